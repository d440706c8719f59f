"""The table of arbitration, in every state at every event, with modes that see nothing but say what they are told."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from hs_tracker_cv import Box, TrackerHS_Params, patch_tracker, segmentation
from hs_tracker_cv.arbitration import Choice, Track, advance, start
from hs_tracker_cv.arbitration.rooms import Rooms
from hs_tracker_cv.arbitration.table import TABLE
from hs_tracker_cv.arbitration.tuning import ASK_EVERY, SIGHTED, SURE, WITNESS_FRAMES
from hs_tracker_cv.arbitration.turn import Event, State, Turn, begin
from hs_tracker_cv.frames import Frame, as_frame
from hs_tracker_cv.redetection import Redetection

HERE, THERE = Box(40.0, 30.0, 20.0, 16.0), Box(80.0, 60.0, 20.0, 16.0)
OUTSIDE = Box(400.0, 300.0, 20.0, 16.0)
OF_FRAMES = (Event.SCENE, Event.PLAIN, Event.OTHER, Event.NOTHING)
OF_ANSWERS = (
    Event.RAN,
    Event.LOCATED,
    Event.UNLIKELY,
    Event.HIDDEN,
    Event.MISSING,
    Event.PART,
    Event.WHOLE,
)


@dataclass
class Stub:
    """All three rooms at once: they write down that they were asked, and answer what the test says."""

    segment: Box = HERE
    segment_ok: bool = True
    segment_score: float = 0.95
    occluded: bool = False
    carried: Box = HERE
    carried_ok: bool = True
    carried_score: float = 0.95
    left: bool = False
    ground: bool = False
    relocated: bool = False
    redetected: Redetection | None = None
    foreign: bool = False
    asked: list[str] = field(default_factory=list)

    def _segmented(self, state: Any, name: str, box: Box, **changes: Any) -> Any:
        self.asked.append(name)
        return state.replace(estimate=state.estimate.replace(box=box, **changes), count=state.count + 1)

    def has_left(self, state: Any, box: Box) -> bool:
        """What the test says."""
        self.asked.append("left")
        return self.left

    def shows_ground(self, state: Any, box: Box) -> bool:
        """What the test says."""
        return self.ground

    def watch(self, state: Any, frame: Frame, box: Box, params: Any) -> Any:
        """Learn the background."""
        return self._segmented(state, "watch", box, ok=True, score=0.9)

    def reseed(self, state: Any, frame: Frame, box: Box, params: Any) -> Any:
        """Begin anew."""
        return self._segmented(state, "reseed", box, ok=True, score=1.0)

    def relocate(self, state: Any, frame: Frame, gap: int, params: Any) -> Any:
        """Find the layer, if the test says so."""
        found = self._segmented(state, "relocate", self.segment, ok=True)
        return found if self.relocated else None

    def _carried(self, state: Any, name: str, **changes: Any) -> Any:
        self.asked.append(name)
        return state._replace(estimate=state.estimate.replace(**changes))

    def seek(self, state: Any, frame: Frame, params: Any) -> Any:
        """Look everywhere."""
        return self._carried(state, "seek", box=self.carried, ok=self.carried_ok, score=self.carried_score)

    def ride(self, state: Any, box: Box) -> Any:
        """Take a box over."""
        return self._carried(state, "ride", box=box, ok=True)

    def start(self, frame: Frame, box: Box, params: Any) -> Any:
        """Begin anew."""
        self.asked.append("start")
        return patch_tracker.start(frame, box, params)

    def teach(self, state: Any, frame: Frame, box: Box, params: Any) -> Any:
        """Take a box over, and learn it."""
        return self._carried(state, "teach", box=box, ok=True)

    def dismiss(self, before: Any, after: Any) -> Any:
        """Still lost."""
        return self._carried(after, "dismiss", ok=False, score=0.0)

    def turned(self, state: Any, angle: float) -> Any:
        """As it is."""
        return state

    def target_of(self, state: Any, known: Any) -> Any:
        """Any."""
        return known or "target"

    def scene_without(self, frame: Frame, target: Any) -> Any:
        """Any."""
        self.asked.append("scene")
        return "scene"

    def find(self, scene: Any, frame: Frame) -> Redetection | None:
        """What the test says."""
        self.asked.append("redetect")
        return self.redetected

    def is_foreign(self, scene: Any, frame: Frame, box: Box) -> bool:
        """What the test says."""
        return self.foreign

    @property
    def rooms(self) -> Rooms:
        """The stub three times; the two modes have a `step` each."""
        mode = _Segmentation(self), _PatchTracker(self)
        return Rooms(*mode, self)  # type: ignore[arg-type]


class _Room:
    def __init__(self, stub: Stub) -> None:
        self.stub = stub

    def __getattr__(self, name: str) -> Any:
        return getattr(self.stub, name)


class _Segmentation(_Room):
    def step(self, state: Any, frame: Frame, params: Any) -> Any:
        told = self.stub
        return told._segmented(
            state, "segment", told.segment, ok=told.segment_ok, score=told.segment_score, occluded=told.occluded
        )


class _PatchTracker(_Room):
    def step(self, state: Any, frame: Frame, params: Any, *, near: Any = None) -> Any:
        told = self.stub
        return told._carried(state, "carry", box=told.carried, ok=told.carried_ok, score=told.carried_score)


@pytest.fixture(scope="module")
def image() -> np.ndarray[Any, Any]:
    """A scene with structure in the whole frame."""
    rough = np.random.default_rng(3).integers(40, 215, (12, 16, 3), dtype=np.uint8)
    return np.ascontiguousarray(rough.repeat(10, 0).repeat(10, 1))


@pytest.fixture
def frame(image: np.ndarray[Any, Any]) -> Frame:
    """The scene."""
    return as_frame(image)


@pytest.fixture(scope="module")
def young(image: np.ndarray[Any, Any]) -> Track:
    """A track right after its start."""
    return replace(start(as_frame(image), HERE, TrackerHS_Params()), first=None)


def track_in(young: Track, state: State) -> Track:
    """A track that a frame of the scene finds in a state."""
    if state is State.STARTING:
        return young
    if state is State.TEACHING:
        return replace(young, choice=Choice(frames=9, log_unexplained=-3.5, since=9).with_pupil, target="target")
    choice = Choice(frames=WITNESS_FRAMES, log_unexplained=-3.5, since=1, agreement=0.8)
    old = replace(young, choice=choice, target="target")
    if state is State.PATCH_TRACKER:
        return replace(old, choice=replace(choice, trusted=False, log_unexplained=0.0))
    if state is State.LOST:
        return replace(lost(old), scene="scene")
    return replace(lost(old), interrupted=3) if state is State.INTERRUPTED else old


def lost(track: Track) -> Track:
    """The same track, the object being lost by both modes."""
    assert track.segmentation is not None
    assert track.patch_tracker is not None
    return replace(
        track,
        state="lost",
        segmentation=track.segmentation.replace(estimate=track.segmentation.estimate.replace(ok=False), count=9),
        patch_tracker=track.patch_tracker._replace(estimate=track.patch_tracker.estimate.replace(ok=False)),
    )


def turn_in(young: Track, frame: Frame, state: State, event: Event, stub: Stub) -> Turn:
    """A frame on its way, at an event in a state; the modes have said what the stub says."""
    track = track_in(young, state)
    turn = begin(track, frame, stub.rooms)._replace(event=event, redetected=stub.redetected)
    if event not in OF_FRAMES:
        segmented = _Segmentation(stub).step(turn.segmentation, frame, None)
        carried = _PatchTracker(stub).step(turn.patch_tracker, frame, None)
        turn = turn._replace(segmentation=segmented, patch_tracker=carried, estimate=segmented.estimate, score=0.9)
        turn = turn._replace(choice=replace(turn.choice, log_unexplained=-3.5))
        stub.asked.clear()
    return turn


EXPECTED: dict[tuple[State, Event], tuple[Event, list[str]]] = {
    # state, event: what turns out, and who is asked for it
    (State.STARTING, Event.SCENE): (Event.RAN, ["segment", "carry"]),
    (State.STARTING, Event.LEFT): (Event.RAN, ["start"]),
    (State.TEACHING, Event.SCENE): (Event.FOUND, ["segment"]),
    (State.TEACHING, Event.FOUND): (Event.RAN, ["teach"]),
    (State.TEACHING, Event.DUE): (Event.RAN, ["teach"]),
    (State.TEACHING, Event.UNSEEN): (Event.RAN, ["carry"]),
    (State.SEGMENTATION, Event.SCENE): (Event.FOUND, ["segment"]),
    (State.SEGMENTATION, Event.FOUND): (Event.RAN, ["ride"]),
    (State.SEGMENTATION, Event.DUE): (Event.RAN, ["carry", "ride"]),
    (State.SEGMENTATION, Event.UNSEEN): (Event.RAN, ["carry"]),
    (State.PATCH_TRACKER, Event.SCENE): (Event.RAN, ["carry"]),
    (State.LOST, Event.SCENE): (Event.SCENE, ["redetect"]),
    (State.INTERRUPTED, Event.SCENE): (Event.DONE, ["seek", "reseed"]),
    (State.INTERRUPTED, Event.OTHER): (Event.DONE, ["seek", "reseed"]),
}
_LEADERS = (State.STARTING, State.TEACHING, State.SEGMENTATION, State.PATCH_TRACKER)
for _state in (*_LEADERS, State.LOST):
    EXPECTED[_state, Event.PLAIN] = EXPECTED[_state, Event.SCENE]
    EXPECTED[_state, Event.OTHER] = EXPECTED[_state, Event.NOTHING] = (Event.DONE, [])
EXPECTED[State.INTERRUPTED, Event.PLAIN] = (Event.SCENE, [])
EXPECTED[State.INTERRUPTED, Event.NOTHING] = (Event.DONE, [])
for _state in _LEADERS:
    EXPECTED[_state, Event.RAN] = (Event.LOCATED, [])
    EXPECTED[_state, Event.LOCATED] = (Event.DONE, [])
    for _event in (Event.UNLIKELY, Event.HIDDEN, Event.MISSING, Event.PART):
        EXPECTED[_state, _event] = (Event.DONE, ["scene"])
    EXPECTED[_state, Event.WHOLE] = (Event.DONE, ["reseed", "ride"])


def test_the_table_has_the_rows_that_are_expected() -> None:
    """No pair of state and event is missing here, or there."""
    assert {(state, event) for state, row in TABLE.items() for event in row} == set(EXPECTED)
    assert set(TABLE) == set(State)
    assert {event for row in TABLE.values() for event in row} == set(Event) - {Event.DONE}


@pytest.mark.parametrize(("state", "event"), EXPECTED, ids=lambda value: value.name)
def test_every_state_at_every_event(young: Track, frame: Frame, state: State, event: Event) -> None:
    """What is done asks these rooms and no others, leads to this event, and leaves the track before as it was."""
    stub = Stub(redetected=Redetection(THERE, 0.9))
    turn = turn_in(young, frame, state, event, stub)
    if state is State.INTERRUPTED:
        assert turn.state is state
    before = turn.track
    after = TABLE[state][event](turn._replace(state=state))
    assert (after.event, stub.asked) == EXPECTED[state, event]
    assert (after.track is before) == (after.event is not Event.DONE)


ANSWERS: list[tuple[Event, str, Box, float | None, bool]] = [
    # event, state answered, box, score, whether the scene is remembered
    (Event.LOCATED, "tracking", HERE, 0.9, False),
    (Event.UNLIKELY, "lost", HERE, 0.9, True),
    (Event.HIDDEN, "occluded", HERE, 0.9, True),
    (Event.MISSING, "lost", HERE, 0.9, True),
    (Event.PART, "tracking", THERE, SIGHTED, True),
    (Event.WHOLE, "tracking", THERE, SURE, False),
]


@pytest.mark.parametrize("leader", _LEADERS, ids=lambda s: s.name)
@pytest.mark.parametrize(("event", "state", "box", "score", "scene"), ANSWERS, ids=lambda v: getattr(v, "name", None))
def test_what_is_answered(
    young: Track, frame: Frame, leader: State, event: Event, state: str, box: Box, score: float, scene: bool
) -> None:
    """Each outcome has one answer, whoever leads."""
    turn = turn_in(young, frame, leader, event, Stub(redetected=Redetection(THERE, 0.5)))
    after = TABLE[leader][event](turn).track
    assert (after.state, after.box, after.score, after.scene is not None) == (state, box, score, scene)


@pytest.mark.parametrize(
    ("told", "event"),
    [
        ({}, Event.LOCATED),
        ({"segment_score": 0.05, "carried_score": 0.05}, Event.UNLIKELY),
        ({"segment": OUTSIDE, "carried": OUTSIDE}, Event.MISSING),
        ({"segment_ok": False, "carried_ok": False}, Event.MISSING),
        ({"segment_ok": False, "carried_ok": False, "occluded": True}, Event.HIDDEN),
        ({"segment_ok": False, "carried_ok": False, "redetected": Redetection(THERE, 0.5)}, Event.PART),
        ({"segment_ok": False, "carried_ok": False, "redetected": Redetection(THERE, 0.9)}, Event.WHOLE),
        ({"segment_ok": False}, Event.LOCATED),  # the patch tracker is sure
        ({"segment_ok": False, "carried_score": 0.85}, Event.MISSING),  # it is not
    ],
)
def test_what_turns_out_of_what_the_modes_say(young: Track, frame: Frame, told: dict[str, Any], event: Event) -> None:
    """While segmentation leads."""
    turn = turn_in(young, frame, State.SEGMENTATION, Event.RAN, Stub(**told))
    assert TABLE[State.SEGMENTATION][Event.RAN](turn._replace(choice=turn.choice.asked(0.5, 0.6))).event is event


def test_the_patch_tracker_is_asked_in_every_eighth_frame(young: Track, frame: Frame) -> None:
    """In the others it rides."""
    track, stub = track_in(young, State.SEGMENTATION), Stub()
    asked = []
    for _ in range(3 * ASK_EVERY):
        stub.asked.clear()
        track = advance(track, frame, stub.rooms)
        asked.append("carry" in stub.asked)
    assert sum(asked) == 3
    assert np.diff(np.flatnonzero(asked)).tolist() == [ASK_EVERY] * 2


@pytest.mark.parametrize(
    ("carried", "score", "hidden", "kept"),
    [
        (HERE, 0.9, False, True),
        (HERE, 0.9, True, False),  # what is before the object is not learned
        (HERE, 0.5, False, False),  # it is not sure
        (HERE.moved(2.0, 0.0), 0.9, False, False),  # it is elsewhere
    ],
)
def test_what_is_learned_is_kept_where_both_agree(
    young: Track, frame: Frame, carried: Box, score: float, hidden: bool, kept: bool
) -> None:
    """The stub's lessons are its estimates: the score of the step is that of the patch tracker which goes on."""
    track = track_in(young, State.SEGMENTATION)
    track = replace(track, choice=replace(track.choice, since=0))
    after = advance(track, frame, Stub(carried=carried, carried_score=score, occluded=hidden).rooms)
    assert after.patch_tracker is not None
    assert track.patch_tracker is not None
    before = track.patch_tracker.estimate.score
    assert after.patch_tracker.estimate.score == (score if kept else before) != (before if kept else score)


