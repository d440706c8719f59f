"""The runner: whatever a tracker does costs one row, marked with its reason; nothing that is finished is lost."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import psutil
import pytest

from eval import process as protocol
from eval.__main__ import main
from eval.accuracy import Job, make_jobs, run_jobs, run_one
from eval.datasets import load_dataset
from eval.metrics import summarise
from eval.process import Limits
from eval.protocols import start_box
from eval.regions import Mask, polygon_text, read_region, region_box
from eval.results import COMPLETED, Folder, ResultsError, Run, SpeedRun
from eval.sandbox import available
from eval.sequences import Sequence
from eval.speed import measure_speed
from eval.statistics import score_answers
from eval.trackers import DEFAULT_TRACKERS, TRACKERS, TrackerSpec, code_version, find_tracker

pytestmark = pytest.mark.once

ROOT = Path(__file__).resolve().parents[1]
COUNT = 6

BAD_TRACKERS = '''
import ctypes, itertools, mmap, os, signal, subprocess, sys, threading, time
import numpy as np

class Base:
    """Follows nothing, and goes wrong in its third update."""
    def __init__(self, **params):
        self.params, self.frame = params, 0
    def init(self, image, box):
        self.box = box
    def update(self, image):
        self.frame += 1
        return self.go_wrong() if self.frame == 3 else (True, self.box)

def bad(name, action):
    return type(name, (Base,), {"go_wrong": action})

def _raise(self): raise RuntimeError("no more\\nideas")
def _fill(self):
    held = []
    while True:
        held.append(np.ones(2_000_000))
        time.sleep(0.01)

def _fill_shared(self):
    """What is mapped to be shared, as multiprocessing's arrays are, is memory like any other."""
    held = []
    for _ in range(100):
        held.append(mmap.mmap(-1, 2**24))
        held[-1].write(bytes(2**24))
        time.sleep(0.01)
    return True, self.box

Fine = bad("Fine", lambda self: (True, self.box))
Segfault = bad("Segfault", lambda self: ctypes.string_at(0))
Hang = bad("Hang", lambda self: time.sleep(600))
Raise = bad("Raise", _raise)
Nan = bad("Nan", lambda self: (True, (float("nan"), 0, 5, 5)))
Outside = bad("Outside", lambda self: (True, (5000, 5000, 5, 5)))
Flat = bad("Flat", lambda self: (True, (5, 5, 0, 5)))
Memory = bad("Memory", _fill)
def _fill_memory_file(self):
    file = os.memfd_create("held")
    while True:
        os.write(file, bytes(2**24))
        time.sleep(0.01)

def _fill_shared_folder(self):
    with open("/dev/shm/hs_eval-test", "wb"):
        return True, self.box

def _keep_lasting(self):
    """The three kinds of System V, of which nobody sees how much one holds, and which stay."""
    library = ctypes.CDLL(None, use_errno=True)
    for call, size in (("shmget", (2**24,)), ("semget", (1,)), ("msgget", ())):
        made = getattr(library, call)(0, *size, 0o600)
        assert made < 0, f"{call} made {made}"
        print(call, os.strerror(ctypes.get_errno()))
    raise RuntimeError("none was made")

Lasting = bad("Lasting", _keep_lasting)
SharedMemory = bad("SharedMemory", _fill_shared)
MemoryFile = bad("MemoryFile", _fill_memory_file)
SharedFolder = bad("SharedFolder", _fill_shared_folder)
Leave = bad("Leave", lambda self: os._exit(3))
LeaveFull = bad("LeaveFull", lambda self: os._exit(74))
Quit = bad("Quit", lambda self: sys.exit(0))
Nonsense = bad("Nonsense", lambda self: None)
Interrupt = bad("Interrupt", lambda self: throw(KeyboardInterrupt()))
NoMemory = bad("NoMemory", lambda self: throw(MemoryError()))
Odd = bad("Odd", lambda self: throw(type("Odd", (BaseException,), {})("ly")))
LeaveQuietly = bad("LeaveQuietly", lambda self: os._exit(0))
Abort = bad("Abort", lambda self: os.abort())
Stop = bad("Stop", lambda self: os.kill(os.getpid(), signal.SIGSTOP))
Shut = bad("Shut", lambda self: (os.close(1), sys.stdout.close(), (True, self.box))[2])
ShutAll = bad("ShutAll", lambda self: (os.closerange(0, 99), (True, self.box))[1])
Blind = bad("Blind", lambda self: (False, None))
Ambiguous = bad("Ambiguous", lambda self: (np.ones(2), self.box))
Stack = bad("Stack", lambda self: (True, np.ones((1, 4))))
Endless = bad("Endless", lambda self: (True, itertools.repeat(1.0)))
Beyond = bad("Beyond", lambda self: (True, (10**400, 0, 5, 5)))
Largest = bad("Largest", lambda self: (True, (1e308, 1e308, 1e308, 1e308)))
Numpy = bad("Numpy", lambda self: (np.True_, np.array(self.box, np.float32)))
Talkative = bad("Talkative", lambda self: [print("x" * 1000) for _ in itertools.count()])

def throw(error): raise error

def _children(self):
    child = subprocess.Popen(["sleep", "600"])
    with open(self.params["path"], "w") as diary:
        diary.write(str(child.pid))
    return True, self.box
Children = bad("Children", _children)

def _daemon(self):
    """Leaves a process of another session behind, with every file of ours open in it."""
    child = os.fork()
    if child:
        with open(self.params["path"], "w") as diary:
            diary.write(str(child))
        return True, self.box
    os.setsid()
    time.sleep(600)
    os._exit(0)
Daemon = bad("Daemon", _daemon)

def _note(self, number):
    with open(self.params["path"], "w") as diary:
        diary.write(str(number))

