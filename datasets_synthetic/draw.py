"""Suites that are distributions: (theme, seed, index) -> spec, a pure function.

A theme fills in a draft (what moves, how, over which ground), then up to three nuisances of other kinds are added,
and last the way is laid so that the target stays in the frame. Every sequence has a generator of its own, seeded
from theme, seed and index alone: how many are drawn, and in which process, changes none of them.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .draft import CONVEX, Dice, Draft, Span, new_skin, ordinary
from .motion import PATHS
from .spec import Actor, Camera, Effect, Motion, Path, Scene, SequenceSpec
from .themes import NUISANCES, THEMES
from .ways import WAYS, random_point

__all__ = ["Change", "draw", "draw_mixed"]

Change = Callable[[Draft], None]
"""What is done to a draft when all of it is drawn, before its way is laid."""

_NUISANCES = (0.25, 0.35, 0.25, 0.15)
"""Chances of none, one, two, three."""


def _pole_before(draft: Draft, path: Path) -> Actor:
    """Upright in the middle of the way."""
    texture = new_skin(draft.dice, draft.ground, (35.0, 400.0))
    place = ((PATHS[path.kind](path, 0.0)[0] + PATHS[path.kind](path, 1.0)[0]) / 2.0, draft.frame[1] / 2.0)
    return Actor("bar", (draft.pole, 3.0 * draft.frame[1]), texture, Motion(Path("hold", place)))


def _passer(draft: Draft, start: Span) -> Actor:
    """Another thing that crosses the frame; where there is no place beside the target it enters from outside."""
    dice, (width, height) = draft.dice, draft.frame
    side = round(dice.scaled(0.7, 1.3) * max(draft.size), 2)
    shape = draft.shape if draft.twin else dice.pick(CONVEX)
    size = draft.size if draft.twin else (side, round(side * dice.uniform(0.6, 1.0), 2))
    texture = draft.skin if draft.twin else new_skin(dice, draft.ground)
    near = (math.hypot(*size) / 2.0 + math.hypot(*draft.half_extent())) / min(1.0, *draft.zoom) + 8.0
    frame = np.array([0.0, 0.0, width, height])
    places = [random_point(dice, frame) for _ in range(12)]
    outside = (width + near if dice.chance(0.5) else -near, dice.uniform(0.0, height))
    begin = next((place for place in places if math.dist(place, start) > near), outside)
    aim = (width - begin[0] + dice.uniform(-40, 40), height - begin[1] + dice.uniform(-40, 40))
    path = Path(dice.pick(("line", "swing")), begin, (round(aim[0], 2), round(aim[1], 2)))
    angle = draft.angle if draft.twin else dice.uniform(-30, 30)
    motion = Motion(path, angle=angle, spin=draft.spin, with_camera=draft.pan != (0.0, 0.0))
    return Actor(shape, size, texture, motion, seed=dice.seed())


def _finish(draft: Draft, name: str, theme: str) -> SequenceSpec:
    room = draft.room()
    while draft.pole and room[2] - room[0] < 2.0 * draft.half_extent()[0] + draft.pole + 20.0:
        draft.size, draft.pole = (round(draft.size[0] * 0.9, 2), round(draft.size[1] * 0.9, 2)), draft.pole * 0.9
        room = draft.room()
    draft.pole = round(draft.pole, 2)
    path = WAYS[draft.way](draft, room, draft.speed * (draft.frames - 1))
    start = PATHS[path.kind](path, 0.0)
    poles = (_pole_before(draft, path),) if draft.pole else ()
    passers = tuple(_passer(draft, start) for _ in range(draft.passers))
    in_front = draft.dice.chance(0.5)
    motion = Motion(
        path, draft.angle, draft.spin, draft.growth, draft.gait, draft.hidden, draft.rests, draft.pan != (0.0, 0.0)
    )
    target = Actor(
        draft.shape, draft.size, draft.skin, motion, draft.deform, draft.surface, draft.morph, draft.shadow,
        draft.mirror, draft.dice.seed(),
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
        draft.dice.seed(),
        tuple(draft.attributes),
        draft.blanks,
        theme,
    )


def draw(theme: str, seed: int, index: int, change: Change | None = None) -> SequenceSpec:
    """Draw a sequence.

    Parameters
    ----------
    theme : str
        Name in ``THEMES``.
    seed, index : int
        Which distribution suite, and which of its sequences. Nothing else decides about the draw.
    change : callable, optional
        What is to be otherwise than it was drawn.

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
    dice = Dice(theme, seed, index)
    draft = ordinary(dice)
    recipe, excluded = THEMES[theme]
    recipe(draft)
    draft.attributes.append(theme)
    taken = set(excluded)
    for _ in range(int(np.searchsorted(np.cumsum(_NUISANCES), dice.share(), side="right"))):
        free = [name for name, (_, kinds) in NUISANCES.items() if taken.isdisjoint(kinds) and name != theme]
        name = free[dice.whole(0, len(free))]
        add, kinds = NUISANCES[name]
        add(draft)
        draft.attributes.append(name)
        taken.update(kinds)
    if change is not None:
        change(draft)
    return _finish(draft, f"{theme}_{seed}_{index}", theme)


def draw_mixed(seed: int, index: int, change: Change | None = None) -> SequenceSpec:
    """Draw sequence `index` of all themes by turns, in an order that the seed decides; see :func:`draw`."""
    order = sorted(THEMES, key=lambda theme: Dice("order", seed, theme).share())
    return draw(order[index % len(order)], seed, index, change)
