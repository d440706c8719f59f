"""Colour histograms of object and background, and how much they tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .kernels import blend_colours

__all__ = ["BINS", "blend", "likelihood"]

BINS = 512
"""8 × 8 × 8 bins of BGR."""


def blend(colours: NDArray[np.float32], tally: NDArray[np.float32], rate: float) -> NDArray[np.float32]:
    """Histograms (object, background) moved towards a frame's counts, smoothed; one without pixels stays."""
    mixed = np.empty_like(colours)
    blend_colours(colours, tally, rate, np.empty_like(colours), mixed)
    return mixed


def likelihood(colours: NDArray[np.float32], weight: float) -> tuple[NDArray[np.float32], float]:
    """Log-ratio object to background per bin, clipped to ±2, and the weight it deserves.

    Histograms that overlap (Bhattacharyya coefficient near 1) get next to none.
    """
    logs = np.log(colours + np.float32(1e-3))
    ratio = np.minimum(np.maximum(logs[0] - logs[1], np.float32(-2.0)), np.float32(2.0))
    overlap = float(np.sqrt(colours[0] * colours[1]).sum())
    return ratio, weight * max(0.0, 1.1 - overlap)
