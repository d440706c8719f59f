"""How well each layer explains a pixel."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, local, smaller
from .common import KNOWN, Image, Integers, Mask, Numbers, Plane, Row, fast_kernel, fast_part
from .windows import carry

f32 = np.float32
_THIRD = np.float32(1.0 / 3.0)
_BLOCK = 64  # pixels at a time: results first go to short arrays on the stack, which overlap with nothing

_block = local(_BLOCK)


@fast_part
def _products(a, b, y, rows, first, second):
    """Channel sums of a · b and b · b along a row."""
    for x in range(a.shape[1]):
        b0 = b[y, x, 0]
        b1 = b[y, x, 1]
        b2 = b[y, x, 2]
        rows[first, x] = a[y, x, 0] * b0 + a[y, x, 1] * b1 + a[y, x, 2] * b2
        rows[second, x] = b0 * b0 + b1 * b1 + b2 * b2


@fast_part
def _slopes(a, y, rows, target):
    """Mean over the channels of the squared gradient along a row."""
    h, w, _ = a.shape
    up = larger(y - 1, 0)
    down = smaller(y + 1, h - 1)
    unit = _THIRD * f32(0.25)  # (difference over two pixels)² is four times the gradient squared
    for x in range(w):
        d0 = a[down, x, 0] - a[up, x, 0]
        d1 = a[down, x, 1] - a[up, x, 1]
        d2 = a[down, x, 2] - a[up, x, 2]
        rows[target, x] = unit * (d0 * d0 + d1 * d1 + d2 * d2)
    for x in range(1, w - 1):
        d0 = a[y, x + 1, 0] - a[y, x - 1, 0]
        d1 = a[y, x + 1, 1] - a[y, x - 1, 1]
        d2 = a[y, x + 1, 2] - a[y, x - 1, 2]
        rows[target, x] += unit * (d0 * d0 + d1 * d1 + d2 * d2)
    for c in range(3):
        first = a[y, 1, c] - a[y, 0, c]
        last = a[y, w - 1, c] - a[y, w - 2, c]
        rows[target, 0] += unit * first * first
        rows[target, w - 1] += unit * last * last


@fast_part
def _add_five(rows, group, y, h, w, target):
    """Sum of the rows y − 2 … y + 2 of a group, reflected at the border; the sum begins at column 2."""
    a = group + abs(y - 2) % 5
    b = group + abs(y - 1) % 5
    c = group + y % 5
    d = group + (y + 1 if y + 1 < h else h - 2) % 5
    e = group + (y + 2 if y + 2 < h else 2 * h - y - 4) % 5
    for x in range(w):
        rows[target, x + 2] = rows[a, x] + rows[b, x] + rows[c, x] + rows[d, x] + rows[e, x]
    rows[target, 1] = rows[target, 3]
    rows[target, 0] = rows[target, 4]
    rows[target, w + 2] = rows[target, w]
    rows[target, w + 3] = rows[target, w - 1]


@fast_kernel
def evidence(
    image: Image,
    background: Image,
    moved: Image,
    carried: Image,
    obj: Image,
    warped: Plane,
    counts: Image,
    part: Integers,
    inside: Integers,
    knobs: Row,
    rows: Plane,
    out: Image,
    fresh: Mask,
) -> float:
    """Log-likelihood ratio, object against background, per pixel.

    Parameters are windows: current image, background layer, previous image moved by the camera and by the object's
    motion, object layer and log-odds warped by the object's motion, the background's counts. `part` (x0, y0, x1, y1)
    is where the object layer has been warped; elsewhere nothing can be the object but what is new.
    knobs = (tau_b², tau_o², κ, motion contrast, occluded, noise, least and greatest gain of the background and of
    the object). `rows` (27, w + 4) is a workspace.
    out[0] log-likelihood ratio, out[1] error against the background (any explanation), out[2] local gain of the
    background, out[3] error against the previous image where the background is not yet known. `fresh` is 1 where
    something new covers a background that was seen a moment ago.
    Returns the share of the object's pixels that look about as they did.
    """
    h, w, channels = image.shape
    if channels != 3 or background.shape[2] != 3 or obj.shape[2] != 3 or moved.shape[2] != 3 or carried.shape[2] != 3:
        return 0.0  # from here on LLVM knows it, and can vectorise
    tau_b = knobs[0]
    tau_o = knobs[1]
    unit = knobs[2] * _THIRD
    contrast = knobs[3]
    occluded = knobs[4]
    noise = knobs[5]
    noise2 = noise * noise
    like = (f32(6.0) * noise + f32(6.0)) * (f32(6.0) * noise + f32(6.0)) * f32(3.0)
    texture = larger(f32(2.0), f32(0.8) * noise)
    own = f32(0.0)
    alike = f32(0.0)
    direct = _block()
    error_b = _block()
    error_o = _block()
    gain = _block()
    still = _block()
    other = _block()
    ratio = _block()
    for ahead in range(h + 2):
        # products of five rows are kept, in turn: row r at r % 5 of each group of five
        if ahead < h:
            for side in range(2):
                layer = obj if side else background
                _products(image, layer, ahead, rows, 10 * side + ahead % 5, 10 * side + 5 + ahead % 5)
        y = ahead - 2
        if y < 0:
            continue
        touched = y >= part[1] and y < part[3]
        for x in range(w):
            i0 = image[y, x, 0]
            i1 = image[y, x, 1]
            i2 = image[y, x, 2]
            rows[26, x] = i0 * i0 + i1 * i1 + i2 * i2
        for side in range(2 if touched else 1):
            layer = obj if side else background
            _slopes(layer, y, rows, 20 + side)
        for group in range(4 if touched else 2):
            _add_five(rows, 5 * group, y, h, w, 22 + group)
        slot = y % 5
        for first in range(0, w, _BLOCK):
            m = smaller(w - first, _BLOCK)
            unknown = 0
            for i in range(m):
                unknown += 1 if counts[0, y, first + i] < KNOWN else 0
                error_o[i] = 5.0
                still[i] = 1e9
                other[i] = 1e9
            if unknown > 0:
                for i in range(m):
                    x = first + i
                    i0 = image[y, x, 0]
                    i1 = image[y, x, 1]
                    i2 = image[y, x, 2]
                    d0 = i0 - moved[y, x, 0]
                    d1 = i1 - moved[y, x, 1]
                    d2 = i2 - moved[y, x, 2]
                    e0 = i0 - carried[y, x, 0]
                    e1 = i1 - carried[y, x, 1]
                    e2 = i2 - carried[y, x, 2]
                    new = counts[0, y, x] < KNOWN
                    still[i] = d0 * d0 + d1 * d1 + d2 * d2 if new else f32(1e9)
                    other[i] = e0 * e0 + e1 * e1 + e2 * e2 if new else f32(1e9)
            for i in range(m):
                x = first + i
                n = counts[0, y, x]
                ib = rows[slot, x]
                bb = rows[5 + slot, x]
                ii = rows[26, x]
                crossed = rows[22, x] + rows[22, x + 1] + rows[22, x + 2] + rows[22, x + 3] + rows[22, x + 4]
                squared = rows[23, x] + rows[23, x + 1] + rows[23, x + 2] + rows[23, x + 3] + rows[23, x + 4]
                g = (crossed + f32(1250.0)) / (squared + f32(1250.0))
                g = smaller(larger(g, knobs[6]), knobs[7])
                grad = rows[20, x]
                var = noise2 * (f32(1.0) + f32(1.0) / larger(n, f32(1.0))) + tau_b * grad
                per = unit / var
                plain = larger(ii - f32(2.0) * ib + bb, f32(0.0)) * per
                # a shadow leaves the texture: where there is some, to be explained that way is no accident, unless
                # there is so much noise that a dark object would do as well
                lit = larger(ii - f32(2.0) * g * ib + g * g * bb, f32(0.0))
                shaded = lit * per + texture * noise2 / (noise2 + grad)
                lifted = lit * unit / (var + f32(0.0025) * _THIRD * bb) + f32(3.0)
                e = plain
                e = smaller(e, shaded) if g < f32(0.97) else e
                # what was the object a moment ago has a highlight rather than brighter ground behind it
                e = smaller(e, lifted) if (g > f32(1.03)) & (warped[y, x] <= f32(0.0)) else e
                rest = still[i] * unit / (f32(2.0) * noise2 + tau_b * grad)
                direct[i] = plain
                gain[i] = g
                still[i] = rest
                error_b[i] = smaller(np.float64(e), rest)
            if touched:
                low = larger(part[0] - first, 0)
                high = smaller(part[2] - first, m)
                for i in range(low, high):
                    x = first + i
                    io = rows[10 + slot, x]
                    oo = rows[15 + slot, x]
                    ii = rows[26, x]
                    crossed = rows[24, x] + rows[24, x + 1] + rows[24, x + 2] + rows[24, x + 3] + rows[24, x + 4]
                    squared = rows[25, x] + rows[25, x + 1] + rows[25, x + 2] + rows[25, x + 3] + rows[25, x + 4]
                    g = (crossed + f32(1250.0)) / (squared + f32(1250.0))
                    g = smaller(larger(g, knobs[8]), knobs[9])
                    plain = larger(ii - f32(2.0) * io + oo, f32(0.0))
                    lit = larger(ii - f32(2.0) * g * io + g * g * oo, f32(0.0))
                    grad = tau_o * rows[21, x]
                    var = f32(1.5) * noise2 + grad
                    e = smaller(plain, lit + var / unit) * unit / var
                    # where the background may be explained by the last frame, the object may be too: a plain area
                    # looks as it looked a moment ago with either motion
                    last = other[i] * unit / (f32(2.0) * noise2 + grad)
                    s = warped[y, x]
                    error_o[i] = smaller(np.float64(e), last) if s >= f32(-0.5) else 5.0
                    mine = f32(1.0) if s > f32(0.0) else f32(0.0)
                    own += mine
                    alike += mine if smaller(plain, f32(4.0) * lit) < like else f32(0.0)
            for i in range(m):
                x = first + i
                n = counts[0, y, x]
                s = warped[y, x]
                known = n >= KNOWN
                e = error_b[i]
                ll = 0.5 * (smaller(e, 9.0 if known else 4.0) - smaller(error_o[i], 5.0))
                as_ever = 0.8 * contrast * (1.0 - 0.25 * e)
                ll -= as_ever if known & (e < 4.0) else 0.0
                ll *= contrast if (contrast < 0.99) & (ll < 0.0) & (n < 7.0) & (s > 0.0) else 1.0
                ll = smaller(ll, -1.5) if (occluded > 0.0) & (n > KNOWN) & (e < 2.0) else ll
                far = (s < -2.5) & known & (direct[i] < 2.0)  # far from the object and as ever
                ratio[i] = 0.5 * (direct[i] - 5.0) if far else ll
                error_b[i] = direct[i] if far else e
                still[i] = 0.0 if known else still[i]
            for i in range(m):
                out[0, y, first + i] = ratio[i]
                out[1, y, first + i] = error_b[i]
                out[2, y, first + i] = gain[i]
                out[3, y, first + i] = still[i]
            for i in range(m):
                x = first + i
                new = (error_b[i] >= 7.2) & (counts[0, y, x] > KNOWN) & (counts[2, y, x] <= 4.0)
                fresh[y, x] = 1 if new else 0
        within = y >= inside[1] and y < inside[3]
        for side in range(2):
            for x in range(inside[2] if side and within else 0, inside[0] if within and not side else w):
                fresh[y, x] = 0
                out[0, y, x] = -2.0
                out[1, y, x] = 0.0
                out[2, y, x] = 1.0
                out[3, y, x] = 0.0
    return float(alike / larger(own, f32(1.0)))


@fast_kernel
def explain(
    previous: Image,
    obj: Image,
    odds: Plane,
    shape: Plane,
    inverse: Numbers,
    everywhere: bool,
    image: Image,
    background: Image,
    moved: Image,
    counts: Image,
    part: Integers,
    inside: Integers,
    knobs: Row,
    rows: Plane,
    previous_out: Image,
    obj_out: Image,
    odds_out: Plane,
    shape_out: Plane,
    own_out: Mask,
    out: Image,
    fresh: Mask,
) -> float:
    """Move what belongs to the object to this frame, as :func:`carry` does, and weigh :func:`evidence` there."""
    carry(
        previous, obj, odds, shape, counts, inverse, part, everywhere, previous_out, obj_out, odds_out, shape_out,
        own_out,
    )  # fmt: skip
    alike: float = evidence(
        image, background, moved, previous_out, obj_out, odds_out, counts, part, inside, knobs, rows, out, fresh
    )
    return alike
