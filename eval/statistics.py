"""From runs to numbers: scores per run, means per sequence and attribute, paired differences, trust in scores.

Every sequence counts once in a mean; what is independent, where intervals and tests need it, is a scene.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .intervals import critical_difference, holm, mean_interval, share_interval, sign_flip_p
from .metrics import COUNTS, METRICS, FrameScores, frame_scores, precision_curve, success_curve, summarise
from .results import COMPLETED, Run, SpeedRun, Trajectory
from .sequences import Sequence

__all__ = [
    "ORACLE",
    "ScoredRun",
    "calibration",
    "calibration_error",
    "common_pairs",
    "curves",
    "differences",
    "mean_ranks",
    "median_known",
    "overall",
    "per_attribute",
    "per_sequence",
    "per_theme",
    "score_answers",
    "score_before_loss",
    "score_frames",
    "score_quality",
    "score_table",
    "speed_table",
    "worst_sequences",
]

FloatArray = NDArray[np.float64]

LOW_QUANTILE = 0.05
"""Share of the sequences that are worse than what is called the 5 % quantile."""

ORACLE = "Oracle"
"""The tracker that knows the truth: it shows that the scale ends at 1, and competes with nobody."""

SURE = 0.9
"""Score from which on a tracker counts as sure of itself."""


@dataclass(frozen=True)
class ScoredRun:
    """A run, the sequence it was about, and the scores of its frames."""

    run: Run
    sequence: Sequence
    frames: FrameScores


def score_frames(runs: Iterable[Run], sequences: Iterable[Sequence]) -> list[ScoredRun]:
    """Score every frame of each run against the truth of its sequence.

    Runs on another version of their sequence, which were left behind, are not in the result.
    """
    known = {sequence.name: sequence for sequence in sequences}
    scored = []
    for run in runs:
        sequence, answer = known[run.sequence], run.trajectory
        if run.provenance.get("digest") == sequence.digest and len(answer.ok) == len(sequence):
            scored.append(ScoredRun(run, sequence, score_answers(sequence, answer)))
    return scored


def score_answers(sequence: Sequence, answer: Trajectory, first: int = 0) -> FrameScores:
    """Score what was answered against the truth of a sequence, from frame `first`, where the tracker started."""
    return frame_scores(
        sequence.boxes[first:],
        sequence.visibility[first:],
        answer.boxes[first:],
        answer.ok[first:],
        sequence.size,
        true_regions=sequence.regions[first:],
        regions=answer.regions[first:],
    )


def score_table(scored: Iterable[ScoredRun]) -> pd.DataFrame:
    """One row per run: tracker, sequence, scene, start, repeat, status, the metrics and their counts of frames."""
    names = ("tracker", "sequence", "start", "repeat", "status")
    rows = [
        {**{name: getattr(item.run, name) for name in names}, "scene": item.sequence.scene, **summarise(item.frames)}
        for item in scored
    ]
    columns = ["tracker", "sequence", "scene", "start", "repeat", "status", *METRICS, *COUNTS]
    return pd.DataFrame(rows, columns=columns)


def per_sequence(scores: pd.DataFrame) -> pd.DataFrame:
    """Mean over the repeats of each (tracker, sequence), and over its perturbed starts as `perturbed_iou`.

    Returns
    -------
    DataFrame
        One row per pair: tracker, sequence, its scene, the metrics from the exact start, `perturbed_iou`, `failed`
        runs, the counts of frames.
    """
    pair = ["tracker", "sequence"]
    numbers = [*METRICS, *COUNTS]
    exact = scores[scores["start"] == 0].groupby(pair, sort=False)[numbers].mean()
    perturbed = scores[scores["start"] > 0].groupby(pair, sort=False)["mean_iou"].mean()
    failed = (scores["status"] != COMPLETED).groupby([scores[name] for name in pair], sort=False).sum()
    scene = scores.groupby(pair, sort=False)["scene"].first()
    return exact.assign(perturbed_iou=perturbed, failed=failed, scene=scene).reset_index()


def _scenes(pairs: pd.DataFrame) -> dict[str, str]:
    """Scene of each sequence."""
    return dict(zip(pairs["sequence"], pairs["scene"], strict=True))


def common_pairs(pairs: pd.DataFrame) -> pd.DataFrame:
    """Rows of the sequences that all trackers have run; all rows where there are no such sequences."""
    runners = pairs.groupby("sequence")["tracker"].nunique()
    common = pairs[pairs["sequence"].isin(runners.index[runners == pairs["tracker"].nunique()])]
    return pairs if common.empty else common


def _weighted_mean(values: FloatArray, weights: FloatArray) -> float:
    known = np.isfinite(values) & (weights > 0)
    return float(np.average(values[known], weights=weights[known])) if known.any() else float("nan")


def _weights(rows: pd.DataFrame, metric: str) -> FloatArray:
    column = METRICS[metric].weight if metric in METRICS else ""
    return rows[column].to_numpy(float) if column else np.ones(len(rows))


def overall(pairs: pd.DataFrame) -> pd.DataFrame:
    """Means over sequences, one row per tracker, the best mean IoU first.

    Each sequence counts once, except that rates of `ok` and the columns of GOT-10k count each frame once. `low` and
    `high` bound the mean IoU, `q05` is the mean IoU that only :data:`LOW_QUANTILE` of the sequences fall below.
    Ranks are by the sequences that all trackers have run; where there are none, by what each has run.
    """
    rows = []
    pairs = common_pairs(pairs)
    for tracker, group in pairs.groupby("tracker", sort=False):
        row: dict[str, object] = {"tracker": tracker, "sequences": len(group), "failed": int(group["failed"].sum())}
        for metric in (*METRICS, "perturbed_iou"):
            row[metric] = _weighted_mean(group[metric].to_numpy(float), _weights(group, metric))
        values = group["mean_iou"].dropna().to_numpy(float)
        # No mean of shares lies outside of 0 to 1, wherever the formula's ends are.
        bounds = mean_interval(group["mean_iou"].to_numpy(float), group["scene"].tolist())
        row["low"], row["high"] = np.clip(bounds, 0.0, 1.0)
        row["scenes"] = group.loc[group["mean_iou"].notna(), "scene"].nunique()
        row["q05"] = float(np.quantile(values, LOW_QUANTILE)) if values.size else float("nan")
        rows.append(row)
    columns = ["tracker", "sequences", "scenes", "failed", *METRICS, "perturbed_iou", "low", "high", "q05"]
    table = pd.DataFrame(rows, columns=columns)
    return table.sort_values("mean_iou", ascending=False, kind="stable", ignore_index=True)


def differences(
    pairs: pd.DataFrame, tracker: str, metric: str = "mean_iou", *, together: bool = True
) -> pd.DataFrame:
    """Compare one tracker with each other one on the sequences that both have run; the oracle is no rival.

    Parameters
    ----------
    pairs : DataFrame
    tracker, metric : str
    together : bool, optional
        Intervals so wide that with all trackers equal one table in twenty shows any difference; else each is one to
        be asked about alone.

    Returns
    -------
    DataFrame
        One row per other tracker: mean difference (positive: `tracker` is better by that), its interval `low` to
        `high`, `p` of a test that flips the signs of scenes, corrected for the number of rows (Holm) where they are
        to be right `together`, number of `scenes`, sequences won (by more than 0.02), lost and even, and the worst
        loss with its sequence.
    """
    scenes = _scenes(pairs)
    wide = pairs.pivot(index="sequence", columns="tracker", values=metric)
    rows = []
    others = wide.columns.drop([tracker, ORACLE], errors="ignore")
    for other in others:
        gap = (wide[tracker] - wide[other]).dropna()
        if gap.empty:
            continue
        values, places = gap.to_numpy(float), [scenes[str(name)] for name in gap.index]
        # No difference of shares lies outside of −1 to 1, wherever the formula's ends are.
        bounds = mean_interval(values, places, comparisons=len(others) if together else 1)
        low, high = np.clip(bounds, -1.0, 1.0)
        test = {"p": sign_flip_p(values, places), "scenes": len(set(places))}
        won, lost = int((gap > 0.02).sum()), int((gap < -0.02).sum())
        worst = {"worst": float(gap.min()), "worst_sequence": str(gap.idxmin())}
        counts = {"won": won, "lost": lost, "even": len(gap) - won - lost}
        rows.append(
            {"other": other, "difference": float(gap.mean()), "low": low, "high": high, **test, **counts, **worst}
        )
    columns = ["other", "difference", "low", "high", "p", "scenes", "won", "lost", "even", "worst", "worst_sequence"]
    table = pd.DataFrame(rows, columns=columns)
    if together:
        table["p"] = holm(table["p"].to_numpy(float))
    return table.sort_values("difference", kind="stable", ignore_index=True)


def mean_ranks(pairs: pd.DataFrame, metric: str = "mean_iou") -> tuple[pd.DataFrame, float]:
    """Rank the trackers in each scene that all have run, and say which mean ranks differ by more than chance.

    Demšar's procedure: ranks by the means over the sequences of a scene (1 is the best, equal ones share theirs),
    and Nemenyi's critical difference for all pairs at once. The oracle does not compete.

    Returns
    -------
    table : DataFrame
        One row per tracker, the best first: `tracker`, `rank`, number of `scenes`, and `like`, the others whose rank
        is within the critical difference, in words.
    critical : float
        That difference; NaN where there are too few trackers or scenes for one.
    """
    known = common_pairs(pairs[pairs["tracker"] != ORACLE].dropna(subset=[metric]))
    wide = known.pivot_table(index="scene", columns="tracker", values=metric, sort=False).dropna()
    ranks = wide.rank(axis="columns", ascending=False).mean().sort_values(kind="stable")
    critical = critical_difference(len(ranks), len(wide))
    places = {str(name): float(rank) for name, rank in ranks.items()}
    like = [
        ", ".join(name for name, other in places.items() if name != own and not abs(other - rank) >= critical)
        for own, rank in places.items()
    ]
    table = pd.DataFrame({"tracker": ranks.index, "rank": ranks.to_numpy(float), "scenes": len(wide), "like": like})
    return table, critical


def per_attribute(pairs: pd.DataFrame, sequences: Iterable[Sequence], metric: str = "mean_iou") -> pd.DataFrame:
    """Mean of a metric over the sequences that carry each attribute.

    Returns
    -------
    DataFrame
        One row per attribute, with the number of `sequences` and one column per tracker.
    """
    carried = pd.DataFrame(
        [(sequence.name, attribute) for sequence in sequences for attribute in sequence.attributes],
        columns=["sequence", "attribute"],
    )
    joined = carried.merge(pairs, on="sequence")
    if joined.empty:
        return pd.DataFrame(columns=["attribute", "sequences"])
    wide = joined.pivot_table(index="attribute", columns="tracker", values=metric, sort=False)
    wide = wide[[name for name in pairs["tracker"].unique() if name in wide.columns]]
    wide.insert(0, "sequences", joined.groupby("attribute")["sequence"].nunique())
    wide.columns.name = None
    return wide.sort_values("sequences", ascending=False, kind="stable").reset_index()


def per_theme(pairs: pd.DataFrame, sequences: Iterable[Sequence], chosen: str) -> pd.DataFrame:
    """Compare the themes of a distribution suite.

    Returns
    -------
    DataFrame
        One row per theme, the one that the chosen tracker finds hardest first: number of `sequences`, mean IoU of
        each tracker, and of the chosen one the `least` mean IoU of a sequence and the rates of `ok`. No row where no
        sequence has a theme.
    """
    themes = {sequence.name: sequence.theme for sequence in sequences if sequence.theme}
    known = pairs.assign(theme=pairs["sequence"].map(themes)).dropna(subset=["theme"])
    rates = ("false_true", "false_false", "true_off")
    rows = []
    for theme, group in known.groupby("theme", sort=False):
        own = group[group["tracker"] == chosen]
        means = group.groupby("tracker", sort=False)["mean_iou"].mean().to_dict()
        row = {"theme": theme, "sequences": group["sequence"].nunique(), **means, "least": own["mean_iou"].min()}
        rows.append(row | {rate: _weighted_mean(own[rate].to_numpy(float), _weights(own, rate)) for rate in rates})
    columns = ["theme", "sequences", *pairs["tracker"].unique(), "least", *rates]
    table = pd.DataFrame(rows, columns=columns)
    return table.sort_values(chosen, kind="stable", ignore_index=True) if chosen in table else table


def worst_sequences(pairs: pd.DataFrame, sequences: Iterable[Sequence], chosen: str, count: int = 10) -> pd.DataFrame:
    """Find the sequences of a distribution suite on which the chosen tracker is worst.

    Returns
    -------
    DataFrame
        One row per sequence, the worst first: `sequence`, `mean_iou`, `best_other` (mean IoU of the best of the other
        trackers) and one column per parameter of these draws, NaN where it does not apply.
    """
    drawn = {sequence.name: sequence for sequence in sequences if sequence.theme}
    wide = pairs[pairs["sequence"].isin(drawn)].pivot(index="sequence", columns="tracker", values="mean_iou")
    if chosen not in wide:
        return pd.DataFrame(columns=["sequence", "mean_iou", "best_other"])
    others = wide.drop(columns=[name for name in (chosen, ORACLE) if name in wide]).max(axis=1)
    worst = wide[chosen].dropna().nsmallest(count)
    table = pd.DataFrame({"mean_iou": worst, "best_other": others.reindex(worst.index)}).rename_axis("sequence")
    parameters = pd.DataFrame([drawn[str(name)].parameters for name in worst.index], index=worst.index)
    return table.join(parameters).reset_index()


def curves(scored: Iterable[ScoredRun]) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Success and precision curve of each tracker from the exact start: mean over sequences, each counting once."""
    found: dict[str, dict[str, list[tuple[FloatArray, FloatArray]]]] = {}
    for item in scored:
        seen = item.frames.visible
        if item.run.start == 0 and seen.any():
            pair = success_curve(item.frames.iou[seen]), precision_curve(item.frames.distance[seen])
            found.setdefault(item.run.tracker, {}).setdefault(item.run.sequence, []).append(pair)
    return {
        tracker: (
            np.mean([np.mean([success for success, _ in pairs], axis=0) for pairs in by_sequence.values()], axis=0),
            np.mean(
                [np.mean([precision for _, precision in pairs], axis=0) for pairs in by_sequence.values()], axis=0
            ),
        )
        for tracker, by_sequence in found.items()
    }


