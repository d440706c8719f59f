"""The kernels of segmentation, what `_native/segmentation/bindings.cpp` binds.

Windows are (h, w) pixels: images (h, w, 3), planes (h, w), masks (h, w) of 0 and 1, all C-contiguous. `part` and
`inside` are (x0, y0, x1, y1) in window pixels, the second the part of the window inside the frame. An affine
motion is theta[0..5]: q = p + (t0 + t1 X + t2 Y, t3 + t4 X + t5 Y) with X = (x − cx) / scale, Y alike, `grid` being
(cx, cy, scale, area); theta[6] is a gain in percent, theta[7] a bias in gray levels.

Arrays that belong together are handed over as structs, which are checked when they are made and share memory with
them. Results are written into arrays that are given. Errors name the array: TypeError for other elements, ValueError
for another shape or layout and for results that are read-only.
"""

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Mask = NDArray[np.uint8]
Bins = NDArray[np.int16]
Rectangle = NDArray[np.int64]
Pair = tuple[float, float]
Grid = tuple[float, float, float, float]
Theta = tuple[float, float, float, float, float, float, float, float]

KNOWN: float
"""Samples after which a background pixel is known; until then it must stay as it is from frame to frame."""
FAR_OFF: float
"""Gray levels; where two images differ by more, it counts as this much."""
BINS: int
"""8 × 8 × 8 bins of BGR."""
POINT_ROWS: int
"""Rows of a list of points, see :func:`collect`."""

class Window:
    """The window of this frame, and the part of it inside the frame."""

    def __init__(self, image: Float32, inside: Rectangle) -> None: ...

class Ground:
    """The background: its image, and (3, h, w) samples, mismatches and age."""

    def __init__(self, background: Float32, counts: Float32) -> None: ...

class Scene:
    """The window of this frame, and what explains it: last frame moved by the camera, background and its counts."""

    def __init__(
        self, image: Float32, inside: Rectangle, moved: Float32, background: Float32, counts: Float32
    ) -> None: ...

class Layer:
    """What is known of the object: its image, log-odds and slow shape."""

    def __init__(self, obj: Float32, odds: Float32, shape: Float32) -> None: ...

class Expected:
    """A layer and the last frame where they are expected in this one, {log-odds > 0}, and where they were moved.

    Outside `part` nothing can be the object but what is new.
    """

    def __init__(
        self, previous: Float32, obj: Float32, odds: Float32, shape: Float32, own: Mask, part: Rectangle
    ) -> None: ...

class Evidence:
    """What :func:`evidence` writes.

    Parameters
    ----------
    planes
        (4, h, w): log-likelihood ratio, error against the background (any explanation), local gain of the background,
        error against the last frame where the background is not yet known.
    fresh
        1 where something new covers a background that was seen a moment ago.
    """

    def __init__(self, planes: Float32, fresh: Mask) -> None: ...

class Labels:
    """What :func:`label` writes.

    Parameters
    ----------
    bins, raw, odds
        The bin of each colour, the log-odds as they come out of evidence and colour, the log-odds with all that is
        known of shape.
    mask, foreign
        The object, and the distractor if there is one.
    """

    def __init__(self, bins: Bins, raw: Float32, odds: Float32, mask: Mask, foreign: Mask | None) -> None: ...

class Memory:
    """What is remembered after a frame: a layer, the background with its counts, the histograms (2, bins)."""

    def __init__(
        self, odds: Float32, obj: Float32, shape: Float32, background: Float32, counts: Float32, colours: Float32
    ) -> None: ...

class Points:
    """Pixels by which an image is registered, see :func:`collect`: `count` columns of `rows` (POINT_ROWS, N)."""

    def __init__(self, rows: Float32, count: int = 0) -> None: ...
    @property
    def count(self) -> int: ...

class Outline:
    """The object before this frame.

    Parameters
    ----------
    odds, shown, weighing
        What the object's pixels {odds > 0} weigh: 0 one, `shown` being None; 1 as `shown` says; 2 the odds, at most
        one, times `shown` / 255.
    box
        Grid to fall back on when there is no outline.
    """

    def __init__(self, odds: Float32, shown: Mask | None, weighing: int, box: Grid) -> None: ...

