"""How much of what was in the box is still in it, whatever it looks like by now.

A target that turns looks like nothing that was learned, but its surface goes on in the box; one that is hidden is
replaced by what comes from outside. The map has half the resolution of the fine patch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import anchor
from .state import Geometry, Pose, PropagationParams, PropagationState, halved
from .view import View

__all__ = ["Carried", "body_weights", "carried_along", "coherence_with", "kept_share", "refreshed"]

F32 = NDArray[np.float32]


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
    return anchor.correlation(patch, state.model.previous, state.geometry.inner * body_weights(state))


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
    if carried.belongs is not None:
        textured = halved(carried.weight / (carried.weight + np.float32(0.1)))
        kept = kept * (np.float32(1.0) - textured * np.maximum(1.0 - 2.0 * halved(carried.belongs), 0.0))
    rows, columns = kept.shape
    unit, zoom, turn = 2.0 * g.fine_step * coarse.sx, pose.sx / coarse.sx, pose.angle - coarse.angle
    along = np.arange(columns, dtype=np.float32) - np.float32(0.5 * (columns - 1))
    up = np.arange(rows, dtype=np.float32) - np.float32(0.5 * (rows - 1))
    right, down = coarse.offset(pose)
    cosine, sine = np.float32(zoom * math.cos(turn)), np.float32(zoom * math.sin(turn))
    x = np.float32(right / unit + 0.5 * (columns - 1)) + cosine * along[None, :] - sine * up[:, None]
    y = np.float32(down / unit + 0.5 * (rows - 1)) + cosine * up[:, None] + sine * along[None, :]
    half = carried.flow[1::2, 1::2] * np.float32(0.5)
    moved, before = _at(x - half[:, :, 0], y - half[:, :, 1], kept, halved(state.model.previous))
    unchanged = (np.float32(p.changed) - np.abs(before - now)) * np.float32(1.0 / (p.changed - p.same))
    return np.asarray(moved * np.clip(unchanged, 0.0, 1.0), np.float32)


def _at(x: F32, y: F32, *planes: F32) -> list[F32]:
    """Bilinear reads of planes of one shape; beyond them their border is repeated."""
    rows, columns = planes[0].shape
    x, y = np.clip(x, 0.0, columns - 1.001), np.clip(y, 0.0, rows - 1.001)
    left, top = x.astype(np.int32), y.astype(np.int32)
    fx, fy, base = x - left, y - top, top * columns + left
    out = []
    for plane in planes:
        one, two = plane.take(base), plane.take(base + columns)
        one += fx * (plane.take(base + 1) - one)
        two += fx * (plane.take(base + columns + 1) - two)
        out.append(np.asarray(one + fy * (two - one), np.float32))
    return out


def kept_share(kept: F32, g: Geometry) -> float:
    """Share of the box that is kept, 0–1, the middle of the box above all."""
    return float(np.vdot(kept, g.body_weights))
