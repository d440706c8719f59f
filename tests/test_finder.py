"""The correlation filter that finds the object, and its kernels, on pictures whose shift is known."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from hs_tracker_cv._native import kernels
from hs_tracker_cv.patch_tracker import finder
from hs_tracker_cv.patch_tracker.finder import CELLS, Fade, Finder, Peak, Scene
from hs_tracker_cv.patch_tracker.patches import Place

F32 = NDArray[np.float32]

SIDE = 32.0
"""Of the object, px: a cell is 4 px and the window 160."""
HALF = CELLS // 2 + 1
LATTICE = finder.lattice_of(SIDE, SIDE)


def _texture(seed: int, height: int, width: int) -> F32:
    noise = np.random.default_rng(seed).uniform(0, 255, (height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    return np.clip(128 + (smooth - smooth.mean()) * 4, 0, 255).astype(np.float32)


def _picture(dx: float = 0.0, dy: float = 0.0, ground: int = 1, turn: float = 0.0) -> F32:
    """A textured square at the middle of 300 × 300 px, displaced, on a textured ground that stays."""
    image, square = 0.5 * _texture(ground, 300, 300) + 30, _texture(2, int(SIDE), int(SIDE))
    move = cv2.getRotationMatrix2D((SIDE / 2 - 0.5, SIDE / 2 - 0.5), -np.degrees(turn), 1.0)
    move[:, 2] += np.asarray([dx, dy]) + 150 - SIDE / 2
    cover = cv2.warpAffine(np.ones((int(SIDE), int(SIDE)), np.float32), move, (300, 300))[:, :, np.newaxis]
    return np.asarray(image * (1 - cover) + cv2.warpAffine(square, move, (300, 300)), np.float32)


def _scene(picture: F32, before: F32 | None = None, x: float = 149.5, y: float = 149.5, angle: float = 0.0) -> Scene:
    at = Place(x, y, LATTICE.step, LATTICE.step, angle)
    gray = None if before is None else before @ np.asarray([[0.114], [0.587], [0.299]], np.float32)
    return Scene(np.ascontiguousarray(picture), at, gray, at)


def _start(coloured: bool = True) -> Finder:
    return finder.start(_scene(_picture()), LATTICE, coloured)


# ---- kernels ----


@pytest.mark.parametrize("channels", [16, 24])
def test_transform_is_that_of_numpy(rng: np.random.Generator, channels: int) -> None:
    """Each channel's spectrum is the one that NumPy computes in double precision."""
    features = rng.normal(size=(CELLS, CELLS, channels)).astype(np.float32)
    spectrum = np.empty((CELLS, HALF, 2, channels), np.float32)
    kernels.transform(features, spectrum)
    expected = np.fft.rfft2(features.astype(np.float64), axes=(0, 1))
    np.testing.assert_allclose(spectrum[:, :, 0], expected.real, atol=2e-4)
    np.testing.assert_allclose(spectrum[:, :, 1], expected.imag, atol=2e-4)


def learning(memory: float, coupling: float, rounds: int = 1) -> kernels.FilterLearning:
    """How filters are learned here."""
    return kernels.FilterLearning(memory=memory, coupling=coupling, growth=10.0, rounds=rounds)


def _complex(spectrum: F32) -> NDArray[np.complex128]:
    return spectrum[:, :, 0].astype(np.float64) + 1j * spectrum[:, :, 1]


@pytest.mark.parametrize("first", [True, False])
def test_filter_solves_its_equations(rng: np.random.Generator, first: bool) -> None:
    """Without a penalty one round is the least squares solution, bin by bin, of a dense solver."""
    channels, memory, coupling = 16, 0.5, 0.01
    spectrum, old = (rng.normal(size=(CELLS, HALF, 2, channels)).astype(np.float32) for _ in range(2))
    target, learned = rng.normal(size=(CELLS, HALF)).astype(np.float32), np.empty_like(spectrum)
    penalty = np.zeros((CELLS, CELLS), np.float32)
    kernels.adapt(spectrum, target, penalty, None if first else old, learning(memory, coupling), learned)
    share, weight = 1.0 / CELLS**2, coupling + (0.0 if first else memory)
    x, before = _complex(spectrum), 0.0 if first else memory * _complex(old)
    for i, j in ((0, 0), (3, 7), (20, 20), (39, 1)):
        matrix = share * np.outer(x[i, j], x[i, j].conj()) + weight * np.eye(channels)
        wanted = share * target[i, j] * x[i, j] + (0.0 if first else before[i, j])
        np.testing.assert_allclose(_complex(learned)[i, j], np.linalg.solve(matrix, wanted), atol=1e-4)


