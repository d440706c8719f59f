"""Pictures: colours that mean what the legend says, boxes where they belong, panels of one size."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import HornSchunck, PaperMethod, TrackerHS, draw
from hs_tracker_cv.display import draw_box, draw_boxes, flow_colours, nice_scale, render_panels, signed_colours
from hs_tracker_cv.geometry import Box


@dataclass(frozen=True)
class _Fields:
    window: Box
    step: float
    current: NDArray[np.float32]
    Fx: NDArray[np.float32]
    Fy: NDArray[np.float32]
    Ft: NDArray[np.float32]
    flow: NDArray[np.float32]
    normal_flow: NDArray[np.float32]
    mask: NDArray[np.bool_] | None


def _fields(height: int = 30, width: int = 40, *, mask: bool = True) -> _Fields:
    rng = np.random.default_rng(3)
    plane = [rng.normal(0, 10, (height, width)).astype(np.float32) for _ in range(3)]
    flow = rng.normal(0, 1, (height, width, 2)).astype(np.float32)
    inside = np.zeros((height, width), bool)
    inside[height // 4 : height // 2, width // 4 : width // 2] = True
    return _Fields(Box(10, 5, width, height), 1.0, np.abs(plane[0]), *plane, flow, flow * 2, inside if mask else None)


def test_signed_map_is_gray_at_zero_and_opposite_at_the_ends() -> None:
    """Zero and NaN are mid gray, positive is orange, negative is blue, beyond the scale nothing changes."""
    colours = signed_colours(np.array([[0.0, np.nan, 2.0, 9.0, -2.0, -np.inf]]), 2.0)[0].astype(int)
    assert np.ptp(colours[0]) == 0
    assert 90 < colours[0, 0] < 150
    np.testing.assert_array_equal(colours[0], colours[1])
    assert colours[2, 2] > colours[2, 0] + 80
    assert colours[4, 0] > colours[4, 2] + 80
    np.testing.assert_array_equal(colours[2], colours[3])
    np.testing.assert_array_equal(colours[4], colours[5])


@pytest.mark.parametrize(
    ("flow", "colour"),
    [
        ((0.0, 0.0), (255, 255, 255)),  # no motion is white
        ((1.0, 0.0), (0, 0, 255)),  # right is red
    ],
)
def test_flow_wheel_has_middleburys_anchors(flow: tuple[float, float], colour: tuple[int, int, int]) -> None:
    """The wheel's published anchor colours (BGR) come out exactly."""
    np.testing.assert_array_equal(flow_colours(np.array([[flow]]), 1.0)[0, 0], colour)


def test_flow_hue_is_direction_and_saturation_is_speed() -> None:
    """Half the speed is half way to white; opposite directions differ strongly."""
    angles = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=1)[None]
    full, half = flow_colours(rim, 1.0).astype(int), flow_colours(rim * 0.5, 1.0).astype(int)
    np.testing.assert_allclose(half, (full + 255) / 2, atol=1.0)
    np.testing.assert_allclose(full, flow_colours(rim * (1 + 1e-12), 1.0).astype(int), atol=1.0)
    assert np.abs(full[0, :12] - full[0, 12:]).sum(axis=1).min() > 150


@pytest.mark.parametrize(
    ("peak", "scale"), [(0.0, 0.5), (0.7, 1.0), (1.0, 1.0), (1.01, 2.0), (3.0, 5.0), (51.0, 100.0)]
)
def test_scale_is_rounded_up_to_1_2_5(peak: float, scale: float) -> None:
    """The full scale never lies below the values and takes few distinct values."""
    assert nice_scale(np.full((4, 4), -peak), floor=0.5) == pytest.approx(scale)


def test_box_is_drawn_round_the_pixels_it_holds_on_a_copy() -> None:
    """The outline lies on the box's edge, the inside stays as it was, the input is not written to."""
    frame = np.full((100, 120, 3), 50, np.uint8)
    frame.flags.writeable = False
    picture = draw_box(frame, Box(30, 40, 20, 10))
    changed = np.argwhere((picture != 50).any(axis=2))
    assert abs(changed - np.array([[40, 30]])).min(axis=0).max() <= 1
    assert changed.min(axis=0).tolist() == pytest.approx([40, 30], abs=1)
    assert changed.max(axis=0).tolist() == pytest.approx([50, 50], abs=1)
    assert (picture[42:48, 33:47] == 50).all()


def test_lost_is_visible_without_a_box() -> None:
    """A lost tracker frames the picture in red and writes the word; a tracking one does neither."""
    frame = np.zeros((100, 160, 3), np.uint8)
    lost, tracking = draw_box(frame, None, state="lost"), draw_box(frame, None, state="tracking")
    assert (lost[0, :, 2] > 200).all()
    assert lost[5:30, 5:80].any()
    assert not tracking.any()


