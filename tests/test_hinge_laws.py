"""Laws of links for the angle between rigid bodies."""

import numpy as np
import pytest

from eig3.effects import (
    BoucWen,
    Breaking,
    ElasticPlastic,
    Gap,
    LeadRubber,
    LinearDamper,
    LinearSpring,
    MassImpact,
)
from eig3.scene import Scene

from .conftest import refusals

INERTIA = 0.3 + 2 * 0.5**2  # about the pin


def oscillator(inertia, laws, speed, end):
    """The problem of the angle alone, as a mass on a line."""
    scene = Scene(1)
    ground, point = scene.fixed([0.0]), scene.mass(inertia, [0.0], velocity=[speed])
    for law in laws:
        scene.add(law, ground, point)
    return scene.problem((0, end))


def flap(*laws, dimension=2, speed=-3.0):
    """A body that turns about a pin of the ground, and its problem."""
    scene = Scene(dimension)
    more = [0.0] * (dimension - 2)
    given = [0.5, 0.0, *more], None
    motion = {"velocity": [0.0, 0.5 * speed, *more]}
    if dimension == 2:
        body, axis = scene.body(2.0, 0.3, *given, angular_velocity=speed, **motion), None
    else:
        axis = [0.0, 0.0, 1.0]
        body = scene.body(2.0, [0.3, 0.3, 0.3], *given, angular_velocity=[0.0, 0.0, speed], **motion)
    body.revolute(None, np.zeros(dimension), axis)
    for law in laws:
        body.torsional_spring(None, law, axis)
    return body, scene.problem((0, 3), work=True)


@pytest.mark.parametrize(
    ("dimension", "laws"),
    [
        (2, (ElasticPlastic(20.0, 5.0, 0.1, isotropic=0.5), Gap(50.0, 0.1))),
        (3, (Breaking(BoucWen(20.0, 0.2, 0.1), max_energy=2.0), LinearSpring(9.0), LinearDamper(0.1))),
    ],
)
def test_a_body_on_a_hinge_moves_as_one_degree_of_freedom(dimension, laws):
    """The angle is that of a mass with the same links; so are the states, and the times of the events."""
    body, problem = flap(*laws, dimension=dimension)
    options = {"rtol": 1e-10, "t_eval": np.linspace(0, 3, 13), "h_max": 0.02}
    run = problem.integrate(**options)
    alone = oscillator(INERTIA, laws, -3.0, 3).integrate(**options)
    turned = body.rotation(run.u)
    turned = turned if dimension == 2 else 2 * np.arctan2(turned[:, 2], turned[:, 3])
    np.testing.assert_allclose(turned, alone.u[:, 0], rtol=0, atol=1e-7)
    assert run.drift["energy"] < 1e-8
    assert run.events.keys() == alone.events.keys()
    for name, found in alone.events.items():
        assert len(found)
        np.testing.assert_allclose(run.events[name].t, found.t, rtol=0, atol=1e-6)
    for name in run.z.keys() & alone.z.keys():
        np.testing.assert_allclose(run.z[name], alone.z[name], rtol=0, atol=1e-6)


def pair():
    """Two bodies on one pin with a plastic hinge between them."""
    scene = Scene(2)
    one, other = scene.body(1.0, 0.4, [0.0, 0.0], angular_velocity=4.0), scene.body(2.0, 0.6, [0.0, 0.0])
    one.revolute(None, [0.0, 0.0])
    other.revolute(None, [0.0, 0.0])
    one.torsional_spring(other, ElasticPlastic(20.0, 1.5, 0.05))
    return scene.problem((0, 2)), one, other


def test_a_plastic_hinge_between_two_bodies():
    """The relative angle is an oscillator with the reduced inertia; EIG-3 keeps its order; members are single runs."""
    problem, one, other = pair()
    reduced = oscillator(0.4 * 0.6, [ElasticPlastic(20.0, 1.5, 0.05)], 4.0, 2)
    true = reduced.integrate(rtol=1e-11).u[-1, 0]
    errors = []
    for h in (8e-3, 8e-3 / 16):
        u = problem.integrate(h=h, save_every=None).u[-1]
        spin = np.angle(np.exp(1j * (one.rotation(u) - other.rotation(u) - true)))
        errors.append(abs(spin))
    assert errors[0] < 1e-3
    assert errors[0] / errors[1] > 16 ** (2 - 0.3)
    v0 = problem.v0 * np.linspace(0.2, 1.2, 6)[:, None]
    members = problem.ensemble(v0=v0, h=2e-3, save_every=None)
    for k in (0, 5):
        single = problem.with_(v0=v0[k]).integrate(h=2e-3, save_every=None)
        np.testing.assert_allclose(members.u[k, -1], single.u[-1], rtol=0, atol=1e-11)
        name = "elastic plastic 0"
        np.testing.assert_allclose(members[k].events[name].t, single.events[name].t, rtol=0, atol=1e-10)


test_what_is_wrong_is_refused_in_a_sentence = refusals(
    {
        "law of HingeLaw must act along one line, and LeadRubber does not": lambda: flap(LeadRubber(1.0, 1.0, 0.1)),
        "Breaking is broken at the start": lambda: flap(Breaking(LinearSpring(9.0, 0.5), min_stretch=-0.4)),
    },
    {
        "law of HingeLaw must be a link of eig3.effects, not 3.0": lambda: flap(3.0),
        "MassImpact changes velocities at events, which a hinge does not support": lambda: flap(MassImpact(0.3)),
    },
)
