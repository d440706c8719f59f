"""One frame on its way through the table."""

from __future__ import annotations

from enum import Enum, auto
from typing import NamedTuple

from ..estimate import Estimate
from ..frames import Frame
from ..overview import Overview, blank, overview, same_scene
from ..patch_tracker import PatchTrackerState
from ..redetection import Redetection
from ..segmentation import SegmentationState
from .choice import Choice
from .rooms import Rooms
from .track import Track
from .tuning import WITNESS_FRAMES

__all__ = ["Event", "State", "Turn", "begin", "first_state"]


class State(Enum):
    """Who is to do what with a frame."""

    STARTING = auto()
    """Both modes run, each being the other's witness; or there is only one."""
    TEACHING = auto()
    """Still the first frames, but the patch tracker stayed with the ground: segmentation leads, and teaches it."""
    SEGMENTATION = auto()
    """Segmentation leads; the patch tracker rides on its box."""
    PATCH_TRACKER = auto()
    """The patch tracker leads; segmentation watches the background."""
    LOST = auto()
    """The object went out of sight, and the scene without it is remembered."""
    INTERRUPTED = auto()
    """The last frames were blank, or of another scene."""


class Event(Enum):
    """What has turned out."""

    # of the frame
    SCENE = auto()
    """It shows the scene that was tracked."""
    PLAIN = auto()
    """So it does, and that shows nothing."""
    OTHER = auto()
    """It shows another scene."""
    NOTHING = auto()
    """It is blank, or nothing was found in it."""
    # of segmentation
    FOUND = auto()
    """It sees the object."""
    DUE = auto()
    """So it does, and the patch tracker is to be asked."""
    UNSEEN = auto()
    """It does not, or what it sees is something else."""
    # of the modes
    LEFT = auto()
    """Both ran, and the patch tracker stays with ground that the object has left."""
    RAN = auto()
    """All that are to run have."""
    # of what they say
    LOCATED = auto()
    """The object is there."""
    UNLIKELY = auto()
    """It is hardly there."""
    HIDDEN = auto()
    """Something is in front of it."""
    MISSING = auto()
    """It is nowhere."""
    PART = auto()
    """So it is for the modes; but a part of it is seen in the whole frame."""
    WHOLE = auto()
    """So it is for the modes; but most of it is seen in the whole frame."""
    DONE = auto()
    """The track is that after the frame."""


class Turn(NamedTuple):
    """One frame, and what is known of it so far.

    Parameters
    ----------
    state : State
    event : Event
    rooms : Rooms
    frame : Frame
    overview : ndarray
        Of the frame.
    same : bool
        It is of the scene that was tracked.
    track : Track
        Before the frame; after it, once the event is DONE.
    redetected : Redetection or None
        What is seen of a lost object in the whole frame.
    segmentation, patch_tracker : SegmentationState, PatchTrackerState, or None
        As they stand now.
    choice : Choice
        As it stands now.
    estimate : Estimate or None
        What is answered, once the modes ran.
    score : float
        Of that, 0–1.
    """

    state: State
    event: Event
    rooms: Rooms
    frame: Frame
    overview: Overview
    same: bool
    track: Track
    redetected: Redetection | None
    segmentation: SegmentationState | None
    patch_tracker: PatchTrackerState | None
    choice: Choice
    estimate: Estimate | None = None
    score: float = 0.0

    @property
    def near(self) -> tuple[float, float] | None:
        """Where a lost object is seen, frame px."""
        return self.redetected.box.centre if self.redetected else None


def begin(track: Track, frame: Frame, rooms: Rooms) -> Turn:
    """State of a track, and the event that a frame is."""
    now = overview(frame)
    same = track.overview is None or same_scene(track.overview, now, track.interrupted + 1)
    if blank(now):
        event = Event.PLAIN if same else Event.NOTHING
    else:
        event = Event.SCENE if same else Event.OTHER
    state = State.INTERRUPTED if track.interrupted else first_state(track)
    return Turn(
        state, event, rooms, frame, now, same, track, None, track.segmentation, track.patch_tracker, track.choice
    )


def first_state(track: Track) -> State:
    """State in which a frame of the scene finds a track."""
    return State.LOST if track.scene else leader(track)


def leader(track: Track) -> State:
    """State of a track whose object is in sight."""
    choice = track.choice
    if track.segmentation is None or track.patch_tracker is None:
        return State.STARTING
    if choice.frames < WITNESS_FRAMES:
        return State.TEACHING if choice.teaching else State.STARTING
    return State.SEGMENTATION if choice.trusted else State.PATCH_TRACKER
