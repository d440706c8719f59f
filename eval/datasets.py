"""Data sets on disk: OTB, VOT, GOT-10k, LaSOT, MOT and COCO, a video and a file of boxes; OTB-100 as published.

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

from .annotations import Tracks, read_coco, read_csv, read_mot
from .framesource import FrameSource
from .sequences import Sequence
from .truthfiles import (
    SequenceError,
    SequenceWarning,
    is_gray_export,
    read_attributes,
    read_box_file,
    read_masks,
    read_numbers,
    read_scene,
    read_text,
)

__all__ = ["DATASETS", "canonical_dataset", "load_dataset"]

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
    regions: tuple[str, ...] = (),
) -> Sequence:
    """Make a sequence of images and of boxes, of which either may be one too many."""
    count = _common_count(name, len(images), len(boxes))
    try:
        first = read_image(images[0])
    except VideoError as error:
        raise SequenceError(f"{name}: cannot read {error}") from error
    paths = tuple(str(path) for path in images[:count])
    size = (first.shape[1], first.shape[0])
    source = FrameSource(paths, "images", count)
    return _sequence(name, source, boxes[:count], visible, folder, size, scene, regions[:count])


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
    regions: tuple[str, ...] = (),
) -> Sequence:
    """Whatever the layout: where there is no box there is no object, and our exports say what can be seen of it."""
    count = len(boxes)
    exact = read_numbers(folder / "visibility.txt", count, 1.0)
    shown = exact if exact is not None else visible
    presence = np.asarray(np.isfinite(boxes).all(axis=1), dtype=np.float64)
    # What is not known stays unknown; elsewhere there is no object where there is no box.
    visibility = presence if shown is None else np.where(np.isnan(shown[:count]), np.nan, presence * shown[:count])
    # In our exports what can be seen is known better than by what the layout has room for.
    shown_masks = read_masks(folder / "masks.txt", count)
    by_region = any(regions) and not shown_masks
    regions = shown_masks or (regions if any(regions) else ())
    # The same files are other frames where their one channel is given once.
    texts = (*regions, source.kind) if source.kind == "gray video" else regions
    digest = _hash(source.paths, texts, boxes, visibility)
    scene = read_scene(folder) or scene
    attributes = read_attributes(folder)
    return Sequence(
        name, source, boxes, visibility, attributes, size, digest, scene=scene, regions=regions, by_region=by_region
    )


def _hash(paths: Iterable[str], texts: Iterable[str], *arrays: NDArray[np.float64]) -> str:
    digest = hashlib.sha256(_hash_files([Path(path) for path in paths]).encode())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    for text in texts:
        digest.update(text.encode() + b"\n")
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
    boxes = read_box_file(truth, first=1, count=len(images)).boxes
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
    boxes, regions = read_box_file(folder / "groundtruth.txt", first=0, count=len(images), regions=True)
    return _from_images(folder.name, folder, images, boxes, None, regions=regions)


def _got10k(folder: Path) -> Sequence:
    images = _images_in(folder)
    boxes = read_box_file(folder / "groundtruth.txt", first=0, count=len(images)).boxes
    if len(boxes) == 1 and len(images) > 2:
        # The test split keeps its truth to itself: where the object is later on, and whether, nobody knows here.
        unknown = np.full(len(images) - 1, np.nan)
        boxes = np.concatenate([boxes, np.full((len(images) - 1, 4), np.nan)])
        return _from_images(folder.name, folder, images, boxes, np.concatenate([[1.0], unknown]))
    # cover.label counts eighths of the object that can be seen.
    cover = read_numbers(folder / "cover.label", len(boxes), 8.0)
    absence = read_numbers(folder / "absence.label", len(boxes), 1.0)
    visible = None if cover is None else cover / 8.0
    if absence is not None:
        visible = (1.0 - absence) * (1.0 if visible is None else visible)
    return _from_images(folder.name, folder, images, boxes, visible)


def _lasot(folder: Path) -> Sequence:
    """Boxes are taken as they are, as got10k's reader takes them."""
    images = _images_in(folder / "img")
    boxes = read_box_file(folder / "groundtruth.txt", first=0, count=len(images)).boxes
    hidden = np.zeros(len(boxes))
    for name in ("full_occlusion.txt", "out_of_view.txt"):
        flags = read_numbers(folder / name, len(boxes), 1.0)
        hidden = hidden if flags is None else np.maximum(hidden, flags)
    return _from_images(folder.name, folder, images, boxes, 1.0 - hidden)


