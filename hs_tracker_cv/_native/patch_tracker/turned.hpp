// Sampling of a turned patch, which cannot be done by rows and columns: a sample is the mean of a few bilinear reads.
//
// This header is compiled for every level: static functions only, see planes.hpp.
#pragma once

#include "../arithmetic.hpp"
#include "pictures.hpp"

#include <cstdint>

namespace hs {

constexpr Index ROW = 64;       // samples at a time
constexpr Index MOST_READS = 4; // of the picture for one sample, each way

static inline Index reads_of(double step) { return clamp(static_cast<Index>(step + 0.5), 1, MOST_READS); }

// Where samples of a row read: the pixel up and left of each, and how far right of and below its centre.
struct Reads {
    std::int32_t at[ROW];
    float right[ROW], below[ROW];
};

// Reads of `count` samples that begin at (x, y) and go on by (dx, dy), px; those outside are moved to the border.
static inline void aim(const Picture &picture, double x, double y, float dx, float dy, Index count, Reads &reads) {
    const std::int32_t channels = static_cast<std::int32_t>(picture.channels);
    const std::int32_t width = static_cast<std::int32_t>(picture.width);
    const std::int32_t last_x = width > 1 ? width - 2 : 0;
    const std::int32_t last_y = picture.height > 1 ? static_cast<std::int32_t>(picture.height) - 2 : 0;
    const float most_x = static_cast<float>(width - 1), most_y = static_cast<float>(picture.height - 1);
    const float first_x = static_cast<float>(x), first_y = static_cast<float>(y);
#pragma omp simd
    for (Index j = 0; j < count; ++j) {
        const float step = static_cast<float>(j), px = first_x + dx * step, py = first_y + dy * step;
        const float low_x = px > 0.0f ? px : 0.0f, low_y = py > 0.0f ? py : 0.0f;
        const float in_x = low_x < most_x ? low_x : most_x, in_y = low_y < most_y ? low_y : most_y;
        const std::int32_t whole_x = static_cast<std::int32_t>(in_x), whole_y = static_cast<std::int32_t>(in_y);
        const std::int32_t column = whole_x < last_x ? whole_x : last_x, row = whole_y < last_y ? whole_y : last_y;
        reads.at[j] = (row * width + column) * channels;
        reads.right[j] = in_x - static_cast<float>(column);
        reads.below[j] = in_y - static_cast<float>(row);
    }
}

// One read of each of `count` samples, added to a row of every plane.
static inline void add_reads(const Picture &picture, const Reads &reads, Index count, float share, Index plane,
                             float *samples) {
    const Index right = picture.width > 1 ? picture.channels : 0;
    const Index below = picture.height > 1 ? picture.width * picture.channels : 0;
    for (Index c = 0; c < picture.channels; ++c) {
        const float *HS_RESTRICT pixels = picture.data + c;
        float *HS_RESTRICT out = samples + c * plane;
#pragma omp simd
        for (Index j = 0; j < count; ++j) {
            const float *p = pixels + reads.at[j], *q = p + below;
            const float top = p[0] + reads.right[j] * (p[right] - p[0]);
            const float low = q[0] + reads.right[j] * (q[right] - q[0]);
            out[j] += share * (top + reads.below[j] * (low - top));
        }
    }
}

// Samples of rows × columns places, a plane for each channel.
static inline void sample_turned(const Picture &picture, const Place &place, Index rows, Index columns,
                                 float *samples) {
    const Index across = reads_of(place.step_x), down = reads_of(place.step_y);
    const float share = 1.0f / static_cast<float>(across * down);
    const float dx = static_cast<float>(place.cosine * place.step_x),
                dy = static_cast<float>(place.sine * place.step_x);
    Reads reads;
    for (Index k = 0; k < picture.channels * rows * columns; ++k) samples[k] = 0.0f;
    for (Index i = 0; i < rows; ++i)
        for (Index first = 0; first < columns; first += ROW)
            for (Index k = 0; k < across * down; ++k) {
                const double in_column = (k % across + 0.5) / across - 0.5, in_row = (k / across + 0.5) / down - 0.5;
                const double right = (first - 0.5 * (columns - 1) + in_column) * place.step_x;
                const double below = (i - 0.5 * (rows - 1) + in_row) * place.step_y;
                const Index count = columns - first < ROW ? columns - first : ROW;
                aim(picture, place.x + place.cosine * right - place.sine * below,
                    place.y + place.sine * right + place.cosine * below, dx, dy, count, reads);
                add_reads(picture, reads, count, share, rows * columns, samples + i * columns + first);
            }
}

} // namespace hs
