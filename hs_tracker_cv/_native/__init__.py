"""Loops over pixels, in C++: :mod:`.kernels` is compiled from the sources in this folder.

Its functions take arrays of exactly the type and layout that they document, write results into arrays they are given,
and let go of Python's lock meanwhile. They check all that and decide nothing.
"""

from __future__ import annotations

try:
    from . import kernels
    from .kernels import (
        segmentation as _segmentation,  # without the extension, the folder of stubs would pass for the module
    )
except ImportError as error:
    message = "hs_tracker_cv is not built for this Python: run `make native` in a checkout, or install the package"
    raise ImportError(f"{message} ({error})") from error

assert _segmentation

__all__ = ["kernels"]
