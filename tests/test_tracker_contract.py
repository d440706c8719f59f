"""The contract with cv2 users: every bad input, every idiom (see the behaviour table in README)."""

from __future__ import annotations

import copy
import gc
import pickle
import weakref
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import Box, TrackerHS, TrackerHS_create, TrackerHS_Params, legacy, segmentation
from hs_tracker_cv.frames import InputError
from hs_tracker_cv.geometry import iou
from tests.conftest import BOX_IOU, moving_square
from tests.test_segmentation import behind_wall

NOWHERE = (0, 0, 0, 0)
Frames = list[NDArray[np.uint8]]
Boxes = list[tuple[int, int, int, int]]


@pytest.fixture(scope="module")
def video() -> tuple[Frames, Boxes]:
    """A textured square moving over texture."""
    return moving_square(np.random.default_rng(7))


def run(tracker: Any, frames: Frames) -> list[tuple[bool, tuple[int, int, int, int]]]:
    """Answers of a tracker to a list of frames."""
    return [tracker.update(frame) for frame in frames]


def started(video: tuple[Frames, Boxes], **parameters: Any) -> TrackerHS:
    """A tracker initialised on the first frame."""
    tracker = TrackerHS_create(TrackerHS_Params(**parameters))
    tracker.init(video[0][0], video[1][0])
    return tracker


@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
def test_follows_a_moving_square(video: tuple[Frames, Boxes], mode: str) -> None:
    """The box stays on a textured mover in every mode, in frame coordinates, as Python ints."""
    tracker = started(video, mode=mode)
    for frame, truth in zip(video[0][1:], video[1][1:], strict=True):
        ok, box = tracker.update(frame)
        assert ok is True
        assert type(box) is tuple
        assert [type(value) for value in box] == [int] * 4
        assert iou(Box(*box), Box(*truth)) > BOX_IOU * (1 if mode != "patch_tracker" else 0.9)


def test_init_returns_none_like_cv2(video: tuple[Frames, Boxes]) -> None:
    """`init` answers None, and takes cv2's keyword names."""
    tracker = TrackerHS_create()
    assert tracker.init(image=video[0][0], boundingBox=video[1][0]) is None
    assert tracker.update(image=video[0][1])[0] is True


@pytest.mark.parametrize(
    "kind", [list, tuple, np.array, lambda b: np.array(b, float), lambda b: tuple(map(float, b))]
)
def test_rois_of_every_kind_start_the_same_track(
    video: tuple[Frames, Boxes], kind: Callable[[tuple[int, ...]], Any]
) -> None:
    """Lists, arrays and floats are boxes too."""
    tracker = TrackerHS_create()
    tracker.init(video[0][0], kind(video[1][0]))
    assert run(tracker, video[0][1:4]) == run(started(video), video[0][1:4])


@pytest.mark.parametrize(
    "roi",
    [
        (0, 0, 0, 0),
        (10, 10, -5, 20),
        (10, 10, 2, 20),
        (500, 500, 20, 20),
        (1, 2, 3),
        (1, 2, 3, 4, 5),
        None,
        "box",
        (np.nan, 1, 20, 20),
    ],
)
def test_bad_rois_raise_and_leave_the_tracker_uninitialised(video: tuple[Frames, Boxes], roi: Any) -> None:
    """A failed init is an exception, then `update` says so instead of crashing, then init works."""
    tracker = started(video)
    with pytest.raises(InputError, match="boundingBox") as refused:
        tracker.init(video[0][0], roi)
    assert repr(roi) in str(refused.value)
    assert isinstance(refused.value, cv2.error)
    assert isinstance(refused.value, ValueError)
    assert (tracker.state, tracker.box, tracker.getTrackingScore()) == ("uninitialised", None, 0.0)
    with pytest.raises(InputError, match="init"):
        tracker.update(video[0][1])
    tracker.init(video[0][0], video[1][0])
    assert tracker.update(video[0][1])[0] is True


@pytest.mark.parametrize(
    "image",
    [None, "frame.png", np.zeros((0, 0, 3), np.uint8), np.zeros((9, 9, 2), np.uint8), np.zeros((9, 9), complex)],
)
def test_bad_images_at_init_raise_and_leave_the_tracker_uninitialised(
    video: tuple[Frames, Boxes], image: Any
) -> None:
    """A frame that is none starts nothing, ends what was tracked, and the next init works."""
    tracker = started(video)
    with pytest.raises(InputError, match="expected"):
        tracker.init(image, video[1][0])
    assert (tracker.state, tracker.box, tracker.getTrackingScore()) == ("uninitialised", None, 0.0)
    tracker.init(video[0][0], video[1][0])
    assert tracker.update(video[0][1])[0] is True


