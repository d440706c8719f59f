"""What a child process may open: its own code and libraries, a folder of its own, and nothing that holds truth.

On Linux this is Landlock (kernel 5.13 and later; no privilege is needed): the kernel refuses to open every file that
is not on a list, in the child and in all that it starts, and refuses them the memory and the open files of processes
outside. Elsewhere nothing is refused; then a child is protected from the truth only by not being told where it is.

What is timed starts no process either, whose time would be nobody's (:func:`forbid_processes`, a filter of calls).
"""

from __future__ import annotations

import contextlib
import ctypes
import errno
import functools
import os
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

__all__ = [
    "available", "confine", "device_paths", "forbid_lasting_memory", "forbid_processes", "make_ruleset",
    "readable_paths", "visible_paths",
]  # fmt: skip

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446  # system calls, the same on every architecture
_VERSION_FLAG, _RULE_PATH_BENEATH, _SET_NO_NEW_PRIVS = 1, 1, 38
_WRITE_FILE, _READ_FILE, _READ_DIR = 1 << 1, 1 << 2, 1 << 3
_CHANGE_FOLDER = sum(1 << bit for bit in range(4, 13))  # remove and make entries of every kind
_REFER, _TRUNCATE = 1 << 13, 1 << 14  # since versions 2 and 3
_SCOPES = 0b11  # since version 6: no signals and no abstract sockets to processes outside

_SYSTEM = ("/bin", "/sbin", "/usr", "/lib", "/lib32", "/lib64", "/etc", "/opt", "/nix", "/gnu", "/proc", "/sys")
_DEVICES = ("/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom", "/dev/dri")
# Not /dev/shm: files there are memory that belongs to no process, and stay when all of them have ended.
_SITES = {"site-packages", "dist-packages"}
_MODULES = {".py", ".pyc", ".so", ".pyd", ".zip", ".egg", ".pth"}

_CLONE3, _CLONE_THREAD, _OTHER_CALLS = 435, 0x10000, 0x40000000  # the last: those of x32 on x86-64
_SET_SECCOMP, _MODE_FILTER = 22, 2
_LOAD, _EQUAL, _AT_LEAST, _ANY_BIT, _RETURN = 0x20, 0x15, 0x35, 0x45, 0x06  # of a filter (linux/bpf_common.h)
_ALLOW, _REFUSE = 0x7FFF0000, 0x00050000


class _Machine(NamedTuple):
    """Linux's numbers on one kind of machine."""

    architecture: int

    processes: tuple[int, int, int]
    """Calls that make one (clone, fork, vfork); where the latter two do not exist, a number that no call has."""

    lasting: tuple[int, int, int]
    """Calls that make what belongs to no process and stays: System V's memory, semaphores and queues."""


_MACHINES = {
    "x86_64": _Machine(0xC000003E, (56, 57, 58), (29, 64, 68)),
    "aarch64": _Machine(0xC00000B7, (220, 0x3FFFFFFF, 0x3FFFFFFF), (194, 190, 186)),
}


class _Ruleset(ctypes.Structure):
    _fields_ = (("fs", ctypes.c_uint64), ("net", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _PathBeneath(ctypes.Structure):
    _pack_ = 1
    _fields_ = (("access", ctypes.c_uint64), ("parent", ctypes.c_int32))


class _Instruction(ctypes.Structure):
    _fields_ = (
        ("code", ctypes.c_uint16),
        ("yes", ctypes.c_uint8),
        ("no", ctypes.c_uint8),
        ("value", ctypes.c_uint32),
    )


class _Program(ctypes.Structure):
    _fields_ = (("length", ctypes.c_uint16), ("instructions", ctypes.POINTER(_Instruction)))


@functools.cache
def _libc() -> ctypes.CDLL:
    return ctypes.CDLL(None, use_errno=True)


def _call(number: int, *arguments: object) -> int:
    result = _libc().syscall(number, *arguments)
    if result < 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))
    return int(result)


