"""Protocols: who is led how, and the figures that follow by hand."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from eval.__main__ import main
from eval.accuracy import make_jobs, run_jobs
from eval.framesource import FrameSource
from eval.process import Answer, ChildError
from eval.protocol_tables import expected_overlap, precision_recall, protocol_tables
from eval.protocols import PROTOCOLS, Box, Step, find_protocol
from eval.regions import Mask, box_polygon, polygon_text
from eval.report import write_report
from eval.results import COMPLETED, Folder, Run
from eval.sequences import Sequence
from eval.tables import protocol_text, summarise_folder, write_tables
from eval.track import Track
from eval.trackers import TRACKERS, TrackerSpec

pytestmark = pytest.mark.once

COUNT, SIZE = 40, (96, 72)
SECONDS = 0.001  # what everything takes

TRUTHFUL = '''
from eval.baselines.known import Oracle

class Fails(Oracle):
    """Tells the truth, but for one frame after its start, which it answers far off."""
    def __init__(self, boxes, regions, frame):
        super().__init__(boxes, regions)
        self._wrong = frame
    def update(self, image):
        answer = super().update(image)
        return (True, (90, 66, 5, 5)) if self._frame == self._wrong else answer

class Reads:
    """Knows the frame from its gray level."""
    def init(self, image, box):
        pass
    def update(self, image):
        return True, (10 + int(image[0, 0]), 20, 20, 10)

class Breaks(Fails):
    def update(self, image):
        if self._frame == self._wrong - 1:
            raise RuntimeError("no more")
        return super().update(image)
'''


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    """Frame t has the gray level t; a box of 20 × 10 moves right by 1 px a frame."""
    (tmp_path / "frames").mkdir()
    place = tmp_path / "frames" / "levels.npy"
    levels = np.arange(COUNT, dtype=np.uint8)[:, np.newaxis, np.newaxis]
    np.save(place, np.tile(levels, (1, SIZE[1], SIZE[0])))
    boxes = np.array([[10.0 + index, 20, 20, 10] for index in range(COUNT)])
    source = FrameSource((str(place),), "array", COUNT)
    return Sequence("levels", source, boxes, np.ones(COUNT), (), SIZE, "digest")


@pytest.fixture
def truthful(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., TrackerSpec]:
    """Specs of trackers that know the truth and go wrong at a known frame."""
    (tmp_path / "truthful.py").write_text(TRUTHFUL)
    monkeypatch.syspath_prepend(str(tmp_path))

    def spec(name: str, **params: Any) -> TrackerSpec:
        return TrackerSpec(name, f"truthful:{name}", params, ("truthful",), sees_truth=True)

    return spec


class Inside:
    """In the place of a child process: the same service in this one, much sooner ready; it takes no time."""

    def __init__(self, service: str, limits: Any, **options: Any) -> None:
        self._service = Track()

    def close(self) -> None:
        """Nothing to end."""

    def ask(self, content: dict[str, Any], arrays: Any = (), *, seconds: float) -> Answer:
        """Answer, or fail, as a child does."""
        try:
            found, parts = self._service.answer(json.loads(json.dumps(content)), arrays)
        except Exception as error:
            raise ChildError(f"raised {type(error).__name__}: {error}") from error
        return Answer(dict(found), parts, SECONDS, SECONDS)


@pytest.fixture(autouse=True)
def inside(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trackers run in this process, unless a test undoes that."""
    monkeypatch.setattr("eval.accuracy.Child", Inside)


def run_all(specs: list[TrackerSpec], sequence: Sequence, folder: Folder, protocol: str) -> list[tuple[Run, bool]]:
    """Run a protocol; every run with whether it was there already."""
    found: list[tuple[Run, bool]] = []
    folder.write_manifest("suite:test", [sequence])
    jobs = make_jobs(specs, [sequence], protocol=find_protocol(protocol))
    run_jobs(jobs, folder, workers=1, report=lambda run, reused, note: found.append((run, reused)))
    return found


