"""A frame as the propagation mode reads it: patches at a pose, and how much in them has the object's colours."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import patches
from ..frames import Frame, crop, to_gray
from .state import Geometry, Pose

__all__ = ["COLOURS", "GRAYS", "View", "foreground", "histograms_of", "likelihood_of"]

F32 = NDArray[np.float32]

GRAYS, COLOURS = 64, 4096


class View:
    """The part of a frame round the object, cut once and sampled often."""

    def __init__(self, frame: Frame, geometry: Geometry, pose: Pose) -> None:
        fine = geometry.fine_step * min(pose.sx, pose.sy)
        # Thinning the pixels keeps the cost of a large object that of a small one: two reads a sample remain.
        self._thin = max(1, int(fine / 2.0))
        self._frame = Frame(frame.pixels[:: self._thin, :: self._thin], frame.gain)
        self._geometry = geometry
        self._seen: dict[Pose, F32] = {}
        self._left = self._top = self._right = self._bottom = 0
        self._colour: F32 = np.empty((0, 0, 1), np.float32)
        self._gray = self._colour
        rows, columns = geometry.window.shape
        self._cut(pose, geometry.coarse_step, rows, columns)

    def fine(self, pose: Pose) -> F32:
        """Normalised gray patch at a pose: zero mean under the inner weights, deviation about 32."""
        if pose in self._seen:
            return self._seen[pose]
        g = self._geometry
        gray, patch = self._sample(pose, g.fine_step, *g.weights.shape, gray=True), np.empty_like(g.weights)
        patches.normalise(gray[:, :, 0], g.inner, patch)
        self._seen[pose] = patch
        return patch

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the frame, px."""
        return self._frame.width * self._thin, self._frame.height * self._thin

    def contains(self, pose: Pose) -> bool:
        """Whether the pose's centre lies in the frame."""
        return 0 <= pose.cx / self._thin < self._frame.width and 0 <= pose.cy / self._thin < self._frame.height

    def coarse(self, pose: Pose) -> F32:
        """Raw window (h, w, C) of the correlation filter at a pose."""
        return self._sample(pose, self._geometry.coarse_step, *self._geometry.window.shape, gray=False)

    def context(self, pose: Pose) -> F32:
        """Gray of the same window, twice as fine."""
        rows, columns = self._geometry.window.shape
        unit = 0.5 * self._geometry.coarse_step
        return np.ascontiguousarray(self._sample(pose, unit, 2 * rows, 2 * columns, gray=True)[:, :, 0])

    def _sample(self, pose: Pose, unit: float, rows: int, columns: int, *, gray: bool) -> F32:
        self._cut(pose, unit, rows, columns)
        source = self._gray if gray else self._colour
        out = np.empty((rows, columns, source.shape[2]), np.float32)
        t = self._thin
        place = source, pose.cx / t - self._left, pose.cy / t - self._top, unit * pose.sx / t, unit * pose.sy / t
        if pose.angle == 0.0:
            patches.sample(*place, out)
        else:
            patches.sample_turned(*place, pose.angle, out)
        return out

    def _cut(self, pose: Pose, unit: float, rows: int, columns: int) -> None:
        t = self._thin
        x, y = pose.cx / t, pose.cy / t
        half_x, half_y = unit * pose.sx * columns / 2 / t, unit * pose.sy * rows / 2 / t
        cosine, sine = abs(math.cos(pose.angle)), abs(math.sin(pose.angle))
        half_x, half_y = cosine * half_x + sine * half_y + 4, cosine * half_y + sine * half_x + 4
        inside = x - half_x >= self._left and x + half_x <= self._right
        if inside and y - half_y >= self._top and y + half_y <= self._bottom:
            return
        # Room for the pose to move in before all has to be cut again.
        half_x, half_y = 1.1 * half_x, 1.1 * half_y
        left, right, top, bottom = int(x - half_x), int(x + half_x) + 1, int(y - half_y), int(y + half_y) + 1
        self._left, self._top, self._right, self._bottom = left, top, right, bottom
        self._colour = crop(self._frame, left, top, right - left, bottom - top)
        self._gray = to_gray(self._colour)[:, :, None]


def histograms_of(bins: NDArray[np.int32], count: int, inside: NDArray[np.bool_]) -> F32:
    """Shares of `count` bins inside and outside in a coarse window, (2, bins)."""
    both = np.stack([np.bincount(bins[m], minlength=count) for m in (inside, ~inside)]).astype(np.float32)
    if count == GRAYS:
        both = np.asarray(cv2.GaussianBlur(both, (7, 1), 1.5), np.float32)
    return np.asarray(both / np.maximum(both.sum(axis=1, keepdims=True), 1.0), np.float32)


def likelihood_of(histograms: F32) -> F32:
    """Share of the object in each bin of colour, (bins,), 0–1."""
    share: F32 = (histograms[0] + np.float32(1e-4)) / (histograms[0] + histograms[1] + np.float32(2e-4))
    return share


def foreground(window: F32, likelihood: F32) -> tuple[F32, NDArray[np.int32]]:
    """Likelihood of the object's colours in each sample of a coarse window, and the samples' bins; both (h, w)."""
    seen, bins = np.empty(window.shape[:2], np.float32), np.empty(window.shape[:2], np.int32)
    patches.foreground(window, likelihood, bins, seen)
    return seen, bins
