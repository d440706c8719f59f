"""The numerical core, in Numba: an instruction set on planes, and :func:`run`, which carries out a program of it.

A program is made once per frame size, in Python (:mod:`.program`), and run at every call. So there is one compiled
function with one signature for all modes: each loop is compiled once, the order of the loops costs nothing to
compile, and one cached file serves everything.

All planes live in one flat float32 array, the workspace `m`, and a plane is named by the index of its first pixel:
cutting array views would cost more to compile than all the arithmetic, and time at every call. Pixel (y, x) of plane
`a`, h × w, is element a + y s + x, where s, the stride, is w and room for at least 16 elements more: two pixels
round the plane are its ring, which :func:`pad` fills, and let each loop run without a branch at the border; the rest
makes rows begin at multiples of 16 elements, where the processor reads fastest. Indices are unsigned, since Numba
then leaves out Python's wrap-around of negative ones; so every constant that meets an index is a uint64 as well.

What is computed at each pixel is written as a :func:`.formula.formula`, which is made into vector code.

Symbols are those of Horn & Schunck (1981, doi:10.1016/0004-3702(81)90024-2): derivatives F_x, F_y, F_t, flow (u, v).
Planes that belong together (u and v; F_x, F_y and F_t) are `d` elements apart.
"""

# Types come from the calls: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Annotated

import numpy as np
from numpy.typing import NDArray

from ..compiling import kernel, part
from .formula import formula, interpolate_fours

if TYPE_CHECKING:  # the vector code is written when something is compiled
    from .formulas import Around, Columns, Image, ImageOfTwo, Index, Lanes, Pixels, PixelsOfTwo

__all__ = ["COLUMNS", "FACTORS", "run"]

Steps = Annotated[NDArray[np.uint64], 2]
Factors = Annotated[NDArray[np.float32], 2]
Memory = Annotated[NDArray[np.float32], 1]
Frame = Annotated[NDArray[np.float32], 3]

ZERO = np.uint64(0)
ONE = np.uint64(1)
TWO = np.uint64(2)
THREE = np.uint64(3)
FOUR = np.uint64(4)

(
    LOAD,
    LOAD_FLOW,
    STORE_FLOW,
    FILL,
    ADD,
    PAD,
    DERIVE,
    NORMALISE,
    SWEEP,
    RESAMPLE,
    WARP,
    MEDIAN,
    SCALED,
    RESIDUAL,
    MEASURED_SWEEP,
    PROJECT,
    RESTRICT,
    PROLONG,
    COARSE_SWEEP,
    COARSE_RESIDUAL,
) = (np.uint64(i) for i in range(20))
"""What the first column of a program may hold; each is the function of :func:`run`'s branch."""

COLUMNS = 13
"""Columns of a program, see :func:`run`."""

FACTORS = 5
"""Float columns of a program, see :func:`run`."""

# What has one call site becomes part of its caller before anything is compiled: each function that is compiled on
# its own goes through LLVM twice, alone and in its caller.
_inner = part(inline="always")


@formula
def copy(a: Pixels, b: Pixels, factor: Lanes) -> None:
    """Write plane `a` times `factor` to plane `b`."""
    b[0] = a[0] * factor


@_inner
def pad(m, a, keep, h, w, s):
    """Fill the ring of plane `a` with the border pixels (`keep` 1) or with zeros (`keep` 0)."""
    for y in range(h):
        left = a + y * s
        right = left + w - ONE
        first = keep * m[left]
        last = keep * m[right]
        m[left - ONE] = first
        m[left - TWO] = first
        m[right + ONE] = last
        m[right + TWO] = last
    top = a - TWO
    bottom = top + (h - ONE) * s
    for _ in range(TWO):  # the second time the row outside of the first one
        copy(m, ONE, w + FOUR, s, top, top - s, keep)
        copy(m, ONE, w + FOUR, s, bottom, bottom + s, keep)
        top -= s
        bottom += s


