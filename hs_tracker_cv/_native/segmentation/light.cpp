#include "light.hpp"

#include "../median.hpp"

#include <algorithm>
#include <vector>

namespace hs {
namespace {

bool tells(const float *now, const float *before, const LightLimits &limits) {
    const auto [darkest, brightest] = std::minmax({now[0], now[1], now[2]});
    return std::min({before[0], before[1], before[2]}) > limits.unlit && brightest < limits.saturated &&
           darkest > limits.unlit_now;
}

} // namespace

Light measure_light(Size size, const float *image, const float *previous, const Rectangle &box, Index stride,
                    const LightLimits &limits) {
    std::array<std::vector<float>, CHANNELS> ratios;
    for (auto &each : ratios) each.reserve((size.height / stride + 1) * (size.width / stride + 1));
    for (Index y = 0; y < size.height; y += stride)
        for (Index x = 0; x < size.width; x += stride) {
            if (y >= box.top && y < box.bottom && x >= box.left && x < box.right) continue;
            const Index at = CHANNELS * (y * size.width + x);
            if (!tells(image + at, previous + at, limits)) continue;
            for (Index c = 0; c < CHANNELS; ++c) ratios[c].push_back(image[at + c] / previous[at + c]);
        }
    Light light{static_cast<Index>(ratios[0].size()), {1.0f, 1.0f, 1.0f}};
    if (light.pixels)
        for (Index c = 0; c < CHANNELS; ++c) light.ratio[c] = median(ratios[c]);
    return light;
}

} // namespace hs
