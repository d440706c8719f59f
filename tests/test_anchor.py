"""The correlation filter and the patch agreement, on images whose shift is known."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import anchor, patches

SIDE = 64


def _scene(seed: int = 3) -> NDArray[np.float32]:
    noise = np.random.default_rng(seed).uniform(0, 255, (4 * SIDE, 4 * SIDE)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 3.0)
    return np.asarray(128 + (smooth - smooth.mean()) * 5, np.float32)


def _window(scene: NDArray[np.float32], dx: float, dy: float) -> NDArray[np.float32]:
    """Gray window of a scene that moved by (dx, dy) samples of the filter, each of 2 × 2 px."""
    middle = (scene.shape[1] / 2 - 2 * dx, scene.shape[0] / 2 - 2 * dy)
    return np.asarray(cv2.getRectSubPix(scene, (2 * SIDE, 2 * SIDE), middle), np.float32)


def _channels(window: NDArray[np.float32]) -> NDArray[np.float32]:
    return anchor.features(window, None, anchor.hann(SIDE, SIDE))


def _peak(score: NDArray[np.float32]) -> tuple[float, float, float, float]:
    """Highest point of a response, no place being worth less than another."""
    nowhere = np.zeros_like(score)
    dx, dy, height, nearest = patches.peak(score, nowhere, nowhere, 0.0, 0.0, 0.0, np.empty_like(score))
    return dx, dy, height, nearest


@pytest.mark.parametrize(
    ("dx", "dy"),
    [
        (0.0, 0.0),  # nothing moved
        (5.0, -3.0),  # whole samples
        (-2.5, 4.25),  # between samples
        (3.3, 2.6),  # between samples, both ways
    ],
)
def test_peak_is_at_the_known_shift(dx: float, dy: float) -> None:
    """The response peaks within a fifth of a sample of the true displacement."""
    scene = _scene()
    learned = anchor.train(_channels(_window(scene, 0, 0)), 1.6)
    found = _peak(anchor.respond(learned, _channels(_window(scene, dx, dy))))
    assert found[:2] == pytest.approx((dx, dy), abs=0.2)


def test_response_to_what_was_learned_is_nearly_one() -> None:
    """The window the filter was trained on answers with a peak just under 1, another scene with far less."""
    learned = anchor.train(_channels(_window(_scene(), 0, 0)), 1.6)
    _, _, same, _ = _peak(anchor.respond(learned, _channels(_window(_scene(), 0, 0))))
    _, _, other, _ = _peak(anchor.respond(learned, _channels(_window(_scene(8), 0, 0))))
    assert 0.9 < same <= 1.0
    assert other < 0.4


def test_learning_moves_the_filter_and_leaves_the_old_one_alone() -> None:
    """After enough windows of a new scene the filter knows it, and the filter it came from is unchanged."""
    old = anchor.train(_channels(_window(_scene(), 0, 0)), 1.6)
    before = old.numerator.copy(), old.energy.copy()
    new_view = _channels(_window(_scene(8), 0, 0))
    new = old
    for _ in range(60):
        new = anchor.learn(new, new_view, 0.1)
    assert _peak(anchor.respond(new, new_view))[2] > 0.9
    np.testing.assert_array_equal(old.numerator, before[0])
    np.testing.assert_array_equal(old.energy, before[1])


def test_likelihood_adds_a_channel() -> None:
    """A colour likelihood is a sixth channel; every channel fades towards the border."""
    window, likelihood = _window(_scene(), 0, 0), np.full((SIDE, SIDE), 0.5, np.float32)
    likelihood[20:40, 20:40] = 0.9
    channels = anchor.features(window, likelihood, anchor.hann(SIDE, SIDE))
    assert channels.shape == (6, SIDE, SIDE)
    assert np.abs(channels[:, 0]).max() < 0.02
    assert np.abs(channels[5, 25:35, 25:35]).min() > 0.5


def test_a_filter_is_the_ratio_of_mean_spectra() -> None:
    """Training, one step of learning and the response are what NumPy makes of their formulas."""
    first, second = _channels(_window(_scene(), 0, 0)), _channels(_window(_scene(8), 1, 2))
    old = anchor.train(first, 1.6)
    spectra = [np.fft.rfft2(channels).astype(np.complex128) for channels in (first, second)]
    numerator = 0.75 * old.target * spectra[0].conj() + 0.25 * old.target * spectra[1].conj()
    energy = 0.75 * (np.abs(spectra[0]) ** 2).sum(axis=0) + 0.25 * (np.abs(spectra[1]) ** 2).sum(axis=0)
    new = anchor.learn(old, second, 0.25)
    np.testing.assert_allclose(new.numerator, numerator, atol=1e-3 * np.abs(numerator).max())
    np.testing.assert_allclose(new.energy, energy, rtol=1e-3)
    floor = 1e-3 * 5 * SIDE * SIDE
    response = np.fft.irfft2((numerator * spectra[1]).sum(axis=0) / (energy + floor), s=(SIDE, SIDE))
    np.testing.assert_allclose(anchor.respond(new, second), np.fft.fftshift(response), atol=1e-3)


@pytest.mark.parametrize("turn", [0, 1, 2, 3])
def test_orientation_has_its_channel(turn: int) -> None:
    """A grating at a multiple of 45 degrees is strongest in one channel, the same for the grating's negative."""
    y, x = np.mgrid[:32, :32].astype(np.float32)
    angle = np.pi / 4 * turn
    grating = np.asarray(128 + 60 * np.sin(0.7 * (x * np.cos(angle) + y * np.sin(angle))), np.float32)
    flat = np.full((32, 32), 128, np.float32)
    out = np.empty((4, 16, 16), np.float32)
    stepped = grating.copy()
    stepped[:, :16] = 128.0
    patches.orientations(stepped, out)
    right = out[:, 2:-2, 9:-1].mean(axis=(1, 2))
    assert int(np.argmax(right)) == [0, 2, 1, 3][turn]
    negative = np.empty_like(out)
    patches.orientations(np.asarray(256 - stepped, np.float32), negative)
    np.testing.assert_allclose(negative, out, atol=1e-5)
    patches.orientations(flat, out)
    np.testing.assert_array_equal(out, 0.0)


def test_peak_position_is_parabolic() -> None:
    """A sampled paraboloid gives back its vertex."""
    y, x = np.mgrid[:16, :20].astype(np.float32)
    score = np.asarray(1 - 0.01 * ((x - 12.3) ** 2 + (y - 6.8) ** 2), np.float32)
    dx, dy, height, nearest = _peak(score)
    assert (dx, dy) == pytest.approx((2.3, -1.2), abs=1e-3)
    assert height == nearest == score[7, 12]


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
    weights = anchor.hann(2 * SIDE, 2 * SIDE)
    changed = np.asarray(gain * patch + offset, np.float32)
    assert patches.correlation(patch, changed, weights) == pytest.approx(expected, abs=1e-3)
    assert abs(patches.correlation(patch, _window(_scene(8), 0, 0), weights)) < 0.4
