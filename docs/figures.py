"""Draws the figure of docs/algorithm.md: ``python -m docs.figures``."""

from __future__ import annotations

from html import escape
from pathlib import Path

WIDTH, HEIGHT = 990, 470
INK, PAPER = "#1f2933", "#ffffff"
FILLS = {
    "data": "#eef2f7",
    "segmentation": "#dbeafe",
    "patch_tracker": "#fde7d3",
    "arbitration": "#dcfce7",
    "lost": "#fee2e2",
}

BOXES = {
    # name: (x, y, width, height, fill, heading, lines)
    "frame": (20, 40, 120, 60, "data", "frame", ("any cv2 image",)),
    "overview": (180, 40, 150, 60, "data", "overview", ("still the scene?",)),
    "segmentation": (380, 20, 300, 120, "segmentation", "segmentation · segmentation.step", (
        "window → predicted motion → flow",
        "→ motions of object and ground",
        "→ which explains each pixel? → mask",
        "→ box, occlusion → learn both layers",
    )),
    "patch_tracker": (380, 210, 300, 100, "patch_tracker", "patch tracker · patch_tracker.step", (
        "correlation filter: place",
        "→ flow and keyframes: size",
        "→ believe? → learn",
    )),
    "arbitration": (750, 80, 220, 100, "arbitration", "arbitration", (
        "doubt → which leads",
        "chance of being right → score",
        "below 0.25: not believed",
    )),
    "answer": (750, 240, 220, 50, "data", "(ok, box), score, state", ()),
    "tracking": (750, 370, 220, 56, "arbitration", "tracking", ("ok is True",)),
    "occluded": (460, 370, 180, 56, "lost", "occluded", ("hidden by something",)),
    "lost": (180, 370, 180, 56, "lost", "lost", ("unseen, or not believed",)),
    "redetection": (20, 210, 300, 100, "lost", "while lost · redetection.find", (
        "what is new in the frame, and has",
        "the object's colours? The filter looks",
        "at three more places per frame.",
    )),
}  # fmt: skip

ARROWS = (
    # points, words, where the words stand, how they are anchored
    (((140, 70), (180, 70)), "", (0, 0), ""),
    (((330, 70), (380, 70)), "yes", (354, 62), "middle"),
    (((350, 70), (350, 240), (380, 240)), "", (0, 0), ""),
    (((255, 100), (255, 150)), "no: answered False", (255, 166), "middle"),
    (((590, 140), (590, 210)), "rides on the segment,", (584, 170), "end"),
    (((620, 210), (620, 140)), "asked every 8th frame", (584, 186), "end"),
    (((680, 80), (715, 80), (715, 115), (750, 115)), "", (0, 0), ""),
    (((680, 260), (715, 260), (715, 145), (750, 145)), "", (0, 0), ""),
    (((860, 180), (860, 240)), "", (0, 0), ""),
    (((860, 290), (860, 370)), "", (0, 0), ""),
    (((750, 390), (640, 390)), "", (0, 0), ""),
    (((640, 408), (750, 408)), "", (0, 0), ""),
    (((460, 398), (360, 398)), "", (0, 0), ""),
    (((820, 370), (820, 340), (320, 340), (320, 370)), "", (0, 0), ""),
    (((240, 370), (240, 310)), "", (0, 0), ""),
    (((320, 280), (380, 280)), "where", (350, 272), "middle"),
    (
        ((270, 426), (270, 450), (860, 450), (860, 426)),
        "found again: both modes start anew there",
        (560, 444),
        "middle",
    ),
)


def main() -> None:
    """Write the figure."""
    path = Path(__file__).with_name("algorithm.svg")
    path.write_text(figure(), encoding="utf-8")
    print(path)


def figure() -> str:
    """Compose the picture as SVG; it stands on its own, in light and dark pages."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}" '
        'font-family="system-ui, sans-serif" font-size="13" role="img" aria-label="From a frame to a box">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        f'<path d="M0 0 L8 4 L0 8 Z" fill="{INK}"/></marker></defs>',
        f'<rect width="{WIDTH}" height="{HEIGHT}" rx="8" fill="{PAPER}"/>',
        *(_arrow(*arrow) for arrow in ARROWS),
        *(_box(*box) for box in BOXES.values()),
        "</svg>",
    ]
    return "\n".join(parts) + "\n"


def _box(x: int, y: int, width: int, height: int, fill: str, heading: str, lines: tuple[str, ...]) -> str:
    top = y + (height - 18 * (len(lines) + 1)) / 2 + 14
    words = [_text(x + width / 2, top, heading, bold=True)]
    words += [_text(x + width / 2, top + 18 * k, line) for k, line in enumerate(lines, 1)]
    return (
        f'<rect x="{x}" y="{y}" width="{width}" height="{height}" rx="6" fill="{FILLS[fill]}" stroke="{INK}"/>\n'
        + "\n".join(words)
    )


def _arrow(points: tuple[tuple[int, int], ...], words: str, place: tuple[int, int], anchor: str) -> str:
    way = " ".join(f"{x},{y}" for x, y in points)
    line = f'<polyline points="{way}" fill="none" stroke="{INK}" stroke-width="1.4" marker-end="url(#tip)"/>'
    return line + (f"\n{_text(*place, words, anchor=anchor, size=12)}" if words else "")


def _text(x: float, y: float, words: str, *, bold: bool = False, anchor: str = "middle", size: int = 13) -> str:
    weight = ' font-weight="600"' if bold else ""
    return (
        f'<text x="{x:g}" y="{y:g}" text-anchor="{anchor}" font-size="{size}" fill="{INK}"{weight}>'
        f"{escape(words)}</text>"
    )


if __name__ == "__main__":
    main()
