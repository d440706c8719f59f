#include "memory.hpp"

#include "colour.hpp"
#include "room.hpp"
#include "shapes.hpp"
#include "sums.hpp"

#include <cmath>
#include <cstring>

namespace hs {
namespace HS_LEVEL {
namespace {

constexpr Index CHUNK = 64;          // pixels at a time: results first go to short arrays, which overlap with nothing
constexpr Index MOST_SAMPLES = 2000; // pixels that tell the noise
constexpr Index THINNED = 7;         // one in so many pixels of a row, another one in the next

void unite(Index pixels, const Byte *HS_RESTRICT a, const Byte *HS_RESTRICT b, Byte *HS_RESTRICT out) {
    for (Index i = 0; i < pixels; ++i) out[i] = a[i] | b[i];
}

void add_foreign(Index pixels, const Byte *HS_RESTRICT foreign, Byte *HS_RESTRICT near) {
    for (Index i = 0; i < pixels; ++i) {
        const Byte elsewhere = static_cast<Byte>(foreign[i] & (near[i] ^ 1));
        near[i] = static_cast<Byte>(near[i] + elsewhere + elsewhere);
    }
}

// 1 within two pixels of the object, where it is or was expected, and 2 on a distractor elsewhere: a second mover is
// neither ground to be learned nor noise.
void surround(Size size, const Lesson &what, Byte *either, Byte *held, Byte *near) {
    const Index pixels = size.height * size.width;
    unite(pixels, what.mask, what.own, either);
    widen(size, either, 2, held, near);
    if (what.foreign) add_foreign(pixels, what.foreign, near);
}

// Pixels that are learned at a time, and how fast the images move there. Their number is CHUNK, or in the last one
// `rest`.
struct Chunk {
    Index begin, rest;
    float object_rate[CHUNK], ground_rate[CHUNK];
    std::int32_t mask[CHUNK], covered[CHUNK], inside[CHUNK], near[CHUNK]; // of the masks' bytes
};

template <Index Count> void widen_bytes(const Byte *mask, const Chunk &chunk, std::int32_t *out) {
    const Index count = Count ? Count : chunk.rest;
    const Byte *HS_RESTRICT in = mask + chunk.begin;
    for (Index i = 0; i < count; ++i) out[i] = in[i];
}

// 1 in a rectangle of a window.
void draw(Size size, const Rectangle &where, Byte *mask) {
    std::memset(mask, 0, static_cast<std::size_t>(size.height * size.width));
    for (Index y = where.top; y < where.bottom; ++y)
        std::memset(mask + y * size.width + where.left, 1, static_cast<std::size_t>(where.right - where.left));
}

// Log-odds, shape, and how fast the object layer is learned: at once where it is not known (`covered`), and where
// something is in front of the object only where the background surely is not seen.
template <Index Count> void learn_object(const Lesson &what, Index pixels, Chunk *chunk, const Memory &memory) {
    const Index begin = chunk->begin, count = Count ? Count : chunk->rest;
    const float *HS_RESTRICT warped = what.expected.odds + begin, *HS_RESTRICT odds = what.odds + begin;
    const float *HS_RESTRICT raw = what.raw + begin, *HS_RESTRICT old = what.expected.shape + begin;
    const float *HS_RESTRICT object = what.expected.image + CHANNELS * begin;
    const float *HS_RESTRICT image = what.image + CHANNELS * begin, *HS_RESTRICT ratio = what.evidence + begin;
    const float *HS_RESTRICT error = ratio + pixels;
    const std::int32_t *mask = chunk->mask, *covered = chunk->covered;
    float *HS_RESTRICT rates = chunk->object_rate, *HS_RESTRICT odds_out = memory.odds + begin;
    float *HS_RESTRICT shape_out = memory.shape + begin;
    const float shape_rate = what.freeze ? 0.0f : what.shape_rate, free = what.freeze ? 0.0f : 1.0f;
    const float least = what.hidden ? 4.0f : -1.0f; // errors are positive
#pragma omp simd
    for (Index i = 0; i < count; ++i) {
        const bool own = mask[i] != 0;
        const float s = warped[i], belief = odds[i];
        const float next = own ? larger(raw[i], 0.2f) : s + 0.5f * (belief - s);
        odds_out[i] = smaller(larger(next, -3.0f), 4.0f);
        const float target = own ? smaller(larger(belief + 0.5f, 0.0f), 1.0f) : 0.0f;
        shape_out[i] = old[i] + shape_rate * (target - old[i]);
        const float d = (image[3 * i] - object[3 * i]) + (image[3 * i + 1] - object[3 * i + 1]) +
                        (image[3 * i + 2] - object[3 * i + 2]);
        // What has lit up that much is rather a highlight that moves on than the surface.
        const float rate = d < 75.0f ? 0.5f : 0.1f;
        const bool sure = (ratio[i] > -0.3f) & (error[i] >= least);
        const float wanted = own ? (sure ? rate : 0.0f) : free;
        rates[i] = covered[i] != 0 ? wanted : 1.0f;
    }
}

// An image moved towards another by a rate for each pixel.
template <Index Count>
void move_image(const float *from, const float *to, const float *rates, const Chunk &chunk, float *out) {
    const Index count = Count ? Count : chunk.rest;
    const float *HS_RESTRICT a = from + CHANNELS * chunk.begin, *HS_RESTRICT b = to + CHANNELS * chunk.begin;
    float *HS_RESTRICT result = out + CHANNELS * chunk.begin;
    float each[CHANNELS * CHUNK];
    for (Index i = 0; i < count; ++i) each[3 * i] = each[3 * i + 1] = each[3 * i + 2] = rates[i];
    for (Index i = 0; i < CHANNELS * count; ++i) result[i] = a[i] + each[i] * (b[i] - a[i]);
}

// Counts of the background, and how fast its image is learned; counts what is known there and what is unexplained.
template <Index Count>
void learn_ground(const Lesson &what, Index pixels, Chunk *chunk, const Memory &memory, Fit *fit) {
    const Index begin = chunk->begin, count = Count ? Count : chunk->rest;
    const float *HS_RESTRICT samples = what.ground.counts + begin, *HS_RESTRICT misses = samples + pixels;
    const float *HS_RESTRICT age = samples + 2 * pixels;
    const float *HS_RESTRICT errors = what.evidence + pixels + begin, *HS_RESTRICT gains = errors + pixels;
    const float *HS_RESTRICT changes = gains + pixels, *HS_RESTRICT odds = what.odds + begin;
    const std::int32_t *mask = chunk->mask, *near = chunk->near, *inside = chunk->inside;
    float *HS_RESTRICT rates = chunk->ground_rate, *HS_RESTRICT samples_out = memory.counts + begin;
    float *HS_RESTRICT misses_out = samples_out + pixels, *HS_RESTRICT age_out = misses_out + pixels;
    int known = 0, strange = 0;
#pragma omp simd reduction(+ : known, strange)
    for (Index i = 0; i < count; ++i) {
        const float n = samples[i], bad = misses[i], error = errors[i], gain = gains[i];
        const bool here = inside[i] != 0, free = near[i] != 1;
        const bool learned = here & free & (odds[i] < -1.0f);
        const bool matched = (mask[i] == 0) & (error < 4.0f) & (n >= KNOWN);
        const float ticks = matched ? 0.0f : age[i] + 1.0f;
        age_out[i] = here ? ticks : age[i];
        const bool counted = here & free & (n >= KNOWN);
        known += counted ? 1 : 0;
        strange += counted & (error > 5.0f) ? 1 : 0;
        // Something moves here: begin again.
        float base = (n < KNOWN) & (changes[i] >= 4.0f) ? 0.0f : n;
        const bool odd = (base >= KNOWN) & (error >= 6.0f);
        const float worse = odd ? bad + 1.0f : 0.0f;
        misses_out[i] = learned ? worse : bad;
        const bool shaded = (gain < 0.93f) | (gain > 1.07f);
        const bool wait = odd & ((worse < 6.0f) | ((worse < 25.0f) & shaded));
        base = odd ? 0.0f : base;
        const bool dark = (base >= KNOWN) & (gain <= 0.93f);
        base = (base >= KNOWN) & (gain > 1.07f) ? 0.0f : base;
        float rate = larger(1.0f / (base + 1.0f), 0.06f);
        rate = (base >= KNOWN) & (gain < 0.985f) ? smaller(rate, 0.02f) : rate;
        const bool taken = learned & !wait & !dark;
        rates[i] = taken ? rate : 0.0f;
        samples_out[i] = taken ? smaller(base + 1.0f, 20.0f) : n;
    }
    fit->known += known;
    fit->strange += strange;
}

// Masks for the time of a call.
struct Masks {
    Byte *near, *covered, *inside;
};

template <Index Count>
void learn_chunk(const Lesson &what, Index pixels, const Masks &masks, Chunk *chunk, const Memory &out, Fit *fit) {
    widen_bytes<Count>(what.mask, *chunk, chunk->mask);
    widen_bytes<Count>(masks.covered, *chunk, chunk->covered);
    widen_bytes<Count>(masks.inside, *chunk, chunk->inside);
    widen_bytes<Count>(masks.near, *chunk, chunk->near);
    learn_object<Count>(what, pixels, chunk, out);
    move_image<Count>(what.expected.image, what.image, chunk->object_rate, *chunk, out.object);
    learn_ground<Count>(what, pixels, chunk, out, fit);
    move_image<Count>(what.ground.image, what.aligned, chunk->ground_rate, *chunk, out.ground);
}

// Differences from the background on some pixels of a row, in shadow by what the shadow leaves unexplained; how many
// there are now.
Index sample_noise(const Lesson &what, Size size, const Byte *near, Index y, Index taken, float *sample) {
    const Index pixels = size.height * size.width, begin = y * size.width, left = what.inside.left;
    const float *gains = what.evidence + 2 * pixels;
    for (Index x = left + (THINNED - (left + 2 * y) % THINNED) % THINNED; x < what.inside.right; x += THINNED) {
        const Index i = begin + x;
        if (near[i] != 0 || what.ground.counts[i] < KNOWN || taken >= MOST_SAMPLES) continue;
        const float gain = gains[i], light = gain < 0.9f || gain > 1.1f ? gain : 1.0f;
        float d = 0.0f;
        for (Index k = CHANNELS * i; k < CHANNELS * (i + 1); ++k)
            d += std::fabs(what.aligned[k] - light * what.ground.image[k]);
        sample[taken++] = d;
    }
    return taken;
}

// Colours of object and background, of every second pixel.
void count_colours(const Lesson &what, Size size, const Byte *near, float *tally) {
    for (Index i = 0; i < 2 * BINS; ++i) tally[i] = 0.0f;
    const Rectangle &inside = what.inside;
    for (Index y = inside.top; y < inside.bottom; ++y)
        for (Index x = inside.left + (inside.left + y) % 2; x < inside.right; x += 2) {
            const Index i = y * size.width + x, bin = what.bins[i] & (BINS - 1);
            if (near[i] != 1)
                tally[BINS + bin] += 1.0f;
            else if (what.mask[i] != 0 && what.odds[i] > 1.0f)
                tally[bin] += 1.0f;
        }
}

} // namespace

Fit learn(Size size, const Lesson &what, const Memory &out) {
    const Index pixels = size.height * size.width;
    const Room<Byte> room(3 * pixels);
    const Masks masks{room.get(), room.get() + pixels, room.get() + 2 * pixels};
    surround(size, what, masks.covered, masks.inside, masks.near);
    draw(size, what.part, masks.covered);
    draw(size, what.inside, masks.inside);
    Fit fit{0, 0, -1.0};
    Chunk chunk;
    for (chunk.begin = 0; chunk.begin < pixels; chunk.begin += CHUNK) {
        chunk.rest = pixels - chunk.begin;
        if (chunk.rest >= CHUNK)
            learn_chunk<CHUNK>(what, pixels, masks, &chunk, out, &fit);
        else
            learn_chunk<0>(what, pixels, masks, &chunk, out, &fit);
    }
    float sample[MOST_SAMPLES], tally[2 * BINS];
    Index taken = 0;
    for (Index y = what.inside.top; y < what.inside.bottom; ++y)
        taken = sample_noise(what, size, masks.near, y, taken, sample);
    count_colours(what, size, masks.near, tally);
    blend(what.colours, tally, what.colour_rate, out.colours);
    if (taken > 10) fit.spread = select(sample, taken, 0.85) / 3.0;
    return fit;
}

} // namespace HS_LEVEL
} // namespace hs
