"""The flow: against the paper in NumPy, a direct sparse solve, known displacements, and symmetries."""

from __future__ import annotations

import copy
import itertools
import math
import pickle
import threading
from functools import partial
from typing import Any, Literal, get_args, get_type_hints

import cv2
import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from hs_tracker_cv.flow import FlowField, FlowParams, HornSchunck, derivatives, normal_flow, reference
from hs_tracker_cv.flow.params import PRESETS
from hs_tracker_cv.frames import InputError

MODES = ("classic", "solve", "fast", "default", "accurate")
WARPING = ("fast", "default", "accurate")
REFERENCE_TOLERANCE = 1e-5  # px, float32 sweeps against float64 ones
SOLVE_TOLERANCE = 1e-4  # px, against the direct solve
SYMMETRY_TOLERANCE = 2e-3  # px, other order of rounding, amplified by warping


def texture(height, width, dx=0.0, dy=0.0, seed=0):
    """Sum of sines sampled so that the content has moved by (dx, dy) px: exact sub-pixel truth, 0–255."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[:height, :width].astype(np.float64)
    image = np.zeros((height, width))
    for _ in range(24):
        angle, wavelength, phase = rng.uniform(0, np.pi), rng.uniform(6, 40), rng.uniform(0, 2 * np.pi)
        along = (x - dx) * np.cos(angle) + (y - dy) * np.sin(angle)
        image += np.sin(2 * np.pi * along / wavelength + phase)
    return np.clip(127.5 + 16 * image, 0, 255).astype(np.float32)


def noise(height, width, seed):
    """Uniform noise, 0–255."""
    return np.random.default_rng(seed).uniform(0, 255, (height, width)).astype(np.float32)


def direct_solution(frame0, frame1, smoothness):
    """Fixed point of the paper's iteration by scipy's sparse LU, from the reference's derivatives."""
    fx, fy, ft = (plane.ravel() for plane in reference.derivatives(frame0, frame1))
    height, width = frame0.shape
    n = height * width
    y, x = np.mgrid[:height, :width]
    mean = scipy.sparse.csr_matrix((n, n))
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            if dx or dy:
                column = np.clip(y + dy, 0, height - 1) * width + np.clip(x + dx, 0, width - 1)
                weight = np.full(n, 1 / 12 if dx and dy else 1 / 6)
                mean += scipy.sparse.csr_matrix((weight, (np.arange(n), column.ravel())), (n, n))
    smooth = smoothness**2 * (scipy.sparse.eye(n) - mean)
    mixed = scipy.sparse.diags(fx * fy)
    system = scipy.sparse.bmat(
        [[smooth + scipy.sparse.diags(fx * fx), mixed], [mixed, smooth + scipy.sparse.diags(fy * fy)]]
    )
    solution = scipy.sparse.linalg.spsolve(system.tocsc(), -np.concatenate((fx * ft, fy * ft)))
    return np.moveaxis(solution.reshape(2, height, width), 0, -1)


def mean_error(flow, dx, dy, margin=8):
    """Mean endpoint error away from the border."""
    inside = flow[margin:-margin, margin:-margin] - (dx, dy)
    return float(np.hypot(inside[..., 0], inside[..., 1]).mean())


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (5, 1), (16, 16), (37, 53), (64, 41)])
@pytest.mark.parametrize("iterations", [1, 2, 25])
def test_classic_equals_the_paper_in_numpy(shape, iterations):
    """Mode "classic" runs exactly n sweeps of the paper, at any size."""
    frame0, frame1 = noise(*shape, 1), noise(*shape, 2)
    flow = HornSchunck("classic", smoothness=7.0, iterations=iterations, gain=1.0).calc(frame0, frame1)
    np.testing.assert_allclose(flow, reference.flow(frame0, frame1, 7.0, iterations), atol=REFERENCE_TOLERANCE)


