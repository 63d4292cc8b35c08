"""The argument PROBLEM of `eig3 run` and `eig3 plan`."""

from __future__ import annotations

import argparse
from collections.abc import Callable

from ..problem import Problem


def add_problem(parser: argparse.ArgumentParser) -> None:
    """Add the argument, with the names of all problems in its help."""
    from .. import problems

    parser.add_argument("problem", metavar="PROBLEM", help=f"one of {', '.join(problems.__all__)}")


def add_method_and_end(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the options of a run except its step; `default` describes the default method."""
    parser.add_argument("--method", metavar="NAME", help=f"the method (default: {default})")
    parser.add_argument(
        "--t-end", dest="t_end", type=float, metavar="T", help="the duration, s (default: the problem's own)"
    )


def builder(name: str, command: str) -> Callable[..., Problem]:
    """Return the function of `eig3.problems` that builds the problem `name`; errors name the `command`.

    Raises
    ------
    SystemExit
        If there is no such problem. The message lists the names of all problems.
    """
    from .. import problems

    if name not in problems.__all__:
        raise SystemExit(f"eig3 {command}: PROBLEM must be one of {', '.join(problems.__all__)}, not {name}.")
    return getattr(problems, name)
