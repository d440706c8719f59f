"""The box carried by the dense flow inside it: for parts, stops and moving cameras.

Each frame, in patches resampled round the box so that the object always has the same size in samples:

1. *Find*: a correlation filter on a wide, coarse window says where the object's surroundings are.
2. *Carry*: the Horn–Schunck flow between the previous and the present fine patch, fitted robustly by a
   translation and a scale, moves and resizes the box.
3. *Hold*: the flow from stored keyframes to the present patch takes out the drift of summed increments.
4. *Judge*: agreement with what was learned decides whether to follow, to learn, to coast or to search.
5. *Keep*: the flow also says how much of what was in the box is still in it. A target that turns looks like nothing
   that was learned, but its surface goes on in the box; one that is hidden is replaced by what comes from outside.

All functions are pure: a state goes in, a new one comes out, and no array of the old one is written to.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from . import anchor, patches
from .flow import HornSchunck
from .frames import Frame, crop, to_gray
from .geometry import Box

__all__ = ["PropagationParams", "PropagationReport", "PropagationState", "ride", "start", "step"]

F32 = NDArray[np.float32]

_COLOUR_THRESHOLD = 2.0
_CONTRAST = 32.0
_MASK_FLOOR = 0.15
_KEY_MATCH = 0.7
_MIN_SIDE = 6.0
_CLEARLY = 0.1
_RIDE_RATE = 0.03
_LOOKS, _PLACES = 8, 200
_ZOOMS = (0.67, 0.75, 0.87, 1.0, 1.15, 1.33, 1.5, 1.7)
_GOOD, _UNSURE, _WEAK, _BAD = "good", "unsure", "weak", "bad"


@dataclass(frozen=True)
class PropagationParams:
    """Numbers of the propagation mode.

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
    max_scale_step, max_key_scale : float
        Largest relative change of size taken from one flow field.
    patch_rate, colour_rate, filter_rate : float
        Share of a good frame in the running means: patch, colours, correlation filter.
    filter_sigma : float
        Width of the filter's wanted response, coarse samples.
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
    confidence : float
        Least sum of peak height and agreement with the first keyframe that is believed.
    weak : float
        A peak lower than this share of its running mean makes the search look around.
    recentre : float
        Displacement, in coarse samples, beyond which the window is looked at again round the peak.
    far, found, far_level, far_match : float
        A displacement from the prediction over `far` box sizes, and what a lost object is found again by, needs a
        peak of `found` that is `far_level` of its running mean, and agreement `far_match` with some keyframe.
    near, near_level, follow_level : float
        Any other needs `near_level`; within `near` box sizes, `follow_level` is enough to follow without learning.
    drop, match_rate, doubt : float
        Agreement with the best keyframe under `drop` of its running mean (rate `match_rate`) is not learned, unless
        the sum of peak height and agreement with the first keyframe is over `doubt`.
    present : float
        Share of its running mean that the peak keeps, times the share of the object's colours that the box keeps,
        from which an object within `near` box sizes is followed although it looks like nothing that was learned.
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
    preset: str = "fast"
    levels: int = 4
    key_levels: int = 3
    warps: int = 2
    max_scale_step: float = 0.03
    max_key_scale: float = 0.1
    patch_rate: float = 0.03
    colour_rate: float = 0.05
    filter_rate: float = 0.06
    filter_sigma: float = 1.6
    distance_penalty: float = 0.15
    velocity_rate: float = 0.5
    keys: int = 4
    key_gap: int = 8
    patience: int = 3
    confidence: float = 0.36
    weak: float = 0.42
    recentre: float = 4.0
    far: float = 0.6
    far_level: float = 0.55
    far_match: float = 0.5
    found: float = 0.25
    near: float = 0.35
    near_level: float = 0.38
    follow_level: float = 0.33
    drop: float = 0.55
    doubt: float = 0.72
    match_rate: float = 0.1
    present: float = 0.35
    separation: float = 0.3
    mask_rate: float = 0.1
    same: float = 16.0
    changed: float = 40.0
    keep_rate: float = 0.2
    coherent: float = 0.6
    unsure: float = 0.3
    new_key: float = 0.8
    reset_below: float = 0.6
    reset_match: float = 0.7
    reset_gain: float = 0.15
    reset_level: float = 0.8


@dataclass(frozen=True)
class Pose:
    """Where the box is: centre in pixel-index coordinates, and size relative to the first box."""

    cx: float
    cy: float
    sx: float
    sy: float

    def moved(self, dx: float, dy: float) -> Pose:
        """Return the pose translated by (dx, dy) px."""
        return Pose(self.cx + dx, self.cy + dy, self.sx, self.sy)

    def scaled(self, factor: float) -> Pose:
        """Return the pose with its size multiplied."""
        return Pose(self.cx, self.cy, self.sx * factor, self.sy * factor)


