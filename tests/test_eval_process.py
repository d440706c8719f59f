"""The child process: it gets frames and nothing else, whatever it tries, and the clock is ours."""

from __future__ import annotations

import io
import math
import os
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from eval.accuracy import Job, hidden_paths, run_one
from eval.clock import Clock, UntrueTimeError, untrue_time
from eval.datasets import load_dataset
from eval.metrics import frame_scores, summarise
from eval.process import Answer, Child, ChildError, Limits
from eval.results import COMPLETED, Folder, SpeedRun
from eval.sandbox import available, readable_paths
from eval.sequences import Sequence
from eval.speed import measure_speed
from eval.trackers import TrackerSpec
from eval.wire import GarbledError, read_message, write_message
from eval.worker import Arrays

pytestmark = pytest.mark.once

COUNT = 6

CHEATS = '''
import gc, glob, os, re, sys, time, ctypes
import numpy as np

def rows_in(data):
    """Boxes in the bytes of a file, if they could be the truth of the six frames that begin with (10, 10, 20, 10)."""
    text = data.decode("latin-1")
    rows = re.findall(r"(?m)^([\\d.]+),([\\d.]+),([\\d.]+),([\\d.]+)$", text)
    rows += re.findall(r"\\[([\\d.]+), ?([\\d.]+), ?([\\d.]+), ?([\\d.]+)\\]", text)
    rows = [tuple(map(float, row)) for row in rows]
    if len(rows) >= 6 and rows[0] in ((10, 10, 20, 10), (11, 11, 20, 10)):
        return rows

class Honest:
    """The box never moves."""
    def __init__(self, **params): self.params, self.truth, self.frame = params, None, 0
    def search(self): return None
    def init(self, image, box):
        self.box, self.truth = box, self.search()
    def update(self, image):
        self.frame += 1
        if not self.truth:
            return True, self.box
        x, y, w, h = self.truth[self.frame]
        return True, (x - 1, y - 1, w, h)

def looked_for(paths):
    for path in paths:
        try:
            with open(path, "rb") as file:
                found = rows_in(file.read(2_000_000))
        except OSError:
            continue
        if found:
            return found

def everywhere(*roots):
    for root in roots:
        for place, folders, files in os.walk(root):
            yield from (os.path.join(place, name) for name in files if name.endswith((".txt", ".json")))

class ScansFiles(Honest):
    def search(self): return looked_for(everywhere(*self.params["roots"]))

class FollowsProcesses(Honest):
    """Open files, folders, environments, arguments and memory of all processes that it comes from."""
    def search(self):
        process = os.getppid()
        while process > 1:
            found = looked_for(glob.glob(f"/proc/{process}/fd/*"))
            found = found or looked_for([f"/proc/{process}/environ", f"/proc/{process}/mem"])
            try:
                found = found or looked_for(everywhere(os.readlink(f"/proc/{process}/cwd")))
            except OSError:
                pass
            for word in self.words(process):
                found = found or looked_for(everywhere(word, os.path.dirname(word)))
            if found:
                return found
            process = int(re.search(r"PPid:\\s+(\\d+)", open(f"/proc/{process}/status").read())[1])
    def words(self, process):
        try:
            text = open(f"/proc/{process}/cmdline").read()
        except OSError:
            return []
        return [word for part in text.split("\\0") for word in part.split(":") if os.path.isdir(word)]

class ReadsItsOwn(Honest):
    """Its arguments, environment, folder, open files, and all objects of its own memory."""
    def search(self):
        words = [*sys.argv, *os.environ.values(), os.getcwd()]
        places = [word for word in words if "data" in word and os.path.exists(word)]
        found = looked_for(everywhere(*places)) or looked_for(everywhere(os.getcwd()))
        files = [f"/proc/self/fd/{name}" for name in os.listdir("/proc/self/fd")]
        found = found or looked_for(file for file in files if os.path.isfile(file))
        for thing in gc.get_objects():
            if isinstance(thing, (str, bytes)) and len(thing) > 50 and "tiny" in str(thing):
                found = found or rows_in(str(thing).encode())
        return found

class AsksTheLaboratory(Honest):
    def search(self):
        from datasets_synthetic import SUITES, render
        return [tuple(box + (1, 1, 0, 0)) for box in render(SUITES["smoke"][0]).boxes]

class ReadsResults(Honest):
    def search(self): return looked_for(everywhere(self.params["results"]))

class Told:
    """Service that says what its process was told, in every way that could name a place."""
    def answer(self, content, arrays):
        files = [os.readlink(f"/proc/self/fd/{name}") for name in os.listdir("/proc/self/fd") if int(name) < 90
                 and os.path.exists(f"/proc/self/fd/{name}")]
        words = [word for value in os.environ.values() for word in value.split(":")]
        return {"words": [*sys.orig_argv, *words, os.getcwd(), *files]}, ()

class Helped(Honest):
    """Lets other processes work, whose time is not that of its calls."""
    def init(self, image, box):
        super().init(image, box)
        if self.params["when"] == "init":
            os.fork() or os._exit(0)
    def update(self, image):
        if self.params["way"] == "subprocess":
            import subprocess
            subprocess.run(["true"])
        elif self.params["way"] == "fork":
            os.fork() or os._exit(0)
        return super().update(image)

class Threaded(Honest):
    """Works in a thread and waits for it."""
    def update(self, image):
        import threading
        thread = threading.Thread(target=sum, args=(range(1000),))
        thread.start()
        thread.join()
        return super().update(image)

class Slow(Honest):
    """Works for two milliseconds, and has a clock that says what it is told to."""
    def __init__(self, **params):
        super().__init__()
        import eval.track
        said = iter(params["said"] * 100)
        if params["said"]:
            eval.track.process_time = lambda: next(said)
        if params.get("wall"):
            eval.track.perf_counter = lambda: next(said)
    def update(self, image):
        end = time.clock_gettime(time.CLOCK_PROCESS_CPUTIME_ID) + 0.002
        while time.clock_gettime(time.CLOCK_PROCESS_CPUTIME_ID) < end:
            pass
        return super().update(image)
'''


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    """Six frames of 64 × 48; the box moves right by 2 px per frame."""
    folder = tmp_path / "data" / "tiny"
    (folder / "img").mkdir(parents=True)
    for index in range(COUNT):
        cv2.imwrite(str(folder / "img" / f"{index + 1:04d}.png"), np.full((48, 64, 3), 10 * index, dtype=np.uint8))
    lines = [f"{11 + 2 * index},11,20,10" for index in range(COUNT)]
    (folder / "groundtruth_rect.txt").write_text("\n".join(lines) + "\n")
    return load_dataset(f"otb:{folder}")[0]


