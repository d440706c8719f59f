"""The numerical core, in Numba: one memory in, one memory out; no checks, no options, no allocation.

All planes live in one flat float32 array, the workspace `m`, and a plane is named by the index of its first element:
cutting array views would cost more to compile than all the arithmetic, and time at every call. A plane holds h × w
pixels with a ring of two pixels round them: pixel (y, x) is element (y + 2) (w + 4) + x + 2. The ring, filled by
:func:`pad` or :func:`edge`, lets each loop run without a branch at the border. Indices are unsigned, since Numba
then leaves out Python's wrap-around of negative ones, which keeps loops from being vectorised; so every constant
that meets an index is a uint64 as well. Literals as arguments would have a function compiled once more for each.

Symbols are those of Horn & Schunck (1981, doi:10.1016/0004-3702(81)90024-2): derivatives F_x, F_y, F_t, flow (u, v).
"""

# Types come from the calls: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

__all__ = [
    "FLOW_PLANES",
    "GRID_PLANES",
    "SOLVE_PLANES",
    "coarse_to_fine",
    "full_multigrid",
    "write_derivatives",
]

ZERO = np.uint64(0)
ONE = np.uint64(1)
TWO = np.uint64(2)
THREE = np.uint64(3)
FOUR = np.uint64(4)
FIVE = np.uint64(5)
NINE = np.uint64(9)
NO = np.bool_(False)

CHUNK = np.uint64(8)
"""Chebyshev sweeps between two looks at the residual."""

RADIUS = np.float32(0.97)
"""Upper end of the spectrum that Chebyshev's weights are made for; what is slower, coarser grids have done."""

FAST = {"contract", "nsz"}  # reassociation would break "identical frames give exactly zero"
INNER: dict[str, Any] = {
    "nogil": True,
    "no_cpython_wrapper": True,
    "no_cfunc_wrapper": True,
    "fastmath": FAST,
    "error_model": "numpy",
}
SUMMING: dict[str, Any] = {**INNER, "fastmath": FAST | {"reassoc"}}
# Only what Python calls is cached: its machine code holds the inner functions too.
OUTER: dict[str, Any] = {
    "cache": True,
    "nogil": True,
    "no_cfunc_wrapper": True,
    "fastmath": FAST,
    "error_model": "numpy",
}

FLOW_PLANES = 9
"""Full-size planes that :func:`coarse_to_fine` needs, beside the pyramid and two rows."""

SOLVE_PLANES = 12
"""Full-size planes that :func:`full_multigrid` needs (the twelfth for one row)."""

GRID_PLANES = 9
"""Planes that :func:`full_multigrid` needs for each coarse grid."""


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
def normalise(m, fx, fy, ft, mask, u, v, lam, outlier, h, w):
    """Turn derivatives into the sweep's coefficients g = √m F / √(λ² + m (F_x² + F_y²)), in place.

    The data term is linearised about (u, v), so that the sweep solves for the whole flow. Its weight is
    m = mask / (1 + `outlier` F_t²): pixels that the flow so far does not explain count less (Lorentzian weights).
    """
    lam2 = lam * lam
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            x_slope = m[fx + k]
            y_slope = m[fy + k]
            weight = m[mask + k] / (np.float32(1.0) + outlier * m[ft + k] * m[ft + k])
            scale = np.sqrt(weight / (lam2 + weight * (x_slope * x_slope + y_slope * y_slope)))
            m[ft + k] = (m[ft + k] - x_slope * m[u + k] - y_slope * m[v + k]) * scale
            m[fx + k] = x_slope * scale
            m[fy + k] = y_slope * scale


@njit(**INNER)
def sweep(m, u, v, un, vn, gx, gy, gt, c_old, c_here, c_jacobi, h, w):
    """Do one sweep of the paper: new = c_old · new + c_here · (u, v) + c_jacobi · Jacobi(u, v)."""
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
        if i == ZERO:
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


