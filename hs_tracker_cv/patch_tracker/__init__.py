"""The box carried by the dense flow inside it: for parts, stops and moving cameras.

Each frame, in patches resampled round the box so that the object always has the same size in samples:

1. *Find*: a correlation filter on a wide window says where the object is, and how sure that is.
2. *Carry*: the Horn–Schunck flow between the previous and the present fine patch, fitted robustly by a
   translation and a scale, moves and resizes the box.
3. *Hold*: the flow from stored keyframes to the present patch takes out the drift of summed increments.
4. *Judge*: the chance that this is right decides whether to follow, to learn, to coast or to search.
5. *Keep*: the flow also says how much of what was in the box is still in it. A target that turns looks like nothing
   that was learned, but its surface goes on in the box; one that is hidden is replaced by what comes from outside.

All functions are pure: a state goes in, a new one comes out, and no array of the old one is written to.
"""

from __future__ import annotations

from .state import PatchTrackerEstimate, PatchTrackerParams, PatchTrackerState, belongs
from .tracking import dismiss, ride, seek, start, step, teach, turned

__all__ = [
    "PatchTrackerEstimate",
    "PatchTrackerParams",
    "PatchTrackerState",
    "belongs",
    "dismiss",
    "ride",
    "seek",
    "start",
    "step",
    "teach",
    "turned",
]
