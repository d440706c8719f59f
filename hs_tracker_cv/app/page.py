"""The page: a video, a box, the trackers on it, the stages of the paper's method, and what to take away."""

from __future__ import annotations

import asyncio
import time
import weakref
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import cv2
import numpy as np
from nicegui import background_tasks, events, run, ui

from ..frames import InputError
from ..geometry import Box
from ..movers import MoverFinder
from ..video import VIDEO_SUFFIXES, VideoError
from .controls import Controls
from .panels import WATCH, PanelGrid
from .picker import BoxPicker
from .pictures import colour, draw_tracks, picture_url
from .session import Moment, Session
from .sources import Sources
from .stream import SCRIPT, Stream
from .strip import strip_svg
from .style import ACCENT, CSS, KEYS, LET_GO

__all__ = ["app_page"]

LARGEST = 960
"""Width, px, in which frames are sent to the browser at most."""
FASTEST = 30.0
"""Frames shown per second at most; faster play leaves frames out, of the picture and not of the tracks."""
LATE = 0.2
"""Seconds that the video may lag behind the clock and still catch up with it."""
SLICE = 0.1
"""Seconds of work after which the page shows how far it is."""
TELL_SECONDS = 0.3
"""How often numbers and curves are told while the video plays: each time costs the browser as much as a picture."""
DRAG = "Drag a box round an object, at any frame."
WAITING = "waiting for something that moves"
SPEEDS = {0.25: "¼ ×", 0.5: "½ ×", 1: "1 ×", 2: "2 ×", 4: "4 ×"}


def app_page(video: str = "", models: str = "") -> None:
    """Declare the page at ``/``.

    Parameters
    ----------
    video : str
        What it opens at first: a video file, the number of a camera, a folder of images or of videos; empty to let
        the viewer choose.
    models : str
        Folder of TrackerNano's models; empty for none.
    """

    @ui.page("/")
    def page() -> None:
        Page(Session(Sources(video), models), opens=bool(video))


@dataclass(frozen=True)
class Shown:
    """A frame, ready to be sent.

    Parameters
    ----------
    moment : Moment
        What it is a picture of.
    url : str
        The picture, encoded.
    size : tuple of int
        Of the frame, px.
    scale : float
        Picture px per frame px.
    rows : str
        What the trackers say of it, as rows of a table.
    """

    moment: Moment
    url: str
    size: tuple[int, int]
    scale: float
    rows: str

    @property
    def index(self) -> int:
        """Number of the frame."""
        return self.moment.index


