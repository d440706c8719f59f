"""How things move: registration with a layer, robust fit of a flow, search over translations."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, local, root, smaller
from .common import Image, Integers, Mask, Numbers, Plane, fast_kernel, fast_part, select

_BLOCK = 64  # points at a time
_SETTLED = 0.02  # px, of a step of Gauss–Newton: what the next one would add is a fraction of that
_BRIGHTNESS = 0.1  # px that a percent of gain or a gray level of bias is worth there
_THINNED = 3  # every third residual tells the median

_row = local(_BLOCK)
_corners = local(3, 4, _BLOCK)
_three = local(3)
_six = local(6)
_eight = local(8)
_three_by_three = local(3, 3)
_eight_by_eight = local(8, 8)


@fast_part
def _solve(a, b, n):
    """Solve the symmetric positive definite system a x = b of n equations in place (Cholesky); x is left in `b`."""
    for j in range(n):
        for k in range(j):
            b[j] -= a[j, k] * b[k]
            for i in range(j, n):
                a[i, j] -= a[i, k] * a[j, k]
        pivot = root(larger(a[j, j], 1e-9))
        for i in range(j, n):
            a[i, j] /= pivot
        b[j] /= pivot
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= a[k, i] * b[k]
        b[i] /= a[i, i]


@fast_kernel
def collect(reference: Image, weight: Plane, grid: Numbers, stride: int, points: Plane) -> int:
    """List the pixels by which `reference` is registered: those of positive weight, every `stride`-th of a row.

    Rows of `points` (5 + 3 C, N): x, y, X, Y, weight; then per channel the value and a quarter of the difference of
    the neighbours to the right and left, below and above. Returns how many there are, N at most.
    """
    h, w, channels = reference.shape
    n = 0
    for y in range(h):
        up = larger(y - 1, 0)
        down = smaller(y + 1, h - 1)
        for x in range(y % stride, w, stride):
            if weight[y, x] <= 0.0 or n >= points.shape[1]:
                continue
            left = larger(x - 1, 0)
            right = smaller(x + 1, w - 1)
            points[0, n] = x
            points[1, n] = y
            points[2, n] = (x - grid[0]) / grid[2]
            points[3, n] = (y - grid[1]) / grid[2]
            points[4, n] = weight[y, x]
            for c in range(channels):
                points[5 + 3 * c, n] = reference[y, x, c]
                points[6 + 3 * c, n] = 0.25 * (reference[y, right, c] - reference[y, left, c])
                points[7 + 3 * c, n] = 0.25 * (reference[down, x, c] - reference[up, x, c])
            n += 1
    return n


@fast_kernel
def gauss_newton(
    image: Image,
    points: Plane,
    count: int,
    theta: Numbers,
    prior: Numbers,
    scale: float,
    ceiling: float,
    inside: Integers,
    costs: Numbers,
    iterations: int,
) -> float:
    """Register the listed points in `image`: minimise Σ w ρ(I(p + a(p)) − g R(p) − b) over theta = (a, g, b).

    In place. `points` and `count` are from :func:`collect`. theta[6] is 100 (g − 1), theta[7] is b. `prior` holds the
    diagonal ridge towards the start value, per unit of weight. ρ has the weights (1 + (e / scale)²)⁻². It ends early
    when there is nothing left to gain. Returns the mean of min(|e|, ceiling) at the end (1e9 when less than a quarter
    of the weight is in the frame); costs[0] is the same at the start. With no iterations that is all it does.
    """
    # Blocks of points: what is looked up pixel by pixel goes to short rows, and all arithmetic is on those rows.
    # Each is an array of its own, so that LLVM sees that they don't overlap.
    height, width, channels = image.shape
    left = inside[0]
    top = inside[1]
    right = inside[2] - 1
    bottom = inside[3] - 1
    corners = _corners()
    at_x = _row()
    at_y = _row()
    part_x = _row()
    part_y = _row()
    weight = _row()
    xx = _row()
    xy = _row()
    yy = _row()
    xe = _row()
    ye = _row()
    xr = _row()
    yr = _row()
    x1 = _row()
    y1 = _row()
    rr = _row()
    r1 = _row()
    re = _row()
    e1 = _row()
    ee = _row()
    start = _eight()
    normal = _eight_by_eight()
    rhs = _eight()
    for i in range(8):
        start[i] = theta[i]
    share = 1.0 / channels
    cost = 0.0
    for iteration in range(iterations + 1):
        last = iteration == iterations
        gain = 1.0 + 0.01 * theta[6]
        bias = theta[7]
        t0 = theta[0]
        t1 = theta[1]
        t2 = theta[2]
        t3 = theta[3]
        t4 = theta[4]
        t5 = theta[5]
        wanted = used = cost = 0.0
        a00 = a01 = a02 = a11 = a12 = a22 = 0.0
        b00 = b01 = b02 = b11 = b12 = b22 = 0.0
        c00 = c01 = c02 = c11 = c12 = c22 = 0.0
        d0 = d1 = d2 = d3 = d4 = d5 = f0 = f1 = f2 = f3 = f4 = f5 = 0.0
        s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = g66 = g67 = g77 = 0.0
        for first in range(0, count, _BLOCK):
            m = smaller(count - first, _BLOCK)
            for i in range(m):
                p = first + i
                qx = points[0, p] + t0 + t1 * points[2, p] + t2 * points[3, p]
                qy = points[1, p] + t3 + t4 * points[2, p] + t5 * points[3, p]
                within = qx >= left and qy >= top and qx < right and qy < bottom
                weight[i] = points[4, p] if within else 0.0
                qx = smaller(larger(qx, 0.0), width - 1.001)
                qy = smaller(larger(qy, 0.0), height - 1.001)
                at_x[i] = np.float64(np.int64(qx))
                at_y[i] = np.float64(np.int64(qy))
                part_x[i] = qx - at_x[i]
                part_y[i] = qy - at_y[i]
                ee[i] = 0.0
            for i in range(m):
                ix = np.int64(at_x[i])
                iy = np.int64(at_y[i])
                for c in range(channels):
                    corners[c, 0, i] = image[iy, ix, c]
                    corners[c, 1, i] = image[iy, ix + 1, c]
                    corners[c, 2, i] = image[iy + 1, ix, c]
                    corners[c, 3, i] = image[iy + 1, ix + 1, c]
            if last:
                for c in range(channels):
                    for i in range(m):
                        above = corners[c, 0, i] + part_x[i] * (corners[c, 1, i] - corners[c, 0, i])
                        below = corners[c, 2, i] + part_x[i] * (corners[c, 3, i] - corners[c, 2, i])
                        e = above + part_y[i] * (below - above) - gain * points[5 + 3 * c, first + i] - bias
                        ee[i] += e * e
                for i in range(m):
                    wanted += points[4, first + i]
                    used += weight[i]
                    cost += weight[i] * smaller(root(share * ee[i]), ceiling)
                continue
            for i in range(m):
                xx[i] = xy[i] = yy[i] = xe[i] = ye[i] = xr[i] = yr[i] = x1[i] = y1[i] = 0.0
                rr[i] = r1[i] = re[i] = e1[i] = 0.0
            for c in range(channels):
                for i in range(m):
                    i00 = corners[c, 0, i]
                    i10 = corners[c, 2, i]
                    across = corners[c, 1, i] - i00
                    twist = corners[c, 3, i] - i10 - across
                    r = points[5 + 3 * c, first + i]
                    fx = part_x[i]
                    fy = part_y[i]
                    down = i10 - i00 + fx * twist
                    e = i00 + fx * across + fy * down - gain * r - bias
                    # the mean of both images' gradients: nearly second-order convergence
                    gx = 0.5 * (across + fy * twist) + gain * points[6 + 3 * c, first + i]
                    gy = 0.5 * down + gain * points[7 + 3 * c, first + i]
                    r *= -0.01
                    xx[i] += gx * gx
                    xy[i] += gx * gy
                    yy[i] += gy * gy
                    xe[i] += gx * e
                    ye[i] += gy * e
                    xr[i] += gx * r
                    yr[i] += gy * r
                    x1[i] -= gx
                    y1[i] -= gy
                    rr[i] += r * r
                    r1[i] -= r
                    re[i] += r * e
                    e1[i] -= e
                    ee[i] += e * e
            for i in range(m):
                wt = weight[i]
                wanted += points[4, first + i]
                used += wt
                square = share * ee[i]
                cost += wt * smaller(root(square), ceiling)
                rho = 1.0 + square / (scale * scale)
                w0 = share * wt / (rho * rho)
                x = points[2, first + i]
                y = points[3, first + i]
                wx = w0 * x
                wy = w0 * y
                wxx = wx * x
                wxy = wx * y
                wyy = wy * y
                a00 += w0 * xx[i]
                a01 += wx * xx[i]
                a02 += wy * xx[i]
                a11 += wxx * xx[i]
                a12 += wxy * xx[i]
                a22 += wyy * xx[i]
                b00 += w0 * xy[i]
                b01 += wx * xy[i]
                b02 += wy * xy[i]
                b11 += wxx * xy[i]
                b12 += wxy * xy[i]
                b22 += wyy * xy[i]
                c00 += w0 * yy[i]
                c01 += wx * yy[i]
                c02 += wy * yy[i]
                c11 += wxx * yy[i]
                c12 += wxy * yy[i]
                c22 += wyy * yy[i]
                d0 += w0 * xr[i]
                d1 += wx * xr[i]
                d2 += wy * xr[i]
                d3 += w0 * yr[i]
                d4 += wx * yr[i]
                d5 += wy * yr[i]
                f0 += w0 * x1[i]
                f1 += wx * x1[i]
                f2 += wy * x1[i]
                f3 += w0 * y1[i]
                f4 += wx * y1[i]
                f5 += wy * y1[i]
                g66 += w0 * rr[i]
                g67 += w0 * r1[i]
                g77 += w0
                s0 += w0 * xe[i]
                s1 += wx * xe[i]
                s2 += wy * xe[i]
                s3 += w0 * ye[i]
                s4 += wx * ye[i]
                s5 += wy * ye[i]
                s6 += w0 * re[i]
                s7 += w0 * e1[i]
        if used < 0.25 * wanted or used <= 0.0:
            cost = 1e9
        else:
            cost /= used
        if iteration == 0:
            costs[0] = cost
        if last or cost >= 1e9:
            break
        # the lower triangle is all that is read
        normal[0, 0] = a00
        normal[1, 0] = a01
        normal[2, 0] = a02
        normal[1, 1] = a11
        normal[2, 1] = a12
        normal[2, 2] = a22
        normal[3, 0] = b00
        normal[4, 0] = normal[3, 1] = b01
        normal[5, 0] = normal[3, 2] = b02
        normal[4, 1] = b11
        normal[5, 1] = normal[4, 2] = b12
        normal[5, 2] = b22
        normal[3, 3] = c00
        normal[4, 3] = c01
        normal[5, 3] = c02
        normal[4, 4] = c11
        normal[5, 4] = c12
        normal[5, 5] = c22
        normal[6, 0] = d0
        normal[6, 1] = d1
        normal[6, 2] = d2
        normal[6, 3] = d3
        normal[6, 4] = d4
        normal[6, 5] = d5
        normal[7, 0] = f0
        normal[7, 1] = f1
        normal[7, 2] = f2
        normal[7, 3] = f3
        normal[7, 4] = f4
        normal[7, 5] = f5
        normal[6, 6] = g66
        normal[7, 6] = g67
        normal[7, 7] = g77 * channels
        rhs[0] = -s0
        rhs[1] = -s1
        rhs[2] = -s2
        rhs[3] = -s3
        rhs[4] = -s4
        rhs[5] = -s5
        rhs[6] = -s6
        rhs[7] = -s7
        for i in range(8):
            normal[i, i] += prior[i] * wanted
            rhs[i] -= prior[i] * wanted * (theta[i] - start[i])
        _solve(normal, rhs, theta.shape[0])
        longest = larger(root(rhs[0] * rhs[0] + rhs[3] * rhs[3]), 1e-6)
        shorten = smaller(1.0, 1.5 / longest)
        change = 0.0
        for i in range(8):
            theta[i] += shorten * rhs[i]
            change = larger(change, abs(rhs[i]) * (1.0 if i < 6 else _BRIGHTNESS))
        if change < _SETTLED:
            break
    return cost


@fast_kernel
def fit_affine(
    flow: Image,
    gray: Plane,
    log_odds: Plane,
    grid: Numbers,
    ridge: Numbers,
    noise: float,
    camera: Numbers,
    young: bool,
    stride: int,
    points: Plane,
    theta: Numbers,
) -> float:
    """Robust affine fit of `flow` on the object {log_odds > 0}, towards the prediction in `theta` (in place).

    Iteratively reweighted least squares, five rounds. Pixels count by their gradient (a flat pixel's flow is only
    its neighbours'), by the odds that they are the object and, when `young`, by their contrast to the camera.
    `points` is a workspace (7, N). Returns the scale of the residual, px.
    """
    h, w = log_odds.shape
    n = 0
    for y in range(1, h - 1):
        for x in range(1 + y % stride, w - 1, stride):
            s = log_odds[y, x]
            if s <= 0.0 or n >= points.shape[1]:
                continue
            gx = 0.5 * (gray[y, x + 1] - gray[y, x - 1])
            gy = 0.5 * (gray[y + 1, x] - gray[y - 1, x])
            g2 = gx * gx + gy * gy
            u = flow[y, x, 0]
            v = flow[y, x, 1]
            wt = g2 / (g2 + 4.0 * noise * noise + 9.0) * smaller(larger(0.5 * (s + 0.5), 0.1), 1.0)
            if young:
                du = u - camera[0]
                dv = v - camera[1]
                wt *= smaller(1.0, (du * du + dv * dv) * 4.0 + 0.05)
            points[0, n] = (x - grid[0]) / grid[2]
            points[1, n] = (y - grid[1]) / grid[2]
            points[2, n] = u
            points[3, n] = v
            points[4, n] = wt
            points[5, n] = 0.0
            n += 1
    if n == 0:
        return 0.0
    start = _six()
    for i in range(6):
        start[i] = theta[i]
    a = _three_by_three()
    b = _three()
    scale = 1e3
    for _ in range(5):
        a00 = a11 = a22 = a10 = a20 = a21 = u0 = u1 = u2 = v0 = v1 = v2 = 0.0
        unit = 1.0 / (2.25 * scale * scale)
        for p in range(n):
            far = 1.0 + points[5, p] * unit
            wt = points[4, p] / (far * far)
            x = points[0, p]
            y = points[1, p]
            u = points[2, p]
            v = points[3, p]
            wx = wt * x
            wy = wt * y
            a00 += wt
            a10 += wx
            a20 += wy
            a11 += wx * x
            a21 += wx * y
            a22 += wy * y
            u0 += wt * u
            u1 += wx * u
            u2 += wy * u
            v0 += wt * v
            v1 += wx * v
            v2 += wy * v
        for side in range(2):  # `solve` destroys its matrix
            a[0, 0] = a00 + ridge[0] * n
            a[1, 0] = a10
            a[2, 0] = a20
            a[1, 1] = a11 + ridge[1] * n
            a[2, 1] = a21
            a[2, 2] = a22 + ridge[2] * n
            b[0] = u0 if side == 0 else v0
            b[1] = u1 if side == 0 else v1
            b[2] = u2 if side == 0 else v2
            for i in range(3):
                b[i] += ridge[i] * n * start[3 * side + i]
            _solve(a, b, ridge.shape[0])
            for i in range(3):
                theta[3 * side + i] = b[i]
        u0 = theta[0]
        u1 = theta[1]
        u2 = theta[2]
        v0 = theta[3]
        v1 = theta[4]
        v2 = theta[5]
        for p in range(n):
            ru = points[2, p] - u0 - u1 * points[0, p] - u2 * points[1, p]
            rv = points[3, p] - v0 - v1 * points[0, p] - v2 * points[1, p]
            points[5, p] = ru * ru + rv * rv
        looked_at = 0
        for p in range(0, n, _THINNED):
            points[6, looked_at] = points[5, p]
            looked_at += 1
        scale = larger(0.06, 1.48 * root(select(points[6], looked_at, 0.5)))
    return scale


@fast_kernel
def start_flow(near: Mask, grid: Numbers, theta: Numbers, camera: Numbers, out: Image) -> None:
    """Flow to start from, into out (h, w, 2): the affine motion where `near` is set, the camera's elsewhere."""
    h, w = near.shape
    for y in range(h):
        yy = (y - grid[1]) / grid[2]
        for x in range(w):
            if near[y, x] != 0:
                xx = (x - grid[0]) / grid[2]
                out[y, x, 0] = theta[0] + theta[1] * xx + theta[2] * yy
                out[y, x, 1] = theta[3] + theta[4] * xx + theta[5] * yy
            else:
                out[y, x, 0] = camera[0]
                out[y, x, 1] = camera[1]


@fast_kernel
def median_flow(flow: Image, near: Mask, sample: Plane, out: Numbers) -> int:
    """Medians outside `near`, every fourth pixel of every fourth row: u and v into out[0..1].

    `sample` is a workspace (2, N). Returns the number of pixels looked at.
    """
    h, w = near.shape
    n = 0
    for y in range(0, h, 4):
        for x in range(y // 4 % 4, w, 4):
            if near[y, x] == 0 and n < sample.shape[1]:
                sample[0, n] = flow[y, x, 0]
                sample[1, n] = flow[y, x, 1]
                n += 1
    if n:
        for i in range(2):
            out[i] = select(sample[i], n, 0.5)
    return n


@fast_kernel
def search_shift(
    image: Image,
    obj: Image,
    shape: Plane,
    different: Mask,
    centre: Integers,
    reach: int,
    step: int,
    inside: Integers,
    noise: float,
) -> tuple[float, float, int, int]:
    """Best translation of the object layer: Σ over its shape of [not background] (1 − min(|I − O| / (12 + 3σ), 2)).

    Shifts are `centre` ± `reach` in steps of `step` px; about four hundred pixels of {shape > ½} are looked at.
    Returns (score there, score at no shift, dx, dy), scores per pixel of the shape.
    """
    h, w, channels = image.shape
    area = 0
    for y in range(h):
        for x in range(w):
            if shape[y, x] > 0.5:
                area += 1
    stride = larger(1, np.int64(root(area / 400.0)))
    best = -1e9
    still = 0.0
    best_x = 0
    best_y = 0
    unit = 1.0 / ((12.0 + 3.0 * noise) * channels)
    for sy in range(centre[1] - reach, centre[1] + reach + 1, step):
        for sx in range(centre[0] - reach, centre[0] + reach + 1, step):
            score = 0.0
            n = 0
            for y in range(0, h, stride):
                for x in range(0, w, stride):
                    if shape[y, x] <= 0.5:
                        continue
                    n += 1
                    qx = x + sx
                    qy = y + sy
                    if qx < inside[0] or qy < inside[1] or qx >= inside[2] or qy >= inside[3]:
                        continue
                    if different[qy, qx] == 0:
                        continue
                    e = 0.0
                    for c in range(channels):
                        e += abs(image[qy, qx, c] - obj[y, x, c])
                    score += 1.0 - smaller(e * unit, 2.0)
            score /= larger(n, 1)
            if sx == 0 and sy == 0:
                still = score
            if score > best:
                best = score
                best_x = sx
                best_y = sy
    return best, still, best_x, best_y
