"""How the object moves: prediction, Horn–Schunck flow, robust affine fit, registration with the object layer."""

from __future__ import annotations

import math
import threading
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from . import background as ground
from .kernels import FAR_OFF, fit_affine, start_flow
from .mask import dilate
from .registration import Points, list_points, misfit, refine
from .state import Atlas, Image, LayersParams, LayersState, Plane
from .window import View, transformed

__all__ = ["Grid", "Moves", "displace", "find", "follow", "warp"]

_LOCAL = threading.local()
_NO_LINEAR = (0.0, 0.0, 0.0, 0.0)
_CONTINUE = 1.03  # the motion found from the predicted one wins where it explains the frame about as well
_FIT_PIXELS = 1200  # enough for eight parameters; more only cost time


class Grid(NamedTuple):
    """Normalised coordinates of an object: X = (x − cx) / scale, window px, and the area in pixels."""

    cx: float
    cy: float
    scale: float
    area: float

    @property
    def triple(self) -> NDArray[np.float64]:
        """(cx, cy, scale) as the kernels want it."""
        return np.array((self.cx, self.cy, self.scale))


class Moves(NamedTuple):
    """How everything moved into this frame.

    grid, theta : affine motion of the object, as in `kernels.gauss_newton`.
    residual : mean residual of the motion that was predicted, gray levels.
    flow : dense, window px per frame.
    camera : translation of the background, lattice px.
    atlas : the background, registered to this frame.
    contrast : how much the object moves against the camera, 0–1, slowly forgetting.
    """

    grid: Grid
    theta: NDArray[np.float64]
    residual: float
    flow: NDArray[np.float32]
    camera: tuple[float, float]
    atlas: Atlas
    contrast: float

    @property
    def velocity(self) -> tuple[float, float]:
        """Translation of the object, lattice px."""
        return float(self.theta[0]), float(self.theta[3])


def find(state: LayersState, view: View, params: LayersParams) -> Moves:
    """Motion of object and camera into this frame."""
    obj = (state.odds > 0).view(np.uint8)
    grid = _grid_of(obj, state)
    weight = (state.visible if state.occlusion.occluded else obj).astype(np.float32)
    if state.count == 0:  # the corners of a drawn box are ground, more often than not
        weight = np.clip(state.odds, 0.0, 1.0).astype(np.float32)
    points = list_points(state.obj, weight, grid.triple, grid.area, _FIT_PIXELS)
    predicted = _predict(state, view, points, weight, grid)
    near = dilate(obj, 5)
    flow = _dense_flow(view, near, grid, predicted[0], state, params)
    atlas, camera = _ground(state, view, flow, near)
    theta = _measure(state, view, flow, points, weight, grid, predicted[0], camera)
    few = state.occlusion.occluded and np.count_nonzero(weight) < 0.1 * state.box[2] * state.box[3]
    if few or state.occlusion.coasting:  # hardly anything is seen: it moves as it did before
        theta = _theta(state.velocity, _NO_LINEAR, grid.scale)
    return Moves(grid, theta, predicted[1], flow, camera, atlas, _contrast(theta, camera, state.contrast))


def follow(
    state: LayersState, view: View, obj: NDArray[np.uint8], velocity: tuple[float, float], params: LayersParams
) -> Moves:
    """Motion of the camera into this frame; that of the object is given."""
    grid = _grid_of(obj, state)
    theta = _theta(velocity, _NO_LINEAR, grid.scale)
    near = dilate(obj, 5)
    flow = _dense_flow(view, near, grid, theta, state, params)
    atlas, camera = _ground(state, view, flow, near)
    return Moves(grid, theta, state.match_cost, flow, camera, atlas, _contrast(theta, camera, state.contrast))


def displace(moves: Moves, shift: tuple[int, int]) -> Moves:
    """Add a translation to the object's motion."""
    theta = moves.theta.copy()
    theta[0] += shift[0]
    theta[3] += shift[1]
    return moves._replace(theta=theta)


def _ground(
    state: LayersState, view: View, flow: NDArray[np.float32], near: NDArray[np.uint8]
) -> tuple[Atlas, tuple[float, float]]:
    camera = ground.camera_from_flow(flow, near, state.camera)
    registered = ground.register(state.atlas, view.image, near, camera, state.noise, view.inside)
    return ground.fill_new(registered.atlas, view.image, state.odds), registered.camera


def _contrast(theta: NDArray[np.float64], camera: tuple[float, float], last: float) -> float:
    relative = math.hypot(theta[0] - camera[0], theta[3] - camera[1])
    relative += 0.2 * float(abs(theta[1]) + abs(theta[2]) + abs(theta[4]) + abs(theta[5]))
    return max(min(relative / 0.4, 1.0), 0.9 * last)


