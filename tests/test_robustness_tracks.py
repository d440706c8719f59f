"""Tracks that go as no track should: nothing but InputError leaves `update`, whatever is on the frames.

Objects that are gone as soon as they were drawn and come back elsewhere, boxes of four pixels and boxes as large as
the frame, blank frames, other scenes, cameras that jump. ``python -m benchmarks.fuzz tracks`` makes 10,000.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from hs_tracker_cv import MultiTrackerHS_create, TrackerHS, TrackerHS_Params
from tests.test_robustness import examples, in_time

SIZES = [(48, 64), (48, 64), (90, 120), (33, 47), (12, 14), (6, 90), (90, 6)]
SURFACES = ("texture", "noise", "flat", "stripes", "dots")
EVENTS = ("seen", "gone", "elsewhere", "jump", "black", "white", "gray", "noise", "another scene", "freeze", "dark")

Picture = NDArray[np.float32]
Roi = tuple[float, float, float, float]


class Story(NamedTuple):
    """A video and who tracks what in it."""

    size: tuple[int, int]
    channels: int
    dtype: str
    ground: str
    surface: str
    contrast: float
    seed: int
    roi: Roi
    velocity: tuple[float, float]
    growth: float
    camera: float
    noise: float
    events: list[tuple[str, int]]
    mode: str
    rotation: bool


@st.composite
def stories(draw: st.DrawFn) -> Story:
    """Videos of up to forty frames."""
    height, width = size = draw(st.sampled_from(SIZES))
    w, h = draw(st.floats(4, width)), draw(st.floats(4, height))
    if draw(st.booleans()):  # as small as a box may be, or as large
        w, h = draw(st.sampled_from([(4.0, 4.0), (float(width), float(height)), (4.0, h), (w, 4.0)]))
    # Up to a part beyond the frame, of which at least 4 px must be inside.
    roi = draw(st.floats(4 - w, width - 4)), draw(st.floats(4 - h, height - 4)), w, h
    return Story(
        size=size,
        channels=draw(st.sampled_from([1, 3])),
        dtype=draw(st.sampled_from(["uint8", "uint8", "uint16", "float32"])),
        ground=draw(st.sampled_from(SURFACES)),
        surface=draw(st.sampled_from(SURFACES)),
        contrast=draw(st.sampled_from([1.0, 1.0, 0.1, 0.0])),
        seed=draw(st.integers(0, 2**32 - 1)),
        roi=roi,
        velocity=(draw(st.floats(-9, 9)), draw(st.floats(-9, 9))),
        growth=draw(st.sampled_from([1.0, 1.0, 1.05, 0.95, 1.3, 0.6])),
        camera=draw(st.sampled_from([0.0, 0.0, 1.0, 12.0])),
        noise=draw(st.sampled_from([0.0, 1.0, 10.0])),
        events=draw(st.lists(st.tuples(st.sampled_from(EVENTS), st.integers(1, 9)), min_size=1, max_size=6)),
        mode=draw(st.sampled_from(["auto", "auto", "segmentation", "patch_tracker"])),
        rotation=draw(st.booleans()),
    )


def surface(kind: str, height: int, width: int, rng: np.random.Generator) -> Picture:
    """A picture (height, width, 3) of one kind, 0–255."""
    if kind == "flat":
        return np.full((height, width, 3), rng.integers(0, 256, 3), np.float32)
    if kind == "stripes":
        rows = np.arange(height, dtype=np.float32)[:, np.newaxis, np.newaxis]
        return np.broadcast_to(np.float32(127.5) * (1 + np.sin(rows)), (height, width, 3)).astype(np.float32)
    if kind == "dots":
        return np.where(rng.random((height, width, 1)) < 0.02, 255.0, rng.integers(0, 200, 3)).astype(np.float32)
    noise = rng.uniform(0, 255, (height, width, 3)).astype(np.float32)
    if kind == "noise":
        return noise
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.0)
    return np.clip((smooth - 127.5) * 4 + 127.5, 0, 255).astype(np.float32)


def frames_of(story: Story) -> list[NDArray[Any]]:
    """The frames of a story; the first shows the object in its box."""
    rng = np.random.default_rng(story.seed)
    height, width = story.size
    room = 30  # the camera sees a part of a larger ground
    ground = surface(story.ground, height + 2 * room, width + 2 * room, rng)
    x, y, w, h = story.roi
    face = surface(story.surface, max(round(h), 1), max(round(w), 1), rng)
    face = 127.5 + story.contrast * (face - 127.5)
    events = [("seen", 1), *story.events]
    frames: list[Picture] = []
    for event, count in events:
        if event == "elsewhere":
            x, y = rng.uniform(-w, width), rng.uniform(-h, height)
        if event == "jump":
            x, y = x + rng.uniform(-3, 3) * w, y + rng.uniform(-3, 3) * h
        for _ in range(count):
            if event in ("black", "white", "gray", "noise", "another scene", "freeze"):
                frames.append(disturbed(event, frames, story, rng))
                continue
            dx, dy = np.rint(rng.uniform(-1, 1, 2) * min(story.camera, room)).astype(int)
            frame = ground[room + dy : room + dy + height, room + dx : room + dx + width].copy()
            if event != "gone":
                paint(frame, face, x - dx, y - dy)
            frames.append(frame * np.float32(0.1) if event == "dark" else frame)
            x, y = x + story.velocity[0], y + story.velocity[1]
            w, h = (min(max(side * story.growth, 1.0), 200.0) for side in (w, h))
            face = cv2.resize(face, (max(round(w), 1), max(round(h), 1)), interpolation=cv2.INTER_AREA)
    return [finished(frame, story, rng) for frame in frames]


def disturbed(event: str, frames: list[Picture], story: Story, rng: np.random.Generator) -> Picture:
    """A frame that shows nothing of the scene, or the last one again."""
    if event == "freeze":
        return frames[-1]
    if event in ("noise", "another scene"):
        return surface("noise" if event == "noise" else "texture", *story.size, rng)
    return np.full((*story.size, 3), {"black": 0.0, "white": 255.0, "gray": 128.0}[event], np.float32)


def paint(frame: Picture, face: Picture, x: float, y: float) -> None:
    """Put a picture into a frame, as far as it lies inside."""
    height, width = face.shape[:2]
    left, top = round(x), round(y)
    x0, y0, x1, y1 = max(left, 0), max(top, 0), min(left + width, frame.shape[1]), min(top + height, frame.shape[0])
    if x1 > x0 and y1 > y0:
        frame[y0:y1, x0:x1] = face[y0 - top : y1 - top, x0 - left : x1 - left]


def finished(frame: Picture, story: Story, rng: np.random.Generator) -> NDArray[Any]:
    """A frame of the story's kind: noisy, gray or in colours, in its number type."""
    noisy = np.clip(frame + rng.normal(0, story.noise, frame.shape), 0, 255)
    if story.channels == 1:
        noisy = noisy[:, :, 0]
    return (noisy * {"uint8": 1.0, "uint16": 257.0, "float32": 1 / 255}[story.dtype]).astype(story.dtype)


@examples(18)
@given(story=stories())
def test_every_frame_of_every_story_is_answered(story: Story) -> None:
    """No exception and no answer without sense; several objects of one video are answered as each is alone."""
    frames = frames_of(story)
    parameters = TrackerHS_Params(mode=story.mode, rotation=story.rotation)
    alone, multi = TrackerHS(parameters), MultiTrackerHS_create()
    alone.init(frames[0], story.roi)
    assert multi.add(TrackerHS(parameters), frames[0], story.roi) == 1
    assert multi.add(TrackerHS(), frames[0], (0, 0, *story.size[::-1])) == 2
    for frame in frames[1:]:
        ok, box = in_time(alone, lambda one, frame=frame: one.update(frame))
        every, boxes = multi.update(frame)
        assert boxes.shape == (2, 4)
        assert tuple(boxes[0]) == box
        assert ok or not every
        assert (box == (0, 0, 0, 0)) == (not ok)
        assert 0.0 <= alone.getTrackingScore() <= 1.0
        assert alone.box is not None
        assert np.isfinite(alone.box).all()
