"""Runs trackers on sequences: one process serves one tracker on a few of them.

A tracker gets to see one frame after another, and its start box as whole numbers; a protocol
(:mod:`eval.protocols`) decides which. The truth stays in this process.
"""

from __future__ import annotations

import hashlib
import os
import socket
import threading
from collections.abc import Callable, Iterable, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from .framesource import FrameSourceError
from .process import Answer, Child, ChildError, KilledError, Limits, isolation
from .protocols import ONE_PASS, Box, Protocol, Step
from .regions import Mask, polygon_text
from .results import COMPLETED, Folder, ResultsError, Run, Trajectory, provenance
from .scheduling import ATTEMPTS, in_parallel
from .sequences import Sequence
from .trackers import TrackerSpec, code_version
from .worker import Arrays

__all__ = [
    "TRACK",
    "Job",
    "check_factories",
    "hidden_paths",
    "make_jobs",
    "open_request",
    "run_jobs",
    "run_one",
    "with_parameters",
]

TRACK = "eval.track:Track"
"""The service that a tracker's process runs."""

BATCH_FRAMES = 3000
"""Frames that one process of a tracker serves at most, so that starting it costs little and losing it as well."""

_PROTOCOL = "3"  # part of every key of a run: raise it when what a tracker is given changes


@dataclass(frozen=True)
class Job:
    """One tracker on one sequence from one start.

    Parameters
    ----------
    tracker : TrackerSpec
    sequence : Sequence
    start : int, optional
        Number among the starts of the protocol; in one pass 0 is the exact box, others are perturbed.
    repeat : int, optional
    protocol : Protocol, optional
    """

    tracker: TrackerSpec
    sequence: Sequence
    start: int = 0
    repeat: int = 0
    protocol: Protocol = ONE_PASS

    def key(self, version: str) -> str:
        """Hash of all that the trajectory depends on; `version` is what ``code_version(tracker)`` gives."""
        # By what it was judged decides where a tracker is started again.
        judged = ("by region",) if self.sequence.by_region else ()
        led = () if self.protocol.key == ONE_PASS.key else (self.protocol.key, *judged)
        what = (self.sequence.name, self.sequence.digest, str(self.start), str(self.repeat))
        parts = (_PROTOCOL, version, *what, *led)
        return hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]


def make_jobs(
    trackers: Iterable[TrackerSpec],
    sequences: Iterable[Sequence],
    *,
    starts: int = 0,
    protocol: Protocol = ONE_PASS,
) -> list[Job]:
    """Every run of a protocol: each pair from the first start `repeats` times, and from each other start once.

    Sequence by sequence, so that an early look at the results compares trackers on the same ones.

    Parameters
    ----------
    trackers : iterable of TrackerSpec
    sequences : iterable of Sequence
    starts : int, optional
        Perturbed start boxes besides those of the protocol.
    protocol : Protocol, optional
    """
    trackers = list(trackers)
    return [
        job
        for sequence in sequences
        for tracker in trackers
        for job in (
            *(Job(tracker, sequence, 0, repeat, protocol) for repeat in range(tracker.repeats)),
            *(Job(tracker, sequence, start, 0, protocol) for start in range(1, protocol.runs(sequence) + starts)),
        )
    ]


