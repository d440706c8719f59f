"""The paper's method on one pair of frames, stage by stage: what a student of it wants to see.

Smoothed frames → F_x, F_y, F_t (steps 1–3) → flow (4–5) → normal flow (9) → threshold (10) → segmentation (11) →
corners and box (12). Every stage is what the paper's own formulas give on these two frames alone: no first guess, no
memory of earlier frames, no rectangle. :class:`~hs_tracker_cv.MotionDetector` is what to use for detection; it goes
through the same stages with an adaptive threshold, and asks the flow to explain what has changed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .flow import HornSchunck, derivatives, normal_flow
from .flow.params import FlowParams, Mode
from .frames import Frame, as_pair, crop, fixed_errstate, to_gray
from .geometry import Box
from .scalars import make_plain

__all__ = ["MODES", "PaperMethod", "StageParams", "Stages"]

MODES = ("classic", "solve", "fast", "default", "accurate")
"""Flows to choose from; the first is the paper's."""

STEEP = 3.0
"""Gradient, gray levels per px, below which a normal flow is noise divided by nothing."""
MIN_AREA = 5e-4
"""Smallest segment, as a share of the frame."""
MAX_CORNERS = 50

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class StageParams:
    """What the stages are computed with.

    Parameters
    ----------
    mode : {"classic", "solve", "fast", "default", "accurate"}
        Flow, as for :class:`~hs_tracker_cv.HornSchunck`; "classic" is the paper's.
    smoothness : float
        λ, gray levels of a 0–255 image; > 0.
    iterations : int
        Sweeps of "classic"; of the other modes see FlowParams.
    smoothing : float
        σ of the Gaussian before everything else, lattice px; >= 0.
    threshold : float
        Normal flow from which a pixel moves, frame px per frame; > 0.
    max_side : int
        Longer side of the lattice, px; larger frames are averaged down to it.

    Raises
    ------
    TypeError, ValueError
        If a value that should be a number is not one, or is out of range.
    """

    mode: Mode = "classic"
    smoothness: float = 10.0
    iterations: int = 100
    smoothing: float = 1.0
    threshold: float = 0.5
    max_side: int = 640

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        make_plain(self)
        FlowParams.preset(self.mode, smoothness=self.smoothness, iterations=self.iterations)
        if not 0 <= self.smoothing <= 20:
            raise ValueError(f"expected smoothing from 0 to 20, got {self.smoothing!r}")
        if not self.threshold > 0:
            raise ValueError(f"expected threshold above 0, got {self.threshold!r}")
        if self.max_side < 32:
            raise ValueError(f"expected max_side of at least 32, got {self.max_side!r}")

    @classmethod
    def preset(cls, mode: Mode, **others: Any) -> StageParams:
        """The λ and the iterations that `mode` has by itself, with the other values given."""
        flow = FlowParams.preset(mode)
        return cls(**{"mode": mode, "smoothness": flow.smoothness, "iterations": flow.iterations, **others})


