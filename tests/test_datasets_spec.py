"""Specs: what they refuse, how they hash; the suites; the vocabularies."""

from __future__ import annotations

import json
import os
import pickle
import subprocess
import sys
from collections.abc import Callable
from dataclasses import field, fields, make_dataclass, replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datasets_synthetic import SUITES, SequenceSpec, from_plain, suite, to_plain
from datasets_synthetic.deform import DEFORMS
from datasets_synthetic.effects import box_blur
from datasets_synthetic.motion import PATHS, shake
from datasets_synthetic.pose import stage_of
from datasets_synthetic.shapes import SHAPES
from datasets_synthetic.spec import Actor, Blank, Camera, Deform, Effect, Motion, Path, Scene, Shadow, Texture
from datasets_synthetic.textures import PHOTOGRAPHS, TEXTURES, paint, sample

pytestmark = pytest.mark.once

STILL = Motion(Path("hold", (50, 50)))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Texture("velvet"), "unknown texture 'velvet'; known: astronaut, brick"),
        (lambda: Texture("grass", contrast=-1), "contrast of at least 0, got -1"),
        (lambda: Texture("grass", shrink=0), "shrink in 1–8, got 0"),
        (lambda: Path("teleport"), "unknown path 'teleport'; known: hold, line"),
        (lambda: Path("knots"), "at least two knots"),
        (lambda: Path("knots", knots=((0.5, 0, 0), (0.1, 1, 1))), "rising fraction"),
        (lambda: Motion(Path("hold"), growth=(1.0, 0.0)), "positive growth"),
        (lambda: Deform("melt", 0.1, 1), "unknown deformation 'melt'"),
        (lambda: Deform("squash", 1.5, 1), "strength in"),
        (lambda: Effect("rain"), "unknown effect 'rain'"),
        (lambda: Effect("jpeg", 0.0), "JPEG quality in 1–100"),
        (lambda: Shadow((3, 3), 1.5), "shadow strength"),
        (lambda: Actor("dragon", (20, 20), Texture("grass"), STILL), "unknown shape 'dragon'; known: ellipse"),
        (lambda: Actor("box", (1, 20), Texture("grass"), STILL), "at least 2 px"),
        (
            lambda: Actor("box", (20, 20), Texture("grass"), STILL, surface=(Effect("noise"),)),
            "unknown surface effect",
        ),
        (lambda: Camera(zoom=(1.0, -1.0)), "positive zoom"),
        (lambda: Camera(shutter=2.0), "shutter in"),
        (lambda: Camera(jitter=-1.0), "jitter of at least 0"),
        (lambda: replace(SUITES["smoke"][0], frames=1), "at least 2 frames, got 1"),
        (lambda: replace(SUITES["smoke"][0], size=(8, 100)), "at least 16 × 16"),
        (lambda: replace(SUITES["smoke"][0], effects=(Effect("glint"),)), "unknown picture effect 'glint'"),
        (lambda: Blank("green", 3, 9), "unknown blank 'green'; known: black"),
        (lambda: Blank("black", 9, 9), "0 < first < stop, got 9 and 9"),
        (lambda: Effect("red", 1.2, ramp=(0.6, 0.2)), "rising ramp within 0–1"),
        (lambda: Motion(Path("hold"), hidden=((7, 7),)), r"span \(first, stop\) of frames, got \(7, 7\)"),
        (lambda: Motion(Path("hold"), rests=((3, 9), (5, 12))), "rests one after the other"),
    ],
)
def test_bad_specs_are_refused_with_the_value(make: Callable[[], object], message: str) -> None:
    """A wrong value is named at once, with what was expected."""
    with pytest.raises(ValueError, match=message):
        make()


def test_specs_are_hashable_printable_data() -> None:
    """A spec can be a key, survives pickling, and its repr makes it again."""
    spec = SUITES["smoke"][2]
    assert pickle.loads(pickle.dumps(spec)) == spec
    assert len({spec, replace(spec)}) == 1
    names = {
        c.__name__: c for c in (SequenceSpec, Actor, Camera, Deform, Effect, Motion, Path, Scene, Shadow, Texture)
    }
    assert eval(repr(spec), names) == spec


