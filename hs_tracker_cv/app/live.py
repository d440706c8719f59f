"""The live page: pick a video, drag the box, watch every panel, score and state; pause and step."""

from __future__ import annotations

import itertools
import threading
from collections import deque
from collections.abc import Iterator
from typing import Any

from nicegui import events, run, ui

from ..display import draw_box, render_panels
from ..following import Step, steps
from ..frames import InputError
from ..geometry import Box
from ..video import VideoError, VideoSource
from .picker import BoxPicker, picture_url
from .sources import VIDEO_SUFFIXES, Sources

__all__ = ["LiveSession", "live_page"]

HISTORY = 240
"""Scores shown in the curve."""

COLOURS = {"tracking": "green", "occluded": "orange", "lost": "red", "searching": "cyan"}


class LiveSession:
    """One viewer's video and tracker, without any page: what the buttons do. Its methods wait for one another.

    Parameters
    ----------
    sources : Sources
        What may be opened.

    Attributes
    ----------
    step : Step or None
        The last step; None before one.
    scores : deque of float
        The last scores, oldest first.
    """

    def __init__(self, sources: Sources) -> None:
        self.sources = sources
        self.step: Step | None = None
        self.scores: deque[float] = deque(maxlen=HISTORY)
        self._source: VideoSource | None = None
        self._frame: Any = None
        self._steps: Iterator[Step] = iter(())
        self._lock = threading.Lock()
        self._closed = False

    def open(self, name: str) -> Any:
        """Open one of the sources and return its first frame; raises VideoError."""
        with self._lock:
            self._release()
            if self._closed:
                raise VideoError("the page has been closed")
            self._source = self.sources.open(name)
            self._frame = next(self._source.frames)
            return self._frame

    def start(self, roi: Box | None) -> None:
        """Follow the object in `roi` from the current frame on; None waits for the first that moves."""
        with self._lock:
            if self._source is None:
                return
            index = self.step.index if self.step is not None else 0
            frames = itertools.chain([self._frame], self._source.frames)
            self._steps = steps(frames, roi, show=True, first=index)
            self.scores.clear()

    def advance(self) -> Step | None:
        """Take the next frame; None at the end. Raises VideoError or InputError."""
        with self._lock:
            step = next(self._steps, None)
            if step is not None:
                self.step, self._frame = step, step.frame
                self.scores.append(step.score)
            return step

    def close(self) -> None:
        """Give the video back and delete the uploads; nothing can be opened any more."""
        with self._lock:
            self._closed = True
            self._release()
            self.sources.close()

    def _release(self) -> None:
        if self._source is not None:
            self._source.close()
        self._source, self._frame, self.step, self._steps = None, None, None, iter(())
        self.scores.clear()


def live_page(video: str = "") -> None:
    """Declare the page at ``/``, which offers what `video` names."""

    @ui.page("/")
    def page() -> None:
        LivePage(Sources(video))


class LivePage:
    """The elements of one viewer's page and what their events do."""

    def __init__(self, sources: Sources) -> None:
        self.session = LiveSession(sources)
        self.busy = False
        self.playing = False
        ui.query(".nicegui-content").classes("gap-3")
        self._controls(sources.names)
        self.picker = BoxPicker(self._boxed)
        self.picker.element.props("id=frame")
        with ui.row().classes("items-center gap-4 w-full"):
            self.state = ui.badge("no video", color="grey").classes("text-sm").props("id=state")
            self.facts = ui.label("").classes("font-mono text-sm whitespace-pre").props("id=facts")
            self.curve = ui.html("", sanitize=False).props("id=score")
        self.panels = ui.image().style("max-width: 1330px; width: 100%").props("id=panels no-spinner no-transition")
        self.timer = ui.timer(0.02, self._tick, active=False)
        # Deletion and not disconnection: a connection that is lost for a moment comes back to the same page.
        ui.context.client.on_delete(self._leave)
        if sources.names:
            # A timer starts when the page is seen: a request alone opens no video.
            ui.timer(0.0, self._open, once=True)

    def _controls(self, names: list[str]) -> None:
        with ui.row().classes("items-center gap-3 w-full"):
            first = names[0] if names else None
            self.name = ui.select(list(names), value=first, label="Video", on_change=self._open)
            self.name.classes("grow").props("id=name")
            self.upload = ui.upload(label="or choose a file", auto_upload=True, on_upload=self._take)
            self.upload.props(f"id=upload flat bordered accept={','.join(sorted(VIDEO_SUFFIXES))}")
            self.detect = ui.button("Find what moves", icon="search", on_click=lambda: self._start(None))
            self.detect.props("id=detect")
            self.play = ui.button("Pause", icon="pause", on_click=self._toggle).props("id=play")
            self.once = ui.button("Step", icon="skip_next", on_click=self._one).props("id=step")
        self._enable(opened=False, started=False)

    def _enable(self, *, opened: bool, started: bool) -> None:
        self.detect.set_enabled(opened)
        self.play.set_enabled(started)
        self.once.set_enabled(started)

    async def _take(self, event: events.UploadEventArguments) -> None:
        try:
            name, path = self.session.sources.reserve(event.file.name)
        except VideoError as error:
            ui.notify(str(error), type="negative")
            return
        await event.file.save(path)
        self.upload.reset()
        self.name.set_options(list(self.session.sources.names), value=name)

    async def _open(self) -> None:
        self._play(False)
        try:
            frame = await run.io_bound(self.session.open, str(self.name.value))
        except VideoError as error:
            self._enable(opened=False, started=False)
            ui.notify(str(error), type="negative")
            return
        self.picker.show(frame, lossless=True)
        self.panels.set_source("")
        self._say("drag a box", "grey", "drag a box round the object, or let it be found")
        self._enable(opened=True, started=False)

    def _boxed(self, box: Box) -> None:
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

    async def _leave(self) -> None:
        # In a thread: it waits for the frame that is being worked on.
        await run.io_bound(self.session.close)


def _curve(scores: deque[float]) -> str:
    """The last scores as a line, 1 on top."""
    points = " ".join(f"{index},{38 - 36 * score:.1f}" for index, score in enumerate(scores))
    return (
        f'<svg width="{HISTORY}" height="40" style="background:#222;border-radius:4px">'
        f'<polyline points="{points}" fill="none" stroke="#5ae16e" stroke-width="1.5"/></svg>'
    )
