"""Calls in any order: a tracker that sees garbage, copies and reused buffers answers as its sheltered twin does.

Thirty generated sequences here; ``python -m benchmarks.fuzz calls`` makes 10,000.
"""

from __future__ import annotations

import copy
import pickle
from typing import Any

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from numpy.typing import NDArray

from hs_tracker_cv import TrackerHS, TrackerHS_create, TrackerHS_Params
from hs_tracker_cv.frames import InputError
from tests.test_robustness import (
    KINDS,
    NOWHERE,
    ROI,
    SHAPE,
    anything,
    examples,
    filled,
    is_frame,
    known,
    rois,
    update,
    video,
)

ROIS = [ROI, (0, 0, 30, 30), (40.5, 20.5, 40.0, 40.0), (20, 20, 4, 4), (0, 0, 64, 48), (-12, 5, 40, 20)]


class Twins(RuleBasedStateMachine):
    """`tracker` lives in the wild; `twin` gets fresh frames of the same video only, and is new after each init."""

    @initialize(kind=st.sampled_from(KINDS), mode=st.sampled_from(["auto", "auto", "segmentation", "patch_tracker"]))
    def begin(self, kind: tuple[str, int], mode: str) -> None:
        """Make both; nothing is initialised yet."""
        self.kind = kind
        self.parameters = TrackerHS_Params(mode=mode)
        self.frames = video(*kind)
        self.position = 0
        self.buffer = np.empty_like(self.frames[0])
        self.tracker = TrackerHS_create(self.parameters)
        self.twin = TrackerHS_create(self.parameters)

    def shown(self, frame: NDArray[Any]) -> NDArray[Any]:
        """The frame in the one buffer that this caller reuses."""
        self.buffer[:] = frame
        return self.buffer

    def scribble(self) -> None:
        """What a caller may do to a buffer between two calls."""
        self.buffer[:] = filled(self.buffer.shape, self.kind[0], "checker", 0)

    @rule(index=st.integers(0, 9), roi=st.sampled_from(ROIS))
    def start(self, index: int, roi: tuple[float, float, float, float]) -> None:
        """Init, again and again, equals a new tracker."""
        self.position = index
        self.tracker.init(self.shown(self.frames[index]), roi)
        self.scribble()
        self.twin = TrackerHS_create(self.parameters)
        self.twin.init(self.frames[index].copy(), roi)

    @rule(roi=rois())
    def start_on_any_roi(self, roi: Any) -> None:
        """A refused ROI leaves the tracker as new; a taken one starts it."""
        self.twin = TrackerHS_create(self.parameters)
        try:
            self.tracker.init(self.frames[0], roi)
        except InputError:
            return
        box = self.tracker.box
        assert box is not None
        self.twin.init(self.frames[0], box)
        self.position = 0

    @rule(thing=anything())
    def start_on_no_frame(self, thing: Any) -> None:
        """An image that is none leaves the tracker as new."""
        if is_frame(thing):
            return
        self.twin = TrackerHS_create(self.parameters)
        with pytest.raises(InputError):
            self.tracker.init(thing, ROI)

    @rule(step=st.sampled_from([1, 1, 1, 0, -1, 4]))
    def next_frame(self, step: int) -> None:
        """A frame of the video: the next, the same again, an earlier one, or a jump."""
        self.position = (self.position + step) % len(self.frames)
        self.both(self.frames[self.position])

    @rule(fill=st.sampled_from(["zeros", "largest", "random", "nan", "inf", "mixed"]), seed=st.integers(0, 3))
    def extreme_frame(self, fill: str, seed: int) -> None:
        """A frame of the right kind, and no sense in it, is answered."""
        self.both(filled(self.frames[0].shape, self.kind[0], fill, seed))

    def both(self, frame: NDArray[Any]) -> None:
        """The two answers to a frame are equal."""
        answer = update(self.tracker, self.shown(frame))
        self.scribble()
        assert answer == update(self.twin, frame.copy())
        assert (answer == "refused") == (not self.twin.initialised)

    @rule(thing=anything())
    def update_with_anything(self, thing: Any) -> None:
        """What cannot be a frame of this video is seen by the tracker only, and must leave no trace."""
        pixels = thing if isinstance(thing, np.ndarray) else None
        fits = is_frame(thing) and (
            pixels is None or (pixels.shape[:2] == SHAPE and (pixels.ndim == 2 or pixels.shape[2] != 2))
        )
        if fits:
            return
        answer = update(self.tracker, thing)
        assert answer in ("refused", (False, NOWHERE))

    @rule()
    def pickled(self) -> None:
        """The tracker goes through a pickle."""
        self.tracker = pickle.loads(pickle.dumps(self.tracker))

    @rule(copier=st.sampled_from([copy.copy, copy.deepcopy]), seed=st.integers(0, 3))
    def copied(self, copier: Any, seed: int) -> None:
        """The tracker is replaced by its copy, and what the original does then does not reach it."""
        original: TrackerHS = self.tracker
        self.tracker = copier(original)
        update(original, filled(self.frames[0].shape, self.kind[0], "random", seed))
        original.init(self.frames[0], (5, 5, 10, 10))
        update(original, self.frames[1])

    @precondition(lambda self: self.tracker.initialised)
    @rule()
    def looked_into(self) -> None:
        """Looking changes nothing, even when what was looked at is overwritten."""
        try:
            debug = self.tracker.debug()
        except InputError:
            return
        for value in vars(debug).values():
            if isinstance(value, np.ndarray) and value.flags.writeable:
                value[...] = 0
        self.tracker.parameters.mode = "segmentation"

    @invariant()
    def twins_are_equal(self) -> None:
        """All that a caller can see is the same."""
        if hasattr(self, "twin"):
            assert known(self.tracker) == known(self.twin)


TestTwins = Twins.TestCase
TestTwins.settings = examples(30)