def test_a_segment_that_is_contradicted_is_left(young: Track, frame: Frame) -> None:
    """A patch tracker that is likely right and elsewhere leads from that frame on."""
    track, stub = track_in(young, State.SEGMENTATION), Stub(carried=THERE)
    track = replace(track, choice=replace(track.choice, since=0))
    after = advance(track, frame, stub.rooms)
    assert not after.choice.trusted
    assert after.box == THERE
    assert "segment" not in calls(after, frame, stub)


@pytest.mark.parametrize("left", [True, False])
def test_a_patch_tracker_that_stays_with_the_ground_is_taught(young: Track, frame: Frame, left: bool) -> None:
    """Once the object has left its box, segmentation leads it to the end of the start; otherwise both go on alone."""
    stub, track = Stub(segment=THERE, left=left), young
    assert calls(track, frame, stub) == ["segment", "carry", "left", *(["start"] if left else [])]
    asked = []
    for _ in range(4):
        track = advance(track, frame, stub.rooms)
        asked.append(calls(track, frame, stub))
    assert asked[:3] == [["segment", "teach"] if left else ["segment", "carry", "left"]] * 3
    assert (track.box, track.choice.teaching) == (THERE, left)


def test_what_the_pupil_says_is_no_measurement(young: Track, frame: Frame) -> None:
    """The size of a box that was put on the segment says nothing of the segment's."""
    track = track_in(young, State.TEACHING)
    after = advance(track, frame, Stub().rooms)
    assert after.choice.frames == track.choice.frames + 1
    assert after.choice.witnessed == 0