def _double_daemon(self):
    """Leaves a process of another session behind whose parent is gone."""
    open(self.params["path"], "w").close()
    child = os.fork()
    if child:
        os.waitpid(child, 0)
        while not os.path.getsize(self.params["path"]):
            time.sleep(0.01)
        return True, self.box
    os.setsid()
    if os.fork():
        os._exit(0)
    _note(self, os.getpid())
    time.sleep(600)
    os._exit(0)
DoubleDaemon = bad("DoubleDaemon", _double_daemon)
DaemonCrash = bad("DaemonCrash", lambda self: (_double_daemon(self), ctypes.string_at(0)))

def _hidden_memory(self):
    """Four processes of sessions of their own, each with a third of what is allowed."""
    for _ in range(4):
        if os.fork() == 0:
            os.setsid()
            held = np.ones(12_500_000)
            time.sleep(600)
    time.sleep(600)
HiddenMemory = bad("HiddenMemory", _hidden_memory)

def _crowd(self):
    for _ in range(25):
        if os.fork() == 0:
            os.setsid()
            if os.fork() == 0:
                time.sleep(600)
            os._exit(0)
    time.sleep(600)
Crowd = bad("Crowd", _crowd)

def _killed(self):
    with open(self.params["path"], "r+") as diary:
        deaths = len(diary.read())
        if deaths < self.params["deaths"]:
            diary.write("x")
            diary.flush()
            os.kill(os.getpid(), signal.SIGKILL)
    return True, self.box
Killed = bad("Killed", _killed)

def _scribble(self):
    for number in range(3, 30):
        try: os.write(number, b"[]\\n")
        except OSError: pass
    return True, self.box
Scribble = bad("Scribble", _scribble)

def _linger(self):
    threading.Thread(target=time.sleep, args=(600,)).start()
    return True, self.box
Linger = bad("Linger", _linger)
Chatty = bad("Chatty", lambda self: (print("{", flush=True), (True, self.box))[1])
Vandal = bad("Vandal", lambda self: (True, self.box))
def _vandal_update(self, image):
    image[:] = 0
    return True, self.box
Vandal.update = _vandal_update

def _go_away(self):
    os.chdir("/")
    return True, self.box
Wanderer = bad("Wanderer", _go_away)

class Weights(Fine):
    """Reads the file of a parameter."""
    def init(self, image, box):
        super().init(image, box)
        open("/" + self.params["other"] if "other" in self.params else self.params["model"], "rb").read()

class Refusing(Base):
    def init(self, image, box): return False

class FailingInit(Base):
    def init(self, image, box): raise ValueError("not this box")

class Witness(Base):
    """Says what it was given: the mean of the frame and whether the box is made of ints."""
    def update(self, image):
        ints = all(type(v) is int for v in self.box)
        return True, (float(image.mean()), 1.0 + ints, image.shape[0], image.shape[1])

class Patient(Base):
    """Hangs as long as a file is there."""
    def update(self, image):
        while os.path.exists(os.environ["HANG_WHILE"]):
            time.sleep(0.02)
        return True, self.box

class Glutton(Base):
    """Takes a little more with each update, and never a rest."""
    held = []
    def update(self, image):
        self.held.append(np.ones(10_000_000))
        return True, self.box

class Diary(Base):
    """Writes down whose turn it is, for which frame."""
    def update(self, image):
        self.frame += 1
        with open(self.params["path"], "a") as diary:
            diary.write(f"{self.params['label']}{self.frame} ")
        return True, self.box

class Scoring(Base):
    def update(self, image):
        self.frame += 1
        return True, self.box
    def getTrackingScore(self): return -1.0 if self.frame == 2 else 0.25 * self.frame

class Shaped(Base):
    """A box, four corners, OpenCV's rotated rectangle, and pixels twice, the second time of another frame."""
    def update(self, image):
        self.frame += 1
        self.shape = image.shape[:2]
        turned = {2: np.array([10, 15, 15, 10, 20, 15, 15, 20]), 3: ((15.0, 15.0), (50**0.5, 50**0.5), 45.0)}
        return True, turned.get(self.frame, self.box)
    def getMask(self):
        mask = np.zeros(self.shape if self.frame < 5 else (3, 4), np.uint8)
        mask[10:12, 20:23] = 255
        return mask if self.frame > 3 else None
