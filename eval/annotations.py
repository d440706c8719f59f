"""Files that hold the truth of many objects, or of many videos: MOT, COCO video, CSV of labelling tools.

Each is read into tracks by the name of the object. What is not understood is refused with file, place and text.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .regions import Mask, mask_of_polygons, mask_of_runs, read_region, region_box
from .truthfiles import SequenceError, read_number, read_text

__all__ = ["CocoVideo", "Track", "Tracks", "read_coco", "read_csv", "read_mot"]

FloatArray = NDArray[np.float64]
Rows = dict[int, tuple[tuple[float, float, float, float], float]]


@dataclass(frozen=True)
class Track:
    """One object in all T frames of a video.

    Parameters
    ----------
    boxes : ndarray, shape (T, 4)
        NaN where it is not.
    visibility : ndarray, shape (T,)
        0 where it is not.
    regions : tuple of str
        See :class:`eval.sequences.Sequence`.
    """

    boxes: FloatArray
    visibility: FloatArray
    regions: tuple[str, ...] = ()


Tracks = Mapping[str, Track]
"""By the name of the object."""

_CORNERS = (("xtl", "ytl", "xbr", "ybr"), ("x1", "y1", "x2", "y2"), ("xmin", "ymin", "xmax", "ymax"))
_SIDES = (("x", "y", "w", "h"), ("x", "y", "width", "height"), ("left", "top", "width", "height"))
_NAMES = ("track_id", "object_id", "instance_id", "id", "label")
_MOT_COLUMNS = (6, 7, 8, 9, 10)


def _track(rows: Rows, count: int, regions: Mapping[int, str] | None = None) -> Track:
    boxes, visibility = np.full((count, 4), np.nan), np.zeros(count)
    for frame, (box, shown) in rows.items():
        boxes[frame], visibility[frame] = box, shown
    visibility[~(boxes[:, 2:] > 0).all(axis=1)] = 0.0
    boxes[~(boxes[:, 2:] > 0).all(axis=1)] = np.nan
    texts = tuple(regions.get(frame, "") for frame in range(count)) if regions else ()
    return Track(boxes, visibility, texts)


def _place(rows: Rows, frame: float, count: int, where: str, first: int = 0) -> int:
    """Index of a frame, which is there and has no box yet; the file counts from `first`."""
    index = int(frame) - first
    if index + first != frame or not 0 <= index < count:
        raise SequenceError(f"{where}: expected a frame from {first} to {first + count - 1}, got {frame:g}")
    if index in rows:
        raise SequenceError(f"{where}: a second box of the same object in one frame")
    return index


def _share_seen(value: float, where: str) -> float:
    """Visibility, which is a share."""
    if not 0.0 <= value <= 1.0:
        raise SequenceError(f"{where}: expected a visibility from 0 to 1, got {value:g}")
    return value


def read_mot(path: Path, count: int) -> Tracks:
    """Read the file of MOTChallenge: frame, object, x, y, w, h, and optionally flag, class, visibility.

    Frames and pixels count from 1. Rows whose flag is 0 are not to be judged, and are left out.

    Parameters
    ----------
    path : Path
    count : int
        Number of frames.
    """
    found: dict[str, Rows] = {}
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if not line.strip():
            continue
        where = f"{path}:{number}"
        words = [word.strip() for word in line.split(",")]
        if len(words) not in _MOT_COLUMNS:
            raise SequenceError(f"{where}: expected 6 to 10 numbers, got {len(words)} in {line[:80]!r}")
        values = [read_number(word, where) for word in words]
        if len(values) > 6 and values[6] == 0:
            continue
        if values[1] < 0 or values[1] != int(values[1]):
            raise SequenceError(f"{where}: expected the number of an object, got {words[1]} in {line[:80]!r}")
        x, y, w, h = values[2:6]
        rows = found.setdefault(f"{values[1]:.0f}", {})
        shown = _share_seen(values[8], where) if len(values) == 9 else 1.0
        rows[_place(rows, values[0], count, where, first=1)] = ((x - 1, y - 1, w, h), shown)
    return {name: _track(rows, count) for name, rows in found.items()}


@dataclass(frozen=True)
class CocoVideo:
    """One video of a COCO file: names of its images, beside the file, and what is tracked in it."""

    name: str
    images: tuple[str, ...]
    tracks: Tracks


def read_coco(path: Path) -> list[CocoVideo]:
    """Read a COCO file, or one of YouTube-VIS.

    COCO's has images with `video_id` and `frame_id`, annotations with `track_id` or `instance_id`. Without videos all
    images are one, in the order of their ids; without tracks there is one object. Of our own exports the boxes of
    hidden frames come back too. YouTube-VIS has no images: its videos list `file_names`, and an annotation is an
    object with lists of `bboxes` and `segmentations`, null where it is not seen. Masks are runs or polygons.
    """
    try:
        data = json.loads(read_text(path))
        if "images" not in data:
            return [_vis_video(video, data["annotations"], f"{path}") for video in data["videos"]]
        videos: dict[Any, list[dict[str, Any]]] = {}
        for image in data["images"]:
            videos.setdefault(image.get("video_id", 0), []).append(image)
        names = {one["id"]: str(one["name"]) for one in data.get("videos", ())}
        notes: dict[Any, list[dict[str, Any]]] = {}
        for note in data["annotations"]:
            notes.setdefault(note["image_id"], []).append(note)
        return [
            _coco_video(names.get(number, path.parent.name), images, notes, f"{path}")
            for number, images in videos.items()
        ]
    except SequenceError:
        raise
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise SequenceError(
            f"{path}: expected COCO's images and annotations, got {type(error).__name__}: {error}"
        ) from error


def _vis_video(video: Mapping[str, Any], notes: Iterable[Mapping[str, Any]], where: str) -> CocoVideo:
    """One video of YouTube-VIS; boxes are those of the masks where the file has none."""
    files = tuple(str(name) for name in video["file_names"])
    tracks = {}
    for note in notes:
        if note["video_id"] != video["id"]:
            continue
        place = f"{where}: annotation {note['id']}"
        masks = [_mask_text(mask, place) for mask in note.get("segmentations") or [None] * len(files)]
        boxes = note.get("bboxes") or [[*region_box(read_region(text))] if text else None for text in masks]
        if not len(boxes) == len(masks) == len(files):
            raise SequenceError(f"{place}: expected {len(files)} boxes and masks, got {len(boxes)} and {len(masks)}")
        rows: Rows = {}
        for frame, box in enumerate(boxes):
            if box is not None:
                rows[frame] = (_sides(box, place), 1.0)
        tracks[str(note["id"])] = _track(rows, len(files), {frame: text for frame, text in enumerate(masks) if text})
    folder = Path(files[0]).parent.name if files else ""
    return CocoVideo(str(video.get("name", folder or video["id"])), files, tracks)


def _sides(box: Any, where: str) -> tuple[float, float, float, float]:
    """Left, top, width and height of a box in JSON, which knows other things than four numbers."""
    try:
        x, y, w, h = (float(value) for value in box)
    except (TypeError, ValueError):
        x = y = w = h = math.nan
    if not all(map(math.isfinite, (x, y, w, h))):
        raise SequenceError(f"{where}: expected a box of four numbers, got {str(box)[:80]}")
    return x, y, w, h


def _mask_text(segmentation: Any, where: str) -> str:
    """Text of a mask that COCO's file holds as polygons, or as runs column by column; empty for none."""
    if not segmentation:
        return ""
    try:
        return (
            _mask_of_columns(segmentation) if isinstance(segmentation, dict) else mask_of_polygons(segmentation)
        ).text
    except (ValueError, TypeError) as error:
        raise SequenceError(f"{where}: {error}") from error


