"""The rule that chooses the mode."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hs_tracker_cv.choice import MISMATCH_LIMIT, STRAY_LIMIT, Choice, judge


def after(count: int, mismatch: float, stray: float, choice: Choice | None = None) -> Choice:
    """The choice after the same measurements `count` times."""
    choice = choice or Choice()
    for _ in range(count):
        choice = judge(choice, mismatch, stray)
    return choice


@pytest.mark.parametrize(
    ("mismatch", "stray", "trusted"),
    [
        (1.5, 0.05, True),  # quiet background, still flow
        (9.0, 0.05, False),  # the background does not explain the frame
        (1.5, 0.9, False),  # the surroundings move with the object
    ],
)
def test_each_measurement_alone_can_withdraw_trust(mismatch: float, stray: float, trusted: bool) -> None:
    """Segmentation is followed only while both are small."""
    assert after(10, mismatch, stray).trusted is trusted


def test_no_switch_on_the_first_frames() -> None:
    """Two frames are too few to leave segmentation."""
    assert after(2, 50.0, 2.0).trusted
    assert not after(3, 50.0, 2.0).trusted


def test_constant_measurements_are_reported_as_they_are() -> None:
    """The running means of constants are the constants."""
    choice = after(30, 2.5, 0.11)
    assert choice.mismatch == pytest.approx(2.5)
    assert choice.stray == pytest.approx(0.11)


def test_near_the_limit_the_choice_stays() -> None:
    """Hysteresis: 3 % over the limit does not switch in either direction."""
    near = (MISMATCH_LIMIT * 1.03 - 0.1, STRAY_LIMIT / 2)
    assert after(50, *near).trusted
    distrusted = after(10, 50.0, 0.05)
    assert not distrusted.trusted
    assert not after(300, MISMATCH_LIMIT * 0.97 - 0.1, STRAY_LIMIT / 2, distrusted).trusted
    assert after(300, 1.0, 0.05, distrusted).trusted


@given(st.lists(st.tuples(st.floats(0, 255), st.floats(0, 1000)), max_size=30))
def test_since_counts_frames_since_the_last_switch(values: list[tuple[float, float]]) -> None:
    """`since` restarts at each switch and at no other time."""
    choice = Choice()
    for value in values:
        following = judge(choice, *value)
        assert following.since == (choice.since + 1 if following.trusted == choice.trusted else 0)
        choice = following
