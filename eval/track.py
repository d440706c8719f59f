"""One tracker on its way through a sequence: the service that its process runs (see :mod:`eval.worker`).

Requests: ``{"do": "find", "factory": "pkg.module:name"}``, which only says whether there is such a thing; ``{"do":
"open", "factory": "pkg.module:name", "params": {...}, "seed": 0}``; ``{"do": "frame"}`` with an
image, which the next two are about; ``{"do": "init", "box": [x, y, w, h]}``; ``{"do": "update"}``, whose answer is
``{"ok": true, "box": [x, y, w, h], "score": 0.9, "cpu_ms": 1.2, "wall_ms": 1.3}``: the times are of the call of
`update` alone. A rotated box comes as its four `corners` beside the box round it. ``{"do": "mask"}`` gives the
object's pixels as an array, of a tracker that is `masked`. A process may be asked to open one tracker after another.
"""

from __future__ import annotations

import math
import random
from collections.abc import Mapping, Sequence
from time import perf_counter, process_time
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .worker import Arrays, resolve

__all__ = ["Track", "read_answer", "whole_box"]


def whole_box(box: Sequence[float], size: tuple[int, int]) -> tuple[int, int, int, int]:
    """Box that a tracker starts from, here and in other people's harnesses: whole pixels inside the frame.

    The edges are rounded. cv2's newer trackers take nothing but whole numbers, and some of them die of a box that
    reaches outside.

    Parameters
    ----------
    box : sequence of float
        x, y, w, h, px.
    size : (int, int)
        Width and height of the frame, px.

    Returns
    -------
    (int, int, int, int)
        At least one pixel wide and high.
    """
    (x, y, w, h), (width, height) = box, size
    left, top = min(max(round(x), 0), width - 1), min(max(round(y), 0), height - 1)
    right, bottom = min(max(round(x + w), left + 1), width), min(max(round(y + h), top + 1), height)
    return left, top, right - left, bottom - top


class Track:
    """A tracker and the frame that it is given."""

    def __init__(self) -> None:
        self._tracker: Any = None
        self._frame: NDArray[Any] | None = None

    def answer(self, content: Mapping[str, Any], arrays: Arrays) -> tuple[Mapping[str, Any], Arrays]:
        """Do what is asked.

        Raises
        ------
        ValueError
            If the tracker refuses its box, or answers something that is no box.
        """
        if content["do"] == "find":
            resolve(content["factory"])
        elif content["do"] == "open":
            # Whatever was served before: the same dice.
            cv2.setRNGSeed(content["seed"])
            random.seed(content["seed"])
            np.random.seed(content["seed"])  # noqa: NPY002 - the one that trackers draw from unasked
            params = dict(content["params"])
            if arrays:  # a test double that sees the truth
                params |= {"boxes": arrays[0], "regions": bytes(arrays[1]).decode().splitlines()}
            self._tracker = resolve(content["factory"])(**params)
        elif content["do"] == "frame":
            self._frame = arrays[0]
        elif content["do"] == "init":
            self._init(content["box"])
        elif content["do"] == "mask":
            return {}, self._mask()
        else:
            return self._update(), ()
        return {}, ()

    def _init(self, box: list[int]) -> None:
        whole = tuple(int(value) for value in box)
        if self._tracker.init(self._frame, whole) is False:
            raise ValueError(f"init refused the box {whole}")

    def _update(self) -> dict[str, Any]:
        start, busy = perf_counter(), process_time()
        answer = self._tracker.update(self._frame)
        times = {"cpu_ms": 1000.0 * (process_time() - busy), "wall_ms": 1000.0 * (perf_counter() - start)}
        ok, box, corners = read_answer(answer)
        masked = hasattr(self._tracker, "getMask")
        return {"ok": ok, "box": box, "corners": corners, "masked": masked, "score": self._score(), **times}

    def _mask(self) -> Arrays:
        """The object's pixels, where the tracker knows them."""
        mask = self._tracker.getMask()
        if mask is None or self._frame is None:
            return ()
        found = np.asarray(mask)
        if found.shape != self._frame.shape[:2]:
            raise ValueError(f"getMask returned shape {found.shape}, expected {self._frame.shape[:2]}")
        return (np.asarray(found != 0),)

    def _score(self) -> float:
        # OpenCV 5 gives every tracker the method; −1 is its way of saying that there is no score.
        score = float(self._tracker.getTrackingScore()) if hasattr(self._tracker, "getTrackingScore") else math.nan
        return score if score >= 0 else math.nan


def read_answer(answer: Any) -> tuple[bool, list[float], list[float]]:
    """Flag, box, and the corners of a rotated one: x, y of four, or OpenCV's centre, size and angle.

    Raises
    ------
    ValueError
        If that is no answer of a tracker's.
    """
    try:
        ok, box = answer
        if isinstance(box, tuple) and len(box) == 3:
            box = cv2.boxPoints(box).ravel()
        values = [float(value) for value in box]
    except (TypeError, ValueError, cv2.error):
        values = []
    if len(values) == 8:
        x, y = values[0::2], values[1::2]
        return bool(ok), [min(x), min(y), max(x) - min(x), max(y) - min(y)], values
    if len(values) != 4:
        raise ValueError(f"update returned {answer!r}, expected (ok, (x, y, w, h))")
    return bool(ok), values, []
