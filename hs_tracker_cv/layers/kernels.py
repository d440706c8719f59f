"""The inner loops of the two-layer model, in Numba: arrays in, arrays out; no checks, no options.

Images are (h, w, C) float32 windows, planes (h, w) float32; all C-contiguous and of one window size. `inside` is
(x0, y0, x1, y1): the part of the window that lies inside the frame, in window pixels, end exclusive.
An affine displacement is a[0..5]: q = p + (a0 + a1 X + a2 Y, a3 + a4 X + a5 Y) with X = (x − cx) / scale, Y alike,
and `grid` is (cx, cy, scale).
"""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from ..compiling import kernel, larger, local, part, root, smaller

__all__ = [
    "FAR_OFF",
    "KNOWN",
    "alpha_edge",
    "evidence",
    "fit_affine",
    "gauss_newton",
    "label",
    "learn",
    "local_products",
    "median_flow",
    "resample",
    "search_shift",
    "start_flow",
]

Image = Annotated[NDArray[np.float32], 3]
Plane = Annotated[NDArray[np.float32], 2]
Mask = Annotated[NDArray[np.uint8], 2]
Bins = Annotated[NDArray[np.int16], 2]
Row = Annotated[NDArray[np.float32], 1]
Numbers = Annotated[NDArray[np.float64], 1]
Integers = Annotated[NDArray[np.int64], 1]

# Nothing here may be NaN: frames.crop has removed what is not finite. 'nnan' and 'ninf' stay off all the same.
_FAST = {"contract", "reassoc", "nsz", "arcp"}
_kernel = kernel(fastmath=_FAST)
_part = part(fastmath=_FAST)

# Samples after which a background pixel is known; until then it must stay as it is from frame to frame.
KNOWN = np.float32(3.0)

# Gray levels; where two images differ by more, it counts as this much.
FAR_OFF = 40.0


_three = local(3)
_six = local(6)
_eight = local(8)
_three_by_three = local(3, 3)
_eight_by_eight = local(8, 8)


@_part
def _solve(a, b):
    """Solve the symmetric positive definite system a x = b in place (Cholesky); x is left in `b`."""
    n = b.size
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


@_part
def _select(values, n, share):
    """The value below which `share` of values[:n] lies; their order is destroyed."""
    low = 0
    high = n - 1
    middle = np.int64(share * n)
    while low < high:
        pivot = values[middle]
        i = low
        j = high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                held = values[i]
                values[i] = values[j]
                values[j] = held
                i += 1
                j -= 1
        if j < middle:
            low = i
        if i > middle:
            high = j
    return values[middle]


