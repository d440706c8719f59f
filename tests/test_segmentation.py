"""The two-layer model on sequences whose truth is constructed here."""

from __future__ import annotations

import copy
import dataclasses
import pickle
import threading
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import segmentation
from hs_tracker_cv._native.kernels import segmentation as kernels
from hs_tracker_cv.frames import Frame, as_frame
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.segmentation.window import grab, shifted, transformed, translated

PARAMS = segmentation.SegmentationParams()
HEIGHT, WIDTH = 150, 220


def texture(
    height: int, width: int, seed: int, colour: tuple[int, int, int] = (105, 110, 115), contrast: float = 28.0
) -> NDArray[np.float32]:
    """Smooth random texture (height, width, 3) round a colour."""
    noise = np.random.default_rng(seed).normal(size=(height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return np.asarray(np.array(colour, np.float32) + contrast * smooth / smooth.std(), dtype=np.float32)


def finish(image: NDArray[np.float32], seed: int, sigma: float = 1.5) -> NDArray[np.uint8]:
    """Add noise, round to 8 bits."""
    noise = np.random.default_rng(seed).normal(scale=sigma, size=image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def paste(image: NDArray[np.float32], patch: NDArray[np.float32], x: int, y: int) -> None:
    """Put a patch on an image, in place."""
    h, w = patch.shape[:2]
    image[y : y + h, x : x + w] = patch


GROUND = texture(HEIGHT, WIDTH, 1)
SQUARE = texture(34, 34, 2, (150, 100, 80))


def moving_square(frames: int = 24, speed: tuple[int, int] = (3, 1)) -> tuple[list[NDArray[np.uint8]], list[Box]]:
    """Square of texture moving over texture by whole pixels."""
    images, boxes = [], []
    for t in range(frames):
        image = GROUND.copy()
        x, y = 30 + speed[0] * t, 40 + speed[1] * t
        paste(image, SQUARE, x, y)
        images.append(finish(image, t))
        boxes.append(Box(x, y, 34, 34))
    return images, boxes


def follow(
    images: list[NDArray[Any]], box: Box, params: segmentation.SegmentationParams = PARAMS
) -> list[segmentation.SegmentationEstimate]:
    """Reports of all frames, the first one's too."""
    state = segmentation.start(as_frame(images[0]), box, params)
    reports = [state.estimate]
    for image in images[1:]:
        state = segmentation.step(state, as_frame(image), params)
        reports.append(state.estimate)
    return reports


def overlaps(reports: list[segmentation.SegmentationEstimate], boxes: list[Box]) -> NDArray[np.float64]:
    """IoU per frame, the first one excluded."""
    return np.array([iou(r.box, b) if r.ok else 0.0 for r, b in zip(reports[1:], boxes[1:], strict=True)])


@pytest.mark.parametrize("speed", [(3, 1), (-1, 2), (5, 0), (0, 1)])
def test_moving_square_is_followed(speed: tuple[int, int]) -> None:
    """A textured square moving over textured ground is boxed within a pixel or so."""
    images, boxes = moving_square(20, speed)
    assert overlaps(follow(images, boxes[0]), boxes).min() > 0.9


def test_gray_frames_are_followed() -> None:
    """One channel is enough."""
    images, boxes = moving_square(20)
    gray = [np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)) for image in images]
    assert overlaps(follow(gray, boxes[0]), boxes).min() > 0.9


def test_generous_start_box_tightens() -> None:
    """A start box 15 % too large shrinks to what moves."""
    images, boxes = moving_square()
    loose = Box(boxes[0].x - 4, boxes[0].y - 3, 41, 41)
    assert overlaps(follow(images, loose), boxes)[8:].min() > 0.9


def test_moving_camera_is_told_from_the_object() -> None:
    """With a panning camera the box follows the object, and the camera's motion is reported."""
    ground = texture(HEIGHT, WIDTH + 120, 3)
    images, boxes = [], []
    for t in range(20):
        image = np.ascontiguousarray(ground[:, 2 * t : 2 * t + WIDTH])
        paste(image, SQUARE, 60 + t, 50)
        images.append(finish(image, t))
        boxes.append(Box(60 + t, 50, 34, 34))
    reports = follow(images, boxes[0])
    assert overlaps(reports, boxes).min() > 0.9
    assert np.allclose([r.camera for r in reports[1:]], (-2.0, 0.0), atol=0.15)


def test_stopped_object_is_held() -> None:
    """An object that stops stays in its box: the background memory knows what belongs there."""
    images, boxes = moving_square(12)
    for t in range(30):
        image = GROUND.copy()
        paste(image, SQUARE, int(boxes[11].x), int(boxes[11].y))
        images.append(finish(image, 100 + t))
        boxes.append(boxes[11])
    assert overlaps(follow(images, boxes[0]), boxes).min() > 0.9


def test_second_mover_is_not_followed() -> None:
    """A second object that passes beside the first does not enter the box."""
    other = texture(24, 24, 5, (70, 140, 160))
    images, boxes = [], []
    for t in range(30):
        image = GROUND.copy()
        paste(image, other, 190 - 6 * t, 92)
        paste(image, SQUARE, 40 + 2 * t, 40)
        images.append(finish(image, t))
        boxes.append(Box(40 + 2 * t, 40, 34, 34))
    assert overlaps(follow(images, boxes[0]), boxes).min() > 0.88


def test_shadow_is_not_part_of_the_object() -> None:
    """A shadow that moves with the object is, after a few frames, ground that has darkened, not object."""
    images, boxes = [], []
    for t in range(24):
        image = GROUND.copy()
        x, y = 30 + 3 * t, 40 + t
        image[y + 14 : y + 46, x + 10 : x + 46] *= np.float32(0.6)
        paste(image, SQUARE, x, y)
        images.append(finish(image, t))
        boxes.append(Box(x, y, 34, 34))
    assert overlaps(follow(images, boxes[0]), boxes)[8:].min() > 0.85


def test_highlight_does_not_carry_the_box_away() -> None:
    """A broad highlight that wanders over the object faster than it moves is neither its motion nor its edge."""
    across = np.arange(44, dtype=np.float32)
    surface = texture(34, 44, 2, (150, 90, 70))
    images, boxes = [], []
    for t in range(36):
        image = GROUND.copy()
        light = 170 * np.exp(-(((across - (2.5 * t - 20)) / 6) ** 2))
        paste(image, np.clip(surface + light[np.newaxis, :, np.newaxis], 0, 255), 40 + t, 40)
        images.append(finish(image, t))
        boxes.append(Box(40 + t, 40, 44, 34))
    assert overlaps(follow(images, boxes[0]), boxes).min() > 0.85


@pytest.mark.parametrize("step", [-5, 5])
def test_second_mover_in_front_hides_and_does_not_take_over(step: int) -> None:
    """Another object that passes in front of the object leaves the box where it was."""
    other = texture(40, 26, 5, (70, 140, 160))
    images, boxes = [], []
    for t in range(40):
        image = GROUND.copy()
        paste(image, SQUARE, 70 + t, 45)
        x = (190 if step < 0 else 6) + step * t
        if 0 <= x <= WIDTH - 26:
            paste(image, other, x, 40)
        images.append(finish(image, t))
        boxes.append(Box(70 + t, 45, 34, 34))
    found = overlaps(follow(images, boxes[0]), boxes)
    assert found.mean() > 0.85
    assert found[-3:].min() > 0.85


def test_score_falls_while_the_object_goes_out_of_sight() -> None:
    """Behind a wall the score falls before the object is lost, and is high again after it."""
    images, boxes, shares = behind_wall()
    scores = np.array([report.score for report in follow(images, boxes[0])])
    going = (shares > 0.0) & (shares < 0.3) & (np.arange(44) < 25)
    assert going.any()
    assert scores[going].max() < 0.95
    assert scores[5:15].min() > 0.97
    assert scores[-3:].min() > 0.97


def test_sudden_absence_is_not_taken_for_the_object() -> None:
    """An object that is gone from one frame to the next is not located, until it is back."""
    images, boxes = moving_square(30, (2, 1))
    for t in range(14, 20):
        images[t] = finish(GROUND, t)
    reports = follow(images, boxes[0])
    assert not any(r.ok for r in reports[14:20])
    assert overlaps(reports, boxes)[-8:].min() > 0.85


def behind_wall() -> tuple[list[NDArray[np.uint8]], list[Box], NDArray[np.float64]]:
    """Square that passes behind a wall of its own width, with the visible share of each frame."""
    wall = texture(HEIGHT, 40, 7, (60, 60, 60), 15.0)
    images, boxes, shares = [], [], []
    for t in range(44):
        image = GROUND.copy()
        x = 30 + 3 * t
        paste(image, SQUARE, x, 50)
        paste(image, wall, 90, 0)
        images.append(finish(image, t))
        boxes.append(Box(x, 50, 34, 34))
        shares.append(1 - max(0, min(x + 34, 130) - max(x, 90)) / 34)
    return images, boxes, np.array(shares)


def test_occlusion_is_reported_and_survived() -> None:
    """Behind a wall the object is reported occluded, not ok when unseen, and found again on the other side."""
    images, boxes, shares = behind_wall()
    reports = follow(images, boxes[0])
    half = (shares < 0.6) & (shares > 0.2) & (np.arange(44) < 25)
    assert [r.occluded for r, hidden in zip(reports, half, strict=True) if hidden].count(True) >= 1
    assert not any(r.ok for r, share in list(zip(reports, shares, strict=True)) if share <= 0.0)
    assert overlaps(reports, boxes)[-4:].min() > 0.85


def test_object_is_not_occluded_on_open_ground() -> None:
    """Without anything in front nothing is reported."""
    images, boxes = moving_square()
    reports = follow(images, boxes[0])
    assert not any(r.occluded or r.lost or not r.ok for r in reports)
    assert min(r.score for r in reports) > 0.8


def snapshot(value: Any) -> Any:
    """Nested bytes of everything in a state, for comparison."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if dataclasses.is_dataclass(value):
        return {f.name: snapshot(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, tuple):
        return [snapshot(each) for each in value]
    return value


@pytest.mark.parametrize("operation", ["step", "watch", "reseed"])
def test_old_state_is_never_changed(operation: str) -> None:
    """Every operation leaves its state as it was: a failed update must not harm the track."""
    images, boxes = moving_square(8)
    frames = [as_frame(image) for image in images]
    state = segmentation.start(frames[0], boxes[0], PARAMS)
    for frame in frames[1:6]:
        state = segmentation.step(state, frame, PARAMS)
    before = snapshot(state)
    if operation == "step":
        segmentation.step(state, frames[6], PARAMS)
    elif operation == "watch":
        segmentation.watch(state, frames[6], boxes[6], PARAMS)
    else:
        segmentation.reseed(state, frames[5], boxes[5], PARAMS)
    assert snapshot(state) == before


def test_read_only_frames_suffice() -> None:
    """The caller's frame is never written to."""
    images, boxes = moving_square(6)
    for image in images:
        image.flags.writeable = False
    assert overlaps(follow(images, boxes[0]), boxes).min() > 0.9


def test_same_input_gives_same_state() -> None:
    """Two runs agree to the last bit."""
    images, boxes = moving_square(10)
    ends = []
    for _ in range(2):
        state = segmentation.start(as_frame(images[0]), boxes[0], PARAMS)
        for image in images[1:]:
            state = segmentation.step(state, as_frame(image), PARAMS)
        ends.append(snapshot(state))
    assert ends[0] == ends[1]


@pytest.mark.parametrize("way", ["pickle", "deepcopy"])
def test_copied_state_continues_alike(way: str) -> None:
    """A state that was pickled or deep-copied continues as the original does."""
    images, boxes = moving_square(10)
    state = segmentation.start(as_frame(images[0]), boxes[0], PARAMS)
    for image in images[1:6]:
        state = segmentation.step(state, as_frame(image), PARAMS)
    copied = pickle.loads(pickle.dumps(state)) if way == "pickle" else copy.deepcopy(state)
    for image in images[6:]:
        state = segmentation.step(state, as_frame(image), PARAMS)
        copied = segmentation.step(copied, as_frame(image), PARAMS)
    assert snapshot(state) == snapshot(copied)


def test_threads_do_not_disturb_each_other() -> None:
    """Tracks run in threads give what they give alone."""
    images, boxes = moving_square(8)
    alone = [r.box for r in follow(images, boxes[0])]
    results: list[list[Box]] = []
    threads = [
        threading.Thread(target=lambda: results.append([r.box for r in follow(images, boxes[0])])) for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [alone, alone]


def test_watching_knows_the_background_and_hands_over() -> None:
    """While another tracker gives the box the background is learned; a later step takes over from it."""
    images, boxes = moving_square(24)
    state = segmentation.start(as_frame(images[0]), boxes[0], PARAMS)
    for image, box in zip(images[1:14], boxes[1:14], strict=True):
        state = segmentation.watch(state, as_frame(image), box, PARAMS)
    assert state.estimate.box == pytest.approx(boxes[13], abs=1e-9)
    assert np.count_nonzero(state.atlas.counts[0] > 5) > 500
    assert state.estimate.unexplained < 0.03
    for image in images[14:]:
        state = segmentation.step(state, as_frame(image), PARAMS)
    assert iou(state.estimate.box, boxes[-1]) > 0.9


def test_reseed_takes_the_box_and_keeps_the_background() -> None:
    """After a hand-over the object is followed from the new box, with the background known as before."""
    images, boxes = moving_square(24)
    state = segmentation.start(as_frame(images[0]), boxes[0], PARAMS)
    for image in images[1:12]:
        state = segmentation.step(state, as_frame(image), PARAMS)
    known = int(np.count_nonzero(state.atlas.counts[0] > 5))
    state = segmentation.reseed(state, as_frame(images[11]), boxes[11], PARAMS)
    assert state.estimate.box == boxes[11]
    assert np.count_nonzero(state.atlas.counts[0] > 5) > 0.8 * known
    for image, box in zip(images[12:], boxes[12:], strict=True):
        state = segmentation.step(state, as_frame(image), PARAMS)
        assert iou(state.estimate.box, box) > 0.88


def test_trust_tells_a_foreign_motion() -> None:
    """A box that stands on moving ground is betrayed by what it leaves unexplained outside it."""
    images, boxes = moving_square(10)
    calm = follow(images, boxes[0])[-1]
    wrong = follow(images, Box(boxes[0].x + 40, boxes[0].y, 20, 20))
    assert max(r.unexplained for r in wrong[1:]) > 5 * calm.unexplained


def test_large_object_is_reduced() -> None:
    """An object of 180 px is handled on a coarser lattice, its box in frame pixels all the same."""
    ground = cv2.resize(GROUND, (880, 600), interpolation=cv2.INTER_CUBIC)
    big = cv2.resize(SQUARE, (180, 180), interpolation=cv2.INTER_CUBIC)
    images, boxes = [], []
    for t in range(10):
        image = np.asarray(ground, dtype=np.float32).copy()
        paste(image, np.asarray(big, dtype=np.float32), 200 + 8 * t, 200)
        images.append(finish(image, t))
        boxes.append(Box(200 + 8 * t, 200, 180, 180))
    reports = follow(images, boxes[0])
    assert reports[-1].step == 2
    assert max(reports[-1].mask.shape) < 200
    assert overlaps(reports, boxes).min() > 0.9


def test_growing_object_changes_the_lattice() -> None:
    """When an object outgrows the working size the lattice becomes coarser, and the track goes on."""
    params = segmentation.SegmentationParams(working_size=30)
    images, boxes = [], []
    for t in range(24):
        side = 28 + 2 * t
        image = GROUND.copy()
        paste(image, np.asarray(cv2.resize(SQUARE, (side, side)), dtype=np.float32), 70 - t, 60 - t)
        images.append(finish(image, t))
        boxes.append(Box(70 - t, 60 - t, side, side))
    reports = follow(images, boxes[0], params)
    assert {r.step for r in reports} >= {1, 2}
    assert overlaps(reports, boxes).min() > 0.8


@pytest.mark.parametrize("corner", ["left", "right", "top", "bottom"])
def test_object_may_leave_the_frame(corner: str) -> None:
    """Leaving the frame raises nothing, and the object is not reported where it cannot be seen."""
    direction = {"left": (-4, 0), "right": (4, 0), "top": (0, -4), "bottom": (0, 4)}[corner]
    images = []
    for t in range(40):
        canvas = np.pad(GROUND, ((80, 80), (80, 80), (0, 0)), mode="edge")
        x, y = 90 + direction[0] * t, 55 + direction[1] * t
        if -60 < x < WIDTH + 40 and -60 < y < HEIGHT + 40:
            paste(canvas, SQUARE, x + 80, y + 80)
        images.append(finish(canvas[80:-80, 80:-80], t))
    reports = follow(images, Box(90, 55, 34, 34))
    assert not reports[-1].ok


def test_report_is_complete() -> None:
    """Every picture that debug() shows has the size of the window."""
    images, boxes = moving_square(4)
    report = follow(images, boxes[0])[-1]
    h, w = report.mask.shape
    assert report.previous.shape == report.current.shape == (h, w)
    assert report.flow.shape == (h, w, 2)
    assert report.mask.dtype == np.uint8
    assert 0.0 <= report.score <= 1.0


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("working_size", 5),
        ("margin", 0.0),
        ("smoothness", -1.0),
        ("warps", 0),
        ("colour_weight", -0.1),
        ("occlusion_ratio", 1.5),
        ("max_coast", 0),
    ],
)
def test_bad_parameters_are_named(name: str, value: float) -> None:
    """A parameter out of range is refused with its name and value."""
    with pytest.raises(ValueError, match=f"{name}.*{value}"):
        segmentation.SegmentationParams(**{name: value})


