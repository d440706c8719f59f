"""The suites: which sequences there are.

`smoke` is quick, `standard` is the public one, `vanish` has a target that goes out of sight, `compressed` is part of
`standard` as JPEG, `deep` has frames of 16 bits: literal tables. `develop`, `heldout`, `vanish_develop` and
`vanish_heldout` were drawn once, and are kept in `lists.json`. `drawn:N:SEED` is drawn anew, any number of sequences
of any seed, and so is `crowd:N:SEED`, in which three to eight things move.
"""

from __future__ import annotations

import json
import re
import time
from dataclasses import replace
from pathlib import Path as FilePath

from .crowd import crowd
from .draw import Change, draw, draw_mixed
from .plain import from_plain
from .spec import Actor, Camera, Deep, Deform, Effect, Motion, Path, Scene, SequenceSpec, Shadow, Texture
from .themes import THEMES

__all__ = ["SUITES", "canonical", "suite"]

_NOISE = Effect("noise", 2.0)

_GRASS = Texture("grass", 0.9, (62.0, 124.0, 98.0), seed=2)
_BRICK = Texture("brick", 1.0, (72.0, 96.0, 140.0), seed=3)
_GRAVEL = Texture("gravel", 0.9, (112.0, 122.0, 130.0), seed=1)
_ASPHALT = Texture("speckle", 0.8, (96.0, 94.0, 92.0), seed=14)
_STONE = Texture("moon", 1.0, (118.0, 132.0, 140.0), seed=5)
_COFFEE, _CAT = Texture("coffee", seed=4), Texture("chelsea", seed=6)
_CAMERA, _COINS, _PAGE = Texture("camera", seed=4), Texture("coins", seed=9), Texture("page", seed=8)

_SMOKE = (
    SequenceSpec(
        "smoke_move",
        Actor("ellipse", (36, 28), Texture("patches", seed=3), Motion(Path("line", (38, 50), (118, 72)))),
        Scene(_GRAVEL),
        size=(160, 120),
        frames=28,
        seed=101,
        attributes=("translation",),
    ),
    SequenceSpec(
        "smoke_rotate",
        Actor("polygon", (40, 36), Texture("coffee", seed=2), Motion(Path("hold", (80, 60)), spin=7.0), seed=4),
        Scene(_GRASS),
        size=(160, 120),
        frames=28,
        seed=102,
        attributes=("rotation",),
    ),
    SequenceSpec(
        "smoke_deform",
        Actor(
            "blob",
            (40, 40),
            Texture("clouds", seed=5),
            Motion(Path("line", (112, 46), (52, 70))),
            deform=(Deform("squash", 0.22, 1.5),),
            shadow=Shadow((5, 6)),
            seed=2,
        ),
        Scene(_BRICK),
        size=(160, 120),
        frames=28,
        seed=103,
        attributes=("deformation", "shadow"),
    ),
    SequenceSpec(
        "smoke_occlude",
        Actor("box", (34, 30), Texture("chelsea", seed=6, shrink=3), Motion(Path("line", (30, 62), (128, 58)))),
        Scene(_CAMERA, front=(Actor("bar", (14, 140), _ASPHALT, Motion(Path("hold", (82, 60)))),)),
        Camera(jitter=0.4),
        (_NOISE, Effect("gray")),
        size=(160, 120),
        frames=28,
        seed=104,
        attributes=("occlusion", "jitter", "gray"),
    ),
)

