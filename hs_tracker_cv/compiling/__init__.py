"""How kernels are written and run: compiled by Numba at the first use ever, loaded without Numba after that.

Importing Numba takes longer than everything else at the start of a program. So the decorators here only remember
their function. A kernel's first call looks for its machine code on disk (:mod:`.cache`); only where there is none
is Numba imported and asked for it (:mod:`.object_code`). Found or just compiled, it is called in the same way
(:mod:`.loading`).
"""

# mypy: allow-untyped-calls
from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Any
from weakref import WeakSet

from . import cache

__all__ = [
    "Intrinsic",
    "Kernel",
    "Part",
    "intrinsic",
    "kernel",
    "larger",
    "local",
    "part",
    "prepare_all",
    "root",
    "smaller",
]

_LOCK = threading.RLock()
_KERNELS: WeakSet[Kernel] = WeakSet()
_COMPILED: dict[str, bytes] = {}
"""Machine code that was made along with another kernel's and is not loaded yet."""


class Kernel:
    """A compiled function. Every parameter is annotated with its one type; `py_func` is the Python function.

    A number's type is ``float``, ``int``, ``bool`` or one of NumPy's; an array's ``Annotated[NDArray[...], ndim]``,
    C-contiguous. Arguments of another type are refused with an exception; no value is ever checked. A kernel may
    call another: each is compiled once, and linked when it is loaded; its annotation then has to say what it returns.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.py_func = function
        self.options = options
        # Read now: when the machine code is made, the file may hold a later version than this process runs.
        self.sources = cache.sources(self._modules())
        self._run: Callable[..., Any] = self._first_run
        _KERNELS.add(self)

    def __call__(self, *arguments: Any) -> Any:
        """Run the machine code; the interpreter is free for other threads meanwhile."""
        return self._run(*arguments)

    @property
    def name(self) -> str:
        """Name of the machine code."""
        return f"{self.py_func.__module__}.{self.py_func.__name__}"

    @property
    def ready(self) -> bool:
        """True once the machine code is loaded."""
        return self._run != self._first_run

    def place(self) -> cache.Entry:
        """Where the machine code is kept."""
        return cache.Entry(self.py_func, self.sources)

    def called(self) -> list[Kernel]:
        """Return the kernels that this one calls, itself or by its parts."""
        found: dict[str, Kernel] = {}
        _add_called(self.py_func, found, set())
        return list(found.values())

    def _modules(self) -> list[str]:
        """Names of the modules of which the machine code is made."""
        names: set[str] = set()
        _add_modules(self.py_func, names)
        return sorted(names)

    def prepare(self) -> None:
        """Load or compile the machine code, as the first call would."""
        with _LOCK:
            if not self.ready:
                self._run = _machine_code(self)

    def _first_run(self, *arguments: Any) -> Any:
        self.prepare()
        return self._run(*arguments)


def prepare_all() -> None:
    """Load or compile the machine code of every kernel of the modules imported so far."""
    for kernel in sorted(_KERNELS, key=lambda kernel: kernel.name):
        kernel.prepare()


class Part:
    """A function that only kernels call: compiled into them."""

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        self.py_func = function
        self.options = options

    def __call__(self, *arguments: Any) -> Any:
        """Refuse: there is no compiled function of its own."""
        raise TypeError(f"{self.py_func.__name__} can only be called by a kernel")


class Intrinsic:
    """An instruction for kernels.

    When something is compiled, `make` returns what ``numba.extending.intrinsic`` wants; `module` is where that is
    written.
    """

    def __init__(self, make: Callable[[], Callable[..., Any]], module: str) -> None:
        self.make = make
        self.module = module

    def __call__(self, *arguments: Any) -> Any:
        """Refuse: it is not a function."""
        raise TypeError("an instruction for kernels can only be called by a kernel")


def _add_modules(function: Callable[..., Any], names: set[str]) -> None:
    """Add to `names` the modules that a function and what it may call are written in."""
    if function.__module__ in names:
        return
    names.add(function.__module__)
    for value in function.__globals__.values():
        if isinstance(value, Part | Kernel):
            _add_modules(value.py_func, names)
        elif isinstance(value, Intrinsic):
            names.add(value.module)


def _add_called(function: Callable[..., Any], found: dict[str, Kernel], seen: set[Any]) -> None:
    """Add the kernels that a function calls to those `found`, looking into every part once."""
    for name in function.__code__.co_names:
        value = function.__globals__.get(name)
        if isinstance(value, Kernel):
            found[value.name] = value
        elif isinstance(value, Part) and value not in seen:
            seen.add(value)
            _add_called(value.py_func, found, seen)


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Kernel]:
    """Compile a function on first call and keep its machine code on disk.

    The place is Numba's: ``NUMBA_CACHE_DIR`` if set, else ``__pycache__`` beside the source, else the user's cache
    directory. Where none can be written, as in a read-only installation without a home, the function is compiled
    once in every process.

    Parameters
    ----------
    **options
        Of ``numba.njit``, except ``cache``.
    """
    return lambda function: Kernel(function, options)


def part(**options: Any) -> Callable[[Callable[..., Any]], Part]:
    """Mark a function that only kernels call: not callable from Python, and cached as a part of its callers."""
    return lambda function: Part(function, options)


def intrinsic(function: Callable[..., Any]) -> Intrinsic:
    """Mark a function that emits LLVM instructions for kernels; it imports what it needs of Numba when called."""
    return Intrinsic(lambda: function, function.__module__)


@intrinsic
def root(typing_context: Any, a: Any) -> Any:
    """Square root of a float, inside a kernel: the processor's instruction.

    ``np.sqrt`` calls C's function for negative numbers, whose errors nobody asks for, and keeps loops from being
    vectorised.
    """

    def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        function = builder.module.declare_intrinsic("llvm.sqrt", [arguments[0].type])
        return builder.call(function, arguments)

    return a(a), emit


def local(*shape: int) -> Intrinsic:
    """Intrinsic without arguments that returns an array of float64 on the stack, uninitialised, for a kernel's use.

    Numba's ``np.empty`` compiles an allocator into every kernel, and its array costs a lock at run time.
    """

    def array(typing_context: Any) -> Any:
        from numba import types
        from numba.core import cgutils
        from numba.np.arrayobj import populate_array

        kind = types.Array(types.float64, len(shape), "C")

        def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            element = context.get_value_type(kind.dtype)
            room = cgutils.alloca_once(builder, element, size=math.prod(shape))
            made = context.make_array(kind)(context, builder)
            sides = [context.get_constant(types.intp, side) for side in shape]
            steps = [context.get_constant(types.intp, 8 * math.prod(shape[i + 1 :])) for i in range(len(shape))]
            populate_array(made, room, sides, steps, 8, None)
            return made._getvalue()

        return kind(), emit

    return intrinsic(array)


def _machine_code(kernel: Kernel) -> Callable[..., Any]:
    """Machine code of a kernel as a Python function."""
    from . import loading

    called = kernel.called()
    for other in called:
        other.prepare()
    if all(loading.loaded(other.name) for other in called):
        code = _COMPILED.pop(kernel.name, None) or kernel.place().read() or _compiled(kernel)
        if code is not None:
            return loading.function(code, kernel.name)
    from .numba_function import dispatcher

    function: Callable[..., Any] = dispatcher(kernel)
    return function


def _compiled(kernel: Kernel) -> bytes | None:
    """Compile a kernel; None if Numba has to run it in its own way.

    What else there is of its package is compiled with it, since it will be wanted, and together it takes less time.
    """
    try:
        from .object_code import object_codes
    except Exception:  # a Numba whose inner names have changed
        return None
    package, _, module = kernel.name.partition(".")
    kin = [other for other in _KERNELS if module.count(".") and other.name.startswith(f"{package}.")]
    missing = [other for other in kin if other is not kernel and not other.ready and other.place().read() is None]
    for other, code in zip([kernel, *missing], object_codes([kernel, *missing]), strict=True):
        if code is not None:
            other.place().write(code)
            _COMPILED[other.name] = code
    return _COMPILED.pop(kernel.name, None)


def _select(comparison: str) -> Intrinsic:
    """Intrinsic that returns one of two numbers.

    Numba compiles its own ``min`` and ``max`` as functions, once for each pair of types: a second of compiling.
    """

    def select(typing_context: Any, a: Any, b: Any) -> Any:
        from numba import types

        a, b = types.unliteral(a), types.unliteral(b)
        common = typing_context.unify_pairs(a, b)

        def emit(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
            one, two = (
                context.cast(builder, value, kind, common)
                for value, kind in zip(arguments, signature.args, strict=True)
            )
            if isinstance(common, types.Float):
                return builder.select(builder.fcmp_ordered(comparison, one, two), one, two)
            return builder.select(builder.icmp_signed(comparison, one, two), one, two)

        return common(a, b), emit

    return intrinsic(select)


smaller = _select("<")
"""The smaller of two floats or signed integers, inside a kernel."""

larger = _select(">")
"""The larger of two floats or signed integers, inside a kernel."""
