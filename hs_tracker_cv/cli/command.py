"""Follow an object, or all that move, through a source and write what is asked for."""

from __future__ import annotations

import contextlib
import os
import sys
import time
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..following import Step, steps
from ..frames import InputError, as_frame, as_roi
from ..geometry import Box
from ..video import VideoError, VideoSource, open_source
from .interrupts import Pending, deferred_interrupts
from .options import PROGRAM, Options, UsageError, check, parsed_roi
from .outputs import Outputs

if TYPE_CHECKING:
    from rich.progress import Progress

__all__ = ["FAILURE", "complain", "end_of_pipe", "follow"]

FAILURE = 1

WAITING = "waiting for something that moves"

_FIRST_LINE = 10.0  # s

_MOSTLY = 0.5
"""Share of a box inside the frame below which it is probably no x,y,w,h."""


@dataclass
class _Tally:
    """Counts for the line at the end."""

    searching: int = 0
    followed: int = 0
    lost: int = 0
    objects: set[int] = field(default_factory=set)
    seconds: list[float] = field(default_factory=list)

    def add(self, step: Step) -> None:
        self.searching += step.state == "searching"
        self.followed += step.box is not None
        self.lost += step.box is None and step.state != "searching"
        self.objects.update(each.identity for each in step.objects)
        if step.seconds:
            self.seconds.append(step.seconds)


def follow(options: Options) -> int:
    """Carry out a command and return its exit code.

    Raises
    ------
    UsageError
        If it cannot be meant.
    VideoError or InputError
        If the source or an output cannot be used.
    """
    check(options)
    roi = parsed_roi(options.roi) if options.roi is not None else None
    with open_source(options.video, start=options.start, step=options.step, gain=options.gain) as source:
        outputs = Outputs(source, options)
        if options.select:
            roi = _selected(source)
        if roi is not None:
            _check_roi(roi, source)
        return _follow(source, roi, outputs, options)


def complain(error: object, code: int) -> int:
    """Say an error in one line and return the exit code."""
    print(f"{PROGRAM}: {' '.join(str(error).split())}", file=sys.stderr)
    return code


def end_of_pipe() -> int:
    """Whoever read our standard output has ended: so do we, as if by the signal. Returns the exit code."""
    with contextlib.suppress(OSError, ValueError):
        # Python flushes what is left when it ends.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 128 + 13


def _check_roi(roi: Box, source: VideoSource) -> None:
    try:
        inside = as_roi(roi, as_frame(source.first))
    except InputError as error:
        raise UsageError(str(error)) from error
    if inside.w * inside.h < _MOSTLY * roi.w * roi.h:
        width, height = source.size
        x, y, w, h = (f"{side:g}" for side in roi)
        complain(
            f"warning: --roi {x},{y},{w},{h} lies mostly outside the {width} × {height} frame; "
            "its last two numbers are width and height, not the other corner",
            0,
        )


def _selected(source: VideoSource) -> Box:
    from ..app import select_roi

    roi = select_roi(source.first)
    if roi is None:
        raise UsageError("no box was selected")
    return roi


def _follow(source: VideoSource, roi: Box | None, outputs: Outputs, options: Options) -> int:
    """Write every step as it comes; on an error or an interrupt what was written stays and is finished."""
    tally, code = _Tally(), 0
    try:
        with deferred_interrupts() as pending, outputs:
            _take_steps(source, roi, outputs, options, tally, pending)
        code = pending.code or 0
    except (VideoError, InputError) as error:
        code = complain(error, FAILURE)
    except BrokenPipeError:
        code = end_of_pipe()
    for remark in source.remarks:
        complain(f"warning: {remark}", 0)
    _summarise(source.name, tally, outputs, code, options)
    return code


def _take_steps(
    source: VideoSource, roi: Box | None, outputs: Outputs, options: Options, tally: _Tally, pending: Pending
) -> None:
    show = options.panels and options.stages is None
    followed = steps(
        source.frames,
        roi,
        every=options.all,
        show=show,
        max_frames=options.max_frames,
        first=source.start,
        stride=source.step,
    )
    total = _total(source, options)
    with _progress() as progress:
        task = progress.add_task(source.name, total=total)
        lines = _Lines(source.name, total) if progress.disable else None
        for done, step in enumerate(followed, 1):
            outputs.write(step)
            tally.add(step)
            if lines is not None:
                lines.tell(done)
            doing = WAITING if step.state == "searching" else step.state
            progress.update(task, advance=1, description=f"{source.name}  {doing}")
            if pending.code is not None:
                return


class _Lines:
    """Progress where nobody sees a bar, as in a log: a line after ten seconds, after twenty, forty and so on."""

    def __init__(self, name: str, total: int | None) -> None:
        self._name, self._of = name, "" if total is None else f" of {total}"
        self._begin, self._next = time.monotonic(), _FIRST_LINE

    def tell(self, done: int) -> None:
        passed = time.monotonic() - self._begin
        if passed >= self._next:
            self._next *= 2.0
            complain(f"{self._name}: {done}{self._of} frames after {passed:.0f} s", 0)


def _total(source: VideoSource, options: Options) -> int | None:
    if source.count is None or options.max_frames is None:
        return source.count if source.count is not None else options.max_frames
    return min(source.count, options.max_frames)


def _progress() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        # Into a log file it would write an empty line.
        disable=not console.is_terminal,
    )


def _counted(count: int, noun: str) -> str:
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def _summarise(name: str, tally: _Tally, outputs: Outputs, code: int, options: Options) -> None:
    frames = tally.searching + tally.followed + tally.lost
    parts = [_counted(frames, "frame"), f"object in {tally.followed}"]
    if options.all:
        parts.append(_counted(len(tally.objects), "object"))
    if tally.searching:
        parts.append(f"none yet in {tally.searching}")
    if tally.lost:
        parts.append(f"lost in {tally.lost}")
    if tally.seconds:
        parts.append(f"{1e3 * float(np.median(tally.seconds)):.1f} ms per update")
    ending = " (interrupted)" if code > 128 else ""
    files = ", ".join(str(path) for path in outputs.written)
    words = f"{name}: {', '.join(parts)}{ending}; wrote {files or 'nothing'}"
    if options.json:
        complain(words, 0)
    else:
        print(words, flush=True)
