"""All that is known of a target between two frames."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray

from .. import patch_tracker, segmentation
from ..estimate import Estimate
from ..frames import Frame, VideoFormat
from ..geometry import Box
from ..overview import Overview, overview
from ..params import TrackerHS_Params
from ..patch_tracker import PatchTrackerParams, PatchTrackerState
from ..patch_tracker.patches import COLOURS, GRAYS
from ..redetection import Scene, Target
from ..segmentation import SegmentationState
from ..validation import Count, Shape
from . import rooms
from .choice import Choice

__all__ = ["FirstFrame", "Track", "TrackerState", "leading", "start"]

TrackerState = Literal["uninitialised", "tracking", "occluded", "lost"]

_FIRST_MARGIN = 16
"""Margin round the box, px, in which a frame must repeat the first one bit by bit to count as the same frame."""


@dataclass(frozen=True)
class FirstFrame:
    """The part of the first frame round the box: OpenCV's own sample gives that frame to `update` too."""

    x0: Count
    y0: Count
    pixels: Annotated[NDArray[Any], Shape("first h", "first w", "channels")]

    @classmethod
    def of(cls, frame: Frame, box: Box) -> FirstFrame:
        """The part of a frame round a box."""
        window = box.grown(_FIRST_MARGIN).clip(frame.width, frame.height)
        x0, y0 = int(window.x), int(window.y)
        part = frame.pixels[y0 : int(window.bottom) + 1, x0 : int(window.right) + 1]
        # In the byte order in which a pickle gives it back.
        return cls(x0, y0, part.astype(frame.format.dtype))

    def is_repeated(self, frame: Frame) -> bool:
        """Tell whether a frame is the first one again."""
        height, width = self.pixels.shape[:2]
        part = frame.pixels[self.y0 : self.y0 + height, self.x0 : self.x0 + width]
        return frame.format.dtype == self.pixels.dtype and np.array_equal(part, self.pixels)


@dataclass(frozen=True)
class Track:
    """All that is known of the target after one frame.

    Parameters
    ----------
    video : VideoFormat
    segmentation, patch_tracker : SegmentationState, PatchTrackerState, or None
        The modes at work.
    choice : Choice
        Which of them leads.
    box : Box
        The answer, frame px; where the object was last, while it is lost.
    options : PatchTrackerParams
    first : FirstFrame or None
        None after the first frame that does not repeat it.
    score : float
    state : str
    target : Target or None
        What the object is known by.
    scene : Scene or None
        While it is out of sight: the scene without it.
    overview : ndarray or None
        Of the last frame of the scene.
    interrupted : int
        Frames since then that were blank or of another scene.
    """

    video: VideoFormat
    segmentation: SegmentationState | None
    patch_tracker: PatchTrackerState | None
    choice: Choice
    box: Box
    options: PatchTrackerParams
    first: FirstFrame | None = None
    score: float = 1.0
    state: TrackerState = "tracking"
    target: Target | None = None
    scene: Scene | None = None
    overview: Overview | None = None
    interrupted: Count = 0

    @property
    def leading(self) -> Estimate:
        """What the mode that leads says."""
        return leading(self.segmentation, self.patch_tracker, self.choice)

    def follows(self, parameters: TrackerHS_Params) -> bool:
        """Tell whether a tracker of these parameters may have such a track."""
        at_work = (self.segmentation is not None, self.patch_tracker is not None)
        if self.options != _options(parameters) or at_work != _modes(parameters):
            return False
        size = self.video.width, self.video.height
        if self.segmentation and not segmentation.belongs(self.segmentation, *size, rooms.SEGMENTATION):
            return False
        return self.patch_tracker is None or patch_tracker.belongs(self.patch_tracker, *size, self.options)

    def named_lengths(self) -> dict[str, int]:
        """Lengths of arrays that follow from the kind of frame, by name."""
        known = {"channels": self.video.channels, "bins": GRAYS if self.video.channels == 1 else COLOURS}
        return known | (self.scene.lengths(self.video) if self.scene else {})


def start(frame: Frame, box: Box, parameters: TrackerHS_Params) -> Track:
    """Begin with the object in a box of the first frame."""
    segmenting, carrying = _modes(parameters)
    options = _options(parameters)
    return Track(
        video=frame.format,
        segmentation=segmentation.start(frame, box, rooms.SEGMENTATION) if segmenting else None,
        patch_tracker=patch_tracker.start(frame, box, options) if carrying else None,
        choice=Choice(trusted=segmenting),
        box=box,
        options=options,
        first=FirstFrame.of(frame, box),
        overview=overview(frame),
    )


def leading(segmented: SegmentationState | None, carried: PatchTrackerState | None, choice: Choice) -> Estimate:
    """What the mode that leads says."""
    if segmented and (choice.trusted or carried is None):
        return segmented.estimate
    assert carried is not None, "at least one mode is at work"
    return carried.estimate


def _options(parameters: TrackerHS_Params) -> PatchTrackerParams:
    return replace(rooms.PATCH_TRACKER, rotation=True) if parameters.rotation else rooms.PATCH_TRACKER


def _modes(parameters: TrackerHS_Params) -> tuple[bool, bool]:
    """Whether segmentation is at work, and the patch tracker."""
    return parameters.mode != "patch_tracker", parameters.mode != "segmentation"
