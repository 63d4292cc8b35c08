"""`eig3.stability`, compared with closed forms and with runs."""

import math
import re

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import eig3
from eig3.stability import (
    amplification_matrix,
    characteristic_polynomial,
    damping_ratio,
    explain,
    first_above,
    is_stable,
    limit,
    period_error,
    practical_limit,
    principal_root,
    spectral_radius,
    stable_region,
)

from .conftest import ALL_METHODS

EPS = 2.0**-52
LAGGED = eig3.CentralDifference(velocity="lagged")
CD = eig3.CentralDifference(velocity="none")
UNDAMPED = [eig3.EIG3(), CD, eig3.RK2(), eig3.RK3(), eig3.RK4(), eig3.AB2(), eig3.AB3()]
SETS = [(1, 0.5), (1.2, 0.5), (1.5, 0.5), (2, 0.5), (1.2, 0.6), (2, 1), (1, 0.6), (0, 0), (1 / 3, 0.5), (0.8, 0.5)]

parameters = st.floats(-2, 2)
frequencies = st.floats(0.01, 3)
dampings = st.floats(0, 1.5)


# Closed forms --------------------------------------------------------------------------------------------------------


@settings(deadline=None)
@given(Omega=st.floats(0.05, 1.95))
def test_eig3_is_central_difference_undamped(Omega):
    """The principal root has cos arg = 1 - Omega^2 / 2 and the modulus one."""
    # acos loses digits towards Omega = 0 and 2, where the slope of cos is 0.05 and 0.2: eps / 0.05
    angle = 2 * math.asin(Omega / 2)
    for method in (eig3.EIG3(), CD):
        assert principal_root(method, Omega).item() == pytest.approx(complex(np.exp(1j * angle)), abs=1e-12)
        assert damping_ratio(method, Omega) == pytest.approx(0, abs=1e-12)
        assert period_error(method, Omega) == pytest.approx(Omega / angle - 1, abs=1e-12)


# The polynomial and the roots of every method ------------------------------------------------------------------------


@settings(deadline=None, max_examples=200)
@given(method=st.sampled_from(ALL_METHODS), Omega=st.floats(0.01, 2.5), xi=st.floats(0, 0.3))
def test_polynomial_has_the_eigenvalues_for_roots(method, Omega, xi):
    """The roots are exact for a matrix that is eps ||A|| away, and so are the coefficients that they multiply to."""
    A = amplification_matrix(method, Omega, xi)
    if not np.isfinite(A).all():  # fixed-point iteration does not converge for large xi Omega
        assert spectral_radius(method, Omega, xi) == np.inf
        return
    coefficients = characteristic_polynomial(method, Omega, xi)
    size = 1 + np.linalg.norm(A)
    tolerance = 100 * EPS * size ** np.arange(len(A) + 1)
    assert (np.abs(np.poly(np.linalg.eigvals(A)) - coefficients) <= tolerance).all()
    assert spectral_radius(method, Omega, xi) == np.abs(np.linalg.eigvals(A)).max()


def test_matrices_of_an_array_are_those_of_its_values():
    Omega, xi = np.linspace(0.1, 2.4, 7), np.array([[0.0], [0.1], [0.9]])
    for method in ALL_METHODS:
        together = amplification_matrix(method, Omega, xi)
        size = together.shape[-1]
        assert together.shape == (3, 7, size, size)
        assert characteristic_polynomial(method, Omega, xi).shape == (3, 7, size + 1)
        assert spectral_radius(method, Omega, xi).shape == is_stable(method, Omega, xi).shape == (3, 7)
        for i, j in ((0, 0), (1, 3), (2, 6)):
            one = amplification_matrix(method, Omega[j], xi[i, 0])
            # the compiler may fuse multiply-adds in one loop and not in the other; a solve stops at 1e-12
            np.testing.assert_allclose(one, together[i, j], atol=1e-10)


# Where EIG-3 is stable -----------------------------------------------------------------------------------------------


