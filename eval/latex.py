"""Tables for a paper: LaTeX that compiles with three packages, fits the line and has the best in bold."""

from __future__ import annotations

import math
from typing import Literal

import pandas as pd

from .metrics import METRICS
from .statistics import ORACLE

__all__ = ["Rivals", "latex_table"]

Rivals = Literal["rows", "columns", ""]

_ROWS = 40
"""Most rows of one table: what is longer goes on in the next one."""

_SIGNS_WIDE = 100  # what is wider goes on in the next one, too: made smaller still, nobody could read it
_LONG_TEXT = 44  # characters from which on a cell is a paragraph
_UNRATED = {"n", "sequences", "frames", "runs", "won", "even", "lost", "score ≥"}
_LOWER = {metric.title for metric in METRICS.values() if metric.better == "lower"} | {
    "p95 ms", "failed", "ECE", "sure, wrong", "R (failures)", "failures / 100", "frames dropped",
}  # fmt: skip

_SIGNS = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "{": r"\{",
        "}": r"\}",
        "$": r"\$",
        "%": r"\%",
        "_": r"\_",
        "&": r"\&",
        "#": r"\#",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "±": r"$\pm$",
        "×": r"$\times$",
        "–": "--",
        "−": "$-$",
        "≥": r"$\geq$",
        "≤": r"$\leq$",
        ">": "$>$",
        "<": "$<$",
        "→": r"$\rightarrow$",
        "¹": r"\textsuperscript{1}",
    }
)

_LATIN, _QUOTES = 0x180, "‘’“”„…—"  # what pdflatex knows as it is

_HEAD = r"""% \usepackage{array, booktabs, graphicx}
"""
# Wider than the line: made smaller. Narrower: left as it is.
_TABLE = r"""\begin{table}[htbp]
\centering
\caption{%(caption)s}
\label{%(label)s}
\sbox0{\begin{tabular}{@{}%(columns)s@{}}
\toprule
%(head)s \\
\midrule
%(body)s
\bottomrule
\end{tabular}}
\ifdim\wd0>\linewidth\resizebox{\linewidth}{!}{\usebox0}\else\usebox0\fi
\end{table}
"""


def latex_table(table: pd.DataFrame, *, caption: str, label: str, rivals: Rivals = "") -> str:
    """Write a table of texts as floats of LaTeX, one for every forty rows and hundred signs.

    Parameters
    ----------
    table : DataFrame
        Of texts; the first column names the rows.
    caption, label : str
    rivals : {"rows", "columns", ""}, optional
        Whose best is bold: the rows' in each column, the columns' in each row, or nobody's.

    Returns
    -------
    str
        Needs the packages array, booktabs and graphicx, as its first line says.
    """
    best = _best(table, rivals)
    parts = [
        (columns, range(start, min(start + _ROWS, len(table))))
        for start in range(0, max(len(table), 1), _ROWS)
        for columns in _columns(table)
    ]
    texts = []
    for number, (columns, rows) in enumerate(parts):
        values = {
            "caption": _escaped(caption) + (" (continued)" if number else ""),
            "label": label + (f"-{number + 1}" if number else ""),
            "columns": "".join(_alignment(table, column) for column in columns),
            "head": " & ".join(_escaped(str(table.columns[column])) for column in columns),
            "body": "\n".join(
                " & ".join(_cell(str(table.iat[row, column]), (row, column) in best) for column in columns) + r" \\"
                for row in rows
            ),
        }
        texts.append(_TABLE % values)
    return _HEAD + "\n".join(texts)


def _columns(table: pd.DataFrame) -> list[list[int]]:
    """Columns side by side, as many as can still be read on a page; the first in each part."""
    widths = [max(len(str(cell)) for cell in (name, *table[name])) for name in table.columns]
    parts: list[list[int]] = [[0]]
    for column in range(1, table.shape[1]):
        room = _SIGNS_WIDE - sum(min(widths[other], _LONG_TEXT) + 2 for other in parts[-1])
        if min(widths[column], _LONG_TEXT) > room and len(parts[-1]) > 1:
            parts.append([0])
        parts[-1].append(column)
    return parts


def _alignment(table: pd.DataFrame, column: int) -> str:
    cells = [str(cell) for cell in table.iloc[:, column]]
    if any(len(cell) > _LONG_TEXT for cell in cells):
        return _paragraph(0.6 if column else 0.4)
    return "l" if column == 0 or any(cell[:1].isalpha() for cell in cells) else "r"


def _paragraph(share: float) -> str:
    return rf">{{\raggedright\arraybackslash}}p{{{share}\linewidth}}"


def _cell(text: str, best: bool) -> str:
    text = _escaped(text)
    return rf"\textbf{{{text}}}" if best else text


def _escaped(text: str) -> str:
    """Text as LaTeX takes it; of scripts that its default fonts have not, the numbers of the signs."""
    signs = text.translate(_SIGNS)
    return "".join(sign if ord(sign) < _LATIN or sign in _QUOTES else f"U+{ord(sign):04X}" for sign in signs)


def _best(table: pd.DataFrame, rivals: Rivals) -> set[tuple[int, int]]:
    """Row and column of each best cell; equal texts are equally good."""
    columns = range(1, table.shape[1])
    if rivals == "rows":
        names = table.iloc[:, 0].astype(str).tolist()
        rated = [row for row, name in enumerate(names) if name != ORACLE]
        lines = [
            ([(row, column) for row in rated], str(table.columns[column]) in _LOWER)
            for column in columns
            if str(table.columns[column]) not in _UNRATED
        ]
    elif rivals == "columns":
        known = {*_UNRATED, *_LOWER, ORACLE, "least IoU"}
        rated = [column for column in columns if str(table.columns[column]) not in known]
        lines = [([(row, column) for column in rated], False) for row in range(len(table))]
    else:
        return set()
    found: set[tuple[int, int]] = set()
    for cells, lower in lines:
        values = {cell: _number(str(table.iat[cell])) for cell in cells}
        known_values = [value for value in values.values() if not math.isnan(value)]
        if len(known_values) > 1:
            top = min(known_values) if lower else max(known_values)
            found |= {cell for cell, value in values.items() if value == top}
    return found


def _number(text: str) -> float:
    """NaN for what is no single number: names, intervals, dashes."""
    try:
        return float(text)
    except ValueError:
        return math.nan