def test_filter_stays_inside() -> None:
    """What is learned has its weight on the object, although the window reaches far beyond it."""
    learned = _start().filter
    weight = (np.fft.irfft2(_complex(learned), s=(CELLS, CELLS), axes=(0, 1)) ** 2).sum(axis=2)
    assert weight[LATTICE.penalty < 1].sum() > 0.9 * weight.sum()


def test_more_rounds_keep_the_filter_closer_inside() -> None:
    """With more rounds of the alternating directions less and less is left outside."""
    features = np.random.default_rng(5).normal(size=(CELLS, CELLS, 16)).astype(np.float32)
    spectrum = np.empty((CELLS, HALF, 2, 16), np.float32)
    kernels.transform(features, spectrum)
    outside = []
    for rounds in (1, 2, 6):
        learned = np.empty_like(spectrum)
        kernels.adapt(spectrum, LATTICE.target, LATTICE.penalty, None, learning(15.0, 1.0, rounds), learned)
        weight = (np.fft.irfft2(_complex(learned), s=(CELLS, CELLS), axes=(0, 1)) ** 2).sum(axis=2)
        outside.append(weight[LATTICE.penalty > 1].sum() / weight.sum())
    assert outside[0] > outside[1] > 10 * outside[2]


@settings(deadline=None)
@given(st.floats(-15.0, 15.0), st.floats(-15.0, 15.0))
def test_peak_between_samples_is_that_of_the_function(dx: float, dy: float) -> None:
    """The peak of a sampled Gaussian is found to a hundredth of a cell, with its height and the witness's."""
    frequency_y, frequency_x = np.fft.fftfreq(CELLS)[:, np.newaxis], np.fft.rfftfreq(CELLS)
    bell = np.exp(-2 * (np.pi * 1.5) ** 2 * (frequency_x**2 + frequency_y**2))
    wave = bell * np.exp(-2j * np.pi * (frequency_x * dx + frequency_y * dy))
    spectrum, learned = np.zeros((2, CELLS, HALF, 2, 16), np.float32)
    spectrum[:, :, 0, 3], spectrum[:, :, 1, 3] = wave.real, wave.imag
    learned[:, :, 0, 3] = 1.0
    response = np.empty((CELLS, CELLS), np.float32)
    x, y, height, value, *_, witness = kernels.respond(
        learned, np.float32(0.5) * learned, spectrum, finder.NO_FADE, response
    )
    assert (x, y) == (pytest.approx(dx, abs=0.01), pytest.approx(dy, abs=0.01))
    top = np.fft.irfft2(bell, s=(CELLS, CELLS))[0, 0]
    assert (height, value) == (pytest.approx(top, rel=1e-2), pytest.approx(height))
    assert witness == pytest.approx(top / 2, rel=1e-2)
    expected = np.fft.fftshift(np.fft.irfft2(wave, s=(CELLS, CELLS)))
    np.testing.assert_allclose(response, expected, atol=1e-6)


def test_fade_chooses_the_nearer_of_two_peaks() -> None:
    """Of two equal peaks the one nearer to the fade's point is found; its value is lowered by weight × distance²."""
    plane = np.zeros((CELLS, CELLS))
    plane[20 - 5, 20 - 10] = plane[20 - 5, 20 + 10] = 1.0
    wave = np.fft.rfft2(np.fft.ifftshift(cv2.GaussianBlur(plane, (0, 0), 1.5)))
    spectrum, learned = np.zeros((2, CELLS, HALF, 2, 16), np.float32)
    spectrum[:, :, 0, 0], spectrum[:, :, 1, 0], learned[:, :, 0, 0] = wave.real, wave.imag, 1.0
    # The window's centre is 3 cells to the left of the point and 1 below it; a unit is 4 cells across, and 2 down.
    fade = (0.001, -3 / 4, 1 / 2, 1 / 4, 1 / 2)
    x, y, height, value, second, *_ = kernels.respond(
        learned, learned, spectrum, fade, np.empty((CELLS, CELLS), np.float32)
    )
    assert (round(x), round(y)) == (10, -5)
    assert value == pytest.approx(height - 0.001 * ((7 / 4) ** 2 + (4 / 2) ** 2), abs=1e-5)
    assert second == pytest.approx(height, rel=1e-3)


