"""`TrackerHS`: the tracker with the interface of ``cv2.Tracker``.

It decides; its collaborators compute. It is the only mutable object of a track: what is known of the target is a
:class:`_Track`, replaced as a whole after each frame, so that a frame that cannot be used leaves no trace.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import patch_tracker, redetection, segmentation
from .arbitration import LEAST, SURELY, WITNESS_FRAMES, Choice, agreement, judge, size_difference
from .flow import derivatives, normal_flow
from .frames import (
    Frame,
    InputError,
    VideoFormat,
    as_frame,
    as_roi,
    downloaded,
    fixed_errstate,
    is_dropped,
    next_frame,
)
from .geometry import Box, iou
from .overview import Overview, blank, overview, same_scene
from .params import TrackerHS_Params
from .patch_tracker import PatchTrackerParams, PatchTrackerReport, PatchTrackerState
from .patch_tracker.patches import COLOURS, GRAYS
from .redetection import Scene, Sighting, Target
from .segmentation import SegmentationReport, SegmentationState
from .validation import Count, Shape, shown, validate

__all__ = ["TrackerDebug", "TrackerHS", "TrackerHS_create", "TrackerState"]

NOWHERE = (0, 0, 0, 0)
"""The box that cv2's trackers return with ``False``."""

SEEN_MARGIN = 16
"""Margin round the box, px, in which a frame must repeat the first one bit by bit to count as the same frame."""

SEGMENTATION = segmentation.SegmentationParams()
PATCH_TRACKER = PatchTrackerParams()

SURE = 0.8
"""Score from which the carried box may take over from a segmentation that is doubted, and its size is compared."""

ASK_EVERY = 8
"""Frames between two questions to a carried box that rides on a segment: where would it be on its own?"""

WATCH_EVERY = 2
"""Frames between two looks at the background of an object whose segmentation is not trusted."""

UNDERSTOOD = 0.06
"""Share of the background not explained below which what is new in the scene may be searched for the object."""

SIGHTED = 0.45
"""Score while a part of the object is sighted: so often its box overlapped the truth by half (vanish suites)."""

WHOLE = 0.8
"""Share of the object sighted from which segmentation begins anew there."""

STATE_VERSION = 5
"""Of what a pickle of a tracker holds; a change of any class in it changes the number."""

PATIENCE = 60
"""Frames of another scene after which the object is looked for there, too: the camera may have been moved."""

CERTAINLY = 0.95
"""Chance from which the carried box is believed in a frame that seems to be of another scene: in cuts between real
sequences .9 was too little (4 % of the answers True), .97 gave what .95 gives."""

TrackerState = Literal["uninitialised", "tracking", "occluded", "lost"]


@dataclass(frozen=True)
class TrackerDebug:
    """What the last update saw and thought: the panels of the paper's window.

    Parameters
    ----------
    window : Box
        The window worked in, frame px.
    step : float
        Frame pixels per window pixel.
    previous, current : ndarray, shape (H, W), float32
        The window in the last two frames, gray, 0–255.
    Fx, Fy, Ft : ndarray, shape (H, W), float32
        Derivatives over the 2×2×2 cube.
    flow : ndarray, shape (H, W, 2), float32
        Window px per frame.
    normal_flow : ndarray, shape (H, W, 2), float32
    mask : ndarray of bool, shape (H, W), or None
        Pixels of the object; None when the box was carried by flow.
    choice : Choice
        The measurement behind the mode that answered.
    """

    window: Box
    step: float
    previous: NDArray[np.float32]
    current: NDArray[np.float32]
    Fx: NDArray[np.float32]
    Fy: NDArray[np.float32]
    Ft: NDArray[np.float32]
    flow: NDArray[np.float32]
    normal_flow: NDArray[np.float32]
    mask: NDArray[np.bool_] | None
    choice: Choice

    def _repr_png_(self) -> bytes:
        """Its panels, in Jupyter."""
        from .display import draw_fields, png

        return png(draw_fields(self))


