"""The extension's boundary: what it takes, what it refuses, the lock, and that all levels give the same bits."""

from __future__ import annotations

import ast
import sys
import threading
from pathlib import Path

import numpy as np
import pytest

from hs_tracker_cv._native import kernels
from hs_tracker_cv.flow import HornSchunck

H, W = 4, 6
NO_BLUR = (1.0, 0.0, 0.0)


def images(rng, *shape):
    """Two images of noise, 0–255."""
    return rng.uniform(0, 255, (2, *shape)).astype(np.float32)


def load(image, other, guess=None, *, height=H, width=W):
    """Load two images, and a first guess, into planes, without blur."""
    planes = kernels.Planes(2 if guess is None else 4, height, width)
    kernels.load_frames(image, other, guess, NO_BLUR, planes, kernels.Planes(1, height, width))
    return planes


@pytest.mark.parametrize("shape", [(1, 1), (5, 7), (16, 33)])
def test_images_come_in_and_go_out(rng, shape):
    """Planes hold the images and the flow, with zeros for NaN and infinity, and give the flow back."""
    first, second = images(rng, *shape)
    first[0, 0], second[-1, -1] = np.nan, -np.inf
    flow = rng.normal(size=(*shape, 2)).astype(np.float32)
    planes = load(first, second, flow, height=shape[0], width=shape[1])
    for plane, image in zip(range(4), (first, second, flow[..., 0], flow[..., 1]), strict=True):
        np.testing.assert_array_equal(planes[plane], np.where(np.isfinite(image), image, 0))
    pair, out = kernels.Planes(2, *shape), np.empty((*shape, 2), np.float32)
    pair[0][...], pair[1][...] = flow[..., 0], flow[..., 1]
    kernels.store_flow(pair, out)
    np.testing.assert_array_equal(out, flow)


@pytest.mark.parametrize(
    ("image", "error", "message"),
    [
        (np.zeros((H, W)), TypeError, "frame0 to be an array of float32 with 2 dimensions, got float64"),
        (np.zeros((H, W), ">f4"), TypeError, "got format '>f'"),
        (np.zeros((H, W), np.complex64), TypeError, "got format 'Zf'"),
        (np.zeros((H, W), bool), TypeError, "got bool"),
        (b"bytes", TypeError, "got uint8"),
        (None, TypeError, "frame0 to be an array.*got NoneType"),
        (np.zeros((H, 2 * W), np.float32)[:, ::2], ValueError, "frame0.*got one that is not C-contiguous"),
        (np.zeros((H, W, 1), np.float32), ValueError, r"frame0.*got shape \(4, 6, 1\)"),
        (np.zeros(H, np.float32), ValueError, r"frame0.*got shape \(4,\)"),
        (np.zeros((H, 0), np.float32), ValueError, "frame0 to have pixels"),
        (np.zeros((H, W + 1), np.float32), ValueError, r"frame1 to have shape \(4, 7\), got \(4, 6\)"),
        (np.frombuffer(bytes(97), np.float32, 24, 1).reshape(H, W), ValueError, "frame0.*at an address"),
    ],
)
def test_what_a_kernel_refuses_is_named(image, error, message):
    """Another type, layout, number of dimensions or size is an error that names it; nothing is converted."""
    with pytest.raises(error, match=message):
        load(image, np.zeros((H, W), np.float32))


def read_only(array):
    """Make an array read-only."""
    array.flags.writeable = False
    return array


@pytest.mark.parametrize(
    ("out", "error", "message"),
    [
        (np.zeros((H, W, 2)), TypeError, "got float64"),
        (bytes(4 * H * W * 2), TypeError, "got uint8"),
        (read_only(np.zeros((H, W, 2), np.float32)), ValueError, "got a read-only one"),
        (np.zeros((H, W, 3), np.float32)[..., :2], ValueError, "not C-contiguous"),
        (np.zeros((H, W, 3), np.float32), ValueError, r"shape \(4, 6, 2\), got \(4, 6, 3\)"),
    ],
)
def test_results_are_written_into_what_can_take_them(out, error, message):
    """Neither read-only memory nor a copy is ever written to."""
    before = bytes(out) if isinstance(out, bytes) else out.copy()
    with pytest.raises(error, match=f"out.*{message}"):
        kernels.store_flow(kernels.Planes(2, H, W), out)
    np.testing.assert_array_equal(
        np.asarray(bytearray(out) if isinstance(out, bytes) else out),
        np.asarray(bytearray(before) if isinstance(before, bytes) else before),
    )


