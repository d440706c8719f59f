"""Sequences as files that other people's tools read. Pixels survive exactly: PNG and FFV1, never a lossy codec.

Every layout has a folder of its own per sequence, which also holds `manifest.json` (attributes, the spec, its digest,
the renderer's version), `visibility.txt`, and `masks.txt` with a line per frame as VOT writes masks. Numbers are
written so that they come back to the last bit. Images that other tools look for as .jpg are PNG under that name,
which every reader opens by content.

An earlier export is replaced, file by file: of a longer one no frame stays behind. A folder that holds something else
is refused.
"""

from __future__ import annotations

import contextlib
import errno
import json
from collections.abc import Callable, Iterable
from decimal import Decimal
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .sequence import Sequence
from .spec import RENDERER_VERSION

__all__ = [
    "FORMATS", "PREVIEWS", "encode_kitti", "read_flo", "read_otb_boxes", "write_coco", "write_flo", "write_flow",
    "write_got10k", "write_image", "write_kitti", "write_mot", "write_otb", "write_video", "write_vot",
]  # fmt: skip

PREVIEWS = "previews"
"""Folder of the pictures for people, beside those of the sequences."""

_FPS = 25.0
_ANCHOR_FRAMES = 50
_ANCHOR_VISIBILITY = 0.5  # a start box of something that is hidden is no start
_FLO_MAGIC = 202021.25
_MANIFEST = "manifest.json"
_SUBFOLDERS = ("img", "img1", "gt", "color", "flow", "image_2", "flow_occ")
_EXPORTED = (
    *(f"{folder}[0-9]*.jpg" for folder in ("", "img/", "img1/")),
    *(f"{folder}[0-9]*.png" for folder in ("", "img/", "color/", "image_2/", "flow_occ/")),
    "flow/[0-9]*.flo", "flow/[0-9]*_valid.png", "groundtruth*.txt", "visibility.txt", "masks.txt", "anchor.value",
    "sequence", "*.tag", "*.label", "meta_info.ini", "annotations.json", "video.mkv", "gt/gt.txt", "seqinfo.ini",
)  # fmt: skip


def write_otb(sequence: Sequence, root: Path) -> Path:
    """Write `img/0001.jpg` … and `groundtruth_rect.txt`: 1-based, comma-separated amodal boxes.

    Parameters
    ----------
    sequence : Sequence
    root : Path
        The sequence goes into ``root / sequence.name``.

    Returns
    -------
    Path
        The folder of the sequence.
    """
    folder = _folder(sequence, root)
    _images(sequence, folder / "img", "{:04d}.jpg", 1)
    # In decimals: x + 1 in binary would lose the last bit of x.
    rows = [[Decimal(repr(x)) + 1, Decimal(repr(y)) + 1, w, h] for x, y, w, h in sequence.boxes.tolist()]
    _rows(folder / "groundtruth_rect.txt", rows)
    return folder


def read_otb_boxes(path: Path) -> NDArray[np.float64]:
    """Read an OTB truth file (commas, tabs or spaces).

    Parameters
    ----------
    path : Path

    Returns
    -------
    ndarray, shape (T, 4), float64
        x, y, w, h of the project's convention: 0-based.
    """
    lines = path.read_text().replace(",", " ").splitlines()
    rows = [[Decimal(word) for word in line.split()] for line in lines if line.strip()]
    return np.array([[float(x - 1), float(y - 1), float(w), float(h)] for x, y, w, h in rows])


def write_vot(sequence: Sequence, root: Path) -> Path:
    """Write `color/00000001.png` …, `groundtruth.txt` (x, y, w, h), `anchor.value`, `sequence`, tags.

    Takes and gives what `write_otb` does; ``root / "list.txt"`` gains the sequence's name. Boxes are rectangles of
    four numbers: a polygon of eight is filled by the toolkit to its last row and column, one pixel too large.
    """
    folder = _folder(sequence, root)
    _images(sequence, folder / "color", "{:08d}.png", 1)
    _table(folder / "groundtruth.txt", sequence.boxes)
    _table(folder / "anchor.value", _anchors(sequence)[:, np.newaxis])
    for name, flags in sequence.frame_attributes.items():
        _table(folder / f"{name}.tag", flags[:, np.newaxis].astype(int))
    height, width = sequence.frames.shape[1:3]
    facts = {
        "channels.color": "color/%08d.png", "format": "default", "fps": f"{_FPS:g}", "name": sequence.name,
        "width": width, "height": height, "length": len(sequence),
    }  # fmt: skip
    (folder / "sequence").write_text("".join(f"{key}={value}\n" for key, value in facts.items()))
    _list(root, sequence.name)
    return folder


