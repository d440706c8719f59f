"""The background: where it lies in a frame, and what it looks like there."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .kernels import fill_new, shift
from .state import Atlas, Image, Plane
from .window import shifted

__all__ = ["Background", "Registered", "move", "place"]


class Background(NamedTuple):
    """The atlas registered to this frame, and the camera's translation since the last one (lattice px)."""

    atlas: Atlas
    camera: tuple[float, float]


class Registered(NamedTuple):
    """Where the atlas lies in this frame (lattice px), and how much brighter it is, by `kernels.measure`."""

    offset: tuple[float, float]
    gain: float

    @classmethod
    def of(cls, theta: NDArray[np.float64]) -> Registered:
        """Read it from a motion as the kernels have it; a gain of next to one is one."""
        x, _, _, y, _, _, percent, _ = theta.tolist()
        gain = min(max(1.0 + 0.01 * percent, 0.5), 1.8)
        return cls((x, y), 1.0 if abs(gain - 1.0) <= 0.004 else gain)


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
    size = odds.shape
    picture, counts = shifted(atlas.image, dx, dy, size, 0.0), np.empty((3, *size), np.float32)
    for new, old, fill in zip(counts, atlas.counts, (-1.0, 0.0, 0.0), strict=True):
        shift(old, dx, dy, fill, new)
    if gain != 1.0:
        picture *= np.float32(gain)
    fill_new(counts[0], picture, image, odds)
    return Atlas(picture, counts, atlas.offset)
