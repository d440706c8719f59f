"""Suites that are distributions: (theme, seed, index) -> spec, a pure function.

A theme fills in a draft (what moves, how, over which ground), then up to three nuisances of other kinds are added,
and last the way is laid so that the target stays in the frame. Every sequence has a generator of its own, seeded
from theme, seed and index alone: how many are drawn, and in which process, changes none of them.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from .motion import PATHS
from .spec import Actor, Blank, Camera, Deform, Effect, Motion, Path, Scene, SequenceSpec, Shadow, Texture

__all__ = ["THEMES", "draw", "draw_mixed"]

Colour = tuple[float, float, float]
Span = tuple[float, float]
Rng = np.random.Generator

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
_CONVEX = ("ellipse", "box", "polygon", "blob")
_CONCAVE = ("gear", "fan2", "fan3", "fan4", "fan5", "star", "cross", "L", "T", "U")
_ROUND = ("gear", "fan2", "fan3", "fan4", "fan5", "star")  # of one diameter: other proportions would make them lame
_SIZES = ((320, 240),) * 8 + ((240, 180), (480, 360))
_MARGIN = 4.0  # px between the target and the frame's edge
_APART = (55.0, 180.0)  # distance of the mean colours of target and ground, grey levels
_LUMA = np.array([0.114, 0.587, 0.299])
_NUISANCES = (0.25, 0.35, 0.25, 0.15)  # chances of none, one, two, three


def _generator(*key: object) -> Rng:
    digest = hashlib.sha256(" ".join(map(str, key)).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest[:16], "little"))


def _seed(rng: Rng) -> int:
    return int(rng.integers(1, 1_000_000))


def _pick(rng: Rng, names: tuple[str, ...]) -> str:
    return names[int(rng.integers(len(names)))]


def _uniform(rng: Rng, low: float, high: float) -> float:
    """Draw rounded to two decimals, so that a printed spec stays readable."""
    return round(float(rng.uniform(low, high)), 2)


def _scaled(rng: Rng, low: float, high: float) -> float:
    """Draw whose logarithm is uniform: as many small ones as large ones."""
    return round(float(math.exp(rng.uniform(math.log(low), math.log(high)))), 2)


def _sign(rng: Rng) -> float:
    return 1.0 if rng.random() < 0.5 else -1.0


def _chance(rng: Rng, share: float) -> bool:
    return bool(rng.random() < share)


def _colour_apart(rng: Rng, other: Colour, distance: Span, luma: float = 0.0) -> Colour:
    """Colour whose distance from another is within limits, and its luminance at least `luma` from it."""
    best, least = other, math.inf
    for _ in range(200):
        drawn = rng.uniform(30.0, 225.0, 3).round()
        away = drawn - np.asarray(other)
        far = float(np.hypot.reduce(away))
        excess = max(distance[0] - far, far - distance[1], luma - abs(float(away @ _LUMA)), 0.0)
        if excess < least:
            best, least = (float(drawn[0]), float(drawn[1]), float(drawn[2])), excess
        if excess == 0.0:
            break
    return best


@dataclass
class _Draft:
    """A sequence in the making; whoever fills it in may still change anything."""

    rng: Rng
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
        if self.spin or self.roll != (0.0, 0.0) or self.shape in _ROUND:
            x = y = math.hypot(w, h) / 2.0 if self.shape not in _ROUND else max(w, h) / 2.0
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


def _texture_of_ground(rng: Rng) -> Texture:
    kind = _pick(rng, tuple(_GROUNDS))
    b, g, r = (value + float(rng.integers(-20, 21)) for value in _GROUNDS[kind])
    return Texture(kind, _uniform(rng, 0.6, 1.0), (b, g, r), seed=_seed(rng))


def _skin(rng: Rng, ground: Texture, distance: Span = _APART) -> Texture:
    """Surface of another kind and another colour than the ground."""
    kind = _pick(rng, tuple(kind for kind in _SKINS if kind != ground.kind))
    assert ground.colour is not None
    colour = _colour_apart(rng, ground.colour, distance)
    return Texture(kind, _uniform(rng, 0.6, 1.1), colour, seed=_seed(rng), shrink=int(rng.integers(1, 4)))


def _ordinary(rng: Rng) -> _Draft:
    """One thing of middling size that goes somewhere at middling speed."""
    width, height = _SIZES[int(rng.integers(len(_SIZES)))]
    ground = _texture_of_ground(rng)
    draft = _Draft(rng, (width, height), int(rng.integers(60, 101)), ground, _skin(rng, ground))
    draft.shape = _pick(rng, _CONVEX if _chance(rng, 0.6) else _CONCAVE)
    side = _scaled(rng, 28, 84) * draft.unit
    slenderness = 1.0 if draft.shape in _ROUND else _uniform(rng, 0.55, 1.0)
    tall = _chance(rng, 0.4)
    long, short = round(side, 2), round(side * slenderness, 2)
    draft.size = (short, long) if tall else (long, short)
    draft.angle = _uniform(rng, -30, 30)
    draft.spin = _uniform(rng, -1.0, 1.0) if _chance(rng, 0.3) else 0.0
    draft.speed = _scaled(rng, 0.7, 4.5) * draft.unit
    draft.way = _pick(rng, ("straight", "straight", "weave", "orbit", "bouncing"))
    draft.noise = _uniform(rng, 0.8, 3.0)
    return draft


# --- themes ------------------------------------------------------------------------------------------------


def _rotate_in_place(draft: _Draft) -> None:
    """Bars, fans, stars, crosses and letters that turn about their centre; some rest first, some stop."""
    rng = draft.rng
    draft.shape = _pick(
        rng, ("bar", "bar", "thin", "fan2", "fan3", "fan3", "fan4", "fan5", "star", "cross", "L", "T", "U", "ellipse")
    )
    half = _uniform(rng, 15, 60) * draft.unit
    ratio = _uniform(rng, 0.18, 0.5) if draft.shape in ("bar", "ellipse") else 1.0
    if draft.shape == "thin":
        draft.shape, ratio = "bar", max(_uniform(rng, 0.08, 0.16), 2.5 / half)
    if draft.shape in ("L", "T", "U"):
        half, ratio = half / 1.2, _uniform(rng, 0.7, 1.0)
    draft.size = (round(2.0 * half, 2), round(2.0 * half * ratio, 2))
    draft.angle = _uniform(rng, 0, 360)
    draft.spin = round(math.degrees(_uniform(rng, 0.03, 0.15)) * _sign(rng), 2)
    draft.way = "hold"
    if _chance(rng, 0.12):
        _plain_ground(draft)
    chance = rng.random()
    if chance < 0.2:
        draft.rests = ((0, int(rng.integers(3, 20))),)
    elif chance < 0.35:
        draft.rests = ((int(rng.integers(25, 45)), draft.frames),)
    elif chance < 0.45:
        draft.rests = ((int(rng.integers(20, 30)), int(rng.integers(36, 50))),)


def _straight(draft: _Draft) -> None:
    draft.way = _pick(draft.rng, ("straight", "weave"))


def _orbit(draft: _Draft) -> None:
    draft.way, draft.speed = "orbit", _uniform(draft.rng, 1.5, 5) * draft.unit


def _bouncing(draft: _Draft) -> None:
    draft.way, draft.speed = "bouncing", _uniform(draft.rng, 2, 6) * draft.unit


def _stops(draft: _Draft) -> None:
    """Stop and go; some begin at rest."""
    rng = draft.rng
    draft.way, draft.speed = _pick(rng, ("straight", "orbit", "bouncing")), _uniform(rng, 1.5, 5) * draft.unit
    at, rests = 0 if _chance(rng, 0.3) else int(rng.integers(8, 25)), []
    while at < draft.frames - 10:
        stop = at + int(rng.integers(6, 20))
        rests.append((at, stop))
        at = stop + int(rng.integers(12, 30))
    draft.rests = tuple(rests)


def _rotate_and_move(draft: _Draft) -> None:
    rng = draft.rng
    draft.spin = round(math.degrees(_uniform(rng, 0.03, 0.12)) * _sign(rng), 2)
    draft.shape = _pick(rng, ("bar", "box", "polygon", "blob", *_CONCAVE))
    if draft.shape in _ROUND:
        draft.size = (max(draft.size),) * 2
    elif draft.shape == "bar":
        draft.size = (max(draft.size), round(max(draft.size) * _uniform(rng, 0.2, 0.5), 2))


def _deform(draft: _Draft) -> None:
    rng = draft.rng
    draft.shape = _pick(rng, ("blob", "ellipse", "box", "polygon"))
    draft.spin = 0.0
    squash = Deform("squash", _uniform(rng, 0.1, 0.35), _uniform(rng, 1.5, 4))
    other = Deform(_pick(rng, ("wave", "bend")), _uniform(rng, 0.1, 0.35), _uniform(rng, 1.5, 4))
    draft.deform = ((squash,), (other,), (squash, other))[int(rng.integers(3))]


def _turn(draft: _Draft) -> None:
    rng = draft.rng
    draft.shape, draft.spin, draft.angle = _pick(rng, ("box", "ellipse")), 0.0, _uniform(rng, -10, 10)
    draft.deform = (Deform("turn", _uniform(rng, 0.45, 1.0), _uniform(rng, 0.4, 1.5)),)


def _glint(draft: _Draft) -> None:
    glint = Effect("glint", _uniform(draft.rng, 80, 220), _uniform(draft.rng, 1.5, 5))
    draft.surface = (Effect("shade", 0.15), glint)


def _pulse(draft: _Draft) -> None:
    draft.surface = (Effect("pulse", _uniform(draft.rng, 0.08, 0.25), _uniform(draft.rng, 1.5, 8)),)


def _morph(draft: _Draft) -> None:
    draft.morph = _skin(draft.rng, draft.ground)


def _flicker(draft: _Draft) -> None:
    draft.effects.append(Effect("flicker", _uniform(draft.rng, 0.06, 0.28), _uniform(draft.rng, 3, 30)))


def _plain_ground(draft: _Draft) -> None:
    b, g, r = (float(value) for value in draft.rng.uniform(60, 190) + draft.rng.uniform(-20, 20, 3).round(0))
    draft.ground = Texture("plain", colour=(round(b), round(g), round(r)))
    draft.skin = _skin(draft.rng, draft.ground)


def _plain_object(draft: _Draft) -> None:
    rng = draft.rng
    assert draft.ground.colour is not None
    draft.skin = Texture("plain", colour=_colour_apart(rng, draft.ground.colour, (90.0, 400.0)))
    draft.surface = (Effect("shade", _uniform(rng, 0.05, 0.2)),)


def _low_contrast(draft: _Draft) -> None:
    draft.skin = _skin(draft.rng, draft.ground, (30.0, 60.0))
    draft.effects.append(Effect("haze", _uniform(draft.rng, 0.35, 0.65)))
    draft.noise = _uniform(draft.rng, 0.8, 1.8)


def _small(draft: _Draft) -> None:
    rng = draft.rng
    draft.shape = _pick(rng, _CONVEX)
    side = _uniform(rng, 9, 20)
    draft.size = (side, max(round(side * _uniform(rng, 0.7, 1.0), 2), 8.0))
    draft.skin = _skin(rng, draft.ground, (90.0, 400.0))
    draft.speed = _scaled(rng, 0.5, 3.0)
    draft.noise = _uniform(rng, 0.8, 2.0)


def _large(draft: _Draft) -> None:
    rng = draft.rng
    side = _uniform(rng, 100, 140) * draft.unit
    draft.shape, draft.spin = _pick(rng, _CONVEX), 0.0
    draft.size = (round(side, 2), round(side * _uniform(rng, 0.7, 1.0), 2))


def _fast(draft: _Draft) -> None:
    rng = draft.rng
    draft.way, draft.speed = _pick(rng, ("orbit", "bouncing")), _uniform(rng, 6, 14)
    draft.size = (max(draft.size[0], 30.0), max(draft.size[1], 30.0))
    if draft.shape in _ROUND:
        draft.size = (max(draft.size),) * 2


def _growing(draft: _Draft) -> None:
    rng = draft.rng
    factor = _uniform(rng, 1.4, 2.2)
    small = round(_uniform(rng, 28, 48) * draft.unit, 2)
    share = small / max(draft.size)
    draft.size = (round(draft.size[0] * share, 2), round(draft.size[1] * share, 2))
    draft.growth = (1.0, factor) if _chance(rng, 0.6) else (factor, 1.0)


def _jitter(draft: _Draft) -> None:
    draft.jitter = _uniform(draft.rng, 0.4, 2.2)


def _pan(draft: _Draft) -> None:
    rng = draft.rng
    speed = _uniform(rng, 0.5, 4.0) * draft.unit * (draft.frames - 1)
    draft.pan = (round(speed * _sign(rng), 2), round(speed * float(rng.uniform(-0.3, 0.3)), 2))
    draft.jitter = _uniform(rng, 0.0, 0.5)
    draft.speed = min(draft.speed, 3.0 * draft.unit)


def _zoom(draft: _Draft) -> None:
    draft.zoom = (
        (1.0, _uniform(draft.rng, 1.2, 1.7)) if _chance(draft.rng, 0.6) else (_uniform(draft.rng, 1.2, 1.6), 1.0)
    )


def _roll(draft: _Draft) -> None:
    draft.roll = (0.0, _uniform(draft.rng, 5, 20) * _sign(draft.rng))


def _noise(draft: _Draft) -> None:
    draft.noise = _uniform(draft.rng, 6, 18)


def _blur(draft: _Draft) -> None:
    draft.shutter = _uniform(draft.rng, 0.4, 0.95)
    draft.speed = max(draft.speed, _uniform(draft.rng, 3, 8) * draft.unit)
    draft.way = _pick(draft.rng, ("orbit", "bouncing", "straight"))


def _shutter(draft: _Draft) -> None:
    draft.shutter = _uniform(draft.rng, 0.3, 0.8)


def _jpeg(draft: _Draft) -> None:
    draft.effects.append(Effect("jpeg", float(draft.rng.integers(20, 71))))


def _ramp(rng: Rng) -> Span:
    """A jump, a quick change, or a drift over all of the sequence."""
    at = _uniform(rng, 0.15, 0.7)
    return ((at, at), (at, round(at + 0.2, 2)), (0.0, 1.0))[int(rng.integers(3))]


def _exposure(draft: _Draft) -> None:
    gain = _uniform(draft.rng, 0.5, 0.85) if _chance(draft.rng, 0.6) else _uniform(draft.rng, 1.15, 1.5)
    draft.effects.append(Effect("exposure", gain, ramp=_ramp(draft.rng)))


def _white_balance(draft: _Draft) -> None:
    rng = draft.rng
    if _chance(rng, 0.5):
        draft.effects.append(Effect("red", _uniform(rng, 1.15, 1.35), ramp=_ramp(rng)))
        return
    by = _uniform(rng, 0.1, 0.25) * _sign(rng)
    draft.effects += [Effect("red", round(1.0 + by, 2)), Effect("blue", round(1.0 - by, 2))]


def _shadow(draft: _Draft) -> None:
    rng = draft.rng
    offset = (_uniform(rng, 4, 22) * _sign(rng), _uniform(rng, 4, 22))
    draft.shadow = Shadow(offset, _uniform(rng, 0.25, 0.6), _uniform(rng, 1.5, 4))


def _crossing(draft: _Draft) -> None:
    """From side to side, so that something can stand in the way."""
    draft.way, draft.spin, draft.rests = "across", 0.0, ()


def _pole(draft: _Draft) -> None:
    _crossing(draft)
    draft.pole = round(max(min(draft.size) * _uniform(draft.rng, 0.2, 0.6), 5.0), 2)


def _full_occlusion(draft: _Draft) -> None:
    rng = draft.rng
    _crossing(draft)
    draft.shape, draft.angle, draft.frames = _pick(rng, _CONVEX), 0.0, int(rng.integers(80, 101))
    side = _uniform(rng, 28, 46) * draft.unit
    draft.size = (round(side, 2), round(side * _uniform(rng, 0.7, 1.0), 2))
    draft.pole = round(draft.size[0] + _uniform(rng, 4, 40) * draft.unit, 2)


def _second_mover(draft: _Draft) -> None:
    draft.passers, draft.twin = (1 if _chance(draft.rng, 0.7) else 2), _chance(draft.rng, 0.3)


def _absence(rng: Rng, frames: int, low: int, high: int) -> tuple[int, int]:
    """Span of frames; as often after one, two or three good ones as after ten or forty."""
    first = round(_scaled(rng, 2, frames - high - 12))
    return first, first + int(rng.integers(low, high + 1))


def _blank(draft: _Draft) -> None:
    first, stop = _absence(draft.rng, draft.frames, 3, 12)
    draft.blanks = (Blank(_pick(draft.rng, ("black", "white", "gray", "static")), first, stop),)


def _empty(draft: _Draft) -> None:
    """The object is gone, the scene stays; it is back where its way has led it, or where it was."""
    span = _absence(draft.rng, draft.frames, 6, 25)
    draft.hidden = (span,)
    if _chance(draft.rng, 0.5):
        draft.rests = (span,)


def _leaves(draft: _Draft) -> None:
    draft.way, draft.spin, draft.frames = "out", 0.0, int(draft.rng.integers(85, 101))
    side = _uniform(draft.rng, 28, 52) * draft.unit
    share = side / max(draft.size)
    draft.size = (round(draft.size[0] * share, 2), round(draft.size[1] * share, 2))


def _gray(draft: _Draft) -> None:
    assert draft.ground.colour is not None
    draft.skin = replace(draft.skin, colour=_colour_apart(draft.rng, draft.ground.colour, _APART, luma=40.0))
    draft.morph = None
    draft.effects.append(Effect("gray"))


def _thermal(draft: _Draft) -> None:
    """Warm, nearly plain thing over a cool, soft ground, in gray."""
    rng = draft.rng
    level = _uniform(rng, 50, 110)
    draft.ground = Texture(
        _pick(rng, ("clouds", "moon", "speckle", "gravel")), _uniform(rng, 0.2, 0.6), (level,) * 3, _seed(rng)
    )
    warm = _uniform(rng, level + 50, min(level + 120, 235))
    draft.skin = Texture(_pick(rng, ("clouds", "speckle", "plain")), _uniform(rng, 0.2, 0.6), (warm,) * 3, _seed(rng))
    draft.surface = (Effect("shade", _uniform(rng, 0.05, 0.2)),)
    draft.effects.append(Effect("gray"))
    draft.noise = _uniform(rng, 2, 6)


def _walker(draft: _Draft) -> None:
    rng = draft.rng
    _crossing(draft)
    height = round(_uniform(rng, 60, 120) * draft.unit, 2)
    draft.shape, draft.size, draft.angle = "walker", (height / 2.0, height), 0.0
    draft.skin = Texture("speckle", 0.9, draft.skin.colour, _seed(rng))
    draft.speed = _uniform(rng, 1.2, 3.5) * draft.unit
    # A turn of the legs carries 0.78 of the height: feet that stay where they stand.
    draft.gait = round(draft.speed / (0.78 * height), 4)


def _car(draft: _Draft) -> None:
    rng = draft.rng
    _crossing(draft)
    height = round(_uniform(rng, 24, 44) * draft.unit, 2)
    draft.shape, draft.size, draft.angle = "car", (round(2.4 * height, 2), height), 0.0
    draft.skin = Texture("speckle", 0.5, draft.skin.colour, _seed(rng))
    draft.surface = (Effect("shade", 0.15), Effect("glint", _uniform(rng, 40, 110), _uniform(rng, 1, 3)))
    draft.speed = _uniform(rng, 1.2, 5) * draft.unit
    draft.gait = round(draft.speed / (2.0 * math.pi * 0.22 * height), 4)


Recipe = Callable[[_Draft], None]

THEMES: dict[str, tuple[Recipe, tuple[str, ...]]] = {
    "rotate_in_place": (_rotate_in_place, ("way", "surface", "camera", "blur")),
    "straight": (_straight, ()),
    "orbit": (_orbit, ("way",)),
    "bouncing": (_bouncing, ("way",)),
    "stops": (_stops, ("way",)),
    "rotate_and_move": (_rotate_and_move, ("way",)),
    "deform": (_deform, ("surface",)),
    "turn": (_turn, ("surface",)),
    "glint": (_glint, ("surface",)),
    "pulse": (_pulse, ("surface",)),
    "morph": (_morph, ("surface", "gray")),
    "flicker": (_flicker, ("light",)),
    "plain_ground": (_plain_ground, ("contrast",)),
    "plain_object": (_plain_object, ("contrast", "surface")),
    "low_contrast": (_low_contrast, ("contrast", "noise", "jpeg", "light", "gray", "blur")),
    "small": (_small, ("contrast", "noise", "way", "blur")),
    "large": (_large, ("way", "passer")),
    "fast": (_fast, ("way", "gone")),
    "growing": (_growing, ("camera",)),
    "jitter": (_jitter, ("camera",)),
    "pan": (_pan, ("camera", "way")),
    "zoom": (_zoom, ("camera",)),
    "roll": (_roll, ("camera",)),
    "noise": (_noise, ("noise", "contrast")),
    "blur": (_blur, ("blur", "way", "camera")),
    "jpeg": (_jpeg, ("jpeg",)),
    "exposure": (_exposure, ("light",)),
    "white_balance": (_white_balance, ("light", "gray")),
    "shadow": (_shadow, ("shadow",)),
    "pole": (_pole, ("way", "camera")),
    "full_occlusion": (_full_occlusion, ("way", "camera", "gone", "passer")),
    "second_mover": (_second_mover, ("passer", "camera")),
    "blank": (_blank, ("gone",)),
    "empty": (_empty, ("gone", "way")),
    "leaves": (_leaves, ("way", "camera", "gone")),
    "gray": (_gray, ("gray", "contrast")),
    "thermal": (_thermal, ("gray", "contrast", "surface", "light")),
    "walker": (_walker, ("way", "surface", "camera")),
    "car": (_car, ("way", "surface", "camera")),
}
"""Name -> recipe, and the kinds of nuisance that may not come on top of it."""

NUISANCES: dict[str, tuple[Recipe, tuple[str, ...]]] = {
    "jitter": (_jitter, ("camera",)),
    "pan": (_pan, ("camera", "way")),
    "zoom": (_zoom, ("camera",)),
    "roll": (_roll, ("camera",)),
    "noise": (_noise, ("noise",)),
    "blur": (_shutter, ("blur",)),
    "jpeg": (_jpeg, ("jpeg",)),
    "exposure": (_exposure, ("light",)),
    "white_balance": (_white_balance, ("light", "gray")),
    "flicker": (_flicker, ("light",)),
    "shadow": (_shadow, ("shadow",)),
    "glint": (_glint, ("surface",)),
    "pulse": (_pulse, ("surface",)),
    "pole": (_pole, ("way",)),
    "second_mover": (_second_mover, ("passer",)),
    "blank": (_blank, ("gone",)),
    "gray": (_gray, ("gray", "contrast")),
}
"""Name -> recipe, and the kinds it is of; of each kind a sequence has one at most."""


# --- the way -----------------------------------------------------------------------------------------------


def _point(rng: Rng, room: NDArray[np.float64]) -> Span:
    return _uniform(rng, room[0], room[2]), _uniform(rng, room[1], room[3])


def _straight_way(draft: _Draft, room: NDArray[np.float64], length: float) -> Path:
    """Straight line of that length if there is one in the room, else there and back on a long one."""
    start, end, longest = (0.0, 0.0), (0.0, 0.0), -1.0
    for _ in range(30):
        first, angle = _point(draft.rng, room), draft.rng.uniform(0.0, 2.0 * math.pi)
        aim = np.array(first) + length * np.array([math.cos(angle), math.sin(angle)])
        last = np.clip(aim, room[:2], room[2:]).round(2)
        far = math.dist(first, last)
        if far > longest:
            start, end, longest = first, (float(last[0]), float(last[1])), far
        if far >= 0.999 * length:
            break
    if length > 1.3 * longest:
        return Path("bounce", start, end, cycles=round(length / (2.0 * longest), 3))
    return Path(_pick(draft.rng, ("line", "line", "ease")), start, end)


def _weaving_way(draft: _Draft, room: NDArray[np.float64], length: float) -> Path:
    amplitude = round(min(_uniform(draft.rng, 6, 24) * draft.unit, float((room[2:] - room[:2]).min()) / 4.0), 2)
    straight = _straight_way(draft, room + np.array([amplitude, amplitude, -amplitude, -amplitude]), length)
    cycles = _uniform(draft.rng, 0.8, 2.0)
    return Path("weave", straight.start, straight.end, amplitude, cycles)


def _orbiting_way(draft: _Draft, room: NDArray[np.float64], length: float) -> Path:
    rng, half = draft.rng, (room[2:] - room[:2]) / 2.0
    rx, ry = (float(rng.uniform(0.45, 1.0) * value) for value in half)
    x, y = _point(rng, room + np.array([rx, ry, -rx, -ry]))
    perimeter = math.pi * (3.0 * (rx + ry) - math.sqrt((3.0 * rx + ry) * (rx + 3.0 * ry)))
    corner = (round(x + rx * _sign(rng), 2), round(y + ry * _sign(rng), 2))
    return Path("orbit", (x, y), corner, cycles=round(length / perimeter, 3))


def _bouncing_way(draft: _Draft, room: NDArray[np.float64], length: float) -> Path:
    """As a ball between four walls."""
    rng = draft.rng
    place = np.array(_point(rng, room))
    angle = rng.uniform(0.15, 0.5 * math.pi - 0.15)
    heading = np.array([math.cos(angle) * _sign(rng), math.sin(angle) * _sign(rng)])
    knots, gone = [(0.0, float(place[0]), float(place[1]))], 0.0
    while gone < length:
        wall = np.where(heading > 0, room[2:], room[:2])
        reach = (wall - place) / heading
        axis = int(np.argmin(reach))
        step = min(float(reach[axis]), length - gone)
        place, gone = place + step * heading, gone + step
        heading[axis] = -heading[axis]
        x, y = np.clip(place, room[:2], room[2:]).round(2).tolist()
        knots.append((min(round(gone / length, 5), 1.0), x, y))
    return Path("knots", knots=tuple(knots))


def _way_across(draft: _Draft, room: NDArray[np.float64], length: float) -> Path:
    """From side to side, at least as far as it takes to pass the pole."""
    rng = draft.rng
    wide = float(room[2] - room[0])
    far = min(max(length, 2.0 * draft.half_extent()[0] + draft.pole + 20.0), wide)
    left = round(float(room[0] + rng.random() * (wide - far)), 2)
    ends = ((left, _uniform(rng, room[1], room[3])), (round(left + far, 2), _uniform(rng, room[1], room[3])))
    if draft.shape in ("walker", "car"):
        # They keep to the floor, roll without slipping, and look where they go.
        ends = (ends[0], (ends[1][0], ends[0][1]))
        draft.gait = round(draft.gait * far / length, 4)
    draft.mirror = _chance(rng, 0.5)
    return Path("line", *(ends[::-1] if draft.mirror else ends))


def _way_out(draft: _Draft, room: NDArray[np.float64], length: float) -> Path:
    """Out of the frame on one side, in again there or on the other."""
    rng, half = draft.rng, draft.half_extent()[0] + 6.0
    outside = (-half, draft.frame[0] + half)
    out, back = (outside[int(rng.integers(2))] for _ in range(2))
    first, last, high, low = (_point(rng, room) for _ in range(4))
    gone = _uniform(rng, 0.3, 0.45)
    knots = (
        (0.0, *first),
        (gone, round(out, 2), high[1]),
        (round(gone + _uniform(rng, 0.08, 0.2), 2), round(back, 2), low[1]),
        (1.0, *last),
    )
    return Path("knots", knots=knots)


def _no_way(draft: _Draft, room: NDArray[np.float64], length: float) -> Path:
    return Path("hold", _point(draft.rng, room))


_WAYS: dict[str, Callable[[_Draft, NDArray[np.float64], float], Path]] = {
    "hold": _no_way,
    "straight": _straight_way,
    "weave": _weaving_way,
    "orbit": _orbiting_way,
    "bouncing": _bouncing_way,
    "across": _way_across,
    "out": _way_out,
}


# --- the rest of the scene ---------------------------------------------------------------------------------


def _pole_before(draft: _Draft, path: Path) -> Actor:
    """Upright in the middle of the way."""
    texture = _skin(draft.rng, draft.ground, (35.0, 400.0))
    place = ((path.start[0] + path.end[0]) / 2.0, draft.frame[1] / 2.0)
    return Actor("bar", (draft.pole, 3.0 * draft.frame[1]), texture, Motion(Path("hold", place)))


def _passer(draft: _Draft, start: Span) -> Actor:
    """Another thing that crosses the frame; where there is no place beside the target it enters from outside."""
    rng, (width, height) = draft.rng, draft.frame
    side = round(_scaled(rng, 0.7, 1.3) * max(draft.size), 2)
    shape = draft.shape if draft.twin else _pick(rng, _CONVEX)
    size = draft.size if draft.twin else (side, round(side * _uniform(rng, 0.6, 1.0), 2))
    texture = draft.skin if draft.twin else _skin(rng, draft.ground)
    near = (math.hypot(*size) / 2.0 + math.hypot(*draft.half_extent())) / min(1.0, *draft.zoom) + 8.0
    frame = np.array([0.0, 0.0, width, height])
    places = [_point(rng, frame) for _ in range(12)]
    outside = (width + near if _chance(rng, 0.5) else -near, _uniform(rng, 0.0, height))
    begin = next((place for place in places if math.dist(place, start) > near), outside)
    aim = (width - begin[0] + _uniform(rng, -40, 40), height - begin[1] + _uniform(rng, -40, 40))
    path = Path(_pick(rng, ("line", "swing")), begin, (round(aim[0], 2), round(aim[1], 2)))
    angle = draft.angle if draft.twin else _uniform(rng, -30, 30)
    motion = Motion(path, angle=angle, spin=draft.spin, with_camera=draft.pan != (0.0, 0.0))
    return Actor(shape, size, texture, motion, seed=_seed(rng))


def _finish(draft: _Draft, name: str, theme: str) -> SequenceSpec:
    room = draft.room()
    while draft.pole and room[2] - room[0] < 2.0 * draft.half_extent()[0] + draft.pole + 20.0:
        draft.size, draft.pole = (round(draft.size[0] * 0.9, 2), round(draft.size[1] * 0.9, 2)), draft.pole * 0.9
        room = draft.room()
    draft.pole = round(draft.pole, 2)
    path = _WAYS[draft.way](draft, room, draft.speed * (draft.frames - 1))
    start = PATHS[path.kind](path, 0.0)
    poles = (_pole_before(draft, path),) if draft.pole else ()
    passers = tuple(_passer(draft, start) for _ in range(draft.passers))
    in_front = _chance(draft.rng, 0.5)
    motion = Motion(
        path, draft.angle, draft.spin, draft.growth, draft.gait, draft.hidden, draft.rests, draft.pan != (0.0, 0.0)
    )
    target = Actor(
        draft.shape, draft.size, draft.skin, motion, draft.deform, draft.surface, draft.morph, draft.shadow,
        draft.mirror, _seed(draft.rng),
    )  # fmt: skip
    behind, front = ((), passers) if in_front else (passers, ())
    pan = Path("line", end=draft.pan) if draft.pan != (0.0, 0.0) else Path("hold")
    return SequenceSpec(
        name,
        target,
        Scene(draft.ground, behind, (*front, *poles)),
        Camera(pan, draft.jitter, draft.zoom, draft.roll, draft.shutter),
        (*draft.effects, Effect("noise", draft.noise)),
        draft.frame,
        draft.frames,
        _seed(draft.rng),
        tuple(draft.attributes),
        draft.blanks,
        theme,
    )


def draw(theme: str, seed: int, index: int) -> SequenceSpec:
    """Draw a sequence.

    Parameters
    ----------
    theme : str
        Name in ``THEMES``.
    seed, index : int
        Which distribution suite, and which of its sequences. Nothing else decides about the draw.

    Returns
    -------
    SequenceSpec
        Named ``theme_seed_index``. Its attributes are the theme and the nuisances that came on top.

    Raises
    ------
    ValueError
        If the theme is unknown.
    """
    if theme not in THEMES:
        raise ValueError(f"unknown theme {theme!r}; known: {', '.join(THEMES)}")
    rng = _generator(theme, seed, index)
    draft = _ordinary(rng)
    recipe, excluded = THEMES[theme]
    recipe(draft)
    draft.attributes.append(theme)
    taken = set(excluded)
    for _ in range(int(rng.choice(len(_NUISANCES), p=_NUISANCES))):
        free = [name for name, (_, kinds) in NUISANCES.items() if taken.isdisjoint(kinds) and name != theme]
        name = free[int(rng.integers(len(free)))]
        add, kinds = NUISANCES[name]
        add(draft)
        draft.attributes.append(name)
        taken.update(kinds)
    return _finish(draft, f"{theme}_{seed}_{index}", theme)


def draw_mixed(seed: int, index: int) -> SequenceSpec:
    """Draw sequence `index` of all themes by turns, in an order that the seed decides; see :func:`draw`."""
    order = sorted(THEMES, key=lambda theme: _generator("order", seed, theme).random())
    return draw(order[index % len(order)], seed, index)
