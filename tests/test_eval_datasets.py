"""Data sets: every way in which people write boxes down, and every way in which a data set can be wrong."""

from __future__ import annotations

import csv
import json
import os
import sys
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from datasets_synthetic import SUITES, render
from datasets_synthetic import Sequence as Rendered
from datasets_synthetic.export import FORMATS
from datasets_synthetic.spec import Deep
from eval import datasets
from eval.commands import _open
from eval.datasets import canonical_dataset, load_dataset
from eval.framesource import FrameSource, FrameSourceError
from eval.metrics import frame_scores, summarise
from eval.regions import Mask
from eval.sequences import from_spec
from eval.truthfiles import SequenceError, SequenceWarning, read_box_file, read_scenes

BOXES = np.array([[10, 11, 20, 12], [12.5, 11, 20, 12], [15, 11.25, 20, 12]])


def write_images(folder: Path, count: int, *, suffix: str = ".png", digits: int = 4) -> None:
    """Frames of the gray level 10 t, as far as there are levels."""
    folder.mkdir(parents=True, exist_ok=True)
    for index in range(count):
        frame = np.full((48, 64, 3), 10 * index % 256, dtype=np.uint8)
        cv2.imwrite(str(folder / f"{index + 1:0{digits}d}{suffix}"), frame)


def write_otb(root: Path, name: str, text: str, *, count: int = 3) -> Path:
    """A sequence in OTB layout."""
    write_images(root / name / "img", count)
    (root / name / "groundtruth_rect.txt").write_text(text)
    return root / name


@pytest.mark.parametrize(
    "text",
    [
        "11,12,20,12\n13.5,12,20,12\n16,12.25,20,12\n",
        "11\t12\t20\t12\n13.5\t12\t20\t12\n16\t12.25\t20\t12",
        "11 12 20 12\r\n13.5  12 20 12\r\n16 12.25 20 12\r\n\r\n",
        " 11, 12, 20, 12 \n13.5; 12; 20; 12\n16,\t12.25, 20, 12\n\n\n",
        "\ufeff11,12,20,12\n13.5,12,20,12\n16,12.25,20,12",
    ],
    ids=["commas", "tabs", "spaces and CRLF", "mixed and padded", "byte order mark"],
)
def test_otb_boxes_in_all_spellings(text: str, tmp_path: Path) -> None:
    """Commas, tabs, semicolons or spaces; the first pixel is 1."""
    write_otb(tmp_path, "a", text)
    (found,) = load_dataset(f"otb:{tmp_path}")
    assert_allclose(found.boxes, BOXES)
    assert (found.name, found.size, len(found)) == ("a", (64, 48), 3)
    assert_array_equal(found.visibility, 1.0)


@pytest.mark.parametrize("line", ["NaN,NaN,NaN,NaN", "", "0,0,0,0", "5,5,-3,4", "nan 1 2 3"])
def test_a_frame_without_a_box_is_invisible(line: str, tmp_path: Path) -> None:
    """Absence is written in many ways and read as one: a NaN row of visibility 0."""
    write_otb(tmp_path, "a", f"11,12,20,12\n{line}\n16,12.25,20,12\n")
    (found,) = load_dataset(f"otb:{tmp_path / 'a'}")
    assert np.isnan(found.boxes[1]).all()
    assert_array_equal(found.visibility, [1, 0, 1])


def test_polygons_have_their_bounding_box(tmp_path: Path) -> None:
    """VOT's eight numbers are x, y of four corners, which are kept beside it."""
    path = tmp_path / "groundtruth.txt"
    path.write_text("10,20,30,10,50,20,30,40\n")
    found = read_box_file(path, first=0, regions=True)
    assert_allclose(found.boxes, [[10, 10, 40, 30]])
    assert found.regions == ("10.0,20.0,30.0,10.0,50.0,20.0,30.0,40.0",)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "1,2,3\n1,2,3,4\n1,2,3,4",
            r"_rect.txt:1: expected 4 numbers, got 3 in '1,2,3'",
        ),
        ("1,2,3,4\n1,two,3,4\n1,2,3,4", r"groundtruth_rect.txt:2: expected numbers, got 'two' in '1,two,3,4'"),
        (
            "1,1,100,200,30,40,1,-1,-1,-1\n" * 3,
            r"_rect.txt:1: expected 4 numbers, got 10 in '1,1,100",
        ),
        ("0 " * 16 + "\n", r"_rect.txt:1: expected 4 numbers, got 16"),
        ("1,2,3,4\n1,5,2,5,3,5,4,5\n1,2,3,4", r"_rect.txt:2: expected 4 numbers, got 8 in '1,5,2,5,3,5,4,5'"),
        ("1,2,3,4\n" + "1,2,3,4,5,6,7,8,9,10,11,12\n" * 2, r"_rect.txt:2: expected 4 numbers, got 12"),
        ("10,5 20,0 30,1 40,2\n" * 3, r"_rect.txt:1: expected a decimal point, got decimal commas in '10,5 20,0 30"),
        ("10,5;20,0;30,1;40,2\n" * 3, r"_rect.txt:1: expected a decimal point, got decimal commas"),
        ("10,5\t20,0\t30,1\t40,2\n" * 3, r"_rect.txt:1: expected a decimal point, got decimal commas"),
        (
            "1,2,3,4\n1,,3,4,5\n1,2,3,4",
            r"_rect.txt:2: expected a number in every field, .* in '1,,3,4,5'",
        ),
        ("1,2,3,4\n1_0,2,3,4\n1,2,3,4", r"_rect.txt:2: expected numbers, got '1_0' in '1_0,2,3,4'"),
        ("1,2,3,4\n1,2,inf,4\n1,2,3,4", r"_rect.txt:2: expected numbers, got 'inf'"),
        ("1,2,3,4\n1,2,1e400,4\n1,2,3,4", r"_rect.txt:2: expected numbers, got '1e400'"),
        ("1,2,3,4\n1,2,0x3,4\n1,2,3,4", r"_rect.txt:2: expected numbers, got '0x3'"),
        ("1,2,3,4\n1,2,٣,4\n1,2,3,4", r"_rect.txt:2: expected numbers, got '٣'"),
        ("1,2,3,4", "a: 3 frames but 1 boxes"),
        ("nan,nan,nan,nan\n1,2,3,4\n1,2,3,4", "a: frame 0 has no box to start from"),
    ],
)
def test_a_wrong_box_file_is_named_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    """The message says where and what."""
    write_otb(tmp_path, "a", text)
    with pytest.raises(SequenceError, match=message):
        load_dataset(f"otb:{tmp_path}")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "latin-1"])
