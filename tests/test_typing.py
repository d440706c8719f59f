"""What type checkers say of users' programs."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.once

PROGRAM = """
from hs_tracker_cv import HornSchunck, PaperMethod, TrackerHS_Params, draw
from hs_tracker_cv.stages import StageParams

HornSchunck("fast")
TrackerHS_Params(mode="segmentation")
StageParams(mode="classic")
HornSchunck("fats")
TrackerHS_Params(mode="layer")
StageParams(mode="classics")
reveal_type(draw(PaperMethod().calc(0, 0)))
"""


@pytest.mark.slow
def test_misspelt_modes_fail_type_checking(tmp_path: Path) -> None:
    """Lines 8 to 10 are wrong, and no others; the last one has a type."""
    api = pytest.importorskip("mypy.api")
    (tmp_path / "program.py").write_text(PROGRAM)
    root = Path(__file__).resolve().parents[1]
    config = tmp_path / "mypy.ini"
    config.write_text(f"[mypy]\nmypy_path = {root}\nfollow_imports = silent\nignore_missing_imports = True\n")
    arguments = ["--config-file", str(config), "--cache-dir", str(tmp_path), "--strict", "--no-color-output"]
    said, _, _ = api.run([*arguments, "--python-executable", sys.executable, str(tmp_path / "program.py")])
    lines = [line.split(":", 2)[1:] for line in said.splitlines() if "program.py:" in line]
    errors = {int(number) for number, words in lines if "error" in words}
    assert errors == {8, 9, 10}
    assert "incompatible type \"Literal['fats']\"" in said
    assert 'Revealed type is "numpy.ndarray' in said
