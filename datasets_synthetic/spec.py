"""Description of a sequence: frozen, hashable, printable data. What it looks like is decided by `render` alone."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from .deform import DEFORMS
from .effects import BLANKS, EFFECTS, SURFACE_EFFECTS
from .motion import PATHS
from .plain import to_plain
from .shapes import SHAPES
from .textures import TEXTURES

__all__ = [
    "RENDERER_VERSION", "Actor", "Blank", "Camera", "Deep", "Deform", "Effect", "Motion", "Path", "Scene",
    "SequenceSpec", "Shadow", "Texture",
]  # fmt: skip

RENDERER_VERSION = 6
"""Raised whenever the same spec gives other pixels or other truth, so that cached results die."""

Point = tuple[float, float]


def _known(kind: str, table: Mapping[str, object], what: str) -> None:
    if kind not in table:
        raise ValueError(f"unknown {what} {kind!r}; known: {', '.join(table)}")


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ValueError(message)


@dataclass(frozen=True)
class Texture:
    """Look of a surface.

    Parameters
    ----------
    kind : str
        Name in ``textures.TEXTURES``.
    contrast : float
        Factor on the deviations from the mean.
    colour : tuple of 3 floats, optional
        Mean blue, green, red in 0–255; by default the picture's own.
    seed : int
        Which piece of the photograph, which draw of the pattern.
    shrink : int
        Photographs only: how many of its pixels, across and down, make one.
    """

    kind: str
    contrast: float = 1.0
    colour: tuple[float, float, float] | None = None
    seed: int = 0
    shrink: int = 1

    def __post_init__(self) -> None:
        _known(self.kind, TEXTURES, "texture")
        _require(1 <= self.shrink <= 8, f"expected shrink in 1–8, got {self.shrink}")
        _require(self.contrast >= 0, f"expected a contrast of at least 0, got {self.contrast}")


@dataclass(frozen=True)
class Path:
    """Way of a point, in world px: those of the first frame of a still camera.

    Parameters
    ----------
    kind : str
        Name in ``motion.PATHS``.
    start, end : tuple of 2 floats
        Ends of the way (for `orbit` its centre and the corner of its quarter).
    amplitude : float
        px across the way (`weave`).
    cycles : float
        Repetitions over the sequence.
    knots : tuple of (fraction, x, y)
        For `knots`; fractions rise.
    """

    kind: str
    start: Point = (0.0, 0.0)
    end: Point = (0.0, 0.0)
    amplitude: float = 0.0
    cycles: float = 1.0
    knots: tuple[tuple[float, float, float], ...] = ()

    def __post_init__(self) -> None:
        _known(self.kind, PATHS, "path")
        _require(self.kind != "knots" or len(self.knots) > 1, "a path of kind 'knots' needs at least two knots")
        fractions = [knot[0] for knot in self.knots]
        _require(fractions == sorted(fractions), f"expected knots of rising fraction, got {fractions}")


@dataclass(frozen=True)
class Motion:
    """Pose of an actor over time.

    Parameters
    ----------
    path : Path
        Way of its centre.
    angle : float
        Angle at the start, degrees clockwise as seen.
    spin : float
        Degrees per frame.
    growth : tuple of 2 floats
        Size factor at the first and the last frame.
    gait : float
        Turns of wheels or steps of legs per frame.
    hidden : tuple of (first, stop)
        Frames in which it is not there at all.
    rests : tuple of (first, stop)
        Frames in which its clock stands: it neither moves, turns nor grows. They are missing at the end of the path.
    with_camera : bool
        The path is one in the frame of the camera that pans, not in the world.
    """

    path: Path
    angle: float = 0.0
    spin: float = 0.0
    growth: tuple[float, float] = (1.0, 1.0)
    gait: float = 0.0
    hidden: tuple[tuple[int, int], ...] = ()
    rests: tuple[tuple[int, int], ...] = ()
    with_camera: bool = False

    def __post_init__(self) -> None:
        _require(min(self.growth) > 0, f"expected positive growth, got {self.growth}")
        for first, stop in (*self.hidden, *self.rests):
            _require(first < stop, f"expected a span (first, stop) of frames, got {(first, stop)}")
        stops = [stop for _, stop in self.rests]
        overlap = any(first < stop for (first, _), stop in zip(self.rests[1:], stops, strict=False))
        _require(not overlap, f"expected rests one after the other, got {self.rests}")


@dataclass(frozen=True)
class Deform:
    """Change of shape: name in ``deform.DEFORMS``, strength, and how many cycles over the sequence."""

    kind: str
    strength: float
    cycles: float

    def __post_init__(self) -> None:
        _known(self.kind, DEFORMS, "deformation")
        limit = 0.9 if self.kind == "squash" else math.inf
        _require(0 < self.strength <= limit, f"expected a strength in (0, {limit}], got {self.strength}")


@dataclass(frozen=True)
class Effect:
    """Change of light.

    Parameters
    ----------
    kind : str
        Name in ``effects.EFFECTS`` or ``SURFACE_EFFECTS``.
    strength : float
    cycles : float
        Repetitions over the sequence.
    ramp : tuple of 2 floats
        Gains only: between which shares of the sequence they go from 1 to `strength`; equal shares are a jump.
    """

    kind: str
    strength: float = 1.0
    cycles: float = 1.0
    ramp: tuple[float, float] = (0.0, 1.0)

    def __post_init__(self) -> None:
        _known(self.kind, {**EFFECTS, **SURFACE_EFFECTS}, "effect")
        if self.kind == "jpeg":
            _require(1 <= self.strength <= 100, f"expected a JPEG quality in 1–100, got {self.strength}")
        _require(0 <= self.ramp[0] <= self.ramp[1] <= 1, f"expected a rising ramp within 0–1, got {self.ramp}")


@dataclass(frozen=True)
class Blank:
    """Frames first … stop − 1 that show nothing of the scene: all of them `kind`, a name in ``effects.BLANKS``."""

    kind: str
    first: int
    stop: int

    def __post_init__(self) -> None:
        _known(self.kind, BLANKS, "blank")
        _require(0 < self.first < self.stop, f"expected 0 < first < stop, got {self.first} and {self.stop}")


@dataclass(frozen=True)
class Deep:
    """Camera of 16 bits, as thermal and scientific ones are: grey level 0 becomes `low` and 255 becomes `high`.

    What lies between two of 256 grey levels is kept, noise included.
    """

    low: int = 0
    high: int = 65535

    def __post_init__(self) -> None:
        _require(0 <= self.low < self.high <= 65535, f"expected 0 <= low < high <= 65535, got {self}")


@dataclass(frozen=True)
class Shadow:
    """Cast shadow: offset from the thing, px, darkening in (0, 1), softness of the edge, px."""

    offset: Point
    strength: float = 0.45
    softness: float = 3.0

    def __post_init__(self) -> None:
        _require(0 < self.strength < 1, f"expected a shadow strength in (0, 1), got {self.strength}")


@dataclass(frozen=True)
class Actor:
    """A thing in the scene.

    Parameters
    ----------
    shape : str
        Name in ``shapes.SHAPES``.
    size : tuple of 2 floats
        Width and height at rest, px.
    texture : Texture
    motion : Motion
    deform : tuple of Deform
        Applied in this order, from the material outwards.
    surface : tuple of Effect
        Of ``effects.SURFACE_EFFECTS``.
    morph : Texture, optional
        Surface it has turned into at the last frame.
    shadow : Shadow, optional
    mirror : bool
        Facing left instead of right.
    seed : int
        Draw of the shape.
    """

    shape: str
    size: Point
    texture: Texture
    motion: Motion
    deform: tuple[Deform, ...] = ()
    surface: tuple[Effect, ...] = ()
    morph: Texture | None = None
    shadow: Shadow | None = None
    mirror: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        _known(self.shape, SHAPES, "shape")
        _require(min(self.size) >= 2, f"expected a size of at least 2 px, got {self.size}")
        for effect in self.surface:
            _known(effect.kind, SURFACE_EFFECTS, "surface effect")


@dataclass(frozen=True)
class Scene:
    """Background, and the actors other than the target: behind it and in front of it, each painted in order."""

    background: Texture
    behind: tuple[Actor, ...] = ()
    front: tuple[Actor, ...] = ()


@dataclass(frozen=True)
class Camera:
    """Camera over the world.

    Parameters
    ----------
    pan : Path
        World position of the frame's top-left corner at zoom 1.
    jitter : float
        Deviation of a hand's shake, px.
    zoom : tuple of 2 floats
        Scale about the frame's centre at the first and the last frame.
    roll : tuple of 2 floats
        Angle about the frame's centre at the first and the last frame, degrees that the picture turns clockwise.
    shutter : float
        Share of the frame time that the shutter is open, in [0, 1]: motion blur.
    """

    pan: Path = field(default_factory=lambda: Path("hold"))
    jitter: float = 0.0
    zoom: tuple[float, float] = (1.0, 1.0)
    roll: tuple[float, float] = (0.0, 0.0)
    shutter: float = 0.0

    def __post_init__(self) -> None:
        _require(min(self.zoom) > 0, f"expected positive zoom, got {self.zoom}")
        _require(0 <= self.shutter <= 1, f"expected a shutter in [0, 1], got {self.shutter}")
        _require(self.jitter >= 0, f"expected a jitter of at least 0 px, got {self.jitter}")


@dataclass(frozen=True)
class SequenceSpec:
    """All that a sequence is made from.

    Parameters
    ----------
    name : str
    target : Actor
        The thing whose truth is recorded.
    scene : Scene
    camera : Camera
    effects : tuple of Effect
        Of ``effects.EFFECTS``; always applied in ``effects.ORDER``.
    size : tuple of 2 ints
        Width and height of the frames, px.
    frames : int
    seed : int
        Of noise and jitter.
    attributes : tuple of str
        What the sequence is about, for per-attribute tables.
    blanks : tuple of Blank
    theme : str
        Recipe it was drawn by; empty for one that was made by hand.
    deep : Deep, optional
        Frames of 16 bits instead of 8.
    """

    name: str
    target: Actor
    scene: Scene
    camera: Camera = field(default_factory=Camera)
    effects: tuple[Effect, ...] = (Effect("noise", 2.0),)
    size: tuple[int, int] = (320, 240)
    frames: int = 90
    seed: int = 0
    attributes: tuple[str, ...] = ()
    blanks: tuple[Blank, ...] = ()
    theme: str = ""
    deep: Deep | None = None

    def __post_init__(self) -> None:
        _require(self.frames >= 2, f"expected at least 2 frames, got {self.frames}")
        _require(min(self.size) >= 16, f"expected frames of at least 16 × 16 px, got {self.size}")
        for effect in self.effects:
            _known(effect.kind, EFFECTS, "picture effect")
        compressed = any(effect.kind == "jpeg" for effect in self.effects)
        _require(not (self.deep and compressed), "expected a deep sequence without jpeg, which has 8 bits")

    def digest(self) -> str:
        """Hash of everything that decides the pixels, as 16 hex digits; stable across processes.

        Fields that have their defaults are not part of it: a new one leaves the digests of all specs as they are.
        """
        text = json.dumps(to_plain(self), sort_keys=True)
        return hashlib.sha256(f"{RENDERER_VERSION} {text}".encode()).hexdigest()[:16]

    def blank(self, t: int) -> Blank | None:
        """Say which blank frame t is, if any."""
        return next((blank for blank in self.blanks if blank.first <= t < blank.stop), None)

    def fraction(self, t: float) -> float:
        """Share of the sequence that has passed at frame t."""
        return t / (self.frames - 1)
