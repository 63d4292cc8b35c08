"""Welds, universal joints and motors of rigid bodies, against what is known of them exactly."""

import re
from contextlib import nullcontext

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import eig3
from eig3 import effects
from eig3.scene import Scene

G = 9.81
PRECISE = {"rtol": 1e-11, "method": "rk8", "t_eval": np.linspace(0.0, 2.0, 21)}


def about(place, mass):
    """The inertia of a mass at a place about the origin."""
    return mass * (place @ place * np.eye(3) - np.outer(place, place))


def test_welded_bodies_in_space_move_as_one():
    """As the one with the sum of both masses and inertias, and with their relative position and orientation kept."""
    masses, places = (2.0, 0.7), np.array([(0.1, -0.2, 0.3), (0.6, 0.4, -0.1)])
    turns = Rotation.from_rotvec([0.3, 0.5, -0.2]), Rotation.from_rotvec([-1.0, 0.2, 0.4])
    moments, w = ((0.2, 0.3, 0.4), (0.05, 0.04, 0.03)), np.array([1.0, 3.0, -2.0])
    centre = np.average(places, axis=0, weights=masses)
    scene = Scene(3)
    pair = [
        scene.body(m, j, x, turn, velocity=np.cross(w, x - centre), angular_velocity=w)
        for m, j, x, turn in zip(masses, moments, places, turns, strict=True)
    ]
    scene.add(effects.Weld(), *pair)
    run = scene.problem((0.0, 2.0)).integrate(**PRECISE)
    inertia = sum(
        turn.as_matrix() @ np.diag(j) @ turn.as_matrix().T + about(x - centre, m)
        for m, j, x, turn in zip(masses, moments, places, turns, strict=True)
    )
    alone = Scene(3)
    whole = alone.body(sum(masses), inertia, centre, angular_velocity=w)
    points = [whole.at(x) for x in places]
    expected = alone.problem((0.0, 2.0)).integrate(**PRECISE)
    turned = Rotation.from_quat(whole.rotation(expected.u))
    for body, point, turn in zip(pair, points, turns, strict=True):
        np.testing.assert_allclose(body.centre.positions(run.u), point.positions(expected.u), rtol=0, atol=1e-9)
        found = Rotation.from_quat(body.rotation(run.u))
        assert np.abs((found.inv() * turned * turn).magnitude()).max() < 1e-9
        np.testing.assert_allclose(
            body.angular_velocity(run.u, run.v), whole.angular_velocity(expected.u, expected.v), rtol=0, atol=1e-8
        )
    run = scene.problem((0.0, 2.0)).integrate(h=2e-3)
    first, second = (Rotation.from_quat(body.rotation(run.u)) for body in pair)
    way = first.inv().apply(pair[1].centre.positions(run.u) - pair[0].centre.positions(run.u))
    np.testing.assert_allclose(way, way[:1].repeat(len(way), axis=0), rtol=0, atol=1e-13)
    assert ((first.inv() * second) * (turns[0].inv() * turns[1]).inv()).magnitude().max() < 1e-13


@pytest.mark.parametrize("options", [{"h": 2e-3}, {"h": 2e-3, "method": "rk4"}, {"rtol": 1e-8}])
def test_welded_bodies_in_the_plane_swing_as_one(options):
    """Two bars that are welded at a right angle, and hang at a pin, are one pendulum."""
    scene = Scene(2)
    bar, arm = scene.body(1.0, 1 / 12, (0.5, 0.0)), scene.body(2.0, 0.1, (1.0, -0.5), np.pi / 2)
    bar.revolute(None, (0.0, 0.0))
    arm.weld(bar)
    scene.add(effects.Gravity((0.0, -G)))
    run = scene.problem((0.0, 1.0)).integrate(**options)
    alone = Scene(2)
    centre = np.array([(0.5 + 2.0) / 3, -1.0 / 3])
    apart = [m * np.sum((centre - x) ** 2) for m, x in ((1.0, (0.5, 0.0)), (2.0, (1.0, -0.5)))]
    both = alone.body(3.0, 1 / 12 + 0.1 + sum(apart), centre)
    both.revolute(None, (0.0, 0.0))
    alone.add(effects.Gravity((0.0, -G)))
    expected = alone.problem((0.0, 1.0)).integrate(rtol=1e-11, method="rk8")
    angle = both.rotation(expected.u[-1])
    assert bar.rotation(run.u[-1]) == pytest.approx(angle, abs=1e-5)
    apart = np.unwrap(arm.rotation(run.u)) - np.unwrap(bar.rotation(run.u))
    np.testing.assert_allclose(apart, np.pi / 2, rtol=0, atol=1e-12)


