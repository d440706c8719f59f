// Masks: grown, opened, taken apart, measured. What lies beyond the border is neither in a mask nor outside it.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace HS_LEVEL {

// 1 where the odds are positive.
void threshold(Index pixels, const float *odds, Byte *mask);

// Pixels of a mask.
Index count(Index pixels, const Byte *mask);

// Pixels of a mask that are not in the other; how many they are.
Index without(Size size, const Byte *mask, const Byte *other, Byte *out);

// Pixels outside a mask; how many they are.
Index invert(Size size, const Byte *mask, Byte *out);

// 1 where at least five of 3 × 3 pixels are in the mask, the border repeated. `held` is a workspace, as below.
void median(Size size, const Byte *mask, Byte *held, Byte *out);

// Let the mask `out` grow over `allowed`, in each step to all eight neighbours.
void spread(Size size, const Byte *allowed, Index times, Byte *held, Byte *out);

// 1 where a pixel of the mask lies within `reach` px, in rows and in columns.
void widen(Size size, const Byte *mask, Index reach, Byte *held, Byte *out);

// 1 where a pixel of the mask is here, or one of the four neighbours.
void widen_cross(Size size, const Byte *mask, Byte *out);

// Runs of a mask in rows, and which of them hang together, also by corners: a component's head is the first of its
// runs. There are at most `most_runs`. Returns the number of runs; `heads` receives that of components.
Index components(Size size, const Byte *mask, const Byte *other, Run *runs, Index *heads);

// Inside the frame the pixels of {shape > ½}, those of them in the mask, and those of the mask.
void overlap(Size size, const Byte *mask, const float *shape, const Rectangle &inside, VisiblePart *visible);

// First and last column and row of a mask, false if it is empty. `columns` receives the largest of the odds between the
// first and last row, `rows` that between the first and last column.
bool extremes(Size size, const Byte *mask, const float *odds, float *columns, float *rows, Rectangle *bounds);

} // namespace HS_LEVEL

static inline Index most_runs(Size size) { return size.height * ((size.width + 1) / 2); }

} // namespace hs
