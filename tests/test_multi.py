"""Several objects at once."""

from __future__ import annotations

import copy
import pickle
import re
import types
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest

from hs_tracker_cv import MultiTrackerHS, MultiTrackerHS_create, TrackerHS, TrackerHS_create, legacy
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


def test_a_lost_object_is_a_row_of_zeros_and_the_others_go_on() -> None:
    """One object that is gone makes ok False and leaves the other box where it is; ids may be removed then."""
    frames, boxes = moving_square(np.random.default_rng(3))
    x, y, w, h = boxes[-1]
    multi = MultiTrackerHS_create()
    still = multi.add(TrackerHS_create(), frames[-1], (100, 80, 30, 30))
    gone = multi.add(TrackerHS_create(), frames[-1], boxes[-1])
    empty = frames[-1].copy()
    empty[y : y + h, x : x + w] = frames[0][y : y + h, x : x + w]
    empty[y : y + 20, x : x + 20] = empty[90:110, 5:25]
    rng = np.random.default_rng(4)
    for _ in range(30):
        noisy = np.clip(empty + rng.normal(0, 1.0, empty.shape), 0, 255).astype(np.uint8)
        ok, answers = multi.update(noisy)
    assert not ok
    assert answers[1].tolist() == [0, 0, 0, 0]
    np.testing.assert_allclose(answers[0], (100, 80, 30, 30), atol=3)
    multi.remove(gone)
    assert multi.update(noisy)[0]
    assert list(multi.objects) == [still]


@pytest.mark.parametrize("bad", [np.zeros((60, 80, 3), np.uint8), np.zeros((120, 160), np.uint8), "frame"])
def test_a_frame_of_another_video_changes_nothing(bad: object) -> None:
    """The error of update comes through; all objects are tracked on as if the frame had not come."""
    frames, boxes = moving_square(np.random.default_rng(3))
    multis = [MultiTrackerHS_create(), MultiTrackerHS_create()]
    for multi in multis:
        multi.add(TrackerHS_create(), frames[0], boxes[0])
        multi.add(TrackerHS_create(), frames[0], (100, 80, 30, 30))
        multi.update(frames[1])
    with pytest.raises(InputError, match="expected"):
        multis[0].update(bad)
    assert not multis[0].update(None)[0]
    for frame in frames[2:6]:
        (ok, answers), (expected, boxes_of_all) = (multi.update(frame) for multi in multis)
        assert ok == expected
        np.testing.assert_array_equal(answers, boxes_of_all)


def known(multi: MultiTrackerHS) -> list[Any]:
    """Everything a caller can see of all objects."""
    trackers = multi.objects.values()
    return [
        multi.getObjects().tolist(),
        [(one.state, one.box, one.getTrackingScore(), one.initialised) for one in trackers],
    ]


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize("kind", ["size", "channels"])
def test_objects_of_differing_frames_advance_together_or_not_at_all(kind: str, order: int) -> None:
    """With one object of another video among them every frame is wrong for one: no object takes it in."""
    frames, boxes = moving_square(np.random.default_rng(3))
    others = [frame[:100, :150] if kind == "size" else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in frames]
    multi, alone = MultiTrackerHS_create(), TrackerHS_create()
    for video in (frames, others)[::order]:
        multi.add(TrackerHS_create(), video[0], boxes[0])
    alone.init(frames[0], boxes[0])
    before = known(multi)
    for frame in (frames[4], others[4], frames[5], others[5]):
        with pytest.raises(InputError, match="as given to init"):
            multi.update(frame)
        assert known(multi) == before
    assert not multi.update(None)[0]
    odd = 2 if order == 1 else 1
    with pytest.raises(InputError, match="boundingBox"):
        multi.objects[odd].init(frames[0], (0, 0, 0, 0))
    before = known(multi)
    with pytest.raises(InputError, match="successful init"):
        multi.update(frames[4])
    assert known(multi) == before
    multi.remove(odd)
    for frame in frames[1:5]:
        ok, answers = multi.update(frame)
        assert (ok, tuple(answers[0])) == alone.update(frame)


