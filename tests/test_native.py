"""The extension's boundary: what it takes, what it refuses, the lock, and that all levels give the same bits."""

from __future__ import annotations

import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest

from hs_tracker_cv._native import kernels


@pytest.fixture
def level() -> Iterator[None]:
    """Leave the level as it was."""
    before = kernels.level()
    yield
    kernels.use_level(before)


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (16, 33)])
def test_load_copies_and_clears_what_is_not_finite(rng, shape):
    """A plane holds the image, with zeros for NaN and infinity; its neighbours are untouched."""
    image = rng.normal(size=shape).astype(np.float32)
    planes = kernels.Planes(3, *shape)
    kernels.load(image, planes, 1)
    np.testing.assert_array_equal(planes[1], image)
    assert not planes[0].any()
    assert not planes[2].any()
    image[0, 0], image[-1, -1] = np.nan, -np.inf
    kernels.load(image, planes, 1)
    np.testing.assert_array_equal(planes[1], np.where(np.isfinite(image), image, 0))


@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        (np.zeros((4, 6)), TypeError, "image to be an array of float32 with 2 dimensions, got float64"),
        (np.zeros((4, 6), ">f4"), TypeError, "got format '>f'"),
        (np.zeros((4, 6), np.complex64), TypeError, "got format 'Zf'"),
        (np.zeros((4, 6), bool), TypeError, "got bool"),
        (b"bytes", TypeError, "got uint8"),
        (None, TypeError, "image to be an array.*got NoneType"),
        (np.zeros((4, 12), np.float32)[:, ::2], ValueError, "image.*got one that is not C-contiguous"),
        (np.zeros((4, 6, 1), np.float32), ValueError, r"image.*got shape \(4, 6, 1\)"),
        (np.zeros(4, np.float32), ValueError, r"image.*got shape \(4,\)"),
        (np.zeros((4, 7), np.float32), ValueError, r"image to have shape \(4, 6\), got \(4, 7\)"),
        (np.frombuffer(bytes(97), np.float32, 24, 1).reshape(4, 6), ValueError, "image.*at an address"),
    ],
)
def test_what_a_kernel_refuses_is_named(image, error, message):
    """Another type, layout, number of dimensions or size is an error that names it; nothing is converted."""
    with pytest.raises(error, match=message):
        kernels.load(image, kernels.Planes(1, 4, 6), 0)


def test_read_only_images_are_read():
    """What is only read need not be writable."""
    image = np.ones((4, 6), np.float32)
    image.flags.writeable = False
    planes = kernels.Planes(1, 4, 6)
    kernels.load(image, planes, 0)
    np.testing.assert_array_equal(planes[0], image)


def test_planes_are_checked():
    """Sizes that are not positive or beyond all memory, and planes that are not there, are named."""
    with pytest.raises(ValueError, match=r">= 1.*got 2, 0 and 5"):
        kernels.Planes(2, 0, 5)
    with pytest.raises(ValueError, match=">= 1 that memory can hold"):
        kernels.Planes(2**40, 2**40, 2**40)
    planes = kernels.Planes(2, 3, 5)
    assert len(planes) == 2
    for plane in (-1, 2):
        with pytest.raises(IndexError, match=f"from 0 to 1, got {plane}"):
            planes[plane]
        with pytest.raises(IndexError, match=f"from 0 to 1, got {plane}"):
            kernels.load(np.zeros((3, 5), np.float32), planes, plane)


def test_arrays_keep_their_planes_alive():
    """An image of planes that nobody else holds stays valid."""
    image = kernels.Planes(1, 300, 300)[0]
    others = [kernels.Planes(1, 300, 300) for _ in range(4)]
    for other in others:
        other[0][:] = 1.0
    assert not image.any()


def test_kernels_let_go_of_the_lock():
    """While a kernel runs, another thread can: one that waits gets its turn though none is ever forced."""
    image = np.zeros((500, 500), np.float32)
    planes = kernels.Planes(1, 500, 500)
    turn = threading.Event()
    calls = 0

    def work() -> None:
        nonlocal calls
        while not turn.is_set() and calls < 3000:
            kernels.load(image, planes, 0)
            calls += 1

    interval = sys.getswitchinterval()
    sys.setswitchinterval(1000.0)
    try:
        worker = threading.Thread(target=work)
        worker.start()
        turn.set()
        worker.join()
    finally:
        sys.setswitchinterval(interval)
    assert calls < 3000


@pytest.mark.usefixtures("level")
def test_all_levels_give_the_same_bits(rng):
    """The processor's level is chosen at import; any lower one can be forced, and computes the same."""
    image = rng.normal(size=(37, 53)).astype(np.float32)
    results = []
    assert kernels.level() == kernels.levels()[-1]
    for name in kernels.levels():
        kernels.use_level(name)
        assert kernels.level() == name
        planes = kernels.Planes(1, 37, 53)
        kernels.load(image, planes, 0)
        results.append(planes[0].tobytes())
    assert len(set(results)) == 1
    with pytest.raises(ValueError, match="got 'v9'"):
        kernels.use_level("v9")