def test_a_file_that_is_not_utf8_is_named(encoding: str, tmp_path: Path) -> None:
    """Notepad writes UTF-16; the message names the file and what it holds."""
    folder = write_otb(tmp_path, "a", "")
    text = "\ufeff" * (encoding == "utf-16-le") + "1,2,3,4 é\n" * 3
    (folder / "groundtruth_rect.txt").write_bytes(text.encode(encoding, errors="ignore"))
    with pytest.raises(SequenceError, match=r"groundtruth_rect\.txt: expected text in UTF-8, found (UTF-16|0xe9)"):
        load_dataset(f"otb:{tmp_path}")


def test_one_image_too_many_is_cut_and_said(tmp_path: Path) -> None:
    """Published sets often have one image more than boxes."""
    write_otb(tmp_path, "a", "1,2,3,4\n1,2,3,4\n1,2,3,4\n", count=4)
    with pytest.warns(SequenceWarning, match="a: 4 frames but 3 boxes; the last is left out"):
        assert len(load_dataset(f"otb:{tmp_path}")[0]) == 3


def test_empty_lines_at_the_end_are_frames_as_far_as_there_are_any(tmp_path: Path) -> None:
    """The object has left: lines without a box; an editor's empty lines beyond the last frame are none."""
    write_otb(tmp_path, "a", "1,2,3,4\n1,2,3,4\n\n\n", count=4)
    (found,) = load_dataset(f"otb:{tmp_path}")
    assert found.visibility.tolist() == [1, 1, 0, 0]
    (tmp_path / "a" / "groundtruth_rect.txt").write_text("1,2,3,4\n" * 4 + "\n" * 5)
    (found,) = load_dataset(f"otb:{tmp_path}")
    assert found.visibility.tolist() == [1, 1, 1, 1]


def test_images_are_ordered_by_number(tmp_path: Path) -> None:
    """2.png comes before 10.png."""
    write_images(tmp_path / "a" / "img", 11, digits=1)
    (tmp_path / "a" / "groundtruth_rect.txt").write_text("1,2,3,4\n" * 11)
    (found,) = load_dataset(f"otb:{tmp_path}")
    assert [int(frame[0, 0, 0]) for frame in found.frames] == [10 * index for index in range(11)]


def test_meta_is_optional_and_gives_attributes(tmp_path: Path) -> None:
    """The camera's kind is an attribute too; null is no attribute."""
    folder = write_otb(tmp_path, "a", "1,2,3,4\n" * 3)
    (folder / "meta.json").write_text(json.dumps({"camera": "static", "attributes": ["SV", "DEF"]}))
    assert load_dataset(f"otb:{tmp_path}")[0].attributes == ("camera static", "SV", "DEF")
    (folder / "meta.json").write_text("\ufeff" + json.dumps({"attributes": None}), encoding="utf-8")
    assert load_dataset(f"otb:{tmp_path}")[0].attributes == ()


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("meta.json", "{", r"meta\.json: expected JSON, got "),
        ("meta.json", "[" * 20_000, r"meta\.json: expected JSON, got "),
        ("meta.json", "7" * 5000, r"meta\.json: expected JSON, got "),
        ("meta.json", '["SV"]', r"meta\.json: expected an object with camera and attributes, got a list"),
        ("meta.json", '{"attributes": "SV"}', r"meta\.json: expected a list of attributes, got 'SV'"),
        (
            "meta_info.ini",
            "object_class: bear\n",
            r"meta_info\.ini: expected sections of key = value, got File",
        ),
        ("cover.label", "8\n8\n", ""),
        ("cover.label", "8\n", r"cover\.label: expected 3 numbers, got 1"),
        ("cover.label", "8\n8\neight\n", r"cover\.label: expected one number per line, got 'eight'"),
        ("cover.label", "8\n9\n8\n", r"cover\.label: expected numbers from 0 to 8, got 9"),
        ("absence.label", "0\n-1\n0\n", r"absence\.label: expected numbers from 0 to 1, got -1"),
        ("visibility.txt", "1\n1\n1.5\n", r"visibility\.txt: expected numbers from 0 to 1, got 1\.5"),
        ("masks.txt", "m0,0,2,2,0,4\n" * 2, r"masks\.txt: expected 3 masks, got 2"),
        ("masks.txt", "\nm0,0,2,2,0,5\n\n", r"masks\.txt:2: expected runs within 2 × 2 px, got 5 px"),
        ("masks.txt", "\n1,2,3,4\n\n", r"masks\.txt: expected a mask, got '1,2,3,4'"),
        ("absence.label", "0\n" * 9, r"absence\.label: expected 3 numbers, got 9"),
        ("visibility.txt", "1\n" * 9, r"visibility\.txt: expected 3 numbers, got 9"),
    ],
)
def test_an_odd_side_file_is_said_and_ignored(name: str, text: str, message: str, tmp_path: Path) -> None:
    """One line with file, found and expected; truth and frames are what they were without it."""
    folder = tmp_path / "a"
    write_images(folder, 3, suffix=".jpg", digits=8)
    (folder / "groundtruth.txt").write_text("10,11,20,12\n" * 3)
    (folder / name).write_text(text)
    if not message:
        assert load_dataset(f"got10k:{folder}")[0].visibility.tolist() == [1, 1, 1]
        return
    with pytest.warns(SequenceWarning, match=f"{message}.*; the file is ignored") as said:
        (found,) = load_dataset(f"got10k:{folder}")
    assert len(said) == 1
    assert "\n" not in str(said[0].message)
    assert (found.visibility.tolist(), found.attributes) == ([1, 1, 1], ())


