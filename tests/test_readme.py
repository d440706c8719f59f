"""README tells the truth: its example runs as it stands."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.conftest import moving_square

ROOT = Path(__file__).resolve().parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def example() -> str:
    """The one Python block of README."""
    (code,) = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    return str(code)


def test_the_example_follows_the_object(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Run on a video with a mover in the example's box, it prints a true answer for every frame."""
    frames, _ = moving_square(np.random.default_rng(1))
    writer = cv2.VideoWriter(str(tmp_path / "video.avi"), cv2.VideoWriter_fourcc(*"FFV1"), 25, (160, 120))
    for frame in frames:
        writer.write(frame)
    writer.release()
    monkeypatch.chdir(tmp_path)
    exec(compile(example(), "README.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == len(frames) - 1
    assert all(line.startswith("True (") for line in lines)


def test_files_that_are_named_exist() -> None:
    """Pictures and modules that README points at are in the repository."""
    for path in re.findall(r"`((?:hs_tracker_cv|tests|eval|benchmarks)/[\w/]+\.py)`|\]\((docs/[\w.]+)\)", README):
        name = path[0] or path[1]
        assert (ROOT / name).is_file(), name