# --- perfect -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("protocol", list(PROTOCOLS))
def test_the_oracle_scores_exactly_one(protocol: str, sequence: Sequence, tmp_path: Path) -> None:
    """In every protocol, with boxes of any fraction and an object that goes out of sight."""
    rng = np.random.default_rng(5)
    boxes = np.concatenate([rng.uniform(5, 20, (COUNT, 2)), rng.uniform(8, 20, (COUNT, 2))], axis=1)
    visibility = np.ones(COUNT)
    visibility[12:20], visibility[20:23] = 0.0, 0.3
    folder = Folder(tmp_path / "results")
    runs = run_all([TRACKERS["Oracle"]], replace(sequence, boxes=boxes, visibility=visibility), folder, protocol)
    assert {run.status for run, _ in runs} == {COMPLETED}
    tables = protocol_tables([run for run, _ in runs], folder.read_sequences())
    (row,) = next(iter(tables.values())).to_dict("records")
    ones = {"mean_iou", "auc", "sr50", "precision20", "worst_start", "eao", "accuracy", "f", "precision", "recall"}
    assert {name: row[name] for name in ones & set(row)} == dict.fromkeys(ones & set(row), 1.0)
    assert {row.get(name, 0.0) for name in ("failures", "per_hundred", "dropped")} == {0.0}
    assert row.get("f_ok", 1.0) == 1.0


# --- other starts --------------------------------------------------------------------------------------------------


def test_boxes_of_sre_by_hand(sequence: Sequence) -> None:
    """A tenth of the size in eight directions, then four sizes about the same centre."""
    protocol = PROTOCOLS["sre"]
    boxes = [protocol.begin(sequence, start) for start in range(protocol.runs(sequence))]
    assert {index for index, _ in boxes} == {0}
    assert [box for _, box in boxes[:8]] == [
        (8, 19, 20, 10), (10, 19, 20, 10), (12, 19, 20, 10), (8, 20, 20, 10), (12, 20, 20, 10), (8, 21, 20, 10),
        (10, 21, 20, 10), (12, 21, 20, 10),
    ]  # fmt: skip
    # Edges are rounded to whole pixels, halves to even ones.
    assert [box for _, box in boxes[8:]] == [(12, 21, 16, 8), (11, 20, 18, 10), (9, 20, 22, 10), (8, 19, 24, 12)]


def test_the_static_box_of_sre_is_its_closed_form(sequence: Sequence, tmp_path: Path) -> None:
    """The box that was given stays where it was put: IoU of two rectangles, start by start."""
    runs = run_all([TRACKERS["Static"]], sequence, Folder(tmp_path / "results"), "sre")
    expected = []
    for run, _ in runs:
        x, y, w, h = run.trajectory.boxes[0]
        across = np.array([max(min(x + w, 30.0 + t) - max(x, 10.0 + t), 0.0) for t in range(1, COUNT)])
        common = across * max(min(y + h, 30.0) - max(y, 20.0), 0.0)
        expected.append(float((common / (w * h + 200.0 - common)).mean()))
    (row,) = protocol_tables([run for run, _ in runs], [sequence])["sre"].to_dict("records")
    assert (row["runs"], row["mean_iou"]) == (12, pytest.approx(np.mean(expected)))
    assert row["worst_start"] == pytest.approx(min(expected))


def test_times_of_tre_by_hand(sequence: Sequence) -> None:
    """Twenty starts at even distances, each with twenty frames to go; later where the object is hidden."""
    protocol = PROTOCOLS["tre"]

    def times(sequence: Sequence) -> list[int]:
        return [protocol.begin(sequence, start)[0] for start in range(protocol.runs(sequence))]

    assert times(sequence) == list(range(20))
    assert protocol.begin(sequence, 7) == (7, (17, 20, 20, 10))
    hidden = np.ones(COUNT)
    hidden[3:9] = 0.0
    assert times(replace(sequence, visibility=hidden)) == [0, 1, 2, *range(9, 20)]
    assert times(sequence.cut(8)) == [0]


def test_the_static_box_of_tre_is_its_closed_form(sequence: Sequence, tmp_path: Path) -> None:
    """From a later start fewer frames are left, and only they count."""
    runs = run_all([TRACKERS["Static"]], sequence, Folder(tmp_path / "results"), "tre")
    iou = np.array([max(20.0 - t, 0.0) / (20.0 + min(t, 20.0)) for t in range(1, COUNT)])
    (row,) = protocol_tables([run for run, _ in runs], [sequence])["tre"].to_dict("records")
    assert row["mean_iou"] == pytest.approx(np.mean([iou[: COUNT - 1 - start].mean() for start in range(20)]))
    assert row["worst_start"] == pytest.approx(iou.mean())


# --- restarts ------------------------------------------------------------------------------------------------------