@dataclass(frozen=True)
class _Seen:
    """The part of the first frame round the box: OpenCV's own sample gives that frame to `update` too."""

    x0: Count
    y0: Count
    pixels: Annotated[NDArray[Any], Shape("first h", "first w", "channels")]

    @classmethod
    def of(cls, frame: Frame, box: Box) -> _Seen:
        window = box.grown(SEEN_MARGIN).clip(frame.width, frame.height)
        x0, y0 = int(window.x), int(window.y)
        part = frame.pixels[y0 : int(window.bottom) + 1, x0 : int(window.right) + 1]
        # In the byte order in which a pickle gives it back.
        return cls(x0, y0, part.astype(frame.format.dtype))

    def again(self, frame: Frame) -> bool:
        height, width = self.pixels.shape[:2]
        part = frame.pixels[self.y0 : self.y0 + height, self.x0 : self.x0 + width]
        return frame.format.dtype == self.pixels.dtype and np.array_equal(part, self.pixels)


@dataclass(frozen=True)
class _Track:
    """All that is known of the target after one frame."""

    video: VideoFormat
    segmentation: segmentation.SegmentationState | None
    patch_tracker: patch_tracker.PatchTrackerState | None
    choice: Choice
    box: Box
    options: PatchTrackerParams
    first: _Seen | None = None
    score: float = 1.0
    state: TrackerState = "tracking"
    target: Target | None = None
    scene: Scene | None = None
    overview: Overview | None = None
    interrupted: Count = 0

    def follows(self, parameters: TrackerHS_Params) -> bool:
        """Tell whether a tracker of these parameters may have such a track."""
        modes = (self.segmentation is not None, self.patch_tracker is not None)
        if self.options != _options(parameters) or modes != _modes(parameters):
            return False
        size = self.video.width, self.video.height
        segmented = self.segmentation is None or segmentation.belongs(self.segmentation, *size, SEGMENTATION)
        return segmented and (
            self.patch_tracker is None or patch_tracker.belongs(self.patch_tracker, *size, self.options)
        )

    def named_lengths(self) -> dict[str, int]:
        """Lengths of arrays that follow from the kind of frame, by name."""
        known = {"channels": self.video.channels, "bins": GRAYS if self.video.channels == 1 else COLOURS}
        return known | (self.scene.lengths(self.video) if self.scene else {})


