#include "flow.hpp"

#include <cmath>

namespace hs {
namespace {

// Copy an image into a plane and fill its ring; what is not finite, or nearly so, becomes 0.
void load(const Image &image, const Planes &planes, std::ptrdiff_t plane) {
    for (std::ptrdiff_t y = 0; y < image.height; ++y) {
        const float *HS_RESTRICT in = image.data + y * image.width;
        float *HS_RESTRICT out = row(planes, plane, y);
#pragma omp simd
        for (std::ptrdiff_t x = 0; x < image.width; ++x) out[x] = std::fabs(in[x]) < 1e30f ? in[x] : 0.0f;
    }
    fill_ring(planes, plane, 1.0f);
}

} // namespace

extern const FlowKernels HS_JOIN(flow, HS_LEVEL) = {load};

} // namespace hs
