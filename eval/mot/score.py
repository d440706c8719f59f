"""Where and who: HOTA, CLEAR and identity measures, computed by TrackEval, the code of HOTA's authors."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from datasets_synthetic import Truth

from ..metrics import iou_per_frame
from ..results import ResultsError
from .trackers import Found

__all__ = ["COLUMNS", "OWED", "Answers", "Scores", "combined", "scored"]

Answers = Sequence[Sequence[Found]]
"""Per frame, what a tracker has located."""

OWED = 0.25
"""Share of an object that must be seen for its box to be owed; whoever follows it through less is not punished."""
_MATCHED = 0.5  # IoU

COLUMNS = ("HOTA", "DetA", "AssA", "IDF1", "MOTA", "IDSW", "FP", "FN")


@dataclass(frozen=True)
class Scores:
    """Results of TrackEval's three metrics on one sequence, to be combined.

    Parameters
    ----------
    parts : mapping of str to mapping
        By the name of the metric.
    """

    parts: Mapping[str, Mapping[str, Any]]

    def row(self) -> dict[str, float]:
        """Values of ``COLUMNS``: shares in 0–1 (MOTA may be below 0), and counts."""
        hota, clear, identity = (self.parts[name] for name in ("HOTA", "CLEAR", "Identity"))
        # HOTA and its halves are means over the thresholds of IoU, .05 to .95.
        means = {name: float(np.mean(hota[name])) for name in ("HOTA", "DetA", "AssA")}
        counts = {"IDSW": clear["IDSW"], "FP": clear["CLR_FP"], "FN": clear["CLR_FN"]}
        row = means | {"IDF1": float(identity["IDF1"]), "MOTA": float(clear["MOTA"])} | counts
        return {name: float(row[name]) for name in COLUMNS}


def scored(truth: Sequence[Truth], answers: Answers, size: tuple[int, int]) -> Scores:
    """Score the answers to one sequence.

    Parameters
    ----------
    truth : sequence of Truth
        Of every object, over T frames.
    answers : Answers
        Of T frames. Boxes are compared inside the frame.
    size : (int, int)
        Width and height of the frames, px.

    Raises
    ------
    ValueError
        If the answers are not those of T frames, or one names an identity twice in a frame.
    ResultsError
        If TrackEval is not installed.
    """
    frames = len(truth[0].boxes)
    if len(answers) != frames:
        raise ValueError(f"expected answers to {frames} frames, got {len(answers)}")
    data = _data(truth, answers, size)
    return Scores({name: metric.eval_sequence(data) for name, metric in _metrics().items()})


def combined(scores: Mapping[str, Scores]) -> Scores:
    """Scores over several sequences, by name: counts are added up, as the benchmarks do."""
    return Scores(
        {
            name: metric.combine_sequences({key: dict(each.parts[name]) for key, each in scores.items()})
            for name, metric in _metrics().items()
        }
    )


def _metrics() -> dict[str, Any]:
    try:
        # It prints what of it cannot be used without pycocotools; nothing here needs that.
        with contextlib.redirect_stdout(io.StringIO()):
            from trackeval.metrics import CLEAR, HOTA, Identity
    except ImportError as error:
        raise ResultsError(
            "TrackEval is missing: pip install --no-deps trackeval (it asks for opencv-python, which would overwrite "
            "the OpenCV that is there)"
        ) from error
    quiet = {"PRINT_CONFIG": False, "THRESHOLD": _MATCHED}
    return {"HOTA": HOTA(), "CLEAR": CLEAR(quiet), "Identity": Identity(quiet)}


def _data(truth: Sequence[Truth], answers: Answers, size: tuple[int, int]) -> dict[str, Any]:
    """What TrackEval wants of a sequence: identities from 0 on, and the IoU of every pair, frame by frame."""
    owed_ids, found_ids, overlaps = [], [], []
    for t, found in enumerate(answers):
        identities = [identity for identity, _ in found]
        if len(set(identities)) < len(identities):
            raise ValueError(f"expected each identity once in frame {t}, got {identities}")
        overlap = _overlaps(np.array([each.boxes[t] for each in truth]), [box for _, box in found], size)
        seen = np.array([each.visibility[t] for each in truth])
        owed = seen >= OWED
        kept = _neither(overlap, owed)
        owed_ids.append(np.flatnonzero(owed))
        found_ids.append(np.array(identities, dtype=np.int64)[kept])
        overlaps.append(overlap[owed][:, kept])
    known = {identity: k for k, identity in enumerate(sorted({int(i) for row in found_ids for i in row}))}
    return {
        "gt_ids": owed_ids,
        "tracker_ids": [np.array([known[int(i)] for i in row], dtype=np.int64) for row in found_ids],
        "similarity_scores": overlaps,
        "num_gt_ids": len(truth),
        "num_tracker_ids": len(known),
        "num_gt_dets": sum(map(len, owed_ids)),
        "num_tracker_dets": sum(map(len, found_ids)),
        "num_timesteps": len(answers),
    }


def _overlaps(truth: NDArray[np.float64], found: Sequence[Any], size: tuple[int, int]) -> NDArray[np.float64]:
    boxes = np.array(found, dtype=np.float64).reshape(-1, 4)
    pairs = np.repeat(truth, len(boxes), axis=0), np.tile(boxes, (len(truth), 1))
    return iou_per_frame(*pairs, size).reshape(len(truth), len(boxes))


def _neither(overlap: NDArray[np.float64], owed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Answers that count: all but those that lie on an object whose box is not owed."""
    kept = np.ones(overlap.shape[1], dtype=bool)
    if owed.all() or not overlap.size:
        return kept
    # What is owed has the first choice.
    worth = np.where(overlap >= _MATCHED, overlap + owed[:, np.newaxis], 0.0)
    for k, j in zip(*linear_sum_assignment(-worth), strict=True):
        if worth[k, j] > 0.0 and not owed[k]:
            kept[j] = False
    return kept
