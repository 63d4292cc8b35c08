"""How central difference solves for the velocity when it is left to the library."""

import copy

import numpy as np
import pytest

import eig3
from eig3 import CentralDifference, integrate

from .conftest import coupled, oscillator, spring


@eig3.jit
def cluster(t, u, v, p, a):
    """Atoms in a row with forces between neighbours; nothing loads v."""
    n = u.size
    for j in range(n):
        a[j] = 0.0
    for j in range(n - 1):
        d = 1.0 + u[j + 1] - u[j]
        pull = p[0] * (d**-7 - d**-13)
        a[j] += pull
        a[j + 1] -= pull


@eig3.jit
def damped_cluster(t, u, v, p, a):
    cluster(t, u, v, p, a)
    for j in range(u.size):
        a[j] -= p[1] * v[j]


@eig3.jit
def stiffening_damper(t, u, v, p, a):
    c = p[0] if t > 1.0 else 0.1
    for j in range(u.size):
        a[j] = -u[j] - c * v[j]


def test_a_function_without_velocity_takes_one_evaluation_a_step():
    u0 = 0.01 * np.sin(np.arange(324.0))
    for method in ("cd", CentralDifference(), "eig3", eig3.EIG3()):
        run = integrate(cluster, (0, 1), u0, np.zeros(324), h=1e-2, params=10.0, method=method)
        assert run.n_rhs == run.n_steps + 1
        assert run.n_iterations == 0
        assert run.notes == ()


def test_a_large_damped_system_takes_a_few_evaluations_a_step():
    """Newton's method with differences would take 325 evaluations in each iteration."""
    u0 = 0.01 * np.sin(np.arange(324.0))
    run = integrate(damped_cluster, (0, 0.3), u0, np.zeros(324), h=1e-2, params=(10.0, 0.3), method="cd")
    newton = CentralDifference(solver="newton")
    by_newton = integrate(damped_cluster, (0, 0.3), u0, np.zeros(324), h=1e-2, params=(10.0, 0.3), method=newton)
    assert run.n_rhs < 10 * run.n_steps
    assert run.notes == ()
    np.testing.assert_allclose(run.u, by_newton.u, rtol=0, atol=1e-12)  # both solve to 1e-12 of v
    assert by_newton.n_rhs > 324 * run.n_steps
    assert any("differences of rhs" in note and "324 in each" in note for note in by_newton.notes)


@pytest.mark.parametrize(
    ("chunks", "inline"), [([400], False), ([1, 99, 1, 299], False), ([100, 101, 199], True)], ids=str
)
def test_newtons_method_takes_over_where_the_iteration_does_not_converge(chunks, inline):
    """h c / 2 is 0.0005 up to t = 1, and then 5: the iteration diverges at the step from there on."""
    options = {"h": 0.01, "params": 1000.0, "method": "cd", "inline": inline}
    stepper = eig3.Stepper(stiffening_damper, [1.0, 0.5, 0.1], [0.0] * 3, **options)
    u, v = np.empty((400, 3)), np.empty((400, 3))
    for count in chunks:
        first = stepper.index
        assert stepper.advance(count, 1, u[first:], v[first:]) == count
    assert stepper.changed_at == pytest.approx(1.0)
    newton = eig3.Stepper(
        stiffening_damper, [1.0, 0.5, 0.1], [0.0] * 3, h=0.01, params=1000.0, method=CentralDifference(solver="newton")
    )
    u_newton, v_newton = np.empty((400, 3)), np.empty((400, 3))
    newton.advance(400, 1, u_newton, v_newton)
    np.testing.assert_allclose(u, u_newton, rtol=0, atol=1e-11)  # both solve to 1e-12 of v, and steps add up
    np.testing.assert_allclose(v, v_newton, rtol=0, atol=1e-10)


