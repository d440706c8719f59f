"""Regions that are finer than a box: masks and rotated boxes, and how much two regions overlap.

They are kept as text in the way VOT writes them: ``m`` and x, y, w, h of a window, then lengths of runs row by row,
the first of pixels outside; or x, y of four corners. Pixel column j covers x from j to j + 1, so that the overlap of
a mask with a box is what it is on paper, wherever the box's edges lie.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage import draw

__all__ = [
    "Mask", "answered_region", "box_polygon", "mask_of_polygons", "mask_of_runs", "outlines", "polygon_text",
    "read_region", "region_box", "region_iou",
]  # fmt: skip

Polygon = NDArray[np.float64]
"""Corners (N, 2) of a convex polygon, px."""

_FARTHEST = 20_000.0  # px: what lies farther off than any frame reaches is a slip, and no mask to be painted
_HAIR = 1e-6, 1.618e-6  # px: a middle on an edge that two polygons share is in one of them only


@dataclass(frozen=True, eq=False)
class Mask:
    """Pixels of a window; those outside of it are none.

    Parameters
    ----------
    x, y : int
        Left column and top row of the window.
    pixels : ndarray of bool, shape (h, w)
    """

    x: int
    y: int
    pixels: NDArray[np.bool_]

    @property
    def text(self) -> str:
        """The mask as VOT writes it, its window no larger than needed; empty where there is no pixel."""
        rows, columns = np.flatnonzero(self.pixels.any(axis=1)), np.flatnonzero(self.pixels.any(axis=0))
        if not rows.size:
            return ""
        part = self.pixels[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
        # A pixel outside before the first: a mask that begins inside has a first run of none.
        edges = np.flatnonzero(np.diff(part.ravel().astype(np.int8), prepend=0))
        runs = np.diff(np.concatenate([[0], edges, [part.size]])).tolist()
        window = self.x + int(columns[0]), self.y + int(rows[0]), part.shape[1], part.shape[0]
        return "m" + ",".join(map(str, [*window, *runs]))

    def within(self, size: tuple[int, int]) -> Mask:
        """Return what of it is inside a frame of `size` (width, height)."""
        left, top = max(-self.x, 0), max(-self.y, 0)
        right, bottom = max(size[0] - self.x, left), max(size[1] - self.y, top)
        return Mask(self.x + left, self.y + top, self.pixels[top:bottom, left:right])


Region = Mask | Polygon


def mask_of_runs(x: int, y: int, width: int, height: int, runs: Iterable[int]) -> Mask:
    """Mask of a window and lengths of runs, row by row, the first of pixels outside.

    Raises
    ------
    ValueError
        If the runs do not fit into the window.
    """
    lengths = list(runs)
    if min(width, height, *lengths, 0) < 0 or sum(lengths) > width * height:
        raise ValueError(f"expected runs within {width} × {height} px, got {sum(lengths)} px")
    pixels = np.zeros(width * height, dtype=bool)
    filled = np.repeat(np.arange(len(lengths)) % 2 == 1, lengths)
    pixels[: filled.size] = filled
    return Mask(x, y, pixels.reshape(height, width))


def mask_of_polygons(polygons: Iterable[Iterable[float]]) -> Mask:
    """Pixels whose middle is inside any of several polygons, each x, y of its corners.

    COCO's own library rounds corners to fifths of a pixel first: where the middle of a pixel is nearer than that to
    an outline, it may say otherwise.

    Raises
    ------
    ValueError
        If they are no polygons.
    """
    corners = [np.array(list(polygon), dtype=np.float64) for polygon in polygons]
    for flat in corners:
        if flat.size < 6 or flat.size % 2 or not (np.abs(flat) < _FARTHEST).all():
            raise ValueError(f"expected x, y of three corners or more, got {flat.tolist()}")
    points = [flat.reshape(-1, 2) for flat in corners] or [np.zeros((1, 2))]
    x, y = np.floor(np.min([one.min(axis=0) for one in points], axis=0)).astype(int).tolist()
    right, bottom = np.ceil(np.max([one.max(axis=0) for one in points], axis=0)).astype(int).tolist()
    pixels = np.zeros((bottom - y, right - x), dtype=bool)
    for one in points:
        columns, rows = (one - [x, y] - 0.5 + _HAIR).T
        pixels[draw.polygon(rows, columns, pixels.shape)] = True  # type: ignore[no-untyped-call]
    return Mask(x, y, pixels)


def polygon_text(corners: Iterable[float]) -> str:
    """Text of corners x, y, x, y …; every number comes back to the last bit."""
    return ",".join(repr(float(value)) for value in corners)


def read_region(text: str) -> Region:
    """Region of a text that this module has written.

    Raises
    ------
    ValueError
        If it is none.
    """
    if text.startswith("m"):
        x, y, width, height, *runs = map(int, text[1:].split(","))
        return mask_of_runs(x, y, width, height, runs)
    values = np.array(text.split(","), dtype=np.float64)
    if values.size != 8 or not np.isfinite(values).all():
        raise ValueError(f"expected a mask or four corners, got {text[:80]!r}")
    return values.reshape(4, 2)


def region_box(region: Region) -> tuple[float, float, float, float]:
    """Bounding box x, y, w, h of a region; NaN of an empty mask."""
    if not isinstance(region, Mask):
        low, high = region.min(axis=0).tolist(), region.max(axis=0).tolist()
        return low[0], low[1], high[0] - low[0], high[1] - low[1]
    rows, columns = np.nonzero(region.pixels)
    if not rows.size:
        return (np.nan,) * 4
    x, y = int(columns.min()), int(rows.min())
    return float(region.x + x), float(region.y + y), float(columns.max() - x + 1), float(rows.max() - y + 1)


def box_polygon(box: Iterable[float]) -> Polygon:
    """Corners of a box x, y, w, h."""
    x, y, w, h = box
    return np.array([[x, y], [x + w, y], [x + w, y + h], [x, y + h]], dtype=np.float64)


def answered_region(text: str, box: Iterable[float]) -> Region:
    """Region of an answer: the mask or rotated box that `text` holds, or where it is empty the box."""
    return read_region(text) if text else box_polygon(box)


def region_iou(truth: Region, answer: Region, size: tuple[int, int]) -> float:
    """Intersection over union of two regions inside a frame of `size` (width, height); 0 where either is empty."""
    first, second = (
        one.within(size) if isinstance(one, Mask) else _within_frame(one, size) for one in (truth, answer)
    )
    areas = _area(first), _area(second)
    if min(areas) <= 0:
        return 0.0
    common = min(_common(first, second), *areas)
    return common / (areas[0] + areas[1] - common)


def outlines(region: Region, zoom: float) -> list[NDArray[np.int32]]:
    """Closed lines round a region, to be drawn on a picture that is `zoom` times as large."""
    if not isinstance(region, Mask):
        return [np.rint(region * zoom).astype(np.int32)]
    padded = np.pad(region.pixels, 1).astype(np.uint8)
    found, _ = cv2.findContours(padded, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    # A contour runs through the middles of pixels.
    offset = np.array([region.x - 0.5, region.y - 0.5])
    return [np.rint((line[:, 0] + offset) * zoom).astype(np.int32) for line in found]


def _area(region: Region) -> float:
    return float(region.pixels.sum()) if isinstance(region, Mask) else abs(_signed_area(region))


def _signed_area(polygon: Polygon) -> float:
    if len(polygon) < 3:
        return 0.0
    # From its first corner, so that what is far away loses no digits.
    x, y = (polygon[1:] - polygon[0]).T
    return float(x[:-1] @ y[1:] - x[1:] @ y[:-1]) / 2.0


def _common(first: Region, second: Region) -> float:
    if isinstance(first, Mask) and isinstance(second, Mask):
        x, y = max(first.x, second.x), max(first.y, second.y)
        one, other = (mask.pixels[max(y - mask.y, 0) :, max(x - mask.x, 0) :] for mask in (first, second))
        height, width = min(one.shape[0], other.shape[0]), min(one.shape[1], other.shape[1])
        return float((one[:height, :width] & other[:height, :width]).sum())
    if isinstance(first, Mask):
        return _covered(first, np.asarray(second))
    return _covered(second, first) if isinstance(second, Mask) else _area(_clipped(first, second))


def _within_frame(polygon: Polygon, size: tuple[int, int]) -> Polygon:
    if polygon.min() >= 0 and (polygon.max(axis=0) <= size).all():
        return polygon
    if _is_box(polygon):
        return np.asarray(np.clip(polygon, 0.0, size))
    return _clipped(polygon, box_polygon((0.0, 0.0, *size)))


def _is_box(polygon: Polygon) -> bool:
    """Whether it is what :func:`box_polygon` makes: boxes are many, and quickly dealt with."""
    if len(polygon) != 4:
        return False
    (x, y), opposite = polygon[0], polygon[2]
    return bool((polygon[1] == (opposite[0], y)).all() and (polygon[3] == (x, opposite[1])).all())


def _covered(mask: Mask, polygon: Polygon) -> float:
    """Area of a mask inside a polygon."""
    if len(polygon) < 3 or not mask.pixels.size:
        return 0.0
    if _is_box(polygon):  # columns and rows are cut each for itself
        low, high = polygon.min(axis=0), polygon.max(axis=0)
        height, width = mask.pixels.shape
        columns = _shares(mask.x, width, low[0], high[0])
        rows = _shares(mask.y, height, low[1], high[1])
        return float(rows @ (mask.pixels @ columns))
    total = 0.0
    for row in np.flatnonzero(mask.pixels.any(axis=1)).tolist():
        edges = np.flatnonzero(np.diff(mask.pixels[row].astype(np.int8), prepend=0, append=0)).tolist()
        for left, right in zip(edges[::2], edges[1::2], strict=True):
            run = box_polygon((mask.x + left, mask.y + row, right - left, 1))
            total += _area(_clipped(run, polygon))
    return total


def _shares(first: int, count: int, low: float, high: float) -> NDArray[np.float64]:
    """How much of pixels in a row, from the first on, is between two edges."""
    starts = np.arange(first, first + count, dtype=np.float64)
    return np.asarray(np.maximum(np.minimum(starts + 1.0, high) - np.maximum(starts, low), 0.0))


def _clipped(polygon: Polygon, window: Polygon) -> Polygon:
    """Part of a convex polygon inside another one (Sutherland and Hodgman)."""
    if _signed_area(window) < 0:
        window = window[::-1]
    for start, end in zip(window, _rolled(window), strict=True):
        if len(polygon) == 0:
            break
        dx, dy = end - start
        # How far inside of this edge each corner is.
        depth = dx * (polygon[:, 1] - start[1]) - dy * (polygon[:, 0] - start[0])
        kept: list[NDArray[np.float64]] = []
        for here, after, a, b in zip(polygon, _rolled(polygon), depth, _rolled(depth), strict=True):
            if a >= 0:
                kept.append(here)
            if (a < 0 < b) or (b < 0 < a):
                kept.append(here + (after - here) * (a / (a - b)))
        polygon = np.array(kept, dtype=np.float64).reshape(-1, 2)
    return polygon


def _rolled(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each one's successor (np.roll takes ten times as long)."""
    return np.concatenate([values[1:], values[:1]])
