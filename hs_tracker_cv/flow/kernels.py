"""The numerical core, in Numba: an instruction set on planes, and :func:`run`, which carries out a program of it.

A program is made once per frame size, in Python (:mod:`.program`), and run at every call. So there is one compiled
function with one signature for all modes: each loop is compiled once, the order of the loops costs nothing to
compile, and one cached file serves everything.

All planes live in one flat float32 array, the workspace `m`, and a plane is named by the index of its first element:
cutting array views would cost more to compile than all the arithmetic, and time at every call. A plane holds h × w
pixels with a ring of two pixels round them: pixel (y, x) is element (y + 2) (w + 4) + x + 2. The ring, filled by
:func:`pad`, lets each loop run without a branch at the border. Indices are unsigned, since Numba then leaves out
Python's wrap-around of negative ones, which keeps loops from being vectorised; so every constant that meets an index
is a uint64 as well.

Symbols are those of Horn & Schunck (1981, doi:10.1016/0004-3702(81)90024-2): derivatives F_x, F_y, F_t, flow (u, v).
Planes that belong together (u and v; F_x, F_y and F_t) are `d` elements apart.
"""

# Types come from the calls: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numba.np.arrayobj import make_array

from ..compiling import kernel, larger, part, smaller

__all__ = ["COLUMNS", "FACTORS", "run"]

ZERO = np.uint64(0)
ONE = np.uint64(1)
TWO = np.uint64(2)
THREE = np.uint64(3)
FOUR = np.uint64(4)
FIVE = np.uint64(5)

(
    LOAD,
    STORE,
    FILL,
    ADD,
    PAD,
    DERIVE,
    NORMALISE,
    SWEEP,
    RESAMPLE,
    WARP,
    MEDIAN,
    SCALE,
    RESIDUAL,
    PROJECT,
    RESTRICT,
    PROLONG,
    COARSE,
) = (np.uint64(i) for i in range(17))
"""What the first column of a program may hold; each is the function of :func:`run`'s branch."""

COLUMNS = 12
"""Columns of a program, see :func:`run`."""

FACTORS = 5
"""Float columns of a program, see :func:`run`."""

FAST = {"contract", "nsz"}  # reassociation would break "identical frames give exactly zero"
# What has one call site becomes part of its caller before anything is compiled: each function that is compiled on
# its own goes through LLVM twice, alone and in its caller.
_inner = part(fastmath=FAST, inline="always")
_summing = part(fastmath=FAST | {"reassoc"})


@_inner
def pad(m, a, depth, keep, h, w):
    """Fill the ring of plane `a`, `depth` pixels deep, with the border pixels (`keep` 1) or with zeros (`keep` 0)."""
    s = w + FOUR
    for r in range(depth):
        left = a + ONE - r
        right = a + w + TWO + r
        for y in range(TWO - r, h + TWO + r):
            m[left + y * s] = keep * m[left + y * s + ONE]
            m[right + y * s] = keep * m[right + y * s - ONE]
        top = a + (ONE - r) * s
        bottom = a + (h + TWO + r) * s
        for x in range(ONE - r, w + THREE + r):
            m[top + x] = keep * m[top + s + x]
            m[bottom + x] = keep * m[bottom - s + x]


@_inner
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


@_inner
def store(m, a, image, channel):
    """Copy plane `a` into one channel of an (h, w, channels) image."""
    h = np.uint64(image.shape[0])
    w = np.uint64(image.shape[1])
    for y in range(h):
        row = a + (y + TWO) * (w + FOUR) + TWO
        for x in range(w):
            image[y, x, channel] = m[row + x]


@_inner
def fill(m, a, value, count):
    """Set `count` elements."""
    for k in range(a, a + count):
        m[k] = value


@_inner
def add(m, b, a, factor, h, w):
    """Add `factor` times plane `a` to plane `b`, rings and all."""
    d = a - b
    for k in range(b, b + (h + FOUR) * (w + FOUR)):
        m[k] += factor * m[k + d]


