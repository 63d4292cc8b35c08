"""The article's five tables as printed, and its errors recomputed from their definitions.

Steps in seconds, errors in the metric of each table, times in seconds on one core of a Xeon E5345 at 2.33 GHz (C/C++,
-O3, mean of ten runs). A time of 0.0 is below the resolution of the clock there.
"""

from collections.abc import Callable
from dataclasses import dataclass

from eig3 import problems
from eig3.methods import METHODS, CentralDifference, Method
from eig3.problem import Problem

FOOTNOTES = {
    "a": "printed 6.9e23, probably a misprint of 6.9e13: the mantissa and the growth law (1 + Omega^4/4)^(N/2) agree",
    "b": "round-off of 2 u_n - u_{n-1} in the article; computed here with increments, the error keeps second order",
    "c": "the motion is chaotic at this step: errors of different programs agree to a few per cent only",
    "d": "the article does not give the start of AB2 for this problem; the Taylor start used here is more accurate",
}


@dataclass(frozen=True)
class Entry:
    """One cell: the printed and the recomputed error, the printed time, and the letter of a footnote."""

    error: float
    recomputed: float
    seconds: float
    mark: str = ""


@dataclass(frozen=True)
class Table:
    """One of the article's tables; `entries[method]` has one entry for each of `steps`."""

    number: int
    title: str
    metric: str
    problem: Callable[[], Problem]
    steps: tuple[float, ...]
    entries: dict[str, tuple[Entry, ...]]


def method_of(problem: Problem, name: str) -> Method:
    """A method as the article uses it: CD solves with Newton's method if f depends on the velocity."""
    if name == "cd" and problem.uses_velocity:
        return CentralDifference(velocity="implicit", solver="newton")
    return METHODS[name]()


def _entries(errors, recomputed, seconds, marks=""):
    """The column of one method, from the largest step to the smallest; `marks` has a letter or a dot for each."""
    marks = marks.replace(".", " ").ljust(len(errors))
    return tuple(Entry(*cell, mark.strip()) for *cell, mark in zip(errors, recomputed, seconds, marks, strict=True))