def test_the_background_is_watched_in_every_second_frame(young: Track, frame: Frame) -> None:
    """While the patch tracker leads."""
    track, stub = track_in(young, State.PATCH_TRACKER), Stub()
    watched = []
    for _ in range(6):
        track = replace(track, choice=replace(track.choice, log_unexplained=0.0))
        stub.asked.clear()
        track = advance(track, frame, stub.rooms)
        watched.append("watch" in stub.asked)
    assert watched in ([False, True] * 3, [True, False] * 3)


def test_a_lost_object_is_found_by_the_patch_tracker(young: Track, frame: Frame) -> None:
    """Segmentation begins anew there and is not trusted; something else is dismissed."""
    track = track_in(young, State.LOST)
    found = Stub(segment_ok=False, carried=THERE)
    after = advance(track, frame, found.rooms)
    assert found.asked == ["redetect", "segment", "relocate", "carry", "reseed"]
    assert (after.state, after.box, after.choice.trusted) == ("tracking", THERE, False)
    other = Stub(segment_ok=False, carried=THERE, foreign=True)
    after = advance(track, frame, other.rooms)
    assert other.asked == ["redetect", "segment", "relocate", "carry", "dismiss"]
    assert after.state == "lost"


@pytest.mark.parametrize("state", [State.STARTING, State.SEGMENTATION], ids=lambda s: s.name)
@pytest.mark.parametrize("ground", [True, False])
def test_a_box_that_shows_ground_is_no_object(young: Track, frame: Frame, state: State, ground: bool) -> None:
    """The object has vanished before a ground that segmentation knows: the patch tracker does not learn that."""
    track, stub = track_in(young, state), Stub(segment_ok=False, ground=ground)
    track = replace(track, choice=replace(track.choice, log_unexplained=-3.5))
    assert ("dismiss" in calls(track, frame, stub)) is ground
    assert (advance(track, frame, stub.rooms).state == "lost") is ground


