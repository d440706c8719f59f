"""Sweeps: one parameter is set, all else stays as it was drawn, and the figures are those of the frames."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from numpy.typing import NDArray

from datasets_synthetic import SWEEPS, SequenceSpec, parameters, suite
from eval import rendered
from eval.__main__ import main
from eval.framesource import FrameSource
from eval.metrics import MIN_VISIBILITY, iou_per_frame
from eval.protocols import misplaced, start_box
from eval.regions import Mask, read_region
from eval.results import COMPLETED, Folder, Run, Trajectory
from eval.sequences import Sequence, SequenceError
from eval.sweep import Grid, sweep_sequences, sweep_table, sweep_text

pytestmark = pytest.mark.once

DRAWS = "drawn:8:3"
COUNT = 21


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("noise=0:20:5", (0.0, 5.0, 10.0, 15.0, 20.0)),
        ("noise=0:9:4", (0.0, 4.0, 8.0)),
        ("contrast=1:0.7:-0.1", (0.7, 0.8, 0.9, 1.0)),
        ("box=0:0.3:0.1", (0.0, 0.1, 0.2, 0.3)),
        ("rotation=10,0,-10", (-10.0, 0.0, 10.0)),
        ("speed=3", (3.0,)),
    ],
)
def test_values_are_read(text: str, values: tuple[float, ...]) -> None:
    """Both ends are in it, and they are told from the least to the greatest."""
    assert Grid.parse(text).values == values


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("fog=0:1:1", "unknown parameter 'fog'; known: noise, rotation, speed, size, contrast, blur, compression"),
        ("noise", "expected NAME=FIRST:LAST:STEP or NAME=VALUE,VALUE, got 'noise'"),
        ("noise=0:20", "expected NAME=FIRST:LAST:STEP or NAME=VALUE,VALUE, got 'noise=0:20'"),
        ("noise=0:a:2", "expected NAME=FIRST:LAST:STEP or NAME=VALUE,VALUE, got 'noise=0:a:2'"),
        ("noise=0:20:-2", "expected a step from 0 towards 20, got -2"),
        ("noise=0:20:0", "expected a step from 0 towards 20, got 0"),
        ("noise=0:20:0.01", "expected at most 100 values, got 2001"),
        ("noise=0:200:50", "expected noise, grey levels .* in 0–100, got 150"),
        ("compression=0,50", "expected JPEG quality in 1–100, got 0"),
        ("box=0.7", "expected error of the start box, box sizes in 0–0.6, got 0.7"),
    ],
)
def test_what_cannot_be_swept_is_said(text: str, message: str) -> None:
    """The bad word, and what was expected."""
    with pytest.raises(ValueError, match=message):
        Grid.parse(text)


def swept(name: str, value: float, draws: str = DRAWS) -> tuple[SequenceSpec, ...]:
    """Specs with a parameter set."""
    return suite(draws, change=SWEEPS[name].setting(value))


def effects(spec: SequenceSpec, kind: str) -> list[float]:
    """Strengths of a picture effect."""
    return [effect.strength for effect in spec.effects if effect.kind == kind]


def test_each_parameter_is_what_it_was_set_to() -> None:
    """In every draw, whatever its theme had drawn."""
    assert all(effects(spec, "noise") == [7.0] for spec in swept("noise", 7.0))
    assert all(effects(spec, "jpeg") == [30.0] for spec in swept("compression", 30.0))
    assert all(effects(spec, "haze") == [0.75] for spec in swept("contrast", 0.25))
    assert all(spec.camera.shutter == 0.5 for spec in swept("blur", 0.5))
    assert all(spec.target.motion.spin == 4.0 for spec in swept("rotation", 4.0))
    assert all(spec.target.motion.hidden == ((20, 35),) and spec.frames >= 60 for spec in swept("occlusion", 15.0))
    assert all(spec.target.motion.hidden == () for spec in swept("occlusion", 0.0))
    for spec in swept("size", 24.0):
        assert max(spec.target.size) == pytest.approx(24.0 * spec.size[0] / 320.0, abs=0.02)


def test_the_speed_is_that_of_the_picture() -> None:
    """Pixels per frame of the target, as the laboratory itself measures it, without what shakes or grows."""
    found = [parameters(spec) for spec in swept("speed", 2.0, "drawn/straight:12:3")]
    shaken = {"jitter", "zoom", "roll", "pan", "rests"}
    plain = [
        float(one["speed"]) * 320.0 / float(str(one["frame"]).split("x")[0])
        for one in found
        if shaken.isdisjoint(one) and one["path"] == "line"
    ]
    assert len(plain) >= 3
    np.testing.assert_allclose(plain, 2.0, atol=0.1)


def test_all_else_is_as_it_was_drawn() -> None:
    """What light and camera add changes nothing but itself."""
    for spec, noisy in zip(suite(DRAWS), swept("noise", 50.0), strict=True):
        kept = tuple(effect for effect in spec.effects if effect.kind != "noise")
        assert replace(noisy, effects=kept) == replace(spec, effects=kept)
    for spec, blurred in zip(suite(DRAWS), swept("blur", 1.0), strict=True):
        assert replace(blurred, camera=spec.camera) == spec


def test_every_draw_has_every_value() -> None:
    """Draw by draw, each value under a name and a digest of its own; one draw is one scene."""
    found = sweep_sequences(Grid.parse("noise=0,10"), "drawn:2:3")
    assert [sequence.parameters["swept"] for sequence in found] == [0.0, 10.0, 0.0, 10.0]
    assert len({sequence.name for sequence in found}) == len({sequence.digest for sequence in found}) == 4
    assert found[0].name == f"{found[0].scene}@noise=0"
    assert found[0].scene == found[1].scene != found[2].scene
    np.testing.assert_array_equal(found[0].boxes, found[1].boxes)
    with pytest.raises(SequenceError, match=r"expected drawn:N:SEED .* to sweep over, got 'standard'"):
        sweep_sequences(Grid.parse("noise=0,10"), "standard")


def test_a_start_box_is_wrong_by_what_was_asked() -> None:
    """Position and size are off by that share, in the same directions at every value."""
    boxes = np.tile([400.0, 300.0, 200.0, 100.0], (COUNT, 1))
    source = FrameSource(("none",), "array", COUNT)
    directions = {}
    for name in "abcdefgh":
        sequence = Sequence(name, source, boxes, np.ones(COUNT), (), (1000, 800), "d")
        assert misplaced(0.0).begin(sequence, 0) == (0, (400, 300, 200, 100))
        for error in (0.1, 0.2):
            _, (x, y, w, h) = misplaced(error).begin(sequence, 0)
            off = np.array([(x + w / 2 - 500) / 200, (y + h / 2 - 350) / 100, w / 200 - 1, h / 100 - 1])
            np.testing.assert_allclose(np.abs(off), error, atol=0.0101)
            signs = tuple(np.sign(off).tolist())
            assert directions.setdefault(name, signs) == signs
    assert len(set(directions.values())) > 1


def led(name: str, value: float, iou: float, false: int, tracker: str = "T") -> tuple[Sequence, Run]:
    """A draw at a value: a tracker of constant IoU that says False in the last `false` frames."""
    boxes = np.tile([10.0, 10.0, 20.0, 20.0], (COUNT, 1))
    source = FrameSource(("none",), "array", COUNT)
    digest = f"{name}{value}"
    sequence = Sequence(f"{name}@{value:g}", source, boxes, np.ones(COUNT), (), (64, 48), digest, {"swept": value})
    answered = boxes.copy()
    answered[1:, 3] *= iou
    ok = np.arange(COUNT) < COUNT - false
    trajectory = Trajectory(ok, answered, np.full(COUNT, np.nan))
    return sequence, Run("k", tracker, sequence.name, 0, 0, COMPLETED, trajectory, {"digest": digest})


def test_figures_of_a_sweep_by_hand() -> None:
    """Means over draws with their intervals, frames pooled for what is answered falsely; strangers are left out."""
    grid = Grid("noise", "noise", (0.0, 10.0))
    found = [led("a", 0.0, 0.8, 0), led("b", 0.0, 0.6, 5), led("a", 10.0, 0.5, 10), led("a", 20.0, 0.9, 0)]
    sequences, runs = [one for one, _ in found], [run for _, run in found]
    table = sweep_table(grid, [*runs, replace(runs[0], start=1)], sequences)
    assert table["value"].tolist() == [0.0, 10.0]
    assert table["draws"].tolist() == [2, 1]
    # A frame said to be lost has IoU 0.
    np.testing.assert_allclose(table["mean_iou"], [(0.8 + 0.6 * 15 / 20) / 2, 0.25])
    np.testing.assert_allclose(table["false"], [5 / 40, 0.5])
    assert table["low"][0] < table["mean_iou"][0] < table["high"][0]
    assert table["false_low"][0] < 0.125 < table["false_high"][0]
    text = sweep_text(table, grid)
    assert text["mean IoU"]["noise"].tolist() == ["0", "10"]
    assert text["mean IoU"]["T"].tolist()[1] == "0.250"
    assert text["false answers"]["T"].tolist()[1] == "0.500"


def test_a_sweep_from_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Table and plot are written; what has been run is not run again, more values come on top."""
    kept = tmp_path / "kept"
    kept.mkdir()
    monkeypatch.setattr(rendered, "kept_frames", lambda: kept)
    words = ["sweep", "noise=0,40", "--suite", "drawn/small:1:5", "--trackers", "Static", "--out", str(tmp_path)]
    assert main(words) == 0
    assert "mean IoU against noise, grey levels (deviation), on drawn/small:1:5" in capsys.readouterr().out
    folder = tmp_path / "sweep-noise-drawn-small-5"
    table = pd.read_csv(folder / "tables" / "sweep.csv")
    assert table["value"].tolist() == [0.0, 40.0]
    # The box that never moves does not look at the frames.
    assert table["mean_iou"].nunique() == 1
    assert (folder / "plots" / "sweep.pdf").read_bytes().startswith(b"%PDF")
    assert r"\caption" in (folder / "tables" / "sweep-mean-IoU.tex").read_text(encoding="utf-8")
    written = {path: path.stat().st_mtime_ns for path in folder.glob("tracks/*/*.json")}
    assert len(written) == 2
    words[1] = "noise=0,20,40"
    assert main(words) == 0
    again = {path: path.stat().st_mtime_ns for path in folder.glob("tracks/*/*.json")}
    assert len(again) == 3
    assert written.items() <= again.items()
    words[1] = "box=0,0.2"
    assert main(words) == 0
    boxes = pd.read_csv(tmp_path / "sweep-box-drawn-small-5" / "tables" / "sweep.csv")
    assert boxes["value"].tolist() == [0.0, 0.2]
    assert boxes["mean_iou"][0] == table["mean_iou"][0] != boxes["mean_iou"][1]


