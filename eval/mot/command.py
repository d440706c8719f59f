"""``python -m eval mot``: trackers of several objects on scenes in which three to eight things move."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Annotated, Any

import joblib
import pandas as pd
import tyro

import datasets_synthetic as laboratory

from ..options import Jobs, Out
from ..progress import Steps, make_console
from ..results import ResultsError
from ..sequences import suite_folder
from ..tables import console_table, counted, format_cell, write_numbers, write_table
from .score import COLUMNS, OWED, Answers, Scores, combined, scored
from .trackers import TRACKERS, Found, make_tracker

__all__ = ["answers_of", "main_mot", "write_answers", "write_truth"]

_console = make_console()


def main_mot(
    *,
    suite: Annotated[str, tyro.conf.arg(help="crowd:N:SEED, or any other suite (SEED may be clock).")] = "crowd:12:1",
    trackers: Annotated[tuple[str, ...], tyro.conf.arg(help="Names, or pkg.module:factory.")] = tuple(TRACKERS),
    jobs: Jobs = 2,
    out: Out = Path("results"),
) -> None:
    """Follow everything that moves, without a rectangle, and score where it is and who it is.

    HOTA, IDF1 and MOTA are TrackEval's. Answers and truth are stored as MOTChallenge files, for other tools.
    """
    name = laboratory.canonical(suite)
    specs = laboratory.suite(name)
    truths = {spec.name: laboratory.objects(spec) for spec in specs}
    still = [sequence for sequence, truth in truths.items() if not truth]
    if still:
        raise ValueError(
            f"{', '.join(still)} of {name}: nothing moves from its place, so that there is nobody to follow"
        )
    folder = out / f"mot-{suite_folder(name)}"
    for spec in specs:
        write_truth(folder / "truth" / f"{spec.name}.txt", truths[spec.name])
    work = [(tracker, spec) for tracker in dict.fromkeys(trackers) for spec in specs]
    for tracker in dict.fromkeys(trackers):
        make_tracker(tracker)  # what cannot be made is said before anything is run
    scores: dict[str, dict[str, Scores]] = {tracker: {} for tracker in dict.fromkeys(trackers)}
    with Steps(
        _console, f"{counted(len(scores), 'tracker')} × {counted(len(specs), 'sequence')}", len(work)
    ) as steps:
        calls = (joblib.delayed(answers_of)(tracker, spec) for tracker, spec in work)
        found = joblib.Parallel(n_jobs=jobs, return_as="generator")(calls)
        for (tracker, spec), answers in zip(work, found, strict=True):
            write_answers(folder / "answers" / _file_name(tracker) / f"{spec.name}.txt", answers)
            scores[tracker][spec.name] = scored(truths[spec.name], answers, spec.size)
            steps.advance()
    rows = [
        {"tracker": tracker, "sequence": sequence, **each.row()}
        for tracker, by_name in scores.items()
        for sequence, each in by_name.items()
    ]
    write_numbers(pd.DataFrame(rows), "sequences", folder / "tables")
    table = pd.DataFrame([{"tracker": tracker, **combined(each).row()} for tracker, each in scores.items()])
    table = table.sort_values("HOTA", ascending=False)
    write_numbers(table, "overall", folder / "tables")
    text = pd.DataFrame({name: [_cell(value, name) for value in table[name]] for name in table.columns})
    write_table(text, "overall", folder / "tables", caption=f"Several objects: trackers on {name}.", rivals="rows")
    objects = sum(map(len, truths.values()))
    _console.print(
        console_table(
            text, f"{name}: {counted(len(specs), 'sequence')}, {counted(objects, 'object')}", bold="AutomaticTracker"
        )
    )
    _console.print(f"boxes are owed while at least {OWED:.0%} of an object is seen; files: {folder.resolve()}")


def answers_of(tracker: str, spec: laboratory.SequenceSpec) -> Answers:
    """Run a tracker over a sequence.

    Raises
    ------
    ResultsError
        If it answers with something else than identities and boxes.
    """
    judged = make_tracker(tracker)
    answers = []
    for t, frame in enumerate(laboratory.frames(spec)):
        answer = judged.update(frame)
        try:
            answers.append([_plain(identity, box) for identity, box in answer])
        except (TypeError, ValueError) as error:
            raise ResultsError(
                f"{tracker} on {spec.name}, frame {t}: expected (identity, (x, y, w, h)) of each object ({error})"
            ) from error
    return answers


def _plain(identity: object, box: Iterable[Any]) -> Found:
    x, y, w, h = (float(side) for side in box)
    return int(identity), (x, y, w, h)  # type: ignore[call-overload]


def write_answers(path: Path, answers: Answers) -> None:
    """Write answers as MOTChallenge has them: frames and pixels from 1."""
    rows = [
        f"{t + 1},{identity},{x + 1:.3f},{y + 1:.3f},{w:.3f},{h:.3f},1,-1,-1,-1\n"
        for t, found in enumerate(answers)
        for identity, (x, y, w, h) in found
    ]
    _write(path, rows)


def write_truth(path: Path, truth: Sequence[laboratory.Truth]) -> None:
    """Write the truth as MOTChallenge has it; a box that is not owed is marked 0, the last column is what is seen."""
    rows = [
        f"{t + 1},{k},{x + 1:.3f},{y + 1:.3f},{w:.3f},{h:.3f},{int(seen >= OWED)},1,{seen:.3f}\n"
        for k, each in enumerate(truth, 1)
        for t, ((x, y, w, h), seen) in enumerate(zip(each.boxes.tolist(), each.visibility.tolist(), strict=True))
    ]
    _write(path, rows)


def _write(path: Path, rows: list[str]) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("".join(rows), encoding="utf-8")
    except OSError as error:
        raise ResultsError(f"cannot write {path}: {error.strerror or error}") from error


def _file_name(tracker: str) -> str:
    return "".join(letter if letter.isalnum() else "_" for letter in tracker)


def _cell(value: object, column: str) -> str:
    return f"{value:.0f}" if column in COLUMNS[-3:] else format_cell(value, column)
