"""What the table names: each takes a frame one step further, and says what has turned out."""

from __future__ import annotations

from dataclasses import replace

from ..estimate import Estimate
from ..frames import Frame
from ..geometry import Box, iou
from ..patch_tracker import PatchTrackerState
from ..redetection import Scene, Target
from ..segmentation import SegmentationState
from . import rooms, tuning
from .choice import Choice, agreement, size_difference, updated
from .steadiness import Steadiness, growth
from .track import Track, TrackerState, leading
from .turn import Event, Turn, first_state, leader

__all__ = [
    "answer",
    "answer_part",
    "ask",
    "begin_anew",
    "begin_teaching",
    "go_on",
    "interrupt",
    "miss",
    "redetect",
    "reject",
    "resume",
    "ride",
    "run_both",
    "run_patch_tracker",
    "run_segmentation",
    "search",
    "teach",
    "weigh",
]

# Of the frame.


def interrupt(turn: Turn) -> Turn:
    """The frame is none of the scene: nothing is learned from it."""
    before = turn.track
    return _done(turn, replace(before, first=None, score=0.0, state="lost", interrupted=before.interrupted + 1))


def resume(turn: Turn) -> Turn:
    """After an interruption: find the object by its layer, where it may have gone meanwhile, or by the patch tracker.

    The latter has to be sure: it also looks where the scene is not the same, since the camera may have been moved.
    """
    relocated = _relocated(turn)
    if relocated:
        return _done(turn, relocated)
    sought = _sought(turn)
    if not sought.interrupted:
        return _done(turn, sought)
    turn = turn._replace(track=sought)
    return go_on(turn) if turn.same else turn._replace(event=Event.NOTHING)


def go_on(turn: Turn) -> Turn:
    """As if there had been no interruption."""
    track = turn.track
    return turn._replace(
        state=first_state(track),
        event=Event.SCENE,
        segmentation=track.segmentation,
        patch_tracker=track.patch_tracker,
        choice=track.choice,
    )


def redetect(turn: Turn) -> Turn:
    """Search the whole frame for the lost object, before the modes search where they expect it."""
    assert turn.track.scene is not None, "the state LOST has a scene"
    found = turn.rooms.redetection.find(turn.track.scene, turn.frame)
    return turn._replace(redetected=found, state=leader(turn.track), event=Event.SCENE)


# Of the modes.


def run_both(turn: Turn) -> Turn:
    """Run each mode that is at work, and compare what they say."""
    segmented, carried, choice = turn.segmentation, turn.patch_tracker, turn.choice
    if segmented:
        segmented = _segmented(turn, segmented)
    if carried:
        if segmented and segmented.estimate.ok:
            carried = turn.rooms.patch_tracker.turned(carried, segmented.turn)
        stepped = turn.rooms.patch_tracker.step(carried, turn.frame, turn.track.options, near=turn.near)
        ground = segmented is not None and _shows_ground(turn, segmented, stepped.estimate)
        carried = turn.rooms.patch_tracker.dismiss(carried, stepped) if ground else stepped
    left = False
    if segmented and carried:
        choice = choice.asked(carried.estimate.score, agreement(segmented.estimate.box, carried.estimate.box))
        left = _has_left(turn, choice, segmented, carried.estimate.box)
    event = Event.LEFT if left else Event.RAN
    return turn._replace(segmentation=segmented, patch_tracker=carried, choice=choice, event=event)


def begin_teaching(turn: Turn) -> Turn:
    """Begin the patch tracker anew where segmentation sees the object."""
    segmented, _ = _both(turn)
    carried = turn.rooms.patch_tracker.start(turn.frame, segmented.estimate.box, turn.track.options)
    return turn._replace(patch_tracker=carried, choice=turn.choice.with_pupil, event=Event.RAN)


def teach(turn: Turn) -> Turn:
    """Show the patch tracker where segmentation sees the object: over other ground in every frame."""
    segmented, carried = _both(turn)
    carried = turn.rooms.patch_tracker.teach(carried, turn.frame, segmented.estimate.box, turn.track.options)
    return turn._replace(patch_tracker=carried, event=Event.RAN)


def run_segmentation(turn: Turn) -> Turn:
    """Run segmentation; what it finds again after a loss must not be known to be something else."""
    assert turn.segmentation is not None, "segmentation leads"
    segmented = _segmented(turn, turn.segmentation)
    if segmented.estimate.ok and not _is_consistent(turn, segmented.estimate.box):
        segmented = segmented.replace(estimate=segmented.estimate.replace(ok=False, score=0.0))
    if not segmented.estimate.ok:
        event = Event.UNSEEN
    else:
        event = Event.FOUND if turn.choice.since % tuning.ASK_EVERY else Event.DUE
    return turn._replace(segmentation=segmented, event=event)


