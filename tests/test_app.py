"""The browser pages, with a real mouse in a headless Chromium."""

from __future__ import annotations

import base64
import contextlib
import importlib.util
import os
import queue
import re
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
from hs_tracker_cv.video import VideoError, VideoSink, open_source

pytestmark = pytest.mark.once

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
ROOT = Path(__file__).resolve().parents[1]
COUNT = 40
"""Frames of the video."""
PATIENCE = 180_000
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


@pytest.fixture(scope="module")
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
    image = page.locator("[data-part=frame] img").first
    image.wait_for(timeout=PATIENCE)
    page.wait_for_function("document.querySelector('[data-part=frame] img').naturalWidth > 0", timeout=PATIENCE)
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
    page.locator("[data-part=accept]:not([disabled])").click(timeout=PATIENCE)
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


@pytest.fixture(scope="module")
def square(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A video of a square that moves 2 px to the right per frame, in a folder of its own."""
    path = tmp_path_factory.mktemp("videos") / "square.mkv"
    with VideoSink(path, 25.0) as sink:
        for frame in _frames(COUNT)[0]:
            sink.write(frame)
    return path


@pytest.fixture(scope="module")
def served(square: Path) -> Iterator[tuple[str, psutil.Process]]:
    """A server for that video: every test has a page, and so a session, of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("PYTEST_CURRENT_TEST", raising=False)
        with _live(str(square)) as running:
            yield running


@pytest.fixture
def page(browser: Any, served: tuple[str, psutil.Process]) -> Iterator[Page]:
    """The page at the first frame of the video; the test fails on any error in the browser."""
    with Page.visiting(browser, served[0]) as opened:
        opened.await_frame(0)
        yield opened


class Page:
    """A page in the browser, by the names of its parts."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    @classmethod
    @contextlib.contextmanager
    def visiting(cls, browser: Any, address: str, width: int = 1400) -> Iterator[Page]:
        """Open a page, close it, and see that no script has failed."""
        visited = cls(browser.new_page(viewport={"width": width, "height": 1200}))
        visited.page.goto(address, timeout=PATIENCE)
        yield visited
        visited.page.close()
        assert visited.errors == []

    def part(self, name: str) -> Any:
        """The element of that name."""
        return self.page.locator(f"[data-part={name}]").first

    def text(self, name: str) -> str:
        """What it says."""
        return str(self.part(name).inner_text())

    def click(self, name: str) -> None:
        """Press it with the mouse."""
        self.part(name).click(timeout=PATIENCE)

    def await_text(self, name: str, words: str) -> None:
        """Wait until a part says something."""
        self.page.wait_for_function(
            "([name, words]) => document.querySelector(`[data-part=${name}]`)?.innerText.includes(words)",
            arg=[name, words],
            timeout=PATIENCE,
        )

    def await_frame(self, index: int) -> None:
        """Wait until a frame is shown."""
        self.await_text("facts", f"frame {index} of")

    @property
    def frame(self) -> int:
        """Number of the frame shown."""
        return int(self.text("facts").split()[1])

    def picture(self, panel: str) -> str:
        """What a panel shows at the moment."""
        return str(self.page.locator(f"[data-part=panel-{panel}] img").get_attribute("src"))

    def await_other_picture(self, panel: str, before: str) -> str:
        """Wait until a panel shows something else."""
        self.page.wait_for_function(
            "([panel, before]) => document.querySelector(`[data-part=panel-${panel}] img`)?.src !== before",
            arg=[panel, before],
            timeout=PATIENCE,
        )
        return self.picture(panel)

    def rows(self) -> dict[str, list[str]]:
        """The table of the trackers: cells by name."""
        lines = [line.split("\t") for line in self.text("tracks").splitlines()[1:]]
        return {name.strip(): [cell.strip() for cell in rest] for name, *rest in lines}

    def drag_slider(self, name: str, share: float) -> None:
        """Drag the thumb of a slider with the mouse to a share of its track."""
        track = self.part(name).locator(".q-slider__track-container").bounding_box()
        thumb = self.part(name).locator(".q-slider__thumb").bounding_box()
        middle = track["y"] + track["height"] / 2
        self.page.mouse.move(thumb["x"] + thumb["width"] / 2, middle)
        self.page.mouse.down()
        self.page.mouse.move(track["x"] + share * track["width"], middle, steps=5)
        self.page.mouse.up()

    def download(self, name: str) -> tuple[str, bytes]:
        """Click, and return the name and content of the file that comes."""
        with self.page.expect_download(timeout=PATIENCE) as coming:
            self.click(name)
        return coming.value.suggested_filename, Path(coming.value.path()).read_bytes()


def _box(cell: str) -> Box:
    return Box(*(float(number) for number in re.findall(r"[\d.]+", cell)))


@pytest.mark.browser
def test_a_dragged_box_is_followed_and_taken_away(page: Page, square: Path, tmp_path: Path) -> None:
    """From a drag to the end of the video; boxes as hs-track writes them, overlay, panels and program."""
    _drag(page.page, (60, 70), (100, 110))
    page.await_text("hint", "box 60, 70, 40, 40 at frame 0")
    page.drag_slider("scrub", 1.0)
    page.await_frame(COUNT - 1)
    page.await_text("tracks", "TrackerHS 1")
    state, score, box, _ = page.rows()["TrackerHS 1"]
    assert (state, float(score) > 0.5) == ("tracking", True)
    assert iou(_box(box), _frames(COUNT)[1][-1]) > 0.7

    name, table = page.download("save-boxes")
    command = [sys.executable, "-m", "hs_tracker_cv", str(square), "--roi", "60,70,40,40", "--csv", "theirs.csv"]
    subprocess.run(command, check=True, cwd=tmp_path, env={**os.environ, "PYTHONPATH": str(ROOT)})
    assert name == "square.hs.csv"
    assert table == (tmp_path / "theirs.csv").read_bytes()

    name, overlay = page.download("save-overlay")
    (tmp_path / name).write_bytes(overlay)
    assert len(list(open_source(tmp_path / name).frames)) == COUNT
    name, panels = page.download("save-panels")
    assert name.endswith(".png")
    assert cv2.imdecode(np.frombuffer(panels, np.uint8), cv2.IMREAD_COLOR).shape[1] > 1000
    page.click("save-python")
    page.await_text("program", "tracker.init(frame, (60, 70, 40, 40))")
    assert str(square) in page.text("program")


@pytest.mark.browser
def test_the_keys_play_step_and_clear(page: Page) -> None:
    """Space plays and pauses, arrows step both ways, r forgets the box and goes back to where it was drawn."""
    keyboard = page.page.keyboard
    keyboard.press("ArrowRight")
    page.await_frame(1)
    keyboard.press("Shift+ArrowRight")
    page.await_frame(11)
    keyboard.press("ArrowLeft")
    page.await_frame(10)
    # The scrubber has the focus of the mouse, and must not take the arrows for itself.
    page.drag_slider("scrub", 0.0)
    page.await_frame(0)
    keyboard.press("ArrowRight")
    page.await_frame(1)
    _drag(page.page, (62, 70), (102, 110))
    page.await_text("hint", "at frame 1")
    keyboard.press("Space")
    page.page.wait_for_function(
        "parseInt(document.querySelector('[data-part=facts]').innerText.split(' ')[1]) > 4", timeout=PATIENCE
    )
    keyboard.press("Space")
    page.page.wait_for_timeout(500)
    paused = page.frame
    page.page.wait_for_timeout(500)
    assert page.frame == paused
    keyboard.press("r")
    page.await_frame(1)
    assert page.rows() == {}
    page.await_text("panel-Fx", "gray levels")
    assert page.page.locator("[data-part=panel-Fx] img").is_visible()
    keyboard.press("ArrowLeft")
    # Nothing has moved in the first frame: no panel stays as tall as its last picture was.
    page.await_text("panel-Fx", "needs the frame before")
    page.page.locator("[data-part=panel-Fx] img").wait_for(state="hidden", timeout=PATIENCE)


@pytest.mark.browser
def test_a_box_is_dragged_while_the_video_plays(page: Page) -> None:
    """Pressing pauses; the box holds for the frame that is shown. Play at the end begins anew."""
    page.page.keyboard.press("Space")
    page.page.wait_for_function(
        "parseInt(document.querySelector('[data-part=facts]').innerText.split(' ')[1]) > 1", timeout=PATIENCE
    )
    _drag(page.page, (20, 20), (70, 60))
    page.await_text("hint", "box 20, 20, 50, 40 at frame")
    page.await_text("tracks", "TrackerHS 1")
    paused = page.frame
    assert page.text("hint").endswith(f"at frame {paused}")
    page.page.wait_for_timeout(400)
    assert page.frame == paused
    page.drag_slider("scrub", 1.0)
    page.await_frame(COUNT - 1)
    page.click("ahead")
    page.click("play")
    page.page.wait_for_function(
        f"parseInt(document.querySelector('[data-part=facts]').innerText.split(' ')[1]) < {COUNT // 2}",
        timeout=PATIENCE,
    )


@pytest.mark.browser
def test_controls_act_on_the_paused_frame(page: Page) -> None:
    """λ changes the flow and leaves the derivatives; the threshold changes what is above it; modes bring their λ."""
    assert page.text("panel-Ft").endswith("needs the frame before")
    page.click("ahead")
    page.await_text("panel-arrows", "classic, λ 10, 100 iterations, whole frame")
    page.await_text("panel-threshold", "normal flow ≥ 0.5")
    flow, slope, above = (page.picture(name) for name in ("arrows", "Fx", "threshold"))
    page.drag_slider("knob-smoothness", 0.9)
    page.await_text("panel-arrows", "λ 90")
    assert page.picture("arrows") != flow
    assert (page.picture("Fx"), page.picture("threshold")) == (slope, above)
    page.drag_slider("knob-threshold", 0.5)
    page.await_other_picture("threshold", above)
    page.click("flow-mode")
    page.page.get_by_text("accurate", exact=True).click()
    page.await_text("panel-arrows", "accurate, λ 4,")
    page.click("paper")
    page.await_text("panel-arrows", "classic, λ 10, 100 iterations")
    assert page.frame == 1


@pytest.mark.browser
def test_rivals_and_parameters_catch_up(page: Page) -> None:
    """A tracker that is ticked later has its row at the current frame; a changed mode follows anew."""
    _drag(page.page, (60, 70), (100, 110))
    page.await_text("hint", "at frame 0")
    page.drag_slider("scrub", 0.6)
    page.await_frame(round(0.6 * (COUNT - 1)))
    page.click("use-CSRT")
    page.click("use-KCF")
    page.await_text("tracks", "KCF 1")
    page.await_text("tracks", "CSRT 1")
    truth = _frames(COUNT)[1][page.frame]
    assert all(iou(_box(cells[2]), truth) > 0.5 for cells in page.rows().values())
    page.click("use-CSRT")
    page.page.wait_for_function(
        "!document.querySelector('[data-part=tracks]').innerText.includes('CSRT')", timeout=PATIENCE
    )
    before = page.rows()["TrackerHS 1"][2]
    page.click("tracker-mode")
    page.page.get_by_text("patch_tracker", exact=True).click()
    page.page.wait_for_function(
        """before => {
            const words = document.querySelector('[data-part=tracks]').innerText;
            return words.includes("TrackerHS 1") && !words.includes(before);
        }""",
        arg=before.split("\u00a0")[0].strip(),
        timeout=PATIENCE,
    )
    assert iou(_box(page.rows()["TrackerHS 1"][2]), truth) > 0.5


@pytest.mark.browser
def test_what_is_ticked_fast_counts_in_its_order(page: Page) -> None:
    """Clicks that come faster than their work is done: at the end the table shows just what is ticked."""
    _drag(page.page, (60, 70), (100, 110))
    page.await_text("hint", "at frame 0")
    for share in (0.6, 1.0):
        # Each click starts trackers anew while others are still starting. Which clicks count is the browser's affair:
        # a box is ticked by the server's answer, and clicked again before, it is ticked once.
        page.page.evaluate(
            """async (clicks) => {
                for (const name of clicks) {
                    document.querySelector(`[data-part=use-${name}]`).click();
                    await new Promise((drawn) => requestAnimationFrame(drawn));
                }
            }""",
            ["CSRT", "KCF", "MIL"] * 4 + ["KCF"],
        )
        page.drag_slider("scrub", share)
        page.await_frame(round(share * (COUNT - 1)))
        page.page.wait_for_function(
            """() => {
                const named = [...document.querySelectorAll("[data-part=tracks] td:first-child")];
                const ticked = [...document.querySelectorAll("[data-part^=use-][aria-checked=true]")];
                return named.map((cell) => cell.innerText.trim()).join()
                    === ticked.map((box) => box.dataset.part.slice(4) + " 1").join();
            }""",
            timeout=PATIENCE,
        )


@pytest.mark.browser
def test_a_tracker_ticked_on_the_way_does_not_end_the_way(page: Page) -> None:
    """Neither that to a frame far off, nor a video that plays; the tracker is there at the end."""
    _drag(page.page, (60, 70), (100, 110))
    page.await_text("tracks", "TrackerHS 1")
    page.drag_slider("scrub", 0.8)
    page.click("use-KCF")
    page.await_frame(round(0.8 * (COUNT - 1)))
    page.await_text("tracks", "KCF 1")
    assert list(page.rows()) == ["TrackerHS 1", "KCF 1"]
    page.page.keyboard.press("r")
    page.await_frame(0)
    page.page.keyboard.press("Space")
    for _ in range(4):
        page.click("use-KCF")
    page.await_frame(COUNT - 1)


@pytest.mark.browser
def test_the_picture_is_that_of_the_frame_told(page: Page) -> None:
    """Wherever the video is paused: no picture that was still under way comes on top."""
    frames = np.stack(_frames(COUNT)[0]).astype(np.int16)

    def right() -> bool:
        url = page.page.locator("[data-part=frame] img").get_attribute("src")
        encoded = base64.b64decode(url.split(",")[1].split("#")[0])
        picture = cv2.imdecode(np.frombuffer(encoded, np.uint8), cv2.IMREAD_COLOR)
        # Below the frame's number, which is in the corner.
        return int(np.abs(frames[:, 60:] - picture[60:]).mean(axis=(1, 2, 3)).argmin()) == page.frame

    told = "parseInt(document.querySelector('[data-part=facts]').innerText.split(' ')[1])"
    for turn in range(6):
        before = page.frame
        page.page.keyboard.press("Space")
        page.page.wait_for_function(f"{told} > {before}", timeout=PATIENCE)
        page.page.wait_for_timeout(37 * turn)
        page.page.keyboard.press("Space")
        page.await_text("play", "play_arrow")
        _wait_until(right)
        page.page.wait_for_timeout(300)
        assert right()
        if page.frame > COUNT - 10:
            page.page.keyboard.press("r")
            page.drag_slider("scrub", 0.0)
            page.await_frame(0)


@pytest.mark.browser
def test_the_way_to_a_frame_ends_where_a_box_is_begun(page: Page) -> None:
    """And the box holds for the frame in which it was drawn; the right button draws none."""
    page.drag_slider("scrub", 0.6)
    _drag(page.page, (20, 20), (70, 60))
    page.await_text("hint", "box 20, 20, 50, 40 at frame")
    page.await_text("tracks", "TrackerHS 1")
    begun = page.frame
    assert page.text("hint").endswith(f"at frame {begun}")
    place = page.page.locator("[data-part=frame] img").first.bounding_box()
    page.page.mouse.move(place["x"] + 30, place["y"] + 30)
    page.page.mouse.down(button="right")
    page.page.mouse.move(place["x"] + 200, place["y"] + 200, steps=4)
    page.page.mouse.up(button="right")
    page.click("ahead")
    page.await_frame(begun + 1)
    assert list(page.rows()) == ["TrackerHS 1"]
    assert page.text("hint").endswith(f"at frame {begun}")


@pytest.mark.browser
def test_a_proposed_region_is_clicked_and_a_second_box_added(page: Page) -> None:
    """What moves is drawn dashed; a click inside follows it; the switch keeps it when another box is drawn."""
    page.drag_slider("scrub", 0.25)
    page.page.wait_for_timeout(300)
    page.click("propose")
    page.await_text("hint", "Click a dashed box")
    truth = _frames(COUNT)[1][page.frame]
    centre = tuple(round(side) for side in truth.centre)
    _drag(page.page, centre, centre)
    page.await_text("tracks", "TrackerHS 1")
    assert iou(_box(page.rows()["TrackerHS 1"][2]), truth) > 0.4
    page.click("several")
    _drag(page.page, (10, 10), (50, 50))
    page.await_text("tracks", "TrackerHS 2")
    assert list(page.rows()) == ["TrackerHS 1", "TrackerHS 2"]


@pytest.mark.browser
def test_the_strip_leads_to_a_frame(page: Page) -> None:
    """A click into the curves goes to the frame below it."""
    _drag(page.page, (60, 70), (100, 110))
    page.await_text("hint", "at frame 0")
    page.drag_slider("scrub", 1.0)
    page.await_frame(COUNT - 1)
    place = page.page.locator("[data-part=strip] svg").bounding_box()
    for index in (7, 20):
        x = place["x"] + place["width"] * (index + 0.5) / COUNT
        page.page.mouse.click(x, place["y"] + place["height"] / 2)
        page.await_frame(index)
    assert page.page.locator("[data-part=strip] path.curve").count() == 5


@pytest.mark.browser
def test_the_first_mover_is_followed_on_the_page(page: Page) -> None:
    """Without any drag; the video goes on playing."""
    page.part("first").dblclick(timeout=PATIENCE)
    page.await_text("tracks", "TrackerHS 1")
    assert iou(_box(page.rows()["TrackerHS 1"][2]), _frames(COUNT)[1][page.frame]) > 0.4


@pytest.mark.browser
def test_videos_are_chosen_on_the_page(browser: Any, square: Path, tmp_path: Path) -> None:
    """Without a video at the start: the demo, and a file through the browser's chooser; a broken one is refused."""
    broken = tmp_path / "broken.avi"
    broken.write_bytes(b"no video")
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("PYTEST_CURRENT_TEST", raising=False)
        with _live() as (address, _), Page.visiting(browser, address) as page:
            page.await_text("hint", "Open a video")
            page.click("name")
            page.page.get_by_text("a rolling ball").click()
            page.await_text("facts", "frame 0 of 200 · 640 × 480")
            # The list has closed, and keys are the video's.
            page.page.keyboard.press("ArrowRight")
            page.await_text("facts", "frame 1 of 200")
            with page.page.expect_file_chooser(timeout=PATIENCE) as chooser:
                page.click("open")
            chooser.value.set_files(str(broken))
            page.page.get_by_text("broken.avi: is not a video").first.wait_for(timeout=PATIENCE)
            page.page.locator("[data-part=upload] input[type=file]").set_input_files(str(square))
            page.await_text("facts", f"frame 0 of {COUNT} · 240 × 180")
            _drag(page.page, (60, 70), (100, 110))
            page.await_text("tracks", "TrackerHS 1")


def _contrast(ink: str, plate: str) -> float:
    """Of two colours as a browser tells them: the ratio of their luminances, as WCAG 2 defines it."""

    def luminance(colour: str) -> float:
        levels = np.array([int(level) / 255 for level in re.findall(r"\d+", colour)[:3]])
        linear = np.where(levels <= 0.04045, levels / 12.92, ((levels + 0.055) / 1.055) ** 2.4)
        return float(linear @ (0.2126, 0.7152, 0.0722))

    dark, light = sorted((luminance(ink), luminance(plate)))
    return (light + 0.05) / (dark + 0.05)


@pytest.mark.browser
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_the_page_fits_a_phone_in_both_colours(browser: Any, served: tuple[str, psutil.Process], scheme: str) -> None:
    """At 400 px nothing is wider than the screen; the ground is light or dark as the system has it."""
    with Page.visiting(browser, served[0], width=400) as page:
        page.page.emulate_media(color_scheme=scheme)
        page.await_frame(0)
        _drag(page.page, (60, 70), (100, 110))
        page.await_text("tracks", "TrackerHS 1")
        page.click("ahead")
        page.await_text("panel-arrows", "classic")
        assert page.page.evaluate("document.documentElement.scrollWidth") == 400
        wide = page.page.evaluate(
            "[...document.querySelectorAll('[data-part]')].filter(e => e.getBoundingClientRect().right > 400).length"
        )
        assert wide == 0
        name, dark = (page.part(part).bounding_box() for part in ("name", "dark"))
        assert name["y"] < dark["y"] + dark["height"] / 2 < name["y"] + name["height"]  # the header is one row
        ground = page.page.evaluate("getComputedStyle(document.body).backgroundColor")
        level = np.mean([int(number) for number in re.findall(r"\d+", ground)[:3]])
        assert (level < 60) == (scheme == "dark")
        assert (level > 200) == (scheme == "light")
        for part in ("save-python", "paper", "first"):
            ink = page.part(part).evaluate("button => getComputedStyle(button).color")
            assert _contrast(ink, "rgb(29, 35, 39)" if scheme == "dark" else "rgb(255, 255, 255)") > 4.5


@pytest.mark.browser
def test_a_closed_page_gives_its_video_back(browser: Any, served: tuple[str, psutil.Process], square: Path) -> None:
    """Open files and threads of the server are after many pages what they were after a few."""
    address, server = served

    def held() -> int:
        return sum(Path(file.path).samefile(square) for file in server.open_files())

    def visit(count: int) -> None:
        pages = [Page(_visit(browser, address)) for _ in range(count)]
        for page in pages:
            page.await_frame(0)
            page.click("ahead")
            page.await_frame(1)
        assert held() == count
        for page in pages:
            page.page.close()
        _wait_until(lambda: held() == 0)

    # A page of an earlier test may still hold its video: one that was closed keeps it for some seconds.
    _wait_until(lambda: held() == 0)
    # As many at once as later: what is kept for later work exists from then on, but for a few threads of the pools.
    visit(4)
    before = server.num_fds(), server.num_threads()
    memory = server.memory_info().rss
    for _ in range(2):
        visit(4)
    _wait_until(lambda: server.num_fds() <= before[0] + 4)
    _wait_until(lambda: server.num_threads() <= before[1] + 6)
    # Frames, stages and pictures of a page are some 20 MB.
    assert server.memory_info().rss < memory + 80_000_000


def _wait_until(question: Callable[[], bool]) -> None:
    deadline = time.monotonic() + PATIENCE / 1000
    while not question():
        assert time.monotonic() < deadline
        time.sleep(0.2)


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
