"""One frame of the two-layer model: start, step, reseed, watch."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..frames import Frame, to_gray
from ..geometry import Box
from . import background as ground
from . import colour
from . import mask as masks
from . import motion as motions
from . import occlusion as hiding
from .kernels import KNOWN, evidence, label, learn, local_products
from .state import Atlas, Image, LayersParams, LayersReport, LayersState, Occlusion, Plane
from .window import grab, inside_rectangle, lattice_step, place_window, shifted

__all__ = ["reseed", "start", "step", "watch"]

_TAU_OBJECT = 0.35  # object layer: error per unit of gradient, px
_TAU_WHOLE, _TAU_FRACTION = 0.15, 0.3  # background, camera at rest on whole pixels or between

# The 85th percentile of |I − B|, not the median: compression leaves most pixels alone and errs badly near edges. The
# factor is that of the median (1.3) where both tell the same, in Gaussian noise.
_SPREAD_TO_NOISE = 1.3 / 1.54


class _View(NamedTuple):
    """The window of this frame and all that does not change while it is interpreted."""

    image: Image
    gray: Plane
    previous: Plane
    inside: NDArray[np.int64]


class _Labels(NamedTuple):
    """What the evidence of one frame says."""

    mask: masks.Mask
    odds: Plane
    raw: Plane
    ratio: Plane
    errors: NDArray[np.float32]
    distractor: masks.Mask
    bins: NDArray[np.int16]


def start(frame: Frame, box: Box, params: LayersParams) -> LayersState:
    """Begin with the object inside `box`.

    Parameters
    ----------
    frame : Frame
    box : Box
        Frame px.
    params : LayersParams

    Returns
    -------
    LayersState
    """
    step_ = lattice_step(max(box.w, box.h), params.working_size)
    small = _to_lattice(box, step_)
    margin = _margin(small, 0, params)
    origin, size = place_window(small, (0.0, 0.0), margin, _extent(frame, step_))
    image = grab(frame, origin, size, step_)
    odds, shape, atlas, colours = _seed(image, small, origin)
    empty = np.zeros(size, np.uint8)
    gray = to_gray(image)
    inside_box = (odds > 0).view(np.uint8)
    report = LayersReport(
        box=box,
        ok=True,
        score=1.0,
        occluded=False,
        lost=False,
        unexplained=0.0,
        mismatch=0.0,
        stray=0.0,
        n_known=0,
        mask=inside_box,
        origin=(origin[0] * step_, origin[1] * step_),
        step=step_,
        previous=gray,
        current=gray,
        flow=np.zeros((*size, 2), np.float32),
        camera=(0.0, 0.0),
    )
    return LayersState(
        report=report,
        count=0,
        step=step_,
        origin=origin,
        box=small,
        velocity=(0.0, 0.0),
        linear=(0.0, 0.0, 0.0, 0.0),
        camera=(0.0, 0.0),
        previous=image,
        odds=odds,
        shape=shape,
        obj=image,
        distractor=empty,
        visible=inside_box,
        atlas=atlas,
        colours=colours,
    )


def _seed(
    image: Image, box: tuple[float, float, float, float], origin: tuple[int, int]
) -> tuple[Plane, Plane, Atlas, NDArray[np.float32]]:
    """Log-odds, shape, atlas and colour histograms from a box alone."""
    h, w, channels = image.shape
    x = np.abs(np.arange(w) + 0.5 + origin[0] - box[0] - box[2] / 2) / (box[2] / 2)
    y = (np.abs(np.arange(h) + 0.5 + origin[1] - box[1] - box[3] / 2) / (box[3] / 2))[:, np.newaxis]
    square = np.maximum(x, y)
    ellipse = np.sqrt(x * x + y * y)
    odds = np.select([ellipse <= 0.95, square <= 1.0, square <= 1.12], [1.0, 0.4, -2.0], -3.0).astype(np.float32)
    counts = np.zeros((3, h, w), np.float32)
    counts[0] = np.where(square > 1.0, KNOWN, 0)
    bins = np.empty((h, w), np.int16)
    blank = np.zeros((h, w), np.float32)
    count = colour.bin_count(channels)
    label(image, blank, blank.copy(), np.zeros((h, w), np.uint8), np.zeros(count, np.float32), 0.0, bins, blank.copy())
    tally = [np.bincount(bins[where], minlength=count) for where in (ellipse <= 0.9, square > 1.0)]
    colours = np.stack([colour.histogram(one.astype(np.float32)) for one in tally])
    return odds, (odds > 0).astype(np.float32), Atlas(image, counts), colours


def _to_lattice(box: Box, step: int) -> tuple[float, float, float, float]:
    return box.x / step, box.y / step, box.w / step, box.h / step


def _extent(frame: Frame, step: int) -> tuple[float, float]:
    return frame.width / step, frame.height / step


def _margin(box: tuple[float, float, float, float], coasting: int, params: LayersParams) -> float:
    share = params.margin * max(box[2], box[3])
    return max(12.0, share + min(coasting, 20)) if coasting else max(10.0, share)


def step(state: LayersState, frame: Frame, params: LayersParams) -> LayersState:
    """Follow the object into the next frame.

    Parameters
    ----------
    state : LayersState
        Left as it is.
    frame : Frame
        Of the same size as the first one.
    params : LayersParams

    Returns
    -------
    LayersState
    """
    view = _look(state, frame)
    obj = (state.odds > 0).view(np.uint8)
    x, y, w, h = state.box
    local = (x - state.origin[0], y - state.origin[1], w, h)
    grid = motions.grid_of(obj, local)
    weight = (state.visible if state.occlusion.occluded else obj).astype(np.float32)
    predicted = motions.predict(state, view.image, weight, grid, view.inside)

    near = masks.dilate(obj, 5)
    side = min(w, h)
    flow = motions.dense_flow(view.previous, view.gray, near, grid, predicted[0], state.camera, side, params)
    outside = near == 0
    camera = ground.camera_from_flow(flow, outside, state.camera)
    weight_outside = outside.astype(np.float32)
    registered = ground.register(state.atlas, view.image, weight_outside, camera, state.noise, view.inside)
    atlas = ground.fill_new(registered.atlas, view.image, state.odds)
    camera = registered.camera

    motion = motions.measure(
        state, view.image, view.previous, flow, weight, grid, predicted, camera, view.inside
    )
    motion = _restrain(state, motion, weight)
    return _interpret(state, frame, view, grid, motion, flow, camera, atlas, params)


def _look(state: LayersState, frame: Frame) -> _View:
    size = state.window()
    image = grab(frame, state.origin, size, state.step)
    return _View(
        image, to_gray(image), to_gray(state.previous), inside_rectangle(frame, state.origin, size, state.step)
    )


def _restrain(state: LayersState, motion: motions.Motion, weight: Plane) -> motions.Motion:
    """While hardly anything of the object is seen it moves as it did before."""
    hidden = state.occlusion.coasting > 0 or (
        state.occlusion.occluded and np.count_nonzero(weight) < 0.1 * state.box[2] * state.box[3]
    )
    theta = motion.theta.copy()
    if hidden:
        theta[:] = (state.velocity[0], 0, 0, state.velocity[1], 0, 0, 0, 0)
    return motion._replace(theta=theta)


def _interpret(
    state: LayersState,
    frame: Frame,
    view: _View,
    grid: motions.Grid,
    motion: motions.Motion,
    flow: NDArray[np.float32],
    camera: tuple[float, float],
    atlas: Atlas,
    params: LayersParams,
) -> LayersState:
    """Label the window with the motions found, and remember."""
    theta = motion.theta
    warped = motions.warp(state.odds, theta, grid, -3.0)
    shape = motions.warp(state.shape, theta, grid, 0.0)
    obj = motions.warp(state.obj, theta, grid, np.nan)
    background, seen = ground.shift(atlas.image, atlas.offset), atlas.counts[0]
    moved = ground.shift(state.previous, camera)
    relative = float(np.hypot(theta[0] - camera[0], theta[3] - camera[1]))
    relative += 0.2 * float(np.abs(theta[[1, 2, 4, 5]]).sum())
    contrast = max(min(relative / 0.4, 1.0), 0.9 * state.contrast)

    errors = _weigh(state, view, background, seen, moved, obj, warped, contrast, atlas.offset)
    hiding_now = state.occlusion.occluded or state.occlusion.coasting > 0
    if hiding_now:
        reach = int(min(8 + state.occlusion.coasting + 0.2 * state.occlusion.suspected, 30))
        different = (errors[1] >= 4.0).view(np.uint8)
        dx, dy = hiding.find_again(view.image, obj, shape, different, reach, state.noise, view.inside)
        if (dx, dy) != (0, 0):
            size = state.window()
            warped = shifted(warped, -dx, -dy, size, -3.0)
            shape = shifted(shape, -dx, -dy, size, 0.0)
            obj = shifted(obj, -dx, -dy, size, 0.0)
            theta = theta.copy()
            theta[0] += dx
            theta[3] += dy
            errors = _weigh(state, view, background, seen, moved, obj, warped, contrast, atlas.offset)
    labels = _label(state, view, background, seen, warped, errors, atlas, params)
    return _remember(
        state, frame, view, grid, theta, motion, flow, camera, atlas, background, warped, shape, obj, labels, contrast, params
    )


def _weigh(
    state: LayersState,
    view: _View,
    background: Image,
    seen: Plane,
    moved: Image,
    obj: Image,
    warped: Plane,
    contrast: float,
    offset: tuple[float, float],
) -> NDArray[np.float32]:
    """Run the evidence kernel; (5, h, w)."""
    h, w, channels = view.image.shape
    products = np.empty((h, w, 4), np.float32)
    local_products(view.image, background, obj, products)
    products = cv2.blur(products, (5, 5))
    errors = np.empty((5, h, w), np.float32)
    tau = _TAU_WHOLE if offset == (0.0, 0.0) else _TAU_FRACTION
    kappa = 1.8 if channels == 3 else 1.0
    knobs = np.array((tau**2, _TAU_OBJECT**2, kappa, contrast, float(state.occlusion.occluded)), np.float32)
    evidence(
        view.image, background, moved, obj, warped, seen, products, np.float32(state.noise), knobs, view.inside, errors
    )
    return errors


def _label(
    state: LayersState,
    view: _View,
    background: Image,
    seen: Plane,
    warped: Plane,
    errors: NDArray[np.float32],
    atlas: Atlas,
    params: LayersParams,
) -> _Labels:
    """Mask of the object from the evidence."""
    h, w = view.gray.shape
    grown, distractor = masks.grow(errors[1], seen, atlas.counts[2], warped, state.distractor, state.count)
    ratio, trust = colour.likelihood(state.colours, params.colour_weight)
    bins = np.empty((h, w), np.int16)
    raw = np.empty((h, w), np.float32)
    ll = errors[0]
    label(view.image, warped, ll, grown, ratio, trust, bins, raw)
    odds = raw.copy()
    mask = masks.component(odds, warped)
    odds[(odds > 0) & (mask == 0)] = -1.0
    odds[(distractor != 0) & (warped < 1.0)] = np.minimum(odds, -2.0)[(distractor != 0) & (warped < 1.0)]
    mask = masks.refine_edge(view.image, background, seen, mask, odds, state.noise)
    return _Labels(mask, odds, raw, ll, errors, distractor, bins)


def _remember(
    state: LayersState,
    frame: Frame,
    view: _View,
    grid: motions.Grid,
    theta: NDArray[np.float64],
    motion: motions.Motion,
    flow: NDArray[np.float32],
    camera: tuple[float, float],
    atlas: Atlas,
    background: Image,
    warped: Plane,
    shape: Plane,
    obj: Image,
    labels: _Labels,
    contrast: float,
    params: LayersParams,
) -> LayersState:
    """Judge occlusion, find the box, learn, and put everything into the next frame's window."""
    memory = state.occlusion
    mask, errors = labels.mask, labels.errors
    share, in_view = hiding.visible_share(mask, shape, view.inside)
    moved = (float(theta[0]), float(theta[3]))
    local = masks.box_of(mask, labels.odds, True)
    lattice_box = None if local is None else local.moved(*state.origin)
    usable = contrast >= 0.2
    memory = hiding.judge(memory, lattice_box, moved, camera, share, usable, params)
    began = memory.occluded and not state.occlusion.occluded
    unseen = (share < 0.2 and state.count > 3 and usable) or local is None
    coasting = state.occlusion.coasting + 1 if unseen else 0
    memory = replace(memory, coasting=coasting)

    odds = labels.odds
    hidden = memory.occluded or coasting > 0
    velocity = (0.4 * state.velocity[0] + 0.6 * moved[0], 0.4 * state.velocity[1] + 0.6 * moved[1])
    linear = tuple(0.5 * (old + float(theta[i]) / grid.scale) for old, i in zip(state.linear, (1, 2, 4, 5), strict=True))
    if began:
        vx, vy = hiding.remembered_speed(memory)
        velocity = (vx + camera[0], vy + camera[1])
    elif coasting:
        slow = 0.9 if coasting > 20 else 1.0
        velocity = (state.velocity[0] * slow, state.velocity[1] * slow)
    elif memory.occluded:
        velocity = tuple(v + 0.05 * (m - v) for v, m in zip(state.velocity, moved, strict=True))
    if hidden:
        linear = (0.0, 0.0, 0.0, 0.0)
        whole = masks.box_of((shape > 0.5).view(np.uint8), shape, False)
        if whole is not None:
            local = whole
    if local is None:
        x, y, w, h = state.box
        local = Box(x - state.origin[0], y - state.origin[1], w, h).moved(*moved)

    picture, counts = atlas.image.copy(), atlas.counts.copy()
    aligned = ground.shift(view.image, (-atlas.offset[0], -atlas.offset[1]))
    near = masks.dilate(mask | (warped > 0).view(np.uint8), 5)
    size = state.window()
    s_out, m_out = np.empty(size, np.float32), np.empty(size, np.float32)
    o_out = np.empty_like(obj)
    tally = np.zeros(state.colours.shape, np.float32)
    sums = np.zeros(4)
    freeze = hidden or memory.suspected > 0
    knobs = np.array((0.3 if state.count < 12 else 0.08, float(freeze), float(hidden)), np.float32)
    learn(
        view.image, aligned, mask, near, odds, labels.raw, warped, obj, shape, errors, labels.bins, view.inside, knobs,
        s_out, o_out, m_out, picture, counts, tally, np.empty(2000, np.float32), sums,
    )  # fmt: skip
    if hidden:
        s_out = np.clip(8.0 * (shape - np.float32(0.5)), -2.0, 1.0).astype(np.float32)
    colours = state.colours if hidden else colour.blend(state.colours, tally, 0.1)
    known, strange, total, spread = (float(value) for value in sums)
    noise = state.noise
    if spread >= 0:
        noise += 0.2 * (min(max(_SPREAD_TO_NOISE * spread, 1.2), 14.0) - noise)

    stray = _stray(flow, near, camera, contrast)
    ok = coasting < 2
    box = Box(local.x + state.origin[0], local.y + state.origin[1], local.w, local.h)
    k = state.step
    report = LayersReport(
        box=Box(box.x * k, box.y * k, box.w * k, box.h * k),
        ok=ok,
        score=float(min(share, 1.0)) if ok else 0.0,
        occluded=memory.occluded,
        lost=not ok,
        unexplained=float(strange / max(known, 1)),
        mismatch=float(total / max(known, 1)),
        stray=stray,
        n_known=int(known),
        mask=mask,
        origin=(state.origin[0] * k, state.origin[1] * k),
        step=k,
        previous=view.previous,
        current=view.gray,
        flow=flow,
        camera=(camera[0] * k, camera[1] * k),
    )
    rate = 0.15 if state.count else 1.0
    return _advance(
        state.replace(
            report=report,
            count=state.count + 1,
            box=(box.x, box.y, box.w, box.h),
            velocity=velocity,
            linear=linear,
            camera=camera,
            odds=s_out,
            shape=m_out,
            obj=o_out,
            distractor=labels.distractor,
            visible=mask & (labels.ratio > 0).view(np.uint8),
            atlas=Atlas(picture, counts, atlas.offset),
            colours=colours,
            noise=noise,
            contrast=contrast,
            match_cost=state.match_cost + rate * (motion.residual - state.match_cost),
            occlusion=memory,
        ),
        frame,
        params,
    )