def test_frames_of_other_types() -> None:
    """16-bit and float frames give the same boxes as 8-bit ones."""
    images, boxes = moving_square(6)
    expected = [r.box for r in follow(images, boxes[0])]
    for scale, kind in ((257, np.uint16), (1 / 255, np.float64)):
        frames: list[Frame] = [as_frame((image * np.float64(scale)).astype(kind)) for image in images]
        state = segmentation.start(frames[0], boxes[0], PARAMS)
        for frame, box in zip(frames[1:], expected[1:], strict=True):
            state = segmentation.step(state, frame, PARAMS)
            assert iou(state.estimate.box, box) > 0.98


@pytest.mark.parametrize("offset", [(0.3, 0.2), (-0.4, 0.0), (3.7, -2.2)])
def test_translated_moves_a_smooth_image(offset: tuple[float, float]) -> None:
    """A wave moved by a fraction of a pixel is the wave there; the image itself comes back for no motion at all."""

    def wave(dx: float, dy: float) -> NDArray[np.float32]:
        y, x = np.mgrid[:50, :60]
        return (100 + 50 * np.sin((x - dx) / 3) + 40 * np.cos((y - dy) / 4)).astype(np.float32)[:, :, np.newaxis]

    moved = translated(wave(0, 0), *offset)
    np.testing.assert_allclose(moved[8:-8, 8:-8], wave(*offset)[8:-8, 8:-8], atol=0.05)


