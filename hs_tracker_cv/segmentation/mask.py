"""Masks beside what the kernels do to them: that of a second mover, followed; the box of a mask."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Box
from . import tuning
from .state import Image
from .window import transformed

__all__ = ["Mask", "follow_distractor", "outer_box"]

Mask = NDArray[np.uint8]

_SQUARE = np.ones((3, 3), np.uint8)


def follow_distractor(
    distractor: Mask | None, flow: NDArray[np.float32], previous: Image, image: Image, obj: Image, noise: float
) -> Mask | None:
    """Where the distractor of the last frame is now, in front of the object too.

    It moves by the median of its flow; a pixel stays its own if that explains it, and clearly better than the
    object layer does. None if there is no such pixel.
    """
    if distractor is None or cv2.countNonZero(distractor) < tuning.SMALLEST_MOVER:
        return None
    inside = distractor != 0
    u, v = (float(np.median(flow[:, :, i][inside])) for i in (0, 1))
    matrix = np.array(((1.0, 0.0, u), (0.0, 1.0, v)))
    size = (distractor.shape[1], distractor.shape[0])
    there = cv2.warpAffine(cv2.dilate(distractor, _SQUARE), matrix, size, flags=cv2.INTER_NEAREST) != 0
    moved = transformed(previous, (1.0, 0.0, u, 0.0, 1.0, v), distractor.shape[:2])
    own = np.abs(image - moved).mean(axis=2)
    other = np.abs(image - obj).mean(axis=2)
    still = (own < tuning.MOVER_NOISE * noise + tuning.MOVER_ADDED) & (own < tuning.MOVER_BETTER * other)
    found = np.asarray(there & still, dtype=np.uint8)
    return found if cv2.countNonZero(found) else None


def outer_box(mask: Mask) -> Box | None:
    """Extremes of a mask, whole window px."""
    x, y, w, h = cv2.boundingRect(mask)
    return Box(float(x), float(y), float(w), float(h)) if w else None
