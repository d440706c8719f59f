"""Where and how trackers fail on one sequence: frame by frame as a strip, the failures, and the frames round them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .metrics import FAR_OFF
from .statistics import ScoredRun

__all__ = ["KINDS", "Failure", "Kind", "Strip", "failures", "states", "strips"]

Kind = Literal["far off", "false False", "false True", "drop"]

KINDS: dict[Kind, str] = {
    "far off": "located far off (True, IoU below 0.1)",
    "false False": "said to be lost though it is seen",
    "false True": "said to be located where nothing is seen",
    "drop": "IoU falls by 0.4 or more from one frame to the next",
}
"""What a failure can be, and what that means."""

_DROP = 0.4
_APART = 3  # frames: failures of one kind that are closer are one

# States of a frame, as strips show them.
_UNJUDGED, _LOCATED, _FAR_OFF, _FALSE_FALSE, _FALSE_TRUE, _RIGHTLY_FALSE = range(6)
_STATES: dict[int, Kind] = {_FAR_OFF: "far off", _FALSE_FALSE: "false False", _FALSE_TRUE: "false True"}


@dataclass(frozen=True)
class Failure:
    """A tracker goes wrong.

    Parameters
    ----------
    tracker : str
    kind : str
        A name in :data:`KINDS`.
    first, last : int
        Frames of which that is true.
    before, after : float
        IoU in the frame before, and in the first of them; NaN where no box is scored.
    """

    tracker: str
    kind: Kind
    first: int
    last: int
    before: float
    after: float


@dataclass(frozen=True)
class Strip:
    """One tracker on one sequence, frame by frame.

    Parameters
    ----------
    tracker : str
    iou : ndarray, shape (T,)
        NaN where no box is scored.
    state : ndarray of int, shape (T,)
        See :func:`states`.
    spans : list of (first, stop, fill)
        Runs of frames that look alike, with what they look like: ``iou0`` … ``iou4``, ``far``, ``falsefalse``,
        ``falsetrue``, ``absent`` or ``none``.
    """

    tracker: str
    iou: NDArray[np.float64]
    state: NDArray[np.int64]
    spans: list[tuple[int, int, str]]


def states(item: ScoredRun) -> NDArray[np.int64]:
    """What each frame (T,) is: 0 not judged, 1 located, 2 far off, 3 false False, 4 false True, 5 rightly False."""
    scores = item.frames
    far = np.nan_to_num(scores.iou) < FAR_OFF
    seen = np.where(scores.ok, np.where(far, _FAR_OFF, _LOCATED), _FALSE_FALSE)
    gone = np.where(scores.ok, _FALSE_TRUE, _RIGHTLY_FALSE)
    later = np.where(scores.visible, seen, np.where(scores.invisible, gone, _UNJUDGED))
    return np.concatenate([[_UNJUDGED], later])


def failures(item: ScoredRun) -> list[Failure]:
    """Every failure of a run, in the order of frames."""
    iou, state = _iou(item), states(item)
    found: list[Failure] = []
    for code, kind in _STATES.items():
        for first, stop in _merged(state == code):
            found.append(_failure(item, kind, first, stop - 1, iou))
    known = {frame for one in found for frame in range(one.first, one.last + 1)}
    with np.errstate(invalid="ignore"):
        falls = np.flatnonzero(np.diff(iou) <= -_DROP) + 1
    found += [_failure(item, "drop", int(frame), int(frame), iou) for frame in falls if int(frame) not in known]
    return sorted(found, key=lambda one: (one.first, one.kind))


def _failure(item: ScoredRun, kind: Kind, first: int, last: int, iou: NDArray[np.float64]) -> Failure:
    return Failure(item.run.tracker, kind, first, last, float(iou[first - 1]), float(iou[first]))


def _merged(where: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Spans (first, stop) of what is true; small gaps do not count."""
    spans: list[tuple[int, int]] = []
    for first, stop in _spans(where.astype(int)):
        if not where[first]:
            continue
        if spans and first - spans[-1][1] < _APART:
            spans[-1] = (spans[-1][0], stop)
        else:
            spans.append((first, stop))
    return spans


def _spans(values: NDArray[np.int64]) -> list[tuple[int, int]]:
    edges = [0, *(np.flatnonzero(np.diff(values)) + 1).tolist(), len(values)]
    return list(pairwise(edges))


def _iou(item: ScoredRun) -> NDArray[np.float64]:
    return np.concatenate([[np.nan], item.frames.iou])


def strips(items: Iterable[ScoredRun]) -> list[Strip]:
    """Strips of the trackers' runs on one sequence, in their order."""
    return [_strip(item) for item in items]


_FILLS = {_FAR_OFF: "far", _FALSE_FALSE: "falsefalse", _FALSE_TRUE: "falsetrue", _RIGHTLY_FALSE: "absent"}


def _strip(item: ScoredRun) -> Strip:
    iou, state = _iou(item), states(item)
    level = np.clip(np.nan_to_num(iou) * 5.0, 0, 4).astype(np.int64)
    look = np.where(state == _LOCATED, 10 + level, state)
    spans = []
    for first, stop in _spans(look):
        code = int(look[first])
        spans.append((first, stop, f"iou{code - 10}" if code >= 10 else _FILLS.get(code, "none")))
    return Strip(item.run.tracker, iou, state, spans)
