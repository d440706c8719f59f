"""Intervals whose coverage was simulated (``tests/test_eval_intervals.py``), from few and skewed values; tests.

What is independent is a scene: sequences that one camera has taken are no independent evidence.

A percentile bootstrap of ten values covers 76 to 91 % instead of 95 %, and of two values half of that. Student's t
covers more, and from about thirty values on BCa does on skewed ones (a tracker that fails on one sequence in seven).
No interval knows of a failure that none of its values shows.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy import stats

__all__ = [
    "COVERAGE", "critical_difference", "holm", "jackknife_interval", "mean_interval", "median_interval", "scene_sums",
    "share_interval", "sign_flip_p",
]  # fmt: skip

FloatArray = NDArray[np.float64]
Scenes = Sequence[str]

COVERAGE = 0.95
"""Of every interval given."""

BCA_FROM = 30
"""Scenes from which on the mean's interval is a bias-corrected and accelerated bootstrap."""

_RESAMPLES = 5000
_SEED = 20240501
_UNKNOWN = float("nan"), float("nan")


def mean_interval(values: FloatArray, scenes: Scenes | None = None, *, comparisons: int = 1) -> tuple[float, float]:
    """Interval of the mean that values (one per sequence) of independent scenes are drawn round.

    Parameters
    ----------
    values : ndarray, shape (n,)
        NaN are left out.
    scenes : sequence of str, length n, optional
        What each value belongs to; values of one scene may be as alike as they like. By default each is its own.
    comparisons : int, optional
        Number of intervals among which none is to be wrong, at :data:`COVERAGE` (Bonferroni's correction).

    Returns
    -------
    (float, float)
        NaN for fewer than two scenes.
    """
    known = _known(values)
    sums, counts = scene_sums(values, scenes)
    if sums.size < 2:
        return _UNKNOWN
    if np.ptp(known) == 0:
        return float(known[0]), float(known[0])
    level = 1.0 - (1.0 - COVERAGE) / comparisons
    if sums.size < BCA_FROM:
        middle = known.mean()
        spread = np.sqrt(sums.size / (sums.size - 1) * ((sums - counts * middle) ** 2).sum()) / known.size
        # Scenes of many sequences decide about the spread: it is known from fewer than there are.
        freedom = max((counts**2).sum() ** 2 / (counts**4).sum() - 1.0, 1.0)
        half = stats.t.ppf(0.5 + level / 2.0, freedom) * spread
        return float(middle - half), float(middle + half)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", stats.DegenerateDataWarning)
        found = stats.bootstrap(
            (sums, counts),
            lambda part, count, axis: part.sum(axis=axis) / count.sum(axis=axis),
            paired=True,
            batch=500,
            confidence_level=level,
            n_resamples=_RESAMPLES,
            random_state=np.random.default_rng(_SEED),
        )
    return float(found.confidence_interval.low), float(found.confidence_interval.high)


def jackknife_interval(statistic: Callable[[NDArray[np.intp]], float], scenes: Scenes) -> tuple[float, float]:
    """Interval of a number that is no mean of values: by what it would be without each scene, and Student's t.

    Parameters
    ----------
    statistic : callable
        The number, of the sequences of these indices.
    scenes : sequence of str
        What each sequence belongs to.

    Returns
    -------
    (float, float)
        NaN for fewer than two scenes, or where it is not known without one of them.
    """
    names, index = np.unique(np.asarray(scenes, dtype=str), return_inverse=True)
    number = names.size
    if number < 2:
        return _UNKNOWN
    whole = statistic(np.arange(len(scenes)))
    without = np.array([statistic(np.flatnonzero(index != scene)) for scene in range(number)])
    # What each scene says, were the number a mean: whole × n less the rest × (n − 1).
    spread = (number - 1) * without.std(ddof=1) / np.sqrt(number)
    half = stats.t.ppf(0.5 + COVERAGE / 2.0, number - 1) * spread
    return float(whole - half), float(whole + half)


def median_interval(values: FloatArray) -> tuple[float, float]:
    """Interval of the median that independent values are drawn round: two of the values, however they are spread.

    Parameters
    ----------
    values : ndarray, shape (n,)
        NaN are left out.

    Returns
    -------
    (float, float)
        Covers at least :data:`COVERAGE`; NaN for fewer than six values, for which there is none.
    """
    known = np.sort(_known(values))
    # The number of values below the median is binomial.
    rank = int(stats.binom.ppf((1.0 - COVERAGE) / 2.0, known.size, 0.5)) if known.size else 0
    if rank < 1:
        return _UNKNOWN
    return float(known[rank - 1]), float(known[-rank])


