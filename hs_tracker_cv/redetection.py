"""Where in the whole frame something new has the colours of the object that was lost.

While the object is out of sight, every n-th pixel of the frame is compared with the frame in which it went. What has
changed since and has colours of the object, hardly any of anything else, is where it comes back: long before enough
of it is seen for its appearance to be compared. Something else that comes by has changed too, but has other colours.
Nothing is seen in this way when the camera moves (everything has changed), nor of an object whose colours are those
of the scene.

Where its numbers were chosen: on the vanish suites and more draws of their themes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .frames import Frame, VideoFormat, crop
from .geometry import Box
from .segmentation import SegmentationState, colour
from .validation import LARGEST, Shape, Within

__all__ = ["Redetection", "Scene", "Target", "find", "is_foreign", "scene_without", "target_of"]

_ACROSS = 8  # samples across the shorter side of the object
_MOST = 30_000  # samples of a frame
_FEWEST = 3  # samples across the object below which nothing can be told
_BULK = 0.9  # share of the object in its commonest colours: the others say nothing
_OFTENER = 1.6  # times as common in the object as in the scene: a colour that speaks for the object
_DISTINCT = 0.5  # share of the object in such colours below which they do not tell it from the scene
_CHANGED = 4.0  # difference that counts as change, in units of the noise
_LEAST_CHANGE = 12.0  # the same, gray levels
_RESTLESS = 0.25  # share of the frame changed from which it is the camera that has moved
_SHARE = 0.15  # of the object that must be seen
_PURITY = 0.9  # share of what has changed there that has its colours, against that of the object itself
_FOREIGN = 0.8  # the same, below which it is something else
_NEW = 0.05  # share of a box changed from which that tells
_SAME = 0.85  # Bhattacharyya coefficient of two histograms from which they are the same object's
_SLOWLY = 0.98  # share of its size that an object keeps from one frame to the next
_ALIKE = (0.7, 0.15)  # the same coefficient from which a small part may be the object's, and how much more for all
_PRESENT = 0.5  # of the object's telling colours that must be in a box in which nothing has changed


_Extent = Annotated[float, Within(1e-3, 1e15)]


class Target(NamedTuple):
    """What an object is known by.

    Parameters
    ----------
    colours : ndarray, shape (bins,), float32
        Its histogram.
    extent : tuple of float
        Width and height, frame px, and area, frame px².
    noise : float
        Of the video, gray levels.
    """

    colours: Annotated[NDArray[np.float32], Shape(colour.BINS)]
    extent: tuple[_Extent, _Extent, _Extent]
    noise: float


@dataclass(frozen=True)
class Scene:
    """A frame without the object, and by what colours it will be known.

    Parameters
    ----------
    target : Target
    samples : ndarray, shape (h, w, C), float32
        Every `step`-th pixel.
    step : int
        Frame px.
    telling : ndarray, shape (bins,), uint8
        1 for colours that speak for the object.
    distinct : float
        Share of the object in such colours.
    """

    target: Target
    samples: Annotated[NDArray[np.float32], Shape("scene h", "scene w", "channels")]
    step: Annotated[int, Within(1, LARGEST)]
    telling: Annotated[NDArray[np.uint8], Shape(colour.BINS)]
    distinct: Annotated[float, Within(_DISTINCT, 1.01)]

    def lengths(self, video: VideoFormat) -> dict[str, int]:
        """Rows and columns of the samples of a frame of the video, by name."""
        rows, columns = (len(range(self.step // 2, side, self.step)) for side in (video.height, video.width))
        return {"scene h": rows, "scene w": columns}


class Redetection(NamedTuple):
    """Something that may be the object: the box of what is seen of it (frame px), and the share that is, 0–1."""

    box: Box
    share: float


def target_of(state: SegmentationState, known: Target | None) -> Target | None:
    """What is known of the object after a frame in which all of it is seen.

    Its colours change slowly. If they are suddenly others, it is another object, and what was `known` stays; so it
    does when the object, gone as soon as it was drawn, has left no shape. It shrinks slowly, too: an object that goes
    out of sight seems to shrink fast.
    """
    colours, k = state.colours[0], state.step
    area = float(np.count_nonzero(state.shape > 0.5)) * k**2
    if area == 0.0 or (known is not None and float(np.sqrt(colours * known.colours).sum()) < _SAME):
        return known
    extent = (state.box[2] * k, state.box[3] * k, area)
    if known is not None:
        width, height, area = (max(new, _SLOWLY * old) for new, old in zip(extent, known.extent, strict=True))
        extent = width, height, area
    return Target(colours, extent, state.noise)


def scene_without(frame: Frame, target: Target) -> Scene | None:
    """Take in the frame in which the object was lost.

    Returns
    -------
    Scene or None
        None when its colours do not tell it from the scene, or it is too small for a look at every n-th pixel.
    """
    side = min(target.extent[:2])
    step = max(1, round(side / _ACROSS), math.ceil(math.sqrt(frame.width * frame.height / _MOST)))
    if side < _FEWEST * step:
        return None
    samples = _samples(frame, step)
    colours = target.colours
    scene = _histogram(_bins(samples))
    telling = (colours >= _least_of(colours, _BULK)) & (colours > _OFTENER * scene)
    distinct = float(colours[telling].sum())
    if distinct < _DISTINCT:
        return None
    return Scene(target, samples, step, telling.astype(np.uint8), distinct)


def find(scene: Scene, frame: Frame) -> Redetection | None:
    """Look for the object in a frame; None when nothing like it is seen."""
    changes = _changes(scene, frame)
    if changes is None:
        return None
    changed, bins = changes
    alike = changed & scene.telling[bins]
    step = scene.step
    across, down = (max(1, round(side / step)) for side in scene.target.extent[:2])
    counts, of_all = (
        cv2.boxFilter(plane, cv2.CV_32F, (across, down), normalize=False, borderType=cv2.BORDER_CONSTANT)
        for plane in (alike, changed)
    )
    _, most, _, (x, y) = cv2.minMaxLoc(counts)
    share = most * step**2 / (scene.target.extent[2] * scene.distinct)
    if share < _SHARE or most < _PURITY * scene.distinct * float(of_all[y, x]):
        return None
    left, top = max(x - across // 2, 0), max(y - down // 2, 0)
    window = np.s_[top : y - down // 2 + down, left : x - across // 2 + across]
    colours = _histogram(bins[window][changed[window] != 0])
    least, more = _ALIKE
    if float(np.sqrt(colours * scene.target.colours).sum()) < least + more * min(share, 1.0):
        return None
    i, j, w, h = cv2.boundingRect(alike[window])
    sides = (float(side * step) for side in (left + i, top + j, w, h))
    return Redetection(Box(*sides), min(share, 1.0))


def is_foreign(scene: Scene, frame: Frame, box: Box) -> bool:
    """Tell whether what another tracker takes for the object is something else.

    It is not when what is new in the box has the object's colours, or when all that is in it has, new or not.
    """
    changes = _changes(scene, frame)
    if changes is None:
        return False
    changed, telling = changes[0], scene.telling[changes[1]]
    inside = box.clip(frame.width, frame.height)
    x0, y0, x1, y1 = (round(edge / scene.step) for edge in (inside.x, inside.y, inside.right, inside.bottom))
    changed, telling = changed[y0:y1, x0:x1], telling[y0:y1, x0:x1]
    new, own = int(np.count_nonzero(changed)), int(np.count_nonzero(changed & telling))
    if new > _NEW * changed.size:
        return own < _FOREIGN * scene.distinct * new
    whole = scene.distinct * scene.target.extent[2] / scene.step**2
    return int(np.count_nonzero(telling)) < _PRESENT * whole


def _changes(scene: Scene, frame: Frame) -> tuple[NDArray[np.uint8], NDArray[np.int32]] | None:
    """Which samples have changed, and the bin of each; None when so many have that it is the camera."""
    samples = _samples(frame, scene.step)
    threshold = max(_CHANGED * scene.target.noise, _LEAST_CHANGE)
    different: NDArray[np.bool_] = np.abs(samples - scene.samples).max(axis=2) > threshold
    if np.count_nonzero(different) > _RESTLESS * different.size:
        return None
    return different.view(np.uint8), _bins(samples)


def _histogram(bins: NDArray[np.int32]) -> NDArray[np.float32]:
    counts = np.bincount(bins.ravel(), minlength=colour.BINS).astype(np.float32)
    return np.ascontiguousarray(colour.histograms(np.stack((counts, counts)))[0])


def _least_of(histogram: NDArray[np.float32], share: float) -> float:
    """The height of the least of the bins that together hold a share of a histogram."""
    heights = np.sort(histogram)[::-1]
    return float(heights[np.searchsorted(np.cumsum(heights), share)])


def _samples(frame: Frame, step: int) -> NDArray[np.float32]:
    middle = step // 2
    thinned = replace(frame, pixels=frame.pixels[middle::step, middle::step])
    return crop(thinned, 0, 0, thinned.width, thinned.height)


def _bins(samples: NDArray[np.float32]) -> NDArray[np.int32]:
    """Bin of each sample, as segmentation numbers them; gray counts as three equal channels."""
    levels = samples.astype(np.int32) >> 5
    blue, green, red = (levels[:, :, c % samples.shape[2]] for c in range(3))
    return np.asarray((blue * 8 + green) * 8 + red)
