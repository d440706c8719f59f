"""Every flow method on known shifts of a textured image."""

import cv2
import numpy as np
import pytest

from eval.baselines import flow_common, flow_discrete, flow_matching, flow_robust
from eval.flow import methods as flow_methods

SIZE = (144, 176)
MARGIN = 16
SHIFTS = {"whole": (2.0, -1.0), "sub-pixel": (0.5, 0.75)}


def textured(shift, count=2):
    """A sequence of ``count`` frames of a random texture that moves by ``shift`` px per frame."""
    rng = np.random.default_rng(11)
    canvas = np.zeros((SIZE[0] + 64, SIZE[1] + 64), np.float32)
    for sigma in (1.2, 3.0, 8.0):
        noise = cv2.GaussianBlur(rng.normal(size=canvas.shape).astype(np.float32), (0, 0), sigma)
        canvas += noise / noise.std()
    canvas = 127.0 + 35.0 * canvas
    frames = []
    for t in range(count):
        matrix = np.array([[1.0, 0.0, t * shift[0] - 32], [0.0, 1.0, t * shift[1] - 32]])
        moved = cv2.warpAffine(canvas, matrix, SIZE[::-1], flags=cv2.INTER_CUBIC)
        frame = np.clip(np.rint(moved), 0, 255).astype(np.uint8)
        frame.flags.writeable = False
        frames.append(frame)
    return frames


def inner_error(flow, shift):
    """Mean endpoint error away from the border, px."""
    difference = flow[MARGIN:-MARGIN, MARGIN:-MARGIN] - np.array(shift)
    return float(np.hypot(difference[:, :, 0], difference[:, :, 1]).mean())


@pytest.fixture(scope="module")
def functions():
    """Every method, made once."""
    made = {}

    def get(name):
        if name not in made:
            try:
                made[name] = flow_methods.FLOW_METHODS[name].factory()
            except flow_methods.MissingLibraryError as missing:
                pytest.skip(str(missing))
        return made[name]

    return get


# Classic Horn–Schunck is one linearisation: it follows motions of about a pixel only in part.
SINGLE_SCALE = {"hs-classic", "hs-solve", "paper"}


@pytest.mark.parametrize("kind", SHIFTS)
@pytest.mark.parametrize("name", [name for name in flow_methods.FLOW_METHODS if name != "zero"])
def test_method_follows_a_textured_shift(functions, name, kind):
    """On a shifted texture every method is far better than zero flow, in gray and unchanged input."""
    shift, method = SHIFTS[kind], flow_methods.FLOW_METHODS[name]
    frames = textured(shift)
    flow = flow_methods.estimate_flow(method, functions(name), frames, 0)
    assert flow.dtype == np.float32
    assert inner_error(flow, shift) < (0.8 if name in SINGLE_SCALE else 0.35) * np.hypot(*shift)


@pytest.mark.parametrize("name", flow_methods.FLOW_METHODS)
def test_method_takes_color_and_odd_sizes(functions, name):
    """BGR frames of odd size give a finite flow of that size."""
    frames = [cv2.cvtColor(frame[:133, :171], cv2.COLOR_GRAY2BGR) for frame in textured((1.0, 0.0))]
    flow = flow_methods.estimate_flow(flow_methods.FLOW_METHODS[name], functions(name), frames, 0)
    assert flow.shape == (133, 171, 2)
    assert np.isfinite(flow).all()


def test_zero_flow_is_zero(functions):
    """The null baseline says that nothing moves."""
    flow = flow_methods.estimate_flow(flow_methods.FLOW_METHODS["zero"], functions("zero"), textured((3.0, 0.0)), 0)
    assert not flow.any()


@pytest.mark.parametrize(
    "name", ["match-ssd", "match-ncc", "phase-correlation", "lucas-kanade", "belief-propagation"]
)
def test_pyramids_and_blocks_follow_large_motion(functions, name):
    """A motion far beyond a window's own reach is found coarse to fine."""
    shift = (11.0, -7.0)
    flow = flow_methods.estimate_flow(flow_methods.FLOW_METHODS[name], functions(name), textured(shift), 0)
    assert inner_error(flow, shift) < 2.0


def test_ncc_does_not_mind_a_change_of_light(functions):
    """Gain and offset between the frames leave block matching by correlation unharmed, but not by differences."""
    first, second = textured((2.0, 1.0))
    darker = np.rint(0.6 * second + 10).astype(np.uint8)
    errors = {name: inner_error(functions(name)(first, darker), (2.0, 1.0)) for name in ("match-ncc", "match-ssd")}
    assert errors["match-ncc"] < 0.3 < errors["match-ssd"]


def test_buxton_uses_the_frames_round_the_pair(functions):
    """With frames on either side the answer differs from the pair's alone, and still follows the motion."""
    shift = (0.75, -0.5)
    frames, method = textured(shift, 6), flow_methods.FLOW_METHODS["buxton-buxton"]
    alone = flow_methods.estimate_flow(method, functions("buxton-buxton"), frames[2:4], 0)
    round_it = flow_methods.estimate_flow(method, functions("buxton-buxton"), frames, 2)
    assert not np.array_equal(alone, round_it)
    assert inner_error(round_it, shift) < 0.35 * np.hypot(*shift)