class Page:
    """The elements of one viewer's page and what their events do."""

    def __init__(self, session: Session, *, opens: bool) -> None:
        self.session = session
        self.goal: int | None = None
        self.asked = 0  # how often a frame has been asked for
        self.moving = asyncio.Lock()  # held on the way to a frame, or to the first mover
        self.turn = asyncio.Lock()  # held by one change after the other
        self.finder: MoverFinder | None = None  # of the search for the first mover that goes on
        self.playing = False
        self.left = False
        self.due = 0.0
        self.told_at = 0.0
        self.shown: Shown | None = None
        ui.colors(primary=ACCENT)
        ui.add_css(CSS)
        ui.add_head_html(KEYS + SCRIPT + WATCH)
        self.dark = ui.dark_mode(None)
        self._header()
        with ui.element("div").classes("hs-main"):
            with ui.element("div").classes("hs-view"):
                self._view()
            with ui.element("div").classes("hs-side"):
                self.controls = Controls(self)
        self.grid = PanelGrid(self)
        ui.keyboard(self._key, ignore=["input", "textarea", "select"])
        self.timer = ui.timer(1.0 / FASTEST, self._tick, active=False)
        self.client = ui.context.client
        # Deletion and not disconnection: a connection that is lost for a moment comes back to the same page.
        self.client.on_delete(self._leave)
        if opens:
            # A timer starts when the page is seen: a request alone opens no video.
            ui.timer(0.0, lambda: self.name.set_value(self.session.sources.names[0]), once=True)

    # Layout

    def _header(self) -> None:
        with ui.element("div").classes("hs-header"):
            ui.label("hs-track").classes("hs-title")
            self.name = ui.select(
                list(self.session.sources.names), label="Video", on_change=lambda event: self.open(event.value)
            )
            self.name.classes("hs-grow").props("data-part=name dense outlined options-dense")
            self.name.on("popup-hide", js_handler=LET_GO)
            # FastAPI keeps the handlers of uploads in a cache for good: they must not keep the page.
            page = weakref.ref(self)
            self.upload = ui.upload(auto_upload=True, on_upload=lambda event: _taken(page(), event))
            self.upload.classes("hidden").props("data-part=upload")
            self.upload.props(f"accept={','.join(sorted(VIDEO_SUFFIXES))}")
            pick = f"() => runMethod({self.upload.id}, 'pickFiles', [])"
            ui.button("Open file", icon="upload_file").props(
                'outline dense no-caps data-part=open aria-label="Open file"'
            ).on("click", js_handler=pick)
            ui.button(icon="contrast", on_click=self._toggle_dark).props(
                'flat round dense data-part=dark aria-label="Light or dark"'
            ).tooltip("Light or dark")

    def _view(self) -> None:
        self.picker = BoxPicker(self._boxed, self._clicked, self._halt)
        self.picker.element.props("data-part=frame").classes("hs-frame")
        self.stream = Stream(self.picker.element)
        self.hint = ui.label("Open a video, or choose the demo above.").classes("hs-hint").props("data-part=hint")
        with ui.element("div").classes("hs-transport"):
            back, self.play_button, ahead = (
                ui.button(icon=icon, on_click=act)
                .props(f'round dense data-part={name} aria-label="{tip}"')
                .tooltip(tip)
                for icon, name, tip, act in (
                    ("skip_previous", "back", "One frame back (←)", lambda: self._step(-1)),
                    ("play_arrow", "play", "Play or pause (space)", self._toggle),
                    ("skip_next", "ahead", "One frame ahead (→)", lambda: self._step(1)),
                )
            )
            for button in (back, ahead):
                button.props("flat")
            self.slider = (
                ui.slider(min=0, max=1, step=1, value=0).props("data-part=scrub aria-label=Frame").classes("hs-grow")
            )
            self.slider.on(
                "update:model-value", lambda event: self.seek(int(event.args)), throttle=0.05, leading_events=False
            )
            self.speed = ui.select(SPEEDS, value=1).props(
                "data-part=speed aria-label=Speed dense borderless options-dense"
            )
            self.speed.tooltip("Speed")
            self.speed.on("popup-hide", js_handler=LET_GO)
        self.facts = ui.label("").classes("hs-facts").props("data-part=facts")
        self.strip = ui.html("", sanitize=False).classes("hs-strip").props("data-part=strip")
        self.strip.on(
            "click",
            self._point,
            js_handler="""(e) => {
                const place = e.currentTarget.querySelector("svg").getBoundingClientRect();
                emit((e.clientX - place.left) / place.width);
            }""",
        )
        self.table = ui.html("", sanitize=False).classes("hs-table").props("data-part=tracks")

    def _toggle_dark(self) -> None:
        """From what the browser wants to dark, to light, and back."""
        self.dark.value = {None: True, True: False, False: None}[self.dark.value]

    # Sources

    async def take(self, event: events.UploadEventArguments) -> None:
        """Store an upload and open it."""
        try:
            name, path = self.session.sources.reserve(event.file.name)
        except VideoError as error:
            self.complain(error)
            return
        try:
            await event.file.save(path)
        except OSError as error:
            self.complain(VideoError(f"{name}: cannot be stored ({error.strerror})"))
            return
        self.upload.reset()
        self.name.set_options(list(self.session.sources.names))
        self.name.set_value(name)

    async def open(self, name: str) -> None:
        """Open a source by its name and show its first frame."""
        self._halt()
        self.picker.clear()
        self.hint.set_text(f"Opening {name} …")
        async with self.turn:
            opened = await self.do(self.session.open, name) if name == self.name.value else None
        if name != self.name.value:
            return  # another was asked for meanwhile
        self.hint.set_text(DRAG if opened else "Open another video.")
        if opened:
            await self.pursue(0)
        else:
            self._blank()

    def _blank(self) -> None:
        self.shown = None
        self.picker.element.set_source("")
        for element in (self.strip, self.table):
            element.set_content("")
        self.facts.set_text("")
        self.grid.refresh()

    # Time

    async def _step(self, by: int) -> None:
        self._play(False)
        await self.pursue(self._aim() + by)

    def _aim(self) -> int:
        """The frame that it goes to, or is at."""
        return self.goal if self.goal is not None else self.session.index

    def seek(self, index: int) -> None:
        """Go to a frame, showing the way."""
        self._play(False)
        background_tasks.create(self.pursue(index), name="seek")

    def _point(self, event: events.GenericEventArguments) -> None:
        """Go to a place in the strip, a share of its width."""
        if self.shown is not None:
            self.seek(round(event.args * self.shown.moment.count - 0.5))

    async def _toggle(self) -> None:
        playing = not self.playing and self.session.opened
        self._play(playing)
        seen = self.shown.moment if self.shown is not None else None
        if playing and seen is not None and seen.store.ended and self._aim() >= seen.count - 1:
            await self.pursue(0)  # at the end it plays from the beginning

    def _halt(self) -> None:
        """Pause, and stay here even if it was going to another frame."""
        self._play(False)
        self.goal = None

    def _play(self, playing: bool) -> None:
        """Play or pause; a search for the first mover ends."""
        self.finder = None
        paused = self.playing and not playing
        self.playing = playing
        self.due = time.monotonic()
        self.stream.begin()
        self.play_button.props(f"icon={'pause' if playing else 'play_arrow'}")
        if hasattr(self, "timer"):
            self.timer.active = playing
        if paused and not self.moving.locked() and self.shown is not None:
            # What was left out while it played.
            self._tell(self.shown)
            self.grid.refresh()

    async def _tick(self) -> None:
        if self.moving.locked() or not self.playing or self.shown is None:
            return
        rate = self.shown.moment.store.fps * float(self.speed.value)
        stride = max(round(rate / FASTEST), 1)
        # By the clock: a frame that came late does not put off those behind it, unless it came very late.
        now = time.monotonic()
        self.due = max(self.due + stride / rate, now - LATE)
        self.timer.interval = max(self.due - now, 0.0)
        before = self.session.index
        await self.pursue(before + stride)
        if self.session.index == before:
            self._play(False)

    async def catch_up(self) -> None:
        """Let tracks that are behind come to the current frame, or to the one that it goes to."""
        await self.pursue(self._aim())

    async def pursue(self, goal: int) -> None:
        """Go to a frame and show what is on the way; the last goal given counts."""
        if not self.session.opened:
            return
        self.goal = max(goal, 0)
        self.asked += 1
        if self.moving.locked():
            return
        async with self.moving:
            try:
                while self.goal is not None and not self.left:
                    asked = self.asked
                    advanced = await self.do(self._advance, self.goal)
                    # After an error it stays at the last frame before.
                    arrived, shown = advanced or (True, await run.io_bound(self._render))
                    if shown is not None and not self.left:
                        await self._show(shown)
                    # The same frame may have been asked for again meanwhile, for tracks that are new.
                    if arrived and self.asked == asked:
                        self.goal = None
            finally:
                self.goal = None
        self.grid.refresh()

    def _advance(self, goal: int) -> tuple[bool, Shown | None]:
        # While another source is being opened there is none, and no frame to go to.
        return not self.session.opened or self.session.go_to(goal, SLICE), self._render()

    def _render(self) -> Shown | None:
        """Draw and encode the current frame; in a thread of its own."""
        moment = self.session.current()
        if moment is None:
            return None
        picture = draw_tracks(moment.frame, moment.tracks, moment.index)
        height, width = picture.shape[:2]
        scale = min(LARGEST / width, 1.0)
        if scale < 1.0:
            size = (LARGEST, round(height * scale))
            picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
        return Shown(moment, picture_url(picture), (width, height), scale, _rows(moment.tracks, moment.index))

    async def _show(self, shown: Shown) -> None:
        if not self.session.shows(shown.moment):
            return  # another source was opened while it was drawn
        # What is proposed holds for its frame; a box that is being drawn is not taken away.
        if (self.shown is None or shown.index != self.shown.index) and not self.picker.dragging:
            self.picker.clear()
        self.shown = shown
        if self.playing:
            await self.stream.send(shown.url)
        else:
            await self.stream.settle()
        if not self.playing or time.monotonic() - self.told_at > TELL_SECONDS:
            self._tell(shown)

    def _tell(self, shown: Shown) -> None:
        """All that the page says of a frame; and the frame itself, unless it is on its way."""
        self.told_at = time.monotonic()
        if not self.playing:
            self.picker.show_url(shown.url, shown.size, shown.scale)
        store, total = shown.moment.store, shown.moment.count
        self.slider.props(f"max={max(total - 1, 1)}")
        self.slider.set_value(shown.index)
        self.table.set_content(shown.rows)
        count = f"of {store.count}" if store.count is not None else "(live)"
        words = f"frame {shown.index} {count} · {shown.size[0]} × {shown.size[1]} px · {store.fps:g} frames/s"
        if self.playing and (rate := self.stream.rate):
            words += f" · shown {rate:.0f}/s"
        self.facts.set_text(words)
        self.strip.set_content(strip_svg(shown.moment.tracks, shown.index, total))

    # Objects

    async def _boxed(self, box: Box) -> None:
        if self.shown is None:
            return
        self._halt()
        whole, seen = Box(*box.rounded()), self.shown.moment
        if await self.change(partial(self.session.start, whole, add=self.controls.several.value, seen=seen)):
            idle = "" if self.session.names else ": choose a tracker to follow it"
            self.hint.set_text(f"box {', '.join(f'{side:g}' for side in whole)} at frame {seen.index}{idle}")
            self.picker.clear()
            # Back, if it was on its way and a step further already.
            await self.pursue(seen.index)

    async def _clicked(self, x: float, y: float) -> None:
        proposed = self.picker.proposed_at(x, y)
        if proposed is not None:
            await self._boxed(proposed)
        else:
            self.picker.clear()

    async def propose(self) -> None:
        """Draw what moves in this frame, to be clicked."""
        if self.shown is None:
            return
        self._halt()
        seen = self.shown.moment
        regions = await self.do(self.session.regions, seen)
        if regions is not None and self.shown is not None and self.shown.moment is seen:
            self.picker.propose([region.box for region in regions])
            few = "nothing moves here" if seen.index else "there is no motion in the first frame: go on first"
            self.hint.set_text("Click a dashed box to follow it." if regions else few)

    async def follow_first(self) -> None:
        """Go on until something moves and follow that; whatever else is asked for meanwhile ends it."""
        if not self.session.opened:
            return
        self._halt()
        finder = self.finder = MoverFinder()
        async with self.moving:
            found = await self._search(finder)
        if self.finder is finder or self.goal is not None:
            await self.catch_up()
        if self.finder is finder:
            self.hint.set_text("" if found else "nothing has moved up to the end")
            self._play(found)
        elif self.hint.text == WAITING:
            self.hint.set_text(DRAG)

    async def _search(self, finder: MoverFinder) -> bool:
        """Show the way to the first mover; whether there is one."""
        self.hint.set_text(WAITING)
        found, before = False, -1
        while not found and self.finder is finder and self.session.index != before and not self.left:
            before = self.session.index
            found = bool(await self.do(self.session.follow_first_mover, finder, SLICE))
            shown = await run.io_bound(self._render)
            if shown is not None:
                await self._show(shown)
        return found

    async def forget(self) -> None:
        """Take all boxes away and go back to where the first was drawn."""
        self._halt()
        if not self.session.opened:
            return
        start = await self.change(self.session.forget)
        self.hint.set_text(DRAG)
        self.picker.clear()
        await self.pursue(start)

    # Keys, errors, end

    async def _key(self, event: events.KeyEventArguments) -> None:
        if not event.action.keydown or event.modifiers.ctrl or event.modifiers.meta or event.modifiers.alt:
            return
        if event.key.space and not event.action.repeat:
            await self._toggle()
        elif event.key.arrow_left or event.key.arrow_right:
            by = 10 if event.modifiers.shift else 1
            await self._step(by if event.key.arrow_right else -by)
        elif event.key == "r":
            await self.forget()

    async def change(self, work: Callable[..., Any], *args: Any) -> Any:
        """As `do`, after all changes that were asked for before: threads that wait for a lock have no order."""
        async with self.turn:
            return await self.do(work, *args)

    async def do(self, work: Callable[..., Any], *args: Any, **kwargs: Any) -> Any:
        """Do something in a thread, and say what goes wrong; True for what returns nothing, None after an error."""
        try:
            result = await run.io_bound(work, *args, **kwargs)
        except (VideoError, InputError, cv2.error) as error:
            self._play(False)
            self.complain(error)
            return None
        return True if result is None else result

    def complain(self, error: Exception) -> None:
        """Show an error as one line."""
        if not self.left:
            with self.client:
                ui.notify(" ".join(str(error).split()), type="negative", multi_line=True)

    async def _leave(self) -> None:
        self.left = True
        # In a thread: it waits for the frame that is being worked on.
        await run.io_bound(self.session.close)


async def _taken(page: Page | None, event: events.UploadEventArguments) -> None:
    if page is not None:
        await page.take(event)


def _rows(tracks: list[Any], index: int) -> str:
    """What each track says of a frame, as an HTML table."""
    rows = []
    for track in tracks:
        step = track.at(index)
        if step is None:
            continue
        box = "–"
        if step.box is not None:
            x, y, w, h = step.box
            box = f"{x:.1f}, {y:.1f} &nbsp; {w:.1f} × {h:.1f}"
        score = "" if step.score != step.score else f"{step.score:.2f}"
        seconds = track.seconds(index)
        spent = f"{1e3 * seconds:.1f} ms" if seconds else ""
        rows.append(
            f'<tr><td><b style="background:{colour(track.name)}"></b>{track.label}</td><td>{step.state}</td>'
            f"<td>{score}</td><td>{box}</td><td>{spent}</td></tr>"
        )
    head = "<tr><th>tracker</th><th>state</th><th>score</th><th>box, px</th><th>update, median</th></tr>"
    return f"<table>{head}{''.join(rows)}</table>" if rows else ""
