"""The paper's method stage by stage, on pairs of frames whose motion is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import InputError
from hs_tracker_cv.display import PANELS, draw_layers, draw_panel, tile_panels
from hs_tracker_cv.flow import reference
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.stages import MODES, PaperMethod, StageParams
from tests.conftest import smooth_noise

Image = NDArray[np.uint8]

SEGMENT_IOU = 0.7
"""IoU of a segment with the mover: smoothing spreads what changes by a few px, and both frames are in it."""


def pair(rng: np.random.Generator, *, step: tuple[int, int] = (2, 1)) -> tuple[Image, Image, Box]:
    """A textured square of 40 px that moves over a textured ground; and where it is in the second frame."""
    ground = smooth_noise(rng, 120, 160, 3.0)
    square = smooth_noise(rng, 40, 40)
    frames = []
    for index in range(2):
        frame = ground.copy()
        x, y = 50 + step[0] * index, 40 + step[1] * index
        frame[y : y + 40, x : x + 40] = square
        frames.append(np.rint(frame).astype(np.uint8))
    return frames[0], frames[1], Box(50 + step[0], 40 + step[1], 40, 40)


@pytest.mark.parametrize(("smoothness", "iterations"), [(10.0, 100), (3.0, 7), (40.0, 1)])
def test_classic_is_the_reference_on_the_whole_frame(
    rng: np.random.Generator, smoothness: float, iterations: int
) -> None:
    """Derivatives and flow are the paper's lines in NumPy: from zero, with exactly that λ and that many sweeps."""
    first, second, _ = pair(rng)
    params = StageParams(smoothness=smoothness, iterations=iterations, smoothing=0.0)
    stages = PaperMethod(params).calc(first, second)
    for mine, theirs in zip((stages.Fx, stages.Fy, stages.Ft), reference.derivatives(first, second), strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-4)
    expected = reference.flow(first, second, smoothness, iterations)
    np.testing.assert_allclose(stages.flow, expected, atol=1e-4)


@pytest.mark.parametrize("mode", MODES)
def test_a_still_scene_has_no_flow(rng: np.random.Generator, mode: str) -> None:
    """However textured, nothing moves: not a pixel above the threshold, no segment, no corner, no box."""
    frame = smooth_noise(rng, 90, 120).astype(np.uint8)
    stages = PaperMethod(StageParams.preset(mode)).calc(frame, frame)
    assert not stages.flow.any()
    assert not stages.normal_flow.any()
    assert not stages.moving.any()
    assert not stages.mask.any()
    assert len(stages.corners) == 0
    assert stages.box is None


def test_the_mover_is_segmented_and_boxed(rng: np.random.Generator) -> None:
    """The box of the largest segment is that of the moving square, and the corners lie in it."""
    first, second, truth = pair(rng)
    stages = PaperMethod().calc(first, second)
    assert stages.box is not None
    assert iou(stages.box, truth) > SEGMENT_IOU
    assert len(stages.corners) > 3
    box = stages.box.grown(1.0)
    assert all(box.x <= x <= box.right and box.y <= y <= box.bottom for x, y in stages.corners)
    assert (stages.mask & stages.moving).sum() > 0.5 * stages.moving.sum()


def test_a_larger_frame_is_averaged_down_and_answers_in_its_own_px(rng: np.random.Generator) -> None:
    """Box and corners are frame px whatever the lattice."""
    first, second, truth = pair(rng)
    twice = [cv2.resize(frame, None, fx=2, fy=2, interpolation=cv2.INTER_NEAREST) for frame in (first, second)]
    stages = PaperMethod(StageParams(max_side=160)).calc(*twice)
    assert stages.step == 2.0
    assert stages.current.shape == (120, 160)
    assert stages.box is not None
    assert iou(stages.box, Box(*(2 * side for side in truth))) > SEGMENT_IOU
    assert stages.corners.max() > 160


