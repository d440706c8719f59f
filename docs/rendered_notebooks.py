"""Hook of MkDocs: the notebooks as pages of the site, executed while it is built; one that raises fails the build."""

from __future__ import annotations

import tempfile
from pathlib import Path

import nbformat
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from nbclient import NotebookClient
from nbconvert import MarkdownExporter
from nbformat import NotebookNode

__all__ = ["FOLDER", "executed", "on_files"]

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


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add a page for each notebook, and the pictures in it."""
    for path in sorted(FOLDER.glob("*.ipynb")):
        text, made = MarkdownExporter().from_notebook_node(executed(path), {"output_files_dir": path.stem})
        title, _, rest = text.partition("\n")
        source = f"Executed when this page was built, from [{path.name}]({path.name})."
        files.append(File.generated(config, f"{FOLDER.name}/{path.stem}.md", content=f"{title}\n\n{source}\n{rest}"))
        for name, picture in made["outputs"].items():
            files.append(File.generated(config, f"{FOLDER.name}/{name}", content=picture))
    return files
