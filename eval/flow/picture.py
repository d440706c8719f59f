"""Flow fields as pictures, in the Middlebury colour wheel: hue is the direction, saturation the length."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["color_wheel", "flow_to_color", "largest_flow", "wheel_legend"]

_SEGMENTS = (
    # (steps, colour at its start, colour at its end), RGB; perceptually even steps, Baker et al., IJCV 92, 2011.
    (15, (1, 0, 0), (1, 1, 0)),
    (6, (1, 1, 0), (0, 1, 0)),
    (4, (0, 1, 0), (0, 1, 1)),
    (11, (0, 1, 1), (0, 0, 1)),
    (13, (0, 0, 1), (1, 0, 1)),
    (6, (1, 0, 1), (1, 0, 0)),
)


def color_wheel() -> NDArray[np.float64]:
    """The 55 saturated colours of the wheel.

    Returns
    -------
    ndarray, shape (55, 3)
        RGB in 0–1, from red through yellow, green, cyan, blue and magenta.
    """
    parts = []
    for steps, start, end in _SEGMENTS:
        t = np.arange(steps)[:, np.newaxis] / steps
        parts.append((1.0 - t) * np.array(start) + t * np.array(end))
    return np.concatenate(parts)


def largest_flow(flow: NDArray[np.floating[Any]], valid: NDArray[np.bool_]) -> float:
    """Length that gets full saturation: the longest true flow of a pair, px, and at least a little above zero."""
    vectors = flow[valid]
    return max(float(np.hypot(vectors[:, 0], vectors[:, 1]).max(initial=0.0)), 1e-3)


def flow_to_color(
    flow: NDArray[np.floating[Any]], longest: float, valid: NDArray[np.bool_] | None = None
) -> NDArray[np.uint8]:
    """Paint a flow field.

    Parameters
    ----------
    flow : ndarray, shape (H, W, 2)
        px per frame. Non-finite vectors are painted black.
    longest : float
        Length that gets full saturation, px; longer vectors are darkened, as Middlebury does.
    valid : ndarray of bool, shape (H, W), optional
        Other pixels are painted black.

    Returns
    -------
    ndarray, shape (H, W, 3), uint8
        BGR, as cv2 writes it. No motion is white; opposite directions have opposite hues.

    Raises
    ------
    ValueError
        If the flow has another shape or ``longest`` is not positive.
    """
    if flow.ndim != 3 or flow.shape[2] != 2:
        raise ValueError(f"expected a flow of shape (H, W, 2), got {flow.shape}")
    if not longest > 0:
        raise ValueError(f"expected a positive longest flow, got {longest}")
    known = np.isfinite(flow).all(axis=2) if valid is None else valid & np.isfinite(flow).all(axis=2)
    u, v = np.moveaxis(np.where(known[:, :, np.newaxis], flow, 0.0) / longest, 2, 0)
    radius = np.hypot(u, v)[:, :, np.newaxis]
    wheel = color_wheel()
    # Middlebury's convention: the wheel starts (red) at the direction (+1, 0) and runs clockwise on the screen.
    position = (np.arctan2(v, u) / (2.0 * np.pi)) % 1.0 * len(wheel)
    lower = np.floor(position).astype(int) % len(wheel)
    t = (position - np.floor(position))[:, :, np.newaxis]
    hue = (1.0 - t) * wheel[lower] + t * wheel[(lower + 1) % len(wheel)]
    color = np.where(radius <= 1.0, 1.0 - radius * (1.0 - hue), 0.75 * hue)
    color[~known] = 0.0
    return np.ascontiguousarray(np.rint(255.0 * color[:, :, ::-1]).astype(np.uint8))


def wheel_legend(size: int) -> NDArray[np.uint8]:
    """The wheel itself: the picture of a flow that points away from the centre, full saturation at the rim.

    Parameters
    ----------
    size : int
        Side, px.

    Returns
    -------
    ndarray, shape (size, size, 3), uint8, BGR
        White outside the rim.
    """
    axis = np.linspace(-1.0, 1.0, size)
    flow = np.stack(np.meshgrid(axis, axis), axis=2)
    picture = flow_to_color(flow, 1.0)
    picture[np.hypot(flow[:, :, 0], flow[:, :, 1]) > 1.0] = 255
    return picture
