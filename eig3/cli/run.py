"""Integrate a problem of eig3.problems. Print its energy balance and cost; write its history and a picture."""

from __future__ import annotations

import argparse

from ..options import add_out
from .problem import add_method_and_end, add_problem, builder

SUMMARY = "integrate a problem; report its energy balance, write its history and a picture"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problem(parser)
    parser.add_argument(
        "--h", type=float, help="the step, s (default: the problem's own, or else at most a tenth of the critical step)"
    )
    add_method_and_end(parser)
    add_out(parser, "folder for NAME.npz, NAME.png and, if the history is short, NAME.csv")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Return the exit status: 1 if the run failed, for example if it diverged."""
    from ..run import run

    build = builder(options.problem, "run")
    try:
        solution = run(build, h=options.h, method=options.method, t_end=options.t_end, out=options.out)
    except (TypeError, ValueError) as error:
        raise SystemExit(f"eig3 run: {error}") from None
    return 0 if solution.success else 1
