"""What a cv2 user may hand over, checked: any frame and any ROI in, a plain view or one clear error out.

A :class:`Frame` is a view of the caller's pixels, never a copy and never written to; only the windows cut from
it are float32 copies of our own. So the cost is the window's, whatever the size of the frame.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple, ParamSpec, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from .geometry import Box
from .validation import Within, shown

__all__ = [
    "MIN_SIDE",
    "Frame",
    "InputError",
    "VideoFormat",
    "as_frame",
    "as_pair",
    "as_roi",
    "crop",
    "downloaded",
    "fixed_errstate",
    "is_dropped",
    "next_frame",
    "to_gray",
]

P = ParamSpec("P")
R = TypeVar("R")

MIN_SIDE = 4.0
"""Smallest side of a region of interest, px: less holds no gradient to follow."""

_ROUNDING = 1e-6
"""What a side may lose in the arithmetic of its edges, px."""

HEADROOM = 0.25
"""Room left for later frames of a track, above and below the values of the first one, as a share of their spread."""
_PART = 100_000
"""Values that are searched at once for the range of a float frame."""

_LARGEST_FLOAT = float(np.finfo(np.float32).max)
_BGR_TO_GRAY = np.array([[0.114, 0.587, 0.299]], np.float32)
_FIXED = {np.dtype(np.uint8): 1.0, np.dtype(np.bool_): 255.0}  # gain of types whose range is known
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

    @property
    def format(self) -> VideoFormat:
        """What the other frames of its video must be like."""
        return VideoFormat(self.height, self.width, self.channels, _native(self.pixels), self.gain, self.offset)


class VideoFormat(NamedTuple):
    """What all frames of one video have in common.

    Parameters
    ----------
    height, width, channels : int
        Channels: 1 (gray) or 3 (BGR).
    dtype : numpy.dtype
        In the byte order of this machine.
    gain, offset : float
        Range of the first frame, which holds for all frames of this dtype, or of floats of any precision: one dark
        frame does not change the scale.
    """

    height: Annotated[int, Within(1, 2**31)]
    width: Annotated[int, Within(1, 2**31)]
    channels: Annotated[int, Within(1, 3)]
    dtype: np.dtype[Any]
    gain: Annotated[float, Within(0.0, _LARGEST_FLOAT)]
    offset: Annotated[float, Within(-_LARGEST_FLOAT, _LARGEST_FLOAT)]


def fixed_errstate(call: Callable[P, R]) -> Callable[P, R]:
    """Make a public function independent of the caller's ``np.seterr`` and of warnings made errors.

    Values out of range are expected in frames and what is computed from them, and are dealt with where they matter.
    """

    @functools.wraps(call)
    def independent(*args: P.args, **kwargs: P.kwargs) -> R:
        with np.errstate(all="ignore"):
            return call(*args, **kwargs)

    return independent


def downloaded(image: Any) -> Any:
    """Return the ndarray behind a ``cv2.UMat``; anything else as it is."""
    return image.get() if isinstance(image, cv2.UMat) else image


def is_dropped(image: Any) -> bool:
    """Tell whether this is what a reader gives for a frame it could not read: None, or an image without pixels."""
    return image is None or (isinstance(image, np.ndarray) and image.size == 0)


@fixed_errstate
def as_frame(image: Any, gain: float | None = None) -> Frame:
    """Check an image and return a view of it.

    Parameters
    ----------
    image : ndarray or cv2.UMat
        Shape (H, W), (H, W, 1), (H, W, 3) BGR or (H, W, 4) BGRA (alpha is ignored), of any real type. Integers are
        read as 0–255, uint16 as 0–65535, bools as black and white, floats as 0–1 when no value exceeds 1, else as
        0–255. Where the values do not fit that or fill less than a quarter of 16 bits (cameras of 10, 12 and 14
        bits, thermal cameras), the range is that of the image, with headroom.
    gain : float, optional
        Gray levels per unit, instead of that rule; see :func:`value_range`.

    Returns
    -------
    Frame

    Raises
    ------
    InputError
        If the image is None, empty, of another type, shape or dtype.
    """
    pixels = _checked(image)
    return Frame(pixels, *value_range(pixels, gain))


@fixed_errstate
def as_pair(first: Any, second: Any, gain: float | None = None) -> tuple[Frame, Frame]:
    """Check two frames of one video: of one size, and of one range where they are of one dtype, or both of floats.

    Sizes are compared before any pixel is read.

    Parameters
    ----------
    first, second : ndarray or cv2.UMat
    gain : float, optional
        Gray levels per unit, instead of what the frames tell.

    Raises
    ------
    InputError
        If a frame cannot be used or the sizes differ.
    """
    before, after = _checked(first), _checked(second)
    if before.shape[:2] != after.shape[:2]:
        raise InputError(f"expected two frames of one size, got {_size(before)} and {_size(after)}")
    if gain is not None:
        return Frame(before, gain), Frame(after, gain)
    ranges = [value_range(pixels) for pixels in (before, after)]
    if _alike_in_type(before.dtype, after.dtype):
        ranges = [min(ranges)] * 2  # one bright frame tells the range of both
    return Frame(before, *ranges[0]), Frame(after, *ranges[1])


@fixed_errstate
def next_frame(image: Any, video: VideoFormat) -> Frame:
    """Check the next frame of a video; its size is compared before any pixel is read.

    Raises
    ------
    InputError
        If the image cannot be used, or is of another size or number of channels.
    """
    pixels = _checked(image)
    if pixels.shape != (video.height, video.width, video.channels):
        raise InputError(
            f"expected a {video.width} × {video.height} frame of {video.channels} channel(s) as given to init, got "
            f"{_size(pixels)} of {pixels.shape[2]}; call init again for another video"
        )
    alike = _alike_in_type(pixels.dtype, video.dtype)
    return Frame(pixels, *((video.gain, video.offset) if alike else value_range(pixels)))


def _checked(image: Any) -> NDArray[Any]:
    """View (H, W, 1 or 3) of an image."""
    image = downloaded(image)
    if not isinstance(image, np.ndarray):
        raise InputError(f"expected an image (ndarray or cv2.UMat), got {type(image).__name__}")
    image = np.asarray(image)  # a plain view: np.matrix and its like index in ways of their own
    if image.ndim == 2:
        image = image[:, :, np.newaxis]
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4):
        raise InputError(f"expected a frame of shape (H, W), (H, W, 1), (H, W, 3) or (H, W, 4), got {image.shape}")
    if image.size == 0:
        raise InputError(f"expected a non-empty frame, got shape {image.shape}")
    if image.dtype.kind not in "buif":
        raise InputError(f"expected a frame of integers, floats or bools, got dtype {image.dtype}")
    pixels: NDArray[Any] = image[:, :, :3] if image.shape[2] == 4 else image
    return pixels


def _size(pixels: NDArray[Any]) -> str:
    return f"{pixels.shape[1]} × {pixels.shape[0]}"


def _native(pixels: NDArray[Any]) -> np.dtype[Any]:
    """Dtype in the byte order of this machine: files of big-endian numbers are read as such."""
    return pixels.dtype.newbyteorder("=")


def _alike_in_type(one: np.dtype[Any], two: np.dtype[Any]) -> bool:
    """Whether numbers of both types mean the same: floats of every precision do."""
    return one.kind == two.kind == "f" or one.newbyteorder("=") == two.newbyteorder("=")


def value_range(pixels: NDArray[Any], gain: float | None = None) -> tuple[float, float]:
    """Gain and offset that bring the values of a frame, and of those like it, to gray levels.

    Parameters
    ----------
    pixels : ndarray, shape (H, W, C)
        Of any real type.
    gain : float, optional
        Gray levels per unit of what is not uint8; only the offset is then chosen: 0 where the values fit so, else
        what brings them to the middle of 0–255.

    Returns
    -------
    gain, offset : float
    """
    if pixels.dtype in _FIXED:
        return _FIXED[pixels.dtype], 0.0
    if gain is None and pixels.dtype.kind == "f":
        low, high = float(pixels.min()), float(pixels.max())  # of what is no number, no number
        if low >= 0.0 and high <= 255.0:
            return 255.0 / (255.0 if high > 1.0 else 1.0), 0.0
    low, high = _extremes(pixels)
    if gain is not None:
        return gain, 0.0 if low * gain >= 0.0 and high * gain <= 255.0 else 0.5 * (low + high) - 127.5 / gain
    spread = high - low
    finest = math.inf if pixels.dtype.kind == "f" else 1.0  # a gray level is no less than a step of the sensor
    if _native(pixels) == np.uint16:
        whole, fits = _DEEP, spread > _DEEP / 4.0
    else:
        whole = 1.0 if pixels.dtype.kind == "f" and not _exceeds_one(pixels) else 255.0
        # What filters overshoot by does not change the scale.
        fits = max(-low, 0.0) + max(high - whole, 0.0) <= spread / 4.0
    if fits or spread == 0.0:
        return 255.0 / whole, 0.0
    first = low - HEADROOM * spread if low < 0.0 else max(low - HEADROOM * spread, 0.0)
    return min(255.0 / (high + HEADROOM * spread - first), finest), first


def _exceeds_one(pixels: NDArray[Any]) -> bool:
    """Tell whether a finite value is above 1; in parts: no copy of the frame, and the first such value ends it."""
    rows = max(_PART // pixels[0].size, 1)
    parts = (pixels[top : top + rows] for top in range(0, len(pixels), rows))
    return any(bool(((part > 1.0) & (part < np.inf)).any()) for part in parts)


def _extremes(pixels: NDArray[Any]) -> tuple[float, float]:
    """Lowest and highest value, those of single dead or hot pixels and what is no number apart; 0, 0 of none."""
    step = max(1, round((pixels.size / _SAMPLE) ** 0.5))
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
        If it has not four finite numbers, less than 4 × 4 px inside the frame, or no finite pixel.
    """
    values = _four_numbers(bounding_box)
    if values is None:
        raise InputError(f"expected a boundingBox of four numbers (x, y, w, h), got {shown(bounding_box)}")
    if not np.isfinite(values).all():
        raise InputError(f"expected a finite boundingBox, got {shown(bounding_box)}")
    box = Box(*(float(value) for value in values))
    if box.w < MIN_SIDE or box.h < MIN_SIDE:
        raise InputError(
            f"expected a boundingBox of at least {MIN_SIDE:g} × {MIN_SIDE:g} px, got {shown(bounding_box)}"
        )
    inside = box.clip(frame.width, frame.height)
    if min(inside.w, inside.h) < MIN_SIDE - _ROUNDING:
        raise InputError(
            f"expected a boundingBox with at least {MIN_SIDE:g} × {MIN_SIDE:g} px inside the "
            f"{frame.width} × {frame.height} frame, got {shown(bounding_box)}"
        )
    if frame.pixels.dtype.kind == "f":
        part = frame.pixels[int(inside.y) : math.ceil(inside.bottom), int(inside.x) : math.ceil(inside.right)]
        if not np.isfinite(part).any():
            raise InputError(f"expected a finite pixel inside the boundingBox {shown(bounding_box)}, got none")
    return inside


