"""What all kernels of this room share: the types of their arrays, how they may round, a few numbers."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ...compiling import kernel, part

Image = Annotated[NDArray[np.float32], 3]
Plane = Annotated[NDArray[np.float32], 2]
Mask = Annotated[NDArray[np.uint8], 2]
Masks = Annotated[NDArray[np.uint8], 3]
Runs = Annotated[NDArray[np.int32], 2]
Bins = Annotated[NDArray[np.int16], 2]
Row = Annotated[NDArray[np.float32], 1]
Numbers = Annotated[NDArray[np.float64], 1]
Integers = Annotated[NDArray[np.int64], 1]

# Nothing here may be NaN: frames.crop has removed what is not finite. 'nnan' and 'ninf' stay off all the same.
_FAST = {"contract", "reassoc", "nsz", "arcp"}
fast_kernel = kernel(fastmath=_FAST)
fast_part = part(fastmath=_FAST)

# Samples after which a background pixel is known; until then it must stay as it is from frame to frame.
KNOWN = np.float32(3.0)

# Gray levels; where two images differ by more, it counts as this much.
FAR_OFF = 40.0


@fast_part
def select(values, n, share):
    """The value below which `share` of values[:n] lies; their order is destroyed."""
    low = 0
    high = n - 1
    middle = np.int64(share * n)
    while low < high:
        pivot = values[middle]
        i = low
        j = high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                held = values[i]
                values[i] = values[j]
                values[j] = held
                i += 1
                j -= 1
        if j < middle:
            low = i
        if i > middle:
            high = j
    return values[middle]
