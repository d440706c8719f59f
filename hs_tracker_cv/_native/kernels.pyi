"""What module.cpp binds."""

import numpy as np
from numpy.typing import NDArray

Float32 = NDArray[np.float32]

def level() -> str:
    """Name of the instruction set that kernels use: "v2", "v3" or "v4" (of x86-64), or "plain"."""

def levels() -> list[str]:
    """Names of those that this processor can run, the most capable last."""

def use_level(name: str) -> None:
    """Use another one from now on, in all threads; results are the same bits.

    Raises
    ------
    ValueError
        If it is not one of :func:`levels`.
    """

class Planes:
    """So many images (height, width) of float32 in one piece of memory, zero at first, laid out for the kernels.

    Parameters
    ----------
    count, height, width : int

    Raises
    ------
    ValueError
        If one of them is less than 1.
    """

    def __init__(self, count: int, height: int, width: int) -> None: ...
    def __len__(self) -> int: ...
    def __getitem__(self, plane: int) -> Float32:
        """One image; the array shares memory with it."""

def load(image: Float32, planes: Planes, plane: int) -> None:
    """Copy an image (height, width) into a plane; what is not finite becomes 0."""