def test_the_change_is_noted_and_undone_by_going_back():
    run = integrate(stiffening_damper, (0, 4), [1.0, 0.5], [0.0] * 2, h=0.01, params=1000.0, method="cd")
    assert run.success
    assert run.notes[0].startswith("From t = 1 on, CD solves for the velocity by Newton's method")
    stepper = eig3.Stepper(stiffening_damper, [1.0, 0.5], [0.0] * 2, h=0.01, params=1000.0, method="cd")
    stepper.advance(90)
    kept = stepper.fork()
    stepper.advance(50)
    assert (stepper.changed_at is None, kept.changed_at) == (False, None)
    after = stepper.u
    stepper.back()
    assert (stepper.changed_at, stepper.index) == (None, 90)
    np.testing.assert_array_equal(stepper.u, kept.u)
    stepper.advance(50)
    np.testing.assert_array_equal(stepper.u, after)


def test_a_solver_that_is_named_is_kept():
    method = CentralDifference(solver="fixed-point")
    run = integrate(stiffening_damper, (0, 4), [1.0, 0.5], [0.0] * 2, h=0.01, params=1000.0, method=method)
    assert run.status is eig3.Status.NOT_CONVERGED
    assert run.t[-1] == pytest.approx(1.0)
    assert "solver='newton' may help" in run.message


takes_v_by_another_name = eig3.jit(lambda t, u, speed, p: -u - 0.1 * speed)


@eig3.jit
def has_v_in_an_inner_function(t, u, v, p):
    def damping():
        return 0.1 * v

    return -u - damping()


hands_v_on = eig3.jit(lambda t, u, v, p: spring(t, u, v, p))


@eig3.jit
def assigns_v_only(t, u, v, p):
    v = 2.0 * u
    return -v


@pytest.mark.parametrize(
    ("rhs", "reads"),
    [
        (spring, False),
        (oscillator, True),
        (coupled, True),
        (cluster, False),
        (takes_v_by_another_name, True),
        (has_v_in_an_inner_function, True),
        (hands_v_on, True),  # what the other function does with it is not looked at
        (assigns_v_only, True),
    ],
    ids=lambda x: x.py_func.__name__ if hasattr(x, "py_func") else str(x),
)
def test_bytecode_tells_whether_a_function_may_read_v(rhs, reads):
    assert eig3.functions.callbacks.reads_velocity(rhs) is reads


def test_a_large_system_does_not_change_to_newtons_method():
    """65 degrees of freedom: the iteration fails at t = 1, and the run ends there at once."""
    run = integrate(stiffening_damper, (0, 4), np.ones(65), np.zeros(65), h=0.01, params=1000.0, method="cd")
    assert run.status is eig3.Status.NOT_CONVERGED
    assert run.n_rhs < 60 * 100
    assert "solver='newton'" in run.message


def test_a_copy_of_a_stepper_is_independent():
    stepper = eig3.Stepper(spring, 1.0, 0.0, h=0.1, params=(1.0,))
    stepper.advance(3)
    for other in (copy.copy(stepper), copy.deepcopy(stepper), stepper.fork()):
        other.advance(5)
        assert (stepper.index, other.index) == (3, 8)
        other.back()
        assert (other.u, other.v) == (stepper.u, stepper.v)


@pytest.mark.parametrize("method", ["eig3", "ab3", "cd"])
def test_going_back_keeps_new_parameters_and_starts_anew(method):
    """The past accelerations of the state before are those of other parameters."""
    first, other = (eig3.Stepper(spring, 1.0, 0.0, h=0.1, params=(1.0,), method=method) for _ in range(2))
    with pytest.raises(RuntimeError, match=r"^this stepper has taken no steps: call advance before back\."):
        first.back()
    for stepper in (first, other):
        stepper.advance(5)
    first.advance(5)
    first.params = other.params = (4.0,)
    first.back()
    for stepper in (first, other):
        stepper.advance(5)
    assert (first.u, first.v, first.n_rhs) == (other.u, other.v, other.n_rhs)


def test_the_state_before_is_independent_too():
    stepper = eig3.Stepper(spring, 1.0, 0.0, h=0.1, params=(1.0,))
    stepper.advance(10)
    before = stepper.before()
    for _ in range(2):
        before.advance(5)
    before.back()
    stepper.back()
    assert (before.index, stepper.index) == (5, 0)
    assert stepper.u == 1.0
    before.advance(0)
    for _ in range(2):
        before.back()  # the call without steps, and nothing
    assert before.index == 5
