"""Plots of a flow comparison: error against time, error by pair, and the flow fields themselves."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .picture import wheel_legend
from .run import picture_path
from .tables import pair_table, summary_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["error_by_pair", "error_over_time", "picture_grid", "save_plots"]

FAMILY_COLORS = {
    "ours": "#d62728",
    "OpenCV": "#1f77b4",
    "scikit-image": "#ff7f0e",
    "surveyed": "#2ca02c",
    "null": "#7f7f7f",
    "own": "#9467bd",
}

TILE_WIDTH, TILE_HEIGHT, CAPTION_HEIGHT = 200, 170, 16
"""Room of one picture in a grid and of the words below it, px."""

LABEL_WIDTH = 140
"""Room of the methods' names, px."""

PAIRS_PER_GRID = 8


def save_plots(table: pd.DataFrame, out: Path) -> list[Path]:
    """Write flow-time.png, flow-pairs.png and flow-pictures-*.png.

    Parameters
    ----------
    table : DataFrame
        As ``results_frame`` makes it.
    out : Path
        The folder of the run; the pictures of the single results are read from it.

    Returns
    -------
    list of Path
        Nothing if no method gave a result.
    """
    scored = table[table["aepe"].notna()]
    if scored.empty:
        return []
    files = []
    for name, figure in {"flow-time": error_over_time(scored), "flow-pairs": error_by_pair(scored)}.items():
        files.append(out / f"{name}.png")
        figure.savefig(files[-1], dpi=130)
    methods = list(summary_table(scored).index)
    pairs = list(dict.fromkeys(scored["pair"]))
    for number in range(math.ceil(len(pairs) / PAIRS_PER_GRID)):
        part = pairs[number * PAIRS_PER_GRID : (number + 1) * PAIRS_PER_GRID]
        files.append(out / f"flow-pictures-{number + 1}.png")
        cv2.imwrite(str(files[-1]), picture_grid(scored, methods, part, out))
    return files


def error_over_time(table: pd.DataFrame) -> Figure:
    """Mean endpoint error against time per pair, both logarithmic: lower left is better.

    Parameters
    ----------
    table : DataFrame
        Rows with a result.

    Returns
    -------
    matplotlib Figure
        The line joins the methods that no other beats in both time and error.
    """
    from matplotlib.figure import Figure
    from matplotlib.ticker import LogLocator, NullFormatter

    summary = summary_table(table).dropna(subset=["aepe"])
    figure = Figure(figsize=(9, 6), layout="constrained")
    axes = figure.subplots()
    for family, part in summary[summary["family"] != "null"].groupby("family", sort=False):
        axes.scatter(part["ms"], part["aepe"], s=36, color=FAMILY_COLORS.get(str(family), "black"), label=str(family))
    for name, row in summary[summary["family"] == "null"].iterrows():
        axes.axhline(row["aepe"], color=FAMILY_COLORS["null"], linestyle="--", label=f"{name} flow")
    front = _pareto(summary[summary["family"] != "null"])
    axes.plot(front["ms"], front["aepe"], color="black", linewidth=0.8, alpha=0.4, drawstyle="steps-post", zorder=0)
    axes.set(
        xscale="log",
        yscale="log",
        xlabel="processor time per pair on one thread, ms",
        ylabel="mean endpoint error, px",
    )
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 3.0, 5.0)))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.margins(x=0.12)
    axes.grid(alpha=0.2)
    axes.legend(fontsize=8)
    axes.set_title(f"Flow methods on {table['pair'].nunique()} pairs with true flow")
    moving = summary[summary["family"] != "null"]
    _label_points(figure, axes, {str(name): (row["ms"], row["aepe"]) for name, row in moving.iterrows()})
    return figure


def _label_points(figure: Figure, axes: Axes, points: dict[str, tuple[float, float]]) -> None:
    """Write a name beside each point, on the first of several sides where it covers no other name or point."""
    figure.draw_without_rendering()  # settles the axes, so that positions on the page are known
    places = {name: axes.transData.transform(point) for name, point in points.items()}
    taken = [(x - 4, y - 4, x + 4, y + 4) for x, y in places.values()]
    for name, (x, y) in places.items():
        width, height = 6.2 * len(name), 11
        sides = [(dx, dy) for dx in (7.0, -7.0 - width) for dy in (4.0, -14.0, -5.0)]
        boxes = [(x + dx, y + dy, x + dx + width, y + dy + height) for dx, dy in sides]
        chosen = next((i for i, box in enumerate(boxes) if not any(_overlap(box, other) for other in taken)), 0)
        taken.append(boxes[chosen])
        axes.annotate(name, points[name], xytext=sides[chosen], textcoords="offset pixels", fontsize=8)


