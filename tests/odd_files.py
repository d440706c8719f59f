"""Videos as phones, screen recorders, broadcasters and cameras make them, by the ffmpeg of PyPI's imageio-ffmpeg."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

Image = NDArray[np.uint8]

DROPPED = "select='not(between(n,10,13))*not(between(n,20,29))'"
"""Leaves 26 of 40 frames, at their own times: a variable frame rate."""


def moving_square(count: int = 40) -> tuple[list[Image], list[tuple[int, int, int, int]]]:
    """A textured square that moves 2 px to the right per frame, 40 times: frames (120, 160, 3) and exact boxes."""
    rng = np.random.default_rng(8)
    ground = cv2.GaussianBlur(rng.integers(0, 255, (120, 160, 3), dtype=np.uint8), (0, 0), 4.0)
    square = cv2.GaussianBlur(rng.integers(0, 255, (36, 36, 3), dtype=np.uint8), (0, 0), 1.2)
    frames, boxes = [], []
    for index in range(count):
        frame, x = np.asarray(ground, np.uint8).copy(), 30 + 2 * (index % 40)
        frame[40:76, x : x + 36] = square
        frames.append(frame)
        boxes.append((x, 40, 36, 36))
    return frames, boxes


def ffmpeg(*arguments: str | Path, data: bytes = b"") -> bytes:
    """Run ffmpeg and return what it writes; skip where it is not installed."""
    program = pytest.importorskip("imageio_ffmpeg").get_ffmpeg_exe()
    command = [program, "-v", "error", "-y", *arguments]
    done = subprocess.run(command, input=data, capture_output=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    return done.stdout


def encode(path: Path, frames: Sequence[Image], *options: str, rate: int = 25) -> Path:
    """Write frames as the options and the ending of the name say."""
    height, width = frames[0].shape[:2]
    shape = ["-f", "rawvideo", "-pix_fmt", "bgr24", "-s", f"{width}x{height}", "-r", str(rate), "-i", "-"]
    ffmpeg(*shape, *options, path, data=b"".join(frame.tobytes() for frame in frames))
    return path


def decode(path: Path, width: int, height: int) -> NDArray[np.uint8]:
    """All frames as ffmpeg itself shows them, (T, height, width, 3) BGR."""
    data = ffmpeg("-i", path, "-f", "rawvideo", "-pix_fmt", "bgr24", "-fps_mode", "passthrough", "-")
    return np.frombuffer(data, np.uint8).reshape(-1, height, width, 3)
