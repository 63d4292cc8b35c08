"""Sweeps on one problem: every method with ever smaller steps, and every rival with ever tighter tolerances."""

from __future__ import annotations

import dataclasses
import math
import statistics
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from eig3.methods import METHODS, Method
from eig3.problem import Problem
from eig3.result.solution import Solution
from eig3.run.fixed_run import divide
from eig3.stability import limit

from . import text
from .modes import MODES
from .problem_set import BenchmarkProblem, about, describe
from .reference import METRICS, Judge, reference
from .rivals import RIVALS
from .rivals.rival import Answer, Rival
from .timing import Storage, interleave, kernel_run
from .tolerances import TOLERANCES
from .typed import check_known, check_positive, checked

STATES = 2000  # stored in every run of the library, and compared with the reference
RIVAL_STATES = 401  # the same for a rival: with 2000, the dense output would take a fifth of heyoka's time
REPEATS = 15
ENOUGH = 0.2  # s; a run that has taken so long in three rounds is not repeated
LONGEST = 0.1  # steps are halved until a run takes this long, s
_FACTORS = (1.05, 0.95, 0.7)  # the first steps, as fractions of the stability limit; then it is halved
_BETWEEN = (2 ** (2 / 3), 2 ** (1 / 3))  # steps to try between an unstable step and its half, which is stable
_HOPELESS = 20  # a method is given up when its next run would take this multiple of `longest`
_ENOUGH = 0.3  # of the smallest target; no smaller step is tried
_SHORT = 1e-3  # s
_SLOW = 1.0  # s; a run with tolerances may last so long: a solver in Python takes long with its loosest tolerance too
_DIGITS = 5  # of times and errors in JSON
_USELESS = 10.0  # only an unstable run has such a relative error
_MODE = " --mode "  # the option of `eig3 bench precision`
CERTAIN = 3  # an error below this multiple of the uncertainty of the truth is not known


@dataclass
class Point:
    """One run: a method with a step, or a rival with a tolerance.

    `setting` is the step or the tolerance. `mode` is one of `MODES`; a rival has none, and its mode is "".
    """

    method: str
    label: str
    mode: str
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
        """Median and minimum of the seconds, and ns/step of a method; empty if the run was not timed."""
        found = {"median": self.time, "minimum": min(self.seconds)} if self.seconds else {}
        if found and self.n_steps:
            found["ns_per_step"] = 1e9 * self.time / self.n_steps
        return found


@dataclass(frozen=True)
class WorkPrecisionSet:
    """All points on one problem.

    Attributes
    ----------
    name, title, description : str
        The description is for a reader who does not know the problem.
    metric : str
        The metric of error that is shown first.
    targets : tuple of float
        The errors to reach.
    tolerances : bool
        Whether the library was measured with tolerances too.
    source : str
        Where the true motion is from.
    uncertainty : float
        Of the true motion, relative to max |u|.
    points : list of Point
    skipped : list of str
        What was not measured, and why.
    command : str
        The command that measures these points alone.
    """

    name: str
    title: str
    description: str
    metric: str
    targets: tuple[float, ...]
    tolerances: bool
    source: str
    uncertainty: float
    points: list[Point]
    skipped: list[str]
    command: str = ""

    @property
    def is_solved(self) -> bool:
        """Whether a method or a rival has a stable run."""
        return any(point.stable for point in self.points)

    @property
    def metrics(self) -> list[str]:
        """The metrics of error that were measured, the problem's own first."""
        known = {metric for point in self.points for metric in point.errors}
        return sorted(known, key=lambda metric: (metric != self.metric, list(METRICS).index(metric)))

    def of(self, method: str) -> list[Point]:
        return [point for point in self.points if point.method == method]

    @property
    def methods(self) -> dict[str, str]:
        """The label of each method and rival."""
        return {point.method: point.label for point in self.points}

    @property
    def unstable(self) -> str:
        """The methods with unstable or useless runs, each with its settings, in words; empty if there are none."""
        settings: dict[str, list[str]] = {}
        for point in self.points:
            if not point.stable:
                settings.setdefault(point.label, []).append(f"{point.setting:.2g}")
        return "; ".join(f"{label} at {', '.join(found)}" for label, found in settings.items())

    @property
    def modes(self) -> list[str]:
        """The modes that were measured, in the order of `MODES`."""
        return [mode for mode in MODES if any(point.mode == mode for point in self.points)]

    def in_mode(self, mode: str) -> WorkPrecisionSet:
        """Return the points of one mode and of the rivals, with the command for this mode."""
        points = [point for point in self.points if point.mode in (mode, "")]
        command = self.command
        if self.is_of_the_library:
            command = f"{command.partition(_MODE)[0]}{_MODE}{mode}"
        return dataclasses.replace(self, points=points, command=command)

    @property
    def is_of_the_library(self) -> bool:
        """Whether it is one of the library's problems, and not a user's own."""
        return self.command.startswith("eig3 bench precision")

    def is_claimed(self, metric: str, target: float) -> bool:
        """Whether the truth is certain enough to say that a run has such an error."""
        return metric != "trajectory" or target >= CERTAIN * self.uncertainty

    def as_json(self) -> dict[str, Any]:
        """Everything as JSON, with the statistics of each point and short numbers; one that is not finite is null."""
        uncertainty = self.uncertainty if math.isfinite(self.uncertainty) else None
        plain = {"uncertainty": uncertainty, "points": [_as_json(point) for point in self.points]}
        return {**vars(self), **plain}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> WorkPrecisionSet:
        """What `as_json` gave.

        Raises
        ------
        TypeError, ValueError, LookupError
            If it is damaged.
        """
        points = [_from_json(point) for point in data["points"]]
        uncertainty = math.inf if data["uncertainty"] is None else data["uncertainty"]
        fields = {**data, "targets": tuple(data["targets"]), "uncertainty": uncertainty, "points": points}
        found = checked(cls(**fields))
        check_known([found.metric], METRICS)
        if not (found.targets and all(0 < target < 1 for target in found.targets) and found.uncertainty >= 0):
            raise ValueError("targets are between 0 and 1, and an uncertainty is not negative")
        check_positive(found.targets)
        return found


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def _as_json(point: Point) -> dict[str, Any]:
    errors = {metric: _short(error) if math.isfinite(error) else None for metric, error in point.errors.items()}
    numbers = {name: _short(value) for name, value in point.statistics.items()}
    return {**vars(point), **numbers, "errors": errors, "seconds": [_short(value) for value in point.seconds]}


