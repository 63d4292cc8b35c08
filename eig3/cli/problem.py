"""The argument PROBLEM of `eig3 run`, `eig3 plan` and `eig3 sweep`."""

from __future__ import annotations

import argparse

from ..named_problem import OWN


def add_problem(parser: argparse.ArgumentParser) -> None:
    """Add the argument, with the names of all problems in its help."""
    from .. import problems

    parser.add_argument("problem", metavar="PROBLEM", help=f"one of {', '.join(problems.__all__)}; or {OWN}")


def add_method_and_end(parser: argparse.ArgumentParser, default: str) -> None:
    """Add the options of a run except its step; `default` describes the default method."""
    parser.add_argument("--method", metavar="NAME", help=f"the method (default: {default})")
    parser.add_argument(
        "--t-end", dest="t_end", type=float, metavar="T", help="the duration, s (default: the problem's own)"
    )
