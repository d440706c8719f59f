"""The box carried by the dense flow inside it: for parts, stops and moving cameras.

Each frame, in patches resampled round the box so that the object always has the same size in samples:

1. *Find*: a correlation filter on a wide, coarse window says where the object's surroundings are.
2. *Carry*: the Horn–Schunck flow between the previous and the present fine patch, fitted robustly by a
   translation and a scale, moves and resizes the box.
3. *Hold*: the flow from stored keyframes to the present patch takes out the drift of summed increments.
4. *Judge*: agreement with what was learned decides whether to follow, to learn, to coast or to search.

All functions are pure: a state goes in, a new one comes out, and no array of the old one is written to.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass, field, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from . import anchor, patches
from .flow import HornSchunck
from .frames import Frame, crop, to_gray
from .geometry import Box

__all__ = ["PropagationParams", "PropagationReport", "PropagationState", "reseat", "start", "step"]

F32 = NDArray[np.float32]

_COLOUR_THRESHOLD = 2.0
_CONTRAST = 32.0


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
        Frames of bad agreement that are still followed before the object counts as lost.
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
    filter_rate: float = 0.04
    filter_sigma: float = 1.6
    distance_penalty: float = 0.15
    velocity_rate: float = 0.5
    keys: int = 4
    key_gap: int = 8
    patience: int = 3
    kind: int = 0


@dataclass(frozen=True)
class Pose:
    """Where the box is: centre in pixel-index coordinates, and size relative to the first box."""

    cx: float
    cy: float
    sx: float
    sy: float

    def moved(self, dx: float, dy: float) -> Pose:
        """Return the pose translated by (dx, dy) px."""
        return replace(self, cx=self.cx + dx, cy=self.cy + dy)

    def scaled(self, factor: float) -> Pose:
        """Return the pose with its size multiplied."""
        return replace(self, sx=self.sx * factor, sy=self.sy * factor)


@dataclass(frozen=True)
class _Geometry:
    """What depends on the first box only: sampling steps, patch sizes and weights."""

    w: float
    h: float
    fine_step: float
    coarse_step: float
    inner: F32
    weights: F32
    window: F32
    inside: NDArray[np.bool_]
    distance: F32


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
        Agreement with what was learned, 0–1.
    lost : bool
        Searching.
    debug : dict
        `flow` (h, w, 2) in fine samples, `previous` and `current` fine patch, `pose` (cx, cy, sx, sy), `ncc`,
        `peak`, `keys` (agreement with each keyframe).
    """

    box: Box
    ok: bool
    score: float
    lost: bool
    debug: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Model:
    """What was learned about the object: patches, keyframes, colours, correlation filter."""

    previous: F32
    mean: F32
    deviation: F32
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
    agreement: float
    peak: float
    low: int
    report: PropagationReport


