"""The library with tolerances, measured as a rival is: over tolerances, with the same output times."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from eig3.methods import METHODS
from eig3.problem import Problem

from .modes import Mode
from .rivals.rival import Answer, Rival, absolute


def _prepare(
    method: str, problem: Problem, times: np.ndarray, *, mode: Mode
) -> Callable[[float], Callable[[], Answer]]:
    def at(tolerance: float) -> Callable[[], Answer]:
        options = {"method": method, "t_eval": times, "rtol": tolerance, "atol": absolute(tolerance, problem)}
        timed = mode.timed(problem, options)

        def run() -> Answer:
            seconds, solution = timed()
            return Answer(seconds, solution.u, solution.v, solution.n_rhs, solution.success)

        return run

    return at


def _with_tolerances(method: str, steps: range) -> Rival:
    tolerances = tuple(10.0 ** (-k / 2) for k in steps)
    return Rival(f"{METHODS[method]().label}, tolerances", "eig3", partial(_prepare, method), tolerances)


#: The methods with tolerances; EIG-3, of second order, would take too long with tight ones.
TOLERANCES = {
    "rk5 tolerances": _with_tolerances("rk5", range(6, 27)),
    "rk8 tolerances": _with_tolerances("rk8", range(6, 28)),
    "rkn12 tolerances": _with_tolerances("rkn12", range(4, 27)),
    "eig3 tolerances": _with_tolerances("eig3", range(4, 19)),
}
