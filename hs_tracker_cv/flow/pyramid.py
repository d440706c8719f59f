"""Coarse-to-fine warping: the displacement is found on small frames first and refined level by level."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import kernels
from .params import FlowParams

__all__ = ["PyramidPlan", "estimate", "plan"]

MIN_SIDE = 16
"""Shortest side of a level, px."""

BLUR = 0.68
"""Blur before a level is reduced, in units of √(1/ratio² − 1) px: less lets high frequencies fold back."""

Taps = tuple[np.float32, np.float32, np.float32]


class PyramidPlan(NamedTuple):
    """What does not change from frame to frame: level sizes (levels, 2), memory in floats, blur taps."""

    sizes: NDArray[np.uint64]
    memory: int
    presmooth: Taps
    blur: Taps


@lru_cache(maxsize=4096)
def plan(height: int, width: int, params: FlowParams) -> PyramidPlan:
    """Plan the levels for frames of height × width px."""
    sizes = [(height, width)]
    while len(sizes) < params.levels:
        scale = params.ratio ** len(sizes)
        size = (round(height * scale), round(width * scale))
        if min(size) < MIN_SIDE:
            break
        sizes.append(size)
    full = (height + 4) * (width + 4)
    levels = sum((h + 4) * (w + 4) for h, w in sizes)
    return PyramidPlan(
        np.array(sizes, np.uint64),
        kernels.FLOW_PLANES * full + 2 * (width + 4) + 4 * levels,
        _gaussian(params.presmooth),
        _gaussian(BLUR * (1.0 / params.ratio**2 - 1.0) ** 0.5),
    )


def _gaussian(sigma: float) -> Taps:
    """Weights of the centre and of the neighbours 1 and 2 px away; they sum to 1 over the five."""
    if sigma == 0.0:
        return np.float32(1.0), np.float32(0.0), np.float32(0.0)
    taps = np.exp(-0.5 * (np.arange(3) / sigma) ** 2)
    taps /= taps[0] + 2.0 * (taps[1] + taps[2])
    return np.float32(taps[0]), np.float32(taps[1]), np.float32(taps[2])


def estimate(
    frame0: NDArray[np.float32],
    frame1: NDArray[np.float32],
    flow: NDArray[np.float32],
    started: bool,
    params: FlowParams,
    memory: NDArray[np.float32],
) -> None:
    """Estimate the flow from `frame0` to `frame1`, both (H, W, 1), into `flow` (H, W, 2).

    With `started`, `flow` holds a first guess: each level warps by it from the beginning. Mode "classic" runs here
    too: one level, no warping, plain Jacobi sweeps from the guess.
    """
    levels = plan(frame0.shape[0], frame0.shape[1], params)
    kernels.coarse_to_fine(
        frame0,
        frame1,
        flow,
        started,
        levels.sizes,
        memory,
        params.mode == "classic",
        params.derivative == "five-tap",
        np.uint64(params.warps),
        np.uint64(params.iterations),
        np.float32(0.0) if params.mode == "classic" else kernels.RADIUS,
        np.uint64(params.median),
        np.float32(params.smoothness),
        np.float32(1.0 / params.outlier**2 if params.outlier else 0.0),
        *levels.presmooth,
        *levels.blur,
    )
