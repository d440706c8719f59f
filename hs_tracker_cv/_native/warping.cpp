#include "warping.hpp"

#include "derivatives.hpp"

#include <cmath>
#include <cstdint>

namespace hs {
namespace {

// The second one if either is not a number.
inline float least(float a, float b) { return a < b ? a : b; }
inline float greatest(float a, float b) { return a > b ? a : b; }

void add(const Plane &from, const Plane &to, float factor) {
    const Index width = whole_blocks(from.width);
    for (Index y = 0; y < from.height; ++y) {
        const float *HS_RESTRICT in = row(from, y);
        float *HS_RESTRICT out = row(to, y);
#pragma omp simd
        for (Index x = 0; x < width; ++x) out[x] += factor * in[x];
    }
}

// Where a pixel of the new image lies in the old one: between `first` and the next, `fraction` of the way.
struct Place {
    std::int32_t first;
    float fraction;
};

inline Place place(Index at, float step) {
    const float position = (static_cast<float>(at) + 0.5f) * step + 1.5f; // two more, so that it is positive
    const std::int32_t whole = static_cast<std::int32_t>(position);
    return {whole - static_cast<std::int32_t>(RING), position - static_cast<float>(whole)};
}

// A row of whole blocks, ring included, with a block more on both sides: the rows between which a new row lies, mixed.
void mix_rows(const Plane &in, const Place &at, float gain, float *HS_RESTRICT out) {
    const float low = at.fraction * gain, high = gain - low;
    const float *HS_RESTRICT up = row(in, at.first);
    const float *HS_RESTRICT down = row(in, at.first + 1);
    const Index end = whole_blocks(in.width) + BLOCK;
#pragma omp simd
    for (Index x = -BLOCK; x < end; ++x) out[x] = high * up[x] + low * down[x];
}

// The same of rows blurred down the columns. Rows must lie between the first and the last one.
void mix_blurred_rows(const Plane &in, const Place &at, float gain, const Taps &taps, float *HS_RESTRICT out) {
    const float low = at.fraction * gain, high = gain - low;
    const float w0 = high * taps.far, w1 = high * taps.near + low * taps.far, w2 = high * taps.centre + low * taps.near;
    const float w5 = low * taps.far, w4 = low * taps.near + high * taps.far, w3 = low * taps.centre + high * taps.near;
    const float *HS_RESTRICT r0 = row(in, at.first - 2), *HS_RESTRICT r1 = row(in, at.first - 1);
    const float *HS_RESTRICT r2 = row(in, at.first), *HS_RESTRICT r3 = row(in, at.first + 1);
    const float *HS_RESTRICT r4 = row(in, at.first + 2);
    const float *HS_RESTRICT r5 = row(in, low > 0.0f ? at.first + 3 : at.first + 2);
    const Index end = whole_blocks(in.width) + BLOCK;
#pragma omp simd
    for (Index x = -BLOCK; x < end; ++x)
        out[x] = (w0 * r0[x] + w5 * r5[x]) + (w1 * r1[x] + w4 * r4[x]) + (w2 * r2[x] + w3 * r3[x]);
}

// A row blurred, in whole blocks.
void blur_row(const float *HS_RESTRICT in, const Taps &taps, Index width, float *HS_RESTRICT out) {
    const float centre = taps.centre, near = taps.near, far = taps.far;
    const Index end = whole_blocks(width);
#pragma omp simd
    for (Index x = 0; x < end; ++x)
        out[x] = centre * in[x] + near * (in[x - 1] + in[x + 1]) + far * (in[x - 2] + in[x + 2]);
}

void blur(const Plane &in, const Plane &out, const Taps &taps, float *rows) {
    fill_ring(in, 1.0f);
    float *HS_RESTRICT down = rows + BLOCK;
    const float centre = taps.centre, near = taps.near, far = taps.far;
    const Index end = whole_blocks(in.width) + BLOCK;
    for (Index y = 0; y < in.height; ++y) {
        const float *HS_RESTRICT up2 = row(in, y - 2), *HS_RESTRICT up = row(in, y - 1), *HS_RESTRICT here = row(in, y);
        const float *HS_RESTRICT down1 = row(in, y + 1), *HS_RESTRICT down2 = row(in, y + 2);
#pragma omp simd
        for (Index x = -BLOCK; x < end; ++x)
            down[x] = centre * here[x] + near * (up[x] + down1[x]) + far * (up2[x] + down2[x]);
        blur_row(down, taps, in.width, row(out, y));
    }
}

void resize(const Plane &in, const Plane &out, float gain, const Taps &taps, float *rows) {
    fill_ring(in, 1.0f);
    const float step_y = static_cast<float>(in.height) / static_cast<float>(out.height);
    const float step_x = static_cast<float>(in.width) / static_cast<float>(out.width);
    const Index room = whole_blocks(in.width) + 2 * BLOCK;
    float *const mixed = rows + BLOCK, *const blurred = mixed + room;
    float *HS_RESTRICT fractions = blurred + room;
    std::int32_t *HS_RESTRICT firsts = reinterpret_cast<std::int32_t *>(fractions + out.width);
    for (Index x = 0; x < out.width; ++x) {
        const Place at = place(x, step_x);
        firsts[x] = at.first;
        fractions[x] = at.fraction;
    }
    for (Index y = 0; y < out.height; ++y) {
        const float *HS_RESTRICT from = mixed;
        if (taps.near == 0.0f) {
            mix_rows(in, place(y, step_y), gain, mixed);
        } else {
            mix_blurred_rows(in, place(y, step_y), gain, taps, mixed);
            blur_row(mixed, taps, in.width, blurred);
            blurred[in.width] = blurred[in.width - 1];
            from = blurred;
        }
        float *HS_RESTRICT to = row(out, y);
#pragma omp simd
        for (Index x = 0; x < out.width; ++x) {
            const float left = from[firsts[x]], right = from[firsts[x] + 1];
            to[x] = left + fractions[x] * (right - left);
        }
    }
}

// For a tile of a row, where each pixel is sampled and with which weights.
struct Samples {
    std::int32_t x[TILE], y[TILE]; // of the pixel to the left and above
    float down[4][TILE], across[4][TILE];
    float sums[4 * TILE]; // of four columns, each weighed down
};

// Keys' bicubic weights (a = -1/2) for a place `t` of the way between two pixels.
inline void keys(float t, float *HS_RESTRICT w0, float *HS_RESTRICT w1, float *HS_RESTRICT w2, float *HS_RESTRICT w3) {
    *w0 = ((-0.5f * t + 1.0f) * t - 0.5f) * t;
    *w1 = (1.5f * t - 2.5f) * t * t + 1.0f;
    *w2 = ((-1.5f * t + 2.0f) * t + 0.5f) * t;
    *w3 = (0.5f * t - 0.5f) * t * t;
}

void find_places(const Plane &frame, const float *HS_RESTRICT u, const float *HS_RESTRICT v, Index start, Index y,
                 Index width, Samples &at, float *HS_RESTRICT mask) {
    const float right = static_cast<float>(frame.width - 1), bottom = static_cast<float>(frame.height - 1);
    const float py0 = static_cast<float>(y);
    const std::int32_t x0 = static_cast<std::int32_t>(start);
#pragma omp simd
    for (std::int32_t x = 0; x < static_cast<std::int32_t>(width); ++x) {
        const float px = static_cast<float>(x0 + x) + u[x], py = py0 + v[x];
        const float ix = least(greatest(px, 0.0f), right), iy = least(greatest(py, 0.0f), bottom);
        mask[x] = (ix == px ? 1.0f : 0.0f) * (iy == py ? 1.0f : 0.0f);
        const std::int32_t whole_x = static_cast<std::int32_t>(ix), whole_y = static_cast<std::int32_t>(iy);
        at.x[x] = whole_x;
        at.y[x] = whole_y;
        keys(iy - static_cast<float>(whole_y), at.down[0] + x, at.down[1] + x, at.down[2] + x, at.down[3] + x);
        keys(ix - static_cast<float>(whole_x), at.across[0] + x, at.across[1] + x, at.across[2] + x, at.across[3] + x);
    }
}

void interpolate(const Plane &frame, Samples &at, Index width, float *HS_RESTRICT out) {
    const Index stride = frame.stride;
    for (Index x = 0; x < width; ++x) {
        const float *HS_RESTRICT p = frame.data + (at.y[x] - 1) * stride + (at.x[x] - 1);
        const float w0 = at.down[0][x], w1 = at.down[1][x], w2 = at.down[2][x], w3 = at.down[3][x];
        float *HS_RESTRICT sums = at.sums + 4 * x;
        for (Index i = 0; i < 4; ++i)
            sums[i] = (w0 * p[i] + w1 * p[i + stride]) + (w2 * p[i + 2 * stride] + w3 * p[i + 3 * stride]);
    }
    const float *HS_RESTRICT sums = at.sums;
#pragma omp simd
    for (Index x = 0; x < width; ++x)
        out[x] = (at.across[0][x] * sums[4 * x] + at.across[1][x] * sums[4 * x + 1]) +
                 (at.across[2][x] * sums[4 * x + 2] + at.across[3][x] * sums[4 * x + 3]);
}

void warp(const Plane &frame, const Pair &flow, const Plane &warped, const Plane &mask) {
    fill_ring(frame, 1.0f);
    Samples at;
    for (Index start = 0; start < frame.width; start += TILE) {
        const Index width = tile_width(frame, start);
        for (Index y = 0; y < frame.height; ++y) {
            find_places(frame, row(flow.u, y) + start, row(flow.v, y) + start, start, y, width, at,
                        row(mask, y) + start);
            interpolate(frame, at, width, row(warped, y) + start);
        }
    }
}

inline float unexplained(float before, float after, const Exposure &exposure) {
    return (after - before) - (exposure.gain * (0.5f * (before + after)) + exposure.offset);
}

// Sums of pixels a block apart, so that their order does not depend on the processor.
struct Lanes {
    float w[BLOCK], m[BLOCK], mm[BLOCK], d[BLOCK], md[BLOCK];
};

inline void compare_at(const float *HS_RESTRICT before, const float *HS_RESTRICT after, const float *HS_RESTRICT mask,
                       Index x, Index lane, float outlier, const Exposure &exposure, Lanes &sums) {
    const float d = after[x] - before[x], m = 0.5f * (before[x] + after[x]);
    const float rest = unexplained(before[x], after[x], exposure), w = mask[x] / (1.0f + outlier * rest * rest);
    sums.w[lane] += w;
    sums.m[lane] += w * m;
    sums.mm[lane] += w * m * m;
    sums.d[lane] += w * d;
    sums.md[lane] += w * m * d;
}

LineSums compare(const Plane &first, const Plane &warped, const Plane &mask, float outlier, const Exposure &exposure) {
    LineSums total{};
    const Index width = first.width, whole = width / BLOCK * BLOCK;
    for (Index y = 0; y < first.height; ++y) {
        const float *HS_RESTRICT before = row(first, y);
        const float *HS_RESTRICT after = row(warped, y);
        const float *HS_RESTRICT inside = row(mask, y);
        Lanes sums{};
        for (Index x = 0; x < whole; x += BLOCK) {
#pragma omp simd
            for (Index i = 0; i < BLOCK; ++i) compare_at(before, after, inside, x + i, i, outlier, exposure, sums);
        }
        for (Index x = whole; x < width; ++x) compare_at(before, after, inside, x, x - whole, outlier, exposure, sums);
        for (Index i = 0; i < BLOCK; ++i) {
            total.w += sums.w[i];
            total.m += sums.m[i];
            total.mm += sums.mm[i];
            total.d += sums.d[i];
            total.md += sums.md[i];
        }
    }
    return total;
}

struct LinearisedRow {
    const float *HS_RESTRICT mask, *HS_RESTRICT u, *HS_RESTRICT v;
    float *HS_RESTRICT gx, *HS_RESTRICT gy, *HS_RESTRICT gt;
};

template <bool FiveTap>
HS_NOINLINE void linearise_row(const Rows a, const Rows b, const LinearisedRow row, Index width, float square_lambda,
                               float outlier, const Exposure exposure) {
#pragma omp simd
    for (Index x = 0; x < width; ++x) {
        Slope f = slope_at<FiveTap>(a, b, x);
        f.t -= exposure.gain * (0.5f * (a.here[x] + b.here[x])) + exposure.offset;
        const float weight = row.mask[x] / (1.0f + outlier * f.t * f.t);
        const float scale = std::sqrt(weight / (square_lambda + weight * (f.x * f.x + f.y * f.y)));
        row.gx[x] = f.x * scale;
        row.gy[x] = f.y * scale;
        row.gt[x] = (f.t - f.x * row.u[x] - f.y * row.v[x]) * scale;
    }
}

template <bool FiveTap>
void linearise_by(const Plane &first, const Plane &warped, const Plane &mask, const Pair &flow, float lambda,
                  float outlier, const Exposure &exposure, const Slopes &g) {
    const Index width = whole_blocks(first.width);
    for (Index y = 0; y < first.height; ++y) {
        const LinearisedRow here = {row(mask, y), row(flow.u, y), row(flow.v, y),
                                    row(g.x, y),  row(g.y, y),    row(g.t, y)};
        linearise_row<FiveTap>(rows_round(first, y), rows_round(warped, y), here, width, lambda * lambda, outlier,
                               exposure);
    }
}

void linearise(const Plane &first, const Plane &warped, const Plane &mask, const Pair &flow, bool five_tap,
               float lambda, float outlier, const Exposure &exposure, const Slopes &g) {
    fill_ring(first, 1.0f);
    fill_ring(warped, 1.0f);
    (five_tap ? linearise_by<true> : linearise_by<false>)(first, warped, mask, flow, lambda, outlier, exposure, g);
}

inline void order(float &a, float &b) {
    const float low = least(a, b), high = greatest(a, b);
    a = low;
    b = high;
}

// Sorting networks of the fewest exchanges (Knuth, vol. 3, section 5.3.4).
inline void sort3(float &a, float &b, float &c) {
    order(a, b);
    order(b, c);
    order(a, b);
}

inline void sort5(float &a, float &b, float &c, float &d, float &e) {
    order(a, b);
    order(d, e);
    order(c, e);
    order(c, d);
    order(b, e);
    order(a, d);
    order(a, c);
    order(b, d);
    order(b, c);
}

// For a tile of a row, the pixels of each column sorted, the smallest first; two columns more on both sides.
template <int Side> struct SortedColumns {
    float rank[Side][TILE + 2 * BLOCK];
};

inline void sort_columns(const Plane &in, Index start, Index y, Index width, SortedColumns<3> &out) {
    const float *HS_RESTRICT p0 = row(in, y - 1) + start;
    const float *HS_RESTRICT p1 = row(in, y) + start;
    const float *HS_RESTRICT p2 = row(in, y + 1) + start;
#pragma omp simd
    for (Index x = -RING; x < width + RING; ++x) {
        float a = p0[x], b = p1[x], c = p2[x];
        sort3(a, b, c);
        out.rank[0][x + BLOCK] = a;
        out.rank[1][x + BLOCK] = b;
        out.rank[2][x + BLOCK] = c;
    }
}

inline void sort_columns(const Plane &in, Index start, Index y, Index width, SortedColumns<5> &out) {
    const float *HS_RESTRICT p0 = row(in, y - 2) + start;
    const float *HS_RESTRICT p1 = row(in, y - 1) + start;
    const float *HS_RESTRICT p2 = row(in, y) + start;
    const float *HS_RESTRICT p3 = row(in, y + 1) + start;
    const float *HS_RESTRICT p4 = row(in, y + 2) + start;
#pragma omp simd
    for (Index x = -RING; x < width + RING; ++x) {
        float a = p0[x], b = p1[x], c = p2[x], d = p3[x], e = p4[x];
        sort5(a, b, c, d, e);
        out.rank[0][x + BLOCK] = a;
        out.rank[1][x + BLOCK] = b;
        out.rank[2][x + BLOCK] = c;
        out.rank[3][x + BLOCK] = d;
        out.rank[4][x + BLOCK] = e;
    }
}

// The median of nine is that of the largest of the columns' smallest, the median of their medians and the smallest of
// their largest.
inline void pick_medians(const SortedColumns<3> &columns, Index width, float *HS_RESTRICT out) {
#pragma omp simd
    for (Index x = 0; x < width; ++x) {
        const Index i = x + BLOCK;
        const float *low = columns.rank[0], *middle = columns.rank[1], *high = columns.rank[2];
        float a = greatest(greatest(low[i - 1], low[i]), low[i + 1]);
        float m0 = middle[i - 1], m1 = middle[i], m2 = middle[i + 1];
        sort3(m0, m1, m2);
        float c = least(least(high[i - 1], high[i]), high[i + 1]);
        sort3(a, m1, c);
        out[x] = m1;
    }
}

// Ranks sorted among the columns leave 13 values that may be the median of 25; of all others that many values are
// known to be no smaller, or no larger. What the exchanges bring to the seventh place is the median: Batcher's, less
// those that the order which the 13 have already makes superfluous. A test goes through all orders.
inline float median_of_candidates(float r21, float r04, float r03, float r31, float r12, float r40, float r30,
                                  float r22, float r13, float r23, float r41, float r14, float r32) {
    order(r31, r14);
    order(r21, r12);
    order(r04, r40);
    order(r03, r30);
    order(r31, r22);
    order(r13, r32);
    order(r40, r23);
    order(r04, r31);
    order(r12, r30);
    order(r40, r22);
    order(r13, r41);
    order(r31, r40);
    order(r30, r13);
    order(r31, r30);
    order(r40, r13);
    order(r40, r30);
    return r30;
}

inline void pick_medians(const SortedColumns<5> &columns, Index width, float *HS_RESTRICT out) {
#pragma omp simd
    for (Index x = 0; x < width; ++x) {
        const float *p0 = columns.rank[0] + x + BLOCK, *p1 = columns.rank[1] + x + BLOCK;
        const float *p2 = columns.rank[2] + x + BLOCK, *p3 = columns.rank[3] + x + BLOCK;
        const float *p4 = columns.rank[4] + x + BLOCK;
        float a0 = p0[-2], a1 = p0[-1], a2 = p0[0], a3 = p0[1], a4 = p0[2];
        float b0 = p1[-2], b1 = p1[-1], b2 = p1[0], b3 = p1[1], b4 = p1[2];
        float c0 = p2[-2], c1 = p2[-1], c2 = p2[0], c3 = p2[1], c4 = p2[2];
        float d0 = p3[-2], d1 = p3[-1], d2 = p3[0], d3 = p3[1], d4 = p3[2];
        float e0 = p4[-2], e1 = p4[-1], e2 = p4[0], e3 = p4[1], e4 = p4[2];
        sort5(a0, a1, a2, a3, a4);
        sort5(b0, b1, b2, b3, b4);
        sort5(c0, c1, c2, c3, c4);
        sort5(d0, d1, d2, d3, d4);
        sort5(e0, e1, e2, e3, e4);
        out[x] = median_of_candidates(c1, a4, a3, d1, b2, e0, d0, c2, b3, c3, e1, b4, d2);
    }
}

template <int Side> void median_of(const Plane &in, const Plane &out) {
    SortedColumns<Side> columns;
    for (Index start = 0; start < in.width; start += TILE) {
        const Index width = tile_width(in, start);
        for (Index y = 0; y < in.height; ++y) {
            sort_columns(in, start, y, width, columns);
            pick_medians(columns, width, row(out, y) + start);
        }
    }
}

void median(const Plane &in, const Plane &out, int side) {
    fill_ring(in, 1.0f);
    (side == 3 ? median_of<3> : median_of<5>)(in, out);
}

} // namespace

extern const WarpKernels HS_JOIN(warping, HS_LEVEL) = {add, blur, resize, warp, compare, linearise, median};

} // namespace hs
