"""How the object moves: prediction, Horn–Schunck flow, robust affine fit, registration with the object layer."""

from __future__ import annotations

import threading
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .kernels import fit_affine, gauss_newton
from .state import Image, LayersParams, LayersState, Plane

__all__ = ["Grid", "Motion", "dense_flow", "grid_of", "measure", "predict", "warp"]

_LOCAL = threading.local()
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

    def stride(self, share: float = 1.0) -> int:
        """Take every n-th pixel of a row, so that about the wanted number is used."""
        return max(1, round(self.area * share / _FIT_PIXELS))


class Motion(NamedTuple):
    """Affine motion of the object: theta (8,) as in `gauss_newton`, its residual, and the prediction's."""

    theta: NDArray[np.float64]
    residual: float
    predicted: float


def grid_of(mask: NDArray[np.uint8], fallback: tuple[float, float, float, float]) -> Grid:
    """Centre and scale of a mask; of a box (window px) when the mask is empty."""
    moments = cv2.moments(mask, binaryImage=True)
    area = moments["m00"]
    if area < 4:
        x, y, w, h = fallback
        return Grid(x + w / 2, y + h / 2, max(6.0, max(w, h) / 2), max(w * h, 1.0))
    _, _, w, h = cv2.boundingRect(mask)
    return Grid(moments["m10"] / area, moments["m01"] / area, max(6.0, max(w, h) / 2), area)


def _theta(velocity: tuple[float, float], linear: tuple[float, float, float, float], scale: float) -> NDArray[np.float64]:
    vx, vy = velocity
    a, b, c, d = (value * scale for value in linear)
    return np.array((vx, a, b, vy, c, d, 0.0, 0.0))


def predict(
    state: LayersState, image: Image, weight: Plane, grid: Grid, inside: NDArray[np.int64]
) -> tuple[NDArray[np.float64], float]:
    """Affine motion expected for this frame, and its mean residual.

    The last motion, its translation alone or the camera's motion, whichever explains the frame best; a search over
    translations when none does (always in the second frame, whose motion nobody knows).
    """
    no_linear = (0.0, 0.0, 0.0, 0.0)
    best = _theta(state.velocity, state.linear, grid.scale)
    if state.occlusion.occluded or state.occlusion.coasting:
        return _theta(state.velocity, no_linear, grid.scale), state.match_cost
    cost = _cost(state.obj, image, weight, grid, best, inside)
    for velocity in (state.velocity, state.camera):
        other = _theta(velocity, no_linear, grid.scale)
        other_cost = _cost(state.obj, image, weight, grid, other, inside)
        if other_cost < cost - 0.3:
            best, cost = other, other_cost
    first = state.count == 0
    if first or cost > 1.5 * state.match_cost + 1.0:
        shift = _search(state, image, weight, grid)
        other = _theta(shift, no_linear, grid.scale)
        other_cost = _cost(state.obj, image, weight, grid, other, inside)
        dx, dy = shift[0] - state.velocity[0], shift[1] - state.velocity[1]
        distance = dx * dx + dy * dy
        penalised = other_cost * (1 + distance / (2 * (0.5 * grid.scale + 8) ** 2)) + 0.02 * distance
        if penalised < (0.92 * cost - 0.15 if first else 0.85 * cost - 0.5):
            best, cost = other, other_cost
    return best, cost


def _cost(
    obj: Image, image: Image, weight: Plane, grid: Grid, theta: NDArray[np.float64], inside: NDArray[np.int64]
) -> float:
    nothing = np.zeros(8)
    return float(
        gauss_newton(image, obj, weight, grid.triple, theta.copy(), nothing, 1.0, 0, grid.stride(), inside)
    )


def _search(state: LayersState, image: Image, weight: Plane, grid: Grid) -> tuple[float, float]:
    """Translation of the object layer with the least masked squared difference, near ones preferred."""
    reduce = 2 if 2 * grid.scale >= 24 else 1
    channels = image.shape[2]
    obj, mask = state.obj, weight
    if reduce == 2:
        size = (image.shape[1] // 2, image.shape[0] // 2)
        image, obj = (cv2.resize(a, size, interpolation=cv2.INTER_AREA) for a in (image, obj))
        mask = cv2.resize(weight, size, interpolation=cv2.INTER_AREA)
    mask8 = (mask > 0.5).astype(np.uint8)
    x, y, w, h = cv2.boundingRect(mask8)
    if w < 2 or h < 2:
        return state.velocity
    template = np.ascontiguousarray(obj[y : y + h, x : x + w])
    masks = np.repeat(mask8[y : y + h, x : x + w, np.newaxis].astype(np.float32), channels, axis=2).reshape(template.shape)
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
            "fast", smoothness=params.smoothness, levels=levels, warps=params.warps, ratio=0.5, iterations=5
        )
    return cache[key]