def test_a_failure_at_a_known_frame(truthful: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path) -> None:
    """Fails 15 frames after each start: at 15 and, started again at 20, at 35; then the sequence is over."""
    folder = Folder(tmp_path / "results")
    ((run, _),) = run_all([truthful("Fails", frame=15)], sequence, folder, "restarts")
    assert run.marks == {"started": [0, 20], "failed": [15, 35]}
    assert np.flatnonzero(~run.trajectory.ok).tolist() == [16, 17, 18, 19, 36, 37, 38, 39]
    (row,) = protocol_tables([run], [sequence])["restarts"].to_dict("records")
    assert (row["accuracy"], row["failures"], row["per_hundred"]) == (1.0, 2.0, 5.0)
    # Fourteen good frames of the 39 that a sequence of this length has after its start.
    assert (row["from"], row["to"], row["eao"]) == (39, 39, pytest.approx(14 / 39))


def test_accuracy_leaves_out_what_is_easy(sequence: Sequence, tmp_path: Path) -> None:
    """The box that never moves touches the object for 19 frames: nine of them count, ten after a start do not."""
    ((run, _),) = run_all([TRACKERS["Static"]], sequence, Folder(tmp_path / "results"), "restarts")
    assert run.marks == {"started": [0, 25], "failed": [20]}
    iou = [(20 - t) / (20 + t) for t in range(COUNT)]
    (row,) = protocol_tables([run], [sequence])["restarts"].to_dict("records")
    assert row["accuracy"] == pytest.approx(np.mean([*iou[10:20], *iou[10:15]]))
    assert row["eao"] == pytest.approx(np.sum(iou[1:20]) / 39)


