"""Measure what the first choice of eig3.plan costs against the best of a sweep over all methods and steps."""

from __future__ import annotations

import argparse
import dataclasses
import statistics
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import eig3
from eig3.methods import LIBRARY, Method
from eig3.planning.planner import EXTRAPOLATED, Plan, Prediction
from eig3.problem import Problem
from eig3.run.fixed_run import divide

from . import text
from .choices import add_longest, add_problems, add_repeats, choose
from .environment import in_words
from .problem_set import PROBLEM_SET, BenchmarkProblem
from .reach import reach
from .reference import Judge, reference
from .sweep import LONGEST, STATES, WorkPrecisionSet, measure, records
from .timing import Storage, kernel_run, medians
from .typed import checked

SUMMARY = "what the first choice of eig3.plan costs against the best of a sweep"
ACCURACIES = (1e-2, 1e-4, 1e-6, 1e-8)
PLAN_METRICS = ("trajectory", "energy")
MOST = 1.3  # largest ratio of the time of the first choice to the time of the best
ERROR_RANGE = (0.1, 1.0)  # of a prediction, relative to the requested accuracy
TIME_FACTOR = 1.5  # of a prediction
_CONTENDERS = 3  # the fastest methods of the sweep, which are timed again beside the first choice
_TRIALS = 30  # steps tried from the interpolated one down
_LONGEST_PREDICTED = 3.0  # a prediction with a longer time is not checked, s
HEADER = [
    "problem",
    "error of",
    "accuracy",
    "first choice",
    "ms",
    "achieved / asked",
    "best of the sweep",
    "ms",
    "ratio",
    "predictions hit",
    "pilot s",
]


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problems(parser)
    add_repeats(parser, 9)
    add_longest(parser, LONGEST, " of the sweep")


@dataclass(frozen=True)
class Checked:
    """A prediction after its run: its error over the requested accuracy, and its time over the predicted time."""

    prediction: Prediction
    error: float
    time: float

    @property
    def is_hit(self) -> bool:
        """Whether error and time are in their ranges. A smaller error is a hit if stability limits the step."""
        reaches = self.error <= ERROR_RANGE[1] and (self.error >= ERROR_RANGE[0] or bool(self.prediction.note))
        return reaches and 1 / TIME_FACTOR <= self.time <= TIME_FACTOR


@dataclass(frozen=True)
class Outcome:
    """A case of the table: its name, its row, and what is wrong with the first choice; empty if nothing is."""

    name: str
    row: list[str]
    is_good: bool
    reaches: bool
    miss: str

    def __post_init__(self) -> None:
        if len(checked(self).row) != len(HEADER):
            raise ValueError(f"row must have {len(HEADER)} cells")

    @classmethod
    def of(cls, plan: Plan, followed: Sequence[Checked], seconds: float, best: str, best_seconds: float) -> Outcome:
        """Judge the first choice of a plan, which took these seconds, beside the best method of the sweep."""
        first, ratio = followed[0] if followed else None, seconds / best_seconds
        if first is None:
            miss = f"no method is predicted to reach the accuracy, but {best} does"
        elif first.error > 1:
            miss = f"{plan.best.label} has {text.number(first.error)} of the requested error"
        else:
            miss = f"{plan.best.label} takes {ratio:.2f} times as long as {best}" if ratio > MOST else ""
        row = [
            plan.problem.name,
            plan.metric,
            f"{plan.accuracy:g}",
            first.prediction.label if first else "-",
            text.number(1e3 * seconds),
            text.number(first.error, 2) if first else "-",
            best,
            text.number(1e3 * best_seconds),
            text.ratio(ratio),
            f"{sum(each.is_hit for each in followed)} of {len(followed)}",
            f"{plan.pilot_seconds:.2f}",
        ]
        name = f"{plan.problem.name}, {plan.metric} {plan.accuracy:g}"
        return cls(name, row, ratio <= MOST, first is not None and first.error <= 1, miss)


def benchmark(
    *,
    only: Sequence[str] | None = None,
    repeats: int = 9,
    longest: float = LONGEST,
    write: Callable[[str], None] = print,
) -> None:
    """Print a table with every case of every problem, the ratios, and every miss."""
    names = choose(only, list(PROBLEM_SET), "--problem")
    write(f"Machine: {in_words()}")
    write(how_measured(repeats) + "\n")
    write(render([outcome for name in names for outcome in outcomes_of(name, repeats, longest)]))


def how_measured(repeats: int) -> str:
    return (
        f"The first choice beside the {_CONTENDERS} fastest methods of a sweep, each at the step with which it reaches "
        f"the accuracy: medians of {repeats} interleaved runs. A prediction counts as right if the error is "
        f"{ERROR_RANGE[0]} to {ERROR_RANGE[1]} of the requested error, or smaller with a note, and the time is right "
        f"to a factor of {TIME_FACTOR}. Extrapolated predictions are not counted."
    )


