"""Moving regions of two frames, without any ROI: the paper's steps 9–12.

Smoothed frames → Horn–Schunck flow → normal flow → threshold → segmentation → corners → boxes. The threshold
follows the noise of the two frames, so that a still scene gives no region however noisy it is.

Where the paper takes every pixel above the threshold, a pixel here must also be explained by the flow: the
ground that an object uncovers changes too, but nothing in the previous frame moved there.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .flow import HornSchunck, derivatives, normal_flow
from .frames import MIN_SIDE, as_pair, crop, fixed_errstate, to_gray
from .geometry import Box, iou

__all__ = ["DetectionFields", "DetectorParams", "FirstMover", "MotionDetector", "Region"]

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

NORMAL_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, of a normal distribution."""
MIN_CHANGE = 3.0
"""Smallest change in brightness that counts, gray levels. Video codecs skip most blocks of a still scene, so that the
median change is 0, and refresh others by one or two levels."""
REACH = 0.08
"""Widest gap between changed pixels of one object, over the frame's longer side: a plain object changes at its rim
only, and two objects that move alike must not become one."""
BORDER_PATIENCE = 5
"""How many times longer a region at the border of the frame must be seen before it is taken for the whole object."""
SPARSE = 2
"""Every second pixel, each way, is enough for a median over the frame."""


@dataclass(frozen=True, kw_only=True)
class DetectorParams:
    """How moving regions are found.

    Parameters
    ----------
    smoothing : float
        σ of the Gaussian before the flow, lattice px; >= 0.
    threshold : float or None
        Normal flow from which a pixel moves, frame px per frame, > 0. None follows the noise.
    noise_factor : float
        With ``threshold=None``: change in brightness from which a pixel moves, in standard deviations of the noise.
    min_speed : float
        Slowest motion of a region, frame px per frame.
    min_area : float
        Smallest region, as a share of the frame; > 0.
    max_side : int
        Longer side of the lattice, px; larger frames are averaged down to it.
    flow_side : int
        Longer side of the lattice the flow is solved on, px; it is smooth, so a coarser one loses little.
    max_corners : int
        Most corners per region.
    """

    smoothing: float = 1.0
    threshold: float | None = None
    noise_factor: float = 5.0
    min_speed: float = 0.15
    min_area: float = 5e-4
    max_side: int = 640
    flow_side: int = 320
    max_corners: int = 50

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        for name, lowest in (
            ("noise_factor", 0.0),
            ("min_area", 0.0),
            ("max_side", 31),
            ("flow_side", 31),
            ("max_corners", 0),
        ):
            if not getattr(self, name) > lowest:
                raise ValueError(f"expected {name} above {lowest:g}, got {getattr(self, name)!r}")
        for name in ("smoothing", "min_speed"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"expected {name} of at least 0, got {getattr(self, name)!r}")
        if self.threshold is not None and not self.threshold > 0:
            raise ValueError(f"expected threshold above 0 or None, got {self.threshold!r}")


@dataclass(frozen=True)
class Region:
    """A connected part of the current frame that moves.

    Parameters
    ----------
    box : Box
        Tight box in the current frame, px.
    mask : ndarray, shape (H, W), bool
        Its pixels, at the frame's size.
    flow : tuple of float
        Mean (u, v), frame px per frame.
    area : float
        px².
    corners : ndarray, shape (N, 2), float32
        x, y of corners inside the region, frame px, the strongest first.
    """

    box: Box
    mask: Mask
    flow: tuple[float, float]
    area: float
    corners: NDArray[np.float32]


@dataclass(frozen=True)
class DetectionFields:
    """What the detector has computed for one pair of frames; what ``display.render_panels`` shows.

    Arrays lie on a lattice over the whole frame, `step` frame px apart, and in the *current* frame: ``flow`` leads
    from where the pixel was to where it is.
    """

    window: Box
    step: float
    previous: Plane
    current: Plane
    Fx: Plane
    Fy: Plane
    Ft: Plane
    flow: Plane
    normal_flow: Plane
    mask: Mask


