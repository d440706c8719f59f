"""Which of the two modes to follow: segmentation by motion, or the box carried by flow; and how far to believe it.

Segmentation is doubted by three measurements, in one sum: what its background memory leaves unexplained outside its
mask, how far the segment's size is from what the user drew, and how unsteadily that size changes from frame to frame.
The carried box is the witness of the second, but only while it is young: in its first frames it cannot have drifted,
later it may. So the latter two are measured in the first frames and kept. They take some frames to be told from the
unrest of a beginning: until then doubt is put off.

The carried box is also asked where it would be on its own. Where it is rather right than not and elsewhere, it is
followed, and so it is where segmentation is doubted and it is likely right. What it says and the doubt make the
chance that a segment is right, which is the score. Of an object that turns steadily it is no witness: it knows that
as it stood at first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Annotated

from ..geometry import Box, iou
from ..validation import Count, Within
from . import tuning
from .steadiness import Steadiness, growth

__all__ = ["Choice", "agreement", "size_difference", "updated"]


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
        Mean `size_difference` of the two boxes: over those of the first `tuning.WITNESS_FRAMES` frames in which the
        carried box is a witness; later the running one of what it says when asked.
    witnessed : int
        How many these were.
    trusted : bool
        True while segmentation is followed.
    since : int
        Frames since `trusted` last changed.
    chance : float
        Chance that the carried box is right, 0–1, when it was last asked.
    agreement : float
        `agreement` of the two boxes then.
    steadiness : Steadiness
        Of the segment.
    taught : bool
        True once segmentation has shown the patch tracker where the object is: that is no witness any more.
    """

    frames: Count = 0
    log_unexplained: Annotated[float, Within(-100.0, 100.0)] = 0.0
    size_difference: float = 0.0
    witnessed: Count = 0
    trusted: bool = True
    since: Count = 0
    chance: Annotated[float, Within(0.0, 1.0)] = 1.0
    agreement: Annotated[float, Within(0.0, 1.0)] = 1.0
    steadiness: Steadiness = field(default_factory=Steadiness)
    taught: bool = False

    @property
    def teaching(self) -> bool:
        """Segmentation leads, and shows the patch tracker where the object is."""
        return self.taught and self.trusted

    @property
    def unexplained(self) -> float:
        """Running share of the background that its memory does not explain, 0–1."""
        return math.exp(self.log_unexplained) - tuning.FLOOR

    @property
    def doubt(self) -> float:
        """How far the measurements speak against segmentation: positive, they do; negative, they do not."""
        shape = self.steadiness
        measured = self.log_unexplained + tuning.SIZE_WEIGHT * self.size_difference
        measured += math.log(shape.unsteadiness + tuning.STEADY)
        # The box of the patch tracker does not turn: of what does, a doubtful segment is the better answer.
        turning = tuning.SPIN_WEIGHT * min(abs(shape.spin), tuning.FAST_SPIN)
        early = tuning.EARLY * max(1.0 - self.frames / tuning.WITNESS_FRAMES, 0.0) if self.trusted else 0.0
        return measured - turning - early - tuning.LIMIT

    @property
    def contradicted(self) -> bool:
        """The carried box is rather right than not, and elsewhere."""
        elsewhere = self.agreement < tuning.APART and self.chance > tuning.RATHER
        return elsewhere and not self.steadiness.spinning

    def may_have_left(self, score: float) -> bool:
        """A segment of that score, not doubted, has gone from where the carried box is, if both began together."""
        apart = self.agreement < tuning.LEFT_AGREEMENT and self.trusted
        return apart and score > tuning.LEFT_SCORE and self.doubt < tuning.LEFT_DOUBT

    def outweighed(self, chance: float) -> bool:
        """A segment hardly to be believed stands against a carried box that is rather right than not."""
        return self.trusted and chance < tuning.LEAST and self.chance > tuning.RATHER

    @property
    def carried_away(self) -> Choice:
        """The same measurements with the carried box followed."""
        return replace(self, trusted=False, since=0)

    def asked(self, chance: float, agreement: float, difference: float | None = None) -> Choice:
        """Take in what the carried box says where it is on its own, and how large; None where it is no witness."""
        size = self.size_difference
        if difference is not None:
            size += tuning.ASKED_RATE * (difference - size)
        return replace(self, chance=chance, agreement=agreement, size_difference=size)

    @property
    def confirmed(self) -> bool:
        """The carried box is rather right than not, and where the segment is."""
        return self.agreement > tuning.TOGETHER and self.chance > tuning.RATHER

    @property
    def with_pupil(self) -> Choice:
        """The same measurements with the carried box put on the segment, and taught."""
        return replace(self, chance=1.0, agreement=1.0, taught=True)

    def segment_chance(self, score: float) -> float:
        """Chance that a segment is right, 0–1, by its own `score` and what the carried box said of it.

        Logistic; fitted on ``drawn:160:101`` and on 22 real sequences (choose.txt), three starts each.
        """
        chance, agreed = self.chance, self.agreement
        if self.steadiness.spinning:
            chance, agreed = max(chance, tuning.SPUN_CHANCE), max(agreed, tuning.SPUN_AGREEMENT)
        evidence = tuning.SEGMENT_CHANCE * _log_odds(chance) + tuning.SEGMENT_SCORE * _log_odds(score)
        evidence = evidence + tuning.SEGMENT_AGREEMENT * agreed + tuning.SEGMENT_DOUBT * self.doubt
        return 1.0 / (1.0 + math.exp(-tuning.SEGMENT_OFFSET - evidence))


