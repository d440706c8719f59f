"""The browser pages, with a real mouse in a headless Chromium."""

from __future__ import annotations

import contextlib
import importlib.util
import queue
import shutil
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import psutil
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import app
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.video import VideoError, VideoSink

CHROMIUM = shutil.which("chromium") or "/usr/bin/chromium"
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--no-first-run",
    "--disable-quic",
]
PATIENCE = 60_000
"""Milliseconds a page may take: the machine may be busy."""


def _frames(count: int) -> tuple[list[NDArray[np.uint8]], list[Box]]:
    rng = np.random.default_rng(8)
    ground = cv2.GaussianBlur(rng.integers(0, 255, (180, 240, 3), dtype=np.uint8), (0, 0), 4.0)
    square = cv2.GaussianBlur(rng.integers(0, 255, (40, 40, 3), dtype=np.uint8), (0, 0), 1.2)
    frames, boxes = [], []
    for index in range(count):
        frame, x = ground.copy(), 60 + 2 * index
        frame[70:110, x : x + 40] = square
        frames.append(frame)
        boxes.append(Box(x, 70, 40, 40))
    return frames, boxes


@pytest.fixture
def browser() -> Iterator[Any]:
    """A headless Chromium, or a skip where there is none."""
    if not Path(CHROMIUM).exists():
        pytest.skip(f"no Chromium at {CHROMIUM}")
    for module in ("playwright", "nicegui"):
        if importlib.util.find_spec(module) is None:
            pytest.skip(f"{module} is not installed")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def plain_environment(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """To be called by the test: NiceGUI serves differently when this variable tells it that pytest is running."""
    return lambda: monkeypatch.delenv("PYTEST_CURRENT_TEST", raising=False)


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> queue.Queue[str]:
    """The addresses that would be opened in the user's browser."""
    addresses: queue.Queue[str] = queue.Queue()
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr(app.webbrowser, "open", addresses.put)
    return addresses


def _visit(browser: Any, address: str) -> Any:
    page = browser.new_page(viewport={"width": 1400, "height": 1100})
    page.goto(address, timeout=PATIENCE)
    return page


def _is_free(address: str) -> bool:
    """Whether nothing listens at an address any more."""
    parts = urlsplit(address)
    with contextlib.suppress(ConnectionRefusedError), socket.create_connection((parts.hostname, parts.port), 2.0):
        return False
    return True


def _drag(page: Any, start: tuple[int, int], end: tuple[int, int]) -> None:
    image = page.locator("#frame img").first
    image.wait_for(timeout=PATIENCE)
    page.wait_for_function("document.querySelector('#frame img').naturalWidth > 0", timeout=PATIENCE)
    place, natural = image.bounding_box(), image.evaluate("image => image.naturalWidth")
    scale = place["width"] / natural
    page.mouse.move(place["x"] + start[0] * scale, place["y"] + start[1] * scale)
    page.mouse.down()
    page.mouse.move(place["x"] + end[0] * scale, place["y"] + end[1] * scale, steps=8)
    page.mouse.up()


@pytest.mark.browser
@pytest.mark.parametrize(
    ("start", "end"),
    [
        ((60, 40), (161, 117)),  # down and right
        ((200, 150), (31, 22)),  # up and left
    ],
)
def test_the_dragged_box_is_the_answer(
    browser: Any,
    plain_environment: Callable[[], None],
    opened: queue.Queue[str],
    start: tuple[int, int],
    end: tuple[int, int],
) -> None:
    """A mouse drag on the page gives exactly the dragged box, in frame px, and the server ends."""
    plain_environment()
    answers: list[Box | None] = []
    frame = _frames(1)[0][0]
    thread = threading.Thread(target=lambda: answers.append(app.select_roi(frame)))
    thread.start()
    address = opened.get(timeout=PATIENCE / 1000)
    page = _visit(browser, address)
    _drag(page, start, end)
    page.locator("#accept:not([disabled])").click(timeout=PATIENCE)
    thread.join(PATIENCE / 1000)
    left, right = sorted((start[0], end[0]))
    top, bottom = sorted((start[1], end[1]))
    assert answers == [Box(left, top, right - left, bottom - top)]
    assert _is_free(address)


def test_the_selection_gives_up_by_itself(plain_environment: Callable[[], None], opened: queue.Queue[str]) -> None:
    """Without a drag the answer is None after the timeout, and the server has ended."""
    pytest.importorskip("nicegui")
    plain_environment()
    assert app.select_roi(_frames(1)[0][0], timeout=2.0) is None
    assert _is_free(opened.get_nowait())


@contextlib.contextmanager
def _live(*arguments: str) -> Iterator[tuple[str, psutil.Process]]:
    """`hs-track app`: the printed address and the server's process."""
    command = [sys.executable, "-m", "hs_tracker_cv", "app", *arguments, "--no-show"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        address = process.stderr.readline().split()[-1]
        yield address, psutil.Process(process.pid).children()[0]
    finally:
        process.terminate()
        process.communicate()


@pytest.fixture
def square(tmp_path: Path) -> Path:
    """A video of a square that moves to the right."""
    path = tmp_path / "square.mkv"
    with VideoSink(path, 25.0) as sink:
        for frame in _frames(14)[0]:
            sink.write(frame)
    return path


@pytest.mark.browser
def test_the_live_page_tracks_what_was_dragged(
    browser: Any, plain_environment: Callable[[], None], square: Path
) -> None:
    """A drag starts the tracker; the page shows state, box and panels, pauses, and steps one frame."""
    plain_environment()
    boxes = _frames(14)[1]
    with _live(str(square)) as (address, _):
        page = _visit(browser, address)
        _drag(page, (60, 70), (100, 110))
        page.wait_for_function("document.querySelector('#facts').innerText.includes('frame 2 ')", timeout=PATIENCE)
        page.locator("#play").click()
        page.wait_for_function("document.querySelector('#play').innerText.match(/go on/i)", timeout=PATIENCE)
        page.wait_for_timeout(500)
        before = _facts(page)[0]
        page.locator("#step").click()
        page.wait_for_function(f"document.querySelector('#facts').innerText.includes('frame {before + 1} ')")
        index, box = _facts(page)
        assert index == before + 1
        assert iou(box, boxes[index]) > 0.7
        assert page.locator("#state").inner_text() == "tracking"
        assert page.locator("#panels img").first.evaluate("image => image.naturalWidth") > 1000


def _facts(page: Any) -> tuple[int, Box]:
    words = page.locator("#facts").inner_text().replace(",", " ").split()
    at = words.index("box")
    x, y, w, h = (float(words[at + offset]) for offset in (1, 2, 3, 5))
    return int(words[words.index("frame") + 1]), Box(x, y, w, h)


@pytest.mark.browser
def test_a_video_is_chosen_on_the_page(browser: Any, plain_environment: Callable[[], None], square: Path) -> None:
    """Without a video at the start, one is handed over through the browser's file chooser."""
    plain_environment()
    with _live() as (address, _):
        page = _visit(browser, address)
        page.locator("#upload input[type=file]").set_input_files(str(square), timeout=PATIENCE)
        _drag(page, (60, 70), (100, 110))
        page.wait_for_function("document.querySelector('#facts').innerText.includes('frame 2 ')", timeout=PATIENCE)


@pytest.mark.browser
def test_a_closed_page_gives_its_video_back(
    browser: Any, plain_environment: Callable[[], None], square: Path
) -> None:
    """Open files and threads of the server are after many pages what they were after a few."""
    plain_environment()
    with _live(str(square)) as (address, server):

        def held() -> int:
            return sum(Path(file.path).samefile(square) for file in server.open_files())

        def visit(count: int) -> None:
            pages = [_visit(browser, address) for _ in range(count)]
            for page in pages:
                page.locator("#frame img").first.wait_for(timeout=PATIENCE)
                page.locator("#detect").click(timeout=PATIENCE)
            assert held() == count
            for page in pages:
                page.close()
            _wait_until(lambda: held() == 0)

        # As many at once as later: threads that are kept for later work exist from then on.
        visit(6)
        before = server.num_fds(), server.num_threads()
        for _ in range(3):
            visit(6)
        _wait_until(lambda: server.num_fds() <= before[0])
        _wait_until(lambda: server.num_threads() <= before[1])


def _wait_until(question: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE / 1000
    while not question():
        assert time.monotonic() < deadline
        time.sleep(0.2)


def test_a_session_follows_and_can_be_restarted_on_the_way(tmp_path: Path) -> None:
    """A new box in the middle of a video starts a new track in that frame, under that frame's number."""
    pytest.importorskip("nicegui")
    from hs_tracker_cv.app.live import LiveSession
    from hs_tracker_cv.app.sources import Sources

    frames, boxes = _frames(8)
    with VideoSink(tmp_path / "square.mkv", 25.0) as sink:
        for frame in frames:
            sink.write(frame)
    session = LiveSession(Sources(str(tmp_path / "square.mkv")))
    np.testing.assert_array_equal(session.open("square.mkv"), frames[0])
    session.start(boxes[0])
    assert [session.advance().index for _ in range(4)] == [0, 1, 2, 3]
    session.start(boxes[3])
    later = [session.advance() for _ in range(6)]
    assert [step.index for step in later[:5]] == [3, 4, 5, 6, 7]
    assert later[5] is None
    assert later[0].box == boxes[3]
    assert iou(later[4].box, boxes[7]) > 0.7
    assert len(session.scores) == 5
    session.close()
    with pytest.raises(VideoError, match="has been closed"):
        session.open("square.mkv")


def test_a_source_that_cannot_be_read_leaves_the_session_usable(square: Path) -> None:
    """The error names it; the other sources still open."""
    pytest.importorskip("nicegui")
    from hs_tracker_cv.app.live import LiveSession
    from hs_tracker_cv.app.sources import Sources

    (square.parent / "broken.avi").write_bytes(b"no video")
    session = LiveSession(Sources(str(square.parent)))
    with pytest.raises(VideoError, match=r"broken\.avi"):
        session.open("broken.avi")
    session.start(Box(60, 70, 40, 40))
    assert session.advance() is None
    session.open("square.mkv")
    session.start(Box(60, 70, 40, 40))
    assert session.advance().index == 0
    session.close()


def test_without_nicegui_the_way_to_install_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The missing extra is one clear line, not a traceback from inside."""
    monkeypatch.setattr(app.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ImportError, match=r"pip install 'hs-tracker-cv\[app\]'"):
        app.select_roi(_frames(1)[0][0])


def test_a_server_that_cannot_start_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is reported with its exit code."""
    pytest.importorskip("nicegui")
    monkeypatch.setattr(app.sys, "executable", "false")
    with pytest.raises(VideoError, match="cannot be served: its server ended with code 1"):
        app.select_roi(_frames(1)[0][0], show=False)
