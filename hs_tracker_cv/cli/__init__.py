"""`hs-track`: follow one object through a video; boxes as CSV, an overlay video, the paper's panels.

This package and ``__main__`` are the only ones that print. Errors are one line on stderr: exit code 2 for a
command that cannot be meant, 1 for input or output that fails, 128 + its number for a signal (130 for Ctrl-C); what
was written stays.
"""

from __future__ import annotations

import platform
import sys
from collections.abc import Sequence

import cv2
import numpy as np

from .. import __version__
from ..frames import InputError
from ..video import VideoError, silence_decoders
from .command import FAILURE, complain, end_of_pipe, follow
from .interrupts import Interrupted, interrupts_raised
from .options import PROGRAM, AppOptions, Options, UsageError, parsed

__all__ = ["main"]

USAGE = 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command and return its exit code."""
    silence_decoders()
    # Names of files may hold what cannot be encoded.
    if hasattr(sys.stdout, "reconfigure"):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        with interrupts_raised():
            return _command(sys.argv[1:] if arguments is None else list(arguments))
    except UsageError as error:
        return complain(error, USAGE)
    except BrokenPipeError:
        return end_of_pipe()
    except (VideoError, InputError, OSError, ImportError) as error:
        return complain(error, FAILURE)
    except Interrupted as interrupt:
        return interrupt.code


def _command(arguments: list[str]) -> int:
    if arguments == ["--version"]:
        parts = f"OpenCV {cv2.__version__}, NumPy {np.__version__}, Python {platform.python_version()}"
        print(f"{PROGRAM} {__version__} ({parts})")
        return 0
    if not arguments:
        raise UsageError(
            f"expected a VIDEO to follow, or app for the live page, which needs none; see {PROGRAM} --help"
        )
    if arguments[:1] == ["app"]:
        from ..app import serve

        page = parsed(AppOptions, arguments[1:], f"{PROGRAM} app")
        return serve(page.video, models=page.models, port=page.port, show=not page.no_show)
    return follow(parsed(Options, arguments))
