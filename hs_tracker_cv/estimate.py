"""What a mode says after each frame: the one result that arbitration and the panels know."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .geometry import Box

__all__ = ["Estimate"]

_Self = TypeVar("_Self", bound="Estimate")


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """Where the object is in one frame, and the evidence for it.

    A mode adds the measurements that only it has in a subclass.

    Parameters
    ----------
    box : Box
        Sub-pixel, frame px; where nothing is seen, what is believed of it.
    ok : bool
        The object is located in this frame.
    score : float
        Chance that the box overlaps the object by more than half, 0–1.
    occluded : bool
        Something is in front of it.
    window : Box
        Part of the frame that was worked on, frame px.
    step : float
        Frame px per window pixel.
    previous, current : ndarray, shape (h, w), float32
        Windows the flow was computed on.
    flow : ndarray, shape (h, w, 2), float32
        Window px per frame.
    mask : ndarray, shape (h, w), uint8, or None
        Object pixels of the window; None where the mode has none.
    """

    box: Box
    ok: bool
    score: float
    occluded: bool
    window: Box
    step: float
    previous: NDArray[np.float32]
    current: NDArray[np.float32]
    flow: NDArray[np.float32]
    mask: NDArray[np.uint8] | None

    @property
    def lost(self) -> bool:
        """The object is not located."""
        return not self.ok

    @property
    def grays(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """`previous` and `current` as gray levels, 0–255."""
        return self.previous, self.current

    def replace(self: _Self, **changes: Any) -> _Self:
        """Return a copy with some fields changed."""
        # several times as fast as dataclasses.replace, which asks for each field by name
        copy = object.__new__(type(self))
        copy.__dict__.update(self.__dict__, **changes)
        return copy
