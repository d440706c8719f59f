"""Numba's ``njit`` for the kernels: cached on disk where that can be, and quick to load from there."""

# mypy: allow-untyped-calls
from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any

from numba import njit, types
from numba.core.caching import FunctionCache
from numba.core.runtime.nrt import rtsys
from numba.extending import intrinsic

__all__ = ["kernel", "larger", "part", "smaller"]

_SETTINGS: dict[str, Any] = {"nogil": True, "no_cfunc_wrapper": True, "error_model": "numpy"}
# NumPy's error model: a test for zero at every division would double the time to compile.


class _Cache(FunctionCache):
    """Numba's cache, loaded without setting up the compiler.

    Before it loads a cached function Numba registers all that it could compile, linear algebra of SciPy included,
    which takes 0.3 s and is not needed to run machine code; a function that must be compiled has it done then.
    """

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Load machine code for a signature; None if there is none."""
        try:
            rtsys.initialize(target_context)  # the allocator: kernels that make arrays call it
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except AttributeError:  # a Numba whose inner names have changed
            return super().load_overload(sig, target_context)


def kernel(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function on first call and keep its machine code on disk.

    The place is Numba's: ``NUMBA_CACHE_DIR`` if set, else ``__pycache__`` beside the source, else the user's cache
    directory. Where none can be written, as in a read-only installation without a home, the function is compiled
    once in every process.

    Parameters
    ----------
    **options
        Of ``numba.njit``, except ``cache``.
    """

    def decorate(function: Callable[..., Any]) -> Any:
        dispatcher: Any = njit(**{**_SETTINGS, **options})(function)
        with suppress(RuntimeError):  # Numba's "no locator available": nowhere to write
            dispatcher._cache = _Cache(function)
        return dispatcher

    return decorate


def part(**options: Any) -> Callable[[Callable[..., Any]], Any]:
    """Compile a function that only kernels call: not callable from Python, and cached as a part of its callers."""
    decorate: Any = njit(**{**_SETTINGS, "no_cpython_wrapper": True, **options})
    return decorate  # type: ignore[no-any-return]


def _select(comparison: str) -> Any:
    """Intrinsic that returns one of two numbers.

    Numba compiles its own ``min`` and ``max`` as functions, once for each pair of types: a second of compiling.
    """

    @intrinsic
    def select(typing_context: Any, a: Any, b: Any) -> Any:
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

    return select


smaller = _select("<")
"""The smaller of two floats or signed integers, inside a kernel."""

larger = _select(">")
"""The larger of two floats or signed integers, inside a kernel."""
