"""Horn–Schunck optical flow with the call of ``cv2.DenseOpticalFlow`` and the results of MATLAB's ``opticalFlowHS``.

B. K. P. Horn and B. G. Schunck, "Determining Optical Flow", Artificial Intelligence 17 (1981) 185–203,
doi:10.1016/0004-3702(81)90024-2.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames import Frame, InputError, as_pair, fixed_errstate, to_gray
from ..validation import shown
from . import sweeps
from .coarse_to_fine import coarse_to_fine, horn_schunck_solver
from .multigrid import solve
from .params import DERIVATIVES, Derivative, FlowParams, Mode
from .workspace import Workspace

__all__ = ["FlowField", "HornSchunck", "derivatives", "normal_flow"]

Gray = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class FlowField:
    """A flow with the names of MATLAB's ``opticalFlow`` object.

    Parameters
    ----------
    flow : ndarray, shape (H, W, 2), float32
        u to the right and v downwards, px per frame.
    """

    flow: NDArray[np.float32]

    @property
    def Vx(self) -> NDArray[np.float32]:
        """Component to the right, (H, W), px per frame."""
        return self.flow[:, :, 0]

    @property
    def Vy(self) -> NDArray[np.float32]:
        """Component downwards, (H, W), px per frame."""
        return self.flow[:, :, 1]

    @property
    def Orientation(self) -> NDArray[np.float32]:
        """Angle from the x axis towards the (downward) y axis, (H, W), radians in [−π, π]."""
        return np.asarray(np.arctan2(self.Vy, self.Vx), np.float32)

    @property
    def Magnitude(self) -> NDArray[np.float32]:
        """Length, (H, W), px per frame."""
        return np.asarray(np.hypot(self.Vx, self.Vy), np.float32)

    def _repr_png_(self) -> bytes:
        """Directions as hues, speeds as saturation, in Jupyter."""
        from ..display import flow_colours, nice_scale, png

        return png(flow_colours(self.flow, nice_scale(self.Magnitude, floor=0.5)))

    def plot(self, ax: Any = None, *, decimation: int = 8, scale: float = 1.0) -> Any:
        """Draw the flow as arrows with matplotlib, which this alone needs.

        Parameters
        ----------
        ax : matplotlib Axes, optional
            Where to draw; the current axes if absent.
        decimation : int
            Draw one arrow per that many pixels, both ways.
        scale : float
            Length of an arrow over that of its flow.

        Returns
        -------
        matplotlib Axes
        """
        if decimation < 1:
            raise ValueError(f"expected decimation >= 1, got {decimation!r}")
        if ax is None:
            import matplotlib.pyplot as plt

            ax = plt.gca()
        height, width = self.flow.shape[:2]
        y, x = np.mgrid[decimation // 2 : height : decimation, decimation // 2 : width : decimation]
        arrows = self.flow[y, x] * scale
        ax.quiver(x, y, arrows[..., 0], arrows[..., 1], angles="xy", scale_units="xy", scale=1.0)
        ax.set(xlim=(-0.5, width - 0.5), ylim=(height - 0.5, -0.5), aspect="equal")
        return ax


class HornSchunck:
    """Dense optical flow by Horn & Schunck (1981).

    An object keeps the memory it works in from call to call. Threads may share one: each call has memory of its own.

    Parameters
    ----------
    mode : {"classic", "solve", "fast", "default", "accurate"}
        Preset, see :data:`~hs_tracker_cv.flow.params.PRESETS`. "classic": the paper's sweeps (λ = 10, 100 sweeps);
        "solve": the paper's linear system, solved (λ = 10); "fast", "default", "accurate": coarse-to-fine warping
        (λ = 4) for displacements of many pixels.
    smoothness, iterations, levels, ratio, warps, median, presmooth, outlier, exposure, tolerance : optional
    derivative, gain : optional
        Replace a value of the preset, see :class:`FlowParams`. λ is in gray levels of a 0–255 image.

    Raises
    ------
    ValueError
        If the mode is unknown, a value is out of range or has no meaning in the mode.

    Examples
    --------
    >>> import numpy as np
    >>> y, x = np.mgrid[:64, :64]
    >>> frame0 = 128 + 60 * np.sin(x / 5) + 60 * np.cos(y / 7)
    >>> frame1 = 128 + 60 * np.sin((x - 1) / 5) + 60 * np.cos(y / 7)
    >>> flow = HornSchunck().calc(frame0, frame1)
    >>> flow.shape, np.round(flow[32, 32]).tolist()
    ((64, 64, 2), [1.0, 0.0])
    """

    def __init__(
        self,
        mode: Mode = "default",
        *,
        smoothness: float | None = None,
        iterations: int | None = None,
        levels: int | None = None,
        ratio: float | None = None,
        warps: int | None = None,
        median: int | None = None,
        presmooth: float | None = None,
        outlier: float | None = None,
        exposure: bool | None = None,
        tolerance: float | None = None,
        derivative: Derivative | None = None,
        gain: float | None = None,
    ) -> None:
        self.params = FlowParams.preset(
            mode,
            smoothness=smoothness,
            iterations=iterations,
            levels=levels,
            ratio=ratio,
            warps=warps,
            median=median,
            presmooth=presmooth,
            outlier=outlier,
            exposure=exposure,
            tolerance=tolerance,
            derivative=derivative,
            gain=gain,
        )
        self._idle: list[Workspace] = []
        self._previous: Gray | None = None
        self._stream = threading.Lock()

    @fixed_errstate
    def calc(self, I0: Any, I1: Any, flow: Any = None) -> NDArray[np.float32]:
        """Flow from one frame to the next.

        Parameters
        ----------
        I0, I1 : ndarray or cv2.UMat
            Frames as :func:`hs_tracker_cv.frames.as_frame` takes them, of one size; colour is converted to gray.
            Never written to. Values that are not finite read as 0.
        flow : ndarray, shape (H, W, 2), optional
            First guess, px per frame; zero if absent. As with cv2's DIS and Farnebäck, the result is written into it,
            and it is what is returned. An array that cannot hold the result is left as it is, and a new one is
            returned: one of another size, as after a change of video, says nothing; one of another type of real
            numbers is still the first guess.

        Returns
        -------
        ndarray, shape (H, W, 2), float32
            The whole flow, the first guess included: I0[y, x] ≈ I1[y + v, x + u]; u = [..., 0] to the right,
            v = [..., 1] downwards, px per frame.

        Raises
        ------
        InputError
            If a frame cannot be used, the shapes differ or `flow` is read-only or no array of real numbers.
        """
        first, second = _gray_pair(I0, I1, self.params.gain)
        if flow is None:
            return self._calc(first, second, None)
        if not isinstance(flow, np.ndarray) or flow.dtype.kind not in "biuf":
            raise InputError(f"expected flow to be an array of real numbers, got {_kind(flow)}")
        if flow.shape != (*first.shape, 2):
            return self._calc(first, second, None)
        if flow.dtype != np.float32:
            return self._calc(first, second, flow.astype(np.float32, order="C"))
        if not flow.flags.writeable:
            raise InputError(
                "expected flow to be writable, since the result is written into it, got a read-only array"
            )
        if flow.flags.c_contiguous and flow.flags.aligned:
            return self._calc(first, second, flow)
        flow[...] = self._calc(first, second, flow.copy(order="C"))
        return flow

    @fixed_errstate
    def estimate(self, frame: Any) -> FlowField:
        """Flow from the frame of the last call to this one; zero at the first call and after :meth:`reset`.

        Raises
        ------
        InputError
            If the frame cannot be used or its size has changed.
        """
        current, _ = _gray_pair(frame, frame, self.params.gain)
        with self._stream:
            previous = self._previous
            if previous is not None and previous.shape != current.shape:
                raise InputError(f"expected two frames of one size, got {previous.shape} and {current.shape}")
            self._previous = current.copy()
        if previous is None:
            return FlowField(np.zeros((*current.shape, 2), np.float32))
        return FlowField(self._calc(previous, current, None))

    def reset(self) -> None:
        """Forget the previous frame of :meth:`estimate`."""
        self._previous = None

    def collectGarbage(self) -> None:
        """Let the memory go that is kept from call to call, as ``cv2.DenseOpticalFlow`` does."""
        self._idle.clear()

    def _calc(self, first: Gray, second: Gray, guess: NDArray[np.float32] | None) -> NDArray[np.float32]:
        """Flow between frames of one size, into the first guess if there is one."""
        started = guess is not None
        out = np.empty((*first.shape, 2), np.float32) if guess is None else guess
        try:
            workspace = self._idle.pop()
        except IndexError:  # all are at work in other threads
            workspace = Workspace()
        if self.params.mode == "classic":
            sweeps.classic(first, second, out, started, self.params, workspace)
        elif self.params.mode == "solve":
            solve(first, second, out, started, self.params, workspace)
        else:
            solver = horn_schunck_solver(self.params, workspace)
            coarse_to_fine(first, second, solver, out, started, self.params, workspace)
        self._idle.append(workspace)
        return out

    def __getstate__(self) -> dict[str, Any]:
        """State without memory and lock, which a copy has of its own."""
        return {"params": self.params, "_previous": self._previous}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Take over what :meth:`__getstate__` gave. Anybody may have edited it: then this is a ValueError."""
        params, previous = state.get("params"), state.get("_previous")
        if not isinstance(params, FlowParams):
            raise ValueError(f"expected params to be FlowParams, got {shown(params)}")
        try:
            params = replace(params)  # which checks every value
        except TypeError as error:
            raise ValueError(str(error)) from error
        if previous is not None and not _is_gray(previous):
            raise ValueError(f"expected _previous to be a contiguous plane of float32, got {shown(previous)}")
        self.__dict__.update(state, params=params)
        self._idle = []
        self._stream = threading.Lock()


