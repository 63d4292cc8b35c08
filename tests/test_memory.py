"""Links with memory in scenes: yielding by events, and states that are first-order unknowns."""

from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

import eig3
from eig3.effects import (
    BoucWen,
    BreakingString,
    Cable,
    ElasticPlastic,
    Gap,
    GiuffreMenegottoPinto,
    HarmonicForce,
    LinearDamper,
    LinearSpring,
    Link,
    Maxwell,
    Multilinear,
    RigidStop,
)
from eig3.scene import Scene

from .conftest import refusals


def oscillator(*links, mass=1.0, velocity=0.0, force=0.0, omega=0.0, span=(0, 10), work=False, position=0.0):
    """A mass on a line, joined to the ground by links without a rest length."""
    scene = Scene(dimension=1)
    ground, point = scene.fixed([0.0]), scene.mass(mass, [position], velocity=[velocity])
    for link in links:
        scene.add(link, ground, point)
    if force:
        scene.add(HarmonicForce([force], omega), point)
    return scene.problem(span, work=work)


def test_members_with_memory_are_vectorised():
    """The places of the states are in the code: in p, they could differ between the lanes."""
    places = np.arange(4.0)

    def row(stiffness):
        scene = Scene(dimension=1)
        points = scene.mass(1.0, places)
        scene.add(BoucWen(stiffness, 0.1, 0.1, rest_length=1.0), points[:-1], points[1:])
        scene.add(Maxwell(10.0, 2.0), points[:-1], points[1:])
        scene.add(HarmonicForce([5.0], 4.0), points)
        return scene.problem((0, 10)).with_(v0=[1.0, 0, 0, 0])

    options = {"h": 0.005, "save_every": 1000}
    members = row(4.0).ensemble(params=[row(k).params for k in np.linspace(4, 9, 16)], **options)
    assert members.notes == ()
    for i, k in ((0, 4.0), (15, 9.0)):
        alone = row(k).integrate(**options)
        np.testing.assert_allclose(members.u[i], alone.u, rtol=0, atol=1e-13)  # sums of lanes may round otherwise
        for name, z in alone.z.items():
            np.testing.assert_allclose(members.z[name][i], z, rtol=0, atol=1e-13)


def test_a_standard_linear_solid_moves_as_its_matrix_says():
    problem = oscillator(LinearSpring(4.0), Maxwell(1.5, 1.05), velocity=0.5)
    run = problem.integrate(rtol=1e-10, method="rk8")
    matrix = np.array([[0, 1, 0], [-4, 0, -1.5], [0, 1, -1.5 / 1.05]])
    found = [run.u[-1, 0], run.v[-1, 0], run.z["maxwell"][-1]]
    np.testing.assert_allclose(found, expm(10 * matrix) @ [0, 0.5, 0], rtol=0, atol=1e-9)


def test_the_states_of_links_have_numbers_by_their_effect():
    """The states of one effect are together, in the order in which the links were added."""
    scene = Scene(dimension=1)
    ground, masses = scene.fixed(0.0), scene.mass([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])
    scene.add(Maxwell(2.0, 1.0), masses[:2], masses[1:])
    scene.add(BoucWen(4.0, 0.1, rest_length=1.0), ground, masses[0])
    scene.add(Maxwell(5.0, 3.0), ground, masses[0])
    problem = scene.problem((0, 2)).with_(v0=[0.3, -0.2, 0.1])
    assert problem.z0.keys() == {"maxwell", "bouc wen"}
    run = problem.integrate(h=1e-3, method="rk4")
    x, v, z = run.u, run.v, run.z["maxwell"]
    assert z.shape == (2001, 3)
    assert run.z["bouc wen"].shape == (2001,)
    stretch = np.column_stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 1], x[:, 0]])
    rate = np.gradient(stretch, run.t, axis=0)
    expected = rate - z * [2.0, 2.0, 5.0 / 3.0]
    np.testing.assert_allclose(np.gradient(z, run.t, axis=0)[1:-1], expected[1:-1], rtol=0, atol=1e-5)
    pulls = z * [2.0, 2.0, 5.0] @ np.array([[1, -1, 0], [0, 1, -1], [-1, 0, 0]])
    pulls[:, 0] -= 4.0 * run.z["bouc wen"]
    np.testing.assert_allclose(run.a, pulls / [1.0, 2.0, 3.0], rtol=0, atol=1e-12)
    assert v.shape == x.shape


