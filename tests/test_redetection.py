"""Something new in the colours of the object, anywhere in the frame."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import TrackerHS, TrackerHS_create, redetection, segmentation
from hs_tracker_cv.frames import as_frame
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.redetection import Scene, Target

RED, BLUE, GREEN = (30, 40, 220), (220, 60, 30), (40, 170, 40)
SIDE = 40
SIZE = (240, 320)


def ground(seed: int = 0) -> NDArray[np.uint8]:
    """Gray noise."""
    gray = np.random.default_rng(seed).integers(90, 140, (*SIZE, 1))
    return np.repeat(gray, 3, axis=2).astype(np.uint8)


def scene_with(box: Box | None, colour: tuple[int, int, int] = RED) -> NDArray[np.uint8]:
    """The ground with a rectangle of one colour on it."""
    picture = ground()
    if box is not None:
        x0, y0, x1, y1 = (max(int(edge), 0) for edge in (box.x, box.y, box.right, box.bottom))
        picture[y0:y1, x0:x1] = colour
    return picture


def known(colour: tuple[int, int, int] = RED) -> Target:
    """A target of one colour, described by segmentation after `init`."""
    box = Box(100, 80, SIDE, SIDE)
    state = segmentation.start(as_frame(scene_with(box, colour)), box, segmentation.SegmentationParams())
    target = redetection.target_of(state, None)
    assert target is not None
    return target


def empty_scene(target: Target | None = None) -> Scene:
    """The ground alone, as remembered when the object was lost."""
    scene = redetection.scene_without(as_frame(scene_with(None)), target or known())
    assert scene is not None
    return scene


@pytest.mark.parametrize("x", [0, 33, 151, 280])
@pytest.mark.parametrize("y", [0, 97, 200])
def test_the_object_is_seen_wherever_it_is(x: int, y: int) -> None:
    """The box of what is seen is right to a sample on each side, and all of the object is seen."""
    box = Box(x, y, SIDE, SIDE)
    seen = redetection.find(empty_scene(), as_frame(scene_with(box)))
    assert seen is not None
    assert seen.share > 0.8
    step = empty_scene().step
    edges = zip((seen.box.x, seen.box.y, seen.box.right, seen.box.bottom), (x, y, x + SIDE, y + SIDE), strict=True)
    assert all(abs(one - other) <= step for one, other in edges)


@pytest.mark.parametrize(("inside", "low", "high"), [(12, 0.15, 0.45), (24, 0.4, 0.8), (36, 0.7, 1.0)])
def test_a_part_is_seen_and_called_a_part(inside: int, low: float, high: float) -> None:
    """An object that comes in over the border is seen by what is inside, and its share grows."""
    seen = redetection.find(empty_scene(), as_frame(scene_with(Box(inside - SIDE, 90, SIDE, SIDE))))
    assert seen is not None
    assert low <= seen.share <= high
    assert seen.box.x == 0
    assert abs(seen.box.right - inside) <= empty_scene().step


@pytest.mark.parametrize("colour", [BLUE, GREEN, (128, 128, 128)])
def test_something_else_is_not_the_object(colour: tuple[int, int, int]) -> None:
    """Another colour is new, but it is not the object's; and a box round it is foreign."""
    box = Box(200, 100, SIDE, SIDE)
    frame = as_frame(scene_with(box, colour))
    assert redetection.find(empty_scene(), frame) is None
    assert redetection.is_foreign(empty_scene(), frame, box)


def test_what_was_there_before_is_not_new() -> None:
    """Something in the object's colours that stood there when the object was lost is no sighting."""
    other = scene_with(Box(200, 100, 20, 20))
    scene = redetection.scene_without(as_frame(other), known())
    assert scene is not None
    assert redetection.find(scene, as_frame(other)) is None


def test_the_object_is_not_foreign_whether_it_is_new_or_not() -> None:
    """A box round the object is its own, also where the remembered scene has it already."""
    box = Box(60, 60, SIDE, SIDE)
    frame = as_frame(scene_with(box))
    assert not redetection.is_foreign(empty_scene(), frame, box)
    with_it = redetection.scene_without(frame, known())
    assert with_it is not None
    assert not redetection.is_foreign(with_it, frame, box)
    assert redetection.is_foreign(empty_scene(), as_frame(scene_with(None)), box)


def test_nothing_is_concluded_when_all_has_changed() -> None:
    """After a turn of the camera nothing is sighted and nothing is called foreign."""
    box = Box(60, 60, SIDE, SIDE)
    turned = as_frame(255 - scene_with(box, GREEN))
    assert redetection.find(empty_scene(), turned) is None
    assert not redetection.is_foreign(empty_scene(), turned, box)


