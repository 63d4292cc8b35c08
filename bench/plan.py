"""Check on seven problems what eig3.plan predicts, against the true error and the measured time."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import eig3
from eig3.analysis.planner import Plan, Prediction

from . import text
from .environment import in_words
from .options import add_problems, choose
from .problem_set import PROBLEM_SET
from .reference import Judge, reference

SUMMARY = "how well eig3.plan predicts"
ACCURACIES = (1e-2, 1e-4, 1e-6)
ERROR_RANGE = (0.1, 1.5)  # relative to the requested accuracy
TIME_FACTOR = 1.5
_LONGEST = 3.0  # a run with a longer predicted time is left out, s
HEADER = ["problem", "accuracy", "fastest", "h", "achieved / asked", "time / predicted", "hits of all methods"]


def add_options(parser: argparse.ArgumentParser) -> None:
    add_problems(parser)


def run(options: argparse.Namespace) -> None:
    benchmark(only=options.problems)


@dataclass(frozen=True)
class Outcome:
    """A prediction after its run: the error over the requested accuracy, and the time over the predicted time."""

    prediction: Prediction
    error: float
    time: float

    @property
    def misses(self) -> list[str]:
        """The quantities outside their ranges. A smaller error is not a miss if stability limits the step."""
        found = []
        limited = self.error < ERROR_RANGE[0] and self.prediction.note
        if not limited and not ERROR_RANGE[0] <= self.error <= ERROR_RANGE[1]:
            found.append(f"error {text.number(self.error, 2)} of the requested accuracy")
        if not 1 / TIME_FACTOR <= self.time <= TIME_FACTOR:
            found.append(f"time {self.time:.2f} of the predicted time")
        return found


def benchmark(*, only: Sequence[str] | None = None, write: Callable[[str], None] = print) -> None:
    """Print the fastest method of each plan with its outcome, and every miss of every method."""
    names = choose(only, list(PROBLEM_SET), "--problem")
    write(f"Machine: {in_words()}")
    write(
        f"A hit has {ERROR_RANGE[0]} to {ERROR_RANGE[1]} of the requested error, or less if the plan says that "
        f"stability limits the step. It takes the predicted time to a factor of {TIME_FACTOR}.\n"
    )
    rows, misses, total = [], [], 0
    for name in names:
        problem = PROBLEM_SET[name].build()
        judge = Judge(problem, reference(problem, PROBLEM_SET[name].omega))
        for accuracy in ACCURACIES:
            text.status(f"{name}, accuracy {accuracy:g}")
            plan = eig3.plan(problem, accuracy)
            outcomes = follow(plan, judge)
            total += len(outcomes)
            rows.append(_row(plan, outcomes))
            misses += [
                f"{name}, {accuracy:g}, {outcome.prediction.method.label}: {miss}"
                for outcome in outcomes
                for miss in outcome.misses
            ]
    text.status("")
    write(text.table(HEADER, rows))
    write(f"\n{total} predictions were run, with {len(misses)} misses{':' if misses else '.'}\n")
    write("\n".join(f"- {miss}" for miss in misses))


def follow(plan: Plan, judge: Judge) -> list[Outcome]:
    """Run every prediction, the fastest first."""
    outcomes = []
    for prediction in plan.predictions:
        if prediction.reaches and prediction.seconds < _LONGEST:
            solution = Plan(plan.problem, plan.accuracy, plan.metric, (prediction,), 0.0).run()
            error = judge.errors(solution.t, solution.u)["trajectory"] if solution.success else float("inf")
            outcomes.append(Outcome(prediction, error / plan.accuracy, solution.kernel_seconds / prediction.seconds))
    return outcomes


def _row(plan: Plan, outcomes: Sequence[Outcome]) -> list[str]:
    best, good = outcomes[0], sum(not outcome.misses for outcome in outcomes)
    note = f" ({best.prediction.note})" if best.prediction.note else ""
    return [
        plan.problem.name,
        f"{plan.accuracy:g}",
        best.prediction.method.label,
        f"{best.prediction.h:.2e}",
        text.number(best.error, 2) + note,
        f"{best.time:.2f}",
        f"{good} of {len(outcomes)}",
    ]
