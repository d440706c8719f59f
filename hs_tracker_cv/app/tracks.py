"""One tracker on one object, frame by frame: ours or one of OpenCV's."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..following import Step, steps
from ..geometry import Box
from ..params import TrackerHS_Params
from .rivals import Rival

__all__ = ["OURS", "Silhouette", "Track"]

OURS = "TrackerHS"
RECENT = 25
"""Updates of which the usual time is told."""


@dataclass(frozen=True)
class Silhouette:
    """The pixels that a tracker takes for the object, packed eight to a byte.

    Parameters
    ----------
    window : Box
        Where they lie, frame px.
    shape : tuple of int
    bits : ndarray of uint8
    """

    window: Box
    shape: tuple[int, ...]
    bits: NDArray[np.uint8]

    @classmethod
    def of(cls, step: Step) -> Silhouette | None:
        """What a step has to show of it; None without a mask."""
        fields = step.fields
        if fields is None or fields.mask is None:
            return None
        return cls(fields.window, fields.mask.shape, np.packbits(fields.mask))

    @property
    def mask(self) -> NDArray[np.bool_]:
        """Its pixels, bool."""
        count = int(np.prod(self.shape))
        return np.asarray(np.unpackbits(self.bits, count=count).reshape(self.shape) > 0, bool)


class Track:
    """What one tracker has found of one object, from the frame it was boxed in.

    Parameters
    ----------
    name : str
        "TrackerHS", or one of `rivals`.
    number : int
        Of the object, from 1.
    roi : Box
        The object in frame `start`, px.
    start : int
    parameters : TrackerHS_Params
        For ours.
    create : callable, optional
        Makes the tracker, for one of OpenCV's.

    Attributes
    ----------
    steps : list of Step
        From frame `start` on; without frames and fields, which would fill the memory.
    failure : str
        Why it has ended; empty while it goes on.
    """

    def __init__(
        self,
        name: str,
        number: int,
        roi: Box,
        start: int,
        parameters: TrackerHS_Params,
        create: Callable[[], Any] | None = None,
    ) -> None:
        self.name, self.number, self.roi, self.start = name, number, roi, start
        self.parameters = parameters
        self.steps: list[Step] = []
        self.failure = ""
        self._silhouettes: list[Silhouette | None] = []
        self._frame: Any = None
        self._rival = Rival(create, roi) if create is not None else None
        self._ours = steps(self._frames(), roi, show=True, first=start, parameters=parameters)

    @property
    def label(self) -> str:
        """Name and number of the object."""
        return f"{self.name} {self.number}"

    @property
    def head(self) -> int:
        """Last frame it has seen; the one before `start` at first."""
        return self.start + len(self.steps) - 1

    def feed(self, frame: Any) -> None:
        """Take the frame behind `head`.

        Raises
        ------
        InputError, cv2.error
            If the frame cannot be used; the track then ends here.
        """
        self._frame = frame
        try:
            step = self._next()
        except cv2.error as error:
            self.failure = " ".join(str(error).split())
            raise
        self._silhouettes.append(Silhouette.of(step))
        self.steps.append(replace(step, frame=None, fields=None))

    def _next(self) -> Step:
        if self._rival is None:
            return next(self._ours)
        index = self.head + 1
        return self._rival.update(index, self._frame) if self.steps else self._rival.init(index, self._frame)

    def _frames(self) -> Iterator[Any]:
        while True:
            yield self._frame

    def at(self, index: int) -> Step | None:
        """What was found in a frame; None where the track has not been."""
        return self.steps[index - self.start] if self.start <= index <= self.head else None

    def silhouette(self, index: int) -> Silhouette | None:
        """The object's pixels in a frame; None where there are none."""
        return self._silhouettes[index - self.start] if self.start <= index <= self.head else None

    def seconds(self, index: int) -> float:
        """Median time of the last updates up to a frame: a single one may have waited for the machine; 0 for none."""
        recent = self.steps[max(index - self.start + 1 - RECENT, 0) : index - self.start + 1]
        spent = [step.seconds for step in recent if step.seconds]
        return float(np.median(spent)) if spent else 0.0

    def speeds(self) -> list[float]:
        """How far the box's centre moves, px per frame, one value per step; NaN where there is no box."""
        speeds = [float("nan")]
        for before, after in zip(self.steps, self.steps[1:], strict=False):
            if before.box is None or after.box is None:
                speeds.append(float("nan"))
            else:
                (x0, y0), (x1, y1) = before.box.centre, after.box.centre
                speeds.append(float(np.hypot(x1 - x0, y1 - y0)))
        return speeds
