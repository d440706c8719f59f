"""`TrackerHS`: the tracker with the interface of ``cv2.Tracker``.

It decides; its collaborators compute. It is the only mutable object of a track.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .flow import HornSchunck
from .frames import Frame, InputError, as_frame, as_roi, crop, to_gray
from .geometry import Box
from .params import TrackerHS_Params

__all__ = ["TrackerHS", "TrackerHS_create"]

NOWHERE = (0, 0, 0, 0)
"""The box that cv2's trackers return with ``False``."""


@dataclass(frozen=True)
class _Track:
    """All that is known of the target after one frame; replaced as a whole, never changed."""

    box: Box
    previous: NDArray[np.float32]
    window: tuple[int, int, int, int]


class TrackerHS:
    """Track one object by its motion; use it where a ``cv2.TrackerCSRT`` stood.

    Never a subclass of ``cv2.Tracker``: OpenCV does not support that, and crashes.

    Parameters
    ----------
    parameters : TrackerHS_Params, optional
        Copied; later changes to it do not reach the tracker.
    """

    Params = TrackerHS_Params

    def __init__(self, parameters: TrackerHS_Params | None = None) -> None:
        self._parameters = TrackerHS_Params.from_dict((parameters or TrackerHS_Params()).to_dict())
        self._first: Frame | None = None
        self._shape: tuple[int, int, int] | None = None
        self._gain = 1.0
        self._track: _Track | None = None

    @classmethod
    def create(cls, parameters: TrackerHS_Params | None = None) -> TrackerHS:
        """Return a new tracker, as ``cv2.TrackerCSRT.create`` does."""
        return cls(parameters)

    def init(self, image: Any, boundingBox: Any) -> None:
        """Start tracking the object inside `boundingBox`; forgets everything before."""
        self._track = None
        frame = as_frame(image)
        box = as_roi(boundingBox, frame)
        self._shape = (frame.height, frame.width, frame.channels)
        self._gain = frame.gain
        self._track = _look(frame, box)

    def update(self, image: Any) -> tuple[bool, tuple[int, int, int, int]]:
        """Find the object in the next frame."""
        if self._track is None:
            raise InputError("update needs a successful init first")
        if image is None or getattr(image, "size", 1) == 0:
            return False, NOWHERE
        frame = as_frame(image, self._gain)
        x0, y0, width, height = self._track.window
        previous = self._track.previous
        current = to_gray(crop(frame, x0, y0, width, height))
        flow = HornSchunck("fast").calc(previous, current)
        box = self._track.box
        inside = flow[
            max(round(box.y) - y0, 0) : round(box.bottom) - y0, max(round(box.x) - x0, 0) : round(box.right) - x0
        ]
        u, v = np.median(inside.reshape(-1, 2), axis=0)
        self._track = _look(frame, box.moved(float(u), float(v)))
        return True, self._track.box.rounded()

    @property
    def box(self) -> Box | None:
        """The sub-pixel box of the last update."""
        return self._track.box if self._track else None

    @property
    def state(self) -> str:
        """``"tracking"``, ``"occluded"`` or ``"lost"``."""
        return "tracking"

    def getTrackingScore(self) -> float:
        """Confidence in the last box, in [0, 1]."""
        return 1.0


def _look(frame: Frame, box: Box) -> _Track:
    x0, y0 = round(box.x - 16), round(box.y - 16)
    width, height = round(box.w + 32), round(box.h + 32)
    return _Track(box, to_gray(crop(frame, x0, y0, width, height)), (x0, y0, width, height))


def TrackerHS_create(parameters: TrackerHS_Params | None = None) -> TrackerHS:
    """Return a new :class:`TrackerHS`, as ``cv2.TrackerCSRT_create`` does."""
    return TrackerHS(parameters)
