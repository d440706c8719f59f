"""What module.cpp binds.

Images are arrays (height, width), flows (height, width, 2), C-contiguous, of float32. Errors name the argument:
TypeError for another type, ValueError for another shape, layout or size and for results that are read-only.
"""

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
Taps = tuple[float, float, float]
"""Weights of a symmetric blur: of the centre, the neighbours and the next ones; (1, 0, 0) is none."""
Place = tuple[float, float, float, float, float]
"""Where a window is sampled: (x, y, step_x, step_y, angle), its centre in pixel-index coordinates, the distances of
samples (px), its turn in radians from x towards y."""

def level() -> str:
    """Name of the instruction set that kernels use: "v2", "v3" or "v4" (of x86-64), or "plain"."""

def levels() -> list[str]:
    """Names of those that this processor can run, the most capable last."""

def use_level(name: str) -> None:
    """Use another one from now on, in all threads; results are the same bits.

    Raises
    ------
    ValueError
        If it is not one of :func:`levels`.
    """

def overview(samples: NDArray[np.uint8] | Float32, thinned: int, out: Float32) -> None:
    """Means of the samples (H, W, C) of a frame over cells, and the deviation within each, into (2, rows, columns).

    The deviation is that of the first channel, of one sample in `thinned` across and down.
    """

def median_of(plane: Float32) -> float:
    """Median of all numbers, as NumPy has it."""

def deviation_of(plane: Float32) -> float:
    """Standard deviation of all numbers."""

class Planes:
    """So many images (height, width) of float32 in one piece of memory, laid out for the kernels.

    Raises
    ------
    ValueError
        If one of the numbers is less than 1.
    """

    def __init__(self, count: int, height: int, width: int) -> None: ...
    def resize(self, count: int, height: int, width: int) -> None:
        """Make it so many of another size, with undefined content; memory that is large enough is kept."""

    def __len__(self) -> int: ...
    def __getitem__(self, plane: int) -> Float32:
        """One image; the array shares memory with it until the planes are resized."""

def derivatives(frame0: Float32, frame1: Float32, five_tap: bool, planes: Planes) -> None:
    """F_x, F_y and F_t of two images into the first three of five planes."""

def classic(
    frame0: Float32,
    frame1: Float32,
    flow: Float32,
    started: bool,
    five_tap: bool,
    smoothness: float,
    sweeps: int,
    planes: Planes,
) -> None:
    """Sweep so often, from the first guess in `flow` if `started`, else from zero, into `flow`. Seven planes."""

class Multigrid:
    """The paper's linear system on grids of halved sizes: the parts of its solution, in their order.

    What `begin` and `sweep` return are 2-norms over λ²: of the right-hand side, and of the residual before the last
    sweep.
    """

    def __init__(self, height: int, width: int) -> None: ...
    def sizes(self) -> list[tuple[int, int]]:
        """Sizes (height, width) of the grids, the finest first."""

    def begin(self, frame0: Float32, frame1: Float32, five_tap: bool, smoothness: float) -> float:
        """Make the systems of all grids."""

    def guess(self, flow: Float32) -> None:
        """Take a first guess."""

    def full(self) -> None:
        """Make a first guess by full multigrid."""

    def sweep(self, count: int, relax: float, quarter_square: float) -> float:
        """Sweep the finest grid an even number of times, see :func:`~hs_tracker_cv.flow.sweeps.chebyshev`."""

    def correct(self) -> None:
        """Correct the flow by a V cycle of the coarse grids."""

    def store(self, flow: Float32) -> None:
        """Copy the flow into an array."""

def load_frames(
    frame0: Float32, frame1: Float32, guess: Float32 | None, blur: Taps, frames: Planes, scratch: Planes
) -> None:
    """Blur two images into two planes, and copy a first guess into two more; what is not finite becomes 0."""

def reduce_frames(fine: Planes, blur: Taps, out: Planes) -> None:
    """Make the frames of a coarser level, and its first guess, from those of the next finer one."""

def begin_flow(frames: Planes, flow: Planes) -> None:
    """Begin the coarsest level: with its first guess if it has one, else with zero."""

def expand_flow(coarse_frames: Planes, coarse_flow: Planes, frames: Planes, flow: Planes) -> None:
    """Begin another level with the flow of the next coarser one; of a first guess only the increment passes."""

class Refinement:
    """How the flow of a level is refined, see :func:`refine`. `outlier` is the weight of F_t² against a data term."""

    def __init__(
        self,
        *,
        smoothness: float,
        five_tap: bool,
        warps: int,
        sweeps: int,
        median: int,
        outlier: float,
        relax: float,
        quarter_square: float,
        exposure: bool,
    ) -> None: ...

