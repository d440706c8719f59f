"""Drawn sequences: one recipe per difficulty; a seed decides everything that is left open.

`develop` and `heldout` are two draws of the same recipes, so that a tracker is tuned on one and reported on the
other without anybody having picked either. A recipe takes an ordinary sequence (one thing that crosses the picture)
and makes it difficult in one way.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .spec import Actor, Camera, Deform, Effect, Motion, Path, Scene, SequenceSpec, Shadow, Texture

__all__ = ["THEMES", "VANISHING", "draw"]

Recipe = Callable[[SequenceSpec, np.random.Generator], SequenceSpec]

_WIDTH, _HEIGHT = 320, 240
_BACKGROUNDS: tuple[tuple[str, tuple[float, float, float] | None], ...] = (
    ("grass", (66.0, 120.0, 100.0)),
    ("gravel", (110.0, 120.0, 126.0)),
    ("brick", (80.0, 98.0, 138.0)),
    ("moon", (120.0, 128.0, 136.0)),
    ("coins", None),
    ("camera", None),
    ("coffee", None),
    ("chelsea", None),
    ("page", None),
    ("speckle", None),
)
_STREETS: tuple[tuple[str, tuple[float, float, float]], ...] = (
    ("brick", (80.0, 98.0, 138.0)),
    ("grass", (66.0, 120.0, 100.0)),
    ("speckle", (98.0, 96.0, 94.0)),
)
_SKINS = ("patches", "stripes", "dots", "clouds", "speckle", "checker", "astronaut", "chelsea", "coffee")
_SHAPES = ("ellipse", "box", "polygon", "blob", "gear")


def _seed(rng: np.random.Generator) -> int:
    return int(rng.integers(1, 1_000_000))


def _pick(rng: np.random.Generator, names: tuple[str, ...]) -> str:
    return names[int(rng.integers(len(names)))]


def _uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """Draw rounded to two decimals, so that a printed spec stays readable."""
    return round(float(rng.uniform(low, high)), 2)


def _skin(rng: np.random.Generator) -> Texture:
    return Texture(_pick(rng, _SKINS), _uniform(rng, 0.8, 1.1), seed=_seed(rng), shrink=int(rng.integers(2, 4)))


def _ground(rng: np.random.Generator) -> Texture:
    kind, colour = _BACKGROUNDS[int(rng.integers(len(_BACKGROUNDS)))]
    return Texture(kind, _uniform(rng, 0.75, 1.0), colour, seed=_seed(rng))


def _crossing(rng: np.random.Generator) -> Path:
    """Way from one side of the picture to the other, straight or winding."""
    left = (_uniform(rng, 48, 84), _uniform(rng, 70, 170))
    right = (_uniform(rng, 236, 272), _uniform(rng, 70, 170))
    start, end = (left, right) if rng.random() < 0.5 else (right, left)
    kind = _pick(rng, ("line", "weave", "ease"))
    return Path(kind, start, end, amplitude=_uniform(rng, 8, 26), cycles=_uniform(rng, 0.8, 1.6))


def _ordinary(name: str, rng: np.random.Generator) -> SequenceSpec:
    width = _uniform(rng, 42, 66)
    spin = _uniform(rng, -1.5, 1.5) if rng.random() < 0.5 else 0.0
    shape, slenderness = _pick(rng, _SHAPES), _uniform(rng, 0.72, 1.05)
    target = Actor(
        shape,
        (width, width if shape == "gear" else round(width * slenderness, 2)),
        _skin(rng),
        Motion(_crossing(rng), angle=_uniform(rng, -20, 20), spin=spin),
        seed=_seed(rng),
    )
    noise = Effect("noise", _uniform(rng, 1.5, 3.0))
    return SequenceSpec(
        name, target, Scene(_ground(rng)), effects=(noise,), seed=_seed(rng), attributes=("translation",)
    )


def _about(spec: SequenceSpec, *attributes: str) -> SequenceSpec:
    return replace(spec, attributes=(*attributes, *spec.attributes))


def _target(spec: SequenceSpec, **changes: object) -> SequenceSpec:
    return replace(spec, target=replace(spec.target, **changes))  # type: ignore[arg-type]


def _moving(spec: SequenceSpec, **changes: object) -> SequenceSpec:
    return _target(spec, motion=replace(spec.target.motion, **changes))  # type: ignore[arg-type]


def _move(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return spec


def _rotate_in_place(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    place = (_uniform(rng, 110, 210), _uniform(rng, 90, 150))
    spin = _uniform(rng, 2.5, 6.0) * (1 if rng.random() < 0.5 else -1)
    spec = _moving(spec, path=Path("hold", place), spin=spin)
    return replace(_target(spec, shape=_pick(rng, ("polygon", "box", "blob"))), attributes=("rotation",))


def _rotate_and_move(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(_moving(spec, spin=_uniform(rng, 2.5, 5.5)), "rotation")


def _turn(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    turn = Deform("turn", _uniform(rng, 0.45, 1.0), _uniform(rng, 0.6, 1.5))
    return _about(
        _target(_moving(spec, spin=0.0), deform=(turn,), shape=_pick(rng, ("box", "ellipse"))), "out_of_plane"
    )


def _glint(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    glint = Effect("glint", _uniform(rng, 120, 220), _uniform(rng, 2, 5))
    return _about(_target(spec, surface=(Effect("shade", 0.15), glint)), "glint")


def _morph(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(_target(spec, morph=_skin(rng)), "morph")


def _flicker(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    flicker = Effect("flicker", _uniform(rng, 0.12, 0.28), _uniform(rng, 4, 12))
    return _about(replace(spec, effects=(flicker, *spec.effects)), "flicker")


def _deform(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    first = Deform("squash", _uniform(rng, 0.12, 0.28), _uniform(rng, 2, 4))
    second = Deform(_pick(rng, ("wave", "bend")), _uniform(rng, 0.1, 0.3), _uniform(rng, 2, 4))
    return _about(_target(spec, deform=(first, second), shape=_pick(rng, ("blob", "ellipse"))), "deformation")


def _plain_object(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    # As different from any of the grounds as a painted thing is: one channel strong, one weak.
    colour = tuple(float(value) for value in rng.permutation([_uniform(rng, 25, 60), 90.0, _uniform(rng, 190, 225)]))
    spec = _target(
        spec, texture=Texture("plain", colour=(colour[0], colour[1], colour[2])), surface=(Effect("shade", 0.1),)
    )
    return _about(spec, "plain_object")


def _plain_background(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    grey = _uniform(rng, 120, 180)
    ground = Texture("plain", colour=(grey + _uniform(rng, -15, 15), grey, grey + _uniform(rng, -15, 15)))
    return _about(replace(spec, scene=Scene(ground)), "plain_background")


def _low_contrast(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(replace(spec, effects=(Effect("haze", _uniform(rng, 0.5, 0.72)), *spec.effects)), "low_contrast")


def _noise(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(replace(spec, effects=(Effect("noise", _uniform(rng, 10, 20)),)), "noise")


def _fast(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    corner = (160 + _uniform(rng, 75, 105), 120 + _uniform(rng, 55, 75))
    path = Path("orbit", (160.0, 120.0), corner, cycles=_uniform(rng, 1.6, 2.1) * (1 if rng.random() < 0.5 else -1))
    return _about(_moving(spec, path=path), "fast")


def _small(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    side = _uniform(rng, 14, 20)
    return _about(_target(spec, size=(side, side)), "small")


def _large(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    side = _uniform(rng, 190, 240)
    start, end = (
        (_uniform(rng, 190, 260), _uniform(rng, 200, 280)),
        (_uniform(rng, 380, 450), _uniform(rng, 200, 280)),
    )
    texture = Texture(_pick(rng, ("astronaut", "coffee", "chelsea", "clouds")), seed=_seed(rng))
    spec = _target(_moving(spec, path=Path("swing", start, end)), size=(side, side), texture=texture)
    return _about(replace(spec, size=(640, 480)), "large")


def _growing(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    path = Path(
        "line", (_uniform(rng, 90, 130), _uniform(rng, 90, 150)), (_uniform(rng, 180, 230), _uniform(rng, 110, 130))
    )
    growth = (1.0, _uniform(rng, 1.6, 2.1)) if rng.random() < 0.7 else (_uniform(rng, 1.6, 2.0), 1.0)
    side = _uniform(rng, 38, 48)
    spec = _target(spec, size=(side, side))
    return _about(_moving(spec, path=path, growth=growth), "scale")


def _shadow(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    offset = (_uniform(rng, 8, 24) * (1 if rng.random() < 0.5 else -1), _uniform(rng, 8, 22))
    return _about(_target(spec, shadow=Shadow(offset, _uniform(rng, 0.35, 0.6), _uniform(rng, 2, 4))), "shadow")


def _stop(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    path = replace(spec.target.motion.path, kind="stop_and_go", cycles=float(rng.integers(2, 5)))
    return _about(_moving(spec, path=path, spin=0.0), "stop")


def _straight(spec: SequenceSpec) -> SequenceSpec:
    return _moving(spec, path=replace(spec.target.motion.path, kind="line"))


def _wall(spec: SequenceSpec, rng: np.random.Generator, width: float) -> SequenceSpec:
    texture = Texture(_pick(rng, ("speckle", "brick", "clouds")), 0.8, seed=_seed(rng))
    wall = Actor("bar", (width, 260), texture, Motion(Path("hold", (_uniform(rng, 140, 180), 120.0))))
    return replace(_straight(spec), scene=replace(spec.scene, front=(*spec.scene.front, wall)))


def _part_occlusion(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(_wall(spec, rng, _uniform(rng, 14, 26)), "occlusion")


def _full_occlusion(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    side = _uniform(rng, 36, 46)
    spec = _target(_moving(spec, angle=0.0, spin=0.0), size=(side, side))
    return _about(_wall(spec, rng, _uniform(rng, 64, 84)), "full_occlusion", "occlusion")


def _jitter(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(replace(spec, camera=Camera(jitter=_uniform(rng, 0.8, 2.0))), "jitter")


def _pan(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    by = (_uniform(rng, 80, 200) * (1 if rng.random() < 0.5 else -1), _uniform(rng, -40, 40))
    path = spec.target.motion.path
    end = (round(path.end[0] + by[0], 2), round(path.end[1] + by[1], 2))
    # The thing's path takes the camera's along, or the pan would leave it behind.
    spec = _moving(spec, path=replace(path, kind="line", end=end))
    return _about(replace(spec, camera=Camera(pan=Path("line", (0.0, 0.0), by), jitter=0.3)), "pan")


def _zoom(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    path = Path(
        "line", (_uniform(rng, 110, 130), _uniform(rng, 95, 145)), (_uniform(rng, 180, 210), _uniform(rng, 100, 140))
    )
    zoom = (1.0, _uniform(rng, 1.3, 1.7)) if rng.random() < 0.7 else (_uniform(rng, 1.3, 1.5), 1.0)
    return _about(replace(_moving(spec, path=path), camera=Camera(zoom=zoom)), "zoom", "scale")


def _distractor(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    path = spec.target.motion.path
    back = Path("line", (path.end[0], path.start[1] + _uniform(rng, -30, 30)), (path.start[0], path.end[1]))
    other = Actor(_pick(rng, _SHAPES), spec.target.size, _skin(rng), Motion(back), seed=_seed(rng))
    scene = replace(spec.scene, front=(other,)) if rng.random() < 0.5 else replace(spec.scene, behind=(other,))
    return _about(replace(_straight(spec), scene=scene), "distractor")


def _blur(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    path = Path(
        "orbit",
        (160.0, 120.0),
        (160 + _uniform(rng, 65, 95), 120 + _uniform(rng, 40, 65)),
        cycles=_uniform(rng, 1.0, 1.5),
    )
    return _about(replace(_moving(spec, path=path), camera=Camera(shutter=_uniform(rng, 0.5, 0.9))), "blur", "fast")


def _jpeg50(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(replace(spec, effects=(*spec.effects, Effect("jpeg", 50.0))), "jpeg")


def _jpeg30(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(replace(spec, effects=(*spec.effects, Effect("jpeg", 30.0))), "jpeg")


def _gray(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    return _about(replace(spec, effects=(*spec.effects, Effect("gray"))), "gray")


def _walker(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    height = _uniform(rng, 80, 116)
    colour = (_uniform(rng, 50, 190), _uniform(rng, 50, 190), _uniform(rng, 50, 190))
    rightwards = spec.target.motion.path.start[0] < spec.target.motion.path.end[0]
    y = _uniform(rng, 120, 160)
    xs = (50.0, 270.0) if rightwards else (270.0, 50.0)
    # A turn of the legs carries 0.78 of the height: feet that stay where they stand.
    gait = round(220.0 / 89.0 / (0.78 * height), 4)
    target = Actor(
        "walker",
        (height / 2.0, height),
        Texture("speckle", 0.9, colour, seed=_seed(rng)),
        Motion(Path("line", (xs[0], y), (xs[1], y)), gait=gait),
        mirror=not rightwards,
        seed=_seed(rng),
    )
    return _about(replace(spec, target=target), "articulated", "deformation")


def _everything(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    """Several mild difficulties at once, as on a street: hand-held, shadow, light, encoder."""
    spec = _jitter(_shadow(_flicker(spec, rng), rng), rng)
    spec = replace(spec, camera=replace(spec.camera, jitter=0.6, shutter=0.5))
    return _about(replace(spec, effects=(*spec.effects, Effect("jpeg", float(rng.integers(40, 70))))), "jpeg", "blur")


def _street(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    """Hand-held, slightly hazy, compressed; before a wall, a lawn or tarmac."""
    kind, colour = _STREETS[int(rng.integers(len(_STREETS)))]
    scene = replace(spec.scene, background=Texture(kind, _uniform(rng, 0.7, 1.0), colour, seed=_seed(rng)))
    effects = (Effect("haze", _uniform(rng, 0.1, 0.35)), *spec.effects, Effect("jpeg", float(rng.integers(30, 60))))
    camera = Camera(jitter=_uniform(rng, 0.3, 0.8), shutter=0.4)
    return _about(replace(spec, scene=scene, camera=camera, effects=effects), "jpeg", "jitter", "blur", "shadow")


def _street_walker(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    """Person on a street, whom another passes the other way."""
    spec = _walker(spec, rng)
    person = replace(spec.target, shadow=Shadow((6.0, 5.0), 0.4, 3.0))
    path = person.motion.path
    back = Path("line", (path.end[0], path.end[1] - 14.0), (path.start[0], path.start[1] - 14.0))
    motion = replace(person.motion, path=back)
    texture = replace(person.texture, colour=(_uniform(rng, 50, 190), _uniform(rng, 50, 190), _uniform(rng, 50, 190)))
    other = replace(person, motion=motion, texture=texture, mirror=not person.mirror, seed=_seed(rng))
    spec = replace(spec, target=person, scene=replace(spec.scene, behind=(other,)))
    return _about(_street(spec, rng), "distractor")


def _street_car(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    """Car that drives past a lamp-post."""
    height = _uniform(rng, 28, 44)
    path = spec.target.motion.path
    y = _uniform(rng, 110, 170)
    rightwards = path.start[0] < path.end[0]
    xs = (64.0, 256.0) if rightwards else (256.0, 64.0)
    colour = (_uniform(rng, 40, 200), _uniform(rng, 40, 200), _uniform(rng, 40, 200))
    target = Actor(
        "car",
        (round(2.4 * height, 2), height),
        Texture("speckle", 0.5, colour, seed=_seed(rng)),
        # Wheels of 0.22 of the height in radius that roll and do not slip.
        Motion(Path("line", (xs[0], y), (xs[1], y)), gait=round(192.0 / 89.0 / (2.0 * math.pi * 0.22 * height), 4)),
        surface=(Effect("shade", 0.15), Effect("glint", _uniform(rng, 50, 110), 2.0)),
        shadow=Shadow((-2.0, 6.0), 0.45, 2.0),
        mirror=not rightwards,
    )
    post = Actor(
        "bar",
        (_uniform(rng, 7, 12), 260.0),
        Texture("speckle", 0.6, (70.0, 72.0, 74.0), seed=_seed(rng)),
        Motion(Path("hold", (_uniform(rng, 130, 190), 120.0))),
    )
    spec = replace(spec, target=target, scene=replace(spec.scene, front=(post,)))
    return _about(_street(spec, rng), "glint", "occlusion")


def _hiding(spec: SequenceSpec, rng: np.random.Generator, *attributes: str) -> SequenceSpec:
    """Small thing in a longer sequence, so that there is time to be away and to come back."""
    side = _uniform(rng, 36, 46)
    spec = _target(_moving(spec, angle=0.0, spin=0.0), size=(side, side))
    return replace(spec, frames=130, attributes=attributes)


def _through(spec: SequenceSpec, *knots: tuple[float, float, float]) -> SequenceSpec:
    return _moving(spec, path=Path("knots", knots=knots))


def _behind_wall(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    spec = _wall(_hiding(spec, rng, "full_occlusion", "reappears_ahead"), rng, _uniform(rng, 96, 116))
    rightwards = spec.target.motion.path.start[0] < spec.target.motion.path.end[0]
    start, end = (30.0, _uniform(rng, 70, 170)), (290.0, _uniform(rng, 70, 170))
    return _moving(spec, path=Path("line", *((start, end) if rightwards else (end, start))))


def _behind_wall_displaced(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    spec = _wall(_hiding(spec, rng, "full_occlusion", "reappears_elsewhere"), rng, 116.0)
    wall = spec.scene.front[-1].motion.path.start[0]
    high, low = _uniform(rng, 50, 90), _uniform(rng, 150, 190)
    first, last = (high, low) if rng.random() < 0.5 else (low, high)
    end = 36.0 if rng.random() < 0.4 else 284.0
    return _through(spec, (0.0, 36.0, first), (0.4, wall, first), (0.64, wall, last), (1.0, end, last))


def _away(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    side = 1.0 if rng.random() < 0.5 else -1.0
    out, back = 160 + side * 200, 160 + side * (200 if rng.random() < 0.5 else -200)
    first, last = _uniform(rng, 60, 180), _uniform(rng, 60, 180)
    spec = _hiding(spec, rng, "out_of_view", "reappears_same_place" if out == back else "reappears_elsewhere")
    inside = _uniform(rng, 140, 180)
    return _through(spec, (0.0, inside, first), (0.42, out, first), (0.58, back, last), (1.0, inside, last))


def _blink(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    spec = _hiding(spec, rng, "blink", "reappears_same_place", "rotation")
    first, second = int(rng.integers(30, 44)), int(rng.integers(78, 90))
    hidden = ((first, first + int(rng.integers(10, 26))), (second, second + int(rng.integers(8, 20))))
    place = (_uniform(rng, 110, 210), _uniform(rng, 90, 150))
    return _moving(spec, path=Path("hold", place), spin=_uniform(rng, 2.5, 5.0), hidden=hidden)


def _blink_moving(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
    spec = _straight(_hiding(spec, rng, "blink", "reappears_ahead"))
    first = int(rng.integers(36, 56))
    return _moving(spec, hidden=((first, first + int(rng.integers(12, 28))),))


def _with_passer_by(recipe: Recipe) -> Recipe:
    """Add to a recipe another thing that stays in view."""

    def both(spec: SequenceSpec, rng: np.random.Generator) -> SequenceSpec:
        spec = recipe(spec, rng)
        left, right = (
            (_uniform(rng, 40, 70), _uniform(rng, 40, 70)),
            (_uniform(rng, 250, 280), _uniform(rng, 170, 200)),
        )
        way = spec.target.motion.path
        x = way.knots[0][1] if way.knots else way.start[0]
        # It begins on the other side, so that the first frame shows both well apart.
        path = Path("swing", *((right, left) if x < 160 else (left, right)), cycles=1.5)
        other = Actor(spec.target.shape, spec.target.size, _skin(rng), Motion(path), seed=_seed(rng))
        return _about(replace(spec, scene=replace(spec.scene, behind=(other,))), "distractor")

    return both


THEMES: dict[str, Recipe] = {
    "move": _move,
    "rotate_in_place": _rotate_in_place,
    "rotate_and_move": _rotate_and_move,
    "turn": _turn,
    "glint": _glint,
    "morph": _morph,
    "flicker": _flicker,
    "deform": _deform,
    "plain_object": _plain_object,
    "plain_background": _plain_background,
    "low_contrast": _low_contrast,
    "noise": _noise,
    "fast": _fast,
    "small": _small,
    "large": _large,
    "growing": _growing,
    "shadow": _shadow,
    "stop": _stop,
    "part_occlusion": _part_occlusion,
    "full_occlusion": _full_occlusion,
    "jitter": _jitter,
    "pan": _pan,
    "zoom": _zoom,
    "distractor": _distractor,
    "blur": _blur,
    "jpeg50": _jpeg50,
    "jpeg30": _jpeg30,
    "gray": _gray,
    "walker": _walker,
    "everything": _everything,
    "street_walker": _street_walker,
    "street_car": _street_car,
}

VANISHING: dict[str, Recipe] = {
    "behind_wall": _behind_wall,
    "behind_wall_displaced": _behind_wall_displaced,
    "away": _away,
    "blink": _blink,
    "blink_moving": _blink_moving,
    "behind_wall_passer_by": _with_passer_by(_behind_wall),
    "displaced_passer_by": _with_passer_by(_behind_wall_displaced),
    "away_passer_by": _with_passer_by(_away),
}
"""Recipes whose target goes out of sight and comes back."""


def draw(theme: str, seed: int) -> SequenceSpec:
    """Draw a sequence.

    Parameters
    ----------
    theme : str
        Name in ``THEMES`` or ``VANISHING``.
    seed : int
        Decides shape, texture, ground, path and strength.

    Returns
    -------
    SequenceSpec
        Named ``theme_seed``.

    Raises
    ------
    ValueError
        If the theme is unknown.
    """
    recipes = {**THEMES, **VANISHING}
    if theme not in recipes:
        raise ValueError(f"unknown theme {theme!r}; known: {', '.join(recipes)}")
    rng = np.random.default_rng([seed, 9])
    return recipes[theme](_ordinary(f"{theme}_{seed}", rng), rng)
