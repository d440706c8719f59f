"""From result files to tables, figures and the report: nothing runs, nothing is lost, every number is right."""

from __future__ import annotations

import re
import shutil
import subprocess
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import cv2
import numpy as np
import pandas as pd
import pytest

from eval import report
from eval.__main__ import COMMANDS, main
from eval.framesource import FrameSource
from eval.latex import latex_table
from eval.plots import as_svg, before_loss_plot
from eval.regression import compare, update
from eval.report import write_figures, write_report
from eval.results import COMPLETED, Folder, ResultsError, Run, SpeedRun, Trajectory
from eval.sequences import Sequence
from eval.statistics import (
    differences,
    mean_ranks,
    median_known,
    overall,
    per_attribute,
    score_before_loss,
    score_frames,
    speed_table,
)
from eval.tables import (
    Summary,
    brief_table,
    overall_table,
    sequence_table,
    speed_overall_text,
    summarise_folder,
    write_tables,
)
from eval.trackers import TRACKERS, TrackerSpec

pytestmark = pytest.mark.once

COUNT, SIZE = 20, (96, 72)
STAMP = {
    "tracker": "a:b",
    "params": {},
    "code": "c0de",
    "commit": "abc",
    "opencv": "4.13",
    "python": "3.11",
    "machine": "m",
    "time": "2026-01-01",
}


def make_sequence(folder: Path, name: str, attributes: tuple[str, ...]) -> Sequence:
    """Noise, a box that moves right by 1 px per frame, two frames without it at the end."""
    frames = np.random.default_rng(5).integers(0, 255, (COUNT, SIZE[1], SIZE[0], 3), dtype=np.uint8)
    np.save(folder / f"{name}.npy", frames)
    boxes = np.array([[10.0 + index, 20, 20, 16] for index in range(COUNT)])
    visibility = np.ones(COUNT)
    visibility[-2:] = 0.0
    source = FrameSource((str(folder / f"{name}.npy"),), "array", COUNT)
    return Sequence(name, source, boxes, visibility, attributes, SIZE, f"digest-{name}")


def make_run(tracker: str, sequence: Sequence, shift: float, *, status: str = COMPLETED, start: int = 0) -> Run:
    """A tracker that is off by `shift` px throughout, and true to its score."""
    boxes = sequence.boxes + np.array([shift, 0, 0, 0])
    score = np.clip(np.linspace(1.0, 0.0, COUNT), 0, 1)
    trajectory = Trajectory(np.ones(COUNT, dtype=bool), boxes, score)
    stamp = {**STAMP, "digest": sequence.digest}
    return Run(f"{tracker}{start}", tracker, sequence.name, start, 0, status, trajectory, stamp)


@pytest.fixture
def folder(tmp_path: Path) -> Folder:
    """Results of three trackers on two sequences: exact, 4 px off, and 10 px off with a failure."""
    found = Folder(tmp_path / "results" / "tiny")
    sequences = [make_sequence(tmp_path, "one", ("fast", "gray")), make_sequence(tmp_path, "two_b", ("fast",))]
    found.write_manifest("suite:tiny", sequences)
    for sequence in sequences:
        found.write_run(make_run("Exact", sequence, 0.0))
        found.write_run(make_run("Exact", sequence, 4.0, start=1))
        found.write_run(make_run("Near", sequence, 4.0))
        found.write_run(make_run("pkg.mod:Far", sequence, 10.0, status="crashed (SIGSEGV) at frame 3"))
        times = {"Exact": [1.0, 2.0, 3.0], "CSRT": [10.0, 20.0, 30.0]}
        found.write_speed(SpeedRun("k", sequence.name, times, times, {"Exact": COMPLETED, "CSRT": COMPLETED}, STAMP))
    return found


@pytest.fixture
def summary(folder: Folder) -> Summary:
    """Everything in numbers."""
    return summarise_folder(folder, chosen="Near")


def test_a_report_of_trackers_that_have_not_run_says_so(folder: Folder) -> None:
    """One that was asked for is not left out without a word; the message says what there is."""
    with pytest.raises(ResultsError, match=r"of Nope, Absent in .*tiny .*runs of Exact, Near, pkg\.mod:Far$"):
        summarise_folder(folder, trackers=["Near", "Nope", "Absent"])


