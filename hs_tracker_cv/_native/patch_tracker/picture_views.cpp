#include "picture_views.hpp"

#include <cmath>

namespace nb = nanobind;

namespace hs {

Picture as_picture(const Array<const float, 3> &pixels, Py_ssize_t fewest) {
    const Picture picture{pixels.data(), pixels.size(0), pixels.size(1), pixels.size(2)};
    if (picture.height < fewest || picture.width < fewest || (picture.channels != 1 && picture.channels != 3))
        throw nb::value_error(("expected picture to have at least " + std::to_string(fewest) + " x " +
                               std::to_string(fewest) + " pixels and 1 or 3 channels, got " +
                               std::to_string(picture.height) + " x " + std::to_string(picture.width) + " and " +
                               std::to_string(picture.channels))
                                  .c_str());
    return picture;
}

Place as_place(const PlaceNumbers &at) {
    const auto [x, y, step_x, step_y, angle] = at;
    if (!(step_x > 0.0 && step_x < 1e4 && step_y > 0.0 && step_y < 1e4 && std::fabs(x) < 1e9 && std::fabs(y) < 1e9 &&
          std::isfinite(angle)))
        throw nb::value_error(("expected a finite place with steps between 0 and 1e4, got x " + std::to_string(x) +
                               ", y " + std::to_string(y) + ", steps " + std::to_string(step_x) + " and " +
                               std::to_string(step_y) + ", angle " + std::to_string(angle))
                                  .c_str());
    return {x, y, step_x, step_y, std::cos(angle), std::sin(angle)};
}

} // namespace hs
