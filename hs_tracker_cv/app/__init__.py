"""The browser pages: drag the box on the first frame, or watch the tracker think, live.

They need the extra ``app`` (NiceGUI). Each page is served by a process of its own on the loopback interface, so
that a server's global state never meets the caller's.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import socket
import subprocess
import sys
import tempfile
import time
import webbrowser
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2

from ..geometry import Box
from ..video import VideoError

__all__ = ["select_roi", "serve"]

HOST = "127.0.0.1"
START_SECONDS = 60.0
"""How long the server may take to answer its first connection."""


def select_roi(frame: Any, *, timeout: float = 600.0, show: bool = True, port: int | None = None) -> Box | None:
    """Let the user drag a box on a frame, in a browser; ``cv2.selectROI`` for wheels without windows.

    Parameters
    ----------
    frame : ndarray
        Gray, BGR or BGRA, uint8.
    timeout : float
        Seconds after which the page gives up.
    show : bool
        Open a browser window where there is a screen. Its address is written to stderr in any case.
    port : int, optional
        Port on the loopback interface; a free one by default.

    Returns
    -------
    Box or None
        In frame px, as dragged; None when nothing was selected in time.

    Raises
    ------
    ImportError
        If NiceGUI is not installed.
    VideoError
        If the page cannot be served.
    """
    _require_nicegui()
    with tempfile.TemporaryDirectory(prefix="hs-track-") as folder:
        picture, answer = Path(folder) / "frame.png", Path(folder) / "answer.json"
        picture.write_bytes(cv2.imencode(".png", frame)[1].tobytes())
        port = _free_port() if port is None else port
        with _page("select", str(picture), str(answer), str(timeout), port=port) as process:
            _announce("Drag a box round the object at", port, show=show)
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(timeout)
        return Box(*json.loads(answer.read_text())) if answer.exists() else None


def serve(video: str = "", *, port: int | None = None, show: bool = True) -> int:
    """Serve the live page until Ctrl-C.

    Parameters
    ----------
    video : str
        What the page opens at first; it can be changed there.
    port, show : int, bool
        As for select_roi.

    Returns
    -------
    int
        The server's exit code.

    Raises
    ------
    ImportError, VideoError
        As select_roi.
    """
    _require_nicegui()
    port = _free_port() if port is None else port
    with _page("live", video, port=port) as process:
        _announce("Watch the tracker at", port, show=show)
        return process.wait()


def _require_nicegui() -> None:
    if importlib.util.find_spec("nicegui") is None:
        raise ImportError("the page needs NiceGUI: pip install 'hs-tracker-cv[app]'")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return int(probe.getsockname()[1])


@contextlib.contextmanager
def _page(name: str, *arguments: str, port: int) -> Iterator[subprocess.Popen[bytes]]:
    """Run a page in a process of its own, until it ends or the block does."""
    # NiceGUI writes a storage folder into the working directory unless told otherwise.
    with tempfile.TemporaryDirectory(prefix="hs-track-storage-") as storage:
        environment = {**os.environ, "NICEGUI_STORAGE_PATH": storage}
        command = [sys.executable, "-m", "hs_tracker_cv.app", name, str(port), *arguments]
        process = subprocess.Popen(command, env=environment, stdin=subprocess.DEVNULL)
        try:
            _await_server(process, port)
            yield process
        finally:
            process.terminate()
            process.wait()


def _await_server(process: subprocess.Popen[bytes], port: int) -> None:
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline and process.poll() is None:
        with contextlib.suppress(OSError), socket.create_connection((HOST, port), timeout=1.0):
            return
        time.sleep(0.05)
    raise VideoError(f"the page could not be served on port {port}")


def _announce(words: str, port: int, *, show: bool) -> None:
    address = f"http://{HOST}:{port}/"
    print(f"{words} {address}", file=sys.stderr, flush=True)
    # Without a screen Python may start a text browser in this terminal, and wait for it.
    if show and (sys.platform in {"darwin", "win32"} or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()):
        webbrowser.open(address)
