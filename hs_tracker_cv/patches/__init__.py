"""Compiled kernels of the carried box: patches and their filter, the motion in a flow field, what is kept.

Arrays in, arrays out; no checks, no options: :mod:`~hs_tracker_cv.propagation` and
:mod:`~hs_tracker_cv.anchor` call them with C-contiguous float32 arrays.
"""

from __future__ import annotations

from .filtering import foreground, mix, orientations, peak, respond
from .fitting import fit_motion, misfit, register, residual_weights
from .keeping import carry, correlation
from .sampling import normalise, sample, sample_turned

__all__ = [
    "carry",
    "correlation",
    "fit_motion",
    "foreground",
    "misfit",
    "mix",
    "normalise",
    "orientations",
    "peak",
    "register",
    "residual_weights",
    "respond",
    "sample",
    "sample_turned",
]
