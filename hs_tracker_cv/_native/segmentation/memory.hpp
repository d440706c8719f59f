// What is learned from a labelled frame.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace HS_LEVEL {

// What is remembered after a frame: log-odds, object layer, slow shape, background, colours.
Fit learn(Size size, const Lesson &what, const Memory &out);

} // namespace HS_LEVEL
} // namespace hs