def _anchors(sequence: Sequence) -> NDArray[np.int64]:
    """Where VOT starts a tracker anew: 1 runs to the end, −1 to the beginning, whichever is farther."""
    frames = np.arange(len(sequence))
    starts = (frames % _ANCHOR_FRAMES == 0) & (sequence.visibility >= _ANCHOR_VISIBILITY)
    return np.where(starts, np.where(frames <= frames[-1] - frames, 1, -1), 0)


def write_got10k(sequence: Sequence, root: Path) -> Path:
    """Write the layout of GOT-10k: images, `groundtruth.txt`, `meta_info.ini`, three label files, `list.txt`.

    Takes and gives what `write_otb` does. Boxes are 0-based, since the toolkit hands them on as they are.
    `cover.label` counts eighths, rounded up, so that 0 is what cannot be seen at all, as in the toolkit;
    `visibility.txt` says exactly how much can be seen.
    """
    folder = _folder(sequence, root)
    _images(sequence, folder, "{:08d}.jpg", 1)
    _table(folder / "groundtruth.txt", sequence.boxes)
    cover = np.ceil(sequence.visibility * 8.0).astype(int)
    _table(folder / "cover.label", cover[:, np.newaxis])
    _table(folder / "absence.label", sequence.frame_attributes["absent"][:, np.newaxis].astype(int))
    _table(folder / "cut_by_image.label", sequence.frame_attributes["cut_by_frame"][:, np.newaxis].astype(int))
    height, width = sequence.frames.shape[1:3]
    facts = (
        "url: none", "begin: 00:00:00", f"end: {len(sequence)}", f"anno_fps: {_FPS:g}Hz", "object_class: synthetic",
        f"motion_class: {' '.join(sequence.attributes)}", "major_class: synthetic", "root_class: synthetic",
        "motion_adverb: none", f"resolution: ({width}, {height})",
    )  # fmt: skip
    (folder / "meta_info.ini").write_text("[METAINFO]\n" + "".join(f"{fact}\n" for fact in facts))
    _list(root, sequence.name)
    return folder


def write_mot(sequence: Sequence, root: Path) -> Path:
    """Write MOTChallenge's layout: `img1/000001.jpg` …, `gt/gt.txt`, `seqinfo.ini`; object 1 is the target.

    Takes and gives what `write_otb` does. Rows are frame, object, x, y, w, h, flag, class, visibility; frames and
    pixels count from 1. Hidden frames have their rows, of visibility 0.
    """
    folder = _folder(sequence, root)
    _images(sequence, folder / "img1", "{:06d}.jpg", 1)
    (folder / "gt").mkdir(exist_ok=True)
    shown = sequence.visibility.tolist()
    rows = [
        [t + 1, 1, Decimal(repr(x)) + 1, Decimal(repr(y)) + 1, w, h, 1, 1, shown[t]]
        for t, (x, y, w, h) in enumerate(sequence.boxes.tolist())
    ]
    _rows(folder / "gt" / "gt.txt", rows)
    height, width = sequence.frames.shape[1:3]
    facts = {
        "name": sequence.name, "imDir": "img1", "frameRate": f"{_FPS:g}", "seqLength": len(sequence),
        "imWidth": width, "imHeight": height, "imExt": ".jpg",
    }  # fmt: skip
    (folder / "seqinfo.ini").write_text("[Sequence]\n" + "".join(f"{key}={value}\n" for key, value in facts.items()))
    return folder


def write_coco(sequence: Sequence, root: Path) -> Path:
    """Write `img/0001.png` … and `annotations.json`, one annotation per frame in which the target is seen.

    Takes and gives what `write_otb` does. `bbox` and `segmentation` are amodal, `area` is that of the visible
    mask, and the additional keys `visible_bbox` and `visibility` say what is seen; where nothing is, the image has
    a `hidden_bbox`.
    """
    folder = _folder(sequence, root)
    _images(sequence, folder / "img", "{:04d}.png", 1)
    height, width = sequence.frames.shape[1:3]
    images = [
        {"id": t + 1, "file_name": f"img/{t + 1:04d}.png", "width": width, "height": height}
        | ({} if sequence.visibility[t] > 0 else {"hidden_bbox": sequence.boxes[t].tolist()})
        for t in range(len(sequence))
    ]
    annotations = [_annotation(sequence, t) for t in np.flatnonzero(sequence.visibility > 0).tolist()]
    document = {
        "info": {"description": f"{sequence.name} {sequence.spec.digest()}"},
        "images": images,
        "annotations": annotations,
        "categories": [{"id": 1, "name": "target"}],
    }
    (folder / "annotations.json").write_text(json.dumps(document))
    return folder


