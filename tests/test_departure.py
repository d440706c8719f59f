"""Boxes that stay with the ground when a thin object moves on."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import Box, TrackerHS_create, segmentation
from hs_tracker_cv.frames import as_frame
from hs_tracker_cv.geometry import iou
from hs_tracker_cv.segmentation import SegmentationParams, SegmentationState
from hs_tracker_cv.segmentation.departure import beginning

SIDE, SPEED, COUNT = 44, 3, 40
PARAMS = SegmentationParams()


def _cross(thickness: int) -> NDArray[np.bool_]:
    """A diagonal cross: its box is mostly ground."""
    shape = np.zeros((SIDE, SIDE), np.uint8)
    cv2.line(shape, (0, 0), (SIDE - 1, SIDE - 1), 1, thickness)
    cv2.line(shape, (SIDE - 1, 0), (0, SIDE - 1), 1, thickness)
    return shape.astype(bool)


def _video(seed: int, *, camera: float = 0.0, thickness: int = 5) -> tuple[list[NDArray[np.uint8]], list[Box]]:
    """The cross crosses rough ground; the camera moves to the right."""
    rng = np.random.default_rng(seed)
    ground = cv2.GaussianBlur(rng.uniform(0, 255, (160, 420, 3)).astype(np.float32), (0, 0), 2.0)
    ground = np.clip(128 + 3.0 * (ground - 128), 0, 255).astype(np.uint8)
    own = np.clip(rng.normal(128, 60, (SIDE, SIDE, 3)), 0, 255).astype(np.uint8)
    own, shape = cv2.GaussianBlur(own, (0, 0), 1.0), _cross(thickness)
    frames, boxes = [], []
    for index in range(COUNT):
        left = round(camera * index)
        frame, x = ground[:, left : left + 300].copy(), 30 + SPEED * index - left
        frame[60 : 60 + SIDE, x : x + SIDE][shape] = own[shape]
        frames.append(frame)
        boxes.append(Box(x, 60, SIDE, SIDE))
    return frames, boxes


def _followed(frames: list[NDArray[np.uint8]], box: Box, count: int) -> SegmentationState:
    state = segmentation.start(as_frame(frames[0]), box, PARAMS)
    for frame in frames[1:count]:
        state = segmentation.step(state, as_frame(frame), PARAMS)
    return state


@pytest.mark.parametrize("camera", [0.0, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_the_object_has_left_the_place_it_was_at(seed: int, camera: float) -> None:
    """Once it is a third of its size away; not from where it is, nor from a place beside that."""
    frames, boxes = _video(seed, camera=camera)
    state = _followed(frames, boxes[0], 8)
    assert iou(state.estimate.box, boxes[7]) > 0.7
    assert segmentation.has_left(state, boxes[0].moved(-7 * camera, 0.0))
    assert not segmentation.has_left(state, boxes[7])
    assert not segmentation.has_left(state, boxes[0].moved(SPEED * 5, 0.0))


@pytest.mark.parametrize("seed", range(4))
def test_what_stands_still_has_not_left(seed: int) -> None:
    """Whatever a segment that has gone elsewhere says: what was in the box is still seen there."""
    frames, boxes = _video(seed)
    state = _followed([frames[0]] * 8, boxes[0], 8)
    x, y, w, h = state.box
    astray = state.replace(box=(x + 12.0, y, w, h))
    assert not segmentation.has_left(astray, boxes[0])


@pytest.mark.parametrize("camera", [0.0, 1.0])
@pytest.mark.parametrize("seed", range(4))
def test_a_box_shows_ground_beside_the_object_and_not_where_that_is(seed: int, camera: float) -> None:
    """Of ground that was never seen uncovered, or is out of the window, nothing is told."""
    frames, boxes = _video(seed, camera=camera, thickness=14)
    state, place = _followed(frames, boxes[0], 23), boxes[22]
    assert iou(state.estimate.box, place) > 0.7
    assert segmentation.shows_ground(state, Box(place.x - 12, place.y, 10, SIDE))
    assert segmentation.shows_ground(state, Box(place.right + 2, place.y, 10, SIDE))
    assert not segmentation.shows_ground(state, place)
    assert not segmentation.shows_ground(state, place.moved(200.0, 0.0))
    assert not segmentation.shows_ground(_followed([frames[0]] * 2, boxes[0], 2), boxes[0])


@pytest.mark.parametrize("seed", range(4))
def test_the_place_of_what_has_vanished_shows_the_ground_known_before(seed: int) -> None:
    """In the first frame without the object; after many the memory may be of anything, and tells nothing."""
    frames, boxes = _video(seed, thickness=14)
    empty = as_frame(frames[0])  # the object stands where it began, out of the window
    state = segmentation.step(_followed(frames, boxes[0], 23), empty, PARAMS)
    assert not state.estimate.ok
    assert segmentation.shows_ground(state, boxes[22])
    for _ in range(25):
        state = segmentation.step(state, empty, PARAMS)
    assert not segmentation.shows_ground(state, boxes[22])


def test_nothing_is_known_of_a_departure_without_a_beginning() -> None:
    """After another tracker has led, the way over the ground is not known; a reseeded object begins anew."""
    frames, boxes = _video(1)
    state = _followed(frames, boxes[0], 8)
    watched = segmentation.watch(state, as_frame(frames[8]), boxes[8], PARAMS)
    assert watched.begun is None
    assert not segmentation.has_left(watched, boxes[0])
    fresh = segmentation.reseed(watched, as_frame(frames[8]), boxes[8], PARAMS)
    assert fresh.begun is not None
    assert fresh.begun.centre == boxes[8].centre


def test_the_beginning_is_what_is_in_the_box() -> None:
    """Cut at whole pixels, and at the border of the window; None beyond it."""
    image = np.arange(20 * 30 * 3, dtype=np.float32).reshape(20, 30, 3)
    whole = beginning(image, (105.5, 52.0, 10.0, 8.0), (100, 50))
    assert whole is not None
    np.testing.assert_array_equal(whole.image, image[2:10, 5:16])
    assert (whole.origin, whole.centre) == ((105, 52), (110.5, 56.0))
    part = beginning(image, (95.0, 45.0, 10.0, 8.0), (100, 50))
    assert part is not None
    np.testing.assert_array_equal(part.image, image[:3, :5])
    assert part.origin == (100, 50)
    assert beginning(image, (80.0, 45.0, 10.0, 8.0), (100, 50)) is None


@pytest.mark.parametrize("thickness", [2, 3, 4])
@pytest.mark.parametrize("seed", range(5, 9))
def test_a_thin_cross_is_followed_to_the_end(seed: int, thickness: int) -> None:
    """Most of the drawn box is ground, which the patch tracker would stay with."""
    frames, boxes = _video(seed, thickness=thickness)
    tracker = TrackerHS_create()
    tracker.init(frames[0], tuple(int(side) for side in boxes[0]))
    answers = [tracker.update(frame) for frame in frames[1:]]
    assert all(ok for ok, _ in answers)
    assert np.mean([iou(Box(*box), truth) for (_, box), truth in zip(answers, boxes[1:], strict=True)]) > 0.8