class Stages:
    """Every intermediate result on one pair of frames; what ``display.draw_panel`` draws.

    Arrays lie on a lattice over the whole frame, `step` frame px apart. Each is computed when it is first asked for.

    Attributes
    ----------
    params : StageParams
    window : Box
        The whole frame, px.
    step : float
        Frame px per lattice px.
    previous, current : ndarray, shape (h, w), float32
        Smoothed gray frames, 0–255.
    """

    def __init__(self, params: StageParams, solver: HornSchunck, before: Frame, after: Frame) -> None:
        self.params = params
        self.window = Box(0.0, 0.0, float(after.width), float(after.height))
        self.step = max(1.0, max(after.width, after.height) / params.max_side)
        self._solver = solver
        size = (max(round(after.width / self.step), 1), max(round(after.height / self.step), 1))
        self.previous = _plane(before, size, params.smoothing)
        self.current = _plane(after, size, params.smoothing)

    @cached_property
    def _slopes(self) -> tuple[Plane, Plane, Plane]:
        return derivatives(self.previous, self.current)

    @property
    def Fx(self) -> Plane:
        """Derivative along x over the 2 × 2 × 2 cube, (h, w), gray levels per px."""
        return self._slopes[0]

    @property
    def Fy(self) -> Plane:
        """Derivative along y, (h, w), gray levels per px."""
        return self._slopes[1]

    @property
    def Ft(self) -> Plane:
        """Derivative along time, (h, w), gray levels per frame."""
        return self._slopes[2]

    @cached_property
    def flow(self) -> Plane:
        """From the previous frame to the current one, (h, w, 2), lattice px per frame."""
        return self._solver.calc(self.previous, self.current)

    @cached_property
    def normal_flow(self) -> Plane:
        """Flow along the gradient, (h, w, 2), lattice px per frame."""
        return normal_flow(*self._slopes)

    @cached_property
    def moving(self) -> Mask:
        """Where the gradient is steep and the normal flow at or above the threshold, (h, w)."""
        # The length of the normal flow is |Ft| / |∇F|.
        steepness = cv2.magnitude(self.Fx, self.Fy)
        above = np.abs(self.Ft) >= steepness * (self.params.threshold / self.step)
        return np.asarray(above & (steepness >= STEEP), bool)

    @cached_property
    def _segments(self) -> tuple[Mask, Box | None]:
        return _segmented(self.moving, self.step)

    @property
    def mask(self) -> Mask:
        """Segmentation, (h, w): `moving` without specks, closed, without what is small."""
        return self._segments[0]

    @property
    def box(self) -> Box | None:
        """Tight box of the largest segment, frame px; None where nothing moves."""
        return self._segments[1]

    @cached_property
    def corners(self) -> NDArray[np.float32]:
        """Corners inside the mask, (N, 2), x and y in frame px, the strongest first."""
        mask = self.mask.astype(np.uint8)
        found = cv2.goodFeaturesToTrack(self.current, MAX_CORNERS, 0.05, 5.0, mask=mask)
        points = np.zeros((0, 2), np.float32) if found is None else found.reshape(-1, 2)
        # A pixel's area begins at its number: its centre is half a pixel further.
        return np.asarray((points + 0.5) * self.step - 0.5, np.float32)

    def _repr_png_(self) -> bytes:
        """All panels, in Jupyter."""
        from .display import draw, png

        return png(draw(self))


class PaperMethod:
    """Carries out the stages on pairs of frames; keeps the memory it works in, so use one per thread.

    Parameters
    ----------
    params : StageParams, optional

    Examples
    --------
    >>> import numpy as np
    >>> frame = np.zeros((48, 64), np.uint8)
    >>> PaperMethod().calc(frame, frame).box is None
    True
    """

    def __init__(self, params: StageParams | None = None) -> None:
        self.params = params if params is not None else StageParams()
        self._flow = HornSchunck(
            self.params.mode, smoothness=self.params.smoothness, iterations=self.params.iterations, gain=1.0
        )

    @fixed_errstate
    def calc(self, prev: Any, curr: Any) -> Stages:
        """The stages from one frame to the next.

        Parameters
        ----------
        prev, curr : ndarray
            Two frames of one size, as TrackerHS takes them.

        Raises
        ------
        InputError
            If a frame cannot be used or the sizes differ.
        """
        return Stages(self.params, self._flow, *as_pair(prev, curr))


def _plane(frame: Frame, size: tuple[int, int], smoothing: float) -> Plane:
    gray = to_gray(crop(frame, 0, 0, frame.width, frame.height))
    if size != (frame.width, frame.height):
        gray = np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.float32)
    return np.asarray(cv2.GaussianBlur(gray, (0, 0), smoothing) if smoothing > 0 else gray, np.float32)


def _segmented(moving: Mask, step: float) -> tuple[Mask, Box | None]:
    """The segments that are large enough, and the box of the largest one, frame px."""
    seeds = cv2.medianBlur(moving.astype(np.uint8), 3)
    closed = cv2.morphologyEx(seeds, cv2.MORPH_CLOSE, cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (9, 9)))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(closed, connectivity=8)
    areas = stats[:, cv2.CC_STAT_AREA].copy()
    areas[0] = 0  # the ground
    areas[areas < max(MIN_AREA * moving.size, 9.0)] = 0
    mask = np.asarray(areas[labels] > 0, bool)
    if not areas.any():
        return mask, None
    x, y, w, h = (float(side) * step for side in stats[int(areas.argmax()), :4])
    return mask, Box(x, y, w, h)
