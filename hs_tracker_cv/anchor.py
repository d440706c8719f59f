"""What keeps a box carried by flow from drifting: keyframes, and a small correlation filter.

A correlation filter (D. S. Bolme and others, "Visual object tracking using adaptive correlation filters", CVPR
2010; several channels as in M. Danelljan and others, "Accurate scale estimation for robust visual tracking",
BMVC 2014) says *where* in a window the object's surroundings look as they were learned; it is blind to scale and
coarse. Keyframes are old patches of the object to which the dense flow registers the present one: that is exact,
but only where the two overlap. :mod:`~hs_tracker_cv.propagation` uses the one to find and the other to hold.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from . import patches

__all__ = ["CorrelationFilter", "features", "hann", "learn", "respond", "train"]

F32 = NDArray[np.float32]
C64 = NDArray[np.complex64]

_REGULARISATION = 1e-3
_EDGES = 3.0


@dataclass(frozen=True)
class CorrelationFilter:
    """A multi-channel correlation filter in the Fourier domain.

    Parameters
    ----------
    target : ndarray, shape (h, w // 2 + 1), complex64
        Transform of the wanted response: a Gaussian round zero displacement.
    numerator : ndarray, shape (C, h, w // 2 + 1), complex64
        Running mean of target × conjugate features.
    energy : ndarray, shape (h, w // 2 + 1), float32
        Running mean of the features' power, summed over the channels.
    """

    target: C64
    numerator: C64
    energy: F32

    @property
    def size(self) -> tuple[int, int]:
        """Height and width of the window, samples."""
        return self.target.shape[0], 2 * (self.target.shape[1] - 1)


def hann(height: int, width: int) -> F32:
    """Raised-cosine window (height, width) that fades to the border, without zero rows."""
    rows = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(height) + 0.5) / height)
    columns = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(width) + 0.5) / width)
    return np.outer(rows, columns).astype(np.float32)


def features(gray: F32, likelihood: F32 | None, window: F32) -> F32:
    """Channels of the filter: edges in four directions, log-gray, and the colour likelihood when there is one.

    Parameters
    ----------
    gray : ndarray, shape (2 h, 2 w), float32
        0–255, twice as fine as the filter.
    likelihood : ndarray, shape (h, w), float32, or None
        Share of the object's colour in each sample, 0–1.
    window : ndarray, shape (h, w), float32
        Fading weights.

    Returns
    -------
    ndarray, shape (C, h, w), float32
        C is 5 or 6; each channel of zero mean under the window and about unit variance.
    """
    out = np.empty((5 if likelihood is None else 6, *window.shape), np.float32)
    patches.orientations(gray, out[:4])
    out[:4] *= np.float32(_EDGES)
    rows = gray[::2] + gray[1::2]
    light = cv2.log((rows[:, ::2] + rows[:, 1::2]) * np.float32(0.25) + np.float32(8.0))
    mean, deviation = cv2.meanStdDev(light)
    out[4] = (light - mean[0, 0]) / (deviation[0, 0] + 0.05)
    if likelihood is not None:
        np.subtract(likelihood, np.float32(likelihood.mean()), out=out[5])
        out[5] *= np.float32(3.0)
    out *= window
    return out


def train(channels: F32, sigma: float) -> CorrelationFilter:
    """Learn a filter from one window.

    Parameters
    ----------
    channels : ndarray, shape (C, h, w), float32
        From :func:`features`; h and w even.
    sigma : float
        Width of the wanted response, samples.
    """
    height, width = channels.shape[1:]
    y = np.minimum(np.arange(height), height - np.arange(height))
    x = np.minimum(np.arange(width), width - np.arange(width))
    wanted = np.exp(-(y[:, None] ** 2 + x[None, :] ** 2) / (2.0 * sigma * sigma)).astype(np.float32)
    target = _transform(wanted)
    spectrum = _transform(channels)
    return CorrelationFilter(target, np.ascontiguousarray(target * spectrum.conj()), _power(spectrum))


def learn(old: CorrelationFilter, channels: F32, rate: float) -> CorrelationFilter:
    """Return the filter with one more window mixed in at `rate` (0–1)."""
    spectrum = _transform(channels)
    numerator, energy = np.empty_like(old.numerator), np.empty_like(old.energy)
    patches.mix(
        _parts(old.numerator), old.energy, _parts(old.target), _parts(spectrum), rate, _parts(numerator), energy
    )
    return replace(old, numerator=numerator, energy=energy)


def respond(filter_: CorrelationFilter, channels: F32) -> F32:
    """Response of the filter: about 1 at the object's displacement from the window's centre.

    Returns
    -------
    ndarray, shape (h, w), float32
        Zero displacement is at ``[h // 2, w // 2]``.
    """
    spectrum = _transform(channels)
    height, width = channels.shape[1:]
    floor, product = _REGULARISATION * channels.shape[0] * height * width, np.empty_like(filter_.target)
    patches.respond(_parts(filter_.numerator), _parts(spectrum), filter_.energy, floor, _parts(product))
    response = np.fft.irfft(np.fft.ifft(product, axis=0), n=width).astype(np.float32, copy=False)
    shifted = np.empty_like(response)
    down, across = height // 2, width // 2
    shifted[down:, across:], shifted[down:, :across] = response[:-down, :-across], response[:-down, -across:]
    shifted[:down, across:], shifted[:down, :across] = response[-down:, :-across], response[-down:, -across:]
    return shifted


def _transform(plane: F32) -> C64:
    # rfft2 is these two, after a search for what its arguments mean.
    return np.ascontiguousarray(np.fft.fft(np.fft.rfft(plane), axis=-2), np.complex64)


def _parts(spectrum: C64) -> F32:
    """Real and imaginary parts in turn."""
    return spectrum.view(np.float32)


def _power(spectrum: C64) -> F32:
    power: F32 = (spectrum.real**2 + spectrum.imag**2).sum(axis=0)
    return power
