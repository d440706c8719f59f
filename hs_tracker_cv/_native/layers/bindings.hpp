// What Python sees of segmentation: the submodule `layers`.
#pragma once

#include <nanobind/nanobind.h>

namespace hs {

void bind_layers(nanobind::module_ &module);

} // namespace hs