def test_a_tracker_cannot_follow_two_objects() -> None:
    """Adding it again is refused, and its track goes on."""
    frames, boxes = moving_square(np.random.default_rng(3))
    multi, tracker, alone = MultiTrackerHS_create(), TrackerHS_create(), TrackerHS_create()
    multi.add(tracker, frames[0], boxes[0])
    alone.init(frames[0], boxes[0])
    with pytest.raises(ValueError, match="that of object 1"):
        multi.add(tracker, frames[0], (100, 80, 30, 30))
    assert list(multi.objects) == [1]
    assert tuple(multi.update(frames[1])[1][0]) == alone.update(frames[1])[1]


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda multi: pickle.loads(pickle.dumps(multi))])
def test_copies_go_on_alone(duplicate: Any) -> None:
    """Pickle and deepcopy carry all tracks and ids, and share nothing."""
    frames, boxes = moving_square(np.random.default_rng(3))
    multi = MultiTrackerHS_create()
    for box in (boxes[0], (100, 80, 30, 30)):
        multi.add(TrackerHS_create(), frames[0], box)
    multi.update(frames[1])
    twin = duplicate(multi)
    assert known(twin) == known(multi)
    expected = [multi.update(frame)[1].tolist() for frame in frames[2:5]]
    assert [twin.update(frame)[1].tolist() for frame in frames[2:5]] == expected
    twin.remove(1)
    assert list(multi.objects) == [1, 2]


def test_a_frame_that_one_object_refuses_moves_none() -> None:
    """Objects of videos of two sizes: the error comes before any object has taken the frame in."""
    frames, boxes = moving_square(np.random.default_rng(3))
    multi, alone = MultiTrackerHS_create(), TrackerHS_create()
    first = multi.add(TrackerHS_create(), frames[0], boxes[0])
    alone.init(frames[0], boxes[0])
    other = multi.add(TrackerHS_create(), frames[0][:60], (10, 10, 30, 30))
    before = pickle.dumps(multi.objects[first])
    with pytest.raises(InputError, match="60"):
        multi.update(frames[1])
    assert pickle.dumps(multi.objects[first]) == before
    multi.remove(other)
    assert tuple(multi.update(frames[1])[1][0]) == alone.update(frames[1])[1]


def test_a_dropped_frame_moves_none() -> None:
    """None and an empty image are answered with zeros, and nothing is forgotten."""
    frames, boxes = moving_square(np.random.default_rng(3))
    multi, alone = MultiTrackerHS_create(), TrackerHS_create()
    multi.add(TrackerHS_create(), frames[0], boxes[0])
    alone.init(frames[0], boxes[0])
    for image in (None, np.empty((0, 0, 3), np.uint8)):
        ok, answers = multi.update(image)
        assert not ok
        np.testing.assert_array_equal(answers, [[0, 0, 0, 0]])
    assert tuple(multi.update(frames[1])[1][0]) == alone.update(frames[1])[1]


CV2_TRACKERS = [
    pytest.param(lambda: cv2.TrackerCSRT_create(), id="CSRT"),
    pytest.param(lambda: cv2.TrackerKCF_create(), id="KCF"),
    pytest.param(lambda: cv2.legacy.TrackerMOSSE_create(), id="legacy.MOSSE"),
    pytest.param(lambda: cv2.legacy.TrackerMedianFlow_create(), id="legacy.MedianFlow"),
]


@pytest.mark.parametrize("create", [*CV2_TRACKERS, pytest.param(legacy.TrackerHS_create, id="legacy.TrackerHS")])
def test_any_tracker_can_be_added(create: Callable[[], Any]) -> None:
    """Trackers of OpenCV and the legacy flavour are followed as they are alone, beside ours."""
    frames, boxes = moving_square(np.random.default_rng(3))
    multi, alone, ours = MultiTrackerHS_create(), create(), TrackerHS_create()
    alone.init(frames[0], boxes[0])
    ours.init(frames[0], boxes[0])
    multi.add(create(), frames[0], boxes[0])
    multi.add(TrackerHS_create(), frames[0], boxes[0])
    for frame in frames[1:6]:
        assert not multi.update(None)[0]
        with pytest.raises(InputError, match="160 × 120"):
            multi.update(frame[:60])
        ok, answers = multi.update(frame)
        (found, box), (_, own) = alone.update(frame), ours.update(frame)
        assert ok == found
        assert answers.tolist() == [list(box if found else (0, 0, 0, 0)), list(own)]


