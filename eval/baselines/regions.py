"""From a mask of change to the box of one target: shared by the baselines that see motion and nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["BoxFollower", "noise_threshold"]

_GATE = 0.35  # how far, in box sizes, changed pixels may lie outside the predicted box
_GATE_PIXELS = 6.0
_INSIDE = 0.6  # of the size, from the centre: components centred within it are parts of the target
_GROWTH = 0.12  # largest change of a side per frame
_FILLED = 0.03  # least changed share of the box that counts as seen
_PATIENCE = 40  # frames without change for which the box is held: a stopped object looks like that

FloatArray = NDArray[np.float64]


def noise_threshold(difference: NDArray[np.float32]) -> float:
    """Level above which a difference of frames, in gray levels, is no noise.

    The median of a half-normal distribution is 0.6745 σ, and most of the frame is background.
    """
    return max(6.0, 4.5 * float(np.median(difference[::2, ::2])) / 0.6745)


@dataclass
class BoxFollower:
    """Follows one target through masks of change with a constant-velocity prediction.

    Parameters
    ----------
    centre, size : ndarray, shape (2,)
        px.
    """

    centre: FloatArray
    size: FloatArray

    def __post_init__(self) -> None:
        self._velocity = np.zeros(2)
        self._missed = 0

    def update(self, mask: NDArray[np.uint8], *, lag: int = 0) -> tuple[bool, tuple[float, float, float, float]]:
        """Move the box to the changed pixels near the predicted place; hold it where there are none.

        Parameters
        ----------
        mask : ndarray of uint8, shape (H, W)
            Not 0 where something changed.
        lag : int, optional
            Frames for which a place that the target has left still counts as changed: it is cut off behind.
        """
        predicted = self.centre + self._velocity
        seen = self._changed_near(mask, predicted)
        if seen is None:
            self._missed += 1
            self._velocity *= 0.5
        else:
            self._missed = 0
            low, high = seen
            trail = np.clip(lag * self._velocity, -0.5 * (high - low), 0.5 * (high - low))
            self._follow(low + np.maximum(trail, 0.0), high + np.minimum(trail, 0.0))
        self.centre = np.clip(self.centre, 0.0, (mask.shape[1], mask.shape[0]))
        if self._missed > _PATIENCE:
            return False, (0.0, 0.0, 0.0, 0.0)
        left, top = self.centre - self.size / 2
        return True, (float(left), float(top), float(self.size[0]), float(self.size[1]))

    def _follow(self, low: FloatArray, high: FloatArray) -> None:
        size = np.clip(high - low, self.size * (1 - _GROWTH), self.size * (1 + _GROWTH))
        # Sides that shrink are mostly surface that did not change: believe growth sooner.
        rate = np.where(size > self.size, 0.4, 0.15)
        size = self.size + rate * (size - self.size)
        centre = (low + high) / 2
        step = np.clip(centre - self.centre, -0.6 * self.size, 0.6 * self.size)
        self._velocity = 0.6 * self._velocity + 0.4 * step
        self.centre, self.size = self.centre + 0.3 * self._velocity + 0.7 * step, size

    def _changed_near(self, mask: NDArray[np.uint8], predicted: FloatArray) -> tuple[FloatArray, FloatArray] | None:
        """Edges of the changed components that belong to the predicted box, of those inside the gate round it."""
        reach = self.size * (0.5 + _GATE) + _GATE_PIXELS + np.abs(self._velocity)
        limits = (mask.shape[1], mask.shape[0])
        left, top = np.clip(np.floor(predicted - reach), 0, limits).astype(int)
        right, bottom = np.clip(np.ceil(predicted + reach), 0, limits).astype(int)
        part = mask[top:bottom, left:right]
        if part.size == 0:
            return None
        joined = _close(part, float(self.size.min()))
        _, labels, stats, centres = cv2.connectedComponentsWithStats(joined)
        offsets = np.asarray(centres, dtype=np.float64) - (predicted - (left, top))
        changed = (part > 0) & np.isin(labels, self._chosen(np.asarray(stats, dtype=np.int32), offsets))
        if changed.sum() < _FILLED * self.size.prod():
            return None
        rows, columns = np.nonzero(changed)
        # The outermost hundredth is stray.
        (x0, x1), (y0, y1) = (np.percentile(indices, (1, 99)) for indices in (columns, rows))
        return np.array([left + x0, top + y0]), np.array([left + x1 + 1, top + y1 + 1])

    def _chosen(self, stats: NDArray[np.int32], offsets: FloatArray) -> list[int]:
        """Labels of the components whose centre lies in the predicted box, or the one nearest to it.

        What only touches the box is a neighbour: taking it in would let the box grow without end.
        """
        large = stats[:, cv2.CC_STAT_AREA] >= max(4.0, 0.01 * float(self.size.prod()))
        large[0] = False  # the background
        inside = large & (np.abs(offsets) <= self.size * _INSIDE + 1.0).all(axis=1)
        if inside.any() or not large.any():
            return [int(label) for label in np.flatnonzero(inside)]
        distance = np.where(large, np.hypot(*(offsets / self.size).T), np.inf)
        return [int(np.argmin(distance))]


def _close(mask: NDArray[np.uint8], side: float) -> NDArray[np.uint8]:
    """Drop single pixels, then join what is close in relation to the object."""
    reach = 2 * round(np.clip(side / 8, 1, 8)) + 1
    cleaned = cv2.medianBlur((mask > 0).astype(np.uint8) * 255, 3)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (reach, reach))
    return np.asarray(cv2.morphologyEx(cleaned, cv2.MORPH_CLOSE, kernel), dtype=np.uint8)