def render(outcomes: Sequence[Outcome]) -> str:
    """The table of the cases, in how many of them the first choice is good, and a line for each of the others."""
    good, reached = sum(outcome.is_good for outcome in outcomes), sum(outcome.reaches for outcome in outcomes)
    lines = [
        f"The first choice takes at most {MOST} times as long as the best in {good} of {len(outcomes)} cases. It "
        f"reaches the accuracy in {reached}.",
        *(f"- {outcome.name}: {outcome.miss}" for outcome in outcomes if outcome.miss),
    ]
    return "\n\n".join([text.table(HEADER, [outcome.row for outcome in outcomes]), "\n".join(lines)])


def outcomes_of(name: str, repeats: int, longest: float, swept: WorkPrecisionSet | None = None) -> list[Outcome]:
    """A plan for each metric and accuracy that a method of the sweep reaches; the sweep is measured if not given."""
    problem = dataclasses.replace(PROBLEM_SET[name].build(), name=name)
    chosen = dataclasses.replace(PROBLEM_SET[name], build=lambda: problem)  # its reference is found only once
    swept = swept or measure(name, chosen, LIBRARY, 3, longest, rivals=False, modes=("pointer",))
    judge = Judge(problem, reference(problem, chosen.omega))
    found = []
    for metric in PLAN_METRICS:
        for accuracy in ACCURACIES if metric in swept.metrics else ():
            text.status(f"{name}, {metric} {accuracy:g}")
            contenders = fastest(judge, chosen, swept, metric, accuracy)
            if contenders:
                plan = eig3.plan(problem, accuracy, metric=metric)
                found.append(compare(plan, follow(plan, judge), contenders, repeats))
    text.status("")
    return found


def fastest(
    judge: Judge, chosen: BenchmarkProblem, swept: WorkPrecisionSet, metric: str, accuracy: float
) -> list[tuple[str, Method, float]]:
    """The label, record and step of the methods of the sweep that reach the accuracy first."""
    reached = []
    for key, method in records(judge.problem, chosen, LIBRARY):
        found = reach(swept, key, metric, accuracy)
        if found:
            reached.append((found.seconds, swept.methods[key], method, found.setting))
    reached.sort(key=lambda entry: entry[0])
    return [
        (label, method, reaching(judge, method, h, metric, accuracy)) for _, label, method, h in reached[:_CONTENDERS]
    ]


def reaching(judge: Judge, method: Method, h: float, metric: str, accuracy: float) -> float:
    """The first step from `h` down, by 3 % each time, that reaches the accuracy; `reach` only interpolates it."""
    for _ in range(_TRIALS):
        if error_of(judge, method, h, metric) <= accuracy:
            break
        h *= 0.97
    return h


def error_of(judge: Judge, method: Method, h: float, metric: str) -> float:
    n_steps, h = divide(*judge.problem.t_span, h)
    return _error_of(judge, metric, h=h, method=method, save_every=max(1, n_steps // STATES))


def error_of_prediction(judge: Judge, prediction: Prediction, metric: str) -> float:
    if prediction.rtol is None:
        return error_of(judge, prediction.method, prediction.h, metric)
    return _error_of(judge, metric, **prediction.options)


def _error_of(judge: Judge, metric: str, **options: Any) -> float:
    solution = judge.problem.integrate(**options)
    return judge.of_run(solution)[metric] if solution.success else float("inf")


def repeatable(problem: Problem, prediction: Prediction, storage: Storage | None = None) -> Callable[[], float]:
    """A run of a prediction, which can be repeated; it returns the seconds in the kernel.

    With a fixed step it stores about `STATES` states in `storage`; with tolerances, every state.
    """
    if prediction.rtol is not None:
        every = 1 if storage else None
        return lambda: problem.integrate(**prediction.options, save_every=every, invariants={}).kernel_seconds
    return _with_step(problem, prediction.method, prediction.h, storage)


def _with_step(problem: Problem, method: Method, h: float, storage: Storage | None) -> Callable[[], float]:
    n_steps, h = divide(*problem.t_span, h)
    start = problem.stepper(h=h, method=method)
    return kernel_run(start, n_steps, every=max(1, n_steps // STATES), storage=storage)


def compare(
    plan: Plan, followed: Sequence[Checked], contenders: Sequence[tuple[str, Method, float]], repeats: int
) -> Outcome:
    """Time the first choice and the contenders in turn."""
    problem = plan.problem
    storage = Storage.for_steps(problem, 2 * STATES)
    runs = {label: _with_step(problem, method, h, storage) for label, method, h in contenders}
    if followed:
        runs["first choice"] = repeatable(problem, plan.best, storage)
    seconds = medians(runs, repeats, problem.name)
    first = seconds.pop("first choice", float("inf"))
    best = min(seconds, key=lambda label: seconds[label])
    return Outcome.of(plan, followed, first, best, seconds[best])


def follow(plan: Plan, judge: Judge) -> list[Checked]:
    """Run every prediction that is not extrapolated, the fastest first."""
    checked = []
    for prediction in plan.predictions:
        if prediction.reaches and prediction.note != EXTRAPOLATED and prediction.seconds < _LONGEST_PREDICTED:
            error = error_of_prediction(judge, prediction, plan.metric)
            again = repeatable(plan.problem, prediction)
            seconds = statistics.median(again() for _ in range(3))
            checked.append(Checked(prediction, error / plan.accuracy, seconds / prediction.seconds))
    return checked
