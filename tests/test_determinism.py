"""The same frames give the same boxes: from run to run, in any process, with any number of threads, on any OpenCV.

``python -m tests.test_determinism`` prints the boxes of the suite `smoke` as JSON, or those of the clips in the file
named; with ``--write`` it makes them the reference in ``tests/data/smoke_boxes.json`` that every version of OpenCV is
held to.
"""

from __future__ import annotations

import functools
import hashlib
import json
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from datasets_synthetic import SUITES, render
from hs_tracker_cv import TrackerHS_create, TrackerHS_Params
from tests.conftest import moving_square

ROOT = Path(__file__).resolve().parents[1]
REFERENCE = ROOT / "tests" / "data" / "smoke_boxes.json"
REWRITTEN = 0.01
"""Distance of box edges from the reference, px: sums may be taken in another order than when it was made."""

OTHER = ROOT / (".venv-cv4" if cv2.__version__.startswith("5") else ".venv-cv5") / "bin" / "python"
"""The interpreter with the other major version of OpenCV, where ``make test-matrix`` has made one."""

OPENCV = tuple(int(part) for part in cv2.__version__.split(".")[:2])

Track = list[list[float] | None]


class Clip(NamedTuple):
    """Frames, and the box to start from."""

    frames: NDArray[Any]
    box: tuple[float, ...]


@functools.cache
def clips() -> dict[str, Clip]:
    """The suite `smoke`, rendered once."""
    rendered = [render(spec) for spec in SUITES["smoke"]]
    return {sequence.name: Clip(sequence.frames, tuple(sequence.boxes[0])) for sequence in rendered}


def track(clip: Clip, mode: str = "auto") -> Track:
    """Sub-pixel boxes of a clip; None where the answer is False."""
    tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
    tracker.init(clip.frames[0], clip.box)
    boxes: Track = []
    for frame in clip.frames[1:]:
        ok, _ = tracker.update(frame)
        boxes.append([float(value) for value in tracker.box or ()] if ok else None)
    return boxes


def smoke(mode: str = "auto") -> dict[str, Track]:
    """Boxes of the whole suite."""
    return {name: track(clip, mode) for name, clip in clips().items()}


def elsewhere(*arguments: str, python: str = sys.executable, **environment: str) -> dict[str, Any]:
    """What this file prints in a process of its own."""
    done = subprocess.run(
        [python, "-m", "tests.test_determinism", *arguments],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
        cwd=ROOT,
        timeout=300,
    )
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


@pytest.mark.parametrize("mode", ["auto", "segmentation", "patch_tracker"])
def test_runs_are_equal_bit_by_bit(mode: str) -> None:
    """Nothing is random."""
    assert smoke(mode) == smoke(mode)


@pytest.mark.parametrize("mode", ["segmentation", "patch_tracker"])
@pytest.mark.parametrize("size", [(23.5, 27.5), (32, 32), (21, 40), (44, 29), (18, 18), (37, 26)])
def test_no_result_depends_on_where_an_array_lies(size: tuple[float, float], mode: str) -> None:
    """The last bits of some SIMD code (cv2.magnitude) depend on the address of its arrays; no state of ours does."""
    frames, boxes = moving_square(np.random.default_rng(3), count=5)
    frames[2] = np.full_like(frames[2], 255)
    rng, clutter, states = np.random.default_rng(1), [], set()
    for _ in range(10):
        # Blocks of odd sizes, kept for a while, move what is allocated after them.
        clutter = [*clutter[-int(rng.integers(1, 30)) :], np.ones(rng.integers(1, 20_000), np.float32)]
        tracker = TrackerHS_create(TrackerHS_Params(mode=mode))
        tracker.init(frames[0], (*boxes[0][:2], *size))
        for frame in frames[1:]:
            tracker.update(frame)
        states.add(pickle.dumps(tracker))
    assert len(states) == 1


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
        pytest.param({"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}, id="one-thread"),
        pytest.param({"OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2", "PYTHONHASHSEED": "7"}, id="two-threads"),
    ],
)
def test_another_process_gives_the_same_boxes(environment: dict[str, str]) -> None:
    """Neither the process, nor its threads, nor its hash seed can be seen in the boxes."""
    assert elsewhere(**environment)["boxes"] == smoke()


def test_every_opencv_gives_the_boxes_of_the_reference() -> None:
    """The committed boxes but for the order of sums, and False in the same frames."""
    reference = json.loads(REFERENCE.read_text(encoding="utf-8"))["boxes"]
    answers = smoke()
    assert list(answers) == list(reference)
    for name, boxes in answers.items():
        pairs = list(zip(boxes, reference[name], strict=True))
        assert not [frame for frame, (a, b) in enumerate(pairs) if (a is None) != (b is None)], name
        apart = [np.abs(np.subtract(corners(a), corners(b))).max() for a, b in pairs if a and b]
        assert max(apart) <= REWRITTEN, f"{name}: {np.round(apart, 3).tolist()}"


@pytest.mark.skipif(not OTHER.is_file(), reason=f"no {OTHER}: make test-matrix makes it")
@pytest.mark.skipif(
    OPENCV < (4, 13), reason="cv2.sepFilter2D rounds otherwise before OpenCV 4.13; the reference holds"
)
def test_both_opencvs_give_the_same_boxes_bit_by_bit(tmp_path: Path) -> None:
    """4.13 and 5.0, on the frames of this process: NumPy paints the last bits of a sequence by its own version."""
    handed = tmp_path / "clips.npz"
    np.savez(
        handed,
        **{f"{name}.{part}": array for name, clip in clips().items() for part, array in clip._asdict().items()},
    )
    answer = elsewhere(str(handed), python=str(OTHER))
    assert answer["opencv"].split(".")[0] != cv2.__version__.split(".")[0]
    assert answer["boxes"] == smoke()


def corners(box: list[float]) -> list[float]:
    """Left, top, right and bottom edge."""
    x, y, w, h = box
    return [x, y, x + w, y + h]


def answer(handed: dict[str, Clip]) -> dict[str, Any]:
    """Boxes of the clips, with what they were made on."""
    boxes = {name: track(clip) for name, clip in handed.items()}
    pixels = hashlib.sha256(b"".join(clip.frames.tobytes() for clip in handed.values())).hexdigest()
    return {
        "opencv": cv2.__version__,
        "pixels": pixels,
        "hash": hashlib.sha256(json.dumps(boxes).encode()).hexdigest(),
        "boxes": boxes,
    }


if __name__ == "__main__":
    if sys.argv[1:] == ["--write"]:
        REFERENCE.parent.mkdir(exist_ok=True)
        REFERENCE.write_text(json.dumps(answer(clips()), indent=None) + "\n", encoding="utf-8")
    elif sys.argv[1:]:
        with np.load(sys.argv[1]) as handed:
            names = list(dict.fromkeys(key.rpartition(".")[0] for key in handed))
            print(
                json.dumps(
                    answer({name: Clip(handed[f"{name}.frames"], tuple(handed[f"{name}.box"])) for name in names})
                )
            )
    else:
        print(json.dumps(answer(clips())))