@pytest.mark.parametrize("shape", [(60, 80), (60, 80, 1), (60, 80, 3), (60, 80, 4)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_any_frame_of_cv2_can_be_drawn_on(shape: tuple[int, ...], dtype: type) -> None:
    """Gray, BGR and BGRA frames of every depth give a BGR picture, also with a box that leaves the frame."""
    frame = np.ones(shape, dtype)
    picture = draw_box(frame, Box(-20, 50, 300, 80), state="occluded", score=0.5, note="frame 1")
    assert picture.shape == (60, 80, 3)
    assert picture.dtype == np.uint8


def test_panels_have_one_size_whatever_there_is_to_show() -> None:
    """Size depends on the frame and the tile width only: with fields, without, any window, no mask, no box."""
    frame = np.full((120, 160, 3), 90, np.uint8)
    box = Box(20, 15, 12, 10)
    pictures = [
        render_panels(frame, _fields(), box, score=0.5, note="frame 3"),
        render_panels(frame, _fields(7, 90, mask=False), None, state="lost", score=0.0),
        render_panels(frame, _fields(90, 7), box),
        render_panels(frame, _fields(1, 1, mask=False), box),
        render_panels(frame, None, None, state="searching"),
    ]
    assert {picture.shape for picture in pictures} == {pictures[0].shape}
    assert all(picture.dtype == np.uint8 for picture in pictures)


def test_still_fields_give_neutral_panels() -> None:
    """Where nothing moves, the derivative panels are mid gray and the coloured flow is white."""
    zero, none = np.zeros((30, 40), np.float32), np.zeros((30, 40, 2), np.float32)
    still = _Fields(Box(0, 0, 40, 30), 1.0, zero, zero, zero, zero, none, none, zero > 0)
    picture = render_panels(np.zeros((120, 160, 3), np.uint8), still, None)
    half, quarter = picture.shape[0] // 2, picture.shape[1] // 4
    np.testing.assert_array_equal(picture[half // 2, quarter + quarter // 2], signed_colours(zero, 1.0)[0, 0])
    np.testing.assert_array_equal(picture[half + half // 2, quarter + quarter // 2], (255, 255, 255))


def test_mask_panel_lights_the_mask() -> None:
    """Inside the mask the window keeps its brightness and takes a tint, outside it is darkened."""
    bright = np.full((30, 40), 200, np.float32)
    zero, none = np.zeros((30, 40), np.float32), np.zeros((30, 40, 2), np.float32)
    mask = np.zeros((30, 40), bool)
    mask[:, :20] = True
    fields = _Fields(Box(0, 0, 40, 30), 1.0, bright, zero, zero, zero, none, none, mask)
    picture = render_panels(np.zeros((120, 160, 3), np.uint8), fields, None)
    row, quarter = picture.shape[0] * 3 // 4, picture.shape[1] // 4
    left, right = picture[row, 3 * quarter + quarter // 5, 0], picture[row, 3 * quarter + quarter * 4 // 5, 0]
    assert left > 190
    assert right < 120


def test_draw_shows_the_panels_asked_for() -> None:
    """In a grid, each of the width asked for; misspelt ones are refused, and so is none."""
    frames = [np.full((48, 64), 60, np.uint8) for _ in range(2)]
    frames[0][20:30, 20:30], frames[1][20:30, 22:32] = 200, 200
    stages = PaperMethod().calc(*frames)
    one = draw(stages, ["Fx"], width=100)
    two = draw(stages, ["Fx", "normal"], width=100, columns=2)
    assert two.shape[0] == one.shape[0]
    assert two.shape[1] > 1.9 * 100
    assert draw(stages, ["Fx", "normal"], width=100, columns=1).shape[0] > 1.9 * one.shape[0] - 20
    with pytest.raises(ValueError, match="got 'Fz'"):
        draw(stages, ["Fz"])
    with pytest.raises(ValueError, match="got none"):
        draw(stages, [])


def test_draw_takes_what_a_tracker_saw() -> None:
    """Its window has neither a threshold nor corners, and who asks for them is told what there is."""
    shown = draw(_fields(), width=100, columns=8)
    assert shown.shape[1] > 8 * 100
    two = draw(_fields(), ["Fx", "segmentation"], width=100)
    assert 2 * 100 < two.shape[1] < 3 * 100
    with pytest.raises(ValueError, match=r"frame, Fx, .*, segmentation, got 'corners'"):
        draw(_fields(), ["Fx", "corners"])


def test_no_label_is_written_over_another() -> None:
    """Boxes at one place and under the note: of each label as many pixels are seen as where it is alone."""
    ground = np.full((240, 320, 3), 120, np.uint8)
    boxes = [
        Box(100, 100, 60, 40),
        Box(100, 100, 60, 40),
        Box(104, 96, 60, 44),
        Box(3, 3, 60, 40),
        Box(97, 103, 66, 41),
    ]
    colours = [(255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (0, 255, 255)]
    # On a dark plate that nothing else has touched, a letter's pixel is a mixture of its colour and a quarter of 120.
    labelled = [(box, colour, "88") for box, colour in zip(boxes, colours, strict=True)]
    together = draw_boxes(ground, labelled, notes=[("frame 8", (255, 0, 255))])
    for colour in colours:
        alone = draw_boxes(ground, [(Box(250, 180, 1, 1), colour, "88")])
        plate = alone[150:179, 240:300]
        assert _count(together, colour) >= _count(plate, colour) > 10


def _count(picture: NDArray[np.uint8], colour: tuple[int, int, int]) -> int:
    """Pixels of a colour, hardly mixed: of letters. Lines lie between pixels; OpenCV 4 mixes all a little."""
    return int((np.abs(picture.astype(int) - np.array(colour)).max(axis=2) <= 8).sum())


def test_results_display_themselves_in_jupyter() -> None:
    """As PNG, which decodes to a picture in which something is drawn."""
    rng = np.random.default_rng(3)
    frames = [rng.integers(0, 255, (64, 96, 3), dtype=np.uint8)]
    frames.append(np.roll(frames[0], 1, axis=1))
    tracker = TrackerHS()
    tracker.init(frames[0], (30, 20, 24, 24))
    tracker.update(frames[1])
    solver = HornSchunck()
    solver.estimate(frames[0])
    for result in (PaperMethod().calc(*frames), tracker.debug(), solver.estimate(frames[1])):
        data = np.frombuffer(result._repr_png_(), np.uint8)
        assert cv2.imdecode(data, cv2.IMREAD_COLOR).std() > 5.0
