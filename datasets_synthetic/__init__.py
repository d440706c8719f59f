"""The laboratory: videos whose truth is known exactly because we drew them."""

from .crowd import crowd
from .draw import draw, draw_mixed
from .parameters import parameters
from .plain import from_plain, to_plain
from .render import Truth, frames, objects, render, truth
from .sequence import Sequence
from .spec import SequenceSpec
from .suites import SUITES, canonical, suite
from .sweeps import SWEEPS

__all__ = [
    "SUITES", "SWEEPS", "Sequence", "SequenceSpec", "Truth", "canonical", "crowd", "draw", "draw_mixed", "frames",
    "from_plain", "objects", "parameters", "render", "suite", "to_plain", "truth",
]  # fmt: skip
