"""Whether all bytes of a video file are there: what its container says of its own length.

The announced number of frames proves nothing: most containers give duration × rate, and even an index counts frames
that were dropped. Containers made of nested elements say how long the outermost ones are.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

__all__ = ["announced_bytes"]

_UNKNOWN = 0


def announced_bytes(path: Path) -> int | None:
    """Length that a file must have to be whole, bytes.

    Parameters
    ----------
    path : Path

    Returns
    -------
    int or None
        None where the container does not say: MPEG streams and others without nesting, live recordings whose length
        was never filled in.

    Raises
    ------
    OSError
        If the file cannot be read.
    """
    with path.open("rb") as file:
        head = file.read(12)
        file.seek(0)
        if head[:4] == b"RIFF":
            return _end(_riff(file))
        if head[:4] == b"\x1a\x45\xdf\xa3":
            return _end(_ebml(file))
        if head[4:8] in (b"ftyp", b"moov", b"mdat", b"free", b"skip", b"wide"):
            return _end(_boxes(file))
    return None


def _end(elements: Iterator[tuple[int, int]]) -> int | None:
    """End of the last element; elements are (where it begins, its whole length or 0 where that is not said)."""
    end = None
    for begin, length in elements:
        if length == _UNKNOWN:
            return None
        end = begin + length
    return end


def _riff(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """AVI: one or, beyond a gigabyte, several RIFF chunks."""
    begin = 0
    while len(head := _at(file, begin, 8)) == 8 and head[:4] == b"RIFF":
        size = int.from_bytes(head[4:], "little")
        length = _UNKNOWN if size in (0, 0xFFFFFFFF) else 8 + size
        yield begin, length
        if length == _UNKNOWN:
            return
        begin += length + size % 2


def _boxes(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """MP4 and QuickTime: top-level boxes."""
    begin = 0
    while len(head := _at(file, begin, 16)) >= 8 and head[4:8].isalnum():
        size = int.from_bytes(head[:4], "big")
        if size == 1:
            size = int.from_bytes(head[8:16], "big")
        length = size if size >= 8 else _UNKNOWN  # 0 is a box that goes on to the end
        yield begin, length
        if length == _UNKNOWN:
            return
        begin += length


def _ebml(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Matroska and WebM: the EBML head and the Segment."""
    begin = 0
    for _ in range(2):
        head = _at(file, begin, 12)
        if len(head) < 5:
            return
        size, width = _vint(head[4:])
        length = _UNKNOWN if size is None else 4 + width + size
        yield begin, length
        begin += length


def _vint(data: bytes) -> tuple[int | None, int]:
    """EBML's number of variable width, None where it is the one that means unknown; and its width in bytes."""
    width = 9 - data[0].bit_length()
    if width > 8 or len(data) < width:
        return None, 1
    bits = 7 * width
    value = int.from_bytes(data[:width], "big") & ((1 << bits) - 1)
    return (None if value == (1 << bits) - 1 else value), width


def _at(file: BinaryIO, place: int, count: int) -> bytes:
    if place >= os.fstat(file.fileno()).st_size:
        return b""  # an element may claim to be longer than any place that can be sought
    file.seek(place)
    return file.read(count)
