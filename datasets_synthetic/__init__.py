"""The laboratory: videos whose truth is known exactly because we drew them."""

from .draw import draw, draw_mixed
from .parameters import parameters
from .plain import from_plain, to_plain
from .render import Truth, frames, render, truth
from .sequence import Sequence
from .spec import SequenceSpec
from .suites import SUITES, canonical, suite

__all__ = [
    "SUITES", "Sequence", "SequenceSpec", "Truth", "canonical", "draw", "draw_mixed", "frames", "from_plain",
    "parameters", "render", "suite", "to_plain", "truth",
]  # fmt: skip
