"""What a viewer takes away: boxes, an overlay video, the panels, and a program that does the same."""

from __future__ import annotations

import io
import itertools
import tempfile
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import cv2

from ..display import tile_panels
from ..following import write_header, write_row
from ..params import TrackerHS_Params
from ..stages import StageParams
from ..video import VideoError, VideoSink
from .pictures import draw_tracks
from .session import Moment, Session
from .sources import DEMO
from .tracks import OURS, Track

__all__ = ["overlay_webm", "panels_png", "snippet", "table_csv"]

PANEL_WIDTH = 480
"""Of a panel that is saved, px."""


def table_csv(track: Track) -> str:
    """The boxes of one track, as `hs-track --csv` writes them."""
    table = io.StringIO(newline="")
    write_header(table)
    for step in track.steps:
        write_row(table, step)
    return table.getvalue()


def overlay_webm(session: Session, seen: Moment) -> bytes:
    """All frames that a track has seen, with every box drawn on them.

    Parameters
    ----------
    session : Session
    seen : Moment
        Whose tracks are drawn.

    Raises
    ------
    VideoError
        If there is no track, a frame cannot be had any more, or another video has been opened.
    """
    tracks = seen.tracks
    if not tracks:
        raise VideoError("nothing has been followed yet")
    if not session.shows(seen):
        raise VideoError(f"{seen.store.name}: is no longer open")
    with tempfile.TemporaryDirectory(prefix="hs-track-") as folder:
        path = Path(folder) / "overlay.webm"
        with VideoSink(path, seen.store.fps) as sink:
            for index, frame in _frames(session, seen):
                sink.write(draw_tracks(frame, tracks, index))
        return path.read_bytes()


def _frames(session: Session, seen: Moment) -> Iterator[tuple[int, Any]]:
    """All frames that a track has seen, with their numbers."""
    first, last = min(track.start for track in seen.tracks), max(track.head for track in seen.tracks)
    if seen.store.live:
        for index in range(first, last + 1):
            yield index, session.frame_at(index, seen)
        return
    # Read on their own: out of the store they would drive what the viewer looks at.
    with session.sources.open(seen.store.offered) as source:
        yield from itertools.islice(enumerate(source.frames), first, last + 1)


def panels_png(session: Session, seen: Moment, names: list[str]) -> bytes:
    """Panels of a frame in a grid, with their titles and notes.

    Parameters
    ----------
    session : Session
    seen : Moment
        Whose frame is drawn.
    names : list of str
        As for ``Session.panels``.

    Raises
    ------
    VideoError
        If there is none: in the first frame, or when none is chosen; or if another video has been opened.
    """
    panels = session.panels(seen, names, PANEL_WIDTH)
    if not panels:
        raise VideoError("there are no panels to save: choose some, and go to a frame behind the first")
    tiles = tile_panels([(panel.title, panel.note, panel.picture) for panel in panels])
    return cv2.imencode(".png", tiles)[1].tobytes()


def snippet(session: Session, seen: Moment) -> str:
    """A Python program that finds the same boxes and computes the same panels.

    Parameters
    ----------
    session : Session
    seen : Moment
        Whose frame and tracks the program is about.
    """
    name = seen.store.offered
    ours = [track for track in seen.tracks if track.name == OURS]
    names = ["TrackerHS", "TrackerHS_Params"] if any(_parameters(track) for track in ours) else ["TrackerHS"]
    demo = name == DEMO
    lines = [f"from hs_tracker_cv import {', '.join(names)}"] if ours else []
    lines += ["from hs_tracker_cv.app.demo import demo"] if demo else []
    lines += [
        "from hs_tracker_cv.stages import PaperMethod, StageParams",
        *([] if demo else ["from hs_tracker_cv.video import open_source"]),
        "",
        "",
        *(["# handed over in the browser: expected beside this program"] if session.sources.is_upload(name) else []),
        "def opened():",
        f"    return {'demo()' if demo else f'open_source({session.sources.argument(name)!r})'}",
        "",
        "",
        "# the paper's method from the frame before to the one shown",
        *_paper(seen.index, session.stage_params),
    ]
    for track in ours:
        lines += ["", *_following(track)]
    return "\n".join(lines) + "\n"


def _paper(index: int, params: StageParams) -> list[str]:
    return [
        "parameters = StageParams(",
        *(f"    {field.name}={getattr(params, field.name)!r}," for field in fields(params)),
        ")",
        "method, previous = PaperMethod(parameters), None",
        "with opened() as source:",
        "    for index, frame in enumerate(source.frames):",
        f"        if index == {max(index, 1)}:",
        "            stages = method.calc(previous, frame)",
        "            print(index, stages.flow.shape, stages.box)",
        "            break",
        "        previous = frame",
    ]


def _parameters(track: Track) -> str:
    return "" if track.parameters == TrackerHS_Params() else repr(track.parameters)


def _following(track: Track) -> list[str]:
    return [
        f"# object {track.number}",
        f"tracker = TrackerHS({_parameters(track)})",
        "with opened() as source:",
        "    for index, frame in enumerate(source.frames):",
        f"        if index == {track.start}:",
        f"            tracker.init(frame, {tuple(track.roi)!r})",
        f"        elif index > {track.start}:",
        "            ok, _ = tracker.update(frame)",
        "            print(index, tracker.box if ok else None, tracker.getTrackingScore())",
    ]
