"""Compiled kernels of the propagation mode that look at the frame: the fine patch, and the filter's channels.

Arrays in, arrays out; no checks, no options: :mod:`~hs_tracker_cv.propagation` calls them with C-contiguous float32
arrays. Each is one call for all that is wanted of a place, since between two calls the interpreter has to be waited
for.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiling import kernel, larger, part, root, smaller

__all__ = ["COLOURS", "GRAYS", "Place", "Sight", "fine", "sight"]

F32 = NDArray[np.float32]
Image = Annotated[NDArray[np.float32], 3]
Plane = Annotated[NDArray[np.float32], 2]
Row = Annotated[NDArray[np.float32], 1]
Bins = Annotated[NDArray[np.int32], 2]
Integers = Annotated[NDArray[np.int64], 1]
Numbers = Annotated[NDArray[np.float64], 1]

GRAYS, COLOURS = 64, 4096
"""Bins of the histograms of a gray and of a colour video."""

_CONTRAST = 32.0
_EDGES = 3.0
_SIDE = math.exp(-0.5 / 0.7**2) / (1.0 + 2.0 * math.exp(-0.5 / 0.7**2))
_LN2, _ROOT = math.log(2.0), 2.0**3.5
_NO_IMAGE, _NO_PLANE, _NO_ROW = (np.empty((0,) * ndim, np.float32) for ndim in (3, 2, 1))
_NO_BINS, _NO_SCORES = np.empty((0, 0), np.int32), np.empty(0)

# Constants by name, since a call such as np.float32(1.0) takes a kernel longer to compile.
_ZERO, _ONE, _TWO, _NINE, _LEAST = (np.float32(value) for value in (0.0, 1.0, 2.0, 9.0, 1e-6))

_FAST = {"contract", "reassoc", "nsz", "arcp"}


class Place(NamedTuple):
    """Where a patch is sampled: its centre in pixel-index coordinates, the steps between samples (px), its turn."""

    x: float
    y: float
    step_x: float
    step_y: float
    angle: float


class Sight(NamedTuple):
    """What :func:`sight` sees.

    Parameters
    ----------
    channels : ndarray, shape (5 or 6, h, w), float32
        Of the correlation filter: edges in four directions, log-gray, and the colour likelihood if it is asked for;
        each of zero mean before the window is applied.
    raw : ndarray, shape (h, w, C), float32
        Samples, 0–255; empty if no likelihood is asked for, as the others.
    bins : ndarray, shape (h, w), int32
        Bin of each sample: 64 of gray or 16³ of colour.
    likelihood : ndarray, shape (h, w), float32
        Of the object's colours round each sample, 0–1.
    """

    channels: F32
    raw: F32
    bins: NDArray[np.int32]
    likelihood: F32


def fine(gray: F32, at: Place, inner: F32, templates: F32) -> tuple[F32, NDArray[np.float64]]:
    """Sample, smooth and normalise a patch, and compare it with others.

    Parameters
    ----------
    gray : ndarray, shape (H, W), float32
        At least ``3 step + 3`` pixels on each side; beyond it its border is repeated.
    at : Place
    inner : ndarray, shape (h, w), float32
        Weights of sum 1.
    templates : ndarray, shape (n, h, w), float32
        Of zero mean under the weights, as patches are.

    Returns
    -------
    patch : ndarray, shape (h, w), float32
        Of zero mean under the weights, deviation about 32.
    scores : ndarray, shape (n,), float64
        Correlation with each template under the weights.
    """
    rows, columns = inner.shape
    patch, scores = np.empty((rows, columns), np.float32), np.empty(len(templates))
    raw = np.empty((rows, columns, 1), np.float32)
    first, weight = _room(rows, columns, gray.shape[1], at)
    if at.angle != 0.0:
        _sample_turned(gray, *at[:4], math.cos(at.angle), math.sin(at.angle), raw)
    _look(
        gray, gray, *at, True, first, weight, _NO_IMAGE, raw, raw.ravel(), _NO_PLANE, _NO_BINS, patch.ravel(),
        _NO_PLANE, inner.ravel(), templates.reshape(len(templates), inner.size), _NO_PLANE, scores,
    )  # fmt: skip
    return patch, scores


def sight(colour: F32, gray: F32, at: Place, histograms: F32 | None, window: F32) -> Sight:
    """Sample the window of the correlation filter, and make its channels.

    Parameters
    ----------
    colour : ndarray, shape (H, W, C), float32
        0–255; at least ``step + 3`` pixels on each side; beyond it its border is repeated.
    gray : ndarray, shape (H, W), float32
        The same in gray.
    at : Place
    histograms : ndarray, shape (2, bins), float32, or None
        Shares of the bins of colour in the object and outside of it, if its colours are used.
    window : ndarray, shape (h, w), float32
        Fading weights.
    """
    rows, columns = window.shape
    context, energy = np.empty((2 * rows, 2 * columns, 1), np.float32), np.empty((rows, columns), np.float32)
    raw, bins, shade = _NO_IMAGE, _NO_BINS, _NO_PLANE
    if histograms is not None:
        raw, bins = np.empty((rows, columns, colour.shape[2]), np.float32), np.empty((rows, columns), np.int32)
        shade = np.empty((rows, columns), np.float32)
    channels = np.empty((5 if histograms is None else 6, rows, columns), np.float32)
    flat = colour.reshape(len(colour), -1)
    first, weight = _room(2 * rows, 2 * columns, flat.shape[1], at)
    if at.angle != 0.0:
        cosine, sine = math.cos(at.angle), math.sin(at.angle)
        _sample_turned(gray, at.x, at.y, 0.5 * at.step_x, 0.5 * at.step_y, cosine, sine, context)
        if raw.size:
            _sample_turned(flat, *at[:4], cosine, sine, raw)
    colours = _NO_PLANE if histograms is None else histograms
    _look(
        flat, gray, *at, False, first, weight, raw, context, _NO_ROW, colours, bins, shade.ravel(), energy,
        window.ravel(), _NO_PLANE, channels.reshape(len(channels), -1), _NO_SCORES,
    )  # fmt: skip
    return Sight(channels, raw, bins, shade)


def _room(rows: int, columns: int, width: int, at: Place) -> tuple[NDArray[np.int64], F32]:
    """Room for `_sample` to work in, for patches of up to that size from rows of `width` numbers."""
    taps = columns * (int(3 * at.step_x) + 3) + rows * (int(3 * at.step_y) + 3)
    return np.empty(rows + columns, np.int64), np.empty(taps + width, np.float32)


@part()
def _taps(
    centre: float, step: float, side: float, size: int, count: int, first: Any, at: int, weight: Any, base: int
) -> Any:
    """Write, for each output sample, the first source pixel and the weights of the pixels it averages.

    A sample is the mean of ``clip(round(step), 1, 4)`` bilinear reads spread evenly over the step. If `side` is not
    0, it is smoothed: its two neighbours, mirrored at the ends, get that weight each. All this is folded into one
    short row of weights, the length of which is returned, so that columns and rows can be filtered one after the
    other.
    """
    reach = 1 if side > 0.0 else 0
    length = np.int64((2 * reach + 1) * step) + 3
    sub = smaller(larger(np.int64(step + 0.5), 1), 4)
    half = 0.5 * (count - 1)
    for i in range(count):
        row = base + i * length
        for k in range(length):
            weight[row + k] = 0.0
        low = np.int64(np.floor(centre + (i - reach - half - 0.5 * (sub - 1) / sub) * step))
        low = larger(smaller(low, size - length), 0)
        first[at + i] = low
        row -= low
        for j in range((2 * reach + 1) * sub):
            near = j // sub - reach
            n = count - 1 - abs(count - 1 - abs(i + near))
            share = (1.0 - 2.0 * side if near == 0 else side) / sub
            position = centre + (n - half + (j % sub + 0.5) / sub - 0.5) * step
            position = smaller(larger(position, 0.0), size - 1.0)
            whole = smaller(np.int64(position), size - 2)
            part = position - whole
            weight[row + whole] += (1.0 - part) * share
            weight[row + whole + 1] += part * share
    return length


@part()
def _sample(
    window: Any, cx: float, cy: float, step_x: float, step_y: float, side: float, first: Any, weight: Any, out: Any
) -> None:
    """Sample a patch round a point, with pixels as C columns of the window; `first` and `weight` are room."""
    rows, columns, channels = out.shape
    if rows == 0:
        return
    start = np.int64(0)  # a variable: for each constant that a part is given it is compiled anew
    length_x = _taps(cx, step_x, side, window.shape[1] // channels, columns, first, start, weight, start)
    low = columns * length_x
    length_y = _taps(cy, step_y, side, window.shape[0], rows, first, columns, weight, low)
    line = low + rows * length_y
    start, stop = first[0] * channels, (first[columns - 1] + length_x) * channels
    for i in range(rows):
        for j in range(start, stop):
            weight[line + j] = 0.0
        for k in range(length_y):
            w = weight[low + i * length_y + k]
            if w != 0.0:
                y = first[columns + i] + k
                for j in range(start, stop):
                    weight[line + j] += w * window[y, j]
        for j in range(columns):
            base = line + first[j] * channels
            for c in range(channels):
                total = _ZERO
                for k in range(length_x):
                    total += weight[j * length_x + k] * weight[base + k * channels + c]
                out[i, j, c] = total


@kernel()
def _sample_turned(
    window: Plane, cx: float, cy: float, step_x: float, step_y: float, cosine: float, sine: float, out: Image
) -> None:
    """Sample a turned patch, with pixels as C columns of the window.

    It cannot be filtered by columns and rows, so that this costs several times as much as a straight one.
    """
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


@part()
def _nine(plane: Any, up: int, i: int, down: int, left: int, j: int, right: int) -> Any:
    """Mean of 3 × 3 pixels."""
    top = plane[up, left] + plane[up, j] + plane[up, right]
    middle = plane[i, left] + plane[i, j] + plane[i, right]
    return (top + middle + (plane[down, left] + plane[down, j] + plane[down, right])) / _NINE


@part()
def _logarithm(x: Any) -> Any:
    """Natural logarithm of a number between 8 and 264, which gray levels are: kernels call no C function."""
    whole = 3.5
    for _ in range(4):
        if x >= 16.0:
            x *= 0.5
            whole += 1.0
    s = (x - _ROOT) / (x + _ROOT)  # x is in [8, 16.5); the series is that of the inverse hyperbolic tangent
    q = s * s
    return whole * _LN2 + 2.0 * s * (1.0 + q * (1 / 3 + q * (1 / 5 + q * (1 / 7 + q * (1 / 9 + q / 11)))))


@part(fastmath=_FAST)
def _normalise(raw: Any, inner: Any, templates: Any, out: Any, scores: Any) -> None:
    """Bring a patch to zero mean and deviation 32 under the inner weights, and compare it with the templates."""
    size = out.shape[0]
    middle = 1.0 * raw[size // 2]
    total = square = 0.0
    for i in range(size):
        value = raw[i] - middle
        total += inner[i] * value
        square += inner[i] * value * value
    deviation = root(larger(square - total * total, 0.0))
    factor = _CONTRAST / (deviation + 4.0)
    deviation *= factor
    for i in range(size):
        out[i] = (raw[i] - middle - total) * factor
    for k in range(scores.shape[0]):
        # The means of all of them under these weights are zero.
        both = power = 0.0
        for i in range(size):
            weighted = 1.0 * inner[i] * templates[k, i]
            both += weighted * out[i]
            power += weighted * templates[k, i]
        scores[k] = both / root(power * deviation * deviation + 1e-6)


@kernel(fastmath=_FAST)
def _look(
    colour: Plane,
    gray: Plane,
    cx: float,
    cy: float,
    step_x: float,
    step_y: float,
    angle: float,
    is_fine: bool,
    first: Integers,
    weight: Row,
    raw: Image,
    context: Image,
    flat: Row,
    histograms: Plane,
    bins: Bins,
    shade: Row,
    energy: Plane,
    window: Row,
    templates: Plane,
    out: Plane,
    scores: Numbers,
) -> None:
    """Sample, and make of it a fine patch or the filter's channels: as `fine` or `sight`.

    One kernel for both, as sampling costs as much to compile as either. Turned samples are in `raw` and `context`
    already. A fine patch is smoothed with σ 0.7 samples; `window` then is its inner weights, `flat` the same samples
    as `context`, and `shade` receives the patch.

    With the gradient (x, y) of length r, a pixel adds the positive and the negative part of (x² − y²) / r and of
    2xy / r to its cell of 2 × 2 pixels: so an edge and its negative are the same, and a small turn changes little. A
    cell is divided by the root of the mean square in the 3 × 3 cells round it plus a floor, and limited to 1, as in
    N. Dalal and B. Triggs, "Histograms of oriented gradients for human detection", CVPR 2005.
    """
    if angle == 0.0:
        share = 1.0 if is_fine else 0.5
        _sample(gray, cx, cy, share * step_x, share * step_y, _SIDE if is_fine else 0.0, first, weight, context)
        _sample(colour, cx, cy, step_x, step_y, 0.0, first, weight, raw)
    if is_fine:
        _normalise(flat, window, templates, shade, scores)
        return
    channels, size = out.shape
    rows, columns = energy.shape
    bottom, end = 2 * rows - 1, 2 * columns - 1
    total = 0.0
    for i in range(rows):
        for j in range(columns):
            a = b = c = d = light = _ZERO
            for k in range(4):
                y, x = 2 * i + (k >> 1), 2 * j + (k & 1)
                gx = context[y, smaller(x + 1, end), 0] - context[y, larger(x - 1, 0), 0]
                gy = context[smaller(y + 1, bottom), x, 0] - context[larger(y - 1, 0), x, 0]
                length = root(gx * gx + gy * gy) + _LEAST
                straight = (gx * gx - gy * gy) / length
                diagonal = _TWO * gx * gy / length
                a += larger(straight, _ZERO)
                b += larger(-straight, _ZERO)
                c += larger(diagonal, _ZERO)
                d += larger(-diagonal, _ZERO)
                light += context[y, x, 0]
            cell = i * columns + j
            out[0, cell], out[1, cell], out[2, cell], out[3, cell] = a, b, c, d
            out[4, cell] = _logarithm(0.25 * light + 8.0)
            energy[i, j] = a * a + b * b + c * c + d * d
            total += energy[i, j]
    least = 0.3 * root(total / size) + 4.0
    for i in range(rows):
        up, down = larger(i - 1, 0), smaller(i + 1, rows - 1)
        for j in range(columns):
            near = _nine(energy, up, i, down, larger(j - 1, 0), j, smaller(j + 1, columns - 1))
            part = _ONE / root(near + np.float32(least * least))
            for k in range(4):
                out[k, i * columns + j] = smaller(out[k, i * columns + j] * part, _ONE)
    if channels == 6:
        for i in range(rows):
            for j in range(columns):
                number = 0
                if raw.shape[2] == 1:
                    number = smaller(np.int64(raw[i, j, 0]) >> 2, GRAYS - 1)
                else:
                    for k in range(3):
                        number = 16 * number + smaller(np.int64(raw[i, j, k]) >> 4, 15)
                bins[i, j] = number
                own = histograms[0, number] + 1e-4
                energy[i, j] = own / (own + histograms[1, number] + 1e-4)
        for i in range(rows):
            up, down = abs(i - 1), rows - 1 - abs(rows - 2 - i)
            for j in range(columns):
                value = _nine(energy, up, i, down, abs(j - 1), j, columns - 1 - abs(columns - 2 - j))
                shade[i * columns + j] = value
                out[5, i * columns + j] = value
    for k in range(channels):
        mean = square = 0.0
        for i in range(size):
            value = 1.0 * out[k, i]
            mean += value
            square += value * value
        mean /= size
        deviation = root(larger(square / size - mean * mean, 0.0))
        factor = 1.0 / (deviation + 0.05) if k == 4 else _EDGES
        for i in range(size):
            out[k, i] = (out[k, i] - mean) * factor * window[i]
