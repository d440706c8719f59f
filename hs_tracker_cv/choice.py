"""Which of the two modes to follow: segmentation by motion, or the box carried by flow.

Segmentation is worth following only while its background model explains the pixels outside its mask. Two
measurements say whether it does, and they complement each other: the mean difference between frame and background
catches passers-by and changed light; the flow that strays from the camera's catches a mask that has lost its
object on calm ground.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

__all__ = ["MISMATCH_LIMIT", "STRAY_LIMIT", "Choice", "judge"]

MISMATCH_LIMIT = 4.5
"""Running mean |frame − background| outside the mask above which segmentation is not trusted, gray levels."""

STRAY_LIMIT = 0.30
"""Running |flow − camera motion| outside the mask, in units of the object's own motion, above which it is not."""

_HYSTERESIS = 0.1
_MISMATCH_FLOOR, _STRAY_FLOOR = 0.1, 0.05
_MISMATCH_RATE, _STRAY_RATE = 0.05, 0.1
_FIRST_SWITCH = 3


@dataclass(frozen=True)
class Choice:
    """The running measurements and what follows from them.

    Parameters
    ----------
    frames : int
        Frames judged so far.
    log_mismatch, log_stray : float
        Running means of the logarithms.
    trusted : bool
        True while segmentation is followed.
    since : int
        Frames since `trusted` last changed.
    """

    frames: int = 0
    log_mismatch: float = 0.0
    log_stray: float = 0.0
    trusted: bool = True
    since: int = 0

    @property
    def mismatch(self) -> float:
        """Running mean difference from the background, gray levels."""
        return math.exp(self.log_mismatch) - _MISMATCH_FLOOR

    @property
    def stray(self) -> float:
        """Running stray flow, as a fraction of the object's motion."""
        return math.exp(self.log_stray) - _STRAY_FLOOR


def judge(choice: Choice, mismatch: float, stray: float) -> Choice:
    """Take in the measurements of one frame.

    Parameters
    ----------
    choice : Choice
        What was known before.
    mismatch : float
        Mean |frame − background| outside the mask, gray levels.
    stray : float
        Median |flow − camera motion| outside the mask over the motion contrast of the object.

    Returns
    -------
    Choice
    """
    frames = choice.frames + 1
    log_mismatch = _follow(choice.log_mismatch, mismatch + _MISMATCH_FLOOR, _MISMATCH_RATE, frames)
    log_stray = _follow(choice.log_stray, stray + _STRAY_FLOOR, _STRAY_RATE, frames)
    slack = _HYSTERESIS if choice.trusted else -_HYSTERESIS
    trusted = log_mismatch < math.log(MISMATCH_LIMIT) + slack and log_stray < math.log(STRAY_LIMIT) + slack
    if frames < _FIRST_SWITCH:
        trusted = choice.trusted
    since = choice.since + 1 if trusted == choice.trusted else 0
    return replace(
        choice, frames=frames, log_mismatch=log_mismatch, log_stray=log_stray, trusted=trusted, since=since
    )


def _follow(mean: float, value: float, rate: float, count: int) -> float:
    """Running mean of log `value`: a plain mean at first, exponential later."""
    return mean + max(rate, 1.0 / count) * (math.log(value) - mean)
