"""`eig3.stability` of the EIG family, RK5, RK8 and BM6, compared with theory in exact rational arithmetic."""

import math
import re
from fractions import Fraction

import numpy as np
import pytest

import eig3
from eig3.kernels.methods import bm6, eig, rk5, rk8
from eig3.stability import (
    alternating_limit,
    damping_ratio,
    expansion,
    explain,
    is_stable,
    limit,
    period_error,
    practical_limit,
    principal_root,
    spectral_radius,
)

WEAK = (6, 11)  # with an odd and an even number of accelerations; other tests compile these too
DAMPED_GRADES = (3, 5, 8, 13)  # one text makes all grades, and each takes seconds to compile
GRADES = sorted({*WEAK, *DAMPED_GRADES})
DAMPINGS = (0.01, 0.1, 0.5, 1.0)
EPS = 2.0**-52


def product(a, b):
    result = [Fraction(0)] * (len(a) + len(b) - 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            result[i + j] += x * y
    return result


def total(*polynomials):
    length = max(map(len, polynomials))
    return [sum((p[i] for p in polynomials if i < len(p)), Fraction(0)) for i in range(length)]


# The EIG family -------------------------------------------------------------------------------------------------------


def polynomial(grade, Omega, xi=0):
    """The characteristic polynomial in 1/z, from the constant term on, exactly.

    With x = 1/z, the difference D is 1 - x. The recursion for h^2 a = -Omega^2 u - 2 xi Omega h w, with
    h w = (1 - x) u + x sum kappa_j D^j h^2 a, and (1 - x)^2 u = x sum sigma_j D^j h^2 a, gives
    (1 - x)^2 (1 + 2 xi Omega x K) + x S (Omega^2 + 2 xi Omega (1 - x)) = 0.
    """
    Omega, xi = Fraction(Omega), Fraction(xi)
    difference = [Fraction(1), Fraction(-1)]

    def series(coefficients):
        result, power = [Fraction(0)], [Fraction(1)]
        for c in coefficients:
            result, power = total(result, [c * x for x in power]), product(power, difference)
        return result

    damping = 2 * xi * Omega
    first = total([Fraction(1)], [Fraction(0), *(damping * x for x in series(eig.kappa(grade - 2)))])
    force = total([Omega * Omega], [damping * x for x in difference])
    return total(
        product(product(difference, difference), first), [Fraction(0), *product(series(eig.sigma(grade - 1)), force)]
    )


def all_within(coefficients):
    """Whether all roots z of a polynomial are inside the unit circle: Schur and Cohn's criterion, exactly."""
    a = [x / coefficients[0] for x in coefficients]
    while len(a) > 1:
        last = a[-1]
        if abs(last) >= 1:
            return False
        a = [(a[k] - last * a[-1 - k]) / (1 - last * last) for k in range(len(a) - 1)]
    return True


def principal(grade, Omega, xi=0):
    """The principal root of the exact polynomial, by Newton's iteration from the exact solution."""
    a = np.array([float(x) for x in polynomial(grade, Omega, xi)])
    z = np.exp(Omega * (-xi + 1j * math.sqrt(1 - xi * xi)))
    for _ in range(20):
        z -= np.polyval(a, z) / np.polyval(np.polyder(a), z)
    return z


@pytest.mark.parametrize(
    ("grade", "xi"), [(grade, xi) for grade in GRADES for xi in (0.0, *DAMPINGS) if xi == 0 or grade in DAMPED_GRADES]
)
def test_theory_on_both_sides_of_every_limit(grade, xi):
    """Within 1e-6 of the limit; the roots of grade 3 are on the unit circle without damping, and grade 8 leaves it by
    a growth that is below the 1e-11 of `is_stable` for the first 1e-6 or so."""
    bound = limit(eig3.EIG(grade), xi)
    if grade in WEAK and xi == 0:
        assert bound == 0
        for Omega in (0.01, 0.05, 0.2):  # however slowly, it grows
            assert not all_within(polynomial(grade, Omega))
        return
    if (grade, xi) != (8, 0):
        assert bound == pytest.approx(alternating_limit(grade, xi), abs=1e-9)
    assert not all_within(polynomial(grade, bound * (1 + 1e-6), xi))
    for part in (0.01, 0.3, 0.7, 0.999, 1 - 1e-5):
        assert all_within(polynomial(grade, bound * part, xi)) or (grade, xi) == (3, 0)
    assert is_stable(eig3.EIG(grade), bound * (1 - 1e-6), xi)
    assert not is_stable(eig3.EIG(grade), bound * (1 + 1e-5), xi)


@pytest.mark.parametrize("grade", DAMPED_GRADES)
@pytest.mark.parametrize("xi", [0.0, 0.05])
def test_principal_root_is_that_of_the_exact_polynomial(grade, xi):
    """Round-off of eigenvalues: a pair 2 Omega apart moves by the round-off of the coefficients, up to 1e3 eps, over
    Omega."""
    method = eig3.EIG(grade)
    for Omega in (0.5 * limit(method, xi or 0.05), 0.1):
        z = principal(grade, Omega, xi)
        tolerance = 1e5 * EPS / Omega
        assert principal_root(method, Omega, xi).item() == pytest.approx(z, abs=tolerance)
        assert damping_ratio(method, Omega, xi) == pytest.approx(-np.log(abs(z)) / np.angle(z), abs=tolerance / Omega)
        exact = Omega * math.sqrt(1 - xi * xi)
        assert period_error(method, Omega, xi) == pytest.approx(exact / np.angle(z) - 1, abs=tolerance / Omega)


@pytest.mark.parametrize("grade", DAMPED_GRADES)
def test_leading_terms_of_the_principal_root(grade):
    """Stoermer's series solves the equation exactly. The terms from sigma_p on are left out, so that
    ln z = x (1 - sigma_p x^p / 2 + (p sigma_p / 2 - sigma_(p+1)) x^(p+1) / 2 + ...) with x = i Omega."""
    p = grade - 1
    sigma = eig.sigma(p + 2)
    expected = float(-sigma[p] / 2), float((p * sigma[p] / 2 - sigma[p + 1]) / 2)
    coefficients, _ = expansion(eig3.EIG(grade, velocity="none"))
    assert coefficients[0] == pytest.approx(1, abs=1e-12)
    # the round-off of an eigenvalue, 1e-14 of coefficients up to 1e3, over the power of the radius
    assert coefficients[p : p + 2] == pytest.approx(expected, rel=1e-6, abs=1e-12)
    text = explain(eig3.EIG(grade))
    said = [float(x) for x in re.findall(r"([\d.]+) Omega", text)]
    for value, power in zip(expected, (p, p + 1), strict=True):
        if value == 0:
            continue
        assert f"Omega^{power}" in text
        fraction = Fraction(value).limit_denominator(1000)
        shown = abs(fraction.numerator) if abs(float(fraction) - value) < 1e-12 else float(f"{abs(value):.4g}")
        assert shown in said or shown == 1


@pytest.mark.parametrize("grade", WEAK)
def test_weak_growth(grade):
    """Rate, power and practical limit: 3/80 Omega^6 a step in grade 6. Near 0.2 the next term is some 0.3 of it."""
    p, method = grade - 1, eig3.EIG(grade, velocity="none")
    sigma = eig.sigma(p + 2)
    power = p + 1 if p % 2 else p + 2
    rate = abs(float(sigma[p] / 2 if p % 2 else (p * sigma[p] / 2 - sigma[p + 1]) / 2))
    for Omega in (0.15, 0.2):
        growth = spectral_radius(method, Omega) - 1
        assert growth == pytest.approx(abs(principal(grade, Omega)) - 1, rel=1e-3, abs=1e-13)
        assert growth == pytest.approx(rate * Omega**power, rel=15 * Omega**2)
    practical = practical_limit(method)
    assert practical == pytest.approx({6: 0.2575, 11: 0.2424}[grade], abs=1e-4)
    radii = [np.abs(np.roots([float(x) for x in polynomial(grade, practical * part)])).max() for part in (0.999, 1.001)]
    assert radii[0] < 1 + 1e-5 < radii[1]
    text = explain(method)
    assert re.search(rf"grows weakly: by .*Omega\^{power}[^ ]* a step, which is below 1e-5 up to", text)
    assert f"up to omega h = {practical:.4g}." in text


def test_practical_limits_of_other_methods():
    """RK2 grows by Omega^4/8 and AB2 by Omega^4/4 a step; a proper limit is a practical one too."""
    for growth in (1e-5, 1e-8):
        assert practical_limit("rk2", growth=growth) == pytest.approx((8 * growth) ** 0.25, rel=1e-3)
        assert practical_limit("ab2", growth=growth) == pytest.approx((4 * growth) ** 0.25, rel=2e-2)
    assert practical_limit("cd") == pytest.approx(2, abs=1e-6)
    assert practical_limit("eig9", 0.1) == pytest.approx(limit("eig9", 0.1), rel=1e-4)
    with pytest.raises(ValueError, match=r"^growth must be positive, not 0\.$"):
        practical_limit("rk2", growth=0)


# Runge-Kutta ----------------------------------------------------------------------------------------------------------


def stability_polynomial(kernel):
    """R of a Runge-Kutta method for u' = z u: 1 + sum b A^(k-1) 1 z^k, exactly."""
    stages = len(kernel.B)
    A = [[Fraction(x) for x in row] for row in [(), *kernel.A]]
    ones, R = [Fraction(1)] * stages, [Fraction(1)]
    for _ in range(stages):
        R.append(sum((Fraction(b) * x for b, x in zip(kernel.B, ones, strict=True)), Fraction(0)))
        ones = [sum((a * x for a, x in zip(row, ones, strict=False)), Fraction(0)) for row in A]
    return R


def undamped_growth(R, Omega):
    """|R(i Omega)|^2 - 1, exactly."""
    s = -(Fraction(Omega) ** 2)
    real = sum(c * s**k for k, c in enumerate(R[::2]))
    imaginary = sum(c * s**k for k, c in enumerate(R[1::2]))
    return real**2 - s * imaginary**2 - 1


@pytest.mark.parametrize(("method", "kernel"), [(eig3.RK5(), rk5), (eig3.RK8(), rk8)], ids=["rk5", "rk8"])
def test_runge_kutta_limits_on_both_sides(method, kernel):
    R = stability_polynomial(kernel)
    bound = limit(method)
    # a growth of 1e-11 is not seen: RK5, which rises slowly, is 1e-5 beyond its limit by then
    assert undamped_growth(R, bound * (1 - 2e-5)) < 0 < undamped_growth(R, bound * (1 + 1e-5))
    values = np.array([float(c) for c in R[::-1]])
    for xi in DAMPINGS:
        rate = -xi + 1j * math.sqrt(1 - xi * xi)
        bound = limit(method, xi)
        sizes = [abs(np.polyval(values, rate * bound * part)) for part in (0.5, 0.9, 1 - 1e-5, 1 + 1e-5)]
        assert max(sizes[:3]) < 1 < sizes[3]


@pytest.mark.parametrize(("method", "kernel"), [(eig3.RK5(), rk5), (eig3.RK8(), rk8)], ids=["rk5", "rk8"])
def test_leading_terms_of_runge_kutta_methods(method, kernel):
    """ln R(x) - x, from the first term of R that is not that of exp: c_p = r and c_(p+1) = q - r."""
    p, R = method.order, stability_polynomial(kernel)
    r, q = (float((R[k] if k < len(R) else 0) - Fraction(1, math.factorial(k))) for k in (p + 1, p + 2))
    coefficients, _ = expansion(method)
    # RK5's coefficients are given to 14 digits
    assert coefficients[p : p + 2] == pytest.approx([r, q - r], abs=1e-13)
    text = explain(method)
    assert f"{abs(r):.4g} Omega^{p}" in text
    assert f"{abs(q - r):.4g} Omega^{p + 1}" in text


# BM6 ------------------------------------------------------------------------------------------------------------------


def half_trace():
    """Half of the trace of BM6's matrix as a polynomial in Omega^2, exactly; its determinant is one."""
    rows = []
    for u, v in (([Fraction(1)], [Fraction(0)]), ([Fraction(0)], [Fraction(1)])):
        for kick, drift in zip(bm6.KICKS, (*bm6.DRIFTS, 0), strict=True):
            v = total(v, [Fraction(0), *(-Fraction(kick) * x for x in u)])
            u = total(u, [Fraction(drift) * x for x in v])
        rows.append((u, v))
    (a, c), (b, d) = rows
    determinant = total(product(a, d), [-x for x in product(b, c)])
    assert determinant[0] == 1
    assert not any(determinant[1:])
    return [x / 2 for x in total(a, d)]


def test_bm6_is_stable_in_three_intervals():
    """Where |trace| <= 2. Near pi and 2 pi the two roots meet at -1 and 1, and part for 9e-4 and 1.4e-3."""
    trace = half_trace()

    def size(Omega):
        return abs(sum(c * Fraction(Omega) ** (2 * k) for k, c in enumerate(trace)))

    again = r"up to omega h = ([\d.]+),.* again from ([\d.]+) to ([\d.]+) and from ([\d.]+) to ([\d.]*\d)\."
    found = re.search(again, explain("bm6"))
    ends = [float(x) for x in found.groups()]
    assert ends[0] == pytest.approx(limit("bm6"), abs=1e-5)
    assert ends == pytest.approx([math.pi, math.pi, 2 * math.pi, 2 * math.pi, 9.0736], rel=0.02)
    within = 2e-5  # six digits are printed
    for end, is_last in zip(ends, (True, False, True, False, True), strict=True):
        stable, unstable = (end - within, end + within) if is_last else (end + within, end - within)
        assert size(stable) <= 1 < size(unstable)
        assert is_stable("bm6", stable)
        assert not is_stable("bm6", unstable)
    assert all(size(x) <= 1 for x in np.linspace(0.01, ends[0] - within, 200))
    assert limit("bm6") == pytest.approx(3.1414311, abs=1e-6)


def test_bm6_keeps_the_size_of_the_motion():
    Omega = np.array([0.5, 1.5, 2.9])
    trace = [float(c) for c in half_trace()]
    angle = np.arccos([sum(c * x ** (2 * k) for k, c in enumerate(trace)) for x in Omega])
    assert damping_ratio("bm6", Omega) == pytest.approx(0, abs=1e-13)
    assert period_error("bm6", Omega) == pytest.approx(Omega / angle - 1, abs=1e-12)
    assert "It has no numerical damping." in explain("bm6")
    assert "It is for forces that do not depend on the velocity." in explain("bm6")
