"""Ways for the target of a draft, laid so that it stays in the frame."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from .draft import Dice, Draft, Span
from .spec import Path

__all__ = ["WAYS", "random_point"]


def random_point(dice: Dice, room: NDArray[np.float64]) -> Span:
    """Draw a point of a room, given as low x, y, high x, y."""
    x0, y0, x1, y1 = room.tolist()
    # A room without width may have lost the last bit of it.
    return dice.uniform(x0, max(x0, x1)), dice.uniform(y0, max(y0, y1))


def _straight_way(draft: Draft, room: NDArray[np.float64], length: float) -> Path:
    """Straight line of that length if there is one in the room, else there and back on a long one."""
    start, end, longest = (0.0, 0.0), (0.0, 0.0), -1.0
    for _ in range(30):
        first, angle = random_point(draft.dice, room), draft.dice.uniform(0.0, 2.0 * math.pi)
        aim = np.array(first) + length * np.array([math.cos(angle), math.sin(angle)])
        last = np.clip(aim, room[:2], room[2:]).round(2)
        far = math.dist(first, last)
        if far > longest:
            start, end, longest = first, (float(last[0]), float(last[1])), far
        if far >= 0.999 * length:
            break
    if length > 1.3 * longest:
        return Path("bounce", start, end, cycles=round(length / (2.0 * longest), 3))
    return Path(draft.dice.pick(("line", "line", "ease")), start, end)


def _weaving_way(draft: Draft, room: NDArray[np.float64], length: float) -> Path:
    amplitude = round(min(draft.dice.uniform(6, 24) * draft.unit, float((room[2:] - room[:2]).min()) / 4.0), 2)
    straight = _straight_way(draft, room + np.array([amplitude, amplitude, -amplitude, -amplitude]), length)
    cycles = draft.dice.uniform(0.8, 2.0)
    return Path("weave", straight.start, straight.end, amplitude, cycles)


def _orbiting_way(draft: Draft, room: NDArray[np.float64], length: float) -> Path:
    dice, half = draft.dice, (room[2:] - room[:2]) / 2.0
    rx, ry = (dice.uniform(0.45, 1.0) * value for value in half.tolist())
    x, y = random_point(dice, room + np.array([rx, ry, -rx, -ry]))
    perimeter = math.pi * (3.0 * (rx + ry) - math.sqrt((3.0 * rx + ry) * (rx + 3.0 * ry)))
    corner = (round(x + rx * dice.sign(), 2), round(y + ry * dice.sign(), 2))
    return Path("orbit", (x, y), corner, cycles=round(length / perimeter, 3))


def _bouncing_way(draft: Draft, room: NDArray[np.float64], length: float) -> Path:
    """As a ball between four walls."""
    dice = draft.dice
    place = np.array(random_point(dice, room))
    angle = dice.uniform(0.15, 0.5 * math.pi - 0.15)
    heading = np.array([math.cos(angle) * dice.sign(), math.sin(angle) * dice.sign()])
    knots, gone = [(0.0, float(place[0]), float(place[1]))], 0.0
    while gone < length:
        wall = np.where(heading > 0, room[2:], room[:2])
        reach = (wall - place) / heading
        axis = int(np.argmin(reach))
        step = min(float(reach[axis]), length - gone)
        place, gone = place + step * heading, gone + step
        heading[axis] = -heading[axis]
        x, y = np.clip(place, room[:2], room[2:]).round(2).tolist()
        knots.append((min(round(gone / length, 5), 1.0), x, y))
    return Path("knots", knots=tuple(knots))


def _way_across(draft: Draft, room: NDArray[np.float64], length: float) -> Path:
    """From side to side, at least as far as it takes to pass the pole."""
    dice = draft.dice
    wide = float(room[2] - room[0])
    far = min(max(length, 2.0 * draft.half_extent()[0] + draft.pole + 20.0), wide)
    left = round(float(room[0] + dice.share() * (wide - far)), 2)
    ends = ((left, dice.uniform(room[1], room[3])), (round(left + far, 2), dice.uniform(room[1], room[3])))
    if draft.shape in ("walker", "car"):
        # They keep to the floor, roll without slipping, and look where they go.
        ends = (ends[0], (ends[1][0], ends[0][1]))
        draft.gait = round(draft.gait * far / length, 4)
    draft.mirror = dice.chance(0.5)
    return Path("line", *(ends[::-1] if draft.mirror else ends))


def _displaced_way(draft: Draft, room: NDArray[np.float64], length: float) -> Path:
    """From side to side, but up or down in the middle, behind what stands there."""
    across = _way_across(draft, room, length)
    (x0, y0), (x1, y1) = across.start, across.end
    middle = round((x0 + x1) / 2.0, 2)
    return Path("knots", knots=((0.0, x0, y0), (0.42, middle, y0), (0.58, middle, y1), (1.0, x1, y1)))


def _way_out(draft: Draft, room: NDArray[np.float64], length: float) -> Path:
    """Out of the frame on one side, in again there or on the other."""
    dice, half = draft.dice, draft.half_extent()[0] + 6.0
    outside = (-half, draft.frame[0] + half)
    out, back = (outside[dice.whole(0, 2)] for _ in range(2))
    first, last, high, low = (random_point(dice, room) for _ in range(4))
    gone = dice.uniform(0.3, 0.45)
    knots = (
        (0.0, *first),
        (gone, round(out, 2), high[1]),
        (round(gone + dice.uniform(0.08, 0.2), 2), round(back, 2), low[1]),
        (1.0, *last),
    )
    return Path("knots", knots=knots)


def _no_way(draft: Draft, room: NDArray[np.float64], length: float) -> Path:
    return Path("hold", random_point(draft.dice, room))


WAYS: dict[str, Callable[[Draft, NDArray[np.float64], float], Path]] = {
    "hold": _no_way,
    "straight": _straight_way,
    "weave": _weaving_way,
    "orbit": _orbiting_way,
    "bouncing": _bouncing_way,
    "across": _way_across,
    "displaced": _displaced_way,
    "out": _way_out,
}
"""Name -> (draft, room for the centre, length in px) -> path."""
