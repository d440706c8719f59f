"""One frame of the carried box: find, carry, hold, judge, learn."""

from __future__ import annotations

import math
import threading
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from .. import anchor, patches
from ..flow import HornSchunck
from ..frames import Frame
from ..geometry import Box
from .kept import Carried, body_weights, carried_along, coherence_with, kept_share, refreshed
from .search import Found, find, finer, look
from .state import (
    Geometry,
    Model,
    Pose,
    PropagationParams,
    PropagationReport,
    PropagationState,
    box_at,
    geometry_of,
    halved,
    jump_from,
)
from .view import COLOURS, GRAYS, View, foreground, histograms_of, likelihood_of

__all__ = ["dismiss", "ride", "start", "step"]

F32 = NDArray[np.float32]

_COLOUR_THRESHOLD = 2.0
_MASK_FLOOR = 0.15
_KEY_MATCH = 0.7
_MIN_SIDE = 6.0
_CLEARLY = 0.1
_RIDE_RATE = 0.03
_MAX_TURN = 0.15
_ZOOMS = (0.67, 0.75, 0.87, 1.0, 1.15, 1.33, 1.5, 1.7)
_GOOD, _UNSURE, _WEAK, _BAD = "good", "unsure", "weak", "bad"


_local = threading.local()


def _flow(a: F32, b: F32, params: PropagationParams, levels: int) -> F32:
    """Flow a → b by a solver of this thread; its workspace must not travel with the state."""
    solvers = _local.__dict__.setdefault("solvers", {})
    key = (params.preset, params.smoothness, levels, params.warps)
    if key not in solvers:
        solvers[key] = HornSchunck(params.preset, smoothness=params.smoothness, levels=levels, warps=params.warps)
    flow: F32 = solvers[key].calc(a, b, None)
    return flow


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
    g = geometry_of(box, params)
    pose = Pose(box.x + box.w / 2 - 0.5, box.y + box.h / 2 - 0.5, 1.0, 1.0)
    view = View(frame, g, pose)
    model = _first_model(view, g, pose, params)
    patch = model.previous
    report = PropagationReport(
        box, 0.0, True, 1.0, False, *_window(g, pose), patch, patch, np.zeros((*patch.shape, 2), np.float32), 1.0,
        np.zeros_like(g.window), 1.0, (1.0,), 1.0, _GOOD,
    )  # fmt: skip
    return PropagationState(
        g, pose, (0.0, 0.0), model, 1.0, 1.0, _first_colour(view, pose, model, g), 1, 0, g.body, None, report
    )


def _window(g: Geometry, pose: Pose) -> tuple[tuple[float, float], tuple[float, float]]:
    """Origin and step of the fine patch at a pose."""
    rows, columns = g.weights.shape
    across, down = g.fine_step * pose.sx, g.fine_step * pose.sy
    return (pose.cx + 0.5 - 0.5 * columns * across, pose.cy + 0.5 - 0.5 * rows * down), (across, down)


def _first_colour(view: View, pose: Pose, model: Model, g: Geometry) -> float:
    if model.likelihood is None:
        return 1.0
    likelihood, _ = foreground(view.coarse(pose), model.likelihood)
    found = Found(0.0, pose, 0.0, likelihood, pose, likelihood)
    fine = finer(found, g)
    return 1.0 if fine is None else float(np.vdot(g.inner, fine))


def _first_model(view: View, g: Geometry, pose: Pose, p: PropagationParams) -> Model:
    fine, raw = view.fine(pose), view.coarse(pose)
    histograms = likelihood = seen = None
    if raw.shape[2] == 1 or float(np.abs(raw[:, :, 0] - raw[:, :, 2]).mean()) > _COLOUR_THRESHOLD:
        count = GRAYS if raw.shape[2] == 1 else COLOURS
        _, bins = foreground(raw, np.zeros(count, np.float32))
        histograms = histograms_of(bins, count, g.inside)
        likelihood = likelihood_of(histograms)
        seen, _ = foreground(raw, likelihood)
    located = anchor.train(anchor.features(view.context(pose), seen, g.window), p.filter_sigma)
    return Model(fine, fine, np.zeros_like(fine), np.ones_like(fine), (fine,), 0, histograms, likelihood, located)


