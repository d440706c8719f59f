"""The one protocol with a child process: what is judged runs there, and gets at nothing but what it is handed.

A child is started anew (no memory is shared), in an empty folder, with no path of a data set in its arguments, its
environment or its open files. Frames reach it as bytes through a pipe. What it may open is limited by
:mod:`eval.sandbox`, and all processes that it starts end with it (:mod:`eval.supervisor`). The clock is the parent's:
it measures every exchange, by the time that passed and by the processor time of the child, which it reads itself.
"""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple, cast

import numpy as np
import psutil

from .sandbox import available, device_paths, make_ruleset, readable_paths, visible_paths
from .supervisor import SCRATCH
from .wire import GarbledError, read_message, write_message
from .worker import Arrays

__all__ = ["SCRATCH_ROOT", "Answer", "CancelledError", "Child", "ChildError", "KilledError", "Limits", "isolation"]

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of a process in which nothing runs beside what is measured."""

SCRATCH_ROOT = "HS_EVAL_SCRATCH"
"""Variable of the environment: the folder in which working folders are made, where that is not the system's."""

START_SECONDS = 120.0
"""For a child to be ready, on a machine that is busy; it is not charged to what it runs."""

_GLANCE_SECONDS = 0.1
_LEAVE_SECONDS = 30.0  # for the supervisor, on a machine that is busy; it takes milliseconds
_PIPE_BYTES = 2**20
_PRINTED_MEGABYTES = 64.0  # what may be printed: it goes to the disk that the results are on
_TAIL = 65536  # bytes at the end of what was printed, among which the last line is looked for
_NOTHINGS = 30  # empty exchanges whose median is the time that an exchange takes by itself
_OUTSIDE = {signal.SIGTERM, signal.SIGINT, getattr(signal, "SIGKILL", None), getattr(signal, "SIGHUP", None)}


class ChildError(Exception):
    """What is judged gave no answer; the message says why."""


class KilledError(ChildError):
    """The process was killed by a signal that people and systems send, and not by us."""


class CancelledError(Exception):
    """The run was interrupted while a child was at work."""


@dataclass(frozen=True)
class Limits:
    """What one child, with all processes that it starts, may take.

    Parameters
    ----------
    seconds : float
        Time that passes until it has answered.
    megabytes : float
        Resident memory.
    processes : int
        At any time. With 1 it may start threads, but no other process: then its processor time is known to the last.
    paths : tuple of str
        Files and folders, besides its own code, that it may read and write: weights, for example. What is hidden
        stays so.
    """

    seconds: float = 300.0
    megabytes: float = 2048.0
    processes: int = 64
    paths: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not (self.seconds > 0 and self.megabytes > 0 and self.processes > 0):
            raise ValueError(
                f"expected positive limits, got {self.seconds} s, {self.megabytes} MB, {self.processes} processes"
            )


class Answer(NamedTuple):
    """What came back.

    Parameters
    ----------
    content : dict
    arrays : sequence of ndarray
    wall : float
        Time that passed from asking to the answer, s, by our clock.
    cpu : float
        Processor time of the child meanwhile, s, read by us; NaN where the system does not tell.
    """

    content: dict[str, Any]
    arrays: Arrays
    wall: float
    cpu: float


def isolation() -> str:
    """How children are kept from the truth: by the kernel, or only by not being told where it is."""
    return "landlock" if available() else "paths not told"