@intrinsic
def bicubic_at(typing_context: Any, m: Any, k: Any, stride: Any, tx: Any, ty: Any) -> Any:
    """Interpolate the 4 × 4 pixels whose first is element k, at the fractions (tx, ty) between the inner ones.

    Keys' kernel (a = −1/2) on four-element vectors: written in scalars, it takes twice as long.
    """
    vector = ir.VectorType(ir.FloatType(), 4)
    cubics = ((-0.5, 1.5, -1.5, 0.5), (1.0, -2.5, 2.0, -0.5), (-0.5, 0.0, 0.5, 0.0), (0.0, 1.0, 0.0, 0.0))
    flags = ["contract"]

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        data = make_array(signature.args[0])(context, builder, arguments[0]).data
        none = ir.Constant(vector, ir.Undefined)

        def lanes(a: Any, *order: int) -> Any:
            return builder.shuffle_vector(a, none, ir.Constant(ir.VectorType(ir.IntType(32), 4), order))

        def multiply_add(a: Any, b: Any, c: Any) -> Any:
            return builder.fadd(builder.fmul(a, b, flags=flags), c, flags=flags)

        def weights(t: Any) -> Any:
            t = lanes(builder.insert_element(none, t, ir.Constant(ir.IntType(32), 0)), 0, 0, 0, 0)
            value = ir.Constant(vector, cubics[0])
            for powers in cubics[1:]:
                value = multiply_add(value, t, ir.Constant(vector, powers))
            return value

        down = weights(arguments[4])
        column = ir.Constant(vector, (0.0,) * 4)
        at = arguments[1]
        for i in range(4):
            pixels = builder.bitcast(cgutils.gep_inbounds(builder, data, at), vector.as_pointer())
            column = multiply_add(builder.load(pixels, align=4), lanes(down, i, i, i, i), column)
            at = builder.add(at, arguments[2])
        total = builder.fmul(column, weights(arguments[3]))
        total = builder.fadd(total, lanes(total, 2, 3, 0, 1))
        total = builder.fadd(total, lanes(total, 1, 0, 3, 2))
        return builder.extract_element(total, ir.Constant(ir.IntType(32), 0))

    return types.float32(m, types.uint64, types.uint64, types.float32, types.float32), emit


@njit(**INNER)
def warp(m, b, u, v, warped, mask, h, w):
    """Sample plane `b` at (x + u, y + v), bicubic; outside the frame take its border and mask 0."""
    zero = np.float32(0.0)
    one = np.float32(1.0)
    s = w + FOUR
    right = np.float32(w - ONE)
    bottom = np.float32(h - ONE)
    for y in range(h):
        k = (y + TWO) * s + TWO
        for x in range(w):
            px = np.float32(x) + m[u + k + x]
            py = np.float32(y) + m[v + k + x]
            m[mask + k + x] = one if px >= zero and px <= right and py >= zero and py <= bottom else zero
            px = min(px if px > zero else zero, right)
            py = min(py if py > zero else zero, bottom)
            j = np.int64(px)
            i = np.int64(py)
            first = b + (np.uint64(i) + ONE) * s + np.uint64(j) + ONE
            m[warped + k + x] = bicubic_at(m, first, s, px - np.float32(j), py - np.float32(i))
    pad(m, warped, h, w)


def median_of(radius: int) -> Any:
    """Intrinsic that reads the (2 radius + 1)² neighbours of element k and returns their median.

    It emits Batcher's odd-even merge sort as straight-line code; LLVM drops the exchanges that the middle element
    does not need and vectorises the rest. Written as Python calls of min and max, it would take seconds to compile.
    """

    @intrinsic
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
        if size == THREE:
            for k in range(row, row + w):
                m[k + d] = median_3x3_at(m, k, s)
        else:
            for k in range(row, row + w):
                m[k + d] = median_5x5_at(m, k, s)
    pad(m, b, h, w)


