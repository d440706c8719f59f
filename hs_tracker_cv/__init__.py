"""Object tracking by motion: a drop-in for OpenCV's trackers built on Horn–Schunck optical flow.

>>> from hs_tracker_cv import TrackerHS_create
>>> tracker = TrackerHS_create()

Names are loaded on first use, so that importing the package costs next to nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from . import legacy
    from .automatic import AutomaticTracker
    from .detection import MotionDetector
    from .display import draw
    from .flow import HornSchunck
    from .frames import InputError
    from .geometry import Box
    from .multi import MultiTrackerHS, MultiTrackerHS_create
    from .params import TrackerHS_Params
    from .stages import PaperMethod
    from .tracker import TrackerHS, TrackerHS_create

__version__ = "0.1.0"

_HOMES = {
    "AutomaticTracker": "automatic",
    "Box": "geometry",
    "HornSchunck": "flow",
    "InputError": "frames",
    "MotionDetector": "detection",
    "MultiTrackerHS": "multi",
    "MultiTrackerHS_create": "multi",
    "PaperMethod": "stages",
    "TrackerHS": "tracker",
    "TrackerHS_Params": "params",
    "TrackerHS_create": "tracker",
    "draw": "display",
}

__all__ = [
    "AutomaticTracker",
    "Box",
    "HornSchunck",
    "InputError",
    "MotionDetector",
    "MultiTrackerHS",
    "MultiTrackerHS_create",
    "PaperMethod",
    "TrackerHS",
    "TrackerHS_Params",
    "TrackerHS_create",
    "__version__",
    "draw",
    "legacy",
]


def __getattr__(name: str) -> Any:
    if name == "legacy":
        return import_module(".legacy", __name__)
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_HOMES[name]}", __name__), name)


def __dir__() -> list[str]:
    return __all__