def test_a_segmentation_that_is_doubted_refutes_nothing(young: Track, frame: Frame) -> None:
    """What it takes for ground may be the object."""
    track, stub = track_in(young, State.STARTING), Stub(segment_ok=False, ground=True)
    doubted = replace(track, choice=Choice(frames=9, log_unexplained=0.0, size_difference=1.0))
    assert doubted.choice.doubt > 0.0
    assert "dismiss" not in calls(doubted, frame, stub)


def test_what_is_seen_of_a_lost_object_elsewhere_refutes_a_segment(young: Track, frame: Frame) -> None:
    """The whole of it is seen there: what segmentation says of another place is not believed."""
    stub = Stub(redetected=Redetection(THERE, 0.9), carried_ok=False)
    after = advance(track_in(young, State.LOST), frame, stub.rooms)
    assert (after.state, after.box) == ("tracking", THERE)


def test_an_interruption_is_waited_for_and_ends_where_the_object_is_found(
    young: Track, frame: Frame, image: np.ndarray[Any, Any]
) -> None:
    """Blank frames ask nobody; the first frame of the scene asks for the layer, then for the patch tracker."""
    track, stub = track_in(young, State.SEGMENTATION), Stub()
    black = as_frame(np.zeros_like(image))
    for count in (1, 2, 3):
        track = advance(track, black, stub.rooms)
        assert (track.state, track.interrupted, track.score) == ("lost", count, 0.0)
    assert stub.asked == []
    found = Stub(relocated=True, segment=THERE)
    after = advance(track, frame, found.rooms)
    assert found.asked == ["relocate", "ride"]
    assert (after.state, after.box, after.interrupted, after.choice.trusted) == ("tracking", THERE, 0, True)
    sought = Stub(carried=THERE)
    after = advance(track, frame, sought.rooms)
    assert sought.asked == ["relocate", "seek", "reseed"]
    assert (after.state, after.box, after.interrupted, after.choice.trusted) == ("tracking", THERE, 0, False)
    unsure = Stub(carried=THERE, carried_score=0.5)
    after = advance(track, frame, unsure.rooms)
    assert unsure.asked[:3] == ["relocate", "seek", "segment"]
    assert after.interrupted == 0


