"""The rule that chooses the mode."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hs_tracker_cv.choice import UNEXPLAINED_LIMIT, Choice, judge


def after(count: int, unexplained: float, choice: Choice | None = None) -> Choice:
    """The choice after the same measurement `count` times."""
    choice = choice or Choice()
    for _ in range(count):
        choice = judge(choice, unexplained)
    return choice


@pytest.mark.parametrize(("unexplained", "trusted"), [(0.0, True), (0.01, True), (0.1, False), (1.0, False)])
def test_segmentation_is_followed_while_the_background_is_explained(unexplained: float, trusted: bool) -> None:
    """A quiet background keeps segmentation, one that contradicts its memory ends it."""
    assert after(10, unexplained).trusted is trusted


def test_no_switch_on_the_first_frames() -> None:
    """Two frames are too few to leave segmentation."""
    assert after(2, 1.0).trusted
    assert not after(3, 1.0).trusted


def test_a_constant_is_reported_as_it_is() -> None:
    """The running mean of a constant is the constant."""
    assert after(30, 0.25).unexplained == pytest.approx(0.25)


def test_near_the_limit_the_choice_stays() -> None:
    """Hysteresis: 5 % off the limit switches in neither direction, a clear change in both."""
    assert after(50, UNEXPLAINED_LIMIT * 1.05).trusted
    distrusted = after(10, 0.5)
    assert not after(300, UNEXPLAINED_LIMIT * 0.95, distrusted).trusted
    assert after(300, 0.0, distrusted).trusted


@given(st.lists(st.floats(0, 1), max_size=30))
def test_since_counts_frames_since_the_last_switch(values: list[float]) -> None:
    """`since` restarts at each switch and at no other time."""
    choice = Choice()
    for value in values:
        following = judge(choice, value)
        assert following.since == (choice.since + 1 if following.trusted == choice.trusted else 0)
        choice = following
