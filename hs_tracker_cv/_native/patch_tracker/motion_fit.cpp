// Iteratively re-weighted least squares with the weights of S. Geman and D. McClure, "Statistical methods for
// tomographic image reconstruction", Bulletin of the ISI 1987; the scale is the median residual.
#include "motion_fit.hpp"

#include "../arithmetic.hpp"

#include <cmath>

namespace hs {
namespace {

constexpr Index ROUNDS = 8, BINS = 512;
constexpr float BINS_PER_SAMPLE = 64.0f;
constexpr double LEAST_MEDIAN = 0.05;       // samples: residuals are never taken to be smaller
constexpr float TEXTURE = 30.0f;            // squared gradient from which a pixel counts more than half
constexpr float UNEXPLAINED = 8.0f;         // gray levels that the flow leaves, from which it counts a quarter
constexpr double LEAST_SURROUNDINGS = 10.0; // weight from which a second motion is looked for
constexpr double LEAST_APART = 0.25;        // share of the object's weight that must not move with its surroundings

// ---- the fit ----

// Every second pixel of a row, in whole blocks of LANES: flow and weight, which is 0 beyond the end.
struct Samples {
    float *u, *v, *weight;
    Index height, width, stride;
};

Index stride_of(Index width) { return ((width + 1) / 2 + LANES - 1) / LANES * LANES; }

void thin(const float *HS_RESTRICT flow, const float *HS_RESTRICT weights, const Samples &samples) {
    for (Index y = 0; y < samples.height; ++y) {
        const Index start = y * samples.stride, row = y * samples.width, count = (samples.width + 1) / 2;
        for (Index i = 0; i < count; ++i) {
            samples.u[start + i] = flow[2 * (row + 2 * i)];
            samples.v[start + i] = flow[2 * (row + 2 * i) + 1];
            samples.weight[start + i] = weights[row + 2 * i];
        }
        for (Index i = start + count; i < start + samples.stride; ++i)
            samples.u[i] = samples.v[i] = samples.weight[i] = 0.0f;
    }
}

// Weighted sums over samples of: 1, x, y, x² + y², u, v, (x, y) · (u, v), (x, y) × (u, v); and of the weights before
// they are lowered.
struct FitSums {
    double one, x, y, square, u, v, dot, cross, prior;
};

// One round over every second row: the sums, and the histogram's bin of each residual from the motion so far.
FitSums add_rows(const Samples &samples, Index first, const Motion &old, float lowering,
                 std::int32_t *HS_RESTRICT bins) {
    const double right = old.right, down = old.down, growth = old.growth, turn = old.turn;
    double one[LANES] = {}, x[LANES] = {}, y[LANES] = {}, square[LANES] = {}, u[LANES] = {}, v[LANES] = {};
    double dot[LANES] = {}, cross[LANES] = {}, prior[LANES] = {};
    for (Index row = first; row < samples.height; row += 2) {
        const double py = row - 0.5 * (samples.height - 1), mx = 0.5 * (samples.width - 1);
        for (Index start = 0; start < samples.stride; start += LANES) {
            const Index at = row * samples.stride + start;
            const float *HS_RESTRICT us = samples.u + at, *HS_RESTRICT vs = samples.v + at;
            const float *HS_RESTRICT weights = samples.weight + at;
            std::int32_t *HS_RESTRICT own = bins + at;
            const double left = static_cast<double>(2 * start) - mx;
#pragma omp simd
            for (int l = 0; l < LANES; ++l) {
                const double px = left + 2 * l, du = us[l] - right - growth * px + turn * py;
                const double dv = vs[l] - down - growth * py - turn * px, residual = du * du + dv * dv;
                // Roots and quotients of float32 take a fourth of the time.
                const float square_left = static_cast<float>(residual), fair = 1.0f + square_left * lowering;
                const double w = weights[l] / (fair * fair);
                const float bin = std::sqrt(square_left) * BINS_PER_SAMPLE;
                own[l] = static_cast<std::int32_t>(bin < BINS - 1.0f ? bin : BINS - 1.0f);
                prior[l] += weights[l];
                one[l] += w;
                x[l] += w * px;
                y[l] += w * py;
                square[l] += w * (px * px + py * py);
                u[l] += w * us[l];
                v[l] += w * vs[l];
                dot[l] += w * (px * us[l] + py * vs[l]);
                cross[l] += w * (px * vs[l] - py * us[l]);
            }
        }
    }
    return {total(one), total(x), total(y), total(square), total(u), total(v), total(dot), total(cross), total(prior)};
}

Motion solve(const FitSums &sums, bool rotation) {
    const double n = sums.one + 1e-9, x = sums.x, y = sums.y, u = sums.u, v = sums.v;
    const double spread = sums.square - (x * x + y * y) / n + 1e-6;
    const double growth = (sums.dot - (x * u + y * v) / n) / spread;
    const double turn = rotation ? (sums.cross - (x * v - y * u) / n) / spread : 0.0;
    return {(u - growth * x + turn * y) / n, (v - growth * y - turn * x) / n, growth, turn};
}

// Median of the residuals of every second row by a histogram; four side by side, so that hardly ever two additions
// in a row wait for each other.
double median_of(const Samples &samples, Index first, const std::int32_t *bins, double half) {
    constexpr Index SIDES = 4;
    double histogram[SIDES * BINS];
    for (Index i = 0; i < SIDES * BINS; ++i) histogram[i] = 0.0;
    const Index count = (samples.width + 1) / 2;
    for (Index row = first; row < samples.height; row += 2) {
        const std::int32_t *own = bins + row * samples.stride;
        const float *weights = samples.weight + row * samples.stride;
        for (Index i = 0; i < count; ++i) histogram[SIDES * own[i] + i % SIDES] += weights[i];
    }
    double running = 0.0;
    Index i = 0;
    for (const double *bin = histogram; i < BINS - 1; ++i, bin += SIDES) {
        const double next = running + ((bin[0] + bin[1]) + (bin[2] + bin[3]));
        if (!(next < half)) break;
        running = next;
    }
    return (i + 0.5) / BINS_PER_SAMPLE;
}

// Fit u = right + growth · x - turn · y, v = down + growth · y + turn · x; the median residual is written too.
Motion fit_flow(const Samples &samples, bool rotation, std::int32_t *bins, double *median) {
    Motion motion = solve(add_rows(samples, 0, {}, 0.0f, bins), rotation); // at first nothing is known of residuals
    *median = 1.0;
    for (Index round = 1; round < ROUNDS; ++round) {
        const double limit = 1.5 * larger(LEAST_MEDIAN, 1.48 * *median);
        const FitSums sums = add_rows(samples, round % 2, motion, static_cast<float>(1.0 / (limit * limit)), bins);
        *median = median_of(samples, round % 2, bins, 0.5 * sums.prior);
        motion = solve(sums, rotation);
    }
    return motion;
}

// ---- weights ----

// Bilinear read inside of a plane, whose last pixel is (last_x, last_y).
inline float read(const float *HS_RESTRICT plane, std::int32_t width, float x, float y, float last_x, float last_y) {
    const std::int32_t ix = static_cast<std::int32_t>(x < last_x - 1.0f ? x : last_x - 1.0f);
    const std::int32_t iy = static_cast<std::int32_t>(y < last_y - 1.0f ? y : last_y - 1.0f), at = iy * width + ix;
    const float fx = x - static_cast<float>(ix), fy = y - static_cast<float>(iy);
    const float a = plane[at], b = plane[at + 1], c = plane[at + width], d = plane[at + width + 1];
    const float top = a + fx * (b - a), low = c + fx * (d - c);
    return top + fy * (low - top);
}

inline float inside(float value, float last) {
    const float positive = value > 0.0f ? value : 0.0f; // 0 where it is not a number
    return positive < last ? positive : last;
}

// |second(x + flow) - first|, into rows of width + 2 with a ring that repeats the border.
void compare(const PatchFlow &patches, float *differences) {
    const std::int32_t width = static_cast<std::int32_t>(patches.width);
    const float last_x = static_cast<float>(width - 1), last_y = static_cast<float>(patches.height - 1);
    const float *HS_RESTRICT second = patches.second;
    for (Index y = 0; y < patches.height; ++y) {
        const float *HS_RESTRICT flow = patches.flow + 2 * y * width, *HS_RESTRICT first = patches.first + y * width;
        float *HS_RESTRICT out = differences + (y + 1) * (width + 2) + 1;
        const float row = static_cast<float>(y);
#pragma omp simd
        for (std::int32_t x = 0; x < width; ++x) {
            const float px = inside(static_cast<float>(x) + flow[2 * x], last_x);
            const float py = inside(row + flow[2 * x + 1], last_y);
            out[x] = std::fabs(read(second, width, px, py, last_x, last_y) - first[x]);
        }
    }
}

void repeat_border(float *padded, Index height, Index width) {
    const Index stride = width + 2;
    for (Index y = 1; y <= height; ++y) {
        float *row = padded + y * stride;
        row[0] = row[1];
        row[width + 1] = row[width];
    }
    for (Index x = 0; x < stride; ++x) {
        padded[x] = padded[stride + x];
        padded[(height + 1) * stride + x] = padded[height * stride + x];
    }
}

// Likelihood of the object's colours at the pixels of a row, plus a little.
void read_colours(const ColourPrior &colours, Index y, Index height, Index width, float *HS_RESTRICT out) {
    const float last_x = static_cast<float>(colours.columns - 1), last_y = static_cast<float>(colours.rows - 1);
    const float ratio = static_cast<float>(colours.ratio), left = 0.5f * last_x - 0.5f * (width - 1) * ratio;
    const float py = inside(0.5f * last_y + (y - 0.5f * (height - 1)) * ratio, last_y);
    const float *HS_RESTRICT likelihood = colours.likelihood;
    const std::int32_t columns = static_cast<std::int32_t>(colours.columns);
#pragma omp simd
    for (std::int32_t x = 0; x < static_cast<std::int32_t>(width); ++x) {
        const float px = inside(left + static_cast<float>(x) * ratio, last_x);
        out[x] = 0.1f + read(likelihood, columns, px, py, last_x, last_y);
    }
}

// A pixel weighs prior · G / (G + TEXTURE) / (1 + (r / UNEXPLAINED)²)², G being the squared gradient of the first
// patch and r the 3 × 3 mean of what the flow does not explain. `planes` as in MotionFit; `around` are the weights of
// the surroundings.
void weigh_row(const float *HS_RESTRICT first, const float *HS_RESTRICT differences, Index stride, Index width,
               const float *HS_RESTRICT outside, const float *HS_RESTRICT prior, float *HS_RESTRICT weights,
               float *HS_RESTRICT around) {
    const float *HS_RESTRICT up = differences - stride, *HS_RESTRICT down = differences + stride;
#pragma omp simd
    for (Index x = 0; x < width; ++x) {
        const float near = up[x - 1] + up[x] + up[x + 1] + differences[x - 1] + differences[x] + differences[x + 1] +
                           down[x - 1] + down[x] + down[x + 1];
        const float left = near * (1.0f / 9.0f / UNEXPLAINED), fair = 1.0f + left * left;
        const float gx = 0.5f * (first[x + 1] - first[x - 1]), gy = 0.5f * (first[x + stride] - first[x - stride]);
        const float strength = gx * gx + gy * gy, share = strength / ((strength + TEXTURE) * (fair * fair));
        weights[x] = prior[x] * share;
        around[x] = outside[x] * share;
    }
}

void weigh_pixels(const PatchFlow &patches, const FitPriors &priors, float *room, float *planes, float *around) {
    const Index width = patches.width, height = patches.height, size = width * height, stride = width + 2;
    float *differences = room, *first = differences + stride * (height + 2);
    compare(patches, differences);
    for (Index y = 0; y < height; ++y)
        for (Index x = 0; x < width; ++x) first[(y + 1) * stride + x + 1] = patches.first[y * width + x];
    repeat_border(differences, height, width);
    repeat_border(first, height, width);
    for (Index y = 0; y < height; ++y) {
        float *HS_RESTRICT prior = planes + 2 * size + y * width, *HS_RESTRICT share = planes + size + y * width;
        const float *HS_RESTRICT object = priors.object + y * width;
        for (Index x = 0; x < width; ++x) share[x] = 1.0f;
        if (priors.colours.likelihood) {
            read_colours(priors.colours, y, height, width, prior);
            for (Index x = 0; x < width; ++x) prior[x] *= object[x];
        } else
            for (Index x = 0; x < width; ++x) prior[x] = object[x];
        const Index inner = (y + 1) * stride + 1;
        weigh_row(first + inner, differences + inner, stride, width, priors.surroundings + y * width, prior,
                  planes + y * width, around + y * width);
    }
}

// ---- object and surroundings ----

// Squared distance of a pixel's flow from a motion, samples².
inline double misfit(const float *flow, double px, double py, const Motion &motion) {
    const double du = flow[0] - motion.right - motion.growth * px + motion.turn * py;
    const double dv = flow[1] - motion.down - motion.growth * py - motion.turn * px;
    return du * du + dv * dv;
}

// Weights of the object without the pixels that move with the surroundings, whose residuals have that median.
void leave_out(const PatchFlow &patches, const Motion &surroundings, double median, const float *HS_RESTRICT weights,
               float *HS_RESTRICT left) {
    const double spread = 0.25 + 1.5 * median, factor = 0.5 / (spread * spread);
    for (Index y = 0; y < patches.height; ++y) {
        const double py = y - 0.5 * (patches.height - 1), mx = 0.5 * (patches.width - 1);
        const Index row = y * patches.width;
#pragma omp simd
        for (Index x = 0; x < patches.width; ++x) {
            const double apart = misfit(patches.flow + 2 * (row + x), static_cast<double>(x) - mx, py, surroundings);
            left[row + x] = static_cast<float>(weights[row + x] * (1.0 - decay(apart * factor)));
        }
    }
}

void share_out(const PatchFlow &patches, const Motion &object, const Motion &surroundings, float *HS_RESTRICT shares) {
    for (Index y = 0; y < patches.height; ++y) {
        const double py = y - 0.5 * (patches.height - 1), mx = 0.5 * (patches.width - 1);
        const Index row = y * patches.width;
#pragma omp simd
        for (Index x = 0; x < patches.width; ++x) {
            const float *flow = patches.flow + 2 * (row + x);
            const double px = static_cast<double>(x) - mx, apart = misfit(flow, px, py, surroundings);
            shares[row + x] = static_cast<float>(apart / (apart + misfit(flow, px, py, object) + 0.02));
        }
    }
}

Index integers(Index height, Index width) { return height * stride_of(width); }

Index floats(Index height, Index width) {
    return 2 * (height + 2) * (width + 2) + height * width + 3 * height * stride_of(width);
}

MotionFit fit(const PatchFlow &patches, const FitPriors &priors, const FitRoom &room, float *planes) {
    const Index height = patches.height, width = patches.width, size = height * width;
    const Index thinned = height * stride_of(width);
    float *around = room.floats, *padded = around + size, *thin_u = padded + 2 * (height + 2) * (width + 2);
    const Samples samples{thin_u, thin_u + thinned, thin_u + 2 * thinned, height, width, stride_of(width)};
    const auto fit_with = [&](const float *weights, double *median) {
        thin(patches.flow, weights, samples);
        return fit_flow(samples, priors.rotation, room.integers, median);
    };
    const auto whole = [size](const float *weights) {
        return sum(size, [=](Index i) { return static_cast<double>(weights[i]); });
    };
    double ignored = 1.0, median = 1.0;
    weigh_pixels(patches, priors, padded, planes, around);
    const Motion together = fit_with(planes, &ignored);
    if (priors.separation < 0.0 || whole(around) < LEAST_SURROUNDINGS) return {together, false};
    const Motion background = fit_with(around, &median);
    leave_out(patches, background, median, planes, around);
    if (whole(around) < LEAST_APART * whole(planes) + 1e-3) return {together, false};
    const Motion object = fit_with(around, &ignored);
    const double right = object.right - background.right, down = object.down - background.down;
    const bool apart = right * right + down * down >= priors.separation * priors.separation;
    if (apart) share_out(patches, object, background, planes + size);
    return {object, apart};
}

} // namespace

extern const MotionFitKernels HS_JOIN(motion_fit, HS_LEVEL) = {floats, integers, fit};

} // namespace hs
