"""Masks: grown, compared, measured."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, smaller
from .common import Integers, Mask, Plane, Row, fast_kernel

f32 = np.float32


@fast_kernel
def widen(mask: Mask, reach: int, held: Mask, out: Mask) -> None:
    """Write 1 where a pixel of the mask lies within `reach` px, in rows and in columns. `held` is a workspace."""
    h, w = mask.shape
    for y in range(h):
        for x in range(w):
            held[y, x] = mask[y, x]
        for row in range(larger(y - reach, 0), smaller(y + reach + 1, h)):
            for x in range(w):
                held[y, x] |= mask[row, x]
    for y in range(h):
        for x in range(w):
            out[y, x] = held[y, x]
        for d in range(1, reach + 1):
            for x in range(w - d):
                out[y, x] |= held[y, x + d]
            for x in range(d, w):
                out[y, x] |= held[y, x - d]


@fast_kernel
def spread(seed: Mask, allowed: Mask, times: int, held: Mask, out: Mask) -> None:
    """Write 1 where pixels of `allowed` are reached from `seed` in so many steps, each to one of eight neighbours.

    The way leads over `allowed` and `seed`. `held` is a workspace.
    """
    h, w = seed.shape
    for y in range(h):
        for x in range(w):
            out[y, x] = seed[y, x]
    for _ in range(times):
        for y in range(h):
            held[y, 0] = out[y, 0] | out[y, 1]
            for x in range(1, w - 1):
                held[y, x] = out[y, x - 1] | out[y, x] | out[y, x + 1]
            held[y, w - 1] = out[y, w - 2] | out[y, w - 1]
        for y in range(h):
            up = larger(y - 1, 0)
            down = smaller(y + 1, h - 1)
            for x in range(w):
                out[y, x] |= allowed[y, x] & (held[up, x] | held[y, x] | held[down, x])
    for y in range(h):
        for x in range(w):
            out[y, x] &= allowed[y, x]


@fast_kernel
def overlap(mask: Mask, shape: Plane, inside: Integers) -> tuple[int, int, int]:
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


@fast_kernel
def extremes(mask: Mask, odds: Plane, columns: Row, rows: Row) -> tuple[int, int, int, int]:
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
