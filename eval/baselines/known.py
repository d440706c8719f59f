"""What a score is worth: a box that never moves, and the truth itself."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..regions import Mask, read_region

__all__ = ["Oracle", "Static"]


class Static:
    """The box never moves: what a score is worth when nothing is tracked."""

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Remember the box."""
        self._box = boundingBox

    def update(self, image: NDArray[Any]) -> tuple[bool, tuple[int, int, int, int]]:
        """Return it."""
        return True, self._box


class Oracle:
    """Test double that knows the truth; it must score 1 in everything.

    Parameters
    ----------
    boxes : ndarray, shape (T, 4)
        The true box of each frame; NaN where the target is invisible.
    regions : sequence of str
        Its mask or rotated box, see :class:`eval.sequences.Sequence`.
    """

    def __init__(self, boxes: NDArray[np.float64], regions: Sequence[str]) -> None:
        self._boxes = boxes
        self._regions = [read_region(text) if text else None for text in regions]
        self._frame = 0
        self._shape = (0, 0)

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start at frame 0."""
        self._frame = 0
        self._shape = image.shape[:2]

    def update(self, image: NDArray[Any]) -> tuple[bool, list[float]]:
        """Return the truth."""
        self._frame += 1
        box, region = self._boxes[self._frame], self._region()
        if not np.isfinite(box).all():
            return False, [0.0] * 4
        return True, (region if isinstance(region, np.ndarray) else box).ravel().tolist()

    def getMask(self) -> NDArray[np.bool_] | None:
        """Return the true mask, where it is known."""
        region = self._region()
        if not isinstance(region, Mask):
            return None
        inside = region.within((self._shape[1], self._shape[0]))
        mask = np.zeros(self._shape, dtype=np.bool_)
        height, width = inside.pixels.shape
        mask[inside.y : inside.y + height, inside.x : inside.x + width] = inside.pixels
        return mask

    def _region(self) -> Mask | NDArray[np.float64] | None:
        return self._regions[self._frame] if self._regions else None
