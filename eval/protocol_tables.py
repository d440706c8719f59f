"""What the protocols of :mod:`eval.protocols` say about trackers: one table of numbers each, on common sequences."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .intervals import jackknife_interval, mean_interval
from .metrics import FrameScores, overlap_figures, summarise
from .protocols import BURN_IN, ONE_PASS
from .results import Run
from .sequences import Sequence
from .statistics import score_answers

__all__ = ["TITLES", "expected_overlap", "precision_recall", "protocol_tables"]

FloatArray = NDArray[np.float64]

TITLES: dict[str, str] = {
    "sre": "SRE: other start boxes",
    "tre": "TRE: other start frames",
    "restarts": "Restarts after each failure, as VOT's",
    "realtime": "Real time",
    "long-term": "Long-term, as VOT's",
}

_Answered = tuple[FloatArray, FloatArray, NDArray[np.bool_]]
"""Of a sequence: overlap, score (NaN where nothing was answered) and whether the object is seen."""

_RESOLUTION = 100  # thresholds of the score that precision and recall are taken at


@dataclass(frozen=True)
class _Led:
    """A run with the truth it was led along; `scores` is about the frames after its first one."""

    run: Run
    sequence: Sequence
    first: int
    scores: FrameScores

    @property
    def overlap(self) -> FloatArray:
        """What VOT's figures are made of: IoU with the true regions where these are the truth, else with boxes."""
        return self.scores.finest_iou if self.sequence.by_region else self.scores.iou

    @property
    def figures(self) -> dict[str, float]:
        """Mean, AUC and success rates of that overlap."""
        return overlap_figures(self.overlap[self.scores.visible])


def protocol_tables(runs: Iterable[Run], sequences: Iterable[Sequence]) -> dict[str, pd.DataFrame]:
    """Make a table of numbers for each protocol that there are runs of.

    Parameters
    ----------
    runs : iterable of Run
        Of any protocols; those on another version of their sequence, or from perturbed boxes, are left out.
    sequences : iterable of Sequence

    Returns
    -------
    dict of str to DataFrame
        By protocol, ``realtime:FPS`` once for each rate; one row per tracker, the best first. The long-term table is
        made of the runs in one pass.
    """
    known = {sequence.name: sequence for sequence in sequences}
    by_protocol: dict[str, list[_Led]] = {}
    for run in runs:
        sequence = known.get(run.sequence)
        if (
            sequence is None
            or run.provenance.get("digest") != sequence.digest
            or len(run.trajectory.ok) != len(sequence)
        ):
            continue
        name = "long-term" if run.protocol == ONE_PASS.key else run.protocol
        if name.partition(":")[0] not in _TABLES or (run.protocol == ONE_PASS.key and run.start):
            continue
        by_protocol.setdefault(name, []).append(_led(run, sequence))
    tables = {}
    for name, found in by_protocol.items():
        passes = [led for led in by_protocol.get("long-term", []) if led.run.repeat == 0]
        tables[name] = _TABLES[name.partition(":")[0]](_common(found), passes)
    return dict(sorted(tables.items(), key=lambda item: list(TITLES).index(item[0].partition(":")[0])))


def _led(run: Run, sequence: Sequence) -> _Led:
    first = run.marks.get("started", [0])[0]
    return _Led(run, sequence, first, score_answers(sequence, run.trajectory, first))


def _common(found: list[_Led]) -> dict[str, list[_Led]]:
    """Runs by tracker, on the sequences that all trackers have run; all where there are none."""
    names: dict[str, set[str]] = {}
    for led in found:
        names.setdefault(led.run.tracker, set()).add(led.run.sequence)
    shared = set.intersection(*names.values())
    by_tracker: dict[str, list[_Led]] = {}
    for led in found:
        if led.run.sequence in shared or not shared:
            by_tracker.setdefault(led.run.tracker, []).append(led)
    return by_tracker


def _sorted(rows: list[dict[str, object]], by: str) -> pd.DataFrame:
    table = pd.DataFrame(rows)
    return table.sort_values(by, ascending=False, kind="stable", ignore_index=True)


def _interval(values: pd.Series[float], own: list[_Led]) -> tuple[float, float]:
    """Interval of the mean over sequences; scenes are what is independent."""
    scenes = {led.run.sequence: led.sequence.scene for led in own}
    low, high = mean_interval(np.asarray(values, dtype=np.float64), [scenes[str(name)] for name in values.index])
    return max(low, 0.0), min(high, 1.0)


# --- other starts ----------------------------------------------------------------------------------------------


