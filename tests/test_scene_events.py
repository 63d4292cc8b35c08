"""Events of effects: where they occur, what happens there, and what of it is in the code of a scene."""

import inspect
import math
import re
import sys
from collections import Counter
from dataclasses import dataclass

import numpy as np
import pytest

import eig3
from eig3.effects import (
    Body,
    BreakingString,
    Cable,
    Gap,
    Gravity,
    LinearDamper,
    LinearSpring,
    Link,
    MassImpact,
    RigidStop,
    SupportMotion,
)
from eig3.kernels.compile.numba_internals import compilations
from eig3.problems.bouncing_ball import impact_times
from eig3.scene import Scene

from .conftest import refusals

G = 9.81


def code(function):
    return inspect.getsource(inspect.unwrap(function.py_func))


# Impacts

half_way = eig3.jit(lambda t, u, v, p: u[0] - 0.5)


def dropped(dimension=1, slow=0.01, t_end=1.68, **options):
    """A ball that falls from 1 m on a floor, and moves along it too."""
    up = np.eye(dimension)[-1]
    scene = Scene(dimension)
    place, speed = (1.0, 0.0) if dimension == 1 else (up, 0.7 * np.eye(dimension)[0])
    scene.mass(2.0, place, speed)
    scene.add(Gravity(-G * up))
    scene.add(RigidStop(up, 0.0, 0.6, slow))
    return scene.problem((0.0, t_end), **options)


@pytest.mark.parametrize(("dimension", "run"), [(1, {"h": 1e-2, "method": "rk4"}), (3, {"rtol": 1e-9})])
def test_a_ball_strikes_the_floor_at_the_times_of_the_closed_form(dimension, run):
    """Each method computes a parabola exactly: the errors are those of the roots, and 1e-11 of the span.

    The work is the energy at the end of the run, less that at the start. Along the floor nothing acts.
    """
    assert dropped(dimension).energy is None
    solution = dropped(dimension, work=True).integrate(**run)
    found = solution.events["rigid stop 0"]
    assert len(found) == 5
    np.testing.assert_allclose(found.t, impact_times(5, 0.6, 1.0, G), rtol=0, atol=1e-11)
    speeds = math.sqrt(2 * G) * 0.6 ** np.arange(6)
    np.testing.assert_allclose(found.v[:, -1], -speeds[:5], rtol=1e-10)
    np.testing.assert_allclose(found.v_after[:, -1], -0.6 * found.v[:, -1], rtol=1e-15)
    np.testing.assert_array_equal(found.u_after, found.u)
    assert solution.z["work"][-1] == pytest.approx(2.0 * G * (0.6**10 - 1), rel=1e-9)
    assert solution.drift["energy"] < 1e-9


def test_an_event_of_a_run_leaves_the_impacts_of_the_scene(tmp_path):
    """Without the event of the stop, the ball would fall through the floor, by g t^2 / 2: ``events={}`` says so."""
    problem, half = dropped(), {"half": eig3.Event(half_way)}
    options = {"h": 1e-2, "events": half}
    for both in (
        problem.integrate(**options),
        problem.prepare(**options)(),
        problem.ensemble(**options, v0=[[0.0]])[0],
    ):
        assert both.events["half"].t[0] == pytest.approx(math.sqrt(1 / G), abs=1e-11)
        assert len(both.events["rigid stop 0"]) == 5
    problem.integrate(**options, t_end=1.0, save_to=tmp_path / "run")
    longer = problem.load(tmp_path / "run", events=half).extend(1.68)
    np.testing.assert_array_equal(longer.events["rigid stop 0"].t, both.events["rigid stop 0"].t)
    free = problem.integrate(h=1e-2, events={})
    assert free.u[-1, 0] == pytest.approx(1 - G * 1.68**2 / 2, rel=1e-12)


def test_an_impact_changes_the_normal_velocity_only():
    normal = np.array([0.6, 0.8])
    scene = Scene(2)
    ball = scene.mass(1.0, (1.0, 1.0), (-0.5, -2.0))
    scene.add(RigidStop(normal, 0.3, 0.5), ball)
    found = scene.problem((0.0, 2.0)).integrate(h=1e-2).events["rigid stop 0"]
    before, after = ball.velocities(found.v), ball.velocities(found.v_after)
    assert len(found) == 1
    assert ball.positions(found.u)[0] @ normal == pytest.approx(0.3, abs=1e-12)
    assert after[0] @ normal == pytest.approx(-0.5 * before[0] @ normal, rel=1e-14)
    along = np.array([0.8, -0.6])
    assert after[0] @ along == pytest.approx(before[0] @ along, rel=1e-14)


