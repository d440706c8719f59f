// Memory for planes, as an object of Python.
#pragma once

#include "planes.hpp"

#include <memory>

namespace hs {

// So many planes of one size, all zero at first; see planes.hpp for how they lie in memory.
class OwnedPlanes {
  public:
    // std::invalid_argument unless all are at least 1 and the whole can be counted in elements.
    OwnedPlanes(std::ptrdiff_t count, std::ptrdiff_t height, std::ptrdiff_t width);

    const Planes &view() const { return view_; }
    std::ptrdiff_t count() const { return count_; }

  private:
    std::unique_ptr<float[]> memory_;
    Planes view_;
    std::ptrdiff_t count_;
};

} // namespace hs
