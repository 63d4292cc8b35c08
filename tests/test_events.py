"""Events: where they are found, what they do to the run, and how runs with them end."""

import math
import os
import signal
import threading

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import eig3
from eig3 import Event, Status
from eig3.functions.guard import guarded
from eig3.kernels.protocol import SCALAR
from eig3.problems.bouncing_ball import bouncing_ball, impact_times
from eig3.stepping.run_options import run_options
from eig3.stepping.stepper import Stepper
from eig3.stepping.system import System

from .conftest import falling, first_position, position, spring, velocity

FIXED = {"h": 1e-2, "method": "eig3"}
ADAPTIVE = {"rtol": 1e-6, "method": "rk5"}

pendulum = eig3.jit(lambda t, u, v, p: -np.sin(u))
bounce = eig3.jit(lambda t, u, v, p: (0.0, -p[1] * v))
swap = eig3.jit(lambda t, u, v, p: (u, 2 * v))


@eig3.jit
def free(t, u, v, p, a):
    a[0], a[1] = 0.0, -p[0]


at_wall = eig3.jit(lambda t, u, v, p: p[1] * (u[0] - p[3]))
at_floor = eig3.jit(lambda t, u, v, p: p[2] * (u[1] - p[4]))


@eig3.jit
def off_wall(t, u, v, p):
    v[0] = -v[0]


@eig3.jit
def off_floor(t, u, v, p):
    v[1] = -v[1]


near_one = eig3.jit(lambda t, u, v, p: (t - p[2]) * (t - p[2]) - p[1])
energy = eig3.jit(lambda t, u, v, p: v * v / 2 + p[0] * u)


@eig3.jit
def vector_fall(t, u, v, p, a):
    for j in range(u.size):
        a[j] = -p[0]


@eig3.jit
def vector_bounce(t, u, v, p):
    u[0], v[0] = 0.0, -p[1] * v[0]


BALL = {"impact": Event(position, direction=-1, apply=bounce)}
BOX = {"wall": Event(at_wall, apply=off_wall), "floor": Event(at_floor, apply=off_floor)}


def swing(events, span=(0, 10), u0=1.0, v0=0.0, rhs=spring, params=1.0, **options):
    return eig3.integrate(rhs, span, u0, v0, params=params, events=events, **(options or ADAPTIVE))


def drop(span, restitution=0.8, h0=1.0, **options):
    return eig3.integrate(falling, span, h0, 0.0, params=(9.81, restitution), events=BALL, **options)


# Zeros ---------------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scipy_pendulum():
    rises, falls = (lambda t, y: y[0]), (lambda t, y: y[0])
    rises.direction, falls.direction = 1, -1
    options = {"rtol": 1e-13, "atol": 1e-13, "events": (rises, falls)}
    reference = solve_ivp(lambda t, y: (y[1], -math.sin(y[0])), (0, 40), (2.0, 0.0), "DOP853", **options)
    return reference.t_events, reference.y_events


@pytest.mark.parametrize("options", [{"rtol": 1e-11}, {"h": 0.01, "method": "eig9"}], ids=["rk8", "eig9"])
def test_crossings_of_a_pendulum_are_those_of_scipy(options, scipy_pendulum):
    events = {"both": Event(position), "up": Event(position, direction=1), "down": Event(position, direction=-1)}
    found = swing(events, (0, 40), 2.0, rhs=pendulum, params=(), **options).events
    (up, down), states = scipy_pendulum
    np.testing.assert_allclose(found["up"].t, up, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found["down"].t, down, rtol=0, atol=1e-9)
    assert np.array_equal(found["both"].t, np.sort(np.concatenate([found["up"].t, found["down"].t])))
    np.testing.assert_allclose(found["up"].v, states[0][:, 1], rtol=0, atol=1e-8)
    # without an `apply`, nothing changes; u is zero to the resolution of t times v
    for each in found.values():
        assert np.array_equal(each.v, each.v_after)
        assert np.abs(each.u).max() < 1e-13
        assert len(each.jumps) == 0


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
def test_a_zero_at_the_start_does_not_fire(options):
    found = swing({"zero": Event(position)}, u0=0.0, v0=1.0, **options).events["zero"]
    # the error of the motion: the period of EIG-3 is wrong by (omega h)^2 / 24 = 4e-6 of it
    np.testing.assert_allclose(found.t, np.pi * np.arange(1, 4), rtol=0, atol=1e-4)


def test_a_zero_at_the_end_of_a_step_fires_once():
    """u = 1/2 - t^2 / 2 is zero at t = 1, which is the end of a step, without round-off."""
    for h in (0.25, 0.5, 1.0):
        found = eig3.integrate(falling, (0, 3), 0.5, 0.0, h=h, params=1.0, events={"zero": Event(position)}).events[
            "zero"
        ]
        assert found.t.tolist() == [1.0]


