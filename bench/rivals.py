"""Adaptive solvers that a user could choose instead, each with its best settings, on the same problems.

Every rival returns the states at given times by its own dense output. Its time does not include compiling.
"""

from __future__ import annotations

import importlib.util
import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numba
import numpy as np

from eig3.functions.callbacks import jit
from eig3.functions.checks import check_params
from eig3.problem import Problem

from .rival_events import HEYOKA_EVENTS, restarted, states

_ENDLESS = 1_000_000  # evaluations; SciPy takes some 8 s for them


@dataclass(frozen=True)
class Answer:
    """One run of a rival: seconds, states at the given times, and evaluations if the rival counts them."""

    seconds: float
    u: np.ndarray
    v: np.ndarray
    evaluations: int | None
    success: bool


@dataclass(frozen=True)
class Rival:
    """A solver. ``prepare(problem, times)(tolerance)`` returns a function without arguments that makes a run."""

    label: str
    package: str
    prepare: Callable[..., Callable[[float], Callable[[], Answer]]]
    tolerances: Sequence[float] = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-13, 3e-14)
    most_degrees: int = 10_000  # with more degrees of freedom the solver takes too long

    @property
    def is_installed(self) -> bool:
        return importlib.util.find_spec(self.package) is not None


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


def _scipy(method: str, problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
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
        return _answer(seconds, states(results), times, sum(r.nfev for r in results), results[-1].success)

    return lambda tolerance: partial(run, tolerance)


def _cyrk(method: str, problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
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
        return _answer(seconds, result.y.copy(), times, None, result.success)

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
        return _answer(time.perf_counter() - begin, states(results), times, None, results[-1].success)

    return lambda tolerance: partial(run, tolerance)


def _heyoka(problem: Problem, times: np.ndarray) -> Callable[[float], Callable[[], Answer]]:
    import heyoka

    system, y0 = heyoka_form(problem)

    def at(tolerance: float) -> Callable[[], Answer]:
        u, v = ([variable for variable, _ in half] for half in (system[: len(y0) // 2], system[len(y0) // 2 :]))
        events = HEYOKA_EVENTS.get(problem.name, _none)(heyoka, u, v, problem, tolerance)
        # without compact mode a large system takes minutes to compile
        solver = heyoka.taylor_adaptive(system, y0, tol=tolerance, compact_mode=len(u) > 20, t_events=events)

        def run() -> Answer:
            solver.time = times[0]
            solver.state[:] = y0
            if events:
                solver.pars[:] = 0
                solver.reset_cooldowns()
            begin = time.perf_counter()
            outcome, *_, states = solver.propagate_grid(times)
            seconds = time.perf_counter() - begin
            return _answer(seconds, states.T, times, None, outcome == heyoka.taylor_outcome.time_limit)

        return run

    return at


def heyoka_form(problem: Problem, real: Any = float) -> tuple[list[tuple], list]:
    """The first-order system in heyoka's symbols, and y0 = (u0, v0), with constants of the type `real`."""
    import heyoka

    y0, params, _ = first_order(problem)
    n = len(y0) // 2
    u, v = ([heyoka.make_vars(f"{letter}{j}") for j in range(n)] for letter in "uv")
    accelerations = EXPRESSIONS[problem.name](heyoka, u, v, [real(x) for x in params])
    return [*zip(u, v, strict=True), *zip(v, accelerations, strict=True)], [real(x) for x in y0]


def _none(*arguments: Any) -> list:
    return []


def absolute(tolerance: float, problem: Problem) -> float:
    """The absolute tolerance: the relative one of the size of the initial state.

    With a hundredth of it, DOP853 takes up to 40 % more evaluations to an error, and nowhere 10 % fewer.
    """
    size = float(max(np.abs(problem.u0).max(), np.abs(problem.v0).max()))
    return tolerance * (size or 1.0)  # of a motion that starts at rest, nothing is known


def _answer(seconds: float, y: np.ndarray, times: np.ndarray, evaluations: int | None, success: bool) -> Answer:
    n = len(y) // 2
    u, v = (y[0], y[1]) if n == 1 else (y[:n].T, y[n:].T)
    success = bool(success) and len(u) == len(times) and bool(np.isfinite(u).all())
    return Answer(seconds, u, v, evaluations, success)


def _single_dof(heyoka, u, v, p):
    return [-p[0] * p[0] * u[0]]


def _hardening_spring(heyoka, u, v, p):
    return [-p[0] * u[0] * (1.0 + p[1] * u[0] * u[0])]


def _softening_spring(heyoka, u, v, p):
    return [-p[0] * heyoka.tanh(u[0])]


def _spring_pendulum(heyoka, u, v, p):
    m, l0, k, g = p
    return [
        u[0] * v[1] * v[1] - k / m * (u[0] - l0) + g * heyoka.cos(u[1]),
        -(2.0 * v[0] * v[1] + g * heyoka.sin(u[1])) / u[0],
    ]


def _henon_heiles(heyoka, u, v, p):
    x, y = u
    return [-x - 2.0 * x * y, -y - x * x + y * y]


def _rotor(heyoka, u, v, p):
    x, y = u
    square, beta, speed = p
    stiffness = square * (1.0 + beta * (x * x + y * y)) - speed * speed
    return [2.0 * speed * v[1] - stiffness * x, -2.0 * speed * v[0] - stiffness * y]


def _kepler(heyoka, u, v, p):
    pull = p[0] * (u[0] * u[0] + u[1] * u[1]) ** -1.5
    return [-pull * u[0], -pull * u[1]]


def _double_pendulum(heyoka, u, v, p):
    m1, m2, l1, l2, g = p
    m, sine, cosine = m1 + m2, heyoka.sin(u[0] - u[1]), heyoka.cos(u[0] - u[1])
    sine1, sine2 = heyoka.sin(u[0]), heyoka.sin(u[1])
    pull1, pull2 = l1 * v[0] * v[0], l2 * v[1] * v[1]
    inertia = m1 + m2 * sine * sine
    return [
        -(m2 * sine * (pull1 * cosine + pull2) + g * (m * sine1 - m2 * sine2 * cosine)) / (l1 * inertia),
        (sine * (m * pull1 + m2 * pull2 * cosine) + m * g * (sine1 * cosine - sine2)) / (l2 * inertia),
    ]


def _duffing(heyoka, u, v, p):
    a, b, delta, gamma, omega = p
    return [gamma * heyoka.cos(omega * heyoka.time) - u[0] * (a + b * u[0] * u[0]) - delta * v[0]]


def _van_der_pol(heyoka, u, v, p):
    return [p[0] * (1.0 - u[0] * u[0]) * v[0] - u[0]]


def _arenstorf(heyoka, u, v, p):
    (x, y), mu = u, p[0]
    to_earth, to_moon = x + mu, x - (1 - mu)
    earth = (1 - mu) * (to_earth * to_earth + y * y) ** -1.5
    moon = mu * (to_moon * to_moon + y * y) ** -1.5
    return [x + 2.0 * v[1] - earth * to_earth - moon * to_moon, y - 2.0 * v[0] - (earth + moon) * y]


def _hertz_impact(heyoka, u, v, p):
    """The event that switches the force on and off writes heyoka's own parameter 0."""
    touches = heyoka.gt(heyoka.par[0], 0.5)
    indentation = heyoka.select(touches, -u[0], 1.0)
    return [heyoka.select(touches, p[0] * indentation * heyoka.sqrt(indentation), 0.0)]


def _bouncing_ball(heyoka, u, v, p):
    return [heyoka.expression(-p[0])]


def _second_differences(u):
    return [(u[j - 1] if j else 0.0) - 2.0 * u[j] + (u[j + 1] if j < len(u) - 1 else 0.0) for j in range(len(u))]


def _elastic_bar(heyoka, u, v, p):
    return [p[0] * bent for bent in _second_differences(u)]


def _damped_bar(heyoka, u, v, p):
    pairs = zip(_second_differences(u), _second_differences(v), strict=True)
    return [p[0] * bent + p[1] * rate for bent, rate in pairs]


def _hardening_chain(heyoka, u, v, p):
    stretches = [u[0], *(u[j + 1] - u[j] for j in range(len(u) - 1))]
    forces = [p[0] * stretch * (1.0 + p[1] * stretch * stretch) for stretch in stretches]
    return [(forces[j + 1] if j < len(u) - 1 else 0.0) - forces[j] for j in range(len(u))]


#: The problems as heyoka needs them, in symbols: ``(heyoka, u, v, params) -> accelerations``.
EXPRESSIONS = {
    "single_dof": _single_dof,
    "hardening_spring": _hardening_spring,
    "softening_spring": _softening_spring,
    "spring_pendulum": _spring_pendulum,
    "henon_heiles": _henon_heiles,
    "rotor": _rotor,
    "kepler": _kepler,
    "double_pendulum": _double_pendulum,
    "duffing": _duffing,
    "van_der_pol": _van_der_pol,
    "arenstorf": _arenstorf,
    "hertz_impact": _hertz_impact,
    "bouncing_ball": _bouncing_ball,
    "elastic_bar": _elastic_bar,
    "damped_bar": _damped_bar,
    "hardening_chain": _hardening_chain,
}

RIVALS = {
    "scipy dop853": Rival("SciPy DOP853", "scipy", partial(_scipy, "DOP853")),
    "scipy rk45": Rival("SciPy RK45", "scipy", partial(_scipy, "RK45")),
    "scipy lsoda": Rival("SciPy LSODA", "scipy", partial(_scipy, "LSODA"), most_degrees=300),
    "heyoka": Rival("heyoka", "heyoka", _heyoka, tuple(10.0**-k for k in (3, 5, 7, 9, 11, 13, 15))),
    "cyrk dop853": Rival("CyRK DOP853", "CyRK", partial(_cyrk, "DOP853")),
    "cyrk vern8": Rival("CyRK Vern8", "CyRK", partial(_cyrk, "Vern8")),
}
