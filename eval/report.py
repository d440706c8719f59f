"""The report: one HTML file with all figures in it, to be sent to anyone, and beside it a page for each sequence."""

from __future__ import annotations

import base64
import html
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from . import metrics, protocols
from .diagnosis import Failure, failures
from .framesource import FrameSourceError
from .metrics import METRICS
from .overlay import contact_sheet, encode_jpeg
from .pages import page_environment, page_name, write_page
from .plots import (
    as_svg,
    before_loss_plot,
    calibration_plot,
    colour_of,
    precision_plot,
    speed_plot,
    success_plot,
    write_figure,
)
from .results import Folder, ResultsError, Run, SpeedRun
from .sequences import Sequence
from .statistics import LOW_QUANTILE, ORACLE, SURE, ScoredRun, calibration, curves, score_before_loss
from .tables import (
    Summary,
    attribute_table,
    counted,
    difference_table,
    failure_table,
    overall_table,
    protocol_text,
    protocol_title,
    rank_table,
    ranks_caption,
    sequence_table,
    speed_text,
    theme_table,
    worst_table,
)
from .trackers import TRACKERS

__all__ = ["write_figures", "write_report"]

_TEMPLATE = "report.html.j2"

_SHEETS = 40
"""Most sequences with a contact sheet and a page of their own."""

SHEET_BYTES = 4_000_000
"""Contact sheets of one report, at most, as they stand in it."""


def write_report(
    summary: Summary, folder: Folder, path: Path, *, videos: int = 0, shown: tuple[str, ...] = ()
) -> None:
    """Write the report of a folder of results, and in ``pages`` beside it the pages of its sequences.

    Parameters
    ----------
    summary : Summary
    folder : Folder
        Where the results are.
    path : Path
        The HTML file.
    videos : int, optional
        Number of sequences with a video beside their page: those first on which the chosen tracker is farthest
        behind.
    shown : tuple of str, optional
        Trackers whose boxes are drawn; the chosen one and the best other one by default.

    Raises
    ------
    ResultsError
        If the file cannot be written.
    """
    environment = page_environment()
    environment.tests["share"] = _is_share
    text = environment.get_template(_TEMPLATE).render(
        _contents(summary, folder, path.parent / "pages", videos, shown)
    )
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultsError(f"cannot write {path}: {error.strerror or error}") from error


def _contents(
    summary: Summary, folder: Folder, pages: Path, videos: int, shown: tuple[str, ...]
) -> dict[str, object]:
    origin, provenance = _provenance(summary)
    whole = overall_table(summary)
    theirs = [name for name in whole.columns if name.endswith(("(OTB)", "(GOT-10k)"))]
    return {
        "summary": summary,
        "sentence": _sentence(summary),
        "colours": _colours(summary),
        "overall": whole.drop(columns=theirs),
        "compatible": whole[[whole.columns[0], *theirs]],
        "notes": {name: TRACKERS[name].note for name in summary.overall["tracker"] if name in TRACKERS},
        "differences": difference_table(summary),
        "ranks": rank_table(summary) if len(summary.ranks) > 1 else (),
        "ranks_caption": ranks_caption(summary),
        "protocols": [(protocol_title(name), protocol_text(table)) for name, table in summary.protocols.items()],
        "led": _conventions(protocols.__doc__ or "", "frames.\n\n"),
        "attributes": attribute_table(summary),
        "themes": theme_table(summary),
        "worst": worst_table(summary),
        "per_sequence": sequence_table(summary),
        "speed": speed_text(folder.read_speeds()) if len(summary.speed) else None,
        "turns": _turns(folder.read_speeds()),
        "wall": f"{(summary.speed['wall'] / summary.speed['median']).median():.2f}",
        "failures": failure_table(summary),
        "plots": [(title, as_svg(figure)) for _, title, figure in _curves(summary)],
        "score_plots": [(title, as_svg(figure)) for _, title, figure in _score_figures(summary)],
        "pictures": _pictures(summary, pages, videos, shown),
        "origin": origin,
        "provenance": provenance,
        "conventions": _conventions(metrics.__doc__ or "", "-----------\n"),
        "units": {metric.title: metric.better for metric in METRICS.values()},
        "low_quantile": f"{100 * LOW_QUANTILE:g}",
        "sure": f"{SURE:g}",
    }