def test_a_run_comes_back_as_it_was_written(folder: Folder, tmp_path: Path) -> None:
    """Files lose nothing, NaN included."""
    sequence = make_sequence(tmp_path, "one", ())
    run = make_run("Gaps", sequence, 0.125)
    run.trajectory.boxes[3] = np.nan
    run.trajectory.score[4] = np.nan
    folder.write_run(run)
    found = folder.read_run(folder.run_path("Gaps", "one", 0, 0))
    np.testing.assert_array_equal(found.trajectory.boxes, run.trajectory.boxes)
    np.testing.assert_array_equal(found.trajectory.ok, run.trajectory.ok)
    np.testing.assert_allclose(found.trajectory.score, run.trajectory.score, atol=1e-6)
    assert (found.key, found.provenance) == (run.key, run.provenance)


def test_the_overall_table_is_right(summary: Summary) -> None:
    """Means over sequences, sorted; the rates of ok by frames; the failure is counted; speed beside CSRT."""
    table = summary.overall.set_index("tracker")
    assert list(table.index) == ["Exact", "Near", "pkg.mod:Far"]
    assert table.loc["Exact", "mean_iou"] == 1.0
    assert table.loc["Near", "mean_iou"] == pytest.approx(16 / 24)
    assert table.loc["Exact", "perturbed_iou"] == pytest.approx(16 / 24)
    assert table.loc["Near", "false_true"] == 1.0
    assert list(table["failed"]) == [0, 0, 2]
    assert table.loc["Exact", "fps"] == pytest.approx(500.0)
    assert table.loc["Exact", "ratio"] == pytest.approx(10.0)
    assert table.loc["Exact", "low"] == table.loc["Exact", "high"] == 1.0


def test_texts_are_made_for_reading(summary: Summary) -> None:
    """Three digits, a dash where nothing is known, no column without anything in it."""
    shown = overall_table(summary)
    assert shown["mean IoU"].tolist() == ["1.000", "0.667", "0.333"]
    assert shown["fps"].tolist() == ["500", "–", "–"]
    assert sequence_table(summary)["sequence"].tolist() == ["one", "two_b"]


def test_results_on_another_version_of_a_sequence_do_not_count(folder: Folder, tmp_path: Path) -> None:
    """When the sequence has changed since, its old runs are left out and not scored against another truth."""
    sequences = folder.read_sequences()
    folder.write_manifest("suite:tiny", [replace(sequences[0], digest="other"), sequences[1]])
    assert set(summarise_folder(folder).scores["sequence"]) == {"two_b"}


def test_a_folder_without_results_is_said(tmp_path: Path) -> None:
    """The message says what to run."""
    with pytest.raises(ResultsError, match=r"no results in .*: run `python -m eval run` first"):
        summarise_folder(Folder(tmp_path))


def pairs_of(scores: dict[str, list[float]]) -> pd.DataFrame:
    """Per-sequence table from bare scores."""
    rows = [
        {"tracker": tracker, "sequence": f"s{index}", "scene": f"s{index}", "mean_iou": value}
        for tracker, values in scores.items()
        for index, value in enumerate(values)
    ]
    return pd.DataFrame(rows)


def test_differences_are_paired() -> None:
    """Won, lost and even by 0.02; the worst loss by name; the sign says who is better."""
    table = differences(pairs_of({"A": [0.9, 0.5, 0.70], "B": [0.8, 0.8, 0.71]}), "A")
    row = table.iloc[0]
    assert row["difference"] == pytest.approx((0.1 - 0.3 - 0.01) / 3)
    assert (row["won"], row["lost"], row["even"], row["worst_sequence"]) == (1, 1, 1, "s1")
    assert row["low"] <= row["difference"] <= row["high"]


def test_attributes_group_sequences(summary: Summary) -> None:
    """Each attribute has the mean over its sequences and says how many there are."""
    table = per_attribute(summary.pairs, summary.sequences).set_index("attribute")
    assert table["sequences"].to_dict() == {"fast": 2, "gray": 1}
    assert table.loc["gray", "Near"] == pytest.approx(16 / 24)


