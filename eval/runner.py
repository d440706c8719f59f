"""Runs trackers on sequences, each pair in a process of its own, and measures their speed.

The one place that decides what a tracker gets to see: the frames, and the first box as whole numbers. The truth stays
in this process.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import psutil

from .results import COMPLETED, Folder, ResultsError, Run, SpeedRun, Trajectory, provenance
from .sequences import Sequence
from .trackers import TrackerSpec, code_version
from .worker import ONE_THREAD, UNWRITTEN

__all__ = [
    "BLOCK",
    "TIMED_UPDATES",
    "Job",
    "Limits",
    "make_jobs",
    "measure_speed",
    "run_jobs",
    "run_one",
    "start_box",
]

PERTURBATION = 0.1
"""Largest change of a perturbed start box, in box sizes: position and size alike."""

WARM_UP = 5
"""Updates before the timed ones: compilation, caches, the first allocation."""

TIMED_UPDATES = 40
"""Per sequence and tracker: enough for a median, since thirty sequences are measured."""

BLOCK = 10
"""Consecutive updates of one tracker before it is the next one's turn. Turns let noise fall on all alike; a block is
what the user of a single tracker sees, whose caches are his own: after a single update of each other tracker they
are filled with what those have left there, which costs a fast tracker the greatest share of its time."""

_PROTOCOL = "1"  # part of every key of a run: raise it when what a tracker is given changes
_SPEED_PROTOCOL = "2"  # the same for the timing pass: raise it when what is measured changes
_GARBLED = {"failure": "wrote among its own answers"}
_POLL_SECONDS = 0.02
_GLANCE_SECONDS = 0.25
_LEAVE_SECONDS = 1.0  # for the pipe of a process that has ended to be read to its end
_PRINTED_MEGABYTES = 64.0  # what a tracker may print in one run: it goes to the disk that the results are on
_TAIL = 65536  # bytes at the end of what it printed, among which its last line is looked for


class _Cancelled(Exception):
    """The run was interrupted; nothing is recorded for this job."""


@dataclass(frozen=True)
class Limits:
    """What one process may take.

    Parameters
    ----------
    seconds : float
        Wall-clock time for one sequence.
    megabytes : float
        Resident memory.
    """

    seconds: float = 300.0
    megabytes: float = 2048.0

    def __post_init__(self) -> None:
        if not (self.seconds > 0 and self.megabytes > 0):
            raise ValueError(f"expected positive limits, got {self.seconds} s and {self.megabytes} MB")


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
        parts = (_PROTOCOL, version, self.sequence.digest, str(self.start), str(self.repeat))
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
    width, height = sequence.size
    left, top = min(max(round(x), 0), width - 1), min(max(round(y), 0), height - 1)
    right, bottom = min(max(round(x + w), left + 1), width), min(max(round(y + h), top + 1), height)
    return left, top, right - left, bottom - top


# --- accuracy: one process per job -------------------------------------------------------------------------


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
    stamp = provenance()
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
                stored = run_one(job, key=key, limits=limits, stamp=origin, stop=stop)
                folder.write_run(stored)
            report(stored, reused, note)
        except _Cancelled:
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


def run_one(
    job: Job,
    *,
    key: str = "",
    limits: Limits | None = None,
    stamp: Mapping[str, Any] | None = None,
    stop: threading.Event | None = None,
) -> Run:
    """Run one job in a process of its own. Whatever the tracker does, the result is a run.

    Returns
    -------
    Run
        Its status says what went wrong; frames without an answer count as ``ok=False``.
    """
    limits = limits or Limits()
    with tempfile.TemporaryDirectory(prefix="hs_eval-", ignore_cleanup_errors=True) as scratch:
        place = Path(scratch)
        commands = [_open_command(job), {"do": "update", "count": len(job.sequence) - 1, "timed": False}]
        (place / "commands").write_text("".join(json.dumps(command) + "\n" for command in commands), encoding="utf-8")
        with (
            (place / "commands").open() as stdin,
            (place / "records").open("w") as stdout,
            (place / "errors").open("w") as stderr,
        ):
            process = _spawn(stdin, stdout, stderr)
            try:
                ended = _watch(process, limits, stop or threading.Event(), place / "errors")
            finally:
                _end(process)
        if process.returncode == UNWRITTEN:
            _check_room(place)
        records = _read_records(place / "records")
        # A positive code is Python's own end, and its last line says why; a signal leaves nothing of ours there.
        complaint = _last_line(place / "errors") if process.returncode > 0 else ""
    return _as_run(job, key, records, ended, complaint, stamp or {**provenance(), "code": code_version(job.tracker)})


def _check_room(place: Path) -> None:
    """See whether a file can be written; otherwise what is missing is our fault, and no tracker's."""
    try:
        (place / "probe").write_bytes(bytes(2**16))
    except OSError as error:
        raise ResultsError(
            f"cannot write to {place}: {error.strerror or error}; what was written before is safe"
        ) from error