def calibration(scored: Iterable[ScoredRun]) -> dict[str, pd.DataFrame]:
    """How far a tracker's score can be believed.

    Returns
    -------
    dict of str to DataFrame
        For each tracker that gives a score: one row per tenth of it, with the mean `score`, the share of frames with
        the target really `located` (visible and IoU ≥ 0.5), its interval `low` to `high` between scenes, and the
        number of `frames`.
    """
    return {tracker: _reliability(values) for tracker, values in _believed(scored).items()}


def score_quality(scored: Iterable[ScoredRun]) -> pd.DataFrame:
    """How wrong a tracker's score is, in two numbers.

    Returns
    -------
    DataFrame
        Indexed by the trackers that give a score: `ece`, the expected calibration error, and `sure_wrong`, the share
        of frames with a score of at least :data:`SURE` whose target is not located.
    """
    rows = {}
    for tracker, values in _believed(scored).items():
        wrong = (values["score"] >= SURE) & (values["located"] == 0)
        error = calibration_error(_reliability(values))
        rows[tracker] = {"ece": error, "sure_wrong": float(wrong.mean())}
    return pd.DataFrame.from_dict(rows, orient="index", columns=["ece", "sure_wrong"])


def calibration_error(table: pd.DataFrame) -> float:
    """Expected calibration error of a table of :func:`calibration`.

    Mean over the frames of the distance between the mean score of their tenth and the share located in it.
    """
    gaps = (table["score"] - table["located"]).abs()
    return float(np.average(gaps, weights=table["frames"]))


