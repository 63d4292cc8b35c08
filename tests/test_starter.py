"""A multistep method in one file and one record: AB4, which RK4 starts."""

import importlib
import sys

import numpy as np
import pytest

import eig3
from eig3.stability import amplification_matrix, limit

from .conftest import coupled, gyroscope, oscillator, python

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


@element
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


def test_it_takes_one_file_of_some_forty_lines():
    code = [line for line in AB4.splitlines() if line.strip()]
    assert len(code) < 50


@pytest.mark.parametrize(
    ("rhs", "u0", "v0", "params", "inline"),
    [
        (oscillator, 1.0, 0.2, (2.0, 0.1), False),
        (coupled, [0.1, 0.2, -0.3], [0.0, 0.1, 0.0], (3.0, 1.0, 2.0), True),
        (gyroscope, [0.0] * 3, [1.0, 0.0, 0.0], (1.0,), False),
    ],
    ids=["damped", "damped and forced, inline", "gyroscopic"],
)
def test_order_is_four_from_the_first_step_on(ab4, rhs, u0, v0, params, inline):
    """Errors against RK4 at a step so short that its own are some 1e-13."""
    options = {"params": params, "inline": inline}
    exact = eig3.integrate(rhs, (0, 4), u0, v0, h=1e-3, method="rk4", params=params)
    errors = []
    for h in (0.04, 0.02, 0.01):
        run = eig3.integrate(rhs, (0, 4), u0, v0, h=h, method="ab4", **options)
        errors.append(np.abs(run.u - exact.u[:: round(h / 1e-3)]).max())
    ratios = np.divide(errors[:-1], errors[1:])
    assert ratios == pytest.approx(16, rel=0.2)  # the next term of the error is h times some ten times the first


def test_rk4_starts_it(ab4):
    options = {"h": 0.1, "params": (4.0, 0.1)}
    run, rk4 = (eig3.integrate(oscillator, (0, 0.5), 0.5, 0.25, method=m, **options) for m in ("ab4", "rk4"))
    np.testing.assert_array_equal(run.u[:4], rk4.u[:4])
    assert run.u[4] != rk4.u[4]
    assert run.n_rhs == 1 + 3 * (4 + 1) + 2  # a starting step also records f at its start


@pytest.mark.parametrize("inline", [False, True])
def test_chunks_agree_bit_for_bit(ab4, inline):
    """The rows come back to their places at the end of each chunk, wherever it ends."""
    options = {"h": 0.02, "params": (3.0, 1.0, 2.0), "method": "ab4", "inline": inline}
    whole, parts = (eig3.Stepper(coupled, [0.1, 0.2, -0.3], [0.0, 0.1, 0.0], **options) for _ in range(2))
    whole.advance(60)
    for count in (1, 1, 2, 3, 5, 8, 13, 27):
        parts.advance(count)
    np.testing.assert_array_equal(whole.u, parts.u)
    np.testing.assert_array_equal(whole.v, parts.v)
    assert whole.n_rhs == parts.n_rhs


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


CHUNG_LEE = '''
"""The explicit method of Chung and Lee, Int. J. Numer. Meth. Engng 37 (1994) 3961, with gamma = 3/2."""

from dataclasses import dataclass
from typing import ClassVar

import eig3

PAST, ROWS, EVALUATIONS = 1, 4, 1


def constants(settings, h, work):
    return h * h * (0.5 - settings[0]), h * h * settings[0]


def start(u, v, a, h):
    return (a,)


def step(f, at, y, c, n):
    u, v, a_past, a = y
    f(at.t, u, v, at.p, a)
    for j in range(n):
        u[j] += at.h * v[j] + c[0] * a_past[j] + c[1] * a[j]
        v[j] += at.h * (1.5 * a[j] - 0.5 * a_past[j])
    return (u, v, a, a_past), True


@dataclass(frozen=True)
class ChungLee(eig3.Method):
    beta: float = 28 / 27
    name: ClassVar[str] = "chung-lee"
    label: ClassVar[str] = "Chung-Lee"
    kernel: ClassVar[str] = __name__
    order: ClassVar[int] = 2
'''


def test_functions_need_no_decorator_and_get_the_numbers_of_the_record(tmp_path, monkeypatch):
    """With the same past values, the formulas are the ones of EIG-3 with alpha = 2 beta - 1."""
    (tmp_path / "chung_lee.py").write_text(CHUNG_LEE)
    monkeypatch.syspath_prepend(tmp_path)
    method = importlib.import_module("chung_lee").ChungLee
    try:
        for beta in (1.0, 28 / 27):
            # each limit is found to 1e-10
            assert limit(method(beta)) == pytest.approx(limit(eig3.EIG3(alpha=2 * beta - 1)), rel=1e-9)
    finally:
        del sys.modules["chung_lee"], eig3.METHODS["chung-lee"]
