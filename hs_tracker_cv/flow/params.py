"""What a flow estimate is made with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, get_args

from ..scalars import make_plain
from ..validation import shown

__all__ = ["DERIVATIVES", "PRESETS", "Derivative", "FlowParams", "Mode"]

Mode = Literal["classic", "solve", "fast", "default", "accurate"]
"""Names of the presets."""

Derivative = Literal["cube", "five-tap"]
"""Names of the derivative masks: the paper's 2 × 2 × 2 cube; Barron, Fleet & Beauchemin's 5-tap (1994)."""

DERIVATIVES: tuple[Derivative, ...] = get_args(Derivative)

_PYRAMID_FIELDS = frozenset({"iterations", "levels", "ratio", "warps", "median", "presmooth", "outlier", "exposure"})
_FIELDS_OF_MODE: dict[Mode, frozenset[str]] = {
    "classic": frozenset({"iterations"}),
    "solve": frozenset({"iterations", "tolerance"}),
    "fast": _PYRAMID_FIELDS,
    "default": _PYRAMID_FIELDS,
    "accurate": _PYRAMID_FIELDS,
}
_COMMON_FIELDS = frozenset({"smoothness", "derivative", "gain"})


@dataclass(frozen=True, kw_only=True)
class FlowParams:
    """Parameters of :class:`~hs_tracker_cv.flow.HornSchunck`.

    Parameters
    ----------
    mode : {"classic", "solve", "fast", "default", "accurate"}
        "classic": that many Jacobi sweeps, the paper; "solve": its linear system to a tolerance; the others:
        coarse-to-fine warping.
    smoothness : float
        λ, gray levels of a 0–255 image (λ for 0–1 images is this over 255); the energy and the denominator hold λ².
    derivative : {"cube", "five-tap"}
        Mask of F_x, F_y and F_t. The cube estimates half a pixel to the right and below, half a frame later.
    gain : float or None
        Factor that brings the frames to 0–255. None: by dtype, float frames being read as 0–1 when no value of
        either exceeds 1. Callers with float windows of a known range should pass it: a dark window looks like 0–1.
    iterations : int
        "classic": sweeps; "solve": most sweeps on the finest grid; else accelerated sweeps per warp.
    levels : int
        Most levels of the pyramid, the full resolution included. There are fewer when the shorter side of the
        coarsest would be under 16 px.
    ratio : float
        Side of a level over that of the next finer one, in (0, 1).
    warps : int
        Linearisations per level.
    median : {1, 3, 5}
        Side of the median filter of the flow after each warp, px; 1 is none.
    presmooth : float
        σ of the Gaussian blur (5 taps) of both frames at full resolution, px, in [0, 1].
    outlier : float
        Gray-level difference between a pixel and its warped counterpart at which the pixel's data term counts
        half; 0 counts all pixels alike, as the paper does.
    exposure : bool
        Whether a change of gain and offset of the whole frame between the two, as auto-exposure makes it, is
        estimated and taken off; without that it is taken for motion. A plain ramp that moves looks the same, so
        callers with windows that hold little else should do without.
    tolerance : float
        "solve" stops at this residual over right-hand side (2-norms), or where float32 ends, about 3e-7. The flow's
        own error is larger: 1e-7 keeps it under 1e-4 px for λ ≥ 5.

    Raises
    ------
    TypeError
        If a value that should be a number is not one; NumPy's numbers become Python's.
    ValueError
        If a value is out of range; the message names it.
    """

    mode: Mode
    smoothness: float
    iterations: int
    derivative: Derivative = "cube"
    gain: float | None = None
    levels: int = 1
    ratio: float = 0.65
    warps: int = 1
    median: int = 1
    presmooth: float = 0.0
    outlier: float = 0.0
    exposure: bool = False
    tolerance: float = 1e-7

    def __post_init__(self) -> None:
        """Check every value."""
        make_plain(self)
        _one_of("mode", self.mode, tuple(_FIELDS_OF_MODE))
        _one_of("derivative", self.derivative, DERIVATIVES)
        _one_of("median", self.median, (1, 3, 5))
        _positive("smoothness", self.smoothness)
        _positive("tolerance", self.tolerance)
        if self.gain is not None:
            _positive("gain", self.gain)
        for name in ("iterations", "levels", "warps"):
            _at_least_one(name, getattr(self, name))
        if not 0.0 < self.ratio < 1.0:
            raise ValueError(f"expected ratio in (0, 1), got {self.ratio!r}")
        if not 0.0 <= self.presmooth <= 1.0:
            raise ValueError(f"expected presmooth in [0, 1], got {self.presmooth!r}")
        if not 0.0 <= self.outlier < math.inf:
            raise ValueError(f"expected a finite outlier >= 0, got {self.outlier!r}")

    @classmethod
    def preset(cls, mode: Mode, **overrides: float | str | None) -> FlowParams:
        """Preset of `mode` with the overrides that are not None.

        Raises
        ------
        ValueError
            If the mode is unknown, or an override has no meaning in it.
        """
        _one_of("mode", mode, tuple(PRESETS))
        given = {name: value for name, value in overrides.items() if value is not None}
        known = _COMMON_FIELDS | _FIELDS_OF_MODE[mode]
        for name, value in given.items():
            if name not in known:
                raise ValueError(f"expected only {', '.join(sorted(known))} with mode {mode!r}, got {name}={value!r}")
        return cls(**{**PRESETS[mode], **given})  # type: ignore[arg-type]


def _one_of(name: str, value: object, known: tuple[object, ...]) -> None:
    if not isinstance(value, (str, int)) or value not in known:
        raise ValueError(f"expected {name} to be one of {', '.join(map(repr, known))}, got {shown(value)}")


def _positive(name: str, value: float) -> None:
    if not 0.0 < value < math.inf:
        raise ValueError(f"expected a finite {name} > 0, got {value!r}")


def _at_least_one(name: str, value: int) -> None:
    if value < 1:
        raise ValueError(f"expected an integer {name} >= 1, got {value!r}")


_ALL_LEVELS = 32

PRESETS: dict[Mode, dict[str, float | str | None]] = {
    "classic": {"mode": "classic", "smoothness": 10.0, "iterations": 100},
    "solve": {"mode": "solve", "smoothness": 10.0, "iterations": 5000},
    "fast": {
        "mode": "fast",
        "smoothness": 4.0,
        "derivative": "five-tap",
        "iterations": 15,
        "levels": _ALL_LEVELS,
        "ratio": 0.65,
        "warps": 1,
        "median": 5,
        "presmooth": 0.5,
        "outlier": 10.0,
        "exposure": True,
    },
    "default": {
        "mode": "default",
        "smoothness": 4.0,
        "derivative": "five-tap",
        "iterations": 10,
        "levels": _ALL_LEVELS,
        "ratio": 0.65,
        "warps": 3,
        "median": 5,
        "presmooth": 0.5,
        "outlier": 10.0,
        "exposure": True,
    },
    "accurate": {
        "mode": "accurate",
        "smoothness": 4.0,
        "derivative": "five-tap",
        "iterations": 10,
        "levels": _ALL_LEVELS,
        "ratio": 0.8,
        "warps": 7,
        "median": 5,
        "presmooth": 0.5,
        "outlier": 10.0,
        "exposure": True,
    },
}
"""Parameters of each mode. λ: 10 for the paper's own system; 4 with warping, where coarser levels and the median do
the smoothing. Those of the last three were chosen on Dimetrodon, Grove2, RubberWhale and Urban2 of Middlebury."""
