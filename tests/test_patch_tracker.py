"""the patch tracker on drawn squares whose box is known in every frame."""

from __future__ import annotations

import pickle
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv import patch_tracker
from hs_tracker_cv._native import kernels
from hs_tracker_cv.frames import Frame, as_frame
from hs_tracker_cv.geometry import Box, iou
from hs_tracker_cv.patch_tracker import PatchTrackerParams, PatchTrackerState, patches
from hs_tracker_cv.patch_tracker.patches import Place
from hs_tracker_cv.patch_tracker.sampler import Sampler
from hs_tracker_cv.patch_tracker.search import _elsewhere

PARAMS = PatchTrackerParams()
Path = Callable[[int], Box | None]


def _texture(seed: int, height: int, width: int, colour: bool) -> NDArray[np.float32]:
    noise = np.random.default_rng(seed).uniform(0, 255, (height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 2.5)
    smooth = 128 + (smooth - smooth.mean()) * 4
    return np.clip(smooth if colour else smooth[:, :, :1].repeat(3, 2), 0, 255).astype(np.float32)


def _frame(box: Box | None, colour: bool = True) -> Frame:
    """Draw a textured square, sub-pixel, on a textured ground; None: nothing there."""
    image = 0.5 * _texture(1, 180, 240, colour) + 30
    if box is not None:
        square = _texture(2, 80, 80, colour) * np.asarray([1.0, 0.9, 0.6], np.float32)
        scale = box.w / 80
        shift = np.asarray([[scale, 0, box.x + scale / 2 - 0.5], [0, scale, box.y + scale / 2 - 0.5]])
        size, border = (image.shape[1], image.shape[0]), cv2.BORDER_CONSTANT
        cover = cv2.warpAffine(np.ones((80, 80), np.float32), shift, size, borderMode=border)[:, :, None]
        image = image * (1 - cover) + cv2.warpAffine(square, shift, size, borderMode=border)
    pixels = np.clip(image, 0, 255).astype(np.uint8)
    return as_frame(pixels if colour else pixels[:, :, 0])


def _track(path: Path, frames: int, colour: bool = True) -> list[PatchTrackerState]:
    first = path(0)
    assert first is not None
    states = [patch_tracker.start(_frame(first, colour), first, PARAMS)]
    for t in range(1, frames):
        states.append(patch_tracker.step(states[-1], _frame(path(t), colour), PARAMS))
    return states


def _moving(t: int) -> Box:
    return Box(60.3 + 1.7 * t, 50.0 + 0.9 * t, 40.0, 40.0)


def _growing(t: int) -> Box:
    return Box.from_centre(110.0, 90.0, 40.0 * 1.5 ** (t / 40), 40.0 * 1.5 ** (t / 40))


def _stopping(t: int) -> Box:
    return _moving(min(t, 10))


def _hidden(t: int) -> Box | None:
    return None if 15 <= t < 30 else _moving(min(t, 15))


@pytest.mark.parametrize("colour", [True, False], ids=["colour", "gray"])
@pytest.mark.parametrize(
    ("path", "frames", "least"),
    [
        (_moving, 40, 0.9),  # translation, 1.9 px per frame
        (_growing, 41, 0.85),  # grows to 1.5 times
        (_stopping, 40, 0.93),  # stands still after a while
    ],
)
def test_follows_a_square(path: Path, frames: int, least: float, colour: bool) -> None:
    """The box overlaps the true one in every frame, and every frame says so."""
    for t, state in enumerate(_track(path, frames, colour)):
        truth = path(t)
        assert truth is not None
        assert iou(state.estimate.box, truth) > least
        assert state.estimate.ok
        assert not state.estimate.lost


def test_says_lost_and_finds_again() -> None:
    """Hidden, the object is lost within a few frames and nothing else is seized; shown again, it is found."""
    reports = [state.estimate for state in _track(_hidden, 40)]
    assert all(report.ok for report in reports[:15])
    assert all(report.lost and not report.ok for report in reports[20:30])
    assert max(report.score for report in reports[20:30]) < 0.5
    shown = _hidden(39)
    assert shown is not None
    assert reports[-1].ok
    assert iou(reports[-1].box, shown) > 0.8


def test_finds_an_object_that_comes_back_elsewhere() -> None:
    """An object that reappears more than a box away from where it vanished is found by the wider search."""

    def displaced(t: int) -> Box | None:
        return _moving(0) if t < 10 else None if t < 16 else Box(150.0, 90.0, 40.0, 40.0)

    last = _track(displaced, 45)[-1].estimate
    assert last.ok
    assert iou(last.box, Box(150.0, 90.0, 40.0, 40.0)) > 0.8


def _arrays(state: PatchTrackerState) -> list[NDArray[np.float32]]:
    model = state.model
    filter_ = model.located
    found = [
        state.persistence,
        model.previous,
        model.means,
        model.keys,
        filter_.filter,
        filter_.witness,
        state.before.gray,
    ]
    return found if model.histograms is None else [*found, model.histograms]


def test_step_leaves_the_old_state_alone() -> None:
    """No array of a state changes when the next state is made from it."""
    state = _track(_moving, 5)[-1]
    before = [array.copy() for array in _arrays(state)]
    patch_tracker.step(state, _frame(_moving(5)), PARAMS)
    patch_tracker.ride(state, _moving(5))
    for array, copy in zip(_arrays(state), before, strict=True):
        np.testing.assert_array_equal(array, copy)


def test_same_input_same_output() -> None:
    """Two runs give bit-identical boxes, and so does a state that went through pickle."""
    once, again = _track(_moving, 12), _track(_moving, 12)
    assert [state.estimate.box for state in once] == [state.estimate.box for state in again]
    copied = pickle.loads(pickle.dumps(once[6]))
    assert patch_tracker.step(copied, _frame(_moving(7)), PARAMS).estimate.box == once[7].estimate.box


def test_keyframe_takes_out_an_artificial_drift() -> None:
    """A pose pushed off by 2 px returns to the object, although the frame-to-frame flow sees no motion at all."""
    frame, box = _frame(_moving(0)), _moving(0)
    state = patch_tracker.start(frame, box, PARAMS)
    for _ in range(3):
        state = patch_tracker.step(state, frame, PARAMS)
    state = patch_tracker.ride(state, state.estimate.box.moved(2.0, 1.5))
    for _ in range(6):
        state = patch_tracker.step(state, frame, PARAMS)
    assert state.estimate.box.x == pytest.approx(box.x, abs=0.5)
    assert state.estimate.box.y == pytest.approx(box.y, abs=0.5)


def test_seek_finds_what_has_moved_far_though_it_was_not_lost() -> None:
    """A step looks near; to seek is to look all over the frame."""
    state, far = _track(_moving, 6)[-1], _frame(Box(150.0, 120.0, 40.0, 40.0))
    assert iou(patch_tracker.step(state, far, PARAMS).estimate.box, Box(150.0, 120.0, 40.0, 40.0)) < 0.1
    for _ in range(8):
        state = patch_tracker.seek(state, far, PARAMS)
    assert state.estimate.ok
    assert iou(state.estimate.box, Box(150.0, 120.0, 40.0, 40.0)) > 0.8


def _turned_frame(angle: float) -> Frame:
    """The whole picture turned about the middle of the square at rest."""
    box = _moving(0)
    (x, y), size = box.centre, (240, 180)
    cosine, sine = np.cos(angle), np.sin(angle)
    about = np.asarray([[cosine, -sine, x - cosine * x + sine * y], [sine, cosine, y - sine * x - cosine * y]])
    return as_frame(
        cv2.warpAffine(np.ascontiguousarray(_frame(box).pixels), about, size, borderMode=cv2.BORDER_REFLECT)
    )


def test_a_turn_that_is_told_is_found_and_one_that_is_not_is_dropped() -> None:
    """The finder knows the object upright: told of its turn it is as sure as before, told of a wrong one likewise."""
    state = _track(lambda t: _moving(0), 4)[-1]
    turned, still = _turned_frame(0.6), _turned_frame(0.0)
    told, untold = (patch_tracker.step(s, turned, PARAMS).estimate for s in (patch_tracker.turned(state, 0.6), state))
    wrong, right = (patch_tracker.step(s, still, PARAMS).estimate for s in (patch_tracker.turned(state, 0.6), state))
    assert told.score > untold.score + 0.2
    assert told.angle == pytest.approx(0.6)
    assert wrong.score == pytest.approx(right.score, abs=0.05)
    assert wrong.angle == 0.0
    assert (told.box.w, told.box.h) == pytest.approx((40.0, 40.0), rel=0.1)


def test_ride_moves_the_box_and_goes_on() -> None:
    """After a hand-over the report is the box handed over, also when it was lost, and tracking goes on from there."""
    state = _track(_hidden, 25)[-1]
    assert state.estimate.lost
    box = Box(150.0, 60.0, 40.0, 40.0)
    state = patch_tracker.ride(state, box)
    assert state.estimate.box == box
    assert state.estimate.ok
    for t in range(1, 8):
        state = patch_tracker.step(state, _frame(box.moved(1.5 * t, 0.0)), PARAMS)
    assert state.estimate.ok
    assert iou(state.estimate.box, box.moved(10.5, 0.0)) > 0.85


def test_ride_takes_a_new_size_slowly() -> None:
    """A box that shrinks for a few frames, as it does on its way out of sight, hardly changes the remembered size."""
    state = _track(_moving, 5)[-1]
    width = state.geometry.w * state.pose.sx
    for _ in range(5):
        state = patch_tracker.ride(state, Box(60.0, 60.0, 10.0, 40.0))
    assert state.geometry.w * state.pose.sx > 0.85 * width
    for _ in range(300):
        state = patch_tracker.ride(state, Box(60.0, 60.0, 30.0, 40.0))
    assert state.geometry.w * state.pose.sx == pytest.approx(30.0, abs=0.5)


def test_report_explains_itself() -> None:
    """The report holds flow and patches of one size, and where in the frame they lie; the score is a probability."""
    state = _track(_moving, 4)[-1]
    report = state.estimate
    assert report.flow.shape == (*report.current.shape, 2)
    assert report.previous.shape == report.current.shape
    window = report.window
    assert window.w == pytest.approx(report.current.shape[1] * report.step)
    assert iou(window, report.box) > 0.3
    assert window.x + window.w / 2 == pytest.approx(report.box.x + report.box.w / 2, abs=2.0)
    assert 0.5 < report.score <= 1.0
    assert report.verdict == "good"
    assert report.persistence > 0.9


def test_what_a_wall_hides_is_not_kept() -> None:
    """Behind a static wall the kept share falls, since the wall came in from outside of the box."""
    wall = _texture(3, 180, 60, True).astype(np.uint8)
    states = [patch_tracker.start(_frame(_moving(0)), _moving(0), PARAMS)]
    for t in range(1, 34):
        pixels = _frame(_moving(t)).pixels.copy()
        pixels[:, 110:170] = wall
        states.append(patch_tracker.step(states[-1], as_frame(pixels), PARAMS))
    kept = [state.estimate.persistence for state in states]
    assert min(kept[:5]) > 0.9
    assert min(kept[10:]) < 0.6
    assert states[-1].estimate.lost


def test_a_look_alike_far_off_does_not_draw_the_box_away() -> None:
    """While the object's content goes on in the box, a better picture of it elsewhere is not followed."""

    def dimmed(t: int, contrast: float) -> Frame:
        box = _moving(t)
        pixels = _frame(box).pixels.astype(np.float32)
        x, y = round(box.x), round(box.y)
        part = pixels[y : y + 40, x : x + 40]
        pixels[y : y + 40, x : x + 40] = (
            part.mean() + contrast * (part - part.mean()) + 0.5 * (1 - contrast) * (_texture(9, 40, 40, True) - 128)
        )
        return as_frame(np.clip(pixels, 0, 255).astype(np.uint8))

    states = [patch_tracker.start(dimmed(0, 1.0), _moving(0), PARAMS)]
    for t in range(1, 25):
        states.append(patch_tracker.step(states[-1], dimmed(t, max(0.0, 1.0 - t / 15)), PARAMS))
    assert all(iou(state.estimate.box, _moving(t)) > 0.5 for t, state in enumerate(states) if state.estimate.ok)
    assert states[15].estimate.ok


def test_search_after_a_loss_covers_the_frame() -> None:
    """In one round of places every pixel of the frame is less than a box from one, also at the borders."""
    states = _track(lambda t: _moving(0) if t < 5 else None, 12)
    state = states[-1]
    view = Sampler(_frame(None), state.geometry, state.pose, state.model.templates, None)
    assert state.estimate.lost
    places = [at for turn in range(1, 8) for at in _elsewhere(state.pose, state.geometry, view, turn)]
    y, x = np.mgrid[:180:4, :240:4]
    away = np.min([np.maximum(np.abs(x - at.cx), np.abs(y - at.cy)) for at in [state.pose, *places]], axis=0)
    assert away.max() < 40.0
    assert all(0 <= at.cx < 240 and 0 <= at.cy < 180 for at in places)


@pytest.mark.parametrize("side", [12.0, 150.0], ids=["tiny", "large"])
def test_cost_is_bounded_by_the_object(side: float) -> None:
    """Patches have the same number of samples whatever the object's size in pixels."""
    state = patch_tracker.start(_frame(None), Box(40.0, 20.0, side, side), PARAMS)
    other = patch_tracker.start(_frame(None), Box(40.0, 20.0, 60.0, 60.0), PARAMS)
    assert state.model.previous.shape == other.model.previous.shape
    assert state.geometry.inside.shape == other.geometry.inside.shape


def test_box_leaving_the_frame_is_not_followed_outside() -> None:
    """An object that walks out of the picture is reported lost, not followed into the repeated border."""

    def leaving(t: int) -> Box | None:
        box = Box(150.0 + 4.0 * t, 60.0, 40.0, 40.0)
        return box if box.x < 240 else None

    last = _track(leaving, 36)[-1].estimate
    assert not last.ok


def _ramp(height: int, width: int) -> NDArray[np.float32]:
    y, x = np.mgrid[:height, :width].astype(np.float32)
    return np.asarray(20.0 + 1.3 * x + 0.6 * y, np.float32)


@pytest.mark.parametrize("angle", [0.0, 0.6])
@pytest.mark.parametrize("step", [0.6, 1.0, 2.3, 5.0])
def test_fine_patch_of_a_ramp_is_exact(step: float, angle: float) -> None:
    """On a plane means and smoothing change nothing, so a patch is the plane at the places of its samples, scaled."""
    gray, inner = _ramp(130, 150), np.zeros((10, 12), np.float32)
    inner[2:-2, 2:-2] = 1 / 48
    at = Place(70.3, 60.8, step, step, angle)
    patch, scores = patches.fine(gray, at, inner, np.empty((0, 10, 12), np.float32))
    right, down = (np.arange(12) - 5.5) * step, ((np.arange(10) - 4.5) * step)[:, None]
    px = 70.3 + np.cos(angle) * right - np.sin(angle) * down
    py = 60.8 + np.sin(angle) * right + np.cos(angle) * down
    expected = 20.0 + 1.3 * px + 0.6 * py
    expected -= (inner * expected).sum()
    expected *= 32.0 / (np.sqrt((inner * expected**2).sum()) + 4.0)
    if angle == 0.0:  # straight patches are smoothed
        np.testing.assert_allclose(patch[1:-1, 1:-1], expected[1:-1, 1:-1], atol=2e-3)
        # The neighbours of a sample at the end are mirrored there.
        share = np.exp(-1 / 0.98) / (1 + 2 * np.exp(-1 / 0.98))
        corner = expected[0, 0] + 2 * share * (expected[0, 1] + expected[1, 0] - 2 * expected[0, 0])
        assert patch[0, 0] == pytest.approx(corner, abs=2e-3)
    assert scores.size == 0


def test_scores_are_weighted_correlations() -> None:
    """A patch agrees with itself by 1, with its negative by −1, and with another patch as NumPy has it."""
    inner = np.full((24, 28), 1 / (24 * 28), np.float32)
    inner[:, 14:] *= 0.5
    inner /= inner.sum()
    at, none = Place(60.0, 60.0, 1.5, 1.5, 0.0), np.empty((0, 24, 28), np.float32)
    gray, other = (np.ascontiguousarray(_texture(seed, 120, 120, False)[:, :, 0]) for seed in (4, 5))
    patch, that = patches.fine(gray, at, inner, none)[0], patches.fine(other, at, inner, none)[0]
    _, scores = patches.fine(gray, at, inner, np.stack((patch, -patch, that)))
    expected = (inner * patch * that).sum() / np.sqrt((inner * patch**2).sum() * (inner * that**2).sum())
    np.testing.assert_allclose(scores, [1.0, -1.0, expected], atol=1e-4)
    brighter = np.asarray(0.5 * gray + 40.0, np.float32)
    assert patches.fine(brighter, at, inner, patch[None])[1][0] == pytest.approx(1.0, abs=1e-4)


def _follow(
    flow: NDArray[np.float64],
    separation: float = -1.0,
    turning: bool = False,
    object_: NDArray[np.bool_] | None = None,
) -> tuple[list[float], NDArray[np.float32]]:
    """Fit to a flow from a texture to the same texture moved by it, which it explains everywhere."""
    height, width = flow.shape[:2]
    y, x = np.mgrid[:height, :width].astype(np.float32)
    b = np.ascontiguousarray(_texture(6, height, width, False)[:, :, 0])
    field = flow.astype(np.float32)
    a = cv2.remap(b, x + field[:, :, 0], y + field[:, :, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    prior = np.ones((height, width), np.float32) if object_ is None else object_.astype(np.float32)
    planes = np.empty((3, height, width), np.float32)
    priors = kernels.FitPriors(prior, 1 - prior, None, 0.5)
    found = kernels.fit_motion(a, b, field, priors, turning, separation, planes)
    return list(found), planes


def test_fit_ignores_outliers() -> None:
    """Translation and scale come back exactly enough although a sixth of the field moves otherwise."""
    y, x = np.mgrid[:48, :52] - np.asarray([23.5, 25.5])[:, None, None]
    flow = np.stack([1.5 + 0.03 * x, -0.7 + 0.03 * y], axis=2)
    flow[:8] = (5.0, 4.0)
    (tx, ty, scale, turn, apart), _ = _follow(flow)
    np.testing.assert_allclose([tx, ty, scale], [1.5, -0.7, 0.03], atol=0.02)
    assert turn == 0.0
    assert not apart


def test_fit_finds_a_rotation_when_asked() -> None:
    """A field that shifts, grows and turns gives back all three."""
    y, x = np.mgrid[:48, :52] - np.asarray([23.5, 25.5])[:, None, None]
    flow = np.stack([0.8 + 0.02 * x - 0.05 * y, -0.4 + 0.02 * y + 0.05 * x], axis=2)
    (tx, ty, scale, turn, *_), _ = _follow(flow, turning=True)
    np.testing.assert_allclose([tx, ty, scale, turn], [0.8, -0.4, 0.02, 0.05], atol=2e-3)


def test_object_and_surroundings_are_told_apart() -> None:
    """Pixels that move with the surroundings are found in the box too, and have no part in the object's motion."""
    flow = np.full((48, 52, 2), (-0.5, 0.2))
    flow[12:36, 12:32] = (1.5, -0.8)
    box = np.zeros((48, 52), np.bool_)
    box[10:38, 10:42] = True
    (tx, ty, *_, apart), planes = _follow(flow, separation=0.3, object_=box)
    assert apart
    np.testing.assert_allclose([tx, ty], [1.5, -0.8], atol=0.02)
    assert planes[1, 14:34, 14:30].min() > 0.95
    assert planes[1, 14:34, 34:40].max() < 0.05
    (tx, ty, *_, apart), planes = _follow(np.full((48, 52, 2), (1.5, -0.8)), separation=0.3, object_=box)
    assert not apart
    np.testing.assert_allclose([tx, ty], [1.5, -0.8], atol=0.02)
    np.testing.assert_array_equal(planes[1], 1.0)


def test_colours_are_read_from_their_own_lattice() -> None:
    """The likelihood, whose middle is the patch's, is a further prior weight."""
    likelihood = np.zeros((30, 40), np.float32)
    likelihood[:, :] = np.arange(40) / 40
    a, still = np.ascontiguousarray(_texture(6, 24, 28, False)[:, :, 0]), np.zeros((24, 28, 2), np.float32)
    prior, planes = np.full((24, 28), 2.0, np.float32), np.empty((3, 24, 28), np.float32)
    kernels.fit_motion(a, a, still, kernels.FitPriors(prior, prior, likelihood, 0.5), False, -1.0, planes)
    at = (19.5 + (np.arange(28) - 13.5) * 0.5) / 40
    np.testing.assert_allclose(planes[2], np.broadcast_to(2.0 * (0.1 + at), (24, 28)), atol=1e-5)


STAY = (0.0, 0.0, 1.0, 0.0)


def rates(rate: float, mean: float, mask: float) -> kernels.PersistenceRates:
    """How persistence goes on here."""
    return kernels.PersistenceRates(same=16.0, changed=40.0, rate=rate, mean_rate=mean, mask_rate=mask, floor=0.15)


def _keep(change: float, rate: float, mean: float, belongs: float = 1.0) -> NDArray[np.float32]:
    """What is kept of 0.8 after a shift by (2, -1) of half-size pixels, of a patch that changes by `change`."""
    height, width = 40, 48
    previous = np.ascontiguousarray(_texture(6, height, width, False)[:, :, 0])
    patch = np.asarray(np.roll(previous, (-2, 4), (0, 1)) + change, np.float32)
    flow = np.full((height, width, 2), (4.0, -2.0), np.float32)
    planes = np.full((3, height, width), 1e6, np.float32)
    planes[1] = belongs
    means = np.zeros((4, height, width), np.float32)
    means[0] = patch + mean
    kept, body = np.full((20, 24), 0.8, np.float32), np.ones((20, 24), np.float32)
    out, new = np.empty((20, 24), np.float32), np.empty_like(means)
    before, passage = (
        kernels.KnownBefore(kept, body, previous, means, patch),
        kernels.Passage(planes, flow, patch, STAY),
    )
    kernels.update_persistence(before, passage, rates(rate, 0.0, 0.0), out, new)
    np.testing.assert_array_equal(new[:3], means[:3])
    return out[3:-3, 3:-3]


@pytest.mark.parametrize(
    ("change", "rate", "mean", "belongs", "expected"),
    [
        (0.0, 0.0, 0.0, 1.0, 0.8),  # the same surface: all of it
        (28.0, 0.0, 0.0, 1.0, 0.4),  # half-way from the same to another
        (50.0, 0.0, 0.0, 1.0, 0.0),  # another one
        (0.0, 0.0, 0.0, 0.25, 0.4),  # half of it moves with the surroundings
        (50.0, 0.5, 0.0, 1.0, 0.5),  # another one than before, but as it was learned
        (0.0, 0.5, 10.0, 1.0, 0.8 + 0.1 * np.exp(-1.0)),  # less so: ten gray levels off
        (0.0, 0.5, 1e4, 1.0, 0.8),  # nothing like it
    ],
)
def test_what_is_kept(change: float, rate: float, mean: float, belongs: float, expected: float) -> None:
    """What is kept moves with the flow, and is lowered by change and by what moves with the surroundings."""
    np.testing.assert_allclose(_keep(change, rate, mean, belongs), expected, atol=1e-5)


def test_running_means() -> None:
    """Mean, deviation and mask move towards the frame by their rates; the prior weight follows from them."""
    old, new = np.empty((4, 4, 6), np.float32), np.empty((4, 4, 6), np.float32)
    old[:3] = np.asarray([10.0, 4.0, 0.5])[:, None, None]
    planes = np.zeros((3, 4, 6), np.float32)
    planes[0], planes[1] = 0.2, 1.0  # half of the mask's rate
    patch, weights, half = np.zeros((4, 6), np.float32), np.full((4, 6), 0.5, np.float32), np.ones((2, 3), np.float32)
    flow = np.zeros((4, 6, 2), np.float32)
    before, passage = kernels.KnownBefore(half, half, patch, old, weights), kernels.Passage(planes, flow, patch, STAY)
    kernels.update_persistence(before, passage, rates(0.0, 0.1, 0.4), half.copy(), new)
    expected = [9.0, 4.6, 0.6, 0.5 * 0.75 / (1.0 + 0.46**2)]
    np.testing.assert_allclose(new, np.broadcast_to(np.asarray(expected)[:, None, None], new.shape), rtol=1e-5)


def test_rotation_is_followed_when_asked() -> None:
    """A square that turns by 90 degrees in 60 frames: its angle is known throughout, and the upright box fits."""

    def turned(t: int) -> tuple[Frame, float]:
        angle, side = np.deg2rad(1.5 * t), 40.0
        image = 0.5 * _texture(1, 180, 240, True) + 30
        square = _texture(2, 80, 80, True) * np.asarray([1.0, 0.9, 0.6], np.float32)
        scale = side / 80
        matrix = scale * np.asarray([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        shift = np.asarray([100.0 + 0.5 * t, 90.0]) - 0.5 - matrix @ np.asarray([39.5, 39.5])
        affine, size = np.concatenate([matrix, shift[:, None]], axis=1), (240, 180)
        cover = cv2.warpAffine(np.ones((80, 80), np.float32), affine, size)[:, :, None]
        image = image * (1 - cover) + cv2.warpAffine(square, affine, size)
        return as_frame(np.clip(image, 0, 255).astype(np.uint8)), float(angle)

    params = PatchTrackerParams(rotation=True)
    state = patch_tracker.start(turned(0)[0], Box(80.0, 70.0, 40.0, 40.0), params)
    for t in range(1, 61):
        frame, angle = turned(t)
        state = patch_tracker.step(state, frame, params)
        assert state.estimate.ok
        assert state.estimate.angle == pytest.approx(angle, abs=0.06)
        side = 40.0 * (abs(np.cos(angle)) + abs(np.sin(angle)))
        assert iou(state.estimate.box, Box.from_centre(100.0 + 0.5 * t, 90.0, side, side)) > 0.85
