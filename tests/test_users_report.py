"""`eig3.report` of a user's own problem."""

import numpy as np
import pytest

import eig3
from eig3.bench.reach import reach
from eig3.bench.report.record import Record

pytestmark = pytest.mark.system

spring = eig3.jit(lambda t, u, v, p: -p[0] * u)
energy = eig3.jit(lambda t, u, v, p: 0.5 * (v * v + p[0] * u * u))


def oscillator(**fields):
    return eig3.Problem("oscillator", spring, 1.0, 0.0, [4.0], (0.0, 20.0), **fields)


def exact(t):
    return np.cos(2 * t), -2 * np.sin(2 * t)


@pytest.mark.usefixtures("few_reported")
def test_a_users_problem_is_judged_by_its_exact_solution(tmp_path):
    problem = oscillator(exact=exact, energy=energy)
    page = eig3.report(problem, tmp_path / "new", accuracies=(1e-3, 1e-6), rivals=("scipy dop853",), repeats=2)
    assert page == tmp_path / "new" / "report.html"
    assert "oscillator" in page.read_text()
    (result,) = Record.open(page.parent).results
    assert result.source == "exact solution"
    assert result.modes == ["prepared", "pointer"]
    assert result.metrics == ["trajectory", "energy"]
    assert "EIG-3" in " ".join([*result.methods.values(), *result.skipped])
    fixed = [point for point in result.points if point.stable and point.n_steps]
    for point in fixed:
        run = problem.integrate(h=point.setting, method=point.method, invariants_every=1)
        worst = np.abs(run.u - exact(run.t)[0]).max()
        # they are compared at 61 states or more of a motion of 6 periods, which miss little of the largest, and kept
        # with five digits
        assert 0.8 * worst <= point.errors["trajectory"] <= worst * (1 + 1e-4) + 1e-13
        assert point.errors["energy"] == pytest.approx(run.drift["energy"] / 2, rel=1e-4, abs=1e-12)
    assert len(fixed) > 10
    for method in result.methods:
        for mode in result.modes:
            swept = result.in_mode(mode)
            loose, tight = (reach(swept, method, "trajectory", target) for target in result.targets)
            assert not (tight and loose) or tight.setting <= loose.setting
    assert any(reach(result.in_mode("prepared"), method, "trajectory", 1e-6) for method in result.methods)
    assert reach(result, "scipy dop853", "trajectory", 1e-6)