def margins(Omega, alpha, beta):
    """The margins of the four inequalities of EIG-3: Jury's inequalities for its cubic, where P(1) = Omega^2 > 0."""
    s, g = Omega * Omega, alpha / 2 - beta
    return np.stack(
        [
            2 - s * (alpha - beta),  # P(-1) < 0
            1 - np.abs(s * g),  # the product of the roots
            (beta - 0.5) + s * g * (beta + 0.5),
            2 + s * (0.5 - beta) - s * s * g * (alpha + 0.5 - beta),
        ]
    )


def test_stable_region_of_eig3_is_that_of_its_inequalities():
    """Of 12 000 points, all except those too close to a boundary to decide.

    The decision can be wrong if the distance of a root z from the unit circle is below the 1e-11 that is_stable allows.
    Then one of the margins, which are products of factors 1 - z_i z_j and 1 + z_i (over s >= 0.01 in the third), is
    below 2e-11 (1 + R^2)^2 / s for roots up to R. Here R < 40, and 1e-2 is more than that.
    """
    random = np.random.default_rng(7)
    alpha, beta = random.uniform(-1, 3, 400), random.uniform(-0.5, 1.5, 400)
    alpha[::4], beta[::4] = random.uniform(1, 2.5, 100), random.uniform(0.5, 0.9, 100)  # where most of it is stable
    Omega = np.sqrt(random.uniform(0.01, 6, (30, 1)))
    quantities = margins(Omega, alpha, beta)
    decided = (np.abs(quantities) > 1e-2).all(axis=0)
    expected = (quantities > 0).all(axis=0)
    region = stable_region(Omega, alpha, beta)
    assert region.shape == (30, 400)
    assert decided.mean() > 0.95
    assert 0.1 < expected.mean() < 0.9
    assert (quantities[:, decided] <= 0).any(axis=1).all()  # each inequality is violated somewhere
    np.testing.assert_array_equal(region[decided], expected[decided])
    assert max(spectral_radius(eig3.EIG3(a, b), Omega).max() for a, b in zip(alpha[:40], beta[:40], strict=True)) < 40


@settings(deadline=None, max_examples=300)
@given(alpha=st.floats(-1, 3), beta=st.floats(-0.5, 1.5), Omega=st.floats(0.1, 2.5))
@example(alpha=1.0, beta=0.6, Omega=0.95)
@example(alpha=1.0, beta=0.6, Omega=0.96)
def test_is_stable_is_the_inequalities(alpha, beta, Omega):
    quantities = margins(np.float64(Omega), alpha, beta)
    if (np.abs(quantities) > 1e-2).all():  # as above
        assert is_stable(eig3.EIG3(alpha, beta), Omega) is bool((quantities > 0).all())


@pytest.mark.parametrize(
    ("alpha", "beta", "s", "stable"),
    [
        (1.0, 0.5, 1.0, True),  # a pair on the unit circle, simple
        (1.0, 0.5, 4.0, False),  # twice -1
        (1.5, 0.5, 2.0, True),  # -1 once, the others within
        (2.0, 1.0, 2.0, True),  # -1, 0 and 0
        (1.0, 0.6, 10 / 11, True),  # the third margin vanishes: a simple pair on the unit circle
        (0.8, 0.5, 1e-2, False),  # grows by 5e-6 a step
    ],
)
def test_boundaries_with_simple_roots_are_stable(alpha, beta, s, stable):
    assert is_stable(eig3.EIG3(alpha, beta), math.sqrt(s)) is stable
    assert stable_region(math.sqrt(s), alpha, beta).item() is stable


def test_stable_region_takes_damping():
    Omega = np.array([0.5, 0.82, 0.83, 1.0])
    np.testing.assert_array_equal(stable_region(Omega, xi=0.5), [True, True, False, False])  # 2 (sqrt 2 - 1) = 0.828
    np.testing.assert_array_equal(stable_region(1.0, xi=[0.0, 0.3, 0.4, 1.0]), [True, True, False, False])  # 3/8


@pytest.mark.parametrize("method", ["cd", CD, eig3.EIG3()])
def test_a_double_root_on_the_unit_circle_is_unstable(method):
    """At Omega = 2 both roots are -1, and u grows like n."""
    assert not is_stable(method, 2.0)
    assert is_stable(method, 2 - 1e-8)
    assert not is_stable(method, 2 + 1e-8)
    assert spectral_radius(method, 2.0) == pytest.approx(1, abs=1e-7)  # the square root of round-off


