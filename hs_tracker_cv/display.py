"""The paper's window as one image: frame, Fx, Fy, Ft, flow, normal flow, mask and box side by side.

Every function takes arrays and returns a new BGR image, uint8; nothing is shown and nothing is written.

References
----------
.. [1] S. Baker et al., "A Database and Evaluation Methodology for Optical Flow", IJCV 92 (2011) 1–31,
       DOI 10.1007/s11263-010-0390-2: the colour wheel of the flow.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import lru_cache, partial
from typing import Any, Protocol, TypeGuard

import cv2
import numpy as np
from numpy.typing import NDArray

from .frames import as_frame, crop, fixed_errstate
from .geometry import Box
from .scalars import as_count
from .validation import shown

__all__ = [
    "PANELS",
    "FlowFields",
    "draw",
    "draw_box",
    "draw_boxes",
    "draw_layers",
    "draw_panel",
    "flow_colours",
    "nice_scale",
    "png",
    "render_panels",
    "signed_colours",
    "tile_panels",
]

Picture = NDArray[np.uint8]
Colour = tuple[int, int, int]

CANVAS: Colour = (30, 26, 24)
TITLE: Colour = (235, 232, 228)
NOTE: Colour = (165, 158, 150)
WINDOW: Colour = (210, 190, 90)
ARROW: Colour = (90, 225, 250)
STATE_COLOURS: dict[str, Colour] = {
    "tracking": (110, 225, 90),
    "occluded": (40, 180, 255),
    "lost": (70, 70, 245),
    "searching": (210, 190, 90),
}
"""Colour (BGR) of each state; an unknown one is drawn as lost."""

GAP = 10
TITLE_HEIGHT = 26
FOOTER_HEIGHT = 30
COLUMNS = 4
FLOW_PERCENTILE = 99.0
SAMPLES = 20_000
"""Pixels from which the scale of a panel is taken, about."""
STEEP = 3.0
"""Gradient, gray levels per px, from which the normal flow is shown."""


PANELS: dict[str, tuple[str, str]] = {
    "frame": ("Frame", "smoothed, before step 1"),
    "Fx": ("Fx", "steps 1–3"),
    "Fy": ("Fy", "steps 1–3"),
    "Ft": ("Ft", "steps 1–3"),
    "arrows": ("Flow, arrows", "steps 4–5"),
    "colours": ("Flow, colour wheel", "steps 4–5"),
    "normal": ("Normal flow", "step 9"),
    "threshold": ("Threshold", "step 10"),
    "segmentation": ("Segmentation", "step 11"),
    "corners": ("Corners and box", "step 12"),
}
"""The panels of :func:`draw_panel`: title, and where the paper has it."""


WINDOW_PANELS = ("frame", "Fx", "Fy", "Ft", "arrows", "colours", "normal", "segmentation")
"""Those there are of a tracker's window, or of the detector's frame."""


class FlowFields(Protocol):
    """What there is to show of one step: the result of ``TrackerHS.debug()`` and of ``MotionDetector.fields``."""

    @property
    def window(self) -> Box:
        """Where the arrays lie, frame px."""

    @property
    def step(self) -> float:
        """Frame px per array pixel."""

    @property
    def current(self) -> NDArray[np.float32]:
        """Gray window of the current frame, (h, w), 0–255."""

    @property
    def Fx(self) -> NDArray[np.float32]:
        """Derivative along x, (h, w), gray levels per px."""

    @property
    def Fy(self) -> NDArray[np.float32]:
        """Derivative along y, (h, w), gray levels per px."""

    @property
    def Ft(self) -> NDArray[np.float32]:
        """Derivative along time, (h, w), gray levels per frame."""

    @property
    def flow(self) -> NDArray[np.float32]:
        """Flow (u, v), (h, w, 2), array px per frame."""

    @property
    def normal_flow(self) -> NDArray[np.float32]:
        """Flow along the gradient, (h, w, 2), array px per frame."""

    @property
    def mask(self) -> NDArray[np.bool_] | None:
        """Pixels that belong to the object, (h, w); None where the step has found none."""


class StageFields(FlowFields, Protocol):
    """What there is to show of the paper's method on a whole frame: ``stages.Stages``."""

    @property
    def moving(self) -> NDArray[np.bool_]:
        """Pixels above the threshold, (h, w)."""

    @property
    def corners(self) -> NDArray[np.float32]:
        """Corners of the segments, (N, 2), frame px."""

    @property
    def box(self) -> Box | None:
        """Box of the largest segment, frame px."""


