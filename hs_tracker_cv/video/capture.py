"""What cv2.VideoCapture reads: video files, streams and cameras."""

from __future__ import annotations

import json
import os
import stat
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import cv2
import numpy as np

from .container import announced_bytes
from .source import DEFAULT_FPS, Bytes, Image, Picture, VideoError, VideoSource, native_name

__all__ = ["STREAMS", "open_camera", "open_file", "open_stream"]

STREAMS = frozenset({"http", "https", "rtmp", "rtmps", "rtp", "rtsp", "rtsps", "srt", "tcp", "udp"})
"""Schemes of URLs that are handed to FFmpeg."""

_LAST_CAMERA = 2**31 - 1  # cv2 takes a C int
_MOST_FRAMES = 10**9  # live streams announce counts of any size
_SLACK = 1024  # bytes by which writers are wrong about their own files
_RUN = 5  # repeated frames in succession that make us ask the decoder why
_GAP_SECONDS, _GAP_SHARE = 1.0, 0.1  # an end without frames that is worth a remark
_GRAY16 = int.from_bytes(b"Y1\x00\x10", "little")
_TEXT = int.from_bytes(b"ansi", "little")  # what FFmpeg takes any text for whose name it knows

_SILENCING = ("OPENCV_LOG_LEVEL", "OPENCV_FFMPEG_LOGLEVEL", "OPENCV_FFMPEG_DEBUG")
_PROBE = """
import sys
sys.path[:] = filter(None, sys.path)  # never a cv2.py that lies beside the video
import cv2, json
name, count = json.load(sys.stdin)
capture = cv2.VideoCapture(name)
for _ in range(count - 1):
    capture.grab()
capture.read()
"""


def open_file(path: Path, start: int, step: int, gain: float | None) -> VideoSource:
    """Open a video file; raises VideoError."""
    name = native_name(path)
    try:
        # A pipe would be waited for, perhaps for ever, and what is read from it is gone.
        if not stat.S_ISREG(path.stat().st_mode):
            raise VideoError(f"{path}: is neither a file nor a folder (a camera is given by its number)")
        missing = _missing_bytes(path)
    except (OSError, ValueError) as error:
        raise VideoError(f"{path}: cannot be read ({getattr(error, 'strerror', None) or error})") from error
    capture = cv2.VideoCapture(name)
    if not capture.isOpened():
        raise VideoError(f"{path}: is not a video that OpenCV can open (damaged, or an unknown format)")
    if int(capture.get(cv2.CAP_PROP_FOURCC)) == _TEXT:
        capture.release()
        raise VideoError(f"{path}: is a text, which FFmpeg would show letter by letter, and no video")
    reading = _Reading(str(path), capture, start, step, gain)
    reading.begin(name)
    ending = f"the file is cut off: {missing} bytes are missing" if missing else ""
    return reading.source(path.stem, reading.checked_frames(name, ending))


def _missing_bytes(path: Path) -> int:
    size = path.stat().st_size
    if size == 0:
        raise VideoError(f"{path}: is an empty file")
    announced = announced_bytes(path)
    return announced - size if announced is not None and announced - size > _SLACK else 0


def open_stream(url: str, start: int, step: int, gain: float | None) -> VideoSource:
    """Open a stream by its URL, of which user, password and query are never repeated; raises VideoError."""
    parts = urlsplit(url)
    shown = f"{parts.scheme}://{parts.netloc.rpartition('@')[2]}{parts.path}"
    native_name(Path(url))
    capture = cv2.VideoCapture(url)
    if not capture.isOpened():
        raise VideoError(f"{shown}: cannot be opened (no such stream, or an unknown format)")
    reading = _Reading(shown, capture, start, step, gain)
    reading.begin(url)
    stem = Path(parts.path).stem or parts.hostname or parts.scheme
    frames = reading.frames() if reading.count is not None else reading.live_frames()
    return reading.source("".join(c if c.isalnum() or c in "-_." else "_" for c in stem), frames)


def open_camera(number: int, start: int, step: int, gain: float | None) -> VideoSource:
    """Open a camera; raises VideoError."""
    name = f"camera {number}"
    if number > _LAST_CAMERA:
        raise VideoError(f"{name}: cannot be opened (there are no such numbers)")
    capture = cv2.VideoCapture(number)
    if not capture.isOpened():
        raise VideoError(f"{name}: cannot be opened (not present, or in use)")
    reading = _Reading(name, capture, start, step, gain, live=True)
    return reading.source(f"camera{number}", reading.live_frames())