# --- every parameter, from the command line to the table -------------------------------------------------------


def gray(sequence: Sequence) -> NDArray[np.float64]:
    """Frames as a tracker gets them, in gray."""
    return np.stack([frame.mean(axis=2) for frame in sequence.frames])


def of_noise(quiet: Sequence, noisy: Sequence) -> None:
    """What is added spreads by twenty levels, where it is not cut off."""
    before, after = (next(iter(one.frames)).astype(float) for one in (quiet, noisy))
    middle = (before > 80) & (before < 175)
    assert (after - before)[middle].std() == pytest.approx(20.0, rel=0.05)


def of_rotation(still: Sequence, turning: Sequence) -> None:
    """Longest axes of the true masks turn by ten degrees a frame."""

    def turns(sequence: Sequence) -> NDArray[np.float64]:
        masks = [read_region(text) for text in sequence.regions]
        spreads = [np.cov(np.argwhere(mask.pixels).T) for mask in masks if isinstance(mask, Mask)]
        axes = np.array([np.degrees(np.arctan2(2 * one[0, 1], one[1, 1] - one[0, 0])) / 2 for one in spreads])
        return np.asarray((np.diff(axes) + 90) % 180 - 90)

    assert np.median(turns(still)) == pytest.approx(0.0, abs=0.5)
    assert np.median(turns(turning)) == pytest.approx(10.0, abs=0.5)


