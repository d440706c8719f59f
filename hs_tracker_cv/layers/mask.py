"""From evidence to a mask and from a mask to a box."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Box
from .kernels import alpha_edge
from .state import Image, Plane
from .window import transformed

__all__ = ["Mask", "box_of", "component", "dilate", "follow_distractor", "grow", "refine_edge"]

Mask = NDArray[np.uint8]

_SMALLEST_DISTRACTOR = 20  # px; less has no flow of its own
_SQUARES = {side: np.ones((side, side), np.uint8) for side in (3, 5, 7, 9)}
_CROSS = cv2.getStructuringElement(cv2.MORPH_CROSS, (3, 3))


def dilate(mask: Mask, side: int) -> Mask:
    """Dilation by a square of that side."""
    return np.asarray(cv2.dilate(mask, _SQUARES[side]), dtype=np.uint8)


def grow(fresh: Mask, warped: Plane, distractor: Mask, count: int) -> tuple[Mask, Mask]:
    """Where the object has grown and where something else has arrived.

    Only what covers a background seen a moment ago (`fresh`) counts: this excludes ghosts and lifted shadows.

    Returns
    -------
    grown : 1 where the object has grown, 2 on a distractor
    distractor : its pixels, remembered for the next frame
    """
    obj = (warped > 0).view(np.uint8)
    grown = np.zeros_like(obj)
    area = int(np.count_nonzero(obj))
    new = np.asarray(cv2.medianBlur(fresh, 3), dtype=np.uint8)
    if area == 0 or not new.any():
        return grown, np.zeros_like(obj)
    apart = new & (1 - obj)
    if not apart.any():
        return grown, np.zeros_like(obj)
    near = dilate(obj, 9)
    other = _other_components(apart, near, max(8.0, 0.02 * area))
    if distractor.any():
        other |= new & dilate(distractor, 7) & (1 - obj)
    calm = np.count_nonzero(new & (1 - near)) < 0.03 * new.size
    if count > 2 and calm:
        allowed = new & (1 - other)
        region = obj
        for _ in range(4):
            region = dilate(region, 3) & (allowed | obj)
        grown[(region & allowed) != 0] = 1
    grown[other != 0] = 2
    return grown, other


def _other_components(apart: Mask, near: Mask, smallest: float) -> Mask:
    """Components that don't touch `near` and are not tiny."""
    if not (apart & (1 - near)).any():
        return np.zeros_like(apart)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(apart, connectivity=8)
    keep = stats[:, cv2.CC_STAT_AREA] >= smallest
    keep[labels[near != 0]] = False
    keep[0] = False
    return np.asarray(keep[labels], dtype=np.uint8)


def follow_distractor(
    distractor: Mask, flow: NDArray[np.float32], previous: Image, image: Image, obj: Image, noise: float
) -> Mask:
    """Where the distractor of the last frame is now, in front of the object too.

    It moves by the median of its flow; a pixel stays its own if that explains it, and clearly better than the
    object layer does.
    """
    inside = distractor != 0
    if np.count_nonzero(inside) < _SMALLEST_DISTRACTOR:
        return np.zeros_like(distractor)
    u, v = (float(np.median(flow[:, :, i][inside])) for i in (0, 1))
    matrix = np.array(((1.0, 0.0, u), (0.0, 1.0, v)))
    size = (distractor.shape[1], distractor.shape[0])
    there = cv2.warpAffine(dilate(distractor, 3), matrix, size, flags=cv2.INTER_NEAREST) != 0
    moved = transformed(previous, (1.0, 0.0, u, 0.0, 1.0, v), distractor.shape[:2])
    own = np.abs(image - moved).mean(axis=2)
    other = np.abs(image - obj).mean(axis=2)
    return np.asarray(there & (own < 3.0 * noise + 3.0) & (own < 0.6 * other), dtype=np.uint8)


def component(odds: Plane, warped: Plane) -> Mask:
    """The object's component of {odds > 0}: the one that overlaps most with where it was expected, and its parts."""
    mask = (odds > 0).view(np.uint8)
    before = warped > 0
    area = int(np.count_nonzero(before))
    if area > 800:
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, _SQUARES[3]), dtype=np.uint8)
    elif area > 150:
        mask = np.asarray(cv2.morphologyEx(mask, cv2.MORPH_OPEN, _CROSS), dtype=np.uint8)
    x, y, w, h = cv2.boundingRect(mask)
    part = (slice(y, y + h), slice(x, x + w))
    if w == 0:
        return mask
    n, labels, stats, _ = cv2.connectedComponentsWithStats(np.ascontiguousarray(mask[part]), connectivity=8)
    if n <= 2:
        return mask
    overlap = np.bincount(labels[before[part]], minlength=n)
    overlap[0] = 0
    keep = (overlap > 0.03 * area) & (overlap > 0.5 * stats[:, cv2.CC_STAT_AREA])
    keep[int(np.argmax(overlap))] = True
    keep[0] = False
    kept = np.zeros_like(mask)
    kept[part] = keep[labels]
    return kept


def refine_edge(image: Image, background: Image, seen: Plane, mask: Mask, odds: Plane, noise: float) -> Mask:
    """Cut mixed edge pixels that are mostly background; lowers `odds` there. Keeps the mask if too much would go."""
    core = np.asarray(cv2.erode(mask, _SQUARES[5]), dtype=np.uint8)
    if np.count_nonzero(core) < 9:
        core = np.asarray(cv2.erode(mask, _SQUARES[3]), dtype=np.uint8)
    changed = odds.copy()
    alpha_edge(image, background, seen, core, dilate(mask, 3), mask, noise, changed)
    kept = mask & (changed > 0).view(np.uint8)
    if np.count_nonzero(kept) <= 0.6 * np.count_nonzero(mask):
        return mask
    odds[:] = changed
    return kept


def box_of(mask: Mask, odds: Plane | None) -> Box | None:
    """Extremes of a mask, window px; given the odds, where the largest per row or column crosses zero."""
    x, y, w, h = cv2.boundingRect(mask)
    if w == 0:
        return None
    if odds is None:
        return Box(float(x), float(y), float(w), float(h))
    columns = odds[y : y + h, :].max(axis=0)
    rows = odds[:, x : x + w].max(axis=1)
    left, right = _crossing(columns, x, -1), _crossing(columns, x + w - 1, 1)
    top, bottom = _crossing(rows, y, -1), _crossing(rows, y + h - 1, 1)
    return Box.from_edges(left, top, right, bottom)


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