class MotionDetector:
    """Find what moves between two frames.

    Parameters
    ----------
    params : DetectorParams, optional

    Notes
    -----
    A camera that shifts the whole picture is allowed for: the median of the flow counts as standing still.
    """

    def __init__(self, params: DetectorParams | None = None) -> None:
        self.params = params if params is not None else DetectorParams()
        self._flow = HornSchunck("default")

    def detect(self, prev: Any, curr: Any) -> list[Region]:
        """Moving regions, the largest first.

        Parameters
        ----------
        prev, curr : ndarray
            Two frames of one size, as TrackerHS takes them.

        Returns
        -------
        list of Region
            In the current frame; empty where nothing moves.

        Raises
        ------
        InputError
            If a frame cannot be used or the sizes differ.
        """
        return self.regions(self.fields(prev, curr))

    @fixed_errstate
    def regions(self, fields: DetectionFields) -> list[Region]:
        """Regions of what :meth:`fields` has computed, the largest first; under 4 px there is nothing to track."""
        parts = _components(fields.mask, self._smallest(fields.mask))
        regions = [self._region(fields, area, part) for area, part in parts]
        wide = [region for region in regions if min(region.box.w, region.box.h) >= MIN_SIDE]
        return sorted(wide, key=lambda region: region.area, reverse=True)

    @fixed_errstate
    def fields(self, prev: Any, curr: Any) -> DetectionFields:
        """Every intermediate result of :meth:`detect`, on the lattice.

        Returns
        -------
        DetectionFields
            Its mask holds all regions together.

        Raises
        ------
        InputError
            As detect.
        """
        before, after = as_pair(prev, curr)
        step = max(1.0, max(after.width, after.height) / self.params.max_side)
        size = (max(round(after.width / step), 1), max(round(after.height / step), 1))
        planes = [_lattice(frame, size, self.params.smoothing) for frame in (before, after)]
        flow = self._motion(planes[0], planes[1])
        fx, fy, ft = derivatives(planes[0], planes[1])
        mask = self._segment(planes[0], planes[1], flow, step)
        window = Box(0.0, 0.0, float(after.width), float(after.height))
        return DetectionFields(window, step, planes[0], planes[1], fx, fy, ft, flow, normal_flow(fx, fy, ft), mask)

    def _motion(self, prev: Plane, curr: Plane) -> Plane:
        """Flow from prev to curr, at curr's pixels: solved backwards, so that it lies where the object is now."""
        height, width = curr.shape
        ratio = min(1.0, self.params.flow_side / max(height, width))
        if ratio == 1.0:
            return -self._flow.calc(curr, prev)
        size = (max(round(width * ratio), 1), max(round(height * ratio), 1))
        small = [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in (curr, prev)]
        flow = cv2.resize(self._flow.calc(small[0], small[1]), (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(flow * np.array([-width / size[0], -height / size[1]]), np.float32)

    def _smallest(self, mask: Mask) -> float:
        return max(self.params.min_area * mask.size, 9.0)

    def _segment(self, prev: Plane, curr: Plane, flow: Plane, step: float) -> Mask:
        """Changed pixels, filled to regions where the flow agrees, without the ground that was uncovered."""
        still = np.median(flow[::SPARSE, ::SPARSE].reshape(-1, 2), axis=0)
        signed = curr - _warp(prev, np.broadcast_to(still, flow.shape))
        change = np.abs(signed)
        seeds = (change > self._least_change(signed, curr, step)) & _near_crest(change)
        seeds &= _came_from_inside(seeds.shape, float(still[0]), float(still[1]))
        seeds = cv2.medianBlur(seeds.astype(np.uint8), 3) > 0
        speed = np.hypot(flow[..., 0] - still[0], flow[..., 1] - still[1])
        moving = speed > np.maximum(0.5 * _mean_over(speed, seeds), self.params.min_speed / step)
        moving &= ~_stands_still(change, curr, flow - still)
        filled = _filled(seeds, moving, self._smallest(seeds))
        # The object is where it has changed and came from where it has changed; what it uncovers came from nowhere.
        came_from = _warp(filled.astype(np.float32), flow)
        return filled & (came_from > 0.5)

    def _least_change(self, change: Plane, curr: Plane, step: float) -> Plane:
        """Change in brightness, per pixel, that stands for the threshold on the normal flow −Ft / |∇F|."""
        slope = np.hypot(*_slope(curr))
        if self.params.threshold is not None:
            return np.asarray(np.maximum(slope, 1.0) * (self.params.threshold / step), np.float32)
        sample = change[::SPARSE, ::SPARSE]
        noise = NORMAL_SIGMA * float(np.median(np.abs(sample - np.median(sample))))
        least = max(self.params.noise_factor * noise, MIN_CHANGE)
        return np.asarray(np.maximum(slope * (self.params.min_speed / step), least), np.float32)

    def _region(self, fields: DetectionFields, area: tuple[slice, slice], part: Mask) -> Region:
        height, width = round(fields.window.h), round(fields.window.w)
        whole = np.zeros(fields.mask.shape, np.uint8)
        whole[area] = part
        sx, sy = width / fields.mask.shape[1], height / fields.mask.shape[0]
        rows, columns = area
        box = Box.from_edges(columns.start * sx, rows.start * sy, columns.stop * sx, rows.stop * sy)
        u, v = fields.flow[area][part].mean(axis=0)
        corners = cv2.goodFeaturesToTrack(fields.current, self.params.max_corners, 0.05, 3.0, mask=whole)
        points = np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)
        return Region(
            box,
            np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_NEAREST) > 0, bool),
            (float(u) * sx, float(v) * sy),
            float(part.sum()) * sx * sy,
            np.asarray((points + 0.5) * np.array([sx, sy]) - 0.5, np.float32),
        )


