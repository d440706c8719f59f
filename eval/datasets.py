"""Data sets on disk: OTB, VOT and GOT-10k folders, a video plus a box file; OTB-100 as it was published.

A data set is a mapping of names to what reads each sequence: nothing is read, and nothing complained about, that
nobody asked for.
"""

from __future__ import annotations

import hashlib
import json
import os
import tempfile
import time
import warnings
from collections.abc import Callable, Iterable, Mapping
from collections.abc import Sequence as Listing
from contextlib import suppress
from functools import partial
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hs_tracker_cv.video import VideoError, image_files, native_name, read_image

from .framesource import FrameSource
from .sequences import Sequence
from .truthfiles import SequenceError, SequenceWarning, read_attributes, read_boxes, read_numbers, read_scene

__all__ = ["DATASETS", "load_dataset"]

Readers = Mapping[str, Callable[[], Sequence]]

OTB_FIRST_FRAME = {
    "blurcar1": 247, "blurcar3": 3, "blurcar4": 18, "david": 300, "diving": 1, "football1": 1, "freeman3": 1,
    "freeman4": 1, "tiger1": 6,
}  # fmt: skip
"""Number of the image that the first box of OTB-100 belongs to, where there are more images than boxes."""

_STORED_SECONDS = 2.0  # a file changed later than that might change again without its time telling so


# --- what all layouts share --------------------------------------------------------------------------------


def _images_in(folder: Path) -> list[Path]:
    try:
        found = image_files(folder)
    except OSError as error:
        raise SequenceError(f"cannot list {folder}: {error.strerror or error}") from error
    if not found:
        raise SequenceError(f"no images in {folder}")
    return found


def _from_images(
    name: str,
    folder: Path,
    images: Listing[Path],
    boxes: NDArray[np.float64],
    visible: NDArray[np.float64] | None,
    scene: str = "",
) -> Sequence:
    """Make a sequence of images and of boxes, of which either may be one too many."""
    count = _common_count(name, len(images), len(boxes))
    try:
        first = read_image(images[0])
    except VideoError as error:
        raise SequenceError(f"{name}: cannot read {error}") from error
    paths = tuple(str(path) for path in images[:count])
    size = (first.shape[1], first.shape[0])
    return _sequence(name, FrameSource(paths, "images", count), boxes[:count], visible, folder, size, scene)


def _common_count(name: str, frames: int, boxes: int) -> int:
    if abs(frames - boxes) > 1:
        raise SequenceError(f"{name}: {frames} frames but {boxes} boxes")
    if frames != boxes:
        # Common in the published sets.
        warnings.warn(
            f"{name}: {frames} frames but {boxes} boxes; the last is left out", SequenceWarning, stacklevel=2
        )
    return min(frames, boxes)


def _sequence(
    name: str,
    source: FrameSource,
    boxes: NDArray[np.float64],
    visible: NDArray[np.float64] | None,
    folder: Path,
    size: tuple[int, int],
    scene: str = "",
) -> Sequence:
    """Whatever the layout: where there is no box there is no object, and our exports say what can be seen of it."""
    count = len(boxes)
    exact = read_numbers(folder / "visibility.txt", count, 1.0)
    shown = exact if exact is not None else visible
    presence = np.asarray(np.isfinite(boxes).all(axis=1), dtype=np.float64)
    visibility = presence if shown is None else presence * shown[:count]
    digest = _hash(source.paths, boxes, visibility)
    scene = read_scene(folder) or scene
    return Sequence(name, source, boxes, visibility, read_attributes(folder), size, digest, scene=scene)


