"""What OpenCV and its decoders print: silenced for a whole program, or one remark of the encoder's left out."""

from __future__ import annotations

import contextlib
import os
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import cv2

__all__ = ["silence_decoders", "without_remark"]

_lock = threading.Lock()


def silence_decoders() -> None:
    """Keep OpenCV and FFmpeg from printing in this process, unless the environment asks for it.

    For programs: they say the same in one line. Has no effect on FFmpeg once a video has been opened.
    """
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")  # "quiet"
    if "OPENCV_LOG_LEVEL" not in os.environ:
        # The one is OpenCV's until 4.12, the other from 4.13 on; 0 is "silent".
        set_level = getattr(cv2, "setLogLevel", None) or cv2.utils.logging.setLogLevel
        set_level(0)


@contextlib.contextmanager
def without_remark(start: bytes) -> Iterator[None]:
    """Leave out lines of standard error that begin with `start`, for what OpenCV prints whatever its log level.

    Standard error belongs to the whole process: what other threads write meanwhile comes through a little later, and
    blocks of several threads wait for one another.
    """
    with _lock, tempfile.TemporaryDirectory() as folder, (Path(folder) / "heard").open("ab", 0) as heard:
        try:
            saved = os.dup(2)
        except OSError:  # no stderr at all, as under pythonw
            yield
            return
        sys.stderr.flush()
        os.dup2(heard.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(saved, 2)
            # Read by a handle of its own: a thread that is still writing shares the position of the other one.
            for line in Path(heard.name).read_bytes().splitlines(keepends=True):
                if not line.startswith(start):
                    os.write(saved, line)
            os.close(saved)
