"""A multistep method in one file and one record: AB4, which RK4 starts. Its step needs no decorator."""

import importlib
import sys

import numpy as np
import pytest

import eig3
from eig3.stability import amplification_matrix, limit

from .conftest import coupled, oscillator, python

AB4 = '''
"""AB4, the fourth-order Adams-Bashforth method on (u, v); RK4 takes the first three steps."""

from dataclasses import dataclass
from typing import ClassVar

import eig3
from eig3.kernels.compile.jit import element

PAST, ROWS, EVALUATIONS = 6, 9, 1
START, START_STEPS = "rk4", 3


@element
def adams(x, s, s1, s2, s3, h):
    return x + h / 24 * (55 * s - 59 * s1 + 37 * s2 - 9 * s3)


def step(f, at, y, c, n):
    u, v, v1, a1, v2, a2, v3, a3, a = y
    f(at.t, u, v, at.p, a)
    for j in range(n):
        v_now = v[j]
        u[j] = adams(u[j], v_now, v1[j], v2[j], v3[j], at.h)
        v[j] = adams(v_now, a[j], a1[j], a2[j], a3[j], at.h)
        v3[j] = v_now
    return (u, v, v3, a, v1, a1, v2, a2, a3), True


@dataclass(frozen=True)
class AB4(eig3.Method):
    """Adams-Bashforth of fourth order."""

    name: ClassVar[str] = "ab4"
    label: ClassVar[str] = "AB4"
    kernel: ClassVar[str] = __name__
    order: ClassVar[int] = 4
'''


@pytest.fixture(scope="module")
def ab4(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ab4")
    (folder / "ab4.py").write_text(AB4)
    sys.path.insert(0, str(folder))
    yield importlib.import_module("ab4").AB4()
    sys.path.remove(str(folder))
    del sys.modules["ab4"], eig3.METHODS["ab4"]


def test_order_is_four_from_the_first_step_on(ab4):
    """Errors against RK4 at a step so short that its own are some 1e-13."""
    start = oscillator, (0, 4), 1.0, 0.2
    exact = eig3.integrate(*start, h=1e-3, method="rk4", params=(2.0, 0.1))
    errors = []
    for h in (0.04, 0.02, 0.01):
        run = eig3.integrate(*start, h=h, method="ab4", params=(2.0, 0.1))
        errors.append(np.abs(run.u - exact.u[:: round(h / 1e-3)]).max())
    ratios = np.divide(errors[:-1], errors[1:])
    assert ratios == pytest.approx(16, rel=0.2)  # the next term of the error is h times some ten times the first


def test_rk4_starts_it(ab4):
    options = {"h": 0.1, "params": (4.0, 0.1)}
    run, rk4 = (eig3.integrate(oscillator, (0, 0.5), 0.5, 0.25, method=m, **options) for m in ("ab4", "rk4"))
    np.testing.assert_array_equal(run.u[:4], rk4.u[:4])
    assert run.u[4] != rk4.u[4]
    assert run.n_rhs == 1 + 3 * (4 + 1) + 2  # a starting step also records f at its start


def test_stability_is_that_of_the_formula(ab4):
    """A step after the starting ones, on (u, h v, past ...)."""
    Omega = 0.3
    A = np.array([[0.0, 1.0], [-(Omega**2), 0.0]])
    expected = np.zeros((8, 8))
    expected[:2] = np.hstack([np.eye(2) + 55 / 24 * A, -59 / 24 * np.eye(2), 37 / 24 * np.eye(2), -9 / 24 * np.eye(2)])
    expected[2:4, :2] = A
    expected[4:, 2:6] = np.eye(4)
    np.testing.assert_allclose(amplification_matrix("ab4", Omega), expected, atol=1e-14)
    assert limit("ab4") == pytest.approx(0.43, abs=0.005)  # the known limit of AB4 on the imaginary axis


def take_five_steps_in_both_forms(method):
    for rhs, u0 in ((oscillator, 1.0), (coupled, [1.0, 2.0, 3.0])):
        eig3.Stepper(rhs, u0, np.zeros_like(u0), h=0.1, params=(1.0, 1.0, 1.0), method=method).advance(5)


@pytest.mark.parametrize(
    ("change", "error", "message"),
    [
        ({"ROWS": 10}, Exception, "wrong tuple length"),
        ({"START_STEPS": 0}, TypeError, "must define START and START_STEPS together"),
    ],
)
def test_a_wrong_declaration_does_not_compile(ab4, tmp_path, monkeypatch, change, error, message):
    code = AB4.replace('"ab4"', '"wrong"')
    for name, value in change.items():
        code += f"\n{name} = {value}\n"
    (tmp_path / "wrong_ab4.py").write_text(code)
    monkeypatch.syspath_prepend(tmp_path)
    method = importlib.import_module("wrong_ab4").AB4()
    try:
        with pytest.raises(error, match=message):
            take_five_steps_in_both_forms(method)
    finally:
        del sys.modules["wrong_ab4"], eig3.METHODS["wrong"]


def test_a_past_that_is_too_small_is_seen(ab4, tmp_path, monkeypatch):
    (tmp_path / "short_ab4.py").write_text(AB4.replace('"ab4"', '"short"') + "\nPAST = 5\n")
    monkeypatch.syspath_prepend(tmp_path)
    method = importlib.import_module("short_ab4").AB4()
    try:
        stepper, whole = (eig3.Stepper(oscillator, 1.0, 0.0, h=0.1, params=(1.0, 1.0), method=m) for m in (method, ab4))
        for each in (stepper, whole):
            each.advance(5)  # after a slice, or more of them on a slow machine, only the past is kept
            each.advance(5)
        assert whole.is_finite
        assert not stepper.is_finite
    finally:
        del sys.modules["short_ab4"], eig3.METHODS["short"]


LOSES_A_ROW = """
import eig3, ab4
try:
    eig3.integrate(eig3.problems.spring_pendulum().rhs, (0, 1), [1.0, 1.0], [0.0, 0.0], h=0.1,
                   params=(1.0, 0.5, 98.1, 9.81), method="ab4")
except IndexError as error:
    print(error)
"""


@pytest.mark.system
def test_a_step_that_returns_a_row_twice_is_found_where_indices_are_checked(tmp_path):
    (tmp_path / "ab4.py").write_text(
        AB4.replace("v3, a, v1, a1, v2, a2, a3), True", "v3, a, v1, a1, v1, a2, a3), True")
    )
    printed = python("-c", LOSES_A_ROW, NUMBA_BOUNDSCHECK="1", PYTHONPATH=str(tmp_path))
    assert "each of its rows once" in printed
