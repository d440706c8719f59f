"""How a segment changes from frame to frame: what follows one motion keeps its size, or changes it smoothly."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated

from ..geometry import Box
from ..validation import Count, Within
from . import tuning

__all__ = ["Steadiness", "growth"]


@dataclass(frozen=True)
class Steadiness:
    """Size and turn of the segment over time.

    Parameters
    ----------
    segments : int
        Pairs of segments compared so far.
    growth : float
        `growth` between the last two.
    unsteadiness : float
        Mean |change of growth| over the first `tuning.WITNESS_FRAMES` pairs: 0 for a size that stays or changes
        evenly, however fast.
    spin : float
        Running mean of the turn, radians per frame from x towards y.
    wobble : float
        Running mean of how far single turns are from that, radians per frame.
    """

    segments: Count = 0
    growth: float = 0.0
    unsteadiness: Annotated[float, Within(0.0, 100.0)] = 0.0
    spin: Annotated[float, Within(-10.0, 10.0)] = 0.0
    wobble: Annotated[float, Within(0.0, 20.0)] = 0.0

    @property
    def spinning(self) -> bool:
        """The object turns steadily: then the patch tracker, which knows it as it stood, is no witness."""
        return abs(self.spin) > max(tuning.SPINNING, tuning.WOBBLING * self.wobble)

    def after(self, grown: float, turn: float) -> Steadiness:
        """Take in one more pair of segments.

        Parameters
        ----------
        grown : float
            `growth` from one to the other.
        turn : float
            Radians from x towards y.
        """
        segments = self.segments + 1
        unsteadiness = self.unsteadiness
        if 1 < segments <= tuning.WITNESS_FRAMES:
            unsteadiness += (abs(grown - self.growth) - unsteadiness) / (segments - 1)
        rate = max(tuning.RATE, 1.0 / segments)
        spin = self.spin + rate * (turn - self.spin)
        wobble = self.wobble + rate * (abs(turn - spin) - self.wobble)
        return Steadiness(segments, grown, unsteadiness, spin, wobble)


def growth(before: Box, after: Box) -> float:
    """Log ratio of the diagonals: that of a bar stays as it is while it turns, those of its sides do not.

    Examples
    --------
    >>> growth(Box(0, 0, 20, 10), Box(5, 5, 10, 20))
    0.0
    """
    return math.log(max(math.hypot(after.w, after.h), 1.0) / max(math.hypot(before.w, before.h), 1.0))
