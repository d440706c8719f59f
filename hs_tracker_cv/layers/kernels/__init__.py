"""The inner loops of the two-layer model, in Numba: arrays in, arrays out; no checks, no options.

Images are (h, w, 3) float32 windows, planes (h, w) float32; all C-contiguous and of one window size. `inside` is
(x0, y0, x1, y1): the part of the window that lies inside the frame, in window pixels, end exclusive.
An affine displacement is a[0..5]: q = p + (a0 + a1 X + a2 Y, a3 + a4 X + a5 Y) with X = (x − cx) / scale, Y alike,
and `grid` is (cx, cy, scale).
"""

from __future__ import annotations

from .colour import bin_colours, blend, likelihood
from .common import FAR_OFF, KNOWN
from .evidence import evidence, explain
from .labelling import label
from .memory import learn
from .motion import foresee, measure, search_shift, start_flow
from .registration import collect, gauss_newton, residual
from .shapes import components, invert, median, spread, widen, widen_cross, without
from .windows import carry, move_ground, move_object, resample, shift, smooth

__all__ = [
    "FAR_OFF",
    "KNOWN",
    "bin_colours",
    "blend",
    "carry",
    "collect",
    "components",
    "evidence",
    "explain",
    "foresee",
    "gauss_newton",
    "invert",
    "label",
    "learn",
    "likelihood",
    "measure",
    "median",
    "move_ground",
    "move_object",
    "resample",
    "residual",
    "search_shift",
    "shift",
    "smooth",
    "spread",
    "start_flow",
    "widen",
    "widen_cross",
    "without",
]
