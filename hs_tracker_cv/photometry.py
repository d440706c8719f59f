"""What a change of light alone makes of a frame: mains flicker, exposure, white balance, rolling bands, a vignette.

The next frame is predicted from the one before by one robust linear fit. Its terms are the colour channels, an offset
and a curve, which are an exposure and a white balance, and gains that vary slowly over the frame, along the rows more
finely: a rolling shutter gives every row a moment of its own. What moves is an outlier of that fit.
"""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["NORMAL_SIGMA", "relit", "structure_changed"]

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

NORMAL_SIGMA = 1.4826
"""Standard deviation over median absolute deviation, of a normal distribution."""

_ACROSS = 56  # samples along the longer side
_BANDS = 16  # cosines along the height
_ROUNDS = 6  # of reweighting
_RIDGE = 1e-3  # of the mean square of a regressor, which keeps terms down that a plain frame does not determine
_WHITE = 250.0  # gray level from which a sensor may have been saturated
_GAINS = (0.6, 1.6)  # local gains that light may have
_EXPLAINED = 0.25  # share of the change that light may leave
_LEAST_SPREAD = 0.2  # gray levels: standard deviation of the rest of the fit, at least
_OUTLIER = 2.0  # of these standard deviations, at which a sample counts a quarter


def relit(before: Plane, gray: Plane, valid: Mask | None = None) -> tuple[Plane, Plane]:
    """Predict a frame from the one before it, as if only the light had changed.

    Parameters
    ----------
    before : ndarray, shape (H, W, C), float32
        Earlier frame, 0–255, C = 1 or 3.
    gray : ndarray, shape (H, W), float32
        Later frame.
    valid : ndarray of bool, shape (H, W), optional
        Pixels that `before` knows.

    Returns
    -------
    predicted : ndarray, shape (H, W), float32
    change : ndarray, shape (H, W), float32
        Later frame minus predicted; 0 where the earlier one was saturated and the later one is brighter still.
    """
    height, width = gray.shape
    ratio = min(_ACROSS / max(height, width), 1.0)
    size = max(round(width * ratio), 1), max(round(height * ratio), 1)
    small = np.asarray(cv2.resize(before, size, interpolation=cv2.INTER_AREA), np.float32)
    small = small.reshape(size[1], size[0], -1)
    target = cv2.resize(gray, size, interpolation=cv2.INTER_AREA)
    usable = (_brightest(small) < _WHITE) & (target < _WHITE)
    if valid is not None:
        usable &= cv2.resize(valid.astype(np.float32), size, interpolation=cv2.INTER_AREA) > 0.99
    terms = _terms(small, _fields(*size))
    weights = _fit(terms[usable], target[usable].astype(np.float64))
    predicted = _apply(before, weights)
    change = gray - predicted
    change[(_brightest(before) >= _WHITE) & (change > 0)] = 0.0
    return predicted, change


def _brightest(image: Plane) -> Plane:
    """Largest channel of each pixel."""
    if image.shape[2] == 1:
        return image[:, :, 0]
    blue, green, red = cv2.split(image)
    return np.asarray(cv2.max(cv2.max(blue, green), red), np.float32)


@lru_cache(maxsize=8)
def _fields(width: int, height: int) -> NDArray[np.float32]:
    """Slow gains, shape (height, width, K): along a row linear and quadratic, along a column cosines."""
    x = np.linspace(-1.0, 1.0, width, dtype=np.float32)[None, :]
    y = (np.arange(height, dtype=np.float32)[:, None] + 0.5) / height
    rows = [np.broadcast_to(np.cos(np.pi * k * y), (height, width)) for k in range(1, _BANDS + 1)]
    columns = [np.broadcast_to(field, (height, width)) for field in (x, x * x - 1 / 3)]
    return np.stack([*rows, *columns, x * (2 * y - 1)], axis=2)


def _terms(before: Plane, fields: NDArray[np.float32]) -> NDArray[np.float64]:
    """Regressors, shape (H, W, N): the channels, one, a curve, and the mean channel times each field."""
    mean = before.mean(axis=2, keepdims=True)
    curve = mean * (1.0 - mean / 255.0)
    return np.concatenate([before, np.full_like(mean, 255.0), curve, mean * fields], axis=2).astype(np.float64)


def _fit(terms: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weights of the regressors, reweighted so that what light does not explain does not count."""
    count = terms.shape[1]
    prior = np.zeros(count)
    channels = count - _BANDS - 5
    prior[:channels] = (0.114, 0.587, 0.299) if channels == 3 else (1.0,)
    if len(target) < 2 * count:
        return prior
    ridge = _RIDGE * float((terms**2).mean()) * len(target) * np.eye(count)
    left = target - terms @ prior
    weights = np.ones(len(target))
    change = np.zeros(count)
    for _ in range(_ROUNDS):
        weighted = terms * weights[:, None]
        change = np.linalg.solve(weighted.T @ terms + ridge * weights.mean(), weighted.T @ left)
        rest = left - terms @ change
        spread = max(NORMAL_SIGMA * float(np.median(np.abs(rest))), _LEAST_SPREAD)
        weights = 1.0 / (1.0 + (rest / (_OUTLIER * spread)) ** 2) ** 2
    return prior + change


def _apply(before: Plane, weights: NDArray[np.float64]) -> Plane:
    height, width, channels = before.shape
    mean = cv2.transform(before, np.full((1, channels), 1.0 / channels, np.float32)).reshape(height, width)
    direct = np.concatenate([weights[:channels], [255.0 * weights[channels]]]).astype(np.float32)[None, :]
    plain = cv2.transform(before, direct).reshape(height, width)
    rows, columns = weights[channels + 2 : channels + 2 + _BANDS], weights[channels + 2 + _BANDS :]
    y = (np.arange(height) + 0.5) / height
    x = np.linspace(-1.0, 1.0, width)
    along = np.cos(np.pi * y[:, None] * np.arange(1, _BANDS + 1)) @ rows
    across = columns[0] * x + columns[1] * (x * x - 1 / 3)
    gain = (along[:, None] + across[None, :] + columns[2] * np.outer(2 * y - 1, x)).astype(np.float32)
    curve = np.float32(weights[channels + 1])
    predicted = plain + mean * (gain + curve - mean * (curve / np.float32(255.0)))
    return np.asarray(np.clip(predicted, 0.0, 255.0, out=predicted), np.float32)


def structure_changed(predicted: Plane, gray: Plane, side: int = 9) -> Mask:
    """Where the change is not a gain and an offset of the light nearby, as of a glow, a shadow or a lamp of its own.

    Parameters
    ----------
    predicted, gray : ndarray, shape (H, W), float32
    side : int
        Of the window in which gain and offset are one, px.

    Returns
    -------
    ndarray of bool, shape (H, W)
    """

    def mean(values: NDArray[np.float32]) -> NDArray[np.float32]:
        return np.asarray(cv2.blur(values, (side, side)), np.float32)

    x, y = mean(predicted), mean(gray)
    xx, yy, xy = mean(predicted * predicted), mean(gray * gray), mean(predicted * gray)
    energy = xx + yy - 2 * xy
    var_x, var_y, cov = xx - x * x, yy - y * y, xy - x * y
    gain = np.clip(cov / np.maximum(var_x, 1e-3), *_GAINS)
    left = var_y - 2 * gain * cov + gain * gain * var_x
    return np.asarray(left > _EXPLAINED * energy, bool)
