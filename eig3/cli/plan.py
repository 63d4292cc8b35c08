"""Predict from short pilot runs which method reaches a given accuracy in the shortest time, and with which step."""

from __future__ import annotations

import argparse

from ..command_line import add_methods
from ..named_problem import builder, reported
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


def run(options: argparse.Namespace) -> int:
    """Return the exit status: 1 if no method reaches the accuracy."""
    from .. import plan

    build = builder(options.problem, "eig3 plan")
    with reported("eig3 plan"):
        found = plan(build(), options.accuracy, metric=options.metric, methods=options.methods)
    print(found)
    return 0 if found.predictions[0].reaches else 1
