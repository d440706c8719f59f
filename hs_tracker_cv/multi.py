"""`MultiTrackerHS`: several objects in one video, each with a tracker of its own."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from .frames import InputError, VideoFormat, as_frame, downloaded, is_dropped, next_frame
from .validation import shown, validate

__all__ = ["MultiTrackerHS", "MultiTrackerHS_create", "ObjectTracker"]

Row = tuple[float, float, float, float]
NOWHERE: Row = (0.0, 0.0, 0.0, 0.0)


class ObjectTracker(Protocol):
    """What can follow an object: TrackerHS of either flavour, any of ``cv2``, or one of the user's."""

    def init(self, image: Any, boundingBox: Any, /) -> bool | None:
        """Start; False is a refusal."""

    def update(self, image: Any, /) -> tuple[bool, Any]:
        """Whether the object is located, and its box (x, y, w, h)."""


class _Followed(NamedTuple):
    """An object: who follows it, and in what video."""

    tracker: Any
    video: VideoFormat

    def check(self, image: Any) -> None:
        """Raise InputError for an image that cannot be the tracker's next frame."""
        check = getattr(self.tracker, "check", None)
        if callable(check):
            check(image)
        else:
            next_frame(image, self.video)

    def update(self, image: Any) -> Row:
        """Row of `getObjects` after a frame."""
        answer = self.tracker.update(image)
        try:
            ok, box = answer
            x, y, w, h = (float(value) for value in box) if ok else NOWHERE
        except (TypeError, ValueError):
            raise TypeError(
                f"expected (ok, (x, y, w, h)) from {type(self.tracker).__name__}.update, got {shown(answer)}"
            ) from None
        return x, y, w, h


class MultiTrackerHS:
    """Track several objects; add and remove them at any time.

    The calls of ``cv2.legacy.MultiTracker``, and `remove`, which that one lacks.
    """

    def __init__(self) -> None:
        self._followed: dict[int, _Followed] = {}
        self._rows: dict[int, Row] = {}
        self._next_id = 1

    def __getstate__(self) -> dict[str, Any]:
        """State for pickle and copy."""
        return dict(self.__dict__)

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over what :meth:`__getstate__` gave. Anybody may have edited it: then this is a ValueError."""
        validate(state, dict[str, Any], "state")
        for name, kind in (("_followed", dict[int, _Followed]), ("_rows", dict[int, Row]), ("_next_id", int)):
            validate(state.get(name), kind, name)
        for followed in state["_followed"].values():
            _expect_tracker(followed.tracker)
        self.__dict__.update(state)

    @classmethod
    def create(cls) -> MultiTrackerHS:
        """Return an empty multi-tracker."""
        return cls()

    @property
    def objects(self) -> Mapping[int, Any]:
        """The trackers by the id that `add` returned."""
        return MappingProxyType({identity: followed.tracker for identity, followed in self._followed.items()})

    def add(self, newTracker: ObjectTracker, image: Any, boundingBox: Any) -> int:
        """Start tracking one more object.

        Parameters
        ----------
        newTracker : object with `init` and `update`
            A tracker of its own, which is initialised here: TrackerHS, its legacy flavour, a ``cv2.TrackerCSRT``
            or any other.
        image, boundingBox
            As for :meth:`TrackerHS.init`; a tracker of another make may take less.

        Returns
        -------
        int
            The id of the object, from 1 upwards: true where ``cv2.legacy.MultiTracker.add`` returns True.

        Raises
        ------
        TypeError
            If this is no tracker.
        InputError
            If image or box cannot be used, or the tracker refuses them with False; nothing is added then.
        ValueError
            If this tracker follows one of the objects already; it goes on doing so.
        """
        _expect_tracker(newTracker)
        for identity, followed in self._followed.items():
            if followed.tracker is newTracker:
                raise ValueError(f"expected a tracker of its own, got that of object {identity}")
        video = as_frame(image).format
        if newTracker.init(image, boundingBox) is False:
            raise InputError(
                f"expected a boundingBox that {type(newTracker).__name__} can start from, got {shown(boundingBox)}"
            )
        identity = self._next_id
        self._followed[identity] = _Followed(newTracker, video)
        self._next_id += 1
        return identity

    def remove(self, identity: int) -> None:
        """Stop tracking an object.

        Raises
        ------
        KeyError
            If there is no such id.
        """
        if identity not in self._followed:
            raise KeyError(f"no object {identity!r}; there are {sorted(self._followed)}")
        del self._followed[identity]
        self._rows.pop(identity, None)

    def update(self, image: Any) -> tuple[bool, NDArray[np.float64]]:
        """Find all objects in the next frame.

        Parameters
        ----------
        image : ndarray or cv2.UMat
            None or an empty image (a dropped frame) is answered with False and zeros, and moves no object.

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
        Exception
            What a tracker of another make has raised; its object counts as not located, all others have moved on,
            and `getObjects` has their boxes.
        """
        dropped = is_dropped(downloaded(image))
        rows, failures = dict.fromkeys(self._followed, NOWHERE), []
        if not dropped:
            for followed in self._followed.values():
                followed.check(image)
            for identity, followed in self._followed.items():
                try:
                    rows[identity] = followed.update(image)
                except Exception as failure:
                    failures.append(failure)
        self._rows = rows
        if failures:
            raise failures[0]
        return all(row != NOWHERE for row in rows.values()), self.getObjects()

    def getObjects(self) -> NDArray[np.float64]:
        """Boxes of the last update, shape (N, 4), float64, as `update` returned them."""
        rows = [self._rows.get(identity, NOWHERE) for identity in self._followed]
        return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _expect_tracker(thing: Any) -> None:
    if isinstance(thing, type) or not all(callable(getattr(thing, name, None)) for name in ("init", "update")):
        raise TypeError(f"expected a tracker with the methods init and update, got {shown(thing)}")


def MultiTrackerHS_create() -> MultiTrackerHS:
    """Return an empty :class:`MultiTrackerHS`, as ``cv2.legacy.MultiTracker_create`` does."""
    return MultiTrackerHS()
