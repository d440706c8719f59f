"""The documents say what is there: functions they name exist, links lead somewhere, pictures are those of scripts."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import pytest

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


@pytest.mark.parametrize("page", [page.name for page in PAGES])
def test_links_lead_somewhere(page: str) -> None:
    """Links to files of the documents; whether anchors exist is checked by ``mkdocs build --strict``."""
    text = (DOCS / page).read_text(encoding="utf-8")
    for target in re.findall(r"\]\(([^)#\s]+)", text):
        if "://" not in target:
            assert (DOCS / target).exists(), target
