"""`hs-track`: follow one object through a video; boxes as CSV, an overlay video, the paper's panels.

This module and ``__main__`` are the only ones that print. Errors are one line on stderr: exit code 2 for a
command that cannot be meant, 1 for input or output that fails, 130 for Ctrl-C; what was written stays.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import signal
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import numpy as np
import tyro

from .display import draw_box, render_panels
from .following import Step, steps, write_header, write_row
from .frames import InputError, as_frame, as_roi
from .geometry import Box
from .video import VideoError, VideoSink, VideoSource, open_source, silence_decoders

if TYPE_CHECKING:
    from rich.progress import Progress

__all__ = ["Options", "main"]

PROGRAM = "hs-track"
USAGE, FAILURE, INTERRUPTED = 2, 1, 130

Kind = TypeVar("Kind")


class UsageError(ValueError):
    """A command that cannot be meant; the message is one line."""


@dataclass(frozen=True)
class Options:
    """Follow one object through a video, a camera or a folder of images.

    Without --roi and --select the first object that moves is followed.

    Other commands: `hs-track warmup` compiles the kernels in advance, `hs-track app` opens the live page.

    Parameters
    ----------
    video
        Video file, number of a camera, or folder of images.
    roi
        The object in the first frame, in px: x,y,w,h.
    select
        Open a local page and drag the box on the first frame.
    out
        Overlay video: .webm (plays in a browser), .mkv or .avi (lossless). Default: NAME.hs.webm.
    csv
        Boxes: frame,x,y,w,h,ok,score. Default: NAME.hs.csv.
    panels
        Write the paper's display (Fx, Fy, Ft, flow, normal flow, mask) too, as NAME.hs.panels.webm beside the
        overlay video.
    max_frames
        Stop after so many frames.
    """

    video: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="VIDEO")]
    roi: Annotated[str | None, tyro.conf.arg(metavar="X,Y,W,H")] = None
    select: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    csv: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    panels: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    max_frames: Annotated[int | None, tyro.conf.arg(metavar="N")] = None


@dataclass(frozen=True)
class AppOptions:
    """Pick a video, drag the box, watch every panel live, in a browser.

    Parameters
    ----------
    video
        Video file, number of a camera, or folder of images.
    port
        Port on the loopback interface; a free one by default.
    no_show
        Do not open a browser window.
    """

    video: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="VIDEO")] = ""
    port: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    no_show: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


@dataclass
class _Tally:
    """Counts for the line at the end."""

    searching: int = 0
    followed: int = 0
    lost: int = 0
    seconds: list[float] = field(default_factory=list)

    def add(self, step: Step) -> None:
        self.searching += step.state == "searching"
        self.followed += step.box is not None
        self.lost += step.box is None and step.state != "searching"
        if step.seconds:
            self.seconds.append(step.seconds)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    try:
        silence_decoders()
        with _termination_as_interrupt():
            return _command(sys.argv[1:] if arguments is None else list(arguments))
    except UsageError as error:
        return _complain(error, USAGE)
    except (VideoError, InputError, OSError, ImportError) as error:
        return _complain(error, FAILURE)
    except KeyboardInterrupt:
        return INTERRUPTED


def _command(arguments: list[str]) -> int:
    if arguments[:1] == ["warmup"]:
        return _warmup()
    if arguments[:1] == ["app"]:
        from .app import serve

        page = _parsed(AppOptions, arguments[1:], f"{PROGRAM} app")
        return serve(page.video, port=page.port, show=not page.no_show)
    return _run(_parsed(Options, arguments, PROGRAM))


@contextlib.contextmanager
def _termination_as_interrupt() -> Iterator[None]:
    """Treat a request to terminate as Ctrl-C: files are finished and servers ended."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def _complain(error: Exception, code: int) -> int:
    print(f"{PROGRAM}: {' '.join(str(error).split())}", file=sys.stderr)
    return code


def _parsed(kind: type[Kind], arguments: Sequence[str], program: str) -> Kind:
    """Parse the command; what is wrong with it becomes one line instead of tyro's box."""
    words = io.StringIO()
    try:
        with contextlib.redirect_stderr(words):
            return tyro.cli(kind, args=arguments, prog=program)
    except SystemExit as end:
        if not end.code:
            raise
    lines = [line.strip("│ ") for line in words.getvalue().splitlines() if line.startswith("│")]
    meant = itertools.takewhile(lambda line: "──" not in line, lines)
    raise UsageError(" ".join(meant) or words.getvalue())


