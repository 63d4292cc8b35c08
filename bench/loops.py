"""Runs of the library's kernels and of loops written by hand, on the same problems and storage."""

import time
from collections.abc import Callable
from typing import Any

import numba
import numpy as np
from numba.types import FunctionType

from eig3 import problems
from eig3.kernels.compile.jit import OPTIONS
from eig3.kernels.protocol import SCALAR, VECTOR
from eig3.problem import Problem

from . import handwritten
from .article import method_of
from .choices import ARTICLE_METHODS
from .timing import Storage, kernel_run

#: Steps of a timed run.
N_STEPS = 500_000
#: The methods whose steps are timed. Methods of the article also have loops written by hand.
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


def by_hand(problem: Problem, method: str) -> Callable | None:
    """The loop written by hand of a method for a problem; None if there is none."""
    return getattr(handwritten, f"{method}_{'pair' if is_vector(problem) else 'scalar'}", None)


def initial_state(problem: Problem) -> tuple[Any, Any]:
    """u and v at the start: floats, or new arrays that a loop may change."""
    u, v = (np.array(x, dtype=np.float64) for x in (problem.u0, problem.v0))
    return (u, v) if u.ndim else (float(u), float(v))


def kernel_loop(problem: Problem, h: float, method: str, storage: Storage, *, inline: bool) -> Callable[[], float]:
    """A run of the library's kernel; it returns its seconds."""
    start = problem.stepper(h=h, method=method_of(problem, method), inline=inline)
    return kernel_run(start, N_STEPS, storage=storage)


def hand_loop(problem: Problem, h: float, function: Callable, storage: Storage, *, inline: bool) -> Callable[[], float]:
    """A run of a function of `handwritten`, compiled with the kernels' options; it returns its seconds."""
    form = VECTOR if is_vector(problem) else SCALAR
    params = np.array(problem.params, dtype=np.float64)
    if inline:
        loop = numba.njit(**OPTIONS)(function)
    else:
        array = numba.types.Array(numba.float64, 1, "C")
        state = array if form is VECTOR else numba.float64
        types = (FunctionType(form.rhs), state, state, array, numba.float64, numba.int64, form.state, form.state)
        loop = numba.njit(numba.void(*types), **OPTIONS)(function)
    return timed_call(problem, lambda u, v: loop(problem.rhs, u, v, params, h, N_STEPS, storage.u, storage.v))


def timed_call(problem: Problem, loop: Callable[[Any, Any], object]) -> Callable[[], float]:
    """A call of ``loop(u, v)`` from the start of the problem; it returns its seconds."""

    def run() -> float:
        u, v = initial_state(problem)
        begin = time.perf_counter()
        loop(u, v)
        return time.perf_counter() - begin

    return run
