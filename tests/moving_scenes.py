"""Scenes for the automatic start: what moves in them, and all that changes without moving, drawn from a seed."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets_synthetic.spec import Texture
from datasets_synthetic.textures import paint
from hs_tracker_cv.geometry import Box

Image = NDArray[np.uint8]
Plane = NDArray[np.float32]

GROUNDS = ("astronaut", "brick", "camera", "chelsea", "coffee", "coins", "grass", "gravel", "clouds", "patches")
SURFACES = ("astronaut", "chelsea", "coffee", "coins", "patches", "dots", "stripes", "speckle")
LIGHTS = ("still", "mains", "flicker", "ramp", "bands", "exposure", "white balance", "vignette")
FIXTURES = ("clock", "fast clock", "blinking light", "screen")


@dataclass(frozen=True)
class Mover:
    """A thing that moves.

    Parameters
    ----------
    shape : str
        "box", "ellipse", "bar" or "fan".
    size : tuple of 2 floats
        Width and height, px.
    start, velocity : tuple of 2 floats
        Centre in frame `first`, px, and px per frame.
    spin : float
        Radians per frame.
    first : int
        Frame from which on it moves; it stands before.
    texture : Texture
    """

    shape: str
    size: tuple[float, float]
    start: tuple[float, float]
    velocity: tuple[float, float] = (0.0, 0.0)
    spin: float = 0.0
    first: int = 0
    texture: Texture = field(default_factory=lambda: Texture("patches"))

    def outlines(self, t: int) -> list[NDArray[np.float64]]:
        """Polygons of the thing in a frame, px."""
        steps = max(t - self.first, 0)
        x, y = (s + v * steps for s, v in zip(self.start, self.velocity, strict=True))
        cosine, sine = np.cos(self.spin * steps), np.sin(self.spin * steps)
        turn = np.array([[cosine, -sine], [sine, cosine]])
        return [part @ turn.T + (x, y) for part in _outline(self.shape, *self.size)]

    def box(self, t: int, width: int, height: int) -> Box:
        """Extent of what is in the picture."""
        points = np.concatenate(self.outlines(t))
        (left, top), (right, bottom) = points.min(axis=0), points.max(axis=0)
        return Box.from_edges(left, top, right, bottom).clip(width, height)


@dataclass(frozen=True)
class Scene:
    """A still or panning camera's view; `light` is one of LIGHTS, `fixtures` are of FIXTURES."""

    ground: Texture = field(default_factory=lambda: Texture("coffee"))
    movers: tuple[Mover, ...] = ()
    light: str = "still"
    fixtures: tuple[str, ...] = ()
    camera: tuple[float, float] = (0.0, 0.0)
    size: tuple[int, int] = (320, 240)
    frames: int = 60
    noise: float = 2.0
    jpeg: int | None = None
    seed: int = 0

    def truth(self, t: int) -> list[Box]:
        """Box of every mover in a frame; of no area outside the picture."""
        return [mover.box(t, *self.size) for mover in self.movers]


def _outline(shape: str, w: float, h: float) -> list[NDArray[np.float64]]:
    corners = np.array([(-w, -h), (w, -h), (w, h), (-w, h)]) / 2
    if shape in ("box", "bar"):
        return [corners]
    if shape == "ellipse":
        angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
        return [np.column_stack([w / 2 * np.cos(angles), h / 2 * np.sin(angles)])]
    blade = np.array([(0, -h / 10), (w / 2, -h / 6), (w / 2, h / 6), (0, h / 10)])
    turns = (np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]]) for a in 2 * np.pi / 3 * np.arange(3))
    return [blade @ turn.T for turn in turns]


