"""One update of the tracker, timed: the cost of each mode, the size of object and frame, and CSRT in the same run.

``python -m benchmarks.bench_update`` prints two tables. Times are medians over interleaved updates on one thread;
ratios within a run hold on a noisy machine, times do not.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from hs_tracker_cv import TrackerHS_create, TrackerHS_Params

SIZES = ((640, 480, 60), (640, 480, 240), (3840, 2160, 60))
"""Width and height of the frame and side of the object, px."""

FRAMES = 30


def moving_square(width: int, height: int, side: int, count: int) -> Iterator[NDArray[np.uint8]]:
    """Frames of a textured square that moves by (2, 1) px over a textured ground; starts at (40, 40)."""
    rng = np.random.default_rng(0)

    def texture(h: int, w: int) -> NDArray[np.float32]:
        small = rng.uniform(0, 255, (h // 4 + 2, w // 4 + 2, 3)).astype(np.float32)
        return np.asarray(cv2.resize(small, (w, h), interpolation=cv2.INTER_CUBIC), dtype=np.float32)

    ground = np.clip(texture(height, width) * 0.6, 0, 255).astype(np.uint8)
    square = np.clip(60 + texture(side, side) * 0.7, 0, 255).astype(np.uint8)
    noise = rng.integers(-2, 3, (height, width, 3)).astype(np.int16)
    for index in range(count):
        frame = ground.copy()
        x, y = 40 + 2 * index, 40 + index
        frame[y : y + side, x : x + side] = square
        yield np.clip(frame + np.roll(noise, 31 * index, axis=1), 0, 255).astype(np.uint8)


def trackers() -> dict[str, Callable[[], Any]]:
    """What is timed: name and factory."""
    modes = {f"TrackerHS {mode}": mode for mode in ("auto", "segmentation", "patch_tracker")}
    table: dict[str, Callable[[], Any]] = {
        name: (lambda mode=mode: TrackerHS_create(TrackerHS_Params(mode=mode))) for name, mode in modes.items()
    }
    return {**table, "CSRT": cv2.TrackerCSRT_create}


def median_times(width: int, height: int, side: int) -> dict[str, float]:
    """Median ms per update of each tracker, all of them on each frame in turn."""
    frames = moving_square(width, height, side, FRAMES)
    first = next(frames)
    running = {name: factory() for name, factory in trackers().items()}
    for tracker in running.values():
        tracker.init(first, (40, 40, side, side))
    times: dict[str, list[float]] = {name: [] for name in running}
    for frame in frames:
        for name, tracker in running.items():
            begin = time.process_time()
            tracker.update(frame)
            times[name].append(1e3 * (time.process_time() - begin))
    return {name: float(np.median(values[3:])) for name, values in times.items()}


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    median_times(320, 240, 40)  # compiles and warms up
    table = Table(title="ms per update (median), and CSRT's time over ours")
    table.add_column("object, frame")
    for name in trackers():
        table.add_column(name, justify="right")
    table.add_column("CSRT / auto", justify="right")
    for width, height, side in SIZES:
        row = median_times(width, height, side)
        ratio = row["CSRT"] / row["TrackerHS auto"]
        cells = [f"{value:.2f}" for value in row.values()]
        table.add_row(f"{side} px, {width} × {height}", *cells, f"{ratio:.1f}")
    Console().print(table)


if __name__ == "__main__":
    main()
