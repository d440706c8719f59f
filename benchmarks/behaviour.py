"""What trackers do with bad input and odd calls: measured, each probe in a process of its own, as a Markdown table.

``python -m benchmarks.behaviour`` prints the table of README; a tracker that takes its process down costs one cell.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import multiprocessing
import pickle
import signal
from collections.abc import Callable, Sequence
from multiprocessing.connection import Connection
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from hs_tracker_cv import Box, TrackerHS_create
from hs_tracker_cv.geometry import iou

TIMEOUT = 60.0
"""Seconds after which a probe counts as hanging; the first call of a cold cache compiles."""

Factory = Callable[[], Any]
Roi = tuple[int, int, int, int]

TRACKERS: dict[str, Factory] = {
    "CSRT": lambda: cv2.TrackerCSRT_create(),
    "KCF": lambda: cv2.TrackerKCF_create(),
    "MIL": lambda: cv2.TrackerMIL_create(),
    "legacy.MOSSE": lambda: cv2.legacy.TrackerMOSSE_create(),
    "legacy.MedianFlow": lambda: cv2.legacy.TrackerMedianFlow_create(),
    "TrackerHS": TrackerHS_create,
}


class Clip:
    """A textured square moving by whole pixels over a textured ground; frames (120, 160, 3) uint8, boxes exact."""

    def __init__(self, count: int = 12) -> None:
        rng = np.random.default_rng(7)
        self.ground = self._texture(rng, 120, 160, 3.0, 20, 130)
        square = self._texture(rng, 32, 32, 1.5, 70, 240)
        self.frames: list[NDArray[np.uint8]] = []
        self.boxes: list[Roi] = []
        for index in range(count):
            x, y = 30 + 2 * index, 30 + index
            image = self.ground.copy()
            image[y : y + 32, x : x + 32] = square
            self.frames.append(self._noisy(image, rng))
            self.boxes.append((x, y, 32, 32))
        self.empty = [self._noisy(self.ground, rng) for _ in range(10)]

    @staticmethod
    def _texture(
        rng: np.random.Generator, height: int, width: int, sigma: float, low: float, high: float
    ) -> NDArray[np.float32]:
        planes = [cv2.GaussianBlur(rng.standard_normal((height, width)), (0, 0), sigma) for _ in range(3)]
        return np.dstack([cv2.normalize(plane, None, low, high, cv2.NORM_MINMAX) for plane in planes])

    @staticmethod
    def _noisy(image: NDArray[Any], rng: np.random.Generator) -> NDArray[np.uint8]:
        return np.clip(np.rint(image + rng.normal(0, 1.0, image.shape)), 0, 255).astype(np.uint8)


def _error(error: Exception) -> str:
    """Name an exception, with OpenCV's code where it has one."""
    return f"cv2.error ({error.code})" if type(error) is cv2.error else type(error).__name__


def _attempt(call: Callable[[], Any]) -> str:
    """What a call does: ``ok``, False, or the exception it raises."""
    try:
        result = call()
    except Exception as error:
        return _error(error)
    return "False" if result is False else "ok"


def _updated(tracker: Any, frame: Any, truth: Roi) -> str:
    """What an update answers, and whether the box is on the object."""
    try:
        ok, box = tracker.update(frame)
    except Exception as error:
        return _error(error)
    if not ok:
        return "False"
    return "found" if iou(Box(*box), Box(*truth)) > 0.5 else "True, off target"


def _same(outcomes: Sequence[str]) -> str:
    """One word when all agree, else each once, in order."""
    return " / ".join(dict.fromkeys(outcomes))


def _started(factory: Factory, clip: Clip, updates: int = 2) -> Any:
    tracker = factory()
    tracker.init(clip.frames[0], clip.boxes[0])
    for frame in clip.frames[1 : updates + 1]:
        tracker.update(frame)
    return tracker


def _tracked(factory: Factory, frames: Sequence[Any], rois: Sequence[Roi]) -> str:
    """What comes of a video: the answers to all frames but the first, or why it could not be started."""
    tracker = factory()
    started = _attempt(lambda: tracker.init(frames[0], rois[0]))
    if started != "ok":
        return f"init: {started}"
    return _same([_updated(tracker, frame, roi) for frame, roi in zip(frames[1:], rois[1:], strict=True)])