def _open_command(job: Job) -> dict[str, Any]:
    params = dict(job.tracker.params)
    if job.tracker.sees_truth:
        sequence = job.sequence
        params["boxes"] = [
            list(box) if visible > 0 and np.isfinite(box).all() else None
            for box, visible in zip(sequence.boxes.tolist(), sequence.visibility.tolist(), strict=True)
        ]
    return {
        "do": "open",
        "factory": job.tracker.factory,
        "params": params,
        "frames": job.sequence.frames.to_json(),
        "box": start_box(job.sequence, job.start),
    }


def _spawn(stdin: Any, stdout: Any, stderr: Any) -> subprocess.Popen[str]:
    # One thread each: what is parallel here is the jobs. The search path travels too, for plugin trackers.
    root = str(Path(__file__).parent.parent)
    path = os.pathsep.join(dict.fromkeys([root, *(entry or os.getcwd() for entry in sys.path)]))
    return subprocess.Popen(
        [sys.executable, "-m", "eval.worker"],
        stdin=stdin,
        stdout=stdout,
        stderr=stderr,
        text=True,
        env={**os.environ, **ONE_THREAD, "PYTHONPATH": path},
        # A session of its own: Ctrl-C reaches us alone, and we can end it with all that it has started.
        start_new_session=True,
    )


def _end(process: subprocess.Popen[str]) -> None:
    if hasattr(os, "killpg"):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL)
    if process.poll() is None:
        process.kill()
    process.wait()


def _watch(process: subprocess.Popen[str], limits: Limits, stop: threading.Event, printed: Path) -> str:
    """Wait for the end of the process; say why it had to be ended, or how it died, or nothing."""
    deadline = time.monotonic() + limits.seconds
    try:
        gauge = psutil.Process(process.pid)
    except psutil.NoSuchProcess:
        gauge = None
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return _death(process.wait(_POLL_SECONDS))
        if stop.is_set():
            raise _Cancelled
        if time.monotonic() > deadline:
            return f"timed out after {limits.seconds:g} s"
        if gauge is not None and _own_megabytes(gauge) > limits.megabytes:
            return f"used more than {limits.megabytes:g} MB of memory"
        if printed.stat().st_size > _PRINTED_MEGABYTES * 2**20:
            return f"printed more than {_PRINTED_MEGABYTES:g} MB"


def _own_megabytes(gauge: psutil.Process) -> float:
    try:
        memory = gauge.memory_info()
    except psutil.Error:
        return 0.0
    # Pages of the mapped frames are shared and not the tracker's doing.
    return float(memory.rss - getattr(memory, "shared", 0)) / 2**20


def _death(code: int) -> str:
    if code == 0:
        return ""
    if code > 0:
        return f"ended its process with code {code}"
    try:
        return f"crashed ({signal.Signals(-code).name})"
    except ValueError:
        return f"crashed (signal {-code})"


def _read_records(path: Path) -> list[dict[str, Any]]:
    # What stands behind the last line feed was cut off by the end of the process.
    lines = path.read_text(encoding="utf-8", errors="replace").split("\n")[:-1]
    records = []
    for line in lines:
        records.append(_as_record(line))
        if "failure" in records[-1]:
            break
    return records


