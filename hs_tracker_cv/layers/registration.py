"""Registration of a layer in a frame: its pixels listed once, then moved until they fit."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .kernels import collect, gauss_newton
from .state import Image, Plane

__all__ = ["Fit", "Points", "list_points", "misfit", "refine"]

_NO_PRIOR = np.zeros(8)


class Points(NamedTuple):
    """Pixels of a layer that a motion is measured by; see `kernels.collect`."""

    rows: NDArray[np.float32]
    length: int


class Fit(NamedTuple):
    """A motion found, as in `kernels.gauss_newton`, and the mean residuals at the start and at the end."""

    theta: NDArray[np.float64]
    before: float
    after: float


def list_points(reference: Image, weight: Plane, grid: NDArray[np.float64], area: float, wanted: int) -> Points:
    """About `wanted` pixels of `reference`, evenly taken from the `area` pixels where `weight` is positive."""
    stride = max(1, round(area / wanted))
    rows = np.empty((5 + 3 * reference.shape[2], 3 * wanted // 2 + 200), np.float32)
    return Points(rows, collect(reference, weight, grid, stride, rows))


def misfit(
    points: Points, image: Image, theta: NDArray[np.float64], ceiling: float, inside: NDArray[np.int64]
) -> float:
    """Mean residual of a motion, none counted as more than `ceiling`."""
    return float(
        gauss_newton(image, points.rows, points.length, theta, _NO_PRIOR, 1.0, ceiling, inside, np.empty(1), 0)
    )


def refine(
    points: Points,
    image: Image,
    start: NDArray[np.float64],
    prior: NDArray[np.float64],
    scale: float,
    ceiling: float,
    inside: NDArray[np.int64],
    steps: int = 3,
) -> Fit:
    """Refine a motion, in so many steps at most, towards the least residual."""
    theta, before = start.copy(), np.empty(1)
    after = gauss_newton(image, points.rows, points.length, theta, prior, scale, ceiling, inside, before, steps)
    return Fit(theta, float(before[0]), float(after))
