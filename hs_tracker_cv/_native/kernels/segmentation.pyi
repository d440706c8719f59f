"""The kernels of segmentation, what `_native/segmentation/bindings.cpp` binds.

Windows are (h, w) pixels: images (h, w, 3), planes (h, w), masks (h, w) of 0 and 1, all C-contiguous. `part` and
`inside` are (x0, y0, x1, y1) in window pixels, the second the part of the window inside the frame. An affine
motion is theta[0..5]: q = p + (t0 + t1 X + t2 Y, t3 + t4 X + t5 Y) with X = (x − cx) / scale, Y alike, `grid` being
(cx, cy, scale, area); theta[6] is a gain in percent, theta[7] a bias in gray levels.

Results are written into arrays that are given. Errors name the argument: TypeError for other elements, ValueError for
another shape or layout and for results that are read-only.
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

KNOWN: float
"""Samples after which a background pixel is known; until then it must stay as it is from frame to frame."""
FAR_OFF: float
"""Gray levels; where two images differ by more, it counts as this much."""
BINS: int
"""8 × 8 × 8 bins of BGR."""
POINT_ROWS: int
"""Rows of a list of points, see :func:`collect`."""

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

def move_object(
    dx: int,
    dy: int,
    odds: Float32,
    shape: Float32,
    obj: Float32,
    odds_out: Float32,
    shape_out: Float32,
    obj_out: Float32,
) -> None:
    """Copy what is known of the object into another window, see :func:`shift`."""

def move_ground(
    dx: int,
    dy: int,
    gain: float,
    picture: Float32,
    counts: Float32,
    image: Float32,
    odds: Float32,
    picture_out: Float32,
    counts_out: Float32,
) -> None:
    """Copy the background into another window, see :func:`shift`, and make it brighter by `gain`.

    Pixels that are new get the colour of `image`. They are taken as known, or as not yet seen where the object may be
    by its `odds`. `image` and `odds` are of the new window.
    """

def resample(image: Float32, inverse: Float64, repeat: bool, fill: float, out: Float32) -> None:
    """Write to `out` the image at (m0 x + m1 y + m2, m3 x + m4 y + m5), bilinear, m being `inverse`.

    Beyond the image its border is repeated, or else `fill`. OpenCV's own differs from version to version.
    """

def carry(
    previous: Float32,
    obj: Float32,
    odds: Float32,
    shape: Float32,
    counts: Float32,
    inverse: Float64,
    part: Rectangle,
    everywhere: bool,
    previous_out: Float32,
    obj_out: Float32,
    odds_out: Float32,
    shape_out: Float32,
    own_out: Mask,
) -> None:
    """Move what belongs to the object, in `part` of the window, as :func:`resample` does.

    Images repeat their border, the planes are −3 and 0 beyond theirs; outside `part` images are 0 and planes the same
    as beyond. `own_out` is 1 where the log-odds are positive. The last frame is moved only where the background is
    not yet known, unless `everywhere`.
    """

def evidence(
    image: Float32,
    background: Float32,
    moved: Float32,
    carried: Float32,
    obj: Float32,
    odds: Float32,
    counts: Float32,
    part: Rectangle,
    inside: Rectangle,
    likelihood: Float32,
    out: Float32,
    fresh: Mask,
) -> float:
    """Log-likelihood ratio, object against background, per pixel.

    Parameters
    ----------
    image, background, moved, carried, obj, odds, counts
        This frame, the background, the last frame moved by the camera and by the object's motion, object layer and
        log-odds moved by the object's motion, the background's counts (3, h, w).
    part
        Where the object layer has been moved; elsewhere nothing can be the object but what is new.
    likelihood
        (τ_b², τ_o², κ, contrast of the motions, occluded, noise, least and greatest gain of the background and of the
        object).
    out
        Receives (4, h, w): log-likelihood ratio, error against the background (any explanation), local gain of the
        background, error against the last frame where the background is not yet known.
    fresh
        Receives 1 where something new covers a background that was seen a moment ago.

    Returns
    -------
    Share of the object's pixels that look about as they did.
    """

def warp_and_score(
    previous: Float32,
    obj: Float32,
    odds: Float32,
    shape: Float32,
    inverse: Float64,
    everywhere: bool,
    image: Float32,
    background: Float32,
    moved: Float32,
    counts: Float32,
    part: Rectangle,
    inside: Rectangle,
    likelihood: Float32,
    previous_out: Float32,
    obj_out: Float32,
    odds_out: Float32,
    shape_out: Float32,
    own_out: Mask,
    out: Float32,
    fresh: Mask,
) -> float:
    """Move what belongs to the object to this frame, as :func:`carry` does, and weigh :func:`evidence` there."""

def collect(reference: Float32, weight: Float32, grid: Grid, stride: int, points: Float32) -> int:
    """List the pixels by which `reference` is registered: those of positive weight, every `stride`-th of a row.

    Rows of `points` (POINT_ROWS, N): x, y, X, Y, weight; then per channel the value and a quarter of the difference
    of the neighbours to the right and left, below and above. Returns how many there are, N at most.
    """

def residual(image: Float32, points: Float32, count: int, theta: Float64, ceiling: float, inside: Rectangle) -> float:
    """Mean of min(|I(p + a(p)) − g R(p) − b|, `ceiling`) over the listed points, each of its weight.

    It is 1e9 when less than a quarter of the weight is in the frame. See :func:`gauss_newton`.
    """

def gauss_newton(
    image: Float32,
    points: Float32,
    count: int,
    theta: Float64,
    prior: Float64,
    scale: float,
    ceiling: float,
    inside: Rectangle,
    costs: Float64,
    steps: int,
    stiffness: float,
) -> None:
    """Register the listed points in `image`: minimise Σ w ρ(I(p + a(p)) − g R(p) − b) over theta = (a, g, b).

    In place. `points` and `count` are from :func:`collect`. `stiffness` is what it costs, per unit of weight, to be
    more than translation, rotation and change of size. `prior` holds the diagonal ridge towards the start value, per
    unit of weight. ρ has the weights (1 + (e / scale)²)⁻². It ends early when there is nothing left to gain. costs[0]
    and costs[1] receive the :func:`residual` at the start and at the end. With no steps that is all it does.
    """

def start_flow(near: Mask, grid: Grid, theta: Float64, camera: Pair, out: Float32) -> None:
    """Flow to start from, into out (h, w, 2): the affine motion where `near` is set, the camera's elsewhere."""

