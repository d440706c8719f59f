"""Adapters for other people's harnesses, with stand-ins for the packages that they are made for."""

from __future__ import annotations

import sys
from collections import namedtuple
from collections.abc import Sequence
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from eval.clients import Follower, got10k, vot
from eval.track import whole_box
from hs_tracker_cv import Box
from hs_tracker_cv.geometry import iou
from tests.conftest import BOX_IOU, moving_square

Frames = list[NDArray[np.uint8]]
Boxes = list[tuple[int, int, int, int]]


@pytest.fixture(scope="module")
def video() -> tuple[Frames, Boxes]:
    """A textured square moving over texture."""
    return moving_square(np.random.default_rng(7))


class _Blinking:
    """Answers with the start box moved on, but for every second frame, which it does not find."""

    def init(self, image: Any, box: Any) -> None:
        self.box, self.frame = box, 0

    def update(self, image: Any) -> tuple[bool, tuple[int, int, int, int]]:
        self.frame += 1
        x, y, w, h = self.box
        return (False, (0, 0, 0, 0)) if self.frame % 2 == 0 else (True, (x + self.frame, y, w, h))


@pytest.fixture
def blinking(monkeypatch: pytest.MonkeyPatch) -> str:
    """Reference of a tracker that is not of this project."""
    module = ModuleType("blinking_tracker")
    module.__spec__ = SimpleNamespace(submodule_search_locations=None, origin=None)  # type: ignore[assignment]
    module.make = _Blinking  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "blinking_tracker", module)
    return "blinking_tracker:make"


def test_a_lost_object_keeps_its_last_box(video: tuple[Frames, Boxes], blinking: str) -> None:
    """Harnesses want a box for every frame; confidence 0 says that it is an old one. Each init starts anew."""
    follower = Follower(blinking)
    for _ in range(2):
        follower.init(video[0][0], (10.4, 20.0, 30.0, 40.0))
        answers = [follower.update(frame) for frame in video[0][1:5]]
        expected = [((11.0, 20.0, 30.0, 40.0), 1.0), ((11.0, 20.0, 30.0, 40.0), 0.0), ((13.0, 20.0, 30.0, 40.0), 1.0)]
        assert answers[:3] == expected


def test_the_start_box_is_that_of_our_own_runs(video: tuple[Frames, Boxes], blinking: str) -> None:
    """Edges are rounded, here as there, and cut by the frame: one start box, whoever runs the tracker."""
    follower = Follower(blinking)
    for box in ((10.4, 20.3, 30.4, 40.4), (-3.0, 100.5, 20.0, 60.0), (5.0, 5.0, 0.2, 0.3)):
        follower.init(video[0][0], box)
        assert follower._tracker.box == whole_box(box, (160, 120))
    assert whole_box((10.4, 20.3, 30.4, 40.4), (160, 120)) == (10, 20, 31, 41)


@pytest.mark.parametrize("spoilt", ["box", "size"])
def test_what_a_tracker_refuses_is_answered_as_lost(
    spoilt: str, video: tuple[Frames, Boxes], capsys: pytest.CaptureFixture[str]
) -> None:
    """A first box of 3 × 3 px, or pictures that change size, cost their sequence and not the experiment."""
    frames = [frame if spoilt == "box" or index < 2 else frame[:80] for index, frame in enumerate(video[0][:5])]
    box = (30.0, 30.0, 3.0, 3.0) if spoilt == "box" else tuple(map(float, video[1][0]))
    follower = Follower("TrackerHS")
    for _ in range(2):
        follower.init(frames[0], box)
        answers = [follower.update(frame) for frame in frames[1:]]
        refused = answers if spoilt == "box" else answers[1:]
        assert {confidence for _, confidence in refused} == {0.0}
        assert {place for place, _ in refused} == {box if spoilt == "box" else answers[0][0]}
        said = capsys.readouterr().err.splitlines()
        assert len(said) == 1
        assert said[0].startswith("TrackerHS: answered as lost: ")
    follower.init(video[0][0], video[1][0])
    assert follower.update(video[0][1])[1] > 0


