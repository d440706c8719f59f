"""Pickles that were edited: they are refused in words, or what they hold is tracked on; the process goes on.

A pickle is a program, and one made to do harm does it before this library is asked. These are pickles damaged by
accident, or edited by hand. ``python -m benchmarks.fuzz pickles`` makes 10,000.
"""

from __future__ import annotations

import copy
import dataclasses
import functools
import math
import pickle
from collections.abc import Iterator
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from hs_tracker_cv import MultiTrackerHS, TrackerHS, TrackerHS_create, TrackerHS_Params, legacy
from hs_tracker_cv import tracker as tracker_module
from hs_tracker_cv.arbitration import Track
from hs_tracker_cv.frames import InputError
from hs_tracker_cv.validation import Shape
from tests.test_robustness import NOWHERE, ROI, examples, known, video
from tests.test_robustness_tracks import Story, frames_of, stories

Path = tuple[str | int, ...]

VERSION = tracker_module.STATE_VERSION

NUMBERS = [0, -1, 1, 2, -5, 17, 1e5, -1e5, 10**6, 2**31 - 1, -(2**31), 2**63, 10**400, math.nan, math.inf, -math.inf]
ODDITIES: list[Any] = [*NUMBERS, 1e300, 1e-300, None, "3", "lost", "bad", b"", True, (), [], {}, object, 3j]


@functools.cache
def track(kind: tuple[str, int], mode: str, updates: int, gone: int) -> TrackerHS:
    """A tracker after some frames of the object and some without it; to be copied, not used."""
    frames = video(*kind)
    empty = frames[9].copy()
    empty[18:36, 31:49] = frames[0][18:36, 31:49]
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode, rotation=updates == 5))
    tracker.init(frames[0], ROI)
    for frame in [*frames[1 : updates + 1], *[empty] * gone]:
        tracker.update(frame)
    return tracker


def tracks() -> st.SearchStrategy[tuple[TrackerHS, list[NDArray[Any]]]]:
    """Trackers at all stages, and the video."""
    kinds = st.sampled_from([("uint8", 3), ("uint8", 1), ("uint16", 3)])
    stages = st.sampled_from([(0, 0), (1, 0), (5, 0), (9, 0), (6, 8)])
    modes = st.sampled_from(["auto", "segmentation", "patch_tracker"])
    return st.builds(lambda kind, mode, stage: (track(kind, mode, *stage), video(*kind)), kinds, modes, stages)


def names(holder: Any) -> list[str | int]:
    """What can be replaced in a value of the state."""
    if dataclasses.is_dataclass(holder):
        return [field.name for field in dataclasses.fields(holder)]
    if isinstance(holder, tuple):
        return [*getattr(holder, "_fields", range(len(holder)))]
    return []


def part(holder: Any, name: str | int) -> Any:
    """A part by its name."""
    return getattr(holder, name) if isinstance(name, str) else holder[name]


def paths(value: Any) -> Iterator[Path]:
    """Ways to all that is in a value."""
    for name in names(value):
        yield (name,)
        yield from ((name, *rest) for rest in paths(part(value, name)))


def at(value: Any, path: Path) -> Any:
    """What a way leads to."""
    return functools.reduce(part, path, value)


def edited(value: Any, path: Path, new: Any) -> Any:
    """A copy of a value with one thing in it replaced."""
    if not path:
        return new
    inner = edited(part(value, path[0]), path[1:], new)
    if dataclasses.is_dataclass(value):
        copied = copy.copy(value)
        object.__setattr__(copied, str(path[0]), inner)
        return copied
    items = [inner if name == path[0] else part(value, name) for name in names(value)]
    return type(value)._make(items) if hasattr(value, "_fields") else tuple(items)


@st.composite
def edits(draw: st.DrawFn, old: Any) -> Any:
    """What may stand in the place of a value."""
    if not isinstance(old, np.ndarray) or draw(st.integers(0, 5)) == 0:
        return draw(st.sampled_from(ODDITIES) if isinstance(old, str | type(None)) else st.sampled_from(NUMBERS))
    floating = old.dtype.kind in "fc"
    values = [0, 1, math.nan, math.inf, 3e38, -1e9, 1e14, 1e-40] if floating else [0, 1, 7, 255]
    filled = [np.full_like(old, value) for value in values]
    one_bad = old.copy()
    one_bad.flat[draw(st.integers(0, old.size - 1))] = values[3]
    random = np.random.default_rng(draw(st.integers(0, 99)))
    layouts = [
        old[1:],
        old[..., :-1],
        np.concatenate([old, old]),
        old.T,
        old[..., ::-1],
        old[np.newaxis],
        old.ravel(),
    ]
    layouts += [np.asfortranarray(old), np.broadcast_to(old[:1], old.shape), np.zeros((), old.dtype), old[:0]]
    layouts += [old.astype(np.float64), old.astype(np.complex128), old.astype(object), old.astype(">f8")]
    layouts += [random.permutation(old.ravel()).reshape(old.shape), one_bad]
    return draw(st.sampled_from(filled + layouts))