@pytest.mark.parametrize(("u0", "t0"), [(0.5, 1.0), (0.0, 2.0)])
@pytest.mark.parametrize("h", [0.25, 0.5, 1.0, 2.0])
def test_bounces_at_the_ends_of_steps(u0, t0, h):
    """A flight takes 2 units of time: up to a whole step from zero to zero."""
    v0 = 0.0 if u0 else 1.0
    solution = eig3.integrate(falling, (0, 20.5), u0, v0, h=h, params=(1.0, 1.0), events=BALL)
    expected = np.arange(t0, 20.5, 2.0)
    # the round-off of v, of some 1e-15 in a step, adds up over ten flights
    np.testing.assert_allclose(solution.events["impact"].t, expected, rtol=0, atol=2e-12)
    assert solution.u.min() > -1e-12


@pytest.mark.parametrize(
    ("time", "gap", "count"), [(1.03, 0.0, 0), (1.03, -1e-3, 0), (1.03, 1e-8, 0), (1.03, 0.04, 2), (1.0, 0.0, 0)]
)
def test_zeros_that_graze(time, gap, count):
    """Two zeros within a step are unseen, and a zero without a change of sign is none. t = 1.03 is within a step."""
    found = swing({"touch": Event(near_one)}, (0, 2), params=(1.0, gap, time), h=0.125, method="eig3").events["touch"]
    assert len(found) == count
    np.testing.assert_allclose(np.abs(found.t - time), math.sqrt(gap) if count else 0, rtol=0, atol=1e-12)


def test_events_in_a_step_are_in_their_order():
    events = {f"{x}": Event(_reaches(x)) for x in (0.9, 0.3, 0.6)}
    solution = eig3.integrate(falling, (0, 2), 1.0, 0.0, h=2.0, params=1.0, events=events)
    for name, occurrences in solution.events.items():
        np.testing.assert_allclose(occurrences.t, math.sqrt(2 * (1 - float(name))), rtol=1e-14)


def _reaches(x):
    return eig3.jit(lambda t, u, v, p: u - x)


# Terminal events -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("save_every", [1, 7, None])
@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
def test_terminal_events_end_the_run(options, save_every):
    solution = swing({"up": Event(position, 1, terminal=True)}, save_every=save_every, **options)
    assert solution.status is Status.TERMINATED
    assert solution.success
    assert "'up'" in solution.message
    assert solution.t[-1] == solution.events["up"].t[0]
    assert solution.u[-1] == solution.events["up"].u[0]
    assert solution.t[-1] == pytest.approx(1.5 * math.pi, abs=1e-4)
    assert (np.diff(solution.t) > 0).all()
    whole = swing({}, save_every=save_every, **options)
    assert np.array_equal(solution.u[:-1], whole.u[: len(solution.u) - 1])
    if solution.steps is not None:
        last = swing({"up": Event(position, 1, terminal=True)}, **options)
        assert solution.steps[-1] == pytest.approx(last.t[-1] - last.t[-2], rel=1e-12)


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
def test_of_two_terminal_events_the_first_ends_the_run(options):
    events = {"late": Event(velocity, 1, terminal=True), "early": Event(position, terminal=True)}
    solution = swing(events, **options)
    assert "'early'" in solution.message
    assert len(solution.events["late"]) == 0


def test_a_terminal_event_with_apply_ends_with_its_state():
    for options in (FIXED, ADAPTIVE):
        solution = swing({"zero": Event(position, terminal=True, apply=swap)}, **options)
        assert solution.v[-1] == solution.events["zero"].v_after[0] == 2 * solution.events["zero"].v[0]


# Resets --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "options",
    [{"h": 1e-2, "method": name} for name in ("eig3", "rk4", "eig9", "ab3", "cd")]
    + [{"rtol": rtol, "method": name} for name in ("rk5", "rk8", "eig3") for rtol in (1e-3, 1e-8)],
    ids=lambda options: f"{options['method']}-{next(iter(options.values()))}",
)
def test_thirty_impacts(options):
    """Every method is exact for a constant acceleration, so that only round-off remains."""
    times = impact_times(30, 0.8, 1.0, 9.81)
    solution = drop((0, times[-1] + 1e-3), **options)
    found = solution.events["impact"]
    assert solution.status is Status.COMPLETED
    np.testing.assert_allclose(found.t, times, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.v, -math.sqrt(2 * 9.81) * 0.8 ** np.arange(30), rtol=1e-9)
    np.testing.assert_allclose(found.v_after, -0.8 * found.v, rtol=1e-15)
    assert not found.u_after.any()
    assert len(found.jumps) == 30


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
def test_resets_in_vector_form(options):
    """One of two bodies bounces: it does so as alone, and the other one falls."""
    events = {"impact": Event(first_position, -1, apply=vector_bounce)}
    params = (9.81, 0.8)
    solution = eig3.integrate(vector_fall, (0, 2), [1.0, 5.0], [0.0, 0.0], params=params, events=events, **options)
    alone = drop((0, 2), **options)
    np.testing.assert_allclose(solution.events["impact"].t, alone.events["impact"].t, rtol=1e-12)
    assert solution.events["impact"].u.shape == (len(alone.events["impact"]), 2)
    np.testing.assert_allclose(solution.u[:, 1], 5 - 9.81 / 2 * solution.t**2, rtol=0, atol=1e-11)


