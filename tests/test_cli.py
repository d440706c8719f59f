"""`hs-track`: what is written, what is said, and how it ends."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import __version__, app, cli, following
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.video import VideoSink, open_source

Image = NDArray[np.uint8]
ROOT = Path(__file__).resolve().parents[1]


def _square(count: int = 10, still: int = 0) -> tuple[list[Image], list[Box]]:
    """A textured square that stands still for some frames and then moves 2 px per frame."""
    rng = np.random.default_rng(8)
    ground = cv2.GaussianBlur(rng.integers(0, 255, (120, 160, 3), dtype=np.uint8), (0, 0), 4.0)
    square = cv2.GaussianBlur(rng.integers(0, 255, (36, 36, 3), dtype=np.uint8), (0, 0), 1.2)
    frames, boxes = [], []
    for index in range(count):
        frame, x = ground.copy(), 40 + 2 * max(index - still, 0)
        frame[40:76, x : x + 36] = square
        frames.append(frame)
        boxes.append(Box(x, 40, 36, 36))
    return frames, boxes


def _write(path: Path, frames: list[Image]) -> Path:
    with VideoSink(path, 20.0) as sink:
        for frame in frames:
            sink.write(frame)
    return path


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def _box(row: dict[str, str]) -> Box:
    return Box(*(float(row[name]) for name in ("x", "y", "w", "h")))


def _alone(here: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """The command in a process of its own, with all that the libraries below it print."""
    command = [sys.executable, "-m", "hs_tracker_cv", *arguments]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("OPENCV_")}
    environment["PYTHONPATH"] = str(ROOT)
    return subprocess.run(command, cwd=here, env=environment, capture_output=True, text=True, timeout=300)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty working directory."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_a_file_with_roi_gives_boxes_and_a_video(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every frame has a row with a box on the object, and the overlay video has as many frames."""
    frames, boxes = _square()
    _write(here / "in.mkv", frames)
    assert cli.main(["in.mkv", "--roi", "40,40,36,36"]) == 0
    rows = _rows(here / "in.hs.csv")
    assert [int(row["frame"]) for row in rows] == list(range(10))
    assert all(row["ok"] == "1" and 0.0 <= float(row["score"]) <= 1.0 for row in rows)
    assert min(iou(_box(row), box) for row, box in zip(rows, boxes, strict=True)) > 0.7
    assert len(list(open_source(here / "in.hs.webm").frames)) == 10
    said = capsys.readouterr()
    assert said.out.startswith("in: 10 frames, object in 10, ")
    assert said.out.endswith("wrote in.hs.webm, in.hs.csv\n")
    assert said.out.count("\n") == 1