@pytest.mark.filterwarnings("ignore:Casting complex")
@examples(120)
@given(data=st.data(), case=tracks())
def test_an_edited_track_is_refused_or_goes_on(
    data: st.DataObject, case: tuple[TrackerHS, list[NDArray[Any]]]
) -> None:
    """Whatever stands where in the state: a ValueError from the pickle, or answers from the tracker."""
    original, frames = case
    state = original.__getstate__()
    whole = state["_track"]
    # The longer path first: after the shorter one, what it led to may be no more.
    for path in sorted(data.draw(st.sets(st.sampled_from(list(paths(whole))), min_size=1, max_size=2)), key=len)[
        ::-1
    ]:
        state["_track"] = edited(state["_track"], path, data.draw(edits(at(whole, path))))
    holder = TrackerHS(original.parameters)
    holder.__dict__.update(_track=state["_track"])
    try:
        # Through a pickle and, as a hand may do it, directly: then arrays keep their strides.
        trackers = [pickle.loads(pickle.dumps(holder)), TrackerHS()]
        trackers[1].__setstate__(state)
    except ValueError:
        return
    blank = np.zeros_like(frames[0])
    for tracker in trackers:
        for frame in (frames[9], frames[0], blank, frames[6], frames[7]):
            try:
                ok, box = tracker.update(frame)
            except InputError:  # what was edited is the size of the frames
                assert tracker._track.video != whole.video
                return
            assert ok or box == NOWHERE


@examples(100)
@given(case=tracks(), where=st.floats(0, 1, exclude_max=True), value=st.integers(0, 255), data=st.data())
def test_a_damaged_pickle_raises_or_goes_on(
    case: tuple[TrackerHS, list[NDArray[Any]]], where: float, value: int, data: st.DataObject
) -> None:
    """One byte changed, or the end lost."""
    original, frames = case
    pickled = bytearray(pickle.dumps(original))
    place = int(where * len(pickled))
    if data.draw(st.booleans()):
        assume(pickled[place] != value)
        pickled[place] = value
    else:
        del pickled[place:]
    try:
        tracker = pickle.loads(bytes(pickled))
    except Exception:  # Python's unpickler raises anything
        return
    if not isinstance(tracker, TrackerHS):
        return
    for frame in (frames[9], frames[0], frames[6]):
        try:
            ok, box = tracker.update(frame)
        except InputError:
            continue
        assert ok or box == NOWHERE


@examples(15)
@given(story=stories())
def test_every_true_track_goes_through_a_pickle(story: Story) -> None:
    """What the tracker itself has put into its state is never refused, and goes on as if nothing had been."""
    frames = frames_of(story)
    tracker = TrackerHS(TrackerHS_Params(mode=story.mode, rotation=story.rotation))
    tracker.init(frames[0], story.roi)
    for frame in frames[1:]:
        twin = pickle.loads(pickle.dumps(tracker))
        assert twin.update(frame) == tracker.update(frame)
        assert known(twin) == known(tracker)


def annotations(kind: Any, path: str) -> Iterator[tuple[str, Any]]:
    """All annotations of arrays in a class and what it holds."""
    if isinstance(kind, type) and (dataclasses.is_dataclass(kind) or hasattr(kind, "_fields")):
        for name, one in get_type_hints(kind, include_extras=True).items():
            yield from annotations(one, f"{path}.{name}")
    elif get_origin(kind) is np.ndarray or (
        get_origin(kind) is Annotated and get_origin(kind.__origin__) is np.ndarray
    ):
        yield path, kind
    else:
        for one in get_args(kind):
            yield from annotations(one, path)


def test_every_array_of_a_track_says_its_shape() -> None:
    """What is added to a state later is validated too, by its annotation: without a shape, it would not be."""
    told = dict(annotations(Track, "track"))
    assert len(told) > 30
    silent = [path for path, kind in told.items() if not any(isinstance(one, Shape) for one in get_args(kind))]
    assert not silent


