"""What went wrong, and where: failures by hand, a planted jump found again on the page of its sequence."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from eval import pages, report
from eval.diagnosis import Failure, failures, strips
from eval.framesource import FrameSource
from eval.pages import page_name, write_page
from eval.report import write_report
from eval.results import COMPLETED, Folder, Run, Trajectory
from eval.sequences import Sequence
from eval.statistics import ScoredRun, score_frames
from eval.tables import summarise_folder

pytestmark = pytest.mark.once

COUNT, SIZE = 40, (96, 72)
JUMP = 17
COLOURS = {"Jumps": "#d55e00", "Exact": "#0072b2"}
NAN = float("nan")


@pytest.fixture
def sequence(tmp_path: Path) -> Sequence:
    """Frame t has the gray level 5 t; a box of 20 × 16 moves right by 1 px a frame."""
    levels = np.arange(COUNT, dtype=np.uint8)[:, np.newaxis, np.newaxis] * np.uint8(5)
    np.save(tmp_path / "levels.npy", np.tile(levels, (1, SIZE[1], SIZE[0])))
    boxes = np.array([[10.0 + index, 20, 20, 16] for index in range(COUNT)])
    source = FrameSource((str(tmp_path / "levels.npy"),), "array", COUNT)
    return Sequence("levels/1", source, boxes, np.ones(COUNT), ("fast",), SIZE, "digest", {"noise": 2.5})


def run_of(sequence: Sequence, tracker: str, boxes: NDArray[np.float64], ok: NDArray[np.bool_] | None = None) -> Run:
    """A run that answered so."""
    answered = Trajectory(np.ones(COUNT, dtype=bool) if ok is None else ok, boxes, np.full(COUNT, 0.5))
    stamp = {"digest": sequence.digest, "tracker": "a:b", "params": {}, "time": "2026-01-01"}
    return Run("k", tracker, sequence.name, 0, 0, COMPLETED, answered, stamp)


def jumping(sequence: Sequence) -> Run:
    """The truth, but for a jump out of the box at a known frame."""
    boxes = sequence.boxes.copy()
    boxes[JUMP:, 1] += 30.0
    return run_of(sequence, "Jumps", boxes)


def scored(sequence: Sequence, *runs: Run) -> list[ScoredRun]:
    """Runs with their frames scored."""
    return score_frames(runs, [sequence])


def without(sequence: Sequence, first: int, stop: int) -> Sequence:
    """The object out of sight for some frames."""
    sequence.visibility[first:stop] = 0.0
    return sequence


def test_a_planted_jump_is_found_where_it_is(sequence: Sequence) -> None:
    """From that frame to the last, with the IoU before it and then."""
    (found,) = failures(scored(sequence, jumping(sequence))[0])
    assert found == Failure("Jumps", "far off", JUMP, COUNT - 1, 1.0, 0.0)
    (strip,) = strips(scored(sequence, jumping(sequence)))
    assert strip.spans == [(0, 1, "none"), (1, JUMP, "iou4"), (JUMP, COUNT, "far")]


def test_each_kind_of_failure_by_hand(sequence: Sequence) -> None:
    """False where it is seen, True where it is not, a fall of the IoU on the object; short gaps do not part."""
    hidden = without(sequence, 20, 30)
    boxes, ok = sequence.boxes.copy(), np.ones(COUNT, dtype=bool)
    ok[[5, 6, 8]] = False  # two frames apart: one failure
    ok[22:30] = False  # right, after two frames of saying True
    boxes[33:, 2] = 8.0  # 8 of 20 px wide
    found = failures(scored(hidden, run_of(hidden, "T", boxes, ok))[0])
    assert [(one.kind, one.first, one.last) for one in found] == [
        ("false False", 5, 8),
        ("false True", 20, 21),
        ("drop", 33, 33),
    ]
    assert (found[2].before, found[2].after) == (1.0, pytest.approx(0.4))
    assert np.isnan(found[1].after)
    (strip,) = strips(scored(hidden, run_of(hidden, "T", boxes, ok)))
    assert [fill for _, _, fill in strip.spans] == [
        "none", "iou4", "falsefalse", "iou4", "falsefalse", "iou4", "falsetrue", "absent", "iou4", "iou2",
    ]  # fmt: skip


def test_nothing_fails_without_a_fault(sequence: Sequence) -> None:
    """The truth has no failures, hidden frames or not."""
    hidden = without(sequence, 20, 30)
    right = run_of(hidden, "Exact", hidden.boxes.copy(), hidden.visibility > 0)
    assert failures(scored(hidden, right)[0]) == []


def pictures_of(html: str) -> list[tuple[int, float]]:
    """Frame numbers of the pictures on a page, and their gray levels in a corner without boxes or digits."""
    found = re.findall(r'alt="frame (\d+)" src="data:image/jpeg;base64,([^"]+)"', html)
    decoded = [
        (int(frame), cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), 0)) for frame, text in found
    ]
    return [(frame, float(picture[-20:, :20].mean())) for frame, picture in decoded]


def test_the_page_shows_the_jump(sequence: Sequence, tmp_path: Path) -> None:
    """In the strip, in the list, as pictures of the frames before and at it, and in what a click is answered from."""
    exact = run_of(sequence, "Exact", sequence.boxes.copy())
    items = scored(sequence, exact, jumping(sequence))
    path = write_page(tmp_path / "pages", items, COLOURS, shown=("Jumps",))
    assert path.name == page_name("levels/1")
    html = path.read_text(encoding="utf-8")
    assert f'<rect class="far" x="{JUMP}" width="{COUNT - JUMP}" height="1"/>' in html
    assert f'<tr data-frame="{JUMP}">' in html
    assert f"asked : {JUMP});" in html  # what is shown first
    assert f"Jumps, far off at {JUMP}: IoU 1.00 → 0.00" in html
    (before, level_before), (at, level_at) = pictures_of(html)
    assert (before, at) == (JUMP - 1, JUMP)
    assert (level_before, level_at) == (pytest.approx(5 * (JUMP - 1), abs=2), pytest.approx(5 * JUMP, abs=2))
    data = json.loads(re.findall(r'<script id="data" type="application/json">(.*?)</script>', html)[0])
    assert data["trackers"]["Jumps"]["iou"][JUMP - 1 : JUMP + 1] == [1.0, 0.0]
    assert [data["trackers"][name]["state"][JUMP] for name in ("Exact", "Jumps")] == [1, 2]
    assert "drawn: noise 2.5" in html
    assert "No video beside this page" in html
    assert not re.search(r"\bnan\b", html)


def test_a_video_lies_beside_its_page(sequence: Sequence, tmp_path: Path) -> None:
    """On request; every frame is in it."""
    path = write_page(tmp_path, scored(sequence, jumping(sequence)), COLOURS, shown=("Jumps",), video=True)
    film = path.with_suffix(".webm")
    assert f'src="{film.name}"' in path.read_text(encoding="utf-8")
    capture = cv2.VideoCapture(str(film))
    count = 0
    while capture.read()[0]:
        count += 1
    capture.release()
    assert count == COUNT


def test_a_page_has_a_largest_size(sequence: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What there is no room for is left out and said, the shortest failures first; so it is without frames."""
    ok = np.ones(COUNT, dtype=bool)
    ok[5], ok[12:20], ok[30:32] = False, False, False
    items = scored(sequence, run_of(sequence, "Jumps", sequence.boxes.copy(), ok))
    whole = write_page(tmp_path, items, COLOURS, shown=("Jumps",)).read_text(encoding="utf-8")
    assert [frame for frame, _ in pictures_of(whole)] == [4, 5, 11, 12, 29, 30]
    monkeypatch.setattr(pages, "PICTURE_BYTES", len(whole) // 2)
    smaller = write_page(tmp_path, items, COLOURS, shown=("Jumps",)).read_text(encoding="utf-8")
    shown = [frame for frame, _ in pictures_of(smaller)]
    assert shown[:2] == [11, 12]
    assert 2 <= len(shown) < 6
    assert f"{3 - len(shown) // 2} more" in smaller
    (tmp_path / "levels.npy").unlink()
    bare = write_page(tmp_path, items, COLOURS, shown=("Jumps",), video=True).read_text(encoding="utf-8")
    assert "3 more are not shown: the frames are not on this machine any more" in bare
    assert not pictures_of(bare)
    assert not list(tmp_path.glob("*.webm"))


def test_the_report_has_a_largest_size(sequence: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without room for contact sheets there are the names and the pages still, with what failed."""
    folder = Folder(tmp_path / "results")
    folder.write_manifest("suite:test", [sequence])
    folder.write_run(jumping(sequence))
    summary = summarise_folder(folder, chosen="Jumps")
    monkeypatch.setattr(report, "SHEET_BYTES", 0)
    write_report(summary, folder, tmp_path / "report.html")
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "data:image/jpeg" not in html
    assert f'href="pages/{page_name("levels/1")}"' in html
    assert "1 × far off" in html