'''


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    """Six frames of 64 × 48, frame t of the gray level 10 t; the box moves right by 2 px per frame."""
    folder = tmp_path / "data" / "tiny"
    (folder / "img").mkdir(parents=True)
    for index in range(COUNT):
        cv2.imwrite(str(folder / "img" / f"{index + 1:04d}.png"), np.full((48, 64, 3), 10 * index, dtype=np.uint8))
    lines = [f"{11 + 2 * index},11,20,10" for index in range(COUNT)]
    (folder / "groundtruth_rect.txt").write_text("\n".join(lines) + "\n")
    return load_dataset(f"otb:{folder}")[0]


@pytest.fixture
def bad(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., TrackerSpec]:
    """Specs of trackers made to go wrong."""
    (tmp_path / "bad_trackers.py").write_text(BAD_TRACKERS)
    monkeypatch.syspath_prepend(str(tmp_path))

    def spec(name: str, **params: object) -> TrackerSpec:
        return TrackerSpec(name, f"bad_trackers:{name}", params=params, sources=("bad_trackers",))

    return spec


def mean_iou(run: Run, sequence: Sequence) -> float:
    """Mean IoU of a run."""
    return summarise(score_answers(sequence, run.trajectory))["mean_iou"]


STATIC = [(20 - 2 * d) / (20 + 2 * d) for d in range(1, COUNT)]
"""IoU of the box that never moves, frame by frame."""


@pytest.mark.parametrize(
    ("name", "reason", "answered"),
    [
        ("Segfault", "crashed (SIGSEGV) at frame 3", 2),
        ("Raise", "raised RuntimeError: no more ideas at frame 3", 2),
        ("Leave", "ended its process with code 3 at frame 3", 2),
        ("Quit", "ended its process at frame 3", 2),
        ("Nonsense", "raised ValueError: update returned None, expected (ok, (x, y, w, h)) at frame 3", 2),
        ("Interrupt", "raised KeyboardInterrupt at frame 3", 2),
        ("NoMemory", "raised MemoryError at frame 3", 2),
        ("Odd", "raised Odd: ly at frame 3", 2),
        ("LeaveQuietly", "ended its process at frame 3", 2),
        ("Abort", "crashed (SIGABRT) at frame 3", 2),
        ("ShutAll", "ended its process with code 74 at frame 3", 2),
        ("Blind", "raised ValueError: update returned (False, None), expected", 2),
        ("Ambiguous", "raised ValueError: The truth value of an array", 2),
        ("Stack", "raised ValueError: update returned (True, array([[1., 1., 1., 1.]])), expected", 2),
        ("Beyond", "raised OverflowError", 2),
        ("Refusing", "raised ValueError: init refused the box (10, 10, 20, 10) in init", 0),
        ("FailingInit", "raised ValueError: not this box in init", 0),
        ("Missing", "raised ValueError: cannot load", 0),
    ],
)
def test_a_tracker_that_goes_wrong_keeps_what_it_had(
    name: str, reason: str, answered: int, bad: Callable[..., TrackerSpec], sequence: Sequence
) -> None:
    """The reason and the frame are named; frames answered before count, all others score 0."""
    run = run_one(Job(bad(name), sequence))
    assert run.status.startswith(reason)
    assert mean_iou(run, sequence) == pytest.approx(sum(STATIC[:answered]) / len(STATIC))


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("Nan", "returned a box that is not finite at frame 3"),
        ("Outside", "returned a box outside the frame at frame 3"),
        ("Flat", "returned a box without area at frame 3"),
        ("Largest", "returned a box outside the frame at frame 3"),
    ],
)
def test_a_box_that_cannot_be_meant_costs_its_frame(
    name: str, reason: str, bad: Callable[..., TrackerSpec], sequence: Sequence
) -> None:
    """The run goes on, the frame scores 0 and the row is marked."""
    run = run_one(Job(bad(name), sequence))
    assert run.status == reason
    assert mean_iou(run, sequence) == pytest.approx((sum(STATIC) - STATIC[2]) / len(STATIC))


@pytest.mark.parametrize("name", ["Numpy", "Shut"])
def test_a_tracker_with_bad_manners_goes_through(
    name: str, bad: Callable[..., TrackerSpec], sequence: Sequence
) -> None:
    """Numbers of NumPy are numbers; a tracker that shuts its own standard output does not shut ours."""
    run = run_one(Job(bad(name), sequence))
    assert run.status == COMPLETED
    assert mean_iou(run, sequence) == pytest.approx(np.mean(STATIC))


def test_an_endless_box_is_ended(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """A box that never ends is eaten until the limit of memory."""
    run = run_one(Job(bad("Endless"), sequence), limits=Limits(seconds=60.0, megabytes=300.0))
    assert run.status == "used more than 300 MB of memory at frame 3"


def test_a_tracker_that_stops_itself_is_ended(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """A stopped process cannot be asked to end, and is ended."""
    assert run_one(Job(bad("Stop"), sequence), limits=Limits(seconds=2.0)).status == "timed out after 2 s at frame 3"


def test_a_tracker_that_prints_without_end_is_ended(
    bad: Callable[..., TrackerSpec], sequence: Sequence, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it prints goes to the disk, which is not its own."""
    monkeypatch.setattr(protocol, "_PRINTED_MEGABYTES", 0.5)
    assert run_one(Job(bad("Talkative"), sequence)).status == "printed more than 0.5 MB at frame 3"


def test_a_relative_data_set_survives_a_tracker_that_goes_elsewhere(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where a data set lies is said once, from where the command was given."""
    monkeypatch.chdir(tmp_path)
    (relative,) = load_dataset("otb:data/tiny")
    run = run_one(Job(bad("Wanderer"), relative))
    assert run.status == COMPLETED
    assert mean_iou(run, sequence) == pytest.approx(np.mean(STATIC))


def test_data_sets_of_one_name_keep_their_results_apart(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """Same folder name, same sequence names, other truth: neither overwrites or reuses anything of the other."""
    other = tmp_path / "elsewhere" / "data"
    shutil.copytree(tmp_path / "data", other)
    (other / "tiny" / "groundtruth_rect.txt").write_text("1,1,30,30\n" * COUNT)
    out, words = tmp_path / "out", ["run", "--trackers", "bad_trackers:Fine", "--jobs", "1", "--out"]
    for _ in range(2):
        for data in (tmp_path / "data", other):
            assert main([*words, str(out), "--dataset", f"otb:{data}"]) == 0
    places = {path.parent.name: json.loads(path.read_text())["place"] for path in out.glob("*/run.json")}
    assert len(places) == 2
    assert places["otb-data"] == f"otb:{(tmp_path / 'data').resolve()}"
    boxes = [Folder(out / name).read_sequences()[0].boxes[0].tolist() for name in sorted(places)]
    assert boxes == [[10, 10, 20, 10], [0, 0, 30, 30]]
    for name in places:
        assert [run.status for run in Folder(out / name).read_runs()] == [COMPLETED]


def test_names_that_look_alike_as_files_do_not_share_one(tmp_path: Path) -> None:
    """What a file system does not take is replaced, and told apart."""
    folder = Folder(tmp_path)
    names = ["a b", "a_b", "a/b", "a:b", "a"]
    assert len({folder.run_path("t", name, 0, 0) for name in names}) == len(names)
    assert folder.run_path("TrackerHS", "a_b", 0, 0).name == "a_b.s0r0.json"


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("plug:mak", "cannot load 'plug:mak': module 'plug' has no attribute 'mak'"),
        ("plug:NUMBER", "expected pkg.module:factory, got 'plug:NUMBER', which cannot be called"),
        ("broken:make", "cannot load 'broken:make': No module named 'nowhere'"),
    ],
)
@pytest.mark.parametrize("timed", [False, True])
def test_a_mistyped_factory_is_found_before_anything_is_run(
    name: str, message: str, timed: bool, sequence: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It is an error of the command, and no row in which a tracker fails; known trackers beside it do not run."""
    (tmp_path / "plug.py").write_text("NUMBER = 3\ndef make(): ...\n")
    (tmp_path / "broken.py").write_text("import nowhere\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    specs = [find_tracker("Static"), find_tracker(name)]
    folder, done = Folder(tmp_path / "out"), []
    expected = re.escape(f"the tracker {name!r} cannot be used: it raised ValueError: {message}")
    start = (
        partial(measure_speed, specs, [sequence])
        if timed
        else partial(run_jobs, make_jobs(specs, [sequence]), workers=1)
    )
    with pytest.raises(ValueError, match=expected):
        start(folder, report=lambda run, *_: done.append(run))
    assert done == []


@pytest.mark.skipif(not available(), reason="this kernel keeps no process from files")
def test_weights_that_a_parameter_names_can_be_read(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """What the user gives to a tracker is the tracker's; what lies beside it is not."""
    for name in ("weights.bin", "secret.bin"):
        (tmp_path / name).write_bytes(b"w")
    given = bad("Weights", model=str(tmp_path / "weights.bin"))
    assert run_one(Job(given, sequence)).status == COMPLETED
    kept = bad("Weights", model="weights.bin", other=str(tmp_path)[1:] + "/secret.bin")
    assert run_one(Job(kept, sequence)).status.startswith("raised PermissionError")


def test_where_the_kernel_keeps_nothing_from_anyone_a_run_says_so(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without Landlock a run is the same, and its provenance is not."""
    monkeypatch.setattr("eval.sandbox._version", lambda: 0)
    folder = Folder(tmp_path / "results")
    run_jobs(make_jobs([bad("Fine")], [sequence]), folder, workers=1, report=collect([]))
    run = folder.read_run(folder.run_path("Fine", "tiny", 0, 0))
    assert (run.status, run.provenance["isolation"]) == (COMPLETED, "paths not told")


def test_a_tracker_that_ends_late_is_not_waited_for(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """All its answers count, and what it has left running ends with its process."""
    run = run_one(Job(bad("Linger"), sequence), limits=Limits(seconds=20.0))
    assert run.status == COMPLETED
    assert run.trajectory.ok.all()


def gone(number: int) -> bool:
    """Whether a process ends within a few seconds."""
    deadline = time.monotonic() + 10.0
    while psutil.pid_exists(number) and psutil.Process(number).status() != psutil.STATUS_ZOMBIE:
        if time.monotonic() > deadline:
            return False
        time.sleep(0.02)
    return True


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="orphans are ours on Linux only")
@pytest.mark.parametrize("name", ["Children", "Daemon", "DoubleDaemon", "DaemonCrash"])
def test_processes_of_a_tracker_end_with_it(
    name: str, bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """In a session of their own, orphaned, with our pipes open, its process crashed: all are gone after the run."""
    diary = tmp_path / "diary"
    diary.touch()
    spec, limits = bad(name, path=str(diary)), Limits(paths=(str(diary),))
    status = run_one(Job(spec, sequence), limits=limits).status
    assert status == ("crashed (SIGSEGV) at frame 3" if name == "DaemonCrash" else COMPLETED)
    assert gone(int(diary.read_text()))


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork on this system")
def test_the_limits_hold_for_all_processes_of_a_tracker(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """Memory is that of all together, in whatever session, and so is their number."""
    limits = Limits(seconds=60.0, megabytes=300.0, processes=20)
    run = run_one(Job(bad("HiddenMemory"), sequence), limits=limits)
    assert run.status == "used more than 300 MB of memory at frame 3"
    run = run_one(Job(bad("Crowd"), sequence), limits=limits)
    assert run.status == "started more than 20 processes at frame 3"


@pytest.mark.parametrize(
    ("deaths", "status", "updates"),
    [(2, COMPLETED, COUNT - 1), (99, "was killed (SIGKILL) at frame 3", 2)],
)
def test_a_process_killed_from_outside_is_started_again(
    deaths: int, status: str, updates: int, bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """The out-of-memory killer, a person: the job is run again; a tracker that always dies so is charged."""
    diary = tmp_path / "diary"
    diary.touch()
    spec = bad("Killed", path=str(diary), deaths=deaths)
    run = run_one(Job(spec, sequence), limits=Limits(paths=(str(diary),)))
    assert run.status == status
    assert run.trajectory.ok.sum() == updates + 1
    assert len(diary.read_text()) == min(deaths, 3)


def test_what_is_written_among_the_answers_is_noticed(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """A tracker that writes into files that are not its own loses its row, and nobody else loses anything."""
    found: list[SpeedRun] = []
    assert run_one(Job(bad("Scribble"), sequence)).status == "wrote among its own answers at frame 3"
    specs = [bad("Fine"), bad("Scribble")]
    measure_speed(
        specs, [sequence], Folder(tmp_path / "results"), warm_up=1, report=lambda run, reused: found.append(run)
    )
    assert found[0].status == {"Fine": COMPLETED, "Scribble": "wrote among its own answers"}
    assert len(found[0].milliseconds["Fine"]) == COUNT - 2


def test_a_tracker_that_hangs_is_ended(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """The limit holds, and what was answered before it counts."""
    run = run_one(Job(bad("Hang"), sequence), limits=Limits(seconds=5.0))
    assert run.status == "timed out after 5 s at frame 3"
    assert run.trajectory.ok.tolist() == [True, True, True, False, False, False]


@pytest.mark.parametrize(
    "name",
    [
        "Memory",
        "SharedMemory",
        pytest.param(
            "MemoryFile", marks=pytest.mark.skipif(not hasattr(os, "memfd_create"), reason="files of Linux's")
        ),
    ],
)
def test_a_tracker_that_eats_memory_is_ended(name: str, bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """It ends at its own limit and not at that of the machine."""
    run = run_one(Job(bad(name), sequence), limits=Limits(seconds=60.0, megabytes=400.0))
    assert run.status == "used more than 400 MB of memory at frame 3"


@pytest.mark.skipif(not available(), reason="this kernel cannot keep a process from files")
def test_a_tracker_leaves_no_files_in_memory(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """What lies in /dev/shm is nobody's memory, and would stay when the tracker has ended."""
    assert "Permission denied: '/dev/shm/hs_eval-test'" in run_one(Job(bad("SharedFolder"), sequence)).status


@pytest.mark.skipif(
    not sys.platform.startswith("linux") or os.uname().machine not in {"x86_64", "aarch64"}, reason="of Linux"
)
def test_a_tracker_leaves_no_memory_of_system_v(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """It belongs to no process, so that no limit counts it, and would stay when the tracker has ended."""
    run = run_one(Job(bad("Lasting"), sequence))
    assert "none was made" in run.status


def test_what_a_tracker_prints_is_no_record(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """Standard output belongs to the tracker; the records have a way of their own."""
    run = run_one(Job(bad("Chatty"), sequence))
    assert run.status == COMPLETED
    assert run.trajectory.ok.all()


def test_a_tracker_gets_frames_and_whole_numbers(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """Frame t arrives as update t, undamaged by what was done to earlier ones, with Python ints at the start."""
    run = run_one(Job(bad("Witness"), sequence))
    assert run.trajectory.boxes[1:].tolist() == [[10.0 * index, 2.0, 48.0, 64.0] for index in range(1, COUNT)]


def test_scores_are_recorded_and_minus_one_is_none(bad: Callable[..., TrackerSpec], sequence: Sequence) -> None:
    """``getTrackingScore`` is kept per frame; OpenCV's −1 means that there is no score."""
    score = run_one(Job(bad("Scoring"), sequence)).trajectory.score
    np.testing.assert_array_equal(score, [np.nan, 0.25, np.nan, 0.75, 1.0, 1.25])


def test_the_oracle_scores_one_and_the_static_box_its_closed_form(sequence: Sequence) -> None:
    """The referee is itself refereed: both ends of its scale are where they must be."""
    oracle, static = (run_one(Job(TRACKERS[name], sequence)) for name in ("Oracle", "Static"))
    assert mean_iou(oracle, sequence) == 1.0
    assert mean_iou(static, sequence) == pytest.approx(np.mean(STATIC))


def test_masks_and_rotated_boxes_are_taken_down(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """As regions beside the box round them, and come back from the file; a mask of another size costs the run."""
    folder = Folder(tmp_path / "results")
    folder.write_manifest("test", [sequence])
    run_jobs(make_jobs([bad("Shaped")], [sequence]), folder, workers=1, report=collect([]))
    (run,) = folder.read_runs()
    width, height = sequence.size
    assert run.status == f"raised ValueError: getMask returned shape (3, 4), expected ({height}, {width}) at frame 5"
    assert run.trajectory.regions[:2] == ("", "")
    assert run.trajectory.regions[2] == "10.0,15.0,15.0,10.0,20.0,15.0,15.0,20.0"
    corners = np.array(run.trajectory.regions[3].split(","), dtype=float).reshape(4, 2)
    assert sorted(corners.round(4).tolist()) == [[10, 15], [15, 10], [15, 20], [20, 15]]
    np.testing.assert_allclose(run.trajectory.boxes[2:4], [[10, 10, 10, 10]] * 2, atol=1e-5)
    assert run.trajectory.regions[4:] == ("m20,10,3,2,0,6", "")


def test_the_oracle_is_no_default() -> None:
    """What sees the truth runs only when it is named."""
    assert "Oracle" not in DEFAULT_TRACKERS
    assert "Static" in DEFAULT_TRACKERS


def test_the_oracle_scores_exactly_one(sequence: Sequence, tmp_path: Path) -> None:
    """Truth of any binary fraction goes to its process, into its file and back without losing a bit."""
    rng = np.random.default_rng(5)
    boxes = np.concatenate([rng.uniform(5, 20, (COUNT, 2)), rng.uniform(8, 20, (COUNT, 2))], axis=1)
    visibility = np.array([1.0, 0.3, 0.0, 0.0, 1.0, 0.7])
    mask, corners = Mask(12, 13, rng.random((9, 7)) < 0.5).text, polygon_text([9.1, 8, 20, 11, 18, 21, 8.3, 19])
    exact = replace(sequence, boxes=boxes, visibility=visibility, regions=("", mask, mask, "", "", corners))
    boxes[5] = region_box(read_region(corners))
    folder = Folder(tmp_path / "results")
    folder.write_manifest("test", [exact])
    run_jobs(make_jobs([TRACKERS["Oracle"]], [exact]), folder, workers=1, report=collect([]))
    (run,), (truth,) = folder.read_runs(), folder.read_sequences()
    scores = summarise(score_answers(truth, run.trajectory))
    ones = ("mean_iou", "mask_iou", "rotated_iou", "auc", "sr50", "sr75", "precision20", "normalised_precision")
    assert [scores[name] for name in ones] == [1.0] * len(ones)
    assert (scores["false_true"], scores["false_false"]) == (0.0, 0.0)


def test_start_boxes_are_perturbed_alike_for_all_and_stay_inside(sequence: Sequence) -> None:
    """Start 0 is exact, others differ from it by at most a tenth and the rounding, and are the same every time."""
    assert start_box(sequence, 0) == (10, 10, 20, 10)
    boxes = [start_box(sequence, start) for start in range(1, 30)]
    assert boxes == [start_box(sequence, start) for start in range(1, 30)]
    assert len(set(boxes)) > 10
    for x, y, w, h in boxes:
        assert abs(x + w / 2 - 20) <= 3.0
        assert abs(y + h / 2 - 15) <= 2.0
        assert abs(w - 20) <= 3
        assert abs(h - 10) <= 2


def test_a_start_box_is_cut_by_the_frame(sequence: Sequence) -> None:
    """cv2's MIL and KCF die of a box that reaches outside: nobody gets one."""
    boxes = sequence.boxes.copy()
    boxes[0] = (-8.0, 40.0, 20.0, 30.0)
    assert start_box(replace(sequence, boxes=boxes), 0) == (0, 40, 12, 8)


def collect(runs: list[tuple[Run, bool, str]]) -> Callable[[Run, bool, str], None]:
    """Report function that gathers."""
    return lambda run, reused, note: runs.append((run, reused, note))


def test_nothing_is_run_twice(bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path) -> None:
    """A stored result is reused until tracker, parameters, code or sequence change."""
    folder = Folder(tmp_path / "results")

    def reused(spec: TrackerSpec, sequence: Sequence) -> bool:
        runs: list[tuple[Run, bool, str]] = []
        run_jobs(make_jobs([spec], [sequence]), folder, workers=1, report=collect(runs))
        return runs[0][1]

    assert not reused(bad("Fine"), sequence)
    assert reused(bad("Fine"), sequence)
    assert not reused(bad("Fine", gain=2), sequence)
    assert not reused(bad("Fine"), sequence)
    assert not reused(bad("Fine"), sequence.cut(4))
    assert not reused(bad("Fine"), sequence)
    (tmp_path / "bad_trackers.py").write_text(BAD_TRACKERS + "\n# changed\n")
    assert not reused(bad("Fine"), sequence)


def test_failures_are_run_again_on_request_only(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """A failure is a result; ``retry_failed`` gives it another chance."""
    folder = Folder(tmp_path / "results")
    for retry, expected in ((False, False), (False, True), (True, False)):
        runs: list[tuple[Run, bool, str]] = []
        jobs = make_jobs([bad("Raise")], [sequence])
        run_jobs(jobs, folder, workers=1, retry_failed=retry, report=collect(runs))
        assert runs[0][1] is expected


def test_a_damaged_result_is_said_and_run_again(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """A file that was cut off is named, replaced, and never silently part of a table."""
    folder = Folder(tmp_path / "results")
    jobs = make_jobs([bad("Fine")], [sequence])
    run_jobs(jobs, folder, workers=1, report=collect([]))
    path = folder.run_path("Fine", "tiny", 0, 0)
    path.write_text(path.read_text()[:50])
    folder.write_manifest("test", [sequence])
    with pytest.raises(ResultsError, match=r"tiny\.s0r0\.json is damaged"):
        folder.read_runs()
    runs: list[tuple[Run, bool, str]] = []
    run_jobs(jobs, folder, workers=1, report=collect(runs))
    assert "is damaged" in runs[0][2]
    assert not runs[0][1]
    assert folder.read_runs()[0].status == COMPLETED


def test_a_result_of_a_newer_version_is_said(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """It is called newer and not damaged, in any kind of file; a run replaces it and says so."""
    folder = Folder(tmp_path / "results")
    jobs = make_jobs([bad("Fine")], [sequence])
    run_jobs(jobs, folder, workers=1, report=collect([]))
    measure_speed([bad("Fine")], [sequence], folder, report=lambda run, reused: None)
    folder.write_manifest("test", [sequence])
    path, readers = (
        folder.run_path("Fine", "tiny", 0, 0),
        (folder.read_runs, folder.read_speeds, folder.read_manifest),
    )
    for file, read in zip((path, folder.speed_path("tiny"), folder.path / "run.json"), readers, strict=True):
        before = file.read_text()
        file.write_text(json.dumps({"format": 2, "shape": "new"}))
        with pytest.raises(ResultsError, match=rf"{file.name} was written by a newer version of eval \(format 2"):
            read()
        file.write_text(before)
        assert read()
    path.write_text(json.dumps({**json.loads(path.read_text()), "format": 2}))
    runs: list[tuple[Run, bool, str]] = []
    run_jobs(jobs, folder, workers=1, report=collect(runs))
    assert "newer version" in runs[0][2]
    assert not runs[0][1]
    assert folder.read_runs()[0].status == COMPLETED


def test_a_full_disk_is_a_clear_message(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The error names the file and the reason, and nothing half written stays."""
    folder = Folder(tmp_path / "results")

    def full(self: Path, *_: object, **__: object) -> int:
        raise OSError(28, "No space left on device")

    jobs = make_jobs([bad("Fine")], [sequence])
    with monkeypatch.context() as patch:
        # The commands of the worker are written to a temporary file by the same method: fail for results only.
        write = Path.write_text
        patch.setattr(
            Path, "write_text", lambda self, *a, **k: full(self) if "results" in self.parts else write(self, *a, **k)
        )
        with pytest.raises(ResultsError, match=r"tiny\.s0r0\.json: No space left on device"):
            run_jobs(jobs, folder, workers=2, report=collect([]))
    assert [path.name for path in (tmp_path / "results").rglob("*.*")] == []


def test_a_tracker_that_leaves_with_the_workers_own_code_costs_its_row(
    bad: Callable[..., TrackerSpec], sequence: Sequence
) -> None:
    """An exit code is the tracker's, whatever it is."""
    assert run_one(Job(bad("LeaveFull"), sequence)).status == "ended its process with code 74 at frame 3"


@pytest.mark.parametrize(
    ("number", "code", "said"),
    [(signal.SIGINT, 130, "interrupted"), (signal.SIGTERM, 130, "interrupted"), (signal.SIGKILL, -9, "")],
)
def test_an_interrupted_run_goes_on(
    number: signal.Signals,
    code: int,
    said: str,
    bad: Callable[..., TrackerSpec],
    sequence: Sequence,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Ctrl-C, kill, even kill -9: what was finished is stored and not run again, and the rest is run then."""
    flag = tmp_path / "flag"
    flag.touch()
    command = [sys.executable, "-m", "eval", "run", "--dataset", f"otb:{tmp_path / 'data'}", "--out", str(tmp_path)]
    command += ["--trackers", "bad_trackers:Fine", "bad_trackers:Patient"]
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    environment = {**os.environ, "PYTHONPATH": str(tmp_path), "HANG_WHILE": str(flag), "TMPDIR": str(scratch)}
    # A shell's background job ignores Ctrl-C and would hand that down to the command.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(command, cwd=ROOT, env=environment, stderr=subprocess.PIPE, text=True)
    signal.signal(signal.SIGINT, before)
    stored = tmp_path / "otb-data" / "tracks"
    try:
        deadline = time.monotonic() + 240.0
        workers: list[psutil.Process] = []
        while not (list(stored.glob("*Fine-*/*.json")) and workers) and time.monotonic() < deadline:
            time.sleep(0.05)
            workers = psutil.Process(process.pid).children(recursive=True)
        process.send_signal(number)
        _, message = process.communicate(timeout=240.0)
        assert all(gone(worker.pid) for worker in workers)
        while list(scratch.glob("hs_eval-*")) and time.monotonic() < deadline + 60.0:
            time.sleep(0.05)
        assert not list(scratch.glob("hs_eval-*"))
    finally:
        process.kill()
    assert process.returncode == code
    assert said in message
    (finished,) = stored.glob("*/*.json")
    assert finished.parent.name.startswith("bad_trackers_Fine-")
    written = finished.stat().st_mtime_ns
    flag.unlink()
    monkeypatch.setenv("HANG_WHILE", str(flag))
    assert main([*command[3:], "--jobs", "1"]) == 0
    assert finished.stat().st_mtime_ns == written
    folder = Folder(tmp_path / "otb-data")
    assert {run.tracker: run.status for run in folder.read_runs()} == {
        "bad_trackers:Fine": COMPLETED,
        "bad_trackers:Patient": COMPLETED,
    }


def test_a_cancelled_job_is_not_recorded(bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path) -> None:
    """When one job cannot be stored, the others end too, and none of them is taken for a failure of its tracker."""
    folder = Folder(tmp_path / "results")
    jobs = make_jobs([bad("Fine"), bad("Hang")], [sequence])

    def stop(run: Run, reused: bool, note: str) -> None:
        raise KeyboardInterrupt

    start = threading.active_count()
    with pytest.raises(KeyboardInterrupt):
        run_jobs(jobs, folder, workers=2, limits=Limits(seconds=60.0), report=stop)
    assert not folder.run_path("Hang", "tiny", 0, 0).exists()
    assert threading.active_count() <= start + 4


def test_repeats_and_starts_are_jobs_of_their_own(sequence: Sequence) -> None:
    """MIL runs three times from the exact box and once from each perturbed one."""
    jobs = make_jobs([TRACKERS["MIL"], TRACKERS["CSRT"]], [sequence], starts=2)
    found = [(job.tracker.name, job.start, job.repeat) for job in jobs]
    mil = [("MIL", 0, 0), ("MIL", 0, 1), ("MIL", 0, 2), ("MIL", 1, 0), ("MIL", 2, 0)]
    assert found == [*mil, ("CSRT", 0, 0), ("CSRT", 1, 0), ("CSRT", 2, 0)]
    assert len({job.key("v") for job in jobs if job.tracker.name == "MIL"}) == 5


def test_names_are_looked_up_and_unknown_ones_list_the_known() -> None:
    """A plugin is ``pkg.module:factory``; anything else must be in the table."""
    assert find_tracker("CSRT") is TRACKERS["CSRT"]
    assert find_tracker("eval.baselines.known:Static").factory == "eval.baselines.known:Static"
    with pytest.raises(ValueError, match=r"unknown tracker 'CSTR'; known: TrackerHS, CSRT"):
        find_tracker("CSTR")
    with pytest.raises(ValueError, match="cannot find the module 'no_such_package'"):
        find_tracker("no_such_package:make")


def test_the_version_follows_source_and_parameters(bad: Callable[..., TrackerSpec], tmp_path: Path) -> None:
    """Only what the answers depend on changes the key."""
    before = code_version(bad("Fine"))
    assert code_version(bad("Fine")) == before
    assert code_version(bad("Fine", rate=0.1)) != before
    (tmp_path / "bad_trackers.py").write_text(BAD_TRACKERS + "\n")
    assert code_version(bad("Fine")) != before


def test_everything_that_answers_depend_on_is_in_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every tracker of the table names its sources; versions of libraries, and what runs it, count for all."""
    before = {name: code_version(spec) for name, spec in TRACKERS.items()}
    assert len(set(before.values())) == len(before)
    read_bytes = Path.read_bytes

    def edited(name: str) -> set[str]:
        with monkeypatch.context() as patch:
            patch.setattr(Path, "read_bytes", lambda path: read_bytes(path) + b"#" * (path.name == name))
            return {key for key, spec in TRACKERS.items() if code_version(spec) != before[key]}

    ours = {"CSRT", "KCF", "KCF-primed", "MIL", "MOSSE", "MedianFlow"}
    assert edited("opencv.py") == ours | {"TrackerNano", "TrackerVit", "TrackerVit-normalised", "DaSiamRPN"}
    assert edited("known.py") == {"Static", "Oracle"}
    assert edited("regions.py") == {"FrameDifferencing", "BackgroundModel", "Oracle"}
    assert "TrackerHS" in edited("tracker.py")
    assert edited("track.py") == set(TRACKERS)
    monkeypatch.setattr("eval.trackers.version", lambda name: "99")
    assert all(code_version(spec) != before[name] for name, spec in TRACKERS.items())


def test_a_compiled_extension_is_in_the_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A library that is compiled anew is another one, though no line of Python has changed."""
    (tmp_path / "compiled_tracker").mkdir()
    (tmp_path / "compiled_tracker" / "__init__.py").write_text("")
    (tmp_path / "compiled_tracker" / "_native.abi3.so").write_bytes(b"one")
    monkeypatch.syspath_prepend(str(tmp_path))
    spec = find_tracker("compiled_tracker:make")
    before = code_version(spec)
    (tmp_path / "compiled_tracker" / "_native.abi3.so").write_bytes(b"two")
    assert code_version(spec) != before


@pytest.fixture
def trusted(monkeypatch: pytest.MonkeyPatch) -> None:
    """Times are not doubted, so that none is when the machine is busy: that they are is test_eval_process's."""
    monkeypatch.setattr("eval.clock._SLACK_MS", 60_000.0)


@pytest.mark.usefixtures("trusted")
def test_speed_is_measured_side_by_side_and_survives(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """Each tracker gets its times; one that dies is marked and the others go on; the second call measures nothing."""
    folder = Folder(tmp_path / "results")
    specs = [bad(name) for name in ("Fine", "Segfault", "Raise", "FailingInit", "Memory", "Glutton")]
    found: list[tuple[SpeedRun, bool]] = []
    for _ in range(2):
        measure_speed(
            specs,
            [sequence],
            folder,
            frames=4,
            warm_up=1,
            limits=Limits(megabytes=300.0),
            report=lambda run, reused: found.append((run, reused)),
        )
    (first, reused), (_, again) = found
    assert (reused, again) == (False, True)
    assert len(first.milliseconds.pop("Glutton")) in (2, 3, 4)  # its memory is looked at now and then
    assert {name: len(times) for name, times in first.milliseconds.items()} == {
        "Fine": 4,
        "Segfault": 1,
        "Raise": 1,
        "FailingInit": 0,
        "Memory": 1,
    }
    assert all(value >= 0 for value in first.milliseconds["Fine"])
    assert first.status["Fine"] == COMPLETED
    assert first.status["Segfault"] == "crashed (SIGSEGV)"
    assert first.status["Raise"].startswith("raised RuntimeError")
    assert first.status["Memory"] == first.status["Glutton"] == "used more than 300 MB of memory"
    assert json.loads(folder.speed_path("tiny").read_text())["provenance"]["opencv"] == cv2.__version__


@pytest.mark.usefixtures("trusted")
def test_a_tracker_that_hangs_does_not_hold_up_the_clock(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """It has the time of one update, and keeps those that it was timed for."""
    found: list[SpeedRun] = []
    measure_speed(
        [bad("Hang")],
        [sequence],
        Folder(tmp_path / "results"),
        warm_up=1,
        limits=Limits(seconds=4.0),
        report=lambda run, reused: found.append(run),
    )
    assert found[0].status == {"Hang": "timed out after 4 s"}
    assert len(found[0].milliseconds["Hang"]) == 1


@pytest.mark.usefixtures("trusted")
@pytest.mark.parametrize(
    ("block", "turns"),
    [
        (1, "a1 b1 a2 b2 a3 b3 a4 b4 a5 b5"),
        (3, "a1 b1 a2 a3 a4 b2 b3 b4 a5 b5"),
        (9, "a1 b1 a2 a3 a4 a5 b2 b3 b4 b5"),
    ],
)
def test_trackers_take_turns_of_a_block_of_updates(
    block: int, turns: str, bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """After the updates to warm up, each has its few frames before the next one has the same; none is left out."""
    diary = tmp_path / "diary"
    diary.touch()
    specs = [replace(bad("Diary", label=name, path=str(diary)), name=name) for name in "ab"]
    found: list[SpeedRun] = []
    measure_speed(
        specs,
        [sequence],
        Folder(tmp_path / "results"),
        frames=40,
        warm_up=1,
        block=block,
        limits=Limits(paths=(str(diary),)),
        report=lambda run, reused: found.append(run),
    )
    assert diary.read_text().split() == turns.split()
    assert [len(times) for times in found[0].milliseconds.values()] == [4, 4]
    assert found[0].provenance["block"] == block


@pytest.mark.usefixtures("trusted")
def test_times_of_another_protocol_are_not_reused(
    bad: Callable[..., TrackerSpec], sequence: Sequence, tmp_path: Path
) -> None:
    """Turns of another length are another measurement, and take the place of the stored one."""
    folder, reused = Folder(tmp_path / "results"), []
    for block in (2, 1, 1, 2):
        measure_speed([bad("Fine")], [sequence], folder, block=block, report=lambda run, again: reused.append(again))
    assert reused == [False, False, True, False]


def test_a_turn_without_updates_is_refused(sequence: Sequence, tmp_path: Path) -> None:
    """The error says what was asked for."""
    with pytest.raises(ValueError, match="at least one update, got 0"):
        measure_speed([], [sequence], Folder(tmp_path), block=0, report=lambda run, reused: None)


def test_a_library_that_is_not_built_is_one_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Not a run of TrackerHS that scores 0: nothing is stored."""
    monkeypatch.setitem(sys.modules, "hs_tracker_cv._native", None)
    words = ["run", "--suite", "smoke", "--trackers", "TrackerHS", "--out", str(tmp_path / "out")]
    assert main(words) == 1
    assert "hs_tracker_cv._native" in capsys.readouterr().err
    assert not list((tmp_path / "out").rglob("tracks/*"))
