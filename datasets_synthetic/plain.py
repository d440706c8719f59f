"""Specs as plain data, for files: nested dicts and lists that hold only what is not the default."""

from __future__ import annotations

from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from types import UnionType
from typing import Any, TypeVar, Union, get_args, get_origin, get_type_hints

__all__ = ["from_plain", "to_plain"]

T = TypeVar("T")


def to_plain(value: Any) -> Any:
    """Turn a spec, or any part of one, into what JSON can hold."""
    if is_dataclass(value):
        held = {field: getattr(value, field.name) for field in fields(value)}
        return {field.name: to_plain(item) for field, item in held.items() if not _is_default(field, item)}
    return [to_plain(item) for item in value] if isinstance(value, tuple) else value


def _is_default(field: Field[Any], value: Any) -> bool:
    default = field.default_factory() if field.default_factory is not MISSING else field.default
    # 1 and 1.0 are equal, but not the same text, of which digests are made.
    return repr(value) == repr(default)


_hints = cache(get_type_hints)


def from_plain(kind: type[T], data: Any) -> T:
    """Make a spec, or any part of one, of what :func:`to_plain` gave.

    Parameters
    ----------
    kind : type
        :class:`~datasets_synthetic.spec.SequenceSpec`, for example.
    data : dict

    Raises
    ------
    TypeError, ValueError
        If the data does not describe one.
    """
    made: T = _made(kind, data)
    return made


def _made(kind: Any, data: Any) -> Any:
    if is_dataclass(kind) and isinstance(kind, type):
        if not isinstance(data, dict):
            raise TypeError(f"expected the fields of a {kind.__name__}, got {data!r}")
        hints = _hints(kind)
        unknown = set(data) - set(hints)
        if unknown:
            raise ValueError(f"unknown field {', '.join(sorted(unknown))} of a {kind.__name__}")
        return kind(**{name: _made(hints[name], item) for name, item in data.items()})
    if get_origin(kind) in (Union, UnionType):
        (inner,) = (each for each in get_args(kind) if each is not type(None))
        return None if data is None else _made(inner, data)
    if get_origin(kind) is tuple:
        inner, *more = get_args(kind)
        kinds = [inner] * len(data) if more == [Ellipsis] else [inner, *more]
        return tuple(_made(each, item) for each, item in zip(kinds, data, strict=True))
    return data
