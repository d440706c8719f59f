"""How the object moves: prediction, Horn–Schunck flow, robust affine fit, registration with the object layer."""

from __future__ import annotations

import math
import threading
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from . import background as ground
from .kernels import FAR_OFF, fit_affine, outline, start_flow
from .mask import dilate
from .registration import Points, list_points, misfit, refine
from .state import Atlas, Image, LayersParams, LayersState, Plane
from .window import View

__all__ = ["Grid", "Moves", "displace", "find", "follow", "inverse_matrix", "where_to"]

_LOCAL = threading.local()
_NO_LINEAR = (0.0, 0.0, 0.0, 0.0)
_CONTINUE = 1.03  # the motion found from the predicted one wins where it explains the frame about as well
_EVENLY, _BY_ODDS, _AS_VISIBLE = range(3)  # what the pixels of the object weigh, for `kernels.outline`
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
    extent : (x0, y0, x1, y1) of all that may have belonged to the object, window px of the last frame.
    """

    grid: Grid
    theta: NDArray[np.float64]
    residual: float
    flow: NDArray[np.float32]
    camera: tuple[float, float]
    atlas: Atlas
    contrast: float
    extent: tuple[int, int, int, int]

    @property
    def velocity(self) -> tuple[float, float]:
        """Translation of the object, lattice px."""
        return float(self.theta[0]), float(self.theta[3])


def find(state: LayersState, view: View, params: LayersParams) -> Moves:
    """Motion of object and camera into this frame."""
    hidden = state.visible is not None
    # the corners of a drawn box are ground, more often than not
    way = _AS_VISIBLE if hidden else _BY_ODDS if state.count == 0 else _EVENLY
    shape = _outline(state.odds, state, way)
    grid = shape.grid
    points = list_points(state.obj, shape.weight, grid.triple, grid.area, _FIT_PIXELS)
    predicted = _predict(state, view, points, shape.weight, grid)
    near = dilate(shape.mask, 5)
    flow = _dense_flow(view, near, grid, predicted[0], state, params)
    atlas, camera = _ground(state, view, flow, near)
    few = hidden and shape.seen < 0.1 * state.box[2] * state.box[3]
    if few or state.occlusion.coasting:  # hardly anything is seen: it moves as it did before
        theta = _theta(state.velocity, _NO_LINEAR, grid.scale)
    else:
        theta = _measure(state, view, flow, points, shape.weight, grid, predicted[0], camera)
    contrast = _contrast(theta, camera, state.contrast)
    return Moves(grid, theta, predicted[1], flow, camera, atlas, contrast, shape.extent)


def follow(state: LayersState, view: View, odds: Plane, velocity: tuple[float, float], params: LayersParams) -> Moves:
    """Motion of the camera into this frame; that of the object, which is where `odds` are positive, is given."""
    shape = _outline(odds, state, _EVENLY)
    theta = _theta(velocity, _NO_LINEAR, shape.grid.scale)
    near = dilate(shape.mask, 5)
    flow = _dense_flow(view, near, shape.grid, theta, state, params)
    atlas, camera = _ground(state, view, flow, near)
    contrast = _contrast(theta, camera, state.contrast)
    return Moves(shape.grid, theta, state.match_cost, flow, camera, atlas, contrast, shape.extent)


def displace(moves: Moves, shift: tuple[int, int]) -> Moves:
    """Add a translation to the object's motion."""
    theta = moves.theta.copy()
    theta[0] += shift[0]
    theta[3] += shift[1]
    return moves._replace(theta=theta)


def _ground(state: LayersState, view: View, flow: NDArray[np.float32], near: NDArray[np.uint8]) -> ground.Background:
    camera = ground.camera_from_flow(flow, near, state.camera)
    return ground.register(state.atlas, view.image, state.odds, near, camera, state.noise, view.inside)


def _contrast(theta: NDArray[np.float64], camera: tuple[float, float], last: float) -> float:
    relative = math.hypot(theta[0] - camera[0], theta[3] - camera[1])
    relative += 0.2 * float(abs(theta[1]) + abs(theta[2]) + abs(theta[4]) + abs(theta[5]))
    return max(min(relative / 0.4, 1.0), 0.9 * last)


class _Outline(NamedTuple):
    """Where the object is: mask, weights of its pixels and their sum, coordinates, and all that may belong to it."""

    mask: NDArray[np.uint8]
    weight: Plane
    seen: float
    grid: Grid
    extent: tuple[int, int, int, int]


def _outline(odds: Plane, state: LayersState, way: int) -> _Outline:
    """Outline of {odds > 0}; of the last box when that is empty."""
    mask, weight, sums = np.empty(odds.shape, np.uint8), np.empty_like(odds), np.empty(12)
    outline(odds, mask if state.visible is None else state.visible, way, mask, weight, sums)
    area, x, y, left, right, top, bottom, first_x, last_x, first_y, last_y, seen = sums.tolist()
    extent = (int(first_x), int(first_y), int(last_x) + 1, int(last_y) + 1)
    if area < 4:
        bx, by, w, h = state.box
        cx, cy = bx - state.origin[0] + w / 2, by - state.origin[1] + h / 2
        grid = Grid(cx, cy, max(6.0, max(w, h) / 2), max(w * h, 1.0))
    else:
        grid = Grid(x / area, y / area, max(6.0, max(right - left + 1, bottom - top + 1) / 2), area)
    return _Outline(mask, weight, seen, grid, extent)


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
    cache = _LOCAL.__dict__.setdefault("solvers", {})
    key = (levels, params.smoothness, params.warps)
    if key not in cache:
        from ..flow import HornSchunck

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


def inverse_matrix(theta: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """Where the pixels of this frame come from by an affine motion, as `kernels.resample` wants it."""
    vx, a, b, vy, c, d = theta[:6].tolist()
    a, b, c, d = 1.0 + a / grid.scale, b / grid.scale, c / grid.scale, 1.0 + d / grid.scale
    x = vx - (a - 1.0) * grid.cx - b * grid.cy
    y = vy - c * grid.cx - (d - 1.0) * grid.cy
    size = a * d - b * c
    return np.array((d / size, -b / size, (b * y - d * x) / size, -c / size, a / size, (c * x - a * y) / size))


def where_to(extent: tuple[int, int, int, int], theta: NDArray[np.float64], grid: Grid) -> tuple[float, ...]:
    """Box (x0, y0, x1, y1) round all places to which an affine motion takes the pixels of a rectangle."""
    vx, a, b, vy, c, d = theta[:6].tolist()
    xs, ys = ((extent[0], extent[2]), (extent[1], extent[3]))
    corners = [((x - grid.cx) / grid.scale, (y - grid.cy) / grid.scale, x, y) for x in xs for y in ys]
    across = [x + vx + a * unit_x + b * unit_y for unit_x, unit_y, x, _ in corners]
    down = [y + vy + c * unit_x + d * unit_y for unit_x, unit_y, _, y in corners]
    return min(across), min(down), max(across), max(down)
