"""Masks and rotated boxes: overlaps worked out on paper, a slow oracle, texts that come back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from datasets_synthetic import SUITES, render
from eval.metrics import frame_scores, summarise
from eval.regions import (
    Mask,
    box_polygon,
    mask_of_polygons,
    mask_of_runs,
    outlines,
    polygon_text,
    read_region,
    region_box,
    region_iou,
)  # fmt: skip
from eval.sequences import from_spec

SIZE = (64, 48)
MASKS = st.tuples(
    st.integers(-6, 40), st.integers(-6, 30), st.integers(1, 12), st.integers(1, 12), st.integers(0, 999)
)


def blob(x: int, y: int, width: int, height: int, seed: int) -> Mask:
    """Any pixels."""
    return Mask(x, y, np.random.default_rng(seed).random((height, width)) < 0.6)


def turned(x: float, y: float, w: float, h: float, degrees: float) -> NDArray[np.float64]:
    """Corners of a box turned about its centre."""
    angle = math.radians(degrees)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    return np.array([[-w, -h], [w, -h], [w, h], [-w, h]]) / 2 @ turn.T + [x, y]


def painted(mask: Mask, size: tuple[int, int] = SIZE) -> NDArray[np.bool_]:
    """The mask in its frame."""
    inside = mask.within(size)
    found = np.zeros((size[1], size[0]), dtype=bool)
    height, width = inside.pixels.shape
    found[inside.y : inside.y + height, inside.x : inside.x + width] = inside.pixels
    return found


@given(MASKS, MASKS)
def test_masks_overlap_as_their_pixels_do(first: tuple[int, ...], second: tuple[int, ...]) -> None:
    """Counted in the whole frame; a mask overlaps with itself entirely if there is any of it."""
    one, other = blob(*first), blob(*second)
    common, union = painted(one) & painted(other), painted(one) | painted(other)
    expected = common.sum() / union.sum() if painted(one).any() and painted(other).any() else 0.0
    assert region_iou(one, other, SIZE) == pytest.approx(expected, abs=1e-12)
    assert region_iou(one, one, SIZE) == float(painted(one).any())


@given(MASKS, st.tuples(*[st.floats(-5, 45)] * 2, *[st.floats(0.5, 30)] * 2), st.floats(0, 180))
def test_a_mask_and_a_box_overlap_as_finer_pixels_do(
    pixels: tuple[int, ...], box: tuple[float, ...], degrees: float
) -> None:
    """Points at 8 × 8 places of each pixel, counted; upright boxes take a way of their own."""
    mask, (x, y, w, h) = blob(*pixels), box
    inside = np.kron(painted(mask), np.ones((8, 8), dtype=bool))
    rows, columns = (np.indices(inside.shape) + 0.5) / 8
    for polygon, angle in ((box_polygon(box), 0.0), (turned(x + w / 2, y + h / 2, w, h, degrees), degrees)):
        along = math.cos(math.radians(angle)), math.sin(math.radians(angle))
        dx, dy = columns - x - w / 2, rows - y - h / 2
        within = (abs(dx * along[0] + dy * along[1]) <= w / 2) & (abs(dy * along[0] - dx * along[1]) <= h / 2)
        union = (inside | within).sum()
        expected = (inside & within).sum() / union if inside.any() and within.any() else 0.0
        assert region_iou(mask, polygon, SIZE) == pytest.approx(expected, abs=0.06)
        assert region_iou(polygon, mask, SIZE) == region_iou(mask, polygon, SIZE)


@pytest.mark.parametrize(
    ("first", "second", "expected"),
    [
        (turned(20, 20, 10, 10, 45), turned(20, 20, 10, 10, 45), 1.0),
        (turned(20, 20, 10, 10, 45), box_polygon((20 - 50**0.5, 20 - 50**0.5, 200**0.5, 200**0.5)), 0.5),
        (turned(20, 20, 10, 10, 45), box_polygon((15, 15, 10, 10)), 2**-0.5),
        (turned(20, 20, 10, 4, 90), box_polygon((18, 15, 4, 10)), 1.0),
        (turned(20, 20, 10, 10, 45), box_polygon((40, 20, 10, 10)), 0.0),
        (box_polygon((-5, 10, 10, 10)), box_polygon((0, 10, 5, 10)), 1.0),
        (turned(20, 20, 10, 10, 45)[::-1], turned(20, 20, 10, 10, 45), 1.0),
        (Mask(10, 10, np.ones((4, 4), dtype=bool)), box_polygon((10.5, 10, 4, 4)), 14 / 18),
        (Mask(10, 10, np.tri(4, dtype=bool)), turned(12, 12, 32**0.5, 32**0.5, 45), 10 / 32),
        (Mask(70, 10, np.ones((4, 4), dtype=bool)), box_polygon((10, 10, 4, 4)), 0.0),
    ],
    ids=["itself", "its box", "octagon", "upright", "apart", "cut", "other way round", "half", "in it", "outside"],
)
def test_overlaps_on_paper(first: Mask | NDArray[np.float64], second: NDArray[np.float64], expected: float) -> None:
    """A square and its turned twin share an octagon: 2^½ − 1 of the square's area twice over makes 2^-½."""
    assert region_iou(first, second, SIZE) == pytest.approx(expected, abs=1e-12)