def run_jobs(
    jobs: list[Job],
    folder: Folder,
    *,
    workers: int,
    dask: str = "",
    limits: Limits | None = None,
    retry_failed: bool = False,
    report: Callable[[Run, bool, str], None],
) -> None:
    """Run what has no valid result yet, in parallel, and store each result as soon as it is here.

    Parameters
    ----------
    jobs : list of Job
    folder : Folder
    workers : int
        Number of processes at a time.
    dask : str, optional
        Address of a scheduler of Dask's, whose workers run the jobs instead.
    limits : Limits, optional
    retry_failed : bool, optional
        Run those again whose stored status is not "completed".
    report : callable
        Called with each run, whether it was reused, and a note to the user (mostly empty).

    Raises
    ------
    ValueError
        If the factory of a tracker is not there.
    ResultsError
        When a result cannot be written, or a worker of a cluster has other code; running processes are ended, stored
        results stay.
    KeyboardInterrupt
        Passed on after ending the running processes.
    """
    limits = limits or Limits()
    versions = {job.tracker.name: code_version(job.tracker) for job in jobs}
    waiting, notes = [], {}
    for job in jobs:
        key = job.key(versions[job.tracker.name])
        stored, note = _stored(job, key, folder)
        if stored is not None and (stored.status == COMPLETED or not retry_failed):
            report(stored, True, note)
        else:
            waiting.append(Keyed(job, key))
            notes[key] = note
    if not dask:
        trackers = {one.job.tracker.name: one.job.tracker for one in waiting}
        sequences = {one.job.sequence.name: one.job.sequence for one in waiting}
        check_factories(trackers.values(), sequences.values(), limits, folder.path)
    batches = [
        Batch(part, versions[part[0].job.tracker.name], limits, folder.path.absolute())
        for part in _batched(waiting, workers)
    ]
    with closing(in_parallel(_run_batch, batches, workers=workers, dask=dask)) as found:
        for run in chain.from_iterable(found):
            folder.write_run(run)
            report(run, False, notes[run.key])


def check_factories(
    trackers: Iterable[TrackerSpec], sequences: Iterable[Sequence], limits: Limits, results: Path
) -> None:
    """Refuse trackers ``pkg.module:factory`` whose factory is not there, before they have failed on every sequence.

    A module is loaded in a process of its own, as it is for a run; what lies with the sequences and in the folder of
    results is hidden from it.

    Raises
    ------
    ValueError
        Naming the first that cannot be used, with the reason.
    """
    own = [tracker for tracker in trackers if ":" in tracker.name]
    hidden = sorted({path for sequence in sequences for path in hidden_paths(sequence, results)}) if own else []
    for tracker in own:
        with Child(TRACK, with_parameters(limits, tracker), hidden=hidden) as child:
            try:
                child.ask({"do": "find", "factory": tracker.factory})
            except ChildError as error:
                raise ValueError(f"the tracker {tracker.name!r} cannot be used: it {error}") from error


class Keyed(NamedTuple):
    """A job, and the key of its result."""

    job: Job
    key: str


class Batch(NamedTuple):
    """Jobs of one tracker that one process of it serves; all on different sequences.

    Parameters
    ----------
    jobs : tuple of Keyed
    version : str
        Of the tracker's code, where the jobs come from.
    limits : Limits
    results : Path
        Folder that is none of the tracker's business.
    """

    jobs: tuple[Keyed, ...]
    version: str
    limits: Limits
    results: Path


def _batched(jobs: list[Keyed], workers: int) -> list[tuple[Keyed, ...]]:
    """Jobs in batches, those first whose sequences come first, so that early results are on the same ones for all.

    A process never gets a sequence twice: what it has seen from one start box is no help for the next.
    """
    frames = sum(len(one.job.sequence) for one in jobs)
    most = min(BATCH_FRAMES, frames / (4 * workers))
    place: dict[str, int] = {}
    groups: dict[tuple[str, int, int], list[list[Keyed]]] = {}
    for one in jobs:
        job = one.job
        place.setdefault(job.sequence.name, len(place))
        parts = groups.setdefault((job.tracker.name, job.start, job.repeat), [[]])
        if sum(len(other.job.sequence) for other in parts[-1]) + len(job.sequence) > most and parts[-1]:
            parts.append([])
        parts[-1].append(one)
    found = [tuple(part) for parts in groups.values() for part in parts]
    return sorted(found, key=lambda part: place[part[0].job.sequence.name])