def test_a_double_root_at_one_is_unstable():
    """Omega = 0 is a free particle, and u grows like n."""
    for method in UNDAMPED:
        assert not is_stable(method, 0.0)
        assert is_stable(method, 1e-2) is not isinstance(method, eig3.RK2 | eig3.AB2)


def test_a_step_whose_solve_fails_is_unstable():
    """Fixed-point iteration contracts by xi Omega."""
    method = eig3.CentralDifference(solver="fixed-point")
    assert spectral_radius(method, 1.0, 1.5) == np.inf
    np.testing.assert_array_equal(is_stable(method, [0.2, 1.0], 1.5), [True, False])
    assert np.isnan(amplification_matrix(method, 1.0, 1.5)).any()


# Limits --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("method", "expected", "tolerance"),
    [
        (eig3.EIG3(1, 0.6), 0.953, 1e-3),
        (eig3.EIG3(0.8, 0.5), 0, 0),
        (eig3.EIG3(0.5, 0.5), 0, 0),
        (eig3.EIG3(1 / 3, 0.5), 0, 0),
        (eig3.EIG3(0.9999, 0.5), 0, 0),
        (eig3.EIG3(0, 0), 0, 0),
        (eig3.CentralDifference(velocity="none"), 2, 1e-9),
        (eig3.RK2(), 0, 0),
        (eig3.RK3(), 3**0.5, 1e-9),
        (eig3.RK4(), 8**0.5, 1e-9),
        (eig3.AB2(), 0, 0),
        (eig3.AB3(), 12 / (5 * 11**0.5), 1e-9),
    ],
)
def test_stability_limits(method, expected, tolerance):
    """The limits of the reference, to the digits printed there, or closed forms to 1e-9, which limit promises."""
    assert limit(method) == pytest.approx(expected, abs=tolerance)


@pytest.mark.parametrize(("alpha", "beta"), [pair for pair in SETS if pair[0] > pair[1]][:6])
def test_limit_of_eig3_is_where_an_eigenvalue_is_minus_one(alpha, beta):
    assert limit(eig3.EIG3(alpha, beta)) == pytest.approx(math.sqrt(2 / (alpha - beta)), abs=1e-9)


@pytest.mark.parametrize("xi", [0.0, 0.01, 0.1, 0.5, 1.0, 2.0, 5.0])
@pytest.mark.parametrize(
    ("method", "closed_form"),
    [
        (eig3.EIG3(), lambda xi: 2 * (math.sqrt(1 + 4 * xi * xi) - 2 * xi)),
        (eig3.CentralDifference(), lambda xi: 2.0),
        (LAGGED, lambda xi: 2 * (math.sqrt(1 + xi * xi) - xi)),
    ],
    ids=["eig3", "cd", "lagged"],
)
def test_damped_limits(method, closed_form, xi):
    assert limit(method, xi) == pytest.approx(closed_form(xi), abs=1e-9)


@pytest.mark.parametrize(("method", "interval"), [("rk2", 2.0), ("ab2", 1.0), ("ab3", 6 / 11)])
def test_overdamped_limits(method, interval):
    """The faster of the two rates, xi + sqrt(xi^2 - 1), leaves the real interval of the method, for z' = -z."""
    for xi in (1.0, 1.5, 5.0, 50.0):
        assert limit(method, xi) == pytest.approx(interval / (xi + math.sqrt(xi * xi - 1)), abs=1e-9)


# Damping and period --------------------------------------------------------------------------------------------------

