"""Predict from short pilot runs which method reaches a given accuracy in the shortest time, and with which step."""

from __future__ import annotations

import argparse

from ..command_line import add_methods
from ..named_problem import builder
from .problem import add_problem

SUMMARY = "predict which method reaches a given accuracy fastest"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problem(parser)
    parser.add_argument("--accuracy", type=float, required=True, help="the largest relative error, such as 1e-4")
    parser.add_argument(
        "--metric",
        choices=("trajectory", "energy"),
        default="trajectory",
        help="the quantity that must reach the accuracy (default: trajectory)",
    )
    add_methods(parser)
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> None:
    from .. import plan

    build = builder(options.problem, "eig3 plan")
    try:
        problem = build()
        print(plan(problem, options.accuracy, metric=options.metric, methods=options.methods))
    except (TypeError, ValueError) as error:
        raise SystemExit(f"eig3 plan: {error}") from None