_STANDARD = (
    SequenceSpec(
        "move",
        Actor("ellipse", (54, 42), Texture("patches", seed=3), Motion(Path("line", (56, 78), (258, 164)))),
        Scene(_GRAVEL),
        seed=1,
        attributes=("translation",),
    ),
    SequenceSpec(
        "rotate_in_place",
        Actor(
            "polygon",
            (64, 58),
            Texture("coffee", seed=2, shrink=2),
            Motion(Path("hold", (164, 122)), spin=4.0),
            seed=4,
        ),
        Scene(_GRASS),
        seed=2,
        attributes=("rotation",),
    ),
    SequenceSpec(
        "rotate_and_move",
        Actor(
            "gear",
            (62, 62),
            Texture("speckle", 1.4, (150.0, 160.0, 168.0), seed=6),
            Motion(Path("weave", (62, 120), (256, 124), amplitude=36, cycles=1.5), spin=-5.0),
            surface=(Effect("shade", 0.25),),
            shadow=Shadow((4, 5), 0.4, 2.0),
            seed=1,
        ),
        Scene(_BRICK),
        seed=3,
        attributes=("rotation", "translation", "shadow"),
    ),
    SequenceSpec(
        "turn_out_of_plane",
        Actor(
            "box",
            (62, 66),
            Texture("patches", seed=11),
            Motion(Path("line", (110, 122), (212, 118))),
            deform=(Deform("turn", 0.6, 1.2),),
        ),
        Scene(_COFFEE),
        seed=4,
        attributes=("out_of_plane", "translation"),
    ),
    SequenceSpec(
        "glint",
        Actor(
            "ellipse",
            (68, 50),
            Texture("clouds", 0.9, (120.0, 84.0, 60.0), seed=8),
            Motion(Path("ease", (76, 152), (246, 92)), angle=-12.0),
            surface=(Effect("shade", 0.2), Effect("glint", 190.0, 3.0)),
            shadow=Shadow((6, 7)),
        ),
        Scene(_STONE),
        seed=5,
        attributes=("glint", "translation", "shadow"),
    ),
    SequenceSpec(
        "morphing_surface",
        Actor(
            "blob",
            (62, 54),
            Texture("chelsea", seed=3, shrink=2),
            Motion(Path("swing", (90, 90), (230, 150), cycles=1.0)),
            morph=Texture("dots", seed=5),
            seed=5,
        ),
        Scene(_BRICK),
        seed=6,
        attributes=("morph", "translation"),
    ),
    SequenceSpec(
        "flicker",
        Actor(
            "polygon",
            (56, 52),
            Texture("stripes", seed=2),
            Motion(Path("line", (66, 160), (254, 82)), spin=1.0),
            seed=7,
        ),
        Scene(_COINS),
        effects=(Effect("flicker", 0.22, 9.0), _NOISE),
        seed=7,
        attributes=("flicker", "translation"),
    ),
    SequenceSpec(
        "deform",
        Actor(
            "blob",
            (58, 58),
            Texture("dots", 0.9, seed=9),
            Motion(Path("weave", (70, 110), (250, 130), amplitude=16, cycles=2.0)),
            deform=(Deform("squash", 0.25, 4.0), Deform("wave", 0.12, 3.0)),
            seed=9,
        ),
        Scene(_GRASS),
        seed=8,
        attributes=("deformation", "translation"),
    ),
    SequenceSpec(
        "plain_object",
        Actor(
            "ellipse",
            (52, 44),
            Texture("plain", colour=(52.0, 70.0, 196.0)),
            Motion(Path("weave", (62, 90), (256, 150), amplitude=24, cycles=1.0)),
            surface=(Effect("shade", 0.12),),
        ),
        Scene(_GRAVEL),
        seed=9,
        attributes=("plain_object", "translation"),
    ),
    SequenceSpec(
        "plain_background",
        Actor(
            "polygon",
            (58, 54),
            Texture("astronaut", seed=3, shrink=3),
            Motion(Path("line", (250, 76), (72, 160))),
            seed=3,
        ),
        Scene(Texture("plain", colour=(168.0, 160.0, 150.0))),
        seed=10,
        attributes=("plain_background", "translation"),
    ),
    SequenceSpec(
        "low_contrast",
        Actor(
            "box",
            (56, 46),
            Texture("speckle", 0.9, (118.0, 126.0, 132.0), seed=4),
            Motion(Path("line", (64, 92), (252, 150))),
        ),
        Scene(_GRAVEL),
        effects=(Effect("haze", 0.62), _NOISE),
        seed=11,
        attributes=("low_contrast", "translation"),
    ),
    SequenceSpec(
        "noise",
        Actor(
            "ellipse",
            (56, 52),
            Texture("patches", 0.8, seed=13),
            Motion(Path("line", (250, 150), (68, 88)), spin=1.5),
        ),
        Scene(_CAMERA),
        effects=(Effect("noise", 16.0),),
        seed=12,
        attributes=("noise", "translation"),
    ),
    SequenceSpec(
        "fast",
        Actor(
            "polygon",
            (48, 44),
            Texture("stripes", seed=8),
            Motion(Path("orbit", (160, 120), (255, 188), cycles=1.75)),
            seed=2,
        ),
        Scene(_COFFEE),
        seed=13,
        attributes=("fast", "translation"),
    ),
    SequenceSpec(
        "small",
        Actor(
            "ellipse",
            (16, 16),
            Texture("clouds", 1.0, (60.0, 90.0, 210.0), seed=4),
            Motion(Path("weave", (70, 150), (240, 90), 18, 1.5)),
        ),
        Scene(_GRASS),
        seed=14,
        attributes=("small", "translation"),
    ),
    SequenceSpec(
        "large",
        Actor(
            "blob",
            (240, 232),
            Texture("astronaut", seed=5),
            Motion(Path("swing", (250, 230), (400, 260), cycles=1.0), spin=0.6),
            seed=11,
        ),
        Scene(_BRICK),
        size=(640, 480),
        seed=15,
        attributes=("large", "rotation", "translation"),
    ),
    SequenceSpec(
        "growing",
        Actor(
            "box",
            (46, 40),
            Texture("page", 1.0, (120.0, 150.0, 170.0), seed=3, shrink=2),
            Motion(Path("line", (110, 90), (190, 138)), growth=(1.0, 2.0)),
        ),
        Scene(_STONE),
        seed=16,
        attributes=("scale", "translation"),
    ),
    SequenceSpec(
        "cast_shadow",
        Actor(
            "polygon",
            (50, 46),
            Texture("patches", 0.8, seed=21),
            Motion(Path("line", (58, 84), (240, 148)), spin=1.0),
            shadow=Shadow((20, 18), 0.5, 3.0),
            seed=8,
        ),
        Scene(_GRASS),
        seed=17,
        attributes=("shadow", "translation"),
    ),
    SequenceSpec(
        "stop_and_go",
        Actor(
            "box",
            (54, 40),
            Texture("coffee", seed=7, shrink=3),
            Motion(Path("stop_and_go", (58, 110), (262, 136), cycles=3)),
        ),
        Scene(_GRAVEL),
        seed=18,
        attributes=("stop", "translation"),
    ),
    SequenceSpec(
        "part_occlusion",
        Actor("ellipse", (58, 48), Texture("patches", seed=30), Motion(Path("line", (54, 112), (266, 130)))),
        Scene(_COFFEE, front=(Actor("bar", (22, 260), _ASPHALT, Motion(Path("hold", (160, 120)))),)),
        seed=19,
        attributes=("occlusion", "translation"),
    ),
    SequenceSpec(
        "full_occlusion",
        Actor(
            "polygon",
            (46, 46),
            Texture("dots", seed=3),
            Motion(Path("line", (40, 132), (282, 108)), spin=1.0),
            seed=12,
        ),
        Scene(_GRASS, front=(Actor("bar", (72, 260), _BRICK, Motion(Path("hold", (164, 120)))),)),
        seed=20,
        attributes=("occlusion", "full_occlusion", "translation"),
    ),
    SequenceSpec(
        "camera_jitter",
        Actor(
            "box",
            (54, 48),
            Texture("chelsea", seed=1, shrink=3),
            Motion(Path("line", (66, 146), (250, 92)), angle=10.0),
        ),
        Scene(_COINS),
        Camera(jitter=1.5),
        seed=21,
        attributes=("jitter", "translation"),
    ),
    SequenceSpec(
        "camera_pan",
        Actor("blob", (56, 50), Texture("stripes", seed=5), Motion(Path("line", (80, 120), (390, 140))), seed=13),
        Scene(_BRICK),
        Camera(pan=Path("line", (0, 0), (160, 18))),
        seed=22,
        attributes=("pan", "translation"),
    ),
    SequenceSpec(
        "camera_zoom",
        Actor("ellipse", (46, 40), Texture("patches", seed=17), Motion(Path("line", (120, 96), (196, 140)))),
        Scene(_CAMERA),
        Camera(zoom=(1.0, 1.6)),
        seed=23,
        attributes=("zoom", "scale", "translation"),
    ),
    SequenceSpec(
        "distractor",
        Actor("ellipse", (50, 44), Texture("patches", seed=40), Motion(Path("line", (56, 88), (260, 148)))),
        Scene(
            _GRAVEL,
            front=(
                Actor(
                    "polygon",
                    (44, 48),
                    Texture("patches", seed=41),
                    Motion(Path("line", (276, 98), (40, 146))),
                    seed=3,
                ),
            ),
        ),
        seed=24,
        attributes=("distractor", "occlusion", "translation"),
    ),
    SequenceSpec(
        "motion_blur",
        Actor("box", (54, 46), Texture("dots", seed=12), Motion(Path("orbit", (160, 120), (240, 172), cycles=1.2))),
        Scene(_STONE),
        Camera(shutter=0.8),
        seed=25,
        attributes=("blur", "fast", "translation"),
    ),
    SequenceSpec(
        "jpeg50",
        Actor(
            "polygon",
            (54, 50),
            Texture("coffee", seed=9, shrink=3),
            Motion(Path("line", (60, 84), (254, 152)), spin=2.0),
            seed=21,
        ),
        Scene(_GRASS),
        effects=(_NOISE, Effect("jpeg", 50.0)),
        seed=26,
        attributes=("jpeg", "rotation", "translation"),
    ),
    SequenceSpec(
        "jpeg30",
        Actor(
            "blob",
            (56, 52),
            Texture("patches", 0.8, seed=50),
            Motion(Path("weave", (256, 96), (66, 148), 18, 1.0)),
            seed=22,
        ),
        Scene(_COFFEE),
        effects=(_NOISE, Effect("jpeg", 30.0)),
        seed=27,
        attributes=("jpeg", "translation"),
    ),
    SequenceSpec(
        "gray",
        Actor(
            "gear", (56, 56), Texture("clouds", seed=22), Motion(Path("line", (70, 156), (246, 84)), spin=3.0), seed=4
        ),
        Scene(_PAGE),
        effects=(_NOISE, Effect("gray")),
        seed=28,
        attributes=("gray", "rotation", "translation"),
    ),
    SequenceSpec(
        "walker",
        Actor(
            "walker",
            (52, 104),
            Texture("speckle", 0.9, (150.0, 96.0, 70.0), seed=31),
            Motion(Path("line", (52, 140), (268, 140)), gait=0.03),
        ),
        Scene(_BRICK),
        seed=29,
        attributes=("articulated", "deformation", "translation"),
    ),
    SequenceSpec(
        "car",
        Actor(
            "car",
            (96, 40),
            Texture("speckle", 0.5, (58.0, 60.0, 186.0), seed=33),
            Motion(Path("line", (62, 150), (420, 150)), gait=0.0726),
            surface=(Effect("shade", 0.15), Effect("glint", 90.0, 2.0)),
            shadow=Shadow((-3, 7), 0.45, 2.0),
        ),
        Scene(_ASPHALT),
        Camera(pan=Path("line", (0, 0), (178, 0)), jitter=0.4),
        seed=30,
        attributes=("pan", "jitter", "glint", "shadow", "translation"),
    ),
)


