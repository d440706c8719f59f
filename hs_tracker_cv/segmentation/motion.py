"""How the object moves: prediction, Horn–Schunck flow, robust affine fit, registration with the object layer."""

from __future__ import annotations

import math
import threading
from typing import Any, NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from .._native.kernels import segmentation as kernels
from . import background as ground
from . import tuning
from .state import Atlas, Image, Plane, SegmentationParams, SegmentationState
from .window import Window, differences, outside, translated

__all__ = ["Grid", "Moves", "displace", "find", "follow", "inverse_matrix", "where_to"]

_LOCAL = threading.local()
_NO_LINEAR = (0.0, 0.0, 0.0, 0.0)
_EVENLY, _AS_VISIBLE, _AS_CHANGED = range(3)  # what the pixels of the object weigh, for `predict_motion`


class Grid(NamedTuple):
    """Normalised coordinates of an object: X = (x − cx) / scale, window px, and the area in pixels."""

    cx: float
    cy: float
    scale: float
    area: float


class Moves(NamedTuple):
    """How everything moved into this frame.

    grid, theta : affine motion of the object, as the kernels have it.
    residual : mean residual of the motion that was predicted, gray levels.
    flow : dense, window px per frame.
    camera : translation of the background, lattice px.
    atlas : the background, registered to this frame.
    contrast : how much the object moves against the camera, 0–1, slowly forgetting.
    extent : (x0, y0, x1, y1) of all that may have belonged to the object, window px of the last frame.
    misfit : how little what is seen along the motion looks like the object, 0 (as ever) to 1 (nothing like it).
    """

    grid: Grid
    theta: NDArray[np.float64]
    residual: float
    flow: NDArray[np.float32]
    camera: tuple[float, float]
    atlas: Atlas
    contrast: float
    extent: tuple[int, int, int, int]
    misfit: float

    @property
    def velocity(self) -> tuple[float, float]:
        """Translation of the object, lattice px."""
        return float(self.theta[0]), float(self.theta[3])


def find(state: SegmentationState, window: Window, params: SegmentationParams) -> Moves:
    """Motion of object and camera into this frame."""
    hidden = state.visible is not None
    coasting = state.occlusion.coasting > 0
    # the corners of a drawn box are ground, more often than not
    way = _AS_VISIBLE if hidden else _AS_CHANGED if state.count < tuning.MOVING_YOUNG else _EVENLY
    changed = _changed(state, window, _first_camera(state, window, params)) if way == _AS_CHANGED else None
    known = state.occlusion.occluded or coasting
    predicted = _predict(
        state, window, state.odds, way, (*state.velocity, *state.linear), known=known, changed=changed
    )
    surprising = predicted.cost > tuning.SEARCH_FACTOR * state.match_cost + tuning.SEARCH_ADDED
    if not known and (state.count == 0 or surprising):
        predicted = _predict_by_search(state, window, predicted)
    flow = _dense_flow(window, predicted.start, state, params)
    if coasting or (hidden and predicted.visible < tuning.HARDLY_VISIBLE * state.box[2] * state.box[3]):
        # hardly anything is seen: it moves as it did before
        registered, _ = _measure(state, window, flow, predicted, state.odds, points=None)
        theta = _theta(state.velocity)
    else:
        registered, theta = _measure(state, window, flow, predicted, state.odds, points=predicted.points)
    return _moves(state, window, predicted, flow, registered, theta, state.match_cost if known else predicted.cost)


def _changed(state: SegmentationState, window: Window, camera: tuple[float, float]) -> NDArray[np.uint8]:
    """How surely each pixel has changed since the first frame or the last, 0–255, the camera's motion apart.

    What has is the object or has been covered by it; what has not, in a box just drawn, is rather ground.
    """
    offset = state.atlas.offset[0] + camera[0], state.atlas.offset[1] + camera[1]
    ground, previous = translated(state.atlas.image, *offset), translated(state.previous, *camera)
    # lights that change for all of the window are no motion
    beside = outside(state)
    first = window.image - ground * _gains(window.image, ground, beside)
    last = window.image - previous * _gains(window.image, previous, beside)
    square = np.maximum((first * first).mean(axis=2), (last * last).mean(axis=2))
    square = cv2.blur(square, (3, 3))
    noise, floor = state.noise**2, tuning.CHANGE_FLOOR
    return np.asarray(
        255 * np.clip(floor + (square - tuning.CHANGE * noise) / (tuning.SURE_CHANGE * noise), floor, 1.0), np.uint8
    )


def _gains(image: Image, reference: Image, where: NDArray[np.bool_]) -> NDArray[np.float32]:
    """How much brighter each channel has become, by its mean over some pixels."""
    if not where.any():
        return np.ones(3, np.float32)
    now, before = image[where].mean(axis=0), reference[where].mean(axis=0)
    return np.asarray((now + 1.0) / (before + 1.0), np.float32)