@njit(**OUTER)
def coarse_to_fine(
    frame0,
    frame1,
    flow,
    started,
    sizes,
    m,
    plain,
    five,
    warps,
    iterations,
    rho,
    median,
    lam,
    outlier,
    p0,
    p1,
    p2,
    c0,
    c1,
    c2,
):
    """Estimate the flow level by level, the coarsest first; `flow` holds the start field and takes the result.

    `sizes` is (levels, 2): height and width of each level, the finest first. With a start field each level warps
    by its reduced copy plus the increment found so far, so its detail is not lost on the way through the levels.

    `plain`: the paper's own method on one level: nothing is warped, and the data term stays linearised about zero.
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
    load(m, frame0, ZERO, u)
    resample(m, u, h, w, pyramid, h, w, one, p0, p1, p2, row)
    load(m, frame1, ZERO, u)
    resample(m, u, h, w, pyramid + size, h, w, one, p0, p1, p2, row)
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
            resample(
                m, pyramid + i * size, h, w, coarse + i * (hc + FOUR) * (wc + FOUR), hc, wc, gain, c0, c1, c2, row
            )
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
            for _ in range(TWO):
                resample(m, u, hc, wc, un, h, w, gain, one, zero, zero, row)
                gain = np.float32(h) / np.float32(hc)
                u, v, un, vn = v, un, vn, u  # after both turns: new u, new v, old u, old v
        if started:
            add(m, u, pyramid + TWO * size, one, h, w)
            add(m, v, pyramid + THREE * size, one, h, w)
        for _ in range(warps):
            second = pyramid + size
            about_u = u
            about_v = v
            if plain:
                about_u = un
                about_v = vn
                fill(m, mask, one, h, w)
                fill(m, un, zero, h, w)
                fill(m, vn, zero, h, w)
            else:
                warp(m, second, u, v, warped, mask, h, w)
                second = warped
            differentiate(m, pyramid, second, fx, fy, ft, five, h, w)
            normalise(m, fx, fy, ft, mask, about_u, about_v, lam, outlier, h, w)
            sweeps(m, u, v, un, vn, fx, fy, ft, iterations, rho, h, w)
            if iterations % TWO == ONE:
                u, v, un, vn = un, vn, u, v
            if median > ONE:
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


@njit(**INNER)
def restrict_product(m, p, q, h, w, coarse, factor, hc, wc):
    """Sum `factor` · p · q over 2 × 2 pixels; outside the plane is zero, or the system would lose its symmetry."""
    s = w + FOUR
    bottom = p + (h + TWO) * s
    for x in range(s):
        m[bottom + x] = np.float32(0.0)
    for y in range(h + THREE):
        m[p + y * s + w + TWO] = np.float32(0.0)
    d = q - p
    for y in range(hc):
        k = p + (y + y + TWO) * s + TWO
        row = coarse + (y + TWO) * (wc + FOUR) + TWO
        for x in range(wc):
            i = k + x + x
            n = i + s
            m[row + x] = factor * (
                (m[i] * m[i + d] + m[i + ONE] * m[i + ONE + d]) + (m[n] * m[n + d] + m[n + ONE] * m[n + ONE + d])
            )


@njit(**INNER)
def restrict(m, p, h, w, coarse, hc, wc):
    """Sum plane `p` over 2 × 2 pixels (λ² falls by four, so the mean is multiplied by it); zero outside."""
    s = w + FOUR
    bottom = p + (h + TWO) * s
    for x in range(s):
        m[bottom + x] = np.float32(0.0)
    for y in range(h + THREE):
        m[p + y * s + w + TWO] = np.float32(0.0)
    for y in range(hc):
        k = p + (y + y + TWO) * s + TWO
        row = coarse + (y + TWO) * (wc + FOUR) + TWO
        for x in range(wc):
            i = k + x + x
            m[row + x] = (m[i] + m[i + ONE]) + (m[i + s] + m[i + s + ONE])


@njit(**INNER)
def prolong(m, coarse, hc, wc, p, h, w, row):
    """Add to plane `p` the bilinear interpolation of a coarse plane: weights (9, 3, 3, 1) / 16."""
    s = w + FOUR
    sc = wc + FOUR
    near = np.float32(0.75)
    far = np.float32(0.25)
    for y in range(h):
        centre = coarse + (y // TWO + TWO) * sc
        other = centre + sc if y % TWO == ONE else centre - sc
        for x in range(ONE, wc + THREE):
            m[row + x] = near * m[centre + x] + far * m[other + x]
        k = p + (y + TWO) * s + TWO
        for x in range(wc):
            i = row + x + TWO
            m[k + x + x] += near * m[i] + far * m[i - ONE]
            m[k + x + x + ONE] += near * m[i] + far * m[i + ONE]
    edge(m, p, h, w)


@njit(**INNER)
def coarse_sweep(m, u, v, un, vn, j, b, h, w):
    """Write one Jacobi sweep of (u, v) on a coarse grid to (un, vn).

    The system is u − ū + J u = b with J = (jxx, jxy, jyy), three planes from `j`, and b two planes from `b`.
    """
    one = np.float32(1.0)
    sixth = np.float32(1.0 / 6.0)
    twelfth = np.float32(1.0 / 12.0)
    s = w + FOUR
    size = (h + FOUR) * s
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p = u + k
            n = p - s
            o = p + s
            ru = m[b + k] + (
                sixth * ((m[n] + m[o]) + (m[p - ONE] + m[p + ONE]))
                + twelfth * ((m[n - ONE] + m[n + ONE]) + (m[o - ONE] + m[o + ONE]))
            )
            q = v + k
            n = q - s
            o = q + s
            rv = m[b + size + k] + (
                sixth * ((m[n] + m[o]) + (m[q - ONE] + m[q + ONE]))
                + twelfth * ((m[n - ONE] + m[n + ONE]) + (m[o - ONE] + m[o + ONE]))
            )
            axx = one + m[j + k]
            axy = m[j + size + k]
            ayy = one + m[j + size + size + k]
            scale = one / (axx * ayy - axy * axy)
            m[un + k] = scale * (ayy * ru - axy * rv)
            m[vn + k] = scale * (axx * rv - axy * ru)
    edge(m, un, h, w)
    edge(m, vn, h, w)


@njit(**INNER)
def coarse_residual(m, u, v, un, vn, j, b, h, w):
    """Write the residual of (u, v) on a coarse grid to (un, vn).

    The system is u − ū + J u = b with J = (jxx, jxy, jyy), three planes from `j`, and b two planes from `b`.
    """
    one = np.float32(1.0)
    sixth = np.float32(1.0 / 6.0)
    twelfth = np.float32(1.0 / 12.0)
    s = w + FOUR
    size = (h + FOUR) * s
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p = u + k
            n = p - s
            o = p + s
            ru = m[b + k] + (
                sixth * ((m[n] + m[o]) + (m[p - ONE] + m[p + ONE]))
                + twelfth * ((m[n - ONE] + m[n + ONE]) + (m[o - ONE] + m[o + ONE]))
            )
            q = v + k
            n = q - s
            o = q + s
            rv = m[b + size + k] + (
                sixth * ((m[n] + m[o]) + (m[q - ONE] + m[q + ONE]))
                + twelfth * ((m[n - ONE] + m[n + ONE]) + (m[o - ONE] + m[o + ONE]))
            )
            axx = one + m[j + k]
            axy = m[j + size + k]
            ayy = one + m[j + size + size + k]
            m[un + k] = ru - (axx * m[p] + axy * m[q])
            m[vn + k] = rv - (axy * m[p] + ayy * m[q])


@njit(**SUMMING)
def fine_residual(m, u, v, ru, rv, fx, fy, ft, weight, h, w):
    """Write the residual of the paper's system over λ² to (ru, rv); `weight` is 1 / λ². Return its square sum."""
    sixth = np.float32(1.0 / 6.0)
    twelfth = np.float32(1.0 / 12.0)
    s = w + FOUR
    total = 0.0
    for y in range(TWO, h + TWO):
        partial = np.float32(0.0)
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
            t = weight * (m[fx + k] * m[p] + m[fy + k] * m[q] + m[ft + k])
            a = (ub - m[p]) - m[fx + k] * t
            b = (vb - m[q]) - m[fy + k] * t
            m[ru + k] = a
            m[rv + k] = b
            partial += a * a + b * b
        total += partial
    return total