def test_digest_follows_every_field() -> None:
    """Any change of a spec changes its digest; equal specs share it."""
    spec = SUITES["smoke"][0]
    changed = [
        replace(spec, seed=spec.seed + 1),
        replace(spec, frames=spec.frames + 1),
        replace(spec, camera=Camera(jitter=0.1)),
        replace(spec, target=replace(spec.target, mirror=True)),
        replace(spec, effects=()),
    ]
    digests = {each.digest() for each in (spec, *changed)}
    assert len(digests) == len(changed) + 1
    assert replace(spec).digest() == spec.digest()


def test_a_new_field_leaves_the_digests_as_they_are() -> None:
    """What has its default is not in the digest, so that results outlive the vocabulary's growth."""
    spec = SUITES["smoke"][0]
    grown = make_dataclass("SequenceSpec", [("rain", float, field(default=0.0))], bases=(SequenceSpec,), frozen=True)
    held = {each.name: getattr(spec, each.name) for each in fields(spec)}
    assert grown(**held).digest() == spec.digest()
    assert grown(**held, rain=0.5).digest() != spec.digest()


def test_digest_does_not_depend_on_the_process() -> None:
    """String hashing differs between processes; digests do not."""
    code = "from datasets_synthetic import SUITES; print(*[s.digest() for v in SUITES.values() for s in v])"
    env = {**os.environ, "PYTHONHASHSEED": "12345"}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=env)
    assert done.stdout.split() == [spec.digest() for suite in SUITES.values() for spec in suite]


def test_suites_have_what_they_promise() -> None:
    """Sizes, lengths and names are as the documentation says; every sequence has attributes."""
    drawn = {"develop", "heldout", "vanish_develop", "vanish_heldout"}
    assert {"smoke", "standard", "vanish", "compressed", "deep"} | drawn == set(SUITES)
    assert all(spec.deep for spec in SUITES["deep"])
    assert len(SUITES["smoke"]) == 4
    assert len(SUITES["standard"]) >= 24
    assert len(SUITES["develop"]) == len(SUITES["heldout"]) >= 24
    assert len(SUITES["vanish"]) >= 6
    assert len(SUITES["compressed"]) == 12
    for title, specs in SUITES.items():
        names = [spec.name for spec in specs]
        assert len(set(names)) == len(names)
        assert all(spec.attributes for spec in specs)
        if title != "smoke":
            assert all(spec.frames >= 80 for spec in specs)
            assert all(spec.size in ((320, 240), (640, 480)) for spec in specs)


def test_standard_covers_the_difficulties() -> None:
    """Each difficulty the suite is to hold is an attribute of some sequence."""
    held = {attribute for spec in SUITES["standard"] for attribute in spec.attributes}
    wanted = (
        "translation rotation out_of_plane glint morph flicker deformation plain_object plain_background "
        "low_contrast noise fast small large scale shadow stop occlusion full_occlusion jitter pan zoom "
        "distractor blur jpeg gray articulated"
    )
    assert set(wanted.split()) <= held


def test_develop_and_heldout_share_no_sequence() -> None:
    """The same recipes, never the same draw."""
    develop, heldout = SUITES["develop"], SUITES["heldout"]
    seeds = {spec.seed for spec in develop} | {spec.target.texture.seed for spec in develop}
    assert not seeds & ({spec.seed for spec in heldout} | {spec.target.texture.seed for spec in heldout} - {0})
    for first, second in zip(develop, heldout, strict=True):
        assert first.name.rpartition("_")[0] == second.name.rpartition("_")[0]
        assert replace(second, name="") != replace(first, name="")


def test_specs_survive_as_plain_data() -> None:
    """Through JSON and back they are the same text, so the same digest, whichever fields they use."""
    for spec in (*(each for specs in SUITES.values() for each in specs), *suite("drawn:80:3")):
        data = json.loads(json.dumps(to_plain(spec)))
        assert repr(from_plain(SequenceSpec, data)) == repr(spec)
        assert len(json.dumps(data)) < 2500


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ([], "expected the fields of a SequenceSpec, got"),
        ({"nom": "x"}, "unknown field nom of a SequenceSpec"),
        ({"name": "x", "target": {"shape": "dragon"}}, "missing 3 required"),
        ({"name": "x", "camera": {"zoom": [1.0]}}, "zip"),
    ],
)
def test_plain_data_that_is_no_spec_is_refused(data: object, message: str) -> None:
    """What is wrong is said."""
    with pytest.raises((TypeError, ValueError), match=message):
        from_plain(SequenceSpec, data)


