"""`TrackerHS`: the tracker with the interface of ``cv2.Tracker``.

It checks what a user hands over, and nothing else: :mod:`~hs_tracker_cv.arbitration` decides. It is the only mutable
object of a track: what is known of the target is a :class:`~hs_tracker_cv.arbitration.Track`, replaced as a whole
after each frame, so that a frame that cannot be used leaves no trace.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import arbitration
from .arbitration import Choice, Track, TrackerState
from .flow import derivatives, normal_flow
from .frames import Frame, InputError, as_frame, as_roi, downloaded, fixed_errstate, is_dropped, next_frame
from .geometry import Box
from .params import TrackerHS_Params
from .validation import shown, validate

__all__ = ["TrackerDebug", "TrackerHS", "TrackerHS_create", "TrackerState"]

NOWHERE = (0, 0, 0, 0)
"""The box that cv2's trackers return with ``False``."""

STATE_VERSION = 9
"""Of what a pickle of a tracker holds; a change of any class in it changes the number."""


@dataclass(frozen=True)
class TrackerDebug:
    """What the last update saw and thought: the panels of the paper's window.

    Parameters
    ----------
    window : Box
        The window worked in, frame px.
    step : float
        Frame pixels per window pixel.
    previous, current : ndarray, shape (H, W), float32
        The window in the last two frames, gray, 0–255.
    Fx, Fy, Ft : ndarray, shape (H, W), float32
        Derivatives over the 2×2×2 cube.
    flow : ndarray, shape (H, W, 2), float32
        Window px per frame.
    normal_flow : ndarray, shape (H, W, 2), float32
    mask : ndarray of bool, shape (H, W), or None
        Pixels of the object; None when the box was carried by flow.
    choice : Choice
        The measurement behind the mode that answered.
    """

    window: Box
    step: float
    previous: NDArray[np.float32]
    current: NDArray[np.float32]
    Fx: NDArray[np.float32]
    Fy: NDArray[np.float32]
    Ft: NDArray[np.float32]
    flow: NDArray[np.float32]
    normal_flow: NDArray[np.float32]
    mask: NDArray[np.bool_] | None
    choice: Choice

    def _repr_png_(self) -> bytes:
        """Its panels, in Jupyter."""
        from .display import draw, png

        return png(draw(self))


