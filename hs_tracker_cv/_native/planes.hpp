// Images as kernels hold them.
//
// This header is compiled for every level. So it has plain data and static functions only: an inline function that is
// visible outside of its file might be taken from the most capable level's when all are linked.
#pragma once

#include <cstddef>

#define HS_JOIN_(a, b) a##_##b
#define HS_JOIN(a, b) HS_JOIN_(a, b)
#ifdef _MSC_VER
#define HS_RESTRICT __restrict
#define HS_NOINLINE __declspec(noinline)
#else
#define HS_RESTRICT __restrict__
#define HS_NOINLINE __attribute__((noinline))
#endif

namespace hs {

using Index = std::ptrdiff_t;

// An image made for loops without branches: it has a ring of two pixels round it, and between the rows there is room
// for blocks of 16 pixels that stick out. What is in that room does not count.
//
// Kernels fill the rings that they read, so a plane may be written by anybody.
struct Plane {
    float *data; // pixel (0, 0)
    Index height, width;
    Index stride; // elements from one row to the next
};

// Planes of one size in one piece of memory.
struct Planes {
    Plane first;
    Index count;
    Index step; // elements from one plane to the next
};

constexpr Index BLOCK = 16; // pixels: what the widest registers hold
constexpr Index RING = 2;   // pixels
constexpr Index TILE = 272; // pixels of a row that are computed in one go where rows are buffered; whole blocks

static inline Plane plane(const Planes &planes, Index i) {
    const Plane &first = planes.first;
    return {first.data + i * planes.step, first.height, first.width, first.stride};
}

static inline float *row(const Plane &plane, Index y) { return plane.data + y * plane.stride; }

static inline Index whole_blocks(Index width) { return (width + BLOCK - 1) / BLOCK * BLOCK; }

// Pixels of whole blocks from x on to the end of a row, but at most a tile.
static inline Index tile_width(const Plane &plane, Index x, Index tile = TILE) {
    const Index blocks = whole_blocks(plane.width - x);
    return blocks < tile ? blocks : tile;
}

// Copy a row of pixels and the ring beside it, times `keep`, to another row.
static inline void copy_row(const Plane &plane, Index from, Index to, float keep) {
    const float *HS_RESTRICT in = row(plane, from);
    float *HS_RESTRICT out = row(plane, to);
    for (Index x = -RING; x < plane.width + RING; ++x) out[x] = keep * in[x];
}

// Fill the ring of a plane: from its border (keep = 1) or with zeros (keep = 0).
static inline void fill_ring(const Plane &plane, float keep) {
    const Index w = plane.width;
    for (Index y = 0; y < plane.height; ++y) {
        float *p = row(plane, y);
        p[-1] = p[-2] = keep * p[0];
        p[w] = p[w + 1] = keep * p[w - 1];
    }
    for (Index i = 1; i <= RING; ++i) {
        copy_row(plane, 0, -i, keep);
        copy_row(plane, plane.height - 1, plane.height - 1 + i, keep);
    }
}

static inline void clear(const Plane &plane) {
    for (Index y = 0; y < plane.height; ++y)
        for (Index x = 0; x < plane.width; ++x) row(plane, y)[x] = 0.0f;
}

static inline void copy(const Plane &from, const Plane &to) {
    for (Index y = 0; y < from.height; ++y) {
        const float *HS_RESTRICT in = row(from, y);
        float *HS_RESTRICT out = row(to, y);
        for (Index x = 0; x < from.width; ++x) out[x] = in[x];
    }
}

} // namespace hs
