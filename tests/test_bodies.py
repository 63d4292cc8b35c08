"""Rigid bodies against their equations in angles, and the mechanisms of the library against published results."""

import pickle

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import eig3
from eig3 import effects, problems
from eig3.bench.squeezers import END
from eig3.kernels import vector_angle
from eig3.problems.four_bar import BASE, COUPLER, CRANK, ROCKER, linkage
from eig3.problems.squeezer import START, mechanism, places
from eig3.problems.tumbling_box import scene_of_box
from eig3.scene import Scene
from eig3.scene.hinge_friction import HingeFriction

from .conftest import assert_same, refusals

G = 9.81
RUNS = [({"rtol": 1e-10, "method": "rk8"}, 1e-8), ({"h": 1e-3, "method": "rk4"}, 1e-8), ({"h": 1e-3}, 1e-4)]


def exact(rates, start, t):
    return solve_ivp(lambda t, y: rates(y), (0, t), start, "DOP853", rtol=1e-12, atol=1e-13).y[:, -1]


@pytest.mark.parametrize(("options", "tolerance"), RUNS)
def test_a_free_body_follows_eulers_equations(options, tolerance):
    """With its axes along those of the frame of the body, and turned against it."""
    moments, spin, turn = np.array([1.0, 2.0, 2.5]), np.array([0.3, 3.0, 0.2]), Rotation.from_rotvec([0.4, -0.2, 0.7])

    def euler(w):
        return (np.roll(moments, -1) - np.roll(moments, -2)) * np.roll(w, -1) * np.roll(w, -2) / moments

    expected = exact(euler, spin, 4.0)
    for inertia, frame in ((moments, turn), (turn.as_matrix() @ np.diag(moments) @ turn.as_matrix().T, None)):
        scene = Scene(3)
        body = scene.body(
            2.0, inertia, (0.0, 1.0, 0.0), frame, velocity=(1.0, 0.0, 0.0), angular_velocity=turn.apply(spin)
        )
        run = scene.problem((0.0, 4.0)).integrate(**options)
        turned = Rotation.from_quat(body.rotation(run.u)[-1]) * (Rotation.identity() if frame else turn)
        found = turned.inv().apply(body.angular_velocity(run.u, run.v)[-1])
        np.testing.assert_allclose(found, expected, rtol=0, atol=3 * tolerance)
        np.testing.assert_allclose(body.centre.positions(run.u)[-1], [4.0, 1.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(("options", "tolerance"), RUNS)
def test_a_bar_on_a_hinge_is_that_of_its_angle(options, tolerance):
    """A spring acts on its end, and a torque on the bar. The force of the hinge is that of the balance."""
    mass, inertia, torque = 2.0, 2.0 / 12, 1.5
    scene = Scene(2)
    bar = scene.body(mass, inertia, (0.5, 0.0))
    bar.revolute(None, (0.0, 0.0))
    end = bar.point((0.5, 0.0))
    scene.add(effects.Gravity((0.0, -G)))
    scene.add(effects.LinearSpring(20.0, 0.5), scene.fixed((1.0, 1.0)), end)
    scene.add(effects.Torque(torque), bar.axes)

    def spring(angle):
        place = np.array([np.cos(angle), np.sin(angle)])
        way = np.array([1.0, 1.0]) - place
        return place, 20.0 * (1 - 0.5 / np.linalg.norm(way)) * way

    def rates(y):
        place, force = spring(y[0])
        moment = -mass * G / 2 * place[0] + place[0] * force[1] - place[1] * force[0] + torque
        return y[1], moment / (inertia + mass / 4)

    angle, speed = exact(rates, (0.0, 0.0), 2.0)
    problem = scene.problem((0.0, 2.0))
    run = problem.integrate(outputs=problem.outputs, **options)
    assert bar.rotation(run.u)[-1] == pytest.approx(angle, abs=tolerance)
    assert bar.angular_velocity(run.u, run.v)[-1] == pytest.approx(speed, abs=10 * tolerance)
    place, force = spring(angle)
    np.testing.assert_allclose(end.positions(run.u)[-1], place, atol=tolerance)
    turning = rates((angle, speed))[1]
    centre = turning * np.array([-place[1], place[0]]) / 2 - speed**2 * place / 2
    hinge = mass * centre - force + [0.0, mass * G]
    np.testing.assert_allclose(run.outputs["reactions"][-1, -2:], -hinge, rtol=0, atol=300 * tolerance)  # on the ground


def test_a_problem_does_not_change_when_a_body_gets_points():
    scene = Scene(2)
    bar = scene.body(1.0, 0.1, (0.5, 0.0))
    problem = scene.problem((0.0, 1.0))
    u = problem.u0[None]
    before = problem.view.places(np.zeros(1), u)
    end = bar.point((0.5, 0.0))
    np.testing.assert_array_equal(problem.view.places(np.zeros(1), u), before)
    np.testing.assert_allclose(end.positions(u), [[1.0, 0.0]], atol=1e-15)


rising = eig3.jit(lambda t: 3.0 * t)
rising_about_an_axis = eig3.jit(lambda t: (0.0, 4.0 * t, 3.0 * t))


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_motor_is_a_torque_that_depends_on_the_time(dimension):
    """The angle grows as t^3 J^-1 / 2, and the hinge takes the part of the torque across its axis."""
    scene = Scene(dimension)
    if dimension == 2:
        bar = scene.body(3.0, 0.25, (0.5, 0.0))
        bar.revolute(None, (0.0, 0.0))
        scene.add(effects.Motor(rising), bar.axes)
    else:
        bar = scene.body(3.0, (0.1, 0.3, 0.25), (0.5, 0.0, 0.0))
        bar.revolute(None, (0.0, 0.0, 0.0), (0.0, 0.0, 2.0))
        scene.add(effects.Motor(rising_about_an_axis), bar.axes)
    problem = pickle.loads(pickle.dumps(scene.problem((0.0, 1.0))))
    run = problem.integrate(h=1e-3, method="rk4")
    angle = np.arctan2(*bar.centre.positions(run.u)[-1, [1, 0]])
    assert angle == pytest.approx(0.5, abs=1e-10)
    spin = np.atleast_1d(bar.angular_velocity(run.u, run.v)[-1])
    np.testing.assert_allclose(spin, [0.0, 0.0, 1.5][-len(spin) :], rtol=0, atol=1e-9)


swing = eig3.jit(lambda t: (2 * np.sin(3 * t), 6 * np.cos(3 * t), -18 * np.sin(3 * t)))
turns = eig3.jit(lambda t: (10 * t, 10.0, 0.0))


@pytest.mark.parametrize(("options", "tolerance"), RUNS)
def test_a_drive_turns_a_bar_as_it_is_told(options, tolerance):
    """Its reaction is the torque of the balance, and its work the energy of the bar."""
    mass, inertia = 2.0, 0.2
    scene = Scene(2)
    spin = 6.0
    bar = scene.body(mass, inertia, (0.5, 0.0), velocity=(0.0, 0.5 * spin), angular_velocity=spin)
    bar.revolute(None, (0.0, 0.0))
    bar.prescribed_angle(None, swing)
    scene.add(effects.Gravity((0.0, -G)))
    problem = scene.problem((0.0, 2.0), work=True)
    run = problem.integrate(outputs=problem.outputs, **options)
    angle, rate, turning = np.array([swing(t) for t in run.t]).T
    np.testing.assert_allclose(np.unwrap(bar.rotation(run.u)), angle, rtol=0, atol=1e-12)
    np.testing.assert_allclose(bar.angular_velocity(run.u, run.v), rate, rtol=0, atol=1e-10)
    torque = (inertia + mass / 4) * turning + mass * G / 2 * np.cos(angle)
    np.testing.assert_allclose(run.outputs["reactions"][:, -1], torque, rtol=0, atol=1e4 * tolerance)
    energy = (inertia + mass / 4) / 2 * rate**2 + mass * G / 2 * np.sin(angle)
    np.testing.assert_allclose(run.z["work"], energy - energy[0], rtol=0, atol=1e2 * tolerance)


def test_a_drive_turns_around_about_the_axis_of_a_hinge():
    """One body turns another one, which turns against the ground, three times around in a second."""
    scene, axis = Scene(3), np.array([0.0, 0.6, 0.8])
    arm = scene.body(1.0, (0.1, 0.2, 0.25), (0.0, 0.0, 0.0), angular_velocity=10 * axis)
    rotor = scene.body(1.0, (0.1, 0.2, 0.25), (0.0, 0.0, 0.0), angular_velocity=20 * axis)
    arm.revolute(None, (0.0, 0.0, 0.0), axis)
    arm.prescribed_angle(None, turns, axis)
    rotor.revolute(arm, (0.0, 0.0, 0.0), axis)
    rotor.prescribed_angle(arm, turns, axis)
    run = scene.problem((0.0, 2.0)).integrate(h=1e-2, method="rk4")
    for body, way in ((arm, 20.0), (rotor, 40.0)):
        expected = Rotation.from_rotvec(way * axis)
        apart = Rotation.from_quat(body.rotation(run.u)[-1]) * expected.inv()
        assert apart.magnitude() < 1e-11
    with pytest.raises(ValueError, match="axis of a prescribed angle must be given in a scene of 3 dimensions"):
        rotor.prescribed_angle(arm, turns)
    with pytest.raises(
        TypeError, match="target of PrescribedAngleInSpace must return a tuple of 3 numbers here, a value with"
    ):
        rotor.prescribed_angle(arm, rising, axis)


def test_viscous_friction_in_a_hinge_takes_the_relative_spin():
    """Of two bodies about one axis, it decays with the reduced inertia, and the sum of their momenta stays."""
    scene, axis = Scene(3), np.array([0.0, 0.6, 0.8])
    inertias, damping = np.array([0.2, 0.5]), 0.3
    rotor, stator = (
        scene.body(1.0, (j, j, j), (0.0, 0.0, 0.0), angular_velocity=w * axis)
        for j, w in zip(inertias, (9.0, 1.0), strict=True)
    )
    rotor.revolute(stator, (0.0, 0.0, 0.0), axis)
    rotor.friction(stator, axis=axis, damping=damping)
    problem = scene.problem((0.0, 1.0), work=True)
    run = problem.integrate(h=2e-3, method="rk4")
    spins = np.array([body.angular_velocity(run.u, run.v) @ axis for body in (rotor, stator)])
    # the errors of RK4 are 2e-10, 2e-9 and 6e-9 here, and fall with h^4
    np.testing.assert_allclose(inertias @ spins, np.full(len(run.t), inertias @ spins[:, 0]), rtol=0, atol=1e-9)
    decay = 8.0 * np.exp(-damping * (1 / inertias).sum() * run.t)
    np.testing.assert_allclose(spins[0] - spins[1], decay, rtol=0, atol=1e-8)
    lost = inertias @ (spins**2 - spins[:, :1] ** 2) / 2
    np.testing.assert_allclose(run.z["work"], lost, rtol=0, atol=3e-8)


def test_friction_in_a_hinge_is_a_couple_against_the_relative_spin():
    """Its moment is limit + damping w, far above the speed of slip, on vectors across the axis in the two bodies."""
    for axis in (np.array([0.0, 0.0, 1.0]), np.array([2.0, 1.0, 2.0]) / 3):
        one, other = (tuple(np.cross(axis, x) / np.linalg.norm(np.cross(axis, x))) for x in ((1, 2, 0.5), (-2, 0.5, 3)))
        v = tuple(np.cross(0.7 * axis, one)), tuple(np.cross(1.9 * axis, other))
        places = [("space", (one, other, tuple(axis)), v)]
        if axis[2] == 1:
            places.append(("plane", (one[:2], other[:2]), (v[0][:2], v[1][:2])))
        for where, x, rates in places:
            rate = getattr(vector_angle, f"rate_in_{where}").py_func(x, rates)
            torque = HingeFriction.torque.py_func(rate, 2.0, 0.3, 1e-9)
            forces = getattr(vector_angle, f"couple_in_{where}").py_func(x, torque)[:2]
            moments = [np.cross(x, [*force, 0.0][:3]) for x, force in zip((one, other), forces, strict=True)]
            np.testing.assert_allclose(moments, np.outer([1, -1], (2.0 + 0.3 * 1.2) * axis), rtol=0, atol=1e-12)


def test_coulombs_friction_in_a_hinge_stops_a_wheel():
    """With its smoothing, sqrt(w^2 + s^2) - s asinh(s / w) of the spin w falls at the rate M / J."""
    scene, inertia, limit, slip = Scene(2), 0.4, 0.8, 0.05
    wheel = scene.body(3.0, inertia, (0.0, 0.0), angular_velocity=4.0)
    wheel.revolute(None, (0.0, 0.0))
    wheel.friction(None, limit, regularization_speed=slip)
    run = scene.problem((0.0, 2.1)).integrate(h=1e-3, method="rk4")
    spin = wheel.angular_velocity(run.u, run.v)
    falls = np.hypot(spin, slip) - slip * np.arcsinh(slip / spin)
    # M h / (J s) = 0.04 at the end, where the error of RK4 is some 0.04^4 s
    np.testing.assert_allclose(falls, falls[0] - limit / inertia * run.t, rtol=0, atol=1e-6)
    assert 0 < spin[-1] < slip
    with pytest.raises(ValueError, match="regularization_speed of HingeFriction must be positive"):
        wheel.friction(None, limit, regularization_speed=0.0)
    with pytest.raises(ValueError, match="axis of friction is for scenes of 3 dimensions"):
        wheel.friction(None, limit, axis=(0.0, 0.0, 1.0))


def test_joints_leave_what_they_should():
    rail = Scene(3)
    car = rail.body(3.0, (0.1, 0.3, 0.25), (0.5, 0.0, 0.0))
    car.prismatic(None, (0.0, 0.0, 0.0), (1.0, 0.0, 1.0))
    box = rail.body(1.0, (0.1, 0.3, 0.25), (0.5, 0.0, 1.0))
    box.prismatic(car, (0.5, 0.0, 0.5), (0.0, 0.0, 1.0))
    rail.add(effects.Gravity((0.0, 0.0, -G)))
    run = rail.problem((0.0, 0.3)).integrate(h=1e-2, method="rk4")
    np.testing.assert_allclose(car.rotation(run.u)[-1], [0.0, 0.0, 0.0, 1.0], atol=1e-12)
    np.testing.assert_allclose(box.rotation(run.u)[-1], [0.0, 0.0, 0.0, 1.0], atol=1e-12)
    # the box falls freely along z, and goes with the car along x: (M + m) x'' + M z'' = -M g with z'' = x'' for the car
    way = -3.0 * G / (3.0 + 3.0 + 1.0) * 0.3**2 / 2
    np.testing.assert_allclose(car.centre.positions(run.u)[-1] - [0.5, 0.0, 0.0], [way, 0.0, way], atol=1e-12)
    np.testing.assert_allclose(
        box.centre.positions(run.u)[-1] - [0.5, 0.0, 1.0], [way, 0.0, -G * 0.3**2 / 2], atol=1e-12
    )

    plane = Scene(2)
    block = plane.body(1.0, 0.1, (0.0, 0.0))
    block.prismatic(None, (0.0, 0.0), (1.0, 1.0))
    plane.add(effects.Gravity((0.0, -G)))
    plane.add(effects.Torque(3.0), block.axes)
    run = plane.problem((0.0, 1.0)).integrate(h=1e-2)
    np.testing.assert_allclose(block.centre.positions(run.u)[-1], [-G / 4, -G / 4], atol=1e-12)
    assert block.rotation(run.u)[-1] == pytest.approx(0.0, abs=1e-12)


def test_a_torsional_spring_on_a_hinge():
    """Its frequency is sqrt(k / J); at this amplitude the spring is linear, and nothing else acts."""
    scene = Scene(2)
    bar = scene.body(3.0, 0.25, (0.5, 0.0))
    bar.revolute(None, (0.0, 0.0))
    ends = bar.point((0.5, 0.0)), scene.fixed((0.0, 0.0)), scene.fixed((0.0, -1.0))
    scene.add(effects.HarmonicAngle(4.0, np.pi / 2 + 0.3), *ends)
    period = 2 * np.pi * np.sqrt(1.0 / 4.0)
    problem = scene.problem((0.0, period))
    # that of the tangent space; the state at the start is no equilibrium, where the frequency would be exact
    assert problem.critical_step().omega_max == pytest.approx(2.0, rel=0.05)
    run = problem.integrate(h=1e-3 * period, method="rk4")
    angles = bar.rotation(run.u)
    np.testing.assert_allclose(angles, 0.3 * (1 - np.cos(2 * run.t)), rtol=0, atol=1e-9)


def test_spheres_of_bodies_touch():
    """Two dumbbells meet: the contacts act between all near spheres, and energy and momentum stay what they are."""
    scene = Scene(3)
    places = [(0.0, 0.0, 0.0), (1.5, 0.2, 0.3)]
    bodies = [scene.body(1.0, (0.1, 0.2, 0.25), place, velocity=(1 - 2 * k, 0, 0)) for k, place in enumerate(places)]
    spheres = [body.point([(0.3, 0.0, 0.0), (-0.3, 0.0, 0.0)]) for body in bodies]
    both = eig3.scene.Points(scene, np.concatenate([points.numbers for points in spheres]))
    scene.add(effects.HertzContact(2e3, 0.5), both, exclude_bonded=("1-2",))
    run = scene.problem((0.0, 2.0)).integrate(h=1e-4, save_every=100)
    assert run.drift["energy"] < 1e-4
    momentum = sum(body.centre.velocities(run.v) for body in bodies)
    np.testing.assert_allclose(momentum, 0.0, atol=1e-12)
    assert np.abs(bodies[0].angular_velocity(run.u, run.v)[-1]).max() > 0.1
    assert bodies[0].centre.velocities(run.v)[-1, 0] < 0.5


def test_a_bar_strikes_through_its_hinge():
    """Its end bounces with the restitution, though the impulse turns the bar about a hinge."""
    scene = Scene(2)
    bar = scene.body(2.0, 2.0 / 12, (0.5, 0.0))
    bar.revolute(None, (0.0, 0.0))
    scene.add(effects.Gravity((0.0, -G)))
    scene.add(effects.RigidStop((0.0, 1.0), -0.6, restitution=0.5), bar.point((0.5, 0.0)))
    problem = scene.problem((0.0, 0.6), work=True)
    for options in ({"h": 1e-3}, {"rtol": 1e-8}):
        run = problem.integrate(**options)
        impact = run.events["rigid stop 0"]
        assert len(impact.t) == 1
        speeds = bar.angular_velocity(impact.u, impact.v)[0], bar.angular_velocity(impact.u, impact.v_after)[0]
        assert speeds[1] == pytest.approx(-0.5 * speeds[0], rel=1e-6)
        assert run.z["work"][-1] == pytest.approx(-0.75 * (2.0 / 3) / 2 * speeds[0] ** 2, rel=1e-4)


@pytest.mark.parametrize("steps", [({"rtol": 1e-10, "method": "rk8"},), ({"h": 1e-6}, {"h": 5e-7})])
def test_the_squeezer_ends_where_it_should(steps):
    """The published angles have errors of 1e-9. Those of EIG-3, 1.6e-6 and 4e-7, fall as h^2, and so cancel to 1e-9."""
    _, bodies = mechanism()
    centres, _, angles = places(END)
    start = places(START)[2]
    ends = []
    for options in steps:
        run = problems.squeezer().integrate(save_every=10**9, **options)
        np.testing.assert_allclose([body.rotation(run.u)[0] for body in bodies], start, rtol=0, atol=1e-12)
        turned = [body.rotation(run.u)[-1] for body in bodies] - np.array(angles)
        places_off = [body.centre.positions(run.u)[-1] for body in bodies] - np.array(centres)
        ends.append(np.column_stack([(turned + np.pi) % (2 * np.pi) - np.pi, places_off]))
    off = np.abs(ends[-1] + (ends[-1] - ends[0]) / 3)
    assert off[:, 0].max() < 1e-8
    assert off[:, 1:].max() < 1.1e-10


def test_a_box_flips_about_its_intermediate_axis():
    """The period of the flips follows from the elliptic quadratures of Euler's equations; here from these equations."""
    problem, (_, box) = problems.tumbling_box(), scene_of_box()
    run = problem.integrate(rtol=1e-10, method="rk8", t_eval=np.linspace(0, 10, 101))
    up = Rotation.from_quat(box.rotation(run.u)).apply([0.0, 1.0, 0.0])[:, 1]
    assert up[0] == 1.0
    assert up.min() < -0.99
    assert up[np.argmin(up) :].max() > 0.99
    assert run.drift["energy"] < 1e-8


def test_a_motor_turns_the_crank_around():
    """The bars keep their joints, and the speed of the crank settles where the damper takes what the motor gives."""
    problem, (_, (crank, coupler, rocker)) = problems.four_bar(), linkage()
    run = problem.integrate(h=problem.h)
    turns = np.unwrap(crank.rotation(run.u))
    assert turns[-1] - turns[0] > 4 * np.pi
    assert np.ptp(np.unwrap(rocker.rotation(run.u))) < np.pi
    knee = [
        np.linalg.norm(x - y, axis=-1)
        for x, y in ((crank.centre.positions(run.u), 0), (rocker.centre.positions(run.u), [BASE, 0]))
    ]
    np.testing.assert_allclose(knee[0], CRANK / 2, atol=1e-13)
    np.testing.assert_allclose(knee[1], ROCKER / 2, atol=1e-13)
    assert COUPLER > CRANK
    assert coupler.rotation(run.u).shape == run.t.shape


def test_runs_with_bodies_go_on_with_the_same_bits():
    problem = problems.four_bar(t_end=0.2)
    for options in ({"h": 1e-3}, {"h": 1e-3, "method": "rk4"}):
        whole, half = problem.integrate(**options), problem.with_(t_span=(0.0, 0.1)).integrate(**options)
        assert_same(half.extend(0.2), whole)


def test_a_torque_takes_the_axes_of_a_body_and_nothing_else():
    scene = Scene(2)
    bar, masses = scene.body(1.0, 1.0, (0.0, 0.0)), scene.mass(1.0, [(0.0, 0.0), (1.0, 0.0)])
    for effect in (effects.Torque(0.5), effects.Motor(rising)):
        for points in (
            (),
            (bar,),
            (bar.axes[0],),
            (bar.axes, bar.axes),
            (bar.centre,),
            (bar.point((1.0, 0.0)),),
            (masses,),
        ):
            with pytest.raises(TypeError, match=rf"turns a rigid body: give its axes, .*{effect.title}.*body.axes"):
                scene.add(effect, *points)
        scene.add(effect, bar.axes)
    with pytest.raises(TypeError, match=r"not on RigidBody: give body.centre, or a point such as body.point\(place\)"):
        scene.add(effects.HarmonicForce((1.0, 0.0), 2.0), bar)


@pytest.mark.parametrize(("inertia", "others"), [((3.0, 1.0, 2.0), 0), (np.diag([0.1, 0.2, 0.3]), 2)])
def test_a_plate_without_thickness_follows_eulers_equations(inertia, others):
    """Also with a torque and a force on a point outside its plane, which the vector across it could not bear."""
    scene, place, w0 = Scene(3), (0.3, -0.2, 0.5), np.array([0.3, 2.0, 0.1])
    moments = np.diag(inertia) if np.ndim(inertia) == 2 else np.array(inertia)
    for k in range(others):  # more constraints than are written as lines
        scene.body(1.0, (1.0, 1.0, 1.0), (1.0 + k, 0.0, 0.0))
    plate = scene.body(2.0, inertia, (0.0, 0.0, 0.0), angular_velocity=w0)
    scene.add(effects.HarmonicForce((0.1, 0.2, -0.1), 1.0), plate.point(place))
    scene.add(effects.Torque((0.05, 0.02, -0.03)), plate.axes)

    def euler(t, y):
        turn, w = Rotation.from_quat(y[:4]).inv(), y[4:]
        torque = np.cross(place, turn.apply(np.cos(t) * np.array([0.1, 0.2, -0.1]))) + turn.apply([0.05, 0.02, -0.03])
        x, s = y[:3], y[3]
        return [*(s * w + np.cross(x, w)) / 2, -x @ w / 2, *(torque - np.cross(w, moments * w)) / moments]

    exact = solve_ivp(euler, (0.0, 5.0), [0.0, 0.0, 0.0, 1.0, *w0], rtol=1e-11, atol=1e-11).y[:, -1]
    problem = scene.problem((0.0, 5.0))
    for options, tolerance in RUNS:
        run = problem.integrate(**options)
        turn = Rotation.from_quat(plate.rotation(run.u)[-1])
        spin = turn.inv().apply(plate.angular_velocity(run.u, run.v)[-1])
        np.testing.assert_allclose(spin, exact[4:], rtol=0, atol=tolerance)
        assert (turn.inv() * Rotation.from_quat(exact[:4])).magnitude() < tolerance
    if not others:
        lanes = problem.ensemble(h=1e-3, u0=[problem.u0] * 3)
        assert not lanes.notes
        np.testing.assert_allclose(lanes.u[1, -1], run.u[-1], rtol=0, atol=1e-12)


def test_a_plate_without_thickness_is_too_thin_for_some_joints():
    """A hinge beside the plate pulls at the vector across it, which has no mass. The constraints are independent."""

    def door(largest):
        scene = Scene(3)
        scene.body(1.0, (0.3, 0.5, largest), (0.5, 0.0, 0.0)).revolute(None, (0.0, 0.0, 0.1), (0.0, 1.0, 0.0))
        return scene.problem((0.0, 1.0))

    with pytest.raises(
        ValueError, match=r"reactions of revolute joint 0 \(body 0, ground\) cannot be computed, because"
    ):
        door(0.8)
    assert door(0.8 * (1 - 1e-6)).integrate(h=1e-3).success


def in_plane(inertia=1.0, **options):
    return Scene(2).body(1.0, inertia, (0.0, 0.0), **options)


def in_space(inertia=(1.0, 1.0, 1.5), **options):
    return Scene(3).body(1.0, inertia, (0.0, 0.0, 0.0), **options)


def adding(effect, points_of):
    scene = Scene(2)
    scene.add(effect, points_of(scene.body(1.0, 1.0, (0.0, 0.0))))


def beside_a_rolling_mass():
    scene = Scene(2)
    scene.body(1.0, 1.0, (0.0, 0.0))
    scene.mass(1.0, (3.0, 0.0), inertia=0.1)
    scene.problem((0.0, 1.0))


def joined_to_itself(joint, *arguments):
    body = in_plane()
    getattr(body, joint)(body, *arguments)


BAD_VALUES = {
    "inertia of a body in the plane must be a positive number": lambda: in_plane((1.0, 2.0, 3.0)),
    "positive principal moments, each at most the sum of the others": lambda: in_space((1.0, 1.0, 2.00001)),
    "positive principal moments": lambda: in_space((0.0, 0.0, 0.0)),
    "positive principal moments, each": lambda: in_space((0.0, 1.0, 1.0)),
    "inertia of a body must have positive": lambda: in_space((1.0, 1.0, -1.0)),
    "3 principal moments or a symmetric 3 x 3 matrix": lambda: in_space(1.0),
    "rotation of a body in 2 dimensions must be an angle in rad": lambda: in_plane(rotation=(0.0, 0.0, 0.0, 1.0)),
    "rotation of a body in 3 dimensions must be a quat": lambda: in_space(rotation=[[2, 0, 0], [0, 2, 0], [0, 0, 2]]),
    "angular_velocity of a body in 2 dimensions must be a number": lambda: in_plane(angular_velocity=(1.0, 0.0, 0.0)),
    "a rigid body needs a scene of 2 or 3 dimensions": lambda: Scene(1).body(1.0, 1.0, 0.0),
    "periodic box has no rigid bodies": lambda: Scene(2, box=(1.0, 1.0)).body(1.0, 1.0, (0.0, 0.0)),
    "place must have 2 finite components": lambda: in_plane().point((1.0, 2.0, 3.0)),
    "direction must not be zero": lambda: in_plane().prismatic(None, (0.0, 0.0), (0.0, 0.0)),
    "other must be another body, or None for the ground": lambda: joined_to_itself("revolute", (1.0, 0.0)),
    "other must be another body, or None": lambda: joined_to_itself("friction", 1.0),
    "axis of a revolute joint is for scenes of 3 dimensions": lambda: in_plane().revolute(
        None, (1.0, 0.0), (0.0, 0.0, 1.0)
    ),
    "rotation of a body in 2 dimensions": lambda: in_plane(rotation=Rotation.identity()),
    "rotation of a body in 3 dimensions": lambda: in_space(rotation=(np.nan, 0.0, 0.0, 1.0)),
    "velocity of a body must be 2 numbers": lambda: in_plane(velocity=(1.0, 0.0, 0.0)),
    "position must have 2 finite components": lambda: in_plane().revolute(None, (0.0, 0.0, 0.0)),
    "position must have 2 finite components, not": lambda: in_plane().revolute(None, np.zeros((2, 2))),
    "direction must have 2 finite components": lambda: in_plane().prismatic(None, (0.0, 0.0), (0.0, np.nan)),
    "axis must have 3 finite components": lambda: in_space().revolute(None, (0.0, 0.0, 0.0), (0.0, 1.0)),
    "cannot have masses with an inertia: add them with scene.body": beside_a_rolling_mass,
    "Gravity acts on masses, and a point of a rigid body has none": lambda: adding(
        effects.Gravity((0.0, -G)), lambda body: body.point((1.0, 0.0))
    ),
}
BAD_TYPES = {
    "take a Torque": lambda: effects.Motor(3.0),
    "torque of Motor must be compiled": lambda: adding(effects.Motor(lambda t: t), lambda body: body.axes),
    "torque of Motor must return a number in the plane": lambda: adding(
        effects.Motor(rising_about_an_axis), lambda body: body.axes
    ),
}
test_bad_bodies = refusals(BAD_VALUES, BAD_TYPES)
