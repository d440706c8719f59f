"""Speed of the flow, as ratios within one run: ``python -m benchmarks.bench_flow``.

Each line gives a time, what it is measured against and the bar it is held to. One thread, warm, the smallest of
many runs: the machine may be busy, and the smallest time is the one with the least of that in it. Milliseconds depend
on the machine, so the Middlebury times are scaled by cv2's DIS (medium), measured in the same run: as if DIS took the
20 ms that it takes on the machine the bars were set on.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from hs_tracker_cv.flow import HornSchunck, reference

MIDDLEBURY = Path(os.environ.get("MIDDLEBURY", Path(__file__).parents[2] / "shared" / "middlebury"))
CHOSEN_ON = ("Dimetrodon", "Grove2", "RubberWhale", "Urban2")
DIS_MS = 20.0

Image = NDArray[Any]


def best(call: Callable[[], object], seconds: float = 0.6) -> float:
    """Smallest time of one call within about `seconds`, in seconds; the first call is not counted.

    It is this thread's time on the processor: a longer call rarely gets through without another process's turn.
    """
    call()
    times: list[float] = []
    end = time.perf_counter() + seconds
    while len(times) < 3 or time.perf_counter() < end:
        start = time.thread_time()
        call()
        times.append(time.thread_time() - start)
    return min(times)


def pair(height: int, width: int) -> tuple[Image, Image]:
    """Smooth random texture, and the same a pixel further right."""
    noise = np.random.default_rng(0).random((height, width + 1)).astype(np.float32)
    blurred = cv2.GaussianBlur(noise, (0, 0), 1.5)
    image = cv2.normalize(blurred, None, 0, 255, cv2.NORM_MINMAX)
    return np.ascontiguousarray(image[:, 1:]), np.ascontiguousarray(image[:, :-1])


def gray_pair(name: str) -> tuple[Image, Image]:
    """Frames of a Middlebury pair, gray float32."""
    first, second = (cv2.imread(str(MIDDLEBURY / name / f"frame1{i}.png"), cv2.IMREAD_GRAYSCALE) for i in (0, 1))
    return first.astype(np.float32), second.astype(np.float32)


def residual(flow: Image, frames: tuple[Image, Image], smoothness: float) -> float:
    """Residual of the paper's system over its right-hand side, 2-norms, in float64."""
    fx, fy, ft = reference.derivatives(*frames)
    u, v = np.moveaxis(flow.astype(np.float64), -1, 0)
    data = fx * u + fy * v + ft
    part_u = smoothness**2 * (u - reference.average(u)) + fx * data
    part_v = smoothness**2 * (v - reference.average(v)) + fy * data
    return float(
        np.hypot(np.linalg.norm(part_u), np.linalg.norm(part_v)) / np.linalg.norm(np.hypot(fx * ft, fy * ft))
    )


