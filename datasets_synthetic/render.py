"""From a spec to pictures and truth.

The truth (boxes, coverage, labels) comes from the poses; the finished pixels are never looked at. Edges are
exact across a row and sampled eight times down a column.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .effects import BLANKS, EFFECTS, ORDER, SURFACE_EFFECTS, box_blur, to_bytes, to_words
from .pose import PartPose, Stage, stage_of
from .sequence import Sequence
from .spec import Actor, SequenceSpec, Texture
from .textures import paint, resample, sample

__all__ = ["Truth", "coverage", "frames", "objects", "render", "truth"]

Image = NDArray[np.float32]
Frame = NDArray[np.uint8] | NDArray[np.uint16]

_SUBROWS = 8
_BLUR_SAMPLES = 7


def coverage(outline: NDArray[np.float64], x0: int, y0: int, width: int, height: int) -> Image:
    """Share of each pixel that a simple polygon covers.

    Parameters
    ----------
    outline : ndarray, shape (N, 2)
        Corners, px.
    x0, y0, width, height : int
        The window of pixels.

    Returns
    -------
    ndarray, shape (height, width), float32
        In [0, 1]. Each crossing of an edge with a subrow adds the share of the pixels right of it, signed by the
        edge's direction; the sum along the row is the covered share.
    """
    ys = y0 + (np.arange(height * _SUBROWS) + 0.5) / _SUBROWS
    a, b = outline, np.roll(outline, -1, axis=0)
    crosses = (a[:, 1] <= ys[:, np.newaxis]) != (b[:, 1] <= ys[:, np.newaxis])
    row, edge = np.nonzero(crosses)
    share = (ys[row] - a[edge, 1]) / (b[edge, 1] - a[edge, 1])
    x = np.clip(a[edge, 0] + share * (b[edge, 0] - a[edge, 0]) - x0, 0.0, width)
    sign = np.where(b[edge, 1] > a[edge, 1], 1.0, -1.0) / _SUBROWS
    column = np.floor(x).astype(np.int64)
    within = x - column
    cell = (row // _SUBROWS) * (width + 2) + column
    count = height * (width + 2)
    step = np.bincount(cell, sign * (1.0 - within), count) + np.bincount(cell + 1, sign * within, count)
    total = np.cumsum(step.reshape(height, width + 2), axis=1)[:, :width]
    return np.clip(np.abs(total), 0.0, 1.0).astype(np.float32)


@dataclass(eq=False)
class _Skin:
    """Painted picture of an actor, centred on it; (x, y) texels per px."""

    image: Image
    morph: Image | None
    density: tuple[float, float]
    closed: bool

    @cached_property
    def mean(self) -> Image:
        return np.asarray(self.image.mean(axis=(0, 1)), dtype=np.float32)

    def colour(self, x: NDArray[np.float64], y: NDArray[np.float64], s: float) -> Image:
        column = x * self.density[0] + self.image.shape[1] / 2.0 - 0.5
        row = y * self.density[1] + self.image.shape[0] / 2.0 - 0.5
        first = sample(self.image, column, row, closed=self.closed)
        if self.morph is None:
            return first
        share = np.float32(s)
        return first * (1 - share) + sample(self.morph, column, row, closed=self.closed) * share


def _skin(actor: Actor, zoom: float) -> _Skin:
    density = max(1.0, max(actor.motion.growth) * zoom)
    # A thing that turns shows its whole circumference, which closes upon itself.
    closed = any(deform.kind == "turn" for deform in actor.deform)
    around = actor.size[0] * (math.pi if closed else 1.2)
    width, height = math.ceil(around * density), int(actor.size[1] * density * 1.2) + 4

    def picture(texture: Texture) -> Image:
        return paint(texture, height, width)

    morph = picture(actor.morph) if actor.morph else None
    return _Skin(picture(actor.texture), morph, (width / around, density), closed)


@dataclass(eq=False)
class _Canvas:
    """A picture in the making (or none), with what is seen where."""

    image: Image | None
    labels: NDArray[np.uint8]
    target: Image
    unhidden: float = 0.0
    """Area of the target within the frame before anything came in front of it, px²."""


class _Painter:
    """Draws the moments of one sequence; truth is that of the actor `followed`, the target by default."""

    def __init__(self, spec: SequenceSpec, followed: int | None = None) -> None:
        self.spec = spec
        self.stage: Stage = stage_of(spec)
        self.followed = self.stage.target_index if followed is None else followed
        self.width, self.height = spec.size

    @cached_property
    def skins(self) -> list[_Skin]:
        """Painted picture of each actor."""
        zoom = max(self.spec.camera.zoom)
        return [_skin(actor, zoom) for actor in self.stage.actors]

    @cached_property
    def _world(self) -> tuple[Image, int, int]:
        """Background picture large enough for every view, and the world px of its top-left corner."""
        xs, ys = np.array([0.0, self.width, 0.0, self.width]), np.array([0.0, 0.0, self.height, self.height])
        views = [self.stage.camera(t).to_world(xs, ys) for t in range(self.spec.frames)]
        low = np.floor(np.min([[x.min(), y.min()] for x, y in views], axis=0)).astype(int) - 2
        high = np.ceil(np.max([[x.max(), y.max()] for x, y in views], axis=0)).astype(int) + 2
        if self.stage.still and self.spec.camera.zoom[0] == 1.0 and self.spec.camera.roll[0] == 0.0:
            low, high = low + 2, high - 2
        picture = paint(self.spec.scene.background, int(high[1] - low[1]), int(high[0] - low[0]))
        return picture, int(low[0]), int(low[1])

    def _view(self, t: float) -> Image:
        picture, x0, y0 = self._world
        camera = self.stage.camera(t)
        xs, ys = np.arange(self.width, dtype=np.float64) + 0.5, np.arange(self.height, dtype=np.float64) + 0.5
        if camera.roll:
            wx, wy = camera.to_world(*np.meshgrid(xs, ys))
            return sample(picture, wx - 0.5 - x0, wy - 0.5 - y0)
        wx, _ = camera.to_world(xs, xs)
        _, wy = camera.to_world(ys, ys)
        # A whole-pixel pan must stay whole in floating point: it is then an exact copy.
        return resample(picture, np.round(wy - 0.5 - y0, 9), np.round(wx - 0.5 - x0, 9))

    @cached_property
    def _still_view(self) -> Image:
        return self._view(0.0)

    def moment(self, t: float, frame: int) -> tuple[Image, _Canvas]:
        """Draw everything at time t of frame number `frame`."""
        image = self._still_view.copy() if self.stage.still else self._view(t)
        return image, self.outlines(t, frame, image)

    def outlines(self, t: float, frame: int, image: Image | None = None) -> _Canvas:
        """Say what is seen where at time t of frame number `frame`, and paint it into a picture of the ground."""
        shape = (self.height, self.width)
        canvas = _Canvas(image, np.zeros(shape, np.uint8), np.zeros(shape, np.float32))
        present = [k for k in range(len(self.stage.actors)) if self.stage.present(k, frame)]
        poses = {k: self.stage.actor(k, t) for k in present}
        if image is not None:
            for k in present:
                self._shadow(image, poses[k])
        for k in present:
            for label, pose in zip(self.stage.labels_of(k), poses[k], strict=True):
                self._draw(canvas, k, pose, label, t)
            if k == self.followed:
                canvas.unhidden = float(canvas.target.sum(dtype=np.float64))
        return canvas

    def _window(self, outline: NDArray[np.float64], margin: int = 0) -> tuple[int, int, int, int]:
        low, high = np.floor(outline.min(axis=0)) - margin, np.ceil(outline.max(axis=0)) + margin
        x0, y0 = (int(min(max(value, 0), side)) for value, side in zip(low, self.spec.size, strict=True))
        x1, y1 = (int(min(max(value, 0), side)) for value, side in zip(high, self.spec.size, strict=True))
        return x0, y0, max(x1 - x0, 0), max(y1 - y0, 0)

    def _shadow(self, image: Image, poses: list[PartPose]) -> None:
        shadow = poses[0].actor.shadow
        if shadow is None:
            return
        zoom = poses[0].camera.zoom
        softness = shadow.softness * zoom
        outlines = [pose.outline() + np.asarray(shadow.offset) * zoom for pose in poses]
        low = np.floor(np.min([outline.min(axis=0) for outline in outlines], axis=0)).astype(int)
        high = np.ceil(np.max([outline.max(axis=0) for outline in outlines], axis=0)).astype(int)
        margin = 3 * round(softness) + 2
        x0, y0 = int(low[0]) - margin, int(low[1]) - margin
        width, height = int(high[0]) + margin - x0, int(high[1]) + margin - y0
        light = np.ones((height, width), np.float32)
        for outline in outlines:
            light *= 1 - coverage(outline, x0, y0, width, height)
        dark = box_blur(1 - light, softness)
        x1, y1, w, h = self._window(np.array([[x0, y0], [x0 + width, y0 + height]], dtype=np.float64))
        if w and h:
            part = dark[y1 - y0 : y1 - y0 + h, x1 - x0 : x1 - x0 + w, np.newaxis]
            image[y1 : y1 + h, x1 : x1 + w] *= 1 - np.float32(shadow.strength) * part

    def _draw(self, canvas: _Canvas, index: int, pose: PartPose, label: int, t: float) -> None:
        outline = pose.outline()
        x0, y0, width, height = self._window(outline)
        if not (width and height):
            return
        alpha = coverage(outline, x0, y0, width, height)
        window = (slice(y0, y0 + height), slice(x0, x0 + width))
        if canvas.image is not None:
            inside = np.nonzero(alpha)
            colour = self._colour(index, pose, *_centres(inside, x0, y0), t)
            weight = alpha[inside][:, np.newaxis]
            view = canvas.image[window]
            view[inside] = view[inside] * (1 - weight) + colour * weight
        canvas.labels[window][alpha >= 0.5] = label
        canvas.target[window] *= 1 - alpha
        if index == self.followed:
            canvas.target[window] += alpha

    def _colour(self, index: int, pose: PartPose, x: NDArray[np.float64], y: NDArray[np.float64], t: float) -> Image:
        s = self.spec.fraction(t)
        own_x, own_y = pose.own(x, y)
        colour = self.skins[index].colour(*pose.inverse(own_x, own_y), s)
        if pose.part.tone is not None:
            colour = np.array(pose.part.tone, np.float32) + (colour - self.skins[index].mean) * np.float32(0.5)
        colour = colour * np.float32(pose.part.shade)
        half_w, half_h = pose.actor.size[0] / 2.0, pose.actor.size[1] / 2.0
        u, v = (own_x / half_w).astype(np.float32), (own_y / half_h).astype(np.float32)
        for effect in pose.actor.surface:
            colour = SURFACE_EFFECTS[effect.kind](colour, effect, u, v, s)
        return np.asarray(np.clip(colour, 0.0, 255.0), dtype=np.float32)

    def picture(self, t: int) -> tuple[Image, _Canvas]:
        """Draw frame t as the shutter sees it, and its canvas at the middle of the exposure."""
        image, middle = self.moment(float(t), t)
        shutter = self.spec.camera.shutter
        if shutter == 0:
            return image, middle
        offsets = shutter * ((np.arange(_BLUR_SAMPLES) + 0.5) / _BLUR_SAMPLES - 0.5)
        total = sum(image if offset == 0 else self.moment(t + offset, t)[0] for offset in offsets.tolist())
        return np.asarray(total / np.float32(_BLUR_SAMPLES), dtype=np.float32), middle

    def expose(self, image: Image, t: int) -> Frame:
        """Light, sensor and encoder."""
        exposed = self._exposed(image, t)
        if self.spec.deep is not None:
            return to_words(exposed, self.spec.deep)
        return to_bytes(exposed)

    def _exposed(self, image: Image, t: int) -> Image:
        """Grey levels as they leave the sensor, not rounded yet."""
        rng = np.random.Generator(np.random.SFC64([self.spec.seed, 1, t]))
        blank = self.spec.blank(t)
        if blank:
            gray = any(effect.kind == "gray" for effect in self.spec.effects)
            return BLANKS[blank.kind](image.shape[:2] if gray else image.shape, rng).astype(np.float32)
        for effect in sorted(self.spec.effects, key=lambda effect: ORDER.index(effect.kind)):
            image = EFFECTS[effect.kind](image, effect, self.spec.fraction(t), rng)
        return image


def _centres(
    pixels: tuple[NDArray[np.intp], ...], x0: int, y0: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Centres (x, y) in the frame of pixels (rows, columns) of a window, px."""
    rows, columns = pixels
    return columns.astype(np.float64) + (x0 + 0.5), rows.astype(np.float64) + (y0 + 0.5)


