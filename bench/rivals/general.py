"""Solvers that take any right-hand side: SciPy, CyRK, and Verlet's method as a loop by hand."""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import numba
import numpy as np

from eig3.functions.callbacks import jit
from eig3.functions.checks import check_params
from eig3.problem import Problem

from .impacts import restarted, states
from .rival import Answer, absolute

_ENDLESS = 1_000_000  # evaluations; SciPy takes some 8 s for them


def first_order(problem: Problem) -> tuple[np.ndarray, np.ndarray, Any]:
    """y = (u, v), the parameters, and a jitted ``slope(t, y, p, dy)``."""
    u0 = np.array(problem.u0, dtype=np.float64)
    y0 = np.concatenate([np.atleast_1d(u0), np.atleast_1d(np.array(problem.v0, dtype=np.float64))])
    rhs = problem.rhs
    if u0.ndim == 0:

        @jit
        def slope(t, y, p, dy):
            dy[0] = y[1]
            dy[1] = rhs(t, y[0], y[1], p)

    else:

        @jit
        def slope(t, y, p, dy):
            n = y.size // 2
            u, v = y[:n], y[n:]
            for j in range(n):
                dy[j] = v[j]
            rhs(t, u, v, p, dy[n:])

    return y0, check_params(problem.params), slope


def scipy_form(problem: Problem) -> tuple[np.ndarray, Any]:
    """y = (u, v), and its slope f(t, y) jitted and compiled."""
    y0, params, slope = first_order(problem)

    @jit
    def f(t, y):
        dy = np.empty_like(y)
        slope(t, y, params, dy)
        return dy

    f(problem.t_span[0], y0)
    return y0, f


class _EndlessError(Exception):
    """A run takes far more evaluations than any that is compared."""


def _limited(f: Any) -> Any:
    """The same slope, which raises an error after `_ENDLESS` calls: a motion that blows up takes ever smaller steps."""
    calls = itertools.count()

    def slope(t: float, y: np.ndarray) -> np.ndarray:
        if next(calls) > _ENDLESS:
            raise _EndlessError
        return f(t, y)

    return slope


def scipy(method: str, problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    from scipy.integrate import solve_ivp

    y0, f = scipy_form(problem)
    finished: set[float] = set()  # the tolerances with which a run has ended

    def run(tolerance: float) -> Answer:
        options = {"rtol": tolerance, "atol": absolute(tolerance, problem)}
        slope = f if tolerance in finished else _limited(f)

        def solve(span: Any, y: np.ndarray, t_eval: np.ndarray, events: Any) -> Any:
            return solve_ivp(slope, span, y, method, t_eval, events=events, **options)

        begin = time.perf_counter()
        try:
            with np.errstate(all="ignore"):  # a motion that blows up is no reason for warnings here
                results = restarted(solve, problem, times, y0)
        except (ValueError, _EndlessError):  # SciPy's search for an event fails where a step passes over a whole flight
            return Answer(time.perf_counter() - begin, np.empty(0), np.empty(0), None, False)
        seconds = time.perf_counter() - begin
        finished.add(tolerance)
        return Answer.of(seconds, states(results), times, sum(r.nfev for r in results), results[-1].success)

    return lambda tolerance: partial(run, tolerance)


def cyrk(method: str, problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    from CyRK import nb_diffeq_addr, nbsolve2_ivp

    if problem.events:
        return _cyrk_events(method, problem, times)
    y0, params, slope = first_order(problem)
    n, n_params = len(y0), len(params)

    def f(dy, t, y, p):  # CyRK's own signature, of pointers
        slope(t, numba.carray(y, n), numba.carray(p, n_params), numba.carray(dy, n))

    address = nb_diffeq_addr(f)

    def run(tolerance: float) -> Answer:
        begin = time.perf_counter()
        result = nbsolve2_ivp(
            address,
            (times[0], times[-1]),
            y0,
            method,
            times,
            args=params,
            rtol=tolerance,
            atol=absolute(tolerance, problem),
        )
        seconds = time.perf_counter() - begin
        return Answer.of(seconds, result.y.copy(), times, None, result.success)

    return lambda tolerance: partial(run, tolerance)


def _cyrk_events(method: str, problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    """With events, which CyRK has in its interface for Python only."""
    from CyRK import pysolve_ivp

    y0, f = scipy_form(problem)

    def run(tolerance: float) -> Answer:
        options = {"rtol": tolerance, "atol": absolute(tolerance, problem)}

        def solve(span: Any, y: np.ndarray, t_eval: np.ndarray, events: Any) -> Any:
            return pysolve_ivp(f, span, y, method, t_eval, events=events, **options)

        begin = time.perf_counter()
        results = restarted(solve, problem, times, y0)
        return Answer.of(time.perf_counter() - begin, states(results), times, None, results[-1].success)

    return lambda tolerance: partial(run, tolerance)


def verlet(problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    """Velocity Verlet as a user would write it with Numba, with the right-hand side inlined."""
    p = check_params(problem.params)
    u0, v0 = (np.array(x, dtype=np.float64) for x in (problem.u0, problem.v0))
    rhs = problem.rhs
    if u0.ndim:
        slope = rhs
    else:

        @jit
        def slope(t, u, v, p, a):
            a[0] = rhs(t, u[0], v[0], p)

    @jit
    def solve(t, h, substeps, u, v, p, states):
        n, a = u.size, np.zeros(u.size)
        slope(t, u, v, p, a)
        states[0, :n], states[0, n:] = u, v
        for i in range(1, len(states)):
            for k in range(substeps):
                for j in range(n):
                    v[j] += h / 2 * a[j]
                    u[j] += h * v[j]
                slope(t + ((i - 1) * substeps + k + 1) * h, u, v, p, a)
                for j in range(n):
                    v[j] += h / 2 * a[j]
            states[i, :n], states[i, n:] = u, v

    def run(h: float) -> Answer:
        substeps = round((times[1] - times[0]) / h)
        begin = time.perf_counter()
        states = np.empty((len(times), 2 * u0.size))
        solve(times[0], h, substeps, u0.flatten(), v0.flatten(), p, states)
        return Answer.of(time.perf_counter() - begin, states.T, times, (len(times) - 1) * substeps + 1, True)

    return lambda h: partial(run, h)