@pytest.mark.parametrize(
    ("state", "words"),
    [
        (None, f"version {VERSION}, got version None"),
        ({}, f"version {VERSION}, got version None"),
        ({"version": VERSION + 1}, f"version {VERSION}, got version {VERSION + 1}"),
        ({"version": VERSION}, "_parameters to be TrackerHS_Params, got None"),
        ({"version": VERSION, "_parameters": TrackerHS_Params()}, "_track to be a Track, got 'nothing'"),
        ({"version": VERSION, "_parameters": {"mode": "auto"}, "_track": None}, "_parameters to be TrackerHS_Params"),
    ],
)
def test_another_version_or_half_a_state_is_refused(state: Any, words: str) -> None:
    """A pickle of another version of the library is named as such, and the tracker stays as it was."""
    tracker = copy.copy(track(("uint8", 3), "auto", 5, 0))
    before = known(tracker)
    with pytest.raises(ValueError, match=words):
        tracker.__setstate__(state)
    assert known(tracker) == before


@pytest.mark.parametrize("changes", [{"mode": "segmentation"}, {"mode": "patch_tracker"}, {"rotation": True}])
def test_a_track_belongs_to_its_parameters(changes: dict[str, Any]) -> None:
    """Parameters that ask for another mode than the track has are refused."""
    state = track(("uint8", 3), "auto", 1, 0).__getstate__()
    with pytest.raises(ValueError, match="expected a track as of TrackerHS_Params"):
        TrackerHS().__setstate__(state | {"_parameters": TrackerHS_Params(**changes)})


def test_what_a_user_adds_to_a_tracker_is_kept() -> None:
    """Attributes of a subclass go through pickle and copy as they did."""
    tracker = copy.copy(track(("uint8", 3), "auto", 1, 0))
    tracker.name = "left camera"  # type: ignore[attr-defined]
    assert [copier(tracker).name for copier in (copy.copy, copy.deepcopy)] == ["left camera"] * 2
    assert pickle.loads(pickle.dumps(tracker)).name == "left camera"


def test_a_read_only_pickle_is_tracked_on() -> None:
    """Buffers out of band (as joblib and Dask send them) may be read-only; the boxes are the same."""
    tracker, frames = copy.copy(track(("uint8", 3), "auto", 5, 0)), video()
    buffers: list[pickle.PickleBuffer] = []
    pickled = pickle.dumps(tracker, protocol=5, buffer_callback=buffers.append)
    assert buffers
    twin = pickle.loads(pickled, buffers=[bytes(buffer) for buffer in buffers])
    for frame in frames[6:]:
        assert twin.update(frame) == tracker.update(frame)


@pytest.mark.parametrize("value", [math.nan, math.inf, np.finfo(np.float32).max])
def test_a_track_of_pixels_that_are_no_numbers_goes_through_a_pickle(value: float) -> None:
    """What is kept of the first frame is the user's own, whatever it holds."""
    frames = video("float32")
    frames[0][12, 15] = value
    tracker = TrackerHS_create()
    tracker.init(frames[0], ROI)
    twin = pickle.loads(pickle.dumps(tracker))
    assert [twin.update(frame) for frame in frames[1:4]] == [tracker.update(frame) for frame in frames[1:4]]


@pytest.mark.parametrize("wrong", [None, "tracker", TrackerHS, []])
def test_edited_pickles_of_the_other_interfaces_are_refused(wrong: Any) -> None:
    """The legacy flavour holds a tracker, and a multi-tracker holds trackers, ids and boxes; nothing else."""
    frames = video()
    flavour = legacy.TrackerHS_create()
    with pytest.raises(ValueError, match="expected"):
        flavour.__setstate__({"tracker": wrong})
    multi = MultiTrackerHS()
    multi.add(TrackerHS_create(), frames[0], ROI)
    multi.update(frames[1])
    state = multi.__getstate__()
    for name in state:
        with pytest.raises((ValueError, TypeError), match="expected"):
            multi.__setstate__(state | {name: wrong})
    with pytest.raises(ValueError, match="expected"):
        multi.__setstate__(state | {"_followed": {1: (wrong, state["_followed"][1].video)}})
    with pytest.raises(TypeError, match="expected"):
        multi.__setstate__(state | {"_followed": {1: state["_followed"][1]._replace(tracker=wrong)}})
    assert multi.update(frames[2])[0]