def ride(turn: Turn) -> Turn:
    """Put the patch tracker on the segment."""
    segmented, carried = _both(turn)
    carried = turn.rooms.patch_tracker.turned(carried, segmented.turn)
    carried = turn.rooms.patch_tracker.ride(carried, segmented.estimate.box)
    return turn._replace(patch_tracker=carried, event=Event.RAN)


def ask(turn: Turn) -> Turn:
    """Ask the patch tracker where it would be on its own; where it contradicts the segment, it leads from now on.

    Where it confirms the segment of an object that nothing hides, what it has learned there is kept: it stays
    acquainted with what changes.
    """
    segmented, carried = _both(turn)
    carried = turn.rooms.patch_tracker.turned(carried, segmented.turn)
    asked = turn.rooms.patch_tracker.step(carried, turn.frame, turn.track.options)
    box, seen = segmented.estimate.box, asked.estimate
    difference = size_difference(box, seen.box) if _is_witness(turn.choice, asked) else None
    choice = turn.choice.asked(seen.score, agreement(box, seen.box), difference)
    if choice.contradicted:
        return turn._replace(patch_tracker=asked, choice=choice.carried_away, event=Event.RAN)
    known = asked if choice.confirmed and not segmented.estimate.occluded else carried
    return turn._replace(patch_tracker=turn.rooms.patch_tracker.ride(known, box), choice=choice, event=Event.RAN)


def search(turn: Turn) -> Turn:
    """Segmentation waits where the object was last; the patch tracker knows what it looks like and searches around.

    Where that finds it, segmentation begins anew, and has to earn its trust as after `init`.
    """
    segmented, carried = _both(turn)
    found = turn.rooms.patch_tracker.step(carried, turn.frame, turn.track.options, near=turn.near)
    foreign = found.estimate.ok and not _is_consistent(turn, found.estimate.box)
    if foreign or _shows_ground(turn, segmented, found.estimate):
        found = turn.rooms.patch_tracker.dismiss(carried, found)
    elif found.estimate.ok and carried.estimate.lost:
        segmented = turn.rooms.segmentation.reseed(segmented, turn.frame, found.estimate.box, rooms.SEGMENTATION)
        return turn._replace(
            segmentation=segmented, patch_tracker=found, choice=Choice(trusted=False), event=Event.RAN
        )
    return turn._replace(patch_tracker=found, event=Event.RAN)


def run_patch_tracker(turn: Turn) -> Turn:
    """Run the patch tracker; every second frame segmentation learns the background round its box.

    That keeps segmentation ready, and is what trust in it is measured on.
    """
    segmented, carried = _both(turn)
    carried = turn.rooms.patch_tracker.step(carried, turn.frame, turn.track.options, near=turn.near)
    if turn.choice.since % tuning.WATCH_EVERY == 0:
        segmented = turn.rooms.segmentation.watch(segmented, turn.frame, carried.estimate.box, rooms.SEGMENTATION)
    return turn._replace(segmentation=segmented, patch_tracker=carried, event=Event.RAN)


# Of what they say.


def weigh(turn: Turn) -> Turn:
    """Take the measurements of this frame into the choice, and choose what is answered and how sure that is."""
    segmented, carried = turn.segmentation, turn.patch_tracker
    choice = turn.choice if segmented is None or carried is None else _measured(turn, segmented, carried)
    estimate = leading(segmented, carried, choice)
    score = estimate.score
    if segmented and carried and choice.trusted:
        other = carried.estimate
        if estimate.ok:
            score = choice.segment_chance(score)
            if other.ok and choice.outweighed(score):
                choice, estimate, score = choice.carried_away, other, other.score
        elif other.ok and other.score > tuning.SURELY:
            estimate, score = other, other.score
    turn = turn._replace(choice=choice, estimate=estimate, score=score)
    return turn._replace(event=_outcome(turn))


def answer(turn: Turn) -> Turn:
    """The object is there."""
    return _done(turn, _advanced(turn, "tracking"))


def reject(turn: Turn) -> Turn:
    """What is hardly the object is no answer."""
    lost = _advanced(turn, "lost")
    return _done(turn, replace(lost, scene=_remembered(turn, lost)))


