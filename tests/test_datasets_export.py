"""Files written by the laboratory, read back; its command line."""

from __future__ import annotations

import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from datasets_synthetic import SUITES, Sequence, render
from datasets_synthetic.__main__ import main
from datasets_synthetic.export import (
    FORMATS,
    _anchors,
    read_flo,
    read_otb_boxes,
    write_coco,
    write_flo,
    write_flow,
    write_got10k,
    write_otb,
    write_video,
    write_vot,
)
from datasets_synthetic.preview import contact_sheet
from datasets_synthetic.spec import Deep


@pytest.fixture(scope="module")
def sequence() -> Sequence:
    """A short sequence in colour."""
    return render(replace(SUITES["smoke"][0], frames=5))


@pytest.fixture(scope="module")
def hidden() -> Sequence:
    """A gray sequence whose target is not there in frames 2 and 3."""
    spec = SUITES["smoke"][3]
    motion = replace(spec.target.motion, hidden=((2, 4),))
    return render(replace(spec, frames=6, target=replace(spec.target, motion=motion)))


def numbers(path: Path) -> np.ndarray:
    """Comma-separated numbers of a file."""
    return np.array([[float(value) for value in line.split(",")] for line in path.read_text().splitlines()])


def test_otb_round_trip(sequence: Sequence, tmp_path: Path) -> None:
    """Boxes are 1-based and comma-separated on disk and come back; images are bit-exact."""
    folder = write_otb(sequence, tmp_path)
    assert folder == tmp_path / sequence.name
    raw = numbers(folder / "groundtruth_rect.txt")
    np.testing.assert_allclose(raw[:, :2], sequence.boxes[:, :2] + 1, atol=1e-4)
    np.testing.assert_allclose(read_otb_boxes(folder / "groundtruth_rect.txt"), sequence.boxes, atol=1e-4)
    files = sorted((folder / "img").iterdir())
    assert [file.name for file in files] == [f"{t:04d}.jpg" for t in range(1, 6)]
    for file, frame in zip(files, sequence.frames, strict=True):
        np.testing.assert_array_equal(cv2.imread(str(file)), frame)


@pytest.mark.parametrize(
    "text", ["3,4,10,20\n5,6,10,20\n", "3\t4\t10\t20\n5\t6\t10\t20\n", "3 4 10 20\n5 6 10 20\n\n"]
)
def test_otb_truth_with_any_separator(text: str, tmp_path: Path) -> None:
    """OTB's own files have commas, tabs or spaces."""
    (tmp_path / "truth.txt").write_text(text)
    np.testing.assert_array_equal(read_otb_boxes(tmp_path / "truth.txt"), [[2, 3, 10, 20], [4, 5, 10, 20]])


def test_vot_layout(hidden: Sequence, tmp_path: Path) -> None:
    """Four numbers a line; tags per frame; the sequence file says how long it is."""
    folder = write_vot(hidden, tmp_path)
    np.testing.assert_array_equal(numbers(folder / "groundtruth.txt"), hidden.boxes)
    assert (folder / "absent.tag").read_text().split() == ["0", "0", "1", "1", "0", "0"]
    facts = dict(line.split("=") for line in (folder / "sequence").read_text().split())
    assert facts["length"] == "6"
    assert facts["width"] == "160"
    assert (folder / (facts["channels.color"] % 6)).is_file()
    assert (tmp_path / "list.txt").read_text().split() == [hidden.name]
    assert (folder / "anchor.value").read_text().split() == ["1", "0", "0", "0", "0", "0"]


def test_vot_anchors(tmp_path: Path, sequence: Sequence) -> None:
    """Every fiftieth frame in which the target can be seen; from the second half on the run is backward."""
    visibility = np.ones(220)
    visibility[50] = 0.2
    longer = replace(sequence, frames=np.zeros((220, 8, 8), np.uint8), visibility=visibility)
    anchors = _anchors(longer)
    assert {int(frame): int(anchors[frame]) for frame in np.flatnonzero(anchors)} == {0: 1, 100: 1, 150: -1, 200: -1}


