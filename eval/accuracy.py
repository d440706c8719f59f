"""Runs trackers on sequences, each pair in a process of its own.

The one place that decides what a tracker gets to see: one frame after another, and the first box as whole numbers.
The truth stays in this process.
"""

from __future__ import annotations

import hashlib
import os
import threading
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

import joblib
import numpy as np

from .framesource import FrameSourceError
from .process import CancelledError, Child, ChildError, KilledError, Limits, isolation
from .results import COMPLETED, Folder, ResultsError, Run, Trajectory, provenance
from .sequences import Sequence
from .track import whole_box
from .trackers import TrackerSpec, code_version

__all__ = [
    "TRACK",
    "Job",
    "hidden_paths",
    "make_jobs",
    "open_request",
    "run_jobs",
    "run_one",
    "start_box",
    "with_parameters",
]

TRACK = "eval.track:Track"
"""The service that a tracker's process runs."""

PERTURBATION = 0.1
"""Largest change of a perturbed start box, in box sizes: position and size alike."""

ATTEMPTS = 3
"""Processes that are started for one job if each is killed from outside: the last one is the tracker's fault."""

_PROTOCOL = "2"  # part of every key of a run: raise it when what a tracker is given changes


@dataclass(frozen=True)
class Job:
    """One tracker on one sequence from one start box.

    Parameters
    ----------
    tracker : TrackerSpec
    sequence : Sequence
    start : int, optional
        0 is the exact box, others are perturbed.
    repeat : int, optional
    """

    tracker: TrackerSpec
    sequence: Sequence
    start: int = 0
    repeat: int = 0

    def key(self, version: str) -> str:
        """Hash of all that the trajectory depends on; `version` is what ``code_version(tracker)`` gives."""
        parts = (_PROTOCOL, version, self.sequence.name, self.sequence.digest, str(self.start), str(self.repeat))
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]


def make_jobs(trackers: Iterable[TrackerSpec], sequences: Iterable[Sequence], *, starts: int = 0) -> list[Job]:
    """Every pair from the exact box, `repeats` times, and from `starts` perturbed boxes.

    Sequence by sequence, so that an early look at the results compares trackers on the same ones.
    """
    trackers = list(trackers)
    return [
        job
        for sequence in sequences
        for tracker in trackers
        for job in (
            *(Job(tracker, sequence, 0, repeat) for repeat in range(tracker.repeats)),
            *(Job(tracker, sequence, start) for start in range(1, starts + 1)),
        )
    ]


def start_box(sequence: Sequence, start: int) -> tuple[int, int, int, int]:
    """Box that a tracker is given on frame 0: whole pixels inside the frame.

    Parameters
    ----------
    sequence : Sequence
    start : int
        0 for the exact box; otherwise the number of the perturbation: up to ±10 % of the size in position and size,
        the same for every tracker.
    """
    x, y, w, h = (float(value) for value in sequence.boxes[0])
    if start:
        seed = hashlib.sha256(f"{sequence.name}\0{start}".encode()).digest()
        dx, dy, dw, dh = np.random.default_rng(list(seed)).uniform(-PERTURBATION, PERTURBATION, 4)
        x, y, w, h = x + (dx - dw / 2) * w, y + (dy - dh / 2) * h, w * (1 + dw), h * (1 + dh)
    return whole_box((x, y, w, h), sequence.size)