def test_a_weld_with_the_ground_bears_the_load():
    """The weight, the moment of a force beside the centre, and a torque."""
    scene = Scene(2)
    body = scene.body(2.0, 0.3, (1.0, 0.0))
    scene.add(effects.Weld(), body)
    scene.add(effects.Gravity((0.0, -G)))
    scene.add(effects.HarmonicForce((0.0, 3.0), 0.0), body.point((0.5, 0.0)))
    scene.add(effects.Torque(0.7), body.axes)
    problem = scene.problem((0.0, 1.0))
    run = problem.integrate(h=0.01, outputs=problem.outputs)
    np.testing.assert_allclose(run.u, run.u[:1].repeat(101, axis=0), rtol=0, atol=1e-14)
    weld = run.outputs["reactions"][:, -3:]
    np.testing.assert_allclose(weld, [[0.0, 2.0 * G - 3.0, -0.7 - 1.5]] * 101, rtol=0, atol=1e-10)


def test_joints_in_space_bear_the_load_as_their_help_says():
    """The joints are at the centres of bodies at rest, so that each bears the opposite of the given load."""
    scene, force, torque = Scene(3), np.array([10.0, -20.0, 30.0]), np.array([1.0, 2.0, -3.0])
    axis, other = np.array([0.6, 0.8, 0.0]), np.array([0.0, 0.0, 1.0])
    bodies = [scene.body(1.0, (0.2, 0.2, 0.2), (x, 0.0, 0.0)) for x in (0.0, 1.0, 2.0)]
    revolute, prismatic, universal = bodies
    revolute.revolute(None, (0.0, 0.0, 0.0), axis)
    prismatic.prismatic(None, (1.0, 0.0, 0.0), axis)
    universal.universal(None, (2.0, 0.0, 0.0), axis, other)
    scene.add(effects.Gravity(force))
    for body in bodies:
        scene.add(effects.Torque(torque), body.axes)
    problem = scene.problem((0.0, 0.1))
    found = problem.integrate(h=0.1, outputs=problem.outputs).outputs["reactions"][0, 18:]
    e, f = np.linalg.svd([axis])[2][1:]
    across = np.cross(axis, e), np.cross(axis, f)
    expected = [
        *(*force, *(-torque @ n for n in across)),
        *(-force @ e, -force @ f, *(-torque @ n for n in (*across, np.cross(e, f)))),
        *(*force, -torque @ np.cross(axis, other)),
    ]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)  # round-off of 30 N


def test_a_weld_in_space_bears_torques_about_each_axis():
    scene, torque = Scene(3), np.array([1.0, -0.5, 0.3])
    body = scene.body(1.0, (0.2, 0.3, 0.4), (0.0, 0.0, 0.0))
    body.weld(None)
    scene.add(effects.Torque(torque), body.axes)
    problem = scene.problem((0.0, 1.0))
    run = problem.integrate(h=0.1, outputs=problem.outputs)
    np.testing.assert_allclose(run.outputs["reactions"][-1, -6:], [0, 0, 0, *-torque], rtol=0, atol=1e-12)


steady = eig3.jit(lambda t: (3.0 * t, 3.0, 0.0))


def test_a_universal_joint_turns_as_hookes():
    """Behind a joint with the angle b, tan of the angle of the second shaft is that of the first divided by cos b."""
    b, origin = 0.6, (0.0, 0.0, 0.0)
    along, up = np.array([np.cos(b), np.sin(b), 0.0]), np.array([0.0, 0.0, 1.0])
    scene = Scene(3)
    first = scene.body(1.0, (0.1, 0.1, 0.15), (-0.5, 0.0, 0.0), angular_velocity=(3.0, 0.0, 0.0))
    second = scene.body(1.0, (0.1, 0.1, 0.15), 0.5 * along, angular_velocity=3.0 / np.cos(b) * along)
    first.revolute(None, (-1.0, 0.0, 0.0), (1.0, 0.0, 0.0))
    first.prescribed_angle(None, steady, (1.0, 0.0, 0.0))
    first.universal(second, origin, (0.0, 1.0, 0.0), up)
    scene.add(effects.Slider(direction=along), second.at(along))
    run = scene.problem((0.0, 2.0)).integrate(h=1e-3, method="rk4")
    turned = Rotation.from_quat(second.rotation(run.u)).apply(up)
    angle = np.unwrap(np.arctan2(turned @ np.cross(along, up), turned @ up))
    expected = np.unwrap(np.arctan2(np.sin(3.0 * run.t), np.cos(b) * np.cos(3.0 * run.t)))
    np.testing.assert_allclose(angle, expected, rtol=0, atol=1e-9)


controller = eig3.jit(lambda t, angle, rate: 0.4 * t - 5.0 * angle - 0.3 * rate)


