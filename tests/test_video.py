"""Sources of frames and video out: what is read is what was written, and every fault is one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv.video import VideoError, VideoSink, VideoSource, image_files, natural_key, open_source, source_kind
from hs_tracker_cv.video.quiet import without_remark


def _pictures(count: int, height: int = 48, width: int = 64, seed: int = 0) -> list[NDArray[np.uint8]]:
    rng = np.random.default_rng(seed)
    return [rng.integers(0, 256, (height, width, 3), dtype=np.uint8) for _ in range(count)]


def _write_video(path: Path, frames: list[NDArray[np.uint8]], fps: float = 25.0) -> Path:
    with VideoSink(path, fps) as sink:
        for frame in frames:
            sink.write(frame)
    return path


def _read_into(frames: list[Any], source: VideoSource) -> None:
    for frame in source.frames:
        frames.append(frame)


def _one_line(error: pytest.ExceptionInfo[VideoError]) -> str:
    message = str(error.value)
    assert "\n" not in message
    return message


@pytest.mark.parametrize("suffix", [".mkv", ".avi"])
def test_lossless_formats_give_back_every_pixel(tmp_path: Path, suffix: str) -> None:
    """Frames written to .mkv and .avi come back bit for bit, with rate, count and size."""
    frames = _pictures(7)
    source = open_source(_write_video(tmp_path / f"clip{suffix}", frames, fps=12.0))
    assert (source.name, source.count, source.size) == ("clip", 7, (64, 48))
    assert source.fps == pytest.approx(12.0, abs=0.01)
    read = list(source.frames)
    assert len(read) == 7
    for got, wanted in zip(read, frames, strict=True):
        np.testing.assert_array_equal(got, wanted)


def test_webm_keeps_the_picture(tmp_path: Path) -> None:
    """A smooth picture survives VP8 within a few gray levels, on every frame."""
    ramp = np.linspace(30, 220, 96, dtype=np.float32)
    frame = np.repeat(np.tile(ramp, (64, 1)).astype(np.uint8)[:, :, None], 3, axis=2)
    read = list(open_source(_write_video(tmp_path / "a.webm", [frame] * 5)).frames)
    assert len(read) == 5
    assert max(np.abs(got.astype(int) - frame).mean() for got in read) < 6


def test_odd_sizes_are_padded_not_cut(tmp_path: Path) -> None:
    """A 63 × 47 frame becomes 64 × 48 by repeating the last row and column."""
    frame = _pictures(1, 47, 63)[0]
    got = open_source(_write_video(tmp_path / "odd.mkv", [frame, frame])).first
    assert got.shape == (48, 64, 3)
    np.testing.assert_array_equal(got[:47, :63], frame)


def test_a_folder_is_read_in_natural_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """10 follows 9; hidden files and what is no image file are ignored; `img` takes its parent's name."""
    folder = tmp_path / "walk" / "img"
    folder.mkdir(parents=True)
    for number, frame in enumerate(_pictures(11)):
        frame[:] = number
        cv2.imwrite(str(folder / f"f{number}.png"), frame)
    (folder / "notes.txt").write_text("no image")
    (folder / "._f1.png").write_bytes(b"\0\5\x16\7 resource fork of macOS")
    (folder / ".hidden.png").write_bytes(b"")
    (folder / "folder.png").mkdir()
    if hasattr(os, "mkfifo"):
        os.mkfifo(folder / "pipe.png")
    source = open_source(folder)
    assert (source.name, source.count) == ("walk", 11)
    assert [int(frame[0, 0, 0]) for frame in source.frames] == list(range(11))
    monkeypatch.chdir(tmp_path / "walk")
    assert open_source(Path("img")).name == "img"  # the folder round it was not named


def test_a_frame_that_cannot_be_reached_is_missing_and_not_skipped(tmp_path: Path) -> None:
    """A link that leads nowhere, as git-annex leaves them, is an error where it comes."""
    cv2.imwrite(str(tmp_path / "0.png"), _pictures(1)[0])
    (tmp_path / "1.png").symlink_to("nowhere.png")
    assert [path.name for path in image_files(tmp_path)] == ["0.png", "1.png"]
    with pytest.raises(VideoError, match=r"1\.png: cannot be read \(No such file"):
        _read_into([], open_source(tmp_path))


def test_natural_key_orders_numbers_by_value() -> None:
    """Numbers inside names compare as numbers, the rest as lower-case text."""
    names = ["b1.png", "a10.png", "A9.png", "a.png", "7.png", "07.png", "a²3.png"]
    wanted = ["07.png", "7.png", "A9.png", "a10.png", "a.png", "a²3.png", "b1.png"]
    for order in (names, names[::-1]):
        assert [path.name for path in sorted(map(Path, order), key=natural_key)] == wanted


