"""`eig3 bench precision`: what each accuracy costs in time, on every problem, for every method and rival."""

from __future__ import annotations

import dataclasses
import json
import math
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from eig3 import problems
from eig3.integration import divide
from eig3.methods import METHODS, CentralDifference, Method
from eig3.problem import Problem
from eig3.solution import Solution, Status
from eig3.stability import limit

from . import text
from .environment import environment, in_words
from .reference import Reference, reference
from .rivals import RIVALS, Answer
from .speed import choose
from .timing import Storage, interleave

TARGETS = (1e-2, 1e-3, 1e-4, 1e-6, 1e-8)
STATES = 2000  # kept of every run, ours and the rivals', and compared with the reference
_FACTORS = (1.05, 0.95, 0.7)  # of the stability limit; then halved
LONGEST = 0.25  # s: steps are halved until a run takes this
_ENOUGH = 3e-9  # an error below every target: no smaller step is tried
_USELESS = 10.0  # a relative error that only an unstable run has
METRICS = {
    "trajectory": "max |u - u(t)| / max |u|",
    "energy": "max |E - E0| / |E0|",
    "continuum": "max |u - u(x, t)| / max |u|, against the continuous bar: errors in space and in time",
}


@dataclass(frozen=True)
class Case:
    """A problem in the set: its highest angular frequency, the methods on it, and the metric that matters first."""

    build: Callable[[], Problem]
    omega: float
    title: str
    metric: str = "trajectory"
    cd: tuple[tuple[str, Method], ...] = ()


_SOLVED = (
    ("cd newton", CentralDifference()),
    ("cd fixed-point", CentralDifference(solver="fixed-point")),
)
_BAR_OMEGA = 2 * 5000.0 * 1001
CASES = {
    "single_dof": Case(problems.single_dof, 4.0, "single degree of freedom, 637 periods"),
    "hardening_spring": Case(problems.hardening_spring, 83.0, "hardening spring, 100 periods"),
    "softening_spring": Case(problems.softening_spring, 10.0, "softening spring, 123 periods"),
    "spring_pendulum": Case(problems.spring_pendulum, 9.9, "spring pendulum, 100 s", cd=_SOLVED),
    "elastic_bar": Case(problems.elastic_bar, _BAR_OMEGA, "elastic bar, 1000 masses, ten passes", "continuum"),
    "damped_bar": Case(
        problems.damped_bar, _BAR_OMEGA, "damped bar, 1000 masses, ten passes", "continuum", cd=_SOLVED[1:]
    ),
    "hardening_chain": Case(problems.hardening_chain, 260.0, "chain of 200 masses, hardening, struck"),
}


@dataclass
class Point:
    """One run: a method at a step, or a rival at a tolerance."""

    method: str
    label: str
    setting: float
    n_steps: int | None
    evaluations: int | None
    stable: bool
    errors: dict[str, float]
    seconds: list[float] = field(default_factory=list)

    @property
    def time(self) -> float:
        return statistics.median(self.seconds)

    @property
    def statistics(self) -> dict[str, float]:
        """Of the seconds; empty for a run that was not timed, and of a rival without ns/step."""
        found = {"median": self.time, "minimum": min(self.seconds)} if self.seconds else {}
        if found and self.n_steps:
            found["ns_per_step"] = 1e9 * self.time / self.n_steps
        return found


@dataclass(frozen=True)
class Result:
    """One problem, measured."""

    name: str
    case: Case
    source: str
    uncertainty: float
    points: list[Point]
    skipped: list[str]

    @property
    def metrics(self) -> list[str]:
        known = {metric for point in self.points for metric in point.errors}
        return sorted(known, key=lambda metric: (metric != self.case.metric, list(METRICS).index(metric)))

    def of(self, method: str) -> list[Point]:
        return [point for point in self.points if point.method == method]

    @property
    def methods(self) -> dict[str, str]:
        return {point.method: point.label for point in self.points}


