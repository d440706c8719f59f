"""The boundary of segmentation's kernels: what each refuses is named; all levels give the same bits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from hs_tracker_cv._native import kernels
from hs_tracker_cv._native.kernels import segmentation
from tests.conftest import LIKELIHOOD

pytestmark = pytest.mark.once

H, W = 21, 37  # not a whole number of blocks
GRID = (18.0, 10.0, 8.0, 100.0)
Arguments = dict[str, Any]


def noise(*shape: int, low: float = 0.0, high: float = 255.0) -> np.ndarray:
    """Random float32 that are the same in every call."""
    return np.random.default_rng(sum(shape)).uniform(low, high, shape).astype(np.float32)


def mask(*, density: float = 0.4) -> np.ndarray:
    """A random mask."""
    return (np.random.default_rng(3).uniform(size=(H, W)) < density).astype(np.uint8)


def rectangle() -> np.ndarray:
    """Most of the window."""
    return np.array((1, 2, W - 1, H - 3), np.int64)


def histograms() -> np.ndarray:
    """Shares of colours of object and background."""
    shares = noise(2, segmentation.BINS, high=1.0)
    return np.asarray(shares / shares.sum(axis=1, keepdims=True), np.float32)


def points() -> np.ndarray:
    """Points of registration in the window."""
    listed = np.zeros((segmentation.POINT_ROWS, 300), np.float32)
    segmentation.collect(noise(H, W, 3), noise(H, W, high=1.0), GRID, 3, segmentation.Points(listed))
    return listed


INVERSE = np.array((1.02, 0.01, -0.3, -0.02, 0.98, 0.6))
THETA = np.array((0.3, 0.1, -0.1, -0.4, 0.05, 0.1, 1.0, 2.0))


def image() -> np.ndarray:
    """A window."""
    return noise(H, W, 3)


def plane() -> np.ndarray:
    """Log-odds."""
    return noise(H, W, low=-3.0, high=3.0)


def counts() -> np.ndarray:
    """Samples, mismatches and age of a background."""
    return np.floor(noise(3, H, W, high=9.0))


def layer() -> Arguments:
    """What belongs to the object, and where it goes."""
    return {
        "previous": image(),
        "obj": noise(H, W, 3)[::-1].copy(),
        "odds": plane(),
        "shape": noise(H, W, high=1.0),
        "inverse": INVERSE,
        "counts": counts(),
        "part": rectangle(),
        "everywhere": False,
        "previous_out": image(),
        "obj_out": image(),
        "odds_out": plane(),
        "shape_out": plane(),
        "own_out": mask(),
    }


def scene() -> Arguments:
    """Images of a frame and of what explains it."""
    return {
        "image": image(),
        "background": noise(H, W, 3) + 1,
        "moved": noise(H, W, 3) - 2,
        "counts": counts(),
        "part": rectangle(),
        "inside": rectangle(),
        "likelihood": LIKELIHOOD,
        "planes_out": noise(4, H, W),
        "fresh_out": mask(),
    }


def layer_as_expected() -> Arguments:
    """What belongs to the object where it is expected."""
    names = ("previous", "obj", "odds", "shape", "part")
    return {**{name: layer()[name] for name in names}, "own": mask(density=0.3)}


def valid() -> dict[Callable[..., Any], Arguments]:
    """Arguments that each kernel takes, by name."""
    flow, theta = noise(H, W, 2, low=-1.0, high=1.0), np.zeros(8)
    listed = points()
    bins = np.random.default_rng(4).integers(0, segmentation.BINS, (H, W)).astype(np.int16)
    registered = {"rows": listed, "count": 200, "inside": rectangle(), "image": image()}
    return {
        segmentation.without: {"mask": mask(), "other": mask(density=0.7), "out": mask()},
        segmentation.invert: {"mask": mask(), "out": mask()},
        segmentation.median: {"mask": mask(), "out": mask()},
        segmentation.spread: {"allowed": mask(), "times": 2, "out": mask(density=0.1)},
        segmentation.widen: {"mask": mask(density=0.1), "reach": 2, "out": mask()},
        segmentation.widen_cross: {"mask": mask(density=0.1), "out": mask()},
        segmentation.components: {
            "mask": mask(),
            "other": mask(density=0.7),
            "runs": np.zeros((H * ((W + 1) // 2), 6), np.int32),
        },
        segmentation.bin_colours: {"image": image(), "bins": bins},
        segmentation.likelihood: {"colours": histograms(), "ratio": noise(segmentation.BINS)},
        segmentation.blend: {
            "colours": histograms(),
            "tally": noise(2, segmentation.BINS),
            "rate": 0.1,
            "out": histograms(),
        },
        segmentation.smooth: {
            "pixels": noise(H + 4, W + 4, 3),
            "taps": np.array((0.6, 0.15, 0.05), np.float32),
            "image": image(),
            "gray": plane(),
        },
        segmentation.shift: {"source": plane(), "dx": 3, "dy": -2, "fill": 1.0, "out": plane()},
        segmentation.move_object: {
            "dx": 3,
            "dy": -2,
            **{name: layer()[name] for name in ("obj", "odds", "shape", "obj_out", "odds_out", "shape_out")},
        },
        segmentation.move_ground: {
            "dx": 3,
            "dy": -2,
            "gain": 1.1,
            "background": image(),
            "counts": counts(),
            "image": image(),
            "odds": plane(),
            "background_out": image(),
            "counts_out": counts(),
        },
        segmentation.resample: {"image": image(), "inverse": INVERSE, "repeat": False, "fill": 1.0, "out": image()},
        segmentation.without_object: {
            "image": image(),
            "odds": plane(),
            "dx": 3,
            "dy": -2,
            "sure": 1.0,
            "fill": -999.0,
            "out": image(),
        },
        segmentation.measure_light: {
            "image": image(),
            "previous": noise(H, W, 3)[::-1].copy(),
            "box": (3, 2, 17, 12),
            "stride": 2,
            "limits": (20.0, 4.0, 250.0),
        },
        segmentation.carry: layer(),
        segmentation.evidence: {
            **scene(),
            "previous": image() + 3,
            "obj": image() - 1,
            "odds": plane(),
            "shape": plane(),
            "own": mask(),
        },
        segmentation.warp_and_score: {**layer(), **scene()},
        segmentation.collect: {
            "reference": image(),
            "weight": noise(H, W, high=1.0),
            "grid": GRID,
            "stride": 3,
            "rows_out": np.zeros_like(listed),
        },
        segmentation.residual: {**registered, "theta": THETA, "ceiling": 40.0},
        segmentation.gauss_newton: {
            **registered,
            "theta": theta,
            "prior": np.full(8, 0.1),
            "scale": 9.0,
            "ceiling": 40.0,
            "stiffness": 1.0,
            "steps": 3,
            "costs": np.zeros(2),
        },
        segmentation.start_flow: {"near": mask(), "grid": GRID, "theta": THETA, "camera": (0.1, 0.2), "out": flow},
        segmentation.predict_motion: {
            "odds": plane(),
            "shown": mask(),
            "weighing": 2,
            "box": GRID,
            "obj": image(),
            "image": image() + 1,
            "inside": rectangle(),
            "motion": (0.3, 0.1, 0.01, 0.0, 0.0, 0.02),
            "camera": (1.1, 0.2),
            "known": False,
            "near_out": mask(),
            "weight_out": plane(),
            "rows_out": np.zeros_like(listed),
            "theta_out": theta.copy(),
            "flow_out": flow.copy(),
        },
        segmentation.measure_motion: {
            "flow": noise(H, W, 2, low=-1.0, high=1.0),
            "image": image(),
            "previous": noise(H, W),
            "inside": rectangle(),
            "near": mask(density=0.2),
            "camera": (0.1, 0.2),
            "noise": 2.5,
            "background": image(),
            "counts": counts(),
            "offset": (0.2, -0.1),
            "ground_steps": 3,
            "odds": plane(),
            "weight": noise(H, W, high=1.0),
            "grid": GRID,
            "rows": listed,
            "count": 200,
            "theta": THETA,
            "start": noise(H, W, 2),
            "hidden": False,
            "young": False,
            "steps": 3,
        },
        segmentation.search_shift: {
            "image": image(),
            "obj": image() + 1,
            "shape": noise(H, W, high=1.0),
            "different": mask(),
            "centre": (0, 1),
            "reach": 4,
            "step": 2,
            "inside": rectangle(),
            "noise": 2.5,
        },
        segmentation.label: {
            **layer_as_expected(),
            "image": image(),
            "background": image() + 1,
            "moved": image() + 2,
            "counts": counts(),
            "inside": rectangle(),
            "planes_out": noise(4, H, W, low=-2.0, high=2.0),
            "fresh": mask(density=0.8),
            "before": mask(),
            "hiding": mask(density=0.05),
            "emerging": False,
            "colours": histograms(),
            "colour_weight": 0.7,
            "noise": 2.5,
            "growth": 4,
            "young": False,
            "least": 0.6,
            "bins_out": bins.copy(),
            "raw_out": plane(),
            "odds_out": plane(),
            "mask_out": mask(),
            "foreign_out": mask(),
        },
        segmentation.learn: {
            **layer_as_expected(),
            "image": image(),
            "aligned": image() + 1,
            "mask": mask(),
            "foreign": mask(density=0.1),
            "labelled": plane(),
            "raw": plane(),
            "errors": noise(4, H, W, low=-2.0, high=9.0),
            "bins": bins,
            "background": image() + 3,
            "counts": counts(),
            "inside": rectangle(),
            "shape_rate": 0.1,
            "freeze": False,
            "hidden": False,
            "colours": histograms(),
            "colour_rate": 0.1,
            "odds_out": plane(),
            "obj_out": image(),
            "shape_out": plane(),
            "background_out": image(),
            "counts_out": counts(),
            "colours_out": histograms(),
        },
    }


# For each kernel its structs, and for each of their fields the array of `valid` that it gets.
Fields = dict[str, str]
Struct = tuple[type, Fields]


def struct(kind: type, *same: str, **other: str) -> Struct:
    """Fields that get the arrays of the same names, and those that get others."""
    return kind, {**{field: field for field in same}, **other}


WINDOW = struct(segmentation.Window, "image", "inside")
SCENE = struct(segmentation.Scene, "image", "inside", "moved", "background", "counts")
LAYER = struct(segmentation.Layer, "obj", "odds", "shape")
GROUND = struct(segmentation.Ground, "background", "counts")
POINTS = struct(segmentation.Points, "rows", "count")
EXPECTED = struct(segmentation.Expected, "previous", "obj", "odds", "shape", "own", "part")
MOVED = struct(
    segmentation.Expected,
    "part",
    previous="previous_out",
    obj="obj_out",
    odds="odds_out",
    shape="shape_out",
    own="own_out",
)
SEEN = struct(segmentation.Evidence, planes="planes_out", fresh="fresh_out")
STRUCTS: dict[str, dict[str, Struct]] = {
    "move_object": {
        "layer": LAYER,
        "out": struct(segmentation.Layer, obj="obj_out", odds="odds_out", shape="shape_out"),
    },
    "move_ground": {
        "ground": GROUND,
        "out": struct(segmentation.Ground, background="background_out", counts="counts_out"),
    },
    "carry": {"layer": LAYER, "expected": MOVED},
    "evidence": {"scene": SCENE, "expected": EXPECTED, "out": SEEN},
    "warp_and_score": {"scene": SCENE, "layer": LAYER, "expected": MOVED, "out": SEEN},
    "collect": {"points": struct(segmentation.Points, rows="rows_out")},
    "residual": {"window": WINDOW, "points": POINTS},
    "gauss_newton": {
        "window": WINDOW,
        "points": POINTS,
        "how": struct(segmentation.Registration, "prior", "scale", "ceiling", "stiffness", "steps"),
    },
    "predict_motion": {
        "window": WINDOW,
        "outline": struct(segmentation.Outline, "odds", "shown", "weighing", "box"),
        "last": struct(segmentation.LastMotion, "motion", "camera", "known"),
        "points": struct(segmentation.Points, rows="rows_out"),
        "out": struct(
            segmentation.Prediction, near="near_out", weight="weight_out", theta="theta_out", flow="flow_out"
        ),
    },
    "measure_motion": {
        "window": WINDOW,
        "ground": GROUND,
        "predicted": struct(segmentation.Prediction, "near", "weight", "theta", flow="start"),
        "points": POINTS,
        "how": struct(
            segmentation.Measuring,
            "grid", "camera", "offset", "noise", "hidden", "young", "ground_steps", "steps",
        ),
    },
    "search_shift": {"window": WINDOW},
    "label": {
        "scene": SCENE,
        "expected": EXPECTED,
        "seen": struct(segmentation.Evidence, "fresh", planes="planes_out"),
        "how": struct(
            segmentation.Labelling,
            "colours", "colour_weight", "noise", "least", "growth", "emerging", "young",
        ),
        "labels": struct(
            segmentation.Labels,
            bins="bins_out",
            raw="raw_out",
            odds="odds_out",
            mask="mask_out",
            foreign="foreign_out",
        ),
    },
    "learn": {
        "window": WINDOW,
        "expected": EXPECTED,
        "labels": struct(segmentation.Labels, "bins", "raw", "mask", "foreign", odds="labelled"),
        "ground": GROUND,
        "how": struct(segmentation.Learning, "colours", "shape_rate", "colour_rate", "freeze", "hidden"),
        "memory": struct(
            segmentation.Memory,
            odds="odds_out",
            obj="obj_out",
            shape="shape_out",
            background="background_out",
            counts="counts_out",
            colours="colours_out",
        ),
    },
}  # fmt: skip


VALID = {function.__name__: arguments for function, arguments in valid().items()}
NAMES = list(VALID)


def fresh(name: str) -> Arguments:
    """Valid arguments of a kernel, in arrays of their own."""
    return {key: value.copy() if isinstance(value, np.ndarray) else value for key, value in VALID[name].items()}


OPTIONAL = {"before", "hiding", "foreign", "foreign_out", "shown"}
RESULTS = {
    "spread": {"out"},
    "components": {"runs"},
    "bin_colours": {"bins"},
    "likelihood": {"ratio"},
    "blend": {"tally", "out"},
    "smooth": {"image", "gray"},
    "gauss_newton": {"theta", "costs"},
}
"""What is written, beside all that ends with "out"."""


def run(name: str, given: Arguments) -> Any:
    """Call a kernel."""
    structs = {
        key: kind(**{field: given[source] for field, source in fields.items()})
        for key, (kind, fields) in STRUCTS.get(name, {}).items()
    }
    inner = {source for _, fields in STRUCTS.get(name, {}).values() for source in fields.values()}
    outer = {key: value for key, value in given.items() if key not in inner}
    return getattr(segmentation, name)(**outer, **structs)


def call(name: str, **changes: Any) -> Any:
    """Call a kernel with valid arguments but for some."""
    return run(name, {**fresh(name), **changes})


def called(name: str, key: str) -> str:
    """What errors call an array."""
    for _, fields in STRUCTS.get(name, {}).values():
        for field, source in fields.items():
            if source == key:
                return field
    return key


def arrays(name: str) -> Iterator[tuple[str, np.ndarray, bool]]:
    """Array arguments of a kernel, and whether they are written."""
    for key, value in fresh(name).items():
        if isinstance(value, np.ndarray):
            yield key, value, key.endswith("out") or key in RESULTS.get(name, ())


@pytest.mark.parametrize("name", NAMES)
def test_other_elements_are_refused(name: str) -> None:
    """Arrays of another type, and what is no array, are a TypeError that names the argument."""
    call(name)
    for key, value, _ in arrays(name):
        with pytest.raises(
            TypeError, match=f"expected {called(name, key)} to be an array of {value.dtype}.* got complex|format"
        ):
            call(name, **{key: value.astype(np.complex64)})
        if key not in OPTIONAL:
            with pytest.raises(TypeError, match=f"expected {called(name, key)} to be an array.* got NoneType"):
                call(name, **{key: None})


@pytest.mark.parametrize("name", NAMES)
def test_other_layouts_are_refused(name: str) -> None:
    """Another number of dimensions and what is not contiguous are a ValueError that names the argument."""
    for key, value, _ in arrays(name):
        with pytest.raises(ValueError, match=f"expected {called(name, key)} to be .* got shape"):
            call(name, **{key: value[np.newaxis]})
        with pytest.raises(ValueError, match=f"expected {called(name, key)} to be .* not C-contiguous"):
            call(name, **{key: np.repeat(value, 2, axis=-1)[..., ::2]})


@pytest.mark.parametrize("name", NAMES)
def test_results_must_be_writable(name: str) -> None:
    """A read-only result is refused by name and left as it is; what is read may be read-only."""
    for key, value, written in arrays(name):
        given, before = value.copy(), value.copy()
        given.flags.writeable = False
        if written:
            with pytest.raises(ValueError, match=f"expected {called(name, key)} to be .* got a read-only one"):
                call(name, **{key: given})
        else:
            call(name, **{key: given})
        np.testing.assert_array_equal(given, before)


ANY_SIZE = {
    ("shift", "source"),
    ("shift", "out"),
    ("resample", "image"),
    ("resample", "out"),
    ("residual", "image"),
    ("gauss_newton", "image"),
}


@pytest.mark.parametrize("name", NAMES)
def test_sizes_must_agree(name: str) -> None:
    """An array with a row too many is a ValueError that names it, or what it does not agree with."""
    for key, value, _ in arrays(name):
        if (name, key) in ANY_SIZE:
            continue
        other = np.concatenate((value, value[:1]))
        with pytest.raises(ValueError, match=r"expected .* to have (shape|at least)"):
            call(name, **{key: other})


@pytest.mark.parametrize(
    ("name", "changes", "message"),
    [
        ("residual", {"inside": np.array((0, 0, W + 1, H))}, r"inside \(x0, y0, x1, y1\).*got 0, 0, 38, 21"),
        ("carry", {"part": np.array((-1, 0, W, H))}, r"part .*got -1, 0, 37, 21"),
        ("residual", {"count": 301}, "count between 0 and 300, got 301"),
        ("residual", {"count": -1}, "count between 0 and 300, got -1"),
        ("collect", {"stride": 0}, "stride between 1 and .*, got 0"),
        ("collect", {"grid": (1.0, 1.0, 0.0, 1.0)}, "scale > 0, got 0"),
        ("predict_motion", {"box": (1.0, 1.0, 1.0, np.nan)}, "area from 0 .*, got nan"),
        ("predict_motion", {"weighing": 3}, "weighing between 0 and 2, got 3"),
        ("predict_motion", {"shown": None}, "expected shown to be a mask, got None"),
        ("label", {"foreign_out": None}, "expected foreign to be a mask, got None"),
        ("widen", {"reach": -1}, "reach between 0 and .*, got -1"),
        ("search_shift", {"step": 0}, "step between 1 and .*, got 0"),
        ("invert", {"mask": np.zeros((2, W), np.uint8)}, "mask to have at least 3 x 3 pixels, got 2 x 37"),
    ],
)
def test_numbers_are_checked(name: str, changes: Arguments, message: str) -> None:
    """What would lead out of an array, or means nothing, is an error with its value."""
    with pytest.raises(ValueError, match=message):
        call(name, **changes)


@pytest.mark.parametrize("strange", [np.nan, np.inf, -np.inf, 1e30, -1e30])
@pytest.mark.parametrize("name", NAMES)
def test_no_number_leads_out_of_an_array(name: str, strange: float) -> None:
    """Whatever stands in an image or a motion, kernels stay in their arrays: guards beside results are left alone."""
    for key, value, _ in arrays(name):
        if value.dtype.kind != "f":
            continue
        arguments, guards = {}, []
        for other, array, written in arrays(name):
            if written:
                room = np.full(array.size + 32, 77, array.dtype)
                inner = room[16 : 16 + array.size].reshape(array.shape)
                inner[...] = array
                arguments[other] = inner
                guards.append(room)
        arguments[key] = np.full_like(value, strange)
        call(name, **arguments)
        for room in guards:
            assert (room[:16] == 77).all()
            assert (room[-16:] == 77).all()


@pytest.mark.usefixtures("level")
@pytest.mark.parametrize("name", NAMES)
def test_all_levels_give_the_same_bits(name: str) -> None:
    """What is returned and what is written."""
    results = set()
    for one in kernels.levels():
        kernels.use_level(one)
        arguments = fresh(name)
        answer = run(name, arguments)
        written = [arguments[key].tobytes() for key, _, out in arrays(name) if out]
        results.add((repr(answer), *written))
    assert len(results) == 1
