"""Side by side, in batches, on a cluster, in shards: the same results, and what is killed costs time only."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from eval import accuracy
from eval.__main__ import main
from eval.accuracy import Job, Keyed, make_jobs, run_jobs, run_one
from eval.framesource import FrameSource
from eval.process import Limits
from eval.results import COMPLETED, Folder, ResultsError, Run
from eval.scheduling import in_parallel
from eval.sequences import Sequence
from eval.trackers import TrackerSpec, find_tracker

ROOT = Path(__file__).parents[1]

pytestmark = pytest.mark.once

ODD_TRACKERS = '''
import os, random
import cv2, numpy as np

LIVES = 0

class Fine:
    """Moves by chance; says in which process."""
    def __init__(self, diary=""):
        global LIVES
        LIVES += 1
        self.diary = diary
    def init(self, image, box):
        self.box = np.array(box, float)
        if self.diary:
            with open(self.diary + "/diary", "a") as file:
                file.write(f"{os.getpid()}\\\\n")
    def update(self, image):
        noise = np.zeros((1, 2))
        cv2.randu(noise, -1, 1)
        self.box[:2] += noise[0] + np.random.uniform(-1, 1, 2) + random.uniform(-1, 1) + image[0, 0, 0] / 100
        return True, tuple(self.box)

class Hoarder(Fine):
    """Bears only one life per process."""
    def update(self, image):
        if LIVES > 1:
            raise MemoryError("full")
        return True, (1, 1, 5, 5)
'''


@pytest.fixture
def odd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., TrackerSpec]:
    """Specs of trackers that remember."""
    (tmp_path / "odd_trackers.py").write_text(ODD_TRACKERS.replace("\\\\", "\\"))
    monkeypatch.syspath_prepend(str(tmp_path))

    def spec(name: str, **params: Any) -> TrackerSpec:
        return TrackerSpec(name, f"odd_trackers:{name}", params=params, sources=("odd_trackers",))

    return spec


def make_sequences(folder: Path, count: int, frames: int = 4) -> list[Sequence]:
    """Sequences of a few gray frames with one level each."""
    boxes = np.tile([10.0, 10.0, 12.0, 12.0], (frames, 1))
    found = []
    for number in range(count):
        path = folder / "data" / f"{number}.npy"
        path.parent.mkdir(exist_ok=True)
        np.save(path, np.full((frames, 48, 64, 3), number, np.uint8))
        source = FrameSource((str(path),), "array", frames)
        found.append(Sequence(f"s{number}", source, boxes, np.ones(frames), (), (64, 48), f"d{number}"))
    return found


def bytes_of(folder: Folder) -> dict[str, str]:
    """Every stored run, without what says where and when."""
    found = {}
    for path in sorted((folder.path / "tracks").rglob("*.json")):
        data = json.loads(path.read_text())
        for name in ("time", "load"):
            del data["provenance"][name]
        found[str(path.relative_to(folder.path))] = json.dumps(data)
    return found


def quiet(run: Run, reused: bool, note: str) -> None:
    """Report nothing."""


def test_one_process_serves_many_sequences(odd: Callable[..., TrackerSpec], tmp_path: Path) -> None:
    """One for each batch; from another start box another one, which has not seen the sequences."""
    diary = tmp_path / "notes" / "diary"  # its folder is the parameter: the bytes of a file would be part of the key
    diary.parent.mkdir()
    jobs = make_jobs([odd("Fine", diary=str(diary.parent))], make_sequences(tmp_path, 4), starts=1)
    run_jobs(jobs, Folder(tmp_path / "out"), workers=1, report=quiet)
    processes = diary.read_text().split()
    assert len(processes) == 8
    assert len(set(processes)) == len(accuracy._batched([Keyed(job, "") for job in jobs], 1)) == 4


def test_batches_keep_sequences_apart_and_together(tmp_path: Path, odd: Callable[..., TrackerSpec]) -> None:
    """No batch has a sequence twice or two trackers; early ones are about early sequences; all jobs are in one."""
    specs = [odd("Fine"), odd("Hoarder")]
    sequences = make_sequences(tmp_path, 9)
    jobs = [Keyed(job, str(n)) for n, job in enumerate(make_jobs(specs, sequences, starts=2))]
    batches = accuracy._batched(jobs, 1)
    assert sorted(one.key for batch in batches for one in batch) == sorted(one.key for one in jobs)
    for batch in batches:
        assert len({one.job.sequence.name for one in batch}) == len(batch)
        assert len({(one.job.tracker.name, one.job.start, one.job.repeat) for one in batch}) == 1
    assert max(map(len, batches)) == 9
    first = [batch[0].job.sequence.name for batch in accuracy._batched(jobs, 4)]
    assert len(first) > len(batches)
    assert first == sorted(first)


def test_what_was_served_before_changes_nothing(odd: Callable[..., TrackerSpec], tmp_path: Path) -> None:
    """The same dice for every sequence, in any process; a failure that may be another's fault is tried afresh."""
    sequences = make_sequences(tmp_path, 3)
    for name in ("Fine", "Hoarder"):
        alone = [run_one(Job(odd(name), sequence)) for sequence in sequences]
        together = Folder(tmp_path / name)
        run_jobs(make_jobs([odd(name)], sequences), together, workers=1, report=quiet)
        for run in alone:
            stored = together.read_run(together.run_path(name, run.sequence, 0, 0))
            assert stored.status == run.status == COMPLETED
            np.testing.assert_array_equal(stored.trajectory.boxes, run.trajectory.boxes)