def test_trackers_are_ranked_by_the_sequences_that_all_have_run() -> None:
    """A tracker that has run the easy ones only gains nothing by it; without common ones each has its own."""
    from eval.metrics import COUNTS, METRICS

    pairs = pairs_of({"A": [0.9, 0.5, 0.1], "B": [0.8, 0.6, 0.2]}).assign(failed=0, perturbed_iou=np.nan)
    pairs = pairs.assign(**{name: 0.5 for name in (*METRICS, *COUNTS) if name != "mean_iou"})
    partial = pairs.drop(pairs.index[(pairs["tracker"] == "A") & (pairs["sequence"] == "s2")])
    table = overall(partial).set_index("tracker")
    assert table["sequences"].tolist() == [2, 2]
    assert table["mean_iou"].to_dict() == {"A": pytest.approx(0.7), "B": pytest.approx(0.7)}
    disjoint = pairs[(pairs["tracker"] == "A") == (pairs["sequence"] == "s0")]
    assert overall(disjoint).set_index("tracker")["sequences"].to_dict() == {"A": 1, "B": 2}


def test_many_comparisons_have_wider_intervals() -> None:
    """Each interval is as wide as it must be for all of them to be right together."""
    own, other = [0.9, 0.5, 0.70, 0.6], [0.8, 0.4, 0.65, 0.4]
    one = differences(pairs_of({"A": own, "B": other}), "A").iloc[0]
    many = differences(pairs_of({"A": own, **{f"B{k}": other for k in range(10)}}), "A")
    assert one["low"] > 0
    assert (many["low"] < 0).all()
    assert many["difference"].to_numpy() == pytest.approx(one["difference"])


def test_sequences_of_one_scene_are_one_proof() -> None:
    """A lead on six sequences of one camera is a lead in one scene: nothing is known of others."""
    own, other = [0.9, 0.8, 0.7, 0.9, 0.8, 0.7, 0.6], [0.5, 0.4, 0.2, 0.5, 0.4, 0.3, 0.6]
    pairs = pairs_of({"A": own, "B": other})
    row = differences(pairs, "A").iloc[0]
    assert (row["low"] > 0, row["scenes"], row["p"]) == (True, 7, pytest.approx(2 / 64))
    pairs["scene"] = pairs["sequence"].where(pairs["sequence"] == "s6", "camera")
    row = differences(pairs, "A").iloc[0]
    assert (row["low"] < 0, row["scenes"], row["p"]) == (True, 2, 1.0)


def test_p_values_are_corrected_for_their_number() -> None:
    """Eight sequences that all say the same, three rivals: Holm takes three times 2/256, and all are equal."""
    table = differences(pairs_of({"A": [0.9] * 8, **{name: [0.5] * 8 for name in "BCD"}}), "A")
    assert table["p"].tolist() == pytest.approx([3 * 2 / 256] * 3)
    alone = differences(pairs_of({"A": [0.9] * 8, **{name: [0.5] * 8 for name in "BCD"}}), "A", together=False)
    assert alone["p"].tolist() == pytest.approx([2 / 256] * 3)


def test_the_oracle_is_no_rival_and_no_difference_is_more_than_one() -> None:
    """It takes no share of the correction; of two scenes the formula would reach from −3 to 4."""
    scores = {"A": [0.9, 0.9], "B": [0.1, 0.8], "Oracle": [1.0, 1.0]}
    table = differences(pairs_of(scores), "A")
    assert table["other"].tolist() == ["B"]
    assert (table["low"].iloc[0], table["high"].iloc[0]) == (-1.0, 1.0)


def test_a_tracker_that_has_run_by_a_protocol_only_is_there(folder: Folder, tmp_path: Path) -> None:
    """It has a row in the table of that, and none in those of one pass."""
    restarted = replace(make_run("Again", make_sequence(tmp_path, "one", ()), 0.0), protocol="restarts")
    folder.write_run(restarted)
    summary = summarise_folder(folder, trackers=["Near", "Again"])
    assert set(summary.overall["tracker"]) == {"Near"}
    assert set(summary.protocols["restarts"]["tracker"]) == {"Again"}


