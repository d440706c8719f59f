"""Suites that are distributions: a draw is a pure function, keeps what its theme promises, covers its ranges."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import Counter

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from datasets_synthetic import SUITES, SequenceSpec, canonical, draw, draw_mixed, parameters, render, suite, truth
from datasets_synthetic.pose import stage_of
from datasets_synthetic.themes import NUISANCES, THEMES

pytestmark = pytest.mark.once

GONE = {"leaves", "full_occlusion", "empty", "blank"}
"""Themes whose target may be out of sight altogether."""


def edges(spec: SequenceSpec) -> NDArray[np.float64]:
    """Low x, y and high x, y of the target in every frame, shape (T, 4)."""
    stage = stage_of(spec)
    rows = []
    for t in range(spec.frames):
        points = np.concatenate([pose.outline() for pose in stage.actor(stage.target_index, float(t))])
        rows.append([*points.min(axis=0), *points.max(axis=0)])
    return np.array(rows)


def test_a_draw_depends_on_theme_seed_and_index_alone() -> None:
    """The number of sequences changes none of them; another seed, index or theme is another draw."""
    few, many = suite("drawn:7:3"), suite("drawn:90:3")
    assert many[:7] == few
    assert suite("drawn/pan:2:3") == (draw("pan", 3, 0), draw("pan", 3, 1))
    assert draw_mixed(3, 5) == few[5]
    assert few[5] == draw(few[5].theme, 3, 5)
    targets = {spec.target for spec in (*many, *suite("drawn:90:4"), *suite("drawn/pan:9:3"))}
    assert len(targets) >= 180


def test_a_draw_does_not_depend_on_the_process() -> None:
    """Another process, with other string hashes, draws the same."""
    code = "from datasets_synthetic import suite; print(*[spec.digest() for spec in suite('drawn:80:11')])"
    env = {**os.environ, "PYTHONHASHSEED": "4711"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=env)
    assert done.stdout.split() == [spec.digest() for spec in suite("drawn:80:11")]


def test_themes_come_by_turns() -> None:
    """Every theme is drawn equally often, whatever the seed."""
    counts = Counter(spec.theme for spec in suite(f"drawn:{3 * len(THEMES)}:8"))
    assert counts == dict.fromkeys(THEMES, 3)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("drawn", "unknown suite 'drawn'"),
        ("drawn:x:1", "unknown suite 'drawn:x:1'.*drawn:N:SEED"),
        ("drawn:0:1", "at least 1 sequence, got 'drawn:0:1'"),
        ("drawn/storm:3:1", "unknown theme 'storm'; known: rotate_in_place"),
        ("standard:3", "unknown suite 'standard:3'"),
    ],
)
def test_wrong_names_of_suites_are_refused(name: str, message: str) -> None:
    """A wrong name is named, with what there is."""
    with pytest.raises(ValueError, match=message):
        canonical(name)


def test_wrong_theme_is_refused() -> None:
    """A theme that does not exist is named."""
    with pytest.raises(ValueError, match="unknown theme 'storm'"):
        draw("storm", 1, 0)


@pytest.mark.parametrize("name", ["drawn:3", "drawn:3:clock"])
def test_the_clock_gives_a_seed_that_is_said(name: str) -> None:
    """Without a seed the clock's is taken, and the name holds it: the same draw can be had again."""
    said = canonical(name)
    assert int(said.split(":")[2]) > 1_700_000_000
    assert canonical(said) == said
    assert canonical("smoke") == "smoke"
    assert suite("smoke") == SUITES["smoke"]


@pytest.mark.parametrize("theme", list(THEMES))
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**40), index=st.integers(0, 10**6))
def test_targets_stay_in_the_frame(theme: str, seed: int, index: int) -> None:
    """Whatever the draw, the target is whole in the first frame, and stays so unless the theme says it leaves."""
    spec = draw(theme, seed, index)
    assert 60 <= spec.frames <= 100
    assert spec.size in ((320, 240), (240, 180), (480, 360))
    places = edges(spec)
    held = places[:1] if theme == "leaves" else places
    assert held[:, :2].min() >= 0
    assert (held[:, 2:] <= spec.size).all()
    assert spec.blank(0) is None
    assert all(first > 0 for first, _ in spec.target.motion.hidden)
    assert spec.scene.background.kind != spec.target.texture.kind or spec.scene.background.kind in (
        "clouds", "speckle",
    )  # fmt: skip