@pytest.mark.parametrize("run", [{"h": 1e-3}, {"rtol": 1e-6}])
def test_a_ball_comes_to_rest_in_small_bounces(run):
    """At the speed slow it rises by slow^2 / (2 g)."""
    solution = dropped(slow=0.02, t_end=3.0).integrate(**run)
    assert solution.status is eig3.Status.COMPLETED
    rest = solution.t > 2.0  # the closed form ends at 1.81 s
    assert solution.u[rest].min() > -1e-12
    assert solution.u[rest].max() < 1.001 * 0.02**2 / (2 * G)


def pair(dimension, flipped=False):
    """Two balls of different mass that fly towards each other, beside the line through their centres."""
    rng = np.random.default_rng(dimension)
    offset = 0.2 * rng.standard_normal(dimension) * (np.arange(dimension) > 0)
    along = np.eye(dimension)[0]
    places, speeds = np.array([-along, along + offset]), np.array([1.3 * along, -0.4 * along])
    scene = Scene(dimension)
    order = [1, 0] if flipped else [0, 1]
    shape = (2,) if dimension == 1 else (2, dimension)
    balls = scene.mass([[1.5, 0.7][k] for k in order], places[order].reshape(shape), speeds[order].reshape(shape))
    scene.add(MassImpact(0.6, 0.8), *balls)
    return balls, np.array([1.5, 0.7])[order], scene.problem((0.0, 2.0), work=True)


@pytest.mark.parametrize(("dimension", "flipped"), [(1, False), (3, True)])
def test_an_impact_of_masses_keeps_their_momenta(dimension, flipped):
    """To round-off; the distance is that of the root."""
    balls, m, problem = pair(dimension, flipped)
    solution = problem.integrate(h=1e-2)
    found = solution.events["mass impact 0"]
    assert len(found) == 1
    x, before, after = (balls.positions(s)[0].reshape(2, dimension) for s in (found.u, found.v, found.v_after))
    line = (x[1] - x[0]) / np.linalg.norm(x[1] - x[0])
    assert np.linalg.norm(x[1] - x[0]) == pytest.approx(0.6, abs=1e-12)
    rates = [(v[1] - v[0]) @ line for v in (before, after)]
    assert rates[1] == pytest.approx(-0.8 * rates[0], rel=1e-14)
    np.testing.assert_allclose(m @ after, m @ before, rtol=0, atol=1e-15)
    for i in range(dimension):
        for j in range(i):
            spins = [m @ (x[:, i] * v[:, j] - x[:, j] * v[:, i]) for v in (before, after)]
            assert spins[1] == pytest.approx(spins[0], abs=1e-15)
    reduced = m.prod() / m.sum()
    assert solution.z["work"][-1] == pytest.approx((0.8**2 - 1) * reduced * rates[0] ** 2 / 2, rel=1e-12)


advancing = eig3.jit(lambda t: (0.5 * t, 0.5))


@pytest.mark.parametrize("side", [-1, 1])
def test_a_wall_that_moves_drives_a_mass_away(side):
    """At (1 + restitution) times its speed, from rest; the work is that of the wall."""
    scene = Scene(1)
    wall, ball = scene.fixed(-side * 1.0), scene.mass(3.0, 0.0)
    scene.add(SupportMotion(advancing, [side]), wall)
    scene.add(MassImpact(0.25, 0.4), wall, ball)
    solution = scene.problem((0.0, 3.0), work=True).integrate(h=1e-2)
    assert solution.events["mass impact 0"].t == pytest.approx([1.5], abs=1e-12)
    assert solution.v[-1] == pytest.approx(side * 1.4 * 0.5, rel=1e-14)
    assert solution.z["work"][-1] == pytest.approx(1.5 * 0.7**2, rel=1e-14)


# Cables and strings


def tethered(damping, t_end=1.2):
    """A mass that flies away from a post until a cable stops it: taut from 0.25 s on."""
    scene = Scene(2)
    post, ball = scene.fixed((0.0, 0.0)), scene.mass(2.0, (0.3, 0.4), (1.2, 1.6))
    scene.add(Cable(50.0, 1.0, damping), post, ball)
    return scene.problem((0.0, t_end))


