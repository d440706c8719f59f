"""Adapters by which other people's harnesses run our trackers; their packages are needed only when that is done."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..track import read_answer, whole_box
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
        self._said = False

    def init(self, image: NDArray[np.uint8], box: Sequence[float]) -> None:
        """Start on a frame (H, W, 3), BGR, with x, y, w, h in px; 0-based.

        A tracker that refuses them has lost the object for the whole sequence; the reason goes to standard error.
        """
        x, y, w, h = (float(value) for value in box)
        self._box, self._said = (x, y, w, h), False
        self._tracker = None
        tracker = resolve(self._spec.factory)(**self._spec.params)
        try:
            if not np.isfinite(self._box).all():
                raise ValueError(f"expected a box of finite numbers, got {self._box}")
            whole = whole_box(self._box, (image.shape[1], image.shape[0]))
            if tracker.init(image, whole) is False:
                raise ValueError(f"init refused the box {whole}")
        except Exception as error:  # the experiment goes on, whatever a tracker makes of one sequence of it
            self._say(error)
        else:
            self._tracker = tracker

    def update(self, image: NDArray[np.uint8]) -> tuple[BoxTuple, float]:
        """Box in the next frame and confidence in [0, 1]; while the object is lost, its last box and 0.

        Of a rotated box it is the box round it. The object is lost, too, in a frame that the tracker refuses, or
        about which it says nothing that is a box; the first reason of a sequence goes to standard error.
        """
        if self._tracker is None:
            return self._box, 0.0
        try:
            ok, (x, y, w, h), _ = read_answer(self._tracker.update(image))
        except Exception as error:
            self._say(error)
            return self._box, 0.0
        if not (ok and np.isfinite((x, y, w, h)).all()):
            return self._box, 0.0
        self._box = (x, y, w, h)
        score = float(self._tracker.getTrackingScore()) if hasattr(self._tracker, "getTrackingScore") else -1.0
        return self._box, score if score >= 0 else 1.0

    def _say(self, error: Exception) -> None:
        if not self._said:
            print(f"{self.name}: answered as lost: {type(error).__name__}: {error}", file=sys.stderr)
        self._said = True