TABLES = (
    Table(
        number=1,
        title="single degree of freedom, omega = 4 rad/s, 1000 s",
        metric="max |u - exact| / max |u|",
        problem=problems.single_dof,
        steps=(1e-1, 1e-2, 1e-3, 1e-4),
        entries={
            "eig3": _entries(
                (1.99, 0.26, 2.6e-3, 2.7e-5), (2.00, 0.266, 2.67e-3, 2.67e-5), (0.0, 3.1e-3, 4.1e-2, 0.45)
            ),
            "cd": _entries((1.99, 0.26, 2.6e-3, 2.7e-5), (2.00, 0.266, 2.67e-3, 2.67e-5), (0.0, 3.1e-3, 4e-2, 0.39)),
            "ab2": _entries(
                (7.32e38, 2.0, 2.6e-2, 2.6e-4), (7.32e38, 2.01, 2.67e-2, 2.67e-4), (0.0, 7.8e-3, 6.9e-2, 0.74)
            ),
            "rk2": _entries(
                (6.9e23, 1.03, 1.07e-2, 1.1e-4), (6.97e13, 1.03, 1.07e-2, 1.07e-4), (0.0, 0.015, 0.109, 1.15), "a..."
            ),
        },
    ),
    Table(
        number=2,
        title="hardening spring, 100 periods = 15.153 s",
        metric="max |E - E0| (J)",
        problem=problems.hardening_spring,
        steps=(1e-3, 1e-4, 1e-5, 1e-6),
        entries={
            "eig3": _entries(
                (2.6, 2.6e-2, 2.6e-4, 2.6e-6), (2.615, 2.564e-2, 2.56e-4, 2.56e-6), (0.0, 3.1e-3, 7.2e-2, 0.76)
            ),
            "cd": _entries(
                (1.03, 1.03e-2, 1.03e-4, 7.7e-6),
                (1.030, 1.030e-2, 1.03e-4, 8.9e-6),
                (0.0, 1.5e-2, 6.3e-2, 0.61),
                "...b",
            ),
            "ab2": _entries(
                (101.0, 9.3e-2, 5e-4, 5.1e-6), (101.1, 9.34e-2, 5.06e-4, 5.06e-6), (0.0, 1.5e-2, 0.12, 1.18)
            ),
            "rk2": _entries(
                (49.3, 5.7e-2, 1.4e-4, 1.05e-6), (49.30, 5.669e-2, 1.47e-4, 1.06e-6), (0.0, 1.6e-2, 0.19, 1.9)
            ),
        },
    ),
    Table(
        number=3,
        title="softening spring, 140 s",
        metric="max |E - E0| (J)",
        problem=problems.softening_spring,
        steps=(1e-2, 1e-3, 1e-4, 1e-5),
        entries={
            "eig3": _entries(
                (2.7, 2.7e-2, 2.7e-4, 2.7e-6), (2.71, 2.71e-2, 2.71e-4, 2.71e-6), (0.0, 1.7e-2, 0.16, 1.57)
            ),
            "cd": _entries(
                (0.59, 5.9e-3, 5.9e-5, 8.4e-7), (0.594, 5.93e-3, 5.93e-5, 6.8e-7), (0.0, 1.6e-2, 0.25, 1.5), "...b"
            ),
            "ab2": _entries(
                (45.2, 6.4e-2, 2.8e-4, 2.4e-6), (45.2, 6.44e-2, 2.75e-4, 2.38e-6), (0.0, 1.9e-2, 0.23, 2.29)
            ),
            "rk2": _entries(
                (20.4, 2e-2, 4.7e-5, 4.7e-7), (20.4, 2.05e-2, 4.68e-5, 4.68e-7), (1.5e-2, 3.8e-2, 0.41, 4.1)
            ),
        },
    ),
    Table(
        number=4,
        title="spring pendulum, 100 s",
        metric="max |E - E0| (J)",
        problem=problems.spring_pendulum,
        steps=(1e-2, 1e-3, 1e-4, 1e-5),
        entries={
            "eig3": _entries(
                (1.67, 2.5e-3, 1.6e-5, 1.5e-7), (1.68, 2.52e-3, 1.61e-5, 1.52e-7), (0.0, 1.6e-2, 0.16, 1.6), "c..."
            ),
            "cd": _entries(
                (3.9e-2, 3.9e-4, 3.9e-6, 8e-8), (3.87e-2, 3.90e-4, 3.90e-6, 4.9e-8), (1.7e-2, 8.8e-2, 0.89, 8.9), "c..b"
            ),
            "ab2": _entries(
                (3.4, 4.2e-3, 2.4e-5, 2.2e-7), (3.68, 3.14e-3, 1.31e-5, 1.14e-7), (1.5e-3, 1.5e-2, 0.19, 1.8), "cddd"
            ),
            "rk2": _entries(
                (1.27, 1.1e-3, 2e-6, 1.1e-8), (1.28, 1.12e-3, 2.05e-6, 1.13e-8), (1.5e-3, 2.8e-2, 0.29, 2.9), "c..."
            ),
        },
    ),
    Table(
        number=5,
        title="spring pendulum, 100 s, EIG-3 at finer steps",
        metric="max |E - E0| (J)",
        problem=problems.spring_pendulum,
        steps=(8e-6, 6e-6, 4e-6, 2e-6, 1e-6),
        entries={
            "eig3": _entries(
                (9.7e-8, 5.4e-8, 2.4e-8, 6.1e-9, 1.5e-9),
                (9.72e-8, 5.46e-8, 2.42e-8, 6.05e-9, 1.53e-9),
                (1.9, 2.54, 3.8, 7.6, 15.2),
            ),
        },
    ),
)
