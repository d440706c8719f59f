"""What a sequence is like, in a few words and numbers: for tables of the worst and for sweeps over a parameter."""

from __future__ import annotations

import math

import numpy as np

from .motion import PATHS
from .pose import stage_of
from .spec import Actor, SequenceSpec

__all__ = ["parameters"]

Value = str | int | float


def parameters(spec: SequenceSpec) -> dict[str, Value]:
    """Describe a sequence as a flat table of what is not ordinary in it.

    Parameters
    ----------
    spec : SequenceSpec

    Returns
    -------
    dict of str to str, int or float
        Always: shape, width and height (px), texture, ground, path, speed (mean px/frame of the target in the
        picture), frames, frame. The rest only where it is not the default: spin (rad/frame), rests, hidden, growth,
        deformations and effects by their names, camera, shadow, other actors, blank frames, theme.
    """
    target, motion, camera = spec.target, spec.target.motion, spec.camera
    found: dict[str, Value | None] = {
        "theme": spec.theme or None,
        "frames": spec.frames,
        "frame": f"{spec.size[0]}x{spec.size[1]}",
        "shape": target.shape,
        "width": round(target.size[0], 1),
        "height": round(target.size[1], 1),
        "texture": target.texture.kind,
        "ground": spec.scene.background.kind,
        "path": motion.path.kind,
        "speed": round(_speed(spec), 2),
        "spin": round(float(np.radians(motion.spin)), 3) or None,
        "angle": round(motion.angle, 1) or None,
        "growth": round(motion.growth[1] / motion.growth[0], 2) if motion.growth != (1.0, 1.0) else None,
        "rests": _spans(motion.rests),
        "hidden": _spans(motion.hidden),
        **{deform.kind: deform.strength for deform in target.deform},
        **{effect.kind: effect.strength for effect in target.surface},
        "morph": target.morph.kind if target.morph else None,
        "shadow": target.shadow.strength if target.shadow else None,
        "pan": round(_pan(spec), 2) or None,
        "jitter": camera.jitter or None,
        "zoom": round(camera.zoom[1] / camera.zoom[0], 2) if camera.zoom != (1.0, 1.0) else None,
        "roll": camera.roll[1] - camera.roll[0] or None,
        "shutter": camera.shutter or None,
        **{effect.kind: effect.strength for effect in spec.effects},
        "behind": _names(spec.scene.behind),
        "in_front": _names(spec.scene.front),
        "blanks": " ".join(f"{blank.kind} {blank.first}–{blank.stop - 1}" for blank in spec.blanks) or None,
    }
    return {name: value for name, value in found.items() if value is not None}


def _speed(spec: SequenceSpec) -> float:
    stage = stage_of(spec)
    boxes = []
    for t in range(spec.frames):
        points = np.concatenate([pose.outline() for pose in stage.actor(stage.target_index, float(t))])
        boxes.append((points.min(axis=0) + points.max(axis=0)) / 2.0)
    return float(np.hypot(*np.diff(boxes, axis=0).T).mean())


def _pan(spec: SequenceSpec) -> float:
    pan = spec.camera.pan
    return math.dist(PATHS[pan.kind](pan, 0.0), PATHS[pan.kind](pan, 1.0)) / (spec.frames - 1)


def _spans(spans: tuple[tuple[int, int], ...]) -> str | None:
    return " ".join(f"{first}–{stop - 1}" for first, stop in spans) or None


def _names(actors: tuple[Actor, ...]) -> str | None:
    return " ".join(f"{actor.shape} {actor.size[0]:.0f}x{min(actor.size[1], 999):.0f}" for actor in actors) or None
