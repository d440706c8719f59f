"""Masks: grown, opened, taken apart, measured. What lies beyond the border is neither in a mask nor outside it."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, smaller
from .common import Mask, Runs, fast_kernel, fast_part

f32 = np.float32

# Columns of a list of runs.
RUN_ROW, RUN_FIRST, RUN_END, RUN_HEAD, RUN_AREA, RUN_COMMON = range(6)


@fast_kernel
def without(mask: Mask, other: Mask, out: Mask) -> int:
    """Write the pixels of a mask that are not in the other; return how many they are."""
    h, w = mask.shape
    n = 0
    for y in range(h):
        for x in range(w):
            out[y, x] = mask[y, x] & (other[y, x] ^ 1)
            n += out[y, x]
    return n


@fast_kernel
def invert(mask: Mask, out: Mask) -> int:
    """Write the pixels outside a mask; return how many they are."""
    h, w = mask.shape
    n = 0
    for y in range(h):
        for x in range(w):
            out[y, x] = mask[y, x] ^ 1
            n += out[y, x]
    return n


@fast_kernel
def median(mask: Mask, held: Mask, out: Mask) -> None:
    """Write 1 where at least five of 3 × 3 pixels are in the mask, the border repeated. `held` is a workspace."""
    h, w = mask.shape
    for y in range(h):
        up = larger(y - 1, 0)
        down = smaller(y + 1, h - 1)
        for x in range(w):
            held[y, x] = mask[up, x] + mask[y, x] + mask[down, x]
        # of sums from 0 to 9, those from 5 on become 1
        out[y, 0] = (held[y, 0] + held[y, 0] + held[y, 1] + 3) >> 3
        for x in range(1, w - 1):
            out[y, x] = (held[y, x - 1] + held[y, x] + held[y, x + 1] + 3) >> 3
        out[y, w - 1] = (held[y, w - 2] + held[y, w - 1] + held[y, w - 1] + 3) >> 3


@fast_kernel
def beside(mask: Mask, out: Mask) -> None:
    """Write 1 where a pixel of the mask is here, on the left or on the right."""
    h, w = mask.shape
    for y in range(h):
        out[y, 0] = mask[y, 0] | mask[y, 1]
        for x in range(1, w - 1):
            out[y, x] = mask[y, x - 1] | mask[y, x] | mask[y, x + 1]
        out[y, w - 1] = mask[y, w - 2] | mask[y, w - 1]


@fast_kernel
def spread(allowed: Mask, times: int, held: Mask, out: Mask) -> None:
    """Let the mask `out` grow over `allowed`, in each step to all eight neighbours. `held` is a workspace."""
    h, w = out.shape
    for _ in range(times):
        beside(out, held)
        for y in range(h):
            up = larger(y - 1, 0)
            down = smaller(y + 1, h - 1)
            for x in range(w):
                out[y, x] |= allowed[y, x] & (held[up, x] | held[y, x] | held[down, x])


@fast_kernel
def widen(mask: Mask, reach: int, held: Mask, out: Mask) -> None:
    """Write 1 where a pixel of the mask lies within `reach` px, in rows and in columns. `held` is a workspace."""
    h, w = mask.shape
    for y in range(h):
        for x in range(w):
            out[y, x] = mask[y, x]
    for _ in range(reach):
        beside(out, held)
        for y in range(h):
            up = larger(y - 1, 0)
            down = smaller(y + 1, h - 1)
            for x in range(w):
                out[y, x] = held[up, x] | held[y, x] | held[down, x]


@fast_kernel
def widen_cross(mask: Mask, out: Mask) -> None:
    """Write 1 where a pixel of the mask is here, or one of the four neighbours."""
    h, w = mask.shape
    beside(mask, out)
    for y in range(h):
        up = larger(y - 1, 0)
        down = smaller(y + 1, h - 1)
        for x in range(w):
            out[y, x] |= mask[up, x] | mask[down, x]


@fast_kernel
def components(mask: Mask, other: Mask, runs: Runs) -> tuple[int, int]:
    """Take a mask apart: list its runs of pixels in rows, and which of them hang together, also by corners.

    A component is known by its head, the first of its runs. For each run, `runs` receives (row, first column, end,
    head), and for each head the area of its component and how much of it is in `other`. Returns the numbers of runs
    and of components.
    """
    h, w = mask.shape
    n = above = 0
    for y in range(h):
        begin = n
        x = 0
        while x < w:
            if mask[y, x] == 0:
                x += 1
                continue
            first = x
            common = 0
            while x < w and mask[y, x] != 0:
                common += other[y, x]
                x += 1
            runs[n, RUN_ROW] = y
            runs[n, RUN_FIRST] = first
            runs[n, RUN_END] = x
            runs[n, RUN_HEAD] = n
            runs[n, RUN_AREA] = x - first
            runs[n, RUN_COMMON] = common
            while above < begin and runs[above, RUN_END] < first:
                above += 1
            i = above
            while i < begin and runs[i, RUN_FIRST] <= x:
                a = i
                while runs[a, RUN_HEAD] != a:
                    a = runs[a, RUN_HEAD]
                b = n
                while runs[b, RUN_HEAD] != b:
                    b = runs[b, RUN_HEAD]
                runs[larger(a, b), RUN_HEAD] = smaller(a, b)
                i += 1
            n += 1
        above = begin
    heads = 0
    for i in range(n):
        head = runs[runs[i, RUN_HEAD], RUN_HEAD]  # that of an earlier run is its final one
        runs[i, RUN_HEAD] = head
        if head == i:
            heads += 1
        else:
            runs[head, RUN_AREA] += runs[i, RUN_AREA]
            runs[head, RUN_COMMON] += runs[i, RUN_COMMON]
    return n, heads


@fast_part
def overlap(mask, shape, inside):
    """Count, inside the frame, the pixels of {shape > ½}, those of them in the mask, and those of the mask."""
    area = both = seen = 0
    for y in range(inside[1], inside[3]):
        for x in range(inside[0], inside[2]):
            part = 1 if shape[y, x] > f32(0.5) else 0
            own = 1 if mask[y, x] != 0 else 0
            area += part
            seen += own
            both += part & own
    return area, both, seen


@fast_part
def extremes(mask, odds, columns, rows):
    """First and last column and row of a mask, −1 if it is empty; and how far the odds reach.

    Between the first and last row `columns` receives the largest value per column, and `rows` alike.
    """
    h, w = mask.shape
    left = w
    right = top = bottom = -1
    for y in range(h):
        low = w
        high = -1
        for x in range(w):
            low = smaller(low, x if mask[y, x] != 0 else w)
            high = larger(high, x if mask[y, x] != 0 else -1)
        if high >= 0:
            top = y if top < 0 else top
            bottom = y
            left = smaller(left, low)
            right = larger(right, high)
    if right < 0:
        return -1, -1, -1, -1
    for x in range(w):
        columns[x] = f32(-9.0)
    for y in range(h):
        best = f32(-9.0)
        for x in range(left, right + 1):
            best = larger(best, odds[y, x])
        rows[y] = best
        if y >= top and y <= bottom:
            for x in range(w):
                columns[x] = larger(columns[x], odds[y, x])
    return left, right, top, bottom