def updated(choice: Choice, unexplained: float, difference: float | None, steadiness: Steadiness) -> Choice:
    """Take in the measurements of one frame.

    Parameters
    ----------
    choice : Choice
        What was known before.
    unexplained : float
        Share of the known background outside the mask that its memory does not explain in this frame, 0–1.
    difference : float or None
        `size_difference` of the two boxes in this frame; None when the carried box is no witness, not being sure
        itself. Not used after the first `tuning.WITNESS_FRAMES`.
    steadiness : Steadiness
        Of the segment after this frame.

    Returns
    -------
    Choice
    """
    frames = choice.frames + 1
    # A plain mean at first, an exponential one later.
    rate = max(tuning.RATE, 1.0 / frames)
    mean = choice.log_unexplained + rate * (math.log(unexplained + tuning.FLOOR) - choice.log_unexplained)
    size, witnessed = choice.size_difference, choice.witnessed
    if frames <= tuning.WITNESS_FRAMES and difference is not None:
        witnessed += 1
        size += (difference - size) / witnessed
    seen = replace(
        choice,
        frames=frames,
        log_unexplained=mean,
        size_difference=size,
        witnessed=witnessed,
        since=choice.since + 1,
        steadiness=steadiness,
    )
    if frames < tuning.FIRST_SWITCH:
        return seen
    if seen.trusted:
        alike = seen.agreement > tuning.TOGETHER and seen.size_difference < tuning.ALIKE
        doubtful = seen.doubt >= tuning.LEAVE and not alike
        leave = seen.contradicted or (doubtful and seen.chance > tuning.LIKELY)
        return seen.carried_away if leave else seen
    return replace(seen, trusted=True, since=0) if seen.doubt < tuning.RETURN else seen


def _log_odds(chance: float) -> float:
    chance = min(max(chance, tuning.LEAST_ODDS), tuning.MOST_ODDS)
    return math.log(chance / (1.0 - chance))


def size_difference(a: Box, b: Box) -> float:
    """Twice the |log ratio| of the diagonals: that of a bar stays as it is while it turns, those of its sides do not.

    Examples
    --------
    >>> size_difference(Box(0, 0, 20, 10), Box(5, 5, 10, 20))
    0.0
    """
    return 2.0 * abs(growth(a, b))


def agreement(a: Box, b: Box) -> float:
    """How well two boxes agree on the place, 0–1: their IoU, or more where only their shapes differ.

    Boxes of one size that are a third of their side apart have ½ by either measure.
    """
    (ax, ay), (bx, by) = a.centre, b.centre
    side = math.sqrt(max(0.5 * (a.area + b.area), 1.0))
    return min(max(iou(a, b), 1.0 - tuning.PLACE_WEIGHT * math.hypot(ax - bx, ay - by) / side), 1.0)
