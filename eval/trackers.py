"""The trackers that can be judged: a literal table, and any ``pkg.module:factory`` besides.

A factory takes the tracker's parameters as keywords and returns an object with cv2's ``init(image, boundingBox)``
and ``update(image) -> (ok, box)``. Nothing else is asked of it.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["DEFAULT_TRACKERS", "TRACKERS", "TrackerSpec", "code_version", "find_tracker"]


_cv2: Any = cv2  # its stubs leave out the contrib modules


@dataclass(frozen=True)
class TrackerSpec:
    """How to make a tracker, and what its results depend on.

    Parameters
    ----------
    name : str
        As it stands in tables and file names.
    factory : str
        ``pkg.module:callable``; resolved in the process of the tracker only.
    params : mapping, optional
        Keyword arguments of the factory; JSON values. Part of the key of every result.
    sources : tuple of str, optional
        Modules or packages whose source is part of the key; cv2's version always is.
    repeats : int, optional
        Runs to average, for trackers that differ from run to run.
    sees_truth : bool, optional
        Test double: the runner hands the true boxes to the factory as `boxes`.
    """

    name: str
    factory: str
    params: Mapping[str, Any] = field(default_factory=dict)
    sources: tuple[str, ...] = ()
    repeats: int = 1
    sees_truth: bool = False

    def __post_init__(self) -> None:
        json.dumps(dict(self.params))
        if self.repeats < 1:
            raise ValueError(f"expected at least one repeat, got {self.repeats}")


def trackerhs(**params: Any) -> Any:
    """Ours; `params` are fields of ``TrackerHS_Params``."""
    import hs_tracker_cv

    return hs_tracker_cv.TrackerHS_create(hs_tracker_cv.TrackerHS_Params(**params))


def csrt() -> Any:
    """CSRT as OpenCV ships it."""
    return _cv2.TrackerCSRT_create()


def mil() -> Any:
    """MIL as OpenCV ships it; differs from run to run."""
    return _cv2.TrackerMIL_create()


def mosse() -> Any:
    """MOSSE of ``cv2.legacy``."""
    return _cv2.legacy.TrackerMOSSE_create()


def median_flow() -> Any:
    """MedianFlow of ``cv2.legacy``."""
    return _cv2.legacy.TrackerMedianFlow_create()


class KCF:
    """KCF as OpenCV ships it; never recovers from the motion between its init and its first update.

    It raises on gray frames, so it gets them in three channels, as a user would do after the first exception.
    """

    def __init__(self) -> None:
        self._tracker = _cv2.TrackerKCF_create()

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start."""
        self._tracker.init(_in_colour(image), boundingBox)

    def update(self, image: NDArray[Any]) -> tuple[bool, Any]:
        """Locate the target."""
        ok, box = self._tracker.update(_in_colour(image))
        return ok, box


class PrimedKCF(KCF):
    """KCF at its best: it detects from the first update on, and never gives up.

    As shipped it does not detect in its first update, and is off ever after by the motion up to there; an update
    on the frame of `init` cures it. A detection threshold of 0 keeps it from giving up at its first low peak.
    """

    def __init__(self) -> None:
        parameters = _cv2.TrackerKCF_Params()
        parameters.detect_thresh = 0.0
        self._tracker = _cv2.TrackerKCF_create(parameters)

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start, and prime."""
        super().init(image, boundingBox)
        self.update(image)


def _in_colour(image: NDArray[Any]) -> NDArray[Any]:
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 or image.shape[2] == 1 else image


class Static:
    """The box never moves: what a score is worth when nothing is tracked."""

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Remember the box."""
        self._box = boundingBox

    def update(self, image: NDArray[Any]) -> tuple[bool, tuple[int, int, int, int]]:
        """Return it."""
        return True, self._box


class Oracle:
    """Test double that knows the truth; it must score 1 in everything.

    Parameters
    ----------
    boxes : sequence of (x, y, w, h) or None
        The true box of each frame; None where the target is invisible.
    """

    def __init__(self, boxes: list[list[float] | None]) -> None:
        self._boxes = boxes
        self._frame = 0

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start at frame 0."""
        self._frame = 0

    def update(self, image: NDArray[Any]) -> tuple[bool, list[float]]:
        """Return the truth."""
        self._frame += 1
        box = self._boxes[self._frame]
        return box is not None, [0.0] * 4 if box is None else box


_HERE = "eval.trackers"

TRACKERS: dict[str, TrackerSpec] = {
    "TrackerHS": TrackerSpec("TrackerHS", f"{_HERE}:trackerhs", sources=("hs_tracker_cv",)),
    "CSRT": TrackerSpec("CSRT", f"{_HERE}:csrt"),
    "KCF": TrackerSpec("KCF", f"{_HERE}:KCF"),
    "KCF-primed": TrackerSpec("KCF-primed", f"{_HERE}:PrimedKCF"),
    "MIL": TrackerSpec("MIL", f"{_HERE}:mil", repeats=3),
    "MOSSE": TrackerSpec("MOSSE", f"{_HERE}:mosse"),
    "MedianFlow": TrackerSpec("MedianFlow", f"{_HERE}:median_flow"),
    "TemplateMatching": TrackerSpec(
        "TemplateMatching",
        "eval.baselines.template_matching:TemplateMatching",
        sources=("eval.baselines.template_matching",),
    ),
    "FrameDifferencing": TrackerSpec(
        "FrameDifferencing",
        "eval.baselines.frame_differencing:FrameDifferencing",
        sources=("eval.baselines.frame_differencing", "eval.baselines.regions"),
    ),
    "BackgroundModel": TrackerSpec(
        "BackgroundModel",
        "eval.baselines.background_model:BackgroundModel",
        sources=("eval.baselines.background_model", "eval.baselines.regions"),
    ),
    "Static": TrackerSpec("Static", f"{_HERE}:Static"),
    "Oracle": TrackerSpec("Oracle", f"{_HERE}:Oracle", sees_truth=True),
}

DEFAULT_TRACKERS: tuple[str, ...] = tuple(name for name, spec in TRACKERS.items() if not spec.sees_truth)
"""What is run when no tracker is named."""


def find_tracker(name: str) -> TrackerSpec:
    """Look a tracker up by name, or take ``pkg.module:factory``.

    Raises
    ------
    ValueError
        If the name is neither; the message lists the known ones.
    """
    if name in TRACKERS:
        return TRACKERS[name]
    module, _, attribute = name.partition(":")
    if module and attribute:
        if _find_spec(module) is None:
            raise ValueError(f"cannot find the module {module!r} of the tracker {name!r}")
        return TrackerSpec(name, name, sources=(module.partition(".")[0],))
    raise ValueError(f"unknown tracker {name!r}; known: {', '.join(TRACKERS)}, or any pkg.module:factory")


def code_version(spec: TrackerSpec) -> str:
    """Hash of what a tracker's answers depend on besides the frames: factory, parameters, source, cv2's version."""
    digest = hashlib.sha256()
    for part in (spec.factory, json.dumps(dict(spec.params), sort_keys=True), str(cv2.__version__), np.__version__):
        digest.update(part.encode() + b"\0")
    for source in spec.sources:
        for path in _source_files(source):
            digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _source_files(module: str) -> list[Path]:
    found = _find_spec(module)
    if found is None:
        raise ValueError(f"cannot find the module {module!r}")
    if found.submodule_search_locations:
        return sorted(path for root in found.submodule_search_locations for path in Path(root).rglob("*.py"))
    return [Path(found.origin)] if found.origin and found.origin.endswith(".py") else []


def _find_spec(module: str) -> Any:
    try:
        return importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return None