def driven(t, inertia):
    """The angle of a damped oscillator from rest under a load of 0.4 t N m."""
    k, c = 5.0, 0.3
    omega, xi = np.sqrt(k / inertia), c / (2 * np.sqrt(k * inertia))
    drift, start = 0.4 / k, -0.4 * c / k**2  # of the motion in the end
    high = omega * np.sqrt(1 - xi**2)
    sine = (-drift - xi * omega * start) / high
    return start + drift * t + np.exp(-xi * omega * t) * (-start * np.cos(high * t) + sine * np.sin(high * t))


rising = eig3.jit(lambda t: 0.4 * t)


def test_a_motor_may_be_a_controller():
    """A torque of the time, the angle and its rate makes an oscillator: on one body, between two, and about an axis.

    One of the time only accelerates two other bodies.
    """
    plane = Scene(2)
    alone = plane.body(1.0, 0.2, (0.0, 0.0), 0.7)
    plane.add(effects.Motor(controller), alone.axes)
    rotor, stator, pushed, pushing = (plane.body(1.0, j, (0.0, 0.0)) for j in (0.2, 0.6, 0.2, 0.6))
    rotor.motor(stator, controller)
    pushed.motor(pushing, rising)
    axis = np.array([2.0, 1.0, 2.0]) / 3
    space = Scene(3)
    ball = space.body(1.0, (0.2, 0.2, 0.2), (0.0, 0.0, 0.0))
    ball.revolute(None, (0.0, 0.0, 0.0), axis)
    ball.motor(None, controller, axis)
    runs = [scene.problem((0.0, 2.0), work=True).integrate(**PRECISE) for scene in (plane, space)]
    assert all(run.drift["energy"] < 1e-8 for run in runs)
    u, t = runs[0].u, runs[0].t
    around = Rotation.from_quat(ball.rotation(runs[1].u)).as_rotvec() @ axis
    np.testing.assert_allclose(alone.rotation(u) - 0.7, driven(t, 0.2), rtol=0, atol=1e-8)
    np.testing.assert_allclose(rotor.rotation(u) - stator.rotation(u), driven(t, 0.2 * 0.6 / 0.8), rtol=0, atol=1e-8)
    np.testing.assert_allclose(around, driven(runs[1].t, 0.2), rtol=0, atol=1e-8)
    np.testing.assert_allclose(pushed.rotation(u), 0.4 / 6 / 0.2 * t**3, rtol=0, atol=1e-8)
    np.testing.assert_allclose(pushing.rotation(u), -0.4 / 6 / 0.6 * t**3, rtol=0, atol=1e-8)


def test_what_acts_about_an_axis_in_space_needs_a_revolute_joint_with_this_axis():
    """Its torques on the two bodies are not opposite without the joint, and angular momentum is lost."""
    adds = {
        "motor": lambda body, other, axis: body.motor(other, controller, axis),
        "linear spring": lambda body, other, axis: body.torsional_spring(other, effects.LinearSpring(5.0), axis),
        "hinge friction": lambda body, other, axis: body.friction(other, 0.05, axis),
    }
    for name, add in adds.items():
        for axis, is_right in (((0.0, 0.6, 0.8), True), ((0.0, 0.0, 1.0), False)):
            scene = Scene(3)
            body, other = (scene.body(1.0, (0.1, 0.12, 0.15), (x, 0.0, 0.0)) for x in (0.0, 1.0))
            body.spherical(None, (0.0, 0.0, 0.0))
            body.revolute(other, (0.5, 0.0, 0.0), (0.0, 0.6, 0.8))
            add(body, other, axis)
            message = rf"^{name} \(body 0, body 1\) needs a revolute joint with the same axis .*body\.revolute\("
            with nullcontext() if is_right else pytest.raises(ValueError, match=message):
                scene.problem((0.0, 1.0))


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_acts_on_a_rotation_that_a_joint_prevents_is_refused(dimension):
    """It does nothing there, such as friction that is meant along a prismatic joint."""
    axis = None if dimension == 2 else (1.0, 0.0, 0.0)
    for is_slide in (True, False):
        scene = Scene(dimension)
        body = scene.body(1.0, 1.0 if dimension == 2 else (1.0, 1.0, 1.0), np.zeros(dimension))
        body.friction(None, 5.0, axis, damping=2.0)
        if is_slide:
            body.prismatic(None, np.zeros(dimension), np.eye(dimension)[0])
        else:
            body.weld(None)
        remedy = "leave it out, or for a force along" if is_slide else r"leave it out\.$"
        message = rf"^hinge friction \(body 0, ground\) acts on a rotation, which .* prevents: {remedy}"
        with pytest.raises(ValueError, match=message):
            scene.problem((0.0, 1.0))


only_angle = eig3.jit(lambda t, theta, rate: theta)
twofold = eig3.jit(lambda t, angle, rate: (angle, rate))


