"""Constraints: they hold to round-off, keep the order of every method, and take part in all that a run can do."""

import functools
import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.integrate import solve_ivp

import eig3
from eig3 import effects
from eig3.kernels.compile.numba_internals import compilations
from eig3.planning import planner
from eig3.scene import Scene

from .conftest import assert_same

G = 9.81


def chain(n, drag=0.0, angle=0.7, dimension=2):
    """Rods of the length 1/n that begin in a straight line, at an angle to the vertical."""
    scene = Scene(dimension)
    way = np.array([np.sin(angle), *[0.0] * (dimension - 2), -np.cos(angle)]) / n
    bobs = scene.mass(1 / n, np.arange(1, n + 1)[:, None] * way)
    scene.add(effects.Rod(), scene.fixed(np.zeros(dimension)), bobs[0])
    scene.add(effects.Rod(), bobs[:-1], bobs[1:])
    scene.add(effects.Gravity([0.0] * (dimension - 1) + [-G]))
    if drag:
        scene.add(effects.LinearDamper(drag), bobs[-1], scene.fixed([2.0] + [0.0] * (dimension - 1)))
    return scene


def lengths(problem, u):
    x = np.moveaxis(u.reshape(*u.shape[:-1], 2, -1), -2, -1)
    return np.linalg.norm(np.diff(x, axis=-2, prepend=0.0), axis=-1)


def slider_crank():
    scene = Scene(2)
    crank, block = scene.mass(1.0, (0.3, 0.4)), scene.mass(2.0, (1.5, 0.0))
    scene.add(effects.Rod(), scene.fixed((0.0, 0.0)), crank)
    scene.add(effects.Rod(), crank, block)
    scene.add(effects.Slider(direction=(1.0, 0.0)), block)
    scene.add(effects.Gravity((0.0, -G)))
    scene.add(effects.LinearDamper(0.5), crank, block)
    return scene


def closed_loop():
    """Five rods around, of which two ends are fixed, with a spring across."""
    scene = Scene(2)
    joints = scene.mass([1.0, 2.0, 1.0], [(0.1, 1.0), (1.0, 1.4), (1.9, 0.9)])
    ground = scene.fixed([(0.0, 0.0), (2.0, 0.0)])
    scene.add(effects.Rod(), joints[:-1], joints[1:])
    scene.add(effects.Rod(), ground, joints[[0, 2]])
    scene.add(effects.LinearSpring(5.0, 1.0), ground[0], joints[1])
    scene.add(effects.Gravity((0.0, -G)))
    return scene


swelling = eig3.jit(lambda t: (1 + 0.1 * np.sin(3 * t), 0.3 * np.cos(3 * t), -0.9 * np.sin(3 * t)))


def actuated():
    scene = Scene(3)
    bob = scene.mass(1.0, (0.6, 0.0, -0.8), (0.0, 0.5, 0.0) + 0.3 * np.array([0.6, 0.0, -0.8]))
    scene.add(effects.PrescribedDistance(swelling), scene.fixed((0.0, 0.0, 0.0)), bob)
    scene.add(effects.Gravity((0.0, 0.0, -G)))
    return scene


swing = eig3.jit(lambda t: (np.sin(4 * t), 4 * np.cos(4 * t), -16 * np.sin(4 * t)))


def driven():
    """A pendulum on a crank whose angle is a function of time."""
    scene = Scene(2)
    crank = scene.body(1.0, 0.1, (0.0, 0.0), angular_velocity=4.0)
    crank.revolute(None, (0.0, 0.0))
    crank.prescribed_angle(None, swing)
    bob = scene.mass(1.0, (0.3, -0.5), (0.0, 1.2))
    scene.add(effects.Rod(), crank.at((0.3, 0.0)), bob)
    scene.add(effects.Gravity((0.0, -G)))
    return scene


SCENES = [lambda: chain(3, drag=0.3), slider_crank, closed_loop, actuated, driven]


@functools.cache
def with_its_motion(make):
    problem = make().problem((0.0, 0.8))
    return problem, problem.integrate(rtol=1e-13, method="rk8", outputs=problem.outputs)


