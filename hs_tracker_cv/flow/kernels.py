"""The numerical core, in Numba: one memory in, one memory out; no checks, no options, no allocation.

All planes live in one flat float32 array, the workspace `m`, and a plane is named by the index of its first element:
cutting array views would cost more to compile than all the arithmetic, and time at every call. A plane holds h × w
pixels with a ring of two pixels round them: pixel (y, x) is element (y + 2) (w + 4) + x + 2. The ring, filled by
:func:`pad` or :func:`edge`, lets each loop run without a branch at the border. Indices are unsigned, since Numba then
leaves out Python's wrap-around of negative ones, which keeps loops from being vectorised; so every constant that meets
an index is a uint64 as well.

Symbols are those of Horn & Schunck (1981, doi:10.1016/0004-3702(81)90024-2): derivatives F_x, F_y, F_t, flow (u, v).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

__all__ = ["FLOW_PLANES", "coarse_to_fine", "jacobi", "write_derivatives"]

ZERO = np.uint64(0)
ONE = np.uint64(1)
TWO = np.uint64(2)
THREE = np.uint64(3)
FOUR = np.uint64(4)
FIVE = np.uint64(5)

FAST = {"contract", "nsz"}  # reassociation would break "identical frames give exactly zero"
INNER = {"nogil": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "fastmath": FAST}
# Only what Python calls is cached: its machine code holds the inner functions too.
OUTER = {"cache": True, "nogil": True, "no_cfunc_wrapper": True, "fastmath": FAST}

FLOW_PLANES = 9
"""Full-size planes that :func:`coarse_to_fine` and :func:`jacobi` need beside the pyramid."""


@njit(**INNER)
def edge(m, a, h, w):
    """Replicate the border pixels of plane `a` one pixel outwards: all that the averaging stencil reads."""
    s = w + FOUR
    for y in range(TWO, h + TWO):
        row = a + y * s
        m[row + ONE] = m[row + TWO]
        m[row + w + TWO] = m[row + w + ONE]
    bottom = a + (h + TWO) * s
    for x in range(ONE, w + THREE):
        m[a + s + x] = m[a + s + s + x]
        m[bottom + x] = m[bottom - s + x]


@njit(**INNER)
def pad(m, a, h, w):
    """Replicate the border pixels of plane `a` into its whole ring."""
    edge(m, a, h, w)
    s = w + FOUR
    for y in range(ONE, h + THREE):
        row = a + y * s
        m[row] = m[row + ONE]
        m[row + w + THREE] = m[row + w + TWO]
    bottom = a + (h + THREE) * s
    for x in range(s):
        m[a + x] = m[a + s + x]
        m[bottom + x] = m[bottom - s + x]


@njit(**INNER)
def load(m, image, channel, a):
    """Copy one channel of an (h, w, channels) image into plane `a`; what is not finite becomes 0."""
    h = np.uint64(image.shape[0])
    w = np.uint64(image.shape[1])
    limit = np.float32(1e30)
    for y in range(h):
        row = a + (y + TWO) * (w + FOUR) + TWO
        for x in range(w):
            value = image[y, x, channel]
            m[row + x] = value if abs(value) < limit else np.float32(0.0)
    pad(m, a, h, w)


@njit(**INNER)
def store(m, a, image, channel):
    """Copy plane `a` into one channel of an (h, w, channels) image."""
    h = np.uint64(image.shape[0])
    w = np.uint64(image.shape[1])
    for y in range(h):
        row = a + (y + TWO) * (w + FOUR) + TWO
        for x in range(w):
            image[y, x, channel] = m[row + x]


@njit(**INNER)
def fill(m, a, value, h, w):
    """Set plane `a`, ring and all."""
    for k in range(a, a + (h + FOUR) * (w + FOUR)):
        m[k] = value


@njit(**INNER)
def add(m, a, b, factor, h, w):
    """Add `factor` times plane `b` to plane `a`, rings and all."""
    d = b - a
    for k in range(a, a + (h + FOUR) * (w + FOUR)):
        m[k] += factor * m[k + d]


@njit(**INNER)
def cube(m, a, b, fx, fy, ft, h, w):
    """Average four first differences over the 2 × 2 × 2 cube (step 3 of the paper)."""
    quarter = np.float32(0.25)
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            a00 = m[a + k]
            a01 = m[a + k + ONE]
            a10 = m[a + k + s]
            a11 = m[a + k + s + ONE]
            b00 = m[b + k]
            b01 = m[b + k + ONE]
            b10 = m[b + k + s]
            b11 = m[b + k + s + ONE]
            m[fx + k] = quarter * (((a01 - a00) + (a11 - a10)) + ((b01 - b00) + (b11 - b10)))
            m[fy + k] = quarter * (((a10 - a00) + (a11 - a01)) + ((b10 - b00) + (b11 - b01)))
            m[ft + k] = quarter * (((b00 - a00) + (b01 - a01)) + ((b10 - a10) + (b11 - a11)))


@njit(**INNER)
def five_tap(m, a, b, fx, fy, ft, h, w):
    """Take the central differences of Barron, Fleet & Beauchemin (1994) on the mean of both frames; F_t = b − a."""
    near = np.float32(8.0 / 24.0)
    far = np.float32(1.0 / 24.0)
    s = w + FOUR
    d = s + s
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p = a + k
            q = b + k
            m[fx + k] = near * ((m[p + ONE] - m[p - ONE]) + (m[q + ONE] - m[q - ONE])) - far * (
                (m[p + TWO] - m[p - TWO]) + (m[q + TWO] - m[q - TWO])
            )
            m[fy + k] = near * ((m[p + s] - m[p - s]) + (m[q + s] - m[q - s])) - far * (
                (m[p + d] - m[p - d]) + (m[q + d] - m[q - d])
            )
            m[ft + k] = m[q] - m[p]


@njit(**INNER)
def differentiate(m, a, b, fx, fy, ft, five, h, w):
    """Take the derivatives of frames `a` and `b` by the 5-tap mask or the 2 × 2 × 2 cube."""
    if five:
        five_tap(m, a, b, fx, fy, ft, h, w)
    else:
        cube(m, a, b, fx, fy, ft, h, w)


@njit(**INNER)
def normalise(m, fx, fy, ft, mask, u, v, lam, h, w):
    """Turn derivatives into the sweep's coefficients g = F / √(λ² + F_x² + F_y²), in place.

    The data term is linearised about (u, v), so that the sweep solves for the whole flow; `mask` switches it off.
    """
    lam2 = lam * lam
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            x_slope = m[fx + k]
            y_slope = m[fy + k]
            scale = m[mask + k] / np.sqrt(lam2 + (x_slope * x_slope + y_slope * y_slope))
            m[ft + k] = (m[ft + k] - x_slope * m[u + k] - y_slope * m[v + k]) * scale
            m[fx + k] = x_slope * scale
            m[fy + k] = y_slope * scale


@njit(**INNER)
def sweep(m, u, v, un, vn, gx, gy, gt, c_old, c_here, c_jacobi, h, w):
    """Do one sweep: new = c_old · new + c_here · (u, v) + c_jacobi · Jacobi(u, v), with the equations of the paper."""
    sixth = np.float32(1.0 / 6.0)
    twelfth = np.float32(1.0 / 12.0)
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p = u + k
            n = p - s
            o = p + s
            ub = sixth * ((m[n] + m[o]) + (m[p - ONE] + m[p + ONE])) + twelfth * (
                (m[n - ONE] + m[n + ONE]) + (m[o - ONE] + m[o + ONE])
            )
            q = v + k
            n = q - s
            o = q + s
            vb = sixth * ((m[n] + m[o]) + (m[q - ONE] + m[q + ONE])) + twelfth * (
                (m[n - ONE] + m[n + ONE]) + (m[o - ONE] + m[o + ONE])
            )
            t = m[gx + k] * ub + m[gy + k] * vb + m[gt + k]
            m[un + k] = c_old * m[un + k] + c_here * m[p] + c_jacobi * (ub - m[gx + k] * t)
            m[vn + k] = c_old * m[vn + k] + c_here * m[q] + c_jacobi * (vb - m[gy + k] * t)
    edge(m, un, h, w)
    edge(m, vn, h, w)


@njit(**INNER)
def sweeps(m, u, v, un, vn, gx, gy, gt, iterations, rho, h, w):
    """Run `iterations` sweeps: plain Jacobi for `rho` 0, else with Chebyshev's weights for a spectrum in [−1/3, ρ].

    Planes (u, v) and (un, vn) take turns: the result is in (u, v) when `iterations` is even, else in (un, vn).
    """
    one = np.float32(1.0)
    relax = one
    radius = np.float32(0.0)
    if rho > radius:
        low = np.float32(-1.0 / 3.0)
        relax = np.float32(2.0) / (np.float32(2.0) - low - rho)
        radius = (rho - low) / (np.float32(2.0) - low - rho)
    quarter = np.float32(0.25) * radius * radius
    omega = one
    for i in range(iterations):
        sweep(m, u, v, un, vn, gx, gy, gt, one - omega, omega * (one - relax), omega * relax, h, w)
        u, un = un, u
        v, vn = vn, v
        if i == 0:
            omega = one / (one - quarter - quarter)
        else:
            omega = one / (one - quarter * omega)


@njit(**INNER)
def resample(m, a, h, w, b, hb, wb, gain, c0, c1, c2, row):
    """Resize plane `a` to plane `b` (centre-aligned, bilinear), times `gain`, after a blur by (c2, c1, c0, c1, c2).

    Only rows and columns that are used are blurred. `row` names room for two rows of `a`.
    """
    s = w + FOUR
    half = np.float32(0.5)
    start = np.float32(1.5)  # half a pixel less than the ring
    step_y = np.float32(h) / np.float32(hb)
    step_x = np.float32(w) / np.float32(wb)
    out = row + s
    for y in range(hb):
        p = (np.float32(y) + half) * step_y + start
        i = np.uint64(np.int64(p))
        f = (p - np.float32(i)) * gain
        g = gain - f
        k = a + i * s
        if c1 == np.float32(0.0):
            for x in range(s):
                m[out + x] = g * m[k + x] + f * m[k + s + x]
        else:
            k -= s + s
            t0 = g * c2
            t1 = g * c1 + f * c2
            t2 = g * c0 + f * c1
            t3 = g * c1 + f * c0
            t4 = g * c2 + f * c1
            t5 = f * c2
            for x in range(s):
                q = k + x
                m[row + x] = (t0 * m[q] + t1 * m[q + s] + t2 * m[q + TWO * s]) + (
                    t3 * m[q + THREE * s] + t4 * m[q + FOUR * s] + t5 * m[q + FIVE * s]
                )
            for q in range(row + TWO, row + TWO + w):
                m[q + s] = c0 * m[q] + c1 * (m[q - ONE] + m[q + ONE]) + c2 * (m[q - TWO] + m[q + TWO])
        k = b + (y + TWO) * (wb + FOUR) + TWO
        for x in range(wb):
            p = (np.float32(x) + half) * step_x + start
            j = np.uint64(np.int64(p))
            left = m[out + j]
            m[k + x] = left + (p - np.float32(j)) * (m[out + j + ONE] - left)
    pad(m, b, hb, wb)


@njit(**INNER)
def warp(m, a, b, u, v, warped, mask, h, w):
    """Sample plane `b` at (x + u, y + v) with Keys' bicubic kernel (−1/2); outside the frame take `a` and mask 0."""
    zero = np.float32(0.0)
    one = np.float32(1.0)
    half = np.float32(0.5)
    c2 = np.float32(2.5)
    c3 = np.float32(1.5)
    s = w + FOUR
    right = np.float32(w - ONE)
    bottom = np.float32(h - ONE)
    for y in range(h):
        k = (y + TWO) * s + TWO
        for x in range(w):
            px = np.float32(x) + m[u + k + x]
            py = np.float32(y) + m[v + k + x]
            if px >= zero and px <= right and py >= zero and py <= bottom:
                j = np.uint64(np.int64(px))
                i = np.uint64(np.int64(py))
                t = px - np.float32(j)
                r = one - t
                x0 = -half * t * r * r
                x1 = one - t * t * (c2 - c3 * t)
                x2 = one - r * r * (c2 - c3 * r)
                x3 = -half * r * t * t
                t = py - np.float32(i)
                r = one - t
                n0 = b + (i + ONE) * s + j + ONE
                n1 = n0 + s
                n2 = n1 + s
                n3 = n2 + s
                m[warped + k + x] = (
                    -half * t * r * r * (x0 * m[n0] + x1 * m[n0 + ONE] + x2 * m[n0 + TWO] + x3 * m[n0 + THREE])
                    + (one - t * t * (c2 - c3 * t))
                    * (x0 * m[n1] + x1 * m[n1 + ONE] + x2 * m[n1 + TWO] + x3 * m[n1 + THREE])
                    + (one - r * r * (c2 - c3 * r))
                    * (x0 * m[n2] + x1 * m[n2 + ONE] + x2 * m[n2 + TWO] + x3 * m[n2 + THREE])
                    - half * r * t * t * (x0 * m[n3] + x1 * m[n3 + ONE] + x2 * m[n3 + TWO] + x3 * m[n3 + THREE])
                )
                m[mask + k + x] = one
            else:
                m[warped + k + x] = m[a + k + x]
                m[mask + k + x] = zero
    pad(m, warped, h, w)