@pytest.mark.parametrize("mark", ["", "\ufeff"])
def test_meta_info_may_hold_any_sign(mark: str, tmp_path: Path) -> None:
    """A % is no reference to another value, and a byte order mark no part of a name."""
    folder = tmp_path / "a"
    write_images(folder, 3, suffix=".jpg")
    (folder / "groundtruth.txt").write_text("10,11,20,12\n" * 3)
    text = (
        f"{mark}[METAINFO]\nurl: https://x/%20y\nobject_class: 50% bear\nmotion_class: walking\nobject_class: bear\n"
    )
    (folder / "meta_info.ini").write_text(text, encoding="utf-8")
    assert load_dataset(f"got10k:{folder}")[0].attributes == ("walking", "bear")


def test_hidden_files_and_folders_are_no_frames(tmp_path: Path) -> None:
    """MacOS leaves ._0001.jpg beside 0001.jpg."""
    folder = write_otb(tmp_path, "a", "1,2,3,4\n" * 3)
    (folder / "img" / "._0001.png").write_bytes(b"Mac OS X")
    (folder / "img" / ".hidden.png").write_bytes(b"")
    (folder / "img" / "0004.png").mkdir()
    (found,) = load_dataset(f"otb:{tmp_path}")
    assert [Path(path).name for path in found.frames.paths] == ["0001.png", "0002.png", "0003.png"]


@pytest.mark.skipif(sys.platform in {"darwin", "win32"}, reason="all names are Unicode there")
def test_names_that_are_not_utf8_do_not_end_the_process(tmp_path: Path) -> None:
    """cv2 dies of them: images are decoded from their bytes, a video is refused in one line."""
    odd = Path(os.fsdecode(os.fsencode(tmp_path) + b"/\xe9"))
    write_otb(tmp_path, "plain", "1,2,3,4\n" * 3).rename(odd)
    (found,) = load_dataset(f"otb:{odd}")
    assert [int(frame[0, 0, 0]) for frame in found.frames] == [0, 10, 20]
    (odd / "a.avi").write_bytes(b"no matter")
    (odd / "boxes.txt").write_text("1,2,3,4\n")
    with pytest.raises(SequenceError, match="OpenCV takes names in UTF-8 only"):
        load_dataset(f"video:{odd / 'a.avi'}+{odd / 'boxes.txt'}")


def test_only_what_is_asked_for_is_read(tmp_path: Path) -> None:
    """A damaged sequence stops nobody who does not want it."""
    write_otb(tmp_path, "good", "1,2,3,4\n" * 3)
    write_otb(tmp_path, "bad", "1,2,3\n" * 3)
    assert [one.name for one in load_dataset(f"otb:{tmp_path}", ["good"])] == ["good"]
    with pytest.raises(SequenceError, match=r"bad/groundtruth_rect\.txt:1"):
        load_dataset(f"otb:{tmp_path}")
    with pytest.raises(SequenceError, match=r"unknown sequence ugly in otb:.*; known: bad, good"):
        load_dataset(f"otb:{tmp_path}", ["ugly"])


def test_otb_as_published(tmp_path: Path) -> None:
    """Two truths in one folder, an empty one beside another, and boxes that begin or end within the images."""
    for name in ("Jogging", "Human4"):
        write_images(tmp_path / name / "img", 3)
    for number in (1, 2):
        (tmp_path / "Jogging" / f"groundtruth_rect.{number}.txt").write_text(f"1,2,3,{number}\n" * 3)
    (tmp_path / "Human4" / "groundtruth_rect.1.txt").write_text("")
    (tmp_path / "Human4" / "groundtruth_rect.2.txt").write_text("1,2,3,2\n" * 3)
    write_otb(tmp_path, "David", "1,2,3,4\n" * 471, count=770)
    write_otb(tmp_path, "Football1", "1,2,3,4\n" * 4, count=9)
    write_otb(tmp_path, "Tiger1", "1,2,3,4\n" * 7, count=12)
    write_otb(tmp_path, "Freeman3", "1,2,3,4\n" * 5, count=5)
    found = {one.name: one for one in load_dataset(f"otb:{tmp_path}")}
    assert list(found) == ["David", "Football1", "Freeman3", "Human4", "Jogging-1", "Jogging-2", "Tiger1"]
    assert [found[f"Jogging-{number}"].boxes[0, 3] for number in (1, 2)] == [1, 2]
    assert found["Human4"].boxes[0, 3] == 2
    ends = {
        name: (Path(found[name].frames.paths[0]).stem, Path(found[name].frames.paths[-1]).stem)
        for name in ("David", "Football1", "Tiger1", "Freeman3")
    }
    assert ends == {
        "David": ("0300", "0770"),
        "Football1": ("0001", "0004"),
        "Tiger1": ("0006", "0012"),
        "Freeman3": ("0001", "0005"),
    }


def test_what_shares_a_camera_is_one_scene(tmp_path: Path) -> None:
    """By meta.json, and two truths in one folder by themselves; whatever says nothing is a scene of its own."""
    for name in ("a", "b", "c", "d"):
        write_otb(tmp_path, name, "1,2,3,4\n" * 3)
    for name, scene in (("a", "highway"), ("b", "highway"), ("c", 7)):
        (tmp_path / name / "meta.json").write_text(json.dumps({"scene": scene}))
    (tmp_path / "d" / "groundtruth_rect.txt").rename(tmp_path / "d" / "groundtruth_rect.1.txt")
    (tmp_path / "d" / "groundtruth_rect.2.txt").write_text("1,2,3,4\n" * 3)
    with pytest.warns(
        SequenceWarning, match=r"c/meta\.json: expected the name of a scene, got 7; the file is ignored"
    ):
        found = {one.name: one.scene for one in load_dataset(f"otb:{tmp_path}")}
    assert found == {"a": "highway", "b": "highway", "c": "c", "d-1": "d", "d-2": "d"}