@formula
def load(image: Image, a: Pixels) -> None:
    """Copy an image into plane `a`; what is not finite becomes 0."""
    a[0] = image[0].or_zero()


@formula
def load_pair(image: ImageOfTwo, a: Pixels, d: Index) -> None:
    """Copy both channels of an image into a pair of planes; what is not finite becomes 0."""
    u, v = image.pair()
    a[0] = u.or_zero()
    a[d] = v.or_zero()


@formula
def store_pair(a: Pixels, image: ImageOfTwo, d: Index) -> None:
    """Copy a pair of planes into the channels of an image."""
    image.set_pair(a[0], a[d])


@formula
def fill(a: Pixels, value: Lanes) -> None:
    """Set all pixels to a value."""
    a[0] = value


@formula
def add(b: Pixels, a: Pixels, factor: Lanes) -> None:
    """Add `factor` times plane `a` to plane `b`."""
    b[0] = b[0] + factor * a[0]


def cube_slopes(a: Pixels, b: Pixels, s: Index) -> list[Lanes]:
    """Average four first differences over the 2 × 2 × 2 cube (step 3 of the paper): F_x, F_y, F_t."""
    a00, a01, a10, a11 = a[0], a[1], a[s], a[s + 1]
    b00, b01, b10, b11 = b[0], b[1], b[s], b[s + 1]
    return [
        0.25 * (((a01 - a00) + (a11 - a10)) + ((b01 - b00) + (b11 - b10))),
        0.25 * (((a10 - a00) + (a11 - a01)) + ((b10 - b00) + (b11 - b01))),
        0.25 * (((b00 - a00) + (b01 - a01)) + ((b10 - a10) + (b11 - a11))),
    ]


def five_tap_slopes(a: Pixels, b: Pixels, s: Index) -> list[Lanes]:
    """Take the central differences of Barron, Fleet & Beauchemin (1994) on the mean of both frames; F_t = b − a."""

    def slope(step: Index | int) -> Lanes:
        near = (a[step] - a[-step]) + (b[step] - b[-step])
        far = (a[2 * step] - a[-2 * step]) + (b[2 * step] - b[-2 * step])
        return 8.0 / 24.0 * near - 1.0 / 24.0 * far

    return [slope(1), slope(s), b[0] - a[0]]


@formula
def cube(a: Pixels, b: Pixels, f: Pixels, d: Index, s: Index) -> None:
    """Write the derivatives to three planes."""
    f[0], f[d], f[2 * d] = cube_slopes(a, b, s)


@formula
def five_tap(a: Pixels, b: Pixels, f: Pixels, d: Index, s: Index) -> None:
    """Write the derivatives to three planes."""
    f[0], f[d], f[2 * d] = five_tap_slopes(a, b, s)


def scaled(slopes: list[Lanes], g: Pixels, d: Index, lam: Lanes) -> Lanes:
    """Write the sweep's coefficients g = F / √D with D = λ² + F_x² + F_y² to three planes, and D / λ² to a fourth.

    The sum is that of the squared right-hand side F_t ∇F.
    """
    fx, fy, ft = slopes
    square = fx * fx + fy * fy
    factor = 1.0 / (lam * lam + square).sqrt()
    g[0] = fx * factor
    g[d] = fy * factor
    g[2 * d] = ft * factor
    g[3 * d] = 1.0 + square / (lam * lam)
    return square * ft * ft


@formula
def scaled_cube(a: Pixels, b: Pixels, g: Pixels, d: Index, s: Index, lam: Lanes) -> Lanes:
    """Write the coefficients of the paper's system."""
    return scaled(cube_slopes(a, b, s), g, d, lam)


@formula
def scaled_five_tap(a: Pixels, b: Pixels, g: Pixels, d: Index, s: Index, lam: Lanes) -> Lanes:
    """Write the coefficients of the paper's system with the other derivatives."""
    return scaled(five_tap_slopes(a, b, s), g, d, lam)


