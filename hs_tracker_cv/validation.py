"""Is a value what its annotation says: for what comes out of a pickle, which anybody may have edited.

Kernels take contiguous arrays of matching shapes and check nothing, so an array of another shape, dtype or layout in
a restored state would have them read and write beyond its end. :func:`validate` walks through dataclasses, named
tuples, tuples and dictionaries by the annotations of their fields, whatever classes these are. What a type cannot say
is said by :class:`Shape` and :class:`Within`, as ``Annotated`` extras.
"""

from __future__ import annotations

import functools
import types
from collections.abc import Mapping
from dataclasses import dataclass, is_dataclass
from typing import Annotated, Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

__all__ = ["LARGEST", "Count", "Shape", "Within", "shown", "validate"]

LARGEST = 2**31 - 1
"""What a single number must not exceed, unless its annotation says something else."""

LARGEST_ELEMENT = 1e15
"""The same for elements of arrays: their squares are still numbers in float32."""

_LONGEST = 200
"""Characters of a bad value that a message repeats."""


class Shape:
    """Lengths of an array's axes: numbers, or names of lengths that all arrays validated together share.

    ``"name/2"`` is half of a length, rounded down; ``"name+1"`` and ``"name/2+1"`` are one more.

    Examples
    --------
    >>> Image = Annotated[NDArray[np.float32], Shape("height", "width", 3)]
    """

    def __init__(self, *sides: int | str) -> None:
        self.sides = sides

    def named(self, lengths: tuple[int, ...]) -> dict[str, int]:
        """What the lengths of an array say of this shape's names."""
        pairs = zip(self.sides, lengths, strict=True)
        return {side: length for side, length in pairs if isinstance(side, str) and not side.endswith(("/2", "+1"))}

    def lengths(self, known: Mapping[str, int]) -> tuple[int, ...]:
        """Return the lengths, all names being known."""
        return tuple(side if isinstance(side, int) else _length(side, known) for side in self.sides)


