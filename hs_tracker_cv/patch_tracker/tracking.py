"""One frame of the carried box: find it, follow the flow, correct by keyframes, decide, learn."""

from __future__ import annotations

import math
import threading

import numpy as np
from numpy.typing import NDArray

from .._native import kernels
from ..flow import HornSchunck
from ..frames import Frame
from ..geometry import Box
from . import finder as finders
from . import tuning
from .patches import COLOURS, GRAYS
from .persistence import (
    Carried,
    Followed,
    body_weights,
    carried_along,
    coherence_with,
    persistent_share,
    refreshed,
)
from .sampler import Sampler
from .search import Found, find, peak_at
from .state import (
    Geometry,
    Model,
    PatchTrackerEstimate,
    PatchTrackerParams,
    PatchTrackerState,
    Pose,
    box_at,
    geometry_of,
    jump_from,
)

__all__ = ["dismiss", "ride", "seek", "start", "step", "teach", "turned"]

F32 = NDArray[np.float32]

_GOOD, _UNSURE, _WEAK, _BAD = "good", "unsure", "weak", "bad"


_local = threading.local()


def _flow(a: F32, b: F32, params: PatchTrackerParams, levels: int) -> F32:
    """Flow a → b by a solver of this thread; its workspace must not travel with the state."""
    solvers = _local.__dict__.setdefault("solvers", {})
    key = (params.preset, params.smoothness, levels, params.warps)
    if key not in solvers:
        solvers[key] = HornSchunck(
            params.preset, smoothness=params.smoothness, levels=levels, warps=params.warps, gain=1.0, exposure=False
        )
    flow: F32 = solvers[key].calc(a, b, None)
    return flow


def start(frame: Frame, box: Box, params: PatchTrackerParams) -> PatchTrackerState:
    """Learn the object in `box`.

    Parameters
    ----------
    frame : Frame
    box : Box
        Frame px.
    params : PatchTrackerParams

    Returns
    -------
    PatchTrackerState
    """
    g = geometry_of(box, params)
    pose = Pose(box.x + box.w / 2 - 0.5, box.y + box.h / 2 - 0.5, 1.0, 1.0)
    sampler = Sampler(frame, g, pose, g.weights[np.newaxis], None)
    model = _first_model(sampler, g, pose)
    patch = model.previous
    window, across = _window(g, pose)
    estimate = PatchTrackerEstimate(
        box=box, ok=True, score=1.0, window=window, step=across, previous=patch, current=patch,
        flow=np.zeros((*patch.shape, 2), np.float32), angle=0.0, peak=1.0, response=np.zeros_like(g.lattice.fade),
        agreement=1.0, keys=(1.0,), persistence=1.0, verdict=_GOOD,
    )  # fmt: skip
    return PatchTrackerState(g, pose, (0.0, 0.0), model, 1.0, 1, 0, g.body, None, sampler.part, estimate)


def _window(g: Geometry, pose: Pose) -> tuple[Box, float]:
    """Fine patch at a pose, frame px, and frame px per sample across it."""
    rows, columns = g.weights.shape
    across, down = g.fine_step * pose.sx, g.fine_step * pose.sy
    width, height = columns * across, rows * down
    return Box(pose.cx + 0.5 - 0.5 * columns * across, pose.cy + 0.5 - 0.5 * rows * down, width, height), across


def _first_model(sampler: Sampler, g: Geometry, pose: Pose) -> Model:
    fine, colours, histograms = sampler.fine(pose).gray, sampler.colours(pose), None
    still, moving = np.zeros((*fine.shape, 2), np.float32), np.ones_like(fine)
    means = np.stack((fine, still[:, :, 0], moving, np.float32(1.0 + tuning.MASK_FLOOR) * g.weights))
    is_gray = len(colours) == 1
    if is_gray or float(np.abs(colours[0] - colours[2]).mean()) > tuning.COLOUR_THRESHOLD:
        nothing = np.zeros((2, GRAYS if is_gray else COLOURS), np.float32)
        histograms = sampler.learned_colours(pose, nothing, 1.0)
    located = finders.start(sampler.scene(pose), g.lattice, histograms is not None and not is_gray)
    return Model(fine, means, fine[np.newaxis], 0, histograms, located)