@pytest.mark.parametrize("steps", [{"h": 1e-4}, {"rtol": 1e-8, "method": "rk8"}])
@pytest.mark.parametrize("members", [1, 16])  # both in loops of 16 lanes
def test_a_link_that_yields_turns_at_an_impact(members, steps):
    """The impact reverses the rate. The mass then has the elastic range before it, yields again, and comes to rest.

    Energies give the place where it rests. EIG-3 has the order 2: its error is some a h^2, with h = 1e-4 and a = 5.
    """
    m, k, yield_force, stop, v0, restitution = 2.0, 400.0, 10.0, -0.3, -3.0, 0.5
    scene = Scene(dimension=1)
    ground, mass = scene.fixed(0.0), scene.mass(m, 1.0, velocity=v0)
    scene.add(ElasticPlastic(k, yield_force, rest_length=1.0), ground, mass)
    scene.add(RigidStop(normal=1.0, offset=1.0 + stop, restitution=restitution), mass)
    problem = scene.problem((0, 0.45))
    starts = np.tile(problem.v0, (members, 1))
    turns = problem.ensemble(v0=starts, **steps).events["elastic plastic 0"]
    at_yield = yield_force / k
    energy = m * v0**2 / 2 - k * at_yield**2 / 2 - yield_force * (-stop - at_yield)
    farthest = 1 + stop + 2 * at_yield + restitution**2 * energy / yield_force
    np.testing.assert_array_equal(np.bincount(turns.member), 2)
    expected = np.repeat([1 + stop, farthest], members)
    np.testing.assert_allclose(np.sort(turns.u[:, 0]), expected, rtol=0, atol=1e-6)


def test_an_elastic_plastic_step_response():
    """A constant force of 0.8 of the yield force: elastic until it yields, a parabola, then elastic again."""
    k, yield_force, force = 100.0, 2.0, 1.6
    problem = oscillator(ElasticPlastic(k, yield_force), force=force, span=(0, 3))
    omega, rest = 10.0, force / k
    at_yield = yield_force / k
    t1 = np.arccos(1 - at_yield / rest) / omega
    v1 = rest * omega * np.sin(omega * t1)
    slowing = yield_force - force
    t2, peak = t1 + v1 / slowing, at_yield + v1**2 / (2 * slowing)

    def exact(t):
        plastic = at_yield + v1 * (t - t1) - slowing * (t - t1) ** 2 / 2
        middle = peak - slowing / k
        elastic, after = rest * (1 - np.cos(omega * t)), middle + slowing / k * np.cos(omega * (t - t2))
        return np.select([t < t1, t < t2], [elastic, plastic], after)

    run = problem.integrate(rtol=1e-9, method="rk8")
    # The force has a kink where the link begins to yield, which the tolerance bounds in one step.
    np.testing.assert_allclose(run.u[:, 0], exact(run.t), rtol=0, atol=1e-8)
    turns = run.events["elastic plastic 0"]
    assert turns.t[0] == pytest.approx(t2, abs=1e-7)
    errors = [np.abs((x := problem.integrate(h=h)).u[:, 0] - exact(x.t)).max() for h in (4e-3, 2.5e-4)]
    assert errors[0] / errors[1] > 16 ** (2 - 0.3)  # four halvings, of the second order


BOTH_HARDENINGS = partial(ElasticPlastic, isotropic=0.5)
SHIFTED = partial(GiuffreMenegottoPinto, a1=0.04, a2=1.5, a3=0.1)


@pytest.mark.parametrize("law", [BOTH_HARDENINGS, SHIFTED])
def test_eig3_keeps_its_order_on_yielding_chains(law):
    """Yielding begins and ends within steps, so single ratios scatter: the mean over five halvings counts."""
    scene = Scene(dimension=1)
    before = ground = scene.fixed([0.0])
    for k in range(3):
        point = scene.mass(1.0, [1.0 + k])
        scene.add(law(40.0, 2.0, 0.05, rest_length=1.0), before, point)
        before = point
    scene.add(LinearDamper(0.3), ground, before)
    scene.add(HarmonicForce([6.0], 5.6), before)
    problem = scene.problem((0, 8))
    true = problem.integrate(rtol=1e-12, method="rk8")
    assert sum(map(len, true.events.values())) > 10
    errors = [np.abs(problem.integrate(h=h).u[-1] - true.u[-1]).max() for h in (2e-2, 2e-2 / 32)]
    assert errors[0] < 0.02 * np.abs(true.u - problem.u0).max()
    assert errors[0] / errors[1] > 32 ** (2 - 0.4)
    close = problem.integrate(rtol=1e-8)
    np.testing.assert_allclose(close.u[-1], true.u[-1], rtol=0, atol=1e-6)


