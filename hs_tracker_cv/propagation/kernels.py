"""Compiled kernels of the carried box: the robust fit of a flow field, what is kept of the box, what is learned.

Arrays in, arrays out; no checks, no options: the modules beside this one call them with C-contiguous arrays.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from ..compiling import kernel, larger, local, part, root, smaller

__all__ = ["follow", "keep", "recolour"]

Image = Annotated[NDArray[np.float32], 3]
Plane = Annotated[NDArray[np.float32], 2]
Row = Annotated[NDArray[np.float32], 1]
Bins = Annotated[NDArray[np.int32], 2]
Mask = Annotated[NDArray[np.uint8], 2]

_ONE = np.float32(1.0)
_BINS = 512
_BINS_PER_PX = 64.0
_histogram = local(_BINS)


@part()
def _decay(x: Any) -> Any:
    """``exp(-x)`` of a number that is not negative: kernels call no C function."""
    y = -smaller(x, 700.0) * (1.0 / 1024.0)
    power = 1.0 + y * (1.0 + y * (1 / 2 + y * (1 / 6 + y * (1 / 24 + y * (1 / 120 + y * (1 / 720 + y / 5040))))))
    for _ in range(10):
        power *= power
    return power


@part()
def _fit(flow: Any, planes: Any, k: int, turning: float) -> Any:
    """Fit ``u = tx + s X - r Y, v = ty + s Y + r X`` to a flow field by iteratively re-weighted least squares.

    X, Y are measured from the patch centre, in samples. Eight rounds; every second pixel; Geman–McClure weights
    with the scale set by the median residual; plane `k` holds the weights. Returns tx, ty, s, r and that median.
    """
    _, height, width = planes.shape
    mx, my = 0.5 * (width - 1), 0.5 * (height - 1)
    histogram = _histogram()
    tx, ty, scale, median, turn_rate = 0.0, 0.0, 0.0, 8.0, 0.0
    for turn in range(8):
        half = 0.0
        n = xu = yv = xv = yu = u1 = v1 = xw = yw = xx = yy = 1e-9
        limit = 1.5 * larger(0.05, 1.48 * median)
        for i in range(_BINS):
            histogram[i] = 0.0
        for y in range(turn & 1, height, 2):
            for x in range(0, width, 2):
                w = planes[k, y, x]
                if w <= 0.0:
                    continue
                px, py = x - mx, y - my
                u, v = flow[y, x, 0], flow[y, x, 1]
                half += 0.5 * w
                if turn > 0:
                    du, dv = u - tx - scale * px + turn_rate * py, v - ty - scale * py - turn_rate * px
                    square = du * du + dv * dv
                    fair = 1.0 + square / (limit * limit)
                    histogram[smaller(np.int64(root(square) * _BINS_PER_PX), _BINS - 1)] += w
                    w /= fair * fair
                n += w
                xw += w * px
                yw += w * py
                xx += w * px * px
                yy += w * py * py
                u1 += w * u
                v1 += w * v
                xu += w * px * u
                yv += w * py * v
                xv += w * px * v
                yu += w * py * u
        cxx, cyy = xx - xw * xw / n, yy - yw * yw / n
        cxu, cyv = xu - xw * u1 / n, yv - yw * v1 / n
        scale = (cxu + cyv) / (cxx + cyy + 1e-6)
        turn_rate = turning * (xv - xw * v1 / n - yu + yw * u1 / n) / (cxx + cyy + 1e-6)
        tx, ty = (u1 - scale * xw + turn_rate * yw) / n, (v1 - scale * yw - turn_rate * xw) / n
        if turn > 0:
            running = 0.0
            i = 0
            while i < _BINS - 1 and running + histogram[i] < half:
                running += histogram[i]
                i += 1
            median = (i + 0.5) / _BINS_PER_PX
        else:
            median = 1.0
    return tx, ty, scale, turn_rate, median


@part()
def _read(plane: Any, y: float, x: float) -> Any:
    """Bilinear read inside the plane."""
    iy, ix = smaller(np.int64(y), plane.shape[0] - 2), smaller(np.int64(x), plane.shape[1] - 2)
    fy, fx = y - iy, x - ix
    top = plane[iy, ix] + fx * (plane[iy, ix + 1] - plane[iy, ix])
    low = plane[iy + 1, ix] + fx * (plane[iy + 1, ix + 1] - plane[iy + 1, ix])
    return top + fy * (low - top)


@part()
def _misfit(flow: Any, y: int, x: int, my: float, mx: float, motion: Any) -> Any:
    """Squared distance of a pixel's flow from a motion, samples²."""
    px, py = x - mx, y - my
    du = flow[y, x, 0] - motion[0] - motion[2] * px + motion[3] * py
    dv = flow[y, x, 1] - motion[1] - motion[2] * py - motion[3] * px
    return du * du + dv * dv


