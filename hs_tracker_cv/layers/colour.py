"""Colour histograms of object and background, and how much they tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["bin_count", "blend", "histogram", "likelihood"]

_BLUR = {n: (0.7 * np.eye(n) + 0.15 * (np.eye(n, k=1) + np.eye(n, k=-1))).astype(np.float32) for n in (8, 32)}
"""Smoothing along an axis of n bins, as a matrix: one product per axis."""


def bin_count(channels: int) -> int:
    """8 × 8 × 8 bins of BGR, 32 of gray."""
    return 512 if channels == 3 else 32


def histogram(counts: NDArray[np.float32]) -> NDArray[np.float32]:
    """Counts per bin, smoothed along each colour axis and normalised."""
    if counts.size == 512:
        blur = _BLUR[8]
        cube = (blur @ counts.reshape(8, 64)).reshape(8, 8, 8)
        smooth = (np.matmul(blur, cube).reshape(64, 8) @ blur).ravel()
    else:
        smooth = _BLUR[32] @ counts
    return np.asarray(smooth / max(float(smooth.sum()), 1.0), dtype=np.float32)


def blend(colours: NDArray[np.float32], tally: NDArray[np.float32], rate: float) -> NDArray[np.float32]:
    """Histograms (object, background) moved towards a frame's counts; one without pixels stays."""
    fresh = [histogram(new) if new.any() else old for new, old in zip(tally, colours, strict=True)]
    return np.asarray(colours + np.float32(rate) * (np.stack(fresh) - colours), dtype=np.float32)


def likelihood(colours: NDArray[np.float32], weight: float) -> tuple[NDArray[np.float32], float]:
    """Log-ratio object to background per bin, clipped to ±2, and the weight it deserves.

    Histograms that overlap (Bhattacharyya coefficient near 1) get next to none.
    """
    ratio = np.log((colours[0] + np.float32(1e-3)) / (colours[1] + np.float32(1e-3)))
    overlap = float(np.sqrt(colours[0] * colours[1]).sum())
    return np.clip(ratio, -2, 2).astype(np.float32), weight * max(0.0, 1.1 - overlap)