def calls(track: Track, frame: Frame, stub: Stub) -> list[str]:
    """Who is asked in the next frame."""
    stub.asked.clear()
    advance(track, frame, stub.rooms)
    return list(stub.asked)


@pytest.mark.parametrize(("mode", "asked"), [("segmentation", ["segment"]), ("patch_tracker", ["carry"])])
def test_a_single_mode_is_asked_alone(frame: Frame, mode: Any, asked: list[str]) -> None:
    """From start to loss: no other mode, no hand-over, no search of the whole frame."""
    stub = Stub()
    track = replace(start(frame, HERE, TrackerHS_Params(mode=mode)), first=None)
    for _ in range(WITNESS_FRAMES + 2):
        stub.asked.clear()
        track = advance(track, frame, stub.rooms)
        assert stub.asked == asked
    stub.segment_ok = stub.carried_ok = False
    track = advance(track, frame, stub.rooms)
    assert (track.state, track.scene) == ("lost", None)


def test_the_modes_are_what_arbitration_asks_for() -> None:
    """The stubs have what the rooms have."""
    for name in ("step", "has_left", "watch", "reseed", "relocate"):
        assert callable(getattr(segmentation, name))
    for name in ("start", "step", "seek", "ride", "teach", "turned", "dismiss"):
        assert callable(getattr(patch_tracker, name))