@pytest.mark.parametrize("channels", [None, 1, 3])
def test_transformed_moves_a_ramp_exactly(channels: int | None) -> None:
    """A bilinear map of a linear ramp is the ramp at the place each pixel comes from."""
    y, x = np.mgrid[:40, :50].astype(np.float32)
    ramp = 2 * x + 3 * y
    image = ramp if channels is None else np.repeat(ramp[:, :, np.newaxis], channels, axis=2)
    a, b, c, d, e, f = 1.05, 0.02, 1.5, -0.03, 0.97, 2.25
    moved = transformed(image, (a, b, c, d, e, f), (40, 50))
    assert moved.shape == image.shape
    source = np.linalg.solve([[a, b], [d, e]], np.stack([(x - c).ravel(), (y - f).ravel()]))
    wanted = (2 * source[0] + 3 * source[1]).reshape(40, 50)
    plane = moved if channels is None else moved[:, :, -1]
    np.testing.assert_allclose(plane[6:-6, 6:-6], wanted[6:-6, 6:-6], atol=1e-3)


def test_transformed_beyond_the_image() -> None:
    """What lies beyond is the fill, or else the border; half a pixel over the edge is half of each."""
    image = np.full((10, 12), 5.0, np.float32)
    filled = transformed(image, (1.0, 0.0, 3.5, 0.0, 1.0, 0.0), (10, 12), fill=-3.0)
    np.testing.assert_allclose(filled[:, :3], -3.0)
    np.testing.assert_allclose(filled[:, 3], 1.0)
    np.testing.assert_allclose(filled[:, 4:], 5.0)
    np.testing.assert_allclose(transformed(image, (1.0, 0.0, 3.5, 0.0, 1.0, 0.0), (10, 12)), 5.0)


