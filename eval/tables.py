"""Tables of the results: for the console, and as CSV, Markdown and LaTeX files."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from rich.box import SIMPLE_HEAD
from rich.table import Table

from .intervals import median_interval
from .latex import Rivals, latex_table
from .metrics import METRICS
from .protocol_tables import TITLES, protocol_tables
from .results import Folder, ResultsError, SpeedRun
from .sequences import Sequence
from .statistics import (
    ScoredRun,
    differences,
    mean_ranks,
    overall,
    per_attribute,
    per_sequence,
    per_theme,
    score_frames,
    score_quality,
    score_table,
    speed_table,
    worst_sequences,
)

__all__ = [
    "Summary",
    "brief_table",
    "console_table",
    "counted",
    "format_cell",
    "overall_table",
    "protocol_text",
    "protocol_title",
    "rank_table",
    "ranks_caption",
    "speed_overall_text",
    "summarise_folder",
    "theme_table",
    "worst_table",
    "write_numbers",
    "write_table",
    "write_tables",
]

SPEED_RIVAL = "CSRT"
"""Whose time per update the others are compared with."""


@dataclass(frozen=True)
class Summary:
    """Everything a report says in numbers.

    Parameters
    ----------
    source : str
        The suite or data set.
    sequences : list of Sequence
    scored : list of ScoredRun
    scores, pairs, overall, attributes, differences, ranks, themes, worst, speed : DataFrame
        See :mod:`eval.statistics`.
    critical : float
        Least difference of mean ranks that is none of chance.
    protocols : mapping of str to DataFrame
        See :mod:`eval.protocol_tables`.
    chosen : str
        The tracker that the differences are about.
    """

    source: str
    sequences: list[Sequence]
    scored: list[ScoredRun]
    scores: pd.DataFrame
    pairs: pd.DataFrame
    overall: pd.DataFrame
    attributes: pd.DataFrame
    differences: pd.DataFrame
    ranks: pd.DataFrame
    critical: float
    themes: pd.DataFrame
    worst: pd.DataFrame
    speed: pd.DataFrame
    protocols: Mapping[str, pd.DataFrame]
    chosen: str


def summarise_folder(folder: Folder, *, chosen: str = "TrackerHS", trackers: list[str] | None = None) -> Summary:
    """Compute every number from a folder of results; runs no tracker.

    Parameters
    ----------
    folder : Folder
    chosen : str, optional
        Tracker to compare with the others; the best one where it has not been run.
    trackers : list of str, optional
        Leave out the others.

    Raises
    ------
    ResultsError
        If there is nothing to report, or nothing of a tracker that was asked for, or a file is damaged.
    """
    sequences = folder.read_sequences()
    stored = folder.read_runs()
    runs = [run for run in stored if trackers is None or run.tracker in trackers]
    scored = score_frames(runs, sequences)
    scores = score_table(scored)
    led = [run for run in folder.read_protocol_runs() if trackers is None or run.tracker in trackers]
    if scores.empty and led:
        raise ResultsError(f"no runs in one pass in {folder.path}: run `python -m eval run` without --protocol first")
    if scores.empty:
        raise ResultsError(f"no results in {folder.path} for whole sequences of the last run (--frames cuts them)")
    there = {*scores["tracker"], *(run.tracker for run in led)}
    missing = [name for name in trackers or () if name not in there]
    if missing:
        raise ResultsError(
            f"no results of {', '.join(missing)} in {folder.path} for whole sequences of the last run (--frames cuts "
            f"them); there are runs of {', '.join(sorted({run.tracker for run in stored}))}"
        )
    pairs = per_sequence(scores)
    speed = speed_table(folder.read_speeds(), {sequence.name: sequence.scene for sequence in sequences})
    table = overall(pairs).join(score_quality(scored), on="tracker").join(_speed_by_tracker(speed), on="tracker")
    ranks, critical = mean_ranks(pairs)
    chosen = chosen if chosen in set(table["tracker"]) else str(table["tracker"].iloc[0])
    return Summary(
        source=folder.read_manifest()["source"],
        sequences=sequences,
        scored=scored,
        scores=scores,
        pairs=pairs,
        overall=table,
        attributes=per_attribute(pairs, sequences),
        differences=differences(pairs, chosen),
        ranks=ranks,
        critical=critical,
        themes=per_theme(pairs, sequences, chosen),
        worst=worst_sequences(pairs, sequences, chosen),
        speed=speed,
        protocols=protocol_tables([*runs, *led], sequences),
        chosen=chosen,
    )


def _speed_by_tracker(speed: pd.DataFrame) -> pd.DataFrame:
    """Frames per second, p95, the ratio to the rival: medians over sequences; its interval over scenes; its least."""
    medians = speed.pivot(index="sequence", columns="tracker", values="median")
    tails = speed.pivot(index="sequence", columns="tracker", values="p95")
    rival = medians[SPEED_RIVAL] if SPEED_RIVAL in medians else pd.Series(np.nan, index=medians.index)
    ratios = medians.rdiv(rival, axis=0)
    table = pd.DataFrame(
        {"fps": 1000.0 / medians.median(), "p95_ms": tails.median(), "ratio": ratios.median(), "least": ratios.min()}
    )
    by_scene = ratios.groupby(speed.groupby("sequence")["scene"].first()).median()
    bounds = [median_interval(by_scene[name].to_numpy(float)) for name in by_scene.columns]
    ends = pd.DataFrame(bounds, index=ratios.columns, columns=["ratio_low", "ratio_high"], dtype=float)
    # CSRT is exactly as fast as CSRT.
    ends[ends.index == SPEED_RIVAL] = np.nan
    return table.join(ends)


_EXTRA_TITLES = {
    "tracker": "tracker",
    "sequences": "n",
    "failed": "failed",
    "interval": "95 %",
    "q05": "5 % quantile",
    "ece": "ECE",
    "sure_wrong": "sure, wrong",
    "perturbed_iou": "IoU, start ±10 %",
    "fps": "fps",
    "p95_ms": "p95 ms",
    "ratio": f"× {SPEED_RIVAL}",
    "ratio_interval": f"× {SPEED_RIVAL}, 95 %",
    "least": "least ×",
}
_COLUMNS = (
    "mean_iou", "interval", "q05", "mask_iou", "rotated_iou", "auc", "sr50", "sr75", "precision20",
    "normalised_precision", "auc_otb", "precision_otb", "ao_got10k", "sr50_got10k", "sr75_got10k",
)  # fmt: skip
_COLUMNS_AFTER = (
    "perturbed_iou", "false_true", "false_false", "true_off", "sure_wrong", "ece", "failed", "fps", "p95_ms", "ratio",
    "ratio_interval", "least",
)  # fmt: skip
_BRIEF = {_EXTRA_TITLES.get(name) or METRICS[name].title for name in (
    "tracker", "sequences", "mean_iou", "interval", "mask_iou", "rotated_iou", "sr50", "precision20", "perturbed_iou",
    "false_true", "false_false", "failed", "fps", "ratio",
)}  # fmt: skip
_LONG_TEXT = 40
_DIGITS = {
    "fps": 0, "p95_ms": 2, "ratio": 1, "least": 1, "failed": 0, "sequences": 0, "runs": 0, "failures": 2,
    "per_hundred": 2,
}  # fmt: skip


def counted(count: int, noun: str) -> str:
    """A number of things: ``1 scene``, ``2 scenes``."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def format_cell(value: object, column: str = "") -> str:
    """Text of one cell: three digits for shares, a dash where there is nothing to say."""
    if isinstance(value, str):
        return value
    number = float(value)  # type: ignore[arg-type]
    return "–" if np.isnan(number) else f"{number:.{_DIGITS.get(column, 3)}f}"


