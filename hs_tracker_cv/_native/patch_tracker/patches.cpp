#include "patches.hpp"

#include "../arithmetic.hpp"
#include "turned.hpp"

#include <cmath>
#include <cstdlib>

namespace hs {
namespace {

constexpr float CONTRAST = 32.0f; // deviation of a patch
constexpr float FLOOR = 4.0f;     // gray levels of deviation that are noise
// Weight of the neighbour of a sample in a patch: a Gaussian of 0.7 samples, cut after one.
constexpr double NEIGHBOUR = 0.209453608559564;
constexpr float UNSEEN = 1e-4f; // share of a bin that was not seen

// ---- sampling ----

// Weights (length, count) of the pixels of a line that each of `count` samples of it averages, from `first` on.
struct Line {
    Index count, length;
    std::int32_t *first;
    float *weights;
};

Index line_length(double step, Index reach, Index size) {
    const Index length = static_cast<Index>(static_cast<double>(2 * reach + 1) * step) + 3;
    return length < size ? length : size;
}

// A sample is the mean of bilinear reads spread evenly over a step. With a `side` other than 0 it is smoothed: its two
// neighbours, mirrored at the ends, get that weight each. All this makes one row of weights. The border is repeated.
void weigh(double centre, double step, double side, Index size, const Line &line) {
    const Index reach = side > 0.0 ? 1 : 0, sub = reads_of(step), last = line.count - 1;
    const double half = 0.5 * last;
    for (Index k = 0; k < line.length * line.count; ++k) line.weights[k] = 0.0f;
    for (Index i = 0; i <= last; ++i) {
        const double start = std::floor(centre + (i - reach - half - 0.5 * (sub - 1) / sub) * step);
        const Index low = static_cast<Index>(within(start, 0.0, static_cast<double>(size - line.length)));
        line.first[i] = static_cast<std::int32_t>(low);
        for (Index j = 0; j < (2 * reach + 1) * sub; ++j) {
            const Index near = j / sub - reach, n = last - std::abs(last - std::abs(i + near));
            const double share = (near == 0 ? 1.0 - 2.0 * side : side) / sub;
            const double position = within(centre + (n - half + (j % sub + 0.5) / sub - 0.5) * step, 0.0, size - 1.0);
            const Index whole = clamp(static_cast<Index>(position), 0, size - 2);
            const double part = position - whole;
            const Index k = clamp(whole - low, 0, line.length - 2);
            float *own = line.weights + k * line.count + i;
            own[0] = static_cast<float>(own[0] + (1.0 - part) * share);
            own[line.count] = static_cast<float>(own[line.count] + part * share);
        }
    }
}

// Samples of one row, into a plane for each channel, from a line of pixels.
template <Index Channels>
void gather(const float *HS_RESTRICT pixels, const Line &columns, float *HS_RESTRICT samples, Index plane) {
    for (Index j = 0; j < columns.count; ++j) {
        float total[Channels] = {};
        const float *in = pixels + columns.first[j] * Channels, *weights = columns.weights + j;
        for (Index k = 0; k < columns.length; ++k)
            for (Index c = 0; c < Channels; ++c) total[c] += weights[k * columns.count] * in[k * Channels + c];
        for (Index c = 0; c < Channels; ++c) samples[c * plane + j] = total[c];
    }
}

void sample_straight(const Window &window, double side, const PatchRoom &room, float *samples) {
    const Picture &picture = window.picture;
    const Place &place = window.place;
    const Index channels = picture.channels, reach = side > 0.0 ? 1 : 0, plane = window.rows * window.columns;
    Line columns{window.columns, line_length(place.step_x, reach, picture.width), room.integers, room.floats};
    Line rows{window.rows, line_length(place.step_y, reach, picture.height), room.integers + columns.count,
              room.floats + columns.count * columns.length};
    weigh(place.x, place.step_x, side, picture.width, columns);
    weigh(place.y, place.step_y, side, picture.height, rows);
    const Index left = columns.first[0] * channels;
    const Index width = (columns.first[columns.count - 1] + columns.length) * channels - left;
    float *HS_RESTRICT line = rows.weights + rows.count * rows.length;
    for (Index i = 0; i < rows.count; ++i) {
        for (Index j = 0; j < width; ++j) line[j] = 0.0f;
        for (Index k = 0; k < rows.length; ++k) {
            const float weight = rows.weights[k * rows.count + i];
            if (weight == 0.0f) continue;
            const float *HS_RESTRICT in = picture.data + (rows.first[i] + k) * picture.width * channels + left;
#pragma omp simd
            for (Index j = 0; j < width; ++j) line[j] += weight * in[j];
        }
        (channels == 3 ? gather<3> : gather<1>)(line - left, columns, samples + i * window.columns, plane);
    }
}

void sample_smoothed(const Window &window, double side, const PatchRoom &room, float *samples) {
    if (is_straight(window.place))
        sample_straight(window, side, room, samples);
    else
        // Costs several times as much, and is not smoothed.
        sample_turned(window.picture, window.place, window.rows, window.columns, samples);
}

void sample(const Window &window, const PatchRoom &room, float *samples) {
    sample_smoothed(window, 0.0, room, samples);
}

Index line_floats(const Window &window) {
    const Picture &picture = window.picture;
    return window.columns * line_length(window.place.step_x, 1, picture.width) +
           window.rows * line_length(window.place.step_y, 1, picture.height) + picture.width * picture.channels;
}

Index floats(const Window &window) {
    return line_floats(window) + (window.picture.channels + 1) * window.rows * window.columns;
}

Index integers(const Window &window) { return window.rows + window.columns + window.rows * window.columns; }

// ---- patches ----

double score(const float *HS_RESTRICT patch, const float *HS_RESTRICT weights, const float *HS_RESTRICT other,
             Index size, double deviation) {
    // The means of both under these weights are zero.
    const double both = sum(size, [=](Index i) { return static_cast<double>(weights[i]) * other[i] * patch[i]; });
    const double power = sum(size, [=](Index i) { return static_cast<double>(weights[i]) * other[i] * other[i]; });
    return both / std::sqrt(power * deviation * deviation + 1e-6);
}

void patch(const Window &window, const float *HS_RESTRICT weights, const float *templates, Index count,
           const PatchRoom &room, float *HS_RESTRICT patch, double *scores) {
    const Index size = window.rows * window.columns;
    float *HS_RESTRICT raw = room.floats + line_floats(window);
    sample_smoothed(window, NEIGHBOUR, room, raw);
    const double middle = raw[size / 2];
    const double mean = sum(size, [=](Index i) { return weights[i] * (raw[i] - middle); });
    const double square = sum(size, [=](Index i) { return weights[i] * (raw[i] - middle) * (raw[i] - middle); });
    const double deviation = std::sqrt(larger(square - mean * mean, 0.0)), factor = CONTRAST / (deviation + FLOOR);
#pragma omp simd
    for (Index i = 0; i < size; ++i) patch[i] = static_cast<float>((raw[i] - middle - mean) * factor);
    for (Index k = 0; k < count; ++k) scores[k] = score(patch, weights, templates + k * size, size, deviation * factor);
}

// ---- colours ----

// Bin of each sample.
void classify(const float *HS_RESTRICT samples, Index channels, Index size, std::int32_t *HS_RESTRICT bins) {
    const float *HS_RESTRICT second = samples + size, *HS_RESTRICT third = samples + 2 * size;
    const auto shade = [](float value, float width, std::int32_t last) {
        const float whole = value > 0.0f ? value * (1.0f / width) : 0.0f;
        return whole < static_cast<float>(last) ? static_cast<std::int32_t>(whole) : last;
    };
    if (channels == 1) {
#pragma omp simd
        for (Index i = 0; i < size; ++i) bins[i] = shade(samples[i], 4.0f, 63);
    } else {
#pragma omp simd
        for (Index i = 0; i < size; ++i)
            bins[i] =
                256 * shade(samples[i], 16.0f, 15) + 16 * shade(second[i], 16.0f, 15) + shade(third[i], 16.0f, 15);
    }
}

std::int32_t *bins_of(const Window &window, const PatchRoom &room) {
    const Index size = window.rows * window.columns;
    float *samples = room.floats + line_floats(window);
    std::int32_t *bins = room.integers + window.rows + window.columns;
    sample(window, room, samples);
    classify(samples, window.picture.channels, size, bins);
    return bins;
}

// Mean of 3 × 3 numbers, mirrored at the border.
void mean_of_nine(const float *in, Index rows, Index columns, float *out) {
    const auto mirrored = [](Index i, Index count) { return count - 1 - std::abs(count - 1 - std::abs(i)); };
    for (Index i = 0; i < rows; ++i) {
        const float *HS_RESTRICT up = in + mirrored(i - 1, rows) * columns, *HS_RESTRICT here = in + i * columns;
        const float *HS_RESTRICT down = in + mirrored(i + 1, rows) * columns;
        float *HS_RESTRICT mean = out + i * columns;
        const auto nine = [=](Index left, Index j, Index right) {
            const float top = up[left] + up[j] + up[right], middle = here[left] + here[j] + here[right];
            return (top + middle + (down[left] + down[j] + down[right])) / 9.0f;
        };
#pragma omp simd
        for (Index j = 1; j < columns - 1; ++j) mean[j] = nine(j - 1, j, j + 1);
        mean[0] = nine(1, 0, 1);
        mean[columns - 1] = nine(columns - 2, columns - 1, columns - 2);
    }
}

void likelihood(const Window &window, const float *histograms, const PatchRoom &room, float *likelihood) {
    const Index size = window.rows * window.columns;
    const std::int32_t *bins = bins_of(window, room);
    const float *inside = histograms, *outside = histograms + (window.picture.channels == 1 ? GRAYS : COLOURS);
    float *own = room.floats + line_floats(window);
    for (Index i = 0; i < size; ++i) {
        const float share = inside[bins[i]] + UNSEEN;
        own[i] = share / (share + outside[bins[i]] + UNSEEN);
    }
    mean_of_nine(own, window.rows, window.columns, likelihood);
}

// Weights of a blur of σ 1.5 bins: of a gray video's histogram, whose bins are narrow.
constexpr Index REACH = 3;
constexpr float BLUR[2 * REACH + 1] = {0.03663285f, 0.11128076f, 0.21674532f, 0.27068214f,
                                       0.21674532f, 0.11128076f, 0.03663285f};

void blur(const float *counts, Index bins, float *out) {
    for (Index i = 0; i < bins; ++i) {
        float total = 0.0f;
        for (Index k = -REACH; k <= REACH; ++k)
            total += BLUR[k + REACH] * counts[bins - 1 - std::abs(bins - 1 - std::abs(i + k))];
        out[i] = total;
    }
}

void learn(const Window &window, const std::uint8_t *inside, const Histograms &old, float rate, const PatchRoom &room,
           float *counts, float *learned) {
    const Index size = window.rows * window.columns, count = old.bins;
    const std::int32_t *bins = bins_of(window, room);
    for (Index i = 0; i < 2 * count; ++i) counts[i] = 0.0f;
    for (Index i = 0; i < size; ++i) counts[(inside[i] ? 0 : count) + bins[i]] += 1.0f;
    for (Index side = 0; side < 2; ++side) {
        const float *HS_RESTRICT own = counts + side * count, *HS_RESTRICT before = old.shares + side * count;
        float *HS_RESTRICT out = learned + side * count;
        if (window.picture.channels == 1)
            blur(own, count, out);
        else
            for (Index i = 0; i < count; ++i) out[i] = own[i];
        const double all = 1e-9 + sum(count, [=](Index i) { return static_cast<double>(out[i]); });
#pragma omp simd
        for (Index i = 0; i < count; ++i)
            out[i] = static_cast<float>(before[i] + static_cast<double>(rate) * (out[i] / all - before[i]));
    }
}

} // namespace

extern const PatchKernels HS_JOIN(patches, HS_LEVEL) = {floats, integers, sample, patch, likelihood, learn};

} // namespace hs