@fixed_errstate
def draw_box(
    image: Any, box: Box | None, *, state: str = "tracking", score: float | None = None, note: str = ""
) -> Picture:
    """Copy of a frame with the box and the tracker's state drawn on it.

    Parameters
    ----------
    image : ndarray
        Any frame that ``TrackerHS`` takes.
    box : Box or None
        In px; None draws no box.
    state : str
        One of STATE_COLOURS. Anything but ``"tracking"`` is written out, and ``"lost"`` frames the picture in red.
    score : float, optional
        Written beside the box.
    note : str
        Written in the top left corner.

    Returns
    -------
    ndarray, shape (H, W, 3), uint8
    """
    picture = _as_bgr(image)
    height, width = picture.shape[:2]
    colour = STATE_COLOURS.get(state, STATE_COLOURS["lost"])
    line = max(1, round(min(height, width) / 280))
    if state == "lost":
        cv2.rectangle(picture, (0, 0), (width - 1, height - 1), colour, 4 * line)
    if box is not None:
        _draw_rectangle(picture, box, colour, line, 1.0)
    words = "   ".join(part for part in (note, "" if state == "tracking" else state.upper()) if part)
    taken = [_plate(picture, words, (6 * line, 6 * line), colour)] if words else []
    if box is not None and score is not None:
        _label(picture, f"{score:.2f}", box, colour, 3 * line, taken)
    return picture


@fixed_errstate
def draw_boxes(
    image: Any, boxes: Sequence[tuple[Box, Colour, str]], *, notes: Sequence[tuple[str, Colour]] = ()
) -> Picture:
    """Copy of a frame with several boxes drawn on it.

    Parameters
    ----------
    image : ndarray
        Any frame that ``TrackerHS`` takes.
    boxes : sequence of (Box, colour, str)
        Box in px, colour as (blue, green, red), and what is written above it.
    notes : sequence of (str, colour)
        Written in the top left corner, below one another.

    Returns
    -------
    ndarray, shape (H, W, 3), uint8
    """
    picture = _as_bgr(image)
    line = max(1, round(min(picture.shape[:2]) / 280))
    for box, colour, _ in boxes:
        _draw_rectangle(picture, box, colour, line, 1.0)
    taken: list[Box] = []
    for words, colour in notes:
        taken.append(_plate(picture, words, (6 * line, taken[-1].bottom if taken else 6 * line), colour))
    for box, colour, words in boxes:
        if words:
            taken.append(_label(picture, words, box, colour, 3 * line, taken))
    return picture


def _label(picture: Picture, words: str, box: Box, colour: Colour, gap: int, taken: Sequence[Box]) -> Box:
    """Write beside a box where nothing is written yet, above it at best; returns the plate."""
    width, height = _plate_size(picture, words)
    places = [
        _held_inside(picture, Box(x, y, width, height))
        for y in (box.y - gap - height, box.bottom + gap, box.y + gap, box.bottom - gap - height)
        for x in (box.x, box.right - width)
    ]
    free = (place for place in places if not any(place.intersection(other).area for other in taken))
    place = next(free, places[0])
    return _plate(picture, words, (place.x, place.y), colour)


def _as_bgr(image: Any) -> Picture:
    frame = as_frame(image)
    pixels = frame.pixels
    if pixels.dtype != np.uint8:
        pixels = np.rint(crop(frame, 0, 0, frame.width, frame.height)).astype(np.uint8)
    return np.array(pixels, order="C") if frame.channels == 3 else _gray_to_bgr(pixels[:, :, 0])