def _mask_of_columns(segmentation: Mapping[str, Any]) -> Mask:
    height, width = segmentation["size"]
    counts = segmentation["counts"]
    # What runs down the columns is a mask lying on its side.
    lying = mask_of_runs(0, 0, height, width, _unpacked(counts) if isinstance(counts, str) else counts)
    return Mask(0, 0, lying.pixels.T)


def _unpacked(text: str) -> list[int]:
    """Runs from COCO's compressed text: five bits a sign; from the fourth on, the difference to the last but one."""
    counts: list[int] = []
    value = shift = 0
    for sign in text.encode("ascii"):
        bits = sign - 48
        value |= (bits & 0x1F) << shift
        shift += 5
        if not bits & 0x20:
            value -= (1 << shift) if bits & 0x10 else 0
            counts.append(value + (counts[-2] if len(counts) > 2 else 0))
            value = shift = 0
    return counts


def _coco_video(
    name: str, images: list[dict[str, Any]], notes: Mapping[Any, list[dict[str, Any]]], where: str
) -> CocoVideo:
    order = sorted(images, key=lambda image: image.get("frame_id", image.get("frame_index", image["id"])))
    found: dict[str, Rows] = {}
    masks: dict[str, dict[int, str]] = {}
    for index, image in enumerate(order):
        for note in notes.get(image["id"], ()):
            identity = str(note.get("track_id", note.get("instance_id", 0)))
            rows = found.setdefault(identity, {})
            here = f"{where}: annotation {note.get('id')}"
            mask = _mask_text(note.get("segmentation"), here)
            if mask:
                masks.setdefault(identity, {})[index] = mask
            place = _place(rows, index, len(order), here)
            rows[place] = (_sides(note["bbox"], here), _share_seen(float(note.get("visibility", 1.0)), here))
        if "hidden_bbox" in image:
            hidden = _sides(image["hidden_bbox"], f"{where}: image {image['id']}")
            found.setdefault("0", {})[index] = (hidden, 0.0)
    files = tuple(str(image["file_name"]) for image in order)
    tracks = {identity: _track(rows, len(order), masks.get(identity)) for identity, rows in found.items()}
    return CocoVideo(name, files, tracks)


