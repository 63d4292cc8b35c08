"""The mechanisms of the library against what is known of them exactly."""

import importlib

import numpy as np
import pytest
from scipy.optimize import brentq

from eig3 import problems
from eig3.scene import Points

# the names of the modules in the package are those of the functions
double_wishbone, ragdoll, slider_crank, spinning_top = (
    importlib.import_module(f"eig3.problems.{name}")
    for name in ("double_wishbone", "ragdoll", "slider_crank", "spinning_top")
)


def test_a_slider_crank_keeps_its_energy():
    """Its kinetic energy is a function of the angle and the spin of the crank, which gives the spin at each angle."""
    m = slider_crank
    run = problems.slider_crank().integrate(rtol=1e-10, method="rk8", t_eval=np.linspace(0, 0.5, 200))
    _, crank, _, piston = m.engine()
    angle = crank.rotation(run.u)
    pin = m.CRANK * np.stack([np.cos(angle), np.sin(angle)])
    lean = np.arcsin(pin[1] / m.ROD)
    x = pin[0] + m.ROD * np.cos(lean)
    np.testing.assert_allclose(piston.positions(run.u), np.stack([x, 0 * x], axis=1), rtol=0, atol=1e-10)
    turn = -pin[0] / (m.ROD * np.cos(lean))  # of the rod, for a spin of 1 rad/s
    slide = -pin[1] * (1 - turn)
    middle = np.stack([(-pin[1] + slide) / 2, pin[0] / 2])
    inertia = m.FLYWHEEL + m.PISTON * slide**2
    inertia += m.ROD_MASS * (np.sum(middle**2, axis=0) + m.ROD**2 / 12 * turn**2)
    energy = inertia * crank.angular_velocity(run.u, run.v) ** 2
    np.testing.assert_allclose(energy, energy[0], rtol=1e-8)


def test_a_top_nods_between_two_angles():
    """Goldstein: released at rest, u = cos(tilt) moves between its start and a root of (1 - u^2) b = a^2 (u0 - u)."""
    m, spin, tilt = spinning_top, 150.0, 0.5
    run = problems.spinning_top(spin, tilt).integrate(h=2e-5, method="rk8")
    _, body = m.top(spin, tilt)
    u = body.centre.positions(run.u)[:, 2] / m.HEIGHT
    about_support = m.ACROSS + m.MASS * m.HEIGHT**2
    a, b = m.ALONG * spin / about_support, 2 * m.MASS * m.G * m.HEIGHT / about_support
    lowest = brentq(lambda u: (1 - u * u) * b - a * a * (np.cos(tilt) - u), 0.0, np.cos(tilt))
    assert u.max() == pytest.approx(np.cos(tilt), abs=1e-9)
    assert u.min() == pytest.approx(lowest, abs=1e-7)  # the states are 2e-5 s apart
    assert run.drift["energy"] < 1e-9


def test_the_wheel_of_a_wishbone_follows_its_four_bar_linkage():
    """With the tie rod in the lower arm it does not steer, and the arms and the upright are a linkage in a plane."""
    m = double_wishbone
    run = problems.double_wishbone(tie=0.0).integrate(h=2e-4, method="rk4", save_every=50)
    _, bodies = m.suspension(tie=0.0)
    camber, toe = m.wheel_angles(bodies, run.u)
    np.testing.assert_allclose(toe, 0.0, atol=1e-11)
    arms = [(m.LOWER[1:], m.LOWER_BALL[1:]), (m.UPPER[1:], m.UPPER_BALL[1:])]
    lengths = [np.linalg.norm(ball - hinge) for hinge, ball in arms]
    rise = bodies["lower"].centre.positions(run.u)[:, 2] - bodies["chassis"].centre.positions(run.u)[:, 2]
    for k in range(0, len(run.t), 10):
        z = 2 * (rise[k] + m.CHASSIS[2] - m.LOWER[2])  # of the lower ball above its hinge
        low = m.LOWER[1:] + np.array([np.sqrt(lengths[0] ** 2 - z * z), z])
        way = m.UPPER_BALL[1:] - m.LOWER_BALL[1:]

        def apart(angle, low=low, way=way):
            turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]) @ way
            return np.linalg.norm(low + turned - m.UPPER[1:]) - lengths[1]

        assert camber[k] == pytest.approx(-brentq(apart, -0.1, 0.1, xtol=1e-13), abs=1e-9)
    assert np.abs(camber).max() > 3e-3
    assert (
        np.abs(bodies["chassis"].centre.velocities(run.v)[: int(m.BUMP[1] / 0.01)]).max() < 1e-4
    )  # at rest before the bump


def test_a_ragdoll_comes_to_rest_on_the_stairs():
    run = problems.ragdoll(t_end=4.0).integrate(h=2e-4, save_every=100)
    scene, bodies, ends = ragdoll.person()
    x, _, z = Points(scene, ends).positions(run.u).transpose(3, 0, 1, 2)
    tread = -ragdoll.RISE * np.clip(np.floor(x / ragdoll.RUN) + 1, 0, ragdoll.STEPS)
    assert (z > tread).all()  # of the centres of the spheres: none goes through the stairs
    assert z[-1].max() < -0.3
    speeds = np.linalg.norm(Points(scene, ends).velocities(run.v), axis=-1)
    assert np.median(speeds[-1]) < 0.1  # it creeps, because friction is smoothed, and a limb may slip
    assert speeds.max() > 5
    for name, limb in ragdoll.LIMBS.items():
        if limb.above:
            joint = ragdoll.START + limb.first
            both = bodies[name].at(joint), bodies[limb.above].at(joint)
            np.testing.assert_allclose(both[0].positions(run.u), both[1].positions(run.u), rtol=0, atol=1e-12)