def _first_camera(state: SegmentationState, window: Window, params: SegmentationParams) -> tuple[float, float]:
    """Motion of the camera by the flow round the object alone, before anything is known of the object's."""
    start = np.empty((*window.gray.shape, 2), np.float32)
    start[:] = state.camera
    flow = _dense_flow(window, start, state, params)
    beside = outside(state)
    if not beside.any():
        return state.camera
    u, v = (float(np.median(flow[:, :, i][beside])) for i in (0, 1))
    return (0.0, 0.0) if math.hypot(u, v) < tuning.REST else (u, v)


def follow(
    state: SegmentationState, window: Window, odds: Plane, velocity: tuple[float, float], params: SegmentationParams
) -> Moves:
    """Motion of the camera into this frame; that of the object, which is where `odds` are positive, is given."""
    predicted = _predict(state, window, odds, _EVENLY, (*velocity, *_NO_LINEAR), known=True)
    flow = _dense_flow(window, predicted.start, state, params)
    registered, _ = _measure(state, window, flow, predicted, odds, points=None)
    return _moves(state, window, predicted, flow, registered, _theta(velocity), state.match_cost)


def displace(moves: Moves, shift: tuple[int, int]) -> Moves:
    """Add a translation to the object's motion."""
    theta = moves.theta.copy()
    theta[0] += shift[0]
    theta[3] += shift[1]
    return moves._replace(theta=theta)


class _Prediction(NamedTuple):
    """What is known before the flow is; see `kernels.predict_motion`."""

    near: NDArray[np.uint8]
    weight: Plane
    points: kernels.Points
    grid: Grid
    extent: tuple[int, int, int, int]
    visible: float
    theta: NDArray[np.float64]
    cost: float
    start: NDArray[np.float32]

    @property
    def native(self) -> kernels.Prediction:
        """As the kernels have it."""
        return kernels.Prediction(self.near, self.weight, self.theta, self.start)


