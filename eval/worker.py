"""The process in which one tracker runs: it reads commands, feeds frames and writes one record per frame.

Run as ``python -m eval.worker`` by :mod:`eval.runner` and by nobody else. It is cheap to start, knows no truth, and
writes each record as soon as it exists, so that nothing is lost when the tracker takes the process down with it.

Commands, one JSON object per line of standard input::

    {"do": "open", "factory": "pkg.module:name", "params": {...}, "frames": {...}, "box": [x, y, w, h]}
    {"do": "update", "count": 40, "timed": false}

Records, one JSON object per line of standard output: ``{"opened": true}``, then per update
``{"ok": true, "box": [x, y, w, h], "score": 0.9}``, when timed with "cpu_ms" and "wall_ms" of the call of `update`
alone, or ``{"failure": "..."}``, which ends the track.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Iterator, Mapping
from importlib import import_module
from time import perf_counter, process_time
from typing import Any, TextIO

import cv2
import numpy as np
from numpy.typing import NDArray

from .framesource import FrameSource, FrameSourceError

__all__ = ["ONE_THREAD", "UNWRITTEN", "main", "resolve"]

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
"""Environment of a process in which nothing runs beside what is measured."""

UNWRITTEN = 74
"""Exit code of a worker whose records cannot be written (EX_IOERR of sysexits.h): not its tracker's fault."""


def resolve(reference: str) -> Any:
    """Return the object that ``"pkg.module:name"`` refers to.

    Raises
    ------
    ValueError
        If there is no such module or name in it.
    """
    module, _, name = reference.partition(":")
    if not module or not name:
        raise ValueError(f"expected pkg.module:factory, got {reference!r}")
    try:
        found = import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"cannot load {reference!r}: {error}") from error
    return found


class _Track:
    """A tracker on its way through the frames of one sequence."""

    def __init__(self, command: Mapping[str, Any]) -> None:
        self._frames: Iterator[NDArray[Any]] = iter(FrameSource.from_json(command["frames"]))
        self._tracker = resolve(command["factory"])(**command["params"])
        # cv2's newer trackers take whole numbers only, so every tracker gets them.
        box = tuple(round(value) for value in command["box"])
        if self._tracker.init(next(self._frames), box) is False:
            raise ValueError(f"init refused the box {box}")

    def update(self, timed: bool) -> dict[str, Any] | None:
        frame = next(self._frames, None)
        if frame is None:
            return None
        start, busy = perf_counter(), process_time()
        answer = self._tracker.update(frame)
        times = {"cpu_ms": 1000.0 * (process_time() - busy), "wall_ms": 1000.0 * (perf_counter() - start)}
        ok, box = _checked(answer)
        return {"ok": ok, "box": box, "score": self._score(), **(times if timed else {})}

    def _score(self) -> float:
        # OpenCV 5 gives every tracker the method; −1 is its way of saying that there is no score.
        score = float(self._tracker.getTrackingScore()) if hasattr(self._tracker, "getTrackingScore") else math.nan
        return score if score >= 0 else math.nan


def _checked(answer: Any) -> tuple[bool, list[float]]:
    try:
        ok, box = answer
        values = [float(value) for value in box]
    except (TypeError, ValueError):
        values = []
    if len(values) != 4:
        raise ValueError(f"update returned {answer!r}, expected (ok, (x, y, w, h))")
    return bool(ok), values


def _obey(commands: Iterator[str], write: Any) -> None:
    track: _Track | None = None
    runner = os.getppid()
    for line in commands:
        command = json.loads(line)
        try:
            if command["do"] == "open":
                track = None
                track = _Track(command)
                write({"opened": True})
            else:
                for _ in range(command["count"]):
                    record = track.update(command["timed"]) if track is not None else None
                    # Nobody waits for a worker whose runner was killed.
                    if record is None or os.getppid() != runner:
                        break
                    write(record)
        except FrameSourceError as error:
            track = None
            write({"failure": str(error)})
        except SystemExit:
            raise
        except BaseException as error:  # whatever a tracker raises is its row's reason and not ours to die of
            # Ctrl-C does not reach this process, so that KeyboardInterrupt is the tracker's too.
            track = None
            words = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
            write({"failure": f"raised {words.removesuffix(': ')}"})


def main() -> None:
    """Serve until standard input ends."""
    # What a tracker prints must not mix with the records: it goes to standard error.
    output: TextIO = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)
    cv2.setNumThreads(1)
    np.seterr(all="ignore")

    def write(record: Mapping[str, Any]) -> None:
        try:
            output.write(json.dumps(record) + "\n")
            output.flush()
        except OSError:
            # At once: Python would try to write it again on its way out.
            os._exit(UNWRITTEN)

    _obey(iter(sys.stdin.readline, ""), write)


if __name__ == "__main__":
    main()
