"""Compare flow methods where the true flow is known: ``python -m eval flow``.

Reads pairs (:mod:`eval.flow_data`), runs methods on them (:mod:`eval.flow_run`), and writes tables
(:mod:`eval.flow_tables`) and plots (:mod:`eval.flow_plots`). What was measured before, with the same code on the
same frames, is not measured again.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from .flow_data import FlowPair, dataset_pairs, suite_pairs
from .flow_methods import FLOW_METHODS, flow_method
from .flow_picture import flow_to_color, largest_flow
from .flow_run import FlowResult, MethodProcess, RunOptions, picture_path, run_pair

if TYPE_CHECKING:
    from rich.console import Console

__all__ = ["FlowOptions", "compare", "main_flow"]


@dataclass(frozen=True)
class FlowOptions:
    """Compare flow methods on true flow: endpoint and angular error, time, plots and flow pictures.

    Parameters
    ----------
    suite : tuple of str
        Synthetic suites (``python -m datasets_synthetic`` lists them).
    dataset : tuple of str
        ``middlebury:DIR``: a folder of NAME/frame10.png, frame11.png, flow10.flo.
    methods : tuple of str
        Names of methods, or ``pkg.module:factory``; all known ones when empty.
    out : Path
        Folder for results, tables, plots and pictures. A second run measures only what is missing.
    pairs : int
        Pairs taken from each synthetic sequence, spread over its length.
    repeats : int
        Most timed calls per pair; slow methods are timed once.
    timeout : float
        Longest time for one pair, s.
    """

    suite: tuple[str, ...] = ()
    dataset: tuple[str, ...] = ()
    methods: tuple[str, ...] = ()
    out: Path = Path("results/flow")
    pairs: int = 3
    repeats: int = 5
    timeout: float = 180.0


def collect_pairs(options: FlowOptions) -> list[FlowPair]:
    """All pairs asked for.

    Parameters
    ----------
    options : FlowOptions

    Returns
    -------
    list of FlowPair

    Raises
    ------
    ValueError
        If neither a suite nor a dataset is given, or two pairs have one name.
    """
    if not options.suite and not options.dataset:
        raise ValueError("expected --suite NAME or --dataset middlebury:DIR, got neither")
    pairs = [pair for name in options.suite for pair in suite_pairs(name, options.pairs)]
    pairs += [pair for name in options.dataset for pair in dataset_pairs(name)]
    names = [pair.name for pair in pairs]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"expected pairs of different names, got twice: {', '.join(twice)}")
    return pairs


def compare(
    pairs: Iterable[FlowPair],
    methods: Iterable[str],
    out: Path,
    *,
    options: RunOptions,
    progress: Callable[[str, str], None] = lambda method, pair: None,
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
    progress : callable, optional
        Called with (method, pair) before each run.

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
                progress(name, pair.name)
                results.append(run_pair(process, pair, out, options))
    return results


def _save_truth(pair: FlowPair, out: Path) -> None:
    import cv2

    picture = picture_path(out, pair.name, "truth")
    picture.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(picture), flow_to_color(pair.flow, largest_flow(pair.flow, pair.valid), pair.valid))
    cv2.imwrite(str(picture_path(out, pair.name, "frame")), pair.first)


def main_flow(options: FlowOptions) -> None:
    """Run the comparison and show it: the body of ``python -m eval flow``.

    Parameters
    ----------
    options : FlowOptions

    Raises
    ------
    ValueError
        If a method, suite or dataset is unknown.
    """
    from rich.console import Console

    from .flow_plots import save_plots
    from .flow_tables import results_frame, save_tables, show

    console = Console()
    pairs, methods = collect_pairs(options), options.methods or tuple(FLOW_METHODS)
    run_options = RunOptions(repeats=options.repeats, timeout=options.timeout)
    results = _with_progress(console, pairs, methods, options.out, run_options)
    table = results_frame(results)
    files = [*save_tables(table, options.out), *save_plots(table, options.out)]
    show(table, console)
    for file in files:
        console.print(f"wrote {file}", highlight=False)


def _with_progress(
    console: Console, pairs: list[FlowPair], methods: tuple[str, ...], out: Path, options: RunOptions
) -> list[FlowResult]:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("flow", total=len(pairs) * len(methods))
        done = -1

        def progress(method: str, pair: str) -> None:
            nonlocal done
            done += 1
            bar.update(task, completed=done, description=f"{method} · {pair}")

        results = compare(pairs, methods, out, options=options, progress=progress)
        bar.update(task, completed=done + 1, description="flow")
    return results
