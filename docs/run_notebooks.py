"""Runs the notebooks: ``python -m docs.run_notebooks``; one that raises fails the command."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import nbformat
from nbclient import NotebookClient
from nbformat import NotebookNode

__all__ = ["FOLDER", "executed", "main"]

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "notebooks"
_TIMEOUT = 600  # s, for one cell


def executed(path: Path) -> NotebookNode:
    """Notebook with its outputs; run in a folder of its own, so that the checkout stays as it is."""
    notebook = nbformat.read(path, as_version=4)
    (ROOT / "build").mkdir(exist_ok=True)
    with tempfile.TemporaryDirectory(dir=ROOT / "build") as folder:
        NotebookClient(notebook, timeout=_TIMEOUT, resources={"metadata": {"path": folder}}).execute()
    return notebook


def main() -> None:
    """Run all of them; copies with outputs go into build/notebooks."""
    out = ROOT / "build" / "notebooks"
    out.mkdir(parents=True, exist_ok=True)
    for path in sorted(FOLDER.glob("*.ipynb")):
        started = time.perf_counter()
        nbformat.write(executed(path), out / path.name)
        print(f"{path.name}: {time.perf_counter() - started:.0f} s", flush=True)


if __name__ == "__main__":
    main()
