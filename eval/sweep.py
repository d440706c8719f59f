"""Sweeps: the same draws again and again with one parameter set to one value after the other.

The draws are those of a distribution suite, so that every value is met by the same objects over the same grounds;
``box``, the error of the start box in box sizes, leaves the sequences as they are and starts trackers elsewhere.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from .accuracy import Job, make_jobs
from .intervals import mean_interval, share_interval
from .metrics import FAR_OFF, FrameScores
from .plots import SETTINGS, style_of
from .protocols import misplaced
from .results import Run
from .sequences import Sequence, from_spec
from .statistics import score_answers
from .trackers import TrackerSpec
from .truthfiles import SequenceError

if TYPE_CHECKING:
    from datasets_synthetic import SequenceSpec

__all__ = ["BOX", "Grid", "sweep_figure", "sweep_jobs", "sweep_sequences", "sweep_table", "sweep_text"]

BOX = "box"
"""The parameter that is none of the sequences."""

_BOX_TITLE, _MOST_ERROR = "error of the start box, box sizes", 0.6
_MOST_VALUES = 100


@dataclass(frozen=True)
class Grid:
    """Values of one parameter.

    Parameters
    ----------
    name : str
        Of the parameter: :data:`BOX` or one of the laboratory's ``SWEEPS``.
    title : str
        What it is, with its unit.
    values : tuple of float
    """

    name: str
    title: str
    values: tuple[float, ...]

    @classmethod
    def parse(cls, text: str) -> Grid:
        """Read ``NAME=FIRST:LAST:STEP`` (both ends are in it) or ``NAME=VALUE,VALUE``.

        Raises
        ------
        ValueError
            If it is neither, or a value that the parameter cannot have.
        """
        from datasets_synthetic import SWEEPS

        name, _, words = text.partition("=")
        if name != BOX and name not in SWEEPS:
            raise ValueError(f"unknown parameter {name!r}; known: {', '.join((*SWEEPS, BOX))}")
        values = _values(text, words)
        if name == BOX:
            wrong = [value for value in values if not 0.0 <= value <= _MOST_ERROR]
            if wrong:
                raise ValueError(f"expected {_BOX_TITLE} in 0–{_MOST_ERROR:g}, got {wrong[0]:g}")
            return cls(name, _BOX_TITLE, values)
        for value in values:
            SWEEPS[name].setting(value)
        return cls(name, SWEEPS[name].title, values)


def _values(text: str, words: str) -> tuple[float, ...]:
    expected = "expected NAME=FIRST:LAST:STEP or NAME=VALUE,VALUE"
    try:
        numbers = [float(word) for word in words.replace(":", ",").split(",")]
    except ValueError:
        raise ValueError(f"{expected}, got {text!r}") from None
    if ":" not in words:
        return tuple(sorted(set(numbers)))
    if len(numbers) != 3 or "," in words or not all(map(math.isfinite, numbers)):
        raise ValueError(f"{expected}, got {text!r}")
    first, last, step = numbers
    if step == 0 or (last - first) / step < 0:
        raise ValueError(f"expected a step from {first:g} towards {last:g}, got {step:g}")
    count = math.floor((last - first) / step + 1e-9) + 1
    if count > _MOST_VALUES:
        raise ValueError(f"expected at most {_MOST_VALUES} values, got {count} in {text!r}")
    return tuple(sorted(round(first + index * step, 9) for index in range(count)))


def sweep_sequences(grid: Grid, suite: str) -> list[Sequence]:
    """Every draw of a distribution suite at every value, draw by draw; each says which in its parameters.

    Raises
    ------
    SequenceError
        If the suite is none that is drawn.
    """
    from datasets_synthetic import SWEEPS
    from datasets_synthetic import suite as draws

    if not suite.startswith("drawn"):
        raise SequenceError(f"expected drawn:N:SEED or drawn/THEME:N:SEED to sweep over, got {suite!r}")
    if grid.name == BOX:
        return [from_spec(spec) for spec in draws(suite)]
    columns = []
    for value in grid.values:
        specs = draws(suite, change=SWEEPS[grid.name].setting(value))
        columns.append([_at(grid.name, value, spec) for spec in specs])
    return [sequence for row in zip(*columns, strict=True) for sequence in row]


def _at(name: str, value: float, spec: SequenceSpec) -> Sequence:
    """The draw at a value; all values of one draw are one scene."""
    found = from_spec(replace(spec, name=f"{spec.name}@{name}={value:g}"))
    return replace(found, parameters={**found.parameters, "swept": value}, scene=spec.name)


def sweep_jobs(grid: Grid, trackers: list[TrackerSpec], sequences: list[Sequence]) -> list[Job]:
    """One run of each tracker on each draw at each value."""
    trackers = [replace(tracker, repeats=1) for tracker in trackers]
    if grid.name != BOX:
        return make_jobs(trackers, sequences)
    leads = [misplaced(value) for value in grid.values]
    return [job for sequence in sequences for led in leads for job in make_jobs(trackers, [sequence], protocol=led)]


def sweep_table(grid: Grid, runs: list[Run], sequences: list[Sequence]) -> pd.DataFrame:
    """Sum up a sweep.

    Returns
    -------
    DataFrame
        One row per tracker and value: number of `draws`, `mean_iou` with its interval `low` to `high` over draws, and
        `false`, the share of frames whose `ok` is wrong, with its interval `false_low` to `false_high`: True where
        nothing is to be seen or with an IoU below 0.1, False where the object is seen.
    """
    known = {sequence.name: sequence for sequence in sequences}
    errors = {misplaced(value).key: value for value in grid.values} if grid.name == BOX else {}
    rows = []
    for run in runs:
        sequence = known.get(run.sequence)
        if sequence is None or run.provenance.get("digest") != sequence.digest or run.start:
            continue
        value = errors.get(run.protocol) if grid.name == BOX else sequence.parameters.get("swept")
        if value not in grid.values:
            continue
        scores = score_answers(sequence, run.trajectory)
        wrong, judged = _wrong(scores)
        iou = float(scores.iou[scores.visible].mean()) if scores.visible.any() else math.nan
        rows.append({"tracker": run.tracker, "value": value, "iou": iou, "wrong": wrong, "judged": judged})
    scored = pd.DataFrame(rows, columns=["tracker", "value", "iou", "wrong", "judged"])
    found = []
    for (tracker, at), group in scored.groupby(["tracker", "value"], sort=True):
        low, high = np.clip(mean_interval(group["iou"].to_numpy(float)), 0.0, 1.0)
        false_low, false_high = share_interval(group["wrong"].to_numpy(float), group["judged"].to_numpy(float))
        found.append(
            {
                "tracker": tracker,
                "value": at,
                "draws": len(group),
                "mean_iou": group["iou"].mean(),
                "low": low,
                "high": high,
                "false": group["wrong"].sum() / group["judged"].sum(),
                "false_low": false_low,
                "false_high": false_high,
            }
        )
    names = ["tracker", "value", "draws", "mean_iou", "low", "high", "false", "false_low", "false_high"]
    return pd.DataFrame(found, columns=names)


def _wrong(scores: FrameScores) -> tuple[int, int]:
    """Number of frames whose `ok` is wrong, and of those that are judged."""
    far = scores.visible & scores.ok & (np.nan_to_num(scores.iou) < FAR_OFF)
    wrong = (scores.invisible & scores.ok) | (scores.visible & ~scores.ok) | far
    return int(wrong.sum()), int((scores.visible | scores.invisible).sum())


def sweep_text(table: pd.DataFrame, grid: Grid) -> dict[str, pd.DataFrame]:
    """Mean IoU and false answers as text, with intervals: one row per value and one column per tracker."""
    found = {}
    for title, (middle, low, high) in {
        "mean IoU": ("mean_iou", "low", "high"),
        "false answers": ("false", "false_low", "false_high"),
    }.items():
        cells: dict[str, list[str]] = {grid.name: [f"{value:g}" for value in grid.values]}
        for tracker in _best_first(table):
            own = table[table["tracker"] == tracker].set_index("value").reindex(list(grid.values))
            cells[tracker] = [_cell(*row) for row in own[[middle, low, high]].to_numpy(float).tolist()]
        found[title] = pd.DataFrame(cells)
    return found


def _cell(middle: float, low: float, high: float) -> str:
    if math.isnan(middle):
        return "–"
    return f"{middle:.3f}" + (f" ({low:.3f}–{high:.3f})" if math.isfinite(low) else "")


def _best_first(table: pd.DataFrame) -> list[str]:
    return [str(name) for name in table.groupby("tracker")["mean_iou"].mean().sort_values(ascending=False).index]


def sweep_figure(table: pd.DataFrame, grid: Grid, chosen: str) -> Figure:
    """Mean IoU and share of false answers of each tracker over the parameter, with their intervals as bands."""
    names = _best_first(table)
    with matplotlib.rc_context(SETTINGS):
        figure = Figure(figsize=(8.6, 6.0), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True)
        for axes, title, middle, low, high in (
            (upper, "mean IoU", "mean_iou", "low", "high"),
            (lower, "share of frames whose ok is wrong", "false", "false_low", "false_high"),
        ):
            axes.grid(visible=True, color="#dddddd", linewidth=0.6)
            axes.set_axisbelow(True)
            for side in ("top", "right"):
                axes.spines[side].set_visible(False)
            for name in names:
                own = table[table["tracker"] == name]
                style = style_of(name, names, chosen)
                label = name if axes is upper else None
                axes.plot(own["value"], own[middle], marker="o", markersize=3.5, label=label, **style)
                axes.fill_between(own["value"], own[low], own[high], color=style["color"], alpha=0.12, linewidth=0)
            axes.set(ylabel=title, ylim=(-0.02, 1.02))
        lower.set(xlabel=grid.title)
        figure.legend(fontsize=8, loc="outside right upper")
        return figure
