"""What long work says while it runs: a bar on a terminal, a line now and then in a file or a pipe."""

from __future__ import annotations

import sys
import threading
import time
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

__all__ = ["Steps", "make_console"]

_WIDEST = 10_000  # columns, where nobody's window ends: more than any table has

LINE_SECONDS = 20.0
"""Time between two lines where there is no terminal."""


def make_console() -> Console:
    """Console of standard output that shows every text as it is, `[red]` and `:100:` too.

    Tables that go to a file or a pipe are as wide as they are.
    """
    return Console(width=None if sys.stdout.isatty() else _WIDEST, markup=False, emoji=False)


class Steps:
    """Progress through a known number of steps: a context manager whose methods any thread may call.

    Parameters
    ----------
    console : Console
        Of `make_console`: titles and lines hold words of others.
    title : str
    total : int
    """

    def __init__(self, console: Console, title: str, total: int) -> None:
        self._console, self._title, self._total = console, title, total
        columns = (
            TextColumn("{task.description}", markup=False),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TimeRemainingColumn(),
        )
        self._bar = Progress(*columns, console=console, disable=not console.is_terminal)
        self._task = self._bar.add_task(title, total=total)
        self._lock = threading.Lock()
        self._done = 0
        self._begin = self._last = time.monotonic()

    def __enter__(self) -> Steps:
        """Show the bar."""
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Leave what was said last on the screen."""
        self._bar.stop()
        self._line()

    def advance(self, now: str = "") -> None:
        """Count a finished step; `now` says what is being done."""
        with self._lock:
            self._done += 1
            self._bar.update(self._task, completed=self._done, description=f"{self._title}  {now}".rstrip())
            if time.monotonic() - self._last > LINE_SECONDS:
                self._line()

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self._bar.console.print(text, style="yellow")

    def _line(self) -> None:
        if self._console.is_terminal:
            return
        self._last = time.monotonic()
        self._console.print(f"{self._title}: {self._done} of {self._total} in {self._last - self._begin:.0f} s")