def _length(side: str, known: Mapping[str, int]) -> int:
    part = side.removesuffix("+1")
    whole = known[part.removesuffix("/2")]
    return (whole // 2 if part.endswith("/2") else whole) + (part != side)


@dataclass(frozen=True)
class Within:
    """Lowest and highest allowed number: of a scalar, or of all elements of an array."""

    low: float
    high: float

    def __str__(self) -> str:
        return f"between {self.low:g} and {self.high:g}"


Count = Annotated[int, Within(0, LARGEST)]
"""How many, or how long ago."""


def validate(value: Any, annotation: Any, path: str) -> None:
    """Check a value, and all that it holds, against an annotation.

    Parameters
    ----------
    value : object
    annotation : type or special form
        A class, ``Any``, an optional type, ``Literal``, ``tuple``, ``dict``, ``NDArray``, or ``Annotated`` with one
        of these. Of dataclasses and named tuples every field is checked; those with a method ``named_lengths`` say by
        it what they know of lengths that arrays share. Of other classes the value must be an instance.
    path : str
        What the value is called in messages.

    Raises
    ------
    ValueError
        That names the first part found of another type or dtype, not finite, out of range, not C-contiguous, or of
        another shape than the arrays beside it.
    """
    walk = _Walk()
    walk.check(value, annotation, (), path)
    known: dict[str, int] = {}
    for _, lengths, shape in walk.arrays:
        known |= shape.named(lengths)
    known |= walk.known
    for name, lengths, shape in walk.arrays:
        _expect(lengths == shape.lengths(known), name, f"of shape {shape.lengths(known)}", lengths)


class _Walk:
    """Checks everything but the shapes of arrays, and collects these."""

    def __init__(self) -> None:
        self.arrays: list[tuple[str, tuple[int, ...], Shape]] = []
        self.known: dict[str, int] = {}

    def check(self, value: Any, annotation: Any, extras: tuple[Any, ...], path: str) -> None:
        origin, arguments = get_origin(annotation), get_args(annotation)
        if origin is Annotated:
            self.check(value, arguments[0], arguments[1:], path)
        elif origin in (Union, types.UnionType):
            (kind,) = (one for one in arguments if one is not type(None))
            if value is not None:
                self.check(value, kind, extras, path)
        elif origin is tuple:
            self._check_tuple(value, arguments, path)
        elif origin is dict:
            _expect(type(value) is dict, path, "a dict", value)
            for key, one in value.items():
                self.check(key, arguments[0], (), f"the key {shown(key)} of {path}")
                self.check(one, arguments[1], (), f"{path}[{shown(key)}]")
        elif origin is np.ndarray:
            _check_array(value, get_args(arguments[1])[0], extras, path)
            for shape in (extra for extra in extras if isinstance(extra, Shape)):
                _expect(value.ndim == len(shape.sides), path, f"of {len(shape.sides)} dimensions", value.shape)
                self.arrays.append((path, value.shape, shape))
        elif origin is Literal:
            _expect(type(value) is str and value in arguments, path, f"one of {', '.join(arguments)}", value)
        elif is_dataclass(annotation) or hasattr(annotation, "_fields"):
            self._check_fields(value, annotation, path)
        elif annotation is not Any:
            _check_single(value, origin or annotation, extras, path)

    def _check_tuple(self, value: Any, kinds: tuple[Any, ...], path: str) -> None:
        _expect(type(value) is tuple, path, "a tuple", value)
        if kinds[-1] is Ellipsis:
            kinds = kinds[:1] * len(value)
        _expect(len(value) == len(kinds), path, f"a tuple of {len(kinds)}", value)
        for index, (one, kind) in enumerate(zip(value, kinds, strict=True)):
            self.check(one, kind, (), f"{path}[{index}]")

    def _check_fields(self, value: Any, kind: Any, path: str) -> None:
        _expect(type(value) is kind, path, f"a {kind.__name__}", value)
        for name, field in _fields(kind).items():
            _expect(hasattr(value, name), path, f"a {kind.__name__} that has {name}", value)
            self.check(getattr(value, name), field, (), f"{path}.{name}")
        if hasattr(value, "named_lengths"):
            self.known |= value.named_lengths()


@functools.cache
def _fields(kind: type) -> dict[str, Any]:
    return get_type_hints(kind, include_extras=True)


_NUMBERS: dict[type, tuple[type, ...]] = {
    bool: (bool, np.bool_),
    int: (int, np.integer),
    float: (float, np.floating),  # for kernels, 0 is no 0.0
}


def _check_single(value: Any, kind: type, extras: tuple[Any, ...], path: str) -> None:
    """Check a number, a word, or an instance of a class that is not looked into."""
    good = isinstance(value, _NUMBERS.get(kind, kind)) and (kind is bool or not isinstance(value, bool))
    _expect(good, path, f"of type {kind.__name__}", value)
    if kind in (int, float):
        limits = [extra for extra in extras if isinstance(extra, Within)] or [Within(-LARGEST, LARGEST)]
        for limit in limits:
            _expect(limit.low <= value <= limit.high, path, str(limit), value)


def _check_array(value: Any, number: Any, extras: tuple[Any, ...], path: str) -> None:
    _expect(type(value) is np.ndarray, path, "an array", value)
    dtype, wanted = value.dtype, "of native numbers" if number is Any else f"of native dtype {np.dtype(number)}"
    _expect(dtype.kind in "biufc" and dtype.isnative and number in (Any, dtype.type), path, wanted, dtype)
    _expect(value.flags.c_contiguous and value.flags.aligned, path, "C-contiguous and aligned", value.strides)
    _expect(value.size > 0, path, "an array with elements", value.shape)
    if value.dtype.kind in "fc" and number is not Any:  # which the user's own pixels are of: they may be no numbers
        most = float(np.abs(value).max())
        _expect(most <= LARGEST_ELEMENT, path, f"finite, and at most {LARGEST_ELEMENT:g}", most)
    for limit in (extra for extra in extras if isinstance(extra, Within)):
        low, high = value.min(), value.max()
        _expect(bool(limit.low <= low and high <= limit.high), path, str(limit), (low, high))


def shown(value: Any) -> str:
    """`repr` for a message: cut where it is long, and no error of its own (an int of 5,000 digits has none).

    Of an array its shape and type: its pixels say nothing.
    """
    if isinstance(value, np.ndarray) and value.ndim > 1:
        return f"an array of shape {value.shape}, {value.dtype}"
    try:
        words = repr(value)
    except Exception:
        return f"a {type(value).__name__} that cannot be shown"
    return words if len(words) <= _LONGEST else f"{words[:_LONGEST]}…"


def _expect(good: bool, path: str, wanted: str, got: Any) -> None:
    if not good:
        raise ValueError(f"expected {path} to be {wanted}, got {shown(got)}")
