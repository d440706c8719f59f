"""Truth of rendered sequences, against what is known without rendering."""

from __future__ import annotations

import hashlib
import math
import pickle
import subprocess
import sys
import tracemalloc
from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from datasets_synthetic import SUITES, Sequence, SequenceSpec, frames, render
from datasets_synthetic.render import coverage
from datasets_synthetic.shapes import SHAPES, area
from datasets_synthetic.spec import Actor, Blank, Camera, Deep, Deform, Effect, Motion, Path, Scene, Shadow, Texture
from datasets_synthetic.textures import resample

SIZE = (160, 120)
GROUND = Texture("clouds", seed=3)
SKIN = Texture("patches", 0.6, seed=4)


def actor(path: Path, shape: str = "ellipse", size: tuple[float, float] = (41.3, 30.7), **more: object) -> Actor:
    """Make a target with an ordinary look; keywords of Motion go there, the rest to Actor."""
    motion = {key: more.pop(key) for key in ("angle", "spin", "growth", "gait", "hidden") if key in more}
    return Actor(shape, size, SKIN, Motion(path, **motion), **more)  # type: ignore[arg-type]


def spec(target: Actor, **more: object) -> SequenceSpec:
    """Make a short sequence without noise."""
    facts: dict[str, object] = {"scene": Scene(GROUND), "size": SIZE, "frames": 8, "effects": ()}
    return SequenceSpec("case", target, **{**facts, **more})  # type: ignore[arg-type]


CROSSING = Path("line", (58.2, 55.6), (92.9, 66.1))
STAY = Path("hold", (80.4, 60.3))
CASES: dict[str, SequenceSpec] = {
    "move": spec(actor(CROSSING)),
    "rotate": spec(actor(STAY, "polygon", spin=6.0)),
    "gear": spec(actor(CROSSING, "gear", (46.0, 46.0), spin=-5.0)),
    "squash": spec(actor(CROSSING, "blob", deform=(Deform("squash", 0.25, 1.0),))),
    "wave": spec(actor(STAY, "blob", deform=(Deform("wave", 0.15, 1.0),))),
    "bend": spec(actor(STAY, "box", deform=(Deform("bend", 0.3, 1.0),))),
    "turn": spec(actor(STAY, "box", deform=(Deform("turn", 0.6, 0.25),))),
    "growing": spec(actor(STAY, "box", growth=(1.0, 1.6), angle=20.0)),
    "walker": spec(actor(CROSSING, "walker", (42.0, 84.0), gait=0.05)),
    "car": spec(actor(CROSSING, "car", (70.0, 30.0), gait=0.05, mirror=True)),
    "pan": spec(actor(CROSSING), camera=Camera(pan=Path("line", (0, 0), (9.7, -4.1)))),
    "jitter": spec(actor(CROSSING), camera=Camera(jitter=1.5)),
    "zoom": spec(actor(STAY), camera=Camera(zoom=(1.0, 1.4))),
    "pole": spec(actor(CROSSING), scene=Scene(GROUND, front=(Actor("bar", (12, 150), SKIN, Motion(STAY)),))),
}


@pytest.fixture(scope="module")
def rendered() -> dict[str, Sequence]:
    """Every case, rendered once."""
    return {name: render(case) for name, case in CASES.items()}


def edges(box: np.ndarray) -> np.ndarray:
    """Left, top, right, bottom."""
    return np.concatenate([box[:2], box[:2] + box[2:]])


def mask_edges(mask: np.ndarray) -> np.ndarray:
    """Left, top, right, bottom of a mask's pixels."""
    columns, rows = np.flatnonzero(mask.any(axis=0)), np.flatnonzero(mask.any(axis=1))
    return np.array([columns[0], rows[0], columns[-1] + 1, rows[-1] + 1])


