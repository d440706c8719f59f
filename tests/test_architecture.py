"""Dependencies point one way."""

from __future__ import annotations

import ast
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytestmark = pytest.mark.once

ROOT = Path(__file__).resolve().parents[1]
TESTS = Path(__file__).parent
FORBIDDEN = {
    "hs_tracker_cv": {"eval", "datasets_synthetic", "pandas", "joblib"},
    "datasets_synthetic": {"eval", "hs_tracker_cv", "pandas"},
}


_LOOPS = {"_native", "frames", "geometry", "scalars", "validation"}
ROOMS = {
    # what each of the library's rooms may take from the others, as data flows in docs/algorithm.md
    "estimate": {"geometry"},
    "flow": _LOOPS | {"display"},  # for Jupyter
    "segmentation": _LOOPS | {"estimate", "flow"},
    "patch_tracker": _LOOPS | {"estimate", "flow"},
    "redetection": {"frames", "geometry", "segmentation", "validation"},
    "overview": {"_native", "frames", "validation"},
    "arbitration": {
        "estimate", "frames", "geometry", "overview", "params", "patch_tracker", "redetection", "segmentation",
        "validation",
    },
    "tracker": {"arbitration", "display", "flow", "frames", "geometry", "params", "validation"},
}  # fmt: skip


def neighbours(path: Path) -> Iterator[str]:
    """Rooms of the library that a file imports, at any depth of nesting."""
    home = path.relative_to(ROOT / "hs_tracker_cv").parent.parts
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.level:
            base = home[: len(home) - (node.level - 1)]
            module = (*base, *(node.module or "").split(".")) if node.module else base
            yield from [module[0]] if module else [alias.name for alias in node.names]


