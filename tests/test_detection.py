"""Moving regions without an ROI: nothing where nothing moves, the mover's box where something does."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv.detection import DetectorParams, MotionDetector
from hs_tracker_cv.frames import InputError
from hs_tracker_cv.geometry import Box, box_from_mask, iou

Image = NDArray[np.uint8]


def _texture(rng: np.random.Generator, height: int, width: int, sigma: float) -> NDArray[np.float32]:
    noise = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), sigma)
    return np.asarray(cv2.normalize(noise, None, 20, 235, cv2.NORM_MINMAX), np.float32)


def _noisy(rng: np.random.Generator, image: NDArray[np.float32], sigma: float) -> Image:
    return np.clip(np.rint(image + rng.normal(0, sigma, image.shape)), 0, 255).astype(np.uint8)


def _scene(
    *,
    size: tuple[int, int] = (320, 240),
    side: int = 48,
    start: tuple[int, int] = (100, 80),
    step: tuple[int, int] = (2, 1),
    count: int = 2,
    noise: float = 1.0,
    ground: str = "textured",
    camera: tuple[int, int] = (0, 0),
    seed: int = 5,
) -> tuple[list[Image], list[Box]]:
    """A textured square that moves by whole pixels; `camera` moves everything besides."""
    rng = np.random.default_rng(seed)
    width, height = size
    margin = 40
    scenery = np.full((height + 2 * margin, width + 2 * margin), 110, np.float32)
    if ground == "textured":
        scenery = _texture(rng, *scenery.shape, 3.0) * 0.6 + 20
    square = _texture(rng, side, side, 1.5)
    frames, boxes = [], []
    for index in range(count):
        shift = camera[0] * index, camera[1] * index
        image = scenery[margin - shift[1] :, margin - shift[0] :][:height, :width].copy()
        x, y = start[0] + (step[0] + camera[0]) * index, start[1] + (step[1] + camera[1]) * index
        image[y : y + side, x : x + side] = square
        frames.append(_noisy(rng, image, noise))
        boxes.append(Box(x, y, side, side))
    return frames, boxes


@pytest.mark.parametrize(
    "case",
    [
        {},  # the plain case
        {"step": (1, 0)},  # slow
        {"step": (5, -3)},  # fast
        {"noise": 6.0},
        {"ground": "plain"},
        {"side": 24, "step": (3, 2)},  # small
        {"side": 120, "start": (60, 60)},  # large
        {"size": (640, 480), "side": 64, "start": (300, 200), "step": (4, 2)},
        {"size": (1280, 720), "side": 160, "start": (500, 300), "step": (6, -4)},  # computed on a coarser lattice
        {"camera": (-2, 1)},  # the whole picture shifts, the object by more
    ],
    ids=lambda case: ",".join(case) or "plain",
)
def test_a_textured_mover_is_found_in_its_box(case: dict[str, object]) -> None:
    """The largest region has IoU > 0.8 with the true box in the current frame."""
    frames, boxes = _scene(**case)  # type: ignore[arg-type]
    regions = MotionDetector().detect(*frames)
    assert regions
    assert iou(regions[0].box, boxes[-1]) > 0.8


@pytest.mark.parametrize("step", [(2, 1), (-3, 0), (0, 4)])
def test_a_region_describes_itself(step: tuple[int, int]) -> None:
    """Mean flow is the true motion, mask and area agree with the box, corners lie inside the mask."""
    frames, _ = _scene(step=step)
    region = MotionDetector().detect(*frames)[0]
    assert region.flow == pytest.approx(step, abs=0.4)
    assert region.mask.shape == (240, 320)
    assert box_from_mask(region.mask) == pytest.approx(region.box)
    assert region.area == region.mask.sum()
    assert len(region.corners) > 5
    columns, rows = np.rint(region.corners).astype(int).T
    assert region.mask[rows, columns].all()


@pytest.mark.parametrize("noise", [0.0, 1.0, 4.0, 12.0, 30.0])
def test_noise_is_no_motion(noise: float) -> None:
    """Two noisy pictures of one textured scene hold no region, whatever the noise."""
    rng = np.random.default_rng(11)
    scene = _texture(rng, 240, 320, 2.0)
    detector = MotionDetector()
    for _ in range(4):
        assert detector.detect(_noisy(rng, scene, noise), _noisy(rng, scene, noise)) == []


def test_a_moving_camera_alone_is_no_motion() -> None:
    """A shift of the whole picture counts as standing still."""
    scenery = _texture(np.random.default_rng(2), 260, 340, 3.0)
    frames = [np.rint(scenery[10:250, 10 + 2 * k : 330 + 2 * k]).astype(np.uint8) for k in range(2)]
    assert MotionDetector().detect(*frames) == []


def test_two_movers_come_largest_first() -> None:
    """Two objects give two regions, ordered by area."""
    rng = np.random.default_rng(4)
    scenery = _texture(rng, 240, 320, 3.0) * 0.6 + 20
    small, large = _texture(rng, 30, 30, 1.5), _texture(rng, 60, 60, 1.5)
    frames = []
    for k in range(2):
        image = scenery.copy()
        image[40 : 40 + 30, 30 + 2 * k : 60 + 2 * k] = small
        image[150 : 150 + 60, 220 - 2 * k : 280 - 2 * k] = large
        frames.append(_noisy(rng, image, 1.0))
    regions = MotionDetector().detect(*frames)
    assert len(regions) == 2
    assert iou(regions[0].box, Box(218, 150, 60, 60)) > 0.8
    assert iou(regions[1].box, Box(32, 40, 30, 30)) > 0.8


def test_identical_frames_give_nothing_and_zero_fields() -> None:
    """The same frame twice gives no region, zero flow and zero Ft."""
    frame = _scene()[0][0]
    detector = MotionDetector()
    fields = detector.fields(frame, frame)
    assert detector.detect(frame, frame) == []
    assert not fields.flow.any()
    assert not fields.Ft.any()
    assert not fields.mask.any()


def test_fixed_threshold_separates_slow_from_fast() -> None:
    """A threshold above the object's speed hides it, one below shows it."""
    frames, boxes = _scene(step=(2, 0))
    assert MotionDetector(DetectorParams(threshold=4.0)).detect(*frames) == []
    found = MotionDetector(DetectorParams(threshold=0.5)).detect(*frames)
    assert iou(found[0].box, boxes[-1]) > 0.7