def _wall(x: float, width: float) -> tuple[Actor, ...]:
    return (Actor("bar", (width, 260), _BRICK, Motion(Path("hold", (x, 120)))),)


_VANISH = (
    SequenceSpec(
        "behind_wall",
        Actor("ellipse", (42, 38), Texture("patches", seed=61), Motion(Path("line", (36, 108), (284, 134)))),
        Scene(_GRASS, front=_wall(160, 118)),
        frames=130,
        seed=201,
        attributes=("full_occlusion", "reappears_ahead"),
    ),
    SequenceSpec(
        "behind_wall_displaced",
        Actor(
            "polygon",
            (42, 40),
            Texture("dots", seed=62),
            Motion(Path("knots", knots=((0.0, 36, 76), (0.42, 150, 80), (0.62, 170, 168), (1.0, 282, 172)))),
            seed=6,
        ),
        Scene(_GRAVEL, front=_wall(160, 112)),
        frames=130,
        seed=202,
        attributes=("full_occlusion", "reappears_elsewhere"),
    ),
    SequenceSpec(
        "turns_back_behind_wall",
        Actor(
            "blob",
            (44, 40),
            Texture("stripes", seed=63),
            Motion(Path("knots", knots=((0.0, 40, 96), (0.4, 172, 100), (0.65, 172, 150), (1.0, 44, 156)))),
            seed=7,
        ),
        Scene(_COFFEE, front=_wall(176, 120)),
        frames=130,
        seed=203,
        attributes=("full_occlusion", "reappears_elsewhere"),
    ),
    SequenceSpec(
        "leaves_and_reenters",
        Actor(
            "box",
            (44, 38),
            Texture("coffee", seed=64, shrink=3),
            Motion(Path("knots", knots=((0.0, 160, 90), (0.4, 352, 78), (0.4, -32, 168), (1.0, 200, 150)))),
        ),
        Scene(_STONE),
        frames=130,
        seed=204,
        attributes=("out_of_view", "reappears_elsewhere"),
    ),
    SequenceSpec(
        "leaves_and_returns",
        Actor(
            "ellipse",
            (46, 40),
            Texture("patches", seed=65),
            Motion(Path("knots", knots=((0.0, 120, 130), (0.38, -60, 118), (0.55, -60, 118), (1.0, 160, 104)))),
        ),
        Scene(_BRICK),
        frames=130,
        seed=205,
        attributes=("out_of_view", "reappears_same_place"),
    ),
    SequenceSpec(
        "blink_on_the_spot",
        Actor(
            "gear",
            (50, 50),
            Texture("clouds", 1.1, (90.0, 150.0, 180.0), seed=66),
            Motion(Path("hold", (170, 116)), spin=4.0, hidden=((40, 62), (90, 104))),
        ),
        Scene(_GRASS),
        frames=130,
        seed=206,
        attributes=("blink", "rotation", "reappears_same_place"),
    ),
    SequenceSpec(
        "blink_while_moving",
        Actor(
            "polygon",
            (46, 44),
            Texture("dots", seed=67),
            Motion(Path("line", (46, 150), (276, 88)), spin=1.0, hidden=((46, 70),)),
            seed=9,
        ),
        Scene(_COINS),
        frames=130,
        seed=207,
        attributes=("blink", "reappears_ahead"),
    ),
    SequenceSpec(
        "behind_wall_with_distractor",
        Actor("ellipse", (42, 40), Texture("patches", seed=68), Motion(Path("line", (36, 130), (284, 116)))),
        Scene(
            _GRAVEL,
            behind=(
                Actor("ellipse", (42, 38), Texture("patches", seed=69), Motion(Path("line", (290, 60), (20, 196)))),
            ),
            front=_wall(160, 112),
        ),
        frames=130,
        seed=208,
        attributes=("full_occlusion", "distractor", "reappears_ahead"),
    ),
    SequenceSpec(
        "leaves_while_another_stays",
        Actor(
            "box",
            (44, 40),
            Texture("stripes", seed=70),
            Motion(Path("knots", knots=((0.0, 180, 84), (0.36, 348, 84), (0.62, 348, 150), (1.0, 150, 158)))),
        ),
        Scene(
            _ASPHALT,
            behind=(
                Actor(
                    "box",
                    (46, 40),
                    Texture("stripes", seed=71),
                    Motion(Path("swing", (70, 170), (150, 60), cycles=2.0)),
                ),
            ),
        ),
        frames=130,
        seed=209,
        attributes=("out_of_view", "distractor", "reappears_elsewhere"),
    ),
    SequenceSpec(
        "camera_looks_away",
        Actor(
            "walker",
            (48, 92),
            Texture("speckle", 0.9, (70.0, 110.0, 160.0), seed=72),
            Motion(Path("line", (60, 138), (250, 138)), gait=0.0204),
        ),
        Scene(_BRICK),
        Camera(pan=Path("swing", (0, 0), (400, 0)), jitter=0.5),
        frames=130,
        seed=210,
        attributes=("out_of_view", "pan", "articulated"),
    ),
)


