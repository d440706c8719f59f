// Pictures and places that Python hands over, checked.
#pragma once

#include "../views.hpp"
#include "pictures.hpp"

#include <array>

namespace hs {

// ValueError unless it has so many pixels each way, and 1 or 3 channels.
Picture as_picture(const Array<const float, 3> &pixels, Py_ssize_t fewest);

// x, y, step_x, step_y, angle, as hs_tracker_cv/patch_tracker/patches.py has places.
using PlaceNumbers = std::array<double, 5>;

// ValueError unless it is finite, with steps between 0 and 1e4.
Place as_place(const PlaceNumbers &at);

} // namespace hs