@pytest.fixture
def cheat(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., TrackerSpec]:
    """Specs of trackers that cheat; their module lies in the folder that the data set lies in."""
    (tmp_path / "cheats.py").write_text(CHEATS)
    monkeypatch.syspath_prepend(str(tmp_path))

    def spec(name: str, **params: object) -> TrackerSpec:
        return TrackerSpec(name, f"cheats:{name}", params=params, sources=("cheats",))

    return spec


STATIC = float(np.mean([(20 - 2 * d) / (20 + 2 * d) for d in range(1, COUNT)]))
"""Mean IoU of the box that never moves."""


@pytest.mark.skipif(not available(), reason="this kernel cannot keep a process from files")
@pytest.mark.parametrize(
    "name", ["ScansFiles", "FollowsProcesses", "ReadsItsOwn", "AsksTheLaboratory", "ReadsResults"]
)
def test_a_tracker_that_looks_for_the_truth_finds_none(
    name: str, cheat: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """It scores what it scores without looking; the same search finds the truth where nothing is forbidden."""
    folder = Folder(tmp_path / "out" / "otb-tiny")
    folder.write_manifest("otb:tiny", [sequence])
    spec = cheat(name, roots=[str(tmp_path), str(Path(__file__).parents[1] / "eval")], results=str(folder.path))
    # A file of truth is open here, and the arguments of this process may name it.
    with open(tmp_path / "data" / "tiny" / "groundtruth_rect.txt"):
        run = run_one(Job(spec, sequence), limits=Limits(seconds=120.0), results=folder.path)
    if name == "AsksTheLaboratory":
        assert run.status.startswith("raised ")
        return
    assert run.status == COMPLETED
    scores = frame_scores(sequence.boxes, sequence.visibility, run.trajectory.boxes, run.trajectory.ok, sequence.size)
    assert summarise(scores)["mean_iou"] == pytest.approx(STATIC)


@pytest.mark.parametrize("name", ["ScansFiles", "ReadsResults"])
def test_the_cheats_work_where_nothing_hinders_them(
    name: str, cheat: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """Otherwise their failure would prove nothing."""
    Folder(tmp_path / "out" / "otb-tiny").write_manifest("otb:tiny", [sequence])
    space: dict[str, object] = {}
    exec(CHEATS, space)
    tracker = space[name](roots=[str(tmp_path / "data")], results=str(tmp_path / "out"))  # type: ignore[operator]
    assert len(tracker.search()) >= COUNT


def test_a_child_is_told_no_place(cheat: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path) -> None:
    """Neither arguments nor environment, folder or open files name the data set, with or without a sandbox."""
    hidden = hidden_paths(sequence, tmp_path / "out")
    os.environ["MY_DATA"] = f"x:{hidden[0]}:y"
    try:
        with Child("cheats:Told", Limits(), hidden=hidden) as child:
            words = child.ask({"do": "tell"}).content["words"]
    finally:
        del os.environ["MY_DATA"]
    assert not [word for word in words if "tiny" in word or "out" in Path(word).parts]


def test_what_is_hidden_is_left_out_wherever_it_lies(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Modules can be read, data beside them cannot, nor data that lies inside a package."""
    for name in ("pack/__init__.py", "pack/part.py", "pack/data/truth.txt", "data/truth.txt", "mod.py", "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True, parents=True)
        (tmp_path / name).write_text("")
    monkeypatch.setattr(sys, "path", [str(tmp_path)])
    own = {path for path in readable_paths([]) if tmp_path in path.parents}
    assert own == {tmp_path / "pack", tmp_path / "mod.py"}
    own = {path for path in readable_paths([tmp_path / "pack" / "data"]) if tmp_path in path.parents}
    assert own == {tmp_path / "pack" / "__init__.py", tmp_path / "pack" / "part.py", tmp_path / "mod.py"}


def test_libraries_are_read_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Wheels keep shared libraries and data beside their packages, wherever a user has installed them."""
    site = tmp_path / "site-packages"
    (site / "numpy.libs").mkdir(parents=True)
    (tmp_path / "lib").mkdir()
    monkeypatch.setattr(sys, "path", [str(site)])
    monkeypatch.setenv("LD_LIBRARY_PATH", f"{tmp_path / 'lib'}:")
    assert {path for path in readable_paths([]) if tmp_path in path.parents} == {site, tmp_path / "lib"}


# --- messages ----------------------------------------------------------------------------------------------


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["u1", "<u2", ">u2", "f4", "f8", "?", "i8"]), st.lists(st.integers(0, 5), max_size=4)
        ),
        max_size=3,
    )
)
def test_messages_survive(layout: list[tuple[str, list[int]]]) -> None:
    """Numbers of any type and shape arrive as they were, in arrays that can be written to."""
    sent = [np.arange(math.prod(shape)).reshape(shape).astype(name) for name, shape in layout]
    stream = io.BytesIO()
    write_message(stream, {"a": [1, math.inf]}, sent)
    stream.seek(0)
    content, arrays = read_message(stream)
    assert content == {"a": [1, math.inf]}
    for one, other in zip(sent, arrays, strict=True):
        assert (one.dtype, one.shape, other.flags.writeable) == (other.dtype, other.shape, True)
        assert_array_equal(one, other)