@kernel()
def follow(
    a: Plane,
    b: Plane,
    flow: Image,
    prior: Plane,
    likelihood: Plane,
    place_x: float,
    place_y: float,
    ratio: float,
    inner: Plane,
    outside: Plane,
    turning: float,
    separation: float,
    planes: Image,
) -> tuple[float, float, float, float, float, bool]:
    """Fit the object's motion to the flow, and again without the pixels that move with the surroundings.

    A pixel weighs ``prior * G / (G + 30) / (1 + (res / 8)²)²`` in the fit with G the squared gradient of `a` and res
    the 3 × 3 mean of ``|b(x + flow) - a|``: textured, and explained by the flow.

    Parameters
    ----------
    a, b : ndarray, shape (H, W), float32
        Normalised patches.
    flow : ndarray, shape (H, W, 2), float32
        Flow from `a` to `b`, samples.
    prior : ndarray, shape (H, W), float32
        Prior weights of the object, not negative.
    likelihood : ndarray, shape (h, w), float32
        Of the object's colours, on a coarser lattice, as a further prior weight; empty where they do not tell.
    place_x, place_y, ratio : float
        Where on that lattice the patch has its centre, and samples of the lattice per sample of the patch.
    inner : ndarray, shape (H, W), float32
        Weights of sum 1.
    outside : ndarray, shape (H, W), float32
        Prior weights of the surroundings, not negative.
    turning : float
        1, or 0 to leave the rotation at 0.
    separation : float
        Difference of motion, samples, from which object and surroundings are told apart; less than 0: they never are.
    planes : ndarray, shape (5, H, W), float32
        Receives the weights of the object's first fit; the share of "moves with the object" per pixel, 1 where the
        two are not told apart; the prior weights, colours included; and two that were worked in.

    Returns
    -------
    tx, ty, scale, turn : float
        Translation, samples; growth; rotation, radians from x towards y; all from the patch's centre.
    colour : float
        Mean likelihood of the colours under the inner weights; 1 where they do not tell.
    apart : bool
        Object and surroundings were told apart.
    """
    height, width = a.shape
    rows, columns = likelihood.shape
    mx, my = 0.5 * (width - 1), 0.5 * (height - 1)
    for y in range(height):
        for x in range(width):
            px = smaller(larger(x + flow[y, x, 0], 0.0), width - 1.0)
            py = smaller(larger(y + flow[y, x, 1], 0.0), height - 1.0)
            planes[4, y, x] = abs(_read(b, py, px) - a[y, x])
    total = total_around = total_apart = colour = 0.0
    for y in range(height):
        up, down = larger(y - 1, 0), smaller(y + 1, height - 1)
        ly = smaller(larger(place_y + (y - my) * ratio, 0.0), rows - 1.0)
        for x in range(width):
            left, right = larger(x - 1, 0), smaller(x + 1, width - 1)
            res = (
                planes[4, up, left] + planes[4, up, x] + planes[4, up, right]
                + planes[4, y, left] + planes[4, y, x] + planes[4, y, right]
                + planes[4, down, left] + planes[4, down, x] + planes[4, down, right]
            ) / 9.0  # fmt: skip
            gx = 0.5 * (a[y, right] - a[y, left])
            gy = 0.5 * (a[down, x] - a[up, x])
            strength = gx * gx + gy * gy
            fair = 1.0 + (res / 8.0) * (res / 8.0)
            share = strength / (strength + 30.0) / (fair * fair)
            planes[2, y, x] = prior[y, x]
            if rows > 0:
                lx = smaller(larger(place_x + (x - mx) * ratio, 0.0), columns - 1.0)
                like = _read(likelihood, ly, lx)
                planes[2, y, x] *= 0.1 + like
                colour += inner[y, x] * like
            planes[0, y, x] = planes[2, y, x] * share
            planes[1, y, x] = 1.0
            planes[3, y, x] = outside[y, x] * share
            total += planes[0, y, x]
            total_around += planes[3, y, x]
    if rows == 0:
        colour = 1.0
    own, around = np.int64(0), np.int64(3)  # variables: for each constant that a part is given it is compiled anew
    tx, ty, scale, turn, _ = _fit(flow, planes, own, turning)
    if separation < 0.0 or total_around < 10.0:
        return tx, ty, scale, turn, colour, False
    background = _fit(flow, planes, around, turning)
    spread = 0.25 + 1.5 * background[4]
    for y in range(height):
        for x in range(width):
            planes[4, y, x] = _misfit(flow, y, x, my, mx, background)
            planes[3, y, x] = planes[0, y, x] * (1.0 - _decay(planes[4, y, x] * (0.5 / (spread * spread))))
            total_apart += planes[3, y, x]
    if total_apart < 0.25 * total + 1e-3:
        return tx, ty, scale, turn, colour, False
    motion = _fit(flow, planes, around, turning)
    dx, dy = motion[0] - background[0], motion[1] - background[1]
    apart = dx * dx + dy * dy >= separation * separation
    if apart:
        for y in range(height):
            for x in range(width):
                square = planes[4, y, x]
                planes[1, y, x] = square / (square + _misfit(flow, y, x, my, mx, motion) + 0.02)
    return motion[0], motion[1], motion[2], motion[3], colour, apart