#: Leading terms of the algorithmic damping ratio and of the period error, each as (coefficient, power of Omega): of
#: z = R(i Omega), R = exp(z - c z^(p+1) - d z^(p+2) ...), with the error constants of the Runge-Kutta series and of
#: Adams and Bashforth (5/12, 3/8); for EIG-3 of the polynomial above, whose roots for alpha = 1 are exp(+-i phi),
#: phi = 2 asin(Omega/2) = Omega (1 + Omega^2/24).
LEADING = [
    (eig3.EIG3(), None, (-1 / 24, 2)),
    (CD, None, (-1 / 24, 2)),
    (LAGGED, None, (-1 / 24, 2)),
    (eig3.EIG3(0.8), (-0.05, 3), None),
    (eig3.EIG3(1.2), (0.05, 3), None),
    (eig3.EIG3(2.0), (0.25, 3), None),
    (eig3.EIG3(0.0, 0.0), (-1 / 4, 1), None),  # |l|^2 = 1 + Omega^2 / 2
    (eig3.EIG3(1.2, 0.6), (1 / 20, 1), None),  # |l|^2 = 1 - Omega^2 / 10
    (eig3.RK2(), (-1 / 8, 3), (-1 / 6, 2)),
    (eig3.RK3(), (1 / 24, 3), (-1 / 30, 4)),
    (eig3.RK4(), (1 / 144, 5), (1 / 120, 4)),
    (eig3.AB2(), (-1 / 4, 3), (-5 / 12, 2)),
    (eig3.AB3(), (3 / 8, 3), (-289 / 720, 4)),
]


@pytest.mark.parametrize(("method", "damping", "period"), LEADING, ids=[repr(row[0]) for row in LEADING])
def test_leading_terms(method, damping, period):
    """At 0.1 and 0.05 the next term, Omega^2 times the leading one, is eliminated; of Omega^4 = 1e-4 some times 10 is
    left. Round-off is 1e-15 / Omega of each, 1e-5 of RK4's damping."""
    Omega = np.array([0.05, 0.1])
    for term, values in ((damping, damping_ratio(method, Omega)), (period, period_error(method, Omega))):
        if term is not None:
            coefficient, power = term
            near, far = values / (coefficient * Omega**power)
            assert (4 * near - far) / 3 == pytest.approx(1, abs=1e-3)
    if damping is None:
        assert np.abs(damping_ratio(method, Omega)).max() < 1e-12


def adams_bashforth_root(weights, Omega):
    """The principal root of w^k - w^(k-1) = i Omega (weights), by Newton's method from exp(i Omega)."""
    k = len(weights)
    polynomial = np.zeros(k + 1, dtype=complex)
    polynomial[:2] = 1, -1
    polynomial[1:] -= 1j * Omega * np.array(weights)
    w = np.exp(1j * Omega)
    for _ in range(50):
        w -= np.polyval(polynomial, w) / np.polyval(np.polyder(polynomial), w)
    return w


@settings(deadline=None)
@given(Omega=st.floats(0.02, 0.6), xi=st.floats(0, 0.9))
def test_damping_and_period_are_defined_by_the_principal_root(Omega, xi):
    """For methods of first-order systems that root is known: R(z) for z = (-xi + i sqrt(1 - xi^2)) Omega."""
    rate = complex(-xi, math.sqrt(1 - xi * xi))
    z = rate * Omega
    roots = {
        "rk2": 1 + z + z**2 / 2,
        "rk3": 1 + z + z**2 / 2 + z**3 / 6,
        "rk4": 1 + z + z**2 / 2 + z**3 / 6 + z**4 / 24,
        "ab2": adams_bashforth_root([3 / 2, -1 / 2], z / 1j),
        "ab3": adams_bashforth_root([23 / 12, -16 / 12, 5 / 12], z / 1j),
    }
    for method, root in roots.items():
        # a root of the matrix is found to a few eps over its distance from the conjugate, 2 sqrt(1 - xi^2) Omega
        tolerance = 1e-13 / (abs(z.imag) * abs(root.imag))
        assert damping_ratio(method, Omega, xi) == pytest.approx(
            -math.log(abs(root)) / np.angle(root), rel=1e-9, abs=tolerance / abs(z.imag)
        )
        assert period_error(method, Omega, xi) == pytest.approx(
            Omega * math.sqrt(1 - xi * xi) / np.angle(root) - 1, rel=1e-9, abs=tolerance / abs(z.imag)
        )