def _grid_of(mask: NDArray[np.uint8], state: LayersState) -> Grid:
    """Centre and scale of a mask; of the last box when the mask is empty."""
    moments = cv2.moments(mask, binaryImage=True)
    area = moments["m00"]
    if area < 4:
        x, y, w, h = state.box
        return Grid(
            x - state.origin[0] + w / 2, y - state.origin[1] + h / 2, max(6.0, max(w, h) / 2), max(w * h, 1.0)
        )
    _, _, w, h = cv2.boundingRect(mask)
    return Grid(moments["m10"] / area, moments["m01"] / area, max(6.0, max(w, h) / 2), area)


def _theta(
    velocity: tuple[float, float], linear: tuple[float, float, float, float], scale: float
) -> NDArray[np.float64]:
    vx, vy = velocity
    a, b, c, d = (value * scale for value in linear)
    return np.array((vx, a, b, vy, c, d, 0.0, 0.0))


def _predict(
    state: LayersState, view: View, points: Points, weight: Plane, grid: Grid
) -> tuple[NDArray[np.float64], float]:
    """Affine motion expected for this frame, and its mean residual.

    The last motion, its translation alone or the camera's motion, whichever explains the frame best; a search over
    translations when none does (always in the second frame, whose motion nobody knows).
    """

    def cost_of(theta: NDArray[np.float64]) -> float:
        return misfit(points, view.image, theta, FAR_OFF, view.inside)

    if state.occlusion.occluded or state.occlusion.coasting:
        return _theta(state.velocity, _NO_LINEAR, grid.scale), state.match_cost
    best = _theta(state.velocity, state.linear, grid.scale)
    cost = cost_of(best)
    bent = max(map(abs, state.linear)) * grid.scale > 0.02
    for velocity in (state.velocity, state.camera) if bent else (state.camera,):
        if velocity == state.camera and math.hypot(velocity[0] - best[0], velocity[1] - best[3]) < 0.1:
            continue
        other = _theta(velocity, _NO_LINEAR, grid.scale)
        other_cost = cost_of(other)
        if other_cost < cost - 0.3:
            best, cost = other, other_cost
    first = state.count == 0
    if first or cost > 1.5 * state.match_cost + 1.0:
        shift = _search(state, view.image, weight, grid)
        other = _theta(shift, _NO_LINEAR, grid.scale)
        other_cost = cost_of(other)
        dx, dy = shift[0] - state.velocity[0], shift[1] - state.velocity[1]
        distance = dx * dx + dy * dy
        penalised = other_cost * (1 + distance / (2 * (0.5 * grid.scale + 8) ** 2)) + 0.02 * distance
        if penalised < (0.92 * cost - 0.15 if first else 0.85 * cost - 0.5):
            best, cost = other, other_cost
    return best, cost


