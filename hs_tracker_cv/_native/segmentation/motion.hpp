// How things move: what motion to expect, what the flow and registration make of it, where to search.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace HS_LEVEL {

// Flow to start from, (h, w, 2): the affine motion where `near` is set, the camera's elsewhere.
void start_flow(Size size, const Byte *near, const Grid &grid, const double *theta, const double *camera, float *flow);

// Outline of the object before this frame, and what motion to expect: what has to be known before the flow is.
void predict(Size size, const Prediction &what, Predicted *out);

// Motion of the background to this frame, and that of the object since the last, by the flow and by registration with
// both layers; the second is written if there are points.
void measure(Size size, const Measurement &what, double *ground, double *theta);

// Best translation of the object layer: Σ over its shape of [not background] (1 - min(|I - O| / (12 + 3 noise), 2)),
// per pixel of the shape. Shifts are `centre` ± `reach` in steps of `step` px; about four hundred pixels of
// {shape > ½} are looked at.
Found search_shift(Size size, const float *image, const float *object, const float *shape, const Byte *different,
                   const Index *centre, Index reach, Index step, const Rectangle &inside, double noise);

} // namespace HS_LEVEL
} // namespace hs
