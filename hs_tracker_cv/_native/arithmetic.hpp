// Arithmetic that gives the same bits at every level: kernels call no C function, and the order of sums is fixed.
//
// This header is compiled for every level: static functions only, see planes.hpp.
#pragma once

#include "planes.hpp"

namespace hs {

// Sums are of so many numbers side by side, which are added in pairs at the end.
constexpr Index LANES = 8;

static inline double total(const double *lanes) {
    return ((lanes[0] + lanes[1]) + (lanes[2] + lanes[3])) + ((lanes[4] + lanes[5]) + (lanes[6] + lanes[7]));
}

// Sum of term(0), …, term(count - 1).
template <class Term> static inline double sum(Index count, Term term) {
    double lanes[LANES] = {};
    Index i = 0;
    for (; i + LANES <= count; i += LANES) {
#pragma omp simd
        for (Index l = 0; l < LANES; ++l) lanes[l] += term(i + l);
    }
    for (Index l = 0; i + l < count; ++l) lanes[l] += term(i + l);
    return total(lanes);
}

static inline double larger(double a, double b) { return a > b ? a : b; } // b where a is not a number
static inline double smaller(double a, double b) { return a < b ? a : b; }
static inline double within(double value, double low, double high) { return smaller(larger(value, low), high); }
static inline Index clamp(Index value, Index low, Index high) {
    return value < low ? low : value > high ? high : value;
}

// exp(-x) of a number that is not negative.
static inline double decay(double x) {
    const double y = -smaller(x, 700.0) * (1.0 / 1024.0);
    const double high = 1.0 / 24 + y * (1.0 / 120 + y * (1.0 / 720 + y / 5040));
    double power = 1.0 + y * (1.0 + y * (1.0 / 2 + y * (1.0 / 6 + y * high)));
    for (int k = 0; k < 10; ++k) power *= power;
    return power;
}

} // namespace hs