def test_a_backbone_curve_makes_iwans_elements():
    """Beside elements in parallel, and beside a curve of another number of points: each has a loop and states."""
    curve, other = (
        Multilinear([0.05, 0.1, 0.3], [2.0, 3.0, 4.0]),
        Multilinear([0.1, 0.2, 0.3, 0.5], [1.0, 1.5, 1.8, 1.8]),
    )
    elements = ElasticPlastic(20.0, 1.0), ElasticPlastic(15.0, 1.5), LinearSpring(5.0)
    others = ElasticPlastic(5.0, 0.5), ElasticPlastic(2.0, 0.4), ElasticPlastic(3.0, 0.9)
    ends = [
        oscillator(*links, force=6.0, omega=5.6).integrate(rtol=1e-10, method="rk8").u[-1, 0]
        for links in ((curve, other), (*elements, *others))
    ]
    assert ends[0] == pytest.approx(ends[1], abs=1e-7)  # the events are at the same times, with other steps between


def test_bouc_wen_loads_and_unloads_as_its_formula_says():
    """With the sharpness 1, z = y (1 - exp(-x / y)) at first; then it unloads with the slope 1 until z is 0."""
    y = 0.02
    problem = oscillator(BoucWen(3.0, y, 0.1), LinearSpring(1e9), mass=1e9, velocity=0.1, span=(0, np.pi))
    run = problem.integrate(rtol=1e-10, t_eval=np.linspace(0, np.pi, 300))
    x, z = run.u[:, 0], run.z["bouc wen"]
    up = run.t < np.pi / 2
    np.testing.assert_allclose(z[up], y * (1 - np.exp(-x[up] / y)), rtol=0, atol=1e-9)
    peak = y * (1 - np.exp(-0.1 / y))
    down = (run.t > np.pi / 2) & (z > 0)
    np.testing.assert_allclose(z[down], peak + x[down] - 0.1, rtol=0, atol=1e-8)


LOADS = {"force": st.floats(0.5, 20), "omega": st.floats(0.5, 8)}


@settings(max_examples=15, deadline=None)
@given(
    **LOADS, hardening=st.floats(0, 0.9), sharpness=st.floats(1, 4), pinching=st.floats(0.5, 1), y=st.floats(0.01, 0.5)
)
def test_bouc_wen_dissipates_and_is_bounded(force, omega, hardening, sharpness, pinching, y):
    """|z| <= yield_length; the hysteretic part takes energy over each stretch from z = 0 to z = 0, or keeps it."""
    problem = oscillator(BoucWen(40.0, y, hardening, sharpness, pinching), force=force, omega=omega)
    run = problem.integrate(rtol=1e-8, method="rk8", events={"zero": eig3.Event(stretch_of_link)})
    assert np.abs(run.z["bouc wen"]).max() < y * (1 + 1e-6)
    taken = 40.0 * (1 - hardening) * np.concatenate([[0], np.cumsum(_between(run.z["bouc wen"], run.u[:, 0]))])
    at_zeros = np.interp(run.events["zero"].t, run.t, taken)
    # The trapezoidal rule over steps of a tolerance of 1e-8 has errors of some percent of one loop.
    assert (np.diff(at_zeros) > -0.05 * 40.0 * y * y).all()


stretch_of_link = eig3.jit(lambda t, u, v, z, p: z[0] - 1e-9)


def _between(force, x):
    return (force[1:] + force[:-1]) / 2 * np.diff(x)


def structure(links, mass, spring, forces, damper=0.0, **options):
    """Return equal masses, each on a spring and a damper; the forces are samples over 10 s."""
    n, loads = forces.shape[1], (np.linspace(0, 10, len(forces)), forces)
    given = {"links": links, "force": loads, "t_span": (0, 10), "work": True} | options
    return eig3.linear(np.full(n, mass), damper * np.eye(n), spring * np.eye(n), **given)


