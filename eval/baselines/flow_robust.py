"""Robust flow: Black–Anandan's dense field, and Black–Jepson's parametric regions with local deformations.

Sources: M. J. Black and P. Anandan, "The robust estimation of multiple motions: parametric and piecewise-smooth flow
fields", CVIU 63 (1996) 75–104; M. J. Black and A. D. Jepson, "Estimating optical flow in segmented images using
variable-order parametric models with local deformations", PAMI 18 (1996) 972–986; segments by Felzenszwalb and
Huttenlocher, IJCV 59 (2004), in scikit-image.

Intensities are 0–255, lengths px. The error norm is the Lorentzian ρ(x) = log(1 + x² / 2σ²) everywhere, minimised by
iteratively reweighted least squares: weight ψ(x) / x = 2 / (2σ² + x²).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .flow_common import (
    FloatImage,
    Flow,
    Frame,
    float_gray,
    image_pyramid,
    pixel_grid,
    resize_flow,
    smooth_flow,
    warp,
)

__all__ = ["black_anandan", "black_jepson"]

_Basis = tuple[NDArray[np.float32], NDArray[np.float32]]


@dataclass(frozen=True)
class _Robust:
    """Parameters of the dense estimate.

    Parameters
    ----------
    data_scale : float
        σ of the brightness constancy, gray levels.
    smooth_scale : float
        σ of the difference of neighbouring vectors, px.
    smoothness : float
        Weight of the smoothness term against the data term.
    deformation_scale : float
        σ of the deviation from a prior flow, px; only used where there is one.
    warps, sweeps : int
        Linearisations per level; relaxation sweeps per linearisation.
    """

    data_scale: float = 6.0
    smooth_scale: float = 0.5
    smoothness: float = 0.1
    deformation_scale: float = 1.0
    warps: int = 4
    sweeps: int = 20


def _lorentz(residual: FloatImage, scale: float) -> FloatImage:
    return np.asarray(2.0 / (2.0 * scale**2 + residual**2), dtype=np.float32)


def black_anandan(first: Frame, second: Frame) -> Flow:
    """Dense robust flow, coarse to fine."""
    pyramids = (image_pyramid(float_gray(frame), 16) for frame in (first, second))
    levels = list(zip(*pyramids, strict=True))[::-1]
    flow = np.zeros((*levels[0][0].shape, 2), np.float32)
    for one, other in levels:
        flow = resize_flow(flow, one.shape)
        flow = _relaxed(one, other, flow, np.zeros(one.shape, np.int32), None, _Robust())
    return flow


def _relaxed(
    one: FloatImage, other: FloatImage, flow: Flow, regions: NDArray[np.int32], prior: Flow | None, robust: _Robust
) -> Flow:
    """Refine a flow on one level; smoothness stops at the borders of ``regions``, and acts on flow − prior."""
    for warping in range(robust.warps):
        # Graduated non-convexity: a wide, almost quadratic norm first, the robust one last.
        widen = 2.0 ** max(2 - warping, 0)
        gradient = _linearised(one, other, flow)
        flow = smooth_flow(_sweep(gradient, flow, regions, prior, robust, widen))
    return flow


def _linearised(one: FloatImage, other: FloatImage, flow: Flow) -> tuple[FloatImage, FloatImage, FloatImage]:
    """Ix, Iy, and c of Ix u + Iy v + c = 0 for the full flow (u, v); all 0 where the flow leaves the frame."""
    moved = warp(other, flow, cv2.INTER_CUBIC)
    mean = 0.5 * (one + moved)
    taps = np.array([1, -8, 0, 8, -1], np.float32) / 12
    ix = cv2.filter2D(mean, cv2.CV_32F, taps[np.newaxis, :], borderType=cv2.BORDER_REPLICATE)
    iy = cv2.filter2D(mean, cv2.CV_32F, taps[:, np.newaxis], borderType=cv2.BORDER_REPLICATE)
    x, y = (axis + flow[:, :, i] for i, axis in enumerate(pixel_grid(one.shape)))
    inside = (x >= 0) & (x <= one.shape[1] - 1) & (y >= 0) & (y <= one.shape[0] - 1)
    rest = moved - one - ix * flow[:, :, 0] - iy * flow[:, :, 1]
    ix, iy, rest = (np.where(inside, part, np.float32(0)).astype(np.float32) for part in (ix, iy, rest))
    return ix, iy, rest


def _sweep(
    gradient: tuple[FloatImage, FloatImage, FloatImage],
    flow: Flow,
    regions: NDArray[np.int32],
    prior: Flow | None,
    robust: _Robust,
    widen: float,
) -> Flow:
    """Jacobi sweeps of the reweighted linear equations; the weights are renewed halfway."""
    ix, iy, rest = gradient
    base = np.zeros_like(flow) if prior is None else prior
    joined_right = (regions[:, :-1] == regions[:, 1:]).astype(np.float32)
    joined_down = (regions[:-1] == regions[1:]).astype(np.float32)
    u, v = (np.ascontiguousarray(flow[:, :, i] - base[:, :, i]) for i in (0, 1))
    rest = rest + ix * base[:, :, 0] + iy * base[:, :, 1]
    for _ in range(2):
        data = _lorentz(ix * u + iy * v + rest, robust.data_scale * widen)
        right, down = (
            robust.smoothness * joined * _link(u, v, axis, robust.smooth_scale * widen)
            for axis, joined in ((1, joined_right), (0, joined_down))
        )
        pull = 0.0 if prior is None else 0.01 * _lorentz(np.hypot(u, v), robust.deformation_scale)
        u, v = _jacobi((ix, iy, rest), (u, v), data, right, down, pull, robust.sweeps // 2)
    return np.stack([u, v], axis=2) + base


def _link(u: FloatImage, v: FloatImage, axis: int, scale: float) -> FloatImage:
    """Weight of the smoothness between neighbours along an axis."""
    return _lorentz(np.hypot(np.diff(u, axis=axis), np.diff(v, axis=axis)), scale)


def _jacobi(
    gradient: tuple[FloatImage, FloatImage, FloatImage],
    flow: tuple[FloatImage, FloatImage],
    data: FloatImage,
    right: FloatImage,
    down: FloatImage,
    pull: FloatImage | float,
    sweeps: int,
) -> tuple[FloatImage, FloatImage]:
    """Solve the two equations of every pixel for its vector, its neighbours fixed; again and again."""
    ix, iy, rest = gradient
    u, v = flow
    total = np.zeros_like(u)
    total[:, :-1] += right
    total[:, 1:] += right
    total[:-1] += down
    total[1:] += down
    total += pull + 1e-6
    # Elimination of the 2 × 2 system: the vector is the neighbours' mean minus a step along the gradient.
    gain = data / (total + data * (ix * ix + iy * iy))
    for _ in range(sweeps):
        mean_u, mean_v = (_neighbours(part, right, down) / total for part in (u, v))
        step = gain * (ix * mean_u + iy * mean_v + rest)
        u, v = mean_u - ix * step, mean_v - iy * step
    return u, v


def _neighbours(part: FloatImage, right: FloatImage, down: FloatImage) -> FloatImage:
    summed = np.zeros_like(part)
    summed[:, :-1] += right * part[:, 1:]
    summed[:, 1:] += right * part[:, :-1]
    summed[:-1] += down * part[1:]
    summed[1:] += down * part[:-1]
    return summed


def black_jepson(first: Frame, second: Frame) -> Flow:
    """Parametric flow of the brightness regions of the first frame, plus a small smooth deformation in each.

    A coarse dense flow is robustly fitted in every region by a translation, an affine or a planar model, the order
    growing with the size of the region; the fits are refined on the frames themselves; then every region may deform.
    """
    from skimage.segmentation import felzenszwalb

    one, other = float_gray(first), float_gray(second)
    regions = np.asarray(felzenszwalb(one / 255.0, scale=100, sigma=0.8, min_size=150), dtype=np.int32)
    half = (one.shape[1] // 2, one.shape[0] // 2)
    small = (cv2.resize(frame, half, interpolation=cv2.INTER_AREA).astype(np.uint8) for frame in (one, other))
    coarse = resize_flow(black_anandan(*small), one.shape)
    parametric = _fitted(coarse, regions)
    for _ in range(3):
        parametric = _refined(one, other, parametric, regions)
    return _relaxed(one, other, parametric, regions, parametric, _Robust(warps=3))


def _basis(regions: NDArray[np.int32]) -> _Basis:
    """The eight planar motions at every pixel, (8, H, W) for u and v, in coordinates of the region's own scale."""
    count = int(regions.max()) + 1
    size = np.bincount(regions.ravel(), minlength=count)

    def local(axis: FloatImage) -> FloatImage:
        centre = np.bincount(regions.ravel(), axis.ravel(), count) / size
        return np.asarray((axis - centre[regions]) / np.sqrt(size)[regions], dtype=np.float32)

    x, y = (local(axis) for axis in pixel_grid(regions.shape))
    one, none = np.ones_like(x), np.zeros_like(x)
    along_u = np.stack([one, none, x, y, none, none, x * x, x * y])
    along_v = np.stack([none, one, none, none, x, y, x * y, y * y])
    # Variable order: what a small region cannot determine is left out of its model.
    for first_term, smallest in ((2, 200), (6, 2000)):
        too_small = (size < smallest)[regions]
        along_u[first_term:, too_small] = 0.0
        along_v[first_term:, too_small] = 0.0
    return along_u, along_v


