"""Windows moved: into the next frame, by an affine motion."""

# Parts have no types of their own: Numba infers them.
# mypy: allow-untyped-defs, no-check-untyped-defs, allow-untyped-calls
from __future__ import annotations

import numpy as np

from ...compiling import larger, smaller
from .common import KNOWN, Image, Mask, Numbers, Plane, fast_kernel


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


@fast_kernel
def open_ground(near: Mask, counts: Image, out: Plane) -> int:
    """Write 1 where the background is known and nothing is `near`, 0 elsewhere; return how many pixels that is."""
    h, w = near.shape
    n = 0
    for y in range(h):
        for x in range(w):
            free = near[y, x] == 0 and counts[0, y, x] >= KNOWN
            out[y, x] = np.float32(1.0) if free else np.float32(0.0)
            n += 1 if free else 0
    return n
