"""A folder of images as a source."""

from __future__ import annotations

import re
import stat
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from .source import DEFAULT_FPS, Bytes, Image, Picture, VideoError, VideoSource

__all__ = ["IMAGE_SUFFIXES", "image_files", "natural_key", "open_folder", "read_image"]

IMAGE_SUFFIXES = frozenset({".bmp", ".jpeg", ".jpg", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp"})
"""Files of a folder that are taken for frames."""


def natural_key(path: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Sort key by which ``frame10`` follows ``frame9``."""
    parts = re.split(r"(\d+)", path.name.lower())
    return [(0, int(part), "") if part.isdecimal() else (1, 0, part) for part in parts if part], path.name


def image_files(folder: Path) -> list[Path]:
    """Images of a folder in natural order, without hidden files (``._0001.jpg`` of macOS) and what is no file.

    Raises
    ------
    OSError
        If the folder cannot be listed.
    """
    named = [
        path
        for path in folder.iterdir()
        if path.suffix.lower() in IMAGE_SUFFIXES and not path.name.startswith(".") and _may_be_a_file(path)
    ]
    return sorted(named, key=natural_key)


def _may_be_a_file(path: Path) -> bool:
    """Whether a name is a file, or one that cannot be reached: that is a missing frame, not something to skip."""
    try:
        return stat.S_ISREG(path.stat().st_mode)
    except OSError:
        return True


def open_folder(folder: Path, start: int, step: int, gain: float | None) -> VideoSource:
    """Open a folder of images; raises VideoError."""
    try:
        paths = image_files(folder)
    except OSError as error:
        raise VideoError(f"{folder}: cannot be listed ({error.strerror})") from error
    if not paths:
        raise VideoError(f"{folder}: holds no image ({', '.join(sorted(IMAGE_SUFFIXES))})")
    if start >= len(paths):
        raise VideoError(f"{folder}: has {len(paths)} frames, none after frame {start - 1}")
    paths = paths[start::step]
    first = read_image(paths[0])
    convert = Bytes(str(paths[0]), first, gain)
    # OTB and its kin keep the frames in a folder called img: the sequence's name is the parent's, where it was given.
    generic = folder.name.lower() in {"img", "images", "frames"} and folder.parent.name not in {"", ".."}
    name = folder.parent if generic else folder.resolve()
    return VideoSource(
        name.name, DEFAULT_FPS / step, len(paths), convert(str(paths[0]), first), _frames(paths, convert), start, step
    )


def _frames(paths: list[Path], convert: Bytes) -> Iterator[Picture]:
    for path in paths:
        yield convert(str(path), read_image(path))


def read_image(path: Path) -> Image:
    """Pixels of an image file as they are stored: gray or BGR without alpha, of any depth.

    Raises
    ------
    VideoError
        If it cannot be read, or is no image.
    """
    try:
        # imdecode instead of imread: it takes any path the operating system takes.
        data = np.frombuffer(path.read_bytes(), np.uint8)
    except OSError as error:
        raise VideoError(f"{path}: cannot be read ({error.strerror})") from error
    try:
        image = cv2.imdecode(data, cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR)
    except cv2.error:
        image = None
    if image is None:
        raise VideoError(f"{path}: is not an image that OpenCV can decode")
    return image