def test_a_csv_names_scenes(tmp_path: Path) -> None:
    """Of sequences of any layout, over what they say themselves; those that are not named keep theirs."""
    for name in ("a", "b", "c"):
        write_otb(tmp_path / "set", name, "1,2,3,4\n" * 3)
    (tmp_path / "set" / "b" / "meta.json").write_text(json.dumps({"scene": "yard"}))
    table = tmp_path / "scenes.csv"
    table.write_text("scene,sequence\nhall,a\nhall,b\nelsewhere,z\n")
    folder, found = _open(tmp_path / "out", None, f"otb:{tmp_path / 'set'}", scenes=table)
    assert [one.scene for one in found] == [one.scene for one in folder.read_sequences()] == ["hall", "hall", "c"]
    for text, message in (
        ("sequence\na\n", r"scenes\.csv: expected the columns sequence and scene, got sequence"),
        ("", "got none"),
        ("sequence,scene\na,hall\nb,\n", r"scenes\.csv:3: expected one scene of a sequence, got '' of 'b'"),
        ("sequence,scene\na,hall\na,yard\n", r"scenes\.csv:3: expected one scene .*, got 'yard' of 'a'"),
    ):
        table.write_text(text)
        with pytest.raises(SequenceError, match=message):
            read_scenes(table)


@pytest.fixture(scope="module")
def rendered() -> list[Rendered]:
    """A sequence in colour whose target vanishes, a gray one, and one of a thermal camera, short."""
    colour, gray = SUITES["smoke"][0], SUITES["smoke"][3]
    motion = replace(colour.target.motion, hidden=((2, 4),))
    return [
        render(replace(colour, frames=8, target=replace(colour.target, motion=motion))),
        render(replace(gray, frames=6)),
        render(replace(gray, frames=6, name="thermal", deep=Deep(7300, 8100))),
    ]


@pytest.mark.parametrize("layout", ["otb", "vot", "got10k", "mot", "coco", "video", "flow"])
def test_one_truth_through_every_export_and_reader(layout: str, rendered: list[Rendered], tmp_path: Path) -> None:
    """Boxes, visibility, attributes and pixels come back to the last bit, and so do all scores of a tracker."""
    kind = "otb" if layout == "flow" else layout
    for drawn in rendered:
        if layout == "video" and drawn.spec.deep:
            continue
        folder = FORMATS[layout](drawn, tmp_path)
        where = f"{folder / 'video.mkv'}+{folder / 'groundtruth.txt'}" if kind == "video" else str(folder)
        (found,) = load_dataset(f"{kind}:{where}")
        assert (found.name, found.scene) == (drawn.name, drawn.name)
        assert_array_equal(found.boxes, drawn.boxes)
        assert_array_equal(found.visibility, drawn.visibility)
        assert found.attributes == drawn.attributes
        assert (found.regions, found.by_region) == (from_spec(drawn.spec).regions, False)
        for frame, true in zip(found.frames, drawn.frames, strict=True):
            assert_array_equal(frame, true)
        answers = drawn.boxes + np.array([3.1, -2.2, 0.3, 0.7])
        ok = np.arange(len(drawn)) % 3 != 1
        size = (drawn.frames.shape[2], drawn.frames.shape[1])
        scores = [
            summarise(frame_scores(truth.boxes, truth.visibility, answers, ok, size)) for truth in (drawn, found)
        ]
        assert_array_equal(list(scores[0].values()), list(scores[1].values()))


def test_deep_and_gray_images_stay_what_they_are(tmp_path: Path) -> None:
    """A thermal camera's 16 bits are not cut to 8, and gray is not made colour."""
    folder = write_otb(tmp_path, "a", "1,2,3,4\n" * 3)
    deep = np.full((48, 64), 7300, dtype=np.uint16)
    for path in (folder / "img").iterdir():
        cv2.imwrite(str(path), deep)
    (found,) = load_dataset(f"otb:{folder}")
    for frame in found.frames:
        assert_array_equal(frame, deep)


