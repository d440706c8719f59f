"""Compiled kernels of the propagation mode: patch sampling, orientations, and the robust fit of a flow field.

Arrays in, arrays out; no checks, no options: :mod:`~hs_tracker_cv.propagation` and
:mod:`~hs_tracker_cv.anchor` call them with C-contiguous float32 arrays.
"""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from .compiling import kernel, larger, local, part, root, smaller

__all__ = [
    "carry",
    "correlation",
    "fit_motion",
    "foreground",
    "misfit",
    "mix",
    "normalise",
    "orientations",
    "peak",
    "register",
    "residual_weights",
    "respond",
    "sample",
    "sample_turned",
]

Image = Annotated[NDArray[np.float32], 3]
Plane = Annotated[NDArray[np.float32], 2]
Bins = Annotated[NDArray[np.int32], 2]
Row = Annotated[NDArray[np.float32], 1]
Integers = Annotated[NDArray[np.int64], 1]
Numbers = Annotated[NDArray[np.float64], 1]

_BINS = 512
_BINS_PER_PX = 64.0
_histogram = local(_BINS)

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


def orientations(gray: NDArray[np.float32], out: NDArray[np.float32]) -> None:
    """Strength of the edges in four directions, in cells of 2 × 2 pixels, against that of the surroundings.

    With the gradient (x, y) of length r, a pixel adds the positive and the negative part of (x² − y²) / r and of
    2xy / r to its cell: so an edge and its negative are the same, and a small turn changes little. A cell is divided
    by the root of the mean square in the 3 × 3 cells round it plus a floor, and limited to 1, as in N. Dalal and
    B. Triggs, "Histograms of oriented gradients for human detection", CVPR 2005.

    Parameters
    ----------
    gray : ndarray, shape (2 h, 2 w), float32
        0–255.
    out : ndarray, shape (4, h, w), float32
        Receives the channels, of zero mean each.
    """
    _orientations(gray, np.empty(out.shape[1:], np.float32), out)


@kernel()
def _orientations(gray: Plane, energy: Plane, out: Image) -> None:
    """Edges by direction: as `orientations`, with room to work in."""
    _, rows, columns = out.shape
    bottom, end = gray.shape[0] - 1, gray.shape[1] - 1
    total = 0.0
    for i in range(rows):
        for j in range(columns):
            a = b = c = d = np.float32(0.0)
            for k in range(4):
                y, x = 2 * i + (k >> 1), 2 * j + (k & 1)
                gx = gray[y, smaller(x + 1, end)] - gray[y, larger(x - 1, 0)]
                gy = gray[smaller(y + 1, bottom), x] - gray[larger(y - 1, 0), x]
                length = root(gx * gx + gy * gy) + np.float32(1e-6)
                straight = (gx * gx - gy * gy) / length
                diagonal = np.float32(2.0) * gx * gy / length
                a += larger(straight, np.float32(0.0))
                b += larger(-straight, np.float32(0.0))
                c += larger(diagonal, np.float32(0.0))
                d += larger(-diagonal, np.float32(0.0))
            out[0, i, j], out[1, i, j], out[2, i, j], out[3, i, j] = a, b, c, d
            energy[i, j] = a * a + b * b + c * c + d * d
            total += energy[i, j]
    floor = np.float32(0.3 * root(total / (rows * columns)) + 4.0)
    for i in range(rows):
        up, down = larger(i - 1, 0), smaller(i + 1, rows - 1)
        for j in range(columns):
            left, right = larger(j - 1, 0), smaller(j + 1, columns - 1)
            near = (
                energy[up, left] + energy[up, j] + energy[up, right]
                + energy[i, left] + energy[i, j] + energy[i, right]
                + energy[down, left] + energy[down, j] + energy[down, right]
            ) / np.float32(9.0)  # fmt: skip
            share = np.float32(1.0) / root(near + floor * floor)
            for k in range(4):
                out[k, i, j] = smaller(out[k, i, j] * share, np.float32(1.0))
    for k in range(4):
        total = 0.0
        for i in range(rows):
            for j in range(columns):
                total += out[k, i, j]
        mean = np.float32(total / (rows * columns))
        for i in range(rows):
            for j in range(columns):
                out[k, i, j] -= mean


