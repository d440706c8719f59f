"""Scores of a trajectory against the truth. First the conventions, then their validation, then pure functions.

Conventions
-----------
* Frame 0 is given to the tracker and is not scored.
* The reference is the box of the whole object clipped to the frame; the estimate is clipped likewise.
* A frame is *visible*, and its box is scored, when at least a tenth of the object can be seen and its clipped box has
  an area. It is *invisible* when nothing can be seen: only `ok` counts. In between, nothing does.
* ``ok=False``, a missing answer or a box that is not finite on a visible frame has IoU 0 and an infinite distance.
* *false True* is the share of the invisible frames that were answered with ``ok=True``, *false False* that of the
  visible ones with ``ok=False``, whatever the box; *True far off* is the share of the visible ones with ``ok=True``
  and an IoU below 0.1.
* The success curve is the share of frames with IoU ≥ t, and with IoU > 0 at t = 0: a perfect tracker scores 1 at
  every threshold and an absent one 0. Its AUC (trapezium rule, 101 thresholds) therefore reaches exactly 1. With
  ever more thresholds it becomes the mean IoU.
* Distances: precision counts those ≤ 20 px; normalised precision divides by the size of the reference box and counts
  those ≤ 0.2, which is LaSOT's value.
* *mask IoU* and *rotated IoU* are over the frames whose truth is a mask (of what can be seen), and those whose truth
  is a rotated box. The answer is the tracker's mask where it gives one, else its rotated box, else its box, so that
  of trackers that answer with boxes this says how well a box can stand for the object.
* Columns that end in *(OTB)* and *(GOT-10k)* count as these toolkits do. Both hold the last box in a frame answered
  with ``ok=False``. OTB scores all frames, the first (as perfect) and hidden ones included, without clipping boxes to
  the frame, and takes IoU > t at 21 thresholds, where a perfect tracker scores 20/21. GOT-10k scores every frame but
  the first in which anything of the object can be seen, cuts boxes its own way, and pools frames of all sequences.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from .regions import Mask, answered_region, read_region, region_iou

__all__ = [
    "COUNTS",
    "METRICS",
    "MIN_VISIBILITY",
    "PRECISION_THRESHOLDS",
    "SUCCESS_THRESHOLDS",
    "FrameScores",
    "Metric",
    "clip_boxes",
    "frame_scores",
    "iou_per_frame",
    "overlap_figures",
    "precision_curve",
    "success_curve",
    "summarise",
]

FloatArray = NDArray[np.float64]

MIN_VISIBILITY = 0.1
"""Least visible fraction at which a box is scored."""

FAR_OFF = 0.1
"""IoU under which a box is about something else."""

SUCCESS_THRESHOLDS: FloatArray = np.linspace(0.0, 1.0, 101)
PRECISION_THRESHOLDS: FloatArray = np.arange(0.0, 51.0)
NORMALISED_THRESHOLD = 0.2
OTB_THRESHOLDS: FloatArray = np.linspace(0.0, 1.0, 21)


@dataclass(frozen=True)
class Metric:
    """How a number is to be read.

    Parameters
    ----------
    title : str
        Column heading.
    unit : str
        Empty for shares in 0–1.
    better : {"higher", "lower"}
    weight : str
        Column that counts what it is a share of: means over sequences weigh by it. Empty: each sequence counts once.
    """

    title: str
    unit: str
    better: Literal["higher", "lower"]
    weight: str = ""


METRICS: dict[str, Metric] = {
    "mean_iou": Metric("mean IoU", "", "higher"),
    "mask_iou": Metric("mask IoU", "", "higher"),
    "rotated_iou": Metric("rotated IoU", "", "higher"),
    "auc": Metric("AUC", "", "higher"),
    "auc_otb": Metric("AUC (OTB)", "", "higher"),
    "sr50": Metric("SR@0.5", "", "higher"),
    "sr75": Metric("SR@0.75", "", "higher"),
    "precision20": Metric("P@20", "", "higher"),
    "precision_otb": Metric("P@20 (OTB)", "", "higher"),
    "normalised_precision": Metric("norm. P@0.2", "", "higher"),
    "ao_got10k": Metric("AO (GOT-10k)", "", "higher", weight="covered"),
    "sr50_got10k": Metric("SR@0.5 (GOT-10k)", "", "higher", weight="covered"),
    "sr75_got10k": Metric("SR@0.75 (GOT-10k)", "", "higher", weight="covered"),
    "false_true": Metric("false True", "", "lower", weight="invisible"),
    "false_false": Metric("false False", "", "lower", weight="visible"),
    "true_off": Metric("True far off", "", "lower", weight="visible"),
}

COUNTS = ("visible", "invisible", "covered")
"""Numbers of frames that go with the metrics: those that score a box, those that score `ok` alone, and GOT-10k's."""