def overall_table(summary: Summary) -> pd.DataFrame:
    """The main table as text, with headings; columns in which nothing is known are left out.

    The number of sequences is told where it is not that of all, as when a run was interrupted.
    """
    table = summary.overall
    table = table.assign(
        interval=_interval_texts(table["low"], table["high"], 3),
        ratio_interval=_interval_texts(table["ratio_low"], table["ratio_high"], 1),
    )
    counts = ["sequences"] if (table["sequences"] != len(summary.sequences)).any() else []
    kept = [*counts, *(name for name in (*_COLUMNS, *_COLUMNS_AFTER) if table[name].notna().any())]
    texts = {name: [format_cell(value, name) for value in table[name]] for name in ("tracker", *kept)}
    titles = {name: metric.title for name, metric in METRICS.items()} | _EXTRA_TITLES
    return pd.DataFrame({titles[name]: column for name, column in texts.items()})


def brief_table(summary: Summary) -> pd.DataFrame:
    """Columns of the main table that a terminal has room for."""
    table = overall_table(summary)
    return table[[name for name in table.columns if name in _BRIEF]]


def _interval_texts(low: pd.Series[float], high: pd.Series[float], digits: int) -> list[str] | float:
    """Both ends in one cell each; NaN for a column of which nothing is known."""
    if low.isna().all():
        return float("nan")
    return [f"{a:.{digits}f}–{b:.{digits}f}" if np.isfinite(a) else "–" for a, b in zip(low, high, strict=True)]