def test_every_parameter_acts(rng: np.random.Generator) -> None:
    """λ, sweeps, mode and smoothing change the flow; a higher threshold leaves less above it."""
    first, second, _ = pair(rng)
    plain = PaperMethod().calc(first, second)
    for params in (
        StageParams(smoothness=30.0),
        StageParams(iterations=10),
        StageParams(smoothing=3.0),
        *(StageParams.preset(mode) for mode in MODES[1:]),
    ):
        assert np.abs(PaperMethod(params).calc(first, second).flow - plain.flow).max() > 1e-3
    high = PaperMethod(StageParams(threshold=2.0)).calc(first, second)
    assert 0 < high.moving.sum() < plain.moving.sum()


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mode": "fats"}, "mode"),
        ({"smoothness": 0.0}, "smoothness"),
        ({"iterations": 0}, "iterations"),
        ({"smoothing": -1.0}, "smoothing"),
        ({"smoothing": float("nan")}, "smoothing"),
        ({"threshold": 0.0}, "threshold"),
        ({"max_side": 3}, "max_side"),
    ],
)
def test_values_out_of_range_are_named(values: dict[str, float], message: str) -> None:
    """Before anything is computed."""
    with pytest.raises(ValueError, match=message):
        StageParams(**values)  # type: ignore[arg-type]


def test_frames_of_two_sizes_are_refused() -> None:
    """As everywhere in the library."""
    with pytest.raises(InputError, match="one size"):
        PaperMethod().calc(np.zeros((40, 40), np.uint8), np.zeros((40, 50), np.uint8))


@pytest.mark.parametrize("name", PANELS)
@pytest.mark.parametrize("shape", [(120, 160), (64, 33), (1, 1)])
def test_every_panel_is_a_picture_of_the_frames_shape(
    rng: np.random.Generator, name: str, shape: tuple[int, int]
) -> None:
    """Of the width asked for, whatever moves in it."""
    first, second = (rng.integers(0, 255, shape, dtype=np.uint8) for _ in range(2))
    for stages in (PaperMethod().calc(first, second), PaperMethod().calc(first, first)):
        picture, note = draw_panel(name, stages, width=300)
        assert picture.dtype == np.uint8
        assert picture.shape == (max(round(300 * shape[0] / shape[1]), 1), 300, 3)
        assert isinstance(note, str)


def test_panels_show_what_they_say(rng: np.random.Generator) -> None:
    """The mover's pixels are white in the threshold's panel, coloured in the flow's; the ground is not."""
    first, second, truth = pair(rng, step=(2, 0))
    stages = PaperMethod().calc(first, second)
    threshold, _ = draw_panel("threshold", stages, width=160)
    np.testing.assert_array_equal(threshold[..., 0] > 127, stages.moving)
    colours, note = draw_panel("colours", stages, width=160)
    x, y = (round(side) for side in truth.centre)
    blue, green, red = (int(level) for level in colours[y - 8 : y + 8, x - 8 : x + 8].mean(axis=(0, 1)))
    assert red > 200 > blue + 20  # to the right is red
    assert colours[5:20, 5:30].min() > 240
    assert "px per frame" in note
    assert green < red


def test_an_unknown_panel_is_named(rng: np.random.Generator) -> None:
    """With the known ones."""
    stages = PaperMethod().calc(*pair(rng)[:2])
    with pytest.raises(ValueError, match=r"expected one of frame, Fx.*got 'fx'"):
        draw_panel("fx", stages)


def test_layers_part_object_and_ground() -> None:
    """Left the pixels of the mask, right the others, each black where the other is; the frame's edge is black too."""
    frame = np.full((60, 80, 3), 200, np.uint8)
    mask = np.zeros((20, 20), bool)
    mask[5:15, 5:15] = True
    picture = draw_layers(frame, Box(70.0, 10.0, 20.0, 20.0), mask, width=210)
    assert picture.shape == (100, 210, 3)
    left, right = picture[:, :100], picture[:, 110:]
    assert left[50, 40].tolist() == [200] * 3
    assert left[10, 10].tolist() == [0] * 3
    assert right[50, 40].tolist() == [0] * 3
    assert right[10, 10].tolist() == [200] * 3
    assert right[10, 90].tolist() == [0] * 3


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
def test_tiles_hold_every_panel(count: int) -> None:
    """In rows of three, each with its title above; all pictures are there in order."""
    pictures = [np.full((40, 120, 3), 10 * index + 20, np.uint8) for index in range(count)]
    tiled = tile_panels([("Flow · λ", "±", picture) for picture in pictures])
    found = [int(level) for level in np.unique(tiled) if int(level) in {10 * index + 20 for index in range(count)}]
    assert len(found) == count
    assert tiled.shape[1] == min(count, 3) * 130 + 10