@pytest.mark.parametrize("tracker", ["TrackerHS", "MIL"])
@pytest.mark.parametrize("box", [(np.nan, 40.0, 30.0, 30.0), (30.0, 30.0, np.inf, 30.0), (500.0, 500.0, 30.0, 30.0)])
def test_a_first_box_that_is_none_is_answered_as_lost(
    tracker: str, box: Sequence[float], video: tuple[Frames, Boxes], capsys: pytest.CaptureFixture[str]
) -> None:
    """A broken line of their truth: the box goes back as it came, for them to judge."""
    follower = Follower(tracker)
    follower.init(video[0][0], box)
    for frame in video[0][1:3]:
        place, confidence = follower.update(frame)
        np.testing.assert_array_equal(place, box)
        assert confidence == 0.0
    assert capsys.readouterr().err.count("answered as lost: ") == 1


@pytest.mark.parametrize("side", [(1, 60), (3, 3), (4, 4), (2, 9)])
def test_mil_is_kept_from_boxes_at_which_it_hangs(
    side: tuple[int, int], video: tuple[Frames, Boxes], capsys: pytest.CaptureFixture[str]
) -> None:
    """Other people's harnesses have no clock that would end it: the box is refused, and the object lost."""
    follower = Follower("MIL")
    follower.init(video[0][0], (30, 30, *side))
    assert follower.update(video[0][1]) == ((30.0, 30.0, *map(float, side)), 0.0)
    assert "MIL: answered as lost: ValueError: expected a box of at least 20 px" in capsys.readouterr().err