@kernel()
def keep(
    kept: Plane,
    planes: Image,
    flow: Image,
    right: float,
    down: float,
    cosine: float,
    sine: float,
    previous: Plane,
    patch: Plane,
    same: float,
    changed: float,
    rate: float,
    body: Plane,
    old: Image,
    mean_rate: float,
    mask_rate: float,
    weights: Plane,
    floor: float,
    room: Image,
    out: Plane,
    new: Image,
) -> None:
    """Move what is kept with the flow; drop what changed on the way and what moves with the surroundings.

    In the same walk over the pixels the patch is taken into the running means.

    Parameters
    ----------
    kept : ndarray, shape (h / 2, w / 2), float32
        What was kept in the frame before, on a lattice of half the resolution of the patches.
    planes : ndarray, shape (5, h, w), float32
        From :func:`follow`.
    flow : ndarray, shape (h, w, 2), float32
        Into the patch from which the result's place is measured, samples of the patch.
    right, down, cosine, sine : float
        The result's centre, from that patch's centre in samples of `kept`, and its turn and zoom.
    previous, patch : ndarray, shape (h, w), float32
        Patches in the frame before, and where the result is wanted.
    same, changed : float
        Difference of gray levels up to which a pixel is the same, and from which it is another.
    rate : float
        Share of what looks as it was learned that counts as the object's again.
    body : ndarray, shape (h / 2, w / 2), float32
        The object's pixels.
    old : ndarray, shape (4, h, w), float32
        Mean patch; mean absolute deviation from it; share of "moves with the object"; prior weight of each pixel in
        the fit of the flow, which follows from the last two.
    mean_rate, mask_rate : float
        Share of this frame in patch and deviation, and in "moves with the object".
    weights : ndarray, shape (h, w), float32
        Prior weight by place.
    floor : float
        What is added to "moves with the object" as a weight.
    room : ndarray, shape (6, h / 2, w / 2), float32
        Zeros; room to work in.
    out : ndarray, shape (h / 2, w / 2), float32
        Receives what is kept.
    new : ndarray, shape (4, h, w), float32
        Receives the new means.
    """
    rows, columns = kept.shape
    height, width = patch.shape
    for y in range(height):
        for x in range(width):
            i, j = y >> 1, x >> 1
            weight, belongs, now = planes[0, y, x], planes[1, y, x], patch[y, x]
            mean, deviation, mask = old[0, y, x], old[1, y, x], old[2, y, x]
            room[0, i, j] += 0.25 * weight / (weight + 0.1)
            room[1, i, j] += 0.25 - 0.5 * belongs
            room[2, i, j] += 0.25 * previous[y, x]
            room[3, i, j] += 0.25 * now
            room[4, i, j] += 0.25 * mean
            room[5, i, j] += 0.25 * deviation
            new[0, y, x] = mean + mean_rate * (now - mean)
            deviation += mean_rate * (abs(now - mean) - deviation)
            mask += mask_rate * weight / (weight + 0.2) * (belongs - mask)
            new[1, y, x] = deviation
            new[2, y, x] = mask
            new[3, y, x] = weights[y, x] * (floor + mask) / (1.0 + 0.01 * deviation * deviation)
    for i in range(rows):
        for j in range(columns):
            room[0, i, j] = kept[i, j] * (1.0 - room[0, i, j] * larger(room[1, i, j], 0.0))
    middle_y, middle_x = 0.5 * (rows - 1), 0.5 * (columns - 1)
    for i in range(rows):
        for j in range(columns):
            up, along = i - middle_y, j - middle_x
            x = right + middle_x + cosine * along - sine * up - 0.5 * flow[2 * i + 1, 2 * j + 1, 0]
            y = down + middle_y + cosine * up + sine * along - 0.5 * flow[2 * i + 1, 2 * j + 1, 1]
            x, y = smaller(larger(x, 0.0), columns - 1.001), smaller(larger(y, 0.0), rows - 1.001)
            ix, iy = np.int64(x), np.int64(y)
            held = before = 0.0
            for k in range(4):
                ky, kx = iy + (k >> 1), ix + (k & 1)
                share = (1.0 - abs(ky - y)) * (1.0 - abs(kx - x))
                held += share * room[0, ky, kx]
                before += share * room[2, ky, kx]
            now = room[3, i, j]
            value = held * smaller(larger((changed - abs(before - now)) / (changed - same), 0.0), 1.0)
            error = (now - room[4, i, j]) / (10.0 + room[5, i, j])
            out[i, j] = value + rate * _decay(error * error) * (body[i, j] - value)


