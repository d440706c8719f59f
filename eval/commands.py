"""The subcommands of ``python -m eval``: they parse, print and exit; the work is done elsewhere."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import pandas as pd
import tyro
from rich.text import Text

from . import ablation, regression
from .accuracy import Job, make_jobs, run_jobs
from .datasets import canonical_dataset, load_dataset
from .options import (
    Dask,
    Dataset,
    Datasets,
    Jobs,
    Models,
    Only,
    Out,
    Paths,
    Scenes,
    StoredSuite,
    Suite,
    SuiteName,
    Suites,
    Trackers,
    at_least,
    listed,
)
from .plots import write_figure
from .process import Limits
from .progress import Steps, make_console
from .protocol_tables import protocol_tables
from .protocols import ONE_PASS, Protocol, find_protocol
from .report import write_figures, write_report
from .results import COMPLETED, Folder, ResultsError, Run, SpeedRun
from .sequences import Sequence, canonical_suite, load_suite, suite_folder
from .speed import BLOCK, TIMED_UPDATES, measure_speed
from .sweep import BOX, Grid, sweep_figure, sweep_jobs, sweep_sequences, sweep_table, sweep_text
from .tables import (
    Summary,
    brief_table,
    console_table,
    counted,
    failure_table,
    format_cell,
    protocol_text,
    protocol_title,
    sequence_table,
    speed_overall_text,
    speed_text,
    summarise_folder,
    theme_table,
    worst_table,
    write_numbers,
    write_table,
    write_tables,
)
from .trackers import DEFAULT_TRACKERS, TrackerSpec, find_tracker
from .truthfiles import SequenceError, read_scenes

__all__ = ["ablate", "bench", "check", "merge", "report", "run", "speed", "sweep"]

_console = make_console()


def run(
    *,
    suite: Suite = None,
    dataset: Dataset = None,
    trackers: Trackers = DEFAULT_TRACKERS,
    sequences: Only = (),
    scenes: Scenes = None,
    jobs: Jobs = 2,
    timeout: float = 300.0,
    memory: float = 2048.0,
    processes: int = 64,
    protocol: str = ONE_PASS.name,
    starts: Annotated[int, at_least(0)] = 0,
    frames: int | None = None,
    retry_failed: bool = False,
    paths: Paths = (),
    models: Models = None,
    dask: Dask = "",
    shard: str = "1/1",
    out: Out = Path("results"),
) -> None:
    """Run trackers over a suite or data set and store what they answer. What has been run is not run again.

    Parameters
    ----------
    timeout
        Seconds for one tracker on one sequence.
    memory
        Megabytes for one tracker, with all processes that it starts.
    processes
        How many those may be at a time.
    protocol
        one-pass, sre, tre, restarts, realtime (20 frames a second), realtime:FPS or long-term.
    starts
        In one pass: besides the exact start box, so many perturbed by up to ±10 %.
    frames
        Only the first so many of each sequence.
    retry_failed
        Run those again that failed before.
    shard
        I/N: only every N-th sequence from the I-th on, as one of N machines; `merge` brings their results together.
    """
    specs = [find_tracker(name, models) for name in dict.fromkeys(trackers)]
    led = find_protocol(protocol)
    if starts and led is not ONE_PASS:
        raise ValueError(f"expected --starts with --protocol {ONE_PASS.name}, got it with {protocol}")
    first, step = _shard(shard)
    folder, found = _open(out, suite, dataset, sequences, frames=frames, scenes=scenes)
    limits = Limits(timeout, memory, processes, paths)
    part = found[first::step]
    if any("hs_tracker_cv" in spec.sources for spec in specs):
        import hs_tracker_cv._native  # noqa: F401 - says that it is not built before all runs say so one by one
    _run_with_progress(specs, part, folder, jobs, limits, starts, retry_failed, led, dask)
    names = [spec.name for spec in specs]
    if part and led is ONE_PASS:
        _print_summary(folder, names)
    elif part:
        _print_protocol(folder, names, led)


def _shard(text: str) -> tuple[int, int]:
    """Index of the first sequence of ``I/N``, and the step to the next."""
    number, slash, count = text.partition("/")
    if not (slash and number.isdecimal() and count.isdecimal() and 1 <= int(number) <= int(count)):
        raise ValueError(f"expected a shard I/N with I from 1 to N, got {text!r}")
    return int(number) - 1, int(count)


def merge(folders: tyro.conf.Positional[tuple[Path, ...]], /, *, out: Out = Path("results")) -> None:
    """Bring the results of several machines together: what `run --shard I/N` has stored on each.

    Parameters
    ----------
    folders
        What each of them had as `--out`.
    """
    for root in folders:
        found = sorted(path.parent for path in root.glob("*/run.json"))
        if not found:
            raise ResultsError(f"no results in {root}")
        for path in found:
            added = Folder(out / path.name).merge(Folder(path))
            _console.print(f"{path}: {counted(added, 'result')}", highlight=False)


def speed(
    *,
    suite: Suite = None,
    dataset: Dataset = None,
    trackers: Trackers = DEFAULT_TRACKERS,
    sequences: Only = (),
    scenes: Scenes = None,
    frames: Annotated[int, at_least(1)] = TIMED_UPDATES,
    block: Annotated[int, at_least(1)] = BLOCK,
    timeout: float = 60.0,
    paths: Paths = (),
    models: Models = None,
    out: Out = Path("results"),
) -> None:
    """Time updates: one thread, warm, trackers by turns on the same few frames. Leave the machine alone.

    Parameters
    ----------
    frames
        Timed updates per sequence and tracker, after five to warm up.
    block
        Updates of one tracker before it is the next one's turn. 1 is turns by single frames: then every update
        starts with caches that the other trackers have filled.
    timeout
        Seconds for one update.
    """
    specs = [find_tracker(name, models) for name in dict.fromkeys(trackers)]
    folder, found = _open(out, suite, dataset, sequences, scenes=scenes)
    _speed_with_progress(specs, found, folder, Limits(timeout, paths=paths), frames=frames, block=block)
    measured = folder.read_speeds()
    shared = {sequence.name: sequence.scene for sequence in found}
    _console.print(console_table(speed_text(measured), "median ms per update"))
    _console.print(console_table(speed_overall_text(measured, shared), "medians over sequences"))


def report(
    *,
    suite: StoredSuite = None,
    dataset: Dataset = None,
    chosen: str = "TrackerHS",
    trackers: tuple[str, ...] | None = None,
    videos: Annotated[int, at_least(0)] = 0,
    shown: tuple[str, ...] = (),
    out: Out = Path("results"),
) -> None:
    """Turn stored results into tables, plots, an HTML report and a page per sequence. Runs no tracker.

    Parameters
    ----------
    chosen
        Tracker that is compared with the others.
    trackers
        Only these.
    videos
        Number of sequences whose page has a video beside it.
    shown
        Trackers whose boxes are drawn; the chosen one and the best other one by default.
    """
    for folder in _stored(out, suite, dataset):
        _report(folder, chosen, trackers, videos, shown)


def _report(
    folder: Folder,
    chosen: str = "TrackerHS",
    trackers: tuple[str, ...] | None = None,
    videos: int = 0,
    shown: tuple[str, ...] = (),
) -> None:
    summary = summarise_folder(folder, chosen=chosen, trackers=None if trackers is None else list(trackers))
    write_tables(summary, folder.path / "tables")
    write_figures(summary, folder.path / "plots")
    page = folder.path / "report.html"
    write_report(summary, folder, page, videos=videos, shown=shown)
    if len(summary.themes):
        for table, title in _details(summary):
            _console.print(console_table(table, title))
    _console.print(console_table(brief_table(summary), summary.source, bold=summary.chosen))
    _console.print(f"report: {page.resolve()}", soft_wrap=True)


def bench(
    *,
    suite: SuiteName = "standard",
    jobs: Jobs = 2,
    repeats: Annotated[int, at_least(1)] = 1,
    out: Out = Path("results"),
) -> None:
    """Everything on one suite with every tracker: accuracy, speed, report.

    Parameters
    ----------
    repeats
        Most runs to average of a tracker that differs from run to run. That is MIL, which takes half of the time:
        `run` gives it three runs, and goes on from here.
    """
    specs = [find_tracker(name) for name in DEFAULT_TRACKERS]
    specs = [replace(spec, repeats=min(spec.repeats, repeats)) for spec in specs]
    folder, found = _open(out, suite, None)
    _run_with_progress(specs, found, folder, jobs, Limits(), 0, False)
    _speed_with_progress(specs, found, folder, Limits(60.0))
    _report(folder)


def sweep(
    parameter: tyro.conf.Positional[str],
    *,
    suite: SuiteName = "drawn:20:1",
    trackers: Trackers = DEFAULT_TRACKERS,
    models: Models = None,
    chosen: str = "TrackerHS",
    jobs: Jobs = 2,
    out: Out = Path("results"),
) -> None:
    """The same draws again and again with one parameter set to one value after the other: table and plot.

    Parameters
    ----------
    parameter
        NAME=FIRST:LAST:STEP or NAME=VALUE,VALUE; noise, rotation, speed, size, contrast, blur, compression,
        occlusion, or box (error of the start box).
    chosen
        Tracker whose line stands out.
    """
    grid = Grid.parse(parameter)
    specs = [find_tracker(name, models) for name in dict.fromkeys(trackers)]
    name = canonical_suite(suite)
    found = sweep_sequences(grid, name)
    folder = _results_of(out, f"sweep-{grid.name}-", f"suite:{name}")
    folder.write_manifest(f"suite:{name}", found, _place(f"suite:{name}"))
    _run_jobs_with_progress(sweep_jobs(grid, specs, found), f"{grid.name} on {name}", folder, jobs, Limits(), False)
    runs = folder.read_protocol_runs() if grid.name == BOX else folder.read_runs()
    table = sweep_table(grid, [run for run in runs if run.tracker in {spec.name for spec in specs}], found)
    write_numbers(table, "sweep", folder.path / "tables")
    for title, text in sweep_text(table, grid).items():
        kind = title.replace(" ", "-")
        write_table(
            text, f"sweep-{kind}", folder.path / "tables", caption=f"{title} against {grid.title}, on {name}."
        )
        _console.print(console_table(text, f"{title} against {grid.title}, on {name}"))
    plots = write_figure(sweep_figure(table, grid, chosen), "sweep", folder.path / "plots")
    _console.print(f"plot: {plots[0].resolve()}", soft_wrap=True)


def ablate(
    *,
    suite: Suites = (),
    dataset: Datasets = (),
    parts: tuple[str, ...] = (),
    sequences: Only = (),
    scenes: Scenes = None,
    frames: int | None = None,
    jobs: Jobs = 2,
    out: Out = Path("results"),
) -> None:
    """What each part of TrackerHS is worth: mean IoU with one part taken out, or with another flow in it.

    Of several kinds of data the table has a column each; without any, sixty fresh draws and `vanish`.

    Parameters
    ----------
    parts
        Only these, by their names in eval/ablation.py.
    sequences
        Of the data sets, if there are any; suites beside them are taken whole.
    frames
        Only the first so many of each sequence of the data sets.
    """
    specs = ablation.specs(parts)
    if not suite and not dataset:
        suite = _ABLATION_SUITES
    # What cannot be read is said before anything is run.
    opened = [_open(out, name, None, () if dataset else sequences, kind="ablation-") for name in suite]
    opened += [_open(out, None, name, sequences, frames=frames, scenes=scenes, kind="ablation-") for name in dataset]
    summaries = {}
    for folder, found in opened:
        _run_with_progress(specs, found, folder, jobs, Limits(900.0), 0, False)
        summary = summarise_folder(folder, chosen=ablation.WHOLE, trackers=[spec.name for spec in specs])
        write_tables(summary, folder.path / "tables")
        summaries[folder.path.name.removeprefix("ablation-")] = summary
    table = ablation.ablation_table(summaries)
    write_table(table, "ablation", out / "ablation", caption="What each part is worth: change of the mean IoU.")
    write_numbers(ablation.ablation_changes(summaries), "ablation", out / "ablation")
    _console.print(console_table(table, f"ablation on {', '.join(summary.source for summary in summaries.values())}"))
    for summary in summaries.values():
        failures = failure_table(summary)
        if len(failures):
            _console.print(console_table(failures, f"runs on {summary.source} that did not go through"))


_ABLATION_SUITES = ("drawn:60:clock", "vanish")


def check(*, suite: SuiteName = "smoke", tracker: str = "TrackerHS", jobs: Jobs = 2, update: bool = False) -> int:
    """Compare mean IoU with the committed reference figures; fails when it fell.

    Parameters
    ----------
    tracker
        Name, or pkg.module:factory.
    update
        Write the figures instead of comparing with them.
    """
    _, sequences = _load(suite, None, (), None)
    path = regression.REFERENCE / f"{suite}.json"
    measured = regression.measure(find_tracker(tracker), sequences, workers=jobs)
    if update:
        regression.update(path, tracker, measured)
        _console.print(f"written: {path}")
        return 0
    comparison = regression.compare(path, tracker, measured)
    texts = comparison.table.map(format_cell)
    _console.print(console_table(texts, f"mean IoU of {tracker} on {suite}: {_VERDICTS[comparison.passed]}"))
    return 0 if comparison.passed else 1


_VERDICTS = {True: "passed", False: "FAILED"}


def _stored(out: Path, suite: str | None, dataset: str | None) -> list[Folder]:
    """Results of a suite or data set, or all that there are in a folder."""
    found = sorted(path.parent for path in out.glob("*/run.json"))
    if not found:
        raise SequenceError(f"no results in {out}: run `python -m eval run` first")
    _either(suite, dataset)
    if not suite and not dataset:
        return [Folder(path) for path in found]
    source = canonical_dataset(dataset) if dataset else f"suite:{canonical_suite(suite or '')}"
    folder = _results_of(out, "", source)
    if folder.place() != _place(source):
        raise SequenceError(f"no results of {source} in {out}; there are: {', '.join(path.name for path in found)}")
    return [folder]


def _either(suite: str | None, dataset: str | None) -> None:
    if suite and dataset:
        raise SequenceError("expected --suite or --dataset, got both")


def _load(
    suite: str | None, dataset: str | None, only: tuple[str, ...], frames: int | None
) -> tuple[str, list[Sequence]]:
    _either(suite, dataset)
    only = listed(only)
    name = canonical_suite(suite or "standard")
    if suite not in (None, name):
        _console.print(f"seed of the clock: the same sequences again are --suite {name}", highlight=False)
    dataset = dataset and canonical_dataset(dataset)
    source = dataset or f"suite:{name}"
    with _console.status(Text(f"reading {source}")):
        found = load_dataset(dataset, only) if dataset else load_suite(name)
    unknown = set(only) - {sequence.name for sequence in found}
    if unknown:
        names = ", ".join(sequence.name for sequence in found)
        raise SequenceError(f"unknown sequence {', '.join(sorted(unknown))} in {source}; known: {names}")
    return source, [sequence.cut(frames) for sequence in found if not only or sequence.name in only]


def _open(
    out: Path,
    suite: str | None,
    dataset: str | None,
    only: tuple[str, ...] = (),
    *,
    frames: int | None = None,
    scenes: Path | None = None,
    kind: str = "",
) -> tuple[Folder, list[Sequence]]:
    """Sequences, and the folder of their results, which says from now on what the last run was about."""
    source, found = _load(suite, dataset, only, frames)
    named = read_scenes(scenes) if scenes else {}
    found = [replace(sequence, scene=named.get(sequence.name, sequence.scene)) for sequence in found]
    folder = _results_of(out, kind, source)
    folder.write_manifest(source, found, _place(source))
    return folder, found


def _results_of(out: Path, kind: str, source: str) -> Folder:
    """Folder of results by a name to be read; two data sets of one name have folders of their own."""
    place = _place(source)
    what, _, where = source.partition(":")
    name = suite_folder(where) if what == "suite" else f"{what}-{_paths_of(where)[0].stem}"
    folder = Folder(out / f"{kind}{name}")
    if folder.place() in ("", place):
        return folder
    return Folder(out / f"{kind}{name}-{hashlib.sha256(place.encode()).hexdigest()[:8]}")


def _place(source: str) -> str:
    """What a folder of results is about: a data set by its full path, draws by their seed and not their number."""
    kind, _, where = source.partition(":")
    return f"{kind}:{suite_folder(where) if kind == 'suite' else '+'.join(map(str, _paths_of(where)))}"


def _paths_of(where: str) -> list[Path]:
    video, plus, boxes = where.rpartition("+")
    return [Path(word).expanduser().resolve() for word in ((video, boxes) if plus else (where,))]


def _run_with_progress(
    specs: list[TrackerSpec],
    sequences: list[Sequence],
    folder: Folder,
    workers: int,
    limits: Limits,
    starts: int,
    retry_failed: bool,
    protocol: Protocol = ONE_PASS,
    dask: str = "",
) -> None:
    jobs = make_jobs(specs, sequences, starts=starts, protocol=protocol)
    title = f"{counted(len(specs), 'tracker')} × {counted(len(sequences), 'sequence')}"
    _run_jobs_with_progress(jobs, title, folder, workers, limits, retry_failed, dask)


def _run_jobs_with_progress(
    jobs: list[Job], title: str, folder: Folder, workers: int, limits: Limits, retry_failed: bool, dask: str = ""
) -> None:
    with Steps(_console, title, len(jobs)) as steps:

        def done(finished: Run, reused: bool, note: str) -> None:
            steps.advance()
            if note:
                steps.say(note)
            if finished.status != COMPLETED and not reused:
                steps.say(f"{finished.tracker} on {finished.sequence}: {finished.status}")

        run_jobs(jobs, folder, workers=workers, dask=dask, limits=limits, retry_failed=retry_failed, report=done)


def _speed_with_progress(
    specs: list[TrackerSpec],
    sequences: list[Sequence],
    folder: Folder,
    limits: Limits,
    *,
    frames: int = TIMED_UPDATES,
    block: int = BLOCK,
) -> None:
    with Steps(_console, f"speed of {counted(len(specs), 'tracker')}", len(sequences)) as steps:

        def done(measured: SpeedRun, reused: bool) -> None:
            steps.advance()
            for tracker, status in measured.status.items():
                if status != COMPLETED and not reused:
                    steps.say(f"{tracker} on {measured.sequence}: {status}")

        measure_speed(specs, sequences, folder, frames=frames, block=block, limits=limits, report=done)


def _details(summary: Summary) -> list[tuple[pd.DataFrame, str]]:
    """Tables with their titles: of a distribution what kinds of draws are hard, else every sequence."""
    if not len(summary.themes):
        return [(sequence_table(summary), f"mean IoU per sequence of {summary.source}")]
    return [
        (theme_table(summary), f"mean IoU per theme of {summary.source}"),
        (worst_table(summary), f"worst of {summary.chosen}"),
    ]


def _print_protocol(folder: Folder, trackers: list[str], protocol: Protocol) -> None:
    runs = [run for run in (*folder.read_runs(), *folder.read_protocol_runs()) if run.tracker in trackers]
    tables = protocol_tables(runs, folder.read_sequences())
    name = protocol.key if protocol.key in tables else protocol.name
    _console.print(console_table(protocol_text(tables[name]), protocol_title(name)))


def _print_summary(folder: Folder, trackers: list[str]) -> None:
    summary = summarise_folder(folder, trackers=trackers)
    for table, title in _details(summary):
        _console.print(console_table(table, title))
    failures = failure_table(summary)
    if len(failures):
        _console.print(console_table(failures, "runs that did not go through"))
    _console.print(console_table(brief_table(summary), summary.source, bold=summary.chosen))