def _init_with(*rois: Any) -> Callable[[Factory], str]:
    """Probe: what `init` does with these ROIs."""

    def probe(factory: Factory) -> str:
        frame = Clip().frames[0]
        return _same([_attempt(lambda roi=roi: factory().init(frame, roi)) for roi in rois])

    return probe


def _video_of(convert: Callable[[NDArray[np.uint8]], Any]) -> Callable[[Factory], str]:
    """Probe: whether it tracks a video of frames of another kind."""

    def probe(factory: Factory) -> str:
        clip = Clip()
        return _tracked(factory, [convert(frame) for frame in clip.frames], clip.boxes)

    return probe


def _one_bad(make: Callable[[Clip], Any]) -> Callable[[Factory], str]:
    """Probe: the answer to one bad frame mid-track, and to the good ones after it."""

    def probe(factory: Factory) -> str:
        clip = Clip()
        tracker = _started(factory, clip)
        bad = _updated(tracker, make(clip), clip.boxes[2])
        after = [_updated(tracker, frame, box) for frame, box in zip(clip.frames[3:], clip.boxes[3:], strict=True)]
        return f"{bad}, then {_same(after)}"

    return probe


def _init_returns(factory: Factory) -> str:
    clip = Clip()
    return repr(factory().init(clip.frames[0], clip.boxes[0]))


def _update_returns(factory: Factory) -> str:
    clip = Clip()
    ok, box = _started(factory, clip).update(clip.frames[3])
    return f"({type(ok).__name__}, {_same([type(value).__name__ for value in box])} × {len(box)})"


def _roi_partly_outside(factory: Factory) -> str:
    clip, tracker = Clip(), factory()
    started = _attempt(lambda: tracker.init(clip.frames[0], (-10, -10, 40, 40)))
    return started if started != "ok" else f"ok, then {_attempt(lambda: tracker.update(clip.frames[0])[0])}"


def _update_first(factory: Factory) -> str:
    return _attempt(lambda: factory().update(Clip().frames[0])[0])


def _update_after_failed_init(factory: Factory) -> str:
    clip, tracker = Clip(), factory()
    failed = _attempt(lambda: tracker.init(clip.frames[0], (500, 500, 20, 20)))
    return f"init: {failed}, update: {_attempt(lambda: tracker.update(clip.frames[0])[0])}"


def _init_again(factory: Factory) -> str:
    clip = Clip()
    tracker = _started(factory, clip, updates=5)
    again = _attempt(lambda: tracker.init(clip.frames[0], clip.boxes[0]))
    updates = [_updated(tracker, frame, box) for frame, box in zip(clip.frames[1:5], clip.boxes[1:5], strict=True)]
    return f"{again}, then {_same(updates)}"


def _out_of_sight(updates: int, shown: Callable[[Clip], Sequence[NDArray[np.uint8]]]) -> Callable[[Factory], str]:
    """Probe: the answers to frames without the object after some with it, and to the last one when it is back."""

    def probe(factory: Factory) -> str:
        clip = Clip(updates + 7)
        tracker = _started(factory, clip, updates)
        gone = [tracker.update(frame)[0] for frame in shown(clip)]
        # It comes back where it was, and moves on.
        first = updates + 1
        back = [
            _updated(tracker, frame, box) for frame, box in zip(clip.frames[first:], clip.boxes[first:], strict=True)
        ]
        return f"False in {gone.count(False)} of {len(gone)}; back: {back[-1]}"

    return probe


def _black(clip: Clip) -> list[NDArray[np.uint8]]:
    return [np.zeros_like(clip.frames[0])] * 10


def _flat(factory: Factory) -> str:
    return _tracked(factory, [np.full((120, 160, 3), 128, np.uint8)] * 6, [(30, 30, 32, 32)] * 6)


def _nearly_the_frame(factory: Factory) -> str:
    return _tracked(factory, Clip().frames, [(2, 2, 156, 116)] * 12)


