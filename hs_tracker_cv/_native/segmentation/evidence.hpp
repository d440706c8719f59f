// How well each layer explains a pixel.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace HS_LEVEL {

// Log-likelihood ratio, object against background, per pixel, with the errors and gains behind it. Outside `part` the
// object layer is not known: nothing there can be the object but what is new. Returns the share of the object's pixels
// that look about as they did.
double evidence(Size size, const Explanations &seen, const Rectangle &part, const Rectangle &inside,
                const Likelihood &how, const Evidence &out);

} // namespace HS_LEVEL
} // namespace hs