class Child:
    """A process that answers one request at a time: a context manager.

    Parameters
    ----------
    service : str
        ``pkg.module:name`` of what answers, see :mod:`eval.worker`.
    limits : Limits
    hidden : iterable of Path, optional
        What it may not read even where it may read what is round it: truth, results.
    stop : threading.Event, optional
        Ends the child when it is set.

    Raises
    ------
    OSError
        If no process can be started, or on a system without ``fork``.
    """

    def __init__(
        self, service: str, limits: Limits, *, hidden: Iterable[Path] = (), stop: threading.Event | None = None
    ) -> None:
        if not hasattr(os, "fork"):
            raise OSError("what is judged runs in processes of Linux or macOS: this system has no fork")
        self._limits = limits
        self._stop = stop or threading.Event()
        self._reason = ""
        self._deadline = float("inf")
        self._over = threading.Event()
        self._ending = threading.Lock()
        self._known: dict[int, psutil.Process] = {}
        self._worker = 0
        self._scratch = tempfile.mkdtemp(prefix=SCRATCH, dir=os.environ.get(SCRATCH_ROOT))
        self._printed = tempfile.TemporaryFile()
        try:
            # Whoever can draw a suite knows its truth.
            laboratory = [Path(entry or ".").absolute() / "datasets_synthetic" for entry in sys.path]
            there = [place for place in laboratory if place.exists()]
            self._process, self._leash = self._start([*map(Path, hidden), *there])
        except BaseException:
            self._release()
            raise
        self._requests = cast(BinaryIO, self._process.stdin)
        self._answers = io.BufferedReader(cast(io.RawIOBase, self._process.stdout))
        self._watcher = threading.Thread(target=self._watch, daemon=True)
        self._watcher.start()
        try:
            self._worker = int(self._exchange({"service": service}, (), START_SECONDS).content["process"])
        except (KilledError, CancelledError):
            raise
        except ChildError as error:
            raise OSError(f"cannot start a process for what is judged: it {error}") from error
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Child:
        """Nothing to do: it runs."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End it."""
        self.close()

    def _start(self, hidden: list[Path]) -> tuple[subprocess.Popen[bytes], int]:
        leash, ours = os.pipe()
        rules = self._make_rules(hidden)
        handed = (leash, *(() if rules is None else (rules,)))
        numbers = leash, -1 if rules is None else rules, int(self._limits.processes == 1)
        try:
            process = subprocess.Popen(
                [sys.executable, "-m", "eval.supervisor", *map(str, numbers)],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=self._printed,
                cwd=self._scratch,
                env=_environment(self._scratch, hidden),
                pass_fds=handed,
                # A session of its own: Ctrl-C reaches us alone.
                start_new_session=True,
                bufsize=0,
                pipesize=_PIPE_BYTES,
            )
        except BaseException:
            os.close(ours)
            raise
        finally:
            for handle in handed:
                os.close(handle)
        return process, ours

    def _make_rules(self, hidden: list[Path]) -> int | None:
        cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
        given = visible_paths([cache, *map(Path, self._limits.paths)], hidden)
        return make_ruleset(readable_paths(hidden), [Path(self._scratch), *device_paths(), *given])

    def ask(self, content: Mapping[str, Any], arrays: Arrays = (), *, seconds: float | None = None) -> Answer:
        """Send a request and wait for its answer.

        Parameters
        ----------
        content : mapping
            JSON values.
        arrays : sequence of ndarray, optional
        seconds : float, optional
            Time for this request; that of the limits by default, which is also what the message says.

        Raises
        ------
        ChildError
            If there is none: an exception, a crash, a limit. All but an exception end the child.
        CancelledError
            If the run is to stop.
        """
        answer = self._exchange(content, arrays, self._limits.seconds if seconds is None else seconds)
        if "failure" in answer.content:
            raise ChildError(_printable(str(answer.content["failure"])))
        return answer

    def _exchange(self, content: Mapping[str, Any], arrays: Arrays, seconds: float) -> Answer:
        start, busy = time.perf_counter(), self.processor_seconds()
        self._deadline = time.monotonic() + seconds
        alone = False
        try:
            write_message(self._requests, content, arrays)
            found, parts = read_message(self._answers)
            return Answer(found, parts, time.perf_counter() - start, self.processor_seconds() - busy)
        except GarbledError:
            self._reason = self._reason or "wrote among its own answers"
        except (EOFError, OSError, ValueError):  # a ValueError of a pipe that is closed on our side
            alone = not self._reason and not self._stop.is_set()
        finally:
            self._deadline = float("inf")
        self._end(patient=alone)
        code, complaint = self._process.returncode, self._last_line()
        self.close()
        if self._stop.is_set():
            raise CancelledError
        if self._reason:
            raise ChildError(self._reason)
        raise (KilledError if -code in _OUTSIDE else ChildError)(_death(code, complaint))

    def check_limits(self) -> None:
        """Look at once whether a limit is exceeded, rather than at the next of the glances that are cast anyway.

        Raises
        ------
        ChildError
            If so; the child is ended.
        """
        self._reason = self._reason or self._overrun()
        if self._reason:
            self.close()
            raise ChildError(self._reason)

    def transport(self, arrays: Arrays = ()) -> float:
        """Processor time of the child that an exchange takes by itself, s: a median."""
        return float(np.median([self.ask({"do": "nothing"}, arrays).cpu for _ in range(_NOTHINGS)]))

    def processor_seconds(self) -> float:
        """Processor time of the worker and all its threads, ns exact; it cannot tell us anything else.

        NaN where the system does not tell, or it has ended.
        """
        if not (self._worker and sys.platform.startswith("linux")):
            return float("nan")
        try:
            # The kernel's number for the clock of another process (CPUCLOCK_SCHED of linux/posix-timers.h).
            return time.clock_gettime((~self._worker << 3) | 2)
        except OSError:
            return float("nan")

    def running(self) -> bool:
        """Whether it can be asked."""
        return not self._over.is_set() and self._process.poll() is None

    def _watch(self) -> None:
        while not self._over.wait(_GLANCE_SECONDS):
            self._reason = self._reason or self._overrun()
            if self._reason or self._stop.is_set():
                self._end(patient=False)
                return

    def _overrun(self) -> str:
        """Say which limit is exceeded, or nothing."""
        if time.monotonic() > self._deadline:
            return f"timed out after {self._limits.seconds:g} s" if self._worker else "was not ready in time"
        tree = self._tree()
        if len(tree) > self._limits.processes:
            return f"started more than {self._limits.processes} processes"
        if _megabytes(tree) > self._limits.megabytes:
            return f"used more than {self._limits.megabytes:g} MB of memory"
        if os.fstat(self._printed.fileno()).st_size > _PRINTED_MEGABYTES * 2**20:
            return f"printed more than {_PRINTED_MEGABYTES:g} MB"
        return ""

    def _tree(self) -> list[psutil.Process]:
        """All processes below the supervisor; they are remembered, should it be killed."""
        found = []
        for number in _descendants(self._process.pid):
            if number not in self._known:
                with contextlib.suppress(psutil.Error):
                    self._known[number] = psutil.Process(number)
            if number in self._known:
                found.append(self._known[number])
        return found

    def close(self) -> None:
        """End it, with all that it has started."""
        self._end(patient=False)
        self._watcher.join()
        for stream in (self._requests, self._answers, self._printed):
            stream.close()
        self._release()

    def _end(self, *, patient: bool) -> None:
        """End all processes; a patient end leaves one that dies by itself the time to say how it died."""
        with self._ending:
            self._over.set()
            if self._leash < 0:
                return
            if patient:
                with contextlib.suppress(subprocess.TimeoutExpired):
                    self._process.wait(_LEAVE_SECONDS)
            os.close(self._leash)
            self._leash = -1
            try:
                self._process.wait(_LEAVE_SECONDS)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()
            # Nothing is left of them, unless somebody has killed the supervisor.
            for process in self._known.values():
                with contextlib.suppress(psutil.Error):
                    process.kill()

    def _release(self) -> None:
        shutil.rmtree(self._scratch, ignore_errors=True)

    def _last_line(self) -> str:
        """Last line that was printed: Python's own complaint when it ends with an error."""
        # The place in the file is the child's too: it must not be moved.
        size = os.fstat(self._printed.fileno()).st_size
        text = os.pread(self._printed.fileno(), _TAIL, max(size - _TAIL, 0)).decode("utf-8", errors="replace")
        lines = [_printable(line) for line in text.splitlines() if line.strip()]
        return lines[-1][:300] if lines else ""


