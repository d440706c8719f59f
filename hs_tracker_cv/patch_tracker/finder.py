"""Where the object is: a correlation filter, regularised in space and time, over a wide window round it.

F. Li and others, "Learning spatial-temporal regularized correlation filters for visual tracking", CVPR 2018: the
filter has weight on the object only, although it is learned on all that surrounds it, and each frame changes it as
little as will do. It finds; size and shape are not its business.

Beside histograms of edges, gray and what colours are called, it sees what has changed since the frame before, as long
as the camera stands still: a hand that bends before a desk looks like nothing that was learned, but it moves; and
what stands still behind a walker is in his box, but not of him. The
filter as the first frame taught it is kept as a witness: what was learned by mistake agrees with itself, not with it.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Annotated, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .._native import kernels
from ..validation import Shape, Within
from . import tuning
from .patches import Place

__all__ = [
    "CELLS",
    "NO_FADE",
    "PATCH",
    "Fade",
    "Finder",
    "Lattice",
    "Peak",
    "Scene",
    "colour_names",
    "find_and_learn",
    "find_peak",
    "lattice_of",
    "learn",
    "likelihood",
    "start",
    "with_unrest",
]

F32 = NDArray[np.float32]
_Spectrum = Annotated[F32, Shape(40, 21, 2, "features")]

CELLS = tuning.CELLS

PATCH = 4 * CELLS + 2
"""Samples along a side of the window, with one more at each end."""

_GRAY_CHANNELS, _COLOUR_CHANNELS = 16, 24


class Lattice(NamedTuple):
    """What depends on the size of the first box only.

    Parameters
    ----------
    step : float
        Distance of samples, px, while the object has its first size; a cell is four.
    target : ndarray, shape (CELLS, CELLS // 2 + 1), float32
        Spectrum of the wanted response: a Gaussian round no displacement.
    penalty : ndarray, shape (CELLS, CELLS), float32
        On the square of the filter.
    fade : ndarray, shape (CELLS, CELLS), float32
        Weights of the window, small at its border.
    around : ndarray of bool, shape (CELLS, CELLS)
        Cells that are not the object's.
    """

    step: float
    target: Annotated[F32, Shape(40, 21)]
    penalty: Annotated[F32, Shape(40, 40)]
    fade: Annotated[F32, Shape(40, 40)]
    around: Annotated[NDArray[np.bool_], Shape(40, 40)]


class Finder(NamedTuple):
    """What was learned.

    Parameters
    ----------
    lattice : Lattice
    filter : ndarray, shape (CELLS, CELLS // 2 + 1, 2, channels), float32
        Its spectrum, real parts first.
    witness : ndarray
        The filter as the first frame taught it.
    unit : float
        Response of the witness to the first frame.
    unrest : float or None
        By how many gray levels the surroundings change from frame to frame, running mean; None at first.
    """

    lattice: Lattice
    filter: _Spectrum
    witness: _Spectrum
    unit: Annotated[float, Within(1e-9, 1e9)]
    unrest: float | None


class Scene(NamedTuple):
    """A window of a frame, and the same of the frame before.

    Parameters
    ----------
    picture : ndarray, shape (H, W, C), float32
        0–255.
    at : Place
        Where the window is in `picture`, and the distance of its samples.
    before : ndarray, shape (H, W, 1), float32, or None
        The frame before in gray; None at first.
    then : Place
        Where the window is in `before`.
    """

    picture: F32
    at: Place
    before: F32 | None
    then: Place


class Fade(NamedTuple):
    """A penalty on distance: `weight` times the square of a distance from a point, per axis in units of its own.

    Parameters
    ----------
    weight : float
    right, down : float
        Where the window's centre is, seen from the point, units.
    across, along : float
        Units per cell to the right and downwards.
    """

    weight: float
    right: float
    down: float
    across: float
    along: float


NO_FADE = Fade(0.0, 0.0, 0.0, 0.0, 0.0)


class Peak(NamedTuple):
    """Answer of the filter to one window. Heights are in units of the response to the first frame.

    Parameters
    ----------
    dx, dy : float
        Displacement of the peak from the window's centre, cells.
    height, value : float
        Height of the peak; the same less the fade.
    second : float
        Highest point away from the peak.
    mean, deviation : float
        Of all that is away from the peak.
    witness : float
        Response of the witness at the peak.
    change : float
        Gray levels by which most of the surroundings have changed since the frame before.
    response : ndarray, shape (CELLS, CELLS), float32
        No displacement is at ``[CELLS // 2, CELLS // 2]``.
    """

    dx: float
    dy: float
    height: float
    value: float
    second: float
    mean: float
    deviation: float
    witness: float
    change: float
    response: F32


def lattice_of(width: float, height: float) -> Lattice:
    """Lattice for a first box of that size, px."""
    side = math.sqrt(width * height)
    cell = tuning.WINDOW * side / CELLS
    steps = np.minimum(np.arange(CELLS), CELLS - np.arange(CELLS))
    square = steps[:, None] ** 2 + steps**2
    wanted = np.exp(square / (-2.0 * (tuning.SIGMA * side / cell) ** 2))
    distance = np.abs(np.arange(CELLS) + 0.5 - CELLS / 2) * cell
    fade = np.sin(np.pi * (np.arange(CELLS) + 1) / (CELLS + 1)) ** 2
    # A thin object has two cells across nevertheless.
    inside = _within(distance, max(width / 2, tuning.THIN * cell), max(height / 2, tuning.THIN * cell))
    return Lattice(
        cell / 4,
        np.ascontiguousarray(np.fft.rfft2(wanted).real, np.float32),
        np.where(inside, np.float32(tuning.INSIDE), np.float32(tuning.OUTSIDE)),
        np.outer(fade, fade).astype(np.float32),
        ~_within(distance, tuning.AROUND * width, tuning.AROUND * height),
    )


def _within(distance: NDArray[np.float64], across: float, down: float) -> NDArray[np.bool_]:
    return np.asarray((distance[:, None] <= down) & (distance <= across))


@lru_cache(maxsize=2)
def colour_names(channels: int) -> F32:
    """How far each colour is called black, gray, white, red, yellow, green, cyan, blue, magenta.

    Colours between two names share them, so that a little more light is a little change.

    Parameters
    ----------
    channels : int
        1 for gray, 3 for BGR.

    Returns
    -------
    ndarray, shape (32 ** channels, 9), float32
        Shares of sum 1, blue being the slowest index.
    """
    shades = (np.arange(32) + 0.5) / 32
    if channels == 1:
        b = g = r = shades
    else:
        b, g, r = (plane.ravel() for plane in np.meshgrid(shades, shades, shades, indexing="ij"))
    most, least = np.maximum(np.maximum(b, g), r), np.minimum(np.minimum(b, g), r)
    chroma, light = most - least, (most + least) / 2
    vivid = np.clip(0.8 * chroma / (0.25 * most + 0.1), 0, 1)
    span = np.where(chroma > 0, chroma, 1)
    hue = np.where(most == r, (g - b) / span % 6, np.where(most == g, (b - r) / span + 2, (r - g) / span + 4))
    black, white = np.clip(1 - 3 * light, 0, 1), np.clip(3 * light - 2, 0, 1)
    pale = [(1 - vivid) * share for share in (black, 1 - black - white, white)]
    hues = [vivid * np.clip(1 - np.abs((hue - k + 3) % 6 - 3), 0, 1) for k in range(6)]
    return np.ascontiguousarray(np.stack(pale + hues, axis=1), np.float32)


def start(scene: Scene, lattice: Lattice, coloured: bool) -> Finder:
    """Learn from the first frame; `coloured` lets the filter see colours."""
    witness = np.empty((CELLS, CELLS // 2 + 1, 2, _COLOUR_CHANNELS if coloured else _GRAY_CHANNELS), np.float32)
    finder = Finder(lattice, witness, witness, 1.0, None)
    spectrum, _ = _spectrum(finder, scene)
    _adapt(spectrum, lattice, None, witness)
    return finder._replace(unit=_respond(finder, spectrum, 0.0, NO_FADE).height)


def find_peak(finder: Finder, scene: Scene, fade: Fade = NO_FADE) -> Peak:
    """Say where in a window the object is."""
    return _respond(finder, *_spectrum(finder, scene), fade)


def learn(finder: Finder, scene: Scene) -> Finder:
    """Learn one more window with the object in its middle."""
    spectrum, _ = _spectrum(finder, scene)
    return _learned(finder, spectrum)


def find_and_learn(finder: Finder, scene: Scene) -> tuple[Peak, Finder]:
    """Say where in a window the object is, and learn that it is in its middle."""
    spectrum, change = _spectrum(finder, scene)
    return _respond(finder, spectrum, change, NO_FADE), _learned(finder, spectrum)


def with_unrest(finder: Finder, change: float) -> Finder:
    """Take in by how many gray levels the surroundings have changed since the frame before."""
    old = finder.unrest
    return finder._replace(unrest=change if old is None else old + tuning.UNREST_RATE * (change - old))


def _spectrum(finder: Finder, scene: Scene) -> tuple[F32, float]:
    """Spectrum (CELLS, CELLS // 2 + 1, 2, channels) of a window's channels, and how much its surroundings changed."""
    lattice, channels, change = finder.lattice, finder.filter.shape[3], 0.0
    features, grays = np.empty((CELLS, CELLS, channels), np.float32), np.empty((CELLS, CELLS), np.float32)
    names = colour_names(scene.picture.shape[2]) if channels == _COLOUR_CHANNELS else None
    kernels.describe(scene.picture, scene.at, lattice.fade, names, features, grays)
    if scene.before is not None:
        then = np.empty_like(grays)
        kernels.shade(scene.before, scene.then, then)
        changes = np.abs(grays - then)
        around = changes[lattice.around]
        if around.size:
            rank = int(tuning.UNREST_SHARE * (around.size - 1))
            change = float(np.partition(around, rank)[rank])
        unrest = change if finder.unrest is None else finder.unrest
        still = min(max((tuning.SHAKEN - unrest) / (tuning.SHAKEN - tuning.STILL), 0.0), 1.0)
        if finder.unrest is not None:
            # What stands still while the camera does is hardly the object.
            moving = np.minimum(changes * np.float32(1.0 / tuning.MOVES), np.float32(1.0))
            dimmed = np.float32(tuning.DIMMED * still) * (np.float32(1.0) - cv2.blur(moving, (3, 3)))
            features *= (np.float32(1.0) - dimmed)[:, :, np.newaxis]
        features[:, :, -1] = np.minimum(changes * np.float32(1.0 / tuning.CHANGED), np.float32(1.0)) * lattice.fade
        features[:, :, -1] *= np.float32(still)
    spectrum = np.empty((CELLS, CELLS // 2 + 1, 2, channels), np.float32)
    kernels.transform(features, spectrum)
    return spectrum, change


def _respond(finder: Finder, spectrum: F32, change: float, fade: Fade) -> Peak:
    response, unit = np.empty((CELLS, CELLS), np.float32), finder.unit
    scaled = fade._replace(weight=fade.weight * unit)
    dx, dy, *heights = kernels.respond(finder.filter, finder.witness, spectrum, scaled, response)
    height, value, second, mean, deviation, witness = (height / unit for height in heights)
    response *= np.float32(1.0 / unit)
    return Peak(dx, dy, height, value, second, mean, deviation, witness, change, response)


def _learned(finder: Finder, spectrum: F32) -> Finder:
    filter_ = np.empty_like(spectrum)
    _adapt(spectrum, finder.lattice, finder.filter, filter_)
    return finder._replace(filter=filter_)


def _adapt(spectrum: F32, lattice: Lattice, old: F32 | None, filter_: F32) -> None:
    how = kernels.FilterLearning(
        memory=tuning.MEMORY, coupling=tuning.COUPLING, growth=tuning.COUPLING_GROWTH, rounds=tuning.ROUNDS
    )
    kernels.adapt(spectrum, lattice.target, lattice.penalty, old, how, filter_)


def likelihood(seen: Peak, level: float) -> float:
    """Chance that a box at the peak overlaps the object by more than half: logistic fit to frames of real video.

    Parameters
    ----------
    seen : Peak
    level : float
        Height of the peak, relative to its running mean.
    """
    level = min(max(level, tuning.LEVEL_LEAST), 1.0)
    second = min(max(seen.second / max(seen.height, 1e-6), 0.0), tuning.SECOND_MOST)
    witness = min(max(seen.witness, 0.0), 1.0)
    height = tuning.CHANCE + tuning.CHANCE_LEVEL * math.log(level)
    return 1.0 / (1.0 + math.exp(-height - tuning.CHANCE_SECOND * second - tuning.CHANCE_WITNESS * witness))
