"""The whole frame at a glance: whether it still shows the scene that was tracked, or is blank or another scene.

What is tracked in a window knows nothing of the rest of the frame. Where all of the frame has changed at once, the
window must not be explained by motion: a black frame, noise, a cut. Two thumbnails are compared by their correlation,
so that lights may change; a few shifts are tried, so that the camera may move. Over a plain ground that tells little:
there the deviation of the pixels within each cell tells noise from the scene, and what is missing an even gray.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray

from ._native import kernels
from .frames import Frame, crop
from .validation import Shape

__all__ = ["Overview", "blank", "overview", "same_scene"]

Overview = Annotated[NDArray[np.float32], Shape(2, 24, 32)]
"""Gray thumbnail of a frame, and the deviation of the pixels within each cell; gray levels."""

_SIZE = (32, 24)  # cells across and down
_SAMPLES = 6  # pixels looked at across a cell, at most
_THINNED = 3  # of them, one in so many across and down tells the deviation
_SHIFT = 2  # cells that the camera may move from frame to frame
_MOST_SHIFT = 6  # after an interruption
_FRAMES_PER_SHIFT = 4  # frames of interruption that allow one cell more
_DEARER = 0.04  # by which the correlation asked for rises with each cell more: chance has more tries
_CORRELATION = 0.55  # real video, neighbouring frames: least .54, 22 sequences; between sequences: 95 % below .50
_PLAINLY = 0.9  # correlation at rest from which no shift is tried
_CHANGE = 5.0  # gray levels: where half of the cells differ by less, it is no other scene
_ROUGHER, _ROUGHNESS = 3.0, 4.0  # factor of the median deviation within cells, and what is added to it, gray levels
_EVEN, _UNEVEN = 1.0, 4.0  # deviation of a thumbnail: of one that shows nothing, and of one that shows something


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
    seen = np.empty((2, *_SIZE[::-1]), np.float32)
    kernels.overview(samples, _THINNED, seen)
    return seen


def blank(seen: Overview) -> bool:
    """Tell whether a frame shows nothing."""
    return kernels.deviation_of(seen[0]) < _EVEN


def same_scene(before: Overview, now: Overview, frames: int = 1) -> bool:
    """Tell whether two frames may be of one scene, `frames` apart, though light and camera may have changed.

    Examples
    --------
    >>> scene = np.random.default_rng(0).uniform(0, 255, (2, 24, 32)).astype(np.float32)
    >>> same_scene(scene, 0.5 * scene), same_scene(scene, np.zeros_like(scene))
    (True, False)
    """
    (before, rough_before), (now, rough_now) = before, now
    if kernels.median_of(np.abs(now - before)) < _CHANGE:
        rougher = (kernels.median_of(rough_now) + _ROUGHNESS) / (kernels.median_of(rough_before) + _ROUGHNESS)
        emptied = kernels.deviation_of(now) < _EVEN and kernels.deviation_of(before) > _UNEVEN
        return max(rougher, 1.0 / rougher) < _ROUGHER and not emptied
    s = min(_SHIFT + (frames - 1) // _FRAMES_PER_SHIFT, _MOST_SHIFT)
    middle = before[s:-s, s:-s]
    if _correlation(middle, now[s:-s, s:-s]) > _PLAINLY:
        return True
    return float(_correlation(middle, now).max()) > _CORRELATION + _DEARER * (s - _SHIFT)


def _correlation(template: NDArray[np.float32], image: NDArray[np.float32]) -> NDArray[np.float32]:
    template = np.ascontiguousarray(template)
    if kernels.deviation_of(template) < _EVEN:
        return np.zeros((1, 1), np.float32)
    found = cv2.matchTemplate(image, template, cv2.TM_CCOEFF_NORMED)
    return np.asarray(np.where(np.isfinite(found) & (np.abs(found) <= 1.0), found, 0.0), np.float32)