def _region_fit(
    rows: Sequence[tuple[NDArray[np.float32], FloatImage, FloatImage]], regions: NDArray[np.int32]
) -> NDArray[np.float64]:
    """Weighted least squares in every region at once.

    ``rows`` are equations of every pixel: coefficients (8, H, W), right side (H, W), weight (H, W). Returns the eight
    parameters of every region, (regions, 8).
    """
    count, labels = int(regions.max()) + 1, regions.ravel()
    matrix, vector = np.zeros((count, 8, 8)), np.zeros((count, 8))
    for coefficients, right_side, weight in rows:
        for i in range(8):
            weighted = weight * coefficients[i]
            vector[:, i] += np.bincount(labels, (weighted * right_side).ravel(), count)
            for j in range(i + 1):
                matrix[:, i, j] += np.bincount(labels, (weighted * coefficients[j]).ravel(), count)
    matrix += np.tril(matrix, -1).transpose(0, 2, 1)
    # A little on the diagonal keeps terms that were left out at 0, and a region without texture where it was.
    matrix += np.eye(8) * (1e-3 * np.trace(matrix, axis1=1, axis2=2) / 8 + 1e-9)[:, np.newaxis, np.newaxis]
    return np.asarray(np.linalg.solve(matrix, vector[:, :, np.newaxis])[:, :, 0])


