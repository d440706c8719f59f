"""Coarse-to-fine warping: the displacement is found on small frames first and refined level by level."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from . import kernels
from .params import FlowParams
from .program import JACOBI, Program, ProgramWriter, area, chebyshev, origin, spare, stride

__all__ = ["PyramidPlan", "plan", "slopes"]

MIN_SIDE = 16
"""Shortest side of a level, px."""

BLUR = 0.68
"""Blur before a level is reduced, in units of √(1/ratio² − 1) px: less lets high frequencies fold back."""

RADIUS = 0.97
"""Upper end of the spectrum that Chebyshev's weights are made for; what is slower, coarser levels have done."""

Size = tuple[int, int]
Taps = tuple[float, float, float]


class PyramidPlan(NamedTuple):
    """What does not change from frame to frame: sizes of the levels, the finest first; memory in floats; program."""

    sizes: tuple[Size, ...]
    memory: int
    program: Program


@lru_cache(maxsize=1024)
def plan(height: int, width: int, params: FlowParams, started: bool = False) -> PyramidPlan:
    """Plan the flow between frames of height × width px, from a first guess if `started`."""
    sizes = [(height, width)]
    while len(sizes) < params.levels:
        scale = params.ratio ** len(sizes)
        size = (round(height * scale), round(width * scale))
        if min(size) < MIN_SIDE:
            break
        sizes.append(size)
    writer = _Writer(tuple(sizes), params, started)
    return PyramidPlan(writer.sizes, writer.memory, writer.write())


class _Writer(ProgramWriter):
    """Writes the program.

    With a first guess each level warps by its reduced copy plus the increment found so far, so that its detail is not
    lost on the way through the levels. Mode "classic", the paper's own method, has one level and warps nothing.
    """

    def __init__(self, sizes: tuple[Size, ...], params: FlowParams, started: bool) -> None:
        super().__init__()
        self.sizes = sizes
        self.params = params
        self.started = started
        self.d = area(sizes[0])
        self.pair, self.other, self.slopes, self.warped, self.mask, self.row = (
            origin(sizes[0]) + self.d * i for i in (0, 2, 4, 7, 8, 10)
        )
        self.levels = []  # of each: frame 0, frame 1, start u, start v
        end = self.row + 12 * stride(sizes[0][1])
        for size in sizes:
            self.levels.append(end + origin(size))
            end += (4 if started else 2) * area(size)
        self.memory = end + spare(sizes[0])

    def write(self) -> Program:
        """Write it all."""
        self._finest()
        for level in range(1, len(self.sizes)):
            self._reduce(level)
        for level in reversed(range(len(self.sizes))):
            self._start(level)
            for _ in range(self.params.warps):
                self._linearise(level)
                self._solve(level)
            if self.started and level:
                self._add_start(level, -1.0)
        self.store_flow(self.pair, self.d, self.sizes[0])
        return self.program()

    def _finest(self) -> None:
        """Load frames and first guess."""
        size, base = self.sizes[0], self.levels[0]
        for frame in range(2):
            if self.params.presmooth:
                self.load(frame, self.pair, size)
                taps = _gaussian(self.params.presmooth)
                self.resample(self.pair, size, base + frame * self.d, size, self.row, taps=taps)
            else:
                self.load(frame, base + frame * self.d, size)
        if self.started:
            self.load_flow(base + 2 * self.d, self.d, size)

    def _reduce(self, level: int) -> None:
        """Make a level from the next finer one."""
        fine, coarse = self.sizes[level - 1], self.sizes[level]
        gains = (1.0, 1.0, coarse[1] / fine[1], coarse[0] / fine[0])
        taps = _gaussian(BLUR * (1.0 / self.params.ratio**2 - 1.0) ** 0.5)
        for i in range(4 if self.started else 2):
            source, target = self.levels[level - 1] + i * area(fine), self.levels[level] + i * area(coarse)
            self.resample(source, fine, target, coarse, self.row, gain=gains[i], taps=taps)

    def _start(self, level: int) -> None:
        """Begin a level with the flow of the next coarser one."""
        size = self.sizes[level]
        if level + 1 == len(self.sizes):
            self.clear(self.pair, self.d, size)
        else:
            coarse = self.sizes[level + 1]
            for i, gain in ((0, size[1] / coarse[1]), (self.d, size[0] / coarse[0])):
                self.resample(self.pair + i, coarse, self.other + i, size, self.row, gain=gain)
            self.pair, self.other = self.other, self.pair
        if self.started:
            self._add_start(level, 1.0)

    def _add_start(self, level: int, factor: float) -> None:
        size = self.sizes[level]
        for i in range(2):
            start = self.levels[level] + (2 + i) * area(size)
            self.add(kernels.ADD, size, start, self.pair + i * self.d, factors=(factor,), rings=1)

    def _linearise(self, level: int) -> None:
        """Take the derivatives of a level's frames, the second warped by the flow so far."""
        size, params, d = self.sizes[level], self.params, self.d
        first = self.levels[level]
        second = first + area(size)
        five = int(params.derivative == "five-tap")
        if params.mode == "classic":
            self.add(kernels.SCALED, size, first, self.slopes, second, d, five, factors=(params.smoothness,))
            return
        self.add(kernels.WARP, size, second, self.warped, self.pair, d, self.mask, self.row, rings=1)
        self.add(kernels.DERIVE, size, first, self.slopes, self.warped, d, five)
        outlier = 1.0 / params.outlier**2 if params.outlier else 0.0
        factors = (params.smoothness, outlier)
        self.add(kernels.NORMALISE, size, self.slopes, 0, self.mask, d, self.pair, factors=factors)

    def _solve(self, level: int) -> None:
        """Sweep, and take the median."""
        size, params, d = self.sizes[level], self.params, self.d
        weights = JACOBI if params.mode == "classic" else chebyshev(RADIUS)
        self.pair, self.other = self.sweep(self.pair, self.other, self.slopes, d, size, params.iterations, weights)
        if params.median > 1:
            for i in (0, d):
                self.add(kernels.MEDIAN, size, self.pair + i, self.other + i, e=params.median, rings=1)
            self.pair, self.other = self.other, self.pair


def _gaussian(sigma: float) -> Taps:
    """Weights of the centre and of the neighbours 1 and 2 px away; they sum to 1 over the five."""
    taps = np.exp(-0.5 * (np.arange(3) / sigma) ** 2)
    centre, near, far = (taps / (taps[0] + 2.0 * (taps[1] + taps[2]))).tolist()
    return centre, near, far


def slopes(height: int, width: int, derivative: str) -> PyramidPlan:
    """Plan the derivatives of frames of height × width px, into the first three planes of the memory."""
    size, d = (height, width), area((height, width))
    first = origin(size)
    writer = ProgramWriter()
    for frame in range(2):
        writer.load(frame, first + (3 + frame) * d, size)
    five = int(derivative == "five-tap")
    writer.add(kernels.DERIVE, size, first + 3 * d, first, first + 4 * d, d, five)
    return PyramidPlan((size,), 5 * d + spare(size), writer.program())