def miss(turn: Turn) -> Turn:
    """Nobody sees the object: remember the scene without it; the modes go on searching."""
    lost = _advanced(turn, "occluded" if turn.event is Event.HIDDEN else "lost")
    return _done(turn, replace(lost, scene=_remembered(turn, lost)) if _has_both(turn) else lost)


def answer_part(turn: Turn) -> Turn:
    """The part of the object that is seen is the answer; the modes go on searching."""
    assert turn.redetected is not None, "a part is seen"
    lost = _advanced(turn, "tracking")
    return _done(turn, replace(lost, scene=_remembered(turn, lost), box=turn.redetected.box, score=tuning.SIGHTED))


def begin_anew(turn: Turn) -> Turn:
    """Most of the object is seen: both modes begin anew there."""
    assert turn.redetected is not None, "most of it is seen"
    segmented, carried = _both(turn)
    box = turn.redetected.box
    return _done(
        turn,
        replace(
            _advanced(turn, "tracking"),
            segmentation=turn.rooms.segmentation.reseed(segmented, turn.frame, box, rooms.SEGMENTATION),
            patch_tracker=turn.rooms.patch_tracker.ride(carried, box),
            choice=Choice(),
            box=box,
            score=tuning.SURE,
        ),
    )


# Helpers.


def _done(turn: Turn, track: Track) -> Turn:
    return turn._replace(track=track, event=Event.DONE)


def _has_both(turn: Turn) -> bool:
    return turn.segmentation is not None and turn.patch_tracker is not None


def _both(turn: Turn) -> tuple[SegmentationState, PatchTrackerState]:
    assert turn.segmentation is not None, "both modes are at work"
    assert turn.patch_tracker is not None, "both modes are at work"
    return turn.segmentation, turn.patch_tracker


def _segmented(turn: Turn, state: SegmentationState) -> SegmentationState:
    """Follow the object by segmentation; where it is not where it was expected, find its layer again farther away."""
    stepped = turn.rooms.segmentation.step(state, turn.frame, rooms.SEGMENTATION)
    if stepped.estimate.ok or stepped.estimate.occluded or state.count < tuning.RELOCATED_FROM:
        return stepped
    found = turn.rooms.segmentation.relocate(state, turn.frame, state.occlusion.coasting, rooms.SEGMENTATION)
    return stepped if found is None else found


def _relocated(turn: Turn) -> Track | None:
    """The track after its object's layer was found again; None where it was not."""
    track, segmented = turn.track, turn.track.segmentation
    may_be_here = turn.same or track.interrupted > tuning.PATIENCE
    if segmented is None or not (may_be_here and track.choice.trusted and segmented.estimate.ok):
        return None
    found = turn.rooms.segmentation.relocate(segmented, turn.frame, track.interrupted, rooms.SEGMENTATION)
    if found is None:
        return None
    box = found.estimate.box
    carried = turn.rooms.patch_tracker.ride(track.patch_tracker, box) if track.patch_tracker else None
    return replace(
        track,
        segmentation=found,
        patch_tracker=carried,
        box=box,
        score=tuning.SURELY,
        state="tracking" if _is_inside(box, turn.frame) else "lost",
        overview=turn.overview,
        interrupted=0,
    )


def _sought(turn: Turn) -> Track:
    """The track after the patch tracker looked all over the frame; still interrupted, unless it is sure."""
    track = turn.track
    if track.patch_tracker is None:
        return track
    carried = turn.rooms.patch_tracker.seek(track.patch_tracker, turn.frame, track.options)
    found, segmented = carried.estimate, track.segmentation
    if not found.ok or found.score < (tuning.SURELY if turn.same else tuning.CERTAINLY):
        return replace(track, patch_tracker=carried)
    if segmented:
        segmented = turn.rooms.segmentation.reseed(segmented, turn.frame, found.box, rooms.SEGMENTATION)
    return replace(
        track,
        segmentation=segmented,
        patch_tracker=carried,
        choice=Choice(trusted=False) if segmented else track.choice,
        box=found.box,
        score=found.score,
        state="tracking" if _is_inside(found.box, turn.frame) else "lost",
        overview=turn.overview,
        interrupted=0,
    )


def _has_left(turn: Turn, choice: Choice, segmented: SegmentationState, carried: Box) -> bool:
    """Whether segmentation sees the object elsewhere, and only ground in the carried box."""
    seen = segmented.estimate
    if not seen.ok or seen.occluded or not choice.may_have_left(seen.score):
        return False
    return turn.rooms.segmentation.has_left(segmented, carried)


