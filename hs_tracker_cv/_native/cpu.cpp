// cpuid is read here rather than by __builtin_cpu_supports, which answers 0 to everything in binaries made by zig.
#include "cpu.hpp"

#if defined(__x86_64__) || defined(_M_X64)
#include <cstdint>
#include <initializer_list>
#ifdef _MSC_VER
#include <immintrin.h>
#include <intrin.h>
#else
#include <cpuid.h>
#endif

namespace hs {
namespace {

struct Registers {
    std::uint32_t a, b, c, d;
};

Registers cpuid(std::uint32_t leaf) {
    Registers r{};
#ifdef _MSC_VER
    int values[4];
    __cpuid(values, 0);
    const bool extended = leaf >= 0x80000000u;
    if (extended) __cpuid(values, 0x80000000);
    if (static_cast<std::uint32_t>(values[0]) < leaf) return r;
    __cpuidex(values, static_cast<int>(leaf), 0);
    r = {std::uint32_t(values[0]), std::uint32_t(values[1]), std::uint32_t(values[2]), std::uint32_t(values[3])};
#else
    if (!__get_cpuid_count(leaf, 0, &r.a, &r.b, &r.c, &r.d)) return Registers{};
#endif
    return r;
}

// The register states that the operating system saves.
std::uint64_t saved_states() {
#ifdef _MSC_VER
    return _xgetbv(0);
#else
    std::uint32_t low, high;
    __asm__("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return std::uint64_t(high) << 32 | low;
#endif
}

bool has(std::uint32_t value, std::initializer_list<int> bits) {
    for (const int bit : bits)
        if (!(value >> bit & 1)) return false;
    return true;
}

} // namespace

int cpu_level() {
    const Registers basic = cpuid(1), more = cpuid(7), extended = cpuid(0x80000001u);
    // SSE3, SSSE3, CMPXCHG16B, SSE4.1, SSE4.2, POPCNT; LAHF
    if (!has(basic.c, {0, 9, 13, 19, 20, 23}) || !has(extended.c, {0})) return 0;
    // FMA, MOVBE, OSXSAVE, AVX, F16C; BMI1, AVX2, BMI2; LZCNT; and the states of SSE and AVX
    if (!has(basic.c, {12, 22, 27, 28, 29}) || !has(more.b, {3, 5, 8}) || !has(extended.c, {5})) return 2;
    const std::uint64_t states = saved_states();
    if ((states & 0x06) != 0x06) return 2;
    // AVX512F, DQ, CD, BW, VL; and its states
    if (!has(more.b, {16, 17, 28, 30, 31}) || (states & 0xe0) != 0xe0) return 3;
    return 4;
}

} // namespace hs

#else

namespace hs {

int cpu_level() { return 1; }

} // namespace hs

#endif
