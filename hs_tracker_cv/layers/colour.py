"""Colour histograms of object and background, and how much they tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["bin_count", "histogram", "likelihood"]

_TAPS = (0.15, 0.7, 0.15)


def bin_count(channels: int) -> int:
    """8 × 8 × 8 bins of BGR, 32 of gray."""
    return 512 if channels == 3 else 32


def histogram(bins: NDArray[np.int16], size: int) -> NDArray[np.float32]:
    """Normalised histogram of a list of bin numbers, smoothed along each colour axis."""
    counts = np.bincount(bins, minlength=size).astype(np.float32)
    cube = counts.reshape(8, 8, 8) if size == 512 else counts
    side, centre, _ = _TAPS
    for axis in range(cube.ndim):
        along = np.moveaxis(cube, axis, 0)
        smooth = np.float32(centre) * along
        smooth[1:] += np.float32(side) * along[:-1]
        smooth[:-1] += np.float32(side) * along[1:]
        cube = np.moveaxis(smooth, 0, axis)
    flat = np.ascontiguousarray(cube, dtype=np.float32).ravel()
    return np.asarray(flat / max(float(flat.sum()), 1.0), dtype=np.float32)


def likelihood(colours: NDArray[np.float32], weight: float) -> tuple[NDArray[np.float32], float]:
    """Log-ratio object to background per bin, clipped to ±2, and the weight it deserves.

    Histograms that overlap (Bhattacharyya coefficient near 1) get next to none.
    """
    ratio = np.log((colours[0] + np.float32(2e-4)) / (colours[1] + np.float32(2e-4)))
    overlap = float(np.sqrt(colours[0] * colours[1]).sum())
    return np.clip(ratio, -2, 2).astype(np.float32), weight * max(0.0, 1.1 - overlap)