def test_a_restart_waits_until_the_object_is_seen(
    truthful: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """Nothing fails on what cannot be seen, and nobody starts there."""
    visibility = np.ones(COUNT)
    visibility[14:24] = 0.0
    visibility[24:26] = 0.3
    hidden = replace(sequence, visibility=visibility)
    folder = Folder(tmp_path / "results")
    ((early, _),) = run_all([truthful("Fails", frame=12)], hidden, folder, "restarts")
    assert early.marks == {"started": [0, 26], "failed": [12, 38]}
    ((blind, _),) = run_all([truthful("Fails", frame=15)], hidden, folder, "restarts")
    assert blind.marks == {"started": [0]}


def without_its_tail(sequence: Sequence, kind: str) -> Sequence:
    """The truth is a region, each box but for the four columns on its left; IoU with a still box by closed form."""
    texts = []
    for x, y, w, h in sequence.boxes.astype(int).tolist():
        mask = Mask(x + 4, y, np.ones((h, w - 4), dtype=bool)).text
        texts.append(mask if kind == "mask" else polygon_text(box_polygon((x + 4, y, w - 4, h)).ravel()))
    return replace(sequence, regions=tuple(texts), by_region=True)


TAILLESS = np.array([max(16 - t, 0) / (20 + t) for t in range(COUNT)])
"""IoU of such a region with the box of the whole object that has stood still for so many frames."""


@pytest.mark.parametrize("kind", ["mask", "polygon"])
def test_restarts_judge_regions_where_these_are_the_truth(kind: str, sequence: Sequence, tmp_path: Path) -> None:
    """A box that never moves loses the region four frames earlier than the box, which alone counts elsewhere."""
    folder = Folder(tmp_path / "results")
    ((run, _),) = run_all([TRACKERS["Static"]], without_its_tail(sequence, kind), folder, "restarts")
    assert run.marks == {"started": [0, 21], "failed": [16, 37]}
    (row,) = protocol_tables([run], folder.read_sequences())["restarts"].to_dict("records")
    assert row["accuracy"] == pytest.approx(TAILLESS[10:16].mean())
    assert row["eao"] == pytest.approx(TAILLESS[1:16].sum() / 39)
    boxes = replace(without_its_tail(sequence, kind), by_region=False)
    ((again, reused),) = run_all([TRACKERS["Static"]], boxes, folder, "restarts")
    assert not reused
    assert again.marks == {"started": [0, 25], "failed": [20]}


def test_a_region_that_is_answered_is_judged(sequence: Sequence, tmp_path: Path) -> None:
    """The oracle answers with the true masks: its box alone would have IoU 0.8 with them."""
    folder, truth = Folder(tmp_path / "results"), without_its_tail(sequence, "mask")
    for protocol, ones in (("restarts", ("accuracy", "eao")), ("long-term", ("f", "precision", "recall"))):
        ((run, _),) = run_all([TRACKERS["Oracle"]], truth, folder, protocol)
        (row,) = protocol_tables([run], [truth])[protocol].to_dict("records")
        assert [row[name] for name in ones] == [1.0] * len(ones)
        plain = replace(run, trajectory=replace(run.trajectory, regions=()))
        (row,) = protocol_tables([plain], [truth])[protocol].to_dict("records")
        assert [row[name] for name in ones] == pytest.approx([0.8] * len(ones))


def test_a_tracker_that_breaks_has_failed(
    truthful: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """It is not started again, and what is left counts as lost."""
    ((run, _),) = run_all([truthful("Breaks", frame=13)], sequence, Folder(tmp_path / "results"), "restarts")
    assert run.status == "raised RuntimeError: no more at frame 13"
    assert run.marks == {"started": [0], "failed": [13]}
    (row,) = protocol_tables([run], [sequence])["restarts"].to_dict("records")
    assert (row["failures"], row["eao"]) == (1.0, pytest.approx(12 / 39))


def test_expected_overlap_by_hand() -> None:
    """A failure goes on as zero, an end says nothing further."""
    curve = expected_overlap([(np.array([1.0, 0.5]), False), (np.array([0.5, 0.5, 0.5]), True)], 4)
    np.testing.assert_allclose(curve, [1.0, 0.75, (0.75 + 0.5) / 2, (0.5 + 0.5) / 2, 1.5 / 4])
    assert math.isnan(expected_overlap([(np.array([1.0]), True)], 2)[2])


# --- real time -----------------------------------------------------------------------------------------------------


class Recorder:
    """A walk of a tracker that answers the truth and takes a known time for it."""

    def __init__(self, sequence: Sequence, seconds: float) -> None:
        self.sequence, self.seconds = sequence, seconds
        self.given: list[int] = []
        self.held: list[int] = []
        self.marks: list[tuple[str, int]] = []

    def begin(self, index: int, frame: NDArray[Any], box: Box) -> float:
        """In no time."""
        return 0.0

    def step(self, index: int, frame: NDArray[Any]) -> Step:
        """Take down what was given."""
        self.given.append(index)
        return Step(True, self.sequence.boxes[index].tolist(), self.seconds)

    def hold(self, index: int) -> None:
        """Take down what was not given."""
        self.held.append(index)

    def mark(self, name: str, index: int) -> None:
        """Take down what happened."""
        self.marks.append((name, index))


@pytest.mark.parametrize(
    ("protocol", "seconds", "given"),
    [
        # Late three times for nothing; then each update of 2.4 frames costs the next two.
        ("realtime", 0.12, [1, 2, 3, 4, 7, 10, 13, 16, 19, 22, 25, 28, 31, 34, 37]),
        ("realtime:10", 0.12, [1, 2, 3, *range(4, COUNT, 2)]),
        # Done when the next frame comes is in time.
        ("realtime", 0.05, list(range(1, COUNT))),
        ("realtime:8", 0.12, list(range(1, COUNT))),
    ],
)
def test_frames_do_not_wait(protocol: str, seconds: float, given: list[int], sequence: Sequence) -> None:
    """Which frames a tracker of known speed gets."""
    walk = Recorder(sequence, seconds)
    led = find_protocol(protocol)
    led.lead(walk, sequence, led.begin(sequence, 0))
    assert walk.given == given
    assert walk.held == sorted(set(range(1, COUNT)) - set(given))
    assert walk.marks == [("dropped", index) for index in walk.held]


def test_what_passes_by_has_the_last_answer(
    truthful: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """At four thousand frames a second an update takes four: the box stands for three, and falls behind."""
    folder = Folder(tmp_path / "results")
    ((run, _),) = run_all([replace(truthful("Reads"), sees_truth=False)], sequence, folder, "realtime:4000")
    # The start and two updates are forgiven; the third one, of frame 3, is not.
    given = [1, 2, *range(3, COUNT, 4)]
    assert run.marks["dropped"] == sorted(set(range(1, COUNT)) - set(given))
    ages = np.array([index - max(first for first in given if first <= index) for index in range(1, COUNT)])
    np.testing.assert_array_equal(run.trajectory.boxes[1:, 0], sequence.boxes[1:, 0] - ages)
    (row,) = protocol_tables([run], [sequence])["realtime:4000"].to_dict("records")
    assert row["mean_iou"] == pytest.approx(np.mean((20.0 - ages) / (20.0 + ages)))
    assert row["dropped"] == pytest.approx((ages > 0).mean())


@pytest.mark.parametrize("kind", ["mask", "polygon"])
def test_real_time_judges_regions_where_these_are_the_truth(kind: str, sequence: Sequence, tmp_path: Path) -> None:
    """Hurried and in one pass alike, so that the two columns say what the hurry costs; without regions, boxes."""
    folder, truth = Folder(tmp_path / "results"), without_its_tail(sequence, kind)
    runs = [run for name in ("realtime", "one-pass") for run, _ in run_all([TRACKERS["Static"]], truth, folder, name)]
    (row,) = protocol_tables(runs, [truth])["realtime:20"].to_dict("records")
    assert [row["mean_iou"], row["unhurried"]] == pytest.approx([TAILLESS[1:].mean()] * 2)
    assert row["sr50"] == (TAILLESS[1:] >= 0.5).mean()
    boxes = replace(truth, by_region=False)
    (row,) = protocol_tables(runs, [boxes])["realtime:20"].to_dict("records")
    assert row["mean_iou"] == pytest.approx(np.mean([max(20 - t, 0) / (20 + t) for t in range(1, COUNT)]))


def test_what_passes_by_has_the_last_region(sequence: Sequence, tmp_path: Path) -> None:
    """The oracle's masks are held with its boxes: against a truth that stands still they are right all the time."""
    truth = without_its_tail(sequence, "mask")
    still = replace(truth, boxes=truth.boxes[[0] * COUNT], regions=truth.regions[:1] * COUNT)
    ((run, _),) = run_all([TRACKERS["Oracle"]], still, Folder(tmp_path / "results"), "realtime:4000")
    assert len(run.marks["dropped"]) > COUNT / 2
    (row,) = protocol_tables([run], [still])["realtime:4000"].to_dict("records")
    assert [row["mean_iou"], row["auc"], row["sr50"]] == [1.0] * 3


# --- long term -----------------------------------------------------------------------------------------------------


def test_precision_and_recall_by_hand() -> None:
    """Two sequences: precision over what was said, recall over what is seen, both means over sequences."""
    one = np.array([0.8, 0.6, 0.0, 0.0]), np.array([0.9, 0.4, 0.7, np.nan]), np.array([True, True, False, True])
    two = np.array([1.0, 0.0]), np.array([0.3, 0.2]), np.array([True, False])
    assert precision_recall([one, two], -np.inf) == pytest.approx(((1.4 / 3 + 0.5) / 2, (1.4 / 3 + 1.0) / 2))
    # Nothing is said of the second one.
    assert precision_recall([one, two], 0.5) == pytest.approx(((0.4 + 1.0) / 2, (0.8 / 3 + 0.0) / 2))


def test_ok_and_score_decide_about_the_long_term(sequence: Sequence, tmp_path: Path) -> None:
    """A box that never moves says True for ever: precision falls with the frames without an object."""
    visibility = np.ones(COUNT)
    visibility[20:] = 0.0
    ((run, _),) = run_all(
        [TRACKERS["Static"]], replace(sequence, visibility=visibility), Folder(tmp_path / "results"), "long-term"
    )
    truth = [replace(sequence, visibility=visibility)]
    iou = np.array([(20 - t) / (20 + t) for t in range(1, 20)])
    precision, recall = iou.sum() / 39, iou.mean()
    score = 2 * precision * recall / (precision + recall)
    (row,) = protocol_tables([run], truth)["long-term"].to_dict("records")
    assert [row[name] for name in ("precision", "recall", "f", "f_ok")] == pytest.approx(
        [precision, recall, score, score]
    )
    # Sure of itself only as long as there is something: nothing false is said from that score on.
    run.trajectory.score[1:] = np.where(visibility[1:] > 0, 0.8, 0.2)
    (row,) = protocol_tables([run], truth)["long-term"].to_dict("records")
    assert [row[name] for name in ("precision", "recall", "threshold")] == pytest.approx([recall, recall, 0.8])
    assert row["f_ok"] == pytest.approx(score)


@pytest.mark.parametrize("kind", ["mask", "polygon"])
def test_the_long_term_judges_regions_where_these_are_the_truth(
    kind: str, sequence: Sequence, tmp_path: Path
) -> None:
    """As the restarts do."""
    truth = without_its_tail(sequence, kind)
    ((run, _),) = run_all([TRACKERS["Static"]], truth, Folder(tmp_path / "results"), "long-term")
    (row,) = protocol_tables([run], [truth])["long-term"].to_dict("records")
    assert [row["precision"], row["recall"]] == pytest.approx([TAILLESS[1:].mean()] * 2)


# --- results, report, command line ---------------------------------------------------------------------------------


def test_nothing_is_led_twice(sequence: Sequence, tmp_path: Path) -> None:
    """Each protocol has results of its own, found again by key; the long-term ones are those of one pass."""
    folder = Folder(tmp_path / "results")
    for protocol in PROTOCOLS:
        again = [reused for _, reused in run_all([TRACKERS["Static"]], sequence, folder, protocol)]
        assert set(again) == {protocol == "long-term"}
    for protocol in PROTOCOLS:
        assert all(reused for _, reused in run_all([TRACKERS["Static"]], sequence, folder, protocol))
    assert not any(reused for _, reused in run_all([TRACKERS["Static"]], sequence, folder, "realtime:7"))
    assert {run.protocol for run in folder.read_runs()} == {"one-pass"}
    led = folder.read_protocol_runs()
    assert {run.protocol for run in led} == {"sre", "tre", "restarts", "realtime:20", "realtime:7"}
    jobs = [job for name in PROTOCOLS for job in make_jobs([TRACKERS["CSRT"]], [sequence], protocol=PROTOCOLS[name])]
    # 12 of SRE, 20 of TRE, and one each of one pass (which is the long-term's too), restarts and real time.
    assert len({job.key("v") for job in jobs}) == 12 + 20 + 3


def test_each_protocol_has_a_table_in_the_report(sequence: Sequence, tmp_path: Path) -> None:
    """Headings and figures are there, and in three formats."""
    folder = Folder(tmp_path / "results")
    specs = [TRACKERS["Oracle"], TRACKERS["Static"]]
    for protocol in PROTOCOLS:
        run_all(specs, sequence, folder, protocol)
    summary = summarise_folder(folder)
    write_report(summary, folder, tmp_path / "report.html", videos=0)
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    for title in ("SRE: other start boxes", "TRE: other", "Restarts after", "Real time: 20 frames", "Long-term, as"):
        assert f"<h3>{title}" in html
    assert "EAO [39–39]" in html
    names = {path.name for path in write_tables(summary, tmp_path / "tables")}
    assert {f"protocol-restarts.{kind}" for kind in ("csv", "md", "tex")} <= names
    text = protocol_text(summary.protocols["restarts"])
    assert text["A"].tolist() == ["1.000", f"{summary.protocols['restarts']['accuracy'][1]:.3f}"]
    assert text["R (failures)"].tolist() == ["0.00", "1.00"]


def test_tables_of_restarts_and_the_long_term_have_intervals(sequence: Sequence, tmp_path: Path) -> None:
    """Between scenes: of two that say the same a point, beside the figure that it is about; of one none."""
    for protocol, title in (("restarts", "EAO [39–39]"), ("long-term", "F")):
        ((run, _),) = run_all([TRACKERS["Static"]], sequence, Folder(tmp_path / protocol), protocol)
        truths = [sequence, replace(sequence, name="again", scene="again")]
        runs = [run, replace(run, sequence="again")]
        text = protocol_text(protocol_tables(runs, truths)[protocol])
        (row,) = text.to_dict("records")
        assert list(text.columns[1:3]) == [title, "95 %"]
        assert row["95 %"] == f"{row[title]}–{row[title]}"
        assert "95 %" not in protocol_text(protocol_tables([run], [sequence])[protocol])


def test_a_protocol_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """In processes of their own; it prints its table, says what does not fit, and what is missing for a report."""
    monkeypatch.undo()
    words = ["run", "--suite", "smoke", "--sequences", "smoke_move", "--trackers", "Static", "--out", str(tmp_path)]
    words += ["--frames", "12"]
    assert main([*words, "--protocol", "restarts"]) == 0
    assert "Restarts after each failure" in capsys.readouterr().out
    assert main(["report", "--out", str(tmp_path)]) == 1
    assert "run `python -m eval run` without --protocol first" in capsys.readouterr().err
    assert main([*words, "--protocol", "tre", "--starts", "2"]) == 1
    assert "expected --starts with --protocol one-pass, got it with tre" in capsys.readouterr().err
    for name in ("twopass", "realtime:", "realtime:0", "realtime:inf", "tre:20"):
        assert main([*words, "--protocol", name]) == 1
        assert f"unknown protocol {name!r}; known: one-pass, sre" in capsys.readouterr().err
