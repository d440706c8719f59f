"""The numerical core, in Numba: arrays in, arrays out; no checks, no options, no allocation.

Every plane is a flat float32 array that holds h × w pixels with a ring of two pixels round them: pixel (y, x) is
element (y + 2) * (w + 4) + x + 2. The ring, filled by :func:`pad` or :func:`edge`, lets each loop run without a
branch at the border. Indices are unsigned, since Numba then leaves out Python's wrap-around of negative indices,
which costs the vectoriser a factor of eight; so every constant that meets an index is a uint64 too.

Symbols are those of Horn & Schunck (1981, doi:10.1016/0004-3702(81)90024-2).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

__all__ = ["RING", "coarse_to_fine", "derivatives_of", "jacobi"]

RING = 2
"""Pixels of border round every plane: the widest stencil (5-tap derivative, cubic warp, 5 × 5 median) needs 2."""

ONE = np.uint64(1)
TWO = np.uint64(2)
FOUR = np.uint64(4)
FAST = {"contract", "reassoc", "nsz"}  # NaN and infinity keep their meaning


@njit(cache=True, nogil=True)
def edge(a, h, w):
    """Replicate the border pixels of `a` one pixel outwards: all that the averaging stencil reads."""
    s = w + FOUR
    for y in range(TWO, h + TWO):
        a[y * s + ONE] = a[y * s + TWO]
        a[y * s + w + TWO] = a[y * s + w + ONE]
    for x in range(ONE, w + TWO + ONE):
        a[s + x] = a[TWO * s + x]
        a[(h + TWO) * s + x] = a[(h + ONE) * s + x]


@njit(cache=True, nogil=True)
def pad(a, h, w):
    """Replicate the border pixels of `a` into its whole ring."""
    edge(a, h, w)
    s = w + FOUR
    for y in range(ONE, h + TWO + ONE):
        a[y * s] = a[y * s + ONE]
        a[y * s + w + TWO + ONE] = a[y * s + w + TWO]
    for x in range(s):
        a[x] = a[s + x]
        a[(h + TWO + ONE) * s + x] = a[(h + TWO) * s + x]


@njit(cache=True, nogil=True)
def load(image, a):
    """Copy an (h, w) image into the plane `a` and fill its ring."""
    h = np.uint64(image.shape[0])
    w = np.uint64(image.shape[1])
    for y in range(h):
        i = (y + TWO) * (w + FOUR) + TWO
        for x in range(w):
            a[i + x] = image[y, x]
    pad(a, h, w)


@njit(cache=True, nogil=True, fastmath=FAST)
def cube(a, b, fx, fy, ft, h, w):
    """Average four first differences over the 2 × 2 × 2 cube (step 3 of the paper)."""
    q = np.float32(0.25)
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p00 = a[k] + b[k]
            p01 = a[k + ONE] + b[k + ONE]
            p10 = a[k + s] + b[k + s]
            p11 = a[k + s + ONE] + b[k + s + ONE]
            fx[k] = q * ((p01 - p00) + (p11 - p10))
            fy[k] = q * ((p10 - p00) + (p11 - p01))
            ft[k] = q * (
                ((b[k] - a[k]) + (b[k + ONE] - a[k + ONE])) + ((b[k + s] - a[k + s]) + (b[k + s + ONE] - a[k + s + ONE]))
            )


@njit(cache=True, nogil=True, fastmath=FAST)
def five_tap(a, b, fx, fy, ft, h, w):
    """Take the central differences of Barron, Fleet & Beauchemin (1994) on the mean of both frames; F_t = b − a."""
    near = np.float32(8.0 / 24.0)
    far = np.float32(1.0 / 24.0)
    s = w + FOUR
    d = s + s
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            fx[k] = near * ((a[k + ONE] + b[k + ONE]) - (a[k - ONE] + b[k - ONE])) - far * (
                (a[k + TWO] + b[k + TWO]) - (a[k - TWO] + b[k - TWO])
            )
            fy[k] = near * ((a[k + s] + b[k + s]) - (a[k - s] + b[k - s])) - far * (
                (a[k + d] + b[k + d]) - (a[k - d] + b[k - d])
            )
            ft[k] = b[k] - a[k]


@njit(cache=True, nogil=True, fastmath=FAST)
def normalise(fx, fy, ft, mask, u, v, lam2, h, w):
    """Turn derivatives into the sweep's coefficients g = F / √(λ² + F_x² + F_y²), in place.

    The data term is linearised about (u, v), so that the sweep solves for the whole flow; `mask` switches it off.
    """
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            x_slope = fx[k]
            y_slope = fy[k]
            scale = mask[k] / np.sqrt(lam2 + x_slope * x_slope + y_slope * y_slope)
            ft[k] = (ft[k] - x_slope * u[k] - y_slope * v[k]) * scale
            fx[k] = x_slope * scale
            fy[k] = y_slope * scale


@njit(cache=True, nogil=True, fastmath=FAST)
def sweep(u, v, un, vn, gx, gy, gt, omega, h, w):
    """Do one Jacobi sweep, accelerated by `omega`: new = (1 − ω) old new + ω Jacobi(u, v)."""
    sixth = np.float32(1.0 / 6.0)
    twelfth = np.float32(1.0 / 12.0)
    rest = np.float32(1.0) - omega
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            ub = sixth * ((u[k - s] + u[k + s]) + (u[k - ONE] + u[k + ONE])) + twelfth * (
                (u[k - s - ONE] + u[k - s + ONE]) + (u[k + s - ONE] + u[k + s + ONE])
            )
            vb = sixth * ((v[k - s] + v[k + s]) + (v[k - ONE] + v[k + ONE])) + twelfth * (
                (v[k - s - ONE] + v[k - s + ONE]) + (v[k + s - ONE] + v[k + s + ONE])
            )
            t = gx[k] * ub + gy[k] * vb + gt[k]
            un[k] = rest * un[k] + omega * (ub - gx[k] * t)
            vn[k] = rest * vn[k] + omega * (vb - gy[k] * t)
    edge(un, h, w)
    edge(vn, h, w)


@njit(cache=True, nogil=True)
def sweeps(u, v, un, vn, gx, gy, gt, iterations, rho, h, w):
    """Run `iterations` sweeps with Chebyshev's weights for a spectral radius `rho` (0: plain Jacobi).

    The result is in (u, v) when `iterations` is even, else in (un, vn).
    """
    omega = np.float32(1.0)
    quarter = rho * rho * np.float32(0.25)
    for i in range(iterations):
        if i % 2 == 0:
            sweep(u, v, un, vn, gx, gy, gt, omega, h, w)
        else:
            sweep(un, vn, u, v, gx, gy, gt, omega, h, w)
        omega = np.float32(1.0) / (np.float32(1.0) - quarter * omega * (np.float32(2.0) if i == 0 else np.float32(1.0)))


@njit(cache=True, nogil=True, fastmath=FAST)
def resample(a, h, w, b, hb, wb, gain, taps, row, blurred):
    """Bilinear, centre-aligned resize of plane `a` to `b`, times `gain`, after a 5-tap blur by `taps` (centre, ±1, ±2)."""
    s = w + FOUR
    sb = wb + FOUR
    half = np.float32(0.5)
    step_y = np.float32(h) / np.float32(hb)
    step_x = np.float32(w) / np.float32(wb)
    for y in range(hb):
        p = (np.float32(y) + half) * step_y + np.float32(1.5)
        i = np.uint64(p)
        f = (p - np.float32(i)) * gain
        g = gain - f
        if taps[1] == 0.0:
            for x in range(s):
                blurred[x] = g * a[i * s + x] + f * a[(i + ONE) * s + x]
        else:
            c0 = g * taps[2]
            c1 = g * taps[1] + f * taps[2]
            c2 = g * taps[0] + f * taps[1]
            c3 = g * taps[1] + f * taps[0]
            c4 = g * taps[2] + f * taps[1]
            c5 = f * taps[2]
            k = (i - TWO) * s
            for x in range(s):
                row[x] = (
                    c0 * a[k + x]
                    + c1 * a[k + s + x]
                    + c2 * a[k + TWO * s + x]
                    + c3 * a[k + (TWO + ONE) * s + x]
                    + c4 * a[k + FOUR * s + x]
                    + c5 * a[k + (FOUR + ONE) * s + x]
                )
            for x in range(TWO, w + TWO):
                blurred[x] = (
                    taps[0] * row[x] + taps[1] * (row[x - ONE] + row[x + ONE]) + taps[2] * (row[x - TWO] + row[x + TWO])
                )
        k = (y + TWO) * sb + TWO
        for x in range(wb):
            p = (np.float32(x) + half) * step_x + np.float32(1.5)
            j = np.uint64(np.int64(p))
            f = p - np.float32(j)
            b[k + x] = blurred[j] + f * (blurred[j + ONE] - blurred[j])
    pad(b, hb, wb)


@njit(cache=True, nogil=True, fastmath=FAST)
def warp(a, b, u, v, warped, mask, h, w):
    """Sample `b` at (x + u, y + v) with Keys' bicubic kernel (a = −1/2); outside the frame take `a` and mask 0."""
    one = np.float32(1.0)
    half = np.float32(0.5)
    two = np.float32(2.0)
    s = w + FOUR
    right = np.float32(w - ONE)
    bottom = np.float32(h - ONE)
    for y in range(h):
        k = (y + TWO) * s + TWO
        for x in range(w):
            px = np.float32(x) + u[k + x]
            py = np.float32(y) + v[k + x]
            if px >= np.float32(0.0) and px <= right and py >= np.float32(0.0) and py <= bottom:
                j = np.uint64(np.int64(px))
                i = np.uint64(np.int64(py))
                t = px - np.float32(j)
                r = one - t
                x0 = -half * t * r * r
                x3 = -half * r * t * t
                x1 = one - t * t * (two + half - (one + half) * t)
                x2 = one - r * r * (two + half - (one + half) * r)
                t = py - np.float32(i)
                r = one - t
                y0 = -half * t * r * r
                y3 = -half * r * t * t
                y1 = one - t * t * (two + half - (one + half) * t)
                y2 = one - r * r * (two + half - (one + half) * r)
                n = (i + ONE) * s + j + ONE
                r0 = x0 * b[n] + x1 * b[n + ONE] + x2 * b[n + TWO] + x3 * b[n + TWO + ONE]
                n += s
                r1 = x0 * b[n] + x1 * b[n + ONE] + x2 * b[n + TWO] + x3 * b[n + TWO + ONE]
                n += s
                r2 = x0 * b[n] + x1 * b[n + ONE] + x2 * b[n + TWO] + x3 * b[n + TWO + ONE]
                n += s
                r3 = x0 * b[n] + x1 * b[n + ONE] + x2 * b[n + TWO] + x3 * b[n + TWO + ONE]
                warped[k + x] = y0 * r0 + y1 * r1 + y2 * r2 + y3 * r3
                mask[k + x] = one
            else:
                warped[k + x] = a[k + x]
                mask[k + x] = np.float32(0.0)
    pad(warped, h, w)


