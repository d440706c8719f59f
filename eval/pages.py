"""A page for each sequence: who was where and when, strip by strip, and the frames round each failure."""

from __future__ import annotations

import base64
import hashlib
import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .diagnosis import KINDS, Failure, Strip, failures, strips
from .framesource import FrameSourceError
from .overlay import VIDEO_FPS, encode_jpeg, frame_pictures, write_video
from .results import ResultsError
from .sequences import Sequence
from .statistics import ScoredRun

__all__ = ["PICTURE_BYTES", "page_environment", "page_name", "write_page"]

PICTURE_BYTES = 1_500_000
"""Pictures of one page, at most, as they stand in it."""

_TEMPLATE = "sequence.html.j2"
_WIDTH, _LINE, _CHART = 1000.0, 16, 130  # of the drawing, in its own units


@dataclass(frozen=True)
class _Pair:
    """The frames before and at a frame in which something fails."""

    frame: int
    failures: list[Failure]
    before: str
    after: str


def page_environment() -> Any:
    """Jinja's environment of the referee's pages: templates beside this module, what is unknown an error."""
    import jinja2

    return jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )


def page_name(sequence: str) -> str:
    """File of a sequence's page; two names never share one."""
    safe = re.sub(r"[^\w.+-]", "_", sequence)
    return f"{safe if safe == sequence else f'{safe}-{hashlib.sha256(sequence.encode()).hexdigest()[:6]}'}.html"


def write_page(
    folder: Path,
    items: list[ScoredRun],
    colours: Mapping[str, str],
    *,
    shown: tuple[str, ...],
    video: bool = False,
) -> Path:
    """Write the page of one sequence.

    Parameters
    ----------
    folder : Path
        Of all pages; a video lies beside them.
    items : list of ScoredRun
        One run of each tracker on this sequence, in the order of the strips.
    colours : mapping of str to str
        #rrggbb of each tracker.
    shown : tuple of str
        Trackers whose boxes are drawn, and round whose failures frames are shown.
    video : bool, optional
        Whether the whole sequence is written as a video with their boxes.

    Raises
    ------
    ResultsError
        If it cannot be written.
    """
    sequence = items[0].sequence
    drawn = {item.run.tracker: item.run for item in items if item.run.tracker in shown}
    found = sorted((failure for item in items for failure in failures(item)), key=lambda failure: failure.first)
    pairs, left_out = _pairs(sequence, [one for one in found if one.tracker in drawn], drawn, colours)
    path = folder / page_name(sequence.name)
    film = path.with_suffix(".webm")
    if video and not _filmed(film, sequence, drawn, colours):
        video = False
    rows = strips(items)
    contents = {
        "name": sequence.name,
        "colours": colours,
        "shown": list(drawn),
        "attributes": ", ".join(sequence.attributes),
        "parameters": {name: _text(value) for name, value in sequence.parameters.items()},
        "frames": len(sequence),
        "strips": rows,
        "ticks": _ticks(len(sequence)),
        "lines": {row.tracker: _polylines(row) for row in rows},
        "means": {
            row.tracker: _share(float(np.nanmean(row.iou))) if np.isfinite(row.iou).any() else "–" for row in rows
        },
        "width": _WIDTH,
        "line": _LINE,
        "chart": _CHART,
        "failures": found,
        "kinds": KINDS,
        "pairs": pairs,
        "left_out": left_out,
        "video": film.name if video else "",
        "data": json.dumps(_data(items, rows, VIDEO_FPS)).replace("<", "\\u003c"),
    }
    environment = page_environment()
    environment.filters["share"] = _share
    text = environment.get_template(_TEMPLATE).render(contents)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultsError(f"cannot write {path}: {error.strerror or error}") from error
    return path


def _filmed(path: Path, sequence: Sequence, runs: Mapping[str, Any], colours: Mapping[str, str]) -> bool:
    """Write the video; whether the frames were there for it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        write_video(path, sequence, runs, colours)
    except (FrameSourceError, OSError):
        path.unlink(missing_ok=True)
        return False
    return True


def _pairs(
    sequence: Sequence, found: list[Failure], runs: Mapping[str, Any], colours: Mapping[str, str]
) -> tuple[list[_Pair], int]:
    """Frames just before and at each failure, as many as there is room for, and how many were left out."""
    together: dict[int, list[Failure]] = {}
    for one in found:
        together.setdefault(one.first, []).append(one)
    wanted = sorted({frame for first in together for frame in (first - 1, first)})
    try:
        pictures = frame_pictures(sequence, runs, colours, wanted)
    except (FrameSourceError, OSError):
        return [], len(found)
    encoded = {frame: base64.b64encode(encode_jpeg(picture)).decode() for frame, picture in pictures.items()}
    pairs: list[_Pair] = []
    room = PICTURE_BYTES
    # The longest first, so that what is left out matters least; shown in the order of frames.
    for frame, failed in sorted(together.items(), key=lambda item: -max(one.last - one.first for one in item[1])):
        room -= len(encoded[frame - 1]) + len(encoded[frame])
        if room < 0:
            break
        pairs.append(_Pair(frame, failed, encoded[frame - 1], encoded[frame]))
    shown = sum(len(pair.failures) for pair in pairs)
    return sorted(pairs, key=lambda pair: pair.frame), len(found) - shown


def _ticks(frames: int) -> list[int]:
    """Round numbers of frames, ten at most."""
    steps = (10**power * part for power in range(9) for part in (1, 2, 5))
    return list(range(0, frames, next(step for step in steps if frames <= 10 * step)))


def _polylines(row: Strip) -> list[str]:
    """IoU over time as the points of lines, broken where no box is scored."""
    step = _WIDTH / len(row.iou)
    lines: list[list[str]] = [[]]
    for frame, value in enumerate(row.iou.tolist()):
        if math.isnan(value):
            lines.append([])
        else:
            lines[-1].append(f"{(frame + 0.5) * step:.1f},{_CHART * (1.0 - value):.1f}")
    return [" ".join(points) for points in lines if points]


def _data(items: list[ScoredRun], rows: list[Strip], fps: float) -> dict[str, Any]:
    """What the page says about a frame when it is clicked on."""
    trackers = {
        row.tracker: {
            "iou": [None if math.isnan(value) else round(value, 3) for value in row.iou.tolist()],
            "state": row.state.tolist(),
            "score": [None if math.isnan(value) else round(value, 3) for value in item.run.trajectory.score.tolist()],
        }
        for item, row in zip(items, rows, strict=True)
    }
    return {"fps": fps, "frames": len(rows[0].iou), "trackers": trackers}


def _text(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)


def _share(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.2f}"
