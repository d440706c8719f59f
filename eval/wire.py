"""Messages between the referee and a child process: one line of JSON, then the bytes of arrays.

Nothing that comes from a child is executed or trusted: no pickle, no object types, sizes checked before they are
allocated.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

__all__ = ["GarbledError", "read_message", "write_message"]

_LINE_BYTES = 2**20
_ARRAY_BYTES = 2**31
_KINDS = "buif"  # of dtypes: numbers, whose bytes are what they say


class GarbledError(ValueError):
    """What was received is no message: something else wrote into the pipe."""


def write_message(stream: BinaryIO, content: Mapping[str, Any], arrays: Sequence[NDArray[Any]] = ()) -> None:
    """Send a message.

    Parameters
    ----------
    stream : binary file
    content : mapping
        JSON values.
    arrays : sequence of ndarray, optional
        Of numbers, any shape.

    Raises
    ------
    OSError
        If nobody reads at the other end.
    """
    arrays = [np.asarray(array, order="C") for array in arrays]
    layout = [(array.dtype.str, array.shape) for array in arrays]
    _write(stream, memoryview(json.dumps({**content, "arrays": layout}).encode() + b"\n"))
    for array in arrays:
        _write(stream, _bytes_of(array))
    stream.flush()


def _write(stream: BinaryIO, data: memoryview) -> None:
    while data:
        data = data[stream.write(data) :]


def _bytes_of(array: NDArray[Any]) -> memoryview:
    return array.data.cast("B") if array.size else memoryview(b"")


def read_message(stream: BinaryIO) -> tuple[dict[str, Any], list[NDArray[Any]]]:
    """Receive a message.

    Returns
    -------
    content : dict
    arrays : list of ndarray
        Writable, each of its own.

    Raises
    ------
    EOFError
        If the stream ends.
    GarbledError
        If what came is no message.
    """
    line = stream.readline(_LINE_BYTES)
    if not line.endswith(b"\n"):
        if len(line) < _LINE_BYTES:
            raise EOFError
        raise GarbledError(f"a line of more than {_LINE_BYTES} bytes")
    try:
        content = json.loads(line)
        layout = [(np.dtype(str(name)), tuple(int(side) for side in shape)) for name, shape in content.pop("arrays")]
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise GarbledError(f"no message: {line[:80]!r}") from error
    return content, [_read_array(stream, dtype, shape) for dtype, shape in layout]


def _read_array(stream: BinaryIO, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    size = dtype.itemsize * math.prod(shape)
    if dtype.kind not in _KINDS or min(shape, default=0) < 0 or size > _ARRAY_BYTES:
        raise GarbledError(f"an array of {dtype} and shape {shape}")
    array = np.empty(shape, dtype)
    view = _bytes_of(array)
    done = 0
    while done < len(view):
        count = stream.readinto(view[done:])  # type: ignore[attr-defined]
        if not count:
            raise EOFError
        done += count
    return array
