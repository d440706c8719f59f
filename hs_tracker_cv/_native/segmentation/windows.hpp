// Windows: smoothed, moved by an affine motion, copied into the next frame's.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace HS_LEVEL {

// Smooth pixels (h + 4, (w + 4) channels) by five taps both ways; `taps` are the middle one, its neighbour and the
// outermost. A gray frame is written three times: what follows knows but one kind of window.
void smooth(Size size, Index channels, const float *pixels, const float *taps, float *image, float *gray);

// Copy into a window whose element (i, j) is (i + dx, j + dy) here; `fill` where there is none.
void shift(Size from, const float *source, Index dx, Index dy, float fill, Size to, float *out);

// Copy the background into another window, see `shift`, and make it brighter by `gain`. Pixels that are new get the
// colour of `image`. They are taken as known, or as not yet seen where the object may be by its odds.
void move_ground(Size from, const Ground &ground, Index dx, Index dy, float gain, Size to, const float *image,
                 const float *odds, float *picture, float *counts);

// The image at (m0 x + m1 y + m2, m3 x + m4 y + m5), bilinear. Beyond it its border is repeated, or else `fill`.
// OpenCV's own differs from version to version.
void resample(Size from, Index channels, const float *image, const double *inverse, bool repeat, float fill, Size to,
              float *out);

// Move what belongs to the object, in `part` of the window, as `resample` does. Images repeat their border, the planes
// are -3 and 0 beyond theirs; outside `part` images are 0 and planes the same as beyond. The last frame is moved only
// where the background is not yet known, unless `everywhere`.
void carry(Size size, const Object &object, const float *counts, const double *inverse, const Rectangle &part,
           bool everywhere, const MovedObject &out);

// An image, but `fill` where the log-odds at (i + dx, j + dy) are above `sure`.
void without_object(Size size, const float *image, const float *odds, Index dx, Index dy, float sure, float fill,
                    float *out);

} // namespace HS_LEVEL
} // namespace hs