def test_read_only_images_are_read(rng):
    """What is only read need not be writable."""
    first, second = (read_only(image) for image in images(rng, H, W))
    planes = load(first, second)
    np.testing.assert_array_equal(planes[1], second)


def test_planes_are_checked():
    """Sizes that are not positive or beyond all memory, and planes that are not there, are named."""
    with pytest.raises(ValueError, match=r">= 1.*got 2, 0 and 5"):
        kernels.Planes(2, 0, 5)
    with pytest.raises(ValueError, match=r">= 1 that memory can hold"):
        kernels.Planes(2**40, 2**40, 2**40)
    planes = kernels.Planes(2, 3, 5)
    assert len(planes) == 2
    for plane in (-1, 2):
        with pytest.raises(IndexError, match=f"from 0 to 1, got {plane}"):
            planes[plane]
    for wrong in (kernels.Planes(3, 3, 5), kernels.Planes(2, 3, 6), kernels.Planes(2, 4, 5)):
        with pytest.raises(ValueError, match="expected flow to be 2 planes of 3 x 5, got"):
            kernels.begin_flow(planes, wrong)
    with pytest.raises(ValueError, match="expected frames to be 2 or 4 planes, got 3"):
        kernels.begin_flow(kernels.Planes(3, 3, 5), planes)


def test_numbers_are_checked(rng):
    """Counts that mean nothing are errors with their value."""
    good = {
        "smoothness": 4.0,
        "five_tap": True,
        "outlier": 0.0,
        "relax": 1.0,
        "quarter_square": 0.0,
        "exposure": False,
    }
    for wrong, name in (((0, 1, 1), "warps"), ((1, 0, 1), "sweeps"), ((1, 1, 4), "median")):
        with pytest.raises(ValueError, match=f"{name}.*got {4 if name == 'median' else 0}"):
            kernels.Refinement(warps=wrong[0], sweeps=wrong[1], median=wrong[2], **good)
    grids = kernels.Multigrid(5, 5)
    for count in (0, 3):
        with pytest.raises(ValueError, match=f"even count >= 2, got {count}"):
            grids.sweep(count, 1.0, 0.0)
    with pytest.raises(ValueError, match="size of the grid"):
        grids.begin(*images(rng, 5, 6), False, 10.0)


def test_arrays_outlive_their_planes():
    """An image of planes that nobody else holds, or that were resized, stays valid."""
    planes = kernels.Planes(1, 300, 300)
    image = planes[0]
    image[...] = 7.0
    planes.resize(3, 600, 600)
    del planes
    others = [kernels.Planes(1, 300, 300) for _ in range(4)]
    for other in others:
        other[0][:] = 1.0
    assert (image == 7.0).all()


def test_kernels_let_go_of_the_lock(rng):
    """While a kernel runs, another thread can: one that waits gets its turn though none is ever forced."""
    first, second = images(rng, 300, 300)
    turn = threading.Event()
    calls = 0

    def work() -> None:
        nonlocal calls
        while not turn.is_set() and calls < 3000:
            load(first, second, height=300, width=300)
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


@pytest.mark.parametrize("stub", ["__init__.pyi", "segmentation.pyi"])
def test_no_kernel_takes_more_than_eight_arguments(stub: str) -> None:
    """What belongs together is a struct. Numbers that are given by name are told apart by it."""
    tree = ast.parse((Path(kernels.__file__).parent / "kernels" / stub).read_text(encoding="utf-8"))
    functions = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    assert functions
    taken = [(node.name, [one.arg for one in node.args.args if one.arg != "self"]) for node in functions]
    assert not [function for function in taken if len(function[1]) > 8]


@pytest.mark.usefixtures("level")
@pytest.mark.parametrize("mode", ["classic", "solve", "fast", "default", "accurate"])
def test_all_levels_give_the_same_bits(rng, mode):
    """The processor's level is chosen at import; any lower one can be forced, and computes the same."""
    assert kernels.level() == kernels.levels()[-1]
    first, second = images(rng, 37, 83)
    guess = rng.normal(size=(37, 83, 2)).astype(np.float32)
    results = set()
    for name in kernels.levels():
        kernels.use_level(name)
        assert kernels.level() == name
        solver = HornSchunck(mode, gain=1.0)
        results.add(solver.calc(first, second).tobytes() + solver.calc(first, second, guess.copy()).tobytes())
    assert len(results) == 1


def test_unknown_levels_are_refused():
    """A level that there is not is named beside those that there are."""
    with pytest.raises(ValueError, match=f"{kernels.levels()[-1]}, got 'v9'"):
        kernels.use_level("v9")
