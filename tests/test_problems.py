"""The problems: their constants do what they say, exact solutions solve them, energies are constant along them."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eig3
from eig3 import problems

PROBLEMS = [problems.single_dof, problems.hardening_spring, problems.softening_spring, problems.spring_pendulum]


def acceleration(problem, t, u, v):
    p = np.array(problem.params, dtype=float)
    if np.ndim(problem.u0) == 0:
        return problem.rhs(t, u, v, p)
    a = np.empty(len(u))
    problem.rhs(t, u, v, p, a)
    return a


@pytest.mark.parametrize("build", PROBLEMS)
def test_energy_is_constant_along_the_motion(build):
    """dE/dt by central differences along (v, a) vanishes, at random states."""
    problem = build()
    p = np.array(problem.params, dtype=float)
    random = np.random.default_rng(1)
    for _ in range(20):
        u = np.asarray(problem.u0) + random.normal(scale=0.1, size=np.shape(problem.u0))
        v = random.normal(size=np.shape(problem.v0))
        u, v = (float(u), float(v)) if np.ndim(u) == 0 else (u, v)
        a = acceleration(problem, 0.0, u, v)
        dt = 1e-6
        ends = [problem.energy(0.0, u + s * dt * v, v + s * dt * a, p) for s in (1, -1)]
        scale = np.abs(np.sum(np.asarray(v) * a)) + 1  # the two powers that cancel
        # differences err by eps E / dt, some 1e-8 for E up to 1e3
        assert abs(ends[0] - ends[1]) / (2 * dt) < 1e-6 * scale


@pytest.mark.parametrize("build", PROBLEMS)
def test_against_dop853(build):
    problem = build()
    n = np.size(problem.u0)

    def first_order(t, y):
        u, v = (y[0], y[1]) if np.ndim(problem.u0) == 0 else (y[:n], y[n:])
        return np.concatenate([np.atleast_1d(v), np.atleast_1d(acceleration(problem, t, u, v))])

    y0 = np.concatenate([np.atleast_1d(problem.u0), np.atleast_1d(problem.v0)])
    reference = solve_ivp(first_order, (0, 1), y0, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    run = problem.integrate(h=1e-4, t_end=1.0, method="rk4", save_every=None)
    ours = np.concatenate([np.atleast_1d(run.u[-1]), np.atleast_1d(run.v[-1])])
    np.testing.assert_allclose(ours, reference, rtol=0, atol=1e-6)  # hardening: (omega h)^4 over 7 periods


def test_periods_of_the_springs():
    """Back where it started after the period the article prints; to 1e-6 since that is its last digit."""
    for problem, period in ((problems.hardening_spring(), 0.1515328), (problems.softening_spring(), 1.1418763)):
        run = problem.integrate(h=period / 20000, t_end=period, method="rk4", save_every=None)
        assert run.u[-1] == pytest.approx(run.u[0], abs=1e-6)
        assert run.v[-1] == pytest.approx(0, abs=1e-3)


@pytest.mark.parametrize("xi", [0.0, 0.05, 0.7, 1.0, 2.5])
@pytest.mark.parametrize(("force", "force_omega"), [(0.0, 0.0), (2.0, 0.0), (2.0, 3.1), (2.0, 2.0)])
def test_exact_solution_of_the_oscillator(xi, force, force_omega):
    """Against RK4 at a step where its error is (omega h)^4 t / 120 = 1e-11; resonance and xi = 1 among the cases."""
    problem = problems.single_dof(2.0, xi, force, force_omega, u0=0.7, v0=-1.3, t_end=10.0)
    run = problem.integrate(h=1e-3, method="rk4")
    u, v = problem.exact(run.t)
    np.testing.assert_allclose(run.u, u, rtol=0, atol=1e-9)
    np.testing.assert_allclose(run.v, v, rtol=0, atol=1e-9)


def test_only_the_effects_named_are_compiled():
    assert problems.single_dof().rhs is not problems.single_dof(xi=0.1).rhs
    assert problems.single_dof(xi=0.1).uses_velocity
    assert not problems.single_dof(force=1.0).uses_velocity
    assert problems.single_dof(xi=0.1).energy is None
    assert problems.single_dof().energy is not None


def test_eig3_takes_its_staggered_form_where_nothing_reads_the_velocity():
    assert problems.hardening_spring().method("EIG3").velocity == "none"
    assert problems.spring_pendulum().method("eig3").velocity == "explicit"
    assert problems.hardening_spring().method(eig3.EIG3()).velocity == "explicit"


def test_cd_takes_its_explicit_form_where_nothing_reads_the_velocity():
    assert problems.single_dof().integrate(h=0.1, method="cd", t_end=10).n_newton == 0
    assert problems.single_dof(xi=0.1).integrate(h=0.1, method="cd", t_end=10).n_newton > 0
    explicit = eig3.CentralDifference()
    assert problems.single_dof().integrate(h=0.1, method=explicit, t_end=10).method is explicit


def test_constants_are_the_articles():
    assert problems.single_dof().params[0] == 4.0
    assert problems.hardening_spring().params == (100.0, 10.0)
    assert problems.softening_spring().params == (100.0,)
    assert problems.spring_pendulum().params == (1.0, 0.5, 98.1, 9.81)
    assert problems.spring_pendulum().u0 == (0.75, math.pi / 2)


def test_bad_frequency_is_refused():
    with pytest.raises(ValueError, match="omega must be positive, not 0"):
        problems.single_dof(omega=0)


def test_invariants_can_be_replaced():
    run = problems.single_dof().integrate(h=0.1, t_end=10, invariants={})
    assert run.drift == {}