def step(
    state: PatchTrackerState, frame: Frame, params: PatchTrackerParams, *, near: tuple[float, float] | None = None
) -> PatchTrackerState:
    """Follow the object into the next frame.

    Parameters
    ----------
    state : PatchTrackerState
        Not changed.
    frame : Frame
    params : PatchTrackerParams
    near : tuple of float, optional
        Where else to look for it, it being lost; frame px.

    Returns
    -------
    PatchTrackerState
        Its `estimate` holds the box.
    """
    if near is not None:
        state = state._replace(hint=state.pose._replace(cx=near[0] - 0.5, cy=near[1] - 0.5))
    g, expected = state.geometry, state.pose.moved(*state.velocity)
    sampler = Sampler(frame, g, expected, state.model.templates, state.before)
    found = find(state, sampler, expected, params)
    carried = _follow_flow(state, sampler, found, params)
    pose, keys = _correct_by_keyframes(state, sampler, frame, carried, found.seen.height, params)
    pose = pose._replace(cx=found.pose.cx, cy=found.pose.cy)
    verdict = _verdict(state, frame, pose, expected, found.chance, max(keys), params)
    persistence, means, coarse = state.persistence, state.model.means, found.pose
    leap = jump_from(g, pose, expected) > params.far
    tracking = state.low <= params.patience
    if tracking and (leap or verdict != _GOOD):
        stayed, coherence, persistence = _follow_content(state, sampler, expected, params)
        if persistent_share(persistence, g) > params.unsure:
            # What goes on in the box has not leapt out of it.
            if leap and coherence > coherence_with(state, sampler.fine(pose).gray) + tuning.CLEARLY:
                verdict, coarse = _UNSURE, stayed
            elif verdict == _WEAK and found.chance > params.hopeless:
                verdict = _UNSURE
    if verdict == _GOOD:
        seen = sampler.fine(pose).gray
        persistence, means = refreshed(state, carried.followed, found.pose, pose, seen, params)
        if leap or not tracking:
            persistence = g.body
    pose, velocity, low = _next_pose(state, pose, coarse, verdict, params)
    lost, share = low > params.patience, persistent_share(persistence, g)
    model = state.model if lost and verdict == _BAD else state.model._replace(previous=sampler.fine(pose).gray)
    hint = found.pose if lost and verdict == _BAD else None
    peak, good_frames = state.peak, state.good_frames
    if verdict == _GOOD:
        model = _learn(model, means, sampler, g, pose, carried.patch.agreement, max(keys), share, params)
        good_frames += 1
        peak = _followed_peak(peak, found.seen.height, good_frames)
    model = model._replace(located=finders.with_unrest(model.located, found.seen.change))
    # Without `rotation` the turn is only how the object is found: the box stays that of the first frame.
    box = box_at(g, pose if params.rotation else pose._replace(angle=0.0))
    window, across = _window(g, found.pose)
    estimate = PatchTrackerEstimate(
        box=box, ok=not lost, score=found.chance, window=window, step=across, previous=state.model.previous,
        current=carried.start.gray, flow=carried.followed.flow, angle=pose.angle, peak=found.seen.height,
        response=found.seen.response, agreement=carried.patch.agreement, keys=tuple(keys), persistence=share,
        verdict=verdict,
    )  # fmt: skip
    return PatchTrackerState(
        g, pose, velocity, model, peak, good_frames, low, persistence, hint, sampler.part, estimate
    )


def _followed_peak(peak: float, height: float, good_frames: int) -> float:
    """Usual height of the filter's peak after one more: its mean at first, which then follows slowly."""
    return peak + max(tuning.PEAK_RATE, 1.0 / good_frames) * (height - peak)


