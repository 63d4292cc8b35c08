"""What a right-hand side reads or writes beyond its arrays is found at the start."""

import numpy as np
import pytest

import eig3
from eig3 import integrate

from .conftest import linear_spring as stiff
from .conftest import linear_springs as stiff_vector


@eig3.jit
def second_parameter(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -p[0] * u[j] - p[1] * v[j]


@eig3.jit
def beyond_u(t, u, v, p, a):
    for j in range(u.size):
        a[j] = u[j + 1] - u[j]


@eig3.jit
def beyond_v(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -u[j] + 0.1 * (v[j + 1] - v[j])


@eig3.jit
def before_v(t, u, v, p, a):
    a[0] = a[1] = -u[0] - v[np.int64(p[0]) - v.size]  # -v.size is the first entry; one less is before it


@eig3.jit
def beyond_a(t, u, v, p, a):
    for j in range(u.size + 1):
        a[j] = -u[0]


@eig3.jit
def undefined(t, u, v, p, a):
    for j in range(u.size):
        a[j] = np.sqrt(-1.0 - p[0] * u[j])


@eig3.jit
def another_array(t, u, v, p, a):
    a = -u  # noqa: F841


@eig3.jit
def adds(t, u, v, p, a):
    a[0] = -u[0]
    a[1] -= u[1]


PAIR = {"u0": [1.0, 2.0], "v0": [0.0, 0.0]}


@pytest.mark.parametrize("inline", [False, True])
@pytest.mark.parametrize(
    ("rhs", "start", "message"),
    [
        (stiff, {"u0": 1.0, "v0": 0.0}, r"reads beyond the end of p \(0 values\); give params all the values it reads"),
        (stiff_vector, PAIR, r"rhs gives nan for degree of freedom 0 at the start, because it reads beyond .* p \(0 "),
        (second_parameter, {**PAIR, "params": 3.0}, r"beyond the end of p \(1 values\)"),
        (beyond_u, PAIR, r"freedom 1 at the start, because it reads beyond the end of u \(2 values\); give u0"),
        (beyond_v, PAIR, r"beyond the end of v \(2 values\); give v0"),
        (beyond_a, PAIR, "rhs writes beyond the end of a, which has 2 entries"),
        (undefined, {**PAIR, "params": 1.0}, "it must give a finite acceleration for every degree of freedom"),
        (another_array, PAIR, r"because it does not write a\[0\], .* and not a = \.\.\., which makes"),
        (adds, PAIR, r"because it does not write a\[1\], or adds to it before"),
    ],
    ids=["params", "params of a vector", "one of two", "u", "v", "a", "another reason", "another array", "a sum"],
)
def test_arrays_that_are_too_short_raise(rhs, start, message, inline):
    with pytest.raises(ValueError, match=message):
        integrate(rhs, (0, 1), h=0.1, inline=inline, **start)


@pytest.mark.parametrize("rhs", [stiff, stiff_vector])
def test_parameters_that_are_there_are_enough(rhs):
    u0 = 1.0 if rhs is stiff else [1.0, 2.0]
    run = integrate(rhs, (0, 1), u0, np.zeros_like(u0), h=0.01, params=4.0, method="rk4")
    assert run.u[-1] == pytest.approx(np.cos(2.0) * np.array(u0), abs=1e-8)  # the error of RK4 is some (2 h)^4 / 100


def test_a_negative_index_counts_from_the_end_as_in_python():
    run = integrate(before_v, (0, 1), h=0.1, params=0.0, **PAIR)
    assert run.success
    with pytest.raises(ValueError, match=r"beyond the end of v"):
        integrate(before_v, (0, 1), h=0.1, params=-1.0, **PAIR)


def test_an_acceleration_takes_any_array_of_the_right_shape():
    stepper = eig3.Stepper(stiff_vector, h=0.1, params=2.0, **PAIR)
    np.testing.assert_array_equal(stepper.acceleration(0, np.arange(4.0)[::2], [0, 0]), [0.0, -4.0])
    np.testing.assert_array_equal(stepper.acceleration(0.0, np.array([1, 2]), np.zeros(2)), [-2.0, -4.0])
    with pytest.raises(ValueError, match=r"must have the shape of u0, \(2,\), not \(3,\)"):
        stepper.acceleration(0.0, np.zeros(3), np.zeros(2))
    assert eig3.Stepper(stiff, 1.0, 0.0, h=0.1, params=2.0).acceleration(0, 3, 1) == -6.0


@eig3.jit
def stops_writing(t, u, v, p, a):
    a[0] = -u[0]
    if t < p[0]:
        a[1] = -u[1]


@eig3.jit
def root_of_the_rest(t, u, v, p, a):
    a[0] = np.sqrt(p[0] - t)
    a[1] = 0.0


@pytest.mark.parametrize("method", ["eig3", "rk4", "cd", "ab3"])
def test_an_entry_that_rhs_stops_writing_is_found_at_the_end(method):
    with pytest.raises(ValueError, match=r"rhs does not write a\[1\] at t = 9.99, so that a\[1\] keeps") as caught:
        integrate(stops_writing, (0, 10), h=0.01, params=5.0, method=method, **PAIR)
    assert caught.value.solution.n_steps == 1000
    assert caught.value.solution.status is eig3.Status.INTERRUPTED
    assert integrate(stops_writing, (0, 10), h=0.01, params=20.0, method=method, **PAIR).success


def test_an_entry_that_becomes_nan_counts_as_written():
    run = integrate(root_of_the_rest, (0, 10), h=0.01, params=5.0, **PAIR)
    assert run.status is eig3.Status.DIVERGED
    assert "rhs gives nan at t = 5.01" in run.explain()
    assert integrate(root_of_the_rest, (0, 5), h=0.01, params=5.0 - 1e-9, **PAIR).success  # NaN at the last time only
