"""Options that several subcommands share, each described once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro
from tyro.constructors import PrimitiveConstructorSpec

__all__ = [
    "Dask", "Dataset", "Datasets", "Jobs", "Models", "Only", "Out", "Paths", "Scenes", "StoredSuite", "Suite",
    "SuiteName", "Suites", "Trackers", "at_least", "listed",
]  # fmt: skip


def at_least(least: int) -> PrimitiveConstructorSpec[int]:
    """Whole numbers from `least` on, for an option: others are refused before anything is done."""

    def parsed(words: list[str]) -> int:
        number = int(words[0])
        if number < least:
            raise ValueError(f"expected at least {least}, got {number}")
        return number

    return PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=parsed,
        is_instance=lambda value: isinstance(value, int),
        str_from_instance=lambda value: [str(value)],
    )


_SUITE = "Synthetic suite, drawn:N:SEED or drawn/THEME:N:SEED (SEED may be clock)"
SuiteName = Annotated[str, tyro.conf.arg(help=f"{_SUITE}.")]
Suite = Annotated[str | None, tyro.conf.arg(help=f'{_SUITE}; "standard" when no data set is given.')]
_DATASET = "otb:, vot:, got10k:, lasot:, mot:, coco:DIR, video:FILE+BOXFILE or csv:VIDEO+FILE; or the path alone"
Dataset = Annotated[str | None, tyro.conf.arg(help=f"{_DATASET}.")]
StoredSuite = Annotated[
    str | None, tyro.conf.arg(help=f"{_SUITE}; all that has been run when no data set is given, either.")
]
Trackers = Annotated[tuple[str, ...], tyro.conf.arg(help="Names, or pkg.module:factory.")]
Suites = Annotated[tuple[str, ...], tyro.conf.arg(help=f"{_SUITE}; any number.")]
Datasets = Annotated[tuple[str, ...], tyro.conf.arg(help=f"{_DATASET}; any number.")]
Only = Annotated[
    tuple[str, ...], tyro.conf.arg(help="Only these sequences; @FILE: the names in a file, a line each.")
]
Scenes = Annotated[
    Path | None,
    tyro.conf.arg(help="CSV with the columns sequence and scene: what shares a camera is no independent evidence."),
]
Jobs = Annotated[
    int, tyro.conf.arg(help="Processes at a time; time is measured with one whatever this says."), at_least(1)
]
Dask = Annotated[str, tyro.conf.arg(help="Address of a Dask scheduler: its workers run the trackers instead.")]
Models = Annotated[
    Path | None, tyro.conf.arg(help="Folder of the model files of TrackerNano, TrackerVit, DaSiamRPN.")
]
Paths = Annotated[
    tuple[str, ...], tyro.conf.arg(help="Files and folders that trackers may use besides their own code: weights.")
]
Out = Annotated[Path, tyro.conf.arg(help="Folder of all results; each suite or data set has one of its own in it.")]


def listed(names: tuple[str, ...]) -> tuple[str, ...]:
    """Names, with those of the files in the place of ``@FILE``; lines that are empty or begin with # say nothing.

    Raises
    ------
    OSError
        If a file cannot be read.
    """
    found: list[str] = []
    for name in names:
        lines = Path(name[1:]).read_text(encoding="utf-8").splitlines() if name.startswith("@") else [name]
        found += [line.strip() for line in lines if line.strip() and not line.lstrip().startswith("#")]
    return tuple(found)
