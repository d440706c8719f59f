"""The paper's linear system solved to a tolerance: what infinitely many sweeps of it would give."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from . import kernels
from .params import FlowParams
from .program import Program, ProgramWriter, area, chebyshev, origin, spare

__all__ = ["GridPlan", "plan", "solve"]

COARSEST = 4
"""Shortest side of the coarsest grid, px."""

SWEEPS = 6
"""Sweeps on the finest grid after full multigrid and at the end of a cycle."""

RADIUS = 0.8
"""Upper end of the spectrum that their weights are made for; what is slower, coarser grids do."""

SWEEPS_ALONE = 8
"""Sweeps without coarser grids where these no longer help much: what they bring is rounded."""

RADIUS_ALONE = 0.97
"""Upper end of the spectrum that their weights are made for."""

Size = tuple[int, int]


class GridPlan(NamedTuple):
    """What does not change from frame to frame: sizes of the grids, the finest first; memory in floats; programs.

    `begin` makes the systems, `guess` loads a first guess and `full` makes one by full multigrid; `smooth`, a few
    sweeps, `cycle`, a V cycle, and `sweeps`, more of them, improve it; `finish` stores it.
    """

    sizes: tuple[Size, ...]
    memory: int
    begin: Program
    guess: Program
    full: Program
    smooth: Program
    cycle: Program
    sweeps: Program
    finish: Program


@lru_cache(maxsize=256)
def plan(height: int, width: int, five: bool, smoothness: float) -> GridPlan:
    """Plan the solution for frames of height × width px."""
    sizes = [(height, width)]
    while min(sizes[-1]) > COARSEST:
        h, w = sizes[-1]
        sizes.append(((h + 1) // 2, (w + 1) // 2))
    grids = _Grids(tuple(sizes), five, smoothness)
    parts = (grids.begin, grids.guess, grids.full, grids.smooth, grids.cycle, grids.sweeps, grids.finish)
    return GridPlan(grids.sizes, grids.memory, *(part() for part in parts))


class _Grids:
    """Layout of the memory, and a program for each part of the solution.

    The finest grid has two pairs of planes for the flow, g = F / √D and D / λ²; each coarse one nine planes: J and b
    of the system u − ū + J u = b (five), and two pairs.
    """

    def __init__(self, sizes: tuple[Size, ...], five: bool, smoothness: float) -> None:
        self.sizes = sizes
        self.five = five
        self.smoothness = smoothness
        self.size = sizes[0]
        self.d = area(self.size)
        self.pair, self.other, self.slopes = (origin(self.size) + self.d * i for i in (0, 2, 4))
        self.bases = [self.pair]
        end = 8 * self.d
        for coarse in sizes[1:]:
            self.bases.append(end + origin(coarse))
            end += 9 * area(coarse)
        self.memory = end + spare(self.size)

    def begin(self) -> Program:
        """Program for the finest system and the coarse ones; its sum is that of the squared right-hand side."""
        writer = ProgramWriter()
        for frame in range(2):
            writer.load(frame, self.other + frame * self.d, self.size)
        first, second = self.other, self.other + self.d
        options: Any = {"factors": (self.smoothness,), "rings": 4, "zero": True}
        writer.add(kernels.SCALED, self.size, first, self.slopes, second, self.d, int(self.five), **options)
        for level in range(1, len(self.sizes)):
            coarse, fine, base = self.sizes[level], self.sizes[level - 1], self.bases[level]
            if level == 1:
                numbers = self.slopes, base, 0, self.d, area(coarse)
                writer.add(kernels.PROJECT, coarse, *numbers, source_width=fine[1])
            else:
                for i in range(5):
                    source = self.bases[level - 1] + i * area(fine)
                    writer.add(kernels.RESTRICT, coarse, source, base + i * area(coarse), source_width=fine[1])
            writer.add(kernels.PAD, coarse, 0, base, 0, area(coarse), rings=5, zero=True)
        return writer.program()

    def guess(self) -> Program:
        """Program that loads a first guess."""
        writer = ProgramWriter()
        writer.load_flow(self.pair, self.d, self.size)
        return writer.program()

    def full(self) -> Program:
        """Program for full multigrid: from the coarsest grid up, one V cycle on each but the finest."""
        writer = ProgramWriter()
        if len(self.sizes) == 1:
            writer.clear(self.pair, self.d, self.size)
        for level in reversed(range(1, len(self.sizes))):
            self._cycle(writer, level, guessed=level + 1 < len(self.sizes))
            self._prolong(writer, level, self._pair(level - 1), add=False)
        return writer.program()

    def smooth(self) -> Program:
        """Program for a few sweeps; its sum is the squared residual's before the last one."""
        writer = ProgramWriter()
        self._sweeps(writer, SWEEPS, RADIUS)
        return writer.program()

    def cycle(self) -> Program:
        """Program for a V cycle from the finest grid; its sum is the squared residual's before its last sweep."""
        writer = ProgramWriter()
        if len(self.sizes) > 1:
            numbers = self.pair, self.other, self.slopes, self.d
            writer.add(kernels.RESIDUAL, self.size, *numbers, rings=2, zero=True)
            self._restrict(writer, 0, self.other)
            self._cycle(writer, 1, guessed=False)
            self._prolong(writer, 1, self.pair)
        self._sweeps(writer, SWEEPS, RADIUS)
        return writer.program()

    def sweeps(self) -> Program:
        """Program for sweeps alone; its sum is the squared residual's before the last one."""
        writer = ProgramWriter()
        self._sweeps(writer, SWEEPS_ALONE, RADIUS_ALONE)
        return writer.program()

    def finish(self) -> Program:
        """Program that stores the flow."""
        writer = ProgramWriter()
        writer.store_flow(self.pair, self.d, self.size)
        return writer.program()

    def _cycle(self, writer: ProgramWriter, first: int, *, guessed: bool) -> None:
        """Run one V(1, 1) cycle from level `first`, whose first guess is zero unless it is `guessed`."""
        top = len(self.sizes) - 1
        for level in range(first, top):
            pair, other = self._pair(level), self._pair(level, 1)
            self._coarse_sweep(writer, level, pair, other, guessed=guessed and level == first)
            self._coarse_residual(writer, level, other, pair)
            self._restrict(writer, level, pair)
        pair, other = self._pair(top), self._pair(top, 1)
        writer.clear(pair, area(self.sizes[top]), self.sizes[top])
        self._coarse_sweep(writer, top, pair, other, repeat=8)
        for level in reversed(range(first, top)):
            pair, other = self._pair(level), self._pair(level, 1)
            self._prolong(writer, level + 1, other)
            self._coarse_sweep(writer, level, other, pair)

    def _pair(self, level: int, which: int = 0) -> int:
        """Return the first plane of a grid's pair of planes 0 or 1."""
        return self.bases[level] + (2 * which + (5 if level else 0)) * area(self.sizes[level])

    def _sweeps(self, writer: ProgramWriter, number: int, highest: float) -> None:
        """Sweep an even number of times, so that the result is where it was.

        The last one looks at the residual, which costs less than to compute it afterwards.
        """
        planes = self.slopes, self.d
        writer.sweep(self.pair, self.other, *planes, self.size, number - 1, chebyshev(highest))
        writer.add(kernels.MEASURED_SWEEP, self.size, self.other, self.pair, *planes, rings=2)

    def _coarse_sweep(
        self, writer: ProgramWriter, level: int, pair: int, out: int, *, guessed: bool = True, repeat: int = 1
    ) -> None:
        size, base = self.sizes[level], self.bases[level]
        options: Any = {"factors": (float(guessed),), "repeat": repeat, "rings": 2}
        writer.add(kernels.COARSE_SWEEP, size, pair, out, base, area(size), **options)

    def _coarse_residual(self, writer: ProgramWriter, level: int, pair: int, out: int) -> None:
        size, base = self.sizes[level], self.bases[level]
        writer.add(kernels.COARSE_RESIDUAL, size, pair, out, base, area(size), rings=2, zero=True)

    def _restrict(self, writer: ProgramWriter, level: int, pair: int) -> None:
        """Make the next coarser grid's right-hand side of the residual in `pair`."""
        fine, coarse = self.sizes[level], self.sizes[level + 1]
        for i in range(2):
            target = self.bases[level + 1] + (3 + i) * area(coarse)
            writer.add(kernels.RESTRICT, coarse, pair + i * area(fine), target, source_width=fine[1])

    def _prolong(self, writer: ProgramWriter, level: int, pair: int, *, add: bool = True) -> None:
        """Add a grid's solution to `pair` of the next finer one, or make it that."""
        coarse, fine = self.sizes[level], self.sizes[level - 1]
        options: Any = {"source_width": coarse[1], "factors": (float(add),), "rings": 1}
        for i in range(2):
            source = self._pair(level) + i * area(coarse)
            writer.add(kernels.PROLONG, fine, source, pair + i * area(fine), **options)


