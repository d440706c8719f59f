"""Boxes."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hs_tracker_cv.geometry import Box, box_from_mask, iou

pytestmark = pytest.mark.once

coordinates = st.integers(-20, 20)
sizes = st.integers(1, 25)
boxes = st.builds(Box, coordinates, coordinates, sizes, sizes)


def rasterised_iou(a: Box, b: Box) -> float:
    """Slow independent IoU: count pixels."""
    grid = np.zeros((2, 80, 80), dtype=bool)
    for plane, box in zip(grid, (a, b), strict=True):
        plane[int(box.y) + 30 : int(box.bottom) + 30, int(box.x) + 30 : int(box.right) + 30] = True
    return float((grid[0] & grid[1]).sum() / (grid[0] | grid[1]).sum())


@given(boxes, boxes)
def test_iou_equals_pixel_counting(a: Box, b: Box) -> None:
    """IoU of whole-pixel boxes is the ratio of pixel counts, and symmetric."""
    assert iou(a, b) == pytest.approx(rasterised_iou(a, b), abs=1e-12)
    assert iou(a, b) == iou(b, a)


@given(boxes, st.floats(0.1, 10), coordinates, coordinates)
def test_iou_does_not_change_with_place_and_scale(a: Box, factor: float, dx: int, dy: int) -> None:
    """Moving or scaling both boxes alike leaves the IoU."""
    b = a.moved(a.w / 3, a.h / 5)

    def place(box: Box) -> Box:
        return Box(box.x * factor, box.y * factor, box.w * factor, box.h * factor).moved(dx, dy)

    assert iou(place(a), place(b)) == pytest.approx(iou(a, b), abs=1e-9)


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        (Box(-5, 0, 20, 10), Box(0, 0, 15, 10)),  # leaving on the left: shrinks, does not move
        (Box(90, 40, 20, 20), Box(90, 40, 10, 10)),  # leaving at the corner
        (Box(10, 10, 5, 5), Box(10, 10, 5, 5)),  # inside
        (Box(200, 0, 5, 5), Box(200, 0, 0, 5)),  # outside: no area
    ],
)
def test_clip_shrinks_and_never_moves(box: Box, expected: Box) -> None:
    """Clipping keeps the part inside the frame where it was."""
    assert box.clip(100, 50) == expected


@given(boxes, boxes)
def test_union_holds_both_and_intersection_lies_in_both(a: Box, b: Box) -> None:
    """The union contains each box; the intersection is in each."""
    assert a.union(b).intersection(a) == a
    common = a.intersection(b)
    if common.area:
        assert common.intersection(a) == common == common.intersection(b)


@given(boxes)
def test_mask_box_is_the_box_that_drew_the_mask(box: Box) -> None:
    """A filled rectangle gives back its own box."""
    mask = np.zeros((80, 80), dtype=bool)
    moved = box.moved(30, 30)
    mask[int(moved.y) : int(moved.bottom), int(moved.x) : int(moved.right)] = True
    assert box_from_mask(mask) == moved


def test_empty_mask_has_no_box() -> None:
    """No pixel, no box."""
    assert box_from_mask(np.zeros((5, 5), dtype=bool)) is None


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(4, 60), st.floats(4, 60))
def test_rounded_box_is_ints_within_half_a_pixel_per_edge(x: float, y: float, w: float, h: float) -> None:
    """Rounding moves no edge by more than half a pixel."""
    box = Box(x, y, w, h)
    left, top, width, height = box.rounded()
    assert all(type(value) is int for value in (left, top, width, height))
    edges = np.array([left, top, left + width, top + height])
    assert np.abs(edges - [box.x, box.y, box.right, box.bottom]).max() <= 0.5


def test_scaled_and_grown_keep_the_centre() -> None:
    """Size changes are about the centre."""
    box = Box(3, 4, 10, 20)
    assert box.scaled(1.7).centre == pytest.approx(box.centre)
    assert box.grown(3).centre == pytest.approx(box.centre)