@_kernel
def gauss_newton(
    image: Image,
    reference: Image,
    weight: Plane,
    grid: Numbers,
    theta: Numbers,
    prior: Numbers,
    scale: float,
    ceiling: float,
    iterations: int,
    stride: int,
    inside: Integers,
) -> float:
    """Register `reference` in `image`: minimise Σ w ρ(I(p + a(p)) − g R(p) − b) over theta = (a, g, b), in place.

    theta[6] is 100 (g − 1), theta[7] is b. `prior` holds the diagonal ridge towards the start value, per unit of
    weight. ρ has the weights (1 + (e / scale)²)⁻². Every `stride`-th pixel of a row is used, shifted from row to row.
    Returns the mean of min(|e|, ceiling) at the final theta (1e9 when less than a quarter of the weight is in the
    frame); with no iterations that is all it does.
    """
    h, w, channels = reference.shape
    cx = grid[0]
    cy = grid[1]
    unit = grid[2]
    left = inside[0]
    top = inside[1]
    right = inside[2] - 1
    bottom = inside[3] - 1
    start = _eight()
    for i in range(8):
        start[i] = theta[i]
    normal = _eight_by_eight()
    rhs = _eight()
    basis = _three()
    basis[0] = 1.0
    cost = 0.0
    share = 1.0 / channels
    for iteration in range(iterations + 1):
        last = iteration == iterations
        for i in range(8):
            rhs[i] = 0.0
            for j in range(8):
                normal[i, j] = 0.0
        gain = 1.0 + 0.01 * theta[6]
        bias = theta[7]
        wanted = used = cost = 0.0
        for y in range(h):
            for x in range(y % stride, w, stride):
                wt = weight[y, x]
                if wt <= 0.0:
                    continue
                wanted += wt
                basis[1] = (x - cx) / unit
                basis[2] = (y - cy) / unit
                qx = x + theta[0] + theta[1] * basis[1] + theta[2] * basis[2]
                qy = y + theta[3] + theta[4] * basis[1] + theta[5] * basis[2]
                if qx < left or qy < top or qx >= right or qy >= bottom:
                    continue
                ix = np.int64(qx)
                iy = np.int64(qy)
                fx = qx - ix
                fy = qy - iy
                xm = larger(x - 1, 0)
                xp = smaller(x + 1, w - 1)
                ym = larger(y - 1, 0)
                yp = smaller(y + 1, h - 1)
                sxx = sxy = syy = sxe = sye = sxr = syr = sx = sy = 0.0
                srr = sr = sre = se = see = 0.0
                for c in range(channels):
                    i00 = image[iy, ix, c]
                    i01 = image[iy, ix + 1, c]
                    i10 = image[iy + 1, ix, c]
                    i11 = image[iy + 1, ix + 1, c]
                    r = reference[y, x, c]
                    gx0 = i01 - i00
                    gx1 = i11 - i10
                    value = i00 + fx * gx0
                    value += fy * (i10 + fx * gx1 - value)
                    e = value - gain * r - bias
                    see += e * e
                    if not last:
                        # the mean of both images' gradients: nearly second-order convergence
                        gx = 0.5 * (gx0 + fy * (gx1 - gx0))
                        gx += 0.25 * gain * (reference[y, xp, c] - reference[y, xm, c])
                        gy = 0.5 * (i10 - i00 + fx * (i11 - i01 - i10 + i00))
                        gy += 0.25 * gain * (reference[yp, x, c] - reference[ym, x, c])
                        r *= -0.01
                        sxx += gx * gx
                        sxy += gx * gy
                        syy += gy * gy
                        sxe += gx * e
                        sye += gy * e
                        sxr += gx * r
                        syr += gy * r
                        sx -= gx
                        sy -= gy
                        srr += r * r
                        sr -= r
                        sre += r * e
                        se -= e
                see *= share
                used += wt
                cost += wt * smaller(root(see), ceiling)
                if not last:
                    rho = 1.0 + see / (scale * scale)
                    wr = share * wt / (rho * rho)
                    for i in range(3):
                        wi = wr * basis[i]
                        for j in range(i + 1):
                            wij = wi * basis[j]
                            normal[i, j] += wij * sxx
                            normal[i + 3, j + 3] += wij * syy
                        for j in range(3):
                            normal[i + 3, j] += wi * basis[j] * sxy
                        normal[6, i] += wi * sxr
                        normal[6, i + 3] += wi * syr
                        normal[7, i] += wi * sx
                        normal[7, i + 3] += wi * sy
                        rhs[i] -= wi * sxe
                        rhs[i + 3] -= wi * sye
                    normal[6, 6] += wr * srr
                    normal[7, 6] += wr * sr
                    normal[7, 7] += wr * channels
                    rhs[6] -= wr * sre
                    rhs[7] -= wr * se
        if used < 0.25 * wanted or used <= 0.0:
            return 1e9
        cost /= used
        if last:
            break
        for i in range(8):
            normal[i, i] += prior[i] * wanted
            rhs[i] -= prior[i] * wanted * (theta[i] - start[i])
        _solve(normal, rhs)
        longest = larger(root(rhs[0] * rhs[0] + rhs[3] * rhs[3]), 1e-6)
        shorten = smaller(1.0, 1.5 / longest)
        for i in range(8):
            theta[i] += shorten * rhs[i]
    return cost


