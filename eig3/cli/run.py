"""Run one of eig3.problems; print its energy balance, steps and ns/step, and write its history."""

from __future__ import annotations

import argparse

from ..options import add_out
from .problem import builder

SUMMARY = "run a problem: its history, a picture, its energy"


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("problem", help="one of eig3.problems, such as quarter_car")
    parser.add_argument("--h", type=float, help="the step, s (the problem's own, or else a tenth of the critical step)")
    parser.add_argument("--method", default="eig3", metavar="NAME", help="(eig3)")
    parser.add_argument("--t-end", dest="t_end", type=float, metavar="T", help="s (the problem's own)")
    add_out(parser, "write NAME.npz, .csv unless it would be long, and .png there")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Exit status 1 means that the run failed, for example that it diverged."""
    from ..run import run

    build = builder(options.problem, "run")
    try:
        solution = run(build, h=options.h, method=options.method, t_end=options.t_end, out=options.out)
    except (TypeError, ValueError) as error:
        raise SystemExit(f"eig3 run: {error}") from None
    return 0 if solution.success else 1
