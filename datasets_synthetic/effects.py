"""What light and camera add: changes of the finished picture, and changes of one thing's surface.

Nothing here moves anything, so nothing here touches the truth.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from statistics import NormalDist
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .spec import Deep, Effect

__all__ = ["BLANKS", "EFFECTS", "ORDER", "SURFACE_EFFECTS", "box_blur", "to_bytes", "to_words"]

Image = NDArray[np.float32]


def box_blur(field: Image, radius: float) -> Image:
    """Three running means both ways: a bell of about `radius` px deviation.

    Parameters
    ----------
    field : ndarray, shape (H, W)
        Taken as 0 outside.
    radius : float
        px; below one half nothing happens.
    """
    half = round(radius)
    for _ in range(3 if half else 0):
        for axis in (0, 1):
            pad = [(0, 0), (0, 0)]
            pad[axis] = (half + 1, half)
            total = np.cumsum(np.pad(field, pad).astype(np.float64), axis=axis)
            upper, lower = (slice(2 * half + 1, None), slice(None, -(2 * half + 1)))
            picks = (upper, lower) if axis == 0 else ((slice(None), upper), (slice(None), lower))
            field = np.asarray((total[picks[0]] - total[picks[1]]) / (2 * half + 1), dtype=np.float32)
    return field


def flicker(image: Image, effect: Effect, s: float, rng: np.random.Generator) -> Image:
    """Light whose brightness swings by ± `strength`, `cycles` times."""
    return image * np.float32(1.0 + effect.strength * math.sin(2.0 * math.pi * effect.cycles * s))


def _ramp(effect: Effect, s: float) -> np.float32:
    """Gain that goes from 1 to `strength` over the ramp of the effect."""
    begin, end = effect.ramp
    share = float(s >= begin) if begin == end else min(max((s - begin) / (end - begin), 0.0), 1.0)
    return np.float32(1.0 + (effect.strength - 1.0) * share)


def exposure(image: Image, effect: Effect, s: float, rng: np.random.Generator) -> Image:
    """Exposure that drifts or jumps: all channels times `strength` in the end."""
    return image * _ramp(effect, s)


def red(image: Image, effect: Effect, s: float, rng: np.random.Generator) -> Image:
    """White balance that drifts or jumps: red times `strength` in the end."""
    return image * np.array([1.0, 1.0, _ramp(effect, s)], dtype=np.float32)


def blue(image: Image, effect: Effect, s: float, rng: np.random.Generator) -> Image:
    """White balance that drifts or jumps: blue times `strength` in the end."""
    return image * np.array([_ramp(effect, s), 1.0, 1.0], dtype=np.float32)


def haze(image: Image, effect: Effect, s: float, rng: np.random.Generator) -> Image:
    """Fog: contrast falls by the share `strength`."""
    return np.float32(140.0) + (image - np.float32(140.0)) * np.float32(1.0 - effect.strength)


@cache
def _bell() -> Image:
    """Quantiles of the normal distribution: looking one up costs a third of drawing one."""
    inverse = NormalDist().inv_cdf
    return np.array([inverse((k + 0.5) / 65536.0) for k in range(65536)], dtype=np.float32)


def noise(image: Image, effect: Effect, s: float, rng: np.random.Generator) -> Image:
    """Sensor noise of deviation `strength` grey levels."""
    draws = rng.integers(0, 65536, image.shape, dtype=np.uint16)
    return image + np.take(_bell() * np.float32(effect.strength), draws)


def gray(image: Image, effect: Effect, s: float, rng: np.random.Generator) -> Image:
    """Gray camera: (H, W, 3) becomes (H, W)."""
    return np.asarray(image @ np.array([0.114, 0.587, 0.299], dtype=np.float32))


def jpeg(image: Image, effect: Effect, s: float, rng: np.random.Generator) -> Image:
    """Compress to JPEG of quality `strength` and read it back.

    The one effect whose bytes depend on the libjpeg inside the OpenCV wheel.
    """
    done, data = cv2.imencode(".jpg", to_bytes(image), [cv2.IMWRITE_JPEG_QUALITY, int(effect.strength)])
    if not done:
        raise RuntimeError(f"cv2 could not write a JPEG of quality {effect.strength:g}")
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_UNCHANGED), dtype=np.float32)


def to_bytes(image: Image) -> NDArray[np.uint8]:
    """Round to uint8, saturating as a sensor does."""
    return np.clip(np.rint(image), 0.0, 255.0).astype(np.uint8)


def to_words(image: NDArray[Any], deep: Deep) -> NDArray[np.uint16]:
    """Grey levels 0–255 in the 16 bits of a deep camera, saturating as its sensor does."""
    scale = np.float64(deep.high - deep.low) / 255.0
    return np.clip(np.rint(deep.low + scale * image), 0.0, 65535.0).astype(np.uint16)


EFFECTS: dict[str, Callable[[Image, Effect, float, np.random.Generator], Image]] = {
    "haze": haze,
    "flicker": flicker,
    "exposure": exposure,
    "red": red,
    "blue": blue,
    "gray": gray,
    "noise": noise,
    "jpeg": jpeg,
}
ORDER = tuple(EFFECTS)
"""Light comes first, the sensor after it, the encoder last; effects are applied so however a spec lists them."""


def glint(colour: Image, effect: Effect, x: Image, y: Image, s: float) -> Image:
    """Reflection of a lamp that sweeps over the surface `cycles` times; it saturates."""
    place = -1.4 + 2.8 * ((effect.cycles * s) % 1.0)
    spot = np.exp(-(((x - place) / 0.28) ** 2) - ((y - 0.5 * place) / 0.9) ** 2)
    return colour + np.float32(effect.strength) * spot[..., np.newaxis].astype(np.float32)


def pulse(colour: Image, effect: Effect, x: Image, y: Image, s: float) -> Image:
    """Surface that glows brighter and darker by ± `strength`, `cycles` times."""
    return colour * np.float32(1.0 + effect.strength * math.sin(2.0 * math.pi * effect.cycles * s))


def shade(colour: Image, effect: Effect, x: Image, y: Image, s: float) -> Image:
    """Light from the upper left: a still gradient of ± `strength` over the thing, whatever the surface does."""
    return colour * (1.0 - np.float32(effect.strength) * (0.6 * x + 0.8 * y))[..., np.newaxis].astype(np.float32)


SURFACE_EFFECTS: dict[str, Callable[[Image, Effect, Image, Image, float], Image]] = {
    "shade": shade,
    "pulse": pulse,
    "glint": glint,
}
"""(colour (..., 3), effect, x, y in half sizes of the thing, fraction) -> colour."""


def _static(shape: tuple[int, ...], rng: np.random.Generator) -> NDArray[np.uint8]:
    """Noise of a receiver without a signal."""
    return rng.integers(0, 256, shape, dtype=np.uint8)


BLANKS: dict[str, Callable[[tuple[int, ...], np.random.Generator], NDArray[np.uint8]]] = {
    "black": lambda shape, rng: np.zeros(shape, np.uint8),
    "white": lambda shape, rng: np.full(shape, 255, np.uint8),
    "gray": lambda shape, rng: np.full(shape, 128, np.uint8),
    "static": _static,
}
"""(shape, generator) -> frame that shows nothing of the scene, as it comes out of the wire."""