@pytest.mark.parametrize("run", [{"h": 5e-3, "method": "rk4"}, {"rtol": 1e-11}])
def test_a_cable_goes_taut_and_slack_at_the_times_of_the_closed_form(run):
    """The tension k x + c x' of a damped half-wave ends at the phase pi - 2 asin(zeta).

    A fixed step goes over the jump of the acceleration, c v / m, where the cable goes taut. This displaces the mass, of
    the speed v, by at most h^2 / 2 times the jump.
    """
    omega, damping = 5.0, 4.0
    zeta = damping / (2 * math.sqrt(50.0 * 2.0))
    taut = (math.pi - 2 * math.asin(zeta)) / (omega * math.sqrt(1 - zeta**2))
    solution = tethered(damping).integrate(**run)
    found = solution.events["cable 0"]
    assert len(found) == 2
    jump = 5e-3**2 / 2 * damping / 2.0
    np.testing.assert_allclose(found.t, [0.25, 0.25 + taut], rtol=0, atol=jump if "h" in run else 1e-10)
    np.testing.assert_array_equal(found.v_after, found.v)
    if "rtol" in run:  # a step ends there
        assert np.isin(found.t, solution.t).all()


def hanging(strength=30.0, **options):
    """A mass dropped on a string, which breaks at twice the mass's weight at most."""
    scene = Scene(2)
    post, ball = scene.fixed((0.0, 0.0)), scene.mass(2.0, (0.0, -1.0))
    scene.add(Gravity((0.0, -G)))
    scene.add(BreakingString(200.0, 1.0, strength), post, ball)
    return ball, scene.problem((0.0, 1.0), **options)


@pytest.mark.parametrize("run", [{"h": 1e-3, "method": "rk4"}, {"rtol": 1e-11}])
def test_a_string_breaks_at_its_strength(run):
    """The stretch is g / omega^2 (1 - cos(omega t)) before, and the mass falls freely after."""
    ball, problem = hanging(work=True)
    assert problem.names == ("x0", "y0", "breaking string 0")
    assert problem.units == ("m", "m", "-")
    solution = problem.integrate(**run)
    omega, stretch = 10.0, 30.0 / 200.0
    t = math.acos(1 - stretch * omega**2 / G) / omega
    found = solution.events["breaking string 0"]
    np.testing.assert_allclose(found.t, [t], rtol=0, atol=1e-9)
    assert ball.positions(found.u)[0, 1] == pytest.approx(-1.0 - stretch, abs=1e-10)
    assert (found.u[0, 2], found.u_after[0, 2]) == (0, 1)
    apart = solution.t != found.t[0]  # a step may end there
    np.testing.assert_array_equal(solution.u[apart, 2], solution.t[apart] > found.t[0])
    fall = 1.0 - t
    height = -1.0 - stretch - G / omega * math.sin(omega * t) * fall - G / 2 * fall**2
    assert ball.positions(solution.u)[-1, 1] == pytest.approx(height, abs=1e-8)
    assert solution.z["work"][-1] == pytest.approx(-(30.0**2) / (2 * 200.0), rel=1e-9)
    assert solution.drift["energy"] < 1e-7


def test_a_strong_string_does_not_break_and_a_broken_one_stays_so():
    _, problem = hanging(strength=2.001 * 2.0 * G)
    solution = problem.integrate(h=1e-3)
    assert len(solution.events["breaking string 0"]) == 0
    assert not solution.u[:, 2].any()
    assert problem.critical_step().h == pytest.approx(0.9 * 2 / 10.0, rel=1e-6)
    _, problem = hanging()
    whole, first = (problem.integrate(rtol=1e-10, t_end=t) for t in (1.0, 0.5))
    rest = problem.with_(u0=first.u[-1], v0=first.v[-1], t_span=(0.5, 1.0)).integrate(rtol=1e-10)
    assert len(rest.events["breaking string 0"]) == 0
    np.testing.assert_allclose(rest.u[-1], whole.u[-1], rtol=0, atol=1e-9)


# The code of a scene, and its errors


def row(reverse=False):
    """Strings of different strength on five masses, added in any order, and a stop for two of the masses."""
    scene = Scene(1)
    posts, masses = scene.fixed(np.zeros(5)), scene.mass(1.0, np.ones(5))
    scene.add(Gravity(G))
    order = np.arange(5)[:: -1 if reverse else 1]
    scene.add(BreakingString(100.0, 1.0, 5.0 + order), posts[order], masses[order])
    scene.add(RigidStop(-1.0, [-2.0, -3.0]), masses[[3, 1]])
    return masses, scene.problem((0.0, 1.0))


