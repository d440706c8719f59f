"""The paper's sweeps on one scale: each flow vector becomes its neighbours' average, corrected along the gradient."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._native import kernels
from .params import Derivative, FlowParams
from .workspace import Workspace

__all__ = ["Relaxation", "chebyshev", "classic", "derivatives"]

Gray = NDArray[np.float32]
Relaxation = tuple[float, float]
"""Weight of a sweep's result, and a quarter of the squared radius of the relaxed sweep's spectrum."""

LOWEST = -1.0 / 3.0
"""Lower end of the spectrum of a sweep, which the weights of the average give."""


def chebyshev(highest: float) -> Relaxation:
    """Weights of accelerated sweeps for a spectrum in [−1/3, `highest`]."""
    relax = 2.0 / (2.0 - LOWEST - highest)
    radius = (highest - LOWEST) / (2.0 - LOWEST - highest)
    return relax, 0.25 * radius * radius


def classic(
    frame0: Gray, frame1: Gray, flow: NDArray[np.float32], started: bool, params: FlowParams, workspace: Workspace
) -> None:
    """Sweep as often as asked for, from the first guess in `flow` (H, W, 2) if `started`; leave the result there."""
    five_tap = params.derivative == "five-tap"
    planes = workspace.planes("classic", 7, frame0.shape)
    kernels.classic(frame0, frame1, flow, started, five_tap, params.smoothness, params.iterations, planes)


def derivatives(frame0: Gray, frame1: Gray, derivative: Derivative) -> tuple[Gray, Gray, Gray]:
    """F_x, F_y and F_t of two frames."""
    planes = kernels.Planes(5, *frame0.shape)
    kernels.derivatives(frame0, frame1, derivative == "five-tap", planes)
    return planes[0].copy(), planes[1].copy(), planes[2].copy()
