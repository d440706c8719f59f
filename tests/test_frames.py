"""Frames and regions of interest as users hand them over."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv.frames import Frame, InputError, as_frame, as_pair, as_roi, crop, next_frame, to_gray, value_range
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
    [
        (np.uint8, 51),
        (np.int64, 51),
        (np.int8, 51),
        (np.uint32, 51),
        (np.uint16, 13107),
        (np.float32, 0.2),
        (np.float64, 0.2),
        (np.float16, 0.2),
    ],
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
        (np.zeros((5, 5), object), "object"),
        (np.zeros((5, 5), complex), "complex128"),
        (np.zeros((5, 5), "datetime64[s]"), "datetime64"),
    ],
)
def test_bad_frames_are_named(image: Any, message: str) -> None:
    """The error says what came and is both a cv2.error and a ValueError."""
    with pytest.raises(InputError, match=message) as caught:
        as_frame(image)
    assert isinstance(caught.value, cv2.error)
    assert isinstance(caught.value, ValueError)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, np.longdouble, ">f4"])
@pytest.mark.parametrize(
    ("value", "gain"), [(0.5, 255.0), (1.0, 255.0), (1.5, 1.0), (np.nan, 255.0), (np.inf, 255.0)]
)
def test_one_value_anywhere_tells_the_range_of_a_float_frame(dtype: Any, value: float, gain: float) -> None:
    """The range is that of all finite values, the last row of a large frame included."""
    image = np.full((700, 300), 0.25, dtype)
    assert as_frame(image).gain == 255.0
    image[-1, -1] = value
    assert as_frame(image).gain == gain


def test_two_frames_of_one_video_have_one_range() -> None:
    """A dark float frame is read like the bright one beside it; whole numbers have a range of their own."""
    dark, bright = np.full((5, 6), 0.5), np.full((5, 6), 200.0)
    assert [frame.gain for frame in as_pair(dark, bright)] == [1.0, 1.0]
    assert [frame.gain for frame in as_pair(bright, dark)] == [1.0, 1.0]
    assert [frame.gain for frame in as_pair(dark, dark)] == [255.0, 255.0]
    assert [frame.gain for frame in as_pair(dark, bright.astype(np.float32))] == [1.0, 1.0]
    assert [frame.gain for frame in as_pair(dark, np.zeros((5, 6, 3), np.uint16))] == [255.0, 255.0 / 65535.0]
    assert [frame.gain for frame in as_pair(dark, bright, 3.0)] == [3.0, 3.0]
    with pytest.raises(InputError, match="6 × 5 and 5 × 6"):
        as_pair(dark, dark.T)


def test_the_next_frame_is_like_the_first() -> None:
    """A float frame keeps the range of the first, in any order of bytes and precision; another size is named."""
    first = as_frame(np.full((5, 6, 3), 0.5, np.float32))
    for dtype in ("<f4", ">f4", np.float64, np.float16):
        assert next_frame(np.full((5, 6, 4), 7.0, dtype), first.format).gain == 255.0
    assert next_frame(np.full((5, 6, 3), 7, np.uint8), first.format).gain == 1.0
    with pytest.raises(InputError, match=r"expected a 6 × 5 frame of 3 channel\(s\).*got 5 × 6 of 1"):
        next_frame(np.zeros((6, 5)), first.format)


@pytest.mark.parametrize(
    "roi", [(2, 3, 10, 8), [2.0, 3.0, 10.0, 8.0], np.array([2, 3, 10, 8]), tuple(np.array([2, 3, 10, 8], np.int16))]
)
def test_rois_of_any_numeric_kind(roi: Any) -> None:
    """Ints, floats, tuple, list and ndarray mean the same box."""
    assert as_roi(roi, as_frame(np.zeros((20, 30), np.uint8))) == Box(2, 3, 10, 8)


@pytest.mark.parametrize("roi", [(1.0, 4.177935235407831, 4.0, 4.0), (-10.3, 2.0, 14.3, 4.0), (0.1, 16.0, 4.0, 9.0)])
def test_the_smallest_roi_may_lie_between_pixels(roi: tuple[float, ...]) -> None:
    """4 × 4 px inside are enough, whatever the arithmetic of edges makes of them."""
    assert as_roi(roi, as_frame(np.zeros((20, 30), np.uint8))).area == pytest.approx(16.0)


def test_roi_partly_outside_is_clipped() -> None:
    """What lies outside the frame is cut off."""
    assert as_roi((-4, 10, 10, 20), as_frame(np.zeros((20, 30), np.uint8))) == Box(0, 10, 6, 10)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_box_without_a_number_inside_is_refused(value: float) -> None:
    """There is nothing in it to follow; one finite pixel is something."""
    pixels = np.zeros((20, 30), np.float32)
    pixels[4:10, 5:11] = value
    with pytest.raises(InputError, match="expected a finite pixel inside the boundingBox"):
        as_roi((5, 4, 6, 6), as_frame(pixels))
    assert as_roi((5, 4, 6, 7), as_frame(pixels)) == Box(5, 4, 6, 7)


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
    """A gain that the caller gives holds for bytes as for any other type; levels stay within 0–255."""
    for value, level in ((40, 100.0), (200, 255.0)):
        frame = Frame(np.full((8, 9, 3), value, np.uint8), gain=2.5)
        np.testing.assert_array_equal(crop(frame, 1, 2, 5, 4), np.full((4, 5, 3), level, np.float32))


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


def _scene(seed: int = 3) -> NDArray[np.float64]:
    """A gray picture of 20 to 235."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal((60, 80)), (0, 0), 2.0)
    return np.asarray(cv2.normalize(noise, None, 20.0, 235.0, cv2.NORM_MINMAX), np.float64)


