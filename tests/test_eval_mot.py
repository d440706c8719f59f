"""Trackers of several objects: the suite, its truth, and scores whose values are known beforehand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from datasets_synthetic import Truth, canonical, crowd, frames, objects, render, suite, truth
from eval.mot.command import main_mot, write_answers, write_truth
from eval.mot.score import COLUMNS, Answers, combined, scored
from eval.mot.trackers import NearestBox, make_tracker

pytestmark = pytest.mark.once

pytest.importorskip("trackeval")

SIZE = (200, 100)
FRAMES = 20


def moving(x: float, y: float, speed: float, seen: float = 1.0) -> Truth:
    """Truth of a square of 20 px that goes to the right."""
    boxes = np.array([(x + speed * t, y, 20.0, 20.0) for t in range(FRAMES)])
    return Truth(boxes, boxes, np.full(FRAMES, seen))


TWO = (moving(10, 10, 4.0), moving(150, 60, -4.0))


def as_answers(truth: tuple[Truth, ...], names: dict[int, int] | None = None) -> list[list[Any]]:
    """What a tracker that knows the truth answers."""
    names = names or {k: k + 1 for k in range(len(truth))}
    return [[(names[k], tuple(each.boxes[t])) for k, each in enumerate(truth)] for t in range(FRAMES)]


def row(truth: tuple[Truth, ...], answers: Answers) -> dict[str, float]:
    """Scores as a table has them."""
    return scored(truth, answers, SIZE).row()


def test_who_knows_the_truth_scores_exactly_one() -> None:
    """Whatever it calls the objects."""
    for names in (None, {0: 77, 1: 5}):
        assert row(TWO, as_answers(TWO, names)) == {
            "HOTA": 1.0, "DetA": 1.0, "AssA": 1.0, "IDF1": 1.0, "MOTA": 1.0, "IDSW": 0, "FP": 0, "FN": 0,
        }  # fmt: skip


def test_swapped_identities_are_counted() -> None:
    """Two objects change names in the middle: two switches, half of each identity is right, places all are."""
    answers = as_answers(TWO)[: FRAMES // 2] + as_answers(TWO, {0: 2, 1: 1})[FRAMES // 2 :]
    found = row(TWO, answers)
    assert found["IDSW"] == 2
    assert found["MOTA"] == pytest.approx(1 - 2 / (2 * FRAMES))
    assert found["IDF1"] == pytest.approx(0.5)
    assert found["DetA"] == 1.0
    # Of the 30 frames that an identity and an object have between them, 10 are in common.
    assert found["AssA"] == pytest.approx(1 / 3)
    assert found["HOTA"] == pytest.approx(np.sqrt(1 / 3))


def test_missing_and_invented_objects_are_counted() -> None:
    """One of two objects is never found, and one that is not there always."""
    answers = [[row[0], (9, (60.0, 80.0, 10.0, 10.0))] for row in as_answers(TWO)]
    found = row(TWO, answers)
    assert (found["FN"], found["FP"], found["IDSW"]) == (FRAMES, FRAMES, 0)
    assert found["MOTA"] == pytest.approx(0.0)
    assert found["IDF1"] == pytest.approx(0.5)


def test_nothing_answered_scores_nothing() -> None:
    """Not even a division by zero."""
    found = row(TWO, [[] for _ in range(FRAMES)])
    assert (found["HOTA"], found["IDF1"], found["MOTA"], found["FN"]) == (0.0, 0.0, 0.0, 2 * FRAMES)


def test_what_is_hardly_seen_is_not_owed() -> None:
    """Who follows an object through an occlusion is neither rewarded nor punished."""
    hidden = (TWO[0], moving(150, 60, -4.0, seen=0.1))
    assert row(hidden, as_answers(TWO))["HOTA"] == 1.0
    assert row(hidden, [answer[:1] for answer in as_answers(TWO)])["HOTA"] == 1.0
    far = [[answer[0], (2, (100.0, 5.0, 20.0, 20.0))] for answer in as_answers(TWO)]
    assert row(hidden, far)["FP"] == FRAMES


def test_counts_are_added_over_sequences() -> None:
    """One sequence right, one without any answer."""
    whole, none = scored(TWO, as_answers(TWO), SIZE), scored(TWO, [[] for _ in range(FRAMES)], SIZE)
    both = combined({"a": whole, "b": none}).row()
    assert tuple(both) == COLUMNS
    assert (both["FN"], both["MOTA"], both["DetA"], both["AssA"]) == (2 * FRAMES, 0.5, 0.5, 1.0)


def test_answers_that_cannot_be_meant_are_refused() -> None:
    """Too few frames; one identity in two places."""
    with pytest.raises(ValueError, match="expected answers to 20 frames, got 3"):
        scored(TWO, as_answers(TWO)[:3], SIZE)
    twice = [[(1, answer[0][1]), (1, answer[1][1])] for answer in as_answers(TWO)]
    with pytest.raises(ValueError, match="each identity once in frame 0"):
        scored(TWO, twice, SIZE)


def test_files_count_frames_and_pixels_from_one(tmp_path: Path) -> None:
    """As MOTChallenge does."""
    write_answers(tmp_path / "a.txt", [[], [(7, (0.0, 1.5, 20.0, 10.0))]])
    assert (tmp_path / "a.txt").read_text() == "2,7,1.000,2.500,20.000,10.000,1,-1,-1,-1\n"
    write_truth(tmp_path / "t.txt", (moving(10, 10, 4.0, seen=0.1),))
    assert (tmp_path / "t.txt").read_text().splitlines()[1] == "2,1,15.000,11.000,20.000,20.000,0,1,0.100"


def test_crowds_are_what_they_say() -> None:
    """Three to eight things, each pair of them in one place at one moment; the draw is a function of its key."""
    for index in (0, 3, 5):
        spec = crowd(5, index)
        movers = [actor for actor in (*spec.scene.behind, spec.target) if actor.motion.path.kind != "hold"]
        assert len(movers) == 3 + index
        assert f"{len(movers)} objects" in spec.attributes
        ways = [truth.boxes[:, :2] + truth.boxes[:, 2:] / 2 for truth in objects(spec)]
        for first in range(0, len(movers) - 1, 2):
            apart = np.hypot(*(ways[first] - ways[first + 1]).T)
            assert apart.min() < 12.0 < apart[0]
    assert suite("crowd:2:5") == (crowd(5, 0), crowd(5, 1))
    assert canonical("crowd:2:05") == "crowd:2:5"
    with pytest.raises(ValueError, match="unknown suite 'crowd/x:2:5'"):
        canonical("crowd/x:2:5")


def test_truth_of_objects_is_that_of_the_target_and_adds_up() -> None:
    """The target is the last of them; what is seen of an object is what others leave of it."""
    spec = suite("crowd:1:5")[0]
    found = objects(spec)
    *numbers, masks = found[-1]
    *others, same = truth(spec)
    for one, other in zip(numbers, others, strict=True):
        np.testing.assert_array_equal(one, other)
    assert [(x, y, pixels.tolist()) for x, y, pixels in masks] == [(x, y, part.tolist()) for x, y, part in same]
    labels = render(spec).labels
    for each in (0, 1):
        # One part each, so that label k + 1 is object k.
        pixels = (labels == each + 1).sum(axis=(1, 2))
        inside = found[each].visibility > 0.99
        assert pixels[found[each].visibility < 0.9].max(initial=0) < pixels[inside].max()
    assert min(each.visibility.min() for each in found) < 0.7


def test_nearest_box_keeps_identities_apart() -> None:
    """Two regions that pass each other at a distance keep their names; a gap shorter than its patience is bridged."""
    masks = []
    for t in range(FRAMES):
        mask = np.zeros((100, 200), np.uint8)
        for each in TWO:
            x, y, w, h = each.boxes[t].astype(int)
            mask[y : y + h, x : x + w] = 1
        masks.append(mask * (t not in (8, 9)))
    following = iter(masks)
    tracker = NearestBox(lambda _: next(following))
    answers = [tracker.update(masks[0]) for _ in range(FRAMES)]
    found = row(TWO, answers)
    assert (found["IDSW"], found["FP"]) == (0, 0)
    assert found["FN"] == 2 * (2 + 2)  # two frames until a region is believed, two without any


def test_unknown_trackers_are_refused() -> None:
    """Names that are none, modules that are not there."""
    with pytest.raises(ValueError, match="unknown tracker 'SORT'; known: AutomaticTracker"):
        make_tracker("SORT")
    with pytest.raises(ValueError, match="cannot load 'no\\.such:thing'"):
        make_tracker("no.such:thing")


def test_a_tracker_of_ones_own_is_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`pkg.module:factory` beside ours; answers and truth are there as files."""
    from eval.__main__ import main

    command = ["mot", "--suite", "crowd:1:5", "--out", str(tmp_path), "--jobs", "1"]
    assert main([*command, "--trackers", "tests.mot_tracker:Blind", "FrameDifferencing + nearest"]) == 0
    said = capsys.readouterr().out
    assert "HOTA" in said
    assert "tests.mot_tracker:Blind" in said
    folder = tmp_path / "mot-crowd-5"
    overall = (folder / "tables" / "overall.csv").read_text().splitlines()
    assert overall[0].split(",")[:2] == ["tracker", "HOTA"]
    assert overall[2].startswith("tests.mot_tracker:Blind,0.0,")
    assert (folder / "answers" / "tests_mot_tracker_Blind" / "crowd_5_0.txt").read_text() == ""
    first = (folder / "truth" / "crowd_5_0.txt").read_text().splitlines()[0]
    assert len(first.split(",")) == 9
    assert main([*command, "--trackers", "tests.mot_tracker:Wrong"]) == 1
    assert "expected (identity, (x, y, w, h)) of each object" in capsys.readouterr().err
    assert sum(1 for _ in frames(crowd(5, 0))) == 120


def test_where_nothing_moves_there_is_nobody_to_follow(tmp_path: Path) -> None:
    """A sequence without objects is named before anything is run."""
    with pytest.raises(ValueError, match="smoke_rotate of smoke: nothing moves from its place"):
        main_mot(suite="smoke", trackers=("AutomaticTracker",), out=tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_what_makes_no_tracker_is_refused() -> None:
    """A name that is there but cannot be called."""
    with pytest.raises(ValueError, match="got 'math:pi', which cannot be called"):
        make_tracker("math:pi")
