"""What keeps a box carried by flow from drifting: keyframes, and a small correlation filter.

A correlation filter (D. S. Bolme and others, "Visual object tracking using adaptive correlation filters", CVPR
2010; several channels as in M. Danelljan and others, "Accurate scale estimation for robust visual tracking",
BMVC 2014) says *where* in a window the object's surroundings look as they were learned; it is blind to scale and
coarse. Keyframes are old patches of the object to which the dense flow registers the present one: that is exact,
but only where the two overlap. :mod:`~hs_tracker_cv.propagation` uses the one to find and the other to hold.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .compiling import kernel
from .validation import Shape, Within

__all__ = ["CorrelationFilter", "Fade", "Peak", "correlation", "find_peak", "hann", "learn", "respond", "train"]

F32 = NDArray[np.float32]
C64 = NDArray[np.complex64]
Row = Annotated[NDArray[np.float32], 1]
Plane = Annotated[NDArray[np.float32], 2]

_REGULARISATION = 1e-3


class CorrelationFilter(NamedTuple):
    """A multi-channel correlation filter in the Fourier domain.

    Parameters
    ----------
    target : ndarray, shape (h, w // 2 + 1), complex64
        Transform of the wanted response: a Gaussian round the middle, ``[h // 2, w // 2]``.
    numerator : ndarray, shape (C, h, w // 2 + 1), complex64
        Running mean of target × conjugate features.
    energy : ndarray, shape (h, w // 2 + 1), float32
        Running mean of the features' power, summed over the channels.
    """

    target: Annotated[C64, Shape("coarse h", "coarse w/2+1")]
    numerator: Annotated[C64, Shape("features", "coarse h", "coarse w/2+1")]
    energy: Annotated[F32, Shape("coarse h", "coarse w/2+1"), Within(0.0, np.inf)]

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the window, samples."""
        return self.target.shape[0], 2 * (self.target.shape[1] - 1)


def hann(height: int, width: int) -> F32:
    """Raised-cosine window (height, width) that fades to the border, without zero rows."""
    rows = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(height) + 0.5) / height)
    columns = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(width) + 0.5) / width)
    return np.outer(rows, columns).astype(np.float32)


def train(channels: F32, sigma: float) -> CorrelationFilter:
    """Learn a filter from one window.

    Parameters
    ----------
    channels : ndarray, shape (C, h, w), float32
        From :func:`.patches.sight`; h and w even.
    sigma : float
        Width of the wanted response, samples.
    """
    height, width = channels.shape[1:]
    y, x = np.arange(height) - height // 2, np.arange(width) - width // 2
    wanted = np.exp(-(y[:, None] ** 2 + x[None, :] ** 2) / (2.0 * sigma * sigma)).astype(np.float32)
    target = _transform(wanted)
    spectrum = _transform(channels)
    energy = (spectrum.real**2 + spectrum.imag**2).sum(axis=0)
    return CorrelationFilter(target, target * spectrum.conj(), energy)


def learn(old: CorrelationFilter, channels: F32, rate: float) -> CorrelationFilter:
    """Return the filter with one more window mixed in at `rate` (0–1)."""
    numerator, energy = np.empty_like(old.numerator), np.empty_like(old.energy)
    spectrum = _parts(_transform(channels))
    _mix(
        _parts(old.target).ravel(), spectrum, rate, _parts(old.numerator), old.energy.ravel(), _parts(numerator),
        energy.ravel(),
    )  # fmt: skip
    return CorrelationFilter(old.target, numerator, energy)


def respond(filter_: CorrelationFilter, channels: F32) -> F32:
    """Response of the filter: about 1 at the object's displacement from the window's centre.

    Returns
    -------
    ndarray, shape (h, w), float32
        Zero displacement is at ``[h // 2, w // 2]``.
    """
    count, height, width = channels.shape
    spectrum = _transform(channels)
    spectrum *= filter_.numerator
    product = spectrum.sum(axis=0)
    product /= filter_.energy + np.float32(_REGULARISATION * count * height * width)
    return np.ascontiguousarray(np.fft.irfft(np.fft.ifft(product, axis=0), n=width), np.float32)


