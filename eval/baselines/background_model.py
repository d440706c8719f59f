"""Background subtraction: a mixture of Gaussians per pixel (OpenCV's MOG2), shadows removed, box followed."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .regions import BoxFollower

__all__ = ["BackgroundModel"]

_HISTORY = 200  # frames
_VARIANCES = 20.0  # squared distance, in variances, from which a pixel is foreground
_SHADOW = 127  # MOG2's mark


class BackgroundModel:
    """MOG2 with cv2's tracker calls; for still cameras."""

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start from a box; what is under the object is guessed from around it, so that it leaves no ghost."""
        x, y, w, h = boundingBox
        self._follower = BoxFollower(np.array([x + w / 2, y + h / 2]), np.array([w, h], dtype=np.float64))
        self._model = cv2.createBackgroundSubtractorMOG2(_HISTORY, _VARIANCES, True)
        self._model.apply(_without_object(image, (x, y, w, h)), learningRate=1.0)

    def update(self, image: NDArray[Any]) -> tuple[bool, tuple[float, float, float, float]]:
        """Follow the foreground."""
        foreground = self._model.apply(cv2.GaussianBlur(image, (3, 3), 0))
        return self._follower.update((foreground > _SHADOW).astype(np.uint8))


def _without_object(image: NDArray[Any], box: tuple[int, int, int, int]) -> NDArray[Any]:
    x, y, w, h = box
    # A large hole is filled at reduced resolution: the guess is smooth anyway.
    ratio = min(1.0, 40.0 / max(w, h))
    small = cv2.resize(image, None, fx=ratio, fy=ratio, interpolation=cv2.INTER_AREA)
    hole = np.zeros(image.shape[:2], dtype=np.uint8)
    margin = max(2, round(0.05 * max(w, h)))
    hole[max(0, y - margin) : y + h + margin, max(0, x - margin) : x + w + margin] = 255
    small_hole = cv2.resize(hole, (small.shape[1], small.shape[0]), interpolation=cv2.INTER_NEAREST)
    filled = cv2.resize(cv2.inpaint(small, small_hole, 3, cv2.INPAINT_TELEA), (image.shape[1], image.shape[0]))
    return np.where((hole > 0)[..., np.newaxis] if image.ndim == 3 else hole > 0, filled, image)
