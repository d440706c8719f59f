"""The trackers that can be judged: a literal table, and any ``pkg.module:factory`` besides.

A factory takes the tracker's parameters as keywords and returns an object with cv2's ``init(image, boundingBox)``
and ``update(image) -> (ok, box)``. Nothing else is asked of it; its box may also be four corners or OpenCV's rotated
rectangle, and if it has ``getTrackingScore()`` or ``getMask()`` (pixels (H, W), or None), these are asked for.
"""

from __future__ import annotations

import hashlib
import importlib.util
import json
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeVar

import cv2

_LIBRARIES = ("numpy", "scikit-image", "scipy")
_RUNNERS = ("eval.track", "eval.worker")  # the process of a tracker is theirs
_CODE = {".py", ".so", ".pyd", ".dylib"}

__all__ = [
    "ANY_FACTORY", "DEFAULT_TRACKERS", "TRACKERS", "TrackerSpec", "code_version", "find_tracker", "look_up",
    "source_files",
]  # fmt: skip

ANY_FACTORY = "or any pkg.module:factory"


@dataclass(frozen=True)
class TrackerSpec:
    """How to make a tracker, and what its results depend on.

    Parameters
    ----------
    name : str
        As it stands in tables and file names.
    factory : str
        ``pkg.module:callable``; resolved in the process of the tracker only.
    params : mapping, optional
        Keyword arguments of the factory; JSON values. Part of the key of every result.
    sources : tuple of str, optional
        Modules or packages whose source is part of the key; versions of libraries always are.
    repeats : int, optional
        Runs to average, for trackers that differ from run to run.
    sees_truth : bool, optional
        Test double: the runner hands the true boxes to the factory as `boxes`.
    models : mapping of str to str, optional
        Parameters that are model files, and what the names of the files look like.
    by_default : bool, optional
        Run when no tracker is named.
    note : str, optional
        What a reader of its figures should know; reports say it.
    """

    name: str
    factory: str
    params: Mapping[str, Any] = field(default_factory=dict)
    sources: tuple[str, ...] = ()
    repeats: int = 1
    sees_truth: bool = False
    models: Mapping[str, str] = field(default_factory=dict)
    by_default: bool = True
    note: str = ""

    def __post_init__(self) -> None:
        json.dumps(dict(self.params))
        if self.repeats < 1:
            raise ValueError(f"expected at least one repeat, got {self.repeats}")


def trackerhs(**params: Any) -> Any:
    """Ours; `params` are fields of ``TrackerHS_Params``."""
    import hs_tracker_cv

    return hs_tracker_cv.TrackerHS_create(hs_tracker_cv.TrackerHS_Params(**params))


def _baseline(name: str, factory: str, *helpers: str, **options: Any) -> TrackerSpec:
    """Spec of a tracker in ``eval.baselines``, with the modules there that it needs."""
    module = factory.partition(":")[0]
    sources = tuple(f"eval.baselines.{source}" for source in (module, *helpers))
    return TrackerSpec(name, f"eval.baselines.{factory}", sources=sources, **options)


def _with_models(name: str, factory: str, note: str = "", /, **models: str) -> TrackerSpec:
    """Spec of a tracker of OpenCV that needs files."""
    return _baseline(name, f"opencv:{factory}", models=models, by_default=False, note=note)


def _with_flow(name: str, part: str) -> TrackerSpec:
    """Spec of TrackerHS with another method where Horn–Schunck stands, by the surgery of :mod:`eval.ablation`."""
    sources = ("hs_tracker_cv", "eval.ablation", "eval.flow.methods", "eval.baselines.flow_gradient")
    return TrackerSpec(name, "eval.ablation:ablated", {"without": part}, sources, by_default=False)


TRACKERS: dict[str, TrackerSpec] = {
    spec.name: spec
    for spec in (
        TrackerSpec("TrackerHS", f"{__name__}:trackerhs", sources=("hs_tracker_cv",)),
        _baseline("CSRT", "opencv:csrt"),
        _baseline("KCF", "opencv:KCF", note="as shipped: it does not detect in its first update"),
        _baseline(
            "KCF-primed", "opencv:PrimedKCF", note="updated on the frame of its start, and told never to give up"
        ),
        _baseline("MIL", "opencv:mil", repeats=3, note="differs from run to run: the mean of three, unless said"),
        _baseline("MOSSE", "opencv:mosse"),
        _baseline("MedianFlow", "opencv:median_flow"),
        _baseline("TemplateMatching", "template_matching:TemplateMatching"),
        _baseline("FrameDifferencing", "frame_differencing:FrameDifferencing", "regions"),
        _baseline("BackgroundModel", "background_model:BackgroundModel", "regions"),
        _baseline("Static", "known:Static", note="its box never moves"),
        TrackerSpec(
            "Oracle",
            "eval.baselines.known:Oracle",
            sources=("eval.baselines.known", "eval.regions"),
            sees_truth=True,
            by_default=False,
            note="is told the truth: it shows where the scale ends, and competes with nobody",
        ),
        TrackerSpec(
            "TrackerHS+mask",
            "eval.baselines.masked:Masked",
            sources=("hs_tracker_cv", "eval.baselines.masked"),
            by_default=False,
            note="the same tracker, which answers with the pixels of its segmentation beside the box",
        ),
        _with_models("TrackerNano", "nano", backbone="*backbone*.onnx", neckhead="*head*.onnx"),
        _with_models(
            "TrackerVit",
            "vit",
            "as shipped: OpenCV 4.13 and 5.0 divide two channels by another deviation than in its training",
            net="*vit*track*.onnx",
        ),
        _with_models(
            "TrackerVit-normalised",
            "vit_normalised",
            "with stdvalue = (0.07433, −0.07598, −0.07565, 0), by which it sees the colours that it was trained on",
            net="*vit*track*.onnx",
        ),
        _with_models(
            "DaSiamRPN",
            "dasiamrpn",
            "as shipped; in OpenCV 5 by its classic engine of networks, as with the new one it raises",
            model="*dasiamrpn_model*.onnx",
            kernel_cls1="*dasiamrpn_kernel_cls1*.onnx",
            kernel_r1="*dasiamrpn_kernel_r1*.onnx",
        ),
        _with_flow("TrackerHS+DIS", "flow-dis"),
        _with_flow("TrackerHS+Farneback", "flow-farneback"),
        _with_flow("TrackerHS+TV-L1", "flow-tvl1"),
        _with_flow("TrackerHS+LucasKanade", "flow-lucas-kanade"),
    )
}

