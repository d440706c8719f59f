"""The process behind a page: ``python -m hs_tracker_cv.app select|live PORT …``; started by the package itself."""

from __future__ import annotations

import asyncio
import os
import sys

from . import HOST
from .live import live_page
from .selection import select_page

__all__: list[str] = []


def _main(page: str, port: int, *arguments: str) -> None:
    from nicegui import app, ui

    if page == "select":
        picture, answer, timeout = arguments
        select_page(picture, answer, float(timeout))
    else:
        live_page(*arguments)
    app.on_startup(lambda: asyncio.create_task(_end_with_parent()))
    ui.run(host=HOST, port=port, title="hs-track", dark=True, show=False, reload=False, show_welcome_message=False)


async def _end_with_parent() -> None:
    """A killed parent cannot end its server; the server notices."""
    from nicegui import app

    parent = os.getppid()
    while os.getppid() == parent:
        await asyncio.sleep(1.0)
    app.shutdown()


if __name__ == "__main__":
    _main(sys.argv[1], int(sys.argv[2]), *sys.argv[3:])
