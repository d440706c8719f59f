"""Times single updates: one thread, warm, all trackers by turns on the same few frames."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from .accuracy import TRACK, Job, check_factories, hidden_paths, open_request, with_parameters
from .clock import Clock, UntrueTimeError
from .process import Child, ChildError, KilledError, Limits, isolation
from .protocols import start_box
from .results import COMPLETED, Folder, ResultsError, SpeedRun, provenance
from .scheduling import ATTEMPTS
from .sequences import Sequence
from .trackers import TrackerSpec, code_version

__all__ = ["BLOCK", "TIMED_UPDATES", "measure_speed"]

WARM_UP = 5
"""Updates before the timed ones: compilation, caches, the first allocation."""

TIMED_UPDATES = 40
"""Per sequence and tracker: enough for a median, since thirty sequences are measured."""

BLOCK = 10
"""Consecutive updates of one tracker before it is the next one's turn. Turns let noise fall on all alike; a block is
what the user of a single tracker sees, whose caches are his own: after a single update of each other tracker they
are filled with what those have left there, which costs a fast tracker the greatest share of its time."""

_PROTOCOL = "4"  # part of every key of a timing pass: raise it when what is measured changes


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
    A tracker that starts a process while it is timed is refused it, and fails.

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
        For a single update; the number of processes is 1.
    report : callable
        Called with each result and whether it was reused.

    Raises
    ------
    ValueError
        If `block` is below 1, or the factory of a tracker is not there.
    """
    if block < 1:
        raise ValueError(f"expected a block of at least one update, got {block}")
    limits = limits or Limits()
    versions = [code_version(tracker) for tracker in trackers]
    workers: dict[str, tuple[Child, Clock]] = {}
    check_factories(trackers, sequences, limits, folder.path)
    try:
        for sequence in sequences:
            counts = warm_up, frames, block
            parts = (_PROTOCOL, *versions, sequence.digest, *map(str, counts))
            key = hashlib.sha256("\0".join(parts).encode()).hexdigest()[:24]
            run = _stored_speed(sequence, key, folder)
            reused = run is not None
            if run is None:
                turns = _take_turns(trackers, sequence, workers, counts, limits, folder.path)
                stamp = {**provenance(), "block": block, "isolation": isolation()}
                run = SpeedRun(key, sequence.name, turns.times, turns.walls, turns.status, stamp)
                folder.write_speed(run)
            report(run, reused)
    finally:
        for child, _ in workers.values():
            child.close()


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


def _take_turns(
    trackers: list[TrackerSpec],
    sequence: Sequence,
    workers: dict[str, tuple[Child, Clock]],
    counts: tuple[int, int, int],
    limits: Limits,
    results: Path,
) -> _Turns:
    """All trackers on one sequence; anew while a process is killed from outside, which is no tracker's fault."""
    for _ in range(ATTEMPTS - 1):
        turns = _Turns(trackers, sequence, workers, limits, results, last=False)
        try:
            turns.take(counts)
        except KilledError:
            continue
        return turns
    turns = _Turns(trackers, sequence, workers, limits, results, last=True)
    turns.take(counts)
    return turns


class _Turns:
    """All trackers on one sequence, a block of updates at a time."""

    def __init__(
        self,
        trackers: list[TrackerSpec],
        sequence: Sequence,
        workers: dict[str, tuple[Child, Clock]],
        limits: Limits,
        results: Path,
        *,
        last: bool,
    ) -> None:
        self._trackers, self._sequence, self._workers = trackers, sequence, workers
        self._limits, self._hidden, self._last = limits, hidden_paths(sequence, results), last
        names = [tracker.name for tracker in trackers]
        self.times: dict[str, list[float]] = {name: [] for name in names}
        self.walls: dict[str, list[float]] = {name: [] for name in names}
        self.status = dict.fromkeys(names, COMPLETED)

    def take(self, counts: tuple[int, int, int]) -> None:
        """Start all trackers, then let each have its blocks by turns.

        Raises
        ------
        KilledError
            If a process was killed from outside, and this is not the last attempt.
        """
        frames = iter(self._sequence.frames)
        first = next(frames)
        for tracker in self._trackers:
            self._try(tracker.name, partial(self._open, tracker, first))
        for turn, updates in enumerate(_blocks(len(self._sequence), *counts)):
            block = list(islice(frames, updates))
            for tracker in self._trackers:
                if self.status[tracker.name] == COMPLETED:
                    self._try(tracker.name, partial(self._update, tracker.name, block, turn > 0))

    def _open(self, tracker: TrackerSpec, first: NDArray[Any]) -> None:
        name = tracker.name
        if name not in self._workers or not self._workers[name][0].running():
            # Without processes of its own: the clock is that of one.
            limits = replace(with_parameters(self._limits, tracker), processes=1)
            child = Child(TRACK, limits, hidden=self._hidden)
            self._workers[name] = child, Clock(child, first)
        child, clock = self._workers[name]
        child.ask(*open_request(Job(tracker, self._sequence)))
        child.ask({"do": "frame"}, [first])
        child.ask({"do": "init", "box": start_box(self._sequence, 0)})
        clock.begin(first)

    def _update(self, name: str, block: list[NDArray[Any]], counts: bool) -> None:
        child, clock = self._workers[name]
        for frame in block:
            child.ask({"do": "frame"}, [frame])
            cpu, wall = clock.timed({"do": "update"})
            if counts:
                self.times[name].append(round(cpu, 6))
                self.walls[name].append(round(wall, 6))
        clock.check()
        # A look at its memory takes time from it: only between the turns, and now and then while it takes long.
        child.check_limits()

    def _try(self, name: str, do: Callable[[], None]) -> None:
        try:
            do()
        except KilledError as error:
            if not self._last:
                raise
            self.status[name] = str(error)
        except ChildError as error:
            self.status[name] = str(error)
            if isinstance(error, UntrueTimeError):
                self.times[name].clear()
                self.walls[name].clear()
