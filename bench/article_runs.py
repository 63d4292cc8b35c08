"""Runs of the article's problems: times of all methods at every step of a table, and errors in the article's metric."""

import dataclasses
import math
import statistics
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from eig3.methods import METHODS, CentralDifference, Method
from eig3.problem import Problem
from eig3.result.solution import Solution
from eig3.run.fixed_run import divide

from . import text
from .article import FOOTNOTES, TABLES, Entry, Table, method_of
from .timing import Storage, interleave, kernel_run
from .typed import check_known, check_positive, checked

#: Table 4 gets one more row: CD with fixed-point iteration, which is faster here than the article's Newton iteration.
_EXTRA = {4: {"cd fixed-point": CentralDifference(velocity="implicit", solver="fixed-point")}}
_ERROR_BLOCK = 2**18  # states for which the exact solution is computed at once


@dataclass(frozen=True)
class MeasuredCell:
    """One method at one step: the measurements, and the article's entry if there is one."""

    h: float
    method: str
    n_steps: int
    n_rhs: int
    seconds: list[float]
    error: float
    status: str
    entry: Entry | None

    @property
    def mean(self) -> float:
        return statistics.fmean(self.seconds)

    @property
    def median(self) -> float:
        """Used in ratios, since one disturbed run does not change it."""
        return statistics.median(self.seconds)

    @property
    def label(self) -> str:
        return label(self.method)


@dataclass(frozen=True)
class MeasuredTable:
    """One of the article's tables with its measurements."""

    table: Table
    cells: list[MeasuredCell]

    def cell(self, method: str, h: float | None = None) -> MeasuredCell:
        """The cell of a method at a step, by default at the smallest step that was run.

        Raises
        ------
        LookupError
            If there is no such cell.
        """
        found = [cell for cell in self.cells if cell.method == method and h in (None, cell.h)]
        if not found:
            raise LookupError(f"table {self.table.number} was not run with {method} at h = {h}")
        return min(found, key=lambda cell: cell.h)

    @property
    def steps(self) -> list[float]:
        return sorted({cell.h for cell in self.cells}, reverse=True)

    def as_json(self) -> dict[str, Any]:
        """The cells with their statistics, as JSON; an error that is not finite is null."""
        table = self.table
        cells = [
            {
                **dataclasses.asdict(cell),
                "mean_seconds": cell.mean,
                "median_seconds": cell.median,
                "error": cell.error if math.isfinite(cell.error) else None,
            }
            for cell in self.cells
        ]
        return {"number": table.number, "title": table.title, "metric": table.metric, "cells": cells}

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> "MeasuredTable":
        """What `as_json` gave.

        Raises
        ------
        TypeError, ValueError, LookupError
            If it is damaged.
        """
        (table,) = (table for table in TABLES if table.number == data["number"])
        found = cls(table, [_cell(cell) for cell in data["cells"]])
        runs, methods = [(cell.method, cell.h) for cell in found.cells], {cell.method for cell in found.cells}
        check_known(table.entries, methods)
        check_known(methods, [*table.entries, *_EXTRA.get(table.number, {})])
        if sorted(runs) != sorted(product(methods, found.steps)):
            raise ValueError("each method was run once with each step")
        return found


def _cell(data: Mapping[str, Any]) -> MeasuredCell:
    known = {field.name: data[field.name] for field in dataclasses.fields(MeasuredCell)}
    entry = known["entry"] and Entry(**known["entry"])
    error = math.inf if known["error"] is None else known["error"]
    cell = checked(MeasuredCell(**{**known, "entry": entry, "error": error}))
    check_positive([cell.h, cell.n_steps, cell.n_rhs, cell.mean])
    check_positive(cell.seconds)
    if entry:
        checked(entry)
        check_known([entry.mark], ("", *FOOTNOTES))
        check_positive([entry.error, entry.recomputed])
    if not (cell.error >= 0 and (entry is None or 0 <= entry.seconds < math.inf)):
        raise ValueError("errors and times are not negative")
    return cell


def label(method: str) -> str:
    """The name of a method in tables."""
    name, _, rest = method.partition(" ")
    return METHODS[name]().label + (f" {rest}" if rest else "")


def measure(table: Table, steps: tuple[float, ...], repeats: int) -> MeasuredTable:
    """Time every method at every step in interleaved runs. The errors come from separate runs."""
    problem = table.problem()
    methods: dict[str, Method] = {name: method_of(problem, name) for name in table.entries}
    methods |= _EXTRA.get(table.number, {})
    storage = Storage.for_runs(problem, steps)
    cells = []
    for i, h in enumerate(steps):
        where = f"table {table.number}, h = {h:g}"
        n_steps, fitted = divide(*problem.t_span, h)
        runs = {
            name: kernel_run(problem.stepper(h=fitted, method=method), n_steps, storage=storage)
            for name, method in methods.items()
        }
        seconds = interleave(runs, repeats, where)
        for name, method in methods.items():
            text.status(f"{where}, {name}: error over every step")
            solution, error = error_of(problem, h, method)
            entry = table.entries[name][i] if name in table.entries else None
            status = solution.status.value
            cells.append(MeasuredCell(h, name, solution.n_steps, solution.n_rhs, seconds[name], error, status, entry))
    text.status("")
    return MeasuredTable(table, cells)


def error_of(problem: Problem, h: float, method: str | Method) -> tuple[Solution, float]:
    """A run and its error in the article's metric.

    The error is the relative error of u if the problem has an exact solution, and the energy drift (J) otherwise.
    """
    if problem.exact is None:
        solution = problem.integrate(h=h, method=method, save_every=None, invariants_every=1)
        return solution, solution.drift["energy"]
    solution = problem.integrate(h=h, method=method)
    worst = largest = 0.0
    for begin in range(0, len(solution.t), _ERROR_BLOCK):
        block = slice(begin, begin + _ERROR_BLOCK)
        exact = problem.exact(solution.t[block])[0]
        worst = max(worst, float(np.abs(solution.u[block] - exact).max()))
        largest = max(largest, float(np.abs(exact).max()))
    return solution, worst / largest