def dense_flow(
    previous: Plane,
    current: Plane,
    near: NDArray[np.uint8],
    grid: Grid,
    theta: NDArray[np.float64],
    camera: tuple[float, float],
    box_side: float,
    params: LayersParams,
) -> NDArray[np.float32]:
    """Horn–Schunck flow, started from the predicted motion near the object and from the camera's elsewhere.

    The start field and few levels are what lets a small object with a large motion survive: it would vanish on
    coarse levels.
    """
    levels = int(np.clip(1 + np.floor(np.log2(max(box_side, 8.0) / 10.0)), 1, 3))
    h, w = previous.shape
    start = np.empty((h, w, 2), np.float32)
    start[:] = camera
    x = (np.arange(w, dtype=np.float32) - np.float32(grid.cx)) / np.float32(grid.scale)
    y = ((np.arange(h, dtype=np.float32) - np.float32(grid.cy)) / np.float32(grid.scale))[:, np.newaxis]
    field = np.empty_like(start)
    field[:, :, 0] = theta[0] + theta[1] * x + theta[2] * y
    field[:, :, 1] = theta[3] + theta[4] * x + theta[5] * y
    cv2.copyTo(field, near, start)
    flow: NDArray[np.float32] = _solver(levels, params).calc(previous, current, start)
    return flow


def measure(
    state: LayersState,
    image: Image,
    gray: Plane,
    flow: NDArray[np.float32],
    weight: Plane,
    grid: Grid,
    predicted: tuple[NDArray[np.float64], float],
    camera: tuple[float, float],
    inside: NDArray[np.int64],
) -> Motion:
    """Affine motion of the object: the flow's robust fit, sharpened against the object layer.

    The fit follows the frame pair, the layer keeps it from drifting. Registration starts from the fit and from the
    prediction, and is believed only near its start.
    """
    hidden = state.occlusion.occluded
    theta, cost = predicted
    stride = grid.stride()
    fitted = theta.copy()
    points = np.empty((2 * _FIT_PIXELS, 7), np.float32)
    ridge = np.array((0.02, 0.1, 0.1)) * 0.3
    if hidden:
        ridge *= (3.0, 30.0, 30.0)
    odds = np.where(weight > 0, state.odds, np.float32(-1.0))
    fit_affine(
        flow, gray, odds, grid.triple, ridge, state.noise, np.array(camera), state.count < 3, stride, points, fitted
    )
    linear = (1, 2, 4, 5)
    limit = 0.0 if hidden else 0.35 * grid.scale
    for i in linear:
        fitted[i] = min(max(fitted[i], -limit), limit)
    strength = max(state.noise, 2.0) ** 2 * (5.0 if hidden else 1.0)
    prior = strength * np.array((0.02, 0.05, 0.05, 0.02, 0.05, 0.05, 0.0, 0.02))
    prior[6] = 0.02
    scale = 3.0 * state.noise + 3.0
    best, best_cost = fitted, _cost(state.obj, image, weight, grid, fitted, inside)
    starts = (fitted, theta)
    for number, start in enumerate(starts):
        if number == 1 and float(np.abs(start[[0, 3]] - fitted[[0, 3]]).max()) < 0.05:
            continue
        refined = start.copy()
        residual = float(
            gauss_newton(image, state.obj, weight, grid.triple, refined, prior, scale, 3, stride, inside)
        )
        moved = float(np.hypot(refined[0] - start[0], refined[3] - start[3]))
        stretched = float(np.abs(refined[list(linear)]).max())
        if moved > 3.0 or stretched > 0.4 * grid.scale:
            continue
        if residual < (best_cost if number == 0 else 0.97 * best_cost):
            best, best_cost = refined, residual
    return Motion(best, best_cost, cost)


def warp(image: NDArray[np.float32], theta: NDArray[np.float64], grid: Grid, fill: float) -> NDArray[np.float32]:
    """Image moved by an affine motion; `fill` where nothing comes from the window, its border where fill is NaN."""
    a, b, c, d = theta[1] / grid.scale, theta[2] / grid.scale, theta[4] / grid.scale, theta[5] / grid.scale
    matrix = np.array(
        (
            (1 + a, b, theta[0] - a * grid.cx - b * grid.cy),
            (c, 1 + d, theta[3] - c * grid.cx - d * grid.cy),
        )
    )
    size = (image.shape[1], image.shape[0])
    if np.isnan(fill):
        out = cv2.warpAffine(image, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    else:
        border = (fill,) * 4
        out = cv2.warpAffine(image, matrix, size, flags=cv2.INTER_LINEAR, borderValue=border)
    return np.asarray(out, dtype=np.float32).reshape(image.shape)
