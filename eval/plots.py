"""Figures of the results, and their SVG and PDF. Each function makes a figure of its own, with no global state."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from .metrics import PRECISION_THRESHOLDS, SUCCESS_THRESHOLDS
from .results import ResultsError
from .statistics import calibration_error, median_known

__all__ = [
    "SETTINGS",
    "as_svg",
    "before_loss_plot",
    "calibration_plot",
    "colour_of",
    "precision_plot",
    "speed_plot",
    "style_of",
    "success_plot",
    "write_figure",
]

FloatArray = NDArray[np.float64]
Curves = Mapping[str, tuple[FloatArray, FloatArray]]

# Okabe and Ito's colours, which the colour-blind can tell apart; the chosen tracker has the first for itself.
_CHOSEN = "#d55e00"
_OTHERS = ("#0072b2", "#009e73", "#e69f00", "#56b4e9", "#cc79a7", "#000000", "#8c8c8c")
_DASHES: tuple[str, ...] = ("-", "--", ":")
SETTINGS: Any = {
    "svg.fonttype": "none",
    "font.family": "sans-serif",
    "font.size": 9.0,
    "svg.hashsalt": "eval",
    "pdf.fonttype": 42,
}


def colour_of(tracker: str, trackers: list[str], chosen: str) -> str:
    """Colour of a tracker in every figure and overlay, as #rrggbb."""
    if tracker == chosen:
        return _CHOSEN
    others = sorted(name for name in trackers if name != chosen)
    return _OTHERS[others.index(tracker) % len(_OTHERS)]


