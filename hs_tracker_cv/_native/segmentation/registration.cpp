#include "registration.hpp"

#include "room.hpp"
#include "sums.hpp"

#include <cmath>

namespace hs {
namespace HS_LEVEL {
namespace {

constexpr Index CHUNK = 64;        // points at a time, a multiple of LANES
constexpr double SETTLED = 0.02;   // px, of a step: what the next one would add is a fraction of that
constexpr double BRIGHTNESS = 0.1; // px that a percent of gain or a gray level of bias is worth there
constexpr double UNSEEN = 1e9;     // cost of a motion that takes the points out of the frame

inline Index whole(Index count) { return (count + LANES - 1) / LANES * LANES; }

// Solve the symmetric positive definite system a x = b in place (Cholesky), of which the lower triangle is read; x is
// left in `b`.
template <Index N> void solve(double (&a)[N][N], double (&b)[N]) {
    for (Index j = 0; j < N; ++j) {
        for (Index k = 0; k < j; ++k) {
            b[j] -= a[j][k] * b[k];
            for (Index i = j; i < N; ++i) a[i][j] -= a[i][k] * a[j][k];
        }
        const double pivot = std::sqrt(larger(a[j][j], 1e-9));
        for (Index i = j; i < N; ++i) a[i][j] /= pivot;
        b[j] /= pivot;
    }
    for (Index i = N - 1; i >= 0; --i) {
        for (Index k = i + 1; k < N; ++k) b[i] -= a[k][i] * b[k];
        b[i] /= a[i][i];
    }
}

inline const float *row(const Points &points, Index i) { return points.data + i * points.room; }

// A chunk of points: what belongs to them, where they are by a motion, and the four pixels there. Weights are 0 outside
// the frame and in what makes the chunk a multiple of LANES.
struct Chunk {
    double x[CHUNK], y[CHUNK], wanted[CHUNK], weight[CHUNK];
    double right[CHUNK], down[CHUNK]; // parts of a pixel
    float corner[CHANNELS][4][CHUNK];
    float value[CHANNELS][3][CHUNK]; // of the layer: value and quarters of differences
    Index count, padded;
};

void look_up(Size size, const float *image, const Points &points, Index first, const double *theta,
             const Rectangle &inside, Chunk *chunk) {
    const Index m = smaller(points.count - first, CHUNK), w = size.width;
    Chunk &out = *chunk;
    out.count = m;
    out.padded = whole(m);
    const float *HS_RESTRICT px = row(points, 0) + first, *HS_RESTRICT py = row(points, 1) + first;
    const float *HS_RESTRICT gx = row(points, 2) + first, *HS_RESTRICT gy = row(points, 3) + first;
    const float *HS_RESTRICT own = row(points, 4) + first;
    const double t0 = theta[0], t1 = theta[1], t2 = theta[2], t3 = theta[3], t4 = theta[4], t5 = theta[5];
    const auto left = static_cast<double>(inside.left), top = static_cast<double>(inside.top);
    const auto right = static_cast<double>(inside.right - 1), bottom = static_cast<double>(inside.bottom - 1);
    const double most_x = static_cast<double>(w) - 1.001, most_y = static_cast<double>(size.height) - 1.001;
    std::int32_t at[CHUNK];
#pragma omp simd
    for (Index i = 0; i < m; ++i) {
        const double x = gx[i], y = gy[i], weight = own[i];
        const double qx = px[i] + t0 + t1 * x + t2 * y, qy = py[i] + t3 + t4 * x + t5 * y;
        const bool within = (qx >= left) & (qy >= top) & (qx < right) & (qy < bottom);
        const double in_x = smaller(larger(qx, 0.0), most_x), in_y = smaller(larger(qy, 0.0), most_y);
        const auto ix = static_cast<std::int32_t>(in_x), iy = static_cast<std::int32_t>(in_y);
        out.x[i] = x;
        out.y[i] = y;
        out.wanted[i] = weight;
        out.weight[i] = within ? weight : 0.0;
        out.right[i] = in_x - ix;
        out.down[i] = in_y - iy;
        at[i] = iy * static_cast<std::int32_t>(w) + ix;
    }
    for (Index i = 0; i < m; ++i) {
        const float *p = image + CHANNELS * static_cast<Index>(at[i]), *q = p + CHANNELS * w;
        for (Index c = 0; c < CHANNELS; ++c) {
            out.corner[c][0][i] = p[c];
            out.corner[c][1][i] = p[CHANNELS + c];
            out.corner[c][2][i] = q[c];
            out.corner[c][3][i] = q[CHANNELS + c];
        }
    }
    for (Index c = 0; c < CHANNELS; ++c)
        for (Index k = 0; k < 3; ++k) {
            const float *HS_RESTRICT in = row(points, 5 + 3 * c + k) + first;
            for (Index i = 0; i < m; ++i) out.value[c][k][i] = in[i];
        }
    for (Index i = m; i < out.padded; ++i) {
        out.x[i] = out.y[i] = out.wanted[i] = out.weight[i] = out.right[i] = out.down[i] = 0.0;
        for (Index c = 0; c < CHANNELS; ++c) {
            for (Index k = 0; k < 4; ++k) out.corner[c][k][i] = 0.0f;
            for (Index k = 0; k < 3; ++k) out.value[c][k][i] = 0.0f;
        }
    }
}

// Mean of squared differences over the channels.
void square_errors(const Chunk &chunk, double gain, double bias, double *HS_RESTRICT square) {
#pragma omp simd
    for (Index i = 0; i < chunk.padded; ++i) {
        double sum = 0.0;
        for (Index c = 0; c < CHANNELS; ++c) {
            const double i00 = chunk.corner[c][0][i], i01 = chunk.corner[c][1][i];
            const double i10 = chunk.corner[c][2][i], i11 = chunk.corner[c][3][i];
            const double above = i00 + chunk.right[i] * (i01 - i00), below = i10 + chunk.right[i] * (i11 - i10);
            const double e = above + chunk.down[i] * (below - above) - gain * chunk.value[c][0][i] - bias;
            sum += e * e;
        }
        square[i] = sum * (1.0 / CHANNELS);
    }
}

// Weights of the listed points, of those in the frame, and their costs.
struct Cost {
    Parts wanted{}, used{}, cost{};
};

void add_cost(const Chunk &chunk, const double *square, double ceiling, Cost *sum) {
    double error[CHUNK];
#pragma omp simd
    for (Index i = 0; i < chunk.padded; ++i) error[i] = smaller(std::sqrt(square[i]), ceiling);
    add(&sum->wanted, chunk.wanted, chunk.padded);
    add(&sum->used, chunk.weight, chunk.padded);
    add_products(&sum->cost, chunk.weight, error, chunk.padded);
}

double mean(const Cost &sum) {
    const double used = total(sum.used);
    return used < 0.25 * total(sum.wanted) || used <= 0.0 ? UNSEEN : total(sum.cost) / used;
}

// Sums over the channels, for each point, of products of the gradient (x, y), the error e, the layer's value r and 1.
struct Products {
    double xx[CHUNK], xy[CHUNK], yy[CHUNK], xr[CHUNK], yr[CHUNK], x1[CHUNK], y1[CHUNK];
    double rr[CHUNK], r1[CHUNK], xe[CHUNK], ye[CHUNK], re[CHUNK], e1[CHUNK], square[CHUNK];
};

void multiply(const Chunk &chunk, double gain, double bias, Products *products) {
    Products &out = *products;
#pragma omp simd
    for (Index i = 0; i < chunk.padded; ++i) {
        const double fx = chunk.right[i], fy = chunk.down[i];
        double xx = 0.0, xy = 0.0, yy = 0.0, xr = 0.0, yr = 0.0, x1 = 0.0, y1 = 0.0;
        double rr = 0.0, r1 = 0.0, xe = 0.0, ye = 0.0, re = 0.0, e1 = 0.0, ee = 0.0;
        for (Index c = 0; c < CHANNELS; ++c) {
            const double i00 = chunk.corner[c][0][i], i10 = chunk.corner[c][2][i];
            const double across = chunk.corner[c][1][i] - i00, twist = chunk.corner[c][3][i] - i10 - across;
            const double value = chunk.value[c][0][i], down = i10 - i00 + fx * twist;
            const double e = i00 + fx * across + fy * down - gain * value - bias;
            // The mean of both images' gradients: nearly second-order convergence.
            const double gx = 0.5 * (across + fy * twist) + gain * chunk.value[c][1][i];
            const double gy = 0.5 * down + gain * chunk.value[c][2][i];
            const double r = -0.01 * value;
            xx += gx * gx, xy += gx * gy, yy += gy * gy;
            xe += gx * e, ye += gy * e, re += r * e, e1 -= e, ee += e * e;
            xr += gx * r, yr += gy * r, x1 -= gx, y1 -= gy, rr += r * r, r1 -= r;
        }
        out.xx[i] = xx, out.xy[i] = xy, out.yy[i] = yy, out.xr[i] = xr, out.yr[i] = yr, out.x1[i] = x1, out.y1[i] = y1;
        out.rr[i] = rr, out.r1[i] = r1, out.xe[i] = xe, out.ye[i] = ye, out.re[i] = re, out.e1[i] = e1;
        out.square[i] = ee * (1.0 / CHANNELS);
    }
}

// Weights of a chunk's points times powers of X and Y.
struct Weights {
    double one[CHUNK], x[CHUNK], y[CHUNK], xx[CHUNK], xy[CHUNK], yy[CHUNK];
};

// Weights by the errors: Geman and McClure's.
void weigh(const Chunk &chunk, const double *HS_RESTRICT square, double scale, Weights *weights) {
    Weights &out = *weights;
    const double unit = scale * scale;
#pragma omp simd
    for (Index i = 0; i < chunk.padded; ++i) {
        const double rho = 1.0 + square[i] / unit, w = chunk.weight[i] * (1.0 / CHANNELS) / (rho * rho);
        const double x = chunk.x[i], y = chunk.y[i], wx = w * x, wy = w * y;
        out.one[i] = w, out.x[i] = wx, out.y[i] = wy, out.xx[i] = wx * x, out.xy[i] = wx * y, out.yy[i] = wy * y;
    }
}

// Sums of which the normal equations are made.
struct Normal {
    Parts xx[6]{}, xy[6]{}, yy[6]{};          // times 1, X, Y, XX, XY, YY
    Parts xr[3]{}, yr[3]{}, x1[3]{}, y1[3]{}; // times 1, X, Y
    Parts xe[3]{}, ye[3]{};
    Parts rr{}, r1{}, one{}, re{}, e1{};
    Cost cost;
};

void add_six(Parts (&sum)[6], const Weights &w, const double *values, Index count) {
    const double *const weights[6] = {w.one, w.x, w.y, w.xx, w.xy, w.yy};
    for (Index k = 0; k < 6; ++k) add_products(&sum[k], weights[k], values, count);
}

void add_three(Parts (&sum)[3], const Weights &w, const double *values, Index count) {
    add_products(&sum[0], w.one, values, count);
    add_products(&sum[1], w.x, values, count);
    add_products(&sum[2], w.y, values, count);
}

void add_chunk(const Chunk &chunk, double gain, double bias, double scale, double ceiling, Normal *sum) {
    Products p;
    Weights w;
    multiply(chunk, gain, bias, &p);
    weigh(chunk, p.square, scale, &w);
    add_cost(chunk, p.square, ceiling, &sum->cost);
    const Index n = chunk.padded;
    add_six(sum->xx, w, p.xx, n);
    add_six(sum->xy, w, p.xy, n);
    add_six(sum->yy, w, p.yy, n);
    add_three(sum->xr, w, p.xr, n);
    add_three(sum->yr, w, p.yr, n);
    add_three(sum->x1, w, p.x1, n);
    add_three(sum->y1, w, p.y1, n);
    add_three(sum->xe, w, p.xe, n);
    add_three(sum->ye, w, p.ye, n);
    add_products(&sum->rr, w.one, p.rr, n);
    add_products(&sum->r1, w.one, p.r1, n);
    add_products(&sum->re, w.one, p.re, n);
    add_products(&sum->e1, w.one, p.e1, n);
    add(&sum->one, w.one, n);
}

// A 3 × 3 block of the normal equations, symmetric, from its six sums.
void put_block(double (&matrix)[THETA][THETA], Index row, Index column, const Parts (&sum)[6]) {
    constexpr Index PLACE[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    for (Index i = 0; i < 3; ++i)
        for (Index j = 0; j < 3; ++j) matrix[row + i][column + j] = total(sum[PLACE[i][j]]);
}

// The normal equations of one step; the lower triangle is all that is read.
void assemble(const Normal &sum, double (&matrix)[THETA][THETA], double (&rhs)[THETA]) {
    put_block(matrix, 0, 0, sum.xx);
    put_block(matrix, 3, 0, sum.xy);
    put_block(matrix, 3, 3, sum.yy);
    for (Index i = 0; i < 3; ++i) {
        matrix[6][i] = total(sum.xr[i]);
        matrix[6][3 + i] = total(sum.yr[i]);
        matrix[7][i] = total(sum.x1[i]);
        matrix[7][3 + i] = total(sum.y1[i]);
        rhs[i] = -total(sum.xe[i]);
        rhs[3 + i] = -total(sum.ye[i]);
    }
    matrix[6][6] = total(sum.rr);
    matrix[7][6] = total(sum.r1);
    matrix[7][7] = total(sum.one) * CHANNELS;
    rhs[6] = -total(sum.re);
    rhs[7] = -total(sum.e1);
}

// What pulls a motion back: towards the start, and towards translation, rotation and change of size.
void hold(const Registration &how, double wanted, const double *theta, const double *start,
          double (&matrix)[THETA][THETA], double (&rhs)[THETA]) {
    for (Index i = 0; i < THETA; ++i) {
        matrix[i][i] += how.prior[i] * wanted;
        rhs[i] -= how.prior[i] * wanted * (theta[i] - start[i]);
    }
    const double firm = how.stiffness * wanted;
    const double stretch = firm * (theta[1] - theta[5]), shear = firm * (theta[2] + theta[4]);
    matrix[1][1] += firm;
    matrix[5][5] += firm;
    matrix[5][1] -= firm;
    matrix[2][2] += firm;
    matrix[4][4] += firm;
    matrix[4][2] += firm;
    rhs[1] -= stretch;
    rhs[5] += stretch;
    rhs[2] -= shear;
    rhs[4] -= shear;
}

// Add a step, shortened to 1.5 px; the largest change, in px or what is worth as much.
double advance(const double (&step)[THETA], double *theta) {
    const double longest = larger(std::sqrt(step[0] * step[0] + step[3] * step[3]), 1e-6);
    const double shorten = smaller(1.0, 1.5 / longest);
    double change = 0.0;
    for (Index i = 0; i < THETA; ++i) {
        theta[i] += shorten * step[i];
        change = larger(change, std::fabs(step[i]) * (i < 6 ? 1.0 : BRIGHTNESS));
    }
    return change;
}

} // namespace

Index every(double area, Index wanted) {
    return larger<Index>(static_cast<Index>(area / static_cast<double>(wanted) + 0.5), 1);
}

void collect(Size size, const float *reference, const float *weight, const Grid &grid, Index stride, Points *points) {
    const Index w = size.width, h = size.height, room = points->room;
    Index n = 0;
    for (Index y = 0; y < h; ++y) {
        const float *here = reference + CHANNELS * y * w, *up = y > 0 ? here - CHANNELS * w : here;
        const float *down = y + 1 < h ? here + CHANNELS * w : here;
        for (Index x = y % stride; x < w && n < room; x += stride) {
            const float own = weight[y * w + x];
            if (own <= 0.0f) continue;
            const Index left = CHANNELS * larger<Index>(x - 1, 0), right = CHANNELS * smaller(x + 1, w - 1);
            float *out = points->data + n++;
            const auto px = static_cast<double>(x), py = static_cast<double>(y);
            out[0] = static_cast<float>(x);
            out[room] = static_cast<float>(y);
            out[2 * room] = static_cast<float>((px - grid.cx) / grid.scale);
            out[3 * room] = static_cast<float>((py - grid.cy) / grid.scale);
            out[4 * room] = own;
            for (Index c = 0; c < CHANNELS; ++c) {
                out[(5 + 3 * c) * room] = here[CHANNELS * x + c];
                out[(6 + 3 * c) * room] = 0.25f * (here[right + c] - here[left + c]);
                out[(7 + 3 * c) * room] = 0.25f * (down[CHANNELS * x + c] - up[CHANNELS * x + c]);
            }
        }
    }
    points->count = n;
}

double residual(Size size, const float *image, const Points &points, const double *theta, double ceiling,
                const Rectangle &inside) {
    const double gain = 1.0 + 0.01 * theta[6], bias = theta[7];
    Chunk chunk;
    double square[CHUNK];
    Cost cost;
    for (Index first = 0; first < points.count; first += CHUNK) {
        look_up(size, image, points, first, theta, inside, &chunk);
        square_errors(chunk, gain, bias, square);
        add_cost(chunk, square, ceiling, &cost);
    }
    return mean(cost);
}

void gauss_newton(Size size, const float *image, const Points &points, const Registration &how, const Rectangle &inside,
                  double *theta, double *costs) {
    double start[THETA], matrix[THETA][THETA], step[THETA];
    for (Index i = 0; i < THETA; ++i) start[i] = theta[i];
    Chunk chunk;
    for (Index iteration = 0; iteration < how.steps; ++iteration) {
        Normal sum;
        for (Index first = 0; first < points.count; first += CHUNK) {
            look_up(size, image, points, first, theta, inside, &chunk);
            add_chunk(chunk, 1.0 + 0.01 * theta[6], theta[7], how.scale, how.ceiling, &sum);
        }
        costs[1] = mean(sum.cost);
        if (iteration == 0) costs[0] = costs[1];
        if (costs[1] >= UNSEEN) return;
        assemble(sum, matrix, step);
        hold(how, total(sum.cost.wanted), theta, start, matrix, step);
        solve(matrix, step);
        if (advance(step, theta) < SETTLED) return;
    }
    costs[1] = residual(size, image, points, theta, how.ceiling, inside);
    if (how.steps == 0) costs[0] = costs[1];
}

namespace {

constexpr Index THINNED = 3; // every third residual tells the median

// Pixels by which a flow is fitted: rows X, Y, flow (u, v), weight, squared residual.
struct Samples {
    double *x, *y, *u, *v, *weight, *square;
    Index count, padded;
};

Samples take_samples(const Room<double> &room, Index most) {
    double *p = room.get();
    return {p, p + most, p + 2 * most, p + 3 * most, p + 4 * most, p + 5 * most, 0, 0};
}

void sample_flow(Size size, const float *flow, const float *gray, const float *odds, const float *weight,
                 const Grid &grid, const FlowFit &how, Samples *samples) {
    const Index w = size.width;
    const double floor = 4.0 * how.noise * how.noise + 9.0;
    Index n = 0;
    for (Index y = 1; y < size.height - 1; ++y)
        for (Index x = 1 + y % how.stride; x < w - 1; x += how.stride) {
            const Index i = y * w + x;
            if (odds[i] <= 0.0f || weight[i] <= 0.0f) continue;
            const double gx = 0.5 * (gray[i + 1] - gray[i - 1]), gy = 0.5 * (gray[i + w] - gray[i - w]);
            const double g2 = gx * gx + gy * gy, u = flow[2 * i], v = flow[2 * i + 1];
            double share = g2 / (g2 + floor) * smaller(larger(0.5 * (odds[i] + 0.5), 0.1), 1.0);
            if (how.young) {
                const double du = u - how.camera[0], dv = v - how.camera[1];
                share *= smaller(1.0, (du * du + dv * dv) * 4.0 + 0.05);
            }
            samples->x[n] = (static_cast<double>(x) - grid.cx) / grid.scale;
            samples->y[n] = (static_cast<double>(y) - grid.cy) / grid.scale;
            samples->u[n] = u;
            samples->v[n] = v;
            samples->weight[n] = share;
            samples->square[n++] = 0.0;
        }
    samples->count = n;
    samples->padded = whole(n);
    for (; n < samples->padded; ++n)
        samples->x[n] = samples->y[n] = samples->u[n] = samples->v[n] = samples->weight[n] = samples->square[n] = 0.0;
}

// Weighted sums of a fit: of 1, X, Y, XX, XY, YY, and of u and v times 1, X, Y.
struct Moments {
    double one, x, y, xx, xy, yy, u[3], v[3];
};

Moments moments(const Samples &samples, double scale) {
    Parts one{}, x{}, y{}, xx{}, xy{}, yy{}, u[3]{}, v[3]{};
    const double unit = 1.0 / (2.25 * scale * scale);
    for (Index first = 0; first < samples.padded; first += CHUNK) {
        const Index m = smaller(samples.padded - first, CHUNK);
        const double *px = samples.x + first, *py = samples.y + first;
        double w[CHUNK], wx[CHUNK], wy[CHUNK];
#pragma omp simd
        for (Index i = 0; i < m; ++i) {
            const double far = 1.0 + samples.square[first + i] * unit;
            w[i] = samples.weight[first + i] / (far * far);
            wx[i] = w[i] * px[i];
            wy[i] = w[i] * py[i];
        }
        add(&one, w, m);
        add(&x, wx, m);
        add(&y, wy, m);
        add_products(&xx, wx, px, m);
        add_products(&xy, wx, py, m);
        add_products(&yy, wy, py, m);
        const double *const rows[3] = {w, wx, wy};
        for (Index k = 0; k < 3; ++k) {
            add_products(&u[k], rows[k], samples.u + first, m);
            add_products(&v[k], rows[k], samples.v + first, m);
        }
    }
    return {total(one),
            total(x),
            total(y),
            total(xx),
            total(xy),
            total(yy),
            {total(u[0]), total(u[1]), total(u[2])},
            {total(v[0]), total(v[1]), total(v[2])}};
}

// Translation, rotation and change of size: u = tx + growth X - turn Y, v = ty + turn X + growth Y.
void fit_similar(const Moments &m, const FlowFit &how, double count, const double *start, double *theta) {
    const double r0 = how.ridge[0] * count, r1 = (how.ridge[1] + how.ridge[2]) * count;
    double a[4][4] = {{m.one + r0, 0.0, 0.0, 0.0},
                      {0.0, m.one + r0, 0.0, 0.0},
                      {m.x, m.y, m.xx + m.yy + r1, 0.0},
                      {-m.y, m.x, 0.0, m.xx + m.yy + r1}};
    double b[4] = {m.u[0] + r0 * start[0], m.v[0] + r0 * start[3], m.u[1] + m.v[2] + r1 * 0.5 * (start[1] + start[5]),
                   m.v[1] - m.u[2] + r1 * 0.5 * (start[4] - start[2])};
    solve(a, b);
    theta[0] = b[0];
    theta[3] = b[1];
    theta[1] = theta[5] = b[2];
    theta[4] = b[3];
    theta[2] = -b[3];
}

// One component of a general affine motion.
void fit_component(const Moments &m, const double (&right)[3], const FlowFit &how, double count, const double *start,
                   double *theta) {
    double a[3][3] = {{m.one + how.ridge[0] * count, 0.0, 0.0},
                      {m.x, m.xx + how.ridge[1] * count, 0.0},
                      {m.y, m.xy, m.yy + how.ridge[2] * count}};
    double b[3];
    for (Index i = 0; i < 3; ++i) b[i] = right[i] + how.ridge[i] * count * start[i];
    solve(a, b);
    for (Index i = 0; i < 3; ++i) theta[i] = b[i];
}

// Squared residuals of a motion, and their scale: 1.48 times the median residual.
double spread_of(const Samples &samples, const double *theta, float *thinned) {
    const double u0 = theta[0], u1 = theta[1], u2 = theta[2], v0 = theta[3], v1 = theta[4], v2 = theta[5];
    const double *HS_RESTRICT x = samples.x, *HS_RESTRICT y = samples.y;
    const double *HS_RESTRICT u = samples.u, *HS_RESTRICT v = samples.v;
    double *HS_RESTRICT square = samples.square;
#pragma omp simd
    for (Index i = 0; i < samples.padded; ++i) {
        const double ru = u[i] - u0 - u1 * x[i] - u2 * y[i], rv = v[i] - v0 - v1 * x[i] - v2 * y[i];
        square[i] = ru * ru + rv * rv;
    }
    Index n = 0;
    for (Index i = 0; i < samples.count; i += THINNED) thinned[n++] = static_cast<float>(square[i]);
    return larger(0.06, 1.48 * std::sqrt(static_cast<double>(select(thinned, n, 0.5))));
}

} // namespace

void fit_affine(Size size, const float *flow, const float *gray, const float *odds, const float *weight,
                const Grid &grid, const FlowFit &how, double *theta) {
    const Index most = whole(size.height * (size.width / how.stride + 1));
    const Room<double> room(6 * most);
    Samples samples = take_samples(room, most);
    sample_flow(size, flow, gray, odds, weight, grid, how, &samples);
    if (samples.count == 0) return;
    const Room<float> thinned(samples.count / THINNED + 1);
    double start[6], scale = 1e3;
    for (Index i = 0; i < 6; ++i) start[i] = theta[i];
    const auto count = static_cast<double>(samples.count);
    for (int round = 0; round < 5; ++round) {
        const Moments m = moments(samples, scale);
        if (how.young) {
            fit_similar(m, how, count, start, theta);
        } else {
            fit_component(m, m.u, how, count, start, theta);
            fit_component(m, m.v, how, count, start + 3, theta + 3);
        }
        scale = spread_of(samples, theta, thinned.get());
    }
}

} // namespace HS_LEVEL
} // namespace hs