def _shows_ground(turn: Turn, segmented: SegmentationState, carried: Estimate) -> bool:
    """Whether segmentation, not being doubted, knows the box in which the patch tracker sees the object as ground."""
    if not carried.ok or segmented.estimate.ok or not turn.choice.trusted or turn.choice.doubt >= tuning.LEAVE:
        return False
    return turn.rooms.segmentation.shows_ground(segmented, carried.box)


def _is_consistent(turn: Turn, box: Box) -> bool:
    """Tell whether a mode that has lost the object may have found it again in this box."""
    scene, seen = turn.track.scene, turn.redetected
    if scene is None:
        return True
    if seen and seen.share > tuning.WHOLE and iou(seen.box, box) < tuning.ELSEWHERE:
        return False
    return not turn.rooms.redetection.is_foreign(scene, turn.frame, box)


def _measured(turn: Turn, segmented: SegmentationState, carried: PatchTrackerState) -> Choice:
    """The choice after the measurements of this frame."""
    choice = turn.choice
    if segmented is turn.track.segmentation:  # not watched in this frame
        return replace(choice, since=choice.since + 1)
    witness = _is_witness(choice, carried)
    difference = size_difference(segmented.estimate.box, carried.estimate.box) if witness else None
    steadiness = _steadiness(turn, segmented)
    after = updated(choice, segmented.estimate.unexplained, difference, steadiness)
    if after.trusted and not choice.trusted and not carried.estimate.ok:
        return replace(after, trusted=False)  # nobody knows where the object is that it should follow
    return after


def _is_witness(choice: Choice, carried: PatchTrackerState) -> bool:
    """Whether the patch tracker tells the object's size: not where it hardly knows its place, or was taught."""
    return carried.estimate.score > tuning.SURE and not choice.taught


def _steadiness(turn: Turn, segmented: SegmentationState) -> Steadiness:
    """That of the segment after this frame; as it was where there are not two whole segments to compare."""
    known, before = turn.choice.steadiness, turn.track.segmentation
    assert before is not None, "segmentation is at work"
    ran = turn.choice.trusted or turn.choice.frames < tuning.WITNESS_FRAMES
    whole = all(one.ok and not one.occluded for one in (before.estimate, segmented.estimate))
    if not (ran and whole and segmented.count > 1):
        return known
    return known.after(growth(before.estimate.box, segmented.estimate.box), segmented.turn)


def _outcome(turn: Turn) -> Event:
    estimate = turn.estimate
    assert estimate is not None, "the modes ran"
    if estimate.ok and turn.score < tuning.LEAST:
        return Event.UNLIKELY
    if estimate.ok and _is_inside(estimate.box, turn.frame):
        return Event.LOCATED
    if turn.redetected and _has_both(turn):
        return Event.PART if turn.redetected.share < tuning.WHOLE else Event.WHOLE
    return Event.HIDDEN if estimate.occluded else Event.MISSING


def _is_inside(box: Box, frame: Frame) -> bool:
    inside = box.clip(frame.width, frame.height)
    return min(inside.w, inside.h) >= 1.0


def _advanced(turn: Turn, state: TrackerState) -> Track:
    """The track with what the modes say of this frame."""
    estimate = turn.estimate
    assert estimate is not None, "the modes ran"
    return Track(
        video=turn.track.video,
        segmentation=turn.segmentation,
        patch_tracker=turn.patch_tracker,
        choice=turn.choice,
        box=estimate.box,
        options=turn.track.options,
        score=turn.score,
        state=state,
        target=_target(turn),
        overview=turn.overview,
    )


def _target(turn: Turn) -> Target | None:
    """What the object is known by: of frames in which it is surely segmented, or else of the first one."""
    known, segmented = turn.track.target, turn.segmentation
    if segmented is None or not segmented.estimate.ok:
        return known
    if known is None or (turn.choice.trusted and segmented.estimate.score > tuning.SURE):
        return turn.rooms.redetection.target_of(segmented, known)
    return known


def _remembered(turn: Turn, lost: Track) -> Scene | None:
    """The scene without the object: the frame in which it was lost."""
    before = turn.track
    if before.state != "tracking" or before.scene or not lost.target or lost.choice.unexplained >= tuning.UNDERSTOOD:
        return before.scene
    return turn.rooms.redetection.scene_without(turn.frame, lost.target)
