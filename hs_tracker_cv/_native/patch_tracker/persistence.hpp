// How much of what was in a box is still in it, and the running means of what is seen there.
#pragma once

#include "../planes.hpp"

namespace hs {

// What is known of the frame before. Patches are (height, width), what is kept of them (height / 2, width / 2).
struct Before {
    const float *persistence, *body; // what was kept, and the object's pixels
    const float *previous;           // patch
    // (4, height, width): mean patch; mean absolute deviation from it; share of "moves with the object"; prior weight
    // of each pixel in the fit of the flow, which follows from the last two.
    const float *means;
    const float *weights; // prior weights by place
    Index height, width;
};

// What the flow says: planes of a MotionFit, the flow itself, and the patch where the result is wanted. Its centre is
// `right` and `down` of where the flow ends, in pixels of what is kept; cosine and sine hold its turn and zoom.
struct Passage {
    const float *planes, *flow, *patch;
    double right, down, cosine, sine;
};

struct Persistence {
    double same, changed;        // gray levels of change up to which a pixel is the same, and from which it is another
    double rate;                 // share of what looks as it was learned that counts as the object's again
    double mean_rate, mask_rate; // share of this frame in mean patch and deviation, and in "moves with the object"
    double floor;                // weight of a pixel that never moved with the object
};

// Floats of room that `keep` needs.
static constexpr Index keep_room(Index height, Index width) { return 5 * (height / 2) * (width / 2); }

struct PersistenceKernels {
    // Writes what is kept (height / 2, width / 2) and the new means.
    void (*update)(const Before &before, const Passage &passage, const Persistence &how, float *room,
                   float *persistence, float *means);
};

extern const PersistenceKernels persistence_plain, persistence_v2, persistence_v3, persistence_v4;

} // namespace hs
