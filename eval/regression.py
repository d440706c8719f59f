"""Scores against committed reference figures: a change that makes tracking worse does not pass unseen."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from .accuracy import make_jobs, run_jobs
from .metrics import summarise
from .results import COMPLETED, Folder, ResultsError, Run, Trajectory, provenance
from .sequences import Sequence
from .statistics import score_answers
from .trackers import TrackerSpec

__all__ = ["REFERENCE", "SEQUENCE_TOLERANCE", "SUITE_TOLERANCE", "Comparison", "compare", "measure", "update"]

REFERENCE = Path(__file__).parent / "reference"
SEQUENCE_TOLERANCE = 0.02
"""Largest fall of one sequence's mean IoU."""
SUITE_TOLERANCE = 0.005
"""Largest fall of a suite's mean."""


@dataclass(frozen=True)
class Comparison:
    """Scores beside the reference figures.

    Parameters
    ----------
    table : DataFrame
        One row per sequence and a last one for the suite: `sequence`, `reference`, `now`, `change`, `verdict`.
    passed : bool
    """

    table: pd.DataFrame
    passed: bool


def measure(
    tracker: TrackerSpec, sequences: list[Sequence], *, workers: int = 2, advance: Callable[[], None] | None = None
) -> dict[str, float]:
    """Mean IoU of a tracker on each sequence, run here and now.

    Raises
    ------
    ResultsError
        If a run did not go through; the message gives its status.
    """
    runs: list[Run] = []

    def collect(run: Run, reused: bool, note: str) -> None:
        runs.append(run)
        if advance is not None:
            advance()

    with tempfile.TemporaryDirectory(prefix="hs_check-") as scratch:
        run_jobs(make_jobs([tracker], sequences), Folder(Path(scratch)), workers=workers, report=collect)
    failed = [f"{run.sequence}: {run.status}" for run in runs if run.status != COMPLETED]
    if failed:
        raise ResultsError(f"{tracker.name} did not go through: {'; '.join(failed)}")
    by_name = {run.sequence: run.trajectory for run in runs if run.repeat == 0}
    return {sequence.name: _mean_iou(sequence, by_name[sequence.name]) for sequence in sequences}


def _mean_iou(sequence: Sequence, trajectory: Trajectory) -> float:
    return round(summarise(score_answers(sequence, trajectory))["mean_iou"], 4)


def update(path: Path, tracker: str, measured: dict[str, float]) -> None:
    """Write the reference figures of a suite."""
    content = {"tracker": tracker, "mean_iou": measured, "provenance": provenance()}
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise ResultsError(f"cannot write {path}: {error.strerror or error}") from error


def compare(path: Path, tracker: str, measured: dict[str, float]) -> Comparison:
    """Compare with the reference figures.

    Raises
    ------
    ResultsError
        If there are none for this tracker, or the file is damaged.
    """
    if not path.exists():
        raise ResultsError(f"no reference figures in {path}: write them with `python -m eval check --update`")
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        known = {str(name): float(value) for name, value in content["mean_iou"].items()}
        owner = content["tracker"]
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise ResultsError(f"{path} is damaged ({error!r}): restore it from git") from error
    if owner != tracker:
        raise ResultsError(f"{path} holds the figures of {owner}, not of {tracker}")
    rows = [_row(name, known.get(name), measured.get(name), SEQUENCE_TOLERANCE) for name in {**known, **measured}]
    shared = [name for name in known if name in measured]
    if shared:
        before, now = (sum(scores[name] for name in shared) / len(shared) for scores in (known, measured))
        rows.append(_row("mean", before, now, SUITE_TOLERANCE))
    table = pd.DataFrame(rows, columns=["sequence", "reference", "now", "change", "verdict"])
    return Comparison(table, bool((table["verdict"] != "FELL").all() and (table["verdict"] != "missing").all()))


def _row(
    name: str, before: float | None, now: float | None, tolerance: float
) -> tuple[str, float, float, float, str]:
    nan = float("nan")
    if before is None:
        return name, nan, nan if now is None else now, nan, "new"
    if now is None:
        return name, before, nan, nan, "missing"
    change = now - before
    # A hair more than the tolerance, since the figures are rounded.
    verdict = "FELL" if change < -tolerance - 1e-9 else "rose" if change > tolerance else "same"
    return name, before, now, change, verdict
