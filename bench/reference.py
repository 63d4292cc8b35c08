"""The trajectories that errors are measured against."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eig3.problem import Problem

from .rivals import scipy_form

_CHECK_STEPS = 1000  # of RK4 a radian of the fastest oscillation: its phase error is then 1e-14 a radian
_CHECK_STATES = 200
_known: weakref.WeakKeyDictionary[Problem, "Reference"] = weakref.WeakKeyDictionary()


@dataclass(frozen=True)
class Reference:
    """``u(t)`` of a problem, from where, and how far it may be from the truth, as a part of max |u|."""

    u: Callable[[np.ndarray], np.ndarray]
    source: str
    uncertainty: float


def reference(problem: Problem, omega: float) -> Reference:
    """The exact solution; without one DOP853 at its tightest, checked against RK4 at tiny steps.

    `omega` is the highest angular frequency of the problem. What has been computed is kept as long as the problem is.
    """
    if problem not in _known:
        _known[problem] = _exact(problem) if problem.exact else _checked_dop853(problem, omega)
    return _known[problem]


def _exact(problem: Problem) -> Reference:
    exact = problem.exact
    assert exact is not None
    return Reference(lambda t: exact(t)[0], "exact solution", 1e-12)  # of sines of phases up to 1e4


def _checked_dop853(problem: Problem, omega: float) -> Reference:
    from scipy.integrate import solve_ivp

    y0, f = scipy_form(problem)
    size = float(max(np.abs(problem.u0).max(), np.abs(problem.v0).max()))
    dense = solve_ivp(f, problem.t_span, y0, "DOP853", rtol=3e-14, atol=1e-16 * size, dense_output=True).sol
    n = len(y0) // 2

    def u(t: np.ndarray) -> np.ndarray:
        return dense(t)[0] if n == 1 else dense(t)[:n].T

    n_steps = int(np.ceil((problem.t_span[1] - problem.t_span[0]) * omega * _CHECK_STEPS))
    check = problem.integrate(
        h=(problem.t_span[1] - problem.t_span[0]) / n_steps,
        method="rk4",
        save_every=max(1, n_steps // _CHECK_STATES),
        invariants={},
    )
    difference = float(np.abs(u(check.t) - check.u).max() / np.abs(check.u).max())
    return Reference(u, "SciPy DOP853 at rtol 3e-14, checked against RK4 at tiny steps", difference)