@given(MASKS)
def test_texts_of_masks_come_back(pixels: tuple[int, ...]) -> None:
    """As VOT writes them; the window is cut to what is in it, and no pixel is no text."""
    mask = blob(*pixels)
    if not mask.pixels.any():
        assert mask.text == ""
        return
    found = read_region(mask.text)
    assert isinstance(found, Mask)
    assert found.text == mask.text
    np.testing.assert_array_equal(painted(found), painted(mask))
    assert region_box(found) == region_box(mask) == (found.x, found.y, *found.pixels.shape[::-1])


def test_texts_on_paper() -> None:
    """Two pixels outside, three inside, one outside."""
    mask = mask_of_runs(10, 20, 3, 2, [2, 3, 1])
    assert mask.pixels.tolist() == [[False, False, True], [True, True, False]]
    assert mask.text == "m10,20,3,2,2,3,1"
    assert polygon_text([0.1, 2, 3, 4, 5, 6, 7, 8]) == "0.1,2.0,3.0,4.0,5.0,6.0,7.0,8.0"
    assert region_box(read_region("0,5,5,0,10,5,5,10")) == (0, 0, 10, 10)
    for text in ("1,2,3,4", "m1,2,3,4,13", "m1,2", "1,2,3,4,5,6,7,nan", "m1,2,3,4,x"):
        with pytest.raises(ValueError, match=r"expected|invalid|unpack"):
            read_region(text)


def test_a_polygon_has_the_pixels_whose_middle_is_inside() -> None:
    """Several are one mask; a box of whole pixels is itself, and what is thinner than a pixel may be nothing."""
    corners = [2.6, 1.0, 6.0, 1.0, 6.0, 3.4, 2.6, 3.4]
    np.testing.assert_array_equal(
        np.argwhere(painted(mask_of_polygons([corners]))), [(1, 3), (1, 4), (1, 5), (2, 3), (2, 4), (2, 5)]
    )
    for box in ((10, 20, 5, 4), (-3, -2, 9, 6)):
        assert (
            mask_of_polygons([box_polygon(box).ravel()]).text
            == Mask(box[0], box[1], np.ones((box[3], box[2]), dtype=bool)).text
        )
    both = mask_of_polygons([box_polygon((1, 1, 2, 2)).ravel(), box_polygon((2, 2, 4, 1)).ravel()])
    assert (both.pixels.sum(), region_box(both)) == (7, (1.0, 1.0, 5.0, 2.0))
    assert mask_of_polygons([[1.1, 1, 1.3, 1, 1.3, 9]]).text == mask_of_polygons([]).text == ""
    for wrong in (
        [[1.0, 2, 3, 4]],
        [[1.0, 2, 3, 4, 5, 6, 7]],
        [[1.0, 2, 3, 4, 5, np.nan]],
        [[0.0, 0, 1e9, 0, 0, 1e9]],
    ):
        with pytest.raises(ValueError, match="expected x, y of three corners or more, got"):
            mask_of_polygons(wrong)