def _predict(
    state: SegmentationState,
    window: Window,
    odds: Plane,
    way: int,
    motion: tuple[float, float, float, float, float, float],
    *,
    known: bool,
    changed: NDArray[np.uint8] | None = None,
) -> _Prediction:
    """Outline of the object {odds > 0}, and the motion expected for this frame.

    The last motion, its translation alone or the camera's motion, whichever explains the frame best; the last one
    untried if it is `known`. Where there is no outline, the last box stands for it.
    """
    h, w = odds.shape
    x, y, width, height = state.box
    box = (
        x - state.origin[0] + width / 2,
        y - state.origin[1] + height / 2,
        max(tuning.SMALLEST_RADIUS, max(width, height) / 2),
        max(width * height, 1.0),
    )
    near, weight = np.empty((h, w), np.uint8), np.empty_like(odds)
    shown = state.visible if changed is None else changed
    points = kernels.Points(np.empty((kernels.POINT_ROWS, max(tuning.POINTS, h * w // 16 + 64)), np.float32))
    theta, start = np.empty(8), np.empty((h, w, 2), np.float32)
    cost, visible, grid, extent = kernels.predict_motion(
        window.native,
        state.obj,
        kernels.Outline(odds, shown, way, box),
        kernels.LastMotion(motion=motion, camera=state.camera, known=known),
        points,
        kernels.Prediction(near, weight, theta, start),
    )
    return _Prediction(near, weight, points, Grid(*grid), extent, visible, theta, cost, start)


def _measure(
    state: SegmentationState,
    window: Window,
    flow: NDArray[np.float32],
    predicted: _Prediction,
    odds: Plane,
    *,
    points: kernels.Points | None,
) -> tuple[ground.Registered, NDArray[np.float64]]:
    """How the background moved and how the object did; only the first without any points."""
    how = kernels.Measuring(
        grid=predicted.grid,
        camera=state.camera,
        offset=state.atlas.offset,
        noise=state.noise,
        hidden=state.occlusion.occluded,
        young=state.count < tuning.MOVING_YOUNG,
        ground_steps=tuning.CAMERA_STEPS,
        steps=tuning.OBJECT_STEPS,
    )
    register, theta = kernels.measure_motion(
        window.native, window.previous, flow, odds, state.atlas.native, predicted.native, points, how
    )
    return ground.Registered.of(register), np.array(theta)


def _moves(
    state: SegmentationState,
    window: Window,
    predicted: _Prediction,
    flow: NDArray[np.float32],
    registered: ground.Registered,
    theta: NDArray[np.float64],
    residual: float,
) -> Moves:
    atlas, camera = ground.place(state.atlas, registered, window.image, state.odds)
    contrast = _contrast(theta, camera, state.contrast)
    strange = tuning.STRANGE_NOISE * state.noise + tuning.STRANGE
    left = kernels.residual(window.native, predicted.points, theta, strange)
    misfit = min(left / strange, 1.0)
    return Moves(predicted.grid, theta, residual, flow, camera, atlas, contrast, predicted.extent, misfit)


def _contrast(theta: NDArray[np.float64], camera: tuple[float, float], last: float) -> float:
    vx, a, b, vy, c, d = theta[:6].tolist()
    linear = abs(a) + abs(b) + abs(c) + abs(d)
    relative: float = math.hypot(vx - camera[0], vy - camera[1]) + tuning.LINEAR_CONTRAST * linear
    return max(min(relative / tuning.FULL_CONTRAST, 1.0), tuning.CONTRAST_MEMORY * last)


def _theta(velocity: tuple[float, float]) -> NDArray[np.float64]:
    """Write a translation as the kernels have motions."""
    return np.array((velocity[0], 0.0, 0.0, velocity[1], 0.0, 0.0, 0.0, 0.0))


def _predict_by_search(state: SegmentationState, window: Window, predicted: _Prediction) -> _Prediction:
    """Prediction by a search over translations, where that explains the frame clearly better."""
    grid = predicted.grid
    shift = _search_translation(state, window.image, predicted.weight, grid)
    theta = _theta(shift)
    cost = kernels.residual(window.native, predicted.points, theta, kernels.FAR_OFF)
    dx, dy = shift[0] - state.velocity[0], shift[1] - state.velocity[1]
    distance = dx * dx + dy * dy
    penalised = _penalised(cost, distance, grid)
    first = tuning.FIRST_GAIN * predicted.cost - tuning.FIRST_LESS
    later = tuning.LATER_GAIN * predicted.cost - tuning.LATER_LESS
    if penalised >= (first if state.count == 0 else later):
        return predicted
    start = np.empty_like(predicted.start)
    kernels.start_flow(predicted.near, predicted.grid, theta, state.camera, start)
    return predicted._replace(theta=theta, cost=cost, start=start)


_Cost = TypeVar("_Cost", float, Plane)


def _penalised(cost: _Cost, distance: _Cost, grid: Grid) -> _Cost:
    """Cost of a translation, higher the farther (squared distance, px²) it is from the one expected."""
    room = tuning.FAR_FACTOR * (0.5 * grid.scale + tuning.FAR_ROOM) ** 2
    penalised: _Cost = cost * (1.0 + distance / room) + tuning.FAR_PENALTY * distance
    return penalised


def _search_translation(state: SegmentationState, image: Image, weight: Plane, grid: Grid) -> tuple[float, float]:
    """Translation of the object layer with the least masked squared difference, near ones preferred."""
    reduce = 2 if 2 * grid.scale >= tuning.HALVED else 1
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
    cost = differences(image, template, mask8[y : y + h, x : x + w])
    sx = reduce * (np.arange(cost.shape[1]) - x) - state.velocity[0]
    sy = reduce * (np.arange(cost.shape[0]) - y) - state.velocity[1]
    distance = np.asarray(sx[np.newaxis, :] ** 2 + sy[:, np.newaxis] ** 2, np.float32)
    cost = _penalised(cost, distance, grid)
    row, column = divmod(int(np.argmin(cost)), cost.shape[1])
    return float(reduce * (column - x)), float(reduce * (row - y))


def _solver(levels: int, params: SegmentationParams) -> Any:
    """One flow solver per thread and setting: it owns a workspace, which threads must not share."""
    cache = _LOCAL.__dict__.setdefault("solvers", {})
    key = (levels, params.smoothness, params.warps)
    if key not in cache:
        from ..flow import HornSchunck

        cache[key] = HornSchunck(
            "fast",
            smoothness=params.smoothness,
            levels=levels,
            warps=params.warps,
            ratio=0.5,
            iterations=tuning.FLOW_SWEEPS,
            gain=1.0,
            exposure=False,
        )
    return cache[key]


def _dense_flow(
    window: Window, start: NDArray[np.float32], state: SegmentationState, params: SegmentationParams
) -> NDArray[np.float32]:
    """Horn–Schunck flow, started from the predicted motion near the object and from the camera's elsewhere.

    The start field and few levels are what lets a small object with a large motion survive: it would vanish on
    coarse levels.
    """
    side = max(min(state.box[2], state.box[3]), tuning.FLOW_LEAST_SIDE)
    levels = min(max(1 + math.floor(math.log2(side / tuning.FLOW_COARSEST)), 1), tuning.FLOW_LEVELS)
    flow: NDArray[np.float32] = _solver(levels, params).calc(window.previous, window.gray, start)
    return flow


def inverse_matrix(theta: NDArray[np.float64], grid: Grid) -> NDArray[np.float64]:
    """Where the pixels of this frame come from by an affine motion, as `resample` wants it."""
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
