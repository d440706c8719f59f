"""Writes docs/tuning.md, the list of all tuned numbers, from where they stand: ``python -m docs.tuning``."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hs_tracker_cv
from hs_tracker_cv.detection import DetectorParams
from hs_tracker_cv.patch_tracker import PatchTrackerParams
from hs_tracker_cv.segmentation import SegmentationParams

LIBRARY = Path(hs_tracker_cv.__file__).parent
ROOMS: tuple[tuple[str, str, type | None], ...] = (
    # heading, file, the class of further numbers
    ("Arbitration", "arbitration/tuning.py", None),
    ("Segmentation", "segmentation/tuning.py", SegmentationParams),
    ("Patch tracker", "patch_tracker/tuning.py", PatchTrackerParams),
    ("Redetection", "redetection.py", None),
    ("Overview of the frame", "overview.py", None),
    ("A change of light", "photometry.py", None),
    ("Motion of the camera", "camera.py", None),
    ("Two frames compared", "comparison.py", DetectorParams),
    ("Moving regions between two frames", "detection.py", None),
    ("Pixels of one motion", "common_motion.py", None),
    ("Movers over several frames", "movers.py", None),
    ("Following by itself", "automatic.py", None),
)
INTRODUCTION = """# The numbers

Written by `python -m docs.tuning` from the files named below. Gray levels are of 255; what the sequences are called,
and how strictly they were kept apart, is in [results](results.md). The constants of the native kernels stand, each
with its unit, at the top of their files in `hs_tracker_cv/_native/`.
"""


def main() -> None:
    """Write the list."""
    path = Path(__file__).with_name("tuning.md")
    path.write_text(text(), encoding="utf-8")
    print(path)


def text() -> str:
    """The list, as Markdown."""
    parts = [INTRODUCTION]
    for heading, file, parameters in ROOMS:
        source = (LIBRARY / file).read_text(encoding="utf-8")
        said = _origin(ast.get_docstring(ast.parse(source)) or "")
        parts.append(f"\n## {heading}\n\n`hs_tracker_cv/{file}`. {said}".rstrip() + "\n")
        parts.append(_table(list(_constants(source))))
        if parameters is not None:
            parts.append(f"\nFields of `{parameters.__name__}`:\n")
            parts.append(_table(list(_fields(parameters))))
    return "\n".join(parts)


def _origin(docstring: str) -> str:
    """The paragraph that says where numbers were chosen."""
    found = [part for part in docstring.split("\n\n") if re.match(r"Where \w+( \w+)? were chosen", part)]
    return " ".join(found[0].split()).removesuffix(" docs/tuning.md lists them all.").rstrip(";") if found else ""


def _table(rows: list[tuple[str, str, str]]) -> str:
    lines = ["| name | value | what it is |", "|---|---|---|"]
    lines += [f"| `{name}` | {value} | {words.replace('|', chr(92) + '|')} |" for name, value, words in rows]
    return "\n".join(lines) + "\n"


def _constants(source: str) -> Iterator[tuple[str, str, str]]:
    """Names, values and words of the numbers that a file assigns; words are a string or a comment behind it."""
    body, lines = ast.parse(source).body, source.splitlines()
    for node, behind in zip(body, [*body[1:], None], strict=True):
        if not isinstance(node, ast.Assign) or not _is_number(node.value):
            continue
        if isinstance(behind, ast.Expr) and isinstance(behind.value, ast.Constant):
            words = " ".join(str(behind.value.value).split())
        else:
            words = lines[node.lineno - 1].partition("#")[2].strip()
        yield ast.unparse(node.targets[0]).strip("()"), ast.unparse(node.value).strip("()"), words


def _is_number(value: ast.expr) -> bool:
    """Tell whether an expression is made of numbers alone."""
    allowed = (ast.Tuple, ast.UnaryOp, ast.BinOp, ast.Constant, ast.operator, ast.unaryop, ast.expr_context)
    nodes = list(ast.walk(value))
    constants = [node.value for node in nodes if isinstance(node, ast.Constant)]
    return all(isinstance(node, allowed) for node in nodes) and all(isinstance(one, int | float) for one in constants)


def _fields(parameters: type[Any]) -> Iterator[tuple[str, str, str]]:
    """Names, defaults and words of the parameters of a class, by its docstring."""
    words = inspect.cleandoc(parameters.__doc__ or "").partition("----------\n")[2]
    for names, described in re.findall(r"^(\w[\w, ]*) : .*\n((?:    .*\n?)+)", words, flags=re.M):
        values = (repr(getattr(parameters, name)) for name in names.split(", "))
        yield names, ", ".join(values), " ".join(described.split())


if __name__ == "__main__":
    main()