@pytest.mark.parametrize("iterations", [1, 8, 17])
@pytest.mark.parametrize("shape", [(210, 200), (40, 1041)])
def test_sweeps_that_go_together_equal_the_reference(shape: tuple[int, int], iterations: int) -> None:
    """Over a large frame eight sweeps follow one another row by row, but for one that is wider than a tile."""
    frame0, frame1 = noise(*shape, 1), noise(*shape, 2)
    flow = HornSchunck("classic", smoothness=7.0, iterations=iterations, gain=1.0).calc(frame0, frame1)
    np.testing.assert_allclose(flow, reference.flow(frame0, frame1, 7.0, iterations), atol=REFERENCE_TOLERANCE)


def test_classic_goes_on_from_a_start_field():
    """Ten sweeps and ten more from their result are twenty sweeps."""
    frame0, frame1 = texture(40, 50), texture(40, 50, 0.7, -0.3)
    ten = HornSchunck("classic", iterations=10)
    twenty = HornSchunck("classic", iterations=20).calc(frame0, frame1)
    np.testing.assert_allclose(ten.calc(frame0, frame1, ten.calc(frame0, frame1)), twenty, atol=REFERENCE_TOLERANCE)


@pytest.mark.parametrize("shape", [(64, 64), (97, 131), (145, 142)])
@pytest.mark.parametrize("smoothness", [5.0, 15.0])
def test_solve_equals_a_direct_solve(shape, smoothness):
    """Mode "solve" agrees with scipy's sparse LU within 1e-4 px."""
    frame0, frame1 = texture(*shape), texture(*shape, 1.0, 0.5)
    flow = HornSchunck("solve", smoothness=smoothness).calc(frame0, frame1)
    np.testing.assert_allclose(flow, direct_solution(frame0, frame1, smoothness), atol=SOLVE_TOLERANCE)


def test_solve_is_what_many_sweeps_come_to():
    """Mode "solve" is the limit of "classic", also from a start field."""
    frame0, frame1 = texture(33, 47), texture(33, 47, 0.5, 0.5)
    limit = reference.flow(frame0, frame1, 6.0, 4000)
    solver = HornSchunck("solve", smoothness=6.0)
    np.testing.assert_allclose(solver.calc(frame0, frame1), limit, atol=SOLVE_TOLERANCE)
    start = np.full((33, 47, 2), 3.0, np.float32)
    np.testing.assert_allclose(solver.calc(frame0, frame1, start), limit, atol=SOLVE_TOLERANCE)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("shape", [(1, 1), (2, 7), (15, 16), (48, 170), (97, 131)])
def test_identical_frames_give_exactly_zero(mode, shape):
    """Where nothing changes the flow is 0.0, not nearly so."""
    frame = noise(*shape, 3)
    assert not HornSchunck(mode).calc(frame, frame).any()


@pytest.mark.parametrize("mode", WARPING)
@pytest.mark.parametrize("displacement", [(0.25, -0.4), (2.0, 1.0), (-6.5, 4.0)])
def test_warping_modes_find_a_translation(mode, displacement):
    """Displacements from a fraction of a pixel to many are found within 0.05 px."""
    frame0, frame1 = texture(120, 140), texture(120, 140, *displacement)
    assert mean_error(HornSchunck(mode).calc(frame0, frame1), *displacement) < 0.05


@pytest.mark.parametrize("mode", MODES)
def test_direction_follows_opencv(mode):
    """What moves right and down has positive u and v."""
    flow = HornSchunck(mode).calc(texture(64, 64), texture(64, 64, 0.5, 0.3)).mean(axis=(0, 1))
    assert flow[0] > 0.2
    assert flow[1] > 0.1


def test_flow_warps_the_second_frame_onto_the_first():
    """For a rotation, I1 sampled at x + flow is I0 but for small errors."""
    y, x = np.mgrid[:100, :120].astype(np.float32)
    frame0 = texture(100, 120)
    angle = np.deg2rad(3.0)
    back_x = 60 + (x - 60) * np.cos(angle) + (y - 50) * np.sin(angle)
    back_y = 50 - (x - 60) * np.sin(angle) + (y - 50) * np.cos(angle)
    frame1 = cv2.remap(frame0, back_x.astype(np.float32), back_y.astype(np.float32), cv2.INTER_CUBIC)
    flow = HornSchunck().calc(frame0, frame1)
    warped = cv2.remap(frame1, x + flow[..., 0], y + flow[..., 1], cv2.INTER_CUBIC)
    inside = np.s_[12:-12, 12:-12]
    before = np.abs(frame1 - frame0)[inside].mean()
    assert np.abs(warped - frame0)[inside].mean() < 0.05 * before


