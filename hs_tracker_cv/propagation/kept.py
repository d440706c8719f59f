"""How much of what was in the box is still in it, whatever it looks like by now.

A target that turns looks like nothing that was learned, but its surface goes on in the box; one that is hidden is
replaced by what comes from outside. The map has half the resolution of the fine patch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import patches
from .state import Geometry, Pose, PropagationParams, PropagationState, halved
from .view import View

__all__ = ["Carried", "body_weights", "carried_along", "coherence_with", "kept_share", "refreshed"]

F32 = NDArray[np.float32]

_UNKNOWN: F32 = np.empty((0, 0), np.float32)


@dataclass(frozen=True)
class Carried:
    """Answer of the flow between frames: pose, what is seen there, and how well it agrees with the mean patch."""

    pose: Pose
    current: F32
    agreement: float
    prior: F32
    flow: F32
    weight: F32
    belongs: F32 | None
    seen_at_start: F32
    colour: float  # mean likelihood of the object's colours in the box; 1 where there are none


def body_weights(state: PropagationState) -> F32:
    """Weights of what is kept, on the lattice of the fine patch."""
    return np.asarray(np.float32(0.1) + state.kept.repeat(2, 0).repeat(2, 1), np.float32)


def coherence_with(state: PropagationState, patch: F32) -> float:
    """How well a patch continues the last one."""
    return float(patches.correlation(patch, state.model.previous, state.geometry.inner * body_weights(state)))


def refreshed(
    state: PropagationState, view: View, carried: Carried, coarse: Pose, pose: Pose, p: PropagationParams
) -> F32:
    """What is kept at a pose that is believed: more, where it looks as it was learned."""
    g, model = state.geometry, state.model
    now = halved(view.fine(pose))
    kept = carried_along(state, carried, coarse, pose, now, p)
    error = (now - halved(model.mean)) / (np.float32(10.0) + halved(model.deviation))
    return np.asarray(kept + np.float32(p.keep_rate) * np.exp(-error * error) * (g.body - kept), np.float32)


def carried_along(
    state: PropagationState, carried: Carried, coarse: Pose, pose: Pose, now: F32, p: PropagationParams
) -> F32:
    """Move what is kept with the flow; drop what changed on the way and what moves with the surroundings.

    Parameters
    ----------
    carried : Carried
        Its flow ends in the patch at `coarse`.
    pose : Pose
        Where the result is wanted.
    now : ndarray, shape (h / 2, w / 2), float32
        Patch at `pose`, halved, as the result is.
    """
    g, kept = state.geometry, state.kept
    rows, columns = kept.shape
    unit, zoom, turn = 2.0 * g.fine_step * coarse.sx, pose.sx / coarse.sx, pose.angle - coarse.angle
    right, down = coarse.offset(pose)
    place = np.array(
        (
            right / unit + 0.5 * (columns - 1),
            down / unit + 0.5 * (rows - 1),
            zoom * math.cos(turn),
            zoom * math.sin(turn),
            p.same,
            p.changed,
        )
    )
    belongs = _UNKNOWN if carried.belongs is None else carried.belongs
    held, out = np.empty((2, rows, columns), np.float32), np.empty((rows, columns), np.float32)
    patches.carry(kept, carried.flow, state.model.previous, now, carried.weight, belongs, place, held, out)
    return out


def kept_share(kept: F32, g: Geometry) -> float:
    """Share of the box that is kept, 0–1, the middle of the box above all."""
    return float(np.vdot(kept, g.body_weights))
