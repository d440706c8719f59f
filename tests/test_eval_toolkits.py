"""Other people's toolkits on our exports: the same figures as ours, and a perfect tracker is perfect.

Needs the dependency group ``toolkits``; skipped without it.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import SUITES, Sequence, render
from datasets_synthetic.export import write_got10k, write_otb, write_vot
from eval.framesource import FrameSource
from eval.metrics import frame_scores, summarise
from eval.protocol_tables import expected_overlap, precision_recall, protocol_tables
from eval.protocols import PROTOCOLS, Box, Step
from eval.regions import Mask, box_polygon, mask_of_polygons, read_region, region_iou
from eval.results import COMPLETED, Run, Trajectory
from eval.sequences import Sequence as EvalSequence
from eval.statistics import score_answers

pytestmark = pytest.mark.once

AGREE = 1e-4
"""Largest difference of a figure: got10k stores boxes with three decimals."""


@pytest.fixture(scope="module")
def suite() -> list[Sequence]:
    """Two sequences whose target goes out of sight, and a short one."""
    return [render(spec) for spec in (*SUITES["vanish"][:2], SUITES["smoke"][0])]


def answers_of(sequence: Sequence, kind: str) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Boxes and flags: the truth itself, or boxes that drift, with losses and a frame of nonsense outside."""
    boxes, ok = sequence.boxes.copy(), np.ones(len(sequence), dtype=bool)
    if kind == "drifting":
        times = np.arange(len(sequence))
        boxes += np.stack([0.2 * times - 8.0, 0.1 * times, 0.05 * times, -0.03 * times], axis=1)
        boxes[5] = (-30.0, -30.0, 60.0, 50.0)
        ok = times % 7 != 3
        boxes[0] = sequence.boxes[0]
    return boxes, ok


def held(boxes: NDArray[np.float64], ok: NDArray[np.bool_]) -> NDArray[np.float64]:
    """As a tracker must answer a toolkit."""
    found = boxes.copy()
    for index in range(1, len(found)):
        if not ok[index]:
            found[index] = found[index - 1]
    return found


