// The correlation filter that finds the object: channels of a window round it, their transforms, the filter.
//
// A window is CELLS × CELLS cells of CELL × CELL samples. Channels lie innermost, and the first half of them is the
// real part of complex numbers whose imaginary part is the second half: so one complex transform serves two channels.
#pragma once

#include "../planes.hpp"
#include "pictures.hpp"

namespace hs {

constexpr std::ptrdiff_t CELLS = 40, CELL = 4;
constexpr std::ptrdiff_t PATCH = CELLS * CELL + 2; // samples along a side, with a ring of one round the cells
constexpr std::ptrdiff_t HALF = CELLS / 2 + 1;     // columns of a spectrum of real numbers
constexpr std::ptrdiff_t ANGLES = 9;               // directions of edges
constexpr std::ptrdiff_t SHADES = 32, NAMES = 9;   // shades of each primary colour, and what colours are called
constexpr std::ptrdiff_t GRAY_CHANNELS = 16, COLOUR_CHANNELS = 24;

// Factors of the transforms: exp(-2πi k / CELLS), real and imaginary part in turn.
struct Circle {
    float turn[2 * CELLS];
};

// How the filter is learned: see `adapt`.
struct Learning {
    float memory, coupling, growth;
    int rounds;
};

// Numbers of floats of room that kernels need.
static constexpr std::ptrdiff_t transform_room(std::ptrdiff_t channels) { return 2 * CELLS * CELLS * channels; }
static constexpr std::ptrdiff_t adapt_room(std::ptrdiff_t channels) {
    return CELLS * HALF + 2 * channels + 4 * CELLS * HALF * channels + 2 * CELLS * CELLS * channels;
}

struct FinderKernels {
    // Room that `describe` needs.
    std::ptrdiff_t (*describe_room)(const Picture &picture, const Place &place);
    // Channels (CELLS, CELLS, GRAY_CHANNELS or COLOUR_CHANNELS) of a window, faded, and the mean grays of its cells;
    // `names` is null for gray.
    void (*describe)(const Picture &picture, const Place &place, const float *fade, const float *names, float *room,
                     float *features, float *grays);
    // Mean grays only.
    void (*shade)(const Picture &picture, const Place &place, float *room, float *grays);
    // Spectrum (CELLS, HALF, 2, channels), real parts first.
    void (*transform)(const float *features, std::ptrdiff_t channels, const Circle &circle, float *room,
                      float *spectrum);
    // The filter after one more window; `old` is null for the first one.
    void (*adapt)(const float *spectrum, const float *target, const float *penalty, const float *old,
                  std::ptrdiff_t channels, const Learning &learning, const Circle &circle, float *room, float *filter);
    // Responses (CELLS, CELLS, 2) of two filters, no displacement at [0, 0], and their spectra (CELLS, HALF, 2, 2).
    void (*respond)(const float *filter, const float *witness, const float *spectrum, std::ptrdiff_t channels,
                    const Circle &circle, float *room, float *spectra, float *responses);
};

extern const FinderKernels finder_plain, finder_v2, finder_v3, finder_v4; // those that the processor's family has

} // namespace hs