def test_files_that_have_not_changed_are_not_hashed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The digest is kept by place, size and time, unless the file is so new that its time could hide a change."""
    monkeypatch.setattr(datasets, "_digest_folder", lambda: tmp_path)
    folder = write_otb(tmp_path, "a", "1,2,3,4\n" * 3)
    read: list[Path] = []
    read_bytes = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: (read.append(path), read_bytes(path))[1])

    def images_read() -> int:
        read.clear()
        load_dataset(f"otb:{folder}")
        # The first one is decoded in any case: it tells the size.
        return sum(path.suffix == ".png" for path in read) - 1

    assert [images_read(), images_read()] == [3, 3]
    for path in (folder / "img").iterdir():
        os.utime(path, (1e9, 1e9))
    assert [images_read(), images_read()] == [3, 0]
    os.utime(folder / "img" / "0002.png", (1e9, 1.1e9))
    assert [images_read(), images_read()] == [3, 0]


def test_got10k_labels_give_visibility(tmp_path: Path) -> None:
    """Cover counts eighths, absence overrules it, the meta file gives the classes; the first pixel is 0."""
    folder = tmp_path / "GOT-10k_Val_000001"
    write_images(folder, 3, suffix=".jpg", digits=8)
    (folder / "groundtruth.txt").write_text("10.0,11.0,20.0,12.0\n" * 3)
    (folder / "cover.label").write_text("8\n4\n8\n")
    (folder / "absence.label").write_text("0\n0\n1\n")
    (folder / "meta_info.ini").write_text("[METAINFO]\nobject_class: bear\nmotion_class: walking\n")
    (found,) = load_dataset(f"got10k:{tmp_path}")
    assert_allclose(found.boxes[0], [10, 11, 20, 12])
    assert_array_equal(found.visibility, [1.0, 0.5, 0.0])
    assert found.attributes == ("walking", "bear")


def test_vot_keeps_its_frames_in_color(tmp_path: Path) -> None:
    """VOT layout: color/ beside groundtruth.txt."""
    write_images(tmp_path / "bag" / "color", 3, suffix=".jpg", digits=8)
    (tmp_path / "bag" / "groundtruth.txt").write_text("10,20,30,10,50,20,30,40\n" * 3)
    assert_allclose(load_dataset(f"vot:{tmp_path}")[0].boxes[2], [10, 10, 40, 30])


def test_masks_of_vot_have_their_bounding_box(tmp_path: Path) -> None:
    """Window, then lengths of runs row by row, the first of pixels outside: two pixels of the second row."""
    write_images(tmp_path / "a", 3)
    path = tmp_path / "a" / "groundtruth.txt"
    path.write_text("m10,20,4,3,5,2\nm0,0,2,2,4\n10,20,4,3\n")
    (found,) = load_dataset(f"vot:{tmp_path}")
    assert_allclose(found.boxes, [[11, 21, 2, 1], [np.nan] * 4, [10, 20, 4, 3]])
    assert (found.regions, found.by_region) == (("m11,21,2,1,0,2", "", ""), True)
    assert found.cut(2).regions == found.regions[:2]
    path.write_text("m10,20,4,3,5,1,1,1\nm0,0,2,2,4\n10,20,4,3\n")
    assert load_dataset(f"vot:{tmp_path}")[0].digest != found.digest
    path.write_text("m10,20,4,3,5,200\n")
    with pytest.raises(SequenceError, match=r"groundtruth\.txt:1: expected runs within 4 × 3 px, got 205 px"):
        load_dataset(f"vot:{tmp_path}")


def test_got10k_from_its_root_and_its_test_split(tmp_path: Path) -> None:
    """Splits are found below the root; of the test split only the first box is known, and nothing else is judged."""
    for split, rows in (("val", 3), ("test", 1)):
        folder = tmp_path / split / f"GOT-10k_{split.title()}_000001"
        write_images(folder, 3, suffix=".jpg", digits=8)
        (folder / "groundtruth.txt").write_text("10,11,20,12\n" * rows)
        (folder / "meta_info.ini").write_text("[METAINFO]\n")
    for where in (f"got10k:{tmp_path}", str(tmp_path)):
        test, val = load_dataset(where)
        assert (test.name, val.name) == ("GOT-10k_Test_000001", "GOT-10k_Val_000001")
        assert_array_equal(val.visibility, 1.0)
        assert_array_equal(test.visibility, [1, np.nan, np.nan])
    scores = summarise(frame_scores(test.boxes, test.visibility, val.boxes, np.array([True, False, True]), test.size))
    counts = {name: scores.pop(name) for name in ("visible", "invisible", "covered")}
    assert set(counts.values()) == {0.0}
    assert np.isnan(list(scores.values())).all()


@pytest.mark.parametrize("kind", ["got10k", "vot"])
def test_a_listed_sequence_that_is_not_there_is_named(kind: str, tmp_path: Path) -> None:
    """Of a split that was half copied: said of all, and of that one; the others are read by name."""
    folder = tmp_path / "val" / "one"
    write_images(folder, 3, suffix=".jpg", digits=8)
    (folder / "groundtruth.txt").write_text("10,11,20,12\n" * 3)
    (folder.parent / "list.txt").write_text("one\r\ntwo\r\n\n")
    for where in (tmp_path, folder.parent):
        for only in ([], ["two"]):
            with pytest.raises(SequenceError, match=r"list\.txt names two, but there is no .*two/groundtruth\.txt"):
                load_dataset(f"{kind}:{where}", only)
        assert [one.name for one in load_dataset(f"{kind}:{where}", ["one"])] == ["one"]
    assert [one.name for one in load_dataset(f"{kind}:{folder}")] == ["one"]


def test_lasot_says_when_the_object_is_out_of_view(tmp_path: Path) -> None:
    """Folders of classes; one line of flags each."""
    folder = tmp_path / "airplane" / "airplane-1"
    write_images(folder / "img", 4)
    (folder / "groundtruth.txt").write_text("10,11,20,12\n" * 4)
    (folder / "full_occlusion.txt").write_text("0,1,0,0")
    (folder / "out_of_view.txt").write_text("0,0,0,1\n")
    for where in (f"lasot:{tmp_path}", str(tmp_path)):
        (found,) = load_dataset(where)
        assert (found.name, found.visibility.tolist()) == ("airplane-1", [1, 0, 1, 0])
        assert_allclose(found.boxes[0], [10, 11, 20, 12])


def test_mot_gives_one_sequence_per_object(tmp_path: Path) -> None:
    """From its first frame to its last, absent in between; frames and pixels count from 1, flag 0 is not judged."""
    folder = tmp_path / "MOT-01"
    write_images(folder / "img1", 5, digits=6)
    (folder / "gt").mkdir()
    rows = ["2,1,11,12,20,12,1,1,0.5", "4,1,13,12,20,12,1,1,1", "1,7,1,1,5,5,1,1,1", "2,7,1,1,5,5,1,1,1"]
    (folder / "gt" / "gt.txt").write_text("\n".join([*rows, "1,9,1,1,5,5,0,8,1", "3,8,1,1,5,5,1,1,1"]))
    for where in (f"mot:{tmp_path}", str(tmp_path)):
        one, seven = load_dataset(where)
        assert (one.name, seven.name, one.scene, seven.scene) == ("MOT-01-1", "MOT-01-7", "MOT-01", "MOT-01")
        assert_allclose(one.boxes, [[10, 11, 20, 12], [np.nan] * 4, [12, 11, 20, 12]])
        assert_allclose(one.visibility, [0.5, 0, 1])
        assert [int(frame[0, 0, 0]) for frame in one.frames] == [10, 20, 30]
    assert [one.name for one in load_dataset(f"mot:{tmp_path}", ["MOT-01-7"])] == ["MOT-01-7"]
    for row, message in (
        ("9,1,1,1,5,5,1,1,1", "expected a frame from 1 to 5, got 9"),
        ("2,1,1,1,5,5,1,1,1", "a second box of the same object in one frame"),
        ("0,1,1,1,5,5,1,1,1", "expected a frame from 1 to 5, got 0"),
        ("1,-1,1,1,5,5,1,1,1", "expected the number of an object, got -1 in '1,-1,1,"),
        ("1,1.5,1,1,5,5,1,1,1", "expected the number of an object, got 1.5 in '1,1.5,1,"),
        ("1,2,3", "expected 6 to 10 numbers, got 3 in '1,2,3'"),
        ("1," * 15 + "1", "expected 6 to 10 numbers, got 16 in '1,1,"),
        ("1,2,3,4,5,x", "expected a number, got 'x'"),
        ("1,2,3,4,5,1e400", "expected a number, got '1e400'"),
        ("1,2,3,4,5,6,1,1,7", "expected a visibility from 0 to 1, got 7"),
    ):
        (folder / "gt" / "gt.txt").write_text(f"{rows[0]}\n{row}\n")
        with pytest.raises(SequenceError, match=rf"gt\.txt:2: {message}"):
            load_dataset(f"mot:{tmp_path}")


def test_coco_of_several_videos_and_tracks(tmp_path: Path) -> None:
    """Images by video and frame, annotations by track; what is no such file is said."""
    images, notes = [], []
    for video, name in ((1, "a"), (2, "b")):
        write_images(tmp_path / name, 3)
        for frame in range(3):
            number = 10 * video + 2 - frame  # ids run against the frames
            images.append(
                {"id": number, "video_id": video, "frame_id": frame, "file_name": f"{name}/{frame + 1:04d}.png"}
            )
            notes += [{"image_id": number, "track_id": t, "bbox": [frame, t, 5, 6]} for t in range(video)]
    path = tmp_path / "instances.json"
    data = {"images": images, "annotations": notes, "videos": [{"id": 1, "name": "a"}, {"id": 2, "name": "b"}]}
    path.write_text(json.dumps(data))
    for where in (f"coco:{path}", str(path)):
        found = {one.name: one for one in load_dataset(where)}
        assert list(found) == ["a", "b-0", "b-1"]
        assert_allclose(found["b-1"].boxes, [[0, 1, 5, 6], [1, 1, 5, 6], [2, 1, 5, 6]])
        assert [int(frame[0, 0, 0]) for frame in found["b-1"].frames] == [0, 10, 20]
        assert found["b-1"].scene == "b"
    for box in ([1, 2, 3], [1, 2, 3, float("nan")], [1, 2, 3, "wide"], None):
        path.write_text(json.dumps(data | {"annotations": [{"id": 99, "image_id": 10, "bbox": box}]}))
        with pytest.raises(
            SequenceError, match=r"json: annotation 99: expected a box of four numbers, got (\[1|None)"
        ):
            load_dataset(f"coco:{path}")
    for text, message in (("{}", "got KeyError: 'videos'"), ("[", "got JSONDecodeError"), ("[]", "got TypeError")):
        path.write_text(text)
        with pytest.raises(
            SequenceError, match=rf"instances\.json: expected COCO's images and annotations, {message}"
        ):
            load_dataset(f"coco:{path}")


@pytest.mark.parametrize("rows", ["", "1,1,1,1,5,5,0,1,1\n2,1,1,1,5,5,0,1,1\n", "2,1,1,1,5,5,1,1,1\n"])
def test_many_objects_of_which_none_can_be_followed_are_said(rows: str, tmp_path: Path) -> None:
    """No rows, none to be judged, or an object of a single frame: a run of nothing would look well."""
    folder = tmp_path / "MOT-01"
    write_images(folder / "img1", 3, digits=6)
    (folder / "gt").mkdir()
    (folder / "gt" / "gt.txt").write_text(rows)
    path = tmp_path / "none.json"
    images = [{"id": number, "file_name": f"MOT-01/img1/{number:06d}.png"} for number in (1, 2, 3)]
    path.write_text(json.dumps({"images": images, "annotations": []}))
    for where in (f"mot:{tmp_path}", f"coco:{path}"):
        with pytest.raises(
            SequenceError, match=r"no object to follow in .*: expected one with boxes in at least two"
        ):
            load_dataset(where)


def test_a_nest_of_brackets_is_no_coco(tmp_path: Path) -> None:
    """What Python cannot parse, however it fails, is one line with the file's name."""
    path = tmp_path / "a.json"
    path.write_text("[" * 20_000)
    with pytest.raises(SequenceError, match=r"a\.json: expected COCO's images and annotations, got RecursionError"):
        load_dataset(f"coco:{path}")


