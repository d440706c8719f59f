"""Colours: 8 × 8 × 8 bins of blue, green and red."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from .common import Bins, Image, fast_kernel, fast_part


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
