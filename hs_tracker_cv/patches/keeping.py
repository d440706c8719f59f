"""How alike patches are, and what of the object is still in the box."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiling import kernel, larger, part, root, smaller
from .common import Image, Numbers, Plane


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
