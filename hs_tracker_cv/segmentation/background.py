"""The background: where it lies in a frame, and what it looks like there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .._native.kernels.segmentation import Ground, move_ground
from . import tuning
from .state import Atlas, Image, Plane

__all__ = ["Background", "Registered", "Theta", "move", "place"]

Theta = tuple[float, float, float, float, float, float, float, float]
"""A motion as the kernels have it."""


class Background(NamedTuple):
    """The atlas registered to this frame, and the camera's translation since the last one (lattice px)."""

    atlas: Atlas
    camera: tuple[float, float]


class Registered(NamedTuple):
    """Where the atlas lies in this frame (lattice px), and how much brighter it is, by `measure_motion`."""

    offset: tuple[float, float]
    gain: float

    @classmethod
    def of(cls, theta: Theta) -> Registered:
        """Read it from a motion as the kernels have it; a gain of next to one is one."""
        x, _, _, y, _, _, percent, _ = theta
        gain = min(max(1.0 + 0.01 * percent, tuning.LEAST_GAIN), tuning.MOST_GAIN)
        return cls((x, y), 1.0 if abs(gain - 1.0) <= tuning.SAME_GAIN else gain)


def place(atlas: Atlas, found: Registered, image: Image, odds: Plane) -> Background:
    """Move the atlas by whole pixels to where it was found; new pixels are taken as in :func:`move`."""
    (x, y), (old_x, old_y) = found.offset, atlas.offset
    rx, ry = round(x), round(y)
    placed = Atlas(atlas.image, atlas.counts, (x - rx, y - ry))
    return Background(move(placed, -rx, -ry, image, odds, found.gain), (x - old_x, y - old_y))


def move(atlas: Atlas, dx: int, dy: int, image: Image, odds: Plane, gain: float = 1.0) -> Atlas:
    """Atlas in the window of `image`, whose pixel (i, j) is (i + dx, j + dy) of this one, made brighter by `gain`.

    New pixels get the colour of `image`, taken as known, or unseen where the object may be by its `odds`.
    """
    if (dx, dy, gain) == (0, 0, 1.0) and image.shape == atlas.image.shape:
        return atlas
    h, w = odds.shape
    picture, counts = np.empty((h, w, 3), np.float32), np.empty((3, h, w), np.float32)
    move_ground(dx, dy, gain, atlas.native, image, odds, Ground(picture, counts))
    return Atlas(picture, counts, atlas.offset)
