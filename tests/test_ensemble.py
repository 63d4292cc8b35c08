"""Ensembles: each member is what a run alone gives, and no member sees the others."""

import math
import os
import signal
import threading

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3.ensembles import ensemble, in_process, lanewise
from eig3.ensembles.single_members import Singles
from eig3.kernels.lanes import BlockLayout, compile_rhs
from eig3.kernels.protocol import SCALAR, VECTOR

from .conftest import above_level, linear_spring, linear_springs
from .test_prepare import python_calls

# Both sums are computed from the same formulas, but the compiler may fuse other multiply-adds for lanes: each step then
# differs by some units in the last place, and the difference grows with the number of steps.
ROUND_OFF = 1e-11

duffing = eig3.jit(lambda t, u, v, p: p[3] * eig3.math.cos(p[4] * t) - u * (p[0] + p[1] * u * u) - p[2] * v)


spring_energy = eig3.jit(lambda t, u, v, p: (v * v + p[0] * u * u) / 2)


@eig3.jit
def chain(t, u, v, p, a):
    for j in range(u.size):
        left = u[j - 1] if j > 0 else 0.0
        right = u[j + 1] if j < u.size - 1 else 0.0
        a[j] = p[0] * (left - 2 * u[j] + right) - p[1] * u[j] ** 3


@eig3.jit
def damped_chain(t, u, v, p, a):
    for j in range(u.size):
        left = u[j - 1] if j > 0 else 0.0
        right = u[j + 1] if j < u.size - 1 else 0.0
        a[j] = p[0] * (left - 2 * u[j] + right) - p[1] * u[j] ** 3 - 0.1 * v[j] + eig3.math.sin(t)


@eig3.jit
def chain_energy(t, u, v, p):
    total = p[0] * u[-1] * u[-1] / 2
    for j in range(u.size):
        left = u[j - 1] if j > 0 else 0.0
        total += v[j] * v[j] / 2 + p[0] * (u[j] - left) ** 2 / 2 + p[1] * u[j] ** 4 / 4
    return total


last_position = eig3.jit(lambda t, u, v, p: u[-1])


def start(m, n=None, seed=0):
    """Return displacements and velocities of m members."""
    shape = m if n is None else (m, n)
    rng = np.random.default_rng(seed)
    return rng.uniform(-0.5, 0.5, shape), rng.uniform(-0.5, 0.5, shape)


def stiffness(m):
    return np.linspace([10.0, 1.0], [20.0, 3.0], m)


def drive(m):
    return np.linspace([-1, 1, 0.3, 0.1, 1.0], [1, 1, 0.1, 0.5, 1.4], m)


def assert_same(ensemble, other, chosen=slice(None)):
    """All numbers of the members are equal to the last bit."""
    for name in ("t", "u", "v", "n_steps", "n_rhs", "status", "message"):
        np.testing.assert_array_equal(getattr(ensemble, name)[chosen], getattr(other, name), name)
    for name, values in ensemble.drift.items():
        np.testing.assert_array_equal(values[chosen], other.drift[name])
        for one, two in zip(ensemble.extremes[name], other.extremes[name], strict=True):
            np.testing.assert_array_equal(one[chosen], two)


def assert_alone(member, alone, rtol=ROUND_OFF):
    """A member is what a run alone gives, except for round-off."""
    assert (member.n_steps, member.n_rhs, member.status) == (alone.n_steps, alone.n_rhs, alone.status)
    np.testing.assert_array_equal(member.t, alone.t)
    size = np.abs(alone.u).max() + np.abs(alone.v).max()
    np.testing.assert_allclose(member.u, alone.u, rtol=0, atol=rtol * size)
    np.testing.assert_allclose(member.v, alone.v, rtol=0, atol=rtol * size)


#: One of each kind. The formulas are those of runs alone: the others of a kind would only compile more kernels.
OF_SCALARS = ["eig9", eig3.CentralDifference(velocity="lagged")]
OF_VECTORS = ["eig3", "rk4", "ab3", eig3.EIG3(alpha=1.2)]
FOLLOWED = {"eig3", "rk4"}  # what follows invariants is the same for all


@pytest.mark.parametrize("method", OF_SCALARS, ids=repr)
def test_members_are_runs_alone(method):
    """For a force that reads t, u, v and p, with saved states."""
    options = {"h": 0.01, "method": method, "save_every": 7}
    u0, v0 = start(9)
    solution = eig3.ensemble(duffing, (0, 3), u0, v0, params=drive(9), **options)
    for i in (0, 8):
        alone = eig3.integrate(duffing, (0, 3), u0[i], v0[i], params=drive(9)[i], **options)
        assert_alone(solution[i], alone)
    assert solution.notes == ()
    assert solution.success.all()


@pytest.mark.parametrize("method", OF_VECTORS, ids=repr)
def test_members_of_several_degrees_of_freedom_are_runs_alone(method):
    options = {"h": 0.01, "method": method, "save_every": 7}
    u0, v0 = start(9, 3)
    if method in FOLLOWED:
        options["invariants"] = {"energy": chain_energy, "end": last_position}
    solution = eig3.ensemble(damped_chain, (0, 3), u0, v0, params=stiffness(9), **options)
    for i in (0, 8):
        alone = eig3.integrate(damped_chain, (0, 3), u0[i], v0[i], params=stiffness(9)[i], **options)
        assert_alone(solution[i], alone)
        assert solution[i].drift == pytest.approx(alone.drift, rel=1e-9)
        for name in alone.extremes:
            assert solution[i].extremes[name] == pytest.approx(alone.extremes[name], rel=1e-9)
    assert solution.notes == ()
    assert solution.success.all()