def median_of(radius: int) -> Any:
    """Intrinsic that reads the (2 radius + 1)² neighbours of element k and returns their median.

    It emits Batcher's odd-even merge sort as straight-line code; LLVM drops the exchanges that the middle element
    does not need and vectorises the rest. Written as Python calls of min and max, it would take seconds to compile.
    """

    @intrinsic  # type: ignore[untyped-decorator]
    def median_at(typing_context: Any, a: Any, k: Any, stride: Any) -> Any:
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

        return types.float32(a, types.uint64, types.uint64), emit

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


@njit(cache=True, nogil=True)
def median_3x3(a, b, h, w):
    """Write the 3 × 3 median of `a` (ring filled) to `b`."""
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            b[k] = median_3x3_at(a, k, s)


@njit(cache=True, nogil=True)
def median_5x5(a, b, h, w):
    """Write the 5 × 5 median of `a` (ring filled) to `b`."""
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            b[k] = median_5x5_at(a, k, s)


@njit(cache=True, nogil=True)
def smooth(a, b, size, h, w):
    """Median of `a` of the given size (3 or 5) into `b`, ring filled."""
    if size == 3:
        pad(a, h, w)
        median_3x3(a, b, h, w)
    else:
        pad(a, h, w)
        median_5x5(a, b, h, w)
    pad(b, h, w)


