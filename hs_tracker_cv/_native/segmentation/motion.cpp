#include "motion.hpp"

#include "registration.hpp"
#include "room.hpp"
#include "shapes.hpp"
#include "sums.hpp"

#include <cmath>

namespace hs {
namespace HS_LEVEL {
namespace {

constexpr float NEVER_OBJECT = -2.9f; // log-odds: what lies below has been ground for many frames
constexpr Index FIT_PIXELS = 1200;    // enough for eight parameters; more only cost time
constexpr Index GROUND_PIXELS = 1000;
constexpr Index FEWEST = 60;             // fewer pixels say nothing about the camera
constexpr Index NEAR = 2;                // px round the object in which the flow may be its own
constexpr Index LINEAR[] = {1, 2, 4, 5}; // of a motion's numbers
constexpr double CONTINUE = 1.03;        // the motion found from the predicted one wins where it explains about as well

// ---- prediction ----

// First and last column of a row, none at first.
struct Columns {
    int first, last;
};

// Make a rectangle contain some columns of a row.
inline void include(Rectangle *bounds, const Columns &columns, Index y) {
    if (columns.last < 0) return;
    bounds->top = smaller(bounds->top, y);
    bounds->bottom = y + 1;
    bounds->left = smaller<Index>(bounds->left, columns.first);
    bounds->right = larger<Index>(bounds->right, columns.last + 1);
}

// Where the object {odds > 0} is, and all that may belong to it.
struct Outline {
    Index area, sum_x, sum_y;
    Rectangle object, extent;
};

Outline outline(Size size, const float *odds) {
    const int w = static_cast<int>(size.width);
    const Rectangle none{size.width, size.height, 0, 0};
    Outline found{0, 0, 0, none, none};
    for (Index y = 0; y < size.height; ++y) {
        const float *HS_RESTRICT in = odds + y * w;
        int count = 0, across = 0, low = w, high = -1, may_low = w, may_high = -1;
#pragma omp simd reduction(+ : count, across) reduction(min : low, may_low) reduction(max : high, may_high)
        for (int x = 0; x < w; ++x) {
            const bool own = in[x] > 0.0f, may = in[x] > NEVER_OBJECT;
            count += own;
            across += own ? x : 0;
            low = own && x < low ? x : low;
            high = own && x > high ? x : high;
            may_low = may && x < may_low ? x : may_low;
            may_high = may && x > may_high ? x : may_high;
        }
        found.area += count;
        found.sum_x += across;
        found.sum_y += count * y;
        include(&found.object, {low, high}, y);
        include(&found.extent, {may_low, may_high}, y);
    }
    return found;
}

inline float share(float odds) { return smaller(larger(odds, 0.0f), 1.0f); }

// Weights of the object's pixels; their sum.
double weigh(Size size, const Prediction &what, float *weight) {
    const Index pixels = size.height * size.width;
    const float *HS_RESTRICT in = what.odds;
    const Byte *HS_RESTRICT shown = what.shown;
    float *HS_RESTRICT out = weight;
    if (what.weighing == Weighing::evenly)
        for (Index i = 0; i < pixels; ++i) out[i] = in[i] > 0.0f ? 1.0f : 0.0f;
    else if (what.weighing == Weighing::visible)
        for (Index i = 0; i < pixels; ++i) out[i] = static_cast<float>(shown[i]);
    else
        for (Index i = 0; i < pixels; ++i) out[i] = share(in[i]) * static_cast<float>(shown[i]) * (1.0f / 255.0f);
    return sum_of(weight, pixels);
}

Grid grid_of(const Outline &found, const Grid &otherwise) {
    if (found.area < 4) return otherwise;
    const auto area = static_cast<double>(found.area);
    const Index longest = larger(found.object.right - found.object.left, found.object.bottom - found.object.top);
    return {static_cast<double>(found.sum_x) / area, static_cast<double>(found.sum_y) / area,
            larger(6.0, 0.5 * static_cast<double>(longest)), area};
}

// A motion of the object, in window px.
void affine(double x, double y, const double *linear, double scale, double *theta) {
    theta[0] = x;
    theta[3] = y;
    for (Index i = 0; i < 2; ++i) {
        theta[1 + i] = linear[i] * scale;
        theta[4 + i] = linear[2 + i] * scale;
    }
    theta[6] = theta[7] = 0.0;
}

constexpr double NO_LINEAR[4] = {0.0, 0.0, 0.0, 0.0};

// The last motion, its translation alone or the camera's, whichever explains the frame best; its mean residual.
double best_motion(Size size, const Prediction &what, const Points &points, double scale, double *theta) {
    const double *linear = what.motion + 2;
    double bent = 0.0, other[THETA];
    for (Index i = 0; i < 4; ++i) bent = larger(bent, std::fabs(linear[i]));
    affine(what.motion[0], what.motion[1], linear, scale, theta);
    double cost = residual(size, what.image, points, theta, FAR_OFF, what.inside);
    for (int candidate = bent * scale > 0.02 ? 0 : 1; candidate < 2; ++candidate) {
        const double *velocity = candidate ? what.camera : what.motion;
        const double dx = velocity[0] - theta[0], dy = velocity[1] - theta[3];
        if (candidate == 1 && dx * dx + dy * dy < 0.01) continue;
        affine(velocity[0], velocity[1], NO_LINEAR, scale, other);
        const double other_cost = residual(size, what.image, points, other, FAR_OFF, what.inside);
        if (!(other_cost < cost - 0.3)) continue;
        cost = other_cost;
        for (Index i = 0; i < THETA; ++i) theta[i] = other[i];
    }
    return cost;
}

// ---- the camera ----

// Median flow outside the object; looked at are every fourth pixel of every fourth row. It is exactly zero when it is
// small, the last one when hardly anything is outside.
void camera_flow(Size size, const float *flow, const Byte *near, const double *last, double *camera) {
    const Index most = (size.height / 4 + 1) * (size.width / 4 + 1);
    const Room<float> room(2 * most);
    float *u = room.get(), *v = u + most;
    Index n = 0;
    for (Index y = 0; y < size.height; y += 4)
        for (Index x = y / 4 % 4; x < size.width; x += 4) {
            const Index i = y * size.width + x;
            if (near[i] != 0) continue;
            u[n] = flow[2 * i];
            v[n++] = flow[2 * i + 1];
        }
    const bool enough = 16 * n >= FEWEST;
    camera[0] = enough ? select(u, n, 0.5) : last[0];
    camera[1] = enough ? select(v, n, 0.5) : last[1];
    if (enough && camera[0] * camera[0] + camera[1] * camera[1] < 0.0144) camera[0] = camera[1] = 0.0;
}

// List the known pixels of the background outside the object.
void collect_ground(Size size, const Measurement &what, float *used, Points *points) {
    const Index pixels = size.height * size.width;
    const Byte *HS_RESTRICT near = what.near;
    const float *HS_RESTRICT counts = what.ground.counts;
    float *HS_RESTRICT weight = used;
    int area = 0;
#pragma omp simd reduction(+ : area)
    for (Index i = 0; i < pixels; ++i) {
        const bool free = (near[i] == 0) & (counts[i] >= KNOWN);
        weight[i] = free ? 1.0f : 0.0f;
        area += free;
    }
    const auto w = static_cast<double>(size.width), h = static_cast<double>(size.height);
    const Grid grid{0.5 * w, 0.5 * h, 0.5 * larger(h, w), 0.0};
    collect(size, what.ground.image, used, grid, every(static_cast<double>(area), GROUND_PIXELS), points);
}

// Where the background lies in this frame, and its brightness. Registered with the layer, not with the last frame, so
// that errors don't add up. "The camera stood still" wins ties: otherwise noise slowly blurs the layer.
void register_ground(Size size, const Measurement &what, const double *camera, double *best) {
    const Index pixels = size.height * size.width;
    const Index most = larger<Index>(2400, pixels / 16 + 64); // more than `every` lets through
    const Room<float> room(pixels + POINT_ROWS * most);
    Points points{room.get() + pixels, most, 0};
    collect_ground(size, what, room.get(), &points);
    double still[THETA] = {}, start[THETA] = {}, prior[THETA], costs[2];
    for (double &one : prior) one = 1e6;
    for (Index i = 0; i < 2; ++i) {
        still[3 * i] = start[3 * i] = what.offset[i];
        prior[3 * i] = 0.02 * what.noise * what.noise;
    }
    prior[6] = 1.0;
    const auto cost_of = [&](const double *theta) {
        return residual(size, what.image, points, theta, FAR_OFF, what.inside);
    };
    bool moved = false;
    if (camera[0] != 0.0 || camera[1] != 0.0) {
        for (Index i = 0; i < 2; ++i) start[3 * i] = what.offset[i] + camera[i];
        moved = cost_of(start) < cost_of(still);
        for (Index i = 0; i < 2 && !moved; ++i) start[3 * i] = what.offset[i];
    }
    for (Index i = 0; i < THETA; ++i) best[i] = start[i];
    const Registration how{prior, 3.0 * what.noise, FAR_OFF, 0.0, what.ground_steps};
    gauss_newton(size, what.image, points, how, what.inside, best, costs);
    const double dx = best[0] - start[0], dy = best[3] - start[3];
    double cost = costs[1];
    if (!(costs[1] <= costs[0] && dx * dx + dy * dy < 4.0)) {
        cost = costs[0];
        for (Index i = 0; i < THETA; ++i) best[i] = start[i];
        if (!moved) return;
    }
    still[6] = best[6];
    if (cost_of(still) > 1.03 * cost + 0.02) return;
    for (Index i = 0; i < THETA; ++i) best[i] = still[i];
}

// Offset of the background: on a whole pixel where it nearly is, and was before.
double settled(double now, double before) {
    const double whole = std::floor(now + 0.5);
    return std::fabs(now - whole) < 0.08 && std::fabs(now - before) < 0.15 ? whole : now;
}

// ---- the object ----

// Fit of the flow, which follows the frame pair.
void fit_flow(Size size, const Measurement &what, const double *camera, double *fitted) {
    const double along = what.hidden ? 0.9 : 0.03;
    const FlowFit how{
        what.noise, camera, {what.hidden ? 0.018 : 0.006, along, along}, what.young, every(what.grid.area, FIT_PIXELS)};
    for (Index i = 0; i < THETA; ++i) fitted[i] = what.predicted[i];
    fit_affine(size, what.flow, what.previous, what.odds, what.weight, what.grid, how, fitted);
    const double limit = what.hidden ? 0.0 : 0.35 * what.grid.scale;
    for (const Index i : LINEAR) fitted[i] = smaller(larger(fitted[i], -limit), limit);
}

// Sharpen the fit against the object layer, which keeps it from drifting. Registration starts from the fit and from
// the prediction, and is believed only near its start.
void register_object(Size size, const Measurement &what, const double *fitted, double *best) {
    const double least = larger(what.noise, 2.0), strength = least * least * (what.hidden ? 5.0 : 1.0);
    double prior[THETA], theta[THETA], costs[2], limit = 0.0;
    for (Index i = 0; i < THETA; ++i) {
        prior[i] = 0.05 * strength;
        best[i] = fitted[i];
    }
    prior[0] = prior[3] = prior[7] = 0.02 * strength;
    prior[6] = 0.02;
    // What differs by more than the fit takes seriously (a highlight, something in front) must not decide either.
    const double serious = 3.0 * what.noise + 3.0;
    const Registration how{prior, serious, serious, what.young ? strength : 0.0, what.steps};
    for (int attempt = 0; attempt < 2; ++attempt) {
        const double *start = attempt ? what.predicted : fitted;
        if (attempt && larger(std::fabs(start[0] - fitted[0]), std::fabs(start[3] - fitted[3])) < 0.05) continue;
        for (Index i = 0; i < THETA; ++i) theta[i] = start[i];
        gauss_newton(size, what.image, what.points, how, what.inside, theta, costs);
        if (attempt == 0) limit = costs[0];
        const double dx = theta[0] - start[0], dy = theta[3] - start[3];
        double stretched = 0.0;
        for (const Index i : LINEAR) stretched = larger(stretched, std::fabs(theta[i]));
        if (dx * dx + dy * dy > 9.0 || stretched > 0.4 * what.grid.scale) continue;
        if (!(costs[1] < (attempt ? CONTINUE * limit : limit))) continue;
        limit = costs[1];
        for (Index i = 0; i < THETA; ++i) best[i] = theta[i];
    }
}

// ---- search ----

// A pixel of the object that is looked at.
struct Look {
    Index x, y;
    const float *colour;
};

// Score of a shift, per pixel that is looked at.
double score_shift(Size size, const float *image, const Byte *different, const Look *looks, Index count, Index dx,
                   Index dy, const Rectangle &inside, double unit) {
    double score = 0.0;
    for (Index k = 0; k < count; ++k) {
        const Index x = looks[k].x + dx, y = looks[k].y + dy;
        if (x < inside.left || y < inside.top || x >= inside.right || y >= inside.bottom) continue;
        const Index i = y * size.width + x;
        if (different[i] == 0) continue;
        double e = 0.0;
        for (Index c = 0; c < CHANNELS; ++c) e += std::fabs(image[CHANNELS * i + c] - looks[k].colour[c]);
        score += 1.0 - smaller(e * unit, 2.0);
    }
    return score / static_cast<double>(larger<Index>(count, 1));
}

} // namespace

void start_flow(Size size, const Byte *near, const Grid &grid, const double *theta, const double *camera, float *flow) {
    const double unit = 1.0 / grid.scale;
    const auto camera_x = static_cast<float>(camera[0]), camera_y = static_cast<float>(camera[1]);
    for (Index y = 0; y < size.height; ++y) {
        const Byte *HS_RESTRICT own = near + y * size.width;
        float *HS_RESTRICT out = flow + 2 * y * size.width;
        const double py = (static_cast<double>(y) - grid.cy) * unit;
        const double u = theta[0] + theta[2] * py, v = theta[3] + theta[5] * py;
        for (Index x = 0; x < size.width; ++x) {
            if (own[x] == 0) {
                out[2 * x] = camera_x;
                out[2 * x + 1] = camera_y;
                continue;
            }
            const double px = (static_cast<double>(x) - grid.cx) * unit;
            out[2 * x] = static_cast<float>(u + theta[1] * px);
            out[2 * x + 1] = static_cast<float>(v + theta[4] * px);
        }
    }
}

void predict(Size size, const Prediction &what, Predicted *out) {
    const Index pixels = size.height * size.width;
    const Room<Byte> room(2 * pixels);
    Byte *mask = room.get(), *held = mask + pixels;
    const Outline found = outline(size, what.odds);
    threshold(pixels, what.odds, mask);
    out->visible = weigh(size, what, out->weight);
    out->grid = grid_of(found, what.box);
    out->extent = found.extent;
    widen(size, mask, NEAR, held, out->near);
    collect(size, what.object, out->weight, out->grid, every(out->grid.area, FIT_PIXELS), &out->points);
    out->cost = 0.0;
    if (what.known)
        affine(what.motion[0], what.motion[1], NO_LINEAR, out->grid.scale, out->theta);
    else
        out->cost = best_motion(size, what, out->points, out->grid.scale, out->theta);
    start_flow(size, out->near, out->grid, out->theta, what.camera, out->flow);
}

void measure(Size size, const Measurement &what, double *ground, double *theta) {
    double camera[2], fitted[THETA];
    camera_flow(size, what.flow, what.near, what.camera, camera);
    register_ground(size, what, camera, ground);
    for (Index i = 0; i < 2; ++i) {
        ground[3 * i] = settled(ground[3 * i], what.offset[i]);
        camera[i] = ground[3 * i] - what.offset[i];
    }
    if (what.points.count == 0) return;
    fit_flow(size, what, camera, fitted);
    register_object(size, what, fitted, theta);
}

Found search_shift(Size size, const float *image, const float *object, const float *shape, const Byte *different,
                   const Index *centre, Index reach, Index step, const Rectangle &inside, double noise) {
    const Index pixels = size.height * size.width;
    Index area = 0, count = 0;
    for (Index i = 0; i < pixels; ++i) area += shape[i] > 0.5f;
    const Index stride = larger<Index>(1, static_cast<Index>(std::sqrt(static_cast<double>(area) / 400.0)));
    const Room<Look> room(area);
    Look *looks = room.get();
    for (Index y = 0; y < size.height; y += stride)
        for (Index x = 0; x < size.width; x += stride)
            if (shape[y * size.width + x] > 0.5f) looks[count++] = {x, y, object + CHANNELS * (y * size.width + x)};
    const double unit = 1.0 / ((12.0 + 3.0 * noise) * CHANNELS);
    Found best{-1e9, 0.0, 0, 0};
    for (Index dy = centre[1] - reach; dy <= centre[1] + reach; dy += step)
        for (Index dx = centre[0] - reach; dx <= centre[0] + reach; dx += step) {
            const double score = score_shift(size, image, different, looks, count, dx, dy, inside, unit);
            if (dx == 0 && dy == 0) best.still = score;
            if (score > best.score) best = {score, best.still, dx, dy};
        }
    return best;
}

} // namespace HS_LEVEL
} // namespace hs
