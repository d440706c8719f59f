"""How `hs-track` ends: signals, full disks, closed pipes. What was written stays, whole."""

from __future__ import annotations

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hs_tracker_cv import cli
from hs_tracker_cv.cli import command
from hs_tracker_cv.following import Step
from hs_tracker_cv.video import VideoSink, open_source
from tests.odd_files import moving_square

ROOT = Path(__file__).resolve().parents[1]
ROI = ("--roi", "30,40,36,36")
SIGNALS = [name for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)]

needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")


@pytest.fixture(scope="module")
def videos(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a video of 40 frames, in.mkv, and one of more frames than a pipe holds lines of, long.mkv."""
    folder, frames = tmp_path_factory.mktemp("videos"), moving_square()[0]
    for name, times in (("in.mkv", 1), ("long.mkv", 50)):
        with VideoSink(folder / name, 25.0) as sink:
            for frame in frames * times:
                sink.write(frame)
    return folder


@pytest.fixture
def here(videos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A working directory with the short one."""
    monkeypatch.chdir(tmp_path)
    shutil.copy(videos / "in.mkv", tmp_path)
    return tmp_path


def _rows(path: Path) -> list[dict[str, str]]:
    """Rows of a table, each of which must be whole."""
    data = path.read_bytes()
    assert data.endswith(b"\n")
    rows = list(csv.DictReader(data.decode().splitlines()))
    assert all(None not in row.values() and None not in row for row in rows)
    return rows


def _frames(path: Path) -> int:
    with open_source(path) as source:
        return sum(1 for _ in source.frames)


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def _alone(here: Path, *arguments: str, **options: Any) -> subprocess.CompletedProcess[str]:
    program = [sys.executable, "-m", "hs_tracker_cv", *arguments]
    shared: dict[str, Any] = {"cwd": here, "env": _environment(), "text": True, "timeout": 300, "check": False}
    return subprocess.run(program, **{"capture_output": True, **shared, **options})


def _signalled(monkeypatch: pytest.MonkeyPatch, place: str, numbers: list[int], index: int) -> None:
    """Send signals to this process while frame `index` is worked on: before it is tracked, or between its outputs."""

    def send() -> None:
        for number in numbers:
            os.kill(os.getpid(), number)

    whole = command.steps

    def steps(*arguments: Any, **options: Any) -> Iterator[Step]:
        for step in whole(*arguments, **options):
            if place == "tracking" and step.index == index:
                send()
            yield step

    write = VideoSink.write

    def writes(self: VideoSink, frame: Any) -> None:
        if place == "writing" and self.count == index:
            send()
        write(self, frame)

    monkeypatch.setattr(command, "steps", steps)
    monkeypatch.setattr(VideoSink, "write", writes)


@pytest.mark.skipif(os.name == "nt", reason="os.kill ends the process there")
@pytest.mark.parametrize("place", ["tracking", "writing"])
@pytest.mark.parametrize("name", SIGNALS)
@pytest.mark.parametrize("times", [1, 3])
def test_a_signal_leaves_as_many_rows_as_frames(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], name: str, place: str, times: int
) -> None:
    """Wherever it comes and however often: the frame is finished, all files play, the exit code says which signal."""
    number = getattr(signal, name)
    before = signal.getsignal(number)
    _signalled(monkeypatch, place, [number] * times, 2)
    assert cli.main(["in.mkv", *ROI, "--panels"]) == 128 + number
    assert len(_rows(here / "in.hs.csv")) == 3
    assert _frames(here / "in.hs.webm") == _frames(here / "in.hs.panels.webm") == 3
    said = capsys.readouterr()
    assert "(interrupted); wrote in.hs.webm, in.hs.csv, in.hs.panels.webm\n" in said.out
    assert said.err == ""
    assert signal.getsignal(number) is before


