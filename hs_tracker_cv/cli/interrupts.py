"""Ctrl-C, a request to terminate and a terminal that is closed: files are finished, servers ended."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

__all__ = ["Interrupted", "Pending", "deferred_interrupts", "interrupts_raised"]

Handler = Callable[[int, FrameType | None], Any]

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # not every system has each
_SIGNALS = tuple(getattr(signal, name) for name in _NAMES if hasattr(signal, name))


class Interrupted(KeyboardInterrupt):
    """A signal that asks us to end; `code` is the exit code that says which."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.code = 128 + number


class Pending:
    """Signals that have come while they were deferred.

    Attributes
    ----------
    code : int or None
        Exit code for the first one; None while there is none.
    """

    def __init__(self) -> None:
        self.code: int | None = None

    def take(self, number: int, frame: FrameType | None = None) -> None:
        """Note a signal. Later ones change nothing: a terminal that closes sends more than one."""
        self.code = 128 + number if self.code is None else self.code


def interrupts_raised() -> contextlib.AbstractContextManager[None]:
    """Raise Interrupted at once where a signal comes."""
    return _handling(_raise)


@contextlib.contextmanager
def deferred_interrupts() -> Iterator[Pending]:
    """Note signals instead of raising: the caller asks between two pieces of work that belong together."""
    pending = Pending()
    with _handling(pending.take):
        yield pending


def _raise(number: int, frame: FrameType | None) -> None:
    raise Interrupted(number)


@contextlib.contextmanager
def _handling(handler: Handler) -> Iterator[None]:
    """Handle the signals in the block, those apart that the caller ignores (nohup, background jobs)."""
    before: dict[int, Any] = {}
    if threading.current_thread() is threading.main_thread():
        for number in _SIGNALS:
            if signal.getsignal(number) not in (signal.SIG_IGN, None):
                before[number] = signal.signal(number, handler)
    try:
        yield
    finally:
        for number, old in before.items():
            signal.signal(number, old)
