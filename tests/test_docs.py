"""The documents say what is there: functions they name exist, links lead somewhere, pictures are those of scripts."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

import hs_tracker_cv

pytestmark = pytest.mark.once

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(DOCS.glob("*.md"))
NAME = re.compile(r"`((?:[A-Za-z_]\w*)(?:\.[A-Za-z_]\w*)+)`")


def resolved(name: str) -> Any:
    """What a dotted name inside hs_tracker_cv stands for."""
    parts = name.removeprefix("hs_tracker_cv.").split(".")
    for length in range(len(parts), 0, -1):
        try:
            found: Any = import_module(".".join(("hs_tracker_cv", *parts[:length])))
        except ModuleNotFoundError:
            continue
        for attribute in parts[length:]:
            found = getattr(found, attribute)
        return found
    raise ModuleNotFoundError(name)


@pytest.mark.parametrize("page", ["algorithm.md", "paper.md"])
def test_functions_that_the_documents_name_exist(page: str) -> None:
    """Every dotted name in code is one of the library's; a rename makes the page fail."""
    names = set(NAME.findall((DOCS / page).read_text(encoding="utf-8")))
    assert len(names) > 10
    for name in sorted(names):
        assert resolved(name) is not None, name


def test_a_stale_name_would_be_found() -> None:
    """Modules that are gone, and attributes."""
    with pytest.raises(ModuleNotFoundError):
        resolved("no_such_room.step")
    with pytest.raises(AttributeError):
        resolved("tracker.no_such_function")


def test_the_algorithm_stays_on_a_page() -> None:
    """In about forty lines of steps, each with a function in it."""
    text = (DOCS / "algorithm.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 75
    steps = re.split(r"\n(?=\d+\. )", text)[1:]
    assert [int(step.split(".")[0]) for step in steps] == list(range(1, len(steps) + 1))
    assert [step for step in steps if not NAME.search(step)] == []


def test_the_figure_is_that_of_its_script() -> None:
    """`python -m docs.figures` has been run after the last change."""
    figures = import_module("docs.figures")
    assert (DOCS / "algorithm.svg").read_text(encoding="utf-8") == figures.figure()


def test_the_numbers_are_those_of_the_code() -> None:
    """`python -m docs.tuning` has been run after the last change, and every number says what it is."""
    tuning = import_module("docs.tuning")
    page = (DOCS / "tuning.md").read_text(encoding="utf-8")
    assert page == tuning.text()
    rows = re.findall(r"^\| `.*` \| .* \| (.*) \|$", page, flags=re.M)
    assert len(rows) > 150
    assert all(rows)


@pytest.mark.parametrize("page", [page.name for page in PAGES])
def test_links_lead_somewhere(page: str) -> None:
    """Links to files of the documents; whether anchors exist is checked by ``mkdocs build --strict``."""
    text = (DOCS / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        # Pages of notebooks are made when the site is built.
        source = target.replace(".md", ".ipynb") if target.startswith("notebooks/") else target
        if "://" not in target:
            assert (DOCS / source).exists(), target


@pytest.mark.slow
def test_the_site_builds_and_asks_for_nothing_from_elsewhere(tmp_path: Path) -> None:
    """Strictly: no link leads nowhere, every name of the API is found; scripts, styles and pictures are its own.

    The notebooks run for it, and their pictures are on its pages.
    """
    pytest.importorskip("mkdocstrings")
    pytest.importorskip("nbconvert")
    if not (ROOT / "hs_tracker_cv").is_dir():
        pytest.skip("the wheel is tested, and there are no sources to read the API from")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(tmp_path)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    pages = [path.read_text(encoding="utf-8") for path in tmp_path.rglob("*.html")]
    assert len(pages) > len(PAGES) + 3
    pictures = {"own_video": 3, "horn_schunck": 4, "referee": 0}
    for name, count in pictures.items():
        page = (tmp_path / "notebooks" / f"{name}.html").read_text(encoding="utf-8")
        assert len(re.findall(rf'<img[^>]* src="{name}/[^"]*\.png"', page)) == count, name
        assert len(list((tmp_path / "notebooks" / name).glob("*.png"))) == count, name
    for page in pages:
        assert re.findall(r'<(?:script|img|iframe|link)[^>]*(?:src|href)="?(?:https?:)?//[^>]*', page) == []
    api = (tmp_path / "api.html").read_text(encoding="utf-8")
    for name in hs_tracker_cv.__all__:
        if name not in ("__version__", "legacy"):
            assert name in api, name


def test_notebooks_are_committed_without_outputs() -> None:
    """They are run when the site is built; outputs would be stale, and large."""
    notebooks = sorted((DOCS / "notebooks").glob("*.ipynb"))
    assert len(notebooks) == 3
    for path in notebooks:
        cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
        assert [cell for cell in cells if cell.get("outputs") or cell.get("execution_count")] == []