def solve(
    frame0: NDArray[np.float32],
    frame1: NDArray[np.float32],
    flow: NDArray[np.float32],
    started: bool,
    params: FlowParams,
    grids: GridPlan,
    memory: NDArray[np.float32],
) -> tuple[float, int]:
    """Solve for the flow between two frames (H, W, 1) into `flow` (H, W, 2).

    Full multigrid, or with `started` the first guess that `flow` holds; a few sweeps; then V cycles, and
    sweeps alone where those become slow.

    Returns
    -------
    residual : float
        Over the right-hand side, 2-norms; before the last sweep, which makes it smaller still.
    sweeps : int
        On the finest grid.
    """
    arrays = (memory, frame0, frame1, flow)
    right = math.sqrt(grids.begin.run(*arrays))
    if right == 0.0:
        flow[...] = 0.0
        return 0.0, 0
    (grids.guess if started else grids.full).run(*arrays)
    goal = params.tolerance * right
    norm = math.sqrt(grids.smooth.run(*arrays))
    done = SWEEPS
    while done < params.iterations and norm > goal:
        before = norm
        norm = math.sqrt(grids.cycle.run(*arrays))
        done += SWEEPS
        slow = norm > 0.1 * before
        while slow and norm > goal and done < params.iterations:
            last = norm
            norm = math.sqrt(grids.sweeps.run(*arrays))
            done += SWEEPS_ALONE
            slow = norm < 0.3 * last
        if norm > 0.7 * before:  # as good as float32 gets
            break
    grids.finish.run(*arrays)
    return norm / right, done
