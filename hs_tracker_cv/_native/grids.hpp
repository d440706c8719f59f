// The coarse grids of multigrid.
#pragma once

#include "sweeps.hpp"

namespace hs {

// A coarse system, u - ū + J u = b at each pixel, with the symmetric matrix J.
struct CoarseSystem {
    Plane xx, xy, yy; // J
    Pair right;       // b
};

static inline CoarseSystem coarse_system(const Planes &planes, Index i) {
    return {plane(planes, i), plane(planes, i + 1), plane(planes, i + 2), pair(planes, i + 3)};
}

struct GridKernels {
    // The coarse system of the finest one: sums of (Fx², Fx Fy, Fy², -Ft Fx, -Ft Fy) / λ² over 2 × 2 pixels. What is
    // missing at odd sizes counts as zero, or the system would lose its symmetry.
    void (*project)(const Slopes &g, const Plane &share, const CoarseSystem &out);
    // Sums over 2 × 2 pixels, what is missing counting as zero.
    void (*restrict_plane)(const Plane &fine, const Plane &out);
    // fine = keep · fine + the bilinear interpolation of the coarse plane, weights (9, 3, 3, 1) / 16.
    void (*prolong)(const Plane &coarse, const Plane &fine, float keep);
    // One Jacobi sweep of a coarse system; from zero where `flow` is none.
    void (*sweep)(const Pair *flow, const Pair &out, const CoarseSystem &system);
    void (*residual)(const Pair &flow, const Pair &out, const CoarseSystem &system);
};

extern const GridKernels grids_plain, grids_v2, grids_v3, grids_v4; // those of the processor's family

} // namespace hs
