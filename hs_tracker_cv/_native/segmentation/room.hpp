// Memory for the time of a call. What is in it at first does not count.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace {

// Of this file alone, unlike std::unique_ptr: see planes.hpp.
template <class T> class Room {
  public:
    explicit Room(Index count) : data_(new T[static_cast<std::size_t>(count)]) {}
    ~Room() { delete[] data_; }
    Room(const Room &) = delete;
    Room &operator=(const Room &) = delete;
    T *get() const { return data_; }

  private:
    T *data_;
};

} // namespace
} // namespace hs