def render(scene: Scene) -> Iterator[Image]:
    """Frames of a scene, BGR."""
    rng = np.random.default_rng([scene.seed, 77])
    width, height = scene.size
    pan = np.abs(np.array(scene.camera)) * scene.frames
    ground = paint(scene.ground, height + int(pan[1]) + 4, width + int(pan[0]) + 4)
    skins = [paint(mover.texture, *(int(1.5 * max(mover.size)) + 8,) * 2) for mover in scene.movers]
    fixtures = [_Fixture(kind, scene.size, rng) for kind in scene.fixtures]
    lamp = _Lamp(scene.light, scene.size, rng)
    for t in range(scene.frames):
        image = _view(ground, scene, t)
        for fixture in fixtures:
            fixture.draw(image, t, rng)
        for mover, skin in zip(scene.movers, skins, strict=True):
            _draw(image, mover, skin, t)
        image = lamp.light(image, t)
        image += rng.normal(0.0, scene.noise, image.shape)
        frame = np.clip(np.rint(image), 0, 255).astype(np.uint8)
        if scene.jpeg is not None:
            frame = cv2.imdecode(cv2.imencode(".jpg", frame, [cv2.IMWRITE_JPEG_QUALITY, scene.jpeg])[1], 1)
        yield np.asarray(frame, np.uint8)


def _view(ground: Plane, scene: Scene, t: int) -> Plane:
    width, height = scene.size
    start = [0.0 if c >= 0 else -c * scene.frames for c in scene.camera]
    x, y = (s + c * t for s, c in zip(start, scene.camera, strict=True))
    shift = np.array([[1.0, 0.0, -x], [0.0, 1.0, -y]])
    return np.asarray(cv2.warpAffine(ground, shift, (width, height), flags=cv2.INTER_LINEAR), np.float32)