@formula
def normalise(f: Pixels, mask: Pixels, u: Pixels, d: Index, lam: Lanes, outlier: Lanes) -> None:
    """Turn derivatives `f` into the sweep's coefficients g = √m F / √(λ² + m (F_x² + F_y²)), in place.

    The data term is linearised about (u, v), so that the sweep solves for the whole flow. Its weight is
    m = mask / (1 + `outlier` F_t²): pixels that the flow so far does not explain count less (Lorentzian weights).
    """
    fx, fy, ft = f[0], f[d], f[2 * d]
    weight = mask[0] / (1.0 + outlier * ft * ft)
    scale = (weight / (lam * lam + weight * (fx * fx + fy * fy))).sqrt()
    f[0] = fx * scale
    f[d] = fy * scale
    f[2 * d] = (ft - fx * u[0] - fy * u[d]) * scale


def columns(u: Pixels, d: Index, s: Index) -> list[Lanes]:
    """Parts of the average of u and of v that come from one column of three pixels.

    The average weighs the neighbours beside, above and below 1/6 and those at the corners 1/12 (step 4 of the paper).
    Returns for u, then for v, what a column gives to the pixel in it and what it gives to those left and right of it.
    """
    parts = []
    for i in (0 * d, d):
        outer = u[i - s] + u[i + s]
        parts += [1.0 / 6.0 * outer, 1.0 / 12.0 * outer + 1.0 / 6.0 * u[i]]
    return parts


def averages(around: Around) -> list[Lanes]:
    """ū and v̄ from :func:`columns`."""
    return [around.at(i, 0) + (around.at(i + 1, -1) + around.at(i + 1, 1)) for i in (0, 2)]


@formula(shared=columns)
def sweep(
    around: Around,
    u: Pixels,
    new: Pixels,
    g: Pixels,
    d: Index,
    s: Index,
    c_new: Lanes,
    c_here: Lanes,
    c_jacobi: Lanes,
) -> None:
    """Do one sweep of the paper: new = c_new · new + c_here · (u, v) + c_jacobi · Jacobi(u, v)."""
    ub, vb = averages(around)
    gx, gy = g[0], g[d]
    t = gx * ub + (gy * vb + g[2 * d])
    new[0] = c_new * new[0] + c_here * u[0] + c_jacobi * (ub - gx * t)
    new[d] = c_new * new[d] + c_here * u[d] + c_jacobi * (vb - gy * t)


@formula
def mix_blurred_rows(a: Pixels, b: Pixels, s: Index, f: Lanes, g: Lanes, c0: Lanes, c1: Lanes, c2: Lanes) -> None:
    """Weighted sum of two rows, both blurred by (c2, c1, c0, c1, c2) across: of six rows."""
    upper = c0 * a[0] + c1 * (a[-s] + a[s]) + c2 * (a[-2 * s] + a[2 * s])
    lower = c0 * a[s] + c1 * (a[0] + a[2 * s]) + c2 * (a[-s] + a[3 * s])
    b[0] = g * upper + f * lower


@formula
def mix_rows(a: Pixels, b: Pixels, s: Index, f: Lanes, g: Lanes) -> None:
    """Weighted sum of two rows."""
    b[0] = g * a[0] + f * a[s]


@formula
def blur_row(a: Pixels, b: Pixels, c0: Lanes, c1: Lanes, c2: Lanes) -> None:
    """Blur by (c2, c1, c0, c1, c2) along the row."""
    b[0] = c0 * a[0] + c1 * (a[-1] + a[1]) + c2 * (a[-2] + a[2])


@formula
def positions(x: Columns, whole: Pixels, fraction: Pixels, step: Lanes) -> None:
    """Where the pixels of a row lie, centre-aligned, in one whose pixels are `step` times smaller; 2 more."""
    p = (x + 0.5) * step + 1.5
    whole[0] = p.floor()
    fraction[0] = p - p.floor()