def test_got10k_layout(hidden: Sequence, sequence: Sequence, tmp_path: Path) -> None:
    """The three label files say cover 0–8, absence and cut; images read bit-exactly under the name .jpg."""
    folder = write_got10k(hidden, tmp_path)
    write_got10k(sequence, tmp_path)
    write_got10k(hidden, tmp_path)
    assert (tmp_path / "list.txt").read_text().split() == [hidden.name, sequence.name]
    np.testing.assert_allclose(numbers(folder / "groundtruth.txt"), hidden.boxes, atol=1e-4)
    assert numbers(folder / "absence.label").ravel().tolist() == [0, 0, 1, 1, 0, 0]
    cover = numbers(folder / "cover.label").ravel()
    assert cover.tolist() == np.ceil(hidden.visibility * 8).tolist()
    assert cover[0] == 8
    assert cover[2] == 0
    assert "resolution: (160, 120)" in (folder / "meta_info.ini").read_text()
    image = cv2.imread(str(folder / "00000001.jpg"), cv2.IMREAD_GRAYSCALE)
    np.testing.assert_array_equal(image, hidden.frames[0])


def test_coco_layout(hidden: Sequence, tmp_path: Path) -> None:
    """One annotation per frame in which the target is seen; box, area and polygon agree with the truth."""
    folder = write_coco(hidden, tmp_path)
    document = json.loads((folder / "annotations.json").read_text())
    assert len(document["images"]) == 6
    assert [each["image_id"] for each in document["annotations"]] == [1, 2, 5, 6]
    first = document["annotations"][0]
    np.testing.assert_allclose(first["bbox"], hidden.boxes[0])
    assert first["area"] == hidden.masks[0].sum()
    polygon = np.array(first["segmentation"][0]).reshape(-1, 2)
    np.testing.assert_allclose(polygon.min(axis=0), hidden.boxes[0, :2])
    assert (folder / document["images"][0]["file_name"]).is_file()