def _lattice(frame: Any, size: tuple[int, int], smoothing: float) -> Plane:
    gray = to_gray(crop(frame, 0, 0, frame.width, frame.height))
    if size != (frame.width, frame.height):
        gray = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.float32)
    return np.asarray(cv2.GaussianBlur(gray, (0, 0), smoothing) if smoothing > 0 else gray, np.float32)


def _warp(prev: Plane, flow: NDArray[Any]) -> Plane:
    """The previous frame carried along the flow to where its pixels are now."""
    y, x = np.mgrid[0 : prev.shape[0], 0 : prev.shape[1]].astype(np.float32)
    return np.asarray(
        cv2.remap(
            prev,
            np.asarray(x - flow[..., 0], np.float32),
            np.asarray(y - flow[..., 1], np.float32),
            cv2.INTER_CUBIC,
            borderMode=cv2.BORDER_REPLICATE,
        ),
        np.float32,
    )


def _came_from_inside(shape: tuple[int, ...], u: float, v: float) -> Mask:
    """Pixels that were in the frame before the camera moved: of the others nothing is known."""
    known = np.zeros(shape, bool)
    left, top = max(math.ceil(u), 0), max(math.ceil(v), 0)
    right, bottom = shape[1] + min(math.floor(u), 0), shape[0] + min(math.floor(v), 0)
    known[top : max(bottom, 0), left : max(right, 0)] = True
    return known


def _stands_still(change: Plane, curr: Plane, motion: Plane) -> Mask:
    """Where the motion, were it true, would have changed the picture, and it has not.

    The flow is smooth and runs over the edge of the object; the ground's own texture tells where it is wrong.
    """
    gx, gy = _slope(curr)
    predicted = gx * motion[..., 0] + gy * motion[..., 1]
    expected = cv2.blur(np.asarray(predicted**2, np.float32), (9, 9))
    observed = cv2.blur(np.asarray(change**2, np.float32), (9, 9))
    return np.asarray((expected > 0.5) & (observed < 0.3 * expected), bool)


def _slope(plane: Plane) -> tuple[Plane, Plane]:
    """Gradient, gray levels per lattice px."""
    gx, gy = (cv2.Sobel(plane, cv2.CV_32F, dx, 1 - dx) / 8 for dx in (1, 0))
    return np.asarray(gx, np.float32), np.asarray(gy, np.float32)


