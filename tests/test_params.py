"""TrackerHS_Params."""

from __future__ import annotations

import copy
import pickle
from typing import Any

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


def test_fields_are_mutable_and_compare() -> None:
    """Like cv2's structs, fields are set one by one."""
    parameters = TrackerHS_Params()
    parameters.mode = "layers"
    assert parameters == TrackerHS_Params(mode="layers")
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
    with pytest.raises(ValueError, match="auto, layers, propagation"):
        TrackerHS_Params(mode="best")


def test_the_tracker_copies_its_parameters() -> None:
    """Changing the struct afterwards does not reach the tracker."""
    parameters = TrackerHS_Params(mode="layers")
    tracker = TrackerHS_create(parameters)
    parameters.mode = "propagation"
    assert tracker.parameters == TrackerHS_Params(mode="layers")