def test_update_before_init_is_a_clear_error(video: tuple[Frames, Boxes]) -> None:
    """No segfault: one exception that is a cv2.error and a ValueError."""
    for kind in (cv2.error, ValueError):
        with pytest.raises(kind, match="init"):
            TrackerHS_create().update(video[0][0])


def test_roi_partly_outside_is_clipped(video: tuple[Frames, Boxes]) -> None:
    """A box over the edge starts a track on its inside."""
    tracker = TrackerHS_create()
    tracker.init(video[0][0], (-10, -10, 40, 40))
    assert tracker.update(video[0][0]) == (True, (0, 0, 30, 30))


def test_same_frame_as_init_gives_the_roi(video: tuple[Frames, Boxes]) -> None:
    """No motion is not lost."""
    tracker = started(video)
    assert tracker.update(video[0][0]) == (True, video[1][0])
    assert tracker.state == "tracking"


@pytest.mark.parametrize("bad", [None, np.zeros((0, 0, 3), np.uint8), np.zeros((0, 160), np.uint8)])
def test_no_frame_answers_false_and_the_next_good_one_goes_on(video: tuple[Frames, Boxes], bad: Any) -> None:
    """A dropped frame costs one False and changes nothing."""
    tracker, undisturbed = started(video), started(video)
    answers = []
    for frame in video[0][1:6]:
        assert tracker.update(bad) == (False, NOWHERE)
        answers.append(tracker.update(frame))
    assert answers == run(undisturbed, video[0][1:6])


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.zeros((60, 80, 3), np.uint8), "160 × 120"),
        (np.zeros((120, 160), np.uint8), "3 channel"),
        (np.zeros((120, 160, 3), complex), "complex128"),
        (np.zeros((120, 160, 2), np.uint8), "2"),
        ("frame", "str"),
    ],
)
def test_garbage_mid_track_raises_and_the_track_goes_on(video: tuple[Frames, Boxes], bad: Any, message: str) -> None:
    """A frame that cannot belong to the video is named; the next good one is answered as if it had not come."""
    tracker, undisturbed = started(video), started(video)
    run(tracker, video[0][1:3]), run(undisturbed, video[0][1:3])
    with pytest.raises(InputError, match=message):
        tracker.update(bad)
    assert run(tracker, video[0][3:7]) == run(undisturbed, video[0][3:7])


@pytest.mark.parametrize(
    "convert",
    [
        pytest.param(lambda f: f[:, :, ::1].copy(order="F"), id="fortran"),
        pytest.param(lambda f: np.repeat(f, 2, axis=1)[:, ::2], id="strided"),
        pytest.param(lambda f: np.dstack([f, np.full(f.shape[:2], 9, np.uint8)]), id="bgra"),
        pytest.param(lambda f: cv2.UMat(f), id="umat"),
        pytest.param(lambda f: np.ascontiguousarray(f[:, :, ::-1])[:, :, ::-1], id="reversed-channels"),
        pytest.param(lambda f: np.pad(f, ((3, 4), (5, 6), (0, 0)))[3:-4, 5:-6], id="part-of-a-larger-frame"),
    ],
)
def test_layouts_give_identical_boxes(video: tuple[Frames, Boxes], convert: Callable[[Any], Any]) -> None:
    """The same pixels in another layout give the same track."""
    tracker = TrackerHS_create()
    tracker.init(convert(video[0][0]), video[1][0])
    assert run(tracker, [convert(frame) for frame in video[0][1:5]]) == run(started(video), video[0][1:5])