def share_interval(hits: FloatArray, counts: FloatArray) -> tuple[float, float]:
    """Interval of a share of frames, when it is the scenes that are independent and not their frames.

    Wilson's formula for as many frames as would tell as much if they were independent: the spread between scenes
    says how many that are.

    Parameters
    ----------
    hits, counts : ndarray, shape (n,)
        Frames that count, and frames, of each scene.

    Returns
    -------
    (float, float)
        In [0, 1]; NaN for fewer than two scenes with frames.
    """
    seen = np.asarray(counts, dtype=np.float64) > 0
    hits, counts = np.asarray(hits, dtype=np.float64)[seen], np.asarray(counts, dtype=np.float64)[seen]
    number, total = counts.size, counts.sum()
    if number < 2:
        return _UNKNOWN
    share = hits.sum() / total
    variance = number / (number - 1) * ((hits - share * counts) ** 2).sum() / total**2
    alike = variance <= 0  # all scenes alike, as when all shares are 0 or 1: each tells as much as one frame
    size = float(number) if alike else min(max(share * (1.0 - share) / variance, 1.0), total)
    z = stats.t.ppf(0.5 + COVERAGE / 2.0, number - 1)
    middle = (share + z**2 / (2 * size)) / (1 + z**2 / size)
    half = z * np.sqrt(share * (1 - share) / size + (z / (2 * size)) ** 2) / (1 + z**2 / size)
    return max(float(middle - half), 0.0), min(float(middle + half), 1.0)


def sign_flip_p(values: FloatArray, scenes: Scenes | None = None) -> float:
    """How often paired differences would lie so far from zero on the mean, if their signs were a matter of chance.

    Scenes keep or change their sign as wholes (Fisher's randomisation): all ways of up to 13 scenes, else 9,999.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Differences, one per sequence; NaN are left out.
    scenes : sequence of str, length n, optional
        As for :func:`mean_interval`.

    Returns
    -------
    float
        NaN without a value.
    """
    sums, _ = scene_sums(values, scenes)
    if not sums.size:
        return float("nan")
    if sums.size == 1 or not sums.any():
        return 1.0
    found = stats.permutation_test(
        (sums,), np.sum, permutation_type="samples", n_resamples=9999, batch=500, vectorized=True,
        random_state=np.random.default_rng(_SEED),
    )  # fmt: skip
    return float(found.pvalue)


def holm(p_values: FloatArray) -> FloatArray:
    """P-values of several comparisons, corrected for their number (Holm 1979): none is wrong at the level kept.

    Parameters
    ----------
    p_values : ndarray, shape (n,)
        NaN are no comparisons.
    """
    values = np.asarray(p_values, dtype=np.float64)
    order = np.argsort(values)[: np.isfinite(values).sum()]
    corrected = np.full_like(values, np.nan)
    corrected[order] = np.minimum(np.maximum.accumulate(values[order] * np.arange(order.size, 0, -1)), 1.0)
    return corrected


def critical_difference(trackers: int, scenes: int) -> float:
    """Least difference between two mean ranks that is none of chance, whichever two they are (Nemenyi's test).

    NaN for fewer than two trackers, and of so few scenes that not even trackers which are the first and the last in
    each of them could be told apart. From there on the test keeps what it promises (simulated), as a weak one.
    """
    if trackers < 2 or scenes < 1:
        return float("nan")
    quantile = stats.studentized_range.ppf(COVERAGE, trackers, np.inf) / np.sqrt(2.0)
    found = float(quantile * np.sqrt(trackers * (trackers + 1) / (6.0 * scenes)))
    return found if found <= trackers - 1 else float("nan")


def scene_sums(values: FloatArray, scenes: Scenes | None) -> tuple[FloatArray, FloatArray]:
    """Sum and number of the values that are known, of each scene."""
    found = np.asarray(values, dtype=np.float64)
    seen = np.isfinite(found)
    if scenes is None:
        return found[seen], np.ones(int(seen.sum()))
    if len(scenes) != found.size:
        raise ValueError(f"expected a scene for each of {found.size} values, got {len(scenes)}")
    names, index = np.unique(np.asarray(scenes, dtype=str)[seen], return_inverse=True)
    return (
        np.bincount(index, found[seen], minlength=names.size).astype(np.float64),
        np.bincount(index, minlength=names.size).astype(np.float64),
    )


def _known(values: FloatArray) -> FloatArray:
    known = np.asarray(values, dtype=np.float64)
    return known[np.isfinite(known)]
