"""Where the object is by the correlation filter: here, round here, and after a loss all over the frame."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .. import anchor
from .state import Geometry, Pose, PropagationParams, PropagationState
from .view import View

__all__ = ["Found", "find", "look", "place"]

F32 = NDArray[np.float32]

_LOOKS, _PLACES, _APART = 8, 200, 1.2


class Found(NamedTuple):
    """Answer of the correlation filter: `value` is its height less the distance penalty.

    `likelihood` is that of the object's colours in the window at the pose `window`, empty where they do not tell.
    """

    value: float
    pose: Pose
    height: float
    response: F32
    window: Pose
    likelihood: F32


def look(state: PropagationState, view: View, at: Pose, expected: Pose, penalty: float) -> Found:
    """Best place in the window at a pose."""
    g, model = state.geometry, state.model
    sight = view.sight(at, model.histograms)
    response = anchor.respond(model.located, sight.channels)
    right, down = (at.cx - expected.cx) / (g.w * expected.sx), (at.cy - expected.cy) / (g.h * expected.sy)
    fade = anchor.Fade(penalty, right, down, g.coarse_step / g.w, g.coarse_step / g.h)
    dx, dy, value, height = anchor.find_peak(response, fade)
    pose = at.shifted(dx * g.coarse_step * at.sx, dy * g.coarse_step * at.sy)
    return Found(value, pose, height, response, at, sight.likelihood)


def find(state: PropagationState, view: View, expected: Pose, p: PropagationParams) -> Found:
    """Best place in the window at the pose expected, and elsewhere where that is a poor one."""
    g = state.geometry
    penalty = p.distance_penalty / (1.0 + 0.5 * state.low)
    best = look(state, view, expected, expected, penalty)
    if best.height < p.weak * state.peak:
        lost = state.low - p.patience
        places = _elsewhere(state.pose, g, view, lost)
        for at in places if state.hint is None else [state.hint, *places]:
            # Nothing is known of where a lost object is, so that no place is worth less than another.
            best = max(best, look(state, view, at, at if lost > 0 else expected, penalty), key=lambda f: f.value)
    moved = math.hypot(best.pose.cx - expected.cx, best.pose.cy - expected.cy)
    if moved > p.recentre * g.coarse_step * expected.sx:
        # The window fades what is far from its centre: only a second look says how high the peak really is.
        best = look(state, view, best.pose, best.pose if state.low > p.patience else expected, penalty)
    return best


def place(found: Found, g: Geometry) -> tuple[float, float]:
    """Where the pose found has its centre on the lattice of the coarse window."""
    rows, columns = g.window.shape
    right, down = found.window.offset(found.pose)
    x = right / (g.coarse_step * found.window.sx) + 0.5 * (columns - 1)
    return x, down / (g.coarse_step * found.window.sy) + 0.5 * (rows - 1)


def _elsewhere(pose: Pose, g: Geometry, view: View, lost: int) -> list[Pose]:
    """Where else to look: all round the last pose; once lost, at a few more places in each frame, near ones first.

    These are `_APART` boxes apart and cover the frame, or of a large one the part round the last pose;
    then from the beginning again.
    """
    width, height = g.w * pose.sx, g.h * pose.sy
    if lost <= 0:
        steps = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (1, -1), (-1, 1)]
        near = (pose.moved(across * width, down * height) for across, down in steps)
        return [at for at in near if view.contains(at)]
    width, height = _APART * width, _APART * height
    frame_width, frame_height = view.size
    places = _places(
        *(max(0, math.ceil(room)) for room in (pose.cx / width, (frame_width - pose.cx) / width)),
        *(max(0, math.ceil(room)) for room in (pose.cy / height, (frame_height - pose.cy) / height)),
    )
    first = _LOOKS * (lost - 1)
    steps = [places[i % len(places)] for i in range(first, first + min(_LOOKS, len(places)))]
    # The outermost places are on the border, where what has left comes back.
    return [
        pose._replace(
            cx=min(max(pose.cx + across * width, 0.0), frame_width - 1.0),
            cy=min(max(pose.cy + down * height, 0.0), frame_height - 1.0),
        )
        for across, down in steps
    ]


@lru_cache(maxsize=64)
def _places(left: int, right: int, up: int, down: int) -> list[tuple[int, int]]:
    """Steps to the nearest of all places that so many steps reach, the nearest first."""
    # No farther than the nearest can lie: a small object in a large frame has a hundred thousand places.
    reach = 16 + _PLACES // min(left + right + 1, up + down + 1)
    left, right, up, down = (min(room, reach) for room in (left, right, up, down))
    steps = [(x, y) for y in range(-up, down + 1) for x in range(-left, right + 1) if (x, y) != (0, 0)]
    return sorted(steps, key=lambda step: step[0] ** 2 + step[1] ** 2)[:_PLACES]
