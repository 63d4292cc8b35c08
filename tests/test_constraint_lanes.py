"""Members of scenes with few constraints in lanes: they are single runs, except for round-off."""

from __future__ import annotations

import numpy as np
import pytest

import eig3
from eig3 import effects
from eig3.scene import Scene

from .test_adaptive_lanes import in_lanes  # noqa: F401  a fixture

G = 9.81
FEW = 15  # members: fewer, as in other tests, run in the same loops of 16 lanes
CLOSE = 1e-11  # beside u and v of about 1 and 10: the round-off of some hundred steps of a regular motion


def pendulum(length=1.0, mass=1.0, gravity=G):
    scene = Scene(2)
    bob = scene.mass(mass, (length, 0.0))
    scene.add(effects.Rod(), scene.fixed((0.0, 0.0)), bob)
    scene.add(effects.Gravity((0.0, -gravity)))
    return scene.problem((0.0, 0.5))


def double_pendulum():
    scene = Scene(2)
    bobs = scene.mass([1.0, 0.5], [(0.4, 0.0), (0.9, 0.0)], [(0.0, 0.2), (0.0, 0.45)])
    scene.add(effects.Rod(), scene.fixed((0.0, 0.0)), bobs[0])
    scene.add(effects.Rod(), bobs[0], bobs[1])
    scene.add(effects.Gravity((0.0, -G)))
    return scene.problem((0.0, 0.5))


def slider_crank(torque=0.5, stiffness=200.0, metre=1.0):
    """The rod and a spring act on points of the crank."""
    scene = Scene(2)
    crank = scene.body(mass=2.0, inertia=0.02 * metre**2, position=(0.05 * metre, 0.0))
    crank.revolute(None, (0.0, 0.0))
    pin, block = crank.point((0.05 * metre, 0.0)), scene.mass(4.0, (0.5 * metre, 0.0))
    scene.add(effects.Rod(), pin, block)
    scene.add(effects.Slider(direction=(1.0, 0.0)), block)
    scene.add(effects.Torque(torque * metre**2), crank.axes)
    spring = effects.LinearSpring(stiffness, 0.3 * metre)
    scene.add(spring, crank.point((0.0, 0.1 * metre)), scene.fixed((0.0, 0.5 * metre)))
    return scene.problem((0.0, 0.5), work=True)


BLOCK = 3  # its place along x
touches = eig3.jit(lambda t, u, v, p: u[4] - 0.025)


def swung(problem, members):
    """Velocities that keep the constraints, and differ."""
    return np.asarray(problem.v0) * np.random.default_rng(1).uniform(0.5, 1.5, (members, 1))


def assert_single_runs(solution, problem, members, **options):
    """The members in lanes agree with runs of their own. There are no notes: the loops have vectors."""
    assert solution.notes == ()
    for i, changes in members.items():
        alone = problem.with_(**changes).integrate(**options)
        member = solution[i]
        assert (member.status, member.message, member.n_rhs) == (alone.status, alone.message, alone.n_rhs)
        np.testing.assert_allclose(member.u, alone.u, rtol=0, atol=CLOSE)
        np.testing.assert_allclose(member.v, alone.v, rtol=0, atol=10 * CLOSE)
        for name, values in alone.outputs.items():
            np.testing.assert_allclose(member.outputs[name], values, rtol=1e-9, atol=1e-9)
        assert member.drift == pytest.approx(alone.drift, abs=1e-9)


def test_pendulums_with_their_own_lengths_masses_and_gravity():
    numbers = np.random.default_rng(1).uniform(0.5, 2.0, (FEW, 3))
    problems = [pendulum(*row) for row in numbers]
    params, u0 = np.array([problem.params for problem in problems]), np.array([problem.u0 for problem in problems])
    options = {"h": 1e-3, "method": "rk4", "save_every": 100}
    solution = problems[0].ensemble(params=params, u0=u0, **options)
    assert_single_runs(solution, problems[0], {i: {"params": params[i], "u0": u0[i]} for i in (0, 7, 14)}, **options)
    # the rod keeps its length, and the velocity its direction, to round-off
    x, v = solution.u, solution.v
    np.testing.assert_allclose(np.linalg.norm(x, axis=-1), numbers[:, :1] * np.ones(6), rtol=4e-16)
    assert np.abs(np.sum(x * v, axis=-1)).max() < 1e-14


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_double_pendulums_with_reactions_and_steps_of_their_own(method):
    problem, h = double_pendulum(), np.linspace(1e-3, 2e-3, 80)
    v0 = swung(problem, 80)
    options = {"method": method, "outputs": problem.outputs, "save_every": 50}
    solution = problem.ensemble(v0=v0, h=h, **options)
    for i in (0, 11):
        assert_single_runs(solution, problem, {i: {"v0": v0[i]}}, h=float(h[i]), **options)
    x = solution[3].u.reshape(-1, 2, 2).swapaxes(1, 2)
    np.testing.assert_allclose(np.linalg.norm(x[:, 0], axis=-1), 0.4, rtol=1e-15)
    np.testing.assert_allclose(np.linalg.norm(x[:, 1] - x[:, 0], axis=-1), 0.5, rtol=1e-15)


def test_a_member_has_its_bits_wherever_it_runs():
    problem, h = double_pendulum(), np.linspace(1e-3, 2e-3, 80)
    v0, options = swung(problem, 80), {"outputs": problem.outputs, "save_every": 50}
    whole = problem.ensemble(v0=v0, h=h, threads=2, **options)
    turned = problem.ensemble(v0=v0[::-1], h=h[::-1], threads=1, **options)
    one = problem.ensemble(v0=v0[33:34], h=h[33:34], **options)
    for i in range(80):
        np.testing.assert_array_equal(turned[79 - i].u, whole[i].u)
    np.testing.assert_array_equal(one[0].u, whole[33].u)
    assert whole.notes == one.notes == ()


