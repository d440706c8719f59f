"""What the patch tracker carries from frame to frame: parameters, poses, what was learned, the estimate."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..estimate import Estimate
from ..flow.params import Mode
from ..geometry import Box
from ..validation import Count, Shape, Within
from . import tuning
from .finder import Finder, Lattice, lattice_of

__all__ = [
    "Before",
    "Geometry",
    "Model",
    "PatchTrackerEstimate",
    "PatchTrackerParams",
    "PatchTrackerState",
    "Pose",
    "belongs",
    "box_at",
    "geometry_of",
    "halved",
    "jump_from",
]

F32 = NDArray[np.float32]
_Fine = Annotated[F32, Shape("fine h", "fine w")]
_Half = Annotated[F32, Shape("fine h/2", "fine w/2")]


@dataclass(frozen=True)
class PatchTrackerParams:
    """Numbers of the patch tracker.

    Lengths in "samples" are relative to the object, whose box has sides of geometric mean `fine_size` samples in
    the fine patch and `coarse_size` in the coarse window, whatever its size in the frame.

    Parameters
    ----------
    fine_size, fine_margin : float
        Size of the box in the fine patch, and of the margin round it, samples.
    coarse_size, coarse_margin : float
        The same for the coarse window of the correlation filter.
    smoothness : float
        λ of the flow; the patches are normalised to a standard deviation of 32 gray levels.
    preset : str
        Flow preset, see :class:`~hs_tracker_cv.flow.HornSchunck`.
    levels, key_levels, warps : int
        Pyramid levels of the flow between frames and from keyframes, and warps per level.
    rotation : bool
        Follow the object's rotation in the picture too; the box is then the upright one round the turned one.
    max_scale_step, max_key_scale : float
        Largest relative change of size taken from one flow field.
    patch_rate, colour_rate : float
        Share of a good frame in the running means: patch, colours.
    distance_penalty : float
        Taken from the response at one box size from the prediction (grows with the square).
    velocity_rate : float
        Share of the last displacement in the predicted one.
    keys : int
        Largest number of keyframes; the first is never dropped.
    key_gap : int
        Fewest good frames between two new keyframes.
    patience : int
        Frames without good agreement before the object counts as lost; bad ones are bridged by the velocity.
    recentre : float
        Displacement, in box sizes, beyond which the window is looked at again round the peak.
    near, far : float
        Displacements from the prediction, box sizes.
    sure, far_sure, far_match : float
        Chance of being right from which a place is believed and learned; of one farther than `far`, or after a loss,
        and the agreement with some keyframe that it needs too.
    doubt, hopeless, follow : float
        Within `near`, less is followed without being learned; less than `doubt` for `patience` frames only, unless
        the box has kept what was in it and the chance is above `hopeless`; less than `follow` not at all.
    separation : float
        Difference of motion, fine samples per frame, from which object and surroundings are told apart.
    mask_rate : float
        Share of one frame in the memory of which pixels move with the object.
    same, changed : float
        Difference of normalised gray levels up to which a pixel carried by the flow is the same, and from which it
        is another one.
    keep_rate : float
        How fast a pixel that looks as it was learned counts as the object's again.
    coherent : float
        Correlation of successive patches along the flow from which one continues the other; less takes its share
        from what is kept.
    unsure, new_key : float
        Share of the box kept from which a weak peak is still believed to be the object, and from which a new
        keyframe may be added.
    reset_below, reset_match, reset_gain, reset_level : float
        Agreement with the first keyframe below which other sizes are tried, one per frame; the agreement that one
        of them must have, and by how much it must be the better one; and the share of the peak that must be left.
    """

    fine_size: float = 32.0
    fine_margin: float = 9.6
    coarse_size: float = 16.0
    coarse_margin: float = 16.0
    smoothness: float = 6.0
    preset: Mode = "fast"
    levels: int = 4
    key_levels: int = 3
    warps: int = 2
    rotation: bool = False
    max_scale_step: float = 0.03
    max_key_scale: float = 0.1
    patch_rate: float = 0.03
    colour_rate: float = 0.05
    distance_penalty: float = 0.15
    velocity_rate: float = 0.5
    keys: int = 4
    key_gap: int = 8
    patience: int = 3
    recentre: float = 0.5
    near: float = 0.35
    far: float = 0.6
    sure: float = 0.35
    far_sure: float = 0.5
    far_match: float = 0.3
    doubt: float = 0.25
    hopeless: float = 0.15
    follow: float = 0.05
    separation: float = 0.3
    mask_rate: float = 0.1
    same: float = 16.0
    changed: float = 40.0
    keep_rate: float = 0.2
    coherent: float = 0.6
    unsure: float = 0.5
    new_key: float = 0.8
    reset_below: float = 0.6
    reset_match: float = 0.7
    reset_gain: float = 0.15
    reset_level: float = 0.6


class Pose(NamedTuple):
    """Where the box is: centre in pixel-index coordinates, size relative to the first box, turn in radians."""

    cx: float
    cy: float
    sx: Annotated[float, Within(1e-4, 1e4)]
    sy: Annotated[float, Within(1e-4, 1e4)]
    angle: float = 0.0

    def moved(self, dx: float, dy: float) -> Pose:
        """Return the pose translated by (dx, dy) px."""
        return Pose(self.cx + dx, self.cy + dy, self.sx, self.sy, self.angle)

    def scaled(self, factor: float) -> Pose:
        """Return the pose with its size multiplied."""
        return Pose(self.cx, self.cy, self.sx * factor, self.sy * factor, self.angle)

    def turned(self, angle: float) -> Pose:
        """Return the pose turned by an angle, radians from x towards y."""
        return Pose(self.cx, self.cy, self.sx, self.sy, self.angle + angle)

    def shifted(self, right: float, down: float) -> Pose:
        """Return the pose translated along its own axes, px."""
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        return self.moved(cosine * right - sine * down, sine * right + cosine * down)

    def offset(self, other: Pose) -> tuple[float, float]:
        """Return where the centre of another pose is, along the axes of this one, px."""
        dx, dy = other.cx - self.cx, other.cy - self.cy
        cosine, sine = math.cos(self.angle), math.sin(self.angle)
        return cosine * dx + sine * dy, cosine * dy - sine * dx


class Geometry(NamedTuple):
    """What depends on the first box only: sampling steps, patch sizes and weights."""

    w: Annotated[float, Within(1.0, 2**20)]
    h: Annotated[float, Within(1.0, 2**20)]
    fine_step: float
    coarse_step: float
    inner: _Fine
    weights: _Fine
    outside: _Fine
    body: _Half
    body_weights: _Half
    inside: Annotated[NDArray[np.uint8], Shape("coarse h", "coarse w")]
    lattice: Lattice

    @property
    def colours(self) -> tuple[int, int]:
        """How many samples of the coarse window, in its middle, the fine patch covers, and a ring of two."""
        ratio, (rows, columns) = self.fine_step / self.coarse_step, self.inside.shape
        # Even numbers like the window's own, so that they are the same samples.
        down, across = (2 * math.ceil(((side - 1) * ratio + 4) / 2) for side in self.weights.shape)
        return min(down, rows), min(across, columns)


class Before(NamedTuple):
    """Part of the frame before round the object.

    Parameters
    ----------
    gray : ndarray, shape (H, W, 1), float32
        0–255.
    left, top : int
        Where it was cut, in pixels of the thinned frame.
    thin : int
        Every so many rows and columns of the frame were kept.
    """

    gray: Annotated[F32, Shape("part h", "part w", 1)]
    left: int
    top: int
    thin: Annotated[int, Within(1, 2**20)]


@dataclass(frozen=True, kw_only=True)
class PatchTrackerEstimate(Estimate):
    """What one frame said; the box is the last believed one while the object is lost.

    Parameters
    ----------
    previous, current : ndarray, shape (h, w), float32
        Under the object of mean 0 and deviation 32.
    angle : float
        Turn of the object since the start, radians from x towards y; 0 unless asked for.
    peak : float
        Height of the correlation filter's peak.
    response : ndarray, shape (40, 40), float32
        Response of the correlation filter.
    agreement : float
        Correlation with the mean patch, −1 to 1.
    keys : tuple of float
        Correlation with each keyframe; the first is the first frame.
    persistence : float
        Share of the box that shows what it showed when it was last believed, 0–1.
    verdict : str
        "good": followed and learned. "unsure": it looks different, but what was in the box goes on there; followed,
        not learned. "weak": followed, and about to be lost. "bad": not believed.
    """

    occluded: bool = False
    previous: _Fine
    current: _Fine
    flow: Annotated[F32, Shape("fine h", "fine w", 2)]
    mask: None = None
    angle: float
    peak: float
    response: Annotated[F32, Shape(40, 40)]
    agreement: float
    keys: tuple[float, ...]
    persistence: float
    verdict: str

    @property
    def grays(self) -> tuple[F32, F32]:
        """`previous` and `current` as gray levels, 0–255."""
        previous, current = (np.clip(patch + 128.0, 0.0, 255.0) for patch in (self.previous, self.current))
        return previous, current


class Model(NamedTuple):
    """What was learned about the object: patches, keyframes, colours, correlation filter.

    Parameters
    ----------
    previous : ndarray, shape (h, w), float32
        Last fine patch.
    means : ndarray, shape (4, h, w), float32
        Mean patch; mean absolute deviation from it; share of frames in which a pixel moves with the object; prior
        weight of each pixel in the fit of the flow, which follows from the last two.
    keys : ndarray, shape (n, h, w), float32
        Keyframes, the first frame's first.
    key_age : int
        Good frames since the last one was added.
    histograms : ndarray, shape (2, bins), float32, or None
        Shares of the bins inside and outside the box; None where colours do not tell.
    located : Finder
    """

    previous: _Fine
    means: Annotated[F32, Shape(4, "fine h", "fine w")]
    keys: Annotated[F32, Shape("keys", "fine h", "fine w")]
    key_age: Count
    histograms: Annotated[F32, Shape(2, "bins")] | None
    located: Finder

    @property
    def templates(self) -> F32:
        """What a patch is compared with, (1 + n, h, w): the mean patch and the keyframes."""
        return np.concatenate((self.means[:1], self.keys))


class PatchTrackerState(NamedTuple):
    """Everything carried from frame to frame; immutable, picklable. `hint` is where a lost object was likeliest."""

    geometry: Geometry
    pose: Pose
    velocity: tuple[float, float]
    model: Model
    peak: float
    good_frames: Count
    low: Count
    persistence: _Half
    hint: Pose | None
    before: Before
    estimate: PatchTrackerEstimate


def geometry_of(box: Box, p: PatchTrackerParams) -> Geometry:
    """Sampling steps, sizes and weights of the patches for a first box, frame px."""
    side = math.sqrt(box.w * box.h)
    fine_step, coarse_step = side / p.fine_size, side / p.coarse_size
    # A box as thin as a line is taken to be two samples wide: otherwise none would lie in its middle.
    nw, nh = max(box.w / fine_step, 2.0), max(box.h / fine_step, 2.0)
    fw, fh = (2 * round((n + 2 * p.fine_margin) / 2) for n in (nw, nh))
    y, x = np.mgrid[:fh, :fw].astype(np.float32)
    x, y = (x - (fw - 1) / 2) / (nw / 2), (y - (fh - 1) / 2) / (nh / 2)
    square = x * x + y * y
    weights = np.exp(-((square / tuning.BODY**2) ** 2))
    inner = np.exp(-((square / tuning.BODY_INNER**2) ** 2))
    inner /= inner.sum()
    outside = np.maximum(np.abs(x), np.abs(y)) > tuning.BEYOND
    cw, ch = (cv2.getOptimalDFTSize(round(n / coarse_step / 2 + p.coarse_margin)) * 2 for n in (box.w, box.h))
    y, x = np.mgrid[:ch, :cw].astype(np.float32)
    x, y = x * (coarse_step / box.w), y * (coarse_step / box.h)
    inside = (np.abs(x - x[0, -1] / 2) < tuning.MIDDLE) & (np.abs(y - y[-1, 0] / 2) < tuning.MIDDLE)
    return Geometry(
        box.w, box.h, fine_step, coarse_step, inner.astype(np.float32), weights.astype(np.float32),
        outside.astype(np.float32), halved((square < tuning.KEPT_BODY).astype(np.float32)),
        np.float32(4.0) * halved(inner.astype(np.float32)), inside.astype(np.uint8), lattice_of(box.w, box.h),
    )  # fmt: skip


def belongs(state: PatchTrackerState, width: int, height: int, p: PatchTrackerParams) -> bool:
    """Tell whether a state that comes from elsewhere can be one of frames of that size, px.

    Its geometry follows from its first box; and windows of objects far larger than the frame would fill the memory.
    """
    g, poses = state.geometry, [pose for pose in (state.pose, state.hint) if pose]
    if max(max(g.w * pose.sx, g.h * pose.sy) for pose in poses) > tuning.LARGEST * max(width, height):
        return False
    own = geometry_of(Box(0.0, 0.0, g.w, g.h), p)
    pairs = zip((*g[:-1], *g.lattice), (*own[:-1], *own.lattice), strict=True)
    return all(np.array_equal(np.asarray(one), np.asarray(other)) for one, other in pairs)


def halved(plane: F32) -> F32:
    """Mean of 2 × 2 samples."""
    rows = plane[::2] + plane[1::2]
    return np.asarray((rows[:, ::2] + rows[:, 1::2]) * np.float32(0.25), np.float32)


def box_at(g: Geometry, pose: Pose) -> Box:
    """Upright box round an object at a pose, frame px."""
    width, height = g.w * pose.sx, g.h * pose.sy
    cosine, sine = abs(math.cos(pose.angle)), abs(math.sin(pose.angle))
    return Box.from_centre(
        pose.cx + 0.5, pose.cy + 0.5, cosine * width + sine * height, cosine * height + sine * width
    )


def jump_from(g: Geometry, pose: Pose, expected: Pose) -> float:
    """Distance from the prediction, box sizes."""
    return math.hypot(pose.cx - expected.cx, pose.cy - expected.cy) / math.sqrt(g.w * g.h * expected.sx * expected.sy)