@dataclass(frozen=True)
class FrameScores:
    """Scores of the frames 1 … T−1.

    Parameters
    ----------
    visible, invisible : ndarray of bool, shape (T−1,)
        Which frames score a box, and which score `ok` alone.
    ok : ndarray of bool, shape (T−1,)
    iou : ndarray, shape (T−1,)
        NaN where not visible.
    mask_iou, rotated_iou : ndarray, shape (T−1,)
        NaN where not visible, or the truth has no such region.
    distance, normalised_distance : ndarray, shape (T−1,)
        Of the centres, px and in box sizes; infinite for a missing answer, NaN where not visible.
    otb_iou, otb_distance : ndarray, shape (T,)
        As OTB counts; NaN where there is no reference box.
    got10k_iou : ndarray, shape (T−1,)
        As GOT-10k counts; NaN where nothing of the object can be seen.
    """

    visible: NDArray[np.bool_]
    invisible: NDArray[np.bool_]
    ok: NDArray[np.bool_]
    iou: FloatArray
    mask_iou: FloatArray
    rotated_iou: FloatArray
    distance: FloatArray
    normalised_distance: FloatArray
    otb_iou: FloatArray
    otb_distance: FloatArray
    got10k_iou: FloatArray

    @property
    def finest_iou(self) -> FloatArray:
        """IoU with the true mask or rotated box where there is one, else with the true box; NaN where not visible."""
        finer = np.where(np.isfinite(self.mask_iou), self.mask_iou, self.rotated_iou)
        return np.where(np.isfinite(finer), finer, self.iou)


def _validated(boxes: FloatArray, name: str) -> FloatArray:
    found = np.asarray(boxes, dtype=np.float64)
    if found.ndim != 2 or found.shape[1] != 4:
        raise ValueError(f"expected {name} of shape (T, 4), got {found.shape}")
    return found


def clip_boxes(boxes: FloatArray, size: tuple[int, int]) -> FloatArray:
    """Parts of boxes (T, 4) inside a frame of `size` (width, height), as edges left, top, right, bottom.

    Boxes that are NaN or outside get no area.
    """
    found = _validated(boxes, "boxes")
    with np.errstate(invalid="ignore", over="ignore"):
        edges = np.concatenate([found[:, :2], found[:, :2] + np.maximum(found[:, 2:], 0.0)], axis=1)
    edges[~np.isfinite(edges).all(axis=1)] = 0.0
    width, height = size
    edges[:, 0::2] = np.clip(edges[:, 0::2], 0.0, width)
    edges[:, 1::2] = np.clip(edges[:, 1::2], 0.0, height)
    return edges


def _area(edges: FloatArray) -> FloatArray:
    sides = np.maximum(edges[:, 2:] - edges[:, :2], 0.0)
    return np.asarray(sides[:, 0] * sides[:, 1])


def iou_per_frame(reference: FloatArray, estimated: FloatArray, size: tuple[int, int]) -> FloatArray:
    """Intersection over union of boxes (T, 4), both clipped to a frame of `size` (width, height), px.

    Returns
    -------
    ndarray, shape (T,)
        In [0, 1]; 0 where either has no area in the frame.

    Raises
    ------
    ValueError
        If the shapes differ.
    """
    first, second = clip_boxes(reference, size), clip_boxes(estimated, size)
    if first.shape != second.shape:
        raise ValueError(f"expected as many estimated boxes as reference boxes, got {len(second)} and {len(first)}")
    common = _area(
        np.concatenate([np.maximum(first[:, :2], second[:, :2]), np.minimum(first[:, 2:], second[:, 2:])], 1)
    )
    union = _area(first) + _area(second) - common
    return np.divide(common, union, out=np.zeros_like(common), where=union > 0)


