"""The correlation filter: its channels, its response and what it learns."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiling import kernel, larger, part, root, smaller
from .common import Bins, Image, Plane, Row


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
