"""Flow comparison: metrics against hand cases, .flo files, colour wheel, running, keeping and tabulating results."""

import json
import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from datasets_synthetic.export import write_flo
from eval.flow import command as flow
from eval.flow import data as flow_data
from eval.flow import methods as flow_methods
from eval.flow import metrics as flow_metrics
from eval.flow import picture as flow_picture
from eval.flow import plots as flow_plots
from eval.flow import run as flow_run
from eval.flow import tables as flow_tables
from eval.results import FlowResult

WHOLE = np.ones((6, 8), bool)


def constant(u, v, shape=(6, 8)):
    """A flow that is the same everywhere."""
    return np.full((*shape, 2), (u, v), np.float32)


def make_pair(name="pair", shift=(1.0, 0.0), size=(40, 56), group="", seed=1):
    """A textured pair whose second frame is the first moved by a whole or half pixel."""
    rng = np.random.default_rng(seed)
    canvas = cv2.GaussianBlur(rng.uniform(0, 255, (size[0] + 16, size[1] + 16)).astype(np.float32), (0, 0), 1.5)
    canvas = cv2.normalize(canvas, None, 20, 235, cv2.NORM_MINMAX)
    place = [[1.0, 0.0, -8.0], [0.0, 1.0, -8.0]]
    frames = []
    for t in (0, 1):
        matrix = np.array(place) + np.array([[0, 0, t * shift[0]], [0, 0, t * shift[1]]])
        image = cv2.warpAffine(canvas, matrix, size[::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT)
        frames.append(cv2.cvtColor(np.clip(np.rint(image), 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR))
    valid = np.zeros(size, bool)
    valid[8:-8, 8:-8] = True
    return flow_data.FlowPair(name, tuple(frames), 0, constant(*shift, size), valid, group)


@pytest.mark.parametrize(
    ("reference", "estimated", "epe", "angle"),
    [
        ((0, 0), (0, 0), 0.0, 0.0),  # nothing moves and nothing was found
        ((1, 2), (1, 2), 0.0, 0.0),  # exact
        ((0, 0), (3, 4), 5.0, math.degrees(math.acos(1 / math.sqrt(26)))),  # 3-4-5 triangle
        ((1, 0), (0, 0), 1.0, 45.0),  # (1, 0, 1) against (0, 0, 1)
        ((1, 0), (-1, 0), 2.0, 90.0),  # opposite unit vectors
        ((1, 0), (0, 1), math.sqrt(2), 60.0),  # (1, 0, 1) against (0, 1, 1): cos = 1/2
    ],
)
def test_errors_equal_hand_computed_values(reference, estimated, epe, angle):
    """Endpoint and angular error of one vector equal the values computed by hand."""
    truth, guess = constant(*reference), constant(*estimated)
    assert flow_metrics.endpoint_error(truth, guess, WHOLE) == pytest.approx(np.full(48, epe), abs=1e-9)
    assert flow_metrics.angular_error(truth, guess, WHOLE) == pytest.approx(np.full(48, angle), abs=1e-5)


vectors = st.tuples(*[st.floats(-40, 40, width=32)] * 4)


@given(vectors)
def test_angle_agrees_with_the_arc_cosine_of_barron(components):
    """The angle equals the textbook formula, by an independent computation, and is symmetric."""
    u, v, p, q = components
    cosine = (u * p + v * q + 1) / math.sqrt((u * u + v * v + 1) * (p * p + q * q + 1))
    angle = flow_metrics.angular_error(constant(u, v, (1, 1)), constant(p, q, (1, 1)), np.ones((1, 1), bool))[0]
    back = flow_metrics.angular_error(constant(p, q, (1, 1)), constant(u, v, (1, 1)), np.ones((1, 1), bool))[0]
    # The arc cosine itself is only good to the square root of the rounding error near 0.
    assert angle == pytest.approx(math.degrees(math.acos(min(max(cosine, -1), 1))), abs=1e-4)
    assert angle == pytest.approx(back, abs=1e-9)


def test_scores_of_the_truth_itself_are_exactly_zero():
    """An oracle scores exactly 0 in every metric."""
    truth = np.random.default_rng(2).normal(0, 5, (20, 30, 2)).astype(np.float32)
    scores = flow_metrics.flow_scores(truth, truth.copy(), np.ones((20, 30), bool))
    assert set(scores) == set(flow_metrics.FLOW_METRICS)
    assert all(value == 0.0 for value in scores.values())


def test_unknown_pixels_do_not_count():
    """Errors, even infinite ones, at pixels that are not valid change nothing."""
    truth, guess, valid = constant(1, 0), constant(1, 1), WHOLE.copy()
    guess[0, 0], valid[0, 0] = np.inf, False
    assert flow_metrics.flow_scores(truth, guess, valid)["aepe"] == 1.0


def test_moving_error_looks_at_moving_pixels_only():
    """A method that says "nothing moves" has the moving part's length as its error there."""
    truth = constant(0, 0)
    truth[:, :2] = (3, 4)
    scores = flow_metrics.flow_scores(truth, constant(0, 0), WHOLE)
    assert (scores["moving"], scores["aepe"], scores["r1"]) == (5.0, 1.25, 25.0)
    assert math.isnan(flow_metrics.flow_scores(constant(0, 0), constant(0, 0), WHOLE)["moving"])


@pytest.mark.parametrize(
    ("estimated", "valid", "message"),
    [
        (
            constant(0, 0, (6, 7)),
            WHOLE,
            r"expected reference flow of shape \(6, 7, 2\), got \(6, 8, 2\)|valid of shape",
        ),
        (np.zeros((6, 8)), WHOLE, r"expected estimated flow of shape \(H, W, 2\), got \(6, 8\)"),
        (constant(0, 0), WHOLE[:3], r"expected valid of shape \(6, 8\), got \(3, 8\)"),
        (constant(0, 0), ~WHOLE, "at least one pixel with known flow, got none"),
        (constant(np.nan, 0), WHOLE, "finite estimated flow at every valid pixel, got 48 of 48"),
    ],
)
def test_metrics_refuse_what_cannot_be_compared(estimated, valid, message):
    """Wrong shapes, no valid pixel and non-finite estimates raise, naming what was found."""
    with pytest.raises(ValueError, match=message):
        flow_metrics.flow_scores(constant(0, 0), estimated, valid)


def write_known(path, flow, valid):
    """As Middlebury writes a flow of which some pixels are not known."""
    write_flo(path, np.where(valid[..., np.newaxis], flow, np.float32(1e10)))


def test_flo_round_trip(tmp_path):
    """A flow with unknown pixels survives writing and reading bit by bit."""
    rng = np.random.default_rng(3)
    truth, valid = rng.normal(0, 9, (7, 5, 2)).astype(np.float32), rng.random((7, 5)) > 0.3
    write_known(tmp_path / "a.flo", truth, valid)
    again, known = flow_data.known_flow(tmp_path / "a.flo")
    assert np.array_equal(known, valid)
    assert np.array_equal(again[valid], truth[valid])
    assert not again[~valid].any()


@pytest.mark.parametrize("content", [b"", b"PIEH", b"PIEH\x08\0\0\0\x06\0\0\0short", b"not a flow file at all"])
@pytest.mark.parametrize("name", ["flow10.flo", "frame10.png", "frame11.png"])
def test_what_cannot_be_read_of_a_pair_is_named(tmp_path, name, content):
    """A broken file, or an empty one, raises with its path."""
    folder = middlebury_folder(tmp_path, ["pair"])
    (folder / "pair" / name).write_bytes(content)
    with pytest.raises(ValueError, match=name):
        list(flow_data.dataset_pairs(f"middlebury:{folder}"))


def test_an_empty_truth_of_kitti_is_named(tmp_path):
    """It is no image."""
    (tmp_path / "flow_occ").mkdir()
    (tmp_path / "flow_occ" / "000000_10.png").touch()
    with pytest.raises(ValueError, match=r"expected a readable image, got .*000000_10\.png"):
        list(flow_data.dataset_pairs(f"kitti:{tmp_path}"))


def middlebury_folder(root, names):
    """A folder in Middlebury's layout with one tiny pair under every name."""
    for number, name in enumerate(names):
        pair = make_pair(name, seed=number)
        (root / name).mkdir()
        cv2.imwrite(str(root / name / "frame10.png"), pair.first)
        cv2.imwrite(str(root / name / "frame11.png"), pair.second)
        write_known(root / name / "flow10.flo", pair.flow, pair.valid)
    return root


def test_middlebury_folder_is_read_with_its_split(tmp_path):
    """Pairs come by name, frames and truth intact; the four tuning scenes are told from the others."""
    names = ["Dimetrodon", "Grove2", "RubberWhale", "Urban2", "Venus"]
    pairs = list(flow_data.dataset_pairs(f"middlebury:{middlebury_folder(tmp_path, names)}"))
    assert [pair.name for pair in pairs] == names
    assert [pair.group for pair in pairs] == ["tuned on"] * 4 + ["held out"]
    assert np.array_equal(pairs[1].second, make_pair(seed=1).second)
    assert np.array_equal(pairs[1].valid, make_pair(seed=1).valid)


def test_other_folders_have_no_split(tmp_path):
    """A folder that is not Middlebury's own gets no groups."""
    pairs = flow_data.dataset_pairs(f"middlebury:{middlebury_folder(tmp_path, ['mine', 'Venus'])}")
    assert [pair.group for pair in pairs] == ["", ""]


@pytest.mark.parametrize("dataset", ["sintel:/tmp", "middlebury:", "middlebury", "middlebury:/nowhere"])
def test_unknown_dataset_is_named(dataset):
    """A dataset that cannot be read raises and says what was expected."""
    with pytest.raises(ValueError, match="expected"):
        list(flow_data.dataset_pairs(dataset))


def test_suite_pairs_have_exact_truth_and_context():
    """Warping the second frame of a synthetic pair by its true flow gives the first, nearly."""
    pairs = list(flow_data.suite_pairs("smoke", 1))
    assert len({pair.name for pair in pairs}) == len(pairs) >= 2
    assert all(len(pair.frames) > 2 for pair in pairs)
    pair = pairs[0]
    rows, columns = np.mgrid[: pair.first.shape[0], : pair.first.shape[1]].astype(np.float32)
    moved = cv2.remap(pair.second, columns + pair.flow[:, :, 0], rows + pair.flow[:, :, 1], cv2.INTER_LINEAR)
    moving = pair.valid & (np.hypot(*np.moveaxis(pair.flow, 2, 0)) > 0.5)
    before, after = (
        np.abs(pair.first[moving].astype(float) - image[moving]).mean() for image in (pair.second, moved)
    )
    assert after < 0.7 * before


def test_unknown_suite_names_the_known_ones():
    """The error lists the suites there are."""
    with pytest.raises(ValueError, match=r"unknown suite 'smok'; known: .*smoke"):
        list(flow_data.suite_pairs("smok", 1))


def test_pair_refuses_truth_of_another_size():
    """A pair checks its sizes and its index."""
    pair = make_pair()
    with pytest.raises(ValueError, match="one size"):
        flow_data.FlowPair("bad", pair.frames, 0, pair.flow[:-1], pair.valid)
    with pytest.raises(ValueError, match="index below 1 for 2 frames, got 1"):
        flow_data.FlowPair("bad", pair.frames, 1, pair.flow, pair.valid)


def test_no_motion_is_white_and_unknown_is_black():
    """The wheel's centre is white; unknown and non-finite pixels are black."""
    still, valid = constant(0, 0), WHOLE.copy()
    still[0, 0, 0], valid[1, 1] = np.nan, False
    picture = flow_picture.flow_to_color(still, 5.0, valid)
    assert (picture[2:] == 255).all()
    assert not picture[0, 0].any()
    assert not picture[1, 1].any()


def hue(u, v):
    """Hue of a flow of full length, degrees."""
    pixel = flow_picture.flow_to_color(constant(u, v, (1, 1)), 1.0)
    return 2.0 * float(cv2.cvtColor(pixel, cv2.COLOR_BGR2HSV)[0, 0, 0])


@given(st.floats(0, 2 * math.pi))
def test_opposite_directions_have_opposite_hues(angle):
    """Opposite motions are more than a quarter of the colour circle apart (the wheel's steps are not even)."""
    one, other = hue(math.cos(angle), math.sin(angle)), hue(-math.cos(angle), -math.sin(angle))
    assert min((one - other) % 360, (other - one) % 360) > 90


@pytest.mark.parametrize(
    ("direction", "color"),
    [((1, 0), 0), ((0, 1), 55), ((-1, 0), 194), ((0, -1), 264)],  # right, down, left, up
)
def test_wheel_is_middleburys(direction, color):
    """Right is red, down yellow, left a blue cyan, up violet."""
    assert hue(*direction) == pytest.approx(color, abs=2.5)


def test_longer_motion_is_more_saturated_and_out_of_range_is_darker():
    """Saturation grows with length up to the longest flow; beyond it the colour is darkened."""
    levels = [flow_picture.flow_to_color(constant(r, 0, (1, 1)), 1.0)[0, 0].astype(int) for r in (0.2, 0.5, 1.0, 1.5)]
    saturation = [color.max() - color.min() for color in levels]
    assert saturation[0] < saturation[1] < saturation[2]
    assert levels[3].max() < levels[2].max()


def test_color_refuses_bad_input():
    """Wrong shapes and a longest flow that is not positive raise."""
    with pytest.raises(ValueError, match="shape"):
        flow_picture.flow_to_color(np.zeros((4, 4)), 1.0)
    with pytest.raises(ValueError, match="positive longest flow, got 0"):
        flow_picture.flow_to_color(constant(0, 0), 0)


OWN_METHODS = """
import os
import time

import numpy as np

from eval.flow.methods import MissingLibraryError


def oracle():
    return lambda first, second: np.full((*first.shape[:2], 2), (1, 0), np.float32)


def raising():
    return lambda first, second: 1 // 0


def crashing():
    return lambda first, second: os._exit(3)


def sleeping():
    return lambda first, second: time.sleep(60)


def chatty():
    def calc(first, second):
        print("chatter", flush=True)
        os.system("echo chatter of a C library")
        return np.zeros((*first.shape[:2], 2))

    return calc


def misshapen():
    return lambda first, second: np.zeros((3, 3, 2))


def half_blind():
    return lambda first, second: np.full((*first.shape[:2], 2), np.nan)


def missing():
    raise MissingLibraryError("cv2.magic is not in this wheel")
"""


@pytest.fixture(autouse=True)
def own_methods(tmp_path_factory, monkeypatch):
    """Make ``own_methods`` importable here and in the methods' processes."""
    folder = tmp_path_factory.mktemp("own")
    (folder / "own_methods.py").write_text(OWN_METHODS)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    monkeypatch.syspath_prepend(str(folder))


def run_one(name, tmp_path, pair=None, **options):
    """One result of one method."""
    with flow_run.MethodProcess(name) as process:
        return flow_run.run_pair(process, pair or make_pair(), tmp_path, flow_run.RunOptions(repeats=1, **options))


def test_oracle_scores_zero_through_the_whole_machinery(tmp_path):
    """A method that returns the truth scores 0 and is timed; its picture is that of the truth."""
    pair = make_pair()
    result = run_one("own_methods:oracle", tmp_path, pair)
    assert result.note == ""
    assert all(value == 0.0 for value in result.scores.values())
    assert result.seconds > 0
    assert result.relative > 0
    picture = cv2.imread(str(flow_run.picture_path(tmp_path, pair.name, "own_methods:oracle")))
    assert np.array_equal(picture, flow_picture.flow_to_color(pair.flow, 1.0))


@pytest.mark.parametrize(
    ("factory", "note"),
    [
        ("raising", "failed: ZeroDivisionError"),
        ("crashing", "failed: ended its process with code 3"),
        ("misshapen", "failed: ValueError: expected a flow of shape (40, 56, 2), got (3, 3, 2)"),
        ("half_blind", "failed: expected a finite estimated flow at every valid pixel"),
        ("missing", "skipped: cv2.magic is not in this wheel"),
    ],
)
def test_a_method_that_fails_is_a_note(tmp_path, factory, note):
    """Exceptions, crashes, wrong shapes, NaN and missing libraries become notes, on every pair anew."""
    with flow_run.MethodProcess(f"own_methods:{factory}") as process:
        for name in ("a", "b"):
            result = flow_run.run_pair(process, make_pair(name), tmp_path, flow_run.RunOptions(repeats=1))
            assert result.note.startswith(note)
            assert not result.scores
            assert result.seconds is None


def test_a_method_that_hangs_is_stopped(tmp_path):
    """No answer in time is a note that says so."""
    result = run_one("own_methods:sleeping", tmp_path, timeout=4.0)
    assert result.note == "failed: timed out after 4 s"


def test_what_a_method_prints_does_no_harm(tmp_path):
    """Output of the method or of a library below it does not disturb the exchange."""
    assert run_one("own_methods:chatty", tmp_path).scores["aepe"] == 1.0


def test_one_failure_costs_one_row(tmp_path):
    """The other methods run on, and the table marks the one that failed."""
    names = ["own_methods:raising", "own_methods:oracle"]
    calls = []
    results = flow.compare(
        [make_pair()],
        names,
        tmp_path,
        options=flow_run.RunOptions(repeats=1),
        done=lambda method, pair: calls.append((method, pair)),
    )
    assert calls == [(name, "pair") for name in names]
    summary = flow_tables.summary_table(flow_tables.results_frame(results))
    assert list(summary.index) == names[::-1]
    assert summary.loc[names[1], "aepe"] == 0.0
    assert math.isnan(summary.loc[names[0], "aepe"])
    assert "ZeroDivisionError" in summary.loc[names[0], "note"]


def test_only_what_is_missing_is_run(tmp_path, monkeypatch):
    """A second run answers from disk; a changed pair, a lost picture or a changed method runs again."""
    first = run_one("own_methods:oracle", tmp_path)
    started = []
    start = flow_run.Child
    monkeypatch.setattr(flow_run, "Child", lambda *given: started.append(given) or start(*given))
    assert run_one("own_methods:oracle", tmp_path) == first
    assert started == []
    run_one("own_methods:oracle", tmp_path, make_pair(seed=5))
    assert len(started) == 1
    flow_run.picture_path(tmp_path, "pair", "own_methods:oracle").unlink()
    run_one("own_methods:oracle", tmp_path, make_pair(seed=5))
    assert len(started) == 2
    monkeypatch.setattr(flow_methods.FlowMethod, "fingerprint", lambda method: "new code")
    run_one("own_methods:oracle", tmp_path, make_pair(seed=5))
    assert len(started) == 3


def test_failures_are_not_kept(tmp_path):
    """A failure is tried again by the next run: no file claims it as a result."""
    run_one("own_methods:raising", tmp_path)
    assert list(tmp_path.rglob("*.json")) == []


def test_a_broken_result_file_is_measured_again(tmp_path):
    """A truncated file is not believed."""
    first = run_one("own_methods:oracle", tmp_path)
    (file,) = tmp_path.rglob("*.json")
    file.write_text(file.read_text()[:40])
    assert run_one("own_methods:oracle", tmp_path).scores == first.scores
    assert json.loads(file.read_text())["pair"] == "pair"


def test_fingerprint_follows_source_and_library(monkeypatch):
    """A method's key changes with the version of its library and with the source it names."""
    before = flow_methods.FLOW_METHODS["farneback"].fingerprint()
    assert before == flow_methods.FLOW_METHODS["farneback"].fingerprint()
    assert before != flow_methods.FLOW_METHODS["dis-fast"].fingerprint()
    monkeypatch.setattr(cv2, "__version__", "9.9.9")
    assert before != flow_methods.FLOW_METHODS["farneback"].fingerprint()


def test_fingerprint_follows_what_is_compiled_and_what_others_wrote(tmp_path, monkeypatch):
    """Ours depends on its compiled loops, a method of somebody's own on its source, whatever its version says."""
    ours = flow_methods.FLOW_METHODS["hs-fast"].fingerprint()
    own = flow_methods.flow_method("own_methods:oracle").fingerprint()
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b"#" * path.name.startswith("kernels.cpython"))
    assert flow_methods.FLOW_METHODS["hs-fast"].fingerprint() != ours
    assert flow_methods.flow_method("own_methods:oracle").fingerprint() == own
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b"#" * (path.name == "own_methods.py"))
    assert flow_methods.flow_method("own_methods:oracle").fingerprint() != own


