"""Machine code in memory, as a Python function."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from typing import Any

import llvmlite.binding as llvm  # type: ignore[import-untyped]

__all__ = ["C_FUNCTIONS", "KEPT", "LONG", "PATIENCE", "TURN", "UNTIL", "function", "loaded", "native"]

C_FUNCTIONS = (
    "PyBuffer_Release",
    "PyErr_BadArgument",
    "PyErr_Occurred",
    "PyEval_RestoreThread",
    "PyEval_SaveThread",
    "PyFloat_AsDouble",
    "PyLong_AsLongLong",
    "PyObject_GetBuffer",
    "PyObject_IsTrue",
    "Py_BuildValue",
)
"""Functions of Python's stable C interface, all that machine code here may refer to."""

TURN = "hs_tracker_cv_turn"
"""Name of an integer: 1 from when a thread is back from a kernel until it enters its next one.

In that time it holds Python's lock, and it is soon over. Another thread that comes back from a kernel looks at this
number for a while before it asks for the lock: the lock would put it to sleep, and to be woken takes longer than what
it waits for. Whoever has waited long enough asks all the same, so that nothing depends on the number being right.
"""

PATIENCE = "hs_tracker_cv_patience"
"""Name of an integer: how often to look."""

_LOOKS = 3000
"""About 0.1 ms: few trackers need longer from one kernel to the next."""

UNTIL = "hs_tracker_cv_until"
"""Name of an integer: until when, by the processor's clock, kernels keep Python's lock.

A thread of pure Python gives the lock back only after 5 ms (``sys.getswitchinterval``), and an update would wait for
it after every kernel. So whoever has waited that long keeps the lock for as long, which is what Python grants to
every thread, and then lets others have it again.
"""

LONG = 8_000_000
"""Ticks of that clock: 2 to 4 ms. To wait so long is to wait for a thread of pure Python, not for another tracker."""

KEPT = "hs_tracker_cv_kept"
"""Name of an integer: for how many ticks the lock is then kept."""

_KEPT = 15_000_000
"""4 to 8 ms."""

_LOADED: set[str] = set()
_FASTCALL = 0x80  # METH_FASTCALL


class _Method(ctypes.Structure):
    """``PyMethodDef``."""

    _fields_ = (
        ("name", ctypes.c_char_p),
        ("code", ctypes.c_void_p),
        ("flags", ctypes.c_int),
        ("doc", ctypes.c_char_p),
    )


@cache
def _numbers() -> dict[str, ctypes.c_int32 | ctypes.c_uint64]:
    """Integers of this process that machine code refers to."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    patience = ctypes.c_int32(_LOOKS if processors > 1 else 0)
    return {TURN: ctypes.c_int32(0), PATIENCE: patience, UNTIL: ctypes.c_uint64(0), KEPT: ctypes.c_uint64(_KEPT)}


@cache
def _engine() -> Any:
    """LLVM's loader."""
    with suppress(RuntimeError):  # newer versions initialise themselves, and say so
        llvm.initialize()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    for name in C_FUNCTIONS:
        llvm.add_symbol(name, ctypes.cast(getattr(ctypes.pythonapi, name), ctypes.c_void_p).value)
    for name, number in _numbers().items():
        llvm.add_symbol(name, ctypes.addressof(number))
    machine = llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(jit=True)
    return llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)


def native(name: str) -> str:
    """Name of the function by which other kernels call the kernel of that name."""
    return f"{name}.native"


def loaded(name: str) -> bool:
    """Tell whether the kernel of that name is there for others to be linked to."""
    return name in _LOADED


def function(code: bytes, name: str) -> Callable[..., Any]:
    """Load an object file and return its function `name`, a ``METH_FASTCALL`` function of Python's C interface.

    The kernels that it calls must have been loaded before: LLVM ends the process for a name that it does not find.
    """
    engine = _engine()
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    llvm.add_symbol(native(name), engine.get_function_address(native(name)))
    _LOADED.add(name)
    method = _Method(name.encode(), engine.get_function_address(name), _FASTCALL, None)
    prototype = ctypes.PYFUNCTYPE(ctypes.py_object, ctypes.c_void_p, ctypes.py_object, ctypes.c_void_p)
    make = prototype(("PyCFunction_NewEx", ctypes.pythonapi))
    # The second argument is what Python's function object owns: it refers to all of this as long as it lives.
    result: Callable[..., Any] = make(ctypes.addressof(method), (method, code, engine), None)
    return result
