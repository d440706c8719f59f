"""FLOW_METHODS: every flow method the referee knows, by name, each with where it comes from.

A method's factory is called in a process of its own, once; what it returns is called for every pair as
``(first, second) -> flow``. Methods that need more than two frames (``uses_sequence``) are called as
``(frames, index) -> flow`` instead. Library methods run with the settings they are shipped with. The few constants
of the baselines of ``eval/baselines/flow_*.py`` were chosen on the same four Middlebury pairs as our presets.
"""

from __future__ import annotations

import hashlib
import importlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..trackers import ANY_FACTORY, look_up, source_files
from ..worker import resolve

if TYPE_CHECKING:
    from hs_tracker_cv.flow import Mode

__all__ = ["FLOW_METHODS", "YARDSTICK", "FlowMethod", "MissingLibraryError", "estimate_flow", "flow_method"]

Image = NDArray[np.uint8]
Flow = NDArray[np.float32]

YARDSTICK = "dis-medium"
"""The method whose time is measured beside every other's, so that times of different machines can be compared."""


_LIBRARIES = ("cv2", "skimage")
_NATIVE = "hs_tracker_cv._native"  # Horn–Schunck's loops are compiled


class MissingLibraryError(RuntimeError):
    """The installed wheels do not offer this method; a row with a note, not a failure."""


@dataclass(frozen=True)
class FlowMethod:
    """One entry of the comparison.

    Parameters
    ----------
    family : str
        What kind of method it is; colours the plots.
    source : str
        The publication and the implementation used.
    factory : callable
        ``() -> function``; raises :class:`MissingLibraryError` where its library is absent.
    depends : tuple of str
        Modules whose version (libraries) or source text (this checkout's) decides the result.
    uses_sequence : bool
        The function takes ``(frames, index)`` rather than ``(first, second)``.
    """

    family: str
    source: str
    factory: Callable[[], Callable[..., Flow]]
    depends: tuple[str, ...]
    uses_sequence: bool = False

    def fingerprint(self) -> str:
        """Hash of everything but the frames that decides the result: results are kept under it."""
        digest = hashlib.sha256(f"{self.source}/{self.uses_sequence}".encode())
        for module in (__name__, *self.depends):
            digest.update(_module_state(module))
        return digest.hexdigest()[:16]


def _module_state(module: str) -> bytes:
    """Version of a library; of anything else its sources and compiled extensions, which may change between runs."""
    if module in _LIBRARIES:
        try:
            return f"{module} {importlib.import_module(module).__version__}".encode()
        except ImportError:
            return f"{module} absent".encode()
    return b"".join(file.name.encode() + b"\0" + file.read_bytes() + b"\0" for file in source_files(module))


def gray(image: Image) -> Image:
    """Gray version of a gray or BGR frame."""
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), dtype=np.uint8)


def _zero() -> Callable[[Image, Image], Flow]:
    return lambda first, second: np.zeros((*first.shape[:2], 2), np.float32)


def _ours(mode: Mode) -> Callable[[], Callable[[Image, Image], Flow]]:
    def factory() -> Callable[[Image, Image], Flow]:
        try:
            from hs_tracker_cv.flow import HornSchunck
        except ImportError as error:
            raise MissingLibraryError(str(error)) from error
        solver = HornSchunck(mode)
        return lambda first, second: solver.calc(gray(first), gray(second), None)

    return factory


def _paper() -> Callable[[Image, Image], Flow]:
    """Classic Horn–Schunck, λ = 10, on frames smoothed by a Gaussian, as the paper does it."""
    classic = _ours("classic")()

    def calc(first: Image, second: Image) -> Flow:
        return classic(*(cv2.GaussianBlur(gray(frame), (0, 0), 1.0) for frame in (first, second)))  # type: ignore[arg-type]

    return calc


def _cv2(name: str, *arguments: Any, module: str = "", color: bool = False) -> Callable[[], Callable[..., Flow]]:
    """Factory of a cv2.DenseOpticalFlow by the name of its `create` function."""

    def factory() -> Callable[[Image, Image], Flow]:
        place = getattr(cv2, module, None) if module else cv2
        create = getattr(place, name, None)
        if create is None:
            where = f"cv2.{module}.{name}" if module else f"cv2.{name}"
            raise MissingLibraryError(f"{where} is not in this OpenCV {cv2.__version__} wheel")
        solver = create(*arguments)
        prepare = _bgr if color else gray
        return lambda first, second: solver.calc(prepare(first), prepare(second), None)

    return factory


def _bgr(image: Image) -> Image:
    return image if image.ndim == 3 else np.asarray(cv2.cvtColor(image, cv2.COLOR_GRAY2BGR), dtype=np.uint8)


