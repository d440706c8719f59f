"""Formulas as kernels know them; what makes machine code of them, :mod:`.formulas`, is imported when compiling."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any, overload

from ..compiling import Intrinsic

if TYPE_CHECKING:
    from .formulas import Formula, Lanes

__all__ = ["formula", "interpolate_fours"]

_MODULE = f"{__package__}.formulas"


@overload
def formula(function: Formula) -> Intrinsic: ...
@overload
def formula(*, shared: Callable[..., list[Lanes]]) -> Callable[[Formula], Intrinsic]: ...
def formula(function: Formula | None = None, *, shared: Callable[..., Any] | None = None) -> Any:
    """Make a function that kernels can call of one that says what to compute at a pixel.

    The new one takes the array, height, width and stride, and then for each parameter of `function`, by its
    annotation, a class of :mod:`.formulas`:

    * Pixels: the index of a plane's first pixel, uint64;
    * PixelsOfTwo, a plane of twice the resolution: the same, its stride and its width;
    * Index: a uint64;
    * Lanes: a float32, the same for all pixels;
    * Image and ImageOfTwo: a float32 array (height, width, 1) and (height, width, 2);
    * Columns and Around: nothing.

    It returns the sum over all pixels of what `function` returns, a float64, or nothing if that returns nothing.

    Parameters
    ----------
    function : callable
    shared : callable, optional
        Returns values (Lanes) that the pixels to the right and to the left need as well. It is computed once for
        each block, and `function` gets it, for this block and the two next to it, as its parameter of type
        :class:`.formulas.Around`. Its parameters are parameters of `function`, by name.
    """
    if function is None:
        return partial(formula, shared=shared)
    return Intrinsic(partial(_instruction, function, shared), _MODULE)


def _instruction(function: Formula, shared: Callable[..., Any] | None) -> Callable[..., Any]:
    from .formulas import instruction

    return instruction(function, shared)


def _interpolate_fours() -> Callable[..., Any]:
    from .formulas import interpolate_fours

    return interpolate_fours


interpolate_fours = Intrinsic(_interpolate_fours, _MODULE)
"""See :func:`.formulas.interpolate_fours`."""
