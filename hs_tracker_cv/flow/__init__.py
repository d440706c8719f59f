"""Horn–Schunck optical flow. Numba is imported when a name of this package is first used, not before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .horn_schunck import FlowParams, HornSchunck, derivatives, normal_flow

__all__ = ["FlowParams", "HornSchunck", "derivatives", "normal_flow"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import horn_schunck

    return getattr(horn_schunck, name)