def _followed(
    key: F32,
    current: F32,
    flow: F32,
    prior: F32,
    g: Geometry,
    p: PatchTrackerParams,
    separation: float,
    likelihood: F32 | None = None,
) -> Followed:
    """What is fitted to the flow key → current; the colours of what was found there are a further weight."""
    planes, ratio = np.empty((3, *prior.shape), np.float32), g.fine_step / g.coarse_step
    priors = kernels.FitPriors(prior, g.outside, likelihood, ratio)
    *motion, apart = kernels.fit_motion(key, current, flow, priors, p.rotation, separation, planes)
    return Followed(flow, planes, (motion[0], motion[1], motion[2], motion[3]), apart)


def _applied(pose: Pose, followed: Followed, g: Geometry, limit: float) -> Pose:
    right, down, growth, turn = followed.motion
    moved = pose.shifted(g.fine_step * pose.sx * right, g.fine_step * pose.sy * down)
    factor = 1.0 + min(max(growth, -limit), limit)
    return Pose(
        moved.cx,
        moved.cy,
        pose.sx * factor,
        pose.sy * factor,
        pose.angle + min(max(turn, -tuning.MAX_TURN), tuning.MAX_TURN),
    )


def _follow_flow(state: PatchTrackerState, sampler: Sampler, found: Found, p: PatchTrackerParams) -> Carried:
    g, model, coarse = state.geometry, state.model, found.pose
    start = sampler.fine(coarse)
    likelihood = None if model.histograms is None else sampler.likelihood(coarse, model.histograms)
    flow = _flow(model.previous, start.gray, p, p.levels)
    followed = _followed(model.previous, start.gray, flow, model.means[3], g, p, p.separation, likelihood)
    fine = _applied(coarse, followed, g, p.max_scale_step)
    patch = sampler.fine(fine)
    if patch.agreement < start.agreement - tuning.WORSE:
        return Carried(coarse, start, followed, start)
    trust = min(max((patch.agreement - tuning.TRUST_FROM) / tuning.TRUST_SPAN, 0.0), 1.0)
    cx, cy = coarse.cx + trust * (fine.cx - coarse.cx), coarse.cy + trust * (fine.cy - coarse.cy)
    return Carried(Pose(cx, cy, *fine[2:]), patch, followed, start)


def _follow_content(
    state: PatchTrackerState, sampler: Sampler, expected: Pose, p: PatchTrackerParams
) -> tuple[Pose, float, F32]:
    """Where the content of the box went, how well that can be followed, and how much of it is kept there.

    Neither filter nor keyframes are asked: what they were taught is not what is seen.
    """
    g, model = state.geometry, state.model
    current = sampler.fine(expected).gray
    prior = g.weights * (np.float32(tuning.MASK_FLOOR) + model.means[2]) * body_weights(state)
    flow = _flow(model.previous, current, p, p.levels)
    followed = _followed(model.previous, current, flow, prior, g, p, p.separation)
    pose = _applied(expected, followed, g, 0.0)
    patch = sampler.fine(pose).gray
    before, coherence = coherence_with(state, current), coherence_with(state, patch)
    if coherence < before - tuning.WORSE:
        pose, patch, coherence = expected, current, before
    persistence = carried_along(state, followed, expected, pose, patch, p)
    share = tuning.COHERENCE_SLOPE * coherence / p.coherent - tuning.COHERENCE_OFFSET
    return pose, coherence, persistence * np.float32(min(max(share, 0.0), 1.0))