@settings(max_examples=10, deadline=None)
@given(**LOADS, hardening=st.floats(0, 0.9), isotropic=st.floats(0.01, 1), yield_force=st.floats(0.5, 5))
def test_both_hardenings_dissipate(force, omega, hardening, isotropic, yield_force):
    """What the link absorbs, less its elastic energy and the energy of both hardenings, is the yield force times p."""
    k, law = 40.0, ElasticPlastic(40.0, yield_force, hardening, isotropic=isotropic)
    loads = force * np.cos(omega * np.linspace(0, 10, 501))[:, None]
    problem = structure([(law, None, 0)], 1.0, 0.0, loads, damper=0.5)
    outputs = {"force": eig3.structures.link_forces(problem)}
    run = problem.integrate(rtol=1e-9, outputs=outputs, invariants={})
    tension, plastic = run.outputs["force"][:, 0], run.u[:, 0] - run.outputs["force"][:, 0] / k
    H, p = hardening * k / (1 - hardening), np.concatenate([[0], np.cumsum(np.abs(np.diff(plastic)))])
    stored = tension**2 / (2 * k) + H * ((1 - isotropic) * plastic**2 + isotropic * p**2) / 2
    most = np.abs(run.z["absorbed"]).max()
    # p is a sum over steps, in one of which the motion may turn
    np.testing.assert_allclose(run.z["absorbed"], stored + yield_force * p, rtol=0, atol=1e-3 * most)
    lost = run.z["absorbed"] - tension**2 / (2 * k) - H * (1 - isotropic) * plastic**2 / 2
    assert np.diff(lost).min() > -1e-7 * most


@pytest.mark.parametrize("isotropic", [0.4, 1.0])
def test_cycles_shake_down_to_an_elastic_motion(isotropic):
    """Members in lanes: from turn to turn, the yield force tends to that of elastic cycles as a geometric sequence."""
    k, yield_force, hardening, turns = 40.0, 2.0, 0.2, 6
    law = ElasticPlastic(k, yield_force, hardening, isotropic=isotropic)
    heavy = structure([(law, None, 0)], 1e12, 1e12, np.zeros((2, 1)), t_span=(0, (turns - 0.25) * np.pi))
    peaks, options = np.array([0.08, 0.1, 0.15, 0.2]), {"h": 4e-4, "save_every": None}
    members = heavy.ensemble(v0=peaks[:, None], **options)
    alone = heavy.with_(v0=peaks[-1:]).integrate(**options)
    H = hardening * k / (1 - hardening)
    growth = isotropic * H / (k + H)
    first = (k * peaks - yield_force) / (k + H)
    ways = np.array([first, *(2 * first * (1 - growth) * (1 - 2 * growth) ** n for n in range(turns - 1))])
    np.testing.assert_allclose(members.z["elastic plastic"][:, -1, 1], ways.sum(axis=0), rtol=1e-7)
    plastic = (ways * (-1.0) ** np.arange(turns)[:, None]).sum(axis=0)
    np.testing.assert_allclose(members.z["elastic plastic"][:, -1, 0], plastic, rtol=1e-7)
    np.testing.assert_allclose(alone.z["elastic plastic"][-1], members.z["elastic plastic"][-1, -1], rtol=1e-12)
    assert [len(members[k].events["elastic plastic 0"]) for k in range(4)] == [turns] * 4


def test_the_work_balances_the_energy():
    links = ElasticPlastic(40.0, 2.0, 0.05), BoucWen(20.0, 0.03), Maxwell(10.0, 2.0), LinearSpring(1.0)
    problem = oscillator(*links, force=5.0, omega=4.0, work=True)
    run = problem.integrate(rtol=1e-9)
    assert run.drift["energy"] < 1e-7 * np.abs(run.z["work"]).max()
    fixed = [problem.integrate(h=h).drift["energy"] for h in (0.01, 0.00125)]
    assert fixed[1] < fixed[0] / 20  # three halvings, of the second order with the scatter of the turns


