"""Time per second simulated on elastic bars of up to a million masses, methods at 0.95 of their stability limits."""

from __future__ import annotations

import argparse
from collections.abc import Callable

import numpy as np

from eig3 import problems
from eig3.methods import EIG3, METHODS, Method
from eig3.stability import limit

from . import text
from .choices import add_repeats
from .environment import in_words
from .timing import continued_run, medians

SUMMARY = "bars of up to a million masses, at the stability limit"
SIZES = {1_000: 20_000, 100_000: 200, 1_000_000: 20}  # masses: steps of a run
_OF_LIMIT = 0.95
METHODS_OF_BARS = ("cd", "rk3", "rk4", "rk8", "ab3", "bm6", "eig4", "eig5", "eig8")
HEADER = ["masses, method", "ns/step and mass", "step / RK4's", "time per second simulated / RK4's"]


def add_options(parser: argparse.ArgumentParser) -> None:
    add_repeats(parser, 9)


def benchmark(*, repeats: int = 9, write: Callable[[str], None] = print) -> None:
    """Print the table."""
    write(f"Machine: {in_words()}")
    write("Elastic bar, no state stored, medians of interleaved runs; h is 0.95 of the stability limit.\n")
    write(text.table(HEADER, [row for n, n_steps in SIZES.items() for row in compare(n, n_steps, repeats)]))


def compare(n: int, n_steps: int, repeats: int) -> list[list[str]]:
    """The rows of a bar of `n` masses."""
    problem = problems.elastic_bar(n=n)
    highest = 2 * float(np.asarray(problem.params)[0]) ** 0.5
    methods: dict[str, Method] = {"EIG-3 with velocity": EIG3(velocity="explicit"), "EIG-3": EIG3()}
    methods |= {method.label: method for method in (METHODS[name]() for name in METHODS_OF_BARS)}
    steppers = {
        label: problem.stepper(h=_OF_LIMIT * limit(method) / highest, method=method)
        for label, method in methods.items()
    }
    runs = {label: continued_run(stepper, n_steps) for label, stepper in steppers.items()}
    seconds = medians(runs, repeats, f"{n} masses")
    rk4 = steppers["RK4"].h / seconds["RK4"]
    return [
        [
            f"{n}, {label}",
            f"{1e9 * seconds[label] / n_steps / n:.3f}",
            f"{stepper.h / steppers['RK4'].h:.2f}",
            f"{seconds[label] / stepper.h * rk4:.2f}",
        ]
        for label, stepper in steppers.items()
    ]