@njit(**INNER)
def coarse_cycle(m, sizes, first, base, guessed, row):
    """Run one V(1, 1) cycle from level `first`, whose nine planes (J, b, u, v, un, vn) start at `base`.

    `guessed`: (u, v) of the first level hold a first guess; otherwise the cycle starts from zero.
    """
    zero = np.float32(0.0)
    top = np.uint64(sizes.shape[0]) - ONE
    for level in range(first, top):
        h = sizes[level, 0]
        w = sizes[level, 1]
        hc = sizes[level + ONE, 0]
        wc = sizes[level + ONE, 1]
        size = (h + FOUR) * (w + FOUR)
        b = base + THREE * size
        u = b + TWO * size
        v = u + size
        un = v + size
        vn = un + size
        if not guessed or level > first:
            fill(m, u, zero, h, w)
            fill(m, v, zero, h, w)
        coarse_sweep(m, u, v, un, vn, base, b, h, w)
        coarse_residual(m, un, vn, u, v, base, b, h, w)
        base = vn + size
        below = (hc + FOUR) * (wc + FOUR)
        restrict(m, u, h, w, base + THREE * below, hc, wc)
        restrict(m, v, h, w, base + FOUR * below, hc, wc)
    h = sizes[top, 0]
    w = sizes[top, 1]
    size = (h + FOUR) * (w + FOUR)
    u = base + FIVE * size
    fill(m, u, zero, h, w)
    fill(m, u + size, zero, h, w)
    for _ in range(FOUR):
        coarse_sweep(m, u, u + size, u + TWO * size, u + THREE * size, base, base + THREE * size, h, w)
        coarse_sweep(m, u + TWO * size, u + THREE * size, u, u + size, base, base + THREE * size, h, w)
    for i in range(top - first):
        level = top - ONE - i
        hc = h
        wc = w
        below = size
        coarse = base + FIVE * below
        h = sizes[level, 0]
        w = sizes[level, 1]
        size = (h + FOUR) * (w + FOUR)
        base -= NINE * size
        b = base + THREE * size
        u = b + TWO * size
        un = u + TWO * size
        for j in range(TWO):
            prolong(m, coarse + j * below, hc, wc, un + j * size, h, w, row)
        coarse_sweep(m, un, un + size, u, u + size, base, b, h, w)