def _skimage(name: str) -> Callable[[], Callable[..., Flow]]:
    def factory() -> Callable[[Image, Image], Flow]:
        try:
            from skimage import registration
        except ImportError as error:
            raise MissingLibraryError("scikit-image is not installed") from error
        function = getattr(registration, name)

        def calc(first: Image, second: Image) -> Flow:
            # scikit-image orders the components (row, column) and expects floats in 0–1.
            images = (np.asarray(gray(frame), np.float32) / 255.0 for frame in (first, second))
            v, u = function(*images, dtype=np.float32)
            return np.stack([u, v], axis=2)

        return calc

    return factory


def _baseline(module: str, name: str) -> Callable[[], Callable[..., Flow]]:
    """Factory of a function in ``eval.baselines``."""

    def factory() -> Callable[..., Flow]:
        try:
            function: Callable[..., Flow] = getattr(importlib.import_module(module), name)
        except ImportError as error:
            raise MissingLibraryError(str(error)) from error
        return function

    return factory


_COMMON = "eval.baselines.flow_common"
_MATCHING = "eval.baselines.flow_matching"
_GRADIENT = "eval.baselines.flow_gradient"
_ROBUST = "eval.baselines.flow_robust"
_DISCRETE = "eval.baselines.flow_discrete"

FLOW_METHODS: dict[str, FlowMethod] = {
    "zero": FlowMethod("null", "nothing moves: what any method must beat", _zero, ()),
    "hs-classic": FlowMethod(
        "ours",
        "hs_tracker_cv HornSchunck('classic'): Horn and Schunck 1981",
        _ours("classic"),
        ("hs_tracker_cv.flow", _NATIVE),
    ),
    "hs-solve": FlowMethod(
        "ours",
        "hs_tracker_cv HornSchunck('solve'): the same equations, solved",
        _ours("solve"),
        ("hs_tracker_cv.flow", _NATIVE),
    ),
    "hs-fast": FlowMethod(
        "ours", "hs_tracker_cv HornSchunck('fast')", _ours("fast"), ("hs_tracker_cv.flow", _NATIVE)
    ),
    "hs-default": FlowMethod(
        "ours", "hs_tracker_cv HornSchunck('default')", _ours("default"), ("hs_tracker_cv.flow", _NATIVE)
    ),
    "hs-accurate": FlowMethod(
        "ours", "hs_tracker_cv HornSchunck('accurate')", _ours("accurate"), ("hs_tracker_cv.flow", _NATIVE)
    ),
    "paper": FlowMethod(
        "ours",
        "the paper: smoothed frames, classic Horn–Schunck with λ = 10, by HornSchunck('classic')",
        _paper,
        ("hs_tracker_cv.flow", _NATIVE, "cv2"),
    ),
    "dis-ultrafast": FlowMethod(
        "OpenCV", "cv2 DIS, ultrafast preset: Kroeger et al., ECCV 2016", _cv2("DISOpticalFlow_create", 0), ("cv2",)
    ),
    "dis-fast": FlowMethod("OpenCV", "cv2 DIS, fast preset", _cv2("DISOpticalFlow_create", 1), ("cv2",)),
    YARDSTICK: FlowMethod("OpenCV", "cv2 DIS, medium preset", _cv2("DISOpticalFlow_create", 2), ("cv2",)),
    "farneback": FlowMethod("OpenCV", "cv2 Farnebäck, SCIA 2003", _cv2("FarnebackOpticalFlow_create"), ("cv2",)),
    "dual-tvl1": FlowMethod(
        "OpenCV",
        "cv2.optflow Dual TV-L1: Zach, Pock and Bischof, DAGM 2007",
        _cv2("createOptFlow_DualTVL1", module="optflow"),
        ("cv2",),
    ),
    "dense-rlof": FlowMethod(
        "OpenCV",
        "cv2.optflow dense RLOF: Senst et al., TCSVT 2012; GCPR 2016",
        _cv2("createOptFlow_DenseRLOF", module="optflow", color=True),
        ("cv2",),
    ),
    "deepflow": FlowMethod(
        "OpenCV",
        "cv2.optflow DeepFlow without its matches: Weinzaepfel et al., ICCV 2013",
        _cv2("createOptFlow_DeepFlow", module="optflow"),
        ("cv2",),
    ),
    "ilk": FlowMethod(
        "scikit-image",
        "skimage iterative Lucas–Kanade: Le Besnerais and Champagnat, ICIP 2005",
        _skimage("optical_flow_ilk"),
        ("skimage",),
    ),
    "tvl1": FlowMethod(
        "scikit-image",
        "skimage TV-L1: Zach, Pock and Bischof, DAGM 2007",
        _skimage("optical_flow_tvl1"),
        ("skimage",),
    ),
    "phase-correlation": FlowMethod(
        "surveyed",
        "phase correlation of blocks, Kuglin and Hines 1975; cv2.phaseCorrelate",
        _baseline(_MATCHING, "phase_correlation"),
        ("cv2", _COMMON, _MATCHING),
    ),
    "match-ssd": FlowMethod(
        "surveyed",
        "block matching by squared differences, Anandan 1989; eval.baselines.flow_matching",
        _baseline(_MATCHING, "match_ssd"),
        ("cv2", _COMMON, _MATCHING),
    ),
    "match-ncc": FlowMethod(
        "surveyed",
        "block matching by normalised cross-correlation, Lewis 1995; eval.baselines.flow_matching",
        _baseline(_MATCHING, "match_ncc"),
        ("cv2", _COMMON, _MATCHING),
    ),
    "lucas-kanade": FlowMethod(
        "surveyed",
        "Lucas–Kanade 1981 on every fourth pixel; cv2.calcOpticalFlowPyrLK",
        _baseline(_GRADIENT, "lucas_kanade"),
        ("cv2", _COMMON, _GRADIENT),
    ),
    "buxton-buxton": FlowMethod(
        "surveyed",
        "Buxton–Buxton 1984, moving edges; needs a sequence, on a bare pair its temporal filter is missing; "
        "eval.baselines.flow_gradient",
        _baseline(_GRADIENT, "buxton_buxton"),
        ("cv2", _COMMON, _GRADIENT),
        uses_sequence=True,
    ),
    "black-anandan": FlowMethod(
        "surveyed",
        "Black–Anandan 1996, dense robust flow; eval.baselines.flow_robust",
        _baseline(_ROBUST, "black_anandan"),
        ("cv2", _COMMON, _ROBUST),
    ),
    "black-jepson": FlowMethod(
        "surveyed",
        "Black–Jepson 1996, parametric regions with local deformations; eval.baselines.flow_robust",
        _baseline(_ROBUST, "black_jepson"),
        ("cv2", "skimage", _COMMON, _ROBUST),
    ),
    "belief-propagation": FlowMethod(
        "surveyed",
        "discrete labels by belief propagation, Felzenszwalb and Huttenlocher 2006; eval.baselines.flow_discrete",
        _baseline(_DISCRETE, "belief_propagation"),
        ("cv2", _COMMON, _DISCRETE),
    ),
}
"""Method by name. Families without a kept library are small implementations in ``eval/baselines/flow_*.py``."""


