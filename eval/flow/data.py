"""Pairs of frames whose true flow is known: folders as Middlebury's and KITTI's, and the synthetic suites."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.export import read_flo

if TYPE_CHECKING:
    from datasets_synthetic import SequenceSpec

__all__ = [
    "TUNED_ON",
    "FlowPair",
    "dataset_pairs",
    "kitti_pairs",
    "known_flow",
    "middlebury_pairs",
    "suite_pairs",
]

TUNED_ON = frozenset({"Dimetrodon", "Grove2", "RubberWhale", "Urban2"})
"""Middlebury pairs on which our presets' parameters were chosen; the others are reported separately."""

UNKNOWN_FLOW = 1e9
"""Middlebury's mark: a component larger than this means that the truth is not known there."""

CONTEXT = 2
"""Frames of a synthetic sequence that a pair carries on either side, for methods that use more than two."""


@dataclass(frozen=True, eq=False)
class FlowPair:
    """Two frames and the true flow from the first to the second.

    Parameters
    ----------
    name : str
        Unique within a run; also the name of its picture files.
    frames : tuple of ndarray, each (H, W, 3) uint8 BGR
        The pair, or the short sequence round it for methods that use more than two frames.
    index : int
        ``frames[index]`` and ``frames[index + 1]`` are the pair.
    flow : ndarray, shape (H, W, 2), float32
        Truth, px per frame.
    valid : ndarray of bool, shape (H, W)
        Where the truth is known.
    group : str
        "tuned on" or "held out" for pairs with a published split, else "".
    """

    name: str
    frames: tuple[NDArray[np.uint8], ...]
    index: int
    flow: NDArray[np.float32]
    valid: NDArray[np.bool_]
    group: str = ""
    fingerprint: str = field(init=False, default="")

    def __post_init__(self) -> None:
        """Check the shapes and compute the content hash, by which results are kept."""
        if not 0 <= self.index < len(self.frames) - 1:
            raise ValueError(
                f"expected an index below {len(self.frames) - 1} for {len(self.frames)} frames, got {self.index}"
            )
        size = self.first.shape[:2]
        if self.second.shape[:2] != size or self.flow.shape != (*size, 2) or self.valid.shape != size:
            raise ValueError(
                f"{self.name}: expected frames, flow and valid of one size, got {size}, {self.second.shape[:2]}, "
                f"{self.flow.shape}, {self.valid.shape}"
            )
        digest = hashlib.sha256(f"{self.index}/{len(self.frames)}".encode())
        arrays: tuple[NDArray[Any], ...] = (*self.frames, self.flow, self.valid)
        for array in arrays:
            digest.update(f"{array.shape}{array.dtype}".encode())
            digest.update(np.ascontiguousarray(array).tobytes())
        object.__setattr__(self, "fingerprint", digest.hexdigest()[:16])

    @property
    def first(self) -> NDArray[np.uint8]:
        """The earlier frame of the pair."""
        return self.frames[self.index]

    @property
    def second(self) -> NDArray[np.uint8]:
        """The later frame of the pair."""
        return self.frames[self.index + 1]