@pytest.mark.parametrize("method", ["bm6", "cd", "eig3"])
def test_methods_without_velocity(method):
    """For a force that ignores v, "cd" is explicit, and the EIG methods leave out what serves only the velocity."""
    u0, v0 = start(5, 3)
    solution = eig3.ensemble(chain, (0, 5), u0, v0, params=stiffness(5), h=0.02, method=method)
    for i in range(5):
        alone = eig3.integrate(
            chain, (0, 5), u0[i], v0[i], params=stiffness(5)[i], h=0.02, method=method, save_every=None
        )
        assert_alone(solution[i], alone)


def test_a_force_that_reads_the_velocity_is_refused_by_methods_that_ignore_it():
    u0, v0 = start(3, 2)
    with pytest.raises(ValueError, match="needs a rhs that ignores v"):
        eig3.ensemble(damped_chain, (0, 1), u0, v0, params=stiffness(3), h=0.01, method="bm6")


def test_implicit_members_run_alone():
    u0, v0 = start(4)
    options = {"h": 0.01, "method": eig3.CentralDifference(solver="newton"), "save_every": 50}
    solution = eig3.ensemble(duffing, (0, 3), u0, v0, params=drive(4), invariants={"e": spring_energy}, **options)
    for i in range(4):
        alone = eig3.integrate(duffing, (0, 3), u0[i], v0[i], params=drive(4)[i], **options)
        np.testing.assert_array_equal(solution[i].u, alone.u)
        assert solution[i].n_iterations == alone.n_iterations > 0


def test_many_degrees_of_freedom_run_alone():
    n = lanewise.MOST_DEGREES + 1
    u0, v0 = start(3, n)
    options = {"h": 0.01, "invariants": {"energy": chain_energy}}
    solution = eig3.ensemble(chain, (0, 1), u0, v0, params=stiffness(3), **options)
    alone = eig3.integrate(chain, (0, 1), u0[1], v0[1], params=stiffness(3)[1], save_every=None, **options)
    np.testing.assert_array_equal(solution[1].u, alone.u)
    assert (solution[1].drift, solution[1].extremes) == (alone.drift, alone.extremes)


@settings(max_examples=15, deadline=None)  # the first example compiles
@given(st.data())
def test_no_member_sees_the_others(data):
    """A member has the same bits in any order, with any others, in any block, on any number of threads."""
    m = 150  # more than a block
    chosen = np.array(data.draw(st.lists(st.integers(0, m - 1), min_size=1, max_size=m)))
    u0, v0 = start(m, 2)
    options = {"h": 0.01, "save_every": 10, "invariants": {"energy": chain_energy}}
    whole = eig3.ensemble(damped_chain, (0, 1), u0, v0, params=stiffness(m), threads=1, **options)
    part = eig3.ensemble(
        damped_chain, (0, 1), u0[chosen], v0[chosen], params=stiffness(m)[chosen], threads=3, **options
    )
    assert_same(whole, part, chosen)


OWN = ("params",), ("h",), ("params", "h"), ()


@pytest.mark.parametrize(
    ("method", "n", "own"),
    [("eig3", None, own) for own in OWN] + [("eig3", 2, OWN[2]), ("rk4", None, OWN[2]), ("ab3", 2, OWN[0])],
)
def test_a_member_has_the_same_bits_in_an_ensemble_of_its_own(method, n, own):
    """Whatever its number of members is, rhs is compiled for values of its own where they have a first axis."""
    m = 20
    rhs, params = (duffing, drive(m)) if n is None else (damped_chain, stiffness(m))
    u0, v0 = start(m, n, seed=m)
    steps = np.linspace(0.009, 0.011, m)

    def ensemble(chosen):
        p, h = (values[chosen] if name in own else values[7] for name, values in (("params", params), ("h", steps)))
        return eig3.ensemble(rhs, (0, 2), u0[chosen], v0[chosen], params=p, h=h, method=method)

    whole = ensemble(slice(None))
    for chosen in (slice(4, 5), slice(19, 20), slice(7, 10), slice(1, 18)):
        assert_same(whole, ensemble(chosen), chosen)


def test_the_number_of_lanes_does_not_change_the_bits(monkeypatch):
    u0, v0 = start(200, 2)
    options = {"h": 0.01, "params": stiffness(200), "method": "rk4"}
    usual = eig3.ensemble(damped_chain, (0, 1), u0, v0, **options)
    for lanes in (32, 256):
        monkeypatch.setattr(lanewise, "_FEW_LANES", lanes)
        monkeypatch.setattr(lanewise, "_MOST_LANES", lanes)
        assert_same(usual, eig3.ensemble(damped_chain, (0, 1), u0, v0, **options))