@eig3.jit
def of_another_array(t, u, v, p):
    v = -v


def test_a_reset_that_changes_nothing_has_a_note():
    params, start = [9.81, 1.0, 1.0, 10.0, 0.0], ([0.0, 1.0], [0.0, 0.0])

    def run(apply, **options):
        events = {"floor": Event(at_floor, apply=apply, direction=-1)}
        return eig3.integrate(free, (0, 1), *start, params=params, events=events, **options)

    for options in (FIXED, ADAPTIVE):
        (note,) = run(of_another_array, **options).notes
        assert "apply of events['floor'] changed nothing: write entries, such as v[0] = ..." in note
        assert run(off_floor, **options).notes == run(None, **options).notes == ()


def test_states_on_both_sides_of_an_impact_are_saved():
    solution = drop((0, 2), **ADAPTIVE)
    impacts = solution.events["impact"]
    before = np.flatnonzero(np.diff(solution.t) == 0)
    assert np.array_equal(solution.t[before], impacts.t)
    assert np.array_equal(solution.v[before], impacts.v)
    assert np.array_equal(solution.v[before + 1], impacts.v_after)


@pytest.mark.parametrize(
    "options", [ADAPTIVE, {"rtol": 1e-6, "method": "eig3"}, {"h": 0.1, "method": "eig3"}], ids=["rk5", "eig3", "fixed"]
)
def test_corners_of_a_box(options):
    """The body hits both walls at once. If it missed one of them, it would leave the box."""
    rng = np.random.default_rng(1)
    for _ in range(400):
        vx, vy = rng.uniform(0.3, 3, 2)
        corner, scales, time = rng.uniform(-1, 1, 2), rng.uniform(0.1, 10, 2), rng.uniform(0.5, 2)
        start = corner + time * np.array([vx, vy])
        solution = eig3.integrate(
            free, (0, 3), start, [-vx, -vy], params=(0.0, *scales, *corner), events=BOX, save_every=None, **options
        )
        for name in BOX:
            np.testing.assert_allclose(solution.events[name].t, [time], rtol=0, atol=1e-12)
        np.testing.assert_allclose(solution.v[-1], [vx, vy], rtol=1e-13)  # the round-off of some steps


def test_the_second_of_two_events_at_once_sees_the_state_after_the_first():
    solution = eig3.integrate(free, (0, 2), [1.0, 1.0], [-1.0, -1.0], params=(0.0, 1, 1, 0, 0), h=0.25, events=BOX)
    wall, floor = solution.events["wall"], solution.events["floor"]
    assert wall.t == floor.t == [1.0]
    assert wall.v_after.tolist() == floor.v.tolist() == [[1.0, -1.0]]
    assert floor.v_after.tolist() == [[1.0, 1.0]]


hit = eig3.jit(lambda t, u, v, p: u + 0.5)
turn_back = eig3.jit(lambda t, u, v, p: (-0.5, -v))


@pytest.mark.parametrize(
    ("method", "h", "order"), [("ab3", 0.02, 3), ("eig3", 0.02, 2), ("rk4", 0.1, 4), ("eig9", 0.2, 7.7)]
)
def test_the_order_is_kept_through_impacts(method, h, order):
    """A pendulum against a rigid stop: four impacts, after which a multistep method has to start anew.

    The motion is that of the pendulum between two passages of the stop, again and again.
    """
    quarter = swing({"hit": Event(hit, -1)}, (0, 10), rhs=pendulum, params=(), rtol=2.3e-14, method="rk8")
    first = quarter.events["hit"].t[0]
    times = first * np.array([1, 3, 5, 7])

    def error(h):
        events = {"hit": Event(hit, -1, apply=turn_back)}
        found = swing(events, (0, times[-1] + 0.3), rhs=pendulum, params=(), h=h, method=method).events["hit"]
        assert len(found) == 4
        return np.abs(found.t - times).max()

    found = math.log2(error(h) / error(h / 2))
    # The impacts are anywhere in a step, and the short steps to its end and the start have errors of the same order:
    # their size differs from run to run. The steps to its end and the dense output are RK8's for EIG-9.
    assert found > order - 0.7


def test_zeno():
    limit = math.sqrt(2 / 9.81) * 3  # of the impacts, for restitution 1/2
    for options in (FIXED, ADAPTIVE, {"rtol": 1e-8}, {"rtol": 1e-4, "method": "eig3"}, {"h": 0.7, "method": "ab3"}):
        solution = drop((0, 10), 0.5, **options)
        assert solution.status is Status.ZENO
        assert not solution.success
        assert "'impact'" in solution.message
        # the flights are shorter than 1e-12 of the span from there on, and so is the rest of their sum
        assert solution.t[-1] == pytest.approx(limit, abs=1e-10)
        assert 30 < len(solution.events["impact"]) < 60
        late = eig3.integrate(falling, (1e6, 1e6 + 10), 1.0, 0.0, params=(9.81, 0.5), events=BALL, **options)
        assert late.status is Status.ZENO
        assert late.t[-1] - 1e6 == pytest.approx(limit, abs=1e-7)


