#include "grids.hpp"

namespace hs {
namespace {

struct Sums {
    float xx, xy, yy, right_x, right_y;
};

// What a pixel of the fine grid adds to the coarse system.
inline Sums products(const float *HS_RESTRICT gx, const float *HS_RESTRICT gy, const float *HS_RESTRICT gt,
                     const float *HS_RESTRICT share, Index x) {
    const float weight = share[x], fx = gx[x], fy = gy[x], ft = gt[x];
    return {weight * (fx * fx), weight * (fx * fy), weight * (fy * fy), -(weight * (fx * ft)), -(weight * (fy * ft))};
}

inline Sums plus(const Sums &a, const Sums &b) {
    return {a.xx + b.xx, a.xy + b.xy, a.yy + b.yy, a.right_x + b.right_x, a.right_y + b.right_y};
}

void project(const Slopes &g, const Plane &share, const CoarseSystem &out) {
    fill_ring(g.x, 0.0f);
    fill_ring(g.y, 0.0f);
    fill_ring(g.t, 0.0f);
    fill_ring(share, 0.0f);
    const Index width = whole_blocks(out.xx.width);
    for (Index y = 0; y < out.xx.height; ++y) {
        const float *HS_RESTRICT gx0 = row(g.x, 2 * y), *HS_RESTRICT gx1 = row(g.x, 2 * y + 1);
        const float *HS_RESTRICT gy0 = row(g.y, 2 * y), *HS_RESTRICT gy1 = row(g.y, 2 * y + 1);
        const float *HS_RESTRICT gt0 = row(g.t, 2 * y), *HS_RESTRICT gt1 = row(g.t, 2 * y + 1);
        const float *HS_RESTRICT share0 = row(share, 2 * y), *HS_RESTRICT share1 = row(share, 2 * y + 1);
        float *HS_RESTRICT xx = row(out.xx, y);
        float *HS_RESTRICT xy = row(out.xy, y);
        float *HS_RESTRICT yy = row(out.yy, y);
        float *HS_RESTRICT right_u = row(out.right.u, y);
        float *HS_RESTRICT right_v = row(out.right.v, y);
#pragma omp simd
        for (Index x = 0; x < width; ++x) {
            const Sums upper = plus(products(gx0, gy0, gt0, share0, 2 * x), products(gx0, gy0, gt0, share0, 2 * x + 1));
            const Sums lower = plus(products(gx1, gy1, gt1, share1, 2 * x), products(gx1, gy1, gt1, share1, 2 * x + 1));
            const Sums sums = plus(upper, lower);
            xx[x] = sums.xx;
            xy[x] = sums.xy;
            yy[x] = sums.yy;
            right_u[x] = sums.right_x;
            right_v[x] = sums.right_y;
        }
    }
}

void restrict_plane(const Plane &fine, const Plane &out) {
    fill_ring(fine, 0.0f);
    const Index width = whole_blocks(out.width);
    for (Index y = 0; y < out.height; ++y) {
        const float *HS_RESTRICT upper = row(fine, 2 * y);
        const float *HS_RESTRICT lower = row(fine, 2 * y + 1);
        float *HS_RESTRICT to = row(out, y);
#pragma omp simd
        for (Index x = 0; x < width; ++x) to[x] = (upper[2 * x] + upper[2 * x + 1]) + (lower[2 * x] + lower[2 * x + 1]);
    }
}

void prolong(const Plane &coarse, const Plane &fine, float keep) {
    fill_ring(coarse, 1.0f);
    float mixed[TILE + BLOCK], pairs[2 * TILE];
    for (Index start = 0; start < coarse.width; start += TILE) {
        const Index width = tile_width(coarse, start);
        for (Index y = 0; y < fine.height; ++y) {
            const float *HS_RESTRICT near = row(coarse, y / 2) + start - 1;
            const float *HS_RESTRICT far = row(coarse, y / 2 + (y % 2 ? 1 : -1)) + start - 1;
#pragma omp simd
            for (Index x = 0; x < width + BLOCK; ++x) mixed[x] = 0.75f * near[x] + 0.25f * far[x];
#pragma omp simd
            for (Index x = 0; x < width; ++x) {
                pairs[2 * x] = 0.75f * mixed[x + 1] + 0.25f * mixed[x];
                pairs[2 * x + 1] = 0.75f * mixed[x + 1] + 0.25f * mixed[x + 2];
            }
            float *HS_RESTRICT to = row(fine, y) + 2 * start;
            const Index rest = whole_blocks(fine.width) - 2 * start, end = 2 * width < rest ? 2 * width : rest;
            if (keep == 0.0f) {
#pragma omp simd
                for (Index x = 0; x < end; ++x) to[x] = pairs[x];
            } else {
#pragma omp simd
                for (Index x = 0; x < end; ++x) to[x] = keep * to[x] + pairs[x];
            }
        }
    }
}

// Three rows of a plane.
struct Rows {
    const float *HS_RESTRICT up, *HS_RESTRICT here, *HS_RESTRICT down;
};

inline Rows rows_round(const Plane &plane, Index y) { return {row(plane, y - 1), row(plane, y), row(plane, y + 1)}; }

inline float average(const Rows &p, Index x) {
    return 1.0f / 6.0f * ((p.up[x] + p.down[x]) + (p.here[x - 1] + p.here[x + 1])) +
           1.0f / 12.0f * ((p.up[x - 1] + p.up[x + 1]) + (p.down[x - 1] + p.down[x + 1]));
}

struct SystemRow {
    const float *HS_RESTRICT xx, *HS_RESTRICT xy, *HS_RESTRICT yy, *HS_RESTRICT right_u, *HS_RESTRICT right_v;
};

inline SystemRow system_row(const CoarseSystem &system, Index y) {
    return {row(system.xx, y), row(system.xy, y), row(system.yy, y), row(system.right.u, y), row(system.right.v, y)};
}

// Rows are functions of their own that are called: inlined, compilers keep more pointers than there are registers.
template <bool FromZero>
HS_NOINLINE void sweep_row(const Rows u, const Rows v, const SystemRow system, Index width, float *HS_RESTRICT u_out,
                           float *HS_RESTRICT v_out) {
#pragma omp simd
    for (Index x = 0; x < width; ++x) {
        const float axx = 1.0f + system.xx[x], axy = system.xy[x], ayy = 1.0f + system.yy[x];
        const float ru = system.right_u[x] + (FromZero ? 0.0f : average(u, x));
        const float rv = system.right_v[x] + (FromZero ? 0.0f : average(v, x));
        const float scale = 1.0f / (axx * ayy - axy * axy);
        u_out[x] = scale * (ayy * ru - axy * rv);
        v_out[x] = scale * (axx * rv - axy * ru);
    }
}

void sweep(const Pair *flow, const Pair &out, const CoarseSystem &system) {
    if (flow) {
        fill_ring(flow->u, 1.0f);
        fill_ring(flow->v, 1.0f);
    }
    const Index width = whole_blocks(out.u.width);
    for (Index y = 0; y < out.u.height; ++y) {
        const SystemRow here = system_row(system, y);
        if (flow)
            sweep_row<false>(rows_round(flow->u, y), rows_round(flow->v, y), here, width, row(out.u, y), row(out.v, y));
        else
            sweep_row<true>({}, {}, here, width, row(out.u, y), row(out.v, y));
    }
}

HS_NOINLINE void residual_row(const Rows u, const Rows v, const SystemRow system, Index width, float *HS_RESTRICT u_out,
                              float *HS_RESTRICT v_out) {
#pragma omp simd
    for (Index x = 0; x < width; ++x) {
        const float axx = 1.0f + system.xx[x], axy = system.xy[x], ayy = 1.0f + system.yy[x];
        u_out[x] = (system.right_u[x] + average(u, x)) - (axx * u.here[x] + axy * v.here[x]);
        v_out[x] = (system.right_v[x] + average(v, x)) - (axy * u.here[x] + ayy * v.here[x]);
    }
}

void residual(const Pair &flow, const Pair &out, const CoarseSystem &system) {
    fill_ring(flow.u, 1.0f);
    fill_ring(flow.v, 1.0f);
    const Index width = whole_blocks(out.u.width);
    for (Index y = 0; y < out.u.height; ++y)
        residual_row(rows_round(flow.u, y), rows_round(flow.v, y), system_row(system, y), width, row(out.u, y),
                     row(out.v, y));
}

} // namespace

extern const GridKernels HS_JOIN(grids, HS_LEVEL) = {project, restrict_plane, prolong, sweep, residual};

} // namespace hs
