"""Command line: ``python -m datasets_synthetic render SUITE --out DIR`` and ``python -m datasets_synthetic list``."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any, NoReturn

import tyro
from rich.console import Console
from rich.progress import track
from rich.table import Table

from .export import FORMATS, PREVIEWS, write_image
from .preview import contact_sheet
from .render import render
from .suites import SUITES, canonical
from .suites import suite as specs_of
from .themes import THEMES

_FORMAT_NAMES = ", ".join(FORMATS)


def _console(**options: Any) -> Console:
    """Console that shows every text as it is: `:100:` of a draw is no picture, `[red]` of a path no colour."""
    return Console(markup=False, emoji=False, **options)


def _fail(message: str, code: int = 2) -> NoReturn:
    _console(stderr=True, soft_wrap=True).print(message, style="bold red", highlight=False)
    sys.exit(code)


def render_suite(
    suite: tyro.conf.Positional[str],
    /,
    *,
    out: Path,
    format: Annotated[str, tyro.conf.arg(help=f"one of {_FORMAT_NAMES}")] = "otb",  # noqa: A002 - the option's name
    preview: bool = False,
) -> None:
    """Render a suite to files: frames and truth, one folder per sequence.

    Parameters
    ----------
    suite
        Name of the suite; `list` shows them. `drawn:N:SEED` and `drawn/THEME:N:SEED` are draws of a distribution.
    out
        Folder to write to; made when missing.
    format
        Layout of the files.
    preview
        Also write a picture of each sequence into `previews`: eight frames with the truth drawn in.

    Folders of an earlier export are written anew; what others have put there stays.
    """
    try:
        suite = canonical(suite)
    except ValueError as error:
        _fail(str(error))
    if format not in FORMATS:
        _fail(f"no format {format!r}; known: {_FORMAT_NAMES}")
    console = _console()
    specs = specs_of(suite)
    try:
        for spec in track(specs, description="rendering", console=console):
            sequence = render(spec)
            FORMATS[format](sequence, out)
            if preview:
                # Not beside the frames, where readers would take it for one of them.
                write_image(out / PREVIEWS / f"{sequence.name}.png", contact_sheet(sequence))
    except OSError as error:
        reason = f"{error.filename}: cannot be written ({error.strerror})" if error.filename else str(error)
        _fail(reason, 1)
    except ValueError as error:
        _fail(str(error), 1)
    console.print(f"{len(specs)} sequences of suite {suite} in {out}", highlight=False)


def list_suites() -> None:
    """List the suites and their sequences, and the themes of the distributions."""
    console = _console()
    for suite, specs in SUITES.items():
        table = Table("sequence", "size", "frames", "attributes", "digest", title=f"{suite} ({len(specs)})")
        for spec in specs:
            size = f"{spec.size[0]} × {spec.size[1]}"
            table.add_row(spec.name, size, str(spec.frames), ", ".join(spec.attributes), spec.digest())
        console.print(table)
    console.print(f"drawn:N:SEED, drawn/THEME:N:SEED with the themes {', '.join(THEMES)}", highlight=False)


def main() -> None:
    """Run the command line."""
    tyro.extras.subcommand_cli_from_dict(
        {"render": render_suite, "list": list_suites},
        prog="python -m datasets_synthetic",
        description="The laboratory: videos whose truth is known exactly because we drew them.",
    )


if __name__ == "__main__":
    main()
