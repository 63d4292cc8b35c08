"""Order of convergence by step halving, where order silently drops: damping, forcing and gyroscopic terms.

Tolerance 0.15 on the order: the next term of the error expansion changes the ratio by O(h), a few percent at these
steps.
"""

import numpy as np
import pytest

import eig3

from .conftest import gyroscope


def observed_order(error_at, h):
    return np.log2(error_at(h) / error_at(h / 2))


def test_damped_forced_oscillator(method):
    problem = eig3.problems.single_dof(omega=2.0, xi=0.2, force=3.0, force_omega=1.3, v0=0.5, t_end=5.0)

    def error(h):
        solution = problem.integrate(h=h, method=method)
        u, v = problem.exact(solution.t)
        return max(np.abs(solution.u - u).max(), np.abs(solution.v - v).max())

    assert observed_order(error, 5 / 512) == pytest.approx(method.order, abs=0.15)


def test_spring_pendulum(method):
    problem = eig3.problems.spring_pendulum(t_end=1.0)
    reference = problem.integrate(h=2e-5, method="rk4", save_every=None)

    def error(h):
        run = problem.integrate(h=h, method=method, save_every=None, invariants={})  # the kernel of the gyroscope
        return np.abs(run.u[-1] - reference.u[-1]).max()

    # lagged CD amplifies the gyroscopic motion, so its own second-order term fades later
    assert observed_order(error, 1 / 2000) == pytest.approx(method.order, abs=0.15)


def test_gyroscope(method):
    """v' = i kappa v turns v at the rate kappa."""
    kappa, t_end = 2.0, 3.0

    def error(h):
        solution = eig3.integrate(gyroscope, (0, t_end), [0.0, 0.0], [1.0, 0.0], h=h, params=kappa, method=method)
        exact = np.exp(1j * kappa * solution.t)
        return np.abs(solution.v[:, 0] + 1j * solution.v[:, 1] - exact).max()

    assert observed_order(error, t_end / 1024) == pytest.approx(method.order, abs=0.15)


def test_eig3_with_another_beta_is_of_first_order():
    problem = eig3.problems.single_dof(omega=2.0, xi=0.2, t_end=5.0)
    method = eig3.EIG3(alpha=1.0, beta=0.7)

    def error(h):
        return abs(problem.integrate(h=h, method=method, save_every=None).u[-1] - problem.exact(5.0)[0])

    assert method.order == 1
    assert observed_order(error, 5 / 4096) == pytest.approx(1, abs=0.15)
