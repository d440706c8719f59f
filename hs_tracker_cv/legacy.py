"""The ``cv2.legacy`` flavour of the tracker: `init` answers with a bool, boxes are floats."""

from __future__ import annotations

from typing import Any

from .frames import InputError
from .params import TrackerHS_Params
from .tracker import TrackerHS
from .validation import validate

__all__ = ["LegacyTrackerHS", "TrackerHS_create"]


class LegacyTrackerHS:
    """`TrackerHS` with the interface of ``cv2.legacy`` trackers.

    Parameters
    ----------
    parameters : TrackerHS_Params, optional
    """

    Params = TrackerHS_Params

    def __init__(self, parameters: TrackerHS_Params | None = None) -> None:
        self.tracker = TrackerHS(parameters)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over the state of a pickle. Anybody may have edited it: then this is a ValueError."""
        validate(state, dict[str, Any], "state")
        validate(state.get("tracker"), TrackerHS, "tracker")
        self.__dict__.update(state)

    @classmethod
    def create(cls, parameters: TrackerHS_Params | None = None) -> LegacyTrackerHS:
        """Return a new tracker."""
        return cls(parameters)

    def init(self, image: Any, boundingBox: Any) -> bool:
        """Start tracking; False, instead of an exception, where image or box cannot be used.

        See Also
        --------
        TrackerHS.init
        """
        try:
            self.tracker.init(image, boundingBox)
        except InputError:
            return False
        return True

    def update(self, image: Any) -> tuple[bool, tuple[float, float, float, float]]:
        """Find the object in the next frame.

        Returns
        -------
        ok : bool
            False too before a successful `init`, as in ``cv2.legacy``.
        box : tuple of 4 float
            Sub-pixel x, y, w, h in px; zeros where `ok` is False.
        """
        if not self.tracker.initialised:
            return False, (0.0, 0.0, 0.0, 0.0)
        ok, _ = self.tracker.update(image)
        box = self.tracker.box
        if not ok or box is None:
            return False, (0.0, 0.0, 0.0, 0.0)
        return True, (box.x, box.y, box.w, box.h)

    def check(self, image: Any) -> None:
        """Raise what `update` would raise for an image; nothing changes.

        Raises
        ------
        InputError
            If the image cannot be the next frame of the video.
        """
        if self.tracker.initialised:
            self.tracker.check(image)

    def getTrackingScore(self) -> float:
        """Confidence in the last box, in [0, 1]."""
        return self.tracker.getTrackingScore()


def TrackerHS_create(parameters: TrackerHS_Params | None = None) -> LegacyTrackerHS:
    """Return a new :class:`LegacyTrackerHS`, as ``cv2.legacy.TrackerMOSSE_create`` does."""
    return LegacyTrackerHS(parameters)