def known_flow(path: Path) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Read a Middlebury .flo file in which the flow of some pixels may not be known.

    Parameters
    ----------
    path : Path

    Returns
    -------
    flow : ndarray, shape (H, W, 2), float32
        px per frame; 0 where unknown.
    valid : ndarray of bool, shape (H, W)

    Raises
    ------
    ValueError
        If it is no .flo file.
    """
    flow = read_flo(path)
    valid = np.asarray((np.abs(flow) <= UNKNOWN_FLOW).all(axis=2), dtype=np.bool_)
    return np.where(valid[:, :, np.newaxis], flow, np.float32(0)).astype(np.float32), valid


def middlebury_pairs(folder: Path) -> Iterator[FlowPair]:
    """Pairs of a folder in Middlebury's layout: ``NAME/frame10.png``, ``NAME/frame11.png``, ``NAME/flow10.flo``.

    Parameters
    ----------
    folder : Path

    Yields
    ------
    FlowPair
        In the order of their names. The published split is noted in ``group`` only where all of
        :data:`TUNED_ON` are present, that is where the folder is Middlebury's own.

    Raises
    ------
    ValueError
        If the folder holds no pair, or a frame cannot be read.
    """
    truths = _truths(folder, "*/flow10.flo", "NAME/frame10.png, frame11.png and flow10.flo")
    split = {path.parent.name for path in truths} >= TUNED_ON
    for path in truths:
        name = path.parent.name
        group = ("tuned on" if name in TUNED_ON else "held out") if split else ""
        yield FlowPair(name, _frames(path.with_name("frame")), 0, *known_flow(path), group)


def _truths(folder: Path, pattern: str, expected: str) -> list[Path]:
    found = sorted(folder.glob(pattern))
    if not found:
        raise ValueError(f"expected a folder with {expected}, got {folder}")
    return found


def _frames(place: Path) -> tuple[NDArray[np.uint8], ...]:
    """The two frames of a pair, whose names go on with 10 and 11 with Middlebury and KITTI."""
    paths = (place.with_name(f"{place.name}{number}.png") for number in (10, 11))
    return tuple(np.asarray(_read_image(path, cv2.IMREAD_COLOR), dtype=np.uint8) for path in paths)


def _read_image(path: Path, flags: int) -> NDArray[Any]:
    # From its bytes: cv2 dies of a name that is not UTF-8; and it raises of an empty file.
    data = np.fromfile(path, np.uint8)
    image = cv2.imdecode(data, flags) if data.size else None
    if image is None:
        raise ValueError(f"expected a readable image, got {path}")
    return image


def kitti_pairs(folder: Path) -> Iterator[FlowPair]:
    """Pairs in KITTI's layout, ``image_2/NAME_10.png``, ``NAME_11.png``, ``flow_occ/NAME_10.png``, here or below.

    Parameters
    ----------
    folder : Path

    Yields
    ------
    FlowPair
        In the order of their names.

    Raises
    ------
    ValueError
        If the folder holds no pair, or a file cannot be read.
    """
    for path in _truths(folder, "**/flow_occ/*_10.png", "flow_occ/NAME_10.png and image_2"):
        place, name = path.parents[1], path.stem.removesuffix("_10")
        stored = _read_image(path, cv2.IMREAD_UNCHANGED)
        if stored.dtype != np.uint16 or stored.ndim != 3:
            raise ValueError(f"expected a flow of 16 bits and three channels, got {path}")
        valid = np.asarray(stored[..., 0] > 0)
        flow = (stored[..., :0:-1].astype(np.float32) - 32768.0) / 64.0
        flow = np.where(valid[..., np.newaxis], flow, np.float32(0))
        own = name if place == folder else f"{place.name}-{name}"
        yield FlowPair(own, _frames(place / "image_2" / f"{name}_"), 0, flow, valid)


def dataset_pairs(dataset: str) -> Iterator[FlowPair]:
    """Pairs of a dataset given on the command line as ``kind:folder``.

    Parameters
    ----------
    dataset : str
        ``middlebury:DIR`` or ``kitti:DIR``.

    Returns
    -------
    iterator of FlowPair

    Raises
    ------
    ValueError
        If the kind is unknown.
    """
    kind, _, folder = dataset.partition(":")
    readers = {"middlebury": middlebury_pairs, "kitti": kitti_pairs}
    if kind not in readers or not folder:
        raise ValueError(f"expected middlebury:DIR or kitti:DIR, got {dataset!r}")
    return readers[kind](Path(folder))


def suite_pairs(suite: str, count: int) -> Iterator[FlowPair]:
    """A few pairs of every sequence of a synthetic suite.

    Parameters
    ----------
    suite : str
        As ``datasets_synthetic.suite`` takes it.
    count : int
        Pairs per sequence, spread over its length.

    Yields
    ------
    FlowPair
        With up to two frames more on either side, for methods that use a sequence.

    Raises
    ------
    ValueError
        If the suite is unknown; names the known ones.
    """
    from joblib import Parallel, delayed

    from datasets_synthetic import suite as specs_of

    jobs = Parallel(n_jobs=2, return_as="generator")
    for pairs in jobs(delayed(_sequence_pairs)(spec, count) for spec in specs_of(suite)):
        yield from pairs


def _sequence_pairs(spec: SequenceSpec, count: int) -> list[FlowPair]:
    """Render one sequence and keep of it only what the pairs need."""
    from datasets_synthetic import render

    sequence = render(spec)
    pairs = []
    last = len(sequence.frames) - 2
    for t in sorted({round(place) for place in np.linspace(0, last, count + 2)[1:-1]}):
        flow, valid = sequence.flow(t)
        start = max(t - CONTEXT, 0)
        frames = tuple(np.array(frame) for frame in sequence.frames[start : t + CONTEXT + 2])
        pairs.append(FlowPair(f"{spec.name}-{t:03d}", frames, t - start, flow, valid))
    return pairs
