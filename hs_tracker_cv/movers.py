"""What moves in a video, found over several frames: it must have been displaced, and not changed in its place.

Each frame is compared with those just before it, all taken to one camera and one light. Where something has changed,
the flow of every pair of frames, chained, proposes how it has moved: one shift, turn and zoom, which the chained
displacements there agree on. Then every pixel around is asked what explains it better in all of those frames, that
motion or standing still. A digit that changes, a lamp that blinks or a screen is explained by neither.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import Affine
from .common_motion import (
    DISPLACED,
    FEWEST,
    Explained,
    agreeing,
    explained,
    grown,
    is_plausible,
    is_strip,
    joined,
    refined,
    shift,
    similarity,
)  # fmt: skip
from .comparison import Comparison, DetectorParams, Reduced, changed, compare, is_restless, reduced
from .detection import DetectionFields, MotionDetector, components
from .frames import Frame, VideoFormat, as_frame, fixed_errstate, next_frame
from .geometry import Box, box_from_mask, iou
from .history import Area, History

__all__ = ["Mover", "MoverFinder"]

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

HISTORY = 10
"""Frames looked back on."""
MOST_BACK = 8
"""Most frames between those compared."""
GLANCE = 4
"""Frames back at which slow change is looked for."""
FAR_ENOUGH = 4.0
"""Displacement, lattice px, at which no earlier frame is asked."""
RESTLESS_FOR = 30
"""Frames for which a camera that has moved is taken to move."""
AREAS = 6
"""Most places of a frame at which motions are proposed."""
PROPOSALS = 2
"""Most motions proposed at one place."""
POINTS = 300
"""Most points of a place."""
SMALLEST = 3.0
"""Smallest side of a mover, lattice px."""
CONFIRM = 3
"""Frames in which a mover must have been found."""
STRAIGHT = 0.7
"""Share of its path that a mover has got on by."""
OVERLAP = 0.4
"""IoU of a mover with where it was expected."""
PATIENCE = 4
"""Frames that a mover is remembered when it is not found."""
GROWING = 1.1
"""Growth of the area from frame to frame from which this may not be the whole mover yet."""
MARGIN = 1.5
"""Distance from the border, lattice px, within which a mover is cut by it."""
WAIT_BORDER = 15
"""Frames after which a mover at the border, which grows no longer, is taken for all that will be seen of it."""
ERROR = 0.5
"""Share of the way a mover has come by which its place may differ from where its motions led."""
SLACK = (1.0, 0.05)
"""What may be added to that: lattice px, and a share of width and height together."""
NEARBY = 13
"""Side, lattice px, of the square by which changed pixels are grown to one place of the frame."""
LEAST_PLACE = 9.0
"""Smallest place of the frame that is looked at, lattice px²."""
AROUND = 4.0
"""Lattice px round a mover within which points are taken to be its own."""
WINDOW = 0.25
"""Share of a place's longer side by which it is grown to look for the mover."""
DOUBLE = 0.5
"""Share of the smaller box in common from which two are one mover."""
REACHED = 0.8
"""Quantile of the displacements that tells how far a thing has gone."""


@dataclass(frozen=True)
class Mover:
    """Something that moves.

    Parameters
    ----------
    box : Box
        In the last frame, px.
    whole : bool
        Whether all of it is in the picture: it is off the border, or has stopped growing there.
    pace : tuple of float
        (u, v), px per frame, beyond the camera's motion.
    """

    box: Box
    whole: bool
    pace: tuple[float, float]


@dataclass
class _Sight:
    """A mover as found in the last frame in which it was, on the lattice.

    `pace` is its motion in that frame: shift, turn and growth at its rim, lattice px; `travelled` their sum since it
    was first found, in box `start`, and `path` that of their lengths.
    """

    box: Box
    area: int
    motion: Affine
    pace: NDArray[np.float64]
    start: Box
    travelled: NDArray[np.float64] = field(default_factory=lambda: np.zeros(4))
    path: float = 0.0
    seen: int = 1
    missed: int = 0
    at_border: int = 0
    steady: bool = False
    record: int = field(init=False)

    def __post_init__(self) -> None:
        """Begin the record of its area, from which it is known to grow on at the border."""
        self.record = self.area

    def continues(self, before: _Sight) -> None:
        """Take over what is known from an earlier sight of the same mover."""
        frames = 1 + before.missed
        self.start = before.start
        self.travelled = before.travelled + self.pace * frames
        self.path = before.path + float(np.linalg.norm(self.pace)) * frames
        self.seen = before.seen + 1
        self.steady = self.area < GROWING * before.area
        if self.area < GROWING * before.record:
            self.record = before.record
            self.at_border += before.at_border if self.at_border else 0

    def expected(self) -> Box:
        """Where it is in the next frame."""
        return self.box.moved(*(self.pace[:2] * (1 + self.missed)))

    def is_sure(self) -> bool:
        """Whether it has gone on moving since it was first found, the same way, and its place with it."""
        far = float(np.linalg.norm(self.travelled))
        if self.missed or self.seen < CONFIRM or far < DISPLACED or far < STRAIGHT * self.path:
            return False
        error = np.subtract(self.box.centre, self.start.centre) - self.travelled[:2]
        slack = SLACK[0] + SLACK[1] * (self.box.w + self.box.h)
        return float(np.hypot(*error)) < ERROR * float(np.hypot(*self.travelled[:2])) + slack

    def is_whole(self) -> bool:
        """Whether all of it is in the picture."""
        return self.steady and (self.at_border == 0 or self.at_border > WAIT_BORDER)


