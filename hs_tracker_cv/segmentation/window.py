"""The window round the object: cutting it out of a frame, moving what is remembered into the next one."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .._native.kernels import segmentation as kernels
from ..frames import Frame, crop
from ..geometry import Box
from . import tuning
from .state import EVEN_LIGHT, Image, Light, Plane, SegmentationState

__all__ = [
    "Picture",
    "Window",
    "cut_window",
    "differences",
    "grab",
    "lattice_step",
    "outside",
    "place_window",
    "shifted",
    "shifted_mask",
    "transformed",
    "translated",
]

_RING = 2  # px more on each side, so that the prefilter's border lies outside the window
_TAPS = cv2.getGaussianKernel(2 * _RING + 1, 0.7).astype(np.float32).ravel()[_RING:]

_BLUE, _GREEN, _RED = np.array((0.114, 0.587, 0.299), np.float32)


class Picture(NamedTuple):
    """A window of a frame, and its gray version."""

    image: Image
    gray: Plane


class Window(NamedTuple):
    """The window of this frame, with its gray version and that of the last frame; its part inside the frame."""

    image: Image
    gray: Plane
    previous: Plane
    inside: NDArray[np.int64]
    colour: bool
    light: Light

    @property
    def native(self) -> kernels.Window:
        """As the kernels have it."""
        return kernels.Window(self.image, self.inside)


def cut_window(state: SegmentationState, frame: Frame) -> Window:
    """Cut this frame's window."""
    h, w = state.odds.shape
    image, gray = grab(frame, state.origin, (h, w), state.step, state.light)
    inside = _inside_rectangle(frame, state.origin, (h, w), state.step)
    image, gray, light = _relit(image, gray, state)
    return Window(image, gray, state.gray, inside, frame.channels == 3, light)


def outside(state: SegmentationState) -> NDArray[np.bool_]:
    """Pixels of the window well outside the last box."""
    x0, y0, x1, y1 = _object_rectangle(state)
    beside = np.ones(state.odds.shape, bool)
    beside[y0:y1, x0:x1] = False
    return beside


def _object_rectangle(state: SegmentationState) -> tuple[int, int, int, int]:
    """(x0, y0, x1, y1) of the last box and what is close to it, window px, end exclusive."""
    x, y = (int(state.box[i] - state.origin[i]) for i in (0, 1))
    right, bottom = int(x + state.box[2]) + 3, int(y + state.box[3]) + 3
    return max(x - 2, 0), max(y - 2, 0), max(right, 0), max(bottom, 0)


def _relit(image: Image, gray: Plane, state: SegmentationState) -> tuple[Image, Plane, tuple[float, float, float]]:
    """Window in the light of the first frame, and how much brighter than there each channel is now.

    The median over the pixels round the object of how much brighter each has become: what moves there does not
    change it.
    """
    limits = tuning.UNLIT, tuning.UNLIT_NOW, tuning.SATURATED
    pixels, (b, g, r) = kernels.measure_light(
        image, state.previous, _object_rectangle(state), tuning.LIGHT_STRIDE, limits
    )
    if pixels < tuning.LIGHT_PIXELS or max(abs(b - 1.0), abs(g - 1.0), abs(r - 1.0)) < tuning.SAME_LIGHT:
        return image, gray, state.light
    image, gray = _divided(Picture(image, gray), (b, g, r))
    light = np.clip(np.multiply(state.light, (b, g, r)), tuning.FAINTEST, tuning.BRIGHTEST)
    return image, gray, (float(light[0]), float(light[1]), float(light[2]))


def lattice_step(longest: float, working_size: int) -> int:
    """Frame px per lattice px for an object of that longest side."""
    return max(1, math.ceil(longest / working_size))


def grab(
    frame: Frame, origin: tuple[int, int], size: tuple[int, int], step: int, light: Light = EVEN_LIGHT
) -> Picture:
    """Window of a frame on the lattice: block means of `step` × `step` px, then a 5 × 5 Gaussian of σ 0.7.

    Parameters
    ----------
    frame : Frame
    origin : tuple of int
        Top-left (x, y), lattice px.
    size : tuple of int
        Height and width, lattice px.
    step : int
    light : tuple of float
        What each channel is divided by.

    Returns
    -------
    Picture
        (h, w, 3) and (h, w), float32; of a gray frame the three channels are the same.
    """
    h, w = size
    left, top = (origin[0] - _RING) * step, (origin[1] - _RING) * step
    pixels = crop(frame, left, top, (w + 2 * _RING) * step, (h + 2 * _RING) * step, step=step)
    image, gray = np.empty((h, w, 3), np.float32), np.empty((h, w), np.float32)
    kernels.smooth(pixels.reshape(h + 2 * _RING, w + 2 * _RING, -1), _TAPS, image, gray)
    return _divided(Picture(image, gray), light)


def _divided(picture: Picture, light: Light) -> Picture:
    if light == EVEN_LIGHT:
        return picture
    image = np.minimum(picture.image * (np.float32(1.0) / np.array(light, np.float32)), np.float32(255.0))
    # Not by a matrix product: its last bits depend on the build of BLAS.
    gray: Plane = image[:, :, 0] * _BLUE + image[:, :, 1] * _GREEN + image[:, :, 2] * _RED
    return Picture(image, gray)


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
        reach = margin + max(abs(speed) - tuning.SUDDEN, 0.0)  # to both sides: it may turn back
        low = max(math.floor(start - reach), -tuning.BEYOND_FRAME)
        high = min(math.ceil(start + length + reach), math.ceil(limit) + tuning.BEYOND_FRAME)
        least = tuning.LEAST_WINDOW
        if high - low < least:  # the object has left: keep looking at the nearest edge
            low, high = (low, low + least) if start < limit / 2 else (high - least, high)
        spans.append((low, -((low - high) // tuning.WINDOW_UNIT) * tuning.WINDOW_UNIT))
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
    kernels.resample(source, inverse, fill is None, 0.0 if fill is None else fill, out)
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


def differences(image: Image, template: Image, mask: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Root mean square difference of a template from each place of an image."""
    masks = np.repeat(mask[:, :, np.newaxis].astype(np.float32), 3, axis=2)
    squares = cv2.matchTemplate(
        np.ascontiguousarray(image), np.ascontiguousarray(template), cv2.TM_SQDIFF, mask=masks
    )
    return np.asarray(np.sqrt(np.maximum(squares, 0.0) / max(float(masks.sum()), 1.0)), np.float32)


def shifted(array: NDArray[np.float32], dx: int, dy: int, size: tuple[int, int], fill: float) -> NDArray[np.float32]:
    """Copy an array into a window whose pixel (i, j) is the array's (i + dx, j + dy); `fill` where it has none."""
    channels = math.prod(array.shape[2:])
    out = np.empty((*size, *array.shape[2:]), np.float32)
    kernels.shift(array.reshape(array.shape[0], -1), dx * channels, dy, fill, out.reshape(size[0], -1))
    return out


def shifted_mask(mask: NDArray[np.uint8], dx: int, dy: int, size: tuple[int, int]) -> NDArray[np.uint8]:
    """The same of a mask, 0 where it has no pixel."""
    return np.asarray(shifted(mask.astype(np.float32), dx, dy, size, 0.0), np.uint8)


def window_box(origin: tuple[int, int], size: tuple[int, ...], step: int) -> Box:
    """Where a window of the lattice is in the frame, px."""
    return Box(float(origin[0] * step), float(origin[1] * step), float(size[1] * step), float(size[0] * step))
