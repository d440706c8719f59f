"""A frame as the patch tracker reads it: patches at a pose, and how well they agree with what was learned."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Frame, crop, to_gray
from . import patches, tuning
from .finder import PATCH, Scene
from .patches import Place
from .state import Before, Geometry, Pose

__all__ = ["Patch", "Sampler"]

F32 = NDArray[np.float32]


class Patch(NamedTuple):
    """A fine patch.

    Parameters
    ----------
    gray : ndarray, shape (h, w), float32
        Normalised: zero mean under the inner weights, deviation about 32.
    agreement : float
        Correlation with the mean patch, −1 to 1.
    keys : list of float
        Correlation with each keyframe.
    """

    gray: F32
    agreement: float
    keys: list[float]


class Sampler:
    """The part of a frame round the object, cut once and sampled often."""

    def __init__(self, frame: Frame, geometry: Geometry, pose: Pose, templates: F32, before: Before | None) -> None:
        fine = geometry.fine_step * min(pose.sx, pose.sy)
        # Thinning the pixels keeps the cost of a large object that of a small one: two reads a sample remain.
        self._thin = max(1, int(fine / 2.0))
        self._frame = replace(frame, pixels=frame.pixels[:: self._thin, :: self._thin])
        self._geometry = geometry
        self._templates = templates
        self._before = before
        self._seen: dict[Pose, Patch] = {}
        self._left = self._top = self._right = self._bottom = 0
        self._colour: F32 = np.empty((0, 0, 1), np.float32)
        self._gray: F32 = np.empty((0, 0), np.float32)
        self._cut(pose, geometry.lattice.step, PATCH, PATCH)

    def fine(self, pose: Pose) -> Patch:
        """Fine patch at a pose."""
        found = self._seen.get(pose)
        if found is None:
            g = self._geometry
            at = self._place(pose, g.fine_step, *g.weights.shape)
            gray, scores = patches.fine(self._gray, at, g.inner, self._templates)
            agreement, *keys = scores.tolist()
            found = self._seen[pose] = Patch(gray, agreement, keys)
        return found

    def likelihood(self, pose: Pose, histograms: F32) -> F32:
        """Likelihood of the object's colours in the fine patch at a pose, on the coarse lattice."""
        shape = self._geometry.colours
        return patches.likelihood(self._colour, self._coarse(pose), histograms, shape)

    def learned_colours(self, pose: Pose, histograms: F32, rate: float) -> F32:
        """Histograms with the colours round a pose mixed in at that rate."""
        at = self._coarse(pose)
        return patches.learned_colours(self._colour, at, histograms, self._geometry.inside, rate)

    def colours(self, pose: Pose) -> F32:
        """Samples (C, h, w) of the coarse window at a pose."""
        at, (rows, columns) = self._coarse(pose), self._geometry.inside.shape
        return patches.colours(self._colour, at, (rows, columns))

    def scene(self, pose: Pose) -> Scene:
        """Window of the finder at a pose."""
        step, before = self._geometry.lattice.step, self._before
        at = then = self._place(pose, step, PATCH, PATCH)
        if before is None:
            return Scene(self._colour, at, None, then)
        t = before.thin
        then = Place(
            pose.cx / t - before.left, pose.cy / t - before.top, step * pose.sx / t, step * pose.sy / t, pose.angle
        )
        height, width = before.gray.shape[:2]
        # Most of the window, which fades, must have been seen: nothing is known of changes elsewhere.
        half_x, half_y = tuning.KNOWN_WINDOW * PATCH * then.step_x, tuning.KNOWN_WINDOW * PATCH * then.step_y
        if not (half_x <= then.x <= width - half_x and half_y <= then.y <= height - half_y):
            return Scene(self._colour, at, None, then)
        return Scene(self._colour, at, before.gray, then)

    @property
    def part(self) -> Before:
        """What was cut, for the frame that follows."""
        return Before(self._gray[:, :, np.newaxis], self._left, self._top, self._thin)

    @property
    def size(self) -> tuple[float, float]:
        """Width and height of the frame, px."""
        return self._frame.width * self._thin, self._frame.height * self._thin

    def contains(self, pose: Pose) -> bool:
        """Whether the pose's centre lies in the frame."""
        return 0 <= pose.cx / self._thin < self._frame.width and 0 <= pose.cy / self._thin < self._frame.height

    def _coarse(self, pose: Pose) -> Place:
        return self._place(pose, self._geometry.coarse_step, *self._geometry.inside.shape)

    def _place(self, pose: Pose, unit: float, rows: int, columns: int) -> Place:
        """Where a patch is in the part cut, which is made to hold it."""
        self._cut(pose, unit, rows, columns)
        t = self._thin
        x, y = pose.cx / t - self._left, pose.cy / t - self._top
        return Place(x, y, unit * pose.sx / t, unit * pose.sy / t, pose.angle)

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
        half_x, half_y = tuning.SPARE * half_x, tuning.SPARE * half_y
        left, right, top, bottom = int(x - half_x), int(x + half_x) + 1, int(y - half_y), int(y + half_y) + 1
        self._left, self._top, self._right, self._bottom = left, top, right, bottom
        self._colour = crop(self._frame, left, top, right - left, bottom - top)
        self._gray = to_gray(self._colour)
