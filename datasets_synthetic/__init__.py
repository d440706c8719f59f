"""The laboratory: videos whose truth is known exactly because we drew them."""

from .render import render
from .sequence import Sequence
from .spec import SequenceSpec
from .suites import SUITES

__all__ = ["SUITES", "Sequence", "SequenceSpec", "render"]
