// Horn & Schunck's flow. Symbols are those of the paper (1981, doi:10.1016/0004-3702(81)90024-2): derivatives Fx, Fy,
// Ft, flow (u, v).
#pragma once

#include "planes.hpp"

namespace hs {

struct FlowKernels {
    void (*load)(const Image &image, const Planes &planes, std::ptrdiff_t plane);
};

extern const FlowKernels flow_plain, flow_v2, flow_v3, flow_v4; // those that the processor's family has

} // namespace hs
