"""Trackers side by side: in threads, and in processes that were forked or spawned."""

from __future__ import annotations

import multiprocessing
import sys
import threading
import time
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import HornSchunck, TrackerHS_create, TrackerHS_Params
from hs_tracker_cv._native import kernels
from tests.conftest import moving_square

TRACKERS = 8
PATIENCE = 120.0
"""Seconds after which a child process counts as hanging; a spawned one imports everything anew."""

Result = list[tuple[bool, tuple[int, int, int, int], float, Any]]
Work = tuple[list[NDArray[np.uint8]], tuple[int, int, int, int], str]


def work(number: int) -> Work:
    """A video of its own for each tracker, and a mode."""
    step = ((2, 1), (-1, 1), (1, 2), (0, 1))[number % 4]
    frames, boxes = moving_square(np.random.default_rng(number), step=step, side=24 + 2 * number)
    return frames, boxes[0], ("auto", "segmentation", "patch_tracker", "auto")[number % 4]


def follow(job: Work) -> Result:
    """Everything a tracker says about a video, sub-pixel."""
    frames, box, mode = job
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(frames[0], box)
    return [(*tracker.update(frame), tracker.getTrackingScore(), tracker.box) for frame in frames[1:]]


def into(sender: Any, job: Work) -> None:
    """Body of a child process."""
    sender.send(follow(job))


def in_a_process(method: str, job: Work) -> Result:
    """The answers of a tracker in a child process; a child that hangs or dies fails the test."""
    context: Any = multiprocessing.get_context(method)
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=into, args=(sender, job), daemon=True)
    with warnings.catch_warnings():
        # Python 3.12 warns of forks of a process with threads, which is the case to be tested.
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    sender.close()
    try:
        assert receiver.poll(PATIENCE), f"the {method}ed process hangs"
        result: Result = receiver.recv()
        return result
    finally:
        process.kill()
        process.join()


def in_threads(calls: list[Callable[[], Any]]) -> list[Any]:
    """Results of calls that start at the same moment, each in a thread of its own."""
    barrier = Barrier(len(calls))

    def run(call: Callable[[], Any]) -> Any:
        barrier.wait(PATIENCE)
        return call()

    with ThreadPoolExecutor(len(calls)) as pool:
        return list(pool.map(run, calls))


def test_eight_threads_equal_eight_runs_in_sequence() -> None:
    """Trackers share nothing: boxes, scores and sub-pixel boxes are the same bit by bit."""
    jobs = [work(number) for number in range(TRACKERS)]
    alone = [follow(job) for job in jobs]
    assert in_threads([lambda job=job: follow(job) for job in jobs]) == alone


def test_kernels_release_the_gil() -> None:
    """Another thread runs while a kernel does, in an interpreter that takes the GIL from nobody."""
    features, spectrum = np.zeros((40, 40, 24), np.float32), np.empty((40, 21, 2, 24), np.float32)
    inside, seen = threading.Event(), threading.Event()

    def work() -> None:
        for _ in range(5000):
            inside.set()
            kernels.transform(features, spectrum)
            inside.clear()
            if seen.is_set():
                return

    before = sys.getswitchinterval()
    sys.setswitchinterval(1000.0)
    try:
        worker = threading.Thread(target=work)
        worker.start()
        while worker.is_alive() and not seen.is_set():
            # Having slept, this thread goes on only where the other lets go of the GIL: in a kernel, or at its end.
            time.sleep(0.0005)
            if inside.is_set():
                seen.set()
        worker.join()
    finally:
        sys.setswitchinterval(before)
    assert seen.is_set()


def test_one_tracker_may_be_handed_from_thread_to_thread() -> None:
    """A track started in one thread goes on in others as if nothing had happened."""
    frames, box, mode = work(0)
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(frames[0], box)
    answers = []
    for frame in frames[1:]:
        answer = in_threads([lambda frame=frame: tracker.update(frame)])[0]
        answers.append((*answer, tracker.getTrackingScore(), tracker.box))
    assert answers == follow(work(0))


