"""The process behind a page, started by the package itself: takes its order as JSON on standard input."""

from __future__ import annotations

import json
import shutil
import sys
import tempfile

from ..video import silence_decoders
from .page import app_page
from .selection import select_page
from .server import PageServer, listen, report

__all__: list[str] = []


def _main() -> None:
    silence_decoders()
    # Secrets come through a pipe: other users may read the command line of a process.
    order = json.loads(sys.stdin.readline())
    tempfile.tempdir = order["folder"]
    try:
        listener = listen(order["port"])
    except OSError as error:
        report(error=error.strerror)
        return
    server = PageServer(listener, token=order["token"], ticket=order["ticket"])
    if order["page"] == "select":
        select_page(**order["arguments"], end=server.end)
    else:
        app_page(**order["arguments"])
    server.serve_until_end()
    # If the parent has been killed, nobody else does.
    shutil.rmtree(order["folder"], ignore_errors=True)


if __name__ == "__main__":
    _main()
