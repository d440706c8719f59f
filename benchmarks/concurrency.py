"""How much two threads do: updates per second of two trackers in two threads over one after the other.

``python -m benchmarks.concurrency``. The kernels release the GIL: on two idle cores the median must be 1.6 at least,
or the exit code is 1.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import threading
import time
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import SUITES, render
from hs_tracker_cv import TrackerHS, TrackerHS_create

BAR = 1.6
"""Updates per second of two threads over those of one, on two idle cores."""

BUSY = 0.5
"""Load average before the start from which on a machine of two cores has none to spare for a second thread."""

Clip = tuple[NDArray[np.uint8], tuple[float, ...]]


def clip() -> Clip:
    """Frames and first box of a sequence of ordinary size."""
    sequence = render(SUITES["standard"][0])
    return sequence.frames, tuple(sequence.boxes[0])


def track(tracker: TrackerHS, frames: NDArray[np.uint8], box: tuple[float, ...]) -> None:
    """Follow the object through all frames."""
    tracker.init(frames[0], box)
    for frame in frames[1:]:
        tracker.update(frame)


def seconds(threads: int, clip: Clip) -> float:
    """Wall time for `threads` trackers in as many threads."""
    workers = [threading.Thread(target=track, args=(TrackerHS_create(), *clip)) for _ in range(threads)]
    start = time.perf_counter()
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    return time.perf_counter() - start


def verdict(ratios: Sequence[float], load: float) -> tuple[bool, str]:
    """Whether the median of the ratios reaches the bar, and a line that says so.

    Parameters
    ----------
    ratios : sequence of float
    load : float
        Load average before the start.
    """
    median = statistics.median(ratios)
    passed = median >= BAR
    line = f"two threads over one: {median:.2f} × (from {min(ratios):.2f} to {max(ratios):.2f}), expected {BAR} ×"
    line += ": passed" if passed else ": FAILED"
    if not passed and load > BUSY:
        line += f" on a busy machine (load average {load:.1f} before the start): try again when it is quiet"
    return passed, line


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the speed-up of two threads, the median of several pairs of runs; return 0 if it reaches the bar."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args(arguments)
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else 0.0
    cv2.setNumThreads(1)
    data = clip()
    seconds(1, data)
    # Pairs, so that a change in the load of the machine falls on both.
    ratios = [2 * seconds(1, data) / seconds(2, data) for _ in range(options.repeats)]
    print(f"{os.cpu_count()} cores, load average {load:.1f}, {len(data[0]) - 1} updates, {options.repeats} pairs")
    passed, line = verdict(ratios, load)
    print(line)
    return 0 if passed else 1


if __name__ == "__main__":
    sys.exit(main())