def test_one_tracker_in_three_threads_at_once_takes_no_harm() -> None:
    """Nobody knows which frame it saw last, but every answer is whole, and a new init forgets the turmoil."""
    frames, box, mode = work(0)
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(frames[0], box)

    def turmoil(step: int) -> list[Any]:
        answers = []
        for index in range(24):
            answers.append(tracker.update(frames[index * step % len(frames)]))
            if index % 9 == 8:
                tracker.init(frames[0], box)
        return answers

    for answers in in_threads([lambda step=step: turmoil(step) for step in (1, 5, 7)]):
        assert all(len(found) == 4 and (ok or found == (0, 0, 0, 0)) for ok, found in answers)
    tracker.init(frames[0], box)
    told = [(*tracker.update(frame), tracker.getTrackingScore(), tracker.box) for frame in frames[1:]]
    assert told == follow(work(0))


def test_a_frame_that_is_overwritten_meanwhile_does_no_lasting_harm() -> None:
    """A camera that fills its one buffer while `update` looks at it spoils that answer at most."""
    frames, box, mode = work(0)
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    buffer, done = frames[0].copy(), threading.Event()
    tracker.init(frames[0], box)

    def camera() -> None:
        rng, index = np.random.default_rng(0), 0
        while not done.is_set():
            buffer[:] = frames[index % len(frames)] if index % 3 else rng.integers(0, 256, buffer.shape, np.uint8)
            index += 1

    filling = threading.Thread(target=camera)
    filling.start()
    try:
        for _ in range(40):
            ok, found = tracker.update(buffer)
            assert ok or found == (0, 0, 0, 0)
            assert 0.0 <= tracker.getTrackingScore() <= 1.0
    finally:
        done.set()
        filling.join()
    tracker.init(frames[0], box)
    told = [(*tracker.update(frame), tracker.getTrackingScore(), tracker.box) for frame in frames[1:]]
    assert told == follow(work(0))


@pytest.mark.parametrize("method", ["fork", "spawn", "forkserver"])
def test_child_processes_answer_as_the_parent_does(method: str) -> None:
    """Tracking works in children of a parent that has tracked in threads, with OpenCV's own threads at work."""
    if method not in multiprocessing.get_all_start_methods():
        pytest.skip(f"{method} does not exist here")
    job = work(3)
    cv2.setNumThreads(2)
    cv2.GaussianBlur(np.zeros((1500, 1500, 3), np.float32), (0, 0), 5.0)
    here = in_threads([lambda: follow(job), lambda: follow(job)])
    assert here[0] == here[1]
    assert in_a_process(method, job) == here[0]
    assert follow(job) == here[0]


@pytest.mark.parametrize("busy", ["flow", "trackers"])
def test_a_child_forked_while_threads_are_in_kernels_answers_too(busy: str) -> None:
    """The thread that forks holds Python's lock: the others are in kernels, or wait to come back from them."""
    if "fork" not in multiprocessing.get_all_start_methods():
        pytest.skip("fork does not exist here")
    job, done = work(3), threading.Event()
    expected, frames = follow(job), np.random.default_rng(0).uniform(0, 255, (2, 480, 640)).astype(np.float32)

    def work_on() -> None:
        flow = HornSchunck("fast")
        while not done.is_set():
            flow.calc(*frames) if busy == "flow" else follow(work(0))

    threads = [threading.Thread(target=work_on) for _ in range(3)]
    for thread in threads:
        thread.start()
    try:
        for _ in range(5):
            assert in_a_process("fork", job) == expected
    finally:
        done.set()
        for thread in threads:
            thread.join()
    assert follow(job) == expected


def test_a_track_may_go_on_in_another_process() -> None:
    """A tracker sent to a pool mid-track comes back with its track."""
    frames, box, _ = work(1)
    expected = follow((frames, box, "auto"))
    tracker = TrackerHS_create()
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        tracker = pool.apply(begun, (frames, box))
    assert [(*tracker.update(frame), tracker.getTrackingScore(), tracker.box) for frame in frames[6:]] == expected[5:]


def begun(frames: list[NDArray[np.uint8]], box: tuple[int, int, int, int]) -> Any:
    """A tracker after six frames."""
    tracker = TrackerHS_create()
    tracker.init(frames[0], box)
    for frame in frames[1:6]:
        tracker.update(frame)
    return tracker