class LastMotion:
    """Velocity (2) and linear part (4) of the object, and velocity of the camera, in the last frame.

    If it is `known`, the object moves by its velocity whatever the image says.
    """

    def __init__(
        self, *, motion: tuple[float, float, float, float, float, float], camera: Pair, known: bool
    ) -> None: ...

class Prediction:
    """What is known before the flow is: mask of the object widened by two pixels, weights, motion, flow to start."""

    def __init__(self, near: Mask, weight: Float32, theta: Float64, flow: Float32) -> None: ...

class Measuring:
    """How motion is measured.

    Parameters
    ----------
    grid
        Of the object.
    camera, offset
        Velocity of the camera, and where the background was, in the last frame.
    noise
        Gray levels.
    hidden, young
        Something is in front of the object; its motion is still little known.
    ground_steps, steps
        Most steps of :func:`gauss_newton` for camera and object.
    """

    def __init__(
        self,
        *,
        grid: Grid,
        camera: Pair,
        offset: Pair,
        noise: float,
        hidden: bool,
        young: bool,
        ground_steps: int,
        steps: int,
    ) -> None: ...

class Registration:
    """How points are registered.

    Parameters
    ----------
    prior
        The diagonal ridge towards the start value, per unit of weight.
    scale, ceiling
        Of ρ, see :func:`gauss_newton`; and the most that a pixel counts in a :func:`residual`.
    stiffness
        What it costs, per unit of weight, to be more than translation, rotation and change of size.
    steps
        At most.
    """

    def __init__(self, *, prior: Float64, scale: float, ceiling: float, stiffness: float, steps: int) -> None: ...

class Likelihood:
    """What the likelihoods of both layers depend on: τ_b², τ_o², κ, contrast of the motions, occlusion, noise, gains.

    Of the gains of the background and of the object the least and the greatest that are believed.
    """

    def __init__(
        self,
        *,
        ground_slope: float,
        object_slope: float,
        channel_weight: float,
        contrast: float,
        occluded: bool,
        noise: float,
        ground_gains: Pair,
        object_gains: Pair,
    ) -> None: ...

class Labelling:
    """How a frame is labelled.

    Parameters
    ----------
    colours, colour_weight
        Histograms of object and background, and how much they count.
    noise
        Gray levels.
    least
        Share of the mask that must be left when its edge is cut.
    growth, young
        Px by which the object may grow (0: what is new says nothing), and whether its motion is too little known for
        that.
    emerging
        The object may be coming out from behind something.
    """

    def __init__(
        self,
        *,
        colours: Float32,
        colour_weight: float,
        noise: float,
        least: float,
        growth: int,
        emerging: bool,
        young: bool,
    ) -> None: ...

class Learning:
    """How a frame is learned from.

    Parameters
    ----------
    colours, colour_rate
        Histograms of object and background, and how fast they are learned.
    shape_rate, freeze
        How fast the shape is learned, or not at all.
    hidden
        Something is in front of the object.
    """

    def __init__(
        self, *, colours: Float32, shape_rate: float, colour_rate: float, freeze: bool, hidden: bool
    ) -> None: ...

def without(mask: Mask, other: Mask, out: Mask) -> int:
    """Write the pixels of a mask that are not in the other; return how many they are."""

def invert(mask: Mask, out: Mask) -> int:
    """Write the pixels outside a mask; return how many they are."""

def median(mask: Mask, out: Mask) -> None:
    """Write 1 where at least five of 3 × 3 pixels are in the mask, the border repeated."""

def spread(allowed: Mask, times: int, out: Mask) -> None:
    """Let the mask `out` grow over `allowed`, in each step to all eight neighbours."""

def widen(mask: Mask, reach: int, out: Mask) -> None:
    """Write 1 where a pixel of the mask lies within `reach` px, in rows and in columns."""

def widen_cross(mask: Mask, out: Mask) -> None:
    """Write 1 where a pixel of the mask is here, or one of the four neighbours."""