def residual_weights(
    a: NDArray[np.float32],
    b: NDArray[np.float32],
    flow: NDArray[np.float32],
    prior: NDArray[np.float32],
    weight: NDArray[np.float32],
) -> None:
    """Weight of each pixel in the fit: textured, and explained by the flow.

    ``weight = prior * G / (G + 30) / (1 + (res / 8)²)²`` with G the squared gradient of `a` and res the 3 × 3
    mean of ``|b(x + flow) - a|``.

    Parameters
    ----------
    a, b : ndarray, shape (H, W), float32
        Normalised patches.
    flow : ndarray, shape (H, W, 2), float32
        Flow from `a` to `b`, samples.
    prior : ndarray, shape (H, W), float32
    weight : ndarray, shape (H, W), float32
        Receives the weights.
    """
    _residual_weights(a, b, flow, prior, np.empty_like(a), weight)


@kernel()
def _residual_weights(a: Plane, b: Plane, flow: Image, prior: Plane, error: Plane, weight: Plane) -> None:
    """Weigh pixels: as `residual_weights`, with room to work in."""
    height, width = a.shape
    for y in range(height):
        for x in range(width):
            px = smaller(larger(x + flow[y, x, 0], 0.0), width - 1.0)
            py = smaller(larger(y + flow[y, x, 1], 0.0), height - 1.0)
            ix, iy = smaller(np.int64(px), width - 2), smaller(np.int64(py), height - 2)
            fx, fy = px - ix, py - iy
            top = b[iy, ix] + fx * (b[iy, ix + 1] - b[iy, ix])
            bottom = b[iy + 1, ix] + fx * (b[iy + 1, ix + 1] - b[iy + 1, ix])
            error[y, x] = abs(top + fy * (bottom - top) - a[y, x])
    for y in range(height):
        up, down = larger(y - 1, 0), smaller(y + 1, height - 1)
        for x in range(width):
            left, right = larger(x - 1, 0), smaller(x + 1, width - 1)
            res = (
                error[up, left] + error[up, x] + error[up, right]
                + error[y, left] + error[y, x] + error[y, right]
                + error[down, left] + error[down, x] + error[down, right]
            ) / 9.0  # fmt: skip
            gx = 0.5 * (a[y, right] - a[y, left])
            gy = 0.5 * (a[down, x] - a[up, x])
            strength = gx * gx + gy * gy
            fair = 1.0 + (res / 8.0) * (res / 8.0)
            weight[y, x] = prior[y, x] * strength / (strength + 30.0) / (fair * fair)


@kernel()
def fit_motion(flow: Image, weight: Plane, turning: float, motion: Numbers) -> None:
    """Fit ``u = tx + sx X - r Y, v = ty + sy Y + r X`` to a flow field by iteratively re-weighted least squares.

    X, Y are measured from the patch centre, in samples. Eight rounds; every second pixel; Geman–McClure weights
    with the scale set by the median residual.

    Parameters
    ----------
    flow : ndarray, shape (H, W, 2), float32
        Samples.
    weight : ndarray, shape (H, W), float32
        Prior weights, not negative.
    turning : float
        1, or 0 to leave r at 0.
    motion : ndarray, shape (7,), float64
        Receives tx, ty, sx, sy, the isotropic scale s, the median residual (samples) and the rotation r (radians
        from x towards y).
    """
    height, width = weight.shape
    mx, my = 0.5 * (width - 1), 0.5 * (height - 1)
    histogram = _histogram()
    tx, ty, sx, sy, scale, median, turn_rate = 0.0, 0.0, 0.0, 0.0, 0.0, 8.0, 0.0
    for turn in range(8):
        n = xu = yv = xv = yu = u1 = v1 = xw = yw = xx = yy = 1e-9
        limit = 1.5 * larger(0.05, 1.48 * median)
        for i in range(_BINS):
            histogram[i] = 0.0
        for y in range(turn & 1, height, 2):
            for x in range(0, width, 2):
                w = weight[y, x]
                if w <= 0.0:
                    continue
                px, py = x - mx, y - my
                u, v = flow[y, x, 0], flow[y, x, 1]
                if turn > 0:
                    du, dv = u - tx - scale * px + turn_rate * py, v - ty - scale * py - turn_rate * px
                    square = du * du + dv * dv
                    fair = 1.0 + square / (limit * limit)
                    histogram[smaller(np.int64(root(square) * _BINS_PER_PX), _BINS - 1)] += w
                    w /= fair * fair
                n += w
                xw += w * px
                yw += w * py
                xx += w * px * px
                yy += w * py * py
                u1 += w * u
                v1 += w * v
                xu += w * px * u
                yv += w * py * v
                xv += w * px * v
                yu += w * py * u
        cxx, cyy = xx - xw * xw / n, yy - yw * yw / n
        cxu, cyv = xu - xw * u1 / n, yv - yw * v1 / n
        sx, sy = cxu / (cxx + 1e-6), cyv / (cyy + 1e-6)
        scale = (cxu + cyv) / (cxx + cyy + 1e-6)
        turn_rate = turning * (xv - xw * v1 / n - yu + yw * u1 / n) / (cxx + cyy + 1e-6)
        tx, ty = (u1 - scale * xw + turn_rate * yw) / n, (v1 - scale * yw - turn_rate * xw) / n
        if turn > 0:
            half = 0.0
            for i in range(_BINS):
                half += histogram[i]
            half *= 0.5
            running = 0.0
            i = 0
            while i < _BINS - 1 and running + histogram[i] < half:
                running += histogram[i]
                i += 1
            median = (i + 0.5) / _BINS_PER_PX
        else:
            median = 1.0
    motion[0], motion[1], motion[2], motion[3], motion[4], motion[5] = tx, ty, sx, sy, scale, median
    motion[6] = turn_rate


