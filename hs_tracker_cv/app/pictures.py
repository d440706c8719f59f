"""What the page shows and hands out as pictures."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..display import PANELS, STATE_COLOURS, draw_box, draw_boxes, draw_layers, draw_panel
from ..stages import Stages
from .tracks import OURS, Silhouette, Track

__all__ = ["COLOURS", "LAYERS", "TITLES", "Panel", "colour", "draw", "draw_tracks", "picture_url"]

Picture = NDArray[np.uint8]

LAYERS = "layers"
TITLES: dict[str, tuple[str, str]] = {**PANELS, LAYERS: ("Object and ground", "TrackerHS, not in the paper")}
"""Of every panel: title, and where the paper has it."""

COLOURS: dict[str, tuple[int, int, int]] = {
    OURS: STATE_COLOURS["tracking"],
    "CSRT": (255, 150, 60),
    "KCF": (80, 160, 255),
    "MIL": (220, 110, 220),
    "MOSSE": (80, 230, 240),
    "MedianFlow": (210, 210, 130),
    "TrackerNano": (130, 110, 255),
}
"""Of each tracker, BGR."""
INK = (235, 232, 228)

FLOWS = frozenset({"arrows", "colours"})
THRESHOLDED = frozenset({"threshold", "segmentation", "corners"})


@dataclass(frozen=True)
class Panel:
    """One panel, drawn.

    Parameters
    ----------
    name : str
        A key of TITLES.
    title : str
        What it shows, and by which method.
    note : str
        What its colours and lengths mean.
    picture : ndarray, shape (H, W, 3), uint8
    """

    name: str
    title: str
    note: str
    picture: Picture


def draw(name: str, stages: Stages, frame: Any, silhouette: Silhouette | None, width: int) -> Panel:
    """Draw one panel; `silhouette` is what LAYERS shows."""
    title, place = TITLES[name]
    title = f"{title} · {place}"
    if name != LAYERS:
        picture, note = draw_panel(name, stages, width=width)
        return Panel(name, title, "; ".join(part for part in (_method(name, stages), note) if part), picture)
    if silhouette is None:
        height, columns = stages.current.shape
        blank = np.full((max(round(width * height / columns), 1), width, 3), 30, np.uint8)
        return Panel(name, title, "nothing is segmented in this frame", blank)
    return Panel(name, title, "", draw_layers(frame, silhouette.window, silhouette.mask, width=width))


def _method(name: str, stages: Stages) -> str:
    """Which flow, and which threshold, a panel comes from."""
    params = stages.params
    if name in FLOWS:
        return f"{params.mode}, λ {params.smoothness:g}, {params.iterations} iterations, whole frame"
    if name in THRESHOLDED:
        return f"normal flow ≥ {params.threshold:g} px per frame"
    return f"σ {params.smoothing:g} px" if name == "frame" else ""


def colour(name: str) -> str:
    """Of a tracker, for a style sheet."""
    blue, green, red = COLOURS[name]
    return f"#{red:02x}{green:02x}{blue:02x}"


def draw_tracks(frame: Any, tracks: list[Track], index: int) -> Picture:
    """A frame with what each track has found in it; with one track as `hs-track` draws it."""
    found = [(track, step) for track in tracks if (step := track.at(index)) is not None]
    if len(found) == 1 and found[0][0].name == OURS:
        step = found[0][1]
        return draw_box(frame, step.box, state=step.state, score=step.score, note=f"frame {index}")
    several = len({track.number for track, _ in found}) > 1
    # Ours last, so that it is on top.
    boxes = [
        (step.box, COLOURS[track.name], str(track.number) if several else "")
        for track, step in sorted(found, key=lambda pair: pair[0].name == OURS)
        if step.box is not None
    ]
    names = dict.fromkeys(track.name for track, _ in found)
    return draw_boxes(frame, boxes, notes=[(f"frame {index}", INK), *((name, COLOURS[name]) for name in names)])


def picture_url(image: Any, *, lossless: bool = False) -> str:
    """Encode an image into an address a browser shows without asking the server again."""
    suffix, kind, options = (".png", "png", []) if lossless else (".jpg", "jpeg", [cv2.IMWRITE_JPEG_QUALITY, 88])
    encoded = cv2.imencode(suffix, image, options)[1].tobytes()
    return f"data:image/{kind};base64,{base64.b64encode(encoded).decode('ascii')}"
