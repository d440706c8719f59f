#include "shapes.hpp"

#include <cstring>

namespace hs {
namespace HS_LEVEL {
namespace {

// Loops go over whole masks: rows are often shorter than what a processor takes at a time.

// 1 where a pixel of the mask is here, on the left or on the right.
void beside(Size size, const Byte *mask, Byte *out) {
    const Index w = size.width, last = size.height * w - 1;
    const Byte *HS_RESTRICT in = mask;
    Byte *HS_RESTRICT result = out;
    for (Index i = 1; i < last; ++i) result[i] = in[i - 1] | in[i] | in[i + 1];
    for (Index i = 0; i < last; i += w) {
        result[i] = in[i] | in[i + 1];
        result[i + w - 1] = in[i + w - 2] | in[i + w - 1];
    }
}

// 1 where a pixel of the mask is here, above or below.
void above_or_below(Size size, const Byte *mask, Byte *out) {
    const Index w = size.width, last = (size.height - 1) * w;
    const Byte *HS_RESTRICT in = mask;
    Byte *HS_RESTRICT result = out;
    for (Index i = 0; i < w; ++i) result[i] = in[i] | in[w + i];
    for (Index i = w; i < last; ++i) result[i] = in[i - w] | in[i] | in[i + w];
    for (Index i = last; i < last + w; ++i) result[i] = in[i - w] | in[i];
}

// Sums of three rows, the border repeated.
void add_rows(Size size, const Byte *mask, Byte *sum) {
    const Index w = size.width, last = (size.height - 1) * w;
    const Byte *HS_RESTRICT in = mask;
    Byte *HS_RESTRICT out = sum;
    for (Index i = 0; i < w; ++i) out[i] = static_cast<Byte>(in[i] + in[i] + in[w + i]);
    for (Index i = w; i < last; ++i) out[i] = static_cast<Byte>(in[i - w] + in[i] + in[i + w]);
    for (Index i = last; i < last + w; ++i) out[i] = static_cast<Byte>(in[i - w] + in[i] + in[i]);
}

std::int32_t head_of(const Run *runs, Index i) {
    while (runs[i].head != i) i = runs[i].head;
    return static_cast<std::int32_t>(i);
}

} // namespace

void threshold(Index pixels, const float *odds, Byte *mask) {
    const float *HS_RESTRICT in = odds;
    Byte *HS_RESTRICT out = mask;
#pragma omp simd
    for (Index i = 0; i < pixels; ++i) out[i] = in[i] > 0.0f;
}

Index count(Index pixels, const Byte *mask) {
    constexpr Index PART = 128; // bytes are added up as bytes
    Index total = 0;
    for (Index begin = 0; begin < pixels; begin += PART) {
        const Index length = smaller(pixels - begin, PART);
        Byte part = 0;
        for (Index i = 0; i < length; ++i) part = static_cast<Byte>(part + (mask[begin + i] != 0));
        total += part;
    }
    return total;
}

Index without(Size size, const Byte *mask, const Byte *other, Byte *out) {
    const Index pixels = size.height * size.width;
    const Byte *HS_RESTRICT a = mask, *HS_RESTRICT b = other;
    Byte *HS_RESTRICT result = out;
    for (Index i = 0; i < pixels; ++i) result[i] = static_cast<Byte>(a[i] & (b[i] ^ 1));
    return count(pixels, out);
}

Index invert(Size size, const Byte *mask, Byte *out) {
    const Index pixels = size.height * size.width;
    const Byte *HS_RESTRICT in = mask;
    Byte *HS_RESTRICT result = out;
    for (Index i = 0; i < pixels; ++i) result[i] = in[i] ^ 1;
    return count(pixels, out);
}

void median(Size size, const Byte *mask, Byte *held, Byte *out) {
    const Index w = size.width, last = size.height * w - 1;
    add_rows(size, mask, held);
    const Byte *HS_RESTRICT sum = held;
    Byte *HS_RESTRICT result = out;
    // Of sums from 0 to 9, those from 5 on become 1.
    for (Index i = 1; i < last; ++i) result[i] = static_cast<Byte>(sum[i - 1] + sum[i] + sum[i + 1]) > 4;
    for (Index i = 0; i < last; i += w) {
        result[i] = sum[i] + sum[i] + sum[i + 1] > 4;
        result[i + w - 1] = sum[i + w - 2] + sum[i + w - 1] + sum[i + w - 1] > 4;
    }
}

void spread(Size size, const Byte *allowed, Index times, Byte *held, Byte *out) {
    const Index w = size.width, last = (size.height - 1) * w;
    const Byte *HS_RESTRICT may = allowed, *HS_RESTRICT in = held;
    Byte *HS_RESTRICT result = out;
    for (Index step = 0; step < times; ++step) {
        beside(size, out, held);
        for (Index i = 0; i < w; ++i) result[i] |= may[i] & (in[i] | in[w + i]);
        for (Index i = w; i < last; ++i) result[i] |= may[i] & (in[i - w] | in[i] | in[i + w]);
        for (Index i = last; i < last + w; ++i) result[i] |= may[i] & (in[i - w] | in[i]);
    }
}

void widen(Size size, const Byte *mask, Index reach, Byte *held, Byte *out) {
    if (reach == 0) std::memcpy(out, mask, static_cast<std::size_t>(size.height * size.width));
    for (Index step = 0; step < reach; ++step) {
        beside(size, step ? out : mask, held);
        above_or_below(size, held, out);
    }
}

void widen_cross(Size size, const Byte *mask, Byte *out) {
    const Index w = size.width, last = size.height * w - 1;
    const Byte *HS_RESTRICT in = mask;
    Byte *HS_RESTRICT result = out;
    above_or_below(size, mask, out);
    for (Index i = 1; i < last; ++i) result[i] |= in[i - 1] | in[i + 1];
    // The ends of rows are no neighbours of the next ones'.
    for (Index y = 0; y < size.height; ++y) {
        const Index first = y * w, end = first + w - 1;
        const Byte up = y > 0, down = y + 1 < size.height;
        result[first] = in[first] | in[first + 1] | (up & in[first - up * w]) | (down & in[first + down * w]);
        result[end] = in[end] | in[end - 1] | (up & in[end - up * w]) | (down & in[end + down * w]);
    }
}

Index components(Size size, const Byte *mask, const Byte *other, Run *runs, Index *heads) {
    Index count = 0, first_above = 0;
    for (Index y = 0; y < size.height; ++y) {
        const Byte *in = mask + y * size.width, *second = other + y * size.width;
        const Index begin = count;
        for (Index x = 0; x < size.width;) {
            if (in[x] == 0) {
                ++x;
                continue;
            }
            const Index first = x;
            std::int32_t common = 0;
            for (; x < size.width && in[x] != 0; ++x) common += second[x];
            const auto own = static_cast<std::int32_t>(count);
            runs[count] = {static_cast<std::int32_t>(y),         static_cast<std::int32_t>(first),
                           static_cast<std::int32_t>(x),         own,
                           static_cast<std::int32_t>(x - first), common};
            while (first_above < begin && runs[first_above].end < first) ++first_above;
            for (Index i = first_above; i < begin && runs[i].first <= x; ++i) {
                const std::int32_t a = head_of(runs, i), b = head_of(runs, count);
                runs[larger(a, b)].head = smaller(a, b);
            }
            ++count;
        }
        first_above = begin;
    }
    *heads = 0;
    for (Index i = 0; i < count; ++i) {
        const std::int32_t head = runs[runs[i].head].head; // that of an earlier run is its final one
        runs[i].head = head;
        if (head == i) {
            ++*heads;
        } else {
            runs[head].area += runs[i].area;
            runs[head].common += runs[i].common;
        }
    }
    return count;
}

void overlap(Size size, const Byte *mask, const float *shape, const Rectangle &inside, VisiblePart *visible) {
    visible->expected = visible->both = visible->seen = 0;
    for (Index y = inside.top; y < inside.bottom; ++y) {
        int area = 0, both = 0, seen = 0;
        for (Index x = inside.left; x < inside.right; ++x) {
            const int part = shape[y * size.width + x] > 0.5f, own = mask[y * size.width + x] != 0;
            area += part;
            seen += own;
            both += part & own;
        }
        visible->expected += area;
        visible->both += both;
        visible->seen += seen;
    }
}

bool extremes(Size size, const Byte *mask, const float *odds, float *columns, float *rows, Rectangle *bounds) {
    const Index w = size.width;
    *bounds = {w, -1, -1, -1};
    for (Index y = 0; y < size.height; ++y) {
        const void *found = std::memchr(mask + y * w, 1, w);
        if (!found) continue;
        Index last = w - 1;
        while (mask[y * w + last] == 0) --last;
        bounds->top = bounds->top < 0 ? y : bounds->top;
        bounds->bottom = y;
        bounds->left = smaller<Index>(bounds->left, static_cast<const Byte *>(found) - (mask + y * w));
        bounds->right = larger(bounds->right, last);
    }
    if (bounds->right < 0) return false;
    for (Index x = 0; x < w; ++x) columns[x] = -9.0f;
    for (Index y = 0; y < size.height; ++y) {
        const float *HS_RESTRICT in = odds + y * w;
        float best = -9.0f;
#pragma omp simd reduction(max : best)
        for (Index x = bounds->left; x <= bounds->right; ++x) best = in[x] > best ? in[x] : best;
        rows[y] = best;
        if (y < bounds->top || y > bounds->bottom) continue;
        for (Index x = 0; x < w; ++x) columns[x] = larger(columns[x], in[x]);
    }
    return true;
}

} // namespace HS_LEVEL
} // namespace hs