def _as_jpeg(spec: SequenceSpec, quality: int) -> SequenceSpec:
    return replace(
        spec,
        name=f"{spec.name}_q{quality}",
        effects=(*spec.effects, Effect("jpeg", float(quality))),
        attributes=("jpeg", *spec.attributes),
    )


def _named(name: str) -> SequenceSpec:
    return next(spec for spec in _STANDARD if spec.name == name)


_DEEP = (
    # A thermal camera: gray, eight hundred levels somewhere in 16 bits; a scientific one, which uses all of them.
    replace(
        _STANDARD[0], name="deep_thermal", deep=Deep(7300, 8100), effects=(Effect("gray"), Effect("noise", 1.0)),
        attributes=(*_STANDARD[0].attributes, "16 bit"),
    ),
    replace(
        _STANDARD[1], name="deep_colour", deep=Deep(), effects=(Effect("noise", 1.0),),
        attributes=(*_STANDARD[1].attributes, "16 bit"),
    ),
)  # fmt: skip

_COMPRESSED = tuple(
    _as_jpeg(_named(name), quality)
    for name, quality in (
        ("move", 50),
        ("rotate_and_move", 30),
        ("turn_out_of_plane", 50),
        ("glint", 30),
        ("deform", 50),
        ("plain_object", 30),
        ("low_contrast", 50),
        ("small", 30),
        ("cast_shadow", 50),
        ("stop_and_go", 30),
        ("camera_pan", 50),
        ("walker", 30),
    )
)