def _overlap(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return one[0] < other[2] and other[0] < one[2] and one[1] < other[3] and other[1] < one[3]


def _pareto(summary: pd.DataFrame) -> pd.DataFrame:
    ordered = summary.sort_values("ms")
    return ordered[ordered["aepe"] < ordered["aepe"].cummin().shift(fill_value=np.inf)]


def error_by_pair(table: pd.DataFrame) -> Figure:
    """Endpoint error of every method on every pair, as a heat map with its figures.

    Parameters
    ----------
    table : DataFrame
        Rows with a result.

    Returns
    -------
    matplotlib Figure
        Colour is the error over that of the best method on the pair, logarithmic.
    """
    from matplotlib.figure import Figure

    wide = pair_table(table)
    values = wide.to_numpy(dtype=float)
    ratio = values / np.maximum(np.nanmin(values, axis=0, keepdims=True), 1e-3)
    figure = Figure(figsize=(2.5 + 0.85 * wide.shape[1], 1.5 + 0.3 * wide.shape[0]), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(np.log10(np.maximum(ratio, 1.0)), aspect="auto", cmap="YlOrRd", vmin=0.0, vmax=1.2)
    axes.set_xticks(range(wide.shape[1]), wide.columns, rotation=40, ha="right", fontsize=8)
    axes.set_yticks(range(wide.shape[0]), wide.index, fontsize=8)
    for (row, column), value in np.ndenumerate(values):
        if np.isfinite(value):
            color = "white" if ratio[row, column] > 8 else "black"
            axes.text(column, row, f"{value:.2f}", ha="center", va="center", fontsize=7, color=color)
    bar = figure.colorbar(image, ax=axes, fraction=0.03)
    bar.set_ticks([0.0, math.log10(2), math.log10(5), math.log10(10)], labels=["best", "2 ×", "5 ×", "10 ×"])
    axes.set_title("Mean endpoint error by pair, px")
    return figure


def picture_grid(table: pd.DataFrame, methods: list[str], pairs: list[str], out: Path) -> NDArray[np.uint8]:
    """Flow pictures, one row per method below the frame and the truth, one column per pair.

    Parameters
    ----------
    table : DataFrame
        Rows with a result.
    methods, pairs : list of str
    out : Path
        The folder of the run.

    Returns
    -------
    ndarray, shape (H, W, 3), uint8, BGR
    """
    scores = table.set_index(["method", "pair"])["aepe"].to_dict()
    rows = [np.hstack([_label("", legend=True), *(_tile(picture_path(out, pair, "frame"), pair) for pair in pairs)])]
    for name in ("truth", *methods):
        captions = [f"{scores[name, pair]:.3f} px" if (name, pair) in scores else "" for pair in pairs]
        tiles = [_tile(picture_path(out, pair, name), caption) for pair, caption in zip(pairs, captions, strict=True)]
        rows.append(np.hstack([_label(name), *tiles]))
    return np.vstack(rows)


def _label(text: str, legend: bool = False) -> NDArray[np.uint8]:
    label = np.full((TILE_HEIGHT, LABEL_WIDTH, 3), 255, np.uint8)
    if legend:
        label[20:120, 5:105] = wheel_legend(100)
    _write(label, text, (4, TILE_HEIGHT // 2))
    return label


def _tile(path: Path, caption: str) -> NDArray[np.uint8]:
    """A picture fitted into its place, with a thin edge so that a white one (no motion) is seen as a picture."""
    tile = np.full((TILE_HEIGHT, TILE_WIDTH, 3), 255, np.uint8)
    image = cv2.imread(str(path)) if path.is_file() else None
    if image is not None:
        room_height, room_width = TILE_HEIGHT - CAPTION_HEIGHT - 4, TILE_WIDTH - 4
        scale = min(room_height / image.shape[0], room_width / image.shape[1])
        size = round(image.shape[1] * scale), round(image.shape[0] * scale)
        left, top = (TILE_WIDTH - size[0]) // 2, (room_height - size[1]) // 2 + 2
        tile[top : top + size[1], left : left + size[0]] = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        cv2.rectangle(tile, (left - 1, top - 1), (left + size[0], top + size[1]), (190, 190, 190))
    _write(tile, caption, (4, TILE_HEIGHT - 4))
    return tile


def _write(image: NDArray[np.uint8], text: str, place: tuple[int, int]) -> None:
    cv2.putText(image, text, place, cv2.FONT_HERSHEY_SIMPLEX, 0.38, (0, 0, 0), 1, cv2.LINE_AA)