@pytest.mark.parametrize(
    "convert",
    [
        pytest.param(lambda f: cv2.cvtColor(f, cv2.COLOR_BGR2GRAY), id="gray"),
        pytest.param(lambda f: cv2.cvtColor(f, cv2.COLOR_BGR2GRAY)[:, :, None], id="gray-1-channel"),
        pytest.param(lambda f: f.astype(np.uint16) * 257, id="uint16"),
        pytest.param(lambda f: f.astype(np.float32) / 255, id="float-0-1"),
        pytest.param(lambda f: f.astype(np.float64), id="float-0-255"),
        pytest.param(lambda f: f.astype(np.int64), id="int64"),
        pytest.param(lambda f: (f // 2).astype(np.int8), id="int8"),
    ],
)
def test_every_dtype_is_tracked(video: tuple[Frames, Boxes], convert: Callable[[Any], Any]) -> None:
    """Gray, 16-bit and float video work, and whole numbers of any other type."""
    tracker = TrackerHS_create()
    tracker.init(convert(video[0][0]), video[1][0])
    for frame, truth in zip(video[0][1:], video[1][1:], strict=True):
        ok, box = tracker.update(convert(frame))
        assert ok
        assert iou(Box(*box), Box(*truth)) > BOX_IOU


def test_frames_are_neither_changed_nor_kept(video: tuple[Frames, Boxes]) -> None:
    """Read-only frames serve, and a caller who reuses one buffer gets the same boxes."""
    tracker = TrackerHS_create()
    buffer = video[0][0].copy()
    tracker.init(buffer, video[1][0])
    answers = []
    for frame in video[0][1:6]:
        buffer[:] = frame
        buffer.flags.writeable = False
        answers.append(tracker.update(buffer))
        buffer.flags.writeable = True
        buffer[:] = 255
    assert answers == run(started(video), video[0][1:6])


def test_init_again_forgets_everything(video: tuple[Frames, Boxes]) -> None:
    """A second init on the same object equals a new object."""
    tracker = started(video)
    run(tracker, video[0][1:6])
    tracker.init(video[0][0], video[1][0])
    assert run(tracker, video[0][1:]) == run(started(video), video[0][1:])


def test_init_again_on_another_size(video: tuple[Frames, Boxes]) -> None:
    """A new video of another size needs only a new init."""
    tracker = started(video)
    small = [cv2.resize(frame, (80, 60)) for frame in video[0]]
    tracker.init(small[0], tuple(value // 2 for value in video[1][0]))
    assert tracker.update(small[1])[0] is True


@pytest.mark.parametrize("duplicate", [copy.deepcopy, lambda t: pickle.loads(pickle.dumps(t))])
def test_copies_mid_track_go_on_alone(
    video: tuple[Frames, Boxes], duplicate: Callable[[TrackerHS], TrackerHS]
) -> None:
    """Pickle and deepcopy carry the whole track and share nothing."""
    tracker = started(video)
    run(tracker, video[0][1:5])
    twin = duplicate(tracker)
    expected = run(tracker, video[0][5:])
    assert run(twin, video[0][5:]) == expected


@pytest.mark.parametrize("dtype", [">u2", "<u2", ">f4", "<f4", ">f8"])
@pytest.mark.parametrize("updates", [0, 3])
def test_frames_of_foreign_byte_order_are_answered_alike_after_a_pickle(
    video: tuple[Frames, Boxes], dtype: str, updates: int
) -> None:
    """A pickle gives arrays back in this machine's byte order: the first frame is known again all the same."""
    frames = [(frame * (257.0 if "u" in dtype else 1 / 255)).astype(dtype) for frame in video[0][:7]]
    tracker = TrackerHS_create()
    tracker.init(frames[0], video[1][0])
    run(tracker, frames[1 : updates + 1])
    twin = pickle.loads(pickle.dumps(tracker))
    for frame in (frames[0], *frames[updates + 1 :]):
        assert (twin.update(frame), twin.box) == (tracker.update(frame), tracker.box)


def test_two_runs_are_equal(video: tuple[Frames, Boxes]) -> None:
    """Nothing is random."""
    assert run(started(video), video[0][1:]) == run(started(video), video[0][1:])


def test_a_still_object_is_held(video: tuple[Frames, Boxes]) -> None:
    """When the object stops, the box stays on it; fresh noise each frame."""
    tracker = started(video)
    run(tracker, video[0][1:])
    rng = np.random.default_rng(5)
    for _ in range(15):
        noisy = np.clip(video[0][-1] + rng.normal(0, 1.5, video[0][-1].shape), 0, 255).astype(np.uint8)
        ok, box = tracker.update(noisy)
        assert ok
        assert iou(Box(*box), Box(*video[1][-1])) > 0.85


def test_score_state_box_and_debug(video: tuple[Frames, Boxes]) -> None:
    """What the tracker knows beyond cv2's interface agrees with its answer."""
    tracker = started(video)
    ok, box = tracker.update(video[0][1])
    assert ok
    assert 0.0 <= tracker.getTrackingScore() <= 1.0
    assert tracker.state == "tracking"
    assert tracker.box is not None
    assert tracker.box.rounded() == box
    debug = tracker.debug()
    height, width = debug.current.shape
    assert debug.flow.shape == (height, width, 2)
    for plane in (debug.Fx, debug.Fy, debug.Ft, debug.previous):
        assert plane.shape == (height, width)
    assert debug.normal_flow.shape == (height, width, 2)
    assert debug.mask is None or debug.mask.shape == (height, width)


def test_debug_shows_what_the_last_update_saw(video: tuple[Frames, Boxes]) -> None:
    """Window, derivatives, flow and mask are those of the last two frames: the paper's signs, the object's motion."""
    tracker = started(video, mode="segmentation")
    run(tracker, video[0][1:6])
    debug, (x, y, w, h) = tracker.debug(), video[1][5]
    assert debug.mask is not None
    np.testing.assert_allclose(debug.Ft.mean(), (debug.current - debug.previous).mean(), atol=0.05)
    rows, columns = np.nonzero(debug.mask)
    assert debug.window.x + (columns.mean() + 0.5) * debug.step == pytest.approx(x + w / 2, abs=1.5)
    assert debug.window.y + (rows.mean() + 0.5) * debug.step == pytest.approx(y + h / 2, abs=1.5)
    np.testing.assert_allclose(np.median(debug.flow[debug.mask], axis=0) * debug.step, (2.0, 1.0), atol=0.1)
    along = -debug.Ft / np.maximum(np.hypot(debug.Fx, debug.Fy), 1e-3)
    steep = np.hypot(debug.Fx, debug.Fy) > 5.0
    np.testing.assert_allclose(np.linalg.norm(debug.normal_flow, axis=2)[steep], np.abs(along)[steep], rtol=0.05)


@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
def test_a_loss_is_said_and_the_object_is_found_again(mode: str) -> None:
    """Gone: zeros, another state, a lower score, and no exception for as long as it takes. Back: the box is on it."""
    rng = np.random.default_rng(9)
    frames, boxes = moving_square(rng, count=30)
    ground = moving_square(np.random.default_rng(9), count=1, side=1)[0][0].astype(float)
    empty = [np.clip(ground + rng.normal(0, 1.0, ground.shape), 0, 255).astype(np.uint8) for _ in range(12)]
    tracker = started((frames, boxes), mode=mode)
    assert all(ok for ok, _ in run(tracker, frames[1:12]))
    sure = tracker.getTrackingScore()
    gone = run(tracker, empty)
    assert gone[-1] == (False, NOWHERE)
    assert all(box == NOWHERE for ok, box in gone if not ok)
    assert tracker.state in ("occluded", "lost")
    assert tracker.getTrackingScore() < sure
    back = run(tracker, frames[12:])
    assert back[-1][0]
    assert tracker.state == "tracking"
    assert iou(Box(*back[-1][1]), Box(*boxes[-1])) > 0.6


@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
def test_the_score_falls_before_the_loss(mode: str) -> None:
    """Going behind a wall, the object is given up after the score has warned, and is found on the other side."""
    frames, boxes, _ = behind_wall()
    tracker = started((frames, boxes), mode=mode)
    told = [(tracker.update(frame)[0], tracker.getTrackingScore(), tracker.state) for frame in frames[1:]]
    lost = [ok for ok, _, _ in told].index(False)
    assert min(score for _, score, _ in told[:8]) > 0.9
    assert told[lost - 1][1] < 0.7
    assert told[lost][1] < told[lost - 1][1] + 0.05
    assert mode == "patch_tracker" or "occluded" in [state for _, _, state in told]
    assert all(ok and score > 0.9 and state == "tracking" for ok, score, state in told[-5:])
    assert iou(Box(*tracker.box or ()), boxes[-1]) > 0.85


def test_a_sure_carried_box_answers_where_segmentation_sees_nothing(
    video: tuple[Frames, Boxes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Segmentation calls the object hidden in full view."""
    frames, boxes = video
    tracker = TrackerHS()
    tracker.init(frames[0], boxes[0])
    tracker.update(frames[1])
    step = segmentation.step

    def blind(state: segmentation.SegmentationState, *rest: Any) -> segmentation.SegmentationState:
        seen = step(state, *rest)
        return seen.replace(estimate=seen.estimate.replace(ok=False, occluded=True, score=0.0))

    monkeypatch.setattr(segmentation, "step", blind)
    for frame, box in zip(frames[2:6], boxes[2:6], strict=True):
        ok, answer = tracker.update(frame)
        assert ok
        assert iou(Box(*answer), Box(*box)) > 0.7
        assert tracker.getTrackingScore() > 0.9


def test_a_tracker_can_be_referred_to_weakly(video: tuple[Frames, Boxes]) -> None:
    """Unlike cv2's; it goes when the last strong reference does, whatever copies there are."""
    tracker = started(video)
    tracker.update(video[0][1])
    reference, twin = weakref.ref(tracker), copy.copy(tracker)
    assert reference() is tracker
    del tracker
    gc.collect()
    assert reference() is None
    assert twin.update(video[0][2])[0]


def test_debug_before_update_is_a_clear_error(video: tuple[Frames, Boxes]) -> None:
    """There is nothing to show before the first update."""
    with pytest.raises(InputError, match="update"):
        started(video).debug()


def test_params_are_cv2_like() -> None:
    """`TrackerHS.Params` is `TrackerHS_Params`; a tracker copies what it gets."""
    assert TrackerHS.Params is TrackerHS_Params
    assert isinstance(TrackerHS.create(TrackerHS_Params()), TrackerHS)
    assert isinstance(TrackerHS_create(parameters=None), TrackerHS)


def test_never_a_cv2_tracker() -> None:
    """Inheritance from cv2.Tracker corrupts memory; the tracker is duck-typed."""
    assert not issubclass(TrackerHS, cv2.Tracker)


class TestIdioms:
    """What users' code does with a tracker."""

    def test_drawing_and_slicing_with_the_box(self, video: tuple[Frames, Boxes]) -> None:
        """cv2.rectangle and slices take the box as it is."""
        tracker = started(video)
        _, box = tracker.update(video[0][1])
        cv2.rectangle(video[0][1].copy(), box, (0, 255, 0), 2)
        x, y, w, h = [int(value) for value in box]
        assert video[0][1][y : y + h, x : x + w].size > 0

    def test_factory_table(self, video: tuple[Frames, Boxes]) -> None:
        """`OPENCV_OBJECT_TRACKERS[name]()` with `ok = tracker.init(...)` ignored."""
        table: dict[str, Callable[[], Any]] = {"hs": TrackerHS_create, "hs-legacy": legacy.TrackerHS_create}
        for factory in table.values():
            tracker = factory()
            _ = tracker.init(video[0][0], video[1][0])
            assert tracker.update(video[0][1])[0]

    def test_ask_again_after_a_cancelled_selection(self, video: tuple[Frames, Boxes]) -> None:
        """A cancelled cv2.selectROI gives zeros; `except Exception` must see it."""
        tracker = TrackerHS_create()
        for roi in [(0, 0, 0, 0), video[1][0]]:
            try:
                tracker.init(video[0][0], roi)
            except Exception:
                continue
        assert tracker.update(video[0][1])[0]


class TestLegacy:
    """The cv2.legacy flavour."""

    def test_init_answers_with_a_bool_and_boxes_are_floats(self, video: tuple[Frames, Boxes]) -> None:
        """True, then floats equal to the sub-pixel box."""
        tracker = legacy.TrackerHS_create()
        assert tracker.init(video[0][0], video[1][0]) is True
        ok, box = tracker.update(video[0][1])
        assert ok
        assert [type(value) for value in box] == [float] * 4
        assert tuple(tracker.tracker.box or ()) == box

    @pytest.mark.parametrize("roi", [(0, 0, 0, 0), (1, 2, 3), (900, 900, 20, 20), None])
    def test_bad_init_is_false_and_update_then_false(self, video: tuple[Frames, Boxes], roi: Any) -> None:
        """No exception, no crash."""
        tracker = legacy.TrackerHS_create()
        assert tracker.init(video[0][0], roi) is False
        assert tracker.update(video[0][1]) == (False, (0.0, 0.0, 0.0, 0.0))

    def test_no_frame_is_false_and_the_track_goes_on(self, video: tuple[Frames, Boxes]) -> None:
        """A dropped frame costs one False; a frame of another video is an error, as in cv2.legacy, and no damage."""
        tracker, undisturbed = legacy.TrackerHS_create(), legacy.TrackerHS_create()
        for one in (tracker, undisturbed):
            assert one.init(video[0][0], video[1][0]) is True
        assert tracker.update(None) == (False, (0.0, 0.0, 0.0, 0.0))
        with pytest.raises(cv2.error, match="160 × 120"):
            tracker.update(video[0][1][::2])
        assert run(tracker, video[0][1:4]) == run(undisturbed, video[0][1:4])
        assert tracker.getTrackingScore() == undisturbed.getTrackingScore()

    def test_init_again_and_copies_work_as_without_legacy(self, video: tuple[Frames, Boxes]) -> None:
        """A second init forgets; pickle and deepcopy carry the track."""
        tracker = legacy.TrackerHS_create(TrackerHS_Params(mode="segmentation"))
        tracker.init(video[0][0], video[1][0])
        run(tracker, video[0][1:4])
        twins = [copy.deepcopy(tracker), pickle.loads(pickle.dumps(tracker))]
        expected = run(tracker, video[0][4:8])
        assert [run(twin, video[0][4:8]) for twin in twins] == [expected] * 2
        assert tracker.init(video[0][0], video[1][0]) is True
        assert run(tracker, video[0][1:4])[0][0]
