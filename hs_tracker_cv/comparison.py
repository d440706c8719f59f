"""Two frames compared: what has changed between them beside the light, the noise and what the camera has moved.

All is done on a lattice over the frame, so that a large frame costs little more than a small one.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import STILL, Affine, camera_motion, carried
from .frames import Frame, crop, to_gray
from .photometry import NORMAL_SIGMA, relit, structure_changed
from .scalars import make_plain

__all__ = ["Comparison", "DetectorParams", "Reduced", "changed", "compare", "is_restless", "reduced", "slope"]

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

MIN_CHANGE = 3.0
"""Smallest change in brightness that counts, gray levels. Video codecs skip most blocks of a still scene, so that the
median change is 0, and refresh others by one or two levels."""
RESTLESS = 0.3
"""Share of the texture changed from which the camera may have moved."""
RESTLESS_FRAME = 0.03
"""The same, as a share of the frame."""
SHIFTED = 0.2
"""Share of the change that a shift of the whole picture explains, from which the camera may have moved."""
COARSE = 4
"""Lattice px that are averaged for that: the shift is small then, and the noise too."""
SPARSE = 2
"""Every second pixel, each way, is enough for a statistic over the frame."""
TEXTURED = (2.0, 2.0)
"""Slope from which a pixel has texture: in units of the noise, and gray levels per lattice px at least."""
CREST, CREST_SIDE = 0.4, 7
"""Share of the strongest change in a square of so many lattice px that is no halo: smoothing spreads a change."""
RINGING, RINGING_SIDE = 0.15, 41
"""The same for the ringing of codecs round what moves."""


@dataclass(frozen=True, kw_only=True)
class DetectorParams:
    """How moving regions are found.

    Parameters
    ----------
    smoothing : float
        σ of the Gaussian before the flow, lattice px; >= 0.
    threshold : float or None
        Normal flow from which a pixel moves, frame px per frame, > 0. None follows the noise.
    noise_factor : float
        With ``threshold=None``: change in brightness from which a pixel moves, in standard deviations of the noise.
    min_speed : float
        Slowest motion of a region, frame px per frame.
    min_area : float
        Smallest region, as a share of the frame; > 0.
    max_side : int
        Longer side of the lattice, px; larger frames are averaged down to it.
    flow_side : int
        Longer side of the lattice the flow is solved on, px; it is smooth, so a coarser one loses little.
    max_corners : int
        Most corners per region.
    """

    smoothing: float = 1.0
    threshold: float | None = None
    noise_factor: float = 5.0
    min_speed: float = 0.15
    min_area: float = 5e-4
    max_side: int = 320
    flow_side: int = 320
    max_corners: int = 50

    def __post_init__(self) -> None:
        """Refuse values outside their range."""
        make_plain(self)
        for name, lowest in (
            ("noise_factor", 0.0),
            ("min_area", 0.0),
            ("max_side", 31),
            ("flow_side", 31),
            ("max_corners", 0),
        ):
            if not getattr(self, name) > lowest:
                raise ValueError(f"expected {name} above {lowest:g}, got {getattr(self, name)!r}")
        for name in ("smoothing", "min_speed"):
            if not getattr(self, name) >= 0:
                raise ValueError(f"expected {name} of at least 0, got {getattr(self, name)!r}")
        if self.threshold is not None and not self.threshold > 0:
            raise ValueError(f"expected threshold above 0 or None, got {self.threshold!r}")


@dataclass(frozen=True)
class Reduced:
    """A frame on the lattice.

    Parameters
    ----------
    width, height : int
        Of the frame, px.
    step : float
        Frame px per lattice px.
    colours : ndarray, shape (h, w, C), float32
        Smoothed, 0–255.
    gray : ndarray, shape (h, w), float32
    """

    width: int
    height: int
    step: float
    colours: Plane
    gray: Plane


@dataclass(frozen=True)
class Comparison:
    """A pair of frames on the lattice of `after`.

    Parameters
    ----------
    before, after : Reduced
    predicted : ndarray, shape (h, w), float32
        `before` carried along the camera's motion and into the light of `after`.
    change : ndarray, shape (h, w), float32
        `after` minus predicted, 0 where nothing is known.
    seeds : ndarray of bool, shape (h, w)
        Where neither light nor noise explains the change.
    motion : ndarray, shape (2, 3), or None
        Camera's motion: affine map of lattice pixels from `before` to `after`; None where the two cannot be
        compared, after a cut for one.
    gain : ndarray, shape (h, w), float32
        Predicted over carried brightness.
    """

    before: Reduced
    after: Reduced
    predicted: Plane
    change: Plane
    seeds: Mask
    motion: Affine | None
    gain: Plane


def reduced(frame: Frame, params: DetectorParams) -> Reduced:
    """Take a frame to the lattice."""
    step = max(1.0, max(frame.width, frame.height) / params.max_side)
    size = (max(round(frame.width / step), 1), max(round(frame.height / step), 1))
    colours = _lattice(frame, size, params.smoothing)
    return Reduced(frame.width, frame.height, step, colours, to_gray(colours))


def compare(before: Reduced, after: Reduced, params: DetectorParams, *, camera_moves: bool = False) -> Comparison:
    """Compare two frames.

    Parameters
    ----------
    before, after : Reduced
        Of one size.
    params : DetectorParams
    camera_moves : bool
        Whether the camera is known to move. By default its motion is asked for only where much has changed.
    """
    motion: Affine | None = STILL
    colours, known = before.colours, np.ones(after.gray.shape, bool)
    predicted, change = relit(colours, after.gray)
    if camera_moves or is_restless(predicted, after.gray, change, after.step, params):
        motion = camera_motion(before.gray, after.gray)
        if motion is None:
            known[:] = False
        elif motion is not STILL:
            colours, known = carried(before.colours, motion)
            predicted, change = relit(colours, after.gray, known)
    change = np.where(known, change, np.float32(0.0))
    seeds = changed(predicted, after.gray, change, after.step, params)
    gain = np.asarray((predicted + 1.0) / (to_gray(colours) + 1.0), np.float32)
    return Comparison(before, after, predicted, change, seeds, motion, gain)


def is_restless(predicted: Plane, gray: Plane, change: Plane, step: float, params: DetectorParams) -> bool:
    """Whether so much of the texture has changed that the camera may have moved."""
    sparse = slice(None, None, SPARSE), slice(None, None, SPARSE)
    steep = slope(predicted)[sparse]
    textured = steep > max(TEXTURED[0] * _noise(change), TEXTURED[1])
    strong = np.abs(change[sparse]) > _least_change(change, steep, step, params)
    least = max(RESTLESS * np.count_nonzero(textured), RESTLESS_FRAME * textured.size)
    return bool(np.count_nonzero(strong & textured) > least) or _shifted_share(predicted, change) > SHIFTED


def _shifted_share(predicted: Plane, change: Plane) -> float:
    """Share of the change that a small shift of the whole picture explains; noise is no such change."""
    size = max(change.shape[1] // COARSE, 1), max(change.shape[0] // COARSE, 1)
    coarse, left = (cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in (predicted, change))
    slopes = np.stack([cv2.Sobel(coarse, cv2.CV_32F, dx, 1 - dx, scale=1 / 8).ravel() for dx in (1, 0)]).astype(float)
    target = left.ravel().astype(float)
    along = slopes @ target
    normal = slopes @ slopes.T + 1e-3 * np.eye(2)
    return float(along @ np.linalg.solve(normal, along)) / max(float(target @ target), 1e-3)


def changed(predicted: Plane, gray: Plane, change: Plane, step: float, params: DetectorParams) -> Mask:
    """Pixels of which neither noise nor light explains the change."""
    strength = np.abs(change)
    seeds = strength > _least_change(change, slope(gray), step, params)
    if not seeds.any():
        return np.asarray(seeds, bool)
    seeds &= structure_changed(predicted, gray) & _near_crest(strength)
    return np.asarray(cv2.medianBlur(seeds.astype(np.uint8), 3) > 0, bool)


def _least_change(change: Plane, steep: Plane, step: float, params: DetectorParams) -> Plane:
    """Change in brightness, per pixel, that stands for the threshold on the normal flow −Ft / |∇F|."""
    if params.threshold is not None:
        return np.asarray(np.maximum(steep, 1.0) * (params.threshold / step), np.float32)
    least = max(params.noise_factor * _noise(change), MIN_CHANGE)
    return np.asarray(np.maximum(steep * (params.min_speed / step), least), np.float32)


def _noise(change: Plane) -> float:
    sample = change[::SPARSE, ::SPARSE]
    return NORMAL_SIGMA * float(np.median(np.abs(sample - np.median(sample))))


def _lattice(frame: Frame, size: tuple[int, int], smoothing: float) -> Plane:
    """Whole frame on the lattice, smoothed, shape (h, w, C); a large one is averaged in its own type."""
    step = max(min(frame.width // size[0], frame.height // size[1]), 1)
    whole = crop(frame, 0, 0, frame.width // step * step, frame.height // step * step, step=step)
    if whole.shape[1::-1] != size:
        whole = np.asarray(cv2.resize(whole, size, interpolation=cv2.INTER_AREA), np.float32)
    if smoothing > 0:
        whole = np.asarray(cv2.GaussianBlur(whole, (0, 0), smoothing), np.float32)
    return whole.reshape(size[1], size[0], -1)


def slope(plane: Plane) -> Plane:
    """Length of the gradient, gray levels per lattice px."""
    return np.asarray(cv2.magnitude(*(cv2.Sobel(plane, cv2.CV_32F, dx, 1 - dx, scale=1 / 8) for dx in (1, 0))))


def _near_crest(change: Plane) -> Mask:
    """Where a change is not the halo of a stronger one.

    It must exceed a share of the strongest change nearby, as smoothing spreads a change past its edge, and a smaller
    share of the strongest farther around, as codecs ring round what moves.
    """
    near, wide = (cv2.dilate(change, np.ones((side, side), np.uint8)) for side in (CREST_SIDE, RINGING_SIDE))
    return np.asarray((change > CREST * near) & (change > RINGING * wide), bool)