@kernel()
def misfit(flow: Image, motion: Numbers, square: Plane) -> None:
    """Squared distance of a flow field from a fitted motion.

    Parameters
    ----------
    flow : ndarray, shape (H, W, 2), float32
    motion : ndarray, shape (7,), float64
        From :func:`fit_motion`.
    square : ndarray, shape (H, W), float32
        Receives the squared distance, samples².
    """
    height, width = square.shape
    mx, my = 0.5 * (width - 1), 0.5 * (height - 1)
    for y in range(height):
        for x in range(width):
            du = flow[y, x, 0] - motion[0] - motion[4] * (x - mx) + motion[6] * (y - my)
            dv = flow[y, x, 1] - motion[1] - motion[4] * (y - my) - motion[6] * (x - mx)
            square[y, x] = du * du + dv * dv


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


@kernel()
def correlation(a: Plane, b: Plane, weights: Plane) -> float:
    """Weighted normalised cross-correlation of two patches, −1 to 1."""
    height, width = a.shape
    total = first = second = 1e-30
    for y in range(height):
        for x in range(width):
            total += weights[y, x]
            first += weights[y, x] * a[y, x]
            second += weights[y, x] * b[y, x]
    first /= total
    second /= total
    aa = bb = ab = 0.0
    for y in range(height):
        for x in range(width):
            one, two, weight = a[y, x] - first, b[y, x] - second, weights[y, x]
            aa += weight * one * one
            bb += weight * two * two
            ab += weight * one * two
    return float(ab / root(aa * bb + 1e-6))


@kernel()
def foreground(window: Image, likelihood: Row, bins: Bins, out: Plane) -> None:
    """Likelihood of the object's colours in each sample of a window, and the samples' bins.

    Parameters
    ----------
    window : ndarray, shape (H, W, C), float32
        0–255.
    likelihood : ndarray, shape (bins,), float32
        Of 64 bins of gray or 16³ of colour.
    bins : ndarray, shape (H, W), int32
        Receives the bins.
    out : ndarray, shape (H, W), float32
        Receives the mean likelihood in 3 × 3 samples, the border reflected.
    """
    height, width, channels = window.shape
    for y in range(height):
        for x in range(width):
            if channels == 1:
                bins[y, x] = smaller(np.int32(window[y, x, 0] * np.float32(0.25)), np.int32(63))
            else:
                blue, green, red = np.int32(window[y, x, 0]), np.int32(window[y, x, 1]), np.int32(window[y, x, 2])
                bins[y, x] = (
                    (smaller(blue >> 4, np.int32(15)) << 8)
                    + (smaller(green >> 4, np.int32(15)) << 4)
                    + smaller(red >> 4, np.int32(15))
                )
    for y in range(height):
        for x in range(width):
            total = np.float32(0.0)
            for j in range(y - 1, y + 2):
                row = abs(j) if j < height else height - 2
                for i in range(x - 1, x + 2):
                    total += likelihood[np.int64(bins[row, abs(i) if i < width else width - 2])]
            out[y, x] = total / np.float32(9.0)