@pytest.mark.parametrize("reverse", [False, True])
def test_events_are_numbered_as_their_effects_were_added(reverse):
    masses, problem = row(reverse)
    names = [f"breaking string {k}" for k in range(5)]
    assert list(problem.events) == [*names, "rigid stop 0", "rigid stop 1"]
    assert problem.names[5:] == tuple(names)
    assert "7 events: 'breaking string 0' to 'rigid stop 1'" in problem.note
    solution = problem.integrate(rtol=1e-9)
    for k in range(5):
        found = solution.events[f"breaking string {k}"]
        mass = 4 - k if reverse else k
        assert masses[mass].positions(found.u) == pytest.approx([1.0 + (5.0 + mass) / 100.0], abs=1e-10)
        np.testing.assert_array_equal(np.flatnonzero(found.u_after[0] != found.u[0]), [5 + k])
    for k, (mass, place) in enumerate(((3, 2.0), (1, 3.0))):
        found = solution.events[f"rigid stop {k}"]
        assert masses[mass].positions(found.u)[0] == pytest.approx(place, abs=1e-10)


def test_the_code_has_the_events_that_the_scene_names_only():
    scene = Scene(1)
    a, b = scene.mass(1.0, [0.0, 1.0])
    scene.add(LinearSpring(10.0, 1.0), a, b)
    plain = scene.problem((0.0, 1.0))
    assert plain.events == {}
    assert "event" not in code(plain.rhs)
    scene.add(RigidStop(1.0, -1.0), a)
    problem = scene.problem((0.0, 1.0))
    same, own = (re.sub(r"p\[\d+\]", "p[]", code(each.rhs)).rstrip() for each in (plain, problem))
    assert own == same
    assert list(problem.events) == ["rigid stop 0"]
    for function in (problem.events["rigid stop 0"].g, problem.events["rigid stop 0"].apply):
        assert "rigid_stop" in code(function)
        assert "spring" not in code(function)
        assert "energy" not in code(function)


def gas(count):
    """Balls on a ring that fly past each other at first, with an impact between every two of them."""
    scene = Scene(2)
    angle = 2 * np.pi * np.arange(count) / count
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    balls = scene.mass(np.linspace(1.0, 2.0, count), ring, -ring * np.linspace(1.0, 1.3, count)[:, None])
    first, second = np.triu_indices(count, 1)
    scene.add(MassImpact(0.3, 0.9), balls[first], balls[second])
    return balls, scene.problem((0.0, 2.0))


def test_the_code_to_compile_does_not_grow_with_the_pairs():
    """The first scene compiles the functions of the effect and the kernel, which the others share.

    All have at least 8 pairs, which are looked at together.
    """
    counts = []
    for size in (7, 6, 12):  # of no other test, which may run before or beside this one
        with compilations() as compiled:
            gas(size)[1].integrate(h=0.01, t_end=0.01)
        counts.append(len(compiled))
    assert counts[2] == counts[1] <= counts[0]  # all are 0 if the scenes of an earlier process are on the disk


@pytest.mark.parametrize("run", [{"h": 1e-3, "method": "rk4"}, {"rtol": 1e-9, "h_max": 0.01}])
def test_every_pair_has_its_own_impacts(run):
    """Between impacts the balls move uniformly, so that the run follows from its list of impacts."""
    balls, problem = gas(5)
    solution = problem.integrate(**run)
    pairs = list(zip(*np.triu_indices(5, 1), strict=True))
    assert list(solution.events) == [f"mass impact {k}" for k in range(len(pairs))]
    impacts = [
        (found.t[row], pairs[k], row, found)
        for k, found in enumerate(solution.events.values())
        for row in range(len(found))
    ]
    assert len(impacts) > 3
    t, x, v = 0.0, balls.positions(problem.u0), balls.velocities(problem.v0)
    for time, (i, j), row, found in sorted(impacts, key=lambda impact: impact[0]):
        t, x = time, x + (time - t) * v
        before, after = balls.velocities(found.v)[row], balls.velocities(found.v_after)[row]
        np.testing.assert_allclose(before, v, rtol=0, atol=1e-10)
        assert np.flatnonzero((before != after).any(axis=1)).tolist() == [i, j]
        assert np.linalg.norm(x[j] - x[i]) == pytest.approx(0.3, abs=1e-9)
        v = after
    np.testing.assert_allclose(balls.positions(solution.u)[-1], x + (2.0 - t) * v, rtol=0, atol=1e-9)


