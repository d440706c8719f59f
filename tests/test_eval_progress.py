"""What long work says while it runs."""

from __future__ import annotations

import io

import pytest
from rich.console import Console
from rich.table import Table

from eval import progress
from eval.progress import Steps

pytestmark = pytest.mark.once


def test_lines_where_there_is_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """In a file there is a line now and then with what is done so far, and one at the end."""
    monkeypatch.setattr(progress, "LINE_SECONDS", -1.0)
    text = io.StringIO()
    with Steps(Console(file=text, width=80), "work", 3) as steps:
        steps.advance("first")
        steps.advance()
        steps.say("look here")
    lines = text.getvalue().splitlines()
    assert [line[: len("work: n of 3")] for line in lines] == [
        "work: 1 of 3",
        "work: 2 of 3",
        "look here",
        "work: 2 of 3",
    ]


def test_tables_in_a_pipe_are_whole(capsys: pytest.CaptureFixture[str]) -> None:
    """However wide they are, nothing of them is cut or broken."""
    table = Table(*[f"column {number}" for number in range(40)])
    table.add_row(*["a value of some length"] * 40)
    progress.make_console().print(table)
    (row,) = [line for line in capsys.readouterr().out.splitlines() if "value" in line]
    assert row.count("a value of some length") == 40


def test_a_bar_on_a_terminal() -> None:
    """A terminal gets a bar, and no lines."""
    text = io.StringIO()
    with Steps(Console(file=text, force_terminal=True, width=80), "work", 2) as steps:
        steps.advance("first")
    assert "1/2" in text.getvalue()
    assert "of 2 in" not in text.getvalue()


def test_words_of_others_are_shown_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    """A tracker's complaint or the name of a folder is no markup of Rich's, and none can end the run."""
    words = "raised [red]no[/green] :x: of drawn:100:5"
    console = progress.make_console()
    with Steps(console, words, 1) as steps:
        steps.say(words)
        steps.advance(words)
    table = Table(words, title=words)
    table.add_row(words)
    console.print(table)
    assert capsys.readouterr().out.count(words) == 5


def test_words_of_others_in_a_bar() -> None:
    """The bar shows them unchanged too."""
    text = io.StringIO()
    with Steps(Console(file=text, force_terminal=True, width=120), "[bold]x :x: [/y]", 1) as steps:
        steps.advance("drawn:100:5 [/z]")
    assert "[bold]x :x: [/y]  drawn:100:5 [/z]" in text.getvalue()
