"""No frame and no ROI, of whatever kind, crashes the tracker, hangs it or damages a track.

A few hundred generated examples here; ``python -m benchmarks.fuzz`` makes 10,000 fresh ones of each test.
"""

from __future__ import annotations

import copy
import functools
import math
import os
import time
import tracemalloc
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hs_tracker_cv import (
    AutomaticTracker,
    Box,
    HornSchunck,
    MotionDetector,
    MultiTrackerHS,
    TrackerHS,
    TrackerHS_create,
    TrackerHS_Params,
)
from hs_tracker_cv.display import draw_box
from hs_tracker_cv.flow import derivatives
from hs_tracker_cv.frames import InputError
from tests.conftest import moving_square

LONG = int(os.environ.get("HS_FUZZ", "0"))
"""Number of fresh examples in the long run, which :mod:`benchmarks.fuzz` makes."""

SLOWEST = 1.0
"""CPU seconds that no call may take on a frame of this size; CPU, so that a busy machine does not count."""

NOWHERE = (0, 0, 0, 0)
SHAPE = (48, 64)
ROI = (13, 9, 18, 18)
KINDS = [("uint8", 3), ("uint8", 1), ("uint16", 3), ("float32", 3), ("float64", 1)]
"""Frames a video may have: dtype and channels."""

Answer = tuple[bool, tuple[int, int, int, int]]

DTYPES = (
    "uint8 uint16 float16 float32 float64 longdouble int8 int16 int32 int64 uint32 uint64 bool complex64 "
    "object datetime64[s] S3 U2 >u2 >f4 >i4"
).split()
FILLS = ("zeros", "largest", "random", "nan", "inf", "mixed", "flat", "checker")
LAYOUTS = ("c", "fortran", "strided", "reversed", "read-only", "broadcast", "masked", "matrix")


class Contrary:
    """An object of a caller's that raises whatever is asked of it."""

    def __len__(self) -> int:
        raise RuntimeError("no length")

    def __float__(self) -> float:
        raise RuntimeError("no number")

    def __array__(self, *arguments: Any, **options: Any) -> NDArray[Any]:
        raise RuntimeError("no array")


class Speechless(Contrary):
    """One that cannot even be printed; no generated example, since hypothesis prints those."""

    def __repr__(self) -> str:
        raise RuntimeError("no words")


class Convertible:
    """No array, but NumPy can make one of it."""

    def __array__(self, *arguments: Any, **options: Any) -> NDArray[Any]:
        return np.zeros((*SHAPE, 3), np.uint8)


NOT_IMAGES: tuple[Any, ...] = (
    None,
    "frame.png",
    b"\x00" * 64,
    7,
    math.nan,
    [[1, 2], [3, 4]],
    (),
    {},
    object(),
    np.uint8(3),
    memoryview(bytes(12)),
    range(9),
    Exception("frame"),
    Contrary(),
    Convertible(),
)


def examples(count: int) -> settings:
    """Settings of a generated test: the same `count` examples every time, or fresh ones in the long run."""
    return settings(
        max_examples=LONG or count,
        derandomize=not LONG,
        deadline=None,
        print_blob=True,
        database=None,
        suppress_health_check=list(HealthCheck),
    )


def filled(shape: tuple[int, ...], dtype: str, fill: str, seed: int) -> NDArray[Any]:
    """An array of any dtype, as bad as its dtype allows."""
    kind, rng = np.dtype(dtype).kind, np.random.default_rng(seed)
    if kind not in "uif":
        return np.zeros(shape, dtype) if fill == "zeros" else rng.integers(0, 9, shape).astype(dtype)
    limits = np.finfo(dtype) if kind == "f" else np.iinfo(dtype)
    constants = {"zeros": 0, "flat": 100, "largest": limits.max}
    if kind == "f":
        constants |= {"flat": 0.4, "nan": math.nan, "inf": math.inf}
    if fill in constants:
        return np.full(shape, constants[fill], dtype)
    image = rng.integers(0, 120, shape)
    if fill == "checker":
        image = np.indices(shape).sum(axis=0) % 2 * 120
    if kind != "f":
        return np.asarray(image, dtype)
    values = image / (120.0 if seed % 2 else 1.0)
    if fill == "mixed":
        values = np.where(rng.random(shape) < 0.1, math.nan, np.where(rng.random(shape) < 0.1, -math.inf, values))
    return np.asarray(values, dtype)