def _warmup() -> int:
    """Compile and cache every kernel, so that the first real video starts at once."""
    from . import tracker  # noqa: F401  # and with it all modules that have kernels
    from .compiling import prepare_all

    started = time.perf_counter()
    prepare_all()
    print(f"{PROGRAM}: kernels ready after {time.perf_counter() - started:.1f} s")
    return 0


def _run(options: Options) -> int:
    roi = _parsed_roi(options.roi) if options.roi is not None else None
    if roi is not None and options.select:
        raise UsageError("--roi and --select exclude each other")
    if options.max_frames is not None and options.max_frames < 1:
        raise UsageError(f"expected --max-frames of at least 1, got {options.max_frames}")
    with open_source(options.video) as source:
        if options.select:
            roi = _selected(source)
        if roi is not None:
            _check_roi(roi, source)
        return _follow(source, roi, options)


def _parsed_roi(text: str) -> Box:
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"expected --roi x,y,w,h in px, got {text!r}") from None
    return Box(x, y, w, h)


def _check_roi(roi: Box, source: VideoSource) -> None:
    try:
        as_roi(roi, as_frame(source.first))
    except InputError as error:
        raise UsageError(str(error)) from error


def _selected(source: VideoSource) -> Box:
    from .app import select_roi

    roi = select_roi(source.first)
    if roi is None:
        raise UsageError("no box was selected")
    return roi


def _follow(source: VideoSource, roi: Box | None, options: Options) -> int:
    """Write every step as it comes; on an error or Ctrl-C what was written stays and is finished."""
    video = options.out if options.out is not None else Path(f"{source.name}.hs.webm")
    boxes = options.csv if options.csv is not None else Path(f"{source.name}.hs.csv")
    panels = video.with_name(f"{video.stem}.panels{video.suffix}") if options.panels else None
    _check_targets(options.video, [path for path in (video, boxes, panels) if path is not None])
    tally, code = _Tally(), 0
    try:
        with ExitStack() as stack:
            overlay_sink = stack.enter_context(VideoSink(video, source.fps))
            panel_sink = stack.enter_context(VideoSink(panels, source.fps)) if panels is not None else None
            table = stack.enter_context(boxes.open("w", newline="", encoding="utf-8"))
            progress = stack.enter_context(_progress())
            task = progress.add_task(source.name, total=_total(source, options))
            write_header(table)
            for step in steps(source.frames, roi, show=panels is not None, max_frames=options.max_frames):
                write_row(table, step)
                tally.add(step)
                overlay_sink.write(draw_box(step.frame, step.box, **_labels(step)))
                if panel_sink is not None:
                    panel_sink.write(render_panels(step.frame, step.fields, step.box, **_labels(step)))
                progress.update(task, advance=1, description=f"{source.name}  {step.state}")
    except (VideoError, InputError) as error:
        code = _complain(error, FAILURE)
    except OSError as error:  # of the table: sources and videos raise errors of their own
        code = _complain(OSError(f"{boxes}: cannot be written ({error.strerror})"), FAILURE)
    except KeyboardInterrupt:
        code = INTERRUPTED
    _summarise(source.name, tally, [path for path in (video, boxes, panels) if path is not None], code)
    return code


def _check_targets(video: str, targets: list[Path]) -> None:
    for number, path in enumerate(targets):
        if path.exists() and Path(video).exists() and path.samefile(video):
            raise UsageError(f"{path}: would overwrite the input")
        if path in targets[:number]:
            raise UsageError(f"{path}: is named for two outputs")


def _total(source: VideoSource, options: Options) -> int | None:
    if source.count is None or options.max_frames is None:
        return source.count if source.count is not None else options.max_frames
    return min(source.count, options.max_frames)


def _progress() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        # Into a log file it would write an empty line.
        disable=not console.is_terminal,
    )


def _labels(step: Step) -> dict[str, Any]:
    score = None if step.state == "searching" else step.score
    return {"state": step.state, "score": score, "note": f"frame {step.index}"}


def _summarise(name: str, tally: _Tally, written: list[Path], code: int) -> None:
    frames = tally.searching + tally.followed + tally.lost
    parts = [f"{frames} frames", f"object in {tally.followed}"]
    if tally.searching:
        parts.append(f"none yet in {tally.searching}")
    if tally.lost:
        parts.append(f"lost in {tally.lost}")
    if tally.seconds:
        parts.append(f"{1e3 * float(np.median(tally.seconds)):.1f} ms per update")
    ending = " (interrupted)" if code == INTERRUPTED else ""
    files = ", ".join(str(path) for path in written if path.is_file())
    print(f"{name}: {', '.join(parts)}{ending}; wrote {files or 'nothing'}")