def test_no_scene_for_an_object_in_the_colours_of_the_ground() -> None:
    """Colours that do not tell object and ground apart are not relied on."""
    gray = known((115, 115, 115))
    assert redetection.scene_without(as_frame(scene_with(None)), gray) is None


def test_a_small_object_in_a_large_frame_is_not_looked_for() -> None:
    """The number of samples is bounded; an object between them cannot be seen."""
    target = known()._replace(extent=(8.0, 8.0, 64.0))
    assert redetection.scene_without(as_frame(np.full((2160, 3840, 3), 110, np.uint8)), target) is None
    scene = redetection.scene_without(as_frame(np.full((2160, 3840, 3), 110, np.uint8)), known())
    assert scene is None or scene.samples.size <= 3 * 31_000


def test_a_target_shrinks_slowly_and_does_not_change_its_colours_at_once() -> None:
    """What is remembered of an object survives its going out of sight and a mistake."""
    target = known()
    box = Box(100, 80, 10, SIDE)
    frame = as_frame(scene_with(box))
    thinner = redetection.target_of(segmentation.start(frame, box, segmentation.SegmentationParams()), target)
    assert thinner.extent[0] == pytest.approx(0.98 * target.extent[0])
    other = segmentation.start(
        as_frame(scene_with(Box(100, 80, SIDE, SIDE), BLUE)), box, segmentation.SegmentationParams()
    )
    assert redetection.target_of(other, target) is target


# --- in the tracker ------------------------------------------------------------------------------------------


def away_and_back(
    colour_back: tuple[int, int, int], at: tuple[int, int]
) -> list[tuple[NDArray[np.uint8], Box | None]]:
    """A striped square moves, is gone for twelve frames, and stands somewhere else in some colour."""
    truth: list[Box | None] = [Box(60 + 3 * k, 60 + k, SIDE, SIDE) for k in range(30)]
    truth += [None] * 12 + [Box(*at, SIDE, SIDE)] * 12
    video: list[tuple[NDArray[np.uint8], Box | None]] = []
    for number, box in enumerate(truth):
        picture = scene_with(box, RED if number < 30 else colour_back)
        if box is not None:
            x, y = int(box.x), int(box.y)
            picture[y : y + SIDE : 4, x : x + SIDE] //= 2
        video.append((picture, box))
    return video


def followed(tracker: TrackerHS, video: list[tuple[NDArray[np.uint8], Box | None]]) -> list[tuple[bool, Any]]:
    """Answers of the tracker to all frames but the first."""
    tracker.init(video[0][0], tuple(video[0][1] or ()))
    return [tracker.update(frame) for frame, _ in video[1:]]


def test_an_object_that_comes_back_far_away_is_found_at_once() -> None:
    """False while it is gone, True from the second frame of its return, although that is across the frame."""
    video = away_and_back(RED, (230, 170))
    answers = followed(TrackerHS_create(), video)
    gone = [ok for (ok, _), (_, box) in zip(answers, video[1:], strict=True) if box is None]
    assert not any(gone)
    back = answers[-11:]
    assert all(ok for ok, _ in back)
    assert iou(Box(*back[-1][1]), Box(230, 170, SIDE, SIDE)) > 0.7


def test_another_object_is_not_taken_for_it() -> None:
    """What comes instead in another colour is answered with False."""
    answers = followed(TrackerHS_create(), away_and_back(BLUE, (230, 170)))
    assert not any(ok for ok, _ in answers[-24:])


def test_a_copy_made_during_the_search_goes_on_alike() -> None:
    """What is remembered of the scene travels with a pickled tracker."""
    video = away_and_back(RED, (20, 180))
    tracker = TrackerHS_create()
    tracker.init(video[0][0], tuple(video[0][1] or ()))
    for frame, _ in video[1:38]:
        tracker.update(frame)
    other = pickle.loads(pickle.dumps(tracker))
    assert [tracker.update(frame) for frame, _ in video[38:]] == [other.update(frame) for frame, _ in video[38:]]


def test_an_object_without_a_shape_is_not_described() -> None:
    """Gone as soon as it was drawn, it has left no pixel to be known by: what was known stays, even nothing."""
    box = Box(100, 80, SIDE, SIDE)
    state = segmentation.start(as_frame(scene_with(box)), box, segmentation.SegmentationParams())
    shapeless = state.replace(shape=np.zeros_like(state.shape))
    assert redetection.target_of(shapeless, None) is None
    before = known()
    assert redetection.target_of(shapeless, before) is before