def laid_out(image: NDArray[Any], layout: str) -> NDArray[Any]:
    """The same values in another memory layout."""
    if layout == "fortran":
        return np.asfortranarray(image)
    if layout == "strided" and image.ndim:
        return np.repeat(image, 2, axis=0)[::2]
    if layout == "reversed":
        return image[tuple(slice(None, None, -1) for _ in image.shape)]
    if layout == "broadcast" and image.ndim and image.shape[0]:
        return np.broadcast_to(image[:1], image.shape)
    if layout == "masked":
        return np.ma.masked_array(image, mask=np.arange(image.size).reshape(image.shape) % 3 == 0)
    if layout == "matrix" and image.ndim == 2:
        return image.view(np.matrix)
    if layout == "read-only":
        image.flags.writeable = False
    return image


def shapes() -> st.SearchStrategy[tuple[int, ...]]:
    """Mostly frames of the size of the video, in any number of channels; also any shape at all."""
    right = st.sampled_from([SHAPE, *((*SHAPE, channels) for channels in (1, 3, 4))])
    other = st.sampled_from(
        [(24, 32), (*SHAPE, 2), (*SHAPE, 0), (0, 64, 3), (48, 0), (1, 1, 3), (64, 48, 3), (4, 300)]
    )
    return st.one_of(right, right, other, st.lists(st.integers(0, 9), max_size=5).map(tuple))


@st.composite
def images(draw: st.DrawFn, dtypes: tuple[str, ...] = tuple(DTYPES)) -> NDArray[Any]:
    """Arrays of any dtype, shape, layout and content."""
    dtype = draw(st.sampled_from(dtypes))
    image = filled(draw(shapes()), dtype, draw(st.sampled_from(FILLS)), draw(st.integers(0, 9)))
    return laid_out(image, draw(st.sampled_from(LAYOUTS)))


@st.composite
def umats(draw: st.DrawFn) -> Any:
    """OpenCV's own image type, empty or not."""
    image = draw(images(("uint8", "uint16", "float32", "float64", "int16", "int32")))
    assume(image.ndim in (2, 3) and image.size and not isinstance(image, np.ma.MaskedArray))
    return draw(st.sampled_from([cv2.UMat(np.ascontiguousarray(image)), cv2.UMat()]))


def anything() -> st.SearchStrategy[Any]:
    """Whatever a caller may pass for a frame."""
    return st.one_of(images(), images(), images(("uint8", "float32")), umats(), st.sampled_from(NOT_IMAGES))


def numbers() -> st.SearchStrategy[Any]:
    """Whatever may stand in a ROI."""
    return st.one_of(
        st.integers(-80, 120),
        st.floats(-80, 120),
        st.floats(),
        st.integers(),
        st.sampled_from([10**400, -(10**400), 2**63, math.nan, math.inf, -math.inf, 1e308, 5e-324, True, None, "12"]),
        st.sampled_from([Decimal("20.5"), Fraction(41, 2), np.int8(20), np.float32(20.5), 3 + 4j, [20], (), b"20"]),
        st.sampled_from([Decimal("sNaN"), Contrary(), np.ma.masked, np.float32(math.nan), {}]),
    )


def rois() -> st.SearchStrategy[Any]:
    """Whatever a caller may pass for a ROI."""
    arrays = st.builds(
        filled,
        st.sampled_from([(4,), (1, 4), (4, 1), (2, 2), (3,), (5,), (0,), ()]),
        st.sampled_from(DTYPES),
        st.sampled_from(FILLS),
        st.integers(0, 9),
    )
    four = st.tuples(*[numbers()] * 4)
    return st.one_of(
        four,
        four.map(list),
        st.lists(numbers(), max_size=6),
        arrays,
        st.sampled_from(
            [
                None,
                "",
                "1234",
                b"1234",
                5,
                {},
                {1, 2, 3, 4},
                dict.fromkeys(range(4)),
                object(),
                iter("ab"),
                Contrary(),
            ]
        ),
    )