def test_one_of_a_kind_is_not_counted_as_many(tmp_path: Path) -> None:
    """Of a single sequence the report says so in the singular, on its page and under its tables."""
    found = Folder(tmp_path / "results" / "single")
    sequence = make_sequence(tmp_path, "one", ())
    found.write_manifest("suite:single", [sequence])
    for name, shift in (("Exact", 0.0), ("Near", 4.0)):
        found.write_run(make_run(name, sequence, shift))
    summary = summarise_folder(found, chosen="Near")
    write_report(summary, found, tmp_path / "report.html")
    write_tables(summary, tmp_path / "tables")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "over 1 of 1 sequence;" in page
    assert "over 1 scene of suite:single, too few" in page
    texts = [page, *(path.read_text(encoding="utf-8") for path in (tmp_path / "tables").glob("*.tex"))]
    assert not [text for text in texts if re.search(r"\b1 (scenes|sequences|trackers)\b", text)]


def test_mean_ranks_say_what_chance_cannot() -> None:
    """Ties share their rank, sequences of one scene have one, the oracle none; B and C are not told apart."""
    count = 12
    scores = {"A": [0.9] * count, "B": [0.5, 0.4] * 6, "C": [0.4, 0.5] * 6, "Oracle": [1.0] * count}
    table, critical = mean_ranks(pairs_of(scores))
    assert table["tracker"].tolist() == ["A", "B", "C"]
    assert table["rank"].tolist() == [1.0, 2.5, 2.5]
    assert critical == pytest.approx(2.343 * np.sqrt(3 * 4 / (6 * count)), abs=1e-3)
    assert table["like"].tolist() == ["", "C", "B"]
    one = pairs_of(scores).assign(scene="camera")
    table, critical = mean_ranks(one)
    assert table["like"].tolist() == ["B, C", "A, C", "A, B"]
    assert np.isnan(critical)
    assert mean_ranks(pairs_of({"A": [0.5], "B": [0.5]}))[0]["rank"].tolist() == [1.5, 1.5]


def test_rates_of_ok_weigh_by_frames() -> None:
    """Ten invisible frames of one sequence count ten times as much as one of another."""
    from eval.metrics import METRICS

    rows = pd.DataFrame(
        [{"tracker": "A", "sequence": name, "scene": name, "failed": 0, "perturbed_iou": np.nan} for name in "xy"]
    )
    rows = rows.assign(**dict.fromkeys(METRICS, 0.5)).assign(
        visible=[10.0, 10.0], invisible=[10.0, 1.0], covered=10.0
    )
    rows["false_true"] = [1.0, 0.0]
    assert overall(rows)["false_true"].iloc[0] == pytest.approx(10 / 11)


def test_speed_is_summed_up_by_median_and_tail() -> None:
    """One slow update moves the 95th percentile and not the median."""
    times = [1.0] * 19 + [100.0]
    table = speed_table([SpeedRun("k", "s", {"A": times, "B": []}, {"A": times, "B": []}, {}, {})])
    assert table["tracker"].tolist() == ["A"]
    assert table["median"].iloc[0] == 1.0
    assert table["p95"].iloc[0] == pytest.approx(np.percentile(times, 95))


def test_speed_per_tracker_is_told_against_the_rival() -> None:
    """Frames per second and the ratio to CSRT are medians over sequences, the least ratio is the least."""
    times = {"x": (1.0, 5.0), "y": (2.0, 4.0), "z": (4.0, 36.0)}
    runs = [SpeedRun("k", name, {"A": [own], "CSRT": [rival]}, {}, {}) for name, (own, rival) in times.items()]
    table = speed_overall_text([replace(run, wall=run.milliseconds) for run in runs])
    assert table.to_numpy().tolist() == [["A", "500", "2.00", "5.0", "2.0"], ["CSRT", "200", "5.00", "1.0", "1.0"]]


def test_the_terminal_has_what_decides(summary: Summary) -> None:
    """Trackers, mean IoU with its interval and failures, and nothing of other toolkits' columns."""
    table = brief_table(summary)
    assert table.columns[:3].tolist() == ["tracker", "mean IoU", "95 %"]
    assert "failed" in table
    assert not [name for name in table.columns if "(" in name]
    assert len(table) == len(summary.overall)


def test_tables_are_written_in_three_formats(summary: Summary, tmp_path: Path) -> None:
    """CSV can be read back with all digits, Markdown and LaTeX hold the same rows, with their signs escaped."""
    paths = {path.name: path for path in write_tables(summary, tmp_path / "tables")}
    back = pd.read_csv(paths["overall.csv"])
    assert back["mean_iou"].tolist() == summary.overall["mean_iou"].tolist()
    assert paths["overall.md"].read_text().count("\n") == 5
    assert "| Near " in paths["overall.md"].read_text()
    latex = paths["sequences.tex"].read_text()
    assert r"two\_b & \textbf{1.000} & 0.667 & 0.333 \\" in latex
    assert latex.count(r"\\") == 3
    assert r"\caption{Mean IoU per sequence of suite:tiny.}" in latex
    assert not any(re.search(r"\bnan\b", path.read_text()) for path in paths.values())