#: Displacements at t = 1, 2, 3, 4, 5 that OpenSees 3.7.1 prints for a zeroLength element between a fixed node and
#: a mass of 1 kg under 6 N cos(5.6 t), by Newmark 0.5 0.25 with the steps 1e-4 and 2e-5 s, extrapolated. It starts
#: without an acceleration, so its error is of the first order: some 1e-7 remain.
OF_OPENSEES = {
    'uniaxialMaterial("ElasticPP", 1, 40.0, 0.05)': (
        [ElasticPlastic(40.0, 2.0)],
        [-0.3783896161, -0.4010459245, -0.2895969994, -0.1636927508, -0.1024529823],
    ),
    'uniaxialMaterial("Steel01", 1, 2.0, 40.0, 0.05)': (
        [ElasticPlastic(40.0, 2.0, 0.05)],
        [-0.4203228922, -0.2548565303, 0.0692167087, 0.2283471450, 0.2419224783],
    ),
    'uniaxialMaterial("Hardening", 1, 40.0, 2.0, 2.0, 0.0)': (
        [ElasticPlastic(40.0, 2.0, 2 / 42, isotropic=1.0)],
        [-0.3739673169, -0.3831571663, -0.2684000346, -0.0861324293, 0.1055810901],
    ),
    'uniaxialMaterial("Hardening", 1, 40.0, 2.0, 3.0, 1.0)': (
        [ElasticPlastic(40.0, 2.0, 4 / 44, isotropic=0.75)],
        [-0.3875425733, -0.3631845163, -0.2267959062, -0.0135242686, 0.2355778112],
    ),
    'uniaxialMaterial("Steel02", 1, 2.0, 40.0, 0.05, 20.0, 0.925, 0.15)': (
        [GiuffreMenegottoPinto(40.0, 2.0, 0.05)],
        [-0.4512589330, -0.2323294264, 0.0972497903, 0.2207261815, 0.2219487807],
    ),
    'uniaxialMaterial("Steel02", 1, 2.0, 40.0, 0.02, 10.0, 0.9, 0.2)': (
        [GiuffreMenegottoPinto(40.0, 2.0, 0.02, 10.0, 0.9, 0.2)],
        [-0.4617363547, -0.3495534337, -0.0159234607, 0.1812459626, 0.2047394161],
    ),
    'uniaxialMaterial("Steel02", 1, 2.0, 40.0, 0.02, 15.0, 0.925, 0.15, 0.04, 1.5, 0.1, 1.0)': (
        [GiuffreMenegottoPinto(40.0, 2.0, 0.02, 15.0, a1=0.04, a2=1.5, a3=0.1, a4=1.0)],
        [-0.4419097950, -0.4122165049, -0.2449006148, -0.1176577584, -0.0747492409],
    ),
    'uniaxialMaterial("BoucWen", 1, 0.1, 40.0, 1.0, 10.0, 10.0, 1.0, 0.0, 0.0, 0.0)': (
        [BoucWen(40.0, 0.05, 0.1)],
        [-0.4411823132, -0.1124320229, 0.1133379525, 0.1533982507, 0.2571250040],
    ),
    'uniaxialMaterial("BoucWen", 1, 0.1, 40.0, 2.0, 120.0, 280.0, 1.0, 0.0, 0.0, 0.0)': (
        [BoucWen(40.0, 0.05, 0.1, 2.0, 0.7)],
        [-0.4403458456, -0.1126587417, 0.1091366092, 0.1454760120, 0.2524361323],
    ),
    'uniaxialMaterial("BoucWen", 1, 0.1, 40.0, 1.0, 10.0, 10.0, 1.0, 0.02, 0.05, 0.1)': (
        [BoucWen(40.0, 0.05, 0.1, deltaA=0.02, deltaNu=0.05, deltaEta=0.1)],
        [-0.4455093217, -0.0939714010, 0.1390994658, 0.1519191273, 0.2538596759],
    ),
    'uniaxialMaterial("MultiLinear", 1, 0.05, 2.0, 0.1, 3.0, 0.3, 4.0)': (
        [Multilinear([0.05, 0.1, 0.3], [2.0, 3.0, 4.0])],
        [-0.5055171811, -0.0664282037, 0.0248831076, 0.1693141154, 0.3043558927],
    ),
    'uniaxialMaterial("Parallel", 1, 2, 3) of ("Elastic", 2, 40) and ("Maxwell", 3, 30, 6, 1, 1)': (
        [LinearSpring(40.0), Maxwell(30.0, 6.0)],
        [0.0391087909, -0.0383559878, -0.1702457279, -0.2069657292, -0.1413963886],
    ),
}


@pytest.mark.parametrize("material", OF_OPENSEES)
def test_the_laws_are_those_of_opensees(material):
    links, displacements = OF_OPENSEES[material]
    problem = oscillator(*links, force=6.0, omega=5.6, span=(0, 5))
    run = problem.integrate(rtol=1e-9, method="rk8", t_eval=[1, 2, 3, 4, 5])
    np.testing.assert_allclose(run.u[:, 0], displacements, rtol=0, atol=1e-6)


def bolted(friction, stiffness, clearance, curve, *given, **options):
    """Return two masses: a joint that slips until its bolts bear, as links in parallel, and a backbone curve."""
    joint = friction, Gap(stiffness, clearance), Cable(stiffness, clearance)
    return structure([(curve, None, 1), *((law, None, 0) for law in joint)], *given, **options)


