#include "colour.hpp"

#include "sums.hpp"

#include <cmath>

namespace hs {
namespace HS_LEVEL {
namespace {

constexpr float RARE = 1e-3f;     // share added to every colour's
constexpr float SURE = 7.389056f; // e²: ratio of shares from which on it makes no difference

// Eighth of the range that a value lies in; what is no gray level counts as the nearest.
inline int eighth(float value) { return static_cast<int>(smaller(larger(value, 0.0f), 255.0f)) >> 5; }

constexpr float HERE = 0.7f, BESIDE = 0.15f;

// Smooth a histogram along one colour, whose neighbouring bins are `Step` apart.
template <Index Step> void smooth_along(const float *HS_RESTRICT cube, float *HS_RESTRICT out) {
    for (Index first = 0; first < BINS; first += 8 * Step)
        for (Index k = 0; k < 8; ++k) {
            const float *HS_RESTRICT in = cube + first + k * Step;
            float *HS_RESTRICT result = out + first + k * Step;
            for (Index l = 0; l < Step; ++l) {
                const float before = k > 0 ? in[l - Step] : 0.0f, after = k < 7 ? in[l + Step] : 0.0f;
                result[l] = HERE * in[l] + BESIDE * (before + after);
            }
        }
}

} // namespace

void bin_row(Index width, const float *image, std::int16_t *bins) {
    const float *HS_RESTRICT in = image;
    std::int16_t *HS_RESTRICT out = bins;
    for (Index x = 0; x < width; ++x) {
        const int blue = eighth(in[3 * x]), green = eighth(in[3 * x + 1]), red = eighth(in[3 * x + 2]);
        out[x] = static_cast<std::int16_t>((blue << 6) + (green << 3) + red);
    }
}

void bin_colours(Size size, const float *image, std::int16_t *bins) {
    for (Index y = 0; y < size.height; ++y)
        bin_row(size.width, image + CHANNELS * y * size.width, bins + y * size.width);
}

double likelihood(const float *colours, float *ratio) {
    const float *HS_RESTRICT object = colours, *HS_RESTRICT ground = colours + BINS;
    float *HS_RESTRICT out = ratio;
    float common[BINS];
#pragma omp simd
    for (Index i = 0; i < BINS; ++i) {
        const float a = object[i], b = ground[i];
        common[i] = std::sqrt(a * b);
        const float q = smaller(larger((a + RARE) / (b + RARE), 1.0f / SURE), SURE);
        // ln q = 4 ln √√q, and ln y = 2 artanh t, of which five terms are exact here
        const float y = std::sqrt(std::sqrt(q)), t = (y - 1.0f) / (y + 1.0f), s = t * t;
        const float series = ((1.0f / 9.0f * s + 1.0f / 7.0f) * s + 1.0f / 5.0f) * s + 1.0f / 3.0f;
        out[i] = 8.0f * t * (series * s + 1.0f);
    }
    return sum_of(common, BINS);
}

void blend(const float *colours, float *tally, double rate, float *out) {
    for (Index which = 0; which < 2; ++which) {
        float *counts = tally + which * BINS;
        float blue[BINS], green[BINS];
        smooth_along<64>(counts, blue);
        smooth_along<8>(blue, green);
        smooth_along<1>(green, counts);
        const auto total = static_cast<float>(sum_of(counts, BINS));
        const float share = total > 0.0f ? static_cast<float>(rate) : 0.0f, unit = 1.0f / larger(total, 1.0f);
        const float *before = colours + which * BINS;
        for (Index i = 0; i < BINS; ++i) out[which * BINS + i] = before[i] + share * (counts[i] * unit - before[i]);
    }
}

} // namespace HS_LEVEL
} // namespace hs