def run_jobs(
    jobs: list[Job],
    folder: Folder,
    *,
    workers: int,
    limits: Limits | None = None,
    retry_failed: bool = False,
    report: Callable[[Run, bool, str], None],
) -> None:
    """Run what has no valid result yet, in parallel, and store each result as soon as it exists.

    Parameters
    ----------
    jobs : list of Job
    folder : Folder
    workers : int
        Number of processes at a time.
    limits : Limits, optional
    retry_failed : bool, optional
        Run those again whose stored status is not "completed".
    report : callable
        Called from any thread with each run, whether it was reused, and a note to the user (mostly empty).

    Raises
    ------
    ResultsError
        When a result cannot be written; running processes are ended, stored results stay.
    KeyboardInterrupt
        Passed on after ending the running processes.
    """
    limits = limits or Limits()
    versions = {job.tracker.name: code_version(job.tracker) for job in jobs}
    stamp = {**provenance(), "isolation": isolation()}
    stop = threading.Event()

    def work(job: Job) -> None:
        if stop.is_set():
            return
        try:
            key = job.key(versions[job.tracker.name])
            stored, note = _stored(job, key, folder)
            reused = stored is not None and (stored.status == COMPLETED or not retry_failed)
            if stored is None or not reused:
                origin = {**stamp, "code": versions[job.tracker.name]}
                stored = run_one(job, key=key, limits=limits, stamp=origin, stop=stop, results=folder.path)
                folder.write_run(stored)
            report(stored, reused, note)
        except CancelledError:
            return
        except BaseException:
            stop.set()
            raise

    # Threads, since each does nothing but wait for a process of its own.
    try:
        joblib.Parallel(n_jobs=workers, backend="threading", batch_size=1)(joblib.delayed(work)(job) for job in jobs)
    finally:
        stop.set()


def _stored(job: Job, key: str, folder: Folder) -> tuple[Run | None, str]:
    path = folder.run_path(job.tracker.name, job.sequence.name, job.start, job.repeat)
    if not path.exists():
        return None, ""
    try:
        run = folder.read_run(path)
    except ResultsError as error:
        return None, f"{error}; it is being run again"
    return (run if run.key == key and len(run.trajectory.ok) == len(job.sequence) else None), ""


def hidden_paths(sequence: Sequence, results: Path | None = None) -> list[Path]:
    """Where truth lies, so that a child can be kept from it: the data set, all results."""
    places = set(sequence.frames.places())
    if results is not None:
        places |= {results, *(path.parent for path in results.absolute().parent.glob("*/run.json"))}
    return sorted(place.absolute() for place in places)


def run_one(
    job: Job,
    *,
    key: str = "",
    limits: Limits | None = None,
    stamp: Mapping[str, Any] | None = None,
    stop: threading.Event | None = None,
    results: Path | None = None,
) -> Run:
    """Run one job in a process of its own. Whatever the tracker does, the result is a run.

    A process that is killed from outside is no fault of the tracker's: the job is run again.

    Parameters
    ----------
    job : Job
    key : str, optional
    limits : Limits, optional
        The time is what the tracker takes for all frames; reading them is not its doing.
    stamp : mapping, optional
        Provenance.
    stop : threading.Event, optional
        Ends the job when it is set, by a :class:`~eval.process.CancelledError`.
    results : Path, optional
        Folder of results, which is none of a tracker's business.

    Returns
    -------
    Run
        Its status says what went wrong; frames without an answer count as ``ok=False``.
    """
    limits = limits or Limits()
    hidden = hidden_paths(job.sequence, results)
    for attempt in range(1, ATTEMPTS + 1):
        answers = _Answers()
        try:
            _follow(job, answers, limits, hidden, stop)
        except KilledError as error:
            answers.reason = str(error)
            if attempt < ATTEMPTS:
                continue
        except (ChildError, FrameSourceError) as error:
            answers.reason = str(error)
        break
    origin = stamp or {**provenance(), "isolation": isolation(), "code": code_version(job.tracker)}
    return _as_run(job, key, answers, origin)


class _Answers:
    """What a tracker has answered so far, and why it answers no more."""

    def __init__(self) -> None:
        self.started = False
        self.updates: list[dict[str, Any]] = []
        self.reason = ""


