"""Following whatever moves: objects start, are started anew, keep their identity and end."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from datasets_synthetic.spec import Texture
from hs_tracker_cv import AutomaticTracker, InputError
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.movers import Mover
from tests.moving_scenes import Mover as Drawn
from tests.moving_scenes import Scene, render

COIN, DOTS = Texture("coins", 1.0, None, 3), Texture("dots", 1.0, None, 4)


def _scene(*movers: Drawn, frames: int) -> Scene:
    return Scene(Texture("coffee", 1.0, None, 5), movers, frames=frames, noise=1.0, seed=2)


def _two() -> Scene:
    """Two that cross the frame, the second later; both leave it."""
    one = Drawn("box", (40, 40), (120, 50), (4.0, 0.0), 0.0, 0, COIN)
    two = Drawn("box", (50, 50), (120, 130), (-4.0, 0.0), 0.0, 24, DOTS)
    return replace(_scene(one, two, frames=68), size=(240, 180))


class _Told:
    """A finder that is told what it finds."""

    def __init__(self, movers: dict[int, list[Mover]]) -> None:
        self.movers, self.t, self.fields = movers, -1, None

    def check(self, frame: Any) -> None:
        pass

    def update(self, frame: Any) -> list[Mover]:
        self.t += 1
        return self.movers.get(self.t, [])


def test_all_that_move_are_followed_and_end() -> None:
    """Each has one identity from soon after its start until it has left."""
    scene, tracker = _two(), AutomaticTracker()
    overlaps: dict[int, list[float]] = {1: [], 2: []}
    last: list[int] = []
    for t, frame in enumerate(render(scene)):
        objects = tracker.update(frame)
        last = [each.identity for each in objects]
        for each in objects:
            truth = scene.truth(t)[each.identity - 1]
            if each.ok and truth.w > 30:
                overlaps[each.identity].append(iou(each.box, truth))
    assert all(len(values) > 15 and np.mean(values) > 0.6 for values in overlaps.values())
    assert last == []


def test_one_at_a_time() -> None:
    """With most=1 the second is taken when the first has left, under a new identity."""
    scene, tracker = _two(), AutomaticTracker(most=1)
    seen = [[each.identity for each in tracker.update(frame)] for frame in render(scene)]
    assert all(len(identities) <= 1 for identities in seen)
    order = [identities[0] for identities in seen if identities]
    assert order == sorted(order)
    assert set(order) == {1, 2}


def test_what_was_seized_in_part_is_started_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """When the whole is seen to move with it, the identity stays and the box is that of the whole."""
    scene = _scene(Drawn("box", (80, 60), (80, 120), (3.0, 0.0), 0.0, 0, COIN), frames=30)
    whole = [scene.truth(t)[0] for t in range(30)]
    front = Box.from_edges(whole[4].right - 40, whole[4].y, whole[4].right, whole[4].bottom)
    told = {4: [Mover(front, True, (3.0, 0.0))]}
    told |= {t: [Mover(whole[t], True, (3.0, 0.0))] for t in range(10, 30)}
    tracker = AutomaticTracker()
    monkeypatch.setattr(tracker, "_finder", _Told(told))
    counts = []
    for frame in render(scene):
        objects = tracker.update(frame)
        counts.append([each.identity for each in objects])
    assert counts == [[]] * 4 + [[1]] * 26
    assert iou(objects[0].box, whole[29]) > 0.8


def test_what_overtakes_is_no_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    """A larger mover that passes over a followed one at another pace is not what that was a part of."""
    scene = _scene(Drawn("box", (40, 40), (80, 120), (2.0, 0.0), 0.0, 0, COIN), frames=24)
    told = {t: [Mover(scene.truth(t)[0].scaled(2.0), True, (-6.0, 0.0))] for t in range(12, 24)}
    tracker = AutomaticTracker()
    monkeypatch.setattr(tracker, "_finder", _Told(told | {4: [Mover(scene.truth(4)[0], True, (2.0, 0.0))]}))
    for frame in render(scene):
        objects = tracker.update(frame)
    assert [each.identity for each in objects] == [1]
    assert iou(objects[0].box, scene.truth(23)[0]) > 0.6


def test_a_mover_not_yet_whole_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing is started from a part that is known as one."""
    scene = _scene(frames=4)
    tracker = AutomaticTracker()
    monkeypatch.setattr(
        tracker, "_finder", _Told({t: [Mover(Box(0, 50, 40, 40), False, (3.0, 0.0))] for t in range(4)})
    )
    assert [tracker.update(frame) for frame in render(scene)] == [[]] * 4


def test_dropped_and_wrong_frames_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """None is answered with ok=False; another size is refused, and the object followed on."""
    scene = _scene(Drawn("box", (48, 48), (80, 120), (3.0, 0.0), 0.0, 0, COIN), frames=12)
    tracker = AutomaticTracker()
    for t, frame in enumerate(render(scene)):
        objects = tracker.update(frame)
        if t == 9:
            assert [each.ok for each in tracker.update(None)] == [False]
            with pytest.raises(InputError):
                tracker.update(frame[:-4])
    assert [each.ok for each in objects] == [True]
    assert iou(objects[0].box, scene.truth(11)[0]) > 0.6


@pytest.mark.parametrize("most", [0, -1])
def test_a_number_of_objects_is_at_least_one(most: int) -> None:
    """The error names the value."""
    with pytest.raises(ValueError, match=f"got {most}"):
        AutomaticTracker(most=most)