def _believed(scored: Iterable[ScoredRun]) -> dict[str, pd.DataFrame]:
    """Of each tracker with a score, every judged frame: `scene`, `score` and whether the target is `located`."""
    gathered: dict[str, list[pd.DataFrame]] = {}
    for item in scored:
        score = item.run.trajectory.score[1:]
        judged = np.isfinite(score) & (item.frames.visible | item.frames.invisible)
        if judged.any():
            located = np.where(item.frames.visible, np.nan_to_num(item.frames.iou) >= 0.5, False)
            columns = {
                "scene": item.sequence.scene,
                "score": score[judged],
                "located": located[judged].astype(float),
            }
            gathered.setdefault(item.run.tracker, []).append(pd.DataFrame(columns))
    return {tracker: pd.concat(parts, ignore_index=True) for tracker, parts in gathered.items()}


def _reliability(values: pd.DataFrame) -> pd.DataFrame:
    tenth = np.clip((values["score"] * 10).astype(int), 0, 9)
    rows = []
    for _, part in values.groupby(tenth):
        by_scene = part.groupby("scene")["located"].agg(["sum", "size"])
        low, high = share_interval(by_scene["sum"].to_numpy(float), by_scene["size"].to_numpy(float))
        means = {"score": part["score"].mean(), "located": part["located"].mean()}
        rows.append({**means, "low": low, "high": high, "frames": len(part)})
    return pd.DataFrame(rows, columns=["score", "located", "low", "high", "frames"])