@pytest.mark.parametrize("own_step", [False, True])
def test_a_member_that_diverges_ends_at_its_finite_part(own_step):
    """Members 3 and 70 have a step above the critical one: they end where runs alone end, and the others go on."""
    m = 140
    p = np.full((m, 1), 10.0)
    p[[3, 70], 0] = 1e7, 3e6  # critical steps 6e-4 and 1.2e-3
    u0, v0 = start(m)
    h = np.full(m, 0.01) if own_step else 0.01
    options = {"save_every": 20, "invariants": {"energy": spring_energy}}
    solution = eig3.ensemble(linear_spring, (0, 5), u0, v0, h=h, params=p, **options)
    np.testing.assert_array_equal(np.flatnonzero(~solution.success), [3, 70])
    for i in (3, 70):
        alone = eig3.integrate(linear_spring, (0, 5), u0[i], v0[i], h=0.01, params=p[i], **options)
        member = solution[i]
        assert_alone(member, alone)
        assert member.drift == pytest.approx(alone.drift)
        assert member.message == alone.message
        assert np.isnan(solution.u[i, len(member.t) :]).all()
        assert "critical step" in member.explain()
    others = np.flatnonzero(solution.success)
    healthy = eig3.ensemble(
        linear_spring, (0, 5), u0[others], v0[others], h=h[others] if own_step else h, params=p[others], **options
    )
    assert_same(solution, healthy, others)


def test_a_degree_of_freedom_that_diverges_is_named():
    @eig3.jit
    def unequal(t, u, v, p, a):
        a[0] = -u[0]
        a[1] = -p[0] * u[1]

    solution = eig3.ensemble(unequal, (0, 50), [1.0, 1.0], [0.0, 0.0], h=0.1, params=[[1.0], [1e6]], save_every=10)
    alone = eig3.integrate(unequal, (0, 50), [1.0, 1.0], [0.0, 0.0], h=0.1, params=1e6, save_every=10)
    assert "in degree of freedom 1" in alone.message
    assert solution.message[1] == alone.message
    assert solution.status.tolist() == [eig3.Status.COMPLETED, eig3.Status.DIVERGED]


def test_a_motion_that_stays_finite_but_grows_because_of_the_step_diverged():
    """omega h = 2.02: the motion grows by a factor of 1e25 and stays finite. With h/2 it does not grow."""
    p = np.array([[1.0], [2.02**2 / 0.01]])
    solution = eig3.ensemble(linear_spring, (0, 20), [1.0, 1.0], 0.0, h=0.1, params=p)
    alone = eig3.integrate(linear_spring, (0, 20), 1.0, 0.0, h=0.1, params=p[1])
    assert alone.status is eig3.Status.DIVERGED
    assert np.isfinite(alone.u).all()
    assert solution.status.tolist() == [eig3.Status.COMPLETED, eig3.Status.DIVERGED]
    assert "with h = 0.05" in solution.message[1]
    assert solution[1].explain() == alone.explain()


def test_many_motions_that_grow_with_half_the_step_too_are_judged_together(monkeypatch):
    """A single run for the reason of each takes thousands of times as long as its steps.

    With h and with h/2, some grow to the same size.
    """
    single = []
    monkeypatch.setattr(Singles, "__call__", lambda self, member, stop=None: single.append(member))
    p = np.linspace(1.5, 4.0, 100)[:, None]  # omega h is 3.5 to 5.7
    solution = eig3.ensemble(linear_spring, (0, 20), 1.0, 0.0, h=20 / 7, params=p)
    assert (solution.status == eig3.Status.DIVERGED).all()
    assert all("with h = 0.714286" in message or "with h = 1.42857" in message for message in solution.message)
    assert not single


def test_growth_from_rest_is_judged_from_the_middle_of_the_run():
    """A member at rest without acceleration has no natural size at the start; growth for a physical reason is none.

    The step of the last member is a little above the critical one: it grows by 1e6 in all, but by 1e3 from the middle.
    """
    pushed = eig3.jit(lambda t, u, v, p: p[0] * (1.0 if t > 0.5 else 0.0) + p[1] * u)
    p = np.array([[1.0, -1.0], [1.0, 4.0], [0.0, -1.0], [1.0, -40000.476]])
    solution = eig3.ensemble(pushed, (0, 20), 0.0, 0.0, h=0.01, params=p)
    assert solution.success.all()
    assert abs(solution.u[1, -1]) > 1e10


def test_a_member_that_cannot_start_does_not_stop_the_others():
    singular = eig3.jit(lambda t, u, v, p: -1.0 / u)
    with pytest.raises(ValueError, match="rhs gives -inf for degree of freedom 0 at the start") as alone:
        eig3.integrate(singular, (0, 0.5), 0.0, 0.0, h=0.01)
    solution = eig3.ensemble(singular, (0, 0.5), [1.0, 0.0, 2.0], 0.0, h=0.01)
    assert solution.status.tolist() == [eig3.Status.COMPLETED, eig3.Status.DIVERGED, eig3.Status.COMPLETED]
    assert solution.message[1] == str(alone.value)
    assert solution[1].n_steps == 0
    assert solution[1].u.tolist() == [0.0]
    none = eig3.ensemble(singular, (0, 0.5), [0.0, 0.0], 0.0, h=0.01)
    assert none.message.tolist() == [str(alone.value)] * 2
    assert set(none.status) == {eig3.Status.DIVERGED}