@pytest.mark.parametrize("levels", [1, 3])
def test_start_field_replaces_the_coarse_levels(levels):
    """A start field within half a pixel of a large displacement is refined to it; the result is the whole flow."""
    frame0, frame1 = texture(64, 80), texture(64, 80, 11.3, -7.6)
    start = np.full((64, 80, 2), (11.0, -8.0), np.float32)
    flow = HornSchunck("fast", levels=levels).calc(frame0, frame1, start)
    assert mean_error(flow, 11.3, -7.6, margin=14) < 0.05


def test_detail_of_a_start_field_survives_the_levels():
    """A start field that jumps within the frame is not smeared by its way through the pyramid."""
    truth = np.zeros((64, 64, 2), np.float32)
    truth[:, 32:] = (6.0, 0.0)
    y, x = np.mgrid[:64, :64].astype(np.float32)
    frame1 = texture(64, 64)
    frame0 = cv2.remap(frame1, x + truth[..., 0], y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    flow = HornSchunck("default", levels=3).calc(frame0, frame1, truth)
    assert mean_error(flow[:, :26], 0.0, 0.0) < 0.05
    assert mean_error(flow[:, 38:56], 6.0, 0.0, margin=6) < 0.05


@pytest.mark.parametrize("mode", MODES)
def test_frames_are_never_written_to(mode):
    """Read-only frames are accepted; the result is a new array."""
    frames = [texture(30, 40), texture(30, 40, 0.5)]
    for array in frames:
        array.flags.writeable = False
    flow = HornSchunck(mode).calc(*frames)
    assert flow.flags.writeable
    assert not any(np.shares_memory(flow, frame) for frame in frames)


@pytest.mark.parametrize("mode", MODES)
def test_the_array_given_is_filled_and_returned(mode):
    """As with cv2's DIS and Farnebäck the result is written into the array of the first guess, strided too."""
    frames = texture(30, 40), texture(30, 40, 0.5)
    guess = np.full((30, 40, 2), 0.25, np.float32)
    expected = HornSchunck(mode).calc(*frames, guess.copy())
    assert np.abs(expected - guess).max() > 0.01
    dis = cv2.DISOpticalFlow.create()
    strided = np.full((30, 40, 3), 0.25, np.float32)[..., 1:]
    for solver, out in ((HornSchunck(mode), guess), (HornSchunck(mode), strided), (dis, np.zeros_like(guess))):
        images = [np.rint(frame).astype(np.uint8) for frame in frames] if solver is dis else frames
        assert solver.calc(*images, out) is out
        if solver is not dis:
            np.testing.assert_array_equal(out, expected)


@pytest.mark.parametrize(
    "flow",
    [
        np.full((30, 44, 2), 9.0, np.float32),
        np.full((30, 40, 3), 9.0, np.float32),
        np.full((30, 40), 9.0, np.float32),
        np.zeros(0, np.float32),
        np.zeros((30, 40, 2)),
        np.zeros((30, 40, 2), np.uint8),
    ],
    ids=lambda flow: f"{flow.shape} {flow.dtype}",
)
def test_an_array_that_cannot_hold_the_flow_is_left_and_a_new_one_returned(flow):
    """As DIS does, so that a loop goes on where the next video has another size."""
    frames = [np.rint(frame).astype(np.uint8) for frame in (texture(30, 40), texture(30, 40, 0.5))]
    before = flow.copy()
    for make in (partial(HornSchunck, "fast"), cv2.DISOpticalFlow.create):
        found = make().calc(*frames, flow)
        np.testing.assert_array_equal(found, make().calc(*frames, None))
        np.testing.assert_array_equal(flow, before)
        assert found is not flow
        assert found.dtype == np.float32


@pytest.mark.parametrize("dtype", [np.float64, np.float16, ">f4", np.int8])
def test_numbers_of_another_type_are_still_the_first_guess(dtype):
    """What counts is the numbers: only where they are written differs."""
    frames = texture(30, 40), texture(30, 40, 0.5)
    guess = np.full((30, 40, 2), 2.0, np.float32)
    solver = HornSchunck("classic", iterations=3)
    found = solver.calc(*frames, guess.astype(dtype))
    np.testing.assert_array_equal(found, solver.calc(*frames, guess))
    assert np.abs(found - solver.calc(*frames)).max() > 0.1


@pytest.mark.parametrize(
    ("flow", "message"),
    [
        ([[0.0]], "real numbers, got list"),
        (np.zeros((20, 20, 2), complex), "real numbers, got dtype complex128"),
        (np.full((20, 20, 2), None), "real numbers, got dtype object"),
        (np.broadcast_to(np.float32(0), (20, 20, 2)), "read-only"),
    ],
)
def test_what_is_no_flow_is_refused(flow, message):
    """As cv2 refuses them, in one line."""
    frame = texture(20, 20)
    with pytest.raises(InputError, match=f"flow.*{message}"):
        HornSchunck("fast").calc(frame, frame, flow)


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("gain", [None, 1.0, 0.05])
@pytest.mark.parametrize("top", [1.0, 255.0, 4095.0])
def test_layouts_of_the_same_numbers_give_the_same_flow(mode, gain, top):
    """What counts is the numbers: float32 or float64, strided, read-only, transposed, one channel or three axes."""
    frames = [frame * (top / 255) for frame in (texture(40, 50), texture(40, 50, 0.6, -0.3))]
    solver = HornSchunck(mode, gain=gain)
    expected = solver.calc(*frames)
    assert np.abs(expected).max() > 0.1 or (gain is not None and gain * top < 20)
    read_only = [frame.copy() for frame in frames]
    for frame in read_only:
        frame.flags.writeable = False
    variants = {
        "float64": [frame.astype(np.float64) for frame in frames],
        "strided": [np.repeat(frame, 2, axis=1)[:, ::2] for frame in frames],
        "read-only": read_only,
        "Fortran order": [np.asfortranarray(frame) for frame in frames],
        "(H, W, 1)": [frame[:, :, np.newaxis] for frame in frames],
        "big-endian": [frame.astype(">f4") for frame in frames],
    }
    for name, variant in variants.items():
        np.testing.assert_array_equal(solver.calc(*variant), expected, err_msg=name)
        np.testing.assert_array_equal(solver.calc(frames[0], variant[1]), expected, err_msg=f"float32, then {name}")


def test_every_kind_of_frame_gives_the_same_flow():
    """Gray and BGR, 8 and 16 bits, 0–1 and 0–255 floats, strided and UMat: one flow."""
    frames = [np.rint(texture(40, 56)).astype(np.uint8), np.rint(texture(40, 56, 1.5, 0.5)).astype(np.uint8)]
    solver = HornSchunck("fast")
    expected = solver.calc(*frames)
    wide = [np.repeat(frame, 2, axis=1) for frame in frames]
    variants = {
        "(H, W, 1)": [frame[:, :, np.newaxis] for frame in frames],
        "BGR": [cv2.cvtColor(frame, cv2.COLOR_GRAY2BGR) for frame in frames],
        "uint16": [frame.astype(np.uint16) * 257 for frame in frames],
        "0–1": [frame.astype(np.float32) / 255 for frame in frames],
        "float64": [frame.astype(np.float64) for frame in frames],
        "strided": [frame[:, ::2] for frame in wide],
        "strided float": [frame.astype(np.float32)[:, ::2] for frame in wide],
        "UMat": [cv2.UMat(frame) for frame in frames],
    }
    for name, variant in variants.items():
        np.testing.assert_allclose(solver.calc(*variant), expected, atol=1e-3, err_msg=name)


@pytest.mark.parametrize("mode", WARPING)
@pytest.mark.parametrize(
    ("gain", "offset"), [(1.0, 5.0), (1.0, 10.0), (1.0, 20.0), (1.0, -15.0), (1.1, 0.0), (0.9, 12.0)]
)
def test_a_step_of_exposure_is_no_motion(mode, gain, offset):
    """What auto-exposure does to the whole frame makes no flow where nothing moves, and spoils none where it does."""
    still, moved = 25 + 0.8 * texture(96, 120, seed=3), 25 + 0.8 * texture(96, 120, 2.0, 1.0, seed=3)
    brighter, both = (np.clip(gain * (frame - 128) + 128 + offset, 0, 255) for frame in (still, moved))
    solver = HornSchunck(mode)
    assert np.abs(HornSchunck(mode, exposure=False).calc(still, brighter)).mean() > 0.02
    assert np.abs(solver.calc(still, brighter)).mean() < 0.02
    assert mean_error(solver.calc(still, both), 2.0, 1.0) < 0.05


def test_gain_keeps_dark_float_windows_from_reading_as_0_to_1():
    """With gain=1 a float window is what it says, however dark."""
    frame0, frame1 = texture(32, 32) / 256, texture(32, 32, 0.5) / 256
    dark = HornSchunck("classic", gain=1.0).calc(frame0, frame1)
    np.testing.assert_allclose(dark, reference.flow(frame0, frame1, 10.0, 100), atol=REFERENCE_TOLERANCE)
    assert np.abs(HornSchunck("classic").calc(frame0, frame1)).max() > 10 * np.abs(dark).max()


def test_one_bright_frame_tells_the_range_of_both():
    """A black float frame before a 0–255 one is not multiplied by 255."""
    black, bright = np.zeros((24, 24), np.float32), texture(24, 24)
    expected = HornSchunck("classic", gain=1.0).calc(black, bright)
    np.testing.assert_array_equal(HornSchunck("classic").calc(black, bright), expected)
    np.testing.assert_array_equal(HornSchunck("classic").calc(black.astype(np.float64), bright), expected)


@pytest.mark.parametrize("mode", MODES)
def test_values_that_are_not_finite_do_not_spread(mode):
    """NaN and infinity read as 0, and leave nothing behind for the next call."""
    solver = HornSchunck(mode)
    clean = solver.calc(texture(32, 40), texture(32, 40, 0.5))
    bad = texture(32, 40)
    bad[5, 5], bad[6, 7] = np.nan, np.inf
    assert np.isfinite(solver.calc(bad, texture(32, 40, 0.5))).all()
    start = np.zeros((32, 40, 2), np.float32)
    start[3, 3] = np.nan
    assert np.isfinite(solver.calc(texture(32, 40), texture(32, 40, 0.5), start)).all()
    np.testing.assert_array_equal(solver.calc(texture(32, 40), texture(32, 40, 0.5)), clean)


def test_sizes_may_change_from_call_to_call():
    """One object serves windows of any size in any order, with the results of a new one."""
    solver = HornSchunck("default")
    for shape in [(64, 64), (40, 170), (17, 23), (128, 96), (64, 64)]:
        frames = texture(*shape), texture(*shape, 1.0, 0.5)
        np.testing.assert_array_equal(solver.calc(*frames), HornSchunck("default").calc(*frames))


def test_memory_is_let_go_on_request() -> None:
    """As cv2's flows do; the next call works as before, in memory of its own."""
    frames = np.random.default_rng(2).uniform(0, 255, (2, 40, 50))
    solver = HornSchunck()
    before = solver.calc(*frames)
    solver.collectGarbage()
    assert solver._idle == []
    np.testing.assert_array_equal(solver.calc(*frames), before)


def test_copies_work_and_leave_the_memory_behind():
    """A pickled or copied solver gives the same flow and is small."""
    frames = texture(64, 64), texture(64, 64, 1.0)
    solver = HornSchunck("fast", smoothness=6.0)
    flow = solver.calc(*frames)
    assert len(pickle.dumps(solver)) < 2000
    for twin in (pickle.loads(pickle.dumps(solver)), copy.deepcopy(solver)):
        assert twin.params == solver.params
        np.testing.assert_array_equal(twin.calc(*frames), flow)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"params": None}, "params to be FlowParams, got None"),
        ({"params": ("warps", 0)}, "integer warps >= 1, got 0"),
        ({"params": ("smoothness", math.nan)}, "finite smoothness > 0, got nan"),
        ({"_previous": [[1.0]]}, "_previous to be a contiguous plane"),
        ({"_previous": np.zeros((0, 5), np.float32)}, "_previous to be a contiguous plane"),
        ({"_previous": np.zeros((9, 9))}, "_previous to be a contiguous plane"),
        ({"_previous": np.zeros((9, 9, 2), np.float32)}, "_previous to be a contiguous plane"),
        ({"_previous": np.zeros((9, 18), np.float32)[:, ::2]}, "_previous to be a contiguous plane"),
    ],
)
def test_an_edited_pickle_is_refused(changes: dict[str, Any], words: str) -> None:
    """What kernels would read is checked when it comes out of a pickle, and the solver stays as it was."""
    solver = HornSchunck("fast")
    state = solver.__getstate__() | changes
    if isinstance(state["params"], tuple):
        state["params"] = copy.copy(solver.params)
        object.__setattr__(state["params"], *changes["params"])
    with pytest.raises(ValueError, match=words):
        solver.__setstate__(state)
    assert solver.params == HornSchunck("fast").params


