"""Score, speed, place and size over time, as a strip of curves."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..display import nice_scale
from .pictures import colour
from .tracks import Track

__all__ = ["ROWS", "strip_svg"]

ROW = 34
"""Height of one row, px; its curves leave 2 px above and below."""
WIDTH = 1000
"""Width of the drawing; the browser stretches it."""


@dataclass(frozen=True)
class Row:
    """One row of the strip.

    Parameters
    ----------
    title : str
    values : callable
        Of a track and the frame's size: one or two curves, a value or NaN per step; the second is dashed.
    unit : str
    floor : float
        The least full scale; curves with a fixed one name it in `top`.
    top : float
        Full scale; 0 follows the values.
    """

    title: str
    values: Callable[[Track], Sequence[list[float]]]
    unit: str
    floor: float
    top: float = 0.0


def _centres(track: Track) -> Sequence[list[float]]:
    centres = [step.box.centre if step.box is not None else (math.nan, math.nan) for step in track.steps]
    return [x for x, _ in centres], [y for _, y in centres]


def _sizes(track: Track) -> Sequence[list[float]]:
    return ([math.sqrt(step.box.area) if step.box is not None else math.nan for step in track.steps],)


def _scores(track: Track) -> Sequence[list[float]]:
    return ([step.score for step in track.steps],)


def _speeds(track: Track) -> Sequence[list[float]]:
    return (track.speeds(),)


ROWS = (
    Row("score", _scores, "", 1.0, 1.0),
    Row("speed", _speeds, "px/frame", 1.0),
    Row("centre x, y", _centres, "px", 10.0),
    Row("size √(w·h)", _sizes, "px", 10.0),
)


def strip_svg(tracks: list[Track], index: int, count: int) -> str:
    """Curves of all tracks over the whole video, and a line at the current frame.

    Parameters
    ----------
    tracks : list of Track
    index : int
        The current frame.
    count : int
        Number of frames; at least 1.

    Returns
    -------
    str
        HTML: the names of the rows, and an SVG that may be stretched to any width.
    """
    height = ROW * len(ROWS)
    parts = [
        f'<svg viewBox="0 0 {WIDTH} {height}" preserveAspectRatio="none" height="{height}">',
        *(f'<path class="rule" d="M0 {ROW * (row + 1) - 0.5}H{WIDTH}"/>' for row in range(len(ROWS))),
    ]
    labels = []
    for number, row in enumerate(ROWS):
        curves = [(track, row.values(track)) for track in tracks]
        top = row.top or _top(row, [curve for _, several in curves for curve in several])
        labels.append(f'<div style="height:{ROW}px">{row.title}<i>0 to {top:g} {row.unit}</i></div>')
        for track, several in curves:
            for dashed, curve in enumerate(several):
                path = _path(curve, track.start, count, top, ROW * number)
                dash = ' stroke-dasharray="3 3"' if dashed else ""
                parts.append(f'<path class="curve" stroke="{colour(track.name)}"{dash} d="{path}"/>')
    x = WIDTH * (index + 0.5) / max(count, 1)
    parts.append(f'<path class="now" d="M{x:.1f} 0V{height}"/></svg>')
    return "".join(["<div>", *labels, "</div>", *parts])


def _top(row: Row, curves: list[list[float]]) -> float:
    values = np.array([value for curve in curves for value in curve if math.isfinite(value)])
    return nice_scale(values, floor=row.floor) if values.size else row.floor


def _path(curve: list[float], start: int, count: int, top: float, above: float) -> str:
    """A curve, interrupted where there is no value; of long ones as many points as the drawing is wide."""
    parts, pen = [], "M"
    for index in range(0, len(curve), max(len(curve) // WIDTH, 1)):
        value = curve[index]
        if not math.isfinite(value):
            pen = "M"
            continue
        x = WIDTH * (start + index + 0.5) / max(count, 1)
        y = above + ROW - 3 - (ROW - 6) * min(max(value / top, 0.0), 1.0)
        parts.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "L"
    return "".join(parts)