def _annotation(sequence: Sequence, t: int) -> dict[str, Any]:
    return {
        "id": t + 1,
        "image_id": t + 1,
        "category_id": 1,
        "iscrowd": 0,
        "bbox": sequence.boxes[t].tolist(),
        "visible_bbox": sequence.visible_boxes[t].tolist(),
        "visibility": float(sequence.visibility[t]),
        "area": int(sequence.masks[t].sum()),
        "segmentation": [polygon.ravel().tolist() for polygon in sequence.polygons[t]],
    }


def write_flow(sequence: Sequence, root: Path) -> Path:
    """Write the frames, `flow/0001.flo` … (frame 1 to frame 2 first) and `flow/0001_valid.png`.

    Takes and gives what `write_otb` does.
    """
    folder = write_otb(sequence, root)
    (folder / "flow").mkdir(exist_ok=True)
    for t in range(len(sequence) - 1):
        flow, valid = sequence.flow(t)
        write_flo(folder / "flow" / f"{t + 1:04d}.flo", flow)
        write_image(folder / "flow" / f"{t + 1:04d}_valid.png", valid.astype(np.uint8) * 255)
    return folder


def write_kitti(sequence: Sequence, root: Path) -> Path:
    """Write KITTI's layout of flow: `image_2/000000_10.png`, `000000_11.png` and `flow_occ/000000_10.png` for a pair.

    Takes and gives what `write_otb` does. Flow is stored in 64ths of a pixel.
    """
    folder = _folder(sequence, root)
    for t in range(len(sequence) - 1):
        for number in (0, 1):
            write_image(folder / "image_2" / f"{t:06d}_1{number}.png", sequence.frames[t + number])
        write_image(folder / "flow_occ" / f"{t:06d}_10.png", encode_kitti(*sequence.flow(t)))
    return folder


def encode_kitti(flow: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.uint16]:
    """Flow (H, W, 2) as the channels, in cv2's order, of KITTI's 16-bit PNG; what that cannot hold is not valid."""
    stored = np.rint(flow.astype(np.float64) * 64.0 + 32768.0)
    held = valid & ((stored >= 0) & (stored <= 65535)).all(axis=2)
    channels = np.dstack([held, np.where(held, stored[..., 1], 0), np.where(held, stored[..., 0], 0)])
    return channels.astype(np.uint16)


def write_flo(path: Path, flow: NDArray[np.float32]) -> None:
    """Write a flow field (H, W, 2) in Middlebury's .flo layout."""
    height, width = flow.shape[:2]
    header = np.array([_FLO_MAGIC], "<f4").tobytes() + np.array([width, height], "<i4").tobytes()
    path.write_bytes(header + np.ascontiguousarray(flow, "<f4").tobytes())


def read_flo(path: Path) -> NDArray[np.float32]:
    """Read a .flo file.

    Returns
    -------
    ndarray, shape (H, W, 2), float32

    Raises
    ------
    ValueError
        If it does not begin as such a file does, or has another length than it says.
    """
    data = path.read_bytes()
    if len(data) < 12 or np.frombuffer(data, "<f4", 1)[0] != np.float32(_FLO_MAGIC):
        raise ValueError(f"{path} is no .flo file")
    width, height = np.frombuffer(data, "<i4", 2, 4).tolist()
    if len(data) != 12 + 8 * width * height:
        raise ValueError(f"{path} says {width} × {height} px but holds {len(data) - 12} bytes of flow")
    return np.frombuffer(data, "<f4", offset=12).reshape(height, width, 2).astype(np.float32)


