"""The ablation table: surgery that reaches its part, and a table that says what it cost."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from datasets_synthetic import SUITES, render
from datasets_synthetic.export import write_otb
from eval.__main__ import main
from eval.ablation import ABLATIONS, WHOLE, Cut, ablated, ablation_changes, ablation_table, specs
from eval.tables import Summary
from hs_tracker_cv import TrackerHS_create

CUTS = [pytest.param(cut, id=f"{name}-{cut.module}") for name, part in ABLATIONS.items() for cut in part.cuts]


class Tripwire:
    """Raises as soon as it is used."""

    def __call__(self, *arguments: Any, **options: Any) -> Any:  # noqa: D102
        raise AssertionError("reached")

    def __index__(self) -> int:
        raise AssertionError("reached")

    def __iter__(self) -> Iterator[Any]:
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
    for module, name in (("segmentation.motion", "_LOCAL"), ("patch_tracker.tracking", "_local")):
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
    # A native kernel refuses it by its type before it can raise.
    with pytest.raises((AssertionError, TypeError), match=r"reached|Invoked with types.*Tripwire"):
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


def summary_of(kind: str, ious: dict[str, list[float]]) -> Summary:
    """Means of a whole tracker and of ablated ones on some sequences of a kind."""
    rows = [
        {
            "tracker": tracker,
            "sequence": f"{kind}_{number}",
            "scene": f"{kind}_{number}",
            "mean_iou": value,
            "failed": 0,
        }
        for tracker, values in ious.items()
        for number, value in enumerate(values)
    ]
    pairs = pd.DataFrame(rows).reindex(columns=["tracker", "sequence", "scene", "mean_iou", "failed"])
    means = pairs.groupby("tracker", sort=False)["mean_iou"].agg(sequences="size", mean_iou="mean").reset_index()
    empty = pd.DataFrame()
    sequences: list[Any] = [None] * len(ious[WHOLE])
    found = (empty, pairs, means, empty, empty, empty, np.nan, empty, empty, empty)
    return Summary(kind, sequences, [], *found, {}, WHOLE)


def test_a_part_pays_where_the_whole_interval_is_below_zero() -> None:
    """A column per kind; what pays on one of them is said, what pays on none has a dash."""
    first = {WHOLE: [0.9, 0.8, 0.9], "no-keys": [0.7, 0.62, 0.7], "no-edge": [0.9, 0.85, 0.88], "no-gain": [0.9] * 3}
    second = {WHOLE: [0.5, 0.6], "no-keys": [0.6, 0.6], "no-edge": [0.5, 0.6]}
    table = ablation_table({"drawn-7": summary_of("a", first), "vanish": summary_of("b", second)})
    assert list(table.columns) == ["room", "off or replaced", "drawn-7 (3)", "vanish (2)", "pays on", "where"]
    rows = table.set_index("off or replaced")
    assert list(rows.loc[WHOLE])[1:3] == ["0.867", "0.550"]
    keys = rows.loc[ABLATIONS["no-keys"].title]
    assert keys["drawn-7 (3)"].startswith("-0.193 (-0.222 to -0.165)")
    assert keys["vanish (2)"].startswith("+0.050 (-0.585 to +0.685)")
    assert keys["pays on"] == "drawn-7"
    assert keys["where"] == "a_0 -0.20, a_2 -0.20, a_1 -0.18; b_0 +0.10"
    assert rows.loc[ABLATIONS["no-edge"].title, "pays on"] == "–"
    assert rows.loc[ABLATIONS["no-gain"].title, "vanish (2)"] == "–"
    assert len(table) == 4


def test_the_numbers_of_the_table_have_a_row_per_part_and_kind() -> None:
    """Long form, to be computed with."""
    first = {WHOLE: [0.9, 0.8], "no-keys": [0.7, 0.7]}
    numbers = ablation_changes({"drawn-7": summary_of("a", first), "vanish": summary_of("b", first)})
    row = numbers.set_index(["part", "kind"]).loc[("no-keys", "vanish")]
    assert row["change"] == pytest.approx(-0.15)
    # Student's t: two values say little.
    assert row["low"] == pytest.approx(-0.15 - 12.7062 * 0.05, abs=1e-4)
    assert row["high"] == pytest.approx(-0.15 + 12.7062 * 0.05, abs=1e-4)
    assert row["sequences"] == 2


def test_the_command_prints_and_stores_a_table_with_a_column_per_kind(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """One part on a suite and on a listed sequence of a data set: rows for the whole and the part, and the files."""
    spec = replace(SUITES["smoke"][0], frames=12)
    for name in ("first", "second"):
        write_otb(render(replace(spec, name=name)), tmp_path / "real")
    (tmp_path / "names.txt").write_text("# chosen\nsecond\n\n", encoding="utf-8")
    arguments = ["ablate", "--suite", "drawn/small:1:4", "--dataset", f"otb:{tmp_path / 'real'}"]
    arguments += ["--sequences", f"@{tmp_path / 'names.txt'}", "--frames", "6", "--parts", "segmentation-only"]
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 0
    table = (tmp_path / "out" / "ablation" / "ablation.md").read_text(encoding="utf-8")
    assert "drawn-small-4 (1)" in table
    assert "otb-real (1)" in table
    assert "segmentation always" in table
    assert "segmentation always" in capfd.readouterr().out
    numbers = pd.read_csv(tmp_path / "out" / "ablation" / "ablation.csv")
    assert set(numbers["part"]) == {WHOLE, "segmentation-only"}


def test_a_list_of_names_that_is_not_there_is_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The file is named."""
    assert main(["run", "--suite", "smoke", "--sequences", f"@{tmp_path / 'nothing.txt'}"]) == 1
    assert "nothing.txt" in capsys.readouterr().err
