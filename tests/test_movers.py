"""What moves, found over several frames: every mover and nothing else, in any light, beside anything that blinks."""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from datasets_synthetic.spec import Texture
from hs_tracker_cv import InputError, MotionDetector
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.movers import Mover, MoverFinder
from tests.moving_scenes import FIXTURES, LIGHTS, Image, Scene, crossing, panning, render, still
from tests.moving_scenes import Mover as Drawn

COIN = Texture("coins", 1.0, None, 3)


def _first_whole(frames: Iterable[Image]) -> tuple[int, Mover] | None:
    """The first frame in which a mover is known as a whole, and the mover."""
    finder = MoverFinder()
    for t, frame in enumerate(frames):
        whole = [mover for mover in finder.update(frame) if mover.whole]
        if whole:
            return t, whole[0]
    return None


def _scene(*movers: Drawn, light: str = "still", fixtures: tuple[str, ...] = (), frames: int = 30) -> Scene:
    return Scene(Texture("coffee", 1.0, None, 5), movers, light, fixtures, frames=frames, seed=11)


@pytest.mark.parametrize("light", LIGHTS)
@pytest.mark.parametrize("seed", [41, 42])
def test_a_change_of_light_is_no_region(light: str, seed: int) -> None:
    """A still picture in any light holds no region in any pair of frames."""
    detector = MotionDetector()
    frames = list(render(replace(still(seed, light, ()), size=(240, 180), frames=12)))
    assert [detector.detect(*pair) for pair in itertools.pairwise(frames)] == [[]] * 11


@pytest.mark.parametrize("fixtures", [FIXTURES[:2], FIXTURES[2:]], ids=["clocks", "lamp and screen"])
@pytest.mark.parametrize("seed", [51, 52])
def test_what_changes_in_its_place_is_no_mover(fixtures: tuple[str, ...], seed: int) -> None:
    """Digits, lamps and screens in a still scene are never taken for a mover, nor is their light."""
    scene = replace(still(seed, None, fixtures), size=(240, 180), frames=36)
    assert _first_whole(render(scene)) is None


@pytest.mark.parametrize("light", LIGHTS)
def test_a_mover_is_found_in_any_light(light: str) -> None:
    """It is found soon after it has begun to move, in its box, while the light changes all the time."""
    mover = Drawn("ellipse", (44, 36), (90, 130), (3.0, -1.0), 0.0, 8, COIN)
    scene = _scene(mover, light=light)
    found = _first_whole(render(scene))
    assert found is not None
    assert 8 < found[0] < 18
    assert iou(found[1].box, scene.truth(found[0])[0]) > 0.65


@pytest.mark.parametrize("fixture", FIXTURES)
def test_a_mover_is_found_beside_what_blinks(fixture: str) -> None:
    """The first mover is the one that moves, not the lamp beside it."""
    scene = _scene(Drawn("box", (40, 40), (80, 200), (3.5, 0.0), 0.0, 6, COIN), fixtures=(fixture,))
    found = _first_whole(render(scene))
    assert found is not None
    assert iou(found[1].box, scene.truth(found[0])[0]) > 0.6


@pytest.mark.parametrize("shape", ["bar", "fan"])
@pytest.mark.parametrize("spin", [-0.08, 0.06])
def test_what_turns_in_its_place_is_a_mover(shape: str, spin: float) -> None:
    """A bar or a fan never leaves its place; all of it is found."""
    size = (90.0, 22.0) if shape == "bar" else (90.0, 90.0)
    scene = _scene(Drawn(shape, size, (160, 120), (0.0, 0.0), spin, 3, Texture("patches", 1.0, None, 9)))
    found = _first_whole(render(scene))
    assert found is not None
    assert iou(found[1].box, scene.truth(found[0])[0]) > 0.7


