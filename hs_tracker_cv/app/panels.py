"""The panels that the viewer has chosen, in a grid that follows frame and parameters."""

from __future__ import annotations

import asyncio
import time
from functools import partial
from typing import TYPE_CHECKING

from nicegui import background_tasks, events, ui

from ..video import VideoError
from .pictures import TITLES, picture_url
from .style import LET_GO

if TYPE_CHECKING:
    from .page import Page

__all__ = ["WATCH", "PanelGrid"]

FIRST = ("Fx", "Fy", "Ft", "arrows", "normal", "threshold", "segmentation", "corners")
"""Shown until the viewer chooses others."""
WIDTH = 420
"""Of a panel's picture, px."""
REST = 2.0
"""While the video plays, time between two drawings of the panels over the time that one takes."""

WATCH = """
<script>
  window.hsSeen = new IntersectionObserver((entries) => entries.forEach(
    (entry) => entry.target.dispatchEvent(new CustomEvent("seen", { detail: entry.isIntersecting }))));
</script>
"""
"""For the head of the page: tells a panel when it comes into sight or leaves it."""


class PanelGrid:
    """Chooser and grid.

    Panels are drawn beside the video and not before the next frame: while it plays fast, some frames are left out,
    and so are panels that are out of sight.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._busy = self._wanted = False
        self._tiles: dict[str, tuple[ui.interactive_image, ui.label]] = {}
        self._seen: set[str] = set()
        with ui.element("div").classes("hs-panels-head"):
            ui.label("The paper, step by step").classes("hs-heading")
            self.chooser = ui.select(
                {name: title for name, (title, _) in TITLES.items()},
                multiple=True,
                value=list(FIRST),
                label="Panels",
                on_change=self._rebuild,
            )
            self.chooser.props("data-part=panels-chosen dense outlined options-dense use-chips").classes("hs-grow")
        self.chooser.on("popup-hide", js_handler=LET_GO)
        self.grid = ui.element("div").classes("hs-panels").props("data-part=panels")
        self._rebuild()

    @property
    def names(self) -> list[str]:
        """The chosen panels in the order of the paper."""
        return [name for name in TITLES if name in self.chooser.value]

    def _rebuild(self) -> None:
        self.grid.clear()
        self._tiles.clear()
        self._seen.clear()
        with self.grid:
            for name in self.names:
                title, place = TITLES[name]
                with ui.element("div").classes("hs-panel").props(f"data-part=panel-{name}") as panel:
                    panel.on("seen", partial(self._comes_or_goes, name), js_handler="(e) => emit(e.detail)")
                    ui.html(f"<b>{title}</b> <span>{place}</span>", sanitize=False)
                    image = ui.interactive_image()
                    note = ui.label("needs the frame before")
                self._tiles[name] = image, note
        ui.run_javascript("document.querySelectorAll('.hs-panel').forEach((panel) => hsSeen.observe(panel))")
        self.refresh()

    def _comes_or_goes(self, name: str, event: events.GenericEventArguments) -> None:
        (self._seen.add if event.args else self._seen.discard)(name)

    def refresh(self) -> None:
        """Draw the panels for the current frame and parameters, soon."""
        self._wanted = True
        if not self._busy:
            self._busy = True
            background_tasks.create(self._draw(), name="panels")

    async def _draw(self) -> None:
        try:
            while self._wanted and not self._page.left:
                self._wanted = False
                begun = time.monotonic()
                names = [name for name in self.names if not self._page.playing or name in self._seen]
                drawn = await self._page.do(self._panels, names)
                if not isinstance(drawn, dict) or self._page.left:
                    continue
                for name in names:
                    if name in self._tiles:
                        image, note = self._tiles[name]
                        url, words = drawn.get(name, ("", "needs the frame before"))
                        image.set_source(url)
                        image.set_visibility(bool(url))  # else it would stay as tall as the one before
                        note.set_text(words)
                if self._page.playing:
                    await asyncio.sleep(REST * (time.monotonic() - begun))
        finally:
            self._busy = False

    def _panels(self, names: list[str]) -> dict[str, tuple[str, str]]:
        """Of each panel: picture and note; of none in the first frame."""
        session = self._page.session
        seen = session.current()
        if seen is None or not names:
            return {}
        try:
            panels = session.panels(seen, names, WIDTH)
        except VideoError:
            if session.shows(seen):
                raise
            return {}  # another video is being opened, and asks for its own
        return {panel.name: (picture_url(panel.picture), panel.note) for panel in panels}