def test_a_truncated_file_gives_its_frames_then_one_error(tmp_path: Path) -> None:
    """Half of a file yields the frames it holds and ends in an error that says how many, and what is missing."""
    data = _write_video(tmp_path / "whole.avi", _pictures(40)).read_bytes()
    path = tmp_path / "half.avi"
    path.write_bytes(data[: len(data) // 2])
    read: list[Any] = []
    with pytest.raises(
        VideoError, match=r"half\.avi: ends after \d+ frames \(the file is cut off: \d+ bytes"
    ) as error:
        _read_into(read, open_source(path))
    assert 5 < len(read) < 35
    _one_line(error)


def test_missing_empty_and_foreign_files_are_refused(tmp_path: Path) -> None:
    """A path that is absent, empty, text, or a folder without images each gets its own message."""
    (tmp_path / "empty.avi").touch()
    (tmp_path / "text.avi").write_text("not a video\n" * 50)
    (tmp_path / "folder").mkdir()
    cases = {
        "absent.avi": "cannot be read",
        "empty.avi": "is an empty file",
        "text.avi": "is not a video that OpenCV can open",
        "folder": "holds no image",
    }
    for name, message in cases.items():
        with pytest.raises(VideoError, match=message) as error:
            open_source(tmp_path / name)
        assert name in _one_line(error)


@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".mkv", ".avi"])
def test_text_noise_and_nothing_under_the_name_of_a_video_are_refused(tmp_path: Path, suffix: str) -> None:
    """The content decides, whatever the name says: each fault in one line."""
    contents = {"text": b"not a video\n" * 50, "noise": np.random.default_rng(0).bytes(50_000), "nothing": b""}
    for name, content in contents.items():
        path = tmp_path / f"{name}{suffix}"
        path.write_bytes(content)
        with pytest.raises(VideoError, match=r"is an empty file|is not a video|no frame can be decoded") as error:
            open_source(path)
        assert path.name in _one_line(error)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes on this system")
@pytest.mark.parametrize("name", ["pipe.avi", "7"])
def test_a_pipe_is_refused_and_not_waited_for(tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody writes into it, and opening it would wait for ever; its name may look like a camera's number."""
    monkeypatch.chdir(tmp_path)
    os.mkfifo(name)
    with pytest.raises(VideoError, match=f"{name}: is neither a file nor a folder"):
        open_source(name)


@pytest.mark.parametrize("suffix", [".webm", ".mkv", ".avi"])
def test_a_video_that_does_not_fit_on_the_disk_is_an_error(tmp_path: Path, suffix: str) -> None:
    """The encoder is silent about it: a limit on the size of files stands in for the full disk, in a process."""
    code = f"""
import resource, sys
from pathlib import Path
import numpy as np
from hs_tracker_cv.video import VideoError, VideoSink
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
rng = np.random.default_rng(0)
try:
    with VideoSink(Path("out{suffix}"), 25.0) as sink:
        for _ in range(int(sys.argv[1])):
            sink.write(rng.integers(0, 256, (48, 64, 3), dtype=np.uint8))
except VideoError as error:
    print(error)
"""
    pytest.importorskip("resource")
    for count, said in ((1, ""), (80, f"out{suffix}: cannot be written to its end (File too large)\n")):
        command = [sys.executable, "-c", code, str(count)]
        environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[1])}
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120)
        assert (done.returncode, done.stdout) == (0, said), done.stderr


def test_the_probe_of_the_disk_leaves_no_trace(tmp_path: Path) -> None:
    """What is on the disk is what the encoder wrote, and plays."""
    path = _write_video(tmp_path / "a.mkv", _pictures(3))
    assert not path.read_bytes().endswith(bytes(16))
    assert len(list(open_source(path).frames)) == 3


def test_a_container_without_frames_is_refused(tmp_path: Path) -> None:
    """A header without frames after it is refused when opened."""
    data = _write_video(tmp_path / "whole.mkv", _pictures(3)).read_bytes()
    path = tmp_path / "header.mkv"
    path.write_bytes(data[:600])
    with pytest.raises(VideoError, match=r"header\.mkv: (no frame can be decoded|is not a video)") as error:
        open_source(path)
    _one_line(error)


def test_an_unknown_codec_is_named(tmp_path: Path) -> None:
    """A stream whose codec nobody knows is refused."""
    data = _write_video(tmp_path / "whole.avi", _pictures(3)).read_bytes()
    path = tmp_path / "odd.avi"
    path.write_bytes(data.replace(b"FFV1", b"QQ7Z"))
    with pytest.raises(VideoError, match=r"odd\.avi: (no frame can be decoded|is not a video)") as error:
        open_source(path)
    _one_line(error)


