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
#else
#define HS_RESTRICT __restrict__
#endif

namespace hs {

// A gray image as Python has it: rows of `width` pixels without anything between them.
struct Image {
    const float *data;
    std::ptrdiff_t height, width;
};

// Planes of one size in one piece of memory, made for loops without branches: each has a ring of two pixels round it,
// and between the rows there is room for blocks of 16 pixels that stick out. What is in that room does not count.
struct Planes {
    float *data; // pixel (0, 0) of the first plane
    std::ptrdiff_t height, width;
    std::ptrdiff_t stride; // elements from one row to the next
    std::ptrdiff_t step;   // elements from one plane to the next
};

constexpr std::ptrdiff_t BLOCK = 16; // pixels: what the widest registers hold
constexpr std::ptrdiff_t RING = 2;   // pixels

static inline float *row(const Planes &planes, std::ptrdiff_t plane, std::ptrdiff_t y) {
    return planes.data + plane * planes.step + y * planes.stride;
}

// Width of a row of whole blocks.
static inline std::ptrdiff_t blocks_width(std::ptrdiff_t width) { return (width + BLOCK - 1) / BLOCK * BLOCK; }

// Fill the ring of a plane: from its border (keep = 1) or with zeros (keep = 0).
static inline void fill_ring(const Planes &planes, std::ptrdiff_t plane, float keep) {
    const std::ptrdiff_t h = planes.height, w = planes.width;
    for (std::ptrdiff_t y = 0; y < h; ++y) {
        float *p = row(planes, plane, y);
        p[-1] = p[-2] = keep * p[0];
        p[w] = p[w + 1] = keep * p[w - 1];
    }
    for (std::ptrdiff_t i = 1; i <= RING; ++i) {
        const float *HS_RESTRICT top = row(planes, plane, 0);
        const float *HS_RESTRICT bottom = row(planes, plane, h - 1);
        float *HS_RESTRICT above = row(planes, plane, -i);
        float *HS_RESTRICT below = row(planes, plane, h - 1 + i);
        for (std::ptrdiff_t x = -RING; x < w + RING; ++x) {
            above[x] = keep * top[x];
            below[x] = keep * bottom[x];
        }
    }
}

} // namespace hs
