"""Laws of links for the angle between rigid bodies."""

import math
from dataclasses import dataclass

import numpy as np

import eig3
from eig3.effects import (
    BoucWen,
    Breaking,
    ElasticPlastic,
    Gap,
    LeadRubber,
    LinearDamper,
    LinearSpring,
    Link,
    MassImpact,
    Multilinear,
)
from eig3.scene import Scene

from .conftest import refusals

MOMENTS = Multilinear([0.1, 0.2, 0.5], [2.0, 3.0, 4.0])
INERTIA = 0.3 + 2 * 0.5**2  # about the pin


def oscillator(inertia, laws, speed, end):
    """The problem of the angle alone, as a mass on a line."""
    scene = Scene(1)
    ground, point = scene.fixed([0.0]), scene.mass(inertia, [0.0], velocity=[speed])
    for law in laws:
        scene.add(law, ground, point)
    return scene.problem((0, end))


def flap(*laws):
    """A body in space that turns about a pin of the ground, and its problem."""
    scene, axis = Scene(3), [0.0, 0.0, 1.0]
    motion = {"velocity": [0.0, -1.5, 0.0], "angular_velocity": [0.0, 0.0, -3.0]}
    body = scene.body(2.0, [0.3, 0.3, 0.3], [0.5, 0.0, 0.0], **motion)
    body.revolute(None, np.zeros(3), axis)
    for law in laws:
        body.torsional_spring(None, law, axis)
    return body, scene.problem((0, 3), work=True)


def check_one_degree_of_freedom(problem, angle, inertia, laws, speed):
    """The angle is that of a mass with the same links; so are the states, and the times of the events."""
    options = {"rtol": 1e-10, "method": "rk8", "t_eval": np.linspace(*problem.t_span, 13), "h_max": 0.02}
    run = problem.integrate(**options)
    alone = oscillator(inertia, laws, speed, problem.t_span[1]).integrate(**options)
    np.testing.assert_allclose(np.exp(1j * angle(run.u)), np.exp(1j * alone.u[:, 0]), rtol=0, atol=1e-7)
    assert run.drift["energy"] < 1e-8
    assert run.events.keys() == alone.events.keys()
    for name, found in alone.events.items():
        assert len(found)
        np.testing.assert_allclose(run.events[name].t, found.t, rtol=0, atol=1e-6)
    for name in run.z.keys() & alone.z.keys():
        np.testing.assert_allclose(run.z[name], alone.z[name], rtol=0, atol=1e-6)


def test_a_body_on_a_hinge_moves_as_one_degree_of_freedom():
    """Also with a law whose parameter has the name of a function, as the forces of Iwan's."""
    laws = Breaking(BoucWen(20.0, 0.2, 0.1), max_energy=0.8), MOMENTS, LinearSpring(9.0), LinearDamper(0.1)
    body, problem = flap(*laws)

    def angle(u):
        turned = body.rotation(u)
        return 2 * np.arctan2(turned[:, 2], turned[:, 3])

    check_one_degree_of_freedom(problem, angle, INERTIA, laws, -3.0)


def test_a_plastic_hinge_and_a_gap_between_two_bodies():
    """The relative angle is an oscillator with the reduced inertia; EIG-3 keeps its order; members are single runs."""
    laws = ElasticPlastic(20.0, 1.5, 0.05, isotropic=0.5), Gap(50.0, 0.1)
    scene = Scene(2)
    one, other = scene.body(1.0, 0.4, [0.0, 0.0], angular_velocity=-4.0), scene.body(2.0, 0.6, [0.0, 0.0])
    one.revolute(None, [0.0, 0.0])
    other.revolute(None, [0.0, 0.0])
    for law in laws:
        one.torsional_spring(other, law)
    problem = scene.problem((0, 2), work=True)

    def angle(u):
        return one.rotation(u) - other.rotation(u)

    check_one_degree_of_freedom(problem, angle, 0.4 * 0.6, laws, -4.0)
    true = oscillator(0.4 * 0.6, laws, -4.0, 2).integrate(rtol=1e-11, method="rk8").u[-1, 0]
    errors = []
    for h in (4e-3, 4e-3 / 16):
        u = problem.integrate(h=h, save_every=None).u[-1]
        errors.append(abs(np.angle(np.exp(1j * (angle(u) - true)))))
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] > 16 ** (2 - 0.3)
    v0 = problem.v0 * np.linspace(0.2, 1.2, 6)[:, None]
    members = problem.ensemble(v0=v0, h=2e-3, save_every=None)
    for k in (0, 5):
        single = problem.with_(v0=v0[k]).integrate(h=2e-3, save_every=None)
        np.testing.assert_allclose(members.u[k, -1], single.u[-1], rtol=0, atol=1e-11)
        name = "elastic plastic 0"
        np.testing.assert_allclose(members[k].events[name].t, single.events[name].t, rtol=0, atol=1e-10)


