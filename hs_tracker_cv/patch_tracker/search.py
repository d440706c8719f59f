"""Where the object is by the correlation filter: here, round here, and after a loss all over the frame."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import finder as finders
from . import tuning
from .sampler import Sampler
from .state import Geometry, PatchTrackerParams, PatchTrackerState, Pose

__all__ = ["Found", "find", "peak_at"]

F32 = NDArray[np.float32]


class Found(NamedTuple):
    """Answer of the correlation filter: the pose of its peak, what it saw, and the chance that the pose is right."""

    pose: Pose
    seen: finders.Peak
    chance: float


def peak_at(state: PatchTrackerState, sampler: Sampler, at: Pose, expected: Pose, penalty: float) -> Found:
    """Best place in the window at a pose."""
    g, finder = state.geometry, state.model.located
    cell = 4 * g.lattice.step
    right, down = (at.cx - expected.cx) / (g.w * expected.sx), (at.cy - expected.cy) / (g.h * expected.sy)
    seen = finders.find_peak(finder, sampler.scene(at), finders.Fade(penalty, right, down, cell / g.w, cell / g.h))
    pose = at.shifted(seen.dx * cell * at.sx, seen.dy * cell * at.sy)
    return Found(pose, seen, finders.likelihood(seen, seen.height / max(state.peak, 1e-3)))


def find(state: PatchTrackerState, sampler: Sampler, expected: Pose, p: PatchTrackerParams) -> Found:
    """Best place in the window at the pose expected; once the object is lost, elsewhere too."""
    g, lost = state.geometry, state.low - p.patience
    penalty = p.distance_penalty / (1.0 + tuning.PENALTY_FADE * state.low)
    best = peak_at(state, sampler, expected, expected, penalty)
    if (
        best.chance < tuning.CLEAR and abs(expected.angle - state.estimate.angle) > tuning.SAME_TURN
    ):  # it may not have turned as told
        upright = expected._replace(angle=state.estimate.angle)
        best = max(best, peak_at(state, sampler, upright, upright, penalty), key=lambda found: found.chance)
    if lost > 0 and best.chance < p.sure:
        places = _elsewhere(state.pose, g, sampler, lost)
        for at in places if state.hint is None else [state.hint, *places]:
            best = max(best, peak_at(state, sampler, at, at, 0.0), key=lambda found: found.chance)
    moved = math.hypot(best.pose.cx - expected.cx, best.pose.cy - expected.cy)
    if moved > p.recentre * math.sqrt(g.w * g.h) * expected.sx:
        # The window fades what is far from its centre: a second look says how high the peak really is.
        again = peak_at(state, sampler, best.pose, best.pose, 0.0)
        if again.chance > best.chance:
            return again
    return best


def _elsewhere(pose: Pose, g: Geometry, sampler: Sampler, lost: int) -> list[Pose]:
    """Where else to look for a lost object: at a few more places in each frame, near ones first.

    These are `tuning.APART` boxes apart and cover the frame, or of a large one the part round the last pose;
    then from the beginning again.
    """
    apart = tuning.APART * math.sqrt(g.w * g.h * pose.sx * pose.sy)
    frame_width, frame_height = sampler.size
    room = (pose.cx, frame_width - pose.cx, pose.cy, frame_height - pose.cy)
    places = _places(*(max(0, math.ceil(each / apart)) for each in room))
    first = tuning.LOOKS * (lost - 1)
    steps = [places[i % len(places)] for i in range(first, first + min(tuning.LOOKS, len(places)))]
    # The outermost places are on the border, where what has left comes back.
    return [
        pose._replace(
            cx=min(max(pose.cx + across * apart, 0.0), frame_width - 1.0),
            cy=min(max(pose.cy + down * apart, 0.0), frame_height - 1.0),
        )
        for across, down in steps
    ]


@lru_cache(maxsize=64)
def _places(left: int, right: int, up: int, down: int) -> list[tuple[int, int]]:
    """Steps to the nearest of all places that so many steps reach, the nearest first."""
    # No farther than the nearest can lie: a small object in a large frame has a hundred thousand places.
    reach = tuning.LEAST_REACH + tuning.PLACES // min(left + right + 1, up + down + 1)
    left, right, up, down = (min(room, reach) for room in (left, right, up, down))
    steps = [(x, y) for y in range(-up, down + 1) for x in range(-left, right + 1) if (x, y) != (0, 0)]
    return sorted(steps, key=lambda step: step[0] ** 2 + step[1] ** 2)[: tuning.PLACES]
