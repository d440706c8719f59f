"""What the page does, without a page: frames by number, tracks, panels, exports."""

from __future__ import annotations

import contextlib
import csv
import io
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import InputError, TrackerHS_Params, cli
from hs_tracker_cv.app import demo as demonstration
from hs_tracker_cv.app.export import overlay_webm, panels_png, snippet, table_csv
from hs_tracker_cv.app.pictures import LAYERS, TITLES
from hs_tracker_cv.app.rivals import rivals
from hs_tracker_cv.app.session import Moment, Session
from hs_tracker_cv.app.sources import CAMERA, DEMO, Sources
from hs_tracker_cv.app.store import FrameStore
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.movers import MoverFinder
from hs_tracker_cv.stages import StageParams
from hs_tracker_cv.video import VideoError, VideoSink, VideoSource, open_source
from tests.conftest import moving_square

COUNT = 14


@pytest.fixture
def square(tmp_path: Path, rng: np.random.Generator) -> tuple[Path, list[Box]]:
    """A lossless video of a square that moves, and its boxes."""
    frames, boxes = moving_square(rng, count=COUNT)
    path = tmp_path / "square.mkv"
    with VideoSink(path, 25.0) as sink:
        for frame in frames:
            sink.write(frame)
    return path, [Box(*box) for box in boxes]


@pytest.fixture
def session(square: tuple[Path, list[Box]]) -> Iterator[Session]:
    """A session at the first frame of that video."""
    fresh = Session(Sources(str(square[0])))
    fresh.open("square.mkv")
    yield fresh
    fresh.close()


def _now(session: Session) -> Moment:
    """What a viewer of the page sees now."""
    moment = session.current()
    assert moment is not None
    return moment


def _forget(session: Session) -> None:
    """Without objects, back at where the first was boxed: what the page does for "r"."""
    session.go_to(session.forget())


def _numbered(count: int, *, broken: bool = False, live: bool = False) -> VideoSource:
    """A source whose frames hold their number; it may break after the last."""

    def frames() -> Iterator[NDArray[np.uint8]]:
        for index in range(count):
            yield np.full((8, 8, 3), index, np.uint8)
        if broken:
            raise VideoError("numbers: ends early")

    announced = None if live else count + 5
    return VideoSource("numbers", 25.0, announced, np.zeros((8, 8, 3), np.uint8), frames())


@pytest.mark.parametrize("room", [2, 5, 100])
def test_frames_are_had_in_any_order(rng: np.random.Generator, room: int) -> None:
    """Whatever is kept and whatever has to be decoded again."""
    store = FrameStore(lambda: _numbered(20), budget=room * 8 * 8 * 3)
    assert store.count == 25
    for index in rng.integers(0, 20, 60):
        assert int(store.get(int(index))[0, 0, 0]) == index
    assert store.get(40) is None
    assert store.count == 20
    assert store.ended
    assert int(store.get(0)[0, 0, 0]) == 0
    store.close()


def test_a_camera_has_no_way_back_beyond_what_is_kept() -> None:
    """It says so, and goes on."""
    store = FrameStore(lambda: _numbered(20, live=True), budget=3 * 192)
    assert int(store.get(9)[0, 0, 0]) == 9
    assert int(store.get(7)[0, 0, 0]) == 7
    with pytest.raises(VideoError, match="frame 6 is no longer kept"):
        store.get(6)
    assert int(store.get(10)[0, 0, 0]) == 10


def test_a_source_that_breaks_keeps_what_came_before() -> None:
    """The error comes once; the frames before it are there, and the number of frames is known."""
    store = FrameStore(lambda: _numbered(4, broken=True))
    with pytest.raises(VideoError, match="ends early"):
        store.get(9)
    assert store.count == 4
    assert int(store.get(3)[0, 0, 0]) == 3
    assert store.get(4) is None


