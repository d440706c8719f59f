"""Frames of 10, 12, 14 and 16 bits, thermal counts and floats: followed as well as the same video in bytes."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import HornSchunck, MotionDetector, TrackerHS_create, TrackerHS_Params
from hs_tracker_cv.geometry import Box, iou
from tests.conftest import BOX_IOU, moving_square

CAMERAS = {
    "10 bits": (np.uint16, 4.0, 0.0),
    "12 bits": (np.uint16, 16.0, 0.0),
    "16 bits": (np.uint16, 257.0, 0.0),
    "thermal": (np.uint16, 4.0, 7300.0),
    "kelvin": (np.float32, 0.1, 280.0),
    "counts in float": (np.float32, 64.0, 0.0),
    "bytes in int64": (np.int64, 1.0, 0.0),
    "12 bits in int32": (np.int32, 16.0, 0.0),
    "differences": (np.int16, 1.0, -128.0),
}
"""dtype, units per gray level, units of black."""

camera = pytest.mark.parametrize(("dtype", "units", "black"), CAMERAS.values(), ids=CAMERAS)


def _video(rng: np.random.Generator, dtype: Any, units: float, black: float) -> tuple[list[NDArray[Any]], list[Any]]:
    """The moving square, gray, as that camera gives it, and its boxes."""
    frames, boxes = moving_square(rng)
    return [(frame.mean(axis=2) * units + black).astype(dtype) for frame in frames], boxes


@camera
@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
def test_any_camera_is_followed(rng: np.random.Generator, mode: str, dtype: Any, units: float, black: float) -> None:
    """Every box of every mode lies on the object."""
    frames, boxes = _video(rng, dtype, units, black)
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(frames[0], boxes[0])
    for frame, wanted in zip(frames[1:], boxes[1:], strict=True):
        ok, box = tracker.update(frame)
        assert ok
        assert iou(Box(*box), Box(*wanted)) >= BOX_IOU


@camera
def test_any_camera_is_detected_in(rng: np.random.Generator, dtype: Any, units: float, black: float) -> None:
    """The mover is the largest region."""
    frames, boxes = _video(rng, dtype, units, black)
    assert iou(MotionDetector().detect(frames[3], frames[4])[0].box, Box(*boxes[4])) > 0.7


@pytest.mark.parametrize(("units", "black"), [(4.0, 0.0), (16.0, 0.0), (4.0, 7300.0)])
def test_the_flow_of_deep_frames(rng: np.random.Generator, units: float, black: float) -> None:
    """The square's motion is in the flow of 16-bit frames as it is in that of the bytes."""
    frames, boxes = _video(rng, np.uint16, units, black)
    x, y, w, h = boxes[3]
    inside = HornSchunck().calc(frames[3], frames[4])[y + 6 : y + h - 6, x + 6 : x + w - 6]
    np.testing.assert_allclose(np.median(inside, axis=(0, 1)), [2.0, 1.0], atol=0.1)


def test_one_range_holds_for_the_whole_track(rng: np.random.Generator) -> None:
    """A hot spot that comes later, twice as warm as all else, does not dim the object."""
    frames, boxes = _video(rng, np.uint16, 4.0, 7300.0)
    tracker = TrackerHS_create()
    tracker.init(frames[0], boxes[0])
    for frame, wanted in zip(frames[1:], boxes[1:], strict=True):
        frame[100:115, 130:150] = 16000
        ok, box = tracker.update(frame)
        assert ok
        assert iou(Box(*box), Box(*wanted)) >= BOX_IOU


def test_a_gain_asked_for_reaches_the_tracker(rng: np.random.Generator) -> None:
    """With a gain that leaves one gray level of contrast nothing can be seen; with a fitting one it is followed."""
    frames, boxes = _video(rng, np.uint16, 4.0, 7300.0)
    last = {}
    for gain in (0.001, 0.2):
        tracker = TrackerHS_create(TrackerHS_Params(gain=gain))
        tracker.init(frames[0], boxes[0])
        for frame in frames[1:]:
            tracker.update(frame)
        assert tracker.box is not None
        last[gain] = iou(tracker.box, Box(*boxes[-1]))
    assert last[0.2] >= BOX_IOU > last[0.001]


@pytest.mark.parametrize("gain", [0, -1.0, float("nan"), float("inf")])
def test_a_gain_that_cannot_be_meant_is_refused(gain: float) -> None:
    """The message repeats it."""
    with pytest.raises(ValueError, match=f"expected a finite gain above 0, got {gain!r}"):
        TrackerHS_Params(gain=gain)


@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
def test_bytes_have_a_range_of_their_own(rng: np.random.Generator, mode: str) -> None:
    """A gain for other frames changes nothing about 8-bit ones: they would leave the range that kernels count in."""
    frames, boxes = moving_square(rng)
    trackers = [TrackerHS_create(TrackerHS_Params(mode=mode, gain=gain)) for gain in (None, 40.0)]
    for tracker in trackers:
        tracker.init(frames[0], boxes[0])
    for frame in frames[1:]:
        first, second = (tracker.update(frame) for tracker in trackers)
        assert first == second