@pytest.mark.skipif(os.name == "nt", reason="os.kill ends the process there")
def test_a_terminal_that_closes_sends_several_signals(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The first one counts."""
    _signalled(monkeypatch, "writing", [signal.SIGHUP, signal.SIGTERM, signal.SIGINT], 3)
    assert cli.main(["in.mkv", *ROI]) == 128 + signal.SIGHUP
    assert len(_rows(here / "in.hs.csv")) == _frames(here / "in.hs.webm") == 4


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signal on this system")
def test_nohup_is_obeyed(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A signal that the caller ignores stays ignored."""
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        _signalled(monkeypatch, "tracking", [signal.SIGHUP], 3)
        assert cli.main(["in.mkv", *ROI]) == 0
        assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)
    assert len(_rows(here / "in.hs.csv")) == 40


@pytest.mark.skipif(os.name == "nt", reason="os.kill ends the process there")
def test_a_signal_before_the_first_frame_ends_at_once(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While the source is being opened there is nothing to finish."""

    def opening(*arguments: Any, **options: Any) -> Any:
        os.kill(os.getpid(), signal.SIGTERM)
        raise AssertionError("the signal has not been raised")

    monkeypatch.setattr(command, "open_source", opening)
    assert cli.main(["in.mkv", *ROI]) == 128 + signal.SIGTERM
    assert sorted(path.name for path in here.iterdir()) == ["in.mkv"]


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="no such signal on this system")
def test_a_process_whose_terminal_closes_leaves_playable_files(here: Path, videos: Path) -> None:
    """From outside: SIGHUP to the process in the middle of a long run."""
    shutil.copy(videos / "long.mkv", here)
    program = [sys.executable, "-m", "hs_tracker_cv", "long.mkv", *ROI, "--json"]
    with subprocess.Popen(program, env=_environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        for _ in range(10):
            process.stdout.readline()
        process.send_signal(signal.SIGHUP)
        rest, _ = process.communicate(timeout=60)
    assert process.returncode == 128 + signal.SIGHUP
    lines = 10 + rest.count(b"\n")
    assert lines < 2000
    assert len(_rows(here / "long.hs.csv")) == _frames(here / "long.hs.webm") == lines


def test_a_run_that_is_killed_has_written_its_boxes(here: Path) -> None:
    """Each row is on the disk before the next frame is looked at: kill -9 loses none of them."""
    code = """
import os, signal, sys
from hs_tracker_cv import cli
from hs_tracker_cv.cli import command
steps = command.steps
def killed(*arguments, **options):
    for step in steps(*arguments, **options):
        yield step
        if step.index == 5:
            os.kill(os.getpid(), signal.SIGKILL)
command.steps = killed
cli.main(sys.argv[1:])
"""
    program = [sys.executable, "-c", code, "in.mkv", *ROI]
    done = subprocess.run(program, cwd=here, env=_environment(), timeout=300, check=False)
    assert done.returncode == -9
    assert [int(row["frame"]) for row in _rows(here / "in.hs.csv")] == list(range(6))


@pytest.mark.parametrize("room", range(0, 200, 9))
def test_a_table_that_finds_no_room_ends_with_a_whole_row(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], room: int
) -> None:
    """However much of a row the disk still takes: it is taken back, and one line says why the run ended."""
    from hs_tracker_cv.cli import outputs

    class Disk:
        """A file on a disk that has room for so many bytes."""

        def __init__(self, file: Any) -> None:
            self._file = file

        def write(self, data: bytes) -> int:
            free = room - self._file.seek(0, os.SEEK_END)
            if free <= 0:
                raise OSError(28, "No space left on device")
            return int(self._file.write(data[:free]))

        def __getattr__(self, name: str) -> Any:
            return getattr(self._file, name)

    begin = outputs._Table.open

    def opened(table: Any) -> None:
        path = type(table.path)
        whole = path.open
        monkeypatch.setattr(path, "open", lambda self, *a, **k: Disk(whole(self, *a, **k)))
        try:
            begin(table)
        finally:
            monkeypatch.setattr(path, "open", whole)

    monkeypatch.setattr(outputs._Table, "open", opened)
    assert cli.main(["in.mkv", *ROI]) == 1
    said = capsys.readouterr()
    assert said.err == "hs-track: in.hs.csv: cannot be written (No space left on device)\n"
    data = (here / "in.hs.csv").read_bytes()
    assert len(data) <= room
    assert data == b"" or data.endswith(b"\r\n")
    rows = max(data.count(b"\n") - 1, 0)
    frames = _frames(here / "in.hs.webm") if (here / "in.hs.webm").exists() else 0
    assert frames == rows
    assert said.out.endswith("wrote in.hs.webm, in.hs.csv\n" if rows else "wrote nothing\n")


@needs_full
@pytest.mark.parametrize(("suffix", "room"), [("webm", 20_000), ("mkv", 150_000), ("avi", 150_000)])
def test_a_full_disk_is_noticed_when_it_happens(here: Path, suffix: str, room: int) -> None:
    """A limit on the size of files stands in for it: the run ends long before its video does, all rows are whole."""
    pytest.importorskip("resource")
    with VideoSink(Path("noise.mkv"), 5.0) as sink:
        rng = np.random.default_rng(0)
        for _ in range(120):
            sink.write(rng.integers(0, 256, (120, 160, 3), dtype=np.uint8))
    code = """
import resource, sys
from hs_tracker_cv import cli
room = int(sys.argv.pop())
resource.setrlimit(resource.RLIMIT_FSIZE, (room, room))
sys.exit(cli.main(sys.argv[1:]))
"""
    program = [sys.executable, "-c", code, "noise.mkv", *ROI, "--out", f"o.{suffix}", str(room)]
    done = subprocess.run(
        program, cwd=here, env=_environment(), capture_output=True, text=True, timeout=300, check=False
    )
    assert done.returncode == 1
    assert done.stderr == f"hs-track: o.{suffix}: cannot be written to its end (File too large)\n"
    assert done.stdout.endswith("; wrote noise.hs.csv\n")
    assert 0 < len(_rows(here / "noise.hs.csv")) < 100


def test_what_was_there_before_has_not_been_written(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Files of an earlier run are not named by one that fails before its first frame."""
    for name in ("in.hs.webm", "in.hs.panels.webm"):
        Path(name).write_bytes(b"of yesterday")
    Path("in.hs.csv").mkdir()
    assert cli.main(["in.mkv", *ROI, "--panels"]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err == "hs-track: in.hs.csv: cannot be written (Is a directory)\n"
    assert Path("in.hs.webm").read_bytes() == b"of yesterday"


def test_a_reader_that_ends_ends_the_run(here: Path, videos: Path) -> None:
    """`hs-track --json | head -3`: files are finished, nothing is said, the exit code is that of SIGPIPE."""
    shutil.copy(videos / "long.mkv", here)
    program = [sys.executable, "-m", "hs_tracker_cv", "long.mkv", *ROI, "--json"]
    with subprocess.Popen(program, env=_environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        first = json.loads(process.stdout.readline())
        process.stdout.close()
        said = process.stderr.read().decode()
    assert first["frame"] == 0
    assert process.returncode == 141
    assert said.startswith("hs-track: long: ")
    assert said.count("\n") == 1
    # The row is written before the line that nobody reads.
    assert len(_rows(here / "long.hs.csv")) == _frames(here / "long.hs.webm") + 1 < 2000


@needs_full
@pytest.mark.parametrize("options", [["--json"], []], ids=["lines", "summary"])
def test_a_full_standard_output_is_one_line(here: Path, options: list[str]) -> None:
    """Neither a traceback nor a word of Python's own."""
    with Path("/dev/full").open("wb") as full:
        done = _alone(here, "in.mkv", *ROI, *options, capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr
    assert "Exception" not in done.stderr
    assert all(line.startswith("hs-track: ") for line in done.stderr.splitlines())