def test_the_best_of_each_column_is_bold() -> None:
    """Highest or lowest, as the column is to be read; equals both, test doubles and counts never."""
    cells = [["Oracle", "9", "1.000", "0.000"], ["A", "9", "0.500", "0.200"], ["B", "3", "0.500", "0.100"]]
    table = pd.DataFrame(cells, columns=["tracker", "n", "mean IoU", "false True"])
    lines = [line for line in latex_table(table, caption="c", label="l", rivals="rows").split("\n") if " & " in line]
    assert lines[1:] == [
        r"Oracle & 9 & 1.000 & 0.000 \\",
        r"A & 9 & \textbf{0.500} & 0.200 \\",
        r"B & 3 & \textbf{0.500} & \textbf{0.100} \\",
    ]


def test_what_is_too_wide_to_be_read_goes_on_in_another_table() -> None:
    """Every column once, the names of the rows in each part; words are flush left, numbers right."""
    table = pd.DataFrame({"tracker": ["A", "B"], **{f"metric {k:02}": ["0.500", "0.123"] for k in range(20)}})
    table["like"] = ["B", "A"]
    text = latex_table(table, caption="c", label="l", rivals="rows")
    heads = [line.removesuffix(r" \\").split(" & ") for line in text.split("\n") if line.startswith("tracker")]
    assert [name for head in heads for name in head[1:]] == list(table.columns[1:])
    assert {head[0] for head in heads} == {"tracker"}
    assert max(sum(map(len, head)) for head in heads) <= 100
    assert text.count(r"\textbf{0.500}") == 20
    assert re.findall(r"@\{\}(\w+)@", text)[-1].endswith("rl")


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="needs a LaTeX")
def test_latex_compiles_without_overfull_boxes(summary: Summary, tmp_path: Path) -> None:
    """The tables of a report, and a long, wide one of every sign, long words and paragraphs."""
    files = [path for path in write_tables(summary, tmp_path) if path.suffix == ".tex"]
    hard = pd.DataFrame({f"column {number} ±10 %": ["0.123–0.456"] * 90 for number in range(30)})
    hard.insert(0, "name", [r"a_b&c#d$e{f}g\h~i^j<k>l≥m≤n×o−p→q¹" for _ in range(90)])
    hard["taken"] = "Größe … λ 追跡"
    hard["drawn"] = "speckle 1.5, an_unbroken_word_of_some_length 3, ground clouds, " * 4
    (tmp_path / "hard.tex").write_text(latex_table(hard, caption="50 % of a_b", label="hard"), encoding="utf-8")
    inputs = "\n".join(rf"\input{{{path.name}}}" for path in (*files, tmp_path / "hard.tex"))
    packages = r"\usepackage{array, booktabs, graphicx}"
    text = rf"\documentclass{{article}}{packages}\begin{{document}}{inputs}\end{{document}}"
    (tmp_path / "all.tex").write_text(text, encoding="utf-8")
    command = ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "all.tex"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, errors="replace")
    assert done.returncode == 0, done.stdout[-2000:]
    assert "Overfull" not in done.stdout


def test_figures_are_written_as_svg_and_pdf(summary: Summary, tmp_path: Path) -> None:
    """Both formats of each figure that the results allow."""
    paths = write_figures(summary, tmp_path / "plots")
    names = {"success", "precision", "speed", "reliability", "loss"}
    assert {path.name for path in paths} == {f"{name}.{kind}" for name in names for kind in ("svg", "pdf")}
    assert all(path.read_bytes().startswith(b"%PDF") for path in paths if path.suffix == ".pdf")
    assert all("<svg" in path.read_text(encoding="utf-8") for path in paths if path.suffix == ".svg")


class _Page(HTMLParser):
    """Gathers what a page refers to and what it says."""

    def __init__(self) -> None:
        super().__init__()
        self.sources: list[str] = []
        self.text = ""

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [value or "" for name, value in attrs if name in ("src", "href") and tag != "use"]

    def handle_data(self, data: str) -> None:
        self.text += data


