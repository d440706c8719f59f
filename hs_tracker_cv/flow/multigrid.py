"""The paper's linear system solved to a tolerance: what infinitely many sweeps of it would give."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .params import FlowParams
from .sweeps import chebyshev
from .workspace import Workspace

__all__ = ["solve"]

SWEEPS = 6
"""Sweeps on the finest grid after full multigrid and at the end of a cycle."""

RADIUS = 0.8
"""Upper end of the spectrum that their weights are made for; what is slower, coarser grids do."""

SWEEPS_ALONE = 8
"""Sweeps without coarser grids where these no longer help much: what they bring is rounded."""

RADIUS_ALONE = 0.97
"""Upper end of the spectrum that their weights are made for."""


def solve(
    frame0: NDArray[np.float32],
    frame1: NDArray[np.float32],
    flow: NDArray[np.float32],
    started: bool,
    params: FlowParams,
    workspace: Workspace,
) -> tuple[float, int]:
    """Solve for the flow between two frames (H, W) into `flow` (H, W, 2).

    Full multigrid, or with `started` the first guess that `flow` holds; a few sweeps; then V cycles, and
    sweeps alone where those become slow.

    Returns
    -------
    residual : float
        Over the right-hand side, 2-norms; before the last sweep, which makes it smaller still.
    sweeps : int
        On the finest grid.
    """
    grids = workspace.grids(frame0.shape)
    right = grids.begin(frame0, frame1, params.derivative == "five-tap", params.smoothness)
    if right == 0.0:
        flow[...] = 0.0
        return 0.0, 0
    if started:
        grids.guess(flow)
    else:
        grids.full()
    goal = params.tolerance * right
    norm = grids.sweep(SWEEPS, *chebyshev(RADIUS))
    done = SWEEPS
    while done < params.iterations and norm > goal:
        before = norm
        grids.correct()
        norm = grids.sweep(SWEEPS, *chebyshev(RADIUS))
        done += SWEEPS
        slow = norm > 0.1 * before
        while slow and norm > goal and done < params.iterations:
            last = norm
            norm = grids.sweep(SWEEPS_ALONE, *chebyshev(RADIUS_ALONE))
            done += SWEEPS_ALONE
            slow = norm < 0.3 * last
        if norm > 0.7 * before:  # as good as float32 gets
            break
    grids.store(flow)
    return norm / right, done