@njit(cache=True, nogil=True)
def view(work, first, h, w):
    """Plane of h × w pixels that starts at element `first` of the workspace."""
    return work[first : first + (h + np.int64(4)) * (w + np.int64(4))]


@njit(cache=True, nogil=True)
def split(flow, a, b):
    """Copy a flow (h, w, 2) into the planes `a` and `b`."""
    h = np.uint64(flow.shape[0])
    w = np.uint64(flow.shape[1])
    for y in range(h):
        i = (y + TWO) * (w + FOUR) + TWO
        for x in range(w):
            a[i + x] = flow[y, x, 0]
            b[i + x] = flow[y, x, 1]
    pad(a, h, w)
    pad(b, h, w)


@njit(cache=True, nogil=True)
def join(a, b, flow):
    """Copy the planes `a` and `b` into a flow (h, w, 2)."""
    h = np.uint64(flow.shape[0])
    w = np.uint64(flow.shape[1])
    for y in range(h):
        i = (y + TWO) * (w + FOUR) + TWO
        for x in range(w):
            flow[y, x, 0] = a[i + x]
            flow[y, x, 1] = b[i + x]


@njit(cache=True, nogil=True)
def add_scaled(a, b, factor):
    """Add `factor` times `b` to `a`."""
    for k in range(a.size):
        a[k] += factor * b[k]


