"""The pages' server against strangers: a real process, real HTTP and WebSocket clients, no browser."""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest

from hs_tracker_cv import app
from hs_tracker_cv.video import VideoError, VideoSink

pytest.importorskip("nicegui")
import httpx
import nicegui
import psutil
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from hs_tracker_cv.app.sources import CAMERA, DEMO, Sources

pytestmark = pytest.mark.once

SOCKET = "/_nicegui_ws/socket.io/?EIO=4&transport=websocket"
PATHS = (
    "/",
    "/favicon.ico",
    f"/_nicegui/{nicegui.__version__}/static/nicegui.js",
    "/_nicegui_ws/socket.io/?EIO=4&transport=polling",
    "/nowhere",
)
PATIENCE = 60.0
"""Seconds that something may take on a busy machine."""


class Server:
    """A running page server, and its address taken apart."""

    def __init__(self, process: psutil.Process, address: str) -> None:
        self.process = process
        self.address = address
        self.port = int(urlsplit(address).port or 0)
        self.origin = f"http://127.0.0.1:{self.port}"
        self.token = address.partition("token=")[2]
        self.cookie = f"hs-track-{self.port}={self.token}"

    def get(self, path: str, **headers: str) -> httpx.Response:
        """A request with the cookie that the page has set."""
        return httpx.get(self.origin + path, headers={"Cookie": self.cookie, **headers})