def _one_pixel_high(factory: Factory) -> str:
    clip = Clip()
    rows = [np.ascontiguousarray(frame[44:45]) for frame in clip.frames]
    return _tracked(factory, rows, [(x, 0, w, 1) for x, _, w, _ in clip.boxes])


def _box_when_false(factory: Factory) -> str:
    clip = Clip()
    tracker = _started(factory, clip, updates=11)
    for frame in [*clip.empty, np.zeros_like(clip.empty[0])]:
        ok, box = tracker.update(frame)
        if not ok:
            return repr(tuple(box))
    return "never False"


def _same_frame(factory: Factory) -> str:
    clip, tracker = Clip(), factory()
    tracker.init(clip.frames[0], clip.boxes[0])
    ok, box = tracker.update(clip.frames[0])
    if not ok:
        return "False"
    off = max(abs(a - b) for a, b in zip(box, clip.boxes[0], strict=True))
    return "(True, roi)" if off == 0 else f"True, {off:.0f} px off"


def _two_runs(factory: Factory) -> str:
    clip = Clip()
    first, second = (
        [tracker.update(frame) for frame in clip.frames[1:]]
        for tracker in (_started(factory, clip, 0), _started(factory, clip, 0))
    )
    return "yes" if first == second else "no"


def _duplicate(copier: Callable[[Any], Any]) -> Callable[[Factory], str]:
    """Probe: whether a copy made mid-track goes on alone."""

    def probe(factory: Factory) -> str:
        clip = Clip()
        tracker = _started(factory, clip)
        try:
            twin = copier(tracker)
        except Exception as error:
            return _error(error)
        return "yes" if tracker.update(clip.frames[3]) == twin.update(clip.frames[3]) else "differs"

    return probe


def _score(factory: Factory) -> str:
    clip = Clip()
    tracker = _started(factory, clip)
    try:
        score = tracker.getTrackingScore()
    except AttributeError:
        return "none"
    return "in [0, 1]" if 0 <= score <= 1 else f"{score:g}"


def _bgra(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.dstack([frame, np.full(frame.shape[:2], 255, np.uint8)])


def _read_only(frame: NDArray[np.uint8]) -> NDArray[np.uint8]:
    strided = np.repeat(frame, 2, axis=1)[:, ::2]
    strided.flags.writeable = False
    return strided


def _random_frame(clip: Clip) -> NDArray[np.uint8]:
    return np.random.default_rng(3).integers(0, 256, clip.frames[0].shape, dtype=np.uint8)


CASES: dict[str, Callable[[Factory], str]] = {
    "`init` returns": _init_returns,
    "`update` returns": _update_returns,
    "ROI of floats": _init_with(
        (30.0, 30.0, 32.0, 32.0), (30.5, 30.5, 31.5, 31.5), np.array([30.0, 30.0, 32.0, 32.0])
    ),
    "ROI as list, int array, NumPy ints": _init_with(
        [30, 30, 32, 32], np.array([30, 30, 32, 32]), tuple(np.array([30, 30, 32, 32], np.int32))
    ),
    "ROI of 3 or 5 numbers": _init_with((30, 30, 32), (30, 30, 32, 32, 1)),
    "ROI `None`": _init_with(None),
    "ROI of zero size (cancelled `selectROI`)": _init_with((0, 0, 0, 0)),
    "ROI of negative size": _init_with((30, 30, -10, 20)),
    "ROI of 2 × 2 px": _init_with((30, 30, 2, 2)),
    "ROI fully outside": _init_with((500, 500, 20, 20)),
    "ROI partly outside": _roi_partly_outside,
    "ROI as large as the frame, 2 px in": _nearly_the_frame,
    "frame of 1 px height": _one_pixel_high,
    "flat image": _flat,
    "`update` before `init`": _update_first,
    "`update` after a failed `init`": _update_after_failed_init,
    "`init` again on the same object": _init_again,
    "`update(None)`": _one_bad(lambda clip: None),
    "`update` of an empty image": _one_bad(lambda clip: np.zeros((0, 0, 3), np.uint8)),
    "frame of another size": _one_bad(lambda clip: np.ascontiguousarray(clip.frames[3][::2, ::2])),
    "frame of other channels": _one_bad(lambda clip: cv2.cvtColor(clip.frames[3], cv2.COLOR_BGR2GRAY)),
    "one black frame": _one_bad(lambda clip: np.zeros_like(clip.frames[0])),
    "one random frame": _one_bad(_random_frame),
    "gray (H, W)": _video_of(lambda frame: cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)),
    "gray (H, W, 1)": _video_of(lambda frame: cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)[:, :, np.newaxis]),
    "BGRA": _video_of(_bgra),
    "uint16": _video_of(lambda frame: frame.astype(np.uint16) * 257),
    "float32, 0–1": _video_of(lambda frame: frame.astype(np.float32) / 255),
    "int64": _video_of(lambda frame: frame.astype(np.int64)),
    "bool": _video_of(lambda frame: frame > 90),
    "2 channels": _video_of(lambda frame: np.ascontiguousarray(frame[:, :, :2])),
    "strided, read-only": _video_of(_read_only),
    "`cv2.UMat`": _video_of(lambda frame: cv2.UMat(frame)),
    "`update` on the init frame": _same_frame,
    "object vanishes for 10 frames": _out_of_sight(11, lambda clip: clip.empty),
    "object vanishes after 1 update": _out_of_sight(1, lambda clip: clip.empty),
    "10 black frames": _out_of_sight(11, _black),
    "10 black frames after 1 update": _out_of_sight(1, _black),
    "box when False": _box_when_false,
    "two runs equal": _two_runs,
    "pickle mid-track": _duplicate(lambda tracker: pickle.loads(pickle.dumps(tracker))),
    "deepcopy mid-track": _duplicate(copy.deepcopy),
    "`getTrackingScore()`": _score,
}