@pytest.mark.parametrize("method", ["eig3", eig3.CentralDifference(solver="newton")], ids=["lanes", "alone"])
def test_members_that_cannot_start_may_be_anywhere(method):
    """Also at the ends and in the middle of the ensemble and of its parts, and in the whole of a part."""
    singular = eig3.jit(lambda t, u, v, p: -1.0 / u - v)
    u0 = np.full(384, 1.0)
    u0[[0, 64, 127, 192, 383]] = u0[256:] = 0.0
    options = {"h": 0.05, "method": method}
    whole = eig3.ensemble(singular, (0, 0.5), u0, 0.0, **options)
    np.testing.assert_array_equal(whole.success, u0 == 1.0)
    assert set(whole.status) == {eig3.Status.COMPLETED, eig3.Status.DIVERGED}
    assert all("rhs gives -inf for degree of freedom 0" in message for message in whole.message[u0 == 0])
    parts = eig3.ensemble(singular, (0, 0.5), u0, 0.0, reduce=lambda part: part, **options)
    assert [part.first for part in parts] == [0, 128, 256]
    for part in parts:
        assert_same(whole, part, slice(part.first, part.first + len(part)))


def test_each_member_can_have_its_own_step():
    """The errors at the end show the order 2, and each member is a run alone with its step."""
    h = np.array([0.02, 0.03, 0.01, 0.005])  # 0.03 does not divide the span
    u0, v0 = [1.0, 0.5], [0.0, 0.1]
    options = {"params": [10.0, 1.0], "save_every": 25, "invariants": {"energy": chain_energy}}
    solution = eig3.ensemble(damped_chain, (1, 6), u0, v0, h=h, **options)
    assert solution.n_steps.tolist() == [250, 167, 500, 1000]
    for i, step in enumerate(h):
        alone = eig3.integrate(damped_chain, (1, 6), u0, v0, h=step, **options)
        assert_alone(solution[i], alone)
        np.testing.assert_allclose(solution[i].t, alone.t, rtol=1e-15)
        assert solution[i].drift == pytest.approx(alone.drift, rel=1e-9)
    end = np.array([member.u[-1] for member in solution])
    ratio = np.abs(end[0] - end[2]).max() / np.abs(end[2] - end[3]).max()
    assert ratio == pytest.approx(4, abs=0.3)  # (16 - 4) / (4 - 1) for the order 2, plus terms of higher order


def test_the_last_time_is_that_of_the_span():
    """0.3 plus the steps is 0.9000000000000001."""
    solution = eig3.ensemble(linear_spring, (0.3, 0.9), [1.0, 2.0], 0.0, h=[0.07, 0.05], params=1.0, save_every=3)
    assert [member.t[-1] for member in solution] == [0.9, 0.9]
    assert eig3.ensemble(linear_spring, (0.3, 0.9), [1.0, 2.0], 0.0, h=0.07, params=1.0).t.tolist() == [[0.3, 0.9]] * 2


def test_arguments_are_broadcast():
    shared = eig3.ensemble(linear_springs, (0, 1), [1.0, 2.0], np.zeros((3, 2)), h=0.01, params=[4.0])
    own = eig3.ensemble(linear_springs, (0, 1), np.tile([1.0, 2.0], (3, 1)), [[0.0, 0.0]], h=0.01, params=[[4.0]])
    assert shared.u.shape == (3, 2, 2)
    assert_same(shared, own)
    assert eig3.ensemble(linear_spring, (0, 1), 1.0, 0.0, h=[0.1, 0.01], params=1.0).u.shape == (2, 2)
    assert len(eig3.ensemble(linear_spring, (0, 1), 1.0, 0.0, h=0.01, params=np.ones((5, 1)))) == 5


@pytest.mark.parametrize(
    ("rhs", "changes", "message"),
    [
        (linear_spring, {"v0": np.zeros(4)}, r"u0 has the shape \(3,\) and v0 the shape \(4,\), but their first axes"),
        (linear_spring, {"params": np.ones((5, 1))}, r"u0 has the shape \(3,\) and params the shape \(5, 1\)"),
        (linear_spring, {"h": [0.1, 0.2]}, r"u0 has the shape \(3,\) and h the shape \(2,\)"),
        (linear_springs, {"u0": np.ones((3, 2)), "v0": np.ones((3, 4))}, "their last axes are the degrees of freedom"),
        (linear_springs, {"u0": 1.0}, r"u0 must have the shape \(n,\) or \(m, n\)"),
        (linear_spring, {"u0": np.ones((3, 2))}, r"u0 must have the shape \(\) or \(m,\)"),
        (linear_spring, {"params": np.ones((3, 1, 1))}, r"params must have the shape \(k,\) or \(m, k\)"),
        (linear_spring, {"params": [1.0, 2.0, 3.0]}, r"write params\[:, None\] for one parameter a member"),
        (linear_spring, {"u0": 1.0}, "must have a first axis of members"),
        (linear_spring, {"u0": []}, "u0 must hold at least one member"),
        (linear_spring, {"u0": [1.0, np.nan, 1.0]}, r"u0 must be finite, but u0\[1\] is not"),
        (linear_spring, {"h": -0.1}, "h must be a positive"),
        (linear_spring, {"h": [0.1, 0.0, 0.2]}, r"h must be a positive, .* not 0\.0"),
        (linear_spring, {"save_every": 0}, "save_every must be a whole number"),
        (linear_spring, {"threads": 0}, "threads must be a whole number"),
        (linear_spring, {"t_span": (1, 0)}, "t_span must end after it starts"),
        (linear_spring, {"method": "rk9"}, "method must be one of"),
    ],
)
def test_bad_arguments_are_refused_in_one_sentence(rhs, changes, message):
    arguments = {"t_span": (0, 1), "u0": [1.0, 2.0, 3.0], "v0": 0.0 if rhs is linear_spring else [0.0], "h": 0.1}
    arguments |= {"params": 1.0, **changes}
    with pytest.raises(ValueError, match=message):
        eig3.ensemble(rhs, **arguments)


