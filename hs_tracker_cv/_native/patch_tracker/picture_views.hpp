// Pictures and places that Python hands over, checked.
#pragma once

#include "../views.hpp"
#include "pictures.hpp"

namespace hs {

// ValueError unless it has so many pixels each way, and 1 or 3 channels.
Picture as_picture(const Array<const float, 3> &pixels, Py_ssize_t fewest);

// ValueError unless it is finite, with steps between 0 and 1e4.
Place as_place(double x, double y, double step_x, double step_y, double angle);

} // namespace hs