def video(dtype: str = "uint8", channels: int = 3, count: int = 10) -> list[NDArray[Any]]:
    """A textured square of 18 px crossing a textured ground, 64 × 48, in any supported kind of frame."""
    frames, _ = moving_square(np.random.default_rng(11), count=count, side=18)
    small = [np.ascontiguousarray(frame[21:69, 17:81]) for frame in frames]
    if channels == 1:
        small = [cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in small]
    gain = {"uint8": 1.0, "uint16": 257.0}.get(dtype, 1 / 255)
    return [(frame * np.float64(gain)).astype(dtype) for frame in small]


def in_time(tracker: TrackerHS, call: Callable[[TrackerHS], Any]) -> Any:
    """Make a call and see that it takes less than a second; a first slow one may have been a compilation."""
    # The track is replaced, never changed in place, so a shallow copy is the tracker as it was.
    before = copy.copy(tracker)
    start = time.thread_time()
    try:
        return call(tracker)
    finally:
        if time.thread_time() - start > SLOWEST:
            start = time.thread_time()
            try:
                call(before)
            except InputError:
                pass
            assert time.thread_time() - start < SLOWEST


def update(tracker: TrackerHS, frame: Any) -> Answer | str:
    """A well-formed answer, or ``"refused"``: anything else fails the test."""
    # What is below a mask counts too.
    pixels = np.asarray(frame) if isinstance(frame, np.ndarray) and frame.dtype != object else None
    before = None if pixels is None else pixels.tobytes()
    try:
        answer = in_time(tracker, lambda one: one.update(frame))
    except InputError:
        return "refused"
    assert pixels is None or pixels.tobytes() == before
    ok, box = answer
    assert type(ok) is bool
    assert [type(value) for value in box] == [int] * 4
    assert 0.0 <= tracker.getTrackingScore() <= 1.0
    assert tracker.box is not None
    assert all(math.isfinite(value) for value in tracker.box)
    if not ok:
        assert box == NOWHERE
        return answer
    inside = Box(*box).clip(SHAPE[1], SHAPE[0])
    assert inside.w >= 1, f"{box} lies outside the frame"
    assert inside.h >= 1, f"{box} lies outside the frame"
    return answer


def known(tracker: TrackerHS) -> tuple[Any, ...]:
    """Everything a caller can see of a track."""
    return tracker.state, tracker.box, tracker.getTrackingScore(), tracker.initialised


def is_frame(thing: Any) -> bool:
    """Whether a thing is one of the images the documentation names."""
    if isinstance(thing, cv2.UMat):
        thing = thing.get()
    if not isinstance(thing, np.ndarray) or thing.size == 0 or thing.ndim not in (2, 3):
        return False
    return thing.dtype.kind in "buif" and (thing.ndim == 2 or thing.shape[2] in (1, 3, 4))


@functools.cache
def mid_track(kind: tuple[str, int]) -> TrackerHS:
    """A tracker in the middle of a video of this kind of frame; to be copied, not used."""
    frames, tracker = video(*kind), TrackerHS_create()
    tracker.init(frames[0], ROI)
    for frame in frames[1:5]:
        tracker.update(frame)
    return tracker


@examples(200)
@given(thing=anything())
def test_init_takes_frames_and_refuses_all_else(thing: Any) -> None:
    """What is not a frame is an InputError and leaves the tracker uninitialised; every frame can be updated on."""
    tracker = TrackerHS_create()
    roi = (2, 2, 18, 18)
    frame = thing.get() if isinstance(thing, cv2.UMat) else thing
    usable = is_frame(thing) and frame.shape[0] >= 6 and frame.shape[1] >= 6
    if usable and frame.dtype.kind == "f":
        usable = bool(np.isfinite(frame[2:20, 2:20]).any())
    try:
        in_time(tracker, lambda one: one.init(thing, roi))
    except InputError:
        assert not usable
        assert tracker.state == "uninitialised"
        return
    assert usable
    assert known(tracker) == ("tracking", Box(*roi).clip(frame.shape[1], frame.shape[0]), 1.0, True)
    for _ in range(2):
        ok, box = tracker.update(thing)
        assert box == NOWHERE or ok


