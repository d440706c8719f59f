"""A rendered sequence: pictures and their exact truth."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .pose import stage_of
from .spec import SequenceSpec

__all__ = ["Sequence"]


@dataclass(frozen=True, eq=False)
class Sequence:
    """Frames and truth of T frames.

    Parameters
    ----------
    spec : SequenceSpec
    frames : ndarray, shape (T, H, W, 3) BGR or (T, H, W) gray, uint8; uint16 of a deep camera
    boxes : ndarray, shape (T, 4), float64
        Amodal: x, y, w, h of the whole target, px, unclipped, whether it is seen or not; never NaN.
    visible_boxes : ndarray, shape (T, 4), float64
        Of the part that is seen; NaN where nothing is.
    masks : ndarray, shape (T, H, W), bool
        Pixels of which the visible target covers at least half.
    visibility : ndarray, shape (T,), float64
        Share of the target's area that is seen; 0 exactly where the mask is empty.
    polygons : tuple of T tuples of ndarray, shape (N, 2)
        Unclipped outline of each part of the target, px.
    labels : ndarray, shape (T, H, W), uint8
        Which part of which actor is seen; 0 is the background.
    frame_attributes : dict of str to ndarray, shape (T,), bool
    """

    spec: SequenceSpec
    frames: NDArray[np.uint8] | NDArray[np.uint16]
    boxes: NDArray[np.float64]
    visible_boxes: NDArray[np.float64]
    masks: NDArray[np.bool_]
    visibility: NDArray[np.float64]
    polygons: tuple[tuple[NDArray[np.float64], ...], ...]
    labels: NDArray[np.uint8]
    frame_attributes: dict[str, NDArray[np.bool_]]

    @property
    def name(self) -> str:
        """Name of the sequence."""
        return self.spec.name

    @property
    def attributes(self) -> tuple[str, ...]:
        """What the sequence is about."""
        return self.spec.attributes

    def __len__(self) -> int:
        return len(self.frames)

    def flow(self, t: int) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        """True motion from frame t to frame t + 1, of target, other actors and background.

        Parameters
        ----------
        t : int
            In 0 … T − 2.

        Returns
        -------
        flow : ndarray, shape (H, W, 2), float32
            (u, v), px/frame: ``frames[t][y, x] ≈ frames[t + 1][y + v, x + u]``. 0 where it is not known.
        valid : ndarray, shape (H, W), bool
            Whether the point that the pixel shows is seen in frame t + 1 too.

        Raises
        ------
        IndexError
            If there is no frame t or t + 1.
        """
        if not 0 <= t < len(self.frames) - 1:
            raise IndexError(f"expected a frame in 0 … {len(self.frames) - 2}, got {t}")
        stage = stage_of(self.spec)
        labels = self.labels[t]
        rows, columns = np.indices(labels.shape)
        x, y = columns + 0.5, rows + 0.5
        world = stage.camera(t).to_world(x, y)
        new_x, new_y = stage.camera(t + 1).to_pixel(*world)
        for index in range(len(stage.actors)):
            now, then = stage.actor(index, t), stage.actor(index, t + 1)
            for k, label in enumerate(stage.labels_of(index)):
                seen = labels == label
                if seen.any():
                    painted = now[k].inverse(*now[k].own(x[seen], y[seen]))
                    new_x[seen], new_y[seen] = then[k].forward(*painted)
        known = np.isfinite(new_x) & np.isfinite(new_y)
        flow = np.where(known[..., np.newaxis], np.stack([new_x - x, new_y - y], axis=-1), 0.0).astype(np.float32)
        if self.spec.blank(t) or self.spec.blank(t + 1):
            return flow, np.zeros_like(known)
        return flow, known & _same_label(labels, self.labels[t + 1], x + flow[..., 0], y + flow[..., 1])


def _same_label(
    labels: NDArray[np.uint8], after: NDArray[np.uint8], x: NDArray[Any], y: NDArray[Any]
) -> NDArray[np.bool_]:
    """Whether the pixel of `after` at (x, y) exists and shows the same part."""
    height, width = labels.shape
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    there = after[np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    return np.asarray(inside & (there == labels))
