"""Measure the error against the time of every method and rival on seven problems, and the time to reach accuracies."""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from eig3.methods import LIBRARY
from eig3.options import Files, add_methods, add_out

from . import pictures, text
from .environment import environment, in_words
from .options import add_problems, add_repeats, choose
from .problem_set import PROBLEM_SET
from .reference import METRICS
from .sweep import LONGEST, STATES, Point, WorkPrecisionSet, measure

SUMMARY = "what each accuracy costs in time"
TARGETS = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problems(parser)
    add_methods(parser)
    parser.add_argument("--methods", dest="methods", nargs="+", metavar="NAME", help="only these methods")
    add_repeats(parser, 7)
    parser.add_argument(
        "--longest",
        type=float,
        default=LONGEST,
        metavar="S",
        help=f"halve the steps until a run takes this time ({LONGEST})",
    )
    parser.add_argument("--no-rivals", dest="rivals", action="store_false", help="leave out SciPy, heyoka and CyRK")
    add_out(parser, "folder for precision.json, precision.md and pictures")


def run(options: argparse.Namespace) -> None:
    benchmark(
        only=options.problems,
        methods=options.methods,
        repeats=options.repeats,
        longest=options.longest,
        rivals=options.rivals,
        out=options.out,
    )


def benchmark(
    *,
    only: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    repeats: int = 7,
    longest: float = LONGEST,
    rivals: bool = True,
    out: Path | None = None,
    write: Callable[[str], None] = print,
) -> None:
    """Measure, print each problem as soon as it is complete, and save after each problem in `out`."""
    names, methods = choose(only, list(PROBLEM_SET), "--problem"), choose(methods, LIBRARY)
    files = None if out is None else Files(out, "eig3 bench")
    pages, results = [heading(repeats, longest)], []
    write(pages[0])
    for name in names:
        results.append(measure(name, PROBLEM_SET[name], methods, repeats, longest, rivals))
        pages.append(render(results[-1]))
        write("\n" + pages[-1])
        if files:
            save(files, results)
            with files.writing("precision.md") as path:
                path.write_text("\n\n".join(pages) + "\n")
    if files:
        figures = {f"precision_{result.name}.png": partial(pictures.work_precision, result) for result in results}
        files.finish(write, pictures.draw(figures, files, dpi=110))


def heading(repeats: int, longest: float) -> str:
    return (
        f"Machine: {in_words()}\n\n"
        f"Times: medians of {repeats} interleaved runs, compiling left out, {STATES} states kept of every run; the "
        f"methods with the right-hand side through a pointer. Steps are halved until a run takes {longest:g} s."
    )


@dataclass(frozen=True)
class Reach:
    """What a method needs for a target: seconds and setting. With `at_most`, its first setting is already enough."""

    seconds: float
    setting: float
    at_most: bool


def reach(points: Sequence[Point], metric: str, target: float) -> Reach | None:
    """Interpolate, in logarithms, where the error first falls below `target`; None if it never does."""
    usable = sorted((p for p in points if p.stable and metric in p.errors), key=lambda point: -point.setting)
    first = next((i for i, point in enumerate(usable) if point.errors[metric] <= target), None)
    if first is None:
        return None
    if first == 0:
        return Reach(usable[0].time, usable[0].setting, True)
    one, two = usable[first - 1], usable[first]
    fraction = math.log(one.errors[metric] / target) / math.log(one.errors[metric] / max(two.errors[metric], 1e-300))

    def between(a: float, b: float) -> float:
        return a ** (1 - fraction) * b**fraction

    return Reach(between(one.time, two.time), between(one.setting, two.setting), False)


def render(result: WorkPrecisionSet) -> str:
    """The page of one problem: for each metric a table of times to reach accuracies, and the Pareto front."""
    parts = [f"## {result.problem.title} ({result.name})"]
    parts.append(f"Truth: {result.source}, known to {result.uncertainty:.1g} of max |u|.")
    for metric in result.metrics:
        parts += [render_reach(result, metric), front(result, metric)]
    unstable = [f"{p.label} at {p.setting:.3g}" for p in result.points if not p.stable]
    if unstable:
        parts.append(f"Unstable or useless, and kept in the pictures: {', '.join(unstable)}.")
    if result.skipped:
        parts.append(f"Left out: {', '.join(result.skipped)}.")
    return "\n\n".join(parts)


def render_reach(result: WorkPrecisionSet, metric: str) -> str:
    """The table of times to reach each target; the fastest of each target is bold."""
    header = [f"time to reach ({metric})", *(f"{target:g}" for target in TARGETS)]
    reached = {m: [reach(result.of(m), metric, target) for target in TARGETS] for m in result.methods}
    best = [
        min((found.seconds for found in column if found), default=None)
        for column in zip(*reached.values(), strict=True)
    ]
    rows = []
    for method, label in result.methods.items():
        cells = []
        for i, found in enumerate(reached[method]):
            cell = _cell(found, result.of(method), metric)
            cells.append(f"**{cell}**" if found and found.seconds == best[i] else cell)
        rows.append([label, *cells])
    note = (
        "In brackets the step (s), or the tolerance of a rival. <=: the longest stable step is already that accurate. "
        ">: the shortest step tried is not accurate enough. -: the error no longer falls. The fastest is bold."
    )
    return f"Error: {METRICS[metric]}.\n\n{text.table(header, rows)}\n\n{note}"


def _cell(found: Reach | None, points: Sequence[Point], metric: str) -> str:
    if found:
        return f"{'<= ' if found.at_most else ''}{_milliseconds(found.seconds)} ({found.setting:.1e})"
    stable = [p for p in points if p.stable and metric in p.errors]
    if not stable:
        return "-"
    stalled = len(stable) > 1 and stable[-1].errors[metric] > 0.8 * stable[-2].errors[metric]
    return "-" if stalled else f"> {_milliseconds(stable[-1].time)}"


def _milliseconds(seconds: float) -> str:
    return f"{text.number(1e3 * seconds)} ms"


def front(result: WorkPrecisionSet, metric: str) -> str:
    """The Pareto front as a sentence: the runs than which no other run is both faster and more accurate."""
    points = sorted((p for p in result.points if p.stable and metric in p.errors), key=lambda p: p.time)
    best = math.inf
    stretches: list[list[Any]] = []
    for point in points:
        error = point.errors[metric]
        if error >= min(best, 1.0):
            continue
        best = error
        if stretches and stretches[-1][0] == point.label:
            stretches[-1][2] = error
        else:
            stretches.append([point.label, error, error])
    if not stretches:
        return "Pareto front: no run has an error below 1."
    words = [f"{name} ({a:.1e}{f' to {b:.1e}' if a != b else ''})" for name, a, b in stretches]
    return f"Pareto front, from fast to accurate: {', '.join(words)}."


def save(files: Files, results: Sequence[WorkPrecisionSet]) -> None:
    """Write precision.json, with every run."""
    data = {
        "environment": environment(),
        "states": STATES,
        "problems": [
            {
                "name": result.name,
                "reference": result.source,
                "uncertainty": result.uncertainty,
                "skipped": result.skipped,
                "points": [{**dataclasses.asdict(point), **point.statistics} for point in result.points],
            }
            for result in results
        ],
    }
    with files.writing("precision.json") as path:
        path.write_text(json.dumps(data, indent=1) + "\n")