def _run_batch(batch: Batch, stop: threading.Event) -> list[Run]:
    """Run a batch, wherever this is."""
    tracker = batch.jobs[0].job.tracker
    if code_version(tracker) != batch.version:
        raise ResultsError(
            f"the code of {tracker.name} on {socket.gethostname()} is not what it is where the run was started: "
            "same checkout and versions everywhere, please"
        )
    stamp = {**provenance(), "isolation": isolation(), "code": batch.version}
    hidden = {path for one in batch.jobs for path in hidden_paths(one.job.sequence, batch.results)}
    with _Server(tracker, batch.limits, sorted(hidden), stop) as server:
        return [_run(one.job, one.key, server, stamp) for one in batch.jobs]


def _stored(job: Job, key: str, folder: Folder) -> tuple[Run | None, str]:
    path = folder.run_path(job.tracker.name, job.sequence.name, job.start, job.repeat, job.protocol.key)
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
    origin = stamp or {**provenance(), "isolation": isolation(), "code": code_version(job.tracker)}
    hidden = hidden_paths(job.sequence, results)
    with _Server(job.tracker, limits or Limits(), hidden, stop or threading.Event()) as server:
        return _run(job, key, server, origin)


class _Server:
    """A process of a tracker, started when it is needed, which serves one job after another until one fails."""

    def __init__(self, tracker: TrackerSpec, limits: Limits, hidden: list[Path], stop: threading.Event) -> None:
        self.limits = limits
        self.used = False
        self._tracker, self._hidden, self._stop = tracker, hidden, stop
        self._child: Child | None = None

    def __enter__(self) -> _Server:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def child(self) -> Child:
        """Return the process: the one that has served before, or a fresh one."""
        self.used = self._child is not None
        if self._child is None:
            limits = with_parameters(self.limits, self._tracker)
            self._child = Child(TRACK, limits, hidden=self._hidden, stop=self._stop)
        return self._child

    def close(self) -> None:
        """End the process, if there is one."""
        if self._child is not None:
            self._child.close()
        self._child = None


def _run(job: Job, key: str, server: _Server, stamp: Mapping[str, Any]) -> Run:
    """Run one job, again where its failure may be another's fault: a kill from outside, what was served before."""
    deaths = 0
    while True:
        answers = _Answers(len(job.sequence))
        try:
            _follow(job, answers, server)
        except (ChildError, FrameSourceError) as error:
            answers.reason = str(error)
            server.close()
            deaths += isinstance(error, KilledError)
            if (isinstance(error, KilledError) and deaths < ATTEMPTS) or (
                isinstance(error, ChildError) and server.used
            ):
                continue
        return _as_run(job, key, answers, stamp)


class _Answers:
    """What a tracker has answered so far, and why it answers no more."""

    def __init__(self, count: int) -> None:
        self.started = False
        self.reached = 0  # frames that are done with
        self.trajectory = Trajectory(np.zeros(count, dtype=bool), np.full((count, 4), np.nan), np.full(count, np.nan))
        self.regions = [""] * count
        self.marks: dict[str, list[int]] = {}
        self.reason = ""

    def take(self, index: int, ok: bool, box: Iterable[float], score: float, region: str = "") -> None:
        """Take down what was answered for a frame."""
        self.trajectory.ok[index], self.trajectory.boxes[index], self.trajectory.score[index] = ok, tuple(box), score
        self.regions[index] = region
        self.reached = index + 1


