"""Frames of a source by number, forwards and backwards."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from ..video import VideoError, VideoSource

__all__ = ["FrameStore"]

BUDGET = 400_000_000
"""Bytes of decoded frames that are kept: some 430 frames of 640 × 480."""


class FrameStore:
    """The frames of one source; the last ones are kept, earlier ones are decoded again from the beginning.

    What is live (a camera, a stream) has no way back beyond those that are kept.

    Seeking in the file would be faster, but is off by some frames in many containers.

    Parameters
    ----------
    reopen : callable
        Opens the source at its first frame; raises VideoError.
    offered : str
        The name under which the page offers the source.
    budget : int
        Bytes of frames to keep; two frames are kept in any case.

    Raises
    ------
    VideoError
        If the source cannot be opened.
    """

    def __init__(self, reopen: Callable[[], VideoSource], *, offered: str = "", budget: int = BUDGET) -> None:
        self.offered = offered
        self._reopen = reopen
        self._source = reopen()
        self.live = self._source.count is None
        self._next = 0
        self._kept: OrderedDict[int, Any] = OrderedDict()
        self._room = max(budget // max(self._source.first.nbytes, 1), 2)
        self._known_count: int | None = None

    @property
    def name(self) -> str:
        """What output files are named after."""
        return self._source.name

    @property
    def fps(self) -> float:
        """Frames per second."""
        return self._source.fps

    @property
    def size(self) -> tuple[int, int]:
        """Width and height, px."""
        return self._source.size

    @property
    def count(self) -> int | None:
        """Number of frames: as announced, and exact once the end has been seen; None for what is live."""
        return self._known_count if self._known_count is not None else self._source.count

    @property
    def ended(self) -> bool:
        """Whether `count` is exact."""
        return self._known_count is not None

    def get(self, index: int) -> Any:
        """Return the frame of that number; None behind the last one.

        Raises
        ------
        VideoError
            If the source breaks, once, or has moved on for good; what was read before it stays.
        """
        while self.approach(index):
            pass
        return self._kept.get(index)

    def __contains__(self, index: int) -> bool:
        """Whether a frame is kept, and had at once."""
        return index in self._kept

    def approach(self, index: int) -> bool:
        """Read one frame on the way to `index`; False when it is there, or there is none.

        Raises
        ------
        VideoError
            As `get`.
        """
        if index in self._kept or (self._known_count is not None and index >= self._known_count):
            return False
        if index < self._next:
            self._rewind(index)
        return self._read()

    def _rewind(self, index: int) -> None:
        if self.live:
            raise VideoError(f"{self.name}: frame {index} is no longer kept, and what is live has no way back")
        self._source.close()
        self._source, self._next = self._reopen(), 0
        self._kept.clear()

    def _read(self) -> bool:
        try:
            frame = next(self._source.frames, None)
        except VideoError:
            self._known_count = self._next
            raise
        if frame is None:
            self._known_count = self._next
            return False
        self._kept[self._next] = frame
        self._next += 1
        while len(self._kept) > self._room:
            self._kept.popitem(last=False)
        return True

    def close(self) -> None:
        """Release the source and the frames."""
        self._source.close()
        self._kept.clear()
