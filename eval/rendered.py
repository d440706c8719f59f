"""Frames of drawn sequences, painted when somebody asks for them and kept in a folder of limited size.

A suite of 300 sequences is five gigabytes of frames, of which few are needed at a time: the truth is known without
them, and what has been run needs none.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from datasets_synthetic import SequenceSpec

__all__ = ["RENDERERS", "digest_of", "frames_of", "kept_frames", "text_of"]

RENDERERS = ("deform", "effects", "motion", "pose", "render", "shapes", "textures")
"""Modules of the laboratory that decide about pixels and truth; how a spec came about does not."""

_DAYS = 2.0
_GIGABYTES = 3.0
_RENDERING = threading.Lock()


@lru_cache(maxsize=1)
def _renderer_version() -> str:
    """Hash of all that the pixels depend on beside the spec."""
    import datasets_synthetic

    digest = hashlib.sha256(f"{cv2.__version__} {np.__version__}".encode())
    for name in RENDERERS:
        digest.update(Path(datasets_synthetic.__file__).with_name(f"{name}.py").read_bytes())
    return digest.hexdigest()


def digest_of(spec: SequenceSpec) -> str:
    """Hash of a sequence, frames and truth, as 16 hex digits; known before they are rendered."""
    return hashlib.sha256(f"{spec.digest()} {_renderer_version()}".encode()).hexdigest()[:16]


def text_of(spec: SequenceSpec) -> str:
    """Spec as JSON: all that is needed to render it."""
    from datasets_synthetic import to_plain

    return json.dumps(to_plain(spec))


def frames_of(text: str, digest: str) -> Iterable[NDArray[Any]]:
    """Frames of a drawn sequence, from the kept ones or rendered now.

    Parameters
    ----------
    text : str
        Its spec as JSON, see :func:`text_of`.
    digest : str
        What :func:`digest_of` said of it.

    Returns
    -------
    iterable of T ndarray, shape (H, W) or (H, W, 3), uint8 or uint16
        Mapped from the disk where they are kept; painted one by one where there is no room for that.

    Raises
    ------
    ValueError
        If the laboratory renders it otherwise than when the digest was taken.
    """
    kept = kept_frames() / f"{digest}.npy"
    # One at a time: threads that follow the same sequence side by side want it rendered once.
    with _RENDERING:
        with suppress(OSError):
            os.utime(kept)
            return _mapped(kept)
        count, frames = _render(text, digest)
        with suppress(OSError):
            _keep(count, frames, kept)
            return _mapped(kept)
    return _render(text, digest)[1]


def _mapped(kept: Path) -> NDArray[Any]:
    frames: NDArray[Any] = np.load(kept, mmap_mode="r")
    return frames


def _render(text: str, digest: str) -> tuple[int, Iterator[NDArray[Any]]]:
    """Number of frames, and the frames as they are painted."""
    from datasets_synthetic import SequenceSpec, frames, from_plain

    spec = from_plain(SequenceSpec, json.loads(text))
    if digest_of(spec) != digest:
        raise ValueError(f"the laboratory renders {spec.name} otherwise than it did: run again")
    return spec.frames, frames(spec)


def _keep(count: int, frames: Iterator[NDArray[Any]], kept: Path) -> None:
    """Write one by one, next to the place, and move there in one step; raises OSError where there is no room."""
    with tempfile.NamedTemporaryFile(dir=kept.parent, suffix=".part", delete=False) as scratch:
        part = Path(scratch.name)
        try:
            for index, frame in enumerate(frames):
                if index == 0:
                    header = {"descr": frame.dtype.str, "fortran_order": False, "shape": (count, *frame.shape)}
                    np.lib.format.write_array_header_1_0(scratch, header)
                scratch.write(np.ascontiguousarray(frame).data)
            scratch.close()
            part.replace(kept)
        finally:
            part.unlink(missing_ok=True)
    _trim(kept)


def _trim(kept: Path) -> None:
    """Remove what has not been used for days, and the oldest until the rest fits; never what was just written."""
    files = []
    for path in kept.parent.iterdir():
        with suppress(OSError):
            files.append((path.stat().st_mtime, path.stat().st_size, path))
    room = _GIGABYTES * 2**30
    for used, size, path in sorted(files, reverse=True):
        room -= size
        if path != kept and (room < 0 or time.time() - used > _DAYS * 86400.0):
            with suppress(OSError):
                path.unlink()


def kept_frames() -> Path:
    """Folder of the kept frames; made when missing."""
    user = os.getuid() if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"hs_tracker_cv-frames-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder
