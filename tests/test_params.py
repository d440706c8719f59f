"""TrackerHS_Params."""

from __future__ import annotations

import copy
import pickle
from typing import Any

import cv2
import numpy as np
import pytest

from hs_tracker_cv import TrackerHS_create, TrackerHS_Params


def test_defaults_round_trip() -> None:
    """To a dict, from a dict, through pickle and copy: equal."""
    parameters = TrackerHS_Params()
    for twin in (
        TrackerHS_Params.from_dict(parameters.to_dict()),
        copy.deepcopy(parameters),
        pickle.loads(pickle.dumps(parameters)),
    ):
        assert twin == parameters


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_every_protocol_of_pickle_goes_on_alike(protocol: int) -> None:
    """Parameters, and a tracker in mid-track that holds some."""
    frames = np.random.default_rng(0).integers(0, 255, (4, 90, 120, 3), dtype=np.uint8)
    tracker = TrackerHS_create(TrackerHS_Params(mode="segmentation"))
    tracker.init(frames[0], (30, 30, 30, 30))
    tracker.update(frames[1])
    twin = pickle.loads(pickle.dumps(tracker, protocol))
    assert [twin.update(frame) for frame in frames[2:]] == [tracker.update(frame) for frame in frames[2:]]
    assert pickle.loads(pickle.dumps(TrackerHS_Params(gain=2.0), protocol)) == TrackerHS_Params(gain=2.0)


def test_fields_are_mutable_and_compare() -> None:
    """Like cv2's structs, fields are set one by one."""
    parameters = TrackerHS_Params()
    parameters.mode = "segmentation"
    assert parameters == TrackerHS_Params(mode="segmentation")
    assert parameters != TrackerHS_Params()


def test_unknown_names_are_attribute_errors() -> None:
    """A misspelt option is never ignored."""
    parameters = TrackerHS_Params()
    with pytest.raises(AttributeError, match="smothness"):
        parameters.smothness = 3  # type: ignore[attr-defined]
    with pytest.raises(AttributeError, match="colour"):
        TrackerHS_Params.from_dict({"colour": 1})


@pytest.mark.parametrize("value", [1, None, True, b"auto"])
def test_wrong_types_are_type_errors(value: Any) -> None:
    """As in cv2."""
    with pytest.raises(TypeError, match="mode"):
        TrackerHS_Params().mode = value


def test_values_out_of_range_name_the_choices() -> None:
    """The error lists what is allowed."""
    with pytest.raises(ValueError, match="auto, segmentation, patch_tracker"):
        TrackerHS_Params(mode="best")


def test_the_tracker_copies_its_parameters() -> None:
    """Changing the struct afterwards does not reach the tracker."""
    parameters = TrackerHS_Params(mode="segmentation")
    tracker = TrackerHS_create(parameters)
    parameters.mode = "patch_tracker"
    assert tracker.parameters == TrackerHS_Params(mode="segmentation")


@pytest.mark.parametrize("rotation", [False, True])
def test_rotation_is_followed_on_request(rotation: bool) -> None:
    """A square turned by 45 degrees has an upright box √2 as wide: only who asked for rotation gets that."""
    rng = np.random.default_rng(4)
    ground, square = (
        cv2.GaussianBlur(rng.integers(0, 255, (side, side, 3), np.uint8), (0, 0), 2.0) for side in (240, 60)
    )
    tracker = TrackerHS_create(TrackerHS_Params(mode="patch_tracker", rotation=rotation))
    for degrees in range(0, 46):
        matrix = cv2.getRotationMatrix2D((29.5, 29.5), -degrees, 1.0)
        matrix[:, 2] += 90.0
        cover = cv2.warpAffine(np.ones((60, 60), np.float32), matrix, (240, 240))[:, :, None]
        turned = cv2.warpAffine(square, matrix, (240, 240))
        frame = np.clip(0.5 * ground * (1 - cover) + (0.5 * turned + 100) * cover, 0, 255).astype(np.uint8)
        if degrees == 0:
            tracker.init(frame, (90, 90, 60, 60))
        else:
            ok, (_, _, width, height) = tracker.update(frame)
            assert ok
    assert (abs(width - 85) < 6 and abs(height - 85) < 6) is rotation


def test_rotation_is_a_bool() -> None:
    """A number is none."""
    with pytest.raises(TypeError, match="rotation"):
        TrackerHS_Params(rotation=1)  # type: ignore[arg-type]


@pytest.mark.parametrize("other", [{"mode": "auto"}, "auto", 3])
def test_the_tracker_takes_no_parameters_of_another_kind(other: Any) -> None:
    """Those of another tracker are refused by a message that says what is expected."""
    with pytest.raises(TypeError, match="expected TrackerHS_Params, got "):
        TrackerHS_create(other)
