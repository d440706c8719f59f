"""Kernels of a small module: typed, compiled once, kept on disk, loaded without Numba, and never a crash."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[1]

MODULE = """
from typing import Annotated
import numpy as np
from numpy.typing import NDArray
from hs_tracker_cv.compiling import kernel, larger, local, part, root, smaller

Plane = Annotated[NDArray[np.float32], 2]
Numbers = Annotated[NDArray[np.float64], 1]
_pair = local(2)

@part()
def squares(a, i):
    total = 0.0
    for j in range(a.shape[1]):
        total += a[i, j] * a[i, j]
    return total

@kernel()
def norms(a: Plane, least: float, out: Numbers) -> int:
    best = 0
    held = _pair()
    for i in range(a.shape[0]):
        held[0] = root(squares(a, i))
        out[i] = smaller(larger(held[0], least), 1e3)
        if out[i] > out[best]:
            best = i
    return best

@kernel()
def both(flag: bool, count: int, scale: np.float32, a: Plane) -> tuple[float, int]:
    return scale * a[0, 0], count + 1 if flag else count

@kernel()
def allocates(n: int) -> float:
    return np.ones(n).sum()

@part()
def scaled(a, out, factor):
    return factor * out[norms(a, 0.5, out)]

@kernel()
def longest(a: Plane, out: Numbers, factor: int) -> float:
    return scaled(a, out, factor)

@kernel()
def leans(n: int) -> float:
    return allocates(n) + 1.0
"""

LINKED = """
import numpy as np, sys, small
a, out = np.float32([[3, 4], [6, 8], [0, 0]]), np.zeros(3)
assert small.longest(a, out, 2) == 20.0
assert out.tolist() == [5, 10, 0.5], out
print('numba' in sys.modules)
"""

USE = """
import numpy as np, sys, small
a, out = np.float32([[3, 4], [6, 8], [0, 0]]), np.zeros(3)
assert small.norms(a, 0.5, out) == 1
assert out.tolist() == [5, 10, 0.5], out
print('numba' in sys.modules)
"""


@pytest.fixture
def place(tmp_path):
    """A directory with the module, and the environment of processes that use it."""
    (tmp_path / "small.py").write_text(MODULE)
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("NUMBA_", "XDG_"))}
    path = os.pathsep.join([str(tmp_path), str(ROOT)])
    return tmp_path, environment | {"PYTHONPATH": path, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}


def start(code, environment):
    """Start a process that runs the code, warnings being errors."""
    command = [sys.executable, "-W", "error", "-c", code]
    return subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def compiled(process):
    """Whether the process, which must succeed, has imported the compiler."""
    output, errors = process.communicate()
    assert process.returncode == 0, errors
    return output.strip() == "True"


def run(environment, code=USE):
    """Run the code in a process of its own; whether it has imported the compiler."""
    return compiled(start(code, environment))


@pytest.fixture
def small(place, monkeypatch):
    """The module, imported here."""
    tmp_path, environment = place
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setenv("NUMBA_CACHE_DIR", environment["NUMBA_CACHE_DIR"])
    sys.modules.pop("small", None)
    import small

    yield small
    sys.modules.pop("small")


def test_compiled_once(place):
    """The first process compiles, the second loads, and one file is left."""
    tmp_path, environment = place
    assert run(environment)
    assert not run(environment)
    (file,) = (tmp_path / "cache").iterdir()
    assert file.name.startswith("small.norms-")
    assert file.stat().st_mode == (tmp_path / "small.py").stat().st_mode  # who installs need not be who uses


@pytest.mark.parametrize("damage", [lambda data: data[:50], lambda data: b"", lambda data: data[:-9] + bytes(9)])
def test_damaged_file_is_compiled_again(place, damage):
    """A truncated, empty or altered file is noticed and replaced."""
    tmp_path, environment = place
    run(environment)
    (file,) = (tmp_path / "cache").iterdir()
    whole = file.read_bytes()
    file.write_bytes(damage(whole))
    assert run(environment)
    assert not run(environment)


def test_changed_source_is_compiled_again(place):
    """Machine code of another version of the source is not used; its file is replaced."""
    tmp_path, environment = place
    run(environment)
    source = tmp_path / "small.py"
    source.write_text(MODULE.replace("larger(held[0], least)", "larger(held[0], 2.0 * least)"))
    assert run(environment, USE.replace("0.5], out", "1.0], out"))
    assert len(list((tmp_path / "cache").iterdir())) == 1


def test_other_processor_has_its_own_file(place):
    """Machines that share a directory do not run each other's machine code."""
    tmp_path, environment = place
    run(environment)
    run(environment | {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""})
    assert len(list((tmp_path / "cache").iterdir())) == 2
    assert not run(environment)