@kernel()
def recolour(bins: Bins, inside: Mask, taps: Row, rate: float, old: Plane, counts: Plane, new: Plane) -> None:
    """Take the colours of a coarse window into the histograms.

    Parameters
    ----------
    bins : ndarray, shape (h, w), int32
        Bin of each sample.
    inside : ndarray, shape (h, w), uint8
        1 inside the box.
    taps : ndarray, shape (2 n + 1,), float32
        Filter that smooths a frame's histograms.
    rate : float
        Share of this frame.
    old : ndarray, shape (2, bins), float32
        Shares of the bins inside and outside.
    counts : ndarray, shape (2, bins), float32
        Zeros; room to work in.
    new : ndarray, shape (2, bins), float32
        Receives the new shares.
    """
    rows, columns = bins.shape
    size, reach = old.shape[1], taps.shape[0] // 2
    for i in range(rows):
        for j in range(columns):
            counts[1 - inside[i, j], bins[i, j]] += _ONE
    for k in range(2):
        total = 1e-9
        for i in range(size):
            value = 0.0
            for j in range(2 * reach + 1):
                # beyond the ends the bins are mirrored, as in OpenCV's filters
                value += taps[j] * counts[k, size - 1 - abs(size - 1 - abs(i + j - reach))]
            new[k, i] = value
            total += value
        for i in range(size):
            new[k, i] = old[k, i] + rate * (new[k, i] / total - old[k, i])