def test_slip_in_a_bolted_joint_is_that_of_opensees():
    """``Parallel`` of ElasticPP(40, 0.05) and two ElasticPPGap(60, +-1e6, +-0.1), as above."""
    slipping = [-0.1559366030, -0.2161825180, -0.2410797921, -0.3294426040, -0.1816353929]
    (curve,), yielding = OF_OPENSEES['uniaxialMaterial("MultiLinear", 1, 0.05, 2.0, 0.1, 3.0, 0.3, 4.0)']
    forces = 6 * np.cos(5.6 * np.linspace(0, 10, 40001))  # linear between samples, which changes u by 1e-8
    law, spring = ElasticPlastic(40.0, 2.0), 1e-12  # 0 would make K of blocks, with a code of its own
    problem = bolted(law, 60.0, 0.1, curve, 1.0, spring, np.column_stack([forces, forces]))
    run = problem.integrate(rtol=1e-9, t_eval=[1, 2, 3, 4, 5], invariants={})
    np.testing.assert_allclose(run.u, np.column_stack([slipping, yielding]), rtol=0, atol=1e-6)


def test_loops_of_slip_and_of_a_backbone_curve_are_closed():
    """Heavy masses move as a sine; Masing's rule: the branch that unloads is the backbone curve, twice as large.

    Friction holds up to F, slips, and the bolt bears beyond the clearance; a cycle takes 4 F (A - F / k).
    """
    k, F, bolt, clearance, A = 40.0, 2.0, 60.0, 0.2, 0.5
    stretches, forces = [0.1, 0.2, 0.4], [1.0, 1.5, 2.0]
    law, span = Multilinear(stretches, forces), (0, 6.5 * np.pi)
    given = ElasticPlastic(k, F), bolt, clearance, law, 1e9, 1e9, np.zeros((2, 2))
    problem = bolted(*given, v0=A, t_span=span)
    outputs = {"force": eig3.structures.link_forces(problem)}
    run = problem.integrate(rtol=1e-10, t_eval=np.linspace(*span, 105), outputs=outputs, invariants={})
    x, pulls = run.u[:, 0], run.outputs["force"]
    first, down = run.t < np.pi / 2, (run.t > np.pi / 2) & (run.t < 3 * np.pi / 2)
    up = (run.t > 3 * np.pi / 2) & (run.t < 5 * np.pi / 2)
    bearing = bolt * np.sign(x) * np.maximum(np.abs(x) - clearance, 0)
    friction = np.where(first, np.minimum(k * x, F), np.maximum(F - k * (A - x), -F))
    np.testing.assert_allclose(
        (pulls[:, 1:].sum(axis=1) - bearing)[first | down], friction[first | down], rtol=0, atol=1e-6
    )

    def backbone(x):
        return np.interp(x, [0, *stretches, 0.6], [0, *forces, 2.5])

    tension, top = pulls[:, 0], backbone(A)
    np.testing.assert_allclose(tension[down], top - 2 * backbone((A - x[down]) / 2), rtol=0, atol=1e-6)
    np.testing.assert_allclose(tension[up], 2 * backbone((A + x[up]) / 2) - top, rtol=0, atol=1e-6)
    slopes = np.array([10.0, 5.0, 2.5])
    loop = 4 * (slopes[:2] - slopes[1:]) * stretches[:2] * (A - np.array(stretches[:2]))
    cycles = np.diff(run.z["absorbed"][[40, 72, 104]])  # from a peak to the next two
    np.testing.assert_allclose(cycles, loop.sum() + 4 * F * (A - F / k), rtol=1e-6)


def test_the_critical_step_has_the_relaxation_time():
    problem = oscillator(LinearSpring(4.0), Maxwell(30.0, 0.3), velocity=0.5)
    limit = problem.critical_step(safety=1.0).limit
    assert limit < 0.02  # of the order of 0.3 / 30; the springs alone allow 0.3
    stable, grown = (problem.integrate(h=f * limit, t_end=3000 * limit, save_every=None) for f in (0.98, 1.02))
    assert np.abs(stable.u[-1, 0]) < 1 < np.abs(grown.u[-1, 0])


def test_links_with_memory_between_rigid_bodies():
    """A body slides as the standard linear solid above; the force of nine points is gathered by loops."""
    count, scene = 9, Scene(dimension=2)
    body = scene.body(1.0, 0.1, [1.0, 0.0], velocity=[0.5, 0.0])
    body.prismatic(None, [1.0, 0.0], [1.0, 0.0])
    heights = np.arange(count) / count
    posts = scene.fixed(np.column_stack([0 * heights, heights]))
    ends = body.at(np.column_stack([0 * heights + 1, heights]))
    scene.add(LinearSpring(4.0 / count, 1.0), posts, ends)
    scene.add(Maxwell(1.5 / count, 1.05 / count), posts, ends)
    problem = scene.problem((0, 4))
    run = problem.integrate(h=1e-3, method="rk4")
    alone = oscillator(LinearSpring(4.0), Maxwell(1.5, 1.05), velocity=0.5, span=(0, 4)).integrate(h=1e-3, method="rk4")
    np.testing.assert_allclose(body.centre.positions(run.u)[:, 0] - 1, alone.u[:, 0], rtol=0, atol=1e-10)
    one = run.z["maxwell"].reshape(-1, count)
    np.testing.assert_allclose(one, alone.z["maxwell"][:, None].repeat(count, axis=1), rtol=0, atol=1e-10)
    members = problem.ensemble(v0=[0.5 * problem.v0, problem.v0], h=1e-3, method="rk4", save_every=None)
    np.testing.assert_allclose(members.u[-1, -1], run.u[-1], rtol=0, atol=1e-12)


