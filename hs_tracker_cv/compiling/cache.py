"""Machine code on disk: where it lies, and whether it may be used."""

from __future__ import annotations

import hashlib
import os
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

__all__ = ["Entry", "sources"]

_DIGEST = hashlib.sha256
_DIGEST_SIZE = 32
_VARIABLES = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_ENABLE_AVX", "NUMBA_OPT")
"""Environment variables that change the code which Numba makes."""


class Entry:
    """The file of one kernel's machine code.

    The file begins with a digest of the code and of all that it was made from: the sources of the kernel and of this
    package. So a damaged file is as good as none, and one file is kept per kernel and machine, the latest. What makes
    machines differ (processor, Python, Numba) is in the file's name, for those that share a directory.
    """

    def __init__(self, function: Callable[..., Any], sources: bytes | None) -> None:
        digest = _DIGEST(_machine() + os.path.dirname(function.__code__.co_filename).encode()).hexdigest()
        name = f"{function.__module__}.{function.__name__}"
        self._file = f"{name}-{sys.implementation.cache_tag}-{digest[:16]}.bin"
        self._sources = sources
        self._beside = Path(function.__code__.co_filename).parent

    def read(self) -> bytes | None:
        """Return the code, from the first place that has it; None where it is missing, outdated or damaged."""
        if self._sources is None:
            return None
        for place in self._places():
            with suppress(OSError):
                data = (place / self._file).read_bytes()
                code = data[_DIGEST_SIZE:]
                if data[:_DIGEST_SIZE] == self._digest(code):
                    return code
        return None

    def write(self, code: bytes) -> None:
        """Keep code in the first place that can be written, whole or not at all; nowhere if there is none."""
        import secrets

        if self._sources is None:
            return
        for place in self._places():
            # Not by tempfile, whose files only their owner can read: who installs need not be who uses.
            temporary = place / f"{self._file}.{secrets.token_hex(8)}.tmp"
            with suppress(OSError):
                place.mkdir(parents=True, exist_ok=True)
                try:
                    temporary.write_bytes(self._digest(code) + code)
                    temporary.replace(place / self._file)
                finally:
                    temporary.unlink(missing_ok=True)
                return

    def _digest(self, code: bytes) -> bytes:
        return _DIGEST((self._sources or b"") + code).digest()

    def _places(self) -> Iterator[Path]:
        chosen = os.environ.get("NUMBA_CACHE_DIR")
        if chosen:
            yield Path(chosen)
            return
        yield self._beside / "__pycache__"
        yield _user_directory() / "hs_tracker_cv"


def _user_directory() -> Path:
    """Where the system wants caches to be."""
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or os.path.expanduser("~/AppData/Local"))
    if sys.platform == "darwin":
        return Path(os.path.expanduser("~/Library/Caches"))
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))


def sources(modules: Iterable[str]) -> bytes | None:
    """Contents of these modules' files and this package's; None if one has none, so that nothing is kept on disk."""
    # By name, since importing them would import Numba.
    own = (f"{__package__}{name}" for name in ("", ".loading", ".object_code", ".numba_function"))
    contents = [_module_bytes(name) for name in (*own, *modules)]
    return None if None in contents else b"".join(content or b"" for content in contents)


@cache
def _module_bytes(name: str) -> bytes | None:
    """Contents of a module's file, also of one inside an archive or not imported; None if it has none."""
    try:
        module: Any = find_spec(name)
        data: bytes = module.loader.get_data(module.origin)
    except (OSError, AttributeError, ValueError):
        return None
    return data


@cache
def _machine() -> bytes:
    """All that makes machine code differ but the source: processor, Python, Numba, LLVM."""
    import llvmlite  # type: ignore[import-untyped]
    import llvmlite.binding as llvm  # type: ignore[import-untyped]

    numba = find_spec("numba")  # finding it is quick, importing it is not
    version = b""
    with suppress(OSError):
        version = Path(numba.origin or "").with_name("_version.py").read_bytes() if numba else b""
    features = ""
    with suppress(RuntimeError):  # unknown to LLVM on some processors
        features = llvm.get_host_cpu_features().flatten()
    parts = (
        sys.version,
        llvmlite.__version__,
        llvm.get_process_triple(),
        llvm.get_host_cpu_name(),
        features,
        *(os.environ.get(name, "") for name in _VARIABLES),
    )
    return "\n".join(parts).encode() + version
