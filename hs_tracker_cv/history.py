"""The frames before the last one, taken to its camera and its light; where points of it have been."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import STILL, Affine, carried
from .comparison import Comparison

__all__ = ["Area", "History", "chained"]

Plane = NDArray[np.float32]
Area = tuple[slice, slice]


@dataclass
class _Past:
    """An earlier frame: what takes it to the last one, and the pair of it and the frame after it."""

    pair: Comparison
    motion: Affine
    gain: Plane
    flow: Plane | None = None


class History:
    """Earlier frames of a video, the latest first: `steps` = 1 is the frame before the last one.

    Parameters
    ----------
    length : int
        Most frames kept.
    flow_of : callable
        Gives the flow of a pair beyond the camera's; called only for pairs whose flow is asked for.
    """

    def __init__(self, length: int, flow_of: Callable[[Comparison], Plane]) -> None:
        self._past: deque[_Past] = deque(maxlen=length)
        self._flow_of = flow_of

    def __len__(self) -> int:
        """Frames kept."""
        return len(self._past)

    def clear(self) -> None:
        """Forget all frames."""
        self._past.clear()

    def take_in(self, pair: Comparison) -> None:
        """Add the earlier frame of a pair whose later one is the last frame now; its motion must be known."""
        assert pair.motion is not None
        for past in self._past:
            if pair.motion is not STILL:
                past.motion = chained(pair.motion, past.motion)
                past.gain = carried(past.gain, pair.motion)[0]
            past.gain = past.gain * pair.gain
        self._past.appendleft(_Past(pair, pair.motion, pair.gain))

    def view(self, steps: int, area: Area, motion: Affine | None = None) -> Plane:
        """An earlier frame as the last one would show it, in an area, lattice px.

        Parameters
        ----------
        steps : int
        area : tuple of slice
            Rows and columns.
        motion : ndarray, shape (2, 3), optional
            Motion since then, beyond the camera's.
        """
        past = self._past[steps - 1]
        gray, gain = past.pair.before.gray, past.gain[area]
        if motion is None and past.motion is STILL:
            return np.asarray(gray[area] * gain, np.float32)
        rows, columns = area
        total = past.motion.copy() if motion is None else chained(motion, past.motion)
        total[:, 2] -= (columns.start, rows.start)
        size = columns.stop - columns.start, rows.stop - rows.start
        seen = cv2.warpAffine(gray, total, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        # Light varies slowly over the frame: where it fell then is as good as where it falls now.
        return np.asarray(seen * gain, np.float32)

    def traced(self, points: Plane) -> list[Plane]:
        """Displacement of points since each earlier frame, beyond the camera's.

        Parameters
        ----------
        points : ndarray, shape (N, 2), float32
            x, y in the last frame, lattice px.

        Returns
        -------
        list of ndarray, shape (N, 2), float32
            Of as many entries as there are frames, the latest first.
        """
        place, displacement, result = points, np.zeros_like(points), []
        for past in self._past:
            if past.flow is None:
                past.flow = self._flow_of(past.pair)
            at = np.ascontiguousarray(place, np.float32)
            own = _sampled(past.flow, at)
            displacement = displacement + own
            result.append(displacement)
            place = place - own
            if past.pair.motion is not None and past.pair.motion is not STILL:
                back = cv2.invertAffineTransform(past.pair.motion)
                place = place @ back[:, :2].T.astype(np.float32) + back[:, 2].astype(np.float32)
        return result

    def last_flow(self) -> Plane:
        """Flow of the last pair beyond the camera's."""
        past = self._past[0]
        if past.flow is None:
            past.flow = self._flow_of(past.pair)
        return past.flow


def _sampled(flow: Plane, points: Plane) -> Plane:
    """Flow at points between pixels."""
    x, y = (np.ascontiguousarray(points[:, k : k + 1]) for k in (0, 1))
    return np.asarray(cv2.remap(flow, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)[:, 0]


def chained(second: Affine, first: Affine) -> Affine:
    """The map that does `first` and then `second`."""
    matrix = second[:, :2] @ first[:, :2]
    return np.column_stack([matrix, second[:, :2] @ first[:, 2] + second[:, 2]])
