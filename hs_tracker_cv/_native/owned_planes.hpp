// Memory for planes, as an object of Python.
#pragma once

#include "planes.hpp"

#include <memory>

namespace hs {

// So many planes of one size; see planes.hpp for how they lie in memory.
class OwnedPlanes {
  public:
    OwnedPlanes(Index count, Index height, Index width) { resize(count, height, width); }

    // Make it so many planes of another size. What they hold is undefined; memory that is large enough is kept.
    // std::invalid_argument unless all numbers are at least 1 and the elements can be counted.
    void resize(Index count, Index height, Index width);

    const Planes &planes() const { return planes_; }
    Index count() const { return planes_.count; }
    Index height() const { return planes_.first.height; }
    Index width() const { return planes_.first.width; }
    Plane operator[](Index i) const { return plane(planes_, i); }

    // What keeps the memory alive.
    const std::shared_ptr<float[]> &memory() const { return memory_; }

  private:
    std::shared_ptr<float[]> memory_;
    Index capacity_ = 0;
    Planes planes_{};
};

} // namespace hs
