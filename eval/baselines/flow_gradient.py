"""Flow by gradients in a neighbourhood: Lucas–Kanade on a grid, and Buxton–Buxton's moving edges.

Sources: B. Lucas and T. Kanade, "An iterative image registration technique with an application to stereo vision",
IJCAI (1981), by ``cv2.calcOpticalFlowPyrLK``; B. F. Buxton and H. Buxton, "Computation of optic flow from the motion
of edge features in image sequences", Image and Vision Computing 2 (1984) 59–75.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from .flow_common import FloatImage, Flow, Frame, float_gray, image_pyramid, resize_flow, smooth_flow, warp

__all__ = ["buxton_buxton", "lucas_kanade"]

STEP = 4
"""Distance of the Lucas–Kanade points, px."""


def lucas_kanade(first: Frame, second: Frame) -> Flow:
    """Pyramidal Lucas–Kanade on every fourth pixel, interpolated between them.

    Points that OpenCV gives up take the flow of the nearest one that it found.
    """
    from scipy.ndimage import distance_transform_edt

    one, other = (frame if frame.ndim == 2 else cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in (first, second))
    height, width = one.shape
    rows, columns = -(-height // STEP), -(-width // STEP)
    # Centres of 4 × 4 cells, so that a centre-aligned resize brings the grid to the frame's size.
    y, x = np.mgrid[:rows, :columns].astype(np.float32) * STEP + (STEP - 1) / 2
    points = np.stack([np.minimum(x, width - 1), np.minimum(y, height - 1)], axis=2).reshape(-1, 1, 2)
    start = points.copy()  # cv2 wants an array for the result, and may write to it
    moved, status, _ = cv2.calcOpticalFlowPyrLK(one, other, points, start, winSize=(15, 15), maxLevel=4)
    grid = np.asarray(moved - points, dtype=np.float32).reshape(rows, columns, 2)
    lost = status.reshape(rows, columns) == 0
    if lost.any() and not lost.all():
        nearest = distance_transform_edt(lost, return_distances=False, return_indices=True)
        grid = grid[nearest[0], nearest[1]]
    full = cv2.resize(smooth_flow(grid, 3), (columns * STEP, rows * STEP), interpolation=cv2.INTER_LINEAR)
    return np.ascontiguousarray(full[:height, :width], dtype=np.float32)


EDGE_SCALE = 1.5
"""σ of the spatial Gaussian, px."""

NEIGHBOURHOOD = 5.0
"""σ of the neighbourhood over which edge motion is pooled, px."""

WAVE_SPEED = 1.0
"""The c of the d'Alembertian, px per frame."""

REACH = 2
"""Frames on either side of the pair that the temporal part of the filter uses, where there are so many."""


def buxton_buxton(frames: Sequence[NDArray[np.uint8]], index: int) -> NDArray[np.float32]:
    """Flow from the motion of edges: zero crossings of the d'Alembertian of a space–time Gaussian of the sequence.

    S = (∇² − c⁻² ∂²/∂t²) G ∗ I vanishes on moving edges, and S_x u + S_y v + S_t = 0 there; the full flow is the
    least squares solution over the edges of a neighbourhood. The temporal part needs frames on both sides of the
    pair. With two frames it cannot be formed and S is the Laplacian of Gaussian of each: Marr and Hildreth's edges.
    Coarse to fine with warping is our addition; without it no edge that moves more than a pixel or two is followed.

    Parameters
    ----------
    frames : sequence of ndarray, each (H, W) or (H, W, 3), uint8
        At best two frames before and two after the pair.
    index : int
        The pair is ``frames[index]`` and ``frames[index + 1]``.

    Returns
    -------
    ndarray, shape (H, W, 2), float32
        px per frame.
    """
    reach = min(REACH, index, len(frames) - 2 - index)
    used = [float_gray(frame) for frame in frames[index - reach : index + 2 + reach]]
    levels = list(zip(*(image_pyramid(image, 24) for image in used), strict=True))[::-1]
    flow = np.zeros((*levels[0][0].shape, 2), np.float32)
    for images in levels:
        flow = resize_flow(flow, images[0].shape)
        for _ in range(3):
            flow = smooth_flow(flow + _edge_motion(_aligned(images, flow, reach), reach))
    return flow


def _aligned(images: Sequence[FloatImage], flow: NDArray[np.float32], reach: int) -> list[FloatImage]:
    """Frames moved onto the first of the pair, as if the flow were the same from frame to frame."""
    return [warp(image, (number - reach) * flow, cv2.INTER_CUBIC) for number, image in enumerate(images)]


def _edge_motion(images: Sequence[FloatImage], reach: int) -> NDArray[np.float32]:
    before, after = (_dalembertian(images[start : start + 2 * reach + 1]) for start in (0, 1))
    signal = 0.5 * (before + after)
    gx, gy = (cv2.Scharr(signal, cv2.CV_32F, *axis, scale=1 / 32) for axis in ((1, 0), (0, 1)))
    change, edge = after - before, _zero_crossings(signal)
    a, b, c, p, q = (_pooled(edge * term) for term in (gx * gx, gx * gy, gy * gy, gx * change, gy * change))
    # A little of the mean gradient energy on the diagonal: no motion where a neighbourhood holds no edge.
    floor = np.float32(0.02 * (a + c).mean() + 1e-6)
    a, c = a + floor, c + floor
    determinant = a * c - b * b
    motion = np.stack([(b * q - c * p) / determinant, (b * p - a * q) / determinant], axis=2)
    # A linearised edge tells nothing about motions beyond its own width.
    return np.clip(motion, -EDGE_SCALE, EDGE_SCALE).astype(np.float32)


def _dalembertian(images: Sequence[FloatImage]) -> FloatImage:
    """Filter a short sequence at its middle frame; the spatial Laplacian alone if it is one frame."""
    offsets = np.arange(len(images)) - len(images) // 2
    weights = np.exp(-0.5 * offsets.astype(float) ** 2)
    weights /= weights.sum()
    smooth = [np.asarray(cv2.GaussianBlur(image, (0, 0), EDGE_SCALE), dtype=np.float32) for image in images]
    spatial = sum(weight * cv2.Laplacian(image, cv2.CV_32F) for weight, image in zip(weights, smooth, strict=True))
    if len(images) == 1:
        return np.asarray(spatial, dtype=np.float32)
    bend = (offsets**2 - 1.0) * weights
    bend -= bend.mean()
    bend /= 0.5 * (bend * offsets**2).sum()
    temporal = sum(weight * image for weight, image in zip(bend, smooth, strict=True))
    return np.asarray(spatial - temporal / WAVE_SPEED**2, dtype=np.float32)


def _zero_crossings(signal: FloatImage) -> FloatImage:
    """1 at pixels next to a change of sign, else 0."""
    edge = np.zeros(signal.shape, np.float32)
    across = signal[:, :-1] * signal[:, 1:] < 0
    down = signal[:-1] * signal[1:] < 0
    for part, crossing in ((edge[:, :-1], across), (edge[:, 1:], across), (edge[:-1], down), (edge[1:], down)):
        part[crossing] = 1.0
    return edge


def _pooled(image: FloatImage) -> FloatImage:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), NEIGHBOURHOOD), dtype=np.float32)
