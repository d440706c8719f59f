"""Outlines of things: each shape is one or more parts in pixels round the thing's own centre.

A part has a rest outline and a rigid pose that may depend on the `phase` of the thing's gait (a leg, a wheel), so
that any point painted on it can be followed exactly.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

__all__ = ["SHAPES", "Part", "area"]

Points = NDArray[np.float64]
Affine = NDArray[np.float64]
Colour = tuple[float, float, float]
Point = tuple[float, float]

_STILL: Affine = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def _still(phase: float) -> Affine:
    return _STILL


@dataclass(frozen=True, eq=False)
class Part:
    """A rigid piece of a thing.

    Parameters
    ----------
    outline : ndarray, shape (N, 2)
        Simple polygon at rest, px round the thing's centre.
    pose : callable
        Phase (turns of the gait) -> (2, 3) affine map from rest to the thing's own coordinates.
    shade : float
        Factor on the colour.
    tone : tuple of 3 floats, optional
        Blue, green, red of its own instead of the actor's; the texture's grain stays, at half strength.
    """

    outline: Points
    pose: Callable[[float], Affine] = _still
    shade: float = 1.0
    tone: Colour | None = None


def area(outline: Points) -> float:
    """Signed area of a polygon, px²; the sign is that of its direction."""
    x, y = outline[:, 0], outline[:, 1]
    return float(0.5 * np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))


def _fit(points: Points, width: float, height: float) -> Points:
    """Stretch an outline so that its tight box is `width` × `height` round the origin."""
    low, high = points.min(axis=0), points.max(axis=0)
    return np.asarray((points - (low + high) / 2.0) / (high - low) * np.array([width, height]))


def _polar(radius: NDArray[np.float64], width: float, height: float) -> Points:
    angle = 2.0 * np.pi * np.arange(radius.size) / radius.size
    return _fit(np.column_stack([radius * np.cos(angle), radius * np.sin(angle)]), width, height)


def _round_box(x0: float, y0: float, x1: float, y1: float, radius: float) -> Points:
    """Rectangle with rounded corners, from edges."""
    quarter = np.linspace(0.0, np.pi / 2.0, 5)
    centres = (
        (x1 - radius, y1 - radius),
        (x0 + radius, y1 - radius),
        (x0 + radius, y0 + radius),
        (x1 - radius, y0 + radius),
    )
    corners = [
        np.column_stack(
            [cx + radius * np.cos(quarter + k * np.pi / 2), cy + radius * np.sin(quarter + k * np.pi / 2)]
        )
        for k, (cx, cy) in enumerate(centres)
    ]
    return np.concatenate(corners)


def _disc(cx: float, cy: float, rx: float, ry: float, count: int = 32) -> Points:
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.column_stack([cx + rx * np.cos(angle), cy + ry * np.sin(angle)])


def _turn_about(x: float, y: float, angle: float) -> Affine:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, x - c * x + s * y], [s, c, y - s * x - c * y]])


def _chain(outer: Affine, inner: Affine) -> Affine:
    linear = outer[:, :2] @ inner[:, :2]
    return np.column_stack([linear, outer[:, :2] @ inner[:, 2] + outer[:, 2]])


def ellipse(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Ellipse of 96 corners."""
    return (Part(_disc(0.0, 0.0, width / 2.0, height / 2.0, 96)),)