@pytest.mark.parametrize("name", [name for name in CASES if name != "pole"])
def test_boxes_agree_with_masks(name: str, rendered: dict[str, Sequence]) -> None:
    """Where all of the target is seen, the box from the pose and the mask's box differ by less than a pixel."""
    sequence = rendered[name]
    for t in range(len(sequence)):
        assert sequence.visibility[t] == pytest.approx(1.0, abs=1e-6)
        assert np.abs(edges(sequence.boxes[t]) - mask_edges(sequence.masks[t])).max() < 1.0
        np.testing.assert_array_equal(sequence.visible_boxes[t], sequence.boxes[t])


def test_box_of_a_moved_ellipse_is_known(rendered: dict[str, Sequence]) -> None:
    """An ellipse's box is its size round the path's point, sub-pixel."""
    sequence = rendered["move"]
    for t, box in enumerate(sequence.boxes):
        s = t / (len(sequence) - 1)
        centre = (58.2 + s * (92.9 - 58.2), 55.6 + s * (66.1 - 55.6))
        np.testing.assert_allclose(box[:2] + box[2:] / 2, centre, atol=1e-9)
        np.testing.assert_allclose(box[2:], (41.3, 30.7), atol=1e-9)


def test_flow_of_translation_is_the_path_and_zero(rendered: dict[str, Sequence]) -> None:
    """On the target the flow is the path's step, on a still background exactly 0."""
    sequence = rendered["move"]
    flow, valid = sequence.flow(0)
    step = np.array([(92.9 - 58.2) / 7, (66.1 - 55.6) / 7])
    np.testing.assert_allclose(
        flow[sequence.masks[0]], np.broadcast_to(step, flow[sequence.masks[0]].shape), atol=1e-5
    )
    assert not flow[~sequence.masks[0]].any()
    assert valid[~sequence.masks[0] & ~sequence.masks[1]].all()


def test_flow_of_zoom_is_radial(rendered: dict[str, Sequence]) -> None:
    """Zooming by k moves a background point by (k − 1) times its distance from the centre."""
    sequence = rendered["zoom"]
    flow, _ = sequence.flow(3)
    k = 1.4 ** (1 / 7)
    rows, columns = np.indices(flow.shape[:2]) + 0.5
    ground = sequence.labels[3] == 0
    np.testing.assert_allclose(flow[..., 0][ground], ((k - 1) * (columns - 80))[ground], atol=1e-4)
    np.testing.assert_allclose(flow[..., 1][ground], ((k - 1) * (rows - 60))[ground], atol=1e-4)


@pytest.mark.parametrize("name", list(CASES))
def test_flow_carries_each_frame_to_the_next(name: str, rendered: dict[str, Sequence]) -> None:
    """Frame t + 1 read where the flow points is frame t, inside what is seen in both; without the flow it is not."""
    sequence = rendered[name]
    for t in (0, 3, 6):
        flow, valid = sequence.flow(t)
        inner = _pure(sequence, t, flow, valid)
        now, then = (sequence.frames[k].astype(np.float32) for k in (t, t + 1))
        rows, columns = np.indices(valid.shape, dtype=np.float32)
        carried = cv2.remap(then, columns + flow[..., 0], rows + flow[..., 1], cv2.INTER_LINEAR)
        moving = inner & (np.abs(flow).max(axis=2) > 0.3)
        assert moving.sum() > 60
        error = np.abs(carried - now).mean(axis=2)[moving]
        without = np.abs(then - now).mean(axis=2)[moving]
        assert error.mean() < 2.5
        assert error.mean() < 0.4 * without.mean()


def _pure(sequence: Sequence, t: int, flow: np.ndarray, valid: np.ndarray) -> np.ndarray:
    """Valid pixels all of whose neighbours, before and after, belong to the same part."""

    def core(labels: np.ndarray) -> np.ndarray:
        kernel = np.ones((5, 5), np.uint8)
        return cv2.erode(labels, kernel) == cv2.dilate(labels, kernel)

    rows, columns = np.indices(valid.shape)
    after = core(sequence.labels[t + 1])
    row = np.clip(np.floor(rows + 0.5 + flow[..., 1]).astype(int), 2, SIZE[1] - 3)
    column = np.clip(np.floor(columns + 0.5 + flow[..., 0]).astype(int), 2, SIZE[0] - 3)
    inside = np.zeros_like(valid)
    inside[6:-6, 6:-6] = True
    return valid & core(sequence.labels[t]) & after[row, column] & inside