def jacobi_sweeps(frames: tuple[Image, Image], smoothness: float, goal: float) -> int:
    """Plain sweeps, to within 5 %, that bring the residual under `goal`."""
    done, step, flow = 0, 20, None
    while True:
        flow = HornSchunck("classic", smoothness=smoothness, iterations=step, gain=1.0).calc(*frames, flow)
        done += step
        if residual(flow, frames, smoothness) <= goal:
            return done
        step = max(20, done // 20)


def sweep_rows(table: Table) -> None:
    """Cost of one fused sweep, by difference, against the NumPy reference."""
    frames = pair(128, 128)
    few = HornSchunck("classic", iterations=20)
    many = HornSchunck("classic", iterations=220)
    ours = (best(lambda: many.calc(*frames)) - best(lambda: few.calc(*frames))) / 200
    numpy_time = (
        best(lambda: reference.flow(*frames, 10.0, 22)) - best(lambda: reference.flow(*frames, 10.0, 2))
    ) / 20
    table.add_row("fused sweep, 128²", f"{ours / 128**2 * 1e9:.2f} ns/px", "", "<= 0.5 ns/px")
    table.add_row(
        "… against the NumPy reference", f"{numpy_time * 1e6:.0f} µs", f"{numpy_time / ours:.1f} ×", ">= 5 ×"
    )


def solve_rows(table: Table) -> None:
    """Time to a residual of 1e-3, set-up included, against plain sweeps: on texture and on a picture with flat parts.

    Where there is texture everywhere plain sweeps are at their best: the flow need not come from far away.
    """
    cases: list[tuple[str, tuple[Image, Image], float, str]] = [
        ("texture 128²", pair(128, 128), 15.0, "<= 0.25 ms"),
        ("texture 480 × 640", pair(480, 640), 50.0, ""),
    ]
    if MIDDLEBURY.is_dir():
        cases.append(("Grove2 480 × 640", gray_pair("Grove2"), 50.0, ">= 15 ×"))
    for name, frames, smoothness, bar in cases:
        solver = HornSchunck("solve", smoothness=smoothness, tolerance=1e-3, gain=1.0)
        seconds = best(lambda solver=solver, frames=frames: solver.calc(*frames))
        reached = residual(solver.calc(*frames), frames, smoothness)
        sweeps = jacobi_sweeps(frames, smoothness, 1e-3)
        plain = HornSchunck("classic", smoothness=smoothness, iterations=sweeps, gain=1.0)
        ratio = best(lambda plain=plain, frames=frames: plain.calc(*frames)) / seconds
        name = f"solve, {name}, λ {smoothness:g}, to 1e-3 (reached {reached:.0e})"
        table.add_row(name, f"{seconds * 1e3:.2f} ms", f"{ratio:.1f} × less than {sweeps} sweeps", bar)


def window_rows(table: Table) -> None:
    """Coarse to fine in a tracker's window."""
    frames = pair(128, 128)
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    bytes_ = [np.rint(frame).astype(np.uint8) for frame in frames]
    yardstick = best(lambda: dis.calc(*bytes_, None))
    for warps, bar in ((1, "<= 0.7 ms"), (3, "<= 1.5 ms")):
        solver = HornSchunck("default", warps=warps)
        seconds = best(lambda solver=solver: solver.calc(*frames))
        table.add_row(
            f"window 128², {warps} warp(s)", f"{seconds * 1e3:.2f} ms", f"{yardstick / seconds:.2f} × DIS", bar
        )


def middlebury_rows(table: Table) -> None:
    """Accuracy and time on the eight pairs with truth."""
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    methods: dict[str, Callable[[Image, Image], Image]] = {"cv2 DIS medium": lambda a, b: dis.calc(a, b, None)}
    methods |= {mode: HornSchunck(mode).calc for mode in ("fast", "default", "accurate")}
    bars = {"fast": "0.42 in 15 ms", "default": "0.39 in 30 ms", "accurate": "0.36 in 130 ms"}
    errors: dict[str, dict[str, float]] = {name: {} for name in methods}
    times: dict[str, list[float]] = {name: [] for name in methods}
    for folder in sorted(MIDDLEBURY.iterdir()):
        frames = [cv2.imread(str(folder / f"frame1{i}.png"), cv2.IMREAD_GRAYSCALE) for i in (0, 1)]
        truth = cv2.readOpticalFlow(str(folder / "flow10.flo"))
        known = (np.abs(truth) < 1e9).all(axis=-1)
        for name, method in methods.items():
            times[name].append(best(lambda method=method, frames=frames: method(*frames), 0.2))
            difference = (method(*frames) - truth)[known]
            errors[name][folder.name] = float(np.hypot(difference[:, 0], difference[:, 1]).mean())
    for name, by_pair in errors.items():
        others = [error for key, error in by_pair.items() if key not in CHOSEN_ON]
        scaled = np.mean(times[name]) / np.mean(times["cv2 DIS medium"]) * DIS_MS
        table.add_row(
            f"Middlebury, {name}",
            f"{np.mean(list(by_pair.values())):.3f} px, the other four {np.mean(others):.3f}",
            f"{scaled:.1f} ms scaled ({np.mean(times[name]) * 1e3:.1f})",
            bars.get(name, ""),
        )


def exposure_rows(table: Table) -> None:
    """False flow where nothing moves and only the brightness steps, as by auto-exposure; DIS is the bar."""
    image = cv2.imread(str(MIDDLEBURY / "RubberWhale" / "frame10.png"), cv2.IMREAD_GRAYSCALE)
    if image is None:
        image = np.rint(pair(388, 584)[0]).astype(np.uint8)
    dis = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    methods: dict[str, Callable[[Image, Image], Image]] = {
        mode: HornSchunck(mode).calc for mode in ("fast", "default", "accurate")
    }
    methods["cv2 DIS medium"] = lambda a, b: dis.calc(a, b, None)
    methods["cv2 Farnebäck"] = lambda a, b: cv2.calcOpticalFlowFarneback(a, b, None, 0.5, 5, 15, 3, 5, 1.1, 0)
    if hasattr(cv2, "optflow"):
        tv_l1 = cv2.optflow.DualTVL1OpticalFlow_create()
        methods["cv2 TV-L1"] = lambda a, b: tv_l1.calc(a, b, None)
    for name, method in methods.items():
        flows = [method(image, cv2.add(image, np.full_like(image, step))) for step in (5, 10, 20)]
        means = ", ".join(f"{np.hypot(flow[..., 0], flow[..., 1]).mean():.3f}" for flow in flows)
        table.add_row(
            f"false flow at + 5, + 10, + 20, {name}", f"{means} px", "", "" if "cv2" in name else "<= 0.02 px"
        )


def main() -> None:
    """Print the table."""
    cv2.setNumThreads(1)
    table = Table("what", "measured", "ratio", "bar", title="Horn–Schunck flow, one thread")
    sweep_rows(table)
    solve_rows(table)
    window_rows(table)
    if MIDDLEBURY.is_dir():
        middlebury_rows(table)
    exposure_rows(table)
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