def _evaluated(parameters: NDArray[np.float64], basis: _Basis, regions: NDArray[np.int32]) -> Flow:
    flow = np.zeros((*regions.shape, 2), np.float32)
    for term, values in enumerate(parameters.T.astype(np.float32)):
        here = values[regions]
        flow[:, :, 0] += here * basis[0][term]
        flow[:, :, 1] += here * basis[1][term]
    return flow


def _fitted(coarse: Flow, regions: NDArray[np.int32]) -> Flow:
    """Robust fit of the parametric models to a dense flow."""
    basis = _basis(regions)
    weight = np.ones(regions.shape, np.float32)
    fitted = coarse
    for scale in (2.0, 1.0, 0.5):
        rows = [(basis[i], np.ascontiguousarray(coarse[:, :, i]), weight) for i in (0, 1)]
        fitted = _evaluated(_region_fit(rows, regions), basis, regions)
        weight = _lorentz(np.hypot(*np.moveaxis(coarse - fitted, 2, 0)), scale)
    return fitted


def _refined(one: FloatImage, other: FloatImage, flow: Flow, regions: NDArray[np.int32]) -> Flow:
    """One robust Gauss–Newton step of the parametric models on the frames themselves."""
    basis = _basis(regions)
    ix, iy, rest = _linearised(one, other, flow)
    difference = rest + ix * flow[:, :, 0] + iy * flow[:, :, 1]
    row = ix * basis[0] + iy * basis[1], -difference, _lorentz(difference, 6.0)
    step = _evaluated(_region_fit([row], regions), basis, regions)
    # A linearisation holds for about a pixel; a region that wants more has left its texture.
    trusted = (np.hypot(step[:, :, 0], step[:, :, 1]) < 1.0)[:, :, np.newaxis]
    return np.where(trusted, flow + step, flow).astype(np.float32)
