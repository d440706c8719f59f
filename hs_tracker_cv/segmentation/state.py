"""What the two-layer model remembers between frames, and what it says after each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._native.kernels.segmentation import Ground
from ..estimate import Estimate
from ..validation import Count, Shape, Within
from .colour import BINS

__all__ = [
    "Atlas",
    "Beginning",
    "Image",
    "Occlusion",
    "Plane",
    "SegmentationEstimate",
    "SegmentationParams",
    "SegmentationState",
]

Plane = Annotated[NDArray[np.float32], Shape("h", "w")]
"""One value per window pixel, (h, w)."""
Image = Annotated[NDArray[np.float32], Shape("h", "w", 3)]
"""Three values per window pixel, (h, w, 3), 0–255."""
Mask = Annotated[NDArray[np.uint8], Shape("h", "w")]
_Seen = Annotated[NDArray[np.float32], Shape("seen h", "seen w")]
_Step = Annotated[int, Within(1, 2**20)]


_Factor = Annotated[float, Within(1e-3, 1e3)]
Light = tuple[_Factor, _Factor, _Factor]
"""How much brighter than in the first frame blue, green and red are."""
EVEN_LIGHT: Light = (1.0, 1.0, 1.0)


@dataclass(frozen=True)
class SegmentationParams:
    """Parameters of the two-layer model. Lengths are lattice pixels (frame px / step), intensities 0–255.

    Parameters
    ----------
    working_size : int
        Longest side of the object on the working lattice, px; a larger object is averaged down.
    margin : float
        Window round the object, as a share of its longest side (at least 10 px).
    smoothness : float
        λ of the Horn–Schunck flow.
    warps : int
        Warps per pyramid level of the flow.
    colour_weight : float
        Weight of the colour histograms' log-ratio in the labelling; 0 switches it off.
    occlusion_ratio : float
        Visible share of the object's shape below which a suspected occlusion is confirmed, 0–1.
    max_coast : int
        Frames for which an unseen object is taken to move on as before; also the longest occlusion believed while
        a good part of the object is seen.
    """

    working_size: int = 100
    margin: float = 0.25
    smoothness: float = 8.0
    warps: int = 1
    colour_weight: float = 0.7
    occlusion_ratio: float = 0.82
    max_coast: int = 70

    def __post_init__(self) -> None:
        if self.working_size < 16:
            raise ValueError(f"expected working_size >= 16, got {self.working_size}")
        if not self.margin > 0:
            raise ValueError(f"expected margin > 0, got {self.margin}")
        if not self.smoothness > 0:
            raise ValueError(f"expected smoothness > 0, got {self.smoothness}")
        if self.warps < 1:
            raise ValueError(f"expected warps >= 1, got {self.warps}")
        if not self.colour_weight >= 0:
            raise ValueError(f"expected colour_weight >= 0, got {self.colour_weight}")
        if not 0 < self.occlusion_ratio < 1:
            raise ValueError(f"expected occlusion_ratio between 0 and 1, got {self.occlusion_ratio}")
        if self.max_coast < 1:
            raise ValueError(f"expected max_coast >= 1, got {self.max_coast}")


@dataclass(frozen=True, kw_only=True)
class SegmentationEstimate(Estimate):
    """What one frame gave; the box is amodal while the object is occluded, the score by what is seen and explained.

    Parameters
    ----------
    unexplained : float
        f: share of the known background outside the mask whose noise-normalised error exceeds 5.
    camera : tuple of float
        Camera translation, frame px per frame.
    """

    previous: _Seen
    current: _Seen
    flow: Annotated[NDArray[np.float32], Shape("seen h", "seen w", 2)]
    mask: Annotated[NDArray[np.uint8], Shape("seen h", "seen w")]
    unexplained: Annotated[float, Within(0.0, 1.0)]
    camera: tuple[float, float]


@dataclass(frozen=True)
class Atlas:
    """The background, on a lattice of its own that the camera moves over.

    Parameters
    ----------
    image : ndarray, shape (h, w, 3)
    counts : ndarray, shape (3, h, w), float32
        Samples (0 not yet seen uncovered); frames of mismatch; frames since the pixel last matched
        uncovered.
    offset : tuple of float
        Background pixel (i, j) is seen at window pixel (i, j) + offset; each in [−½, ½].
    """

    image: Image
    counts: Annotated[NDArray[np.float32], Shape(3, "h", "w")]
    offset: tuple[float, float] = (0.0, 0.0)

    @property
    def native(self) -> Ground:
        """As the kernels have it."""
        return Ground(self.image, self.counts)


class Occlusion(NamedTuple):
    """Memory of the occlusion logic.

    Parameters
    ----------
    suspected : int
        Frames since something seemed to cover the object; 0 is not suspected.
    occluded : bool
        Confirmed.
    coasting : int
        Frames in which nothing of the object was seen.
    vanished : bool
        It was not covered bit by bit: something else is in its place since one frame.
    sides : tuple of (left, top, right, bottom)
        Last boxes relative to the background, lattice px, newest last.
    speeds : tuple of (vx, vy)
        Last velocities relative to the background, newest last.
    duration : int
        Frames since the occlusion was confirmed.
    missing : tuple of float
        What the remembered shape lacks on the left, top, right and bottom: it was going out of sight before the
        occlusion was confirmed.
    drift : tuple of float
        Camera translation summed since the start, lattice px: what `sides` are relative to.
    """

    suspected: Count = 0
    occluded: bool = False
    coasting: Count = 0
    vanished: bool = False
    sides: tuple[tuple[float, float, float, float], ...] = ()
    speeds: tuple[tuple[float, float], ...] = ()
    duration: Count = 0
    missing: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    drift: tuple[float, float] = (0.0, 0.0)

    def rescaled(self, ratio: float) -> Occlusion:
        """Return the memory in lattice pixels `ratio` times as many."""
        sides = tuple((a * ratio, b * ratio, c * ratio, d * ratio) for a, b, c, d in self.sides)
        speeds = tuple((vx * ratio, vy * ratio) for vx, vy in self.speeds)
        left, top, right, bottom = (side * ratio for side in self.missing)
        drift = (self.drift[0] * ratio, self.drift[1] * ratio)
        return self._replace(sides=sides, speeds=speeds, missing=(left, top, right, bottom), drift=drift)


NOTHING_IN_FRONT = Occlusion()


class Beginning(NamedTuple):
    """What was in the box in which the object was begun.

    Parameters
    ----------
    image : ndarray, shape (h, w, 3)
        In the light of the first frame.
    origin : tuple of int
        Its top-left, lattice px.
    centre : tuple of float
        Of the box, lattice px.
    """

    image: Annotated[NDArray[np.float32], Shape("begun h", "begun w", 3)]
    origin: tuple[int, int]
    centre: tuple[float, float]


@dataclass(frozen=True)
class SegmentationState:
    """Everything carried to the next frame; never changed in place. All windows are those of the *next* frame.

    Parameters
    ----------
    estimate : SegmentationEstimate
        Of the frame just seen.
    count : int
        Frames seen since the start.
    step : int
        Frame px per lattice pixel.
    origin : tuple of int
        Top-left of the window, lattice px.
    box : tuple of float
        x, y, w, h of the object, lattice px.
    velocity : tuple of float
        Object, lattice px per frame.
    linear : tuple of float
        Linear part (u_x, u_y, v_x, v_y) of its motion, per frame.
    camera : tuple of float
        Last camera translation, lattice px.
    previous : ndarray, shape (h, w, 3)
        The frame just seen.
    gray : ndarray, shape (h, w)
        Its gray version.
    odds, shape : ndarray, shape (h, w)
        Log-odds of "object"; slow memory of its shape, 0–1.
    obj : ndarray, shape (h, w, 3)
        Object layer.
    distractor : ndarray, shape (h, w), uint8, or None
        What moves but is not the object, if there is such a thing.
    visible : ndarray, shape (h, w), uint8, or None
        While it is occluded, the object pixels seen in the last frame.
    atlas : Atlas
        Background layer.
    colours : ndarray, shape (2, bins)
        Histograms of object and background.
    noise : float
        σ, gray levels.
    contrast : float
        Motion contrast between object and camera, 0–1.
    match_cost : float
        Running mean residual of the predicted motion, gray levels.
    occlusion : Occlusion
    light : tuple of float
        How much brighter the frame just seen is than the first one, per channel; all images here are in the light of
        the first.
    begun : Beginning or None
        Where `occlusion.drift` began, too; None once that or the lattice has changed.
    """

    estimate: SegmentationEstimate
    count: Count
    step: _Step
    origin: tuple[int, int]
    box: tuple[float, float, float, float]
    velocity: tuple[float, float]
    linear: tuple[float, float, float, float]
    camera: tuple[float, float]
    previous: Image
    gray: Plane
    odds: Plane
    shape: Plane
    obj: Image
    distractor: Mask | None
    visible: Mask | None
    atlas: Atlas
    colours: Annotated[NDArray[np.float32], Shape(2, BINS)]
    noise: float = 2.5
    contrast: float = 0.0
    match_cost: float = 0.0
    occlusion: Occlusion = NOTHING_IN_FRONT
    light: Light = EVEN_LIGHT
    begun: Beginning | None = None

    @property
    def turn(self) -> float:
        """Angle by which the object turns per frame, radians from x towards y."""
        return 0.5 * (self.linear[2] - self.linear[1])

    def replace(self, **changes: Any) -> SegmentationState:
        """Return a copy with some fields changed."""
        # several times as fast as dataclasses.replace, which asks for each field by name
        copy = object.__new__(type(self))
        copy.__dict__.update(self.__dict__, **changes)
        return copy