@contextlib.contextmanager
def serving(*arguments: str) -> Iterator[Server]:
    """`hs-track app …` until the block ends; its address as printed."""
    command = [sys.executable, "-m", "hs_tracker_cv", "app", *arguments, "--no-show"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    assert process.stderr is not None
    try:
        lines = iter(process.stderr.readline, "")
        address = next(found[0] for line in lines if (found := re.search(r"http://\S+", line)))
        yield Server(psutil.Process(process.pid).children()[0], address)
    finally:
        process.terminate()
        process.communicate()


@pytest.fixture(scope="module")
def video(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short video in a folder of its own."""
    path = tmp_path_factory.mktemp("videos") / "short.avi"
    rng = np.random.default_rng(3)
    with VideoSink(path, 25.0) as sink:
        for _ in range(6):
            sink.write(rng.integers(0, 255, (120, 160, 3), dtype=np.uint8))
    return path


@pytest.fixture(scope="module")
def server(video: Path) -> Iterator[Server]:
    """One server for all tests that leave it as it was."""
    with serving(str(video.parent)) as running:
        yield running


def _status_of_socket(server: Server, *, origin: str | None, cookie: str = "", host: str | None = None) -> int:
    """Open a WebSocket: 101 if it opens, otherwise the status of the refusal."""
    headers = {"Cookie": cookie} if cookie else {}
    address = f"ws://{host or f'127.0.0.1:{server.port}'}{SOCKET}"
    # A foreign name would have to be resolved: the connection is made here, whatever the name says.
    connection = socket.create_connection(("127.0.0.1", server.port))
    try:
        with connect(address, sock=connection, origin=origin, additional_headers=headers, compression=None):  # type: ignore[arg-type]
            return 101
    except InvalidStatus as refusal:
        return refusal.response.status_code


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("query", ["", "token=", "token=wrong", "token=%C3%A9%00"])
def test_without_the_token_every_address_is_refused(server: Server, path: str, query: str) -> None:
    """Pages, static files, polling and what does not exist answer 403 alike, and tell nothing."""
    separator = "&" if "?" in path else "?"
    answer = httpx.get(server.origin + path + (separator + query if query else ""))
    assert answer.status_code == 403
    assert "set-cookie" not in answer.headers
    assert server.token not in answer.text


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "HEAD", "TRACE"])
def test_without_the_token_every_method_is_refused(server: Server, method: str) -> None:
    """No method gets by."""
    assert httpx.request(method, server.origin + "/", headers={"Origin": server.origin}).status_code == 403


def test_the_token_opens_the_page_and_its_cookie_the_rest(server: Server) -> None:
    """The first visit sets a cookie that scripts cannot read and other sites cannot make the browser send."""
    with httpx.Client() as client:
        first = client.get(server.address)
        assert first.status_code == 200
        assert "hs-track" in first.text
        attributes = {part.strip().lower() for part in first.headers["set-cookie"].split(";")}
        assert {"httponly", "samesite=strict", "path=/"} <= attributes
        assert first.headers["content-security-policy"] == "frame-ancestors 'none'"
        assert [client.get(server.origin + path).status_code for path in PATHS] == [200, 200, 200, 200, 404]
    assert server.get("/", Cookie=f"hs-track-{server.port}=wrong").status_code == 403
    assert server.get("/", Cookie=f"hs-track-1={server.token}").status_code == 403


@pytest.mark.parametrize("name", ["evil.example", "127.0.0.1.evil.example", "localhost.", "0.0.0.0", "[::2]", ""])
def test_a_foreign_host_is_refused(server: Server, name: str) -> None:
    """DNS rebinding: a foreign name that leads here is refused even with the token."""
    for host in (name, f"{name}:{server.port}"):
        assert server.get("/", Host=host).status_code in {400, 403}
        assert httpx.get(server.address, headers={"Host": host}).status_code in {400, 403}
    assert (
        _status_of_socket(server, origin=server.origin, cookie=server.cookie, host=f"{name or 'x'}:{server.port}")
        == 403
    )


def test_the_host_has_the_bound_port(server: Server) -> None:
    """Loopback names are right with the server's port only."""
    for name in ("127.0.0.1", "localhost", "LOCALHOST", "[::1]"):
        assert server.get("/", Host=f"{name}:{server.port}").status_code == 200
        assert server.get("/", Host=name).status_code == 403
        assert server.get("/", Host=f"{name}:{server.port + 1}").status_code == 403


def test_a_socket_needs_cookie_and_origin(server: Server) -> None:
    """A page elsewhere can open sockets to any address: they are refused before they open."""
    own, cookie = server.origin, server.cookie
    assert _status_of_socket(server, origin=own, cookie=cookie) == 101
    assert _status_of_socket(server, origin=own) == 403
    assert _status_of_socket(server, origin=own, cookie=f"hs-track-{server.port}=wrong") == 403
    foreign = (None, "null", "http://evil.example", f"http://127.0.0.1:{server.port + 1}", f"{own}.evil.example")
    assert [_status_of_socket(server, origin=origin, cookie=cookie) for origin in foreign] == [403] * len(foreign)


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://127.0.0.1:1"])
def test_unsafe_methods_need_the_origin(server: Server, origin: str | None) -> None:
    """Forms and scripts of other pages cannot post, even where the browser would send the cookie."""
    headers = {"Origin": origin} if origin is not None else {}
    headers["Cookie"] = server.cookie
    address = f"{server.origin}/_nicegui/client/x/upload/1"
    assert httpx.post(address, headers=headers, files={"file": b"x"}).status_code == 403
    headers["Origin"] = server.origin
    assert httpx.post(address, headers=headers, files={"file": b"x"}).status_code == 404


def test_no_path_leads_out_of_the_server(server: Server, video: Path) -> None:
    """Neither plain nor encoded steps upwards reach a file of the machine."""
    with socket.create_connection(("127.0.0.1", server.port)) as probe:
        assert probe.getpeername()[1] == server.port
    prefixes = ("/", f"/_nicegui/{nicegui.__version__}/static/", f"/_nicegui/{nicegui.__version__}/resources/x/")
    steps = ("../" * 12, "..%2f" * 12, "%2e%2e/" * 12, "%2e%2e%2f" * 12, "..%5c" * 12, "//")
    for prefix in prefixes:
        for step in steps:
            for target in ("etc/passwd", str(video).lstrip("/")):
                answer = _raw_get(server, prefix + step + target)
                assert re.match(rb"HTTP/1.1 (404|400|403|405)", answer), (prefix, step)


def _raw_get(server: Server, path: str) -> bytes:
    """A request whose path no client has tidied."""
    headers = (f"Host: 127.0.0.1:{server.port}", f"Cookie: {server.cookie}", "Connection: close", "", "")
    request = "\r\n".join((f"GET {path} HTTP/1.1", *headers))
    with socket.create_connection(("127.0.0.1", server.port), timeout=PATIENCE) as connection:
        connection.sendall(request.encode())
        return b"".join(iter(lambda: connection.recv(65536), b""))


def test_the_ticket_opens_the_page_once() -> None:
    """The address on the browser's command line, which others can read, is worth nothing once it was used."""
    with app._page("app", None, video="", models="") as page:
        port = urlsplit(page.ticket).port
        foreign = httpx.get(page.ticket, headers={"Host": "evil.example"})
        first, again = httpx.get(page.ticket), httpx.get(page.ticket)
        assert [answer.status_code for answer in (foreign, first, again)] == [403, 200, 403]
        cookies = {f"hs-track-{port}": first.cookies[f"hs-track-{port}"]}
        assert httpx.get(page.ticket, cookies=cookies).status_code == 200
        assert page.ticket not in " ".join(page.process.args)
        assert page.address not in " ".join(page.process.args)


def test_the_command_line_holds_no_secret(server: Server) -> None:
    """Other users may read it."""
    assert server.token not in " ".join(server.process.cmdline())


def test_pages_that_nobody_looks_at_hold_nothing(server: Server) -> None:
    """Sixty requests without a browser behind them open no video."""
    before = server.process.num_fds(), server.process.num_threads()
    for _ in range(60):
        assert httpx.get(server.address).status_code == 200
    assert server.process.num_fds() <= before[0] + 2
    assert server.process.num_threads() <= before[1] + 2


def test_a_taken_port_gives_the_next_free_one(capfd: pytest.CaptureFixture[str]) -> None:
    """And that one is printed."""
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with app._page("app", port, video="", models="") as page:
            bound = urlsplit(page.address).port
            assert port < bound < port + 20
            assert httpx.get(page.address).status_code == 200
    assert capfd.readouterr().err == f"hs-track: port {port} is taken, {bound} is used\n"


@pytest.mark.parametrize("port", [0, -1, 65536])
def test_a_port_that_cannot_be_is_named(port: int) -> None:
    """As one line, before anything is started."""
    with pytest.raises(VideoError, match=f"expected a port from 1 to 65535, got {port}"):
        app.serve(port=port, show=False)


def test_no_free_port_is_one_line() -> None:
    """The last port taken and none behind it: exit code 1 and one line."""
    try:
        taken = socket.create_server(("127.0.0.1", 65535))
    except OSError:
        taken = socket.socket()  # taken by another already
    with taken:
        command = [sys.executable, "-m", "hs_tracker_cv", "app", "--port", "65535", "--no-show"]
        answer = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE)
    assert answer.returncode == 1
    assert answer.stderr == "hs-track: the page cannot be served: ports 65535 to 65535 are taken\n"


def test_the_server_ends_with_its_parent() -> None:
    """Even when the parent is killed."""
    with serving() as server:
        parent = server.process.parent()
        assert parent is not None
        parent.kill()
        psutil.wait_procs([server.process], timeout=PATIENCE)
        assert not server.process.is_running()


@pytest.mark.skipif(sys.platform == "win32", reason="signals of other systems")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_uploads_do_not_outlive_the_page(
    video: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    """However the command ends, with pages open, nothing stays in the folder of temporary files."""
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    with serving() as server:
        page = server.get("/").text
        address = next(iter(re.findall(r"/_nicegui/client/[^/]+/upload/\d+", page)))
        files = {"file": ("mine.avi", video.read_bytes())}
        headers = {"Cookie": server.cookie, "Origin": server.origin}
        assert httpx.post(server.origin + address, files=files, headers=headers).status_code == 200
        # The answer does not wait for the page to take it.
        end = time.monotonic() + PATIENCE
        while not (stored := list(tmp_path.rglob("*.avi"))) and time.monotonic() < end:
            time.sleep(0.05)
        assert len(stored) == 1
        parent = server.process.parent()
        assert parent is not None
        parent.send_signal(number)
        psutil.wait_procs([parent, server.process], timeout=PATIENCE)
        assert list(tmp_path.iterdir()) == []


def test_modules_of_the_working_directory_are_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A downloaded folder of videos may hold a file called nicegui.py, or json.py."""
    for name in ("nicegui", "json", "uvicorn", "hs_tracker_cv"):
        (tmp_path / f"{name}.py").write_text("open('executed', 'w'); raise SystemExit('executed')")
    monkeypatch.chdir(tmp_path)
    with app._page("app", None, video="", models="") as page:
        assert httpx.get(page.address).status_code == 200
    assert not (tmp_path / "executed").exists()


def test_a_page_offers_what_was_named_only(video: Path, tmp_path: Path) -> None:
    """Links that leave the folder, other files and anything with a path in its name are no sources."""
    (tmp_path / "inside.avi").write_bytes(video.read_bytes())
    (tmp_path / "link.avi").symlink_to(tmp_path / "inside.avi")
    (tmp_path / "escape.avi").symlink_to(video)
    (tmp_path / "notes.txt").write_text("private")
    sources = Sources(str(tmp_path))
    assert sources.names == ["inside.avi", "link.avi", CAMERA.format(0), DEMO]
    for name in ("escape.avi", "notes.txt", str(video), "../" + video.name, "", "0", "/dev/video0"):
        with pytest.raises(VideoError, match="not among the videos"):
            sources.open(name)
    with sources.open("link.avi") as source:
        assert source.size == (160, 120)
    sources.close()


def test_uploads_lie_where_the_page_says(video: Path) -> None:
    """The name a browser tells is a text; the file lies in the page's own folder, and goes with it."""
    sources = Sources(str(video))
    placed = [sources.reserve(name) for name in ("../../etc/short.avi", "C:\\x\\short.avi", "a\0b.MKV")]
    assert [name for name, _ in placed] == ["short.avi (2)", "short.avi (3)", "a\0b.MKV"]
    paths = [path for _, path in placed]
    assert [path.name for path in paths] == ["upload0.avi", "upload1.avi", "upload2.mkv"]
    assert len({path.parent for path in paths}) == 1
    paths[0].write_bytes(video.read_bytes())
    with sources.open("short.avi (2)") as source:
        assert source.size == (160, 120)
        assert source.name == "short"
    paths[1].write_bytes(b"no video")
    with pytest.raises(VideoError, match=r"^short\.avi \(3\): is not a video"):
        sources.open("short.avi (3)")
    for name in ("passwd", "x.html", ".avi", ""):
        with pytest.raises(VideoError, match="expected a video"):
            sources.reserve(name)
    sources.close()
    assert not paths[0].exists()
