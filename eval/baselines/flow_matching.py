"""Flow by matching windows: block matching (SSD, NCC) and block-wise phase correlation.

Sources: sum of squared differences with a coarse-to-fine search, P. Anandan, "A computational framework and an
algorithm for the measurement of visual motion", IJCV 2 (1989); normalised cross-correlation, J. P. Lewis, "Fast
normalized cross-correlation", Vision Interface (1995); phase correlation, C. Kuglin and D. Hines, "The phase
correlation image alignment method", IEEE Cybernetics and Society (1975), by ``cv2.phaseCorrelate``.
"""

from __future__ import annotations

from collections.abc import Callable

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

__all__ = ["match_ncc", "match_ssd", "phase_correlation"]

WINDOW = 9
"""Side of the matched window, px, on every level."""

REACH = 2
"""Search range on every level but the coarsest, px."""

COARSE_REACH = 5
"""Search range on the coarsest level, px."""


def match_ssd(first: Frame, second: Frame) -> Flow:
    """Flow that minimises the sum of squared differences of 9 × 9 windows, coarse to fine.

    Sub-pixel by a parabola through the costs.
    """
    return _search(first, second, lambda one, other: _window_mean((one - other) ** 2))


def match_ncc(first: Frame, second: Frame) -> Flow:
    """Flow that maximises the normalised cross-correlation of 9 × 9 windows, coarse to fine.

    Sub-pixel by a parabola through the costs.
    """
    return _search(first, second, _decorrelation)


def _window_mean(image: FloatImage) -> FloatImage:
    return np.asarray(cv2.blur(image, (WINDOW, WINDOW), borderType=cv2.BORDER_REPLICATE), dtype=np.float32)


def _decorrelation(one: FloatImage, other: FloatImage) -> FloatImage:
    """1 − normalised cross-correlation; flat windows, where it is undefined, count as uncorrelated."""
    mean, mean_other = _window_mean(one), _window_mean(other)
    covariance = _window_mean(one * other) - mean * mean_other
    power = (_window_mean(one * one) - mean**2) * (_window_mean(other * other) - mean_other**2)
    # One gray level of variance keeps rounding noise in flat windows from looking like correlation.
    return np.asarray(1.0 - covariance / np.sqrt(np.maximum(power, 0.0) + 1.0), dtype=np.float32)


def _search(
    first: NDArray[np.uint8], second: NDArray[np.uint8], cost: Callable[[FloatImage, FloatImage], FloatImage]
) -> NDArray[np.float32]:
    pyramids = (image_pyramid(float_gray(frame), 24) for frame in (first, second))
    levels = list(zip(*pyramids, strict=True))[::-1]
    flow = np.zeros((*levels[0][0].shape, 2), np.float32)
    for number, (one, other) in enumerate(levels):
        reach = COARSE_REACH if number == 0 else REACH
        # Whole pixels, so that the compared windows are the frames' own pixels and not interpolated ones.
        base = np.rint(resize_flow(flow, one.shape))
        flow = smooth_flow(base + _best_offset(_cost_volume(one, other, base, reach, cost)))
    return flow


def _cost_volume(
    one: FloatImage,
    other: FloatImage,
    base: NDArray[np.float32],
    reach: int,
    cost: Callable[[FloatImage, FloatImage], FloatImage],
) -> NDArray[np.float32]:
    """Cost of every offset from ``base``; shape (2 reach + 1, 2 reach + 1, H, W), offsets in y then x."""
    side = 2 * reach + 1
    volume = np.empty((side, side, *one.shape), np.float32)
    for row in range(side):
        for column in range(side):
            candidate = warp(other, base + np.array([column - reach, row - reach]), cv2.INTER_NEAREST)
            volume[row, column] = cost(one, candidate)
    return volume