def test_flo_round_trip(sequence: Sequence, tmp_path: Path) -> None:
    """Flow fields come back to the bit; OpenCV reads the same numbers."""
    folder = write_flow(sequence, tmp_path)
    flow, valid = sequence.flow(2)
    path = folder / "flow" / "0003.flo"
    np.testing.assert_array_equal(read_flo(path), flow)
    np.testing.assert_array_equal(cv2.readOpticalFlow(str(path)), flow)
    mask = cv2.imread(str(folder / "flow" / "0003_valid.png"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(mask > 0, valid)


def test_broken_flo_is_refused(tmp_path: Path) -> None:
    """A file that is none, or that was cut short, is named."""
    path = tmp_path / "x.flo"
    path.write_bytes(b"hello, this is no flow")
    with pytest.raises(ValueError, match=r"x\.flo is no \.flo file"):
        read_flo(path)
    write_flo(path, np.zeros((4, 5, 2), np.float32))
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(ValueError, match="5 × 4 px but holds 156"):
        read_flo(path)


@pytest.mark.parametrize("name", ["sequence", "hidden"])
def test_video_is_lossless(name: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    """Every frame of the FFV1 video is the rendered one, bit for bit."""
    rendered: Sequence = request.getfixturevalue(name)
    folder = write_video(rendered, tmp_path)
    reader = cv2.VideoCapture(str(folder / "video.mkv"))
    frames = []
    while (step := reader.read())[0]:
        frames.append(step[1])
    assert len(frames) == len(rendered)
    for frame, true in zip(frames, rendered.frames, strict=True):
        np.testing.assert_array_equal(frame, cv2.cvtColor(true, cv2.COLOR_GRAY2BGR) if true.ndim == 2 else true)


def test_sixteen_bits_are_no_video(hidden: Sequence, tmp_path: Path) -> None:
    """OpenCV would keep eight of them without a word; the message says what to do, and a preview can be seen."""
    deep = render(replace(hidden.spec, frames=3, deep=Deep(7300, 8100)))
    with pytest.raises(ValueError, match=r"expected frames of 8 bits for a video, .* has 16"):
        write_video(deep, tmp_path)
    plain = contact_sheet(render(replace(hidden.spec, frames=3)))
    # The digest in the heading differs.
    assert np.abs(contact_sheet(deep)[80:].astype(int) - plain[80:]).max() <= 40


def test_every_format_leaves_a_manifest(sequence: Sequence, tmp_path: Path) -> None:
    """Whatever the layout, the folder says from which spec it was made and what is visible."""
    for name, write in FORMATS.items():
        folder = write(sequence, tmp_path / name)
        manifest = json.loads((folder / "manifest.json").read_text())
        assert manifest["digest"] == sequence.spec.digest()
        assert manifest["spec"] == repr(sequence.spec)
        np.testing.assert_allclose(numbers(folder / "visibility.txt").ravel(), sequence.visibility, atol=0)


@pytest.mark.parametrize("name", ["sequence", "hidden"])
def test_contact_sheet_draws_the_truth(name: str, request: pytest.FixtureRequest) -> None:
    """The sheet is a picture that holds the box's red and the outline's yellow."""
    sheet = contact_sheet(request.getfixturevalue(name))
    assert sheet.dtype == np.uint8
    assert sheet.ndim == 3
    for colour in ((60, 60, 255), (0, 235, 255)):
        assert (sheet[70:] == colour).all(axis=2).sum() > 100


def command(monkeypatch: pytest.MonkeyPatch, *words: str) -> None:
    """Run the command line."""
    monkeypatch.setattr(sys, "argv", ["datasets_synthetic", *words])
    main()


def test_command_renders_a_suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`render smoke` writes a folder per sequence, with preview on request."""
    command(monkeypatch, "render", "smoke", "--out", str(tmp_path), "--preview")
    for spec in SUITES["smoke"]:
        folder = tmp_path / spec.name
        assert len(list((folder / "img").iterdir())) == spec.frames
        assert len(read_otb_boxes(folder / "groundtruth_rect.txt")) == spec.frames
        assert cv2.imread(str(tmp_path / "previews" / f"{spec.name}.png")) is not None
        assert sorted(path.name for path in folder.iterdir() if path.suffix == ".png") == []


@pytest.mark.parametrize("layout", FORMATS)
def test_previews_are_not_taken_for_frames(
    layout: str, sequence: Sequence, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """What readers of image folders find is the same with previews and without."""
    monkeypatch.setattr("datasets_synthetic.__main__.render", lambda spec: sequence)
    monkeypatch.setattr("datasets_synthetic.__main__.specs_of", lambda name: [sequence.spec])
    for name, words in {"with": ["--preview"], "without": []}.items():
        command(monkeypatch, "render", "smoke", "--out", str(tmp_path / name), "--format", layout, *words)
    found = {
        name: sorted(str(path.relative_to(tmp_path / name)) for path in (tmp_path / name / sequence.name).rglob("*"))
        for name in ("with", "without")
    }
    assert found["with"] == found["without"]
    assert [path.name for path in (tmp_path / "with" / "previews").iterdir()] == [f"{sequence.name}.png"]


@pytest.mark.parametrize("first", FORMATS)
@pytest.mark.parametrize("then", FORMATS)
def test_an_earlier_export_leaves_nothing_behind(first: str, then: str, sequence: Sequence, tmp_path: Path) -> None:
    """Rendered again with fewer frames, in the same layout or another: the same files as in an empty folder."""
    short = render(replace(sequence.spec, frames=3))
    folder = FORMATS[first](sequence, tmp_path / "again")
    (folder / "car.hs.csv").write_text("what somebody has measured")
    FORMATS[then](short, tmp_path / "again")
    fresh = FORMATS[then](short, tmp_path / "fresh")
    again, new = (
        {str(path.relative_to(root)): path.read_bytes() for path in root.rglob("*") if path.is_file()}
        for root in (folder, fresh)
    )
    assert again.pop("car.hs.csv") == b"what somebody has measured"
    assert set(again) == set(new)
    # FFV1 in Matroska holds a number drawn at random.
    assert {name: data for name, data in again.items() if name != "video.mkv"} == {
        name: data for name, data in new.items() if name != "video.mkv"
    }


def test_a_folder_of_somebody_else_is_refused(sequence: Sequence, tmp_path: Path) -> None:
    """Of a data set that happens to have a sequence of that name nothing is changed."""
    folder = tmp_path / sequence.name
    (folder / "img").mkdir(parents=True)
    (folder / "img" / "0001.jpg").write_bytes(b"theirs")
    for write in FORMATS.values():
        with pytest.raises(FileExistsError, match="there are files that are no export of ours"):
            write(sequence, tmp_path)
    assert [path.name for path in folder.iterdir()] == ["img"]
    assert (folder / "img" / "0001.jpg").read_bytes() == b"theirs"


@pytest.mark.parametrize("layout", ["otb", "video"])
@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("file", "file/{name}: cannot be written (Not a directory)"),
        ("/dev/null/x", "/dev/null/x/{name}: cannot be written (Not a directory)"),
        ("theirs", "theirs/{name}: cannot be written (there are files that are no export of ours)"),
    ],
)
def test_a_bad_out_is_one_line(
    out: str, message: str, layout: str, sequence: Sequence, monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """With the reason of the operating system, and exit code 1."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("datasets_synthetic.__main__.render", lambda spec: sequence)
    Path("file").touch()
    (Path("theirs") / sequence.name).mkdir(parents=True)
    (Path("theirs") / sequence.name / "notes.txt").touch()
    with pytest.raises(SystemExit) as stop:
        command(monkeypatch, "render", "smoke", "--out", out, "--format", layout, "--preview")
    assert stop.value.code == 1
    assert message.format(name=sequence.name) in capsys.readouterr().err


@pytest.mark.skipif(sys.platform in {"darwin", "win32"}, reason="all names are Unicode there")
def test_any_name_of_a_folder_is_written_to(
    sequence: Sequence, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """With a colon, of which FFmpeg makes a protocol; not UTF-8, it is an error for video, and not the end."""
    monkeypatch.chdir(tmp_path)
    for write in FORMATS.values():
        assert write(sequence, Path("12:30") / write.__name__).is_dir()
    odd = Path(os.fsdecode(b"\xe9"))
    assert len(list((write_otb(sequence, odd) / "img").iterdir())) == len(sequence)
    with pytest.raises(OSError, match="OpenCV takes names in UTF-8 only"):
        write_video(sequence, odd)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("render", "smokey", "--out", "x"), "unknown suite 'smokey'; known: smoke, standard, develop"),
        (("render", "smoke", "--out", "x", "--format", "avi"), "no format 'avi'; known: otb, vot"),
    ],
)
def test_command_names_what_it_knows(
    words: tuple[str, ...], message: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A wrong suite or format ends with status 2 and the names that exist."""
    with pytest.raises(SystemExit) as stop:
        command(monkeypatch, *words)
    assert stop.value.code == 2
    assert message in " ".join(capsys.readouterr().err.split())


def test_command_lists(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """`list` names every suite and sequence."""
    monkeypatch.setenv("COLUMNS", "200")
    command(monkeypatch, "list")
    text = capsys.readouterr().out
    for suite, specs in SUITES.items():
        assert f"{suite} ({len(specs)})" in text
        assert all(spec.name in text for spec in specs)
