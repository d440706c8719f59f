"""One flow method in a process of its own: the service that answers flows and times (see :mod:`eval.worker`).

Requests: ``{"do": "pair", "index": 0}`` with the frames, which what follows is about; ``{"do": "call", "method":
"farneback"}``, whose answer is ``{"cpu_ms": 1.2, "wall_ms": 1.3}``, the times of the call alone; ``{"do": "flow"}``,
whose answer is the flow of the last call. ``{"skipped": "..."}`` says that the method's library is missing.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from time import perf_counter, process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..worker import Arrays
from .methods import MissingLibraryError, estimate_flow, flow_method

__all__ = ["Methods"]


class Methods:
    """Methods made once each, so that what they keep from call to call stays warm."""

    def __init__(self) -> None:
        self._functions: dict[str, Callable[..., Any]] = {}
        self._frames: Arrays = ()
        self._index = 0
        self._flow: NDArray[np.float32] | None = None

    def answer(self, content: Mapping[str, Any], arrays: Arrays) -> tuple[Mapping[str, Any], Arrays]:
        """Do what is asked."""
        if content["do"] == "pair":
            self._frames, self._index, self._flow = arrays, content["index"], None
            return {}, ()
        if content["do"] == "flow":
            return {}, [] if self._flow is None else [self._flow]
        try:
            return self._call(content["method"]), ()
        except MissingLibraryError as error:
            return {"skipped": str(error)}, ()
        except Exception as error:  # whatever a method raises must become its row's note, with the place
            last = traceback.extract_tb(error.__traceback__)[-1]
            message = " ".join(f"{type(error).__name__}: {error}".split())
            return {"failure": f"{message} ({Path(last.filename).name}:{last.lineno})"}, ()

    def _call(self, name: str) -> dict[str, float]:
        method = flow_method(name)
        start, busy = perf_counter(), process_time()
        if name not in self._functions:
            self._functions[name] = method.factory()
        self._flow = estimate_flow(method, self._functions[name], self._frames, self._index)
        # Processor time counts: all runs on one thread, where it is the time that passes on an idle machine; on a
        # busy one that measures the other processes.
        return {"cpu_ms": 1000.0 * (process_time() - busy), "wall_ms": 1000.0 * (perf_counter() - start)}
