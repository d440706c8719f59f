"""Our trackers in the GOT-10k toolkit (``pip install got10k six``).

For example::

from got10k.experiments import ExperimentGOT10k
from eval.clients.got10k import make_tracker

ExperimentGOT10k("data/GOT-10k", subset="val").run(make_tracker("TrackerHS"))
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import Follower

__all__ = ["make_tracker"]


def make_tracker(tracker: str = "TrackerHS", *, first_pixel: int = 0) -> Any:
    """Return a tracker with the interface of the toolkit.

    Parameters
    ----------
    tracker : str, optional
        As for :class:`~eval.clients.Follower`.
    first_pixel : int, optional
        Number of the first pixel in the boxes of the data set: 1 for OTB; 0 for what
        :func:`datasets_synthetic.export.write_got10k` wrote.

    Returns
    -------
    got10k.trackers.Tracker

    Raises
    ------
    ImportError
        If the toolkit is not installed.
    """
    from got10k.trackers import Tracker

    follower, origin = Follower(tracker), np.array([first_pixel, first_pixel, 0, 0], dtype=np.float64)

    class Client(Tracker):  # type: ignore[misc]
        def init(self, image: Any, box: NDArray[np.float64]) -> None:
            follower.init(_bgr(image), tuple(np.asarray(box, dtype=np.float64) - origin))

        def update(self, image: Any) -> NDArray[np.float64]:
            return np.array(follower.update(_bgr(image))[0]) + origin

    return Client(name=follower.name, is_deterministic=follower.deterministic)


def _bgr(image: Any) -> NDArray[np.uint8]:
    """Pixels of a PIL image in cv2's order of channels."""
    return np.ascontiguousarray(np.asarray(image.convert("RGB"))[:, :, ::-1])
