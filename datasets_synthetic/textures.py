"""What surfaces look like: photographs that ship inside scikit-image, and patterns drawn by rule.

Every function makes a (height, width, 3) BGR picture in 0–255. The photographs are PNG files of the wheel: nothing
is downloaded, and every decoder gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .spec import Texture

__all__ = ["PHOTOGRAPHS", "TEXTURES", "paint", "resample", "sample", "soften"]

Image = NDArray[np.float32]

PHOTOGRAPHS = ("astronaut", "brick", "camera", "chelsea", "coffee", "coins", "grass", "gravel", "moon", "page")


@cache
def _photograph(name: str, shrink: int) -> Image:
    """Photograph made smaller by means over `shrink` × `shrink` pixels."""
    import skimage.data

    picture = np.asarray(getattr(skimage.data, name)())
    if picture.ndim == 2:
        picture = np.repeat(picture[:, :, np.newaxis], 3, axis=2)
    rows, columns = picture.shape[0] // shrink, picture.shape[1] // shrink
    blocks = picture[: rows * shrink, : columns * shrink, 2::-1].reshape(rows, shrink, columns, shrink, 3)
    image: Image = np.ascontiguousarray(blocks.mean(axis=(1, 3), dtype=np.float64), dtype=np.float32)
    image.flags.writeable = False
    return image


def soften(image: Image) -> Image:
    """Blur with (1, 2, 1) / 4 both ways: what a lens does, and what keeps sub-pixel motion free of shimmer."""
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    rows = 0.25 * padded[:-2] + 0.5 * padded[1:-1] + 0.25 * padded[2:]
    return np.asarray(0.25 * rows[:, :-2] + 0.5 * rows[:, 1:-1] + 0.25 * rows[:, 2:], dtype=np.float32)


def _taps(positions: NDArray[np.float64], size: int) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
    """Indices (4, N) and Catmull–Rom weights (4, N) of positions, in texels with centres at whole numbers."""
    base = np.floor(positions)
    f = positions - base
    weights = np.stack(
        [
            ((-0.5 * f + 1.0) * f - 0.5) * f,
            (1.5 * f - 2.5) * f * f + 1.0,
            ((-1.5 * f + 2.0) * f + 0.5) * f,
            (0.5 * f - 0.5) * f * f,
        ]
    )
    indices = np.clip(base.astype(np.int64) + np.arange(-1, 3)[:, np.newaxis], 0, size - 1)
    return indices, weights.astype(np.float32)


def resample(image: Image, ys: NDArray[np.float64], xs: NDArray[np.float64]) -> Image:
    """Sample an image on a grid of rows and columns.

    Parameters
    ----------
    image : ndarray, shape (H, W, 3)
    ys, xs : ndarray, shape (M,) and (N,)
        Row and column positions; whole numbers are pixel centres. Beyond the border the edge repeats.

    Returns
    -------
    ndarray, shape (M, N, 3), float32
        Cubic (Catmull–Rom); exact copies where all positions are whole.
    """
    rows, row_weights = _taps(ys, image.shape[0])
    columns, column_weights = _taps(xs, image.shape[1])
    if (ys == np.floor(ys)).all() and (xs == np.floor(xs)).all():
        return np.ascontiguousarray(image[rows[1]][:, columns[1]])
    first, last = int(columns.min()), int(columns.max()) + 1
    strip = image[:, first:last]
    tall = sum(row_weights[k][:, np.newaxis, np.newaxis] * strip[rows[k]] for k in range(4))
    wide = sum(column_weights[k][np.newaxis, :, np.newaxis] * np.take(tall, columns[k] - first, 1) for k in range(4))
    return np.asarray(wide, dtype=np.float32)


def sample(image: Image, x: NDArray[np.float64], y: NDArray[np.float64], *, closed: bool = False) -> Image:
    """Sample an image at scattered points, bilinearly; beyond the border it is mirrored.

    Parameters
    ----------
    image : ndarray, shape (H, W, 3)
    x, y : ndarray, one shape
        Positions; whole numbers are pixel centres.
    closed : bool
        The right border meets the left one, as on a can.

    Returns
    -------
    ndarray, shape (*x.shape, 3), float32
    """
    height, width = image.shape[:2]
    x0, y0 = np.floor(x), np.floor(y)
    fx = (x - x0).astype(np.float32)[..., np.newaxis]
    fy = (y - y0).astype(np.float32)[..., np.newaxis]
    fold = _wrap if closed else _mirror
    left, right = fold(x0, width), fold(x0 + 1.0, width)
    top, bottom = _mirror(y0, height) * width, _mirror(y0 + 1.0, height) * width
    flat = image.reshape(-1, 3)

    def row(start: NDArray[np.int64]) -> Image:
        first = np.take(flat, start + left, axis=0)
        return np.asarray(first + (np.take(flat, start + right, axis=0) - first) * fx, dtype=np.float32)

    upper = row(top)
    return np.asarray(upper + (row(bottom) - upper) * fy, dtype=np.float32)


def _mirror(index: NDArray[np.float64], size: int) -> NDArray[np.int64]:
    whole = index.astype(np.int64)
    if whole.size and 0 <= whole.min() and whole.max() < size:
        return whole
    folded = whole % (2 * size)
    return np.minimum(folded, 2 * size - 1 - folded)


def _wrap(index: NDArray[np.float64], size: int) -> NDArray[np.int64]:
    return index.astype(np.int64) % size


def photograph(name: str, height: int, width: int, rng: np.random.Generator, shrink: int = 1) -> Image:
    """Cut a piece out of a photograph, enlarged only where it is too small."""
    picture = _photograph(name, shrink)
    scale = max(height / picture.shape[0], width / picture.shape[1], 1.0)
    room_y, room_x = picture.shape[0] - height / scale, picture.shape[1] - width / scale
    y0, x0 = (int(rng.uniform(0.0, max(room, 0.0)) + 1e-9) for room in (room_y, room_x))
    ys = (np.arange(height) + 0.5) / scale - 0.5 + y0
    xs = (np.arange(width) + 0.5) / scale - 0.5 + x0
    return resample(picture, ys, xs)


def _grain(height: int, width: int, cell: float, rng: np.random.Generator, channels: int = 1) -> Image:
    """Smooth random field of about unit deviation whose features are `cell` px wide."""
    rows, columns = int(height / cell) + 3, int(width / cell) + 3
    coarse = rng.standard_normal((rows, columns, channels)).astype(np.float32)
    ys, xs = np.arange(height) / cell + 0.5, np.arange(width) / cell + 0.5
    return resample(coarse, ys, xs)


def plain(height: int, width: int, rng: np.random.Generator) -> Image:
    """One colour."""
    colour = rng.uniform(70.0, 190.0, 3).astype(np.float32)
    return np.broadcast_to(colour, (height, width, 3)).copy()


def clouds(height: int, width: int, rng: np.random.Generator) -> Image:
    """Coloured noise of several octaves."""
    field = sum(
        _grain(height, width, cell, rng, 3) * np.float32(gain) for cell, gain in ((28, 24), (11, 18), (4, 12))
    )
    return np.asarray(128.0 + field, dtype=np.float32)


def speckle(height: int, width: int, rng: np.random.Generator) -> Image:
    """Fine grain on one colour: sand, asphalt, cloth."""
    field = 16.0 * _grain(height, width, 2.5, rng) + 9.0 * _grain(height, width, 40.0, rng)
    return np.asarray(plain(height, width, rng) * 0.5 + 64.0 + field, dtype=np.float32)


def patches(height: int, width: int, rng: np.random.Generator) -> Image:
    """Blotches of a few colours with firm borders, as painted on."""
    field = _grain(height, width, 13.0, rng)[..., 0] + 0.4 * _grain(height, width, 6.0, rng)[..., 0]
    levels = np.digitize(field, [-0.7, 0.0, 0.7])
    palette = rng.uniform(30.0, 230.0, (4, 3)).astype(np.float32)
    return np.asarray(palette[levels], dtype=np.float32)


def stripes(height: int, width: int, rng: np.random.Generator) -> Image:
    """Slanted stripes of unequal width in three colours."""
    angle = rng.uniform(0.3, 1.2)
    y, x = np.mgrid[:height, :width]
    along = (x * np.cos(angle) + y * np.sin(angle)) / rng.uniform(7.0, 11.0)
    palette = rng.uniform(30.0, 230.0, (3, 3)).astype(np.float32)
    edge = np.digitize(np.sin(along) + 0.6 * np.sin(0.37 * along + 1.0), [-0.5, 0.5])
    return np.asarray(palette[edge], dtype=np.float32)


def dots(height: int, width: int, rng: np.random.Generator) -> Image:
    """Dots strewn on one colour."""
    pitch = 13.0
    y, x = np.mgrid[:height, :width]
    row, column = (y // pitch).astype(int), (x // pitch).astype(int)
    shape = (row.max() + 1, column.max() + 1)
    cy, cx = rng.uniform(0.35, 0.65, (2, *shape)) * pitch
    radius = rng.uniform(0.2, 0.38, shape) * pitch
    inside = np.hypot(y % pitch - cy[row, column], x % pitch - cx[row, column]) < radius[row, column]
    back, dot = rng.uniform(40.0, 110.0, 3), rng.uniform(140.0, 240.0, (*shape, 3))
    return np.where(inside[..., np.newaxis], dot[row, column], back).astype(np.float32)


def checker(height: int, width: int, rng: np.random.Generator) -> Image:
    """Checkerboard in two colours."""
    pitch = rng.uniform(9.0, 13.0)
    y, x = np.mgrid[:height, :width]
    odd = ((y // pitch + x // pitch) % 2).astype(np.float32)[..., np.newaxis]
    first, second = rng.uniform(30.0, 110.0, 3), rng.uniform(150.0, 230.0, 3)
    return np.asarray(first * (1 - odd) + second * odd, dtype=np.float32)


TEXTURES: dict[str, Callable[[int, int, np.random.Generator], Image]] = {
    **{name: partial(photograph, name) for name in PHOTOGRAPHS},
    "plain": plain,
    "clouds": clouds,
    "speckle": speckle,
    "patches": patches,
    "stripes": stripes,
    "dots": dots,
    "checker": checker,
}


def paint(texture: Texture, height: int, width: int) -> Image:
    """Make the picture of a texture.

    Parameters
    ----------
    texture : Texture
    height, width : int
        Size, px.

    Returns
    -------
    ndarray, shape (height, width, 3), float32, BGR
        In 0–255, softened; contrast is about the picture's own mean, and the mean is moved to `colour`.
    """
    rng = np.random.default_rng([texture.seed, 5])
    if texture.kind in PHOTOGRAPHS:
        image = photograph(texture.kind, height, width, rng, texture.shrink)
    else:
        image = TEXTURES[texture.kind](height, width, rng)
    image = soften(image)
    mean = image.mean(axis=(0, 1))
    colour = np.asarray(texture.colour, dtype=np.float32) if texture.colour is not None else mean
    return np.asarray(np.clip((image - mean) * np.float32(texture.contrast) + colour, 0.0, 255.0), dtype=np.float32)
