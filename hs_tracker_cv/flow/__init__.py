"""Horn–Schunck optical flow. What computes is imported when a name that needs it is first used, not before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from .params import FlowParams

if TYPE_CHECKING:
    from .horn_schunck import FlowField, HornSchunck, derivatives, normal_flow

__all__ = ["FlowField", "FlowParams", "HornSchunck", "derivatives", "normal_flow"]


def __getattr__(name: str) -> Any:
    """Import what is asked for (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from . import horn_schunck

    return getattr(horn_schunck, name)
