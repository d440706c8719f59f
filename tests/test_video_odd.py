"""Videos that people have: variable rate, interlaced, rotated, cut off, odd names, streams. No frame is made up."""

from __future__ import annotations

import http.server
import os
import socket
import struct
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from hs_tracker_cv.video import VideoError, VideoSink, VideoSource, open_source
from hs_tracker_cv.video.container import announced_bytes
from tests.odd_files import DROPPED, Image, decode, encode, ffmpeg, moving_square

ROOT = Path(__file__).resolve().parents[1]

CODECS = {
    "mkv": ("libx264", "yuv420p"),
    "webm": ("libvpx", "yuv420p"),
    "ts": ("libx264", "yuv420p"),
    "mp4": ("libx264", "yuv420p"),
    "mov": ("mjpeg", "yuvj420p"),
    "avi": ("mjpeg", "yuvj420p"),
    "flv": ("flv1", "yuv420p"),
    "mpg": ("mpeg2video", "yuv420p"),
}


def _encode(path: Path, *options: str, count: int = 40) -> Path:
    codec, pixels = CODECS[path.suffix[1:]]
    return encode(path, moving_square(count)[0], *options, "-c:v", codec, "-pix_fmt", pixels, "-g", "10")


def _read(path: Path | str, **options: Any) -> list[Image]:
    with open_source(path, **options) as source:
        return list(source.frames)


def _read_into(frames: list[Image], source: VideoSource) -> None:
    for frame in source.frames:
        frames.append(frame)


@pytest.mark.parametrize("suffix", [suffix for suffix in CODECS if suffix != "mpg"])
def test_a_variable_frame_rate_is_no_damage(tmp_path: Path, suffix: str) -> None:
    """All 26 frames of what announces 40 come, without an error and without a remark."""
    path = _encode(tmp_path / f"vfr.{suffix}", "-vf", DROPPED, "-fps_mode", "vfr")
    with open_source(path) as source:
        assert sum(1 for _ in source.frames) == 26
        assert source.remarks == []


@pytest.mark.parametrize("text", ["17\n" * 300, "x,y,w,h\n" + "1,2,3,4\n" * 200])
def test_a_text_is_no_video(tmp_path: Path, text: str) -> None:
    """FFmpeg makes pictures of letters of what is called .txt: one line says so, and nothing is followed in them."""
    path = tmp_path / "boxes.txt"
    path.write_text(text)
    with pytest.raises(VideoError, match=r"boxes\.txt: is a text, which FFmpeg would show letter by letter"):
        open_source(path)