def read_csv(path: Path, count: int, size: tuple[int, int], video: str) -> Tracks:
    """Read a CSV with a heading, as labelling tools write it.

    Either a row per box, as CVAT's converters give it: `frame` (from 0), a box as corners (`xtl`, `ytl`, `xbr`, `ybr`
    and the like) or with sides (`x`, `y`, `w`, `h`), and optionally an object (`track_id`, `label`), `outside` or
    `visibility`. Or Label Studio's row per video, whose column of JSON holds keyframes in per cent of the frame, the
    first of number 1, with straight lines between them.

    Parameters
    ----------
    path : Path
    count : int
        Number of frames.
    size : (int, int)
        Width and height of the frames, px.
    video : str
        Name of the video's file, by which a row of Label Studio's is known where there are several.
    """
    reader = csv.DictReader(io.StringIO(read_text(path)))
    rows = list(reader)
    columns = [name for name in reader.fieldnames or () if name]
    if "frame" in columns:
        return _boxes_of_rows(rows, columns, count, path)
    for column in columns:
        if any('"sequence"' in (row[column] or "") for row in rows):
            return _label_studio(rows, column, count, size, video, path)
    raise SequenceError(f"{path}: expected a column `frame`, or one of Label Studio's JSON, got {', '.join(columns)}")


def _boxes_of_rows(rows: list[dict[str, str]], columns: list[str], count: int, path: Path) -> Tracks:
    names = next((names for names in (*_CORNERS, *_SIDES) if set(names) <= set(columns)), None)
    if names is None:
        raise SequenceError(
            f"{path}: expected columns of a box, such as xtl, ytl, xbr, ybr, got {', '.join(columns)}"
        )
    identity = next((name for name in _NAMES if name in columns), None)
    found: dict[str, Rows] = {}
    for number, row in enumerate(rows, start=2):
        where = f"{path}:{number}"
        if (row.get("outside") or "0").strip().lower() in ("1", "true"):
            continue
        a, b, c, d = (read_number((row[name] or "").strip(), where) for name in names)
        box = (a, b, c - a, d - b) if names in _CORNERS else (a, b, c, d)
        shown = _share_seen(read_number(row["visibility"].strip(), where), where) if row.get("visibility") else 1.0
        track = found.setdefault(row[identity].strip() if identity else "0", {})
        track[_place(track, read_number((row["frame"] or "").strip(), where), count, where)] = (box, shown)
    return {name: _track(track, count) for name, track in found.items()}


def _label_studio(
    rows: list[dict[str, str]], column: str, count: int, size: tuple[int, int], video: str, path: Path
) -> Tracks:
    chosen = [row for row in rows if '"sequence"' in (row[column] or "")]
    if len(chosen) > 1:
        chosen = [row for row in chosen if any((row[name] or "").endswith(video) for name in row if name)]
    if len(chosen) != 1:
        raise SequenceError(f"{path}: expected one row about {video}, got {len(chosen)}")
    try:
        tracks = json.loads(chosen[0][column])
        return {
            str(number): _track(_between(track["sequence"], count, size), count)
            for number, track in enumerate(tracks, start=1)
        }
    except (ValueError, KeyError, TypeError, RecursionError) as error:
        raise SequenceError(
            f"{path}: expected Label Studio's keyframes, got {type(error).__name__}: {error}"
        ) from error


def _between(keys: Iterable[Mapping[str, Any]], count: int, size: tuple[int, int]) -> Rows:
    """Boxes of all frames from keyframes: straight lines, and nothing after one that is not enabled."""
    order = sorted(keys, key=lambda key: int(key["frame"]))
    sides = np.array([size[0], size[1], size[0], size[1]]) / 100.0
    rows: Rows = {}
    for key, after in zip(order, [*order[1:], None], strict=True):
        start = int(key["frame"]) - 1
        end = count if after is None else int(after["frame"]) - 1
        own = np.array([float(key[name]) for name in ("x", "y", "width", "height")]) * sides
        next_ = own if after is None else np.array([float(after[n]) for n in ("x", "y", "width", "height")]) * sides
        last = end if key.get("enabled", True) else start + 1
        for frame in range(max(start, 0), min(last, count)):
            x, y, w, h = (own + (next_ - own) * (frame - start) / max(end - start, 1)).tolist()
            rows[frame] = ((x, y, w, h), 1.0)
    return rows
