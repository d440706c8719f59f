"""Windows: smoothed, moved by an affine motion, copied into the next frame's."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, smaller
from .common import KNOWN, Image, Integers, Mask, Numbers, Plane, Row, fast_kernel

f32 = np.float32


@fast_kernel
def smooth(pixels: Plane, taps: Row, line: Row, image: Plane, gray: Plane) -> None:
    """Smooth pixels (h + 4, (w + 4) C), C = 1 or 3, by five taps both ways, into image (h, 3 w) and gray (h, w).

    `taps` are the middle one, its neighbour and the outermost; `line` ((w + 4) C) is a workspace. A gray frame is
    written three times: what follows knows but one kind of window.
    """
    h, w = gray.shape
    a = taps[0]
    b = taps[1]
    c = taps[2]
    for y in range(h):
        for i in range(line.shape[0]):
            near = pixels[y + 1, i] + pixels[y + 3, i]
            line[i] = a * pixels[y + 2, i] + b * near + c * (pixels[y, i] + pixels[y + 4, i])
        if line.shape[0] == w + 4:
            for x in range(w):
                gray[y, x] = a * line[x + 2] + b * (line[x + 1] + line[x + 3]) + c * (line[x] + line[x + 4])
            for x in range(w):
                image[y, 3 * x] = gray[y, x]
                image[y, 3 * x + 1] = gray[y, x]
                image[y, 3 * x + 2] = gray[y, x]
        else:
            for i in range(3 * w):
                image[y, i] = a * line[i + 6] + b * (line[i + 3] + line[i + 9]) + c * (line[i] + line[i + 12])
            for x in range(w):
                green = f32(0.587) * image[y, 3 * x + 1]
                gray[y, x] = f32(0.114) * image[y, 3 * x] + green + f32(0.299) * image[y, 3 * x + 2]


@fast_kernel
def carry(
    previous: Image,
    obj: Image,
    odds: Plane,
    shape: Plane,
    counts: Image,
    inverse: Numbers,
    part: Integers,
    everywhere: bool,
    previous_out: Image,
    obj_out: Image,
    odds_out: Plane,
    shape_out: Plane,
    own_out: Mask,
) -> None:
    """Move what belongs to the object, in `part` (x0, y0, x1, y1) of the window, as :func:`resample` does.

    Images repeat their border, the planes are −3 and 0 beyond theirs; outside `part` images are 0 and planes the same
    as beyond. `own_out` is 1 where the log-odds are positive. The previous image is moved only where the background
    is not yet known, unless `everywhere`.
    """
    h, w, channels = obj.shape
    if channels != 3 or previous.shape[2] != 3 or obj_out.shape[2] != 3 or previous_out.shape[2] != 3:
        return
    right = f32(w - 1)
    bottom = f32(h - 1)
    step_x = f32(inverse[0])
    step_y = f32(inverse[3])
    for y in range(h):
        for x in range(w):
            odds_out[y, x] = f32(-3.0)
        for x in range(w):
            shape_out[y, x] = f32(0.0)
        for x in range(w):
            own_out[y, x] = 0
        for x in range(w):
            for c in range(3):
                obj_out[y, x, c] = f32(0.0)
        for x in range(w):
            for c in range(3):
                previous_out[y, x, c] = f32(0.0)
        if y < part[1] or y >= part[3]:
            continue
        start_x = f32(inverse[1] * y + inverse[2])
        start_y = f32(inverse[4] * y + inverse[5])
        for x in range(part[0], part[2]):
            wanted_x = start_x + step_x * f32(x)
            wanted_y = start_y + step_y * f32(x)
            px = smaller(larger(wanted_x, f32(0.0)), right)
            py = smaller(larger(wanted_y, f32(0.0)), bottom)
            ix = smaller(np.int64(px), w - 2)
            iy = smaller(np.int64(py), h - 2)
            fx = px - f32(ix)
            fy = py - f32(iy)
            # what lies beyond the border by a part of a pixel is partly there
            cover = larger(f32(1.0) - abs(wanted_x - px), f32(0.0)) * larger(f32(1.0) - abs(wanted_y - py), f32(0.0))
            a = odds[iy, ix] + fx * (odds[iy, ix + 1] - odds[iy, ix])
            b = odds[iy + 1, ix] + fx * (odds[iy + 1, ix + 1] - odds[iy + 1, ix])
            s = cover * (a + fy * (b - a) + f32(3.0)) - f32(3.0)
            odds_out[y, x] = s
            own_out[y, x] = 1 if s > f32(0.0) else 0
            a = shape[iy, ix] + fx * (shape[iy, ix + 1] - shape[iy, ix])
            b = shape[iy + 1, ix] + fx * (shape[iy + 1, ix + 1] - shape[iy + 1, ix])
            shape_out[y, x] = cover * (a + fy * (b - a))
            for c in range(3):
                a = obj[iy, ix, c] + fx * (obj[iy, ix + 1, c] - obj[iy, ix, c])
                b = obj[iy + 1, ix, c] + fx * (obj[iy + 1, ix + 1, c] - obj[iy + 1, ix, c])
                obj_out[y, x, c] = a + fy * (b - a)
            if everywhere or counts[0, y, x] < KNOWN:
                for c in range(3):
                    a = previous[iy, ix, c] + fx * (previous[iy, ix + 1, c] - previous[iy, ix, c])
                    b = previous[iy + 1, ix, c] + fx * (previous[iy + 1, ix + 1, c] - previous[iy + 1, ix, c])
                    previous_out[y, x, c] = a + fy * (b - a)


@fast_kernel
def shift(source: Plane, dx: int, dy: int, fill: float, out: Plane) -> None:
    """Copy into a window whose element (i, j) is (i + dx, j + dy) here; `fill` where there is none."""
    h, w = source.shape
    height, width = out.shape
    other = f32(fill)
    for y in range(height):
        row = y + dy
        there = row >= 0 and row < h
        first = smaller(larger(-dx, 0), width) if there else width
        last = larger(smaller(w - dx, width), first)
        for x in range(first):
            out[y, x] = other
        for x in range(first, last):
            out[y, x] = source[row, x + dx]
        for x in range(last, width):
            out[y, x] = other


@fast_kernel
def move_object(
    dx: int, dy: int, odds: Plane, shape: Plane, obj: Plane, odds_out: Plane, shape_out: Plane, obj_out: Plane
) -> None:
    """Copy what is known of the object into another window, see :func:`shift`. Images are (h, 3 w) here."""
    shift(odds, dx, dy, -3.0, odds_out)
    shift(shape, dx, dy, 0.0, shape_out)
    shift(obj, 3 * dx, dy, 0.0, obj_out)


@fast_kernel
def move_ground(
    dx: int,
    dy: int,
    gain: float,
    picture: Plane,
    counts: Image,
    image: Plane,
    odds: Plane,
    picture_out: Plane,
    counts_out: Image,
) -> None:
    """Copy the background into another window, see :func:`shift`, and make it brighter by `gain`.

    Pixels that are new get the colour of `image`. They are taken as known, or as not yet seen where the object may be
    by its `odds`. Images are (h, 3 w) here; `image` and `odds` are of the new window.
    """
    shift(picture, 3 * dx, dy, 0.0, picture_out)
    for i in range(3):
        shift(counts[i], dx, dy, 0.0, counts_out[i])
    h, w = odds.shape
    factor = f32(gain)
    for y in range(h):
        if factor != f32(1.0):
            for i in range(3 * w):
                picture_out[y, i] *= factor
        there = y + dy >= 0 and y + dy < picture.shape[0]
        first = smaller(larger(-dx, 0), w) if there else w
        last = larger(smaller(picture.shape[1] // 3 - dx, w), first)
        for side in range(2):
            for x in range(last if side else 0, w if side else first):
                counts_out[0, y, x] = KNOWN if odds[y, x] < f32(-1.0) else f32(0.0)
                for c in range(3):
                    picture_out[y, 3 * x + c] = image[y, 3 * x + c]


@fast_kernel
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
