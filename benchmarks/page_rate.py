"""Frames per second that the page really shows: ``python -m benchmarks.page_rate``; needs Chromium and playwright.

A video of 640 × 480 px with 30 frames/s plays in headless Chromium, one object followed, the panels as they are at
first. What counts is pictures that the browser has loaded and then drawn; it has no graphics card here and draws on
the processors that the tracker runs on. The exit code is 1 below 25 frames/s with the page as it opens.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import psutil
from playwright.sync_api import Page, sync_playwright

from hs_tracker_cv.app.demo import BOX, demo
from hs_tracker_cv.video import VideoSink

FPS = 30.0
"""Of the video, and the most that the page shows."""
ENOUGH = 25.0
HEIGHTS = {"as it opens": 1000, "all panels in sight": 2300}
"""Heights of the window, px."""
WIDTH = 1400
PATIENCE = 120_000  # ms
WARM = 1.5  # s

COUNT = """() => {
    window.drawn = { frame: 0, panel: 0 };
    const count = (part, kind) => document.querySelector(`[data-part=${part}] img`).addEventListener(
        "load", () => requestAnimationFrame(() => window.drawn[kind] += 1));
    count("frame", "frame");
    count("panel-arrows", "panel");
}"""


@dataclass(frozen=True)
class Shown:
    """What was drawn within a time, and what that cost.

    Parameters
    ----------
    frames, panels : float
        Pictures of the video, and of one panel, drawn per second.
    server, browser : float
        CPU time, ms per frame drawn.
    """

    frames: float
    panels: float
    server: float
    browser: float


@contextmanager
def _served(video: Path) -> Iterator[tuple[str, psutil.Process]]:
    command = [sys.executable, "-m", "hs_tracker_cv", "app", str(video), "--no-show"]
    parent = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert parent.stderr is not None
    try:
        yield parent.stderr.readline().split()[-1], psutil.Process(parent.pid).children()[0]
    finally:
        parent.terminate()
        parent.communicate()


def _write(path: Path, count: int) -> None:
    with VideoSink(path, FPS) as sink:
        for frame in itertools.islice(itertools.cycle(list(demo().frames)), count):
            sink.write(frame)


def _seconds(processes: Sequence[psutil.Process]) -> float:
    return sum(times.user + times.system for times in (process.cpu_times() for process in processes))


def _measure(page: Page, server: psutil.Process, seconds: float) -> Shown:
    page.get_by_text("frame 0 of").wait_for()
    place: Any = page.locator("[data-part=frame] img").first.bounding_box()
    scale = place["width"] / 640
    page.mouse.move(place["x"] + scale * BOX.x, place["y"] + scale * BOX.y)
    page.mouse.down()
    page.mouse.move(place["x"] + scale * BOX.right, place["y"] + scale * BOX.bottom, steps=4)
    page.mouse.up()
    page.get_by_text("at frame 0").wait_for()
    page.evaluate(COUNT)
    page.mouse.move(0, 0)
    page.keyboard.press("Space")
    time.sleep(WARM)
    browser = [child for child in psutil.Process().children(recursive=True) if "chrom" in child.name()]
    begun, before = time.monotonic(), page.evaluate("({ ...window.drawn })")
    spent = _seconds([server]), _seconds(browser)
    time.sleep(seconds)
    after, passed = page.evaluate("({ ...window.drawn })"), time.monotonic() - begun
    frames = after["frame"] - before["frame"]
    ms = 1e3 / max(frames, 1)
    return Shown(
        frames / passed,
        (after["panel"] - before["panel"]) / passed,
        ms * (_seconds([server]) - spent[0]),
        ms * (_seconds(browser) - spent[1]),
    )


def main() -> int:
    """Measure with each window; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=8.0, help="of playing that are counted")
    seconds = parser.parse_args().seconds
    chromium = shutil.which("chromium")
    if chromium is None:
        parser.error("there is no chromium")
    rates = []
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        video = Path(folder) / "ball.webm"
        _write(video, round(FPS * (seconds + WARM + 5.0)))
        browser = playwright.chromium.launch(executable_path=chromium, args=["--no-sandbox", "--disable-gpu"])
        print(f"{'window':>20}  frames/s  panels/s  server ms  browser ms   per frame shown")
        for name, height in HEIGHTS.items():
            with _served(video) as (address, server):
                page = browser.new_page(viewport={"width": WIDTH, "height": height})
                page.set_default_timeout(PATIENCE)
                page.goto(address, timeout=PATIENCE)
                shown = _measure(page, server, seconds)
                page.close()
            rates.append(shown.frames)
            print(
                f"{name:>20}  {shown.frames:8.1f}  {shown.panels:8.1f}  {shown.server:9.1f}  {shown.browser:10.1f}",
                flush=True,
            )
        browser.close()
    return 0 if rates[0] >= ENOUGH else 1


if __name__ == "__main__":
    sys.exit(main())
