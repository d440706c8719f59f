// One level of coarse-to-fine warping, and what leads from level to level.
#pragma once

#include "sweeps.hpp"

namespace hs {

// Weights of a symmetric blur: of the centre, the neighbours and the next ones.
struct Taps {
    float centre, near, far;
};

// How the brightness of the second frame differs from that of the first: by gain · mean of both + offset.
struct Exposure {
    float gain, offset;
};

// Weighted sums over pixels, for a line fitted to the difference d of two frames against their mean m.
struct LineSums {
    double w, m, mm, d, md;
};

struct WarpKernels {
    // to += factor · from
    void (*add)(const Plane &from, const Plane &to, float factor);
    // Blur. Here and below `rows` is room for `resize_room` elements.
    void (*blur)(const Plane &in, const Plane &out, const Taps &taps, float *rows);
    // Resize (centre-aligned, bilinear) and multiply by `gain`; blur before, where the new size is smaller.
    void (*resize)(const Plane &in, const Plane &out, float gain, const Taps &taps, float *rows);
    // Sample a frame at (x + u, y + v), bicubic; the mask is 1 where that is inside the frame, else 0.
    void (*warp)(const Plane &frame, const Pair &flow, const Plane &warped, const Plane &mask);
    // Sums for a change of exposure. Weights are mask / (1 + outlier · r²), r being what the one known so far leaves.
    LineSums (*compare)(const Plane &first, const Plane &warped, const Plane &mask, float outlier,
                        const Exposure &exposure);
    // Coefficients of the sweep for the data term linearised about the flow: g = √m F / √(λ² + m (Fx² + Fy²)) with
    // Ft - Fx u - Fy v in place of Ft, which is what the exposure does not explain of the difference. Its weight m is
    // mask / (1 + outlier · Ft²): pixels that the flow so far does not explain count less (Lorentzian weights).
    void (*linearise)(const Plane &first, const Plane &warped, const Plane &mask, const Pair &flow, bool five_tap,
                      float lambda, float outlier, const Exposure &exposure, const Slopes &g);
    // Median over 3 × 3 or 5 × 5 pixels.
    void (*median)(const Plane &in, const Plane &out, int side);
};

extern const WarpKernels warping_plain, warping_v2, warping_v3, warping_v4; // those of the processor's family

// Elements that `resize` needs for its rows.
static inline Index resize_room(Index width_in, Index width_out) { return 2 * (width_in + width_out + 4 * BLOCK); }

} // namespace hs
