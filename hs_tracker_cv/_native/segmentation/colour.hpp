// Colours: 8 × 8 × 8 bins of blue, green and red, and histograms of object and background over them.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace HS_LEVEL {

// Bin of each pixel of a row.
void bin_row(Index width, const float *image, std::int16_t *bins);
void bin_colours(Size size, const float *image, std::int16_t *bins);

// Log-ratio of object to background per bin, clipped to ±2. Returns how much the histograms overlap: their
// Bhattacharyya coefficient, 1 where they are the same.
double likelihood(const float *colours, float *ratio);

// Histograms (object, background) moved towards a frame's counts, which are smoothed in place; one without pixels
// stays.
void blend(const float *colours, float *tally, double rate, float *out);

} // namespace HS_LEVEL
} // namespace hs