def _curves(summary: Summary) -> list[tuple[str, str, Figure | None]]:
    """Figures of accuracy and speed: name of the file, title, figure."""
    found, chosen = curves(summary.scored), summary.chosen
    areas = dict(zip(summary.overall["tracker"], summary.overall["auc"], strict=True))
    return [
        ("success", "Success", success_plot(found, areas, chosen)),
        ("precision", "Precision", precision_plot(found, chosen)),
        ("speed", "Accuracy and speed", speed_plot(summary.overall, chosen)),
    ]


def _score_figures(summary: Summary) -> list[tuple[str, str, Figure | None]]:
    """Figures about the trackers' own scores, as :func:`_curves` gives them."""
    reliable = calibration_plot(calibration(summary.scored), summary.chosen)
    losses = before_loss_plot(score_before_loss(summary.scored), summary.chosen)
    return [
        ("reliability", "Reliability of the score", reliable),
        ("loss", "The score round a loss", losses),
    ]


def write_figures(summary: Summary, folder: Path) -> list[Path]:
    """Write every figure of the report as SVG and PDF into a folder; returns the files.

    Raises
    ------
    ResultsError
        If they cannot be written.
    """
    figures = [*_curves(summary), *_score_figures(summary)]
    return [path for name, _, figure in figures if figure is not None for path in write_figure(figure, name, folder)]


def _turns(runs: list[SpeedRun]) -> str:
    """How long a turn of each tracker was, in words; nothing where results are too old to say."""
    blocks = sorted({str(run.provenance["block"]) for run in runs if "block" in run.provenance}, key=int)
    return f", {' or '.join(blocks)} at a time" if blocks else ""


def _is_share(text: str) -> bool:
    """Whether a cell is a share in 0–1, to be shaded; whole numbers are counts."""
    try:
        return "." in text and 0.0 <= float(text) <= 1.0
    except ValueError:
        return False


def _sentence(summary: Summary) -> str:
    table = summary.overall
    rows = table[["tracker", "mean_iou", "low", "high", "sequences", "scenes"]].to_numpy().tolist()
    _, score, low, high, count, scenes = next(row for row in rows if row[0] == summary.chosen)
    text = f"{summary.chosen}: mean IoU {score:.3f}"
    if np.isfinite(low):
        text += f" ({low:.3f}–{high:.3f})"
    text += f" over {count} of {counted(len(summary.sequences), 'sequence')}"
    if scenes < count:
        text += f", which show {counted(scenes, 'scene')}"
    others = [row for row in rows if row[0] not in (summary.chosen, ORACLE)]
    if others:
        # The table has the best first.
        text += f"; the best other is {others[0][0]} with {others[0][1]:.3f}"
    return text + "."


def _colours(summary: Summary) -> dict[str, str]:
    names = list(summary.overall["tracker"])
    return {name: colour_of(name, names, summary.chosen) for name in names}


def _conventions(text: str, after: str) -> list[str]:
    """The list in the docstring that the code obeys, as HTML."""
    lines = re.split(r"^\* ", text.partition(after)[2], flags=re.MULTILINE)[1:]
    return [_from_rst(" ".join(line.split())) for line in lines]


def _from_rst(text: str) -> str:
    """The little markup that our docstrings have, as HTML."""
    text = re.sub(r"(?::\w+:)?(`+)([^`]+)\1", r"<code>\2</code>", html.escape(text))
    return re.sub(r"\*([^*]+)\*", r"<i>\1</i>", text)


def _first_runs(summary: Summary) -> dict[str, dict[str, ScoredRun]]:
    """By sequence and tracker, the best tracker first."""
    found: dict[str, dict[str, ScoredRun]] = {}
    for item in summary.scored:
        if item.run.start == 0 and item.run.repeat == 0:
            found.setdefault(item.run.sequence, {})[item.run.tracker] = item
    order = [str(name) for name in summary.overall["tracker"]]
    return {
        sequence: dict(sorted(items.items(), key=lambda item: order.index(item[0])))
        for sequence, items in found.items()
    }