def median_of(radius: int) -> Any:
    """Intrinsic that reads the (2 radius + 1)² neighbours of element k and returns their median.

    It emits Batcher's odd-even merge sort as straight-line code; LLVM drops the exchanges that the middle element
    does not need and vectorises the rest. Written as Python calls of min and max, it would take seconds to compile.
    """

    @intrinsic  # type: ignore[untyped-decorator]
    def median_at(typing_context: Any, m: Any, k: Any, stride: Any) -> Any:
        def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            data = make_array(signature.args[0])(context, builder, arguments[0]).data
            values = []
            for dy in range(-radius, radius + 1):
                row = builder.add(arguments[1], builder.mul(arguments[2], ir.Constant(ir.IntType(64), dy)))
                for dx in range(-radius, radius + 1):
                    at = builder.add(row, ir.Constant(ir.IntType(64), dx))
                    values.append(builder.load(cgutils.gep_inbounds(builder, data, at)))
            for i, j in merge_sort_exchanges(len(values)):
                low, high = values[i], values[j]
                less = builder.fcmp_ordered("<", low, high)
                values[i] = builder.select(less, low, high)
                values[j] = builder.select(less, high, low)
            return values[len(values) // 2]

        return types.float32(m, types.uint64, types.uint64), emit

    return median_at


def merge_sort_exchanges(n: int) -> list[tuple[int, int]]:
    """Compare-exchange pairs of Batcher's odd-even merge sort of n values (Knuth, vol. 3, algorithm 5.2.2M)."""
    pairs = []
    p = top = 1 << (n - 1).bit_length() - 1
    while p:
        q, r, d = top, 0, p
        while True:
            pairs += [(i, i + d) for i in range(n - d) if i & p == r]
            if q == p:
                break
            d, q, r = q - p, q >> 1, p
        p >>= 1
    return pairs


median_3x3_at = median_of(1)
median_5x5_at = median_of(2)


@njit(**INNER)
def median_filter(m, a, b, size, h, w):
    """Write the median of plane `a` over `size` × `size` pixels (3 or 5) to plane `b`."""
    pad(m, a, h, w)
    s = w + FOUR
    d = b - a
    for y in range(TWO, h + TWO):
        row = a + y * s + TWO
        if size == 3:
            for k in range(row, row + w):
                m[k + d] = median_3x3_at(m, k, s)
        else:
            for k in range(row, row + w):
                m[k + d] = median_5x5_at(m, k, s)
    pad(m, b, h, w)


@njit(**OUTER)
def coarse_to_fine(
    frame0, frame1, flow, started, sizes, m, five, warps, iterations, rho, median, lam, c0, c1, c2
):  # fmt: skip
    """Estimate the flow level by level, the coarsest first; `flow` holds the start field and takes the result.

    `sizes` is (levels, 2): height and width of each level, the finest first. With a start field each level warps
    by its reduced copy plus the increment found so far, so its detail is not lost on the way through the levels.
    """
    zero = np.float32(0.0)
    one = np.float32(1.0)
    h = sizes[0, 0]
    w = sizes[0, 1]
    size = (h + FOUR) * (w + FOUR)
    u = ZERO
    v = u + size
    un = v + size
    vn = un + size
    fx = vn + size
    fy = fx + size
    ft = fy + size
    warped = ft + size
    mask = warped + size
    row = mask + size
    pyramid = row + TWO * (w + FOUR)  # per level: frame 0, frame 1, start u, start v
    load(m, frame0, ZERO, pyramid)
    load(m, frame1, ZERO, pyramid + size)
    planes = TWO
    if started:
        planes = FOUR
        load(m, flow, ZERO, pyramid + TWO * size)
        load(m, flow, ONE, pyramid + THREE * size)

    top = np.uint64(sizes.shape[0]) - ONE
    for level in range(top):
        h = sizes[level, 0]
        w = sizes[level, 1]
        hc = sizes[level + ONE, 0]
        wc = sizes[level + ONE, 1]
        size = (h + FOUR) * (w + FOUR)
        coarse = pyramid + planes * size
        gain = one
        for i in range(planes):
            if i == TWO:
                gain = np.float32(wc) / np.float32(w)
            if i == THREE:
                gain = np.float32(hc) / np.float32(h)
            resample(m, pyramid + i * size, h, w, coarse + i * (hc + FOUR) * (wc + FOUR), hc, wc, gain, c0, c1, c2, row)
        pyramid = coarse

    for i in range(top + ONE):
        level = top - i
        h = sizes[level, 0]
        w = sizes[level, 1]
        size = (h + FOUR) * (w + FOUR)
        if i == ZERO:
            fill(m, u, zero, h, w)
            fill(m, v, zero, h, w)
        else:
            pyramid -= planes * size
            gain = np.float32(w) / np.float32(wc)
            for j in range(TWO):
                resample(m, u, hc, wc, un, h, w, gain, one, zero, zero, row)
                gain = np.float32(h) / np.float32(hc)
                u, v, un, vn = v, un, vn, u  # after both turns: new u, new v, old u, old v
        if started:
            add(m, u, pyramid + TWO * size, one, h, w)
            add(m, v, pyramid + THREE * size, one, h, w)
        for _ in range(warps):
            warp(m, pyramid, pyramid + size, u, v, warped, mask, h, w)
            differentiate(m, pyramid, warped, fx, fy, ft, five, h, w)
            normalise(m, fx, fy, ft, mask, u, v, lam, h, w)
            sweeps(m, u, v, un, vn, fx, fy, ft, iterations, rho, h, w)
            if iterations % 2 == 1:
                u, v, un, vn = un, vn, u, v
            if median > 1:
                median_filter(m, u, un, median, h, w)
                median_filter(m, v, vn, median, h, w)
                u, v, un, vn = un, vn, u, v
        if started and level > ZERO:
            add(m, u, pyramid + TWO * size, -one, h, w)
            add(m, v, pyramid + THREE * size, -one, h, w)
        hc = h
        wc = w
    store(m, u, flow, ZERO)
    store(m, v, flow, ONE)


@njit(**OUTER)
def write_derivatives(frame0, frame1, five, out, m):
    """Write F_x, F_y, F_t of two (h, w, 1) frames to `out`, (h, w, 3)."""
    h = np.uint64(frame0.shape[0])
    w = np.uint64(frame0.shape[1])
    size = (h + FOUR) * (w + FOUR)
    fx = TWO * size
    load(m, frame0, ZERO, ZERO)
    load(m, frame1, ZERO, size)
    differentiate(m, ZERO, size, fx, fx + size, fx + TWO * size, five, h, w)
    for i in range(THREE):
        store(m, fx + i * size, out, i)


@njit(**OUTER)
def jacobi(frame0, frame1, flow, m, five, iterations, lam):
    """Run the sweeps of the paper at full resolution, from the field in `flow`, which takes the result."""
    h = np.uint64(frame0.shape[0])
    w = np.uint64(frame0.shape[1])
    size = (h + FOUR) * (w + FOUR)
    u = ZERO
    v = u + size
    un = v + size
    vn = un + size
    fx = vn + size
    fy = fx + size
    ft = fy + size
    mask = ft + size
    load(m, frame0, ZERO, u)
    load(m, frame1, ZERO, v)
    differentiate(m, u, v, fx, fy, ft, five, h, w)
    fill(m, mask, np.float32(1.0), h, w)
    fill(m, u, np.float32(0.0), h, w)
    fill(m, v, np.float32(0.0), h, w)
    normalise(m, fx, fy, ft, mask, u, v, lam, h, w)
    load(m, flow, ZERO, u)
    load(m, flow, ONE, v)
    sweeps(m, u, v, un, vn, fx, fy, ft, iterations, np.float32(0.0), h, w)
    if iterations % 2 == 1:
        u, v = un, vn
    store(m, u, flow, ZERO)
    store(m, v, flow, ONE)