@_kernel
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
    area = 0.0
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
            area += 1.0
            n += 1
    if n == 0:
        return 0.0
    start = _six()
    for i in range(6):
        start[i] = theta[i]
    a = _three_by_three()
    b_u = _three()
    b_v = _three()
    basis = _three()
    basis[0] = 1.0
    scale = 1e3
    for _ in range(5):
        for i in range(3):
            for j in range(3):
                a[i, j] = 0.0
            a[i, i] = ridge[i] * area
            b_u[i] = a[i, i] * start[i]
            b_v[i] = a[i, i] * start[3 + i]
        for p in range(n):
            r2 = points[5, p] / (2.25 * scale * scale)
            wt = points[4, p] / ((1.0 + r2) * (1.0 + r2))
            basis[1] = points[0, p]
            basis[2] = points[1, p]
            for i in range(3):
                wi = wt * basis[i]
                b_u[i] += wi * points[2, p]
                b_v[i] += wi * points[3, p]
                for j in range(i + 1):
                    a[i, j] += wi * basis[j]
        # _solve destroys its matrix; the upper half, unused by it, keeps a copy for the second right-hand side
        d0 = a[0, 0]
        d1 = a[1, 1]
        d2 = a[2, 2]
        l10 = a[1, 0]
        l20 = a[2, 0]
        l21 = a[2, 1]
        _solve(a, b_u)
        a[0, 0] = d0
        a[1, 1] = d1
        a[2, 2] = d2
        a[1, 0] = l10
        a[2, 0] = l20
        a[2, 1] = l21
        _solve(a, b_v)
        for p in range(n):
            ru = points[2, p] - b_u[0] - b_u[1] * points[0, p] - b_u[2] * points[1, p]
            rv = points[3, p] - b_v[0] - b_v[1] * points[0, p] - b_v[2] * points[1, p]
            points[5, p] = ru * ru + rv * rv
            points[6, p] = points[5, p]
        scale = larger(0.06, 1.48 * root(_select(points[6], n, 0.5)))
    for i in range(3):
        theta[i] = b_u[i]
        theta[3 + i] = b_v[i]
    return scale


@_kernel
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


@_kernel
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
            out[i] = _select(sample[i], n, 0.5)
    return n


@_kernel
def resample(image: Image, inverse: Numbers, repeat: bool, fill: float, out: Image) -> None:
    """Write to `out` the image at (m0 x + m1 y + m2, m3 x + m4 y + m5), bilinear, m being `inverse`.

    Beyond the image its border is repeated, or else `fill`. OpenCV's own differs from version to version.
    """
    h, w, channels = image.shape
    height, width, _ = out.shape
    one = np.float32(1.0)
    zero = np.float32(0.0)
    right = np.float32(w - 1)
    bottom = np.float32(h - 1)
    step_x = np.float32(inverse[0])
    step_y = np.float32(inverse[3])
    other = np.float32(fill)
    for y in range(height):
        start_x = np.float32(inverse[1] * y + inverse[2])
        start_y = np.float32(inverse[4] * y + inverse[5])
        for x in range(width):
            px = start_x + step_x * np.float32(x)
            py = start_y + step_y * np.float32(x)
            if repeat:
                px = smaller(larger(px, zero), right)
                py = smaller(larger(py, zero), bottom)
            elif px <= -one or py <= -one or px >= right + one or py >= bottom + one:
                for c in range(channels):
                    out[y, x, c] = other
                continue
            ix = np.int64(px + one) - 1
            iy = np.int64(py + one) - 1
            fx = px - np.float32(ix)
            fy = py - np.float32(iy)
            if ix >= 0 and iy >= 0 and ix + 1 < w and iy + 1 < h:
                for c in range(channels):
                    a = image[iy, ix, c]
                    b = image[iy + 1, ix, c]
                    a += fx * (image[iy, ix + 1, c] - a)
                    b += fx * (image[iy + 1, ix + 1, c] - b)
                    out[y, x, c] = a + fy * (b - a)
                continue
            left_share = one - fx if ix >= 0 else zero
            right_share = fx if ix + 1 < w else zero
            top_share = one - fy if iy >= 0 else zero
            bottom_share = fy if iy + 1 < h else zero
            x0 = larger(ix, 0)
            y0 = larger(iy, 0)
            x1 = smaller(ix + 1, w - 1)
            y1 = smaller(iy + 1, h - 1)
            beyond = other * (one - (left_share + right_share) * (top_share + bottom_share))
            for c in range(channels):
                above = left_share * image[y0, x0, c] + right_share * image[y0, x1, c]
                below = left_share * image[y1, x0, c] + right_share * image[y1, x1, c]
                out[y, x, c] = top_share * above + bottom_share * below + beyond