def _correct_by_keyframes(
    state: PatchTrackerState, sampler: Sampler, frame: Frame, carried: Carried, height: float, p: PatchTrackerParams
) -> tuple[Pose, list[float]]:
    """Pose drawn half-way to the best keyframe, and the agreement with each keyframe."""
    g, pose, scores = state.geometry, carried.pose, list(carried.patch.keys)
    best, found = scores.index(max(scores)), None
    candidate, score = _registered(state, sampler, best, carried.patch.gray, pose, carried.followed.planes[2], p)
    if score > scores[best]:
        scores[best], found = score, candidate if score > tuning.KEY_MATCH else None
    if scores[0] < p.reset_below:
        # Only the first keyframe's size is what the user drew.
        other = pose.scaled(tuning.ZOOMS[(state.good_frames + state.low) % len(tuning.ZOOMS)])
        reset, score = _registered(state, sampler, 0, sampler.fine(other).gray, other, g.weights, p)
        # A patch of a few blurred edges fits in many sizes; what surrounds it does not.
        if score > max(p.reset_match, scores[0] + p.reset_gain) and (
            peak_at(state, sampler, reset, reset, 0.0).seen.height > p.reset_level * height
        ):
            scores[0] = score
            return reset, scores
    if found is not None:
        pose = pose.moved(0.5 * (found.cx - pose.cx), 0.5 * (found.cy - pose.cy))
        pose = pose.scaled(math.sqrt(found.sx / pose.sx)).turned(0.5 * (found.angle - pose.angle))
    return _gate_scale(pose, state.pose, max(carried.patch.agreement, *scores), g, frame), scores


def _registered(
    state: PatchTrackerState, sampler: Sampler, key: int, current: F32, pose: Pose, prior: F32, p: PatchTrackerParams
) -> tuple[Pose, float]:
    """Pose to which the flow from a keyframe leads, and the agreement there; `current` is the patch at `pose`."""
    g, patch = state.geometry, state.model.keys[key]
    followed = _followed(patch, current, _flow(patch, current, p, p.key_levels), prior, g, p, -1.0)
    candidate = _applied(pose, followed, g, p.max_key_scale)
    return candidate, sampler.fine(candidate).keys[key]


def _gate_scale(pose: Pose, old: Pose, agreement: float, g: Geometry, frame: Frame) -> Pose:
    factor = (pose.sx / old.sx) ** min(max((agreement - tuning.SIZE_FROM) / tuning.SIZE_SPAN, 0.0), 1.0)
    side = math.sqrt(g.w * g.h * old.sx * old.sy) * factor
    if not tuning.MIN_SIDE <= side <= tuning.MOST_OF_FRAME * max(frame.width, frame.height):
        factor = 1.0
    return Pose(pose.cx, pose.cy, old.sx * factor, old.sy * factor, pose.angle)


def _verdict(
    state: PatchTrackerState,
    frame: Frame,
    pose: Pose,
    expected: Pose,
    chance: float,
    best_key: float,
    p: PatchTrackerParams,
) -> str:
    """Believe the pose and learn, only follow, or reject it.

    `chance` is that of the pose's overlap with the object by more than half, `best_key` the agreement with the best
    keyframe.
    """
    jump = jump_from(state.geometry, pose, expected)
    if _visible(box_at(state.geometry, pose), frame) < tuning.LEAST_VISIBLE:
        return _BAD
    if jump < p.far and state.low <= p.patience:
        believed = chance > p.sure
    else:
        believed = chance > p.far_sure and best_key > p.far_match
    if believed:
        return _GOOD
    if jump >= p.near or chance < p.follow:
        return _BAD
    return _UNSURE if chance > p.doubt and state.low <= p.patience else _WEAK


def _visible(box: Box, frame: Frame) -> float:
    """Share of a box inside the frame."""
    return box.clip(frame.width, frame.height).area / box.area


