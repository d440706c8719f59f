// Which pixels are the object: the mask, its log-odds, and what is visible of it.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace HS_LEVEL {

// Mask of the object from the evidence, and what is visible of it.
VisiblePart label(Size size, const Labelling &what, const Labels &out);

} // namespace HS_LEVEL
} // namespace hs
