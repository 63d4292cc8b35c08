"""Powers such as x ** 1.5 are compiled to square roots: their rounding, their special values, and where this holds."""

import re

import numba
import numpy as np
import pytest

import eig3
from eig3.kernels.compile.numba_internals import compile_results, optimised_code

EXPONENTS = [sign * (k + 0.5) for k in range(4) for sign in (1, -1)]
SPECIAL = [0.0, np.inf, np.nan, -1.0, -2.5, 5e-324, 1e-310, 1.7e308, 1.0]


def power(exponent):
    return eig3.jit(eval(f"lambda x: x ** {exponent}"), cache=False)


@pytest.mark.parametrize("exponent", EXPONENTS)
def test_a_half_power_is_rounded_as_its_root_and_products(exponent):
    """Each operation adds half an ulp, relative to the largest unit; a unit is up to twice as large, relatively.

    The powers in the extended precision of NumPy have 11 more bits. Special values are those of pow.
    """
    x = np.exp(np.random.default_rng(3).uniform(-60, 60, 20000))
    exact = x.astype(np.longdouble) ** np.longdouble(exponent)
    function = power(exponent)
    found = np.array([function(value) for value in x])
    units = np.spacing(found).astype(np.longdouble)
    operations = 1 + int(abs(exponent)) + (exponent < 0)
    assert np.abs((found - exact) / units).max() <= 0.5 + (operations - 1)
    with np.errstate(all="ignore"):
        expected = [float(np.power(value, exponent)) for value in SPECIAL]
    np.testing.assert_allclose([function(value) for value in SPECIAL], expected, rtol=1e-15)


def test_what_differs_from_pow_has_no_normal_result():
    """Results below the smallest normal number may be zero; the sign of zero is free, also that of its inverse."""
    assert power(-1.5)(1e205) == pytest.approx(10**-307.5, rel=1e-14)
    assert power(-1.5)(1e207) == 0.0
    assert abs(power(-0.5)(-0.0)) == np.inf
    assert np.isnan(power(1.5)(-np.inf))


def test_whole_numbers_arrays_and_assignments_have_half_powers_too():
    @eig3.jit(cache=False)
    def assigned(x):
        x **= 2.5
        return x

    assert assigned(4) == 32.0
    assert power(-1.5)(4) == 0.125
    np.testing.assert_array_equal(power(1.5)(np.array([4.0, 9.0])), [8.0, 27.0])
    assert power(0.75)(16.0) == 8.0  # by pow
    assert power(4.5)(4.0) == 512.0  # by pow


def calls_pow(function):
    code = optimised_code(next(iter(compile_results(getattr(function, "for_python", function)).values())))
    return bool(re.search(r"(llvm\.pow|@pow)\b", code))


def test_no_pow_is_left():
    with_root, with_pow = power(1.5), power(0.7)
    plain = numba.njit(with_root.py_func)
    for function in (with_root, with_pow, plain):
        function(2.0)  # which compiles it for calls from Python
    assert [calls_pow(function) for function in (with_root, with_pow, plain)] == [False, True, True]


@eig3.jit
def planet(t, u, v, p, a):
    per_cube = p[0] * (u[0] * u[0] + u[1] * u[1]) ** -1.5
    a[0] = -u[0] * per_cube
    a[1] = -u[1] * per_cube


def test_inlined_functions_have_roots_too():
    """The orbit of one period: the runs differ by the order in which LLVM fuses products and sums."""
    options = {"params": [1.0], "h": 0.01}
    called, inlined = (
        eig3.integrate(planet, (0, 5), [1.0, 0.0], [0.0, 1.0], inline=inline, **options).u for inline in (False, True)
    )
    np.testing.assert_allclose(inlined, called, rtol=0, atol=1e-13)
    members = eig3.ensemble(planet, (0, 5), np.array([[1.0, 0.0]] * 2), [0.0, 1.0], **options)
    np.testing.assert_allclose(members.u[:, -1], called[[-1, -1]], rtol=0, atol=1e-13)
