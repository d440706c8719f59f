"""The inner loops of the two-layer model, in Numba: arrays in, arrays out; no checks, no options.

Images are (h, w, 3) float32 windows, planes (h, w) float32; all C-contiguous and of one window size. `inside` is
(x0, y0, x1, y1): the part of the window that lies inside the frame, in window pixels, end exclusive.
An affine displacement is a[0..5]: q = p + (a0 + a1 X + a2 Y, a3 + a4 X + a5 Y) with X = (x − cx) / scale, Y alike,
and `grid` is (cx, cy, scale).
"""

from __future__ import annotations

from .colour import bin_colours
from .common import FAR_OFF, KNOWN
from .evidence import evidence
from .labelling import label
from .memory import learn
from .registration import collect, fit_affine, gauss_newton, median_flow, search_shift, start_flow
from .windows import carry, fill_new, open_ground, outline, resample, shift, smooth

__all__ = [
    "FAR_OFF",
    "KNOWN",
    "bin_colours",
    "carry",
    "collect",
    "evidence",
    "fill_new",
    "fit_affine",
    "gauss_newton",
    "label",
    "learn",
    "median_flow",
    "open_ground",
    "outline",
    "resample",
    "search_shift",
    "shift",
    "smooth",
    "start_flow",
]