def test_whole_pixel_pan_is_an_exact_shift() -> None:
    """A camera that pans by whole pixels shows exactly the same background pixels, shifted."""
    case = spec(actor(Path("hold", (60.0, 50.0))), camera=Camera(pan=Path("line", (0, 0), (14, -7))))
    sequence = render(case)
    for t in range(len(sequence) - 1):
        np.testing.assert_array_equal(sequence.frames[t][:-1, 2:], sequence.frames[t + 1][1:, :-2])
        np.testing.assert_allclose(sequence.flow(t)[0], np.broadcast_to([-2.0, 1.0], (120, 160, 2)), atol=1e-5)


def test_shadow_flicker_and_glint_leave_the_truth_alone() -> None:
    """Light changes pixels, never boxes, masks or flow."""
    plain = CASES["squash"]
    lit = replace(
        plain,
        target=replace(
            plain.target, shadow=Shadow((9, 8)), surface=(Effect("glint", 150.0, 2.0), Effect("shade", 0.2))
        ),
        effects=(Effect("flicker", 0.2, 3.0), Effect("noise", 4.0)),
    )
    first, second = render(plain), render(lit)
    assert (first.frames != second.frames).any()
    np.testing.assert_array_equal(first.boxes, second.boxes)
    np.testing.assert_array_equal(first.masks, second.masks)
    np.testing.assert_array_equal(first.flow(2)[0], second.flow(2)[0])