def predict_motion(
    odds: Float32,
    shown: Mask | None,
    weighing: int,
    box: Grid,
    obj: Float32,
    image: Float32,
    inside: Rectangle,
    motion: tuple[float, float, float, float, float, float],
    camera: Pair,
    known: bool,
    near: Mask,
    weight: Float32,
    points: Float32,
    theta: Float64,
    flow: Float32,
) -> tuple[int, float, float, Grid, tuple[int, int, int, int]]:
    """Outline of the object before this frame, and what motion to expect: what has to be known before the flow is.

    Parameters
    ----------
    odds, shown, weighing
        What the object's pixels {odds > 0} weigh: 0 one, `shown` being None; 1 as `shown` says; 2 the odds, at most
        one, times `shown` / 255.
    box
        Grid to fall back on when there is no outline.
    obj, image
        Object layer and current image.
    motion, camera
        Velocity (2) and linear part (4) of the object and velocity of the camera in the last frame.
    known
        The object moves by its velocity, whatever the image says.
    near, weight, points
        Receive the mask, widened by two pixels, the weights and the points of :func:`collect`.
    theta, flow
        Receive the motion and the flow to start from.

    Returns
    -------
    Number of points; mean residual of the motion (0 if it is known); sum of the weights; grid of the object;
    (x0, y0, x1, y1) of all that may belong to it.
    """

def measure_motion(
    flow: Float32,
    image: Float32,
    previous: Float32,
    inside: Rectangle,
    near: Mask,
    camera: Pair,
    noise: float,
    background: Float32,
    counts: Float32,
    offset: Pair,
    ground_steps: int,
    odds: Float32,
    weight: Float32,
    grid: Grid,
    points: Float32,
    count: int,
    predicted: Float64,
    hidden: bool,
    young: bool,
    steps: int,
    ground: Float64,
    theta: Float64,
) -> None:
    """Motion of the camera and of the object in this frame, by the flow and by registration with both layers.

    Parameters
    ----------
    flow, image, previous
        This frame; `previous` is the last one, in gray.
    near, odds, weight, grid, points, count, predicted
        The object as :func:`predict_motion` has it. Without points only the camera's motion is measured.
    camera
        Velocity of the camera in the last frame.
    noise
        Gray levels.
    background, counts, offset
        The background and where it was in the last frame.
    ground_steps, steps
        Most steps of :func:`gauss_newton` for camera and object.
    hidden, young
        Something is in front of the object; its motion is still little known.
    ground, theta
        Receive the motion of the background to this frame, and that of the object since the last.
    """