def of_speed(slow: Sequence, fast: Sequence) -> None:
    """Middles of the true boxes step by one and three pixels."""
    for sequence, step in ((slow, 1.0), (fast, 3.0)):
        middles = sequence.boxes[:, :2] + sequence.boxes[:, 2:] / 2
        assert np.median(np.hypot(*np.diff(middles, axis=0).T)) == pytest.approx(step, abs=0.02)


def of_size(small: Sequence, large: Sequence) -> None:
    """The longer side of the true box."""
    for sequence, side in ((small, 20.0), (large, 40.0)):
        assert sequence.boxes[0, 2:].max() == pytest.approx(side, abs=0.5)


def of_contrast(pale: Sequence, full: Sequence) -> None:
    """A quarter of the spread, but for noise."""
    assert gray(pale)[0].std() / gray(full)[0].std() == pytest.approx(0.25, abs=0.05)


def of_blur(sharp: Sequence, blurred: Sequence) -> None:
    """An object that goes ten pixels a frame loses its edges, and stays where it was."""
    x, y, w, h = sharp.boxes[10].astype(int)
    slopes = [np.abs(np.diff(gray(one)[10, y : y + h, x : x + w], axis=1)).mean() for one in (sharp, blurred)]
    assert slopes[1] < 0.7 * slopes[0]
    np.testing.assert_array_equal(sharp.boxes, blurred.boxes)


