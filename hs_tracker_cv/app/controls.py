"""The controls beside the video: objects, trackers, the paper's method, what to take away."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from nicegui import ui

from ..params import MODES as TRACKER_MODES
from ..params import TrackerHS_Params
from ..stages import MODES, StageParams
from ..video import VideoError
from .export import overlay_webm, panels_png, snippet, table_csv
from .pictures import colour
from .style import LET_GO
from .tracks import OURS

if TYPE_CHECKING:
    from .page import Page
    from .session import Moment

__all__ = ["Controls"]

FLOWS = {mode: f"{mode} (the paper)" if mode == "classic" else mode for mode in MODES}
THROTTLE = 0.1
"""Seconds between two values of a slider that is being moved."""


class Controls:
    """The cards at the side of the page.

    Parameters
    ----------
    page : Page
        Whose session they act on.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self._session = page.session
        with ui.element("div").classes("hs-card"):
            self._objects()
        with ui.element("div").classes("hs-card"):
            self._trackers()
        with ui.element("div").classes("hs-card"):
            self._method()
        with ui.element("div").classes("hs-card"):
            self._export()

    def _objects(self) -> None:
        ui.label("Objects").classes("hs-heading")
        with ui.element("div").classes("hs-row"):
            for words, part, act in (
                ("What moves?", "propose", self._page.propose),
                ("Follow the first mover", "first", self._page.follow_first),
                ("Clear (r)", "forget", self._page.forget),
            ):
                ui.button(words, on_click=act).props(f"outline dense no-caps data-part={part}")
        self.several = ui.switch("A new box adds an object").props("dense data-part=several")

    def _trackers(self) -> None:
        ui.label("Trackers on the same frames").classes("hs-heading")
        self._chosen: dict[str, ui.checkbox] = {}
        with ui.element("div").classes("hs-row"):
            for name in (OURS, *self._session.rivals):
                box = ui.checkbox(name, value=name == OURS, on_change=self._choose)
                # In the colour in which the tracker's boxes and curves are drawn.
                box.props(f"dense data-part=use-{name}").style(f"--q-primary: {colour(name)}")
                self._chosen[name] = box
        with ui.element("div").classes("hs-row"):
            self._mode = ui.select(
                list(TRACKER_MODES), value="auto", label="TrackerHS: mode", on_change=self._parameters
            )
            self._mode.props("dense outlined options-dense data-part=tracker-mode").classes("hs-grow")
            self._mode.on("popup-hide", js_handler=LET_GO)
            self._rotation = ui.switch("rotation", on_change=self._parameters).props("dense data-part=rotation")

    async def _choose(self) -> None:
        names = [name for name, box in self._chosen.items() if box.value]
        if await self._page.change(self._session.choose, names):
            await self._page.catch_up()
        else:
            self._show_what_holds()

    async def _parameters(self) -> None:
        parameters = TrackerHS_Params(mode=self._mode.value, rotation=self._rotation.value)
        if await self._page.change(self._session.set_parameters, parameters):
            await self._page.catch_up()
        else:
            self._show_what_holds()

    def _show_what_holds(self) -> None:
        """After a change that was refused."""
        for name, box in self._chosen.items():
            box.set_value(name in self._session.names)
        self._mode.set_value(self._session.parameters.mode)
        self._rotation.set_value(self._session.parameters.rotation)

    def _method(self) -> None:
        params = self._session.stage_params
        ui.label("The paper's method, on the whole frame").classes("hs-heading")
        self._flow = ui.select(FLOWS, value=params.mode, label="Flow", on_change=self._preset)
        self._flow.props("dense outlined options-dense data-part=flow-mode")
        self._flow.on("popup-hide", js_handler=LET_GO)
        self._knobs: dict[str, tuple[ui.slider, ui.label]] = {}
        self._knob("smoothness", "λ, smoothness", 1, 100, 1)
        self._knob("iterations", "iterations", 1, 500, 1)
        self._knob("smoothing", "smoothing σ, px", 0, 5, 0.1)
        self._knob("threshold", "threshold, px", 0.05, 5, 0.05)
        ui.button("As in the paper", on_click=self._as_in_the_paper).props("flat dense no-caps data-part=paper")

    def _as_in_the_paper(self) -> None:
        self._flow.set_value("classic")
        self._set(StageParams())

    def _knob(self, field: str, title: str, least: float, most: float, step: float) -> None:
        value = getattr(self._session.stage_params, field)
        with ui.element("div").classes("hs-knob"):
            ui.label(title)
            slider = ui.slider(min=least, max=most, step=step, value=value).props(
                f'dense data-part=knob-{field} aria-label="{title}"'
            )
            label = ui.label(f"{value:g}")
        slider.on(
            "update:model-value", lambda event: self._turn(field, event.args), throttle=THROTTLE, leading_events=True
        )
        self._knobs[field] = slider, label

    def _turn(self, field: str, value: Any) -> None:
        value = int(value) if field == "iterations" else float(value)
        # The slider itself is left alone: under the mouse it may be further already.
        self._use(replace(self._session.stage_params, **{field: value}))

    def _preset(self) -> None:
        params = self._session.stage_params
        self._set(StageParams.preset(self._flow.value, smoothing=params.smoothing, threshold=params.threshold))

    def _set(self, params: StageParams) -> None:
        for field, (slider, _) in self._knobs.items():
            slider.set_value(getattr(params, field))
        self._use(params)

    def _use(self, params: StageParams) -> None:
        self._session.stage_params = params
        for field, (_, label) in self._knobs.items():
            label.set_text(f"{getattr(params, field):g}")
        self._page.grid.refresh()

    def _export(self) -> None:
        ui.label("Take away").classes("hs-heading")
        with ui.element("div").classes("hs-row"):
            for name, icon, act in (
                ("Boxes, CSV", "table_rows", self._save_tables),
                ("Overlay, WebM", "movie", self._save_overlay),
                ("Panels, PNG", "grid_view", self._save_panels),
                ("Python", "code", self._show_program),
            ):
                word = name.split(",")[0].lower()
                ui.button(name, icon=icon, on_click=act).props(f"outline dense no-caps data-part=save-{word}")

    def _seen(self) -> Moment | None:
        """What the viewer sees now, which is what is taken away; told where there is nothing."""
        if self._page.shown is None:
            self._page.complain(VideoError("there is no video yet: open one first"))
            return None
        return self._page.shown.moment

    def _save_tables(self) -> None:
        """One file per track; the first is named as hs-track does."""
        seen = self._seen()
        if seen is None:
            return
        if not seen.tracks:
            self._page.complain(VideoError("nothing has been followed yet: drag a box first"))
        for number, track in enumerate(seen.tracks):
            suffix = "hs" if number == 0 and track.name == OURS else track.label.replace(" ", ".")
            ui.download.content(table_csv(track), f"{seen.store.name}.{suffix}.csv", "text/csv")

    async def _save_overlay(self) -> None:
        seen = self._seen()
        if seen is None:
            return
        video = await self._page.do(overlay_webm, self._session, seen)
        if isinstance(video, bytes):
            ui.download.content(video, f"{seen.store.name}.hs.webm", "video/webm")

    async def _save_panels(self) -> None:
        seen = self._seen()
        if seen is None:
            return
        picture = await self._page.do(panels_png, self._session, seen, self._page.grid.names)
        if isinstance(picture, bytes):
            ui.download.content(picture, f"{seen.store.name}.{seen.index:06d}.panels.png", "image/png")

    def _show_program(self) -> None:
        seen = self._seen()
        if seen is None:
            return
        code = snippet(self._session, seen)
        with ui.dialog() as dialog, ui.card().style("width: 100%; max-width: 48rem"):
            ui.label("The same boxes and stages in Python").classes("hs-heading")
            ui.code(code, language="python").style("width: 100%").props("data-part=program")
            with ui.element("div").classes("hs-row"):
                name = f"{seen.store.name}.py"
                save = ui.button("Save", on_click=lambda: ui.download.content(code, name, "text/x-python"))
                save.props("dense no-caps data-part=save-program")
                ui.button("Close", on_click=dialog.close).props("flat dense no-caps")
        dialog.on("hide", dialog.delete)
        dialog.open()
