"""The numerical core piece by piece, each against an independent way to the same numbers."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest

from hs_tracker_cv.flow import kernels, multigrid, pyramid, reference
from hs_tracker_cv.flow.params import FlowParams
from hs_tracker_cv.flow.program import ProgramWriter

H, W = 7, 9
SIZE = (H + 4) * (W + 4)
SHAPE = (H, W)


def memory(planes, seed=0):
    """Workspace of random planes, and the index of each plane's first element."""
    m = np.random.default_rng(seed).uniform(0, 255, planes * SIZE).astype(np.float32)
    return m, [i * SIZE for i in range(planes)]


def inside(m, plane):
    """Pixels of a plane, without its ring, as a view."""
    return m[plane : plane + SIZE].reshape(H + 4, W + 4)[2:-2, 2:-2]


def padded(image):
    """The image with its border repeated twice, as a flat plane."""
    return np.pad(image, 2, mode="edge").ravel()


def run(m, code, size, *numbers, **options):
    """Run one step on the memory; return its sum."""
    writer = ProgramWriter()
    writer.add(code, size, *numbers, **options)
    image = np.zeros((1, 1, 1), np.float32)
    return writer.program().run(m, image, image, image)


@pytest.mark.parametrize("depth", [1, 2])
def test_pad_repeats_the_border(depth):
    """The ring holds the nearest pixel, as deep as asked for, and is left alone beyond."""
    m, (a,) = memory(1)
    expected = m.copy().reshape(H + 4, W + 4)
    ring = slice(2 - depth, depth - 2 or None)
    expected[ring, ring] = np.pad(inside(m, a).copy(), depth, mode="edge")
    run(m, kernels.PAD, SHAPE, 0, a, rings=1, depth=depth)
    np.testing.assert_array_equal(m.reshape(expected.shape), expected)


def test_rings_of_zeros_of_several_planes():
    """The rings of planes a distance apart are filled with zeros."""
    m, planes = memory(3)
    expected = [np.pad(inside(m, plane).copy(), 2) for plane in planes]
    run(m, kernels.PAD, SHAPE, 0, planes[0], 0, SIZE, rings=3, depth=2, zero=True)
    np.testing.assert_array_equal(m.reshape(3, H + 4, W + 4), expected)


def test_cube_source_equals_the_reference():
    """The kernel's Python source, not compiled, gives the paper's derivatives."""
    m, planes = memory(5)
    a, b, *slopes = planes
    for plane in (a, b):
        m[plane : plane + SIZE] = padded(inside(m, plane).copy())
    kernels.cube.py_func(m, *np.array([a, b, slopes[0], SIZE, *SHAPE], np.uint64))
    for plane, expected in zip(slopes, reference.derivatives(inside(m, a), inside(m, b)), strict=True):
        np.testing.assert_allclose(inside(m, plane), expected, atol=1e-3)


@pytest.mark.parametrize("size", [3, 5])
def test_median_equals_opencv(size):
    """The sorting network's median is cv2.medianBlur's, the border repeated."""
    m, (a, b) = memory(2)
    image = inside(m, a).copy()
    run(m, kernels.PAD, SHAPE, 0, a, rings=1, depth=2)
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
    image = np.zeros((1, 1, 1), np.float32)
    writer.program().run(m, image, image, image)
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


def test_warp_is_keys_interpolation():
    """Bicubic samples are exact for a quadratic, at whole pixels are the pixel, outside are masked."""
    m, (b, u, v, warped, mask) = memory(5)
    y, x = np.mgrid[:H, :W].astype(np.float32)
    quadratic = 3 + x * x - 2 * y * y + x * y
    m[:SIZE] = padded(quadratic)
    inside(m, u)[:], inside(m, v)[:] = 0.0, 0.0
    inside(m, u)[3, 4], inside(m, v)[3, 4] = 0.3, -0.6
    inside(m, u)[0, 0] = -0.1
    run(m, kernels.WARP, SHAPE, b, warped, u, SIZE, mask)
    expected = quadratic.copy()
    expected[3, 4] = 3 + 4.3**2 - 2 * 2.4**2 + 4.3 * 2.4
    np.testing.assert_allclose(inside(m, warped), expected, rtol=1e-5)
    assert inside(m, mask)[0, 0] == 0.0
    assert inside(m, mask).sum() == H * W - 1


def test_restriction_sums_and_prolongation_keeps_constants():
    """Restriction gives the sum over 2 × 2 pixels; prolongation of a constant is that constant."""
    ones = np.ones(4 * 144, np.float32)
    ones[144:] = 0.0
    run(ones, kernels.RESTRICT, (4, 4), 0, 144, e=8)
    coarse = ones[144 : 144 + 64].reshape(8, 8)
    np.testing.assert_array_equal(coarse[2:-2, 2:-2], 4.0)
    coarse[1:-1, 1:-1] = 4.0
    run(ones, kernels.PROLONG, (8, 8), 144, 288, 432, e=4)
    np.testing.assert_allclose(ones[288 : 288 + 144].reshape(12, 12)[2:-2, 2:-2], 4.0)


def test_coarse_system_is_the_sum_of_products():
    """PROJECT sums the products of the derivatives over 2 × 2 pixels; what is missing counts as zero."""
    m, (f, *_) = memory(3)
    run(m, kernels.PAD, SHAPE, 0, f, 0, SIZE, rings=3, zero=True)
    fx, fy, ft = (np.pad(inside(m, i * SIZE), ((0, 1), (0, 1))) for i in range(3))
    coarse = (H // 2 + 1 + 4) * (W // 2 + 1 + 4)
    m = np.concatenate((m, np.zeros(5 * coarse, np.float32)))
    run(m, kernels.PROJECT, (H // 2 + 1, W // 2 + 1), f, 3 * SIZE, 0, SIZE, W, factors=(0.5,))
    for i, product in enumerate((fx * fx, fx * fy, fy * fy, -ft * fx, -ft * fy)):
        plane = m[3 * SIZE + i * coarse :][:coarse].reshape(H // 2 + 5, W // 2 + 5)[2:-2, 2:-2]
        expected = 0.5 * (product[::2, ::2] + product[1::2, ::2] + product[::2, 1::2] + product[1::2, 1::2])
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
