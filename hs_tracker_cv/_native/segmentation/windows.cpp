#include "windows.hpp"

#include "room.hpp"
#include "shapes.hpp"

#include <cmath>
#include <cstring>

namespace hs {
namespace HS_LEVEL {
namespace {

constexpr Index CHUNK = 64;    // pixels of a row at a time
constexpr float NEVER = -3.0f; // log-odds where nothing is known of the object

inline void fill(float *out, Index count, float value) {
    for (Index i = 0; i < count; ++i) out[i] = value;
}

// Where a bilinear sample is: its upper left pixel and the parts of one beyond it.
struct Spot {
    Index at;
    float right, down;
};

inline float between(const float *p, Index step, Index stride, const Spot &spot) {
    const float a = p[0] + spot.right * (p[step] - p[0]);
    const float b = p[stride] + spot.right * (p[stride + step] - p[stride]);
    return a + spot.down * (b - a);
}

inline void between_all(const float *image, Index width, const Spot &spot, float *out) {
    const float *p = image + CHANNELS * spot.at;
    for (Index c = 0; c < CHANNELS; ++c) out[c] = between(p + c, CHANNELS, CHANNELS * width, spot);
}

// Columns of a row of `to` that have a counterpart in a row of the source, from first to last.
struct Span {
    Index first, last;
};

inline Span overlap(Index width, Index dx, bool there, Index to) {
    const Index first = there ? smaller(larger<Index>(-dx, 0), to) : to;
    return {first, larger(smaller(width - dx, to), first)};
}

// Begin the background anew at some pixels.
void renew(Index first, Index last, const float *image, const float *odds, float *picture, float *counts) {
    for (Index i = first; i < last; ++i) {
        counts[i] = odds[i] < -1.0f ? KNOWN : 0.0f;
        for (Index c = CHANNELS * i; c < CHANNELS * (i + 1); ++c) picture[c] = image[c];
    }
}

// One pixel of `resample` near or beyond the border: what lies outside is `fill`.
void sample_border(Size from, Index channels, const float *image, float px, float py, float fill, float *out) {
    const Index w = from.width, h = from.height;
    const Index ix = static_cast<Index>(px + 1.0f) - 1, iy = static_cast<Index>(py + 1.0f) - 1;
    const float fx = px - static_cast<float>(ix), fy = py - static_cast<float>(iy);
    const float left = ix >= 0 ? 1.0f - fx : 0.0f, right = ix + 1 < w ? fx : 0.0f;
    const float top = iy >= 0 ? 1.0f - fy : 0.0f, bottom = iy + 1 < h ? fy : 0.0f;
    const Index x0 = larger<Index>(ix, 0), x1 = smaller(ix + 1, w - 1);
    const Index y0 = larger<Index>(iy, 0), y1 = smaller(iy + 1, h - 1);
    const float beyond = fill * (1.0f - (left + right) * (top + bottom));
    const float *upper = image + y0 * w * channels, *lower = image + y1 * w * channels;
    for (Index c = 0; c < channels; ++c) {
        const float above = left * upper[x0 * channels + c] + right * upper[x1 * channels + c];
        const float below = left * lower[x0 * channels + c] + right * lower[x1 * channels + c];
        out[c] = top * above + bottom * below + beyond;
    }
}

} // namespace

void smooth(Size size, Index channels, const float *pixels, const float *taps, float *image, float *gray) {
    const Index w = size.width, length = (w + 4) * channels;
    const float a = taps[0], b = taps[1], c = taps[2];
    const Room<float> room(length);
    float *HS_RESTRICT line = room.get();
    for (Index y = 0; y < size.height; ++y) {
        const float *HS_RESTRICT in = pixels + y * length;
        for (Index i = 0; i < length; ++i)
            line[i] =
                a * in[2 * length + i] + b * (in[length + i] + in[3 * length + i]) + c * (in[i] + in[4 * length + i]);
        float *HS_RESTRICT out = image + y * w * CHANNELS, *HS_RESTRICT mean = gray + y * w;
        if (channels == 1) {
            for (Index x = 0; x < w; ++x)
                mean[x] = a * line[x + 2] + b * (line[x + 1] + line[x + 3]) + c * (line[x] + line[x + 4]);
            for (Index x = 0; x < w; ++x) out[3 * x] = out[3 * x + 1] = out[3 * x + 2] = mean[x];
        } else {
            for (Index i = 0; i < 3 * w; ++i)
                out[i] = a * line[i + 6] + b * (line[i + 3] + line[i + 9]) + c * (line[i] + line[i + 12]);
            for (Index x = 0; x < w; ++x)
                mean[x] = 0.114f * out[3 * x] + 0.587f * out[3 * x + 1] + 0.299f * out[3 * x + 2];
        }
    }
}

void shift(Size from, const float *source, Index dx, Index dy, float fill_value, Size to, float *out) {
    for (Index y = 0; y < to.height; ++y) {
        const Index row = y + dy;
        const Span span = overlap(from.width, dx, row >= 0 && row < from.height, to.width);
        float *result = out + y * to.width;
        fill(result, span.first, fill_value);
        if (span.last > span.first)
            std::memcpy(result + span.first, source + row * from.width + span.first + dx,
                        (span.last - span.first) * sizeof(float));
        fill(result + span.last, to.width - span.last, fill_value);
    }
}

void move_ground(Size from, const Ground &ground, Index dx, Index dy, float gain, Size to, const float *image,
                 const float *odds, float *picture, float *counts) {
    const Size wide{from.height, CHANNELS * from.width}, wide_out{to.height, CHANNELS * to.width};
    shift(wide, ground.image, CHANNELS * dx, dy, 0.0f, wide_out, picture);
    for (Index i = 0; i < 3; ++i)
        shift(from, ground.counts + i * from.height * from.width, dx, dy, 0.0f, to, counts + i * to.height * to.width);
    for (Index y = 0; y < to.height; ++y) {
        const Index begin = y * to.width;
        if (gain != 1.0f)
            for (Index i = CHANNELS * begin; i < CHANNELS * (begin + to.width); ++i) picture[i] *= gain;
        const Span span = overlap(from.width, dx, y + dy >= 0 && y + dy < from.height, to.width);
        renew(begin, begin + span.first, image, odds, picture, counts);
        renew(begin + span.last, begin + to.width, image, odds, picture, counts);
    }
}

void resample(Size from, Index channels, const float *image, const double *inverse, bool repeat, float fill_value,
              Size to, float *out) {
    const Index w = from.width, h = from.height;
    const auto right = static_cast<float>(w - 1), bottom = static_cast<float>(h - 1);
    const auto step_x = static_cast<float>(inverse[0]), step_y = static_cast<float>(inverse[3]);
    for (Index y = 0; y < to.height; ++y) {
        const auto row = static_cast<double>(y);
        const auto start_x = static_cast<float>(inverse[1] * row + inverse[2]);
        const auto start_y = static_cast<float>(inverse[4] * row + inverse[5]);
        float *result = out + y * to.width * channels;
        for (Index x = 0; x < to.width; ++x, result += channels) {
            float px = start_x + step_x * static_cast<float>(x), py = start_y + step_y * static_cast<float>(x);
            if (repeat) {
                px = smaller(larger(px, 0.0f), right);
                py = smaller(larger(py, 0.0f), bottom);
            } else if (!(px > -1.0f && py > -1.0f && px < right + 1.0f && py < bottom + 1.0f)) {
                fill(result, channels, fill_value);
                continue;
            }
            const Index ix = static_cast<Index>(px + 1.0f) - 1, iy = static_cast<Index>(py + 1.0f) - 1;
            if (ix < 0 || iy < 0 || ix + 1 >= w || iy + 1 >= h) {
                sample_border(from, channels, image, px, py, fill_value, result);
                continue;
            }
            const Spot spot{iy * w + ix, px - static_cast<float>(ix), py - static_cast<float>(iy)};
            const float *p = image + spot.at * channels;
            for (Index c = 0; c < channels; ++c) result[c] = between(p + c, channels, channels * w, spot);
        }
    }
}

void without_object(Size size, const float *image, const float *odds, Index dx, Index dy, float sure, float fill_value,
                    float *out) {
    const Index w = size.width;
    std::memcpy(out, image, CHANNELS * size.height * w * sizeof(float));
    for (Index y = 0; y < size.height; ++y) {
        const Index row = y + dy;
        const Span span = overlap(w, dx, row >= 0 && row < size.height, w);
        const float *before = odds + row * w + dx;
        for (Index x = span.first; x < span.last; ++x)
            if (before[x] > sure) fill(out + CHANNELS * (y * w + x), CHANNELS, fill_value);
    }
}

namespace {

// Where the pixels of a part of a row come from; `cover` is how much of a pixel is in the window.
struct Spots {
    std::int32_t at[CHUNK];
    float right[CHUNK], down[CHUNK], cover[CHUNK];
};

void find_spots(Size size, const double *inverse, Index y, Index first, Index count, Spots *spots) {
    const auto right = static_cast<float>(size.width - 1), bottom = static_cast<float>(size.height - 1);
    const auto most_x = static_cast<std::int32_t>(size.width - 2), most_y = static_cast<std::int32_t>(size.height - 2);
    const auto step_x = static_cast<float>(inverse[0]), step_y = static_cast<float>(inverse[3]);
    const auto start_x = static_cast<float>(inverse[1] * static_cast<double>(y) + inverse[2]);
    const auto start_y = static_cast<float>(inverse[4] * static_cast<double>(y) + inverse[5]);
    const auto begin = static_cast<std::int32_t>(first), width = static_cast<std::int32_t>(size.width);
    Spots &out = *spots;
#pragma omp simd
    for (std::int32_t i = 0; i < static_cast<std::int32_t>(count); ++i) {
        const auto x = static_cast<float>(begin + i);
        const float wanted_x = start_x + step_x * x, wanted_y = start_y + step_y * x;
        const float px = smaller(larger(wanted_x, 0.0f), right), py = smaller(larger(wanted_y, 0.0f), bottom);
        const std::int32_t whole_x = static_cast<std::int32_t>(px), whole_y = static_cast<std::int32_t>(py);
        const std::int32_t ix = smaller(whole_x, most_x), iy = smaller(whole_y, most_y);
        out.at[i] = iy * width + ix;
        out.right[i] = px - static_cast<float>(ix);
        out.down[i] = py - static_cast<float>(iy);
        // What lies beyond the border by a part of a pixel is partly there.
        out.cover[i] = larger(1.0f - std::fabs(wanted_x - px), 0.0f) * larger(1.0f - std::fabs(wanted_y - py), 0.0f);
    }
}

// A plane at these spots, `beyond` outside.
void carry_plane(const float *plane, Index width, const Spots &spots, Index count, float beyond, float *result) {
    const float *HS_RESTRICT p = plane, *HS_RESTRICT q = plane + width;
    float *HS_RESTRICT out = result;
#pragma omp simd
    for (Index i = 0; i < count; ++i) {
        const std::int32_t at = spots.at[i];
        const float a = p[at] + spots.right[i] * (p[at + 1] - p[at]);
        const float b = q[at] + spots.right[i] * (q[at + 1] - q[at]);
        out[i] = spots.cover[i] * (a + spots.down[i] * (b - a) - beyond) + beyond;
    }
}

void carry_image(const float *image, Index width, const Spots &spots, Index count, float *result) {
    for (Index i = 0; i < count; ++i)
        between_all(image, width, {spots.at[i], spots.right[i], spots.down[i]}, result + CHANNELS * i);
}

// The last frame, where the background is not yet known.
void carry_unknown(const float *image, Index width, const float *counts, const Spots &spots, Index count,
                   float *result) {
    for (Index i = 0; i < count; ++i)
        if (counts[i] < KNOWN)
            between_all(image, width, {spots.at[i], spots.right[i], spots.down[i]}, result + CHANNELS * i);
}

} // namespace

void carry(Size size, const Object &object, const float *counts, const double *inverse, const Rectangle &part,
           bool everywhere, const MovedObject &out) {
    const Index w = size.width, pixels = size.height * w;
    fill(out.odds, pixels, NEVER);
    fill(out.shape, pixels, 0.0f);
    fill(out.image, CHANNELS * pixels, 0.0f);
    fill(out.previous, CHANNELS * pixels, 0.0f);
    Spots spots;
    for (Index y = part.top; y < part.bottom; ++y)
        for (Index first = part.left; first < part.right; first += CHUNK) {
            const Index count = smaller(part.right - first, CHUNK), at = y * w + first;
            find_spots(size, inverse, y, first, count, &spots);
            carry_plane(object.odds, w, spots, count, NEVER, out.odds + at);
            carry_plane(object.shape, w, spots, count, 0.0f, out.shape + at);
            carry_image(object.image, w, spots, count, out.image + CHANNELS * at);
            if (everywhere)
                carry_image(object.previous, w, spots, count, out.previous + CHANNELS * at);
            else
                carry_unknown(object.previous, w, counts + at, spots, count, out.previous + CHANNELS * at);
        }
    threshold(pixels, out.odds, out.own);
}

} // namespace HS_LEVEL
} // namespace hs