@_kernel
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


@_kernel
def local_products(image: Image, background: Image, obj: Image, out: Image) -> None:
    """Channel sums of I·B, B·B, I·O, O·O into out (h, w, 4): box-filtered, they give the local gains."""
    h, w, channels = image.shape
    for y in range(h):
        for x in range(w):
            ib = bb = io = oo = 0.0
            for c in range(channels):
                i = image[y, x, c]
                b = background[y, x, c]
                o = obj[y, x, c]
                ib += i * b
                bb += b * b
                io += i * o
                oo += o * o
            out[y, x, 0] = ib
            out[y, x, 1] = bb
            out[y, x, 2] = io
            out[y, x, 3] = oo


@_kernel
def evidence(
    image: Image,
    background: Image,
    moved: Image,
    carried: Image,
    obj: Image,
    warped: Plane,
    counts: Image,
    products: Image,
    noise: np.float32,
    knobs: Row,
    inside: Integers,
    out: Image,
    fresh: Mask,
) -> float:
    """Log-likelihood ratio, object against background, per pixel.

    Parameters are windows: current image, background layer, previous image moved by the camera and by the object's
    motion, object layer and log-odds warped by the object's motion, the background's counts, filtered products.
    knobs = (tau_b², tau_o², κ, motion contrast, occluded).
    out[0] log-likelihood ratio, out[1] error against the background (any explanation), out[2] the same without
    gain or previous image, out[3] local gain of the background, out[4] error against the previous image where
    the background is not yet known. `fresh` is 1 where something new covers a background that was seen a moment ago.
    Returns the share of the object's pixels that look about as they did.
    """
    h, w, channels = image.shape
    tau_b = knobs[0]
    tau_o = knobs[1]
    kappa = knobs[2]
    contrast = knobs[3]
    occluded = knobs[4]
    mean = 1.0 / channels
    noise2 = noise * noise
    like = (6.0 * noise + 6.0) * (6.0 * noise + 6.0) * channels
    own = 0
    alike = 0.0
    for y in range(h):
        ym = larger(y - 1, 0)
        yp = smaller(y + 1, h - 1)
        for x in range(w):
            fresh[y, x] = 0
            if x < inside[0] or y < inside[1] or x >= inside[2] or y >= inside[3]:
                out[0, y, x] = -2.0
                out[1, y, x] = 0.0
                out[2, y, x] = 0.0
                out[3, y, x] = 1.0
                out[4, y, x] = 0.0
                continue
            xm = larger(x - 1, 0)
            xp = smaller(x + 1, w - 1)
            n = counts[0, y, x]
            s = warped[y, x]
            gain_b = (products[y, x, 0] + 50.0) / (products[y, x, 1] + 50.0)
            gain_b = smaller(larger(gain_b, 0.35), 2.5)
            grad_b = b2 = eb = egb = 0.0
            for c in range(channels):
                i = image[y, x, c]
                b = background[y, x, c]
                gx = background[y, xp, c] - background[y, xm, c]
                gy = background[yp, x, c] - background[ym, x, c]
                grad_b += gx * gx + gy * gy
                b2 += b * b
                e = i - b
                eb += e * e
                e = i - gain_b * b
                egb += e * e
            # the factor ¼ makes (difference over two pixels)² the gradient squared; κ/s² of the channel mean
            grad_b *= mean / 4.0
            var_b = noise2 * (1.0 + 1.0 / larger(n, 1.0)) + tau_b * grad_b
            unit = kappa * mean / var_b
            direct = eb * unit
            out[2, y, x] = direct
            out[3, y, x] = gain_b
            out[4, y, x] = 0.0
            if s < -2.5 and n >= KNOWN and direct < 2.0:  # far from the object and as ever: nothing more to weigh
                out[0, y, x] = 0.5 * (direct - 5.0)
                out[1, y, x] = direct
                continue
            gain_o = (products[y, x, 2] + 50.0) / (products[y, x, 3] + 50.0)
            gain_o = smaller(larger(gain_o, 0.6), 1.7)
            grad_o = em = eo = ego = ec = 0.0
            for c in range(channels):
                i = image[y, x, c]
                o = obj[y, x, c]
                gx = obj[y, xp, c] - obj[y, xm, c]
                gy = obj[yp, x, c] - obj[ym, x, c]
                grad_o += gx * gx + gy * gy
                e = i - moved[y, x, c]
                em += e * e
                e = i - carried[y, x, c]
                ec += e * e
                e = i - o
                eo += e * e
                e = i - gain_o * o
                ego += e * e
            if s > 0.0:
                own += 1
                if eo < like or ego < 0.25 * like:
                    alike += 1.0
            var_o = 1.5 * noise2 + tau_o * grad_o * mean / 4.0
            error_b = direct
            if gain_b < 0.97:
                # a shadow leaves the texture: where there is some, to be explained that way is no accident, unless
                # there is so much noise that a dark object would do as well
                error_b = smaller(error_b, egb * unit + larger(2.0, 0.8 * noise) / (1.0 + grad_b / noise2))
            elif gain_b > 1.03:
                lifted = kappa * mean / (var_b + 0.0025 * b2 * mean)
                error_b = smaller(error_b, egb * lifted + 3.0)
            if n < KNOWN:
                still = em * kappa * mean / (2.0 * noise2 + tau_b * grad_b)
                out[4, y, x] = still
                error_b = smaller(error_b, still)
            error_o = smaller(eo, ego + var_o / (kappa * mean)) * kappa * mean / var_o
            if n < KNOWN:
                # the background may be explained by the last frame here, so the object may be too: a plain area
                # looks as it looked a moment ago with either motion
                error_o = smaller(error_o, ec * kappa * mean / (2.0 * noise2 + tau_o * grad_o * mean / 4.0))
            if s < -0.5:
                error_o = 5.0  # its appearance there is unknown
            ceiling = 9.0 if n >= KNOWN else 4.0
            ll = 0.5 * (smaller(error_b, ceiling) - smaller(error_o, 5.0))
            if n >= KNOWN and error_b < 4.0:
                ll -= 0.8 * contrast * (1.0 - error_b / 4.0)
            if contrast < 0.99 and ll < 0.0 and n < 7.0 and s > 0.0:
                ll *= contrast
            if occluded > 0.0 and n > KNOWN and error_b < 2.0:
                ll = smaller(ll, -1.5)
            if error_b >= 7.2 and n > KNOWN and counts[2, y, x] <= 4.0:
                fresh[y, x] = 1
            out[0, y, x] = ll
            out[1, y, x] = error_b
    if own:
        alike /= own
    return alike


