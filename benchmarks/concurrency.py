"""How much two threads do: updates per second of two trackers in two threads over one after the other.

``python -m benchmarks.concurrency``. The kernels release the GIL; the target is 1.6 on two idle cores.
"""

from __future__ import annotations

import argparse
import os
import statistics
import threading
import time
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from datasets_synthetic import SUITES, render
from hs_tracker_cv import TrackerHS, TrackerHS_create

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


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the speed-up of two threads: the median of several pairs of runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeats", type=int, default=5)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    data = clip()
    seconds(1, data)
    # Pairs, so that a change in the load of the machine falls on both.
    ratios = sorted(2 * seconds(1, data) / seconds(2, data) for _ in range(options.repeats))
    load = f"load average {os.getloadavg()[0]:.1f}" if hasattr(os, "getloadavg") else "load unknown"
    print(f"{os.cpu_count()} cores, {load}, {len(data[0]) - 1} updates, {options.repeats} pairs")
    print(f"two threads over one: {statistics.median(ratios):.2f} × (from {ratios[0]:.2f} to {ratios[-1]:.2f})")


if __name__ == "__main__":
    main()
