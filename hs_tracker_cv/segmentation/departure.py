"""Whether the object has left a box in which something else sees it.

A box drawn round a thin object holds mostly ground. What carries such a box by what it looks like may stay with that
ground while the object moves on, and be sure of itself. The pixels that were the object's tell: they now show ground.
So do all of them where the object has vanished.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._native.kernels.segmentation import KNOWN
from ..geometry import Box
from . import tuning
from .state import Beginning, Image, SegmentationState
from .window import shifted, translated

__all__ = ["beginning", "has_left", "shows_ground"]


class _Overlay(NamedTuple):
    """The picture of the beginning laid somewhere, and what the window has there; rows and columns of the former."""

    begun: Image
    now: Image
    ground: Image
    known: NDArray[np.bool_]


def beginning(image: Image, box: tuple[float, float, float, float], origin: tuple[int, int]) -> Beginning | None:
    """Keep what is in the box in which an object is begun.

    Parameters
    ----------
    image : ndarray, shape (h, w, 3)
        The window.
    box : tuple of float
        x, y, w, h of the object, lattice px.
    origin : tuple of int
        Top-left of the window, lattice px.

    Returns
    -------
    Beginning or None
        None when no pixel of the box is in the window.
    """
    x, y, w, h = box
    left, top = (max(math.floor(edge) - start, 0) for edge, start in zip((x, y), origin, strict=True))
    right, bottom = (math.ceil(edge) - start for edge, start in zip((x + w, y + h), origin, strict=True))
    part = image[top : max(bottom, 0), left : max(right, 0)]
    if not part.size:
        return None
    return Beginning(part.copy(), (left + origin[0], top + origin[1]), (x + w / 2, y + h / 2))


def has_left(state: SegmentationState, box: Box) -> bool:
    """Tell whether the object has gone from a box that has stayed with the ground.

    Pixels of the first box in whose place known ground looks otherwise were the object's. Where most of them look as
    the ground does, and hardly any as in the first frame only, the object is no longer in `box`. Nothing is told of a
    box that has moved over the ground, nor where the object's place is not uncovered yet.

    Parameters
    ----------
    state : SegmentationState
        After the frame.
    box : Box
        Where something else says that the object is in it, frame px.
    """
    begun, (dx, dy), k = state.begun, state.occlusion.drift, state.step
    if begun is None:
        return False
    x, y = (centre / k - first for centre, first in zip(box.centre, begun.centre, strict=True))
    segment_x, segment_y, w, h = state.box
    moved = segment_x + w / 2 - begun.centre[0] - dx, segment_y + h / 2 - begun.centre[1] - dy
    if math.hypot(x - dx, y - dy) > tuning.STAYED * math.hypot(*moved):
        return False
    unlike = tuning.LEFT_DIFFERENCE * max(state.noise, tuning.LEFT_NOISE)
    ground = translated(state.atlas.image, *state.atlas.offset)
    place = _laid(state, begun, ground, dx, dy)
    own = place.known & (_difference(place.begun, place.ground) > unlike)
    there = _laid(state, begun, ground, x, y)
    told = own & there.known
    as_ground = told & (_difference(there.now, there.ground) < unlike)
    as_begun = told & (_difference(there.now, there.begun) < unlike)
    count, uncovered = np.count_nonzero(told), np.count_nonzero(as_ground & ~as_begun)
    return bool(
        uncovered >= tuning.LEFT_SHARE * told.size
        and np.count_nonzero(as_ground) > tuning.LEFT_TO_GROUND * count
        and np.count_nonzero(as_begun & ~as_ground) < tuning.LEFT_THERE * uncovered
    )


def shows_ground(state: SegmentationState, box: Box) -> bool:
    """Tell whether a box in which something else sees the object shows ground, as it was known before.

    Parameters
    ----------
    state : SegmentationState
        After the frame. What it has learned since it saw the object last may be the object, and is not known ground.
    box : Box
        Frame px.

    Returns
    -------
    bool
        Most of the box is known, and nearly all of that looks as the ground does.
    """
    edges = (box.x, box.y, box.right, box.bottom)
    x0, y0, x1, y1 = (
        max(round(edge / state.step) - first, 0) for edge, first in zip(edges, 2 * state.origin, strict=True)
    )
    inside = np.s_[y0:y1, x0:x1]
    ground = translated(state.atlas.image, *state.atlas.offset)[inside]
    known = state.atlas.counts[0][inside] >= KNOWN + state.occlusion.coasting
    unlike = tuning.LEFT_DIFFERENCE * max(state.noise, tuning.LEFT_NOISE)
    alike = known & (_difference(state.previous[inside], ground) < unlike)
    count = np.count_nonzero(known)
    most = count * state.step**2 > tuning.GROUND_KNOWN * box.area
    return bool(most and np.count_nonzero(alike) > tuning.GROUND_ALIKE * count)


def _laid(state: SegmentationState, begun: Beginning, ground: Image, dx: float, dy: float) -> _Overlay:
    """The picture of the beginning moved by a distance, lattice px; `ground` is the background in the window."""
    (h, w), (left, top) = begun.image.shape[:2], state.origin
    x, y = begun.origin[0] + dx - left, begun.origin[1] + dy - top
    column, row = math.floor(x + 0.5), math.floor(y + 0.5)
    planes = state.previous, ground, state.atlas.counts[0]
    now, ground, known = (shifted(plane, column, row, (h, w), 0.0) for plane in planes)
    return _Overlay(translated(begun.image, x - column, y - row), now, ground, known >= KNOWN)


def _difference(a: Image, b: Image) -> NDArray[np.float32]:
    """Root mean square over the channels, gray levels."""
    return np.asarray(np.sqrt(np.square(a - b).mean(axis=2)), np.float32)