def test_without_roi_the_first_mover_is_followed(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rows before the object moves say ok=0 with a zero box; after it, the boxes are the object's."""
    frames, boxes = _square(12, still=4)
    folder = here / "walk" / "img"
    folder.mkdir(parents=True)
    for index, frame in enumerate(frames):
        cv2.imwrite(str(folder / f"{index}.png"), frame)
    assert cli.main([str(folder)]) == 0
    rows = _rows(here / "walk.hs.csv")
    assert len(rows) == 12
    found = [row["ok"] == "1" for row in rows]
    start = found.index(True)
    assert 5 <= start <= 9
    assert all(found[start:])
    assert all(_box(row) == Box(0, 0, 0, 0) for row in rows[:start])
    assert min(iou(_box(row), box) for row, box in zip(rows[start:], boxes[start:], strict=True)) > 0.6
    assert f"none yet in {start}" in capsys.readouterr().out


def test_options_name_the_outputs_and_limit_the_frames(here: Path) -> None:
    """--out, --csv and --max-frames are obeyed; an .mkv keeps the picture outside the drawing exactly."""
    frames, _ = _square()
    _write(here / "in.mkv", frames)
    assert cli.main(["in.mkv", "--roi", "40,40,36,36", "--out", "o.mkv", "--csv", "b.csv", "--max-frames", "4"]) == 0
    written = list(open_source(here / "o.mkv").frames)
    assert len(written) == len(_rows(here / "b.csv")) == 4
    np.testing.assert_array_equal(written[3][100:], frames[3][100:])
    assert not np.array_equal(written[3][30:90, 30:100], frames[3][30:90, 30:100])
    assert sorted(path.name for path in here.iterdir()) == ["b.csv", "in.mkv", "o.mkv"]


@pytest.mark.parametrize("flow", [[], ["--flow", "fast"], ["--flow", "tracker"]], ids="".join)
def test_panels_are_a_video_of_their_own(here: Path, flow: list[str]) -> None:
    """--panels writes one picture of all panels per frame beside the overlay video."""
    _write(here / "in.mkv", _square(4)[0])
    assert cli.main(["in.mkv", "--roi", "40,40,36,36", "--panels", *flow]) == 0
    panels = list(open_source(here / "in.hs.panels.webm").frames)
    assert len(panels) == 4
    assert panels[0].shape[1] > 1000
    assert panels[3].std() > 10


def test_the_flow_of_the_panels_is_the_one_asked_for(here: Path) -> None:
    """On a still scene every flow panel is white but for the wheel; more iterations carry a motion further."""
    frames, _ = _square(3)
    _write(here / "still.mkv", [frames[0]] * 3)
    _write(here / "in.mkv", frames)
    colours = {}
    for name, options in {
        "still": ["still.mkv"],
        "few": ["in.mkv", "--iterations", "2"],
        "many": ["in.mkv", "--iterations", "200", "--smoothness", "5"],
    }.items():
        command = [*options, "--roi", "40,40,36,36", "--panels", "--out", f"o-{name}.mkv"]
        assert cli.main(command) == 0
        *_, last = open_source(here / f"o-{name}.panels.mkv").frames
        # The sixth tile, the first one of the second row, without its title and its wheel.
        colours[name] = last[364:600, 14:300]
    assert colours["still"].min() == 255
    assert colours["many"].min() < 200
    assert not np.array_equal(colours["few"], colours["many"])


def test_start_and_step_keep_the_numbers_of_the_video(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rows and JSON lines say which frame of the video they are of; the box is drawn on the first that is taken."""
    frames, boxes = _square(12)
    _write(here / "in.mkv", frames)
    assert (
        cli.main(["in.mkv", "--roi", "46,40,36,36", "--start", "3", "--step", "2", "--max-frames", "4", "--json"])
        == 0
    )
    rows = _rows(here / "in.hs.csv")
    assert [int(row["frame"]) for row in rows] == [3, 5, 7, 9]
    said = capsys.readouterr()
    lines = [json.loads(line) for line in said.out.splitlines()]
    for row, line in zip(rows, lines, strict=True):
        assert list(line) == ["frame", "box", "ok", "score", "state"]
        assert line["frame"] == int(row["frame"])
        assert line["box"] == pytest.approx(list(_box(row)))
        assert line["ok"] is True
        assert line["score"] == float(row["score"])
        assert line["state"] == row["state"] == "tracking"
        assert iou(_box(row), boxes[line["frame"]]) > 0.7
    assert said.err.startswith("hs-track: in: 4 frames, object in 4, ")
    assert open_source(here / "in.hs.webm").fps == pytest.approx(10.0, abs=0.1)


def test_a_frame_without_a_box_is_null(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Searching: no box, ok false."""
    frames, _ = _square(2)
    _write(here / "in.mkv", [frames[0]] * 3)
    assert cli.main(["in.mkv", "--json"]) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {(line["box"], line["ok"], line["state"]) for line in lines} == {(None, False, "searching")}


def test_the_versions_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    """Ours, and those that results depend on."""
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out.startswith(
        f"hs-track {__version__} (OpenCV {cv2.__version__}, NumPy {np.__version__}"
    )


@pytest.mark.parametrize(
    ("roi", "warned"),
    [("100,60,150,110", True), ("-30,40,60,36", False), ("-31,40,60,36", True), ("0,0,160,120", False)],
)
def test_a_box_mostly_outside_is_warned_of(
    here: Path, capsys: pytest.CaptureFixture[str], roi: str, warned: bool
) -> None:
    """It is followed, but two corners were probably meant."""
    _write(here / "in.mkv", _square(2)[0])
    assert cli.main(["in.mkv", "--roi", roi]) == 0
    said = capsys.readouterr().err
    assert (f"hs-track: warning: --roi {roi} lies mostly outside the 160 × 120 frame" in said) == warned
    assert said.count("\n") == warned


@pytest.mark.parametrize(("units", "black"), [(4, 0), (16, 0), (4, 7300)], ids=["10 bits", "12 bits", "thermal"])
@pytest.mark.parametrize("suffix", ["png", "tif"])
def test_deep_images_are_followed(here: Path, suffix: str, units: int, black: int) -> None:
    """As well as the same frames in bytes, and the overlay shows them with their contrast."""
    (here / "set").mkdir()
    frames, boxes = _square(8)
    for index, frame in enumerate(frames):
        cv2.imwrite(f"set/{index}.{suffix}", frame.astype(np.uint16) * units + black)
    assert cli.main(["set", "--roi", "40,40,36,36", "--out", "o.mkv"]) == 0
    rows = _rows(here / "set.hs.csv")
    assert min(iou(_box(row), box) for row, box in zip(rows, boxes, strict=True)) > 0.8
    *_, last = open_source(here / "o.mkv").frames
    assert last[80:].std() > 0.6 * frames[-1][80:].std()


def test_float_and_signed_tiff_are_followed(here: Path) -> None:
    """32-bit floats of 0–1 and of degrees, and signed 16 bits."""
    frames, boxes = _square(6)
    kinds = {
        "unit": lambda frame: (frame / 255.0).astype(np.float32),
        "kelvin": lambda frame: (frame * 0.1 + 280.0).astype(np.float32),
        "signed": lambda frame: (frame * 4.0 - 500.0).astype(np.int16),
    }
    for name, convert in kinds.items():
        (here / name).mkdir()
        for index, frame in enumerate(frames):
            cv2.imwrite(f"{name}/{index}.tif", convert(frame.mean(axis=2)))
        assert cli.main([name, "--roi", "40,40,36,36"]) == 0
        rows = _rows(here / f"{name}.hs.csv")
        assert min(iou(_box(row), box) for row, box in zip(rows, boxes, strict=True)) > 0.7


def test_hidden_files_are_no_frames(here: Path) -> None:
    """What macOS puts beside every file it copies does not stop the run."""
    (here / "set").mkdir()
    for index, frame in enumerate(_square(3)[0]):
        cv2.imwrite(f"set/{index}.png", frame)
        Path(f"set/._{index}.png").write_bytes(b"\0\5\x16\7")
    assert cli.main(["set", "--roi", "40,40,36,36"]) == 0
    assert len(_rows(here / "set.hs.csv")) == 3


@pytest.mark.skipif(os.name == "nt", reason="Windows knows no such names")
def test_a_name_with_a_colon_names_the_outputs(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As phones and screen recorders make them: FFmpeg takes the hour for a protocol."""
    (here / "12:30:05.mkv").write_bytes(_write(here / "in.mkv", _square(3)[0]).read_bytes())
    assert cli.main(["12:30:05.mkv", "--roi", "40,40,36,36"]) == 0
    assert capsys.readouterr().out.endswith("wrote 12:30:05.hs.webm, 12:30:05.hs.csv\n")
    assert len(list(open_source("12:30:05.hs.webm").frames)) == 3


@pytest.mark.skipif(sys.platform in {"darwin", "win32"}, reason="all names are Unicode there")
def test_a_folder_whose_name_is_not_utf8_is_followed(here: Path) -> None:
    """Only a video cannot be written under that name; the process goes on to its end."""
    folder = Path(os.fsdecode(b"\xe9"))
    folder.mkdir()
    for index, frame in enumerate(_square(3)[0]):
        (folder / f"{index}.png").write_bytes(cv2.imencode(".png", frame)[1].tobytes())
    said = _alone(here, str(folder), "--roi", "40,40,36,36")
    assert said.returncode == 1
    assert r"\udce9.hs.webm: OpenCV takes names in UTF-8 only" in said.stderr
    said = _alone(here, str(folder), "--roi", "40,40,36,36", "--out", "o.webm")
    assert said.returncode == 0, said.stderr
    assert said.stdout.endswith("wrote o.webm, \\udce9.hs.csv\n")


def test_an_output_without_a_place_costs_no_earlier_one(here: Path) -> None:
    """The table of an earlier run stays when the next one cannot begin."""
    _write(here / "in.mkv", _square()[0])
    (here / "in.hs.csv").write_text("kept\n")
    assert cli.main(["in.mkv", "--roi", "40,40,36,36", "--out", "absent/o.webm"]) == 1
    assert (here / "in.hs.csv").read_text() == "kept\n"


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["absent.avi"], 1, "absent.avi: cannot be read (No such file or directory)"),
        (["text.avi"], 1, "text.avi: is not a video that OpenCV can open"),
        (["97"], 1, "camera 97: cannot be opened"),
        (["99999999999999999999"], 1, "camera 99999999999999999999: cannot be opened"),
        (["text.mp4"], 1, "text.mp4: is not a video that OpenCV can open"),
        (["zero.mp4"], 1, "zero.mp4: is an empty file"),
        (["in.mkv", "--csv", "."], 1, ".: cannot be written (Is a directory)"),
        (["in.mkv", "--roi", "1,2,3"], 2, "expected --roi x,y,w,h in px, got '1,2,3'"),
        (["in.mkv", "--roi", "a,b,c,d"], 2, "expected --roi x,y,w,h in px, got 'a,b,c,d'"),
        (["in.mkv", "--roi", "0,0,0,0"], 2, "expected a boundingBox of at least 4 × 4 px"),
        (["in.mkv", "--roi", "900,900,20,20"], 2, "inside the 160 × 120 frame"),
        (["in.mkv", "--roi", "nan,0,9,9"], 2, "expected a finite boundingBox"),
        (["in.mkv", "--roi", "1,2,30,30", "--select"], 2, "--roi and --select exclude each other"),
        (["in.mkv", "--max-frames", "0"], 2, "expected --max-frames of at least 1, got 0"),
        (["in.mkv", "--out", "in.mkv"], 2, "in.mkv: would overwrite the input"),
        (["in.mkv", "--out", "a.mkv", "--csv", "a.mkv"], 2, "a.mkv: is named for two outputs"),
        (["in.mkv", "--out", "a.mkv", "--csv", "../{here}/a.mkv"], 2, "a.mkv: is named for two outputs"),
        (["in.mkv", "--panels", "--csv", "in.hs.panels.webm"], 2, "in.hs.panels.webm: is named for two outputs"),
        (["in.mkv", "--csv", "link.csv"], 2, "link.csv: would overwrite the input"),
        (["set", "--csv", "set/0.png"], 2, f"set{os.sep}0.png: would overwrite the input"),
        (["set", "--csv", "set/0040.png"], 2, f"set{os.sep}0040.png: would be read as a frame of the input"),
        (["in.mkv", "--csv", "x.webm"], 2, "x.webm: is a table of boxes: expected a name as boxes.csv"),
        (["in.mkv", "--all", "--mot", "x.MP4"], 2, "x.MP4: is a table of boxes: expected a name as boxes.csv"),
        (["in.mkv", "--csv", "x.png"], 2, "x.png: is a table of boxes: expected a name as boxes.csv"),
        (["in.mkv", "--out", "x.csv"], 1, "x.csv: expected a name that ends in .webm, .mkv, .avi, got '.csv'"),
        (["app", "absent.mp4", "--no-show"], 1, "absent.mp4: cannot be read (No such file or directory)"),
        (["app", "text.mp4", "--no-show"], 1, "text.mp4: is not a video that OpenCV can open"),
        (["app", "none", "--no-show"], 1, "none: holds no image"),
        (["app", "--models", "none", "--no-show"], 1, "none: holds no TrackerNano for this OpenCV"),
        (["in.mkv", "--start", "-1"], 2, "expected --start of at least 0, got -1"),
        (["in.mkv", "--start", "3"], 1, "in.mkv: has 3 frames, none after frame 2"),
        (["in.mkv", "--step", "0"], 2, "expected --step of at least 1, got 0"),
        (["in.mkv", "--gain", "-1"], 2, "expected --gain above 0, got -1"),
        (["in.mkv", "--gain", "nan"], 2, "expected --gain above 0, got nan"),
        (["in.mkv", "--flow", "fast"], 2, "--flow, --smoothness and --iterations are for --panels"),
        (["in.mkv", "--iterations", "9"], 2, "--flow, --smoothness and --iterations are for --panels"),
        (["in.mkv", "--panels", "--flow", "farneback"], 2, "invalid choice 'farneback' for argument '--flow'"),
        (["in.mkv", "--panels", "--smoothness", "0"], 2, "expected a finite smoothness > 0, got 0"),
        (["in.mkv", "--panels", "--iterations", "0"], 2, "iterations"),
        (["in.mkv", "--panels", "--flow", "tracker", "--smoothness", "1"], 2, "no meaning with --flow tracker"),
        (["gopher://host/in.mkv"], 1, "gopher://host/in.mkv: expected a URL of http, https"),
        (["in.mkv", "--out", "o.mp4"], 1, "o.mp4: expected a name that ends in .webm, .mkv, .avi"),
        (["in.mkv", "--out", "absent/o.webm"], 1, "absent/o.webm: cannot be written (No such file or directory)"),
        (["in.mkv", "--frobnicate"], 2, "frobnicate"),
        ([], 2, "expected a VIDEO to follow, or app for the live page, which needs none"),
        (["in.mkv", "--max-frames", "many"], 2, "--max-frames"),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else None,
)
def test_a_fault_is_one_line_and_a_code(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], code: int, message: str
) -> None:
    """Wrong commands end with 2, failing input and output with 1, each with a single line on stderr."""
    _write(here / "in.mkv", _square(3)[0])
    for name in ("text.avi", "text.mp4"):
        (here / name).write_text("no video\n" * 20)
    (here / "none").mkdir()
    (here / "zero.mp4").touch()
    (here / "link.csv").symlink_to("in.mkv")
    (here / "set").mkdir()
    cv2.imwrite("set/0.png", _square(1)[0][0])
    assert cli.main([argument.format(here=here.name) for argument in arguments]) == code
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert lines[0].startswith("hs-track: ")
    assert message in lines[0]


@pytest.mark.parametrize("suffix", ["avi", "mkv"])
def test_a_truncated_video_keeps_the_boxes_so_far(suffix: str, here: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The frames that can be decoded are followed and written; then one line, whatever the codec has to say."""
    data = _write(here / f"whole.{suffix}", _square(30)[0]).read_bytes()
    (here / f"half.{suffix}").write_bytes(data[: len(data) // 2])
    said = _alone(here, f"half.{suffix}", "--roi", "40,40,36,36")
    assert said.returncode == 1
    rows = _rows(here / "half.hs.csv")
    assert 5 < len(rows) < 25
    assert all(row["ok"] == "1" for row in rows)
    assert len(list(open_source(here / "half.hs.webm").frames)) == len(rows)
    assert said.stderr.startswith(f"hs-track: half.{suffix}: ends after")
    assert said.stderr.count("\n") == 1
    assert "wrote half.hs.webm, half.hs.csv" in said.stdout


def _unusable(here: Path) -> dict[str, str]:
    """Sources of every kind that gives no frame: path and what must be said of it."""
    whole = _write(here / "whole.avi", _square(3)[0]).read_bytes()
    header = _write(here / "whole.mkv", _square(3)[0]).read_bytes()[:600]
    (here / "codec.avi").write_bytes(whole.replace(b"FFV1", b"QQ7Z"))
    (here / "header.mkv").write_bytes(header)
    (here / "empty.avi").touch()
    (here / "folder").mkdir()
    (here / "images").mkdir()
    (here / "images" / "0.png").write_bytes(b"no picture")
    (here / "circle.avi").symlink_to("circle.avi")
    os.mkfifo(here / "pipe.avi")
    return {
        "codec.avi": "codec.avi: ",
        "header.mkv": "header.mkv: ",
        "empty.avi": "empty.avi: is an empty file",
        "folder": "folder: holds no image",
        "images": f"images{os.sep}0.png: is not an image that OpenCV can decode",
        "circle.avi": "circle.avi: cannot be read (Too many levels of symbolic links)",
        "pipe.avi": "pipe.avi: is neither a file nor a folder (a camera is given by its number)",
    }


@pytest.mark.parametrize(
    "name", ["codec.avi", "header.mkv", "empty.avi", "folder", "images", "circle.avi", "pipe.avi"]
)
def test_a_source_without_a_frame_is_one_line(name: str, here: Path) -> None:
    """Unknown codec, no frames, no images, not readable: one line, exit code 1, and no files."""
    message = _unusable(here)[name]
    said = _alone(here, name, "--roi", "40,40,36,36")
    assert said.returncode == 1
    assert said.stderr.startswith(f"hs-track: {message}")
    assert said.stderr.count("\n") == 1
    assert said.stdout == ""
    assert not list(here.glob("*.hs.*"))


def test_a_source_that_may_not_be_read_is_one_line(
    here: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """The reason of the operating system is in the line."""
    _write(here / "in.mkv", _square(3)[0])

    def denied(self: Path, *arguments: Any, **options: Any) -> Any:
        raise PermissionError(13, "Permission denied", str(self))

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", denied)
        assert cli.main(["in.mkv", "--roi", "40,40,36,36"]) == 1
    assert capfd.readouterr().err == "hs-track: in.mkv: cannot be read (Permission denied)\n"


def test_a_broken_image_keeps_the_boxes_so_far(here: Path) -> None:
    """The image that cannot be decoded is named, the rows and frames before it stay."""
    (here / "set").mkdir()
    for index, frame in enumerate(_square(6)[0]):
        cv2.imwrite(str(here / "set" / f"{index}.png"), frame)
    data = (here / "set" / "3.png").read_bytes()
    (here / "set" / "3.png").write_bytes(data[:40])
    said = _alone(here, "set", "--roi", "40,40,36,36")
    assert said.returncode == 1
    assert len(_rows(here / "set.hs.csv")) == 3
    assert len(list(open_source(here / "set.hs.webm").frames)) == 3
    # The libpng of OpenCV 4.8 has a word of its own, whatever the log level.
    lines = [line for line in said.stderr.splitlines() if not line.startswith("libpng ")]
    assert lines == [f"hs-track: set{os.sep}3.png: is not an image that OpenCV can decode"]


def test_images_of_differing_sizes_keep_the_boxes_so_far(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The image that differs is named, the rows before it stay."""
    (here / "set").mkdir()
    frames, _ = _square(6)
    for index, frame in enumerate(frames):
        cv2.imwrite(str(here / "set" / f"{index}.png"), frame if index != 4 else frame[:100])
    assert cli.main(["set", "--roi", "40,40,36,36"]) == 1
    assert len(_rows(here / "set.hs.csv")) == 4
    assert f"set{os.sep}4.png: is 160 × 100 px" in capsys.readouterr().err


class _VanishingCamera:
    """A camera that gives five frames and is gone."""

    def __init__(self, number: int) -> None:
        self.frames = iter(_square(5)[0])

    def isOpened(self) -> bool:
        return True

    def read(self) -> tuple[bool, Any]:
        frame = next(self.frames, None)
        return frame is not None, frame

    def get(self, prop: int) -> float:
        return 30.0

    def release(self) -> None:
        pass


def test_a_vanished_camera_keeps_the_boxes_so_far(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """What the camera gave is followed and written; its loss is one line and exit code 1."""
    monkeypatch.setattr(cv2, "VideoCapture", _VanishingCamera)
    assert cli.main(["0", "--roi", "40,40,36,36"]) == 1
    assert len(_rows(here / "camera0.hs.csv")) == 5
    assert "camera 0: has stopped giving frames after 5" in capsys.readouterr().err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
def test_a_full_disk_is_one_line(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A CSV that cannot be written ends the run with exit code 1 and the reason."""
    _write(here / "in.mkv", _square(3)[0])
    assert cli.main(["in.mkv", "--roi", "40,40,36,36", "--csv", "/dev/full"]) == 1
    assert capsys.readouterr().err == "hs-track: /dev/full: cannot be written (No space left on device)\n"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full on this system")
@pytest.mark.parametrize("suffix", ["webm", "mkv", "avi"])
def test_a_full_disk_for_the_video_keeps_the_boxes(
    suffix: str, here: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The overlay video is lost, which is said in one line when it happens; the rows until then are whole."""
    _write(here / "in.mkv", _square(4)[0])
    (here / f"o.{suffix}").symlink_to("/dev/full")
    assert cli.main(["in.mkv", "--roi", "40,40,36,36", "--out", f"o.{suffix}"]) == 1
    said = capsys.readouterr()
    assert said.err == f"hs-track: o.{suffix}: cannot be written to its end (No space left on device)\n"
    assert said.out.endswith("; wrote in.hs.csv\n")
    assert len(_rows(here / "in.hs.csv")) == 1


class _LostTracker:
    """A tracker that has lost its object after the first frame."""

    initialised = False
    state = "tracking"
    box: Box | None = None

    def init(self, image: Any, box: Box) -> None:
        self.initialised, self.box = True, box

    def update(self, image: Any) -> tuple[bool, tuple[int, int, int, int]]:
        self.state = "lost"
        return False, (0, 0, 0, 0)

    def getTrackingScore(self) -> float:
        return 0.0


def test_a_lost_object_is_seen_and_counted(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Lost frames have a red border in the video, ok=0 and a zero box in the CSV, and are counted at the end."""
    monkeypatch.setattr(following, "TrackerHS", lambda parameters: _LostTracker())
    _write(here / "in.mkv", _square(3)[0])
    assert cli.main(["in.mkv", "--roi", "40,40,36,36", "--out", "o.mkv"]) == 0
    first, second, _ = open_source(here / "o.mkv").frames
    blue, green, red = second[0].astype(int).mean(axis=0)
    assert red > 200 > 100 > max(blue, green)
    assert first[0, :, 2].mean() < 200
    rows = _rows(here / "in.hs.csv")
    assert [row["ok"] for row in rows] == ["1", "0", "0"]
    assert _box(rows[1]) == Box(0, 0, 0, 0)
    assert "lost in 2" in capsys.readouterr().out


def test_select_follows_the_box_of_the_page(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """--select shows the first frame and starts in the box that comes back."""
    frames, boxes = _square(4)
    _write(here / "in.mkv", frames)
    shown = []

    def select_roi(frame: Image) -> Box:
        shown.append(frame)
        return Box(40, 40, 36, 36)

    monkeypatch.setattr(app, "select_roi", select_roi)
    assert cli.main(["in.mkv", "--select"]) == 0
    np.testing.assert_array_equal(shown[0], frames[0])
    assert iou(_box(_rows(here / "in.hs.csv")[3]), boxes[3]) > 0.7


def test_select_without_an_answer_or_the_extra_says_so(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """No selection ends with 2; no NiceGUI ends with 1 and says how to install it."""
    _write(here / "in.mkv", _square(2)[0])
    monkeypatch.setattr(app.importlib.util, "find_spec", lambda name: None)
    assert cli.main(["in.mkv", "--select"]) == 1
    assert capsys.readouterr().err == "hs-track: the page needs NiceGUI: pip install 'hs-tracker-cv[app]'\n"
    monkeypatch.setattr(app, "select_roi", lambda frame: None)
    assert cli.main(["in.mkv", "--select"]) == 2
    assert capsys.readouterr().err == "hs-track: no box was selected\n"


def test_module_run(tmp_path: Path) -> None:
    """`python -m hs_tracker_cv` is the command, and `--version` writes nothing into the working directory."""
    command = [sys.executable, "-m", "hs_tracker_cv", "--version"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True, timeout=300)
    assert done.stdout.startswith("hs-track ")
    assert done.stderr == ""
    assert list(tmp_path.iterdir()) == []


@pytest.mark.real
def test_the_car_on_a_real_road_is_followed(real: Path, here: Path) -> None:
    """From the annotated first box, the boxes of the CSV overlap the annotated car."""
    folder = real / "cdnet_highway_521"
    truth = np.loadtxt(folder / "groundtruth_rect.txt", delimiter=",")[:60]
    x, y, w, h = truth[0]
    assert cli.main([str(folder / "img"), "--roi", f"{x - 1},{y - 1},{w},{h}", "--max-frames", "60"]) == 0
    rows = _rows(here / "cdnet_highway_521.hs.csv")
    overlaps = [iou(_box(row), Box(x - 1, y - 1, w, h)) for row, (x, y, w, h) in zip(rows, truth, strict=True)]
    assert np.mean(overlaps) > 0.6


def test_all_that_move_have_rows_of_their_own(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With --all the table has an id, a row per object and none without one; the line at the end counts them."""
    frames, boxes = _square(14, still=2)
    _write(here / "in.mkv", frames)
    assert cli.main(["in.mkv", "--all", "--json"]) == 0
    rows = _rows(here / "in.hs.csv")
    assert {row["id"] for row in rows} == {"1"}
    assert min(iou(_box(row), boxes[int(row["frame"])]) for row in rows) > 0.6
    said = capsys.readouterr()
    assert ", 1 object," in said.err
    lines = [json.loads(line) for line in said.out.splitlines()]
    assert [line["frame"] for line in lines] == list(range(14))
    assert [each["id"] for each in lines[-1]["objects"]] == [1]


@pytest.mark.parametrize("other", [["--roi", "1,1,9,9"], ["--select"]])
def test_all_takes_no_box(here: Path, capsys: pytest.CaptureFixture[str], other: list[str]) -> None:
    """What cannot be meant is refused in one line."""
    assert cli.main(["in.mkv", "--all", *other]) == 2
    assert "--all follows whatever moves" in capsys.readouterr().err


def test_all_as_a_motchallenge_file(capsys: pytest.CaptureFixture[str], here: Path) -> None:
    """Located objects, frames and pixels counted from 1; the same boxes as the table's."""
    _write(here / "in.mkv", _square(30)[0])
    assert cli.main(["in.mkv", "--all", "--mot", "in.txt", "--start", "2"]) == 0
    assert "in.txt" in capsys.readouterr().out
    found = [line.split(",") for line in (here / "in.txt").read_text().splitlines()]
    table = [row for row in _rows(here / "in.hs.csv") if row["ok"] == "1"]
    assert len(found) == len(table) > 10
    for (frame, identity, left, top, *sides, score, x, y, z), row in zip(found, table, strict=True):
        assert (int(frame) - 1, identity, score) == (int(row["frame"]), row["id"], row["score"])
        assert (float(left) - 1, float(top) - 1) == pytest.approx((float(row["x"]), float(row["y"])), abs=1e-6)
        assert (*sides, x, y, z) == (row["w"], row["h"], "-1", "-1", "-1")
    assert cli.main(["in.mkv", "--mot", "in.txt"]) == 2
    assert "it needs --all" in capsys.readouterr().err
    assert cli.main(["in.mkv", "--all", "--mot", "in.mkv"]) == 2
    assert cli.main(["in.mkv", "--all", "--mot", "in.hs.csv"]) == 2


def test_what_takes_long_says_how_far_it_is(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where standard error is no terminal: a line after 10 s, 20 s and 40 s of a run of 45 s, none before."""
    frames, boxes = _square(10)
    _write(here / "in.mkv", frames)
    clock = iter(range(0, 500, 5))
    monkeypatch.setattr("hs_tracker_cv.cli.command.time.monotonic", lambda: float(next(clock)))
    assert cli.main(["in.mkv", "--roi", ",".join(f"{side:g}" for side in boxes[0])]) == 0
    lines = [line for line in capsys.readouterr().err.splitlines() if " after " in line]
    assert lines == [f"hs-track: in: {n} of 10 frames after {s} s" for n, s in ((2, 10), (4, 20), (8, 40))]
