"""Many updates in one process: whether memory grows, whether updates become slower.

``python -m benchmarks.soak`` makes 100,000 updates with an init every 500. Resident memory must stay within 2 MB of
what it was after the first 1,000, and the time per update must not drift, or the exit code is 1.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import psutil
from numpy.typing import NDArray

from hs_tracker_cv import TrackerHS_create

SETTLED = 1000
"""Updates after which every kernel is loaded and every buffer has its size."""

GROWTH = 2.0
"""Resident memory that may come on top of that of the settled process, MB, at any time."""

DRIFT = 1.15
"""Time per update in the last three tenths over that in the first three: beyond what a shared machine makes of it."""


@dataclass(frozen=True)
class Soaked:
    """What a long run used.

    Parameters
    ----------
    updates : int
    settled, final, highest : float
        Resident memory once settled, at the end, and the most between, MB.
    tenths : tuple of float
        Median CPU time per update of each tenth of the run, ms: what else the machine does is not in it.
    """

    updates: int
    settled: float
    final: float
    highest: float
    tenths: tuple[float, ...]

    @property
    def growth(self) -> float:
        """Most memory that came on top of that of the settled process, MB."""
        return max(self.final, self.highest) - self.settled

    @property
    def drift(self) -> float:
        """Time per update at the end over that at the beginning."""
        return statistics.median(self.tenths[-3:]) / statistics.median(self.tenths[:3])

    def faults(self) -> list[str]:
        """What went beyond its bar, in words."""
        return [
            f"{name} is {value:.2f}, expected at most {bar}"
            for name, value, bar in (
                ("growth of memory in MB", self.growth, GROWTH),
                ("time per update at the end over that at the beginning", self.drift, DRIFT),
            )
            if value > bar
        ]


def ring(count: int = 60) -> tuple[list[NDArray[np.uint8]], list[tuple[int, int, int, int]]]:
    """Frames (72, 96, 3) of a textured disc on a closed path, so that the video has no end, and its boxes."""
    rng = np.random.default_rng(3)
    ground = cv2.GaussianBlur(rng.uniform(0, 200, (72, 96, 3)).astype(np.float32), (0, 0), 2.0)
    face = cv2.GaussianBlur(rng.uniform(0, 255, (20, 20, 3)).astype(np.float32), (0, 0), 1.0)
    disc = np.hypot(*(np.indices((20, 20)) - 9.5)) < 10
    frames, boxes = [], []
    for turn in np.arange(count) / count * 2 * np.pi:
        image = ground.copy()
        x, y = round(38 + 25 * np.cos(turn)), round(26 + 15 * np.sin(turn))
        image[y : y + 20, x : x + 20][disc] = face[disc]
        frames.append(np.clip(image + rng.normal(0, 1.5, image.shape), 0, 255).astype(np.uint8))
        boxes.append((x, y, 20, 20))
    return frames, boxes


def soak(updates: int, *, restart: int = 500, settled: int = SETTLED) -> Soaked:
    """Track an endless video, with a new init now and then.

    Parameters
    ----------
    updates : int
        More than `settled`.
    restart : int
        Updates between two inits.
    settled : int
        Updates before memory is first measured.
    """
    if updates <= settled:
        raise ValueError(f"expected more than {settled} updates, got {updates}")
    (frames, boxes), process, tracker = ring(), psutil.Process(), TrackerHS_create()
    times = np.full(updates, np.nan)  # resident from the start: this record is not the tracker's memory
    first = highest = 0.0
    for index in range(updates):
        if index % restart == 0:
            tracker.init(frames[index % len(frames)], boxes[index % len(frames)])
        # Black frames now and then: losing the object and finding it again must cost no memory either.
        frame = frames[(index + 1) % len(frames)] if index % 100 < 95 else np.zeros_like(frames[0])
        before = time.thread_time()
        tracker.update(frame)
        times[index] = time.thread_time() - before
        if index + 1 >= settled and (index + 1 - settled) % 100 == 0:
            memory = process.memory_info().rss / 2**20
            first = first or memory
            highest = max(highest, memory)
    tenths = tuple(1000 * statistics.median(part.tolist()) for part in np.array_split(times, 10))
    return Soaked(updates, first, process.memory_info().rss / 2**20, highest, tenths)


def main(arguments: Sequence[str] | None = None) -> int:
    """Print memory, times and the verdict; return 0 if both are within their bars."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--updates", type=int, default=100_000)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    soaked = soak(options.updates)
    print(f"{soaked.updates} updates on OpenCV {cv2.__version__}")
    print(f"resident memory after {SETTLED}: {soaked.settled:.1f} MB, at the end: {soaked.final:.1f} MB", end="")
    print(f" ({soaked.final - soaked.settled:+.1f}), highest {soaked.highest:.1f} MB")
    print("CPU ms per update by tenths:", " ".join(f"{value:.2f}" for value in soaked.tenths), end="")
    print(f" (end over beginning {soaked.drift:.2f})")
    faults = soaked.faults()
    print(f"soak: {'FAILED: ' + '; '.join(faults) if faults else 'passed'}")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