def _edges(spec: SequenceSpec) -> np.ndarray:
    stage = stage_of(spec)
    rows = []
    for t in range(spec.frames):
        points = np.concatenate([pose.outline() for pose in stage.actor(stage.target_index, float(t))])
        rows.append([*points.min(axis=0), *points.max(axis=0)])
    return np.array(rows)


@pytest.mark.parametrize("suite", ["vanish", "vanish_develop", "vanish_heldout"])
def test_vanishing_targets_start_in_sight_and_come_back(suite: str) -> None:
    """They are whole in the first frames and in the last, and away for at least eight frames between."""
    for spec in SUITES[suite]:
        edges = _edges(spec)
        seen = (edges[:, :2] >= 0).all(axis=1) & (edges[:, 2:] <= spec.size).all(axis=1)
        for first, stop in spec.target.motion.hidden:
            seen[first:stop] = False
        for wall in spec.scene.front:
            x, half = wall.motion.path.start[0], wall.size[0] / 2
            seen &= (edges[:, 2] < x - half) | (edges[:, 0] > x + half)
        assert seen[:15].all(), spec.name
        assert seen[-5:].all(), spec.name
        assert (~seen).sum() >= 8, spec.name


@pytest.mark.parametrize("suite", ["smoke", "standard", "develop", "heldout"])
def test_targets_stay_in_the_frame(suite: str) -> None:
    """Nothing leaves the picture where it is not meant to."""
    for spec in SUITES[suite]:
        edges = _edges(spec)
        assert edges[:, :2].min() >= 0, spec.name
        assert (edges[:, 2:] <= spec.size).all(), spec.name


def test_fast_is_ten_pixels_per_frame() -> None:
    """The sequence `fast` moves by about 10 px in every frame, `small` is 16 px, `large` about 240."""
    specs = {spec.name: spec for spec in SUITES["standard"]}
    centres = _edges(specs["fast"]).reshape(-1, 2, 2).mean(axis=1)
    steps = np.hypot(*np.diff(centres, axis=0).T)
    assert steps.mean() == pytest.approx(10.0, abs=0.5)
    assert steps.min() > 8
    assert specs["small"].target.size == (16, 16)
    assert specs["large"].target.size[0] == 240
    sizes = np.diff(_edges(specs["growing"]).reshape(-1, 2, 2), axis=1)[:, 0]
    np.testing.assert_allclose(sizes[-1] / sizes[0], 2.0)


@pytest.mark.parametrize("kind", list(DEFORMS))
@settings(max_examples=40, deadline=None)
@given(strength=st.floats(0.05, 0.8), phase=st.floats(-2, 2), seed=st.integers(0, 99))
def test_deformations_can_be_undone(kind: str, strength: float, phase: float, seed: int) -> None:
    """The inverse of the forward map is the point itself, wherever it faces the viewer."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(-20, 20, 50), rng.uniform(-15, 15, 50)
    maps = DEFORMS[kind]
    moved = maps.forward(x, y, 20.0, 15.0, strength, phase)
    seen = np.isfinite(moved[0])
    back = maps.inverse(moved[0][seen], moved[1][seen], 20.0, 15.0, strength, phase)
    np.testing.assert_allclose(back, (x[seen], y[seen]), atol=1e-4)


@pytest.mark.parametrize("kind", list(PATHS))
def test_paths_begin_at_their_start_and_never_jump(kind: str) -> None:
    """Every path starts where it says and moves in steps that shrink with the time step."""
    path = Path(
        kind, (10, 20), (60, 40), amplitude=5, cycles=2.0, knots=((0.0, 10, 20), (0.5, 30, 30), (1.0, 60, 40))
    )
    places = np.array([PATHS[kind](path, s) for s in np.linspace(0, 1, 401)])
    start = (60, 20) if kind == "orbit" else (10, 20)
    np.testing.assert_allclose(places[0], start, atol=1e-9)
    assert np.hypot(*np.diff(places, axis=0).T).max() < 2.0
    if kind in ("line", "ease", "weave", "stop_and_go", "knots"):
        np.testing.assert_allclose(places[-1], (60, 40), atol=1e-9)


def test_stop_and_go_rests() -> None:
    """Half of each stretch is rest: exactly the same place."""
    path = Path("stop_and_go", (0, 0), (90, 0), cycles=3)
    xs = [PATHS["stop_and_go"](path, s)[0] for s in np.linspace(0, 1, 301)]
    assert np.mean(np.diff(xs) == 0) == pytest.approx(0.5, abs=0.02)
    assert xs[60] == pytest.approx(30)


def test_shake_has_the_stated_size() -> None:
    """A hand's shake has the deviation asked for, and none is none."""
    assert shake(4000, 1.5, 3).std() == pytest.approx(1.5, rel=0.05)
    assert not shake(50, 0.0, 3).any()


