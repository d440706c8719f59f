"""Blank frames and cuts are told from the scene; light and a moving camera are not taken for them."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from skimage import data

from hs_tracker_cv import TrackerHS
from hs_tracker_cv._native import kernels
from hs_tracker_cv.frames import as_frame
from hs_tracker_cv.overview import overview, same_scene

Image = NDArray[np.uint8]
ASTRONAUT: Image = np.ascontiguousarray(data.astronaut()[:240, :320, ::-1])
CHELSEA: Image = np.ascontiguousarray(data.chelsea()[:240, :320, ::-1])
COFFEE: Image = np.ascontiguousarray(data.coffee()[:240, :320, ::-1])


def glance(image: NDArray[np.generic]) -> NDArray[np.float32]:
    """Overview of an image."""
    return overview(as_frame(image))


def nothing(kind: str, seed: int = 0) -> Image:
    """Frame that shows nothing of the scene."""
    if kind == "noise":
        return np.random.default_rng(seed).integers(0, 256, ASTRONAUT.shape).astype(np.uint8)
    return np.full_like(ASTRONAUT, {"black": 0, "gray": 128, "white": 255}[kind])


@pytest.mark.parametrize("kind", ["black", "gray", "white", "noise"])
def test_a_blank_frame_is_not_the_scene(kind: str) -> None:
    """One value all over, or noise, has nothing of the scene."""
    assert not same_scene(glance(ASTRONAUT), glance(nothing(kind)))


def test_another_scene_is_told() -> None:
    """Two photographs are two scenes."""
    assert not same_scene(glance(ASTRONAUT), glance(COFFEE))


@pytest.mark.parametrize("gain", [0.4, 0.8, 1.2])
def test_light_may_change(gain: float) -> None:
    """The correlation does not mind a gain."""
    lit = np.clip(gain * ASTRONAUT.astype(np.float32), 0, 255).astype(np.uint8)
    assert same_scene(glance(ASTRONAUT), glance(lit))


@pytest.mark.parametrize("shift", [(0, 15), (12, 0), (-10, 10)])
def test_the_camera_may_move(shift: tuple[int, int]) -> None:
    """Shifts of up to two cells are tried."""
    assert same_scene(glance(ASTRONAUT), glance(np.roll(ASTRONAUT, shift, (0, 1))))


def test_the_size_of_the_frame_does_not_matter() -> None:
    """A frame five times as large has the same thumbnail."""
    large = ASTRONAUT.repeat(5, 0).repeat(5, 1)
    assert np.abs(glance(large)[0] - glance(ASTRONAUT)[0]).mean() < 3.0


@pytest.mark.parametrize("kind", ["gray", "noise"])
def test_over_a_plain_ground_nothing_is_told_from_the_scene(kind: str) -> None:
    """Its thumbnail is hardly another one: noise is told by its roughness, an even gray by what is missing."""
    ramp = np.linspace(110, 146, 320)[np.newaxis, :, np.newaxis]
    noise = np.random.default_rng(1).normal(0.0, 2.0, ASTRONAUT.shape)
    ground = np.clip(ramp + noise, 0, 255).astype(np.uint8)
    assert same_scene(glance(ground), glance(ground + np.uint8(1)))
    assert not same_scene(glance(ground), glance(nothing(kind)))


def scene(count: int, ground: Image, *, seen: bool = True) -> list[Image]:
    """A textured square moves by (3, 1) px per frame; not drawn where it is not `seen`."""
    square = COFFEE[100:136, 60:96]
    frames = []
    for t in range(count):
        frame = ground.copy()
        if seen:
            frame[60 + t : 96 + t, 40 + 3 * t : 76 + 3 * t] = square
        frames.append(frame)
    return frames


def truth(t: int) -> tuple[int, int, int, int]:
    """Box of the square in frame t."""
    return 40 + 3 * t, 60 + t, 36, 36


def overlap(a: tuple[int, int, int, int], b: tuple[int, int, int, int]) -> float:
    """IoU of two boxes."""
    w = max(min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]), 0)
    h = max(min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]), 0)
    return w * h / (a[2] * a[3] + b[2] * b[3] - w * h)


@pytest.mark.parametrize("good", [1, 3, 6, 20])
@pytest.mark.parametrize("kind", ["black", "gray", "white", "noise", "cut", "ground"])
def test_nothing_is_not_taken_for_the_object(kind: str, good: int) -> None:
    """False in every one of ten frames without the object, after however many good ones; then found again."""
    frames, gap = scene(good + 16, ASTRONAUT), 10
    tracker = TrackerHS()
    tracker.init(frames[0], truth(0))
    for frame in frames[1 : good + 1]:
        assert tracker.update(frame)[0]
    ground = {"cut": COFFEE, "ground": ASTRONAUT}
    answers = [tracker.update(ground[kind] if kind in ground else nothing(kind, i))[0] for i in range(gap)]
    assert answers == [False] * gap
    back = [tracker.update(frame) for frame in frames[good + 11 : good + 16]]
    assert any(ok and overlap(box, truth(good + 11 + i)) > 0.5 for i, (ok, box) in enumerate(back))


def test_nothing_is_claimed_of_a_scene_that_stays() -> None:
    """After a cut for good the tracker goes on looking, and sees no object where there is none."""
    frames = scene(10, ASTRONAUT)
    tracker = TrackerHS()
    tracker.init(frames[0], truth(0))
    for frame in frames[1:]:
        tracker.update(frame)
    assert not any(tracker.update(CHELSEA)[0] for _ in range(100))


def test_the_object_is_found_in_a_scene_that_stays() -> None:
    """The ground is another one for good, with the object on it: it is looked for there, and nothing else claimed."""
    tracker = TrackerHS()
    frames = scene(10, ASTRONAUT)
    tracker.init(frames[0], truth(0))
    for frame in frames[1:]:
        tracker.update(frame)
    moved = np.ascontiguousarray(ASTRONAUT[::-1, ::-1])
    moved[69:105, 67:103] = COFFEE[100:136, 60:96]
    answers = [tracker.update(moved) for _ in range(70)]
    claimed = [box for ok, box in answers if ok]
    assert answers[-1][0]
    assert min(overlap(box, truth(9)) for box in claimed) > 0.8


def test_a_small_change_before_a_flat_ground_is_not_another_scene() -> None:
    """Thumbnails of fine noise are flat: a patch that comes and goes must not decide alone."""
    ground = np.random.default_rng(0).integers(0, 256, (120, 160, 3)).astype(np.uint8)
    patched = ground.copy()
    patched[40:72, 52:84] = 255
    assert same_scene(glance(patched), glance(ground))


@pytest.mark.parametrize("shape", [(240, 320, 3), (97, 131, 1), (10, 14, 3)])
@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_an_overview_is_means_over_cells_and_deviations_within(
    rng: np.random.Generator, shape: tuple[int, int, int], dtype: type
) -> None:
    """A sample on the edge of a cell counts by the part inside, of small frames too; against matrices of shares."""
    samples = rng.integers(0, 256, shape).astype(dtype)
    seen = np.empty((2, 24, 32), np.float32)
    kernels.overview(samples, 3, seen)

    def average(plane: NDArray[np.float64]) -> NDArray[np.float64]:
        down, across = (shares(side, cells) for side, cells in zip(plane.shape, (24, 32), strict=True))
        return np.asarray(down @ plane @ across.T)

    few = samples[::3, ::3, 0].astype(np.float64)
    np.testing.assert_allclose(seen[0], average(samples.mean(axis=2, dtype=np.float64)), rtol=1e-5)
    variances = average(few * few) - average(few) ** 2
    np.testing.assert_allclose(seen[1], np.sqrt(np.maximum(variances, 0.0)), rtol=1e-5, atol=1e-4)


def shares(side: int, cells: int) -> NDArray[np.float64]:
    """How much of each sample along a side makes up each cell; rows of sum 1."""
    edges = np.linspace(0.0, side, cells + 1)
    low, high = edges[:-1, np.newaxis], edges[1:, np.newaxis]
    overlaps = np.minimum(np.arange(1, side + 1), high) - np.maximum(np.arange(side), low)
    return np.asarray(np.maximum(overlaps, 0.0) * cells / side)


@pytest.mark.parametrize("count", [1, 2, 7, 768])
def test_statistics_are_those_of_numpy(rng: np.random.Generator, count: int) -> None:
    """The median is the same bits."""
    plane = rng.normal(100.0, 20.0, (1, count)).astype(np.float32)
    assert kernels.median_of(plane) == np.median(plane)
    assert kernels.deviation_of(plane) == pytest.approx(plane.std(dtype=np.float64))


def test_what_has_no_pixels_is_refused() -> None:
    """By name, as by all kernels; so are other elements and sizes."""
    out = np.empty((2, 24, 32), np.float32)
    with pytest.raises(ValueError, match="samples to have pixels"):
        kernels.overview(np.empty((0, 4, 3), np.uint8), 3, out)
    with pytest.raises(ValueError, match="thinned >= 1"):
        kernels.overview(np.zeros((4, 4, 3), np.uint8), 0, out)
    with pytest.raises(ValueError, match=r"out to have shape \(2, any, any\)"):
        kernels.overview(np.zeros((4, 4, 3), np.uint8), 3, np.empty((3, 24, 32), np.float32))
    with pytest.raises(TypeError, match="samples to be an array of float32 with 3 dimensions, got float64"):
        kernels.overview(np.zeros((4, 4, 3)), 3, out)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="plane to have numbers"):
        kernels.median_of(np.empty((0, 4), np.float32))
