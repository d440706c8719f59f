"""Boxes: a float rectangle and pure functions on it.

Pixel column ``j`` covers ``[j, j + 1)``: the centre of a box is ``x + w / 2``, its area ``w * h``, and
there is no ±1 anywhere.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Box", "box_from_mask", "iou"]


class Box(NamedTuple):
    """A rectangle: top-left corner and size, in pixels, as floats.

    Parameters
    ----------
    x, y : float
        Left and top edge, px.
    w, h : float
        Width and height, px.

    Examples
    --------
    >>> Box(10, 20, 4, 6).centre
    (12.0, 23.0)
    """

    x: float
    y: float
    w: float
    h: float

    @property
    def centre(self) -> tuple[float, float]:
        """Centre (x, y), px."""
        return self.x + self.w / 2, self.y + self.h / 2

    @property
    def area(self) -> float:
        """Area, px²; 0 for a box of no extent."""
        return max(self.w, 0.0) * max(self.h, 0.0)

    @property
    def right(self) -> float:
        """Right edge, px."""
        return self.x + self.w

    @property
    def bottom(self) -> float:
        """Bottom edge, px."""
        return self.y + self.h

    @classmethod
    def from_edges(cls, left: float, top: float, right: float, bottom: float) -> Box:
        """Box between four edges; edges that cross give size 0."""
        return cls(left, top, max(right - left, 0.0), max(bottom - top, 0.0))

    @classmethod
    def from_centre(cls, cx: float, cy: float, w: float, h: float) -> Box:
        """Box of the given size round a centre."""
        return cls(cx - w / 2, cy - h / 2, w, h)

    def moved(self, dx: float, dy: float) -> Box:
        """Return the box translated by (dx, dy) px."""
        return Box(self.x + dx, self.y + dy, self.w, self.h)

    def scaled(self, factor: float) -> Box:
        """Return the box with its size multiplied, about its own centre."""
        cx, cy = self.centre
        return Box.from_centre(cx, cy, self.w * factor, self.h * factor)

    def grown(self, margin: float) -> Box:
        """Return the box with `margin` px added on every side."""
        return Box(self.x - margin, self.y - margin, self.w + 2 * margin, self.h + 2 * margin)

    def union(self, other: Box) -> Box:
        """Smallest box that holds both."""
        return Box.from_edges(
            min(self.x, other.x),
            min(self.y, other.y),
            max(self.right, other.right),
            max(self.bottom, other.bottom),
        )

    def intersection(self, other: Box) -> Box:
        """Common part; its size is 0 where there is none."""
        return Box.from_edges(
            max(self.x, other.x),
            max(self.y, other.y),
            min(self.right, other.right),
            min(self.bottom, other.bottom),
        )

    def clip(self, width: float, height: float) -> Box:
        """Part of the box inside a `width` × `height` frame: it shrinks and never moves."""
        return self.intersection(Box(0.0, 0.0, width, height))

    def rounded(self) -> tuple[int, int, int, int]:
        """Nearest box of whole pixels, as Python ints: edges are rounded, so a side is off by at most 1 px."""
        left, top = round(self.x), round(self.y)
        return left, top, max(round(self.right) - left, 1), max(round(self.bottom) - top, 1)


def iou(a: Box, b: Box) -> float:
    """Intersection over union of two boxes.

    Returns
    -------
    float
        In [0, 1]; 0 when either box has no area.

    Examples
    --------
    >>> iou(Box(0, 0, 2, 2), Box(1, 0, 2, 2))
    0.3333333333333333
    """
    common = a.intersection(b).area
    union = a.area + b.area - common
    return float(common / union) if union > 0 else 0.0


def box_from_mask(mask: NDArray[np.bool_] | NDArray[np.uint8]) -> Box | None:
    """Tight box of the non-zero pixels of a mask.

    Parameters
    ----------
    mask : ndarray, shape (H, W)

    Returns
    -------
    Box or None
        None for an empty mask.
    """
    columns = np.flatnonzero(mask.any(axis=0))
    if columns.size == 0:
        return None
    rows = np.flatnonzero(mask.any(axis=1))
    return Box.from_edges(float(columns[0]), float(rows[0]), float(columns[-1] + 1), float(rows[-1] + 1))
