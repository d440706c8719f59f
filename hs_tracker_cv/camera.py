"""How the camera has moved between two frames: shift, turn and zoom of the whole picture."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["STILL", "Affine", "camera_flow", "camera_motion", "carried"]

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]
Affine = NDArray[np.float64]

STILL: Affine = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Motion of a camera that stands; :func:`camera_motion` answers with this very array."""

_CORNERS = 200  # most that are followed
_QUALITY, _APART = 0.02, 7.0  # least quality of a corner, as a share of the best one's; px between two
_RETURNED = 0.5  # px from itself at which a corner may end that is followed there and back
_LOCAL = 8.0  # σ, px, of the surroundings that local contrast is taken against
_PLAIN = 4.0  # gray levels added to the deviation there: a plain ground is not blown up to noise
_CONTRAST = 40.0  # gray levels that such a deviation becomes
_FEWEST = 12  # corners below which a motion of the whole picture is a guess
_AGREE = 0.5  # share of them that must move together
_SPREAD = 0.15  # standard deviation of their places, of a side of the frame: else it is one thing that has moved
_REST = 0.08  # px: less than this, anywhere in the frame, is a camera that stands
_NEAR = 0.6  # px from where the common motion takes a corner


def camera_motion(before: Plane, after: Plane) -> Affine | None:
    """Motion of most of the picture.

    Parameters
    ----------
    before, after : ndarray, shape (H, W), float32
        Two frames, 0–255.

    Returns
    -------
    ndarray, shape (2, 3), or None
        Affine map from pixels of `before` to those of `after`; `STILL` where the camera stands, or where there is no
        texture all over the frame to tell; None where most of the picture does not move as one.
    """
    first, second = _levelled(before), _levelled(after)
    corners = cv2.goodFeaturesToTrack(first, _CORNERS, _QUALITY, _APART)
    if corners is None or len(corners) < _FEWEST:
        return STILL
    guess: Any = None
    there, found, _ = cv2.calcOpticalFlowPyrLK(first, second, corners, guess, winSize=(15, 15), maxLevel=3)
    back, returned, _ = cv2.calcOpticalFlowPyrLK(second, first, there, guess, winSize=(15, 15), maxLevel=3)
    sure = (found.ravel() > 0) & (returned.ravel() > 0)
    sure &= np.hypot(*(back - corners).reshape(-1, 2).T) < _RETURNED
    if sure.sum() < max(_FEWEST, _AGREE * len(corners)):
        return None
    matrix, inliers = cv2.estimateAffinePartial2D(
        corners[sure], there[sure], method=cv2.RANSAC, ransacReprojThreshold=_NEAR, maxIters=500
    )
    if matrix is None or inliers.sum() < _AGREE * len(corners):
        return None
    height, width = before.shape
    moved = corners[sure][inliers.ravel() > 0].reshape(-1, 2)
    if (moved.std(axis=0) < _SPREAD * np.array([width, height])).any():
        return STILL
    rim = np.array([(0, 0, 1), (width, 0, 1), (0, height, 1), (width, height, 1)], np.float64)
    if np.abs(rim @ matrix.T - rim[:, :2]).max() < _REST:
        return STILL
    return np.asarray(matrix, np.float64)


def _levelled(plane: Plane) -> NDArray[np.uint8]:
    """Local contrast alone, as 8 bit: what the light has done to the frame is gone."""
    mean = cv2.GaussianBlur(plane, (0, 0), _LOCAL)
    deviation = plane - mean
    spread = cv2.GaussianBlur(deviation * deviation, (0, 0), _LOCAL)
    cv2.sqrt(spread, spread)
    return np.asarray(cv2.convertScaleAbs(deviation / (spread + _PLAIN) * _CONTRAST + 128.0), np.uint8)


def carried(image: Plane, motion: Affine) -> tuple[Plane, Mask]:
    """A frame carried along the camera's motion, and which pixels of it are known."""
    height, width = image.shape[:2]
    moved = cv2.warpAffine(image, motion, (width, height), flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    flow = camera_flow(motion, height, width)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    x, y = x - flow[..., 0], y - flow[..., 1]
    known = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
    return np.asarray(moved, np.float32).reshape(image.shape), np.asarray(known, bool)


def camera_flow(motion: Affine, height: int, width: int) -> Plane:
    """Flow (u, v) of the camera's motion at the pixels of the later frame, shape (height, width, 2)."""
    back = cv2.invertAffineTransform(motion)
    y, x = np.mgrid[0:height, 0:width].astype(np.float32)
    u = x - (back[0, 0] * x + back[0, 1] * y + back[0, 2])
    v = y - (back[1, 0] * x + back[1, 1] * y + back[1, 2])
    return np.asarray(np.dstack([u, v]), np.float32)
