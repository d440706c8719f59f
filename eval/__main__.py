"""Entry point of ``python -m eval``: finds the subcommand, loads only what it needs, turns errors into one line."""

from __future__ import annotations

import signal
import sys
import warnings
from importlib import import_module

__all__ = ["COMMANDS", "main"]

COMMANDS: dict[str, tuple[str, str]] = {
    "run": ("eval.commands:run", "run trackers over a suite or data set"),
    "merge": ("eval.commands:merge", "bring the results of several machines together"),
    "speed": ("eval.commands:speed", "time single updates, all trackers side by side"),
    "flow": ("eval.flow.command:main_flow", "compare dense flow methods on true flow"),
    "mot": ("eval.mot.command:main_mot", "compare trackers of several objects, for where and for who"),
    "bench": ("eval.commands:bench", "run, speed and report on one suite with every tracker"),
    "sweep": ("eval.commands:sweep", "the same draws with one parameter set to one value after the other"),
    "ablate": ("eval.commands:ablate", "what each part of TrackerHS is worth"),
    "check": ("eval.commands:check", "compare with the committed reference figures"),
    "report": ("eval.commands:report", "tables, plots and the HTML report from stored results"),
}
"""Subcommand -> ("module:function", what it does). The function's signature is its command line (tyro)."""


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand.

    Returns
    -------
    int
        Exit code: what the subcommand returns, 1 after an error that the user can mend, 2 for a wrong command line,
        130 after Ctrl-C.
    """
    # Being ended by `kill` is an interruption too: the workers end, and what is finished stays.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    arguments = sys.argv[1:] if arguments is None else arguments
    if not arguments or arguments[0] not in COMMANDS:
        asked = bool(arguments) and arguments[0] in ("-h", "--help")
        lines = [f"  {name:<8} {text}" for name, (_, text) in COMMANDS.items()]
        unknown = f"unknown command {arguments[0]!r}\n" if arguments and not asked else ""
        text = f"{unknown}usage: python -m eval COMMAND [-h] ...\n\n" + "\n".join(lines)
        print(text, file=sys.stdout if asked else sys.stderr)
        return 0 if asked else 2
    return _run(arguments[0], arguments[1:])


def _run(name: str, arguments: list[str]) -> int:
    import tyro

    from .results import ResultsError

    module, _, function = COMMANDS[name][0].partition(":")
    try:
        command = getattr(import_module(module), function)
        with warnings.catch_warnings():
            # One line each, as errors are, and not the line of source that says it.
            warnings.showwarning = _show_warning
            chosen = tyro.cli(
                command, args=arguments, prog=f"python -m eval {name}", config=(tyro.conf.OmitArgPrefixes,)
            )
        return int(chosen or 0)
    except (ResultsError, ValueError, OSError, ImportError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print("interrupted: what was finished is stored, the same command goes on from there", file=sys.stderr)
        return 130


def _show_warning(message: Warning | str, *_: object, **__: object) -> None:
    print(f"warning: {message}", file=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
