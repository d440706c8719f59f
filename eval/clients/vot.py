"""Our trackers in the VOT toolkit, over its TraX protocol (``pip install vot-trax``).

In ``trackers.ini`` of the workspace::

    [TrackerHS]
    label = TrackerHS
    protocol = trax
    command = python -m eval.clients.vot TrackerHS
    env_PYTHONPATH = /path/of/the/checkout
"""

from __future__ import annotations

import sys

import cv2
import numpy as np
from numpy.typing import NDArray

from . import Follower

__all__ = ["main", "serve"]


def serve(tracker: str = "TrackerHS") -> None:
    """Answer the toolkit until it says that it is done.

    Parameters
    ----------
    tracker : str, optional
        As for :class:`~eval.clients.Follower`.

    Raises
    ------
    ImportError
        If TraX is not installed.
    ValueError
        If the toolkit names an image that cannot be read.
    """
    import trax

    follower = Follower(tracker)
    with trax.Server([trax.Region.RECTANGLE], [trax.Image.PATH], tracker_name=follower.name) as server:
        while (request := server.wait()).type != trax.TraxStatus.QUIT:
            image = _read(request.image[trax.ImageChannel.COLOR].path())
            confidence = 1.0
            if request.type == trax.TraxStatus.INITIALIZE:
                box = request.objects[0][0].bounds()
                follower.init(image, box)
            else:
                box, confidence = follower.update(image)
            server.status([(trax.Rectangle.create(*box), {"confidence": confidence})])


def _read(path: str) -> NDArray[np.uint8]:
    image = cv2.imread(path, cv2.IMREAD_COLOR)
    if image is None:
        raise ValueError(f"cannot read the frame {path}")
    return np.asarray(image, dtype=np.uint8)


def main() -> int:
    """Serve the tracker that the command line names."""
    serve(*sys.argv[1:2])
    return 0


if __name__ == "__main__":
    sys.exit(main())