@_kernel
def label(
    image: Image, warped: Plane, ll: Plane, grown: Mask, ratio: Row, trust: float, bins: Bins, out: Plane
) -> None:
    """Log-odds of object after this frame's evidence: 0.9 warped + 0.7 ll + trust · colour ratio.

    `grown` is 1 where the object has grown, 2 on a distractor, 3 where that covers the object; `ll` is changed there.
    `ratio` is the log-ratio of the colour histograms per bin, clipped; `bins` receives each pixel's bin.
    """
    h, w, channels = image.shape
    for y in range(h):
        for x in range(w):
            if channels == 3:
                blue = np.int64(image[y, x, 0])
                green = np.int64(image[y, x, 1])
                red = np.int64(image[y, x, 2])
                b = ((blue >> 5) << 6) + ((green >> 5) << 3) + (red >> 5)
            else:
                b = np.int64(image[y, x, 0]) >> 3
            bins[y, x] = b
            s = warped[y, x]
            if grown[y, x] == 1:
                ll[y, x] = larger(ll[y, x], 2.0)
                s = larger(s, -0.5)
            elif grown[y, x] == 3:
                ll[y, x] = smaller(ll[y, x], -2.0)
                s = smaller(s, -1.0)
            elif grown[y, x] == 2 and s < 1.0:
                ll[y, x] = smaller(ll[y, x], -1.0)
            p = 0.9 * s + 0.7 * ll[y, x] + trust * ratio[b]
            out[y, x] = smaller(larger(p, -5.0), 5.0)


