"""The process in which one flow method runs: it reads pairs, answers flows and times, and knows no truth.

Run as ``python -m eval.flow_worker METHOD`` by :mod:`eval.flow_run` and by nobody else. Pickles ``(frames, index,
repeats, budget)`` come by standard input; ``("ok", (flow, seconds, relative))``, ``("skipped", message)`` or
``("failed", message)`` go back by standard output.
"""

from __future__ import annotations

import os
import pickle
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .flow_methods import YARDSTICK, MissingLibraryError, estimate_flow, flow_method

__all__ = ["main"]


class _Methods:
    """Methods made once each, so that what they keep from call to call stays warm."""

    def __init__(self) -> None:
        self._functions: dict[str, Callable[..., Any]] = {}

    def flow(self, name: str, frames: Sequence[NDArray[np.uint8]], index: int) -> NDArray[np.float32]:
        """Flow of one pair by one method."""
        method = flow_method(name)
        if name not in self._functions:
            self._functions[name] = method.factory()
        return estimate_flow(method, self._functions[name], frames, index)

    def timed(self, name: str, frames: Sequence[NDArray[np.uint8]], index: int) -> tuple[NDArray[np.float32], float]:
        """Flow of one pair and the processor time of the call, s.

        Processor time, not the clock on the wall: all runs on one thread, where the two agree on an idle machine, and
        on a busy one the wall clock measures the other processes.
        """
        start = time.process_time()
        flow = self.flow(name, frames, index)
        return flow, time.process_time() - start


SLOW = 2.0
"""A method whose first call takes longer is not called again for its time: warming up is little of it. Seconds."""


def _measure(
    methods: _Methods, name: str, frames: Sequence[NDArray[np.uint8]], index: int, repeats: int, budget: float
) -> tuple[NDArray[np.float32], float, float]:
    """Flow of a first call, which compiles and allocates, then median times of a few more.

    They are taken in turns with the yardstick, because a noisy machine slows both and so leaves their ratio alone.
    """
    flow, first = methods.timed(name, frames, index)
    methods.flow(YARDSTICK, frames, index)
    yardstick = [methods.timed(YARDSTICK, frames, index)[1]]
    times = [first] if first > SLOW else []
    while len(times) < repeats and sum(times) < budget:
        times.append(methods.timed(name, frames, index)[1])
        yardstick.append(methods.timed(YARDSTICK, frames, index)[1])
    return flow, float(np.median(times)), float(np.median(times) / np.median(yardstick))


def _answer(methods: _Methods, name: str, request: tuple[Any, ...]) -> tuple[str, Any]:
    try:
        return "ok", _measure(methods, name, *request)
    except MissingLibraryError as error:
        return "skipped", str(error)
    except Exception as error:  # whatever a method raises must become its row's note, not our crash
        last = traceback.extract_tb(error.__traceback__)[-1]
        message = " ".join(f"{type(error).__name__}: {error}".split())
        return "failed", f"{message} ({Path(last.filename).name}:{last.lineno})"


def main(name: str) -> None:
    """Serve one method until standard input ends.

    Parameters
    ----------
    name : str
        As ``flow_method`` takes it.
    """
    cv2.setNumThreads(1)
    requests, answers = sys.stdin.buffer, os.fdopen(os.dup(1), "wb")
    # What a library prints must not land between the pickles.
    os.dup2(2, 1)
    methods = _Methods()
    while True:
        try:
            request = pickle.load(requests)
        except EOFError:
            return
        pickle.dump(_answer(methods, name, request), answers, protocol=pickle.HIGHEST_PROTOCOL)
        answers.flush()


if __name__ == "__main__":
    main(sys.argv[1])