def _as_record(line: str) -> dict[str, Any]:
    """Read one record of the worker; what others have written into its file or pipe is a failure."""
    try:
        record = json.loads(line)
    except ValueError:
        return _GARBLED
    return record if isinstance(record, dict) and record.keys() & {"opened", "ok", "failure"} else _GARBLED


def _last_line(path: Path) -> str:
    with path.open("rb") as printed:
        printed.seek(max(path.stat().st_size - _TAIL, 0))
        text = printed.read().decode("utf-8", errors="replace")
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return lines[-1][:300] if lines else ""


def _as_run(
    job: Job, key: str, records: list[dict[str, Any]], ended: str, complaint: str, stamp: Mapping[str, Any]
) -> Run:
    count = len(job.sequence)
    trajectory = Trajectory(np.zeros(count, dtype=bool), np.full((count, 4), np.nan), np.full(count, np.nan))
    trajectory.ok[0], trajectory.boxes[0] = True, start_box(job.sequence, job.start)
    failure = next((record["failure"] for record in records if "failure" in record), "")
    answers = [record for record in records if "ok" in record][: count - 1]
    for frame, answer in enumerate(answers, start=1):
        trajectory.ok[frame] = answer["ok"]
        trajectory.boxes[frame] = answer["box"]
        trajectory.score[frame] = answer["score"]
    reason = failure or ": ".join(part for part in (ended, complaint) if part)
    if not reason and len(answers) < count - 1:
        reason = "ended its process"
    where = " after the last frame" if len(answers) == count - 1 else f" at frame {len(answers) + 1}"
    if not any("opened" in record for record in records):
        where = " in init"
    status = f"{reason}{where}" if reason else _find_nonsense(trajectory, job.sequence.size)
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


# --- speed: all trackers side by side, a block of updates at a time ----------------------------------------


class _LiveWorker:
    """A worker process that is asked one thing at a time; the limits hold for one answer."""

    def __init__(self, limits: Limits) -> None:
        self._limits = limits
        self._process = _spawn(subprocess.PIPE, subprocess.PIPE, subprocess.DEVNULL)
        self._gauge = psutil.Process(self._process.pid)
        self._answers: queue.SimpleQueue[str] = queue.SimpleQueue()
        self._listener = threading.Thread(target=self._listen, daemon=True)
        self._listener.start()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        with self._process.stdout as lines:
            for line in lines:
                self._answers.put(line)
        self._answers.put("")

    def ask(self, command: Mapping[str, Any], answers: int = 1) -> list[dict[str, Any]]:
        """Send a command that has so many answers; a failure is an answer, and the last."""
        assert self._process.stdin is not None
        found: list[dict[str, Any]] = []
        try:
            self._process.stdin.write(json.dumps(command) + "\n")
            self._process.stdin.flush()
        except OSError:
            return [self._dead()]
        while len(found) < answers and not (found and "failure" in found[-1]):
            found.append(self._answer())
        return [*found, self._too_large()] if self._eats() else found

    def _answer(self) -> dict[str, Any]:
        deadline = time.monotonic() + self._limits.seconds
        # A look at its memory takes time from it: only while it takes long, and between the turns.
        while (left := deadline - time.monotonic()) > 0:
            with contextlib.suppress(queue.Empty):
                line = self._answers.get(timeout=min(_GLANCE_SECONDS, left))
                record = _as_record(line) if line else self._dead()
                if record == _GARBLED:
                    self.close()
                return record
            if self._eats():
                return self._too_large()
        return self._ended(f"timed out after {self._limits.seconds:g} s")

    def _eats(self) -> bool:
        return self.running() and _own_megabytes(self._gauge) > self._limits.megabytes

    def _too_large(self) -> dict[str, Any]:
        return self._ended(f"used more than {self._limits.megabytes:g} MB of memory")

    def _ended(self, reason: str) -> dict[str, Any]:
        self.close()
        return {"failure": reason}

    def _dead(self) -> dict[str, Any]:
        self.close()
        return {"failure": _death(self._process.returncode) or "ended its process"}

    def running(self) -> bool:
        return self._process.poll() is None

    def close(self) -> None:
        with contextlib.suppress(OSError):
            if self._process.stdin is not None:
                self._process.stdin.close()
        # One that died by itself keeps its own exit code: give it a moment to be collected.
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(0.5)
        _end(self._process)
        # A process that the tracker has left behind may hold the pipe open for ever; the listener waits alone then.
        self._listener.join(_LEAVE_SECONDS)