@njit(cache=True, nogil=True)
def coarse_to_fine(frame0, frame1, flow, started, sizes, work, five, warps, iterations, rho, median, lam, taps, none):
    """Estimate the flow level by level, the coarsest first; `flow` holds the start field and takes the result.

    `sizes` is (levels, 2): height and width of each level, the finest first. With a start field each level warps
    by its reduced copy plus the increment found so far, so its detail is not lost on the way through the levels.
    """
    levels = sizes.shape[0]
    one = np.float32(1.0)
    first = 0
    n0 = (sizes[0, 0] + 4) * (sizes[0, 1] + 4)
    h0 = sizes[0, 0]
    w0 = sizes[0, 1]
    u = view(work, 0, h0, w0)
    v = view(work, n0, h0, w0)
    un = view(work, 2 * n0, h0, w0)
    vn = view(work, 3 * n0, h0, w0)
    fx = view(work, 4 * n0, h0, w0)
    fy = view(work, 5 * n0, h0, w0)
    ft = view(work, 6 * n0, h0, w0)
    warped = view(work, 7 * n0, h0, w0)
    mask = view(work, 8 * n0, h0, w0)
    row = view(work, 9 * n0, 0, w0)
    blurred = view(work, 9 * n0 + 4 * w0 + 16, 0, w0)
    base = 9 * n0 + 8 * w0 + 32
    planes = 4 if started else 2

    first = base
    load(frame0, view(work, first, h0, w0))
    load(frame1, view(work, first + n0, h0, w0))
    if started:
        split(flow, view(work, first + 2 * n0, h0, w0), view(work, first + 3 * n0, h0, w0))
    for level in range(1, levels):
        hf = sizes[level - 1, 0]
        wf = sizes[level - 1, 1]
        h = sizes[level, 0]
        w = sizes[level, 1]
        fine = (hf + 4) * (wf + 4)
        coarse = (h + 4) * (w + 4)
        second = first + planes * fine
        for i in range(planes):
            gain = one
            if i == 2:
                gain = np.float32(w) / np.float32(wf)
            if i == 3:
                gain = np.float32(h) / np.float32(hf)
            a = view(work, first + i * fine, hf, wf)
            b = view(work, second + i * coarse, h, w)
            resample(a, np.uint64(hf), np.uint64(wf), b, np.uint64(h), np.uint64(w), gain, taps, row, blurred)
        first = second

    for level in range(levels - 1, -1, -1):
        h = sizes[level, 0]
        w = sizes[level, 1]
        n = (h + 4) * (w + 4)
        uh = np.uint64(h)
        uw = np.uint64(w)
        a = view(work, first, h, w)
        b = view(work, first + n, h, w)
        if level == levels - 1:
            u[:n] = np.float32(0.0)
            v[:n] = np.float32(0.0)
        else:
            hc = sizes[level + 1, 0]
            wc = sizes[level + 1, 1]
            resample(u, np.uint64(hc), np.uint64(wc), un, uh, uw, np.float32(w) / np.float32(wc), none, row, blurred)
            resample(v, np.uint64(hc), np.uint64(wc), vn, uh, uw, np.float32(h) / np.float32(hc), none, row, blurred)
            u, un = un, u
            v, vn = vn, v
        if started:
            add_scaled(u[:n], view(work, first + 2 * n, h, w), one)
            add_scaled(v[:n], view(work, first + 3 * n, h, w), one)
        for _ in range(warps):
            warp(a, b, u, v, warped, mask, uh, uw)
            if five:
                five_tap(a, warped, fx, fy, ft, uh, uw)
            else:
                cube(a, warped, fx, fy, ft, uh, uw)
            normalise(fx, fy, ft, mask, u, v, lam * lam, uh, uw)
            un[:n] = u[:n]
            vn[:n] = v[:n]
            sweeps(u, v, un, vn, fx, fy, ft, iterations, rho, uh, uw)
            if iterations % 2 == 1:
                u, un = un, u
                v, vn = vn, v
            if median > 1:
                smooth(u, un, median, uh, uw)
                smooth(v, vn, median, uh, uw)
                u, un = un, u
                v, vn = vn, v
        if started and level > 0:
            add_scaled(u[:n], view(work, first + 2 * n, h, w), -one)
            add_scaled(v[:n], view(work, first + 3 * n, h, w), -one)
        if level > 0:
            first -= planes * (sizes[level - 1, 0] + 4) * (sizes[level - 1, 1] + 4)
    join(u, v, flow)


