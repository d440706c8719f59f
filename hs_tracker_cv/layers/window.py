"""The window round the object: cutting it out of a frame, moving what is remembered into the next one."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..frames import Frame, crop
from .kernels import resample, shift, smooth
from .state import Image, LayersState, Plane

__all__ = [
    "Picture",
    "View",
    "grab",
    "lattice_step",
    "look",
    "place_window",
    "shifted",
    "shifted_mask",
    "transformed",
    "translated",
]

_RING = 2  # px more on each side, so that the prefilter's border lies outside the window
_TAPS = cv2.getGaussianKernel(2 * _RING + 1, 0.7).astype(np.float32).ravel()[_RING:]
_SIZES = 4  # windows are so many px high and wide, times a whole number: flow is planned once per size


class Picture(NamedTuple):
    """A window of a frame, and its gray version."""

    image: Image
    gray: Plane


class View(NamedTuple):
    """The window of this frame, with its gray version and that of the last frame; its part inside the frame."""

    image: Image
    gray: Plane
    previous: Plane
    inside: NDArray[np.int64]
    colour: bool


def look(state: LayersState, frame: Frame) -> View:
    """Cut this frame's window."""
    h, w = state.odds.shape
    image, gray = grab(frame, state.origin, (h, w), state.step)
    inside = _inside_rectangle(frame, state.origin, (h, w), state.step)
    return View(image, gray, state.gray, inside, frame.channels == 3)


def lattice_step(longest: float, working_size: int) -> int:
    """Frame px per lattice px for an object of that longest side."""
    return max(1, math.ceil(longest / working_size))


def grab(frame: Frame, origin: tuple[int, int], size: tuple[int, int], step: int) -> Picture:
    """Window of a frame on the lattice: block means of `step` × `step` px, then a 5 × 5 Gaussian of σ 0.7.

    Parameters
    ----------
    frame : Frame
    origin : tuple of int
        Top-left (x, y), lattice px.
    size : tuple of int
        Height and width, lattice px.
    step : int

    Returns
    -------
    Picture
        (h, w, 3) and (h, w), float32; of a gray frame the three channels are the same.
    """
    h, w = size
    left, top = (origin[0] - _RING) * step, (origin[1] - _RING) * step
    pixels = crop(frame, left, top, (w + 2 * _RING) * step, (h + 2 * _RING) * step, step=step)
    rows = pixels.reshape(h + 2 * _RING, -1)
    image, gray = np.empty((h, 3 * w), np.float32), np.empty((h, w), np.float32)
    smooth(rows, _TAPS, np.empty(rows.shape[1], np.float32), image, gray)
    return Picture(image.reshape(h, w, 3), gray)


def _inside_rectangle(frame: Frame, origin: tuple[int, int], size: tuple[int, int], step: int) -> NDArray[np.int64]:
    """(x0, y0, x1, y1) of the part of the window inside the frame, window px, end exclusive."""
    right = int(frame.width / step + 0.5) - origin[0]
    bottom = int(frame.height / step + 0.5) - origin[1]
    corners = (max(0, -origin[0]), max(0, -origin[1]), min(size[1], right), min(size[0], bottom))
    return np.array(corners, dtype=np.int64)


def place_window(
    box: tuple[float, float, float, float], velocity: tuple[float, float], margin: float, extent: tuple[float, float]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Window for the next frame: the box, the box moved on, and a margin; kept within reach of the frame.

    Parameters
    ----------
    box, velocity, margin
        Lattice px.
    extent : tuple of float
        Width and height of the frame, lattice px.

    Returns
    -------
    origin, size : (x, y), (h, w)
    """
    spans = []
    for start, length, speed, limit in zip(box[:2], box[2:], velocity, extent, strict=True):
        low = max(math.floor(start + min(speed, 0.0) - margin), -12)
        high = min(math.ceil(start + length + max(speed, 0.0) + margin), math.ceil(limit) + 12)
        if high - low < 24:  # the object has left: keep looking at the nearest edge
            low, high = (low, low + 24) if start < limit / 2 else (high - 24, high)
        spans.append((low, -((low - high) // _SIZES) * _SIZES))
    (x, w), (y, h) = spans
    return (x, y), (h, w)


def transformed(
    image: NDArray[np.float32],
    matrix: tuple[float, float, float, float, float, float],
    size: tuple[int, int],
    fill: float | None = None,
) -> NDArray[np.float32]:
    """Image moved by an affine map, bilinear.

    Parameters
    ----------
    image : ndarray, shape (h, w) or (h, w, C), float32
    matrix : tuple of float
        (a, b, c, d, e, f): pixel (x, y) goes to (a x + b y + c, d x + e y + f).
    size : (h, w)
        Of the result.
    fill : float, optional
        What lies beyond the image; without it, the border is repeated.
    """
    a, b, c, d, e, f = matrix
    scale = 1.0 / (a * e - b * d)
    inverse = np.array((e, -b, b * f - c * e, -d, a, c * d - a * f)) * scale
    source = np.ascontiguousarray(image).reshape(image.shape[0], image.shape[1], -1)
    out = np.empty((*size, source.shape[2]), np.float32)
    resample(source, inverse, fill is None, 0.0 if fill is None else fill, out)
    return out.reshape(*size, *image.shape[2:])


def translated(image: Image, dx: float, dy: float) -> Image:
    """Image moved by any distance, cubic (Keys' kernel, a = −1/2), the border repeated; itself for none."""
    if (dx, dy) == (0.0, 0.0):
        return image
    whole_x, whole_y = math.floor(dx), math.floor(dy)
    if (whole_x, whole_y) != (0, 0):
        rows = np.clip(np.arange(image.shape[0]) - whole_y, 0, image.shape[0] - 1)
        columns = np.clip(np.arange(image.shape[1]) - whole_x, 0, image.shape[1] - 1)
        image = image[rows[:, np.newaxis], columns]
    out = cv2.sepFilter2D(
        image, -1, _cubic(dx - whole_x), _cubic(dy - whole_y), anchor=(2, 2), borderType=cv2.BORDER_REPLICATE
    )
    return np.asarray(out, dtype=np.float32).reshape(image.shape)


def _cubic(t: float) -> NDArray[np.float64]:
    """Weights of the pixels 2 and 1 before, here, and 1 after, at a place `t` before here (0–1)."""
    s = 1.0 - t
    weights = ((-0.5 * s + 1.0) * s - 0.5) * s, ((1.5 * s - 2.5) * s) * s + 1.0, ((-1.5 * s + 2.0) * s + 0.5) * s
    return np.array((*weights, (0.5 * s - 0.5) * s * s))


def shifted(array: NDArray[np.float32], dx: int, dy: int, size: tuple[int, int], fill: float) -> NDArray[np.float32]:
    """Copy an array into a window whose pixel (i, j) is the array's (i + dx, j + dy); `fill` where it has none."""
    channels = math.prod(array.shape[2:])
    out = np.empty((*size, *array.shape[2:]), np.float32)
    shift(array.reshape(array.shape[0], -1), dx * channels, dy, fill, out.reshape(size[0], -1))
    return out


def shifted_mask(mask: NDArray[np.uint8], dx: int, dy: int, size: tuple[int, int]) -> NDArray[np.uint8]:
    """The same of a mask, 0 where it has no pixel."""
    return np.asarray(shifted(mask.astype(np.float32), dx, dy, size, 0.0), np.uint8)
