"""Frames and regions of interest as users hand them over."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest

from hs_tracker_cv.frames import InputError, as_frame, as_roi, crop, to_gray
from hs_tracker_cv.geometry import Box


@pytest.mark.parametrize(
    ("shape", "channels"),
    [((6, 8), 1), ((6, 8, 1), 1), ((6, 8, 3), 3), ((6, 8, 4), 3)],
)
def test_every_cv2_frame_layout_is_a_view(shape: tuple[int, ...], channels: int) -> None:
    """Gray, BGR and BGRA are taken without a copy."""
    image = np.zeros(shape, dtype=np.uint8)
    frame = as_frame(image)
    assert (frame.height, frame.width, frame.channels) == (6, 8, channels)
    assert np.shares_memory(frame.pixels, image)


@pytest.mark.parametrize(
    ("dtype", "value"),
    [(np.uint8, 51), (np.uint16, 13107), (np.float32, 0.2), (np.float64, 0.2), (np.float16, 0.2)],
)
def test_every_dtype_comes_out_in_0_to_255(dtype: Any, value: float) -> None:
    """The same gray in any dtype is the same window value."""
    window = crop(as_frame(np.full((5, 5), value, dtype=dtype)), 0, 0, 5, 5)
    assert window.dtype == np.float32
    np.testing.assert_allclose(window, 51.0, rtol=1e-3)


def test_float_images_of_0_to_255_keep_their_values() -> None:
    """A float image with values above 1 is in gray levels already."""
    assert crop(as_frame(np.full((5, 5), 51.0)), 0, 0, 5, 5).max() == 51.0


def test_umat_is_accepted() -> None:
    """cv2.UMat is a frame like any other."""
    assert as_frame(cv2.UMat(np.zeros((6, 8, 3), np.uint8))).channels == 3


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (None, "NoneType"),
        ("frame.png", "str"),
        (np.zeros((0, 5), np.uint8), "non-empty"),
        (np.zeros((5, 5, 2), np.uint8), r"\(5, 5, 2\)"),
        (np.zeros(5, np.uint8), r"\(5, 1\)|\(5,\)"),
        (np.zeros((5, 5), np.int32), "int32"),
        (np.zeros((5, 5), complex), "complex128"),
        (np.zeros((5, 5), bool), "bool"),
    ],
)
def test_bad_frames_are_named(image: Any, message: str) -> None:
    """The error says what came and is both a cv2.error and a ValueError."""
    with pytest.raises(InputError, match=message) as caught:
        as_frame(image)
    assert isinstance(caught.value, cv2.error)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize(
    "roi", [(2, 3, 10, 8), [2.0, 3.0, 10.0, 8.0], np.array([2, 3, 10, 8]), tuple(np.array([2, 3, 10, 8], np.int16))]
)
def test_rois_of_any_numeric_kind(roi: Any) -> None:
    """Ints, floats, tuple, list and ndarray mean the same box."""
    assert as_roi(roi, as_frame(np.zeros((20, 30), np.uint8))) == Box(2, 3, 10, 8)


def test_roi_partly_outside_is_clipped() -> None:
    """What lies outside the frame is cut off."""
    assert as_roi((-4, 10, 10, 20), as_frame(np.zeros((20, 30), np.uint8))) == Box(0, 10, 6, 10)


@pytest.mark.parametrize(
    "roi",
    [
        None,
        "1234",
        b"1234",
        7,
        (1, 2, 3),
        (1, 2, 3, 4, 5),
        (0, 0, 0, 0),
        (5, 5, -10, 8),
        (5, 5, 3, 8),
        (100, 100, 10, 10),
        (-9, 0, 10, 10),
        (np.nan, 0, 9, 9),
        (0, 0, np.inf, 9),
        (10**400, 0, 9, 9),
        np.full(4, np.finfo(np.longdouble).max),
        ([1], 2, 3, 4),
        ("a", 2, 3, 4),
        1j,
    ],
)
def test_bad_rois_are_named(roi: Any) -> None:
    """Every unusable ROI raises one exception type that repeats it."""
    with pytest.raises(InputError, match="boundingBox"):
        as_roi(roi, as_frame(np.zeros((20, 30), np.uint8)))


def test_crop_outside_repeats_the_border(rng: np.random.Generator) -> None:
    """A window over the edge equals the padded frame's."""
    image = rng.integers(0, 255, (12, 15, 3), dtype=np.uint8)
    padded = cv2.copyMakeBorder(image, 9, 9, 9, 9, cv2.BORDER_REPLICATE)
    window = crop(as_frame(image), -5, 7, 12, 14)
    np.testing.assert_array_equal(window, padded[16:30, 4:16].astype(np.float32))


@pytest.mark.parametrize("place", [(-50, -50), (40, 3), (3, 40), (100, 100)])
def test_crop_wholly_outside_repeats_the_nearest_pixels(place: tuple[int, int]) -> None:
    """A window that misses the frame is still a window."""
    image = np.arange(12 * 15, dtype=np.uint8).reshape(12, 15)
    window = crop(as_frame(image), *place, 6, 5)
    padded = cv2.copyMakeBorder(image, 110, 110, 110, 110, cv2.BORDER_REPLICATE)
    x, y = place[0] + 110, place[1] + 110
    np.testing.assert_array_equal(window[:, :, 0], padded[y : y + 5, x : x + 6])


def test_not_a_number_becomes_black() -> None:
    """NaN and infinities never reach the arithmetic."""
    image = np.full((5, 5), 0.5)
    image[0, 0], image[1, 1], image[2, 2] = np.nan, np.inf, -np.inf
    window = crop(as_frame(image), 0, 0, 5, 5)
    assert np.isfinite(window).all()
    assert window[0, 0] == window[2, 2] == 0.0


def test_frames_are_never_written_to() -> None:
    """A read-only frame of any stride serves."""
    image = np.zeros((40, 60, 3), np.uint8)[::2, ::-2, ::-1]
    image.flags.writeable = False
    assert to_gray(crop(as_frame(image), 3, 3, 10, 9)).shape == (9, 10)


def test_crop_obeys_the_gain_of_a_frame_of_bytes() -> None:
    """A gain that the caller gives holds for bytes as for any other type."""
    frame = as_frame(np.full((8, 9, 3), 40, np.uint8), gain=2.5)
    np.testing.assert_array_equal(crop(frame, 1, 2, 5, 4), np.full((4, 5, 3), 100.0, np.float32))


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("start", [(-70, -33), (-7, 5), (11, 40), (60, 2), (-200, 3), (90, -300)])
def test_blocks_beyond_the_frame_are_those_of_the_repeated_border(start: tuple[int, int], channels: int) -> None:
    """A window averaged in blocks is the same as if the whole border had been repeated first, wherever it lies."""
    pixels = np.random.default_rng(5).integers(0, 256, (47, 61, channels), dtype=np.uint8)
    step, size, room = 7, (17, 12), 400
    x0, y0 = start
    wide = np.pad(pixels, ((room, room), (room, room), (0, 0)), mode="edge")
    part = wide[room + y0 : room + y0 + size[1] * step, room + x0 : room + x0 + size[0] * step]
    wanted = cv2.resize(np.ascontiguousarray(part), size, interpolation=cv2.INTER_AREA).reshape(*size[::-1], -1)
    cut = crop(as_frame(pixels), x0, y0, size[0] * step, size[1] * step, step=step)
    np.testing.assert_array_equal(cut, wanted)
    assert cut.flags.c_contiguous
