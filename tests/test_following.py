"""An object followed through frames, step by step."""

from __future__ import annotations

import io

import numpy as np
import pytest

from hs_tracker_cv import TrackerHS_Params
from hs_tracker_cv.following import Step, steps, write_header, write_row
from hs_tracker_cv.geometry import Box
from tests.conftest import moving_square


def test_a_video_that_repeats_its_first_frame_is_followed(rng: np.random.Generator) -> None:
    """Screen recordings begin so: there is nothing to show yet, and nothing goes wrong."""
    frames, boxes = moving_square(rng, count=4)
    video = [frames[0], frames[0].copy(), *frames]
    done = list(steps(iter(video), Box(*boxes[0]), show=True))
    assert [step.index for step in done] == list(range(6))
    assert [step.fields is None for step in done] == [True, True, True, False, False, False]
    assert {step.state for step in done} == {"tracking"}


@pytest.mark.parametrize("mode", ["segmentation", "patch_tracker"])
def test_the_parameters_reach_the_tracker(rng: np.random.Generator, mode: str) -> None:
    """The carried box has no mask, segmentation has one."""
    frames, boxes = moving_square(rng, count=3)
    parameters = TrackerHS_Params(mode=mode)
    *_, last = steps(iter(frames), Box(*boxes[0]), show=True, first=5, stride=3, parameters=parameters)
    assert last.index == 11
    assert last.fields is not None
    assert (last.fields.mask is None) == (mode == "patch_tracker")


def test_the_table_has_zeros_where_the_object_is_lost() -> None:
    """One row per frame, the box with two digits."""
    table = io.StringIO()
    write_header(table)
    write_row(table, Step(3, None, Box(1.25, 2.0, 3.0, 4.5), "tracking", 0.5, None))
    write_row(table, Step(4, None, None, "lost", 0.0, None))
    lines = table.getvalue().splitlines()
    assert lines[0] == "frame,x,y,w,h,ok,score,state"
    assert lines[1] == "3,1.25,2.00,3.00,4.50,1,0.500,tracking"
    assert lines[2] == "4,0.00,0.00,0.00,0.00,0,0.000,lost"