@pytest.mark.parametrize("shared", [False, True])
def test_threads_work_in_parallel(shared):
    """Threads give what one gives alone, with objects of their own or one that they share, at sizes that change."""
    pairs = [(texture(n, 96), texture(n, 96, 2.0, 1.0)) for n in (96, 40, 70)]
    expected = [HornSchunck("default").calc(*frames) for frames in pairs]
    common = HornSchunck("default")
    alike = []

    def work():
        solver = common if shared else HornSchunck("default")
        for _ in range(4):
            alike.extend(np.array_equal(solver.calc(*f), e) for f, e in zip(pairs, expected, strict=True))

    threads = [threading.Thread(target=work) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert alike == [True] * 48


def test_modes_are_known_to_type_checkers():
    """The names of modes and masks are literals, so that a slip of the pen fails type checking."""
    hints = get_type_hints(HornSchunck.__init__)
    assert get_args(hints["mode"]) == MODES
    assert set(get_args(hints["derivative"])) == {Literal["cube", "five-tap"], type(None)}
    assert tuple(PRESETS) == MODES


@settings(max_examples=25, deadline=None)
@given(
    st.integers(1, 60), st.integers(1, 60), st.sampled_from(MODES), st.sampled_from((np.uint8, np.uint16, np.float32))
)
def test_shape_and_dtype(height, width, mode, dtype):
    """Any size and dtype gives a finite (H, W, 2) float32 flow."""
    frame0, frame1 = noise(height, width, 4).astype(dtype), noise(height, width, 5).astype(dtype)
    flow = HornSchunck(mode).calc(frame0, frame1)
    assert flow.shape == (height, width, 2)
    assert flow.dtype == np.float32
    assert np.isfinite(flow).all()


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 255), st.integers(0, 255), st.sampled_from(MODES))
def test_constant_images_have_no_flow(level0, level1, mode):
    """Without a gradient there is no flow but rounding, whatever the brightness does."""
    frame0, frame1 = np.full((24, 31), level0, np.uint8), np.full((24, 31), level1, np.uint8)
    # Smoothing leaves gradients of about one float32 rounding of 255, 1.5e-5 gray levels; times a change of 255 over
    # λ² that is less than 1e-3 px.
    np.testing.assert_allclose(HornSchunck(mode).calc(frame0, frame1), 0.0, atol=1e-3)


