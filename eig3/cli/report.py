"""Measure what each accuracy costs in time on a problem, beside other solvers, and write a page of it."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..command_line import add_out
from ..named_problem import builder, reported
from .problem import add_problem

SUMMARY = "measure what each accuracy costs in time on a problem, and write a page of it"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problem(parser)
    parser.add_argument("--accuracy", type=float, nargs="+", metavar="E", help="the relative errors, such as 1e-3 1e-6")
    add_out(parser, "the folder of the page, report.html (default: here)")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    from .. import report

    build = builder(options.problem, "eig3 report")
    given = {} if options.accuracy is None else {"accuracies": options.accuracy}
    with reported("eig3 report"):
        print(f"Written: {report(build(), options.out or Path(), **given)}")