def ours(sequence: Sequence, kind: str) -> dict[str, float]:
    """Our figures."""
    size = (sequence.frames.shape[2], sequence.frames.shape[1])
    return summarise(frame_scores(sequence.boxes, sequence.visibility, *answers_of(sequence, kind), size))


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["perfect", "drifting"])
def test_got10k_agrees(kind: str, suite: list[Sequence], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """AO and SR@0.5 of its experiment are our columns, pooled and per sequence; a perfect tracker scores 1."""
    experiments, trackers = pytest.importorskip("got10k.experiments"), pytest.importorskip("got10k.trackers")
    monkeypatch.setenv("MPLBACKEND", "agg")
    boxes = {}
    for sequence in suite:
        folder = write_got10k(sequence, tmp_path / "data" / "val")
        boxes[str(folder / "00000001.jpg")] = held(*answers_of(sequence, kind))

    class Replay(trackers.Tracker):  # type: ignore[misc, name-defined]
        def track(self, files: list[str], box: Any, visualize: bool = False) -> Any:
            return boxes[files[0]].copy(), np.full(len(files), 0.01)

    experiment = experiments.ExperimentGOT10k(
        str(tmp_path / "data"), "val", str(tmp_path / "results"), str(tmp_path / "reports")
    )
    experiment.run(Replay(kind, True))
    found = experiment.report([kind])[kind]
    rows = {sequence.name: ours(sequence, kind) for sequence in suite}
    for name, row in rows.items():
        assert found["seq_wise"][name]["ao"] == pytest.approx(row["ao_got10k"], abs=AGREE)
        assert found["seq_wise"][name]["sr"] == pytest.approx(row["sr50_got10k"], abs=AGREE)
    weights = [row["covered"] for row in rows.values()]
    for key, column in (("ao", "ao_got10k"), ("sr", "sr50_got10k")):
        pooled = np.average([row[column] for row in rows.values()], weights=weights)
        assert found["overall"][key] == pytest.approx(pooled, abs=AGREE)
    if kind == "perfect":
        assert found["overall"]["ao"] == pytest.approx(1.0, abs=AGREE)


@pytest.mark.parametrize("kind", ["perfect", "drifting"])
def test_otb_agrees(kind: str, suite: list[Sequence], tmp_path: Path) -> None:
    """Success and precision of its experiment, by its own functions on files that its reader finds."""
    pytest.importorskip("got10k")
    from got10k.experiments.otb import ExperimentOTB
    from got10k.utils.metrics import center_error, rect_iou

    experiment = ExperimentOTB.__new__(ExperimentOTB)
    experiment.nbins_iou, experiment.nbins_ce = 21, 51
    for sequence in suite:
        folder = write_otb(sequence, tmp_path)
        assert len(list((folder / "img").glob("*.jpg"))) == len(sequence)
        truth = np.loadtxt(folder / "groundtruth_rect.txt", delimiter=",")
        boxes = held(*answers_of(sequence, kind)) + np.array([1, 1, 0, 0])
        boxes[0] = truth[0]
        success, precision = experiment._calc_curves(rect_iou(boxes, truth), center_error(boxes, truth))
        row = ours(sequence, kind)
        assert success.mean() == pytest.approx(row["auc_otb"], abs=1e-12)
        assert precision[20] == pytest.approx(row["precision_otb"], abs=1e-12)


@pytest.mark.filterwarnings("ignore")
def test_vot_reads_what_we_write(suite: list[Sequence], tmp_path: Path) -> None:
    """Regions, tags, lengths and anchors are there; the truth overlaps with itself entirely in every frame."""
    dataset, region = pytest.importorskip("vot.dataset"), pytest.importorskip("vot.region")
    from vot.experiment.multistart import find_anchors

    for sequence in suite:
        write_vot(sequence, tmp_path)
    found = dataset.load_dataset(str(tmp_path))
    assert sorted(one.name for one in found) == sorted(sequence.name for sequence in suite)
    for sequence in suite:
        read = found[sequence.name]
        size = (sequence.frames.shape[2], sequence.frames.shape[1])
        assert (len(read), tuple(read.size)) == (len(sequence), size)
        truths = [read.groundtruth(frame) for frame in range(len(read))]
        assert min(region.calculate_overlap(truth, truth, size) for truth in truths) == 1.0
        forward, _ = find_anchors(read)
        assert forward[0] == 0
        absent = [frame for frame in range(len(read)) if "absent" in read.tags(frame)]
        assert absent == np.flatnonzero(sequence.visibility == 0).tolist()


def test_vot_agrees_on_masks_and_rotated_boxes() -> None:
    """Overlaps of its own regions. It fills a rotated box to whole pixels, of which the border may be either way."""
    region = pytest.importorskip("vot.region")
    from vot.region.shapes import Mask as TheirMask

    rng, size = np.random.default_rng(4), (128, 96)
    for _ in range(20):
        x, y, w, h = rng.integers(20, 50, 4).tolist()
        pixels = rng.random((h, w)) < 0.7
        moved = float(x + rng.integers(-9, 9)), float(y + rng.integers(-9, 9)), float(w), float(h)
        other = Mask(x + 3, y - 2, rng.random((h, w)) < 0.7)
        truth = TheirMask(pixels.astype(np.uint8), (x, y))
        answers = {
            region.Rectangle(*moved): box_polygon(moved),
            TheirMask(other.pixels.astype(np.uint8), (other.x, other.y)): other,
        }
        for theirs, own in answers.items():
            expected = region.calculate_overlap(truth, theirs, size)
            assert region_iou(Mask(x, y, pixels), own, size) == pytest.approx(expected, abs=1e-6)
        angle = rng.uniform(0, np.pi)
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        first = box_polygon((-w / 2, -h / 2, w, h)) @ turn.T + [64, 48]
        second = first + rng.uniform(-6, 6, 2)
        expected = region.calculate_overlap(region.Polygon(first.tolist()), region.Polygon(second.tolist()), size)
        assert region_iou(first, second, size) == pytest.approx(expected, abs=0.05)


@pytest.mark.filterwarnings("ignore")
def test_coco_agrees_on_masks_of_polygons() -> None:
    """But for pixels whose middle is within a fifth of one of the outline, as often inside as outside."""
    library = pytest.importorskip("pycocotools.mask")
    rng, excess, outline = np.random.default_rng(6), 0.0, 0.0
    for _ in range(60):
        count = int(rng.integers(3, 30))
        angles, radii = np.sort(rng.uniform(0.0, 2 * np.pi, count)), rng.uniform(20.0, 45.0, count)
        corners = np.stack([80 + radii * np.cos(angles), 60 + radii * np.sin(angles)], axis=1)
        expected = library.decode(library.merge(library.frPyObjects([corners.ravel().tolist()], 120, 160))) > 0
        found, inside = mask_of_polygons([corners.ravel()]), np.zeros((120, 160), dtype=bool)
        rows, columns = found.pixels.shape
        inside[found.y : found.y + rows, found.x : found.x + columns] = found.pixels
        closed = corners.astype(np.float32)[:, np.newaxis]
        for y, x in np.argwhere(inside != expected).tolist():
            assert abs(cv2.pointPolygonTest(closed, (x + 0.5, y + 0.5), True)) < 0.2
        excess += float(inside.sum()) - float(expected.sum())
        outline += cv2.arcLength(closed, True)
    assert abs(excess) / outline < 0.01


def walk(folder: Path, seed: int, count: int, kind: str) -> EvalSequence:
    """Whole boxes that wander, or discs in them; of the frames nobody sees more than their number."""
    rng = np.random.default_rng(seed)
    places = np.clip(60 + np.cumsum(rng.integers(-7, 8, (count, 2)), axis=0), 0, 100)
    boxes = np.concatenate([places, np.full((count, 2), 20)], axis=1).astype(float)
    np.save(folder / f"{seed}.npy", np.zeros((count, 1, 1), dtype=np.uint8))
    source = FrameSource((str(folder / f"{seed}.npy"),), "array", count)
    found = EvalSequence(f"walk{seed}", source, boxes, np.ones(count), (), (128, 128), "d")
    if kind == "boxes":
        return found
    disc = np.hypot(*np.mgrid[-9.5:10, -9.5:10]) < 10
    return replace(found, regions=tuple(Mask(x, y, disc).text for x, y in places.tolist()), by_region=True)


def stays_behind(truth: EvalSequence) -> Run:
    """The run that restarts make of a tracker whose box never moves, by the rules and without a process."""

    class Still:
        def __init__(self) -> None:
            count = len(truth)
            unknown = np.full((count, 4), np.nan), np.full(count, np.nan)
            self.answer = Trajectory(np.zeros(count, dtype=bool), *unknown)
            self.marks: dict[str, list[int]] = {"started": [], "failed": []}

        def begin(self, index: int, frame: object, box: Box) -> float:
            self.marks["started"].append(index)
            self.box = box
            return 0.0

        def step(self, index: int, frame: object) -> Step:
            self.answer.ok[index], self.answer.boxes[index] = True, self.box
            return Step(True, list(self.box), 0.0)

        def hold(self, index: int) -> None:
            raise AssertionError

        def mark(self, name: str, index: int) -> None:
            self.marks[name].append(index)

    still, protocol = Still(), PROTOCOLS["restarts"]
    protocol.lead(still, truth, protocol.begin(truth, 0))
    return Run("k", "Still", truth.name, 0, 0, COMPLETED, still.answer, {"digest": "d"}, "restarts", still.marks)


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("kind", ["boxes", "masks"])
def test_vot_agrees_on_restarts_and_the_long_term(kind: str, tmp_path: Path) -> None:
    """Accuracy, robustness, expected average overlap, precision and recall by its own functions on the same truth."""
    supervised, region = pytest.importorskip("vot.analysis.supervised"), pytest.importorskip("vot.region")
    from vot.analysis.longterm import compute_tpr_curves
    from vot.region.shapes import Mask as TheirMask
    from vot.tracker import Trajectory as Codes

    def theirs_of(truth: EvalSequence) -> list[Any]:
        if not truth.regions:
            return [region.Rectangle(*box) for box in truth.boxes]
        masks = [read_region(text) for text in truth.regions]
        return [TheirMask(mask.pixels.astype(np.uint8), (mask.x, mask.y)) for mask in masks if isinstance(mask, Mask)]

    truths = [walk(tmp_path, seed, count, kind) for seed, count in ((1, 120), (2, 90), (3, 160))]
    runs = [stays_behind(truth) for truth in truths]
    accuracies, failures, overlaps, ends = [], [], [], []
    for truth, run in zip(truths, runs, strict=True):
        regions = [region.Special(Codes.UNKNOWN)] * len(truth)
        for index in np.flatnonzero(run.trajectory.ok):
            regions[index] = region.Rectangle(*run.trajectory.boxes[index])
        for name, code in (("started", Codes.INITIALIZATION), ("failed", Codes.FAILURE)):
            for index in run.marks[name]:
                regions[index] = region.Special(code)
        theirs = SimpleNamespace(groundtruth=lambda truth=truth: theirs_of(truth), size=truth.size)
        accuracies.append(supervised.compute_accuracy(regions, theirs)[0])
        failures.append(supervised.count_failures(regions)[0])
        values = region.calculate_overlaps(regions, theirs.groundtruth(), truth.size)
        for number, start in enumerate(run.marks["started"]):
            failed = run.marks["failed"][number : number + 1]
            overlaps.append(values[start : failed[0] if failed else len(truth)])
            ends.append(not failed)
        score = np.linspace(1.0, 0.0, len(truth))
        precision, recall = compute_tpr_curves(
            regions[1:],
            score[1:],
            SimpleNamespace(groundtruth=lambda theirs=theirs: theirs.groundtruth()[1:], size=truth.size),
            [0.5, 0.2],
        )
        scores = score_answers(truth, run.trajectory)
        iou = (scores.finest_iou if kind == "masks" else scores.iou), score[1:], np.ones(len(truth) - 1, dtype=bool)
        ours = [precision_recall([iou], threshold) for threshold in (0.5, 0.2)]
        np.testing.assert_allclose(ours, np.transpose([precision, recall]), atol=1e-12)
    (row,) = protocol_tables(runs, truths)["restarts"].to_dict("records")
    lengths = [len(truth) for truth in truths]
    assert sum(failures) > 5
    assert row["accuracy"] == pytest.approx(np.average(accuracies, weights=lengths), abs=AGREE)
    assert row["failures"] == pytest.approx(np.average(failures, weights=lengths))
    longest = max(map(len, overlaps))
    curve = supervised.compute_eao_curve(overlaps, [1] * len(overlaps), ends)
    parts = [(np.array(part[1:]), end) for part, end in zip(overlaps, ends, strict=True)]
    np.testing.assert_allclose(expected_overlap(parts, longest - 1)[1:], curve[1:], atol=AGREE)