@part()
def _halved(plane: Any, y: int, x: int) -> Any:
    """Mean of 2 × 2 samples."""
    total = plane[2 * y, 2 * x] + plane[2 * y + 1, 2 * x]
    return np.float32(0.25) * (total + (plane[2 * y, 2 * x + 1] + plane[2 * y + 1, 2 * x + 1]))


@kernel()
def carry(
    kept: Plane,
    flow: Image,
    previous: Plane,
    now: Plane,
    weight: Plane,
    belongs: Plane,
    place: Numbers,
    held: Image,
    out: Plane,
) -> None:
    """Move what is kept of the object with the flow; drop what has changed and what moves with the surroundings.

    Parameters
    ----------
    kept : ndarray, shape (h, w), float32
        At half the resolution of the patches.
    flow : ndarray, shape (2 h, 2 w, 2), float32
        From the last patch to this frame's, samples.
    previous : ndarray, shape (2 h, 2 w), float32
        The last patch.
    now : ndarray, shape (h, w), float32
        The patch where the result is wanted, halved.
    weight, belongs : ndarray, shape (2 h, 2 w), float32
        How much a sample says, and its share of "moves with the object"; `belongs` of 0 × 0 if that is not known.
    place : ndarray, shape (6,), float64
        Where the result's middle is in this frame's patch, and its x axis there, halved samples (4); differences of
        the patches up to which nothing has changed and from which all has (2).
    held : ndarray, shape (2, h, w), float32
        Workspace.
    out : ndarray, shape (h, w), float32
        Receives the map, 0–1.
    """
    rows, columns = kept.shape
    for y in range(rows):
        for x in range(columns):
            held[1, y, x] = _halved(previous, y, x)
            held[0, y, x] = kept[y, x]
            if belongs.shape[0] > 0:
                textured = np.float32(0.0)
                for k in range(4):
                    one = weight[2 * y + (k >> 1), 2 * x + (k & 1)]
                    textured += np.float32(0.25) * one / (one + np.float32(0.1))
                foreign = larger(np.float32(1.0) - np.float32(2.0) * _halved(belongs, y, x), np.float32(0.0))
                held[0, y, x] *= np.float32(1.0) - textured * foreign
    same, changed = place[4], place[5]
    for y in range(rows):
        for x in range(columns):
            along, down = x - 0.5 * (columns - 1), y - 0.5 * (rows - 1)
            px = place[0] + place[2] * along - place[3] * down - 0.5 * flow[2 * y + 1, 2 * x + 1, 0]
            py = place[1] + place[2] * down + place[3] * along - 0.5 * flow[2 * y + 1, 2 * x + 1, 1]
            px = smaller(larger(px, 0.0), columns - 1.001)
            py = smaller(larger(py, 0.0), rows - 1.001)
            ix, iy = np.int64(px), np.int64(py)
            fx, fy = px - ix, py - iy
            moved = before = 0.0
            for k in range(2):
                one = held[k, iy, ix] + fx * (held[k, iy, ix + 1] - held[k, iy, ix])
                two = held[k, iy + 1, ix] + fx * (held[k, iy + 1, ix + 1] - held[k, iy + 1, ix])
                moved = before
                before = one + fy * (two - one)
            unchanged = (changed - abs(before - now[y, x])) / (changed - same)
            out[y, x] = moved * smaller(larger(unchanged, 0.0), 1.0)