def test_functions_are_checked():
    with pytest.raises(TypeError, match="rhs must be compiled"):
        eig3.ensemble(lambda t, u, v, p: -u, (0, 1), [1.0, 2.0], 0.0, h=0.1)
    with pytest.raises(TypeError, match="invariants must be a dictionary"):
        eig3.ensemble(linear_spring, (0, 1), [1.0, 2.0], 0.0, h=0.1, params=1.0, invariants=spring_energy)
    with pytest.raises(ValueError, match=r"reads beyond the end of p \(0 values\)"):
        eig3.ensemble(linear_spring, (0, 1), [1.0, 2.0], 0.0, h=0.1)


def test_the_plain_njit_of_numba_is_vectorised_too():
    """The check of a division by zero, which Numba adds by default, would prevent it."""
    divided = numba.njit(lambda t, u, v, p: -u / p[0])
    solution = eig3.ensemble(divided, (0, 1), np.ones(3), 0.0, h=0.01, params=[[1.0], [2.0], [0.5]])
    assert solution.notes == ()
    alone = eig3.integrate(divided, (0, 1), 1.0, 0.0, h=0.01, params=0.5, save_every=None)
    assert_alone(solution[2], alone)


@pytest.mark.parametrize(
    ("form", "n", "rhs", "sizes", "has_own_step"),
    [
        (SCALAR, 1, duffing, (0, 5), False),
        (SCALAR, 1, duffing, (5, 0), True),
        (VECTOR, 2, chain, (5, 0), False),
        (VECTOR, 6, damped_chain, (0, 5), True),
    ],
)
def test_right_hand_sides_are_vectorised(form, n, rhs, sizes, has_own_step):
    """The optimised code computes vectors, and calls no function for single values in its loop."""
    assert compile_rhs(rhs.py_func, BlockLayout(form, n, 64, *sizes, has_own_step)).obstacle == ""


def test_loops_in_functions_that_a_right_hand_side_calls_are_vectorised():
    """LLVM would prepare the loop of a helper for any n: it is inlined before. One that calls itself cannot be."""

    @eig3.jit
    def power(x, k):
        return 1.0 if k == 0 else x * power(x, k - 1)

    @eig3.jit
    def resist(v, a, c=0.3):
        for j in range(v.size):
            a[j] -= c * v[j]

    @eig3.jit
    def coupled(t, u, v, p, a):
        for j in range(u.size):
            a[j] = p[0] * (u[j - 1] if j else 0.0) - u[j] * u[j] * u[j]
        resist(v, a)

    @eig3.jit
    def with_powers(t, u, v, p, a):
        for j in range(u.size):
            a[j] = -p[0] * power(u[j], 3)
        resist(v, a)

    starts = np.random.default_rng(0).normal(size=(20, 3))
    for rhs, notes in ((coupled, 0), (with_powers, 1)):
        solution = eig3.ensemble(rhs, (0, 1), starts, np.zeros(3), h=0.01, params=[[0.5]] * 20)
        assert len(solution.notes) == notes
        alone = eig3.integrate(rhs, (0, 1), starts[7], np.zeros(3), h=0.01, params=[0.5], save_every=None)
        assert_alone(solution[7], alone)


def test_notes_say_why_a_function_is_not_vectorised():
    of_libm = eig3.jit(lambda t, u, v, p: -math.sin(u))

    @eig3.jit
    def of_t_only(t, u, v, p):
        return math.cos(t) - u  # the same for all members, so that it is computed once

    free = eig3.jit(lambda t, u, v, p: 0.0)

    @eig3.jit
    def searched(t, u, v, p):
        x = 1.0
        while x * x < 2.0 + abs(u):
            x *= 1.1
        return -u * x

    @eig3.jit
    def with_arrays(t, u, v, p, a):
        w = u.copy()
        a[0], a[1] = -p[0] * w[0], -p[0] * w[1]

    def notes(rhs, u0=(1.0, 2.0)):
        solution = eig3.ensemble(rhs, (0, 1), u0, 0.0 if np.ndim(u0) == 1 else [0.0, 0.0], h=0.01, params=1.0)
        alone = eig3.integrate(rhs, (0, 1), u0[0], 0 * np.asarray(u0[0]), h=0.01, params=1.0, save_every=None)
        assert_alone(solution[0], alone)
        return solution.notes

    assert notes(of_t_only) == notes(free) == ()
    assert "calls sin of the C library" in notes(of_libm)[0]
    assert "eig3.math" in notes(of_libm)[0]
    assert "branches or loops" in notes(searched)[0]
    assert "write loops over single values" in notes(with_arrays, np.ones((2, 2)))[0]