def _search(state: LayersState, image: Image, weight: Plane, grid: Grid) -> tuple[float, float]:
    """Translation of the object layer with the least masked squared difference, near ones preferred."""
    reduce = 2 if 2 * grid.scale >= 24 else 1
    channels = image.shape[2]
    obj, mask = state.obj, weight
    if reduce == 2:
        size = (image.shape[1] // 2, image.shape[0] // 2)
        image, obj, mask = (
            np.asarray(cv2.resize(a, size, interpolation=cv2.INTER_AREA), dtype=np.float32)
            for a in (image, obj, weight)
        )
    mask8 = (mask > 0.5).astype(np.uint8)
    x, y, w, h = cv2.boundingRect(mask8)
    if w < 2 or h < 2:
        return state.velocity
    template = np.ascontiguousarray(obj[y : y + h, x : x + w])
    masks = np.repeat(mask8[y : y + h, x : x + w, np.newaxis].astype(np.float32), channels, axis=2).reshape(
        template.shape
    )
    squares = cv2.matchTemplate(image, template, cv2.TM_SQDIFF, mask=masks)
    cost = np.sqrt(np.maximum(squares, 0) / max(float(masks.sum()), 1.0))
    sx = reduce * (np.arange(cost.shape[1]) - x) - state.velocity[0]
    sy = reduce * (np.arange(cost.shape[0]) - y) - state.velocity[1]
    distance = sx[np.newaxis, :] ** 2 + sy[:, np.newaxis] ** 2
    cost = cost * (1 + distance / (2 * (0.5 * grid.scale + 8) ** 2)) + 0.02 * distance
    row, column = divmod(int(np.argmin(cost)), cost.shape[1])
    return float(reduce * (column - x)), float(reduce * (row - y))


def _solver(levels: int, params: LayersParams) -> Any:
    """One flow solver per thread and setting: it owns a workspace, which threads must not share."""
    from ..flow import HornSchunck

    cache = _LOCAL.__dict__.setdefault("solvers", {})
    key = (levels, params.smoothness, params.warps)
    if key not in cache:
        cache[key] = HornSchunck(
            "fast", smoothness=params.smoothness, levels=levels, warps=params.warps, ratio=0.5, iterations=5, gain=1.0
        )
    return cache[key]


def _dense_flow(
    view: View,
    near: NDArray[np.uint8],
    grid: Grid,
    theta: NDArray[np.float64],
    state: LayersState,
    params: LayersParams,
) -> NDArray[np.float32]:
    """Horn–Schunck flow, started from the predicted motion near the object and from the camera's elsewhere.

    The start field and few levels are what lets a small object with a large motion survive: it would vanish on
    coarse levels.
    """
    side = max(min(state.box[2], state.box[3]), 8.0)
    levels = int(min(max(1 + np.floor(np.log2(side / 10.0)), 1), 3))
    h, w = view.gray.shape
    start = np.empty((h, w, 2), np.float32)
    start_flow(near, grid.triple, theta, np.array(state.camera), start)
    flow: NDArray[np.float32] = _solver(levels, params).calc(view.previous, view.gray, start)
    return flow


def _measure(
    state: LayersState,
    view: View,
    flow: NDArray[np.float32],
    points: Points,
    weight: Plane,
    grid: Grid,
    predicted: NDArray[np.float64],
    camera: tuple[float, float],
) -> NDArray[np.float64]:
    """Affine motion of the object: the flow's robust fit, sharpened against the object layer.

    The fit follows the frame pair, the layer keeps it from drifting. Registration starts from the fit and from the
    prediction, and is believed only near its start.
    """
    hidden = state.occlusion.occluded
    fitted = _fit(state, view, flow, weight, grid, predicted, camera)
    strength = max(state.noise, 2.0) ** 2 * (5.0 if hidden else 1.0)
    stiff, steady = 0.05 * strength, 0.02 * strength
    prior = np.array((steady, stiff, stiff, steady, stiff, stiff, 0.02, steady))
    # what differs by more than the fit takes seriously (a highlight, something in front) must not decide either
    scale = 3.0 * state.noise + 3.0
    best, limit = fitted, math.inf
    for start in (fitted, predicted):
        if start is predicted and max(abs(start[0] - fitted[0]), abs(start[3] - fitted[3])) < 0.05:
            continue
        theta, before, after = refine(points, view.image, start, prior, scale, scale, view.inside)
        if start is fitted:
            limit = before
        moved = math.hypot(theta[0] - start[0], theta[3] - start[3])
        stretched = max(abs(theta[1]), abs(theta[2]), abs(theta[4]), abs(theta[5]))
        if moved > 3.0 or stretched > 0.4 * grid.scale:
            continue
        if after < (limit if start is fitted else _CONTINUE * limit):
            best, limit = theta, after
    return best


def _fit(
    state: LayersState,
    view: View,
    flow: NDArray[np.float32],
    weight: Plane,
    grid: Grid,
    predicted: NDArray[np.float64],
    camera: tuple[float, float],
) -> NDArray[np.float64]:
    """Affine motion of the object by the flow alone."""
    hidden = state.occlusion.occluded
    fitted = predicted.copy()
    ridge = np.array((0.018, 0.9, 0.9) if hidden else (0.006, 0.03, 0.03))
    odds = np.where(weight > 0, state.odds, np.float32(-1.0)) if hidden else state.odds
    stride = max(1, round(grid.area / _FIT_PIXELS))
    workspace = np.empty((7, 2 * _FIT_PIXELS), np.float32)
    fit_affine(
        flow, view.previous, odds, grid.triple, ridge, state.noise, np.array(camera), state.count < 3, stride,
        workspace, fitted,
    )  # fmt: skip
    limit = 0.0 if hidden else 0.35 * grid.scale
    for i in (1, 2, 4, 5):
        fitted[i] = min(max(fitted[i], -limit), limit)
    return fitted


def warp(
    image: NDArray[np.float32], theta: NDArray[np.float64], grid: Grid, fill: float | None
) -> NDArray[np.float32]:
    """Image moved by an affine motion; where nothing comes from the window `fill`, or (None) its border."""
    a, b, c, d = (float(theta[i]) / grid.scale for i in (1, 2, 4, 5))
    x = float(theta[0]) - a * grid.cx - b * grid.cy
    y = float(theta[3]) - c * grid.cx - d * grid.cy
    size = (image.shape[0], image.shape[1])
    return transformed(image, (1 + a, b, x, c, 1 + d, y), size, fill)
