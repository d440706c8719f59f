"""Which of the two modes to follow: segmentation by motion, or the box carried by flow.

Segmentation is worth following only while its background memory explains the pixels outside its mask. How many of
them it leaves unexplained is measured in every frame; the running mean of the logarithm decides. It is a choice of
regime, not a judge of which box is better in this frame: the two boxes' agreement, their sizes and their own scores
were measured to be worse witnesses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

__all__ = ["UNEXPLAINED_LIMIT", "Choice", "judge"]

UNEXPLAINED_LIMIT = 0.03
"""Running share of known background outside the mask that contradicts the background memory, above which
segmentation is not followed."""

_FLOOR = 0.01
_RATE = 0.05
_HYSTERESIS = 0.1
_FIRST_SWITCH = 3


@dataclass(frozen=True)
class Choice:
    """The running measurement and what follows from it.

    Parameters
    ----------
    frames : int
        Frames judged so far.
    log_unexplained : float
        Running mean of log(unexplained share + 0.01).
    trusted : bool
        True while segmentation is followed.
    since : int
        Frames since `trusted` last changed.
    """

    frames: int = 0
    log_unexplained: float = 0.0
    trusted: bool = True
    since: int = 0

    @property
    def unexplained(self) -> float:
        """Running share of the background that its memory does not explain, 0–1."""
        return math.exp(self.log_unexplained) - _FLOOR


def judge(choice: Choice, unexplained: float) -> Choice:
    """Take in the measurement of one frame.

    Parameters
    ----------
    choice : Choice
        What was known before.
    unexplained : float
        Share of the known background outside the mask that its memory does not explain in this frame, 0–1.

    Returns
    -------
    Choice
    """
    frames = choice.frames + 1
    # A plain mean at first, an exponential one later.
    rate = max(_RATE, 1.0 / frames)
    mean = choice.log_unexplained + rate * (math.log(unexplained + _FLOOR) - choice.log_unexplained)
    slack = _HYSTERESIS if choice.trusted else -_HYSTERESIS
    trusted = choice.trusted if frames < _FIRST_SWITCH else mean < math.log(UNEXPLAINED_LIMIT + _FLOOR) + slack
    return Choice(frames, mean, trusted, choice.since + 1 if trusted == choice.trusted else 0)
