"""What a run writes: overlay video, table of boxes, panels, JSON lines; and what of it has been written."""

from __future__ import annotations

import json
import os
import stat
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, TextIO, cast

from ..display import STATE_COLOURS, draw_box, draw_boxes
from ..following import Step, write_header, write_mot, write_row
from ..video import IMAGE_SUFFIXES, VIDEO_SUFFIXES, VideoError, VideoSink, VideoSource
from .options import Options, UsageError
from .panels import Panels, labels

__all__ = ["Outputs"]


class Outputs:
    """The files of one run. Nothing is made before the first frame but the table.

    Parameters
    ----------
    source : VideoSource
    options : Options

    Raises
    ------
    UsageError
        If two outputs are one file, one is the input, or a table is named like a video.
    VideoError
        If a video cannot be written under its name.
    """

    def __init__(self, source: VideoSource, options: Options) -> None:
        video = options.out if options.out is not None else Path(f"{source.name}.hs.webm")
        table = options.csv if options.csv is not None else Path(f"{source.name}.hs.csv")
        panels = video.with_name(f"{video.stem}.panels{video.suffix}")
        tables = [table] if options.mot is None else [table, options.mot]
        targets = [video, *tables, panels] if options.panels else [video, *tables]
        _check(options.video, targets, tables)
        _check_folders(targets)
        self._overlay = VideoSink(video, source.fps)
        self._every = options.all
        self._table = _Table(table, partial(write_header, every=options.all), partial(write_row, every=options.all))
        self._mot = _Table(options.mot, lambda _: None, write_mot) if options.mot is not None else None
        self._panels = VideoSink(panels, source.fps) if options.panels else None
        self._drawn = Panels(options.stages)
        self._json = options.json
        self._failed: set[Path] = set()

    def __enter__(self) -> Outputs:
        """Begin the tables."""
        self._table.open()
        if self._mot is not None:
            try:
                self._mot.open()
            except VideoError:
                self._table.close()
                raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Finish every file, whatever goes wrong with another."""
        with ExitStack() as stack:
            for sink in (self._overlay, self._panels):
                if sink is not None:
                    stack.callback(self._finish, sink)
            for table in self._tables:
                stack.callback(table.close)

    def write(self, step: Step) -> None:
        """Write a step to every output: the row first, so that a run that is killed has it.

        Raises
        ------
        VideoError
            If an output cannot be written.
        BrokenPipeError
            If nobody reads standard output any more.
        """
        for table in self._tables:
            table.write(step)
        if self._json:
            _print_line(json.dumps(_plain_all(step) if self._every else _plain(step)))
        self._send(self._overlay, _drawn_all(step) if self._every else _drawn(step))
        if self._panels is not None:
            self._send(self._panels, self._drawn.draw(step))

    @property
    def _tables(self) -> list[_Table]:
        return [table for table in (self._table, self._mot) if table is not None]

    def _send(self, sink: VideoSink, picture: Any) -> None:
        try:
            sink.write(picture)
        except VideoError:
            self._failed.add(sink.path)
            raise

    def _finish(self, sink: VideoSink) -> None:
        try:
            sink.close()
        except VideoError:
            self._failed.add(sink.path)
            raise

    @property
    def written(self) -> list[Path]:
        """Files that this run has written, whole as far as it went."""
        outputs = (self._overlay, self._table, self._mot, self._panels)
        made = [output.path for output in outputs if output is not None and output.count > 0]
        return [path for path in made if path not in self._failed]


class _Table:
    """A table in which every row is whole: what of a row is on a full disk is taken back."""

    def __init__(self, path: Path, header: Callable[[TextIO], None], row: Callable[[TextIO, Step], None]) -> None:
        self.path = path
        self.count = 0
        self._header, self._row = header, row
        self._file: BinaryIO | None = None

    def open(self) -> None:
        """Make the file and write the names of the columns; raises VideoError."""
        try:
            self._file = self.path.open("wb", buffering=0)
        except OSError as error:
            raise VideoError(f"{self.path}: cannot be written ({error.strerror})") from error
        try:
            self._header(cast(TextIO, _Whole(self._file, self.path)))
        except VideoError:
            self._file.close()
            raise

    def write(self, step: Step) -> None:
        """Append a row; raises VideoError."""
        assert self._file is not None
        self._row(cast(TextIO, _Whole(self._file, self.path)), step)
        self.count += 1

    def close(self) -> None:
        """Close the file."""
        if self._file is not None:
            self._file.close()


class _Whole:
    """What of a text stream a CSV writer needs: each piece is on the disk at once and as a whole, or not at all."""

    def __init__(self, file: BinaryIO, path: Path) -> None:
        self._file, self._path = file, path

    def write(self, text: str) -> int:
        data = text.encode()
        regular = stat.S_ISREG(os.fstat(self._file.fileno()).st_mode)
        begin = self._file.seek(0, os.SEEK_END) if regular else 0
        done = 0
        try:
            while done < len(data):
                done += self._file.write(data[done:])
        except OSError as error:
            if regular:
                self._file.truncate(begin)
            raise VideoError(f"{self._path}: cannot be written ({error.strerror})") from error
        return len(text)

    def flush(self) -> None:
        pass


def _print_line(line: str) -> None:
    try:
        print(line, flush=True)
    except BrokenPipeError:
        raise
    except OSError as error:
        raise VideoError(f"standard output: cannot be written ({error.strerror})") from error


def _drawn(step: Step) -> Any:
    return draw_box(step.frame, step.box, **labels(step))


def _drawn_all(step: Step) -> Any:
    """The frame with every object that is located, each by its id."""
    colour = STATE_COLOURS["tracking"]
    located = [(each.box, colour, f"{each.identity}  {each.score:.2f}") for each in step.objects if each.ok]
    return draw_boxes(step.frame, located, notes=[(labels(step)["note"], colour)])


def _plain_all(step: Step) -> dict[str, Any]:
    objects = [
        {
            "id": each.identity,
            "box": [round(side, 2) for side in each.box] if each.ok else None,
            "ok": each.ok,
            "score": round(each.score, 3),
            "state": each.state,
        }
        for each in step.objects
    ]
    return {"frame": step.index, "objects": objects}


def _plain(step: Step) -> dict[str, Any]:
    box = None if step.box is None else [round(side, 2) for side in step.box]
    return {
        "frame": step.index,
        "box": box,
        "ok": box is not None,
        "score": round(step.score, 3),
        "state": step.state,
    }


def _check_folders(targets: list[Path]) -> None:
    """Refuse before any output is begun, so that one without a place costs none of an earlier run."""
    for path in targets:
        if path.is_dir():
            raise VideoError(f"{path}: cannot be written (Is a directory)")
        if not path.parent.is_dir():
            raise VideoError(f"{path}: cannot be written (No such file or directory)")


def _check(video: str, targets: list[Path], tables: list[Path]) -> None:
    """Refuse tables that are named like videos, two outputs to one file, and any over what is read."""
    source = Path(video)
    seen: dict[str, Path] = {}
    for path in targets:
        if _same(path, source) or (path.exists() and _is_frame(path, source)):
            raise UsageError(f"{path}: would overwrite the input")
        if _is_frame(path, source):
            raise UsageError(f"{path}: would be read as a frame of the input")
        place = _place(path)
        if place in seen or any(_same(path, other) for other in seen.values()):
            raise UsageError(f"{path}: is named for two outputs")
        seen[place] = path
    for path in tables:
        if path.suffix.lower() in VIDEO_SUFFIXES | IMAGE_SUFFIXES:
            raise UsageError(
                f"{path}: is a table of boxes: expected a name as boxes.csv, got that of a video or picture"
            )


def _is_frame(path: Path, folder: Path) -> bool:
    """Whether a file of this name is, or would be, one of the frames of a folder."""
    return path.suffix.lower() in IMAGE_SUFFIXES and _same(path.parent, folder)


def _same(one: Path, two: Path) -> bool:
    """Whether two names are one file that exists."""
    try:
        return one.samefile(two)
    except (OSError, ValueError):
        return False


def _place(path: Path) -> str:
    """The file that a name stands for, whether or not there is one; case is no difference where it mostly is none."""
    place = os.path.realpath(path)
    return place.casefold() if sys.platform in {"darwin", "win32"} else place