@pytest.mark.parametrize(
    "text",
    [
        b"[]\n",
        b"{}\n",
        b"\n",
        b"\xff\n",
        b"null\n",
        b'{"arrays": [["O", [1]]]}\n',
        b'{"arrays": [["S9", [1]]]}\n',
        b'{"arrays": [["u1", [-1]]]}\n',
        b'{"arrays": [["f8", [99999, 99999]]]}\n',
        b'{"arrays": 3}\n',
        b"x" * 2**20,
        b"[" * 2**15 + b"\n",
    ],
)
def test_what_is_no_message_is_refused(text: bytes) -> None:
    """No objects, no sizes that cannot be meant, no line without end."""
    with pytest.raises(GarbledError):
        read_message(io.BytesIO(text))


@pytest.mark.parametrize("text", [b"", b"{", b'{"arrays": [["u1", [3]]]}\nab'])
def test_a_message_that_is_cut_off_is_the_end(text: bytes) -> None:
    """A child that died in the middle has said nothing."""
    with pytest.raises(EOFError):
        read_message(io.BytesIO(text))


# --- the clock ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("cpu", "wall", "said"),
    [
        (1.0, 1.0, ""),
        (0.0, 1.0, "reported a call of 0 ms"),
        (1.0, 0.0, "reported a call of 0 ms"),
        (-2.0, 1.0, "reported a call of -2 ms"),
        (math.nan, 1.0, "reported a call of nan ms"),
        (1.0, math.inf, "reported a call of 1 ms"),
        (1.0, 2.5, "reported a call of 2.500 ms, which took 2.000 ms"),
        (1.9, 1.0, "reported 1.900 ms of processor time, and has taken 1.500 ms"),
    ],
)
def test_a_time_that_cannot_be_is_named(cpu: float, wall: float, said: str) -> None:
    """More than our clock saw, nothing, or less."""
    assert untrue_time(cpu, wall, 1.5, 2.0).startswith(said)
    assert bool(untrue_time(cpu, wall, 1.5, 2.0)) is bool(said)


