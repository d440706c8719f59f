"""Single numbers that a user hands over."""

from __future__ import annotations

import pickle
import re
from collections.abc import Callable
from dataclasses import fields
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from hs_tracker_cv import AutomaticTracker, HornSchunck, PaperMethod, TrackerHS_Params, draw
from hs_tracker_cv.detection import DetectorParams
from hs_tracker_cv.flow.params import PRESETS, FlowParams
from hs_tracker_cv.scalars import as_bool, as_float, as_int
from hs_tracker_cv.stages import StageParams

GIVEN: tuple[tuple[Callable[..., Any], dict[str, Any]], ...] = (
    (FlowParams, {**PRESETS["accurate"], "gain": 2.0}),
    (StageParams, {field.name: field.default for field in fields(StageParams)}),
    (DetectorParams, {**{field.name: field.default for field in fields(DetectorParams)}, "threshold": 0.5}),
    (TrackerHS_Params, {"mode": "auto", "rotation": True, "gain": 2.0}),
)
"""Classes of parameters, with a good value of every field."""

NUMPY = {float: np.float32, int: np.int64, bool: np.bool_, str: np.str_}


@pytest.mark.parametrize(("kind", "values"), GIVEN)
def test_numbers_of_numpy_are_python_s(kind: Callable[..., Any], values: dict[str, Any]) -> None:
    """Every field takes them, and holds what Python's number of that size would be."""
    made = kind(**{name: NUMPY[type(value)](value) for name, value in values.items()})
    plain = kind(**{name: type(value)(NUMPY[type(value)](value)) for name, value in values.items()})
    assert made == plain
    for name, value in values.items():
        assert isinstance(getattr(made, name), type(value))
        assert isinstance(value, str) or type(getattr(made, name)) is type(value)


@pytest.mark.parametrize("bad", ["3", [3], {}, 1 + 2j, np.array([3.0]), np.datetime64("2020"), 10**400, float("nan")])
@pytest.mark.parametrize(("kind", "values"), GIVEN)
def test_what_is_no_number_is_refused_by_the_name_of_its_field(
    kind: Callable[..., Any], values: dict[str, Any], bad: Any
) -> None:
    """For every field, before anything is computed."""
    for name in values:
        with pytest.raises((TypeError, ValueError), match=rf"expected .*\b{name}\b.*, got "):
            kind(**{**values, name: bad})


@pytest.mark.parametrize("bad", [True, np.True_, None])
def test_a_flag_is_no_number(bad: Any) -> None:
    """Python would count True as 1."""
    for make, name in ((as_float, "λ"), (as_int, "λ")):
        with pytest.raises(TypeError, match=re.escape(f"number, got {bad!r}")):
            make(name, bad)
    with pytest.raises(TypeError, match="expected exposure to be True or False, got 1"):
        HornSchunck("fast", exposure=1)  # type: ignore[arg-type]


def test_numbers_of_other_kinds() -> None:
    """A fraction is a number; 3.0 is no whole one."""
    assert as_float("x", Fraction(1, 4)) == 0.25
    assert as_int("x", np.uint8(200)) == 200
    assert as_bool("x", np.False_) is False
    with pytest.raises(TypeError, match=re.escape("expected iterations to be a whole number, got 3.0")):
        HornSchunck("fast", iterations=3.0)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="expected most to be a whole number, got 'x'"):
        AutomaticTracker(most="x")  # type: ignore[arg-type]


def test_the_flow_is_that_of_the_same_numbers(rng: np.random.Generator) -> None:
    """To the last bit."""
    first, second = rng.integers(0, 255, (2, 40, 50), np.uint8)
    given = HornSchunck("fast", smoothness=np.float32(3), iterations=np.int64(5)).calc(first, second, None)
    np.testing.assert_array_equal(given, HornSchunck("fast", smoothness=3.0, iterations=5).calc(first, second, None))


@pytest.mark.parametrize("thing", [None, 3, "x", [1], np.zeros((8, 8), np.uint8), PaperMethod()])
def test_what_cannot_be_drawn_is_named(thing: Any) -> None:
    """With what can be."""
    with pytest.raises(TypeError, match=r"expected the result of PaperMethod\.calc .*; got "):
        draw(thing)


@pytest.mark.parametrize("name", ["width", "columns"])
def test_sizes_of_a_drawing(name: str, rng: np.random.Generator) -> None:
    """NumPy's whole numbers are taken; nothing is drawn in none."""
    stages = PaperMethod().calc(*rng.integers(0, 255, (2, 48, 64), np.uint8))
    taken = draw(stages, ["frame", "Fx"], **{name: np.int64(100)})  # type: ignore[arg-type]
    np.testing.assert_array_equal(taken, draw(stages, ["frame", "Fx"], **{name: 100}))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match=f"expected {name} of at least 1, got 0"):
        draw(stages, **{name: 0})  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=f"expected {name} to be a whole number, got 1.5"):
        draw(stages, **{name: 1.5})  # type: ignore[arg-type]


def test_an_edited_pickle_says_so() -> None:
    """A number in a restored state that is none is a ValueError, as all that is wrong with a pickle."""
    solver = HornSchunck("fast")
    object.__setattr__(solver.params, "smoothness", "x")
    state = pickle.dumps(solver)
    with pytest.raises(ValueError, match="expected smoothness to be a number, got 'x'"):
        pickle.loads(state)
