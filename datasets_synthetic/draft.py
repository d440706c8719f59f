"""A sequence in the making: what may be drawn of it, and helpers that draw."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .spec import Blank, Deform, Effect, Shadow, Texture

__all__ = [
    "APART", "CONCAVE", "CONVEX", "ROUND", "Colour", "Dice", "Draft", "Span", "colour_apart", "new_skin", "ordinary",
    "texture_of_ground",
]  # fmt: skip

Colour = tuple[float, float, float]
Span = tuple[float, float]

_GROUNDS: dict[str, Colour] = {
    "grass": (66.0, 120.0, 100.0),
    "gravel": (110.0, 120.0, 126.0),
    "brick": (80.0, 98.0, 138.0),
    "moon": (112.0, 118.0, 124.0),
    "coins": (97.0, 97.0, 97.0),
    "camera": (124.0, 126.0, 130.0),
    "coffee": (60.0, 92.0, 156.0),
    "chelsea": (87.0, 111.0, 148.0),
    "astronaut": (96.0, 106.0, 142.0),
    "page": (165.0, 170.0, 172.0),
    "clouds": (128.0, 124.0, 118.0),
    "speckle": (98.0, 96.0, 94.0),
    "patches": (126.0, 128.0, 122.0),
}
"""Grounds with a mean colour each is plausible in; the draw moves it by up to 20 grey levels a channel."""

_SKINS = (
    "patches", "stripes", "dots", "checker", "clouds", "speckle", "astronaut", "chelsea", "coffee", "brick", "grass",
    "gravel",
)  # fmt: skip
CONVEX = ("ellipse", "box", "polygon", "blob")
CONCAVE = ("gear", "fan2", "fan3", "fan4", "fan5", "star", "cross", "L", "T", "U")
ROUND = ("gear", "fan2", "fan3", "fan4", "fan5", "star")  # of one diameter: other proportions would make them lame
_SIZES = ((320, 240),) * 8 + ((240, 180), (480, 360))
_MARGIN = 4.0  # px between the target and the frame's edge
APART = (55.0, 180.0)  # distance of the mean colours of target and ground, grey levels
_LUMA = np.array([0.114, 0.587, 0.299])


class Dice:
    """Draws of one sequence.

    Parameters
    ----------
    *key : object
        What alone decides about them.
    """

    def __init__(self, *key: object) -> None:
        digest = hashlib.sha256(" ".join(map(str, key)).encode()).digest()
        self._rng = np.random.default_rng(int.from_bytes(digest[:16], "little"))

    def share(self) -> float:
        """Draw from 0 to 1."""
        return float(self._rng.random())

    def whole(self, low: int, stop: int) -> int:
        """Draw a whole number from `low` to `stop` − 1."""
        return int(self._rng.integers(low, stop))

    def seed(self) -> int:
        """Draw a seed for a texture, a shape or noise."""
        return self.whole(1, 1_000_000)

    def pick(self, names: tuple[str, ...]) -> str:
        """Draw one of the names."""
        return names[self.whole(0, len(names))]

    def uniform(self, low: float, high: float) -> float:
        """Draw rounded to two decimals, so that a printed spec stays readable."""
        return round(float(self._rng.uniform(low, high)), 2)

    def scaled(self, low: float, high: float) -> float:
        """Draw whose logarithm is uniform: as many small ones as large ones."""
        return round(float(math.exp(self._rng.uniform(math.log(low), math.log(high)))), 2)

    def sign(self) -> float:
        """Draw 1 or −1."""
        return 1.0 if self.share() < 0.5 else -1.0

    def chance(self, share: float) -> bool:
        """Draw True in that share of the cases."""
        return self.share() < share

    def colour(self) -> Colour:
        """Draw a colour, neither black nor white."""
        b, g, r = self._rng.uniform(30.0, 225.0, 3).round().tolist()
        return b, g, r


def colour_apart(dice: Dice, other: Colour, distance: Span, luma: float = 0.0) -> Colour:
    """Colour whose distance from another is within limits, and its luminance at least `luma` from it."""
    best, least = other, math.inf
    for _ in range(200):
        drawn = dice.colour()
        far, brighter = math.dist(drawn, other), float(np.subtract(drawn, other) @ _LUMA)
        excess = max(distance[0] - far, far - distance[1], luma - abs(brighter), 0.0)
        if excess < least:
            best, least = drawn, excess
        if excess == 0.0:
            break
    return best


@dataclass
class Draft:
    """A sequence in the making; whoever fills it in may still change anything."""

    dice: Dice
    frame: tuple[int, int]
    frames: int
    ground: Texture
    skin: Texture
    shape: str = "ellipse"
    size: Span = (50.0, 50.0)
    angle: float = 0.0
    spin: float = 0.0
    gait: float = 0.0
    growth: Span = (1.0, 1.0)
    mirror: bool = False
    deform: tuple[Deform, ...] = ()
    surface: tuple[Effect, ...] = ()
    morph: Texture | None = None
    shadow: Shadow | None = None
    hidden: tuple[tuple[int, int], ...] = ()
    rests: tuple[tuple[int, int], ...] = ()
    way: str = "straight"
    speed: float = 2.0
    pan: Span = (0.0, 0.0)
    jitter: float = 0.0
    zoom: Span = (1.0, 1.0)
    roll: Span = (0.0, 0.0)
    shutter: float = 0.0
    noise: float = 2.0
    effects: list[Effect] = field(default_factory=list)
    blanks: tuple[Blank, ...] = ()
    pole: float = 0.0
    passers: int = 0
    twin: bool = False
    attributes: list[str] = field(default_factory=list)

    @property
    def unit(self) -> float:
        """Sizes and speeds are drawn for frames 320 px wide."""
        return self.frame[0] / 320.0

    def half_extent(self) -> Span:
        """Largest half width and half height that the target takes in the picture, px, camera included."""
        w, h = self.size
        if self.spin or self.roll != (0.0, 0.0) or self.shape in ROUND:
            x = y = math.hypot(w, h) / 2.0 if self.shape not in ROUND else max(w, h) / 2.0
        else:
            c, s = abs(math.cos(math.radians(self.angle))), abs(math.sin(math.radians(self.angle)))
            x, y = (w * c + h * s) / 2.0, (w * s + h * c) / 2.0
        stretch = max(self.growth) * max(self.zoom)
        for deform in self.deform:
            stretch *= 1.0 if deform.kind == "turn" else 1.0 + deform.strength
        return x * stretch, y * stretch

    def room(self) -> NDArray[np.float64]:
        """Where the target's centre may be in the world of a camera that does not pan: low x, y, high x, y.

        A target that does not fit is made smaller.
        """
        width, height = self.frame
        angle = math.radians(max(map(abs, self.roll)))
        while True:
            x, y = self.half_extent()
            a = width / 2.0 - x - _MARGIN - 4.0 * self.jitter
            b = height / 2.0 - y - _MARGIN - 4.0 * self.jitter
            a, b = a - max(b, 0.0) * math.sin(angle), b - max(a, 0.0) * math.sin(angle)
            a, b = a / max(self.zoom), b / max(self.zoom)
            if min(a, b) >= 6.0:
                return np.array([width / 2.0 - a, height / 2.0 - b, width / 2.0 + a, height / 2.0 + b])
            self.size = (round(self.size[0] * 0.9, 2), round(self.size[1] * 0.9, 2))


def texture_of_ground(dice: Dice) -> Texture:
    """Ground of a plausible colour."""
    kind = dice.pick(tuple(_GROUNDS))
    b, g, r = (value + float(dice.whole(-20, 21)) for value in _GROUNDS[kind])
    return Texture(kind, dice.uniform(0.6, 1.0), (b, g, r), seed=dice.seed())


def new_skin(dice: Dice, ground: Texture, distance: Span = APART) -> Texture:
    """Surface of another kind and another colour than the ground."""
    kind = dice.pick(tuple(kind for kind in _SKINS if kind != ground.kind))
    assert ground.colour is not None
    colour = colour_apart(dice, ground.colour, distance)
    return Texture(kind, dice.uniform(0.6, 1.1), colour, seed=dice.seed(), shrink=dice.whole(1, 4))


def ordinary(dice: Dice) -> Draft:
    """One thing of middling size that goes somewhere at middling speed."""
    width, height = _SIZES[dice.whole(0, len(_SIZES))]
    ground = texture_of_ground(dice)
    draft = Draft(dice, (width, height), dice.whole(60, 101), ground, new_skin(dice, ground))
    draft.shape = dice.pick(CONVEX if dice.chance(0.6) else CONCAVE)
    side = dice.scaled(28, 84) * draft.unit
    slenderness = 1.0 if draft.shape in ROUND else dice.uniform(0.55, 1.0)
    tall = dice.chance(0.4)
    long, short = round(side, 2), round(side * slenderness, 2)
    draft.size = (short, long) if tall else (long, short)
    draft.angle = dice.uniform(-30, 30)
    draft.spin = dice.uniform(-1.0, 1.0) if dice.chance(0.3) else 0.0
    draft.speed = dice.scaled(0.7, 4.5) * draft.unit
    draft.way = dice.pick(("straight", "straight", "weave", "orbit", "bouncing"))
    draft.noise = dice.uniform(0.8, 3.0)
    return draft
