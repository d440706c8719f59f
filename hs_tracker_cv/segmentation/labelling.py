"""Which pixels are the object: both layers as expected in this frame, the evidence for each, the mask."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._native.kernels import segmentation as kernels
from ..geometry import Box
from . import mask as masks
from . import motion, tuning
from .state import Image, Plane, SegmentationParams, SegmentationState
from .window import Window, shifted, shifted_mask, translated

__all__ = ["Expected", "Labels", "assign", "displace", "measure_evidence", "predict_ground", "predict_layers"]


class Expected(NamedTuple):
    """Both layers as they should look in this frame.

    background : image of the background memory.
    moved, carried : the last frame, moved by the camera and by the object's motion.
    odds, own, shape, obj : the object's log-odds, {odds > 0}, shape and image, moved by its motion.
    part : (x0, y0, x1, y1), where `obj` and `carried` are known; nothing outside can be the object but what is new.
    """

    background: Image
    moved: Image
    carried: Image
    odds: Plane
    own: masks.Mask
    shape: Plane
    obj: Image
    part: NDArray[np.int64]

    @property
    def native(self) -> kernels.Expected:
        """As the kernels have it."""
        return kernels.Expected(self.carried, self.obj, self.odds, self.shape, self.own, self.part)


class Evidence(NamedTuple):
    """Planes (4, h, w) of `evidence`, where something is new, and how much of the object looks as it did."""

    errors: NDArray[np.float32]
    fresh: masks.Mask
    alike: float

    @property
    def native(self) -> kernels.Evidence:
        """As the kernels have it."""
        return kernels.Evidence(self.errors, self.fresh)


class Labels(NamedTuple):
    """Mask of the object, log-odds behind it (with and without the edge and component steps), errors, colour bins."""

    mask: masks.Mask
    odds: Plane
    raw: Plane
    errors: NDArray[np.float32]
    distractor: masks.Mask | None
    bins: NDArray[np.int16]

    @property
    def native(self) -> kernels.Labels:
        """As the kernels have it."""
        return kernels.Labels(self.bins, self.raw, self.odds, self.mask, self.distractor)


class VisiblePart(NamedTuple):
    """What is visible of the object.

    Inside the frame the pixels of the remembered shape, those of them in the mask, and those of the mask; and the
    mask's box, window px: where the largest of the odds per row or column crosses zero.
    """

    area: int
    both: int
    seen: int
    box: Box | None


def predict_layers(state: SegmentationState, window: Window, moves: motion.Moves) -> tuple[Expected, Evidence]:
    """Move both layers to this frame, and weigh there what it shows."""
    h, w = state.odds.shape
    hidden = state.occlusion.occluded or state.occlusion.coasting > 0 or state.occlusion.suspected > 0
    # it may be looked for elsewhere, or be told from a second mover
    everywhere = hidden or state.distractor is not None
    expected = Expected(
        background=translated(moves.atlas.image, *moves.atlas.offset),
        moved=_ground_of_last(state, moves),
        carried=np.empty_like(state.previous),
        odds=np.empty_like(state.odds),
        own=np.empty((h, w), np.uint8),
        shape=np.empty_like(state.shape),
        obj=np.empty_like(state.obj),
        part=_whole(h, w) if everywhere else _reach(moves, h, w),
    )
    errors, fresh = np.empty((4, h, w), np.float32), np.empty((h, w), np.uint8)
    alike = kernels.warp_and_score(
        _scene(window, expected, moves),
        state.previous,
        kernels.Layer(state.obj, state.odds, state.shape),
        motion.inverse_matrix(moves.theta, moves.grid),
        everywhere,
        _likelihood(state, window, moves),
        expected.native,
        kernels.Evidence(errors, fresh),
    )
    return expected, Evidence(errors, fresh, alike)


def _ground_of_last(state: SegmentationState, moves: motion.Moves) -> Image:
    """The last frame moved by the camera, and nothing where the object surely was: no ground was seen there."""
    moved = translated(state.previous, *moves.camera)
    dx, dy = (-round(speed) for speed in moves.camera)
    out = np.empty_like(moved)
    kernels.without_object(moved, state.odds, dx, dy, tuning.SURELY_OBJECT, tuning.NOWHERE, out)
    return out


def predict_ground(state: SegmentationState, window: Window, moves: motion.Moves, odds: Plane) -> Expected:
    """Move the background alone; the object is where `odds` says and looks as it looks."""
    return Expected(
        background=translated(moves.atlas.image, *moves.atlas.offset),
        moved=translated(state.previous, *moves.camera),
        carried=window.image,
        odds=odds,
        own=(odds > 0).view(np.uint8),
        shape=(odds > 0).astype(np.float32),
        obj=window.image,
        part=_whole(*odds.shape),
    )


def _whole(h: int, w: int) -> NDArray[np.int64]:
    return np.array((0, 0, w, h), np.int64)


def _reach(moves: motion.Moves, h: int, w: int) -> NDArray[np.int64]:
    """Rectangle of what may be the object, with room for gradients and for sums over 5 × 5 pixels."""
    x0, y0, x1, y1 = motion.where_to(moves.extent, moves.theta, moves.grid)
    x0, x1 = min(max(int(x0) - tuning.REACH, 0), w), min(max(int(x1) + tuning.REACH + 1, 0), w)
    y0, y1 = min(max(int(y0) - tuning.REACH, 0), h), min(max(int(y1) + tuning.REACH + 1, 0), h)
    return np.array((x0, y0, max(x0, x1), max(y0, y1)), np.int64)


def displace(expected: Expected, shift: tuple[int, int]) -> Expected:
    """Move the object's part by whole pixels."""
    dx, dy = -shift[0], -shift[1]
    h, w = expected.odds.shape
    return expected._replace(
        own=shifted_mask(expected.own, dx, dy, (h, w)),
        odds=shifted(expected.odds, dx, dy, (h, w), tuning.NEVER),
        shape=shifted(expected.shape, dx, dy, (h, w), 0.0),
        obj=shifted(expected.obj, dx, dy, (h, w), 0.0),
        carried=shifted(expected.carried, dx, dy, (h, w), 0.0),
        part=_whole(h, w),
    )


