"""The page on which the object is boxed: the paper's step 4."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path

import cv2
from nicegui import ui

from ..frames import MIN_SIDE
from ..geometry import Box
from ..video import VideoError
from .picker import BoxPicker

__all__ = ["select_page"]


def select_page(picture: str, answer: str, end: Callable[[], None]) -> None:
    """Declare the page at ``/``.

    Parameters
    ----------
    picture : str
        PNG of the frame.
    answer : str
        File that takes the box as JSON: [x, y, w, h].
    end : callable
        Ends the server.
    """
    image = cv2.imread(picture, cv2.IMREAD_COLOR)
    if image is None:
        raise VideoError(f"{picture}: is not an image")

    @ui.page("/")
    def page() -> None:
        chosen: list[Box] = []

        def take(box: Box) -> None:
            large = min(box.w, box.h) >= MIN_SIDE
            chosen[:] = [box] if large else []
            text = f"{box.x:g}, {box.y:g}    {box.w:g} × {box.h:g} px" if large else "too small: drag a larger box"
            label.set_text(text)
            button.set_enabled(large)

        async def accept() -> None:
            Path(answer).write_text(json.dumps(list(chosen[0])), encoding="utf-8")
            label.set_text("The box was taken; this page can be closed.")
            button.set_enabled(False)
            # The page must have heard before its server goes.
            await asyncio.sleep(0.3)
            end()

        ui.query(".nicegui-content").style("align-items: flex-start; gap: 12px")
        with ui.row().style("align-items: center; gap: 16px"):
            ui.label("Drag a box round the object").style("font-size: 18px")
            button = ui.button("Track this", icon="check", on_click=accept).props("data-part=accept")
            button.set_enabled(False)
            label = ui.label("no box yet").style("font-family: monospace; white-space: pre; opacity: .8")
            label.props("data-part=box")
        picker = BoxPicker(take)
        picker.element.props("data-part=frame")
        picker.show(image, lossless=True)
