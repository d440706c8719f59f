"""What is seen in patches, and how well they agree."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv.patch_tracker import patches
from hs_tracker_cv.patch_tracker.patches import COLOURS, GRAYS, Place
from hs_tracker_cv.patch_tracker.persistence import correlation

SIDE = 64


def _scene(seed: int = 3) -> NDArray[np.float32]:
    noise = np.random.default_rng(seed).uniform(0, 255, (4 * SIDE, 4 * SIDE)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3.0)
    return np.asarray(128 + (smooth - smooth.mean()) * 5, np.float32)


def _window(scene: NDArray[np.float32], dx: float, dy: float) -> NDArray[np.float32]:
    """Gray window of a scene that moved by (dx, dy) samples of the filter, each of 2 × 2 px."""
    middle = (scene.shape[1] / 2 - 2 * dx, scene.shape[0] / 2 - 2 * dy)
    return np.asarray(cv2.getRectSubPix(scene, (2 * SIDE, 2 * SIDE), middle), np.float32)


def _weights(height: int, width: int) -> NDArray[np.float32]:
    """Fade to the border."""
    rows, columns = (np.sin(np.pi * (np.arange(side) + 0.5) / side) ** 2 for side in (height, width))
    return np.outer(rows, columns).astype(np.float32)


def _at(height: int, width: int) -> Place:
    """The middle of a picture of which every second pixel is sampled."""
    return Place(0.5 * (width - 1), 0.5 * (height - 1), 2.0, 2.0, 0.0)


@pytest.mark.parametrize("angle", [0.0, np.pi / 2], ids=["straight", "turned"])
def test_a_sample_is_the_mean_of_its_pixels(angle: float) -> None:
    """Two reads each way between four pixels: their mean, in a plane for each channel."""
    picture = np.random.default_rng(5).uniform(0, 255, (8, 12, 3)).astype(np.float32)
    expected = picture.reshape(4, 2, 6, 2, 3).mean(axis=(1, 3)).transpose(2, 0, 1)
    if angle:
        expected = np.rot90(expected, 1, (1, 2))
    found = patches.colours(picture, _at(8, 12)._replace(angle=angle), expected.shape[1:])
    np.testing.assert_allclose(found, expected, atol=1e-4)


def _learned(picture: NDArray[np.float32], bins: int, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Histograms of a window whose left half is the object's."""
    inside = np.zeros(shape, np.uint8)
    inside[:, : shape[1] // 2] = 1
    at = _at(*picture.shape[:2])
    return patches.learned_colours(picture, at, np.full((2, bins), 1 / bins, np.float32), inside, 0.5)


def test_samples_are_counted_by_colour() -> None:
    """16³ bins of colour: shares inside and outside are mixed in."""
    picture = np.full((32, 40, 3), (33.0, 255.0, 16.0), np.float32)
    picture[:, 20:] = (0.0, 47.9, 250.0)
    left, right = (2 << 8) + (15 << 4) + 1, (0 << 8) + (2 << 4) + 15
    expected = np.full((2, COLOURS), 0.5 / COLOURS)
    expected[0, left] += 0.5
    expected[1, right] += 0.5
    np.testing.assert_allclose(_learned(picture, COLOURS, (16, 20)), expected, atol=1e-7)


def test_grays_are_counted_and_smoothed() -> None:
    """64 bins of gray, blurred by σ 1.5 bins, mirrored at the ends of the range."""
    picture = np.full((32, 40, 1), 2.0, np.float32)
    picture[:, 20:] = 162.0
    blur = np.exp(np.arange(-3.0, 4.0) ** 2 / (-2.0 * 1.5**2))
    blur /= blur.sum()
    expected = np.full((2, GRAYS), 0.5 / GRAYS)
    # The bins beyond the first one are the next ones again, which are empty.
    expected[0, :4] += 0.5 * blur[3:] / blur[3:].sum()
    expected[1, 37:44] += 0.5 * blur
    np.testing.assert_allclose(_learned(picture, GRAYS, (16, 20)), expected, atol=1e-6)


def test_likelihood_is_the_share_of_the_objects_colours() -> None:
    """Inside / (inside + outside) by the sample's bin, the mean of 3 × 3 samples."""
    picture = np.full((32, 40, 3), (33.0, 255.0, 16.0), np.float32)
    picture[:, 20:] = (0.0, 47.9, 250.0)
    left, right = (2 << 8) + (15 << 4) + 1, (0 << 8) + (2 << 4) + 15
    histograms = np.zeros((2, COLOURS), np.float32)
    histograms[:, left], histograms[:, right] = (0.8999, 0.0999), (0.0, 0.5)
    expected = np.repeat([0.9, 0.6, 0.3, 0.0], [9, 1, 1, 9])[None, :].repeat(16, 0)
    found = patches.likelihood(picture, _at(32, 40), histograms, (16, 20))
    np.testing.assert_allclose(found, expected, atol=3e-4)
    # A part in the middle is the same samples.
    part = patches.likelihood(picture, _at(32, 40), histograms, (10, 12))
    np.testing.assert_array_equal(part[1:-1, 1:-1], found[4:-4, 5:-5])


@pytest.mark.parametrize("value", [-1e9, -1.0, 255.9, 256.0, 1e9, np.nan])
def test_grays_out_of_range_are_in_the_bins_at_the_ends(value: float) -> None:
    """Nothing is counted outside of the histogram."""
    found = _learned(np.full((8, 8, 1), value, np.float32), GRAYS, (4, 4))
    np.testing.assert_allclose(found.sum(axis=1), 1.0, atol=1e-5)
    assert np.argmax(found[0]) == (GRAYS - 1 if value > 0 else 0)


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
    weights = _weights(2 * SIDE, 2 * SIDE)
    changed = np.asarray(gain * patch + offset, np.float32)
    assert correlation(patch, changed, weights) == pytest.approx(expected, abs=1e-3)
    assert abs(correlation(patch, _window(_scene(8), 0, 0), weights)) < 0.4