def test_without_a_processor_clock_the_other_is_used() -> None:
    """Not every system tells the processor time of another process."""
    assert untrue_time(1.9, 1.0, math.nan, 2.0) == ""
    assert untrue_time(1.9, 2.1, math.nan, 2.0) != ""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the processor time of a child is known on Linux")
@pytest.mark.parametrize(
    ("params", "status"),
    [
        ({"said": []}, COMPLETED),
        ({"said": [1.0, 1.0]}, "reported a call of 0 ms"),
        ({"said": [2.0, 1.0]}, "reported a call of -1000 ms"),
        ({"said": [1.0, 3.0]}, "reported 2000.000 ms of processor time, and has taken"),
        ({"said": [1.0, 1.0001]}, "reported "),
        ({"said": [0.0, 0.0, 9.0, 9.0], "wall": True}, "reported a call of"),
    ],
    ids=["honest", "nothing", "back in time", "too much", "too little", "too long"],
)
def test_a_tracker_that_turns_the_clock_loses_its_row(
    params: dict[str, object], status: str, cheat: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """Its process can be made to say anything; ours has seen how long it took."""
    found: list[SpeedRun] = []
    measure_speed(
        [cheat("Slow", **params), cheat("Honest")],
        [sequence],
        Folder(tmp_path / "out"),
        warm_up=1,
        report=lambda run, reused: found.append(run),
    )
    assert found[0].status["Slow"].startswith(status)
    assert found[0].status["Honest"] == COMPLETED
    if status == COMPLETED:
        assert min(found[0].milliseconds["Slow"]) >= 2.0


class Mute:
    """A child whose clock is told: calls of a millisecond each, and what it works in them and beside them, s."""

    def __init__(self, *, called: float = 0.001, beside: float = 0.0, handing: float = 0.0) -> None:
        self.called, self.beside, self.handing, self.worked = called, beside, handing, 0.0

    def transport(self, arrays: Arrays = ()) -> float:
        """Handing over arrays takes what it takes."""
        return self.handing if arrays else 0.0

    def processor_seconds(self) -> float:
        """So far."""
        return self.worked

    def ask(self, content: object) -> Answer:
        """A call."""
        self.worked += self.called + self.beside
        return Answer({"cpu_ms": 1.0, "wall_ms": 1.0}, (), 0.01, self.called)


def judged(child: Mute, calls: int, load: float, monkeypatch: pytest.MonkeyPatch) -> Clock:
    """The clock of a child after some calls, on a machine of two cores with so many processes."""
    monkeypatch.setattr(os, "getloadavg", lambda: (load, load, load))
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    clock = Clock(child, FRAME)  # type: ignore[arg-type]
    clock.begin(FRAME)
    for _ in range(calls):
        assert clock.timed({}) == (1.0, 1.0)
    return clock


FRAME = np.zeros((48, 64), np.uint8)


@pytest.mark.parametrize(("load", "refused"), [(0.1, True), (1e6, False)])
def test_a_machine_under_load_is_given_more_slack(
    load: float, refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half a millisecond that is not accounted for is a lie on a quiet machine, and nothing on a busy one."""
    clock = judged(Mute(called=0.0015), 3, load, monkeypatch)
    if refused:
        with pytest.raises(UntrueTimeError, match=r"reported 0\.500 ms less per call"):
            clock.check()
    clock.check()


@pytest.mark.parametrize(
    ("child", "calls", "refused"),
    [
        (Mute(beside=0.001), 30, True),
        (Mute(beside=0.001), 10, False),  # once, it may take ten milliseconds to get ready
        (Mute(beside=0.001, handing=0.001), 30, False),
        (Mute(beside=0.0002), 1000, False),
        (Mute(beside=0.0003), 1000, True),
    ],
)
def test_work_beside_the_calls_is_charged(
    child: Mute, calls: int, refused: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A thread that works between the calls: what handing over a frame takes is given, and little more."""
    child.worked = 0.0
    clock = judged(child, calls, 1.0, monkeypatch)
    if refused:
        with pytest.raises(UntrueTimeError, match="ms per call beside its calls"):
            clock.check()
    else:
        clock.check()


def test_what_was_done_before_is_not_charged(monkeypatch: pytest.MonkeyPatch) -> None:
    """To load a model and to begin may take as long as they like."""
    child = Mute()
    clock = judged(child, 1, 1.0, monkeypatch)
    child.worked += 9.0
    clock.begin(FRAME)
    clock.timed({})
    clock.check()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="a filter of Linux's")
@pytest.mark.parametrize(
    "params",
    [{"way": "fork", "when": ""}, {"way": "subprocess", "when": ""}, {"way": "", "when": "init"}],
    ids=["for each frame", "a program for each", "one that stays"],
)
def test_what_is_timed_starts_no_process(
    params: dict[str, object], cheat: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """Its time would be nobody's; threads are its own. Where nothing is timed it may."""
    specs = [cheat("Helped", **params), cheat("Threaded")]
    found: list[SpeedRun] = []
    measure_speed(specs, [sequence], Folder(tmp_path / "out"), warm_up=1, report=lambda run, _: found.append(run))
    assert found[0].status["Helped"].startswith("raised PermissionError: [Errno 1]")
    assert found[0].milliseconds["Helped"] == []
    assert len(found[0].milliseconds["Threaded"]) == COUNT - 2
    assert run_one(Job(specs[0], sequence)).status == COMPLETED


def test_a_child_that_cannot_start_is_no_trackers_fault() -> None:
    """The error says what its process printed last."""
    with pytest.raises(OSError, match=r"cannot start a process .*cannot load 'eval.no_such:Thing'"):
        Child("eval.no_such:Thing", Limits())


def test_a_failure_leaves_the_child_in_use() -> None:
    """An exception is an answer; the next request is served."""
    with Child("eval.track:Track", Limits()) as child:
        with pytest.raises(ChildError, match="raised ValueError: cannot load 'nowhere:Nothing'"):
            child.ask({"do": "open", "factory": "nowhere:Nothing", "params": {}, "seed": 0})
        assert (
            child.ask({"do": "open", "factory": "eval.baselines.known:Static", "params": {}, "seed": 0}).content == {}
        )
        assert child.running()
    assert not child.running()


def test_what_a_child_says_commands_no_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its words go to a terminal, to files and pages: letters only."""
    (tmp_path / "rude.py").write_text(r"""def make(): raise ValueError("\x1b[31mred\x07\u202e")""")
    monkeypatch.syspath_prepend(str(tmp_path))
    with Child("eval.track:Track", Limits()) as child:
        with pytest.raises(ChildError) as caught:
            child.ask({"do": "open", "factory": "rude:make", "params": {}, "seed": 0})
    assert str(caught.value) == "raised ValueError: [31mred"


@pytest.mark.parametrize("limits", [{"seconds": 0}, {"megabytes": -1}, {"processes": 0}, {"seconds": math.nan}])
def test_limits_are_positive(limits: dict[str, float]) -> None:
    """Senseless limits are named."""
    with pytest.raises(ValueError, match="expected positive limits"):
        Limits(**limits)  # type: ignore[arg-type]