def wave(height: int, width: int, dx: float = 0.0, dy: float = 0.0) -> NDArray[np.float32]:
    """Smooth image (height, width, 3) moved by (dx, dy)."""
    y, x = np.mgrid[:height, :width]
    plane = 100 + 50 * np.sin((x - dx) / 5) + 40 * np.cos((y - dy) / 6)
    return np.stack([plane, 0.5 * plane + 20, 200 - plane], axis=2).astype(np.float32)


@pytest.mark.parametrize(("motion", "gain"), [((0.7, -1.2), 1.0), ((-1.6, 0.4), 1.15), ((0.0, 0.0), 0.9)])
def test_registration_finds_a_motion_and_a_gain(motion: tuple[float, float], gain: float) -> None:
    """A smooth layer that has moved and become brighter is registered to a hundredth of a pixel and a percent."""
    reference, image = wave(60, 70), gain * wave(60, 70, *motion)
    weight = np.zeros((60, 70), np.float32)
    weight[12:48, 14:56] = 1.0
    grid, points = (35.0, 30.0, 20.0, 1.0), kernels.Points(np.empty((14, 2000), np.float32))
    kernels.collect(reference, weight, grid, 3, points)
    assert points.count == weight.sum() / 3
    window = kernels.Window(np.asarray(image, np.float32), np.array((0, 0, 70, 60)))

    def registered(steps: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        theta, costs = np.zeros(8), np.empty(2)
        how = kernels.Registration(prior=np.full(8, 1e-6), scale=20.0, ceiling=40.0, stiffness=0.0, steps=steps)
        kernels.gauss_newton(window, points, how, theta, costs)
        return theta, costs

    theta, costs = registered(8)
    assert theta[[0, 3]] == pytest.approx(motion, abs=0.01)
    assert theta[6] == pytest.approx(100 * (gain - 1), abs=1.0)
    assert costs[0] == pytest.approx(kernels.residual(window, points, np.zeros(8), 40.0))
    assert costs[1] < 0.5
    unmoved, costs = registered(0)
    assert not unmoved.any()
    assert costs[0] == costs[1]


def test_registration_says_when_the_layer_is_out_of_the_frame() -> None:
    """A motion that takes three quarters of the layer out of the frame costs more than any other."""
    image, points = wave(40, 40), kernels.Points(np.empty((14, 2000), np.float32))
    kernels.collect(image, np.ones((40, 40), np.float32), (20.0, 20.0, 20.0, 1.0), 1, points)
    theta = np.array((35.0, 0, 0, 0, 0, 0, 0, 0))
    assert kernels.residual(kernels.Window(image, np.array((0, 0, 40, 40))), points, theta, 40.0) == 1e9


@pytest.mark.parametrize("channels", [1, 3])
def test_window_is_smoothed_and_of_three_channels(channels: int) -> None:
    """A window is the frame under a 5 × 5 Gaussian; a gray frame's is three times the same."""
    pixels = np.random.default_rng(0).integers(0, 256, (50, 60, channels), dtype=np.uint8)
    image, gray = grab(as_frame(pixels), (8, 6), (24, 32), 1)
    wanted = cv2.GaussianBlur(pixels.astype(np.float32), (5, 5), 0.7).reshape(50, 60, channels)[6:30, 8:40]
    np.testing.assert_allclose(image, np.broadcast_to(wanted, (24, 32, 3)), atol=1e-3)
    np.testing.assert_allclose(gray, image @ np.array((0.114, 0.587, 0.299), np.float32), atol=1e-3)


@pytest.mark.parametrize("offset", [(0, 0), (3, -2), (-5, 4), (40, 0), (0, -40)])
@pytest.mark.parametrize("tail", [(), (3,)])
def test_shifted_copies_what_there_is(offset: tuple[int, int], tail: tuple[int, ...]) -> None:
    """Pixel (i, j) of the new window is (i + dx, j + dy) of the old one, or the fill."""
    (dx, dy), (h, w), size = offset, (20, 24), (17, 30)
    array = np.random.default_rng(1).uniform(0, 9, (h, w, *tail)).astype(np.float32)
    moved = shifted(array, dx, dy, size, -3.0)
    padded = np.pad(array, ((60, 60), (60, 60), *[(0, 0)] * len(tail)), constant_values=-3.0)
    np.testing.assert_array_equal(moved, padded[60 + dy : 60 + dy + size[0], 60 + dx : 60 + dx + size[1]])


def test_carried_layers_are_the_resampled_ones() -> None:
    """In the part asked for, moving all layers at once is resampling each; beyond it there is no object."""
    rng = np.random.default_rng(2)
    h, w, part = 40, 50, np.array((5, 0, 44, 33))
    images = [rng.uniform(0, 255, (h, w, 3)).astype(np.float32) for _ in range(2)]
    planes = [rng.uniform(-3, 4, (h, w)).astype(np.float32), rng.uniform(0, 1, (h, w)).astype(np.float32)]
    inverse = np.array((1.02, 0.01, -3.3, -0.02, 0.98, 2.6))
    counts = np.zeros((3, h, w), np.float32)
    out = [np.empty_like(a) for a in (*images, *planes)]
    own = np.empty((h, w), np.uint8)
    expected = kernels.Expected(*out, own, part)
    kernels.carry(images[0], kernels.Layer(images[1], *planes), counts, inverse, True, expected)
    inner = (slice(part[1], part[3]), slice(part[0], part[2]))
    for before, after, fill in zip((*images, *planes), out, (None, None, -3.0, 0.0), strict=True):
        wanted = np.empty((h, w, before.size // (h * w)), np.float32)
        kernels.resample(before.reshape(h, w, -1), inverse, fill is None, fill or 0.0, wanted)
        np.testing.assert_allclose(after[inner], wanted.reshape(before.shape)[inner], atol=1e-3)
        np.testing.assert_array_equal(after[part[3] :], fill or 0.0)
    np.testing.assert_array_equal(own, out[2] > 0)
