"""Runs of the library's kernels, and of a loop that is their lower bound, on the same problems and storage."""

import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np

from eig3 import problems
from eig3.kernels.compile.jit import OPTIONS
from eig3.problem import Problem

from .article import method_of
from .choices import ARTICLE_METHODS
from .timing import Storage, kernel_run

#: Steps of a timed run.
N_STEPS = 500_000
#: The methods whose steps are timed.
METHODS = (*ARTICLE_METHODS, "eig5", "eig9", "rk5", "rk8", "bm6")
#: The article's problems, each with a step that is small enough for every method.
ARTICLE_PROBLEMS = (
    (problems.single_dof, 1e-3),
    (problems.hardening_spring, 1e-5),
    (problems.softening_spring, 1e-4),
    (problems.spring_pendulum, 1e-4),
)


def is_vector(problem: Problem) -> bool:
    """Whether the state of the problem is an array."""
    return np.ndim(problem.u0) == 1


def initial_state(problem: Problem) -> tuple[Any, Any]:
    """u and v at the start: floats, or new arrays that a loop may change."""
    u, v = (np.array(x, dtype=np.float64) for x in (problem.u0, problem.v0))
    return (u, v) if u.ndim else (float(u), float(v))


def kernel_loop(problem: Problem, h: float, method: str, storage: Storage, *, inline: bool) -> Callable[[], float]:
    """A run of the library's kernel; it returns its seconds."""
    start = problem.stepper(h=h, method=method_of(problem, method), inline=inline)
    return kernel_run(start, N_STEPS, storage=storage)


def floor_loop(problem: Problem, h: float, storage: Storage) -> Callable[[], float]:
    """A lower bound of a run: each step evaluates f once, on a stored state of another run; it returns its seconds."""
    params = np.array(problem.params, dtype=np.float64)
    loop = numba.njit(**OPTIONS)(_floor_of_arrays if is_vector(problem) else _floor_of_numbers)
    return timed_call(problem, lambda u, v: loop(problem.rhs, u, v, params, h, N_STEPS, storage.u, storage.v))


def _floor_of_numbers(f, u, v, p, h, n, u_rows, v_rows):  # type: ignore[no-untyped-def]
    for i in range(n):
        u = u_rows[i] + 1e-30 * f(i * h, u, v_rows[i], p)
    return u


def _floor_of_arrays(f, u, v, p, h, n, u_rows, v_rows):  # type: ignore[no-untyped-def]
    a = np.empty(2)
    for i in range(n):
        v[0], v[1] = v_rows[i, 0], v_rows[i, 1]
        f(i * h, u, v, p, a)
        u[0], u[1] = u_rows[i, 0] + 1e-30 * a[0], u_rows[i, 1] + 1e-30 * a[1]
    return u[0] + u[1]


def timed_call(problem: Problem, loop: Callable[[Any, Any], object]) -> Callable[[], float]:
    """A call of ``loop(u, v)`` from the start of the problem; it returns its seconds."""

    def run() -> float:
        u, v = initial_state(problem)
        begin = time.perf_counter()
        loop(u, v)
        return time.perf_counter() - begin

    return run