def test_many_impacts_in_one_step():
    """More than fit in the log of the kernel."""
    fall_time = math.sqrt(2e-10 / 9.81)
    solution = drop((0, 0.5), 1.0, 1e-10, h=0.25, method="eig3")
    count = round((0.5 / fall_time + 1) // 2)
    assert abs(len(solution.events["impact"]) - count) <= 1
    # each flight adds a round-off of the time, and an error of v that changes the next flights
    np.testing.assert_allclose(np.diff(solution.events["impact"].t), 2 * fall_time, rtol=1e-5)


def test_many_impacts_of_a_large_system():
    n = 9000  # the log then has few rows
    u0 = np.ones(n)
    u0[0] = 1e-4
    events = {"impact": Event(first_position, -1, apply=vector_bounce)}
    options = {"params": (9.81, 1.0), "h": 0.5, "save_every": None, "events": events}
    solution = eig3.integrate(vector_fall, (0, 1), u0, np.zeros(n), **options)
    fall_time = math.sqrt(2e-4 / 9.81)
    times = fall_time * np.arange(1, 1 / fall_time, 2)
    np.testing.assert_allclose(solution.events["impact"].t, times, rtol=0, atol=1e-10)


@eig3.jit
def size_of_u(t, u, v, p, a):
    a[0] = -float(u.size) * u[0]
    a[1] = -float(v.size) * u[-1]


last_of_all = eig3.jit(lambda t, u, v, p: u[-1] + 0.0 * v[-1] + 1e3 * (u.size - 2) + 1e3 * (v.size - 2))


@eig3.jit
def turn_all_back(t, u, v, p):
    for j in range(v.size):
        v[j] *= -(u.size == 2)


@eig3.jit
def both(t, u, v, p, out):
    out[0], out[1] = u.size, v.size


@pytest.mark.parametrize(
    "options",
    [FIXED, {**FIXED, "inline": True}, {"h": 0.01, "method": "ab3"}, ADAPTIVE],
    ids=["eig3", "inline", "ab3", "rk5"],
)
def test_callbacks_get_arrays_of_n_values_however_many_events_there_are(options):
    """With more events than degrees of freedom too. Each of two oscillators with omega^2 = 2 turns back at zero."""
    events = {f"{k}": Event(last_of_all, terminal=k == 5) for k in range(4)}
    events["reset"] = Event(last_of_all, apply=turn_all_back)
    options = {**options, "events": events, "outputs": {"sizes": (both, 2)}, "t_eval": np.linspace(0, 3, 31)}
    solution = eig3.integrate(size_of_u, (0, 3), [1.0, 1.0], [0.0, 0.0], **options)
    assert (solution.outputs["sizes"] == 2).all()
    np.testing.assert_allclose(solution.u[:, 0], solution.u[:, 1], rtol=0, atol=1e-12)
    # errors of a second-order method: (omega h)^2 / 24 of the phase, 2 in all
    np.testing.assert_allclose(solution.u[:, 1], np.abs(np.cos(math.sqrt(2) * solution.t)), rtol=0, atol=1e-4)
    for k in range(4):
        np.testing.assert_allclose(solution.events[f"{k}"].t, [math.pi / math.sqrt(8)], rtol=0, atol=1e-4)


at_one = eig3.jit(lambda t, u, v, p: t - 1.0)
push = eig3.jit(lambda t, u, v, p: (u, v - 0.001))


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE, {"h": 0.25, "method": "ab3"}], ids=["fixed", "adaptive", "ab3"])
def test_a_reset_at_the_end_of_a_step_makes_no_other_event_occur(options):
    """A body falls from 20 m, and is pushed at t = 1, the end of a step of 0.01 or 0.25."""
    events = {
        "push": Event(at_one, apply=push),
        "floor": Event(position, terminal=True),
        "passed": Event(position, apply=swap),
    }
    solution = eig3.integrate(falling, (0, 5), 20.0, 0.0, params=(9.81,), events=events, **options)
    v = -9.81 - 0.001  # after the push
    t = 1 + (v + math.sqrt(v * v + 2 * 9.81 * (20 - 9.81 / 2))) / 9.81
    assert solution.events["push"].t.tolist() == pytest.approx([1.0], abs=1e-14)
    assert solution.events["floor"].t.tolist() == pytest.approx([t], abs=1e-11)
    assert solution.events["passed"].t.tolist() == solution.events["floor"].t.tolist()


