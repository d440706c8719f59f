"""A small sequence to try the page with, made when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from ..geometry import Box
from ..video import VideoSource

__all__ = ["BOX", "demo"]

WIDTH, HEIGHT, COUNT, FPS = 640, 480, 200, 25.0
RADIUS = 44
CENTRE = (150.0, 250.0)
BOX = Box(CENTRE[0] - RADIUS, CENTRE[1] - RADIUS, 2 * RADIUS, 2 * RADIUS)
"""Where the ball is in the first frame."""

Picture = NDArray[np.uint8]


def demo() -> VideoSource:
    """A textured ball that rolls in a figure of eight over a meadow in changing light."""
    frames = _frames()
    return VideoSource("demo", FPS, COUNT, next(_frames()), frames)


def _frames() -> Iterator[Picture]:
    rng = np.random.default_rng(1981)
    ground = _texture(rng, HEIGHT, WIDTH, 2.5, (70, 120, 90), 26.0)
    skin = _texture(rng, 4 * RADIUS, 4 * RADIUS, 3.0, (70, 110, 205), 60.0)
    for index in range(COUNT):
        frame = np.asarray(cv2.convertScaleAbs(ground, alpha=1.0 + 0.04 * np.sin(index / 17.0)), np.uint8)
        _roll(frame, skin, *_centre(index), 4.0 * index)
        yield frame


def _centre(index: int) -> tuple[float, float]:
    phase = 2.0 * np.pi * index / COUNT
    return CENTRE[0] + 170.0 * (1.0 - np.cos(phase)), CENTRE[1] + 90.0 * np.sin(2.0 * phase)


def _texture(
    rng: np.random.Generator, height: int, width: int, sigma: float, colour: tuple[int, int, int], contrast: float
) -> Picture:
    fine, coarse = (cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), k * sigma) for k in (1, 6))
    noise = np.asarray(fine + 9.0 * coarse, np.float64)
    levels = np.array(colour) + (noise / noise.std() * contrast)[:, :, None] * np.array([0.7, 1.0, 0.8])
    return np.asarray(np.clip(levels, 0, 255), np.uint8)


def _roll(frame: Picture, skin: Picture, x: float, y: float, angle: float) -> None:
    """Draw the ball, turned and lit from the upper left, its edge blended over a pixel."""
    side = 2 * RADIUS + 4
    left, top = int(x) - side // 2, int(y) - side // 2
    middle = skin.shape[0] / 2
    turn = cv2.getRotationMatrix2D((middle, middle), angle, 1.0)
    turn[:, 2] += (x - left - middle, y - top - middle)
    ball = cv2.warpAffine(skin, turn, (side, side), flags=cv2.INTER_LINEAR)
    across, down = np.meshgrid(np.arange(side) + 0.5 - (x - left), np.arange(side) + 0.5 - (y - top))
    cover = np.clip(RADIUS - np.hypot(across, down), 0.0, 1.0)[:, :, None]
    light = 1.15 - 0.35 * np.clip(np.hypot(across + 14, down + 16) / RADIUS, 0.0, 2.0)[:, :, None]
    under = frame[top : top + side, left : left + side]
    under[:] = np.clip(np.rint(under * (1.0 - cover) + ball * light * cover), 0, 255)