@examples(200)
@given(roi=rois())
def test_any_roi_starts_a_track_or_is_an_input_error(roi: Any) -> None:
    """No ROI ends in another exception; a refused one leaves nothing behind, a taken one lies in the frame."""
    tracker, frames = TrackerHS_create(), video(count=2)
    try:
        in_time(tracker, lambda one: one.init(frames[0], roi))
    except InputError:
        assert tracker.state == "uninitialised"
        tracker.init(frames[0], ROI)
        assert tracker.box == Box(*ROI)
        return
    box = tracker.box
    assert box is not None
    assert box == box.clip(SHAPE[1], SHAPE[0])
    assert min(box.w, box.h) >= 4 - 1e-6
    assert update(tracker, frames[1]) != "refused"


@examples(200)
@given(roi=st.tuples(*[st.one_of(st.floats(-70, 90), st.integers(-70, 90), st.floats())] * 4))
def test_rois_of_four_numbers_are_taken_exactly_when_enough_is_inside(roi: tuple[float, ...]) -> None:
    """At least 4 × 4 px as given and inside the frame: taken and clipped; all else is refused."""
    x, y, w, h = roi
    tracker = TrackerHS_create()
    enough = all(math.isfinite(value) for value in roi) and w >= 4 and h >= 4
    least = 4 - 1e-6  # of a box of 4 px not at whole numbers, the arithmetic of its edges may leave a little less
    enough = enough and min(x + w, SHAPE[1]) - max(x, 0) >= least and min(y + h, SHAPE[0]) - max(y, 0) >= least
    if enough:
        tracker.init(video(count=1)[0], roi)
        assert tracker.initialised
    else:
        with pytest.raises(InputError):
            tracker.init(video(count=1)[0], roi)
        assert not tracker.initialised


@examples(80)
@given(thing=anything(), kind=st.sampled_from(KINDS))
def test_any_object_mid_track_is_answered_or_refused(thing: Any, kind: tuple[str, int]) -> None:
    """What cannot be a frame of the video changes nothing; what can is answered, and the next good frame too."""
    tracker, twin = copy.deepcopy(mid_track(kind)), copy.deepcopy(mid_track(kind))
    good = video(*kind)[5:7]
    before = known(tracker)
    empty = thing is None or (isinstance(thing, np.ndarray) and thing.size == 0)
    empty = empty or (isinstance(thing, cv2.UMat) and thing.get() is None)
    answer = update(tracker, thing)
    if empty:
        assert answer == (False, NOWHERE)
    if empty or answer == "refused":
        assert known(tracker) == before
        assert [update(tracker, frame) for frame in good] == [update(twin, frame) for frame in good]
    else:
        assert is_frame(thing)
        assert [update(tracker, frame) for frame in good].count("refused") == 0


@pytest.mark.parametrize(
    "roi",
    [
        np.array([10, 10, 20, 20], complex),
        ["10", "10", "20", "20"],
        np.array(["10", "10", "20", "20"]),
        np.array([10, 10, 20, 20], "datetime64[s]"),
        (10**400, 0, 20, 20),
        (0, 0, 1e308, math.inf),
        {0: 10, 1: 10, 2: 20, 3: 20},
        (value for value in (10, 10, 20, 20)),
        (10**5000, 0, 20, 20),
        (Contrary(), 0, 20, 20),
        (Speechless(), 0, 20, 20),
        Speechless(),
        (Decimal("sNaN"), 0, 20, 20),
        np.zeros(1, [("x", "i4"), ("y", "i4"), ("w", "i4"), ("h", "i4")])[0],
        ((10, 10), (20, 20), 0.0),
        [[10, 10, 20, 20]],
        np.array([10, 10, 20, 20], bool),
    ],
    ids=lambda roi: type(roi).__name__,
)
def test_what_is_not_four_numbers_is_no_roi(roi: Any) -> None:
    """Complex numbers, words, dates, nests: an InputError, not a warning and not a guess."""
    with pytest.raises(InputError, match="boundingBox"):
        TrackerHS_create().init(video(count=1)[0], roi)


def test_a_long_bad_roi_is_named_by_its_beginning() -> None:
    """A whole array handed over by mistake does not fill the screen."""
    with pytest.raises(InputError, match=r"got \[0, 1, 2, .*…$") as refused:
        TrackerHS_create().init(video(count=1)[0], list(range(100_000)))
    assert len(str(refused.value)) < 300


