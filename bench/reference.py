"""The trajectories that errors are measured against, and the errors of a run."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eig3.problem import Problem
from eig3.solution import Solution

from .rivals import Answer, scipy_form

METRICS = {
    "trajectory": "max |u - u(t)| / max |u|",
    "energy": "max |E - E0| / |E0|",
    "continuum": "max |u - u(x, t)| / max |u|, against the continuous bar: errors in space and in time",
}
_CHECK_STEPS = 1000  # of RK4 for each radian of the fastest oscillation: its phase error is then 1e-14 per radian
_CHECK_STATES = 200
_known: weakref.WeakKeyDictionary[Problem, "Reference"] = weakref.WeakKeyDictionary()


@dataclass(frozen=True)
class Reference:
    """The true u(t) of a problem, where it comes from, and its uncertainty relative to max |u|."""

    u: Callable[[np.ndarray], np.ndarray]
    source: str
    uncertainty: float


def reference(problem: Problem, omega: float) -> Reference:
    """The exact solution, or else DOP853 with its tightest tolerance, checked against RK4 with tiny steps.

    `omega` is the highest angular frequency of the problem, rad/s. A result is kept as long as its problem exists.
    """
    if problem not in _known:
        _known[problem] = _exact(problem) if problem.exact else _checked_dop853(problem, omega)
    return _known[problem]


def _exact(problem: Problem) -> Reference:
    exact = problem.exact
    assert exact is not None
    return Reference(lambda t: exact(t)[0], "exact solution", 1e-12)  # the round-off of sines of phases up to 1e4


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


class Judge:
    """Measures the errors of runs of one problem, in every metric that the problem has."""

    def __init__(self, problem: Problem, truth: Reference) -> None:
        self.problem = problem
        self.truths: dict[str, Callable[[np.ndarray], np.ndarray]] = {"trajectory": truth.u}
        if problem.continuum is not None:
            continuum = problem.continuum
            self.truths["continuum"] = lambda t: continuum(t)[0]

    def errors(self, t: np.ndarray, u: np.ndarray) -> dict[str, float]:
        """The errors of displacements u, shape (m,) or (m, n), at the times t, shape (m,)."""
        found = {}
        for metric, truth in self.truths.items():
            true = truth(t)
            with np.errstate(over="ignore", invalid="ignore"):
                found[metric] = float(np.abs(u - true).max() / np.abs(true).max())
        return found

    def of_run(self, solution: Solution) -> dict[str, float]:
        """The errors of a run of the library."""
        errors = self.errors(solution.t, solution.u)
        if "energy" in solution.drift:
            errors["energy"] = solution.drift["energy"] / abs(self.problem.energy_of(self.problem.u0, self.problem.v0))
        return errors

    def of_answer(self, times: np.ndarray, answer: Answer) -> dict[str, float]:
        """The errors of a run of a rival."""
        errors = self.errors(times, answer.u)
        if self.problem.energy is not None:
            energies = np.array([self.problem.energy_of(u, v) for u, v in zip(answer.u, answer.v, strict=True)])
            errors["energy"] = float(np.abs(energies / energies[0] - 1).max())
        return errors
