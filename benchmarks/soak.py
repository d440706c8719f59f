"""Many updates in one process: whether memory grows, whether updates become slower.

``python -m benchmarks.soak`` makes 100,000 updates with an init every 500. Targets: resident memory within 2 MB of
what it was after the first 1,000, the same time per update from first tenth to last.
"""

from __future__ import annotations

import argparse
import statistics
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


@dataclass(frozen=True)
class Soaked:
    """What a long run used.

    Parameters
    ----------
    updates : int
    settled, final, highest : float
        Resident memory after the first `SETTLED` updates, at the end, and the most between, MB.
    tenths : tuple of float
        Median time per update of each tenth of the run, ms.
    """

    updates: int
    settled: float
    final: float
    highest: float
    tenths: tuple[float, ...]


def ring(count: int = 60) -> list[NDArray[np.uint8]]:
    """Frames (96, 128, 3) of a textured disc on a closed path, so that the video has no end."""
    rng = np.random.default_rng(3)
    ground = cv2.GaussianBlur(rng.uniform(0, 200, (96, 128, 3)).astype(np.float32), (0, 0), 2.0)
    face = cv2.GaussianBlur(rng.uniform(0, 255, (28, 28, 3)).astype(np.float32), (0, 0), 1.0)
    disc = np.hypot(*(np.indices((28, 28)) - 13.5)) < 13.5
    frames = []
    for turn in np.arange(count) / count * 2 * np.pi:
        image = ground.copy()
        x, y = round(50 + 30 * np.cos(turn)), round(34 + 20 * np.sin(turn))
        image[y : y + 28, x : x + 28][disc] = face[disc]
        frames.append(np.clip(image + rng.normal(0, 1.5, image.shape), 0, 255).astype(np.uint8))
    return frames


def soak(updates: int, restart: int = 500) -> Soaked:
    """Track an endless video, with a new init now and then.

    Parameters
    ----------
    updates : int
        More than `SETTLED`.
    restart : int
        Updates between two inits.
    """
    if updates <= SETTLED:
        raise ValueError(f"expected more than {SETTLED} updates, got {updates}")
    frames, process, tracker = ring(), psutil.Process(), TrackerHS_create()
    times = np.empty(updates)
    settled = highest = 0.0
    for index in range(updates):
        if index % restart == 0:
            start = index % len(frames)
            turn = start / len(frames) * 2 * np.pi
            tracker.init(frames[start], (round(50 + 30 * np.cos(turn)), round(34 + 20 * np.sin(turn)), 28, 28))
        # Black frames now and then: losing the object and finding it again must cost no memory either.
        frame = frames[(index + 1) % len(frames)] if index % 100 < 95 else np.zeros_like(frames[0])
        before = time.perf_counter()
        tracker.update(frame)
        times[index] = time.perf_counter() - before
        if index + 1 >= SETTLED and (index + 1) % 500 == 0:
            memory = process.memory_info().rss / 2**20
            settled = settled or memory
            highest = max(highest, memory)
    tenths = tuple(1000 * statistics.median(part.tolist()) for part in np.array_split(times, 10))
    return Soaked(updates, settled, process.memory_info().rss / 2**20, highest, tenths)


def main(arguments: Sequence[str] | None = None) -> None:
    """Run and print memory and times."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--updates", type=int, default=100_000)
    options = parser.parse_args(arguments)
    cv2.setNumThreads(1)
    soaked = soak(options.updates)
    print(f"{soaked.updates} updates on OpenCV {cv2.__version__}")
    print(f"resident memory after {SETTLED}: {soaked.settled:.1f} MB, at the end: {soaked.final:.1f} MB", end="")
    print(f" ({soaked.final - soaked.settled:+.1f}), highest {soaked.highest:.1f} MB")
    print("ms per update by tenths:", " ".join(f"{value:.2f}" for value in soaked.tenths))


if __name__ == "__main__":
    main()
