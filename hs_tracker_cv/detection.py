"""Moving regions of two frames, without any ROI: the paper's steps 9–12.

Smoothed frames → Horn–Schunck flow → normal flow → threshold → segmentation → corners → boxes. The threshold
follows the noise of the two frames, so that a still scene gives no region however noisy it is.

Where the paper takes every pixel above the threshold, a pixel here must also be explained by the flow: the
ground that an object uncovers changes too, but nothing in the previous frame moved there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import STILL, camera_flow
from .comparison import Comparison, DetectorParams, compare, reduced
from .flow import HornSchunck, derivatives, normal_flow
from .frames import MIN_SIDE, as_pair, fixed_errstate
from .geometry import Box

__all__ = ["DetectionFields", "DetectorParams", "MotionDetector", "Region", "components"]

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

REACH = 0.08
"""Widest gap between changed pixels of one object, over the frame's longer side: a plain object changes at its rim
only, and two objects that move alike must not become one."""
SMALLEST = 9.0
"""Smallest region in any frame, lattice px²."""
AS_FAST = 0.5
"""Share of the mean speed of the changed pixels nearby from which a pixel moves with them."""
CAME_FROM = 0.5
"""Share of a pixel that came from a changed one, from which it is no uncovered ground."""
TELLING = 0.5
"""Squared change, gray levels², that a motion must predict to be refuted where it is not seen."""
UNSEEN = 0.3
"""Share of the predicted change below which it is not seen."""
AROUND_TOLD, AROUND_SPEED = 9, 31
"""Sides, lattice px, of the squares over which these changes, and the speed of the changed pixels, are averaged."""
CORNER, CORNER_APART = 0.05, 3.0
"""Quality of a corner, as a share of the best one's, and distance between two, lattice px."""


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
        parts = components(fields.mask, self._smallest(fields.mask))
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
        before, after = (reduced(frame, self.params) for frame in as_pair(prev, curr))
        return self.fields_of(compare(before, after, self.params))

    @fixed_errstate
    def fields_of(self, pair: Comparison) -> DetectionFields:
        """As :meth:`fields`, of two frames that have been compared already."""
        predicted, curr, step = pair.predicted, pair.after.gray, pair.after.step
        fx, fy, ft = derivatives(predicted, curr)
        mask = np.zeros(curr.shape, bool)
        flow = np.zeros((*curr.shape, 2), np.float32)
        if pair.seeds.any():
            flow = self.flow_of(pair)
            mask = self._segment(pair, flow)
        if pair.motion is not None and pair.motion is not STILL:
            flow += camera_flow(pair.motion, *curr.shape)
        window = Box(0.0, 0.0, float(pair.after.width), float(pair.after.height))
        return DetectionFields(window, step, predicted, curr, fx, fy, ft, flow, normal_flow(fx, fy, ft), mask)

    def flow_of(self, pair: Comparison) -> Plane:
        """Flow beyond the camera's, at the later frame's pixels: solved backwards, it lies where an object is.

        Returns
        -------
        ndarray, shape (h, w, 2), float32
            Lattice px per frame.
        """
        prev, curr = pair.predicted, pair.after.gray
        height, width = curr.shape
        ratio = min(1.0, self.params.flow_side / max(height, width))
        if ratio == 1.0:
            return -self._flow.calc(curr, prev)
        size = (max(round(width * ratio), 1), max(round(height * ratio), 1))
        small = [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in (curr, prev)]
        flow = cv2.resize(self._flow.calc(small[0], small[1]), (width, height), interpolation=cv2.INTER_LINEAR)
        return np.asarray(flow * np.array([-width / size[0], -height / size[1]]), np.float32)

    def _smallest(self, mask: Mask) -> float:
        return max(self.params.min_area * mask.size, SMALLEST)

    def _segment(self, pair: Comparison, flow: Plane) -> Mask:
        """Changed pixels, filled to regions where the flow agrees, without the ground that was uncovered."""
        speed = np.hypot(flow[..., 0], flow[..., 1])
        moving = speed > np.maximum(AS_FAST * _mean_over(speed, pair.seeds), self.params.min_speed / pair.after.step)
        moving &= ~_stands_still(pair.change, pair.after.gray, flow)
        filled = _filled(pair.seeds, moving, self._smallest(pair.seeds))
        # The object is where it has changed and came from where it has changed; what it uncovers came from nowhere.
        came_from = _warp(filled.astype(np.float32), flow)
        return filled & (came_from > CAME_FROM)

    def _region(self, fields: DetectionFields, area: tuple[slice, slice], part: Mask) -> Region:
        height, width = round(fields.window.h), round(fields.window.w)
        whole = np.zeros(fields.mask.shape, np.uint8)
        whole[area] = part
        sx, sy = width / fields.mask.shape[1], height / fields.mask.shape[0]
        rows, columns = area
        box = Box.from_edges(columns.start * sx, rows.start * sy, columns.stop * sx, rows.stop * sy)
        u, v = fields.flow[area][part].mean(axis=0)
        corners = cv2.goodFeaturesToTrack(fields.current, self.params.max_corners, CORNER, CORNER_APART, mask=whole)
        points = np.zeros((0, 2), np.float32) if corners is None else corners.reshape(-1, 2)
        return Region(
            box,
            np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_NEAREST) > 0, bool),
            (float(u) * sx, float(v) * sy),
            float(part.sum()) * sx * sy,
            np.asarray((points + 0.5) * np.array([sx, sy]) - 0.5, np.float32),
        )


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