class TrackerHS:
    """Track one object by its motion; put it where a ``cv2.TrackerCSRT`` stood.

    The object is found by Horn–Schunck optical flow, without training or model file, and may rotate, deform, glint or
    change its surface. Duck-typed: it is not a subclass of ``cv2.Tracker``, since OpenCV does not support that and
    crashes.

    Parameters
    ----------
    parameters : TrackerHS_Params, optional
        Copied: later changes to it do not reach the tracker.

    Examples
    --------
    >>> import numpy as np
    >>> from hs_tracker_cv import TrackerHS_create
    >>> frame = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    >>> tracker = TrackerHS_create()
    >>> tracker.init(frame, (40, 30, 32, 24))
    >>> tracker.update(frame)
    (True, (40, 30, 32, 24))
    """

    Params = TrackerHS_Params

    def __init__(self, parameters: TrackerHS_Params | None = None) -> None:
        self._parameters = TrackerHS_Params.from_dict((parameters or TrackerHS_Params()).to_dict())
        self._track: _Track | None = None

    def __getstate__(self) -> dict[str, Any]:
        """State for pickle and copy."""
        return {**self.__dict__, "version": STATE_VERSION}

    @fixed_errstate
    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over what :meth:`__getstate__` gave. Anybody may have edited it: then this is a ValueError."""
        version = state.get("version") if isinstance(state, dict) else None
        if version != STATE_VERSION:
            raise ValueError(f"expected a TrackerHS pickled in version {STATE_VERSION}, got version {shown(version)}")
        own = {name: value for name, value in state.items() if name != "version"}
        parameters = own.get("_parameters")
        if not isinstance(parameters, TrackerHS_Params):
            raise ValueError(f"expected _parameters to be TrackerHS_Params, got {shown(parameters)}")
        parameters = TrackerHS_Params.from_dict(parameters.to_dict())  # which knows types and ranges
        validate(own.get("_track", "nothing"), _Track | None, "_track")
        if own["_track"] is not None and not own["_track"].follows(parameters):
            raise ValueError(f"expected a track as of {parameters}, got one of other modes or numbers")
        self.__dict__.update(own)

    @classmethod
    def create(cls, parameters: TrackerHS_Params | None = None) -> TrackerHS:
        """Return a new tracker, as ``cv2.TrackerCSRT.create`` does."""
        return cls(parameters)

    @fixed_errstate
    def init(self, image: Any, boundingBox: Any) -> None:
        """Start tracking what is inside a box; whatever was tracked before is forgotten.

        Parameters
        ----------
        image : ndarray or cv2.UMat
            Gray (H, W) or (H, W, 1), BGR (H, W, 3) or BGRA (H, W, 4); of any real type, in any memory layout. It
            is neither kept nor written to.
        boundingBox : sequence of 4 numbers
            x, y, w, h in px. What lies outside the frame is cut off.

        Raises
        ------
        InputError
            If image or box cannot be used (a ``cv2.error`` and a ``ValueError``); the tracker is then
            uninitialised.
        """
        self._track = None
        frame = as_frame(image, self._parameters.gain)
        box = as_roi(boundingBox, frame)
        segmenting, carrying = _modes(self._parameters)
        options = _options(self._parameters)
        self._track = _Track(
            video=frame.format,
            segmentation=segmentation.start(frame, box, SEGMENTATION) if segmenting else None,
            patch_tracker=patch_tracker.start(frame, box, options) if carrying else None,
            choice=Choice(trusted=segmenting),
            box=box,
            options=options,
            first=_Seen.of(frame, box),
            overview=overview(frame),
        )

    @fixed_errstate
    def update(self, image: Any) -> tuple[bool, tuple[int, int, int, int]]:
        """Find the object in the next frame.

        Parameters
        ----------
        image : ndarray or cv2.UMat
            Of the size and channel count of the frame given to `init`. None or an empty image (a dropped frame)
            is answered with False, and changes nothing.

        Returns
        -------
        ok : bool
            True when the object is located. False when it is lost, occluded or out of view; it is searched for
            in the frames that follow.
        box : tuple of 4 int
            x, y, w, h in px; zeros where `ok` is False. :attr:`box` is the same with sub-pixel precision.

        Raises
        ------
        InputError
            Before a successful `init`, or for an image that cannot belong to the same video; the track is
            as if the call had not been made.
        """
        track = _started(self._track)
        frame = _next(track, image)
        if frame is None:
            return False, NOWHERE
        if track.first is None or not track.first.again(frame):
            track = self._track = _advance(track, frame)
        return (True, track.box.rounded()) if track.state == "tracking" else (False, NOWHERE)

    @fixed_errstate
    def check(self, image: Any) -> None:
        """Raise what `update` would raise for an image; nothing changes.

        Raises
        ------
        InputError
            As :meth:`update` does.
        """
        _next(_started(self._track), image)

    def getTrackingScore(self) -> float:
        """Confidence in the last answer, in [0, 1]; 0 before a successful `init`."""
        return self._track.score if self._track else 0.0

    @property
    def parameters(self) -> TrackerHS_Params:
        """A copy of the options in force."""
        return TrackerHS_Params.from_dict(self._parameters.to_dict())

    @property
    def initialised(self) -> bool:
        """True after a successful `init`."""
        return self._track is not None

    @property
    def box(self) -> Box | None:
        """Where the object is, with sub-pixel precision; where it was last, while lost; None before `init`."""
        return self._track.box if self._track else None

    @property
    def state(self) -> TrackerState:
        """``"tracking"``, ``"occluded"`` or ``"lost"``; ``"uninitialised"`` before a successful `init`."""
        return self._track.state if self._track else "uninitialised"

    @fixed_errstate
    def debug(self) -> TrackerDebug:
        """What the last update saw and thought.

        Raises
        ------
        InputError
            Before the first update.
        """
        track = self._track
        if track is None or track.first is not None:
            raise InputError("debug needs an update first")
        view = _view(_followed(track.segmentation, track.patch_tracker, track.choice))
        fx, fy, ft = derivatives(view.previous, view.current)
        return TrackerDebug(
            window=view.window,
            step=view.step,
            previous=view.previous,
            current=view.current,
            Fx=fx,
            Fy=fy,
            Ft=ft,
            flow=view.flow,
            normal_flow=normal_flow(fx, fy, ft),
            mask=view.mask,
            choice=track.choice,
        )


def _options(parameters: TrackerHS_Params) -> PatchTrackerParams:
    return replace(PATCH_TRACKER, rotation=True) if parameters.rotation else PATCH_TRACKER


def _modes(parameters: TrackerHS_Params) -> tuple[bool, bool]:
    """Whether segmentation is at work, and the carried box."""
    return parameters.mode != "patch_tracker", parameters.mode != "segmentation"


def _started(track: _Track | None) -> _Track:
    if track is None:
        raise InputError("update needs a successful init first")
    return track


def _next(track: _Track, image: Any) -> Frame | None:
    """Check that an image can be the next frame of this video; None for a frame that was dropped."""
    image = downloaded(image)
    return None if is_dropped(image) else next_frame(image, track.video)


def _advance(track: _Track, frame: Frame) -> _Track:
    """Take one frame in: the modes look, the rule chooses, the track is replaced."""
    now = overview(frame)
    same = track.overview is None or same_scene(track.overview, now, track.interrupted + 1)
    if track.interrupted and not blank(now):
        track = _resume(track, frame, now, same)
        if not track.interrupted:
            return track
    if not same:
        return replace(track, first=None, score=0.0, state="lost", interrupted=track.interrupted + 1)
    seen = redetection.look(track.scene, frame) if track.scene else None
    segmented, carried, choice = _look(track, frame, seen)
    if segmented and carried:
        carried, choice = _choose(track, segmented, carried, choice, frame)
    report: SegmentationReport | PatchTrackerReport = _followed(segmented, carried, choice).report
    if (
        segmented
        and carried
        and choice.trusted
        and not report.ok
        and carried.report.ok
        and carried.report.score > SURELY
    ):
        report = carried.report
    score = report.score
    if segmented and carried and choice.trusted and report is segmented.report and report.ok:
        score = choice.belief(report.score)
        if carried.report.ok and choice.outweighed(score):
            choice, report, score = choice.carried_away, carried.report, carried.report.score
    advanced = _Track(
        video=track.video,
        segmentation=segmented,
        patch_tracker=carried,
        choice=choice,
        box=report.box,
        options=track.options,
        score=score,
        state=_state(report, frame),
        target=_known(track.target, segmented, choice),
        overview=now,
    )
    if report.ok and score < LEAST:
        return replace(advanced, state="lost", scene=_remembered(track, advanced, frame))
    return advanced if advanced.state == "tracking" else _await(track, advanced, frame, seen)


def _resume(track: _Track, frame: Frame, now: Overview, same: bool) -> _Track:
    """After an interruption: find the object by its layer, where it may have gone meanwhile, or by the carried box.

    The latter has to be sure: it also looks where the scene is not the same, since the camera may have been moved.
    """
    found = replace(track, overview=now, interrupted=0)
    segmented = None
    if (
        (same or track.interrupted > PATIENCE)
        and track.segmentation
        and track.choice.trusted
        and track.segmentation.report.ok
    ):
        segmented = segmentation.relocate(track.segmentation, frame, track.interrupted, SEGMENTATION)
    if segmented is not None:
        report = segmented.report
        carried = patch_tracker.ride(track.patch_tracker, report.box) if track.patch_tracker else None
        return replace(
            found,
            segmentation=segmented,
            patch_tracker=carried,
            box=report.box,
            score=SURELY,
            state=_state(report, frame),
        )
    if track.patch_tracker is None:
        return track
    carried = patch_tracker.seek(track.patch_tracker, frame, track.options)
    seen = carried.report
    if not seen.ok or seen.score < (SURELY if same else CERTAINLY):
        return replace(track, patch_tracker=carried)
    segmented = segmentation.reseed(track.segmentation, frame, seen.box, SEGMENTATION) if track.segmentation else None
    choice = Choice(trusted=False) if track.segmentation else track.choice
    return replace(
        found, segmentation=segmented, patch_tracker=carried, choice=choice, box=seen.box, score=seen.score,
        state=_state(seen, frame),
    )  # fmt: skip


def _choose(
    track: _Track, segmented: SegmentationState, carried: PatchTrackerState, choice: Choice, frame: Frame
) -> tuple[PatchTrackerState, Choice]:
    """Take the measurements of this frame into the choice; where it changes, see to the hand-over."""
    if segmented is track.segmentation:  # not watched in this frame
        return carried, replace(choice, since=choice.since + 1)
    # A carried box that does not know where the object is does not know its size.
    witness = carried.report.score > SURE
    difference = size_difference(segmented.report.box, carried.report.box) if witness else None
    judged = judge(choice, segmented.report.unexplained, difference)
    if judged.trusted and not choice.trusted and not carried.report.ok:
        judged = replace(judged, trusted=False)  # nobody knows where the object is that it should follow
    return carried, judged


def _known(target: Target | None, segmented: SegmentationState | None, choice: Choice) -> Target | None:
    """What the object is known by: of frames in which it is surely segmented, or else of the first one."""
    if segmented is None or not segmented.report.ok:
        return target
    if target is None or (choice.trusted and segmented.report.score > SURE):
        return redetection.describe(segmented, target)
    return target


def _await(track: _Track, lost: _Track, frame: Frame, seen: Sighting | None) -> _Track:
    """The object is lost: remember the scene without it, and answer with what is seen of it when it comes back.

    When all of it is seen, segmentation begins anew there; until then both modes go on searching.
    """
    if lost.segmentation is None or lost.patch_tracker is None:
        return lost
    scene = _remembered(track, lost, frame)
    if seen is None:
        return replace(lost, scene=scene)
    found = replace(lost, scene=scene, box=seen.box, score=SIGHTED, state="tracking")
    if seen.share < WHOLE:
        return found
    segmented = segmentation.reseed(lost.segmentation, frame, seen.box, SEGMENTATION)
    carried = patch_tracker.ride(lost.patch_tracker, seen.box)
    return replace(found, segmentation=segmented, patch_tracker=carried, choice=Choice(), scene=None, score=SURE)


def _remembered(track: _Track, lost: _Track, frame: Frame) -> Scene | None:
    """The scene without the object: the frame in which it was lost."""
    if track.state != "tracking" or track.scene or not lost.target or lost.choice.unexplained >= UNDERSTOOD:
        return track.scene
    return redetection.remember(frame, lost.target)


def _look(
    track: _Track, frame: Frame, seen: Sighting | None
) -> tuple[SegmentationState | None, PatchTrackerState | None, Choice]:
    """Both modes whole while the choice is young; then the one followed, and of the other what keeps it ready.

    Ready means: segmentation goes on learning the background round the carried box, which is also what its trust is
    measured on; the carried box rides on the segment.
    """
    segmented, carried, choice = track.segmentation, track.patch_tracker, track.choice
    near = seen.box.centre if seen else None
    if segmented is None or carried is None or choice.frames < WITNESS_FRAMES:
        segmented = _segment(segmented, frame) if segmented else None
        carried = _turned(carried, segmented) if carried and segmented and segmented.report.ok else carried
        carried = patch_tracker.step(carried, frame, track.options, near=near) if carried else None
        if segmented and carried:
            choice = choice.asked(carried.report.score, agreement(segmented.report.box, carried.report.box))
        return segmented, carried, choice
    if not choice.trusted:
        carried = patch_tracker.step(carried, frame, track.options, near=near)
        if choice.since % WATCH_EVERY == 0:
            segmented = segmentation.watch(segmented, frame, carried.report.box, SEGMENTATION)
        return segmented, carried, choice
    segmented = _segment(segmented, frame)
    if segmented.report.ok and not _believable(segmented.report.box, track.scene, seen, frame):
        segmented = segmented.replace(report=replace(segmented.report, ok=False, lost=True, score=0.0))
    if segmented.report.ok:
        carried = _turned(carried, segmented)
        if choice.since % ASK_EVERY == 0:
            asked = patch_tracker.step(carried, frame, track.options)
            choice = choice.asked(asked.report.score, agreement(segmented.report.box, asked.report.box))
            if choice.contradicted:
                return segmented, asked, choice.carried_away
        return segmented, patch_tracker.ride(carried, segmented.report.box), choice
    return _search(track, segmented, carried, frame, seen)


def _turned(carried: PatchTrackerState, segmented: SegmentationState) -> PatchTrackerState:
    """The carried box expects the object turned as segmentation sees it turn."""
    return patch_tracker.turned(carried, segmented.turn)


def _segment(state: SegmentationState, frame: Frame) -> SegmentationState:
    """Follow the object by segmentation; where it is not where it was expected, find its layer again farther away."""
    stepped = segmentation.step(state, frame, SEGMENTATION)
    if stepped.report.ok or stepped.report.occluded or state.count < 3:
        return stepped
    found = segmentation.relocate(state, frame, state.occlusion.coasting, SEGMENTATION)
    return stepped if found is None else found


def _search(
    track: _Track, segmented: SegmentationState, carried: PatchTrackerState, frame: Frame, seen: Sighting | None
) -> tuple[SegmentationState, PatchTrackerState, Choice]:
    """Segmentation waits where the object was last; the carried box knows what it looks like and searches around.

    Where that finds it, segmentation begins anew, and has to earn its trust as after `init`.
    """
    searching = patch_tracker.step(carried, frame, track.options, near=seen.box.centre if seen else None)
    if searching.report.ok and not _believable(searching.report.box, track.scene, seen, frame):
        return segmented, patch_tracker.dismiss(carried, searching), track.choice
    if carried.report.lost and searching.report.ok:
        return (
            segmentation.reseed(segmented, frame, searching.report.box, SEGMENTATION),
            searching,
            Choice(trusted=False),
        )
    return segmented, searching, track.choice


def _believable(box: Box, scene: Scene | None, seen: Sighting | None, frame: Frame) -> bool:
    """Tell whether a mode that has lost the object may have found it again in this box."""
    if scene is None:
        return True
    if seen and seen.share > WHOLE and iou(seen.box, box) < 0.5:
        return False
    return not redetection.foreign(scene, frame, box)


def _followed(
    segmented: SegmentationState | None, carried: PatchTrackerState | None, choice: Choice
) -> SegmentationState | PatchTrackerState:
    """The mode that answers."""
    chosen = segmented if segmented and (choice.trusted or carried is None) else carried
    assert chosen is not None, "init starts at least one mode"
    return chosen


class _View(NamedTuple):
    """The pictures behind one answer."""

    window: Box
    step: float
    previous: NDArray[np.float32]
    current: NDArray[np.float32]
    flow: NDArray[np.float32]
    mask: NDArray[np.bool_] | None


def _view(state: SegmentationState | PatchTrackerState) -> _View:
    if isinstance(state, SegmentationState):
        seen = state.report
        height, width = seen.current.shape
        window = Box(*seen.origin, width * seen.step, height * seen.step)
        return _View(window, seen.step, seen.previous, seen.current, seen.flow, seen.mask.astype(bool))
    carried = state.report
    height, width = carried.current.shape
    window = Box(*carried.origin, width * carried.step[0], height * carried.step[1])
    # patches are normalised to mean 0 and deviation 32
    previous, current = (np.clip(patch + 128.0, 0.0, 255.0) for patch in (carried.previous, carried.current))
    return _View(window, carried.step[0], previous, current, carried.flow, None)


def _state(report: SegmentationReport | PatchTrackerReport, frame: Frame) -> TrackerState:
    inside = report.box.clip(frame.width, frame.height)
    if report.ok and min(inside.w, inside.h) >= 1.0:
        return "tracking"
    return "occluded" if isinstance(report, SegmentationReport) and report.occluded else "lost"


def TrackerHS_create(parameters: TrackerHS_Params | None = None) -> TrackerHS:
    """Return a new :class:`TrackerHS`, as ``cv2.TrackerCSRT_create`` does."""
    return TrackerHS(parameters)