class TrackerHS:
    """Track one object by its motion; put it where a ``cv2.TrackerCSRT`` stood.

    The object is found by Horn–Schunck optical flow, without training or model file, and may rotate, deform, glint or
    change its surface. Duck-typed: it is not a subclass of ``cv2.Tracker``, since OpenCV does not support that and
    crashes.

    Parameters
    ----------
    parameters : TrackerHS_Params, optional
        Copied: later changes to it do not reach the tracker.

    Raises
    ------
    TypeError
        For parameters of another kind, as those of OpenCV's trackers.

    Examples
    --------
    >>> import numpy as np
    >>> from hs_tracker_cv import TrackerHS_create
    >>> frame = np.random.default_rng(0).integers(0, 255, (120, 160, 3), dtype=np.uint8)
    >>> tracker = TrackerHS_create()
    >>> tracker.init(frame, (40, 30, 32, 24))
    >>> tracker.update(frame)
    (True, (40, 30, 32, 24))
    """

    Params = TrackerHS_Params

    def __init__(self, parameters: TrackerHS_Params | None = None) -> None:
        if not isinstance(parameters, TrackerHS_Params | None):
            raise TypeError(f"expected TrackerHS_Params, got {shown(parameters)}")
        self._parameters = TrackerHS_Params.from_dict((parameters or TrackerHS_Params()).to_dict())
        self._track: Track | None = None

    def __getstate__(self) -> dict[str, Any]:
        """State for pickle and copy."""
        return {**self.__dict__, "version": STATE_VERSION}

    @fixed_errstate
    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over what :meth:`__getstate__` gave. Anybody may have edited it: then this is a ValueError."""
        version = state.get("version") if isinstance(state, dict) else None
        if version != STATE_VERSION:
            raise ValueError(f"expected a TrackerHS pickled in version {STATE_VERSION}, got version {shown(version)}")
        own = {name: value for name, value in state.items() if name != "version"}
        parameters = own.get("_parameters")
        if not isinstance(parameters, TrackerHS_Params):
            raise ValueError(f"expected _parameters to be TrackerHS_Params, got {shown(parameters)}")
        parameters = TrackerHS_Params.from_dict(parameters.to_dict())  # which knows types and ranges
        validate(own.get("_track", "nothing"), Track | None, "_track")
        if own["_track"] is not None and not own["_track"].follows(parameters):
            raise ValueError(f"expected a track as of {parameters}, got one of other modes or numbers")
        self.__dict__.update(own)

    @classmethod
    def create(cls, parameters: TrackerHS_Params | None = None) -> TrackerHS:
        """Return a new tracker, as ``cv2.TrackerCSRT.create`` does."""
        return cls(parameters)

    @fixed_errstate
    def init(self, image: Any, boundingBox: Any) -> None:
        """Start tracking what is inside a box; whatever was tracked before is forgotten.

        Parameters
        ----------
        image : ndarray or cv2.UMat
            Gray (H, W) or (H, W, 1), BGR (H, W, 3) or BGRA (H, W, 4); of any real type, in any memory layout. It
            is neither kept nor written to.
        boundingBox : sequence of 4 numbers
            x, y, w, h in px. What lies outside the frame is cut off.

        Raises
        ------
        InputError
            If image or box cannot be used (a ``cv2.error`` and a ``ValueError``); the tracker is then
            uninitialised.
        """
        self._track = None
        frame = as_frame(image, self._parameters.gain)
        self._track = arbitration.start(frame, as_roi(boundingBox, frame), self._parameters)

    @fixed_errstate
    def update(self, image: Any) -> tuple[bool, tuple[int, int, int, int]]:
        """Find the object in the next frame.

        Parameters
        ----------
        image : ndarray or cv2.UMat
            Of the size and channel count of the frame given to `init`. None or an empty image (a dropped frame)
            is answered with False, and changes nothing.

        Returns
        -------
        ok : bool
            True when the object is located. False when it is lost, occluded or out of view; it is searched for
            in the frames that follow.
        box : tuple of 4 int
            x, y, w, h in px; zeros where `ok` is False. :attr:`box` is the same with sub-pixel precision.

        Raises
        ------
        InputError
            Before a successful `init`, or for an image that cannot belong to the same video; the track is
            as if the call had not been made.
        """
        track = _started(self._track)
        frame = _next(track, image)
        if frame is None:
            return False, NOWHERE
        if track.first is None or not track.first.is_repeated(frame):
            track = self._track = arbitration.advance(track, frame)
        return (True, track.box.rounded()) if track.state == "tracking" else (False, NOWHERE)

    @fixed_errstate
    def check(self, image: Any) -> None:
        """Raise what `update` would raise for an image; nothing changes.

        Raises
        ------
        InputError
            As :meth:`update` does.
        """
        _next(_started(self._track), image)

    def getTrackingScore(self) -> float:
        """Confidence in the last answer, in [0, 1]; 0 before a successful `init`."""
        return self._track.score if self._track else 0.0

    @property
    def parameters(self) -> TrackerHS_Params:
        """A copy of the options in force."""
        return TrackerHS_Params.from_dict(self._parameters.to_dict())

    @property
    def initialised(self) -> bool:
        """True after a successful `init`."""
        return self._track is not None

    @property
    def box(self) -> Box | None:
        """Where the object is, with sub-pixel precision; where it was last, while lost; None before `init`."""
        return self._track.box if self._track else None

    @property
    def state(self) -> TrackerState:
        """``"tracking"``, ``"occluded"`` or ``"lost"``; ``"uninitialised"`` before a successful `init`."""
        return self._track.state if self._track else "uninitialised"

    @fixed_errstate
    def debug(self) -> TrackerDebug:
        """What the last update saw and thought.

        Raises
        ------
        InputError
            Before the first update.
        """
        track = self._track
        if track is None or track.first is not None:
            raise InputError("debug needs an update first")
        seen = track.leading
        previous, current = seen.grays
        fx, fy, ft = derivatives(previous, current)
        return TrackerDebug(
            window=seen.window,
            step=seen.step,
            previous=previous,
            current=current,
            Fx=fx,
            Fy=fy,
            Ft=ft,
            flow=seen.flow,
            normal_flow=normal_flow(fx, fy, ft),
            mask=None if seen.mask is None else seen.mask.astype(bool),
            choice=track.choice,
        )


def _started(track: Track | None) -> Track:
    if track is None:
        raise InputError("update needs a successful init first")
    return track


def _next(track: Track, image: Any) -> Frame | None:
    """Check that an image can be the next frame of this video; None for a frame that was dropped."""
    image = downloaded(image)
    return None if is_dropped(image) else next_frame(image, track.video)


def TrackerHS_create(parameters: TrackerHS_Params | None = None) -> TrackerHS:
    """Return a new :class:`TrackerHS`, as ``cv2.TrackerCSRT_create`` does."""
    return TrackerHS(parameters)