@dataclass(frozen=True, eq=False)
class Burgers(Link):
    """A link of one's own: the state relaxes towards the stretch."""

    stiffness: float
    time: float

    tension = eig3.jit(lambda r, state, stiffness: stiffness * (r - state))
    state_rate = eig3.jit(lambda r, state, time: (r - state) / time)


def test_a_law_of_ones_own_takes_one_class():
    """It is Maxwell's law with another state."""
    options = {"velocity": 0.5, "span": (0, 3)}
    problem = oscillator(LinearSpring(4.0), Burgers(1.5, 0.7), **options)
    assert "velocity is read by Burgers" in problem.note  # a state with a rate is a velocity for methods
    own = problem.integrate(rtol=1e-10)
    known = oscillator(LinearSpring(4.0), Maxwell(1.5, 1.05), **options).integrate(rtol=1e-10)
    np.testing.assert_allclose(own.u[-1], known.u[-1], rtol=0, atol=1e-8)
    np.testing.assert_allclose(own.u[-1] - own.z["burgers"][-1], known.z["maxwell"][-1], rtol=0, atol=1e-8)


def add_a_pair_force():
    @dataclass(frozen=True, eq=False)
    class Near(Burgers):
        cutoff: float = 1.0
        cutoff_field = "cutoff"

    scene = Scene(dimension=1)
    scene.add(Near(1.0, 1.0), scene.mass(1.0, [0.0, 1.0]))
    scene.problem((0, 1))


@pytest.mark.parametrize(
    "kind", ["elastic plastic", "isotropic", "multilinear", "giuffre menegotto pinto", "breaking string"]
)
def test_a_link_yields_in_all_units(kind):
    """Factors of two are exact: a run in other units has the same steps and digits, whatever its states are."""

    def run(metre, newton):
        law = {
            "elastic plastic": ElasticPlastic(50.0 * newton / metre, 3.0 * newton, 0.1),
            "isotropic": ElasticPlastic(50.0 * newton / metre, 3.0 * newton, 0.1, isotropic=0.5),
            "multilinear": Multilinear(np.array([0.05, 0.1, 0.2]) * metre, np.array([2.5, 4.0, 5.0]) * newton),
            "giuffre menegotto pinto": GiuffreMenegottoPinto(50.0 * newton / metre, 3.0 * newton, 0.1),
            "breaking string": BreakingString(50.0 * newton / metre, 0.0, 3.0 * newton),
        }[kind]
        starts = {"mass": newton / metre, "velocity": 1.5 * metre}
        pushed = oscillator(law, **starts, force=0.1 * newton, omega=1.0, span=(0, 2))
        return pushed.integrate(rtol=1e-5, method="rk5")

    usual = run(1.0, 1.0)
    (found,) = usual.events.values()
    assert len(found) >= 1 + (kind != "breaking string")
    for metre, newton in ((1.0, 2.0**-30), (1.0, 2.0**20), (2.0**-20, 1.0)):
        other = run(metre, newton)
        np.testing.assert_array_equal(other.t, usual.t)
        np.testing.assert_array_equal(other.u[:, 0] / metre, usual.u[:, 0])
        assert other.notes == usual.notes == ()


