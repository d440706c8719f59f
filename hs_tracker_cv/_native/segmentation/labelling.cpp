#include "labelling.hpp"

#include "colour.hpp"
#include "room.hpp"
#include "shapes.hpp"

#include <cmath>
#include <cstring>

namespace hs {
namespace HS_LEVEL {
namespace {

constexpr Byte GROWN = 1, HIDING = 3; // what is new at a pixel; 2 is something else
constexpr Index MASKS = 5;

// Memory for the time of a call: masks, and the runs of one.
struct Work {
    Byte *mask[MASKS];
    Run *runs;
};

// ---- what is new ----

// Write the components that don't touch `near` and are not tiny.
void distant(Size size, const Byte *apart, const Byte *near, double smallest, Run *runs, Byte *out) {
    Index heads = 0;
    const Index count = components(size, apart, near, runs, &heads);
    for (Index i = 0; i < count; ++i) {
        const Run &head = runs[runs[i].head];
        if (head.common == 0 && head.area >= smallest)
            std::memset(out + runs[i].row * size.width + runs[i].first, 1,
                        static_cast<std::size_t>(runs[i].end - runs[i].first));
    }
}

// Whole masks: pointers that alias nothing, as loops over bytes need.
void add_common(Index pixels, const Byte *HS_RESTRICT a, const Byte *HS_RESTRICT b, Byte *HS_RESTRICT out) {
    for (Index i = 0; i < pixels; ++i) out[i] |= a[i] & b[i];
}

void remove(Index pixels, const Byte *HS_RESTRICT other, Byte *HS_RESTRICT mask) {
    for (Index i = 0; i < pixels; ++i) mask[i] &= other[i] ^ 1;
}

// The kind of what is new: the object where it has grown, or else something foreign.
void merge_kinds(Index pixels, const Byte *HS_RESTRICT fresh, const Byte *HS_RESTRICT foreign,
                 Byte *HS_RESTRICT kinds) {
    for (Index i = 0; i < pixels; ++i) kinds[i] = static_cast<Byte>((kinds[i] & fresh[i]) | (foreign[i] + foreign[i]));
}

void hide(Index pixels, const Byte *HS_RESTRICT hiding, Byte *HS_RESTRICT kinds, Byte *HS_RESTRICT foreign) {
    for (Index i = 0; i < pixels; ++i) {
        kinds[i] = hiding[i] != 0 ? HIDING : kinds[i];
        foreign[i] |= hiding[i];
    }
}

// What is new beside the distractor of the last frame is the distractor.
void join_distractor(Size size, const Byte *before, const Byte *apart, const Work &work, Byte *foreign) {
    Byte *near = work.mask[3], *held = work.mask[4];
    widen(size, before, 3, held, near);
    add_common(size.height * size.width, apart, near, foreign);
}

// Tell where the object has grown from where something else has arrived, which `foreign` shows.
//
// Only what covers a background seen a moment ago (`fresh`) counts: this excludes ghosts and lifted shadows. What is
// new within reach of the object has grown from it, unless it is too young for that. What comes out from behind
// something may be the object itself.
void arrivals(Size size, const Labelling &what, Index area, const Work &work, Byte *kinds, Byte *foreign) {
    const Index pixels = size.height * size.width;
    Byte *fresh = work.mask[1], *apart = work.mask[2], *near = work.mask[3], *held = work.mask[4];
    median(size, what.fresh, held, fresh);
    if (without(size, fresh, what.own, apart) == 0 || area == 0) return;
    widen(size, what.own, what.growth, held, near);
    const Index far = without(size, apart, near, held);
    if (far > 0) distant(size, apart, near, larger(8.0, 0.02 * static_cast<double>(area)), work.runs, foreign);
    if (what.before) join_distractor(size, what.before, apart, work, foreign);
    if (!what.young && static_cast<double>(far) < 0.03 * static_cast<double>(pixels)) {
        std::memcpy(kinds, what.own, static_cast<std::size_t>(pixels));
        remove(pixels, foreign, fresh);
        spread(size, fresh, what.growth, held, kinds);
    }
    if (what.emerging)
        for (Index i = 0; i < pixels; ++i) foreign[i] = 0;
    merge_kinds(pixels, fresh, foreign, kinds);
}

// What is new, by kind; returns the area of the object where it was expected.
Index classify(Size size, const Labelling &what, const Work &work, Byte *kinds, Byte *foreign) {
    const Index pixels = size.height * size.width;
    const Index area = count(pixels, what.own);
    std::memset(kinds, 0, static_cast<std::size_t>(pixels));
    std::memset(foreign, 0, static_cast<std::size_t>(pixels));
    if (what.growth > 0) arrivals(size, what, area, work, kinds, foreign);
    if (what.hiding) hide(pixels, what.hiding, kinds, foreign);
    return area;
}

// ---- log-odds ----

// Log-odds after this frame's evidence: 0.9 expected + 0.7 evidence + trust · colour ratio. The evidence is changed
// where something is new.
void log_odds(Size size, const Labelling &what, const Byte *kinds, const float *ratio, float trust,
              const Labels &labels) {
    const Index pixels = size.height * size.width;
    bin_row(pixels, what.image, labels.bins);
    const std::int16_t *HS_RESTRICT bins = labels.bins;
    const float *HS_RESTRICT odds = what.odds;
    float *HS_RESTRICT evidence = what.evidence, *HS_RESTRICT out = labels.raw;
    for (Index i = 0; i < pixels; ++i) out[i] = ratio[bins[i]];
#pragma omp simd
    for (Index i = 0; i < pixels; ++i) {
        float e = evidence[i], s = odds[i];
        const bool grown = kinds[i] == GROWN, hiding = kinds[i] == HIDING;
        const bool other = (kinds[i] != 0) & !grown & !hiding & (s < 1.0f);
        e = grown ? larger(e, 2.0f) : hiding ? smaller(e, -2.0f) : other ? smaller(e, -1.0f) : e;
        s = grown ? larger(s, -0.5f) : hiding ? smaller(s, -1.0f) : s;
        evidence[i] = e;
        out[i] = smaller(larger(0.9f * s + 0.7f * e + trust * out[i], -5.0f), 5.0f);
    }
}

// Write the log-odds, lowered where they are positive outside the mask, and where something else is. Returns on how
// many pixels that is.
Index settle(Size size, const float *expected, const Labels &labels) {
    const Index pixels = size.height * size.width;
    const float *HS_RESTRICT raw = labels.raw, *HS_RESTRICT before = expected;
    const Byte *HS_RESTRICT mask = labels.mask, *HS_RESTRICT foreign = labels.foreign;
    float *HS_RESTRICT odds = labels.odds;
#pragma omp simd
    for (Index i = 0; i < pixels; ++i) {
        float p = raw[i];
        p = (p > 0.0f) & (mask[i] == 0) ? -1.0f : p;
        const bool other = (foreign[i] != 0) & (before[i] < 1.0f);
        odds[i] = other ? smaller(p, -2.0f) : p;
    }
    return count(pixels, labels.foreign);
}

// ---- the mask ----

void keep_positive(Index pixels, const Byte *HS_RESTRICT mask, const float *HS_RESTRICT odds, Byte *HS_RESTRICT kept) {
#pragma omp simd
    for (Index i = 0; i < pixels; ++i) kept[i] = odds[i] > 0.0f ? mask[i] : 0;
}

// Remove from the mask of a large object what is thinner than 3 px, of a middling one what holds no cross.
void open(Size size, Index area, const Work &work, Byte *mask) {
    Byte *inverse = work.mask[1], *wide = work.mask[2], *held = work.mask[3];
    if (area <= 150) return;
    invert(size, mask, inverse);
    if (area > 800) {
        widen(size, inverse, 1, held, wide);
        invert(size, wide, inverse);
        widen(size, inverse, 1, held, mask);
    } else {
        widen_cross(size, inverse, wide);
        invert(size, wide, inverse);
        widen_cross(size, inverse, mask);
    }
}

// Keep the component that overlaps most with where the object was expected, and its parts.
void keep_component(Size size, const Byte *own, Index area, Run *runs, Byte *mask) {
    Index heads = 0, best = 0;
    const Index count = components(size, mask, own, runs, &heads);
    if (heads <= 1) return;
    for (Index i = 0; i < count; ++i)
        if (runs[i].head == i && runs[i].common > runs[best].common) best = i;
    for (Index i = 0; i < count; ++i) {
        const Run &head = runs[runs[i].head];
        const bool part = head.common > 0.03 * static_cast<double>(area) && head.common > 0.5 * head.area;
        if (!part && (runs[i].head != best || head.common == 0))
            std::memset(mask + runs[i].row * size.width + runs[i].first, 0,
                        static_cast<std::size_t>(runs[i].end - runs[i].first));
    }
}

struct Colour {
    float blue, green, red;
};

inline Colour colour_at(const float *image, Index i) { return {image[3 * i], image[3 * i + 1], image[3 * i + 2]}; }
inline Colour operator-(const Colour &a, const Colour &b) {
    return {a.blue - b.blue, a.green - b.green, a.red - b.red};
}
inline float dot(const Colour &a, const Colour &b) { return a.blue * b.blue + a.green * b.green + a.red * b.red; }

// Mean colour of the pixels within 3 px whose value in the mask is `wanted`; false if there are none.
bool mean_round(Size size, const float *image, const Byte *mask, Byte wanted, Index x, Index y, Colour *mean) {
    Colour sum{0.0f, 0.0f, 0.0f};
    Index count = 0;
    const Index left = larger<Index>(x - 3, 0), right = smaller(x + 4, size.width);
    for (Index j = larger<Index>(y - 3, 0); j < smaller(y + 4, size.height); ++j)
        for (Index i = j * size.width + left; i < j * size.width + right; ++i) {
            if (mask[i] != wanted) continue;
            ++count;
            sum.blue += image[3 * i];
            sum.green += image[3 * i + 1];
            sum.red += image[3 * i + 2];
        }
    const float share = 1.0f / static_cast<float>(larger<Index>(count, 1));
    *mean = {sum.blue * share, sum.green * share, sum.red * share};
    return count > 0;
}

// Pixels well inside the object: of a thin one hardly anything is farther inside.
void find_core(Size size, const Byte *mask, const Work &work, Byte *core) {
    Byte *outside = work.mask[0], *wide = work.mask[2], *held = work.mask[3];
    invert(size, mask, outside);
    for (Index reach = 2; reach > 0; --reach) {
        widen(size, outside, reach, held, wide);
        if (invert(size, wide, core) >= 9) return;
    }
}

// How much of a pixel of the edge is object, if that is told: α of I = α o + (1 - α) b, o being the mean of the core's
// pixels nearby, b the background, or, where that was never seen, the mean of the pixels well outside nearby.
bool mixture(Size size, const Labelling &what, const Byte *core, const Byte *wide, float flat, Index x, Index y,
             float *alpha) {
    const Index i = y * size.width + x;
    Colour ground = colour_at(what.ground.image, i), object;
    if (what.ground.counts[i] < KNOWN && !mean_round(size, what.image, wide, 0, x, y, &ground)) return false;
    if (!mean_round(size, what.image, core, 1, x, y, &object)) return false;
    const Colour o = object - ground, e = colour_at(what.image, i) - ground;
    const float span = dot(o, o);
    if (span <= flat) return false;
    *alpha = dot(o, e) / span;
    const float rest = dot(e, e) - *alpha * *alpha * span;
    return *alpha < 0.7f && rest < 0.15f * span;
}

// Cut mixed edge pixels that are mostly background, and lower their odds. Returns whether more than the share `least`
// of the mask is left; if not, the mask is as it was, but not the odds.
bool cut_edge(Size size, const Labelling &what, const Work &work, const Labels &labels) {
    const Index w = size.width;
    Byte *kept = work.mask[0], *core = work.mask[1], *wide = work.mask[2], *held = work.mask[3];
    find_core(size, labels.mask, work, core);
    widen(size, labels.mask, 1, held, wide);
    const auto flat = static_cast<float>(36.0 * what.noise * what.noise + 100.0);
    for (Index y = 0; y < size.height; ++y)
        for (Index x = 0; x < w; ++x) {
            const Index i = y * w + x;
            float alpha;
            if (labels.mask[i] == 0 || core[i] != 0) continue;
            if (mixture(size, what, core, wide, flat, x, y, &alpha))
                labels.odds[i] = smaller(labels.odds[i], larger(8.0f * (alpha - 0.5f), -3.0f));
        }
    const Index pixels = size.height * w;
    keep_positive(pixels, labels.mask, labels.odds, kept);
    const auto before = static_cast<double>(count(pixels, labels.mask)),
               after = static_cast<double>(count(pixels, kept));
    if (after <= what.least * before) return false;
    std::memcpy(labels.mask, kept, static_cast<std::size_t>(pixels));
    return true;
}

// ---- its edges ----

// Edge, px, where the profile crosses zero between the last pixel inside and the next one.
double crossing(const float *values, Index count, Index last, Index step) {
    const auto way = static_cast<double>(step), edge = static_cast<double>(last) + 0.5 + 0.5 * way;
    const Index beyond = last + step;
    if (beyond < 0 || beyond >= count || values[last] <= 0.0f || values[beyond] >= 0.0f) return edge;
    const double inner = values[last];
    // Equal odds on both sides put the edge where the pixels meet.
    return edge + way * (inner / (inner - values[beyond]) - 0.5);
}

// Edges of a mask: where the largest of the odds per row or column crosses zero; all 0 if it is empty.
void edges(Size size, const Byte *mask, const float *odds, VisiblePart *visible) {
    const Room<float> room(size.width + size.height);
    float *columns = room.get(), *rows = columns + size.width;
    Rectangle bounds;
    visible->left = visible->top = visible->right = visible->bottom = 0.0;
    if (!extremes(size, mask, odds, columns, rows, &bounds)) return;
    visible->left = crossing(columns, size.width, bounds.left, -1);
    visible->top = crossing(rows, size.height, bounds.top, -1);
    visible->right = crossing(columns, size.width, bounds.right, 1);
    visible->bottom = crossing(rows, size.height, bounds.bottom, 1);
}

} // namespace

VisiblePart label(Size size, const Labelling &what, const Labels &out) {
    const Index pixels = size.height * size.width;
    const Room<Byte> masks(MASKS * pixels);
    const Room<Run> runs(most_runs(size));
    Work work;
    for (Index i = 0; i < MASKS; ++i) work.mask[i] = masks.get() + i * pixels;
    work.runs = runs.get();
    Byte *kinds = work.mask[0];
    const Index area = classify(size, what, work, kinds, out.foreign);
    float ratio[BINS];
    // Histograms that overlap tell next to nothing.
    const double trust = what.colour_weight * larger(0.0, 1.1 - likelihood(what.colours, ratio));
    log_odds(size, what, kinds, ratio, static_cast<float>(trust), out);
    threshold(pixels, out.raw, out.mask);
    open(size, area, work, out.mask);
    keep_component(size, what.own, area, work.runs, out.mask);
    VisiblePart visible;
    visible.foreign = settle(size, what.odds, out);
    if (!cut_edge(size, what, work, out)) settle(size, what.odds, out);
    overlap(size, out.mask, what.shape, what.inside, &visible);
    edges(size, out.mask, out.odds, &visible);
    return visible;
}

} // namespace HS_LEVEL
} // namespace hs