@pytest.mark.parametrize("kind", list(TEXTURES))
def test_textures_are_reproducible_and_honour_contrast_and_colour(kind: str) -> None:
    """The same texture is the same bytes, another seed is another picture, zero contrast one colour."""
    first, again = (paint(Texture(kind, seed=5), 50, 70) for _ in range(2))
    assert first.shape == (50, 70, 3)
    assert first.dtype == np.float32
    np.testing.assert_array_equal(first, again)
    assert (first != paint(Texture(kind, seed=6), 50, 70)).any()
    flat = paint(Texture(kind, contrast=0.0, colour=(10.0, 20.0, 30.0), seed=5), 12, 12)
    np.testing.assert_allclose(flat, np.broadcast_to([10.0, 20.0, 30.0], (12, 12, 3)), atol=1e-4)


@pytest.mark.parametrize(("kind", "height", "width"), [("page", 193, 100), ("chelsea", 313, 40), ("coins", 317, 400)])
def test_photographs_fill_any_size(kind: str, height: int, width: int) -> None:
    """A picture larger than the photograph enlarges it, though the quotient is rounded past the border."""
    assert paint(Texture(kind), height, width).shape == (height, width, 3)


def test_photographs_need_no_download() -> None:
    """Every photograph is a PNG file inside the installed scikit-image."""
    from pathlib import Path as FilePath

    import skimage.data

    folder = FilePath(skimage.data.__file__).parent
    assert all((folder / f"{name}.png").is_file() for name in PHOTOGRAPHS)


def test_sampling_mirrors_beyond_the_border() -> None:
    """Left of the first texel comes the first again, then the second; between texels the mean."""
    image = np.arange(4, dtype=np.float32)[np.newaxis, :, np.newaxis].repeat(3, axis=0).repeat(3, axis=2)
    x = np.array([-2.0, -1.0, 0.0, 1.5, 3.0, 4.0, 5.0])
    np.testing.assert_allclose(sample(image, x, np.zeros(7))[:, 0], [1, 0, 0, 1.5, 3, 3, 2])
    np.testing.assert_allclose(sample(image, x, np.zeros(7), closed=True)[:, 0], [2, 3, 0, 1.5, 3, 0, 1])


def test_blur_keeps_the_sum() -> None:
    """Softening an edge moves light, it neither makes nor swallows any."""
    field = np.zeros((40, 40), np.float32)
    field[15:25, 15:22] = 1.0
    assert box_blur(field, 2.0).sum() == pytest.approx(field.sum(), rel=1e-5)
    np.testing.assert_array_equal(box_blur(field, 0.2), field)


@pytest.mark.parametrize("shape", list(SHAPES))
def test_shapes_fill_their_size(shape: str) -> None:
    """At rest a shape spans its size; a walker's is that of its stride, a fan's and a star's that of their circle."""
    parts = SHAPES[shape](60.0, 48.0 if shape != "walker" else 120.0, 3)
    points = np.concatenate([part.outline @ part.pose(0.0)[:, :2].T + part.pose(0.0)[:, 2] for part in parts])
    width, height = np.ptp(points, axis=0)
    if shape == "walker":
        assert width <= 60
        assert height == pytest.approx(120, rel=0.03)
    elif shape.startswith("fan") or shape == "star":
        assert np.hypot(points[:, 0] / 30.0, points[:, 1] / 24.0).max() == pytest.approx(1.0)
    else:
        assert (width, height) == pytest.approx((60, 48), rel=1e-6)