def protocol_title(name: str) -> str:
    """Heading of the table of a protocol."""
    kind, _, rate = name.partition(":")
    return TITLES[kind] + (f": {rate} frames a second" if rate else "")


def protocol_text(table: pd.DataFrame) -> pd.DataFrame:
    """Table of a protocol as text, with headings; columns in which nothing is known are left out."""
    if "low" in table:
        leading = next(name for name in ("mean_iou", "eao", "f") if name in table)
        texts = _interval_texts(table["low"], table["high"], 3)
        table = table.drop(columns=["low", "high"])
        table.insert(list(table.columns).index(leading) + 1, "interval", texts)
    if "from" in table:
        window = f"EAO [{table['from'].iloc[0]}–{table['to'].iloc[0]}]"
        table = table.drop(columns=["from", "to"]).rename(columns={"eao": window})
    titles = {name: metric.title for name, metric in METRICS.items()} | _EXTRA_TITLES | _PROTOCOL_TITLES
    kept = [name for name in table.columns if table[name].notna().any()]
    return _as_text(table[kept]).rename(columns=titles)


_PROTOCOL_TITLES = {
    "worst_start": "mean IoU, worst start",
    "accuracy": "A",
    "failures": "R (failures)",
    "per_hundred": "failures / 100",
    "dropped": "frames dropped",
    "unhurried": "mean IoU, one pass",
    "f": "F",
    "precision": "Pr",
    "recall": "Re",
    "threshold": "score ≥",
    "f_ok": "F of ok alone",
}


def sequence_table(summary: Summary) -> pd.DataFrame:
    """Mean IoU as text, one row per sequence and one column per tracker, the best tracker first."""
    wide = summary.pairs.pivot(index="sequence", columns="tracker", values="mean_iou")
    wide = wide.reindex([sequence.name for sequence in summary.sequences])[list(summary.overall["tracker"])]
    return _as_text(wide.rename_axis(columns=None).reset_index())


def speed_text(runs: list[SpeedRun]) -> pd.DataFrame:
    """Median ms per update as text, one row per sequence and one column per tracker, the fastest first."""
    wide = speed_table(runs).pivot(index="sequence", columns="tracker", values="median")
    wide = wide[wide.median().sort_values().index].reindex([run.sequence for run in runs])
    return _as_text(wide.rename_axis(columns=None).reset_index())


def speed_overall_text(runs: list[SpeedRun], scenes: Mapping[str, str] = MappingProxyType({})) -> pd.DataFrame:
    """Speed as text, one row per tracker, the fastest first; `scenes` are those of sequences that share theirs."""
    table = _speed_by_tracker(speed_table(runs, scenes)).sort_values("fps", ascending=False)
    table = table.assign(ratio_interval=_interval_texts(table["ratio_low"], table["ratio_high"], 1))
    names = [name for name in ("fps", "p95_ms", "ratio", "ratio_interval", "least") if table[name].notna().any()]
    texts = {_EXTRA_TITLES[name]: [format_cell(value, name) for value in table[name]] for name in names}
    return pd.DataFrame({"tracker": table.index, **texts})


