"""Sequences of the synthetic suites."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from eval.sequences import load_suite
from eval.truthfiles import SequenceError

pytestmark = pytest.mark.once


def test_a_suite_is_rendered_once_and_is_what_the_laboratory_drew() -> None:
    """From the cache come the same bytes, and they are those of ``render``."""
    from datasets_synthetic import SUITES, render

    first, again = load_suite("smoke"), load_suite("smoke")
    assert [sequence.digest for sequence in first] == [sequence.digest for sequence in again]
    assert [sequence.name for sequence in first] == [spec.name for spec in SUITES["smoke"]]
    drawn = render(SUITES["smoke"][0])
    assert_array_equal(np.stack(list(first[0].frames)), drawn.frames)
    assert_array_equal(first[0].boxes, drawn.boxes)
    assert first[0].attributes == tuple(drawn.attributes)


def test_an_unknown_suite_lists_the_known() -> None:
    """The message helps."""
    with pytest.raises(SequenceError, match=r"unknown suite 'smoky'; known: smoke, standard"):
        load_suite("smoky")
