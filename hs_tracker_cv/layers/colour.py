"""Colour histograms of object and background, and how much they tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["BINS", "blend", "histograms", "likelihood"]

BINS = 512
"""8 × 8 × 8 bins of BGR."""

_BLUR = (0.7 * np.eye(8) + 0.15 * (np.eye(8, k=1) + np.eye(8, k=-1))).astype(np.float32)
"""Smoothing along an axis."""


def blend(colours: NDArray[np.float32], tally: NDArray[np.float32], rate: float) -> NDArray[np.float32]:
    """Histograms (object, background) moved towards a frame's counts, smoothed; one without pixels stays."""
    # along blue, green and red, each as one product
    cubes = np.matmul(_BLUR, tally.reshape(2, 8, 64)).reshape(2, 8, 8, 8)
    smooth = np.matmul(np.matmul(_BLUR, cubes).reshape(2, 64, 8), _BLUR).reshape(2, BINS)
    totals = smooth.sum(axis=1, keepdims=True)
    shares = np.float32(rate) * (totals > 0)
    return np.asarray(colours + shares * (smooth / np.maximum(totals, 1) - colours), dtype=np.float32)


def histograms(tally: NDArray[np.float32]) -> NDArray[np.float32]:
    """Histograms (object, background) of counts alone, smoothed."""
    return blend(np.zeros_like(tally), tally, 1.0)


def likelihood(colours: NDArray[np.float32], weight: float) -> tuple[NDArray[np.float32], float]:
    """Log-ratio object to background per bin, clipped to ±2, and the weight it deserves.

    Histograms that overlap (Bhattacharyya coefficient near 1) get next to none.
    """
    logs = np.log(colours + np.float32(1e-3))
    ratio = np.minimum(np.maximum(logs[0] - logs[1], np.float32(-2.0)), np.float32(2.0))
    overlap = float(np.sqrt(colours[0] * colours[1]).sum())
    return ratio, weight * max(0.0, 1.1 - overlap)
