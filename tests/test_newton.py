"""The linear solve and the Newton iteration of CD."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import eig3
from eig3.kernels.methods import ldu
from eig3.stability import limit

from .conftest import oscillator


@eig3.jit
def solve(matrix, b):
    n = b.size
    row_swaps, column_swaps = np.empty(n), np.empty(n)
    if not ldu.factorise(matrix, n, row_swaps, column_swaps):
        return False
    ldu.solve(matrix, n, row_swaps, column_swaps, b)
    return True


@settings(deadline=None)
@given(
    st.integers(1, 8).flatmap(
        lambda n: arrays(np.float64, (n, n + 1), elements=st.floats(-1, 1).map(lambda x: round(x, 3)))
    )
)
def test_ldu_solves(system):
    matrix, b = system[:, :-1].copy(), system[:, -1].copy()
    condition = np.linalg.cond(matrix)
    assume(condition < 1e6)
    x = b.copy()
    assert solve(matrix.copy(), x)
    # backward stable: the forward error is the condition times a modest multiple of the round-off
    assert np.abs(x - np.linalg.solve(matrix, b)).max() <= 1e-14 * condition * max(np.abs(x).max(), 1e-300)


def test_ldu_needs_both_permutations():
    matrix = np.array([[0.0, 1e-3, 5.0], [0.0, 0.0, 1.0], [2.0, 0.0, 0.0]])
    b = np.array([1.0, 2.0, 3.0])
    x = b.copy()
    assert solve(matrix.copy(), x)
    np.testing.assert_allclose(matrix @ x, b, rtol=1e-14)


@pytest.mark.parametrize("matrix", [np.zeros((2, 2)), np.ones((3, 3)), np.diag([1.0, 0.0, 2.0])])
def test_ldu_detects_a_singular_matrix(matrix):
    assert not solve(matrix.copy(), np.ones(len(matrix)))


@eig3.jit
def drag(t, u, v, p, a):
    speed = np.sqrt(v[0] * v[0] + v[1] * v[1])
    a[0] = -u[0] - p[0] * speed * v[0]
    a[1] = -2 * u[1] - p[0] * speed * v[1]


@eig3.jit
def drag_jacobian(t, u, v, p, J):
    speed = np.sqrt(v[0] * v[0] + v[1] * v[1])
    if speed > 0:
        for i in range(2):
            for j in range(2):
                J[i, j] = -p[0] * v[i] * v[j] / speed
            J[i, i] -= p[0] * speed


cubic = eig3.jit(lambda t, u, v, p: -u - p[0] * v * v * v)
cubic_jacobian = eig3.jit(lambda t, u, v, p: -3 * p[0] * v * v)


@pytest.mark.parametrize(
    ("rhs", "jacobian", "u0", "v0"), [(drag, drag_jacobian, [1.0, 0.0], [0.0, 1.0]), (cubic, cubic_jacobian, 1.0, 2.0)]
)
def test_jacobian_gives_the_same_run_for_fewer_evaluations(rhs, jacobian, u0, v0):
    runs = [
        eig3.integrate(rhs, (0, 10), u0, v0, h=0.01, params=3.0, method=eig3.CentralDifference(jacobian=given))
        for given in (None, jacobian)
    ]
    np.testing.assert_allclose(runs[0].u, runs[1].u, rtol=0, atol=1e-11)
    assert runs[1].n_rhs < runs[0].n_rhs


def test_newton_holds_where_fixed_point_fails():
    """h xi omega = 5: fixed-point iteration diverges, and Newton's method converges."""
    options = {"h": 0.1, "params": (1.0, 50.0)}
    newton = eig3.integrate(oscillator, (0, 10), 1.0, 0.0, method=eig3.CentralDifference(), **options)
    assert newton.success
    method = eig3.CentralDifference(solver="fixed-point")
    fixed_point = eig3.integrate(oscillator, (0, 10), 1.0, 0.0, method=method, **options)
    assert fixed_point.status is not eig3.Status.COMPLETED


#: No root for Newton past t = 1: the sign of the residual's slope flips at every iterate.
rough = eig3.jit(lambda t, u, v, p: 0.0 if t < 1 else 1e6 * np.sin(1e9 * v))


def test_not_converged_reports_time_and_residual():
    method = eig3.CentralDifference(max_iterations=5)
    run = eig3.integrate(rough, (0, 2), 1.0, 1.0, h=0.01, method=method)
    assert run.status is eig3.Status.NOT_CONVERGED
    assert run.t[-1] == pytest.approx(0.99)
    assert "t = 1" in run.message
    assert "residual" in run.message
    assert np.isfinite(run.u).all()
    with pytest.raises(eig3.IntegrationError) as caught:
        eig3.integrate(rough, (0, 2), 1.0, 1.0, h=0.01, method=method, raise_on_failure=True)
    assert caught.value.solution.n_steps == run.n_steps


