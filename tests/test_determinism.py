"""The same frames give the same boxes: from run to run, in any process, with any number of threads, on any OpenCV.

``python -m tests.test_determinism`` prints the boxes of the suite `smoke` as JSON; with ``--write`` it makes them the
reference in ``tests/data/smoke_boxes.json`` that every version of OpenCV is held to.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from datasets_synthetic import SUITES, Sequence, render
from hs_tracker_cv import TrackerHS_create, TrackerHS_Params

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "tests" / "data" / "smoke_boxes.json"
ACROSS_VERSIONS = 1.0
"""Distance of box edges between versions of OpenCV, px: cv2's own resampling differs in the last bits."""

Track = list[list[float] | None]


@functools.cache
def sequences() -> tuple[Sequence, ...]:
    """The suite `smoke`, rendered once."""
    return tuple(render(spec) for spec in SUITES["smoke"])


def track(sequence: Sequence, mode: str = "auto") -> Track:
    """Sub-pixel boxes of a sequence; None where the answer is False."""
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(sequence.frames[0], tuple(sequence.boxes[0]))
    boxes: Track = []
    for frame in sequence.frames[1:]:
        ok, _ = tracker.update(frame)
        boxes.append([float(value) for value in tracker.box or ()] if ok else None)
    return boxes


def smoke(mode: str = "auto") -> dict[str, Track]:
    """Boxes of the whole suite."""
    return {sequence.name: track(sequence, mode) for sequence in sequences()}


def elsewhere(**environment: str) -> dict[str, Any]:
    """What this file prints in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "tests.test_determinism"],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        timeout=300,
    )
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


@pytest.mark.parametrize("mode", ["auto", "layers", "propagation"])
def test_two_runs_are_equal_bit_by_bit(mode: str) -> None:
    """Nothing is random and nothing depends on where in memory an array happens to lie."""
    first, clutter = smoke(mode), []
    for size in range(1, 400, 13):
        clutter.append(np.full(size * 7, np.nan, np.float32))
    assert smoke(mode) == first


def test_the_number_of_threads_does_not_matter() -> None:
    """OpenCV with one thread, with two and with four gives the same boxes."""
    answers = []
    for threads in (1, 2, 4):
        cv2.setNumThreads(threads)
        answers.append(smoke())
    assert answers[0] == answers[1] == answers[2]


@pytest.mark.parametrize(
    "environment",
    [
        pytest.param(
            {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}, id="one-thread"
        ),
        pytest.param({"OMP_NUM_THREADS": "2", "NUMBA_NUM_THREADS": "2", "PYTHONHASHSEED": "7"}, id="two-threads"),
    ],
)
def test_another_process_gives_the_same_boxes(environment: dict[str, str]) -> None:
    """Neither the process, nor its threads, nor its hash seed can be seen in the boxes."""
    assert elsewhere(**environment)["boxes"] == smoke()


def test_every_opencv_gives_the_boxes_of_the_reference() -> None:
    """Edges within a pixel of the committed ones, and False in the same frames."""
    if not REFERENCE.is_file():
        pytest.skip(f"no reference at {REFERENCE}; make one with python -m tests.test_determinism --write")
    reference = json.loads(REFERENCE.read_text(encoding="utf-8"))
    for name, boxes in smoke().items():
        expected = reference["boxes"][name]
        assert [box is None for box in boxes] == [box is None for box in expected], name
        pairs = [(a, b) for a, b in zip(boxes, expected, strict=True) if a is not None]
        edges = [np.subtract(corners(a), corners(b)) for a, b in pairs]
        assert np.abs(edges).max() <= ACROSS_VERSIONS, f"{name}: {np.abs(edges).max(axis=1).round(2).tolist()}"


def corners(box: list[float]) -> list[float]:
    """Left, top, right and bottom edge."""
    x, y, w, h = box
    return [x, y, x + w, y + h]


def answer() -> dict[str, Any]:
    """Boxes of the suite, with what they were made on."""
    boxes = smoke()
    pixels = hashlib.sha256(b"".join(sequence.frames.tobytes() for sequence in sequences())).hexdigest()
    return {
        "opencv": cv2.__version__,
        "pixels": pixels,
        "hash": hashlib.sha256(json.dumps(boxes).encode()).hexdigest(),
        "boxes": boxes,
    }


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        REFERENCE.parent.mkdir(exist_ok=True)
        REFERENCE.write_text(json.dumps(answer(), indent=None) + "\n", encoding="utf-8")
    else:
        print(json.dumps(answer()))