STEPS = {"eig3": (2, 4e-3), "rk4": (4, 2e-2), "eig5": (4, 4e-3), "ab2": (2, 2e-3)}


RUNS = [*zip(SCENES, ("ab2", "rk4", "eig3", "eig5", "eig3"), strict=True), (driven, "rk4")]


@pytest.mark.parametrize(("make", "method"), RUNS)
def test_positions_and_reactions_keep_the_order(make, method):
    order, h = STEPS[method]
    problem, exact = with_its_motion(make)
    errors = []
    for step in (h, h / 2, h / 4):
        run = problem.integrate(h=step, method=method, outputs=problem.outputs)
        values = (run.u, run.v, run.outputs["reactions"]), (exact.u, exact.v, exact.outputs["reactions"])
        errors.append([np.abs(x[-1] - y[-1]).max() / np.abs(y[-1]).max() for x, y in zip(*values, strict=True)])
    ratios = np.log2([np.divide(a, b) for a, b in pairwise(errors)])
    # the terms of higher order change the ratio by less than a third of the order at these steps
    assert ratios[-1] == pytest.approx(order, abs=order / 3)


def test_a_pendulum_is_that_of_its_angle():
    run = chain(1, angle=2.0).problem((0.0, 5.0)).integrate(rtol=1e-12, method="rk8")
    angle = solve_ivp(lambda t, y: (y[1], -G * np.sin(y[0])), (0, 5), (2.0, 0.0), "DOP853", rtol=1e-12, atol=1e-12).y[0]
    np.testing.assert_allclose(run.u[-1], [np.sin(angle[-1]), -np.cos(angle[-1])], rtol=0, atol=1e-10)


def test_the_reaction_is_the_force_in_a_rod():
    """A bob that hangs has the tension m g, and one that swings on a circle m v^2 / r more."""
    problem = chain(1, angle=0.0).problem((0.0, 0.1))
    problem = problem.with_(v0=np.array([2.0, 0.0]))
    run = problem.integrate(h=1e-3, outputs=problem.outputs)
    assert run.outputs["reactions"][0, 0] == pytest.approx(-(G + 4.0), rel=1e-14)


def test_a_million_steps_keep_the_lengths():
    """Of RK4; the next test has those of EIG-3."""
    run = chain(3).problem((0.0, 1000.0)).integrate(h=1e-3, method="rk4", save_every=10_000)
    assert np.abs(lengths(chain(3), run.u) - 1 / 3).max() < 1e-13
    assert len(run.t) == 101


