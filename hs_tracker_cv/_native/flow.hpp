// What the flow does between two looks of Python: kernels in their order.
#pragma once

#include "owned_planes.hpp"
#include "sweeps.hpp"
#include "warping.hpp"

namespace hs {

// Two images (height, width) and a flow (height, width, 2).
struct Frames {
    const float *first, *second;
};

constexpr Index DERIVATIVE_PLANES = 5, CLASSIC_PLANES = 7, REFINE_PLANES = 7;

// Fx, Fy and Ft into the first three of five planes.
void derivatives(const Frames &frames, bool five_tap, const Planes &planes);

// The paper's method: so many sweeps of one system, from `flow` where `started`, else from zero.
void classic(const Frames &frames, float *flow, bool started, bool five_tap, float lambda, Index sweeps,
             const Planes &planes);

// The frames of a level of the pyramid: two planes, or four, the first guess of the flow being the others.
//
// The finest level from images, each blurred; `scratch` is a plane of its size.
void load_frames(const Frames &frames, const float *guess, const Taps &blur, const Planes &out, const Plane &scratch);
// A coarser level from the next finer one.
void reduce_frames(const Planes &fine, const Taps &blur, const Planes &out);

// The flow with which a level begins. With a first guess each level takes its reduced copy plus the increment found so
// far, so that its detail is not lost on the way through the levels.
//
// The coarsest level:
void begin_flow(const Planes &frames, const Planes &flow);
// Another one, from the next coarser one, whose flow becomes the increment:
void expand_flow(const Planes &coarse_frames, const Planes &coarse_flow, const Planes &frames, const Planes &flow);

// How the flow of a level is refined.
struct Refinement {
    float smoothness; // λ
    bool five_tap;
    Index warps;   // linearisations
    Index sweeps;  // of each
    int median;    // side, px; 1 is none
    float outlier; // weight of Ft² against a pixel's data term
    Relaxation relaxation;
    bool exposure; // whether a change of exposure is estimated
};

// Refine a level's flow: warp the second frame, linearise, sweep, take the median, and again. The change of exposure
// that coarser levels have found, if there are any, is refined as well, and returned.
Exposure refine(const Planes &frames, const Planes &flow, const Refinement &how, const Exposure *exposure,
                const Planes &scratch);

void store_flow(const Planes &flow, float *out);

} // namespace hs