DEFAULT_TRACKERS: tuple[str, ...] = tuple(name for name, spec in TRACKERS.items() if spec.by_default)
"""What is run when no tracker is named."""


Thing = TypeVar("Thing")


def look_up(table: Mapping[str, Thing], name: str, what: str, *others: str) -> Thing:
    """Entry of a table by its name.

    Raises
    ------
    ValueError
        If there is none; the message lists the names that there are, and what `others` may be asked for.
    """
    if name not in table:
        raise ValueError(f"unknown {what} {name!r}; known: {', '.join((*table, *others))}")
    return table[name]


def find_tracker(name: str, models: Path | None = None) -> TrackerSpec:
    """Look a tracker up by name, or take ``pkg.module:factory``.

    Parameters
    ----------
    name : str
    models : Path, optional
        Folder of the model files that some trackers need.

    Raises
    ------
    ValueError
        If the name is neither, and the message lists the known ones; or if a model file is missing.
    """
    module, _, attribute = name.partition(":")
    if not (module and attribute):
        spec = look_up(TRACKERS, name, "tracker", ANY_FACTORY)
        return replace(spec, params={**spec.params, **_model_files(spec, models)}) if spec.models else spec
    if _find_spec(module) is None:
        raise ValueError(f"cannot find the module {module!r} of the tracker {name!r}")
    return TrackerSpec(name, name, sources=(module.partition(".")[0],))


def _model_files(spec: TrackerSpec, folder: Path | None) -> dict[str, str]:
    if folder is None:
        raise ValueError(f"{spec.name} needs model files: --models DIR with {', '.join(spec.models.values())}")
    return {parameter: str(_model_file(spec.name, folder, pattern)) for parameter, pattern in spec.models.items()}


def _model_file(tracker: str, folder: Path, pattern: str) -> Path:
    found = sorted(path for path in folder.glob("*") if fnmatch(path.name.lower(), pattern))
    if len(found) != 1:
        names = ", ".join(path.name for path in found) or "none"
        raise ValueError(f"{tracker}: expected one file like {pattern} in {folder}, found {names}")
    return found[0].resolve()


def _without_places(params: Mapping[str, Any]) -> dict[str, Any]:
    """Parameters in which files are what is in them, wherever they lie."""
    return {
        name: hashlib.sha256(Path(value).read_bytes()).hexdigest()
        if isinstance(value, str) and os.path.isabs(value) and os.path.isfile(value)
        else value
        for name, value in params.items()
    }


def code_version(spec: TrackerSpec) -> str:
    """Hash of what a tracker's answers depend on besides the frames.

    That is factory, parameters (of files their bytes), its sources and compiled extensions, what runs it in its
    process, and the versions of the libraries that the trackers here are made of.
    """
    digest = hashlib.sha256()
    versions = (str(cv2.__version__), *map(_version, _LIBRARIES))
    for part in (spec.factory, json.dumps(_without_places(spec.params), sort_keys=True), *versions):
        digest.update(part.encode() + b"\0")
    for source in (*spec.sources, *_RUNNERS):
        for path in source_files(source):
            digest.update(path.name.encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()[:16]


def _version(distribution: str) -> str:
    try:
        return f"{distribution} {version(distribution)}"
    except PackageNotFoundError:
        return f"no {distribution}"


def source_files(module: str) -> list[Path]:
    """Files of a module or package whose change may change what it does: Python and compiled extensions.

    Raises
    ------
    ValueError
        If there is no such module.
    """
    found = _find_spec(module)
    if found is None:
        raise ValueError(f"cannot find the module {module!r}")
    if found.submodule_search_locations:
        roots = [Path(root) for root in found.submodule_search_locations]
        return sorted(path for root in roots for path in root.rglob("*") if path.suffix in _CODE)
    return [Path(found.origin)] if found.origin and Path(found.origin).suffix in _CODE else []


def _find_spec(module: str) -> Any:
    try:
        return importlib.util.find_spec(module)
    except (ImportError, ValueError):
        return None