@_inner
def resample(m, a, h, w, s, b, hb, wb, sb, gain, c0, c1, c2, row):
    """Resize plane `a` to plane `b` (centre-aligned, bilinear), times `gain`, after a blur by (c2, c1, c0, c1, c2).

    Only rows and columns that are used are blurred. `row` names room for four rows.
    """
    step_y = np.float32(h) / np.float32(hb)
    room = s + sb
    blurred = row + room
    whole = blurred + room
    fraction = whole + room
    blur = c1 != np.float32(0.0)
    positions(m, ONE, wb, s, whole, fraction, np.float32(w) / np.float32(wb))
    for y in range(hb):
        p = (np.float32(y) + np.float32(0.5)) * step_y + np.float32(1.5)
        i = np.uint64(np.int64(p))
        f = (p - np.float32(i)) * gain
        g = gain - f
        k = a + i * s - s - s  # the upper one of the two rows between which the new row lies
        out = b + y * sb
        if blur:
            mix_blurred_rows(m, ONE, w + FOUR, s, k - TWO, row - TWO, s, f, g, c0, c1, c2)
            blur_row(m, ONE, w, s, row, out if w == wb else blurred, c0, c1, c2)
        else:
            mix_rows(m, ONE, w + FOUR, s, k - TWO, blurred - TWO, s, f, g)
        if w != wb or not blur:
            for x in range(wb):
                j = blurred + np.uint64(np.int64(m[whole + x])) - TWO
                m[out + x] = m[j] + m[fraction + x] * (m[j + ONE] - m[j])


@formula
def places(
    x: Columns,
    u: Pixels,
    mask: Pixels,
    table: Pixels,
    d: Index,
    room: Index,
    y: Lanes,
    right: Lanes,
    bottom: Lanes,
) -> None:
    """For a row, where (x + u, y + v) is, and the weights of Keys' bicubic interpolation (a = −1/2) there.

    Rows of the table, `room` apart: y and x of the pixel to the left and above, four weights down, four across.
    Outside of the frame take its border and mask 0.
    """
    px = x + u[0]
    py = y + u[d]
    ix = px.greatest(0.0).least(right)
    iy = py.greatest(0.0).least(bottom)
    mask[0] = ix.equals(px) * iy.equals(py)
    table[0] = iy.floor()
    table[room] = ix.floor()
    for i, p in ((2, iy), (6, ix)):
        t = p - p.floor()
        table[i * room] = ((-0.5 * t + 1.0) * t - 0.5) * t
        table[(i + 1) * room] = (1.5 * t - 2.5) * t * t + 1.0
        table[(i + 2) * room] = ((-1.5 * t + 2.0) * t + 0.5) * t
        table[(i + 3) * room] = (0.5 * t - 0.5) * t * t


@_inner
def warp(m, b, warped, u, d, mask, table, h, w, s):
    """Sample plane `b` at (x + u, y + v), bicubic."""
    fours = (w + THREE) >> TWO
    for y in range(h):
        row = y * s
        # The table's last four may stick out of the row: what is there does not count, but must be places in memory.
        places(
            m,
            ONE,
            fours << TWO,
            s,
            u + row,
            mask + row,
            table,
            d,
            s,
            np.float32(y),
            np.float32(w - ONE),
            np.float32(h - ONE),
        )
        interpolate_fours(m, fours, table, s, b - s - ONE, warped + row)


def exchange(values: list[Lanes], i: int, j: int) -> None:
    """Put the smaller of two values at i, the larger one at j."""
    values[i], values[j] = values[i].least(values[j]), values[i].greatest(values[j])


def sort(given: Iterable[Lanes]) -> list[Lanes]:
    """Sort by Batcher's odd-even merge sort; LLVM drops the exchanges that do not matter in the end."""
    values = list(given)
    for i, j in merge_sort_exchanges(len(values)):
        exchange(values, i, j)
    return values


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


