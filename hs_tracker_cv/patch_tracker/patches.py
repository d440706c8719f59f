"""Patches of a frame as the patch tracker sees them: normalised gray, and the object's colours."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from .._native import kernels

__all__ = ["COLOURS", "GRAYS", "Place", "colours", "fine", "learned_colours", "likelihood"]

F32 = NDArray[np.float32]

GRAYS, COLOURS = 64, 4096
"""Bins of the histograms of a gray and of a colour video."""


class Place(NamedTuple):
    """Where a patch is sampled: its centre in pixel-index coordinates, the steps between samples (px), its turn."""

    x: float
    y: float
    step_x: float
    step_y: float
    angle: float


def fine(gray: F32, at: Place, inner: F32, templates: F32) -> tuple[F32, NDArray[np.float64]]:
    """Sample, smooth and normalise a patch, and compare it with others.

    Parameters
    ----------
    gray : ndarray, shape (H, W), float32
        Beyond it its border is repeated.
    at : Place
    inner : ndarray, shape (h, w), float32
        Weights of sum 1.
    templates : ndarray, shape (n, h, w), float32
        Of zero mean under the weights, as patches are.

    Returns
    -------
    patch : ndarray, shape (h, w), float32
        Of zero mean under the weights, deviation about 32.
    scores : ndarray, shape (n,), float64
        Correlation with each template under the weights.
    """
    patch, scores = np.empty(inner.shape, np.float32), np.empty(len(templates))
    kernels.patch(gray, at, inner, templates, patch, scores)
    return patch, scores


def colours(picture: F32, at: Place, shape: tuple[int, int]) -> F32:
    """Samples (C, h, w) of a picture (H, W, C), 0–255."""
    samples = np.empty((picture.shape[2], *shape), np.float32)
    kernels.sample(picture, at, samples)
    return samples


def likelihood(picture: F32, at: Place, histograms: F32, shape: tuple[int, int]) -> F32:
    """Likelihood of the object's colours round each sample.

    Parameters
    ----------
    picture : ndarray, shape (H, W, C), float32
        0–255; beyond it its border is repeated.
    at : Place
    histograms : ndarray, shape (2, bins), float32
        Shares of the bins of colour in the object and outside of it: `GRAYS`, or `COLOURS` of three channels.
    shape : tuple of int
        Samples down and across.

    Returns
    -------
    ndarray, shape (h, w), float32
        0–1.
    """
    found = np.empty(shape, np.float32)
    kernels.likelihood(picture, at, histograms, found)
    return found


def learned_colours(picture: F32, at: Place, histograms: F32, inside: NDArray[np.uint8], rate: float) -> F32:
    """Histograms with the colours of one more window mixed in.

    Parameters
    ----------
    picture, at, histograms
        As of :func:`likelihood`.
    inside : ndarray, shape (h, w), uint8
        1 where a sample is the object's.
    rate : float
        Share of this window.
    """
    learned = np.empty_like(histograms)
    kernels.learn_colours(picture, at, inside, rate, histograms, learned)
    return learned
