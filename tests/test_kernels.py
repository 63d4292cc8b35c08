"""Each kernel, compared with the definition of its method and with its other forms."""

import ctypes
import sys
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3.kernels.loops import fixed
from eig3.kernels.loops.formulas import formulas
from eig3.kernels.protocol import VECTOR
from eig3.stability import amplification_matrix

from .conftest import ALL_METHODS, WITHOUT_VELOCITY, coupled, hardening, hardening_chain, oscillator, oscillator_vector

#: One with a row of the past, one whose steps can fail, one of several evaluations, and one with starting steps. The
#: inline kernels of the other methods are the same loops with other formulas, which pointer mode tests.
OF_EACH_KIND = [eig3.EIG3(), eig3.CentralDifference(solver="newton"), eig3.RK4(), eig3.AB3()]
#: The two forms, as rhs, u0 and v0.
FORMS = (oscillator, 1.0, 0.2), (coupled, [0.1, 0.2, -0.3], [0.0, 0.1, 0.0])

finite = st.floats(-2, 2)
frequencies = st.floats(0.01, 3)
dampings = st.floats(0, 1.5)


def taylor_polynomial(A, degree):
    """exp(A) up to A^degree: one step of every Runge-Kutta method of that order and number of stages."""
    term = total = np.eye(len(A))
    for k in range(1, degree + 1):
        term = term @ A / k
        total = total + term
    return total


def matrix_of(method, Omega, xi):
    """The method's formula on the oscillator, h = 1, on the state its kernel carries; typed in here independently."""
    a = np.array([-(Omega**2), -2 * xi * Omega])
    A = np.array([[0, 1], a])
    if isinstance(method, eig3.EIG3):
        alpha, beta = method.alpha, method.beta
        return np.array(
            [
                [1 + a[0] / 2 * (1 + alpha), 1 + a[1] / 2 * (1 + alpha), -alpha / 2],
                [a[0] * (1 + beta), 1 + a[1] * (1 + beta), -beta],
                [a[0], a[1], 0],
            ]
        )
    if isinstance(method, eig3.RK2 | eig3.RK3 | eig3.RK4):
        return taylor_polynomial(A, method.order)
    if isinstance(method, eig3.AB2):
        return np.block([[np.eye(2) + 1.5 * A, -0.5 * np.eye(2)], [A, np.zeros((2, 2))]])
    if isinstance(method, eig3.AB3):
        one, zero = np.eye(2), np.zeros((2, 2))
        return np.block([[one + 23 / 12 * A, -16 / 12 * one, 5 / 12 * one], [A, zero, zero], [zero, one, zero]])
    raise NotImplementedError


@settings(deadline=None)
@given(alpha=finite, beta=finite, Omega=frequencies, xi=dampings)
def test_eig3_step_is_its_matrix(alpha, beta, Omega, xi):
    method = eig3.EIG3(alpha, beta)
    # a dozen multiplications of numbers up to (Omega^2)(1 + alpha) = 27
    np.testing.assert_allclose(amplification_matrix(method, Omega, xi), matrix_of(method, Omega, xi), atol=1e-13)


@pytest.mark.parametrize("method", [eig3.RK2(), eig3.RK3(), eig3.RK4(), eig3.AB2(), eig3.AB3()])
@settings(deadline=None)
@given(Omega=frequencies, xi=dampings)
def test_step_is_the_matrix_of_the_method(method, Omega, xi):
    A = amplification_matrix(method, Omega, xi)
    expected = matrix_of(method, Omega, xi)
    if isinstance(method, eig3.AB3 | eig3.AB2):
        # the kernel carries (u, v, v_1, a_1, ...), the matrix (u, v, then the slopes (v_1, a_1), ...): the same
        assert A.shape == expected.shape
    np.testing.assert_allclose(A, expected, atol=1e-12)  # (Omega + 2 xi Omega)^4 / 24 is up to 40 at round-off 1e-16


@pytest.mark.parametrize("solver", ["newton", "fixed-point"])
@settings(deadline=None)
@given(Omega=st.floats(0.01, 1.9), xi=st.floats(0, 0.4))
def test_central_difference_satisfies_its_formula(solver, Omega, xi):
    method = eig3.CentralDifference(solver=solver, max_iterations=500)
    run = eig3.integrate(oscillator, (0, 20), 1.0, 0.3, h=1.0, params=(Omega, xi), method=method)
    u, v = run.u, run.v
    assert run.success
    scale = np.abs(u).max() + np.abs(v).max()
    acceleration = -(Omega**2) * u - 2 * xi * Omega * v
    # the solver stops at 1e-12 (|v| + |w|), and its contraction factor xi Omega stays below 0.76
    np.testing.assert_allclose(u[2:] - 2 * u[1:-1] + u[:-2], acceleration[1:-1], atol=2e-11 * scale)
    np.testing.assert_allclose((u[2:] - u[:-2]) / 2, v[1:-1], atol=2e-11 * scale)