def of_compression(poor: Sequence, good: Sequence) -> None:
    """Blocks of eight have borders that are steeper than what is in them."""
    for sequence, least, most in ((poor, 3.0, np.inf), (good, 0.0, 1.3)):
        steps = np.abs(np.diff(gray(sequence)[0], axis=1))
        assert least < steps[:, 7::8].mean() / steps[:, 3::8].mean() < most


def of_occlusion(seen: Sequence, hidden: Sequence) -> None:
    """From frame 20 on nothing is to be seen for fifteen frames."""
    assert np.flatnonzero(seen.visibility == 0).size == 0
    assert np.flatnonzero(hidden.visibility == 0).tolist() == list(range(20, 35))


EFFECTS: dict[str, tuple[tuple[float, float], str, Callable[[Sequence, Sequence], None]]] = {
    "noise": ((0, 20), "straight:1:2", of_noise),
    "rotation": ((0, 10), "straight:1:2", of_rotation),
    "speed": ((1, 3), "straight:1:2", of_speed),
    "size": ((20, 40), "straight:1:2", of_size),
    "contrast": ((0.25, 1), "straight:1:2", of_contrast),
    "blur": ((0, 1), "fast:1:2", of_blur),
    "compression": ((5, 95), "straight:1:2", of_compression),
    "occlusion": ((0, 15), "straight:1:2", of_occlusion),
}
"""Of each parameter two values, a draw to see them on, and what has to be seen."""


@pytest.mark.parametrize("parameter", list(SWEEPS))
def test_every_parameter_reaches_frames_and_table(
    parameter: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The frames that trackers were given show the value, and the figures are those of a box that never moves."""
    values, draw, shows = EFFECTS[parameter]
    (tmp_path / "kept").mkdir()
    monkeypatch.setattr(rendered, "kept_frames", lambda: tmp_path / "kept")
    words = ["sweep", f"{parameter}={values[0]},{values[1]}", "--suite", f"drawn/{draw}", "--trackers", "Static"]
    assert main([*words, "--out", str(tmp_path)]) == 0
    (place,) = tmp_path.glob(f"sweep-{parameter}-*")
    sequences = Folder(place).read_sequences()
    assert [sequence.parameters["swept"] for sequence in sequences] == [float(value) for value in values]
    shows(*sequences)
    table = pd.read_csv(place / "tables" / "sweep.csv")
    assert table["value"].tolist() == [float(value) for value in values]
    for sequence, (_, row) in zip(sequences, table.iterrows(), strict=True):
        still = np.tile(np.array(start_box(sequence, 0), dtype=float), (len(sequence), 1))
        iou, seen = iou_per_frame(sequence.boxes, still, sequence.size)[1:], sequence.visibility[1:] >= MIN_VISIBILITY
        gone = sequence.visibility[1:] == 0
        assert row["mean_iou"] == pytest.approx(iou[seen].mean())
        # True in every frame: wrong where the object is gone, or elsewhere.
        assert row["false"] == pytest.approx((gone | (seen & (iou < 0.1))).sum() / (gone | seen).sum())
