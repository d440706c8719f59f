"""The ablation table: surgery that reaches its part, and a table that says what it cost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from eval.__main__ import main
from eval.ablation import ABLATIONS, WHOLE, Cut, ablated, specs
from hs_tracker_cv import TrackerHS_create

CUTS = [pytest.param(cut, id=f"{name}-{cut.module}") for name, part in ABLATIONS.items() for cut in part.cuts]


class Tripwire:
    """Raises as soon as it is used."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:  # noqa: D102
        raise AssertionError("reached")

    def __index__(self) -> int:
        raise AssertionError("reached")

    def __getattr__(self, name: str) -> Any:
        raise AssertionError("reached")


@pytest.fixture(scope="module")
def frames() -> list[NDArray[np.uint8]]:
    """A textured disc on a textured ground."""
    rng = np.random.default_rng(3)
    ground = cv2.GaussianBlur(rng.integers(0, 255, (120, 160, 3), np.uint8), (0, 0), 1.5)
    disc = cv2.GaussianBlur(rng.integers(0, 255, (40, 40, 3), np.uint8), (0, 0), 1.0)
    inside = np.hypot(*(np.mgrid[:40, :40] - 19.5)) < 19
    found = []
    for t in range(6):
        frame = ground.copy()
        frame[40:80, 30 + 2 * t : 70 + 2 * t][inside] = disc[inside]
        found.append(frame)
    return found


def follow(tracker: Any, frames: list[NDArray[np.uint8]]) -> list[Any]:
    """Answers from the true box on."""
    tracker.init(frames[0], (30, 40, 40, 40))
    return [tracker.update(frame) for frame in frames[1:]]


def forget_solvers() -> None:
    """Drop the flow solvers that the modes keep per thread: they outlive the surgery."""
    for module, name in (("layers.motion", "_LOCAL"), ("propagation.tracking", "_local")):
        getattr(import_module(f"hs_tracker_cv.{module}"), name).__dict__.clear()


@pytest.fixture
def restored(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Undo the surgery of an ablation after the test."""

    def note(name: str) -> None:
        forget_solvers()
        for cut in ABLATIONS[name].cuts:
            place = import_module(f"hs_tracker_cv.{cut.module}")
            monkeypatch.setattr(place, cut.name, getattr(place, cut.name))

    yield note
    forget_solvers()


@pytest.mark.parametrize("cut", CUTS)
def test_every_cut_reaches_what_a_tracker_uses(
    cut: Cut, frames: list[NDArray[np.uint8]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The replaced part is used by a tracker in its first frames: no row of the table is without effect."""
    follow(TrackerHS_create(), frames)
    forget_solvers()
    monkeypatch.setattr(import_module(f"hs_tracker_cv.{cut.module}"), cut.name, Tripwire())
    with pytest.raises(AssertionError, match="reached"):
        follow(TrackerHS_create(), frames)


@pytest.mark.parametrize("name", ABLATIONS)
def test_an_ablated_tracker_still_tracks(
    name: str, frames: list[NDArray[np.uint8]], restored: Callable[[str], None]
) -> None:
    """What is left of the tracker answers every frame with a flag and a box."""
    restored(name)
    for ok, box in follow(ablated(name), frames):
        assert isinstance(ok, bool)
        assert len(box) == 4


def test_whole_is_the_tracker_itself(frames: list[NDArray[np.uint8]]) -> None:
    """The row that the others are compared with is the tracker as users get it."""
    assert follow(ablated(WHOLE), frames) == follow(TrackerHS_create(), frames)


def test_unknown_parts_are_named() -> None:
    """A part that does not exist is an error that lists those that do."""
    with pytest.raises(ValueError, match="no-edge"):
        specs(("no-brain",))
    with pytest.raises(ValueError, match="no-brain"):
        ablated("no-brain")


def test_the_command_prints_and_stores_a_table(tmp_path: Any, capfd: pytest.CaptureFixture[str]) -> None:
    """One part on one sequence: a row for the whole, one for the part, and the files of the table."""
    arguments = ["ablate", "--suite", "smoke", "--sequences", "smoke_move", "--parts", "layers-only"]
    assert main([*arguments, "--out", str(tmp_path)]) == 0
    table = (tmp_path / "ablation-smoke" / "tables" / "ablation.md").read_text(encoding="utf-8")
    assert "whole" in table
    assert "segmentation always" in table
    assert "segmentation always" in capfd.readouterr().out