def test_shadow_darkens_the_ground_beside_the_target_only() -> None:
    """The shadow multiplies the ground by no more than its strength and never brightens."""
    still = spec(actor(STAY))
    shaded = replace(still, target=replace(still.target, shadow=Shadow((15, 12), 0.5, 2.0)))
    light, dark = (render(case) for case in (still, shaded))
    before, after = (sequence.frames[0].astype(float) for sequence in (light, dark))
    assert (after <= before).all()
    assert (after >= 0.5 * before - 1.0).all()
    # The outermost pixels are part ground.
    inner = cv2.erode(light.masks[0].astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    np.testing.assert_array_equal(before[inner], after[inner])
    beside = (slice(68, 76), slice(98, 104))
    assert (after[beside] < 0.8 * before[beside]).all()


@pytest.mark.parametrize("suite", ["smoke", "vanish"])
def test_visibility_is_zero_exactly_where_the_mask_is_empty(suite: str) -> None:
    """No mask, no visibility, no visible box; and the other way round; amodal boxes are always there."""
    for case in SUITES[suite]:
        sequence = render(replace(case, frames=26))
        empty = ~sequence.masks.any(axis=(1, 2))
        np.testing.assert_array_equal(sequence.visibility == 0, empty)
        np.testing.assert_array_equal(np.isnan(sequence.visible_boxes).any(axis=1), empty)
        np.testing.assert_array_equal(sequence.frame_attributes["absent"], empty)
        assert np.isfinite(sequence.boxes).all()
        assert ((sequence.visibility >= 0) & (sequence.visibility <= 1)).all()


def test_visibility_behind_a_wall_is_the_share_beside_it() -> None:
    """A box that is half behind a wall is half visible, and its visible box is the other half."""
    target = Actor("bar", (40, 20), SKIN, Motion(Path("hold", (60, 60))))
    wall = Actor("bar", (30, 140), GROUND, Motion(Path("hold", (75, 60))))
    sequence = render(spec(target, scene=Scene(GROUND, front=(wall,)), frames=2))
    assert sequence.visibility[0] == pytest.approx(0.5, abs=1e-6)
    np.testing.assert_allclose(sequence.visible_boxes[0], [40, 50, 20, 20], atol=1e-9)
    np.testing.assert_allclose(sequence.boxes[0], [40, 50, 40, 20], atol=1e-9)


def test_visibility_at_the_frame_edge_is_the_share_inside() -> None:
    """A box a quarter of which is inside the frame is a quarter visible; its amodal box is not clipped."""
    target = Actor("bar", (40, 20), SKIN, Motion(Path("hold", (-10, 60))))
    sequence = render(spec(target, frames=2))
    assert sequence.visibility[0] == pytest.approx(0.25, abs=1e-6)
    np.testing.assert_allclose(sequence.boxes[0], [-30, 50, 40, 20], atol=1e-9)
    np.testing.assert_allclose(sequence.visible_boxes[0], [0, 50, 10, 20], atol=1e-9)
    assert sequence.frame_attributes["cut_by_frame"].all()


def test_hidden_frames_show_the_background_alone() -> None:
    """A target that blinks out leaves the untouched ground, and its amodal box goes on."""
    case = spec(actor(STAY, hidden=((2, 4),)), frames=6)
    sequence = render(case)
    assert sequence.visibility.tolist() == pytest.approx([1, 1, 0, 0, 1, 1])
    np.testing.assert_array_equal(sequence.frames[2], sequence.frames[3])
    assert not sequence.labels[2].any()
    np.testing.assert_array_equal(sequence.boxes[2], sequence.boxes[1])
    flow, valid = sequence.flow(1)
    assert not valid[sequence.masks[1]].any()
    assert np.isfinite(flow).all()


def test_distractor_is_no_part_of_the_truth() -> None:
    """Another actor behind the target changes labels and pixels, not the target's mask."""
    other = actor(Path("line", (110.0, 60.0), (50.0, 60.0)), "box")
    alone = render(CASES["move"])
    together = render(replace(CASES["move"], scene=Scene(GROUND, behind=(other,))))
    np.testing.assert_array_equal(alone.masks, together.masks)
    assert set(np.unique(together.labels).tolist()) == {0, 1, 2}
    moved = together.flow(0)[0][together.labels[0] == 1]
    np.testing.assert_allclose(moved, np.broadcast_to([-60 / 7, 0.0], moved.shape), atol=1e-4)


def test_blur_smears_along_the_motion_and_keeps_the_truth() -> None:
    """An open shutter softens the picture and leaves box and mask at the middle of the exposure."""
    fast = spec(actor(Path("line", (40.0, 60.0), (120.0, 60.0))))
    blurred = replace(fast, camera=Camera(shutter=0.8))
    sharp, soft = render(fast), render(blurred)
    np.testing.assert_array_equal(sharp.boxes, soft.boxes)
    np.testing.assert_array_equal(sharp.masks, soft.masks)

    def roughness(sequence: Sequence) -> float:
        return float(np.abs(np.diff(sequence.frames[3].astype(float), axis=1))[sequence.masks[3][:, 1:]].mean())

    assert roughness(soft) < 0.7 * roughness(sharp)


def test_gray_and_jpeg() -> None:
    """Gray frames have no channel axis; a lower JPEG quality is farther from the original."""
    gray = render(spec(actor(STAY), effects=(Effect("gray"),), frames=2))
    assert gray.frames.shape == (2, 120, 160)
    original = render(spec(actor(STAY), frames=2)).frames.astype(float)
    errors = [
        np.abs(render(spec(actor(STAY), effects=(Effect("jpeg", q),), frames=2)).frames - original).mean()
        for q in (90.0, 50.0, 30.0)
    ]
    assert 0 < errors[0] < errors[1] < errors[2] < 12


def test_noise_has_the_stated_deviation_and_no_memory() -> None:
    """Sensor noise has zero mean, the deviation of the spec, and is independent from frame to frame."""
    ground = Texture("plain", colour=(128.0, 128.0, 128.0))
    target = Actor("bar", (4, 4), ground, Motion(STAY))
    sequence = render(spec(target, scene=Scene(ground), effects=(Effect("noise", 6.0),), frames=4))
    noise = sequence.frames.astype(float) - 128.0
    assert abs(noise.mean()) < 0.1
    assert noise.std() == pytest.approx(6.0, rel=0.02)
    assert abs(np.corrcoef(noise[0].ravel(), noise[1].ravel())[0, 1]) < 0.02


def digest_of(sequence: Sequence) -> str:
    """Hash of everything in a sequence."""
    parts = (sequence.frames, sequence.boxes, sequence.masks, sequence.visibility, sequence.labels)
    return hashlib.sha256(b"".join(part.tobytes() for part in parts)).hexdigest()


def test_same_spec_same_bytes_in_any_process() -> None:
    """Two renders, here and in another process, are equal to the byte."""
    code = (
        "import hashlib; from datasets_synthetic import SUITES, render\n"
        "for spec in SUITES['smoke']:\n"
        "    s = render(spec)\n"
        "    parts = (s.frames, s.boxes, s.masks, s.visibility, s.labels)\n"
        "    print(spec.digest(), hashlib.sha256(b''.join(p.tobytes() for p in parts)).hexdigest())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    here = [f"{case.digest()} {digest_of(render(case))}" for case in SUITES["smoke"]]
    assert here == [f"{case.digest()} {digest_of(render(case))}" for case in SUITES["smoke"]]
    assert done.stdout.splitlines() == here


def test_sequence_survives_pickling() -> None:
    """A sequence sent to another process still knows its flow."""
    sequence = render(SUITES["smoke"][0])
    again = pickle.loads(pickle.dumps(sequence))
    assert again.name == sequence.name
    np.testing.assert_array_equal(again.flow(0)[0], sequence.flow(0)[0])


@pytest.mark.parametrize("t", [-1, 7, 100])
def test_flow_beyond_the_sequence_is_an_error(t: int, rendered: dict[str, Sequence]) -> None:
    """There is no flow from the last frame on."""
    with pytest.raises(IndexError, match=f"got {t}"):
        rendered["move"].flow(t)


@pytest.mark.parametrize("shape", list(SHAPES))
@pytest.mark.parametrize("seed", [0, 5, 12])
def test_coverage_of_every_part_sums_to_its_area(shape: str, seed: int) -> None:
    """Summed coverage is the polygon's area, to a hundredth of its outline's pixels."""
    for part in SHAPES[shape](60.3, 52.9, seed):
        covered = coverage(part.outline + np.array([50.2, 50.7]), 0, 0, 100, 100)
        length = np.hypot(*np.diff(np.vstack([part.outline, part.outline[:1]]), axis=0).T).sum()
        assert covered.sum() == pytest.approx(abs(area(part.outline)), abs=0.05 * length)
        assert covered.min() >= 0
        assert covered.max() <= 1


@settings(max_examples=60, deadline=None)
@given(x=st.floats(2, 20), y=st.integers(16, 160), w=st.floats(1, 12), h=st.integers(8, 96))
def test_coverage_of_a_rectangle_is_exact(x: float, y: int, w: float, h: int) -> None:
    """Each pixel's share of an upright rectangle is the product of its overlaps; rows on eighths are exact too."""
    top, bottom = y / 8, (y + h) / 8
    outline = np.array([[x, top], [x + w, top], [x + w, bottom], [x, bottom]])
    across = np.clip(np.minimum(np.arange(1, 41), x + w) - np.maximum(np.arange(40), x), 0, None)
    down = np.clip(np.minimum(np.arange(1, 41), bottom) - np.maximum(np.arange(40), top), 0, None)
    np.testing.assert_allclose(coverage(outline, 0, 0, 40, 40), np.outer(down, across), atol=1e-5)


def test_coverage_does_not_depend_on_the_window() -> None:
    """A window cuts out part of the same coverage, left of the polygon and inside it alike."""
    outline = SHAPES["blob"](40.0, 36.0, 3)[0].outline + np.array([30.3, 30.8])
    whole = coverage(outline, 0, 0, 64, 64)
    np.testing.assert_allclose(coverage(outline, 20, 25, 17, 13), whole[25:38, 20:37], atol=1e-6)
    np.testing.assert_allclose(coverage(outline[::-1], 0, 0, 64, 64), whole, atol=1e-6)


def test_resampling_on_whole_positions_copies() -> None:
    """Whole positions give the pixels themselves; a straight ramp is met between them."""
    rng = np.random.default_rng(1)
    image = rng.uniform(0, 255, (20, 24, 3)).astype(np.float32)
    np.testing.assert_array_equal(resample(image, np.arange(3.0, 9.0), np.arange(2.0, 7.0)), image[3:9, 2:7])
    ramp = np.broadcast_to(np.arange(24, dtype=np.float32)[np.newaxis, :, np.newaxis], (20, 24, 3))
    half = resample(ramp, np.arange(5.0), np.arange(4.0, 12.0) + 0.3)
    np.testing.assert_allclose(half[0, :, 0], np.arange(4.0, 12.0) + 0.3, atol=1e-4)


def test_turning_thing_narrows_to_its_depth() -> None:
    """A quarter turn of a column shows its other axis; a half turn its full width again."""
    case = spec(actor(STAY, "bar", (40.0, 30.0), deform=(Deform("turn", 0.5, 0.5),)), frames=9)
    widths = render(case).boxes[:, 2]
    np.testing.assert_allclose(widths[[0, 4, 8]], [40.0, 20.0, 40.0], atol=1e-9)
    assert widths[2] == pytest.approx(math.hypot(40 * math.cos(math.pi / 4), 20 * math.sin(math.pi / 4)))


def test_full_turn_shows_the_same_face_again() -> None:
    """After one turn the surface closes: the picture is that of the start; half-way it is another."""
    sequence = render(spec(actor(STAY, "box", deform=(Deform("turn", 0.6, 1.0),)), frames=9))
    first, half, last = (sequence.frames[t].astype(int) for t in (0, 4, 8))
    assert np.abs(first - last).max() <= 1
    assert np.abs(first - half)[sequence.masks[0]].mean() > 10


@pytest.mark.parametrize("gray", [False, True])
@pytest.mark.parametrize("deep", [Deep(), Deep(7300, 8100), Deep(0, 255)])
def test_a_deep_camera_sees_the_same_in_16_bits(deep: Deep, gray: bool) -> None:
    """Grey level g is low + g (high − low) / 255, rounded once; the truth is the same, blank frames included."""
    effects = (Effect("gray"),) if gray else ()
    shallow = spec(actor(STAY), effects=effects, blanks=(Blank("white", 2, 3),))
    plain, words = render(shallow), render(replace(shallow, deep=deep))
    assert words.frames.dtype == np.uint16
    assert words.frames.shape == plain.frames.shape
    levels = (words.frames.astype(np.float64) - deep.low) * 255.0 / (deep.high - deep.low)
    step = 255.0 / (deep.high - deep.low)
    assert np.abs(levels - plain.frames).max() <= 0.5 + step / 2 + 1e-4
    assert (words.frames[2] == deep.high).all()
    np.testing.assert_array_equal(words.boxes, plain.boxes)
    if deep.high > 1000:
        # It is not the 8 bits spread out.
        assert len(np.unique(words.frames[0])) > 1.5 * len(np.unique(plain.frames[0]))


def test_a_deep_camera_that_cannot_be_is_named() -> None:
    """Its levels rise, within 16 bits; JPEG has 8."""
    with pytest.raises(ValueError, match="expected 0 <= low < high <= 65535"):
        Deep(5, 5)
    with pytest.raises(ValueError, match="without jpeg"):
        spec(actor(STAY), deep=Deep(), effects=(Effect("jpeg", 50.0),))


@pytest.mark.parametrize("case", SUITES["smoke"], ids=lambda case: case.name)
def test_frames_one_by_one_are_those_of_the_sequence(case: SequenceSpec) -> None:
    """Painting without keeping gives the same bytes."""
    for one, other in zip(frames(case), render(case).frames, strict=True):
        np.testing.assert_array_equal(one, other)


def test_painting_needs_memory_for_one_frame() -> None:
    """Eight times as many frames take no more: nothing of those before is kept."""
    peaks = []
    for count in (6, 48):
        case = spec(actor(STAY), frames=count)
        tracemalloc.start()
        for frame in frames(case):
            assert frame.shape == (120, 160, 3)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0]