class _View:
    """The part of a frame round the object, cut once and sampled often."""

    def __init__(self, frame: Frame, geometry: _Geometry, pose: Pose) -> None:
        fine = geometry.fine_step * min(pose.sx, pose.sy)
        # Thinning the pixels keeps the cost of a large object that of a small one: two reads a sample remain.
        self._thin = max(1, int(fine / 2.0))
        self._frame = Frame(frame.pixels[:: self._thin, :: self._thin], frame.gain)
        self._geometry = geometry
        self._left = self._top = self._right = self._bottom = 0
        self._colour: F32 = np.empty((0, 0, 1), np.float32)
        self._gray = self._colour
        rows, columns = geometry.window.shape
        self._cut(pose, geometry.coarse_step, rows, columns)

    def fine(self, pose: Pose) -> F32:
        """Normalised gray patch at a pose: zero mean under the inner weights, deviation about 32."""
        g = self._geometry
        gray = self._sample(pose, g.fine_step, *g.weights.shape, gray=True)[:, :, 0]
        gray = cv2.GaussianBlur(gray, (3, 3), 0.7)
        mean = float(np.vdot(g.inner, gray))
        gray -= np.float32(mean)
        deviation = math.sqrt(max(float(np.vdot(g.inner, gray * gray)), 0.0))
        gray *= np.float32(_CONTRAST / (deviation + 4.0))
        return np.asarray(gray, np.float32)

    def fine_colour(self, pose: Pose) -> F32:
        """Raw patch (h, w, C) at a pose, on the lattice of :meth:`fine`."""
        return self._sample(pose, self._geometry.fine_step, *self._geometry.weights.shape, gray=False)

    def coarse(self, pose: Pose) -> F32:
        """Raw window (h, w, C) of the correlation filter at a pose."""
        return self._sample(pose, self._geometry.coarse_step, *self._geometry.window.shape, gray=False)

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
        half_x, half_y = unit * pose.sx * columns / 2 / t + 4, unit * pose.sy * rows / 2 / t + 4
        left, right = int(pose.cx / t - half_x), int(pose.cx / t + half_x) + 1
        top, bottom = int(pose.cy / t - half_y), int(pose.cy / t + half_y) + 1
        if left >= self._left and top >= self._top and right <= self._right and bottom <= self._bottom:
            return
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
    r2 = ((x - (fw - 1) / 2) / (nw / 2)) ** 2 + ((y - (fh - 1) / 2) / (nh / 2)) ** 2
    weights = np.exp(-((r2 / 0.9**2) ** 2)).astype(np.float32)
    inner = np.exp(-((r2 / 0.85**2) ** 2)).astype(np.float32)
    cw, ch = (cv2.getOptimalDFTSize(round(n / coarse_step / 2 + p.coarse_margin)) * 2 for n in (box.w, box.h))
    y, x = np.mgrid[:ch, :cw]
    inside = (abs(x - (cw - 1) / 2) * coarse_step < 0.45 * box.w) & (
        abs(y - (ch - 1) / 2) * coarse_step < 0.45 * box.h
    )
    distance = ((x - cw // 2) * coarse_step / box.w) ** 2 + ((y - ch // 2) * coarse_step / box.h) ** 2
    return _Geometry(
        box.w, box.h, fine_step, coarse_step, inner / inner.sum(), weights,
        anchor.hann(ch, cw), inside, distance.astype(np.float32),
    )  # fmt: skip


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
        both = cv2.GaussianBlur(both, (7, 1), 1.5)
    return np.asarray(both / np.maximum(both.sum(axis=1, keepdims=True), 1.0), np.float32)


def _likelihood(histograms: F32) -> F32:
    return (histograms[0] + np.float32(1e-4)) / (histograms[0] + histograms[1] + np.float32(2e-4))


def _foreground(raw: F32, likelihood: F32 | None) -> F32 | None:
    if likelihood is None:
        return None
    return np.asarray(cv2.blur(likelihood.take(_bins(raw)), (3, 3)), np.float32)


def _channels(raw: F32, model_likelihood: F32 | None, g: _Geometry, p: PropagationParams) -> F32:
    return anchor.features(to_gray(raw), _foreground(raw, model_likelihood), g.window, p.kind, raw)


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
    report = PropagationReport(box, True, 1.0, False)
    return PropagationState(g, pose, (0.0, 0.0), _first_model(view, g, pose, params), 1.0, 1.0, 0, report)


def _first_model(view: _View, g: _Geometry, pose: Pose, p: PropagationParams) -> _Model:
    fine, raw = view.fine(pose), view.coarse(pose)
    histograms = likelihood = None
    if raw.shape[2] == 1 or float(np.abs(raw[:, :, 0] - raw[:, :, 2]).mean()) > _COLOUR_THRESHOLD:
        histograms = _histograms(raw, g.inside)
        likelihood = _likelihood(histograms)
    located = anchor.train(_channels(raw, likelihood, g, p), p.filter_sigma)
    return _Model(fine, fine, np.zeros_like(fine), (fine,), 0, histograms, likelihood, located)


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
    p, g, old = params, state.geometry, state.pose
    view = _View(frame, g, old.moved(*state.velocity))
    coarse, peak, response = _find(state, view, p)
    pose, current, agreement, prior, flow = _carry(state, view, coarse, p)
    pose, keys = _hold(state, view, pose, current, prior, p)
    best = max(agreement, *keys)
    good = best > 0.6 * state.agreement or (state.low == 0 and peak > 0.5 * state.peak)
    pose = _gate_scale(pose, old, best, g, frame)
    low = 0 if good else state.low + 1
    lost = low > p.patience
    velocity = state.velocity
    if good and state.low <= p.patience:
        step_x, step_y = pose.cx - old.cx, pose.cy - old.cy
        velocity = tuple(v + p.velocity_rate * (d - v) for v, d in zip(velocity, (step_x, step_y), strict=True))
    elif lost:
        velocity, pose = (0.0, 0.0), old
    elif not good:
        velocity = (0.5 * velocity[0], 0.5 * velocity[1])
    model = state.model
    if not lost:
        model = replace(model, previous=view.fine(pose))
    if good:
        model = _learn(model, view, g, pose, agreement, max(keys), p)
        rate = 0.05
        state = replace(
            state,
            agreement=state.agreement + rate * (best - state.agreement),
            peak=state.peak + rate * (peak - state.peak),
        )
    score = min(max(0.5 * best / state.agreement + 0.5 * peak / state.peak, 0.0), 1.0)
    debug = {
        "flow": flow, "previous": state.model.previous, "current": current,
        "pose": (pose.cx, pose.cy, pose.sx, pose.sy), "ncc": agreement, "peak": peak, "keys": keys,
        "q": best, "n": agreement, "good": good, "response": response,
    }  # fmt: skip
    report = PropagationReport(_box(g, pose), not lost, score, lost, debug)
    return replace(state, pose=pose, velocity=velocity, model=model, low=low, report=report)


def _find(state: PropagationState, view: _View, p: PropagationParams) -> tuple[Pose, float, F32]:
    g = state.geometry
    lost = max(state.low - p.patience, 0)
    zoom = (1.0, 0.85, 1.0, 1.18)[state.low % 4] if lost else 1.0
    at = state.pose.moved(*state.velocity).scaled(zoom)
    response = anchor.respond(state.model.located, _channels(view.coarse(at), state.model.likelihood, g, p))
    top = anchor.find_peak(response - np.float32(p.distance_penalty / (1 + lost)) * g.distance)
    rows, columns = response.shape
    height = float(response[min(round(top.dy) + rows // 2, rows - 1), min(round(top.dx) + columns // 2, columns - 1)])
    return at.moved(top.dx * g.coarse_step * at.sx, top.dy * g.coarse_step * at.sy), height, response


def _register(
    key: F32, current: F32, pose: Pose, prior: F32, g: _Geometry, p: PropagationParams, levels: int, limit: float
) -> tuple[Pose, F32]:
    """Pose of the object that looks like `key`, from the flow key → current patch (sampled at `pose`)."""
    flow = _flow(key, current, p, levels)
    weight, motion = np.empty_like(prior), np.empty(6)
    patches.residual_weights(key, current, flow, prior, weight)
    patches.fit_motion(flow, weight, motion)
    tx, ty, _, _, scale, _ = motion.tolist()
    moved = pose.moved(g.fine_step * pose.sx * tx, g.fine_step * pose.sy * ty)
    return moved.scaled(1.0 + min(max(scale, -limit), limit)), flow


def _carry(
    state: PropagationState, view: _View, coarse: Pose, p: PropagationParams
) -> tuple[Pose, F32, float, F32, F32]:
    g, model = state.geometry, state.model
    current = view.fine(coarse)
    prior = g.weights / (np.float32(1.0) + (model.deviation * np.float32(0.1)) ** 2)
    foreground = None if model.likelihood is None else _foreground(view.fine_colour(coarse), model.likelihood)
    if foreground is not None:
        prior *= np.float32(0.1) + foreground
    before = anchor.correlation(current, model.mean, g.inner)
    fine, flow = _register(model.previous, current, coarse, prior, g, p, p.levels, p.max_scale_step)
    patch = view.fine(fine)
    agreement = anchor.correlation(patch, model.mean, g.inner)
    if agreement < before - 0.02:
        return coarse, current, before, prior, flow
    trust = min(max((agreement - 0.3) / 0.4, 0.0), 1.0)
    fine = replace(fine, cx=coarse.cx + trust * (fine.cx - coarse.cx), cy=coarse.cy + trust * (fine.cy - coarse.cy))
    return fine, patch, agreement, prior, flow


def _hold(
    state: PropagationState, view: _View, pose: Pose, current: F32, prior: F32, p: PropagationParams
) -> tuple[Pose, list[float]]:
    g = state.geometry
    scores = [anchor.correlation(current, key, g.inner) for key in state.model.keys]
    best, found = 0.7, None
    for index in sorted(range(len(scores)), key=lambda i: -scores[i])[:2]:
        key = state.model.keys[index]
        candidate, _ = _register(key, current, pose, prior, g, p, p.key_levels, p.max_key_scale)
        score = anchor.correlation(view.fine(candidate), key, g.inner)
        if score > max(best, scores[index]):
            best, found = score, candidate
        scores[index] = max(scores[index], score)
    if found is not None:
        pose = pose.moved(0.5 * (found.cx - pose.cx), 0.5 * (found.cy - pose.cy))
        pose = pose.scaled(math.sqrt(found.sx / pose.sx))
    return pose, scores


def _gate_scale(pose: Pose, old: Pose, agreement: float, g: _Geometry, frame: Frame) -> Pose:
    factor = (pose.sx / old.sx) ** min(max((agreement - 0.5) / 0.4, 0.0), 1.0)
    side = math.sqrt(g.w * g.h * old.sx * old.sy) * factor
    if not 6.0 <= side <= 0.9 * max(frame.width, frame.height):
        factor = 1.0
    return Pose(pose.cx, pose.cy, old.sx * factor, old.sy * factor)


def _learn(
    model: _Model, view: _View, g: _Geometry, pose: Pose, agreement: float, best_key: float, p: PropagationParams
) -> _Model:
    patch, raw, rate = model.previous, view.coarse(pose), np.float32(p.patch_rate)
    located = anchor.learn(model.located, _channels(raw, model.likelihood, g, p), p.filter_rate)
    histograms, likelihood = model.histograms, model.likelihood
    if histograms is not None:
        histograms = histograms + np.float32(p.colour_rate) * (_histograms(raw, g.inside) - histograms)
        likelihood = _likelihood(histograms)
    keys, age = model.keys, model.key_age + 1
    if best_key < 0.7 and agreement > 0.6 and age >= p.key_gap:
        keys, age = (keys[0], *keys[1:][2 - p.keys :], patch), 0
    error = patch - model.mean
    return _Model(
        previous=patch,
        mean=model.mean + rate * error,
        deviation=model.deviation + rate * (np.abs(error) - model.deviation),
        keys=keys, key_age=age, histograms=histograms, likelihood=likelihood, located=located,
    )  # fmt: skip


def reseat(
    state: PropagationState, frame: Frame, box: Box, params: PropagationParams, *, learn: bool
) -> PropagationState:
    """Move the pose to a box found by other means.

    Parameters
    ----------
    state : PropagationState
        Not changed.
    frame : Frame
        The frame `box` was found in.
    box : Box
        Frame px.
    params : PropagationParams
    learn : bool
        Refresh what was learned with what is seen there.

    Returns
    -------
    PropagationState
        Not lost; velocity from the displacement.
    """
    g, old = state.geometry, state.pose
    pose = Pose(box.x + box.w / 2 - 0.5, box.y + box.h / 2 - 0.5, box.w / g.w, box.h / g.h)
    view = _View(frame, g, pose)
    model = replace(state.model, previous=view.fine(pose))
    if learn:
        agreement = anchor.correlation(model.previous, model.mean, g.inner)
        best = max(anchor.correlation(model.previous, key, g.inner) for key in model.keys)
        model = _learn(model, view, g, pose, agreement, best, params)
    velocity = state.velocity
    if state.low <= params.patience:
        rate = params.velocity_rate
        velocity = (
            velocity[0] + rate * (pose.cx - old.cx - velocity[0]),
            velocity[1] + rate * (pose.cy - old.cy - velocity[1]),
        )
    report = replace(state.report, box=box, ok=True, lost=False)
    return replace(state, pose=pose, velocity=velocity, model=model, low=0, report=report)
