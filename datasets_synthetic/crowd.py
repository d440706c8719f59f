"""Scenes for trackers of several objects: (seed, index) -> spec, in which three to eight things move and cross."""

from __future__ import annotations

import math

from .draft import CONVEX, Dice, new_skin, texture_of_ground
from .spec import Actor, Camera, Effect, Motion, Path, Scene, SequenceSpec, Shadow, Texture

__all__ = ["crowd"]

_SIZE = (480, 360)
_FRAMES = 120
_FEWEST, _KINDS = 3, 6
_SPEED = (0.9, 2.6)  # px/frame
_SIDE = (24.0, 52.0)  # px
_CROSSING = (0.35, 0.65)  # share of the sequence at which a pair meets
_ANGLES = (50.0, 180.0)  # between the headings of a pair, degrees
_TWINS = 0.25  # chance that a pair looks alike
_APART = 6.0  # px between things in the first frame
_TRIES = 200


def crowd(seed: int, index: int) -> SequenceSpec:
    """Draw a sequence in which 3 + index mod 6 things move.

    Things come in pairs that meet in the same place at the same moment, the nearer one before the farther; the odd
    one stops and goes. Some leave the frame, some come in from outside. In a third of the draws a pole stands in
    front, in a quarter the camera is held by hand.

    Parameters
    ----------
    seed, index : int
        Which distribution, and which of its sequences. Nothing else decides about the draw.

    Returns
    -------
    SequenceSpec
        Named ``crowd_seed_index``; the target is the thing in front.
    """
    dice = Dice("crowd", seed, index)
    count = _FEWEST + index % _KINDS
    ground = texture_of_ground(dice)
    actors: list[Actor] = []
    while len(actors) < count:
        pair = min(2, count - len(actors))
        actors += _placed(dice, ground, actors, pair)
    pole, by_hand = dice.chance(1 / 3), dice.chance(0.25)
    attributes = [f"{count} objects", "crossing", *["pole"] * pole, *["jitter"] * by_hand]
    return SequenceSpec(
        f"crowd_{seed}_{index}",
        actors[-1],
        Scene(ground, tuple(actors[:-1]), (_pole(dice, ground),) if pole else ()),
        Camera(jitter=0.5 if by_hand else 0.0),
        (Effect("noise", 2.0),),
        _SIZE,
        _FRAMES,
        dice.seed(),
        tuple(attributes),
        theme="crowd",
    )


def _placed(dice: Dice, ground: Texture, others: list[Actor], count: int) -> list[Actor]:
    """Draw until no thing begins on another one."""
    for _ in range(_TRIES):
        drawn = _pair(dice, ground) if count == 2 else [_wanderer(dice, ground)]
        if all(_apart(one, other) for k, one in enumerate(drawn) for other in (*others, *drawn[:k])):
            return drawn
    raise AssertionError("eight things have room in the frame")


def _apart(one: Actor, other: Actor) -> bool:
    reach = (math.hypot(*one.size) + math.hypot(*other.size)) / 2.0 + _APART
    return math.dist(one.motion.path.start, other.motion.path.start) > reach


def _pair(dice: Dice, ground: Texture) -> list[Actor]:
    """Two things that are in one place at one moment."""
    width, height = _SIZE
    place = (dice.uniform(0.3 * width, 0.7 * width), dice.uniform(0.3 * height, 0.7 * height))
    share, heading = dice.uniform(*_CROSSING), dice.uniform(0.0, 360.0)
    headings = (heading, heading + dice.sign() * dice.uniform(*_ANGLES))
    first = _thing(dice, ground, _through(place, share, headings[0], dice.uniform(*_SPEED)))
    second = _thing(dice, ground, _through(place, share, headings[1], dice.uniform(*_SPEED)))
    if dice.chance(_TWINS):
        second = Actor(first.shape, first.size, first.texture, second.motion, shadow=first.shadow, seed=first.seed)
    return [first, second]


def _through(place: tuple[float, float], share: float, heading: float, speed: float) -> Path:
    """Straight way that is at a place after that share of the sequence."""
    dx, dy = (speed * _FRAMES * part for part in (math.cos(math.radians(heading)), math.sin(math.radians(heading))))
    start = (round(place[0] - share * dx, 2), round(place[1] - share * dy, 2))
    return Path("line", start, (round(start[0] + dx, 2), round(start[1] + dy, 2)))


def _wanderer(dice: Dice, ground: Texture) -> Actor:
    """A thing on its own, which stops twice."""
    width, height = _SIZE
    ends = [(dice.uniform(50, width - 50), dice.uniform(50, height - 50)) for _ in range(2)]
    return _thing(dice, ground, Path("stop_and_go", ends[0], ends[1], cycles=2.0))


def _thing(dice: Dice, ground: Texture, path: Path) -> Actor:
    side = dice.scaled(*_SIDE)
    size = (side, round(side * dice.uniform(0.6, 1.0), 2))
    spin = dice.uniform(-1.5, 1.5) if dice.chance(0.3) else 0.0
    motion = Motion(path, angle=dice.uniform(-30, 30), spin=spin)
    shadow = Shadow((4.0, 5.0), 0.35) if dice.chance(0.25) else None
    return Actor(dice.pick(CONVEX), size, new_skin(dice, ground), motion, shadow=shadow, seed=dice.seed())


def _pole(dice: Dice, ground: Texture) -> Actor:
    place = (dice.uniform(0.35, 0.65) * _SIZE[0], _SIZE[1] / 2.0)
    return Actor("bar", (dice.uniform(10, 24), 3.0 * _SIZE[1]), new_skin(dice, ground), Motion(Path("hold", place)))
