"""Measure the error of every method and rival against its time on a set of problems, and the time to an accuracy."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from itertools import groupby
from pathlib import Path

from eig3.command_line import Files, add_methods, add_out, method_name
from eig3.methods import LIBRARY

from . import pictures, text
from .choices import add_accuracies, add_longest, add_problems, add_repeats, choose
from .environment import environment, in_words
from .modes import MODES
from .problem_set import PROBLEM_SET, VARIABLE_SPEED
from .reach import Contest, Reach, contests, front, reach
from .reference import METRICS
from .rivals import RIVALS
from .sweep import CERTAIN, LONGEST, REPEATS, RIVAL_STATES, STATES, Point, WorkPrecisionSet, measure
from .tolerances import TOLERANCES

SUMMARY = "what each accuracy costs in time"


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problems(parser)
    add_methods(parser)
    parser.add_argument(
        "--methods", dest="methods", nargs="+", type=method_name, metavar="NAME", help="only these methods"
    )
    add_repeats(parser, REPEATS)
    add_longest(parser, LONGEST)
    words = "; ".join(f"{name}: {mode.words}" for name, mode in MODES.items())
    parser.add_argument("--mode", choices=MODES, default=next(iter(MODES)), help=f"what is timed ({words})")
    parser.add_argument(
        "--no-rivals", dest="rivals", action="store_false", help="leave out the solvers of other packages"
    )
    add_accuracies(parser, "the accuracies of each problem")
    add_out(parser, "folder for precision.json, precision.md and pictures")


def benchmark(
    *,
    only: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    repeats: int = REPEATS,
    longest: float = LONGEST,
    rivals: bool = True,
    mode: str = next(iter(MODES)),
    accuracies: Sequence[float] | None = None,
    out: Path | None = None,
    write: Callable[[str], None] = print,
) -> None:
    """Measure, print each problem as soon as it is complete, and save after each problem in `out`."""
    known = PROBLEM_SET | VARIABLE_SPEED
    names, methods = choose(only, list(known), "--problem"), choose(methods, LIBRARY)
    files = None if out is None else Files(out, "eig3 bench")
    pages: list[str] = []
    results: list[WorkPrecisionSet] = []

    def add(page: str) -> None:
        pages.append(page)
        write(page + "\n")
        if files:
            save(files, results)
            with files.writing("precision.md") as path:
                path.write_text("\n\n".join(pages) + "\n", encoding="utf-8")

    modes = (mode,)
    add(f"Machine: {in_words()}\n\n{how_measured(repeats, longest, modes)}")
    for name in names:
        chosen = known[name] if accuracies is None else replace(known[name], targets=tuple(accuracies))
        results.append(measure(name, chosen, methods, repeats, longest, rivals=rivals, modes=modes))
        add(render(results[-1]))
    add(render_summary(results))
    if files:
        figures = {f"precision_{result.name}.png": partial(pictures.work_precision, result) for result in results}
        files.finish(write, pictures.draw(figures, files, dpi=110))


def how_measured(repeats: int, longest: float, modes: Sequence[str]) -> str:
    words = "; or ".join(MODES[mode].words for mode in modes)
    return (
        f"Times: medians of {repeats} interleaved runs, fewer if they take long, without compilation. Timed for a "
        f"method: {words}. It keeps {STATES} states or more, or all if there are fewer. Timed for a rival: the whole "
        f"call. Rivals and methods with tolerances compute {RIVAL_STATES} states by their dense output. Steps are "
        f"halved until a run takes {longest:g} s."
    )


def render(result: WorkPrecisionSet) -> str:
    """The page of one problem: for each metric a table of times to reach accuracies, and the Pareto front."""
    parts = [f"## {result.title} ({result.name})", result.description]
    parts.append(f"Truth: {result.source}, known to {result.uncertainty:.1g} of max |u|.")
    if not result.is_claimed("trajectory", min(result.targets)):
        parts.append(
            f"No method is therefore ranked for errors of the trajectory below {CERTAIN * result.uncertainty:.1g}."
        )
    for metric in result.metrics:
        parts += [render_reach(result, metric), render_contests(result, metric), render_front(result, metric)]
        parts += [render_tolerances(result, metric)] * result.tolerances
    if result.unstable:
        parts.append(f"Unstable or too inaccurate, but in the pictures: {result.unstable}.")
    if result.skipped:
        parts.append(f"Left out: {'; '.join(result.skipped)}.")
    return "\n\n".join(parts)


def render_reach(result: WorkPrecisionSet, metric: str) -> str:
    """The table of times to reach each target; the fastest of each target is bold."""
    targets = result.targets
    header = [f"time to reach ({metric})", *(f"{target:g}" for target in targets)]
    reached = {m: [reach(result, m, metric, target) for target in targets] for m in result.methods}
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
        "In brackets the step (s) or the tolerance. <=: the longest stable step is already that accurate. "
        ">: the shortest step tried is not accurate enough. -: the error no longer falls, or every step tried is "
        "unstable. The fastest is bold."
    )
    return f"Error: {METRICS[metric]}.\n\n{text.table(header, rows)}\n\n{note}"


def render_contests(result: WorkPrecisionSet, metric: str) -> str:
    """The fastest method and the fastest rival for each target, and a sentence for each target that a rival wins."""
    held = [contest for contest in contests(result, metric) if contest.rival]
    if not held:
        return "No rival was measured, or none reaches one of these errors."
    header = [f"fastest to reach ({metric})", *(f"{contest.target:g}" for contest in held)]
    rows = [
        ["of eig3", *(_fastest(contest.ours) for contest in held)],
        ["of the rivals", *(_fastest(contest.rival) for contest in held)],
        ["ratio of the times", *(_ratio(contest) for contest in held)],
    ]
    lost = [
        f"At {contest.target:g}, a rival is ahead: {_fastest(contest.rival)}, against {_fastest(contest.ours)}."
        for contest in held
        if contest.is_lost
    ]
    return f"{text.table(header, rows)}\n\n{' '.join(lost) or 'No rival is ahead at any of these errors.'}"


def render_tolerances(result: WorkPrecisionSet, metric: str) -> str:
    """Return the table of ratios: fastest method with tolerances to fastest rival of a package, or fixed step."""
    others: dict[str, list[str]] = {}
    for method, rival in RIVALS.items():
        others.setdefault(rival.label.partition(" ")[0], []).append(method)
    others["fixed steps"] = [method for method in result.methods if method not in RIVALS and method not in TOLERANCES]
    held = contests(result, metric)
    rows = []
    for name, chosen in others.items():
        pairs = ((contest.of(TOLERANCES.__contains__), contest.of(chosen.__contains__)) for contest in held)
        rows.append([name, *(text.number(one.seconds / two.seconds, 2) if one and two else "-" for one, two in pairs)])
    header = [f"fastest with tolerances ({metric}) / fastest of", *(f"{target:g}" for target in result.targets)]
    return text.table(header, rows)


def _fastest(found: Reach | None) -> str:
    return f"{found.label} {_milliseconds(found.seconds)}" if found else "none"


def _ratio(contest: Contest) -> str:
    return "-" if contest.ratio is None or math.isinf(contest.ratio) else text.ratio(contest.ratio)


def render_summary(results: Sequence[WorkPrecisionSet]) -> str:
    """The ratio of the times of the fastest method and the fastest rival, for every problem and target."""
    held = {result.name: contests(result, "trajectory") for result in results}
    cells = [contest for row in held.values() for contest in row if contest.rival]
    if not cells:
        return "No rival was measured."
    lost = sum(contest.is_lost for contest in cells)
    tables = []
    for targets, group in groupby(results, key=lambda result: result.targets):
        header = ["fastest of eig3 / fastest rival", *(f"{target:g}" for target in targets)]
        tables.append(text.table(header, [[result.name, *map(_ratio, held[result.name])] for result in group]))
    return "\n\n".join(
        [
            "## Beside the rivals",
            "Time to reach an error of the trajectory.",
            *tables,
            f"A method of eig3 is the fastest in {len(cells) - lost} of {len(cells)} cells.",
        ]
    )


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


def render_front(result: WorkPrecisionSet, metric: str) -> str:
    """The Pareto front as a sentence."""
    stretches = [
        (label, [point.errors[metric] for point in points])
        for label, points in groupby(front(result, metric), key=lambda point: point.label)
    ]
    if not stretches:
        return "Pareto front: no run has an error below 0.1."
    words = [f"{label} ({e[0]:.1e}{f' to {e[-1]:.1e}' if e[1:] else ''})" for label, e in stretches]
    return f"Pareto front, from fast to accurate: {', '.join(words)}."


def save(files: Files, results: Sequence[WorkPrecisionSet]) -> None:
    """Write precision.json, with every run."""
    data = {"environment": environment(), "states": STATES, "problems": [result.as_json() for result in results]}
    with files.writing("precision.json") as path:
        path.write_text(json.dumps(data, indent=1) + "\n")