def flow_method(name: str) -> FlowMethod:
    """Method by its name in :data:`FLOW_METHODS`, or by ``pkg.module:factory``.

    Parameters
    ----------
    name : str
        The factory returns a function as :data:`FLOW_METHODS` have, or an object with the `calc` of
        ``cv2.DenseOpticalFlow``: ``cv2:DISOpticalFlow_create``.

    Returns
    -------
    FlowMethod

    Raises
    ------
    ValueError
        If the name is unknown, and names the known ones; or if there is no such factory.
    """
    module, _, attribute = name.partition(":")
    if not attribute:
        return look_up(FLOW_METHODS, name, "flow method", ANY_FACTORY)

    make = resolve(name)

    def factory() -> Callable[..., Flow]:
        made = make()
        return _dense(made) if hasattr(made, "calc") else made

    return FlowMethod("own", name, factory, ("cv2", module.partition(".")[0]))


def _dense(solver: Any) -> Callable[[Image, Image], Flow]:
    """Any ``cv2.DenseOpticalFlow``: it is given gray frames, or colour if it refuses those, as RLOF does."""
    prepare: Callable[[Image], Image] | None = None

    def calc(first: Image, second: Image) -> Flow:
        nonlocal prepare
        if prepare is None:
            prepare = gray
            try:
                return np.asarray(solver.calc(gray(first), gray(second), None), np.float32)
            except cv2.error:
                prepare = _bgr
        return np.asarray(solver.calc(prepare(first), prepare(second), None), np.float32)

    return calc


def estimate_flow(
    method: FlowMethod, function: Callable[..., Any], frames: Sequence[Image], index: int
) -> NDArray[np.float32]:
    """Flow from ``frames[index]`` to the next frame, checked.

    Parameters
    ----------
    method : FlowMethod
    function : callable
        What ``method.factory()`` returned.
    frames : sequence of ndarray, each (H, W) or (H, W, 3) uint8
    index : int

    Returns
    -------
    ndarray, shape (H, W, 2), float32

    Raises
    ------
    ValueError
        If the method returns something that is not a flow of the frame's size.
    """
    raw = function(frames, index) if method.uses_sequence else function(frames[index], frames[index + 1])
    flow = np.asarray(raw)
    expected = (*frames[index].shape[:2], 2)
    if flow.shape != expected:
        raise ValueError(f"expected a flow of shape {expected}, got {flow.shape}")
    return np.ascontiguousarray(flow, dtype=np.float32)