@dataclass(frozen=True, eq=False)
class SineSpring(Link):
    stiffness: float

    @staticmethod
    @eig3.jit
    def tension(r, stiffness):
        return stiffness * math.sin(r)


def test_a_note_on_functions_of_the_c_library_is_for_functions_that_the_user_wrote():
    """A hinge calls atan2, and the user of a scene writes no rhs that could call something else."""
    scene = Scene(1)
    scene.add(SineSpring(2.0), scene.fixed(0.0), scene.mass(1.0, 0.5))
    (note,) = scene.problem((0, 1)).ensemble(u0=np.ones((2, 1)), h=0.01).notes
    assert note.startswith("The force of the problem is not vectorised: it calls sin of the C library")
    assert note.endswith("in functions that you wrote, use the functions of eig3.math.")


@dataclass(frozen=True, eq=False)
class SpringAboutAngle(Link):
    stiffness: float
    angle: float

    @staticmethod
    @eig3.jit
    def tension(r, stiffness, angle):
        return stiffness * (r - angle)


def test_a_rest_angle_may_be_negative():
    """The angle swings about the rest angle, cos(omega t) - 1 times its size, on either side.

    A field of a link may have the name angle.
    """
    scene, flats = Scene(2), {-0.5: LinearSpring(0.2, -0.5), 0.5: SpringAboutAngle(0.2, 0.5)}
    for rest, law in flats.items():
        flats[rest] = scene.body(2.0, 0.3, [0.5, 0.0])
        flats[rest].revolute(None, [0.0, 0.0])
        flats[rest].torsional_spring(None, law)
    run = scene.problem((0, 3)).integrate(rtol=1e-10)
    for rest, flat in flats.items():
        expected = rest * (1 - np.cos(np.sqrt(0.2 / INERTIA) * run.t))
        np.testing.assert_allclose(flat.rotation(run.u), expected, rtol=0, atol=1e-8)


@eig3.jit
def cogging(t, angle, rate):
    return -0.05 * np.sin(2 * angle)


@dataclass(frozen=True, eq=False)
class SpringOfTurns(Link):
    stiffness: float

    @staticmethod
    @eig3.jit
    def tension(state, stiffness):
        return stiffness * state

    @staticmethod
    @eig3.jit
    def state_rate(rate):
        return rate


def test_a_torque_that_jumps_at_half_a_turn_has_a_note():
    """All bodies turn further. A torque with the period of the angle does not jump; nor does one of whole turns."""
    scene = Scene(2)
    bodies = [scene.body(1.0, 0.3, [0.0, 0.0], angular_velocity=8.0) for _ in range(3)]
    bodies[0].torsional_spring(None, LinearSpring(0.5))
    bodies[1].motor(None, cogging)
    bodies[2].torsional_spring(None, SpringOfTurns(0.5))
    problem = scene.problem((0, 3))
    run = problem.integrate(rtol=1e-9)
    turned = [np.unwrap(body.rotation(run.u)) for body in bodies]
    assert min(angle.max() for angle in turned) > np.pi
    omega = np.sqrt(0.5 / 0.3)
    np.testing.assert_allclose(turned[2], 8.0 / omega * np.sin(omega * run.t), rtol=0, atol=1e-7)  # 100 rtol
    first = run.t[np.argmax(turned[0] > np.pi) - 1]
    (note,) = run.notes
    assert note.startswith(f"The angle of LinearSpring 0 passes half a turn after t = {first:.4g}. ")
    slow = problem.with_(v0=0.3 * problem.v0)
    assert slow.integrate(rtol=1e-6).notes == ()
    quarter = np.pi / omega / 2  # from the largest angle to the least, which differ by more than half a turn
    assert slow.with_(t_span=(0, 4)).integrate(rtol=1e-6, t_eval=[0, quarter, 3 * quarter]).notes == ()
    members = problem.ensemble(v0=problem.v0 * np.array([[0.3], [1.0]]), rtol=1e-6, save_every=1)
    (noted,) = (note for note in members.notes if "half a turn" in note)
    assert "LinearSpring 0" in noted
    assert noted.endswith("This is member 1.")


test_what_is_wrong_is_refused_in_a_sentence = refusals(
    {
        "law of HingeLawInSpace must act along one line, and LeadRubber does not": lambda: flap(
            LeadRubber(1.0, 1.0, 0.1)
        ),
        "rest_length of LinearSpring must be between -pi and pi in a hinge": lambda: flap(LinearSpring(9.0, -90.0)),
        "Breaking is broken at the start": lambda: flap(Breaking(LinearSpring(9.0, 0.5), min_stretch=-0.4)),
    },
    {
        "law of HingeLawInSpace must be a link of eig3.effects, not 3.0": lambda: flap(3.0),
        "MassImpact changes velocities at events, which a hinge does not support": lambda: flap(MassImpact(0.3)),
    },
)