def _amodal_area(outlines: list[NDArray[np.float64]]) -> float:
    """Area of the union of the parts, px², whether inside the frame or not."""
    low = np.floor(np.min([outline.min(axis=0) for outline in outlines], axis=0)).astype(int)
    high = np.ceil(np.max([outline.max(axis=0) for outline in outlines], axis=0)).astype(int)
    free = np.ones((int(high[1] - low[1]), int(high[0] - low[0])), np.float32)
    for outline in outlines:
        free *= 1 - coverage(outline, int(low[0]), int(low[1]), free.shape[1], free.shape[0])
    return float((1 - free).sum(dtype=np.float64))


def _share(
    canvas: _Canvas, outlines: list[NDArray[np.float64]], mask: NDArray[np.bool_], size: tuple[int, int]
) -> float:
    """Share of the target's area that is seen."""
    if not mask.any():
        return 0.0
    x, y, w, h = _tight(outlines).tolist()
    whole = x >= 0 and y >= 0 and x + w <= size[0] and y + h <= size[1]
    area = canvas.unhidden if whole else _amodal_area(outlines)
    return min(float(canvas.target.sum(dtype=np.float64)) / area, 1.0)


def _tight(outlines: list[NDArray[np.float64]]) -> NDArray[np.float64]:
    points = np.concatenate(outlines)
    low, high = points.min(axis=0), points.max(axis=0)
    return np.concatenate([low, high - low])