def run(
    *,
    only: Sequence[str] | None = None,
    methods: Sequence[str] | None = None,
    repeats: int = 7,
    longest: float = LONGEST,
    rivals: bool = True,
    out: Path | None = None,
    write: Callable[[str], None] = print,
) -> list[Result]:
    """Measure and print each problem when it is done; keep everything in `out` as soon as it is there."""
    names, methods = choose(only, list(CASES), "--problem"), choose(methods, list(METHODS))
    pages, results = [heading(repeats, longest)], []
    write(pages[0])
    for name in names:
        results.append(measure(name, methods, repeats, longest, rivals))
        pages.append(render(results[-1]))
        write("\n" + pages[-1])
        if out is not None:
            save(out, results)
            (out / "precision.md").write_text("\n\n".join(pages) + "\n")
    if out is not None:
        write(f"\nWritten to {out}: precision.json, precision.md{draw(results, out)}")
    return results


def heading(repeats: int, longest: float) -> str:
    return (
        f"Machine: {in_words()}\n\n"
        f"Times: medians of {repeats} interleaved runs, compiling left out, {STATES} states kept of every run; the "
        f"methods with the right-hand side through a pointer. Steps are halved until a run takes {longest:g} s."
    )


def measure(name: str, methods: Sequence[str], repeats: int, longest: float, rivals: bool) -> Result:
    """Sweep the steps of every method and the tolerances of every rival, then time all of them interleaved."""
    case = CASES[name]
    problem = case.build()
    text.status(f"{name}: reference")
    truth = reference(problem, case.omega)
    judge = Judge(problem, truth)
    # less than twice STATES: a run keeps every so many-th state
    storage = Storage(np.size(problem.u0) if np.ndim(problem.u0) else None, 2 * STATES)
    points, runs, skipped = [], {}, []
    for key, method in records(problem, case, methods):
        for point, again in sweep(problem, case, judge, key, method, longest, storage):
            points.append(point)
            runs[len(points) - 1] = again
    for key, rival in RIVALS.items() if rivals else ():
        if not rival.is_installed:
            skipped.append(f"{rival.label} (not installed)")
        elif np.size(problem.u0) > rival.most_degrees:
            skipped.append(f"{rival.label} (more than {rival.most_degrees} degrees of freedom)")
        else:
            for point, again in sweep_rival(problem, judge, key, longest):
                points.append(point)
                runs[len(points) - 1] = again
    timed = {str(i): again for i, again in runs.items() if points[i].stable}
    for i, seconds in interleave(timed, repeats, lambda what: text.status(f"{name}, {what}")).items():
        points[int(i)].seconds = seconds
    text.status("")
    return Result(name, case, truth.source, truth.uncertainty, points, skipped)


def records(problem: Problem, case: Case, methods: Sequence[str]) -> list[tuple[str, Method]]:
    """The methods as records; CD, where it has to solve, by each of its solvers that is of use."""
    found: list[tuple[str, Method]] = []
    for name in methods:
        found += case.cd if name == "cd" and case.cd else [(name, problem.method(name))]
    return found


class Judge:
    """The errors of a run in every metric that the problem has."""

    def __init__(self, problem: Problem, truth: Reference) -> None:
        self.problem = problem
        self.truths: dict[str, Callable[[np.ndarray], np.ndarray]] = {"trajectory": truth.u}
        if problem.continuum is not None:
            continuum = problem.continuum
            self.truths["continuum"] = lambda t: continuum(t)[0]

    def errors(self, t: np.ndarray, u: np.ndarray) -> dict[str, float]:
        found = {}
        for metric, truth in self.truths.items():
            true = truth(t)
            with np.errstate(over="ignore", invalid="ignore"):
                found[metric] = float(np.abs(u - true).max() / np.abs(true).max())
        return found

    def of_run(self, solution: Solution) -> dict[str, float]:
        errors = self.errors(solution.t, solution.u)
        if "energy" in solution.drift:
            errors["energy"] = solution.drift["energy"] / abs(self.problem.energy_of(self.problem.u0, self.problem.v0))
        return errors

    def of_answer(self, times: np.ndarray, answer: Answer) -> dict[str, float]:
        errors = self.errors(times, answer.u)
        if self.problem.energy is not None:
            energies = np.array([self.problem.energy_of(u, v) for u, v in zip(answer.u, answer.v, strict=True)])
            errors["energy"] = float(np.abs(energies / energies[0] - 1).max())
        return errors