@settings(max_examples=15, deadline=None)
@given(st.integers(20, 60), st.integers(20, 60), st.sampled_from(MODES), st.integers(0, 99))
def test_flow_transposes_with_the_image(height, width, mode, seed):
    """Transposed frames give the transposed flow with u and v exchanged."""
    frame0, frame1 = texture(height, width, seed=seed), texture(height, width, 0.6, -0.4, seed=seed)
    solver = HornSchunck(mode)
    turned = solver.calc(np.ascontiguousarray(frame0.T), np.ascontiguousarray(frame1.T))
    np.testing.assert_allclose(
        turned.transpose(1, 0, 2)[..., ::-1], solver.calc(frame0, frame1), atol=SYMMETRY_TOLERANCE
    )


@settings(max_examples=15, deadline=None)
@given(st.integers(20, 60), st.integers(20, 60), st.sampled_from(MODES), st.sampled_from((0, 1)), st.integers(0, 99))
def test_flow_flips_with_the_image(height, width, mode, axis, seed):
    """Flipped frames give the flipped flow with that component negated (masks centred on the pixel)."""
    frame0, frame1 = texture(height, width, seed=seed), texture(height, width, 0.6, -0.4, seed=seed)
    solver = HornSchunck(mode, derivative="five-tap")
    flipped = solver.calc(np.flip(frame0, axis), np.flip(frame1, axis))
    flipped = np.flip(flipped, axis) * (np.float32([1, -1]) if axis == 0 else np.float32([-1, 1]))
    np.testing.assert_allclose(flipped, solver.calc(frame0, frame1), atol=SYMMETRY_TOLERANCE)


