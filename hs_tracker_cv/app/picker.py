"""An image on which a box is dragged with mouse, pen or finger."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from nicegui import events, ui

from ..geometry import Box
from .pictures import picture_url

__all__ = ["BoxPicker"]

PRIMARY = 0
"""Number of the button that draws; the others have the browser's menus."""
COMFORTABLE = 640
"""Width, screen px, up to which a small image is enlarged."""
STYLE = 'fill="rgba(90,190,210,0.15)" stroke="#5abed2" stroke-width="2" vector-effect="non-scaling-stroke"'
PROPOSED = (
    'fill="rgba(255,190,60,0.12)" stroke="#ffbe3c" stroke-width="2" stroke-dasharray="6 4" '
    'vector-effect="non-scaling-stroke"'
)


class BoxPicker:
    """An image element that answers a drag with a box in image px, and a click with the point.

    Parameters
    ----------
    on_box : callable
        Called with the Box when the button is released.
    on_click : callable, optional
        Called with x, y when it is released where it was pressed.
    on_press : callable, optional
        Called when the button is pressed.
    """

    def __init__(
        self,
        on_box: Callable[[Box], Any],
        on_click: Callable[[float, float], Any] | None = None,
        on_press: Callable[[], Any] | None = None,
    ) -> None:
        self._on_box = on_box
        self._on_click = on_click
        self._on_press = on_press
        self._start: tuple[float, float] | None = None
        self._last = (0.0, 0.0)
        self._size = (0, 0)
        self._scale = 1.0
        self._shown = 0
        self._proposals: list[Box] = []
        self.element = ui.interactive_image(
            on_mouse=self._mouse, events=["pointerdown", "pointermove", "pointerup"], cross="#5abed2"
        )
        # As inline text has them, images stand on a line, with room below, and places would be off by that.
        ui.add_css("img { display: block; }")
        # A finger that draws a box does not scroll the page.
        self.element.style("touch-action: none")

    @property
    def dragging(self) -> bool:
        """Whether a box is being drawn."""
        return self._start is not None

    def show(self, image: Any, *, lossless: bool = False) -> None:
        """Show an image at a size at which a drag hits pixels exactly; a box drawn on the one before disappears."""
        # Where it fits, one image pixel is a whole number of screen pixels.
        shown = image.shape[1] * max(COMFORTABLE // image.shape[1], 1)
        self.element.style(f"width: {shown}px; max-width: 100%")
        self.show_url(picture_url(image, lossless=lossless), (image.shape[1], image.shape[0]))
        self.clear()

    def show_url(self, url: str, size: tuple[int, int], scale: float = 1.0) -> None:
        """Show an encoded image of a frame of `size`, which has been made smaller by `scale`."""
        self._size, self._scale = size, scale
        # As another one each time: the same as before would change nothing, though others were shown past it since.
        self._shown += 1
        self.element.set_source(f"{url}#{self._shown}")

    def propose(self, boxes: list[Box]) -> None:
        """Draw dashed boxes, to be clicked."""
        self._proposals = boxes
        self._draw()

    def proposed_at(self, x: float, y: float) -> Box | None:
        """The smallest proposed box that a point is in."""
        hit = [box for box in self._proposals if box.x <= x <= box.right and box.y <= y <= box.bottom]
        return min(hit, key=lambda box: box.area, default=None)

    def clear(self) -> None:
        """Take the drawn box and the proposals away."""
        self._start = None
        self._proposals = []
        self.element.set_content("")

    def _mouse(self, event: events.MouseEventArguments) -> Any:
        x, y = event.image_x / self._scale, event.image_y / self._scale
        here = (min(max(x, 0.0), self._size[0]), min(max(y, 0.0), self._size[1]))
        if event.type == "pointerdown":
            if event.button != PRIMARY:
                return None
            self._start = self._last = here
            if self._on_press is not None:
                self._on_press()
        elif self._start is not None and event.type == "pointermove" and event.buttons & 1:
            self._last = here
            self._draw()
        elif self._start is not None:
            # Released here, or outside the image: then the next move comes without a button.
            self._last = here if event.type == "pointerup" else self._last
            self._draw()
            start, self._start = self._start, None
            if self._last == start and self._on_click is not None:
                return self._on_click(*start)
            return self._on_box(self._box(start))
        return None

    def _box(self, start: tuple[float, float]) -> Box:
        left, top = min(start[0], self._last[0]), min(start[1], self._last[1])
        return Box.from_edges(left, top, max(start[0], self._last[0]), max(start[1], self._last[1]))

    def _draw(self) -> None:
        shapes = [_rectangle(box, self._scale, PROPOSED) for box in self._proposals]
        if self._start is not None:
            shapes.append(_rectangle(self._box(self._start), self._scale, STYLE))
        self.element.set_content("".join(shapes))


def _rectangle(box: Box, scale: float, style: str) -> str:
    x, y, w, h = (side * scale for side in box)
    return f'<rect x="{x}" y="{y}" width="{w}" height="{h}" {style} />'
