"""What a score is worth: a box that never moves, and the truth itself."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

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
    boxes : sequence of (x, y, w, h) or None
        The true box of each frame; None where the target is invisible.
    """

    def __init__(self, boxes: list[list[float] | None]) -> None:
        self._boxes = boxes
        self._frame = 0

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start at frame 0."""
        self._frame = 0

    def update(self, image: NDArray[Any]) -> tuple[bool, list[float]]:
        """Return the truth."""
        self._frame += 1
        box = self._boxes[self._frame]
        return box is not None, [0.0] * 4 if box is None else box
