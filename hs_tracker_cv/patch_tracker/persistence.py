"""How much of what was in the box is still in it, whatever it looks like by now.

A target that turns looks like nothing that was learned, but its surface goes on in the box; one that is hidden is
replaced by what comes from outside. The map has half the resolution of the fine patch.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._native import kernels
from . import tuning
from .sampler import Patch
from .state import Geometry, PatchTrackerParams, PatchTrackerState, Pose

__all__ = [
    "Carried",
    "Followed",
    "body_weights",
    "carried_along",
    "coherence_with",
    "persistent_share",
    "refreshed",
]

F32 = NDArray[np.float32]


class Followed(NamedTuple):
    """Flow from a patch to another one, and what was fitted to it.

    Parameters
    ----------
    flow : ndarray, shape (h, w, 2), float32
        Samples.
    planes : ndarray, shape (3, h, w), float32
        Weight of each pixel, share of "moves with the object" and prior weight: see `fit_motion` in kernels.pyi.
    motion : tuple of float
        Translation (samples), growth and rotation (radians).
    apart : bool
        The motions of object and surroundings could be told apart.
    """

    flow: F32
    planes: F32
    motion: tuple[float, float, float, float]
    apart: bool


class Carried(NamedTuple):
    """Answer of the flow between frames: pose, and what is seen there; `start` was seen where the flow ends."""

    pose: Pose
    patch: Patch
    followed: Followed
    start: Patch


def body_weights(state: PatchTrackerState) -> F32:
    """Weights of what is kept, on the lattice of the fine patch."""
    return np.asarray(np.float32(tuning.KEPT_FLOOR) + state.persistence.repeat(2, 0).repeat(2, 1), np.float32)


def correlation(a: F32, b: F32, weights: F32) -> float:
    """Weighted normalised cross-correlation of two patches, −1 to 1."""
    total = float(weights.sum())
    a = a - np.float32(float(np.vdot(weights, a)) / total)
    b = b - np.float32(float(np.vdot(weights, b)) / total)
    weighted = weights * a
    power = float(np.vdot(weighted, a)) * float(np.vdot(weights * b, b))
    return float(np.vdot(weighted, b)) / math.sqrt(power + 1e-6)


def coherence_with(state: PatchTrackerState, patch: F32) -> float:
    """How well a patch continues the last one."""
    return correlation(patch, state.model.previous, state.geometry.inner * body_weights(state))


def refreshed(
    state: PatchTrackerState, followed: Followed, coarse: Pose, pose: Pose, patch: F32, p: PatchTrackerParams
) -> tuple[F32, F32]:
    """What is kept at a pose that is believed, more where it looks as it was learned, and the means learned there."""
    mask_rate = p.mask_rate if followed.apart else 0.0
    return _updated(state, followed, coarse, pose, patch, p, (p.keep_rate, p.patch_rate, mask_rate))


def carried_along(
    state: PatchTrackerState, followed: Followed, coarse: Pose, pose: Pose, patch: F32, p: PatchTrackerParams
) -> F32:
    """What is kept at a pose of what was kept before, and no more.

    Parameters
    ----------
    followed : Followed
        Its flow ends in the patch at `coarse`.
    pose : Pose
        Where the result is wanted.
    patch : ndarray, shape (h, w), float32
        Patch there.
    """
    return _updated(state, followed, coarse, pose, patch, p, (0.0, 0.0, 0.0))[0]


def _updated(
    state: PatchTrackerState,
    followed: Followed,
    coarse: Pose,
    pose: Pose,
    patch: F32,
    p: PatchTrackerParams,
    rates: tuple[float, float, float],
) -> tuple[F32, F32]:
    g, model = state.geometry, state.model
    unit, zoom, turn = 2.0 * g.fine_step * coarse.sx, pose.sx / coarse.sx, pose.angle - coarse.angle
    right, down = coarse.offset(pose)
    rate, mean_rate, mask_rate = rates
    persistence, means = np.empty_like(state.persistence), np.empty_like(model.means)
    way = (right / unit, down / unit, zoom * math.cos(turn), zoom * math.sin(turn))
    before = kernels.KnownBefore(state.persistence, g.body, model.previous, model.means, g.weights)
    passage = kernels.Passage(followed.planes, followed.flow, patch, way)
    how = kernels.PersistenceRates(
        same=p.same, changed=p.changed, rate=rate, mean_rate=mean_rate, mask_rate=mask_rate, floor=tuning.MASK_FLOOR
    )
    kernels.update_persistence(before, passage, how, persistence, means)
    return persistence, means


def persistent_share(persistence: F32, g: Geometry) -> float:
    """Share of the box that is kept, 0–1, the middle of the box above all."""
    return float(np.vdot(persistence, g.body_weights))
