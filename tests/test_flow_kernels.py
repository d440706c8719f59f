"""The numerical core piece by piece, each against an independent way to the same numbers."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from numba import njit

from hs_tracker_cv.flow import kernels, multigrid, pyramid, reference
from hs_tracker_cv.flow.params import FlowParams

H, W = 7, 9
SIZE = (H + 4) * (W + 4)
SHAPE = tuple(np.array([H, W], np.uint64))


def memory(planes, seed=0):
    """Workspace of random planes, and the index of each plane's first element."""
    m = np.random.default_rng(seed).uniform(0, 255, planes * SIZE).astype(np.float32)
    return m, list(np.arange(planes, dtype=np.uint64) * np.uint64(SIZE))


def inside(m, plane):
    """Pixels of a plane, without its ring, as a view."""
    return m[int(plane) : int(plane) + SIZE].reshape(H + 4, W + 4)[2:-2, 2:-2]


def padded(image):
    """The image with its border repeated twice, as a flat plane."""
    return np.pad(image, 2, mode="edge").ravel()


def compiled(kernel):
    """Kernel made callable from here: inner kernels have no Python wrapper of their own."""
    return njit(lambda *arguments: kernel(*arguments))


def test_pad_repeats_the_border():
    """The ring holds the nearest pixel."""
    m, (a,) = memory(1)
    expected = padded(inside(m, a).copy())
    compiled(kernels.pad)(m, a, *SHAPE)
    np.testing.assert_array_equal(m, expected)


def test_cube_source_equals_the_reference():
    """The kernel's Python source, not compiled, gives the paper's derivatives."""
    m, (a, b, fx, fy, ft) = memory(5)
    for plane in (a, b):
        m[int(plane) : int(plane) + SIZE] = padded(inside(m, plane).copy())
    kernels.cube.py_func(m, a, b, fx, fy, ft, *SHAPE)
    for plane, expected in zip((fx, fy, ft), reference.derivatives(inside(m, a), inside(m, b)), strict=True):
        np.testing.assert_allclose(inside(m, plane), expected, atol=1e-3)


@pytest.mark.parametrize("size", [3, 5])
def test_median_equals_opencv(size):
    """The sorting network's median is cv2.medianBlur's, the border repeated."""
    m, (a, b) = memory(2)
    image = inside(m, a).copy()
    compiled(kernels.median_filter)(m, a, b, np.uint64(size), *SHAPE)
    np.testing.assert_array_equal(inside(m, b), cv2.medianBlur(image, size))


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
    compiled(kernels.warp)(m, b, u, v, warped, mask, *SHAPE)
    expected = quadratic.copy()
    expected[3, 4] = 3 + 4.3**2 - 2 * 2.4**2 + 4.3 * 2.4
    np.testing.assert_allclose(inside(m, warped), expected, rtol=1e-5)
    assert inside(m, mask)[0, 0] == 0.0
    assert inside(m, mask).sum() == H * W - 1


def test_restriction_sums_and_prolongation_keeps_constants():
    """Restriction gives the sum over 2 × 2 pixels; prolongation of a constant is that constant."""
    h, w = np.uint64(8), np.uint64(8)
    ones = np.ones(4 * 144, np.float32)
    ones[144:] = 0.0
    compiled(kernels.restrict)(ones, np.uint64(0), h, w, np.uint64(144), np.uint64(4), np.uint64(4))
    coarse = ones[144 : 144 + 64].reshape(8, 8)
    np.testing.assert_array_equal(coarse[2:-2, 2:-2], 4.0)
    coarse[1:-1, 1:-1] = 4.0
    compiled(kernels.prolong)(ones, np.uint64(144), np.uint64(4), np.uint64(4), np.uint64(288), h, w, np.uint64(432))
    np.testing.assert_allclose(ones[288 : 288 + 144].reshape(12, 12)[2:-2, 2:-2], 4.0)


def test_levels_shrink_by_the_ratio_down_to_the_smallest_side():
    """The pyramid has the sizes asked for, and stops at 16 px or at the number of levels."""
    levels = pyramid.plan(100, 200, FlowParams.preset("fast", ratio=0.5))
    assert levels.sizes.tolist() == [[100, 200], [50, 100], [25, 50]]
    assert pyramid.plan(100, 200, FlowParams.preset("fast", levels=2)).sizes.tolist() == [[100, 200], [65, 130]]
    assert pyramid.plan(3, 500, FlowParams.preset("fast")).sizes.tolist() == [[3, 500]]
    for taps in (levels.presmooth, levels.blur):
        assert taps[0] + 2 * (taps[1] + taps[2]) == pytest.approx(1.0, abs=1e-6)


def test_grids_halve():
    """The multigrid's sizes are halved, rounding up, down to 4 px."""
    assert multigrid.plan(19, 33).sizes.tolist() == [[19, 33], [10, 17], [5, 9], [3, 5]]
