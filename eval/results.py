"""Result files: the only place that reads and writes them.

A folder of results, one per suite or data set::

    run.json                          the sequences of the last run, in order, and where they came from
    sequences/NAME.json               truth: a report needs nothing but this folder
    tracks/TRACKER/NAME.s0r0.json     one run: start box 0 (the exact one), repeat 0
    protocols/PROTOCOL/TRACKER/…      the same, of a protocol other than one pass
    speed/NAME.json                   the timing pass on one sequence, all trackers
    flow/METHOD/PAIR.json             one flow method on one pair of frames

Each run carries a key, the hash of tracker, parameters, code, sequence, start, repeat and protocol. A file whose key
is not the expected one is stale and is written anew.
"""

from __future__ import annotations

import hashlib
import json
import math
import os
import platform
import re
import subprocess
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .framesource import FrameSource
from .regions import read_region
from .sequences import Sequence

__all__ = ["COMPLETED", "FlowResult", "Folder", "ResultsError", "Run", "SpeedRun", "Trajectory", "provenance"]

_FORMAT = 1  # of the files; raise it when an older reader would misread them

_ONE_PASS = "one-pass"  # the protocol of results that name none

COMPLETED = "completed"
"""Status of a run that went through all frames."""


class ResultsError(Exception):
    """A result file that cannot be read or written; the message says which, why and what to do."""


@dataclass(frozen=True)
class Trajectory:
    """What a tracker answered.

    Parameters
    ----------
    ok : ndarray of bool, shape (T,)
    boxes : ndarray, shape (T, 4)
        x, y, w, h, px; frame 0 holds the start box, frames without an answer NaN.
    score : ndarray, shape (T,)
        ``getTrackingScore()``; NaN where there is none.
    regions : tuple of str
        Of each frame the mask or rotated box that was answered, see :class:`eval.sequences.Sequence`.
    """

    ok: NDArray[np.bool_]
    boxes: NDArray[np.float64]
    score: NDArray[np.float64]
    regions: tuple[str, ...] = ()


@dataclass(frozen=True)
class Run:
    """One tracker on one sequence from one start.

    Parameters
    ----------
    key : str
        Hash of all that the trajectory depends on.
    tracker, sequence : str
        Names.
    start, repeat : int
        Number of the start (in one pass 0 is the exact box) and of the repetition.
    status : str
        :data:`COMPLETED`, or why it did not go through.
    trajectory : Trajectory
    provenance : mapping
        Code version, parameters, machine, versions, time.
    protocol : str
        How the tracker was led.
    marks : mapping of str to list of int
        Frames at which the protocol did something: "started", "failed", "dropped".
    """

    key: str
    tracker: str
    sequence: str
    start: int
    repeat: int
    status: str
    trajectory: Trajectory
    provenance: Mapping[str, Any] = field(default_factory=dict)
    protocol: str = _ONE_PASS
    marks: Mapping[str, list[int]] = field(default_factory=dict)


@dataclass(frozen=True)
class SpeedRun:
    """Times of all trackers on one sequence, measured by turns.

    Parameters
    ----------
    key : str
    sequence : str
    milliseconds, wall : mapping of str to list of float
        Per tracker, the processor time of each timed update, and the time that passed.
    status : mapping of str to str
    provenance : mapping
    """

    key: str
    sequence: str
    milliseconds: Mapping[str, list[float]]
    wall: Mapping[str, list[float]]
    status: Mapping[str, str]
    provenance: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class FlowResult:
    """What one flow method did on one pair of frames.

    Parameters
    ----------
    key : str
        Hash of all that the result depends on.
    method, pair, group : str
    scores : mapping
        Metric name to value; empty if the method failed.
    seconds : float or None
        Median processor time of a call, warm, on one thread.
    relative : float or None
        The same in units of the yardstick's time, measured by turns in the same process.
    note : str
        Why there are no scores, else "".
    provenance : mapping
    """

    key: str
    method: str
    pair: str
    group: str
    scores: Mapping[str, float] = field(default_factory=dict)
    seconds: float | None = None
    relative: float | None = None
    note: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)


