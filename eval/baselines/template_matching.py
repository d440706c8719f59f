"""Template matching at its best: normalised cross-correlation over position and scale, with two templates.

One template is the first view and never changes; the other follows the object's look slowly, and only in good frames.
Their mean decides, so that neither drift nor a change of view alone loses the target.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

__all__ = ["TemplateMatching"]

_SIDE = 40  # px: longest side of the template; larger objects are matched at reduced resolution
_SCALES = (0.94, 0.97, 1.0, 1.03, 1.06)  # of the box, from one frame to the next
_SCALE_COST = 0.02  # of a peak that asks for another scale, so that noise does not make the box breathe
_REACH = 0.9  # search radius in box sizes, beside _REACH_PIXELS
_REACH_PIXELS = 12.0
_FOUND = 0.40  # least correlation that counts as found
_GOOD = 0.70  # least correlation at which the second template learns
_RATE = 0.15  # of learning

Window = NDArray[np.float32]


class TemplateMatching:
    """Multi-scale normalised cross-correlation in a search window, with cv2's calls."""

    def init(self, image: NDArray[Any], boundingBox: tuple[int, int, int, int]) -> None:
        """Take the template."""
        x, y, w, h = (float(value) for value in boundingBox)
        self._centre = np.array([x + w / 2, y + h / 2])
        self._size = np.array([w, h])
        self._velocity = np.zeros(2)
        self._lost = 0
        # Template pixels per image pixel at scale 1.
        self._zoom = min(1.0, _SIDE / max(w, h))
        self._shape = max(4, round(w * self._zoom)), max(4, round(h * self._zoom))
        self._scale = 1.0
        self._first = self._window(image, self._centre, self._shape, 1.0)
        self._recent = self._first.copy()

    def update(self, image: NDArray[Any]) -> tuple[bool, tuple[float, float, float, float]]:
        """Find the best position and scale near the predicted position."""
        predicted = self._centre + (self._velocity if self._lost == 0 else 0.0)
        score, centre, factor = self._search(image, predicted)
        if score < _FOUND:
            self._lost += 1
            return False, (0.0, 0.0, 0.0, 0.0)
        self._velocity = np.zeros(2) if self._lost else 0.5 * self._velocity + 0.5 * (centre - self._centre)
        self._lost = 0
        self._centre = np.clip(centre, 0.0, (image.shape[1], image.shape[0]))
        self._scale = float(np.clip(self._scale * factor, 0.2, 5.0))
        if score > _GOOD:
            seen = self._window(image, self._centre, self._shape, self._scale)
            self._recent += np.float32(_RATE) * (seen - self._recent)
        width, height = self._size * self._scale
        return True, (self._centre[0] - width / 2, self._centre[1] - height / 2, width, height)

    def _search(
        self, image: NDArray[Any], predicted: NDArray[np.float64]
    ) -> tuple[float, NDArray[np.float64], float]:
        best = (-1.0, predicted, 1.0)
        # The longer it is lost, the farther it looks; the scale is searched only while it is not.
        reach = (_REACH * self._size.max() * self._scale + _REACH_PIXELS) * min(1.5**self._lost, 4.0)
        for factor in _SCALES if self._lost == 0 else (1.0,):
            scale = self._scale * factor
            zoom = self._zoom / scale
            margin = int(np.ceil(reach * zoom))
            shape = self._shape[0] + 2 * margin, self._shape[1] + 2 * margin
            window = self._window(image, predicted, shape, scale)
            response = 0.5 * (_correlation(window, self._first) + _correlation(window, self._recent))
            row, column = np.unravel_index(int(np.argmax(response)), response.shape)
            score = float(response[row, column]) - (_SCALE_COST if factor != 1.0 else 0.0)
            if score > best[0]:
                offset = np.array([column, row]) + _sub_pixel(response, int(row), int(column)) - margin
                best = (score, predicted + offset / zoom, factor)
        return best

    def _window(
        self, image: NDArray[Any], centre: NDArray[np.float64], shape: tuple[int, int], scale: float
    ) -> Window:
        """Cut a window (width, height) out round a centre, resampled so that the object has the template's size."""
        zoom = self._zoom / scale
        shift = np.array(shape) / 2 - centre * zoom - 0.5 + 0.5 * zoom
        matrix = np.array([[zoom, 0.0, shift[0]], [0.0, zoom, shift[1]]])
        blurred = self._reduced(image, centre, shape, zoom) if zoom < 0.6 else None
        if blurred is not None:
            return blurred
        part = cv2.warpAffine(image, matrix, shape, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(part, dtype=np.float32)

    @staticmethod
    def _reduced(
        image: NDArray[Any], centre: NDArray[np.float64], shape: tuple[int, int], zoom: float
    ) -> Window | None:
        """The same by averaging, where the picture is made much smaller and linear interpolation would alias."""
        half = np.array(shape) / (2 * zoom)
        left, top = np.floor(centre - half).astype(int)
        right, bottom = np.ceil(centre + half).astype(int)
        pads = max(0, -top), max(0, bottom - image.shape[0]), max(0, -left), max(0, right - image.shape[1])
        part = image[max(0, top) : bottom, max(0, left) : right]
        if part.size == 0:
            return None
        if any(pads):
            part = cv2.copyMakeBorder(part, *pads, cv2.BORDER_REPLICATE)
        small = cv2.resize(part, None, fx=min(1.0, 2 * zoom), fy=min(1.0, 2 * zoom), interpolation=cv2.INTER_AREA)
        ratio = np.array([small.shape[1] / part.shape[1], small.shape[0] / part.shape[0]])
        step = zoom / ratio
        shift = np.array(shape) / 2 - (centre - (left, top)) * zoom - 0.5 + 0.5 * step
        matrix = np.array([[step[0], 0.0, shift[0]], [0.0, step[1], shift[1]]])
        window = cv2.warpAffine(small, matrix, shape, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(window, dtype=np.float32)


def _correlation(window: Window, template: Window) -> Window:
    """Correlation coefficient at every offset: mean over the channels, weighted by the template's contrast in each.

    Channel by channel, since OpenCV is many times faster on one than on three together.
    """
    windows, templates = (np.atleast_3d(image).transpose(2, 0, 1) for image in (window, template))
    contrast = templates.std(axis=(1, 2)) + 1e-6
    total = np.zeros([1 + a - b for a, b in zip(window.shape[:2], template.shape[:2], strict=True)], dtype=np.float32)
    for weight, image, pattern in zip(contrast / contrast.sum(), windows, templates, strict=True):
        found = cv2.matchTemplate(np.ascontiguousarray(image), np.ascontiguousarray(pattern), cv2.TM_CCOEFF_NORMED)
        # A flat window correlates with nothing, and OpenCV may answer 1 or infinity there.
        total += np.float32(weight) * np.where(np.abs(found) <= 1.0 + 1e-3, found, -1.0)
    return total


def _sub_pixel(response: NDArray[np.float32], row: int, column: int) -> NDArray[np.float64]:
    """Offset (x, y) of a peak from its pixel: the top of the parabola through its neighbours."""
    offset = np.zeros(2)
    if 0 < column < response.shape[1] - 1:
        offset[0] = _parabola(*response[row, column - 1 : column + 2])
    if 0 < row < response.shape[0] - 1:
        offset[1] = _parabola(*response[row - 1 : row + 2, column])
    return offset


def _parabola(before: float, peak: float, after: float) -> float:
    bend = before - 2 * peak + after
    return float(np.clip(0.5 * (before - after) / bend, -0.5, 0.5)) if bend < 0 else 0.0