class _Walk:
    """A tracker in a child process, led by a protocol (:class:`eval.protocols.Walk`)."""

    def __init__(self, child: Child, job: Job, answers: _Answers, limits: Limits) -> None:
        self._child, self._job, self._answers = child, job, answers
        self._left = limits.seconds
        self._seconds = 0.0

    def begin(self, index: int, frame: NDArray[Any], box: Box) -> float:
        request, truth = open_request(self._job, index)
        self._ask(request, *truth)
        self._ask({"do": "frame"}, frame)
        self._ask({"do": "init", "box": box})
        self._answers.started = True
        self._answers.take(index, True, box, np.nan)
        self.mark("started", index)
        return self._seconds

    def step(self, index: int, frame: NDArray[Any]) -> Step:
        self._ask({"do": "frame"}, frame)
        content, seconds = self._ask({"do": "update"}).content, self._seconds
        masks = self._ask({"do": "mask"}).arrays if content.get("masked") is True else ()
        answer = _checked(content, masks, frame.shape[:2])
        self._answers.take(index, **answer)
        return Step(answer["ok"], answer["box"], seconds, answer["region"])

    def hold(self, index: int) -> None:
        last, before = self._answers.trajectory, index - 1
        region = self._answers.regions[before]
        self._answers.take(index, bool(last.ok[before]), last.boxes[before], float(last.score[before]), region)

    def mark(self, name: str, index: int) -> None:
        self._answers.marks.setdefault(name, []).append(index)

    def _ask(self, content: Mapping[str, Any], *arrays: Any) -> Answer:
        begin = perf_counter()
        try:
            answer = self._child.ask(content, arrays, seconds=max(self._left, 0.0))
        finally:
            self._left -= perf_counter() - begin
        self._seconds = answer.wall if np.isnan(answer.cpu) else answer.cpu
        return answer


def _follow(job: Job, answers: _Answers, server: _Server) -> None:
    begin = job.protocol.begin(job.sequence, job.start)
    job.protocol.lead(_Walk(server.child(), job, answers, server.limits), job.sequence, begin)


def _checked(answer: Mapping[str, Any], arrays: Arrays, shape: tuple[int, ...]) -> dict[str, Any]:
    """Numbers of the types that they should be: a tracker can write into its own process what it likes."""
    try:
        ok, box, score = bool(answer["ok"]), [float(value) for value in answer["box"]], float(answer["score"])
        corners = [float(value) for value in answer["corners"]]
    except (KeyError, TypeError, ValueError, OverflowError):
        box = []
    if len(box) != 4 or len(corners) not in (0, 8) or any(array.shape != shape for array in arrays):
        raise ChildError("wrote among its own answers")
    region = polygon_text(corners) if corners and np.isfinite(corners).all() else ""
    for mask in arrays:
        region = Mask(0, 0, mask != 0).text or region
    return {"ok": ok, "box": box, "score": score, "region": region}


def with_parameters(limits: Limits, tracker: TrackerSpec) -> Limits:
    """Limits under which a tracker may also use the files that its parameters name: its weights."""
    named = (value for value in tracker.params.values() if isinstance(value, str) and os.path.isabs(value))
    return replace(limits, paths=(*limits.paths, *(value for value in named if os.path.exists(value))))


def open_request(job: Job, first: int = 0) -> tuple[dict[str, Any], tuple[NDArray[Any], ...]]:
    """Request that makes a tracker; the truth from frame `first` on is in it only for a test double that asks."""
    tracker, sequence = job.tracker, job.sequence
    request = {"do": "open", "factory": tracker.factory, "params": dict(tracker.params), "seed": job.repeat}
    if not tracker.sees_truth:
        return request, ()
    boxes = np.where(sequence.visibility[first:, np.newaxis] > 0, sequence.boxes[first:], np.nan)
    regions = "\n".join(sequence.regions[first:]) + "\n" * bool(sequence.regions)
    return request, (boxes, np.frombuffer(regions.encode(), dtype=np.uint8))


def _as_run(job: Job, key: str, answers: _Answers, stamp: Mapping[str, Any]) -> Run:
    if not answers.started:
        # Where it should have started, it counts as started.
        first, box = job.protocol.begin(job.sequence, job.start)
        answers.take(first, True, box, np.nan)
        answers.marks["started"] = [first]
    if answers.reason:
        answers.marks.setdefault("failed", []).append(answers.reached)
    where = f" at frame {answers.reached}" if answers.started else " in init"
    status = f"{answers.reason}{where}" if answers.reason else _find_nonsense(answers.trajectory, job.sequence.size)
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
        trajectory=replace(answers.trajectory, regions=tuple(answers.regions) if any(answers.regions) else ()),
        provenance=details,
        protocol=job.protocol.key,
        marks={} if job.protocol.key == ONE_PASS.key else answers.marks,
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
