"""The time to a first result: define, compile and run a right-hand side.

`python -m eig3.bench.start pointer` does it in a new process; the other mode is `inline`.
"""

import sys
from typing import Any

import numpy as np

import eig3
from eig3.result.solution import Solution


def new_function() -> Any:
    """The oscillator u'' = -u as a new function, which Numba has to compile again."""

    @eig3.jit
    def oscillator(t, u, v, p):
        return -u

    return oscillator


def result(rhs: Any, mode: str) -> Solution:
    """The run from u = 1, v = 0."""
    return eig3.integrate(rhs, (0, 10), 1.0, 0.0, h=1e-3, inline=mode == "inline")


def error(solution: Solution) -> float:
    """max |u - cos t|"""
    return float(np.abs(solution.u - np.cos(solution.t)).max())


if __name__ == "__main__":
    sys.exit(not result(new_function(), sys.argv[1]).success)
