"""Tables of a flow comparison: per pair and in the mean, on the console, as CSV and as Markdown."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import pandas as pd
from rich.console import Console
from rich.table import Table

from ..results import FlowResult
from .methods import YARDSTICK, flow_method
from .metrics import FLOW_METRICS

__all__ = ["pair_table", "results_frame", "save_tables", "show", "summary_table"]


def results_frame(results: Iterable[FlowResult]) -> pd.DataFrame:
    """Results as a long table.

    Parameters
    ----------
    results : iterable of FlowResult

    Returns
    -------
    DataFrame
        One row per method and pair: method, family, pair, group, every metric, ms, relative, note.
    """
    rows = [
        {
            "method": result.method,
            "family": flow_method(result.method).family,
            "pair": result.pair,
            "group": result.group,
            **{name: result.scores.get(name) for name in FLOW_METRICS},
            "ms": None if result.seconds is None else 1e3 * result.seconds,
            "relative": result.relative,
            "note": result.note,
        }
        for result in results
    ]
    numbers = [*FLOW_METRICS, "ms", "relative"]
    return pd.DataFrame(rows).astype(dict.fromkeys(numbers, "float64"))


def summary_table(table: pd.DataFrame) -> pd.DataFrame:
    """Mean over the pairs, best first.

    Parameters
    ----------
    table : DataFrame
        As :func:`results_frame` makes it.

    Returns
    -------
    DataFrame
        Index method; columns family, aepe, one ``aepe GROUP`` per group of pairs, the other metrics, ms, relative,
        note. A method that failed on any pair has no mean: a mean over the pairs it survived would flatter it.
    """
    groups = table.groupby("method", sort=False)
    complete = groups["aepe"].agg(lambda column: bool(column.notna().all()))
    summary = groups[["family"]].first()
    summary["aepe"] = groups["aepe"].mean().where(complete)
    for group in sorted((set(table["group"]) - {""}), reverse=True):
        part = table[table["group"] == group]
        summary[f"aepe {group}"] = part.groupby("method", sort=False)["aepe"].mean().where(complete)
    for column in [name for name in FLOW_METRICS if name != "aepe"]:
        summary[column] = groups[column].mean().where(complete)
    for column in ("ms", "relative"):
        # Not the mean: one pair disturbed by another process would spoil it.
        summary[column] = groups[column].median().where(complete)
    summary["note"] = groups["note"].agg(_joined)
    return summary.sort_values("aepe", kind="stable", na_position="last")


def _joined(notes: pd.Series[str]) -> str:
    counts = notes[notes != ""].value_counts(sort=False)
    return "; ".join(
        str(note) if count == len(notes) else f"{note} ({count} of {len(notes)} pairs)"
        for note, count in counts.items()
    )


def pair_table(table: pd.DataFrame, metric: str = "aepe") -> pd.DataFrame:
    """One metric, methods by pairs, methods in the order of the summary.

    Parameters
    ----------
    table : DataFrame
        As :func:`results_frame` makes it.
    metric : str
        A name of ``FLOW_METRICS``.

    Returns
    -------
    DataFrame
        Index method, one column per pair; NaN where the method failed.
    """
    wide = table.pivot(index="method", columns="pair", values=metric)
    return wide.reindex(index=list(summary_table(table).index), columns=list(dict.fromkeys(table["pair"])))


def _headings(summary: pd.DataFrame) -> dict[str, str]:
    headings = {name: f"{metric.label} {metric.unit}" for name, metric in FLOW_METRICS.items()}
    headings |= {"ms": "ms", "relative": f"× {YARDSTICK}"}
    for column in summary.columns:
        if column.startswith("aepe "):
            headings[column] = f"AEPE {column.removeprefix('aepe ')}"
    return headings


def _formatted(summary: pd.DataFrame) -> pd.DataFrame:
    """Strings with the digits each column deserves; a dash where there is nothing."""
    digits = {"aae": 2, "r1": 1, "ms": 1, "relative": 2}
    text = pd.DataFrame(index=summary.index)
    for column in summary.columns:
        if summary[column].dtype.kind == "f":
            places = digits.get(column, 3)
            text[column] = [f"{value:.{places}f}" if value == value else "–" for value in summary[column]]
        else:
            text[column] = summary[column]
    return text.rename(columns=_headings(summary))


def save_tables(table: pd.DataFrame, out: Path) -> list[Path]:
    """Write flow.csv (per pair), flow-summary.csv and flow.md.

    Parameters
    ----------
    table : DataFrame
        As :func:`results_frame` makes it.
    out : Path
        Folder; made if missing.

    Returns
    -------
    list of Path
    """
    out.mkdir(parents=True, exist_ok=True)
    summary = summary_table(table)
    files = [out / "flow.csv", out / "flow-summary.csv", out / "flow.md"]
    table.to_csv(files[0], index=False)
    summary.to_csv(files[1])
    files[2].write_text(_markdown(table, summary), encoding="utf-8")
    return files


def _markdown(table: pd.DataFrame, summary: pd.DataFrame) -> str:
    conventions = "; ".join(f"{metric.label}: {metric.description}" for metric in FLOW_METRICS.values())
    sources = "\n".join(f"- `{name}`: {flow_method(str(name)).source}" for name in summary.index)
    return (
        "# Flow methods on true flow\n\n"
        f"Mean over {table['pair'].nunique()} pairs; {conventions}. "
        "ms: processor time per pair on one thread, warm, median over calls and pairs; "
        f"× {YARDSTICK}: the same in units of that method's time, measured in turns with it in the same process.\n\n"
        f"{_formatted(summary).to_markdown()}\n\n"
        f"## AEPE by pair, px\n\n{_formatted(pair_table(table)).to_markdown()}\n\n"
        f"## Angular error by pair, degrees\n\n{_formatted(pair_table(table, 'aae')).to_markdown()}\n\n"
        f"## Sources\n\n{sources}\n"
    )


def show(table: pd.DataFrame, console: Console) -> None:
    """Print the summary.

    Parameters
    ----------
    table : DataFrame
        As :func:`results_frame` makes it.
    console : rich.console.Console
    """
    summary = summary_table(table)
    text = _formatted(summary.drop(columns=["family", "note"]))
    grid = Table(title=f"flow on {table['pair'].nunique()} pairs")
    grid.add_column("method", no_wrap=True)
    for heading in text.columns:
        grid.add_column(heading, justify="right")
    for name, row in text.iterrows():
        style = {"ours": "bold", "null": "dim"}.get(flow_method(str(name)).family, "")
        grid.add_row(str(name), *(str(value) for value in row), style=style)
    console.print(grid)
    for name, note in summary["note"].items():
        if note:
            console.print(f"{name}: {note}", style="yellow", highlight=False, markup=False)
