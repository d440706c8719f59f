// Channels: histograms of oriented gradients as in P. Felzenszwalb and others, "Object detection with discriminatively
// trained part-based models", TPAMI 2010, without the contrast-sensitive half; mean gray; what the colours are called.
// Filter: F. Li and others, "Learning spatial-temporal regularized correlation filters for visual tracking", CVPR 2018.
#include "finder.hpp"

#include "../arithmetic.hpp"
#include "turned.hpp"

#include <cmath>

namespace hs {
namespace {

constexpr Index SIDE = CELLS * CELL;
constexpr Index EDGE = CELLS + 2; // cells along a side, with a ring of one
constexpr float PI = 3.14159265f;

// ---- sampling ----

Index taps_length(double step, Index size) {
    const Index length = static_cast<Index>(std::ceil(larger(step, 1.0))) + 1;
    return length < size ? length : size;
}

// First pixel that each sample averages, and the pixels' weights: a sample is the mean of a piece of the line as long
// as a step, or as a pixel if that is longer. The border is repeated.
void weigh(double centre, double step, Index size, Index length, Index *first, float *weights) {
    const double width = larger(step, 1.0);
    for (Index i = 0; i < PATCH; ++i) {
        float *own = weights + i * length;
        for (Index k = 0; k < length; ++k) own[k] = 0.0f;
        // Far outside every pixel is the border's.
        const double middle = smaller(larger(centre + (i - 0.5 * (PATCH - 1)) * step + 0.5, -width), size + width);
        const double low = middle - 0.5 * width, high = middle + 0.5 * width;
        const Index start = static_cast<Index>(std::floor(low));
        first[i] = clamp(start, 0, size - length);
        for (Index p = start; p < high; ++p) {
            const double part = smaller(high, p + 1.0) - larger(low, static_cast<double>(p));
            own[clamp(clamp(p, 0, size - 1) - first[i], 0, length - 1)] += static_cast<float>(part / width);
        }
    }
}

// A line of pixels, and which of them each sample averages: the first, and the weights of `across` from there on.
struct Taps {
    const float *line;
    const Index *first;
    const float *weights;
    Index across;
};

// The samples of one row, into a plane for each channel. A number of taps that is known lets the compiler unroll;
// 0 stands for any.
template <Index Channels, Index Known> void gather(const Taps &taps, float *HS_RESTRICT patch) {
    constexpr Index WIDTH = Channels == 3 ? 4 : 1; // with the pixel's right neighbour: one register
    const Index across = Known ? Known : taps.across;
    const float *HS_RESTRICT line = taps.line, *HS_RESTRICT weights = taps.weights;
    for (Index j = 0; j < PATCH; ++j) {
        float total[WIDTH] = {};
        const float *in = line + taps.first[j] * Channels;
        for (Index k = 0; k < across; ++k)
            for (Index c = 0; c < WIDTH; ++c) total[c] += weights[j * across + k] * in[k * Channels + c];
        for (Index c = 0; c < Channels; ++c) patch[c * PATCH * PATCH + j] = total[c];
    }
}

template <Index Channels> void gather(const Taps &taps, float *patch) {
    switch (taps.across) {
    case 2:
        return gather<Channels, 2>(taps, patch);
    case 3:
        return gather<Channels, 3>(taps, patch);
    case 4:
        return gather<Channels, 4>(taps, patch);
    default:
        return gather<Channels, 0>(taps, patch);
    }
}

void sample_straight(const Picture &picture, const Place &place, float *room, float *patch) {
    const Index channels = picture.channels;
    const Index across = taps_length(place.step_x, picture.width), down = taps_length(place.step_y, picture.height);
    Index columns[PATCH], rows[PATCH];
    float *weights_x = room, *weights_y = weights_x + PATCH * across, *line = weights_y + PATCH * down;
    weigh(place.x, place.step_x, picture.width, across, columns, weights_x);
    weigh(place.y, place.step_y, picture.height, down, rows, weights_y);
    const Index left = columns[0] * channels, right = (columns[PATCH - 1] + across) * channels;
    const Taps taps{line, columns, weights_x, across};
    line[right] = 0.0f; // is read, and does not count
    for (Index i = 0; i < PATCH; ++i) {
        for (Index j = left; j < right; ++j) line[j] = 0.0f;
        for (Index k = 0; k < down; ++k) {
            const float weight = weights_y[i * down + k];
            if (weight == 0.0f) continue;
            const float *HS_RESTRICT in = picture.data + (rows[i] + k) * picture.width * channels;
            float *HS_RESTRICT out = line;
#pragma omp simd
            for (Index j = left; j < right; ++j) out[j] += weight * in[j];
        }
        if (channels == 3)
            gather<3>(taps, patch + i * PATCH);
        else
            gather<1>(taps, patch + i * PATCH);
    }
}

// ---- channels ----

// Edges of the samples of row i, in the channel where they are strongest: length, direction (in steps of π / ANGLES).
void edges(const float *patch, Index channels, Index i, float *HS_RESTRICT length, float *HS_RESTRICT direction) {
    float x[SIDE], y[SIDE], square[SIDE];
    for (Index c = 0; c < channels; ++c) {
        const float *HS_RESTRICT here = patch + (c * PATCH + i + 1) * PATCH + 1;
        const float *HS_RESTRICT above = here - PATCH, *HS_RESTRICT below = here + PATCH;
#pragma omp simd
        for (Index j = 0; j < SIDE; ++j) {
            const float right = here[j + 1] - here[j - 1], down = below[j] - above[j];
            const float power = right * right + down * down;
            const bool stronger = c == 0 || power > square[j];
            x[j] = stronger ? right : x[j];
            y[j] = stronger ? down : y[j];
            square[j] = stronger ? power : square[j];
        }
    }
#pragma omp simd
    for (Index j = 0; j < SIDE; ++j) {
        length[j] = std::sqrt(square[j]);
        // The arc tangent by a polynomial, to 2e-6: kernels call no C function.
        const float a = std::fabs(x[j]), b = std::fabs(y[j]);
        const float most = a > b ? a : b, least = a > b ? b : a, t = least / (most + 1e-12f), s = t * t;
        const float arc =
            t * (0.99997726f +
                 s * (-0.33262347f + s * (0.19354346f + s * (-0.11643287f + s * (0.05265332f + s * -0.01172120f)))));
        const float angle = b > a ? 0.5f * PI - arc : arc;
        // An edge and its negative are the same.
        const float turned = (x[j] < 0.0f) != (y[j] < 0.0f) ? PI - angle : angle;
        direction[j] = turned * (ANGLES / PI);
    }
}

// Histograms of edges (EDGE, EDGE, ANGLES): each sample is shared by the four nearest cells and two directions.
void collect(const float *patch, Index channels, float *histograms) {
    for (Index k = 0; k < EDGE * EDGE * ANGLES; ++k) histograms[k] = 0.0f;
    float length[SIDE], direction[SIDE], row[EDGE * ANGLES];
    for (Index i = 0; i < SIDE; ++i) {
        edges(patch, channels, i, length, direction);
        for (Index k = 0; k < EDGE * ANGLES; ++k) row[k] = 0.0f;
        for (Index j = 0; j < SIDE; ++j) {
            const Index at = (j + CELL / 2) / CELL, whole = static_cast<Index>(direction[j]);
            const float right = ((j + CELL / 2) % CELL + 0.5f) / CELL, part = direction[j] - static_cast<float>(whole);
            const Index one = whole >= ANGLES ? whole - ANGLES : whole, two = one + 1 == ANGLES ? 0 : one + 1;
            const float second = part * length[j], first = length[j] - second;
            float *cell = row + at * ANGLES;
            cell[one] += first * (1.0f - right);
            cell[two] += second * (1.0f - right);
            cell[ANGLES + one] += first * right;
            cell[ANGLES + two] += second * right;
        }
        const float low = ((i + CELL / 2) % CELL + 0.5f) / CELL;
        float *HS_RESTRICT upper = histograms + (i + CELL / 2) / CELL * EDGE * ANGLES;
        float *HS_RESTRICT lower = upper + EDGE * ANGLES;
#pragma omp simd
        for (Index k = 0; k < EDGE * ANGLES; ++k) {
            upper[k] += row[k] * (1.0f - low);
            lower[k] += row[k] * low;
        }
    }
}

// Mean gray (0–255) of a cell, and how much of it is called by each of the names.
float name(const float *patch, Index channels, Index row, Index column, const float *names, float *shares) {
    float total[3] = {0.0f, 0.0f, 0.0f};
    for (Index k = 0; k < NAMES; ++k) shares[k] = 0.0f;
    for (Index quarter = 0; quarter < 4; ++quarter) {
        const Index y = row * CELL + 1 + quarter / 2 * (CELL / 2), x = column * CELL + 1 + quarter % 2 * (CELL / 2);
        Index shade = 0;
        for (Index c = 0; c < channels; ++c) {
            float sum = 0.0f;
            for (Index i = 0; i < CELL / 2; ++i)
                for (Index j = 0; j < CELL / 2; ++j) sum += patch[(c * PATCH + y + i) * PATCH + x + j];
            const float mean = sum * (4.0f / (CELL * CELL));
            total[c] += 0.25f * mean;
            shade = shade * SHADES + clamp(static_cast<Index>(mean * (SHADES / 256.0f)), 0, SHADES - 1);
        }
        if (names)
            for (Index k = 0; k < NAMES; ++k) shares[k] += 0.25f * names[shade * NAMES + k];
    }
    return channels == 1 ? total[0] : 0.114f * total[0] + 0.587f * total[1] + 0.299f * total[2];
}

void assemble(const float *patch, Index channels, const float *histograms, float *energy, const float *fade,
              const float *names, float *features, float *grays) {
    constexpr float LIMIT = 0.2f, LEAST = 1e-4f * CELL * CELL * CELL * CELL;
    for (Index k = 0; k < EDGE * EDGE; ++k) {
        energy[k] = 0.0f;
        for (Index a = 0; a < ANGLES; ++a) energy[k] += histograms[k * ANGLES + a] * histograms[k * ANGLES + a];
    }
    const Index count = names ? COLOUR_CHANNELS : GRAY_CHANNELS;
    for (Index i = 0; i < CELLS; ++i)
        for (Index j = 0; j < CELLS; ++j) {
            const Index cell = (i + 1) * EDGE + j + 1;
            const float *own = histograms + cell * ANGLES;
            float *out = features + (i * CELLS + j) * count, shares[NAMES];
            for (Index a = 0; a < ANGLES; ++a) out[a] = 0.0f;
            // Relative to the four squares of 2 × 2 cells that it belongs to.
            for (Index corner = 0; corner < 4; ++corner) {
                const Index y = corner / 2 ? EDGE : -EDGE, x = corner % 2 ? 1 : -1;
                const float near = energy[cell] + energy[cell + x] + energy[cell + y] + energy[cell + y + x];
                const float part = 1.0f / std::sqrt(near + LEAST);
                float total = 0.0f;
                for (Index a = 0; a < ANGLES; ++a) {
                    const float value = own[a] * part < LIMIT ? own[a] * part : LIMIT;
                    out[a] += 0.5f * value;
                    total += value;
                }
                out[ANGLES + corner] = 0.2357f * total;
            }
            grays[i * CELLS + j] = name(patch, channels, i, j, names, shares);
            out[ANGLES + 4] = grays[i * CELLS + j] * (1.0f / 255.0f) - 0.5f;
            for (Index k = 0; k < NAMES && names; ++k) out[ANGLES + 5 + k] = shares[k];
            for (Index k = ANGLES + 5 + (names ? NAMES : 0); k < count; ++k) out[k] = 0.0f;
            for (Index k = 0; k < count; ++k) out[k] *= fade[i * CELLS + j];
        }
}

Index describe_room(const Picture &picture, const Place &place) {
    const Index taps = taps_length(place.step_x, picture.width) + taps_length(place.step_y, picture.height);
    return picture.channels * (PATCH * PATCH + picture.width) + 1 + EDGE * EDGE * (ANGLES + 1) + PATCH * taps;
}

void sample(const Picture &picture, const Place &place, float *room, float *patch) {
    if (is_straight(place))
        sample_straight(picture, place, room, patch);
    else
        sample_turned(picture, place, PATCH, PATCH, patch);
}

void describe(const Picture &picture, const Place &place, const float *fade, const float *names, float *room,
              float *features, float *grays) {
    float *patch = room, *histograms = patch + picture.channels * PATCH * PATCH;
    float *energy = histograms + EDGE * EDGE * ANGLES, *rest = energy + EDGE * EDGE;
    sample(picture, place, rest, patch);
    collect(patch, picture.channels, histograms);
    assemble(patch, picture.channels, histograms, energy, fade, names, features, grays);
}

void shade(const Picture &picture, const Place &place, float *room, float *grays) {
    float nothing[NAMES];
    sample(picture, place, room + picture.channels * PATCH * PATCH, room);
    for (Index i = 0; i < CELLS; ++i)
        for (Index j = 0; j < CELLS; ++j) grays[i * CELLS + j] = name(room, picture.channels, i, j, nullptr, nothing);
}

// ---- transforms ----

// One step of a transform that sorts itself (Stockham): `in` are Radix × width points `apart` floats from each other.
// A point is `count` times LANES real parts followed by as many imaginary parts. `re` and `im` say which are which: a
// transform with the two exchanged is the inverse one.
template <Index Radix, Index Lanes>
inline void butterflies(const float *HS_RESTRICT in, Index apart, float *HS_RESTRICT out, Index step, const float *turn,
                        Index re, Index im) {
#pragma omp simd
    for (Index l = 0; l < Lanes; ++l) {
        float a[Radix], b[Radix], c[Radix], d[Radix];
        for (Index k = 0; k < Radix; ++k) {
            a[k] = in[k * apart + re + l];
            b[k] = in[k * apart + im + l];
        }
        if constexpr (Radix == 2) {
            c[0] = a[0] + a[1], d[0] = b[0] + b[1];
            c[1] = a[0] - a[1], d[1] = b[0] - b[1];
        } else if constexpr (Radix == 4) {
            const float p = a[0] + a[2], q = b[0] + b[2], r = a[0] - a[2], s = b[0] - b[2];
            const float t = a[1] + a[3], u = b[1] + b[3], v = a[1] - a[3], w = b[1] - b[3];
            c[0] = p + t, d[0] = q + u;
            c[1] = r + w, d[1] = s - v;
            c[2] = p - t, d[2] = q - u;
            c[3] = r - w, d[3] = s + v;
        } else {
            constexpr float C1 = 0.30901699437f, C2 = -0.80901699437f, S1 = 0.95105651630f, S2 = 0.58778525229f;
            const float p1 = a[1] + a[4], q1 = b[1] + b[4], m1 = a[1] - a[4], n1 = b[1] - b[4];
            const float p2 = a[2] + a[3], q2 = b[2] + b[3], m2 = a[2] - a[3], n2 = b[2] - b[3];
            const float u1 = a[0] + C1 * p1 + C2 * p2, v1 = b[0] + C1 * q1 + C2 * q2;
            const float u2 = a[0] + C2 * p1 + C1 * p2, v2 = b[0] + C2 * q1 + C1 * q2;
            const float w1 = S1 * m1 + S2 * m2, z1 = S1 * n1 + S2 * n2, w2 = S2 * m1 - S1 * m2, z2 = S2 * n1 - S1 * n2;
            c[0] = a[0] + p1 + p2, d[0] = b[0] + q1 + q2;
            c[1] = u1 + z1, d[1] = v1 - w1;
            c[2] = u2 + z2, d[2] = v2 - w2;
            c[3] = u2 - z2, d[3] = v2 + w2;
            c[4] = u1 - z1, d[4] = v1 + w1;
        }
        for (Index k = 0; k < Radix; ++k) {
            const float cosine = turn[2 * k], sine = turn[2 * k + 1];
            out[k * step + re + l] = c[k] * cosine - d[k] * sine;
            out[k * step + im + l] = c[k] * sine + d[k] * cosine;
        }
    }
}

// `Left` transforms of Radix × Width points have been put side by side by the steps before.
template <Index Radix, Index Left, Index Lanes>
void step(const float *in, float *out, Index count, Index re, Index im, const Circle &circle) {
    constexpr Index WIDTH = CELLS / (Radix * Left);
    const Index point = 2 * Lanes * count;
    for (Index p = 0; p < WIDTH; ++p) {
        float turn[2 * Radix];
        for (Index k = 0; k < Radix; ++k) {
            turn[2 * k] = circle.turn[2 * (p * k * Left % CELLS)];
            turn[2 * k + 1] = circle.turn[2 * (p * k * Left % CELLS) + 1];
        }
        for (Index q = 0; q < Left; ++q)
            for (Index b = 0; b < count; ++b)
                butterflies<Radix, Lanes>(in + (q + Left * p) * point + 2 * Lanes * b, Left * WIDTH * point,
                                          out + (q + Left * Radix * p) * point + 2 * Lanes * b, Left * point, turn, re,
                                          im);
    }
}

// Transform CELLS points in place.
template <Index Lanes> void line(float *data, float *room, Index count, Index re, Index im, const Circle &circle) {
    static_assert(CELLS == 4 * 5 * 2, "the steps below are those of 40 points");
    step<4, 1, Lanes>(data, room, count, re, im, circle);
    step<5, 4, Lanes>(room, data, count, re, im, circle);
    step<2, 20, Lanes>(data, room, count, re, im, circle);
    const Index size = CELLS * 2 * Lanes * count;
    for (Index k = 0; k < size; ++k) data[k] = room[k];
}

template <Index Lanes> void plane(float *data, float *room, bool inverse, const Circle &circle) {
    const Index re = inverse ? Lanes : 0, im = inverse ? 0 : Lanes;
    for (Index i = 0; i < CELLS; ++i) line<Lanes>(data + i * CELLS * 2 * Lanes, room, 1, re, im, circle);
    line<Lanes>(data, room, CELLS, re, im, circle);
}

void plane(float *data, Index channels, float *room, bool inverse, const Circle &circle) {
    if (channels == COLOUR_CHANNELS)
        plane<COLOUR_CHANNELS / 2>(data, room, inverse, circle);
    else
        plane<GRAY_CHANNELS / 2>(data, room, inverse, circle);
}

// Tell two real channels apart in the transform of the complex one that they made.
void unpack(const float *data, Index channels, float *HS_RESTRICT spectrum) {
    const Index lanes = channels / 2;
    for (Index y = 0; y < CELLS; ++y)
        for (Index x = 0; x < HALF; ++x) {
            const float *p = data + (y * CELLS + x) * channels;
            const float *q = data + ((CELLS - y) % CELLS * CELLS + (CELLS - x) % CELLS) * channels;
            float *HS_RESTRICT out = spectrum + (y * HALF + x) * 2 * channels;
#pragma omp simd
            for (Index l = 0; l < lanes; ++l) {
                out[l] = 0.5f * (p[l] + q[l]);
                out[lanes + l] = 0.5f * (p[lanes + l] + q[lanes + l]);
                out[channels + l] = 0.5f * (p[lanes + l] - q[lanes + l]);
                out[channels + lanes + l] = 0.5f * (q[l] - p[l]);
            }
        }
}

void pack(const float *spectrum, Index channels, float *data) {
    const Index lanes = channels / 2;
    for (Index y = 0; y < CELLS; ++y)
        for (Index x = 0; x < HALF; ++x) {
            const float *HS_RESTRICT in = spectrum + (y * HALF + x) * 2 * channels;
            float *HS_RESTRICT p = data + (y * CELLS + x) * channels;
            float *HS_RESTRICT q = data + ((CELLS - y) % CELLS * CELLS + (CELLS - x) % CELLS) * channels;
            const bool twice = x > 0 && x < CELLS / 2; // other columns hold both of a pair already
            for (Index l = 0; l < lanes; ++l) {
                p[l] = in[l] - in[channels + lanes + l];
                p[lanes + l] = in[channels + l] + in[lanes + l];
            }
            if (!twice) continue;
            for (Index l = 0; l < lanes; ++l) {
                q[l] = in[l] + in[channels + lanes + l];
                q[lanes + l] = in[lanes + l] - in[channels + l];
            }
        }
}

void transform(const float *features, Index channels, const Circle &circle, float *room, float *spectrum) {
    const Index size = CELLS * CELLS * channels;
    float *data = room, *rest = room + size;
    for (Index k = 0; k < size; ++k) data[k] = features[k];
    plane(data, channels, rest, false, circle);
    unpack(data, channels, spectrum);
}

// ---- the filter ----

// Sum over the channels of conj(a) b.
static inline void inner(const float *HS_RESTRICT a, const float *HS_RESTRICT b, Index channels, float *re, float *im) {
    // Eight sums, as all levels can add them up in the same order.
    float real[8] = {}, imaginary[8] = {};
    for (Index c = 0; c < channels; c += 8)
        for (Index l = 0; l < 8; ++l) {
            const Index k = c + l, m = channels + k;
            real[l] += a[k] * b[k] + a[m] * b[m];
            imaginary[l] += a[k] * b[m] - a[m] * b[k];
        }
    *re = ((real[0] + real[4]) + (real[1] + real[5])) + ((real[2] + real[6]) + (real[3] + real[7]));
    *im = ((imaginary[0] + imaginary[4]) + (imaginary[1] + imaginary[5])) +
          ((imaginary[2] + imaginary[6]) + (imaginary[3] + imaginary[7]));
}

// The filter F minimises, with ⋆ a correlation, over all samples
//     mean |Σ F ⋆ x − target|² + penalty |F|² + memory |F − old|²
// by alternating directions: F itself, G that bears the penalty, H that makes them equal with a coupling that grows.
void adapt(const float *spectrum, const float *target, const float *penalty, const float *old, Index channels,
           const Learning &learning, const Circle &circle, float *room, float *filter) {
    constexpr Index BINS = CELLS * HALF;
    constexpr float SHARE = 1.0f / (CELLS * CELLS);
    const Index both = 2 * channels, size = BINS * both;
    float *power = room, *sum = power + BINS, *g = sum + both, *h = g + size, *data = h + size;
    float *rest = data + CELLS * CELLS * channels;
    for (Index k = 0; k < BINS; ++k) {
        float nothing;
        inner(spectrum + k * both, spectrum + k * both, channels, power + k, &nothing);
    }
    const float memory = old ? learning.memory : 0.0f;
    float coupling = learning.coupling;
    for (int round = 0;; ++round) {
        const float weight = memory + coupling, part = 1.0f / weight;
        for (Index k = 0; k < BINS; ++k) {
            const float *HS_RESTRICT x = spectrum + k * both;
            float *HS_RESTRICT f = filter + k * both;
            const float wanted = target[k] * SHARE;
#pragma omp simd
            for (Index c = 0; c < both; ++c) sum[c] = x[c] * wanted;
            if (old) {
                const float *HS_RESTRICT before = old + k * both;
#pragma omp simd
                for (Index c = 0; c < both; ++c) sum[c] += memory * before[c];
            }
            if (round) {
                const float *HS_RESTRICT p = g + k * both, *HS_RESTRICT q = h + k * both;
#pragma omp simd
                for (Index c = 0; c < both; ++c) sum[c] += coupling * (p[c] - q[c]);
            }
            // (x xᴴ + weight) F = sum, by Sherman and Morrison.
            float re, im;
            inner(x, sum, channels, &re, &im);
            const float factor = SHARE / (weight + power[k] * SHARE);
            re *= factor, im *= factor;
#pragma omp simd
            for (Index c = 0; c < channels; ++c) {
                f[c] = (sum[c] - (x[c] * re - x[channels + c] * im)) * part;
                f[channels + c] = (sum[channels + c] - (x[c] * im + x[channels + c] * re)) * part;
            }
        }
        if (round + 1 >= learning.rounds) return;
        for (Index k = 0; k < size; ++k) {
            h[k] = round ? h[k] + filter[k] : filter[k];
            g[k] = h[k];
        }
        pack(g, channels, data);
        plane(data, channels, rest, true, circle);
        for (Index k = 0; k < CELLS * CELLS; ++k) {
            const float kept = coupling / (penalty[k] + coupling) * SHARE;
            for (Index c = 0; c < channels; ++c) data[k * channels + c] *= kept;
        }
        plane(data, channels, rest, false, circle);
        unpack(data, channels, g);
        for (Index k = 0; k < size; ++k) h[k] = (h[k] - g[k]) / learning.growth;
        coupling *= learning.growth;
    }
}

void respond(const float *filter, const float *witness, const float *spectrum, Index channels, const Circle &circle,
             float *room, float *spectra, float *responses) {
    for (Index k = 0; k < CELLS * HALF; ++k) {
        const float *own = spectrum + k * 2 * channels;
        inner(filter + k * 2 * channels, own, channels, spectra + 4 * k, spectra + 4 * k + 2);
        inner(witness + k * 2 * channels, own, channels, spectra + 4 * k + 1, spectra + 4 * k + 3);
    }
    pack(spectra, 2, responses);
    plane<1>(responses, room, true, circle);
    for (Index k = 0; k < 2 * CELLS * CELLS; ++k) responses[k] *= 1.0f / (CELLS * CELLS);
}

} // namespace

extern const FinderKernels HS_JOIN(finder, HS_LEVEL) = {describe_room, describe, shade, transform, adapt, respond};

} // namespace hs
