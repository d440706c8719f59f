// How the light has changed, by the pixels round the box. Of no level: medians are not vector code.
#pragma once

#include "kernels.hpp"

#include <array>

namespace hs {

// Gray levels: darker ones before, darker and brighter ones now tell nothing.
struct LightLimits {
    float unlit, unlit_now, saturated;
};

// How many pixels were used, and the median by which each channel has become brighter; 1 of none.
struct Light {
    Index pixels;
    std::array<float, CHANNELS> ratio;
};

// By one in `stride` pixels across and down of a window outside `box`.
Light measure_light(Size size, const float *image, const float *previous, const Rectangle &box, Index stride,
                    const LightLimits &limits);

} // namespace hs