def score_before_loss(scored: Iterable[ScoredRun], *, before: int = 20, after: int = 10) -> dict[str, FloatArray]:
    """Score of a tracker round the moment at which the target is lost: IoU under 0.1 or nothing left to see.

    Returns
    -------
    dict of str to ndarray, shape (L, before + after + 1)
        One row per run, round its first loss, for frames −`before` … `after`, NaN where there is no score; only for
        trackers that give a score and lose.
    """
    gathered: dict[str, list[FloatArray]] = {}
    for item in scored:
        score = item.run.trajectory.score[1:]
        gone = item.frames.invisible | (np.nan_to_num(item.frames.iou, nan=1.0) < 0.1)
        if not gone.any() or not np.isfinite(score).any():
            continue
        frame = int(np.argmax(gone))
        padded = np.concatenate([np.full(before, np.nan), score, np.full(after + 1, np.nan)])
        gathered.setdefault(item.run.tracker, []).append(padded[frame : frame + before + after + 1])
    return {tracker: np.stack(rows) for tracker, rows in gathered.items()}


def median_known(rows: FloatArray) -> FloatArray:
    """Median of each column over what is known of it; NaN where nothing is."""
    known = np.isfinite(rows)
    columns = [
        np.median(column[seen]) if seen.any() else np.nan for column, seen in zip(rows.T, known.T, strict=True)
    ]
    return np.array(columns)


def speed_table(runs: Iterable[SpeedRun], scenes: Mapping[str, str] = MappingProxyType({})) -> pd.DataFrame:
    """Time of one update per (tracker, sequence), ms.

    Parameters
    ----------
    runs : iterable of SpeedRun
    scenes : mapping of str to str, optional
        Scenes of the sequences that share theirs.

    Returns
    -------
    DataFrame
        `scene`, `median` and `p95` of the processor time, `wall`, the median of the time that passed, and the number
        of timed `updates`.
    """
    rows = [
        {
            "tracker": tracker,
            "sequence": run.sequence,
            "scene": scenes.get(run.sequence, run.sequence),
            "median": float(np.median(times)),
            "p95": float(np.percentile(times, 95)),
            "wall": float(np.median(run.wall[tracker])),
            "updates": len(times),
        }
        for run in runs
        for tracker, times in run.milliseconds.items()
        if times
    ]
    return pd.DataFrame(rows, columns=["tracker", "sequence", "scene", "median", "p95", "wall", "updates"])
