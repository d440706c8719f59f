"""The boundary of the patch tracker's kernels, and that all levels give the same bits."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hs_tracker_cv._native import kernels

pytestmark = pytest.mark.once

H, W = 20, 23
PLACE: dict[str, Any] = {"at": (11.3, 9.2, 1.3, 1.1, 0.0)}


def noise(*shape: int) -> NDArray[np.float32]:
    """Random gray levels."""
    return np.random.default_rng(7).uniform(0, 255, shape).astype(np.float32)


def smooth(*shape: int) -> NDArray[np.float32]:
    """Random numbers 0–1 that fit weights, shares and small motions."""
    return np.random.default_rng(8).uniform(0, 1, shape).astype(np.float32)


def arguments(name: str) -> dict[str, Any]:
    """Good arguments of a kernel."""
    if name == "sample":
        return {"picture": noise(30, 31, 3), **PLACE, "samples": np.empty((3, H, W), np.float32)}
    if name == "patch":
        out = {"patch": np.empty((H, W), np.float32), "scores": np.empty(2)}
        weights, templates = smooth(H, W) / (H * W), noise(2, H, W) - 128
        return {"gray": noise(30, 31), **PLACE, "weights": weights, "templates": templates, **out}
    if name == "likelihood":
        shares = {"histograms": smooth(2, 4096), "likelihood": np.empty((H, W), np.float32)}
        return {"picture": noise(30, 31, 3), **PLACE, **shares}
    if name == "learn_colours":
        shares = {"old": smooth(2, 64), "learned": np.empty((2, 64), np.float32)}
        inside = (smooth(H, W) > 0.5).astype(np.uint8)
        return {"picture": noise(30, 31, 1), **PLACE, "inside": inside, "rate": 0.1, **shares}
    if name == "fit_motion":
        patches = {"first": noise(H, W), "second": noise(H, W), "flow": 3 * smooth(H, W, 2) - 1}
        priors = {"prior": smooth(H, W), "likelihood": smooth(9, 11), "ratio": 0.4, "outside": smooth(H, W)}
        return {**patches, **priors, "rotation": True, "separation": 0.01, "planes": np.empty((3, H, W), np.float32)}
    before = {
        "persistence": smooth(10, 11),
        "body": smooth(10, 11),
        "previous": noise(20, 22),
        "means": noise(4, 20, 22),
    }
    now = {"weights": smooth(20, 22), "planes": smooth(3, 20, 22), "flow": smooth(20, 22, 2), "patch": noise(20, 22)}
    move = {"way": (0.2, -0.3, 1.01, 0.02), "same": 16.0, "changed": 40.0, "rate": 0.2}
    rates = {"mean_rate": 0.03, "mask_rate": 0.1, "floor": 0.15}
    out = {"out": np.empty((10, 11), np.float32), "learned": np.empty((4, 20, 22), np.float32)}
    return {**before, **now, **move, **rates, **out}


STRUCTS: dict[str, dict[str, tuple[type, tuple[str, ...]]]] = {
    "fit_motion": {"priors": (kernels.FitPriors, ("prior", "outside", "likelihood", "ratio"))},
    "update_persistence": {
        "before": (kernels.KnownBefore, ("persistence", "body", "previous", "means", "weights")),
        "passage": (kernels.Passage, ("planes", "flow", "patch", "way")),
        "how": (kernels.PersistenceRates, ("same", "changed", "rate", "mean_rate", "mask_rate", "floor")),
    },
}
"""Arguments of a kernel that are structs, and which of `arguments` each holds."""


def run(name: str, given: dict[str, Any]) -> Any:
    """Call a kernel."""
    given = dict(given)
    for key, (struct, fields) in STRUCTS.get(name, {}).items():
        given[key] = struct(**{field: given.pop(field) for field in fields})
    kernel: Callable[..., Any] = getattr(kernels, name)
    return kernel(**given)


WRITTEN = {
    "sample": ("samples",),
    "patch": ("patch", "scores"),
    "likelihood": ("likelihood",),
    "learn_colours": ("learned",),
    "fit_motion": ("planes",),
    "update_persistence": ("out", "learned"),
}
ARRAYS = [(name, key) for name in WRITTEN for key, value in arguments(name).items() if isinstance(value, np.ndarray)]


def call(name: str, **changes: Any) -> Any:
    """Call a kernel with good arguments but for the changes."""
    return run(name, {**arguments(name), **changes})


@pytest.mark.parametrize(("name", "key"), ARRAYS)
def test_what_is_refused_is_named(name: str, key: str) -> None:
    """Another type, layout, number of dimensions or shape of any array; nothing is converted."""
    good = arguments(name)[key]
    with pytest.raises(TypeError, match=f"{key} to be an array.*got int16"):
        call(name, **{key: np.zeros(good.shape, np.int16)})
    with pytest.raises(TypeError, match=f"{key} to be an array.*got str"):
        call(name, **{key: "array"})
    with pytest.raises(ValueError, match=f"{key} to be an array.*got shape"):
        call(name, **{key: good[None]})
    with pytest.raises(ValueError, match=f"{key} to be an array.*not C-contiguous"):
        call(name, **{key: np.repeat(good, 2, -1)[..., ::2]})
    with pytest.raises(ValueError, match=r"expected \w+ to have"):
        call(name, **{key: np.empty((0,) * good.ndim, good.dtype)})


@pytest.mark.parametrize(("name", "key"), [(name, key) for name, keys in WRITTEN.items() for key in keys])
def test_read_only_results_are_refused(name: str, key: str) -> None:
    """And nothing is written."""
    result = np.zeros_like(arguments(name)[key])
    result.flags.writeable = False
    with pytest.raises(ValueError, match=f"{key} to be an array.*a read-only one"):
        call(name, **{key: result})
    assert not result.any()


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("sample", {"picture": noise(30, 31, 2)}, "1 or 3 channels, got 30 x 31 and 2"),
        ("sample", {"picture": noise(1, 31, 3)}, "picture to have at least 2 x 2 pixels"),
        ("patch", {"gray": noise(30, 1)}, "gray to have at least 2 x 2 elements, got 30 x 1"),
        ("patch", {"at": (11.3, 9.2, 0.0, 1.1, 0.0)}, "steps between 0 and 1e4"),
        ("patch", {"scores": np.empty(3)}, r"scores to have shape \(2,\), got \(3,\)"),
        ("likelihood", {"histograms": smooth(2, 64)}, r"histograms to have shape \(2, 4096\)"),
        ("likelihood", {"at": (np.nan, 9.2, 1.3, 1.1, 0.0)}, "finite place"),
        ("likelihood", {"likelihood": smooth(1, 5)}, "likelihood to have at least 2 x 2"),
        ("learn_colours", {"old": smooth(2, 4096)}, r"old to have shape \(2, 64\)"),
        ("fit_motion", {"outside": smooth(H, H)}, r"outside to have shape \(20, 23\), got \(20, 20\)"),
        ("fit_motion", {"likelihood": smooth(1, 9)}, "likelihood to have at least 2 x 2"),
        (
            "update_persistence",
            {"planes": smooth(5, 20, 22)},
            r"planes to have shape \(3, 20, 22\), got \(5, 20, 22\)",
        ),
        ("update_persistence", {"changed": 16.0}, "changed > same, got 16.0.* and 16.0"),
    ],
)
def test_sizes_and_numbers_are_checked(name: str, change: dict[str, Any], message: str) -> None:
    """What does not fit the other arguments is named with its value."""
    with pytest.raises(ValueError, match=message):
        call(name, **change)


@pytest.mark.usefixtures("level")
@pytest.mark.parametrize("name", WRITTEN)
@pytest.mark.parametrize(
    "at", [PLACE["at"], (11.3, 9.2, 1.3, 1.1, 0.4), (-5.0, 9.2, 3.7, 1.1, 0.0)], ids=["straight", "turned", "off"]
)
def test_all_levels_give_the_same_bits(name: str, at: tuple[float, ...]) -> None:
    """Also turned, and beyond the border of the picture."""
    results = set()
    for each in kernels.levels():
        kernels.use_level(each)
        given = arguments(name)
        if "at" in given:
            given["at"] = at
        answer = run(name, given)
        results.add(repr(answer).encode() + b"".join(given[key].tobytes() for key in WRITTEN[name]))
    assert len(results) == 1


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e30])
@pytest.mark.parametrize(
    ("name", "key"), [("fit_motion", "flow"), ("update_persistence", "flow"), ("likelihood", "picture")]
)
def test_wild_numbers_reach_no_other_memory(name: str, key: str, value: float) -> None:
    """A flow or picture without sense gives an answer, whatever it is."""
    call(name, **{key: np.full_like(arguments(name)[key], value)})
