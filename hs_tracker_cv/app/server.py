"""The server of a page's process: a port of the loopback interface, guarded, with NiceGUI behind."""

from __future__ import annotations

import errno
import json
import os
import socket
import sys
import threading
from typing import Any

import uvicorn
from fastapi import FastAPI
from nicegui import ui

from . import HOST
from .guard import Guard

__all__ = ["PageServer", "listen", "report"]

TRIED_PORTS = 20
"""How many ports are tried, from the wanted one on."""
RECONNECT_SECONDS = 15.0
"""How long a page that has lost its connection keeps its video: a busy machine, a laptop that slept for a moment."""
GRACE_SECONDS = 2
"""How long open connections may delay the end."""


def listen(port: int) -> socket.socket:
    """Bind the first free port from `port` on; any free one for 0.

    Raises
    ------
    OSError
        If none of them can be bound.
    """
    last = min(port + TRIED_PORTS - 1, 65535)
    for candidate in range(port, last + 1):
        try:
            return socket.create_server((HOST, candidate))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise OSError(
                    error.errno, f"port {candidate} cannot be had ({os.strerror(error.errno or 0)})"
                ) from error
    raise OSError(errno.EADDRINUSE, f"ports {port} to {last} are taken")


def report(**facts: Any) -> None:
    """Tell the parent process, which reads one line of JSON from standard output."""
    sys.stdout.write(json.dumps(facts) + "\n")
    sys.stdout.flush()


class PageServer(uvicorn.Server):
    """Serves the declared pages to whoever holds the token; tells the parent when it does, and ends with it.

    Parameters
    ----------
    listener : socket
        Bound and listening.
    token, ticket : str
        As for Guard.
    """

    def __init__(self, listener: socket.socket, *, token: str, ticket: str) -> None:
        self._listener = listener
        outer = FastAPI(openapi_url=None)
        # Tailwind looks at whatever changes on the page, at each frame, for classes that ours has not.
        ui.run_with(
            outer,
            title="hs-track",
            dark=None,
            tailwind=False,
            reconnect_timeout=RECONNECT_SECONDS,
            show_welcome_message=False,
        )
        guarded = Guard(outer, port=listener.getsockname()[1], token=token, ticket=ticket)
        # On the loopback interface compression costs more than it saves; wsproto comes with NiceGUI.
        config = uvicorn.Config(
            guarded,
            log_level="warning",
            ws="wsproto",
            ws_per_message_deflate=False,
            timeout_graceful_shutdown=GRACE_SECONDS,
        )
        super().__init__(config)

    def serve_until_end(self) -> None:
        """Serve until `end`, a signal, or the end of the parent process."""
        threading.Thread(target=self._await_parent, daemon=True).start()
        self.run(sockets=[self._listener])

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start, and say so."""
        await super().startup(sockets)
        if self.started:
            report(port=self._listener.getsockname()[1])

    def end(self) -> None:
        """End soon: what is being answered is still answered."""
        self.should_exit = True

    def _await_parent(self) -> None:
        # A killed parent cannot end its server; but the pipe from it closes.
        sys.stdin.read()
        self.end()