@settings(max_examples=20, deadline=None)
@given(st.sampled_from(MODES), st.floats(0.2, 4.0), st.integers(0, 99))
def test_lambda_is_in_units_of_intensity(mode, factor, seed):
    """Frames times k, with λ (and the outlier scale) times k, give the same flow."""
    frame0, frame1 = texture(40, 40, seed=seed), texture(40, 40, 0.6, -0.4, seed=seed)
    scale = {"outlier": 10.0 * factor} if mode in WARPING else {}
    base = {"outlier": 10.0} if mode in WARPING else {}
    plain = HornSchunck(mode, smoothness=8.0, gain=1.0, **base).calc(frame0, frame1)
    k = np.float32(factor)
    scaled = HornSchunck(mode, smoothness=8.0 * factor, gain=1.0, **scale).calc(k * frame0, k * frame1)
    np.testing.assert_allclose(scaled, plain, atol=SYMMETRY_TOLERANCE)


def test_cube_derivatives_are_the_papers():
    """The cube equals the reference, and a ramp moving right has its slope, and −slope times the speed in time."""
    frame0, frame1 = noise(21, 34, 6), noise(21, 34, 7)
    for ours, theirs in zip(derivatives(frame0, frame1), reference.derivatives(frame0, frame1), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-4)
    x = np.mgrid[:10, :12][1].astype(np.float32)
    fx, fy, ft = derivatives(100 + 3 * x, 100 + 3 * (x - 0.5))
    np.testing.assert_allclose(fx[:, :-1], 3.0, atol=1e-4)
    np.testing.assert_allclose(fy, 0.0, atol=1e-4)
    np.testing.assert_allclose(ft, -1.5, atol=1e-4)