def write_video(sequence: Sequence, root: Path) -> Path:
    """Write `video.mkv` (FFV1, lossless) and `groundtruth.txt` (0-based x,y,w,h).

    Takes and gives what `write_otb` does. Gray frames are stored as three equal channels, and the manifest says so.

    Raises
    ------
    OSError
        If this OpenCV cannot write FFV1.
    ValueError
        If the frames have 16 bits, of which OpenCV's videos keep 8.
    """
    if sequence.spec.deep:
        raise ValueError(f"expected frames of 8 bits for a video, {sequence.name} has 16: choose a layout of images")
    folder = _folder(sequence, root)
    height, width = sequence.frames.shape[1:3]
    writer = cv2.VideoWriter(
        _native_name(folder / "video.mkv"), cv2.VideoWriter.fourcc(*"FFV1"), _FPS, (width, height)
    )
    if not writer.isOpened():
        raise OSError(f"cv2 {cv2.__version__} cannot write FFV1 video to {folder / 'video.mkv'}")
    for frame in sequence.frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) if frame.ndim == 2 else frame)
    writer.release()
    _table(folder / "groundtruth.txt", sequence.boxes)
    return folder


FORMATS: dict[str, Callable[[Sequence, Path], Path]] = {
    "otb": write_otb,
    "vot": write_vot,
    "got10k": write_got10k,
    "mot": write_mot,
    "coco": write_coco,
    "flow": write_flow,
    "kitti": write_kitti,
    "video": write_video,
}


def _folder(sequence: Sequence, root: Path) -> Path:
    """Folder of a sequence, with nothing of an earlier export in it, and what all layouts have in common."""
    folder = root / sequence.name
    folder.mkdir(parents=True, exist_ok=True)
    _clear(folder)
    manifest = {
        "name": sequence.name,
        "digest": sequence.spec.digest(),
        "renderer_version": RENDERER_VERSION,
        "seed": sequence.spec.seed,
        "attributes": sequence.attributes,
        "gray": sequence.frames.ndim == 3,
        "spec": repr(sequence.spec),
    }
    (folder / _MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")
    _table(folder / "visibility.txt", sequence.visibility[:, np.newaxis])
    (folder / "masks.txt").write_text("".join(f"{_runs(mask)}\n" for mask in sequence.masks))
    return folder


def _runs(mask: NDArray[np.bool_]) -> str:
    """Text of a mask: m, the window that it is in, and lengths of runs row by row, the first of pixels outside."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not rows.size:
        return ""
    part = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    # A pixel outside before the first: a mask that begins inside has a first run of none.
    edges = np.flatnonzero(np.diff(part.ravel().astype(np.int8), prepend=0))
    runs = np.diff(np.concatenate([[0], edges, [part.size]])).tolist()
    return "m" + ",".join(map(str, [columns[0], rows[0], part.shape[1], part.shape[0], *runs]))


def _clear(folder: Path) -> None:
    """Remove what exports write, of any layout; raises OSError for a folder that holds something else."""
    if not (folder / _MANIFEST).is_file():
        # Of an export that was interrupted the manifest is there: it is written first.
        if any(not path.name.startswith(".") for path in folder.iterdir()):
            raise FileExistsError(errno.EEXIST, "there are files that are no export of ours", str(folder))
        return
    for name in _EXPORTED:
        for path in (found for found in folder.glob(name) if found.is_file() or found.is_symlink()):
            path.unlink()
    for name in _SUBFOLDERS:
        with contextlib.suppress(OSError):  # absent, or not empty
            (folder / name).rmdir()


def _images(sequence: Sequence, folder: Path, pattern: str, first: int) -> None:
    folder.mkdir(exist_ok=True)
    for t, frame in enumerate(sequence.frames):
        write_image(folder / pattern.format(t + first), frame)


def write_image(path: Path, image: NDArray[np.uint8] | NDArray[np.uint16]) -> None:
    """Write a PNG, whatever the name of the file; the folder is made when missing.

    Raises
    ------
    OSError
        If it cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    done, data = cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
    if not done:
        raise OSError(f"cv2 could not encode {path}")
    path.write_bytes(data.tobytes())


def _table(path: Path, values: NDArray[Any]) -> None:
    _rows(path, values.tolist())


def _native_name(path: Path) -> str:
    """Name of a file for cv2, which takes a relative one with a colon for a protocol and dies of one not in UTF-8."""
    name = str(path.absolute())
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        raise OSError(errno.EILSEQ, "OpenCV takes names in UTF-8 only", name) from None
    return name


def _rows(path: Path, rows: Iterable[Iterable[object]]) -> None:
    """Numbers as they print, which for floats is the shortest text that gives the same number."""
    path.write_text("".join(",".join(map(str, row)) + "\n" for row in rows))


def _list(root: Path, name: str) -> None:
    path = root / "list.txt"
    names = path.read_text().split() if path.exists() else []
    if name not in names:
        path.write_text("".join(f"{each}\n" for each in [*names, name]))