def test_wrong_joints_are_refused():
    plane, space = Scene(2), Scene(3)
    disc, ball = plane.body(1.0, 1.0, (0.0, 0.0)), space.body(1.0, (1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    origin, x = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="axis of a revolute joint must be given in a scene of 3 dimensions"):
        ball.revolute(None, origin)
    with pytest.raises(ValueError, match=r"in the plane, take body\.revolute\(other, position\)"):
        disc.spherical(None, (0.0, 0.0))
    with pytest.raises(ValueError, match="axis and other_axis of a universal joint must be at right angles"):
        ball.universal(None, origin, x, (1.0, 1.0, 0.0))
    with pytest.raises(TypeError, match=r"Weld joins two rigid bodies, or one with the ground: scene\.add"):
        plane.add(effects.Weld(), disc.centre, plane.fixed((1.0, 0.0)))
    with pytest.raises(TypeError, match=r"has an angle, which needs an axis in space: take body\.motor"):
        space.add(effects.Motor(controller), ball.axes)
    with pytest.raises(TypeError, match="torque of Motor must be a jitted function of t, or of t, angle and rate"):
        plane.add(effects.Motor(only_angle), disc.axes)
    with pytest.raises(TypeError, match="torque of Motor must return a number here"):
        disc.motor(None, twofold)
    with pytest.raises(ValueError, match=r"for a mass take scene\.add\(PointJoint\(\), body\.at\(position\), mass\)"):
        disc.revolute(plane.mass(1.0, (1.0, 0.0)), (1.0, 0.0))
    disc.revolute(None, (0.0, 0.0))
    disc.weld(None)
    with pytest.raises(ValueError, match=r"these constraints depend on each other at the start: .*weld 0"):
        plane.problem((0.0, 1.0))


def loop_of_hinges():
    """Three bodies and the ground in a square, with parallel hinges: three conditions are too many in space."""
    scene, z = Scene(3), (0.0, 0.0, 1.0)
    bars = [scene.body(1.0, (1.0, 1.0, 1.0), place) for place in ((0.0, 0.5, 0.0), (0.5, 1.0, 0.0), (1.0, 0.5, 0.0))]
    bars[0].revolute(None, (0.0, 0.0, 0.0), z)
    bars[0].revolute(bars[1], (0.0, 1.0, 0.0), z)
    bars[1].revolute(bars[2], (1.0, 1.0, 0.0), z)
    bars[2].revolute(None, (1.0, 0.0, 0.0), z)
    return scene


def twice_on_a_slide():
    """A block that slides on the ground twice, beside a body that is no part of it."""
    scene = Scene(2)
    scene.body(1.0, 1.0, (5.0, 0.0))
    block = scene.body(1.0, 1.0, (0.0, 0.0))
    for _ in range(2):
        block.prismatic(None, (0.0, 0.0), (1.0, 0.0))
    return scene


def rods_beside_each_other():
    scene = Scene(2)
    body, mass = scene.body(1.0, 1.0, (0.0, 0.0)), scene.mass(1.0, (2.0, 0.0))
    for _ in range(2):
        scene.add(effects.Rod(), body.point((1.0, 0.0)), mass)
    return scene


def rods_beside_each_other_twice():
    scene = rods_beside_each_other()
    body, mass = scene.body(1.0, 1.0, (0.0, 9.0)), scene.mass(1.0, (2.0, 9.0))
    for _ in range(2):
        scene.add(effects.Rod(), body.point((1.0, 9.0)), mass)
    return scene


#: The joints, and the number of conditions that the others imply: a planar loop in space has 3.
TOO_MANY = {
    loop_of_hinges: (
        3,
        "revolute joint 0 (body 0, ground)",
        "revolute joint 1 (body 0, body 1)",
        "revolute joint 2 (body 1, body 2)",
        "revolute joint 3 (body 2, ground)",
    ),
    twice_on_a_slide: (2, "prismatic joint 0 (body 1, ground)", "prismatic joint 1 (body 1, ground)"),
    rods_beside_each_other: (1, "rod 0 (body 0, mass)", "rod 1 (body 0, mass)"),
    rods_beside_each_other_twice: (2, *(f"rod {k} (body {k // 2}, mass)" for k in range(4))),
}


@pytest.mark.parametrize("make", TOO_MANY, ids=lambda make: make.__name__)
def test_too_many_constraints_are_named_as_the_user_wrote_them(make):
    """By their joints and bodies, and not by the conditions on vectors of which joints are made."""
    with pytest.raises(ValueError, match="these constraints depend on each other at the start") as caught:
        make().problem((0.0, 1.0))
    named = str(caught.value).partition("start: ")[2].partition(";")[0]
    surplus, *joints = TOO_MANY[make]
    assert sorted(re.split(r"(?<=\)), ", named)) == joints
    assert f"is too large by {surplus}:" in str(caught.value)
    assert ("a spherical and a universal joint" in str(caught.value)) == (make is loop_of_hinges)
