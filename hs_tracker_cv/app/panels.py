"""The panels that the viewer has chosen, in a grid that follows frame and parameters."""

from __future__ import annotations

import asyncio
import time
from typing import TYPE_CHECKING

from nicegui import background_tasks, ui

from .pictures import TITLES, Panel, picture_url

if TYPE_CHECKING:
    from .page import Page

__all__ = ["PanelGrid"]

FIRST = ("Fx", "Fy", "Ft", "arrows", "normal", "threshold", "segmentation", "corners")
"""Shown until the viewer chooses others."""
WIDTH = 420
"""Of a panel's picture, px."""


class PanelGrid:
    """Chooser and grid.

    Panels are drawn beside the video and not before the next frame: while it plays fast, some are left out.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._busy = self._wanted = False
        self._tiles: dict[str, tuple[ui.interactive_image, ui.label]] = {}
        self.panels: list[Panel] = []
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
        self.grid = ui.element("div").classes("hs-panels").props("data-part=panels")
        self._rebuild()

    @property
    def names(self) -> list[str]:
        """The chosen panels in the order of the paper."""
        return [name for name in TITLES if name in self.chooser.value]

    def _rebuild(self) -> None:
        self.grid.clear()
        self._tiles.clear()
        with self.grid:
            for name in self.names:
                title, place = TITLES[name]
                with ui.element("div").classes("hs-panel").props(f"data-part=panel-{name}"):
                    ui.html(f"<b>{title}</b> <span>{place}</span>", sanitize=False)
                    image = ui.interactive_image()
                    note = ui.label("needs the frame before")
                self._tiles[name] = image, note
        self.refresh()

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
                drawn = await self._page.do(self._panels)
                if not isinstance(drawn, list) or self._page.left:
                    continue
                self.panels = [panel for panel, _ in drawn]
                for name in self._tiles.keys() - {panel.name for panel in self.panels}:
                    self._tiles[name][0].set_source("")
                    self._tiles[name][1].set_text("needs the frame before")
                for panel, url in drawn:
                    if panel.name in self._tiles:
                        image, note = self._tiles[panel.name]
                        image.set_source(url)
                        note.set_text(panel.note)
                if self._page.playing:
                    # Half of the time is the video's.
                    await asyncio.sleep(time.monotonic() - begun)
        finally:
            self._busy = False

    def _panels(self) -> list[tuple[Panel, str]]:
        panels = self._page.session.panels(self.names, WIDTH) if self._page.session.opened else []
        return [(panel, picture_url(panel.picture)) for panel in panels]
