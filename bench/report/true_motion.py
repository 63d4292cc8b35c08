"""The true motion of a user's problem, at equal distances in time."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from eig3.problem import Problem
from eig3.result.solution import Solution

from ..reference import Reference, exact_reference

_UNIT = 61  # a prime number: states at multiples of a period would hide an error of phase
_HALVINGS = 4  # of the distance between states, for a small system
VALUES = 2**22  # of a history, at most
_STEPS = 4  # in each distance, before states are put closer together
_SECONDS = 12.0  # for the runs of RK8, and a third of it for the runs of RK5
_SMALL = 1e-3  # of two runs that differ by less, it is known how the next ones differ
_SLOWLY = 0.7  # the factor of two differences, above which round-off or a force that is not smooth is in the way
_AGREES = 0.1  # of the smallest accuracy
_ROUND_OFF = 1e-12  # runs that agree better are not halved


@dataclass(frozen=True)
class Grid:
    """The times of a span at which runs are compared: `count` equal distances, `_UNIT` times a power of 2."""

    t_span: tuple[float, float]
    count: int

    @classmethod
    def of(cls, problem: Problem) -> Grid:
        count = _UNIT * 2**_HALVINGS
        while count > _UNIT and count * np.size(problem.u0) > VALUES:
            count //= 2
        return cls(problem.t_span, count)

    @property
    def rival_states(self) -> int:
        """The number of states of a run that gives states at any times."""
        return max(_UNIT, self.count // 2) + 1

    def fit(self, n_steps: int) -> int:
        """The least number of steps, at least `n_steps`, of a run that has enough states on the grid."""
        return math.ceil(n_steps / self._states(n_steps)) * self._states(n_steps)

    def steps(self, n_steps: int) -> dict[str, Any]:
        """The options of a run with a fitted number of steps, which keeps its states on the grid."""
        span = self.t_span[1] - self.t_span[0]
        states = self._states(n_steps)
        while states < self.count and n_steps % (2 * states) == 0:
            states *= 2
        return {"h": span / n_steps, "save_every": n_steps // states}

    def _states(self, n_steps: int) -> int:
        states = self.count
        while states > _UNIT and states * _STEPS > n_steps:
            states //= 2
        return states

    def at(self, table: np.ndarray, t: np.ndarray) -> np.ndarray:
        """The rows of a table, which has one row for each time of the grid, at some of these times."""
        t0, t1 = self.t_span
        return table[np.rint((t - t0) / (t1 - t0) * self.count).astype(int)]


def find_truth(problem: Problem, grid: Grid, smallest: float) -> Reference:
    """The exact solution, or RK8 with steps that are halved until two runs agree to a tenth of the smallest accuracy.

    The difference of the last two is the uncertainty. The halving ends earlier if it no longer brings them closer, or
    if the next run would take too long. RK5, with ever more steps, is a check by another method.

    Raises
    ------
    ValueError
        If no run of RK8 reaches the end.
    """
    if problem.exact:
        return exact_reference(problem)
    solution, uncertainty = _halved(problem, grid, smallest)
    difference, check = _checked(problem, grid, solution, max(uncertainty, _AGREES * smallest))
    beside = f"from which RK5 with {check} steps differs by {difference:.1g}"
    source = f"RK8 with {solution.n_steps} steps, {beside}"
    return Reference(lambda t: grid.at(solution.u, t), source, uncertainty)


def _halved(problem: Problem, grid: Grid, smallest: float) -> tuple[Solution, float]:
    """Return the last of the runs of RK8, and its difference from the run before."""
    begin = time.perf_counter()
    n_steps, last, before, message = grid.count, None, math.inf, ""
    while True:
        started = time.perf_counter()
        solution = _run(problem, grid, "rk8", n_steps)
        seconds = time.perf_counter() - started
        if solution.success:
            difference = _difference(solution, last) if last else math.inf
            is_slow = difference > _SLOWLY * before and min(difference, before) < _SMALL
            if difference <= max(_AGREES * smallest, _ROUND_OFF) or is_slow:
                return solution, difference
            last, before = solution, difference
        else:
            message = solution.message
        if time.perf_counter() - begin + 2 * seconds > _SECONDS:
            break
        n_steps *= 2
    if last is None:
        raise ValueError(f"problem {problem.name} does not reach the end of t_span with RK8: {message}")
    return last, before


def _checked(problem: Problem, grid: Grid, truth: Solution, enough: float) -> tuple[float, int]:
    """The smallest difference of runs of RK5, with ever more steps, and the number of steps."""
    begin = time.perf_counter()
    n_steps, least = truth.n_steps, (math.inf, 0)
    while True:
        started = time.perf_counter()
        solution = _run(problem, grid, "rk5", n_steps)
        seconds = time.perf_counter() - started
        if solution.success:
            least = min(least, (_difference(solution, truth), n_steps))
        if least[0] <= enough or time.perf_counter() - begin + 2 * seconds > _SECONDS / 3:
            return least if least[1] else (math.inf, n_steps)
        n_steps *= 2


def _run(problem: Problem, grid: Grid, method: str, n_steps: int) -> Solution:
    return problem.integrate(method=method, invariants={}, **grid.steps(n_steps))


def _difference(one: Solution, two: Solution) -> float:
    """Of two runs, which both have all states of the grid."""
    size = float(np.abs(one.u).max()) or 1.0
    return float(np.abs(one.u - two.u).max() / size)
