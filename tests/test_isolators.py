"""Isolators across two directions of a structure, with a circular yield surface."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import eig3
from eig3.effects import BoucWen, FrictionPendulum, LeadRubber
from eig3.scene import Scene
from eig3.structures import Frame, Section, base_shear, link_ductility, link_forces, link_stretches

from .conftest import refusals

G = 9.81  # m/s^2
Y = 0.02
BEARING = LeadRubber(stiffness=3.0, strength=2.0, yield_length=Y)
HEAVY = [1e12, 1e12], None, 1e12 * np.eye(2)  # moves on a circle with omega = 1, whatever the bearing does


def plane(law, v0=(1.0, 0.0), stiffness=0.0, span=(0, 6), **options):
    """A mass in the plane on a bearing, and on a spring with the same stiffness in all directions."""
    K = stiffness * np.eye(2) if stiffness else None
    return eig3.linear([1.0, 1.0], None, K, links=[(law, None, (0, 1))], v0=v0, t_span=span, **options)


@pytest.mark.parametrize("sharpness", [1.0, 2.0, 4.5])
def test_on_a_circle_the_yield_force_is_constant_and_lags(sharpness):
    """In the steady motion z turns with the velocity, and z' = r' - (e . r') e: so sin(lag) = y / radius."""
    law, radius = LeadRubber(3.0, 2.0, Y, sharpness), 0.1
    problem = eig3.linear(*HEAVY, links=[(law, None, (0, 1))], u0=[radius, 0], v0=[0, radius], t_span=(0, 12))
    outputs = {"forces": link_forces(problem), "stretches": link_stretches(problem)}
    outputs["ductility"] = link_ductility(problem)  # one value for both directions
    run = problem.integrate(rtol=1e-10, t_eval=np.linspace(9, 12, 7), outputs=outputs)
    np.testing.assert_array_equal(run.outputs["stretches"], run.u)
    np.testing.assert_allclose(run.outputs["ductility"], np.full((7, 1), radius / Y), rtol=1e-8)
    lead = run.outputs["forces"] - 3.0 * run.u
    np.testing.assert_allclose(np.linalg.norm(lead, axis=1), 2.0, rtol=1e-8)
    lag = run.t + np.pi / 2 - np.arctan2(lead[:, 1], lead[:, 0])
    np.testing.assert_allclose(np.sin(lag), Y / radius, rtol=0, atol=1e-8)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
@pytest.mark.parametrize("sharpness", [1.0, 3.0])
def test_along_one_line_it_is_bouc_wen(angle, sharpness):
    """Also oblique to the axes; the difference is round-off, which grows in 600 steps."""
    along = np.array([np.cos(angle), np.sin(angle)])
    problem = plane(LeadRubber(3.0, 2.0, Y, sharpness), v0=along)
    alone = eig3.linear(
        [1.0], links=[(BoucWen(103.0, Y, 3.0 / 103.0, sharpness), None, 0)], v0=[1.0], t_span=problem.t_span
    )
    run, other = (x.integrate(h=0.01, method="rk4") for x in (problem, alone))
    np.testing.assert_allclose(run.u, other.u * along, rtol=0, atol=1e-12)
    np.testing.assert_allclose(run.z["lead rubber"], other.z["bouc wen"][:, None] * along, rtol=0, atol=1e-12)


def test_a_plane_frame_takes_one_direction():
    """The other direction joins the ground to itself."""
    links = [(BEARING, (None, None), (0, None))], [(BoucWen(103.0, Y, 3.0 / 103.0, 2.0), None, 0)]
    runs = [eig3.linear([1.0], links=each, v0=[1.0], t_span=(0, 6)).integrate(h=0.01, method="rk4") for each in links]
    np.testing.assert_allclose(runs[0].u, runs[1].u, rtol=0, atol=1e-12)


def test_a_turned_motion_is_the_turned_result():
    c, s = np.cos(0.6), np.sin(0.6)
    turned = np.array([[c, s], [-s, c]])
    T = np.linspace(0, 6, 200)
    force = np.column_stack([np.sin(3 * T), np.cos(5 * T)])
    v0 = np.array([0.6, -0.3])
    one, other = (
        plane(BEARING, v0=v0 @ a, force=(T, force @ a), stiffness=2.0).integrate(h=0.01, method="rk4")
        for a in (np.eye(2), turned)
    )
    np.testing.assert_allclose(one.u @ turned, other.u, rtol=0, atol=1e-12)


@settings(max_examples=10, deadline=None)
@given(friction=st.floats(0.01, 0.2), omega=st.floats(0.5, 8), strength=st.floats(1, 10), angle=st.floats(0, 2 * np.pi))
def test_a_pendulum_dissipates_and_balances(friction, omega, strength, angle):
    """The absorbed energy, less the energy of the slope and of the elastic part, never falls."""
    law = FrictionPendulum(friction, radius=2.0, weight=G, yield_length=0.01)
    T = np.linspace(0, 6, 600)
    force = strength * np.column_stack([np.sin(omega * T), np.cos(1.3 * omega * T + angle)])
    run = plane(law, force=(T, force), work=True).integrate(rtol=1e-9)
    z = run.z["friction pendulum"]
    assert np.linalg.norm(z, axis=1).max() < 0.01 * (1 + 1e-6)
    stored = G / 2.0 * (run.u**2).sum(axis=1) / 2 + friction * G / 0.01 * (z**2).sum(axis=1) / 2
    lost = run.z["absorbed"] - stored
    most = np.abs(run.z["work"]).max()
    assert np.diff(lost).min() > -1e-7 * most
    assert run.drift["energy"] < 1e-7 * most


#: Displacements at t = 1, ..., 5 that OpenSees 3.7.1 prints for a mass of 1 kg on elastomericBearingBoucWen with the
#: shear stiffness 103, the strength 2, alpha1 = 3 / 103, eta = 2, beta = gamma = 0.5, under 6 N cos(5.6 t) and
#: 4 N cos(4.1 t), by Newmark 0.5 0.25 with the steps 2e-4 and 5e-5.
OF_OPENSEES = np.array([
    [[-0.3120168729, -0.1651822731], [-0.2072168632, 0.0746470509], [0.0453085170, -0.2789566126],
     [0.2020068147, 0.1580953610], [0.1649228863, 0.2207735272]],
    [[-0.3118406032, -0.1650783691], [-0.2072588731, 0.0745835449], [0.0453128006, -0.2790534929],
     [0.2019966402, 0.1580920543], [0.1649500470, 0.2208387716]],
])  # fmt: skip


def test_a_lead_rubber_bearing_is_the_bearing_of_opensees():
    """OpenSees starts without an acceleration, so its error is of the first order: extrapolated, some 1e-7 remain."""
    problem = plane(BEARING, v0=0.0, force=two_forces, span=(0, 5))
    run = problem.integrate(rtol=1e-9, t_eval=[1, 2, 3, 4, 5])
    coarse, fine = OF_OPENSEES
    np.testing.assert_allclose(run.u, fine + (fine - coarse) / 3, rtol=0, atol=1e-6)


@eig3.jit
def two_forces(t, u, v, p, out):
    out[0] += 6 * np.cos(5.6 * t)
    out[1] += 4 * np.cos(4.1 * t)


def test_eig3_is_of_the_second_order():
    problem = plane(BEARING, v0=[1.0, 0.4], stiffness=5.0, damping=eig3.Rayleigh(0.05, 2.0, 20.0))
    true = problem.integrate(rtol=1e-12, method="rk8").u[-1]
    errors = [np.abs(problem.integrate(h=h).u[-1] - true).max() for h in (4e-3, 4e-3 / 16)]
    assert errors[0] / errors[1] > 16 ** (2 - 0.2)  # the mean over four halvings, because unloading begins in steps


def test_the_period_of_a_pendulum():
    """A mass swings with 2 pi sqrt(R / g); Coulomb friction leaves the period, and takes 2 mu R each half."""
    radius, start, mu, y = 2.0, 0.6, 0.02, 1e-3
    swing = eig3.linear(
        [500.0, 500.0],
        links=[(FrictionPendulum(mu, radius, 500 * G, y, sharpness=8.0), None, (0, 1))],
        u0=np.array([0.6, 0.8]) * start,
        t_span=(0, 6),
    ).integrate(rtol=1e-9, events={"turn": eig3.Event(turning)})
    turns = swing.events["turn"]
    along = turns.u @ [0.6, 0.8]
    assert len(along) >= 3
    # friction turns over a length of 2 y after each turn of the motion, where the mass is for a time of sqrt(y / start)
    np.testing.assert_allclose(np.diff(turns.t), np.pi * np.sqrt(radius / G), rtol=0, atol=0.01)
    np.testing.assert_allclose(-np.diff(np.abs(along)), 2 * mu * radius, rtol=0, atol=0.3 * y)


turning = eig3.jit(lambda t, u, v, z, p: 0.6 * v[0] + 0.8 * v[1])


def test_bearings_below_a_frame_in_space():
    """By the equation of motion, M a + M r g = -base shear; each bearing has two forces and two states."""
    frame = Frame(3)
    section = Section(E=3e10, A=0.09, I=6.75e-4, J=1e-3, density=2500.0)
    for k, (x, y) in enumerate([(0, 0), (4, 0), (0, 4), (4, 4)]):
        for name, height in (("base", 0.0), ("top", 3.0)):
            frame.node(f"{name}{k}", x, y, height)
            frame.mass(f"{name}{k}", 1000.0, 100.0)
        frame.member(f"base{k}", f"top{k}", section)
        frame.support(f"base{k}", "uz rx ry rz")
    for a, b in ((0, 1), (1, 3), (3, 2), (2, 0)):
        frame.member(f"top{a}", f"top{b}", section)
    law = FrictionPendulum(0.05, 1.5, 2000 * G)
    T = np.linspace(0, 5, 501)
    ends = [(f"base{k}.ux", f"base{k}.uy") for k in range(4)]
    problem = frame.problem((0, 1), ground=(T, 4 * np.sin(4 * T)), links=[(law, None, ends)])
    assert problem.h is None
    outputs = {"forces": link_forces(problem), "shear": base_shear(problem)}
    run = problem.integrate(h=1e-3, outputs=outputs)
    assert run.z["friction pendulum"].shape[1] == run.outputs["forces"].shape[1] == 8
    along = np.array([name.endswith(".ux") for name in problem.names])
    inertia = (run.a + np.multiply.outer(np.interp(run.t, T, 4 * np.sin(4 * T)), along)) @ (problem.params.m * along)
    np.testing.assert_allclose(run.outputs["shear"], -inertia, rtol=0, atol=1e-7 * np.abs(inertia).max())
    assert np.abs(run.u[:, problem.names.index("base0.ux")]).max() > 0.01


def between(*ends):
    return lambda: eig3.linear([1.0, 1.0], links=[(BEARING, *ends)], t_span=(0, 1))


PAIRS = r"links\[0\] acts across 2 directions: give pairs of degrees of freedom for its ends, .* one direction alone"
test_what_is_wrong_is_refused_in_a_sentence = refusals(
    {
        "yield_length of LeadRubber must be positive": lambda: plane(LeadRubber(1.0, 1.0, 0.0)),
        "radius of FrictionPendulum must be positive": lambda: plane(FrictionPendulum(0.1, 0.0, 1.0)),
        PAIRS: between(None, 0),
        PAIRS + ".*": between(None, (0, 1, 0)),
        r"links\[0\] must join two different degrees of freedom": between((0, None), (0, 1)),
    },
    {
        "LeadRubber acts across two directions of a structure: give it to": lambda: Scene(dimension=2).add(
            BEARING, None, None
        )
    },
)
