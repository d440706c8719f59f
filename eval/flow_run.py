"""Run flow methods on pairs, each in a process of its own and on one thread; keep the results on disk.

The only place of the flow comparison that touches a result file; only :mod:`eval.flow_worker` touches a clock.
"""

from __future__ import annotations

import hashlib
import json
import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from . import flow_metrics, flow_picture, flow_worker
from .flow_data import FlowPair
from .flow_methods import flow_method
from .flow_metrics import flow_scores
from .flow_picture import flow_to_color, largest_flow
from .worker import ONE_THREAD

__all__ = ["FlowResult", "MethodProcess", "RunOptions", "run_pair"]


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


@dataclass(frozen=True)
class FlowResult:
    """What one method did on one pair.

    Parameters
    ----------
    method, pair, group : str
    scores : mapping
        Metric name to value; empty if the method failed.
    seconds : float or None
        Median processor time of a call, warm, on one thread.
    relative : float or None
        The same in units of the yardstick's time, measured just before in the same process.
    note : str
        Why there are no scores, else "".
    """

    method: str
    pair: str
    group: str
    scores: Mapping[str, float] = field(default_factory=dict)
    seconds: float | None = None
    relative: float | None = None
    note: str = ""


def run_pair(process: MethodProcess, pair: FlowPair, folder: Path, options: RunOptions) -> FlowResult:
    """One method on one pair: from disk if the same thing was measured before, else run and kept.

    Parameters
    ----------
    process : MethodProcess
    pair : FlowPair
    folder : Path
        Holds ``results/METHOD/PAIR.json`` and ``pictures/PAIR/METHOD.png``.
    options : RunOptions

    Returns
    -------
    FlowResult
        A failure is a result with a note; it is not kept, so the next run tries again.
    """
    safe = process.name.replace(":", "-")
    file = folder / "results" / safe / f"{pair.name}.json"
    picture = picture_path(folder, pair.name, process.name)
    key = _key(process.name, pair)
    kept = _load(file, key)
    if kept is not None and picture.is_file():
        return kept
    try:
        flow, seconds, relative = process.measure(pair, options)
        scores = flow_scores(pair.flow, flow, pair.valid)
    except MethodError as error:
        return FlowResult(process.name, pair.name, pair.group, note=str(error))
    except ValueError as error:
        return FlowResult(process.name, pair.name, pair.group, note=f"failed: {error}")
    result = FlowResult(process.name, pair.name, pair.group, scores, seconds, relative)
    picture.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(picture), flow_to_color(flow, largest_flow(pair.flow, pair.valid)))
    _save(file, key, result)
    return result


def picture_path(folder: Path, pair: str, method: str) -> Path:
    """Where the colour-wheel picture of a result is kept."""
    return folder / "pictures" / pair / f"{method.replace(':', '-')}.png"


def _key(name: str, pair: FlowPair) -> str:
    digest = hashlib.sha256(f"{flow_method(name).fingerprint()}/{pair.fingerprint}/{pair.group}".encode())
    for module in (flow_metrics, flow_picture, flow_worker):
        digest.update(Path(str(module.__file__)).read_bytes())
    return digest.hexdigest()[:16]


def _load(file: Path, key: str) -> FlowResult | None:
    try:
        kept = json.loads(file.read_text(encoding="utf-8"))
        return FlowResult(**kept["result"]) if kept["key"] == key else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _save(file: Path, key: str, result: FlowResult) -> None:
    provenance = {"opencv": cv2.__version__, "numpy": np.__version__, "source": flow_method(result.method).source}
    text = json.dumps({"key": key, "provenance": provenance, "result": asdict(result)}, indent=1)
    file.parent.mkdir(parents=True, exist_ok=True)
    # Written beside and renamed, so that an interrupted run leaves no half file to be read back.
    partial = file.with_suffix(".partial")
    partial.write_text(text, encoding="utf-8")
    partial.replace(file)


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
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> MethodProcess:
        """Nothing to do yet."""
        return self

    def __exit__(self, *exception: object) -> None:
        """End the process."""
        self.close()

    def close(self) -> None:
        """End the process, if there is one."""
        if self._process is not None:
            self._process.kill()
            # Reaps the process and closes its pipes.
            self._process.communicate()
        self._process = None

    def measure(self, pair: FlowPair, options: RunOptions) -> tuple[NDArray[np.float32], float, float]:
        """Flow, median seconds per call, and the same relative to the yardstick.

        Raises
        ------
        MethodError
            If the method's library is missing, the method raises, crashes or takes too long.
        """
        if self._process is None:
            self._process = _start(self.name)
        request = (pair.frames, pair.index, options.repeats, options.budget)
        answer = _exchange(self._process, request, options.timeout)
        if answer is None:
            code = self._process.wait()
            self.close()
            # Only our own timer kills with this signal.
            late = code == -signal.SIGKILL
            raise MethodError(f"failed: no answer in {options.timeout:g} s" if late else f"failed: exit code {code}")
        kind, content = answer
        if kind != "ok":
            raise MethodError(f"{kind}: {content}")
        flow, seconds, relative = content
        return flow, seconds, relative


def _start(name: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "eval.flow_worker", name],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        cwd=Path(__file__).parent.parent,
        env=os.environ | ONE_THREAD,
    )


def _exchange(process: subprocess.Popen[bytes], request: object, timeout: float) -> tuple[str, Any] | None:
    """Send a request and wait for its answer; None if the process died, or was killed because it took too long."""
    assert process.stdin is not None
    assert process.stdout is not None
    timer = threading.Timer(timeout, process.kill)
    timer.start()
    try:
        pickle.dump(request, process.stdin, protocol=pickle.HIGHEST_PROTOCOL)
        process.stdin.flush()
        answer: tuple[str, Any] = pickle.load(process.stdout)
        return answer
    except (EOFError, OSError, pickle.UnpicklingError):
        return None
    finally:
        timer.cancel()
