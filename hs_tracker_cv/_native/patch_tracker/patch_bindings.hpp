// What Python sees of the patch tracker.
#pragma once

#include <nanobind/nanobind.h>

namespace hs {

void bind_patch_tracker(nanobind::module_ &module);

} // namespace hs
