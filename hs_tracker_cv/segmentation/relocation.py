"""Finding the object again by what it looked like, after frames in which nothing could be seen of the scene."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from .._native.kernels.segmentation import FAR_OFF, KNOWN
from ..frames import Frame
from ..geometry import Box
from . import background as ground
from . import tuning
from .state import Atlas, Image, Occlusion, Plane, SegmentationParams, SegmentationState
from .window import differences, grab, place_window, shifted, transformed

__all__ = ["relocate"]


class _Appearance(NamedTuple):
    """Object layer of a window, as it is expected to look now."""

    odds: Plane
    shape: Plane
    obj: Image


def relocate(
    state: SegmentationState, frame: Frame, gap: int, params: SegmentationParams
) -> SegmentationState | None:
    """Find the object `gap` frames after it was last seen, by its layer moved and turned as it moved and turned.

    Parameters
    ----------
    state : SegmentationState
        After the last frame in which the scene was seen; left as it is.
    frame : Frame
        The one just seen, of the same scene.
    gap : int
        Frames in between, which showed nothing of it.
    params : SegmentationParams

    Returns
    -------
    SegmentationState or None
        None when the object is not surely seen.
    """
    seen = _turned(state, state.turn * (gap + 1))
    shift, cost = _search(state, seen, frame, gap)
    if cost > tuning.RESIDUAL + tuning.RESIDUAL_FACTOR * state.match_cost:
        return None
    return _moved(state, seen, frame, shift, gap, params)


def _turned(state: SegmentationState, turn: float) -> _Appearance:
    if abs(turn) < tuning.LEAST_TURN:
        return _Appearance(state.odds, state.shape, state.obj)
    x, y = (
        state.box[0] + state.box[2] / 2 - state.origin[0] - 0.5,
        state.box[1] + state.box[3] / 2 - state.origin[1] - 0.5,
    )
    c, s = math.cos(turn), math.sin(turn)
    matrix = (c, -s, x - c * x + s * y, s, c, y - s * x - c * y)
    size = state.odds.shape
    return _Appearance(
        transformed(state.odds, matrix, size, tuning.NEVER),
        transformed(state.shape, matrix, size, 0.0),
        transformed(state.obj, matrix, size),
    )


def _search(state: SegmentationState, seen: _Appearance, frame: Frame, gap: int) -> tuple[tuple[int, int], float]:
    """Translation of the window with the least mean difference from the object layer, lattice px, and that."""
    mask = (seen.odds > 0).astype(np.uint8)
    x, y, w, h = cv2.boundingRect(mask)
    if w < 2 or h < 2:
        return (0, 0), math.inf
    ways = [tuning.REACH_SPEED * abs(v) * (gap + 1) + tuning.REACH_ADDED for v in state.velocity]
    reach = [min(max(tuning.LEAST_REACH, way), tuning.MOST_REACH) for way in ways]
    left, top = state.origin[0] + x - int(reach[0]), state.origin[1] + y - int(reach[1])
    size = (h + 2 * int(reach[1]), w + 2 * int(reach[0]))
    image, _ = grab(frame, (left, top), size, state.step, state.light)
    template, mask = seen.obj[y : y + h, x : x + w], mask[y : y + h, x : x + w]
    step = 2 if min(w, h) >= tuning.COARSE else 1
    cost = differences(image[::step, ::step], template[::step, ::step], mask[::step, ::step])
    row, column = divmod(int(np.argmin(cost)), cost.shape[1])
    best = cost[row, column]
    # beside the best place there must be no other one as good
    beside = cost.copy()
    down, across = max(h // step // 3, 2), max(w // step // 3, 2)
    beside[max(row - down, 0) : row + down + 1, max(column - across, 0) : column + across + 1] = np.inf
    if beside.min() < tuning.RIVAL * best:
        return (0, 0), math.inf
    row, column = step * row, step * column
    y0, x0 = max(row - step, 0), max(column - step, 0)
    part = image[y0 : row + step + h, x0 : column + step + w]
    fine = differences(part, template, mask)
    dy, dx = divmod(int(np.argmin(fine)), fine.shape[1])
    row, column = y0 + dy, x0 + dx
    there = np.abs(image[row : row + h, column : column + w] - template).mean(axis=2)
    shift = left + column - state.origin[0] - x, top + row - state.origin[1] - y
    return shift, float(np.minimum(there, FAR_OFF)[mask != 0].mean())


def _moved(
    state: SegmentationState,
    seen: _Appearance,
    frame: Frame,
    shift: tuple[int, int],
    gap: int,
    params: SegmentationParams,
) -> SegmentationState:
    k = state.step
    box = (state.box[0] + shift[0], state.box[1] + shift[1], *state.box[2:])
    margin = max(tuning.LEAST_MARGIN, params.margin * max(box[2], box[3]))
    velocity = (shift[0] / (gap + 1), shift[1] / (gap + 1))
    origin, size = place_window(box, velocity, margin, (frame.width / k, frame.height / k))
    image, gray = grab(frame, origin, size, k, state.light)
    dx, dy = origin[0] - state.origin[0], origin[1] - state.origin[1]
    odds, shape, obj = (
        shifted(plane, dx - shift[0], dy - shift[1], size, fill)
        for plane, fill in zip(seen, (tuning.NEVER, 0.0, 0.0), strict=True)
    )
    if math.hypot(*state.camera) < tuning.REST:  # its background memory is kept
        atlas = ground.move(state.atlas, dx, dy, image, odds)
    else:
        counts = np.zeros((3, *size), np.float32)
        counts[0] = np.where(odds < -1.0, KNOWN, np.float32(0.0))
        atlas = Atlas(image, counts)
    estimate = state.estimate.replace(
        box=Box(box[0] * k, box[1] * k, box[2] * k, box[3] * k), ok=True, occluded=False
    )
    return state.replace(
        estimate=estimate, origin=origin, box=box, velocity=velocity, previous=image, gray=gray, odds=odds,
        shape=shape, obj=obj, distractor=None, visible=None, atlas=atlas, occlusion=Occlusion(),
        begun=None,
    )  # fmt: skip
