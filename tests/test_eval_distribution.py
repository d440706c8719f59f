"""Distribution suites in the referee: their numbers, frames on demand, runs that go on where they ended."""

from __future__ import annotations

import ast
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import datasets_synthetic
from datasets_synthetic import draw, parameters, render
from eval import rendered
from eval.__main__ import main
from eval.accuracy import hidden_paths
from eval.framesource import FrameSource, FrameSourceError
from eval.metrics import COUNTS
from eval.results import COMPLETED, Folder, Run, Trajectory
from eval.sequences import Sequence, SequenceError, canonical_suite, load_suite, suite_folder
from eval.statistics import calibration_error, overall
from eval.tables import overall_table, summarise_folder, theme_table, worst_table

pytestmark = pytest.mark.once

COUNT = 21
HALF = 10  # frames of which a score is sure, and right
TINY = "drawn/small:2:5"


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of kept frames for this test alone."""
    folder = tmp_path / "kept"
    folder.mkdir()
    monkeypatch.setattr(rendered, "kept_frames", lambda: folder)
    return folder


def make_folder(path: Path, ious: dict[str, float]) -> Folder:
    """Results of a tracker on sequences without frames, named theme_number, with one mean IoU each.

    In the first half of the frames the box has that IoU and the score is 0.95, in the second it is far off, at 0.35.
    """
    folder = Folder(path)
    sequences = []
    for name, iou in ious.items():
        boxes = np.tile([10.0, 10.0, 20.0, 20.0], (COUNT, 1))
        drawn = {"theme": name.rpartition("_")[0], "width": 20, name: 1.5}
        source = FrameSource(("{}", "none"), "drawn", COUNT)
        sequence = Sequence(name, source, boxes, np.ones(COUNT), (), (64, 48), f"d-{name}", drawn)
        answered = boxes.copy()
        answered[1 : HALF + 1, 3] *= iou
        answered[HALF + 1 :, 0] = 40.0
        score = np.concatenate([[np.nan], np.full(HALF, 0.95), np.full(COUNT - 1 - HALF, 0.35)])
        trajectory = Trajectory(np.ones(COUNT, dtype=bool), answered, score)
        folder.write_run(Run("k", "T", name, 0, 0, COMPLETED, trajectory, {"digest": sequence.digest}))
        sequences.append(sequence)
    folder.write_manifest("suite:drawn:1:1", sequences)
    return folder


def test_a_distribution_is_summed_up_by_its_tail_and_its_trust(tmp_path: Path) -> None:
    """Quantile, True far off, share of sure and wrong frames, and calibration error, all from constructed answers."""
    folder = make_folder(tmp_path, {"a_1": 1.0, "a_2": 0.8, "b_3": 0.4, "b_4": 0.6})
    summary = summarise_folder(folder, chosen="T")
    row = summary.overall.set_index("tracker").loc["T"]
    means = np.array([1.0, 0.8, 0.4, 0.6]) / 2
    assert row["mean_iou"] == pytest.approx(means.mean())
    assert row["q05"] == pytest.approx(np.quantile(means, 0.05))
    assert row["true_off"] == pytest.approx(0.5)
    # One of the four sequences is under 0.5 while the score is 0.95: an eighth of all frames.
    assert row["sure_wrong"] == pytest.approx(0.125)
    assert row["ece"] == pytest.approx(0.5 * abs(0.95 - 0.75) + 0.5 * abs(0.35 - 0.0))
    shown = overall_table(summary)
    assert {"5 % quantile", "True far off", "sure, wrong", "ECE"} <= set(shown.columns)


def test_worst_draws_and_themes_come_first(tmp_path: Path) -> None:
    """The worst sequence with what was drawn in it, the hardest theme with the rates of ok."""
    folder = make_folder(tmp_path, {"a_1": 1.0, "a_2": 0.8, "b_3": 0.4, "b_4": 0.6})
    summary = summarise_folder(folder, chosen="T")
    worst = worst_table(summary)
    assert list(worst["sequence"]) == ["b_3", "b_4", "a_2", "a_1"]
    assert worst["drawn"][0] == "width 20, b_3 1.5"
    assert list(worst["best other"]) == ["–"] * 4
    themes = theme_table(summary)
    assert list(themes["theme"]) == ["b", "a"]
    assert list(themes["T"]) == ["0.250", "0.450"]
    assert list(themes["least IoU"]) == ["0.200", "0.400"]
    assert list(themes["false False"]) == ["0.000", "0.000"]


def test_calibration_error_weighs_by_frames() -> None:
    """A tenth with nine times the frames counts nine times."""
    table = pd.DataFrame({"score": [0.05, 0.95], "located": [0.05, 0.45], "frames": [9, 1]})
    assert calibration_error(table) == pytest.approx(0.05)


def test_the_quantile_of_nothing_is_unknown() -> None:
    """A tracker that never had a visible frame has none."""
    row = dict.fromkeys(["mean_iou", "perturbed_iou"], float("nan"))
    pairs = pd.DataFrame([{"tracker": "T", "sequence": "s", "scene": "s", "failed": 0, **row}])
    pairs = pairs.assign(**{name: np.nan for name in overall(pairs.iloc[:0]).columns if name not in pairs})
    assert np.isnan(overall(pairs.assign(**dict.fromkeys(COUNTS, 0.0)))["q05"][0])


def test_frames_are_rendered_when_asked_for_and_kept(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading renders nothing; the frames are those of the laboratory, the second time from the disk."""
    found = load_suite(TINY)
    assert not list(kept.iterdir())
    assert hidden_paths(found[0]) == [kept]
    spec = draw("small", 5, 0)
    assert found[0].theme == "small"
    assert found[0].parameters == parameters(spec)
    sequence = render(spec)
    np.testing.assert_array_equal(np.stack(list(found[0].frames)), sequence.frames)
    np.testing.assert_array_equal(found[0].boxes, sequence.boxes)
    np.testing.assert_array_equal(found[0].visibility, sequence.visibility)
    monkeypatch.setattr(rendered, "_render", None)
    np.testing.assert_array_equal(next(iter(found[0].frames)), sequence.frames[0])