# Rest ----------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [-1, 0])
@pytest.mark.parametrize("restitution", [0.0, 1e-17, 1e-8, 1e-4])
@pytest.mark.parametrize(
    "options",
    [FIXED, {"h": 0.7, "method": "ab3"}, ADAPTIVE, {"rtol": 1e-9}, {"rtol": 1e-4, "method": "eig3"}],
    ids=["eig3", "ab3", "rk5", "rk8", "eig3-adaptive"],
)
def test_a_body_that_does_not_rebound_does_not_pass_through_the_floor(restitution, direction, options):
    for floor in (0.0, 1000.0):
        events = {"impact": Event(above_floor, direction, apply=land)}
        params = (9.81, restitution, floor)
        solution = eig3.integrate(falling, (0, 10), floor + 1.0, 0.0, params=params, events=events, **options)
        assert solution.status is Status.ZENO
        assert "'impact'" in solution.message
        assert "force" in solution.message
        fall_time = math.sqrt(2 / 9.81)
        # all flights last 2 e + 2 e^2 + ... falls; 1e-13 m is the spacing of u on the floor at 1000 m
        end = fall_time * (1 + 2 * restitution / (1 - restitution))
        assert solution.t[-1] == pytest.approx(end, abs=1e-8)
        assert solution.u[-1] == pytest.approx(floor, abs=1e-12)
        assert solution.u.min() > floor - 1e-12
        assert abs(solution.v[-1]) <= 4.5 * restitution
        assert np.array_equal(np.unique(solution.t), solution.t[np.append(True, np.diff(solution.t) > 0)])


above_floor = eig3.jit(lambda t, u, v, p: u - p[2])
land = eig3.jit(lambda t, u, v, p: (p[2], -p[1] * v))


@eig3.jit
def pulled(t, u, v, p, a):
    a[0], a[1] = p[0], p[1]


above_slope = eig3.jit(lambda t, u, v, p: p[2] * u[0] + p[3] * u[1] - p[4])


@eig3.jit
def land_on_slope(t, u, v, p):
    rate = p[2] * v[0] + p[3] * v[1]
    v[0] -= rate * p[2]
    v[1] -= rate * p[3]


within_circle = eig3.jit(lambda t, u, v, p: 1.0 - np.sqrt((u[0] - p[2]) ** 2 + (u[1] - p[3]) ** 2))


@eig3.jit
def land_in_circle(t, u, v, p):
    x, y = u[0] - p[2], u[1] - p[3]
    rate = (x * v[0] + y * v[1]) / (x * x + y * y)
    v[0] -= rate * x
    v[1] -= rate * y


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
def test_a_body_that_does_not_rebound_stays_on_a_slope_and_in_a_circle(options):
    """Round-off of the positions hides how g leaves zero, and more so far from the origin."""
    rng = np.random.default_rng(3)
    slope = {"impact": Event(above_slope, -1, apply=land_on_slope)}
    circle = {"impact": Event(within_circle, -1, apply=land_in_circle)}
    for size in (1.0, 1000.0):
        for _ in range(30):
            angle = rng.uniform(0, 2 * math.pi)
            normal, along = np.array([math.cos(angle), math.sin(angle)]), np.array([-math.sin(angle), math.cos(angle)])
            foot = rng.uniform(-size, size, 2)
            u0, v0 = foot + rng.uniform(0.1, 2) * normal, rng.uniform(-3, 3) * along - rng.uniform(0, 2) * normal
            a = rng.uniform(-1, 1) * along - 9.81 * normal
            run = {"params": (*a, *normal, normal @ foot), "events": slope, **options}
            solution = eig3.integrate(pulled, (0, 5), u0, v0, **run)
            assert solution.status is Status.ZENO
            # errors of a thousand spacings, in a second
            assert (solution.u @ normal - normal @ foot).min() > -1e-12 * size
            u0, v0 = foot + rng.uniform(-0.5, 0.5, 2), rng.uniform(-3, 3, 2)
            solution = eig3.integrate(pulled, (0, 5), u0, v0, params=(*a, *foot), events=circle, **options)
            assert solution.status is Status.ZENO
            assert np.linalg.norm(solution.u - foot, axis=1).max() < 1 + 1e-12 * size


pressed_after_2 = eig3.jit(lambda t, u, v, p: -1.0 if t > 2.05 else 0.0)
lifted_after_2 = eig3.jit(lambda t, u, v, p: 1.0 if t > 2.05 else 0.0)


@pytest.mark.parametrize("options", [FIXED, {**ADAPTIVE, "h_max": 0.1}], ids=["fixed", "adaptive"])
def test_a_body_at_rest_on_a_stop_that_is_pressed_later(options):
    """It lands without weight at t = 1, and a force begins at t = 2.05, within a step or at its end."""
    events = {"impact": Event(above_floor, -1, apply=land)}
    pressed = eig3.integrate(pressed_after_2, (0, 4), 1.0, -1.0, params=(0.0, 0.0, 0.0), events=events, **options)
    assert pressed.status is Status.ZENO
    assert 2 - 0.1 < pressed.t[-1] < 2.05 + 0.1
    assert abs(pressed.u[-1]) < 1e-12
    lifted = eig3.integrate(lifted_after_2, (0, 4), 1.0, -1.0, params=(0.0, 0.0, 0.0), events=events, **options)
    assert lifted.status is Status.COMPLETED
    assert len(lifted.events["impact"]) == 1
    # a step over the begin of the force has an error of h^2 / 2 in u at most, and of h in v
    assert lifted.u[-1] == pytest.approx(1.95**2 / 2, abs=0.03)


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
@pytest.mark.parametrize("factor", [3.0, 1.0, 1e-3])
@pytest.mark.parametrize("direction", [-1, 0, 1])
def test_a_reset_may_let_the_state_pass(factor, direction, options):
    """A gate changes the speed of a body that goes through it: a kick, a relay that changes nothing, a brake."""
    events = {"gate": Event(position, direction, apply=through)}
    solution = eig3.integrate(falling, (0, 3), 1.0, 0.0, params=(1.0, factor), events=events, **options)
    assert solution.status is Status.COMPLETED
    first = math.sqrt(2)
    if direction == 1:
        assert len(solution.events["gate"]) == 0
        factor = 1.0
    else:
        np.testing.assert_allclose(solution.events["gate"].t, [first], rtol=0, atol=1e-12)
    x = 3 - first
    assert solution.u[-1] == pytest.approx(-factor * first * x - x * x / 2, abs=1e-11)


