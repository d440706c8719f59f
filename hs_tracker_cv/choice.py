"""Which of the two modes to follow: segmentation by motion, or the box carried by flow.

Two measurements, one sum. Segmentation is worth following while its background memory explains the pixels outside
its mask; and while the segment has the size of what the user drew. The carried box is the witness of the latter, but
only while it is young: in its first frames it cannot have drifted from what was drawn, later it may, and its size
says nothing any more. So the second measurement is taken in the first frames and kept.

The other witnesses that were measured (agreement of the boxes' places, the carried box's own scores, mean difference
from the background, flow that strays from the camera's) separate the laboratory from the street less well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated

from .geometry import Box
from .validation import Count, Within

__all__ = ["WITNESS_FRAMES", "Choice", "judge", "size_difference"]

WITNESS_FRAMES = 20
"""Frames after the start in which the size of the carried box can be relied on."""

_LIMIT = -2.25
_SIZE_WEIGHT = 4.0
_FLOOR = 0.01
_RATE = 0.05
_LEAVE, _RETURN = 0.1, -0.7
_FIRST_SWITCH = 6


@dataclass(frozen=True)
class Choice:
    """The running measurements and what follows from them.

    Parameters
    ----------
    frames : int
        Frames judged so far.
    log_unexplained : float
        Running mean of log(unexplained share of the background + 0.01).
    size_difference : float
        Mean |log ratio| of the widths plus that of the heights of the two boxes, over those of the first
        `WITNESS_FRAMES` frames in which the carried box is a witness.
    witnessed : int
        How many these were.
    trusted : bool
        True while segmentation is followed.
    since : int
        Frames since `trusted` last changed.
    """

    frames: Count = 0
    log_unexplained: Annotated[float, Within(-100.0, 100.0)] = 0.0
    size_difference: float = 0.0
    witnessed: Count = 0
    trusted: bool = True
    since: Count = 0

    @property
    def unexplained(self) -> float:
        """Running share of the background that its memory does not explain, 0–1."""
        return math.exp(self.log_unexplained) - _FLOOR

    @property
    def doubt(self) -> float:
        """How far the measurements speak against segmentation: positive, they do; negative, they do not."""
        return self.log_unexplained + _SIZE_WEIGHT * self.size_difference - _LIMIT

    def keeping(self, before: Choice) -> Choice:
        """Return the same measurements with segmentation trusted as `before`: there is nothing better to follow."""
        return replace(self, trusted=True, since=before.since + 1)


def judge(choice: Choice, unexplained: float, difference: float | None) -> Choice:
    """Take in the measurements of one frame.

    Parameters
    ----------
    choice : Choice
        What was known before.
    unexplained : float
        Share of the known background outside the mask that its memory does not explain in this frame, 0–1.
    difference : float or None
        `size_difference` of the two boxes in this frame; None when the carried box is no witness, not being sure
        itself. Not used after the first `WITNESS_FRAMES`.

    Returns
    -------
    Choice
    """
    frames = choice.frames + 1
    # A plain mean at first, an exponential one later.
    mean = choice.log_unexplained + max(_RATE, 1.0 / frames) * (
        math.log(unexplained + _FLOOR) - choice.log_unexplained
    )
    size, witnessed = choice.size_difference, choice.witnessed
    if frames <= WITNESS_FRAMES and difference is not None:
        witnessed += 1
        size += (difference - size) / witnessed
    seen = Choice(frames, mean, size, witnessed, choice.trusted, choice.since + 1)
    trusted = seen.trusted if frames < _FIRST_SWITCH else seen.doubt < (_LEAVE if seen.trusted else _RETURN)
    return seen if trusted == choice.trusted else replace(seen, trusted=trusted, since=0)


def size_difference(a: Box, b: Box) -> float:
    """|log ratio| of the widths plus that of the heights; 0 for boxes of equal size.

    Examples
    --------
    >>> size_difference(Box(0, 0, 20, 10), Box(5, 5, 20, 10))
    0.0
    """
    return sum(abs(math.log(max(one, 1.0) / max(other, 1.0))) for one, other in ((a.w, b.w), (a.h, b.h)))
