"""Intervals: they cover what they say, in simulations whose truth is known."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import NDArray

from eval.intervals import (
    BCA_FROM,
    critical_difference,
    holm,
    jackknife_interval,
    mean_interval,
    median_interval,
    share_interval,
    sign_flip_p,
)

pytestmark = pytest.mark.once

Draw = Callable[[np.random.Generator, int], np.ndarray]


def normal(rng: np.random.Generator, n: int) -> np.ndarray:
    """Scores that spread alike to both sides."""
    return rng.normal(0.6, 0.2, n)


def skewed(rng: np.random.Generator, n: int) -> np.ndarray:
    """Scores that are good nearly always."""
    return rng.beta(5.0, 1.2, n)


def failing(rng: np.random.Generator, n: int) -> np.ndarray:
    """Scores that are good or nothing."""
    return rng.beta(8.0, 2.0, n) * (rng.random(n) > 0.2)


MEANS = {normal: 0.6, skewed: 5.0 / 6.2, failing: 0.8 * 0.8}
MEDIANS = {normal: 0.6}


@pytest.mark.parametrize("draw", MEANS)
@pytest.mark.parametrize(("count", "least"), [(2, 0.82), (10, 0.86), (20, 0.90), (BCA_FROM + 2, 0.92)])
def test_intervals_of_the_mean_cover_it(count: int, least: float, draw: Draw) -> None:
    """At few values as at many, far more often than the percentile bootstrap (.49 for two values, .8 for ten)."""
    rng = np.random.default_rng(7)
    runs = 600 if count < BCA_FROM else 150
    bounds = [mean_interval(draw(rng, count)) for _ in range(runs)]
    assert np.mean([low <= MEANS[draw] <= high for low, high in bounds]) >= least


def test_intervals_of_the_mean_become_narrow() -> None:
    """Otherwise they would cover for nothing."""
    rng = np.random.default_rng(7)
    widths = [np.diff(mean_interval(normal(rng, count)))[0] for count in (5, 20, 80, 320)]
    assert all(one > 1.3 * other for one, other in pairwise(widths))


def test_ten_equal_rivals_show_no_difference() -> None:
    """At least one of ten intervals is wrong in about 5 % of experiments, and in far more without the correction."""
    rng = np.random.default_rng(3)
    wrong = {1: 0, 10: 0}
    for _ in range(300):
        own, rivals = rng.normal(0.6, 0.2, 15), rng.normal(0.6, 0.2, (10, 15))
        for comparisons in wrong:
            bounds = [mean_interval(own - rival, comparisons=comparisons) for rival in rivals]
            wrong[comparisons] += any(low > 0 or high < 0 for low, high in bounds)
    assert wrong[10] / 300 < 0.08
    assert wrong[1] / 300 > 0.2


@pytest.mark.parametrize("count", [6, 7, 10, 31])
def test_intervals_of_the_median_cover_it(count: int) -> None:
    """Whatever the values are drawn from; they are two of the values."""
    rng = np.random.default_rng(11)
    for draw, truth in ((normal, 0.6), (lambda rng, n: rng.lognormal(0.0, 1.5, n), 1.0)):
        bounds = [median_interval(draw(rng, count)) for _ in range(1500)]
        assert np.mean([low <= truth <= high for low, high in bounds]) >= 0.94
    values = rng.permutation(np.arange(1.0, count + 1))
    assert set(median_interval(values)) <= set(values)


@pytest.mark.parametrize(("sequences", "least"), [(8, 0.8), (25, 0.9)])
@pytest.mark.parametrize("share", [0.2, 0.9])
def test_intervals_of_a_share_cover_it_when_frames_are_alike(sequences: int, least: float, share: float) -> None:
    """Frames of one sequence are located together or not at all: Wilson's formula on frames covers a quarter."""
    rng = np.random.default_rng(5)
    covered, by_frames = [], []
    for _ in range(800):
        counts = rng.integers(20, 200, sequences).astype(float)
        hits = counts * rng.beta(2.0 * share, 2.0 * (1.0 - share), sequences)
        low, high = share_interval(hits, counts)
        covered.append(low <= share <= high)
        p, half = hits.sum() / counts.sum(), 1.96 * np.sqrt(share * (1 - share) / counts.sum())
        by_frames.append(p - half <= share <= p + half)
    assert np.mean(covered) >= least
    assert np.mean(by_frames) < 0.5


@pytest.mark.parametrize(
    ("sizes", "least"),
    [([6, 1, 1, 1, 1, 1], 0.94), ([6, 6, 6, 2, *[1] * 6], 0.92), ([3] * 10, 0.90), ([3] * (BCA_FROM + 2), 0.90)],
)
@pytest.mark.parametrize("draw", MEANS)
def test_intervals_cover_when_sequences_of_a_scene_are_alike(sizes: list[int], least: float, draw: Draw) -> None:
    """Scenes are resampled as wholes: sequence by sequence, six of one camera would count as six proofs."""
    rng = np.random.default_rng(13)
    scenes = np.repeat([f"scene {number}" for number in range(len(sizes))], sizes).tolist()
    covered, by_sequences = [], []
    for _ in range(400 if len(sizes) < BCA_FROM else 120):
        values = np.repeat(draw(rng, len(sizes)), sizes)
        low, high = mean_interval(values, scenes)
        covered.append(low <= MEANS[draw] <= high)
        low, high = mean_interval(values)
        by_sequences.append(low <= MEANS[draw] <= high)
    assert np.mean(covered) >= (least if draw is not failing else least - 0.06)
    assert np.mean(by_sequences) < 0.8