def attribute_table(summary: Summary) -> pd.DataFrame:
    """Mean IoU per attribute as text, the best tracker first."""
    best_first = [name for name in summary.overall["tracker"] if name in summary.attributes]
    return _as_text(summary.attributes[["attribute", "sequences", *best_first]])


def theme_table(summary: Summary) -> pd.DataFrame:
    """Means per theme as text, the best tracker first; the least and the rates of `ok` are the chosen one's."""
    best_first = [name for name in summary.overall["tracker"] if name in summary.themes]
    rates = ["false_true", "false_false", "true_off"]
    titles = {"sequences": "n", **{rate: METRICS[rate].title for rate in rates}}
    table = summary.themes.rename(columns={"least": "least IoU"})[
        ["theme", "sequences", *best_first, "least IoU", *rates]
    ]
    return _as_text(table).rename(columns=titles)


def worst_table(summary: Summary) -> pd.DataFrame:
    """The worst draws as text: which, how bad, and what was drawn."""
    table = summary.worst
    drawn = table.drop(columns=["sequence", "mean_iou", "best_other", "theme"], errors="ignore")
    texts = {
        "sequence": table["sequence"],
        "mean IoU": [format_cell(value) for value in table["mean_iou"]],
        "best other": [format_cell(value) for value in table["best_other"]],
        "drawn": [_drawn_text(row) for _, row in drawn.iterrows()],
    }
    return pd.DataFrame(texts)


def _drawn_text(drawn: pd.Series[Any]) -> str:
    """Parameters of a draw in one line."""
    words = [
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in drawn.dropna().items()
    ]
    return ", ".join(words)


def difference_table(summary: Summary) -> pd.DataFrame:
    """The chosen tracker against each other one, as text."""
    table = summary.differences
    texts = {
        f"{summary.chosen} minus": table["other"],
        "mean IoU": [f"{value:+.3f}" for value in table["difference"]],
        "95 %": [
            f"{a:+.3f} to {b:+.3f}" if np.isfinite(a) else "–"
            for a, b in zip(table["low"], table["high"], strict=True)
        ],
        "p (Holm)": [format_cell(value) for value in table["p"]],
        "won": table["won"].astype(str),
        "even": table["even"].astype(str),
        "lost": table["lost"].astype(str),
        "worst": [f"{a:+.3f} {b}" for a, b in zip(table["worst"], table["worst_sequence"], strict=True)],
    }
    return pd.DataFrame(texts)


def rank_table(summary: Summary) -> pd.DataFrame:
    """Mean ranks as text, the best first, and where there are scenes enough, which of them cannot be told apart."""
    table = summary.ranks
    texts = {"tracker": table["tracker"], "mean rank": [f"{rank:.2f}" for rank in table["rank"]]}
    return pd.DataFrame(texts | ({"not apart from": table["like"]} if np.isfinite(summary.critical) else {}))


def ranks_caption(summary: Summary) -> str:
    """What the ranks are about, and which of them are not told apart."""
    scenes = int(summary.ranks["scenes"].max()) if len(summary.ranks) else 0
    text = f"Mean ranks by mean IoU over {counted(scenes, 'scene')} of {summary.source}"
    if np.isfinite(summary.critical):
        text += f"; those that differ by less than {summary.critical:.2f} are not told apart (Nemenyi, 95 %)"
    else:
        text += ", too few to tell any of them apart: not even first and last in each (Nemenyi, 95 %)"
    return f"{text}."


def failure_table(summary: Summary) -> pd.DataFrame:
    """Runs that did not go through, with their reasons."""
    failed = summary.scores[summary.scores["status"] != "completed"]
    return failed[["tracker", "sequence", "start", "repeat", "status"]].astype(str).reset_index(drop=True)