def test_kept_frames_have_a_limit(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was used longest ago goes, what was just written stays, whatever its size."""
    first, second = load_suite(TINY)
    monkeypatch.setattr(rendered, "_GIGABYTES", 1e-6)
    next(iter(first.frames))
    next(iter(second.frames))
    assert [path.stem for path in kept.iterdir()] == [second.digest]
    assert next(iter(first.frames)).shape[:2] == first.size[::-1]


def test_a_disk_without_room_costs_nothing_but_time(kept: Path) -> None:
    """Where nothing can be kept, the frames are rendered."""
    kept.rmdir()
    kept.write_text("a file where the folder was")
    sequence = load_suite(TINY)[0]
    assert len(list(sequence.frames)) == len(sequence)


def test_a_laboratory_that_draws_otherwise_is_noticed(kept: Path) -> None:
    """Frames that do not belong to the stored truth are an error, not a wrong score."""
    sequence = load_suite(TINY)[0]
    text, digest = sequence.frames.paths
    with pytest.raises(FrameSourceError, match="renders small_5_0 otherwise than it did"):
        next(iter(replace(sequence.frames, paths=(text, "0" * 16))))
    with pytest.raises(FrameSourceError, match="SequenceSpec"):
        next(iter(replace(sequence.frames, paths=("[]", digest))))


def test_the_modules_that_make_pixels_are_those_that_rendering_imports() -> None:
    """Results are keyed by neither more nor less than what they depend on; specs are in the key themselves."""
    folder, found, open_ = Path(datasets_synthetic.__file__).parent, set(), {"render"}
    while open_:
        name = open_.pop()
        found.add(name)
        tree = ast.parse((folder / f"{name}.py").read_text(encoding="utf-8"))
        imports = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.level == 1]
        open_ |= {str(node.module) for node in imports} - found
    assert found - {"plain", "spec", "sequence"} == set(rendered.RENDERERS)


def test_names_of_folders_hold_kind_and_seed() -> None:
    """Draws of one seed share their results, whatever their number; the clock's seed is in the name."""
    assert suite_folder("standard") == "standard"
    assert suite_folder("drawn:300:7") == suite_folder("drawn:20:7") == "drawn-7"
    assert suite_folder("drawn/pan:20:7") == "drawn-pan-7"
    assert suite_folder(canonical_suite("drawn:3:clock")).startswith("drawn-1")
    with pytest.raises(SequenceError, match="unknown theme 'storm'"):
        canonical_suite("drawn/storm:3:1")


def test_a_distribution_from_the_command_line(
    tmp_path: Path, kept: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Run, run more of the same seed, report: nothing is run or rendered twice, and the worst draws are shown."""
    command = ["run", "--trackers", "MOSSE", "--jobs", "1", "--out", str(tmp_path / "out"), "--suite"]
    assert main([*command, TINY]) == 0
    assert "worst of MOSSE" in capsys.readouterr().out
    written = {path.name for path in kept.iterdir()}
    assert len(written) == 2
    shutil.rmtree(kept)
    kept.mkdir()
    assert main([*command, "drawn/small:3:5"]) == 0
    assert len(list(kept.iterdir())) == 1
    assert not written & {path.name for path in kept.iterdir()}
    assert main(["report", "--out", str(tmp_path / "out"), "--suite", "drawn/small:2:5", "--chosen", "MOSSE"]) == 0
    text = (tmp_path / "out" / "drawn-small-5" / "report.html").read_text(encoding="utf-8")
    assert "The worst draws of MOSSE" in text
    assert "Mean IoU per theme" in text
    assert text.count('<img class="sheet"') == 3
    worst = pd.read_csv(tmp_path / "out" / "drawn-small-5" / "tables" / "worst.csv")
    assert {"sequence", "mean_iou", "speed", "ground"} <= set(worst.columns)


def test_a_seed_of_the_clock_is_said(tmp_path: Path, kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The command prints how to get the same sequences again."""
    command = ["run", "--trackers", "MOSSE", "--out", str(tmp_path / "out"), "--suite", "drawn/small:1:clock"]
    assert main(command) == 0
    (folder,) = (tmp_path / "out").iterdir()
    seed = folder.name.removeprefix("drawn-small-")
    assert f"--suite drawn/small:1:{seed}" in " ".join(capsys.readouterr().out.split())
