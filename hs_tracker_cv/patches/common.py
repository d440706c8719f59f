"""Types of the arrays that kernels of this room take."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

Image = Annotated[NDArray[np.float32], 3]
Plane = Annotated[NDArray[np.float32], 2]
Bins = Annotated[NDArray[np.int32], 2]
Row = Annotated[NDArray[np.float32], 1]
Integers = Annotated[NDArray[np.int64], 1]
Numbers = Annotated[NDArray[np.float64], 1]