def test_processes_that_compile_at_once(place):
    """Processes that start together on an empty cache all get their results, and leave one whole file."""
    tmp_path, environment = place
    assert all([compiled(process) for process in [start(USE, environment) for _ in range(3)]])
    assert len(list((tmp_path / "cache").iterdir())) == 1
    assert not run(environment)


def test_without_numbas_inner_parts(place):
    """Where Numba's inner names have changed, kernels are compiled in Numba's public way, with the same results."""
    _, environment = place
    code = "import sys; sys.modules['hs_tracker_cv.compiling.object_code'] = None\n" + USE
    assert run(environment, code + "assert type(small.norms._run).__name__ == 'CPUDispatcher'")


def test_a_kernel_calls_another(place):
    """Each is compiled once and kept in a file of its own; a later process links them without Numba."""
    tmp_path, environment = place
    assert run(environment, LINKED)
    names = sorted(file.name.split("-")[0] for file in (tmp_path / "cache").iterdir())
    assert names == ["small.longest", "small.norms"]
    assert not run(environment, LINKED)
    (tmp_path / "small.py").write_text(MODULE.replace("larger(held[0], least)", "larger(held[0], 12.0 * least)"))
    assert run(environment, LINKED.replace("[5, 10, 0.5]", "[6, 10, 6]"))


def test_a_kernel_calls_another_in_numbas_way(place):
    """Where Numba's inner names have changed, and where the called one needs more than bare code."""
    _, environment = place
    code = "import sys; sys.modules['hs_tracker_cv.compiling.object_code'] = None\n" + LINKED
    assert run(environment, code + "assert type(small.longest._run).__name__ == 'CPUDispatcher'")
    assert run(environment, "import sys, small; assert small.leans(3) == 4.0; print('numba' in sys.modules)")


def test_a_package_is_compiled_together(place):
    """The first call compiles all kernels of the package; what cannot be compiled is left to its own call."""
    tmp_path, environment = place
    (tmp_path / "kin").mkdir()
    (tmp_path / "kin" / "__init__.py").touch()
    (tmp_path / "small.py").rename(tmp_path / "kin" / "small.py")
    (tmp_path / "kin" / "other.py").write_text(
        "from hs_tracker_cv.compiling import kernel\n\n@kernel()\ndef next_one(n: int) -> int:\n    return n + 1\n"
    )
    code = "import sys\nfrom kin import other, small\nassert other.next_one(2) == 3\nprint('numba' in sys.modules)\n"
    assert run(environment, code)
    names = sorted(file.name.split("-")[0] for file in (tmp_path / "cache").iterdir())
    assert names == ["kin.other.next_one", *(f"kin.small.{name}" for name in ("both", "leans", "longest", "norms"))]
    assert not run(environment, LINKED.replace("sys, small", "sys\nfrom kin import small"))
    assert run(environment, code.replace("other.next_one", "small.allocates").replace("== 3", "== 2"))


def test_inside_an_archive(place):
    """A package in a zip file compiles, keeps its machine code in the user's cache, and loads it."""
    import zipfile

    tmp_path, environment = place
    with zipfile.ZipFile(tmp_path / "packed.zip", "w") as archive:
        archive.writestr("small.py", MODULE)
    (tmp_path / "small.py").unlink()
    environment["PYTHONPATH"] = os.pathsep.join([str(tmp_path / "packed.zip"), str(ROOT)])
    environment["XDG_CACHE_HOME"] = environment["LOCALAPPDATA"] = environment["HOME"] = str(tmp_path / "home")
    del environment["NUMBA_CACHE_DIR"]
    assert run(environment)
    assert not run(environment)
    assert list((tmp_path / "home").rglob("small.norms-*"))


def test_numbers_in_and_out(small):
    """Flags, whole and floating numbers of Python and NumPy go in; a tuple of numbers comes out."""
    a = np.full((1, 1), 3, np.float32)
    assert small.both(True, 4, 0.5, a) == (1.5, 5)
    assert small.both(np.False_, np.int32(4), np.float32(2), a) == (6.0, 4)
    assert [type(value) for value in small.both(True, 4, 0.5, a)] == [float, int]


