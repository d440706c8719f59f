"""What is seen in patches, and how well they agree."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import patches
from hs_tracker_cv.patches import COLOURS, GRAYS, Place
from hs_tracker_cv.propagation.kept import correlation
from hs_tracker_cv.propagation.state import hann

SIDE = 64


def _scene(seed: int = 3) -> NDArray[np.float32]:
    noise = np.random.default_rng(seed).uniform(0, 255, (4 * SIDE, 4 * SIDE)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3.0)
    return np.asarray(128 + (smooth - smooth.mean()) * 5, np.float32)


def _window(scene: NDArray[np.float32], dx: float, dy: float) -> NDArray[np.float32]:
    """Gray window of a scene that moved by (dx, dy) samples of the filter, each of 2 × 2 px."""
    middle = (scene.shape[1] / 2 - 2 * dx, scene.shape[0] / 2 - 2 * dy)
    return np.asarray(cv2.getRectSubPix(scene, (2 * SIDE, 2 * SIDE), middle), np.float32)


def _sight(
    colour: NDArray[np.float32], histograms: NDArray[np.float32] | None, window: NDArray[np.float32]
) -> patches.Sight:
    """Channels of a window (2 h, 2 w, C), read pixel by pixel."""
    height, width = colour.shape[:2]
    at = Place(0.5 * (width - 1), 0.5 * (height - 1), 2.0, 2.0, 0.0)
    gray = np.ascontiguousarray(colour.mean(axis=2), np.float32)
    return patches.sight(np.ascontiguousarray(colour), gray, at, histograms, window)


def test_likelihood_adds_a_channel() -> None:
    """Colours of the object are a sixth channel; every channel fades towards the border."""
    window, histograms = _window(_scene(), 0, 0)[:, :, None].repeat(3, 2), np.full((2, COLOURS), 0.1, np.float32)
    window[40:80, 40:80] = (200.0, 10.0, 90.0)
    histograms[0, (12 << 8) + (0 << 4) + 5] = 0.9
    channels = _sight(window, histograms, hann(SIDE, SIDE)).channels
    assert channels.shape == (6, SIDE, SIDE)
    assert np.abs(channels[:, 0]).max() < 0.02
    assert channels[5, 25:35, 25:35].min() > 0.5
    assert channels[5, :10, :10].max() < 0.0


def test_samples_are_binned_by_colour() -> None:
    """Each sample has the bin of its colour, 16³ or 64 of gray, and the mean likelihood of 3 × 3 samples."""
    colour = np.full((32, 40, 3), (33.0, 255.0, 16.0), np.float32)
    colour[:, 20:] = (0.0, 47.9, 250.0)
    left, right = (2 << 8) + (15 << 4) + 1, (0 << 8) + (2 << 4) + 15
    histograms = np.zeros((2, COLOURS), np.float32)
    histograms[:, left], histograms[:, right] = (0.8999, 0.0999), (0.0, 0.5)
    sight = _sight(colour, histograms, np.ones((16, 20), np.float32))
    assert set(np.unique(sight.bins[:, :10])) == {left}
    assert set(np.unique(sight.bins[:, 10:])) == {right}
    expected = np.repeat([0.9, 0.6, 0.3, 0.0], [9, 1, 1, 9])[None, :].repeat(16, 0)
    np.testing.assert_allclose(sight.likelihood, expected, atol=3e-4)
    gray = _sight(colour[:, :, 2:], np.zeros((2, GRAYS), np.float32), np.ones((16, 20), np.float32))
    assert set(np.unique(gray.bins[:, :10])) == {4}
    assert set(np.unique(gray.bins[:, 10:])) == {62}


def test_light_is_the_standardised_logarithm() -> None:
    """The fifth channel is log(gray + 8) less its mean over its deviation, also at both ends of the gray levels."""
    gray = np.linspace(0.0, 255.0, 32 * 40, dtype=np.float32).reshape(32, 40).repeat(2, 0).repeat(2, 1)
    light = _sight(gray[:, :, None], None, np.ones((32, 40), np.float32)).channels[4]
    expected = np.log(gray[::2, ::2] + 8.0)
    expected = (expected - expected.mean()) / (expected.std() + 0.05)
    np.testing.assert_allclose(light, expected, atol=1e-5)


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_orientation_has_its_channel(turn: int) -> None:
    """A grating at a multiple of 45 degrees is strongest in one channel, the same for the grating's negative."""
    y, x = np.mgrid[:32, :32].astype(np.float32)
    angle = np.pi / 4 * turn
    grating = np.asarray(128 + 60 * np.sin(0.7 * (x * np.cos(angle) + y * np.sin(angle))), np.float32)
    flat = np.full((32, 32), 128, np.float32)
    stepped = grating.copy()
    stepped[:, :16] = 128.0

    def edges(gray: NDArray[np.float32]) -> NDArray[np.float32]:
        return _sight(gray[:, :, None], None, np.ones((16, 16), np.float32)).channels[:4]

    out = edges(stepped)
    right = out[:, 2:-2, 9:-1].mean(axis=(1, 2))
    assert int(np.argmax(right)) == [0, 2, 1, 3][turn]
    np.testing.assert_allclose(out.mean(axis=(1, 2)), 0.0, atol=1e-5)
    np.testing.assert_allclose(edges(np.asarray(256 - stepped, np.float32)), out, atol=1e-4)
    np.testing.assert_array_equal(edges(flat), 0.0)


@pytest.mark.parametrize(
    ("gain", "offset", "expected"),
    [
        (1.0, 0.0, 1.0),  # the same
        (0.3, 40.0, 1.0),  # darker, brighter
        (-1.0, 0.0, -1.0),  # negative
    ],
)
def test_correlation_ignores_gain_and_offset(gain: float, offset: float, expected: float) -> None:
    """Agreement is ±1 for any linear change of brightness."""
    patch = _window(_scene(), 0, 0)
    weights = hann(2 * SIDE, 2 * SIDE)
    changed = np.asarray(gain * patch + offset, np.float32)
    assert correlation(patch, changed, weights) == pytest.approx(expected, abs=1e-3)
    assert abs(correlation(patch, _window(_scene(8), 0, 0), weights)) < 0.4