def _printable(words: str) -> str:
    """One line without what would command a terminal: the words are the child's."""
    return " ".join("".join(letter if letter.isprintable() else " " for letter in words).split())


def _environment(scratch: str, hidden: list[Path]) -> dict[str, str]:
    """One thread each, since what is parallel here is the children; no word of what is hidden."""
    root = str(Path(__file__).parent.parent)
    # The search path travels too, for plugin trackers.
    path = os.pathsep.join(dict.fromkeys([root, *(entry or os.getcwd() for entry in sys.path)]))
    secret = [str(place) for place in hidden]
    kept = {name: value for name, value in os.environ.items() if not any(place in value for place in secret)}
    folder = {**dict.fromkeys(("TMPDIR", "TEMP", "TMP", "PWD"), scratch), "OLDPWD": "/"}
    return {**kept, **ONE_THREAD, **folder, "PYTHONPATH": path}


def _descendants(process: int) -> list[int]:
    """Numbers of all processes below one."""
    try:
        return list(_walk(process))
    except FileNotFoundError:
        try:
            return [child.pid for child in psutil.Process(process).children(recursive=True)]
        except psutil.Error:
            return []


def _walk(process: int) -> Iterator[int]:
    # Ten times as fast as going through all processes of the machine, ten times a second.
    for task in os.listdir(f"/proc/{process}/task"):
        for word in Path(f"/proc/{process}/task/{task}/children").read_text(encoding="ascii").split():
            yield int(word)
            with contextlib.suppress(FileNotFoundError, ProcessLookupError):
                yield from _walk(int(word))


