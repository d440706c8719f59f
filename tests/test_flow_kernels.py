"""The parts of the flow one by one, each against an independent way to the same numbers."""

from __future__ import annotations

import itertools
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from hs_tracker_cv._native import kernels
from hs_tracker_cv.flow import derivatives, reference
from hs_tracker_cv.flow.coarse_to_fine import coarse_to_fine, gaussian, level_sizes
from hs_tracker_cv.flow.params import FlowParams
from hs_tracker_cv.flow.workspace import Workspace

SOURCE = Path(__file__).parents[1] / "hs_tracker_cv" / "_native" / "warping.cpp"


def planes_of(*images):
    """Planes that hold these images."""
    planes = kernels.Planes(len(images), *images[0].shape)
    for plane, image in enumerate(images):
        planes[plane][...] = image
    return planes


@pytest.mark.parametrize("width", [1, 15, 16, 17, 40])
def test_cube_equals_the_reference(width):
    """The cube gives the paper's derivatives."""
    frame0, frame1 = np.random.default_rng(2).uniform(2, 255, (2, 6, width)).astype(np.float32)
    for ours, expected in zip(derivatives(frame0, frame1), reference.derivatives(frame0, frame1), strict=True):
        np.testing.assert_allclose(ours, expected, atol=1e-3)


@pytest.mark.parametrize("side", [3, 5])
@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (7, 21), (30, 300), (4, 600)])
def test_median_equals_opencv(rng, side, shape):
    """The sorting network's median is cv2.medianBlur's, the border repeated."""
    first, second = rng.normal(size=(2, *shape)).astype(np.float32)
    out = kernels.Planes(2, *shape)
    kernels.median(planes_of(first, second), out, side)
    np.testing.assert_array_equal(out[0], cv2.medianBlur(first, side))
    np.testing.assert_array_equal(out[1], cv2.medianBlur(second, side))


def networks():
    """Candidates (rank within the column, then among the columns) and exchanges of the 5 × 5 median's source."""
    text = SOURCE.read_text(encoding="utf-8")
    body = text[text.index("inline float median_of_candidates(") :]
    names = re.findall(r"r(\d)(\d)", body[: body.index("{")])
    exchanges = re.findall(r"order\(r(\d\d), r(\d\d)\);", body[: body.index("}")])
    order = ["".join(name) for name in names]
    result = order.index(re.search(r"return r(\d\d);", body)[1])
    return [(int(i), int(j)) for i, j in names], [(order.index(a), order.index(b)) for a, b in exchanges], result


@pytest.mark.skipif(not SOURCE.is_file(), reason="the source is not installed")
def test_median_candidates_and_exchanges_suffice():
    """The median of 5 × 5 is found whatever the order of the values in columns and ranks that are sorted.

    By the 0–1 principle it is enough that zeros and ones come out right. With columns sorted, then ranks, the number
    of ones does not fall from rank to rank, and within a rank ones come last.
    """
    candidates, exchanges, result = networks()
    assert (len(candidates), len(exchanges)) == (13, 16)
    for ones in itertools.combinations_with_replacement(range(6), 5):
        values = [int(column >= 5 - ones[rank]) for rank, column in candidates]
        for i, j in exchanges:
            values[i], values[j] = min(values[i], values[j]), max(values[i], values[j])
        assert values[result] == int(sum(ones) >= 13)


def test_warp_is_keys_interpolation():
    """Bicubic samples are exact for a quadratic, at whole pixels are the pixel, outside are masked."""
    height, width = 7, 300
    y, x = np.mgrid[:height, :width].astype(np.float32)
    x /= 16
    quadratic = 3 + x * x - 2 * y * y + x * y
    u, v = np.zeros_like(x), np.zeros_like(x)
    u[3, 4], v[3, 4] = 0.3, -0.6
    u[3, 290], v[3, 290] = -0.3, 0.4
    u[0, 0] = -0.1
    out = kernels.Planes(2, height, width)
    kernels.warp(planes_of(x, quadratic), planes_of(u, v), out)
    expected = quadratic.copy()
    for row, column in ((3, 4), (3, 290)):
        xs, ys = x[row, column] + u[row, column] / 16, y[row, column] + v[row, column]
        expected[row, column] = 3 + xs * xs - 2 * ys * ys + xs * ys
    np.testing.assert_allclose(out[0], expected, rtol=1e-5)
    assert out[1][0, 0] == 0.0
    assert out[1].sum() == height * width - 1


@pytest.mark.parametrize("flow", [np.nan, np.inf, -np.inf, 1e30, -1e30])
def test_warp_reads_inside_whatever_the_flow_is(rng, flow):
    """A flow that is no number or beyond all bounds samples the border, and is masked."""
    frame = rng.uniform(1, 2, (5, 20)).astype(np.float32)
    out = kernels.Planes(2, 5, 20)
    kernels.warp(planes_of(frame, frame), planes_of(np.full_like(frame, flow), np.zeros_like(frame)), out)
    assert np.isin(out[0], frame[:, [0, -1]]).all()
    assert not out[1].any()


