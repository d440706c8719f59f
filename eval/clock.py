"""Times that a child reports, held against the clock of the parent.

A child measures the call that counts, and nothing round it. It could be made to say anything, so that each time must
be positive, no longer than the exchange in which it was reported, and not much shorter either; nor may the child have
worked much longer between the calls than it takes to be handed what they are about.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .process import Child, ChildError

__all__ = ["Clock", "SkippedError", "UntrueTimeError", "untrue_time"]

# What an exchange may take besides the call, with the caches that a long call leaves; more on a machine under load.
_SLACK_MS = 0.2
_MOST_LOAD = 5.0
_SLACK_EXCHANGES = 5.0
_SLACK_SHARE = 0.05
_ONCE_MS = 10.0  # beside all calls together
_FEWEST = 3  # calls that are judged together: one alone may pay for pages and caches that others have taken


class UntrueTimeError(ChildError):
    """A time that was reported cannot be true."""


class SkippedError(ChildError):
    """What is judged is not there on this machine; the message says what is missing."""


class Clock:
    """The clock of one child: to be made before anything foreign runs in it.

    Parameters
    ----------
    child : Child
    frame : ndarray, optional
        One like those that will be handed over before the calls.
    """

    def __init__(self, child: Child, frame: NDArray[Any] | None = None) -> None:
        self._child = child
        # Before what is judged is there, which could make it look long.
        self._transport_ms = 1000.0 * child.transport()
        self._byte_ms = 0.0 if frame is None else 1000.0 * child.transport([frame]) / frame.nbytes
        self._missing: list[tuple[float, float]] = []
        self.begin()

    def begin(self, frame: NDArray[Any] | None = None) -> None:
        """Charge from here on what the child works beside its calls, too.

        Parameters
        ----------
        frame : ndarray, optional
            One like this is handed over before each call.
        """
        self._handing_ms = 0.0 if frame is None else self._byte_ms * frame.nbytes
        self._begun_ms, self._reported_ms, self._calls = 1000.0 * self._child.processor_seconds(), 0.0, 0

    def timed(self, content: Mapping[str, Any]) -> tuple[float, float]:
        """Processor time and time that passed of one call, ms, as the answer's "cpu_ms" and "wall_ms" say.

        Raises
        ------
        ChildError
            If there is no answer; a :class:`SkippedError` if there is nothing to call.
        UntrueTimeError
            If the times in it cannot be true.
        """
        answer = self._child.ask(content)
        if "skipped" in answer.content:
            raise SkippedError(str(answer.content["skipped"]))
        try:
            cpu, wall = float(answer.content["cpu_ms"]), float(answer.content["wall_ms"])
        except (KeyError, TypeError, ValueError) as error:
            raise ChildError("wrote among its own answers") from error
        complaint = untrue_time(cpu, wall, 1000.0 * answer.cpu, 1000.0 * answer.wall)
        if complaint:
            raise UntrueTimeError(complaint)
        if not math.isnan(answer.cpu):
            self._missing.append((1000.0 * answer.cpu - cpu, cpu))
        self._reported_ms += cpu
        self._calls += 1
        return cpu, wall

    def check(self) -> None:
        """Refuse times that leave out what our clock has seen: in calls since the last check, or beside all calls.

        Of the calls the median of a few decides.

        Raises
        ------
        UntrueTimeError
            Saying how much is missing.
        """
        if len(self._missing) >= _FEWEST:
            missing, reported = np.median(self._missing, axis=0).tolist()
            self._missing.clear()
            if missing > self._slack_ms() + _SLACK_SHARE * reported:
                raise UntrueTimeError(
                    f"reported {missing:.3f} ms less per call than it took by the clock of the referee"
                )
        beside = 1000.0 * self._child.processor_seconds() - self._begun_ms - self._reported_ms
        each = self._slack_ms() + _SLACK_EXCHANGES * (self._transport_ms + self._handing_ms)
        if beside > _ONCE_MS + self._calls * each + _SLACK_SHARE * self._reported_ms:
            raise UntrueTimeError(f"worked {beside / max(self._calls, 1):.3f} ms per call beside its calls")

    def _slack_ms(self) -> float:
        return _SLACK_MS * _load() + _SLACK_EXCHANGES * self._transport_ms


def _load() -> float:
    """How many processes want each core, at least 1."""
    return min(max(os.getloadavg()[0] / (os.cpu_count() or 1), 1.0), _MOST_LOAD)


def untrue_time(cpu: float, wall: float, our_cpu: float, our_wall: float) -> str:
    """Say why times that a child reports for one call cannot be true, or nothing.

    Parameters
    ----------
    cpu, wall : float
        Processor time and time that passed, ms, as reported.
    our_cpu, our_wall : float
        The same for the whole exchange, by our own clock; `our_cpu` is NaN where the system does not tell.
    """
    if not (0.0 < cpu < math.inf and 0.0 < wall < math.inf):
        return f"reported a call of {min(cpu, wall):g} ms"
    if wall > our_wall:
        return f"reported a call of {wall:.3f} ms, which took {our_wall:.3f} ms by the clock of the referee"
    if cpu > our_cpu:
        return f"reported {cpu:.3f} ms of processor time, and has taken {our_cpu:.3f} ms"
    return ""
