"""Who is judged: a tracker of several objects is anything whose `update` answers with identities and boxes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from ..baselines.frame_differencing import GAP, aligned, smooth_gray
from ..baselines.regions import noise_threshold
from ..trackers import ANY_FACTORY, look_up
from ..worker import resolve

__all__ = ["TRACKERS", "Found", "ManyTracker", "make_tracker"]

Box = tuple[float, float, float, float]
Found = tuple[int, Box]
"""Identity of an object, and its box x, y, w, h, px."""

_CLOSE = 9  # px: parts of an object that are nearer to each other are one region
_SMALLEST = 60  # px² of a region
_GATE = 1.0  # diagonals of the box, from where it should be, within which the nearest region is the same object
_BORN = 3  # frames in a row after which a region is an object
_PATIENCE = 10  # frames without its region after which an object is gone
_SHADOW = 127  # MOG2's mark


class ManyTracker(Protocol):
    """What can be judged."""

    def update(self, image: NDArray[Any], /) -> Iterable[Found]:
        """Objects that are located in the next frame."""


class Automatic:
    """Ours: ``AutomaticTracker``, what is not located left out."""

    def __init__(self) -> None:
        from hs_tracker_cv import AutomaticTracker

        self._tracker = AutomaticTracker()

    def update(self, image: NDArray[Any]) -> list[Found]:
        """Objects that are located."""
        return [(each.identity, (*each.box,)) for each in self._tracker.update(image) if each.ok]


@dataclass
class _Life:
    """An object as the nearest box knows it."""

    identity: int
    box: NDArray[np.float64]
    velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros(2))
    seen: int = 1
    missed: int = 0

    @property
    def expected(self) -> NDArray[np.float64]:
        """Centre in the next frame, px."""
        return _centre(self.box) + self.velocity * (self.missed + 1)

    def take(self, box: NDArray[np.float64]) -> None:
        """Go on with a region."""
        step = (_centre(box) - _centre(self.box)) / (self.missed + 1)
        self.velocity = step if self.seen == 1 else 0.7 * self.velocity + 0.3 * step
        self.box, self.seen, self.missed = box, self.seen + 1, 0


class NearestBox:
    """Regions of change, each the object whose expected place is nearest: what is built in an afternoon.

    Parameters
    ----------
    changed : callable
        Mask of what moves, from the next frame.
    """

    def __init__(self, changed: Callable[[NDArray[Any]], NDArray[np.uint8]]) -> None:
        self._changed = changed
        self._lives: list[_Life] = []
        self._next = 1

    def update(self, image: NDArray[Any]) -> list[Found]:
        """Objects whose region is seen."""
        regions = _regions(self._changed(image))
        lives = self._lives
        distance = np.array([[_distance(life, box) for box in regions] for life in lives]).reshape(
            len(lives), len(regions)
        )
        pairs = zip(*linear_sum_assignment(np.minimum(distance, 2.0 * _GATE)), strict=True)
        taken = {int(k): int(j) for k, j in pairs if distance[k, j] <= _GATE}
        for k, life in enumerate(lives):
            if k in taken:
                life.take(regions[taken[k]])
            else:
                life.missed += 1
        self._lives = [life for life in lives if life.missed <= (_PATIENCE if life.seen >= _BORN else 0)]
        for j, box in enumerate(regions):
            if j not in taken.values():
                self._lives.append(_Life(self._next, box))
                self._next += 1
        shown = [life for life in self._lives if life.seen >= _BORN and not life.missed]
        return [(life.identity, (*life.box.tolist(),)) for life in shown]


def _regions(mask: NDArray[np.uint8]) -> list[NDArray[np.float64]]:
    """Boxes of what is connected in a mask."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_CLOSE, _CLOSE))
    joined = cv2.morphologyEx(cv2.medianBlur(mask, 3), cv2.MORPH_CLOSE, kernel)
    _, _, stats, _ = cv2.connectedComponentsWithStats(joined)
    return [np.asarray(row[:4], dtype=np.float64) for row in np.asarray(stats)[1:] if row[4] >= _SMALLEST]


def _centre(box: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(box[:2] + box[2:] / 2.0)


def _distance(life: _Life, box: NDArray[np.float64]) -> float:
    """How far a region is from where an object is expected, in diagonals of the object's box."""
    return float(np.hypot(*(_centre(box) - life.expected)) / np.hypot(*life.box[2:]))


class _Differences:
    """Three-frame differencing, as the baseline of one object does it."""

    def __init__(self) -> None:
        self._past: deque[NDArray[np.float32]] = deque(maxlen=2 * GAP)

    def __call__(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        gray = smooth_gray(image)
        earlier = [self._past[max(0, len(self._past) - GAP)], self._past[0]] if self._past else [gray, gray]
        differences = [np.abs(gray - aligned(old, gray)) for old in earlier]
        self._past.append(gray)
        changed: NDArray[np.bool_] = np.minimum(*differences) > noise_threshold(differences[0])
        return changed.astype(np.uint8)


class _Background:
    """OpenCV's MOG2, its shadows left out."""

    def __init__(self) -> None:
        self._model = cv2.createBackgroundSubtractorMOG2(200, 20.0, True)

    def __call__(self, image: NDArray[Any]) -> NDArray[np.uint8]:
        return (self._model.apply(cv2.GaussianBlur(image, (3, 3), 0)) > _SHADOW).astype(np.uint8)


TRACKERS: dict[str, Callable[[], ManyTracker]] = {
    "AutomaticTracker": Automatic,
    "FrameDifferencing + nearest": lambda: NearestBox(_Differences()),
    "MOG2 + nearest": lambda: NearestBox(_Background()),
}


def make_tracker(name: str) -> ManyTracker:
    """Make a tracker by its name, or by ``pkg.module:factory``.

    Raises
    ------
    ValueError
        If there is none of that name; the message lists the known ones.
    """
    factory = resolve(name) if ":" in name else look_up(TRACKERS, name, "tracker", ANY_FACTORY)
    tracker: ManyTracker = factory()
    return tracker
