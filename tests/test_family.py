"""EIG of any grade: its coefficients, order, error constant and starter, from theory."""

from fractions import Fraction
from math import comb, factorial

import numpy as np
import pytest

import eig3
from eig3.kernels.methods import eig

from .conftest import gyroscope

GRADES = range(3, 14)


def monomial(k, t):
    """The value of t^k / k! at a whole number t, exactly."""
    return Fraction(t**k, factorial(k)) if k >= 0 else Fraction(0)


def test_coefficients_are_those_of_the_literature():
    """Stoermer's coefficients: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, table 10.1."""
    stoermer = "1 0 1/12 1/12 19/240 3/40 863/12096 275/4032 33953/518400"
    assert eig.sigma(9) == [Fraction(x) for x in stoermer.split()]
    assert eig.kappa(4) == [Fraction(x) for x in ["1/2", "1/3", "7/24", "97/360"]]
    assert eig.omega(4) == [Fraction(x) for x in ["1/2", "-1/6", "-1/24", "-1/45"]]


@pytest.mark.parametrize("p", [grade - 1 for grade in GRADES])
def test_positions_are_exact_for_polynomials_of_degree_p_plus_1(p):
    """The residual for t^(p+2)/(p+2)! is the error constant: the next coefficient that is not zero, sigma_p."""
    weights = eig.ordinates(eig.sigma(p))

    def residual(k):
        second_difference = monomial(k, 1) - 2 * monomial(k, 0) + monomial(k, -1)
        return second_difference - sum(w * monomial(k - 2, -i) for i, w in enumerate(weights))

    assert [residual(k) for k in range(p + 2)] == [0] * (p + 2)
    assert residual(p + 2) == eig.sigma(p + 1)[p]


@pytest.mark.parametrize("p", [grade - 1 for grade in GRADES])
@pytest.mark.parametrize(("coefficients", "newest", "lost"), [(eig.kappa, -1, 1), (eig.omega, 0, 0)])
def test_velocities_are_exact_for_polynomials(p, coefficients, newest, lost):
    """The velocity at t = 0 from the mean velocity of the step before, and accelerations from the time `newest` back.

    With p - `lost` accelerations, a polynomial of degree p - `lost` + 1 is exact, and one of the next degree is not.
    """
    weights = eig.ordinates(coefficients(p - lost))

    def residual(k):
        mean = monomial(k, 0) - monomial(k, -1)
        return monomial(k - 1, 0) - mean - sum(w * monomial(k - 2, newest - i) for i, w in enumerate(weights))

    degree = p - lost + 1
    assert [residual(k) for k in range(1, degree + 1)] == [0] * degree
    assert residual(degree + 1) == coefficients(p - lost + 1)[-1]


def test_ordinates_sum_the_differences():
    differences = [Fraction(1, 3), Fraction(2), Fraction(-5, 7)]
    a = [Fraction(4), Fraction(9), Fraction(1, 2)]
    backward = [sum((-1) ** i * comb(j, i) * a[i] for i in range(j + 1)) for j in range(3)]
    expected = sum(x * d for x, d in zip(differences, backward, strict=True))
    assert sum(w * x for w, x in zip(eig.ordinates(differences), a, strict=True)) == expected


# Kernels --------------------------------------------------------------------------------------------------------------

damped = eig3.jit(lambda t, u, v, p: -4 * u - 0.4 * v + np.cos(1.3 * t))