BAD_VALUES = {
    "yield_length of BoucWen must be positive": lambda: BoucWen(1.0, 0.0),
    "hardening of BoucWen must be 0 to 1": lambda: BoucWen(1.0, 1.0, 1.5),
    "sharpness of BoucWen must be at least 1": lambda: BoucWen(1.0, 1.0, 0.5, 0.5),
    "pinching of BoucWen must be 0.5 to 1": lambda: BoucWen(1.0, 1.0, 0.5, 1.0, 0.2),
    "deltaNu of BoucWen must not be negative": lambda: BoucWen(1.0, 1.0, deltaNu=-1.0),
    "stretches of Multilinear must have at least three points": lambda: Multilinear([1.0, 2.0], [1.0, 1.5]),
    "stretches of Multilinear must be positive and increase": lambda: Multilinear([1.0, 2.0, 2.0], [1.0, 2.0, 2.0]),
    "forces of Multilinear must have slopes that decrease": lambda: Multilinear([1.0, 2.0, 3.0], [1.0, 1.2, 2.0]),
    "forces of Multilinear must have as many points as stretches": lambda: Multilinear([1.0, 2.0, 3.0], [1.0, 1.2]),
    "damping of Maxwell must be positive": lambda: Maxwell(1.0, 0.0),
    "stiffness of ElasticPlastic must be positive": lambda: ElasticPlastic(0.0, 1.0),
    "yield_force of ElasticPlastic must be positive": lambda: ElasticPlastic(1.0, 0.0),
    "hardening of ElasticPlastic must be 0 to 1": lambda: ElasticPlastic(1.0, 1.0, 1.0),
    "isotropic of ElasticPlastic must be 0 to 1": lambda: ElasticPlastic(1.0, 1.0, isotropic=2.0),
    "a4 of GiuffreMenegottoPinto must be positive": lambda: GiuffreMenegottoPinto(1.0, 1.0, a4=0.0),
    "R0 of GiuffreMenegottoPinto must be positive": lambda: GiuffreMenegottoPinto(1.0, 1.0, R0=0.0),
}
test_what_is_wrong_is_refused_in_a_sentence = refusals(
    BAD_VALUES, {"Near has a state, and thus needs two arguments of points": add_a_pair_force}
)


def test_a_state_has_no_velocity():
    """Only events change it: with a velocity, the plastic stretch grew all the time."""
    problem = oscillator(ElasticPlastic(100.0, 10.0))
    for call in (problem.with_, partial(problem.ensemble, h=0.01)):
        with pytest.raises(ValueError, match="v0 must be 0 in the degree of freedom elastic plastic 0, a state that"):
            call(v0=[1.0, 1.0])


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize("law", [ElasticPlastic(100.0, 10.0, 0.1), Multilinear([0.1, 0.2, 0.4], [10.0, 15.0, 18.0])])
def test_a_start_beyond_yield_that_moves_back_is_refused(law, way):
    """The link would follow the line of yielding back. All states of a run, with the state of the link, are starts."""
    motion = eig3.linear([1.0], None, None, t_span=(0, 3), u0=[0.15 * way], v0=[0.0], links=[(law, None, 0)])
    with pytest.raises(ValueError, match="must not be exceeded at the start by a link that moves back, but the start"):
        motion.with_(v0=[-1.0 * way]).integrate(h=0.01)
    with pytest.raises(ValueError, match="a link that moves back, but member 2 lies behind"):
        motion.ensemble(v0=np.array([[0.0], [1.0], [-1.0]]) * way, h=0.01)
    run = motion.with_(v0=[5.0 * way]).integrate(rtol=1e-9)
    for k in np.flatnonzero(np.abs(run.v[:-1, 0]) > 1e-3)[::5]:  # at a turn, v is round-off of any sign
        z = {name: values[k] for name, values in run.z.items()}
        rest = motion.with_(u0=run.u[k], v0=run.v[k], z0=z, t_span=(run.t[k], 3.0)).integrate(rtol=1e-9)
        np.testing.assert_allclose(rest.u[-1], run.u[-1], rtol=0, atol=1e-7)  # a hundred times the tolerance


@pytest.mark.parametrize("start", [0.05, 0.2, -0.2])
@pytest.mark.parametrize("law", [partial(GiuffreMenegottoPinto, R0=5.0), SHIFTED])
def test_steel_that_moves_back_at_the_start_turns_there(law, start):
    """From rest, it turns at an event. The displacements depend continuously on the velocity at the start."""
    links = [(law(100.0, 10.0, 0.1), None, 0)]
    motion = eig3.linear([1.0], None, None, t_span=(0, 3), u0=[start], v0=[0.0], links=links)
    rest = motion.integrate(rtol=1e-10, t_eval=np.linspace(0, 3, 50))
    v0 = np.array([[-1e-8], [1e-8]]) * np.sign(start)
    alone = motion.with_(v0=v0[0]).integrate(rtol=1e-10, t_eval=rest.t)
    members = motion.ensemble(v0=v0, rtol=1e-10, t_eval=rest.t)
    for u in (alone.u, *members.u):
        np.testing.assert_allclose(u, rest.u, rtol=0, atol=3e-8)  # the velocity times 3 s
    assert len(alone.events["giuffre menegotto pinto 0"]) == len(rest.events["giuffre menegotto pinto 0"]) - 1