def two_motions():
    """A textured square that moves right over a background that moves left."""
    back, front = textured((-1.5, 0.0)), textured((2.0, 1.0))
    truth = np.full((*SIZE, 2), (-1.5, 0.0), np.float32)
    truth[50:100, 60:120] = (2.0, 1.0)
    first, second = back[0].copy(), back[1].copy()
    first[50:100, 60:120] = front[0][50:100, 60:120] // 2
    second[51:101, 62:122] = front[0][50:100, 60:120] // 2
    return first, second, truth


@pytest.mark.parametrize("name", ["black-anandan", "black-jepson", "belief-propagation"])
def test_motion_boundaries_survive(functions, name):
    """Methods that model discontinuities find both of two motions well inside their regions."""
    first, second, truth = two_motions()
    flow = functions(name)(first, second)
    error = np.hypot(*np.moveaxis(flow - truth, 2, 0))
    assert np.median(error[60:90, 72:108]) < 0.3
    assert np.median(error[MARGIN:40, MARGIN:-MARGIN]) < 0.3


@pytest.mark.parametrize("attribute", ["optflow", "createOptFlow_DeepFlow"])
def test_missing_library_is_named(monkeypatch, attribute):
    """A wheel without the module or the function raises what the tables show as a skipped row."""
    if attribute == "optflow":
        monkeypatch.delattr(cv2, "optflow", raising=False)
    elif hasattr(cv2, "optflow"):
        monkeypatch.delattr(cv2.optflow, attribute, raising=False)
    with pytest.raises(
        flow_methods.MissingLibraryError, match=r"cv2\.optflow\.createOptFlow_DeepFlow is not in this"
    ):
        flow_methods.FLOW_METHODS["deepflow"].factory()


def test_every_method_says_where_it_is_from():
    """Each entry names its family and its publication or null hypothesis."""
    for name, method in flow_methods.FLOW_METHODS.items():
        assert method.family in {"null", "ours", "OpenCV", "scikit-image", "surveyed"}, name
        assert len(method.source) > 10, name


def test_parametric_fit_is_exact_on_an_affine_flow():
    """Black–Jepson's region fit reproduces an affine flow over two regions of different motion."""
    x, y = flow_common.pixel_grid((60, 80))
    regions = (x > 39).astype(np.int32)
    one = np.stack([0.02 * x - 0.01 * y + 1, 0.03 * y - 2], axis=2)
    other = np.stack([-0.01 * x + 0.5, 0.02 * x], axis=2)
    coarse = np.where(regions[:, :, np.newaxis] == 0, one, other).astype(np.float32)
    fitted = flow_robust._fitted(coarse, regions)
    assert np.abs(fitted - coarse).max() < 0.02


def test_message_is_the_least_cost_over_the_senders_labels():
    """A belief propagation message equals the minimum over all pairs of labels, written out, also between bases."""
    rng = np.random.default_rng(4)
    side, step = flow_discrete.SIDE, 0.5
    energy = flow_discrete._Energy(smoothness=3.0, smooth_truncation=4.0)
    said = rng.uniform(0, 10, (side, side, 2, 3)).astype(np.float32)
    shift = rng.integers(-2, 3, (2, 3, 2)).astype(np.int32)
    expected = np.empty_like(said)
    labels = [(row, column) for row in range(side) for column in range(side)]
    for i, j in np.ndindex(2, 3):
        for row, column in labels:
            expected[row, column, i, j] = min(
                said[k, m, i, j]
                + min(3.0 * step * (abs(row + shift[i, j, 1] - k) + abs(column + shift[i, j, 0] - m)), 4.0)
                for k, m in labels
            )
    expected -= expected.min(axis=(0, 1))
    assert flow_discrete._message(said.copy(), shift, step, energy) == pytest.approx(expected, abs=1e-4)


def test_parabola_finds_the_minimum_of_a_quadratic_cost():
    """Sub-pixel refinement is exact where the cost is a parabola."""
    offsets = np.arange(-2, 3, dtype=np.float32)
    cost = (offsets[:, None] - 0.3) ** 2 + 2 * (offsets[None, :] + 0.6) ** 2
    volume = np.ascontiguousarray(np.broadcast_to(cost[:, :, None, None], (5, 5, 3, 4)))
    best = flow_matching._best_offset(volume)
    assert best == pytest.approx(np.broadcast_to(np.float32([-0.6, 0.3]), (3, 4, 2)), abs=1e-5)


def test_resized_flow_scales_its_vectors():
    """Flow at twice the resolution has vectors twice as long, per axis."""
    flow = np.full((4, 6, 2), (1.0, 2.0), np.float32)
    assert flow_common.resize_flow(flow, (8, 18)) == pytest.approx(np.broadcast_to([3.0, 4.0], (8, 18, 2)))