def _gray_pair(first: Any, second: Any, gain: float | None) -> tuple[Gray, Gray]:
    """Both frames in gray levels of one gain; pixels that are so already are passed on, not copied.

    What counts is the numbers, whatever their layout, and none is clipped.
    """
    if gain == 1.0 and _is_gray(first) and _is_gray(second) and first.shape == second.shape:
        return first, second
    one, two = as_pair(first, second, gain)
    return _gray(one), _gray(two)


def _kind(value: Any) -> str:
    return f"dtype {value.dtype}" if isinstance(value, np.ndarray) else type(value).__name__


def _is_gray(image: Any) -> bool:
    """Tell whether kernels can read an image as it is; what follows from that is no more than speed."""
    if type(image) is not np.ndarray or image.dtype != np.float32 or image.ndim != 2 or image.size == 0:
        return False
    return image.flags.c_contiguous and image.flags.aligned


def _gray(frame: Frame) -> Gray:
    values = np.require(frame.pixels, np.float32, ["C", "A"])
    if frame.offset != 0.0:
        values = values - np.float32(frame.offset)
    if frame.gain != 1.0:
        values = values * np.float32(frame.gain)
    return to_gray(values)


@fixed_errstate
def derivatives(I0: Any, I1: Any, derivative: Derivative = "cube") -> tuple[Gray, Gray, Gray]:
    """F_x, F_y and F_t of two frames (step 3 of the paper).

    Parameters
    ----------
    I0, I1 : ndarray or cv2.UMat
        Frames of one size, as :meth:`HornSchunck.calc` takes them.
    derivative : {"cube", "five-tap"}
        "cube": the 2 × 2 × 2 cube, valid at (x + ½, y + ½, t + ½). "five-tap": Barron, Fleet & Beauchemin's
        [1 −8 0 8 −1] / 12 on the mean of both frames and the plain difference in time, valid at (x, y, t + ½).

    Returns
    -------
    Fx, Fy, Ft : ndarray, shape (H, W), float32
        Gray levels (0–255) per px, per px and per frame; F_t is I1 less I0.

    Raises
    ------
    ValueError
        If the name is unknown.
    InputError
        If a frame cannot be used or the sizes differ.
    """
    if derivative not in DERIVATIVES:
        raise ValueError(f"expected derivative to be one of {', '.join(map(repr, DERIVATIVES))}, got {derivative!r}")
    first, second = _gray_pair(I0, I1, None)
    return sweeps.derivatives(first, second, derivative)


@fixed_errstate
def normal_flow(Fx: NDArray[Any], Fy: NDArray[Any], Ft: NDArray[Any]) -> NDArray[np.float32]:
    """Flow along the gradient, −F_t ∇F / |∇F|²: all that one pixel can know (Horn & Schunck 1981, section 3).

    Parameters
    ----------
    Fx, Fy, Ft : ndarray, shape (H, W)
        Derivatives, as :func:`derivatives` gives them.

    Returns
    -------
    ndarray, shape (H, W, 2), float32
        px per frame, u to the right and v downwards; its length is |F_t| / |∇F|. Zero where the gradient is.
    """
    square = np.square(Fx, dtype=np.float32) + np.square(Fy, dtype=np.float32)
    scale = np.divide(-np.asarray(Ft, np.float32), square, out=np.zeros_like(square), where=square > 0.0)
    return np.stack((scale * Fx, scale * Fy), axis=-1, dtype=np.float32, casting="same_kind")