@given(st.tuples(st.integers(0, 8), st.integers(0, 8)))
def test_polygons_that_share_an_edge_share_no_pixel(middle: tuple[int, int]) -> None:
    """A square cut into four triangles about a point is the square, also where the edges run through middles."""
    square = [(0.5, 0.5), (8.5, 0.5), (8.5, 8.5), (0.5, 8.5)]
    centre = (middle[0] + 0.5, middle[1] + 0.5)
    parts = [
        painted(mask_of_polygons([np.ravel([first, second, centre])]))
        for first, second in zip(square, [*square[1:], square[0]], strict=True)
    ]
    np.testing.assert_array_equal(np.sum(parts, axis=0), painted(mask_of_polygons([np.ravel(square)])))
    assert painted(mask_of_polygons([np.ravel(square)])).sum() == 64


def test_lines_round_a_region_enclose_it() -> None:
    """Through the middles of its outermost pixels, in the picture's own pixels."""
    (line,) = outlines(Mask(10, 20, np.ones((4, 6), dtype=bool)), 2.0)
    assert (line.min(axis=0).tolist(), line.max(axis=0).tolist()) == ([21, 41], [31, 47])
    (corners,) = outlines(turned(20, 20, 10, 10, 45), 2.0)
    assert corners.tolist() == [[40, 26], [54, 40], [40, 54], [26, 40]]


def test_frames_are_scored_by_what_the_truth_is() -> None:
    """A mask, a rotated box, a box, and a mask answered with False; the answer is a region where there is one."""
    boxes = np.array([[10, 10, 10, 10]] * 7, dtype=np.float64)
    diamond = polygon_text(turned(15, 15, 50**0.5, 50**0.5, 45).ravel())
    mask = Mask(10, 10, np.tri(10, dtype=bool)).text
    truths = ["", mask, diamond, "", mask, mask, diamond]
    answers = ["", "", "", diamond, mask, mask, diamond]
    ok = np.array([True, True, True, True, False, True, True])
    scores = frame_scores(boxes, np.ones(7), boxes, ok, SIZE, true_regions=truths, regions=answers)
    np.testing.assert_allclose(scores.mask_iou, [0.55, np.nan, np.nan, 0.0, 1.0, np.nan])
    np.testing.assert_allclose(scores.rotated_iou, [np.nan, 0.5, np.nan, np.nan, np.nan, 1.0])
    found = summarise(scores)
    assert (found["mask_iou"], found["rotated_iou"]) == (pytest.approx(1.55 / 3), pytest.approx(0.75))
    plain = summarise(frame_scores(boxes, np.ones(7), boxes, ok, SIZE))
    assert math.isnan(plain["mask_iou"])
    assert math.isnan(plain["rotated_iou"])
    with pytest.raises(ValueError, match=r"one length, got \[2, 7\]"):
        frame_scores(boxes, np.ones(7), boxes, ok, SIZE, true_regions=truths[:2])


def test_a_drawn_sequence_knows_its_masks() -> None:
    """The pixels that the laboratory renders as the target's, none where it is hidden."""
    spec = SUITES["smoke"][3]
    rendered, sequence = render(spec), from_spec(spec)
    size = rendered.frames.shape[2], rendered.frames.shape[1]
    assert len(sequence.regions) == len(rendered)
    for text, mask in zip(sequence.regions, rendered.masks, strict=True):
        region = read_region(text) if text else Mask(0, 0, np.zeros((0, 0), dtype=bool))
        assert isinstance(region, Mask)
        np.testing.assert_array_equal(painted(region, size), mask)