def step(
    state: PropagationState, frame: Frame, params: PropagationParams, *, near: tuple[float, float] | None = None
) -> PropagationState:
    """Follow the object into the next frame.

    Parameters
    ----------
    state : PropagationState
        Not changed.
    frame : Frame
    params : PropagationParams
    near : tuple of float, optional
        Where else to look for it, it being lost; frame px.

    Returns
    -------
    PropagationState
        Its `report` holds the box.
    """
    if near is not None:
        state = replace(state, hint=replace(state.pose, cx=near[0] - 0.5, cy=near[1] - 0.5))
    g, expected = state.geometry, state.pose.moved(*state.velocity)
    view = View(frame, g, expected)
    found = find(state, view, expected, params)
    carried = _carry(state, view, found, params)
    pose, keys = _hold(state, view, frame, carried, found.height, params)
    verdict = _judge(state, frame, pose, expected, found.height, keys, carried.colour, params)
    kept, coarse, leap = state.kept, found.pose, jump_from(g, pose, expected) > params.far
    tracking = state.low <= params.patience
    if tracking and (leap or verdict != _GOOD):
        stayed, coherence, kept = _continue(state, view, expected, params)
        if kept_share(kept, g) > params.unsure:
            # What goes on in the box has not leapt out of it.
            if leap and coherence > coherence_with(state, view.fine(pose)) + _CLEARLY:
                verdict, coarse = _UNSURE, stayed.pose
            elif verdict == _WEAK:
                verdict = _UNSURE
    if verdict == _GOOD:
        kept = g.body if leap or not tracking else refreshed(state, view, carried, found.pose, pose, params)
    pose, velocity, low = _settle(state, pose, coarse, verdict, params)
    lost, share = low > params.patience, kept_share(kept, g)
    model = state.model if lost and verdict == _BAD else replace(state.model, previous=view.fine(pose))
    hint = found.pose if lost and verdict == _BAD else None
    peak, match, colour, good_frames = state.peak, state.match, state.colour, state.good_frames
    if verdict == _GOOD:
        model = _learn(model, view, g, pose, carried, max(keys), share, params)
        match += params.match_rate * (max(keys) - match)
        colour += params.match_rate * (carried.colour - colour)
        good_frames += 1
        peak += max(0.05, 1.0 / good_frames) * (found.height - peak)
    report = PropagationReport(
        box_at(g, pose), pose.angle, not lost, _score(found.height + keys[0], share), lost, *_window(g, found.pose),
        state.model.previous, carried.seen_at_start, carried.flow, found.height, found.response, carried.agreement,
        tuple(keys), share, verdict,
    )  # fmt: skip
    return PropagationState(g, pose, velocity, model, peak, match, colour, good_frames, low, kept, hint, report)


def _fit(flow: F32, weight: F32, p: PropagationParams) -> NDArray[np.float64]:
    motion = np.empty(7)
    patches.fit_motion(flow, weight, float(p.rotation), motion)
    return motion


def _register(
    key: F32, current: F32, prior: F32, p: PropagationParams, levels: int
) -> tuple[F32, F32, NDArray[np.float64]]:
    """Flow key → current, the weight of each pixel and the motion fitted to it."""
    flow, weight, motion = _flow(key, current, p, levels), np.empty_like(prior), np.empty(7)
    patches.register(key, current, flow, prior, float(p.rotation), np.empty_like(prior), weight, motion)
    return flow, weight, motion


def _applied(pose: Pose, motion: NDArray[np.float64], g: Geometry, limit: float) -> Pose:
    moved = pose.shifted(g.fine_step * pose.sx * float(motion[0]), g.fine_step * pose.sy * float(motion[1]))
    moved = moved.turned(min(max(float(motion[6]), -_MAX_TURN), _MAX_TURN))
    return moved.scaled(1.0 + min(max(float(motion[4]), -limit), limit))