@pytest.mark.parametrize(
    ("kind", "convert"),
    [
        pytest.param(("uint8", 1), lambda f: f.view(np.matrix), id="matrix"),
        pytest.param(("uint8", 3), lambda f: np.ma.masked_greater(f, 100), id="masked"),
        pytest.param(("uint8", 3), lambda f: f.view(Awkward), id="subclass"),
        pytest.param(("uint16", 3), lambda f: f.astype(">u2"), id="big-endian-uint16"),
        pytest.param(("float32", 3), lambda f: f.astype(">f4"), id="big-endian-float"),
        pytest.param(("float32", 3), lambda f: unaligned(f), id="unaligned"),
    ],
)
def test_unusual_arrays_give_the_boxes_of_plain_ones(
    kind: tuple[str, int], convert: Callable[[NDArray[Any]], NDArray[Any]]
) -> None:
    """Subclasses, masks, foreign byte order and odd addresses hold the same pixels."""
    tracker, twin, frames = TrackerHS_create(), TrackerHS_create(), video(*kind)
    tracker.init(convert(frames[0]), ROI)
    twin.init(frames[0], ROI)
    for frame in frames[1:6]:
        assert update(tracker, convert(frame)) == twin.update(frame)
        assert known(tracker) == known(twin)


class Awkward(np.ndarray[Any, Any]):
    """An array that lets nobody look inside."""

    def __getitem__(self, key: Any) -> Any:
        raise RuntimeError("no looking")

    def __array_ufunc__(self, *arguments: Any, **options: Any) -> Any:
        raise RuntimeError("no arithmetic")


def unaligned(frame: NDArray[Any]) -> NDArray[Any]:
    """The same values at an address that no number of their type may have."""
    raw = np.frombuffer(b"x" + frame.tobytes(), np.uint8)[1:].view(frame.dtype).reshape(frame.shape)
    assert not raw.flags.aligned
    return raw


@pytest.mark.parametrize("value", [np.finfo(np.float64).max, -np.finfo(np.float64).max, math.inf, math.nan])
@pytest.mark.parametrize("first", ["good", "bad"])
def test_values_beyond_all_bounds_are_silent(first: str, value: float) -> None:
    """What is infinite in float32 is no warning, and so no error to a user who makes errors of warnings."""
    frames, tracker = video("float64"), TrackerHS_create()
    bad = np.full_like(frames[0], value)
    if first == "bad" and not math.isfinite(value):
        with pytest.raises(InputError, match="expected a finite pixel"):
            tracker.init(bad, ROI)
        return
    tracker.init(frames[0] if first == "good" else bad, ROI)
    assert "refused" not in [update(tracker, frame) for frame in (bad, frames[1], bad, frames[2])]


def answers_of_the_library(kind: tuple[str, int], fill: str | None) -> list[Any]:
    """What every public function that computes says about a video; of frames half of which are bad, if asked for."""
    frames = [
        filled(frame.shape, kind[0], fill, index) if fill and index % 2 else frame
        for index, frame in enumerate(video(*kind))
    ]
    told: list[Any] = []
    for mode in ("auto", "segmentation", "patch_tracker"):
        tracker = TrackerHS_create(TrackerHS_Params(mode=mode, rotation=mode == "patch_tracker"))
        tracker.init(frames[0], tuple(np.array(ROI, np.longdouble)))
        for frame in frames[1:]:
            tracker.check(frame)
            told += [tracker.update(frame), known(tracker), tracker.debug().normal_flow.tobytes()]
    several, automatic = MultiTrackerHS(), AutomaticTracker()
    for frame in frames[:3:2]:  # every second one is bad, and may hold no object
        several.add(TrackerHS_create(), frame, ROI)
    told += [str(answer) for frame in frames[1:] for answer in (several.update(frame), automatic.update(frame))]
    for mode in ("classic", "solve", "fast", "default", "accurate"):
        told.append(HornSchunck(mode).calc(frames[2], frames[3]).tobytes())
    told += [region.box for region in MotionDetector().detect(frames[2], frames[4])]
    told += [plane.tobytes() for plane in derivatives(frames[2], frames[3])]
    told.append(draw_box(frames[3], Box(*ROI), score=0.5).tobytes())
    return told