def test_the_report_is_one_file_with_everything(
    summary: Summary, folder: Folder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It refers to nothing but its pages; tables, figures, pictures and the reasons are in it, videos beside them."""
    monkeypatch.setitem(TRACKERS, "Near", TrackerSpec("Near", "a:b", note="is never far"))
    path = tmp_path / "report.html"
    write_report(summary, folder, path, videos=1)
    html = path.read_text(encoding="utf-8")
    page = _Page()
    page.feed(html)
    links = [source for source in page.sources if not source.startswith(("data:", "#"))]
    assert sorted(links) == ["pages/one.html", "pages/two_b.html"]
    assert all((tmp_path / link).exists() for link in links)
    assert sum(source.startswith("data:image/jpeg") for source in page.sources) == 2
    assert len(list((tmp_path / "pages").glob("*.webm"))) == 1
    assert html.count("<svg") == 5
    assert "Near: mean IoU 0.667" in page.text
    assert "crashed (SIGSEGV) at frame 3" in page.text
    assert "Frame 0 is given to the tracker and is not scored." in page.text
    assert "c0de" in page.text
    assert "m, Python 3.11, OpenCV 4.13, commit abc." in page.text
    scoring = page.text.partition("How it is scored")[2].partition("Where the figures")[0]
    assert "It is invisible when nothing can be seen" in scoring
    assert "false True is the share of the invisible frames" in scoring
    head = page.text.partition("Overall")[2].partition("Curves")[0]
    assert "false True" in head
    assert "Near is never far." in head
    assert "false False: not said to be where it is seen" in head
    assert "Reliability of the score" in page.text
    assert "The score round a loss" in page.text
    assert not re.search(r"[*`]|:data:", scoring)
    assert not re.search(r"\bnan\b", page.text)


def test_the_first_sentence_counts_scenes_where_sequences_share_them(summary: Summary) -> None:
    """Of two sequences that are one scene there is no interval, and that is why."""
    assert "over 2 of 2 sequences; the best" in report._sentence(summary)
    shared = replace(summary, overall=summary.overall.assign(scenes=1))
    assert "over 2 of 2 sequences, which show 1 scene; the best" in report._sentence(shared)


def test_results_of_mixed_origin_are_said(summary: Summary, folder: Folder, tmp_path: Path) -> None:
    """What differs between trackers is a column, and both origins of one tracker stand in its cell."""
    run = summary.scored[0].run
    folder.write_run(replace(run, provenance={**run.provenance, "opencv": "5.0"}))
    write_report(summarise_folder(folder, chosen="Near"), folder, tmp_path / "report.html", videos=0)
    page = _Page()
    page.feed((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert "m, Python 3.11, commit abc." in page.text
    assert "5.0, 4.13" in page.text or "4.13, 5.0" in page.text


def test_the_score_round_a_loss_has_a_row_per_sequence(tmp_path: Path) -> None:
    """Each row is the score round the first frame without the target; the plot shows every row and their median."""
    sequences = [make_sequence(tmp_path, name, ()) for name in ("one", "two")]
    runs = [make_run("A", sequence, 0.0) for sequence in sequences]
    runs[1].trajectory.score[:] /= 2
    rounds = score_before_loss(score_frames(runs, sequences), before=5, after=3)["A"]
    # Visible up to frame 17; frame 0 is not scored.
    expected = np.append(np.linspace(1.0, 0.0, COUNT)[13:20], [np.nan] * 2)
    np.testing.assert_allclose(rounds, [expected, expected / 2])
    np.testing.assert_allclose(median_known(rounds)[:3], 0.75 * expected[:3])
    svg = as_svg(before_loss_plot({"A": rounds}, "A", before=5))
    assert "A, 2 losses" in svg
    assert svg != as_svg(before_loss_plot({"A": rounds[:1]}, "A", before=5))


def test_the_report_does_without_frames_speed_and_scores(folder: Folder, tmp_path: Path) -> None:
    """A report can be made where the data set is not, and before speed was measured."""
    for path in (*tmp_path.glob("*.npy"), *folder.path.glob("speed/*")):
        path.unlink()
    summary = summarise_folder(folder, trackers=["Near"])
    write_report(summary, folder, tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text()
    assert "not on this machine any more" in html
    assert "fps" not in html


def test_the_picture_shows_truth_and_answer(folder: Folder) -> None:
    """White and the tracker's colour are there, where the boxes are."""
    from eval.overlay import contact_sheet

    sequence = folder.read_sequences()[0]
    run = make_run("Near", sequence, 8.0)
    sheet = contact_sheet(sequence, {"Near": run}, {"Near": "#ff0000"}, count=3)
    zoom = 240 / SIZE[1]
    assert sheet.shape[0] == 240
    column = round((sequence.boxes[1, 0] + 8.0) * zoom)
    row = round((sequence.boxes[1, 1] + 8.0) * zoom)
    assert tuple(sheet[row, column]) == (0, 0, 255)
    assert tuple(sheet[row, round(sequence.boxes[1, 0] * zoom)]) == (255, 255, 255)


def test_the_video_holds_every_frame(folder: Folder, tmp_path: Path) -> None:
    """The WebM can be decoded and is as long as the sequence."""
    from eval.overlay import write_video

    sequence = folder.read_sequences()[0]
    write_video(tmp_path / "a.webm", sequence, {}, {})
    capture = cv2.VideoCapture(str(tmp_path / "a.webm"))
    count = 0
    while capture.read()[0]:
        count += 1
    capture.release()
    assert count == COUNT


def test_regression_notices_a_fall(tmp_path: Path) -> None:
    """One sequence by more than 0.02, or the mean by more than 0.005; less passes, and so does better."""
    path = tmp_path / "smoke.json"
    update(path, "T", {"a": 0.90, "b": 0.80})

    def passes(**scores: float) -> bool:
        return compare(path, "T", scores).passed

    assert passes(a=0.90, b=0.80)
    assert passes(a=0.885, b=0.81)
    assert passes(a=0.95, b=0.85)
    assert not passes(a=0.87, b=0.85)
    assert not passes(a=0.89, b=0.79)
    assert not passes(a=0.90)
    assert compare(path, "T", {"a": 0.87, "b": 0.85}).table["verdict"].tolist() == ["FELL", "rose", "rose"]


def test_regression_says_what_is_wrong_with_its_file(tmp_path: Path) -> None:
    """Missing, damaged, somebody else's: each has its message."""
    path = tmp_path / "smoke.json"
    with pytest.raises(ResultsError, match="write them with `python -m eval check --update`"):
        compare(path, "T", {})
    path.write_text("{")
    with pytest.raises(ResultsError, match=r"smoke\.json is damaged"):
        compare(path, "T", {})
    update(path, "T", {"a": 0.5})
    with pytest.raises(ResultsError, match="holds the figures of T, not of U"):
        compare(path, "U", {"a": 0.5})


@pytest.mark.parametrize(
    "words",
    [
        ["run", "--jobs", "0"], ["run", "--jobs", "-1"], ["run", "--starts", "-1"], ["speed", "--frames", "0"],
        ["speed", "--block", "0"], ["flow", "--pairs", "0"], ["flow", "--repeats", "0"], ["mot", "--jobs", "0"],
        ["sweep", "noise=0,1", "--jobs", "0"], ["ablate", "--jobs", "0"], ["check", "--jobs", "0"],
        ["bench", "--repeats", "0"], ["report", "--videos", "-1"],
    ],
)  # fmt: skip
def test_numbers_that_cannot_be_meant_are_refused(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The option is named, with what it takes; nothing is written."""
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(words)
    assert stop.value.code == 2
    said = " ".join(capsys.readouterr().err.replace("│", " ").split())
    assert words[-2] in said
    least = 0 if words[-2] in {"--starts", "--videos"} else 1
    assert f"expected at least {least}, got {words[-1]}" in said
    assert list(tmp_path.iterdir()) == []


def test_every_command_explains_itself(capsys: pytest.CaptureFixture[str]) -> None:
    """Without arguments the commands are listed, and each has its own help."""
    assert main(["--help"]) == 0
    listed = capsys.readouterr().out
    assert all(name in listed for name in COMMANDS)
    assert main(["nonsense"]) == 2
    assert "unknown command 'nonsense'" in capsys.readouterr().err
    for name in COMMANDS:
        with pytest.raises(SystemExit) as ended:
            main([name, "--help"])
        assert ended.value.code == 0


def test_the_whole_way_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Run, speed and report on a folder in OTB layout end with a table and the path of the report."""
    images = tmp_path / "data" / "tiny" / "img"
    images.mkdir(parents=True)
    for index in range(8):
        cv2.imwrite(str(images / f"{index + 1:04d}.png"), np.full((48, 64, 3), 10 * index, dtype=np.uint8))
    lines = [f"{11 + index},11,20,10" for index in range(8)]
    (images.parent / "groundtruth_rect.txt").write_text("\n".join(lines))
    common = ["--dataset", f"otb:{tmp_path / 'data'}", "--out", str(tmp_path / "out")]
    assert main(["run", *common, "--trackers", "Static", "Oracle", "--starts", "2"]) == 0
    assert main(["speed", *common, "--trackers", "Static", "CSRT", "--frames", "2", "--block", "1"]) == 0
    assert main(["report", "--out", str(tmp_path / "out"), "--chosen", "Oracle"]) == 0
    printed = capsys.readouterr().out
    assert "mean IoU per sequence of otb:" in printed
    assert str(tmp_path / "out" / "otb-data" / "report.html") in printed.replace("\n", "")
    tables = tmp_path / "out" / "otb-data" / "tables"
    assert (tables / "overall.tex").exists()
    shutil.rmtree(tables)
    # A data set is named as it was run, whatever its folder of results is called; also without its kind.
    assert main(["report", "--out", str(tmp_path / "out"), "--suite", "smoke"]) == 1
    said = capsys.readouterr().err
    assert said == f"error: no results of suite:smoke in {tmp_path / 'out'}; there are: otb-data\n"
    assert main(["report", "--out", str(tmp_path / "out"), "--dataset", f"otb:{tmp_path}"]) == 1
    assert not tables.exists()
    for name in (f"otb:{tmp_path / 'data'}", str(tmp_path / "data")):
        assert main(["report", "--out", str(tmp_path / "out"), "--dataset", name, "--chosen", "Oracle"]) == 0
        shutil.rmtree(tables)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "--trackers", "Nobody"], "error: unknown tracker 'Nobody'; known: TrackerHS"),
        (["run", "--suite", "nothing"], "error: unknown suite 'nothing'; known: "),
        (["run", "--suite", "smoke", "--dataset", "otb:/x"], "error: expected --suite or --dataset, got both"),
        (["run", "--suite", "smoke", "--sequences", "x"], "error: unknown sequence x in suite:smoke; known: "),
        (["run", "--dataset", "otb:/no/folder"], "error: no such folder: /no/folder"),
        (["report", "--out", "/no/folder"], "error: no results in /no/folder"),
        (["report", "--out", "/no/folder", "--suite", "smoke"], "error: no results in /no/folder"),
    ],
)
def test_errors_are_one_line(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    """No traceback: what was wrong, and what is known."""
    assert main(arguments) == 1
    assert capsys.readouterr().err.startswith(message)


@pytest.mark.parametrize("content", ["", "{", "[]", '{"sequences": 5}', "\x00\x01", "[" * 20_000])
@pytest.mark.parametrize("name", ["run.json", "sequences/one.json", "tracks/Exact/one.s0r0.json", "speed/one.json"])
def test_a_damaged_file_of_any_kind_is_one_clear_line(
    name: str, content: str, folder: Folder, capsys: pytest.CaptureFixture[str]
) -> None:
    """The report names the file and what to do, makes no table of what is left, and ends with 1."""
    path = folder.path / name
    assert path.is_file(), sorted(folder.path.rglob("*.json"))
    path.write_text(content)
    assert main(["report", "--out", str(folder.path.parent)]) == 1
    said = capsys.readouterr()
    assert said.err.startswith(f"error: {path} is damaged (")
    assert "delete it and run again" in said.err
    assert said.err.count("\n") == 1
    assert not (folder.path / "tables").exists()


def test_a_full_disk_at_the_end_is_one_clear_line(
    folder: Folder, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tables and report that cannot be written are named with the reason."""

    def full(self: Path, *arguments: object, **options: object) -> int:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    assert main(["report", "--out", str(folder.path.parent)]) == 1
    said = capsys.readouterr().err
    assert said.startswith("error: cannot write ")
    assert said.endswith(": No space left on device\n")