def test_masks_of_coco(tmp_path: Path) -> None:
    """Polygons, or runs down the columns, as numbers or in five bits a sign (`=3421`, of pycocotools)."""
    write_images(tmp_path / "img", 5)
    pixels = np.zeros((6, 5), dtype=bool)
    pixels[1:4, 2], pixels[2:6, 3], pixels[0, 4] = True, True, True
    counts: list[object] = ["=3421", [13, 3, 4, 5, 5], [30]]
    images = [{"id": t, "file_name": f"img/{t + 1:04d}.png"} for t in range(5)]
    masks: list[object] = [{"size": [6, 5], "counts": runs} for runs in counts]
    masks += [[[2, 1, 3, 1, 3, 4, 2, 4], [3, 2, 4, 2, 4, 6, 3, 6], [4, 0, 5, 0, 5, 1, 4, 1]], []]
    notes = [{"id": 7, "image_id": t, "bbox": [2, 0, 3, 6], "segmentation": masks[t]} for t in range(5)]
    path = tmp_path / "annotations.json"
    path.write_text(json.dumps({"images": images, "annotations": notes}))
    (found,) = load_dataset(f"coco:{tmp_path}")
    text = Mask(0, 0, pixels).text
    assert (found.regions, found.by_region) == ((text, text, "", text, ""), True)
    notes[3]["visibility"] = 1.5
    path.write_text(json.dumps({"images": images, "annotations": notes}))
    with pytest.raises(SequenceError, match=r"annotation 7: expected a visibility from 0 to 1, got 1\.5"):
        load_dataset(f"coco:{tmp_path}")
    notes[3]["segmentation"] = [[2, 1, 3, 1]]
    path.write_text(json.dumps({"images": images, "annotations": notes}))
    with pytest.raises(
        SequenceError, match=r"annotation 7: expected x, y of three corners or more, got \[2\.0, 1\.0"
    ):
        load_dataset(f"coco:{tmp_path}")