class _Reading:
    """A capture of which the first frame wanted has been read.

    Parameters
    ----------
    name : str
        What messages call it.
    capture : cv2.VideoCapture
        Opened; released when the frames end, or here if there is none.
    start, step, gain
        As for open_source.
    live : bool
        Whether there is no last frame.
    """

    def __init__(
        self, name: str, capture: cv2.VideoCapture, start: int, step: int, gain: float | None, *, live: bool = False
    ) -> None:
        self._name, self._capture, self._start, self._step, self._live = name, capture, start, step, live
        if int(capture.get(cv2.CAP_PROP_CODEC_PIXEL_FORMAT)) == _GRAY16:
            capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)  # else 16 bits come as their upper 8, whatever their range
        self.read = 0
        self.remarks: list[str] = []
        self._seconds = 0.0
        self._repeats = 0
        self._suspect = 0  # number of frames read up to a run that nobody has been asked about
        self._next_asked = 0
        self._ahead: Image | None = None
        try:
            first = self._next(start)
            if first is None:
                raise VideoError(self._no_frame())
            self._raw, self._convert = first, Bytes(name, first, gain)
            self._first = self._convert(name, first)
        except BaseException:
            capture.release()
            raise
        announced = 0 if live else capture.get(cv2.CAP_PROP_FRAME_COUNT)
        self.count = int(announced) if 0 < announced < _MOST_FRAMES else None
        fps = float(capture.get(cv2.CAP_PROP_FPS))
        # A container without a frame rate reports 0, NaN or its time base (1000, 90000).
        self._fps = fps if 0.0 < fps <= 480.0 else DEFAULT_FPS
        self._duration = (self.count or 0) / self._fps

    def _no_frame(self) -> str:
        if self._live:
            return f"{self._name}: gives no frame"
        if self.read > 0:
            return f"{self._name}: has {self.read} frames, none after frame {self._start - 1}"
        code = int(self._capture.get(cv2.CAP_PROP_FOURCC))
        letters = bytes((code >> shift) & 0xFF for shift in (0, 8, 16, 24))
        codec = letters.decode("ascii", errors="replace").strip("\0 ") or "?"
        return f"{self._name}: no frame can be decoded (no frames, or the unknown codec {codec!r})"

    def source(self, name: str, frames: Iterator[Picture]) -> VideoSource:
        """The source that hands out `frames`."""
        count = None if self.count is None else max(-(-(self.count - self._start) // self._step), 1)
        rest = self._start, self._step, self.remarks, self._capture.release
        return VideoSource(name, self._fps / self._step, count, self._first, frames, *rest)

    def frames(self) -> Iterator[Picture]:
        """All frames from the first wanted one on."""
        try:
            yield self._first
            while (image := self._next(self._step - 1)) is not None:
                yield self._convert(f"{self._name}: frame {self.read - 1}", image)
        finally:
            self._capture.release()

    def _remark_on_the_end(self) -> None:
        """A tail of zeros, as interrupted downloads leave it, is skipped by the decoder without a word."""
        if self._duration - self._seconds > max(_GAP_SECONDS, _GAP_SHARE * self._duration):
            self.remarks.append(
                f"{self._name}: no frame after {self._seconds:.1f} of {self._duration:.1f} s "
                "(damaged, or its last picture is held)"
            )

    def live_frames(self) -> Iterator[Picture]:
        """All frames of what has no last one: no frame means that it has gone."""
        yield from self.frames()
        raise VideoError(f"{self._name}: has stopped giving frames after {self.read}")

    def checked_frames(self, file: str, ending: str) -> Iterator[Picture]:
        """All frames of a file; raises at the end with `ending` if any, and where it turns out to be interlaced."""
        previous = self._first
        for picture in self.frames():
            if picture is not self._first:
                self._count_repeats(file, _same(picture, previous))
            previous = picture
            yield picture
        if self._suspect:
            self._refuse_interlaced(file, self._suspect)
        if ending:
            raise VideoError(f"{self._name}: ends after {self.read} frames ({ending})")
        self._remark_on_the_end()

    def begin(self, file: str) -> None:
        """Look at the second frame, so that an interlaced file is refused before anybody has used the first.

        Raises
        ------
        VideoError
            If it is interlaced.
        """
        self._ahead = self._next(self._step - 1)
        if self._ahead is not None and _same(self._ahead, self._raw):
            self._refuse_interlaced(file, self.read)

    def _count_repeats(self, file: str, repeated: bool) -> None:
        """Broadcasts become interlaced midway; raises VideoError where the frames stand still because of it.

        The decoder is asked in frames whose numbers double, so that a screen that stands still costs little.
        """
        self._repeats = self._repeats + 1 if repeated else 0
        if self._repeats >= _RUN:
            self._suspect = self.read
            if self.read >= self._next_asked:
                self._refuse_interlaced(file, self.read)

    def _refuse_interlaced(self, file: str, count: int) -> None:
        """Ask the decoder whether the last of `count` frames is one that it could not convert; raises VideoError."""
        self._suspect, self._next_asked = 0, 2 * count
        if _is_interlaced(file, count):
            self._capture.release()
            raise VideoError(
                f"{self._name}: is interlaced, which this OpenCV ({cv2.__version__}) cannot convert; "
                f"deinterlace it first: ffmpeg -i {Path(self._name).name} -vf yadif progressive.mkv"
            )

    def _next(self, skip: int) -> Image | None:
        """The frame after `skip` others, or the one that was read ahead; None at the end."""
        if self._ahead is not None:
            image, self._ahead = self._ahead, None
            return image
        for _ in range(skip):
            if not self._capture.grab():
                return None
            self.read += 1
        ok, image = self._capture.read()
        if not ok or image is None:
            return None
        self.read += 1
        self._seconds = max(self._seconds, self._capture.get(cv2.CAP_PROP_POS_MSEC) / 1e3)
        return image


def _same(one: Image, two: Image) -> bool:
    return np.array_equal(one[::16], two[::16]) and np.array_equal(one, two)


def _is_interlaced(file: str, count: int) -> bool:
    """Ask the decoder, in a process of its own: it tells standard error alone that it could not convert a frame.

    What cv2 hands out then is the memory as it was: black, or the frame before, or whatever lay there.
    """
    if not sys.executable or getattr(sys, "frozen", False):
        return False
    environment = {name: value for name, value in os.environ.items() if name not in _SILENCING}
    try:
        # Not on the command line, which others can read: a URL may hold a password.
        order = json.dumps([file, count]).encode()
        command = [sys.executable, "-c", _PROBE]
        said = subprocess.run(command, env=environment, capture_output=True, input=order, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return False
    return b"interlaced" in said.stderr + said.stdout