def isolated(work: Callable[..., str], *arguments: Any, timeout: float = TIMEOUT) -> str:
    """Run a probe in a process of its own and say how that ended.

    Parameters
    ----------
    work : callable
        Importable; what it returns is the outcome.
    *arguments
        Picklable.
    timeout : float
        Seconds.

    Returns
    -------
    str
        What `work` returned; or, in bold, the signal that ended the process, ``hangs`` or its exit code.
    """
    # A fork server has the imports done, and no threads of ours to inherit.
    methods = multiprocessing.get_all_start_methods()
    context = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
    context.set_forkserver_preload(["cv2", "hs_tracker_cv.tracker"])
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_answer, args=(sender, work, arguments), daemon=True)
    process.start()
    sender.close()
    outcome = None
    if receiver.poll(timeout):
        with contextlib.suppress(EOFError):
            outcome = receiver.recv()
    process.join(5.0)
    if process.is_alive():
        process.kill()
        process.join()
        return "**hangs**"
    code = process.exitcode or 0
    if code < 0:
        name = signal.Signals(-code).name
        return "**segfault**" if name == "SIGSEGV" else f"**{name}**"
    return outcome if outcome is not None and code == 0 else f"**exit {code}**"


def _answer(sender: Connection, work: Callable[..., str], arguments: tuple[Any, ...]) -> None:
    """Body of the process of one probe."""
    cv2.setNumThreads(1)
    sender.send(work(*arguments))


def probe(case: str, tracker: str) -> str:
    """Outcome of one case for one tracker, in this process."""
    return CASES[case](TRACKERS[tracker])


def measure(trackers: Sequence[str]) -> dict[str, dict[str, str]]:
    """Outcome of every case for the named trackers: case -> tracker -> outcome."""
    return {case: {tracker: isolated(probe, case, tracker) for tracker in trackers} for case in CASES}


def markdown(table: dict[str, dict[str, str]]) -> str:
    """A table of `measure` as Markdown."""
    trackers = list(next(iter(table.values())))
    lines = [f"| case | {' | '.join(trackers)} |", f"|---|{'---|' * len(trackers)}"]
    lines += [f"| {case} | {' | '.join(row.values())} |" for case, row in table.items()]
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trackers", nargs="+", choices=list(TRACKERS), default=list(TRACKERS))
    options = parser.parse_args(arguments)
    print(f"OpenCV {cv2.__version__}; every cell measured in a process of its own.\n")
    print(markdown(measure(options.trackers)))


if __name__ == "__main__":
    main()
