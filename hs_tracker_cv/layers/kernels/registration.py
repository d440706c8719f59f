"""What measures motion: registration of a layer with a frame, robust affine fit of a flow."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, local, root, smaller
from .common import Image, Integers, Numbers, Plane, fast_kernel, fast_part, select

_BLOCK = 64  # points at a time
_SETTLED = 0.02  # px, of a step of Gauss–Newton: what the next one would add is a fraction of that
_BRIGHTNESS = 0.1  # px that a percent of gain or a gray level of bias is worth there
_THINNED = 3  # every third residual tells the median

_row = local(_BLOCK)
_corners = local(3, 4, _BLOCK)
_three = local(3)
_four = local(4)
_four_by_four = local(4, 4)
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


@fast_part
def every(area, wanted):
    """Every how manieth of so many pixels to take, to get about as many as wanted."""
    return larger(np.int64(area / wanted + 0.5), 1)


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


@fast_part
def look_up(image, points, first, m, theta, inside, corners, part_x, part_y, weight):
    """Look up where the points from `first` on are by a motion: four pixels per channel, the parts of a pixel.

    `weight` receives the points' own, 0 outside the frame.
    """
    height, width, channels = image.shape
    left = inside[0]
    top = inside[1]
    right = inside[2] - 1
    bottom = inside[3] - 1
    t0 = theta[0]
    t1 = theta[1]
    t2 = theta[2]
    t3 = theta[3]
    t4 = theta[4]
    t5 = theta[5]
    at_x = _row()
    at_y = _row()
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
    for i in range(m):
        ix = np.int64(at_x[i])
        iy = np.int64(at_y[i])
        for c in range(channels):
            corners[c, 0, i] = image[iy, ix, c]
            corners[c, 1, i] = image[iy, ix + 1, c]
            corners[c, 2, i] = image[iy + 1, ix, c]
            corners[c, 3, i] = image[iy + 1, ix + 1, c]


@fast_kernel
def residual(image: Image, points: Plane, count: int, theta: Numbers, ceiling: float, inside: Integers) -> float:
    """Mean of min(|I(p + a(p)) − g R(p) − b|, `ceiling`) over the listed points, each of its weight.

    It is 1e9 when less than a quarter of the weight is in the frame. See :func:`gauss_newton`.
    """
    channels = image.shape[2]
    share = 1.0 / channels
    gain = 1.0 + 0.01 * theta[6]
    bias = theta[7]
    corners = _corners()
    part_x = _row()
    part_y = _row()
    weight = _row()
    ee = _row()
    wanted = used = cost = 0.0
    for first in range(0, count, _BLOCK):
        m = smaller(count - first, _BLOCK)
        look_up(image, points, first, m, theta, inside, corners, part_x, part_y, weight)
        for i in range(m):
            ee[i] = 0.0
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
    return 1e9 if used < 0.25 * wanted or used <= 0.0 else cost / used


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
    stiffness: float,
) -> None:
    """Register the listed points in `image`: minimise Σ w ρ(I(p + a(p)) − g R(p) − b) over theta = (a, g, b).

    In place. `points` and `count` are from :func:`collect`. `stiffness` is what it costs, per unit of weight, to be
    more than translation, rotation and change of size. theta[6] is 100 (g − 1), theta[7] is b. `prior` holds the
    diagonal ridge towards the start value, per unit of weight. ρ has the weights (1 + (e / scale)²)⁻². It ends early
    when there is nothing left to gain. costs[0] and costs[1] receive the :func:`residual` at the start and at the
    end. With no iterations that is all it does.
    """
    # Blocks of points: what is looked up pixel by pixel goes to short rows, and all arithmetic is on those rows.
    # Each is an array of its own, so that LLVM sees that they don't overlap.
    channels = image.shape[2]
    corners = _corners()
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
    settled = False
    for iteration in range(iterations):
        gain = 1.0 + 0.01 * theta[6]
        bias = theta[7]
        wanted = used = cost = 0.0
        a00 = a01 = a02 = a11 = a12 = a22 = 0.0
        b00 = b01 = b02 = b11 = b12 = b22 = 0.0
        c00 = c01 = c02 = c11 = c12 = c22 = 0.0
        d0 = d1 = d2 = d3 = d4 = d5 = f0 = f1 = f2 = f3 = f4 = f5 = 0.0
        s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = g66 = g67 = g77 = 0.0
        for first in range(0, count, _BLOCK):
            m = smaller(count - first, _BLOCK)
            look_up(image, points, first, m, theta, inside, corners, part_x, part_y, weight)
            for i in range(m):
                ee[i] = 0.0
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
        costs[1] = cost
        if cost >= 1e9:
            settled = True
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
        # what is not rotation and change of size costs extra
        firm = stiffness * wanted
        stretch = firm * (theta[1] - theta[5])
        shear = firm * (theta[2] + theta[4])
        normal[1, 1] += firm
        normal[5, 5] += firm
        normal[5, 1] -= firm
        normal[2, 2] += firm
        normal[4, 4] += firm
        normal[4, 2] += firm
        rhs[1] -= stretch
        rhs[5] += stretch
        rhs[2] -= shear
        rhs[4] -= shear
        _solve(normal, rhs, theta.shape[0])
        longest = larger(root(rhs[0] * rhs[0] + rhs[3] * rhs[3]), 1e-6)
        shorten = smaller(1.0, 1.5 / longest)
        change = 0.0
        for i in range(8):
            theta[i] += shorten * rhs[i]
            change = larger(change, abs(rhs[i]) * (1.0 if i < 6 else _BRIGHTNESS))
        if change < _SETTLED:
            settled = True
            break
    if not settled:
        costs[1] = residual(image, points, count, theta, ceiling, inside)
        if iterations == 0:
            costs[0] = costs[1]


@fast_part
def _similar(weights, x, y, squares, u, radial, tangential, v, ridge, n, start, theta):
    """Solve for translation, rotation and change of size, from weighted sums, towards `start`."""
    a = _four_by_four()
    b = _four()
    r0 = ridge[0] * n
    r1 = (ridge[1] + ridge[2]) * n
    # unknowns: tx, ty, growth, turn; u = tx + growth X − turn Y, v = ty + turn X + growth Y
    for i in range(4):
        for j in range(4):
            a[i, j] = 0.0
    a[0, 0] = a[1, 1] = weights + r0
    a[2, 0] = x
    a[3, 0] = -y
    a[2, 1] = y
    a[3, 1] = x
    a[2, 2] = a[3, 3] = squares + r1
    b[0] = u + r0 * start[0]
    b[1] = v + r0 * start[3]
    b[2] = radial + r1 * 0.5 * (start[1] + start[5])
    b[3] = tangential + r1 * 0.5 * (start[4] - start[2])
    _solve(a, b, 4)
    theta[0] = b[0]
    theta[3] = b[1]
    theta[1] = theta[5] = b[2]
    theta[4] = b[3]
    theta[2] = -b[3]


@fast_kernel
def fit_affine(
    flow: Image,
    gray: Plane,
    log_odds: Plane,
    weight: Plane,
    grid: Numbers,
    ridge: Numbers,
    noise: float,
    camera: Numbers,
    young: bool,
    stride: int,
    points: Plane,
    theta: Numbers,
) -> None:
    """Robust affine fit of `flow` on the object {log_odds > 0, weight > 0}, towards that in `theta` (in place).

    Iteratively reweighted least squares, five rounds. Pixels count by their gradient (a flat pixel's flow is only
    its neighbours'), by the odds that they are the object and, when `young`, by their contrast to the camera.
    `points` is a workspace (7, N).
    """
    h, w = log_odds.shape
    n = 0
    for y in range(1, h - 1):
        for x in range(1 + y % stride, w - 1, stride):
            s = log_odds[y, x]
            if s <= 0.0 or weight[y, x] <= 0.0 or n >= points.shape[1]:
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
        return
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
        if young:
            _similar(a00, a10, a20, a11 + a22, u0, u1 + v2, v1 - u2, v0, ridge, n, start, theta)
        for side in range(0 if young else 2):  # `solve` destroys its matrix
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
