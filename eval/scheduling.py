"""Tasks side by side, by joblib: in processes of this machine (loky), or on a cluster of Dask's.

A worker that is killed costs time and nothing else: what it had not handed back is done again by another.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import threading
import time
import warnings
from collections.abc import Callable, Generator, Iterable, Iterator
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager
from typing import Any, NamedTuple, TypeVar

import joblib

from .process import SCRATCH_ROOT
from .results import ResultsError
from .supervisor import SCRATCH

__all__ = ["ATTEMPTS", "in_parallel"]

Task = TypeVar("Task")
Result = TypeVar("Result")

ATTEMPTS = 3
"""How often a task, or what it has started, may be killed from outside before it is at fault itself."""

_GLANCE_SECONDS = 0.5
_LEAVE_SECONDS = 2.0  # to end what runs; whatever is left then ends by itself, see eval.supervisor


class _Home(NamedTuple):
    """Where tasks come from: what can be imported there, and where workers of its own put their folders, or ""."""

    path: tuple[str, ...]
    scratch: str

    @classmethod
    def here(cls, scratch: str) -> _Home:
        return cls(tuple(entry or os.getcwd() for entry in sys.path), scratch)


def in_parallel(
    work: Callable[[Task, threading.Event], Result], tasks: Iterable[Task], *, workers: int, dask: str = ""
) -> Generator[Result]:
    """Do tasks, and give each result as soon as it is there.

    Parameters
    ----------
    work : callable
        Of a task and an event that is set when nobody waits for the result any more. Task, result and the function
        cross to other processes, on a cluster to other machines.
    tasks : iterable
    workers : int
        Processes at a time; with one, everything is done here.
    dask : str, optional
        Address of a scheduler of Dask's, whose workers do it instead.

    Yields
    ------
    object
        Results in the order in which they come.

    Raises
    ------
    ResultsError
        If workers are killed again and again, or Dask is not installed or does not answer.
    """
    left = dict(enumerate(tasks))
    stop = threading.Event()
    # Working folders lie in one of ours: workers that are ended leave theirs behind.
    scratch = tempfile.mkdtemp(prefix=SCRATCH)
    try:
        for attempt in range(1, ATTEMPTS + 1):
            try:
                with _dask_backend(dask) if dask else _own_backend():
                    pool = joblib.Parallel(
                        n_jobs=-1 if dask else workers, return_as="generator_unordered", batch_size=1, max_nbytes=None
                    )
                    alone = workers == 1 and not dask
                    calls = (
                        joblib.delayed(_here if alone else _elsewhere)(
                            work, number, task, stop if alone else _Home.here("" if dask else scratch)
                        )
                        for number, task in list(left.items())
                    )
                    with _closed(pool(calls)) as results:
                        for number, result in results:
                            del left[number]
                            yield result
                return
            except BrokenProcessPool as error:
                if attempt == ATTEMPTS:
                    raise ResultsError(f"workers were killed {ATTEMPTS} times, the last one: {error}") from error
    finally:
        stop.set()
        shutil.rmtree(scratch, ignore_errors=True)


@contextmanager
def _closed(results: Any) -> Iterator[Any]:
    """End what still runs when nobody wants it any more, without joblib's remark that it does."""
    try:
        yield results
    finally:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            results.close()


def _here(work: Callable[[Any, threading.Event], Any], number: int, task: Any, stop: threading.Event) -> Any:
    return number, work(task, stop)


def _elsewhere(work: Callable[[Any, threading.Event], Any], number: int, task: Any, home: _Home) -> Any:
    """Do a task in a worker, which may be older than what its sender can import by now."""
    sys.path.extend(entry for entry in home.path if entry not in sys.path and os.path.isdir(entry))
    if home.scratch:
        os.environ[SCRATCH_ROOT] = home.scratch
    return number, work(task, _GONE)


_GONE = threading.Event()
"""Set in a worker when the process that wants its results is gone, as far as that can be seen from there."""


def _own_backend() -> AbstractContextManager[Any]:
    """Processes of ours, which watch us from their start: one that has no task yet must not outlive us either."""
    backend: AbstractContextManager[Any] = joblib.parallel_config(
        backend="loky", initializer=_leave_with, initargs=(os.getpid(),)
    )
    return backend


def _leave_with(parent: int) -> None:
    """End this process, and first what it is doing, when its parent has ended without a word."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(_GLANCE_SECONDS)
        _GONE.set()
        time.sleep(_LEAVE_SECONDS)
        if SCRATCH_ROOT in os.environ:
            shutil.rmtree(os.environ[SCRATCH_ROOT], ignore_errors=True)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


@contextmanager
def _dask_backend(address: str) -> Iterator[None]:
    try:
        from distributed import Client
    except ImportError as error:
        raise ResultsError("--dask needs Dask: pip install --group cluster") from error
    try:
        client: AbstractContextManager[Any] = Client(address, timeout=30)
    except (OSError, ValueError) as error:
        raise ResultsError(f"no scheduler of Dask's answers at {address!r}: {error}") from error
    with client, joblib.parallel_config(backend="dask", client=client):
        yield