@dataclass(frozen=True)
class _Geometry:
    """What depends on the first box only: sampling steps, patch sizes and weights."""

    w: float
    h: float
    fine_step: float
    coarse_step: float
    inner: F32
    weights: F32
    outside: F32
    body: F32
    body_weights: F32
    window: F32
    inside: NDArray[np.bool_]
    across: F32
    down: F32


@dataclass(frozen=True)
class PropagationReport:
    """What one frame said.

    Parameters
    ----------
    box : Box
        Sub-pixel, frame px; the last believed one while lost.
    ok : bool
        The object was located.
    score : float
        Chance that the box overlaps the object by more than half, 0–1.
    lost : bool
        Searching.
    origin : tuple of float
        Top-left of the window, frame px.
    step : tuple of float
        Frame px per window pixel, across and down.
    previous, current : ndarray, shape (h, w), float32
        Windows the flow was computed on: gray, under the object of mean 0 and deviation 32.
    flow : ndarray, shape (h, w, 2), float32
        Window px per frame.
    peak : float
        Height of the correlation filter's peak.
    response : ndarray, shape (rows, columns), float32
        Response of the correlation filter.
    agreement : float
        Correlation with the mean patch, −1 to 1.
    keys : tuple of float
        Correlation with each keyframe; the first is the first frame.
    kept : float
        Share of the box that shows what it showed when it was last believed, 0–1.
    verdict : str
        "good": followed and learned. "unsure": it looks different, but what was in the box goes on there; followed,
        not learned. "weak": followed, and about to be lost. "bad": not believed.
    """

    box: Box
    ok: bool
    score: float
    lost: bool
    origin: tuple[float, float]
    step: tuple[float, float]
    previous: F32
    current: F32
    flow: F32
    peak: float
    response: F32
    agreement: float
    keys: tuple[float, ...]
    kept: float
    verdict: str


@dataclass(frozen=True)
class _Model:
    """What was learned about the object: patches, keyframes, colours, correlation filter."""

    previous: F32
    mean: F32
    deviation: F32
    mask: F32
    keys: tuple[F32, ...]
    key_age: int
    histograms: F32 | None
    likelihood: F32 | None
    located: anchor.CorrelationFilter


@dataclass(frozen=True)
class PropagationState:
    """Everything carried from frame to frame; immutable, picklable."""

    geometry: _Geometry
    pose: Pose
    velocity: tuple[float, float]
    model: _Model
    peak: float
    match: float
    colour: float
    good_frames: int
    low: int
    kept: F32
    report: PropagationReport


class _View:
    """The part of a frame round the object, cut once and sampled often."""

    def __init__(self, frame: Frame, geometry: _Geometry, pose: Pose) -> None:
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
        gray = self._sample(pose, g.fine_step, *g.weights.shape, gray=True)[:, :, 0]
        gray = np.asarray(cv2.GaussianBlur(gray, (3, 3), 0.7), np.float32)
        mean = float(np.vdot(g.inner, gray))
        gray -= np.float32(mean)
        deviation = math.sqrt(max(float(np.vdot(g.inner, gray * gray)), 0.0))
        gray *= np.float32(_CONTRAST / (deviation + 4.0))
        self._seen[pose] = gray
        return gray

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
        patches.sample(
            source, pose.cx / t - self._left, pose.cy / t - self._top, unit * pose.sx / t, unit * pose.sy / t, out
        )
        return out

    def _cut(self, pose: Pose, unit: float, rows: int, columns: int) -> None:
        t = self._thin
        x, y = pose.cx / t, pose.cy / t
        half_x, half_y = unit * pose.sx * columns / 2 / t + 4, unit * pose.sy * rows / 2 / t + 4
        inside = x - half_x >= self._left and x + half_x <= self._right
        if inside and y - half_y >= self._top and y + half_y <= self._bottom:
            return
        # Room for the pose to move in before all has to be cut again.
        half_x, half_y = 1.1 * half_x, 1.1 * half_y
        left, right, top, bottom = int(x - half_x), int(x + half_x) + 1, int(y - half_y), int(y + half_y) + 1
        self._left, self._top, self._right, self._bottom = left, top, right, bottom
        self._colour = crop(self._frame, left, top, right - left, bottom - top)
        self._gray = to_gray(self._colour)[:, :, None]


_local = threading.local()


def _flow(a: F32, b: F32, params: PropagationParams, levels: int) -> F32:
    """Flow a → b by a solver of this thread; its workspace must not travel with the state."""
    solvers = _local.__dict__.setdefault("solvers", {})
    key = (params.preset, params.smoothness, levels, params.warps)
    if key not in solvers:
        solvers[key] = HornSchunck(params.preset, smoothness=params.smoothness, levels=levels, warps=params.warps)
    flow: F32 = solvers[key].calc(a, b, None)
    return flow