def column_of_three(a: Pixels, s: Index) -> list[Lanes]:
    """Sorted pixels of a column."""
    return sort(a[i * s] for i in range(-1, 2))


def column_of_five(a: Pixels, s: Index) -> list[Lanes]:
    """Sorted pixels of a column."""
    return sort(a[i * s] for i in range(-2, 3))


@formula(shared=column_of_three)
def median_3x3(around: Around, a: Pixels, b: Pixels, s: Index) -> None:
    """Write the median of plane `a` over 3 × 3 pixels to plane `b`.

    The median of nine is that of the largest of the columns' smallest, the median of their medians and the smallest
    of their largest.
    """
    low, middle, high = (sort(around.at(rank, x) for x in range(-1, 2)) for rank in range(3))
    b[0] = sort((low[2], middle[1], high[0]))[1]


MEDIAN_CANDIDATES = (
    *((2, 1), (0, 4), (0, 3), (3, 1), (1, 2), (4, 0), (3, 0), (2, 2), (1, 3), (2, 3), (4, 1), (1, 4), (3, 2)),
)
"""Ranks (within the column, then among the columns) of what may be the median of 5 × 5 values: of all others 13
values are known to be no smaller, or no larger."""

MEDIAN_EXCHANGES = (
    *((3, 11), (0, 4), (1, 5), (2, 6), (3, 7), (8, 12), (5, 9), (1, 3)),
    *((4, 6), (5, 7), (8, 10), (3, 5), (6, 8), (3, 6), (5, 8), (5, 6)),
)
"""Exchanges that bring the median to place 6 of the candidates: Batcher's less those that a search found to be
superfluous, given the order that the candidates have already. The test goes through all orders."""


@formula(shared=column_of_five)
def median_5x5(around: Around, a: Pixels, b: Pixels, s: Index) -> None:
    """Write the median of plane `a` over 5 × 5 pixels to plane `b`: columns sorted, then what has the same rank."""
    ranks = [sort(around.at(rank, x) for x in range(-2, 3)) for rank in range(5)]
    values = [ranks[i][j] for i, j in MEDIAN_CANDIDATES]
    for i, j in MEDIAN_EXCHANGES:
        exchange(values, i, j)
    b[0] = values[6]


def data_term(g: Pixels, d: Index, u: Lanes, v: Lanes) -> list[Lanes]:
    """F_x (F_x u + F_y v + F_t) / λ² and the same with F_y before the bracket, from what :func:`scaled` leaves."""
    gx, gy = g[0], g[d]
    t = g[3 * d] * (gx * u + gy * v + g[2 * d])
    return [gx * t, gy * t]


@formula(shared=columns)
def residual(around: Around, u: Pixels, r: Pixels, g: Pixels, d: Index, s: Index) -> None:
    """Write the residual of the paper's system over λ² to the pair `r`."""
    ub, vb = averages(around)
    du, dv = data_term(g, d, u[0], u[d])
    r[0] = (ub - u[0]) - du
    r[d] = (vb - u[d]) - dv


@formula(shared=columns)
def measured_sweep(around: Around, u: Pixels, new: Pixels, g: Pixels, d: Index, s: Index) -> Lanes:
    """Do one sweep of the paper. The sum is that of the squared residual, over λ², that (u, v) had before it."""
    ub, vb = averages(around)
    gx, gy = g[0], g[d]
    t = gx * ub + (gy * vb + g[2 * d])
    new[0] = ub - gx * t
    new[d] = vb - gy * t
    du, dv = data_term(g, d, u[0], u[d])
    ru = (ub - u[0]) - du
    rv = (vb - u[d]) - dv
    return ru * ru + rv * rv