def kill_once(task: Path, stop: threading.Event) -> int:
    """Die by a kill from outside the first time."""
    if not task.exists():
        task.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return int(task.name)


def kill_always(task: int, stop: threading.Event) -> int:
    """Die every time."""
    os.kill(os.getpid(), signal.SIGKILL)
    return task


def test_a_killed_worker_costs_time_only(tmp_path: Path) -> None:
    """What it had not handed back is done again; who always dies is said to."""
    (tmp_path / "0").touch()
    tasks = [tmp_path / str(number) for number in range(2)]
    assert sorted(in_parallel(kill_once, tasks, workers=2)) == [0, 1]
    with pytest.raises(ResultsError, match="workers were killed 3 times"):
        list(in_parallel(kill_always, [1, 2], workers=2))


def test_in_processes_and_here_give_the_same_bytes(odd: Callable[..., TrackerSpec], tmp_path: Path) -> None:
    """One process or two."""
    jobs = make_jobs([odd("Fine"), find_tracker("Static")], make_sequences(tmp_path, 5))
    folders = [Folder(tmp_path / f"out{workers}") for workers in (1, 2)]
    for workers, folder in zip((1, 2), folders, strict=True):
        run_jobs(jobs, folder, workers=workers, report=quiet)
    assert bytes_of(folders[0]) == bytes_of(folders[1])
    assert len(bytes_of(folders[0])) == 10


@pytest.mark.filterwarnings("ignore")
def test_a_cluster_gives_the_same_bytes_and_survives_a_kill(odd: Callable[..., TrackerSpec], tmp_path: Path) -> None:
    """Two workers of Dask's, one of which is killed in the middle."""
    distributed = pytest.importorskip("distributed")
    jobs = make_jobs([odd("Fine"), find_tracker("Static")], make_sequences(tmp_path, 6))
    here, there = Folder(tmp_path / "here"), Folder(tmp_path / "there")
    run_jobs(jobs, here, workers=1, report=quiet)
    killed: list[int] = []
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            numbers = list(client.run(os.getpid).values())

        def report(run: Run, reused: bool, note: str) -> None:
            if not killed:
                killed.append(numbers[0])
                os.kill(numbers[0], signal.SIGKILL)

        run_jobs(jobs, there, workers=2, dask=cluster.scheduler_address, report=report)
    assert killed
    assert bytes_of(here) == bytes_of(there)


@pytest.mark.parametrize("busy", [True, False])
def test_a_worker_whose_runner_has_ended_ends(busy: bool, tmp_path: Path) -> None:
    """Told before its task or without one, it neither goes on for nobody, nor leaves the runner's folder behind."""
    gone = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    scratch, told = tmp_path / "scratch", tmp_path / "told"
    scratch.mkdir()
    worker = f"""
import time
from pathlib import Path
from eval.scheduling import _Home, _elsewhere, _leave_with
def work(task, stop):
    stop.wait(100)
    Path({str(told)!r}).write_text(task)
    stop.wait(0) and time.sleep(100)
_leave_with({int(gone.stdout)})
if {busy}:
    _elsewhere(work, 0, "told", _Home((), {str(scratch)!r}))
time.sleep(100)
"""
    done = subprocess.run([sys.executable, "-c", worker], cwd=ROOT, timeout=90)
    assert done.returncode == 1
    assert (told.read_text() if told.exists() else None) == ("told" if busy else None)
    assert scratch.exists() is not busy