def _from_json(data: Mapping[str, Any]) -> Point:
    known = {field.name: data[field.name] for field in dataclasses.fields(Point)}
    errors = {metric: math.inf if e is None else e for metric, e in data["errors"].items()}
    point = checked(Point(**{**known, "errors": errors}))
    check_known([point.mode], ("", *MODES))
    check_known(point.errors, METRICS)
    counts = [count for count in (point.n_steps, point.evaluations) if count is not None]
    check_positive([point.setting, *point.seconds, *(count for count in counts if point.stable or count != 0)])
    if not all(error >= 0 for error in point.errors.values()) or (point.stable and not (point.seconds and errors)):
        raise ValueError("errors are not negative, and a stable run has times and errors")
    return point


#: A point, and a function that repeats its run and returns the seconds.
Repeatable = tuple[Point, Callable[[], float]]


def measure(
    name: str,
    chosen: BenchmarkProblem,
    methods: Sequence[str],
    repeats: int,
    longest: float,
    *,
    rivals: bool,
    modes: Sequence[str],
    command: str = "",
) -> WorkPrecisionSet:
    """Find the points of every method, in each of these modes, and of every rival; time all in interleaved runs."""
    problem = chosen.build()
    text.status(f"{name}: reference")
    truth = reference(problem, chosen.omega)
    judge = Judge(problem, truth)
    storage = Storage.for_steps(problem, 2 * STATES)  # a run stores fewer than 2 * STATES states
    found: list[Repeatable] = []
    for mode in modes:
        for key, method in records(problem, chosen, methods):
            found += sweep(problem, chosen, judge, key, method, longest, storage, mode)
        for key, own in TOLERANCES.items() if chosen.tolerances else ():
            method_name = key.partition(" ")[0]
            if method_name in methods and not (METHODS[method_name]().ignores_velocity and problem.uses_velocity):
                found += sweep_tolerances(problem, chosen.targets, judge, key, own, max(longest, _SLOW), mode)
    skipped = []
    for key, rival in RIVALS.items() if rivals else ():
        if why := rival.refusal(problem):
            skipped.append(f"{rival.label} ({why})")
        else:
            found += sweep_tolerances(problem, chosen.targets, judge, key, rival, max(longest, _SLOW))
    points = timed_points(found, repeats, name, ENOUGH)
    return WorkPrecisionSet(
        name,
        chosen.title,
        describe(problem, about(chosen.build)),
        chosen.metric,
        chosen.targets,
        chosen.tolerances,
        truth.source,
        truth.uncertainty,
        points,
        skipped,
        command,
    )


