"""What the small flow baselines share: gray frames, pyramids, warping. On purpose cv2 and NumPy, not our kernels."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = [
    "FloatImage",
    "Flow",
    "Frame",
    "float_gray",
    "image_pyramid",
    "pixel_grid",
    "resize_flow",
    "smooth_flow",
    "warp",
]

FloatImage = NDArray[np.float32]
"""Gray, shape (H, W)."""

Frame = NDArray[np.uint8]
"""What every method takes two of: shape (H, W), or (H, W, 3) BGR."""

Flow = NDArray[np.float32]
"""What every method returns: shape (H, W, 2), px per frame."""


def float_gray(image: NDArray[np.uint8]) -> FloatImage:
    """Gray float32 version, 0–255, of a gray or BGR frame."""
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(gray, dtype=np.float32)


def image_pyramid(image: FloatImage, smallest_side: int) -> list[FloatImage]:
    """The image, then halves of it (2 × 2 means, so centres stay aligned) down to ``smallest_side`` px."""
    levels = [image]
    while min(levels[-1].shape) >= 2 * smallest_side:
        height, width = levels[-1].shape
        half = cv2.resize(levels[-1], ((width + 1) // 2, (height + 1) // 2), interpolation=cv2.INTER_AREA)
        levels.append(np.asarray(half, dtype=np.float32))
    return levels


def resize_flow(flow: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """Flow at another resolution: resampled, its vectors scaled by the ratio of the sizes."""
    height, width = shape[:2]
    ratio = np.array([width / flow.shape[1], height / flow.shape[0]], np.float32)
    return np.asarray(cv2.resize(flow, (width, height), interpolation=cv2.INTER_LINEAR) * ratio, dtype=np.float32)


def smooth_flow(flow: NDArray[np.float32], size: int = 5) -> NDArray[np.float32]:
    """Median of each component in a window of 3 or 5 px."""
    parts = [cv2.medianBlur(np.ascontiguousarray(flow[:, :, channel]), size) for channel in (0, 1)]
    return np.stack(parts, axis=2).astype(np.float32)


def pixel_grid(shape: tuple[int, ...]) -> tuple[FloatImage, FloatImage]:
    """Column and row number of every pixel."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(np.float32)
    return columns, rows


def warp(image: FloatImage, flow: NDArray[Any], interpolation: int = cv2.INTER_LINEAR) -> FloatImage:
    """``image[y + v, x + u]``; the border is repeated."""
    columns, rows = pixel_grid(image.shape)
    x, y = (np.asarray(axis + flow[:, :, i], dtype=np.float32) for i, axis in enumerate((columns, rows)))
    return np.asarray(cv2.remap(image, x, y, interpolation, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32)