def test_a_function_is_compiled_once_for_a_shape(monkeypatch):
    compiled = []
    monkeypatch.setattr(lanewise, "compile_rhs", lambda *args: compiled.append(args) or compile_rhs(*args))
    rhs = eig3.jit(lambda t, u, v, p: -p[0] * u)
    for m in (70, 100, 200):
        eig3.ensemble(rhs, (0, 1), np.ones(m), 0.0, h=0.01, params=1.0)
    assert len(compiled) == 1
    eig3.ensemble(rhs, (0, 1), np.ones(70), 0.0, h=0.01, params=np.ones((70, 1)))
    assert len(compiled) == 2


def test_a_changed_global_is_seen_by_any_number_of_members():
    namespace = {"eig3": eig3, "K": 1.0}
    exec("@eig3.jit\ndef rhs(t, u, v, p):\n    return -K * u", namespace)

    def ends(m):
        return eig3.ensemble(namespace["rhs"], (0, 1), np.ones(m), 0.0, h=0.01).u[:, -1]

    few, many = ends(10), ends(1000)
    namespace["K"] = 25.0
    assert ends(10)[0] == ends(1000)[0] == pytest.approx(np.cos(5), abs=1e-2)  # the phase error of EIG-3 is below 3e-3
    assert few[0] == many[0] == pytest.approx(np.cos(1), abs=1e-4)


def test_what_lies_beyond_the_arrays_is_nan():
    """Each member is checked at its start, and the parameters are guarded all the time."""
    late = eig3.jit(lambda t, u, v, p: -p[0] * u if t <= 0.5 else -p[1] * u)
    for params, h in ((np.ones((8, 1)), 0.01), (np.ones((8, 1)), np.full(8, 0.01)), (1.0, np.full(8, 0.01))):
        assert not eig3.ensemble(late, (0, 1), 1.0, 0.0, h=h, params=params).success.any()

    @eig3.jit
    def beyond(t, u, v, p, a):
        a[0] = -u[int(p[0])]

    params = np.zeros((9, 1))
    params[5] = 1  # u[1] of one degree of freedom
    solution = eig3.ensemble(beyond, (0, 1), np.ones((9, 1)), [0.0], h=0.01, params=params)
    np.testing.assert_array_equal(np.flatnonzero(~solution.success), [5])

    @eig3.jit
    def written(t, u, v, p, a):
        a[0] = -u[0]
        a[int(p[0])] = -u[0]

    with pytest.raises(ValueError, match="rhs writes beyond the end of a, which has 1 entries"):
        eig3.ensemble(written, (0, 1), np.ones((9, 1)), [0.0], h=0.01, params=params)


def test_indices_are_checked_where_the_decorator_asks_for_it():
    @numba.njit(boundscheck=True)
    def checked(t, u, v, p):
        return -p[0] * u if t <= 0.5 else -p[1] * u

    with pytest.raises(IndexError):
        eig3.ensemble(checked, (0, 1), np.ones(9), 0.0, h=0.01, params=1.0)


def test_a_rhs_that_fails_only_where_no_method_needs_it_is_no_error():
    @eig3.jit
    def bounded(t, u, v, p, a):
        if v[0] > 0.999:
            raise ValueError("too fast")
        a[0] = 1.0

    assert eig3.integrate(bounded, (0, 1), [0.0], [0.0], h=0.01).success
    assert eig3.ensemble(bounded, (0, 1), np.zeros((3, 1)), [0.0], h=0.01).success.all()


def test_members_that_run_alone_and_cannot_start_do_not_stop_the_others():
    n = lanewise.MOST_DEGREES + 1

    @eig3.jit
    def divided(t, u, v, p, a):
        for j in range(u.size):
            a[j] = -u[j] / p[0]

    params = np.ones((4, 1))
    params[1] = 0
    solution = eig3.ensemble(divided, (0, 1), np.ones(n), np.zeros(n), h=0.01, params=params)
    assert solution.status[1] is eig3.Status.DIVERGED
    assert solution.success.sum() == 3


def test_one_step_in_an_array_is_the_step_of_all():
    one = eig3.ensemble(linear_spring, (0, 1), np.ones(300), 0.0, h=[0.01], params=1.0)
    assert_same(one, eig3.ensemble(linear_spring, (0, 1), np.ones(300), 0.0, h=0.01, params=1.0))


def test_overflow_gives_no_warnings():
    """pytest turns warnings into errors, also those of a logarithm of zero in an invariant."""
    logarithm = eig3.jit(lambda t, u, v, p: np.log(abs(u)))
    solution = eig3.ensemble(linear_spring, (0, 3), [1.0, 0.0], 0.0, h=0.01, params=1.0, invariants={"e": logarithm})
    assert np.isnan(solution.drift["e"][1])


def test_an_exception_of_rhs_is_raised_and_loses_nothing():
    @eig3.jit
    def bounded(t, u, v, p):
        if u > 100.0:
            raise ValueError("out of range")
        return p[0]

    options = {"h": 0.01, "params": np.repeat([[1.0], [1.0], [9.0]], 100, axis=0), "threads": 1}
    with pytest.raises(ValueError, match="out of range") as raised:
        eig3.ensemble(bounded, (0, 10), np.zeros(300), 0.0, **options)
    part = raised.value.solution
    assert part.success[:100].all()  # their block has ended before
    assert part.status[299] is eig3.Status.INTERRUPTED
    assert np.isfinite(part[299].u).all()


