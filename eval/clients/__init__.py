"""Adapters by which other people's harnesses run our trackers; their packages are needed only when that is done."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..trackers import find_tracker
from ..worker import resolve

__all__ = ["Follower"]

BoxTuple = tuple[float, float, float, float]


class Follower:
    """A tracker as those harnesses want one: a box for every frame, whether it is located or not.

    Parameters
    ----------
    tracker : str
        A name of :data:`eval.trackers.TRACKERS`, or ``pkg.module:factory``.

    Raises
    ------
    ValueError
        If there is no such tracker, or it is the oracle, which needs a truth that they do not hand over.
    """

    def __init__(self, tracker: str = "TrackerHS") -> None:
        spec = find_tracker(tracker)
        if spec.sees_truth:
            raise ValueError(f"expected a tracker that sees frames only, got {tracker!r}")
        self.name = spec.name
        self.deterministic = spec.repeats == 1
        self._spec = spec
        self._tracker: Any = None
        self._box: BoxTuple = (0.0, 0.0, 0.0, 0.0)

    def init(self, image: NDArray[np.uint8], box: Sequence[float]) -> None:
        """Start on a frame (H, W, 3), BGR, with x, y, w, h in px; 0-based."""
        self._tracker = resolve(self._spec.factory)(**self._spec.params)
        x, y, w, h = (float(value) for value in box)
        self._box = (x, y, w, h)
        # Whole numbers, as in our own runs.
        self._tracker.init(image, tuple(round(value) for value in self._box))

    def update(self, image: NDArray[np.uint8]) -> tuple[BoxTuple, float]:
        """Box in the next frame and confidence in [0, 1]; while the object is lost, its last box and 0."""
        ok, box = self._tracker.update(image)
        if not ok:
            return self._box, 0.0
        x, y, w, h = (float(value) for value in box)
        self._box = (x, y, w, h)
        score = float(self._tracker.getTrackingScore()) if hasattr(self._tracker, "getTrackingScore") else -1.0
        return self._box, score if score >= 0 else 1.0
