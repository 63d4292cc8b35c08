"""`eig3 bench bars`: seconds per second simulated on elastic bars of three sizes, at 0.95 of each method's limit."""

from __future__ import annotations

import statistics
from collections.abc import Callable

import numpy as np

from eig3 import problems
from eig3.methods import EIG3, METHODS, Method
from eig3.stability import limit
from eig3.stepper import Stepper

from . import text
from .environment import in_words
from .timing import interleave

SIZES = {1_000: 20_000, 100_000: 200, 1_000_000: 20}  # steps of a run for each number of masses
_OF_LIMIT = 0.95
HEADER = ["masses, method", "ns/step and mass", "step / RK4's", "time per second simulated / RK4's"]


def run(*, repeats: int = 9, write: Callable[[str], None] = print) -> None:
    """Print the table."""
    write(f"Machine: {in_words()}")
    write("Elastic bar, no state stored, medians of interleaved runs; h is 0.95 of the stability limit.\n")
    rows = [row for n, n_steps in SIZES.items() for row in compare(n, n_steps, repeats)]
    text.status("")
    write(text.table(HEADER, rows))


def compare(n: int, n_steps: int, repeats: int) -> list[list[str]]:
    problem = problems.elastic_bar(n=n)
    highest = 2 * float(np.asarray(problem.params)[0]) ** 0.5
    methods: dict[str, Method] = {"EIG-3 with velocity": EIG3(), "EIG-3": problem.method("eig3")}
    methods |= {METHODS[name].label: problem.method(name) for name in ("cd", "rk3", "rk4", "ab3")}
    steppers = {
        label: problem.stepper(h=_OF_LIMIT * limit(method) / highest, method=method)
        for label, method in methods.items()
    }
    runs = {label: _again(stepper, n_steps) for label, stepper in steppers.items()}
    seconds = interleave(runs, repeats, lambda what: text.status(f"{n} masses, {what}"))
    medians = {label: statistics.median(values) for label, values in seconds.items()}
    rk4 = steppers["RK4"].h / medians["RK4"]
    return [
        [
            f"{n}, {label}",
            f"{1e9 * medians[label] / n_steps / n:.3f}",
            f"{stepper.h / steppers['RK4'].h:.2f}",
            f"{medians[label] / stepper.h * rk4:.2f}",
        ]
        for label, stepper in steppers.items()
    ]


def _again(stepper: Stepper, n_steps: int) -> Callable[[], float]:
    def run() -> float:
        before = stepper.seconds
        stepper.advance(n_steps)
        return stepper.seconds - before

    return run
