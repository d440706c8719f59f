"""The flow of Horn & Schunck (1981), steps 1–5 of the tracking paper, in plain NumPy, line for line.

This is what mode "classic" must equal and what a student reads first. Slips of the paper's text put right here:

- The derivatives are averages of *four* differences, so the factor is 1/4 in F_x, F_y and F_t alike.
- The mask of F_y is [-1 -1; 1 1]. It and the others are meant as *correlation* masks. MATLAB's ``conv2`` flips its
  kernel: [-1 1; -1 1] / 4 applied by it to a ramp gives −1/2 in F_x and F_y, while the mask of F_t has no direction
  to flip, so the lines taken literally give the flow the wrong sign.
- The denominator is D = λ² + F_x² + F_y², with λ squared.
- Borders repeat the outermost pixel. With zeros there, as ``conv2(…, 'same')`` has it, the frame's edge would count
  as motion and draw the flow to zero; with mirroring the system would not be symmetric.

The flow points from the first frame to the second: I0[y, x] ≈ I1[y + v, x + u]; u to the right, v downwards.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["average", "derivatives", "flow"]

Plane = NDArray[np.float64]


def derivatives(first: NDArray[Any], second: NDArray[Any]) -> tuple[Plane, Plane, Plane]:
    """Steps 1–3: F_x, F_y, F_t over the 2 × 2 × 2 cube of pixel (y, x), its neighbours and the next frame.

    Parameters
    ----------
    first, second : ndarray, shape (H, W)
        Gray frames, 0–255.

    Returns
    -------
    Fx, Fy, Ft : ndarray, shape (H, W)
        Gray levels per px, per px and per frame, at (x + ½, y + ½), half a frame after the first.
    """
    e, f = _with_next(first), _with_next(second)
    fx = (
        0.25
        * (  # mask [-1 1; -1 1] / 4 on both frames
            (e[:-1, 1:] - e[:-1, :-1])
            + (e[1:, 1:] - e[1:, :-1])
            + (f[:-1, 1:] - f[:-1, :-1])
            + (f[1:, 1:] - f[1:, :-1])
        )
    )
    fy = (
        0.25
        * (  # mask [-1 -1; 1 1] / 4 on both frames
            (e[1:, :-1] - e[:-1, :-1])
            + (e[1:, 1:] - e[:-1, 1:])
            + (f[1:, :-1] - f[:-1, :-1])
            + (f[1:, 1:] - f[:-1, 1:])
        )
    )
    ft = (
        0.25
        * (  # mask [1 1; 1 1] / 4 on the difference
            (f[:-1, :-1] - e[:-1, :-1])
            + (f[:-1, 1:] - e[:-1, 1:])
            + (f[1:, :-1] - e[1:, :-1])
            + (f[1:, 1:] - e[1:, 1:])
        )
    )
    return fx, fy, ft


def _with_next(frame: NDArray[Any]) -> Plane:
    """The frame as float64 with its last row and column repeated once."""
    return np.pad(np.asarray(frame, np.float64), ((0, 1), (0, 1)), mode="edge")


def average(u: Plane) -> Plane:
    """Step 4's ū: the eight neighbours with weights 1/6 (sides) and 1/12 (corners), the border repeated."""
    p = np.pad(u, 1, mode="edge")
    sides = p[:-2, 1:-1] + p[2:, 1:-1] + p[1:-1, :-2] + p[1:-1, 2:]
    corners = p[:-2, :-2] + p[:-2, 2:] + p[2:, :-2] + p[2:, 2:]
    return np.asarray(sides / 6.0 + corners / 12.0)


def flow(
    first: NDArray[Any],
    second: NDArray[Any],
    smoothness: float,
    iterations: int,
    start: NDArray[Any] | None = None,
) -> Plane:
    """Steps 4–5: `iterations` sweeps of u = ū − F_x (F_x ū + F_y v̄ + F_t) / D, and the same for v.

    Parameters
    ----------
    first, second : ndarray, shape (H, W)
        Gray frames, 0–255.
    smoothness : float
        λ, gray levels.
    iterations : int
    start : ndarray, shape (H, W, 2), optional
        Flow to start from; zero if absent.

    Returns
    -------
    ndarray, shape (H, W, 2), float64
        px per frame.
    """
    fx, fy, ft = derivatives(first, second)
    d = smoothness**2 + fx**2 + fy**2
    u, v = np.zeros((2, *fx.shape)) if start is None else np.moveaxis(np.asarray(start, np.float64), -1, 0)
    for _ in range(iterations):
        u_bar, v_bar = average(u), average(v)
        p = fx * u_bar + fy * v_bar + ft
        u = u_bar - fx * p / d
        v = v_bar - fy * p / d
    return np.stack((u, v), axis=-1)
