"""The whole frame at a glance: whether it still shows the scene that was tracked, or is blank or another scene.

What is tracked in a window knows nothing of the rest of the frame. Where all of the frame has changed at once, the
window must not be explained by motion: a black frame, noise, a cut. Two thumbnails are compared by their correlation,
so that lights may change; a few shifts are tried, so that the camera may move.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from .frames import Frame, crop
from .validation import Shape

__all__ = ["Overview", "overview", "same_scene"]

Overview = Annotated[NDArray[np.float32], Shape(24, 32)]
"""Gray thumbnail of a frame, (24, 32), gray levels."""

_SIZE = (32, 24)  # cells across and down
_SAMPLES = 6  # pixels looked at across a cell, at most
_SHIFT = 2  # cells that the camera may move from frame to frame
_MOST_SHIFT = 6  # after an interruption
_DEARER = 0.04  # by which the correlation asked for rises with each cell more: chance has more tries
_CORRELATION = 0.55  # real video, neighbouring frames: least .54, 22 sequences; between sequences: 95 % below .50
_PLAINLY = 0.9  # correlation at rest from which no shift is tried
_CHANGE = 5.0  # gray levels: where half of the cells differ by less, it is no other scene


def overview(frame: Frame) -> Overview:
    """Thumbnail of a frame; it costs the same for any size of frame."""
    steps = (
        max(1, side // (_SAMPLES * cells))
        for side, cells in zip((frame.height, frame.width), _SIZE[::-1], strict=True)
    )
    down, across = steps
    thinned = replace(frame, pixels=frame.pixels[::down, ::across])
    plain = frame.pixels.dtype == np.uint8
    samples = np.ascontiguousarray(thinned.pixels) if plain else crop(thinned, 0, 0, thinned.width, thinned.height)
    cells = cv2.resize(samples, _SIZE, interpolation=cv2.INTER_AREA).reshape(*_SIZE[::-1], -1)
    return np.asarray(cells.mean(axis=2), np.float32)


def blank(thumbnail: Overview) -> bool:
    """Tell whether a frame shows nothing."""
    return float(thumbnail.std()) < 1.0


def same_scene(before: Overview, now: Overview, frames: int = 1) -> bool:
    """Tell whether two thumbnails may be of one scene, `frames` apart, though light and camera may have changed.

    Examples
    --------
    >>> scene = np.random.default_rng(0).uniform(0, 255, (24, 32)).astype(np.float32)
    >>> same_scene(scene, 0.5 * scene), same_scene(scene, np.zeros_like(scene))
    (True, False)
    """
    if float(np.median(np.abs(now - before))) < _CHANGE:
        return True
    s = min(_SHIFT + (frames - 1) // 4, _MOST_SHIFT)
    middle = before[s:-s, s:-s]
    if _correlation(middle, now[s:-s, s:-s]) > _PLAINLY:
        return True
    return float(_correlation(middle, now).max()) > _CORRELATION + _DEARER * (s - _SHIFT)


def _correlation(template: Overview, image: Overview) -> NDArray[np.float32]:
    if blank(template):
        return np.zeros((1, 1), np.float32)
    found = cv2.matchTemplate(image, np.ascontiguousarray(template), cv2.TM_CCOEFF_NORMED)
    return np.asarray(np.where(np.isfinite(found) & (np.abs(found) <= 1.0), found, 0.0), np.float32)