def test_slider_cranks_follow_their_work_and_an_event():
    """The lanes watch the height of the crank; the members in which it rises to a stop run again as single runs."""
    problem = slider_crank()
    params = np.array([slider_crank(torque).params for torque in np.linspace(-3.0, 2.0, FEW)])
    assert problem.names[4] == "y0"
    events = {"touch": eig3.Event(touches)}
    options = {"h": 1e-3, "events": events, "save_every": 100}
    solution = problem.ensemble(params=params, **options)
    assert_single_runs(solution, problem, {i: {"params": params[i]} for i in (0, 7, 14)}, **options)
    assert np.ptp(solution.u[:, -1, 1]) > 0.1  # the cranks turn by different angles
    first = solution.events["touch"].first
    assert np.isfinite(first[-1])
    assert np.isnan(first[0])


def test_a_small_slider_crank_moves_as_a_large_one():
    """A body has unit vectors, and a small one has lengths far below 1; factors of two are exact.

    At t = 1.377 the vectors are right by chance after one iteration of a step, and the next iteration does not improve
    them.
    """
    places = []
    for metre in (1.0, 2.0**-5):
        problem = slider_crank(stiffness=0.0, metre=metre).with_(t_span=(0.0, 1.5))
        run, members = problem.integrate(h=2.0**-10), problem.ensemble(params=[problem.params] * 2, h=2.0**-10)
        assert run.success
        assert members.success.all()
        assert problem.u0[BLOCK] == 0.5 * metre
        places.append([u[-1, BLOCK] / metre for u in (run.u, *members.u)])
    np.testing.assert_allclose(places[0], places[1], rtol=1e-12)


@pytest.mark.parametrize("method", ["eig3", "rk4"])
def test_a_lane_that_finds_no_state_ends_as_a_single_run(method):
    """A rod cannot turn by more than some radians in a step: the first members are too fast, at different times."""
    problem, h = double_pendulum(), np.linspace(2e-2, 2.1e-2, 80)
    v0 = np.asarray(problem.v0) * np.append(np.linspace(300.0, 80.0, 45), np.ones(35))[:, None]
    options = {"method": method, "outputs": problem.outputs, "save_every": 50}
    solution = problem.ensemble(v0=v0, h=h, **options)
    assert solution.success[45:].all()
    for i in range(50):
        alone = problem.with_(v0=v0[i]).integrate(h=float(h[i]), **options)
        assert (solution[i].status, solution[i].message) == (alone.status, alone.message)
    np.testing.assert_allclose(solution[49].u[-1], alone.u[-1], atol=CLOSE)
    assert solution.status[0] == eig3.Status.DIVERGED
    assert "no state was found that keeps the constraints" in solution[0].message


@pytest.mark.usefixtures("in_lanes")
def test_pendulums_with_tolerances_strike_a_wall_in_lanes():
    """The wall acts in the lane of a member, which then goes on there."""
    scene = Scene(2)
    bob = scene.mass(1.0, (1.0, 0.0))
    scene.add(effects.Rod(), scene.fixed((0.0, 0.0)), bob)
    scene.add(effects.Gravity((0.0, -G)))
    scene.add(effects.RigidStop((1.0, 0.0), -0.3, restitution=0.7), bob)
    problem = scene.problem((0.0, 1.5))
    v0 = np.column_stack([np.zeros(40), np.linspace(-2.0, 3.0, 40)])
    options = {"rtol": 1e-7, "method": "rk8", "t_eval": np.linspace(0.0, 1.5, 4), "invariants": {}}
    solution = problem.ensemble(v0=v0, **options)
    assert solution.notes == ()
    for i in (0, 20, 39):
        alone = problem.with_(v0=v0[i]).integrate(**options)
        impacts, others = solution[i].events["rigid stop 0"], alone.events["rigid stop 0"]
        assert len(impacts) == len(others) > 0
        # round-off may decide whether a step with an error near the tolerance is accepted
        np.testing.assert_allclose(impacts.t, others.t, rtol=0, atol=1e-7)
        np.testing.assert_allclose(solution[i].u, alone.u, rtol=0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(solution.u[:, -1], axis=1), 1.0, rtol=4e-16)


def test_many_constraints_run_one_at_a_time():
    scene = Scene(2)
    x = np.arange(1.0, 10.0)
    bobs = scene.mass(1.0, np.column_stack([x, np.zeros(9)]))
    scene.add(effects.Rod(), scene.fixed((0.0, 0.0)), bobs[0])
    scene.add(effects.Rod(), bobs[:-1], bobs[1:])
    problem = scene.problem((0.0, 0.01))
    solution = problem.ensemble(v0=np.zeros((2, 18)), h=1e-3)
    assert "at most 8 constraints" in solution.notes[0]


def test_members_with_other_constraints_run_one_at_a_time():
    """The lines are for rods between certain points, and the numbers of the second scene for a rod between others."""

    def held(i):
        scene = Scene(2)
        bobs = scene.mass([1.0, 2.0], [(0.5, 0.0), (0.0, 0.5)])
        scene.add(effects.Rod(), scene.fixed((0.0, 0.0)), bobs[i])
        scene.add(effects.Gravity((0.0, -G)))
        return scene.problem((0.0, 0.1))

    problems = [held(0), held(1)]
    solution = problems[0].ensemble(params=np.array([problem.params for problem in problems]), h=1e-3)
    assert "join different points" in solution.notes[0]
    for i, problem in enumerate(problems):
        np.testing.assert_array_equal(solution.u[i, -1], problem.integrate(h=1e-3).u[-1])