@kernel()
def respond(numerator: Image, spectrum: Image, energy: Plane, floor: float, out: Plane) -> None:
    """Spectrum of a correlation filter's response: Σ numerator · spectrum over the channels / (energy + floor).

    Parameters
    ----------
    numerator, spectrum : ndarray, shape (C, h, 2 w), float32
        Real and imaginary parts in turn.
    energy : ndarray, shape (h, w), float32
    floor : float
    out : ndarray, shape (h, 2 w), float32
    """
    channels = numerator.shape[0]
    height, width = energy.shape
    for y in range(height):
        for x in range(2 * width):
            out[y, x] = 0.0
        for c in range(channels):
            for x in range(width):
                a, b = numerator[c, y, 2 * x], numerator[c, y, 2 * x + 1]
                p, q = spectrum[c, y, 2 * x], spectrum[c, y, 2 * x + 1]
                out[y, 2 * x] += a * p - b * q
                out[y, 2 * x + 1] += a * q + b * p
        for x in range(width):
            share = np.float32(1.0) / (energy[y, x] + np.float32(floor))
            out[y, 2 * x] *= share
            out[y, 2 * x + 1] *= share


@kernel()
def mix(
    numerator: Image, energy: Plane, target: Plane, spectrum: Image, rate: float, mixed: Image, power: Plane
) -> None:
    """Mix one more spectrum into a correlation filter.

    Parameters
    ----------
    numerator, spectrum : ndarray, shape (C, h, 2 w), float32
        Real and imaginary parts in turn.
    energy : ndarray, shape (h, w), float32
    target : ndarray, shape (h, 2 w), float32
        Transform of the wanted response.
    rate : float
        0–1.
    mixed, power : ndarray
        Receive the new numerator and energy.
    """
    channels = numerator.shape[0]
    height, width = energy.shape
    new, old = np.float32(rate), np.float32(1.0 - rate)
    for y in range(height):
        for x in range(width):
            power[y, x] = old * energy[y, x]
        for c in range(channels):
            for x in range(width):
                a, b = new * target[y, 2 * x], new * target[y, 2 * x + 1]
                p, q = spectrum[c, y, 2 * x], spectrum[c, y, 2 * x + 1]
                mixed[c, y, 2 * x] = old * numerator[c, y, 2 * x] + a * p + b * q
                mixed[c, y, 2 * x + 1] = old * numerator[c, y, 2 * x + 1] + b * p - a * q
                power[y, x] += new * (p * p + q * q)


@part()
def _vertex(left: float, middle: float, right: float) -> float:
    """Where a parabola through three samples is highest, from the middle one, −½ to ½."""
    curve = left - 2.0 * middle + right
    return 0.0 if curve >= 0.0 else smaller(larger(0.5 * (left - right) / curve, -0.5), 0.5)


@kernel()
def peak(
    response: Plane, across: Plane, down: Plane, aside: float, below: float, penalty: float, faded: Plane
) -> tuple[float, float, float, float]:
    """Highest point of a response less a penalty for distance, by parabolas between the samples.

    Parameters
    ----------
    response : ndarray, shape (h, w), float32
        Zero displacement is at ``[h // 2, w // 2]``.
    across, down : ndarray, shape (h, w), float32
        Displacements in box sizes; `aside` and `below` are added.
    penalty : float
        Taken off at one box size.
    faded : ndarray, shape (h, w), float32
        Workspace.

    Returns
    -------
    Displacement (dx, dy) from the centre, samples; height less the penalty; the response at the nearest sample.
    """
    height, width = response.shape
    row, column = 0, 0
    for y in range(height):
        for x in range(width):
            dx, dy = across[y, x] + np.float32(aside), down[y, x] + np.float32(below)
            faded[y, x] = response[y, x] - np.float32(penalty) * (dx * dx + dy * dy)
            if faded[y, x] > faded[row, column]:
                row, column = y, x
    right, lower = 1.0 * (column - width // 2), 1.0 * (row - height // 2)
    if column > 0 and column < width - 1:
        right += _vertex(faded[row, column - 1], faded[row, column], faded[row, column + 1])
    if row > 0 and row < height - 1:
        lower += _vertex(faded[row - 1, column], faded[row, column], faded[row + 1, column])
    return right, lower, float(faded[row, column]), float(response[row, column])


@kernel()
def register(
    a: Plane, b: Plane, flow: Image, prior: Plane, turning: float, error: Plane, weight: Plane, motion: Numbers
) -> None:
    """Weigh the pixels of a flow field and fit its motion: :func:`residual_weights`, then :func:`fit_motion`."""
    _residual_weights(a, b, flow, prior, error, weight)
    fit_motion(flow, weight, turning, motion)
