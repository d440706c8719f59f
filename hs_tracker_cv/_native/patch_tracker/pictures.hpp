// Pictures as Python has them, and where patches of them are sampled.
//
// This header is compiled for every level: plain data only.
#pragma once

#include <cstddef>

namespace hs {

// Rows of pixels of `channels` numbers, 0–255.
struct Picture {
    const float *data;
    std::ptrdiff_t height, width, channels;
};

// Where a patch is sampled: its centre in pixel-index coordinates, steps between samples (px), its turn.
struct Place {
    double x, y, step_x, step_y, cosine, sine;
};

static inline bool is_straight(const Place &place) { return place.sine == 0.0 && place.cosine > 0.0; }

} // namespace hs
