"""The rule that chooses the mode."""

from __future__ import annotations

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hs_tracker_cv.arbitration.choice import Choice, agreement, size_difference, updated
from hs_tracker_cv.arbitration.steadiness import Steadiness, growth
from hs_tracker_cv.arbitration.tuning import SPINNING, WITNESS_FRAMES
from hs_tracker_cv.geometry import Box

pytestmark = pytest.mark.once

shares = st.floats(0, 1)
differences = st.floats(0, 3)


STEADY = Steadiness(segments=WITNESS_FRAMES, unsteadiness=0.008)  # a segment of the laboratory
RAGGED = Steadiness(segments=WITNESS_FRAMES, unsteadiness=0.04)  # one of real video


def after(
    count: int,
    unexplained: float,
    difference: float = 0.0,
    choice: Choice | None = None,
    steadiness: Steadiness = STEADY,
) -> Choice:
    """The choice after the same measurements `count` times."""
    choice = (choice or Choice()).asked(1.0, 0.8)
    for _ in range(count):
        choice = updated(choice, unexplained, difference, steadiness)
    return choice


@pytest.mark.parametrize(
    ("unexplained", "difference", "trusted"),
    [
        (0.0, 0.0, True),  # all explained, sizes agree: the laboratory
        (0.02, 0.0, True),  # compressed video, a good segment
        (0.02, 0.4, False),  # the same background, but the segment is not what was drawn
        (0.0, 0.4, True),  # an object that changes its shape before an explained background
        (0.8, 0.0, False),  # nothing of the background is explained
    ],
)
def test_explanation_and_size_count(unexplained: float, difference: float, trusted: bool) -> None:
    """Segmentation is left when the background is unexplained or the size disagrees, each in view of the other."""
    assert after(30, unexplained, difference).trusted is trusted


def test_no_switch_on_the_first_frames() -> None:
    """Five frames are too few to leave segmentation."""
    assert after(5, 1.0, 2.0).trusted
    assert not after(6, 1.0, 2.0).trusted