def test_scenes_of_one_sequence_each_change_nothing() -> None:
    """And of two scenes all that is left are two values."""
    values = np.random.default_rng(2).normal(0.6, 0.2, 12)
    for count in (12, 2):
        scenes = [str(number % count) for number in range(12)]
        means = np.array([values[number::count].mean() for number in range(count)])
        assert mean_interval(values, scenes) == pytest.approx(mean_interval(means))
    with pytest.raises(ValueError, match="expected a scene for each of 12 values, got 3"):
        mean_interval(values, ["a", "b", "c"])


def test_sign_flips_are_right_about_chance() -> None:
    """P is below .05 in about 5 % of experiments without a difference, whether sequences of a scene agree or not."""
    rng = np.random.default_rng(17)
    scenes = np.repeat([str(number) for number in range(9)], 3).tolist()
    found = [sign_flip_p(np.repeat(rng.normal(0.0, 0.1, 9), 3), scenes) for _ in range(300)]
    assert 0.01 < np.mean(np.array(found) <= 0.05) < 0.09
    # Of six scenes that all say the same, two of 64 ways are as far from zero.
    assert sign_flip_p(np.full(6, 0.1)) == pytest.approx(2 / 64)
    assert sign_flip_p(np.full(18, 0.1), [str(number % 6) for number in range(18)]) == pytest.approx(2 / 64)
    assert sign_flip_p(np.zeros(5)) == sign_flip_p(np.array([0.3])) == 1.0
    assert np.isnan(sign_flip_p(np.array([np.nan])))


def test_holm_is_the_published_procedure() -> None:
    """By hand: the least of four times 4, the next times 3, and never below the one before; NaN is no comparison."""
    corrected = holm(np.array([0.01, 0.04, 0.03, np.nan, 0.005, 0.9]))
    np.testing.assert_allclose(corrected, [0.04, 0.09, 0.09, np.nan, 0.025, 0.9])


def test_the_critical_difference_is_the_published_one() -> None:
    """Demšar 2006, table 5: q.05 is 1.960 for two, 2.728 for five and 3.164 for ten."""
    for trackers, quantile in ((2, 1.960), (5, 2.728), (10, 3.164)):
        expected = quantile * np.sqrt(trackers * (trackers + 1) / (6 * 14))
        assert critical_difference(trackers, 14) == pytest.approx(expected, abs=1e-3)
    assert np.isnan(critical_difference(1, 14))


def test_equal_trackers_are_rarely_told_apart_and_in_two_scenes_never() -> None:
    """Three rivals in two scenes cannot be, whatever they do; in more they are by chance in one table of twenty."""
    assert np.isnan(critical_difference(3, 2))
    assert np.isnan(critical_difference(11, 0))
    rng = np.random.default_rng(0)
    for trackers, scenes in ((3, 3), (5, 4), (11, 6), (12, 20)):
        ranks = rng.random((4000, scenes, trackers)).argsort(axis=2).mean(axis=1)
        critical = critical_difference(trackers, scenes)
        assert critical <= trackers - 1
        assert np.mean(np.ptp(ranks, axis=1) >= critical) < 0.06


def test_what_is_no_mean_has_an_interval_that_covers() -> None:
    """F of mean precision and recall, of ten sequences of which one in five fails; of a mean it is Student's t."""
    rng = np.random.default_rng(1)

    def draw(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        fine = rng.random(count) > 0.2
        precision = np.where(fine, rng.beta(12, 3, count), rng.beta(2, 4, count))
        return precision, precision * rng.uniform(0.4, 1.0, count)

    def f(precision: NDArray[np.float64], recall: NDArray[np.float64]) -> float:
        return float(2 * precision.mean() * recall.mean() / (precision.mean() + recall.mean()))

    true, own = f(*draw(400_000)), [str(number) for number in range(10)]
    covered = 0
    for _ in range(300):
        precision, recall = draw(10)
        low, high = jackknife_interval(lambda i, p=precision, r=recall: f(p[i], r[i]), own)  # type: ignore[misc]
        covered += low <= true <= high
    assert 0.88 < covered / 300 < 0.99
    found = jackknife_interval(lambda index: float(precision[index].mean()), own)
    assert found == pytest.approx(mean_interval(precision))
    assert np.isnan(jackknife_interval(lambda index: 0.5, ["camera"] * 10)).all()


def test_what_cannot_be_known_is_nan() -> None:
    """One value has no interval, five have none of the median; equal ones have a point, and NaN are left out."""
    assert np.isnan(mean_interval(np.array([0.5, np.nan]))).all()
    assert np.isnan(median_interval(np.arange(5.0))).all()
    assert np.isnan(median_interval(np.array([]))).all()
    assert np.isnan(share_interval(np.array([3.0]), np.array([4.0]))).all()
    assert mean_interval(np.full(40, 0.25)) == (0.25, 0.25)
    assert mean_interval(np.array([0.2, 0.4, np.nan])) == mean_interval(np.array([0.2, 0.4]))


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_a_share_of_nothing_or_all_is_not_certain(share: float) -> None:
    """Four sequences without a hit do not prove that there is none."""
    low, high = share_interval(np.full(4, 50.0) * share, np.full(4, 50.0))
    assert (low, high) == ((0.0, pytest.approx(high)) if share == 0 else (pytest.approx(low), 1.0))
    assert high - low > 0.3