def provenance() -> dict[str, Any]:
    """Where and with what: commit, versions, machine, load, time (UTC)."""
    return {
        "commit": _commit(),
        "python": platform.python_version(),
        "opencv": str(cv2.__version__),
        "numpy": np.__version__,
        "machine": f"{_processor()}, {os.cpu_count()} cores, {platform.system()} {platform.machine()}",
        "load": round(os.getloadavg()[0], 2) if hasattr(os, "getloadavg") else None,
        "time": datetime.now(timezone.utc).isoformat(timespec="seconds"),
    }


def _commit() -> str:
    def git(*arguments: str) -> str:
        root = Path(__file__).parent
        return subprocess.run(
            ["git", *arguments], cwd=root, capture_output=True, text=True, check=True
        ).stdout.strip()

    try:
        dirty = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "--short=12", "HEAD") + ("+changes" if dirty else "")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def _processor() -> str:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        return platform.processor() or "unknown processor"
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return found.group(1).strip() if found else platform.processor() or "unknown processor"


def _slug(name: str) -> str:
    """Name as part of a path; two names never share one."""
    safe = re.sub(r"[^\w.+-]", "_", name)
    return safe if safe == name else f"{safe}-{hashlib.sha256(name.encode()).hexdigest()[:6]}"


class Folder:
    """The results of one suite or data set.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def write_manifest(self, source: str, sequences: list[Sequence], place: str = "") -> None:
        """Say which sequences the last run was about, and store their truth; `place` is where they come from."""
        for sequence in sequences:
            self._write(self.path / "sequences" / f"{_slug(sequence.name)}.json", _sequence_to_json(sequence))
        names = [sequence.name for sequence in sequences]
        self._write(
            self.path / "run.json", {"source": source, "place": place, "sequences": names, "provenance": provenance()}
        )

    def place(self) -> str:
        """Source, by its full path, of the results that are here; empty where there are none."""
        return str(self._read(self.path / "run.json").get("place", "")) if (self.path / "run.json").exists() else ""

    def read_manifest(self) -> dict[str, Any]:
        """Return source, sequence names and provenance of the last run."""
        path = self.path / "run.json"
        if not path.exists():
            raise ResultsError(f"no results in {self.path}: run `python -m eval run` first")
        data = self._read(path)
        names = data.get("sequences")
        if not isinstance(names, list) or not all(isinstance(name, str) for name in [*names, data.get("source")]):
            raise self._corrupt(path, "no source, or no list of sequences")
        return data

    def read_sequences(self) -> list[Sequence]:
        """Sequences of the last run, with their truth; the frames may be gone by now."""
        return [self._read_sequence(name) for name in self.read_manifest()["sequences"]]

    def _read_sequence(self, name: str) -> Sequence:
        path = self.path / "sequences" / f"{_slug(name)}.json"
        data = self._read(path)
        try:
            return _sequence_from_json(data)
        except (KeyError, TypeError, ValueError) as error:
            raise self._corrupt(path, error) from error

    def run_path(self, tracker: str, sequence: str, start: int, repeat: int, protocol: str = _ONE_PASS) -> Path:
        """File of one run."""
        home = self.path / "tracks" if protocol == _ONE_PASS else self.path / "protocols" / _slug(protocol)
        return home / _slug(tracker) / f"{_slug(sequence)}.s{start}r{repeat}.json"

    def write_run(self, run: Run) -> None:
        """Store one run; whole or not at all."""
        path = self.run_path(run.tracker, run.sequence, run.start, run.repeat, run.protocol)
        self._write(path, _run_to_json(run))

    def read_run(self, path: Path) -> Run:
        """Read one run.

        Raises
        ------
        ResultsError
            If the file is not a whole result.
        """
        data = self._read(path)
        try:
            return _run_from_json(data)
        except (KeyError, TypeError, ValueError) as error:
            raise self._corrupt(path, error) from error

    def read_runs(self) -> list[Run]:
        """Every stored run in one pass of the sequences of the last run, by tracker and sequence."""
        return self._read_runs("tracks/*/*.json")

    def read_protocol_runs(self) -> list[Run]:
        """Every stored run of other protocols than one pass, of the sequences of the last run."""
        return self._read_runs("protocols/*/*/*.json")

    def _read_runs(self, pattern: str) -> list[Run]:
        wanted = {_slug(name) for name in self.read_manifest()["sequences"]}
        paths = sorted(self.path.glob(pattern))
        return [self.read_run(path) for path in paths if path.name.rsplit(".", 2)[0] in wanted]

    def speed_path(self, sequence: str) -> Path:
        """File of the timing pass on one sequence."""
        return self.path / "speed" / f"{_slug(sequence)}.json"

    def write_speed(self, run: SpeedRun) -> None:
        """Store the timing pass on one sequence."""
        self._write(self.speed_path(run.sequence), vars(run))

    def read_speed(self, path: Path) -> SpeedRun:
        """Read the timing pass on one sequence."""
        data = self._read(path)
        try:
            return SpeedRun(**data)
        except TypeError as error:
            raise self._corrupt(path, error) from error

    def read_speeds(self) -> list[SpeedRun]:
        """Timing passes on the sequences of the last run; empty when speed was not measured."""
        paths = [self.speed_path(name) for name in self.read_manifest()["sequences"]]
        return [self.read_speed(path) for path in paths if path.exists()]

    def flow_path(self, method: str, pair: str) -> Path:
        """File of one flow method on one pair."""
        return self.path / "flow" / _slug(method) / f"{_slug(pair)}.json"

    def write_flow(self, result: FlowResult) -> None:
        """Store the result of one flow method on one pair."""
        self._write(self.flow_path(result.method, result.pair), vars(result))

    def read_flow(self, path: Path) -> FlowResult:
        """Read the result of one flow method on one pair."""
        data = self._read(path)
        try:
            return FlowResult(**data)
        except TypeError as error:
            raise self._corrupt(path, error) from error

    def merge(self, other: Folder) -> int:
        """Take over the results of another folder about the same sequences; return how many are new.

        Raises
        ------
        ResultsError
            If the sequences are others, or both have run the same thing with other code or on other data.
        """
        manifest = other.read_manifest()
        theirs = {sequence.name: sequence.digest for sequence in other.read_sequences()}
        if (self.path / "run.json").exists():
            ours = {sequence.name: sequence.digest for sequence in self.read_sequences()}
            if ours != theirs:
                odd = sorted(name for name in ours.keys() | theirs.keys() if ours.get(name) != theirs.get(name))
                raise ResultsError(f"{other.path} is not about the sequences of {self.path}: {', '.join(odd[:5])}")
        else:
            self._write(self.path / "run.json", manifest)
        files = (
            path
            for kind in ("sequences", "tracks", "protocols", "speed", "flow")
            for path in other.path.glob(f"{kind}/**/*.json")
        )
        return sum(self._take(path, self.path / path.relative_to(other.path)) for path in sorted(files))

    def _take(self, path: Path, place: Path) -> bool:
        """Copy a file unless it is there; whether that is a result that was not."""
        data = self._read(path)
        if not place.exists():
            self._write(place, data)
        elif self._read(place).get("key") != data.get("key"):
            raise ResultsError(f"{path} and {place} were run with other code or on other data: delete one of them")
        else:
            return False
        return "key" in data

    def _write(self, path: Path, data: Mapping[str, Any]) -> None:
        scratch = path.with_name(f".{path.name}.{os.getpid()}.part")
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            text = json.dumps({"format": _FORMAT, **data}, separators=(",", ":"))
            scratch.write_text(text, encoding="utf-8")
            scratch.replace(path)
        except OSError as error:
            scratch.unlink(missing_ok=True)
            raise ResultsError(
                f"cannot write {path}: {error.strerror or error}; what was written before is safe"
            ) from error

    def _read(self, path: Path) -> dict[str, Any]:
        try:
            data = json.loads(path.read_text(encoding="utf-8"))
        except OSError as error:
            raise ResultsError(f"cannot read {path}: {error.strerror or error}") from error
        except (ValueError, RecursionError) as error:
            raise self._corrupt(path, error) from error
        if not isinstance(data, dict):
            raise self._corrupt(path, "not an object")
        version = data.pop("format", 1)
        if not isinstance(version, int):
            raise self._corrupt(path, f"format {version!r}")
        if version > _FORMAT:
            raise ResultsError(
                f"{path} was written by a newer version of eval (format {version}, this one reads {_FORMAT}): "
                "use that one, or delete the file and run again"
            )
        return data

    @staticmethod
    def _corrupt(path: Path, reason: object) -> ResultsError:
        return ResultsError(f"{path} is damaged ({reason}): delete it and run again, the other results are kept")


def _numbers(values: NDArray[np.float64]) -> list[float | None]:
    # To the last bit: a perfect tracker scores 1, and not a little less.
    return [float(value) if math.isfinite(value) else None for value in values]


def _array(values: list[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)


def _run_to_json(run: Run) -> dict[str, Any]:
    trajectory = run.trajectory
    return {
        **{name: getattr(run, name) for name in ("key", "tracker", "sequence", "start", "repeat", "status")},
        "provenance": dict(run.provenance),
        "ok": trajectory.ok.astype(int).tolist(),
        "boxes": [_numbers(box) for box in trajectory.boxes],
        "score": _numbers(trajectory.score),
        **({"regions": list(trajectory.regions)} if trajectory.regions else {}),
        **({} if run.protocol == _ONE_PASS else {"protocol": run.protocol, "marks": dict(run.marks)}),
    }


def _run_from_json(data: dict[str, Any]) -> Run:
    ok = np.array(data["ok"], dtype=bool)
    boxes = np.array([_array(box) for box in data["boxes"]]).reshape(-1, 4)
    score = _array(data["score"])
    if not len(ok) == len(boxes) == len(score) > 0:
        raise ValueError(f"{len(ok)} flags, {len(boxes)} boxes and {len(score)} scores")
    trajectory = Trajectory(ok, boxes, score, _regions_of(data, len(ok)))
    names = ("key", "tracker", "sequence", "start", "repeat", "status", "provenance")
    led = {name: data[name] for name in ("protocol", "marks") if name in data}
    return Run(trajectory=trajectory, **{name: data[name] for name in names}, **led)


def _regions_of(data: Mapping[str, Any], count: int) -> tuple[str, ...]:
    """Regions of a file, each of which can be read; ValueError for what is none."""
    regions = tuple(data.get("regions", ()))
    if regions and len(regions) != count:
        raise ValueError(f"{count} frames and {len(regions)} regions")
    for text in filter(None, regions):
        read_region(text)
    return regions


def _sequence_to_json(sequence: Sequence) -> dict[str, Any]:
    return {
        "name": sequence.name,
        "frames": sequence.frames.to_json(),
        "boxes": [[None if math.isnan(value) else float(value) for value in box] for box in sequence.boxes],
        "visibility": _numbers(sequence.visibility),
        "attributes": list(sequence.attributes),
        "size": list(sequence.size),
        "digest": sequence.digest,
        "parameters": dict(sequence.parameters),
        "scene": sequence.scene,
        **({"regions": list(sequence.regions), "by_region": sequence.by_region} if sequence.regions else {}),
    }


def _sequence_from_json(data: dict[str, Any]) -> Sequence:
    return Sequence(
        name=data["name"],
        frames=FrameSource.from_json(data["frames"]),
        boxes=np.array([_array(box) for box in data["boxes"]]).reshape(-1, 4),
        visibility=_array(data["visibility"]),
        attributes=tuple(data["attributes"]),
        size=(data["size"][0], data["size"][1]),
        digest=data["digest"],
        parameters=dict(data.get("parameters", {})),
        scene=data.get("scene", ""),
        regions=_regions_of(data, len(data["boxes"])),
        by_region=bool(data.get("by_region", False)),
    )
