"""Where things are at a moment: paths of a point, and the shake of a hand-held camera.

A path is evaluated at a *fraction* of the sequence, 0 at the first frame and 1 at the last, and may be asked for
any fraction in between: the shutter of a blurred frame needs them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .spec import Path

__all__ = ["PATHS", "shake", "triangle"]

Point = tuple[float, float]


def triangle(phase: float) -> float:
    """Triangle wave of period 1: 0 at 0, 1 at one half, 0 again at 1."""
    return 1.0 - abs((phase % 1.0) * 2.0 - 1.0)


def _between(path: Path, share: float) -> Point:
    (x0, y0), (x1, y1) = path.start, path.end
    return x0 + (x1 - x0) * share, y0 + (y1 - y0) * share


def hold(path: Path, s: float) -> Point:
    """Stay at the start."""
    return path.start


def line(path: Path, s: float) -> Point:
    """Go from start to end at constant speed."""
    return _between(path, s)


def ease(path: Path, s: float) -> Point:
    """Go from start to end, speeding up and slowing down."""
    return _between(path, s * s * (3.0 - 2.0 * s))


def weave(path: Path, s: float) -> Point:
    """Go from start to end on a sine of `amplitude` px across the line, `cycles` times."""
    (x0, y0), (x1, y1) = path.start, path.end
    length = math.hypot(x1 - x0, y1 - y0) or 1.0
    offset = path.amplitude * math.sin(2.0 * math.pi * path.cycles * s)
    x, y = _between(path, s)
    return x - (y1 - y0) / length * offset, y + (x1 - x0) / length * offset


def bounce(path: Path, s: float) -> Point:
    """Go there and back `cycles` times at constant speed."""
    return _between(path, triangle(path.cycles * s))


def swing(path: Path, s: float) -> Point:
    """Go there and back `cycles` times as a pendulum does."""
    return _between(path, 0.5 - 0.5 * math.cos(2.0 * math.pi * path.cycles * s))


def stop_and_go(path: Path, s: float) -> Point:
    """Go from start to end in `cycles` stretches, each followed by a rest of the same duration."""
    stretch, within = divmod(s * path.cycles, 1.0)
    go = min(within * 2.0, 1.0)
    return _between(path, (stretch + go * go * (3.0 - 2.0 * go)) / path.cycles)


def orbit(path: Path, s: float) -> Point:
    """Go round an ellipse `cycles` times: `start` is its centre, `end` the corner of its quarter."""
    (cx, cy), (ex, ey) = path.start, path.end
    angle = 2.0 * math.pi * path.cycles * s
    return cx + (ex - cx) * math.cos(angle), cy + (ey - cy) * math.sin(angle)


def knots(path: Path, s: float) -> Point:
    """Go through `knots`, each (fraction, x, y), in straight stretches of constant speed."""
    fractions, xs, ys = zip(*path.knots, strict=True)
    return float(np.interp(s, fractions, xs)), float(np.interp(s, fractions, ys))


PATHS: dict[str, Callable[[Path, float], Point]] = {
    "hold": hold,
    "line": line,
    "ease": ease,
    "weave": weave,
    "bounce": bounce,
    "swing": swing,
    "stop_and_go": stop_and_go,
    "orbit": orbit,
    "knots": knots,
}


def shake(frames: int, sigma: float, seed: int) -> NDArray[np.float64]:
    """Offsets of a hand-held camera.

    Parameters
    ----------
    frames : int
    sigma : float
        Standard deviation of the offset, px.
    seed : int

    Returns
    -------
    ndarray, shape (frames, 2)
        Offset (x, y), px: noise that remembers half of its last value, as a hand does.
    """
    noise = np.random.default_rng([seed, 77]).standard_normal((frames, 2))
    memory = 0.5
    for t in range(1, frames):
        noise[t] = memory * noise[t - 1] + math.sqrt(1.0 - memory**2) * noise[t]
    return noise * sigma