DEEP = {
    "10 bits": (np.uint16, 4.0, 0.0),
    "12 bits": (np.uint16, 16.0, 0.0),
    "14 bits": (np.uint16, 64.0, 0.0),
    "thermal": (np.uint16, 4.0, 7300.0),
    "thermal, big-endian": (np.dtype(">u2"), 4.0, 7300.0),
    "kelvin": (np.float32, 0.1, 280.0),
    "counts": (np.float64, 16.0, 0.0),
    "signed": (np.float32, 4.0, -500.0),
}
"""Cameras whose values fill little of their type: dtype, units per gray level, units of black."""


@pytest.mark.parametrize(("dtype", "units", "black"), DEEP.values(), ids=DEEP)
def test_the_range_of_deep_frames_is_taken_from_them(dtype: Any, units: float, black: float) -> None:
    """Two thirds of the contrast of the same picture in bytes at least, nothing cut off, and room for more."""
    picture = _scene()
    window = crop(as_frame((picture * units + black).astype(dtype)), 0, 0, 80, 60)[:, :, 0]
    assert 0.0 < window.min()
    assert window.max() < 255.0
    assert window.max() - window.min() > 0.66 * np.ptp(picture)
    assert np.corrcoef(window.ravel(), picture.ravel())[0, 1] > 0.999


@pytest.mark.parametrize(("dtype", "low", "high"), [(np.uint16, 0, 65535), (np.float32, np.nan, np.inf)])
def test_dead_pixels_do_not_set_the_range(dtype: Any, low: float, high: float) -> None:
    """A few pixels at the ends of the sensor, or without a number, leave the contrast of the others."""
    deep = (_scene() * 4 + 7300).astype(dtype)
    clean = crop(as_frame(deep), 0, 0, 80, 60)
    deep[10, 10], deep[20, 30], deep[40, 70] = low, high, high
    window = crop(as_frame(deep), 0, 0, 80, 60)
    assert np.median(np.abs(window - clean)) < 3.0
    assert np.isfinite(window).all()
    assert window.min() >= 0.0
    assert window.max() <= 255.0


def test_full_16_bits_keep_their_scale() -> None:
    """A frame that fills the type is read as before: 257 steps are one gray level, however bright the frame."""
    deep = (_scene() * 257).astype(np.uint16)
    assert as_frame(deep).gain == 255.0 / 65535.0
    assert as_frame(deep).offset == 0.0


def test_one_step_of_a_sensor_is_at_most_one_gray_level() -> None:
    """The noise of a black frame is not stretched to a picture."""
    dark = np.random.default_rng(0).integers(0, 12, (40, 50)).astype(np.uint16)
    assert crop(as_frame(dark), 0, 0, 50, 40).max() <= 11.0


@pytest.mark.parametrize("gain", [0.25, 0.05])
def test_a_gain_asked_for_is_used(gain: float) -> None:
    """The offset follows: none where all values fit, the middle of the values where they do not."""
    deep = (_scene() * 4 + 7300).astype(np.uint16)
    window = crop(as_frame(deep, gain), 0, 0, 80, 60)
    assert as_frame(deep, gain).gain == gain
    assert window.max() - window.min() == pytest.approx(gain * np.ptp(deep.astype(float)), rel=0.02)
    assert (window.max() + window.min()) / 2 == pytest.approx(127.5, abs=2.0)
    assert value_range((_scene() * 4).astype(np.uint16)[:, :, None], 0.2) == (0.2, 0.0)
