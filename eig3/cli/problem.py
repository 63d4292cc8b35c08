"""The argument PROBLEM of the commands, and the options of a run."""

from __future__ import annotations

import argparse
from typing import Any

from ..command_line import printing
from ..named_problem import OWN, builder, reported


def add_problem(parser: argparse.ArgumentParser) -> None:
    """Add the argument, with the names of all problems in its help."""
    from .. import problems

    parser.add_argument("problem", metavar="PROBLEM", help=f"one of {', '.join(problems.__all__)}; or {OWN}")


def add_steps(parser: argparse.ArgumentParser) -> None:
    """Add the options for the step."""
    steps = parser.add_mutually_exclusive_group()
    steps.add_argument(
        "--h", type=float, help="the step, s (default: the problem's step, or at most a tenth of the critical step)"
    )
    steps.add_argument("--rtol", type=float, help="the relative tolerance, such as 1e-6, instead of a step")
    steps.add_argument(
        "--accuracy", type=float, help="the largest error of u relative to the motion, instead of a step"
    )


def add_method_and_end(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the options of a run except its step; `default` describes the default method."""
    parser.add_argument("--method", metavar="NAME", help=f"the method (default: {default})")
    parser.add_argument(
        "--t-end", dest="t_end", type=float, metavar="T", help="the duration, s (default: the problem's own)"
    )


def integrate(options: argparse.Namespace, command: str, **further: Any) -> int:
    """Run the problem with the options, and return the exit status: 1 if the run failed, for example if it diverged."""
    from ..run_report import run

    build = builder(options.problem, command)
    given = {name: getattr(options, name) for name in ("h", "rtol", "accuracy", "method", "t_end")}
    with printing() as write, reported(command):
        solution = run(build, **given, **further, write=write)
    return 0 if solution.success else 1
