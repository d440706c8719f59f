#include "flow.hpp"

#include "levels.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>
#include <vector>

namespace hs {

void derivatives(const Frames &frames, bool five_tap, const Planes &planes) {
    const SweepKernels &kernels = level().sweeps;
    const Plane first = plane(planes, 3), second = plane(planes, 4);
    kernels.load(frames.first, first);
    kernels.load(frames.second, second);
    kernels.derive(first, second, five_tap, slopes(planes, 0));
}

void classic(const Frames &frames, float *flow, bool started, bool five_tap, float lambda, Index sweeps,
             const Planes &planes) {
    const SweepKernels &kernels = level().sweeps;
    const Pair result = pair(planes, 0), other = pair(planes, 2);
    const Slopes g = slopes(planes, 4);
    kernels.load(frames.first, other.u);
    kernels.load(frames.second, other.v);
    kernels.scale(other.u, other.v, five_tap, lambda, g, nullptr);
    if (started) {
        kernels.load_pair(flow, result);
    } else {
        clear(result.u);
        clear(result.v);
    }
    kernels.sweep(result, other, g, sweeps, {1.0f, 0.0f});
    kernels.store_pair(sweeps % 2 ? other : result, flow);
}

namespace {

// Room for the rows of what is resized, or blurred.
class Rows {
  public:
    Rows(Index width_in, Index width_out) : memory_(new float[resize_room(width_in, width_out)]) {}
    float *data() const { return memory_.get(); }

