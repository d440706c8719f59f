"""Follow an object, or all that move, through frames: one step per frame, and the table of boxes that they make."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, TextIO

from .automatic import AutomaticTracker, Followed
from .display import FlowFields
from .frames import InputError
from .geometry import Box
from .params import TrackerHS_Params
from .tracker import TrackerHS

__all__ = ["COLUMNS", "Step", "steps", "write_header", "write_mot", "write_row"]

COLUMNS = ("frame", "x", "y", "w", "h", "ok", "score", "state")
COLUMNS_OF_ALL = ("frame", "id", *COLUMNS[1:])


@dataclass(frozen=True)
class Step:
    """One frame and what is known after it.

    Parameters
    ----------
    index : int
        From 0.
    frame : ndarray
    box : Box or None
        None while there is no object, or it is lost.
    state : str
        "searching" before the first object, then the tracker's state.
    score : float
        0 to 1.
    fields : FlowFields or None
        What there is to show in the panels.
    seconds : float
        Time of the tracker's update; 0 for other frames.
    objects : tuple of Followed
        Every object, where all that move are followed; box, state and score are then those of the first located one.
    """

    index: int
    frame: Any
    box: Box | None
    state: str
    score: float
    fields: FlowFields | None
    seconds: float = 0.0
    objects: tuple[Followed, ...] = ()


def steps(
    frames: Iterator[Any],
    roi: Box | None,
    *,
    every: bool = False,
    show: bool = False,
    max_frames: int | None = None,
    first: int = 0,
    stride: int = 1,
    parameters: TrackerHS_Params | None = None,
) -> Iterator[Step]:
    """Follow an object through frames.

    Parameters
    ----------
    frames : iterator of ndarray
    roi : Box or None
        The object in the first frame; None waits for what moves, and for the next when that has left.
    every : bool
        Without a roi: follow everything that moves, not one object at a time.
    show : bool
        Also give what the panels need, which costs a little.
    max_frames : int, optional
        Stop after so many.
    first, stride : int
        Index of the first frame, and by how much it grows from frame to frame.
    parameters : TrackerHS_Params, optional
        Of the tracker.

    Yields
    ------
    Step
        One per frame.

    Raises
    ------
    VideoError
        Where the source breaks.
    InputError
        If a frame or the ROI cannot be used.
    """
    take = _given(roi, parameters, show) if roi is not None else _moving(parameters, every, show)
    for count, frame in enumerate(frames, 1):
        yield take(first + (count - 1) * stride, frame)
        if max_frames is not None and count >= max_frames:
            return


def _given(roi: Box, parameters: TrackerHS_Params | None, show: bool) -> Callable[[int, Any], Step]:
    """Steps of the object in a box of the first frame."""
    tracker = TrackerHS(parameters)

    def take(index: int, frame: Any) -> Step:
        if tracker.initialised:
            return _updated(tracker, index, frame, show)
        tracker.init(frame, roi)
        return Step(index, frame, tracker.box, "tracking", tracker.getTrackingScore(), None)

    return take


def _moving(parameters: TrackerHS_Params | None, every: bool, show: bool) -> Callable[[int, Any], Step]:
    """Steps of what moves."""
    automatic = AutomaticTracker(parameters, most=None if every else 1)

    def take(index: int, frame: Any) -> Step:
        started = time.perf_counter()
        objects = automatic.update(frame)
        seconds = time.perf_counter() - started
        fields: FlowFields | None = automatic.fields if show else None
        if not objects:
            return Step(index, frame, None, "searching", 0.0, fields)
        leading = next((followed for followed in objects if followed.ok), objects[0])
        if show:
            fields = _fields(automatic.tracker(leading.identity)) or fields
        box = leading.box if leading.ok else None
        shown = tuple(objects) if every else ()
        return Step(index, frame, box, leading.state, leading.score, fields, seconds, shown)

    return take


def _updated(tracker: TrackerHS, index: int, frame: Any, show: bool) -> Step:
    started = time.perf_counter()
    ok, _ = tracker.update(frame)
    seconds = time.perf_counter() - started
    box = tracker.box if ok else None
    fields = _fields(tracker) if show else None
    return Step(index, frame, box, tracker.state, tracker.getTrackingScore(), fields, seconds)


def _fields(tracker: TrackerHS) -> FlowFields | None:
    """What the tracker has to show; nothing as long as the video repeats its first frame."""
    try:
        return tracker.debug()
    except InputError:
        return None


def write_header(table: TextIO, *, every: bool = False) -> None:
    """Write the names of the columns; `every` for the table of all that move, which has an `id`."""
    csv.writer(table).writerow(COLUMNS_OF_ALL if every else COLUMNS)


def write_row(table: TextIO, step: Step, *, every: bool = False) -> None:
    """Write one row, or one per object, at once: a run that is killed leaves every box it has found."""
    if every:
        for each in step.objects:
            _write(table, (step.index, each.identity), each.box if each.ok else None, each.score, each.state)
    else:
        _write(table, (step.index,), step.box, step.score, step.state)
    table.flush()


def write_mot(table: TextIO, step: Step) -> None:
    """Write the located objects of one frame as MOTChallenge has them, which counts frames and pixels from 1."""
    for each in step.objects:
        if each.ok:
            x, y, w, h = each.box
            sides = (f"{value:.2f}" for value in (x + 1.0, y + 1.0, w, h))
            csv.writer(table).writerow((step.index + 1, each.identity, *sides, f"{each.score:.3f}", -1, -1, -1))
    table.flush()


def _write(table: TextIO, key: tuple[int, ...], found: Box | None, score: float, state: str) -> None:
    box = found if found is not None else Box(0.0, 0.0, 0.0, 0.0)
    sides = (f"{value:.2f}" for value in box)
    csv.writer(table).writerow((*key, *sides, int(found is not None), f"{score:.3f}", state))
