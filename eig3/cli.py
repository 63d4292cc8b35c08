"""The `eig3` command."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ._version import __version__

if TYPE_CHECKING:
    from .problem import Problem


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    arguments = _parser().parse_args(argv)
    try:
        return arguments.run(arguments)
    except KeyboardInterrupt:
        print("\nInterrupted.", file=sys.stderr)
        return 130


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="eig3", description="Compiled explicit integrators for second-order systems u'' = f(t, u, u')."
    )
    parser.add_argument("--version", action="version", version=f"eig3 {__version__}")
    commands = parser.add_subparsers(required=True, metavar="command")

    bench = commands.add_parser(
        "bench",
        help="run a benchmark",
        description="Run a benchmark; alone, `eig3 bench` is `eig3 bench paper --quick`.",
    )
    _add_paper_options(bench, quick=True)
    benchmarks = bench.add_subparsers(metavar="benchmark")

    paper = benchmarks.add_parser("paper", help="the article's five tables", description="The article's five tables.")
    _add_paper_options(paper, quick=False)

    speed = benchmarks.add_parser(
        "speed",
        help="ns/step beside loops written by hand",
        description="ns/step of every method on the article's problems, beside the same loop written by hand.",
    )
    _add_speed_options(speed, _speed)

    c = benchmarks.add_parser(
        "c",
        help="ns/step beside the article's algorithms in C",
        description="ns/step of the kernels in both modes, beside C99 compiled here with the system's compiler.",
    )
    _add_speed_options(c, _c)

    precision = benchmarks.add_parser(
        "precision",
        help="what each accuracy costs in time",
        description="Error against time of every method and rival on seven problems; the time to reach accuracies.",
    )
    _add_problem_option(precision)
    _add_method_option(precision)
    precision.add_argument("--methods", dest="methods", nargs="+", metavar="NAME", help="only these methods")
    precision.add_argument("--repeats", type=_count, default=7, help="runs each median is of (7)")
    precision.add_argument(
        "--longest", type=float, default=0.25, metavar="S", help="halve steps until a run takes this (0.25)"
    )
    precision.add_argument("--no-rivals", dest="rivals", action="store_false", help="leave out SciPy, heyoka and CyRK")
    precision.add_argument(
        "--out", type=_folder, metavar="DIR", help="write precision.json, precision.md and pictures there"
    )
    precision.set_defaults(run=_precision)

    bars = benchmarks.add_parser(
        "bars",
        help="bars of up to a million masses, at the stability limit",
        description="Time per second simulated on elastic bars, every method at 0.95 of its stability limit.",
    )
    bars.add_argument("--repeats", type=_count, default=9, help="runs each median is of (9)")
    bars.set_defaults(run=_bars)

    hits = benchmarks.add_parser(
        "plan",
        help="how well eig3.plan predicts",
        description="What eig3.plan predicts on seven problems, beside what comes of it.",
    )
    _add_problem_option(hits)
    hits.set_defaults(run=_hits)

    stability = benchmarks.add_parser(
        "stability",
        help="stability limits, and the article's figures",
        description="Stability limits in closed form, by eigenvalues and by runs; the article's figures 1-7 and 9.",
    )
    stability.add_argument("--out", type=_folder, metavar="DIR", help="write stability.md and pictures there")
    stability.set_defaults(run=_stability)

    hard = benchmarks.add_parser(
        "hard",
        help="hard cases, each with what is expected",
        description="Runs at the edge: stability limits, chaos, impacts, close passages, round-off. Fails where a "
        "finding is not as expected.",
    )
    hard.add_argument("--case", dest="cases", action="append", type=_count, metavar="N", help="only this; repeatable")
    hard.set_defaults(run=_hard)

    scenes = benchmarks.add_parser(
        "scenes",
        help="what the code of a scene costs, beside code by hand",
        description="ns/step of scenes beside the same systems by hand; what effects that are not named add; time "
        "against the number of effects.",
    )
    scenes.add_argument("--repeats", type=_count, default=9, help="runs each median is of (9)")
    scenes.add_argument("--out", type=_folder, metavar="DIR", help="write scenes.png there")
    scenes.set_defaults(run=_scenes)

    report = benchmarks.add_parser(
        "report",
        help="everything on one page",
        description="The article's tables, C, work and precision with rivals, and the planner, as HTML and Markdown.",
    )
    _add_problem_option(report)
    _add_method_option(report)
    report.add_argument("--repeats", type=_count, default=7, help="runs each median is of (7)")
    report.add_argument("--out", type=_folder, metavar="DIR", required=True, help="where to write it")
    report.set_defaults(run=_report)

    run = commands.add_parser(
        "run",
        help="run a problem: its history, a picture, its energy",
        description="Run one of eig3.problems; print its energy balance, steps and ns/step, and write its history.",
    )
    run.add_argument("problem", help="one of eig3.problems, such as quarter_car")
    run.add_argument("--h", type=float, help="the step, s (what the problem suggests, or a tenth of the critical step)")
    run.add_argument("--method", default="eig3", metavar="NAME", help="(eig3)")
    run.add_argument("--t-end", dest="t_end", type=float, metavar="T", help="s (the problem's own)")
    run.add_argument("--out", type=_folder, metavar="DIR", help="write NAME.npz, .csv if not long, and .png there")
    run.set_defaults(run=_run)

    plan = commands.add_parser(
        "plan",
        help="predict which method reaches an accuracy soonest",
        description="Predict from short pilot runs which method reaches an accuracy soonest, at what step.",
    )
    plan.add_argument("problem", help="one of eig3.problems, such as spring_pendulum")
    plan.add_argument("--accuracy", type=float, required=True, help="the relative error to reach, such as 1e-4")
    plan.add_argument("--metric", choices=("trajectory", "energy"), default="trajectory", help="(trajectory)")
    _add_method_option(plan)
    plan.set_defaults(run=_plan)
    return parser


def _add_problem_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--problem", dest="problems", action="append", metavar="NAME", help="only this one; may be repeated"
    )


def _add_method_option(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--method", dest="methods", action="append", metavar="NAME", help="only this method; may be repeated"
    )


def _add_paper_options(parser: argparse.ArgumentParser, quick: bool) -> None:
    parser.add_argument("--table", type=int, choices=range(1, 6), help="only this one")
    parser.add_argument("--repeats", type=_count, help="runs each time is the mean of (10, or 3 with --quick)")
    parser.add_argument(
        "--quick",
        action="store_true",
        default=quick,
        help="fewer repeats, without the smallest steps of Tables 1-3 and 5",
    )
    parser.add_argument("--out", type=_folder, metavar="DIR", help="write results.json, tables.md and pictures there")
    parser.set_defaults(run=_paper)


def _add_speed_options(parser: argparse.ArgumentParser, run: Callable[[argparse.Namespace], int]) -> None:
    _add_method_option(parser)
    parser.add_argument("--repeats", type=_count, default=9, help="runs each median is of (9)")
    parser.set_defaults(run=run)


def _paper(arguments: argparse.Namespace) -> int:
    from .bench import paper

    repeats = arguments.repeats or (paper.QUICK_REPEATS if arguments.quick else 10)
    paper.run(only=arguments.table, repeats=repeats, quick=arguments.quick, out=arguments.out)
    return 0


def _speed(arguments: argparse.Namespace) -> int:
    from .bench import speed

    speed.run(methods=arguments.methods, repeats=arguments.repeats)
    return 0


def _c(arguments: argparse.Namespace) -> int:
    from .bench import baseline

    baseline.run(methods=arguments.methods, repeats=arguments.repeats)
    return 0


def _precision(arguments: argparse.Namespace) -> int:
    from .bench import precision

    precision.run(
        only=arguments.problems,
        methods=arguments.methods,
        repeats=arguments.repeats,
        longest=arguments.longest,
        rivals=arguments.rivals,
        out=arguments.out,
    )
    return 0


def _bars(arguments: argparse.Namespace) -> int:
    from .bench import bars

    bars.run(repeats=arguments.repeats)
    return 0


def _hits(arguments: argparse.Namespace) -> int:
    from .bench import hits

    hits.run(only=arguments.problems)
    return 0


def _stability(arguments: argparse.Namespace) -> int:
    from .bench import stability

    stability.run(out=arguments.out)
    return 0


def _hard(arguments: argparse.Namespace) -> int:
    from .bench import hard

    unknown = set(arguments.cases or ()) - set(hard.CASES)
    if unknown:
        raise SystemExit(f"eig3 bench hard: --case must be 1 to {len(hard.CASES)}, not {min(unknown)}.")
    return min(1, hard.run(only=arguments.cases))


def _scenes(arguments: argparse.Namespace) -> int:
    from .bench import scenes

    scenes.run(repeats=arguments.repeats, out=arguments.out)
    return 0


def _report(arguments: argparse.Namespace) -> int:
    from .bench import report

    report.run(out=arguments.out, repeats=arguments.repeats, only=arguments.problems, methods=arguments.methods)
    return 0


def _run(arguments: argparse.Namespace) -> int:
    from .run import run

    build = _builder(arguments.problem, "run")
    try:
        solution = run(build, h=arguments.h, method=arguments.method, t_end=arguments.t_end, out=arguments.out)
    except (TypeError, ValueError) as error:
        raise SystemExit(f"eig3 run: {error}") from None
    return 0 if solution.success else 1


def _plan(arguments: argparse.Namespace) -> int:
    from . import plan

    build = _builder(arguments.problem, "plan")
    try:
        print(
            plan(
                build(),
                arguments.accuracy,
                metric=arguments.metric,
                methods=arguments.methods,
            )
        )
    except ValueError as error:
        raise SystemExit(f"eig3 plan: {error}") from None
    return 0


def _builder(name: str, command: str) -> Callable[..., Problem]:
    """The function that builds a problem, by its name."""
    from . import problems

    if name not in problems.__all__:
        raise SystemExit(f"eig3 {command}: PROBLEM must be one of {', '.join(problems.__all__)}, not {name}.")
    return getattr(problems, name)


def _count(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, not {text!r}")
    return int(text)


def _folder(text: str) -> Path:
    """A folder that can be written to, made now rather than after minutes of measuring."""
    path = Path(text)
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise argparse.ArgumentTypeError(f"cannot be made: {error.strerror}: {text!r}") from None
    return path
