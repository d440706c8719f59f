// The highest point of a response, between its samples.
#pragma once

#include "finder.hpp"

namespace hs {

// A penalty on the distance from a point: `weight` times its square. The response's centre is `right` and `down` units
// from the point, and has `across` and `along` units per cell.
struct Fade {
    double weight, right, down, across, along;
};

// Displacement (cells) and height of the peak; height less the fade; the highest point away from it, the mean and the
// standard deviation of what is away from it; the witness's response at the same place.
struct Peak {
    double dx, dy, height, value, second, mean, deviation, witness;
};

Circle circle();

// `responses` and `spectra` as of `respond`; writes the first response with no displacement at its middle.
Peak find_peak(const float *responses, const float *spectra, const Fade &fade, float *centred);

} // namespace hs
