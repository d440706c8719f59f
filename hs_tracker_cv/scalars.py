"""Single numbers that a user hands over, of Python, of NumPy or of another library: made Python's."""

from __future__ import annotations

import numbers
import operator
from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np

from .validation import shown

__all__ = ["as_bool", "as_count", "as_float", "as_int", "make_plain", "plain"]


def as_float(name: str, value: Any) -> float:
    """Return a real number as a float; a bool or an array is not one.

    Raises
    ------
    TypeError
        For anything else.
    ValueError
        If it is too large for a float.
    """
    if not isinstance(value, numbers.Real) or isinstance(value, bool):
        raise TypeError(f"expected {name} to be a number, got {shown(value)}")
    try:
        return float(value)
    except OverflowError:
        raise ValueError(f"expected {name} to be a number that a float holds, got {shown(value)}") from None


def as_int(name: str, value: Any) -> int:
    """Return a whole number as an int; 3.0 and True are not whole numbers here.

    Raises
    ------
    TypeError
        For anything else.
    ValueError
        If it is too large for 32 bits, which is more than anything here has a use for.
    """
    if not isinstance(value, numbers.Integral) or isinstance(value, bool):
        raise TypeError(f"expected {name} to be a whole number, got {shown(value)}")
    number = operator.index(value)
    if abs(number) >= 2**31:
        raise ValueError(f"expected {name} to be a number of 32 bits, got {shown(value)}")
    return number


def as_count(name: str, value: Any) -> int:
    """Return a whole number of at least 1.

    Raises
    ------
    TypeError, ValueError
        As `as_int`; ValueError also if it is less.
    """
    number = as_int(name, value)
    if number < 1:
        raise ValueError(f"expected {name} of at least 1, got {number}")
    return number


def as_bool(name: str, value: Any) -> bool:
    """Return True or False as a bool; 0 and 1 are numbers.

    Raises
    ------
    TypeError
        For anything else.
    """
    if not isinstance(value, (bool, np.bool_)):
        raise TypeError(f"expected {name} to be True or False, got {shown(value)}")
    return bool(value)


_KINDS: dict[str, Callable[[str, Any], Any]] = {"float": as_float, "int": as_int, "bool": as_bool}


def plain(name: str, value: Any, annotation: str) -> Any:
    """Make a value what its field is annotated with, as ``float`` or ``int | None``; others are left as they are.

    Raises
    ------
    TypeError, ValueError
        As the functions above.
    """
    kind = annotation.removesuffix(" | None")
    if kind not in _KINDS or (value is None and kind != annotation):
        return value
    return _KINDS[kind](name, value)


def make_plain(params: Any) -> None:
    """Do that with all fields of a dataclass, a frozen one too, whose module leaves annotations as texts.

    Raises
    ------
    TypeError, ValueError
        As the functions above.
    """
    for field in fields(params):
        object.__setattr__(params, field.name, plain(field.name, getattr(params, field.name), str(field.type)))