def _mot_readers(folder: Path) -> Readers:
    """As many sequences as there are objects, each from its first frame to its last."""
    images = _images_in(folder / "img1")
    tracks = read_mot(folder / "gt" / "gt.txt", len(images))
    return _track_readers(folder.name, folder, images, tracks)


def _track_readers(name: str, folder: Path, images: Listing[Path], tracks: Tracks) -> Readers:
    """Sequences of one video, which is one scene; an object that is there for a single frame is none."""
    found: dict[str, Callable[[], Sequence]] = {}
    for identity, track in tracks.items():
        seen = np.flatnonzero(np.isfinite(track.boxes).all(axis=1))
        if seen.size >= 2:
            part = slice(int(seen[0]), int(seen[-1]) + 1)
            own = name if len(tracks) == 1 else f"{name}-{identity}"
            truth = track.boxes[part], track.visibility[part], name, track.regions[part]
            found[own] = partial(_from_images, own, folder, images[part], *truth)
    return found


def _coco(where: str) -> Readers:
    """A file of COCO's, or a folder of folders with an `annotations.json`."""
    path = Path(where).expanduser().absolute()
    if path.is_file():
        return _coco_readers(path)
    return _folders("annotations.json", lambda folder: _coco_readers(folder / "annotations.json"))(where)


def _coco_readers(path: Path) -> Readers:
    found: dict[str, Callable[[], Sequence]] = {}
    for video in read_coco(path):
        images = [path.parent / name for name in video.images]
        found |= _track_readers(video.name, path.parent, images, video.tracks)
    return found


def _csv(where: str) -> Readers:
    """``VIDEO+FILE``: a video, or a folder of images, and a CSV of a labelling tool's."""
    video, table = _two_files(where, "VIDEO+FILE.csv")
    if video.is_dir():
        images = _images_in(video)
        first = read_image(images[0])
        tracks = read_csv(table, len(images), (first.shape[1], first.shape[0]), video.name)
        return _track_readers(video.name, table.parent, images, tracks)
    frames, size = _count_frames(video)
    tracks = read_csv(table, frames, size, video.name)
    names = {track: f"{_name_of(video)}-{track}" if len(tracks) > 1 else _name_of(video) for track in tracks}
    # A video is followed from its first frame on: what comes later has no start there.
    found = {
        names[name]: partial(_from_video, names[name], video, track.boxes, track.visibility, table.parent, size)
        for name, track in tracks.items()
        if np.isfinite(track.boxes[0]).all()
    }
    if not found:
        raise SequenceError(f"{table}: no object with a box in the first frame of {video.name}")
    return found


def _folders(marker: str, readers: Callable[[Path], Readers], index: str = "") -> Callable[[str], Readers]:
    """Readers of a folder of sequences, which may lie in folders of splits or classes, or of one sequence.

    What a file `index` beside the sequences names belongs to the data set, whether or not it is there.
    """

    def find(where: str) -> Readers:
        root = Path(where).expanduser().absolute()
        if not root.is_dir():
            raise SequenceError(f"no such folder: {root}")
        folders = _marked(root, marker)
        if not folders:
            raise SequenceError(f"no folder with a {marker} in {root}")
        found: dict[str, Callable[[], Sequence]] = {}
        for folder in folders:
            own = readers(folder)
            if own.keys() & found.keys():
                raise SequenceError(f"two sequences named {', '.join(own.keys() & found.keys())} in {root}")
            found |= own
        lists = sorted({folder.parent / index for folder in folders if folder != root}) if index else []
        for path in filter(Path.is_file, lists):
            for name in filter(None, map(str.strip, read_text(path).splitlines())):
                found.setdefault(name, partial(_refuse_absent, path, name, marker))
        return found

    return find


def _refuse_absent(index: Path, name: str, marker: str) -> Sequence:
    raise SequenceError(f"{index} names {name}, but there is no {index.parent / name / marker}")


def _marked(root: Path, marker: str) -> list[Path]:
    """Folders that hold a file: this one, or those in it, or those in these."""
    level = [root]
    for _ in range(3):
        found = [folder for folder in level if any(folder.glob(marker))]
        if found:
            return found
        level = sorted(path for folder in level for path in folder.iterdir() if path.is_dir())
    return []


def _two_files(where: str, expected: str) -> tuple[Path, Path]:
    first, plus, second = where.rpartition("+")
    if not plus:
        raise SequenceError(f"expected {expected}, got {where!r}")
    paths = Path(first).expanduser().absolute(), Path(second).expanduser().absolute()
    for path in paths:
        if not path.exists():
            raise SequenceError(f"no such file: {path}")
    return paths


