"""How wrong a flow field is: endpoint and angular error where the truth is known.

Conventions
-----------
A flow is ``(H, W, 2)``, px per frame, u right and v down. ``valid`` is ``(H, W)`` bool, True where the truth is
known. Every metric takes ``(reference, estimated, valid)`` in this order, checks them, and is a pure function. A
method that leaves NaN or infinity at a pixel it was asked about is in error and is reported so: silently dropping
such pixels would reward it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["FLOW_METRICS", "FlowMetric", "angular_error", "endpoint_error", "flow_scores"]


def endpoint_error(
    reference: NDArray[np.floating[Any]], estimated: NDArray[np.floating[Any]], valid: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Distance between the true and the estimated arrow tip, at every valid pixel.

    Parameters
    ----------
    reference, estimated : ndarray, shape (H, W, 2)
        Flow, px per frame.
    valid : ndarray of bool, shape (H, W)
        Where the truth is known.

    Returns
    -------
    ndarray, shape (N,)
        Endpoint error of the N valid pixels, px (Otte and Nagel, ECCV 1994).

    Raises
    ------
    ValueError
        If the shapes disagree, nothing is valid, or a flow is not finite where it is compared.
    """
    difference = _at_valid(estimated, valid, "estimated") - _at_valid(reference, valid, "reference", estimated.shape)
    return np.asarray(np.hypot(difference[:, 0], difference[:, 1]))


def angular_error(
    reference: NDArray[np.floating[Any]], estimated: NDArray[np.floating[Any]], valid: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Angle between (u, v, 1) of the truth and of the estimate, at every valid pixel.

    Parameters
    ----------
    reference, estimated : ndarray, shape (H, W, 2)
        Flow, px per frame.
    valid : ndarray of bool, shape (H, W)
        Where the truth is known.

    Returns
    -------
    ndarray, shape (N,)
        Angle of the N valid pixels, degrees, in [0, 180) (Barron, Fleet and Beauchemin, IJCV 12, 1994).

    Raises
    ------
    ValueError
        As :func:`endpoint_error`.

    Notes
    -----
    Computed as atan2(|a × b|, a · b): the textbook arc cosine loses half the digits for nearly equal vectors, and an
    oracle must score exactly 0.
    """
    u, v = _at_valid(reference, valid, "reference", estimated.shape).T
    p, q = _at_valid(estimated, valid, "estimated").T
    cross = np.sqrt((v - q) ** 2 + (u - p) ** 2 + (u * q - v * p) ** 2)
    return np.asarray(np.degrees(np.arctan2(cross, u * p + v * q + 1.0)))


def _at_valid(
    flow: NDArray[np.floating[Any]], valid: NDArray[np.bool_], name: str, shape: tuple[int, ...] | None = None
) -> NDArray[np.float64]:
    if flow.ndim != 3 or flow.shape[2] != 2 or (shape is not None and flow.shape != shape):
        raise ValueError(f"expected {name} flow of shape {shape or '(H, W, 2)'}, got {flow.shape}")
    if valid.shape != flow.shape[:2]:
        raise ValueError(f"expected valid of shape {flow.shape[:2]}, got {valid.shape}")
    vectors = np.asarray(flow[valid], dtype=np.float64)
    if vectors.shape[0] == 0:
        raise ValueError("expected at least one pixel with known flow, got none")
    wrong = int((~np.isfinite(vectors).all(axis=1)).sum())
    if wrong:
        raise ValueError(
            f"expected a finite {name} flow at every valid pixel, got {wrong} of {len(vectors)} that are not"
        )
    return vectors


@dataclass(frozen=True)
class FlowMetric:
    """One number per pair, and how to read it.

    Parameters
    ----------
    label : str
        Heading in tables.
    unit : str
    description : str
    score : callable
        ``(endpoint errors, angular errors, true lengths) -> float``; NaN if it says nothing on this pair.
    """

    label: str
    unit: str
    description: str
    score: Callable[[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]], float]


MOVING = 0.5
"""A pixel whose true motion is longer than this moves, px."""


def _mean_where_moving(epe: NDArray[np.float64], length: NDArray[np.float64]) -> float:
    moving = length > MOVING
    return float(epe[moving].mean()) if moving.any() else math.nan


FLOW_METRICS: dict[str, FlowMetric] = {
    "aepe": FlowMetric("AEPE", "px", "mean endpoint error", lambda epe, angle, length: float(epe.mean())),
    "moving": FlowMetric(
        "AEPE moving",
        "px",
        "the same over pixels that move more than half a pixel",
        lambda epe, angle, length: _mean_where_moving(epe, length),
    ),
    "aae": FlowMetric("AAE", "°", "mean angular error of (u, v, 1)", lambda epe, angle, length: float(angle.mean())),
    "r1": FlowMetric(
        "R1",
        "%",
        "share of pixels wrong by more than 1 px",
        lambda epe, angle, length: 100.0 * float((epe > 1.0).mean()),
    ),
}
"""Metrics by name; less is better for all of them."""


def flow_scores(
    reference: NDArray[np.floating[Any]], estimated: NDArray[np.floating[Any]], valid: NDArray[np.bool_]
) -> dict[str, float]:
    """Every metric of :data:`FLOW_METRICS` for one pair of frames.

    Parameters
    ----------
    reference, estimated : ndarray, shape (H, W, 2)
        Flow, px per frame.
    valid : ndarray of bool, shape (H, W)

    Returns
    -------
    dict
        Metric name to value.

    Raises
    ------
    ValueError
        As :func:`endpoint_error`.

    Examples
    --------
    >>> truth = np.zeros((4, 4, 2)); guess = truth + (3.0, 4.0)
    >>> flow_scores(truth, guess, np.ones((4, 4), bool))["aepe"]
    5.0
    """
    epe = endpoint_error(reference, estimated, valid)
    angle = angular_error(reference, estimated, valid)
    length = np.hypot(*_at_valid(reference, valid, "reference").T)
    return {name: metric.score(epe, angle, length) for name, metric in FLOW_METRICS.items()}
