#include "owned_planes.hpp"

#include <cstdint>
#include <cstring>
#include <limits>
#include <new>
#include <stdexcept>
#include <string>
#ifdef __linux__
#include <sys/mman.h>
#endif

namespace hs {
namespace {

constexpr Index LINE = 64 / sizeof(float); // elements of a line of the cache

// Odd multiples of a line: rows or planes a power of two apart would share a few lines of the cache.
Index odd_lines(Index elements) { return ((elements + LINE - 1) / LINE | 1) * LINE; }

constexpr std::size_t HUGE_PAGE = std::size_t(1) << 21; // bytes

// Zeros, beginning at a line of the cache. Planes that many pages hold are walked through side by side, so large ones
// get huge pages where the system gives them when asked, as NumPy's arrays do: a quarter of the time of a sweep.
std::shared_ptr<float[]> zeros(Index elements) {
    const std::size_t bytes = static_cast<std::size_t>(elements) * sizeof(float);
    const std::size_t alignment = bytes >= 2 * HUGE_PAGE ? HUGE_PAGE : 64;
    void *const memory = ::operator new(bytes, std::align_val_t(alignment));
#ifdef __linux__
    if (alignment == HUGE_PAGE) madvise(memory, bytes, MADV_HUGEPAGE);
#endif
    std::memset(memory, 0, bytes);
    return {static_cast<float *>(memory), [alignment](float *p) { ::operator delete(p, std::align_val_t(alignment)); }};
}

} // namespace

void OwnedPlanes::resize(Index count, Index height, Index width) {
    constexpr double most = static_cast<double>(std::numeric_limits<Index>::max() / 8);
    const double rows = static_cast<double>(height) + 5.0, columns = static_cast<double>(width) + 64.0;
    if (count < 1 || height < 1 || width < 1 || static_cast<double>(count) * rows * columns > most)
        throw std::invalid_argument("expected count, height and width of planes >= 1 that memory can hold, got " +
                                    std::to_string(count) + ", " + std::to_string(height) + " and " +
                                    std::to_string(width));
    const Index stride = odd_lines(whole_blocks(width) + BLOCK);
    const Index step = odd_lines((height + 2 * RING) * stride);
    const Index elements = count * step + 2 * LINE; // blocks that stick out of the last row
    if (elements > capacity_) {
        memory_ = zeros(elements);
        capacity_ = elements;
    }
    planes_ = {{memory_.get() + RING * stride + BLOCK, height, width, stride}, count, step};
}

} // namespace hs