def frame_scores(
    reference: FloatArray,
    visibility: FloatArray,
    estimated: FloatArray,
    ok: NDArray[np.bool_],
    size: tuple[int, int],
    *,
    true_regions: Sequence[str] = (),
    regions: Sequence[str] = (),
) -> FrameScores:
    """Score each frame but the first.

    Parameters
    ----------
    reference, estimated : ndarray, shape (T, 4)
        x, y, w, h, px.
    visibility : ndarray, shape (T,)
        Visible fraction.
    ok : ndarray of bool, shape (T,)
    size : (int, int)
        Width and height of the frame, px.
    true_regions, regions : sequence of T str, optional
        Masks and rotated boxes, as :mod:`eval.regions` writes them; of what is empty the box counts.

    Raises
    ------
    ValueError
        If the lengths differ.
    """
    lengths = {
        len(reference),
        len(visibility),
        len(estimated),
        len(ok),
        *map(len, filter(len, (true_regions, regions))),
    }
    if len(lengths) != 1:
        raise ValueError(f"expected arrays of one length, got {sorted(lengths)}")
    reference, estimated = _validated(reference, "reference"), _validated(estimated, "estimated")
    held = _last_box_held(estimated, np.asarray(ok, dtype=bool))
    otb_iou, otb_distance = _as_otb(reference, held)
    got10k_iou = np.where(np.asarray(visibility)[1:] > 0, _got10k_iou(reference[1:], held[1:], size), np.nan)
    reference, estimated = reference[1:], estimated[1:]
    edges, answer = clip_boxes(reference, size), clip_boxes(estimated, size)
    visible = (np.asarray(visibility)[1:] >= MIN_VISIBILITY) & (_area(edges) > 0)
    answered = np.asarray(ok, dtype=bool)[1:] & np.isfinite(estimated).all(axis=1)
    iou = np.where(answered, iou_per_frame(reference, estimated, size), 0.0)
    mask_iou, rotated_iou = _region_ious(true_regions[1:], regions[1:], estimated, visible, answered, size)
    offset = (answer[:, :2] + answer[:, 2:]) / 2 - (edges[:, :2] + edges[:, 2:]) / 2
    sides = np.where(visible[:, np.newaxis], edges[:, 2:] - edges[:, :2], 1.0)
    return FrameScores(
        visible=visible,
        invisible=np.asarray(visibility)[1:] <= 0,
        ok=np.asarray(ok, dtype=bool)[1:],
        iou=np.where(visible, iou, np.nan),
        mask_iou=mask_iou,
        rotated_iou=rotated_iou,
        distance=_masked(np.hypot(*offset.T), answered, visible),
        normalised_distance=_masked(np.hypot(*(offset / sides).T), answered, visible),
        otb_iou=otb_iou,
        otb_distance=otb_distance,
        got10k_iou=got10k_iou,
    )


def _region_ious(
    truths: Sequence[str],
    regions: Sequence[str],
    boxes: FloatArray,
    visible: NDArray[np.bool_],
    answered: NDArray[np.bool_],
    size: tuple[int, int],
) -> tuple[FloatArray, FloatArray]:
    """IoU with the true masks, and with the true rotated boxes; NaN where there is none."""
    masks, rotated = np.full(len(boxes), np.nan), np.full(len(boxes), np.nan)
    for t, text in enumerate(truths):
        if not (text and visible[t]):
            continue
        truth = read_region(text)
        found = masks if isinstance(truth, Mask) else rotated
        found[t] = 0.0
        if answered[t]:
            found[t] = region_iou(truth, answered_region(regions[t] if regions else "", boxes[t]), size)
    return masks, rotated


def _masked(distance: FloatArray, answered: NDArray[np.bool_], visible: NDArray[np.bool_]) -> FloatArray:
    return np.where(visible, np.where(answered, distance, np.inf), np.nan)


def _last_box_held(estimated: FloatArray, ok: NDArray[np.bool_]) -> FloatArray:
    """Boxes as toolkits get them: where nothing is located, the last that was; NaN where nothing was answered."""
    located = ok & np.isfinite(estimated).all(axis=1)
    located = np.concatenate([[True], located[1:]])  # the start box
    last = np.maximum.accumulate(np.where(located, np.arange(len(located)), 0))
    answered = np.isfinite(estimated).all(axis=1, keepdims=True)
    return np.where(answered, estimated[last], np.nan)


def _as_otb(reference: FloatArray, held: FloatArray) -> tuple[FloatArray, FloatArray]:
    """IoU and distance of the centres (T,) without clipping; the first box is the reference itself."""
    known = np.asarray(np.isfinite(reference).all(axis=1))
    first, second = np.where(known[:, np.newaxis], reference, 0.0), held.copy()
    second[0] = first[0]
    iou = _plain_iou(first, np.nan_to_num(second))
    with np.errstate(over="ignore", invalid="ignore"):
        offset = (first[:, :2] + first[:, 2:] / 2) - (second[:, :2] + second[:, 2:] / 2)
        distance = np.nan_to_num(np.hypot(*offset.T), nan=np.inf)
    return np.where(known, iou, np.nan), np.where(known, distance, np.nan)


