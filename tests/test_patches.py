"""Kernels of the carried box, against what NumPy and OpenCV make of the same."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import patches

F32 = NDArray[np.float32]


def _noise(seed: int, *shape: int) -> F32:
    return np.random.default_rng(seed).uniform(0, 255, shape).astype(np.float32)


def test_a_patch_is_smoothed_and_normalised() -> None:
    """A patch is under a 3 × 3 Gaussian, of mean 0 under the weights and of a deviation just under 32."""
    gray, inner = _noise(0, 40, 52), _noise(1, 40, 52)
    inner /= inner.sum()
    out = np.empty_like(gray)
    patches.normalise(gray, inner, out)
    wanted = cv2.GaussianBlur(gray, (3, 3), 0.7).astype(np.float64)
    wanted -= np.vdot(inner, wanted)
    wanted *= 32.0 / (np.sqrt(np.vdot(inner, wanted**2)) + 4.0)
    np.testing.assert_allclose(out, wanted, atol=1e-3)


def test_a_flat_patch_stays_flat() -> None:
    """Nothing is divided by zero where there is nothing to see."""
    out = np.empty((8, 8), np.float32)
    patches.normalise(np.full((8, 8), 90, np.float32), np.full((8, 8), 1 / 64, np.float32), out)
    np.testing.assert_allclose(out, 0.0, atol=1e-3)


@pytest.mark.parametrize(("channels", "count"), [(1, 64), (3, 4096)])
def test_foreground_is_the_mean_likelihood_of_the_colours(channels: int, count: int) -> None:
    """Bins are 4 levels of gray or 16 of each colour wide, 256 and more belong to the last; the mean is of 3 × 3."""
    window, likelihood = _noise(2, 24, 30, channels), _noise(3, count) / np.float32(255)
    window[0, :3] = 256.5
    bins, out = np.empty((24, 30), np.int32), np.empty((24, 30), np.float32)
    patches.foreground(window, likelihood, bins, out)
    levels = np.minimum(window.astype(np.int64) // (4 if channels == 1 else 16), 63 if channels == 1 else 15)
    wanted = levels[:, :, 0] if channels == 1 else levels @ (256, 16, 1)
    np.testing.assert_array_equal(bins, wanted)
    np.testing.assert_allclose(out, cv2.blur(likelihood[wanted], (3, 3)), atol=1e-6)


PLACE = (0.5 * 19, 0.5 * 15, 1.0, 0.0, 8.0, 24.0)
"""The result's middle is the patch's, and not turned; 8 gray levels are the same, 24 are not."""


def _carry(place: tuple[float, ...] = PLACE, **changes: F32) -> F32:
    """Half of the map kept, nothing moves and nothing changes, but for the changes."""
    kept = np.zeros((16, 20), np.float32)
    kept[:, :10] = 1.0
    arrays = {
        "kept": kept,
        "flow": np.zeros((32, 40, 2), np.float32),
        "previous": np.zeros((32, 40), np.float32),
        "now": np.zeros((16, 20), np.float32),
        "weight": np.ones((32, 40), np.float32),
        "belongs": np.empty((0, 0), np.float32),
    } | changes
    out = np.empty((16, 20), np.float32)
    patches.carry(*arrays.values(), np.array(place), np.empty((2, 16, 20), np.float32), out)
    return out


def test_what_is_kept_stays_where_nothing_moves() -> None:
    """Without flow and change the map is the old one (but for the last column and row, read a little inside)."""
    out = _carry()
    np.testing.assert_allclose(out[:, :10], 1.0)
    np.testing.assert_allclose(out[:, 10:], 0.0)


def test_what_is_kept_moves_with_the_flow_and_the_pose() -> None:
    """A flow of six samples to the right takes the map three cells along; a pose that follows it takes them back."""
    flow = np.zeros((32, 40, 2), np.float32)
    flow[:, :, 0] = 6.0
    moved = _carry(flow=flow)
    np.testing.assert_allclose(moved[:, :13], 1.0)
    np.testing.assert_allclose(moved[:, 13:], 0.0)
    followed = _carry((PLACE[0] + 3.0, *PLACE[1:]), flow=flow)
    np.testing.assert_allclose(followed[:, :10], 1.0)
    np.testing.assert_allclose(followed[:, 10:16], 0.0)


def test_what_has_changed_is_not_kept() -> None:
    """All of it up to 8 gray levels, half of it at 16, nothing from 24 on."""
    for change, share in ((8.0, 1.0), (16.0, 0.5), (24.0, 0.0), (60.0, 0.0)):
        out = _carry(now=np.full((16, 20), change, np.float32))
        np.testing.assert_allclose(out[:, :10], share, atol=1e-6)


def test_what_moves_with_the_surroundings_is_not_kept() -> None:
    """Where nothing belongs to the object, as much goes as the samples say; a half that does is left alone."""
    foreign = _carry(belongs=np.zeros((32, 40), np.float32))
    np.testing.assert_allclose(foreign[:, :10], 1.0 - 1.0 / 1.1, atol=1e-6)
    np.testing.assert_allclose(_carry(belongs=np.full((32, 40), 0.5, np.float32))[:, :10], 1.0)
    blind = _carry(belongs=np.zeros((32, 40), np.float32), weight=np.zeros((32, 40), np.float32))
    np.testing.assert_allclose(blind[:, :10], 1.0)


def test_far_peaks_are_worth_less() -> None:
    """Of two equal peaks the nearer one wins, by the penalty at its distance; aside and below are added to it."""
    response = np.zeros((16, 16), np.float32)
    response[8, 4] = response[8, 14] = 0.8
    across, down = (np.asarray(a - 8, np.float32) / 10 for a in np.meshgrid(np.arange(16), np.arange(16)))
    faded = np.empty_like(response)
    dx, dy, height, nearest = patches.peak(response, across, down, 0.0, 0.0, 1.0, faded)
    assert (dx, dy) == pytest.approx((-4.0, 0.0), abs=0.1)
    assert height == pytest.approx(0.8 - 0.4**2)
    assert nearest == pytest.approx(0.8)
    dx, _, height, _ = patches.peak(response, across, down, -0.6, 0.0, 1.0, faded)
    assert dx == pytest.approx(6.0, abs=0.1)
    assert height == pytest.approx(0.8)