def test_lagged_central_difference_uses_the_backward_difference():
    method = eig3.CentralDifference(velocity="lagged")
    run = eig3.integrate(oscillator, (0, 20), 1.0, 0.3, h=1.0, params=(0.7, 0.2), method=method)
    u = run.u
    lagged = u[1:-1] - u[:-2]
    np.testing.assert_allclose(u[2:] - 2 * u[1:-1] + u[:-2], -0.49 * u[1:-1] - 0.28 * lagged, atol=1e-13)
    np.testing.assert_allclose((u[2:] - u[:-2]) / 2, run.v[1:-1], atol=1e-13)
    assert u[1] == pytest.approx(1.0 + 0.3 + (-0.49 * 1.0 - 0.28 * 0.3) / 2)  # Taylor's series at the start


def test_eig3_positions_are_those_of_central_difference():
    """Without velocity in f the two are one method; round-off grows with the chaos-free motion to some 1e-10."""
    options = {"h": 1e-3, "params": (3.0,)}
    one, other = (eig3.integrate(hardening, (0, 10), 1.0, 0.2, method=method, **options) for method in ("eig3", "cd"))
    np.testing.assert_allclose(one.u, other.u, rtol=0, atol=1e-10)
    assert np.abs(one.v - other.v).max() > 1e-6  # the reported velocities differ: an extrapolation, and a mean


@pytest.mark.parametrize(
    ("rhs", "u0", "v0"), [(hardening, 1.0, 0.2), (hardening_chain, [0.1, 0.2, -0.3], [0.0, 1.0, 0.0])]
)
def test_eig3_without_velocity_reports_the_same(rhs, u0, v0):
    """The staggered form renames variables: only roundings differ, 1e3 of 1e-16, amplified by the motion to 1e-12."""
    options = {"h": 0.01, "params": (3.0, 0.1, 2.0), "save_every": 7}
    one, other = (
        eig3.integrate(rhs, (0, 10), u0, v0, method=eig3.EIG3(velocity=v), **options) for v in ("explicit", "none")
    )
    np.testing.assert_allclose(other.u, one.u, rtol=0, atol=1e-12)
    np.testing.assert_allclose(other.v, one.v, rtol=0, atol=1e-12)
    assert other.method.kernel != one.method.kernel == eig3.EIG3(1.2, velocity="none").kernel  # for other parameters
    assert other.n_rhs == one.n_rhs


def test_first_step_is_the_articles():
    a0 = -16.0 * 0.5 - 0.8 * 0.25
    for method in ("eig3", "ab2"):
        run = eig3.integrate(oscillator, (0, 0.1), 0.5, 0.25, h=0.1, params=(4.0, 0.1), method=method)
        assert run.u[1] == pytest.approx(0.5 + 0.1 * 0.25 + 0.005 * a0, rel=1e-15)
        assert run.v[1] == pytest.approx(0.25 + 0.1 * a0, rel=1e-15)


def test_ab3_starts_with_kutta():
    options = {"h": 0.1, "params": (4.0, 0.1)}
    ab3 = eig3.integrate(oscillator, (0, 0.5), 0.5, 0.25, method="ab3", **options)
    rk3 = eig3.integrate(oscillator, (0, 0.5), 0.5, 0.25, method="rk3", **options)
    np.testing.assert_array_equal(ab3.u[:3], rk3.u[:3])
    assert ab3.u[3] != rk3.u[3]
    assert ab3.n_rhs == 1 + 2 * (3 + 1) + 3  # a starting step also records f at its start in the past


def test_scalar_form_equals_vector_form(method):
    options = {"h": 0.01, "params": (3.0, 0.05), "method": method}
    scalar = eig3.integrate(oscillator, (0, 20), 1.0, -0.5, **options)
    vector = eig3.integrate(oscillator_vector, (0, 20), [1.0], [-0.5], **options)
    # the compiler may fuse multiply-adds differently in the two
    np.testing.assert_allclose(vector.u[:, 0], scalar.u, rtol=0, atol=1e-11)
    np.testing.assert_allclose(vector.v[:, 0], scalar.v, rtol=0, atol=1e-11)
    assert vector.n_rhs == pytest.approx(scalar.n_rhs, rel=0.01)  # iterations may stop one sooner