def _kept_lists() -> dict[str, tuple[SequenceSpec, ...]]:
    text = FilePath(__file__).with_name("lists.json").read_text(encoding="utf-8")
    return {name: tuple(from_plain(SequenceSpec, each) for each in specs) for name, specs in json.loads(text).items()}


_LISTS = _kept_lists()

SUITES: dict[str, tuple[SequenceSpec, ...]] = {
    "smoke": _SMOKE,
    "standard": _STANDARD,
    "develop": _LISTS["develop"],
    "heldout": _LISTS["heldout"],
    "vanish": _VANISH,
    "vanish_develop": _LISTS["vanish_develop"],
    "vanish_heldout": _LISTS["vanish_heldout"],
    "compressed": _COMPRESSED,
    "deep": _DEEP,
}

_DRAWN = re.compile(r"(?P<kind>crowd|drawn(?:/(?P<theme>\w+))?):(?P<count>\d+)(?::(?P<seed>\d+|clock))?")


def canonical(name: str) -> str:
    """Name of a suite with its seed in it.

    Parameters
    ----------
    name : str
        A name in ``SUITES``, or ``drawn:N:SEED``, ``drawn/THEME:N:SEED`` or ``crowd:N:SEED`` for the first N
        sequences of a distribution; without a seed, or with ``clock`` for it, the seed is the second of the clock.

    Returns
    -------
    str
        The name, with the clock's seed in the place of ``clock``.

    Raises
    ------
    ValueError
        If there is no such suite or theme, or N is 0.
    """
    if name in SUITES:
        return name
    found = _DRAWN.fullmatch(name)
    if found is None:
        raise ValueError(
            f"unknown suite {name!r}; known: {', '.join(SUITES)}, drawn:N:SEED, drawn/THEME:N:SEED, "
            "crowd:N:SEED (N sequences; SEED a whole number, or clock)"
        )
    theme, count, seed = found["theme"], int(found["count"]), found["seed"]
    if theme is not None and theme not in THEMES:
        raise ValueError(f"unknown theme {theme!r}; known: {', '.join(THEMES)}")
    if count < 1:
        raise ValueError(f"expected at least 1 sequence, got {name!r}")
    seed = str(int(time.time())) if seed in (None, "clock") else str(int(seed))
    return f"{found['kind']}:{count}:{seed}"


def suite(name: str, change: Change | None = None) -> tuple[SequenceSpec, ...]:
    """Specs of a suite, named as :func:`canonical` takes it; `change` is done to each draft of ``drawn``."""
    name = canonical(name)
    if name in SUITES:
        return SUITES[name]
    kind, count, seed = name.split(":")
    _, _, theme = kind.partition("/")
    if kind == "crowd":
        return tuple(crowd(int(seed), index) for index in range(int(count)))
    if theme:
        return tuple(draw(theme, int(seed), index, change) for index in range(int(count)))
    return tuple(draw_mixed(int(seed), index, change) for index in range(int(count)))