@pytest.mark.parametrize("theme", list(THEMES))
def test_every_theme_renders_with_exact_truth(theme: str) -> None:
    """The mask's extent is the true box to a pixel where all is seen; nothing is seen where the truth says so."""
    # Rendering is what this costs: the shortest and smallest of a few.
    sequence = render(
        min((draw(theme, 21, index) for index in range(2, 8)), key=lambda one: one.frames * one.size[0])
    )
    assert sequence.visibility[0] > 0.999
    for t in range(len(sequence)):
        if sequence.visibility[t] == 0:
            assert not sequence.masks[t].any()
            assert np.isnan(sequence.visible_boxes[t]).all()
        elif sequence.visibility[t] > 0.999:
            ys, xs = np.nonzero(sequence.masks[t])
            found = np.array([xs.min(), ys.min(), xs.max() + 1, ys.max() + 1], dtype=np.float64)
            x, y, w, h = sequence.boxes[t]
            inner = np.abs(found - np.array([x, y, x + w, y + h]))
            # Sharp tips of a star or a bar cover less than half of their last pixels.
            assert inner.max() <= 4.0
    seen = sequence.visibility > 0.3
    assert seen.mean() > (0.4 if theme in GONE else 0.75)


def test_what_is_hidden_is_what_the_theme_says() -> None:
    """Blank frames show nothing and have no valid flow; an empty scene is still the scene."""
    blank = render(draw("blank", 5, 3))
    absent = np.flatnonzero(blank.visibility == 0)
    assert all(blank.spec.blank(int(t)) for t in absent)
    first = blank.spec.blanks[0].first
    assert not blank.flow(first - 1)[1].any()
    assert not blank.flow(first)[1].any()
    assert blank.flow(0)[1].any() or first == 1
    empty = render(draw("empty", 5, 3))
    (span,) = empty.spec.target.motion.hidden
    assert (empty.visibility[span[0] : span[1]] == 0).all()
    assert empty.visibility[: span[0]].min() > 0


@pytest.mark.parametrize("theme", ["full_occlusion", "leaves"])
def test_targets_go_out_of_sight_and_come_back(theme: str) -> None:
    """Nothing of them is seen for a while in the middle, all of them in the end; some come back elsewhere."""
    kinds = set()
    for spec in suite(f"drawn/{theme}:16:3"):
        shares = truth(spec).visibility
        (hidden,) = np.nonzero(shares == 0)
        assert len(hidden) >= 1, spec.name
        assert shares[0] > 0.99, spec.name
        assert shares[-1] > 0.99, spec.name
        assert 5 < hidden[0] <= hidden[-1] < spec.frames - 5, spec.name
        kinds.add(spec.target.motion.path.kind)
    assert kinds == ({"line", "knots"} if theme == "full_occlusion" else {"knots"})


def test_the_distribution_covers_its_ranges() -> None:
    """Over a few hundred draws the extremes of what the themes say are met, and nothing beyond them."""
    spins = [parameters(spec) for spec in suite("drawn/rotate_in_place:200:1")]
    rates = np.abs([row["spin"] for row in spins])
    assert 0.03 <= rates.min() < 0.045
    assert 0.135 < rates.max() <= 0.151
    shapes = Counter(row["shape"] for row in spins)
    assert {"bar", "fan2", "fan3", "fan4", "fan5", "star", "cross", "L", "T", "U"} <= set(shapes)
    assert 0.3 < np.mean(["rests" in row for row in spins]) < 0.6
    halves = np.array([max(row["width"], row["height"]) / 2 for row in spins if row["frame"] == "320x240"])
    assert halves.min() < 18
    assert 52 < halves.max() <= 60
    fast = [row for row in map(parameters, suite("drawn/fast:60:1")) if not {"zoom", "jitter", "roll"} & set(row)]
    speeds = np.array([row["speed"] for row in fast])
    assert speeds.min() > 5
    assert speeds.max() < 15
    small = [max(spec.target.size) for spec in suite("drawn/small:60:1")]
    assert 8 <= min(small) < 11
    assert 18 < max(small) <= 20
    qualities = [row["jpeg"] for row in map(parameters, suite("drawn/jpeg:80:1"))]
    assert min(qualities) < 25
    assert max(qualities) > 65


def test_nuisances_are_few_and_all_are_met() -> None:
    """None to three of them, each kind once, and every one of them somewhere in a few hundred draws."""
    specs = suite("drawn:300:9")
    counts = Counter(len(spec.attributes) - 1 for spec in specs)
    assert set(counts) == {0, 1, 2, 3}
    assert counts[1] > counts[3]
    added = Counter(name for spec in specs for name in spec.attributes[1:])
    assert set(added) == set(NUISANCES)


def test_parameters_are_flat_and_name_what_is_unusual() -> None:
    """A table row: plain values only, ordinary ones left out."""
    row = parameters(draw("white_balance", 1, 0))
    assert all(isinstance(value, str | int | float) for value in row.values())
    assert row["theme"] == "white_balance"
    assert {"red", "blue"} & set(row)
    assert "theme" not in parameters(SUITES["smoke"][0])
    assert {row["blanks"].split()[0] for row in map(parameters, suite("drawn/blank:40:1"))} == {
        "black", "white", "gray", "static",
    }  # fmt: skip