def box(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Rectangle with slightly rounded corners."""
    radius = 0.12 * min(width, height)
    return (Part(_round_box(-width / 2, -height / 2, width / 2, height / 2, radius)),)


def bar(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Rectangle with sharp corners: a wall, a pole, a plank."""
    w, h = width / 2.0, height / 2.0
    return (Part(np.array([[-w, -h], [w, -h], [w, h], [-w, h]])),)


def polygon(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Irregular convex polygon of five to eight corners."""
    rng = np.random.default_rng([seed, 11])
    count = int(rng.integers(5, 9))
    angle = (np.arange(count) + rng.uniform(-0.3, 0.3, count)) * 2.0 * np.pi / count
    return (Part(_fit(np.column_stack([np.cos(angle), np.sin(angle)]), width, height)),)


def blob(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Smooth, lumpy outline."""
    rng = np.random.default_rng([seed, 12])
    angle = 2.0 * np.pi * np.arange(96) / 96
    radius = np.ones(96)
    for harmonic in (2, 3, 4, 5):
        radius += rng.uniform(0.05, 0.2) / (harmonic - 1) * np.cos(harmonic * angle + rng.uniform(0.0, 2.0 * np.pi))
    return (Part(_polar(radius, width, height)),)


def gear(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Wheel with flat teeth and a hub."""
    teeth = 8 + seed % 5
    profile = np.concatenate([np.full(6, 1.0), np.full(6, 0.78)])
    wheel = _polar(np.tile(profile, teeth), width, height)
    return Part(wheel), Part(_disc(0.0, 0.0, 0.16 * width, 0.16 * height, 32), tone=(58.0, 54.0, 52.0))


def fan(blades: int, width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Blades round a hub at the origin; width and height are those of the circle through their tips."""
    rng = np.random.default_rng([seed, 13])
    root, tip, sweep = rng.uniform(0.1, 0.18), rng.uniform(0.1, 0.26), rng.uniform(-0.15, 0.15)
    # Where the edges of neighbouring blades meet; of two, in the hub itself.
    throat = root / math.tan(math.pi / blades)
    blade = np.array([[throat, -root], [1.0, sweep - tip], [1.0, sweep + tip]])
    blade /= math.hypot(1.0, abs(sweep) + tip)
    turns = 2.0 * math.pi * np.arange(blades) / blades
    spins = [np.array([[math.cos(a), math.sin(a)], [-math.sin(a), math.cos(a)]]) for a in turns.tolist()]
    outline = np.concatenate([blade @ spin for spin in spins])
    return (Part(outline * np.array([width, height]) / 2.0),)


def star(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Star of four to seven points about the origin; width and height are those of the circle through them."""
    rng = np.random.default_rng([seed, 14])
    points = int(rng.integers(4, 8))
    radii = np.tile([1.0, rng.uniform(0.35, 0.6)], points)
    angles = math.pi * np.arange(2 * points) / points
    outline = np.column_stack([radii * np.cos(angles), radii * np.sin(angles)])
    return (Part(outline * np.array([width, height]) / 2.0),)


def _letter(width: float, height: float, corners: tuple[Point, ...]) -> tuple[Part, ...]:
    return (Part(_fit(np.array(corners), width, height)),)


def cross(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Two bars that cross at right angles."""
    a = 0.12 + 0.03 * (seed % 4)
    quarter = ((1.0, -a), (1.0, a), (a, a))
    corners = [(x * c - y * s, x * s + y * c) for c, s in ((1, 0), (0, 1), (-1, 0), (0, -1)) for x, y in quarter]
    return _letter(width, height, tuple(corners))


def ell(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Letter L."""
    a = 0.24 + 0.05 * (seed % 4)
    return _letter(width, height, ((0.0, 0.0), (a, 0.0), (a, 1.0 - a), (1.0, 1.0 - a), (1.0, 1.0), (0.0, 1.0)))


def tee(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Letter T."""
    a, b = 0.24 + 0.04 * (seed % 4), 0.13 + 0.02 * (seed % 4)
    left, right = 0.5 - b, 0.5 + b
    corners = (
        (0.0, 0.0), (1.0, 0.0), (1.0, a), (right, a), (right, 1.0), (left, 1.0), (left, a), (0.0, a),
    )  # fmt: skip
    return _letter(width, height, corners)


def horseshoe(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Letter U."""
    a = 0.22 + 0.03 * (seed % 4)
    corners = (
        (0.0, 0.0), (a, 0.0), (a, 1.0 - a), (1.0 - a, 1.0 - a), (1.0 - a, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0),
    )  # fmt: skip
    return _letter(width, height, corners)


def car(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Side view of a car that faces right: body, windows, two turning wheels."""
    w, h = width / 2.0, height / 2.0
    body = np.array(
        [
            [-1.0, 0.55], [-1.0, -0.02], [-0.93, -0.16], [-0.66, -0.24], [-0.44, -0.86], [-0.34, -1.0], [0.2, -1.0],
            [0.32, -0.9], [0.54, -0.26], [0.88, -0.12], [1.0, 0.06], [1.0, 0.55],
        ]
    )  # fmt: skip
    rear = np.array([[-0.53, -0.26], [-0.38, -0.78], [-0.12, -0.82], [-0.12, -0.26]])
    front = np.array([[-0.02, -0.26], [-0.02, -0.82], [0.17, -0.82], [0.4, -0.26]])
    scale = np.array([w, h])
    glass = (74.0, 60.0, 48.0)
    parts = [Part(body * scale), Part(rear * scale, tone=glass), Part(front * scale, tone=glass)]
    radius = 0.44 * h
    for x in (-0.58 * w, 0.6 * w):
        y = h - radius

        def roll(phase: float, x: float = x, y: float = y) -> Affine:
            return _turn_about(x, y, 2.0 * math.pi * phase)

        spokes = _disc(x, y, 0.6 * radius, 0.2 * radius, 16)
        parts.append(Part(_disc(x, y, radius, radius), roll, tone=(34.0, 32.0, 32.0)))
        parts.append(Part(spokes, roll, tone=(176.0, 176.0, 178.0)))
    return tuple(parts)


def _limb(x: float, y: float, length: float, thickness: float) -> Points:
    return _round_box(x - thickness / 2, y - thickness / 3, x + thickness / 2, y + length, 0.45 * thickness)


_TROUSERS: tuple[Colour, ...] = ((92.0, 62.0, 48.0), (54.0, 56.0, 62.0), (96.0, 120.0, 142.0), (70.0, 84.0, 64.0))
_COMPLEXIONS: tuple[Colour, ...] = ((132.0, 164.0, 210.0), (86.0, 118.0, 168.0), (52.0, 74.0, 108.0))


def walker(width: float, height: float, seed: int) -> tuple[Part, ...]:
    """Person who walks to the right, seen from the side: limbs that swing about hip, knee, shoulder.

    One turn of the gait is two steps, together 0.78 of the height long: walk at that pace, or the feet slide.
    """
    h = height
    hip, neck, thick = 0.02 * h, -0.33 * h, 0.1 * h
    thigh, shin, arm = 0.25 * h, 0.23 * h, 0.3 * h
    trousers, skin = _TROUSERS[seed % len(_TROUSERS)], _COMPLEXIONS[seed % len(_COMPLEXIONS)]
    reach = 0.42 * min(width / (0.5 * h), 1.0)

    def leg(offset: float, shade: float) -> list[Part]:
        def upper(phase: float) -> Affine:
            return _turn_about(0.0, hip, -reach * math.sin(2 * math.pi * (phase + offset)))

        def lower(phase: float) -> Affine:
            bend = reach * (0.55 + 0.55 * math.cos(2 * math.pi * (phase + offset)))
            return _chain(upper(phase), _turn_about(0.0, hip + thigh, bend))

        ankle = hip + thigh + shin
        shoe = _round_box(-0.45 * thick, ankle - 0.4 * thick, 1.0 * thick, ankle, 0.2 * thick)
        return [
            Part(shoe, lower, shade, (38.0, 36.0, 36.0)),
            Part(_limb(0.0, hip + thigh, shin - 0.1 * thick, 0.8 * thick), lower, shade, trousers),
            Part(_limb(0.0, hip, thigh, thick), upper, shade, trousers),
        ]

    def sleeve(offset: float, shade: float) -> list[Part]:
        shoulder = neck + 0.06 * h

        def sway(phase: float) -> Affine:
            return _turn_about(0.0, shoulder, -0.9 * reach * math.sin(2 * math.pi * (phase + offset)))

        palm = _disc(0.0, shoulder + arm, 0.36 * thick, 0.42 * thick, 16)
        return [Part(palm, sway, shade, skin), Part(_limb(0.0, shoulder, arm, 0.72 * thick), sway, shade)]

    torso = _round_box(-0.85 * thick, neck, 0.85 * thick, hip + 0.05 * h, 0.5 * thick)
    head = _disc(0.02 * h, -0.42 * h, 0.065 * h, 0.08 * h)
    hair = _disc(0.005 * h, -0.455 * h, 0.066 * h, 0.045 * h)
    return (
        *sleeve(0.0, 0.65), *leg(0.5, 0.75), *leg(0.0, 1.0), Part(torso), Part(head, tone=skin),
        Part(hair, tone=(34.0, 42.0, 54.0)), *sleeve(0.5, 0.85),
    )  # fmt: skip


SHAPES: dict[str, Callable[[float, float, int], tuple[Part, ...]]] = {
    "ellipse": ellipse,
    "box": box,
    "bar": bar,
    "polygon": polygon,
    "blob": blob,
    "gear": gear,
    "fan2": partial(fan, 2),
    "fan3": partial(fan, 3),
    "fan4": partial(fan, 4),
    "fan5": partial(fan, 5),
    "star": star,
    "cross": cross,
    "L": ell,
    "T": tee,
    "U": horseshoe,
    "car": car,
    "walker": walker,
}