def measure_speed(
    trackers: list[TrackerSpec],
    sequences: list[Sequence],
    folder: Folder,
    *,
    frames: int = TIMED_UPDATES,
    warm_up: int = WARM_UP,
    block: int = BLOCK,
    limits: Limits | None = None,
    report: Callable[[SpeedRun, bool], None],
) -> None:
    """Time single updates: one thread, warm, all trackers by turns on the same few frames.

    What counts is the processor time of the tracker's process, all its threads together: on a quiet machine that is
    the time that passes, and on a busy one it does not grow with what others do. The time that passed is kept too.

    Parameters
    ----------
    trackers, sequences : list
    folder : Folder
        Gets one file per sequence as soon as it is measured.
    frames, warm_up : int, optional
        Timed updates per sequence, and those before them.
    block : int, optional
        Updates of one tracker before it is the next one's turn.
    limits : Limits, optional
        For a single update.
    report : callable
        Called with each result and whether it was reused.
    """
    if block < 1:
        raise ValueError(f"expected a block of at least one update, got {block}")
    limits = limits or Limits()
    versions = [code_version(tracker) for tracker in trackers]
    workers: dict[str, _LiveWorker] = {}
    try:
        for sequence in sequences:
            counts = warm_up, frames, block
            parts = (_SPEED_PROTOCOL, *versions, sequence.digest, *map(str, counts))
            key = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]
            run = _stored_speed(sequence, key, folder)
            reused = run is not None
            if run is None:
                run = _time_sequence(trackers, sequence, workers, key=key, counts=counts, limits=limits)
                folder.write_speed(run)
            report(run, reused)
    finally:
        for worker in workers.values():
            worker.close()


def _stored_speed(sequence: Sequence, key: str, folder: Folder) -> SpeedRun | None:
    path = folder.speed_path(sequence.name)
    if not path.exists():
        return None
    try:
        run = folder.read_speed(path)
    except ResultsError:
        return None
    return run if run.key == key else None


def _blocks(length: int, warm_up: int, frames: int, block: int) -> list[int]:
    """Number of updates of each turn on a sequence of `length` frames, the first of them to warm up."""
    warm_up = min(warm_up, length - 1)
    timed = min(frames, length - 1 - warm_up)
    return [warm_up, *(min(block, timed - done) for done in range(0, timed, block))]


def _time_sequence(
    trackers: list[TrackerSpec],
    sequence: Sequence,
    workers: dict[str, _LiveWorker],
    *,
    key: str,
    counts: tuple[int, int, int],
    limits: Limits,
) -> SpeedRun:
    times: dict[str, list[float]] = {tracker.name: [] for tracker in trackers}
    walls: dict[str, list[float]] = {tracker.name: [] for tracker in trackers}
    status = dict.fromkeys(times, COMPLETED)
    running = list(times)
    for tracker in trackers:
        if tracker.name not in workers or not workers[tracker.name].running():
            workers[tracker.name] = _LiveWorker(limits)

    def ask(name: str, command: Mapping[str, Any], answers: int = 1) -> list[dict[str, Any]]:
        found = workers[name].ask(command, answers)
        if found and "failure" in found[-1]:
            status[name] = found.pop()["failure"]
            running.remove(name)
        return found

    for tracker in trackers:
        ask(tracker.name, _open_command(Job(tracker, sequence)))
    for turn, updates in enumerate(_blocks(len(sequence), *counts)):
        for name in list(running):
            answers = ask(name, {"do": "update", "count": updates, "timed": True}, updates)
            if turn > 0:
                times[name] += [round(answer["cpu_ms"], 4) for answer in answers]
                walls[name] += [round(answer["wall_ms"], 4) for answer in answers]
    return SpeedRun(key, sequence.name, times, walls, status, {**provenance(), "block": counts[2]})