def _visible_box(mask: NDArray[np.bool_], amodal: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Box of what is seen: the amodal one when that is all, else the mask's, no larger than the amodal one."""
    if share == 0:
        return np.full(4, np.nan)
    if share > 0.999:
        return amodal
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    low = np.maximum([columns[0], rows[0]], amodal[:2])
    high = np.minimum([columns[-1] + 1, rows[-1] + 1], amodal[:2] + amodal[2:])
    return np.concatenate([low, high - low])


def _frame_attributes(
    spec: SequenceSpec, boxes: NDArray[np.float64], visibility: NDArray[np.float64]
) -> dict[str, NDArray[np.bool_]]:
    """Say of each frame what is going on in it; motion is in the picture, from the frame before."""
    centres = boxes[:, :2] + boxes[:, 2:] / 2.0
    moved = np.concatenate([[0.0], np.hypot(*np.diff(centres, axis=0).T)])
    low, high = boxes[:, :2], boxes[:, :2] + boxes[:, 2:]
    cut = (low < 0).any(axis=1) | (high > np.asarray(spec.size)).any(axis=1)
    absent = visibility == 0
    still = moved < 0.1
    still[0] = False
    return {
        "absent": absent,
        "partly_hidden": (visibility < 0.95) & ~absent,
        "cut_by_frame": cut & ~absent,
        "stopped": still,
        "fast": moved > 6.0,
    }


class Truth(NamedTuple):
    """Where the target is in each of T frames; see :class:`~datasets_synthetic.Sequence`.

    Of each mask only the window that it is in: its left column and top row, and its pixels (h, w).
    """

    boxes: NDArray[np.float64]
    visible_boxes: NDArray[np.float64]
    visibility: NDArray[np.float64]
    masks: tuple[tuple[int, int, NDArray[np.bool_]], ...] = ()


def _target_in(
    painter: _Painter, canvas: _Canvas, t: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, tuple[NDArray[np.float64], ...]]:
    """Box, visible box, visibility and outlines of the target in frame t; a blank frame's canvas is emptied."""
    spec, stage = painter.spec, painter.stage
    if spec.blank(t):
        canvas.labels[:], canvas.target[:] = 0, 0
    outlines = [pose.outline() for pose in stage.actor(painter.followed, float(t))]
    mask, box = canvas.target >= 0.5, _tight(outlines)
    share = _share(canvas, outlines, mask, spec.size)
    return box, _visible_box(mask, box, share), share, tuple(outlines)


def truth(spec: SequenceSpec) -> Truth:
    """Give the truth of a sequence without painting it, which takes a tenth of the time.

    Parameters
    ----------
    spec : SequenceSpec

    Returns
    -------
    Truth
        The same numbers as :func:`render` gives.
    """
    return _truth(_Painter(spec))


def objects(spec: SequenceSpec) -> tuple[Truth, ...]:
    """Give the truth of all that moves by itself: of every actor whose path is not to stay where it is.

    Parameters
    ----------
    spec : SequenceSpec

    Returns
    -------
    tuple of Truth
        The hindmost first. What hides behind another actor is as visible as it is to a camera.
    """
    actors = stage_of(spec).actors
    return tuple(_truth(_Painter(spec, k)) for k, actor in enumerate(actors) if actor.motion.path.kind != "hold")


def _truth(painter: _Painter) -> Truth:
    found = [_truth_at(painter, t) for t in range(painter.spec.frames)]
    boxes, visible, shares, masks = zip(*found, strict=True)
    return Truth(np.array(boxes), np.array(visible), np.array(shares), masks)


def _truth_at(
    painter: _Painter, t: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], float, tuple[int, int, NDArray[np.bool_]]]:
    canvas = painter.outlines(float(t), t)
    box, visible, share, _ = _target_in(painter, canvas, t)
    mask = canvas.target >= 0.5
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return box, visible, share, (0, 0, np.zeros((0, 0), dtype=np.bool_))
    x, y = int(columns[0]), int(rows[0])
    return box, visible, share, (x, y, mask[y : int(rows[-1]) + 1, x : int(columns[-1]) + 1].copy())