def test_youtube_vis_lists_boxes_by_object(tmp_path: Path) -> None:
    """One annotation per object, null where it is not seen; boxes are those of the masks where there are none."""
    write_images(tmp_path / "0043f083b5", 3)
    mask = {"size": [6, 5], "counts": [13, 3, 4, 5, 5]}
    files = [f"0043f083b5/{t + 1:04d}.png" for t in range(3)]
    notes = [
        {"id": 1, "video_id": 7, "bboxes": [[1, 2, 3, 4], None, [2, 2, 3, 4]], "segmentations": [mask, None, None]},
        {"id": 2, "video_id": 7, "segmentations": [mask, [[2, 0, 5, 0, 5, 6, 2, 6]], None]},
    ]
    path = tmp_path / "instances.json"
    path.write_text(json.dumps({"videos": [{"id": 7, "file_names": files}], "annotations": notes}))
    first, second = load_dataset(f"coco:{path}")
    assert (first.name, second.name, first.scene) == ("0043f083b5-1", "0043f083b5-2", "0043f083b5")
    assert_allclose(first.boxes, [[1, 2, 3, 4], [np.nan] * 4, [2, 2, 3, 4]])
    assert first.visibility.tolist() == [1, 0, 1]
    assert [bool(text) for text in first.regions] == [True, False, False]
    assert_allclose(second.boxes, [[2, 0, 3, 6]] * 2)
    assert second.regions == (first.regions[0], "m2,0,3,6,0,18")
    notes[0]["bboxes"] = [[1, 2, 3, 4]]
    path.write_text(json.dumps({"videos": [{"id": 7, "file_names": files}], "annotations": notes}))
    with pytest.raises(SequenceError, match="annotation 1: expected 3 boxes and masks, got 1 and 3"):
        load_dataset(f"coco:{path}")


def test_a_csv_of_boxes(tmp_path: Path) -> None:
    """Corners or sides by their headings, several objects, outside as CVAT says it; a video or a folder of images."""
    write_clip(tmp_path / "clip.avi", 3)
    write_images(tmp_path / "frames", 3)
    corners = "frame,track_id,label,xtl,ytl,xbr,ybr,outside\n0,0,car,10,11,30,23,0\n1,0,car,1,2,3,4,1\n"
    corners += "2,0,car,12.5,11,30,23,0\n0,4,dog,1,1,2,2,0\n1,4,dog,1,1,2,2,0\n"
    table = tmp_path / "boxes.csv"
    for video in ("clip.avi", "frames"):
        for kind in ("csv:", ""):
            table.write_text(corners)
            car, dog = load_dataset(f"{kind}{tmp_path / video}+{table}")
            stem = video.removesuffix(".avi")
            assert (car.name, dog.name, car.scene, dog.scene) == (f"{stem}-0", f"{stem}-4", stem, stem)
            assert_allclose(car.boxes, [[10, 11, 20, 12], [np.nan] * 4, [12.5, 11, 17.5, 12]])
            assert_array_equal(car.visibility, [1, 0, 1])
        table.write_text("x,y,width,height,frame\n1,2,3,4,0\n2,2,3,4,1\n")
        assert_allclose(load_dataset(f"csv:{tmp_path / video}+{table}")[0].boxes[1], [2, 2, 3, 4])
    for text, message in (
        ("frame,x,y\n0,1,2\n", r"expected columns of a box, such as xtl, ytl, xbr, ybr, got frame, x, y"),
        ("frame,visibility,x,y,w,h\n0,-1,1,2,3,4\n", r"boxes\.csv:2: expected a visibility from 0 to 1, got -1"),
        ("frame,x,y,w,h\n0,1,2,3,4\n1,1,2,3,4a\n", r"boxes\.csv:3: expected a number, got '4a'"),
        ("frame,x,y,w,h\n0,1,2,3,4\n3,1,2,3,4\n", r"boxes\.csv:3: expected a frame from 0 to 2, got 3"),
        ("a,b\n1,2\n", r"expected a column `frame`, or one of Label Studio's JSON, got a, b"),
    ):
        table.write_text(text)
        with pytest.raises(SequenceError, match=message):
            load_dataset(f"csv:{tmp_path / 'clip.avi'}+{table}")


def test_a_csv_of_label_studio(tmp_path: Path) -> None:
    """Keyframes in per cent of 64 × 48 px, lines between them, nothing after one that is not enabled."""
    write_clip(tmp_path / "clip.avi", 8)
    box = {"x": 25, "y": 25, "width": 50, "height": 25}
    keys = [
        {"frame": 1, "enabled": True, **box},
        {"frame": 3, "enabled": False, **box, "x": 50},
        {"frame": 6, "enabled": True, **box},
    ]
    table = tmp_path / "export.csv"
    rows = [("8f3a-other.avi", []), ("8f3b-clip.avi", keys)]
    with table.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["id", "video", "box"])
        writer.writerows(
            [n, f"/data/upload/{name}", json.dumps([{"sequence": s}])] for n, (name, s) in enumerate(rows)
        )
    (found,) = load_dataset(f"csv:{tmp_path / 'clip.avi'}+{table}")
    expected = np.array(
        [[16, 12, 32, 12], [24, 12, 32, 12], [32, 12, 32, 12], *[[np.nan] * 4] * 2, *[[16, 12, 32, 12]] * 3]
    )
    assert_allclose(found.boxes, expected)
    (tmp_path / "clip.avi").rename(tmp_path / "8f3.avi")
    with pytest.raises(SequenceError, match=r"export\.csv: expected one row about 8f3\.avi, got 0"):
        load_dataset(f"csv:{tmp_path / '8f3.avi'}+{table}")


