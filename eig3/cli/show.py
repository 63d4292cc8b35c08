"""Integrate a problem, and show its motion in three dimensions, on a page that one can turn."""

from __future__ import annotations

import argparse

from ..command_line import file
from .problem import add_method_and_end, add_problem, add_steps, integrate

SUMMARY = "integrate a problem, and show its motion in three dimensions"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problem(parser)
    add_steps(parser)
    add_method_and_end(parser, "eig3, or with --rtol rkn12, rk8 or rk5")
    parser.add_argument("--out", metavar="PATH", type=file, help="write the page to PATH, such as view.html")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Return the exit status: 1 if the run failed, for example if it diverged."""
    return integrate(options, "eig3 show", show=options.out or "")