def test_five_tap_derivatives_are_exact_for_quartics():
    """The 5-tap mask differentiates polynomials up to the fourth degree exactly."""
    y, x = np.mgrid[:9, :9] - 4.0
    quartic = 128 + x**4 / 8 - y**3 + x * y
    fx, fy, ft = derivatives(quartic, quartic + 5, "five-tap")
    inside = np.s_[2:-2, 2:-2]
    np.testing.assert_allclose(fx[inside], (x**3 / 2 + y)[inside], atol=1e-3)
    np.testing.assert_allclose(fy[inside], (-3 * y**2 + x)[inside], atol=1e-3)
    np.testing.assert_allclose(ft, 5.0, atol=1e-3)


def test_normal_flow_is_the_displacement_along_the_gradient():
    """For a slanted ramp the normal flow is the projection of the displacement on the gradient; flat is zero."""
    y, x = np.mgrid[:20, :20].astype(np.float32)
    ramp = 50 + 2 * x + 1 * y
    moved = 50 + 2 * (x - 0.5) + 1 * (y - 0.25)
    field = normal_flow(*derivatives(ramp, moved))
    along = np.array([2.0, 1.0]) * (2 * 0.5 + 1 * 0.25) / 5.0
    np.testing.assert_allclose(field[:-1, :-1], np.broadcast_to(along, (19, 19, 2)), atol=1e-4)
    zero = np.zeros((4, 5), np.float32)
    assert not normal_flow(zero, zero, zero + 9).any()
    assert field.dtype == np.float32


