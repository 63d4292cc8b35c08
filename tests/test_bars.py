"""Bars and chains: exact solutions solve the equations, and a step at the limit gives d'Alembert's solution."""

import numpy as np
import pytest

from eig3 import problems
from eig3.bench import bars
from eig3.cli import main
from eig3.methods import LIBRARY

from .test_problems import acceleration

BARS = [problems.elastic_bar, problems.damped_bar]


@pytest.mark.parametrize("build", BARS)
def test_exact_solution_starts_at_the_state_given_and_solves_the_equation(build):
    problem = build(n=40, width=0.1)
    u, v = problem.exact(0.0)
    np.testing.assert_allclose(u, problem.u0, atol=1e-13)
    np.testing.assert_allclose(v, problem.v0, atol=1e-6)  # the rates reach 5e5
    dt = 1e-10
    for t in (1e-5, 1.7e-4):
        u, v = problem.exact(t)
        (before, v_before), (after, v_after) = problem.exact(t - dt), problem.exact(t + dt)
        scale = np.abs(v).max()
        np.testing.assert_allclose((after - before) / (2 * dt), v, atol=1e-5 * scale)  # eps / dt / scale is 1e-10
        a = acceleration(problem, t, u, v)
        np.testing.assert_allclose((v_after - v_before) / (2 * dt), a, atol=1e-5 * np.abs(a).max())


@pytest.mark.parametrize("build", BARS)
def test_the_lumped_bar_tends_to_the_continuous_one_in_second_order(build):
    t = np.linspace(0, 4e-4, 21)
    errors = []
    for n in (99, 199, 399):
        problem = build(n=n, width=0.1, xi=1e-3 * (n + 1)) if build is problems.damped_bar else build(n=n, width=0.1)
        # xi belongs to the highest mode: with xi in proportion to n + 1 the material stays the same
        errors.append(np.abs(problem.exact(t)[0] - problem.continuum(t)[0]).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    assert (np.abs(ratios - 4) < 0.3).all()  # (dx / width)^2 is 1e-2 at the coarsest


@pytest.mark.parametrize("build", BARS)
def test_continuum_velocity_is_the_derivative_of_its_displacement(build):
    problem, dt, t = build(n=30, width=0.1), 1e-9, 1.1e-4
    slope = (problem.continuum(t + dt)[0] - problem.continuum(t - dt)[0]) / (2 * dt)
    v = problem.continuum(t)[1]
    np.testing.assert_allclose(v, slope, atol=1e-5 * np.abs(v).max())


@pytest.mark.parametrize("method", ["eig3", "cd"])
def test_a_step_at_the_limit_gives_dalemberts_solution(method):
    """Ten passes of the pulse at h = dx / c: both methods are exact there, up to the round-off of 2000 steps."""
    problem = problems.elastic_bar(n=199)
    solution = problem.integrate(h=1 / 200 / 5000, method=method)
    assert solution.success
    np.testing.assert_allclose(solution.u, problem.continuum(solution.t)[0], atol=1e-11)


@pytest.mark.parametrize(("method", "order"), [("eig3", 2), ("rk3", 3), ("rk4", 4), ("ab3", 3)])
def test_order_on_the_damped_bar(method, order):
    problem = problems.damped_bar(n=20, width=0.2, t_end=4e-4)
    steps = [1e-6 / 2**k for k in (1, 2)] if method == "rk4" else [1e-6 / 2**k for k in (3, 4)]
    errors = []
    for h in steps:
        solution = problem.integrate(h=h, method=method)
        errors.append(np.abs(solution.u - problem.exact(solution.t)[0]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(
        order, abs=0.15
    )  # the terms of the next order are small: omega h = 0.03


def test_a_bar_without_damping_is_the_elastic_one():
    t = np.linspace(0, 1e-3, 5)
    elastic, damped = problems.elastic_bar(n=50), problems.damped_bar(n=50, xi=0.0)
    for one, other in ((elastic.exact, damped.exact), (elastic.continuum, damped.continuum)):
        np.testing.assert_allclose(
            one(t)[0], other(t)[0], atol=1e-8
        )  # the pulse has 50 sines: the others add exp(-(50 pi/20)^2/2)


def test_energies_converge_on_the_chain():
    problem = problems.hardening_chain(n=20, t_end=1.0)
    drifts = [problem.integrate(h=h, method="eig3", save_every=None).drift["energy"] for h in (2e-4, 1e-4)]
    assert drifts[0] / drifts[1] == pytest.approx(4, abs=0.3)
    assert drifts[1] < 1e-3  # the energy is 1/2


@pytest.mark.parametrize("build", [*BARS, problems.hardening_chain])
def test_one_mass_is_refused(build):
    with pytest.raises(ValueError, match=r"n must be at least 2, not 1\."):
        build(n=1)


def test_negative_damping_is_refused():
    with pytest.raises(ValueError, match="xi must not be negative"):
        problems.damped_bar(xi=-0.1)


@pytest.mark.system
def test_command_compares_bars_of_several_sizes(capsys, monkeypatch):
    assert {*bars.METHODS_OF_BARS} <= {*LIBRARY}
    monkeypatch.setattr(bars, "METHODS_OF_BARS", ("cd", "rk4", "bm6", "eig4"))  # the others only compile more kernels
    monkeypatch.setattr(bars, "SIZES", {50: 20, 200: 10})
    assert main(["bench", "bars", "--repeats", "1"]) == 0
    lines = [
        line for line in capsys.readouterr().out.splitlines() if "RK4" in line and line.startswith(("| 50", "| 200"))
    ]
    assert [line.split("|")[-2].strip() for line in lines] == ["1.00", "1.00"]


def test_many_masses_are_set_up_in_the_memory_of_a_few_vectors():
    problem = problems.elastic_bar(n=2 * 10**5)  # a matrix would need 320 GB
    u, v = problem.exact(0.0)
    np.testing.assert_allclose(u, problem.u0, atol=1e-12)
    assert np.abs(v).max() < 1e-3  # round-off of a sum of 2e5 modes of size 5e4