@_kernel
def alpha_edge(
    image: Image, background: Image, seen: Plane, core: Mask, wide: Mask, mask: Mask, noise: float, odds: Plane
) -> None:
    """Mixed pixels of the mask's edge: α of I = α o + (1 − α) b, and the odds lowered where α says background.

    o is the mean of the `core` pixels within 3 px, b the background, or, where that was never seen, the mean of the
    pixels outside `wide` within 3 px.
    """
    h, w, channels = image.shape
    inner = _three()
    outer = _three()
    for y in range(h):
        for x in range(w):
            if mask[y, x] == 0 or core[y, x] != 0:
                continue
            own = seen[y, x] >= KNOWN
            n_in = n_out = 0
            for c in range(channels):
                inner[c] = 0.0
                outer[c] = 0.0
            for j in range(larger(y - 3, 0), smaller(y + 4, h)):
                for i in range(larger(x - 3, 0), smaller(x + 4, w)):
                    if core[j, i] != 0:
                        n_in += 1
                        for c in range(channels):
                            inner[c] += image[j, i, c]
                    elif not own and wide[j, i] == 0:
                        n_out += 1
                        for c in range(channels):
                            outer[c] += image[j, i, c]
            if n_in == 0 or (not own and n_out == 0):
                continue
            span = along = total = 0.0
            for c in range(channels):
                b = background[y, x, c] if own else outer[c] / n_out
                d = inner[c] / n_in - b
                e = image[y, x, c] - b
                span += d * d
                along += d * e
                total += e * e
            if span * (3.0 / channels) <= 36.0 * noise * noise + 100.0:
                continue
            alpha = along / span
            if alpha < 0.7 and total - alpha * along < 0.15 * span:
                odds[y, x] = smaller(odds[y, x], larger(8.0 * (alpha - 0.5), -3.0))


