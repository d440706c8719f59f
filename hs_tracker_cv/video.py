"""Frames from a video file, a camera or a folder of images; video out.

Whatever goes wrong with a source or a target is one :class:`VideoError` of one line. An error in the middle of
a source is raised where it happens, after every frame before it has been handed out, so the caller keeps what
it has.
"""

from __future__ import annotations

import contextlib
import os
import re
import stat
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["CODECS", "IMAGE_SUFFIXES", "VideoError", "VideoSink", "VideoSource", "natural_key", "open_source"]

IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"})
"""Files of a folder that are taken for frames."""

CODECS = {".webm": "VP80", ".mkv": "FFV1", ".avi": "FFV1"}
"""Codec by file name. VP8 plays in every browser and is eight times faster to write than VP9; FFV1 is lossless.
MP4 is missing because the OpenCV wheels hold no H.264 encoder and browsers do not play their MPEG-4."""

DEFAULT_FPS = 25.0

_LAST_CAMERA = 2**31 - 1  # cv2 takes a C int
_PROBE = 4096  # bytes that a disk must take after a video for it to count as written

Image = NDArray[Any]


class VideoError(RuntimeError):
    """A video that cannot be read or written; the message is one line."""


@dataclass(frozen=True)
class VideoSource:
    """An open source of frames.

    Parameters
    ----------
    name : str
        What output files are named after.
    fps : float
        Frames per second; 25 where the source does not say.
    count : int or None
        Number of frames the source announces; None for a camera.
    first : ndarray
        The first frame, already decoded: what an ROI is drawn on.
    frames : iterator of ndarray
        All frames in order, the first included. Raises VideoError where the source breaks.
    """

    name: str
    fps: float
    count: int | None
    first: Image
    frames: Iterator[Image]

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return int(self.first.shape[1]), int(self.first.shape[0])

    def close(self) -> None:
        """Release the file or camera."""
        close = getattr(self.frames, "close", None)
        if close is not None:
            close()

    def __enter__(self) -> VideoSource:
        """Return the source itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release the file or camera."""
        self.close()


def open_source(source: str | int | Path) -> VideoSource:
    """Open a video file, a camera or a folder of images.

    Parameters
    ----------
    source : str, int or Path
        Path of a file or folder; a number, or a string of digits that names no file, is a camera.

    Returns
    -------
    VideoSource
        Its first frame has been decoded, so a source that cannot be used has already been refused.

    Raises
    ------
    VideoError
        If there is no such source, it cannot be read, or it yields no frame.
    """
    path, text = Path(str(source)), str(source)
    if isinstance(source, int) or (text.isdecimal() and not path.exists()):
        return _open_camera(int(text))
    if path.is_dir():
        return _open_folder(path)
    return _open_file(path)