@_inner
def cube(m, a, b, f, d, h, w):
    """Average four first differences over the 2 × 2 × 2 cube (step 3 of the paper)."""
    quarter = np.float32(0.25)
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p = a + k
            q = b + k
            # sums of both frames over the four diagonals of the cube, and the differences of the frames
            a00 = m[p]
            a01 = m[p + ONE]
            a10 = m[p + s]
            a11 = m[p + s + ONE]
            b00 = m[q]
            b01 = m[q + ONE]
            b10 = m[q + s]
            b11 = m[q + s + ONE]
            o = f + k
            m[o] = quarter * (((a01 - a00) + (a11 - a10)) + ((b01 - b00) + (b11 - b10)))
            m[o + d] = quarter * (((a10 - a00) + (a11 - a01)) + ((b10 - b00) + (b11 - b01)))
            m[o + d + d] = quarter * (((b00 - a00) + (b01 - a01)) + ((b10 - a10) + (b11 - a11)))


@_inner
def five_tap(m, a, b, f, d, h, w):
    """Take the central differences of Barron, Fleet & Beauchemin (1994) on the mean of both frames; F_t = b − a."""
    near = np.float32(8.0 / 24.0)
    far = np.float32(1.0 / 24.0)
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p = a + k
            q = b + k
            o = f + k
            m[o] = near * ((m[p + ONE] - m[p - ONE]) + (m[q + ONE] - m[q - ONE])) - far * (
                (m[p + TWO] - m[p - TWO]) + (m[q + TWO] - m[q - TWO])
            )
            m[o + d] = near * ((m[p + s] - m[p - s]) + (m[q + s] - m[q - s])) - far * (
                (m[p + s + s] - m[p - s - s]) + (m[q + s + s] - m[q - s - s])
            )
            m[o + d + d] = m[q] - m[p]


@_inner
def normalise(m, f, d, mask, u, lam, outlier, h, w):
    """Turn derivatives `f` into the sweep's coefficients g = √m F / √(λ² + m (F_x² + F_y²)), in place.

    The data term is linearised about (u, v), so that the sweep solves for the whole flow. Its weight is
    m = mask / (1 + `outlier` F_t²): pixels that the flow so far does not explain count less (Lorentzian weights).
    """
    lam2 = lam * lam
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            i = f + k
            x_slope = m[i]
            y_slope = m[i + d]
            change = m[i + d + d]
            weight = m[mask + k] / (np.float32(1.0) + outlier * change * change)
            scale = np.sqrt(weight / (lam2 + weight * (x_slope * x_slope + y_slope * y_slope)))
            m[i] = x_slope * scale
            m[i + d] = y_slope * scale
            m[i + d + d] = (change - x_slope * m[u + k] - y_slope * m[u + d + k]) * scale


@_summing
def scale(m, f, g, d, lam, h, w):
    """Turn derivatives `f` into g = F / √(λ² + F_x² + F_y²), elsewhere.

    Returns the square sum of the right-hand side F_t ∇F / λ².
    """
    lam2 = lam * lam
    s = w + FOUR
    total = 0.0
    for y in range(TWO, h + TWO):
        partial = np.float32(0.0)
        for k in range(y * s + TWO, y * s + w + TWO):
            i = f + k
            x_slope = m[i]
            y_slope = m[i + d]
            change = m[i + d + d]
            square = x_slope * x_slope + y_slope * y_slope
            factor = np.float32(1.0) / np.sqrt(lam2 + square)
            o = g + k
            m[o] = x_slope * factor
            m[o + d] = y_slope * factor
            m[o + d + d] = change * factor
            partial += square * change * change
        total += partial
    return total / (np.float64(lam2) * lam2)


@part(fastmath=FAST)
def average(m, p, s):
    """Mean of the eight neighbours of element p, 1/6 the sides and 1/12 the corners (step 4 of the paper)."""
    n = p - s
    o = p + s
    return np.float32(1.0 / 6.0) * ((m[n] + m[o]) + (m[p - ONE] + m[p + ONE])) + np.float32(1.0 / 12.0) * (
        (m[n - ONE] + m[n + ONE]) + (m[o - ONE] + m[o + ONE])
    )


@_inner
def sweep(m, u, un, g, d, c_old, c_here, c_jacobi, h, w):
    """Do one sweep of the paper: new = c_old · new + c_here · (u, v) + c_jacobi · Jacobi(u, v)."""
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p = u + k
            q = p + d
            i = g + k
            o = un + k
            ub = average(m, p, s)
            vb = average(m, q, s)
            t = m[i] * ub + m[i + d] * vb + m[i + d + d]
            m[o] = c_old * m[o] + c_here * m[p] + c_jacobi * (ub - m[i] * t)
            m[o + d] = c_old * m[o + d] + c_here * m[q] + c_jacobi * (vb - m[i + d] * t)


