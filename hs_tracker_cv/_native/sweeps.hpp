// Horn & Schunck's system and its sweeps. Symbols are those of the paper (1981, doi:10.1016/0004-3702(81)90024-2):
// derivatives Fx, Fy and Ft, flow (u, v), its average (ū, v̄), weight λ and D = λ² + Fx² + Fy².
#pragma once

#include "planes.hpp"

namespace hs {

struct Pair {
    Plane u, v;
};

// Derivatives, or the coefficients g = F / √D that sweeps take.
struct Slopes {
    Plane x, y, t;
};

static inline Pair pair(const Planes &planes, Index i) { return {plane(planes, i), plane(planes, i + 1)}; }

static inline Slopes slopes(const Planes &planes, Index i) {
    return {plane(planes, i), plane(planes, i + 1), plane(planes, i + 2)};
}

// Sweeps accelerated by Chebyshev's polynomials; (1, 0) are the paper's own.
struct Relaxation {
    float relax;          // weight of a sweep's result against what was before
    float quarter_square; // a quarter of the square of the relaxed sweep's spectral radius
};

struct SweepKernels {
    // Copy an image (height, width) into a plane; what is not finite, or nearly so, becomes 0.
    void (*load)(const float *image, const Plane &out);
    // The same for a flow (height, width, 2), and back.
    void (*load_pair)(const float *flow, const Pair &out);
    void (*store_pair)(const Pair &flow, float *out);

    // Derivatives of two frames: the paper's cube, or else the five-tap mask.
    void (*derive)(const Plane &first, const Plane &second, bool five_tap, const Slopes &out);
    // Coefficients of the sweep for them, and D / λ² where `share` is given; the sum of (Ft ∇F)².
    double (*scale)(const Plane &first, const Plane &second, bool five_tap, float lambda, const Slopes &g,
                    const Plane *share);

    // So many sweeps; the result is in `flow` after an even number, else in `other`.
    void (*sweep)(const Pair &flow, const Pair &other, const Slopes &g, Index count, const Relaxation &relaxation);
    // One plain sweep from `flow` to `out`; the sum of the squared residual, over λ², that `flow` has.
    double (*measured_sweep)(const Pair &flow, const Pair &out, const Slopes &g, const Plane &share);
    // Residual of the system over λ².
    void (*residual)(const Pair &flow, const Pair &out, const Slopes &g, const Plane &share);
};

extern const SweepKernels sweeps_plain, sweeps_v2, sweeps_v3, sweeps_v4; // those of the processor's family

} // namespace hs
