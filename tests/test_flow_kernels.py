"""The numerical core piece by piece, each against an independent way to the same numbers."""

from __future__ import annotations

import itertools
import subprocess
import sys

import cv2
import numpy as np
import pytest

from hs_tracker_cv.flow import derivatives, kernels, multigrid, pyramid, reference
from hs_tracker_cv.flow.params import FlowParams
from hs_tracker_cv.flow.program import ProgramWriter, area, origin, pixels, spare, stride

H, W = 7, 21
SHAPE = (H, W)
SIZE = area(SHAPE)
IMAGES = [np.zeros((0, 0, channels), np.float32) for channels in (1, 1, 2)]


def memory(planes, seed=0, shape=SHAPE):
    """Workspace of random planes, and the index of each plane's first pixel."""
    size = planes * area(shape) + spare(shape)
    m = np.random.default_rng(seed).uniform(0, 255, size).astype(np.float32)
    return m, [i * area(shape) + origin(shape) for i in range(planes)]


def inside(m, plane, ring=0, shape=SHAPE):
    """Pixels of a plane, and those of its ring so deep, as a view."""
    rows, columns = (n + 2 * ring for n in shape)
    step = stride(shape[1])
    first = plane - ring * (step + 1)
    return np.lib.stride_tricks.as_strided(m[first:], (rows, columns), (4 * step, 4))


def pad(m, plane):
    """Repeat the border of a plane in its ring, in NumPy."""
    inside(m, plane, 2)[...] = np.pad(inside(m, plane).copy(), 2, mode="edge")


def run(m, code, size, *numbers, **options):
    """Run one step on the memory; return its sum."""
    writer = ProgramWriter()
    writer.add(code, size, *numbers, **options)
    return writer.program().run(m, *IMAGES)


def test_pad_repeats_the_border():
    """The ring holds the nearest pixel, and nothing is written beyond."""
    m, (a,) = memory(1)
    expected = m.copy()
    pad(expected, a)
    run(m, kernels.PAD, SHAPE, 0, a, rings=1)
    np.testing.assert_array_equal(m, expected)


@pytest.mark.parametrize("width", [1, 7, 15, 16, 17, 33])
def test_images_are_copied_in_and_out(width):
    """What is finite of frames and flow comes into planes, and the flow out of them; nothing beyond is written."""
    shape = (3, width)
    rng = np.random.default_rng(4)
    frames = rng.uniform(0, 255, (2, *shape, 1)).astype(np.float32)
    room = rng.uniform(-9, 9, (4, width, 2)).astype(np.float32)
    flow, beyond = room[:3], room[3].copy()
    frames[1, 1, 0], flow[2, 0, 1] = np.nan, -np.inf
    expected = [*frames[..., 0], *np.moveaxis(flow, -1, 0)]
    m, planes = memory(4, shape=shape)
    writer = ProgramWriter()
    for i in range(2):
        writer.load(i, planes[i], shape)
    writer.load_flow(planes[2], area(shape), shape)
    writer.store_flow(planes[2], area(shape), shape)
    writer.program().run(m, *frames, flow)
    for plane, image in zip(planes, expected, strict=True):
        np.testing.assert_array_equal(pixels(m, plane, shape), np.nan_to_num(image, posinf=0.0, neginf=0.0))
    np.testing.assert_array_equal(flow, np.stack([pixels(m, plane, shape) for plane in planes[2:]], axis=-1))
    np.testing.assert_array_equal(room[3], beyond)


def test_rings_of_zeros_of_several_planes():
    """The rings of planes a distance apart are filled with zeros."""
    m, planes = memory(3)
    expected = m.copy()
    for plane in planes:
        inside(expected, plane, 2)[...] = np.pad(inside(m, plane).copy(), 2)
    run(m, kernels.PAD, SHAPE, 0, planes[0], 0, SIZE, rings=3, zero=True)
    np.testing.assert_array_equal(m, expected)


@pytest.mark.parametrize("width", [1, 2, 15, 16, 17, 31, 32, 33, 48])
def test_no_element_outside_of_the_rows_is_written(width):
    """A formula writes the pixels of its plane and nothing else, whatever part of a block its rows end with."""
    shape = (3, width)
    m, (a, b) = memory(2, shape=shape)
    expected = m.copy()
    inside(expected, b, shape=shape)[...] += 2 * inside(m, a, shape=shape)
    run(m, kernels.ADD, shape, a, b, factors=(2.0,))
    np.testing.assert_allclose(m, expected, rtol=1e-6)


