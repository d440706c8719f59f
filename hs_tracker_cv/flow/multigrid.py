"""The paper's linear system solved to a tolerance: what infinitely many sweeps of it would give."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import kernels
from .params import FlowParams

__all__ = ["GridPlan", "plan", "solve"]

COARSEST = 4
"""Shortest side of the coarsest grid, px."""


class GridPlan(NamedTuple):
    """Sizes of the grids (grids, 2), the finest first, and the memory they need in floats."""

    sizes: NDArray[np.uint64]
    memory: int


@lru_cache(maxsize=256)
def plan(height: int, width: int) -> GridPlan:
    """Plan the grids for frames of height × width px."""
    sizes = [(height, width)]
    while min(sizes[-1]) > COARSEST:
        h, w = sizes[-1]
        sizes.append(((h + 1) // 2, (w + 1) // 2))
    planes = [(h + 4) * (w + 4) for h, w in sizes]
    return GridPlan(
        np.array(sizes, np.uint64), kernels.SOLVE_PLANES * planes[0] + kernels.GRID_PLANES * sum(planes[1:])
    )


def solve(
    frame0: NDArray[np.float32],
    frame1: NDArray[np.float32],
    flow: NDArray[np.float32],
    started: bool,
    params: FlowParams,
    memory: NDArray[np.float32],
) -> tuple[float, int]:
    """Solve for the flow between two frames (H, W, 1) into `flow` (H, W, 2).

    With `started`, `flow` holds a first guess.

    Returns
    -------
    residual : float
        Over the right-hand side, 2-norms.
    sweeps : int
        On the finest grid.
    """
    residual, sweeps = kernels.full_multigrid(
        frame0,
        frame1,
        flow,
        started,
        plan(frame0.shape[0], frame0.shape[1]).sizes,
        memory,
        params.derivative == "five-tap",
        np.float32(params.smoothness),
        params.tolerance,
        np.uint64(params.iterations),
    )
    return float(residual), int(sweeps)