@pytest.mark.parametrize("name", ["cv2:DISOpticalFlow_create", "cv2.optflow:createOptFlow_DenseRLOF"])
def test_any_dense_optical_flow_of_cv2_is_a_method(name, tmp_path):
    """An object with `calc` will do, whether it takes gray frames or colour: a shift by 2 px is found."""
    assert run_one(name, tmp_path, make_pair(shift=(2.0, 0.0), size=(120, 160))).scores["aepe"] < 0.5


def test_kitti_comes_back_to_a_64th_of_a_pixel(tmp_path):
    """Our export is read again: the frames as they are, the flow as exactly as 16 bits hold it."""
    from dataclasses import replace

    from datasets_synthetic import SUITES, render
    from datasets_synthetic.export import write_kitti

    sequence = render(replace(SUITES["smoke"][0], frames=3))
    folder = write_kitti(sequence, tmp_path)
    for where, prefix in ((folder, ""), (tmp_path, f"{sequence.name}-")):
        pairs = list(flow_data.dataset_pairs(f"kitti:{where}"))
        assert [pair.name for pair in pairs] == [f"{prefix}000000", f"{prefix}000001"]
    for t, pair in enumerate(pairs):
        flow, valid = sequence.flow(t)
        np.testing.assert_array_equal(pair.valid, valid)
        np.testing.assert_array_equal(pair.second, sequence.frames[t + 1])
        assert np.abs(pair.flow - flow)[valid].max() <= 1 / 128
    with pytest.raises(ValueError, match="expected a folder with flow_occ"):
        list(flow_data.dataset_pairs(f"kitti:{tmp_path / 'none'}"))