def _starts_table(found: Mapping[str, list[_Led]], passes: list[_Led]) -> pd.DataFrame:
    """Means over the starts of each sequence, then over sequences; the least mean IoU of a start likewise."""
    rows = []
    for tracker, own in found.items():
        scores = pd.DataFrame([{"sequence": led.run.sequence, **summarise(led.scores)} for led in own])
        grouped = scores.groupby("sequence", sort=False)
        means = grouped[["mean_iou", "auc", "sr50", "precision20"]].mean()
        low, high = _interval(means["mean_iou"], own)
        rows.append(
            {
                "tracker": tracker,
                "runs": len(own),
                **{str(name): float(value) for name, value in means.mean().items()},
                "low": low,
                "high": high,
                "worst_start": float(grouped["mean_iou"].min().mean()),
            }
        )
    return _sorted(rows, "mean_iou")


# --- restarts --------------------------------------------------------------------------------------------------


def _restarts_table(found: Mapping[str, list[_Led]], passes: list[_Led]) -> pd.DataFrame:
    """Accuracy, robustness and expected average overlap.

    Accuracy and failures are means over sequences that weigh by their frames, as VOT's toolkit has them.
    """
    lengths = {led.run.sequence: int(led.scores.visible.sum()) for own in found.values() for led in own}
    low, high = _typical(np.array(list(lengths.values()), dtype=float))
    rows = []
    for tracker, own in found.items():
        weights = np.array([len(led.sequence) for led in own], dtype=float)
        accuracy, failures = np.array([_accuracy(led) for led in own]), np.array([_failures(led) for led in own])
        parts = [_fragments(led) for led in own]

        def overlap(chosen: NDArray[np.intp], parts: list[list[tuple[FloatArray, bool]]] = parts) -> float:
            together = [part for index in chosen for part in parts[index]]
            window = expected_overlap(together, max(lengths.values()))[low : high + 1]
            return float(np.nanmean(window)) if np.isfinite(window).any() else math.nan

        bounds = np.clip(jackknife_interval(overlap, [led.sequence.scene for led in own]), 0.0, 1.0)
        rows.append(
            {
                "tracker": tracker,
                "eao": overlap(np.arange(len(own))),
                **dict(zip(("low", "high"), bounds.tolist(), strict=True)),
                "accuracy": _weighted_mean(accuracy, weights),
                "failures": float(np.average(failures, weights=weights)),
                "per_hundred": float(100.0 * failures.sum() / weights.sum()),
                "from": low,
                "to": high,
            }
        )
    return _sorted(rows, "eao")


def _weighted_mean(values: FloatArray, weights: FloatArray) -> float:
    known = np.isfinite(values)
    return float(np.average(values[known], weights=weights[known])) if known.any() else math.nan


def _typical(lengths: FloatArray) -> tuple[int, int]:
    """Numbers of scored frames between which the middle half of the sequences is."""
    low, high = np.quantile(lengths, [0.25, 0.75])
    return max(int(low), 1), max(int(high), 1)


def _failures(led: _Led) -> int:
    return len(led.run.marks.get("failed", ()))


def _spans(led: _Led) -> list[tuple[int, int, bool]]:
    """First frame, frame after the last one, and whether it reached the end, of each way from a start."""
    failed = led.run.marks.get("failed", ())
    spans = []
    for start in led.run.marks.get("started", ()):
        end = next((frame for frame in failed if frame > start), None)
        spans.append((start, len(led.sequence) if end is None else end, end is None))
    return spans


def _accuracy(led: _Led) -> float:
    """Mean IoU without failures and the frames after a start; 0 where failures left none of them, as VOT has it."""
    iou = np.concatenate([[np.nan], led.overlap])
    counted = np.concatenate([[math.nan], *(iou[start + BURN_IN : end] for start, end, _ in _spans(led))])
    counted = counted[np.isfinite(counted)]
    if counted.size:
        return float(counted.mean())
    return 0.0 if _failures(led) else math.nan


def _fragments(led: _Led) -> list[tuple[FloatArray, bool]]:
    """IoU of the scored frames after each start, and whether they reach the end of the sequence."""
    iou = np.concatenate([[np.nan], led.overlap])
    parts = [(iou[start + 1 : end], whole) for start, end, whole in _spans(led)]
    return [(part[np.isfinite(part)], whole) for part, whole in parts]


def expected_overlap(fragments: list[tuple[FloatArray, bool]], longest: int) -> FloatArray:
    """Expected average overlap after so many frames.

    Parameters
    ----------
    fragments : list of (ndarray, bool)
        IoU of the frames after a start, and whether they end with the sequence. What ends with a failure goes on as
        0; what ends with the sequence says nothing about longer ones.
    longest : int
        Frames up to which it is told.

    Returns
    -------
    ndarray, shape (longest + 1,)
        Entry n is the mean, over the fragments that tell, of their mean IoU over the first n frames; NaN where none
        does. Entry 0 is 1.
    """
    overlaps, told = np.zeros((len(fragments), longest)), np.zeros((len(fragments), longest), dtype=bool)
    for row, (part, whole) in enumerate(fragments):
        overlaps[row, : len(part)] = part
        told[row, : len(part) if whole else longest] = True
    means = np.cumsum(overlaps, axis=1) / np.arange(1, longest + 1)
    number = told.sum(axis=0)
    curve = np.divide((means * told).sum(axis=0), number, out=np.full(longest, np.nan), where=number > 0)
    return np.concatenate([[1.0], curve])


