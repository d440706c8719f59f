#include "sweeps.hpp"

#include "derivatives.hpp"

#include <cmath>
#include <initializer_list>

namespace hs {
namespace {

float finite_or_zero(float value) { return std::fabs(value) < 1e30f ? value : 0.0f; }

void load(const float *image, const Plane &out) {
    for (Index y = 0; y < out.height; ++y) {
        const float *HS_RESTRICT in = image + y * out.width;
        float *HS_RESTRICT to = row(out, y);
#pragma omp simd
        for (Index x = 0; x < out.width; ++x) to[x] = finite_or_zero(in[x]);
    }
}

void load_pair(const float *flow, const Pair &out) {
    const Index w = out.u.width;
    for (Index y = 0; y < out.u.height; ++y) {
        const float *HS_RESTRICT in = flow + 2 * y * w;
        float *HS_RESTRICT u = row(out.u, y);
        float *HS_RESTRICT v = row(out.v, y);
#pragma omp simd
        for (Index x = 0; x < w; ++x) {
            u[x] = finite_or_zero(in[2 * x]);
            v[x] = finite_or_zero(in[2 * x + 1]);
        }
    }
}

void store_pair(const Pair &flow, float *out) {
    const Index w = flow.u.width;
    for (Index y = 0; y < flow.u.height; ++y) {
        const float *HS_RESTRICT u = row(flow.u, y);
        const float *HS_RESTRICT v = row(flow.v, y);
        float *HS_RESTRICT to = out + 2 * y * w;
#pragma omp simd
        for (Index x = 0; x < w; ++x) {
            to[2 * x] = u[x];
            to[2 * x + 1] = v[x];
        }
    }
}

// Sum of a row's values in an order that does not depend on the processor.
double row_sum(const float *values, Index count) {
    float lanes[BLOCK] = {};
    Index x = 0;
    for (; x + BLOCK <= count; x += BLOCK)
        for (Index i = 0; i < BLOCK; ++i) lanes[i] += values[x + i];
    for (Index i = 0; x + i < count; ++i) lanes[i] += values[x + i];
    double total = 0.0;
    for (const float lane : lanes) total += lane;
    return total;
}

template <bool FiveTap> void derive_by(const Plane &first, const Plane &second, const Slopes &out) {
    const Index width = first.width;
    for (Index y = 0; y < first.height; ++y) {
        const Rows a = rows_round(first, y), b = rows_round(second, y);
        float *HS_RESTRICT fx = row(out.x, y);
        float *HS_RESTRICT fy = row(out.y, y);
        float *HS_RESTRICT ft = row(out.t, y);
#pragma omp simd
        for (Index x = 0; x < width; ++x) {
            const Slope f = slope_at<FiveTap>(a, b, x);
            fx[x] = f.x;
            fy[x] = f.y;
            ft[x] = f.t;
        }
    }
}

void derive(const Plane &first, const Plane &second, bool five_tap, const Slopes &out) {
    fill_ring(first, 1.0f);
    fill_ring(second, 1.0f);
    (five_tap ? derive_by<true> : derive_by<false>)(first, second, out);
}

template <bool FiveTap>
double scale_by(const Plane &first, const Plane &second, float lambda, const Slopes &g, const Plane *share) {
    const float square_lambda = lambda * lambda;
    double total = 0.0;
    for (Index start = 0; start < first.width; start += TILE) {
        const Index width = first.width - start < TILE ? first.width - start : TILE;
        float right_side[TILE], ratio[TILE];
        for (Index y = 0; y < first.height; ++y) {
            const Rows a = rows_round(first, y), b = rows_round(second, y);
            float *HS_RESTRICT gx = row(g.x, y) + start;
            float *HS_RESTRICT gy = row(g.y, y) + start;
            float *HS_RESTRICT gt = row(g.t, y) + start;
#pragma omp simd
            for (Index x = 0; x < width; ++x) {
                const Slope f = slope_at<FiveTap>(a, b, start + x);
                const float square = f.x * f.x + f.y * f.y;
                const float factor = 1.0f / std::sqrt(square_lambda + square);
                gx[x] = f.x * factor;
                gy[x] = f.y * factor;
                gt[x] = f.t * factor;
                ratio[x] = 1.0f + square / square_lambda;
                right_side[x] = square * f.t * f.t;
            }
            if (!share) continue;
            float *HS_RESTRICT out = row(*share, y) + start;
            for (Index x = 0; x < width; ++x) out[x] = ratio[x];
            total += row_sum(right_side, width);
        }
    }
    return total;
}

double scale(const Plane &first, const Plane &second, bool five_tap, float lambda, const Slopes &g,
             const Plane *share) {
    fill_ring(first, 1.0f);
    fill_ring(second, 1.0f);
    return (five_tap ? scale_by<true> : scale_by<false>)(first, second, lambda, g, share);
}

// The average weighs the neighbours beside, above and below 1/6 and those at the corners 1/12 (step 4 of the paper).
constexpr float SIDE = 1.0f / 6.0f, CORNER = 1.0f / 12.0f;

constexpr Index WIDE = 1040; // pixels of a tile: narrow ones would be too short for the processor to read ahead

// The sums of each pixel's left and right neighbours in part of a row. Those of the row below come from memory, and are
// left for the two rows that follow in place of those of the row above, which nobody needs any more.
struct alignas(64) Beside {
    float u[WIDE], v[WIDE];
    float square[WIDE]; // of the residual, for those who ask
};

// A pass over a tile of each row of a flow, whose ring must be filled one pixel deep: what it reads and writes at the
// row where it is. These pointers walk down rather than being computed at each row, since compilers would then keep
// more of them than there are registers.
struct Pass {
    const float *HS_RESTRICT u_up, *HS_RESTRICT u, *HS_RESTRICT u_down;
    const float *HS_RESTRICT v_up, *HS_RESTRICT v, *HS_RESTRICT v_down;
    Beside *HS_RESTRICT beside_up, *HS_RESTRICT beside;
    const float *HS_RESTRICT gx, *HS_RESTRICT gy, *HS_RESTRICT gt, *HS_RESTRICT share;
    float *HS_RESTRICT u_out, *HS_RESTRICT v_out;
};

inline Pass pass_from(Index start, Index width, const Pair &flow, const Pair &out, const Slopes &g, const Plane *share,
                      Beside *besides) {
    const Plane &u = flow.u, &v = flow.v;
    for (Index y = -1; y < 1; ++y) {
        const float *HS_RESTRICT in_u = row(u, y) + start;
        const float *HS_RESTRICT in_v = row(v, y) + start;
        Beside *HS_RESTRICT sums = besides + y + 1;
#pragma omp simd
        for (Index x = 0; x < width; ++x) {
            sums->u[x] = in_u[x - 1] + in_u[x + 1];
            sums->v[x] = in_v[x - 1] + in_v[x + 1];
        }
    }
    return {row(u, -1) + start,
            row(u, 0) + start,
            row(u, 1) + start,
            row(v, -1) + start,
            row(v, 0) + start,
            row(v, 1) + start,
            besides,
            besides + 1,
            row(g.x, 0) + start,
            row(g.y, 0) + start,
            row(g.t, 0) + start,
            share ? row(*share, 0) + start : nullptr,
            row(out.u, 0) + start,
            row(out.v, 0) + start};
}

inline void next_row(Pass &pass, Index stride) {
    pass.u_up += stride;
    pass.u += stride;
    pass.u_down += stride;
    pass.v_up += stride;
    pass.v += stride;
    pass.v_down += stride;
    Beside *const below = pass.beside_up;
    pass.beside_up = pass.beside;
    pass.beside = below;
    pass.gx += stride;
    pass.gy += stride;
    pass.gt += stride;
    if (pass.share) pass.share += stride;
    pass.u_out += stride;
    pass.v_out += stride;
}

struct Vector {
    float u, v;
};

inline Vector average_at(const Pass &pass, Index x) {
    const float down_u = pass.u_down[x - 1] + pass.u_down[x + 1];
    const float down_v = pass.v_down[x - 1] + pass.v_down[x + 1];
    const float up_u = pass.beside_up->u[x], up_v = pass.beside_up->v[x];
    pass.beside_up->u[x] = down_u;
    pass.beside_up->v[x] = down_v;
    return {SIDE * ((pass.u_up[x] + pass.u_down[x]) + pass.beside->u[x]) + CORNER * (up_u + down_u),
            SIDE * ((pass.v_up[x] + pass.v_down[x]) + pass.beside->v[x]) + CORNER * (up_v + down_v)};
}

// The paper's step: the average, corrected along the gradient.
inline Vector jacobi_at(const Pass &pass, Vector mean, Index x) {
    const float t = pass.gx[x] * mean.u + (pass.gy[x] * mean.v + pass.gt[x]);
    return {mean.u - pass.gx[x] * t, mean.v - pass.gy[x] * t};
}

// (ū - u) - Fx (Fx u + Fy v + Ft) / λ² and the same for v, from g = F / √D and D / λ².
inline Vector residual_at(const Pass &pass, Vector mean, Index x) {
    const float t = pass.share[x] * (pass.gx[x] * pass.u[x] + pass.gy[x] * pass.v[x] + pass.gt[x]);
    return {(mean.u - pass.u[x]) - pass.gx[x] * t, (mean.v - pass.v[x]) - pass.gy[x] * t};
}

// A step, and the squared residual before it.
struct Measured {
    float u, v, square;
};

inline Measured measured_at(const Pass &pass, Vector mean, Index x) {
    const Vector rest = residual_at(pass, mean, x), swept = jacobi_at(pass, mean, x);
    return {swept.u, swept.v, rest.u * rest.u + rest.v * rest.v};
}

// How a sweep's result is mixed: new = older · new + before · (u, v) + jacobi · sweep(u, v).
struct Mix {
    float older, before, jacobi;
};

enum class Kind { Plain, First, Later }; // of sweep: first and later ones of Chebyshev's

template <Kind kind> inline Vector mixed_at(const Pass &pass, const Mix &mix, Vector swept, Index x) {
    if (kind != Kind::Plain)
        swept = {mix.before * pass.u[x] + mix.jacobi * swept.u, mix.before * pass.v[x] + mix.jacobi * swept.v};
    if (kind == Kind::Later) swept = {mix.older * pass.u_out[x] + swept.u, mix.older * pass.v_out[x] + swept.v};
    return swept;
}

// A tile of one row, and the ring beside it while the row is in the cache.
template <Kind kind> inline void sweep_row(Pass &pass, const Mix &mix, Index start, Index width, const Plane &out) {
#pragma omp simd
    for (Index x = 0; x < width; ++x) {
        const Vector vector = mixed_at<kind>(pass, mix, jacobi_at(pass, average_at(pass, x), x), x);
        pass.u_out[x] = vector.u;
        pass.v_out[x] = vector.v;
    }
    const Index right = out.width - start;
    if (start == 0) {
        pass.u_out[-1] = pass.u_out[0];
        pass.v_out[-1] = pass.v_out[0];
    }
    if (right <= width) {
        pass.u_out[right] = pass.u_out[right - 1];
        pass.v_out[right] = pass.v_out[right - 1];
    }
    next_row(pass, out.stride);
}

void fill_ring_above(const Pair &flow) {
    for (const Plane *plane : {&flow.u, &flow.v}) copy_row(*plane, 0, -1, 1.0f);
}

void fill_ring_below(const Pair &flow) {
    const Index last = flow.u.height - 1;
    for (const Plane *plane : {&flow.u, &flow.v}) copy_row(*plane, last, last + 1, 1.0f);
}

template <Kind kind> void one_sweep(const Pair &flow, const Pair &out, const Slopes &g, const Mix &mix) {
    const Index height = out.u.height;
    Beside besides[2];
    for (Index start = 0; start < out.u.width; start += WIDE) {
        const Index width = tile_width(flow.u, start, WIDE);
        Pass pass = pass_from(start, width, flow, out, g, nullptr, besides);
        for (Index y = 0; y < height; ++y) sweep_row<kind>(pass, mix, start, width, out.u);
    }
    fill_ring_above(out);
    fill_ring_below(out);
}

// What each sweep of a solution mixes.
struct Step {
    Mix mix;
    Kind kind;
};

class Steps {
  public:
    explicit Steps(const Relaxation &relaxation)
        : relax_(relaxation.relax), quarter_(relaxation.quarter_square), plain_(relax_ == 1.0f && quarter_ == 0.0f) {}