def imported(path: Path) -> Iterator[str]:
    """Top-level names of absolute imports in a file, at any depth of nesting."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.split(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.level == 0 and node.module:
            yield node.module.split(".")[0]


@pytest.mark.parametrize("package", sorted(FORBIDDEN))
def test_packages_do_not_import_their_users(package: str) -> None:
    """The library knows neither referee nor laboratory; the laboratory knows neither of the others."""
    files = sorted((ROOT / package).rglob("*.py"))
    assert files
    wrong = {str(path.relative_to(ROOT)): FORBIDDEN[package] & set(imported(path)) for path in files}
    assert not {path: names for path, names in wrong.items() if names}


@pytest.mark.parametrize("room", sorted(ROOMS))
def test_rooms_take_from_those_below_them_only(room: str) -> None:
    """Arbitration knows the modes, they know flow and frames, and nobody knows who asks."""
    place = ROOT / "hs_tracker_cv" / room
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place.with_suffix(".py")]
    taken = {name for path in files for name in neighbours(path)} - {room}
    assert taken
    assert taken <= ROOMS[room]


def test_pages_take_nothing_from_the_command_line() -> None:
    """What both need has rooms of its own."""
    for path in (ROOT / "hs_tracker_cv" / "app").glob("*.py"):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        taken = [node.module or "" for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
        assert not [module for module in taken if module.split(".")[0] == "cli"], path


def test_importing_the_library_imports_no_compiler() -> None:
    """`import hs_tracker_cv` stays cheap: no scikit-image or page until they are used."""
    heavy = "'skimage', 'nicegui', 'scipy', 'matplotlib'"
    code = f"import hs_tracker_cv, sys; print([m for m in ({heavy}) if m in sys.modules])"
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert answer.stdout.strip() == "[]"


def test_legacy_is_there_after_importing_the_package_alone() -> None:
    """As ``cv2.legacy`` is after ``import cv2``; and it costs nothing before it is used."""
    code = (
        "import hs_tracker_cv, sys; before = 'hs_tracker_cv.legacy' in sys.modules;"
        "print(before, hs_tracker_cv.legacy.TrackerHS_create().update(None))"
    )
    answer = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    assert answer.stdout.strip() == "False (False, (0.0, 0.0, 0.0, 0.0))"


def test_one_place_says_what_becomes_of_floating_point_errors() -> None:
    """Public functions share one rule; inside, nothing else is said of ``np.errstate``."""
    rooms = (ROOT / "hs_tracker_cv").rglob("*.py")
    told = [path.name for path in rooms if "np.errstate" in path.read_text(encoding="utf-8")]
    assert told == ["frames.py"]


def test_every_public_name_exists() -> None:
    """The lazy table and the modules agree."""
    import hs_tracker_cv

    for name in hs_tracker_cv.__all__:
        assert getattr(hs_tracker_cv, name) is not None
    with pytest.raises(AttributeError, match="Tracker9"):
        _ = hs_tracker_cv.Tracker9


def test_both_versions_of_opencv_are_tested() -> None:
    """`make test-matrix` runs tests in an environment of each, and continuous integration runs that."""
    if shutil.which("make") is None:
        pytest.skip("no make on this machine")
    answer = subprocess.run(["make", "-n", "test-matrix"], capture_output=True, text=True, check=True, cwd=ROOT)
    for version in ("4", "5"):
        assert f".venv-cv{version}/bin/python -m pytest" in answer.stdout
        assert f".venv-cv{version}/bin/python -m eval check" in answer.stdout
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert [f"OPENCV{version} := opencv-contrib-python-headless~={version}." in makefile for version in "45"] == [
        True
    ] * 2
    assert "\nmake test-matrix\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def test_the_oldest_that_is_promised_is_tested() -> None:
    """`make test-oldest` installs what pyproject gives as the least, and continuous integration runs it."""
    if shutil.which("make") is None:
        pytest.skip("no make on this machine")
    promised = re.findall(
        r'"(opencv-contrib-python-headless|numpy)>=([\d.]+)"', (ROOT / "pyproject.toml").read_text()
    )
    assert [name for name, _ in promised] == ["opencv-contrib-python-headless", "numpy"]
    command = ["make", "-n", "--always-make", "test-oldest"]
    answer = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    for name, version in promised:
        assert f'"{name}=={version}.*' in answer.stdout
    assert ".venv-oldest/bin/python -m pytest" in answer.stdout
    assert "\nmake test-oldest " in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


ABOUT_OTHER_THINGS = {
    # files whose tests need a whole tracker or page, and say nothing of what OpenCV makes of a frame
    "test_app.py": "what the page does in a browser; what it shows is test_app_session.py's, on every OpenCV",
    "test_app_guard.py": "addresses, tokens, ports and processes",
    "test_docs.py": "the documents, which are built on one OpenCV",
}


def test_what_is_tested_once_is_no_work_of_opencvs() -> None:
    """A file of tests marked `once` imports nothing that uses cv2, and nobody's tracker, but for the files named."""
    files = [
        path for path in TESTS.glob("test_*.py") if "\npytestmark = pytest.mark.once\n" in path.read_text("utf-8")
    ]
    assert len(files) > 10
    wrong = {path.name for path in files if any(uses_opencv(name) for name in modules(path))}
    assert wrong == set(ABOUT_OTHER_THINGS)
    assert "\npytestmark" not in (TESTS / "test_app_session.py").read_text("utf-8")


def modules(path: Path) -> Iterator[str]:
    """Full names of what a file imports at its top."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            inner = [f"{node.module}.{alias.name}" for alias in node.names]
            yield from (
                name if ROOT.joinpath(*name.split(".")).with_suffix(".py").exists() else node.module for name in inner
            )


def uses_opencv(name: str) -> bool:
    """Whether a module is of the library and asks OpenCV, or holds trackers or methods of flow."""
    if name.startswith(("eval.baselines", "eval.flow")):
        return True
    if name.split(".")[0] != "hs_tracker_cv" or name.startswith("hs_tracker_cv._native"):
        return False
    path = ROOT.joinpath(*name.split(".")).with_suffix(".py")
    return not path.exists() or "cv2" in imported(path)