def test_what_does_not_oscillate_has_no_damping_ratio_and_no_period():
    for method in ALL_METHODS:
        # at xi = 1 the double root splits into a pair, for EIG-3 by its error, for other methods by round-off
        for xi in (1.5,) if isinstance(method, eig3.EIG3) else (1.0, 1.5):
            assert np.isnan(damping_ratio(method, 0.1, xi))
            assert np.isnan(period_error(method, 0.1, xi))
    failing = eig3.CentralDifference(solver="fixed-point")
    np.testing.assert_array_equal(np.isnan(damping_ratio(failing, [0.5, 1.9], 0.9)), [False, True])
    for method in (eig3.EIG3(), CD):  # past the limit both roots are real
        assert np.isnan(damping_ratio(method, [2.01, 3.0])).all()
        assert np.isnan(period_error(method, [2.01, 3.0])).all()


@pytest.mark.parametrize("function", [damping_ratio, period_error])
def test_arrays_hold_what_single_calls_give(function):
    Omega, xi = np.array([0.1, 0.7, 1.9, 0.3]), np.array([[0.0], [0.05], [1.2]])
    for method in ALL_METHODS:
        together = function(method, Omega, xi)
        assert together.shape == (3, 4)
        alone = np.array([[function(method, x, y) for x in Omega] for y in xi[:, 0]])
        # the compiler may fuse multiply-adds differently in loops over many and over one: 1e-15, over Omega^2 = 0.01
        np.testing.assert_allclose(together, alone, rtol=1e-9, atol=1e-10)
    assert isinstance(function("rk4", 0.5), float)
    assert isinstance(function("rk4", np.float64(0.5), 0.1), float)
    assert function("rk4", []).shape == (0,)


@pytest.mark.parametrize("function", [damping_ratio, period_error, principal_root])
@pytest.mark.parametrize("Omega", [0.0, -1.0, math.nan, [0.1, 0.0]])
def test_omega_must_be_positive(function, Omega):
    with pytest.raises(ValueError, match=r"^Omega must be positive\.$"):
        function("eig3", Omega)


@pytest.mark.parametrize("function", [limit, explain, is_stable, amplification_matrix, damping_ratio])
def test_an_unknown_method_is_refused(function):
    for method in ("euler", None, 3):
        with pytest.raises(ValueError, match="method must be one of 'eig3', 'cd', 'rk2'"):
            function(method, *[1.0] * (function not in (limit, explain)))


def test_principal_root_is_followed_past_larger_roots():
    """AB3's parasite is larger than its principal root from Omega = 0.7 on; the latter still winds with Omega."""
    Omega = np.linspace(0.05, 1.2, 24)
    root = principal_root("ab3", Omega)
    assert spectral_radius("ab3", 1.2) > 1.1 * abs(root[-1])
    for one, z in zip(Omega, root, strict=True):
        assert z == pytest.approx(adams_bashforth_root([23 / 12, -16 / 12, 5 / 12], one), abs=1e-9)


# In words ------------------------------------------------------------------------------------------------------------


def number(pattern, text):
    found = re.search(pattern, text)
    return None if found is None else float(found[1])


def term(text):
    """The value of a term such as '11 Omega^2/120', '-Omega/4' or '0.06542 Omega^2' as (coefficient, power)."""
    found = re.fullmatch(r"(-?)([\d.e-]*) ?Omega(?:\^(\d+))?(?:/(\d+))?", text)
    sign, factor, power, divisor = found.groups()
    return float(f"{sign}{factor or 1}") / int(divisor or 1), int(power or 1)


