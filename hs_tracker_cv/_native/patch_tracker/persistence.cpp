#include "persistence.hpp"

#include "../arithmetic.hpp"

#include <cmath>
#include <cstdint>

namespace hs {
namespace {

// Means of 2 × 2 pixels, (height / 2, width / 2).
struct Halves {
    float *left;             // of what was kept, without what moves with the surroundings
    float *previous, *now;   // patches
    float *mean, *deviation; // of patches, as they were learned
    Index height, width;
};

// The new means of a row.
void learn_row(const Before &before, const Passage &passage, const Persistence &how, Index start, float *means) {
    const Index size = before.height * before.width;
    const float *HS_RESTRICT old_mean = before.means + start, *HS_RESTRICT old_deviation = old_mean + size;
    const float *HS_RESTRICT old_mask = old_deviation + size, *HS_RESTRICT weights = before.weights + start;
    const float *HS_RESTRICT fitted = passage.planes + start, *HS_RESTRICT belongs = fitted + size;
    const float *HS_RESTRICT patch = passage.patch + start;
    float *HS_RESTRICT mean = means + start, *HS_RESTRICT deviation = mean + size;
    float *HS_RESTRICT mask = deviation + size, *HS_RESTRICT prior = mask + size;
#pragma omp simd
    for (Index x = 0; x < before.width; ++x) {
        const double change = patch[x] - old_mean[x], weight = fitted[x];
        const double strayed = old_deviation[x] + how.mean_rate * (std::fabs(change) - old_deviation[x]);
        const double moves = old_mask[x] + how.mask_rate * weight / (weight + 0.2) * (belongs[x] - old_mask[x]);
        mean[x] = static_cast<float>(old_mean[x] + how.mean_rate * change);
        deviation[x] = static_cast<float>(strayed);
        mask[x] = static_cast<float>(moves);
        prior[x] = static_cast<float>(weights[x] * (how.floor + moves) / (1.0 + 0.01 * strayed * strayed));
    }
}

float quarter(const float *pixels, Index width, Index j) {
    return 0.25f * ((pixels[2 * j] + pixels[2 * j + 1]) + (pixels[width + 2 * j] + pixels[width + 2 * j + 1]));
}

void halve_row(const Before &before, const Passage &passage, Index i, const Halves &halves) {
    const Index width = before.width, size = before.height * width, start = 2 * i * width, at = i * halves.width;
    const float *HS_RESTRICT previous = before.previous + start, *HS_RESTRICT patch = passage.patch + start;
    const float *HS_RESTRICT mean = before.means + start, *HS_RESTRICT deviation = mean + size;
    float *HS_RESTRICT half_previous = halves.previous + at, *HS_RESTRICT half_now = halves.now + at;
    float *HS_RESTRICT half_mean = halves.mean + at, *HS_RESTRICT half_deviation = halves.deviation + at;
#pragma omp simd
    for (Index j = 0; j < halves.width; ++j) {
        half_previous[j] = quarter(previous, width, j);
        half_now[j] = quarter(patch, width, j);
        half_mean[j] = quarter(mean, width, j);
        half_deviation[j] = quarter(deviation, width, j);
    }
}

// Where most of the weight moves with the surroundings, that much less is left.
void leave_row(const Before &before, const Passage &passage, Index i, const Halves &halves) {
    const Index width = before.width, start = 2 * i * width;
    const float *HS_RESTRICT weights = passage.planes + start, *HS_RESTRICT belongs = weights + before.height * width;
    const float *HS_RESTRICT persistence = before.persistence + i * halves.width;
    float *HS_RESTRICT left = halves.left + i * halves.width;
    const auto sure = [=](Index k) { return weights[k] / (weights[k] + 0.1f); };
#pragma omp simd
    for (Index j = 0; j < halves.width; ++j) {
        const Index k = 2 * j;
        const float weight = 0.25f * ((sure(k) + sure(k + 1)) + (sure(k + width) + sure(k + width + 1)));
        const float strange = 1.0f - 2.0f * quarter(belongs, width, j);
        left[j] = persistence[j] * (1.0f - weight * (strange > 0.0f ? strange : 0.0f));
    }
}

// Move a row of what is left with the flow, drop what changed, take back what looks as it was learned.
void move_row(const Before &before, const Passage &passage, const Persistence &how, Index i, const Halves &halves,
              float *HS_RESTRICT persistence) {
    const Index width = halves.width, at = i * width;
    const double middle_x = 0.5 * (width - 1), middle_y = 0.5 * (halves.height - 1), up = i - middle_y;
    const double from_x = passage.right + middle_x - passage.sine * up;
    const double from_y = passage.down + middle_y + passage.cosine * up, span = 1.0 / (how.changed - how.same);
    const float *HS_RESTRICT flow = passage.flow + 2 * ((2 * i + 1) * before.width + 1);
    const float *HS_RESTRICT left = halves.left, *HS_RESTRICT previous = halves.previous;
    const float *HS_RESTRICT body = before.body + at, *HS_RESTRICT now = halves.now + at;
    const float *HS_RESTRICT mean = halves.mean + at, *HS_RESTRICT deviation = halves.deviation + at;
#pragma omp simd
    for (Index j = 0; j < width; ++j) {
        const double along = static_cast<double>(j) - middle_x;
        const double x = within(from_x + passage.cosine * along - 0.5 * flow[4 * j], 0.0, width - 1.001);
        const double y = within(from_y + passage.sine * along - 0.5 * flow[4 * j + 1], 0.0, halves.height - 1.001);
        const std::int32_t ix = static_cast<std::int32_t>(x), iy = static_cast<std::int32_t>(y);
        const std::int32_t k = iy * static_cast<std::int32_t>(width) + ix, low = k + static_cast<std::int32_t>(width);
        const double fx = x - ix, fy = y - iy, a = (1.0 - fy) * (1.0 - fx), b = (1.0 - fy) * fx;
        const double c = fy * (1.0 - fx), d = fy * fx;
        const double held = a * left[k] + b * left[k + 1] + c * left[low] + d * left[low + 1];
        const double seen = a * previous[k] + b * previous[k + 1] + c * previous[low] + d * previous[low + 1];
        const double value = held * within((how.changed - std::fabs(seen - now[j])) * span, 0.0, 1.0);
        const double error = static_cast<double>(now[j] - mean[j]) / (10.0 + deviation[j]);
        persistence[j] = static_cast<float>(value + how.rate * decay(error * error) * (body[j] - value));
    }
}

void update_persistence(const Before &before, const Passage &passage, const Persistence &how, float *room,
                        float *persistence, float *means) {
    const Index height = before.height / 2, width = before.width / 2, size = height * width;
    const Halves halves{room, room + size, room + 2 * size, room + 3 * size, room + 4 * size, height, width};
    for (Index y = 0; y < before.height; ++y) learn_row(before, passage, how, y * before.width, means);
    for (Index i = 0; i < height; ++i) {
        halve_row(before, passage, i, halves);
        leave_row(before, passage, i, halves);
    }
    for (Index i = 0; i < height; ++i) move_row(before, passage, how, i, halves, persistence + i * width);
}

} // namespace

extern const PersistenceKernels HS_JOIN(persistence, HS_LEVEL) = {update_persistence};

} // namespace hs
