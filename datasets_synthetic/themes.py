"""What is difficult about a drawn sequence: recipes that change a draft, as themes and as nuisances on top of one."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

from .draft import APART, CONCAVE, CONVEX, ROUND, Dice, Draft, Span, colour_apart, new_skin
from .spec import Blank, Deform, Effect, Shadow, Texture

__all__ = ["NUISANCES", "THEMES"]


def _rotate_in_place(draft: Draft) -> None:
    """Bars, fans, stars, crosses and letters that turn about their centre; some rest first, some stop."""
    dice = draft.dice
    draft.shape = dice.pick(
        ("bar", "bar", "thin", "fan2", "fan3", "fan3", "fan4", "fan5", "star", "cross", "L", "T", "U", "ellipse")
    )
    half = dice.uniform(15, 60) * draft.unit
    ratio = dice.uniform(0.18, 0.5) if draft.shape in ("bar", "ellipse") else 1.0
    if draft.shape == "thin":
        draft.shape, ratio = "bar", max(dice.uniform(0.08, 0.16), 2.5 / half)
    if draft.shape in ("L", "T", "U"):
        half, ratio = half / 1.2, dice.uniform(0.7, 1.0)
    draft.size = (round(2.0 * half, 2), round(2.0 * half * ratio, 2))
    draft.angle = dice.uniform(0, 360)
    draft.spin = round(math.degrees(dice.uniform(0.03, 0.15)) * dice.sign(), 2)
    draft.way = "hold"
    if dice.chance(0.12):
        _plain_ground(draft)
    chance = dice.share()
    if chance < 0.2:
        draft.rests = ((0, dice.whole(3, 20)),)
    elif chance < 0.35:
        draft.rests = ((dice.whole(25, 45), draft.frames),)
    elif chance < 0.45:
        draft.rests = ((dice.whole(20, 30), dice.whole(36, 50)),)


def _straight(draft: Draft) -> None:
    draft.way = draft.dice.pick(("straight", "weave"))


def _orbit(draft: Draft) -> None:
    draft.way, draft.speed = "orbit", draft.dice.uniform(1.5, 5) * draft.unit


def _bouncing(draft: Draft) -> None:
    draft.way, draft.speed = "bouncing", draft.dice.uniform(2, 6) * draft.unit


def _stops(draft: Draft) -> None:
    """Stop and go; some begin at rest."""
    dice = draft.dice
    draft.way, draft.speed = dice.pick(("straight", "orbit", "bouncing")), dice.uniform(1.5, 5) * draft.unit
    at, rests = 0 if dice.chance(0.3) else dice.whole(8, 25), []
    while at < draft.frames - 10:
        stop = at + dice.whole(6, 20)
        rests.append((at, stop))
        at = stop + dice.whole(12, 30)
    draft.rests = tuple(rests)


def _rotate_and_move(draft: Draft) -> None:
    dice = draft.dice
    draft.spin = round(math.degrees(dice.uniform(0.03, 0.12)) * dice.sign(), 2)
    draft.shape = dice.pick(("bar", "box", "polygon", "blob", *CONCAVE))
    if draft.shape in ROUND:
        draft.size = (max(draft.size),) * 2
    elif draft.shape == "bar":
        draft.size = (max(draft.size), round(max(draft.size) * dice.uniform(0.2, 0.5), 2))


def _deform(draft: Draft) -> None:
    dice = draft.dice
    draft.shape = dice.pick(("blob", "ellipse", "box", "polygon"))
    draft.spin = 0.0
    squash = Deform("squash", dice.uniform(0.1, 0.35), dice.uniform(1.5, 4))
    other = Deform(dice.pick(("wave", "bend")), dice.uniform(0.1, 0.35), dice.uniform(1.5, 4))
    draft.deform = ((squash,), (other,), (squash, other))[dice.whole(0, 3)]


def _turn(draft: Draft) -> None:
    dice = draft.dice
    draft.shape, draft.spin, draft.angle = dice.pick(("box", "ellipse")), 0.0, dice.uniform(-10, 10)
    draft.deform = (Deform("turn", dice.uniform(0.45, 1.0), dice.uniform(0.4, 1.5)),)


def _glint(draft: Draft) -> None:
    glint = Effect("glint", draft.dice.uniform(80, 220), draft.dice.uniform(1.5, 5))
    draft.surface = (Effect("shade", 0.15), glint)


def _pulse(draft: Draft) -> None:
    draft.surface = (Effect("pulse", draft.dice.uniform(0.08, 0.25), draft.dice.uniform(1.5, 8)),)


def _morph(draft: Draft) -> None:
    draft.morph = new_skin(draft.dice, draft.ground)


def _flicker(draft: Draft) -> None:
    draft.effects.append(Effect("flicker", draft.dice.uniform(0.06, 0.28), draft.dice.uniform(3, 30)))


def _plain_ground(draft: Draft) -> None:
    level = draft.dice.uniform(60, 190)
    b, g, r = (round(level + draft.dice.uniform(-20, 20)) for _ in range(3))
    draft.ground = Texture("plain", colour=(b, g, r))
    draft.skin = new_skin(draft.dice, draft.ground)


def _plain_object(draft: Draft) -> None:
    dice = draft.dice
    assert draft.ground.colour is not None
    draft.skin = Texture("plain", colour=colour_apart(dice, draft.ground.colour, (90.0, 400.0)))
    draft.surface = (Effect("shade", dice.uniform(0.05, 0.2)),)


def _low_contrast(draft: Draft) -> None:
    draft.skin = new_skin(draft.dice, draft.ground, (40.0, 70.0))
    draft.effects.append(Effect("haze", draft.dice.uniform(0.3, 0.55)))
    draft.noise = draft.dice.uniform(0.8, 1.8)


def _small(draft: Draft) -> None:
    dice = draft.dice
    draft.shape = dice.pick(CONVEX)
    side = dice.uniform(9, 20)
    draft.size = (side, max(round(side * dice.uniform(0.7, 1.0), 2), 8.0))
    draft.skin = new_skin(dice, draft.ground, (90.0, 400.0))
    draft.speed = dice.scaled(0.5, 3.0)
    draft.noise = dice.uniform(0.8, 2.0)


def _large(draft: Draft) -> None:
    dice = draft.dice
    side = dice.uniform(100, 140) * draft.unit
    draft.shape, draft.spin = dice.pick(CONVEX), 0.0
    draft.size = (round(side, 2), round(side * dice.uniform(0.7, 1.0), 2))


def _fast(draft: Draft) -> None:
    dice = draft.dice
    draft.way, draft.speed = dice.pick(("orbit", "bouncing")), dice.uniform(6, 14)
    draft.size = (max(draft.size[0], 30.0), max(draft.size[1], 30.0))
    if draft.shape in ROUND:
        draft.size = (max(draft.size),) * 2


def _growing(draft: Draft) -> None:
    dice = draft.dice
    factor = dice.uniform(1.4, 2.2)
    small = round(dice.uniform(28, 48) * draft.unit, 2)
    share = small / max(draft.size)
    draft.size = (round(draft.size[0] * share, 2), round(draft.size[1] * share, 2))
    draft.growth = (1.0, factor) if dice.chance(0.6) else (factor, 1.0)


def _jitter(draft: Draft) -> None:
    draft.jitter = draft.dice.uniform(0.4, 2.2)


def _pan(draft: Draft) -> None:
    dice = draft.dice
    speed = dice.uniform(0.5, 4.0) * draft.unit * (draft.frames - 1)
    draft.pan = (round(speed * dice.sign(), 2), round(speed * dice.uniform(-0.3, 0.3), 2))
    draft.jitter = dice.uniform(0.0, 0.5)
    draft.speed = min(draft.speed, 3.0 * draft.unit)


def _zoom(draft: Draft) -> None:
    draft.zoom = (
        (1.0, draft.dice.uniform(1.2, 1.7)) if draft.dice.chance(0.6) else (draft.dice.uniform(1.2, 1.6), 1.0)
    )


def _roll(draft: Draft) -> None:
    draft.roll = (0.0, draft.dice.uniform(5, 20) * draft.dice.sign())


def _noise(draft: Draft) -> None:
    draft.noise = draft.dice.uniform(6, 18)


def _blur(draft: Draft) -> None:
    draft.shutter = draft.dice.uniform(0.4, 0.95)
    draft.speed = max(draft.speed, draft.dice.uniform(3, 8) * draft.unit)
    draft.way = draft.dice.pick(("orbit", "bouncing", "straight"))


def _shutter(draft: Draft) -> None:
    draft.shutter = draft.dice.uniform(0.3, 0.8)


def _jpeg(draft: Draft) -> None:
    draft.effects.append(Effect("jpeg", float(draft.dice.whole(20, 71))))


def _ramp(dice: Dice) -> Span:
    """A jump, a quick change, or a drift over all of the sequence."""
    at = dice.uniform(0.15, 0.7)
    return ((at, at), (at, round(at + 0.2, 2)), (0.0, 1.0))[dice.whole(0, 3)]


def _exposure(draft: Draft) -> None:
    gain = draft.dice.uniform(0.5, 0.85) if draft.dice.chance(0.6) else draft.dice.uniform(1.15, 1.5)
    draft.effects.append(Effect("exposure", gain, ramp=_ramp(draft.dice)))


def _white_balance(draft: Draft) -> None:
    dice = draft.dice
    if dice.chance(0.5):
        draft.effects.append(Effect("red", dice.uniform(1.15, 1.35), ramp=_ramp(dice)))
        return
    by = dice.uniform(0.1, 0.25) * dice.sign()
    draft.effects += [Effect("red", round(1.0 + by, 2)), Effect("blue", round(1.0 - by, 2))]


def _shadow(draft: Draft) -> None:
    dice = draft.dice
    offset = (dice.uniform(4, 22) * dice.sign(), dice.uniform(4, 22))
    draft.shadow = Shadow(offset, dice.uniform(0.25, 0.6), dice.uniform(1.5, 4))


def _crossing(draft: Draft) -> None:
    """From side to side, so that something can stand in the way."""
    draft.way, draft.spin, draft.rests = "across", 0.0, ()


def _pole(draft: Draft) -> None:
    _crossing(draft)
    draft.pole = round(max(min(draft.size) * draft.dice.uniform(0.2, 0.6), 5.0), 2)


def _full_occlusion(draft: Draft) -> None:
    """Behind a wall; it comes out where its way leads it, or elsewhere."""
    dice = draft.dice
    _crossing(draft)
    draft.shape, draft.angle, draft.frames = dice.pick(CONVEX), 0.0, dice.whole(80, 101)
    side = dice.uniform(28, 46) * draft.unit
    draft.size = (round(side, 2), round(side * dice.uniform(0.7, 1.0), 2))
    draft.pole = round(draft.size[0] + dice.uniform(4, 40) * draft.unit, 2)
    if dice.chance(0.3):
        draft.way = "displaced"


def _second_mover(draft: Draft) -> None:
    draft.passers, draft.twin = (1 if draft.dice.chance(0.7) else 2), draft.dice.chance(0.3)


def _absence(dice: Dice, frames: int, low: int, high: int) -> tuple[int, int]:
    """Span of frames; as often after one, two or three good ones as after ten or forty."""
    first = round(dice.scaled(2, frames - high - 12))
    return first, first + dice.whole(low, high + 1)


def _blank(draft: Draft) -> None:
    first, stop = _absence(draft.dice, draft.frames, 3, 12)
    draft.blanks = (Blank(draft.dice.pick(("black", "white", "gray", "static")), first, stop),)


def _empty(draft: Draft) -> None:
    """The object is gone, the scene stays; it is back where its way has led it, or where it was."""
    span = _absence(draft.dice, draft.frames, 6, 25)
    draft.hidden = (span,)
    if draft.dice.chance(0.5):
        draft.rests = (span,)


def _leaves(draft: Draft) -> None:
    draft.way, draft.spin, draft.frames = "out", 0.0, draft.dice.whole(85, 101)
    side = draft.dice.uniform(28, 52) * draft.unit
    share = side / max(draft.size)
    draft.size = (round(draft.size[0] * share, 2), round(draft.size[1] * share, 2))


def _gray(draft: Draft) -> None:
    assert draft.ground.colour is not None
    draft.skin = replace(draft.skin, colour=colour_apart(draft.dice, draft.ground.colour, APART, luma=40.0))
    draft.morph = None
    draft.effects.append(Effect("gray"))


def _thermal(draft: Draft) -> None:
    """Warm, nearly plain thing over a cool, soft ground, in gray."""
    dice = draft.dice
    level = dice.uniform(50, 110)
    draft.ground = Texture(
        dice.pick(("clouds", "moon", "speckle", "gravel")), dice.uniform(0.2, 0.6), (level,) * 3, dice.seed()
    )
    warm = dice.uniform(level + 50, min(level + 120, 235))
    draft.skin = Texture(dice.pick(("clouds", "speckle", "plain")), dice.uniform(0.2, 0.6), (warm,) * 3, dice.seed())
    draft.surface = (Effect("shade", dice.uniform(0.05, 0.2)),)
    draft.effects.append(Effect("gray"))
    draft.noise = dice.uniform(2, 6)


def _walker(draft: Draft) -> None:
    dice = draft.dice
    _crossing(draft)
    height = round(dice.uniform(60, 120) * draft.unit, 2)
    draft.shape, draft.size, draft.angle = "walker", (height / 2.0, height), 0.0
    draft.skin = Texture("speckle", 0.9, draft.skin.colour, dice.seed())
    draft.speed = dice.uniform(1.2, 3.5) * draft.unit
    # A turn of the legs carries 0.78 of the height: feet that stay where they stand.
    draft.gait = round(draft.speed / (0.78 * height), 4)


def _car(draft: Draft) -> None:
    dice = draft.dice
    _crossing(draft)
    height = round(dice.uniform(24, 44) * draft.unit, 2)
    draft.shape, draft.size, draft.angle = "car", (round(2.4 * height, 2), height), 0.0
    draft.skin = Texture("speckle", 0.5, draft.skin.colour, dice.seed())
    draft.surface = (Effect("shade", 0.15), Effect("glint", dice.uniform(40, 110), dice.uniform(1, 3)))
    draft.speed = dice.uniform(1.2, 5) * draft.unit
    draft.gait = round(draft.speed / (2.0 * math.pi * 0.22 * height), 4)


Recipe = Callable[[Draft], None]

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
