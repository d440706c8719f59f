// What Python sees of the finder.
#pragma once

#include <nanobind/nanobind.h>

namespace hs {

void bind_finder(nanobind::module_ &module);

} // namespace hs