def _separate(
    previous: F32,
    current: F32,
    flow: F32,
    weight: F32,
    motion: NDArray[np.float64],
    g: Geometry,
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
    background = _fit(flow, around, p)
    patches.misfit(flow, background, square)
    spread = 0.25 + 1.5 * float(background[5])
    apart = weight * (np.float32(1.0) - np.exp(square * np.float32(-0.5 / spread**2)))
    if float(apart.sum()) < 0.25 * float(weight.sum()) + 1e-3:
        return motion, None
    motion = _fit(flow, apart, p)
    if math.hypot(motion[0] - background[0], motion[1] - background[1]) < p.separation:
        return motion, None
    own = np.empty_like(weight)
    patches.misfit(flow, motion, own)
    return motion, square / (square + own + np.float32(0.02))


def _carry(state: PropagationState, view: View, found: Found, p: PropagationParams) -> Carried:
    g, model, coarse = state.geometry, state.model, found.pose
    current = view.fine(coarse)
    prior = g.weights * (np.float32(_MASK_FLOOR) + model.mask)
    prior /= np.float32(1.0) + (model.deviation * np.float32(0.1)) ** 2
    likelihood, colour = finer(found, g), 1.0
    if likelihood is not None:
        prior *= np.float32(0.1) + likelihood
        colour = float(np.vdot(g.inner, likelihood))
    flow, weight, motion = _register(model.previous, current, prior, p, p.levels)
    motion, belongs = _separate(model.previous, current, flow, weight, motion, g, p)
    fine = _applied(coarse, motion, g, p.max_scale_step)
    patch = view.fine(fine)
    before = patches.correlation(current, model.mean, g.inner)
    agreement = patches.correlation(patch, model.mean, g.inner)
    if agreement < before - 0.02:
        return Carried(coarse, current, before, prior, flow, weight, belongs, current, colour)
    trust = min(max((agreement - 0.3) / 0.4, 0.0), 1.0)
    fine = replace(fine, cx=coarse.cx + trust * (fine.cx - coarse.cx), cy=coarse.cy + trust * (fine.cy - coarse.cy))
    return Carried(fine, patch, agreement, prior, flow, weight, belongs, current, colour)


def _continue(
    state: PropagationState, view: View, expected: Pose, p: PropagationParams
) -> tuple[Carried, float, F32]:
    """Where the content of the box went, how well that can be followed, and how much of it is kept there.

    Neither filter nor keyframes are asked: what they were taught is not what is seen.
    """
    g, model = state.geometry, state.model
    current = view.fine(expected)
    prior = g.weights * (np.float32(_MASK_FLOOR) + model.mask) * body_weights(state)
    flow, weight, motion = _register(model.previous, current, prior, p, p.levels)
    motion, belongs = _separate(model.previous, current, flow, weight, motion, g, p)
    pose = _applied(expected, motion, g, 0.0)
    patch = view.fine(pose)
    before, coherence = coherence_with(state, current), coherence_with(state, patch)
    if coherence < before - 0.02:
        pose, patch, coherence = expected, current, before
    carried = Carried(
        pose, patch, patches.correlation(patch, model.mean, g.inner), prior, flow, weight, belongs, current, 1.0
    )
    kept = carried_along(state, carried, expected, pose, halved(patch), p)
    return carried, coherence, kept * np.float32(min(max(1.5 * coherence / p.coherent - 0.5, 0.0), 1.0))


def _hold(
    state: PropagationState, view: View, frame: Frame, carried: Carried, height: float, p: PropagationParams
) -> tuple[Pose, list[float]]:
    """Pose drawn half-way to the best keyframe, and the agreement with each keyframe."""
    g, pose = state.geometry, carried.pose
    scores = [patches.correlation(carried.current, key, g.inner) for key in state.model.keys]
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
            look(state, view, reset, reset, 0.0).height > p.reset_level * height
        ):
            scores[0] = score
            return reset, scores
    if found is not None:
        pose = pose.moved(0.5 * (found.cx - pose.cx), 0.5 * (found.cy - pose.cy))
        pose = pose.scaled(math.sqrt(found.sx / pose.sx)).turned(0.5 * (found.angle - pose.angle))
    return _gate_scale(pose, state.pose, max(carried.agreement, *scores), g, frame), scores


