"""Fixtures that several test files share, and every tolerance by name."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

# Before NumPy is loaded, and for processes that tests start: threads of OpenBLAS wait awake for each other, and two
# test processes on two cores would need three times the processor for the same small matrices.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import cv2
import numpy as np
import pytest
from hypothesis import settings
from numpy.typing import NDArray

from hs_tracker_cv._native import kernels

# The same examples in every run, so that a change is what makes a test fail; benchmarks.fuzz looks for new ones.
# No deadline: on a busy machine it would be a timed test.
settings.register_profile("seeded", derandomize=True, deadline=None)
if "HS_FUZZ" not in os.environ:
    settings.load_profile("seeded")

REAL = Path(__file__).resolve().parents[2] / "shared" / "real"

LIKELIHOOD = kernels.segmentation.Likelihood(
    ground_slope=0.02,
    object_slope=0.12,
    channel_weight=1.8,
    contrast=0.9,
    occluded=False,
    noise=2.5,
    ground_gains=(0.35, 2.5),
    object_gains=(0.6, 1.7),
)
"""Numbers of the likelihoods as the kernels of segmentation take them, for a frame in colour."""

BOX_IOU = 0.9
"""IoU that a box must keep on a textured mover of constructed truth."""


@pytest.fixture(autouse=True)
def one_thread() -> Iterator[None]:
    """Results must not depend on the thread count; tests run side by side."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    yield
    cv2.setNumThreads(before)


@pytest.fixture
def rng() -> np.random.Generator:
    """A seeded generator."""
    return np.random.default_rng(20261122)


@pytest.fixture
def real() -> Path:
    """The folder of real sequences, or a skip where it is absent."""
    if not REAL.is_dir() or os.environ.get("HS_NO_REAL"):
        pytest.skip(f"no real sequences at {REAL}")
    return REAL


def smooth_noise(rng: np.random.Generator, height: int, width: int, sigma: float = 1.5) -> NDArray[np.float32]:
    """Texture with gradients everywhere, in 0–255."""
    noise = cv2.GaussianBlur(rng.standard_normal((height, width)).astype(np.float32), (0, 0), sigma)
    return np.asarray(cv2.normalize(noise, None, 20, 235, cv2.NORM_MINMAX), dtype=np.float32)


def moving_square(
    rng: np.random.Generator, *, count: int = 12, step: tuple[int, int] = (2, 1), side: int = 32
) -> tuple[list[NDArray[np.uint8]], list[tuple[int, int, int, int]]]:
    """A textured square that moves by whole pixels over a textured ground: frames (120, 160, 3) and exact boxes."""
    ground = np.stack([smooth_noise(rng, 120, 160, 3.0) * 0.5 for _ in range(3)], axis=2)
    square = np.stack([60 + smooth_noise(rng, side, side) * 0.7 for _ in range(3)], axis=2)
    frames, boxes = [], []
    for index in range(count):
        x, y = 30 + step[0] * index, 30 + step[1] * index
        image = ground.copy()
        image[y : y + side, x : x + side] = square
        image += rng.normal(0, 1.0, image.shape)
        frames.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
        boxes.append((x, y, side, side))
    return frames, boxes


@pytest.fixture
def level() -> Iterator[None]:
    """Leave the level as it was."""
    before = kernels.level()
    yield
    kernels.use_level(before)