def refine(
    frames: Planes, flow: Planes, how: Refinement, exposure: tuple[float, float] | None, scratch: Planes
) -> tuple[float, float]:
    """Warp the second frame, linearise, sweep and take the median, as often as asked for. Seven planes of scratch.

    `exposure` is how the second frame's brightness differs as coarser levels have found it, (gain, offset): by gain
    times the mean of both frames and offset. None lets this level find it; what is returned is for the next one.
    """

def warp(frames: Planes, flow: Planes, out: Planes) -> None:
    """Sample the second frame at (x + u, y + v), bicubic, into `out[0]`; `out[1]` is 1 where that is inside."""

def median(flow: Planes, out: Planes, side: int) -> None:
    """Median over 3 × 3 or 5 × 5 pixels of each plane."""

def store_flow(flow: Planes, out: Float32) -> None:
    """Copy two planes into an array."""

def describe(
    picture: Float32,
    at: Place,
    fade: Float32,
    names: Float32 | None,
    features: Float32,
    grays: Float32,
) -> None:
    """Write what the finder sees in a window of 40 × 40 cells of 4 × 4 samples.

    Parameters
    ----------
    picture : ndarray, shape (H, W, 1 or 3), float32
        0–255, BGR. Beyond it its border is repeated.
    at : tuple of float
    fade : ndarray, shape (40, 40), float32
    names : ndarray, shape (32 ** channels, 9), float32, or None
        What the colours are called.
    features : ndarray, shape (40, 40, 16 or, with names, 24), float32
        Written: nine directions of edges, four sums of them, gray, names, zeros; each times `fade`.
    grays : ndarray, shape (40, 40), float32
        Written: mean gray of each cell.
    """

def shade(picture: Float32, at: Place, grays: Float32) -> None:
    """Write the mean gray of each cell only, as :func:`describe` does."""

def transform(features: Float32, spectrum: Float32) -> None:
    """Write the spectrum (40, 21, 2, C) of each channel (40, 40, C): the parts of its ``rfft2``, real ones first."""

class FilterLearning:
    """How a filter is learned, see finder.cpp.

    Raises
    ------
    ValueError
        Unless memory >= 0, coupling > 0, growth >= 1 and rounds >= 1.
    """

    def __init__(self, *, memory: float, coupling: float, growth: float, rounds: int) -> None: ...

def adapt(
    spectrum: Float32, target: Float32, penalty: Float32, old: Float32 | None, how: FilterLearning, learned: Float32
) -> None:
    """Write the filter after one more window; see finder.cpp.

    Parameters
    ----------
    spectrum : ndarray, shape (40, 21, 2, C), float32
    target : ndarray, shape (40, 21), float32
        Spectrum of the wanted response, which must be real: that of a symmetric one.
    penalty : ndarray, shape (40, 40), float32
    old : ndarray like `spectrum`, or None
        The filter before; None for the first window.
    how : FilterLearning
    learned : ndarray like `spectrum`
    """

def respond(
    learned: Float32,
    witness: Float32,
    spectrum: Float32,
    fade: tuple[float, float, float, float, float],
    response: Float32,
) -> tuple[float, float, float, float, float, float, float, float]:
    """Write the response of a filter, no displacement at [20, 20], and find its peak between the samples.

    Parameters
    ----------
    learned, witness, spectrum : ndarray, shape (40, 21, 2, C), float32
    fade : tuple of float
        The penalty on distance: (weight, right, down, across, along).
    response : ndarray, shape (40, 40), float32

    Returns
    -------
    tuple of float
        Displacement (x, y; cells), height, height less the penalty; highest point, mean and deviation of what
        is more than 4 cells away; the witness's response at the peak.
    """

def sample(picture: Float32, at: Place, samples: Float32) -> None:
    """Write samples of a picture: each is the mean of up to 4 × 4 bilinear reads spread over a step.

    Parameters
    ----------
    picture : ndarray, shape (H, W, 1 or 3), float32
        0–255, BGR, at least 2 × 2 pixels. Beyond it its border is repeated.
    at : tuple of float
    samples : ndarray, shape (channels, h, w), float32
        Written.
    """

def patch(
    gray: Float32,
    at: Place,
    weights: Float32,
    templates: Float32,
    patch: Float32,
    scores: Float64,
) -> None:
    """Write a patch of mean 0 and deviation about 32 under weights, and its correlation with others.

    Parameters
    ----------
    gray : ndarray, shape (H, W), float32
        0–255, at least 2 × 2 pixels.
    at : tuple of float
    weights : ndarray, shape (h, w), float32
        Of sum 1.
    templates : ndarray, shape (n, h, w), float32
        Of mean 0 under the weights.
    patch : ndarray, shape (h, w), float32
        Written. Smoothed by a Gaussian of 0.7 samples, unless it is turned.
    scores : ndarray, shape (n,), float64
        Written: −1 to 1.
    """