def _got10k_iou(reference: FloatArray, held: FloatArray, size: tuple[int, int]) -> FloatArray:
    """IoU (T,) of boxes cut as GOT-10k's toolkit cuts them: what reaches out on the left keeps its width."""

    def cut(boxes: FloatArray) -> FloatArray:
        corner = np.clip(np.nan_to_num(boxes[:, :2]), 0.0, size)
        return np.concatenate([corner, np.clip(np.nan_to_num(boxes[:, 2:]), 0.0, size - corner)], axis=1)

    return _plain_iou(cut(reference), cut(held))


def _plain_iou(first: FloatArray, second: FloatArray) -> FloatArray:
    """IoU (T,) of boxes x, y, w, h as they are."""
    with np.errstate(over="ignore", invalid="ignore"):
        low = np.maximum(first[:, :2], second[:, :2])
        high = np.minimum(first[:, :2] + first[:, 2:], second[:, :2] + second[:, 2:])
        common = np.maximum(high - low, 0.0).prod(axis=1)
        union = first[:, 2:].prod(axis=1) + second[:, 2:].prod(axis=1) - common
        shares = np.divide(common, union, out=np.zeros_like(common), where=union > 0)
    return np.asarray(np.clip(shares, 0.0, 1.0))


def success_curve(iou: FloatArray) -> FloatArray:
    """Share of frames with IoU ≥ t at :data:`SUCCESS_THRESHOLDS`; with IoU > 0 at t = 0. `iou` has no NaN."""
    curve = (iou[:, np.newaxis] >= SUCCESS_THRESHOLDS).mean(axis=0)
    curve[0] = (iou > 0).mean()
    return np.asarray(curve)


def precision_curve(distance: FloatArray, thresholds: FloatArray = PRECISION_THRESHOLDS) -> FloatArray:
    """Share of frames with distance ≤ t at each threshold. `distance` has no NaN."""
    return np.asarray((distance[:, np.newaxis] <= thresholds).mean(axis=0))


def _area_under(curve: FloatArray) -> float:
    """Trapezium rule on equal steps, scaled to the interval: exactly 1 for a curve of ones."""
    return float(((curve[1:] + curve[:-1]) / 2).mean())


def _share(values: NDArray[np.bool_]) -> float:
    return float(values.mean()) if values.size else float("nan")


def overlap_figures(iou: FloatArray) -> dict[str, float]:
    """Mean, AUC and success rates of the IoU of some frames; NaN without any."""
    if not iou.size:
        return dict.fromkeys(("mean_iou", "auc", "sr50", "sr75"), float("nan"))
    return {
        "mean_iou": float(iou.mean()),
        "auc": _area_under(success_curve(iou)),
        "sr50": _share(iou >= 0.5),
        "sr75": _share(iou >= 0.75),
    }


def summarise(scores: FrameScores) -> dict[str, float]:
    """Every number of :data:`METRICS` for one trajectory, with its :data:`COUNTS`.

    A number without any frame to rest on is NaN.
    """
    visible = scores.visible
    iou = scores.iou[visible]
    found: dict[str, float] = dict.fromkeys(METRICS, float("nan")) | overlap_figures(iou)
    if iou.size:
        distance, normalised = scores.distance[visible], scores.normalised_distance[visible]
        found["precision20"] = _share(distance <= 20.0)
        found["normalised_precision"] = _share(normalised <= NORMALISED_THRESHOLD)
    for name, values in (("mask_iou", scores.mask_iou), ("rotated_iou", scores.rotated_iou)):
        known = values[np.isfinite(values)]
        if known.size:
            found[name] = float(known.mean())
    found["false_true"] = _share(scores.ok[scores.invisible])
    found["false_false"] = _share(~scores.ok[visible])
    found["true_off"] = _share(scores.ok[visible] & (iou < FAR_OFF))
    # Where only the first box is known there is nothing to count.
    otb, got10k = np.isfinite(scores.otb_iou), np.isfinite(scores.got10k_iou)
    if otb[1:].any():
        found["auc_otb"] = float((scores.otb_iou[otb][:, np.newaxis] > OTB_THRESHOLDS).mean())
        found["precision_otb"] = _share(scores.otb_distance[otb] <= 20.0)
    if got10k.any():
        found["ao_got10k"] = float(scores.got10k_iou[got10k].mean())
        found["sr50_got10k"] = _share(scores.got10k_iou[got10k] > 0.5)
        found["sr75_got10k"] = _share(scores.got10k_iou[got10k] > 0.75)
    counts = visible.sum(), scores.invisible.sum(), got10k.sum()
    return {**found, **{name: float(count) for name, count in zip(COUNTS, counts, strict=True)}}
