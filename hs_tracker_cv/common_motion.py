"""Which pixels follow one motion: those that it explains over several frames, and standing still does not."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import Affine
from .detection import components
from .geometry import box_from_mask
from .history import Area, History, chained

__all__ = [
    "Explained", "agreeing", "explained", "grown", "is_plausible", "is_strip", "joined", "refined", "shift",
    "similarity",
]  # fmt: skip

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

DISPLACED = 1.5
"""Least displacement, lattice px, between the frames compared."""
AGREE = 1.0
"""Distance, lattice px, from where the common motion takes a point that moves with it."""
ZOOM = 0.3
"""Most growth between the frames compared."""
FEWEST = 8
"""Points that make a common motion."""
EXPLAINED = 0.2
"""Share of the squared change that the motion may leave of what standing still leaves."""
CERTAIN = 9.0
"""Squared change, in units of that of the noise, from which a pixel tells the two apart."""
RIM = 1 / 3
"""Share of the change nearby that a pixel must have: smoothing spreads a change past the edge."""
STRIP = 3.0
"""How much longer than its displacement a thing must be along its motion, lattice px."""
ALIKE = 12.0
"""Difference of gray levels of one surface."""
REFINEMENTS = 2
"""How often the motion is registered on the pixels that follow it, and these are asked for anew."""
STEPS = 3
"""Gauss–Newton steps of a registration."""
OUTLIER = 8.0
"""Difference, gray levels, at which a pixel counts half in a registration."""
ROOM = 0.6
"""Share of its longer side by which the window of a mover is grown to register it."""
ROOM_JOINED = 0.1
"""The same for two parts that may be one thing."""
LEAST_ROOM = 8
"""Least of either, lattice px."""
CLEARLY = 0.5
"""Share of the squared change left by one explanation below which the other is refuted."""
LEAST_NOISE = 0.5
"""Squared change, gray levels², that is noise in any video."""
AHEAD = 0.75
"""Quantile of the displacements of what has changed that must reach the least one."""
LEAST_PART = 9.0
"""Smallest part, lattice px²."""
HARDLY = 0.5
"""Displacement, lattice px, below which a thing has no front and back."""
SURFACE = (0.1, 0.9)
"""Quantiles of the gray levels of the front part between which its surface lies."""
BETWEEN = 0.7
"""Share of what lies between two parts that must be of that surface."""
COVERED = 0.5
"""Share of a part that the whole must hold."""
SETTLED = 0.05
"""Lattice px by which a step must move a registration for another one."""


class Explained(NamedTuple):
    """What follows a motion.

    Parameters
    ----------
    area : tuple of slice
        Window of the frame, lattice px.
    mask : ndarray of bool
        Pixels of the window that follow the motion.
    steps : tuple of int
        Earlier frames compared with, rising.
    motions : tuple of ndarray, shape (2, 3)
        Since each of them.
    gain : float
        Squared change that the motion explains and standing still does not.
    """

    area: Area
    mask: Mask
    steps: tuple[int, ...]
    motions: tuple[Affine, ...]
    gain: float

    @property
    def motion(self) -> Affine:
        """Since the earliest frame compared."""
        return self.motions[-1]

    @property
    def places(self) -> NDArray[np.float64]:
        """x, y of the pixels, shape (N, 2), lattice px."""
        rows, columns = np.nonzero(self.mask)
        return np.column_stack([columns + self.area[1].start, rows + self.area[0].start]).astype(np.float64)


def agreeing(before: Plane, after: Plane) -> Mask | None:
    """Points, shape (N, 2) each, that move as one by shift, turn and zoom; None where too few do."""
    if len(before) < FEWEST:
        return None
    matrix, inliers = cv2.estimateAffinePartial2D(
        np.ascontiguousarray(before), np.ascontiguousarray(after), method=cv2.RANSAC, ransacReprojThreshold=AGREE
    )
    if matrix is None or np.count_nonzero(inliers) < FEWEST:
        return None
    return np.asarray(inliers.ravel() > 0, bool)


def shift(before: Plane, after: Plane) -> Affine:
    """Shift that takes points to points."""
    return np.column_stack([np.eye(2), np.median(after - before, axis=0).astype(np.float64)])


def similarity(before: Plane, after: Plane) -> Affine:
    """Shift, turn and zoom that take points to points."""
    source, target = before.astype(np.float64), after.astype(np.float64)
    a, b = source - source.mean(axis=0), target - target.mean(axis=0)
    size = max(float((a * a).sum()), 1e-6)
    cosine = float((a * b).sum()) / size
    sine = float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum()) / size
    matrix = np.array([[cosine, -sine], [sine, cosine]])
    return np.column_stack([matrix, target.mean(axis=0) - matrix @ source.mean(axis=0)])


def is_plausible(motion: Affine) -> bool:
    """Whether a motion leaves the size of things about as it is."""
    return bool(abs(np.hypot(*motion[:, 0]) - 1.0) < ZOOM)


def refined(history: History, now: Plane, first: Explained) -> Explained | None:
    """Register the motions on the pixels that follow them, and ask for these anew, in a window with room around."""
    found: Explained | None = first
    for _ in range(REFINEMENTS):
        if found is None:
            return None
        motions = [
            _registered(history, now, step, found, motion)
            for step, motion in zip(found.steps, found.motions, strict=True)
        ]
        if not all(is_plausible(motion) for motion in motions):
            return None
        found = explained(history, now, grown(_extent(found), now.shape, ROOM), found.steps, motions)
    return found


def explained(
    history: History, now: Plane, area: Area, steps: Sequence[int], motions: Sequence[Affine]
) -> Explained | None:
    """Pixels that the motions explain and standing still does not.

    Parameters
    ----------
    history : History
    now : ndarray, shape (h, w), float32
        The last frame.
    area : tuple of slice
        Where to look.
    steps : sequence of int
        Earlier frames to compare with, rising.
    motions : sequence of ndarray, shape (2, 3)
        Since each of them.

    Returns
    -------
    Explained or None
        None where nothing does, or where it has hardly been displaced, or where much else has changed among them.
    """
    here = now[area]
    # What the mover has uncovered was hidden in some of the frames only.
    still = np.min([_squared(here, history.view(step, area)) for step in (*steps, len(history))], axis=0)
    moved = np.mean(
        [_squared(here, history.view(step, area, motion)) for step, motion in zip(steps, motions, strict=True)],
        axis=0,
    )
    certain = CERTAIN * max(float(np.median(np.minimum(still, moved))), LEAST_NOISE)
    better = (still > certain) & (moved < CLEARLY * still) & (still > RIM * cv2.dilate(still, np.ones((5, 5))))
    better = cv2.medianBlur(better.astype(np.uint8), 3) > 0
    if not better.any():
        return None
    refuted = (
        cv2.erode(((moved > certain) & (still < CLEARLY * moved)).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
    )
    parts, inside = _one_thing(better, refuted, still, moved)
    if parts is None or inside is None or not _is_displaced(parts & better, area, motions[-1]):
        return None
    # Ground that it has just left has changed too, and moves with nothing.
    left = np.zeros(parts.shape, bool)
    for motion in motions:
        left = left | _taken_back(parts, area, motion)
    change = inside & (still > certain) & (parts | ~left)
    before, after = float(still[change].sum()), float(moved[change].sum())
    if after > EXPLAINED * before:
        return None
    mask = inside & ((still <= certain) | (moved < CLEARLY * still))
    return Explained(area, mask, tuple(steps), tuple(motions), before - after)


def _taken_back(mask: Mask, area: Area, motion: Affine) -> Mask:
    """Where the pixels of a mask were before a motion."""
    corner = np.array([area[1].start, area[0].start], np.float64)
    back = cv2.invertAffineTransform(motion)
    back = np.column_stack([back[:, :2], back[:, 2] + back[:, :2] @ corner - corner])
    size = mask.shape[1], mask.shape[0]
    return np.asarray(cv2.warpAffine(mask.astype(np.uint8), back, size, flags=cv2.INTER_NEAREST) > 0, bool)


def _squared(now: Plane, then: Plane) -> Plane:
    return np.asarray(cv2.blur((now - then) ** 2, (3, 3)), np.float32)


def _is_displaced(core: Mask, area: Area, motion: Affine) -> bool:
    rows, columns = np.nonzero(core)
    if len(rows) < FEWEST:
        return False
    places = np.column_stack([columns + area[1].start, rows + area[0].start]).astype(np.float64)
    return float(np.quantile(np.hypot(*displaced(places, motion).T), AHEAD)) > DISPLACED


def displaced(places: NDArray[np.float64], motion: Affine) -> NDArray[np.float64]:
    """How far points, shape (N, 2), have come by a motion."""
    return np.asarray(places - (places - motion[:, 2]) @ np.linalg.inv(motion[:, :2]).T)


def is_strip(found: Explained) -> bool:
    """Whether it is no longer, along its motion, than this: it may be the front of a plain thing, or its wake."""
    places = found.places
    u, v = displaced(places.mean(axis=0, keepdims=True), found.motions[0])[0]
    distance = float(np.hypot(u, v))
    if distance < HARDLY:
        return False
    along = places @ (u / distance, v / distance)
    return float(along.max() - along.min()) < distance + STRIP


def joined(history: History, now: Plane, one: Explained, other: Explained) -> Explained | None:
    """Two parts as one thing: one motion explains both, and what lies between has the gray levels of the front one.

    A plain thing shows at its front and at its back only.
    """
    leader = max((one, other), key=lambda part: part.gain)
    area = _union(_extent(one), _extent(other))
    rows, columns = (each.stop - each.start for each in area)
    sides = [max(each.stop - each.start for each in _extent(part)) for part in (one, other)]
    if max(rows, columns) > 2 * sum(sides):
        return None
    both = explained(history, now, grown(area, now.shape, ROOM_JOINED), leader.steps, leader.motions)
    if both is None or not all(_covers(both, part) for part in (one, other)):
        return None
    course = displaced(leader.places, leader.motion).mean(axis=0)
    ahead = max((one, other), key=lambda part: float(part.places.mean(axis=0) @ course))
    front = now[ahead.area][ahead.mask]
    low, high = np.quantile(front, SURFACE)
    between = both.places.astype(int)
    inner = now[between[:, 1], between[:, 0]]
    fits = (inner > low - ALIKE) & (inner < high + ALIKE)
    return both if fits.mean() > BETWEEN else None


def _union(one: Area, other: Area) -> Area:
    rows, columns = (slice(min(a.start, b.start), max(a.stop, b.stop)) for a, b in zip(one, other, strict=True))
    return rows, columns


def _covers(whole: Explained, part: Explained) -> bool:
    x, y = part.places.astype(int).T
    x, y = x - whole.area[1].start, y - whole.area[0].start
    inside = (x >= 0) & (y >= 0) & (x < whole.mask.shape[1]) & (y < whole.mask.shape[0])
    return bool(whole.mask[y[inside], x[inside]].sum() > COVERED * len(x))


def _one_thing(better: Mask, refuted: Mask, still: Plane, moved: Plane) -> tuple[Mask, Mask] | tuple[None, None]:
    """Parts that follow one motion, and these with what lies between them and does not refute it.

    A plain inside tells nothing.
    """
    closed = cv2.morphologyEx(better.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((5, 5), np.uint8)) > 0
    parts = np.zeros(better.shape, bool)
    largest, most = None, 0
    for place, part in components(closed & ~refuted, LEAST_PART):
        core = part & better[place]
        if float(moved[place][core].sum()) > EXPLAINED * float(still[place][core].sum()):
            continue
        parts[place] |= part
        if np.count_nonzero(core) > most:
            most, largest = int(np.count_nonzero(core)), (place, part)
    if largest is None:
        return None, None
    _, labels = cv2.connectedComponents((parts | ~refuted).astype(np.uint8), connectivity=4)
    linked = labels == labels[largest[0]][largest[1]][0]
    hull = np.zeros(better.shape, np.uint8)
    parts &= linked
    cv2.fillConvexPoly(hull, cv2.convexHull(_rim(parts)), 1)
    return parts, np.asarray((hull > 0) & linked, bool)


def _rim(mask: Mask) -> NDArray[np.int32]:
    """First and last pixel of each row: all that a hull needs."""
    rows = np.flatnonzero(mask.any(axis=1))
    lines = mask[rows]
    first, last = lines.argmax(axis=1), mask.shape[1] - 1 - lines[:, ::-1].argmax(axis=1)
    return np.concatenate([np.column_stack([first, rows]), np.column_stack([last, rows])]).astype(np.int32)


def _registered(history: History, now: Plane, steps: int, found: Explained, motion: Affine) -> Affine:
    """The motion since an earlier frame, moved to where it explains the pixels of a mask best."""
    here, mask = now[found.area], found.mask
    rows, columns = np.nonzero(mask)
    x, y = columns + found.area[1].start, rows + found.area[0].start
    cx, cy = x.mean(), y.mean()
    dx, dy = x - cx, y - cy
    for _ in range(STEPS):
        then = history.view(steps, found.area, motion)
        gx, gy = (cv2.Sobel(then, cv2.CV_32F, order, 1 - order, scale=1 / 8)[mask] for order in (1, 0))
        left = (here - then)[mask].astype(np.float64)
        slopes = np.stack([gx, gy, gx * dx + gy * dy, gy * dx - gx * dy], axis=1).astype(np.float64)
        weighted = slopes / (1.0 + (left[:, None] / OUTLIER) ** 2)
        normal = weighted.T @ slopes
        # A plain or striped thing does not tell all four.
        normal = normal + 1e-3 * np.diag(np.diag(normal)) + 1e-6 * np.eye(4)
        u, v, growth, turn = -np.linalg.solve(normal, weighted.T @ left)
        matrix = np.array([[1.0 + growth, -turn], [turn, 1.0 + growth]])
        centre = np.array([cx, cy])
        motion = chained(np.column_stack([matrix, centre + np.array([u, v]) - matrix @ centre]), motion)
        if max(abs(u), abs(v)) < SETTLED:
            break
    return motion


def grown(area: Area, shape: tuple[int, ...], share: float) -> Area:
    """An area with a share of its longer side added all round, inside the frame."""
    rows, columns = area
    margin = max(round(share * max(rows.stop - rows.start, columns.stop - columns.start)), LEAST_ROOM)
    return (
        slice(max(rows.start - margin, 0), min(rows.stop + margin, shape[0])),
        slice(max(columns.start - margin, 0), min(columns.stop + margin, shape[1])),
    )


def _extent(found: Explained) -> Area:
    """Part of the frame that holds the mask."""
    box = box_from_mask(found.mask)
    assert box is not None
    top, left = found.area[0].start + int(box.y), found.area[1].start + int(box.x)
    return slice(top, top + int(box.h)), slice(left, left + int(box.w))
