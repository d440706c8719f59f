"""The two-layer model: the object's motion and the background's as two hypotheses per pixel.

A mask of the object is carried from frame to frame by the flow; a memory of the background says what has changed.
Everything is a pure function from one frozen state to the next.
"""

from __future__ import annotations

from .departure import has_left, shows_ground
from .relocation import relocate
from .state import SegmentationEstimate, SegmentationParams, SegmentationState
from .tracking import belongs, reseed, start, step, watch

__all__ = [
    "SegmentationEstimate",
    "SegmentationParams",
    "SegmentationState",
    "belongs",
    "has_left",
    "relocate",
    "reseed",
    "shows_ground",
    "start",
    "step",
    "watch",
]