def _near_crest(change: Plane) -> Mask:
    """Where a change is not the halo of a stronger one.

    It must exceed 40 % of the strongest change within 3 px, as smoothing spreads a change past its edge, and 15 % of
    the strongest within 20 px, as codecs ring round what moves.
    """
    near, wide = (cv2.dilate(change, np.ones((side, side), np.uint8)) for side in (7, 41))
    return np.asarray((change > 0.4 * near) & (change > 0.15 * wide), bool)


def _mean_over(values: Plane, mask: Mask) -> Plane:
    """Mean of the values at the mask's pixels nearby."""
    weight = mask.astype(np.float32)
    total = cv2.blur(np.asarray(values * weight, np.float32), (31, 31))
    return np.asarray(total / np.maximum(cv2.blur(weight, (31, 31)), 1e-6), np.float32)


def _filled(seeds: Mask, moving: Mask, smallest: float) -> Mask:
    """Seeds that the flow links, filled: a plain object changes only at its rim."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    closed = cv2.morphologyEx(seeds.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    width = max(round(REACH * max(seeds.shape)), 7)
    reach = cv2.morphologyEx(seeds.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((width, width), np.uint8))
    linked = (closed > 0) | (moving & (reach > 0))
    filled = np.zeros(seeds.shape, bool)
    for area, part in _components(linked, smallest):
        points = cv2.findNonZero((part & seeds[area]).astype(np.uint8))
        if points is None or len(points) < smallest / 3:
            continue
        hull = np.zeros(part.shape, np.uint8)
        cv2.fillConvexPoly(hull, cv2.convexHull(points), 1)
        filled[area] |= (hull > 0) & linked[area]
    return np.asarray(cv2.morphologyEx(filled.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0, bool)


def _components(mask: Mask, smallest: float) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """Each connected component of at least `smallest` pixels: where it lies and its pixels there."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    for label in np.flatnonzero(stats[1:, cv2.CC_STAT_AREA] >= smallest) + 1:
        x, y, w, h = (int(value) for value in stats[label, :4])
        area = slice(y, y + h), slice(x, x + w)
        yield area, labels[area] == label


class FirstMover:
    """Watch frames until an object moves in several of them in a row.

    Parameters
    ----------
    params : DetectorParams, optional
    confirm : int
        Pairs of frames in a row in which the region must be found, overlapping itself; five times as many where it
        touches the border.

    Attributes
    ----------
    fields : DetectionFields or None
        What the last pair of frames gave; None before there is a pair.
    """

    def __init__(self, params: DetectorParams | None = None, *, confirm: int = 3) -> None:
        self.fields: DetectionFields | None = None
        self._detector = MotionDetector(params)
        self._confirm = confirm
        self._previous: Any = None
        self._candidate: Region | None = None
        self._seen = 0

    def update(self, frame: Any) -> Region | None:
        """Look at the next frame; the object's region in it once it is sure, None before.

        Raises
        ------
        InputError
            As MotionDetector.detect.
        """
        previous, self._previous = self._previous, frame
        if previous is None:
            return None
        self.fields = self._detector.fields(previous, frame)
        regions = self._detector.regions(self.fields)
        last = self._candidate
        same = [region for region in regions if last is not None and iou(region.box, last.box) > 0.3]
        self._seen = self._seen + 1 if same else min(len(regions), 1)
        self._candidate = next(iter(same or regions), None)
        if self._candidate is None:
            return None
        # What touches the border is mostly on its way in: worth waiting for, but a face before a webcam stays there.
        needed = self._confirm * (BORDER_PATIENCE if _touches_border(self._candidate) else 1)
        return self._candidate if self._seen >= needed else None


def _touches_border(region: Region) -> bool:
    """Whether the region is at the border of the frame, or was in the frame before."""
    height, width = region.mask.shape
    before = region.box.moved(-region.flow[0], -region.flow[1])
    return any(
        box.x < 1 or box.y < 1 or box.right > width - 1 or box.bottom > height - 1 for box in (region.box, before)
    )