@pytest.mark.parametrize(("name", "message"), [
    ("cv2:DISOpticalFlow_creat", "cannot load 'cv2:DISOpticalFlow_creat'"),
    ("math:pi", "got 'math:pi', which cannot be called"),
    ("nowhere:make", "cannot load 'nowhere:make'"),
])  # fmt: skip
def test_a_mistyped_factory_is_found_before_anything_runs(name, message, tmp_path):
    """It is an error of the command, and no row of notes."""
    with pytest.raises(ValueError, match=message):
        flow.compare([], [name], tmp_path, options=flow.RunOptions())


def test_unknown_method_names_the_known_ones(tmp_path):
    """The error lists every method and says that pkg.module:factory goes too, before anything runs."""
    with pytest.raises(ValueError, match=r"unknown flow method 'zoro'; known: zero, .*belief-propagation") as caught:
        flow.compare([make_pair()], ["zero", "zoro"], tmp_path, options=flow_run.RunOptions())
    assert "pkg.module:factory" in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("options", [{"repeats": 0}, {"budget": 0}, {"timeout": -1}])
def test_run_options_are_checked(options):
    """Senseless options raise and name the value."""
    with pytest.raises(ValueError, match="expected repeats >= 1"):
        flow_run.RunOptions(**options)


def made_results():
    """Results of three methods on three pairs in two groups, made by hand."""
    groups = {"p": "tuned on", "q": "tuned on", "r": "held out"}
    errors = {"zero": (2.0, 4.0, 6.0), "dis-fast": (1.0, 1.0, 4.0), "hs-fast": (0.5, None, 1.0)}
    return [
        FlowResult(
            "key",
            method,
            pair,
            groups[pair],
            {} if error is None else {"aepe": error, "moving": error, "aae": 10 * error, "r1": 0.0},
            None if error is None else 0.002,
            None if error is None else 0.1,
            "failed: no luck" if error is None else "",
        )
        for method, values in errors.items()
        for pair, error in zip(groups, values, strict=True)
    ]