def test_an_entry_of_a_that_is_no_longer_written_is_an_error():
    @eig3.jit
    def forgetful(t, u, v, p, a):
        a[0] = -u[0]
        if t < 5:
            a[1] = -u[1]

    with pytest.raises(ValueError, match=r"rhs does not write a\[1\]"):
        eig3.ensemble(forgetful, (0, 10), np.ones((3, 2)), [0.0, 0.0], h=0.01)


@pytest.mark.usefixtures("python_handler")
def test_ctrl_c_keeps_the_members_that_are_finished(monkeypatch):
    """The first 256 members, a block, are done when the signal comes; the last ones have not begun."""
    u0 = np.ones(600)
    options = {"h": 2.0**-10, "params": 1.0}
    eig3.ensemble(linear_spring, (0, 1), u0, 0.0, **options)
    begin = in_process.Block.run

    def with_signal(block, stop):
        if block.numbers[0] == 256:
            threading.Timer(0.1, os.kill, (os.getpid(), signal.SIGINT)).start()
            block.histories.members.n_steps.setflags(write=True)
            block.histories.members.n_steps[:] = 2**40  # the other blocks do not end by themselves
        begin(block, stop)

    monkeypatch.setattr(in_process.Block, "run", with_signal)
    with pytest.raises(KeyboardInterrupt) as raised:
        eig3.ensemble(linear_spring, (0, 1), u0, 0.0, threads=1, **{**options, "h": np.full(600, 2.0**-10)})
    solution = raised.value.solution
    assert solution.success[:256].all()
    assert set(solution.status[256:]) == {eig3.Status.INTERRUPTED}
    assert solution.message[300].startswith("The run was interrupted after t = ")
    assert solution.n_steps[300] > 1024
    assert solution.message[599] == "The run was interrupted before this member started."
    assert solution[599].n_steps == 0
    assert "interrupted" in repr(solution[599])


@pytest.mark.usefixtures("python_handler")
@pytest.mark.parametrize(
    ("module", "name"), [(ensemble, "check_members"), (in_process, "check_callback"), (lanewise, "compile_rhs")]
)
def test_an_interrupt_of_the_set_up_has_no_solution(monkeypatch, module, name):
    """Before the first member begins, the arguments are checked and functions are compiled."""
    other = eig3.jit(lambda t, u, v, p: -u)
    called = getattr(module, name)

    def with_signal(*arguments):
        os.kill(os.getpid(), signal.SIGINT)
        return called(*arguments)

    monkeypatch.setattr(module, name, with_signal)
    with pytest.raises(KeyboardInterrupt) as raised:
        eig3.ensemble(other, (0, 1), [1.0, 2.0], 0.0, h=0.01)
    assert raised.value.solution is None


@pytest.mark.usefixtures("python_handler")
def test_an_interrupt_after_the_last_step_comes_with_all_members(monkeypatch):
    ended = in_process.EnsembleRun.solution

    def with_signal(part):
        os.kill(os.getpid(), signal.SIGINT)
        return ended(part)

    for options in ({}, {"reduce": len}):
        monkeypatch.setattr(in_process.EnsembleRun, "solution", with_signal)
        with pytest.raises(KeyboardInterrupt) as raised:
            eig3.ensemble(linear_spring, (0, 1), [1.0, 2.0], 0.0, h=0.01, params=1.0, **options)
        solution = raised.value.solution
        assert solution == [None] if options else solution.success.all()


def test_progress_counts_members(capsys):
    eig3.ensemble(linear_spring, (0, 1), np.ones(300), 0.0, h=0.01, params=1.0, progress=True)
    assert "300/300" in capsys.readouterr().err
    eig3.ensemble(linear_spring, (0, 1), np.ones(300), 0.0, h=0.01, params=1.0)
    assert capsys.readouterr().err == ""


def test_members_are_solutions():
    u0, v0 = start(4)
    solution = eig3.ensemble(linear_spring, (0, 1), u0, v0, h=0.01, params=4.0, save_every=30)
    assert len(solution) == 4
    assert [member.u[0] for member in solution] == u0.tolist()
    assert solution[-1].u[0] == u0[3]
    assert solution[2].t.tolist() == pytest.approx([0, 0.3, 0.6, 0.9, 1.0])
    assert "4 members, 4 completed" in repr(solution)
    assert "100 steps" in repr(solution[0])
    with pytest.raises(IndexError, match="there is no member 4"):
        solution[4]
    with pytest.raises(TypeError, match="one index, the number of a member"):
        solution[1:3]


def test_a_problem_has_ensembles():
    problem = eig3.problems.duffing(gamma=0, delta=0)
    u0 = np.linspace(0.5, 1.5, 5)  # as many members as parameters
    solution = problem.ensemble(u0=u0, h=0.01, t_end=5.0)
    alone = problem.with_(u0=u0[3]).integrate(h=0.01, t_end=5.0, save_every=None)
    assert_alone(solution[3], alone)
    assert solution[3].drift["energy"] == pytest.approx(alone.drift["energy"])
    with pytest.raises(TypeError, match=r"problem.with_\(t_span=...\).ensemble"):
        problem.ensemble(u0=u0, h=0.01, t_span=(0, 1))