def _stray(flow: NDArray[np.float32], near: masks.Mask, camera: tuple[float, float], contrast: float) -> float:
    """c: how far the flow outside the object is from the camera's, over the motion contrast."""
    chosen = flow[::3, ::3][near[::3, ::3] == 0]
    if len(chosen) == 0:
        return 0.0
    return float(np.median(np.hypot(chosen[:, 0] - camera[0], chosen[:, 1] - camera[1]))) / max(contrast, 0.1)


def _advance(state: LayersState, frame: Frame, params: LayersParams) -> LayersState:
    """Move all windows to where the object is expected next."""
    margin = _margin(state.box, state.occlusion.coasting, params)
    origin, size = place_window(state.box, state.velocity, margin, _extent(frame, state.step))
    dx, dy = origin[0] - state.origin[0], origin[1] - state.origin[1]
    previous = grab(frame, origin, size, state.step)
    odds = shifted(state.odds, dx, dy, size, -3.0)
    atlas = ground.fill_new(ground.move(state.atlas, dx, dy, size), previous, odds)
    obj = shifted(state.obj, dx, dy, size, 0.0)
    return state.replace(
        origin=origin,
        previous=previous,
        odds=odds,
        shape=shifted(state.shape, dx, dy, size, 0.0),
        obj=obj,
        distractor=shifted(state.distractor, dx, dy, size, 0),
        visible=shifted(state.visible, dx, dy, size, 0),
        atlas=atlas,
    )


def reseed(state: LayersState, frame: Frame, box: Box, params: LayersParams) -> LayersState:
    """Begin the object anew from a box and keep the background memory; a hand-over from another tracker."""
    return start(frame, box, params)


def watch(state: LayersState, frame: Frame, box: Box, params: LayersParams) -> LayersState:
    """Follow camera and background only, the object being in `box`; gives the measurements of trust."""
    return step(state, frame, params)
