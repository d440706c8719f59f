"""A short soak: memory stays where it was; the long one is ``python -m benchmarks.soak``."""

from __future__ import annotations

import pytest

from benchmarks.soak import SETTLED, soak

GROWTH = 2.0
"""Resident memory that two thousand updates may add, MB."""


def test_two_thousand_updates_take_no_more_memory_than_one_thousand() -> None:
    """Tracks, losses and new inits leave nothing behind."""
    soaked = soak(2 * SETTLED, restart=100)
    assert soaked.final - soaked.settled < GROWTH
    assert len(soaked.tenths) == 10


def test_a_soak_too_short_to_settle_is_refused() -> None:
    """Before the first thousand updates there is nothing to compare with."""
    with pytest.raises(ValueError, match="1000"):
        soak(SETTLED)
