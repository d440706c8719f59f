"""The long runs: a short soak here, and that each long one passes and fails where it must."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks import concurrency, fuzz
from benchmarks import soak as soaking
from benchmarks.soak import GROWTH, Soaked, soak

pytestmark = pytest.mark.once

FAULTY = """
import os, signal, time
from hypothesis import given, settings, strategies as st

few = settings(max_examples=int(os.environ["HS_FUZZ"]), database=None)

@few
@given(st.integers())
def test_sound(number): pass

@few
@given(st.integers())
def test_wrong(number): assert number < 5

@few
@given(st.integers())
def test_crash(number): os.kill(os.getpid(), signal.SIGSEGV)

@settings(max_examples=1, deadline=None)
@given(st.integers())
def test_hang(number): time.sleep(600)

def test_without_examples(): pass
"""


def test_memory_stays_where_it_was() -> None:
    """Tracks, losses and new inits leave nothing behind."""
    soaked = soak(900, restart=90, settled=400)
    assert soaked.growth < GROWTH
    assert len(soaked.tenths) == 10


def test_a_soak_too_short_to_settle_is_refused() -> None:
    """Before memory has settled there is nothing to compare with."""
    with pytest.raises(ValueError, match="1000"):
        soak(1000)


@pytest.mark.parametrize(
    ("final", "highest", "last", "words"),
    [
        (101.9, 101.9, 2.2, []),
        (102.5, 102.5, 2.0, ["growth of memory in MB is 2.50"]),
        (100.0, 103.0, 2.0, ["growth of memory in MB is 3.00"]),
        (90.0, 100.0, 2.4, ["time per update at the end over that at the beginning is 1.20"]),
        (103.0, 103.0, 3.0, ["growth", "time"]),
    ],
)
def test_a_soak_passes_within_its_bars_only(
    final: float,
    highest: float,
    last: float,
    words: list[str],
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """More memory at any time, or slower updates at the end, are named, and the exit code is 1."""
    soaked = Soaked(5000, 100.0, final, highest, (2.0,) * 7 + (last,) * 3)
    faults = soaked.faults()
    assert len(faults) == len(words)
    assert all(fault.startswith(word) for fault, word in zip(faults, words, strict=True))
    monkeypatch.setattr(soaking, "soak", lambda updates: soaked)
    assert soaking.main([]) == (1 if words else 0)
    assert capsys.readouterr().out.splitlines()[-1].startswith("soak: FAILED" if words else "soak: passed")


@pytest.mark.parametrize(
    ("ratios", "load", "code", "words"),
    [
        ([1.7, 1.6, 1.2], 0.0, 0, "1.60 × (from 1.20 to 1.70), expected 1.6 ×: passed"),
        ([1.7, 1.5, 1.2], 0.0, 1, "expected 1.6 ×: FAILED"),
        ([1.5, 1.5, 1.5], 2.0, 1, "FAILED on a busy machine (load average 2.0 before the start)"),
    ],
)
def test_two_threads_pass_at_their_bar_only(
    ratios: list[float],
    load: float,
    code: int,
    words: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The median decides; a busy machine is said, and is no excuse."""
    times = iter([1.0, *(value for ratio in ratios for value in (1.0, 2.0 / ratio))])
    monkeypatch.setattr(concurrency, "seconds", lambda threads, data: next(times))
    monkeypatch.setattr(concurrency.os, "getloadavg", lambda: (load, 0.0, 0.0))
    assert concurrency.main(["--repeats", "3"]) == code
    assert words in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.parametrize(
    ("name", "fault", "examples"),
    [
        ("sound", "", 7),
        ("wrong", "failed", None),
        ("crash", "crashed (SIGSEGV)", 0),
        ("without_examples", "tried nothing", 0),
        ("absent", "could not be run (pytest ended with 4)", 0),
    ],
)
def test_a_batch_of_examples_ends_in_a_verdict(name: str, fault: str, examples: int | None, tmp_path: Path) -> None:
    """What fails, crashes or never ran is named, and what passed is counted."""
    (tmp_path / "test_faulty.py").write_text(FAULTY)
    fuzzed = fuzz.batch(f"{tmp_path / 'test_faulty.py'}::test_{name}", 7, seed=3)
    assert fuzzed.fault == fault
    assert examples is None or fuzzed.examples == examples


def test_a_batch_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """After its time it is ended, and its output says where it was."""
    (tmp_path / "test_faulty.py").write_text(FAULTY)
    monkeypatch.setattr(fuzz, "GRACE", 8.0)
    fuzzed = fuzz.batch(f"{tmp_path / 'test_faulty.py'}::test_hang", 1, seed=3, patience=0.0)
    assert fuzzed.fault == "hangs"
    assert "in test_hang" in fuzzed.output


@pytest.mark.parametrize("fault", ["", "crashed (SIGSEGV)"])
def test_fuzzing_fails_when_a_batch_does(
    fault: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """All examples are made, in batches with seeds of their own; one bad batch is named, and the exit code is 1."""
    batches = []

    def batch(test: str, examples: int, seed: int) -> fuzz.Fuzzed:
        batches.append((test, examples, seed))
        return fuzz.Fuzzed(examples, fault if seed == 6 else "", "")

    monkeypatch.setattr(fuzz, "batch", batch)
    assert fuzz.main(["rois", "--examples", "2500", "--seed", "5"]) == (1 if fault else 0)
    assert batches == [(fuzz.TARGETS["rois"], count, seed) for count, seed in ((1000, 5), (1000, 6), (500, 7))]
    printed = capsys.readouterr().out
    assert ("seed 6 crashed (SIGSEGV)" in printed) == bool(fault)
    assert printed.endswith(f"fuzz, seed 5: {'FAILED' if fault else 'passed'}\n")


def test_every_target_of_the_fuzzer_is_a_generated_test() -> None:
    """A renamed test must not leave the long run empty."""
    for name in fuzz.TARGETS:
        assert callable(fuzz.guided_target(name))
    assert fuzz.TARGETS["calls"].endswith("::TestTwins::runTest")
