"""What each part of the tracker is worth: the same tracker with one part taken out, or with another flow in it.

The tracker has no switches for this, since a switch that nobody should touch is a burden on everybody. The surgery is
done from outside: the process that runs the ablated tracker (it serves no other tracker) first replaces a function
of the library. A part that is no longer where it was raises, so that no row of the table can be a row without effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from importlib import import_module
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from .statistics import differences
from .tables import Summary, format_cell
from .trackers import TrackerSpec

__all__ = ["ABLATIONS", "WHOLE", "Ablation", "Cut", "ablated", "ablation_changes", "ablation_table", "specs"]

WHOLE = "whole"
"""Name of the tracker from which nothing is taken."""

_LIBRARY = "hs_tracker_cv"
_DONE: set[str] = set()  # in this process, which may serve several sequences
_SOURCES = (_LIBRARY, __name__, "eval.flow.methods", "eval.baselines")


class Cut(NamedTuple):
    """One replacement: ``make(old)`` is put where a function or value of the library stands."""

    module: str
    name: str
    make: Callable[[Any], Any]

    def do(self) -> None:
        """Change the library in this process, for good."""
        place = import_module(f"{_LIBRARY}.{self.module}")
        setattr(place, self.name, self.make(getattr(place, self.name)))


@dataclass(frozen=True)
class Ablation:
    """One row of the table.

    Parameters
    ----------
    group : str
        The room that the part belongs to.
    title : str
        What is off, or what stands in its place.
    cuts : tuple of Cut, optional
        What is replaced in the library.
    mode : str, optional
        Of ``TrackerHS_Params``.
    """

    group: str
    title: str
    cuts: tuple[Cut, ...] = ()
    mode: str = "auto"


def ablated(without: str) -> Any:
    """Make a tracker after taking a part out of the library, in this process and for good.

    Parameters
    ----------
    without : str
        Name in :data:`ABLATIONS`, or :data:`WHOLE`.

    Raises
    ------
    ValueError
        If the name is unknown.
    """
    if without not in (WHOLE, *ABLATIONS):
        raise ValueError(f"expected one of {', '.join((WHOLE, *ABLATIONS))}, got {without!r}")
    part = ABLATIONS.get(without, Ablation("", ""))
    # All of it first: a module imported after the surgery would bind what another was given.
    library = import_module(f"{_LIBRARY}.tracker")
    if without not in _DONE:
        for cut in part.cuts:
            cut.do()
        _DONE.add(without)
    return library.TrackerHS_create(library.TrackerHS_Params(mode=part.mode))


def specs(names: tuple[str, ...] = ()) -> list[TrackerSpec]:
    """Trackers to run: the whole one first, then one per ablation (all, or those named).

    Raises
    ------
    ValueError
        If a name is unknown.
    """
    unknown = set(names) - set(ABLATIONS)
    if unknown:
        raise ValueError(f"unknown part {', '.join(sorted(unknown))}; known: {', '.join(ABLATIONS)}")
    chosen = (WHOLE, *(name for name in ABLATIONS if not names or name in names))
    return [TrackerSpec(name, f"{__name__}:ablated", params={"without": name}, sources=_SOURCES) for name in chosen]


def ablation_changes(summaries: Mapping[str, Summary]) -> pd.DataFrame:
    """What each part is worth on each kind of data.

    Parameters
    ----------
    summaries : mapping of str to Summary
        One per kind, of runs of :func:`specs`.

    Returns
    -------
    DataFrame
        One row per part and kind: `part`, `kind`, number of `sequences`, `mean_iou` without the part, its `change`
        against the whole, and the interval of the change, `low` to `high`.
    """
    rows = []
    for kind, summary in summaries.items():
        changes = differences(summary.pairs, WHOLE, together=False).set_index("other")
        for tracker, count, mean in summary.overall[["tracker", "sequences", "mean_iou"]].itertuples(index=False):
            row = {"part": tracker, "kind": kind, "sequences": count, "mean_iou": mean}
            if tracker in changes.index:
                # How the mean changes without the part: the opposite of what the whole is better by.
                better = changes.loc[tracker]
                row |= {
                    "change": 0.0 - better["difference"],
                    "low": 0.0 - better["high"],
                    "high": 0.0 - better["low"],
                }
            rows.append(row)
    return pd.DataFrame(rows, columns=["part", "kind", "sequences", "mean_iou", "change", "low", "high"])


def ablation_table(summaries: Mapping[str, Summary]) -> pd.DataFrame:
    """What each part is worth, as text: the mean of the whole, then changes with their intervals, a column per kind.

    A part pays on a kind if the mean falls without it, the whole interval below zero.
    """
    rows = ablation_changes(summaries).to_dict("records")
    found = {(str(row["part"]), str(row["kind"])): row for row in rows}
    lines = [["", WHOLE, *(format_cell(found[WHOLE, kind]["mean_iou"]) for kind in summaries), "", ""]]
    for name, part in ABLATIONS.items():
        own = {kind: found[name, kind] for kind in summaries if (name, kind) in found}
        if own:
            cells = [_change_text(own[kind]) if kind in own else "–" for kind in summaries]
            pays = ", ".join(kind for kind, row in own.items() if row["high"] < 0) or "–"
            lines.append([part.group, part.title, *cells, pays, _where(summaries, name)])
    kinds = [f"{kind} ({len(summary.sequences)})" for kind, summary in summaries.items()]
    return pd.DataFrame(lines, columns=["room", "off or replaced", *kinds, "pays on", "where"])


def _change_text(row: Mapping[Any, Any]) -> str:
    return f"{row['change']:+.3f} ({row['low']:+.3f} to {row['high']:+.3f})"


def _where(summaries: Mapping[str, Summary], part: str) -> str:
    """Sequences that lose most without the part, and those that gain most."""
    pairs = pd.concat([summary.pairs for summary in summaries.values()])
    wide = pairs.pivot(index="sequence", columns="tracker", values="mean_iou")
    gaps = (wide[part] - wide[WHOLE]).dropna().sort_values()
    worst = ", ".join(f"{sequence} {gap:+.2f}" for sequence, gap in gaps.head(3).items() if gap < -0.02)
    best = ", ".join(f"{sequence} {gap:+.2f}" for sequence, gap in gaps[::-1].head(2).items() if gap > 0.02)
    return "; ".join(text for text in (worst, best) if text)


# --- the surgery -------------------------------------------------------------------------------------------


def _with_fields(**values: Any) -> Callable[[Any], Any]:
    """Frozen parameters with other values."""
    return lambda params: replace(params, **values)


def _without_memory(counts_of: Any) -> Any:
    """Background known from the last frame only: no pixel of its memory counts as seen."""

    def unseen(moves: Any) -> Any:
        counts = counts_of(moves).copy()
        counts[0] = np.minimum(counts[0], 0.0)
        return counts

    return unseen


def _never(_: Any) -> Any:
    """A question that is always answered with no."""
    return lambda *_: False


def _never_occluded(updated: Any) -> Any:
    """Nothing is ever in front of the object; out of sight it can still be."""

    def judge_nothing(last: Any, *arguments: Any) -> Any:
        return type(last)()

    return judge_nothing


def _one_brightness(_: Any) -> Any:
    """Local gains of one: shadow, flicker and glint count as change."""
    return 1.0, 1.0


class _OtherFlow:
    """Stands where a :class:`~hs_tracker_cv.flow.HornSchunck` stood.

    A method that takes no first guess is given the second frame warped by it, and adds what it finds to the guess.
    """

    def __init__(self, method: Callable[..., Any], guessed: bool) -> None:
        self._method = method
        self._guessed = guessed

    def calc(
        self, previous: NDArray[np.float32], current: NDArray[np.float32], start: NDArray[np.float32] | None
    ) -> NDArray[np.float32]:
        """Flow from `previous` to `current`, both (H, W) gray, 0–255 or round zero, as patches are."""
        shift = 0.0 if min(previous.min(), current.min()) >= 0.0 else 128.0
        first, second = (np.clip(frame + shift + 0.5, 0, 255).astype(np.uint8) for frame in (previous, current))
        if start is None or not self._guessed:
            return np.asarray(self._method(first, second), np.float32)
        height, width = first.shape
        x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
        warped = cv2.remap(
            second, x + start[:, :, 0], y + start[:, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(start + self._method(first, warped), np.float32)


def _flow(method: str) -> tuple[Cut, ...]:
    """Cuts that put a method of the flow comparison where Horn–Schunck stands, in both modes."""

    def make(horn_schunck: Any) -> Any:
        from .flow.methods import FLOW_METHODS

        return lambda *preset, **options: _OtherFlow(FLOW_METHODS[method].factory(), guessed=True)

    return _flow_cuts(make)


def _paper(horn_schunck: Any) -> Any:
    """The paper's flow: smoothed frames, plain sweeps at one scale with λ = 10, no first guess."""

    def calc(first: NDArray[np.uint8], second: NDArray[np.uint8]) -> Any:
        return horn_schunck("classic").calc(*(cv2.GaussianBlur(frame, (0, 0), 1.0) for frame in (first, second)))

    return lambda *preset, **options: _OtherFlow(calc, guessed=False)