def _gray_to_bgr(gray: NDArray[Any]) -> Picture:
    levels = cv2.convertScaleAbs(np.maximum(gray, 0)) if gray.dtype != np.uint8 else gray
    return np.asarray(cv2.cvtColor(levels, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _draw_rectangle(picture: Picture, box: Box, colour: Colour, line: int, scale: float) -> None:
    """Draw a box at sub-pixel edges; a pixel's area is [j, j + 1), so its centre is where cv2 counts from."""
    shift = 4
    edges = np.array([box.x, box.y, box.right, box.bottom]) * scale - 0.5
    left, top, right, bottom = (int(value) for value in np.rint(np.clip(edges, -1e4, 1e5) * (1 << shift)))
    cv2.rectangle(picture, (left, top), (right, bottom), colour, line, cv2.LINE_AA, shift)


def _letters(picture: Picture) -> float:
    """Size of letters that can be read on a picture."""
    return float(min(max(min(picture.shape[:2]) / 700, 0.38), 1.2))


def _plate_size(picture: Picture, words: str) -> tuple[int, int]:
    (width, height), base = cv2.getTextSize(words, cv2.FONT_HERSHEY_DUPLEX, _letters(picture), 1)
    pad = _padding(base)
    return width + 2 * pad, height + base + pad


def _padding(base: int) -> int:
    return max(3, base // 2 + 1)


def _held_inside(picture: Picture, plate: Box) -> Box:
    height, width = picture.shape[:2]
    x = round(min(max(plate.x, 0), max(width - plate.w, 0)))
    y = round(min(max(plate.y, 0), max(height - plate.h, 0)))
    return Box(x, y, plate.w, plate.h)


def _plate(picture: Picture, words: str, at: tuple[float, float], colour: Colour) -> Box:
    """Write on a dark plate whose upper left corner is at a point, kept inside the picture; returns the plate."""
    plate = _held_inside(picture, Box(*at, *_plate_size(picture, words)))
    x, y, width, height = (int(side) for side in plate)
    area = picture[y : y + height, x : x + width]
    area[:] = area // 4
    (_, high), base = cv2.getTextSize(words, cv2.FONT_HERSHEY_DUPLEX, _letters(picture), 1)
    start = (x + _padding(base), y + _padding(base) + high)
    cv2.putText(picture, words, start, cv2.FONT_HERSHEY_DUPLEX, _letters(picture), colour, 1, cv2.LINE_AA)
    return plate


def nice_scale(values: NDArray[Any], *, floor: float) -> float:
    """Full scale for a panel: the 99th percentile of |values|, rounded up to 1, 2 or 5 times a power of ten.

    Rounding keeps the scale still from frame to frame, so that panels of a video can be compared.

    Examples
    --------
    >>> nice_scale(np.array([-3.1, 0.0]), floor=1.0)
    5.0
    """
    finite = np.abs(values[np.isfinite(values)])
    peak = max(float(np.percentile(finite, FLOW_PERCENTILE)) if finite.size else 0.0, floor)
    decade = 10.0 ** math.floor(math.log10(peak))
    return next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if peak <= factor * decade * (1 + 1e-9))


@lru_cache(maxsize=1)
def _signed_table() -> Picture:
    """255 colours (BGR): blue for negative, mid gray for zero (the middle entry), orange for positive."""
    stops = np.array([(255, 214, 120), (214, 120, 40), (112, 112, 112), (30, 110, 222), (120, 214, 255)], dtype=float)
    at = np.linspace(0.0, 1.0, len(stops))
    table = np.stack([np.interp(np.linspace(0.0, 1.0, 255), at, stops[:, band]) for band in range(3)], axis=1)
    return np.asarray(np.rint(table), dtype=np.uint8)


def signed_colours(values: NDArray[Any], scale: float) -> Picture:
    """Colour a signed field: blue negative, mid gray zero, orange positive; ±`scale` is the end of the map.

    Parameters
    ----------
    values : ndarray, shape (h, w)
    scale : float
        Positive; in the units of `values`.

    Returns
    -------
    ndarray, shape (h, w, 3), uint8
    """
    unit = np.asarray(values, np.float32) * np.float32(127.0 / scale)
    index = np.clip(np.where(np.isnan(unit), np.float32(0.0), unit), -127.0, 127.0) + np.float32(127.5)
    return np.asarray(np.take(_signed_table(), index.astype(np.uint8), axis=0), dtype=np.uint8)


@lru_cache(maxsize=1)
def _wheel() -> NDArray[np.float64]:
    """55 hues (BGR, 0–1) of the Middlebury wheel: segment lengths follow how finely the eye tells hues apart."""
    # (hues, which of R, G, B changes, whether it rises): red, yellow, green, cyan, blue, magenta, red.
    segments = ((15, 1, 1), (6, 0, -1), (4, 2, 1), (11, 1, -1), (13, 0, 1), (6, 2, -1))
    level = np.array([1.0, 0.0, 0.0])
    rows = []
    for length, moving, direction in segments:
        for index in range(length):
            row = level.copy()
            row[moving] = index / length if direction > 0 else 1.0 - index / length
            rows.append(row)
        level[moving] = 1.0 if direction > 0 else 0.0
    return np.array(rows)[:, ::-1]


@lru_cache(maxsize=1)
def _fine_wheel() -> NDArray[np.float32]:
    """The wheel with 32 steps from hue to hue, so that the nearest will do."""
    wheel = _wheel()
    at = np.arange(len(wheel))
    fine = np.linspace(0.0, len(wheel) - 1.0, 32 * (len(wheel) - 1) + 1)
    return np.stack([np.interp(fine, at, wheel[:, band]) for band in range(3)], axis=1).astype(np.float32)


def flow_colours(flow: NDArray[Any], scale: float) -> Picture:
    """Colour a flow field as Middlebury does [1]_: hue is direction, saturation is speed, no motion is white.

    Parameters
    ----------
    flow : ndarray, shape (h, w, 2)
        u right and v down, px/frame.
    scale : float
        Speed of full saturation, px/frame; above it colours darken.

    Returns
    -------
    ndarray, shape (h, w, 3), uint8
    """
    field = np.nan_to_num(np.asarray(flow, dtype=np.float32)) / np.float32(scale)
    u, v = field[..., 0], field[..., 1]
    speed = np.hypot(u, v)[..., None]
    wheel = _fine_wheel()
    turn = (np.arctan2(-v, -u) / np.float32(np.pi) + np.float32(1.0)) * np.float32(0.5 * (len(wheel) - 1))
    hue = np.take(wheel, np.rint(turn).astype(np.intp), axis=0)
    # The rim belongs to the wheel, whatever the last bit of its speed.
    colour = np.where(speed <= 1.0 + 1e-6, 1.0 - speed * (1.0 - hue), np.float32(0.75) * hue)
    return np.asarray(np.rint(np.clip(colour, 0.0, 1.0) * 255.0), dtype=np.uint8)


@fixed_errstate
def draw_panel(name: str, fields: StageFields, *, width: int = 480) -> tuple[Picture, str]:
    """One panel of the paper's method on a whole frame.

    Parameters
    ----------
    name : str
        One of PANELS.
    fields : StageFields
        The result of ``stages.PaperMethod.calc``.
    width : int
        Of the picture, px; its height follows the frame's shape.

    Returns
    -------
    picture : ndarray, shape (H, W, 3), uint8
    note : str
        What its colours and lengths mean; empty where there is nothing to say.

    Raises
    ------
    ValueError
        If there is no such panel.
    """
    if name not in _DRAWN:
        raise ValueError(f"expected one of {', '.join(PANELS)}, got {name!r}")
    height, columns = fields.current.shape
    return _DRAWN[name](fields, (width, max(round(width * height / columns), 1)))


def _draw_frame(fields: StageFields, size: tuple[int, int]) -> tuple[Picture, str]:
    return _gray_picture(fields, size), ""


def _gray_picture(fields: FlowFields, size: tuple[int, int], light: float = 1.0) -> Picture:
    return _gray_to_bgr(_fit(fields.current, size) * np.float32(light))


def _draw_derivative(name: str, fields: StageFields, size: tuple[int, int]) -> tuple[Picture, str]:
    # One scale for the three: only then can the eye weigh them against each other.
    scale = max(nice_scale(_sampled(field), floor=5.0) for field in (fields.Fx, fields.Fy, fields.Ft))
    unit = "frame" if name == "Ft" else "px"
    note = f"blue −{scale:g}, orange +{scale:g} gray levels per {unit}"
    return _fit(signed_colours(_smaller(getattr(fields, name), size), scale), size), note


def _sampled(field: NDArray[Any]) -> NDArray[Any]:
    """As many of its rows and columns as tell its scale."""
    apart = max(math.isqrt(field.shape[0] * field.shape[1] // SAMPLES), 1)
    return field[::apart, ::apart]


def _speed_scale(flow: NDArray[Any]) -> float:
    sample = _sampled(flow)
    return nice_scale(np.hypot(sample[..., 0], sample[..., 1]), floor=0.1)


def _draw_arrows(fields: StageFields, size: tuple[int, int]) -> tuple[Picture, str]:
    speed = _speed_scale(fields.flow)
    return _arrows(fields, speed, size), f"longest {speed * fields.step:.3g} px per frame"


def _draw_colours(fields: StageFields, size: tuple[int, int]) -> tuple[Picture, str]:
    speed = _speed_scale(fields.flow)
    picture = _flow_picture(fields.flow, speed, size)
    _legend(picture)
    return picture, f"rim of the wheel {speed * fields.step:.3g} px per frame"


def _draw_normal(fields: StageFields, size: tuple[int, int]) -> tuple[Picture, str]:
    shown = _steep_only(fields)
    speed = _speed_scale(shown)
    picture = _flow_picture(shown, speed, size)
    _legend(picture)
    return picture, f"rim {speed * fields.step:.3g} px per frame; where |∇F| ≥ {STEEP:g}"


def _flow_picture(flow: NDArray[Any], speed: float, size: tuple[int, int]) -> Picture:
    return _fit(flow_colours(_smaller(flow, size), speed), size)


def _smaller(field: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    """A field averaged down to the size it is shown at: that is less to colour. What is shown larger stays."""
    return cv2.resize(field, size, interpolation=cv2.INTER_AREA) if _fit_scale(field.shape, size) < 1 else field


def _draw_threshold(fields: StageFields, size: tuple[int, int]) -> tuple[Picture, str]:
    share = np.count_nonzero(fields.moving) / fields.moving.size
    white = _fit(fields.moving.view(np.uint8) * np.uint8(255), size)
    return _gray_to_bgr(white), f"white: above it, {100 * share:.2g} % of the frame"


def _draw_segmentation(fields: StageFields, size: tuple[int, int]) -> tuple[Picture, str]:
    return _mask_picture(fields, None, "tracking", size), "" if fields.box else "nothing moves"


def _draw_corners(fields: StageFields, size: tuple[int, int]) -> tuple[Picture, str]:
    picture = _gray_picture(fields, size, 0.7)
    scale = size[0] / fields.window.w
    for x, y in (fields.corners + 0.5) * scale - 0.5:
        cv2.circle(picture, (round(float(x) * 16), round(float(y) * 16)), 40, ARROW, -1, cv2.LINE_AA, 4)
    if fields.box is None:
        return picture, "nothing moves"
    _draw_rectangle(picture, fields.box, STATE_COLOURS["tracking"], 2, scale)
    x, y, w, h = fields.box
    return picture, f"{len(fields.corners)} corners; box {x:.0f}, {y:.0f}, {w:.0f} × {h:.0f}"


_DRAWN: dict[str, Callable[[StageFields, tuple[int, int]], tuple[Picture, str]]] = {
    "frame": _draw_frame,
    **{name: partial(_draw_derivative, name) for name in ("Fx", "Fy", "Ft")},
    "arrows": _draw_arrows,
    "colours": _draw_colours,
    "normal": _draw_normal,
    "threshold": _draw_threshold,
    "segmentation": _draw_segmentation,
    "corners": _draw_corners,
}


@fixed_errstate
def draw(
    fields: FlowFields, panels: Sequence[str] | None = None, *, width: int = 320, columns: int = COLUMNS
) -> Picture:
    """What a step has computed, as one picture: the panels of the paper's window.

    Parameters
    ----------
    fields : FlowFields
        The result of :meth:`PaperMethod.calc <hs_tracker_cv.PaperMethod.calc>`, of ``MotionDetector.fields``, or of
        ``TrackerHS.debug()``, which shows the tracker's window.
    panels : sequence of str, optional
        Some of frame, Fx, Fy, Ft, arrows, colours, normal, threshold, segmentation and corners; by default all that
        there are: threshold and corners are the paper's, and only PaperMethod has them.
    width : int
        Of one panel, px.
    columns : int
        Most panels in a row.

    Returns
    -------
    ndarray, shape (H, W, 3), uint8
        BGR, for ``cv2.imwrite``.

    Raises
    ------
    TypeError
        If `fields` is none of these, or `width` or `columns` is not a whole number.
    ValueError
        If there is no such panel, or none is asked for; or a number is below 1.
    """
    width, columns = (as_count(name, side) for name, side in (("width", width), ("columns", columns)))
    if not hasattr(fields, "current"):
        raise TypeError(
            "expected the result of PaperMethod.calc or TrackerHS.debug(), or MotionDetector.fields, which is None "
            f"before there are two frames; got {shown(fields)}"
        )
    known = tuple(PANELS) if _has_stages(fields) else WINDOW_PANELS
    chosen = known if panels is None else tuple(panels)
    unknown = [name for name in chosen if name not in known]
    if unknown or not chosen:
        raise ValueError(
            f"expected some of {', '.join(known)}, got {unknown[0]!r}"
            if unknown
            else f"expected at least one of {', '.join(known)}, got none"
        )
    if _has_stages(fields):
        pictures = [draw_panel(name, fields, width=width)[0] for name in chosen]
        tiles = [(*PANELS[name], picture) for name, picture in zip(chosen, pictures, strict=True)]
        return tile_panels(tiles, columns=columns)
    size = (width, max(round(width * fields.current.shape[0] / fields.current.shape[1]), 1))
    pictures_of = {
        "frame": _tile(_gray_to_bgr(fields.current), size, "Window"),
        **_field_tiles(fields, None, "tracking", size),
    }
    return _grid([pictures_of[name] for name in chosen], columns)


def _has_stages(fields: FlowFields) -> TypeGuard[StageFields]:
    # Asked of the type: the stages are computed when they are looked at.
    return hasattr(type(fields), "corners")


def png(picture: Picture) -> bytes:
    """Encode a picture, as Jupyter shows it."""
    return cv2.imencode(".png", picture)[1].tobytes()


@fixed_errstate
def draw_layers(image: Any, window: Box, mask: NDArray[np.bool_], *, width: int = 480) -> Picture:
    """What a tracker takes for the object, and what for the ground round it, side by side.

    Parameters
    ----------
    image : ndarray
        The frame.
    window : Box
        Where the mask lies, frame px.
    mask : ndarray of bool, shape (h, w)
        Pixels of the object.
    width : int
        Of the picture, px.

    Returns
    -------
    ndarray, shape (H, W, 3), uint8
    """
    picture = _as_bgr(image)
    height, columns = mask.shape
    # The part of the frame under the mask; what lies outside the frame is black.
    scale = np.array([[columns / window.w, 0.0, 0.0], [0.0, height / window.h, 0.0]])
    scale[:, 2] = scale[0, 0] * (0.5 - window.x) - 0.5, scale[1, 1] * (0.5 - window.y) - 0.5
    part = cv2.warpAffine(picture, scale, (columns, height), flags=cv2.INTER_LINEAR)
    inside = mask[:, :, None]
    side = ((width - GAP) // 2, max(round((width - GAP) / 2 * height / columns), 1))
    layers = [_fit(np.where(kept, part, np.uint8(0)), side) for kept in (inside, ~inside)]
    return np.hstack([layers[0], np.full((layers[0].shape[0], GAP, 3), CANVAS, np.uint8), layers[1]])


@fixed_errstate
def tile_panels(panels: Sequence[tuple[str, str, Picture]], *, columns: int = 3) -> Picture:
    """Panels with their titles and notes, in a grid.

    Parameters
    ----------
    panels : sequence of (title, note, picture)
        At least one; pictures (H, W, 3), uint8, are fitted to the size of the first.
    columns : int

    Returns
    -------
    ndarray, shape (H, W, 3), uint8
    """
    height, width = panels[0][2].shape[:2]
    return _grid(
        [_tile(picture, (width, height), _ascii(title), _ascii(note)) for title, note, picture in panels], columns
    )


def _grid(tiles: list[Picture], columns: int) -> Picture:
    """Tiles of one size in rows, with a gap round them."""
    per_row = min(columns, len(tiles))
    tiles = tiles + [np.full_like(tiles[0], CANVAS)] * (-len(tiles) % per_row)
    rows = [_beside(tiles[start : start + per_row]) for start in range(0, len(tiles), per_row)]
    return np.vstack([*rows, np.full((GAP, rows[0].shape[1], 3), CANVAS, np.uint8)])


def _ascii(words: str) -> str:
    """As far as OpenCV's letters go."""
    for letter, plain in {"–": "-", "−": "-", "×": "x", "≥": ">=", "∇": "grad ", "λ": "lambda", " · ": ", "}.items():
        words = words.replace(letter, plain)
    return words


@fixed_errstate
def render_panels(
    image: Any,
    fields: FlowFields | None,
    box: Box | None,
    *,
    state: str = "tracking",
    score: float | None = None,
    note: str = "",
    tile_width: int = 320,
) -> Picture:
    """The eight panels of one step, in a grid.

    Parameters
    ----------
    image : ndarray
        The frame.
    fields : FlowFields or None
        What the step has computed; without it the panels stay empty.
    box : Box or None
        The box found, frame px.
    state, score, note : str, float, str
        Written below the panels.
    tile_width : int
        Width of one panel, px.

    Returns
    -------
    ndarray, shape (H, W, 3), uint8
        Its size depends on the frame's size and `tile_width` only, so that panels make a video.
    """
    picture = _as_bgr(image)
    height, width = picture.shape[:2]
    size = (tile_width, round(tile_width * min(max(height / width, 0.5), 1.0)))
    tiles = [_frame_tile(picture, fields, box, state, size)]
    tiles += _field_tiles(fields, box, state, size).values() if fields is not None else _empty_tiles(size)
    rows = [_beside(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
    footer = _footer(rows[0].shape[1], box, state, score, note)
    return np.vstack([*rows, footer])


def _beside(tiles: list[Picture]) -> Picture:
    """Tiles in a row, with a gap above and round them."""
    height = tiles[0].shape[0]
    gap = np.full((height, GAP, 3), CANVAS, np.uint8)
    parts = [gap]
    for tile in tiles:
        parts += [tile, gap]
    row = np.hstack(parts)
    return np.vstack([np.full((GAP, row.shape[1], 3), CANVAS, np.uint8), row])


def _footer(width: int, box: Box | None, state: str, score: float | None, note: str) -> Picture:
    strip = np.full((FOOTER_HEIGHT + GAP // 2, width, 3), CANVAS, np.uint8)
    colour = STATE_COLOURS.get(state, STATE_COLOURS["lost"])
    cv2.circle(strip, (GAP + 6, FOOTER_HEIGHT // 2 + 2), 6, colour, -1, cv2.LINE_AA)
    x = GAP + 22
    where = f"box {box.x:.1f}, {box.y:.1f}   {box.w:.1f} x {box.h:.1f} px" if box is not None else ""
    for words, ink in (
        (state, colour),
        (f"score {score:.2f}" if score is not None else "", TITLE),
        (where, TITLE),
        (note, NOTE),
    ):
        x += _write(strip, words, (x, FOOTER_HEIGHT // 2 + 7), ink, 0.5) + (24 if words else 0)
    return strip


def _write(picture: Picture, words: str, at: tuple[int, int], colour: Colour, size: float) -> int:
    """Write and return the width used."""
    cv2.putText(picture, words, at, cv2.FONT_HERSHEY_DUPLEX, size, colour, 1, cv2.LINE_AA)
    return int(cv2.getTextSize(words, cv2.FONT_HERSHEY_DUPLEX, size, 1)[0][0]) if words else 0


def _tile(content: Picture, size: tuple[int, int], title: str, note: str = "", *, bar: bool = False) -> Picture:
    """A titled panel: the content scaled to fit, centred, on black."""
    width, height = size
    tile = np.full((TITLE_HEIGHT + height, width, 3), CANVAS, np.uint8)
    tile[TITLE_HEIGHT:] = (18, 16, 15)
    fitted = _fit(content, size)
    y, x = TITLE_HEIGHT + (height - fitted.shape[0]) // 2, (width - fitted.shape[1]) // 2
    tile[y : y + fitted.shape[0], x : x + fitted.shape[1]] = fitted
    _write(tile, title, (2, TITLE_HEIGHT - 9), TITLE, 0.5)
    room = cv2.getTextSize(note, cv2.FONT_HERSHEY_SIMPLEX, 0.4, 1)[0][0] if note else 0
    cv2.putText(tile, note, (width - room - 2, TITLE_HEIGHT - 9), cv2.FONT_HERSHEY_SIMPLEX, 0.4, NOTE, 1, cv2.LINE_AA)
    if bar:
        length = min(72, width // 4)
        ramp = signed_colours(np.tile(np.linspace(-1, 1, length), (8, 1)), 1.0)
        tile[TITLE_HEIGHT - 17 : TITLE_HEIGHT - 9, width - room - length - 10 : width - room - 10] = ramp
    return tile


def _fit_scale(shape: tuple[int, ...], size: tuple[int, int]) -> float:
    return min(size[0] / shape[1], size[1] / shape[0])


def _fit(content: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    scale = _fit_scale(content.shape, size)
    width = min(max(round(content.shape[1] * scale), 1), size[0])
    height = min(max(round(content.shape[0] * scale), 1), size[1])
    # Enlarged pixels stay square: what was computed is shown, not what could be drawn between.
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_NEAREST
    return cv2.resize(content, (width, height), interpolation=method)


def _frame_tile(
    picture: Picture, fields: FlowFields | None, box: Box | None, state: str, size: tuple[int, int]
) -> Picture:
    scale = _fit_scale(picture.shape, size)
    small = _fit(picture, size)
    if fields is not None:
        _draw_rectangle(small, fields.window, WINDOW, 1, scale)
    if box is not None:
        _draw_rectangle(small, box, STATE_COLOURS.get(state, STATE_COLOURS["lost"]), 2, scale)
    return _tile(small, size, "Frame", f"{picture.shape[1]} x {picture.shape[0]} px")


def _empty_tiles(size: tuple[int, int]) -> list[Picture]:
    blank = np.full((size[1], size[0], 3), (40, 36, 34), np.uint8)
    return [_tile(blank, size, title) for title in ("Fx", "Fy", "Ft", "Flow", "Flow, colour", "Normal flow", "Mask")]


def _field_tiles(fields: FlowFields, box: Box | None, state: str, size: tuple[int, int]) -> dict[str, Picture]:
    """The panels of a window but the frame, by name."""
    # One scale for the three derivatives: only then can the eye weigh them against each other.
    levels = max(nice_scale(field, floor=5.0) for field in (fields.Fx, fields.Fy, fields.Ft))
    speed = nice_scale(np.hypot(fields.flow[..., 0], fields.flow[..., 1]), floor=0.5)
    frame_speed = speed * fields.step
    coloured = _fit(flow_colours(fields.flow, speed), size)
    _legend(coloured)
    slopes = {
        title: _tile(signed_colours(field, levels), size, title, f"+/-{levels:g}", bar=True)
        for title, field in (("Fx", fields.Fx), ("Fy", fields.Fy), ("Ft", fields.Ft))
    }
    return {
        **slopes,
        "arrows": _tile(_arrows(fields, speed, size), size, "Flow", f"longest {frame_speed:.3g} px/frame"),
        "colours": _tile(coloured, size, "Flow, colour", f"rim {frame_speed:.3g} px/frame"),
        "normal": _normal_tile(fields, speed, size),
        "segmentation": _tile(
            _mask_picture(fields, box, state, size), size, "Mask" if box is None else "Mask and box"
        ),
    }


def _normal_tile(fields: FlowFields, speed: float, size: tuple[int, int]) -> Picture:
    return _tile(flow_colours(_steep_only(fields), speed), size, "Normal flow", f"where |grad F| >= {STEEP:g}")


def _steep_only(fields: FlowFields) -> NDArray[np.float32]:
    """Normal flow where there is a gradient; elsewhere it is noise divided by nothing: shown as no motion."""
    steep = cv2.magnitude(fields.Fx, fields.Fy) >= STEEP
    return np.asarray(cv2.copyTo(fields.normal_flow, steep.view(np.uint8)), np.float32)


def _arrows(fields: FlowFields, speed: float, size: tuple[int, int]) -> Picture:
    """The flow as arrows on the darkened window, about 18 px apart, the longest 1.5 spacings long."""
    picture = _gray_picture(fields, size, 0.55)
    scale = _fit_scale(fields.current.shape, size)
    height, width = fields.current.shape
    spacing, unit = 18.0 / scale, 1.5 * 18.0 / speed
    ys, xs = np.arange(spacing / 2, height, spacing), np.arange(spacing / 2, width, spacing)
    vectors = np.nan_to_num(fields.flow[np.ix_(ys.astype(int), xs.astype(int))])
    length = np.hypot(vectors[..., 0], vectors[..., 1])
    vectors = vectors * (unit * np.minimum(1.0, speed / np.maximum(length, 1e-9)))[..., None]
    for y, row in zip(ys.tolist(), vectors.tolist(), strict=True):
        for x, vector in zip(xs.tolist(), row, strict=True):
            _arrow(picture, (x * scale, y * scale), vector)
    return picture


def _arrow(picture: Picture, start: tuple[float, float], vector: Sequence[float]) -> None:
    shift = 4
    tail = (round(start[0] * 16), round(start[1] * 16))
    head = (round((start[0] + vector[0]) * 16), round((start[1] + vector[1]) * 16))
    if math.hypot(*vector) < 1.5:
        cv2.circle(picture, tail, 12, NOTE, -1, cv2.LINE_AA, shift)
        return
    cv2.arrowedLine(picture, tail, head, ARROW, 1, cv2.LINE_AA, shift, 0.3)


def _legend(picture: Picture) -> None:
    """Colour wheel in the lower right corner: each point has the colour of the flow that points to it."""
    radius = max(min(picture.shape[:2]) // 10, 10)
    if min(picture.shape[:2]) < 4 * radius:
        return
    offsets = np.arange(-radius, radius + 1) / radius
    u, v = np.meshgrid(offsets, offsets)
    disc = np.hypot(u, v) <= 1.0
    corner = picture[-2 * radius - 7 : -6, -2 * radius - 7 : -6]
    corner[disc] = flow_colours(np.dstack([u, v]), 1.0)[disc]
    centre = (picture.shape[1] - radius - 7, picture.shape[0] - radius - 7)
    cv2.circle(picture, centre, radius, (90, 90, 90), 1, cv2.LINE_AA)


def _mask_picture(fields: FlowFields, box: Box | None, state: str, size: tuple[int, int]) -> Picture:
    picture = _gray_picture(fields, size, 0.45)
    scale = _fit_scale(fields.current.shape, size)
    colour = STATE_COLOURS.get(state, STATE_COLOURS["lost"])
    if fields.mask is not None:
        large = cv2.resize(
            fields.mask.astype(np.uint8), (picture.shape[1], picture.shape[0]), interpolation=cv2.INTER_NEAREST
        )
        lit = _gray_picture(fields, size)
        cv2.copyTo(cv2.addWeighted(lit, 0.75, np.full_like(lit, WINDOW), 0.25, 0.0), large, picture)
        edges, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, edges, -1, WINDOW, 1, cv2.LINE_AA)
    if box is not None:
        local = box.moved(-fields.window.x, -fields.window.y)
        _draw_rectangle(picture, local, colour, 2, scale / fields.step)
    return picture