@_inner
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


@_inner
def warp(m, b, warped, u, d, mask, h, w):
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
            py = np.float32(y) + m[u + d + k + x]
            m[mask + k + x] = one if px >= zero and px <= right and py >= zero and py <= bottom else zero
            px = smaller(larger(px, zero), right)
            py = smaller(larger(py, zero), bottom)
            j = np.int64(px)
            i = np.int64(py)
            first = b + (np.uint64(i) + ONE) * s + np.uint64(j) + ONE
            m[warped + k + x] = bicubic_at(m, first, s, px - np.float32(j), py - np.float32(i))


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


@_inner
def median_filter(m, a, b, size, h, w):
    """Write the median of plane `a` over `size` × `size` pixels (3 or 5) to plane `b`."""
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


@_summing
def residual(m, u, r, f, d, weight, h, w):
    """Write the residual of the paper's system over λ² to the pair `r`; `weight` is 1 / λ². Return its square sum."""
    s = w + FOUR
    total = 0.0
    for y in range(TWO, h + TWO):
        partial = np.float32(0.0)
        for k in range(y * s + TWO, y * s + w + TWO):
            p = u + k
            q = p + d
            i = f + k
            t = weight * (m[i] * m[p] + m[i + d] * m[q] + m[i + d + d])
            a = (average(m, p, s) - m[p]) - m[i] * t
            b = (average(m, q, s) - m[q]) - m[i + d] * t
            m[r + k] = a
            m[r + d + k] = b
            partial += a * a + b * b
        total += partial
    return total


@_inner
def project(m, f, d, wf, weight, b, h, w):
    """Sum `weight` · (F_x², F_x F_y, F_y², −F_t F_x, −F_t F_y) over 2 × 2 pixels into five coarse planes from `b`.

    The derivatives' planes are `wf` wide; their ring must hold zeros: what is missing at odd sizes counts as zero,
    or the system would lose its symmetry.
    """
    s = wf + FOUR
    size = (h + FOUR) * (w + FOUR)
    for y in range(h):
        k = f + (y + y + TWO) * s + TWO
        row = b + (y + TWO) * (w + FOUR) + TWO
        for x in range(w):
            xx = xy = yy = xt = yt = np.float32(0.0)
            for j in range(FOUR):
                i = k + x + x + (j & ONE) + (j >> ONE) * s
                fx = m[i]
                fy = m[i + d]
                ft = m[i + d + d]
                xx += fx * fx
                xy += fx * fy
                yy += fy * fy
                xt += fx * ft
                yt += fy * ft
            i = row + x
            m[i] = weight * xx
            m[i + size] = weight * xy
            m[i + size + size] = weight * yy
            m[i + THREE * size] = -weight * xt
            m[i + FOUR * size] = -weight * yt


@_inner
def restrict(m, p, wf, coarse, h, w):
    """Sum plane `p`, `wf` wide, over 2 × 2 pixels (λ² falls by four, so the mean is multiplied by it).

    The ring of `p` must hold zeros, see :func:`project`.
    """
    s = wf + FOUR
    for y in range(h):
        k = p + (y + y + TWO) * s + TWO
        row = coarse + (y + TWO) * (w + FOUR) + TWO
        for x in range(w):
            i = k + x + x
            m[row + x] = (m[i] + m[i + ONE]) + (m[i + s] + m[i + s + ONE])


@_inner
def prolong(m, coarse, wc, p, h, w, row):
    """Add to plane `p` the bilinear interpolation of a coarse plane `wc` wide: weights (9, 3, 3, 1) / 16.

    `row` names room for one row of the coarse plane.
    """
    s = w + FOUR
    sc = wc + FOUR
    near = np.float32(0.75)
    far = np.float32(0.25)
    for y in range(h):
        centre = coarse + ((y >> ONE) + TWO) * sc
        other = centre + sc if y & ONE == ONE else centre - sc
        for x in range(ONE, wc + THREE):
            m[row + x] = near * m[centre + x] + far * m[other + x]
        k = p + (y + TWO) * s + TWO
        for x in range(wc):
            i = row + x + TWO
            m[k + x + x] += near * m[i] + far * m[i - ONE]
            m[k + x + x + ONE] += near * m[i] + far * m[i + ONE]


