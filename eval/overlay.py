"""Boxes drawn on frames: contact sheets and videos that a browser plays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hs_tracker_cv.video import VideoError, VideoSink

from .regions import outlines, read_region
from .results import ResultsError, Run
from .sequences import Sequence

__all__ = ["VIDEO_FPS", "contact_sheet", "encode_jpeg", "frame_pictures", "write_video"]

VIDEO_FPS = 15.0
"""Frames per second of the videos."""

_TRUTH = (255, 255, 255)
_SIDE = 240  # px: shorter side of one picture of a contact sheet is about this

Image = NDArray[np.uint8]


def contact_sheet(
    sequence: Sequence, runs: Mapping[str, Run], colours: Mapping[str, str], *, count: int = 6
) -> Image:
    """Frames at even distances in one row, with the truth in white and each tracker in its colour.

    Parameters
    ----------
    sequence : Sequence
    runs : mapping of str to Run
        By tracker; the boxes to draw.
    colours : mapping of str to str
        #rrggbb of each tracker.
    count : int, optional
        Number of frames.

    Returns
    -------
    ndarray, shape (h, w, 3), uint8, BGR

    Raises
    ------
    FrameSourceError or OSError
        If the frames are not there any more.
    """
    chosen = sorted(set(np.linspace(1, len(sequence) - 1, count).round().astype(int).tolist()))
    pictures = frame_pictures(sequence, runs, colours, chosen).values()
    framed = [cv2.copyMakeBorder(one, 0, 0, 0, 2, cv2.BORDER_CONSTANT, value=_TRUTH) for one in pictures]
    return np.asarray(np.concatenate(framed, axis=1), dtype=np.uint8)


def frame_pictures(
    sequence: Sequence, runs: Mapping[str, Run], colours: Mapping[str, str], indices: Iterable[int]
) -> dict[int, Image]:
    """Frames by their numbers, in order, with the truth in white and each tracker in its colour.

    A box that was answered with False is thin.

    Raises
    ------
    FrameSourceError or OSError
        If the frames are not there any more.
    """
    wanted, zoom = set(indices), _SIDE / sequence.size[1]
    found: dict[int, Image] = {}
    if not wanted:
        return found
    for index, frame in enumerate(sequence.frames):
        if index in wanted:
            found[index] = _drawn(frame, index, sequence, runs, colours, zoom)
        if index >= max(wanted):
            break
    return found


def encode_jpeg(picture: Image) -> bytes:
    """Bytes of a JPEG file."""
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 80])[1])


def write_video(
    path: Path, sequence: Sequence, runs: Mapping[str, Run], colours: Mapping[str, str], *, fps: float = VIDEO_FPS
) -> None:
    """Write a WebM (VP8) of the whole sequence with all boxes.

    Raises
    ------
    ResultsError
        If it cannot be written.
    """
    # Small frames are enlarged to be looked at, large ones made small enough to be embedded.
    zoom = float(np.clip(360.0 / sequence.size[1], 0.2, 3.0))
    try:
        with VideoSink(path, fps) as sink:
            for index, frame in enumerate(sequence.frames):
                sink.write(_drawn(frame, index, sequence, runs, colours, zoom))
    except VideoError as error:
        raise ResultsError(str(error)) from error


def _drawn(
    frame: NDArray[Any],
    index: int,
    sequence: Sequence,
    runs: Mapping[str, Run],
    colours: Mapping[str, str],
    zoom: float,
) -> Image:
    if frame.dtype != np.uint8:
        # Of 16 bits a screen shows 8: those that the frame makes use of.
        frame = cv2.normalize(frame, None, 0, 255, cv2.NORM_MINMAX, dtype=cv2.CV_8U)  # type: ignore[call-overload]
    coloured = cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) if frame.ndim == 2 or frame.shape[2] == 1 else frame
    method = cv2.INTER_AREA if zoom < 1 else cv2.INTER_LINEAR
    picture: Image = np.asarray(cv2.resize(coloured, None, fx=zoom, fy=zoom, interpolation=method), dtype=np.uint8)
    if np.isfinite(sequence.boxes[index]).all() and sequence.visibility[index] > 0:
        _rectangle(picture, sequence.boxes[index] * zoom, (0, 0, 0), 3)
        _rectangle(picture, sequence.boxes[index] * zoom, _TRUTH, 1)
        _outline(picture, sequence.regions, index, zoom, _TRUTH)
    for name, run in runs.items():
        if np.isfinite(run.trajectory.boxes[index]).all():
            width = 2 if run.trajectory.ok[index] else 1
            _rectangle(picture, run.trajectory.boxes[index] * zoom, _bgr(colours[name]), width)
            _outline(picture, run.trajectory.regions, index, zoom, _bgr(colours[name]))
    cv2.putText(picture, str(index), (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(picture, str(index), (4, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, _TRUTH, 1, cv2.LINE_AA)
    return picture


def _outline(picture: Image, regions: tuple[str, ...], index: int, zoom: float, colour: tuple[int, int, int]) -> None:
    """Thin line round a mask or rotated box, where there is one."""
    if regions and regions[index]:
        cv2.polylines(picture, outlines(read_region(regions[index]), zoom), True, colour, 1, cv2.LINE_AA)


def _rectangle(picture: Image, box: NDArray[np.float64], colour: tuple[int, int, int], width: int) -> None:
    x, y, w, h = np.clip(box, -1e4, 1e4)
    corners = [round(float(value)) for value in (x, y, x + w - 1, y + h - 1)]
    cv2.rectangle(picture, (corners[0], corners[1]), (corners[2], corners[3]), colour, width)


def _bgr(colour: str) -> tuple[int, int, int]:
    red, green, blue = (int(colour[start : start + 2], 16) for start in (1, 3, 5))
    return blue, green, red
