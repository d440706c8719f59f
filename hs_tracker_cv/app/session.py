"""What one viewer does on the page, without any page: source, frame, tracks, stages.

Its methods wait for one another, so that they may be called from any thread.
"""

from __future__ import annotations

import functools
import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ParamSpec, TypeVar

import cv2

from ..detection import MotionDetector, Region
from ..frames import InputError, as_frame, as_roi
from ..geometry import Box
from ..movers import MoverFinder
from ..params import TrackerHS_Params
from ..stages import PaperMethod, StageParams, Stages
from ..video import VideoError
from .pictures import Panel, draw
from .rivals import rivals
from .sources import Sources
from .store import FrameStore
from .tracks import OURS, Track

__all__ = ["Moment", "Session"]

P = ParamSpec("P")
R = TypeVar("R")


def _alone(method: Callable[P, R]) -> Callable[P, R]:
    """Let one method of a session run at a time."""

    @functools.wraps(method)
    def waiting(*args: P.args, **kwargs: P.kwargs) -> R:
        with args[0]._lock:  # type: ignore[attr-defined]
            return method(*args, **kwargs)

    return waiting


@dataclass(frozen=True, eq=False)
class Moment:
    """Where a session was at one moment: what a viewer sees, while the session may have gone on.

    Parameters
    ----------
    store : FrameStore
        The video.
    index : int
        Number of the frame.
    frame : ndarray
    tracks : list of Track
        Those there were; they may be ahead.
    """

    store: FrameStore
    index: int
    frame: Any
    tracks: list[Track]

    @property
    def count(self) -> int:
        """Number of frames, as far as it is known; at least 1."""
        return max(self.store.count or 0, self.index + 1)


