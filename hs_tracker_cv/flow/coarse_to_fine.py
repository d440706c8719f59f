"""Coarse-to-fine warping: the displacement is found on small frames first and refined level by level."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .._native import kernels
from .._native.kernels import Planes
from .params import FlowParams
from .sweeps import chebyshev
from .workspace import Workspace

__all__ = ["Solver", "coarse_to_fine", "horn_schunck_solver", "level_sizes"]

MIN_SIDE = 16
"""Shortest side of a level, px."""

BLUR = 0.68
"""Blur before a level is reduced, in units of √(1/ratio² − 1) px: less lets high frequencies fold back."""

RADIUS = 0.97
"""Upper end of the spectrum that Chebyshev's weights are made for; what is slower, coarser levels have done."""

Size = tuple[int, int]
Taps = tuple[float, float, float]

Solver = Callable[[Planes, Planes], None]
"""``solver(frames, flow)`` refines a level's flow in place.

``frames[0]`` and ``frames[1]`` are the frames, ``flow[0]`` and ``flow[1]`` are u and v so far, px: arrays (h, w) that
share memory with the planes, or the planes themselves for kernels.
"""


def coarse_to_fine(
    frame0: NDArray[np.float32],
    frame1: NDArray[np.float32],
    solver: Solver,
    flow: NDArray[np.float32],
    started: bool,
    params: FlowParams,
    workspace: Workspace,
) -> None:
    """Refine the flow by `solver` on each level of a pyramid, the coarsest first.

    Parameters
    ----------
    frame0, frame1 : ndarray, shape (H, W)
    solver : callable
        See :data:`Solver`.
    flow : ndarray, shape (H, W, 2)
        Holds a first guess if `started`, and at the end the result, px.
    started : bool
    params : FlowParams
        Of the pyramid: levels, ratio and presmooth.
    workspace : Workspace
    """
    sizes = level_sizes(frame0.shape, params.levels, params.ratio)
    count = 4 if started else 2  # with a first guess each level has a reduced copy of it
    frames = [workspace.planes(("frames", level), count, size) for level, size in enumerate(sizes)]
    flows = [workspace.planes(("flow", level), 2, size) for level, size in enumerate(sizes)]
    kernels.load_frames(frame0, frame1, flow if started else None, gaussian(params.presmooth), frames[0], flows[0])
    blur = gaussian(BLUR * (1.0 / params.ratio**2 - 1.0) ** 0.5)
    for fine, coarse in itertools.pairwise(frames):
        kernels.reduce_frames(fine, blur, coarse)
    kernels.begin_flow(frames[-1], flows[-1])
    solver(frames[-1], flows[-1])
    for level in reversed(range(len(sizes) - 1)):
        kernels.expand_flow(frames[level + 1], flows[level + 1], frames[level], flows[level])
        solver(frames[level], flows[level])
    kernels.store_flow(flows[0], flow)


def horn_schunck_solver(params: FlowParams, workspace: Workspace) -> Solver:
    """Make a solver for one pair of frames: warp the second, linearise, sweep, take the median, `warps` times."""
    relax, quarter_square = chebyshev(RADIUS)
    how = kernels.Refinement(
        smoothness=params.smoothness,
        five_tap=params.derivative == "five-tap",
        warps=params.warps,
        sweeps=params.iterations,
        median=params.median,
        outlier=1.0 / params.outlier**2 if params.outlier else 0.0,
        relax=relax,
        quarter_square=quarter_square,
        exposure=params.exposure,
    )
    exposure: tuple[float, float] | None = None  # of the level before

    def solve(frames: Planes, flow: Planes) -> None:
        nonlocal exposure
        scratch = workspace.planes("refine", 7, frames[0].shape)
        exposure = kernels.refine(frames, flow, how, exposure, scratch)

    return solve


@lru_cache(maxsize=1024)
def level_sizes(size: Size, levels: int, ratio: float) -> tuple[Size, ...]:
    """Sizes (height, width) of at most so many levels, the finest first."""
    height, width = size
    sizes = [size]
    while len(sizes) < levels:
        scale = ratio ** len(sizes)
        size = (round(height * scale), round(width * scale))
        if min(size) < MIN_SIDE:
            break
        sizes.append(size)
    return tuple(sizes)


@lru_cache
def gaussian(sigma: float) -> Taps:
    """Weights of the centre and of the neighbours 1 and 2 px away; they sum to 1 over the five. None at 0 px."""
    if sigma == 0.0:
        return 1.0, 0.0, 0.0
    taps = np.exp(-0.5 * (np.arange(3) / sigma) ** 2)
    centre, near, far = (taps / (taps[0] + 2.0 * (taps[1] + taps[2]))).tolist()
    return centre, near, far