def _flow_cuts(make: Callable[[Any], Any]) -> tuple[Cut, ...]:
    return Cut("flow", "HornSchunck", make), Cut("patch_tracker.tracking", "HornSchunck", make)


ABLATIONS: dict[str, Ablation] = {
    "flow-none": Ablation("flow", "no flow: the predicted motion stands", _flow("zero")),
    "flow-paper": Ablation("flow", "the paper's: one scale, no first guess", _flow_cuts(_paper)),
    "flow-dis": Ablation("flow", "cv2 DIS, medium", _flow("dis-medium")),
    "flow-farneback": Ablation("flow", "cv2 Farnebäck", _flow("farneback")),
    "flow-tvl1": Ablation("flow", "scikit-image TV-L1", _flow("tvl1")),
    "flow-lucas-kanade": Ablation("flow", "pyramidal Lucas–Kanade", _flow("lucas-kanade")),
    "no-registration": Ablation(
        "segmentation",
        "registration with the object layer (Gauss–Newton)",
        (Cut("segmentation.tuning", "OBJECT_STEPS", lambda _: 0),),
    ),
    "no-search": Ablation(
        "segmentation",
        "search over translations",
        (Cut("segmentation.motion", "_search_translation", lambda _: lambda state, *rest: state.velocity),),
    ),
    "no-camera": Ablation(
        "segmentation",
        "registration of the camera to the background memory",
        (Cut("segmentation.tuning", "CAMERA_STEPS", lambda _: 0),),
    ),
    "no-memory": Ablation(
        "segmentation", "background memory", (Cut("segmentation.labelling", "_counts", _without_memory),)
    ),
    "no-gain": Ablation(
        "segmentation",
        "brightness gain (shadow, flicker)",
        tuple(Cut("segmentation.tuning", name, _one_brightness) for name in ("GROUND_GAINS", "OBJECT_GAINS")),
    ),
    "no-colour": Ablation(
        "segmentation",
        "colour histograms",
        (Cut("arbitration.rooms", "SEGMENTATION", _with_fields(colour_weight=0.0)),),
    ),
    "no-growth": Ablation(
        "segmentation",
        "growth and distractors",
        (Cut("segmentation.tuning", "GROWTH", lambda _: 0),),
    ),
    "no-edge": Ablation(
        "segmentation",
        "mixed pixels of the edge",
        (Cut("segmentation.tuning", "LEAST_LEFT", lambda _: 1.0),),
    ),
    "no-occlusion": Ablation(
        "segmentation", "occlusion", (Cut("segmentation.occlusion", "updated", _never_occluded),)
    ),
    "no-keys": Ablation(
        "patch_tracker",
        "keyframes but the first",
        (Cut("arbitration.rooms", "PATCH_TRACKER", _with_fields(key_gap=10**9)),),
    ),
    "no-velocity": Ablation(
        "patch_tracker",
        "prediction by the velocity",
        (Cut("arbitration.rooms", "PATCH_TRACKER", _with_fields(velocity_rate=0.0)),),
    ),
    "no-scale": Ablation(
        "patch_tracker",
        "change of size",
        (Cut("arbitration.rooms", "PATCH_TRACKER", _with_fields(max_scale_step=0.0, max_key_scale=0.0)),),
    ),
    "no-learning": Ablation(
        "patch_tracker",
        "learning after the first frame",
        (Cut("patch_tracker.tracking", "_learn", lambda _: lambda model, *rest: model),),
    ),
    "no-redetection": Ablation(
        "redetection",
        "watching the whole frame after a loss",
        (Cut("redetection", "target_of", lambda _: lambda state, known: None),),
    ),
    "no-teaching": Ablation(
        "arbitration",
        "the carried box begun anew where the object has left it",
        (Cut("arbitration.actions", "_has_left", _never),),
    ),
    "segmentation-only": Ablation("arbitration", "the carried box: segmentation always", mode="segmentation"),
    "patch-tracker-only": Ablation("arbitration", "segmentation: the carried box always", mode="patch_tracker"),
}
"""Every ablation, in the order of the table."""
