"""TrackerHS with the pixels that its segmentation knows, for truths that are masks."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

import hs_tracker_cv

__all__ = ["Masked"]


class Masked:
    """Ours, that answers with the pixels of the object, too, as long as segmentation leads.

    Parameters
    ----------
    **params
        Fields of ``TrackerHS_Params``.
    """

    def __init__(self, **params: Any) -> None:
        self._tracker = hs_tracker_cv.TrackerHS_create(hs_tracker_cv.TrackerHS_Params(**params))
        self._shape = (0, 0)

    def init(self, image: NDArray[Any], boundingBox: Any) -> bool | None:
        """Start."""
        self._shape = image.shape[:2]
        started: bool | None = self._tracker.init(image, boundingBox)
        return started

    def update(self, image: NDArray[Any]) -> tuple[bool, Any]:
        """Follow."""
        answer: tuple[bool, Any] = self._tracker.update(image)
        return answer

    def getTrackingScore(self) -> float:
        """Chance that the box is right."""
        return float(self._tracker.getTrackingScore())

    def getMask(self) -> NDArray[np.bool_] | None:
        """Pixels of the object, shape (H, W); None where they are not known."""
        seen = self._tracker.debug()
        if seen.mask is None:
            return None
        # Middle of the window's first pixel, in pixels of the frame.
        x, y = (start + seen.step / 2.0 - 0.5 for start in (seen.window.x, seen.window.y))
        place = np.array([[seen.step, 0.0, x], [0.0, seen.step, y]])
        size = self._shape[1], self._shape[0]
        mask = cv2.warpAffine(seen.mask.astype(np.uint8), place, size, flags=cv2.INTER_NEAREST)
        return np.asarray(mask > 0)