def test_the_energy_of_a_chain_stays_bounded():
    """EIG-3 is symplectic here: in 10^4 s, some 10^4 periods, the extremes of the energy grow by nothing but chaos."""
    problem = chain(2, angle=0.5).problem((0.0, 10_000.0))
    run = problem.integrate(h=5e-3, save_every=1000)
    assert np.abs(lengths(problem, run.u) - 1 / 2).max() < 1e-13
    energy = problem.energy_of(run.u, run.v)
    first, last = energy[: len(energy) // 10], energy[-len(energy) // 10 :]
    assert np.abs(last - energy[0]).max() < 2 * np.abs(first - energy[0]).max()
    assert abs(last.mean() - first.mean()) < 0.1 * np.ptp(first)


@dataclass(frozen=True, eq=False)
class OnCircle(effects.Constraint):
    radius: ArrayLike

    takes = (1,)

    phi = eig3.jit(lambda x0, radius: (x0[0] * x0[0] + x0[1] * x0[1]) / (2 * radius) - radius / 2)


@dataclass(frozen=True, eq=False)
class Apart(effects.Constraint):
    """A rod with functions of its own."""

    length: ArrayLike

    @staticmethod
    @eig3.jit
    def phi(x0, x1, length):
        dx, dy = x1[0] - x0[0], x1[1] - x0[1]
        return (dx * dx + dy * dy - length * length) / (2 * length)

    @staticmethod
    @eig3.jit
    def gradient(x0, x1, length):
        gx, gy = (x1[0] - x0[0]) / length, (x1[1] - x0[1]) / length
        return -gx, -gy, gx, gy


@pytest.mark.parametrize("options", [{"h": 1e-3}, {"h": 1e-3, "method": "rk4"}, {"rtol": 1e-9}])
def test_constraints_of_ones_own_are_those_of_the_library(options):
    """The curvature of one's own is a difference, with an error of 1e-10 of it."""
    runs = []
    for own in (False, True):
        scene = Scene(2)
        bobs = scene.mass([1.0, 0.5], [(0.6, -0.8), (1.4, -1.4)])
        if own:
            scene.add(OnCircle([1.0]), bobs[:1])
            scene.add(Apart(1.0), bobs[0], bobs[1])
        else:
            scene.add(effects.Rod(), scene.fixed((0.0, 0.0)), bobs[0])
            scene.add(effects.Rod(), bobs[0], bobs[1])
        scene.add(effects.Gravity((0.0, -G)))
        problem = scene.problem((0.0, 2.0))
        runs.append(problem.integrate(outputs=problem.outputs, **options))
    np.testing.assert_allclose(runs[0].u[-1], runs[1].u[-1], rtol=0, atol=1e-9)
    reactions = [run.outputs["reactions"][-1] for run in runs]
    np.testing.assert_allclose(*reactions, rtol=1e-7)


def test_sliders_and_welds():
    """A bead on a skew line in space falls with a part of g; one in a plane that is welded to it goes with it."""
    scene = Scene(3)
    way = np.array([1.0, 2.0, -2.0]) / 3
    bead, guest = scene.mass(1.0, (0.0, 0.0, 0.0)), scene.mass(3.0, (0.0, 1.0, 0.0))
    scene.add(effects.Slider(direction=2 * way), bead)
    scene.add(effects.PointJoint(), bead, guest)
    puck = scene.mass(1.0, (5.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    scene.add(effects.Slider(normal=(0.0, 0.0, 3.0)), puck)
    scene.add(effects.Gravity((0.0, 0.0, -G)))
    problem = scene.problem((0.0, 1.0))
    run = problem.integrate(h=1e-2, outputs=problem.outputs)
    fall = G * 2 / 3 / 2
    np.testing.assert_allclose(bead.positions(run.u)[-1], fall * way, atol=1e-12)
    np.testing.assert_allclose(guest.positions(run.u)[-1], fall * way + [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(puck.positions(run.u)[-1], [6.0, 0.0, 0.0], atol=1e-12)
    assert abs(run.outputs["reactions"][-1, -1]) == pytest.approx(G)


def test_the_work_of_an_actuator_is_followed():
    """The error of the balance falls as h^2: without the work, the energy changes by more than 1 J."""
    problem = actuated().problem((0.0, 1.0), work=True)
    drifts = [problem.integrate(h=h).drift["energy"] for h in (2e-3, 1e-3)]
    assert drifts[0] / drifts[1] == pytest.approx(4.0, rel=0.1)
    precise = problem.integrate(h=1e-2, method="rk8")
    assert precise.drift["energy"] < 1e-10
    assert np.ptp(precise.z["work"]) > 1


@pytest.mark.parametrize("options", [{"h": 1e-3}, {"rtol": 1e-8}])
def test_an_impact_goes_through_the_joints(options):
    """The end of a double pendulum strikes a wall: its restitution is exact, and no rod becomes longer."""
    scene = chain(2, angle=1.2)
    end = scene.mass(2.0, (1.5, 0.3))
    scene.add(effects.Rod(), eig3.scene.Points(scene, np.array(1)), end)
    scene.add(effects.RigidStop((1.0, 0.0), -0.4, restitution=0.7), end)
    run = scene.problem((0.0, 3.0)).integrate(**options)
    impacts = run.events["rigid stop 0"]
    assert len(impacts.t) > 0
    before, after = end.velocities(impacts.v)[0, 0], end.velocities(impacts.v_after)[0, 0]
    assert after == pytest.approx(-0.7 * before, rel=1e-9)
    x, v = (np.moveaxis(values.reshape(2, -1), 0, -1) for values in (impacts.u[0], impacts.v_after[0]))
    rates = [v[0] @ x[0], (v[1] - v[0]) @ (x[1] - x[0]), (v[2] - v[1]) @ (x[2] - x[1])]
    # the positions come from the dense output, which keeps the constraints to the order of the method only
    np.testing.assert_allclose(rates, 0.0, atol=1e-5)


@pytest.mark.parametrize("options", [{"h": 1e-3}, {"h": 1e-3, "method": "rk4"}, {"rtol": 1e-7}])
def test_runs_go_on_with_the_same_bits(options, tmp_path):
    problem = chain(9, drag=0.2).problem((0.0, 1.0))  # too many rods for lanes, which round in another way
    whole = problem.integrate(save_to=tmp_path / "whole", **options)
    half = problem.with_(t_span=(0.0, 0.5)).integrate(**options)
    if "h" in options:
        assert_same(half.extend(1.0), whole)
    members = problem.ensemble(u0=np.tile(problem.u0, (3, 1)), v0=np.tile(problem.v0, (3, 1)), **options)
    np.testing.assert_array_equal(members.u[1, -1], whole.u[-1])


def test_a_chain_takes_time_as_its_number_of_rods():
    """The profile of S has as many numbers for each rod of a chain, and of a tree, whatever their number."""
    for n in (20, 200):
        table = chain(n).problem((0, 1)).params
        assert len(table) < 80 * n + 200
    scene, count = Scene(2), 127
    x = np.random.default_rng(1).normal(size=(count, 2))
    knots = scene.mass(1.0, x)
    scene.add(effects.Rod(), knots[(np.arange(1, count) - 1) // 2], knots[1:])
    assert len(scene.problem((0, 1)).params) < 120 * count


def test_the_reaction_of_a_prescribed_distance_is_a_force():
    """It and the weight give the acceleration of the mass, to round-off, also where the distance has changed."""
    problem = actuated().problem((0.0, 0.8))
    run = problem.integrate(h=1e-3, method="rk8", outputs=problem.outputs)
    away = run.u / np.linalg.norm(run.u, axis=1)[:, None]
    np.testing.assert_allclose(run.outputs["reactions"] * away - (0.0, 0.0, G), run.a, rtol=0, atol=1e-12)


def test_constraints_that_do_not_fit_are_named():
    scene = Scene(2)
    corners = scene.mass(1.0, [(0, 0), (1, 0), (0, 1), (1, 1)])
    first, second = np.array([(i, j) for i in range(4) for j in range(i)]).T
    scene.add(effects.Rod(), corners[first], corners[second])
    with pytest.raises(ValueError, match=r"these constraints depend on each other at the start: rod .*leave out"):
        scene.problem((0.0, 1.0))
    scene = Scene(2)
    scene.add(effects.Rod([1.0, 3.0]), scene.fixed((0, 0)), scene.mass(1.0, [(1, 0), (0, 2)]))
    with pytest.raises(ValueError, match="rod 1 has the length 3 m, but its ends are 2 m apart: move its points"):
        scene.problem((0.0, 1.0))
    scene = Scene(2)
    scene.add(effects.PrescribedDistance(growing), scene.fixed((0, 0)), scene.mass(1.0, (0, 1.5)))
    with pytest.raises(ValueError, match=r"distance 0 has the length 2 m, but its ends are 1.5 m apart"):
        scene.problem((0.0, 1.0))
    scene = Scene(2)
    scene.add(OnCircle(2.0), scene.mass(1.0, (1.0, 0.0)))
    with pytest.raises(ValueError, match=r"on circle 0 does not hold at the start, where its phi is -0.75: move its"):
        scene.problem((0.0, 1.0))
    scene = Scene(2)
    scene.add(effects.Rod(), scene.fixed((0, 0)), scene.mass(1.0, (1, 0), (1.0, 2.0)))
    with pytest.warns(UserWarning, match="the velocities at the start do not keep rod 0"):
        problem = scene.problem((0.0, 1.0))
    np.testing.assert_allclose(problem.v0, [0.0, 2.0], atol=1e-15)
    with pytest.raises(ValueError, match="length of Rod must be positive"):
        effects.Rod(0.0)
    with pytest.raises(TypeError, match="give one of them"):
        effects.Slider()
    with pytest.raises(ValueError, match="Rod joins fixed points only"):
        scene.add(effects.Rod(), scene.fixed((0, 0)), scene.fixed((1, 0)))
    with pytest.raises(ValueError, match="Rod has no direction where its ends coincide"):
        scene.add(effects.Rod(), scene.fixed((0, 0)), scene.mass(1.0, (0, 0)))
    moved = Scene(2)
    pivot = moved.fixed((0, 0))
    moved.add(effects.SampledMotion([0.0, 1.0], [0.0, 0.1], (1.0, 0.0)), pivot)
    moved.add(effects.Rod(), pivot, moved.mass(1.0, (1, 0)))
    with pytest.raises(ValueError, match="Rod takes fixed points that no motion moves"):
        moved.problem((0.0, 1.0))
    with pytest.raises(ValueError, match="method 'cd' does not support constraints"):
        problem.integrate(h=1e-3, method="cd")
    with pytest.raises(ValueError, match="method 'cd' does not support constraints"):
        problem.critical_step(method="cd")
    with pytest.raises(ValueError, match="needs a rhs that ignores v"):
        problem.integrate(h=1e-3, method="bm6", invariants={})


@pytest.mark.parametrize("options", [{"h": 1e-3, "method": "rk4"}, {"rtol": 1e-9, "method": "rk8"}])
def test_other_starts_of_a_problem_keep_the_constraints(options):
    """With the nearest velocities the energy stays, within the errors of these steps; v0 has 0.18 J too much."""
    scene = Scene(2)
    scene.add(effects.Rod(), scene.fixed((0, 0)), scene.mass(1.0, (0.6, -0.8)))
    scene.add(effects.Gravity((0, -G)))
    problem = scene.problem((0.0, 2.0))
    with pytest.raises(ValueError, match="u0 must keep the constraints, but the start at t = 0 does not: change u0"):
        problem.with_(u0=[0.7, -0.8]).integrate(**options)
    with pytest.raises(ValueError, match="u0 must keep the constraints, but the start at t = 0 does not: change u0"):
        problem.with_(u0=[0.7, -0.8]).stepper(h=1e-3)
    with pytest.raises(ValueError, match="u0 must keep the constraints, but member 1 at t = 0 does not"):
        problem.ensemble(u0=[problem.u0, [3.0, 4.0]], **options)
    with pytest.warns(UserWarning, match="v0 does not keep the constraints: the run starts with the nearest"):
        run = problem.with_(v0=[1.0, 0.0]).integrate(**options)
    np.testing.assert_allclose(run.v[0], [0.64, 0.48], rtol=1e-15)
    assert run.drift["energy"] < 1e-7
    with pytest.warns(UserWarning, match="v0 does not keep the constraints"):
        members = problem.ensemble(v0=[[1.0, 0.0], [0.0, 0.0]], params=[problem.params] * 2, **options)
    np.testing.assert_allclose(members[0].u[-1], run.u[-1], rtol=0, atol=1e-8)


def flat_four_bar(flat=False):
    """Two cranks of the same length and their coupler: a parallelogram, which may lie flat and then turn inside out."""
    scene = Scene(2)
    ground = scene.fixed([(0.0, 0.0), (2.0, 0.0)])
    way = np.array([1.0, 0.0]) if flat else np.array([np.cos(1.2), np.sin(1.2)])
    speed = 3.0 * np.array([way[1], -way[0]])
    pins = scene.mass(1.0, [way, way + np.array([2.0, 0.0])], [speed, speed])
    scene.add(effects.Rod(), ground, pins)
    scene.add(effects.Rod(), pins[0], pins[1])
    return scene.problem((0.0, 2.0)) if flat else (pins, scene.problem((0.0, 2.0)))


@pytest.mark.parametrize("options", [{"h": 1e-3}, {"h": 1e-2}, {"h": 1e-3, "method": "rk4"}, {"rtol": 1e-9}])
def test_a_singular_position_is_passed_or_reported(options):
    """Where the parallelogram is flat, the pins could go on either way; a run that goes on keeps the parallelogram."""
    pins, problem = flat_four_bar()
    run = problem.integrate(**options)
    x = pins.positions(run.u)
    np.testing.assert_allclose(x[:, 1] - x[:, 0], np.tile([2.0, 0.0], (len(x), 1)), atol=1e-6)
    if not run.success:
        assert run.t[-1] == pytest.approx(0.4, abs=0.02)
        assert "at a singular position of the mechanism, where its constraints depend on each other" in run.message
    with pytest.raises(ValueError, match="these constraints depend on each other at the start"):
        flat_four_bar(flat=True)


@pytest.mark.parametrize("method", ["eig3", "rk4", "rk8"])
def test_the_runs_that_pass_a_singular_position_are_named(method):
    """As it is for the user who runs them, and without a word about stability, of which it is no question.

    Steps that end at the singular position, at t = 0.4, pass it or not by their round-off, which depends on the
    processor: the first step that does not pass counts.
    """
    _, problem = flat_four_bar()
    runs = (problem.integrate(h=h, method=method) for h in (1e-3, 5e-4, 1e-2, 2e-3, 2.5e-4, 8e-4, 4e-4, 2e-4, 1e-4))
    run = next(run for run in runs if run.status is eig3.Status.DIVERGED)
    why = run.explain()
    assert "stable" not in why
    assert "critical" not in why
    passed, _, lost = why.partition(" passed it")
    named = [(part, part in passed) for part in re.findall(r"'\w+' with (?:rtol|h)=[\d.e-]+", passed + lost)]
    assert any(passes for _, passes in named)
    for name, passes in named:
        method, _, option = name.replace("'", "").partition(" with ")
        option, _, value = option.partition("=")
        other = problem.integrate(method=method, **{option: float(value)})
        assert bool(other.t[-1] > run.t[-1] + 0.05) is passes


reaching = eig3.jit(lambda t: (2.0 + 0.25 * t, 0.25, 0.0))


@pytest.mark.parametrize("options", [{"h": 1e-3, "method": "rk8"}, {"rtol": 1e-8}])
def test_a_singular_position_that_nothing_passes(options):
    """A rod and a distance that grows to the sum of both lengths: the mechanism cannot go beyond it."""
    scene, x = Scene(2), -0.25
    mass = scene.mass(1.0, (x, np.sqrt(1 - x * x)))
    scene.add(effects.Rod(), scene.fixed((0.0, 0.0)), mass)
    scene.add(effects.PrescribedDistance(reaching), scene.fixed((1.5, 0.0)), mass)
    with pytest.warns(UserWarning, match="the velocities at the start do not keep"):
        run = scene.problem((0.0, 4.0)).integrate(**options)
    assert run.t[-1] == pytest.approx(2.0, abs=2e-3)
    assert "at a singular position of the mechanism" in run.message
    assert "begin after it, or change the mechanism" in run.explain()
    assert "stable" not in run.explain()
    if "h" in options:
        assert "'rk8' with rtol=1e-08, 'rk8' with h=0.0009" in run.explain().partition("did not pass it either")[0]


def test_too_long_a_step_is_no_singular_position():
    run = chain(3, angle=0.5).problem((0.0, 10.0)).integrate(h=0.5)
    assert "or the step is too long for them" in run.message
    assert "the critical step of EIG3" in run.explain()


def test_a_straight_chain_stays_straight_and_swings_again():
    """A chain that hangs at rest does not move; with a push, it straightens again and again."""
    problem = chain(20, angle=0.0).problem((0.0, 2.0))
    still = problem.integrate(h=1e-3)
    np.testing.assert_allclose(still.u[-1], problem.u0, atol=1e-13)
    pushed = problem.with_(v0=np.concatenate([np.linspace(0, 1, 20), np.zeros(20)])).integrate(h=5e-4)
    assert pushed.success
    assert pushed.drift["energy"] < 1e-3
    assert np.abs(lengths(problem, pushed.u) - 1 / 20).max() < 1e-13


@dataclass(frozen=True, eq=False)
class Reel(effects.Constraint):
    """The distance from the origin grows at a constant speed."""

    speed: ArrayLike
    length: ArrayLike

    takes = (1,)

    phi = eig3.jit(lambda x0: np.sqrt(x0[0] * x0[0] + x0[1] * x0[1]))
    target = eig3.jit(lambda t, speed, length: (length + speed * t, speed, 0.0))


def test_a_target_of_ones_own_depends_on_the_time():
    """Without other forces the angular momentum stays, and the energy that is lost is the work of the reel."""
    scene, length, speed = Scene(2), np.array([1.0, 2.0]), np.array([0.2, 0.3])
    points = scene.mass(1.0, np.column_stack([length, 0 * length]), np.column_stack([speed, [1.0, 1.5]]))
    scene.add(Reel(speed, length), points)
    problem = scene.problem((0.0, 2.0), work=True)
    for options, tolerance in (({"h": 1e-3, "method": "rk4"}, 1e-9), ({"h": 1e-3}, 1e-5)):
        run = problem.integrate(**options)
        x, v = points.positions(run.u), points.velocities(run.v)
        expected = length + speed * run.t[:, None]
        np.testing.assert_allclose(np.linalg.norm(x, axis=-1), expected, rtol=0, atol=1e-13)
        momentum = x[..., 0] * v[..., 1] - x[..., 1] * v[..., 0]
        np.testing.assert_allclose(momentum, np.broadcast_to(momentum[0], momentum.shape), rtol=0, atol=tolerance)
        assert run.drift["energy"] < tolerance


def test_the_frequencies_are_those_in_the_tangent_space():
    """Of a hanging chain: M_ij = n - max(i, j) and K_ii = (n - i) g / l for the angles, from 0. Differences to 1e-8."""
    n = 5
    i, j = np.indices((n, n))
    omega = np.sqrt(np.linalg.eigvals(np.linalg.inv(n - np.maximum(i, j)) @ np.diag((n - i[:, 0]) * G * n)).real.max())
    step = chain(n, angle=0.0).problem((0.0, 1.0)).critical_step()
    assert step.omega_max == pytest.approx(omega, rel=1e-7)
    assert step.limit == pytest.approx(2 / omega, rel=1e-6)  # that of EIG-3 without damping
    disturbed = chain(n, angle=1e-6).problem((0.0, 40.0))
    assert np.abs(disturbed.integrate(h=0.98 * step.limit).u[-1, :n]).max() < 3e-6
    assert disturbed.integrate(h=1.02 * step.limit).status is eig3.Status.DIVERGED


def test_a_plan_finds_a_method(monkeypatch):
    """Without central difference, which has no steps with constraints. To compile more methods takes long."""
    monkeypatch.setattr(planner, "LIBRARY", ("cd", "eig3", "rk4", "ab2"))
    plan = eig3.plan(chain(2).problem((0.0, 0.5)), 1e-3)
    names = {row.method.name for row in plan.predictions}
    assert "eig3" in names
    assert "cd" not in names
    assert np.abs(plan.run().u[-1]).max() > 0.1


def test_what_all_constraints_share_is_compiled_once():
    """A scene with functions of its own compiles these, and nothing of the library that another scene has compiled."""

    def compiled_for(*constraints):
        scene = Scene(2)
        bobs = scene.mass([1.0, 2.0], [(0.0, -1.0), (0.0, -2.0)])
        for constraint, bob in zip(constraints, bobs, strict=True):
            scene.add(constraint, scene.fixed((0.0, 0.0)), bob)
        scene.add(effects.Gravity((0.0, -G)))
        with compilations() as functions:
            scene.problem((0, 1)).integrate(h=0.01, t_end=0.01)
        return [f.__name__ for f in functions if f.__module__ == "eig3.kernels.constraints"]

    compiled_for(effects.Rod(), effects.Rod())
    assert set(compiled_for(effects.Rod(), effects.PrescribedDistance(growing))) <= {
        "hold_2d"
    }  # a call of what is compiled


growing = eig3.jit(lambda t: (2.0 + 0.5 * np.sin(t) ** 2, 0.5 * np.sin(2 * t), np.cos(2 * t)))