def frames(spec: SequenceSpec) -> Iterator[Frame]:
    """Paint one frame after another: memory for one, however long the sequence is.

    Parameters
    ----------
    spec : SequenceSpec

    Yields
    ------
    ndarray, shape (H, W) or (H, W, 3), uint8 or uint16
        The same frames as :func:`render` gives.
    """
    painter = _Painter(spec)
    for t in range(spec.frames):
        yield painter.expose(painter.picture(t)[0], t)


def render(spec: SequenceSpec) -> Sequence:
    """Render a sequence.

    Parameters
    ----------
    spec : SequenceSpec

    Returns
    -------
    Sequence
        The same bytes for the same spec, in any process. Only frames with the `jpeg` effect depend on the
        libjpeg inside the OpenCV wheel.
    """
    painter = _Painter(spec)
    shape = (spec.frames, spec.size[1], spec.size[0])
    gray = any(effect.kind == "gray" for effect in spec.effects)
    depth = np.uint16 if spec.deep else np.uint8
    pictures = np.empty(shape if gray else (*shape, 3), depth)
    labels, masks = np.empty(shape, np.uint8), np.empty(shape, np.bool_)
    boxes, visible = np.empty((spec.frames, 4)), np.empty((spec.frames, 4))
    visibility = np.empty(spec.frames)
    polygons = []
    for t in range(spec.frames):
        image, canvas = painter.picture(t)
        pictures[t] = painter.expose(image, t)
        boxes[t], visible[t], visibility[t], outlines = _target_in(painter, canvas, t)
        labels[t], masks[t] = canvas.labels, canvas.target >= 0.5
        polygons.append(outlines)
    attributes = _frame_attributes(spec, boxes, visibility)
    return Sequence(spec, pictures, boxes, visible, masks, visibility, tuple(polygons), labels, attributes)