@pytest.mark.parametrize("method", OF_EACH_KIND, ids=lambda method: method.name)
def test_inline_mode_equals_pointer_mode(method):
    for rhs, u0, v0 in FORMS:
        runs = [
            eig3.integrate(rhs, (0, 5), u0, v0, h=0.01, params=(3.0, 0.1, 2.0), method=method, inline=inline)
            for inline in (False, True)
        ]
        np.testing.assert_allclose(runs[0].u, runs[1].u, rtol=0, atol=1e-11)
        np.testing.assert_allclose(runs[0].v, runs[1].v, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    ("methods", "inline"), [(ALL_METHODS + WITHOUT_VELOCITY, False), (OF_EACH_KIND, True)], ids=["pointer", "inline"]
)
@settings(deadline=None, max_examples=25)
@given(data=st.data(), chunks=st.lists(st.integers(0, 40), min_size=1, max_size=6), every=st.integers(1, 30))
def test_chunked_runs_agree_bit_for_bit(methods, data, chunks, every, inline):
    method = data.draw(st.sampled_from(methods))
    scalar, vector = (hardening, hardening_chain) if method.ignores_velocity else (oscillator, coupled)
    for rhs, u0, v0, shape in ((scalar, 1.0, 0.2, ()), (vector, [0.1, 0.2, -0.3], [0.0, 0.1, 0.0], (3,))):
        options = {"h": 0.01, "params": (3.0, 0.1, 2.0), "method": method, "inline": inline}
        total = sum(chunks)
        u_whole, v_whole = (np.full((total // every, *shape), np.nan) for _ in range(2))
        u_parts, v_parts = u_whole.copy(), v_whole.copy()
        whole, parts = eig3.Stepper(rhs, u0, v0, **options), eig3.Stepper(rhs, u0, v0, **options)
        whole.advance(total, every, u_whole, v_whole)
        for count in chunks:
            row = parts.index // every
            parts.advance(count, every, u_parts[row:], v_parts[row:])
        np.testing.assert_array_equal(u_whole, u_parts)
        np.testing.assert_array_equal(v_whole, v_parts)
        np.testing.assert_array_equal(whole.u, parts.u)
        assert (whole.index, whole.n_rhs) == (parts.index, parts.n_rhs)


def test_evaluations_a_step_are_those_of_the_record(method):
    stepper = eig3.Stepper(oscillator, 1.0, 0.0, h=0.01, params=(3.0, 0.1), method=method)
    stepper.advance(10)
    before = stepper.n_rhs
    stepper.advance(100)
    if method.is_implicit:
        assert stepper.n_rhs - before >= 100
        assert stepper.n_iterations > 0
    else:
        assert stepper.n_rhs - before == 100 * method.evaluations
        assert stepper.n_iterations == 0


def test_n_rhs_counts_the_calls():
    """The kernels count exactly the calls of the right-hand side, which the function reports to Python."""
    calls = []
    report = ctypes.CFUNCTYPE(None, ctypes.c_double)(calls.append)

    @eig3.jit
    def counting(t, u, v, p, a):
        report(t)
        a[0] = a[2] = -u[0] - 0.1 * v[0]  # two degrees of freedom have kernels of their own, which take time
        a[1] = -4 * u[1] - 0.1 * v[0] * v[1]

    for method in ALL_METHODS:
        stepper = eig3.Stepper(counting, [1.0, 2.0, 0.0], [0.0, 1.0, 0.0], h=0.01, method=method)
        calls.clear()
        stepper.advance(50)
        assert 1 + len(calls) == stepper.n_rhs  # and the one at the start


def test_a_thread_waits_while_another_imports_a_kernel(tmp_path, monkeypatch):
    text = "import time\n\ntime.sleep(0.2)\n\nfrom eig3.kernels.methods.eig3_staggered import *\n"
    (tmp_path / "kernel_imported_slowly.py").write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with ThreadPoolExecutor(2) as threads:
        first, second = threads.map(formulas, ["kernel_imported_slowly"] * 2)
    assert first.module is second.module
    del sys.modules["kernel_imported_slowly"]


def test_what_kernels_share_cannot_be_changed():
    """The names of one kernel would get into the kernels that are compiled after it."""
    _, names = fixed.pointer_callbacks(VECTOR, False)
    with pytest.raises(TypeError):
        names["STEP"] = None
