"""Several objects at once."""

from __future__ import annotations

import numpy as np
import pytest

from hs_tracker_cv import MultiTrackerHS_create, TrackerHS_create
from hs_tracker_cv.frames import InputError
from tests.conftest import moving_square


def test_objects_come_and_go() -> None:
    """Each object is tracked as if alone; ids stay; removal leaves the others."""
    frames, boxes = moving_square(np.random.default_rng(3))
    other = (100, 80, 30, 30)
    multi = MultiTrackerHS_create()
    assert multi.update(frames[0])[1].shape == (0, 4)
    first = multi.add(TrackerHS_create(), frames[0], boxes[0])
    alone = TrackerHS_create()
    alone.init(frames[0], boxes[0])
    second = multi.add(TrackerHS_create(), frames[0], other)
    assert first
    assert second
    assert first != second
    for frame in frames[1:4]:
        _, answers = multi.update(frame)
        assert tuple(answers[0]) == alone.update(frame)[1]
    multi.remove(second)
    assert list(multi.objects) == [first]
    assert multi.update(frames[4])[1].shape == (1, 4)
    np.testing.assert_array_equal(multi.getObjects()[0], alone.update(frames[4])[1])
    third = multi.add(TrackerHS_create(), frames[4], other)
    assert third not in (first, second)


def test_a_bad_box_adds_nothing() -> None:
    """The error of init comes through and the set is unchanged."""
    multi = MultiTrackerHS_create()
    with pytest.raises(InputError, match="boundingBox"):
        multi.add(TrackerHS_create(), np.zeros((50, 50), np.uint8), (0, 0, 0, 0))
    assert not multi.objects


def test_unknown_ids_are_named() -> None:
    """Removing twice is a KeyError that lists the ids."""
    with pytest.raises(KeyError, match="no object 5"):
        MultiTrackerHS_create().remove(5)
