"""Compare flow methods where the true flow is known: ``python -m eval flow``.

Reads pairs (:mod:`eval.flow.data`), runs methods on them (:mod:`eval.flow.run`), and writes tables
(:mod:`eval.flow.tables`) and plots (:mod:`eval.flow.plots`). What was measured before, with the same code on the
same frames, is not measured again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import cv2

from ..options import Out, Suite, at_least
from ..progress import Steps, make_console
from ..results import FlowResult
from ..sequences import canonical_suite, suite_folder
from .data import FlowPair, dataset_pairs, suite_pairs
from .methods import FLOW_METHODS, flow_method
from .picture import flow_to_color, largest_flow
from .run import MethodProcess, RunOptions, picture_path, run_pair

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["collect_pairs", "compare", "main_flow"]


def collect_pairs(suite: str | None, dataset: str | None, count: int) -> Iterator[FlowPair]:
    """Pairs of a suite or a dataset.

    Parameters
    ----------
    suite, dataset : str or None
        One of them.
    count : int
        Pairs per sequence of a suite.

    Returns
    -------
    iterator of FlowPair

    Raises
    ------
    ValueError
        If both or none are given, or the one that is given is unknown.
    """
    if (suite is None) == (dataset is None):
        raise ValueError(f"expected either a suite or a dataset, got suite {suite!r} and dataset {dataset!r}")
    return dataset_pairs(dataset) if dataset is not None else suite_pairs(str(suite), count)


def compare(
    pairs: Iterable[FlowPair],
    methods: Iterable[str],
    out: Path,
    *,
    options: RunOptions,
    done: Callable[[str, str], None] = lambda method, pair: None,
) -> list[FlowResult]:
    """Every method on every pair.

    Parameters
    ----------
    pairs : iterable of FlowPair
    methods : iterable of str
        Checked before anything runs.
    out : Path
        Where results and pictures are kept.
    options : RunOptions
    done : callable, optional
        Called with (method, pair) after each run.

    Returns
    -------
    list of FlowResult
        One per method and pair; a failure is a result with a note.

    Raises
    ------
    ValueError
        If a method is unknown.
    """
    pairs, methods = list(pairs), list(methods)
    for name in methods:
        flow_method(name)
    for pair in pairs:
        _save_truth(pair, out)
    results = []
    for name in methods:
        with MethodProcess(name) as process:
            for pair in pairs:
                results.append(run_pair(process, pair, out, options))
                done(name, pair.name)
    return results


def _save_truth(pair: FlowPair, out: Path) -> None:
    picture = picture_path(out, pair.name, "truth")
    picture.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(picture), flow_to_color(pair.flow, largest_flow(pair.flow, pair.valid), pair.valid))
    cv2.imwrite(str(picture_path(out, pair.name, "frame")), pair.first)


def main_flow(
    *,
    suite: Suite = None,
    dataset: str | None = None,
    methods: tuple[str, ...] = (),
    pairs: Annotated[int, at_least(1)] = 2,
    repeats: Annotated[int, at_least(1)] = 5,
    timeout: float = 180.0,
    out: Out = Path("results/flow"),
) -> None:
    """Compare flow methods on true flow: error, time, plots, pictures. What has been measured is not measured again.

    Parameters
    ----------
    dataset
        middlebury:DIR, a folder of NAME/frame10.png, frame11.png, flow10.flo; or kitti:DIR.
    methods
        Names, or pkg.module:factory; all known ones if not given.
    pairs
        Pairs taken from each sequence of a suite, spread over its length.
    repeats
        Most timed calls per pair; slow methods get fewer.
    timeout
        Seconds for one method on one pair.
    """
    from .plots import save_plots
    from .tables import results_frame, save_tables, show

    if suite is None and dataset is None:
        suite = "standard"
    suite = suite and canonical_suite(suite)
    names = tuple(dict.fromkeys(methods)) or tuple(FLOW_METHODS)
    for name in names:
        flow_method(name)  # an unknown name must not cost the rendering of a suite
    console = make_console()
    with console.status("loading the pairs"):
        material = list(collect_pairs(suite, dataset, pairs))
    folder = out / (suite_folder(suite) if suite else str(dataset).partition(":")[0])
    results = _with_progress(console, material, names, folder, RunOptions(repeats=repeats, timeout=timeout))
    table = results_frame(results)
    files = [*save_tables(table, folder), *save_plots(table, folder)]
    show(table, console)
    for file in files:
        console.print(f"wrote {file}", highlight=False)


def _with_progress(
    console: Console, pairs: list[FlowPair], methods: tuple[str, ...], out: Path, options: RunOptions
) -> list[FlowResult]:
    with Steps(console, "flow", len(pairs) * len(methods)) as steps:
        return compare(
            pairs, methods, out, options=options, done=lambda method, pair: steps.advance(f"{method} · {pair}")
        )
