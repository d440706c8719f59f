"""The behaviour of the tracker: in each state, what is done at each event.

A frame is an event. What is done says what has turned out, which is the next event, until the frame is done.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from ..frames import Frame
from . import actions
from .rooms import ROOMS, Rooms
from .track import Track
from .turn import Event, State, Turn, begin

__all__ = ["TABLE", "advance"]

Action = Callable[[Turn], Turn]

_NOT_THE_SCENE: dict[Event, Action] = {
    Event.OTHER: actions.interrupt,
    Event.NOTHING: actions.interrupt,
}

_ANSWERS: dict[Event, Action] = {
    Event.RAN: actions.weigh,
    Event.LOCATED: actions.answer,
    Event.UNLIKELY: actions.reject,
    Event.HIDDEN: actions.miss,
    Event.MISSING: actions.miss,
    Event.PART: actions.answer_part,
    Event.WHOLE: actions.begin_anew,
}

TABLE: Mapping[State, Mapping[Event, Action]] = {
    State.STARTING: {
        Event.SCENE: actions.run_both,
        Event.PLAIN: actions.run_both,
        **_NOT_THE_SCENE,
        Event.LEFT: actions.begin_teaching,
        **_ANSWERS,
    },
    State.TEACHING: {
        Event.SCENE: actions.run_segmentation,
        Event.PLAIN: actions.run_segmentation,
        **_NOT_THE_SCENE,
        Event.FOUND: actions.teach,
        Event.DUE: actions.teach,
        Event.UNSEEN: actions.search,
        **_ANSWERS,
    },
    State.SEGMENTATION: {
        Event.SCENE: actions.run_segmentation,
        Event.PLAIN: actions.run_segmentation,
        **_NOT_THE_SCENE,
        Event.FOUND: actions.ride,
        Event.DUE: actions.ask,
        Event.UNSEEN: actions.search,
        **_ANSWERS,
    },
    State.PATCH_TRACKER: {
        Event.SCENE: actions.run_patch_tracker,
        Event.PLAIN: actions.run_patch_tracker,
        **_NOT_THE_SCENE,
        **_ANSWERS,
    },
    State.LOST: {
        Event.SCENE: actions.redetect,
        Event.PLAIN: actions.redetect,
        **_NOT_THE_SCENE,
    },
    State.INTERRUPTED: {
        Event.SCENE: actions.resume,
        Event.PLAIN: actions.go_on,
        Event.OTHER: actions.resume,
        Event.NOTHING: actions.interrupt,
    },
}
"""What is done in a state at an event; other pairs do not occur."""


def advance(track: Track, frame: Frame, rooms: Rooms = ROOMS) -> Track:
    """Take one frame in.

    Parameters
    ----------
    track : Track
        Left as it is.
    frame : Frame
        Of the same video.
    rooms : Rooms, optional
        The modes, and what looks for lost objects.

    Returns
    -------
    Track
        After the frame.
    """
    turn = begin(track, frame, rooms)
    while turn.event is not Event.DONE:
        turn = TABLE[turn.state][turn.event](turn)
    return turn.track
