"""Video out: WebM, Matroska and AVI."""

from __future__ import annotations

import os
import stat
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import cv2

from .quiet import without_remark
from .source import Picture, VideoError, native_name

__all__ = ["CODECS", "VideoSink"]

CODECS = {".webm": "VP80", ".mkv": "FFV1", ".avi": "FFV1"}
"""Codec by file name. VP8 plays in every browser and is eight times faster to write than VP9; FFV1 is lossless.
MP4 is missing because the OpenCV wheels hold no H.264 encoder and browsers do not play their MPEG-4."""

_PROBE = bytes(4096)
"""What a disk must take after a frame for the frame to count as written."""


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
        If the ending is another one, or the name is not UTF-8.

    Attributes
    ----------
    count : int
        Frames written.

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
        self.count = 0
        self._name = native_name(path)
        self._writer: cv2.VideoWriter | None = None
        self._disk: BinaryIO | None = None
        self._shape: tuple[int, ...] = ()

    def write(self, frame: Picture) -> None:
        """Append a frame (H, W, 3) BGR, uint8, of the first one's size.

        Raises
        ------
        VideoError
            If the file cannot be made, the disk is full or the frame is of another size.
        """
        if self._writer is None:
            self._open(frame.shape)
        if frame.shape != self._shape or self._writer is None:
            raise VideoError(f"{self.path}: expected a frame of shape {self._shape}, got {frame.shape}")
        height, width = frame.shape[:2]
        self._writer.write(cv2.copyMakeBorder(frame, 0, height % 2, 0, width % 2, cv2.BORDER_REPLICATE))
        self._check_room()
        self.count += 1

    def _open(self, shape: tuple[int, ...]) -> None:
        try:
            # cv2 says only "not opened"; the operating system says why.
            self._disk = self.path.open("wb", buffering=0)
        except OSError as error:
            raise VideoError(f"{self.path}: cannot be written ({error.strerror})") from error
        codec = CODECS[self.path.suffix.lower()]
        size = (shape[1] + shape[1] % 2, shape[0] + shape[0] % 2)
        with without_remark(b"OpenCV: FFMPEG: tag"):
            writer = cv2.VideoWriter(self._name, cv2.VideoWriter.fourcc(*codec), self.fps, size)
        if not writer.isOpened():
            self._disk.close()
            raise VideoError(f"{self.path}: this OpenCV cannot write {codec} video of {size[0]} × {size[1]} px")
        self._writer, self._shape = writer, shape

    def close(self) -> None:
        """Finish the file; what has been written plays. Nothing happens if no frame was written.

        Raises
        ------
        VideoError
            If the disk has no room for the end of the file.
        """
        if self._writer is None or self._disk is None:
            return
        self._writer.release()
        self._writer = None
        with self._disk:
            self._check_room()

    def _check_room(self) -> None:
        """See whether the disk takes a little more: the encoder says nothing of what it could not write."""
        assert self._disk is not None
        try:
            end = self._disk.seek(0, os.SEEK_END)
            taken = self._disk.write(_PROBE)
            if stat.S_ISREG(os.fstat(self._disk.fileno()).st_mode):
                self._disk.truncate(end)
        except OSError as error:
            raise VideoError(f"{self.path}: cannot be written to its end ({error.strerror})") from error
        if taken != len(_PROBE):
            raise VideoError(f"{self.path}: cannot be written to its end (No space left on device)")

    def __enter__(self) -> VideoSink:
        """Return the sink itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish the file."""
        self.close()
