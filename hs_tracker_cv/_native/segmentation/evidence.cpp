#include "evidence.hpp"

#include "room.hpp"

#include <cstdlib>
#include <cstring>

namespace hs {
namespace HS_LEVEL {
namespace {

constexpr Index SPAN = 5;       // rows and columns of the sums
constexpr float FLAT = 1250.0f; // gray levels² times pixels: what keeps the gain of a dark area near one
constexpr float THIRD = 1.0f / 3.0f;
constexpr float NOTHING = 1e9f; // error of an explanation that does not apply
constexpr Index CHUNK = 64;     // pixels at a time: results first go to short arrays, which overlap with nothing

// What a layer's rows need: products of the last five rows, in turn, their sums, the squared gradient.
struct Rows {
    float *crossed[SPAN], *squared[SPAN]; // image · layer, layer · layer
    float *crossed_sum, *squared_sum;     // from column -2 on
    float *slope;
};

// Channel sums of image · layer and layer · layer along a row.
void products(const float *image, const float *layer, Index width, float *crossed, float *squared) {
    const float *HS_RESTRICT a = image, *HS_RESTRICT b = layer;
    float *HS_RESTRICT ab = crossed, *HS_RESTRICT bb = squared;
    for (Index x = 0; x < width; ++x) {
        const float b0 = b[3 * x], b1 = b[3 * x + 1], b2 = b[3 * x + 2];
        ab[x] = a[3 * x] * b0 + a[3 * x + 1] * b1 + a[3 * x + 2] * b2;
        bb[x] = b0 * b0 + b1 * b1 + b2 * b2;
    }
}

void squares(const float *image, Index width, float *square) {
    const float *HS_RESTRICT a = image;
    float *HS_RESTRICT out = square;
    for (Index x = 0; x < width; ++x)
        out[x] = a[3 * x] * a[3 * x] + a[3 * x + 1] * a[3 * x + 1] + a[3 * x + 2] * a[3 * x + 2];
}

inline float square_sum(const float *a, const float *b) {
    const float d0 = a[0] - b[0], d1 = a[1] - b[1], d2 = a[2] - b[2];
    return d0 * d0 + d1 * d1 + d2 * d2;
}

// Mean over the channels of the squared gradient along a row.
void slopes(const float *layer, Size size, Index y, float *slope) {
    constexpr float UNIT = THIRD * 0.25f; // (difference over two pixels)² is four times the gradient squared
    const Index stride = CHANNELS * size.width, w = size.width;
    const float *HS_RESTRICT here = layer + y * stride;
    const float *HS_RESTRICT up = y > 0 ? here - stride : here;
    const float *HS_RESTRICT down = y + 1 < size.height ? here + stride : here;
    float *HS_RESTRICT out = slope;
    for (Index x = 1; x < w - 1; ++x)
        out[x] = UNIT * square_sum(down + 3 * x, up + 3 * x) + UNIT * square_sum(here + 3 * x + 3, here + 3 * x - 3);
    out[0] = UNIT * square_sum(down, up) + UNIT * square_sum(here + 3, here);
    const Index last = 3 * (w - 1);
    out[w - 1] = UNIT * square_sum(down + last, up + last) + UNIT * square_sum(here + last, here + last - 3);
}

// Sum of five rows, reflected at the sides of the window; it has two columns more on each side.
void add_five(float *const *rows, Size size, Index y, float *sum) {
    const Index h = size.height, w = size.width;
    const float *HS_RESTRICT a = rows[std::abs(y - 2) % SPAN], *HS_RESTRICT b = rows[std::abs(y - 1) % SPAN];
    const float *HS_RESTRICT c = rows[y % SPAN], *HS_RESTRICT d = rows[(y + 1 < h ? y + 1 : h - 2) % SPAN];
    const float *HS_RESTRICT e = rows[(y + 2 < h ? y + 2 : 2 * h - y - 4) % SPAN];
    float *HS_RESTRICT out = sum;
    for (Index x = 0; x < w; ++x) out[x] = a[x] + b[x] + c[x] + d[x] + e[x];
    out[-1] = out[1];
    out[-2] = out[2];
    out[w] = out[w - 2];
    out[w + 1] = out[w - 3];
}

inline float five(const float *sum) { return sum[-2] + sum[-1] + sum[0] + sum[1] + sum[2]; }

// Numbers that stay the same for all pixels.
struct Constants {
    float unit, noise2, texture, like;
};

Constants constants(const Likelihood &how) {
    const float limit = 6.0f * how.noise + 6.0f;
    return {how.channel_weight * THIRD, how.noise * how.noise, larger(2.0f, 0.8f * how.noise), limit * limit * 3.0f};
}

// A chunk of a row, filled up to whole blocks with zeros, and what becomes of it.
struct Chunk {
    float counts[CHUNK], odds[CHUNK];
    float direct[CHUNK], ground[CHUNK], gain[CHUNK], still[CHUNK], other[CHUNK], object[CHUNK], ratio[CHUNK];
};

void load(const Explanations &seen, Index begin, Index m, Chunk *chunk) {
    std::memcpy(chunk->counts, seen.counts + begin, static_cast<std::size_t>(m) * sizeof(float));
    std::memcpy(chunk->odds, seen.odds + begin, static_cast<std::size_t>(m) * sizeof(float));
    for (Index i = m; i < whole_blocks(m); ++i) chunk->counts[i] = chunk->odds[i] = 0.0f;
    for (Index i = 0; i < CHUNK; ++i) {
        chunk->object[i] = 5.0f;
        chunk->still[i] = chunk->other[i] = NOTHING;
    }
}

// Squared errors of the last frame. Moved by the camera it explains ground that is not yet known, and outside the
// object what has changed since it was learned: light, compression, a shadow that has come to rest. Moved by the object
// it explains that where the ground is not yet known.
void last_frame(const Explanations &seen, Index begin, Index m, Chunk *chunk) {
    const float *HS_RESTRICT counts = chunk->counts, *HS_RESTRICT odds = chunk->odds;
    float *HS_RESTRICT still = chunk->still, *HS_RESTRICT other = chunk->other;
    const float *HS_RESTRICT image = seen.image + 3 * begin, *HS_RESTRICT moved = seen.moved + 3 * begin;
    const float *HS_RESTRICT carried = seen.carried + 3 * begin;
    int unknown = 0;
    for (Index i = 0; i < m; ++i) {
        const bool fresh = counts[i] < KNOWN;
        still[i] = fresh | (odds[i] <= 0.0f) ? square_sum(image + 3 * i, moved + 3 * i) : NOTHING;
        unknown += fresh;
    }
    if (unknown == 0) return; // `other` is nothing
    for (Index i = 0; i < m; ++i) {
        const float e = square_sum(image + 3 * i, carried + 3 * i);
        other[i] = counts[i] < KNOWN ? e : NOTHING;
    }
}

// Errors of the background: as it is, in shadow or in brighter light, or as the last frame was.
void explain_ground(const Rows &rows, const float *image_square, Index slot, Index first, Index blocks,
                    const Likelihood &how, const Constants &k, Chunk *chunk) {
    const float *HS_RESTRICT crossed = rows.crossed[slot] + first, *HS_RESTRICT squared = rows.squared[slot] + first;
    const float *HS_RESTRICT crossed_sum = rows.crossed_sum + first,
                             *HS_RESTRICT squared_sum = rows.squared_sum + first;
    const float *HS_RESTRICT slope = rows.slope + first, *HS_RESTRICT square = image_square + first;
    Chunk &out = *chunk;
#pragma omp simd
    for (Index i = 0; i < blocks; ++i) {
        const float ib = crossed[i], bb = squared[i], ii = square[i], grad = slope[i];
        float g = (five(crossed_sum + i) + FLAT) / (five(squared_sum + i) + FLAT);
        g = smaller(larger(g, how.ground_low), how.ground_high);
        const float var = k.noise2 * (1.0f + 1.0f / larger(out.counts[i], 1.0f)) + how.ground_slope * grad;
        const float per = k.unit / var, plain = larger(ii - 2.0f * ib + bb, 0.0f) * per;
        // A shadow leaves the texture: where there is some, to be explained that way is no accident, unless there is
        // so much noise that a dark object would do as well.
        const float lit = larger(ii - 2.0f * g * ib + g * g * bb, 0.0f);
        const float shaded = lit * per + k.texture * k.noise2 / (k.noise2 + grad);
        const float lifted = lit * k.unit / (var + 0.0025f * THIRD * bb) + 3.0f;
        float e = plain;
        e = g < 0.97f ? smaller(e, shaded) : e;
        // What was the object a moment ago has a highlight rather than brighter ground behind it.
        e = (g > 1.03f) & (out.odds[i] <= 0.0f) ? smaller(e, lifted) : e;
        const float rest = out.still[i] * k.unit / (2.0f * k.noise2 + how.ground_slope * grad);
        out.direct[i] = plain;
        out.gain[i] = g;
        out.still[i] = rest;
        out.ground[i] = smaller(e, rest);
    }
}

struct Alike {
    Index own, alike;
};

// Errors of the object: as it is, in another light, or as the last frame was where it came from.
void explain_object(const Rows &rows, const float *image_square, Index slot, Index first, Index low, Index high,
                    const Likelihood &how, const Constants &k, Chunk *chunk, Alike *count) {
    const float *HS_RESTRICT crossed = rows.crossed[slot] + first, *HS_RESTRICT squared = rows.squared[slot] + first;
    const float *HS_RESTRICT crossed_sum = rows.crossed_sum + first,
                             *HS_RESTRICT squared_sum = rows.squared_sum + first;
    const float *HS_RESTRICT slope = rows.slope + first, *HS_RESTRICT square = image_square + first;
    const int from = static_cast<int>(low), to = static_cast<int>(high);
    const int begin = from / static_cast<int>(BLOCK) * static_cast<int>(BLOCK);
    const int end = static_cast<int>(whole_blocks(high));
    Chunk &out = *chunk;
    int own = 0, alike = 0;
#pragma omp simd reduction(+ : own, alike)
    for (int i = begin; i < end; ++i) {
        const bool here = (i >= from) & (i < to);
        const float io = crossed[i], oo = squared[i], ii = square[i];
        float g = (five(crossed_sum + i) + FLAT) / (five(squared_sum + i) + FLAT);
        g = smaller(larger(g, how.object_low), how.object_high);
        const float plain = larger(ii - 2.0f * io + oo, 0.0f);
        const float lit = larger(ii - 2.0f * g * io + g * g * oo, 0.0f);
        const float grad = how.object_slope * slope[i], var = 1.5f * k.noise2 + grad;
        const float e = smaller(plain, lit + var / k.unit) * k.unit / var;
        // Where the background may be explained by the last frame, the object may be too: a plain area looks as it
        // looked a moment ago with either motion.
        const float last = out.other[i] * k.unit / (2.0f * k.noise2 + grad), s = out.odds[i];
        out.object[i] = here & (s >= -0.5f) ? smaller(e, last) : 5.0f;
        const int mine = here & (s > 0.0f), like = smaller(plain, 4.0f * lit) < k.like;
        own += mine;
        alike += mine & like;
    }
    count->own += own;
    count->alike += alike;
}

// The ratio, from the errors of both.
void weigh(Index blocks, const Likelihood &how, Chunk *chunk) {
    const float contrast = how.contrast, occluded = how.occluded;
    Chunk &out = *chunk;
#pragma omp simd
    for (Index i = 0; i < blocks; ++i) {
        const float n = out.counts[i], s = out.odds[i], e = out.ground[i], direct = out.direct[i];
        const bool known = n >= KNOWN;
        float ll = 0.5f * (smaller(e, known ? 9.0f : 4.0f) - smaller(out.object[i], 5.0f));
        const float as_ever = 0.8f * contrast * (1.0f - 0.25f * e);
        ll -= known & (e < 4.0f) ? as_ever : 0.0f;
        ll *= (contrast < 0.99f) & (ll < 0.0f) & (n < 7.0f) & (s > 0.0f) ? contrast : 1.0f;
        ll = (occluded > 0.0f) & (n > KNOWN) & (e < 2.0f) ? smaller(ll, -1.5f) : ll;
        const bool far = (s < -2.5f) & known & (direct < 2.0f); // far from the object and as ever
        out.ratio[i] = far ? 0.5f * (direct - 5.0f) : ll;
        out.ground[i] = far ? direct : e;
        out.still[i] = known ? 0.0f : out.still[i];
    }
}

void store(Size size, Index begin, Index m, const Chunk &chunk, const Evidence &out) {
    const Index pixels = size.height * size.width;
    std::memcpy(out.planes + begin, chunk.ratio, static_cast<std::size_t>(m) * sizeof(float));
    std::memcpy(out.planes + pixels + begin, chunk.ground, static_cast<std::size_t>(m) * sizeof(float));
    std::memcpy(out.planes + 2 * pixels + begin, chunk.gain, static_cast<std::size_t>(m) * sizeof(float));
    std::memcpy(out.planes + 3 * pixels + begin, chunk.still, static_cast<std::size_t>(m) * sizeof(float));
}

// Where something new covers a background that was seen a moment ago.
void find_fresh(const Explanations &seen, Size size, const Evidence &out) {
    const Index pixels = size.height * size.width;
    const float *HS_RESTRICT error = out.planes + pixels, *HS_RESTRICT samples = seen.counts;
    const float *HS_RESTRICT age = seen.counts + 2 * pixels;
    Byte *HS_RESTRICT fresh = out.fresh;
#pragma omp simd
    for (Index i = 0; i < pixels; ++i) fresh[i] = (error[i] >= 7.2f) & (samples[i] > KNOWN) & (age[i] <= 4.0f);
}

// Nothing is seen beyond the frame.
void blank(Size size, Index first, Index last, const Evidence &out) {
    const Index pixels = size.height * size.width;
    for (Index i = first; i < last; ++i) {
        out.planes[i] = -2.0f;
        out.planes[pixels + i] = 0.0f;
        out.planes[2 * pixels + i] = 1.0f;
        out.planes[3 * pixels + i] = 0.0f;
    }
}

// Take rows from a workspace.
Rows take_rows(float **room, Index width) {
    Rows rows;
    const auto next = [&] {
        float *const row = *room;
        *room += width;
        return row;
    };
    for (Index i = 0; i < SPAN; ++i) rows.crossed[i] = next();
    for (Index i = 0; i < SPAN; ++i) rows.squared[i] = next();
    rows.crossed_sum = next() + 2;
    rows.squared_sum = next() + 2;
    rows.slope = next();
    return rows;
}

} // namespace

double evidence(Size size, const Explanations &seen, const Rectangle &part, const Rectangle &inside,
                const Likelihood &how, const Evidence &out) {
    const Index h = size.height, w = size.width, stride = CHANNELS * w;
    const Index length = whole_blocks(w) + 4;
    const Room<float> memory((2 * (2 * SPAN + 3) + 1) * length);
    float *room = memory.get();
    for (Index i = 0; i < (2 * (2 * SPAN + 3) + 1) * length; ++i) room[i] = 0.0f;
    const Rows ground = take_rows(&room, length), object = take_rows(&room, length);
    float *const image_square = room;
    const Constants k = constants(how);
    Alike count{0, 0};
    for (Index ahead = 0; ahead < h + 2; ++ahead) {
        if (ahead < h) { // row r of the last five is at r % 5
            const float *image = seen.image + ahead * stride;
            products(image, seen.background + ahead * stride, w, ground.crossed[ahead % SPAN],
                     ground.squared[ahead % SPAN]);
            if (ahead >= part.top - 2 && ahead < part.bottom + 2)
                products(image, seen.object + ahead * stride, w, object.crossed[ahead % SPAN],
                         object.squared[ahead % SPAN]);
        }
        const Index y = ahead - 2, slot = y % SPAN;
        if (y < 0) continue;
        const bool touched = y >= part.top && y < part.bottom;
        const float *image = seen.image + y * stride;
        squares(image, w, image_square);
        slopes(seen.background, size, y, ground.slope);
        add_five(ground.crossed, size, y, ground.crossed_sum);
        add_five(ground.squared, size, y, ground.squared_sum);
        if (touched) {
            slopes(seen.object, size, y, object.slope);
            add_five(object.crossed, size, y, object.crossed_sum);
            add_five(object.squared, size, y, object.squared_sum);
        }
        for (Index first = 0; first < w; first += CHUNK) {
            const Index m = smaller(w - first, CHUNK), begin = y * w + first;
            Chunk chunk;
            load(seen, begin, m, &chunk);
            last_frame(seen, begin, m, &chunk);
            explain_ground(ground, image_square, slot, first, whole_blocks(m), how, k, &chunk);
            const Index low = larger<Index>(part.left - first, 0), high = smaller(part.right - first, m);
            if (touched && low < high)
                explain_object(object, image_square, slot, first, low, high, how, k, &chunk, &count);
            weigh(whole_blocks(m), how, &chunk);
            store(size, begin, m, chunk, out);
        }
        const bool within = y >= inside.top && y < inside.bottom;
        blank(size, y * w, y * w + (within ? inside.left : w), out);
        if (within) blank(size, y * w + inside.right, y * w + w, out);
    }
    find_fresh(seen, size, out);
    return static_cast<double>(count.alike) / larger<double>(static_cast<double>(count.own), 1.0);
}

} // namespace HS_LEVEL
} // namespace hs
