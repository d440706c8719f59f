"""The panels of one step: the paper's method on the whole frame, or what the tracker saw in its window."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..display import PANELS, draw_box, draw_panel, render_panels, tile_panels
from ..following import Step
from ..stages import PaperMethod, StageParams

__all__ = ["Panels", "labels"]

_COLUMNS, _WIDTH = 5, 384
_SHOWN = tuple(name for name in PANELS if name != "frame")


class Panels:
    """Draws the panels of the steps of one run, in order.

    Parameters
    ----------
    params : StageParams or None
        What the paper's method is carried out with; None shows the tracker's own window.
    """

    def __init__(self, params: StageParams | None) -> None:
        self._method = PaperMethod(params) if params is not None else None
        self._previous: Any = None

    def draw(self, step: Step) -> NDArray[np.uint8]:
        """All panels in one picture; its size is the same for all frames of a video."""
        if self._method is None:
            return render_panels(step.frame, step.fields, step.box, **labels(step))
        # Before there are two frames nothing has moved.
        previous, self._previous = self._previous, step.frame
        stages = self._method.calc(step.frame if previous is None else previous, step.frame)
        tiles = []
        for name in _SHOWN:
            picture, note = draw_panel(name, stages, width=_WIDTH)
            tiles.append((PANELS[name][0], self._flow if name == "arrows" else note, picture))
        height, width = tiles[0][2].shape[:2]
        overlay = draw_box(step.frame, step.box, **labels(step))
        first = cv2.resize(overlay, (width, height), interpolation=cv2.INTER_AREA)
        return tile_panels([("Frame and box", "", np.asarray(first, np.uint8)), *tiles], columns=_COLUMNS)

    @property
    def _flow(self) -> str:
        assert self._method is not None
        params = self._method.params
        return f"{params.mode}, λ {params.smoothness:g}, {params.iterations} iterations"


def labels(step: Step) -> dict[str, Any]:
    """What is written into a picture of a step."""
    score = None if step.state == "searching" else step.score
    return {"state": step.state, "score": score, "note": f"frame {step.index}"}