def test_summary_is_the_mean_over_pairs_and_over_each_group():
    """Mean over all pairs and over each group, best first; a method that failed somewhere has no mean."""
    summary = flow_tables.summary_table(flow_tables.results_frame(made_results()))
    assert list(summary.index) == ["dis-fast", "zero", "hs-fast"]
    columns = ["aepe", "aepe tuned on", "aepe held out", "ms"]
    assert list(summary.loc["dis-fast", columns]) == [2.0, 1.0, 4.0, 2.0]
    assert list(summary.loc["zero", columns]) == [4.0, 3.0, 6.0, 2.0]
    assert summary.loc["hs-fast", columns].isna().all()
    assert summary.loc["hs-fast", "note"] == "failed: no luck (1 of 3 pairs)"


def test_tables_are_written(tmp_path):
    """CSV holds every result in full; Markdown shows the means and names every source."""
    table = flow_tables.results_frame(made_results())
    csv, summary, markdown = flow_tables.save_tables(table, tmp_path)
    assert len(csv.read_text().splitlines()) == 10
    assert summary.read_text().splitlines()[1].startswith("dis-fast,OpenCV,2.0,")
    text = markdown.read_text(encoding="utf-8")
    assert "| dis-fast | OpenCV   | 2.000" in text
    assert all(f"`{name}`: " in text for name in ("zero", "dis-fast", "hs-fast"))
    assert "failed: no luck (1 of 3 pairs)" in text