def _video(where: str) -> Readers:
    """``VIDEO+BOXFILE``: boxes 0-based, one line per frame."""
    video, box_file = _two_files(where, "VIDEO+BOXFILE")
    return {_name_of(video): partial(_read_video, video, box_file)}


def _name_of(video: Path) -> str:
    """Name of a video; one that is called no more than video has its folder's, as those of our exports."""
    return video.parent.name if video.stem == "video" else video.stem


def _read_video(video: Path, box_file: Path) -> Sequence:
    frames, size = _count_frames(video)
    boxes, regions = read_box_file(box_file, first=0, count=frames, regions=True)
    count = _common_count(_name_of(video), frames, len(boxes))
    return _from_video(_name_of(video), video, boxes[:count], None, box_file.parent, size, regions[:count])


def _from_video(
    name: str,
    video: Path,
    boxes: NDArray[np.float64],
    visible: NDArray[np.float64] | None,
    folder: Path,
    size: tuple[int, int],
    regions: tuple[str, ...] = (),
) -> Sequence:
    kind = "gray video" if is_gray_export(folder) else "video"
    source = FrameSource((str(video),), kind, len(boxes))
    return _sequence(name, source, boxes, visible, folder, size, _name_of(video), regions)


def _count_frames(video: Path) -> tuple[int, tuple[int, int]]:
    """Number of frames, and their width and height."""
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
    return frames, size


def _one(read: Callable[[Path], Sequence]) -> Callable[[Path], Readers]:
    return lambda folder: {folder.name: partial(read, folder)}


DATASETS: dict[str, Callable[[str], Readers]] = {
    "otb": _folders("groundtruth_rect*.txt", _otb_readers),
    "vot": _folders("groundtruth.txt", _one(_vot), "list.txt"),
    "got10k": _folders("groundtruth.txt", _one(_got10k), "list.txt"),
    "lasot": _folders("groundtruth.txt", _one(_lasot)),
    "mot": _folders("gt/gt.txt", _mot_readers),
    "coco": _coco,
    "csv": _csv,
    "video": _video,
}


_MARKS = (
    ("gt/gt.txt", "mot"), ("annotations.json", "coco"), ("groundtruth_rect*.txt", "otb"),
    ("out_of_view.txt", "lasot"), ("meta_info.ini", "got10k"), ("absence.label", "got10k"),
    ("groundtruth.txt", "vot"),
)  # fmt: skip
"""What a folder of a sequence holds, and whose layout that is; the first that applies."""


def canonical_dataset(reference: str) -> str:
    """Return ``KIND:WHERE``; of a bare path, or two with a + between them, the kind is found by looking.

    Raises
    ------
    SequenceError
        For what is neither, or no layout that is known.
    """
    kind, colon, _ = reference.partition(":")
    if colon and kind in DATASETS:
        return reference
    path = Path(reference.rpartition("+")[2]).expanduser()
    if not path.exists():
        raise SequenceError(f"unknown data set {reference!r}; expected KIND:WHERE with KIND of {', '.join(DATASETS)}")
    if "+" in reference:
        return f"{'csv' if path.suffix == '.csv' else 'video'}:{reference}"
    if path.is_file():
        if path.suffix.lower() != ".json":
            raise SequenceError(f"expected a data set's folder, COCO's .json, or VIDEO+BOXFILE, got the file {path}")
        return f"coco:{reference}"
    found = next((kind for marker, kind in _MARKS if _marked(path, marker)), None)
    if found is None:
        raise SequenceError(
            f"no data set that we know in {path}; expected KIND:WHERE with KIND of {', '.join(DATASETS)}"
        )
    if found == "vot" and path.name.startswith("GOT-10k"):
        found = "got10k"
    return f"{found}:{reference}"


def load_dataset(reference: str, only: Iterable[str] = ()) -> list[Sequence]:
    """Read the sequences that ``KIND:WHERE`` refers to, for example ``otb:/data/OTB100``; the kind may be left out.

    `WHERE` is a folder of sequences, one sequence's folder, or for ``video`` and ``csv`` ``VIDEO+FILE``.

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
    kind, _, where = canonical_dataset(reference).partition(":")
    readers = DATASETS[kind](where)
    if not readers:
        raise SequenceError(f"no object to follow in {reference}: expected one with boxes in at least two frames")
    wanted = set(only)
    if wanted - set(readers):
        unknown = ", ".join(sorted(wanted - set(readers)))
        raise SequenceError(f"unknown sequence {unknown} in {reference}; known: {', '.join(readers)}")
    return [read() for name, read in readers.items() if not wanted or name in wanted]