def components(mask: Mask, other: Mask, runs: NDArray[np.int32]) -> tuple[int, int]:
    """Take a mask apart: list its runs of pixels in rows, and which of them hang together, also by corners.

    A component is known by its head, the first of its runs. For each run, `runs` (h ⌈w / 2⌉, 6) receives (row, first
    column, end, head), and for each head the area of its component and how much of it is in `other`. Returns the
    numbers of runs and of components.
    """

def bin_colours(image: Float32, bins: Bins) -> None:
    """Bin of each pixel."""

def likelihood(colours: Float32, ratio: Float32) -> float:
    """Write the log-ratio of object to background per bin, clipped to ±2.

    Returns how much the histograms overlap: their Bhattacharyya coefficient, 1 where they are the same.
    """

def blend(colours: Float32, tally: Float32, rate: float, out: Float32) -> None:
    """Move histograms (object, background) towards a frame's counts, smoothed; one without pixels stays.

    The counts are smoothed in place.
    """

def smooth(pixels: Float32, taps: Float32, image: Float32, gray: Float32) -> None:
    """Smooth pixels (h + 4, w + 4, 1 or 3) by five taps both ways: the middle one, its neighbour, the outermost.

    A gray frame is written three times: what follows knows but one kind of window.
    """

def shift(source: Float32, dx: int, dy: int, fill: float, out: Float32) -> None:
    """Copy into a plane whose element (i, j) is (i + dx, j + dy) here; `fill` where there is none."""

def move_object(dx: int, dy: int, layer: Layer, out: Layer) -> None:
    """Copy what is known of the object into another window, see :func:`shift`."""

def move_ground(dx: int, dy: int, gain: float, ground: Ground, image: Float32, odds: Float32, out: Ground) -> None:
    """Copy the background into another window, see :func:`shift`, and make it brighter by `gain`.

    Pixels that are new get the colour of `image`. They are taken as known, or as not yet seen where the object may be
    by its `odds`. `image` and `odds` are of the new window.
    """

def resample(image: Float32, inverse: Float64, repeat: bool, fill: float, out: Float32) -> None:
    """Write to `out` the image at (m0 x + m1 y + m2, m3 x + m4 y + m5), bilinear, m being `inverse`.

    Beyond the image its border is repeated, or else `fill`. OpenCV's own differs from version to version.
    """

def without_object(image: Float32, odds: Float32, dx: int, dy: int, sure: float, fill: float, out: Float32) -> None:
    """Copy an image (h, w, 3), but `fill` where the odds at (i + dx, j + dy) are above `sure`."""

def measure_light(
    image: Float32,
    previous: Float32,
    box: tuple[int, int, int, int],
    stride: int,
    limits: tuple[float, float, float],
) -> tuple[int, list[float]]:
    """Number of pixels that tell the light, and the median by which each channel of them has become brighter.

    They are one in `stride` across and down outside the rectangle `box` (x0, y0, x1, y1), above the first limit
    before, and above the second and below the third now. Of none, the ratio is 1.
    """

def carry(
    previous: Float32, layer: Layer, counts: Float32, inverse: Float64, everywhere: bool, expected: Expected
) -> None:
    """Move what belongs to the object into `expected`, in its part of the window, as :func:`resample` does.

    Images repeat their border, the planes are −3 and 0 beyond theirs; outside the part images are 0 and planes the
    same as beyond. The last frame is moved only where the background is not yet known by its `counts`, unless
    `everywhere`.
    """

def evidence(scene: Scene, expected: Expected, likelihood: Likelihood, out: Evidence) -> float:
    """Log-likelihood ratio, object against background, per pixel.

    Returns
    -------
    Share of the object's pixels that look about as they did.
    """

def warp_and_score(
    scene: Scene,
    previous: Float32,
    layer: Layer,
    inverse: Float64,
    everywhere: bool,
    likelihood: Likelihood,
    expected: Expected,
    out: Evidence,
) -> float:
    """Move what belongs to the object to this frame, as :func:`carry` does, and weigh :func:`evidence` there."""

def collect(reference: Float32, weight: Float32, grid: Grid, stride: int, points: Points) -> None:
    """List the pixels by which `reference` is registered: those of positive weight, every `stride`-th of a row.

    Rows of `points`: x, y, X, Y, weight; then per channel the value and a quarter of the difference of the neighbours
    to the right and left, below and above. There are N at most.
    """