def check_words(method):
    text = explain(method)
    first, undamped, damped, damping, period = text.splitlines()
    record = method if isinstance(method, eig3.Method) else eig3.METHODS[method]()
    free = record.without_velocity()
    assert first.startswith(f"{record!r}: order {record.order}, ")
    if record.is_implicit:
        assert "a solve if the force reads velocity" in first
    else:
        plural = "s" if record.evaluations > 1 else ""
        assert f" {record.evaluations} evaluation{plural} a step." in first
    if limit(free) == 0:
        assert undamped.startswith("  Undamped, it is stable at no step, however small, but it grows weakly: by ")
        coefficient, power = term(re.search(r"weakly: by (.*?) a step", undamped)[1])
        practical = number(r"below 1e-5 up to omega h = ([\d.]*\d)\.$", undamped)
        assert practical == pytest.approx(practical_limit(free), rel=1e-3)
        Omega = 0.01 if power < 5 else 0.1  # the next term is some ten times Omega^2 of it; 1e-12 of round-off
        assert spectral_radius(free, Omega) - 1 == pytest.approx(coefficient * Omega**power, rel=0.15, abs=1e-12)
    else:
        assert number(r"stable up to omega h = ([\d.]*\d)", undamped) == pytest.approx(limit(free), rel=1e-5)
        if record.evaluations is not None:
            assert number(r"([\d.]*\d) per evaluation", undamped) == pytest.approx(
                limit(free) / record.evaluations, rel=1e-3
            )
    limits = re.findall(r"([\d.]+) \(xi = ([\d.]+)\)", damped)
    assert [float(xi) for _, xi in limits] == ([] if record.ignores_velocity else [0.01, 0.1, 0.5, 1.0])
    for value, xi in limits:
        assert not record.ignores_velocity
        assert float(value) == pytest.approx(limit(method, float(xi)), rel=1e-5)  # of six digits printed
    # a term is printed with four digits or as a fraction; at 0.01 the next term is some ten times 1e-4 of it
    if "no numerical damping" in damping:
        assert abs(damping_ratio(free, 0.3)) < 1e-9
    else:
        coefficient, power = term(re.search(r"ratio is (.*?) \+ O\(Omega\^(\d+)\)", damping)[1])
        assert ("adds energy" in damping) == ("negative" in damping) == (coefficient < 0)
        assert f"O(Omega^{power + 2})" in damping
        Omega = 0.01 if power < 4 else 0.05
        assert damping_ratio(free, Omega) == pytest.approx(coefficient * Omega**power, rel=10 * Omega**2 + 1e-3)
    coefficient, power = term(re.search(r"exact one by (.*?) \+ O\(Omega\^(\d+)\)", period)[1])
    assert coefficient > 0
    assert f"O(Omega^{power + 2})" in period
    sign = 1 if "longer" in period else -1
    assert ("longer" in period) != ("shorter" in period)
    Omega = 0.02
    assert period_error(free, Omega) == pytest.approx(sign * coefficient * Omega**power, rel=10 * Omega**2 + 1e-3)
    return text


def test_every_method_is_explained_in_words(method):
    check_words(method)


@pytest.mark.parametrize(("alpha", "beta"), SETS)
def test_every_set_of_eig3_is_explained_in_words(alpha, beta):
    check_words(eig3.EIG3(alpha, beta))


def test_leading_terms_are_given_as_fractions():
    for method, *terms in LEADING:
        text = explain(method)
        for one in filter(None, terms):
            said = [term(x) for x in re.findall(r"(?:ratio is|one by) (.*?) \+ O", text)]
            assert any(
                power == one[1] and abs(coefficient) == pytest.approx(abs(one[0]), rel=1e-12)
                for coefficient, power in said
            )


def test_a_users_method_is_explained_in_words(symplectic_euler):
    """Symplectic Euler has leapfrog's roots undamped, and lagged central difference's limit damped."""
    text = check_words(symplectic_euler())
    assert check_words("symplectic-euler") == text
    assert "order 1, 1 evaluation a step" in text
    assert "It has no numerical damping." in text
    assert "Omega^2/24 " in text
    for xi in (0.0, 0.1, 0.5, 1.0):
        assert limit(symplectic_euler(), xi) == pytest.approx(2 * (math.sqrt(1 + xi * xi) - xi), abs=1e-9)
    # its matrix: v' = v - s u - d v, u' = u + v'
    s, d = 0.49, 0.14
    expected = [[1 - s, 1 - d], [-s, 1 - d]]
    np.testing.assert_allclose(amplification_matrix(symplectic_euler(), 0.7, 0.1), expected, atol=4 * EPS)


def test_a_search_ends_where_round_off_is_above_its_accuracy():
    """Of 1e-10, as for a spring beside a damper that is 1e9 times as fast. Each evaluation halves the interval."""
    evaluations, exact = iter(range(64)), 1e9 / 3

    def excess(x):
        next(evaluations)
        return x - exact

    low, high = first_above(excess, 0.0, blocks=[np.array([1.0, 1e9])])
    assert low <= exact <= high <= low + 2 * np.spacing(high)
