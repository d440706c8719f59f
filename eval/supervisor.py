"""The first process of a child: it starts the worker, and ends whatever the worker leaves behind.

Run as ``python -m eval.supervisor LEASH RULES ALONE`` by :mod:`eval.process` and by nobody else; the first two are
numbers of file descriptors. Every process that the worker starts becomes a child of this one when its own parent
ends, in whatever session it is (``PR_SET_CHILD_SUBREAPER``, Linux), so that none can stay. When the leash is let go,
because the runner wants it or because it is gone, all of them end. It ends as its worker did: with the same code or
signal.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import threading
import time
from pathlib import Path

__all__ = ["SCRATCH", "main"]

SCRATCH = "hs_eval-"
"""What the names of working folders begin with."""

_SET_CHILD_SUBREAPER = 36
_AGAIN_SECONDS = 0.01


def main(leash: int, rules: int, alone: int) -> None:
    """Start the worker in a process of its own and see it end.

    Parameters
    ----------
    leash : int
        File descriptor at whose end everything ends.
    rules : int
        File descriptor of the sandbox's rules, or −1.
    alone : int
        1 if the worker may start no process.
    """
    if sys.platform.startswith("linux"):
        ctypes.CDLL(None).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0)
    worker = os.fork()
    if worker == 0:
        os.setsid()
        os.close(leash)
        _work(rules, alone)
        return
    # The pipes are the worker's: their other ends must see it end.
    for stream in (0, 1, *([rules] if rules >= 0 else [])):
        os.close(stream)
    threading.Thread(target=_kill_with, args=(leash,), daemon=True).start()
    status = _wait(worker)
    _end_all()
    _leave(status)


def _work(rules: int, alone: int) -> None:
    from .sandbox import confine, forbid_lasting_memory, forbid_processes

    if rules >= 0:
        confine(rules)
        os.close(rules)
    with contextlib.suppress(OSError):  # a kernel without filters still runs what is judged
        forbid_lasting_memory()
    if alone:
        forbid_processes()
    from .worker import serve

    serve()


def _wait(worker: int) -> int:
    """Status of the worker when it ends; whatever else ends is collected too."""
    while True:
        process, status = os.waitpid(-1, 0)
        if process == worker:
            return status


def _kill_with(leash: int) -> None:
    """Kill what there is as soon as the leash is let go; the main thread collects it."""
    os.read(leash, 1)
    while True:
        _kill_children()
        time.sleep(_AGAIN_SECONDS)


def _end_all() -> None:
    """End all children, and theirs, which become ours, until there are none."""
    while True:
        _kill_children()
        try:
            os.waitpid(-1, 0)
        except ChildProcessError:
            return


def _kill_children() -> None:
    for child in _children():
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.kill(child, signal.SIGKILL)


def _children() -> list[int]:
    try:
        tasks = list(Path("/proc/self/task").iterdir())
        return [int(word) for task in tasks for word in (task / "children").read_text().split()]
    except OSError:
        import psutil

        return [child.pid for child in psutil.Process().children()]


def _leave(status: int) -> None:
    import shutil

    # The working folder was made for the worker, by this name; a runner that is gone cannot remove it.
    folder = Path.cwd()
    if folder.name.startswith(SCRATCH):
        shutil.rmtree(folder, ignore_errors=True)
    if os.WIFSIGNALED(status):
        import resource

        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        with contextlib.suppress(OSError):  # SIGKILL cannot be handled anyway
            signal.signal(os.WTERMSIG(status), signal.SIG_DFL)
        os.kill(os.getpid(), os.WTERMSIG(status))
        signal.pause()
    os._exit(os.WEXITSTATUS(status))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