def style_of(tracker: str, trackers: list[str], chosen: str) -> dict[str, Any]:
    """Colour, dash and width of a tracker's line."""
    others = sorted(name for name in trackers if name != chosen)
    dash = "-" if tracker == chosen else _DASHES[others.index(tracker) // len(_OTHERS) % len(_DASHES)]
    width = 2.6 if tracker == chosen else 1.3
    order = 3 if tracker == chosen else 2
    return {"color": colour_of(tracker, trackers, chosen), "linestyle": dash, "linewidth": width, "zorder": order}


def _new(width: float, height: float) -> tuple[Figure, Axes]:
    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.add_subplot()
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    return figure, axes


def as_svg(figure: Figure | None) -> str:
    """SVG to stand inside HTML, where it has no XML head; empty for no figure."""
    if figure is None:
        return ""
    buffer = io.StringIO()
    with matplotlib.rc_context(SETTINGS):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return re.sub(r"^.*?(?=<svg)", "", buffer.getvalue(), flags=re.DOTALL)


def write_figure(figure: Figure, name: str, folder: Path) -> list[Path]:
    """Write a figure as SVG and PDF into a folder; returns the files.

    Raises
    ------
    ResultsError
        If they cannot be written.
    """
    paths = [folder / f"{name}.{kind}" for kind in ("svg", "pdf")]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with matplotlib.rc_context(SETTINGS):
            figure.savefig(paths[0], metadata={"Date": None})
            figure.savefig(paths[1], metadata={"CreationDate": None})
    except OSError as error:
        raise ResultsError(f"cannot write figures in {folder}: {error.strerror or error}") from error
    return paths


def success_plot(curves: Curves, scores: Mapping[str, float], chosen: str) -> Figure:
    """Share of frames over the IoU threshold; the legend gives the area, best first."""
    with matplotlib.rc_context(SETTINGS):
        figure, axes = _new(6.8, 4.2)
        for name in sorted(curves, key=lambda name: -scores[name]):
            style = style_of(name, list(curves), chosen)
            axes.plot(SUCCESS_THRESHOLDS, curves[name][0], label=f"{name} {scores[name]:.3f}", **style)
        axes.set(xlabel="IoU threshold", ylabel="share of frames with IoU ≥ threshold", xlim=(0, 1), ylim=(0, 1.01))
        figure.legend(title="AUC", fontsize=8, loc="outside right upper")
        return figure


def precision_plot(curves: Curves, chosen: str) -> Figure:
    """Share of frames over the distance of the centres; the legend gives it at 20 px, best first."""
    with matplotlib.rc_context(SETTINGS):
        figure, axes = _new(6.8, 4.2)
        at_20 = {name: float(curve[1][PRECISION_THRESHOLDS == 20.0][0]) for name, curve in curves.items()}
        for name in sorted(curves, key=lambda name: -at_20[name]):
            style = style_of(name, list(curves), chosen)
            axes.plot(PRECISION_THRESHOLDS, curves[name][1], label=f"{name} {at_20[name]:.3f}", **style)
        axes.axvline(20.0, color="#999999", linewidth=0.8)
        axes.set(xlabel="distance of the centres, px", ylabel="share of frames", xlim=(0, 50), ylim=(0, 1.01))
        figure.legend(title="at 20 px", fontsize=8, loc="outside right upper")
        return figure


def speed_plot(table: pd.DataFrame, chosen: str) -> Figure | None:
    """Mean IoU over frames per second; `table` is the overall table. None when speed was not measured."""
    # What does nothing has no speed to speak of, and would take half of the axis.
    known = table[table["fps"] < 1e5].dropna(subset=["fps", "mean_iou"])
    if known.empty:
        return None
    with matplotlib.rc_context(SETTINGS):
        figure, axes = _new(5.4, 4.2)
        names = list(table["tracker"])
        axes.set_xscale("log")
        taken: list[tuple[float, float]] = []
        for name, fps, score in zip(known["tracker"], known["fps"], known["mean_iou"], strict=True):
            axes.scatter(fps, score, s=60, color=colour_of(name, names, chosen), zorder=3)
            # Names of neighbours stand at different heights.
            near = sum(abs(np.log10(fps / x)) < 0.6 and abs(score - y) < 0.05 for x, y in taken)
            offset = (7, -3 if near % 2 == 0 else -9)
            weight = "bold" if name == chosen else "normal"
            axes.annotate(name, (fps, score), offset, textcoords="offset points", fontsize=8, fontweight=weight)
            taken.append((fps, score))
        axes.margins(x=0.22)
        axes.set(xlabel="frames per second (one thread)", ylabel="mean IoU", ylim=(0, 1.02))
        return figure


def calibration_plot(tables: Mapping[str, pd.DataFrame], chosen: str) -> Figure | None:
    """Share of frames really located over the tracker's own score; a calibrated one lies on the diagonal.

    The legend gives the expected calibration error. Each point is a tenth of the score: its area says how many frames
    have it, its bar how well the share is known, with sequences that are independent and frames that are not.
    """
    if not tables:
        return None
    with matplotlib.rc_context(SETTINGS):
        figure, axes = _new(5.4, 4.2)
        axes.plot([0, 1], [0, 1], color="#999999", linewidth=0.8)
        for name, table in tables.items():
            colour = colour_of(name, list(tables), chosen)
            columns = ("score", "located", "low", "high", "frames")
            score, located, low, high, frames = (table[column].to_numpy(float) for column in columns)
            label = f"{name}, ECE {calibration_error(table):.3f}"
            axes.vlines(score, low, high, color=colour, linewidth=1.2)
            axes.scatter(score, located, s=12 + 8 * np.log2(frames), color=colour, label=label, zorder=3)
            if name == chosen:
                _number(axes, score, located, frames)
        axes.set(
            xlabel="getTrackingScore()", ylabel="share located (IoU ≥ 0.5)", xlim=(-0.06, 1.06), ylim=(-0.06, 1.06)
        )
        axes.legend(fontsize=8, loc="upper left")
        return figure


def _number(axes: Axes, score: FloatArray, located: FloatArray, frames: FloatArray) -> None:
    for x, y, count in zip(score, located, frames, strict=True):
        # On the inner side of the point, so that neighbours at either end do not touch.
        offset = (0, -15 if y > 0.5 else 9)
        axes.annotate(f"{int(count)}", (x, y), offset, textcoords="offset points", fontsize=8, ha="center", zorder=4)


def before_loss_plot(scores: Mapping[str, FloatArray], chosen: str, *, before: int = 20) -> Figure | None:
    """Score in the frames round a loss: the median, and of the chosen tracker each loss as a thin line."""
    if not scores:
        return None
    with matplotlib.rc_context(SETTINGS):
        figure, axes = _new(5.4, 4.2)
        for name, rows in scores.items():
            style, frames = style_of(name, list(scores), chosen), np.arange(rows.shape[1]) - before
            if name == chosen:
                axes.plot(frames, rows.T, color=style["color"], linewidth=0.8, alpha=0.45)
            label = f"{name}, {len(rows)} {'loss' if len(rows) == 1 else 'losses'}"
            axes.plot(frames, median_known(rows), label=label, **style)
        axes.axvline(0.0, color="#999999", linewidth=0.8)
        axes.set(xlabel="frames from the loss (IoU < 0.1, or out of sight)", ylabel="score", ylim=(-0.02, 1.02))
        axes.legend(fontsize=8, loc="lower left")
        return figure
