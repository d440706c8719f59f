"""The browser pages: drag the box on the first frame, or watch the tracker think, live.

They need the extra ``app`` (NiceGUI). Each page is served by a process of its own on the loopback interface, so
that a server's global state never meets the caller's, and to whoever holds the random token in its address only.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import os
import secrets
import subprocess
import sys
import tempfile
import webbrowser
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2

from ..geometry import Box
from ..video import VideoError

__all__ = ["select_roi", "serve"]

HOST = "127.0.0.1"
LAUNCH = """
import runpy, sys
sys.path[:] = [sys.argv[1], *filter(None, sys.path)]
runpy.run_module("hs_tracker_cv.app", run_name="__main__")
"""
"""What ``python -m hs_tracker_cv.app`` does, but never with modules that lie in the working directory: people track
videos in folders that they have downloaded."""
END_SECONDS = 10.0
"""How long a server may take to end before it is killed."""


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
        Port on the loopback interface, or the next free one if it is taken; any free one by default.

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
    with tempfile.TemporaryDirectory(prefix="hs-track-") as folder:
        picture, answer = Path(folder) / "frame.png", Path(folder) / "answer.json"
        picture.write_bytes(cv2.imencode(".png", frame)[1].tobytes())
        with _page("select", port, picture=str(picture), answer=str(answer)) as page:
            page.announce("Drag a box round the object at", show=show)
            with contextlib.suppress(subprocess.TimeoutExpired):
                page.process.wait(timeout)
        return Box(*json.loads(answer.read_text())) if answer.exists() else None


def serve(video: str = "", *, models: str = "", port: int | None = None, show: bool = True) -> int:
    """Serve the page until Ctrl-C.

    Parameters
    ----------
    video : str
        What the page opens at first: a video file, the number of a camera, a folder of images or of videos.
    models : str
        Folder that holds TrackerNano's models, for comparison; it must be named here, since a page opens no path.
    port, show : int, bool
        As for select_roi.

    Returns
    -------
    int
        The server's exit code.

    Raises
    ------
    ImportError, VideoError
        As select_roi; and if `video` or `models` cannot be used.
    """
    from .rivals import rivals
    from .sources import require

    require(video)
    if models and "TrackerNano" not in rivals(models):
        raise VideoError(f"{models}: holds no TrackerNano for this OpenCV (expected *backbone*.onnx and *head*.onnx)")
    with _page("app", port, video=video, models=models) as page:
        page.announce("The page is at", show=show)
        return page.process.wait()


def _require_nicegui() -> None:
    if importlib.util.find_spec("nicegui") is None:
        raise ImportError("the page needs NiceGUI: pip install 'hs-tracker-cv[app]'")


@dataclass(frozen=True)
class _Page:
    """A page that is being served."""

    process: subprocess.Popen[str]
    address: str
    ticket: str

    def announce(self, words: str, *, show: bool) -> None:
        """Write its address to stderr and open a browser where there is a screen."""
        print(f"{words} {self.address}", file=sys.stderr, flush=True)
        # Without a screen Python may start a text browser in this terminal, and wait for it.
        if show and (sys.platform in {"darwin", "win32"} or {"DISPLAY", "WAYLAND_DISPLAY"} & os.environ.keys()):
            webbrowser.open(self.ticket)


@contextlib.contextmanager
def _page(name: str, port: int | None, **arguments: Any) -> Iterator[_Page]:
    """Run a page in a process of its own, until it ends or the block does."""
    if port is not None and not 1 <= port <= 65535:
        raise VideoError(f"expected a port from 1 to 65535, got {port}")
    _require_nicegui()
    token, ticket = secrets.token_urlsafe(), secrets.token_urlsafe()
    # A server that is killed, or ends by a signal, deletes no uploads: they lie in a folder of ours.
    with tempfile.TemporaryDirectory(prefix="hs-track-page-") as folder:
        order = {
            "page": name,
            "port": port or 0,
            "token": token,
            "ticket": ticket,
            "folder": folder,
            "arguments": arguments,
        }
        process = subprocess.Popen(
            [sys.executable, "-c", LAUNCH, str(Path(__file__).resolve().parents[2])],
            # NiceGUI writes a storage folder into the working directory unless told otherwise.
            env={**os.environ, "NICEGUI_STORAGE_PATH": folder},
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            bound = _bound_port(process, order)
            if port not in {None, bound}:
                print(f"hs-track: port {port} is taken, {bound} is used", file=sys.stderr, flush=True)
            address = f"http://{HOST}:{bound}/?token="
            yield _Page(process, address + token, address + ticket)
        finally:
            _end(process)


def _end(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.communicate(timeout=END_SECONDS)
    except subprocess.TimeoutExpired:  # a camera that does not answer holds it up
        process.kill()
        process.communicate()


def _bound_port(process: subprocess.Popen[str], order: dict[str, Any]) -> int:
    """Hand the order over and wait until it is carried out."""
    assert process.stdin is not None
    assert process.stdout is not None
    with contextlib.suppress(BrokenPipeError):
        process.stdin.write(json.dumps(order) + "\n")
        process.stdin.flush()
    # The line comes, or the end of the file when the process ends.
    line = process.stdout.readline()
    answer = json.loads(line) if line else {"error": f"its server ended with code {process.wait()}"}
    if "error" in answer:
        raise VideoError(f"the page cannot be served: {answer['error']}")
    return int(answer["port"])