INTERLACED = {
    "mpeg2.ts": ["-vf", "interlace", "-c:v", "mpeg2video", "-flags", "+ildct+ilme"],
    "mpeg2.mpg": ["-vf", "interlace", "-c:v", "mpeg2video", "-flags", "+ildct+ilme"],
    "h264.ts": ["-vf", "interlace", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-x264opts", "interlaced=1:tff=1"],
    "h264.mp4": ["-vf", "interlace", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-x264opts", "interlaced=1:tff=1"],
    "dv.avi": ["-vf", "scale=720:576", "-c:v", "dvvideo", "-pix_fmt", "yuv420p"],
    "lossless.mkv": ["-vf", "interlace,setfield=tff", "-c:v", "ffv1", "-field_order", "tt"],
}


@pytest.mark.parametrize("name", INTERLACED)
def test_an_interlaced_video_is_shown_or_refused(tmp_path: Path, name: str) -> None:
    """An OpenCV that cannot convert it hands out memory as it was: then one line says so, before a frame is used."""
    path = encode(tmp_path / name, moving_square()[0], *INTERLACED[name])
    capture = cv2.VideoCapture(str(path))
    if np.array_equal(capture.read()[1], capture.read()[1]):
        capture.release()
        with pytest.raises(VideoError, match=rf"{name}: is interlaced, which this OpenCV \({cv2.__version__}\)"):
            open_source(path)
        return
    with open_source(path) as source:
        width, height = source.size
        true = decode(path, width, height)
        got = list(source.frames)
        assert len(got) == len(true)
        assert np.abs(got[5].astype(int) - true[5]).mean() < 12.0


@pytest.mark.parametrize("before", [["still", "moving"], ["moving"] * 7, ["moving"] * 3 + ["still", "moving"]])
def test_a_video_that_becomes_interlaced_is_shown_or_refused(tmp_path: Path, before: list[str]) -> None:
    """A broadcast changes midway: after hundreds of frames, or after a stretch that really stood still."""
    frames = moving_square(40)[0]
    parts = {"still": frames[:1] * 40, "moving": frames}
    for name, shown in parts.items():
        encode(tmp_path / f"{name}.ts", shown, "-c:v", "libx264", "-pix_fmt", "yuv420p")
    encode(tmp_path / "fields.ts", frames, *INTERLACED["h264.ts"])
    path = tmp_path / "broadcast.ts"
    path.write_bytes(b"".join((tmp_path / f"{name}.ts").read_bytes() for name in [*before, "fields"]))
    capture = cv2.VideoCapture(str(tmp_path / "fields.ts"))
    read: list[Image] = []
    if np.array_equal(capture.read()[1], capture.read()[1]):
        with pytest.raises(VideoError, match=r"broadcast\.ts: is interlaced"), open_source(path) as source:
            _read_into(read, source)
    else:
        with open_source(path) as source:
            _read_into(read, source)
    assert len(read) >= 40 * len(before)


def test_a_still_beginning_is_no_interlacing(tmp_path: Path) -> None:
    """A lossless video that begins with the same frame twice, or is black at first, is read."""
    frames, _ = moving_square(4)
    black = np.zeros_like(frames[0])
    path = encode(tmp_path / "still.mkv", [black, black, frames[0], frames[0], *frames], "-c:v", "ffv1")
    assert len(_read(path)) == 8


@pytest.mark.parametrize("suffix", ["mp4", "mov", "mkv"])
@pytest.mark.parametrize("degrees", [90, 180, 270])
def test_the_rotation_of_phone_videos_is_honoured(tmp_path: Path, degrees: int, suffix: str) -> None:
    """Frames stand as ffmpeg and every player show them; the size is that of the turned picture."""
    plain = _encode(tmp_path / "plain.mp4", count=4)
    path = tmp_path / f"turned.{suffix}"
    ffmpeg("-display_rotation:v:0", str(degrees), "-i", plain, "-c", "copy", path)
    width, height = (160, 120) if degrees == 180 else (120, 160)
    with open_source(path) as source:
        assert source.size == (width, height)
        got = list(source.frames)
    for mine, true in zip(got, decode(path, width, height), strict=True):
        assert np.abs(mine.astype(int) - true).mean() < 4.0


@pytest.mark.parametrize("suffix", ["avi", "mov", "mkv", "webm"])
def test_a_file_that_is_cut_off_says_how_much_is_missing(tmp_path: Path, suffix: str) -> None:
    """The frames that are there come first; the whole file has no such end."""
    extra = ["-movflags", "+faststart"] if suffix == "mov" else []
    whole = _encode(tmp_path / f"whole.{suffix}", *extra)
    assert len(_read(whole)) == 40
    data = whole.read_bytes()
    assert announced_bytes(whole) == len(data)
    kept = len(data) * 2 // 3
    path = tmp_path / f"half.{suffix}"
    path.write_bytes(data[:kept])
    read: list[Image] = []
    with (
        open_source(path) as source,
        pytest.raises(VideoError, match=rf"cut off: {len(data) - kept} bytes are missing") as error,
    ):
        _read_into(read, source)
    assert f"ends after {len(read)} frames" in str(error.value)
    assert 5 < len(read) < 40


@pytest.mark.parametrize("suffix", ["mkv", "webm", "avi"])
def test_a_tail_of_zeros_is_remarked_on(tmp_path: Path, suffix: str) -> None:
    """As interrupted downloads leave it: nothing is missing by its length, and the decoder says nothing."""
    whole = _encode(tmp_path / f"whole.{suffix}", count=60)
    data = whole.read_bytes()
    path = tmp_path / f"holed.{suffix}"
    path.write_bytes(data[: len(data) // 3] + bytes(len(data) - len(data) // 3))
    with open_source(path) as source:
        assert 0 < sum(1 for _ in source.frames) < 40
        [remark] = source.remarks
    assert f"holed.{suffix}: no frame after " in remark
    assert "of 2.4 s (damaged, or its last picture is held)" in remark


@pytest.mark.parametrize(
    ("head", "length"),
    [
        (b"", None),
        (b"RIFF", None),
        (b"RIFF\0\0\0\0AVI ", None),
        (b"RIFF\xff\xff\xff\xffAVI ", None),
        (b"RIFF\x04\0\0\0AVI RIFF\x10\0\0\0AVIX", 12 + 24),
        (b"\0\0\0\x08ftyp\0\0\0\0mdat", None),
        (b"\0\0\0\x08ftyp\0\0\0\x01mdat\0\0\0\0\0\0\x10\0", 8 + 4096),
        (b"\0\0\0\x08ftyp\0\0\0\x20moov" + bytes(24), 40),
        (b"\x1a\x45\xdf\xa3", None),
        (b"\x1a\x45\xdf\xa3\x80\x18\x53\x80\x67\x01\xff\xff\xff\xff\xff\xff\xff", None),
        (b"\x1a\x45\xdf\xa3\x80\x18\x53\x80\x67\x41\x00", 5 + 4 + 2 + 256),
        (b"\x1a\x45\xdf\xa3\x00\x00\x00\x00\x00\x00\x00\x00\x00", None),
        (b"\x47" * 376, None),
    ],
)
def test_what_a_container_says_of_its_length(tmp_path: Path, head: bytes, length: int | None) -> None:
    """Nested elements give their end; live recordings, MPEG streams and garbage give none."""
    path = tmp_path / "file"
    path.write_bytes(head)
    assert announced_bytes(path) == length


HEADS = [b"RIFF", b"\x1a\x45\xdf\xa3", b"\0\0\0\x01mdat", b"\0\0\0\x08ftyp", b"\0\0\0\0moov", b""]


@given(st.lists(st.sampled_from(HEADS) | st.binary(max_size=20), max_size=6).map(b"".join))
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_garbage_has_some_length_or_none(tmp_path: Path, data: bytes) -> None:
    """Whatever follows a known head: an answer, no error and no endless search."""
    path = tmp_path / "garbage"
    path.write_bytes(data)
    length = announced_bytes(path)
    assert length is None or length >= 4


NAMES = ["12:30:05.mkv", "a:b.mkv", "file:x.mkv", "pipe:1.mkv", "shot%03d.mkv", "it's #1?.mkv", "日本.mkv", "-x.mkv"]


@pytest.mark.skipif(os.name == "nt", reason="Windows knows no such names")
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("folder", ["", "10:00"])
def test_any_name_is_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, folder: str) -> None:
    """Written and read under that very name, relative or absolute; FFmpeg takes some of them for protocols."""
    monkeypatch.chdir(tmp_path)
    frames, _ = moving_square(3)
    where = Path(folder) / name
    where.parent.mkdir(exist_ok=True)
    with VideoSink(where, 25.0) as sink:
        for frame in frames:
            sink.write(frame)
    assert [path.name for path in (tmp_path / folder).iterdir()] == [name]
    for path in (where, tmp_path / where):
        assert len(_read(path)) == 3


@pytest.mark.skipif(sys.platform in {"darwin", "win32"}, reason="all names are Unicode there")
def test_a_name_that_is_not_utf8_is_refused_and_not_fatal(tmp_path: Path) -> None:
    """cv2 would end the process (SIGSEGV): one line, in letters that can be printed."""
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xe9.mkv"))
    path.write_bytes(b"x" * 100)
    for call in (lambda: open_source(path), lambda: VideoSink(path, 25.0)):
        with pytest.raises(VideoError, match=r"\\udce9\.mkv: OpenCV takes names in UTF-8 only") as error:
            call()
        str(error.value).encode("utf-8")


def test_a_photograph_that_was_turned_is_upright(tmp_path: Path) -> None:
    """The orientation that cameras write into JPEG files is honoured in folders."""
    frame = moving_square(1)[0][0]
    data = cv2.imencode(".jpg", frame)[1].tobytes()
    entry = struct.pack("<HHHIHH", 1, 0x112, 3, 1, 6, 0)  # one field, the orientation: turned by 90° to the right
    exif = b"Exif\0\0II*\0" + struct.pack("<I", 8) + entry + bytes(4)
    marked = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    (tmp_path / "0.jpg").write_bytes(marked)
    (upright,) = _read(tmp_path)
    assert np.abs(upright.astype(int) - cv2.rotate(frame, cv2.ROTATE_90_CLOCKWISE)).mean() < 8.0


def test_a_name_with_a_zero_byte_is_refused() -> None:
    """No operating system has such a file."""
    with pytest.raises(VideoError, match=r"cannot be read \(embedded null"):
        open_source("a\0b.avi")


def test_start_and_step_choose_frames(tmp_path: Path) -> None:
    """Files and folders alike: frames start, start + step and so on, their numbers, rate and count."""
    frames, _ = moving_square(11)
    path = encode(tmp_path / "a.mkv", frames, "-c:v", "ffv1")
    (tmp_path / "set").mkdir()
    for index, frame in enumerate(frames):
        cv2.imwrite(str(tmp_path / "set" / f"{index}.png"), frame)
    for where in (path, tmp_path / "set"):
        with open_source(where, start=3, step=4) as source:
            assert (source.start, source.step, source.count, source.fps) == (3, 4, 2, 25.0 / 4)
            got = list(source.frames)
        np.testing.assert_array_equal(got, [frames[3], frames[7]])
        np.testing.assert_array_equal(source.first, frames[3])
        assert len(_read(where, start=10)) == 1
        for start in (11, 500):
            with pytest.raises(VideoError, match=f"has 11 frames, none after frame {start - 1}"):
                open_source(where, start=start)
    for wrong in ({"start": -1}, {"step": 0}, {"gain": 0.0}, {"gain": float("nan")}):
        with pytest.raises(ValueError, match="expected start >= 0, step >= 1 and gain > 0"):
            open_source(path, **wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("bits", [10, 12, 16])
def test_deep_video_keeps_its_contrast(tmp_path: Path, bits: int) -> None:
    """FFV1 of thermal counts in 16 bits, and 10 and 12 bits: as contrasted as the picture, not the upper 8 bits."""
    frames, _ = moving_square(3)
    gray = [frame.mean(axis=2) for frame in frames]
    black, units = (7300, 4) if bits == 16 else (0, 2 ** (bits - 8))
    deep = [(frame * units + black).astype("<u2") for frame in gray]
    pixels = "gray16le" if bits == 16 else f"gray{bits}le"
    shape = ["-f", "rawvideo", "-pix_fmt", pixels, "-s", "160x120", "-r", "25", "-i", "-"]
    path = tmp_path / "deep.mkv"
    ffmpeg(*shape, "-c:v", "ffv1", path, data=b"".join(frame.tobytes() for frame in deep))
    got = _read(path)
    assert len(got) == 3
    for mine, true in zip(got, gray, strict=True):
        assert mine.dtype == np.uint8
        assert mine.shape == (120, 160, 3)
        assert np.corrcoef(mine[:, :, 0].ravel(), true.ravel())[0, 1] > 0.99
        assert mine.std() > 0.6 * true.std()
    wide = _read(path, gain=0.4)
    if bits == 16:
        assert wide[0].std() == pytest.approx(0.4 * 4 * gray[0].std(), rel=0.05)


@pytest.mark.parametrize("repeat", [1, 3])
def test_a_source_gives_its_file_back(tmp_path: Path, repeat: int) -> None:
    """Closed before, while and after its frames are read."""
    path = encode(tmp_path / "a.mkv", moving_square(5)[0], "-c:v", "ffv1")
    kept = []
    for _ in range(repeat):
        untouched, begun, ended = (open_source(path) for _ in range(3))
        next(begun.frames)
        list(ended.frames)
        for source in (untouched, begun, ended):
            source.close()
            source.close()
        kept += [untouched, begun, ended]
    if Path("/proc/self/fd").is_dir():
        names = [os.readlink(entry) for entry in Path("/proc/self/fd").iterdir() if entry.is_symlink()]
        assert str(path) not in names


def _isolated(code: str, *arguments: str | Path, **environment: str) -> subprocess.CompletedProcess[str]:
    clean = {name: value for name, value in os.environ.items() if not name.startswith("OPENCV_")}
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, arguments)],
        cwd=ROOT,
        env={**clean, **environment},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


def test_standard_error_survives_threads(tmp_path: Path) -> None:
    """Eight threads open and write videos while others print: every line comes through, and standard error stays."""
    encode(tmp_path / "a.mkv", moving_square(3)[0], "-c:v", "ffv1")
    (tmp_path / "bad.avi").write_text("no video\n" * 50)
    code = """
import os, sys, threading
from pathlib import Path
import numpy as np
from hs_tracker_cv.video import VideoError, VideoSink, open_source, silence_decoders
silence_decoders()
folder, frame = Path(sys.argv[1]), np.zeros((48, 64, 3), np.uint8)
def work(number):
    for turn in range(12):
        with open_source(folder / "a.mkv") as source:
            list(source.frames)
        try:
            open_source(folder / "bad.avi")
        except VideoError:
            pass
        with VideoSink(folder / f"{number}-{turn}.webm", 25.0) as sink:
            sink.write(frame)
        os.write(2, f"line {number} {turn}\\n".encode())
threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
os.write(2, b"end\\n")
"""
    done = _isolated(code, tmp_path)
    assert done.returncode == 0, done.stderr
    lines = done.stderr.splitlines()
    assert lines[-1] == "end"
    assert sorted(lines[:-1]) == sorted(f"line {number} {turn}" for number in range(8) for turn in range(12))


def test_the_users_own_log_level_is_obeyed(tmp_path: Path) -> None:
    """Opening in a library changes nothing of what OpenCV prints; a program may silence it, unless asked for."""
    (tmp_path / "bad.avi").write_text("no video\n" * 50)
    code = """
import sys
from hs_tracker_cv.video import VideoError, open_source, silence_decoders
if sys.argv[2] == "program":
    silence_decoders()
try:
    open_source(sys.argv[1])
except VideoError:
    pass
"""
    path = tmp_path / "bad.avi"
    assert _isolated(code, path, "program").stderr == ""
    assert _isolated(code, path, "library", OPENCV_LOG_LEVEL="SILENT", OPENCV_FFMPEG_LOGLEVEL="-8").stderr == ""
    told = _isolated(code, path, "program", OPENCV_LOG_LEVEL="DEBUG", OPENCV_FFMPEG_LOGLEVEL="40")
    assert "FFMPEG" in told.stdout + told.stderr


# --- streams -----------------------------------------------------------------------------------------------


class _Files(http.server.BaseHTTPRequestHandler):
    """Serves the file `served` at any path, and at /live a sequence of JPEGs that breaks off."""

    served = b""
    pictures: tuple[bytes, ...] = ()

    def do_GET(self) -> None:
        if self.path.startswith("/live"):
            self._live()
            return
        if not self.path.startswith("/clip"):
            self.send_error(404)
            return
        self.send_response(200)
        self.send_header("Content-Type", "video/mp4")
        self.send_header("Content-Length", str(len(self.served)))
        self.end_headers()
        self.wfile.write(self.served)

    def _live(self) -> None:
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        for data in self.pictures:
            self.wfile.write(b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(data))
            self.wfile.write(data + b"\r\n")

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002 - http.server's name
        pass


@pytest.fixture
def web() -> Iterator[str]:
    """A server on this machine; gives its address."""
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), _Files)
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    thread.join()
    server.server_close()


