"""Trackers of OpenCV, as it ships them; KCF and TrackerVit also as good versions of themselves."""

from __future__ import annotations

import os
from typing import Any

import cv2
from numpy.typing import NDArray

__all__ = [
    "KCF", "VIT_DEVIATIONS", "InColour", "Network", "PrimedKCF", "csrt", "dasiamrpn", "median_flow", "mil", "mosse",
    "nano", "vit", "vit_normalised",
]  # fmt: skip

VIT_DEVIATIONS = (0.07433, -0.07598, -0.07565, 0.0)
"""`stdvalue` of TrackerVit with which its input is normalised as in its training."""

_MIL_AREA = 20  # px; OpenCV 4.8 and 5.0 hang at many boxes of 18 and less

_cv2: Any = cv2  # its stubs leave out the contrib modules


def csrt() -> Any:
    """CSRT as OpenCV ships it."""
    return _cv2.TrackerCSRT_create()


class _MIL:
    """MIL with boxes refused for which OpenCV looks for features that do not exist, for ever."""

    def __init__(self) -> None:
        self._tracker = _cv2.TrackerMIL_create()

    def init(self, image: NDArray[Any], box: tuple[int, int, int, int]) -> None:
        if min(box[2:]) < 2 or box[2] * box[3] < _MIL_AREA:
            raise ValueError(f"expected a box of at least {_MIL_AREA} px, 2 px wide and high, got {box}")
        self._tracker.init(image, box)

    def update(self, image: NDArray[Any]) -> tuple[bool, tuple[int, int, int, int]]:
        ok, box = self._tracker.update(image)
        return ok, box


def mil() -> Any:
    """MIL as OpenCV ships it, but for boxes at which it hangs; differs from run to run."""
    return _MIL()


def mosse() -> Any:
    """MOSSE of ``cv2.legacy``."""
    return _cv2.legacy.TrackerMOSSE_create()


def median_flow() -> Any:
    """MedianFlow of ``cv2.legacy``."""
    return _cv2.legacy.TrackerMedianFlow_create()


class InColour:
    """A tracker that raises on gray frames: it gets them in three channels, as a user does after the exception."""

    def __init__(self, tracker: Any) -> None:
        self._tracker = tracker

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start."""
        self._tracker.init(_in_colour(image), boundingBox)

    def update(self, image: NDArray[Any]) -> tuple[bool, Any]:
        """Locate the target."""
        ok, box = self._tracker.update(_in_colour(image))
        return ok, box


class Network(InColour):
    """A tracker that is made of networks, and says how sure it is."""

    def getTrackingScore(self) -> float:
        """Score of the last update."""
        return float(self._tracker.getTrackingScore())


def nano(backbone: str, neckhead: str) -> Network:
    """TrackerNano as OpenCV ships it, with its two networks."""
    parameters = _cv2.TrackerNano_Params()
    parameters.backbone, parameters.neckhead = backbone, neckhead
    return Network(_cv2.TrackerNano_create(parameters))


def vit(net: str) -> Network:
    """TrackerVit as OpenCV ships it."""
    parameters = _cv2.TrackerVit_Params()
    parameters.net = net
    return Network(_cv2.TrackerVit_create(parameters))


def vit_normalised(net: str) -> Network:
    """TrackerVit with the colours that its network was trained on.

    OpenCV 4.13 and 5.0 divide two of three channels by another deviation than they were trained with; these values
    of `stdvalue` undo that.
    """
    parameters = _cv2.TrackerVit_Params()
    parameters.net, parameters.stdvalue = net, VIT_DEVIATIONS
    return Network(_cv2.TrackerVit_create(parameters))


def dasiamrpn(model: str, kernel_cls1: str, kernel_r1: str) -> Network:
    """DaSiamRPN as OpenCV ships it, with its three networks.

    It asks for layers in the middle of a network, which the engine of OpenCV 5 does not know (opencv/opencv#26201):
    there the classic engine serves the whole process, if no network was read in it before.
    """
    os.environ["OPENCV_FORCE_DNN_ENGINE"] = "1"
    parameters = _cv2.TrackerDaSiamRPN_Params()
    parameters.model, parameters.kernel_cls1, parameters.kernel_r1 = model, kernel_cls1, kernel_r1
    return Network(_cv2.TrackerDaSiamRPN_create(parameters))


class KCF(InColour):
    """KCF as OpenCV ships it; never recovers from the motion between its init and its first update."""

    def __init__(self) -> None:
        super().__init__(_cv2.TrackerKCF_create())


class PrimedKCF(InColour):
    """KCF at its best: it detects from the first update on, and never gives up.

    As shipped it does not detect in its first update, and is off ever after by the motion up to there; an update
    on the frame of `init` cures it. A detection threshold of 0 keeps it from giving up at its first low peak.
    """

    def __init__(self) -> None:
        parameters = _cv2.TrackerKCF_Params()
        parameters.detect_thresh = 0.0
        super().__init__(_cv2.TrackerKCF_create(parameters))

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Start, and prime."""
        super().init(image, boundingBox)
        self.update(image)


def _in_colour(image: NDArray[Any]) -> NDArray[Any]:
    return cv2.cvtColor(image, cv2.COLOR_GRAY2BGR) if image.ndim == 2 or image.shape[2] == 1 else image