@_kernel
def learn(
    image: Image,
    aligned: Image,
    mask: Mask,
    near: Mask,
    odds: Plane,
    raw: Plane,
    warped: Plane,
    obj: Image,
    shape: Plane,
    errors: Image,
    bins: Bins,
    inside: Integers,
    knobs: Row,
    s_out: Plane,
    o_out: Image,
    m_out: Plane,
    ground: Image,
    counts: Image,
    tally: Plane,
    sample: Plane,
    sums: Numbers,
) -> None:
    """What is remembered after a frame: log-odds, object layer, slow shape, background, colours.

    `aligned` is the image on the background's own lattice. `near` is 1 within two pixels of the object, 2 on a
    distractor elsewhere. `errors` is what :func:`evidence` wrote. `ground` (h, w, C) and `counts` (3, h, w: samples,
    mismatches, age) are the background, updated in place. knobs = (shape rate, freeze, occluded). `tally` (2, bins)
    receives the colour counts of object and background. `sums` receives (known pixels outside, of these unexplained,
    85th percentile of |I − B| there); `sample` is a workspace for that.
    """
    h, w, channels = image.shape
    shape_rate = knobs[0]
    freeze = knobs[1]
    occluded = knobs[2]
    mean = 1.0 / channels
    known = 0
    strange = 0
    taken = 0
    for y in range(h):
        for x in range(w):
            m = mask[y, x] != 0
            s = warped[y, x]
            belief = odds[y, x]
            if m:
                s_new = larger(raw[y, x], 0.2)
            else:
                s_new = s + 0.5 * (belief - s)
            s_out[y, x] = smaller(larger(s_new, -3.0), 4.0)
            m_out[y, x] = shape[y, x]
            if freeze == 0.0:
                target = smaller(larger(belief + 0.5, 0.0), 1.0) if m else 0.0
                m_out[y, x] += shape_rate * (target - shape[y, x])
            rate = 0.0
            if m:
                if errors[0, y, x] > -0.3 and (occluded == 0.0 or errors[1, y, x] >= 4.0):
                    d = 0.0
                    for c in range(channels):
                        d += image[y, x, c] - obj[y, x, c]
                    # what has lit up that much is rather a highlight that moves on than the surface
                    rate = 0.5 if d * mean < 25.0 else 0.1
            elif freeze == 0.0:
                rate = 1.0
            for c in range(channels):
                o = obj[y, x, c]
                o_out[y, x, c] = o + rate * (image[y, x, c] - o)
            if x < inside[0] or y < inside[1] or x >= inside[2] or y >= inside[3]:
                continue
            n = counts[0, y, x]
            free = near[y, x] != 1
            if free:
                tally[1, bins[y, x]] += 1.0
            elif m and belief > 1.0:
                tally[0, bins[y, x]] += 1.0
            error = errors[1, y, x]
            gain = errors[3, y, x]
            if free and n >= KNOWN:
                known += 1
                if error > 5.0:
                    strange += 1
                if near[y, x] == 0 and (x + 2 * y) % 7 == 0 and taken < sample.shape[1]:
                    # in shadow, by what the shadow leaves unexplained
                    light = gain if gain < 0.9 or gain > 1.1 else 1.0
                    d = 0.0
                    for c in range(channels):
                        d += abs(aligned[y, x, c] - light * ground[y, x, c])
                    sample[0, taken] = d * mean
                    taken += 1
            if not m and error < 4.0 and n >= KNOWN:
                counts[2, y, x] = 0.0
            else:
                counts[2, y, x] += 1.0
            if not free or belief >= -1.0:
                continue
            if n < KNOWN and errors[4, y, x] >= 4.0:
                n = 0.0  # something moves here: begin again
            if n >= KNOWN and error >= 6.0:
                bad = counts[1, y, x] + 1.0
                counts[1, y, x] = bad
                if bad < 6.0 or (bad < 25.0 and (gain < 0.93 or gain > 1.07)):
                    continue
                n = 0.0
            else:
                counts[1, y, x] = 0.0
            if n >= KNOWN and gain <= 0.93:
                continue
            if n >= KNOWN and gain > 1.07:
                n = 0.0
            rate = larger(1.0 / (n + 1.0), 0.06)
            if n >= KNOWN and gain < 0.985:
                rate = smaller(rate, 0.02)
            for c in range(channels):
                b = ground[y, x, c]
                ground[y, x, c] = b + rate * (aligned[y, x, c] - b)
            counts[0, y, x] = smaller(n + 1.0, 20.0)
    sums[0] = known
    sums[1] = strange
    sums[2] = _select(sample[0], taken, 0.85) if taken > 10 else -1.0