def _geometry(box: Box, p: PropagationParams) -> _Geometry:
    side = math.sqrt(box.w * box.h)
    fine_step, coarse_step = side / p.fine_size, side / p.coarse_size
    nw, nh = box.w / fine_step, box.h / fine_step
    fw, fh = (2 * round((n + 2 * p.fine_margin) / 2) for n in (nw, nh))
    y, x = np.mgrid[:fh, :fw].astype(np.float32)
    x, y = (x - (fw - 1) / 2) / (nw / 2), (y - (fh - 1) / 2) / (nh / 2)
    square = x * x + y * y
    weights = np.exp(-((square / 0.9**2) ** 2))
    inner = np.exp(-((square / 0.85**2) ** 2))
    inner /= inner.sum()
    outside = np.maximum(np.abs(x), np.abs(y)) > 1.1
    cw, ch = (cv2.getOptimalDFTSize(round(n / coarse_step / 2 + p.coarse_margin)) * 2 for n in (box.w, box.h))
    y, x = np.mgrid[:ch, :cw].astype(np.float32)
    x, y = x * (coarse_step / box.w), y * (coarse_step / box.h)
    across, down = x - x[0, cw // 2], y - y[ch // 2, 0]
    inside = (np.abs(x - x[0, -1] / 2) < 0.45) & (np.abs(y - y[-1, 0] / 2) < 0.45)
    return _Geometry(
        box.w, box.h, fine_step, coarse_step, inner.astype(np.float32), weights.astype(np.float32),
        outside.astype(np.float32), _halved((square < 1.2).astype(np.float32)),
        np.float32(4.0) * _halved(inner.astype(np.float32)), anchor.hann(ch, cw), inside, across, down,
    )  # fmt: skip


def _halved(plane: F32) -> F32:
    """Mean of 2 × 2 samples."""
    rows = plane[::2] + plane[1::2]
    return np.asarray((rows[:, ::2] + rows[:, 1::2]) * np.float32(0.25), np.float32)


def _bins(raw: F32) -> NDArray[np.int32]:
    if raw.shape[2] == 1:
        return np.minimum((raw[:, :, 0] * np.float32(1 / 4)).astype(np.int32), 63)
    level = np.minimum(raw.astype(np.int32) >> 4, 15)
    return np.asarray((level[:, :, 0] << 8) + (level[:, :, 1] << 4) + level[:, :, 2], np.int32)


def _histograms(raw: F32, inside: NDArray[np.bool_]) -> F32:
    bins = _bins(raw)
    count = 64 if raw.shape[2] == 1 else 4096
    both = np.stack([np.bincount(bins[m], minlength=count) for m in (inside, ~inside)]).astype(np.float32)
    if raw.shape[2] == 1:
        both = np.asarray(cv2.GaussianBlur(both, (7, 1), 1.5), np.float32)
    return np.asarray(both / np.maximum(both.sum(axis=1, keepdims=True), 1.0), np.float32)


def _likelihood(histograms: F32) -> F32:
    share: F32 = (histograms[0] + np.float32(1e-4)) / (histograms[0] + histograms[1] + np.float32(2e-4))
    return share


def _foreground(raw: F32, likelihood: F32) -> F32:
    return np.asarray(cv2.blur(likelihood.take(_bins(raw)), (3, 3)), np.float32)


def _channels(view: _View, pose: Pose, raw: F32, likelihood: F32 | None, g: _Geometry) -> F32:
    foreground = None if likelihood is None else _foreground(raw, likelihood)
    return anchor.features(view.context(pose), foreground, g.window)


def _box(g: _Geometry, pose: Pose) -> Box:
    return Box.from_centre(pose.cx + 0.5, pose.cy + 0.5, g.w * pose.sx, g.h * pose.sy)


def start(frame: Frame, box: Box, params: PropagationParams) -> PropagationState:
    """Learn the object in `box`.

    Parameters
    ----------
    frame : Frame
    box : Box
        Frame px.
    params : PropagationParams

    Returns
    -------
    PropagationState
    """
    g = _geometry(box, params)
    pose = Pose(box.x + box.w / 2 - 0.5, box.y + box.h / 2 - 0.5, 1.0, 1.0)
    view = _View(frame, g, pose)
    model = _first_model(view, g, pose, params)
    patch = model.previous
    report = PropagationReport(
        box, True, 1.0, False, *_window(g, pose), patch, patch, np.zeros((*patch.shape, 2), np.float32), 1.0,
        np.zeros_like(g.window), 1.0, (1.0,), 1.0, _GOOD,
    )  # fmt: skip
    return PropagationState(
        g, pose, (0.0, 0.0), model, 1.0, 1.0, _first_colour(view, pose, model, g), 1, 0, g.body, report
    )


def _window(g: _Geometry, pose: Pose) -> tuple[tuple[float, float], tuple[float, float]]:
    """Origin and step of the fine patch at a pose."""
    rows, columns = g.weights.shape
    across, down = g.fine_step * pose.sx, g.fine_step * pose.sy
    return (pose.cx + 0.5 - 0.5 * columns * across, pose.cy + 0.5 - 0.5 * rows * down), (across, down)


def _first_colour(view: _View, pose: Pose, model: _Model, g: _Geometry) -> float:
    if model.likelihood is None:
        return 1.0
    likelihood = _foreground(view.coarse(pose), model.likelihood)
    found = _Found(0.0, pose, 0.0, likelihood, pose, likelihood)
    fine = _finer(found, g)
    return 1.0 if fine is None else float(np.vdot(g.inner, fine))


def _first_model(view: _View, g: _Geometry, pose: Pose, p: PropagationParams) -> _Model:
    fine, raw = view.fine(pose), view.coarse(pose)
    histograms = likelihood = None
    if raw.shape[2] == 1 or float(np.abs(raw[:, :, 0] - raw[:, :, 2]).mean()) > _COLOUR_THRESHOLD:
        histograms = _histograms(raw, g.inside)
        likelihood = _likelihood(histograms)
    located = anchor.train(_channels(view, pose, raw, likelihood, g), p.filter_sigma)
    return _Model(fine, fine, np.zeros_like(fine), np.ones_like(fine), (fine,), 0, histograms, likelihood, located)


def step(state: PropagationState, frame: Frame, params: PropagationParams) -> PropagationState:
    """Follow the object into the next frame.

    Parameters
    ----------
    state : PropagationState
        Not changed.
    frame : Frame
    params : PropagationParams

    Returns
    -------
    PropagationState
        Its `report` holds the box.
    """
    g, expected = state.geometry, state.pose.moved(*state.velocity)
    view = _View(frame, g, expected)
    found = _find(state, view, expected, params)
    carried = _carry(state, view, found, params)
    pose, keys = _hold(state, view, frame, carried, found.height, params)
    verdict = _judge(state, frame, pose, expected, found.height, keys, carried.colour, params)
    kept, coarse, leap = state.kept, found.pose, _jump(g, pose, expected) > params.far
    tracking = state.low <= params.patience
    if tracking and (leap or verdict != _GOOD):
        stayed, coherence, kept = _continue(state, view, expected, params)
        if _kept_share(kept, g) > params.unsure:
            # What goes on in the box has not leapt out of it.
            if leap and coherence > _coherence(state, view.fine(pose)) + _CLEARLY:
                verdict, coarse = _UNSURE, stayed.pose
            elif verdict == _WEAK:
                verdict = _UNSURE
    if verdict == _GOOD:
        kept = g.body if leap or not tracking else _refreshed(state, view, carried, found.pose, pose, params)
    pose, velocity, low = _settle(state, pose, coarse, verdict, params)
    lost, share = low > params.patience, _kept_share(kept, g)
    model = state.model if lost and verdict == _BAD else replace(state.model, previous=view.fine(pose))
    peak, match, colour, good_frames = state.peak, state.match, state.colour, state.good_frames
    if verdict == _GOOD:
        model = _learn(model, view, g, pose, carried, max(keys), share, params)
        match += params.match_rate * (max(keys) - match)
        colour += params.match_rate * (carried.colour - colour)
        good_frames += 1
        peak += max(0.05, 1.0 / good_frames) * (found.height - peak)
    report = PropagationReport(
        _box(g, pose), not lost, _score(found.height + keys[0], share), lost, *_window(g, found.pose),
        state.model.previous, carried.seen_at_start, carried.flow, found.height, found.response, carried.agreement,
        tuple(keys), share, verdict,
    )  # fmt: skip
    return PropagationState(g, pose, velocity, model, peak, match, colour, good_frames, low, kept, report)


@dataclass(frozen=True)
class _Found:
    """Answer of the correlation filter: `value` is its height less the distance penalty."""

    value: float
    pose: Pose
    height: float
    response: F32
    window: Pose
    likelihood: F32 | None


def _look(state: PropagationState, view: _View, at: Pose, expected: Pose, penalty: float) -> _Found:
    """Best place in the window at a pose."""
    g = state.geometry
    raw, likelihood = view.coarse(at), None
    if state.model.likelihood is not None:
        likelihood = _foreground(raw, state.model.likelihood)
    response = anchor.respond(state.model.located, anchor.features(view.context(at), likelihood, g.window))
    across = g.across + np.float32((at.cx - expected.cx) / (g.w * expected.sx))
    down = g.down + np.float32((at.cy - expected.cy) / (g.h * expected.sy))
    fade: F32 = np.float32(penalty) * (across * across + down * down)
    top = anchor.find_peak(response - fade)
    rows, columns = response.shape
    row, column = min(round(top.dy) + rows // 2, rows - 1), min(round(top.dx) + columns // 2, columns - 1)
    pose = at.moved(top.dx * g.coarse_step * at.sx, top.dy * g.coarse_step * at.sy)
    return _Found(top.height, pose, float(response[row, column]), response, at, likelihood)


def _find(state: PropagationState, view: _View, expected: Pose, p: PropagationParams) -> _Found:
    g = state.geometry
    penalty = p.distance_penalty / (1.0 + 0.5 * state.low)
    best = _look(state, view, expected, expected, penalty)
    if best.height < p.weak * state.peak:
        lost = state.low - p.patience
        for at in _elsewhere(state.pose, g, view, lost):
            # Nothing is known of where a lost object is, so that no place is worth less than another.
            best = max(best, _look(state, view, at, at if lost > 0 else expected, penalty), key=lambda f: f.value)
    moved = math.hypot(best.pose.cx - expected.cx, best.pose.cy - expected.cy)
    if moved > p.recentre * g.coarse_step * expected.sx:
        # The window fades what is far from its centre: only a second look says how high the peak really is.
        best = _look(state, view, best.pose, best.pose if state.low > p.patience else expected, penalty)
    return best


def _elsewhere(pose: Pose, g: _Geometry, view: _View, lost: int) -> list[Pose]:
    """Where else to look: all round the last pose; once lost, at a few more places in each frame, near ones first.

    The places are a box apart and cover the frame, or of a large one the part round the last pose; then from the
    beginning again.
    """
    width, height = g.w * pose.sx, g.h * pose.sy
    if lost <= 0:
        steps = [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, 1), (1, -1), (-1, 1)]
    else:
        frame_width, frame_height = view.size
        places = _places(
            *(max(0, int(room)) for room in (pose.cx / width, (frame_width - pose.cx) / width)),
            *(max(0, int(room)) for room in (pose.cy / height, (frame_height - pose.cy) / height)),
        )
        first = _LOOKS * (lost - 1)
        steps = [places[i % len(places)] for i in range(first, first + min(_LOOKS, len(places)))]
    found = (pose.moved(across * width, down * height) for across, down in steps)
    return [at for at in found if view.contains(at)]


@lru_cache(maxsize=64)
def _places(left: int, right: int, up: int, down: int) -> list[tuple[int, int]]:
    """Steps to the nearest of all places that so many steps reach, the nearest first."""
    # No farther than the nearest can lie: a small object in a large frame has a hundred thousand places.
    reach = 16 + _PLACES // min(left + right + 1, up + down + 1)
    left, right, up, down = (min(room, reach) for room in (left, right, up, down))
    steps = [(x, y) for y in range(-up, down + 1) for x in range(-left, right + 1) if (x, y) != (0, 0)]
    return sorted(steps, key=lambda step: step[0] ** 2 + step[1] ** 2)[:_PLACES]


def _fit(flow: F32, weight: F32) -> NDArray[np.float64]:
    motion = np.empty(6)
    patches.fit_motion(flow, weight, motion)
    return motion


def _register(
    key: F32, current: F32, prior: F32, p: PropagationParams, levels: int
) -> tuple[F32, F32, NDArray[np.float64]]:
    """Flow key → current, the weight of each pixel and the motion fitted to it."""
    flow, weight = _flow(key, current, p, levels), np.empty_like(prior)
    patches.residual_weights(key, current, flow, prior, weight)
    return flow, weight, _fit(flow, weight)


def _applied(pose: Pose, motion: NDArray[np.float64], g: _Geometry, limit: float) -> Pose:
    moved = pose.moved(g.fine_step * pose.sx * float(motion[0]), g.fine_step * pose.sy * float(motion[1]))
    return moved.scaled(1.0 + min(max(float(motion[4]), -limit), limit))


def _separate(
    previous: F32,
    current: F32,
    flow: F32,
    weight: F32,
    motion: NDArray[np.float64],
    g: _Geometry,
    p: PropagationParams,
) -> tuple[NDArray[np.float64], F32 | None]:
    """Fit the object's motion again without the pixels that move with the surroundings.

    Returns
    -------
    motion : ndarray, shape (6,)
    belongs : ndarray, shape (h, w), float32, or None
        Share of "moves with the object" per pixel; None where the two motions cannot be told apart.
    """
    around, square = np.empty_like(weight), np.empty_like(weight)
    patches.residual_weights(previous, current, flow, g.outside, around)
    if float(around.sum()) < 10.0:
        return motion, None
    background = _fit(flow, around)
    patches.misfit(flow, background, square)
    spread = 0.25 + 1.5 * float(background[5])
    apart = weight * (np.float32(1.0) - np.exp(square * np.float32(-0.5 / spread**2)))
    if float(apart.sum()) < 0.25 * float(weight.sum()) + 1e-3:
        return motion, None
    motion = _fit(flow, apart)
    if math.hypot(motion[0] - background[0], motion[1] - background[1]) < p.separation:
        return motion, None
    own = np.empty_like(weight)
    patches.misfit(flow, motion, own)
    return motion, square / (square + own + np.float32(0.02))


@dataclass(frozen=True)
class _Carried:
    """Answer of the flow between frames: pose, what is seen there, and how well it agrees with the mean patch."""

    pose: Pose
    current: F32
    agreement: float
    prior: F32
    flow: F32
    weight: F32
    belongs: F32 | None
    seen_at_start: F32
    colour: float  # mean likelihood of the object's colours in the box; 1 where there are none


def _finer(found: _Found, g: _Geometry) -> F32 | None:
    """Colour likelihood on the lattice of the fine patch at the pose found, read from the coarse window."""
    if found.likelihood is None:
        return None
    rows, columns = found.likelihood.shape
    x = (found.pose.cx - found.window.cx) / (g.coarse_step * found.window.sx) + 0.5 * (columns - 1)
    y = (found.pose.cy - found.window.cy) / (g.coarse_step * found.window.sy) + 0.5 * (rows - 1)
    out = np.empty((*g.weights.shape, 1), np.float32)
    ratio = g.fine_step / g.coarse_step
    patches.sample(found.likelihood[:, :, None], x, y, ratio, ratio, out)
    return out[:, :, 0]


def _carry(state: PropagationState, view: _View, found: _Found, p: PropagationParams) -> _Carried:
    g, model, coarse = state.geometry, state.model, found.pose
    current = view.fine(coarse)
    prior = g.weights * (np.float32(_MASK_FLOOR) + model.mask)
    prior /= np.float32(1.0) + (model.deviation * np.float32(0.1)) ** 2
    likelihood, colour = _finer(found, g), 1.0
    if likelihood is not None:
        prior *= np.float32(0.1) + likelihood
        colour = float(np.vdot(g.inner, likelihood))
    flow, weight, motion = _register(model.previous, current, prior, p, p.levels)
    motion, belongs = _separate(model.previous, current, flow, weight, motion, g, p)
    fine = _applied(coarse, motion, g, p.max_scale_step)
    patch = view.fine(fine)
    before = anchor.correlation(current, model.mean, g.inner)
    agreement = anchor.correlation(patch, model.mean, g.inner)
    if agreement < before - 0.02:
        return _Carried(coarse, current, before, prior, flow, weight, belongs, current, colour)
    trust = min(max((agreement - 0.3) / 0.4, 0.0), 1.0)
    fine = replace(fine, cx=coarse.cx + trust * (fine.cx - coarse.cx), cy=coarse.cy + trust * (fine.cy - coarse.cy))
    return _Carried(fine, patch, agreement, prior, flow, weight, belongs, current, colour)


def _continue(
    state: PropagationState, view: _View, expected: Pose, p: PropagationParams
) -> tuple[_Carried, float, F32]:
    """Where the content of the box went, how well that can be followed, and how much of it is kept there.

    Neither filter nor keyframes are asked: what they were taught is not what is seen.
    """
    g, model = state.geometry, state.model
    current = view.fine(expected)
    prior = g.weights * (np.float32(_MASK_FLOOR) + model.mask) * _body(state)
    flow, weight, motion = _register(model.previous, current, prior, p, p.levels)
    motion, belongs = _separate(model.previous, current, flow, weight, motion, g, p)
    pose = _applied(expected, motion, g, 0.0)
    patch = view.fine(pose)
    before, coherence = _coherence(state, current), _coherence(state, patch)
    if coherence < before - 0.02:
        pose, patch, coherence = expected, current, before
    carried = _Carried(
        pose, patch, anchor.correlation(patch, model.mean, g.inner), prior, flow, weight, belongs, current, 1.0
    )
    kept = _carried_along(state, carried, expected, pose, _halved(patch), p)
    return carried, coherence, kept * np.float32(min(max(1.5 * coherence / p.coherent - 0.5, 0.0), 1.0))


def _body(state: PropagationState) -> F32:
    """Weights of what is kept, on the lattice of the fine patch."""
    return np.asarray(np.float32(0.1) + state.kept.repeat(2, 0).repeat(2, 1), np.float32)


def _coherence(state: PropagationState, patch: F32) -> float:
    """How well a patch continues the last one."""
    return anchor.correlation(patch, state.model.previous, state.geometry.inner * _body(state))


def _refreshed(
    state: PropagationState, view: _View, carried: _Carried, coarse: Pose, pose: Pose, p: PropagationParams
) -> F32:
    """What is kept at a pose that is believed: more, where it looks as it was learned."""
    g, model = state.geometry, state.model
    now = _halved(view.fine(pose))
    kept = _carried_along(state, carried, coarse, pose, now, p)
    error = (now - _halved(model.mean)) / (np.float32(10.0) + _halved(model.deviation))
    return np.asarray(kept + np.float32(p.keep_rate) * np.exp(-error * error) * (g.body - kept), np.float32)


def _carried_along(
    state: PropagationState, carried: _Carried, coarse: Pose, pose: Pose, now: F32, p: PropagationParams
) -> F32:
    """Move what is kept with the flow; drop what changed on the way and what moves with the surroundings.

    Parameters
    ----------
    carried : _Carried
        Its flow ends in the patch at `coarse`.
    pose : Pose
        Where the result is wanted.
    now : ndarray, shape (h / 2, w / 2), float32
        Patch at `pose`, halved, as the result is.
    """
    g, kept = state.geometry, state.kept
    if carried.belongs is not None:
        textured = _halved(carried.weight / (carried.weight + np.float32(0.1)))
        kept = kept * (np.float32(1.0) - textured * np.maximum(1.0 - 2.0 * _halved(carried.belongs), 0.0))
    rows, columns = kept.shape
    unit, zoom = 2.0 * g.fine_step * coarse.sx, pose.sx / coarse.sx
    along = np.arange(columns, dtype=np.float32) - np.float32(0.5 * (columns - 1))
    up = np.arange(rows, dtype=np.float32) - np.float32(0.5 * (rows - 1))
    x = np.float32((pose.cx - coarse.cx) / unit + 0.5 * (columns - 1)) + np.float32(zoom) * along
    y = np.float32((pose.cy - coarse.cy) / unit + 0.5 * (rows - 1)) + np.float32(zoom) * up
    half = carried.flow[1::2, 1::2] * np.float32(0.5)
    moved, before = _at(x[None, :] - half[:, :, 0], y[:, None] - half[:, :, 1], kept, _halved(state.model.previous))
    unchanged = (np.float32(p.changed) - np.abs(before - now)) * np.float32(1.0 / (p.changed - p.same))
    return np.asarray(moved * np.clip(unchanged, 0.0, 1.0), np.float32)


def _at(x: F32, y: F32, *planes: F32) -> list[F32]:
    """Bilinear reads of planes of one shape; beyond them their border is repeated."""
    rows, columns = planes[0].shape
    x, y = np.clip(x, 0.0, columns - 1.001), np.clip(y, 0.0, rows - 1.001)
    left, top = x.astype(np.int32), y.astype(np.int32)
    fx, fy, base = x - left, y - top, top * columns + left
    out = []
    for plane in planes:
        one, two = plane.take(base), plane.take(base + columns)
        one += fx * (plane.take(base + 1) - one)
        two += fx * (plane.take(base + columns + 1) - two)
        out.append(np.asarray(one + fy * (two - one), np.float32))
    return out


def _kept_share(kept: F32, g: _Geometry) -> float:
    return float(np.vdot(kept, g.body_weights))


def _hold(
    state: PropagationState, view: _View, frame: Frame, carried: _Carried, height: float, p: PropagationParams
) -> tuple[Pose, list[float]]:
    """Pose drawn half-way to the best keyframe, and the agreement with each keyframe."""
    g, pose = state.geometry, carried.pose
    scores = [anchor.correlation(carried.current, key, g.inner) for key in state.model.keys]
    best, found = int(np.argmax(scores)), None
    candidate, score = _registered(view, state.model.keys[best], carried.current, pose, carried.prior, g, p)
    if score > scores[best]:
        scores[best], found = score, candidate if score > _KEY_MATCH else None
    if scores[0] < p.reset_below:
        # Only the first keyframe's size is what the user drew.
        other = pose.scaled(_ZOOMS[(state.good_frames + state.low) % len(_ZOOMS)])
        reset, score = _registered(view, state.model.keys[0], view.fine(other), other, g.weights, g, p)
        # A patch of a few blurred edges fits in many sizes; what surrounds it does not.
        if score > max(p.reset_match, scores[0] + p.reset_gain) and (
            _look(state, view, reset, reset, 0.0).height > p.reset_level * height
        ):
            scores[0] = score
            return reset, scores
    if found is not None:
        pose = pose.moved(0.5 * (found.cx - pose.cx), 0.5 * (found.cy - pose.cy))
        pose = pose.scaled(math.sqrt(found.sx / pose.sx))
    return _gate_scale(pose, state.pose, max(carried.agreement, *scores), g, frame), scores


def _registered(
    view: _View, key: F32, current: F32, pose: Pose, prior: F32, g: _Geometry, p: PropagationParams
) -> tuple[Pose, float]:
    """Pose to which the flow from a keyframe leads, and the agreement there; `current` is the patch at `pose`."""
    _, _, motion = _register(key, current, prior, p, p.key_levels)
    candidate = _applied(pose, motion, g, p.max_key_scale)
    return candidate, anchor.correlation(view.fine(candidate), key, g.inner)


def _gate_scale(pose: Pose, old: Pose, agreement: float, g: _Geometry, frame: Frame) -> Pose:
    factor = (pose.sx / old.sx) ** min(max((agreement - 0.5) / 0.4, 0.0), 1.0)
    side = math.sqrt(g.w * g.h * old.sx * old.sy) * factor
    if not _MIN_SIDE <= side <= 0.9 * max(frame.width, frame.height):
        factor = 1.0
    return Pose(pose.cx, pose.cy, old.sx * factor, old.sy * factor)


def _judge(
    state: PropagationState,
    frame: Frame,
    pose: Pose,
    expected: Pose,
    height: float,
    keys: list[float],
    colour: float,
    p: PropagationParams,
) -> str:
    """Believe the pose and learn, only follow, or reject it.

    Peak height and agreement with the *first* keyframe tell a good box from a bad one far better than agreement
    with what was learned lately: a mistake that has been learned agrees with itself. A sudden loss of agreement
    with all keyframes is how an occlusion begins, and must not be learned either.
    """
    g, level, evidence = state.geometry, height / max(state.peak, 1e-3), height + keys[0]
    jump = _jump(g, pose, expected)
    if _visible(_box(g, pose), frame) < 0.2:
        return _BAD
    if jump < p.far:
        enough = level > p.near_level
    else:
        enough = height > p.found and level > p.far_level and max(keys) > p.far_match
    if enough and evidence > p.confidence and (evidence > p.doubt or max(keys) > p.drop * state.match):
        return _GOOD
    if state.low <= p.patience and jump < p.near and level * min(colour / state.colour, 1.0) > p.present:
        return _UNSURE
    return _WEAK if jump < p.near and level > p.follow_level else _BAD


def _jump(g: _Geometry, pose: Pose, expected: Pose) -> float:
    """Distance from the prediction, box sizes."""
    return math.hypot(pose.cx - expected.cx, pose.cy - expected.cy) / math.sqrt(g.w * g.h * expected.sx * expected.sy)


def _visible(box: Box, frame: Frame) -> float:
    """Share of a box inside the frame."""
    return box.clip(frame.width, frame.height).area / box.area


def _settle(
    state: PropagationState, pose: Pose, coarse: Pose, verdict: str, p: PropagationParams
) -> tuple[Pose, tuple[float, float], int]:
    """Pose and velocity to carry on with, and for how many frames the agreement has been bad."""
    old, (vx, vy) = state.pose, state.velocity
    if verdict == _GOOD:
        if state.low > p.patience:
            return pose, (vx, vy), 0
        rate = p.velocity_rate
        return pose, (vx + rate * (pose.cx - old.cx - vx), vy + rate * (pose.cy - old.cy - vy)), 0
    if verdict in (_UNSURE, _WEAK):
        low = 1 if verdict == _UNSURE else state.low + 1
        return Pose(coarse.cx, coarse.cy, old.sx, old.sy), (0.5 * vx, 0.5 * vy), low
    low = state.low + 1
    if low > p.patience:
        return old, (0.0, 0.0), low
    return old.moved(vx, vy), (0.5 * vx, 0.5 * vy), low


def _score(evidence: float, kept: float) -> float:
    """Chance that the box overlaps the object by more than half: logistic fit to frames of real and drawn sequences.

    Parameters
    ----------
    evidence : float
        Height of the filter's peak + agreement with the first keyframe.
    kept : float
        Share of the box that is kept.
    """
    return 1.0 / (1.0 + math.exp(4.5 - 3.0 * evidence - 3.2 * kept))


def _learn(
    model: _Model,
    view: _View,
    g: _Geometry,
    pose: Pose,
    carried: _Carried,
    best_key: float,
    kept: float,
    p: PropagationParams,
) -> _Model:
    patch, rate = model.previous, np.float32(p.patch_rate)
    histograms, likelihood = model.histograms, model.likelihood
    raw = view.coarse(pose)
    located = anchor.learn(model.located, _channels(view, pose, raw, model.likelihood, g), p.filter_rate)
    if histograms is not None:
        histograms = histograms + np.float32(p.colour_rate) * (_histograms(raw, g.inside) - histograms)
        likelihood = _likelihood(histograms)
    keys, age = model.keys, model.key_age + 1
    if best_key < _KEY_MATCH and carried.agreement > 0.6 and kept >= p.new_key and age >= p.key_gap:
        keys, age = (keys[0], *keys[1:][2 - p.keys :], patch), 0
    mask = model.mask
    if carried.belongs is not None:
        textured = carried.weight / (carried.weight + np.float32(0.2))
        mask = mask + np.float32(p.mask_rate) * textured * (carried.belongs - mask)
    error = patch - model.mean
    return _Model(
        previous=patch, mean=model.mean + rate * error,
        deviation=model.deviation + rate * (np.abs(error) - model.deviation), mask=mask,
        keys=keys, key_age=age, histograms=histograms, likelihood=likelihood, located=located,
    )  # fmt: skip


def ride(state: PropagationState, box: Box) -> PropagationState:
    """Follow a box found by other means, without a look at the frame: what was learned stays as it is.

    The size follows slowly: another mode's box shrinks while its object goes out of sight, which is when this one
    is needed.

    Parameters
    ----------
    state : PropagationState
        Not changed.
    box : Box
        Frame px; its shape may differ from the first one's.

    Returns
    -------
    PropagationState
        At rest in the middle of `box`, not lost.
    """
    g, old = state.geometry, state.pose
    pose = Pose(
        box.x + box.w / 2 - 0.5,
        box.y + box.h / 2 - 0.5,
        old.sx + _RIDE_RATE * (box.w / g.w - old.sx),
        old.sy + _RIDE_RATE * (box.h / g.h - old.sy),
    )
    report = replace(state.report, box=box, ok=True, lost=False)
    return replace(state, pose=pose, velocity=(0.0, 0.0), low=0, kept=g.body, report=report)
