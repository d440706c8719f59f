"""Horn–Schunck optical flow with the call of ``cv2.DenseOpticalFlow``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..frames import InputError, as_frame, crop, to_gray
from . import kernels

__all__ = ["FlowParams", "HornSchunck", "derivatives", "normal_flow"]

DERIVATIVES = ("cube", "five-tap")
MIN_LEVEL_SIDE = 16


@dataclass(frozen=True, kw_only=True)
class FlowParams:
    """What a flow estimate is made with.

    Parameters
    ----------
    mode : str
        "classic", "solve", "fast", "default" or "accurate".
    smoothness : float
        λ, in gray levels of a 0–255 image; the energy holds λ².
    iterations : int
        Sweeps: in all for "classic", at most for "solve", per warp for the others.
    levels : int
        Most levels of the pyramid; fewer when the coarsest would be under 16 px.
    ratio : float
        Side of a level over the side of the next finer one, in (0, 1).
    warps : int
        Linearisations per level.
    median : int
        Side of the median filter after each warp, px: 0 (none), 3 or 5.
    tolerance : float
        Relative residual at which "solve" stops.
    derivative : str
        "cube" (2 × 2 × 2, the paper) or "five-tap" (Barron, Fleet & Beauchemin 1994).
    """

    mode: str
    smoothness: float
    iterations: int
    levels: int = 1
    ratio: float = 0.65
    warps: int = 1
    median: int = 0
    tolerance: float = 0.0
    derivative: str = "cube"


PRESETS: dict[str, FlowParams] = {
    "classic": FlowParams(mode="classic", smoothness=10.0, iterations=100),
    "solve": FlowParams(mode="solve", smoothness=10.0, iterations=2000, tolerance=1e-3),
    "fast": FlowParams(
        mode="fast", smoothness=5.0, iterations=10, levels=32, warps=1, median=5, derivative="five-tap"
    ),
    "default": FlowParams(
        mode="default", smoothness=7.0, iterations=10, levels=32, warps=3, median=5, derivative="five-tap"
    ),
    "accurate": FlowParams(
        mode="accurate", smoothness=4.5, iterations=10, levels=32, ratio=0.8, warps=10, median=5, derivative="five-tap"
    ),
}


class HornSchunck:
    """Dense flow between two frames."""

    def __init__(
        self,
        mode: str = "default",
        *,
        smoothness: float | None = None,
        iterations: int | None = None,
        levels: int | None = None,
        ratio: float | None = None,
        warps: int | None = None,
        median: int | None = None,
        tolerance: float | None = None,
        derivative: str | None = None,
    ) -> None:
        if mode not in PRESETS:
            raise ValueError(f"expected mode to be one of {', '.join(PRESETS)}, got {mode!r}")
        given = {
            "smoothness": smoothness,
            "iterations": iterations,
            "levels": levels,
            "ratio": ratio,
            "warps": warps,
            "median": median,
            "tolerance": tolerance,
            "derivative": derivative,
        }
        self.params = replace(PRESETS[mode], **{k: v for k, v in given.items() if v is not None})
        self._work = np.zeros(0, np.float32)

    def calc(self, I0: Any, I1: Any, flow: Any = None) -> NDArray[np.float32]:  # noqa: N803
        """Flow from I0 to I1."""
        frame0, frame1 = _gray(I0), _gray(I1)
        if frame0.shape != frame1.shape:
            raise InputError(f"expected two frames of one shape, got {frame0.shape} and {frame1.shape}")
        h, w = frame0.shape
        out = np.zeros((h, w, 2), np.float32)
        if flow is not None:
            if np.shape(flow) != out.shape:
                raise InputError(f"expected a start flow of shape {out.shape}, got {np.shape(flow)}")
            out[...] = flow
        p = self.params
        five = p.derivative == "five-tap"
        plane = (h + 4) * (w + 4)
        if p.mode in ("classic", "solve"):
            self._reserve(kernels.FLOW_PLANES * plane)
            kernels.jacobi(
                frame0[:, :, None], frame1[:, :, None], out, self._work, five, p.iterations, np.float32(p.smoothness)
            )
            return out
        sizes, total = _level_sizes(h, w, p.levels, p.ratio)
        self._reserve(kernels.FLOW_PLANES * plane + 2 * (w + 4) + 4 * total)
        kernels.coarse_to_fine(
            frame0[:, :, None], frame1[:, :, None], out, flow is not None, sizes, self._work, five, p.warps, p.iterations, _RHO, p.median,
            np.float32(p.smoothness), *_TAPS,
        )  # fmt: skip
        return out

    def _reserve(self, size: int) -> None:
        if self._work.size < size:
            self._work = np.zeros(size, np.float32)

    def __getstate__(self) -> dict[str, Any]:
        """State without the workspace, which the copy makes anew."""
        return {**self.__dict__, "_work": np.zeros(0, np.float32)}


def _gaussian(sigma: float) -> tuple[np.float32, ...]:
    taps = np.exp(-0.5 * (np.arange(3) / sigma) ** 2)
    return tuple(np.float32(t) for t in taps / (taps[0] + 2 * taps[1:].sum()))


_TAPS = _gaussian(0.6)
_RHO = np.float32(0.97)


@lru_cache(maxsize=4096)
def _level_sizes(h: int, w: int, levels: int, ratio: float) -> tuple[NDArray[np.uint64], int]:
    sizes = [(h, w)]
    while len(sizes) < levels:
        scale = ratio ** len(sizes)
        size = (round(h * scale), round(w * scale))
        if min(size) < MIN_LEVEL_SIDE:
            break
        sizes.append(size)
    return np.array(sizes, np.uint64), sum((a + 4) * (b + 4) for a, b in sizes)


def _gray(image: Any) -> NDArray[np.float32]:
    if isinstance(image, np.ndarray) and image.dtype == np.float32 and image.ndim == 2 and image.flags.c_contiguous:
        return image
    frame = as_frame(image)
    return to_gray(crop(frame, 0, 0, frame.width, frame.height))


def derivatives(I0: Any, I1: Any, derivative: str = "cube") -> NDArray[np.float32]:  # noqa: N803
    """F_x, F_y, F_t as one array (3, H, W) float32."""
    frame0, frame1 = _gray(I0), _gray(I1)
    if derivative not in DERIVATIVES:
        raise ValueError(f"expected derivative to be one of {', '.join(DERIVATIVES)}, got {derivative!r}")
    h, w = frame0.shape
    out = np.empty((h, w, 3), np.float32)
    work = np.zeros(5 * (h + 4) * (w + 4), np.float32)
    kernels.write_derivatives(frame0[:, :, None], frame1[:, :, None], derivative == "five-tap", out, work)
    return out


def normal_flow(Fx: NDArray[Any], Fy: NDArray[Any], Ft: NDArray[Any]) -> NDArray[np.float32]:  # noqa: N803
    """−F_t ∇F / |∇F|², (H, W, 2) float32; zero where the gradient is."""
    square = Fx * Fx + Fy * Fy
    scale = np.divide(-Ft, square, out=np.zeros_like(square), where=square > 0)
    return np.asarray(np.stack((scale * Fx, scale * Fy), axis=-1), np.float32)