def _follow(job: Job, answers: _Answers, limits: Limits, hidden: list[Path], stop: threading.Event | None) -> None:
    left = limits.seconds
    frames = iter(job.sequence.frames)
    with Child(TRACK, with_parameters(limits, job.tracker), hidden=hidden, stop=stop) as child:

        def ask(content: Mapping[str, Any], *arrays: Any) -> dict[str, Any]:
            nonlocal left
            begin = perf_counter()
            try:
                return child.ask(content, arrays, seconds=max(left, 0.0)).content
            finally:
                left -= perf_counter() - begin

        ask(open_request(job))
        ask({"do": "frame"}, next(frames))
        ask({"do": "init", "box": start_box(job.sequence, job.start)})
        answers.started = True
        for frame in frames:
            ask({"do": "frame"}, frame)
            answers.updates.append(_checked(ask({"do": "update"})))


def _checked(answer: Mapping[str, Any]) -> dict[str, Any]:
    """Numbers of the types that they should be: a tracker can write into its own process what it likes."""
    try:
        ok, box, score = bool(answer["ok"]), [float(value) for value in answer["box"]], float(answer["score"])
    except (KeyError, TypeError, ValueError, OverflowError):
        box = []
    if len(box) != 4:
        raise ChildError("wrote among its own answers")
    return {"ok": ok, "box": box, "score": score}


def with_parameters(limits: Limits, tracker: TrackerSpec) -> Limits:
    """Limits under which a tracker may also use the files that its parameters name: its weights."""
    named = (value for value in tracker.params.values() if isinstance(value, str) and os.path.isabs(value))
    return replace(limits, paths=(*limits.paths, *(value for value in named if os.path.exists(value))))


def open_request(job: Job) -> dict[str, Any]:
    """Request that makes a tracker; the truth is in it only for a test double that asks for it."""
    params = dict(job.tracker.params)
    if job.tracker.sees_truth:
        sequence = job.sequence
        params["boxes"] = [
            list(box) if visible > 0 and np.isfinite(box).all() else None
            for box, visible in zip(sequence.boxes.tolist(), sequence.visibility.tolist(), strict=True)
        ]
    return {"do": "open", "factory": job.tracker.factory, "params": params}


def _as_run(job: Job, key: str, answers: _Answers, stamp: Mapping[str, Any]) -> Run:
    count = len(job.sequence)
    trajectory = Trajectory(np.zeros(count, dtype=bool), np.full((count, 4), np.nan), np.full(count, np.nan))
    trajectory.ok[0], trajectory.boxes[0] = True, start_box(job.sequence, job.start)
    for frame, answer in enumerate(answers.updates, start=1):
        trajectory.ok[frame] = answer["ok"]
        trajectory.boxes[frame] = answer["box"]
        trajectory.score[frame] = answer["score"]
    where = f" at frame {len(answers.updates) + 1}" if answers.started else " in init"
    status = f"{answers.reason}{where}" if answers.reason else _find_nonsense(trajectory, job.sequence.size)
    details = {
        **stamp,
        "tracker": job.tracker.factory,
        "params": dict(job.tracker.params),
        "digest": job.sequence.digest,
    }
    return Run(
        key=key,
        tracker=job.tracker.name,
        sequence=job.sequence.name,
        start=job.start,
        repeat=job.repeat,
        status=status or COMPLETED,
        trajectory=trajectory,
        provenance=details,
    )


def _find_nonsense(trajectory: Trajectory, size: tuple[int, int]) -> str:
    """Say which frames hold a box that cannot be meant, though the tracker said that it has found the target."""
    finite = np.isfinite(trajectory.boxes).all(axis=1)
    x, y, w, h = np.nan_to_num(trajectory.boxes, nan=0.0, posinf=0.0, neginf=0.0).T
    with np.errstate(over="ignore"):
        outside = finite & ((x >= size[0]) | (y >= size[1]) | (x + w <= 0) | (y + h <= 0))
    kinds = {
        "a box that is not finite": trajectory.ok & ~finite,
        "a box without area": trajectory.ok & finite & ((w <= 0) | (h <= 0)),
        "a box outside the frame": trajectory.ok & outside & (w > 0) & (h > 0),
    }
    return "; ".join(
        f"returned {name} at frame {int(np.argmax(where))}"
        + (f" and {where.sum() - 1} more" if where.sum() > 1 else "")
        for name, where in kinds.items()
        if where.any()
    )