def test_stream_keeps_the_previous_frame():
    """Estimate gives zero first, then what calc gives for the last two frames, and zero again after reset."""
    frames = [texture(40, 48, 0.5 * i) for i in range(3)]
    solver = HornSchunck("fast")
    assert not solver.estimate(frames[0]).flow.any()
    for previous, current in itertools.pairwise(frames):
        passed = current.copy()
        field = solver.estimate(passed)
        passed[:] = 0  # the caller may reuse the buffer
        np.testing.assert_array_equal(field.flow, HornSchunck("fast").calc(previous, current))
    with pytest.raises(InputError, match="one size"):
        solver.estimate(texture(30, 30))
    solver.reset()
    assert not solver.estimate(texture(30, 30)).flow.any()


def test_field_has_matlabs_names():
    """Vx, Vy, Orientation and Magnitude agree with the flow."""
    field = FlowField(np.float32([[[3, 4], [0, -2]]]))
    np.testing.assert_array_equal(field.Vx, [[3, 0]])
    np.testing.assert_array_equal(field.Vy, [[4, -2]])
    np.testing.assert_allclose(field.Magnitude, [[5, 2]])
    np.testing.assert_allclose(field.Orientation, [[np.arctan2(4, 3), -np.pi / 2]])


def test_field_plots_arrows():
    """Plot draws one arrow per decimation step, scaled, with the image's y axis downwards."""
    figure = pytest.importorskip("matplotlib.figure").Figure()
    axes = figure.add_subplot()
    field = FlowField(np.full((20, 30, 2), (1.0, 2.0), np.float32))
    assert field.plot(axes, decimation=10, scale=3.0) is axes
    (arrows,) = axes.collections
    np.testing.assert_array_equal(arrows.U, np.full(6, 3.0))
    np.testing.assert_array_equal(arrows.V, np.full(6, 6.0))
    assert axes.yaxis_inverted()
    with pytest.raises(ValueError, match="decimation"):
        field.plot(axes, decimation=0)


@pytest.mark.parametrize(
    ("mode", "options", "message"),
    [
        ("quick", {}, "mode.*'quick'"),
        ("classic", {"warps": 2}, "warps=2"),
        ("solve", {"ratio": 0.5}, "ratio=0.5"),
        ("default", {"tolerance": 1e-3}, "tolerance=0.001"),
        ("default", {"smoothness": 0.0}, "smoothness.*0.0"),
        ("default", {"smoothness": float("nan")}, "smoothness.*nan"),
        ("default", {"iterations": 0}, "iterations.*0"),
        ("default", {"levels": 0}, "levels.*0"),
        ("default", {"ratio": 1.0}, "ratio.*1.0"),
        ("default", {"median": 4}, "median.*4"),
        ("default", {"presmooth": -0.1}, "presmooth.*-0.1"),
        ("default", {"outlier": -1.0}, "outlier.*-1.0"),
        ("solve", {"exposure": True}, "exposure=True"),
        ("default", {"derivative": "sobel"}, "derivative.*'sobel'"),
        ("default", {"gain": 0.0}, "gain.*0.0"),
        ("solve", {"tolerance": 0.0}, "tolerance.*0.0"),
    ],
)
def test_bad_parameters_are_named(mode, options, message):
    """A parameter that is wrong, or means nothing in the mode, is named in the error with its value."""
    with pytest.raises(ValueError, match=message):
        HornSchunck(mode, **options)


def test_parameters_are_values():
    """FlowParams are equal by value, hashable and frozen."""
    assert FlowParams.preset("fast") == HornSchunck("fast").params
    assert hash(FlowParams.preset("fast")) != hash(FlowParams.preset("fast", warps=2))
    with pytest.raises(AttributeError):
        FlowParams.preset("fast").warps = 3


@pytest.mark.parametrize("derivative", ["cube", "five-tap"])
def test_unlike_frames_are_refused(derivative):
    """Frames of two sizes, a start field of another and an unknown mask are errors that name what they got."""
    small, large = texture(20, 20), texture(20, 24)
    with pytest.raises(InputError, match="20 × 20 and 24 × 20"):
        HornSchunck("fast", derivative=derivative).calc(small, large)
    with pytest.raises(InputError, match="one size"):
        derivatives(small, large, derivative)
    with pytest.raises(ValueError, match="'sobel'"):
        derivatives(small, small, "sobel")
    with pytest.raises(InputError, match="NoneType"):
        HornSchunck("fast").calc(None, small)