@pytest.mark.parametrize("channels", [1, 3])
def test_levels_agree_bit_by_bit(level: None, channels: int) -> None:
    """All levels of the kernels give the same bits."""
    results: list[list[F32]] = []
    picture = np.ascontiguousarray(_picture()[:, :, :channels])
    for name in kernels.levels():
        kernels.use_level(name)
        out: list[F32] = []
        for angle in (0.0, 0.3):
            features, grays = np.empty((CELLS, CELLS, 24), np.float32), np.empty((CELLS, CELLS), np.float32)
            at = (149.2, 151.7, 1.3, 0.9, angle)
            kernels.describe(picture, at, LATTICE.fade, finder.colour_names(channels), features, grays)
            spectrum, learned = np.empty((2, CELLS, HALF, 2, 24), np.float32)
            kernels.transform(features, spectrum)
            kernels.adapt(spectrum, LATTICE.target, LATTICE.penalty, spectrum, learning(15.0, 1.0, 2), learned)
            response = np.empty((CELLS, CELLS), np.float32)
            peak = kernels.respond(learned, spectrum, spectrum, finder.NO_FADE, response)
            out += [features, grays, spectrum, learned, response, np.asarray(peak, np.float32)]
        results.append(out)
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(one, two)


def test_grays_are_means_of_pixels() -> None:
    """With a step of one pixel a cell is the mean of 4 × 4 pixels, and beyond the picture its border is repeated."""
    picture = np.random.default_rng(7).uniform(0, 255, (200, 220, 1)).astype(np.float32)
    grays = np.empty((CELLS, CELLS), np.float32)
    kernels.shade(picture, (99.5, 99.5, 1.0, 1.0, 0.0), grays)
    expected = picture[20:180, 20:180, 0].reshape(CELLS, 4, CELLS, 4).mean(axis=(1, 3))
    np.testing.assert_allclose(grays, expected, rtol=1e-5)
    kernels.shade(picture, (1e6, 1e6, 1.0, 1.0, 0.0), grays)
    np.testing.assert_allclose(grays, picture[-1, -1, 0], rtol=1e-5)


@pytest.mark.parametrize("turn", range(9))
def test_direction_has_its_channel(turn: int) -> None:
    """A grating across one of nine directions is strongest in that channel, and so is its negative."""
    y, x = np.mgrid[:200, :200]
    angle = np.pi / 9 * turn
    wave = np.asarray(128 + 60 * np.sin(0.5 * (x * np.cos(angle) + y * np.sin(angle))), np.float32)
    for picture in (wave, 256 - wave):
        features, grays = np.empty((CELLS, CELLS, 16), np.float32), np.empty((CELLS, CELLS), np.float32)
        ones = np.ones((CELLS, CELLS), np.float32)
        pixels = np.ascontiguousarray(picture[:, :, np.newaxis])
        kernels.describe(pixels, (99.5, 99.5, 1.0, 1.0, 0.0), ones, None, features, grays)
        assert int(features[5:-5, 5:-5, :9].mean(axis=(0, 1)).argmax()) == turn


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"picture": np.zeros((5, 5, 2), np.float32)}, ValueError, "1 or 3 channels"),
        ({"picture": np.zeros((5, 5, 3))}, TypeError, "picture.*float64"),
        ({"at": (2.0, 2.0, 0.0, 1.0, 0.0)}, ValueError, "steps 0.0"),
        ({"at": (np.nan, 2.0, 1.0, 1.0, 0.0)}, ValueError, "finite place"),
        ({"at": (2.0, 2.0, 1.0, 1.0, np.inf)}, ValueError, "finite place"),
        ({"names": np.zeros((32, 9), np.float32)}, ValueError, "names.*32768"),
        ({"features": np.zeros((40, 40, 16), np.float32)}, ValueError, "features.*24"),
    ],
)
def test_what_describe_refuses_is_named(change: dict[str, object], error: type[Exception], message: str) -> None:
    """Arguments that a kernel cannot work with raise an error that names them."""
    arguments: dict[str, object] = {
        "picture": np.zeros((5, 5, 3), np.float32),
        "at": (2.0, 2.0, 1.0, 1.0, 0.0),
        "fade": LATTICE.fade,
        "names": finder.colour_names(3),
        "features": np.empty((40, 40, 24), np.float32),
        "grays": np.empty((40, 40), np.float32),
    }
    describe: Callable[..., None] = kernels.describe
    describe(**arguments)
    with pytest.raises(error, match=message):
        describe(**{**arguments, **change})


def test_other_counts_of_channels_are_refused() -> None:
    """Transforms are made for two counts of channels."""
    with pytest.raises(ValueError, match="16 or 24 channels, got 8"):
        kernels.transform(np.zeros((40, 40, 8), np.float32), np.zeros((40, 21, 2, 8), np.float32))


# ---- finder ----


@pytest.mark.parametrize("channels", [1, 3])
def test_names_share_each_colour(channels: int) -> None:
    """What a colour is called adds up to one; pure colours have one name."""
    names = finder.colour_names(channels)
    assert names.shape == (32**channels, 9)
    assert names.min() >= 0
    np.testing.assert_allclose(names.sum(axis=1), 1, atol=1e-6)
    black, white = (0, 31) if channels == 1 else (0, 32**3 - 1)
    assert names[black].argmax() == 0
    assert names[white].argmax() == 2
    if channels == 3:
        b, g, r = 31 << 10, 31 << 5, 31
        called = [int(names[index].argmax()) for index in (r, g + r, g, b + g, b, b + r)]
        assert called == [3, 4, 5, 6, 7, 8]


