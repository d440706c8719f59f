"""Frames from where they lie, one at a time; the place is plain data, so that it can cross to another process."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hs_tracker_cv.video import VideoError, native_name, read_image

from . import rendered

__all__ = ["FrameSource", "FrameSourceError"]


class FrameSourceError(ValueError):
    """A frame that should be there cannot be read."""


@dataclass(frozen=True)
class FrameSource:
    """Where the frames of a sequence are.

    Parameters
    ----------
    paths : tuple of str
        One image file per frame; or a single ``.npy`` file of shape (T, H, W) or (T, H, W, C); or a single video; or
        of a drawn sequence the arguments of :func:`eval.rendered.frames_of`.
    kind : {"images", "array", "video", "gray video", "drawn"}
        Which of these; a gray video has its one channel three times, and gives it once.
    count : int
        Number of frames to give.
    """

    paths: tuple[str, ...]
    kind: str
    count: int

    def __iter__(self) -> Iterator[NDArray[Any]]:
        """Frames (H, W) or (H, W, C) in order, each an array of its own.

        Raises
        ------
        FrameSourceError
            At the first frame that cannot be read.
        """
        readers = {
            "images": self._images, "array": self._array, "video": self._video, "gray video": self._gray_video,
            "drawn": self._drawn,
        }  # fmt: skip
        return islice(readers[self.kind](), self.count)

    def places(self) -> list[Path]:
        """Folders and files that the frames, and what belongs to them, lie in."""
        if self.kind == "drawn":
            return [rendered.kept_frames()]
        return [Path(path) if "video" in self.kind else Path(path).parent for path in self.paths]

    def to_json(self) -> dict[str, Any]:
        """Plain data from which :meth:`from_json` makes an equal source."""
        return asdict(self)

    @classmethod
    def from_json(cls, data: dict[str, Any]) -> FrameSource:
        """Make the source that :meth:`to_json` described."""
        return cls(tuple(data["paths"]), data["kind"], data["count"])

    def _images(self) -> Iterator[NDArray[Any]]:
        for path in self.paths:
            try:
                yield read_image(Path(path))
            except VideoError as error:
                raise FrameSourceError(f"cannot read the frame {error}") from error

    def _array(self) -> Iterator[NDArray[Any]]:
        for frame in np.load(self.paths[0], mmap_mode="r"):
            yield np.array(frame)

    def _drawn(self) -> Iterator[NDArray[Any]]:
        try:
            frames = rendered.frames_of(*self.paths)
        except (TypeError, ValueError) as error:
            raise FrameSourceError(str(error)) from error
        for frame in frames:
            yield np.array(frame)

    def _gray_video(self) -> Iterator[NDArray[Any]]:
        return (frame[:, :, 0].copy() for frame in self._video())

    def _video(self) -> Iterator[NDArray[Any]]:
        capture = cv2.VideoCapture(native_name(Path(self.paths[0])))
        try:
            for index in range(self.count):
                read, frame = capture.read()
                if not read:
                    raise FrameSourceError(f"{self.paths[0]} ends at frame {index}, expected {self.count}")
                yield frame
        finally:
            capture.release()