@njit(**OUTER)
def full_multigrid(frame0, frame1, flow, started, sizes, m, five, lam, tolerance, most):
    """Solve the paper's linear system: full multigrid, then Chebyshev sweeps, then more cycles where those stall.

    Returns the residual over the right-hand side (2-norms) and the number of sweeps done on the finest grid.
    """
    zero = np.float32(0.0)
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
    gx = ft + size
    gy = gx + size
    gt = gy + size
    mask = gt + size
    row = mask + size
    coarsest = row + size
    weight = np.float32(1.0) / (lam * lam)
    load(m, frame0, ZERO, un)
    load(m, frame1, ZERO, vn)
    fill(m, u, zero, h, w)
    fill(m, v, zero, h, w)
    fill(m, mask, np.float32(1.0), h, w)
    differentiate(m, un, vn, fx, fy, ft, five, h, w)
    differentiate(m, un, vn, gx, gy, gt, five, h, w)
    normalise(m, gx, gy, gt, mask, u, v, lam, zero, h, w)
    goal = tolerance * np.sqrt(fine_residual(m, u, v, un, vn, fx, fy, ft, weight, h, w))
    if goal == 0.0:
        for c in range(TWO):
            store(m, u, flow, c)
        return 0.0, ZERO

    # The coarse systems; right-hand sides as well, which full multigrid starts from.
    top = np.uint64(sizes.shape[0]) - ONE
    base = coarsest
    if top > ZERO:
        hc = sizes[1, 0]
        wc = sizes[1, 1]
        below = (hc + FOUR) * (wc + FOUR)
        restrict_product(m, fx, fx, h, w, base, weight, hc, wc)
        restrict_product(m, fx, fy, h, w, base + below, weight, hc, wc)
        restrict_product(m, fy, fy, h, w, base + TWO * below, weight, hc, wc)
        restrict_product(m, ft, fx, h, w, base + THREE * below, -weight, hc, wc)
        restrict_product(m, ft, fy, h, w, base + FOUR * below, -weight, hc, wc)
    for level in range(ONE, top):
        below = (sizes[level, 0] + FOUR) * (sizes[level, 1] + FOUR)
        hc = sizes[level + ONE, 0]
        wc = sizes[level + ONE, 1]
        coarse = base + NINE * below
        for i in range(FIVE):
            restrict(
                m, base + i * below, sizes[level, 0], sizes[level, 1], coarse + i * (hc + FOUR) * (wc + FOUR), hc, wc
            )
        base = coarse

    if started:
        load(m, flow, ZERO, u)
        load(m, flow, ONE, v)
    else:
        for i in range(top):
            level = top - i
            coarse_cycle(m, sizes, level, base, i > ZERO, row)
            hc = sizes[level, 0]
            wc = sizes[level, 1]
            below = (hc + FOUR) * (wc + FOUR)
            source = base + FIVE * below
            hf = sizes[level - ONE, 0]
            wf = sizes[level - ONE, 1]
            fine = (hf + FOUR) * (wf + FOUR)
            target = u
            if level > ONE:
                base -= NINE * fine
                target = base + FIVE * fine
            for c in range(TWO):
                fill(m, target + c * fine, zero, hf, wf)
                prolong(m, source + c * below, hc, wc, target + c * fine, hf, wf, row)

    done = ZERO
    norm = 1e300
    while done < most and norm > goal:
        before = norm
        if top > ZERO:
            sweeps(m, u, v, un, vn, gx, gy, gt, ONE, zero, h, w)
            fine_residual(m, un, vn, u, v, fx, fy, ft, weight, h, w)
            hc = sizes[1, 0]
            wc = sizes[1, 1]
            below = (hc + FOUR) * (wc + FOUR)
            for c in range(TWO):
                restrict(m, u + c * size, h, w, coarsest + (THREE + c) * below, hc, wc)
            coarse_cycle(m, sizes, ONE, coarsest, NO, row)
            for c in range(TWO):
                prolong(m, coarsest + (FIVE + c) * below, hc, wc, un + c * size, h, w, row)
            sweeps(m, un, vn, u, v, gx, gy, gt, ONE, zero, h, w)
            done += TWO
        last = norm
        norm = np.sqrt(fine_residual(m, u, v, un, vn, fx, fy, ft, weight, h, w))
        while norm > goal and norm < 0.3 * last and done < most:
            sweeps(m, u, v, un, vn, gx, gy, gt, CHUNK, RADIUS, h, w)
            done += CHUNK
            last = norm
            norm = np.sqrt(fine_residual(m, u, v, un, vn, fx, fy, ft, weight, h, w))
        if norm > 0.9 * before:  # as good as float32 gets
            break
    store(m, u, flow, ZERO)
    store(m, v, flow, ONE)
    return tolerance * norm / goal, done