def likelihood(
    picture: Float32,
    at: Place,
    histograms: Float32,
    likelihood: Float32,
) -> None:
    """Write the share inside / (inside + outside) of each sample's colour, 0–1, the mean over 3 × 3 samples.

    Parameters
    ----------
    picture, at
        As of :func:`sample`.
    histograms : ndarray, shape (2, 64 or, of three channels, 16 ** 3), float32
        Shares of the bins inside and outside.
    likelihood : ndarray, shape (h, w), float32
        Written; at least 2 × 2.
    """

def learn_colours(
    picture: Float32,
    at: Place,
    inside: NDArray[np.uint8],
    rate: float,
    old: Float32,
    learned: Float32,
) -> None:
    """Write histograms with the colours of a window mixed in.

    Parameters
    ----------
    picture, at
        As of :func:`sample`.
    inside : ndarray, shape (h, w), uint8
        0 outside.
    rate : float
        Share of this window.
    old, learned : ndarray, shape (2, bins), float32
        As of :func:`likelihood`.
    """

class FitPriors:
    """What is known before the object's motion is fitted to the flow.

    Parameters
    ----------
    prior, outside : ndarray, shape (H, W), float32
        Prior weights of the object and of its surroundings, not negative; at least 2 × 2.
    likelihood : ndarray, shape (h, w), float32, or None
        Of the object's colours, as a further prior weight, on a lattice of the same centre; at least 2 × 2.
    ratio : float
        Samples of that lattice per sample of the patch.
    """

    def __init__(self, prior: Float32, outside: Float32, likelihood: Float32 | None, ratio: float) -> None: ...

def fit_motion(
    first: Float32,
    second: Float32,
    flow: Float32,
    priors: FitPriors,
    rotation: bool,
    separation: float,
    planes: Float32,
) -> tuple[float, float, float, float, bool]:
    """Fit the object's motion to the flow, and again without the pixels that move with the surroundings.

    Pixels count that are textured, and explained by the flow; outliers hardly do. See motion_fit.cpp.

    Parameters
    ----------
    first, second : ndarray, shape (H, W), float32
        Normalised patches.
    flow : ndarray, shape (H, W, 2), float32
        From the first to the second, samples.
    priors : FitPriors
    rotation : bool
        Or it is left at 0.
    separation : float
        Samples from which the two motions are told apart; less than 0: they never are.
    planes : ndarray, shape (3, H, W), float32
        Written: weights of the object's first fit; share of "moves with the object" per pixel, 1 where the two are
        not told apart; prior weights, colours included.

    Returns
    -------
    right, down, growth, turn : float
        Translation, samples; growth; rotation, radians from x towards y; all from the patch's centre.
    apart : bool
        Object and surroundings were told apart.
    """

class KnownBefore:
    """What is known of the frame before.

    Parameters
    ----------
    persistence, body : ndarray, shape (h / 2, w / 2), float32
        What was kept, at least 2 × 2; the object's pixels.
    previous : ndarray, shape (h, w), float32
        Patch in the frame before.
    means : ndarray, shape (4, h, w), float32
        Mean patch; mean absolute deviation from it; share of "moves with the object"; prior weight of each pixel in
        the fit of the flow, which follows from the last two.
    weights : ndarray, shape (h, w), float32
        Prior weights by place.
    """

    def __init__(
        self, persistence: Float32, body: Float32, previous: Float32, means: Float32, weights: Float32
    ) -> None: ...

class Passage:
    """What the flow says.

    Parameters
    ----------
    planes : ndarray, shape (3, h, w), float32
        From :func:`fit_motion`.
    flow : ndarray, shape (h, w, 2), float32
        Into the patch from which the result's place is measured, samples.
    patch : ndarray, shape (h, w), float32
        Where the result is wanted.
    way : tuple of float
        (right, down, cosine, sine): the result's centre, from that patch's centre in samples of `persistence`, and
        its turn and zoom.
    """

    def __init__(
        self, planes: Float32, flow: Float32, patch: Float32, way: tuple[float, float, float, float]
    ) -> None: ...

class PersistenceRates:
    """How persistence goes on.

    Parameters
    ----------
    same, changed : float
        Difference of gray levels up to which a pixel is the same, and from which it is another; the second is larger.
    rate : float
        Share of what looks as it was learned that counts as the object's again.
    mean_rate, mask_rate : float
        Share of this frame in patch and deviation, and in "moves with the object".
    floor : float
        Weight of a pixel that never moved with the object.
    """

    def __init__(
        self, *, same: float, changed: float, rate: float, mean_rate: float, mask_rate: float, floor: float
    ) -> None: ...

def update_persistence(
    before: KnownBefore, passage: Passage, how: PersistenceRates, out: Float32, learned: Float32
) -> None:
    """Move what is kept with the flow, drop what changed or moves with the surroundings; learn the patch.

    Parameters
    ----------
    before : KnownBefore
    passage : Passage
    how : PersistenceRates
    out : ndarray, shape (h / 2, w / 2), float32
        Written: what is kept.
    learned : ndarray, shape (4, h, w), float32
        Written: the new means.
    """