class MoverFinder:
    """Watch frames for what moves.

    Parameters
    ----------
    params : DetectorParams, optional
    """

    def __init__(self, params: DetectorParams | None = None) -> None:
        self._detector = MotionDetector(params)
        self._history = History(HISTORY, self._detector.flow_of)
        self._video: VideoFormat | None = None
        self._last: Reduced | None = None
        self._pair: Comparison | None = None
        self._restless = 0
        self._sights: list[_Sight] = []

    @property
    def fields(self) -> DetectionFields | None:
        """What the detector makes of the last pair of frames; None before there is a pair."""
        return None if self._pair is None else self._detector.fields_of(self._pair)

    def check(self, frame: Any) -> Frame:
        """Raise what `update` would raise for a frame; nothing changes."""
        return as_frame(frame) if self._video is None else next_frame(frame, self._video)

    @fixed_errstate
    def update(self, frame: Any) -> list[Mover]:
        """Take in the next frame.

        Returns
        -------
        list of Mover
            Those that are sure, the largest first.

        Raises
        ------
        InputError
            If the frame cannot be used, or is not of the size of those before.
        """
        checked = self.check(frame)
        self._video = self._video or checked.format
        before, self._last = self._last, reduced(checked, self._detector.params)
        if before is None:
            return []
        self._pair = self._compared(before, self._last)
        if self._pair.motion is None:  # after a cut, or where the camera's motion cannot be understood
            self._history.clear()
            self._sights = []
            return []
        self._history.take_in(self._pair)
        parts = self._joined(_distinct(list(self._found(self._pair))), self._pair.after.gray)
        sights = [self._sight(part) for part in parts if not is_strip(part)]
        self._sights = self._matched([sight for sight in sights if sight is not None])
        movers = [self._mover(sight) for sight in self._sights if sight.is_sure()]
        return sorted(movers, key=lambda mover: mover.box.area, reverse=True)

    def _compared(self, before: Reduced, after: Reduced) -> Comparison:
        params = self._detector.params
        self._restless = max(self._restless - 1, 0)
        pair = compare(before, after, params, camera_moves=self._restless > 0)
        if not self._restless and len(self._history) >= GLANCE and pair.motion is not None:
            # A camera that moves slowly shows after several frames only; what they were taken for is wrong then.
            old = self._history.view(GLANCE - 1, _everywhere(after))
            if is_restless(old, after.gray, after.gray - old, after.step, params):
                self._restless = RESTLESS_FOR
                self._history.clear()
                self._sights = []
                return compare(before, after, params, camera_moves=True)
        return pair

    def _found(self, pair: Comparison) -> Iterator[Explained]:
        """Movers at the places of the frame where something has changed."""
        gray = pair.after.gray
        active = pair.seeds
        if len(self._history) > 1:
            old = self._history.view(min(GLANCE, len(self._history)), _everywhere(pair.after))
            active = active | changed(old, gray, gray - old, pair.after.step, self._detector.params)
        near = cv2.dilate(active.astype(np.uint8), np.ones((NEARBY, NEARBY), np.uint8)) > 0
        places = [(np.count_nonzero(part & active[area]), area, part) for area, part in components(near, LEAST_PLACE)]
        for _, area, part in sorted(places, key=lambda place: place[0], reverse=True)[:AREAS]:
            yield from self._found_at(area, part, gray)

    def _found_at(self, area: Area, part: Mask, gray: Plane) -> Iterator[Explained]:
        """Movers at one place of the frame."""
        rows, columns = np.nonzero(part)
        if len(rows) > POINTS:
            chosen = np.linspace(0, len(rows) - 1, POINTS).astype(int)
            rows, columns = rows[chosen], columns[chosen]
        points = np.column_stack([columns + area[1].start, rows + area[0].start]).astype(np.float32)
        displacements = self._history.traced(points)[:MOST_BACK]
        left = np.ones(len(points), bool)
        for _ in range(PROPOSALS):
            steps = _far_enough([displacement[left] for displacement in displacements])
            if steps is None:
                return
            left_now = left & (np.hypot(*displacements[steps - 1].T) > DISPLACED / 2)
            common = agreeing((points - displacements[steps - 1])[left_now], points[left_now])
            if common is None:
                return
            together = np.flatnonzero(left_now)[common]
            left[together] = False
            found = self._asked(area, points[together], [each[together] for each in displacements], steps, gray)
            if found is not None:
                left &= ~_within(points, _box(found).grown(AROUND))
                yield found

    def _joined(self, parts: list[Explained], gray: Plane) -> list[Explained]:
        """Take parts that are one thing together, the strongest first."""
        whole: list[Explained] = []
        for part in parts:
            for index, other in enumerate(whole):
                both = joined(self._history, gray, other, part)
                if both is not None:
                    whole[index] = both
                    break
            else:
                whole.append(part)
        return whole

    def _asked(
        self, area: Area, points: Plane, displacements: list[Plane], frames: int, gray: Plane
    ) -> Explained | None:
        """What follows the common motion of some points, taken for a shift, or for turn and zoom too."""
        steps = sorted({max(frames // 2, 1), frames})
        window = grown(area, gray.shape, WINDOW)
        best: Explained | None = None
        for fit in (shift, similarity):
            motions = [fit(points - displacements[step - 1], points) for step in steps]
            if not all(is_plausible(motion) for motion in motions):
                continue
            found = explained(self._history, gray, window, steps, motions)
            if found is not None and (best is None or found.gain > best.gain):
                best = found
        return None if best is None else refined(self._history, gray, best)

    def _sight(self, found: Explained) -> _Sight | None:
        box = _box(found)
        if min(box.w, box.h) < SMALLEST:
            return None
        height, width = self._history.last_flow().shape[:2]
        before = _taken_back(box, found.motion)
        cut = any(
            each.x < MARGIN or each.y < MARGIN or each.right > width - MARGIN or each.bottom > height - MARGIN
            for each in (box, before)
        )
        # What reaches from border to border is the scene, and no thing in it.
        if (box.x < MARGIN and box.right > width - MARGIN) or (box.y < MARGIN and box.bottom > height - MARGIN):
            return None
        return _Sight(
            box, int(np.count_nonzero(found.mask)), found.motion, self._pace(found), box, at_border=int(cut)
        )

    def _pace(self, found: Explained) -> NDArray[np.float64]:
        """Motion in the last pair of frames: shift, turn and growth at the rim, lattice px."""
        rows, columns = np.nonzero(found.mask)
        flow = self._history.last_flow()[found.area][found.mask].astype(np.float64)
        centred = np.column_stack([columns - columns.mean(), rows - rows.mean()])
        size = max(float((centred**2).sum()), 1e-6)
        turn = float((centred[:, 0] * flow[:, 1] - centred[:, 1] * flow[:, 0]).sum()) / size
        growth = float((centred * flow).sum()) / size
        radius = float(np.sqrt(size / len(rows)))
        return np.array([*flow.mean(axis=0), turn * radius, growth * radius])

    def _matched(self, sights: list[_Sight]) -> list[_Sight]:
        """Take new sights for further ones of those remembered, where they are as far on as these have moved."""
        remembered = list(self._sights)
        for sight in sights:
            overlaps = [iou(before.expected(), sight.box) for before in remembered]
            if overlaps and max(overlaps) > OVERLAP:
                sight.continues(remembered.pop(int(np.argmax(overlaps))))
        for before in remembered:
            before.missed += 1
        return sights + [before for before in remembered if before.missed <= PATIENCE]

    def _mover(self, sight: _Sight) -> Mover:
        assert self._last is not None
        height, width = self._last.gray.shape
        sx, sy = self._last.width / width, self._last.height / height
        box = Box(sight.box.x * sx, sight.box.y * sy, sight.box.w * sx, sight.box.h * sy)
        u, v = (float(value) for value in sight.pace[:2])
        return Mover(box, sight.is_whole(), (u * sx, v * sy))


def _box(found: Explained) -> Box:
    box = box_from_mask(found.mask)
    assert box is not None
    return box.moved(found.area[1].start, found.area[0].start)


def _distinct(found: list[Explained]) -> list[Explained]:
    """Drop what was found twice, where it explains less; the strongest first."""
    kept: list[Explained] = []
    for part in sorted(found, key=lambda each: each.gain, reverse=True):
        box = _box(part)
        if all(box.intersection(_box(other)).area < DOUBLE * min(box.area, _box(other).area) for other in kept):
            kept.append(part)
    return kept


def _everywhere(frame: Reduced) -> Area:
    height, width = frame.gray.shape
    return slice(0, height), slice(0, width)


def _far_enough(displacements: list[Plane]) -> int | None:
    """How many frames to look back until what moves has gone far enough; None where nothing has."""
    reach = 0.0
    for frames, displacement in enumerate(displacements, 1):
        if len(displacement) < FEWEST:
            return None
        reach = float(np.quantile(np.hypot(*displacement.T), REACHED))
        if frames > 1 and reach > FAR_ENOUGH:
            return frames
    return len(displacements) if len(displacements) > 1 and reach > DISPLACED else None


def _taken_back(box: Box, motion: Affine) -> Box:
    """Where a box was before a motion."""
    corners = np.array([(box.x, box.y), (box.right, box.y), (box.x, box.bottom), (box.right, box.bottom)])
    places = (corners - motion[:, 2]) @ np.linalg.inv(motion[:, :2]).T
    (left, top), (right, bottom) = places.min(axis=0), places.max(axis=0)
    return Box.from_edges(float(left), float(top), float(right), float(bottom))


def _within(points: Plane, box: Box) -> Mask:
    x, y = points.T
    return np.asarray((x >= box.x) & (x < box.right) & (y >= box.y) & (y < box.bottom), bool)