@pytest.mark.parametrize("speed", [1.0, 2.5, 8.0])
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0)])
def test_slow_and_fast_movers_are_found(speed: float, direction: tuple[float, float]) -> None:
    """From 1 to 8 px per frame, with the speed that is reported."""
    velocity = direction[0] * speed, direction[1] * speed
    start = (70.0, 120.0) if direction[0] else (160.0, 180.0)
    scene = _scene(Drawn("box", (48, 48), start, velocity, 0.0, 0, COIN))
    found = _first_whole(render(scene))
    assert found is not None
    assert iou(found[1].box, scene.truth(found[0])[0]) > 0.65
    assert np.hypot(*np.subtract(found[1].pace, velocity)) < 0.4 * speed + 0.3


@pytest.mark.parametrize(("width", "speed"), [(40, 3.0), (150, 4.0)], ids=["pedestrian", "truck"])
def test_what_enters_is_waited_for(width: int, speed: float) -> None:
    """It is taken when all of it is in the picture, not its front part before."""
    mover = Drawn("box", (width, 60), (-width / 2 - 1, 130), (speed, 0.0), 0.0, 2, COIN)
    scene = _scene(mover, frames=62)
    found = _first_whole(render(scene))
    assert found is not None
    t, seen = found
    truth = scene.truth(t)[0]
    assert truth.x > 0
    assert iou(seen.box, truth) > 0.75


@pytest.mark.parametrize("seed", [61, 62, 63])
def test_a_camera_that_pans_makes_no_mover(seed: int) -> None:
    """Everything moves on the sensor, nothing in the scene."""
    scene = replace(panning(seed, mover=False), size=(240, 180), frames=18)
    assert _first_whole(render(scene)) is None


def test_a_mover_before_a_camera_that_pans_is_found() -> None:
    """What moves otherwise than the picture is found in its box."""
    scene = replace(_scene(Drawn("box", (50, 50), (90, 130), (2.5, 0.5), 0.0, 0, COIN)), camera=(1.5, 0.5), noise=1.0)
    found = _first_whole(render(scene))
    assert found is not None
    assert iou(found[1].box, scene.truth(found[0])[0]) > 0.6


@pytest.mark.parametrize("seed", range(71, 75))
def test_drawn_movers_are_found(seed: int) -> None:
    """Any size, speed, surface, ground, light and compression, beside anything that blinks."""
    scene = replace(crossing(seed), frames=50)
    found = _first_whole(render(scene))
    assert found is not None
    assert iou(found[1].box, scene.truth(found[0])[0]) > 0.4


def test_two_movers_are_two() -> None:
    """Each has a box of its own."""
    movers = (
        Drawn("box", (40, 40), (70, 60), (2.5, 0.0), 0.0, 0, COIN),
        Drawn("box", (50, 50), (240, 180), (-3.0, 0.0), 0.0, 0, Texture("dots", 1.0, None, 4)),
    )
    scene, finder = _scene(*movers, frames=10), MoverFinder()
    boxes: list[Box] = []
    for frame in render(scene):
        boxes = [mover.box for mover in finder.update(frame) if mover.whole]
    truth = scene.truth(9)
    assert len(boxes) == 2
    assert all(max(iou(box, true) for box in boxes) > 0.6 for true in truth)


def test_a_cut_makes_no_mover() -> None:
    """Of frames that have nothing in common nothing is said."""
    frames = [
        *list(render(_scene(frames=8))),
        *list(render(replace(still(5, "still", ()), size=(320, 240), frames=10))),
    ]
    assert _first_whole(frames) is None


def test_one_video_has_one_size() -> None:
    """Another size is refused, and the frame before it counts on."""
    finder = MoverFinder()
    finder.update(np.zeros((60, 80), np.uint8))
    with pytest.raises(InputError, match="80 × 60"):
        finder.update(np.zeros((60, 81), np.uint8))
    assert finder.update(np.zeros((60, 80), np.uint8)) == []


@pytest.mark.parametrize("shape", [(1, 1), (3, 300), (300, 3), (7, 5)])
def test_frames_of_any_shape_are_taken(shape: tuple[int, int]) -> None:
    """Thin and tiny frames, with noise and without, hold no mover and no error."""
    rng, finder = np.random.default_rng(3), MoverFinder()
    for _ in range(6):
        assert finder.update(rng.integers(0, 255, shape, dtype=np.uint8)) == []