def test_answers_are_read_as_in_our_own_runs(
    video: tuple[Frames, Boxes], blinking: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A rotated box is the box round it; what is none keeps the last one, and the experiment goes on."""
    follower = Follower(blinking)
    boxes = ((5, 5, 15, 5, 15, 20, 5, 20), ((40.0, 30.0), (20.0, 10.0), 0.0), (np.nan,) * 4, (1, 2))
    answers = iter([(True, box) for box in boxes])
    monkeypatch.setattr(_Blinking, "update", lambda self, image: next(answers))
    follower.init(video[0][0], (10.0, 20.0, 30.0, 40.0))
    found = [follower.update(video[0][1]) for _ in range(4)]
    assert found[0] == ((5.0, 5.0, 10.0, 15.0), 1.0)
    assert found[1:] == [((30.0, 25.0, 20.0, 10.0), confidence) for confidence in (1.0, 0.0, 0.0)]
    assert "update returned (True, (1, 2)), expected (ok, (x, y, w, h))" in capsys.readouterr().err


def test_what_sees_the_truth_is_refused() -> None:
    """Nobody hands the truth to the oracle there; MIL is known to differ from run to run."""
    with pytest.raises(ValueError, match="Oracle"):
        Follower("Oracle")
    assert Follower("TrackerHS").deterministic
    assert not Follower("MIL").deterministic


class _Picture:
    """As much of a PIL image as is used: pixels in RGB."""

    def __init__(self, frame: NDArray[np.uint8]) -> None:
        self.frame = frame

    def convert(self, mode: str) -> NDArray[np.uint8]:
        """The pixels themselves, which NumPy takes as it takes an image."""
        assert mode == "RGB"
        return self.frame[:, :, ::-1]


class _ToolkitTracker:
    """The toolkit's base class: a name, whether it is deterministic, and the loop over the images."""

    def __init__(self, name: str, is_deterministic: bool = False) -> None:
        self.name, self.is_deterministic = name, is_deterministic

    def track(self, images: Frames, box: NDArray[np.float64]) -> NDArray[np.float64]:
        """Boxes, shape (T, 4)."""
        boxes = np.zeros((len(images), 4))
        boxes[0] = box
        self.init(_Picture(images[0]), box)  # type: ignore[attr-defined]
        for index, image in enumerate(images[1:], 1):
            boxes[index, :] = self.update(_Picture(image))  # type: ignore[attr-defined]
        return boxes


@pytest.mark.parametrize("first_pixel", [0, 1])
def test_the_got10k_toolkit_gets_a_box_for_every_image(
    first_pixel: int, video: tuple[Frames, Boxes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Boxes follow the object in the toolkit's own numbering of pixels, and are those of cv2's colours."""
    package, trackers = ModuleType("got10k"), ModuleType("got10k.trackers")
    trackers.Tracker = _ToolkitTracker  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "got10k", package)
    monkeypatch.setitem(sys.modules, "got10k.trackers", trackers)
    tracker = got10k.make_tracker("TrackerHS", first_pixel=first_pixel)
    assert (tracker.name, tracker.is_deterministic) == ("TrackerHS", True)
    origin = np.array([first_pixel, first_pixel, 0, 0])
    boxes = tracker.track(video[0], np.array(video[1][0], dtype=float) + origin)
    follower = Follower("TrackerHS")
    follower.init(video[0][0], video[1][0])
    direct = [follower.update(frame)[0] for frame in video[0][1:]]
    np.testing.assert_array_equal(boxes[1:] - origin, direct)
    assert min(iou(Box(*box), Box(*truth)) for box, truth in zip(direct, video[1][1:], strict=True)) > BOX_IOU


_Request = namedtuple("_Request", ["type", "image", "objects", "properties"])


class _Rectangle:
    """A region of TraX."""

    def __init__(self, *bounds: float) -> None:
        self._bounds = bounds

    @classmethod
    def create(cls, x: float, y: float, width: float, height: float) -> _Rectangle:
        """As in TraX."""
        return cls(x, y, width, height)

    def bounds(self) -> tuple[float, ...]:
        """x, y, width, height."""
        return self._bounds


def _trax(requests: list[_Request], answers: list[Any]) -> ModuleType:
    """A stand-in for TraX: a server that is asked what the list says."""

    class Server:
        def __init__(self, regions: list[str], images: list[str], *, tracker_name: str) -> None:
            assert (regions, images) == (["rectangle"], ["path"])
            self.waiting = iter(requests)

        def __enter__(self) -> Server:
            return self

        def __exit__(self, *error: object) -> None:
            answers.append("closed")

        def wait(self) -> _Request:
            return next(self.waiting)

        def status(self, objects: list[Any]) -> None:
            answers.append(objects)

    module = ModuleType("trax")
    module.__dict__.update(
        Server=Server,
        Rectangle=_Rectangle,
        Region=SimpleNamespace(RECTANGLE="rectangle"),
        Image=SimpleNamespace(PATH="path"),
        ImageChannel=SimpleNamespace(COLOR="color"),
        TraxStatus=SimpleNamespace(INITIALIZE="initialize", FRAME="frame", QUIT="quit"),
    )
    return module


def test_the_vot_toolkit_gets_a_box_and_a_confidence(
    video: tuple[Frames, Boxes], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every request but the last is answered, a new start included, with a rectangle on the object."""
    asked, truths = [], []
    for index in (0, 1, 2, 3, 0, 1):
        path = tmp_path / f"{index}.png"
        cv2.imwrite(str(path), video[0][index])
        image = {"color": SimpleNamespace(path=lambda path=path: str(path))}
        if index == 0:
            asked.append(_Request("initialize", image, [(_Rectangle(*video[1][0]), {})], {}))
        else:
            asked.append(_Request("frame", image, None, {}))
        truths.append(video[1][index])
    answers: list[Any] = []
    monkeypatch.setitem(sys.modules, "trax", _trax([*asked, _Request("quit", None, None, {})], answers))
    monkeypatch.setattr(sys, "argv", ["vot", "TrackerHS"])
    assert vot.main() == 0
    assert answers.pop() == "closed"
    assert len(answers) == len(asked)
    for ((region, properties),), truth in zip(answers, truths, strict=True):
        assert iou(Box(*region.bounds()), Box(*truth)) > BOX_IOU
        assert 0.0 <= properties["confidence"] <= 1.0
    assert [region.bounds() for ((region, _),) in answers[:2]] == [region.bounds() for ((region, _),) in answers[4:]]


def test_an_image_that_the_toolkit_names_and_has_not_got_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The session ends with the reason."""
    image = {"color": SimpleNamespace(path=lambda: str(tmp_path / "absent.png"))}
    request = _Request("initialize", image, [(_Rectangle(1, 2, 20, 20), {})], {})
    monkeypatch.setitem(sys.modules, "trax", _trax([request], []))
    with pytest.raises(ValueError, match=r"cannot read the frame .*absent\.png"):
        vot.serve()