@_inner
def coarse(m, u, un, d, j, solve, h, w):
    """Write to the pair `un` one Jacobi sweep of the pair `u` on a coarse grid, or, without `solve`, its residual.

    The system is u − ū + J u = b with J = (jxx, jxy, jyy) and b = (b_u, b_v): five planes from `j`.
    """
    one = np.float32(1.0)
    zero = np.float32(0.0)
    keep = zero if solve else one
    s = w + FOUR
    for y in range(TWO, h + TWO):
        for k in range(y * s + TWO, y * s + w + TWO):
            p = u + k
            q = p + d
            i = j + k
            axx = one + m[i]
            axy = m[i + d]
            ayy = one + m[i + d + d]
            ru = (m[i + THREE * d] + average(m, p, s)) - keep * (axx * m[p] + axy * m[q])
            rv = (m[i + FOUR * d] + average(m, q, s)) - keep * (axy * m[p] + ayy * m[q])
            scale = one / (axx * ayy - axy * axy)
            m[un + k] = scale * (ayy * ru - axy * rv) if solve else ru
            m[un + d + k] = scale * (axx * rv - axy * ru) if solve else rv


@kernel(fastmath=FAST)
def run(program, factors, m, frame0, frame1, flow):
    """Carry out a program; return the sum that the last step to compute one has left.

    Parameters
    ----------
    program : ndarray, shape (steps, COLUMNS), uint64
        A step is: what to do; height and width of its result; planes a (read), b (written) and c; distance d of
        planes that belong together; two more numbers e and f; how often to repeat, a and b changing places after
        each turn; then the number of planes from b on whose ring is to be filled, how deep, and whether with zeros.
    factors : ndarray, shape (steps, FACTORS), float32
    m : ndarray, shape (N,), float32
        The workspace.
    frame0, frame1 : ndarray, shape (H, W, 1), float32
    flow : ndarray, shape (H, W, C), float32
        Start field and result.
    """
    total = 0.0
    one = np.float32(1.0)
    for step in range(np.uint64(program.shape[0])):
        code = program[step, 0]
        h = program[step, 1]
        w = program[step, 2]
        a = program[step, 3]
        b = program[step, 4]
        c = program[step, 5]
        d = program[step, 6]
        e = program[step, 7]
        f = program[step, 8]
        f0 = factors[step, 0]
        f1 = factors[step, 1]
        omega = one
        for _ in range(program[step, 9]):
            if code == LOAD:
                image = frame0
                if a == ONE:
                    image = frame1
                if a == TWO:
                    image = flow
                load(m, image, e, b)
            elif code == STORE:
                store(m, a, flow, e)
            elif code == FILL:
                fill(m, b, f0, a)
            elif code == ADD:
                add(m, b, a, f0, h, w)
            elif code == DERIVE:
                if e == ONE:
                    five_tap(m, a, c, b, d, h, w)
                else:
                    cube(m, a, c, b, d, h, w)
            elif code == NORMALISE:
                normalise(m, a, d, c, e, f0, f1, h, w)
            elif code == SWEEP:
                # Chebyshev's weights for a spectrum of given radius; with radius 0 (f1) and f0 1 plain Jacobi
                sweep(m, a, b, c, d, one - omega, omega * (one - f0), omega * f0, h, w)
                omega = one / (one - f1 * omega if omega != one else one - f1 - f1)
            elif code == RESAMPLE:
                resample(m, a, e, f, b, h, w, f0, f1, factors[step, 2], factors[step, 3], c)
            elif code == WARP:
                warp(m, a, b, c, d, e, h, w)
            elif code == MEDIAN:
                median_filter(m, a, b, e, h, w)
            elif code == SCALE:
                total = scale(m, a, b, d, f0, h, w)
            elif code == RESIDUAL:
                total = residual(m, a, b, c, d, f0, h, w)
            elif code == PROJECT:
                project(m, a, d, e, f0, b, h, w)
            elif code == RESTRICT:
                restrict(m, a, e, b, h, w)
            elif code == PROLONG:
                prolong(m, a, e, b, h, w, c)
            elif code == COARSE:
                coarse(m, a, b, d, c, e == ONE, h, w)
            for plane in range(program[step, 10]):
                pad(m, b + plane * d, program[step, 11], factors[step, 4], h, w)
            a, b = b, a
    return total
