// What Python sees of segmentation: the submodule `segmentation`.
#pragma once

#include <nanobind/nanobind.h>

namespace hs {

void bind_segmentation(nanobind::module_ &module);

} // namespace hs
