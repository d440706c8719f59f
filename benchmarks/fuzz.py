"""Coverage-guided fuzzing, without end: atheris drives the generated tests of the robustness suite.

``python -m benchmarks.fuzz`` runs until it is interrupted or something fails; options after ``--`` go to libFuzzer
(``python -m benchmarks.fuzz frames -- -max_total_time=600``). Without atheris, ``HS_FUZZ=long pytest tests -k
robust`` does the same blindly.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import tempfile
import warnings
from collections.abc import Callable, Sequence
from typing import Any, cast

TARGETS = ("calls", "frames", "rois", "first")
"""Any calls in any order; any object mid-track; any ROI; any first frame."""

KERNELS = ["hs_tracker_cv.flow.kernels", "hs_tracker_cv.layers.kernels", "hs_tracker_cv.patches"]


def target(name: str) -> Callable[[bytes], object]:
    """The generated test of a target, as a function of bytes."""
    from hypothesis.stateful import get_state_machine_test

    from tests import test_robustness as robustness
    from tests.test_robustness_machine import Twins

    tests: dict[str, Any] = {
        "calls": get_state_machine_test(Twins, settings=robustness.examples(1)),
        "frames": robustness.test_any_object_mid_track_is_answered_or_refused,
        "rois": robustness.test_any_roi_starts_a_track_or_is_an_input_error,
        "first": robustness.test_init_takes_frames_and_refuses_all_else,
    }
    return cast("Callable[[bytes], object]", tests[name].hypothesis.fuzz_one_input)


def main(arguments: Sequence[str] | None = None) -> None:
    """Fuzz one target."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("target", nargs="?", choices=TARGETS, default="calls")
    parser.add_argument("fuzzer", nargs="*", help="options of libFuzzer, after --")
    options = parser.parse_args(arguments)
    if importlib.util.find_spec("atheris") is None:
        sys.exit(
            "benchmarks.fuzz needs atheris (pip install atheris); HS_FUZZ=long pytest tests -k robust does without"
        )
    import atheris

    # Numba cannot compile instrumented functions.
    with atheris.instrument_imports(include=["hs_tracker_cv"], exclude=KERNELS):
        import hs_tracker_cv.tracker  # noqa: F401
    warnings.simplefilter("error")
    atheris.Setup(
        [sys.argv[0], f"-artifact_prefix={tempfile.gettempdir()}/", *options.fuzzer], target(options.target)
    )
    atheris.Fuzz()


if __name__ == "__main__":
    main()
