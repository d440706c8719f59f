#include "owned_planes.hpp"

#include <cstdint>
#include <limits>
#include <stdexcept>
#include <string>

namespace hs {
namespace {

constexpr std::ptrdiff_t LINE = 64 / sizeof(float); // elements of a line of the cache

// Odd multiples of a line: rows or planes a power of two apart would share a few lines of the cache.
std::ptrdiff_t odd_lines(std::ptrdiff_t elements) { return ((elements + LINE - 1) / LINE | 1) * LINE; }

} // namespace

OwnedPlanes::OwnedPlanes(std::ptrdiff_t count, std::ptrdiff_t height, std::ptrdiff_t width) : count_(count) {
    constexpr double most = static_cast<double>(std::numeric_limits<std::ptrdiff_t>::max() / 8);
    const double elements = static_cast<double>(count) * (static_cast<double>(height) + 5.0) * (static_cast<double>(width) + 64.0);
    if (count < 1 || height < 1 || width < 1 || elements > most)
        throw std::invalid_argument("expected count, height and width of planes >= 1 that memory can hold, got " +
                                    std::to_string(count) + ", " + std::to_string(height) + " and " +
                                    std::to_string(width));
    const std::ptrdiff_t stride = odd_lines(blocks_width(width) + BLOCK);
    const std::ptrdiff_t step = odd_lines((height + 2 * RING) * stride);
    memory_.reset(new float[count * step + LINE]());
    const auto address = reinterpret_cast<std::uintptr_t>(memory_.get());
    float *aligned = memory_.get() + (64 - address % 64) % 64 / sizeof(float);
    view_ = {aligned + RING * stride + BLOCK, height, width, stride, step};
}

} // namespace hs
