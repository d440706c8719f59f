"""Sequences: every way in which people write boxes down, and every way in which a data set can be wrong."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from eval.framesource import FrameSource, FrameSourceError
from eval.sequences import SequenceError, load_dataset, load_suite, read_boxes

BOXES = np.array([[10, 11, 20, 12], [12.5, 11, 20, 12], [15, 11.25, 20, 12]])


def write_images(folder: Path, count: int, *, suffix: str = ".png", digits: int = 4) -> None:
    """Frames of the gray level 10 t."""
    folder.mkdir(parents=True, exist_ok=True)
    for index in range(count):
        cv2.imwrite(str(folder / f"{index + 1:0{digits}d}{suffix}"), np.full((48, 64, 3), 10 * index, dtype=np.uint8))


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


def test_polygons_become_their_bounding_box(tmp_path: Path) -> None:
    """VOT's eight numbers are x, y of four corners."""
    path = tmp_path / "groundtruth.txt"
    path.write_text("10,20,30,10,50,20,30,40\n")
    assert_allclose(read_boxes(path, first=0), [[10, 10, 40, 30]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3\n1,2,3,4\n1,2,3,4", r"groundtruth_rect.txt:1: expected 4 numbers or a polygon of 8, got 3"),
        ("1,2,3,4\n1,two,3,4\n1,2,3,4", r"groundtruth_rect.txt:2: expected numbers, got '1,two,3,4'"),
        ("1,2,3,4", "a: 3 images but 1 boxes"),
        ("nan,nan,nan,nan\n1,2,3,4\n1,2,3,4", "a: frame 0 has no box to start from"),
    ],
)
def test_a_wrong_box_file_is_named_with_its_line(text: str, message: str, tmp_path: Path) -> None:
    """The message says where and what."""
    write_otb(tmp_path, "a", text)
    with pytest.raises(SequenceError, match=message):
        load_dataset(f"otb:{tmp_path}")


def test_one_image_too_many_is_cut(tmp_path: Path) -> None:
    """Published sets often have one image more than boxes."""
    write_otb(tmp_path, "a", "1,2,3,4\n1,2,3,4\n1,2,3,4\n", count=4)
    assert len(load_dataset(f"otb:{tmp_path}")[0]) == 3


def test_images_are_ordered_by_number(tmp_path: Path) -> None:
    """2.png comes before 10.png."""
    write_images(tmp_path / "a" / "img", 11, digits=1)
    (tmp_path / "a" / "groundtruth_rect.txt").write_text("1,2,3,4\n" * 11)
    (found,) = load_dataset(f"otb:{tmp_path}")
    assert [int(frame[0, 0, 0]) for frame in found.frames] == [10 * index for index in range(11)]


def test_meta_is_optional_and_gives_attributes(tmp_path: Path) -> None:
    """The camera's kind is an attribute too; null is no attribute; what is no JSON is said."""
    folder = write_otb(tmp_path, "a", "1,2,3,4\n" * 3)
    (folder / "meta.json").write_text(json.dumps({"camera": "static", "attributes": ["SV", "DEF"]}))
    assert load_dataset(f"otb:{tmp_path}")[0].attributes == ("camera static", "SV", "DEF")
    (folder / "meta.json").write_text(json.dumps({"attributes": None}))
    assert load_dataset(f"otb:{tmp_path}")[0].attributes == ()
    (folder / "meta.json").write_text("{")
    with pytest.raises(SequenceError, match=r"meta\.json is not JSON"):
        load_dataset(f"otb:{tmp_path}")


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


def test_a_video_and_its_boxes(tmp_path: Path) -> None:
    """A lossless video gives the frames that were written; boxes beyond its end are dropped."""
    path = tmp_path / "clip.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"FFV1"), 25.0, (64, 48))
    for index in range(4):
        writer.write(np.full((48, 64, 3), 10 * index, dtype=np.uint8))
    writer.release()
    (tmp_path / "boxes.txt").write_text("10,11,20,12\n" * 6)
    (found,) = load_dataset(f"video:{path}+{tmp_path / 'boxes.txt'}")
    assert (found.name, len(found), found.size) == ("clip", 4, (64, 48))
    assert [int(frame.mean()) for frame in found.frames] == [0, 10, 20, 30]


@pytest.mark.parametrize(
    ("reference", "message"),
    [
        ("otb", "expected KIND:WHERE with KIND of otb, vot, got10k, video"),
        ("coco:/data", "unknown data set 'coco:/data'"),
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
    with pytest.raises(SequenceError, match=r"no folder with a groundtruth_rect\.txt"):
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


def test_a_suite_is_rendered_once_and_is_what_the_laboratory_drew() -> None:
    """From the cache come the same bytes, and they are those of ``render``."""
    from datasets_synthetic import SUITES, render

    first, again = load_suite("smoke"), load_suite("smoke")
    assert [sequence.digest for sequence in first] == [sequence.digest for sequence in again]
    assert [sequence.name for sequence in first] == [spec.name for spec in SUITES["smoke"]]
    drawn = render(SUITES["smoke"][0])
    assert_array_equal(np.stack(list(first[0].frames)), drawn.frames)
    assert_array_equal(first[0].boxes, drawn.boxes)
    assert first[0].attributes == tuple(drawn.attributes)


def test_an_unknown_suite_lists_the_known() -> None:
    """The message helps."""
    with pytest.raises(SequenceError, match=r"unknown suite 'smoky'; known: smoke, standard"):
        load_suite("smoky")


@pytest.mark.real
def test_the_real_sequences_are_read(real: Path) -> None:
    """All eighteen, with the boxes inside their frames."""
    found = load_dataset(f"otb:{real}")
    assert len(found) == 18
    for sequence in found:
        x, y, w, h = sequence.boxes[0]
        assert (x >= -1, y >= -1, x + w <= sequence.size[0] + 1, y + h <= sequence.size[1] + 1) == (True,) * 4