@functools.cache
def _version() -> int:
    if not sys.platform.startswith("linux"):
        return 0
    try:
        return _call(_CREATE_RULESET, None, 0, _VERSION_FLAG)
    except OSError:
        return 0


def available() -> bool:
    """Whether this system can confine a process."""
    return _version() > 0


def make_ruleset(readable: Iterable[Path], writable: Iterable[Path]) -> int | None:
    """Make a set of rules; every file that is not in or below these paths cannot be opened.

    Names of files can still be listed everywhere.

    Parameters
    ----------
    readable, writable : iterable of Path
        Files and folders; those that do not exist are left out.

    Returns
    -------
    int or None
        File descriptor, to be handed to :func:`confine` in the child; None where the system has no such thing.
    """
    if not available():
        return None
    on_files = _READ_FILE | _WRITE_FILE | (_TRUNCATE if _version() >= 3 else 0)
    handled = on_files | _CHANGE_FOLDER | (_REFER if _version() >= 2 else 0)
    attributes = _Ruleset(handled, 0, _SCOPES if _version() >= 6 else 0)
    size = 24 if _version() >= 6 else 8
    ruleset = _call(_CREATE_RULESET, ctypes.byref(attributes), ctypes.c_size_t(size), 0)
    for paths, access in ((readable, _READ_FILE), (writable, handled)):
        for path in paths:
            with contextlib.suppress(FileNotFoundError, NotADirectoryError, PermissionError):
                _allow(ruleset, path, access if path.is_dir() else access & on_files)
    return ruleset


def _allow(ruleset: int, path: Path, access: int) -> None:
    place = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        rule = _PathBeneath(access, place)
        _call(_ADD_RULE, ruleset, _RULE_PATH_BENEATH, ctypes.byref(rule), 0)
    finally:
        os.close(place)