def _draw(image: Plane, mover: Mover, skin: Plane, t: int) -> None:
    alpha = np.zeros(image.shape[:2], np.uint8)
    for outline in mover.outlines(t):
        points = np.rint((np.clip(outline, -2000, 4000) - 0.5) * 16).astype(np.int32)
        cv2.fillPoly(alpha, [points], 255, cv2.LINE_AA, 4)
    steps = max(t - mover.first, 0)
    x, y = (s + v * steps for s, v in zip(mover.start, mover.velocity, strict=True))
    half = skin.shape[0] / 2
    cosine, sine = np.cos(mover.spin * steps), np.sin(mover.spin * steps)
    pose = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0]])
    pose[:, 2] = np.array([x, y]) - pose[:, :2] @ (half, half) - 0.5 + pose[:, :2] @ (0.5, 0.5)
    painted = cv2.warpAffine(skin, pose, image.shape[1::-1], flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    share = (alpha.astype(np.float32) / 255)[..., None]
    image += share * (painted - image)


class _Lamp:
    """What changes all of the frame alike."""

    def __init__(self, kind: str, size: tuple[int, int], rng: np.random.Generator) -> None:
        self.kind = kind
        self.phase, self.rate = rng.uniform(0, 2 * np.pi), rng.uniform(0.5, 2.8)
        self.period = rng.uniform(0.4, 1.0) * size[1]
        self.jumps = {int(t): g for t, g in zip(rng.integers(2, 40, 4), rng.uniform(0.75, 1.3, 4), strict=True)}
        self.gain = np.ones(3, np.float32)
        y, x = np.mgrid[-1 : 1 : size[1] * 1j, -1 : 1 : size[0] * 1j]
        self.radius = np.asarray(x**2 + y**2, np.float32)[..., None]
        self.rows = np.arange(size[1], dtype=np.float32)[:, None, None]

    def light(self, image: Plane, t: int) -> Plane:
        if self.kind == "mains":
            image = image + (4.0 if t % 2 else -4.0)
        elif self.kind == "flicker":
            image = image * (1.0 + 0.1 * np.sin(self.rate * t + self.phase))
        elif self.kind == "ramp":
            image = image * (0.5 + 0.5 * min(t / 20, 1.0))
        elif self.kind == "bands":
            image = image * (1.0 + 0.05 * np.sin(2 * np.pi * self.rows / self.period + self.rate * t + self.phase))
        elif self.kind == "exposure":
            self.gain *= self.jumps.get(t, 1.0)
            image = image * np.clip(self.gain, 0.5, 1.6)
        elif self.kind == "white balance":
            warmth = 0.15 * np.tanh((t - 20) / 6) + (0.15 if t > 35 else 0.0)
            image = image * np.array([1.0 - warmth, 1.0, 1.0 + warmth], np.float32)
        elif self.kind == "vignette":
            image = image * (1.0 - (0.12 + 0.1 * np.sin(self.rate * t + self.phase)) * self.radius)
        return np.asarray(image, np.float32)


class _Fixture:
    """What changes in its place."""

    def __init__(self, kind: str, size: tuple[int, int], rng: np.random.Generator) -> None:
        self.kind = kind
        self.side = int(rng.integers(14, 60))
        self.x = int(rng.integers(4, size[0] - 100))
        self.y = int(rng.integers(30, size[1] - 64))
        self.period = int(rng.integers(2, 12))
        self.scale = float(rng.uniform(0.4, 1.0))
        self.start = int(rng.integers(0, 86400))
        self.colour = rng.uniform(120, 255, 3)
        self.picture = rng.uniform(20, 235, (8, 8, 3)).astype(np.float32)

    def draw(self, image: Plane, t: int, rng: np.random.Generator) -> None:
        if self.kind == "clock":  # of a video at 12 frames per second
            seconds = self.start + t // 12
            self._write(image, f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}")
        elif self.kind == "fast clock":
            self._write(image, f"{self.start % 60:02d}.{(4 * t) % 100:02d}")
        elif self.kind == "blinking light":
            if t // self.period % 2:
                y, x = np.mgrid[: image.shape[0], : image.shape[1]]
                glow = np.exp(-((x - self.x) ** 2 + (y - self.y) ** 2) / (2 * (self.side / 4) ** 2))
                image += (0.9 * np.clip(1.3 * glow, 0, 1)[..., None] * (self.colour - image)).astype(np.float32)
        else:
            if t % self.period == 0:
                self.picture = rng.uniform(20, 235, (8, 8, 3)).astype(np.float32)
            shown = cv2.resize(self.picture, (2 * self.side, self.side), interpolation=cv2.INTER_CUBIC)
            part = image[self.y : self.y + self.side, self.x : self.x + 2 * self.side]
            part[:] = np.clip(shown, 0, 255)[: part.shape[0], : part.shape[1]]

    def _write(self, image: Plane, words: str) -> None:
        ink = np.zeros(image.shape[:2], np.uint8)
        cv2.putText(ink, words, (self.x, self.y), cv2.FONT_HERSHEY_SIMPLEX, self.scale, 255, 2, cv2.LINE_AA)
        image += (ink / np.float32(255))[..., None] * (np.float32(250) - image)


def _surface(rng: np.random.Generator, kinds: tuple[str, ...]) -> Texture:
    return Texture(str(rng.choice(kinds)), float(rng.uniform(0.6, 1.2)), None, int(rng.integers(1 << 30)))


def _velocity(rng: np.random.Generator, least: float, most: float) -> tuple[float, float]:
    speed, angle = rng.uniform(least, most), rng.uniform(0, 2 * np.pi)
    return float(speed * np.cos(angle)), float(speed * np.sin(angle))


def still(seed: int, light: str | None = None, fixtures: tuple[str, ...] | None = None) -> Scene:
    """A scene without mover."""
    rng = np.random.default_rng([seed, 1])
    drawn_light = str(rng.choice(LIGHTS))
    drawn = tuple(str(kind) for kind in rng.choice(FIXTURES, int(rng.integers(0, 3)), replace=False))
    quality = int(rng.integers(30, 91)) if rng.random() < 0.5 else None
    light, fixtures = light or drawn_light, drawn if fixtures is None else fixtures
    size = (640, 480) if rng.random() < 0.2 else (320, 240)
    noise = float(rng.uniform(0, 6))
    return Scene(_surface(rng, GROUNDS), (), light, fixtures, size=size, noise=noise, jpeg=quality, seed=seed)


def crossing(seed: int) -> Scene:
    """One mover inside the frame that stands for a while, then goes; before a still scene of any kind."""
    scene = still(seed)
    rng = np.random.default_rng([seed, 2])
    width, height = scene.size
    size = float(np.exp(rng.uniform(np.log(12), np.log(100))))
    extent = (size, float(np.clip(size * rng.uniform(0.6, 1.5), 12, 110)))
    velocity = _velocity(rng, 1.0, min(8.0, max(2.0, size / 4)))
    # From the far side of the frame's middle, so that it is in the picture for a while.
    start = tuple(
        float(np.clip(side / 2 - 12 * v + rng.uniform(-20, 20), e / 2 + 6, side - e / 2 - 6))
        for side, v, e in zip((width, height), velocity, extent, strict=True)
    )
    mover = Mover(
        str(rng.choice(("box", "ellipse"))), extent, (start[0], start[1]), velocity,
        float(rng.choice((0.0, rng.uniform(-0.04, 0.04)))), int(rng.integers(0, 12)), _surface(rng, SURFACES),
    )  # fmt: skip
    return replace(scene, movers=(mover,))


def entering(seed: int) -> Scene:
    """One mover that comes in over the border, from a pedestrian to a truck."""
    scene = replace(still(seed), frames=110)
    rng = np.random.default_rng([seed, 3])
    width, height = scene.size
    extent = (float(rng.uniform(20, 0.55 * width)), float(rng.uniform(20, 0.4 * height)))
    speed = float(rng.uniform(2, 6))
    y = float(rng.uniform(extent[1] / 2 + 8, height - extent[1] / 2 - 8))
    side = 1.0 if rng.random() < 0.5 else -1.0
    first = int(rng.integers(2, 10))
    x = -extent[0] / 2 - 2 if side > 0 else width + extent[0] / 2 + 2
    mover = Mover("box", extent, (x, y), (side * speed, 0.0), 0.0, first, _surface(rng, SURFACES))
    return replace(scene, movers=(mover,))


def turning(seed: int) -> Scene:
    """A bar or a fan that turns in its place."""
    scene = still(seed)
    rng = np.random.default_rng([seed, 4])
    shape = str(rng.choice(("bar", "fan")))
    length = float(rng.uniform(50, 100))
    extent = (length, length / 4) if shape == "bar" else (length, length)
    centre = float(rng.uniform(70, scene.size[0] - 70)), float(rng.uniform(65, scene.size[1] - 65))
    spin = float(rng.choice((-1, 1)) * rng.uniform(0.04, 0.12))
    mover = Mover(shape, extent, centre, (0.0, 0.0), spin, int(rng.integers(0, 6)), _surface(rng, SURFACES))
    return replace(scene, movers=(mover,))


def panning(seed: int, *, mover: bool) -> Scene:
    """A camera that pans, with or without something that moves in its picture."""
    base = crossing(seed) if mover else still(seed)
    rng = np.random.default_rng([seed, 5])
    return replace(base, camera=_velocity(rng, 0.5, 4.0), fixtures=())


def pair(seed: int) -> Scene:
    """Two movers in two halves of the frame, the second later."""
    one = crossing(seed)
    rng = np.random.default_rng([seed, 6])
    width, height = one.size
    movers = []
    for index, (low, high) in enumerate(((0.0, 0.5), (0.5, 1.0))):
        size = float(rng.uniform(20, 50))
        speed = float(rng.uniform(1, 4)) * float(rng.choice((-1, 1)))
        y = float(rng.uniform(low * height + size, high * height - size))
        x = width / 2 - 18 * speed
        movers.append(Mover("box", (size, size), (x, y), (speed, 0.0), 0.0, 15 * index, _surface(rng, SURFACES)))
    return replace(one, movers=tuple(movers))
