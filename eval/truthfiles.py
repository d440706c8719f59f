"""Text files of truth: boxes, visibility, attributes. What is not understood is refused with file, line and text."""

from __future__ import annotations

import configparser
import csv
import io
import json
import math
import re
import warnings
from decimal import Decimal
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .regions import mask_of_runs, polygon_text, region_box

__all__ = [
    "BoxFile",
    "SequenceError",
    "SequenceWarning",
    "is_gray_export",
    "read_attributes",
    "read_box_file",
    "read_masks",
    "read_number",
    "read_numbers",
    "read_scene",
    "read_scenes",
    "read_text",
]

_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?$", re.ASCII)
_ABSENT = re.compile(r"[+-]?nan$", re.IGNORECASE)


class SequenceError(ValueError):
    """A data set that is not what it should be; the message names the file."""


class SequenceWarning(UserWarning):
    """Something about a data set that its user should know, and that stops nothing."""


def read_text(path: Path) -> str:
    """Text of a file in UTF-8, with or without a byte order mark.

    Raises
    ------
    SequenceError
        If it cannot be read, or is no such text.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise SequenceError(f"cannot read {path}: {error.strerror or error}") from error
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        raise SequenceError(f"{path}: expected text in UTF-8, found UTF-16")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SequenceError(
            f"{path}: expected text in UTF-8, found {data[error.start]:#04x} at {error.start}"
        ) from error


class BoxFile(NamedTuple):
    """What a file of boxes says.

    Parameters
    ----------
    boxes : ndarray, shape (T, 4)
        x, y, w, h, 0-based; bounding boxes of masks and polygons; NaN where there is none.
    regions : tuple of T str
        Masks and polygons, as :mod:`eval.regions` writes them; empty where there is only a box.
    """

    boxes: NDArray[np.float64]
    regions: tuple[str, ...]


def read_box_file(path: Path, *, first: int, count: int | None = None, regions: bool = False) -> BoxFile:
    """Read a text file of boxes: one line per frame, separated by commas, tabs, semicolons or spaces.

    Parameters
    ----------
    path : Path
    first : int
        Coordinate of the first pixel in the file: 1 for OTB, 0 for GOT-10k, VOT and us.
    count : int, optional
        Number of frames. Empty lines at the end stand for frames as far as there are any; without a number they are
        the end of the file.
    regions : bool, optional
        Whether there may be polygons and masks, as in VOT. Elsewhere eight numbers are four with decimal commas.

    Returns
    -------
    BoxFile
        Of `regions` lines of 8 numbers are polygons, lines that begin with m masks. Lines that are empty, hold a NaN
        or a box without area have no box.

    Raises
    ------
    SequenceError
        Naming the line that holds something else, and what it holds.
    """
    lines = read_text(path).splitlines()
    while lines and not lines[-1].strip() and len(lines) > (count or 0):
        lines.pop()
    read = [_read_box(line, f"{path}:{number}", first, regions) for number, line in enumerate(lines, start=1)]
    found = np.array([box for box, _ in read], dtype=np.float64).reshape(-1, 4)
    there = np.asarray(np.isfinite(found).all(axis=1) & (found[:, 2:] > 0).all(axis=1))
    found[~there] = np.nan
    return BoxFile(found, tuple(text if known else "" for (_, text), known in zip(read, there.tolist(), strict=True)))


def _read_box(line: str, where: str, first: int, regions: bool) -> tuple[tuple[float, ...], str]:
    """Box of a line, and the text of its region; NaN and nothing where it holds none."""
    if regions and line.lstrip()[:1] in ("m", "M"):
        return _read_mask(line.strip()[1:], where)
    words = _words(line.strip(), where)
    if not words:
        return (np.nan,) * 4, ""
    wrong = [word for word in words if not (_is_number(word) or _ABSENT.match(word))]
    if wrong:
        raise SequenceError(f"{where}: expected numbers, got {wrong[0]!r} in {line.strip()!r}")
    if len(words) not in ((4, 8) if regions else (4,)):
        expected = "4 numbers or a polygon of 8" if regions else "4 numbers"
        raise SequenceError(f"{where}: expected {expected}, got {len(words)} in {line.strip()[:80]!r}")
    if any(_ABSENT.match(word) for word in words):
        return (np.nan,) * 4, ""
    # In decimals, so that what was written as x + 1 comes back as x to the last bit.
    values, text = [Decimal(word) for word in words], ""
    if len(values) == 8:
        text = polygon_text(float(value - first) for value in values)
        xs, ys = values[0::2], values[1::2]
        values = [min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys)]
    x, y, w, h = values
    return (float(x - first), float(y - first), float(w), float(h)), text


def _read_mask(text: str, where: str) -> tuple[tuple[float, ...], str]:
    """Bounding box and text of a mask as VOT writes it: a window, then lengths of runs, the first of zeros."""
    numbers = [int(read_number(word, where)) for word in _words(text, where)]
    x, y, width, height, *runs = (*numbers, *(0,) * (4 - len(numbers)))
    try:
        mask = mask_of_runs(x, y, width, height, runs)
    except ValueError as error:
        raise SequenceError(f"{where}: {error}") from None
    return region_box(mask), mask.text


def read_number(word: str, where: str) -> float:
    """Value of a number in the way that all of our files have them.

    Raises
    ------
    SequenceError
        Naming the place and the word that is none.
    """
    if not _is_number(word):
        raise SequenceError(f"{where}: expected a number, got {word!r}")
    return float(word)


def _is_number(word: str) -> bool:
    """Whether it is written as our files have numbers, and no larger than a number can be."""
    return bool(_NUMBER.match(word)) and math.isfinite(float(word))


def _words(line: str, where: str) -> list[str]:
    """Fields of a line, whatever separates them."""
    if not line:
        return []
    parts = [part.strip(",") for part in re.split(r"[;\s]+", line)]
    if len(parts) in (4, 8) and all("," in part for part in parts):
        raise SequenceError(f"{where}: expected a decimal point, got decimal commas in {line!r}")
    words = re.split(r"\s*[,;]\s*|\s+", line)
    if "" in words:
        raise SequenceError(f"{where}: expected a number in every field, got an empty one in {line!r}")
    return words


def read_numbers(path: Path, count: int, most: float) -> NDArray[np.float64] | None:
    """Read an optional file with one number per frame; what cannot be used is said and ignored.

    Parameters
    ----------
    path : Path
    count : int
        Number of frames.
    most : float
        Largest number that has a meaning; the least is 0.

    Returns
    -------
    ndarray, shape (T,), or None
        None without a file, or with one that is not as expected.
    """
    if not path.exists():
        return None
    try:
        words = read_text(path).replace(",", " ").split()  # LaSOT has them in one line, with commas
        wrong = next((word for word in words if not _is_number(word)), None)
        if wrong is not None:
            raise SequenceError(f"{path}: expected one number per line, got {wrong!r}")
        # One image more than lines, or the other way round, is common in the published sets.
        if abs(len(words) - count) > 1:
            raise SequenceError(f"{path}: expected {count} numbers, got {len(words)}")
        wrong = next((word for word in words if not 0.0 <= float(word) <= most), None)
        if wrong is not None:
            raise SequenceError(f"{path}: expected numbers from 0 to {most:g}, got {wrong}")
    except SequenceError as error:
        _ignore(error)
        return None
    values = np.array(words[:count], dtype=np.float64)
    return np.append(values, values[-1:]) if len(values) < count else values


def read_masks(path: Path, count: int) -> tuple[str, ...]:
    """Read an optional file with a mask per frame, as VOT writes them, or an empty line.

    Returns
    -------
    tuple of str
        As :class:`BoxFile` has them; no entries without a file, or with one that is not as expected, which is said.
    """
    if not path.exists():
        return ()
    try:
        lines = read_text(path).splitlines()
        if len(lines) != count:
            raise SequenceError(f"{path}: expected {count} masks, got {len(lines)}")
        wrong = next((line for line in lines if line[:1] not in ("", "m")), None)
        if wrong is not None:
            raise SequenceError(f"{path}: expected a mask, got {wrong[:80]!r}")
        return tuple(_read_mask(line[1:], f"{path}:{n}")[1] if line else "" for n, line in enumerate(lines, start=1))
    except SequenceError as error:
        _ignore(error)
        return ()


def read_attributes(folder: Path) -> tuple[str, ...]:
    """Attributes from an optional meta.json, or the manifest.json of our exports, or the meta_info.ini of GOT-10k.

    The camera's kind is one of them, since results differ most by it. What cannot be used is said and ignored.
    """
    for name in ("meta.json", "manifest.json"):
        if (folder / name).exists():
            try:
                return _from_json(folder / name)
            except SequenceError as error:
                _ignore(error)
                return ()
    path = folder / "meta_info.ini"
    if not path.exists():
        return ()
    # No interpolation: a % in a value is a %.
    parser = configparser.RawConfigParser(strict=False)
    try:
        parser.read_string(read_text(path), source=str(path))
    except (SequenceError, configparser.Error) as error:
        _ignore(SequenceError(" ".join(f"{path}: expected sections of key = value, got {error}".split())))
        return ()
    section = parser["METAINFO"] if "METAINFO" in parser else {}
    return tuple(section[key] for key in ("motion_class", "object_class") if section.get(key))


def is_gray_export(folder: Path) -> bool:
    """Whether the manifest.json of our exports says that the frames have one channel, which a video cannot say."""
    try:
        return (folder / "manifest.json").exists() and _read_meta(folder / "manifest.json").get("gray") is True
    except SequenceError:
        return False  # said when the attributes are read


def read_scene(folder: Path) -> str:
    """Scene that a sequence shares with others, from an optional meta.json; empty where it says none."""
    path = folder / "meta.json"
    if not path.exists():
        return ""
    try:
        scene = _read_meta(path).get("scene")
    except SequenceError:
        return ""  # said when the attributes were read
    if scene is not None and not isinstance(scene, str):
        _ignore(SequenceError(f"{path}: expected the name of a scene, got {scene!r}"))
    return scene if isinstance(scene, str) else ""


def read_scenes(path: Path) -> dict[str, str]:
    """Scene of each sequence that a CSV with the columns `sequence` and `scene` names; others keep their own.

    Raises
    ------
    SequenceError
        Naming the line that does not say both, or says another scene of the same sequence.
    """
    reader = csv.DictReader(io.StringIO(read_text(path)))
    if not {"sequence", "scene"} <= set(reader.fieldnames or ()):
        names = ", ".join(reader.fieldnames or ())
        raise SequenceError(f"{path}: expected the columns sequence and scene, got {names or 'none'}")
    found: dict[str, str] = {}
    for row in reader:
        name, scene = ((row[column] or "").strip() for column in ("sequence", "scene"))
        if not (name and scene) or found.setdefault(name, scene) != scene:
            where = f"{path}:{reader.line_num}"
            raise SequenceError(f"{where}: expected one scene of a sequence, got {scene!r} of {name!r}")
    return found


def _read_meta(path: Path) -> dict[str, Any]:
    text = read_text(path)
    try:
        meta = json.loads(text)
    except (ValueError, RecursionError) as error:  # of nesting, too, and numbers of thousands of digits
        raise SequenceError(f"{path}: expected JSON, got {error}") from error
    if not isinstance(meta, dict):
        raise SequenceError(f"{path}: expected an object with camera and attributes, got a {type(meta).__name__}")
    return meta


def _from_json(path: Path) -> tuple[str, ...]:
    meta = _read_meta(path)
    attributes = meta.get("attributes") or []
    if not isinstance(attributes, list):
        raise SequenceError(f"{path}: expected a list of attributes, got {attributes!r}")
    camera = [f"camera {meta['camera']}"] if isinstance(meta.get("camera"), str) else []
    return (*camera, *(str(item) for item in attributes))


def _ignore(error: SequenceError) -> None:
    warnings.warn(f"{error}; the file is ignored", SequenceWarning, stacklevel=2)