@pytest.mark.parametrize("layout", ["otb", "vot", "got10k", "mot", "coco"])
def test_a_layout_is_detected(layout: str, rendered: list[Rendered], tmp_path: Path) -> None:
    """A path alone will do."""
    FORMATS[layout](rendered[1], tmp_path)
    assert canonical_dataset(str(tmp_path)) == f"{layout}:{tmp_path}"
    assert_array_equal(load_dataset(str(tmp_path))[0].boxes, rendered[1].boxes)


def test_what_is_no_layout_is_said(tmp_path: Path) -> None:
    """And what there is."""
    write_clip(tmp_path / "clip.avi", 2)
    expected = r"expected a data set's folder, COCO's \.json, or VIDEO\+BOXFILE, got the file .*clip\.avi"
    with pytest.raises(SequenceError, match=expected):
        load_dataset(str(tmp_path / "clip.avi"))
    with pytest.raises(
        SequenceError, match=r"no data set that we know in .*; expected KIND:WHERE with KIND of otb, vot"
    ):
        load_dataset(str(tmp_path))


def write_clip(path: Path, count: int) -> None:
    """A lossless video of the gray levels 10 t."""
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (64, 48))
    for index in range(count):
        writer.write(np.full((48, 64, 3), 10 * index, dtype=np.uint8))
    writer.release()


def test_a_video_and_its_boxes(tmp_path: Path) -> None:
    """A lossless video gives the frames that were written; a line that is empty says that the object is absent."""
    path = tmp_path / "clip.avi"
    write_clip(path, 4)
    (tmp_path / "boxes.txt").write_text("10,11,20,12\n" * 2 + "\n\n")
    (found,) = load_dataset(f"video:{path}+{tmp_path / 'boxes.txt'}")
    assert (found.name, len(found), found.size) == ("clip", 4, (64, 48))
    assert [int(frame.mean()) for frame in found.frames] == [0, 10, 20, 30]
    assert found.visibility.tolist() == [1, 1, 0, 0]


@pytest.mark.parametrize(("rows", "said"), [(6, "error"), (2, "error"), (5, "warning"), (3, "warning")])
def test_a_video_of_another_length_than_its_boxes_is_said(rows: int, said: str, tmp_path: Path) -> None:
    """One too many of either is left out with a warning; more is no truth of this video."""
    write_clip(tmp_path / "clip.avi", 4)
    (tmp_path / "boxes.txt").write_text("10,11,20,12\n" * rows)
    reference, message = f"video:{tmp_path / 'clip.avi'}+{tmp_path / 'boxes.txt'}", f"clip: 4 frames but {rows} boxes"
    if said == "error":
        with pytest.raises(SequenceError, match=message):
            load_dataset(reference)
    else:
        with pytest.warns(SequenceWarning, match=message):
            assert len(load_dataset(reference)[0]) == min(rows, 4)


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("otb", "expected KIND:WHERE with KIND of otb, vot, got10k, lasot, mot, coco, csv, video"),
        ("davis:/data", "unknown data set 'davis:/data'"),
        ("otb:/no/such/folder", "no such folder: /no/such/folder"),
        ("video:/no/such.avi", r"expected VIDEO\+BOXFILE"),
        ("video:/no/such.avi+/no/boxes.txt", r"no such file: /no/such.avi"),
    ],
)
def test_a_wrong_reference_says_what_was_expected(reference: str, message: str) -> None:
    """No traceback for a typing error."""
    with pytest.raises(SequenceError, match=message):
        load_dataset(reference)


def test_an_empty_folder_is_said(tmp_path: Path) -> None:
    """The message names the file that makes a folder a sequence."""
    with pytest.raises(SequenceError, match=r"no folder with a groundtruth_rect\*\.txt"):
        load_dataset(f"otb:{tmp_path}")


def test_the_digest_follows_frames_boxes_and_length(tmp_path: Path) -> None:
    """Anything that could change a score changes the hash."""
    folder = write_otb(tmp_path, "a", "1,2,3,4\n" * 3)
    (before,) = load_dataset(f"otb:{tmp_path}")
    assert load_dataset(f"otb:{tmp_path}")[0].digest == before.digest
    assert before.cut(2).digest != before.digest
    assert len(before.cut(2)) == 2
    assert before.cut(None) is before.cut(3) is before
    (folder / "groundtruth_rect.txt").write_text("1,2,3,4\n1,2,3,4\n1,2,3,5\n")
    moved = load_dataset(f"otb:{tmp_path}")[0].digest
    cv2.imwrite(str(folder / "img" / "0002.png"), np.zeros((48, 64, 3), dtype=np.uint8))
    assert len({before.digest, moved, load_dataset(f"otb:{tmp_path}")[0].digest}) == 3


def test_a_frame_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    """Reading stops there, after the frames before it."""
    write_images(tmp_path, 3)
    (tmp_path / "0002.png").write_bytes(b"no picture")
    frames = iter(FrameSource(tuple(str(path) for path in sorted(tmp_path.iterdir())), "images", 3))
    assert next(frames).shape == (48, 64, 3)
    with pytest.raises(FrameSourceError, match=r"cannot read the frame .*0002\.png"):
        next(frames)


@pytest.mark.real
def test_the_real_sequences_are_read(real: Path) -> None:
    """Every folder that holds a truth, with the first box inside its frame."""
    found = load_dataset(f"otb:{real}")
    assert len(found) == len(list(real.glob("*/groundtruth_rect.txt"))) >= 18
    for sequence in found:
        x, y, w, h = sequence.boxes[0]
        assert (x >= -1, y >= -1, x + w <= sequence.size[0] + 1, y + h <= sequence.size[1] + 1) == (True,) * 4
