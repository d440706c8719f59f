"""First use: nothing is compiled or written, also where nothing can be."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import hs_tracker_cv

PACKAGE = Path(hs_tracker_cv.__file__).parent

FLOW = """
import numpy as np
import hs_tracker_cv
from hs_tracker_cv import HornSchunck
y, x = np.mgrid[:40, :40].astype(np.float32)
frames = [128 + 60 * np.sin((x - dx) / 4) + 60 * np.cos(y / 5) for dx in (0, 1)]
flow = HornSchunck("fast").calc(*frames)
assert abs(flow[20, 20, 0] - 1) < 0.1, flow[20, 20]
print(hs_tracker_cv.__file__)
"""

TRACKER = """
import numpy as np
from hs_tracker_cv import TrackerHS_create
rng = np.random.default_rng(0)
ground, square = rng.integers(0, 120, (120, 160, 3), np.uint8), rng.integers(100, 255, (30, 30, 3), np.uint8)
def frame(i):
    image = ground.copy()
    image[40 : 70, 40 + i : 70 + i] = square
    return image
tracker = TrackerHS_create()
tracker.init(frame(0), (40, 40, 30, 30))
for i in range(1, 4):
    ok, box = tracker.update(frame(i))
assert ok and abs(box[0] - 43) <= 3, (ok, box)
"""


@pytest.fixture
def installation(tmp_path):
    """A copy of the package, without compiled files, and the environment of a process that uses it."""
    shutil.copytree(PACKAGE, tmp_path / "lib" / "hs_tracker_cv", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {key: value for key, value in os.environ.items() if not key.startswith("XDG_")}
    environment |= {"PYTHONPATH": str(tmp_path / "lib"), "PYTHONDONTWRITEBYTECODE": "1", "HOME": str(tmp_path)}
    return tmp_path, environment


def make_unwritable(tmp_path, environment):
    """Put files where caches would go: it stops root too, whom permissions do not bind."""
    for folder in [tmp_path / "lib" / "hs_tracker_cv", *(tmp_path / "lib" / "hs_tracker_cv").rglob("*/")]:
        if folder.is_dir():
            (folder / "__pycache__").write_text("")
    (tmp_path / "home").write_text("")
    environment["HOME"] = str(tmp_path / "home")


# An editable install of scikit-build-core finds its package before PYTHONPATH does; here the copy is meant.
FROM_PATH = """
import sys
sys.meta_path[:] = [finder for finder in sys.meta_path if not type(finder).__module__.startswith("_editable_skbc")]
"""


def run(code, environment, *options):
    """Standard output and error of the code in a process of its own, which must succeed."""
    command = [sys.executable, *options, "-W", "error", "-c", FROM_PATH + code]
    answer = subprocess.run(command, env=environment, cwd=environment["PYTHONPATH"], capture_output=True, text=True)
    assert answer.returncode == 0, answer.stderr
    return answer.stdout, answer.stderr


def test_works_where_nothing_can_be_written(installation):
    """A read-only installation without a home works, silently, and leaves nothing behind."""
    tmp_path, environment = installation
    make_unwritable(tmp_path, environment)
    before = sorted(tmp_path.rglob("*"))
    output, errors = run(TRACKER + FLOW, environment)
    assert output.strip().startswith(str(tmp_path))
    assert errors == ""
    assert sorted(tmp_path.rglob("*")) == before


DAEMON = """
import threading
from hs_tracker_cv._native import kernels
multigrid = kernels.Multigrid(64, 64)
def wait():
    threading.Event().wait()
threading.Thread(target=wait, daemon=True).start()
"""


def test_a_daemon_thread_that_outlives_python_is_no_leak(installation):
    """Its globals, and what they hold, are never given back; users are not told of leaks that are none."""
    _, environment = installation
    assert run(DAEMON, environment) == ("", "")