def _best_offset(volume: NDArray[np.float32]) -> NDArray[np.float32]:
    """Offset of least cost (u, v), px, refined by a parabola in each direction where both neighbours exist."""
    side, _, height, width = volume.shape
    best = volume.reshape(side * side, height, width).argmin(axis=0)
    row, column = np.divmod(best, side)
    y, x = np.mgrid[:height, :width]

    def refined(index: NDArray[np.intp], step_row: int, step_column: int) -> NDArray[np.float32]:
        inside = (index > 0) & (index < side - 1)
        centre = volume[row, column, y, x]
        before = volume[np.maximum(row - step_row, 0), np.maximum(column - step_column, 0), y, x]
        after = volume[np.minimum(row + step_row, side - 1), np.minimum(column + step_column, side - 1), y, x]
        bend = before - 2.0 * centre + after
        shift = np.where(inside & (bend > 1e-6), 0.5 * (before - after) / np.maximum(bend, 1e-6), 0.0)
        return np.asarray(index - side // 2 + shift, dtype=np.float32)

    return np.stack([refined(column, 0, 1), refined(row, 1, 0)], axis=2)


def phase_correlation(first: Frame, second: Frame) -> Flow:
    """Flow by phase correlation of overlapping blocks of 128, then 64, then 32 px.

    Every block of the second frame is taken where the larger blocks have found it, so that a shift larger than a
    small block can be followed; a block whose correlation peak is weak keeps what the larger ones found.

    Interpolated between the blocks' centres.
    """
    one, other = float_gray(first), float_gray(second)
    flow = np.zeros((*one.shape, 2), np.float32)
    for block in (128, 64, 32):
        if block <= min(one.shape):
            flow = _correlate_blocks(one, other, flow, block)
    return flow


def _correlate_blocks(
    one: FloatImage, other: FloatImage, flow: NDArray[np.float32], block: int
) -> NDArray[np.float32]:
    step, weakest = block // 4, 0.05
    tops, lefts = (_starts(length, block, step) for length in one.shape)
    window = cv2.createHanningWindow((block, block), cv2.CV_32F)
    found = np.empty((len(tops), len(lefts), 2), np.float32)
    for i, top in enumerate(tops):
        for j, left in enumerate(lefts):
            guess = flow[top + block // 2, left + block // 2]
            other_left, other_top = (
                int(np.clip(start + round(float(shift)), 0, length - block))
                for start, shift, length in ((left, guess[0], one.shape[1]), (top, guess[1], one.shape[0]))
            )
            patch = _centred(one[top : top + block, left : left + block])
            match = _centred(other[other_top : other_top + block, other_left : other_left + block])
            (dx, dy), response = cv2.phaseCorrelate(patch, match, window)
            good = response > weakest
            found[i, j] = (other_left - left + dx, other_top - top + dy) if good else guess
    return _between_centres(smooth_flow(found, 3), tops, lefts, block, one.shape)


def _centred(block: FloatImage) -> FloatImage:
    """Copy of mean 0: the window must not be seen as an edge, and phaseCorrelate misreads views of a larger image."""
    return np.asarray(block - block.mean(), dtype=np.float32)


def _starts(length: int, block: int, step: int) -> NDArray[np.intp]:
    """First pixels of blocks that cover a side evenly, about ``step`` px apart."""
    count = max(round((length - block) / step), 0) + 1
    return np.asarray(np.rint(np.linspace(0, length - block, count)), dtype=np.intp)


def _between_centres(
    found: NDArray[np.float32], tops: NDArray[np.intp], lefts: NDArray[np.intp], block: int, shape: tuple[int, ...]
) -> NDArray[np.float32]:
    """Bilinear between the centres of the blocks, constant beyond the outermost."""
    centre = (block - 1) / 2
    columns, rows = pixel_grid(shape)
    x = np.interp(columns[0], lefts + centre, np.arange(len(lefts))).astype(np.float32)
    y = np.interp(rows[:, 0], tops + centre, np.arange(len(tops))).astype(np.float32)
    x_map = np.ascontiguousarray(np.broadcast_to(x, shape))
    y_map = np.ascontiguousarray(np.broadcast_to(y[:, np.newaxis], shape))
    return np.asarray(cv2.remap(found, x_map, y_map, cv2.INTER_LINEAR), dtype=np.float32)