def _next_pose(
    state: PatchTrackerState, pose: Pose, coarse: Pose, verdict: str, p: PatchTrackerParams
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
        return old._replace(cx=coarse.cx, cy=coarse.cy), (tuning.COAST * vx, tuning.COAST * vy), low
    low = state.low + 1
    if low > p.patience:
        return old, (0.0, 0.0), low
    return old.moved(vx, vy), (tuning.COAST * vx, tuning.COAST * vy), low


def _learn(
    model: Model,
    means: F32,
    sampler: Sampler,
    g: Geometry,
    pose: Pose,
    agreement: float,
    best_key: float,
    persistence: float,
    p: PatchTrackerParams,
) -> Model:
    histograms = model.histograms
    located = finders.learn(model.located, sampler.scene(pose))
    if histograms is not None:
        histograms = sampler.learned_colours(pose, histograms, p.colour_rate)
    keys, age = model.keys, model.key_age + 1
    if (
        best_key < tuning.KEY_MATCH
        and agreement > tuning.NEW_KEY_AGREEMENT
        and persistence >= p.new_key
        and age >= p.key_gap
    ):
        keys, age = np.stack((keys[0], *keys[1:][2 - p.keys :], model.previous)), 0
    return Model(model.previous, means, keys, age, histograms, located)


def ride(state: PatchTrackerState, box: Box) -> PatchTrackerState:
    """Follow a box found by other means, without a look at the frame: what was learned stays as it is.

    The size follows slowly: another mode's box shrinks while its object goes out of sight, which is when this one
    is needed.

    Parameters
    ----------
    state : PatchTrackerState
        Not changed.
    box : Box
        Frame px; its shape may differ from the first one's.

    Returns
    -------
    PatchTrackerState
        At rest in the middle of `box`, not lost.
    """
    g, old = state.geometry, state.pose
    across, down = box.w / g.w, box.h / g.h
    if old.angle != 0.0:  # upright boxes of a turned object have other sides; their diagonal stays
        across = down = math.hypot(box.w, box.h) / math.hypot(g.w, g.h)
    pose = old._replace(
        cx=box.x + box.w / 2 - 0.5,
        cy=box.y + box.h / 2 - 0.5,
        sx=old.sx + tuning.RIDE_RATE * (across - old.sx),
        sy=old.sy + tuning.RIDE_RATE * (down - old.sy),
    )
    estimate = state.estimate.replace(box=box, ok=True)
    return state._replace(pose=pose, velocity=(0.0, 0.0), low=0, persistence=g.body, hint=None, estimate=estimate)


def teach(state: PatchTrackerState, frame: Frame, box: Box, params: PatchTrackerParams) -> PatchTrackerState:
    """Learn what the object looks like where other means have found it, but not how it moves on.

    Parameters
    ----------
    state : PatchTrackerState
        Not changed.
    frame : Frame
    box : Box
        Frame px; its shape may differ from the first one's.
    params : PatchTrackerParams

    Returns
    -------
    PatchTrackerState
        As after `ride`, with filter and peak of this frame.
    """
    ridden = ride(state, box)
    sampler = Sampler(frame, ridden.geometry, ridden.pose, state.model.templates, state.before)
    seen, located = finders.find_and_learn(state.model.located, sampler.scene(ridden.pose))
    located = finders.with_unrest(located, seen.change)
    model = state.model._replace(previous=sampler.fine(ridden.pose).gray, located=located)
    good_frames = state.good_frames + 1
    peak = _followed_peak(state.peak, seen.height, good_frames)
    return ridden._replace(model=model, peak=peak, good_frames=good_frames, before=sampler.part)


def seek(state: PatchTrackerState, frame: Frame, params: PatchTrackerParams) -> PatchTrackerState:
    """Look for the object all over the frame, whether or not it was lost before.

    Parameters
    ----------
    state : PatchTrackerState
        Not changed.
    frame : Frame
    params : PatchTrackerParams

    Returns
    -------
    PatchTrackerState
    """
    return step(state._replace(velocity=(0.0, 0.0), low=max(state.low, params.patience + 1)), frame, params)


def turned(state: PatchTrackerState, angle: float) -> PatchTrackerState:
    """Expect the object turned, as another mode has seen it turn; whether it has is found out in the next `step`.

    Parameters
    ----------
    state : PatchTrackerState
        Not changed.
    angle : float
        Since the last frame, radians from x towards y.

    Returns
    -------
    PatchTrackerState
    """
    return state._replace(pose=state.pose.turned(angle)) if abs(angle) >= tuning.LEAST_TURN else state


def dismiss(before: PatchTrackerState, after: PatchTrackerState) -> PatchTrackerState:
    """The state after a frame in which what it found turned out to be something else: still searching.

    Parameters
    ----------
    before, after : PatchTrackerState
        Searching, and found by mistake.

    Returns
    -------
    PatchTrackerState
    """
    estimate = after.estimate.replace(box=before.estimate.box, ok=False, score=0.0)
    return before._replace(low=before.low + 1, estimate=estimate)
