// Derivatives of two frames at one pixel, for loops in the files of several rooms.
#pragma once

#include "planes.hpp"

namespace hs {
namespace {

struct Slope {
    float x, y, t;
};

// The rows of a frame that a derivative takes, two above and two below.
struct Rows {
    const float *HS_RESTRICT up2, *HS_RESTRICT up, *HS_RESTRICT here, *HS_RESTRICT down, *HS_RESTRICT down2;
};

inline Rows rows_round(const Plane &plane, Index y) {
    return {row(plane, y - 2), row(plane, y - 1), row(plane, y), row(plane, y + 1), row(plane, y + 2)};
}

// Mean of four first differences over the 2 × 2 × 2 cube (step 3 of the paper).
inline Slope cube(const Rows &a, const Rows &b, Index x) {
    const float a00 = a.here[x], a01 = a.here[x + 1], a10 = a.down[x], a11 = a.down[x + 1];
    const float b00 = b.here[x], b01 = b.here[x + 1], b10 = b.down[x], b11 = b.down[x + 1];
    return {0.25f * (((a01 - a00) + (a11 - a10)) + ((b01 - b00) + (b11 - b10))),
            0.25f * (((a10 - a00) + (a11 - a01)) + ((b10 - b00) + (b11 - b01))),
            0.25f * (((b00 - a00) + (b01 - a01)) + ((b10 - a10) + (b11 - a11)))};
}

// Barron, Fleet & Beauchemin's mask [1 -8 0 8 -1] / 12 (1994) on the mean of both frames; Ft is plain b - a.
inline Slope five_tap(const Rows &a, const Rows &b, Index x) {
    constexpr float NEAR = 8.0f / 24.0f, FAR = 1.0f / 24.0f;
    const float near_x = (a.here[x + 1] - a.here[x - 1]) + (b.here[x + 1] - b.here[x - 1]);
    const float far_x = (a.here[x + 2] - a.here[x - 2]) + (b.here[x + 2] - b.here[x - 2]);
    const float near_y = (a.down[x] - a.up[x]) + (b.down[x] - b.up[x]);
    const float far_y = (a.down2[x] - a.up2[x]) + (b.down2[x] - b.up2[x]);
    return {NEAR * near_x - FAR * far_x, NEAR * near_y - FAR * far_y, b.here[x] - a.here[x]};
}

template <bool FiveTap> inline Slope slope_at(const Rows &a, const Rows &b, Index x) {
    return FiveTap ? five_tap(a, b, x) : cube(a, b, x);
}

} // namespace
} // namespace hs