@pytest.mark.parametrize(
    "thing", [None, "CSRT", object(), TrackerHS, cv2.TrackerCSRT, TrackerHS_create, types.SimpleNamespace(init=len)]
)
def test_what_is_no_tracker_is_refused_at_once(thing: Any) -> None:
    """A thing without `init` and `update`, or a class instead of one of its objects, is named."""
    frames, boxes = moving_square(np.random.default_rng(3), count=1)
    multi = MultiTrackerHS_create()
    with pytest.raises(TypeError, match="expected a tracker with the methods init and update"):
        multi.add(thing, frames[0], boxes[0])
    assert not multi.objects


def test_a_frame_for_a_tracker_is_named_by_its_shape() -> None:
    """Arguments in another order, as `init` has them: the message says what came, and not its pixels."""
    frames, boxes = moving_square(np.random.default_rng(3), count=1)
    with pytest.raises(TypeError, match=r"init and update, got an array of shape \(\d+, \d+, 3\), uint8$"):
        MultiTrackerHS_create().add(frames[0], TrackerHS_create(), boxes[0])  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("create", "roi", "error"),
    [
        (legacy.TrackerHS_create, (0, 0, 0, 0), InputError),
        (cv2.TrackerCSRT_create, (0, 0, 0, 0), cv2.error),
        (cv2.TrackerKCF_create, (500, 500, 20, 20), cv2.error),
        (lambda: Stubborn(started=False), (1, 2, 3, 4), InputError),
        (lambda: Stubborn(started=RuntimeError("no")), (1, 2, 3, 4), RuntimeError),
    ],
)
def test_a_refusal_by_any_tracker_adds_nothing(create: Callable[[], Any], roi: Any, error: type[Exception]) -> None:
    """False from `init` is an InputError that names the box; an exception comes through; the others go on."""
    frames, boxes = moving_square(np.random.default_rng(3))
    multi, alone = MultiTrackerHS_create(), TrackerHS_create()
    alone.init(frames[0], boxes[0])
    multi.add(TrackerHS_create(), frames[0], boxes[0])
    with pytest.raises(error, match=str(roi[0]) if error is InputError else None):
        multi.add(create(), frames[0], roi)
    for image in (None, "frame", np.zeros((5, 5, 2), np.uint8)):
        with pytest.raises(InputError, match="expected"):
            multi.add(Stubborn(), image, boxes[0])
    assert list(multi.objects) == [1]
    assert tuple(multi.update(frames[1])[1][0]) == alone.update(frames[1])[1]


class Stubborn:
    """A tracker of a user's that answers what it was told to, or raises it."""

    def __init__(self, *answers: Any, started: Any = None) -> None:
        self.answers = list(answers)
        self.started = started

    def init(self, image: Any, box: Any) -> Any:
        """As told."""
        if isinstance(self.started, Exception):
            raise self.started
        return self.started

    def update(self, image: Any) -> Any:
        """As told."""
        answer = self.answers.pop(0)
        if isinstance(answer, Exception):
            raise answer
        return answer


@pytest.mark.parametrize("bad", [cv2.error("assertion"), ZeroDivisionError("0"), (True, None), (True, (1, 2)), None])
@pytest.mark.parametrize("place", [0, 1])
def test_a_tracker_that_fails_takes_no_other_down(bad: Any, place: int) -> None:
    """Its object counts as not located, all others take the frame in, and then its error is heard."""
    frames, boxes = moving_square(np.random.default_rng(3))
    multi, alone = MultiTrackerHS_create(), TrackerHS_create()
    alone.init(frames[0], boxes[0])
    trackers: list[Any] = [TrackerHS_create()]
    trackers.insert(place, Stubborn((True, [5, 6, 7, 8]), bad, (False, (9, 9, 9, 9)), (True, np.full(4, 2.5))))
    for tracker in trackers:
        multi.add(tracker, frames[0], boxes[0])
    for frame, row in zip(frames[1:5], ([5, 6, 7, 8], None, [0, 0, 0, 0], [2.5] * 4), strict=True):
        own = list(alone.update(frame)[1])
        if row is None:
            wrong = not isinstance(bad, Exception)
            with pytest.raises(TypeError if wrong else type(bad), match=re.escape(repr(bad) if wrong else str(bad))):
                multi.update(frame)
            answers = multi.getObjects()
        else:
            ok, answers = multi.update(frame)
            assert ok == any(row)
        assert answers[place].tolist() == (row or [0, 0, 0, 0])
        assert answers[1 - place].tolist() == own