class Fade(NamedTuple):
    """A penalty on distance: `weight` times the square of a distance from a point, per axis in units of its own.

    Parameters
    ----------
    weight : float
    right, down : float
        Where the response's centre is, seen from the point, units.
    across, along : float
        Units per sample to the right and downwards.
    """

    weight: float
    right: float
    down: float
    across: float
    along: float


class Peak(NamedTuple):
    """Highest point of a response, with sub-sample displacement (dx, dy) from the centre, samples.

    `height` is the response there less the fade, `response` that of the nearest sample.
    """

    dx: float
    dy: float
    height: float
    response: float


NO_FADE = Fade(0.0, 0.0, 0.0, 0.0, 0.0)


def find_peak(response: F32, fade: Fade = NO_FADE) -> Peak:
    """Highest point of a response less a fade; zero displacement is at ``[h // 2, w // 2]``; parabolic sub-sample."""
    score = np.empty_like(response)
    y, x = divmod(_fade(response, *fade, score), score.shape[1])
    height, width = score.shape
    dx, dy, top = float(x - width // 2), float(y - height // 2), score.item(y, x)
    if 0 < x < width - 1:
        dx += _vertex(score.item(y, x - 1), top, score.item(y, x + 1))
    if 0 < y < height - 1:
        dy += _vertex(score.item(y - 1, x), top, score.item(y + 1, x))
    return Peak(dx, dy, top, response.item(y, x))


def correlation(a: F32, b: F32, weights: F32) -> float:
    """Weighted normalised cross-correlation of two patches, −1 to 1."""
    total = float(weights.sum())
    a = a - np.float32(float(np.vdot(weights, a)) / total)
    b = b - np.float32(float(np.vdot(weights, b)) / total)
    weighted = weights * a
    power = float(np.vdot(weighted, a)) * float(np.vdot(weights * b, b))
    return float(np.vdot(weighted, b)) / math.sqrt(power + 1e-6)


def _transform(plane: F32) -> C64:
    # rfft2 is these two, after a search for what its arguments mean.
    return np.ascontiguousarray(np.fft.fft(np.fft.rfft(plane), axis=-2), np.complex64)


def _parts(spectrum: C64) -> F32:
    """Real and imaginary parts of each plane in turn, (C, 2 h w), of the same memory."""
    return spectrum.view(np.float32).reshape(len(spectrum), -1)


@kernel()
def _mix(
    target: Row, spectrum: Plane, rate: float, old: Plane, old_energy: Row, numerator: Plane, energy: Row
) -> None:
    """Mix a window's ``target * conj(spectrum)`` and power into numerator and energy."""
    count = spectrum.shape[0]
    keep, share = np.float32(1.0 - rate), np.float32(rate)
    for i in range(energy.shape[0]):
        a, b = share * target[2 * i], share * target[2 * i + 1]
        power = np.float32(0.0)
        for k in range(count):
            x, y = spectrum[k, 2 * i], spectrum[k, 2 * i + 1]
            numerator[k, 2 * i] = keep * old[k, 2 * i] + (a * x + b * y)
            numerator[k, 2 * i + 1] = keep * old[k, 2 * i + 1] + (b * x - a * y)
            power += x * x + y * y
        energy[i] = keep * old_energy[i] + share * power


@kernel()
def _fade(
    response: Plane, weight: float, right: float, down: float, across: float, along: float, score: Plane
) -> int:
    """Write the response less the fade; return the index of the highest value."""
    rows, columns = response.shape
    best, height = 0, -np.inf
    for i in range(rows):
        y = down + (i - rows // 2) * along
        for j in range(columns):
            x = right + (j - columns // 2) * across
            value = response[i, j] - weight * (x * x + y * y)
            score[i, j] = value
            if value > height:
                best, height = i * columns + j, value
    return best


def _vertex(left: float, middle: float, right: float) -> float:
    curve = left - 2.0 * middle + right
    return 0.0 if curve >= 0.0 else min(max(0.5 * (left - right) / curve, -0.5), 0.5)