def _four_numbers(values: Any) -> NDArray[np.float64] | None:
    try:
        array = np.asarray(values)
        # Neither text that looks like numbers, nor dates, nor complex numbers are coordinates.
        if array.shape != (4,) or array.dtype.kind not in "iufO":
            return None
        if array.dtype.kind == "O" and any(isinstance(value, str | bytes | complex) for value in array):
            return None
        return array.astype(np.float64)  # a long double beyond float64 becomes infinite, which is refused as such
    except Exception:  # an object of the caller's may raise anything when it is asked for numbers
        return None


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
    values = part.astype(np.float32)  # values beyond float32 become infinite, and infinite ones black below
    if offset != 0.0:
        values -= np.float32(offset)
    if gain != 1.0:
        values *= np.float32(gain)
    if part.dtype.kind == "f":
        np.nan_to_num(values, copy=False, nan=0.0, posinf=0.0, neginf=0.0)
    return np.clip(values, 0.0, 255.0, out=values)


def to_gray(window: NDArray[np.float32]) -> NDArray[np.float32]:
    """Gray version (H, W) of a window (H, W, C): OpenCV's BGR weights, or the one channel itself."""
    if window.shape[2] == 1:
        return np.ascontiguousarray(window[:, :, 0])
    # Not cvtColor: its last bits differ between versions of OpenCV.
    return np.asarray(cv2.transform(window, _BGR_TO_GRAY), dtype=np.float32)
