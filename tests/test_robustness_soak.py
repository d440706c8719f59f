"""A short soak: memory stays where it was; the long one is ``python -m benchmarks.soak``."""

from __future__ import annotations

import pytest

from benchmarks.soak import soak

GROWTH = 2.0
"""Resident memory that the updates after the first few hundred may add, MB; a frame is 0.02."""


def test_memory_stays_where_it_was() -> None:
    """Tracks, losses and new inits leave nothing behind."""
    soaked = soak(900, restart=90, settled=400)
    assert soaked.final - soaked.settled < GROWTH
    assert len(soaked.tenths) == 10


def test_a_soak_too_short_to_settle_is_refused() -> None:
    """Before memory has settled there is nothing to compare with."""
    with pytest.raises(ValueError, match="1000"):
        soak(1000)
