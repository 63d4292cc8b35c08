"""The command line `eig3`, with a module for each command."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from contextlib import suppress

from .._version import __version__
from . import bench, cache, plan, report, run, show, sweep

__all__ = ["main"]

_COMMANDS = {"bench": bench, "run": run, "show": show, "plan": plan, "sweep": sweep, "report": report, "cache": cache}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status.

    Parameters
    ----------
    argv : sequence of str, optional
        The arguments after the name of the program; `sys.argv[1:]` if not given.
    """
    arguments = sys.argv[1:] if argv is None else argv
    options = _parser(arguments).parse_args(arguments)
    try:
        status = options.run(options) or 0
        print(end="", flush=True)  # sys.stdout is None if it is closed
        return status
    except KeyboardInterrupt:
        print("\nInterrupted.", file=sys.stderr)
        return 130
    except MemoryError as error:
        raise SystemExit(
            f"eig3 {options.command}: this does not fit in the memory: {error or 'take a shorter run or fewer members'}"
        ) from None
    except BrokenPipeError:  # the reader of a pipe, such as `head`, has closed it
        _drop_output()
        return 0
    except OSError as error:
        try:
            print(end="", flush=True)
        except OSError:  # the disk is full
            _drop_output()
        raise SystemExit(f"eig3 {options.command}: {error}") from None


def _drop_output() -> None:
    """Drop what cannot be written: Python flushes the output again at exit, and changes the exit status."""
    with suppress(OSError):  # an object in place of the output has no file
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _parser(arguments: Sequence[str]) -> argparse.ArgumentParser:
    """Return the parser, with the options of a command only if `arguments` contains the name of the command.

    The options of `eig3 bench` need an import of all benchmarks, which the other commands avoid.
    """
    parser = argparse.ArgumentParser(
        prog="eig3", description="Compiled explicit integrators for second-order systems u'' = f(t, u, u')."
    )
    parser.add_argument("--version", action="version", version=f"eig3 {__version__}")
    commands = parser.add_subparsers(required=True, dest="command", metavar="command")
    for name, command in _COMMANDS.items():
        added = commands.add_parser(name, help=command.SUMMARY, description=command.__doc__)
        if name in arguments:
            command.add_options(added)
    return parser
