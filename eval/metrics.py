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
  every threshold and an absent one 0. Its AUC (trapezium rule, 101 thresholds) therefore reaches exactly 1. The
  field's toolkits count IoU > t at 21 thresholds, where a perfect tracker scores 20/21: that is *AUC (21 ×, >)*.
* Distances: precision counts those ≤ 20 px; normalised precision divides by the size of the reference box and is the
  area under the curve of shares ≤ t for t from 0 to 0.5, scaled to 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "METRICS",
    "MIN_VISIBILITY",
    "PRECISION_THRESHOLDS",
    "SUCCESS_THRESHOLDS",
    "FrameScores",
    "Metric",
    "clip_boxes",
    "frame_scores",
    "iou_per_frame",
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
NORMALISED_THRESHOLDS: FloatArray = np.linspace(0.0, 0.5, 51)
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
    "auc": Metric("AUC", "", "higher"),
    "auc_otb": Metric("AUC (21 ×, >)", "", "higher"),
    "sr50": Metric("SR@0.5", "", "higher"),
    "sr75": Metric("SR@0.75", "", "higher"),
    "precision20": Metric("P@20", "", "higher"),
    "normalised_precision": Metric("norm. P", "", "higher"),
    "false_true": Metric("false True", "", "lower", weight="invisible"),
    "false_false": Metric("false False", "", "lower", weight="visible"),
    "true_off": Metric("True far off", "", "lower", weight="visible"),
}


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
    distance, normalised_distance : ndarray, shape (T−1,)
        Of the centres, px and in box sizes; infinite for a missing answer, NaN where not visible.
    """

    visible: NDArray[np.bool_]
    invisible: NDArray[np.bool_]
    ok: NDArray[np.bool_]
    iou: FloatArray
    distance: FloatArray
    normalised_distance: FloatArray


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

    Raises
    ------
    ValueError
        If the lengths differ.
    """
    lengths = {len(reference), len(visibility), len(estimated), len(ok)}
    if len(lengths) != 1:
        raise ValueError(f"expected arrays of one length, got {sorted(lengths)}")
    reference, estimated = _validated(reference, "reference")[1:], _validated(estimated, "estimated")[1:]
    edges, answer = clip_boxes(reference, size), clip_boxes(estimated, size)
    visible = (np.asarray(visibility)[1:] >= MIN_VISIBILITY) & (_area(edges) > 0)
    answered = np.asarray(ok, dtype=bool)[1:] & np.isfinite(estimated).all(axis=1)
    iou = np.where(answered, iou_per_frame(reference, estimated, size), 0.0)
    offset = (answer[:, :2] + answer[:, 2:]) / 2 - (edges[:, :2] + edges[:, 2:]) / 2
    sides = np.where(visible[:, np.newaxis], edges[:, 2:] - edges[:, :2], 1.0)
    return FrameScores(
        visible=visible,
        invisible=np.asarray(visibility)[1:] <= 0,
        ok=np.asarray(ok, dtype=bool)[1:],
        iou=np.where(visible, iou, np.nan),
        distance=_masked(np.hypot(*offset.T), answered, visible),
        normalised_distance=_masked(np.hypot(*(offset / sides).T), answered, visible),
    )


def _masked(distance: FloatArray, answered: NDArray[np.bool_], visible: NDArray[np.bool_]) -> FloatArray:
    return np.where(visible, np.where(answered, distance, np.inf), np.nan)


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


def summarise(scores: FrameScores) -> dict[str, float]:
    """Every number of :data:`METRICS` for one trajectory, with the counts `visible` and `invisible`.

    A number without any frame to rest on is NaN.
    """
    visible = scores.visible
    iou = scores.iou[visible]
    found: dict[str, float] = dict.fromkeys(METRICS, float("nan"))
    if iou.size:
        distance, normalised = scores.distance[visible], scores.normalised_distance[visible]
        found["mean_iou"] = float(iou.mean())
        found["auc"] = _area_under(success_curve(iou))
        found["auc_otb"] = float((iou[:, np.newaxis] > OTB_THRESHOLDS).mean())
        found["sr50"] = _share(iou >= 0.5)
        found["sr75"] = _share(iou >= 0.75)
        found["precision20"] = _share(distance <= 20.0)
        found["normalised_precision"] = _area_under(precision_curve(normalised, NORMALISED_THRESHOLDS))
    found["false_true"] = _share(scores.ok[scores.invisible])
    found["false_false"] = _share(~scores.ok[visible])
    found["true_off"] = _share(scores.ok[visible] & (iou < FAR_OFF))
    return {**found, "visible": float(visible.sum()), "invisible": float(scores.invisible.sum())}