@formula
def project(g: PixelsOfTwo, b: Pixels, d: Index, size: Index) -> None:
    """Sum (F_x², F_x F_y, F_y², −F_t F_x, −F_t F_y) / λ² over 2 × 2 pixels into five planes, `size` apart.

    The ring of the planes that :func:`scaled` leaves must hold zeros: what is missing at odd sizes counts as zero, or
    the system would lose its symmetry.
    """
    gx, gy, gt, weight = ([*g.pair(i), *g.pair(i + g.stride)] for i in (0 * d, d, 2 * d, 3 * d))

    def total(p: list[Lanes], q: list[Lanes]) -> Lanes:
        first, second, third, fourth = (weight[i] * (p[i] * q[i]) for i in range(4))
        return (first + second) + (third + fourth)

    b[0] = total(gx, gx)
    b[size] = total(gx, gy)
    b[2 * size] = total(gy, gy)
    b[3 * size] = 0.0 - total(gx, gt)
    b[4 * size] = 0.0 - total(gy, gt)


@formula
def restrict(p: PixelsOfTwo, b: Pixels) -> None:
    """Sum plane `p` over 2 × 2 pixels (λ² falls by four, so the mean is multiplied by it).

    The ring of `p` must hold zeros, see :func:`project`.
    """
    (p00, p01), (p10, p11) = p.pair(0), p.pair(p.stride)
    b[0] = (p00 + p01) + (p10 + p11)


def nearer_rows(a: Pixels, s: Index) -> list[Lanes]:
    """Interpolate between a row and those above and below, a quarter of a pixel off."""
    return [0.75 * a[0] + 0.25 * a[-s], 0.75 * a[0] + 0.25 * a[s]]


@formula(shared=nearer_rows)
def prolong(around: Around, a: Pixels, fine: PixelsOfTwo, s: Index, keep: Lanes) -> None:
    """Add to a fine plane, times `keep`, the bilinear interpolation of plane `a`: weights (9, 3, 3, 1) / 16."""
    for i, row in ((0, 0 * s), (1, fine.stride)):
        even, odd = fine.pair(row)
        here = 0.75 * around.at(i, 0)
        fine.set_pair(
            row, keep * even + (here + 0.25 * around.at(i, -1)), keep * odd + (here + 0.25 * around.at(i, 1))
        )


def coarse_matrix(j: Pixels, d: Index) -> list[Lanes]:
    """1 + jxx, jxy and 1 + jyy."""
    return [1.0 + j[0], j[d], 1.0 + j[2 * d]]


@formula(shared=columns)
def coarse_sweep(around: Around, u: Pixels, new: Pixels, j: Pixels, d: Index, s: Index, keep: Lanes) -> None:
    """Do a Jacobi sweep on a coarse grid, of u − ū + J u = b, from (u, v) times `keep`.

    J = (jxx, jxy, jyy) and b = (b_u, b_v) are five planes from `j`.
    """
    ub, vb = averages(around)
    axx, axy, ayy = coarse_matrix(j, d)
    ru = j[3 * d] + keep * ub
    rv = j[4 * d] + keep * vb
    scale = 1.0 / (axx * ayy - axy * axy)
    new[0] = scale * (ayy * ru - axy * rv)
    new[d] = scale * (axx * rv - axy * ru)


@formula(shared=columns)
def coarse_residual(around: Around, u: Pixels, r: Pixels, j: Pixels, d: Index, s: Index) -> None:
    """Write the residual of the coarse system."""
    ub, vb = averages(around)
    axx, axy, ayy = coarse_matrix(j, d)
    r[0] = (j[3 * d] + ub) - (axx * u[0] + axy * u[d])
    r[d] = (j[4 * d] + vb) - (axy * u[0] + ayy * u[d])