def confine(ruleset: int) -> None:
    """Put this process, and all that it will start, under a set of rules for good.

    Raises
    ------
    OSError
        If the system refuses.
    """
    _control(_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    _call(_RESTRICT_SELF, ruleset, 0)


def forbid_processes() -> None:
    """Let this process start threads, but no process, for good: the kernel answers that it is not permitted.

    Nothing is forbidden where the system has no such filters.

    Raises
    ------
    OSError
        If the system refuses.
    """
    machine = _filtered_machine()
    if machine is None:
        return
    clone, fork, vfork = machine.processes
    unknown, refused = _REFUSE | errno.ENOSYS, _REFUSE | errno.EPERM
    # Jumps are relative: to how many instructions later when it is so, and when it is not.
    rows = [
        (_LOAD, 0, 0, 4),  # the architecture
        (_EQUAL, 0, 9, machine.architecture),
        (_LOAD, 0, 0, 0),  # the number of the call
        (_AT_LEAST, 7, 0, _OTHER_CALLS),
        (_EQUAL, 6, 0, _CLONE3),  # what it asks for cannot be seen; who is told that there is none asks by clone
        (_EQUAL, 6, 0, fork),
        (_EQUAL, 5, 0, vfork),
        (_EQUAL, 0, 2, clone),
        (_LOAD, 0, 0, 16),  # its first argument
        (_ANY_BIT, 0, 2, _CLONE_THREAD),
        (_RETURN, 0, 0, _ALLOW),
        (_RETURN, 0, 0, unknown),
        (_RETURN, 0, 0, refused),
    ]
    _filter(rows)


def forbid_lasting_memory() -> None:
    """Keep this process, and all that it will start, from memory that belongs to no process and stays (``shmget``).

    The kernel answers that it is not permitted. Nothing is forbidden where the system has no such filters.

    Raises
    ------
    OSError
        If the system refuses.
    """
    machine = _filtered_machine()
    if machine is None:
        return
    memory, semaphores, queues = machine.lasting
    rows = [
        (_LOAD, 0, 0, 4),  # the architecture
        (_EQUAL, 0, 6, machine.architecture),
        (_LOAD, 0, 0, 0),  # the number of the call
        (_AT_LEAST, 4, 0, _OTHER_CALLS),
        (_EQUAL, 4, 0, memory),
        (_EQUAL, 3, 0, semaphores),
        (_EQUAL, 2, 0, queues),
        (_RETURN, 0, 0, _ALLOW),
        (_RETURN, 0, 0, _REFUSE | errno.ENOSYS),
        (_RETURN, 0, 0, _REFUSE | errno.EPERM),
    ]
    _filter(rows)


def _filtered_machine() -> _Machine | None:
    """The numbers of this machine, if its system has filters of calls; None where nothing can be forbidden."""
    if not sys.platform.startswith("linux") or sys.maxsize < 2**32:
        return None
    return _MACHINES.get(os.uname().machine)


def _filter(rows: list[tuple[int, int, int, int]]) -> None:
    """Have the kernel look at every system call from here on, for good; raises OSError."""
    program = _Program(len(rows), (_Instruction * len(rows))(*(_Instruction(*row) for row in rows)))
    _control(_SET_NO_NEW_PRIVS, 1, 0, 0, 0)
    _control(_SET_SECCOMP, _MODE_FILTER, ctypes.byref(program), 0, 0)


def _control(*arguments: object) -> None:
    if _libc().prctl(*arguments) != 0:
        code = ctypes.get_errno()
        raise OSError(code, os.strerror(code))


def readable_paths(hidden: Iterable[Path]) -> list[Path]:
    """Files and folders that a Python program needs, without those that are hidden.

    That is the system's, Python's own, and in the other folders of ``sys.path`` the modules: source files, extensions
    and packages, not what else lies beside them.

    Parameters
    ----------
    hidden : iterable of Path
        What may not be read, wherever it lies.
    """
    homes = {Path(place).resolve() for place in (sys.prefix, sys.base_prefix, sys.exec_prefix)}
    homes |= {Path(place).resolve() for place in sysconfig.get_paths().values()}
    homes |= {Path(entry).resolve() for entry in sys.path if Path(entry).name in _SITES}
    libraries = (entry for entry in os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep) if entry)
    roots = {Path(place).resolve() for place in (*_SYSTEM, *libraries)} | homes
    for entry in sys.path:
        place = Path(entry or os.getcwd()).resolve()
        if not homes & {place, *place.parents}:
            roots |= {place} if place.is_file() else set(_modules_in(place))
    return visible_paths(roots, hidden)


def visible_paths(paths: Iterable[Path], hidden: Iterable[Path]) -> list[Path]:
    """Paths without those that are hidden, in them or round them."""
    secret = {path.resolve() for path in hidden}
    return sorted(path for root in {path.resolve() for path in paths} for path in _without(root, secret))


def device_paths() -> list[Path]:
    """What every program may write to."""
    return [Path(place) for place in _DEVICES] + [path for path in Path("/dev").glob("nvidia*")]


def _modules_in(folder: Path) -> Iterator[Path]:
    try:
        entries = list(os.scandir(folder))
    except OSError:
        return
    for entry in entries:
        path = Path(entry.path)
        if path.suffix in _MODULES or entry.name.endswith((".dist-info", ".egg-info")):
            yield path.resolve()
        elif entry.is_dir() and (path / "__init__.py").exists():
            yield path.resolve()


def _without(root: Path, secret: set[Path]) -> Iterator[Path]:
    """`root`, or what is in it besides the hidden paths."""
    if root in secret or any(path in secret for path in root.parents):
        return
    if not any(root in path.parents for path in secret):
        yield root
        return
    with contextlib.suppress(OSError):
        for entry in os.scandir(root):
            if not entry.is_symlink():
                yield from _without(Path(entry.path), secret)
