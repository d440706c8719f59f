"""Three-frame differencing at its best: threshold by the measured noise, camera shift taken out, box followed.

A pixel belongs to the moving object when it differs from an earlier frame and from one earlier still: a place that
differs from one of them only is background. What the object has left last differs from both, and is cut off by its
velocity.
"""

from __future__ import annotations

from collections import deque
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .regions import BoxFollower, noise_threshold

__all__ = ["GAP", "FrameDifferencing", "aligned", "smooth_gray"]

GAP = 2  # frames between the three, so that slow objects move enough to show
_WIDTH = 160  # px: width at which the camera's shift is measured
_IMPROVEMENT = 0.85  # of the median difference, under which a shift of the camera is believed

Gray = NDArray[np.float32]


class FrameDifferencing:
    """Three-frame differencing with cv2's calls."""

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start from a box."""
        x, y, w, h = (float(value) for value in boundingBox)
        self._follower = BoxFollower(np.array([x + w / 2, y + h / 2]), np.array([w, h]))
        self._past: deque[Gray] = deque([smooth_gray(image)], maxlen=2 * GAP)

    def update(self, image: NDArray[Any]) -> tuple[bool, tuple[float, float, float, float]]:
        """Follow the pixels that changed."""
        gray = smooth_gray(image)
        earlier = [self._past[max(0, len(self._past) - GAP)], self._past[0]]
        differences = [np.abs(gray - aligned(old, gray)) for old in earlier]
        changed = np.minimum(*differences)
        lag = min(GAP, len(self._past))
        self._past.append(gray)
        return self._follower.update((changed > noise_threshold(differences[0])).astype(np.uint8), lag=lag)


def smooth_gray(image: NDArray[Any]) -> Gray:
    """Gray levels, smoothed against noise."""
    gray = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) if image.ndim == 3 and image.shape[2] == 3 else image
    gray = gray[:, :, 0] if gray.ndim == 3 else gray
    return np.asarray(cv2.GaussianBlur(gray.astype(np.float32), (0, 0), 1.0), dtype=np.float32)


def aligned(old: Gray, new: Gray) -> Gray:
    """Shift `old` as the camera has moved since.

    Phase correlation may find the object's motion instead: a shift must make most of the frame fit better.
    """
    ratio = min(1.0, _WIDTH / old.shape[1])
    small = [cv2.resize(frame, None, fx=ratio, fy=ratio, interpolation=cv2.INTER_AREA) for frame in (old, new)]
    window = cv2.createHanningWindow((small[0].shape[1], small[0].shape[0]), cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(small[0], small[1], window)
    if np.hypot(dx, dy) < 0.1:
        return old
    matrix = np.array([[1.0, 0.0, dx / ratio], [0.0, 1.0, dy / ratio]])
    size = old.shape[1], old.shape[0]
    shifted = np.asarray(cv2.warpAffine(old, matrix, size, borderMode=cv2.BORDER_REPLICATE), dtype=np.float32)
    before, after = (float(np.median(np.abs(new - other)[::2, ::2])) for other in (old, shifted))
    return shifted if after < _IMPROVEMENT * before else old
