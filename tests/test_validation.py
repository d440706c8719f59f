"""Values against annotations: what is right passes, and whatever is wrong is named."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv.validation import LARGEST, Shape, Within, shown, validate

pytestmark = pytest.mark.once

Plane = Annotated[NDArray[np.float32], Shape("h", "w")]


class Part(NamedTuple):
    """Arrays of which some are half as large as others."""

    whole: Plane
    half: Annotated[NDArray[np.float32], Shape("h/2", "w/2+1")]
    spectrum: Annotated[NDArray[np.complex64], Shape(3, "w+1")]


@dataclass(frozen=True)
class Thing:
    """One field of each kind."""

    part: Part
    mask: Annotated[NDArray[np.uint8], Shape("h", "w"), Within(0, 1)] | None
    any_numbers: Annotated[NDArray[Any], Shape("n")]
    place: tuple[float, float]
    steps: tuple[tuple[int, bool], ...]
    share: Annotated[float, Within(0.0, 1.0)]
    name: str
    state: Literal["good", "bad"]
    rows: dict[int, tuple[float, ...]]
    dtype: np.dtype[Any]
    anything: Any = None

    def named_lengths(self) -> dict[str, int]:
        """There are as many numbers as letters in the name."""
        return {"n": len(self.name)}


def good() -> dict[str, Any]:
    """Fields of a thing without fault."""
    part = Part(np.ones((5, 6), np.float32), np.ones((2, 4), np.float32), np.ones((3, 7), np.complex64))
    return {
        "part": part,
        "mask": np.ones((5, 6), np.uint8),
        "any_numbers": np.arange(4),
        "place": (1.0, np.float32(2)),
        "steps": ((1, True), (np.int64(2), np.bool_(False))),
        "share": 1.0,
        "name": "four",
        "state": "good",
        "rows": {1: (1.0,), 2: ()},
        "dtype": np.dtype(np.uint8),
        "anything": object(),
    }


def test_what_is_right_passes() -> None:
    """Numbers of NumPy and of Python, empty tuples, an optional array that is absent."""
    validate(Thing(**good()), Thing, "thing")
    validate(Thing(**good() | {"mask": None}), Thing | None, "thing")
    validate(None, Thing | None, "thing")


def part(**changes: Any) -> Part:
    """The good part with some arrays changed."""
    whole: Part = good()["part"]
    return whole._replace(**changes)


F32 = np.float32


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"part": None}, "thing.part to be a Part, got None"),
        ({"part": tuple(good()["part"])}, "thing.part to be a Part"),
        ({"part": part(whole=np.ones((5, 5), F32))}, r"of shape \(.*\), got \(.*\)"),
        ({"part": part(half=np.ones((3, 4), F32))}, r"thing.part.half to be of shape \(2, 4\), got \(3, 4\)"),
        ({"part": part(half=np.ones((2, 3), F32))}, r"\(2, 4\), got \(2, 3\)"),
        ({"part": part(spectrum=np.ones((3, 6), np.complex64))}, r"\(3, 7\), got \(3, 6\)"),
        ({"part": part(spectrum=np.ones((2, 7), np.complex64))}, r"\(3, 7\), got \(2, 7\)"),
        ({"part": part(spectrum=np.ones((3, 7), F32))}, "spectrum to be of native dtype complex64"),
        ({"part": part(whole=np.ones(5, F32))}, "whole to be of 2 dimensions"),
        ({"part": part(whole=np.ones((), F32))}, "whole to be of 2 dimensions"),
        ({"part": part(whole=np.ones((0, 6), F32))}, "whole to be an array with elements"),
        ({"part": part(whole=np.ones((5, 6)))}, "of native dtype float32, got dtype.'float64'"),
        ({"part": part(whole=np.ones((5, 6), ">f4"))}, "of native dtype float32, got dtype.'>f4'"),
        ({"part": part(whole=np.asfortranarray(np.ones((5, 6), F32)))}, "C-contiguous"),
        ({"part": part(whole=np.ones((5, 12), F32)[:, ::2])}, "C-contiguous"),
        ({"part": part(whole=np.broadcast_to(F32(1), (5, 6)))}, "C-contiguous"),
        ({"part": part(whole=np.ones((5, 6), F32).view(np.matrix))}, "whole to be an array"),
        ({"part": part(whole=np.full((5, 6), np.nan, F32))}, "finite"),
        ({"part": part(whole=np.full((5, 6), -np.inf, F32))}, "finite"),
        ({"part": part(whole=np.full((5, 6), 1e30, F32))}, "at most 1e\\+15"),
        ({"part": part(spectrum=np.full((3, 7), np.nan * 1j, np.complex64))}, "finite"),
        ({"part": part(whole=[[1.0] * 6] * 5)}, "whole to be an array"),
        ({"mask": np.full((5, 6), 2, np.uint8)}, "thing.mask to be between 0 and 1"),
        ({"mask": np.ones((6, 5), np.uint8)}, r"\(5, 6\), got \(6, 5\)|\(6, 5\), got \(5, 6\)"),
        ({"any_numbers": np.arange(5)}, r"thing.any_numbers to be of shape \(4,\), got \(5,\)"),
        ({"any_numbers": np.array([None] * 4)}, "native numbers"),
        ({"any_numbers": np.array(["a"] * 4)}, "native numbers"),
        ({"place": [1.0, 2.0]}, "thing.place to be a tuple, got"),
        ({"place": (1.0,)}, "a tuple of 2"),
        ({"place": (1.0, "2")}, r"thing.place\[1\] to be of type float, got '2'"),
        ({"place": (1.0, 2)}, r"thing.place\[1\] to be of type float, got 2"),
        ({"place": (1.0, True)}, r"thing.place\[1\] to be of type float, got True"),
        ({"place": (1.0, math.nan)}, r"thing.place\[1\] to be between"),
        ({"place": (1.0, 1e300)}, r"thing.place\[1\] to be between"),
        ({"steps": ((10**5000, True),)}, r"thing.steps\[0\]\[0\] to be between .* that cannot be shown"),
        ({"steps": ((1.5, True),)}, r"thing.steps\[0\]\[0\] to be of type int"),
        ({"steps": ((LARGEST + 1, True),)}, r"thing.steps\[0\]\[0\] to be between"),
        ({"steps": ((1, 1),)}, r"thing.steps\[0\]\[1\] to be of type bool"),
        ({"share": 1.01}, "thing.share to be between 0 and 1, got 1.01"),
        ({"name": None}, "thing.name to be of type str, got None"),
        ({"state": "ugly"}, "thing.state to be one of good, bad, got 'ugly'"),
        ({"state": ["good"]}, "thing.state to be one of"),
        ({"rows": {"1": ()}}, "the key '1' of thing.rows to be of type int"),
        ({"rows": {1: (None,)}}, r"thing.rows\[1\]\[0\] to be of type float"),
        ({"rows": [(1, ())]}, "thing.rows to be a dict"),
        ({"dtype": "uint8"}, "thing.dtype to be of type dtype"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_named(changes: dict[str, Any], words: str) -> None:
    """The message says where it is, what was expected and what is there."""
    with pytest.raises(ValueError, match=words):
        validate(Thing(**good() | changes), Thing, "thing")


def test_a_field_that_is_missing_is_named() -> None:
    """A pickle sets the attributes of a frozen dataclass one by one, or leaves one out."""
    thing = object.__new__(Thing)
    thing.__dict__.update(good())
    del thing.__dict__["share"]
    with pytest.raises(ValueError, match="a Thing that has share"):
        validate(thing, Thing, "thing")


def test_a_value_that_has_no_words_is_shown_all_the_same() -> None:
    """What is long is cut; what cannot be printed is named by its type."""
    assert shown(10**5000) == "a int that cannot be shown"
    assert len(shown(list(range(10_000)))) == 201
