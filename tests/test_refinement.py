"""`explain(check=True)`: the error and the order of a run, from runs with shorter steps."""

import copy
import re

import numpy as np
import pytest

import eig3
from eig3.diagnosis.refinement import Refinement

from .conftest import spring


@eig3.jit
def jump(t, u, v, p):
    return (1.0 if t > 1 / 3 else 0.0) - u


def numbers(pattern, text):
    return [float(x) for x in re.search(pattern, text).groups()]


@pytest.mark.parametrize(
    ("method", "h", "options"),
    [
        ("eig3", 0.01, {}),
        ("eig3", 0.01, {"save_every": None}),
        ("eig3", 0.01, {"save_every": 7}),
        ("eig3", 0.01, {"t_eval": np.linspace(0, 10, 33)}),
        ("rk4", 0.1, {}),
        ("rk8", 0.5, {}),
    ],
)
def test_a_smooth_run_shows_the_order_of_its_method(method, h, options):
    solution = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, h=h, method=method, **options)
    text = solution.explain(check=True)
    error, seen, order = numbers(r"error of u is about ([\d.e-]+),.* show the order ([\d.]+), .* order (\d+)", text)
    assert error == pytest.approx(np.abs(solution.u - np.cos(solution.t)).max(), rel=0.1)
    assert order == solution.method.order
    assert seen == pytest.approx(order, abs=0.5)
    assert "kinks" not in text


def test_a_jump_lowers_the_order():
    text = eig3.integrate(jump, (0, 10), 1.0, 0.0, h=0.01, method="rk4").explain(check=True)
    (seen,) = numbers(r"they show the order (-?[\d.]+)", text)
    assert seen < 3
    assert "The order is lower if rhs has kinks or jumps" in text


def test_the_error_and_the_order_follow_by_richardsons_rule():
    """From displacements with the errors e, e / q and e / q^2."""
    t = np.linspace(0, 1, 11)
    u, e = np.cos(t), 1e-3 * np.sin(t)
    for order, is_lower in ((3.5, False), (3.3, True)):
        q = 2**order
        found = Refinement.of(t, u + e, u + e / q, u + e / q**2, 2.0)
        np.testing.assert_allclose(found.error, e, rtol=0, atol=1e-15)
        assert found.order == pytest.approx(order, abs=1e-9)
        assert ("kinks" in found.of_steps("RK4", 4, 0.1)) == is_lower


def test_tolerances():
    solution = eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, rtol=1e-5, method="rk5")
    error, factor = numbers(r"is about ([\d.e-]+),.* divides it by ([\d.]+)\.$", solution.explain(check=True))
    assert error == pytest.approx(np.abs(solution.u - np.cos(solution.t)).max(), rel=0.2)
    assert 4 < factor < 25


def test_what_cannot_be_checked_says_why():
    solution = copy.copy(eig3.integrate(spring, (0, 10), 1.0, 0.0, params=1.0, h=0.01))
    with pytest.raises(ValueError, match="check needs the run"):
        solution.explain(check=True)
    noisy = eig3.integrate(spring, (0, 1), 1.0, 0.0, params=1.0, h=0.01, method=eig3.Langevin(1.0, 1.0))
    with pytest.raises(ValueError, match="adds random numbers"):
        noisy.explain(check=True)
