"""The column TrackerHS of the behaviour table in README, cell by cell, and the machine that measures it."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest

from benchmarks.behaviour import CASES, TRACKERS, isolated, markdown, probe

GOOD = {
    "`init` returns": "None",
    "`update` returns": "(bool, int × 4)",
    "ROI of floats": "ok",
    "ROI as list, int array, NumPy ints": "ok",
    "ROI of 3 or 5 numbers": "InputError",
    "ROI `None`": "InputError",
    "ROI of zero size (cancelled `selectROI`)": "InputError",
    "ROI of negative size": "InputError",
    "ROI of 2 × 2 px": "InputError",
    "ROI fully outside": "InputError",
    "ROI partly outside": "ok, then ok",
    "ROI as large as the frame, 2 px in": "found",
    "frame of 1 px height": "init: InputError",
    "flat image": "found",
    "`update` before `init`": "InputError",
    "`update` after a failed `init`": "init: InputError, update: InputError",
    "`init` again on the same object": "ok, then found",
    "`update(None)`": "False, then found",
    "`update` of an empty image": "False, then found",
    "frame of another size": "InputError, then found",
    "frame of other channels": "InputError, then found",
    "one black frame": "False, then found",
    "one random frame": "False, then found",
    "gray (H, W)": "found",
    "gray (H, W, 1)": "found",
    "BGRA": "found",
    "uint16": "found",
    "float32, 0–1": "found",
    "int64": "found",
    "bool": "found",
    "2 channels": "init: InputError",
    "strided, read-only": "found",
    "`cv2.UMat`": "found",
    "`update` on the init frame": "(True, roi)",
    "object vanishes for 10 frames": "False in 10 of 10; back: found",
    "object vanishes after 1 update": "False in 10 of 10; back: found",
    "10 black frames": "False in 10 of 10; back: found",
    "10 black frames after 1 update": "False in 10 of 10; back: found",
    "box when False": "(0, 0, 0, 0)",
    "two runs equal": "yes",
    "pickle mid-track": "yes",
    "deepcopy mid-track": "yes",
    "`getTrackingScore()`": "in [0, 1]",
}


@pytest.mark.parametrize("case", CASES)
def test_what_trackerhs_does(case: str) -> None:
    """Every probe of the table answers as the best tracker in it, or as a note under the table says."""
    assert probe(case, "TrackerHS") == GOOD[case]


def _answer() -> str:
    return "fine"


def _crash() -> str:
    os.kill(os.getpid(), signal.SIGSEGV)
    return "unreachable"


def _hang() -> str:
    time.sleep(60)
    return "unreachable"


def _leave() -> str:
    os._exit(3)


@pytest.mark.parametrize(
    ("work", "outcome"),
    [(_answer, "fine"), (_crash, "**segfault**"), (_hang, "**hangs**"), (_leave, "**exit 3**")],
)
def test_a_probe_that_dies_costs_one_cell(work: object, outcome: str) -> None:
    """A process that answers, crashes, hangs or leaves is named as such."""
    assert isolated(work, timeout=1.0 if work is _hang else 30.0) == outcome


def test_the_table_is_markdown() -> None:
    """One row a case, one column a tracker."""
    table = {case: dict.fromkeys(TRACKERS, "x") for case in CASES}
    lines = markdown(table).splitlines()
    assert len(lines) == len(CASES) + 2
    assert {line.count("|") for line in lines} == {len(TRACKERS) + 2}


def readme_rows() -> dict[str, dict[str, str]]:
    """The table of README: case -> tracker -> outcome."""
    readme = (Path(__file__).resolve().parents[1] / "README.md").read_text(encoding="utf-8")
    head = f"| case | {' | '.join(TRACKERS)} |"
    assert head in readme
    rows = [line.strip("| ").split(" | ") for line in readme.partition(head)[2].splitlines()[2 : 2 + len(CASES)]]
    return {case.rstrip(" ¹²³"): dict(zip(TRACKERS, cells, strict=True)) for case, *cells in rows}


def test_readme_has_the_table_that_is_tested() -> None:
    """Every case is a row of README, and its last column says what the tests hold TrackerHS to."""
    rows = readme_rows()
    assert list(rows) == list(CASES)
    shown = {case: cells["TrackerHS"] for case, cells in rows.items()}
    assert shown == GOOD


@pytest.mark.parametrize(
    ("case", "trackers"),
    [
        ("ROI of floats", ["CSRT", "KCF", "MIL"]),
        ("ROI of zero size (cancelled `selectROI`)", ["KCF", "MIL"]),
        ("`init` again on the same object", ["CSRT", "KCF"]),
        ("`update(None)`", ["CSRT", "KCF"]),
        ("flat image", ["CSRT", "legacy.MedianFlow"]),
        ("int64", ["CSRT", "KCF", "MIL"]),
        ("10 black frames after 1 update", ["KCF", "legacy.MedianFlow"]),
    ],
)
def test_readme_is_true_of_the_others_too(case: str, trackers: list[str]) -> None:
    """Cells that are the same on every OpenCV from 4.8 on, measured anew; the whole table takes minutes."""
    assert {tracker: isolated(probe, case, tracker) for tracker in trackers} == {
        tracker: readme_rows()[case][tracker] for tracker in trackers
    }
