"""How a surface changes its shape: maps of material points that can be undone exactly.

A deformation acts in the thing's own coordinates, px round its centre, of half size (a, b). It has three parts:
`forward` moves material points, `inverse` finds the material point seen at a place, and `outline` moves the
silhouette, which differs from `forward` only where the surface turns out of the picture plane.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

__all__ = ["DEFORMS", "Deformation"]

Field = NDArray[np.float64]
Map = Callable[[Field, Field, float, float, float, float], tuple[Field, Field]]
"""(x, y, a, b, strength, phase in turns) -> (x, y)."""


@dataclass(frozen=True)
class Deformation:
    """The three maps of one deformation."""

    outline: Map
    forward: Map
    inverse: Map


def _squash(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    """Widen and flatten, at constant area."""
    k = 1.0 + strength * math.sin(2.0 * math.pi * phase)
    return x * k, y / k


def _unsquash(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    k = 1.0 + strength * math.sin(2.0 * math.pi * phase)
    return x / k, y * k


def _wave(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    """Wriggle sideways, as weed in a stream."""
    return x + strength * a * np.sin(math.pi * y / b + 2.0 * math.pi * phase), y


def _unwave(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    return x - strength * a * np.sin(math.pi * y / b + 2.0 * math.pi * phase), y


def _bend(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    """Flap both ends up and down, as a bird does."""
    return x, y + strength * b * math.sin(2.0 * math.pi * phase) * (x / a) ** 2


def _unbend(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    return x, y - strength * b * math.sin(2.0 * math.pi * phase) * (x / a) ** 2


def _turn_state(a: float, depth: float, phase: float) -> tuple[float, float]:
    """Half width of the silhouette and angle of the surface of an elliptic column turned by `phase`."""
    angle = 2.0 * math.pi * phase
    across, along = a * math.cos(angle), depth * a * math.sin(angle)
    ahead = math.atan2(along, across) - angle
    return math.hypot(across, along), angle + (ahead + math.pi) % (2.0 * math.pi) - math.pi


def _turn_outline(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    return x * (_turn_state(a, strength, phase)[0] / a), y


def _turn(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    """Turn a column with semi-axes a and strength·a about its vertical axis; NaN for points of its back."""
    width, delta = _turn_state(a, strength, phase)
    angle = math.pi / 2.0 - x / a + delta
    return np.where((angle >= 0.0) & (angle <= math.pi), width * np.cos(angle), np.nan), y


def _unturn(x: Field, y: Field, a: float, b: float, strength: float, phase: float) -> tuple[Field, Field]:
    width, delta = _turn_state(a, strength, phase)
    return a * (math.pi / 2.0 - np.arccos(np.clip(x / width, -1.0, 1.0)) + delta), y


DEFORMS: dict[str, Deformation] = {
    "squash": Deformation(_squash, _squash, _unsquash),
    "wave": Deformation(_wave, _wave, _unwave),
    "bend": Deformation(_bend, _bend, _unbend),
    "turn": Deformation(_turn_outline, _turn, _unturn),
}