  private:
    std::unique_ptr<float[]> memory_;
};

// Factors of u and v from the sizes of one level to those of another.
struct Gain {
    float u, v;
};

Gain gain(const Planes &from, const Planes &to) {
    return {static_cast<float>(static_cast<double>(to.first.width) / static_cast<double>(from.first.width)),
            static_cast<float>(static_cast<double>(to.first.height) / static_cast<double>(from.first.height))};
}

bool has_guess(const Planes &frames) { return frames.count == 4; }

} // namespace

void load_frames(const Frames &frames, const float *guess, const Taps &blur, const Planes &out, const Plane &scratch) {
    const SweepKernels &kernels = level().sweeps;
    const bool blurs = blur.near != 0.0f;
    const Rows rows(scratch.width, scratch.width);
    for (Index i = 0; i < 2; ++i) {
        const Plane target = plane(out, i);
        kernels.load(i ? frames.second : frames.first, blurs ? scratch : target);
        if (blurs) level().warping.blur(scratch, target, blur, rows.data());
    }
    if (guess) kernels.load_pair(guess, pair(out, 2));
}

void reduce_frames(const Planes &fine, const Taps &blur, const Planes &out) {
    const Gain factor = gain(fine, out);
    const float gains[4] = {1.0f, 1.0f, factor.u, factor.v};
    const Rows rows(fine.first.width, out.first.width);
    for (Index i = 0; i < fine.count; ++i)
        level().warping.resize(plane(fine, i), plane(out, i), gains[i], blur, rows.data());
}

void begin_flow(const Planes &frames, const Planes &flow) {
    for (Index i = 0; i < 2; ++i) {
        const Plane component = plane(flow, i);
        clear(component);
        if (has_guess(frames)) level().warping.add(plane(frames, 2 + i), component, 1.0f);
    }
}

void expand_flow(const Planes &coarse_frames, const Planes &coarse_flow, const Planes &frames, const Planes &flow) {
    const WarpKernels &kernels = level().warping;
    const Gain factor = gain(coarse_flow, flow);
    const Rows rows(coarse_flow.first.width, flow.first.width);
    for (Index i = 0; i < 2; ++i) {
        const Plane coarse = plane(coarse_flow, i), fine = plane(flow, i);
        if (has_guess(frames)) kernels.add(plane(coarse_frames, 2 + i), coarse, -1.0f);
        kernels.resize(coarse, fine, i ? factor.v : factor.u, {1.0f, 0.0f, 0.0f}, rows.data());
        if (has_guess(frames)) kernels.add(plane(frames, 2 + i), fine, 1.0f);
    }
}

namespace {

constexpr Index MOST_SAMPLES = 4096; // that suffice for a median

// The median difference of two frames where the mask is not 0.
float median_difference(const Plane &first, const Plane &second, const Plane &mask) {
    const double pixels = static_cast<double>(first.height) * static_cast<double>(first.width);
    const Index step = static_cast<Index>(std::ceil(std::sqrt(pixels / static_cast<double>(MOST_SAMPLES))));
    std::vector<float> differences;
    for (Index y = step / 2; y < first.height; y += step)
        for (Index x = step / 2; x < first.width; x += step)
            if (row(mask, y)[x] != 0.0f) differences.push_back(row(second, y)[x] - row(first, y)[x]);
    if (differences.empty()) return 0.0f;
    const auto middle = differences.begin() + static_cast<std::ptrdiff_t>(differences.size() / 2);
    std::nth_element(differences.begin(), middle, differences.end());
    return *middle;
}

// Change of gain that is believed. What comes into view and goes out of it looks like one of up to .01 on Middlebury's
// pairs, and taken off makes their flow worse; of this size it leaves a gray level.
constexpr double LEAST_GAIN = 0.02;

// A line through the differences of two frames against their means. Against the first frame alone its slope would be
// biased wherever the flow is still wrong; against the mean it says how the frames' spreads differ.
Exposure fitted(const LineSums &sums) {
    if (sums.w <= 0.0) return {0.0f, 0.0f};
    const double mean = sums.m / sums.w, difference = sums.d / sums.w;
    const double variance = sums.mm / sums.w - mean * mean;
    // Less than a gray level of spread tells nothing about gain.
    double gain = variance > 1.0 ? (sums.md / sums.w - mean * difference) / variance : 0.0;
    if (std::abs(gain) < LEAST_GAIN) gain = 0.0;
    return {static_cast<float>(gain), static_cast<float>(difference - gain * mean)};
}

constexpr int FIRST_FITS = 4; // of the coarsest level, where the exposure is not yet known

Exposure fit_exposure(const Plane &first, const Plane &warped, const Plane &mask, float outlier,
                      const Exposure *known) {
    const WarpKernels &kernels = level().warping;
    Exposure exposure = known ? *known : Exposure{0.0f, median_difference(first, warped, mask)};
    for (int i = 0; i < (known ? 1 : FIRST_FITS); ++i)
        exposure = fitted(kernels.compare(first, warped, mask, outlier, exposure));
    return exposure;
}

} // namespace

Exposure refine(const Planes &frames, const Planes &flow, const Refinement &how, const Exposure *known,
                const Planes &scratch) {
    const Level &kernels = level();
    const Plane first = plane(frames, 0), second = plane(frames, 1), warped = plane(scratch, 0),
                mask = plane(scratch, 1);
    const Slopes g = slopes(scratch, 2);
    Pair now = pair(flow, 0), other = pair(scratch, 5);
    Exposure exposure = known ? *known : Exposure{0.0f, 0.0f};
    for (Index i = 0; i < how.warps; ++i) {
        kernels.warping.warp(second, now, warped, mask);
        if (how.exposure) {
            exposure = fit_exposure(first, warped, mask, how.outlier, known);
            known = &exposure;
        }
        kernels.warping.linearise(first, warped, mask, now, how.five_tap, how.smoothness, how.outlier, exposure, g);
        kernels.sweeps.sweep(now, other, g, how.sweeps, how.relaxation);
        if (how.sweeps % 2) std::swap(now, other);
        if (how.median == 1) continue;
        kernels.warping.median(now.u, other.u, how.median);
        kernels.warping.median(now.v, other.v, how.median);
        std::swap(now, other);
    }
    if (now.u.data != flow.first.data) {
        copy(now.u, plane(flow, 0));
        copy(now.v, plane(flow, 1));
    }
    return exposure;
}

void store_flow(const Planes &flow, float *out) { level().sweeps.store_pair(pair(flow, 0), out); }

} // namespace hs
