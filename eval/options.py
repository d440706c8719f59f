"""Options that several subcommands share, each described once."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import tyro

__all__ = ["Dataset", "Jobs", "Only", "Out", "Paths", "Suite", "SuiteName", "Trackers"]

_SUITE = "Synthetic suite, drawn:N:SEED or drawn/THEME:N:SEED (SEED may be clock)"
SuiteName = Annotated[str, tyro.conf.arg(help=f"{_SUITE}.")]
Suite = Annotated[str | None, tyro.conf.arg(help=f'{_SUITE}; "standard" when no data set is given.')]
Dataset = Annotated[str | None, tyro.conf.arg(help="otb:DIR, vot:DIR, got10k:DIR or video:FILE+BOXFILE.")]
Trackers = Annotated[tuple[str, ...], tyro.conf.arg(help="Names, or pkg.module:factory.")]
Only = Annotated[tuple[str, ...], tyro.conf.arg(help="Only these sequences.")]
Jobs = Annotated[int, tyro.conf.arg(help="Processes at a time; time is measured with one whatever this says.")]
Paths = Annotated[
    tuple[str, ...], tyro.conf.arg(help="Files and folders that trackers may use besides their own code: weights.")
]
Out = Annotated[Path, tyro.conf.arg(help="Folder of all results; each suite or data set has one of its own in it.")]
