"""What every source of frames is: its name, rate, first frame, and all frames as 8-bit BGR of one size."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..frames import InputError, as_frame, crop, fixed_errstate, next_frame

__all__ = ["DEFAULT_FPS", "Bytes", "Image", "Picture", "VideoError", "VideoSource", "native_name"]

DEFAULT_FPS = 25.0
"""Where a source does not say its own."""

Image = NDArray[Any]
Picture = NDArray[np.uint8]


class VideoError(RuntimeError):
    """A video that cannot be read or written; the message is one line."""


def _nothing() -> None:
    pass


@dataclass(frozen=True)
class VideoSource:
    """An open source of frames.

    Parameters
    ----------
    name : str
        What output files are named after.
    fps : float
        Frames handed out per second; 25 where the source does not say.
    count : int or None
        Number of frames to expect, an estimate for many containers; None for what is live.
    first : ndarray, shape (H, W, 3), uint8, BGR
        The first frame, already decoded: what an ROI is drawn on.
    frames : iterator of ndarray
        All frames in order, the first included, of the same shape. Raises VideoError where the source breaks.
    start, step : int
        Frame k of `frames` is number ``start + k * step`` of the source.
    remarks : list of str
        What is odd about the source without being an error; complete once all frames have been read.
    release : callable
        Gives back what `frames` hold, whether or not they have been read.
    """

    name: str
    fps: float
    count: int | None
    first: Picture
    frames: Iterator[Picture]
    start: int = 0
    step: int = 1
    remarks: list[str] = field(default_factory=list)
    release: Callable[[], None] = _nothing

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return int(self.first.shape[1]), int(self.first.shape[0])

    def close(self) -> None:
        """Release the file or camera."""
        self.release()

    def __enter__(self) -> VideoSource:
        """Return the source itself."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Release the file or camera."""
        self.close()


class Bytes:
    """Brings the frames of a source to 8-bit BGR, all by the range of the first one.

    Parameters
    ----------
    name : str
        Where the first frame comes from, for messages.
    first : ndarray
        (H, W) or (H, W, 3), of any type of numbers.
    gain : float or None
        Gray levels per unit; None takes the range of the first frame, with headroom.

    Raises
    ------
    VideoError
        If it is no picture.
    """

    @fixed_errstate
    def __init__(self, name: str, first: Image, gain: float | None) -> None:
        self._size, self._dtype = first.shape[:2], first.dtype
        try:
            self._format = as_frame(_real(first), gain).format
        except InputError as error:
            raise VideoError(f"{name}: {error}") from error

    @fixed_errstate
    def __call__(self, name: str, image: Image) -> Picture:
        """Convert a frame.

        Raises
        ------
        VideoError
            If it is no picture, or differs from the first one in size or depth; `name` says where it comes from.
        """
        if image.shape[:2] != self._size:
            raise VideoError(f"{name}: is {_shown(image.shape)} px, but the first frame is {_shown(self._size)} px")
        if image.dtype != self._dtype:
            raise VideoError(f"{name}: holds {image.dtype} values, but the first frame {self._dtype}")
        channels = 1 if image.ndim == 2 else image.shape[2]
        try:
            frame = next_frame(_real(image), self._format._replace(channels=channels))
        except InputError as error:
            raise VideoError(f"{name}: {error}") from error
        picture = frame.pixels
        if picture.dtype != np.uint8 or frame.gain != 1.0:
            values = crop(frame, 0, 0, frame.width, frame.height)
            picture = np.clip(np.rint(values), 0.0, 255.0).astype(np.uint8)
        return np.asarray(picture if channels == 3 else cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), np.uint8)


def _real(image: Image) -> Image:
    """Signed and wide integers, which TIFF has, as floats."""
    plain = image.dtype.kind == "f" or image.dtype in (np.uint8, np.uint16)
    return image if plain else image.astype(np.float32)


def _shown(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} × {shape[0]}"


def native_name(path: Path) -> str:
    """Name of a file as cv2 takes it: FFmpeg reads a relative one with a colon as a protocol.

    Raises
    ------
    VideoError
        If the name is not UTF-8, which would end the process inside cv2.
    """
    name = str(path if path.is_absolute() else Path.cwd() / path if path.drive else f"./{path}")
    try:
        name.encode("utf-8")
    except UnicodeEncodeError:
        shown = str(path).encode("utf-8", "backslashreplace").decode()
        raise VideoError(f"{shown}: OpenCV takes names in UTF-8 only; rename the file") from None
    return name
