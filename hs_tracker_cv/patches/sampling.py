"""Patches read from a window, and made comparable."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..compiling import kernel, larger, part, root, smaller
from .common import Image, Integers, Plane, Row

_CONTRAST = 32.0
_NEAR = math.exp(-1.0 / (2.0 * 0.7**2))
_SIDE = _NEAR / (1.0 + 2.0 * _NEAR)  # taps of a Gaussian of σ 0.7 over three samples
_MIDDLE = 1.0 - 2.0 * _SIDE


@part()
def _taps(centre: float, step: float, size: int, first: Any, weight: Any) -> None:
    """Write, for each output sample, the first source pixel and the weights of the pixels it averages.

    A sample is the mean of ``clip(round(step), 1, 4)`` bilinear reads spread evenly over the step, folded into one
    short row of weights, so that columns and rows can be filtered one after the other.
    """
    count, length = weight.shape
    sub = smaller(larger(np.int64(step + 0.5), 1), 4)
    for i in range(count):
        for k in range(length):
            weight[i, k] = 0.0
        middle = centre + (i - 0.5 * (count - 1)) * step
        low = np.int64(np.floor(middle - 0.5 * step * (sub - 1) / sub))
        low = larger(smaller(low, size - length), 0)
        first[i] = low
        for j in range(sub):
            position = smaller(larger(middle + ((j + 0.5) / sub - 0.5) * step, 0.0), size - 1.0)
            whole = smaller(np.int64(position), size - 2)
            part = position - whole
            weight[i, whole - low] += (1.0 - part) / sub
            weight[i, whole + 1 - low] += part / sub


def sample(
    window: NDArray[np.float32], cx: float, cy: float, step_x: float, step_y: float, out: NDArray[np.float32]
) -> None:
    """Sample a patch round a point; beyond the window its border is repeated.

    Parameters
    ----------
    window : ndarray, shape (H, W, C), float32
        At least ``step + 3`` pixels on each side.
    cx, cy : float
        Patch centre in pixel-index coordinates of `window` (pixel 0 is at 0.0).
    step_x, step_y : float
        Distance of neighbouring samples, px.
    out : ndarray, shape (h, w, C), float32
        Receives the patch.
    """
    rows, columns, _ = out.shape
    flat = window.reshape(window.shape[0], -1)
    first_x, first_y = np.empty(columns, np.int64), np.empty(rows, np.int64)
    weight_x = np.empty((columns, int(step_x) + 3), np.float32)
    weight_y = np.empty((rows, int(step_y) + 3), np.float32)
    line = np.empty(flat.shape[1], np.float32)
    _sample(flat, cx, cy, step_x, step_y, first_x, first_y, weight_x, weight_y, line, out)


@kernel()
def _sample(
    window: Plane,
    cx: float,
    cy: float,
    step_x: float,
    step_y: float,
    first_x: Integers,
    first_y: Integers,
    weight_x: Plane,
    weight_y: Plane,
    line: Row,
    out: Image,
) -> None:
    """Sample a patch: as `sample`, with pixels as C columns of the window, and room to work in."""
    rows, columns, channels = out.shape
    _taps(cx, step_x, line.shape[0] // channels, first_x, weight_x)
    _taps(cy, step_y, window.shape[0], first_y, weight_y)
    length_x, length_y = weight_x.shape[1], weight_y.shape[1]
    start, stop = first_x[0] * channels, (first_x[columns - 1] + length_x) * channels
    for i in range(rows):
        for j in range(start, stop):
            line[j] = 0.0
        for k in range(length_y):
            w = weight_y[i, k]
            if w != 0.0:
                y = first_y[i] + k
                for j in range(start, stop):
                    line[j] += w * window[y, j]
        for j in range(columns):
            base = first_x[j] * channels
            for c in range(channels):
                total = np.float32(0.0)
                for k in range(length_x):
                    total += weight_x[j, k] * line[base + k * channels + c]
                out[i, j, c] = total


def sample_turned(
    window: NDArray[np.float32],
    cx: float,
    cy: float,
    step_x: float,
    step_y: float,
    angle: float,
    out: NDArray[np.float32],
) -> None:
    """Sample a patch as :func:`sample` does, turned by `angle` radians, from x towards y.

    A turned patch cannot be filtered by columns and rows, so that this costs several times as much.
    """
    flat = window.reshape(window.shape[0], -1)
    _sample_turned(flat, cx, cy, step_x, step_y, math.cos(angle), math.sin(angle), out)


@kernel()
def _sample_turned(
    window: Plane, cx: float, cy: float, step_x: float, step_y: float, cosine: float, sine: float, out: Image
) -> None:
    """Sample a turned patch, with pixels as C columns of the window."""
    rows, columns, channels = out.shape
    height, width = window.shape[0], window.shape[1] // channels
    sub_x = smaller(larger(np.int64(step_x + 0.5), 1), 4)
    sub_y = smaller(larger(np.int64(step_y + 0.5), 1), 4)
    share = 1.0 / (sub_x * sub_y)
    for i in range(rows):
        for j in range(columns):
            for c in range(channels):
                out[i, j, c] = 0.0
            for k in range(sub_x * sub_y):
                dx = (j - 0.5 * (columns - 1) + (k % sub_x + 0.5) / sub_x - 0.5) * step_x
                dy = (i - 0.5 * (rows - 1) + (k // sub_x + 0.5) / sub_y - 0.5) * step_y
                px = smaller(larger(cx + cosine * dx - sine * dy, 0.0), width - 1.0)
                py = smaller(larger(cy + sine * dx + cosine * dy, 0.0), height - 1.0)
                x, y = smaller(np.int64(px), width - 2), smaller(np.int64(py), height - 2)
                fx, fy = px - x, py - y
                for c in range(channels):
                    left, right = x * channels + c, (x + 1) * channels + c
                    top = window[y, left] + fx * (window[y, right] - window[y, left])
                    low = window[y + 1, left] + fx * (window[y + 1, right] - window[y + 1, left])
                    out[i, j, c] += share * (top + fy * (low - top))


@kernel()
def normalise(gray: Plane, inner: Plane, out: Plane) -> None:
    """Smooth a patch a little; then make its mean zero under the inner weights and its deviation about 32.

    Parameters
    ----------
    gray : ndarray, shape (H, W), float32
    inner : ndarray, shape (H, W), float32
        Weights whose sum is 1.
    out : ndarray, shape (H, W), float32
        Receives the patch under a Gaussian of σ 0.7 over 3 × 3 samples (the border reflected), less its mean, times
        32 / (deviation + 4).
    """
    height, width = gray.shape
    side, middle = np.float32(_SIDE), np.float32(_MIDDLE)
    mean = square = 0.0
    for y in range(height):
        up, down = abs(y - 1), y + 1 if y + 1 < height else height - 2
        for x in range(width):
            left, right = abs(x - 1), x + 1 if x + 1 < width else width - 2
            before = side * (gray[up, left] + gray[down, left]) + middle * gray[y, left]
            here = side * (gray[up, x] + gray[down, x]) + middle * gray[y, x]
            after = side * (gray[up, right] + gray[down, right]) + middle * gray[y, right]
            value = side * (before + after) + middle * here
            out[y, x] = value
            mean += inner[y, x] * value
    for y in range(height):
        for x in range(width):
            out[y, x] -= np.float32(mean)
            square += inner[y, x] * out[y, x] * out[y, x]
    scale = np.float32(_CONTRAST / (root(larger(square, 0.0)) + 4.0))
    for y in range(height):
        for x in range(width):
            out[y, x] *= scale
