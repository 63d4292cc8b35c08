"""`eig3 bench plan`: how well `eig3.plan` predicts, on every problem, against the truth and the clock."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import eig3
from eig3.analysis.planner import Plan, Prediction

from . import text
from .environment import in_words
from .precision import CASES, Judge
from .reference import reference
from .speed import choose

ACCURACIES = (1e-2, 1e-4, 1e-6)
ERROR_RANGE = (0.1, 1.5)  # of the accuracy asked for
TIME_FACTOR = 1.5
_LONGEST = 3.0  # s: what is predicted to take longer is not run
HEADER = ["problem", "accuracy", "fastest", "h", "achieved / asked", "time / predicted", "hits of all methods"]


@dataclass(frozen=True)
class Hit:
    """What became of a prediction."""

    prediction: Prediction
    error: float
    time: float

    @property
    def misses(self) -> list[str]:
        found = []
        limited = self.error < ERROR_RANGE[0] and self.prediction.note
        if not limited and not ERROR_RANGE[0] <= self.error <= ERROR_RANGE[1]:
            found.append(f"error {text.number(self.error, 2)} of that asked")
        if not 1 / TIME_FACTOR <= self.time <= TIME_FACTOR:
            found.append(f"time {self.time:.2f} of that predicted")
        return found


def run(*, only: Sequence[str] | None = None, write: Callable[[str], None] = print) -> None:
    """Print the fastest method of each plan, how far it was right, and every miss of every method."""
    names = choose(only, list(CASES), "--problem")
    write(f"Machine: {in_words()}")
    write(
        f"A hit has an error of {ERROR_RANGE[0]} to {ERROR_RANGE[1]} of that asked for, or a smaller one where the "
        f"plan says that stability limits the step, and takes the time predicted to a factor of {TIME_FACTOR}.\n"
    )
    rows, misses, total = [], [], 0
    for name in names:
        problem = CASES[name].build()
        judge = Judge(problem, reference(problem, CASES[name].omega))
        for accuracy in ACCURACIES:
            text.status(f"{name}, accuracy {accuracy:g}")
            plan = eig3.plan(problem, accuracy)
            hits = follow(plan, judge)
            total += len(hits)
            missed = [
                f"{name}, {accuracy:g}, {hit.prediction.method.label}: {miss}" for hit in hits for miss in hit.misses
            ]
            rows.append(_row(plan, hits))
            misses += missed
    text.status("")
    write(text.table(HEADER, rows))
    write(f"\n{total} predictions were run, with {len(misses)} misses{':' if misses else '.'}\n")
    write("\n".join(f"- {miss}" for miss in misses))


def follow(plan: Plan, judge: Judge) -> list[Hit]:
    """Run every prediction, the fastest first."""
    hits = []
    for prediction in plan.predictions:
        if prediction.reaches and prediction.seconds < _LONGEST:
            solution = Plan(plan.problem, plan.accuracy, plan.metric, (prediction,), 0.0).run()
            error = judge.errors(solution.t, solution.u)["trajectory"] if solution.success else float("inf")
            hits.append(Hit(prediction, error / plan.accuracy, solution.kernel_seconds / prediction.seconds))
    return hits


def _row(plan: Plan, hits: Sequence[Hit]) -> list[str]:
    best, good = hits[0], sum(not hit.misses for hit in hits)
    note = f" ({best.prediction.note})" if best.prediction.note else ""
    return [
        plan.problem.name,
        f"{plan.accuracy:g}",
        best.prediction.method.label,
        f"{best.prediction.h:.2e}",
        text.number(best.error, 2) + note,
        f"{best.time:.2f}",
        f"{good} of {len(hits)}",
    ]
