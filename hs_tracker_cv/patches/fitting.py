"""The motion in a flow field: what its pixels weigh, and a robust fit."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..compiling import kernel, larger, local, root, smaller
from .common import Image, Numbers, Plane

_BINS = 512
_BINS_PER_PX = 64.0
_histogram = local(_BINS)


def residual_weights(
    a: NDArray[np.float32],
    b: NDArray[np.float32],
    flow: NDArray[np.float32],
    prior: NDArray[np.float32],
    weight: NDArray[np.float32],
) -> None:
    """Weight of each pixel in the fit: textured, and explained by the flow.

    ``weight = prior * G / (G + 30) / (1 + (res / 8)²)²`` with G the squared gradient of `a` and res the 3 × 3
    mean of ``|b(x + flow) - a|``.

    Parameters
    ----------
    a, b : ndarray, shape (H, W), float32
        Normalised patches.
    flow : ndarray, shape (H, W, 2), float32
        Flow from `a` to `b`, samples.
    prior : ndarray, shape (H, W), float32
    weight : ndarray, shape (H, W), float32
        Receives the weights.
    """
    _residual_weights(a, b, flow, prior, np.empty_like(a), weight)


@kernel()
def _residual_weights(a: Plane, b: Plane, flow: Image, prior: Plane, error: Plane, weight: Plane) -> None:
    """Weigh pixels: as `residual_weights`, with room to work in."""
    height, width = a.shape
    for y in range(height):
        for x in range(width):
            px = smaller(larger(x + flow[y, x, 0], 0.0), width - 1.0)
            py = smaller(larger(y + flow[y, x, 1], 0.0), height - 1.0)
            ix, iy = smaller(np.int64(px), width - 2), smaller(np.int64(py), height - 2)
            fx, fy = px - ix, py - iy
            top = b[iy, ix] + fx * (b[iy, ix + 1] - b[iy, ix])
            bottom = b[iy + 1, ix] + fx * (b[iy + 1, ix + 1] - b[iy + 1, ix])
            error[y, x] = abs(top + fy * (bottom - top) - a[y, x])
    for y in range(height):
        up, down = larger(y - 1, 0), smaller(y + 1, height - 1)
        for x in range(width):
            left, right = larger(x - 1, 0), smaller(x + 1, width - 1)
            res = (
                error[up, left] + error[up, x] + error[up, right]
                + error[y, left] + error[y, x] + error[y, right]
                + error[down, left] + error[down, x] + error[down, right]
            ) / 9.0  # fmt: skip
            gx = 0.5 * (a[y, right] - a[y, left])
            gy = 0.5 * (a[down, x] - a[up, x])
            strength = gx * gx + gy * gy
            fair = 1.0 + (res / 8.0) * (res / 8.0)
            weight[y, x] = prior[y, x] * strength / (strength + 30.0) / (fair * fair)


@kernel()
def fit_motion(flow: Image, weight: Plane, turning: float, motion: Numbers) -> None:
    """Fit ``u = tx + sx X - r Y, v = ty + sy Y + r X`` to a flow field by iteratively re-weighted least squares.

    X, Y are measured from the patch centre, in samples. Eight rounds; every second pixel; Geman–McClure weights
    with the scale set by the median residual.

    Parameters
    ----------
    flow : ndarray, shape (H, W, 2), float32
        Samples.
    weight : ndarray, shape (H, W), float32
        Prior weights, not negative.
    turning : float
        1, or 0 to leave r at 0.
    motion : ndarray, shape (7,), float64
        Receives tx, ty, sx, sy, the isotropic scale s, the median residual (samples) and the rotation r (radians
        from x towards y).
    """
    height, width = weight.shape
    mx, my = 0.5 * (width - 1), 0.5 * (height - 1)
    histogram = _histogram()
    tx, ty, sx, sy, scale, median, turn_rate = 0.0, 0.0, 0.0, 0.0, 0.0, 8.0, 0.0
    for turn in range(8):
        n = xu = yv = xv = yu = u1 = v1 = xw = yw = xx = yy = 1e-9
        limit = 1.5 * larger(0.05, 1.48 * median)
        for i in range(_BINS):
            histogram[i] = 0.0
        for y in range(turn & 1, height, 2):
            for x in range(0, width, 2):
                w = weight[y, x]
                if w <= 0.0:
                    continue
                px, py = x - mx, y - my
                u, v = flow[y, x, 0], flow[y, x, 1]
                if turn > 0:
                    du, dv = u - tx - scale * px + turn_rate * py, v - ty - scale * py - turn_rate * px
                    square = du * du + dv * dv
                    fair = 1.0 + square / (limit * limit)
                    histogram[smaller(np.int64(root(square) * _BINS_PER_PX), _BINS - 1)] += w
                    w /= fair * fair
                n += w
                xw += w * px
                yw += w * py
                xx += w * px * px
                yy += w * py * py
                u1 += w * u
                v1 += w * v
                xu += w * px * u
                yv += w * py * v
                xv += w * px * v
                yu += w * py * u
        cxx, cyy = xx - xw * xw / n, yy - yw * yw / n
        cxu, cyv = xu - xw * u1 / n, yv - yw * v1 / n
        sx, sy = cxu / (cxx + 1e-6), cyv / (cyy + 1e-6)
        scale = (cxu + cyv) / (cxx + cyy + 1e-6)
        turn_rate = turning * (xv - xw * v1 / n - yu + yw * u1 / n) / (cxx + cyy + 1e-6)
        tx, ty = (u1 - scale * xw + turn_rate * yw) / n, (v1 - scale * yw - turn_rate * xw) / n
        if turn > 0:
            half = 0.0
            for i in range(_BINS):
                half += histogram[i]
            half *= 0.5
            running = 0.0
            i = 0
            while i < _BINS - 1 and running + histogram[i] < half:
                running += histogram[i]
                i += 1
            median = (i + 0.5) / _BINS_PER_PX
        else:
            median = 1.0
    motion[0], motion[1], motion[2], motion[3], motion[4], motion[5] = tx, ty, sx, sy, scale, median
    motion[6] = turn_rate


@kernel()
def misfit(flow: Image, motion: Numbers, square: Plane) -> None:
    """Squared distance of a flow field from a fitted motion.

    Parameters
    ----------
    flow : ndarray, shape (H, W, 2), float32
    motion : ndarray, shape (7,), float64
        From :func:`fit_motion`.
    square : ndarray, shape (H, W), float32
        Receives the squared distance, samples².
    """
    height, width = square.shape
    mx, my = 0.5 * (width - 1), 0.5 * (height - 1)
    for y in range(height):
        for x in range(width):
            du = flow[y, x, 0] - motion[0] - motion[4] * (x - mx) + motion[6] * (y - my)
            dv = flow[y, x, 1] - motion[1] - motion[4] * (y - my) - motion[6] * (x - mx)
            square[y, x] = du * du + dv * dv


@kernel()
def register(
    a: Plane, b: Plane, flow: Image, prior: Plane, turning: float, error: Plane, weight: Plane, motion: Numbers
) -> None:
    """Weigh the pixels of a flow field and fit its motion: :func:`residual_weights`, then :func:`fit_motion`."""
    _residual_weights(a, b, flow, prior, error, weight)
    fit_motion(flow, weight, turning, motion)
