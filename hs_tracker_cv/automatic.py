"""`AutomaticTracker`: follows what moves, without a rectangle; starts, starts anew and ends by itself."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

from .detection import DetectionFields, DetectorParams
from .frames import downloaded, is_dropped
from .geometry import Box, iou
from .movers import Mover, MoverFinder
from .multi import MultiTrackerHS
from .params import TrackerHS_Params
from .scalars import as_count
from .tracker import TrackerHS, TrackerState

__all__ = ["AutomaticTracker", "Followed"]

LARGER = 1.5
"""Area over that of the followed box from which what moves there is the thing of which a part was seized."""
HOLDS = 0.6
"""Share of the followed box that it must hold."""
TOGETHER = (0.4, 0.5)
"""Difference of the paces of a part and the whole, as a share of the pace, and px per frame beside."""
COURSE = 6
"""Frames over which the pace of a followed box is taken."""
TWICE = (0.7, 10)
"""IoU of two followed boxes, and frames in a row with it, from which they are one object."""
INSIST = 3
"""Frames in a row in which that must be seen."""
SAME = 0.25
"""Share of the smaller box in common from which a mover is what is followed already."""
EDGE = 2.0
"""Distance from the border, px, at which a lost object was last seen when it has left."""
LEFT = 5
"""Frames after which an object lost at the border has left for good."""
GONE = 90
"""The same for one that was lost inside the frame: behind something, it may come back."""
SLIVER = 0.2
"""Share of its largest area that a box at the border keeps of an object that has left."""
RETURN = 1.5
"""Distance from where it was lost, in diagonals of its box, at which a mover of its size is the lost object."""
SIZED = 0.5
"""IoU, of the boxes laid on each other, from which a mover is of its size."""


@dataclass(frozen=True)
class Followed:
    """An object after one frame.

    Parameters
    ----------
    identity : int
        From 1 upwards; never given twice.
    box : Box
        Where it is, px; where it was last, while it is lost.
    ok : bool
        Whether it is located in this frame.
    state : str
        As :attr:`TrackerHS.state`.
    score : float
        As :meth:`TrackerHS.getTrackingScore`.
    """

    identity: int
    box: Box
    ok: bool
    state: TrackerState
    score: float


@dataclass
class _Life:
    """What is remembered of a followed object beside its tracker."""

    largest: float
    centres: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=COURSE))
    lost: int = 0
    larger: int = 0
    twice: int = 0

    def pace(self) -> tuple[float, float] | None:
        """Mean motion of its box, px per frame; None while it is young."""
        if len(self.centres) < COURSE:
            return None
        (x0, y0), (x1, y1) = self.centres[0], self.centres[-1]
        return (x1 - x0) / (COURSE - 1), (y1 - y0) / (COURSE - 1)


class AutomaticTracker:
    """Follow whatever moves: no rectangle is needed.

    An object is taken when it has been displaced over several frames and all of it is in the picture; one of which
    only a part was seized is started anew. Changes of light, a camera's motion and what changes in its place (a lamp,
    a clock, a screen) are no objects.

    Parameters
    ----------
    parameters : TrackerHS_Params, optional
        Of each object's tracker.
    most : int, optional
        Most objects at a time; any number by default. With 1, the next object is taken when the first has left.
    detector : DetectorParams, optional

    Examples
    --------
    >>> import numpy as np
    >>> from hs_tracker_cv import AutomaticTracker
    >>> tracker = AutomaticTracker()
    >>> tracker.update(np.zeros((120, 160, 3), np.uint8))
    []
    """

    def __init__(
        self,
        parameters: TrackerHS_Params | None = None,
        *,
        most: int | None = None,
        detector: DetectorParams | None = None,
    ) -> None:
        self._parameters = parameters
        self._most = None if most is None else as_count("most", most)
        self._finder = MoverFinder(detector)
        self._multi = MultiTrackerHS()
        self._lives: dict[int, _Life] = {}

    @property
    def fields(self) -> DetectionFields | None:
        """What the detector has seen in the last pair of frames; None before there is one."""
        return self._finder.fields

    def tracker(self, identity: int) -> TrackerHS:
        """The tracker of an object.

        Raises
        ------
        KeyError
            If there is no such object.
        """
        return self._multi.objects[identity]  # type: ignore[no-any-return]

    def update(self, image: Any) -> list[Followed]:
        """Take in the next frame.

        Parameters
        ----------
        image : ndarray or cv2.UMat
            As :meth:`TrackerHS.update` takes it; all of one size. A dropped frame (None) moves nothing.

        Returns
        -------
        list of Followed
            In the order of their identities; those that have left are in it no longer.

        Raises
        ------
        InputError
            If the image cannot be the next frame; then nothing has moved on.
        """
        image = downloaded(image)
        if is_dropped(image):
            return [self._followed(identity, ok=False) for identity in self._lives]
        self._finder.check(image)
        self._multi.update(image)
        movers = self._finder.update(image)
        height, width = image.shape[:2]
        for identity in list(self._lives):
            if identity in self._lives:
                self._keep(identity, movers, image)
        for identity in list(self._lives):
            if self._has_left(identity, width, height) or self._is_followed_twice(identity):
                self._end(identity)
        for mover in movers:
            if mover.whole and self._is_new(mover) and (self._most is None or len(self._lives) < self._most):
                identity = self._multi.add(TrackerHS(self._parameters), image, mover.box)
                self._lives[identity] = _Life(mover.box.area)
        return [self._followed(identity) for identity in self._lives]

    def _box(self, identity: int) -> Box:
        box = self.tracker(identity).box
        assert box is not None, "a tracker is initialised when it is added"
        return box

    def _followed(self, identity: int, *, ok: bool = True) -> Followed:
        tracker = self.tracker(identity)
        state = tracker.state
        return Followed(
            identity,
            self._box(identity),
            ok and state == "tracking",
            state,
            tracker.getTrackingScore() if ok else 0.0,
        )

    def _keep(self, identity: int, movers: list[Mover], image: Any) -> None:
        """See to an object after its tracker's update: it may be found again, or turn out to be a part only."""
        life, tracker, box = self._lives[identity], self.tracker(identity), self._box(identity)
        if tracker.state == "tracking":
            life.lost = 0
            life.centres.append(box.centre)
            whole = [mover for mover in movers if mover.whole and _holds(mover, box, life.pace())]
            life.larger = life.larger + 1 if whole else 0
            if life.larger >= INSIST:
                for other in list(self._lives):  # what else was taken of it
                    if other != identity and _holds(whole[0], self._box(other), None):
                        self._end(other)
                self._restart(identity, whole[0], image)
            life.largest = max(life.largest, box.area)
            return
        life.lost += 1
        life.larger = 0
        life.centres.clear()
        for mover in movers:
            if mover.whole and _may_be(mover.box, box) and self._is_new(mover, but=identity):
                self._restart(identity, mover, image)
                return

    def _end(self, identity: int) -> None:
        self._multi.remove(identity)
        del self._lives[identity]

    def _restart(self, identity: int, mover: Mover, image: Any) -> None:
        self.tracker(identity).init(image, mover.box)
        self._lives[identity] = _Life(mover.box.area)

    def _has_left(self, identity: int, width: int, height: int) -> bool:
        life, box = self._lives[identity], self._box(identity)
        inside = box.clip(width, height)
        at_border = min(box.x, box.y, width - box.right, height - box.bottom) < EDGE
        if life.lost == 0:
            return at_border and inside.area < SLIVER * life.largest
        return life.lost >= (LEFT if at_border else GONE)

    def _is_followed_twice(self, identity: int) -> bool:
        """Whether an older object has been in the same place for a while."""
        life, box = self._lives[identity], self._box(identity)
        same = any(iou(self._box(other), box) > TWICE[0] for other in self._lives if other < identity)
        life.twice = life.twice + 1 if same else 0
        return life.twice >= TWICE[1]

    def _is_new(self, mover: Mover, but: int | None = None) -> bool:
        """Whether a mover is none of the objects followed; `but` leaves one of them out."""
        for identity in self._lives:
            box = self._box(identity)
            if identity != but and mover.box.intersection(box).area > SAME * min(mover.box.area, box.area):
                return False
        return True


def _holds(whole: Mover, part: Box, pace: tuple[float, float] | None) -> bool:
    """Whether a followed box is a part of a larger mover, and moves with it where its pace is known."""
    if whole.box.area < LARGER * part.area or whole.box.intersection(part).area < HOLDS * part.area:
        return False
    share, beside = TOGETHER
    return pace is None or math.dist(whole.pace, pace) < share * math.hypot(*whole.pace) + beside


def _may_be(box: Box, lost: Box) -> bool:
    """Whether a mover is of the size of a lost object and near to where that was last."""
    (x0, y0), (x1, y1) = box.centre, lost.centre
    near = (x1 - x0) ** 2 + (y1 - y0) ** 2 < RETURN**2 * (lost.w**2 + lost.h**2)
    alike = iou(Box(0, 0, box.w, box.h), Box(0, 0, lost.w, lost.h)) > SIZED
    return near and alike