through = eig3.jit(lambda t, u, v, p: (u, p[1] * v))


@eig3.jit
def held_or_sliding(t, u, v, p, a):
    """A block on the ground with the friction 0.8, pulled by the force sin t.

    u[1] is the sign of the velocity, which is 0 while the block sticks.
    """
    a[0] = 0.0 if u[1] == 0 else np.sin(t) - 0.8 * u[1]
    a[1] = 0.0


stops = eig3.jit(lambda t, u, v, p: v[0] if u[1] != 0 else 1.0)


@eig3.jit
def sticks(t, u, v, p):
    v[0], u[1] = 0.0, 0.0


pull_beyond_friction = eig3.jit(lambda t, u, v, p: abs(np.sin(t)) - 0.8 if u[1] == 0 else -1.0)


@eig3.jit
def slips(t, u, v, p):
    u[1] = np.sign(np.sin(t))


@pytest.mark.parametrize(
    "options", [{"h": 0.003, "method": "rk4"}, {**ADAPTIVE, "rtol": 1e-9, "h_max": 0.1}], ids=["fixed", "adaptive"]
)
def test_a_block_that_sticks_and_slips(options):
    """It leaves the state of rest at a zero of g, in both directions in turn, with the rate 0 of the velocity."""
    events = {"stick": Event(stops, apply=sticks), "slip": Event(pull_beyond_friction, 1, apply=slips)}
    solution = eig3.integrate(held_or_sliding, (0, 19), [0.0, 0.0], [0.0, 0.0], events=events, **options)
    assert solution.status is Status.COMPLETED
    slips_at, sticks_at = solution.events["slip"].t, solution.events["stick"].t
    starts = math.asin(0.8) + math.pi * np.arange(6)
    np.testing.assert_allclose(slips_at, starts, rtol=0, atol=1e-8)
    # after the time x of sliding the speed is 0.6 - cos(starts[0] + x) - 0.8 x = 0
    gaps = sticks_at - slips_at
    np.testing.assert_allclose(0.6 - np.cos(starts[0] + gaps) - 0.8 * gaps, 0, atol=1e-8)
    assert (gaps > 1).all()


@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("save_every", [1, 7, None])
def test_the_last_state_of_a_run_that_ends_with_a_step(save_every, terminal, tmp_path):
    """u = 1/2 - t^2 / 2 is zero at t = 1, the end of a step: the state after the reset is saved once."""
    events = {"impact": Event(position, -1, terminal, land_on_zero)}
    for options in ({"h": 1 / 64}, {"h": 1 / 64, "save_to": tmp_path / "run"}, {"rtol": 1e-6, "h_max": 1 / 64}):
        options |= {"params": 1.0, "events": events, "save_every": save_every, "outputs": {"v": velocity}}
        solution = eig3.integrate(falling, (0, 2), 0.5, 0.0, **options)
        assert solution.status is (Status.TERMINATED if terminal else Status.ZENO)
        assert solution.t[-1] == pytest.approx(1.0, abs=1e-14)
        assert (solution.u[-1], solution.v[-1]) == (0.0, 0.0)
        assert np.array_equal(solution.outputs["v"], solution.v)
        assert solution.extremes["v"].low == pytest.approx(-1, abs=1e-14)
        if "h" in options:
            assert (np.diff(solution.t) > 0).all()


land_on_zero = eig3.jit(lambda t, u, v, p: (0.0, 0.0))

# Two events ----------------------------------------------------------------------------------------------------------

lift_to_three = eig3.jit(lambda t, u, v, p: (3.0, 0.0))
above_two = eig3.jit(lambda t, u, v, p: u - 2.0)


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
def test_a_change_of_sign_by_another_reset_is_no_occurrence(options):
    """A body that reaches the floor is put at 3 m: it did not rise through 2 m, but it falls through it."""
    events = {"floor": Event(position, -1, apply=lift_to_three), "level": Event(above_two), "seen": Event(position)}
    solution = eig3.integrate(falling, (0, 3), 1.0, 0.0, params=(2.0,), events=events, **options)
    np.testing.assert_allclose(solution.events["floor"].t, [1.0, 1 + math.sqrt(3)], rtol=0, atol=1e-11)
    np.testing.assert_allclose(solution.events["seen"].t, solution.events["floor"].t, rtol=0, atol=1e-11)
    np.testing.assert_allclose(solution.events["level"].t, [2.0], rtol=0, atol=1e-11)


