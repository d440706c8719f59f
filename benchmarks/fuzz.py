"""Long fuzzing: 10,000 fresh examples of each generated test of the robustness suite, with a verdict.

``python -m benchmarks.fuzz`` runs them in batches, each batch in a process of its own, so that a crash or a hang is
a line of the verdict and not its end; it exits with 1 if there was a crash, a call over a second of processor time, a
batch without end, a wrong exception or a damaged track. ``python -m benchmarks.fuzz calls --examples 500 --seed 7``
does less, and the same each time.

``python -m benchmarks.fuzz calls --guided -- -max_total_time=600`` lets atheris (pip install atheris) choose the
examples by the code that they reach, until something fails or libFuzzer's options end it.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

ROOT = Path(__file__).resolve().parents[1]

_ROBUSTNESS = "tests/test_robustness.py::"
TARGETS = {
    "calls": "tests/test_robustness_machine.py::TestTwins::runTest",
    "frames": f"{_ROBUSTNESS}test_any_object_mid_track_is_answered_or_refused",
    "rois": f"{_ROBUSTNESS}test_any_roi_starts_a_track_or_is_an_input_error",
    "numbers": f"{_ROBUSTNESS}test_rois_of_four_numbers_are_taken_exactly_when_enough_is_inside",
    "first": f"{_ROBUSTNESS}test_init_takes_frames_and_refuses_all_else",
    "tracks": "tests/test_robustness_tracks.py::test_every_frame_of_every_story_is_answered",
    "pickles": "tests/test_robustness_pickles.py::test_an_edited_track_is_refused_or_goes_on",
    "bytes": "tests/test_robustness_pickles.py::test_a_damaged_pickle_raises_or_goes_on",
    "copies": "tests/test_robustness_pickles.py::test_every_true_track_goes_through_a_pickle",
}
"""Calls in any order; any object mid-track; any ROI; any four numbers as ROI; any first frame; any track; pickles
that were edited, damaged, and left as they are."""

EXAMPLES = 10_000
BATCH = 1000
"""Examples per process: hypothesis remembers all that it has tried."""

PATIENCE = 5.0
"""Seconds per example after which a batch counts as hanging; an example of `calls` makes up to fifty calls."""

GRACE = 60.0
"""Seconds that a batch may take besides, to start."""


@dataclass(frozen=True)
class Fuzzed:
    """What came of one batch.

    Parameters
    ----------
    examples : int
        Those that passed.
    fault : str
        What went wrong, "" if nothing did.
    output : str
        What the process printed.
    """

    examples: int
    fault: str
    output: str


def batch(test: str, examples: int, seed: int, *, patience: float = PATIENCE) -> Fuzzed:
    """Run a generated test in a process of its own.

    Parameters
    ----------
    test : str
        As pytest names it, from the root of the checkout.
    examples, seed : int
    patience : float, optional
        Seconds per example.
    """
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "--hypothesis-show-statistics"]
    process = subprocess.Popen(
        [*command, f"--hypothesis-seed={seed}", test],
        cwd=ROOT,
        env={**os.environ, "HS_FUZZ": str(examples)},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        output, _ = process.communicate(timeout=GRACE + patience * examples)
        fault = _fault(process.returncode)
    except subprocess.TimeoutExpired:
        # Python's fault handler answers this signal with where it hangs.
        process.send_signal(signal.SIGABRT)
        output, fault = process.communicate()[0], "hangs"
    passed = sum(int(count) for count in re.findall(r"(\d+) passing", output))
    # Behind the failures stand statistics that no one reads.
    told = re.split(r"^=+ Hypothesis Statistics", output, maxsplit=1, flags=re.MULTILINE)[0]
    return Fuzzed(passed, fault or ("" if passed else "tried nothing"), told)


def _fault(code: int) -> str:
    if code < 0:
        return f"crashed ({signal.Signals(-code).name})"
    return {0: "", 1: "failed"}.get(code, f"could not be run (pytest ended with {code})")


def fuzz(name: str, examples: int, seed: int) -> bool:
    """Run a target in batches, say how it went, and return whether all passed."""
    start, passed, faults = time.monotonic(), 0, []
    for number, done in enumerate(range(0, examples, BATCH)):
        fuzzed = batch(TARGETS[name], min(BATCH, examples - done), seed + number)
        passed += fuzzed.examples
        if fuzzed.fault:
            faults.append(f"seed {seed + number} {fuzzed.fault}")
            print(fuzzed.output, file=sys.stderr)
    verdict = f"FAILED: {'; '.join(faults)}" if faults else "passed"
    print(f"{name}: {passed} examples in {time.monotonic() - start:.0f} s: {verdict}", flush=True)
    return not faults


def guided_target(name: str) -> Callable[[bytes], object]:
    """The generated test of a target, as a function of bytes."""
    from hypothesis.stateful import get_state_machine_test

    from tests import test_robustness as robustness
    from tests.test_robustness_machine import Twins

    if name == "calls":
        test: Any = get_state_machine_test(Twins, settings=robustness.examples(1))
    else:
        file, _, function = TARGETS[name].partition("::")
        test = getattr(importlib.import_module(file.removesuffix(".py").replace("/", ".")), function)
    return cast("Callable[[bytes], object]", test.hypothesis.fuzz_one_input)


def guided(name: str, options: Sequence[str]) -> None:
    """Fuzz one target guided by coverage; does not return."""
    if importlib.util.find_spec("atheris") is None:
        sys.exit("benchmarks.fuzz --guided needs atheris (pip install atheris)")
    import atheris

    with atheris.instrument_imports(include=["hs_tracker_cv"]):
        import hs_tracker_cv.tracker  # noqa: F401
    warnings.simplefilter("error")
    atheris.Setup([sys.argv[0], f"-artifact_prefix={tempfile.gettempdir()}/", *options], guided_target(name))
    atheris.Fuzz()


def main(arguments: Sequence[str] | None = None) -> int:
    """Fuzz, and return 0 if nothing was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("targets", nargs="*", metavar="target", help=f"of {', '.join(TARGETS)}; all if not given")
    parser.add_argument("--examples", type=int, default=EXAMPLES, help="of each target")
    parser.add_argument("--seed", type=int, default=int(time.time()), help="of the first batch")
    parser.add_argument("--guided", action="store_true", help="by atheris; options of libFuzzer after --")
    words = list(sys.argv[1:] if arguments is None else arguments)
    end = words.index("--") if "--" in words else len(words)
    options = parser.parse_args(words[:end])
    names = options.targets or list(TARGETS)
    if unknown := [name for name in names if name not in TARGETS]:
        parser.error(f"unknown target {unknown[0]}; known: {', '.join(TARGETS)}")
    if options.examples < 1:
        parser.error(f"expected at least one example, got {options.examples}")
    if options.guided:
        guided(names[0], words[end + 1 :])
    passed = [fuzz(name, options.examples, options.seed) for name in names]
    print(f"fuzz, seed {options.seed}: {'passed' if all(passed) else 'FAILED'}")
    return 0 if all(passed) else 1


if __name__ == "__main__":
    sys.exit(main())
