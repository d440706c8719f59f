"""`MultiTrackerHS`: several objects in one video, each with a tracker of its own."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .tracker import TrackerHS

__all__ = ["MultiTrackerHS", "MultiTrackerHS_create"]


class MultiTrackerHS:
    """Track several objects; add and remove them at any time.

    The calls of ``cv2.legacy.MultiTracker``, and `remove`, which that one lacks.
    """

    def __init__(self) -> None:
        self._trackers: dict[int, TrackerHS] = {}
        self._boxes: dict[int, tuple[int, int, int, int]] = {}
        self._next_id = 1

    @classmethod
    def create(cls) -> MultiTrackerHS:
        """Return an empty multi-tracker."""
        return cls()

    @property
    def objects(self) -> Mapping[int, TrackerHS]:
        """The trackers by the id that `add` returned."""
        return MappingProxyType(self._trackers)

    def add(self, newTracker: TrackerHS, image: Any, boundingBox: Any) -> int:
        """Start tracking one more object.

        Parameters
        ----------
        newTracker : TrackerHS
            A tracker of its own; it is initialised here.
        image, boundingBox
            As for :meth:`TrackerHS.init`.

        Returns
        -------
        int
            The id of the object, from 1 upwards: true where ``cv2.legacy.MultiTracker.add`` returns True.

        Raises
        ------
        InputError
            If image or box cannot be used; nothing is added then.
        ValueError
            If this tracker follows one of the objects already; it goes on doing so.
        """
        for identity, tracker in self._trackers.items():
            if tracker is newTracker:
                raise ValueError(f"expected a tracker of its own, got that of object {identity}")
        newTracker.init(image, boundingBox)
        identity = self._next_id
        self._trackers[identity] = newTracker
        self._next_id += 1
        return identity

    def remove(self, identity: int) -> None:
        """Stop tracking an object.

        Raises
        ------
        KeyError
            If there is no such id.
        """
        if identity not in self._trackers:
            raise KeyError(f"no object {identity!r}; there are {sorted(self._trackers)}")
        del self._trackers[identity]
        self._boxes.pop(identity, None)

    def update(self, image: Any) -> tuple[bool, NDArray[np.float64]]:
        """Find all objects in the next frame.

        Returns
        -------
        ok : bool
            True when every object was located.
        boxes : ndarray, shape (N, 4), float64
            x, y, w, h in px in the order of `objects`; a row of zeros for each object not located.

        Raises
        ------
        InputError
            If the image cannot be the next frame of every object; then none of them has moved on.
        """
        for tracker in self._trackers.values():
            tracker.check(image)
        answers = {identity: tracker.update(image) for identity, tracker in self._trackers.items()}
        self._boxes = {identity: box for identity, (_, box) in answers.items()}
        return all(ok for ok, _ in answers.values()), self.getObjects()

    def getObjects(self) -> NDArray[np.float64]:
        """Boxes of the last update, shape (N, 4), float64, as `update` returned them."""
        rows = [self._boxes.get(identity, (0, 0, 0, 0)) for identity in self._trackers]
        return np.array(rows, dtype=np.float64).reshape(-1, 4)


def MultiTrackerHS_create() -> MultiTrackerHS:
    """Return an empty :class:`MultiTrackerHS`, as ``cv2.legacy.MultiTracker_create`` does."""
    return MultiTrackerHS()
