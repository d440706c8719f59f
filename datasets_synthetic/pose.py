"""Where every painted point is at every moment: the truth, from which pictures, boxes and flow all follow.

A point painted on a part goes through four maps: the part's own rigid pose, the actor's deformations, the actor's
similarity (mirror, scale, angle, place in the world), the camera. Each can be undone exactly.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from .deform import DEFORMS
from .motion import PATHS, shake
from .shapes import SHAPES, Part
from .spec import Actor, SequenceSpec

__all__ = ["CameraPose", "PartPose", "Stage", "stage_of"]

Field = NDArray[np.float64]


@dataclass(frozen=True)
class CameraPose:
    """Camera at one moment: pixel = turned by roll [(world − corner − centre) · zoom] + centre; roll in radians."""

    corner: tuple[float, float]
    zoom: float
    centre: tuple[float, float]
    roll: float = 0.0

    def to_pixel(self, x: Field, y: Field) -> tuple[Field, Field]:
        """World px -> frame px."""
        (ox, oy), (cx, cy) = self.corner, self.centre
        x, y = _turned((x - ox - cx) * self.zoom, (y - oy - cy) * self.zoom, self.roll)
        return x + cx, y + cy

    def to_world(self, x: Field, y: Field) -> tuple[Field, Field]:
        """Frame px -> world px."""
        (ox, oy), (cx, cy) = self.corner, self.centre
        x, y = _turned(x - cx, y - cy, -self.roll)
        return x / self.zoom + cx + ox, y / self.zoom + cy + oy


@dataclass(frozen=True, eq=False)
class PartPose:
    """One part of one actor at one moment."""

    actor: Actor
    part: Part
    rigid: NDArray[np.float64]
    similarity: NDArray[np.float64]
    deform: tuple[tuple[str, float, float], ...]
    camera: CameraPose

    @property
    def _half(self) -> tuple[float, float]:
        return self.actor.size[0] / 2.0, self.actor.size[1] / 2.0

    def _outward(self, x: Field, y: Field, outline: bool) -> tuple[Field, Field]:
        x, y = _apply(self.rigid, x, y)
        for kind, strength, phase in self.deform:
            maps = DEFORMS[kind]
            x, y = (maps.outline if outline else maps.forward)(x, y, *self._half, strength, phase)
        return self.camera.to_pixel(*_apply(self.similarity, x, y))

    def outline(self) -> NDArray[np.float64]:
        """Polygon in the frame, shape (N, 2), px, unclipped."""
        x, y = self._outward(self.part.outline[:, 0], self.part.outline[:, 1], outline=True)
        return np.column_stack([x, y])

    def forward(self, x: Field, y: Field) -> tuple[Field, Field]:
        """Painted points -> frame px; NaN where the surface has turned away."""
        return self._outward(x, y, outline=False)

    def own(self, x: Field, y: Field) -> tuple[Field, Field]:
        """Frame px -> the actor's own coordinates, before deformation is undone."""
        return _unapply(self.similarity, *self.camera.to_world(x, y))

    def inverse(self, x: Field, y: Field) -> tuple[Field, Field]:
        """Actor's own coordinates -> painted points."""
        for kind, strength, phase in reversed(self.deform):
            x, y = DEFORMS[kind].inverse(x, y, *self._half, strength, phase)
        return _unapply(self.rigid, x, y)


def _turned(x: Field, y: Field, angle: float) -> tuple[Field, Field]:
    if angle == 0.0:
        return x, y
    c, s = math.cos(angle), math.sin(angle)
    return c * x - s * y, s * x + c * y


def _apply(affine: NDArray[np.float64], x: Field, y: Field) -> tuple[Field, Field]:
    (a, b, c), (d, e, f) = affine.tolist()
    return a * x + b * y + c, d * x + e * y + f


def _unapply(affine: NDArray[np.float64], x: Field, y: Field) -> tuple[Field, Field]:
    (a, b, c), (d, e, f) = affine.tolist()
    determinant = a * e - b * d
    x, y = x - c, y - f
    return (e * x - b * y) / determinant, (a * y - d * x) / determinant


class Stage:
    """Poses of everything in a sequence, at any moment.

    Parameters
    ----------
    spec : SequenceSpec
    """

    def __init__(self, spec: SequenceSpec) -> None:
        self.spec = spec
        self.actors = (*spec.scene.behind, spec.target, *spec.scene.front)
        self.target_index = len(spec.scene.behind)
        self.parts = [SHAPES[actor.shape](*actor.size, actor.seed) for actor in self.actors]
        self.first_label = [1 + sum(len(parts) for parts in self.parts[:k]) for k in range(len(self.actors))]
        self._shake = shake(spec.frames, spec.camera.jitter, spec.seed)

    def camera(self, t: float) -> CameraPose:
        """Camera at time t, frames."""
        camera, s = self.spec.camera, self.spec.fraction(t)
        x, y = PATHS[camera.pan.kind](camera.pan, s)
        if camera.jitter:
            when = np.arange(self.spec.frames)
            x += float(np.interp(t, when, self._shake[:, 0]))
            y += float(np.interp(t, when, self._shake[:, 1]))
        zoom = camera.zoom[0] * (camera.zoom[1] / camera.zoom[0]) ** s
        roll = math.radians(camera.roll[0] + (camera.roll[1] - camera.roll[0]) * s)
        return CameraPose((x, y), zoom, (self.spec.size[0] / 2.0, self.spec.size[1] / 2.0), roll)

    def actor(self, index: int, t: float) -> list[PartPose]:
        """Parts of an actor at time t, the hindmost first."""
        actor, s = self.actors[index], self.spec.fraction(t)
        motion = actor.motion
        own = t - sum(min(max(t - first, 0.0), stop - first) for first, stop in motion.rests)
        own_s = self.spec.fraction(own)
        x, y = PATHS[motion.path.kind](motion.path, own_s)
        if motion.with_camera:
            pan = self.spec.camera.pan
            x, y = (place + by for place, by in zip((x, y), PATHS[pan.kind](pan, s), strict=True))
        scale = motion.growth[0] * (motion.growth[1] / motion.growth[0]) ** own_s
        angle = math.radians(motion.angle + motion.spin * own)
        c, n = scale * math.cos(angle), scale * math.sin(angle)
        flip = -1.0 if actor.mirror else 1.0
        similarity = np.array([[c * flip, -n, x], [n * flip, c, y]])
        deform = tuple((deform.kind, deform.strength, deform.cycles * s) for deform in actor.deform)
        camera = self.camera(t)
        phase = motion.gait * own
        return [PartPose(actor, part, part.pose(phase), similarity, deform, camera) for part in self.parts[index]]

    def present(self, index: int, t: int) -> bool:
        """Whether an actor is there at all in frame t."""
        return not any(first <= t < stop for first, stop in self.actors[index].motion.hidden)

    def labels_of(self, index: int) -> range:
        """Labels of an actor's parts; 0 is the background."""
        first = self.first_label[index]
        return range(first, first + len(self.parts[index]))

    @property
    def still(self) -> bool:
        """Whether the camera never moves."""
        camera = self.spec.camera
        fixed = camera.pan.kind == "hold" and camera.jitter == 0
        return fixed and camera.zoom[0] == camera.zoom[1] and camera.roll[0] == camera.roll[1]


@lru_cache(maxsize=4)
def stage_of(spec: SequenceSpec) -> Stage:
    """Stage of a spec; the last few are kept."""
    return Stage(spec)