def test_workers_watch_their_runner_before_their_first_task() -> None:
    """Those of a pool that is killed as soon as it has started are gone with it, though they were given nothing."""
    runner = """
import os, signal
from eval.scheduling import in_parallel
def work(task, stop):
    os.kill(os.getppid(), signal.SIGKILL)
    stop.wait(100)
list(in_parallel(work, [1], workers=2))
"""
    done = subprocess.run([sys.executable, "-c", runner], cwd=ROOT, stderr=subprocess.PIPE, timeout=90)
    assert done.returncode == -signal.SIGKILL


def test_without_dask_one_line_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """And how to get it."""
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ResultsError, match="--dask needs Dask: pip install --group cluster"):
        list(in_parallel(kill_always, [1], workers=1, dask="tcp://nowhere:1"))


def test_other_code_on_a_worker_is_refused(
    odd: Callable[..., TrackerSpec], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A result has the key of the code that made it."""
    versions = iter(["here", "there"])
    monkeypatch.setattr(accuracy, "code_version", lambda tracker: next(versions))
    with pytest.raises(ResultsError, match=r"the code of Fine on .* is not what it is where the run was started"):
        run_jobs(make_jobs([odd("Fine")], make_sequences(tmp_path, 1)), Folder(tmp_path), workers=1, report=quiet)


def write_otb(folder: Path, count: int) -> str:
    """A small data set."""
    for number in range(count):
        images = folder / f"s{number}" / "img"
        images.mkdir(parents=True)
        for frame in range(3):
            cv2.imwrite(str(images / f"{frame + 1:04d}.png"), np.full((48, 64), 10 * frame + number, np.uint8))
        (images.parent / "groundtruth_rect.txt").write_text("11,11,20,10\n" * 3)
    return f"otb:{folder}"


def test_shards_merge_to_the_whole(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Three machines and one give the same files; a shard twice adds nothing, and other code is refused."""
    where = write_otb(tmp_path / "data", 5)
    command = ["run", "--dataset", where, "--trackers", "Static", "--jobs", "1", "--out"]
    assert main([*command, str(tmp_path / "whole")]) == 0
    for shard in (1, 2, 3):
        assert main([*command, str(tmp_path / f"part{shard}"), "--shard", f"{shard}/3"]) == 0
    parts = [str(tmp_path / f"part{shard}") for shard in (1, 2, 3)]
    counts = [len(bytes_of(Folder(Path(part) / "otb-data"))) for part in parts]
    assert counts == [2, 2, 1]
    for _ in range(2):
        assert main(["merge", *parts, "--out", str(tmp_path / "merged")]) == 0
    merged, whole = Folder(tmp_path / "merged" / "otb-data"), Folder(tmp_path / "whole" / "otb-data")
    assert bytes_of(merged) == bytes_of(whole)
    assert [one.name for one in merged.read_sequences()] == [f"s{number}" for number in range(5)]
    path = merged.run_path("Static", "s0", 0, 0)
    path.write_text(path.read_text().replace('"key":"', '"key":"x'))
    assert main(["merge", *parts, "--out", str(tmp_path / "merged")]) == 1
    assert "were run with other code or on other data" in capsys.readouterr().err
    other = write_otb(tmp_path / "other" / "data", 1)
    assert main([*command[:2], other, *command[3:], str(tmp_path / "strange")]) == 0
    assert main(["merge", str(tmp_path / "strange"), "--out", str(tmp_path / "whole")]) == 1
    assert "is not about the sequences of" in capsys.readouterr().err


@pytest.mark.parametrize("shard", ["0/3", "4/3", "1", "a/b", "1/0"])
def test_a_wrong_shard_is_refused(shard: str, capsys: pytest.CaptureFixture[str]) -> None:
    """With what was expected."""
    assert main(["run", "--shard", shard]) == 1
    assert f"expected a shard I/N with I from 1 to N, got {shard!r}" in capsys.readouterr().err


def test_memory_does_not_grow_with_the_video(tmp_path: Path) -> None:
    """A video of 140 MB of frames needs no more here than one of 7 MB; its tracker lives on 100 MB of its own."""
    path, size = tmp_path / "clip.avi", (320, 240)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, size)
    for number in range(600):
        writer.write(np.full((size[1], size[0], 3), number % 200, np.uint8))
    writer.release()
    peaks = []
    for frames in (30, 600):
        source = FrameSource((str(path),), "video", frames)
        boxes = np.tile([10.0, 10.0, 12.0, 12.0], (frames, 1))
        sequence = Sequence("clip", source, boxes, np.ones(frames), (), size, str(frames))
        tracemalloc.start()
        run = run_one(Job(find_tracker("Static"), sequence), limits=Limits(megabytes=100.0))
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert run.status == COMPLETED
    assert peaks[1] - peaks[0] < 3 * 2**20