def test_plots_are_made_even_with_a_failed_row(tmp_path):
    """Plots and picture grids come out as images; nothing is drawn when nothing succeeded."""
    table = flow_tables.results_frame(made_results())
    for pair in ("p", "q", "r"):
        flow._save_truth(make_pair(pair), tmp_path)
    files = flow_plots.save_plots(table, tmp_path)
    assert [file.name for file in files] == ["flow-time.png", "flow-pairs.png", "flow-pictures-1.png"]
    shapes = [cv2.imread(str(file)).shape for file in files]
    assert shapes[2] == (5 * flow_plots.TILE_HEIGHT, flow_plots.LABEL_WIDTH + 3 * flow_plots.TILE_WIDTH, 3)
    assert flow_plots.save_plots(table[table["aepe"].isna()], tmp_path) == []


def test_command_line_writes_tables_and_pictures(tmp_path, capsys):
    """``main_flow`` runs from a dataset to files and prints the table."""
    (tmp_path / "data").mkdir()
    folder = middlebury_folder(tmp_path / "data", ["one"])
    flow.main_flow(dataset=f"middlebury:{folder}", methods=("zero", "dis-fast"), repeats=1, out=tmp_path / "out")
    assert "dis-fast" in capsys.readouterr().out
    made = {file.name for file in (tmp_path / "out" / "middlebury").iterdir()}
    assert {"flow.csv", "flow.md", "flow-summary.csv", "flow-time.png", "flow-pictures-1.png"} <= made


def test_suite_and_dataset_exclude_each_other():
    """One source of pairs at a time."""
    with pytest.raises(ValueError, match="either a suite or a dataset"):
        list(flow.collect_pairs("smoke", "middlebury:/tmp", 1))
