// The whole frame at a glance (hs_tracker_cv/overview.py), and statistics of few numbers. Of no level: all are cheap.
#pragma once

#include <nanobind/nanobind.h>

namespace hs {

void bind_overview(nanobind::module_ &module);

} // namespace hs