@eig3.jit
def singular_jacobian(t, u, v, p, J):
    J[0, 0] = J[1, 1] = 256.0  # I - h/2 J is exactly 0 for h = 1/128


def test_singular_jacobian_gives_not_converged():
    method = eig3.CentralDifference(jacobian=singular_jacobian)
    run = eig3.integrate(drag, (0, 1), [1.0, 0.0], [0.0, 1.0], h=1 / 128, params=1.0, method=method)
    assert run.status is eig3.Status.NOT_CONVERGED
    assert run.u.tolist() == [[1.0, 0.0]]
    assert run.at(0.0)[1].tolist() == [0.0, 1.0]


@eig3.jit
def grows(t, u, v, p):
    return 256.0 * v  # 1 - h/2 df/dv is exactly 0 for h = 1/128


@eig3.jit
def leaves_its_domain(t, u, v, p, a):
    """The force is finite at the first iterate, and NaN at the velocities of the differences."""
    a[0] = -np.sqrt(1.0 - v[0])
    a[1] = 0.0


@eig3.jit
def undefined_jacobian(t, u, v, p, J):
    J[0, 0] = J[1, 1] = (v[0] - v[0]) / (v[1] - v[1])


def test_a_solve_that_breaks_down_is_not_divergence():
    """Each run ends as NOT_CONVERGED: the solve failed, but the motion stayed finite."""
    newton = eig3.CentralDifference(solver="newton")
    runs = [
        eig3.integrate(grows, (0, 1), 1.0, 1.0, h=1 / 128, method=newton),
        eig3.integrate(leaves_its_domain, (0, 1), [0.0, 0.0], [1.0, 0.0], h=0.01, method=newton),
        eig3.integrate(
            drag,
            (0, 1),
            [0.0, 0.0],
            [0.0, 0.0],
            h=0.01,
            params=1.0,
            method=eig3.CentralDifference(jacobian=undefined_jacobian),
        ),
    ]
    for run in runs:
        assert run.status is eig3.Status.NOT_CONVERGED
        assert "did not converge" in run.message
        assert "solver='newton'" not in run.message


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_ldu_of_a_matrix_that_is_not_finite_ends(bad):
    for i in range(2):
        for j in range(2):
            matrix = np.eye(2)
            matrix[i, j] = bad
            b = np.ones(2)
            assert not solve(matrix, b) or not np.isfinite(b).all() or np.isinf(bad)


loaded = eig3.jit(lambda t, u, v, p: -p[1] * v - p[0] * u + p[2])


@eig3.jit
def loaded_vector(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -p[1] * v[j] - p[0] * u[j] + p[2]


@pytest.mark.parametrize("solver", ["newton", "fixed-point"])
@pytest.mark.parametrize(("k", "c"), [(100.0, 2.0), (1e4, 20.0), (1e4, 100.0)])
def test_a_system_settles_under_its_load(solver, k, c):
    """At rest v is only the round-off of f, so that no tolerance relative to v can be reached."""
    method = eig3.CentralDifference(solver=solver)
    for rhs, u0 in ((loaded, 0.0), (loaded_vector, np.zeros(5))):
        run = eig3.integrate(rhs, (0, 50), u0, np.zeros_like(u0), h=1e-3, params=(k, c, 9.81), method=method)
        assert run.success
        np.testing.assert_allclose(run.u[-1], 9.81 / k, rtol=1e-14)


def test_limit_of_fixed_point_is_where_it_converges():
    """The iteration contracts by xi Omega. Above 1 its solves fail, which must not count as stable."""
    method = eig3.CentralDifference(solver="fixed-point", max_iterations=10**5)
    assert limit(method, 0.25) == pytest.approx(2, abs=1e-6)
    assert limit(method, 1.0) == pytest.approx(1, abs=0.01)


far_away = eig3.jit(lambda t, u, v, p: -p[0] * (u - p[2]) - p[1] * v)


def test_a_large_position_does_not_loosen_the_solve():
    """The residual of v must be compared with v: here u is 1e6 times larger than v, and the step is very short."""

    def velocity(solver, offset):
        method = eig3.CentralDifference(solver=solver)
        params = (4.0, 100.0, offset)
        return eig3.integrate(far_away, (0, 1), offset, 1.0, h=1e-5, params=params, method=method, save_every=1000).v

    far = velocity("newton", 1e6)
    # the round-off of u, 1e-10 a step, is the same for both and makes 3e-8 of the force; the solves differ by less
    np.testing.assert_allclose(far, velocity("newton", 0.0), rtol=0, atol=1e-7)
    np.testing.assert_allclose(far, velocity("fixed-point", 1e6), rtol=0, atol=1e-12)