# --- real time -------------------------------------------------------------------------------------------------


def _realtime_table(found: Mapping[str, list[_Led]], passes: list[_Led]) -> pd.DataFrame:
    """Mean IoU, share of the frames that passed by, and mean IoU in one pass without hurry on the same sequences."""
    unhurried = {(led.run.tracker, led.run.sequence): led.figures["mean_iou"] for led in passes}
    rows = []
    for tracker, own in found.items():
        means = pd.DataFrame([{"sequence": led.run.sequence, **led.figures} for led in own])
        by_sequence = means.groupby("sequence", sort=False)[["mean_iou", "auc", "sr50"]].mean()
        low, high = _interval(by_sequence["mean_iou"], own)
        dropped = [len(led.run.marks.get("dropped", ())) / (len(led.sequence) - 1) for led in own]
        before = [unhurried.get((tracker, str(name)), math.nan) for name in by_sequence.index]
        rows.append(
            {
                "tracker": tracker,
                **{str(name): float(value) for name, value in by_sequence.mean().items()},
                "low": low,
                "high": high,
                "dropped": float(np.mean(dropped)),
                "unhurried": float(np.mean(before)),
            }
        )
    return _sorted(rows, "mean_iou")


# --- long term -------------------------------------------------------------------------------------------------


def _long_term_table(found: Mapping[str, list[_Led]], passes: list[_Led]) -> pd.DataFrame:
    """Precision, recall and F at the threshold of the score where F is greatest, and F of `ok` as it is."""
    rows = []
    for tracker, own in found.items():
        parts = [_confident(led) for led in own]
        precision, recall, threshold = _best(parts, _thresholds(parts))
        plain = precision_recall(parts, -math.inf)

        def together(chosen: NDArray[np.intp], parts: list[_Answered] = parts, threshold: float = threshold) -> float:
            return _f(*precision_recall([parts[index] for index in chosen], threshold))

        bounds = np.clip(jackknife_interval(together, [led.sequence.scene for led in own]), 0.0, 1.0)
        rows.append(
            {
                "tracker": tracker,
                "f": _f(precision, recall),
                **dict(zip(("low", "high"), bounds.tolist(), strict=True)),
                "precision": precision,
                "recall": recall,
                "threshold": threshold if np.isfinite(threshold) else math.nan,
                "f_ok": _f(*plain),
            }
        )
    return _sorted(rows, "f")


def _confident(led: _Led) -> _Answered:
    """Of the frames that count: overlap (0 without an object), score (NaN without an answer), whether it is seen."""
    scores = led.scores
    score = led.run.trajectory.score[led.first + 1 :]
    score = np.where(scores.ok, np.where(np.isfinite(score), score, 1.0), np.nan)
    counted = scores.visible | scores.invisible
    return np.nan_to_num(led.overlap)[counted], score[counted], scores.visible[counted]


def _thresholds(parts: list[_Answered]) -> FloatArray:
    scores = np.concatenate([score[np.isfinite(score)] for _, score, _ in parts])
    if not scores.size:
        return np.array([-np.inf])
    found = np.quantile(scores, np.linspace(0.0, 1.0, _RESOLUTION), method="nearest")
    return np.concatenate([[-np.inf], np.unique(found)])


def precision_recall(parts: list[_Answered], threshold: float) -> tuple[float, float]:
    """Precision and recall of answers with at least a score: means over sequences.

    Parameters
    ----------
    parts : list of (ndarray, ndarray, ndarray of bool)
        Of each sequence: overlap, score (NaN where nothing was answered) and whether the object is seen.
    threshold : float

    Returns
    -------
    (float, float)
        A sequence without such an answer has precision 1, as VOT has it; one in which nothing is seen no recall.
    """
    precisions, recalls = [], []
    for overlap, score, seen in parts:
        said = score >= threshold
        precisions.append(float(overlap[said].mean()) if said.any() else 1.0)
        if seen.any():
            recalls.append(float(overlap[said].sum() / seen.sum()))
    return float(np.mean(precisions)), float(np.mean(recalls)) if recalls else math.nan


def _best(parts: list[_Answered], thresholds: FloatArray) -> tuple[float, float, float]:
    found = [(*precision_recall(parts, float(threshold)), float(threshold)) for threshold in thresholds]
    return max(found, key=lambda row: _f(row[0], row[1]))


def _f(precision: float, recall: float) -> float:
    """Harmonic mean; 0 of two zeros."""
    total = precision + recall
    return 2.0 * precision * recall / total if total > 0 else 0.0 * total


_TABLES: dict[str, Callable[[Mapping[str, list[_Led]], list[_Led]], pd.DataFrame]] = {
    "sre": _starts_table,
    "tre": _starts_table,
    "restarts": _restarts_table,
    "realtime": _realtime_table,
    "long-term": _long_term_table,
}
