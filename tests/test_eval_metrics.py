"""Metrics: closed forms, a slow independent oracle, invariants."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from numpy.typing import NDArray

from eval.metrics import (
    COUNTS,
    METRICS,
    clip_boxes,
    frame_scores,
    iou_per_frame,
    precision_curve,
    success_curve,
    summarise,
)

pytestmark = pytest.mark.once

SIZE = (64, 48)
WHOLE = st.integers(-10, 70)
SIDE = st.integers(1, 40)
BOX = st.tuples(WHOLE, WHOLE, SIDE, SIDE)


def boxes_of(*rows: tuple[float, ...]) -> NDArray[np.float64]:
    """Boxes (T, 4)."""
    return np.array(rows, dtype=np.float64)


def rasterised_iou(a: tuple[int, ...], b: tuple[int, ...]) -> float:
    """Count pixels: slow, and right by looking at it."""
    masks = []
    for x, y, w, h in (a, b):
        mask = np.zeros((SIZE[1], SIZE[0]), dtype=bool)
        mask[max(y, 0) : max(y + h, 0), max(x, 0) : max(x + w, 0)] = True
        masks.append(mask)
    union = np.logical_or(*masks).sum()
    return float(np.logical_and(*masks).sum() / union) if union else 0.0


@given(BOX, BOX)
def test_iou_equals_counted_pixels(a: tuple[int, ...], b: tuple[int, ...]) -> None:
    """On whole pixels the IoU is the one that counting gives, clipped to the frame."""
    assert iou_per_frame(boxes_of(a), boxes_of(b), SIZE)[0] == pytest.approx(rasterised_iou(a, b), abs=1e-12)


@given(BOX, BOX, st.floats(0.25, 4.0))
def test_iou_is_symmetric_bounded_and_scale_free(a: tuple[int, ...], b: tuple[int, ...], factor: float) -> None:
    """IoU does not care which box is which, nor about the unit of length, and lies in [0, 1]."""
    first, second = boxes_of(a), boxes_of(b)
    found = iou_per_frame(first, second, SIZE)
    assert 0.0 <= found[0] <= 1.0
    assert_array_equal(found, iou_per_frame(second, first, SIZE))
    scaled = (round(SIZE[0] * factor * 64) / 64, round(SIZE[1] * factor * 64) / 64)
    if scaled == (SIZE[0] * factor, SIZE[1] * factor):
        assert_allclose(iou_per_frame(first * factor, second * factor, scaled), found, atol=1e-9)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("estimated", "expected"),
    [((0, 0, 2, 2), 1.0), ((1, 0, 2, 2), 1 / 3), ((2, 0, 2, 2), 0.0), ((0, 0, 4, 4), 0.25), ((-2, -2, 4, 4), 1.0)],
)
def test_iou_by_hand(estimated: tuple[float, ...], expected: float) -> None:
    """Five cases worked out on paper; the last one is clipped to the frame."""
    assert iou_per_frame(boxes_of((0, 0, 2, 2)), boxes_of(estimated), SIZE)[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    "bad", [(np.nan, 0, 2, 2), (0, np.inf, 2, 2), (0, 0, -2, 2), (0, 0, 0, 0), (1e300, 0, 1e300, 1)]
)
def test_boxes_that_are_none_have_no_area(bad: tuple[float, ...]) -> None:
    """A box that is NaN, infinite, negative or empty overlaps nothing and breaks nothing."""
    assert iou_per_frame(boxes_of((0, 0, 4, 4)), boxes_of(bad), SIZE)[0] == 0.0


def test_clipping_shrinks_and_never_moves() -> None:
    """Edges outside the frame come to its border, the others stay."""
    assert_array_equal(clip_boxes(boxes_of((-5, 10, 20, 100)), SIZE), [[0, 10, 15, 48]])


def scores_of(
    reference: NDArray[np.float64],
    estimated: NDArray[np.float64],
    *,
    visibility: list[float] | None = None,
    ok: list[bool] | None = None,
) -> dict[str, float]:
    """Summary of a trajectory; all visible and all ok unless said otherwise."""
    count = len(reference)
    seen = np.ones(count) if visibility is None else np.array(visibility)
    found = np.ones(count, dtype=bool) if ok is None else np.array(ok)
    return summarise(frame_scores(reference, seen, estimated, found, SIZE))


def walk(count: int, step: float) -> NDArray[np.float64]:
    """A 20 × 10 box that moves right by `step` px per frame."""
    return np.stack(
        [5 + step * np.arange(count), np.full(count, 8.0), np.full(count, 20.0), np.full(count, 10.0)], axis=1
    )


def test_the_truth_scores_exactly_one() -> None:
    """A perfect tracker gets 1.0 and not 0.952, in every metric, also where the object is cut by the border."""
    reference = walk(30, 2.3)
    found = scores_of(reference, reference)
    for name in ("mean_iou", "auc", "sr50", "sr75", "precision20", "normalised_precision"):
        assert found[name] == 1.0, name
    assert found["auc_otb"] == pytest.approx(20 / 21)
    assert found["false_false"] == 0.0
    assert math.isnan(found["false_true"])


def test_a_box_that_never_moves_scores_its_closed_form() -> None:
    """A shift by d of a box of width w has IoU (w − d) / (w + d)."""
    reference = walk(9, 1.0)
    expected = [(20 - d) / (20 + d) for d in range(1, 9)]
    found = scores_of(reference, np.repeat(reference[:1], 9, axis=0))
    assert found["mean_iou"] == pytest.approx(np.mean(expected))
    assert found["sr50"] == pytest.approx(np.mean([value >= 0.5 for value in expected]))
    assert found["auc"] == pytest.approx(np.mean(expected), abs=0.01)
    assert found["precision20"] == 1.0


def test_no_answer_scores_zero() -> None:
    """``ok=False`` on visible frames is IoU 0 and an infinite distance, whatever the box says."""
    reference = walk(5, 1.0)
    found = scores_of(reference, reference, ok=[True] + [False] * 4)
    for name in ("mean_iou", "auc", "sr50", "precision20", "normalised_precision"):
        assert found[name] == 0.0, name
    assert found["false_false"] == 1.0


def test_frame_zero_is_not_scored() -> None:
    """What is said about the frame that was given changes nothing."""
    reference = walk(5, 1.0)
    wrong = reference.copy()
    wrong[0] = (40, 40, 2, 2)
    assert scores_of(reference, wrong, ok=[False] + [True] * 4)["mean_iou"] == 1.0


def test_only_ok_counts_where_nothing_is_seen() -> None:
    """Invisible frames give the false True rate; hardly visible ones give nothing."""
    reference = walk(6, 1.0)
    wrong = reference + 30.0
    wrong[1:3] = reference[1:3]
    visibility, ok = [1, 1, 1, 0.05, 0, 0], [True, True, True, True, True, False]
    found = scores_of(reference, wrong, visibility=visibility, ok=ok)
    assert (found["mean_iou"], found["false_true"], found["false_false"]) == (1.0, 0.5, 0.0)
    assert (found["visible"], found["invisible"]) == (2.0, 2.0)


def test_a_sequence_without_visible_frames_has_no_score() -> None:
    """Nothing to rest on is NaN, not 0 and not a warning."""
    found = scores_of(walk(3, 1.0), walk(3, 1.0), visibility=[1, 0, 0])
    assert math.isnan(found["mean_iou"])
    assert found["false_true"] == 1.0


@given(st.lists(st.floats(0, 1), min_size=1, max_size=40))
def test_success_curve_falls_and_its_area_is_the_mean(values: list[float]) -> None:
    """The curve never rises, starts at the share over 0, and its area is within a step of the mean IoU."""
    iou = np.array(values)
    curve = success_curve(iou)
    assert (np.diff(curve) <= 0).all()
    assert curve[0] == (iou > 0).mean()
    area = ((curve[1:] + curve[:-1]) / 2).mean()
    assert area == pytest.approx(iou.mean(), abs=0.0051)


@given(st.lists(st.floats(0, 100) | st.just(math.inf), min_size=1, max_size=40))
def test_precision_curve_rises_to_the_share_within_reach(values: list[float]) -> None:
    """The curve never falls; what is infinitely far is never within reach."""
    curve = precision_curve(np.array(values))
    assert (np.diff(curve) >= 0).all()
    assert curve[-1] == np.mean([value <= 50 for value in values])


def as_toolkits_count(
    reference: NDArray[np.float64], visibility: list[float], boxes: NDArray[np.float64], ok: list[bool]
) -> dict[str, float]:
    """The columns of OTB and GOT-10k, one frame after another."""

    def cut(box: NDArray[np.float64]) -> list[float]:
        x, y = min(max(box[0], 0), SIZE[0]), min(max(box[1], 0), SIZE[1])
        return [x, y, min(max(box[2], 0), SIZE[0] - x), min(max(box[3], 0), SIZE[1] - y)]

    def overlap(a: list[float], b: list[float]) -> float:
        w = max(min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0]), 0)
        h = max(min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1]), 0)
        return w * h / (a[2] * a[3] + b[2] * b[3] - w * h)

    held, last = [], boxes[0]
    for box, located in zip(boxes, ok, strict=True):
        last = box if located else last
        held.append(last)
    otb = [1.0] + [overlap(list(a), list(b)) for a, b in zip(reference[1:], held[1:], strict=True)]
    far = [0.0] + [
        float(np.hypot(*(a[:2] + a[2:] / 2 - b[:2] - b[2:] / 2)))
        for a, b in zip(reference[1:], held[1:], strict=True)
    ]
    got = [overlap(cut(reference[t]), cut(held[t])) for t in range(1, len(held)) if visibility[t] > 0]
    return {
        "auc_otb": float(np.mean([[value > t / 20 for t in range(21)] for value in otb])),
        "precision_otb": float(np.mean([value <= 20 for value in far])),
        "ao_got10k": float(np.mean(got)),
        "sr50_got10k": float(np.mean([value > 0.5 for value in got])),
        "sr75_got10k": float(np.mean([value > 0.75 for value in got])),
        "covered": len(got),
    }


@given(
    st.integers(0, 10**6),
    st.lists(st.booleans(), min_size=12, max_size=12),
    st.lists(st.sampled_from([0.0, 0.05, 1.0]), min_size=12, max_size=12),
)
def test_the_columns_of_the_toolkits_count_as_they_do(seed: int, ok: list[bool], visibility: list[float]) -> None:
    """The last box is held, frame 0 and hidden frames count for OTB, whatever can be seen counts for GOT-10k."""
    rng = np.random.default_rng(seed)
    reference = walk(12, 3.0) + rng.uniform(-14, 2, (12, 1))
    reference[:, 2:] = rng.uniform(5, 25, (12, 2))
    boxes = reference + rng.uniform(-8, 8, (12, 4))
    boxes[:, 2:] = np.maximum(boxes[:, 2:], 1.0)
    visibility[1] = 1.0
    found = scores_of(reference, boxes, visibility=visibility, ok=ok)
    for name, expected in as_toolkits_count(reference, visibility, boxes, ok).items():
        assert found[name] == pytest.approx(expected, abs=1e-12), name


def test_a_lost_object_costs_nothing_where_the_last_box_is_held() -> None:
    """Of an object that stands still, ``ok=False`` scores 0 here, and 1 in the toolkits."""
    reference = walk(5, 0.0)
    found = scores_of(reference, reference, ok=[True] + [False] * 4)
    assert (found["mean_iou"], found["ao_got10k"], found["precision_otb"]) == (0.0, 1.0, 1.0)
    assert found["auc_otb"] == pytest.approx(20 / 21)


def test_nothing_is_held_for_a_tracker_that_answers_no_more() -> None:
    """After a crash there is no last box: frames without an answer score 0 in the columns of the toolkits, too."""
    reference = walk(5, 0.0)
    boxes = reference.copy()
    boxes[3:] = np.nan
    found = scores_of(reference, boxes, ok=[True, True, False, False, False])
    assert (found["ao_got10k"], found["precision_otb"]) == (0.5, 0.6)
    assert found["auc_otb"] == pytest.approx(0.6 * 20 / 21)


def test_normalised_precision_is_the_share_within_a_fifth_of_the_box() -> None:
    """LaSOT's value: the distance by the sides of the true box, at most 0.2."""
    reference = walk(5, 0.0)
    boxes = reference.copy()
    boxes[1:, 0] += [3.9, 4.1, 0.0, 0.0]
    boxes[1:, 1] += [0.0, 0.0, 1.9, 2.1]
    assert scores_of(reference, boxes)["normalised_precision"] == 0.5


def test_lengths_must_agree() -> None:
    """Arrays of different lengths are an error that names them."""
    with pytest.raises(ValueError, match=r"one length, got \[3, 4\]"):
        frame_scores(walk(3, 1.0), np.ones(4), walk(3, 1.0), np.ones(3, dtype=bool), SIZE)
    with pytest.raises(ValueError, match=r"shape \(T, 4\), got \(3, 2\)"):
        clip_boxes(np.zeros((3, 2)), SIZE)


def test_every_metric_is_computed() -> None:
    """The table of metrics and the summary name the same numbers."""
    assert set(scores_of(walk(3, 1.0), walk(3, 1.0))) == {*METRICS, *COUNTS}