def _hash(paths: Iterable[str], *arrays: NDArray[np.float64]) -> str:
    digest = hashlib.sha256(_hash_files([Path(path) for path in paths]).encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _hash_files(paths: list[Path]) -> str:
    """Hash of the bytes of files; kept, so that files which have not changed since are not read again."""
    states = [path.stat() for path in paths]
    listing = [
        (str(path.resolve()), state.st_size, state.st_mtime_ns, state.st_ino)
        for path, state in zip(paths, states, strict=True)
    ]
    kept = _digest_folder() / hashlib.sha256(json.dumps(listing).encode()).hexdigest()
    with suppress(OSError):
        return kept.read_text(encoding="ascii")
    digest = hashlib.sha256()
    for path in paths:
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    if max(state.st_mtime for state in states) < time.time() - _STORED_SECONDS:
        scratch = kept.with_name(f"{kept.name}.{os.getpid()}")
        with suppress(OSError):
            scratch.write_text(digest.hexdigest(), encoding="ascii")
            scratch.replace(kept)
    return digest.hexdigest()


def _digest_folder() -> Path:
    user = os.getuid() if hasattr(os, "getuid") else "user"
    folder = Path(tempfile.gettempdir()) / f"hs_tracker_cv-digests-{user}"
    folder.mkdir(mode=0o700, exist_ok=True)
    return folder


# --- layouts -----------------------------------------------------------------------------------------------


def _otb(folder: Path, name: str, truth: Path) -> Sequence:
    images = _images_in(folder / "img")
    boxes = read_boxes(truth, first=1, count=len(images))
    start = OTB_FIRST_FRAME.get(folder.name.lower())
    if start is not None and len(images) != len(boxes):
        numbered = [path for path in images if path.stem.isdecimal() and start <= int(path.stem) < start + len(boxes)]
        images = numbered if len(numbered) == len(boxes) else images
    return _from_images(name, folder, images, boxes, None, folder.name)


def _otb_readers(folder: Path) -> Readers:
    """One sequence, or as many as there are files of truth: Jogging and Skating2 have two, Human4 an empty one."""
    truths = [path for path in sorted(folder.glob("groundtruth_rect*.txt")) if path.stat().st_size > 0]
    if len(truths) < 2:
        truth = truths[0] if truths else folder / "groundtruth_rect.txt"
        return {folder.name: partial(_otb, folder, folder.name, truth)}
    names = [f"{folder.name}-{path.stem.removeprefix('groundtruth_rect').strip('.') or 0}" for path in truths]
    return {name: partial(_otb, folder, name, path) for name, path in zip(names, truths, strict=True)}


def _vot(folder: Path) -> Sequence:
    images = _images_in(folder / "color" if (folder / "color").is_dir() else folder)
    boxes = read_boxes(folder / "groundtruth.txt", first=0, count=len(images))
    return _from_images(folder.name, folder, images, boxes, None)


def _got10k(folder: Path) -> Sequence:
    images = _images_in(folder)
    boxes = read_boxes(folder / "groundtruth.txt", first=0, count=len(images))
    # cover.label counts eighths of the object that can be seen.
    cover = read_numbers(folder / "cover.label", len(boxes), 8.0)
    absence = read_numbers(folder / "absence.label", len(boxes), 1.0)
    visible = None if cover is None else cover / 8.0
    if absence is not None:
        visible = (1.0 - absence) * (1.0 if visible is None else visible)
    return _from_images(folder.name, folder, images, boxes, visible)


def _folders(marker: str, readers: Callable[[Path], Readers]) -> Callable[[str], Readers]:
    def find(where: str) -> Readers:
        root = Path(where).expanduser().absolute()
        if not root.is_dir():
            raise SequenceError(f"no such folder: {root}")
        folders = [root] if any(root.glob(marker)) else sorted(p for p in root.iterdir() if any(p.glob(marker)))
        if not folders:
            raise SequenceError(f"no folder with a {marker} in {root}")
        return {name: read for folder in folders for name, read in readers(folder).items()}

    return find


def _video(where: str) -> Readers:
    """``VIDEO+BOXFILE``: boxes 0-based, one line per frame."""
    video, plus, box_file = where.rpartition("+")
    if not plus:
        raise SequenceError(f"expected VIDEO+BOXFILE, got {where!r}")
    paths = [Path(word).expanduser().absolute() for word in (video, box_file)]
    for path in paths:
        if not path.is_file():
            raise SequenceError(f"no such file: {path}")
    return {paths[0].stem: partial(_read_video, *paths)}


def _read_video(video: Path, box_file: Path) -> Sequence:
    try:
        capture = cv2.VideoCapture(native_name(video))
    except VideoError as error:
        raise SequenceError(str(error)) from error
    try:
        if not capture.isOpened():
            raise SequenceError(f"cannot open the video {video}")
        size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        frames = 0
        # The frame count in a header is an estimate for many codecs; counting is exact.
        while capture.grab():
            frames += 1
    finally:
        capture.release()
    boxes = read_boxes(box_file, first=0, count=frames)
    count = _common_count(video.stem, frames, len(boxes))
    source = FrameSource((str(video),), "video", count)
    return _sequence(video.stem, source, boxes[:count], None, box_file.parent, size)


def _one(read: Callable[[Path], Sequence]) -> Callable[[Path], Readers]:
    return lambda folder: {folder.name: partial(read, folder)}


DATASETS: dict[str, Callable[[str], Readers]] = {
    "otb": _folders("groundtruth_rect*.txt", _otb_readers),
    "vot": _folders("groundtruth.txt", _one(_vot)),
    "got10k": _folders("groundtruth.txt", _one(_got10k)),
    "video": _video,
}


def load_dataset(reference: str, only: Iterable[str] = ()) -> list[Sequence]:
    """Read the sequences that ``KIND:WHERE`` refers to, for example ``otb:/data/OTB100``.

    `WHERE` is a folder of sequences, one sequence's folder, or for ``video`` ``FILE+BOXFILE``.

    Parameters
    ----------
    reference : str
    only : iterable of str, optional
        Names of those to read; the others may be as damaged as they like.

    Raises
    ------
    SequenceError
        For an unknown kind or name, or data that is not as expected.
    """
    kind, colon, where = reference.partition(":")
    if not colon or kind not in DATASETS:
        raise SequenceError(f"unknown data set {reference!r}; expected KIND:WHERE with KIND of {', '.join(DATASETS)}")
    readers = DATASETS[kind](where)
    wanted = set(only)
    if wanted - set(readers):
        unknown = ", ".join(sorted(wanted - set(readers)))
        raise SequenceError(f"unknown sequence {unknown} in {reference}; known: {', '.join(readers)}")
    return [read() for name, read in readers.items() if not wanted or name in wanted]