def search_shift(
    image: Float32,
    obj: Float32,
    shape: Float32,
    different: Mask,
    centre: tuple[int, int],
    reach: int,
    step: int,
    inside: Rectangle,
    noise: float,
) -> tuple[float, float, int, int]:
    """Best translation of the object layer: Σ over its shape of [not background] (1 − min(|I − O| / (12 + 3σ), 2)).

    Shifts are `centre` ± `reach` in steps of `step` px; about four hundred pixels of {shape > ½} are looked at.
    Returns (score there, score at no shift, dx, dy), scores per pixel of the shape.
    """

def label(
    image: Float32,
    background: Float32,
    counts: Float32,
    odds: Float32,
    own: Mask,
    shape: Float32,
    evidence: Float32,
    fresh: Mask,
    before: Mask | None,
    hiding: Mask | None,
    emerging: bool,
    colours: Float32,
    colour_weight: float,
    noise: float,
    growth: int,
    young: bool,
    least: float,
    inside: Rectangle,
    bins: Bins,
    raw: Float32,
    odds_out: Float32,
    mask: Mask,
    foreign: Mask,
) -> tuple[int, int, int, int, float, float, float, float]:
    """Mask of the object from the evidence, and what is visible of it.

    Parameters
    ----------
    image, background, counts
        This frame, and the background with its counts.
    odds, own, shape
        The object's log-odds, {log-odds > 0} and slow shape where they are expected.
    evidence, fresh
        What :func:`evidence` wrote. The ratio, its first plane, is changed where something is new.
    before, hiding
        Masks of the last frame's distractor, and of where it hides the object.
    emerging
        The object may be coming out from behind something.
    colours, colour_weight
        Histograms of object and background, and how much they count.
    noise
        Gray levels.
    growth, young, least
        Px by which the object may grow (0: what is new says nothing), and whether its motion is too little known for
        that; share of the mask that must be left when its edge is cut.
    bins, raw, odds_out, mask, foreign
        Receive the bin of each colour, the log-odds as they come out of evidence and colour, the log-odds with all
        that is known of shape, the mask, and the distractor.

    Returns
    -------
    Pixels of the distractor; inside the frame pixels of the shape, of these in the mask, and of the mask; left, top,
    right and bottom of the mask, all 0 if it is empty.
    """

def learn(
    image: Float32,
    aligned: Float32,
    mask: Mask,
    own: Mask,
    foreign: Mask | None,
    odds: Float32,
    raw: Float32,
    warped: Float32,
    obj: Float32,
    shape: Float32,
    evidence: Float32,
    bins: Bins,
    background: Float32,
    counts: Float32,
    part: Rectangle,
    inside: Rectangle,
    shape_rate: float,
    freeze: bool,
    hidden: bool,
    colours: Float32,
    colour_rate: float,
    odds_out: Float32,
    obj_out: Float32,
    shape_out: Float32,
    background_out: Float32,
    counts_out: Float32,
    colours_out: Float32,
) -> tuple[int, int, float]:
    """What is remembered after a frame: log-odds, object layer, slow shape, background, colours.

    Parameters
    ----------
    image, aligned
        This frame, and the same on the background's own lattice.
    mask, own, foreign
        The object's mask, the same as it was expected, and the distractor's.
    odds, raw, bins
        What :func:`label` wrote.
    warped, obj, shape, part
        Log-odds, image and slow shape of the object as they were expected; where the object layer has been moved.
    evidence
        What :func:`evidence` wrote.
    background, counts
        The background: image, and (3, h, w) samples, mismatches and age.
    shape_rate, freeze, hidden
        How fast the shape is learned, or not at all; whether something is in front of the object.
    colours, colour_rate
        Histograms of object and background, and how fast they are learned.
    odds_out, obj_out, shape_out, background_out, counts_out, colours_out
        Receive log-odds, object layer, shape, background and histograms.

    Returns
    -------
    Known pixels outside, of these unexplained, and the 85th percentile of |I − B| there, −1 if they are too few.
    """