@pytest.mark.parametrize("width", [1, 15, 16, 17, 40])
def test_cube_equals_the_reference(width):
    """The cube's formula gives the paper's derivatives."""
    frame0, frame1 = np.random.default_rng(2).uniform(2, 255, (2, 6, width)).astype(np.float32)
    for ours, expected in zip(derivatives(frame0, frame1), reference.derivatives(frame0, frame1), strict=True):
        np.testing.assert_allclose(ours, expected, atol=1e-3)


@pytest.mark.parametrize("size", [3, 5])
def test_median_equals_opencv(size):
    """The sorting network's median is cv2.medianBlur's, the border repeated."""
    m, (a, b) = memory(2)
    image = inside(m, a).copy()
    pad(m, a)
    run(m, kernels.MEDIAN, SHAPE, a, b, e=size)
    np.testing.assert_array_equal(inside(m, b), cv2.medianBlur(image, size))


@pytest.mark.parametrize("repeat", [1, 4, 5])
def test_repeated_sweeps_change_places(repeat):
    """After an even number of turns the result is where it began, after an odd one in the other pair."""
    m, planes = memory(7, seed=1)
    m /= 255
    writer = ProgramWriter()
    for plane in planes[:2]:
        writer.add(kernels.PAD, SHAPE, 0, plane, rings=1)
    result, _ = writer.sweep(planes[0], planes[2], planes[4], SIZE, SHAPE, repeat, (1.0, 0.0))
    assert result == (planes[0] if repeat % 2 == 0 else planes[2])
    u, v = inside(m, planes[0]).copy(), inside(m, planes[1]).copy()
    gx, gy, gt = (inside(m, plane) for plane in planes[4:])
    for _ in range(repeat):
        u, v = reference.average(u), reference.average(v)
        t = gx * u + gy * v + gt
        u, v = u - gx * t, v - gy * t
    writer.program().run(m, *IMAGES)
    np.testing.assert_allclose(inside(m, result), u, rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(inside(m, result + SIZE), v, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("n", [2, 3, 5, 9, 12])
def test_exchanges_sort(n):
    """By the 0–1 principle the network sorts, since it sorts every sequence of zeros and ones."""
    for values in itertools.product((0, 1), repeat=n):
        row = list(values)
        for i, j in kernels.merge_sort_exchanges(n):
            row[i], row[j] = min(row[i], row[j]), max(row[i], row[j])
        assert row == sorted(values)


def test_median_candidates_and_exchanges_suffice():
    """The median of 5 × 5 is found whatever the order of the values in columns and ranks that are sorted.

    By the 0–1 principle it is enough that zeros and ones come out right. With columns sorted, then ranks, the number
    of ones does not fall from rank to rank, and within a rank ones come last.
    """
    for ones in itertools.combinations_with_replacement(range(6), 5):
        values = [int(column >= 5 - ones[rank]) for rank, column in kernels.MEDIAN_CANDIDATES]
        for i, j in kernels.MEDIAN_EXCHANGES:
            values[i], values[j] = min(values[i], values[j]), max(values[i], values[j])
        assert values[6] == int(sum(ones) >= 13)


def test_warp_is_keys_interpolation():
    """Bicubic samples are exact for a quadratic, at whole pixels are the pixel, outside are masked."""
    m, (b, u, v, warped, mask, row, *_) = memory(9)
    y, x = np.mgrid[:H, :W].astype(np.float32)
    quadratic = 3 + x * x - 2 * y * y + x * y
    inside(m, b)[...] = quadratic
    pad(m, b)
    inside(m, u)[:], inside(m, v)[:] = 0.0, 0.0
    inside(m, u)[3, 4], inside(m, v)[3, 4] = 0.3, -0.6
    inside(m, u)[0, 0] = -0.1
    run(m, kernels.WARP, SHAPE, b, warped, u, SIZE, mask, row)
    expected = quadratic.copy()
    expected[3, 4] = 3 + 4.3**2 - 2 * 2.4**2 + 4.3 * 2.4
    np.testing.assert_allclose(inside(m, warped), expected, rtol=1e-5)
    assert inside(m, mask)[0, 0] == 0.0
    assert inside(m, mask).sum() == H * W - 1


def test_restriction_sums_and_prolongation_keeps_constants():
    """Restriction gives the sum over 2 × 2 pixels; prolongation of a constant is that constant."""
    fine, coarse = SHAPE, ((H + 1) // 2, (W + 1) // 2)
    m, (a, b, c) = memory(3)
    inside(m, a, 1)[...] = np.pad(np.ones(fine), 1)
    inside(m, c)[...] = 0.0
    expected = np.pad(np.ones(fine), ((0, 1), (0, 1))).reshape(coarse[0], 2, coarse[1], 2).sum(axis=(1, 3))
    run(m, kernels.RESTRICT, coarse, a, b, source_width=W)
    np.testing.assert_array_equal(inside(m, b, shape=coarse), expected)
    inside(m, b, 1, shape=coarse)[...] = 4.0
    for keep, result in ((0.0, 4.0), (1.0, 8.0)):
        run(m, kernels.PROLONG, fine, b, c, source_width=coarse[1], factors=(keep,))
        np.testing.assert_allclose(inside(m, c), result)


def test_coarse_system_is_the_sum_of_products():
    """PROJECT sums the products of the scaled derivatives over 2 × 2 pixels; what is missing counts as zero."""
    m, (*g, b, _, _, _, _) = memory(9)
    run(m, kernels.PAD, SHAPE, 0, g[0], 0, SIZE, rings=4, zero=True)
    fx, fy, ft, weight = (np.pad(inside(m, plane), ((0, 1), (0, 1))) for plane in g)
    coarse = (H // 2 + 1, W // 2 + 1)
    run(m, kernels.PROJECT, coarse, g[0], b, 0, SIZE, area(coarse), source_width=W)
    for i, product in enumerate((fx * fx, fx * fy, fy * fy, -ft * fx, -ft * fy)):
        plane = inside(m, b + i * area(coarse), shape=coarse)
        product = product * weight
        expected = product[::2, ::2] + product[1::2, ::2] + product[::2, 1::2] + product[1::2, 1::2]
        np.testing.assert_allclose(plane, expected, rtol=1e-5)


def test_levels_shrink_by_the_ratio_down_to_the_smallest_side():
    """The pyramid has the sizes asked for, and stops at 16 px or at the number of levels."""
    levels = pyramid.plan(100, 200, FlowParams.preset("fast", ratio=0.5))
    assert levels.sizes == ((100, 200), (50, 100), (25, 50))
    assert pyramid.plan(100, 200, FlowParams.preset("fast", levels=2)).sizes == ((100, 200), (65, 130))
    assert pyramid.plan(3, 500, FlowParams.preset("fast")).sizes == ((3, 500),)
    blurs = levels.program.factors[levels.program.steps[:, 0] == kernels.RESAMPLE][:, 1:4]
    assert len(blurs) == 2 + 2 * 2 + 2 * 2
    for taps in blurs:
        assert taps[0] + 2 * (taps[1] + taps[2]) == pytest.approx(1.0, abs=1e-6)


def test_grids_halve():
    """The multigrid's sizes are halved, rounding up, down to 4 px."""
    assert multigrid.plan(19, 33, False, 10.0).sizes == ((19, 33), (10, 17), (5, 9), (3, 5))


BETWEEN_GUARDS = """
import ctypes
import itertools
import sys
import numpy as np
from hs_tracker_cv.flow import multigrid, pyramid
from hs_tracker_cv.flow.params import FlowParams

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
        frames = [guarded(at_end, *shape, 1) for _ in range(2)]
        flow = guarded(at_end, *shape, 2)
        for image in (*frames, flow):
            image[...] = rng.uniform(0, 9, image.shape)
        params = FlowParams.preset(mode, **MODES[mode])
        if mode == "solve":
            grids = multigrid.plan(*shape, False, params.smoothness)
            multigrid.solve(*frames, flow, started, params, grids, guarded(at_end, grids.memory))
        else:
            levels = pyramid.plan(*shape, params, started)
            levels.program.run(guarded(at_end, levels.memory), *frames, flow)
        assert np.isfinite(flow).all()
        while maps:
            libc.munmap(*maps.pop())
"""


@pytest.mark.skipif(sys.platform != "linux", reason="needs pages that may not be touched")
def test_no_memory_outside_of_the_arrays_is_touched():
    """With pages before and after each array that may not be touched, all modes run at all sizes."""
    subprocess.run([sys.executable, "-c", BETWEEN_GUARDS], check=True)