infinite = eig3.jit(lambda t, u, v, p: (u, np.inf))


@eig3.jit
def second_infinite(t, u, v, p):
    v[1] = -np.inf


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
def test_apply_must_give_a_finite_state(options):
    message = r"^apply of events\['bad'\] gives infinity or NaN at t = 1\.57\d*; it must give a finite state\.$"
    with pytest.raises(ValueError, match=message) as raised:
        swing({"bad": Event(position, apply=infinite)}, **options)
    assert np.isfinite(raised.value.solution.u).all()
    events = {"bad": Event(first_position, apply=second_infinite)}
    with pytest.raises(ValueError, match=r"^apply of events\['bad'\] gives infinity or NaN at t = "):
        eig3.integrate(vector_fall, (0, 3), [1.0, 1.0], [0.0, 0.0], params=(1.0,), events=events, **options)


class _Set:
    """A `cancel` that is always set."""

    def is_set(self):
        return True


def test_a_step_with_a_full_log_can_be_taken_back():
    """The log is full after some thousand impacts, within a step: a cancellation waits for the end of the step."""
    events = {"impact": Event(position, -1, apply=bounce)}
    system = System(falling, SCALAR, run_options(h=0.25, events=events))
    stepper = Stepper.of(system, 0.0, 0.25, 1e-10, 0.0, guarded(np.array([9.81, 1.0])))
    whole = stepper.fork()
    whole.advance(2)
    stepper.advance(2, cancel=_Set())
    assert stepper.index == 1
    stepper.back()
    assert stepper.index == 0
    before = stepper.before()
    for each in (stepper, before):
        each.advance(1, cancel=_Set())
        each.advance(1)
        assert each.index == 2
        assert (each.u, each.v) == (whole.u, whole.v)
        times = each.look.occurrences()["impact"].t
        assert np.array_equal(times, whole.look.occurrences()["impact"].t)


# Long runs and failures ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("options", [{"h": 0.01, "method": "eig3"}, ADAPTIVE], ids=["fixed", "adaptive"])
def test_a_hundred_thousand_events(options, monkeypatch):
    """A log of a hundred rows is full all the time, which leaves the motion alone."""
    monkeypatch.setattr("eig3.stepping.observer._LOG_VALUES", 600)
    span, options = (0, 1e4 * math.pi + 0.1), {"params": 10.0, "save_every": None, **options}
    solution = swing({"zero": Event(position)}, span, 0.0, 10.0, **options)
    assert solution.u[-1] == swing({}, span, 0.0, 10.0, **options).u[-1]
    assert solution.status is Status.COMPLETED
    times = solution.events["zero"].t
    # the period of EIG-3 is shorter by (omega h)^2 / 24 = 4e-4, that of RK5 by some 1e-7
    assert abs(len(times) - 1e5) < 100
    gaps = np.diff(times) * 10 / math.pi
    np.testing.assert_allclose(gaps, gaps.mean(), rtol=1e-4)
    np.testing.assert_allclose(gaps.mean(), 1, rtol=1e-3)


def test_a_run_with_many_slices_has_the_events_of_one_call():
    """Invariants divide a run into chunks, whose ends must not change anything."""
    options = {"h": 1e-4, "method": "eig3"}
    plain = swing({"zero": Event(position)}, (0, 30), **options)
    watched = swing({"zero": Event(position)}, (0, 30), invariants={"e": energy}, outputs={"v": velocity}, **options)
    assert np.array_equal(plain.events["zero"].t, watched.events["zero"].t)
    assert np.array_equal(watched.outputs["v"], watched.v)
    assert watched.extremes["v"].high == watched.v.max()


nan_after_3 = eig3.jit(lambda t, u, v, p: np.nan if t > 3 else u)


@eig3.jit
def raises_after_3(t, u, v, p):
    if t > 3:
        raise ValueError("g fails")
    return 1.0


@eig3.jit
def rhs_raises_after_3(t, u, v, p):
    if t > 3:
        raise ValueError("rhs fails")
    return -u


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
@pytest.mark.parametrize(
    ("g", "rhs", "message"),
    [
        (nan_after_3, spring, r"^g of events\['bad'\] is NaN in the step after t = "),
        (raises_after_3, spring, "^g fails$"),
        (raises_after_3, rhs_raises_after_3, "fails$"),
    ],
)
def test_exceptions_keep_the_events_before_them(g, rhs, message, options):
    t_eval = np.linspace(0, 10, 101)
    for times in (None, t_eval):
        with pytest.raises(ValueError, match=message) as raised:
            swing({"zero": Event(position), "bad": Event(g)}, rhs=rhs, t_eval=times, **options)
        solution = raised.value.solution
        assert solution.status is Status.INTERRUPTED
        np.testing.assert_allclose(solution.events["zero"].t, [math.pi / 2], rtol=0, atol=1e-4)
        # up to the step that fails, of which the longest has 0.3
        assert 2.5 < solution.t[-1] <= 3
        np.testing.assert_allclose(solution.u, np.cos(solution.t), rtol=0, atol=1e-3)