@pytest.mark.parametrize("fill", [None, "zeros", "largest", "nan", "inf"])
@pytest.mark.parametrize("kind", [("uint8", 3), ("float64", 1)])
def test_a_users_error_state_changes_nothing(kind: tuple[str, int], fill: str | None) -> None:
    """Whatever is computed is the same under ``np.seterr(all="raise")``, and without a warning."""
    with np.errstate(all="raise"):
        raising = answers_of_the_library(kind, fill)
        with pytest.raises(FloatingPointError):
            np.float32(1e-30) * np.float32(1e-30)  # still what the user wants elsewhere
        with pytest.raises(InputError, match="boundingBox"):
            TrackerHS_create().init(video()[0], np.full(4, np.finfo(np.longdouble).max))
    assert raising == answers_of_the_library(kind, fill)


def test_frames_of_another_size_are_refused_unread() -> None:
    """Sizes are compared before anything is converted: frames of 20,000 × 20,000 that take no memory cost none."""
    frames, tracker = video("float32"), TrackerHS_create()
    tracker.init(frames[0], ROI)
    huge = [np.broadcast_to(np.array(0.5, dtype), (20_000, 20_000, 3)) for dtype in (np.uint8, np.float32, float)]
    calls: list[Callable[[Any], Any]] = [
        tracker.update,
        tracker.check,
        lambda frame: HornSchunck().calc(frame, frames[0]),
        lambda frame: HornSchunck().calc(frames[0], frame),
        lambda frame: MotionDetector().detect(frame, frames[0]),
        lambda frame: MotionDetector().detect(frames[0], frame),
        lambda frame: derivatives(frames[0], frame),
    ]
    tracemalloc.start()
    try:
        for call in calls:
            for frame in huge:
                with pytest.raises(InputError, match="20000 × 20000"):
                    call(frame)
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 1_000_000


@pytest.mark.parametrize("empty", [None, np.zeros((0, 5)), np.zeros((48, 0, 3), np.uint8), cv2.UMat()], ids=type)
def test_every_kind_of_dropped_frame_is_answered(empty: Any) -> None:
    """None and all that is empty cost one False."""
    tracker = copy.deepcopy(mid_track(("uint8", 3)))
    assert update(tracker, empty) == (False, NOWHERE)
    assert tracker.state == "tracking"


@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
@pytest.mark.parametrize("fill", FILLS)
@pytest.mark.parametrize("dtype", ["uint8", "uint16", "float32"])
def test_a_whole_video_of_bad_pixels_is_answered(dtype: str, fill: str, mode: str) -> None:
    """Black, white, noise, NaN: every frame after the first is answered, and init then works again."""
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    frames = [filled((*SHAPE, 3), dtype, fill, seed) for seed in range(8)]
    # A box without a number holds no object.
    tracker.init(video(dtype)[0] if dtype == "float32" and fill in ("nan", "inf") else frames[0], ROI)
    assert "refused" not in [update(tracker, frame) for frame in frames[1:]]
    good = video(dtype)
    tracker.init(good[0], ROI)
    assert update(tracker, good[0]) == (True, ROI)


@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
@pytest.mark.parametrize("roi", [(0, 0, 64, 48), (0, 0, 4, 4), (60, 44, 4, 4), (0, 20, 64, 4), (30, 0, 4, 48)])
def test_rois_of_every_extreme_are_tracked_without_a_fault(roi: tuple[int, int, int, int], mode: str) -> None:
    """The whole frame, the smallest box in a corner, slivers: every frame is answered."""
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    frames = video()
    tracker.init(frames[0], roi)
    assert "refused" not in [update(tracker, frame) for frame in frames[1:] + frames[::-1]]


@pytest.mark.parametrize("size", [(4, 4), (5, 200), (200, 5), (7, 7), (4, 3000), (3000, 4)])
def test_tiny_frames_are_tracked_without_a_fault(size: tuple[int, int]) -> None:
    """A frame hardly larger than the smallest ROI is a frame."""
    rng = np.random.default_rng(2)
    tracker = TrackerHS_create()
    tracker.init(rng.integers(0, 256, (*size, 3), dtype=np.uint8), (0, 0, 4, 4))
    for _ in range(6):
        ok, box = tracker.update(rng.integers(0, 256, (*size, 3), dtype=np.uint8))
        assert ok or box == NOWHERE


