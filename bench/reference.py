"""The trajectories that errors are measured against, and the errors of a run."""

import weakref
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from eig3.problem import Problem
from eig3.problems.hertz_impact import contact_time, largest_indentation
from eig3.result.solution import Solution

from .rivals.expressions import EXPRESSIONS
from .rivals.general import scipy_form
from .rivals.rival import Answer, is_installed
from .rivals.symbolic import heyoka_form

METRICS = {
    "trajectory": "max |u - u(t)| / max |u|",
    "energy": "max |E - E0| / |E0|",
    "continuum": "max |u - u(x, t)| / max |u|, against the continuous bar: errors in space and in time",
}
_CHECK_STEPS = 1000  # of RK4 for each radian of the fastest oscillation: its phase error is then 1e-14 per radian
_CHECK_STATES = 200
_FEW = 20  # degrees of freedom for which heyoka compiles in short time
_SHORT_CODE = 6  # degrees of freedom for which heyoka compiles straight code in short time
_TAYLOR = 1e-19  # the tightest tolerance in extended precision
_known: weakref.WeakKeyDictionary[Problem, "Reference"] = weakref.WeakKeyDictionary()


@dataclass(frozen=True)
class Reference:
    """The true u(t) of a problem, where it comes from, and its uncertainty relative to max |u|."""

    u: Callable[[np.ndarray], np.ndarray]
    source: str
    uncertainty: float


def reference(problem: Problem, omega: float) -> Reference:
    """The exact solution, or else DOP853 with its tightest tolerance, checked against RK4 with tiny steps.

    Problems with few degrees of freedom have Taylor series in extended precision instead, if heyoka is installed: the
    round-off of DOP853 can be larger than its difference from RK4. `omega` is the highest angular frequency of the
    problem, rad/s. A result is kept as long as its problem exists.
    """
    if problem not in _known:
        if problem.exact:
            _known[problem] = exact_reference(problem)
        elif problem.name == "hertz_impact":
            _known[problem] = _hertz(problem)
        elif problem.name in EXPRESSIONS and np.size(problem.u0) <= _FEW and is_installed("heyoka"):
            _known[problem] = _taylor(problem)
        else:
            _known[problem] = _checked_dop853(problem, omega)
    return _known[problem]


def exact_reference(problem: Problem) -> Reference:
    """The exact solution of a problem that has one."""
    exact = problem.exact
    assert exact is not None
    return Reference(lambda t: exact(t)[0], "exact solution", 1e-12)  # the round-off of sines of phases up to 1e4


def _hertz(problem: Problem) -> Reference:
    """The motion through a contact, by the inverse of the incomplete beta function, and the free flight after it."""
    from scipy.special import betaincinv

    stiffness, speed = float(np.ravel(problem.params)[0]), -float(np.ravel(problem.v0)[0])
    deepest, half = largest_indentation(stiffness, speed), contact_time(stiffness, speed) / 2

    def u(t: np.ndarray) -> np.ndarray:
        part = np.clip(1 - np.abs(t - half) / half, 0, 1)
        return np.where(t < 2 * half, -deepest * betaincinv(0.4, 0.5, part) ** 0.4, speed * (t - 2 * half))

    return Reference(u, "exact solution", 1e-14)  # the round-off of a few operations


def _taylor(problem: Problem) -> Reference:
    """Taylor series of heyoka in extended precision, compared with a hundred times their tolerance."""
    import heyoka

    real = np.longdouble
    system, y0 = heyoka_form(problem, real)
    n = len(y0) // 2

    def solved(tolerance: float) -> Callable[[np.ndarray], np.ndarray]:
        start = real(problem.t_span[0])
        solver = heyoka.taylor_adaptive(
            system, y0, time=start, tol=real(tolerance), fp_type=real, compact_mode=n > _SHORT_CODE
        )
        series = solver.propagate_until(real(problem.t_span[1]), c_output=True)[4]

        def u(t: np.ndarray) -> np.ndarray:
            states = series(np.ravel(t).astype(real))[:, :n].astype(np.float64)
            return states.reshape(np.shape(t) + ((n,) if np.ndim(problem.u0) else ()))

        return u

    u = solved(_TAYLOR)
    times = np.linspace(*problem.t_span, _CHECK_STATES)
    difference = float(np.abs(u(times) - solved(100 * _TAYLOR)(times)).max() / np.abs(u(times)).max())
    uncertainty = max(difference, float(np.finfo(np.float64).eps))
    return Reference(u, "Taylor series of heyoka in extended precision", uncertainty)


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
            with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
                found[metric] = float(np.abs(u - true).max() / np.abs(true).max())
        return found

    def of_run(self, solution: Solution) -> dict[str, float]:
        """The errors of the saved states of a run of the library."""
        return self._of_states(solution.t, solution.u, solution.v)

    def of_answer(self, times: np.ndarray, answer: Answer) -> dict[str, float]:
        """The errors of a run of a rival."""
        return self._of_states(times, answer.u, answer.v)

    def _of_states(self, t: np.ndarray, u: np.ndarray, v: np.ndarray) -> dict[str, float]:
        errors = self.errors(t, u)
        if self.problem.energy is not None:
            energies = self.problem.energy_of(u, v, t)
            with np.errstate(over="ignore", invalid="ignore"):  # of a motion that grows
                errors["energy"] = float(np.abs(energies / energies[0] - 1).max())
        return errors