@njit(cache=True, nogil=True)
def derivatives_of(frame0, frame1, five, out, work):
    """Write F_x, F_y, F_t of two (h, w) frames to `out` (3, h, w)."""
    h = frame0.shape[0]
    w = frame0.shape[1]
    n = (h + 4) * (w + 4)
    a = view(work, 0, h, w)
    b = view(work, n, h, w)
    load(frame0, a)
    load(frame1, b)
    uh = np.uint64(h)
    uw = np.uint64(w)
    fx = view(work, 2 * n, h, w)
    fy = view(work, 3 * n, h, w)
    ft = view(work, 4 * n, h, w)
    if five:
        five_tap(a, b, fx, fy, ft, uh, uw)
    else:
        cube(a, b, fx, fy, ft, uh, uw)
    for y in range(h):
        for x in range(w):
            k = (y + 2) * (w + 4) + x + 2
            out[0, y, x] = fx[k]
            out[1, y, x] = fy[k]
            out[2, y, x] = ft[k]


@njit(cache=True, nogil=True)
def jacobi(frame0, frame1, flow, work, five, iterations, rho, lam):
    """Run the sweeps of the 1981 paper at full resolution, from the field in `flow`, which takes the result."""
    h = frame0.shape[0]
    w = frame0.shape[1]
    n = (h + 4) * (w + 4)
    uh = np.uint64(h)
    uw = np.uint64(w)
    a = view(work, 0, h, w)
    b = view(work, n, h, w)
    load(frame0, a)
    load(frame1, b)
    fx = view(work, 2 * n, h, w)
    fy = view(work, 3 * n, h, w)
    ft = view(work, 4 * n, h, w)
    mask = view(work, 5 * n, h, w)
    u = view(work, 6 * n, h, w)
    v = view(work, 7 * n, h, w)
    un = view(work, 0, h, w)
    vn = view(work, n, h, w)
    if five:
        five_tap(a, b, fx, fy, ft, uh, uw)
    else:
        cube(a, b, fx, fy, ft, uh, uw)
    mask[:] = np.float32(1.0)
    u[:] = np.float32(0.0)
    v[:] = np.float32(0.0)
    normalise(fx, fy, ft, mask, u, v, lam * lam, uh, uw)
    split(flow, u, v)
    un[:] = u
    vn[:] = v
    sweeps(u, v, un, vn, fx, fy, ft, iterations, rho, uh, uw)
    if iterations % 2 == 1:
        join(un, vn, flow)
    else:
        join(u, v, flow)