def _registered(
    view: View, key: F32, current: F32, pose: Pose, prior: F32, g: Geometry, p: PropagationParams
) -> tuple[Pose, float]:
    """Pose to which the flow from a keyframe leads, and the agreement there; `current` is the patch at `pose`."""
    _, _, motion = _register(key, current, prior, p, p.key_levels)
    candidate = _applied(pose, motion, g, p.max_key_scale)
    return candidate, patches.correlation(view.fine(candidate), key, g.inner)


def _gate_scale(pose: Pose, old: Pose, agreement: float, g: Geometry, frame: Frame) -> Pose:
    factor = (pose.sx / old.sx) ** min(max((agreement - 0.5) / 0.4, 0.0), 1.0)
    side = math.sqrt(g.w * g.h * old.sx * old.sy) * factor
    if not _MIN_SIDE <= side <= 0.9 * max(frame.width, frame.height):
        factor = 1.0
    return Pose(pose.cx, pose.cy, old.sx * factor, old.sy * factor, pose.angle)


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
    jump = jump_from(g, pose, expected)
    if _visible(box_at(g, pose), frame) < 0.2:
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
        return replace(old, cx=coarse.cx, cy=coarse.cy), (0.5 * vx, 0.5 * vy), low
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
    model: Model,
    view: View,
    g: Geometry,
    pose: Pose,
    carried: Carried,
    best_key: float,
    kept: float,
    p: PropagationParams,
) -> Model:
    patch, rate = model.previous, np.float32(p.patch_rate)
    histograms, likelihood = model.histograms, model.likelihood
    seen = None
    if histograms is not None and likelihood is not None:
        seen, bins = foreground(view.coarse(pose), likelihood)
        fresh = histograms_of(bins, histograms.shape[1], g.inside)
        histograms = histograms + np.float32(p.colour_rate) * (fresh - histograms)
        likelihood = likelihood_of(histograms)
    channels = anchor.features(view.context(pose), seen, g.window)
    located = anchor.learn(model.located, channels, p.filter_rate)
    keys, age = model.keys, model.key_age + 1
    if best_key < _KEY_MATCH and carried.agreement > 0.6 and kept >= p.new_key and age >= p.key_gap:
        keys, age = (keys[0], *keys[1:][2 - p.keys :], patch), 0
    mask = model.mask
    if carried.belongs is not None:
        textured = carried.weight / (carried.weight + np.float32(0.2))
        mask = mask + np.float32(p.mask_rate) * textured * (carried.belongs - mask)
    error = patch - model.mean
    return Model(
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
    first = box_at(g, replace(old, sx=1.0, sy=1.0))
    pose = replace(
        old,
        cx=box.x + box.w / 2 - 0.5,
        cy=box.y + box.h / 2 - 0.5,
        sx=old.sx + _RIDE_RATE * (box.w / first.w - old.sx),
        sy=old.sy + _RIDE_RATE * (box.h / first.h - old.sy),
    )
    report = replace(state.report, box=box, ok=True, lost=False)
    return replace(state, pose=pose, velocity=(0.0, 0.0), low=0, kept=g.body, hint=None, report=report)


def dismiss(before: PropagationState, after: PropagationState) -> PropagationState:
    """The state after a frame in which what it found turned out to be something else: still searching.

    Parameters
    ----------
    before, after : PropagationState
        Searching, and found by mistake.

    Returns
    -------
    PropagationState
    """
    report = replace(after.report, box=before.report.box, ok=False, lost=True, score=0.0)
    return replace(before, low=before.low + 1, report=report)