@pytest.mark.parametrize("channels", [1, 3, 4])
def test_any_frame_of_cv2_is_taken_and_left_alone(channels: int) -> None:
    """Read-only gray, BGR and BGRA frames give the same region, and the inputs stay as they were."""
    frames, boxes = _scene()
    shaped = [np.repeat(frame[:, :, None], channels, axis=2) for frame in frames]
    for frame in shaped:
        frame.flags.writeable = False
    assert iou(MotionDetector().detect(*shaped)[0].box, boxes[-1]) > 0.8


def test_frames_of_differing_size_are_refused() -> None:
    """The error names both sizes."""
    with pytest.raises(InputError, match="got 320 × 240 and 64 × 48"):
        MotionDetector().detect(np.zeros((240, 320), np.uint8), np.zeros((48, 64), np.uint8))


@pytest.mark.parametrize(
    ("field", "value"),
    [("threshold", 0.0), ("noise_factor", 0.0), ("min_area", -1.0), ("max_side", 8), ("smoothing", -1.0)],
)
def test_params_outside_their_range_are_refused(field: str, value: float) -> None:
    """The error names the parameter and the value."""
    with pytest.raises(ValueError, match=rf"expected {field} .*got {value!r}"):
        DetectorParams(**{field: value})  # type: ignore[arg-type]


@pytest.mark.real
def test_a_car_on_a_real_road_is_found(real: Path) -> None:
    """On the highway sequence the detector's boxes hold the annotated car in most pairs of frames."""
    folder = real / "cdnet_highway_521"
    truth = np.loadtxt(folder / "groundtruth_rect.txt", delimiter=",")
    detector = MotionDetector()
    overlaps = []
    for index in range(60, 160, 10):
        pair = [cv2.imread(str(folder / "img" / f"{number:04d}.jpg")) for number in (index, index + 1)]
        x, y, w, h = truth[index]
        regions = detector.detect(*pair)
        overlaps.append(max((iou(region.box, Box(x - 1, y - 1, w, h)) for region in regions), default=0.0))
    assert np.median(overlaps) > 0.5
