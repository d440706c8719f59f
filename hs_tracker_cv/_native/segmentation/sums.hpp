// Sums in a fixed order, so that they are the same bits at every level; and the value below which a share lies.
#pragma once

#include "kernels.hpp"

namespace hs {
namespace {

constexpr Index LANES = 8;

// A sum in eight parts, which all levels can add up in the same order.
struct Parts {
    double part[LANES];
};

inline double total(const Parts &sum) {
    const double *p = sum.part;
    return ((p[0] + p[4]) + (p[1] + p[5])) + ((p[2] + p[6]) + (p[3] + p[7]));
}

// Add the products of two rows whose length is a multiple of LANES.
inline void add_products(Parts *sum, const double *HS_RESTRICT a, const double *HS_RESTRICT b, Index count) {
    double part[LANES];
    for (Index l = 0; l < LANES; ++l) part[l] = sum->part[l];
    for (Index i = 0; i < count; i += LANES)
#pragma omp simd
        for (Index l = 0; l < LANES; ++l) part[l] += a[i + l] * b[i + l];
    for (Index l = 0; l < LANES; ++l) sum->part[l] = part[l];
}

inline void add(Parts *sum, const double *HS_RESTRICT a, Index count) {
    double part[LANES];
    for (Index l = 0; l < LANES; ++l) part[l] = sum->part[l];
    for (Index i = 0; i < count; i += LANES)
#pragma omp simd
        for (Index l = 0; l < LANES; ++l) part[l] += a[i + l];
    for (Index l = 0; l < LANES; ++l) sum->part[l] = part[l];
}

inline double sum_of(const float *values, Index count) {
    constexpr Index WIDE = 16;
    float part[WIDE] = {};
    Index i = 0;
    for (; i + WIDE <= count; i += WIDE)
#pragma omp simd
        for (Index l = 0; l < WIDE; ++l) part[l] += values[i + l];
    for (Index l = 0; l < count - i; ++l) part[l] += values[i + l];
    double sum = 0.0;
    for (Index l = 0; l < WIDE; ++l) sum += part[l];
    return sum;
}

// The value below which `share` of so many values lies; their order is destroyed.
inline float select(float *values, Index count, double share) {
    Index low = 0, high = count - 1;
    const auto middle = static_cast<Index>(share * static_cast<double>(count));
    while (low < high) {
        const float pivot = values[middle];
        Index i = low, j = high;
        while (i <= j) {
            while (values[i] < pivot) ++i;
            while (values[j] > pivot) --j;
            if (i > j) break;
            const float held = values[i];
            values[i++] = values[j];
            values[j--] = held;
        }
        if (j < middle) low = i;
        if (i > middle) high = j;
    }
    return values[middle];
}

} // namespace
} // namespace hs