@pytest.mark.parametrize("coloured", [True, False])
@pytest.mark.parametrize(("dx", "dy"), [(0.0, 0.0), (8.0, -12.0), (-21.0, 17.5), (30.3, 9.8)])
def test_finds_a_displaced_square(dx: float, dy: float, coloured: bool) -> None:
    """The peak is within a quarter of a cell of the square, up to a box size from where it was."""
    seen = finder.find_peak(_start(coloured), _scene(_picture(dx, dy)))
    assert 4 * LATTICE.step * seen.dx == pytest.approx(dx, abs=1.0)
    assert 4 * LATTICE.step * seen.dy == pytest.approx(dy, abs=1.0)
    assert seen.height > 1.3 * seen.second


def test_height_is_in_units_of_the_first_frame() -> None:
    """The frame that was learned gives 1, filter and witness alike."""
    seen = finder.find_peak(_start(), _scene(_picture()))
    assert seen.height == pytest.approx(1.0, abs=1e-5)
    assert seen.witness == pytest.approx(1.0, abs=1e-5)


def test_turned_windows_find_a_turned_square() -> None:
    """A window that turns with the object sees it as it was."""
    turned = _picture(turn=0.4)
    seen = finder.find_peak(_start(), _scene(turned, angle=0.4))
    assert np.hypot(seen.dx, seen.dy) < 0.25
    assert seen.height > 1.5 * finder.find_peak(_start(), _scene(turned)).height


def test_learning_leaves_the_old_filter_and_the_witness_alone() -> None:
    """A new view raises its own height, and nothing that was there is written to."""
    old = _start()
    kept = old.filter.copy()
    view = _scene(_picture(turn=1.5))
    new = old
    for _ in range(20):
        new = finder.learn(new, view)
    assert finder.find_peak(new, view).height > 1.5 * finder.find_peak(old, view).height
    assert new.witness is old.witness
    np.testing.assert_array_equal(old.filter, kept)


def test_what_moves_is_seen_while_the_camera_stands() -> None:
    """Between two things that look the same the one that moves is found."""

    def pair(dx: float) -> F32:
        both = 0.5 * _texture(1, 300, 300) + 30
        square = _texture(2, int(SIDE), int(SIDE))
        both[134:166, 100:132] = square
        both[134:166, int(168 + dx) : int(200 + dx)] = square
        return np.asarray(both, np.float32)

    at, known = 183.5, finder.start(_scene(pair(0), x=183.5), LATTICE, True)
    for step in range(1, 6):
        scene = _scene(pair(2 * step), pair(2 * step - 2), x=at + 2 * step)
        known = finder.with_unrest(finder.learn(known, scene), finder.find_peak(known, scene).change)
    # Seen from half-way between them, neither is nearer.
    seen = finder.find_peak(known, _scene(pair(12), pair(10), x=(115.5 + 195.5) / 2))
    assert seen.dx * 4 * LATTICE.step == pytest.approx(40.0, abs=2.0)
    assert known.unrest == pytest.approx(0.0, abs=0.5)


def test_unrest_is_what_surroundings_change_by() -> None:
    """A moving ground is told from one that stands."""
    known = _start()
    still = finder.find_peak(known, _scene(_picture(3.0), _picture())).change
    shaken = finder.find_peak(known, _scene(_picture(ground=8), _picture())).change
    assert still < 0.5
    assert shaken > 5.0
    assert finder.with_unrest(known, shaken).unrest == shaken
    assert finder.with_unrest(finder.with_unrest(known, 10.0), 0.0).unrest == pytest.approx(9.0)


def test_likelihood_falls_with_what_speaks_against_it() -> None:
    """A lower peak, a higher rival and a doubtful witness each lower the chance; it is always within (0, 1)."""
    response = np.zeros((CELLS, CELLS), np.float32)

    def chance(height: float = 1.0, second: float = 0.2, witness: float = 0.9, level: float = 1.0) -> float:
        return finder.likelihood(Peak(0, 0, height, height, second, 0, 0.1, witness, 0, response), level)

    assert chance() > 0.95
    assert chance() > chance(level=0.5) > chance(level=0.1) >= chance(level=-1.0) > 0
    assert chance() > chance(second=0.6) > chance(second=0.95) >= chance(second=9.0) * 0.1 > 0
    assert chance() > chance(witness=0.2) >= chance(witness=-5.0) > 0
    assert 0 < chance(height=-1.0) < 0.1
    assert finder.NO_FADE == Fade(0, 0, 0, 0, 0)
