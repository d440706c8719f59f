"""Takes the picture of the page in README: ``python -m docs.screenshot``; needs Chromium and playwright."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

WIDTH, HEIGHT, FRAME = 1400, 1300, 70
SHOWN = 880
"""Width of the picture, px."""
BALL = (106, 206, 194, 294)


def main() -> None:
    """Follow the ball of the demo by three trackers and photograph the page."""
    path = Path(__file__).with_name("app.png")
    command = [sys.executable, "-m", "hs_tracker_cv", "app", "--no-show"]
    server = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert server.stderr is not None
    try:
        address = server.stderr.readline().split()[-1]
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
            page.goto(address)
            _follow(page)
            page.screenshot(path=path, full_page=True)
            browser.close()
    finally:
        server.terminate()
        server.wait()
    picture = Image.open(path).convert("RGB")
    small = picture.resize((SHOWN, round(SHOWN * picture.height / picture.width)), Image.Resampling.LANCZOS)
    # A palette, as much of it is texture.
    small.quantize(144, method=Image.Quantize.MEDIANCUT, kmeans=2, dither=Image.Dither.NONE).save(path, optimize=True)
    print(path, path.stat().st_size)


def _follow(page: Page) -> None:
    page.locator("[data-part=name]").first.click()
    page.get_by_text("a rolling ball").click()
    page.get_by_text("frame 0 of 200").wait_for()
    image = page.locator("[data-part=frame] img").first
    place = image.bounding_box()
    assert place is not None
    scale = place["width"] / 640
    left, top, right, bottom = (side * scale for side in BALL)
    page.mouse.move(place["x"] + left, place["y"] + top)
    page.mouse.down()
    page.mouse.move(place["x"] + right, place["y"] + bottom, steps=5)
    page.mouse.up()
    page.get_by_text("at frame 0").wait_for()
    for name in ("CSRT", "KCF"):
        page.locator(f"[data-part=use-{name}]").click()
    for frame in range(10, FRAME + 1, 10):
        page.keyboard.press("Shift+ArrowRight")
        page.get_by_text(f"frame {frame} of 200").wait_for()
    page.mouse.move(0, 0)
    page.wait_for_timeout(3000)


if __name__ == "__main__":
    main()