def test_the_parameters_of_a_problem_are_shared_by_any_number_of_members():
    """Also by one member, or by as many as there are parameters: the compiler fuses the same multiply-adds."""
    problem = eig3.problems.duffing(t_end=5.0)
    u0 = np.linspace(0.5, 1.5, len(problem.params) + 1)
    whole = problem.ensemble(u0=u0, h=0.01)
    for count in (1, len(problem.params)):
        assert_same(whole, problem.ensemble(u0=u0[:count], h=0.01), slice(count))


def test_the_shape_of_a_start_is_checked_before_integrals_are_added():
    problem = eig3.problems.shear_building(t_end=2.0, work=True)
    with pytest.raises(ValueError, match=r"u0 must have the shape \(3,\) or \(m, 3\) in shear_building, not \(5, 4\)"):
        problem.ensemble(u0=np.zeros((5, 4)), h=1e-3)


def test_histories_that_do_not_fit_are_refused(monkeypatch):
    monkeypatch.setattr(eig3.result.memory, "available_memory", lambda: 1e6)
    with pytest.raises(MemoryError, match="take a larger save_every, or reduce="):
        eig3.ensemble(linear_spring, (0, 1), np.ones(1000), 0.0, h=0.01, params=1.0, save_every=1)


@pytest.mark.parametrize(("steps", "most"), [({"h": 0.01}, 630), ({"rtol": 1e-6}, 800)])
def test_an_ensemble_of_four_members_makes_few_python_calls(steps, most, monkeypatch):
    """Some third of them are of NumPy: a call of an ensemble takes some tenths of a millisecond beside its steps."""
    monkeypatch.setattr(lanewise, "FIRST_CHUNK", 1000)  # all steps: a busy machine would take more chunks
    params = np.ones((4, 1))
    assert (
        python_calls(lambda: eig3.ensemble(linear_spring, (0, 10), 1.0, 0.0, params=params, threads=1, **steps)) <= most
    )


after_four = eig3.jit(lambda t, u, v, p: t - 4.0)
below_bound_of_two = eig3.jit(lambda t, u, v, p: u[1] + p[1])


@eig3.jit
def two_springs(t, u, v, p, a):
    a[0], a[1] = -p[0] * u[0], -p[0] * u[1] + 0.1 * u[0] - 0.01 * v[1]


@pytest.mark.parametrize(
    ("form", "options", "own_step"),
    [(SCALAR, {}, False), (VECTOR, {"save_every": 3}, True), (SCALAR, {"save_every": 1}, False)],
)
def test_events_that_end_members_are_found_in_lanes(form, options, own_step):
    """Some members end before they diverge, and some at a step; a zero of g in the other direction ends none."""
    m = 140
    p = np.column_stack([np.where(np.arange(m) % 35 == 3, 1e5, np.linspace(1, 10, m)), np.linspace(-1.4, 1.4, m)])
    if form is SCALAR:
        rhs, u0, v0 = linear_spring, np.linspace(0.5, 1.5, m), np.zeros(m)
        event = eig3.Event(above_level, direction=-1, terminal=True)
    else:
        rhs, u0, v0 = two_springs, np.ones((m, 2)), np.zeros((m, 2))
        event = eig3.Event(below_bound_of_two, terminal=True)
    h = np.linspace(0.01, 0.02, m) if own_step else np.full(m, 0.02)
    given = {"events": {"bound": event, "late": eig3.Event(after_four, terminal=True)}, **options}
    alone = [
        eig3.integrate(rhs, (0, 5), u0[i], v0[i], h=h[i], params=p[i], **{"save_every": None, **given})
        for i in range(m)
    ]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(eig3.Prepared, "member", None)  # no member runs alone
        runs = eig3.ensemble(rhs, (0, 5), u0, v0, h=h if own_step else 0.02, params=p, **given)
    for member, one in zip(runs, alone, strict=True):
        assert (member.status, member.message) == (one.status, one.message)
        assert member.n_steps == one.n_steps
        assert member.n_rhs <= one.n_rhs  # which searches also steps in which nothing ends it
        for field in "tuv":
            np.testing.assert_allclose(getattr(member, field), getattr(one, field), rtol=1e-9, atol=1e-11)
        for name, found in one.events.items():
            for field in ("t", "u", "v", "u_after", "v_after"):
                ours = getattr(member.events[name], field)
                np.testing.assert_allclose(ours, getattr(found, field), rtol=1e-9, atol=1e-11)


def test_members_that_begin_at_the_zero_of_an_event_end_as_single_runs():
    """A look in lanes does not see the first change of sign of a g that is zero at the start."""
    events = {"bound": eig3.Event(above_level, -1, terminal=True), "late": eig3.Event(after_four, terminal=True)}
    runs = eig3.ensemble(linear_spring, (0, 5), 1.0, np.ones(70), h=0.02, params=[1.0, 1.0], events=events)
    one = eig3.integrate(linear_spring, (0, 5), 1.0, 1.0, h=0.02, params=[1.0, 1.0], events=events, save_every=None)
    assert one.t[-1] == pytest.approx(np.pi / 2, rel=1e-3)
    for member in runs:
        assert (member.message, member.t[-1]) == (one.message, one.t[-1])