def test_what_is_a_little_doubtful_is_left_at_the_end_of_the_trial_only() -> None:
    """A beginning is unsteady: the same measurements must hold longer than a gross mistake."""
    assert after(WITNESS_FRAMES // 2, 0.02, 0.4).trusted
    assert not after(WITNESS_FRAMES + 1, 0.02, 0.4).trusted


def test_a_ragged_segment_is_left_where_a_steady_one_is_followed() -> None:
    """The same background, the same size: the third measurement decides."""
    assert after(30, 0.02, 0.1).trusted
    assert not after(30, 0.02, 0.1, steadiness=RAGGED).trusted


def test_of_what_turns_the_patch_tracker_is_no_witness() -> None:
    """Neither doubt nor contradiction hands over what would not be left at rest, and the segment stays believed."""
    spun = replace(STEADY, spin=2 * SPINNING)
    assert not after(30, 0.02, 0.4).trusted
    assert after(30, 0.02, 0.4, steadiness=spun).trusted
    blind = Choice(log_unexplained=-4.0, frames=30, steadiness=spun).asked(0.65, 0.1)
    at_rest = replace(blind, steadiness=STEADY)
    assert at_rest.contradicted
    assert not blind.contradicted
    assert blind.segment_chance(0.9) > 0.5 > at_rest.segment_chance(0.9)


def test_a_turn_that_comes_and_goes_is_no_steady_one() -> None:
    """A segment that swells turns for ten frames; an object turns at its rate in every frame."""
    swelling = turning = Steadiness()
    for t in range(40):
        swelling = swelling.after(0.0, 0.09 if t >= 30 else 0.0)
        turning = turning.after(0.0, 0.05)
    assert swelling.spin > SPINNING
    assert not swelling.spinning
    assert turning.spinning


def test_the_mean_turn_counts_against_how_far_turns_are_from_it() -> None:
    """± .02 round .05 is steady, ± .05 round it is not; the first pair has no distance from its own mean."""
    for spread, spinning in ((0.0, True), (0.02, True), (0.05, False)):
        shape = Steadiness()
        for t in range(60):
            shape = shape.after(0.0, 0.05 + spread * (-1) ** t)
        assert shape.wobble == pytest.approx(spread, rel=0.1, abs=1e-9)
        assert shape.spinning is spinning
    assert Steadiness().after(0.0, 0.7).wobble == 0.0


def test_doubt_of_a_segment_that_does_not_lead_is_not_put_off() -> None:
    """After a hand-over segmentation must earn the lead; nothing is taken off in its favour."""
    leading = Choice(frames=5, log_unexplained=-3.0, steadiness=STEADY)
    assert leading.doubt < replace(leading, trusted=False).doubt == replace(leading, frames=WITNESS_FRAMES).doubt


@given(st.floats(-0.1, 0.1), st.floats(-0.2, 0.2), st.integers(2, 40))
def test_even_growth_and_turn_are_steady(grown: float, turn: float, count: int) -> None:
    """What grows evenly has no unsteadiness; a constant turn is its own mean."""
    shape = Steadiness()
    for _ in range(count):
        shape = shape.after(grown, turn)
    assert shape.unsteadiness == pytest.approx(0.0, abs=1e-12)
    assert shape.spin == pytest.approx(turn)
    assert shape.segments == count


def test_unsteadiness_is_the_mean_change_of_growth_in_the_first_frames() -> None:
    """Growth of ± .02 by turns changes by .04 each time; what comes after the trial changes nothing."""
    shape = Steadiness()
    for t in range(WITNESS_FRAMES):
        shape = shape.after(0.02 * (-1) ** t, 0.0)
    assert shape.unsteadiness == pytest.approx(0.04)
    assert shape.after(3.0, 0.0).unsteadiness == shape.unsteadiness


def test_growth_is_that_of_the_diagonal() -> None:
    """A bar that turns does not grow; twice the size is log 2."""
    assert growth(Box(0, 0, 30, 10), Box(5, 9, 10, 30)) == 0.0
    assert growth(Box(0, 0, 30, 10), Box(0, 0, 60, 20)) == pytest.approx(0.6931471805599453)


def test_the_witness_is_heard_only_while_it_is_young() -> None:
    """Sizes that part later change nothing."""
    choice = after(WITNESS_FRAMES, 0.05, 0.0)
    assert after(100, 0.05, 2.0, choice).size_difference == choice.size_difference == 0.0


def test_an_old_witness_is_heard_when_it_is_asked() -> None:
    """Each answer counts by half; none is no answer. A segment that shrinks away from it becomes doubtful."""
    choice = after(WITNESS_FRAMES, 0.02, 0.0)
    assert choice.asked(0.9, 0.8, 0.6).size_difference == pytest.approx(0.3)
    assert choice.asked(0.9, 0.8, 0.6).asked(0.9, 0.8, 0.6).size_difference == pytest.approx(0.45)
    assert choice.asked(0.9, 0.8, None).size_difference == choice.size_difference
    assert choice.doubt < 0.0 < choice.asked(0.9, 0.8, 0.6).asked(0.9, 0.8, 0.6).doubt


@pytest.mark.parametrize(
    ("segment", "chance", "outweighed"),
    [(0.1, 0.7, True), (0.1, 0.5, False), (0.3, 0.9, False)],  # rather right; rather not; the segment is believed
)
def test_a_segment_that_is_not_believed_is_left(segment: float, chance: float, outweighed: bool) -> None:
    """A carried box that is rather right takes its place."""
    assert Choice().asked(chance, 0.1).outweighed(segment) is outweighed
    assert not replace(Choice(), trusted=False).asked(chance, 0.1).outweighed(segment)


def test_constants_are_reported_as_they_are() -> None:
    """The running means of constants are the constants."""
    choice = after(30, 0.25, 0.3)
    assert choice.unexplained == pytest.approx(0.25)
    assert choice.size_difference == pytest.approx(0.3)


def test_trust_comes_back_with_the_background() -> None:
    """A passer-by ends trust for a while, not for ever."""
    distrusted = after(40, 0.9)
    assert not distrusted.trusted
    assert after(200, 0.0, 0.0, distrusted).trusted


@given(st.lists(st.tuples(shares, differences), max_size=40))
def test_a_switch_needs_doubt_and_restarts_the_count(values: list[tuple[float, float]]) -> None:
    """Trust changes only where the doubt has passed zero by the hysteresis; `since` restarts at each change."""
    choice = Choice()
    for value in values:
        following = updated(choice, *value, choice.steadiness)
        if following.trusted != choice.trusted:
            assert following.since == 0
            assert (following.doubt > 0) is choice.trusted
        else:
            assert following.since == choice.since + 1
        choice = following


@given(st.floats(1, 500), st.floats(1, 500), st.floats(0.2, 5))
def test_size_difference_is_symmetric_and_free_of_scale(w: float, h: float, factor: float) -> None:
    """Neither the order of the boxes nor the size of the picture matters."""
    a, b = Box(0, 0, 10 * w, 10 * h), Box(3, 4, 12 * w, 7 * h)
    assert size_difference(a, b) == pytest.approx(size_difference(b, a))
    scaled = [Box(0, 0, box.w * factor, box.h * factor) for box in (a, b)]
    assert size_difference(*scaled) == pytest.approx(size_difference(a, b))


@pytest.mark.parametrize("shift", [0.0, 5.0, 10.0, 20.0])
def test_agreement_of_equal_boxes_falls_with_their_distance(shift: float) -> None:
    """Boxes of one size a third of their side apart agree by one half, whichever measure is taken."""
    assert agreement(Box(0, 0, 30, 30), Box(shift, 0, 30, 30)) == pytest.approx(
        max(1.0 - shift / 20.0, (30.0 - shift) / (30.0 + shift))
    )


def test_a_bar_that_turns_agrees_with_itself() -> None:
    """Upright boxes round a bar lying and standing: the same place, and the same size."""
    lying, standing = Box.from_centre(50, 50, 40, 8), Box.from_centre(50, 50, 8, 40)
    assert agreement(lying, standing) == 1.0
    assert size_difference(lying, standing) == 0.0


def test_a_sure_carried_box_elsewhere_is_followed() -> None:
    """A segment that is contradicted is left, one that is confirmed is not."""
    for chance, place, trusted in ((0.9, 0.1, False), (0.9, 0.9, True), (0.4, 0.1, True)):
        choice = Choice()
        for _ in range(10):
            choice = updated(choice.asked(chance, place), 0.01, None, choice.steadiness)
        assert choice.trusted is trusted


def test_doubt_alone_leaves_a_segment_to_a_carried_box_that_is_likely_right_only() -> None:
    """Where nobody knows where the object is, nothing is handed over; nor where both say the same place."""
    for chance, agreed, trusted in ((0.9, 0.8, False), (0.3, 0.8, True), (0.9, 0.95, True)):
        choice = Choice()
        for _ in range(10):
            choice = updated(choice.asked(chance, agreed), 0.5, None, choice.steadiness)
        assert choice.trusted is trusted


def test_belief_rises_with_all_that_speaks_for_a_segment() -> None:
    """Monotone in its own score, in the chance of the carried box that agrees, and in the agreement."""
    likely = Choice(log_unexplained=-3.0).asked(0.9, 0.9)
    assert likely.segment_chance(0.9) > likely.segment_chance(0.3)
    assert likely.segment_chance(0.9) > likely.asked(0.1, 0.9).segment_chance(0.9)
    assert likely.segment_chance(0.9) > likely.asked(0.9, 0.2).segment_chance(0.9)
    assert likely.segment_chance(0.9) > replace(likely, log_unexplained=0.0).segment_chance(0.9)
