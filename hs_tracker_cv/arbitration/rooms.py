"""What arbitration asks of the rooms that look at pixels. They are injected, so that tests can put others there."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from .. import patch_tracker, redetection, segmentation
from ..frames import Frame
from ..geometry import Box
from ..patch_tracker import PatchTrackerParams, PatchTrackerState
from ..redetection import Redetection, Scene, Target
from ..segmentation import SegmentationParams, SegmentationState

__all__ = ["PATCH_TRACKER", "ROOMS", "SEGMENTATION", "Rooms"]

SEGMENTATION = SegmentationParams()
PATCH_TRACKER = PatchTrackerParams()


class SegmentationRoom(Protocol):
    """As :mod:`hs_tracker_cv.segmentation`."""

    def step(self, state: SegmentationState, frame: Frame, params: SegmentationParams) -> SegmentationState: ...

    def has_left(self, state: SegmentationState, box: Box) -> bool: ...

    def shows_ground(self, state: SegmentationState, box: Box) -> bool: ...

    def watch(
        self, state: SegmentationState, frame: Frame, box: Box, params: SegmentationParams
    ) -> SegmentationState: ...

    def reseed(
        self, state: SegmentationState, frame: Frame, box: Box, params: SegmentationParams
    ) -> SegmentationState: ...

    def relocate(
        self, state: SegmentationState, frame: Frame, gap: int, params: SegmentationParams
    ) -> SegmentationState | None: ...


class PatchTrackerRoom(Protocol):
    """As :mod:`hs_tracker_cv.patch_tracker`."""

    def start(self, frame: Frame, box: Box, params: PatchTrackerParams) -> PatchTrackerState: ...

    def step(
        self,
        state: PatchTrackerState,
        frame: Frame,
        params: PatchTrackerParams,
        *,
        near: tuple[float, float] | None = None,
    ) -> PatchTrackerState: ...

    def seek(self, state: PatchTrackerState, frame: Frame, params: PatchTrackerParams) -> PatchTrackerState: ...

    def ride(self, state: PatchTrackerState, box: Box) -> PatchTrackerState: ...

    def teach(
        self, state: PatchTrackerState, frame: Frame, box: Box, params: PatchTrackerParams
    ) -> PatchTrackerState: ...

    def turned(self, state: PatchTrackerState, angle: float) -> PatchTrackerState: ...

    def dismiss(self, before: PatchTrackerState, after: PatchTrackerState) -> PatchTrackerState: ...


class RedetectionRoom(Protocol):
    """As :mod:`hs_tracker_cv.redetection`."""

    def target_of(self, state: SegmentationState, known: Target | None) -> Target | None: ...

    def scene_without(self, frame: Frame, target: Target) -> Scene | None: ...

    def find(self, scene: Scene, frame: Frame) -> Redetection | None: ...

    def is_foreign(self, scene: Scene, frame: Frame, box: Box) -> bool: ...


class Rooms(NamedTuple):
    """The rooms at work."""

    segmentation: SegmentationRoom
    patch_tracker: PatchTrackerRoom
    redetection: RedetectionRoom


ROOMS = Rooms(segmentation, patch_tracker, redetection)
