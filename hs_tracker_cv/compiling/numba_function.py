"""Kernels as Numba wants to see them."""

# mypy: allow-untyped-calls
from __future__ import annotations

import sys
from collections.abc import Callable
from functools import cache
from types import FunctionType
from typing import Annotated, Any, get_args, get_origin, get_type_hints

import numpy as np
from numba import from_dtype, njit, types
from numba.extending import intrinsic

from . import Intrinsic, Kernel, Part

__all__ = ["SETTINGS", "dispatcher", "function_for", "returned", "signature"]

Compiled = Callable[[Part | Kernel, FunctionType], Any]
"""What stands for a part or a kernel in code that is compiled, given its function as that code may see it."""

SETTINGS: dict[str, Any] = {"nogil": True, "error_model": "numpy"}
# NumPy's error model: a test for zero at every division would double the time to compile.


def signature(kernel: Kernel) -> tuple[Any, ...]:
    """Types of a kernel's parameters, from their annotations."""
    hints = get_type_hints(kernel.py_func, include_extras=True)
    code = kernel.py_func.__code__
    return tuple(_type(hints[name]) for name in code.co_varnames[: code.co_argcount])


def returned(kernel: Kernel) -> Any:
    """Type of what a kernel returns, from its annotation."""
    hint = get_type_hints(kernel.py_func)["return"]
    if hint is type(None):
        return types.none
    return types.Tuple([_type(one) for one in get_args(hint)]) if get_origin(hint) is tuple else _type(hint)


def _type(hint: Any) -> Any:
    if get_origin(hint) is not Annotated:
        return from_dtype(np.dtype(hint))
    array, ndim = get_args(hint)
    (element,) = _elements(array)
    return types.Array(from_dtype(np.dtype(element)), ndim, "C")


def _elements(hint: Any) -> list[type[np.generic]]:
    """NumPy's scalar types in a hint, wherever the version of NumPy has them in `NDArray`."""
    if isinstance(hint, type) and issubclass(hint, np.generic):
        return [hint]
    return [element for argument in get_args(hint) for element in _elements(argument)]


def function_for(kernel: Kernel, compiled: Compiled) -> FunctionType:
    """Kernel's function in a copy of its module in which all stand-ins are what they stand for."""
    return _moved(kernel.py_func, _names(kernel.py_func.__module__, compiled))


@cache
def _names(module: str, compiled: Compiled) -> dict[str, Any]:
    names = dict(vars(sys.modules[module]))
    for name, value in tuple(names.items()):
        if isinstance(value, Intrinsic):
            names[name] = _instruction(value)
        elif isinstance(value, Part | Kernel) and value.py_func.__module__ != module:
            names[name] = _names(value.py_func.__module__, compiled)[value.py_func.__name__]
        elif isinstance(value, Part | Kernel):
            names[name] = compiled(value, _moved(value.py_func, names))
    return names


@cache
def _instruction(value: Intrinsic) -> Any:
    return intrinsic(value.make())


def _moved(function: Callable[..., Any], names: dict[str, Any]) -> FunctionType:
    return FunctionType(function.__code__, names, function.__name__, function.__defaults__, function.__closure__)


def dispatcher(kernel: Kernel) -> Any:
    """Compile a kernel in Numba's own way: it takes longer to load, and does the same."""
    decorate = njit([signature(kernel)], **{**SETTINGS, **kernel.options})
    return decorate(function_for(kernel, _numba))


def _numba(value: Part | Kernel, function: FunctionType) -> Any:
    # A kernel by no signature: it is compiled anew where another one calls it.
    return njit(**{**SETTINGS, **value.options})(function)