class Session:
    """One viewer's video, trackers and parameters.

    Parameters
    ----------
    sources : Sources
        What may be opened.
    models : str
        Folder of TrackerNano's models; empty for none.

    Attributes
    ----------
    index : int
        Number of the current frame; -1 without a source.
    frame : ndarray or None
        The current frame.
    tracks : list of Track
        In the order in which they were started.
    names : list of str
        Trackers that are started on a box.
    parameters : TrackerHS_Params
        Of TrackerHS.
    stage_params : StageParams
        Of the panels.
    """

    def __init__(self, sources: Sources, models: str = "") -> None:
        self.sources = sources
        self.rivals = rivals(models)
        self.index = -1
        self.frame: Any = None
        self.tracks: list[Track] = []
        self._objects: dict[int, tuple[Box, int]] = {}
        self.names = [OURS]
        self.parameters = TrackerHS_Params()
        self.stage_params = StageParams()
        self._store: FrameStore | None = None
        self._method = PaperMethod(self.stage_params)
        self._stages: tuple[int, StageParams, FrameStore, Stages] | None = None
        self._lock = threading.RLock()
        self._panel_lock = threading.Lock()
        self._closed = False

    @property
    def store(self) -> FrameStore:
        """The frames; VideoError without a source."""
        if self._store is None:
            raise VideoError("no video has been opened")
        return self._store

    @property
    def opened(self) -> bool:
        """Whether there is a source."""
        return self._store is not None

    @_alone
    def open(self, name: str) -> None:
        """Open one of the sources at its first frame; tracks are forgotten.

        Raises
        ------
        VideoError
            If it cannot be opened; what was open is closed all the same.
        """
        self._release()
        if self._closed:
            raise VideoError("the page has been closed")
        self._store = FrameStore(lambda: self.sources.open(name), offered=name)
        self.index, self.frame = 0, self._store.get(0)

    def close(self) -> None:
        """Give the video, the memory and the uploads back; nothing can be opened any more."""
        with self._panel_lock, self._lock:
            self._closed = True
            self._release()
            self._stages, self._method = None, PaperMethod()
            self.sources.close()

    def _release(self) -> None:
        if self._store is not None:
            self._store.close()
        self._store = None
        self.index, self.frame, self.tracks, self._objects = -1, None, [], {}

    @_alone
    def go_to(self, target: int, seconds: float = math.inf) -> bool:
        """Make a frame the current one; every track passes all frames up to it.

        Parameters
        ----------
        target : int
            Held within the video.
        seconds : float
            Stop on the way after so long.

        Returns
        -------
        bool
            Whether the frame, or the end of the video, has been reached.

        Raises
        ------
        VideoError
            Where the source breaks; the current frame is then the last one before.
        InputError
            If a tracker cannot use a frame; it is left behind.
        """
        end = time.monotonic() + seconds
        target = max(target, 0)
        while True:
            index = self._next_index(target)
            while self.store.approach(index):
                if time.monotonic() >= end and index not in self.store:
                    return False
            frame = self.store.get(index)
            if frame is None:
                if self.index >= 0 and index <= self.index:
                    raise VideoError(f"{self.store.name}: frame {index} cannot be read again")
                return True
            for track in self.tracks:
                if track.head == index - 1 and not track.failure:
                    track.feed(frame)
            if index > self.index or index == target:
                self.index, self.frame = index, frame
            if self.index == target and not self._waiting(target):
                return True
            if time.monotonic() >= end:
                return False

    def _next_index(self, target: int) -> int:
        """The frame to look at next on the way to `target`: the earliest that a track waits for."""
        return min([min(self.index + 1, target), *(track.head + 1 for track in self._waiting(target))])

    def _waiting(self, target: int) -> list[Track]:
        """Tracks that have not been in a frame they come to."""
        return [track for track in self.tracks if not track.failure and track.head < target]

    @_alone
    def frame_at(self, index: int, seen: Moment) -> Any:
        """Return any frame of a video that was seen, without going there; VideoError where it cannot be had."""
        self._require(seen)
        frame = self.store.get(index)
        if frame is None:
            raise VideoError(f"{self.store.name}: there is no frame {index}")
        return frame

    def shows(self, seen: Moment) -> bool:
        """Whether what was seen is of the video that is open now."""
        return seen.store is self._store

    def _require(self, seen: Moment) -> None:
        if not self.shows(seen):
            raise VideoError(f"{seen.store.name}: is no longer open")

    @_alone
    def start(self, box: Box, *, add: bool = False, seen: Moment | None = None) -> None:
        """Follow the object in a box of a frame; `go_to` catches up from there.

        Parameters
        ----------
        box : Box
            px; what lies outside the frame is cut off.
        add : bool
            Keep the objects that are followed already.
        seen : Moment, optional
            When the box was drawn; now by default.

        Raises
        ------
        InputError
            If the box is too small or outside; the tracks stay as they were.
        VideoError
            If the video that was seen is no longer open.
        """
        if seen is None:
            index, frame = self.index, self.frame
        else:
            self._require(seen)
            index, frame = seen.index, seen.frame
        as_roi(box, as_frame(frame))
        kept, objects = (self.tracks, self._objects) if add else ([], {})
        number = max(objects, default=0) + 1
        fresh = [self._track(name, number, box, index) for name in self.names]
        self._first_steps(fresh, frame)
        self.tracks, self._objects = [*kept, *fresh], {**objects, number: (box, index)}

    def _track(self, name: str, number: int, box: Box, start: int) -> Track:
        try:
            return Track(name, number, box, start, self.parameters, self.rivals.get(name))
        except cv2.error as error:  # a model that cannot be loaded
            raise InputError(f"{name} cannot be made: {' '.join(str(error).split())}") from error

    def _first_steps(self, tracks: list[Track], frame: Any) -> None:
        for track in tracks:
            try:
                track.feed(frame)
            except InputError:
                raise
            except cv2.error as error:
                raise InputError(f"{track.name} cannot start on this box: {track.failure}") from error

    @_alone
    def choose(self, names: list[str]) -> None:
        """Change the trackers; those that are new start where each object was boxed, and `go_to` catches up.

        Raises
        ------
        VideoError, InputError
            If that frame cannot be had or used any more; nothing changes.
        """
        known = [OURS, *self.rivals]
        names = [name for name in known if name in names]
        kept = [track for track in self.tracks if track.name in names]
        present = {(track.number, track.name) for track in kept}
        fresh = [
            self._track(name, number, box, start)
            for number, (box, start) in self._objects.items()
            for name in names
            if (number, name) not in present
        ]
        self._restart(fresh)
        self.names = names
        self.tracks = sorted([*kept, *fresh], key=lambda track: (track.number, known.index(track.name)))

    @_alone
    def set_parameters(self, parameters: TrackerHS_Params) -> None:
        """Change the parameters of TrackerHS; its tracks start anew, and `go_to` catches up.

        Raises
        ------
        VideoError, InputError
            If the first frame of a track cannot be had or used any more; nothing changes.
        """
        if parameters == self.parameters:
            return
        before, self.parameters = self.parameters, parameters
        anew = {id(track): self._track(OURS, track.number, track.roi, track.start) for track in self._ours()}
        try:
            self._restart(list(anew.values()))
        except (VideoError, InputError):
            self.parameters = before
            raise
        self.tracks = [anew.get(id(track), track) for track in self.tracks]

    def _restart(self, tracks: list[Track]) -> None:
        for start in sorted({track.start for track in tracks}):
            self._first_steps([track for track in tracks if track.start == start], self.store.get(start))

    def _ours(self) -> list[Track]:
        return [track for track in self.tracks if track.name == OURS]

    @_alone
    def forget(self) -> int:
        """Take all objects away, and return where the first was boxed; the current frame if there was none."""
        start = min((start for _, start in self._objects.values()), default=self.index)
        self.tracks, self._objects = [], {}
        return start

    @_alone
    def follow_first_mover(self, finder: MoverFinder, seconds: float = math.inf) -> bool:
        """Go on until an object moves, and follow that; what was followed is forgotten.

        Parameters
        ----------
        finder : MoverFinder
            A fresh one, and the same again when the time has passed.
        seconds : float
            Stop on the way after so long.

        Returns
        -------
        bool
            False where the video has ended, or the time has passed, without one.

        Raises
        ------
        VideoError, InputError
            As `go_to`.
        """
        end = time.monotonic() + seconds
        self.tracks, self._objects = [], {}
        while True:
            mover = next((mover for mover in finder.update(self.frame) if mover.whole), None)
            if mover is not None:
                self.start(mover.box)
                return True
            before = self.index
            self.go_to(before + 1)
            if self.index == before or time.monotonic() >= end:
                return False

    @_alone
    def current(self) -> Moment | None:
        """Where it is now; None without a source."""
        return Moment(self._store, self.index, self.frame, self.tracks) if self._store is not None else None

    def regions(self, seen: Moment) -> list[Region]:
        """What moves between the frame before and the one seen, the largest first; raises as `frame_at`."""
        before = self._before(seen)
        return MotionDetector().detect(before, seen.frame) if before is not None else []

    def panels(self, seen: Moment, names: list[str], width: int) -> list[Panel]:
        """Draw panels of a frame that was seen; in the first frame there is nothing to draw.

        Meanwhile the session can go on to other frames.

        Parameters
        ----------
        seen : Moment
        names : list of str
            Of display.PANELS, or LAYERS.
        width : int
            Of a picture, px.

        Raises
        ------
        VideoError
            As `frame_at`.
        """
        with self._panel_lock:
            before, params = self._before(seen), self.stage_params
            if before is None:
                return []
            stages = self._stages_of(seen, before, params)
            silhouettes = (track.silhouette(seen.index) for track in seen.tracks if track.name == OURS)
            silhouette = next((found for found in silhouettes if found is not None), None)
            return [draw(name, stages, seen.frame, silhouette, width) for name in names]

    def _stages_of(self, seen: Moment, before: Any, params: StageParams) -> Stages:
        if self._method.params != params:
            self._method = PaperMethod(params)
        if self._stages is None or self._stages[:3] != (seen.index, params, seen.store):
            self._stages = (seen.index, params, seen.store, self._method.calc(before, seen.frame))
        return self._stages[3]

    def _before(self, seen: Moment) -> Any:
        return self.frame_at(seen.index - 1, seen) if seen.index > 0 else None