@pytest.mark.parametrize(
    "arguments",
    [
        (np.zeros((2, 2)), 0.5, np.zeros(2)),
        (np.zeros((2, 2), np.int32), 0.5, np.zeros(2)),
        (np.zeros((2, 2, 1), np.float32), 0.5, np.zeros(2)),
        (np.zeros((2, 4), np.float32)[:, ::2], 0.5, np.zeros(2)),
        (np.zeros((2, 2), ">f4"), 0.5, np.zeros(2)),
        ([[0.0, 1.0]], 0.5, np.zeros(2)),
        (np.zeros((2, 2), np.float32), "0.5", np.zeros(2)),
        (np.zeros((2, 2), np.float32), 0.5),
        (np.zeros((2, 2), np.float32), 0.5, np.zeros(2), 1),
    ],
)
def test_other_types_are_refused(small, arguments):
    """Arguments that are not of the annotated types raise, and the kernel works as before."""
    with pytest.raises((TypeError, ValueError, BufferError)):
        small.norms(*arguments)
    assert small.norms(np.ones((2, 4), np.float32), 0.5, np.zeros(2)) == 0


def test_arrays_are_let_go(small):
    """A call keeps no reference to its arguments, whether it succeeds or not."""
    a, out = np.ones((2, 4), np.float32), np.zeros(2)
    small.norms(a, 0.5, out)
    before = sys.getrefcount(a), sys.getrefcount(out)
    for _ in range(10):
        small.norms(a, 0.5, out)
        with pytest.raises(TypeError):
            small.norms(a, 0.5, a)
    assert (sys.getrefcount(a), sys.getrefcount(out)) == before
    out.resize(3)  # refused while a buffer is exported


def test_kernel_that_allocates_is_left_to_numba(small):
    """What needs more than bare machine code is compiled in Numba's own way."""
    assert small.allocates(3) == 3.0


def test_parts_cannot_be_called(small):
    """A part or an instruction called from Python says what it is for."""
    with pytest.raises(TypeError, match="squares can only be called by a kernel"):
        small.squares(np.zeros((1, 1)), 0)
    with pytest.raises(TypeError, match="only be called by a kernel"):
        small.root(2.0)


def test_first_call_from_many_threads(small):
    """Threads that make the first call together all get the result."""
    results = []
    barrier = threading.Barrier(8)

    def call():
        barrier.wait()
        out = np.zeros(3)
        results.append((small.norms(np.float32([[3, 4], [6, 8], [0, 0]]), 0.5, out), out.tolist()))

    threads = [threading.Thread(target=call) for _ in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert results == [(1, [5.0, 10.0, 0.5])] * 8


def test_nothing_depends_on_whose_turn_it_is(small):
    """Whatever stands in the number that kernels look at before they ask for the interpreter, they come back."""
    from hs_tracker_cv.compiling import loading

    turn = loading._numbers()[loading.TURN]
    stop, results = threading.Event(), []

    def call():
        for _ in range(500):
            out = np.zeros(3)
            results.append((small.norms(np.float32([[3, 4], [6, 8], [0, 0]]), 0.5, out), out.tolist()))

    def disturb():
        while not stop.is_set():
            turn.value = 1

    callers, disturber = [threading.Thread(target=call) for _ in range(2)], threading.Thread(target=disturb)
    disturber.start()
    for thread in callers:
        thread.start()
    for thread in callers:
        thread.join(60)
    stop.set()
    disturber.join()
    assert results == [(1, [5.0, 10.0, 0.5])] * 1000
    turn.value = 1
    assert small.norms(np.ones((2, 4), np.float32), 0.5, np.zeros(2)) == 0
    assert turn.value == 1  # this thread is between two kernels


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="no clock that machine code can read")
def test_whoever_waited_for_pure_python_keeps_the_interpreter_for_as_long(small):
    """Beside a thread that never lets go, kernels give the interpreter away once in a while, not every time."""
    from hs_tracker_cv.compiling import loading

    until, kept = (loading._numbers()[name] for name in (loading.UNTIL, loading.KEPT))
    usual = kept.value
    arguments = np.ones((2000, 500), np.float32), 0.5, np.zeros(2000)  # long enough for the other thread to wake up

    def unshared() -> bool:
        before = counted[0]
        for _ in range(5):
            small.norms(*arguments)
        return counted[0] == before

    small.norms(*arguments)
    until.value = 0
    stop, counted = threading.Event(), [0]

    def hog():
        while not stop.is_set():
            counted[0] += 1

    thread = threading.Thread(target=hog)
    interval = sys.getswitchinterval()
    sys.setswitchinterval(0.05)
    try:
        thread.start()
        while until.value == 0:  # the other thread has to notice that the interpreter is free
            small.norms(*arguments)
        kept.value, until.value = 2**62, until.value + 2**61  # only Python itself, every 50 ms, lets the other go on
        assert any(unshared() for _ in range(20))
        until.value = 0
        assert not all(unshared() for _ in range(20))
    finally:
        stop.set()
        until.value, kept.value = 0, usual
        thread.join()
        sys.setswitchinterval(interval)
