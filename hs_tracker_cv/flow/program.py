"""Programs for :func:`.kernels.run`: which loops to run over which planes, in which order."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import kernels

__all__ = ["JACOBI", "Chebyshev", "Program", "ProgramWriter", "chebyshev"]

Chebyshev = tuple[float, float]
"""Relaxation of a sweep, and a quarter of the squared radius of the relaxed sweep's spectrum."""

JACOBI: Chebyshev = (1.0, 0.0)
"""Plain sweeps."""

LOWEST = -1.0 / 3.0
"""Lower end of the spectrum of a sweep, which the weights of the average give."""


def chebyshev(highest: float) -> Chebyshev:
    """Weights of accelerated sweeps for a spectrum in [−1/3, `highest`]."""
    low, high, two = np.float32(LOWEST), np.float32(highest), np.float32(2.0)
    relax = two / (two - low - high)
    radius = (high - low) / (two - low - high)
    return float(relax), float(np.float32(0.25) * radius * radius)


class Program(NamedTuple):
    """Steps and their factors, see :func:`.kernels.run`."""

    steps: NDArray[np.uint64]
    factors: NDArray[np.float32]

    def run(
        self,
        memory: NDArray[np.float32],
        frame0: NDArray[np.float32],
        frame1: NDArray[np.float32],
        flow: NDArray[np.float32],
    ) -> float:
        """Run on the frames (H, W, 1) and the flow (H, W, 2); return the last step's sum, if it has one."""
        return float(kernels.run(self.steps, self.factors, memory, frame0, frame1, flow))


class ProgramWriter:
    """Collects steps."""

    def __init__(self) -> None:
        self._steps: list[tuple[int, ...]] = []
        self._factors: list[tuple[float, ...]] = []

    def add(
        self,
        code: np.uint64,
        size: tuple[int, int],
        a: int = 0,
        b: int = 0,
        c: int = 0,
        d: int = 0,
        e: int = 0,
        f: int = 0,
        *,
        source_width: int = 0,
        factors: tuple[float, ...] = (),
        repeat: int = 1,
        rings: int = 0,
        zero: bool = False,
    ) -> None:
        """Append a step; `rings` planes from `b` on have their ring filled, from the border or by 0."""
        strides = stride(size[1]), stride(source_width)
        self._steps.append((int(code), *size, strides[0], a, b, c, d, e, f, strides[1], repeat, rings))
        self._factors.append((*factors, *(0.0,) * (kernels.FACTORS - 1 - len(factors)), 0.0 if zero else 1.0))

    def program(self) -> Program:
        """Return the steps so far."""
        steps = np.array(self._steps, np.uint64).reshape(-1, kernels.COLUMNS)
        return Program(steps, np.array(self._factors, np.float32).reshape(-1, kernels.FACTORS))

    def load(self, frame: int, plane: int, size: tuple[int, int]) -> None:
        """Load frame 0 or 1."""
        self.add(kernels.LOAD, size, frame, plane, rings=1)

    def load_flow(self, pair: int, d: int, size: tuple[int, int]) -> None:
        """Load the flow into a pair of planes."""
        self.add(kernels.LOAD_FLOW, size, 0, pair, d=d, rings=2)

    def store_flow(self, pair: int, d: int, size: tuple[int, int]) -> None:
        """Store a pair of planes as the flow."""
        self.add(kernels.STORE_FLOW, size, pair, d=d)

    def clear(self, pair: int, d: int, size: tuple[int, int]) -> None:
        """Set a pair of planes to zero, rings and all."""
        for plane in (pair, pair + d):
            self.add(kernels.FILL, size, area(size), plane - origin(size))

    def sweep(
        self, pair: int, other: int, g: int, d: int, size: tuple[int, int], repeat: int, weights: Any
    ) -> tuple[int, int]:
        """Sweep `repeat` times from pair to pair; return the pair that holds the result, and the other."""
        self.add(kernels.SWEEP, size, pair, other, g, d, factors=weights, repeat=repeat, rings=2)
        return (pair, other) if repeat % 2 == 0 else (other, pair)

    def resample(
        self,
        a: int,
        size: tuple[int, int],
        b: int,
        target: tuple[int, int],
        row: int,
        *,
        gain: float = 1.0,
        taps: tuple[float, float, float] = (1.0, 0.0, 0.0),
    ) -> None:
        """Resize a plane after a blur by `taps` (centre, neighbours, next neighbours)."""
        self.add(kernels.RESAMPLE, target, a, b, row, 0, *size, source_width=size[1], factors=(gain, *taps), rings=1)


def stride(width: int) -> int:
    """Elements from one row to the next: a multiple of 16, and room for at least 16 elements more than pixels.

    An odd multiple, since rows that are a power of two apart would share a few lines of the cache.
    """
    return ((width + 31) // 16 | 1) * 16


def area(size: tuple[int, int]) -> int:
    """Elements of a plane with its ring and the room round it; an odd multiple of 16, for the reason rows have it."""
    return ((size[0] + 4) * (stride(size[1]) // 16) | 1) * 16


def origin(size: tuple[int, int]) -> int:
    """Elements before a plane's first pixel."""
    return 2 * stride(size[1]) + 16


def pixels(memory: NDArray[np.float32], plane: int, size: tuple[int, int]) -> NDArray[np.float32]:
    """View of the plane with that first pixel."""
    rows = memory[plane : plane + size[0] * stride(size[1])]
    return rows.reshape(size[0], -1)[:, : size[1]]


def spare(size: tuple[int, int]) -> int:
    """Elements after the last plane, which blocks that stick out of it may touch."""
    return 2 * stride(size[1]) + 64