def test_images_of_differing_sizes_end_the_source_at_the_odd_one(tmp_path: Path) -> None:
    """The frames before the odd one are given, then the error names the file and both sizes."""
    for number, frame in enumerate([*_pictures(2), *_pictures(1, 50, 64)]):
        cv2.imwrite(str(tmp_path / f"{number}.png"), frame)
    read: list[Any] = []
    with pytest.raises(VideoError, match=r"2\.png: is 64 × 50 px, but the first frame is 64 × 48 px"):
        _read_into(read, open_source(tmp_path))
    assert len(read) == 2


def test_a_broken_image_is_named(tmp_path: Path) -> None:
    """An image file of garbage is an error where it comes, not a skipped frame."""
    cv2.imwrite(str(tmp_path / "0.png"), _pictures(1)[0])
    (tmp_path / "1.png").write_bytes(b"garbage")
    (tmp_path / "2.png").touch()
    with pytest.raises(VideoError, match=r"1\.png: is not an image"):
        _read_into([], open_source(tmp_path))
    (tmp_path / "1.png").unlink()
    with pytest.raises(VideoError, match=r"2\.png: is not an image"):
        _read_into([], open_source(tmp_path))


class _FakeCamera:
    """A camera that gives `frames` pictures and then none."""

    frames = 3
    opened = True

    def __init__(self, number: int) -> None:
        self.left = self.frames
        self.released = False

    def isOpened(self) -> bool:
        return self.opened

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        self.left -= 1
        return (True, _pictures(1)[0]) if self.left >= 0 else (False, None)

    def get(self, prop: int) -> float:
        return 0.0

    def release(self) -> None:
        self.released = True


@pytest.mark.parametrize(
    ("name", "kind"),
    [
        ("rtsp://camera/door", "stream"),
        ("http://host/clip.mp4", "stream"),
        ("0", "camera"),
        (3, "camera"),
        ("/dev/video7", "file"),  # there is none here
        ("none.mp4", "file"),
        (".", "folder"),
        ("", "file"),
    ],
)
def test_one_place_tells_what_a_name_means(name: str | int, kind: str) -> None:
    """The command, the page and the library ask it."""
    assert source_kind(name) == kind


def test_a_file_with_a_camera_s_number_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever has such a file can name it."""
    monkeypatch.chdir(tmp_path)
    Path("0").touch()
    assert source_kind("0") == "file"
    assert source_kind(0) == "camera"


def test_a_vanished_camera_is_an_error_after_its_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera that stops gives its frames, then an error; its frame rate of 0 is replaced."""
    monkeypatch.setattr(cv2, "VideoCapture", _FakeCamera)
    read: list[Any] = []
    source = open_source("3")
    assert (source.name, source.count, source.fps) == ("camera3", None, 25.0)
    with pytest.raises(VideoError, match="camera 3: has stopped giving frames after 3"):
        _read_into(read, source)
    assert len(read) == 3


def test_an_absent_camera_is_refused() -> None:
    """A camera number that no device has is refused when opened."""
    for number in (97, 2**31 - 1, 2**31, 10**20):
        with pytest.raises(VideoError, match=f"camera {number}: cannot be opened"):
            open_source(number)


def test_a_silent_camera_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera that opens and gives nothing is refused when opened."""
    monkeypatch.setattr(_FakeCamera, "frames", 0)
    monkeypatch.setattr(cv2, "VideoCapture", _FakeCamera)
    with pytest.raises(VideoError, match="camera 0: gives no frame"):
        open_source(0)


def test_the_encoder_stays_silent(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """Writing and reading leaves nothing on stderr, and what others write there meanwhile stays."""
    list(open_source(_write_video(tmp_path / "a.webm", _pictures(2))).frames)
    with without_remark(b"noise"):
        os.write(2, b"one\nnoise, and more\ntwo")
    assert capfd.readouterr().err == "one\ntwo"


def test_a_sink_refuses_what_it_cannot_write(tmp_path: Path) -> None:
    """An ending without codec, a folder that is absent and a frame of another size are errors."""
    with pytest.raises(VideoError, match=r"ends in \.webm, \.mkv, \.avi, got '\.mp4'"):
        VideoSink(tmp_path / "a.mp4", 25.0)
    with pytest.raises(VideoError, match="cannot be written"):
        VideoSink(tmp_path / "absent" / "a.webm", 25.0).write(_pictures(1)[0])
    with VideoSink(tmp_path / "a.webm", 25.0) as sink:
        sink.write(_pictures(1)[0])
        with pytest.raises(VideoError, match=r"expected a frame of shape \(48, 64, 3\)"):
            sink.write(_pictures(1, 50)[0])


def test_a_sink_without_frames_leaves_no_file(tmp_path: Path) -> None:
    """Nothing is created until the first frame comes."""
    with VideoSink(tmp_path / "a.webm", 25.0):
        pass
    assert not (tmp_path / "a.webm").exists()