def test_a_member_can_be_called_from_python():
    """As the event of a scene can be called, and given to a run by a user."""
    balls, problem = gas(3)
    event = problem.events["mass impact 1"]  # of the balls 0 and 2
    x = balls.positions(problem.u0)
    assert event.g(0.0, problem.u0, problem.v0, problem.params) == pytest.approx(np.linalg.norm(x[2] - x[0]) - 0.3)
    watched = problem.with_(events={"meeting": eig3.Event(event.g, -1, terminal=True)}).integrate(h=0.01)
    assert watched.status is eig3.Status.TERMINATED
    x = balls.positions(watched.u)[-1]
    assert np.linalg.norm(x[2] - x[0]) == pytest.approx(0.3, abs=1e-12)


LEVEL = 0.5

above_level = eig3.jit(lambda x: x[0] - LEVEL)
noise = eig3.jit(lambda x: x[0] - np.random.rand())


def test_a_value_from_outside_is_that_of_the_next_run(monkeypatch):
    """As in rhs: the functions of all members are compiled anew, at other addresses."""
    scene = Scene(1)
    scene.add(effect(Body, event=staticmethod(above_level)), scene.mass(1.0, [0.0, 0.1], 1.0))
    problem = scene.problem((0.0, 1.0))
    assert [found.t[0] for found in problem.integrate(h=0.01).events.values()] == pytest.approx([0.5, 0.4])
    monkeypatch.setitem(globals(), "LEVEL", 0.7)
    assert [found.t[0] for found in problem.integrate(h=0.01).events.values()] == pytest.approx([0.7, 0.6])


def test_an_event_does_not_draw_random_numbers():
    scene = Scene(1)
    scene.add(effect(Body, event=staticmethod(noise)), scene.mass(1.0, 0.0))
    with pytest.raises(ValueError, match=r"^g of events\['own 0'\] draws random numbers"):
        scene.problem((0.0, 1.0)).integrate(h=0.01)


def test_a_scene_that_conserves_energy_has_an_energy_with_events():
    assert tethered(0.0).energy is not None
    assert tethered(4.0).energy is None
    assert hanging()[1].energy is None


@dataclass(frozen=True, eq=False)
class Gate(Body):
    """Counts how often a mass passes a place, and pushes it back more each time."""

    place: float
    push: float

    crossing = 1

    event = eig3.jit(lambda x, place: x[0] - place)
    state_after = eig3.jit(lambda state: state + 1)
    force = eig3.jit(lambda state, push: (-push * state,))


def test_a_state_may_count():
    """The mass comes back from each push, and leaves again at an opposite stop."""
    scene = Scene(1)
    ball = scene.mass(1.0, 0.0, 1.0)
    scene.add(Gate(0.5, 2.0), ball)
    scene.add(RigidStop(1.0, -0.25, 1.0), ball)
    solution = scene.problem((0.0, 5.0)).integrate(h=1e-3)
    found = solution.events["gate 0"]
    assert len(found) > 1
    np.testing.assert_array_equal(found.u_after[:, 1], np.arange(1, len(found) + 1))
    np.testing.assert_array_equal(solution.u[:, 1], np.searchsorted(found.t, solution.t))


zero = eig3.jit(lambda x: x[0])
distance = eig3.jit(lambda r: r)
number = eig3.jit(lambda v: v[0])
reading = eig3.jit(lambda state: (state,))


def effect(kind, **members):
    return dataclass(frozen=True, eq=False)(type("Own", (kind,), members))()


def one(added, dimension=1, place=1.0):
    scene = Scene(dimension)
    scene.add(added, scene.mass(1.0, place))


def two(added, dimension=1, places=(0.0, 1.0)):
    scene = Scene(dimension)
    scene.add(added, *scene.mass(1.0, places))


