"""From evidence to a mask and from a mask to a box."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Box
from .kernels import alpha_edge, extremes, spread
from .state import Image, Plane
from .window import transformed

__all__ = ["Mask", "box_of", "component", "dilate", "follow_distractor", "grow", "outer_box", "refine_edge"]

Mask = NDArray[np.uint8]

_GROWTH = 4  # px per frame
_SMALLEST_DISTRACTOR = 20  # px; less has no flow of its own
_SQUARES = {side: np.ones((side, side), np.uint8) for side in (3, 5, 7, 9)}
_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


def dilate(mask: Mask, side: int) -> Mask:
    """Dilation by a square of that side."""
    return np.asarray(cv2.dilate(mask, _SQUARES[side]), dtype=np.uint8)


def grow(fresh: Mask, own: Mask, distractor: Mask | None, count: int) -> tuple[Mask, Mask | None]:
    """Where the object has grown and where something else has arrived.

    Only what covers a background seen a moment ago (`fresh`) counts: this excludes ghosts and lifted shadows.
    `own` is where the object was expected.

    Returns
    -------
    grown : 1 where the object has grown, 2 on a distractor
    distractor : its pixels, remembered for the next frame; None if there are none
    """
    grown = np.zeros_like(own)
    new = np.asarray(cv2.medianBlur(fresh, 3), dtype=np.uint8)
    apart = np.asarray(cv2.subtract(new, own), dtype=np.uint8)
    area = cv2.countNonZero(own)
    if area == 0 or cv2.countNonZero(apart) == 0:
        return grown, None
    near = dilate(own, 9)
    far = cv2.countNonZero(cv2.subtract(apart, near))
    other = _other_components(apart, near, max(8.0, 0.02 * area)) if far else np.zeros_like(own)
    if distractor is not None:
        other |= apart & dilate(distractor, 7)
    if count > 2 and far < 0.03 * new.size:
        spread(own, np.asarray(cv2.subtract(new, other), dtype=np.uint8), _GROWTH, np.empty_like(own), grown)
    if cv2.countNonZero(other) == 0:
        return grown, None
    grown[other != 0] = 2
    return grown, other


def _other_components(apart: Mask, near: Mask, smallest: float) -> Mask:
    """Components that don't touch `near` and are not tiny."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(apart, connectivity=8)
    keep = stats[:, cv2.CC_STAT_AREA] >= smallest
    keep[labels[near != 0]] = False
    keep[0] = False
    return np.asarray(keep[labels], dtype=np.uint8)


def follow_distractor(
    distractor: Mask | None, flow: NDArray[np.float32], previous: Image, image: Image, obj: Image, noise: float
) -> Mask | None:
    """Where the distractor of the last frame is now, in front of the object too.

    It moves by the median of its flow; a pixel stays its own if that explains it, and clearly better than the
    object layer does. None if there is no such pixel.
    """
    if distractor is None or cv2.countNonZero(distractor) < _SMALLEST_DISTRACTOR:
        return None
    inside = distractor != 0
    u, v = (float(np.median(flow[:, :, i][inside])) for i in (0, 1))
    matrix = np.array(((1.0, 0.0, u), (0.0, 1.0, v)))
    size = (distractor.shape[1], distractor.shape[0])
    there = cv2.warpAffine(dilate(distractor, 3), matrix, size, flags=cv2.INTER_NEAREST) != 0
    moved = transformed(previous, (1.0, 0.0, u, 0.0, 1.0, v), distractor.shape[:2])
    own = np.abs(image - moved).mean(axis=2)
    other = np.abs(image - obj).mean(axis=2)
    found = np.asarray(there & (own < 3.0 * noise + 3.0) & (own < 0.6 * other), dtype=np.uint8)
    return found if cv2.countNonZero(found) else None


def component(odds: Plane, before: Mask) -> Mask:
    """The object's component of {odds > 0}: the one that overlaps most with where it was `before`, and its parts."""
    mask = (odds > 0).view(np.uint8)
    area = cv2.countNonZero(before)
    if area > 800:
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, _SQUARES[3]), dtype=np.uint8)
    elif area > 150:
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, _CROSS), dtype=np.uint8)
    x, y, w, h = cv2.boundingRect(mask)
    if w == 0:
        return mask
    part = (slice(y, y + h), slice(x, x + w))
    n, labels = cv2.connectedComponents(np.ascontiguousarray(mask[part]), connectivity=8)
    if n <= 2:
        return mask
    overlap = np.bincount(labels[before[part] != 0], minlength=n)
    overlap[0] = 0
    keep = (overlap > 0.03 * area) & (overlap > 0.5 * np.bincount(labels.ravel(), minlength=n))
    keep[int(np.argmax(overlap))] = True
    keep[0] = False
    kept = np.zeros_like(mask)
    kept[part] = keep[labels]
    return kept


def refine_edge(
    image: Image, background: Image, seen: Plane, mask: Mask, odds: Plane, noise: float
) -> tuple[Mask, Plane]:
    """Cut mixed edge pixels that are mostly background, and lower their odds; nothing if too much would go."""
    core = np.asarray(cv2.erode(mask, _SQUARES[5]), dtype=np.uint8)
    if cv2.countNonZero(core) < 9:
        core = np.asarray(cv2.erode(mask, _SQUARES[3]), dtype=np.uint8)
    changed, kept = np.empty_like(odds), np.empty_like(mask)
    before, after = alpha_edge(image, background, seen, core, dilate(mask, 3), mask, noise, odds, changed, kept)
    return (kept, changed) if after > 0.6 * before else (mask, odds)


def box_of(mask: Mask, odds: Plane) -> Box | None:
    """Extremes of a mask, window px: where the largest of the odds per row or column crosses zero."""
    h, w = mask.shape
    columns, rows = np.empty(w, np.float32), np.empty(h, np.float32)
    first_x, last_x, first_y, last_y = extremes(mask, odds, columns, rows)
    if last_x < 0:
        return None
    left, right = _crossing(columns, first_x, -1), _crossing(columns, last_x, 1)
    top, bottom = _crossing(rows, first_y, -1), _crossing(rows, last_y, 1)
    return Box.from_edges(left, top, right, bottom)


def outer_box(mask: Mask) -> Box | None:
    """Extremes of a mask, whole window px."""
    x, y, w, h = cv2.boundingRect(mask)
    return Box(float(x), float(y), float(w), float(h)) if w else None


def _crossing(values: NDArray[np.float32], last: int, step: int) -> float:
    """Edge, px, where the profile crosses zero between the last pixel inside and the next one."""
    edge = last + 0.5 + 0.5 * step
    beyond = last + step
    if not 0 <= beyond < len(values):
        return edge
    inner, outer = float(values[last]), float(values[beyond])
    if inner <= 0 or outer >= 0:
        return edge
    # equal odds on both sides put the edge where the pixels meet
    return edge + step * (inner / (inner - outer) - 0.5)
