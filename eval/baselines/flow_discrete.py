"""Flow as a labelling problem: belief propagation on a grid of displacements, coarse to fine.

Source: P. Felzenszwalb and D. Huttenlocher, "Efficient belief propagation for early vision", IJCV 70 (2006) 41–54:
min-sum messages with a truncated linear smoothness term, each message in time linear in the number of labels. The
labels of every level are the displacements within two steps of what the level before has found, so that large
motions need no large label sets.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from .flow_common import FloatImage, Flow, Frame, float_gray, image_pyramid, resize_flow, smooth_flow, warp

__all__ = ["belief_propagation"]

REACH = 2
"""Labels on either side of the present displacement, in each direction."""

SIDE = 2 * REACH + 1


@dataclass(frozen=True)
class _Energy:
    """The energy that is minimised.

    Parameters
    ----------
    data_truncation : float
        Largest cost of a pixel's brightness difference, gray levels: occluded pixels must not vote.
    smoothness : float
        Cost per px of difference between neighbouring displacements (sum of both components), gray levels.
    smooth_truncation : float
        Largest cost of a difference, gray levels: motion boundaries must stay affordable.
    rounds : int
        Times every pixel passes messages to its four neighbours.
    """

    data_truncation: float = 20.0
    smoothness: float = 6.0
    smooth_truncation: float = 15.0
    rounds: int = 8


def belief_propagation(first: Frame, second: Frame) -> Flow:
    """Flow by loopy belief propagation.

    From labels down to a quarter of a pixel at half the resolution.
    """
    one, other = float_gray(first), float_gray(second)
    # Half the resolution: a quarter of the time and memory, and the labels are finer than a pixel anyway.
    pyramids = [image_pyramid(frame, 16) for frame in (one, other)]
    pyramids = [pyramid[1:] or pyramid for pyramid in pyramids]
    levels = list(zip(*pyramids, strict=True))[::-1]
    flow = np.zeros((*levels[0][0].shape, 2), np.float32)
    for number, (small, small_other) in enumerate(levels):
        flow = resize_flow(flow, small.shape)
        for step in (1.0, 0.5, 0.25) if number == len(levels) - 1 else (1.0, 0.5):
            flow = smooth_flow(_label(small, small_other, flow, step, _Energy()), 3)
    return resize_flow(flow, one.shape)


def _label(
    one: FloatImage, other: FloatImage, flow: NDArray[np.float32], step: float, energy: _Energy
) -> NDArray[np.float32]:
    """Best displacement of every pixel among those ``step`` apart round the given flow."""
    base = np.rint(flow / step).astype(np.int32)
    data = _data_costs(one, other, base, step, energy)
    messages = np.zeros((4, *data.shape), np.float32)
    for _ in range(energy.rounds):
        messages = _passed(data, messages, base, step, energy)
    belief = (data + messages.sum(axis=0)).reshape(SIDE * SIDE, *one.shape)
    row, column = np.divmod(belief.argmin(axis=0), SIDE)
    offset = np.stack([column, row], axis=2) - REACH
    return np.asarray((base + offset) * step, dtype=np.float32)


def _data_costs(
    one: FloatImage, other: FloatImage, base: NDArray[np.int32], step: float, energy: _Energy
) -> NDArray[np.float32]:
    """Truncated brightness difference of every label, (SIDE, SIDE, H, W), labels in y then x."""
    costs = np.empty((SIDE, SIDE, *one.shape), np.float32)
    for row in range(SIDE):
        for column in range(SIDE):
            flow = step * (base + np.array([column - REACH, row - REACH]))
            difference = np.abs(one - warp(other, flow, cv2.INTER_CUBIC))
            costs[row, column] = cv2.blur(np.minimum(difference, energy.data_truncation), (3, 3))
    return costs


def _passed(
    data: NDArray[np.float32],
    messages: NDArray[np.float32],
    base: NDArray[np.int32],
    step: float,
    energy: _Energy,
) -> NDArray[np.float32]:
    """One round: what every pixel hears from its left, right, upper and lower neighbour."""
    total = data + messages.sum(axis=0)
    heard = np.zeros_like(messages)
    everything, ahead, behind = slice(None), slice(1, None), slice(None, -1)
    # (heard from, the opposite direction, receivers, senders)
    links = (
        (0, 1, (everything, ahead), (everything, behind)),
        (1, 0, (everything, behind), (everything, ahead)),
        (2, 3, (ahead, everything), (behind, everything)),
        (3, 2, (behind, everything), (ahead, everything)),
    )
    for direction, opposite, receivers, senders in links:
        # A sender leaves out what it heard from the receiver itself.
        said = total[(..., *senders)] - messages[opposite][(..., *senders)]
        heard[direction][(..., *receivers)] = _message(said, base[receivers] - base[senders], step, energy)
    return heard


def _message(
    said: NDArray[np.float32], shift: NDArray[np.int32], step: float, energy: _Energy
) -> NDArray[np.float32]:
    """Least cost to the sender of every label of the receiver; ``shift`` is between the centres of their labels."""
    slope = np.float32(energy.smoothness * step)
    least = said.min(axis=(0, 1))
    for axis, component in ((0, 1), (1, 0)):
        labels_first = np.moveaxis(said, axis, 0)
        _distance_transform(labels_first, slope)
        _shift_labels(labels_first, shift[:, :, component], slope)
    np.minimum(said, least + np.float32(energy.smooth_truncation), out=said)
    said -= said.min(axis=(0, 1))
    return said


def _distance_transform(cost: NDArray[np.float32], slope: np.float32) -> None:
    """Lower envelope, in place, of cones of the given slope along the first axis: one pass forward, one back."""
    for label in range(1, SIDE):
        np.minimum(cost[label], cost[label - 1] + slope, out=cost[label])
    for label in range(SIDE - 2, -1, -1):
        np.minimum(cost[label], cost[label + 1] + slope, out=cost[label])


def _shift_labels(envelope: NDArray[np.float32], shift: NDArray[np.int32], slope: np.float32) -> None:
    """Read the envelope at the receiver's labels, in place; beyond the sender's labels it rises with its slope.

    Only where the two have different labels: that is at few pixels, and reading by index is slow.
    """
    y, x = np.nonzero(shift)
    wanted = np.arange(SIDE, dtype=np.int32)[:, np.newaxis] + shift[y, x]
    index = np.clip(wanted, 0, SIDE - 1)
    beyond = slope * np.abs(wanted - index).astype(np.float32)
    part = envelope[:, :, y, x]
    read = np.take_along_axis(part, index[:, np.newaxis, :], axis=0)
    envelope[:, :, y, x] = read + beyond[:, np.newaxis, :]