def measure_evidence(state: SegmentationState, window: Window, expected: Expected, moves: motion.Moves) -> Evidence:
    """Evidence per pixel; see `evidence`."""
    h, w = window.gray.shape
    errors, fresh = np.empty((4, h, w), np.float32), np.empty((h, w), np.uint8)
    alike = kernels.evidence(
        _scene(window, expected, moves),
        expected.native,
        _likelihood(state, window, moves),
        kernels.Evidence(errors, fresh),
    )
    return Evidence(errors, fresh, alike)


def _scene(window: Window, expected: Expected, moves: motion.Moves) -> kernels.Scene:
    """Put this frame and the images that explain it together."""
    return kernels.Scene(window.image, window.inside, expected.moved, expected.background, _counts(moves))


def _counts(moves: motion.Moves) -> NDArray[np.float32]:
    """How well the evidence may take the background to be known."""
    return moves.atlas.counts


def _likelihood(state: SegmentationState, window: Window, moves: motion.Moves) -> kernels.Likelihood:
    """Numbers of the likelihoods, as `evidence` wants them."""
    tau = tuning.TAU_WHOLE if moves.atlas.offset == (0.0, 0.0) else tuning.TAU_FRACTION
    return kernels.Likelihood(
        ground_slope=tau**2,
        object_slope=tuning.TAU_OBJECT**2,
        channel_weight=tuning.KAPPA_COLOUR if window.colour else 1.0,
        contrast=moves.contrast,
        occluded=state.occlusion.occluded,
        noise=state.noise,
        ground_gains=tuning.GROUND_GAINS,
        object_gains=tuning.OBJECT_GAINS,
    )


def in_front(state: SegmentationState, window: Window, moves: motion.Moves, expected: Expected) -> masks.Mask | None:
    """Where the distractor of the last frame hides the object in this one."""
    return masks.follow_distractor(
        state.distractor, moves.flow, state.previous, window.image, expected.obj, state.noise
    )


def assign(
    state: SegmentationState,
    window: Window,
    expected: Expected,
    moves: motion.Moves,
    seen: Evidence,
    hiding: masks.Mask | None,
    params: SegmentationParams,
) -> tuple[Labels, VisiblePart]:
    """Mask of the object from the evidence, which is changed where the object grows or something else arrives."""
    h, w = window.gray.shape
    mask, foreign = np.empty((h, w), np.uint8), np.empty((h, w), np.uint8)
    raw, odds, bins = np.empty((h, w), np.float32), np.empty((h, w), np.float32), np.empty((h, w), np.int16)
    how = kernels.Labelling(
        colours=state.colours,
        colour_weight=params.colour_weight,
        noise=state.noise,
        least=tuning.LEAST_LEFT,
        growth=tuning.GROWTH,
        # what comes out from behind something may be the object itself
        emerging=bool(state.occlusion.occluded or state.occlusion.coasting),
        young=state.count <= 2,
    )
    labels = Labels(mask, odds, raw, seen.errors, foreign, bins)
    others, area, both, visible, edges = kernels.label(
        _scene(window, expected, moves), expected.native, seen.native, state.distractor, hiding, how, labels.native
    )
    box = Box.from_edges(*edges) if edges[0] < edges[2] else None
    return labels if others else labels._replace(distractor=None), VisiblePart(area, both, visible, box)
