"""One picture of a sequence with its truth drawn in, for a person to judge it by."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from .effects import to_bytes
from .sequence import Sequence

__all__ = ["contact_sheet"]

Image = NDArray[np.uint8]

_COLUMNS, _TILES, _WIDTH, _GAP, _CAPTION = 4, 8, 400, 8, 22
_BOX, _VISIBLE, _OUTLINE = (60, 60, 255), (255, 190, 60), (0, 235, 255)
_INK, _PAPER = (60, 50, 45), (250, 250, 250)


def contact_sheet(sequence: Sequence) -> Image:
    """Eight frames, evenly spaced, with truth.

    Parameters
    ----------
    sequence : Sequence

    Returns
    -------
    ndarray, shape (H, W, 3), uint8, BGR
        Red: amodal box. Blue: box of what is seen, where that is less. Yellow: outline of the visible mask.
    """
    times = np.linspace(0, len(sequence) - 1, min(_TILES, len(sequence))).round().astype(int).tolist()
    tiles = [_tile(sequence, t) for t in times]
    tiles += [np.full_like(tiles[0], 250)] * (-len(tiles) % _COLUMNS)
    rows = [np.hstack(tiles[k : k + _COLUMNS]) for k in range(0, len(tiles), _COLUMNS)]
    return np.vstack([_heading(sequence, rows[0].shape[1]), *rows])


def _heading(sequence: Sequence, width: int) -> Image:
    heading = np.full((58, width, 3), _PAPER, np.uint8)
    _write(heading, sequence.name, (_GAP, 24), 0.7)
    height, columns = sequence.frames.shape[1:3]
    facts = f"{columns} x {height}, {len(sequence)} frames, {', '.join(sequence.attributes)}"
    _write(heading, f"{facts}  [{sequence.spec.digest()}]", (_GAP, 46), 0.45)
    x = width - 440
    for colour, text in ((_BOX, "whole target"), (_VISIBLE, "visible part"), (_OUTLINE, "visible mask")):
        cv2.line(heading, (x, 19), (x + 22, 19), colour, 3, cv2.LINE_AA)
        _write(heading, text, (x + 28, 24), 0.45)
        x += 146
    return heading


def _in_bytes(sequence: Sequence, t: int) -> Image:
    """Frame t as a screen shows it."""
    frame, deep = sequence.frames[t], sequence.spec.deep
    if deep is not None:
        frame = to_bytes((frame.astype(np.float32) - deep.low) * np.float32(255.0 / (deep.high - deep.low)))
    return np.asarray(frame, dtype=np.uint8)


def _tile(sequence: Sequence, t: int) -> Image:
    frame = _in_bytes(sequence, t)
    picture = cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) if frame.ndim == 2 else frame
    scale = _WIDTH / picture.shape[1]
    size = (_WIDTH, round(picture.shape[0] * scale))
    way = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    picture = np.asarray(cv2.resize(picture, size, interpolation=way), dtype=np.uint8)
    mask = cv2.resize(sequence.masks[t].astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(picture, contours, -1, _OUTLINE, 1)
    _rectangle(picture, sequence.boxes[t] * scale, _BOX)
    if 0 < sequence.visibility[t] < 0.999:
        _rectangle(picture, sequence.visible_boxes[t] * scale, _VISIBLE)
    caption = np.full((_CAPTION, _WIDTH, 3), _PAPER, np.uint8)
    _write(caption, f"frame {t}   visible {100 * sequence.visibility[t]:.0f} %", (2, 15), 0.45)
    tile = np.vstack([picture, caption])
    return np.pad(tile, ((0, 0), (_GAP // 2, _GAP // 2), (0, 0)), constant_values=_PAPER[0])


def _rectangle(picture: Image, box: NDArray[np.float64], colour: tuple[int, int, int]) -> None:
    x, y, w, h = box.tolist()
    cv2.rectangle(picture, (round(x), round(y)), (round(x + w) - 1, round(y + h) - 1), colour, 1)


def _write(picture: Image, text: str, place: tuple[int, int], size: float) -> None:
    cv2.putText(picture, text, place, cv2.FONT_HERSHEY_SIMPLEX, size, _INK, 1, cv2.LINE_AA)
