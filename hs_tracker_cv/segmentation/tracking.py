"""One frame of the two-layer model: start, step, reseed, watch."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames import Frame
from ..geometry import Box
from . import labelling, memory, motion, tuning
from . import mask as masks
from . import occlusion as hiding
from .departure import beginning
from .labelling import Expected, Labels, VisiblePart
from .memory import Learned
from .state import Occlusion, SegmentationEstimate, SegmentationParams, SegmentationState
from .window import Window, cut_window, grab, lattice_step, place_window, window_box

__all__ = ["reseed", "start", "step", "watch"]


class _Outcome(NamedTuple):
    """What one frame says about the object: where it is (window px), how it moves on, what hides it."""

    box: Box
    velocity: tuple[float, float]
    linear: tuple[float, float, float, float]
    occlusion: Occlusion
    share: float


def start(frame: Frame, box: Box, params: SegmentationParams) -> SegmentationState:
    """Begin with the object inside `box`.

    Parameters
    ----------
    frame : Frame
    box : Box
        Frame px.
    params : SegmentationParams

    Returns
    -------
    SegmentationState
        Its estimate is the box itself.
    """
    k = lattice_step(max(box.w, box.h), params.working_size)
    small = _to_lattice(box, k)
    origin, size = place_window(small, (0.0, 0.0), _margin(small, 0, 0, params), _extent(frame, k))
    image, gray = grab(frame, origin, size, k)
    seed = memory.seed(image, small, origin)
    mask = (seed.odds > 0).view(np.uint8)
    estimate = SegmentationEstimate(
        box=box,
        ok=True,
        score=1.0,
        occluded=False,
        unexplained=0.0,
        mask=mask,
        window=window_box(origin, size, k),
        step=float(k),
        previous=gray,
        current=gray,
        flow=np.zeros((*size, 2), np.float32),
        camera=(0.0, 0.0),
    )
    return SegmentationState(
        estimate=estimate,
        count=0,
        step=k,
        origin=origin,
        box=small,
        velocity=(0.0, 0.0),
        linear=(0.0, 0.0, 0.0, 0.0),
        camera=(0.0, 0.0),
        previous=image,
        gray=gray,
        odds=seed.odds,
        shape=seed.shape,
        obj=image,
        distractor=None,
        visible=None,
        atlas=seed.atlas,
        colours=seed.colours,
        begun=beginning(image, small, origin),
    )


def step(state: SegmentationState, frame: Frame, params: SegmentationParams) -> SegmentationState:
    """Follow the object into the next frame.

    Parameters
    ----------
    state : SegmentationState
        Left as it is.
    frame : Frame
        Of the same size and channel count as the first one.
    params : SegmentationParams

    Returns
    -------
    SegmentationState
    """
    window = cut_window(state, frame)
    moves = motion.find(state, window, params)
    expected, evidence = labelling.predict_layers(state, window, moves)
    in_front = labelling.in_front(state, window, moves, expected)
    if state.occlusion.occluded or state.occlusion.coasting:
        shift = _search(state, window, expected, evidence[0], in_front)
        if shift != (0, 0):
            expected, moves = labelling.displace(expected, shift), motion.displace(moves, shift)
            evidence = labelling.measure_evidence(state, window, expected, moves)
    labels, visible = labelling.assign(state, window, expected, moves, evidence, in_front, params)
    outcome = _outcome(state, moves, expected, visible, in_front, evidence.alike, params)
    hidden = outcome.occlusion.occluded or outcome.occlusion.coasting > 0
    learned = memory.learn_frame(
        state, window, moves, expected, labels, hidden=hidden, suspected=outcome.occlusion.suspected > 0
    )
    return _next_state(state, frame, window, moves, labels, learned, outcome, params)


def watch(state: SegmentationState, frame: Frame, box: Box, params: SegmentationParams) -> SegmentationState:
    """Follow camera and background only, while another tracker says where the object is.

    Gives the measurements of trust at a fraction of the cost of `step`; the state is ready for a `step` that takes
    over from `box`.

    Parameters
    ----------
    state : SegmentationState
        Left as it is.
    frame : Frame
        Of the same size and channel count as the first one.
    box : Box
        Where the object is in this frame, frame px.
    params : SegmentationParams

    Returns
    -------
    SegmentationState
    """
    window = cut_window(state, frame)
    small = _to_lattice(box, state.step)
    seed = memory.seed(window.image, small, state.origin)
    speed = tuple(
        new + side / 2 - old - length / 2
        for new, side, old, length in zip(small[:2], small[2:], state.box[:2], state.box[2:], strict=True)
    )
    mask = (seed.odds > 0).view(np.uint8)
    moves = motion.follow(state, window, seed.odds, (speed[0], speed[1]), params)
    expected = labelling.predict_ground(state, window, moves, seed.odds)
    errors, _, _ = labelling.measure_evidence(state, window, expected, moves)
    labels = Labels(mask, seed.odds, seed.odds, errors, None, seed.bins)
    learned = memory.learn_frame(state, window, moves, expected, labels, hidden=False, suspected=False)
    learned = learned._replace(odds=seed.odds, shape=seed.shape, obj=window.image, colours=seed.colours)
    local = Box(small[0] - state.origin[0], small[1] - state.origin[1], small[2], small[3])
    outcome = _Outcome(local, (speed[0], speed[1]), (0.0, 0.0, 0.0, 0.0), Occlusion(), 1.0)
    return _next_state(state.replace(begun=None), frame, window, moves, labels, learned, outcome, params)


def reseed(state: SegmentationState, frame: Frame, box: Box, params: SegmentationParams) -> SegmentationState:
    """Begin the object anew from a box and keep the memory of the background: a hand-over from another tracker.

    Parameters
    ----------
    state : SegmentationState
        After `frame`; left as it is.
    frame : Frame
        The frame just seen.
    box : Box
        Where the object is in it, frame px.
    params : SegmentationParams

    Returns
    -------
    SegmentationState
        Its estimate is that of the old state, with the new box.
    """
    small = _to_lattice(box, state.step)
    moved = state.replace(box=small, velocity=(0.0, 0.0), linear=(0.0, 0.0, 0.0, 0.0), occlusion=Occlusion(), count=0)
    moved = _advance(moved, frame, params)
    seed = memory.seed(moved.previous, moved.box, moved.origin)
    return moved.replace(
        estimate=state.estimate.replace(box=box, ok=True, score=1.0, occluded=False),
        odds=seed.odds,
        shape=seed.shape,
        obj=moved.previous,
        distractor=None,
        visible=None,
        colours=seed.colours,
        contrast=0.0,
        match_cost=0.0,
        begun=beginning(moved.previous, moved.box, moved.origin),
    )


def belongs(state: SegmentationState, width: int, height: int, params: SegmentationParams) -> bool:
    """Tell whether a state that comes from elsewhere can be one of frames of that size, px.

    Its window shows a part of the frame, and its pixels are no larger than the largest object asks for.
    """
    if state.step > lattice_step(max(width, height), params.working_size):
        return False
    (x, y), (h, w), k = state.origin, state.gray.shape, state.step
    return 0 <= x + w and x * k <= width and 0 <= y + h and y * k <= height


def _to_lattice(box: Box, k: int) -> tuple[float, float, float, float]:
    return box.x / k, box.y / k, box.w / k, box.h / k


def _extent(frame: Frame, k: int) -> tuple[float, float]:
    return frame.width / k, frame.height / k


def _margin(box: tuple[float, float, float, float], count: int, coasting: int, params: SegmentationParams) -> float:
    """Window round the box, lattice px: wider at first, its motion being unknown, and while the object is unseen."""
    share = params.margin * max(box[2], box[3])
    if count == 0:
        return max(tuning.FIRST_MARGIN, 2.0 * share)
    if coasting:
        return max(tuning.UNSEEN_MARGIN, share + min(coasting, tuning.FAR))
    return max(tuning.LEAST_MARGIN, share)


def _search(
    state: SegmentationState,
    window: Window,
    expected: Expected,
    errors: NDArray[np.float32],
    in_front: masks.Mask | None,
) -> tuple[int, int]:
    """Where a hidden object comes out again, relative to where it was expected."""
    reach = tuning.NEARBY + state.occlusion.coasting + tuning.PER_SUSPECTED * state.occlusion.suspected
    reach = int(min(reach, tuning.FAR))
    different = (errors[1] >= tuning.DIFFERENT).view(np.uint8)
    if in_front is not None:
        different &= 1 - in_front
    return hiding.find_again(window.image, expected.obj, expected.shape, different, reach, state.noise, window.inside)


def _outcome(
    state: SegmentationState,
    moves: motion.Moves,
    expected: Expected,
    visible: VisiblePart,
    in_front: masks.Mask | None,
    alike: float,
    params: SegmentationParams,
) -> _Outcome:
    """Occlusion, box and motion after labelling."""
    was_hidden = state.occlusion.coasting > 0
    usable = moves.contrast >= tuning.USABLE_CONTRAST and state.count >= tuning.SHAPE_YOUNG
    share = hiding.visible_share(visible.area, visible.both, visible.seen, hidden=was_hidden)
    vanished = moves.misfit > (tuning.BACK if state.occlusion.vanished else tuning.GONE) or (
        alike < tuning.ALIKE * share and usable and (state.occlusion.vanished or not state.occlusion.occluded)
    )
    if vanished:  # what is there is not the object, whatever it may be
        share = min(share, 1.0 - moves.misfit)
    box = visible.box
    covered = False
    if in_front is not None:
        shape = expected.shape > 0.5
        covered = bool(np.count_nonzero(shape & (in_front != 0)) > tuning.COVERED * np.count_nonzero(shape))
    on_lattice = None if box is None else box.moved(*state.origin)
    occlusion = hiding.updated(
        state.occlusion, on_lattice, moves.velocity, moves.camera, share, usable, covered, params
    )
    unseen = (share < tuning.UNSEEN and usable) or vanished or box is None
    occlusion = occlusion._replace(coasting=state.occlusion.coasting + 1 if unseen else 0, vanished=vanished)
    hidden = occlusion.occluded or unseen
    whole = masks.outer_box((expected.shape > 0.5).view(np.uint8)) if hidden else None
    if whole is not None:
        if occlusion.occluded and not state.occlusion.occluded:
            occlusion = hiding.with_missing(occlusion, whole)
        box = hiding.amodal(occlusion, whole) if occlusion.occluded else whole
    if box is None:
        x, y, w, h = state.box
        box = Box(x - state.origin[0], y - state.origin[1], w, h).moved(*moves.velocity)
    return _Outcome(
        box, _next_velocity(state, moves, occlusion, params), _next_linear(state, moves, hidden), occlusion, share
    )


def _next_velocity(
    state: SegmentationState, moves: motion.Moves, occlusion: Occlusion, params: SegmentationParams
) -> tuple[float, float]:
    (vx, vy), (mx, my) = state.velocity, moves.velocity
    if occlusion.occluded and not state.occlusion.occluded:
        vx, vy = hiding.remembered_speed(occlusion)
        return vx + moves.camera[0], vy + moves.camera[1]
    if occlusion.coasting:
        slow = tuning.COAST_SLOWDOWN if occlusion.coasting > params.max_coast else 1.0
        return vx * slow, vy * slow
    rate = tuning.HIDDEN_RATE if occlusion.occluded else tuning.MOTION_RATE
    return vx + rate * (mx - vx), vy + rate * (my - vy)


def _next_linear(state: SegmentationState, moves: motion.Moves, hidden: bool) -> tuple[float, float, float, float]:
    if hidden:
        return 0.0, 0.0, 0.0, 0.0
    a, b, c, d = (
        tuning.LINEAR_RATE * (old + float(moves.theta[i]) / moves.grid.scale)
        for old, i in zip(state.linear, (1, 2, 4, 5), strict=True)
    )
    return a, b, c, d


def _chance(share: float, unexplained: float, misfit: float) -> float:
    """Probability that the box is right (IoU above one half), 0–1.

    Logistic in the logarithms of the visible share of the object and of the share of the background that is not
    explained; fitted on the suites develop and vanish_develop. Offsets keep the logarithms finite. An object that
    hardly looks like itself any more is about to be lost.
    """
    visible = tuning.SCORE_VISIBLE * math.log(share + tuning.VISIBLE_FLOOR)
    strange = tuning.SCORE_UNEXPLAINED * math.log(unexplained + tuning.UNEXPLAINED_FLOOR)
    seen = 1.0 / (1.0 + math.exp(-tuning.SCORE_OFFSET - visible + strange))
    return seen * min((1.0 - misfit) / tuning.ALIKE_ENOUGH, 1.0)


def _estimate(
    state: SegmentationState,
    place: tuple[float, float],
    window: Window,
    moves: motion.Moves,
    labels: Labels,
    learned: Learned,
    outcome: _Outcome,
) -> SegmentationEstimate:
    """What the frame gave; `place` is the top-left of the box, lattice px."""
    # a single frame in which the mask fails is forgiven, one in which nothing at all is seen is not
    k, (x, y), hidden = state.step, place, outcome.occlusion
    ok = hidden.coasting == 0 or (hidden.coasting == 1 and not hidden.vanished and outcome.share > tuning.NOTHING)
    return SegmentationEstimate(
        box=Box(x * k, y * k, outcome.box.w * k, outcome.box.h * k),
        ok=ok,
        score=_chance(outcome.share, learned.unexplained, moves.misfit) if ok else 0.0,
        occluded=hidden.occluded,
        unexplained=learned.unexplained,
        mask=labels.mask,
        window=window_box(state.origin, window.gray.shape, k),
        step=float(k),
        previous=window.previous,
        current=window.gray,
        flow=moves.flow,
        camera=(moves.camera[0] * k, moves.camera[1] * k),
    )


def _next_state(
    state: SegmentationState,
    frame: Frame,
    window: Window,
    moves: motion.Moves,
    labels: Labels,
    learned: Learned,
    outcome: _Outcome,
    params: SegmentationParams,
) -> SegmentationState:
    """All that was learned, in the window of the next frame."""
    x, y = outcome.box.x + state.origin[0], outcome.box.y + state.origin[1]
    rate = tuning.RESIDUAL_RATE if state.count else 1.0
    concluded = state.replace(
        estimate=_estimate(state, (x, y), window, moves, labels, learned, outcome),
        count=state.count + 1,
        box=(x, y, outcome.box.w, outcome.box.h),
        velocity=outcome.velocity,
        linear=outcome.linear,
        camera=moves.camera,
        odds=learned.odds,
        shape=learned.shape,
        obj=learned.obj,
        distractor=labels.distractor,
        visible=labels.mask & (labels.errors[0] > 0).view(np.uint8) if outcome.occlusion.occluded else None,
        atlas=learned.atlas,
        colours=learned.colours,
        noise=learned.noise,
        contrast=moves.contrast,
        match_cost=state.match_cost + rate * (moves.residual - state.match_cost),
        occlusion=outcome.occlusion,
        light=window.light,
    )
    return _advance(concluded, frame, params)


def _advance(state: SegmentationState, frame: Frame, params: SegmentationParams) -> SegmentationState:
    """Put the state into the window in which the object is expected next."""
    longest = min(max(state.box[2], state.box[3]), max(_extent(frame, state.step)))
    most, least = tuning.LARGEST * params.working_size, tuning.SMALLEST * params.working_size
    if longest > most or (state.step > 1 and longest < least):
        state = memory.rescale(state, lattice_step(longest * state.step, params.working_size))
    margin = _margin(state.box, state.count, state.occlusion.coasting, params)
    origin, size = place_window(state.box, state.velocity, margin, _extent(frame, state.step))
    return memory.move(state, grab(frame, origin, size, state.step, state.light), origin)
