"""The live page: pick a video, drag the box, watch every panel, score and state; pause and step."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from nicegui import run, ui

from ..cli import Step, steps
from ..display import draw_box, render_panels
from ..frames import InputError
from ..geometry import Box
from ..video import VideoError, VideoSource, open_source
from .picker import BoxPicker, picture_url

__all__ = ["LiveSession", "live_page"]

HISTORY = 240
"""Scores shown in the curve."""

COLOURS = {"tracking": "green", "occluded": "orange", "lost": "red", "searching": "cyan"}


class LiveSession:
    """One viewer's video and tracker, without any page: what the buttons do.

    Attributes
    ----------
    step : Step or None
        The last step; None before one.
    scores : deque of float
        The last scores, oldest first.
    """

    def __init__(self) -> None:
        self.source: VideoSource | None = None
        self.step: Step | None = None
        self.scores: deque[float] = deque(maxlen=HISTORY)
        self._frame: Any = None
        self._rest: Iterator[Any] = iter(())
        self._steps: Iterator[Step] = iter(())

    def open(self, path: str) -> Any:
        """Open a source and return its first frame; raises VideoError."""
        self.close()
        self.source = open_source(path)
        self._rest = self.source.frames
        self._frame = next(self._rest)
        self.step = None
        self.scores.clear()
        return self._frame

    def start(self, roi: Box | None) -> None:
        """Follow the object in `roi` from the current frame on; None waits for the first that moves."""
        index = self.step.index if self.step is not None else 0
        self._steps = steps(itertools.chain([self._frame], self._rest), roi, show=True, first=index)
        self.scores.clear()

    def advance(self) -> Step | None:
        """Take the next frame; None at the end. Raises VideoError or InputError."""
        step = next(self._steps, None)
        if step is not None:
            self.step, self._frame = step, step.frame
            self.scores.append(step.score)
        return step

    def close(self) -> None:
        """Release the source."""
        if self.source is not None:
            self.source.close()
        self.source = None


def live_page(video: str = "") -> None:
    """Declare the page at ``/``, with the address of a video filled in."""

    @ui.page("/")
    def page() -> None:
        LivePage(video)


class LivePage:
    """The elements of one viewer's page and what their events do."""

    def __init__(self, video: str) -> None:
        self.session = LiveSession()
        self.busy = False
        self.playing = False
        ui.query(".nicegui-content").classes("gap-3")
        self._controls(video)
        self.picker = BoxPicker(self._boxed)
        self.picker.element.props("id=frame")
        with ui.row().classes("items-center gap-4 w-full"):
            self.state = ui.badge("no video", color="grey").classes("text-sm").props("id=state")
            self.facts = ui.label("").classes("font-mono text-sm whitespace-pre").props("id=facts")
            self.curve = ui.html("", sanitize=False).props("id=score")
        self.panels = ui.image().style("max-width: 1330px; width: 100%").props("id=panels no-spinner no-transition")
        self.timer = ui.timer(0.02, self._tick, active=False)
        ui.context.client.on_disconnect(self._leave)
        if video:
            self._open()

    def _controls(self, video: str) -> None:
        with ui.row().classes("items-center gap-3 w-full"):
            here = sorted(str(path) for path in Path().iterdir() if path.is_dir() or path.suffix in _VIDEO_SUFFIXES)
            self.path = ui.input("Video file, folder of images or camera number", value=video, autocomplete=here)
            self.path.classes("grow").props("id=path").on("keydown.enter", self._open)
            ui.button("Open", icon="folder_open", on_click=self._open).props("id=open")
            self.detect = ui.button("Find what moves", icon="search", on_click=lambda: self._start(None))
            self.detect.props("id=detect")
            self.play = ui.button("Pause", icon="pause", on_click=self._toggle).props("id=play")
            self.once = ui.button("Step", icon="skip_next", on_click=self._one).props("id=step")
        self._enable(opened=False, started=False)

    def _enable(self, *, opened: bool, started: bool) -> None:
        self.detect.set_enabled(opened)
        self.play.set_enabled(started)
        self.once.set_enabled(started)

    def _open(self) -> None:
        self._play(False)
        try:
            frame = self.session.open(self.path.value.strip())
        except VideoError as error:
            self._enable(opened=False, started=False)
            ui.notify(str(error), type="negative")
            return
        self.picker.show(frame, lossless=True)
        self.panels.set_source("")
        self._say("drag a box", "grey", "drag a box round the object, or let it be found")
        self._enable(opened=True, started=False)

    def _boxed(self, box: Box) -> None:
        if self.session.source is not None:
            self._start(box)

    def _start(self, roi: Box | None) -> None:
        self.session.start(roi)
        self._enable(opened=True, started=True)
        self._play(True)

    def _toggle(self) -> None:
        self._play(not self.playing)

    def _play(self, playing: bool) -> None:
        self.playing = playing
        self.play.set_text("Pause" if playing else "Go on")
        self.play.props(f"icon={'pause' if playing else 'play_arrow'}")
        if hasattr(self, "timer"):
            self.timer.active = playing

    async def _one(self) -> None:
        self._play(False)
        await self._tick()

    async def _tick(self) -> None:
        if self.busy:
            return
        self.busy = True
        try:
            # In a thread: the page goes on answering while a frame is worked on.
            pictures = await run.io_bound(self._next_pictures)
        except (VideoError, InputError) as error:
            self._play(False)
            ui.notify(str(error), type="negative")
            return
        finally:
            self.busy = False
        if pictures is None:
            self._play(False)
            self._enable(opened=True, started=False)
            ui.notify("end of the video")
            return
        self._show(*pictures)

    def _next_pictures(self) -> tuple[Step, str, str] | None:
        step = self.session.advance()
        if step is None:
            return None
        note = f"frame {step.index}"
        frame = draw_box(step.frame, step.box, state=step.state, note=note)
        panels = render_panels(step.frame, step.fields, step.box, state=step.state, score=step.score, note=note)
        return step, picture_url(frame), picture_url(panels)

    def _show(self, step: Step, frame: str, panels: str) -> None:
        self.picker.element.set_source(frame)
        self.picker.clear()
        self.panels.set_source(panels)
        box = step.box
        where = f"{box.x:.1f}, {box.y:.1f}  {box.w:.1f} × {box.h:.1f}" if box is not None else "–"
        facts = f"frame {step.index}   score {step.score:.2f}   box {where}   {1e3 * step.seconds:.1f} ms"
        self._say(step.state, COLOURS.get(step.state, "red"), facts)
        self.curve.set_content(_curve(self.session.scores))

    def _say(self, state: str, colour: str, facts: str) -> None:
        self.state.set_text(state)
        self.state.props(f"color={colour}")
        self.facts.set_text(facts)

    def _leave(self) -> None:
        self.timer.active = False
        self.session.close()


_VIDEO_SUFFIXES = frozenset({".avi", ".mkv", ".mov", ".mp4", ".webm", ".mpg", ".m4v"})


def _curve(scores: deque[float]) -> str:
    """The last scores as a line, 1 on top."""
    points = " ".join(f"{index},{38 - 36 * score:.1f}" for index, score in enumerate(scores))
    return (
        f'<svg width="{HISTORY}" height="40" style="background:#222;border-radius:4px">'
        f'<polyline points="{points}" fill="none" stroke="#5ae16e" stroke-width="1.5"/></svg>'
    )