def test_the_video_is_walked_both_ways(session: Session, square: tuple[Path, list[Box]]) -> None:
    """Before a box is drawn: forwards, back, far, and not beyond the ends."""
    frames = list(open_source(square[0]).frames)
    for target, reached in ((1, 1), (5, 5), (4, 4), (0, 0), (13, 13), (99, 13), (-3, 0), (7, 7)):
        assert session.go_to(target)
        assert session.index == reached
        np.testing.assert_array_equal(session.frame, frames[reached])
    assert session.store.count == COUNT


def test_the_table_is_that_of_hs_track(
    session: Session, square: tuple[Path, list[Box]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Byte by byte, on the same box."""
    path, boxes = square
    monkeypatch.chdir(tmp_path)
    x, y, w, h = boxes[0]
    assert cli.main([str(path), "--roi", f"{x},{y},{w},{h}", "--csv", "theirs.csv"]) == 0
    session.start(boxes[0])
    session.go_to(COUNT - 1)
    assert table_csv(session.tracks[0]).encode() == (tmp_path / "theirs.csv").read_bytes()


def test_a_box_may_be_drawn_at_any_frame(session: Session, square: tuple[Path, list[Box]]) -> None:
    """The track begins there, and a new box in another frame takes its place."""
    _, boxes = square
    session.go_to(4)
    session.start(boxes[4])
    session.go_to(9)
    (track,) = session.tracks
    assert (track.start, track.head) == (4, 9)
    assert [step.index for step in track.steps] == list(range(4, 10))
    assert track.at(3) is None
    found = track.at(9)
    assert found is not None
    assert found.box is not None
    assert iou(found.box, boxes[9]) > 0.7
    session.go_to(2)
    session.start(boxes[2])
    assert [track.start for track in session.tracks] == [2]


def test_going_back_changes_no_result(session: Session, square: tuple[Path, list[Box]]) -> None:
    """Every frame is updated once, in order, whatever way the viewer takes."""
    _, boxes = square
    session.start(boxes[0])
    session.go_to(COUNT - 1)
    straight = table_csv(session.tracks[0])
    session.go_to(0)
    session.start(boxes[0])
    for target in (3, 1, 6, 6, 2, 13, 0):
        session.go_to(target)
    assert table_csv(session.tracks[0]) == straight


def test_several_objects_are_followed_side_by_side(session: Session, square: tuple[Path, list[Box]]) -> None:
    """Each with its number and its own first frame."""
    _, boxes = square
    session.start(boxes[0])
    session.go_to(5)
    session.start(Box(100.0, 80.0, 30.0, 30.0), add=True)
    session.go_to(8)
    assert [(track.number, track.start, track.head) for track in session.tracks] == [(1, 0, 8), (2, 5, 8)]
    assert session.tracks[0].label == "TrackerHS 1"


@pytest.mark.parametrize("box", [Box(0, 0, 1, 1), Box(500, 500, 20, 20), Box(10, 10, float("nan"), 5)])
def test_a_box_that_cannot_be_followed_changes_nothing(
    session: Session, square: tuple[Path, list[Box]], box: Box
) -> None:
    """The tracks there are go on."""
    session.start(square[1][0])
    before = list(session.tracks)
    with pytest.raises(InputError):
        session.start(box, add=True)
    assert session.tracks == before


def test_a_rival_that_is_chosen_later_catches_up(session: Session, square: tuple[Path, list[Box]]) -> None:
    """It starts in the frame and box of the object, and ends where the viewer is; unchosen, it goes."""
    _, boxes = square
    session.choose(["TrackerHS", "KCF"])
    session.start(boxes[0])
    session.go_to(8)
    kcf = [step.box for step in session.tracks[1].steps]
    session.choose(["TrackerHS"])
    assert [track.name for track in session.tracks] == ["TrackerHS"]
    ours = session.tracks[0]
    session.choose(["KCF", "TrackerHS", "nobody"])
    assert session.tracks[0] is ours
    assert session.tracks[1].head == 0
    assert session.go_to(session.index)
    assert session.index == 8
    assert [step.box for step in session.tracks[1].steps] == kcf


def test_an_object_outlives_its_trackers(session: Session, square: tuple[Path, list[Box]]) -> None:
    """All may be unchosen; one that is chosen then starts where the object was boxed."""
    session.go_to(3)
    session.start(square[1][3])
    session.go_to(6)
    session.choose([])
    assert session.tracks == []
    session.choose(["KCF"])
    session.go_to(session.index)
    assert [(track.name, track.start, track.head) for track in session.tracks] == [("KCF", 3, 6)]
    _forget(session)
    assert session.index == 3
    session.choose(["TrackerHS"])
    assert session.tracks == []


def test_the_way_back_may_be_cut_short(square: tuple[Path, list[Box]], monkeypatch: pytest.MonkeyPatch) -> None:
    """Where earlier frames have to be decoded again, the viewer is not kept waiting."""
    monkeypatch.setattr(FrameStore.__init__, "__kwdefaults__", {"budget": 1})
    session = Session(Sources(str(square[0])))
    session.open("square.mkv")
    session.go_to(COUNT - 1)
    assert not session.go_to(5, seconds=0.0)
    assert session.index == COUNT - 1
    while not session.go_to(5, seconds=0.0):
        pass
    assert session.index == 5
    session.close()


def test_every_rival_of_this_opencv_runs(session: Session, square: tuple[Path, list[Box]]) -> None:
    """And all are asked about the same frames."""
    names = ["TrackerHS", *rivals()]
    assert {"CSRT", "KCF", "MIL"} <= set(names)
    assert "TrackerNano" not in names
    session.choose(names)
    session.start(square[1][0])
    session.go_to(3)
    assert [(track.name, track.head) for track in session.tracks] == [(name, 3) for name in names]


def test_nano_comes_with_its_models(square: tuple[Path, list[Box]], tmp_path: Path) -> None:
    """A folder without them adds nothing; models that are none are an error of one line, and change nothing."""
    assert "TrackerNano" not in rivals(str(tmp_path / "absent"))
    for part in ("backbone", "head"):
        (tmp_path / f"nano_{part}.onnx").write_bytes(b"no model")
    session = Session(Sources(str(square[0])), str(tmp_path))
    session.open("square.mkv")
    session.start(square[1][0])
    with pytest.raises(InputError, match="TrackerNano"):
        session.choose(["TrackerHS", "TrackerNano"])
    assert [track.name for track in session.tracks] == session.names == ["TrackerHS"]
    session.close()


def test_nano_follows(real: Path) -> None:
    """With the models it follows the demo's ball."""
    session = Session(Sources(), str(real.parent / "models"))
    if "TrackerNano" not in session.rivals:
        pytest.skip(f"no models at {real.parent / 'models'}")
    session.open(DEMO)
    session.choose(["TrackerNano"])
    session.start(demonstration.BOX)
    session.go_to(5)
    found = session.tracks[0].at(5)
    assert found is not None
    assert found.box is not None
    x, y = demonstration._centre(5)
    assert iou(found.box, Box(x - 44, y - 44, 88, 88)) > 0.6
    session.close()


def test_a_rival_that_raises_is_lost() -> None:
    """OpenCV's trackers raise where they should say that the object is lost."""
    from hs_tracker_cv.app.rivals import Rival

    class Raising:
        def init(self, frame: Any, box: Any) -> None:
            pass

        def update(self, frame: Any) -> Any:
            raise cv2.error("no")

    rival = Rival(Raising, Box(1.2, 2.0, 30.0, 30.0))
    frame = np.zeros((60, 60, 3), np.uint8)
    assert rival.init(0, frame).box == Box(1, 2, 30, 30)
    step = rival.update(1, frame)
    assert (step.box, step.state) == (None, "lost")


def test_parameters_act_on_the_whole_track(session: Session, square: tuple[Path, list[Box]]) -> None:
    """The track is what it would have been with them from the start."""
    _, boxes = square
    session.start(boxes[0])
    session.go_to(9)
    session.set_parameters(TrackerHS_Params(mode="patch_tracker"))
    session.go_to(session.index)
    changed = table_csv(session.tracks[0])
    _forget(session)
    assert session.tracks == []
    assert session.index == 0
    session.start(boxes[0])
    session.go_to(9)
    assert table_csv(session.tracks[0]) == changed
    assert session.tracks[0].silhouette(9) is None


def test_the_first_mover_is_followed(session: Session, square: tuple[Path, list[Box]]) -> None:
    """Without a box, as hs-track does without --roi."""
    assert session.follow_first_mover(MoverFinder())
    (track,) = session.tracks
    assert iou(track.roi, square[1][track.start]) > 0.5
    session.go_to(0)
    _forget(session)
    session.go_to(COUNT - 1)
    assert not session.follow_first_mover(MoverFinder())


def test_regions_are_proposed(session: Session, square: tuple[Path, list[Box]]) -> None:
    """None in the first frame, where there is no motion yet; then the mover."""
    assert session.regions(_now(session)) == []
    session.go_to(3)
    best = session.regions(_now(session))[0]
    assert iou(best.box, square[1][3]) > 0.5


def test_the_way_may_be_cut_short(session: Session, square: tuple[Path, list[Box]]) -> None:
    """After no time at all one frame has been taken, and the rest follows when asked again."""
    session.start(square[1][0])
    assert not session.go_to(5, seconds=0.0)
    assert session.index == 1
    calls = 1
    while not session.go_to(5, seconds=0.0):
        calls += 1
    assert calls < 10
    assert session.index == 5


def test_panels_follow_frame_and_parameters(session: Session, square: tuple[Path, list[Box]]) -> None:
    """Each is a picture; λ changes the flow's and not the derivatives'."""
    names = list(TITLES)
    assert session.panels(_now(session), names, 200) == []
    session.start(square[1][0])
    session.go_to(4)
    first = {panel.name: panel for panel in session.panels(_now(session), names, 200)}
    assert list(first) == names
    assert all(panel.picture.shape[1] == 200 for panel in first.values())
    assert "classic, λ 10, 100 iterations, whole frame" in first["arrows"].note
    session.stage_params = StageParams(smoothness=60.0)
    second = {panel.name: panel for panel in session.panels(_now(session), names, 200)}
    changed = {name for name in names if not np.array_equal(first[name].picture, second[name].picture)}
    assert changed == {"arrows", "colours"}
    assert "λ 60" in second["arrows"].note
    session.go_to(3)
    assert not np.array_equal(session.panels(_now(session), ["Ft"], 200)[0].picture, first["Ft"].picture)


def test_the_layers_are_those_of_the_frame_shown(session: Session, square: tuple[Path, list[Box]]) -> None:
    """They are kept for every frame of the track; where there is no track the panel says so."""
    session.start(square[1][0])
    session.go_to(9)
    late = session.panels(_now(session), [LAYERS], 300)[0]
    session.go_to(4)
    early = session.panels(_now(session), [LAYERS], 300)[0]
    assert late.note == early.note == ""
    assert not np.array_equal(late.picture, early.picture)
    silhouette = session.tracks[0].silhouette(4)
    assert silhouette is not None
    rows, columns = np.nonzero(silhouette.mask)
    step = silhouette.window.w / silhouette.mask.shape[1]
    box = Box.from_edges(
        silhouette.window.x + columns.min() * step,
        silhouette.window.y + rows.min() * step,
        silhouette.window.x + (columns.max() + 1) * step,
        silhouette.window.y + (rows.max() + 1) * step,
    )
    assert iou(box, square[1][4]) > 0.7
    session.tracks = []
    assert session.panels(_now(session), [LAYERS], 300)[0].note == "nothing is segmented in this frame"


def test_the_overlay_has_every_frame_of_the_tracks(
    session: Session, square: tuple[Path, list[Box]], tmp_path: Path
) -> None:
    """And plays."""
    with pytest.raises(VideoError, match="nothing has been followed"):
        overlay_webm(session, _now(session))
    session.go_to(2)
    session.start(square[1][2])
    session.go_to(9)
    (tmp_path / "o.webm").write_bytes(overlay_webm(session, _now(session)))
    frames = list(open_source(tmp_path / "o.webm").frames)
    assert len(frames) == 8
    assert frames[0].shape == session.frame.shape
    assert session.index == 9


def test_the_panels_are_a_png(session: Session) -> None:
    """Of all that are chosen; without any it is said why not."""
    with pytest.raises(VideoError, match="no panels"):
        panels_png(session, _now(session), ["Fx"])
    session.go_to(1)
    with pytest.raises(VideoError, match="no panels"):
        panels_png(session, _now(session), [])
    png = panels_png(session, _now(session), ["Fx", "arrows"])
    picture = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    assert picture.shape[1] == 2 * 480 + 3 * 10


def test_the_program_finds_the_same_boxes(session: Session, square: tuple[Path, list[Box]]) -> None:
    """It is run, and prints the page's boxes and the page's flow."""
    path, boxes = square
    session.go_to(2)
    session.stage_params = StageParams(smoothness=7.0, iterations=30)
    session.set_parameters(TrackerHS_Params(mode="segmentation"))
    session.start(boxes[2])
    session.go_to(COUNT - 1)
    session.go_to(5)
    seen = _now(session)
    code = snippet(session, seen)
    assert repr(str(path)) in code
    session.go_to(6)
    assert snippet(session, seen) == code  # of what was seen, wherever the session is by now
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {})
    lines = printed.getvalue().splitlines()
    assert lines[0].startswith("5 (120, 160, 2) ")
    expected = [f"{step.index} {step.box} {step.score}" for step in session.tracks[0].steps[1:]]
    assert lines[1:] == expected


@pytest.mark.parametrize(
    ("url", "name"),
    [
        ("http://user:secret@host/film/clip.mp4?token=secret", "clip.mp4"),
        ("rtsp://user:secret@camera:554", "camera"),
        ("rtsp://user:secret@camera:554/door", "door"),
    ],
)
def test_a_stream_is_offered_without_its_secrets(url: str, name: str) -> None:
    """The page shows its name; what opens it is the address as it was given."""
    sources = Sources(url)
    assert sources.names == [name, CAMERA.format(0), DEMO]
    assert sources.argument(name) == url
    sources.close()


def test_the_program_of_the_demo_runs() -> None:
    """Though it is no file."""
    session = Session(Sources())
    session.open(DEMO)
    session.start(demonstration.BOX)
    session.go_to(2)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(snippet(session, _now(session)).replace("elif index > 0:", "elif 0 < index < 3:"), {})
    lines = printed.getvalue().splitlines()
    assert lines[0].startswith("2 (480, 640, 2) ")
    assert lines[1:] == [f"{step.index} {step.box} {step.score}" for step in session.tracks[0].steps[1:]]
    session.close()


def _printed(code: str) -> list[str]:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        exec(code, {})
    return printed.getvalue().splitlines()


def test_the_program_of_an_upload_runs_beside_the_file(
    square: tuple[Path, list[Box]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A browser tells a file's name and not where it lies."""
    path, boxes = square
    sources = Sources()
    name, inside = sources.reserve(path.name)
    inside.write_bytes(path.read_bytes())
    session = Session(sources)
    session.open(name)
    session.start(boxes[0])
    session.go_to(COUNT - 1)
    code = snippet(session, _now(session))
    assert "beside this program" in code
    monkeypatch.chdir(path.parent)
    expected = [f"{step.index} {step.box} {step.score}" for step in session.tracks[0].steps[1:]]
    assert _printed(code)[1:] == expected
    session.close()


def test_the_program_of_a_folder_runs_anywhere(
    square: tuple[Path, list[Box]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Though the folder was named from where the page was started."""
    path, boxes = square
    folder = tmp_path / "shots" / "img"
    folder.mkdir(parents=True)
    with open_source(path) as source:
        for index, frame in enumerate(source.frames):
            cv2.imwrite(str(folder / f"{index}.png"), frame)
    monkeypatch.chdir(folder.parent)
    session = Session(Sources("img"))
    session.open("shots/img")
    session.start(boxes[0])
    session.go_to(COUNT - 1)
    code = snippet(session, _now(session))
    monkeypatch.chdir("/")
    expected = [f"{step.index} {step.box} {step.score}" for step in session.tracks[0].steps[1:]]
    assert _printed(code)[1:] == expected
    session.close()


def test_the_overlay_of_a_long_video_leaves_the_store_alone(
    session: Session, square: tuple[Path, list[Box]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Frames that are no longer kept are not fetched through it: the viewer's would go for them."""
    session.start(square[1][0])
    session.go_to(COUNT - 1)
    seen = _now(session)

    def refuse(index: int) -> bool:
        raise AssertionError(f"frame {index} was asked of the store")

    monkeypatch.setattr(seen.store, "approach", refuse)
    path = square[0].with_suffix(".webm")
    path.write_bytes(overlay_webm(session, seen))
    with open_source(path) as source:
        assert len(list(source.frames)) == COUNT


class _Camera:
    """A webcam, as OpenCV hands it out: no number of frames, no rate, and an end when it is unplugged."""

    def __init__(self, number: int) -> None:
        assert number == 0
        self._left = iter(moving_square(np.random.default_rng(0), count=COUNT)[0])

    def isOpened(self) -> bool:
        return True

    def read(self) -> tuple[bool, NDArray[np.uint8] | None]:
        frame = next(self._left, None)
        return frame is not None, frame

    def get(self, prop: int) -> float:
        return 0.0

    def release(self) -> None:
        self._left = iter(())


def test_an_object_before_a_camera_is_followed_and_taken_away(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Frames are numbered from when it was opened; those kept can be gone back to; its end is an error."""
    monkeypatch.setattr(cv2, "VideoCapture", _Camera)
    boxes = [Box(*box) for box in moving_square(np.random.default_rng(0), count=COUNT)[1]]
    session = Session(Sources("0"))
    session.open(CAMERA.format(0))
    session.go_to(2)
    session.start(boxes[2])
    session.go_to(COUNT - 1)
    step = session.tracks[0].at(COUNT - 1)
    assert step is not None
    assert step.box is not None
    assert iou(step.box, boxes[COUNT - 1]) > 0.8
    session.go_to(4)  # back, in what is kept
    seen = _now(session)
    assert (seen.index, seen.store.count) == (4, None)
    assert [panel.name for panel in session.panels(seen, ["Ft"], 100)] == ["Ft"]
    (tmp_path / "live.webm").write_bytes(overlay_webm(session, seen))
    with pytest.raises(VideoError, match="camera 0: has stopped giving frames"):
        session.go_to(COUNT)
    session.close()
    monkeypatch.undo()
    with open_source(tmp_path / "live.webm") as source:
        assert len(list(source.frames)) == COUNT - 2


def test_every_tracker_has_its_column_of_speed(session: Session, square: tuple[Path, list[Box]]) -> None:
    """The square moves by (2, 1) px per frame."""
    session.start(square[1][0])
    session.go_to(8)
    speeds = session.tracks[0].speeds()
    assert len(speeds) == 9
    assert np.isnan(speeds[0])
    np.testing.assert_allclose(speeds[2:], np.hypot(2, 1), atol=0.5)


def test_a_box_holds_for_the_frame_in_which_it_was_drawn(session: Session, square: tuple[Path, list[Box]]) -> None:
    """Though the session has gone on meanwhile; the track catches up with it."""
    session.go_to(3)
    seen = _now(session)
    session.go_to(9)
    session.start(square[1][3], seen=seen)
    session.go_to(session.index)
    (track,) = session.tracks
    assert (track.start, track.head, session.index) == (3, 9, 9)
    assert _now(session).tracks == [track]
    assert seen.tracks == []


def test_what_was_seen_of_another_video_is_refused(session: Session, square: tuple[Path, list[Box]]) -> None:
    """A box, an export or a panel that comes late is not made from the frames of the video that is open by then."""
    session.go_to(3)
    session.start(square[1][3])
    seen = _now(session)
    session.open("square.mkv")
    session.go_to(3)
    late: list[Callable[[], Any]] = [
        lambda: session.start(square[1][3], seen=seen),
        lambda: session.regions(seen),
        lambda: session.panels(seen, ["Fx"], 100),
        lambda: panels_png(session, seen, ["Fx"]),
        lambda: overlay_webm(session, seen),
    ]
    for act in late:
        with pytest.raises(VideoError, match="square: is no longer open"):
            act()
    assert session.tracks == []
    assert not session.shows(seen)
    assert session.shows(_now(session))


def test_parameters_that_are_refused_change_nothing(
    session: Session, square: tuple[Path, list[Box]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither what is told nor what is followed with."""
    session.start(square[1][0])
    track = session.tracks[0]

    def refuse(tracks: list[Any]) -> None:
        raise InputError("no")

    monkeypatch.setattr(session, "_restart", refuse)
    with pytest.raises(InputError, match="no"):
        session.set_parameters(TrackerHS_Params(mode="segmentation"))
    assert session.parameters == TrackerHS_Params()
    assert session.tracks == [track]


def test_the_time_told_is_that_of_the_last_updates(session: Session, square: tuple[Path, list[Box]]) -> None:
    """Their median: one that waited for the machine does not count; where the box was drawn there is none."""
    session.start(square[1][0])
    session.go_to(4)
    track = session.tracks[0]
    track.steps = [replace(step, seconds=t) for step, t in zip(track.steps, (0.0, 1.0, 2.0, 90.0, 4.0), strict=True)]
    assert [track.seconds(index) for index in (0, 1, 3, 4)] == [0.0, 1.0, 2.0, 3.0]


def test_without_a_video_everything_says_so() -> None:
    """As one clear error."""
    empty = Session(Sources())
    with pytest.raises(VideoError):
        empty.go_to(1)
    with pytest.raises(InputError):
        empty.start(Box(0, 0, 20, 20))
    assert empty.current() is None
    empty.forget()
    empty.close()
    with pytest.raises(VideoError, match="has been closed"):
        empty.open(DEMO)


def test_a_source_that_cannot_be_read_leaves_the_session_usable(square: tuple[Path, list[Box]]) -> None:
    """The error names it; the other sources still open."""
    (square[0].parent / "broken.avi").write_bytes(b"no video")
    session = Session(Sources(str(square[0].parent)))
    with pytest.raises(VideoError, match=r"broken\.avi"):
        session.open("broken.avi")
    assert not session.opened
    session.open("square.mkv")
    assert session.index == 0
    session.close()


def test_closing_waits_for_what_is_being_done(session: Session, square: tuple[Path, list[Box]]) -> None:
    """A page may be closed in the middle of a frame."""
    session.start(square[1][0])

    def go_on() -> None:
        with contextlib.suppress(VideoError):  # the page was closed before it began
            session.go_to(COUNT - 1)

    thread = threading.Thread(target=go_on)
    thread.start()
    session.close()
    thread.join(60)
    assert not thread.is_alive()
    assert not session.opened


def test_the_demo_is_tracked() -> None:
    """The ball is found in every frame; the sequence is the same each time, and is offered on every page."""
    sources = Sources()
    assert sources.names == [CAMERA.format(0), DEMO]
    session = Session(sources)
    session.open(DEMO)
    assert session.store.size == (640, 480)
    session.start(demonstration.BOX)
    session.go_to(40)
    found = session.tracks[0].at(40)
    assert found is not None
    assert found.box is not None
    x, y = demonstration._centre(40)
    truth = Box(x - demonstration.RADIUS, y - demonstration.RADIUS, *demonstration.BOX[2:])
    assert iou(found.box, truth) > 0.9
    again = [frame for _, frame in zip(range(3), demonstration.demo().frames, strict=False)]
    np.testing.assert_array_equal(again[2], session.frame_at(2, _now(session)))
    session.close()


def test_the_csv_reads_as_a_table(session: Session, square: tuple[Path, list[Box]]) -> None:
    """One row per frame of the track, a rival's too."""
    session.choose(["TrackerHS", "KCF"])
    session.start(square[1][0])
    session.go_to(4)
    for track in session.tracks:
        rows = list(csv.DictReader(io.StringIO(table_csv(track))))
        assert [int(row["frame"]) for row in rows] == list(range(5))
