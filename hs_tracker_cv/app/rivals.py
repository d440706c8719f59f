"""OpenCV's trackers, to be watched beside ours on the same frames."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2

from ..following import Step
from ..geometry import Box

__all__ = ["Rival", "rivals"]

_cv2: Any = cv2  # its stubs leave out the contrib modules


def rivals(models: str = "") -> dict[str, Callable[[], Any]]:
    """Those that this OpenCV has, by name.

    Parameters
    ----------
    models : str
        Folder that holds TrackerNano's ``*backbone*.onnx`` and ``*head*.onnx``; without it there is no TrackerNano.
    """
    legacy = getattr(cv2, "legacy", None)
    found = {
        "CSRT": getattr(cv2, "TrackerCSRT_create", None),
        "KCF": getattr(cv2, "TrackerKCF_create", None),
        "MIL": getattr(cv2, "TrackerMIL_create", None),
        "MOSSE": getattr(legacy, "TrackerMOSSE_create", None),
        "MedianFlow": getattr(legacy, "TrackerMedianFlow_create", None),
        "TrackerNano": _nano(models),
    }
    return {name: create for name, create in found.items() if create is not None}


def _nano(models: str) -> Callable[[], Any] | None:
    if not models or not hasattr(cv2, "TrackerNano_create"):
        return None
    backbones, heads = (sorted(Path(models).glob(f"*{part}*.onnx")) for part in ("backbone", "head"))
    if not backbones or not heads:
        return None

    def create() -> Any:
        parameters = _cv2.TrackerNano_Params()
        parameters.backbone, parameters.neckhead = str(backbones[0]), str(heads[0])
        return _cv2.TrackerNano_create(parameters)

    return create


class Rival:
    """One of them on one object; what it raises counts as lost, for OpenCV's trackers raise where they should say so.

    Parameters
    ----------
    create : callable
        Makes the tracker.
    roi : Box
        The object in the first frame.
    """

    def __init__(self, create: Callable[[], Any], roi: Box) -> None:
        self._roi = roi
        self._tracker: Any = create()

    def init(self, index: int, frame: Any) -> Step:
        """Start; the box is rounded, as OpenCV wants it."""
        box = self._roi.rounded()
        self._tracker.init(frame, box)
        return Step(index, None, Box(*box), "tracking", math.nan, None)

    def update(self, index: int, frame: Any) -> Step:
        """Find the object in the next frame."""
        started = time.perf_counter()
        try:
            ok, box = self._tracker.update(frame)
        except cv2.error:
            ok, box = False, (0, 0, 0, 0)
        seconds = time.perf_counter() - started
        return Step(
            index, None, Box(*box) if ok else None, "tracking" if ok else "lost", self._score(), None, seconds
        )

    def _score(self) -> float:
        """Between 0 and 1 where the tracker has such a score, otherwise NaN."""
        if not hasattr(self._tracker, "getTrackingScore"):
            return math.nan
        score = float(self._tracker.getTrackingScore())
        return score if 0.0 <= score <= 1.0 else math.nan