def _megabytes(tree: list[psutil.Process]) -> float:
    """Memory of their own: pages of libraries are nobody's, those of forked processes are counted once."""
    total = 0.0
    for process in tree:
        with contextlib.suppress(psutil.Error, OSError):
            if not sys.platform.startswith("linux"):
                memory = process.memory_info()
                total += memory.rss - getattr(memory, "shared", 0)
            elif len(tree) > 1:
                total += process.memory_full_info().pss
            else:
                total += _own_bytes(process.pid)
    return (total + _unmapped_bytes(tree)) / 2**20


def _own_bytes(process: int) -> int:
    """Resident memory without the pages of files; what a process could share with others (``mmap``) is its own."""
    return _status_bytes(process, "RssAnon:", "RssShmem:")


def _status_bytes(process: int, *names: str) -> int:
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii", errors="replace").splitlines()
    return 1024 * sum(int(line.split()[1]) for line in lines if line.startswith(names))


def _unmapped_bytes(tree: list[psutil.Process]) -> int:
    """Files in memory (``memfd_create``) that are open, beyond what of such is mapped and counted there."""
    mapped, files = 0, {}
    for process in tree:
        with contextlib.suppress(OSError):
            mapped += _status_bytes(process.pid, "RssShmem:")
            for place in Path(f"/proc/{process.pid}/fd").iterdir():
                with contextlib.suppress(OSError):
                    if os.readlink(place).startswith("/memfd:"):
                        found = place.stat()
                        files[found.st_dev, found.st_ino] = 512 * found.st_blocks
    return max(sum(files.values()) - mapped, 0)


def _death(code: int, complaint: str) -> str:
    if code == 0:
        return "ended its process"
    if code > 0:
        # Python's own end, whose last line says why; a signal leaves nothing of ours there.
        return ": ".join(part for part in (f"ended its process with code {code}", complaint) if part)
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"was killed ({name})" if -code in _OUTSIDE else f"crashed ({name})"
