"""Who leads: segmentation or the patch tracker; and what is answered where neither sees the object.

`table.py` is the behaviour: states × events, and what is done in each. `actions.py` holds what it names, `choice.py`
the measurements that decide, `track.py` what is known between frames, `rooms.py` the modes, which are injected.
"""

from __future__ import annotations

from .choice import Choice
from .table import advance
from .track import Track, TrackerState, start

__all__ = ["Choice", "Track", "TrackerState", "advance", "start"]