def residual(window: Window, points: Points, theta: Float64, ceiling: float) -> float:
    """Mean of min(|I(p + a(p)) − g R(p) − b|, `ceiling`) over the listed points, each of its weight.

    It is 1e9 when less than a quarter of the weight is in the frame. See :func:`gauss_newton`.
    """

def gauss_newton(window: Window, points: Points, how: Registration, theta: Float64, costs: Float64) -> None:
    """Register the listed points: minimise Σ w ρ(I(p + a(p)) − g R(p) − b) over theta = (a, g, b).

    In place. ρ has the weights (1 + (e / scale)²)⁻². It ends early when there is nothing left to gain. costs[0] and
    costs[1] receive the :func:`residual` at the start and at the end. With no steps that is all it does.
    """

def start_flow(near: Mask, grid: Grid, theta: Float64, camera: Pair, out: Float32) -> None:
    """Flow to start from, into out (h, w, 2): the affine motion where `near` is set, the camera's elsewhere."""

def predict_motion(
    window: Window, obj: Float32, outline: Outline, last: LastMotion, points: Points, out: Prediction
) -> tuple[float, float, Grid, tuple[int, int, int, int]]:
    """Outline of the object before this frame, and what motion to expect: what has to be known before the flow is.

    Parameters
    ----------
    window, obj
        Current image, and object layer.
    points
        Receives those of :func:`collect`.

    Returns
    -------
    Mean residual of the motion (0 if it is known); sum of the weights; grid of the object; (x0, y0, x1, y1) of all
    that may belong to it.
    """

def measure_motion(
    window: Window,
    previous: Float32,
    flow: Float32,
    odds: Float32,
    ground: Ground,
    predicted: Prediction,
    points: Points | None,
    how: Measuring,
) -> tuple[Theta, Theta]:
    """Motion of the camera and of the object in this frame, by the flow and by registration with both layers.

    Parameters
    ----------
    window, previous, flow
        This frame; `previous` is the last one, in gray.
    odds, predicted, points
        The object as :func:`predict_motion` has it. Without points only the camera's motion is measured.

    Returns
    -------
    Motion of the background to this frame, and that of the object since the last.
    """

def search_shift(
    window: Window,
    obj: Float32,
    shape: Float32,
    different: Mask,
    centre: tuple[int, int],
    reach: int,
    step: int,
    noise: float,
) -> tuple[float, float, int, int]:
    """Best translation of the object layer: Σ over its shape of [not background] (1 − min(|I − O| / (12 + 3σ), 2)).

    Shifts are `centre` ± `reach` in steps of `step` px; about four hundred pixels of {shape > ½} are looked at.
    Returns (score there, score at no shift, dx, dy), scores per pixel of the shape.
    """

def label(
    scene: Scene,
    expected: Expected,
    seen: Evidence,
    before: Mask | None,
    hiding: Mask | None,
    how: Labelling,
    labels: Labels,
) -> tuple[int, int, int, int, tuple[float, float, float, float]]:
    """Mask of the object from the evidence, and what is visible of it.

    Parameters
    ----------
    seen
        The ratio, its first plane, is changed where something is new.
    before, hiding
        Masks of the last frame's distractor, and of where it hides the object.

    Returns
    -------
    Pixels of the distractor; inside the frame pixels of the shape, of these in the mask, and of the mask; left, top,
    right and bottom of the mask, all 0 if it is empty.
    """

def learn(
    window: Window,
    aligned: Float32,
    expected: Expected,
    errors: Float32,
    labels: Labels,
    ground: Ground,
    how: Learning,
    memory: Memory,
) -> tuple[int, int, float]:
    """What is remembered after a frame: log-odds, object layer, slow shape, background, colours.

    Parameters
    ----------
    aligned
        This frame on the background's own lattice.
    errors
        Planes of the :class:`Evidence`.

    Returns
    -------
    Known pixels outside, of these unexplained, and the 85th percentile of |I − B| there, −1 if they are too few.
    """