def test_levels_shrink_by_the_ratio_down_to_the_smallest_side():
    """The pyramid has the sizes asked for, and stops at 16 px or at the number of levels."""
    assert level_sizes((100, 200), 32, 0.5) == ((100, 200), (50, 100), (25, 50))
    assert level_sizes((100, 200), 2, 0.65) == ((100, 200), (65, 130))
    assert level_sizes((3, 500), 32, 0.65) == ((3, 500),)
    for sigma in (0.3, 0.5, 1.0):
        centre, near, far = gaussian(sigma)
        assert centre + 2 * (near + far) == pytest.approx(1.0, abs=1e-6)
        assert near / centre == pytest.approx(np.exp(-0.5 / sigma**2))
    assert gaussian(0.0) == (1.0, 0.0, 0.0)


@pytest.mark.parametrize("shape", [(16, 20), (33, 70), (5, 300)])
def test_levels_are_reduced_as_by_opencv(rng, shape):
    """A level is the blurred finer one, sampled centre-aligned as cv2.resize does; the flow shrinks with it."""
    images = rng.uniform(0, 255, (4, *shape)).astype(np.float32)
    size = tuple(round(0.65 * n) for n in shape)
    blur = gaussian(0.8)
    out = kernels.Planes(4, *size)
    kernels.reduce_frames(planes_of(*images), blur, out)
    taps = np.array([blur[2], blur[1], blur[0], blur[1], blur[2]])
    gains = (1.0, 1.0, size[1] / shape[1], size[0] / shape[0])
    for plane, (image, gain) in enumerate(zip(images, gains, strict=True)):
        blurred = cv2.sepFilter2D(image, -1, taps, taps, borderType=cv2.BORDER_REPLICATE)
        y, x = (((np.arange(n) + 0.5) * m / n - 0.5).astype(np.float32) for n, m in zip(size, shape, strict=True))
        expected = interpolate(blurred, y, x)
        np.testing.assert_allclose(out[plane], gain * expected, atol=1e-2)


def interpolate(image, y, x):
    """Bilinear samples of an image at rows y and columns x, in float64."""
    rows, columns = np.arange(image.shape[0]), np.arange(image.shape[1])
    across = np.stack([np.interp(x, columns, row) for row in image.astype(np.float64)])
    return np.stack([np.interp(y, rows, column) for column in across.T], axis=1)


def test_grids_halve():
    """The multigrid's sizes are halved, rounding up, down to 4 px."""
    assert kernels.Multigrid(19, 33).sizes() == [(19, 33), (10, 17), (5, 9), (3, 5)]
    assert kernels.Multigrid(3, 900).sizes() == [(3, 900)]


def test_a_solver_is_a_function(rng):
    """Coarse to fine takes any function that refines a flow in place: here one in NumPy that knows the answer."""
    frames = rng.uniform(0, 255, (2, 60, 90)).astype(np.float32)
    flow = np.empty((60, 90, 2), np.float32)
    shapes, found = [], []

    def solver(images, planes):
        shapes.append(images[0].shape)
        found.append(float(planes[0].mean()) / images[0].shape[1])
        planes[0][...] = 0.05 * images[0].shape[1]
        planes[1][...] = -0.02 * images[0].shape[0]

    params = FlowParams.preset("fast", ratio=0.5, presmooth=0.0)
    coarse_to_fine(*frames, solver, flow, False, params, Workspace())
    assert shapes == [(30, 45), (60, 90)]
    np.testing.assert_allclose(found, [0.0, 0.05], atol=1e-6)
    np.testing.assert_allclose(flow, np.broadcast_to((4.5, -1.2), flow.shape), rtol=1e-6)


BETWEEN_GUARDS = """
import ctypes
import itertools
import numpy as np
from hs_tracker_cv.flow import HornSchunck

libc, page, maps = ctypes.CDLL(None), 4096, []
libc.mmap.restype = ctypes.c_void_p
libc.mmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int, ctypes.c_int, ctypes.c_int, ctypes.c_long]
libc.mprotect.argtypes = [ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int]
libc.munmap.argtypes = [ctypes.c_void_p, ctypes.c_size_t]

def guarded(at_end, *shape):
    n = 4 * int(np.prod(shape))
    room = -(-n // page) * page
    first = libc.mmap(None, room + 2 * page, 3, 0x22, -1, 0)
    maps.append((first, room + 2 * page))
    for guard in (first, first + page + room):
        assert libc.mprotect(guard, page, 0) == 0
    place = first + page + (room - n if at_end else 0)
    return np.frombuffer((ctypes.c_char * n).from_address(place), np.float32).reshape(shape)

MODES = {"classic": {}, "solve": {}, "default": {}, "fast": {"median": 3, "derivative": "cube", "presmooth": 0.0}}
rng = np.random.default_rng(0)
for shape in ((1, 1), (5, 1), (2, 17), (16, 16), (33, 31), (40, 96)):
    for at_end, started, mode in itertools.product((False, True), (False, True), MODES):
        frames = [guarded(at_end, *shape) for _ in range(2)]
        guess = guarded(at_end, *shape, 2) if started else None
        for image in (*frames, guess):
            if image is not None:
                image[...] = rng.uniform(0, 9, image.shape)
        assert np.isfinite(HornSchunck(mode, gain=1.0, **MODES[mode]).calc(*frames, guess)).all()
        del image, guess, frames
        while maps:
            libc.munmap(*maps.pop())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs pages that may not be touched")
def test_no_memory_outside_of_the_arrays_is_touched():
    """With pages before and after each array that may not be touched, all modes run at all sizes."""
    subprocess.run([sys.executable, "-c", BETWEEN_GUARDS], check=True)