def timed_points(found: Sequence[Repeatable], repeats: int, name: str, enough: float) -> list[Point]:
    """The points, with the seconds of interleaved runs: each ends after `enough` seconds, as `interleave` says."""
    timed = {str(i): again for i, (point, again) in enumerate(found) if point.stable}
    for i, seconds in interleave(timed, repeats, name, enough).items():
        found[int(i)][0].seconds = seconds
    return [point for point, _ in found]


def records(problem: Problem, chosen: BenchmarkProblem, methods: Sequence[str]) -> Iterator[tuple[str, Method]]:
    """The records of these methods that can solve the problem; CD comes in each form that the problem set names.

    None for a problem with events: a `Stepper`, with which they are timed, does not follow them.
    """
    for name in () if problem.events else methods:
        method = METHODS[name]()
        if name == "cd" and chosen.cd:
            yield from chosen.cd
        elif not (method.ignores_velocity and problem.uses_velocity):
            yield name, method


def sweep(
    problem: Problem,
    chosen: BenchmarkProblem,
    judge: Judge,
    key: str,
    method: Method,
    longest: float,
    storage: Storage,
    mode: str,
) -> Iterator[Repeatable]:
    """Points of one method, from a step just above its stability limit to ever smaller steps."""
    bound = (limit(method) or 2.0) / chosen.omega
    label = method.label + {"cd newton": ", Newton", "cd fixed-point": ", fixed point"}.get(key, "")

    timed = MODES[mode]

    def at(step: float) -> tuple[Repeatable, Solution]:
        n_steps, h = divide(*problem.t_span, step)
        every = max(1, n_steps // STATES)
        text.status(f"{problem.name}, {label}, h = {h:.3g}")
        run = timed.timed(problem, {"h": h, "method": method, "save_every": every})
        _, solution = run()
        errors = judge.of_run(solution) if solution.success else {}
        point = Point(key, label, mode, h, n_steps, solution.n_rhs, is_stable(solution.success, errors), errors)
        if timed.is_whole:
            return (point, warm(lambda: run()[0])), solution
        start = problem.stepper(h=h, method=method, inline=timed.is_inline)
        return (point, warm(kernel_run(start, n_steps, every=every, storage=storage))), solution

    was_stable, pace, taken = True, 0.0, 0
    for factor in (*_FACTORS, *(0.5**k for k in range(1, 40))):
        n_steps, _ = divide(*problem.t_span, factor * bound)
        if n_steps == taken:  # a short span: two values of h have the same number of steps
            continue
        if pace * n_steps > _HOPELESS * longest:
            break
        found, solution = at(factor * bound)
        if found[0].stable and not was_stable and factor <= 0.5:
            yield from (at(factor * longer * bound)[0] for longer in _BETWEEN)
        yield found
        was_stable, taken = found[0].stable, n_steps
        pace = solution.kernel_seconds / max(1, solution.n_steps)
        if found[0].stable and (solution.kernel_seconds > longest or is_enough(found[0], chosen.targets)):
            break


def sweep_tolerances(
    problem: Problem,
    targets: Sequence[float],
    judge: Judge,
    key: str,
    rival: Rival,
    longest: float,
    mode: str = "",
    states: int = RIVAL_STATES,
) -> Iterator[Repeatable]:
    """Points of a rival or of a method with tolerances, from its loosest to its tightest tolerance.

    Only a method has a `mode`.
    """
    options = {"mode": MODES[mode]} if mode else {}
    times = np.linspace(*problem.t_span, states)
    at = rival.prepare(problem, times, **options)
    settings = rival.settings(times)
    at(settings[0])()  # compiles: this must not count as time of a run
    for setting in settings:
        text.status(f"{problem.name}, {rival.label}, setting {setting:g}")
        solve = at(setting)
        answer = solve()
        errors = judge.of_answer(times, answer) if answer.success else {}
        stable = is_stable(answer.success, errors)
        point = Point(key, rival.label, mode, setting, None, answer.evaluations, stable, errors)
        yield point, warm(partial(_seconds, solve))
        if answer.seconds > longest or is_enough(point, targets):
            break


def _seconds(solve: Callable[[], Answer]) -> float:
    return solve().seconds


def warm(run: Callable[[], float]) -> Callable[[], float]:
    """The same run, repeated if it is short: at first its code and data are not in the cache."""

    def again() -> float:
        seconds = run()
        return seconds if seconds > _SHORT else run()

    return again


def is_stable(success: bool, errors: Mapping[str, float]) -> bool:
    """Whether a run that reached the end has a motion that a stable run can have."""
    return success and all(error < _USELESS for metric, error in errors.items() if metric != "energy")


def is_enough(point: Point, targets: Sequence[float]) -> bool:
    """Whether no run has to be more accurate than this one."""
    return point.stable and max(point.errors.values()) < _ENOUGH * min(targets)