@pytest.mark.parametrize("mode", ["auto", "patch_tracker"])
@pytest.mark.parametrize("size", [(4, 40000), (40000, 4)])
def test_a_box_as_thin_as_a_line_is_tracked_without_a_fault(size: tuple[int, int], mode: str) -> None:
    """A box ten thousand times as long as it is wide, as the whole of its frame, is answered like any other."""
    rng = np.random.default_rng(2)
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(rng.integers(0, 256, size, dtype=np.uint8), (0, 0, *size[::-1]))
    for _ in range(3):
        ok, box = tracker.update(rng.integers(0, 256, size, dtype=np.uint8))
        assert ok or box == NOWHERE
    assert 0 <= tracker.getTrackingScore() <= 1


@pytest.mark.parametrize(("size", "roi"), [((1, 60), (0, 0, 60, 1)), ((60, 1), (0, 0, 1, 60)), ((3, 60), ROI)])
def test_frames_thinner_than_any_roi_are_refused_in_words(size: tuple[int, int], roi: tuple[int, ...]) -> None:
    """A line of pixels is a frame, but no ROI fits in: the error speaks of the ROI, and nothing is started."""
    tracker = TrackerHS_create()
    with pytest.raises(InputError, match="boundingBox"):
        tracker.init(np.zeros(size, np.uint8), roi)
    assert not tracker.initialised


def test_a_frame_of_8k_costs_what_its_window_costs() -> None:
    """Neither memory nor time grow with the frame: one that takes no memory at all stands in for it."""
    tracker, small = TrackerHS_create(), TrackerHS_create()
    large = [np.broadcast_to(np.uint8(level), (4320, 7680, 3)) for level in (5, 200, 7)]
    tracker.init(large[0], (100, 100, 300, 300))
    small.init(large[0][:600, :800], (100, 100, 300, 300))
    tracemalloc.start()
    try:
        answers = [in_time(tracker, lambda one, frame=frame: one.update(frame)) for frame in large[1:]]
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert answers == [small.update(frame[:600, :800]) for frame in large[1:]]
    assert most < large[0].size / 4


def leaving(step: tuple[int, int], count: int = 16) -> list[NDArray[np.uint8]]:
    """A textured square of 16 px that starts at (24, 16) and leaves the frame; noise of one gray level."""
    rng = np.random.default_rng(5)
    ground = cv2.GaussianBlur(rng.uniform(0, 255, (*SHAPE, 3)).astype(np.float32), (0, 0), 2.0)
    square = rng.uniform(0, 255, (16, 16, 3)).astype(np.float32)
    canvas = np.zeros((SHAPE[0] + 200, SHAPE[1] + 200, 3), np.float32)
    view, frames = canvas[100:-100, 100:-100], []
    for index in range(count):
        x, y = 124 + step[0] * index, 116 + step[1] * index
        view[:] = ground
        canvas[y : y + 16, x : x + 16] = square
        frames.append(np.clip(np.rint(view + rng.normal(0, 1.0, view.shape)), 0, 255).astype(np.uint8))
    return frames


@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
@pytest.mark.parametrize("step", [(5, 0), (-5, 0), (0, 5), (0, -5)])
def test_a_track_goes_on_after_its_object_left_the_frame(step: tuple[int, int], mode: str) -> None:
    """With its object outside on any side, it still looks at every frame that comes."""
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    frames = leaving(step)
    tracker.init(frames[0], (24, 16, 16, 16))
    assert "refused" not in [update(tracker, frame) for frame in frames[1:]]
    rng, looked_at = np.random.default_rng(1), []
    for _ in range(2):
        noisy = frames[-1] + rng.normal(0.0, 2.0, (*SHAPE, 3))
        update(tracker, np.clip(np.rint(noisy), 0, 255).astype(np.uint8))
        looked_at.append(tracker.debug().current.tobytes())
    assert looked_at[0] != looked_at[1]


@pytest.mark.parametrize("mode", ["auto", "segmentation"])
def test_a_gone_object_is_not_held_for_ever_in_a_video_without_noise(mode: str) -> None:
    """Frames that repeat bit by bit after the object went (a clean or compressed video) still end in False."""
    frames = video()
    # The square has moved by its own width: where it is now, the first frame shows the ground.
    empty = frames[9].copy()
    empty[18:36, 31:49] = frames[0][18:36, 31:49]
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(frames[0], ROI)
    assert tracker.update(frames[1])[0]
    for frame in frames[2:]:
        tracker.update(frame)
    answers = [update(tracker, empty) for _ in range(30)]
    assert answers[-1] == (False, NOWHERE)
