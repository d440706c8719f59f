"""Which kind of source a name means."""

from __future__ import annotations

import math
import os
import re
import stat
from pathlib import Path
from typing import Literal

from .capture import STREAMS, open_camera, open_file, open_stream
from .folder import open_folder
from .source import VideoError, VideoSource

__all__ = ["VIDEO_SUFFIXES", "open_source", "source_kind"]

VIDEO_SUFFIXES = frozenset({".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".ts", ".webm", ".wmv"})
"""What files that are meant as videos end in; `open_source` asks the file itself."""

_SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]+)://")
_CAMERA = re.compile(r"/dev/video(\d+)")


def open_source(source: str | int | Path, *, start: int = 0, step: int = 1, gain: float | None = None) -> VideoSource:
    """Open a video file, a stream, a camera or a folder of images.

    Parameters
    ----------
    source : str, int or Path
        Path of a file or folder; URL of a stream (RTSP, HTTP and others); a number, a string of digits that names no
        file, or /dev/videoN is a camera.
    start : int
        Number of the first frame that is handed out.
    step : int
        Hand out every so-manieth frame from there.
    gain : float, optional
        Gray levels (of 255) per unit of frames of more than 8 bits, which are brought to 8; by default the range of
        the first frame, with headroom. Either holds for the whole source.

    Returns
    -------
    VideoSource
        Its first frame has been decoded, so a source that cannot be used has already been refused.

    Raises
    ------
    VideoError
        If there is no such source, it cannot be read, or it yields no frame.
    ValueError
        If start is negative, step less than 1 or gain not above 0.
    """
    if start < 0 or step < 1 or (gain is not None and not 0.0 < gain < math.inf):
        raise ValueError(f"expected start >= 0, step >= 1 and gain > 0, got {start!r}, {step!r}, {gain!r}")
    text = str(source)
    kind = source_kind(source)
    if kind == "stream":
        scheme = text.split("://")[0]
        if scheme.lower() not in STREAMS:
            raise VideoError(f"{text}: expected a URL of {', '.join(sorted(STREAMS))}, got {scheme}")
        return open_stream(text, start, step, gain)
    if kind == "camera":
        camera = _CAMERA.fullmatch(text)
        return open_camera(int(camera[1] if camera else text), start, step, gain)
    return (open_folder if kind == "folder" else open_file)(Path(text), start, step, gain)


def source_kind(source: str | int | Path) -> Literal["stream", "camera", "folder", "file"]:
    """What `open_source` takes a name for; a file is also what is not there.

    Parameters
    ----------
    source : str, int or Path
    """
    text = str(source)
    if _SCHEME.match(text):
        return "stream"
    mode = _mode(text)
    device = mode is not None and stat.S_ISCHR(mode) and _CAMERA.fullmatch(text)
    if isinstance(source, int) or device or (text.isdecimal() and mode is None):
        return "camera"
    return "folder" if mode is not None and stat.S_ISDIR(mode) else "file"


def _mode(path: str) -> int | None:
    """What kind of thing a path names; None where there is nothing that could be asked."""
    try:
        return os.stat(path).st_mode
    except (OSError, ValueError):
        return None
