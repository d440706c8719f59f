"""Run flow methods on pairs, each in a process of its own and on one thread; keep the results on disk."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from .. import clock, wire
from ..clock import Clock, SkippedError
from ..process import Child, ChildError, Limits, isolation
from ..results import FlowResult, Folder, ResultsError, provenance
from . import metrics, picture, service
from .data import FlowPair
from .methods import YARDSTICK, flow_method
from .metrics import flow_scores
from .picture import flow_to_color, largest_flow

__all__ = ["MethodProcess", "RunOptions", "picture_path", "run_pair"]

SLOW_MS = 2000.0
"""A method whose first call takes longer is not called again for its time: warming up is little of it."""


@dataclass(frozen=True)
class RunOptions:
    """How to measure.

    Parameters
    ----------
    repeats : int
        Most timed calls per pair.
    budget : float
        Stop repeating a slow method after this much time per pair, s.
    timeout : float
        A method that needs longer than this for one pair has failed, s.
    """

    repeats: int = 5
    budget: float = 0.5
    timeout: float = 180.0

    def __post_init__(self) -> None:
        """Check the values."""
        if self.repeats < 1 or self.budget <= 0 or self.timeout <= 0:
            raise ValueError(f"expected repeats >= 1 and positive budget and timeout, got {self}")


def run_pair(process: MethodProcess, pair: FlowPair, folder: Path, options: RunOptions) -> FlowResult:
    """One method on one pair: from disk if the same thing was measured before, else run and kept.

    Parameters
    ----------
    process : MethodProcess
    pair : FlowPair
    folder : Path
        Of results; gets ``pictures/PAIR/METHOD.png`` besides.
    options : RunOptions

    Returns
    -------
    FlowResult
        A failure is a result with a note; it is not kept, so the next run tries again.
    """
    results, image = Folder(folder), picture_path(folder, pair.name, process.name)
    key = _key(process.name, pair)
    kept = _stored(results, key, process.name, pair)
    if kept is not None and image.is_file():
        return kept
    try:
        flow, seconds, relative = process.measure(pair, options)
        scores = flow_scores(pair.flow, flow, pair.valid)
    except MethodError as error:
        return FlowResult(key, process.name, pair.name, pair.group, note=str(error))
    except ValueError as error:
        return FlowResult(key, process.name, pair.name, pair.group, note=f"failed: {error}")
    stamp = {**provenance(), "isolation": isolation(), "source": flow_method(process.name).source}
    result = FlowResult(key, process.name, pair.name, pair.group, scores, seconds, relative, provenance=stamp)
    image.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(image), flow_to_color(flow, largest_flow(pair.flow, pair.valid)))
    results.write_flow(result)
    return result


def _stored(results: Folder, key: str, method: str, pair: FlowPair) -> FlowResult | None:
    path = results.flow_path(method, pair.name)
    if not path.exists():
        return None
    try:
        result = results.read_flow(path)
    except ResultsError:
        return None
    return result if result.key == key else None


def picture_path(folder: Path, pair: str, method: str) -> Path:
    """Where the colour-wheel picture of a result is kept."""
    return folder / "pictures" / pair / f"{method.replace(':', '-')}.png"


def _key(name: str, pair: FlowPair) -> str:
    digest = hashlib.sha256(f"{flow_method(name).fingerprint()}/{pair.fingerprint}/{pair.group}".encode())
    for module in (metrics, picture, service, clock, wire):
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()[:16]


class MethodError(RuntimeError):
    """A method could not be run; the message is the note in the tables."""


class MethodProcess:
    """A process that holds one method: a crash or an endless loop in it costs one row, and threads are ours to set.

    Parameters
    ----------
    name : str
        As ``flow_method`` takes it. The process starts with the first pair that must be run.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._child: Child | None = None
        self._clock: Clock | None = None

    def __enter__(self) -> MethodProcess:
        """Nothing to do yet."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the process."""
        if self._child is not None:
            self._child.close()

    def measure(self, pair: FlowPair, options: RunOptions) -> tuple[NDArray[np.float32], float, float]:
        """Flow, median seconds per call, and the same relative to the yardstick.

        Raises
        ------
        MethodError
            If the method's library is missing, the method raises, crashes or takes too long.
        """
        try:
            if self._child is None or not self._child.running():
                self._child = Child(f"{service.__name__}:Methods", Limits(seconds=options.timeout, processes=1))
                self._clock = Clock(self._child)
            assert self._clock is not None
            self._child.ask({"do": "pair", "index": pair.index}, pair.frames)
            return self._measure(self._child, self._clock, pair, options)
        except SkippedError as error:
            raise MethodError(f"skipped: {error}") from error
        except ChildError as error:
            raise MethodError(f"failed: {error}") from error

    def _measure(
        self, child: Child, clock: Clock, pair: FlowPair, options: RunOptions
    ) -> tuple[NDArray[np.float32], float, float]:
        """Flow of a first call, which compiles and allocates, then median times of a few more.

        They are taken in turns with the yardstick: a noisy machine slows both and so leaves their ratio alone.
        """

        def call(name: str) -> float:
            return clock.timed({"do": "call", "method": name})[0]

        first = call(self.name)
        flow = self._flow(child, pair)
        call(YARDSTICK)
        yardstick = [call(YARDSTICK)]
        times = [first] if first > SLOW_MS else []
        clock.begin()
        while len(times) < options.repeats and sum(times) < 1000.0 * options.budget:
            times.append(call(self.name))
            yardstick.append(call(YARDSTICK))
        clock.check()
        return flow, float(np.median(times)) / 1000.0, float(np.median(times) / np.median(yardstick))

    def _flow(self, child: Child, pair: FlowPair) -> NDArray[np.float32]:
        arrays = child.ask({"do": "flow"}).arrays
        if len(arrays) != 1 or arrays[0].dtype != np.float32 or arrays[0].shape != pair.flow.shape:
            raise ChildError("wrote among its own answers")
        return arrays[0]
