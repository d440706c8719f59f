"""What can be asked of `hs-track`, and what cannot be meant."""

from __future__ import annotations

import contextlib
import io
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import tyro

from ..geometry import Box
from ..stages import StageParams

__all__ = ["PROGRAM", "AppOptions", "Options", "UsageError", "check", "parsed", "parsed_roi"]

PROGRAM = "hs-track"

Kind = TypeVar("Kind")
Flow = Literal["classic", "solve", "fast", "default", "accurate", "tracker"]


class UsageError(ValueError):
    """A command that cannot be meant; the message is one line."""


@dataclass(frozen=True)
class Options:
    """Follow one object through a video, a stream, a camera or a folder of images.

    Without --roi and --select the first object that moves is followed, and the next one when that has left.

    Other commands: `hs-track app [VIDEO]` opens the live page, `hs-track --version` names the versions. Exit code:
    0; 1 for input or output that fails, 2 for a command that cannot be meant, 130 after Ctrl-C (128 + number of the
    signal); what was written stays.

    Parameters
    ----------
    video
        Video file, URL (rtsp, http, …), number of a camera, or folder of images; `hs-track app` starts without, too.
    roi
        The object in the first frame, in px: x,y,w,h.
    select
        Open a local page and drag the box on the first frame.
    all
        Follow everything that moves; the table of boxes has a row per object, with its id.
    start
        Begin with this frame; the first of the video is 0.
    step
        Take every N-th frame only.
    max_frames
        Stop after so many frames.
    gain
        Gray levels (of 255) per unit of images of more than 8 bits; by default the range is that of the first frame.
    out
        Overlay video: .webm (plays in a browser), .mkv or .avi (lossless); no .mp4, for which OpenCV's wheels lack an
        encoder. Default: NAME.hs.webm.
    csv
        Boxes: frame,x,y,w,h,ok,score,state; with --all frame,id,x,… Default: NAME.hs.csv.
    mot
        With --all: located objects as a MOTChallenge file too: frame,id,left,top,width,height,score,-1,-1,-1, frames
        and pixels from 1.
    json
        Boxes also as JSON, one line per frame, on standard output; what is said at the end goes to standard error.
    panels
        Write the paper's display (Fx, Fy, Ft, flow, normal flow, threshold, segmentation, corners) too, as
        NAME.hs.panels.webm beside the overlay video.
    flow
        Flow of the panels: classic is the paper's, on the whole frame; tracker shows the tracker's own window.
    smoothness
        λ of the panels' flow, gray levels; that of the paper is 10.
    iterations
        Iterations of the panels' flow; classic has 100.
    """

    video: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="VIDEO")]
    roi: Annotated[str | None, tyro.conf.arg(metavar="X,Y,W,H")] = None
    select: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    all: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    start: Annotated[int, tyro.conf.arg(metavar="N")] = 0
    step: Annotated[int, tyro.conf.arg(metavar="N")] = 1
    max_frames: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    gain: Annotated[float | None, tyro.conf.arg(metavar="G")] = None
    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    csv: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    mot: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    panels: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    flow: Flow = "classic"
    smoothness: Annotated[float | None, tyro.conf.arg(metavar="λ")] = None
    iterations: Annotated[int | None, tyro.conf.arg(metavar="N")] = None

    @property
    def stages(self) -> StageParams | None:
        """What the panels are computed with; None for those of the tracker's own window."""
        if self.flow == "tracker":
            return None
        numbers = {"smoothness": self.smoothness, "iterations": self.iterations}
        given = {name: value for name, value in numbers.items() if value is not None}
        return StageParams.preset(self.flow, **given)


def check(options: Options) -> None:
    """Refuse what cannot be meant; raises UsageError."""
    if options.roi is not None and options.select:
        raise UsageError("--roi and --select exclude each other")
    if options.all and (options.roi is not None or options.select):
        raise UsageError("--all follows whatever moves: it takes neither --roi nor --select")
    if options.mot is not None and not options.all:
        raise UsageError("--mot is a file of several objects: it needs --all")
    for name, least in (("start", 0), ("step", 1), ("max_frames", 1)):
        value = getattr(options, name)
        if value is not None and value < least:
            raise UsageError(f"expected --{name.replace('_', '-')} of at least {least}, got {value}")
    if options.gain is not None and not 0.0 < options.gain < math.inf:
        raise UsageError(f"expected --gain above 0, got {options.gain:g}")
    numbers = options.smoothness is not None or options.iterations is not None
    if (options.flow != "classic" or numbers) and not options.panels:
        raise UsageError("--flow, --smoothness and --iterations are for --panels")
    if options.flow == "tracker" and numbers:
        raise UsageError("--smoothness and --iterations have no meaning with --flow tracker")
    try:
        _ = options.stages
    except ValueError as error:
        raise UsageError(str(error)) from error


@dataclass(frozen=True)
class AppOptions:
    """Pick a video, drag boxes, compare trackers, see the paper step by step, in a browser.

    Parameters
    ----------
    video
        Video file, number of a camera, URL of a stream, folder of images, or folder of videos.
    models
        Folder that holds TrackerNano's *backbone*.onnx and *head*.onnx, to compare with it.
    port
        Port on the loopback interface, or the next free one; any free one by default.
    no_show
        Do not open a browser window.
    """

    video: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="[VIDEO]")] = ""
    models: Annotated[str, tyro.conf.arg(metavar="DIR")] = ""
    port: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    no_show: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False


def parsed(kind: type[Kind], arguments: Sequence[str], program: str = PROGRAM) -> Kind:
    """Parse a command; what is wrong with it becomes one line instead of tyro's box.

    Raises
    ------
    UsageError
        If it cannot be meant.
    """
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


def parsed_roi(text: str) -> Box:
    """Box of ``x,y,w,h``; raises UsageError."""
    try:
        x, y, w, h = (float(part) for part in text.split(","))
    except ValueError:
        raise UsageError(f"expected --roi x,y,w,h in px, got {text!r}") from None
    return Box(x, y, w, h)