escaping = eig3.jit(lambda t, u, v, p: p[0] * u**3 - u)
sine_of_place = eig3.jit(lambda t, u, v, p: math.sin(u) * v - 0.1)
unequal_squares = eig3.jit(lambda t, u, v, p: u * u - v * v)


@pytest.mark.parametrize("options", [{"h": 0.02}, {"rtol": 1e-6}])
def test_a_g_that_is_nan_where_the_motion_overflows_is_no_error(options):
    """The member with p = 2 grows without end: it ends as without events, and the others complete."""
    params = np.array([[-1.0], [2.0], [0.5]])
    for event in (Event(sine_of_place), Event(unequal_squares), Event(position)):
        plain = [eig3.integrate(escaping, (0, 5), 1.0, 0.0, params=p, **options) for p in params]
        single = [eig3.integrate(escaping, (0, 5), 1.0, 0.0, params=p, events={"e": event}, **options) for p in params]
        members = eig3.ensemble(escaping, (0, 5), 1.0, 0.0, params=params, events={"e": event}, **options)
        for i, run in enumerate(single):
            assert members.status[i] is run.status is plain[i].status
            assert members.message[i] == run.message
            assert np.isfinite(run.events["e"].u_after).all()
        assert members.success.tolist() == [True, False, True]


def test_a_motion_that_an_event_makes_grow_is_no_divergence():
    for options in (FIXED, ADAPTIVE):
        solution = swing({"kick": Event(position, 1, apply=swap)}, (0, 60), **options)
        assert solution.status is Status.COMPLETED
        np.testing.assert_allclose(np.abs(solution.events["kick"].v_after), 2.0 ** np.arange(1, 10), rtol=2e-3)


def test_ctrl_c_keeps_the_events(python_handler):
    for options in ({"h": 1e-3, "method": "eig3"}, ADAPTIVE):
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
        with pytest.raises(KeyboardInterrupt) as raised:
            swing({"zero": Event(position)}, (0, 1e7), save_every=None, **options)
        solution = raised.value.solution
        assert solution.status is Status.INTERRUPTED
        assert abs(len(solution.events["zero"]) - solution.t[-1] / math.pi) < 1e-3 * solution.t[-1] + 2


def test_events_outputs_invariants_and_times_together():
    for options in (FIXED, ADAPTIVE):
        times = np.linspace(0, 2, 33)
        solution = drop((0, 2), t_eval=times, outputs={"v": velocity}, invariants={"e": energy}, **options)
        assert np.array_equal(solution.t, times)
        exact = bouncing_ball(t_end=2.0).exact(times)
        np.testing.assert_allclose(solution.u, exact[0], rtol=0, atol=1e-10)
        np.testing.assert_allclose(solution.outputs["v"], exact[1], rtol=0, atol=1e-10)
        # The energy after the k-th impact is 0.64^k of that at the start. Each impact is within the span.
        count = len(solution.events["impact"])
        assert solution.drift["e"] == pytest.approx(9.81 * (1 - 0.64**count), rel=1e-10)


# Arguments -----------------------------------------------------------------------------------------------------------


def plain(t, u, v, p):
    return u


@pytest.mark.parametrize("options", [FIXED, ADAPTIVE], ids=["fixed", "adaptive"])
@pytest.mark.parametrize(
    ("events", "message"),
    [
        ({"a": position}, r"^events\['a'\] must be an eig3.Event, not .*: write eig3\.Event\(g\)\.$"),
        ([Event(position)], "^events must be a dictionary of names and events"),
        ([], "^events must be a dictionary of names and events"),
        ({"a": Event(3)}, r"^g of events\['a'\] must be a function"),
        ({"a": Event(plain)}, r"^g of events\['a'\] must be compiled"),
        ({"a": Event(bounce)}, r"^g of events\['a'\] must have the form \(t, u, v, p\) -> float"),
        (
            {"a": Event(position, apply=position)},
            r"^apply of events\['a'\] must have the form \(t, u, v, p\) -> \(u, v\)",
        ),
        ({"a": Event(position, apply=5)}, r"^apply of events\['a'\] must be a function"),
        ({"a": Event(first_position)}, r"events\['a'\]"),
        ({"a": Event(position, apply=vector_bounce)}, r"events\['a'\]"),
    ],
)
def test_bad_events_are_refused(events, message, options):
    with pytest.raises(TypeError, match=message) as raised:
        swing(events, **options)
    assert len(str(raised.value).splitlines()) == 1


def test_direction_and_terminal_are_checked():
    for direction in (2, -2, 0.5, "up", None, True):
        with pytest.raises(ValueError, match=r"^direction must be -1, 0 or 1"):
            Event(position, direction=direction)
    for terminal in ("no", 2, None):
        with pytest.raises((TypeError, ValueError), match=r"^terminal must be"):
            Event(position, terminal=terminal)
