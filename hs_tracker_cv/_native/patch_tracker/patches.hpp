// What the patch tracker reads of a picture: the patch that the flow is computed on, and the object's colours.
#pragma once

#include "../planes.hpp"
#include "pictures.hpp"

#include <cstdint>

namespace hs {

constexpr Index GRAYS = 64, COLOURS = 16 * 16 * 16; // bins of the histograms of a gray and of a colour video

// A patch of rows × columns samples round a place of a picture.
struct Window {
    Picture picture;
    Place place;
    Index rows, columns;
};

// Memory that kernels work in; what is in it at first does not count.
struct PatchRoom {
    float *floats;
    std::int32_t *integers;
};

// Shares of the bins inside and outside of an object, (2, bins).
struct Histograms {
    const float *shares;
    Index bins;
};

struct PatchKernels {
    // Floats of room that the kernels below need of a window, and integers.
    Index (*floats)(const Window &window);
    Index (*integers)(const Window &window);
    // Samples (channels, rows, columns): each is the mean of a few bilinear reads spread over a step.
    void (*sample)(const Window &window, const PatchRoom &room, float *samples);
    // A gray patch, smoothed a little, of mean 0 and deviation 32 under weights (rows, columns), and its correlation
    // under them with templates (count, rows, columns) of mean 0.
    void (*patch)(const Window &window, const float *weights, const float *templates, Index count,
                  const PatchRoom &room, float *patch, double *scores);
    // Likelihood of the object's colours round each sample: mean over 3 × 3 of inside / (inside + outside).
    void (*likelihood)(const Window &window, const float *histograms, const PatchRoom &room, float *likelihood);
    // Histograms with the window's colours mixed in at a rate; `inside` is 1 where they are the object's. `counts` is
    // room for as many numbers.
    void (*learn)(const Window &window, const std::uint8_t *inside, const Histograms &old, float rate,
                  const PatchRoom &room, float *counts, float *learned);
};

extern const PatchKernels patches_plain, patches_v2, patches_v3, patches_v4; // those of the processor's family

} // namespace hs
