"""Where sequences come from: synthetic suites, OTB, VOT and GOT-10k folders, a video plus a box file.

Every reader gives the same thing: frames by reference, true boxes, visible fraction, attributes, a content hash.
"""

from __future__ import annotations

import configparser
import hashlib
import json
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import joblib
import numpy as np
from numpy.typing import NDArray

from .framesource import FrameSource

__all__ = ["DATASETS", "Sequence", "SequenceError", "load_dataset", "load_suite", "read_boxes"]

_IMAGE_SUFFIXES = {".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp", ".ppm", ".pgm"}
_CACHE_DAYS = 2.0
_RENDERERS = 2  # processes; each holds a whole sequence in memory


class SequenceError(ValueError):
    """A data set that is not what it should be; the message names the file."""


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


def read_boxes(path: Path, *, first: int) -> NDArray[np.float64]:
    """Read a text file of boxes: one line per frame, separated by commas, tabs, semicolons or spaces.

    Parameters
    ----------
    path : Path
    first : int
        Coordinate of the first pixel in the file: 1 for OTB, 0 for GOT-10k, VOT and us.

    Returns
    -------
    ndarray, shape (T, 4)
        x, y, w, h, 0-based. Lines of 8 numbers are polygons, of which this is the bounding box. Lines that are
        empty, hold a NaN or a box without area give NaN.

    Raises
    ------
    SequenceError
        Naming the line that holds neither 4 nor 8 numbers.
    """
    text = path.read_text(encoding="utf-8-sig").rstrip()
    boxes = [_parse_box(line, f"{path}:{number}") for number, line in enumerate(text.splitlines(), start=1)]
    found = np.array(boxes, dtype=np.float64).reshape(-1, 4)
    found[:, :2] -= first
    found[~(np.isfinite(found).all(axis=1) & (found[:, 2:] > 0).all(axis=1))] = np.nan
    return found


def _parse_box(line: str, where: str) -> tuple[float, ...]:
    words = [word for word in re.split(r"[,;\s]+", line.strip()) if word]
    try:
        values = [float(word) for word in words]
    except ValueError as error:
        raise SequenceError(f"{where}: expected numbers, got {line.strip()!r}") from error
    if not values:
        return (np.nan,) * 4
    if len(values) == 4:
        return tuple(values)
    if len(values) >= 8 and len(values) % 2 == 0:
        xs, ys = values[0::2], values[1::2]
        return min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys)
    raise SequenceError(f"{where}: expected 4 numbers or a polygon of 8, got {len(values)}")


# --- folders -----------------------------------------------------------------------------------------------


def _images_in(folder: Path) -> tuple[str, ...]:
    found = [path for path in folder.iterdir() if path.suffix.lower() in _IMAGE_SUFFIXES]
    # 10.jpg follows 9.jpg, whether or not there are leading zeros.
    found.sort(key=lambda path: [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)])
    if not found:
        raise SequenceError(f"no images in {folder}")
    return tuple(str(path) for path in found)


def _hash_files(paths: Iterable[str], *arrays: NDArray[np.float64]) -> str:
    digest = hashlib.sha256()
    for path in paths:
        digest.update(hashlib.sha256(Path(path).read_bytes()).digest())
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:16]


def _presence(boxes: NDArray[np.float64]) -> NDArray[np.float64]:
    """1 where there is a box, 0 where not."""
    return np.asarray(np.isfinite(boxes).all(axis=1), dtype=np.float64)


def _from_images(
    name: str,
    images: tuple[str, ...],
    boxes: NDArray[np.float64],
    visibility: NDArray[np.float64] | None = None,
    attributes: tuple[str, ...] = (),
) -> Sequence:
    if abs(len(images) - len(boxes)) > 1:
        raise SequenceError(f"{name}: {len(images)} images but {len(boxes)} boxes")
    count = min(len(images), len(boxes))  # one too many of either is common in the published sets
    first = cv2.imread(images[0])
    if first is None:
        raise SequenceError(f"{name}: cannot read {images[0]}")
    boxes = boxes[:count]
    visible = _presence(boxes)
    if visibility is not None:
        visible *= visibility[:count]
    digest = _hash_files(images[:count], boxes, visible)
    source = FrameSource(images[:count], "images", count)
    return Sequence(name, source, boxes, visible, attributes, (first.shape[1], first.shape[0]), digest)


