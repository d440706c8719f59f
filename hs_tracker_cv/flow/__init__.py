"""Horn–Schunck optical flow."""

from __future__ import annotations

from .horn_schunck import FlowField, HornSchunck, derivatives, normal_flow
from .params import FlowParams, Mode

__all__ = ["FlowField", "FlowParams", "HornSchunck", "Mode", "derivatives", "normal_flow"]