def sweep(
    problem: Problem, case: Case, judge: Judge, key: str, method: Method, longest: float, storage: Storage
) -> list[tuple[Point, Callable[[], float]]]:
    """Points from just above the stability limit down, each with a function that runs it again for its seconds."""
    bound = (limit(method) or 2.0) / case.omega
    label = METHODS[method.name].label + {"cd newton": ", Newton", "cd fixed-point": ", fixed point"}.get(key, "")
    found = []
    for factor in (*_FACTORS, *(0.5**k for k in range(1, 40))):
        n_steps, h = divide(problem.t_span[1] - problem.t_span[0], factor * bound)
        every = max(1, n_steps // STATES)
        text.status(f"{problem.name}, {label}, h = {h:.3g}")
        solution = problem.integrate(h=h, method=method, save_every=every)
        if solution.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        errors = judge.of_run(solution) if solution.success else {}
        stable = solution.success and max(errors.values()) < _USELESS
        point = Point(key, label, h, n_steps, solution.n_rhs, stable, errors)
        found.append((point, timed_run(problem, h, method, n_steps, every, storage)))
        if solution.kernel_seconds > longest or (stable and max(errors.values()) < _ENOUGH):
            break
    return found


def timed_run(
    problem: Problem, h: float, method: Method, n_steps: int, every: int, storage: Storage
) -> Callable[[], float]:
    start = problem.stepper(h=h, method=method)

    def again() -> float:
        stepper = start.fork()
        stepper.advance(n_steps, every, storage.u, storage.v)
        return stepper.seconds

    return again


def sweep_rival(problem: Problem, judge: Judge, key: str, longest: float) -> list[tuple[Point, Callable[[], float]]]:
    rival = RIVALS[key]
    times = np.linspace(*problem.t_span, STATES + 1)
    at = rival.prepare(problem, times)
    at(rival.tolerances[0])()  # compiles, and must not count as the time of a run
    found: list[tuple[Point, Callable[[], float]]] = []
    for tolerance in rival.tolerances:
        text.status(f"{problem.name}, {rival.label}, tolerance {tolerance:g}")
        solve = at(tolerance)
        answer = solve()
        errors = judge.of_answer(times, answer) if answer.success else {}
        stable = answer.success and max(errors.values()) < _USELESS
        point = Point(key, rival.label, tolerance, None, answer.evaluations, stable, errors)
        found.append((point, partial(_seconds, solve)))
        # a run of Python's own is slow to begin with: its longest is a second
        if answer.seconds > max(longest, 1.0) or (stable and max(errors.values()) < _ENOUGH):
            break
    return found


def _seconds(solve: Callable[[], Answer]) -> float:
    return solve().seconds


@dataclass(frozen=True)
class Reach:
    """What a method needs to come below a target: seconds and setting; at most those seconds if it starts below it."""

    seconds: float
    setting: float
    at_most: bool


def reach(points: Sequence[Point], metric: str, target: float) -> Reach | None:
    """Interpolate, in logarithms, where the error first falls below `target`; None if it does not."""
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


def render(result: Result) -> str:
    parts = [f"## {result.case.title} ({result.name})"]
    parts.append(f"Truth: {result.source}, known to {result.uncertainty:.1g} of max |u|.")
    for metric in result.metrics:
        parts += [render_reach(result, metric), front(result, metric)]
    unstable = [f"{p.label} at {p.setting:.3g}" for p in result.points if not p.stable]
    if unstable:
        parts.append(f"Unstable or useless, and kept in the pictures: {', '.join(unstable)}.")
    if result.skipped:
        parts.append(f"Left out: {', '.join(result.skipped)}.")
    return "\n\n".join(parts)


def render_reach(result: Result, metric: str) -> str:
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
        "Step (s), or a rival's tolerance, in brackets; <= where the longest stable step is already that accurate; "
        "> where the shortest step tried does not reach it; - where the error no longer falls. The fastest in bold."
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


def front(result: Result, metric: str) -> str:
    """The Pareto front in words: from the fastest run to the most accurate, none is beaten in both."""
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


def save(out: Path, results: Sequence[Result]) -> None:
    """precision.json, with every run."""
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
    (out / "precision.json").write_text(json.dumps(data, indent=1) + "\n")


def draw(results: Sequence[Result], out: Path) -> str:
    """A picture for each problem where matplotlib is installed; say what came of it."""
    try:
        from .pictures import precision
    except ImportError:
        return '; no pictures: pip install "eig3[plot]" draws them'
    for result in results:
        precision(result, out / f"precision_{result.name}.png")
    return f" and {len(results)} picture{'s' * (len(results) > 1)}"