def _read_meta(folder: Path) -> tuple[str, ...]:
    """Attributes from an optional meta.json; the camera's kind is one of them, since results differ most by it."""
    path = folder / "meta.json"
    if not path.exists():
        return ()
    try:
        meta = json.loads(path.read_text(encoding="utf-8"))
    except json.JSONDecodeError as error:
        raise SequenceError(f"{path} is not JSON: {error}") from error
    camera = [f"camera {meta['camera']}"] if isinstance(meta.get("camera"), str) else []
    return (*camera, *(str(item) for item in meta.get("attributes") or ()))


def _read_visibility(folder: Path) -> NDArray[np.float64] | None:
    path = folder / "visibility.txt"
    return np.loadtxt(path, dtype=np.float64, ndmin=1) if path.exists() else None


def _otb(folder: Path) -> Sequence:
    boxes = read_boxes(folder / "groundtruth_rect.txt", first=1)
    images = folder / "img"
    visibility = _read_visibility(folder)
    return _from_images(folder.name, _images_in(images), boxes, visibility, _read_meta(folder))


def _vot(folder: Path) -> Sequence:
    images = folder / "color" if (folder / "color").is_dir() else folder
    boxes = read_boxes(folder / "groundtruth.txt", first=0)
    return _from_images(folder.name, _images_in(images), boxes, None, _read_meta(folder))


def _got10k(folder: Path) -> Sequence:
    boxes = read_boxes(folder / "groundtruth.txt", first=0)
    visibility = None
    if (folder / "cover.label").exists():
        # cover.label counts eighths of the object that can be seen, 0 to 8.
        visibility = np.loadtxt(folder / "cover.label", dtype=np.float64, ndmin=1) / 8.0
    if (folder / "absence.label").exists():
        present = 1.0 - np.loadtxt(folder / "absence.label", dtype=np.float64, ndmin=1)
        visibility = present if visibility is None else visibility * present
    return _from_images(folder.name, _images_in(folder), boxes, visibility, _got10k_attributes(folder))


def _got10k_attributes(folder: Path) -> tuple[str, ...]:
    path = folder / "meta_info.ini"
    if not path.exists():
        return ()
    parser = configparser.ConfigParser()
    parser.read(path, encoding="utf-8")
    section = parser["METAINFO"] if "METAINFO" in parser else {}
    return tuple(section[key] for key in ("motion_class", "object_class") if key in section)


def _folder_reader(marker: str, read: Callable[[Path], Sequence]) -> Callable[[str], list[Sequence]]:
    def load(where: str) -> list[Sequence]:
        root = Path(where).expanduser()
        if not root.is_dir():
            raise SequenceError(f"no such folder: {root}")
        folders = [root] if (root / marker).exists() else sorted(p for p in root.iterdir() if (p / marker).exists())
        if not folders:
            raise SequenceError(f"no folder with a {marker} in {root}")
        return [read(folder) for folder in folders]

    return load


def _video(where: str) -> list[Sequence]:
    """``VIDEO+BOXFILE``: boxes 0-based, one line per frame."""
    video, plus, box_file = where.rpartition("+")
    if not plus:
        raise SequenceError(f"expected VIDEO+BOXFILE, got {where!r}")
    for path in (video, box_file):
        if not Path(path).is_file():
            raise SequenceError(f"no such file: {path}")
    boxes = read_boxes(Path(box_file), first=0)
    capture = cv2.VideoCapture(video)
    try:
        if not capture.isOpened():
            raise SequenceError(f"cannot open the video {video}")
        size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
        count = 0
        # The frame count in a header is an estimate for many codecs; counting is exact.
        while count < len(boxes) and capture.grab():
            count += 1
    finally:
        capture.release()
    boxes = boxes[:count]
    source = FrameSource((video,), "video", count)
    return [Sequence(Path(video).stem, source, boxes, _presence(boxes), (), size, _hash_files([video], boxes))]


DATASETS: dict[str, Callable[[str], list[Sequence]]] = {
    "otb": _folder_reader("groundtruth_rect.txt", _otb),
    "vot": _folder_reader("groundtruth.txt", _vot),
    "got10k": _folder_reader("groundtruth.txt", _got10k),
    "video": _video,
}


def load_dataset(reference: str) -> list[Sequence]:
    """Read the sequences that ``KIND:WHERE`` refers to, for example ``otb:/data/OTB100``.

    `WHERE` is a folder of sequences, one sequence's folder, or for ``video`` ``FILE+BOXFILE``.

    Raises
    ------
    SequenceError
        For an unknown kind, or data that is not as expected.
    """
    kind, colon, where = reference.partition(":")
    if not colon or kind not in DATASETS:
        raise SequenceError(f"unknown data set {reference!r}; expected KIND:WHERE with KIND of {', '.join(DATASETS)}")
    return DATASETS[kind](where)


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
