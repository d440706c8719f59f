"""How a tracker is led through a sequence: one pass, other starts, restarts after a failure, frames that do not wait.

A protocol is a function that leads a :class:`Walk` through the frames. It decides with the truth in hand where a
tracker starts, which frames it is given and what stands for those that it is not.

* *one-pass*: from the first frame to the last.
* *sre* and *tre*: one pass from other places and other times, as OTB's spatial and temporal robustness: twelve boxes
  (moved by a tenth of the size in eight directions; 0.8, 0.9, 1.1 and 1.2 times the size), and up to twenty frames at
  even distances with at least twenty frames to go.
* *restarts*: as VOT's supervised experiment. An answer that does not touch the object is a failure; five frames later
  a new tracker starts from the truth, as soon as at least half of the object can be seen.
* *realtime*: frames come 20 times a second, or as often as ``realtime:FPS`` says, and do not wait, as in VOT. While a
  tracker is busy, frames pass by and its last answer stands; being late is forgiven three times, since what is new
  has to be loaded. Its speed is the processor time of its process as the kernel counts it.
* *long-term*: one pass, judged as VOT's long-term challenge: is the object there, and how sure is the tracker?

Where the truth is masks or rotated boxes (``Sequence.by_region``), VOT's three (*restarts*, *realtime*, *long-term*)
judge these, and OTB's two boxes.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any
from typing import Protocol as Interface

import numpy as np
from numpy.typing import NDArray

from .metrics import MIN_VISIBILITY, iou_per_frame
from .regions import answered_region, read_region, region_iou
from .sequences import Sequence
from .track import whole_box
from .trackers import look_up

__all__ = [
    "BURN_IN",
    "ONE_PASS",
    "PROTOCOLS",
    "Box",
    "Protocol",
    "Step",
    "Walk",
    "find_protocol",
    "misplaced",
    "start_box",
]

Box = tuple[int, int, int, int]

PERTURBATION = 0.1
"""Largest change of a perturbed start box, in box sizes: position and size alike."""

BURN_IN = 10
"""Frames from a restart on that accuracy leaves out, as VOT does: they are easy."""

_SKIPPED = 5  # frames from a failure to the restart
_SEEN_ENOUGH = 0.5  # visible fraction for a restart
_SHIFT, _SCALES = 0.1, (0.8, 0.9, 1.1, 1.2)
_SEGMENTS, _LEAST_FRAMES = 20, 20
_FPS = 20.0
_GRACE = 3


@dataclass(frozen=True)
class Step:
    """What came of one frame.

    Parameters
    ----------
    ok : bool
    box : sequence of float
        x, y, w, h, px.
    seconds : float
        What it took.
    region : str, optional
        Mask or rotated box that was answered, see :mod:`eval.regions`.
    """

    ok: bool
    box: list[float]
    seconds: float
    region: str = ""


class Walk(Interface):
    """A tracker on its way: what a protocol can do with it."""

    def begin(self, index: int, frame: NDArray[Any], box: Box) -> float:
        """Start a new tracker on frame `index`; returns the seconds that it took."""

    def step(self, index: int, frame: NDArray[Any]) -> Step:
        """Give it frame `index` and take down its answer."""

    def hold(self, index: int) -> None:
        """Take down the last answer for frame `index`, which it is not given."""

    def mark(self, name: str, index: int) -> None:
        """Remember that something happened at frame `index`."""


Lead = Callable[[Walk, Sequence, tuple[int, Box]], None]
Begin = Callable[[Sequence, int], tuple[int, Box]]


@dataclass(frozen=True)
class Protocol:
    """One way to lead a tracker through a sequence.

    Parameters
    ----------
    name : str
        As it is asked for.
    table : str
        Which table its results make, a name in ``eval.protocol_tables.TABLES``.
    lead : callable
        Leads a walk through a sequence from a frame and box.
    begin : callable
        (sequence, number of the run) -> frame and box of its start.
    runs : callable, optional
        Sequence -> how many runs there are of it; 1 where it is not said.
    stored : str, optional
        Name in results and keys, where that is not its own: another protocol's results serve for it.
    """

    name: str
    table: str
    lead: Lead
    begin: Begin
    runs: Callable[[Sequence], int] = lambda sequence: 1
    stored: str = ""

    @property
    def key(self) -> str:
        """Name in results and keys."""
        return self.stored or self.name


def start_box(sequence: Sequence, start: int) -> Box:
    """Box that a tracker is given on frame 0: whole pixels inside the frame.

    Parameters
    ----------
    sequence : Sequence
    start : int
        0 for the exact box; otherwise the number of the perturbation: up to ±10 % of the size in position and size,
        the same for every tracker.
    """
    x, y, w, h = (float(value) for value in sequence.boxes[0])
    if start:
        seed = hashlib.sha256(f"{sequence.name}\0{start}".encode()).digest()
        dx, dy, dw, dh = np.random.default_rng(list(seed)).uniform(-PERTURBATION, PERTURBATION, 4)
        x, y, w, h = x + (dx - dw / 2) * w, y + (dy - dh / 2) * h, w * (1 + dw), h * (1 + dh)
    return whole_box((x, y, w, h), sequence.size)


def _true_box(sequence: Sequence, index: int) -> Box:
    return whole_box(sequence.boxes[index].tolist(), sequence.size)


# --- one pass, from wherever it starts -------------------------------------------------------------------------


def _pass(walk: Walk, sequence: Sequence, begin: tuple[int, Box]) -> None:
    first, box = begin
    for index, frame in enumerate(sequence.frames):
        if index == first:
            walk.begin(index, frame, box)
        elif index > first:
            walk.step(index, frame)


def _at_first(sequence: Sequence, start: int) -> tuple[int, Box]:
    return 0, start_box(sequence, start)


def _elsewhere(sequence: Sequence, start: int) -> tuple[int, Box]:
    x, y, w, h = (float(value) for value in sequence.boxes[0])
    moves = [(dx, dy) for dy in (-1, 0, 1) for dx in (-1, 0, 1) if (dx, dy) != (0, 0)]
    if start < len(moves):
        dx, dy = moves[start]
        box = (x + dx * _SHIFT * w, y + dy * _SHIFT * h, w, h)
    else:
        scale = _SCALES[start - len(moves)]
        box = (x + w * (1 - scale) / 2, y + h * (1 - scale) / 2, scale * w, scale * h)
    return 0, whole_box(box, sequence.size)


def _times(sequence: Sequence) -> list[int]:
    """Frames at which a pass of TRE starts: the first at or after each even distance on which the object is seen."""
    seen = np.flatnonzero(_startable(sequence))
    reach = max(len(sequence) - _LEAST_FRAMES, 0)
    wanted = {math.floor(part * (reach + 1) / _SEGMENTS) for part in range(_SEGMENTS)} | {0}
    found = {int(seen[seen >= index][0]) if index and (seen >= index).any() else 0 for index in wanted}
    return sorted(index for index in found if index < len(sequence) - 1)


def _later(sequence: Sequence, start: int) -> tuple[int, Box]:
    index = _times(sequence)[start]
    return index, _true_box(sequence, index)


def misplaced(error: float) -> Protocol:
    """One pass from a start box that is wrong by a known share of its size.

    Parameters
    ----------
    error : float
        Position and size are off by so much, each to one side or the other; to which, the sequence's name decides.
    """

    def begin(sequence: Sequence, start: int) -> tuple[int, Box]:
        x, y, w, h = (float(value) for value in sequence.boxes[0])
        seed = hashlib.sha256(f"{sequence.name}\0box".encode()).digest()
        dx, dy, dw, dh = np.random.default_rng(list(seed)).choice([-error, error], 4)
        moved = (x + (dx - dw / 2) * w, y + (dy - dh / 2) * h, w * (1 + dw), h * (1 + dh))
        return 0, whole_box(moved, sequence.size)

    return Protocol(f"box:{error:g}", "box", _pass, begin)


# --- restarts ------------------------------------------------------------------------------------------------------


def _inside(sequence: Sequence) -> NDArray[np.bool_]:
    """Frames whose true box has an area in the frame."""
    return iou_per_frame(sequence.boxes, sequence.boxes, sequence.size) > 0


def _startable(sequence: Sequence) -> NDArray[np.bool_]:
    return np.asarray(_inside(sequence) & (sequence.visibility >= _SEEN_ENOUGH))


def _restarts(walk: Walk, sequence: Sequence, begin: tuple[int, Box]) -> None:
    startable, judged = _startable(sequence), _inside(sequence) & (sequence.visibility >= MIN_VISIBILITY)
    running, awaited = False, 0
    for index, frame in enumerate(sequence.frames):
        if running:
            answer = walk.step(index, frame)
            running = not (judged[index] and _missed(sequence, index, answer))
            if not running:
                walk.mark("failed", index)
                awaited = index + _SKIPPED
        elif index == begin[0] or (index >= awaited and startable[index]):
            walk.begin(index, frame, begin[1] if index == begin[0] else _true_box(sequence, index))
            running = True


def _missed(sequence: Sequence, index: int, answer: Step) -> bool:
    """Whether an answer has no pixel of the object: of its region where that is the truth, else of its box."""
    if not (answer.ok and np.isfinite(answer.box).all()):
        return True
    truth = sequence.regions[index] if sequence.by_region else ""
    if truth:
        return region_iou(read_region(truth), answered_region(answer.region, answer.box), sequence.size) == 0
    overlap = iou_per_frame(sequence.boxes[[index]], np.array([answer.box]), sequence.size)[0]
    return bool(overlap == 0)


# --- real time -----------------------------------------------------------------------------------------------------


def _hurried(fps: float) -> Lead:
    def lead(walk: Walk, sequence: Sequence, begin: tuple[int, Box]) -> None:
        passing, grace = 0, _GRACE
        for index, frame in enumerate(sequence.frames):
            if passing:
                passing -= 1
                walk.hold(index)
                walk.mark("dropped", index)
                continue
            seconds = walk.begin(index, frame, begin[1]) if index == 0 else walk.step(index, frame).seconds
            # In time is done before the next frame is there.
            passing = max(math.ceil(seconds * fps) - 1, 0)
            if passing and grace:
                passing, grace = 0, grace - 1

    return lead


ONE_PASS = Protocol("one-pass", "one-pass", _pass, _at_first)

PROTOCOLS: dict[str, Protocol] = {
    protocol.name: protocol
    for protocol in (
        ONE_PASS,
        Protocol("sre", "sre", _pass, _elsewhere, lambda sequence: 8 + len(_SCALES)),
        Protocol("tre", "tre", _pass, _later, lambda sequence: len(_times(sequence))),
        Protocol("restarts", "restarts", _restarts, _at_first),
        Protocol("realtime", "realtime", _hurried(_FPS), _at_first, stored=f"realtime:{_FPS:g}"),
        Protocol("long-term", "long-term", _pass, _at_first, stored=ONE_PASS.name),
    )
}


_AT_ANY_RATE = "realtime:FPS (FPS above 0)"


def find_protocol(name: str) -> Protocol:
    """Look a protocol up by name; ``realtime:FPS`` is real time at another rate.

    Raises
    ------
    ValueError
        If there is none of that name; the message lists the known ones.
    """
    kind, colon, rate = name.partition(":")
    if not colon:
        return look_up(PROTOCOLS, name, "protocol", _AT_ANY_RATE)
    try:
        fps = float(rate)
    except ValueError:
        fps = 0.0
    if kind != "realtime" or not 0.0 < fps < math.inf:
        return look_up(PROTOCOLS, name, "protocol", _AT_ANY_RATE)
    return Protocol(f"realtime:{fps:g}", "realtime", _hurried(fps), _at_first)
