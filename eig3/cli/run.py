"""Integrate a problem of eig3.problems. Print its energy balance and cost; write its history and a picture."""

from __future__ import annotations

import argparse

from ..options import add_out
from .problem import add_method_and_end, add_problem, builder

SUMMARY = "integrate a problem; report its energy balance, write its history and a picture"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problem(parser)
    steps = parser.add_mutually_exclusive_group()
    steps.add_argument(
        "--h", type=float, help="the step, s (default: the problem's own, or else at most a tenth of the critical step)"
    )
    steps.add_argument("--rtol", type=float, help="the relative tolerance, such as 1e-6, instead of a step")
    add_method_and_end(parser, "eig3, or with --rtol rk8 or rk5")
    add_out(parser, "folder for NAME.npz, NAME.png and, if the history is short, NAME.csv")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Return the exit status: 1 if the run failed, for example if it diverged."""
    from ..run import run

    build = builder(options.problem, "run")
    try:
        given = {name: getattr(options, name) for name in ("h", "rtol", "method", "t_end", "out")}
        solution = run(build, **given)
    except (TypeError, ValueError) as error:
        raise SystemExit(f"eig3 run: {error}") from None
    return 0 if solution.success else 1
