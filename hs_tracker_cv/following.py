"""Follow an object through frames: one step per frame, and the table of boxes that they make."""

from __future__ import annotations

import csv
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TextIO

from .detection import FirstMover
from .display import FlowFields
from .frames import InputError
from .geometry import Box
from .params import TrackerHS_Params
from .tracker import TrackerHS

__all__ = ["COLUMNS", "Step", "steps", "write_header", "write_row"]

COLUMNS = ("frame", "x", "y", "w", "h", "ok", "score", "state")


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
    """

    index: int
    frame: Any
    box: Box | None
    state: str
    score: float
    fields: FlowFields | None
    seconds: float = 0.0


def steps(
    frames: Iterator[Any],
    roi: Box | None,
    *,
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
        The object in the first frame; None waits for the first that moves.
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
    tracker, mover = TrackerHS(parameters), FirstMover()
    for count, frame in enumerate(frames, 1):
        index = first + (count - 1) * stride
        if tracker.initialised:
            yield _updated(tracker, index, frame, show)
        else:
            region = None if roi is not None else mover.update(frame)
            box = roi if region is None else region.box
            if box is None:
                yield Step(index, frame, None, "searching", 0.0, mover.fields if show else None)
            else:
                tracker.init(frame, box)
                yield Step(index, frame, tracker.box, "tracking", tracker.getTrackingScore(), mover.fields)
        if max_frames is not None and count >= max_frames:
            return


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


def write_header(table: TextIO) -> None:
    """Write the names of the columns."""
    csv.writer(table).writerow(COLUMNS)


def write_row(table: TextIO, step: Step) -> None:
    """Write one row, at once: a run that is killed leaves every box it has found."""
    box = step.box if step.box is not None else Box(0.0, 0.0, 0.0, 0.0)
    sides = (f"{value:.2f}" for value in box)
    csv.writer(table).writerow((step.index, *sides, int(step.box is not None), f"{step.score:.3f}", step.state))
    table.flush()
