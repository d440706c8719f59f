"""Is something in front of the object? Its visible share, its stalled sides, and where it comes out again."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .._native.kernels.segmentation import Window, search_shift
from ..geometry import Box
from . import tuning
from .mask import Mask
from .state import Image, Occlusion, Plane, SegmentationParams

__all__ = ["amodal", "find_again", "remembered_speed", "updated", "visible_share", "with_missing"]


def visible_share(area: int, both: int, seen: int, *, hidden: bool) -> float:
    """Visible share of that part of the remembered shape that lies in the frame; 0 when none does.

    `area` is that of the shape there, `seen` that of the mask, `both` what they have in common. An area that has only
    changed its form counts as visible, since deformation roughly conserves area; and what comes out after it was
    `hidden` need not be where it was expected.
    """
    if area == 0:
        return 0.0
    ratio = both / area
    if ratio > tuning.RESHAPED or hidden:
        ratio = max(ratio, min(1.0, seen / area))
    return float(ratio)


def updated(
    memory: Occlusion,
    box: Box | None,
    velocity: tuple[float, float],
    camera: tuple[float, float],
    share: float,
    usable: bool,
    covered: bool,
    params: SegmentationParams,
) -> Occlusion:
    """Suspect, confirm or end an occlusion after a frame in which `share` of the shape was visible.

    Parameters
    ----------
    memory : Occlusion
    box : Box or None
        Of the visible mask, lattice px.
    velocity, camera : tuple of float
        Lattice px per frame.
    share : float
    usable : bool
        False when the segmentation is too poor to conclude from it.
    covered : bool
        A second mover is known to be in front of the object.
    params : SegmentationParams
    """
    drift = (memory.drift[0] + camera[0], memory.drift[1] + camera[1])
    memory = memory._replace(drift=drift)
    if not usable:
        return memory._replace(suspected=0, occluded=False, coasting=0, sides=(), duration=0)
    if box is not None:
        x, y = box.x - drift[0], box.y - drift[1]
        memory = memory._replace(sides=(*memory.sides, (x, y, x + box.w, y + box.h))[-tuning.SIZES :])
    if not memory.occluded:
        speed = (velocity[0] - camera[0], velocity[1] - camera[1])
        memory = memory._replace(speeds=(*memory.speeds, speed)[-tuning.SPEEDS :])
    suspected = memory.suspected
    if suspected:
        suspected = 0 if share >= tuning.WHOLE else suspected + 1
    elif (share < tuning.WHOLE and (covered or _stalled(memory))) or share < tuning.HALF:
        suspected = 1
    occluded = suspected > 0 and (memory.occluded or share < params.occlusion_ratio)
    duration = memory.duration + 1 if occluded else 0
    if (suspected > tuning.UNCONFIRMED and not occluded) or (
        duration > params.max_coast and share > tuning.MUCH_SEEN
    ):
        suspected, occluded, duration = 0, False, 0
    return memory._replace(suspected=suspected, occluded=occluded, duration=duration)


def with_missing(memory: Occlusion, shape: Box) -> Occlusion:
    """Memory of an occlusion just confirmed, with what the remembered `shape` lacks on its leading sides."""
    left, top, right, bottom = memory.sides[0] if memory.sides else (0.0, 0.0, 0.0, 0.0)
    lost_x, lost_y = max(right - left - shape.w, 0.0), max(bottom - top - shape.h, 0.0)
    vx, vy = remembered_speed(memory)
    least = tuning.LEADING
    missing = (lost_x * (vx < -least), lost_y * (vy < -least), lost_x * (vx > least), lost_y * (vy > least))
    return memory._replace(missing=missing)


def amodal(memory: Occlusion, shape: Box) -> Box:
    """Box of the whole object from that of the remembered shape."""
    left, top, right, bottom = memory.missing
    return Box.from_edges(shape.x - left, shape.y - top, shape.right + right, shape.bottom + bottom)


def _stalled(memory: Occlusion) -> bool:
    """A side towards which the object should have moved has not."""
    if len(memory.sides) <= tuning.SPAN or len(memory.speeds) < tuning.SPAN:
        return False
    new, old = memory.sides[-1], memory.sides[-1 - tuning.SPAN]
    for axis in (0, 1):
        expected = sum(speed[axis] for speed in memory.speeds[-tuning.SPAN :])
        side = axis + 2 if expected > 0 else axis
        moved = (new[side] - old[side]) * np.sign(expected)
        if abs(expected) > tuning.SPAN_LEAST and moved < tuning.SPAN_SHARE * abs(expected):
            return True
    return False


def remembered_speed(memory: Occlusion) -> tuple[float, float]:
    """Velocity relative to the background before the occlusion began to falsify it."""
    speeds = memory.speeds[: -tuning.FALSIFIED] or memory.speeds
    if not speeds:
        return 0.0, 0.0
    vx, vy = np.median(np.array(speeds[-tuning.REMEMBERED :]), axis=0)
    return float(vx), float(vy)


def find_again(
    image: Image, obj: Image, shape: Plane, different: Mask, reach: int, noise: float, inside: NDArray[np.int64]
) -> tuple[int, int]:
    """Translation at which the remembered object fits what is not background; (0, 0) if none fits clearly better."""
    if np.count_nonzero(different) < tuning.FEWEST_DIFFERENT * np.count_nonzero(shape > 0.5):
        return 0, 0
    step = 1 + reach // tuning.SEARCH_STRIDE
    arguments = (Window(image, inside), obj, shape, different)
    score, still, dx, dy = search_shift(*arguments, (0, 0), reach, step, noise)
    if step > 1:
        score, _, dx, dy = search_shift(*arguments, (dx, dy), step - 1, 1, noise)
    better = score > tuning.BETTER * still + tuning.BETTER_ADDED and score > tuning.ENOUGH
    return (dx, dy) if better else (0, 0)
