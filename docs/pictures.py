"""Draws the picture of README: ``python -m docs.pictures``."""

from __future__ import annotations

from pathlib import Path

import cv2

from datasets_synthetic import SUITES, render
from hs_tracker_cv import TrackerHS_create
from hs_tracker_cv.display import render_panels

SEQUENCE, FRAME = "car", 40


def main() -> None:
    """Track one sequence of `standard` and draw the panels of one update."""
    (spec,) = (spec for spec in SUITES["standard"] if spec.name == SEQUENCE)
    sequence = render(spec)
    tracker = TrackerHS_create()
    tracker.init(sequence.frames[0], tuple(sequence.boxes[0]))
    for frame in sequence.frames[1 : FRAME + 1]:
        tracker.update(frame)
    picture = render_panels(
        frame, tracker.debug(), tracker.box, state=tracker.state, score=tracker.getTrackingScore()
    )
    path = Path(__file__).with_name("panels.png")
    cv2.imwrite(str(path), picture)
    print(path)


if __name__ == "__main__":
    main()