def test_a_video_behind_a_url_is_read(tmp_path: Path, web: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """HTTP: all frames; the name comes from the path, and neither password nor token is repeated."""
    monkeypatch.setattr(_Files, "served", _encode(tmp_path / "a.mp4", "-movflags", "+faststart").read_bytes())
    with open_source(f"http://{web}/clip%20one.mp4?token=secret", start=2) as source:
        assert (source.name, source.count) == ("clip_20one", 38)
        assert sum(1 for _ in source.frames) == 38
    with pytest.raises(VideoError, match=rf"http://{web}/none.mp4: cannot be opened") as error:
        open_source(f"http://user:secret@{web}/none.mp4?token=secret")
    assert "secret" not in str(error.value)


def test_an_interlaced_stream_is_shown_or_refused(tmp_path: Path, web: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a file is; the message keeps the secret."""
    path = encode(tmp_path / "a.ts", moving_square()[0], *INTERLACED["mpeg2.ts"])
    monkeypatch.setattr(_Files, "served", path.read_bytes())
    capture = cv2.VideoCapture(str(path))
    if np.array_equal(capture.read()[1], capture.read()[1]):
        with pytest.raises(VideoError, match=rf"http://{web}/clip.ts: is interlaced") as error:
            open_source(f"http://{web}/clip.ts?token=secret")
        assert "secret" not in str(error.value)
    else:
        with open_source(f"http://{web}/clip.ts?token=secret") as source:
            assert next(source.frames).std() > 5.0


def test_a_live_stream_that_ends_has_gone(web: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Motion JPEG, as IP cameras send it: its frames, then an error, since a camera has no last frame."""
    frames, _ = moving_square(12)
    pictures = tuple(cv2.imencode(".jpg", frame)[1].tobytes() for frame in frames)
    monkeypatch.setattr(_Files, "pictures", pictures)
    read: list[Image] = []
    with open_source(f"http://{web}/live") as source:
        assert (source.name, source.count) == ("live", None)
        with pytest.raises(VideoError, match=r"/live: has stopped giving frames after 1[0-2]"):
            _read_into(read, source)
    assert len(read) >= 10
    assert np.abs(read[5].astype(int) - frames[5]).mean() < 6.0


class _Rtsp(threading.Thread):
    """A camera that answers as RTSP wants it and sends an MPEG stream through the same connection, once."""

    def __init__(self, stream: bytes) -> None:
        super().__init__(daemon=True)
        self._stream = stream
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.port = self._socket.getsockname()[1]

    def run(self) -> None:
        connection, _ = self._socket.accept()
        with self._socket, connection, connection.makefile("rb") as lines:
            while request := lines.readline().decode():
                fields = {}
                while line := lines.readline().decode().strip():
                    name, _, value = line.partition(":")
                    fields[name.lower()] = value.strip()
                self._answer(connection, request.split()[0], fields)
                if request.startswith("PLAY"):
                    self._send(connection)
                    return

    def _answer(self, connection: socket.socket, method: str, fields: dict[str, str]) -> None:
        body = ""
        extra = "Session: 1\r\n"
        if method == "OPTIONS":
            extra = "Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN\r\n"
        elif method == "DESCRIBE":
            body = "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=x\r\nt=0 0\r\nm=video 0 RTP/AVP 33\r\na=control:track1\r\n"
            extra = f"Content-Type: application/sdp\r\nContent-Length: {len(body)}\r\n"
        elif method == "SETUP":
            extra += "Transport: RTP/AVP/TCP;unicast;interleaved=0-1\r\n"
        connection.sendall(f"RTSP/1.0 200 OK\r\nCSeq: {fields['cseq']}\r\n{extra}\r\n{body}".encode())

    def _send(self, connection: socket.socket) -> None:
        part = 7 * 188
        for number, begin in enumerate(range(0, len(self._stream), part)):
            data = self._stream[begin : begin + part]
            head = struct.pack(">BBHII", 0x80, 33, number & 0xFFFF, number * 90, 1)
            connection.sendall(b"$\0" + struct.pack(">H", len(head) + len(data)) + head + data)


def test_an_rtsp_camera_is_followed_until_it_goes(tmp_path: Path) -> None:
    """Its frames come, its end is an error, and the password stays out of the message."""
    stream = _encode(tmp_path / "a.ts", "-tune", "zerolatency").read_bytes()
    camera = _Rtsp(stream)
    camera.start()
    read: list[Image] = []
    with (
        open_source(f"rtsp://user:secret@127.0.0.1:{camera.port}/door") as source,
        pytest.raises(VideoError, match=rf"rtsp://127\.0\.0\.1:{camera.port}/door: has stopped") as error,
    ):
        _read_into(read, source)
    assert "secret" not in str(error.value)
    assert (source.name, source.count) == ("door", None)
    assert len(read) > 30
    camera.join(10.0)


@pytest.mark.parametrize("url", ["ftp://host/a.avi", "concat://a", "file:///etc/passwd"])
def test_other_protocols_are_refused(url: str) -> None:
    """With those that are known."""
    with pytest.raises(VideoError, match=r"expected a URL of http, https, rtmp.*, got (ftp|concat|file)"):
        open_source(url)


def test_a_camera_may_be_named_by_its_device(monkeypatch: pytest.MonkeyPatch) -> None:
    """/dev/video2 is camera 2, where there is such a device."""
    from hs_tracker_cv.video import opening

    monkeypatch.setattr(opening, "_mode", lambda path: 0o020660)
    with pytest.raises(VideoError, match="camera 83: cannot be opened"):
        open_source("/dev/video83")


def test_modules_beside_the_video_are_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The decoder is asked in a process of its own, in the folder of the user, who may have downloaded it."""
    monkeypatch.chdir(tmp_path)
    for name in ("cv2", "json"):
        (tmp_path / f"{name}.py").write_text("open('executed', 'w')")
    still = np.full((48, 64, 3), 90, np.uint8)
    with VideoSink(tmp_path / "still.avi", 25.0) as sink:
        for _ in range(4):
            sink.write(still)
    with open_source("still.avi") as source:
        assert len(list(source.frames)) == 4
    assert not (tmp_path / "executed").exists()