def _stands_still(change: Plane, curr: Plane, motion: Plane) -> Mask:
    """Where the motion, were it true, would have changed the picture, and it has not.

    The flow is smooth and runs over the edge of the object; the ground's own texture tells where it is wrong.
    """
    gx, gy = (cv2.Sobel(curr, cv2.CV_32F, dx, 1 - dx, scale=1 / 8) for dx in (1, 0))
    predicted = gx * motion[..., 0] + gy * motion[..., 1]
    expected = cv2.blur(np.asarray(predicted**2, np.float32), (AROUND_TOLD, AROUND_TOLD))
    observed = cv2.blur(np.asarray(change**2, np.float32), (AROUND_TOLD, AROUND_TOLD))
    return np.asarray((expected > TELLING) & (observed < UNSEEN * expected), bool)


def _mean_over(values: Plane, mask: Mask) -> Plane:
    """Mean of the values at the mask's pixels nearby."""
    weight = mask.astype(np.float32)
    total = cv2.blur(np.asarray(values * weight, np.float32), (AROUND_SPEED, AROUND_SPEED))
    return np.asarray(total / np.maximum(cv2.blur(weight, (AROUND_SPEED, AROUND_SPEED)), 1e-6), np.float32)


def _filled(seeds: Mask, moving: Mask, smallest: float) -> Mask:
    """Seeds that the flow links, filled: a plain object changes only at its rim."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    closed = cv2.morphologyEx(seeds.astype(np.uint8), cv2.MORPH_CLOSE, kernel)
    width = max(round(REACH * max(seeds.shape)), 7)
    reach = cv2.morphologyEx(seeds.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((width, width), np.uint8))
    linked = (closed > 0) | (moving & (reach > 0))
    filled = np.zeros(seeds.shape, bool)
    for area, part in components(linked, smallest):
        points = cv2.findNonZero((part & seeds[area]).astype(np.uint8))
        if points is None or len(points) < smallest / 3:
            continue
        hull = np.zeros(part.shape, np.uint8)
        cv2.fillConvexPoly(hull, cv2.convexHull(points), 1)
        filled[area] |= (hull > 0) & linked[area]
    return np.asarray(cv2.morphologyEx(filled.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0, bool)


def components(mask: Mask, smallest: float) -> Iterator[tuple[tuple[slice, slice], Mask]]:
    """Each connected component of at least `smallest` pixels: where it lies and its pixels there."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    for label in np.flatnonzero(stats[1:, cv2.CC_STAT_AREA] >= smallest) + 1:
        x, y, w, h = (int(value) for value in stats[label, :4])
        area = slice(y, y + h), slice(x, x + w)
        yield area, labels[area] == label
