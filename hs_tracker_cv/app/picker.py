"""An image on which a box is dragged with the mouse."""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any

import cv2
from nicegui import events, ui

from ..geometry import Box

__all__ = ["BoxPicker", "picture_url"]

COMFORTABLE = 640
"""Width, screen px, up to which a small image is enlarged."""
STYLE = 'fill="rgba(90,190,210,0.15)" stroke="#5abed2" stroke-width="2" vector-effect="non-scaling-stroke"'


def picture_url(image: Any, *, lossless: bool = False) -> str:
    """Encode an image into an address a browser shows without asking the server again."""
    suffix, kind, options = (".png", "png", []) if lossless else (".jpg", "jpeg", [cv2.IMWRITE_JPEG_QUALITY, 88])
    encoded = cv2.imencode(suffix, image, options)[1].tobytes()
    return f"data:image/{kind};base64,{base64.b64encode(encoded).decode('ascii')}"


class BoxPicker:
    """An image element that answers a drag with a box in image px.

    Parameters
    ----------
    on_box : callable
        Called with the Box when the mouse button is released.
    """

    def __init__(self, on_box: Callable[[Box], None]) -> None:
        self._on_box = on_box
        self._start: tuple[float, float] | None = None
        self._last = (0.0, 0.0)
        self._size = (0, 0)
        self.element = ui.interactive_image(
            on_mouse=self._mouse, events=["mousedown", "mousemove", "mouseup"], cross="#5abed2"
        )

    def show(self, image: Any, *, lossless: bool = False) -> None:
        """Show an image; a box drawn on the one before disappears."""
        self._size = (image.shape[1], image.shape[0])
        # Where it fits, one image pixel is a whole number of screen pixels: a drag then hits pixels exactly.
        shown = image.shape[1] * max(COMFORTABLE // image.shape[1], 1)
        self.element.style(f"width: {shown}px; max-width: 100%")
        self.element.set_source(picture_url(image, lossless=lossless))
        self.clear()

    def clear(self) -> None:
        """Take the drawn box away."""
        self._start = None
        self.element.set_content("")

    def _mouse(self, event: events.MouseEventArguments) -> None:
        here = (min(max(event.image_x, 0.0), self._size[0]), min(max(event.image_y, 0.0), self._size[1]))
        if event.type == "mousedown":
            self._start = self._last = here
        elif self._start is not None and event.type == "mousemove" and event.buttons & 1:
            self._last = here
            self._draw()
        elif self._start is not None:
            # Released here, or outside the image: then the next move comes without a button.
            self._last = here if event.type == "mouseup" else self._last
            self._draw()
            box, self._start = self._box(self._start), None
            self._on_box(box)

    def _box(self, start: tuple[float, float]) -> Box:
        left, top = min(start[0], self._last[0]), min(start[1], self._last[1])
        return Box.from_edges(left, top, max(start[0], self._last[0]), max(start[1], self._last[1]))

    def _draw(self) -> None:
        if self._start is not None:
            x, y, w, h = self._box(self._start)
            self.element.set_content(f'<rect x="{x}" y="{y}" width="{w}" height="{h}" {STYLE} />')
