"""What is remembered: seeded from a box, learned from a frame, moved into the next window."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .._native.kernels import segmentation as kernels
from . import background as ground
from . import colour, motion, tuning
from .labelling import Expected, Labels
from .state import Atlas, Image, Plane, SegmentationState
from .window import Picture, Window, shifted_mask, transformed, translated

__all__ = ["Learned", "Seed", "learn_frame", "move", "rescale", "seed"]


class Seed(NamedTuple):
    """What a box alone tells about a window."""

    odds: Plane
    shape: Plane
    atlas: Atlas
    colours: NDArray[np.float32]
    bins: NDArray[np.int16]


class Learned(NamedTuple):
    """What a frame has taught, and how well the background explained it."""

    odds: Plane
    shape: Plane
    obj: Image
    atlas: Atlas
    colours: NDArray[np.float32]
    noise: float
    unexplained: float


def seed(image: Image, box: tuple[float, float, float, float], origin: tuple[int, int]) -> Seed:
    """Log-odds, shape, background and colours from a box (lattice px): its ellipse is object, round it is ground."""
    h, w, _ = image.shape
    x = np.abs(np.arange(w) + 0.5 + origin[0] - box[0] - box[2] / 2) / (box[2] / 2)
    y = (np.abs(np.arange(h) + 0.5 + origin[1] - box[1] - box[3] / 2) / (box[3] / 2))[:, np.newaxis]
    square = np.maximum(x, y)
    ellipse = np.sqrt(x * x + y * y)
    odds = np.full((h, w), tuning.NEVER, np.float32)
    odds[square <= tuning.SEED_RIM] = tuning.SEED_RIM_ODDS
    odds[square <= 1.0] = tuning.SEED_BOX_ODDS
    odds[ellipse <= tuning.SEED_ELLIPSE] = tuning.SEED_ODDS
    counts = np.zeros((3, h, w), np.float32)
    counts[0] = np.where(square > 1.0, kernels.KNOWN, np.float32(0.0))
    bins = np.empty((h, w), np.int16)
    kernels.bin_colours(image, bins)
    core = ellipse <= tuning.SEED_COLOURS
    tally = [np.bincount(bins[where], minlength=colour.BINS) for where in (core, square > 1.0)]
    colours = colour.histograms(np.array(tally, np.float32))
    return Seed(odds, (odds > 0).astype(np.float32), Atlas(image, counts), colours, bins)


def learn_frame(
    state: SegmentationState,
    window: Window,
    moves: motion.Moves,
    expected: Expected,
    labels: Labels,
    *,
    hidden: bool,
    suspected: bool,
) -> Learned:
    """Update every memory from a labelled frame.

    Parameters
    ----------
    state : SegmentationState
    window, moves, expected, labels
        What is known of the frame.
    hidden : bool
        The object is covered: its shape is kept, and its image learned only where it is surely seen.
    suspected : bool
        It may be about to be: its shape is kept.
    """
    atlas = moves.atlas
    aligned = translated(window.image, -atlas.offset[0], -atlas.offset[1])
    h, w = window.gray.shape
    odds, shape = np.empty((h, w), np.float32), np.empty((h, w), np.float32)
    obj, picture, counts = np.empty_like(expected.obj), np.empty_like(atlas.image), np.empty_like(atlas.counts)
    colours = np.empty_like(state.colours)
    rate = max(tuning.COLOUR_RATE, 1.0 / (state.count + 2))  # the ground in a box just drawn is soon forgotten
    shape_rate = tuning.YOUNG_RATE if state.count < tuning.YOUNG else tuning.SHAPE_RATE
    known, strange, spread = kernels.learn(
        window.native,
        aligned,
        expected.native,
        labels.errors,
        labels.native,
        atlas.native,
        kernels.Learning(
            colours=state.colours,
            shape_rate=shape_rate,
            colour_rate=0.0 if hidden else rate,
            freeze=hidden or suspected,
            hidden=hidden,
        ),
        kernels.Memory(odds, obj, shape, picture, counts, colours),
    )
    if hidden:
        odds = tuning.HIDDEN_SLOPE * (expected.shape - np.float32(0.5))
        odds = np.clip(odds, tuning.HIDDEN_LEAST, tuning.HIDDEN_MOST).astype(np.float32)
    noise = state.noise
    if spread >= 0:
        change = min(max(tuning.SPREAD_TO_NOISE * spread, tuning.LEAST_NOISE), tuning.MOST_NOISE) - noise
        # too low a first guess would make the whole background look new, so it is corrected at once
        rate = tuning.NOISE_RATE
        noise += change * (max(rate, 1.0 / (state.count + 1)) if change > 0 else rate)
    learned = Atlas(picture, counts, atlas.offset)
    return Learned(odds, shape, obj, learned, colours, noise, strange / max(known, 1))


def move(state: SegmentationState, picture: Picture, origin: tuple[int, int]) -> SegmentationState:
    """State in another window, of which `picture` is the frame just seen."""
    dx, dy = origin[0] - state.origin[0], origin[1] - state.origin[1]
    image, gray = picture
    if (dx, dy) == (0, 0) and gray.shape == state.odds.shape:
        return state.replace(previous=image, gray=gray)
    h, w = gray.shape
    odds, shape, obj = np.empty((h, w), np.float32), np.empty((h, w), np.float32), np.empty((h, w, 3), np.float32)
    kernels.move_object(dx, dy, kernels.Layer(state.obj, state.odds, state.shape), kernels.Layer(obj, odds, shape))
    return state.replace(
        origin=origin,
        previous=image,
        gray=gray,
        odds=odds,
        shape=shape,
        obj=obj,
        distractor=None if state.distractor is None else shifted_mask(state.distractor, dx, dy, gray.shape),
        visible=None if state.visible is None else shifted_mask(state.visible, dx, dy, gray.shape),
        atlas=ground.move(state.atlas, dx, dy, image, odds),
    )


def rescale(state: SegmentationState, step: int) -> SegmentationState:
    """State on a lattice of another step: an object that has grown or shrunk keeps the cost of a frame bounded."""
    ratio = state.step / step
    h, w = (int(np.ceil(side * ratio)) for side in state.odds.shape)
    origin = (round(state.origin[0] * ratio), round(state.origin[1] * ratio))
    shift = [(old + 0.5) * ratio - 0.5 - new for old, new in zip(state.origin, origin, strict=True)]
    nearest = np.array(((ratio, 0.0, shift[0]), (0.0, ratio, shift[1])))

    def resample(array: NDArray[np.float32]) -> NDArray[np.float32]:
        return transformed(array, (ratio, 0.0, shift[0], 0.0, ratio, shift[1]), (h, w))

    def pick(array: NDArray[Any]) -> NDArray[Any]:
        out = cv2.warpAffine(array, nearest, (w, h), flags=cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
        return np.ascontiguousarray(out)

    counts = np.stack([pick(plane) for plane in state.atlas.counts])
    offset = (state.atlas.offset[0] * ratio, state.atlas.offset[1] * ratio)
    x, y, box_w, box_h = (side * ratio for side in state.box)
    return state.replace(
        step=step,
        origin=origin,
        box=(x, y, box_w, box_h),
        velocity=(state.velocity[0] * ratio, state.velocity[1] * ratio),
        camera=(state.camera[0] * ratio, state.camera[1] * ratio),
        odds=resample(state.odds),
        shape=resample(state.shape),
        obj=resample(state.obj),
        distractor=None if state.distractor is None else pick(state.distractor),
        visible=None if state.visible is None else pick(state.visible),
        atlas=Atlas(resample(state.atlas.image), counts, offset),
        occlusion=state.occlusion.rescaled(ratio),
        begun=None,
    )
