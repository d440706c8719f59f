"""A sequence: frames by reference, true boxes, visible fraction, attributes, a content hash; and those of the suites.

Those of data sets are read by :mod:`eval.datasets`.
"""

from __future__ import annotations

import hashlib
import os
import shutil
import tempfile
import time
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import joblib
import numpy as np
from numpy.typing import NDArray

from .framesource import FrameSource
from .truthfiles import SequenceError

__all__ = ["Sequence", "load_suite"]

_CACHE_DAYS = 2.0
_RENDERERS = 2  # processes; each holds a whole sequence in memory


@dataclass(frozen=True)
class Sequence:
    """A video with its truth.

    Parameters
    ----------
    name : str
    frames : FrameSource
        T frames.
    boxes : ndarray, shape (T, 4), float64
        True boxes x, y, w, h, px, 0-based, of the whole object; NaN where there is none.
    visibility : ndarray, shape (T,), float64
        Visible fraction of the object, 0–1. Real data sets say only 0 or 1.
    attributes : tuple of str
    size : (int, int)
        Width and height of the frames, px.
    digest : str
        Hash of the frames and the truth.
    """

    name: str
    frames: FrameSource
    boxes: NDArray[np.float64]
    visibility: NDArray[np.float64]
    attributes: tuple[str, ...]
    size: tuple[int, int]
    digest: str

    def __post_init__(self) -> None:
        if self.boxes.shape != (len(self), 4) or self.visibility.shape != (len(self),):
            raise SequenceError(
                f"{self.name}: {len(self)} frames, but boxes {self.boxes.shape}, visibility {self.visibility.shape}"
            )
        if len(self) < 2:
            raise SequenceError(f"{self.name}: expected at least 2 frames, got {len(self)}")
        if not np.isfinite(self.boxes[0]).all():
            raise SequenceError(f"{self.name}: frame 0 has no box to start from")

    def __len__(self) -> int:
        """Number of frames T."""
        return self.frames.count

    def cut(self, count: int | None) -> Sequence:
        """Return the first `count` frames; all for None."""
        if count is None or count >= len(self):
            return self
        return replace(
            self,
            frames=replace(self.frames, count=count),
            boxes=self.boxes[:count],
            visibility=self.visibility[:count],
            digest=f"{self.digest}-{count}",
        )


# --- suites ------------------------------------------------------------------------------------------------


def load_suite(name: str) -> list[Sequence]:
    """Render a synthetic suite, or take it from the cache in the system's temporary folder.

    Raises
    ------
    SequenceError
        If there is no suite of that name; the message lists the known ones.
    """
    from datasets_synthetic import suite

    try:
        specs = suite(name)
    except ValueError as error:
        raise SequenceError(str(error)) from error
    cache, version = _cache_folder(), _renderer_version()
    entries = [cache / f"{spec.digest()[:24]}-{version}" for spec in specs]
    missing = [pair for pair in zip(specs, entries, strict=True) if not (pair[1] / "truth.npz").exists()]
    if missing:
        joblib.Parallel(n_jobs=min(_RENDERERS, len(missing)))(joblib.delayed(_render_into)(*pair) for pair in missing)
    return [_from_cache(entry) for entry in entries]


def _cache_folder() -> Path:
    user = os.getuid() if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"hs_tracker_cv-eval-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    for entry in folder.iterdir():
        if time.time() - entry.stat().st_mtime > _CACHE_DAYS * 86400.0:
            shutil.rmtree(entry, ignore_errors=True)
    return folder


def _renderer_version() -> str:
    digest = hashlib.sha256(f"{cv2.__version__} {np.__version__}".encode())
    found = find_spec("datasets_synthetic")
    for root in (found.submodule_search_locations or ()) if found else ():
        for path in sorted(Path(root).rglob("*.py")):
            digest.update(path.name.encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def _from_cache(entry: Path) -> Sequence:
    os.utime(entry)
    with np.load(entry / "truth.npz", allow_pickle=False) as truth:
        frames = np.load(entry / "frames.npy", mmap_mode="r")
        source = FrameSource((str(entry / "frames.npy"),), "array", len(frames))
        return Sequence(
            name=str(truth["name"]),
            frames=source,
            boxes=truth["boxes"],
            visibility=truth["visibility"],
            attributes=tuple(str(item) for item in truth["attributes"]),
            size=(frames.shape[2], frames.shape[1]),
            digest=str(truth["digest"]),
        )


def _render_into(spec: Any, entry: Path) -> None:
    """Render next to the place and move there in one step, so that an interrupted run leaves no half entry."""
    from datasets_synthetic import render

    rendered = render(spec)
    frames = np.ascontiguousarray(rendered.frames)
    boxes = np.asarray(rendered.boxes, dtype=np.float64)
    visibility = np.asarray(rendered.visibility, dtype=np.float64)
    digest = hashlib.sha256()
    for array in (frames, boxes, visibility):
        digest.update(f"{array.shape}{array.dtype}".encode() + array.tobytes())
    with tempfile.TemporaryDirectory(dir=entry.parent, ignore_cleanup_errors=True) as scratch:
        place = Path(scratch) / "entry"
        place.mkdir()
        np.save(place / "frames.npy", frames)
        np.savez(
            place / "truth.npz",
            name=np.array(rendered.name),
            boxes=boxes,
            visibility=visibility,
            attributes=np.array(list(rendered.attributes), dtype=np.str_),
            digest=np.array(digest.hexdigest()[:16]),
        )
        if not entry.exists():
            place.replace(entry)
