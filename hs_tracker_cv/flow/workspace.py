"""Memory that the flow works in, kept from call to call."""

from __future__ import annotations

from collections.abc import Hashable

from .._native.kernels import Multigrid, Planes

__all__ = ["Workspace"]


class Workspace:
    """Planes by name, and the grids of the last size. One serves one computation at a time."""

    def __init__(self) -> None:
        self._planes: dict[Hashable, Planes] = {}
        self._grids: Multigrid | None = None
        self._size = (0, 0)

    def planes(self, name: Hashable, count: int, size: tuple[int, int]) -> Planes:
        """So many planes of size (height, width), px, with undefined content; those of the last call of that name."""
        planes = self._planes.get(name)
        if planes is None:
            planes = self._planes[name] = Planes(count, *size)
        else:
            planes.resize(count, *size)
        return planes

    def grids(self, size: tuple[int, int]) -> Multigrid:
        """Grids of a frame of size (height, width), px."""
        if self._grids is None or self._size != size:
            self._grids, self._size = Multigrid(*size), size
        return self._grids
