"""Where the time of one update goes: µs per stage of segmentation and of the carried box.

``python -m benchmarks.profile_update`` prints a table for each mode. The stages are the library's own functions,
timed from outside by a wrapper; an indented stage is a part of the one above it, and what no stage accounts for is
the glue between them. One thread, medians over updates; the wrapper costs well under a microsecond a call.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from importlib import import_module
from typing import Any, NamedTuple

import cv2
import numpy as np
from rich.console import Console
from rich.table import Table

from hs_tracker_cv import TrackerHS_create, TrackerHS_Params

from .bench_update import moving_square

SIDES = (30, 60, 120, 240)
"""Sides of the object, px."""

WARM_UP, UPDATES = 8, 40


class Stage(NamedTuple):
    """A function of the library, by the module that calls it; `depth` indents it in the table."""

    title: str
    module: str
    name: str
    depth: int = 0


SEGMENTATION = (
    Stage("window", "segmentation.tracking", "cut_window"),
    Stage("motion", "segmentation.motion", "find"),
    Stage("prediction", "segmentation.motion", "_predict", 1),
    Stage("Horn–Schunck flow", "segmentation.motion", "_dense_flow", 1),
    Stage("fit and registration", "segmentation.motion", "_measure", 1),
    Stage("layers moved, evidence", "segmentation.labelling", "predict_layers"),
    Stage("labels", "segmentation.labelling", "assign"),
    Stage("occlusion, box", "segmentation.tracking", "_outcome"),
    Stage("memory", "segmentation.memory", "learn_frame"),
    Stage("report, next window", "segmentation.tracking", "_next_state"),
)

PATCH_TRACKER = (
    Stage("find: correlation filter", "patch_tracker.tracking", "find"),
    Stage("carry: flow between frames", "patch_tracker.tracking", "_follow_flow"),
    Stage("hold: keyframes", "patch_tracker.tracking", "_correct_by_keyframes"),
    Stage("learn", "patch_tracker.tracking", "_learn"),
)


class Stopwatch:
    """Wraps functions and sums up the time inside each, per update."""

    def __init__(self, stages: tuple[Stage, ...]) -> None:
        self.spent: dict[str, float] = defaultdict(float)
        self._originals: list[tuple[Any, str, Any]] = []
        for stage in stages:
            place = import_module(f"hs_tracker_cv.{stage.module}")
            original = getattr(place, stage.name)
            self._originals.append((place, stage.name, original))
            setattr(place, stage.name, self._timed(stage.title, original))

    def _timed(self, title: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def timed(*arguments: Any, **options: Any) -> Any:
            begin = time.perf_counter()
            try:
                return function(*arguments, **options)
            finally:
                self.spent[title] += time.perf_counter() - begin

        return timed

    def remove(self) -> None:
        """Put the functions back."""
        for place, name, original in self._originals:
            setattr(place, name, original)


def profile(mode: str, stages: tuple[Stage, ...], side: int) -> dict[str, float]:
    """Median µs per update of each stage, and of the whole ("update")."""
    frames = moving_square(640, 480, side, WARM_UP + UPDATES + 1)
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(next(frames), (40, 40, side, side))
    watch = Stopwatch(stages)
    samples: dict[str, list[float]] = defaultdict(list)
    try:
        for number, frame in enumerate(frames):
            watch.spent.clear()
            begin = time.perf_counter()
            tracker.update(frame)
            whole = time.perf_counter() - begin
            if number >= WARM_UP:
                for title, seconds in {**watch.spent, "update": whole}.items():
                    samples[title].append(1e6 * seconds)
    finally:
        watch.remove()
    return {title: float(np.median(values)) for title, values in samples.items()}


def table(mode: str, stages: tuple[Stage, ...]) -> Table:
    """The table of one mode."""
    columns = [profile(mode, stages, side) for side in SIDES]
    found = Table(title=f"mode {mode}: µs per update (median), 640 × 480, by side of the object")
    found.add_column("stage")
    for side in SIDES:
        found.add_column(f"{side} px", justify="right")
    for stage in stages:
        cells = (f"{column.get(stage.title, 0.0):.0f}" for column in columns)
        found.add_row("  " * stage.depth + stage.title, *cells)
    outer = {stage.title for stage in stages if stage.depth == 0}
    rest = (column["update"] - sum(value for title, value in column.items() if title in outer) for column in columns)
    found.add_row("the rest", *(f"{value:.0f}" for value in rest), end_section=True)
    found.add_row("update", *(f"{column['update']:.0f}" for column in columns))
    return found


def main() -> None:
    """Print both tables."""
    cv2.setNumThreads(1)
    for mode, stages in (("segmentation", SEGMENTATION), ("patch_tracker", PATCH_TRACKER)):
        profile(mode, stages, 40)  # compiles
        Console().print(table(mode, stages))


if __name__ == "__main__":
    main()
