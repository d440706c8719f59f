"""The background: how the camera moves over it, and what it looks like where the object is not."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .kernels import FAR_OFF, fill_new, median_flow, open_ground, shift
from .registration import list_points, misfit, refine
from .state import Atlas, Image, Plane
from .window import shifted

__all__ = ["Background", "camera_from_flow", "move", "register"]

_PIXELS = 1000
_FEWEST = 60  # fewer pixels say nothing about the camera


class Background(NamedTuple):
    """The atlas registered to this frame, and the camera's translation since the last one (lattice px)."""

    atlas: Atlas
    camera: tuple[float, float]


def camera_from_flow(
    flow: NDArray[np.float32], near: NDArray[np.uint8], last: tuple[float, float]
) -> tuple[float, float]:
    """Median flow outside the object; exactly zero when it is small, the last one when hardly anything is outside."""
    medians = np.zeros(2)
    n = median_flow(flow, near, np.empty((2, near.size // 16 + 64), np.float32), medians)
    if 16 * n < _FEWEST:
        return last
    u, v = medians
    return (0.0, 0.0) if math.hypot(u, v) < 0.12 else (float(u), float(v))


def register(
    atlas: Atlas,
    image: Image,
    odds: Plane,
    near: NDArray[np.uint8],
    camera: tuple[float, float],
    noise: float,
    inside: NDArray[np.int64],
) -> Background:
    """Find where the atlas lies in this frame, and its brightness; move it there by whole pixels.

    Against the atlas, not the previous frame, so that errors don't add up. "The camera stood still" wins ties:
    otherwise noise slowly blurs the atlas. `odds` of the object say what the atlas may learn where it has nothing.
    """
    h, w, _ = image.shape
    used = np.empty((h, w), np.float32)
    area = open_ground(near, atlas.counts, used)
    grid = np.array((w / 2, h / 2, max(h, w) / 2))
    points = list_points(atlas.image, used, grid, area, _PIXELS)
    still, moved = np.zeros(8), np.zeros(8)
    still[0], still[3] = atlas.offset
    moved[0], moved[3] = atlas.offset[0] + camera[0], atlas.offset[1] + camera[1]
    start = still
    if camera != (0.0, 0.0):
        unmoved = misfit(points, image, still, FAR_OFF, inside)
        if misfit(points, image, moved, FAR_OFF, inside) < unmoved:
            start = moved
    strength = 0.02 * noise * noise
    prior = np.array((strength, 1e6, 1e6, strength, 1e6, 1e6, 1.0, 1e6))
    theta, before, after = refine(points, image, start, prior, 3.0 * noise, FAR_OFF, inside)
    best, cost = start, before
    if after <= before and math.hypot(theta[0] - start[0], theta[3] - start[3]) < 2.0:
        best, cost = theta, after
    if best is not still:
        still[6] = best[6]
        if misfit(points, image, still, FAR_OFF, inside) <= 1.03 * cost + 0.02:
            best = still
    return _place(atlas, best, image, odds)


def _place(atlas: Atlas, theta: NDArray[np.float64], image: Image, odds: Plane) -> Background:
    offset = []
    for new, old in zip((float(theta[0]), float(theta[3])), atlas.offset, strict=True):
        whole = float(round(new))
        offset.append(whole if abs(new - whole) < 0.08 and abs(new - old) < 0.15 else new)
    gain = min(max(1.0 + 0.01 * float(theta[6]), 0.5), 1.8)
    if abs(gain - 1.0) <= 0.004:
        gain = 1.0
    camera = (offset[0] - atlas.offset[0], offset[1] - atlas.offset[1])
    rx, ry = round(offset[0]), round(offset[1])
    placed = Atlas(atlas.image, atlas.counts, (offset[0] - rx, offset[1] - ry))
    return Background(move(placed, -rx, -ry, image, odds, gain), camera)


def move(atlas: Atlas, dx: int, dy: int, image: Image, odds: Plane, gain: float = 1.0) -> Atlas:
    """Atlas in the window of `image`, whose pixel (i, j) is (i + dx, j + dy) of this one, made brighter by `gain`.

    New pixels get the colour of `image`, taken as known, or unseen where the object may be by its `odds`.
    """
    if (dx, dy, gain) == (0, 0, 1.0) and image.shape == atlas.image.shape:
        return atlas
    size = odds.shape
    picture, counts = shifted(atlas.image, dx, dy, size, 0.0), np.empty((3, *size), np.float32)
    for new, old, fill in zip(counts, atlas.counts, (-1.0, 0.0, 0.0), strict=True):
        shift(old, dx, dy, fill, new)
    if gain != 1.0:
        picture *= np.float32(gain)
    fill_new(counts[0], picture, image, odds)
    return Atlas(picture, counts, atlas.offset)