def _as_text(table: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame({name: [format_cell(value, str(name)) for value in table[name]] for name in table.columns})


def console_table(table: pd.DataFrame, title: str, *, bold: str = "") -> Table:
    """Rich table of texts; the row whose first cell is `bold` stands out."""
    found = Table(
        title=title, title_justify="left", header_style="bold", box=SIMPLE_HEAD, pad_edge=False, min_width=len(title)
    )
    for name in table.columns:
        cells = [str(cell) for cell in table[name]]
        # Headings and long texts may wrap, numbers may not.
        words = any(cell[:1].isalpha() for cell in cells)
        width = min(max(map(len, cells), default=1), _LONG_TEXT)
        found.add_column(str(name), justify="left" if words else "right", min_width=width)
    for row in table.itertuples(index=False):
        cells = [str(cell) for cell in row]
        found.add_row(*cells, style="bold" if cells[0] == bold else "")
    return found


def write_tables(summary: Summary, folder: Path) -> list[Path]:
    """Write the tables as CSV (full precision), Markdown and LaTeX into a folder.

    Returns
    -------
    list of Path
        The files.

    Raises
    ------
    ResultsError
        If they cannot be written.
    """
    full = {
        "runs": summary.scores,
        "sequences": summary.pairs,
        "overall": summary.overall,
        "attributes": summary.attributes,
        "differences": summary.differences,
        "ranks": summary.ranks,
        "themes": summary.themes,
        "worst": summary.worst,
        "speed": summary.speed,
    }
    shown: dict[str, tuple[pd.DataFrame, str, Rivals]] = {
        "overall": (overall_table(summary), f"Trackers on {summary.source}.", "rows"),
        "sequences": (sequence_table(summary), f"Mean IoU per sequence of {summary.source}.", "columns"),
        "attributes": (attribute_table(summary), f"Mean IoU per attribute of {summary.source}.", "columns"),
        "differences": (difference_table(summary), f"{summary.chosen} against each other tracker.", ""),
        "ranks": (rank_table(summary), ranks_caption(summary), ""),
    }
    if len(summary.themes):
        shown |= {
            "themes": (theme_table(summary), f"Mean IoU per theme of {summary.source}.", "columns"),
            "worst": (worst_table(summary), f"The worst draws of {summary.chosen}.", ""),
        }
    for name, table in summary.protocols.items():
        file = f"protocol-{name.replace(':', '-')}"
        full[file] = table
        shown[file] = (protocol_text(table), f"{protocol_title(name)}, on {summary.source}.", "rows")
    files = [write_numbers(table, name, folder) for name, table in full.items()]
    for name, (table, caption, rivals) in shown.items():
        files += write_table(table, name, folder, caption=caption, rivals=rivals)
    return files


def write_numbers(table: pd.DataFrame, name: str, folder: Path) -> Path:
    """Write a table of numbers as CSV, in full precision, into a folder; returns the file.

    Raises
    ------
    ResultsError
        If it cannot be written.
    """
    return _write(folder / f"{name}.csv", table.to_csv(index=False))


def write_table(table: pd.DataFrame, name: str, folder: Path, *, caption: str, rivals: Rivals = "") -> list[Path]:
    """Write a table of texts as Markdown and LaTeX into a folder; returns the files.

    Parameters
    ----------
    table : DataFrame
    name : str
    folder : Path
    caption : str
        Of the LaTeX table.
    rivals : {"rows", "columns", ""}, optional
        What is compared, so that the best is bold in LaTeX: rows (trackers) in each column, columns in each row.

    Raises
    ------
    ResultsError
        If they cannot be written.
    """
    markdown = table.to_markdown(index=False, disable_numparse=True) + "\n"
    text = latex_table(table, caption=caption, label=f"tab:{name}", rivals=rivals)
    return [_write(folder / f"{name}.md", markdown), _write(folder / f"{name}.tex", text)]


def _write(path: Path, text: str) -> Path:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultsError(f"cannot write {path}: {error.strerror or error}") from error
    return path