BAD_VALUES = {
    "crossing of Own must be -1, 0 or 1, not 2": lambda: two(effect(Link, event=distance, crossing=2)),
    "offset of RigidStop must leave each mass on the free side at the start": lambda: one(RigidStop(1.0, 1.0)),
    "contact_distance of MassImpact must be below the distance at the start": lambda: two(MassImpact(1.0)),
    "contact_distance of MassImpact must be positive in a scene of two": lambda: two(MassImpact(), 2, ((0, 0), (1, 0))),
    "strength of BreakingString must be above the tension": lambda: two(BreakingString(10.0, 0.5, 5.0)),
}
BAD_TYPES = {
    "Own must have a function event: velocity_after is called at its zeros": lambda: one(
        effect(Body, velocity_after=number, force=staticmethod(number))
    ),
    "Own must have a function state_after or state_rate, because force": lambda: one(effect(Body, force=reading)),
    "velocity_after of Own must return a tuple of 1 number here, not float64": lambda: one(
        effect(Body, event=zero, velocity_after=number)
    ),
    "Own must have a field contact_distance that a function reads, for its picture 'discs'": lambda: two(
        effect(Link, event=distance, picture="discs")
    ),
}
test_bad_events = refusals(BAD_VALUES, BAD_TYPES)


BEHIND = "offset of RigidStop must leave each mass on the free side at the start, but"
test_a_start_behind_a_stop_is_refused = refusals(
    {
        f"{BEHIND} the start lies behind 'rigid stop 0'": lambda: dropped().with_(u0=[-0.1]).integrate(h=0.01),
        f"{BEHIND} the start lies": lambda: dropped().prepare(rtol=1e-6)(u0=[0.0]),  # it would fall at once
        f"{BEHIND} member 1 lies": lambda: dropped().ensemble(u0=[[0.5], [-0.5]], h=0.01),
        f"{BEHIND} member 17 lies": lambda: dropped().ensemble(u0=np.linspace(0.83, -0.02, 18)[:, None], rtol=1e-6),
        f"{BEHIND} member 2 lies": lambda: dropped().ensemble(params=with_floors(0.0, 0.5, 1.5), h=0.01),
    }
)


def with_floors(*heights):
    """The parameters of members whose floors are at some heights."""
    return dropped().params + np.multiply.outer(heights, np.eye(7)[3])


def test_no_function_of_python_is_called_for_each_start():
    """The check of a start took as long as a hundred steps in lanes."""
    problem, calls = dropped(), Counter()
    for _ in range(2):  # the first run compiles
        calls.clear()
        sys.setprofile(lambda frame, event, _: calls.update([frame.f_code] if event == "call" else []))
        problem.ensemble(u0=np.ones((2048, 1)), h=0.1, t_end=0.1)
        sys.setprofile(None)
    assert max(calls.values()) < 2048


def test_a_run_goes_on_from_a_bounce():
    """The located impacts are at -2e-17 to 2e-17 m."""
    problem = dropped()
    found = problem.integrate(h=1e-2, method="rk4").events["rigid stop 0"]
    for k in range(4):
        later = problem.with_(u0=found.u_after[k], v0=found.v_after[k], t_span=(found.t[k], 1.68))
        rest = later.integrate(h=1e-2, method="rk4").events["rigid stop 0"]
        np.testing.assert_allclose(rest.t, found.t[k + 1 :], rtol=0, atol=1e-11)


def test_the_code_does_not_grow_with_the_number_of_states():
    def length(n):
        scene = Scene(1)
        masses = scene.mass(1.0, np.arange(1.0, n + 1))
        scene.add(BreakingString(1.0, 1.0, 1.0), masses[:-1], masses[1:])
        return len(code(scene.problem((0, 1)).rhs))

    assert length(400) == length(200)  # with the same number of digits in each range


def test_a_scene_without_loads_of_the_time_is_not_searched_for_them():
    """Two wagons roll freely to a buffer: no note says that a load may have been jumped over. They bounce back.

    The work of a damper is an integral over the time, but no force depends on the time.
    """
    scene = Scene(1)
    wagons, buffer = scene.mass([1.0, 1.0], [0.0, 1.0], velocity=[5.0, 5.0]), scene.fixed([40.0])
    scene.add(LinearDamper(0.1), wagons[0], wagons[1])
    scene.add(Gap(1e4, 0.0, 6.0), buffer, wagons[1])
    run = scene.problem((0, 8), work=True).integrate(rtol=1e-8)
    assert run.notes == ()
    assert run.drift["energy"] < 25 * 1e-6  # of 25 J, with the tolerance of a step and some hundred steps
    assert run.v[-1, 1] < 0
