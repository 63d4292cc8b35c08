"""EIG of any grade: its coefficients, order, error constant, stability limits and starter, from theory."""

from fractions import Fraction
from math import comb, factorial

import pytest

from eig3.kernels import eig

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