    Step next() {
        const Step step = {{1.0f - omega_, omega_ * (1.0f - relax_), omega_ * relax_},
                           plain_   ? Kind::Plain
                           : first_ ? Kind::First
                                    : Kind::Later};
        omega_ = 1.0f / (1.0f - (first_ ? 2.0f : omega_) * quarter_);
        first_ = false;
        return step;
    }

  private:
    float relax_, quarter_, omega_ = 1.0f;
    bool plain_, first_ = true;
};

void sweep_apart(const Pair &flow, const Pair &other, const Slopes &g, Index count, Steps steps) {
    for (Index i = 0; i < count; ++i) {
        const Step step = steps.next();
        const auto one = step.kind == Kind::Plain   ? one_sweep<Kind::Plain>
                         : step.kind == Kind::First ? one_sweep<Kind::First>
                                                    : one_sweep<Kind::Later>;
        one(i % 2 ? other : flow, i % 2 ? flow : other, g, step.mix);
    }
}

// One of several sweeps that are under way.
struct Sweep {
    Pair flow, out;
    Step step;
    Pass pass;
    Beside besides[2];
};

template <Kind kind> void next_of(Sweep &sweep) {
    Pass pass = sweep.pass;
    sweep_row<kind>(pass, sweep.step.mix, 0, tile_width(sweep.flow.u, 0, WIDE), sweep.out.u);
    sweep.pass = pass;
}

void next_of(Sweep &sweep, Index y, const Slopes &g) {
    if (y == 0) {
        const Index width = tile_width(sweep.flow.u, 0, WIDE);
        sweep.pass = pass_from(0, width, sweep.flow, sweep.out, g, nullptr, sweep.besides);
    }
    const auto row = sweep.step.kind == Kind::Plain   ? next_of<Kind::Plain>
                     : sweep.step.kind == Kind::First ? next_of<Kind::First>
                                                      : next_of<Kind::Later>;
    row(sweep);
    if (y == 0) fill_ring_above(sweep.out);
    if (y == sweep.out.u.height - 1) fill_ring_below(sweep.out);
}

constexpr Index TOGETHER = 8;  // sweeps that go through a flow together
constexpr Index LARGE = 40000; // pixels from which they do: what a sweep reads and writes is more than a cache holds

// Sweeps of a flow no wider than a tile, each a row behind the one before it: what one has written the next finds in
// the cache, and overwrites only what has been read for the last time.
void sweep_together(const Pair &flow, const Pair &other, const Slopes &g, Index count, Steps steps) {
    const Index height = flow.u.height;
    Sweep sweeps[TOGETHER];
    for (Index first = 0; first < count; first += TOGETHER) {
        const Index some = count - first < TOGETHER ? count - first : TOGETHER;
        for (Index i = 0; i < some; ++i) {
            sweeps[i].flow = i % 2 ? other : flow; // TOGETHER is even: the flow is where it was
            sweeps[i].out = i % 2 ? flow : other;
            sweeps[i].step = steps.next();
        }
        for (Index line = 0; line < height + some - 1; ++line)
            for (Index i = 0; i < some; ++i)
                if (line >= i && line - i < height) next_of(sweeps[i], line - i, g);
    }
}

void sweep(const Pair &flow, const Pair &other, const Slopes &g, Index count, const Relaxation &relaxation) {
    fill_ring(flow.u, 1.0f);
    fill_ring(flow.v, 1.0f);
    const bool large = flow.u.width <= WIDE && flow.u.width * flow.u.height >= LARGE;
    (large ? sweep_together : sweep_apart)(flow, other, g, count, Steps(relaxation));
}

void residual(const Pair &flow, const Pair &out, const Slopes &g, const Plane &share) {
    fill_ring(flow.u, 1.0f);
    fill_ring(flow.v, 1.0f);
    Beside besides[2];
    for (Index start = 0; start < flow.u.width; start += WIDE) {
        const Index width = tile_width(flow.u, start, WIDE);
        Pass pass = pass_from(start, width, flow, out, g, &share, besides);
        for (Index y = 0; y < flow.u.height; ++y) {
#pragma omp simd
            for (Index x = 0; x < width; ++x) {
                const Vector rest = residual_at(pass, average_at(pass, x), x);
                pass.u_out[x] = rest.u;
                pass.v_out[x] = rest.v;
            }
            next_row(pass, flow.u.stride);
        }
    }
}

double measured_sweep(const Pair &flow, const Pair &out, const Slopes &g, const Plane &share) {
    fill_ring(flow.u, 1.0f);
    fill_ring(flow.v, 1.0f);
    Beside besides[2];
    double total = 0.0;
    for (Index start = 0; start < flow.u.width; start += WIDE) {
        const Index width = tile_width(flow.u, start, WIDE), right = flow.u.width - start;
        Pass pass = pass_from(start, width, flow, out, g, &share, besides);
        for (Index y = 0; y < flow.u.height; ++y) {
#pragma omp simd
            for (Index x = 0; x < width; ++x) {
                const Measured now = measured_at(pass, average_at(pass, x), x);
                pass.u_out[x] = now.u;
                pass.v_out[x] = now.v;
                pass.beside->square[x] = now.square;
            }
            total += row_sum(pass.beside->square, width < right ? width : right);
            next_row(pass, flow.u.stride);
        }
    }
    return total;
}

} // namespace

extern const SweepKernels HS_JOIN(sweeps, HS_LEVEL) = {load,  load_pair, store_pair,     derive,
                                                       scale, sweep,     measured_sweep, residual};

} // namespace hs
