"""Colours: 8 × 8 × 8 bins of blue, green and red, and histograms of object and background over them."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, root, smaller
from .common import Bins, Image, Plane, Row, fast_kernel, fast_part

f32 = np.float32
_RARE = np.float32(1e-3)  # share added to every colour's
_SURE = np.float32(7.389056)  # e²: ratio of shares from which on it makes no difference
_HERE, _BESIDE = np.float32(0.7), np.float32(0.15)


@fast_part
def bin_row(image, y, bins):
    """Bin of each pixel of a row."""
    for x in range(bins.shape[1]):
        blue = np.int32(image[y, x, 0])
        green = np.int32(image[y, x, 1])
        red = np.int32(image[y, x, 2])
        bins[y, x] = ((blue >> 5) << 6) + ((green >> 5) << 3) + (red >> 5)


@fast_kernel
def bin_colours(image: Image, bins: Bins) -> None:
    """Bin of each pixel."""
    if image.shape[2] != 3:
        return
    for y in range(bins.shape[0]):
        bin_row(image, y, bins)


@fast_kernel
def likelihood(colours: Plane, ratio: Row) -> float:
    """Write the log-ratio of object to background per bin, clipped to ±2.

    Returns how much the histograms overlap: their Bhattacharyya coefficient, 1 where they are the same.
    """
    overlap = 0.0
    for i in range(colours.shape[1]):
        a = colours[0, i]
        b = colours[1, i]
        overlap += root(a * b)
        q = (a + _RARE) / (b + _RARE)
        q = smaller(larger(q, f32(1.0) / _SURE), _SURE)
        # ln q = 4 ln √√q, and ln y = 2 artanh t, of which five terms are exact here
        y = root(root(q))
        t = (y - f32(1.0)) / (y + f32(1.0))
        s = t * t
        series = f32(1 / 9) * s + f32(1 / 7)
        series = series * s + f32(1 / 5)
        series = series * s + f32(1 / 3)
        ratio[i] = f32(8.0) * t * (series * s + f32(1.0))
    return 1.0 * overlap


@fast_part
def _smooth(cube, which, step):
    """Smooth a histogram along one colour, whose neighbouring bins are `step` apart, in place."""
    for first in range(64):
        at = first % step + first // step * 8 * step
        before = f32(0.0)
        here = cube[which, at]
        for k in range(8):
            after = cube[which, at + step] if k < 7 else f32(0.0)
            cube[which, at] = _HERE * here + _BESIDE * (before + after)
            before = here
            here = after
            at += step


@fast_kernel
def blend(colours: Plane, tally: Plane, rate: float, out: Plane) -> None:
    """Move histograms (object, background) towards a frame's counts, smoothed; one without pixels stays.

    The counts are smoothed in place.
    """
    bins = tally.shape[1]
    for which in range(2):
        step = 64
        for _ in range(3):
            _smooth(tally, which, step)
            step //= 8
        total = f32(0.0)
        for i in range(bins):
            total += tally[which, i]
        share = f32(rate) if total > f32(0.0) else f32(0.0)
        unit = f32(1.0) / larger(total, f32(1.0))
        for i in range(bins):
            out[which, i] = colours[which, i] + share * (tally[which, i] * unit - colours[which, i])