@kernel()
def run(program: Steps, factors: Factors, m: Memory, frame0: Frame, frame1: Frame, flow: Frame) -> float:
    """Carry out a program; return the sum that the last step to compute one has left.

    Parameters
    ----------
    program : ndarray, shape (steps, COLUMNS), uint64
        A step is: what to do; height, width and stride of its result; planes a (read), b (written) and c; distance d
        of planes that belong together; two more numbers e and f; the stride t of what is read where that has another
        size; how often to repeat, a and b changing places after each turn; then the number of planes from b on
        whose ring is to be filled.
    factors : ndarray, shape (steps, FACTORS), float32
        Numbers of a step; the last one multiplies what a ring is filled with.
    m : ndarray, shape (N,), float32
        The workspace.
    frame0, frame1 : ndarray, shape (H, W, 1), float32
    flow : ndarray, shape (H, W, 2), float32
        Start field and result.
    """
    total = 0.0
    one = np.float32(1.0)
    for step in range(np.uint64(program.shape[0])):
        code = program[step, 0]
        h = program[step, 1]
        w = program[step, 2]
        s = program[step, 3]
        a = program[step, 4]
        b = program[step, 5]
        c = program[step, 6]
        d = program[step, 7]
        e = program[step, 8]
        f = program[step, 9]
        t = program[step, 10]
        f0 = factors[step, 0]
        f1 = factors[step, 1]
        omega = one
        for _ in range(program[step, 11]):
            if code == LOAD:
                load(m, h, w, s, frame1 if a == ONE else frame0, b)
            elif code == LOAD_FLOW:
                load_pair(m, h, w, s, flow, b, d)
            elif code == STORE_FLOW:
                store_pair(m, h, w, s, a, flow, d)
            elif code == FILL:
                fill(m, ONE, a, ZERO, b, f0)
            elif code == ADD:
                add(m, h, w, s, b, a, f0)
            elif code == DERIVE:
                if e == ONE:
                    five_tap(m, h, w, s, a, c, b, d, s)
                else:
                    cube(m, h, w, s, a, c, b, d, s)
            elif code == NORMALISE:
                normalise(m, h, w, s, a, c, e, d, f0, f1)
            elif code == SWEEP:
                # Chebyshev's weights for a spectrum of given radius; with radius 0 (f1) and f0 1 plain Jacobi
                sweep(m, h, w, s, a, b, c, d, s, one - omega, omega * (one - f0), omega * f0)
                omega = one / (one - f1 * omega if omega != one else one - f1 - f1)
            elif code == RESAMPLE:
                resample(m, a, e, f, t, b, h, w, s, f0, f1, factors[step, 2], factors[step, 3], c)
            elif code == WARP:
                warp(m, a, b, c, d, e, f, h, w, s)
            elif code == MEDIAN:
                if e == THREE:
                    median_3x3(m, h, w, s, a, b, s)
                else:
                    median_5x5(m, h, w, s, a, b, s)
            elif code == SCALED:
                if e == ONE:
                    total = scaled_five_tap(m, h, w, s, a, c, b, d, s, f0)
                else:
                    total = scaled_cube(m, h, w, s, a, c, b, d, s, f0)
                square = np.float64(f0) * f0
                total /= square * square
            elif code == RESIDUAL:
                residual(m, h, w, s, a, b, c, d, s)
            elif code == MEASURED_SWEEP:
                total = measured_sweep(m, h, w, s, a, b, c, d, s)
            elif code == PROJECT:
                project(m, h, w, s, a, t, ZERO, b, d, e)
            elif code == RESTRICT:
                restrict(m, h, w, s, a, t, ZERO, b)
            elif code == PROLONG:
                prolong(m, (h + ONE) >> ONE, (w + ONE) >> ONE, t, a, b, s, w, t, f0)
            elif code == COARSE_SWEEP:
                coarse_sweep(m, h, w, s, a, b, c, d, s, f0)
            elif code == COARSE_RESIDUAL:
                coarse_residual(m, h, w, s, a, b, c, d, s)
            for plane in range(program[step, 12]):
                pad(m, b + plane * d, factors[step, 4], h, w, s)
            a, b = b, a
    return total