@eig3.jit
def damped_vector(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -4 * u[j] - 0.4 * v[j] + np.cos(1.3 * t)


#: Methods with a number of steps at which the error is far above round-off, and the order is seen.
STEPS = {eig3.EIG(5): 160, eig3.EIG(9): 256, eig3.RK5(): 64, eig3.RK8(): 16}
every = pytest.mark.parametrize("method", STEPS, ids=lambda method: method.name)


@every
def test_order_on_a_damped_and_forced_oscillator(method):
    """From h to h/2. The next term of the error changes the order by O(h). v has it too: it is synchronised with u."""
    forced = eig3.problems.single_dof(omega=2.0, xi=0.1, force=1.0, force_omega=1.3, u0=1.0, v0=0.3, t_end=8.0)
    errors = []
    for n in (STEPS[method], 2 * STEPS[method]):
        run = forced.integrate(h=8 / n, method=method)
        u, v = forced.exact(run.t)
        errors.append(max(np.abs(run.u - u).max(), np.abs(run.v - v).max()))
    assert errors[1] > 1e-13
    assert np.log2(errors[0] / errors[1]) == pytest.approx(method.order, abs=0.7)


def test_order_on_a_gyroscope():
    """v' = i kappa v turns v at the rate kappa."""
    method, errors = eig3.EIG(5), []
    for n in (128, 256):
        run = eig3.integrate(gyroscope, (0, 3), [0.0] * 3, [1.0, 0.0, 0.0], h=3 / n, params=2.0, method=method)
        errors.append(np.abs(run.v[:, 0] + 1j * run.v[:, 1] - np.exp(2j * run.t)).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(method.order, abs=0.3)


FORMS = (damped, 1.0, 0.3), (damped_vector, [1.0, 0.5, -1.0], [0.3, 0.0, 0.1])


@every
def test_chunks_agree_bit_for_bit_and_scalar_form_equals_vector_form(method):
    runs = []
    for rhs, u0, v0 in FORMS:
        whole, parts = (eig3.Stepper(rhs, u0, v0, h=0.05, method=method) for _ in range(2))
        whole.advance(100)
        saved = eig3.integrate(rhs, (0, 5), u0, v0, h=0.05, method=method)  # which reports v after each step
        np.testing.assert_array_equal(saved.u[-1], whole.u)
        for count in (1, 2, 1, 7, 3, 11, 75):
            parts.advance(count)
        assert parts.n_rhs == whole.n_rhs
        np.testing.assert_array_equal(parts.u, whole.u)
        np.testing.assert_array_equal(parts.v, whole.v)
        runs.append(saved)
    scalar, vector = runs
    np.testing.assert_allclose(vector.u[:, 0], scalar.u, rtol=0, atol=1e-12)  # multiply-adds fused or not
    np.testing.assert_allclose(vector.v[:, 0], scalar.v, rtol=0, atol=1e-12)


def test_a_step_takes_one_evaluation_and_a_starting_step_twelve_more():
    for grade in (3, 5, 9):
        stepper = eig3.Stepper(damped, 1.0, 0.3, h=0.01, method=eig3.EIG(grade))
        stepper.advance(100)
        assert stepper.n_rhs == 1 + 100 + 12 * (grade - 2)


# BM6 ------------------------------------------------------------------------------------------------------------------

quartic = eig3.jit(lambda t, u, v, p: -u - u**3)


def test_bm6_has_order_6_and_keeps_the_energy():
    """A symplectic method keeps the energy up to its own error, without drift, after 1000 periods as after 10."""
    errors, drifts = [], []
    exact = eig3.integrate(quartic, (0, 4), 1.0, 0.3, h=4 / 320, method="rk8").u
    for n in (16, 32):
        run = eig3.integrate(quartic, (0, 4), 1.0, 0.3, h=4 / n, method="bm6")
        errors.append(np.abs(run.u - exact[:: 320 // n]).max())
    assert np.log2(errors[0] / errors[1]) == pytest.approx(6, abs=0.5)
    for periods in (10, 1000):
        run = eig3.integrate(quartic, (0, 5 * periods), 1.0, 0.0, h=0.25, method="bm6")
        energy = run.v**2 / 2 + run.u**2 / 2 + run.u**4 / 4
        drifts.append(np.abs(energy - energy[0]).max())
    assert drifts[1] < 2 * drifts[0]


def test_bm6_refuses_a_force_with_velocity():
    with pytest.raises(ValueError, match=r"BM6\(\) needs a rhs that ignores v and has no z0"):
        eig3.integrate(damped, (0, 1), 1.0, 0.0, h=0.1, method="bm6")


# Names ----------------------------------------------------------------------------------------------------------------


def test_names_lead_to_records():
    for grade in range(4, 14):
        run = eig3.Stepper(quartic, 1.0, 0.0, h=0.1, method=f"EIG{grade}") if grade == 5 else None
        record = eig3.METHODS[f"eig{grade}"]()
        assert record == eig3.EIG(grade)
        assert record.name == f"eig{grade}"
        assert run is None or run.running == eig3.EIG(5, velocity="none")


@pytest.mark.parametrize("grade", [2, 14, 5.0, "5", True])
def test_other_grades_are_refused(grade):
    with pytest.raises(ValueError, match="grade must be a whole number from 3 to 13, not"):
        eig3.EIG(grade)