def natural_key(path: Path) -> list[tuple[int, int, str]]:
    """Sort key by which ``frame10`` follows ``frame9``."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts if part]


def _open_folder(folder: Path) -> VideoSource:
    try:
        paths = [path for path in folder.iterdir() if path.suffix.lower() in IMAGE_SUFFIXES]
    except OSError as error:
        raise VideoError(f"{folder}: cannot be listed ({error.strerror})") from error
    if not paths:
        raise VideoError(f"{folder}: holds no image ({', '.join(sorted(IMAGE_SUFFIXES))})")
    paths.sort(key=natural_key)
    # OTB and its kin keep the frames in a folder called img: the sequence's name is the parent's.
    name = folder.resolve()
    name = name.parent if name.name.lower() in {"img", "images", "frames"} else name
    return VideoSource(name.name, DEFAULT_FPS, len(paths), _read_image(paths[0]), _folder_frames(paths))


def _read_image(path: Path) -> Image:
    try:
        # imdecode instead of imread: it takes any path the operating system takes.
        image = cv2.imdecode(np.frombuffer(path.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    except OSError as error:
        raise VideoError(f"{path}: cannot be read ({error.strerror})") from error
    except cv2.error:
        image = None
    if image is None:
        raise VideoError(f"{path}: is not an image that OpenCV can decode")
    return image


def _folder_frames(paths: list[Path]) -> Iterator[Image]:
    first: Image | None = None
    for path in paths:
        image = _read_image(path)
        first = image if first is None else first
        _check_size(str(path), image, first)
        yield image


def _check_size(name: str, image: Image, first: Image) -> None:
    if image.shape != first.shape:
        raise VideoError(
            f"{name}: is {image.shape[1]} × {image.shape[0]} px, but the first frame is "
            f"{first.shape[1]} × {first.shape[0]} px"
        )


def _open_file(path: Path) -> VideoSource:
    try:
        # A pipe would be waited for, perhaps for ever, and what is read from it is gone.
        if not stat.S_ISREG(path.stat().st_mode):
            raise VideoError(f"{path}: is neither a file nor a folder (a camera is given by its number)")
        with path.open("rb") as stream:
            empty = not stream.read(1)
    except OSError as error:
        raise VideoError(f"{path}: cannot be read ({error.strerror})") from error
    if empty:
        raise VideoError(f"{path}: is an empty file")
    with _native_stderr_muted():
        capture = cv2.VideoCapture(str(path))
        opened = capture.isOpened()
        ok, first = capture.read() if opened else (False, None)
    if not opened:
        raise VideoError(f"{path}: is not a video that OpenCV can open (damaged, or an unknown format)")
    announced = int(capture.get(cv2.CAP_PROP_FRAME_COUNT))
    if not ok or first is None:
        raise VideoError(f"{path}: no frame can be decoded (no frames, or the unknown codec {_fourcc(capture)!r})")
    count = announced if announced > 0 else None
    fps = _fps(capture)
    return VideoSource(path.stem, fps, count, first, _file_frames(str(path), capture, first, count))


def _fps(capture: cv2.VideoCapture) -> float:
    fps = float(capture.get(cv2.CAP_PROP_FPS))
    # A container without a frame rate reports 0, NaN or its time base (1000, 90000).
    return fps if 0.0 < fps <= 480.0 else DEFAULT_FPS


def _fourcc(capture: cv2.VideoCapture) -> str:
    code = int(capture.get(cv2.CAP_PROP_FOURCC))
    letters = bytes((code >> shift) & 0xFF for shift in (0, 8, 16, 24))
    return letters.decode("ascii", errors="replace").strip("\0 ") or "?"


def _file_frames(name: str, capture: cv2.VideoCapture, first: Image, count: int | None) -> Iterator[Image]:
    read = 1
    try:
        yield first
        while True:
            ok, frame = capture.read()
            if not ok or frame is None:
                break
            _check_size(f"{name}: frame {read}", frame, first)
            read += 1
            yield frame
    finally:
        capture.release()
    # Containers without an index announce a count computed from their duration: off by a frame or two.
    if count is not None and read < count - max(2, count // 50):
        raise VideoError(f"{name}: ends after {read} of {count} frames (truncated or damaged)")


def _open_camera(number: int) -> VideoSource:
    if number > _LAST_CAMERA:
        raise VideoError(f"camera {number}: cannot be opened (there are no such numbers)")
    with _native_stderr_muted():
        capture = cv2.VideoCapture(number)
        opened = capture.isOpened()
        ok, first = capture.read() if opened else (False, None)
    if not opened:
        raise VideoError(f"camera {number}: cannot be opened (not present, or in use)")
    if not ok or first is None:
        capture.release()
        raise VideoError(f"camera {number}: gives no frame")
    return VideoSource(f"camera{number}", _fps(capture), None, first, _camera_frames(number, capture, first))


def _camera_frames(number: int, capture: cv2.VideoCapture, first: Image) -> Iterator[Image]:
    read = 1
    try:
        yield first
        while True:
            ok, frame = capture.read()
            if not ok or frame is None:
                # A camera has no last frame: no frame means that it has gone.
                raise VideoError(f"camera {number}: has stopped giving frames after {read}")
            _check_size(f"camera {number}: frame {read}", frame, first)
            read += 1
            yield frame
    finally:
        capture.release()


class VideoSink:
    """A video file that frames are written to.

    Parameters
    ----------
    path : Path
        Its ending chooses the codec: .webm (VP8, plays in a browser), .mkv or .avi (FFV1, lossless).
    fps : float
        Frames per second.

    Raises
    ------
    VideoError
        If the ending is another one.

    Notes
    -----
    The file is opened at the first frame, whose size it takes. An odd side is padded by one repeated row or
    column, as the codecs' chroma planes want even sides.
    """

    def __init__(self, path: Path, fps: float) -> None:
        if path.suffix.lower() not in CODECS:
            raise VideoError(f"{path}: expected a name that ends in {', '.join(CODECS)}, got {path.suffix!r}")
        self.path = path
        self.fps = fps
        self._writer: cv2.VideoWriter | None = None
        self._shape: tuple[int, ...] = ()

    def write(self, frame: NDArray[np.uint8]) -> None:
        """Append a frame (H, W, 3) BGR, uint8, of the first one's size."""
        if self._writer is None:
            self._open(frame.shape)
        if frame.shape != self._shape or self._writer is None:
            raise VideoError(f"{self.path}: expected a frame of shape {self._shape}, got {frame.shape}")
        height, width = frame.shape[:2]
        self._writer.write(cv2.copyMakeBorder(frame, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE))

    def _open(self, shape: tuple[int, ...]) -> None:
        try:
            # cv2 says only "not opened"; the operating system says why.
            self.path.open("wb").close()
        except OSError as error:
            raise VideoError(f"{self.path}: cannot be written ({error.strerror})") from error
        code = cv2.VideoWriter.fourcc(*CODECS[self.path.suffix.lower()])
        size = (shape[1] + shape[1] % 2, shape[0] + shape[0] % 2)
        with _native_stderr_muted():
            writer = cv2.VideoWriter(str(self.path), code, self.fps, size)
        if not writer.isOpened():
            raise VideoError(f"{self.path}: this OpenCV cannot write {CODECS[self.path.suffix.lower()]} video")
        self._writer, self._shape = writer, shape

    def close(self) -> None:
        """Finish the file; what has been written plays. Nothing happens if no frame was written."""
        if self._writer is None:
            return
        self._writer.release()
        self._writer = None
        self._check_room()

    def _check_room(self) -> None:
        """See whether the disk takes a little more: the encoder says nothing of what it could not write."""
        try:
            with self.path.open("r+b", buffering=0) as file:
                end = file.seek(0, os.SEEK_END)
                taken = file.write(bytes(_PROBE))
                if end > 0:
                    file.truncate(end)
        except OSError as error:
            raise VideoError(f"{self.path}: cannot be written to its end ({error.strerror})") from error
        if taken != _PROBE or end == 0:
            raise VideoError(f"{self.path}: cannot be written to its end (No space left on device)")

    def __enter__(self) -> VideoSink:
        """Return the sink itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file."""
        self.close()


@contextlib.contextmanager
def _native_stderr_muted() -> Iterator[None]:
    """Keep the codec libraries from printing: they report on the file descriptor what we raise as one line."""
    try:
        saved = os.dup(2)
    except OSError:  # no stderr at all, as under pythonw
        yield
        return
    sys.stderr.flush()
    sink = os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, 2)
    try:
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)
        os.close(sink)
