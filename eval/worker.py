"""The process in which what is judged runs: it answers requests, one at a time, and knows no truth and no path.

Started by :mod:`eval.supervisor`. Requests come by standard input and answers go by standard output, as messages of
:mod:`eval.wire`. The first request names a service, ``{"service": "pkg.module:name"}``, and is answered with the
number of this process; what comes then is handed to ``service.answer(content, arrays)``, which returns the same two.
An exception is answered as ``{"failure": "..."}``.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any, BinaryIO, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from .wire import read_message, write_message

__all__ = ["Arrays", "Service", "resolve", "serve"]

_UNWRITTEN = 74  # EX_IOERR of sysexits.h: an answer could not be written

Arrays = Sequence[NDArray[Any]]


class Service(Protocol):
    """What a worker does with its requests."""

    def answer(self, content: Mapping[str, Any], arrays: Arrays) -> tuple[Mapping[str, Any], Arrays]:
        """Answer one request."""


def resolve(reference: str) -> Any:
    """Return the callable that ``"pkg.module:name"`` refers to.

    Raises
    ------
    ValueError
        If there is no such module or name in it, or it cannot be called.
    """
    module, _, name = reference.partition(":")
    if not module or not name:
        raise ValueError(f"expected pkg.module:factory, got {reference!r}")
    try:
        found = import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as error:
        raise ValueError(f"cannot load {reference!r}: {error}") from error
    if not callable(found):
        raise ValueError(f"expected pkg.module:factory, got {reference!r}, which cannot be called")
    return found


def serve() -> None:
    """Answer until standard input ends."""
    requests, answers = _take_pipes()
    cv2.setNumThreads(1)
    np.seterr(all="ignore")
    content, arrays = read_message(requests)
    service: Service = resolve(content["service"])()
    _send(answers, {"process": os.getpid()}, ())
    while True:
        try:
            content, arrays = read_message(requests)
        except EOFError:
            return
        _send(answers, *_answer(service, content, arrays))


def _take_pipes() -> tuple[BinaryIO, BinaryIO]:
    """Keep the two pipes apart from what a tracker reads and prints: nothing, and standard error."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb")
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.dup2(2, 1)
    return requests, answers


def _answer(service: Service, content: Mapping[str, Any], arrays: Arrays) -> tuple[Mapping[str, Any], Arrays]:
    if content.get("do") == "nothing":
        return {}, ()
    try:
        return service.answer(content, arrays)
    except SystemExit:
        raise
    except BaseException as error:  # whatever a tracker raises is its row's reason and not ours to die of
        # Ctrl-C does not reach this process, so that KeyboardInterrupt is the tracker's too.
        words = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
        return {"failure": f"raised {words.removesuffix(': ')}"}, ()


def _send(answers: BinaryIO, content: Mapping[str, Any], arrays: Arrays) -> None:
    try:
        write_message(answers, content, arrays)
    except OSError:
        # At once: Python would try to write it again on its way out.
        os._exit(_UNWRITTEN)