def _by_shortfall(summary: Summary) -> list[tuple[Sequence, str, float]]:
    """Sequences with the best other tracker, those first on which the chosen one is farthest behind it.

    Of a distribution suite, those first on which the chosen one is worst.
    """
    wide = summary.pairs.pivot(index="sequence", columns="tracker", values="mean_iou")
    rows = []
    for sequence in summary.sequences:
        if sequence.name not in wide.index:
            continue
        row = wide.loc[[sequence.name]].dropna(axis="columns")
        scores = dict(zip(map(str, row.columns), row.to_numpy(float)[0].tolist(), strict=True))
        own = scores.pop(summary.chosen, np.inf)
        scores.pop(ORACLE, None)
        best = max(scores, key=lambda name: scores[name], default="")
        rows.append(
            (sequence, best, own - scores.get(best, 0.0), own if sequence.theme else own - scores.get(best, 0.0))
        )
    return [row[:3] for row in sorted(rows, key=lambda row: row[3])]


def _pictures(summary: Summary, pages: Path, videos: int, shown: tuple[str, ...]) -> list[dict[str, object]]:
    """Pages of the sequences, and contact sheets of those whose frames can be had, as many as there is room for."""
    runs, colours = _first_runs(summary), _colours(summary)
    found: list[dict[str, object]] = []
    room = SHEET_BYTES
    for rank, (sequence, best, gap) in enumerate(_by_shortfall(summary)[:_SHEETS]):
        own = runs[sequence.name]
        names = tuple(name for name in (shown or (best, summary.chosen)) if name in own)
        write_page(pages, list(own.values()), colours, shown=names, video=rank < videos)
        try:
            picture = contact_sheet(sequence, {name: own[name].run for name in names}, colours)
            sheet = base64.b64encode(encode_jpeg(picture)).decode() if room > 0 else ""
        except (FrameSourceError, OSError):
            sheet = ""
        room -= len(sheet)
        found.append(
            {
                "name": sequence.name,
                "page": f"{pages.name}/{page_name(sequence.name)}",
                "attributes": ", ".join(sequence.attributes),
                "gap": f"{gap:+.3f}" if np.isfinite(gap) else "",
                "shown": {name: colours[name] for name in names},
                "failures": _failure_words([failure for name in names for failure in failures(own[name])]),
                "sheet": sheet,
            }
        )
    return found


def _failure_words(found: list[Failure]) -> str:
    """How many of which kind."""
    counts = Counter(one.kind for one in found)
    return ", ".join(f"{count} × {kind}" for kind, count in counts.items())


def _provenance(summary: Summary) -> tuple[str, pd.DataFrame]:
    """What made the results: what all trackers share as a sentence, the rest as a table, one row per tracker.

    More than one entry in a cell means that the results are of mixed origin.
    """
    by_tracker: dict[str, list[Run]] = {}
    for item in summary.scored:
        by_tracker.setdefault(item.run.tracker, []).append(item.run)
    rows = []
    for tracker, runs in by_tracker.items():
        stamps = [run.provenance for run in runs]
        times = sorted(str(stamp["time"])[:16].replace("T", " ") for stamp in stamps)
        row = {"tracker": tracker, "runs": str(len(runs)), "factory": _distinct(stamp["tracker"] for stamp in stamps)}
        row |= {name: _distinct(stamp.get(name, "") for stamp in stamps) for name in ("params", "code", *_ORIGIN)}
        rows.append(row | {"from (UTC)": times[0], "to": times[-1]})
    table = pd.DataFrame(rows)
    shared = [name for name in _ORIGIN if table[name].nunique() == 1]
    # Results of earlier versions do not say everything.
    sentence = ", ".join(f"{_ORIGIN[name]} {table[name].iloc[0]}".strip() for name in shared if table[name].iloc[0])
    return sentence, table.drop(columns=shared)


_ORIGIN = {"machine": "", "python": "Python", "opencv": "OpenCV", "commit": "commit", "isolation": "isolation:"}


def _distinct(values: Iterable[object]) -> str:
    return ", ".join(dict.fromkeys(str(value) for value in values))
