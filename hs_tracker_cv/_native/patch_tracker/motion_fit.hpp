// The motion of an object, fitted to the flow inside its patch.
#pragma once

#include "../planes.hpp"

#include <cstdint>

namespace hs {

// From the patch's centre: translation (samples), growth, rotation (radians from x towards y).
struct Motion {
    double right, down, growth, turn;
};

// Patches (height, width) and the flow (height, width, 2) from the first to the second.
struct PatchFlow {
    const float *first, *second, *flow;
    Index height, width;
};

// Likelihood of the object's colours on a lattice of its own, whose centre is the patch's: `ratio` of its samples per
// sample of the patch.
struct ColourPrior {
    const float *likelihood; // null where colours do not tell
    Index rows, columns;
    double ratio;
};

// What is known before: weights (height, width), not negative, of the object and of its surroundings.
struct FitPriors {
    const float *object, *surroundings;
    ColourPrior colours;
    bool rotation;     // or it stays 0
    double separation; // samples from which two motions are told apart; if negative, they never are
};

// Written: planes (3, height, width) of the weights of the object's first fit; of the share of "moves with the
// object", 1 where the two are not told apart; of the object's prior weights, colours included.
struct MotionFit {
    Motion motion;
    bool apart;
};

// Memory that the fit works in; what is in it at first does not count.
struct FitRoom {
    float *floats;
    std::int32_t *integers;
};

struct MotionFitKernels {
    // Floats of room that a fit needs, and integers.
    Index (*floats)(Index height, Index width);
    Index (*integers)(Index height, Index width);
    MotionFit (*fit)(const PatchFlow &patches, const FitPriors &priors, const FitRoom &room, float *planes);
};

extern const MotionFitKernels motion_fit_plain, motion_fit_v2, motion_fit_v3, motion_fit_v4;

} // namespace hs
