"""Run a problem for many values of its parameters, and measure each run. Write a table and a picture.

The parameters have the same names as in Python, as in `eig3.problems.duffing(omega=1.2)`; u0[1] and v0[1] are entries
of the initial values. One or two --set make a grid.
"""

from __future__ import annotations

import argparse
from importlib.util import find_spec

from ..command_line import add_out, count, printing
from ..named_problem import builder, reported
from .problem import add_method_and_end, add_problem

SUMMARY = "run a problem for many values of its parameters, and draw the results"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problem(parser)
    parser.add_argument(
        "--set",
        dest="axes",
        action="append",
        default=[],
        metavar="NAME=FROM:TO:COUNT",
        help="sweep a parameter; :log at the end spaces the values logarithmically; leave :COUNT out with --random",
    )
    parser.add_argument(
        "--fix", dest="fixed", action="append", default=[], metavar="NAME=VALUE", help="another value of a parameter"
    )
    parser.add_argument(
        "--measure",
        dest="measures",
        action="append",
        required=True,
        metavar="KIND:QUANTITY",
        help="what to measure, such as max:u0, min:v1, peak:u1-u0, end:u0, drift:energy, or an output of the "
        "problem; peak is the largest size; may be repeated",
    )
    parser.add_argument("--random", type=count, metavar="COUNT", help="draw this number of members between FROM and TO")
    parser.add_argument("--seed", type=int, default=0, help="the seed of --random (default: 0)")
    parser.add_argument("--after", type=float, metavar="T", help="measure from this time on only, s")
    parser.add_argument(
        "--h", type=float, help="the step, s (default: the shortest of `eig3 run` at the corners of the swept region)"
    )
    add_method_and_end(parser, "eig3")
    parser.add_argument(
        "--check", action="store_true", help="estimate the errors of the measures from runs with half the step"
    )
    add_out(parser, "folder for sweep.csv, sweep.npz and sweep.png")
    parser.set_defaults(run=run)


def run(options: argparse.Namespace) -> int:
    """Return the exit status: 1 if no member reached the end."""
    from ..sweep.axes import Axis
    from ..sweep.measures import Measure
    from ..sweep.report import report, save
    from ..sweep.study import Study

    build = builder(options.problem, "eig3 sweep")
    with reported("eig3 sweep"):
        study = Study.plan(
            build,
            [Axis.parse(text, random=options.random is not None) for text in options.axes],
            [Measure.parse(text) for text in options.measures],
            fixed=[_fixed(text) for text in options.fixed],
            method="eig3" if options.method is None else options.method,
            **{name: getattr(options, name) for name in ("random", "seed", "h", "t_end", "after")},
        )
        interrupt = None
        try:
            study.run(has_tqdm := find_spec("tqdm") is not None)
            if options.check:
                study.check(has_tqdm)
        except KeyboardInterrupt as error:
            interrupt = error
    with printing() as write:
        report(study, write)
        if options.out is not None:
            save(study, options.out, write)
    if interrupt:
        raise interrupt
    return 0 if any(study.completed) else 1


def _fixed(text: str) -> tuple[str, float]:
    name, _, value = text.partition("=")
    try:
        return name.strip(), float(value)
    except ValueError:
        raise ValueError(f"--fix must be NAME=VALUE, such as omega=1.2, not {text!r}.") from None
