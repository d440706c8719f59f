"""What a cv2 user may hand over, checked: any frame and any ROI in, a plain view or one clear error out.

A :class:`Frame` is a view of the caller's pixels, never a copy and never written to; only the windows cut from
it are float32 copies of our own. So the cost is the window's, whatever the size of the frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .geometry import Box

__all__ = ["MIN_SIDE", "Frame", "InputError", "as_frame", "as_roi", "crop", "to_gray", "value_range"]

MIN_SIDE = 4.0
"""Smallest side of a region of interest, px: less holds no gradient to follow."""

_LONGEST = 200
"""Characters of a bad value that a message repeats."""

HEADROOM = 0.25
"""Room left for later frames of a track, above and below the values of the first one, as a share of their spread."""

_BGR_TO_GRAY = np.array([[0.114, 0.587, 0.299]], np.float32)
_DEEP = 65535.0
_SAMPLE = 1 << 20  # values that suffice to know a range


class InputError(cv2.error, ValueError):
    """A frame or ROI that cannot be used; caught by ``except cv2.error`` and by ``except ValueError``."""


@dataclass(frozen=True)
class Frame:
    """A checked view of the caller's image.

    Parameters
    ----------
    pixels : ndarray, shape (H, W, C)
        C is 1 (gray) or 3 (BGR); any supported dtype, any stride.
    gain, offset : float
        ``(value - offset) * gain`` is a gray level, 0–255.
    """

    pixels: NDArray[Any]
    gain: float
    offset: float = 0.0

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.pixels.shape[0])

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.pixels.shape[1])

    @property
    def channels(self) -> int:
        """1 (gray) or 3 (BGR)."""
        return int(self.pixels.shape[2])


def as_frame(image: Any, gain: float | None = None, offset: float = 0.0) -> Frame:
    """Check an image and return a view of it.

    Parameters
    ----------
    image : ndarray or cv2.UMat
        Shape (H, W), (H, W, 1), (H, W, 3) BGR or (H, W, 4) BGRA (alpha is ignored); uint8, uint16 or a float
        type. Float images are read as 0–1 when no value exceeds 1, else as 0–255. Where the values do not fit that
        or fill less than a quarter of 16 bits (cameras of 10, 12 and 14 bits, thermal cameras), the range is that
        of the image, with headroom.
    gain, offset : float, optional
        Range of the first frame of a track, so that one dark frame does not change the scale.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        If the image is None, empty, of another type, shape or dtype.
    """
    if isinstance(image, cv2.UMat):
        image = image.get()
    if not isinstance(image, np.ndarray):
        raise InputError(f"expected an image (ndarray or cv2.UMat), got {type(image).__name__}")
    image = np.asarray(image)  # a plain view: np.matrix and its like index in ways of their own
    if image.ndim == 2:
        image = image[:, :, np.newaxis]
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4):
        raise InputError(f"expected a frame of shape (H, W), (H, W, 1), (H, W, 3) or (H, W, 4), got {image.shape}")
    if image.size == 0:
        raise InputError(f"expected a non-empty frame, got shape {image.shape}")
    if image.dtype.kind != "f" and not (image.dtype.kind == "u" and image.dtype.itemsize <= 2):
        raise InputError(f"expected a uint8, uint16 or float frame, got dtype {image.dtype}")
    pixels = image[:, :, :3] if image.shape[2] == 4 else image
    return Frame(pixels, *(value_range(pixels) if gain is None else (gain, offset)))


def value_range(pixels: NDArray[Any], gain: float | None = None) -> tuple[float, float]:
    """Gain and offset that bring the values of a frame, and of those like it, to gray levels.

    Parameters
    ----------
    pixels : ndarray, shape (H, W, C)
        uint8, uint16 or float.
    gain : float, optional
        Gray levels per unit; only the offset is then chosen: 0 where the values fit so, else what brings them to the
        middle of 0–255.

    Returns
    -------
    gain, offset : float
    """
    if pixels.dtype.itemsize == 1:
        return (1.0 if gain is None else gain), 0.0
    low, high = _extremes(pixels)
    if gain is not None:
        return gain, 0.0 if low * gain >= 0.0 and high * gain <= 255.0 else 0.5 * (low + high) - 127.5 / gain
    spread = high - low
    if pixels.dtype.kind == "u":
        whole, finest, fits = _DEEP, 1.0, spread > _DEEP / 4.0  # a gray level is no less than a step of the sensor
    else:
        whole, finest = (1.0 if _highest(pixels) <= 1.0 else 255.0), math.inf
        # What filters overshoot by does not change the scale.
        fits = max(-low, 0.0) + max(high - whole, 0.0) <= spread / 4.0
    if fits or spread == 0.0:
        return 255.0 / whole, 0.0
    first = low - HEADROOM * spread if low < 0.0 else max(low - HEADROOM * spread, 0.0)
    return min(255.0 / (high + HEADROOM * spread - first), finest), first


def _highest(pixels: NDArray[Any]) -> float:
    finite = pixels[np.isfinite(pixels)]
    return float(finite.max()) if finite.size else 0.0


def _extremes(pixels: NDArray[Any]) -> tuple[float, float]:
    """Lowest and highest value, those of single dead or hot pixels and what is no number apart; 0, 0 of none."""
    step = max(1, round((pixels.size / _SAMPLE) ** 0.5))
    with np.errstate(over="ignore", invalid="ignore"):
        sample = np.ascontiguousarray(pixels[::step, ::step], np.float32)
    finite = np.isfinite(sample)
    if not finite.any():
        return 0.0, 0.0
    if not finite.all():
        sample = np.where(finite, sample, np.median(sample[finite]))
    smooth = cv2.medianBlur(sample, 3)
    return float(smooth.min()), float(smooth.max())


def as_roi(bounding_box: Any, frame: Frame) -> Box:
    """Check a region of interest and clip it to the frame.

    Parameters
    ----------
    bounding_box : sequence of 4 numbers
        x, y, w, h in px; ints or floats; tuple, list or ndarray.
    frame : Frame
        The frame it was drawn on.

    Returns
    -------
    Box
        The part inside the frame.

    Raises
    ------
    InputError
        If it has not four finite numbers, or less than 4 × 4 px inside the frame.
    """
    values = _four_numbers(bounding_box)
    if values is None:
        raise InputError(f"expected a boundingBox of four numbers (x, y, w, h), got {_shown(bounding_box)}")
    if not np.isfinite(values).all():
        raise InputError(f"expected a finite boundingBox, got {_shown(bounding_box)}")
    box = Box(*(float(value) for value in values))
    if box.w < MIN_SIDE or box.h < MIN_SIDE:
        raise InputError(
            f"expected a boundingBox of at least {MIN_SIDE:g} × {MIN_SIDE:g} px, got {_shown(bounding_box)}"
        )
    inside = box.clip(frame.width, frame.height)
    if inside.w < MIN_SIDE or inside.h < MIN_SIDE:
        raise InputError(
            f"expected a boundingBox with at least {MIN_SIDE:g} × {MIN_SIDE:g} px inside the "
            f"{frame.width} × {frame.height} frame, got {_shown(bounding_box)}"
        )
    return inside


def _four_numbers(values: Any) -> NDArray[np.float64] | None:
    try:
        array = np.asarray(values)
        # Neither text that looks like numbers, nor dates, nor complex numbers are coordinates.
        if array.shape != (4,) or array.dtype.kind not in "iufO":
            return None
        if array.dtype.kind == "O" and any(isinstance(value, str | bytes | complex) for value in array):
            return None
        # A long double beyond float64 becomes infinite, which is refused as such, and no warning.
        with np.errstate(over="ignore"):
            return array.astype(np.float64)
    except Exception:  # an object of the caller's may raise anything when it is asked for numbers
        return None


def _shown(value: Any) -> str:
    """`repr` for a message: cut where it is long, and no error of its own (an int of 5,000 digits has none)."""
    try:
        words = repr(value)
    except Exception:
        return f"a {type(value).__name__} that cannot be shown"
    return words if len(words) <= _LONGEST else f"{words[:_LONGEST]}…"


def crop(frame: Frame, x0: int, y0: int, width: int, height: int, *, step: int = 1) -> NDArray[np.float32]:
    """Cut a window out of a frame, as float32 in 0–255.

    Parameters
    ----------
    frame : Frame
    x0, y0 : int
        Top-left pixel; may lie outside the frame.
    width, height : int
        Size of the window, px; multiples of `step`.
    step : int, optional
        Average `step` × `step` pixels to one, of 8-bit frames to whole gray levels: then only what is left is
        converted, which for a large window is most of the work.

    Returns
    -------
    ndarray, shape (height / step, width / step, C), float32, C-contiguous
        A copy. Outside the frame the border pixels are repeated; NaN and infinities become 0.
    """
    if step > 1:
        before, after = _alike(x0, width // step, step, frame.width)
        above, below = _alike(y0, height // step, step, frame.height)
        if before + after + above + below > 0:
            size = width - (before + after) * step, height - (above + below) * step
            inner = crop(frame, x0 + before * step, y0 + above * step, *size, step=step)
            padded = cv2.copyMakeBorder(inner, above, below, before, after, cv2.BORDER_REPLICATE)
            return np.asarray(padded, np.float32).reshape(height // step, width // step, -1)
    left, top = min(max(x0, 0), frame.width - 1), min(max(y0, 0), frame.height - 1)
    right, bottom = min(max(x0 + width, left + 1), frame.width), min(max(y0 + height, top + 1), frame.height)
    part = frame.pixels[top:bottom, left:right]
    if part.dtype != np.uint8 or frame.gain != 1.0 or frame.offset != 0.0:
        part = _as_float(part, frame.gain, frame.offset)
    if part.shape[:2] != (height, width):
        above, before = (
            min(max(inside - start, 0), missing)
            for inside, start, missing in ((top, y0, height - part.shape[0]), (left, x0, width - part.shape[1]))
        )
        below, after = height - part.shape[0] - above, width - part.shape[1] - before
        part = cv2.copyMakeBorder(part, above, below, before, after, cv2.BORDER_REPLICATE)
        part = part.reshape(height, width, -1)  # OpenCV drops the axis of a single channel
    if step > 1:
        size = (width // step, height // step)
        part = cv2.resize(part, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], -1)
    return np.ascontiguousarray(part, dtype=np.float32)


def _alike(start: int, count: int, step: int, limit: int) -> tuple[int, int]:
    """How many of the first and of the last blocks of a window are as the block next to them.

    Those are wholly beyond an edge of the frame, where its border is repeated: of a large object that is as thin as a
    line, nearly all.
    """
    before = min(-start // step, count) - 1
    after = count - max((limit - start + step - 1) // step, 0) - 1
    return max(before, 0), max(after, 0)


def _as_float(part: NDArray[Any], gain: float, offset: float) -> NDArray[np.float32]:
    # Values beyond float32 become infinite, and infinite ones black below.
    with np.errstate(over="ignore", invalid="ignore"):
        values = part.astype(np.float32)
        if offset != 0.0:
            values -= np.float32(offset)
        if gain != 1.0:
            values *= np.float32(gain)
    if part.dtype.kind == "f":
        np.nan_to_num(values, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    if part.dtype != np.uint8:
        np.clip(values, 0.0, 255.0, out=values)
    return values


def to_gray(window: NDArray[np.float32]) -> NDArray[np.float32]:
    """Gray version (H, W) of a window (H, W, C): OpenCV's BGR weights, or the one channel itself."""
    if window.shape[2] == 1:
        return np.ascontiguousarray(window[:, :, 0])
    # Not cvtColor: its last bits differ between versions of OpenCV.
    return np.asarray(cv2.transform(window, _BGR_TO_GRAY), dtype=np.float32)
