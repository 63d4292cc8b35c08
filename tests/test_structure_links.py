"""Links of effects between the degrees of freedom of structures."""

import inspect
from dataclasses import dataclass

import numpy as np
import pytest
import scipy.sparse

import eig3
from eig3.effects import (
    Body,
    BoucWen,
    Cable,
    ElasticPlastic,
    Gap,
    LinearDamper,
    LinearSpring,
    MassImpact,
    Maxwell,
    Multilinear,
)
from eig3.scene import Scene
from eig3.structures import base_shear, link_ductility, link_forces, link_stretches

from .conftest import refusals

M = np.array([1.0, 2.0, 3.0])
K = 10 * np.array([[3.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 1.0]])
T = np.arange(0, 10, 0.01)
GROUND = T, 8 * np.sin(3 * T)
LINKS = [
    (BoucWen(20.0, 0.05, 0.1), None, 0),
    (Maxwell(10.0, 2.0), "a", "c"),
    (ElasticPlastic(40.0, 1.0, 0.05), 0, 1),
    (ElasticPlastic(40.0, 1.0, 0.05), [1], [2]),
    (LinearDamper(0.2), None, 2),
]


def structure(links=LINKS, work=True, **options):
    given = {"ground": GROUND, "t_span": (0, 8), "names": ("a", "b", "c"), "work": work}
    return eig3.linear(M, None, K, links=links, **given, **options)


def as_a_scene(force):
    """The same structure from masses and springs on ground that stands still, with the inertia forces of the ground."""
    scene = Scene(dimension=1)
    ground, masses = scene.fixed(0.0), scene.mass(M, np.zeros(3))
    scene.add(LinearSpring(20.0), ground, masses[0])
    scene.add(LinearSpring(10.0), masses[:2], masses[1:])
    for law, first, second in LINKS:
        ends = [{"a": 0, "b": 1, "c": 2}.get(x, x) if isinstance(x, str) else x for x in (first, second)]
        ends = [ground if x is None else masses[int(np.ravel(x)[0])] for x in ends]
        scene.add(law, *ends)
    scene.add(force, masses)
    return scene.problem((0, 8))


def test_contacts_of_few_steps_are_noted_and_a_growth_by_them_diverges():
    """The energy is constant, so |u| stays below sqrt(2 E / 38), with the least eigenvalue of K, 38.2 N/m. Each contact
    adds energy though its step is stable while it lasts: half a period of the closed gap has 1.6 steps at the limit."""
    spring = np.array([[200.0, -100.0], [-100.0, 100.0]])
    start = {"u0": [-0.101, 0.0], "v0": [-1.0, 0.0], "t_span": (0, 20)}
    pounding = eig3.linear([1.0, 1.0], None, spring, links=[(Gap(1e4, 0.1), None, 0)], **start)
    limit, most = pounding.critical_step().limit, np.sqrt(2 * (0.5 + 1.0201 + 0.005) / 38.0)
    fine, coarse, unstable = (pounding.integrate(h=part * limit) for part in (0.1, 0.9, 0.985))
    assert (fine.success, fine.notes, np.abs(fine.u).max() < most) == (True, (), True)
    assert (coarse.success, np.abs(coarse.u).max() > 100 * most) == (True, True)
    (note,) = coarse.notes
    assert note.startswith("h = 0.0178094 is long for the contacts")
    assert unstable.status is eig3.Status.DIVERGED
    members = pounding.ensemble(h=limit * np.array([0.1] * 5 + [0.9] * 3))
    assert members.notes == (f"{note} This is member 5 of the 3 members with such contacts.",)


def test_a_structure_with_links_moves_as_the_same_scene():
    """The work of the links, the ground and the damper balances the energy."""

    @dataclass(frozen=True, eq=False)
    class Inertia(Body):
        acceleration = eig3.jit(lambda t: (-8 * np.sin(3 * t),))

    problem, scene = structure(), as_a_scene(Inertia())
    options = {"rtol": 1e-9, "t_eval": np.linspace(0, 8, 9), "h_max": 0.01}
    run, other = problem.integrate(**options), scene.integrate(**options)
    # The record is linear between its samples: its interpolation error of 1e-4 is smooth.
    np.testing.assert_allclose(run.u, other.u[:, :3], rtol=0, atol=2e-4 * np.abs(run.u).max())
    for name in ("bouc wen", "maxwell"):
        np.testing.assert_allclose(run.z[name], other.z[name], rtol=0, atol=2e-4 * np.abs(run.u).max())
    assert run.z["elastic plastic"].shape == (9, 2)
    assert [*problem.events] == ["elastic plastic 0", "elastic plastic 1"]
    assert len(run.events["elastic plastic 0"]) == len(other.events["elastic plastic 0"]) > 3
    assert run.drift["energy"] < 1e-6 * np.abs(run.z["work"]).max()


def test_eig3_keeps_its_order():
    """The links turn within steps, so single ratios scatter: the mean over four halvings counts."""
    problem = structure()
    true = problem.integrate(rtol=1e-10).u[-1]
    errors = [np.abs(problem.integrate(h=h).u[-1] - true).max() for h in (2e-2, 2e-2 / 16)]
    assert errors[0] / errors[1] > 16 ** (2 - 0.4)


@eig3.jit
def by_hand(t, u, v, z, p, a, dz):
    pull = 20 * (0.1 * u[0] + 0.9 * z[0])
    f0 = -30 * u[0] + 10 * u[1] - pull
    f1 = 10 * u[0] - 20 * u[1]
    a[0], a[1] = (2 * f0 - f1) / 3, (2 * f1 - f0) / 3
    dz[0] = v[0] * (1 - abs(z[0] / 0.05) * (0.5 + 0.5 * np.sign(v[0] * z[0])))


def test_a_consistent_mass_with_a_link():
    mass, k = np.array([[2.0, 1.0], [1.0, 2.0]]), np.array([[30.0, -10.0], [-10.0, 20.0]])
    links = [(BoucWen(20.0, 0.05, 0.1), None, 0)]
    problem = eig3.linear(mass, None, k, links=links, t_span=(0, 5), v0=[1.0, 0.0])
    run = problem.integrate(h=1e-3, method="rk4", invariants={})
    other = eig3.integrate(by_hand, (0, 5), [0.0, 0.0], [1.0, 0.0], z0=0.0, h=1e-3, method="rk4")
    np.testing.assert_allclose(run.u, other.u, rtol=0, atol=1e-10)
    np.testing.assert_allclose(run.z["bouc wen"], other.z["z"], rtol=0, atol=1e-10)


def test_linear_links_are_entries_of_the_matrices():
    """They have no states."""
    links = [(LinearSpring(5.0), 0, [1, 2]), (LinearDamper(0.3), None, [0, 2])]
    k = K + 5 * np.array([[2, -1, -1], [-1, 1, 0], [-1, 0, 1]])
    problem = structure(links, work=False)
    run = problem.integrate(h=1e-3, outputs={"links": link_forces(problem)})
    other = eig3.linear(M, np.diag([0.3, 0, 0.3]), k, ground=GROUND, t_span=(0, 8)).integrate(h=1e-3)
    np.testing.assert_allclose(run.u, other.u, rtol=0, atol=1e-11)
    pulls = np.hstack([5 * (run.u[:, 1:] - run.u[:, :1]), 0.3 * run.v[:, ::2]])
    np.testing.assert_allclose(run.outputs["links"], pulls, rtol=0, atol=1e-12)


def test_masses_bounce_behind_gaps_and_on_cables():
    """The contact lasts half a period, or less with damping: the mass separates where the force is 0.

    Links with damping have other functions than those without: the first events would be lost under one name.
    """
    dampings = 0.0, 2.0
    links = [(Gap(100.0, 0.1, damping=damping), k, None) for k, damping in enumerate(dampings)]
    links += [(Cable(50.0, 0.1), None, 2), (LinearSpring(1.0), 2, 3), (Cable(50.0, 0.1, 0.2), None, 3)]
    stiffness = np.diag([0.0, 0.0, 4.0, 4.0])
    run = eig3.linear(np.ones(4), None, stiffness, links=links, t_span=(0, 5), v0=np.ones(4)).integrate(rtol=1e-10)
    assert [*run.events] == ["gap 0", "gap 1", "cable 0", "cable 1"]
    np.testing.assert_allclose(run.events["cable 0"].u[:, 2], 0.1, rtol=0, atol=1e-7)
    assert len(run.events["cable 0"]) > 2 < len(run.events["cable 1"])
    assert run.z == {}
    for k, damping in enumerate(dampings):
        decay, times = damping / 2, run.events[f"gap {k}"].t
        omega = np.sqrt(100 - decay**2)
        assert len(times) == 2
        assert times[0] == pytest.approx(0.1, abs=1e-9)
        # x = e^(-decay t) sin(omega t) / omega; the acceleration is 0 at the end
        end = np.pi - np.arctan2(2 * decay * omega, omega**2 - decay**2)
        contact = times[1] - times[0]
        assert contact == pytest.approx((end if damping else np.pi) / omega, abs=1e-8)
        v = np.exp(-decay * contact) * (np.cos(omega * contact) - decay / omega * np.sin(omega * contact))
        assert run.v[-1, k] == pytest.approx(v, abs=1e-8)


@pytest.mark.parametrize("options", [{"h": 2e-3}, {"rtol": 1e-7}], ids=["h", "rtol"])
def test_members_with_scaled_records_are_single_runs(options):
    problem = structure()
    scales = np.linspace(0.2, 1.5, 18)
    members = problem.ensemble(params={"ground_scale": scales}, t_eval=[0, 4, 8], **options)
    for i in (0, 17):
        alone = problem.with_(params=problem.params._replace(ground_scale=scales[i])).integrate(
            t_eval=[0, 4, 8], **options
        )
        tolerance = 1e-10 if "h" in options else 1e-5  # beside kinks, round-off changes the steps
        np.testing.assert_allclose(members.u[i], alone.u, rtol=0, atol=tolerance)
        np.testing.assert_allclose(members.z["bouc wen"][i], alone.z["bouc wen"], rtol=0, atol=tolerance)


def test_forces_and_ductility_of_links_and_the_base_shear():
    """Ductility is the stretch over the stretch at yield, of the links that yield only, also behind other links.

    By the equation of motion, M a + M r g = -base shear in all degrees of freedom together.
    """
    problem = structure()
    outputs = {"links": link_forces(problem), "shear": base_shear(problem), "ductility": link_ductility(problem)}
    run = problem.integrate(h=5e-3, outputs=outputs)
    pulls, stretch = run.outputs["links"], np.diff(run.u, axis=1)
    np.testing.assert_allclose(pulls[:, -1], 0.2 * run.v[:, 2], rtol=0, atol=1e-12)
    inertia = (run.a + np.interp(run.t, *GROUND)[:, None]) @ M
    np.testing.assert_allclose(run.outputs["shear"], -inertia, rtol=0, atol=1e-9)
    assert run.extremes["links"].high.shape == (5,)
    np.testing.assert_allclose(pulls[:, 0], 2 * run.u[:, 0] + 18 * run.z["bouc wen"], rtol=0, atol=1e-11)
    np.testing.assert_allclose(pulls[:, 1], 10 * run.z["maxwell"], rtol=0, atol=1e-11)
    elastic = 40 * (stretch - run.z["elastic plastic"])
    np.testing.assert_allclose(pulls[:, 2:4], np.clip(elastic, 2 * stretch - 0.95, 2 * stretch + 0.95), atol=1e-11)
    ductility = np.abs(np.column_stack([run.u[:, 0], stretch])) / [0.05, 0.025, 0.025]
    np.testing.assert_allclose(run.outputs["ductility"], ductility, rtol=1e-12)


def test_the_base_shear_where_links_have_all_of_the_stiffness():
    """It is the force of the first storey, the only link to the ground."""
    braces = ElasticPlastic(40.0, 1.0, 0.05)
    problem = eig3.linear(M, links=[(braces, None, 0), (braces, [0, 1], [1, 2])], ground=GROUND, t_span=(0, 8))
    run = problem.integrate(h=5e-3, outputs={"links": link_forces(problem), "shear": base_shear(problem)})
    shear, links = run.outputs["shear"], run.outputs["links"]
    np.testing.assert_allclose(shear, links[:, 0], rtol=0, atol=2e-15 * np.abs(links).max())  # a sum of five forces


def test_the_ductility_demand_of_an_impulse():
    """Elastic up to the yield stretch y, then a parabola: (1 + (v / (omega y))^2) / 2, and what exceeds 1 remains."""
    k, y, ratios = 40.0, 0.05, np.array([2.0, 3.0, 4.0])
    links = [(ElasticPlastic(k, k * y), None, 0), (LinearDamper(2.0), None, 1)]
    problem = eig3.linear([1.0, 1.0], links=links, t_span=(0, 8))
    outputs = {"ductility": link_ductility(problem), "residual": link_stretches(problem)}
    v0 = np.column_stack([ratios * np.sqrt(k) * y, np.zeros(3)])
    members = problem.ensemble(v0=v0, rtol=1e-9, outputs=outputs)
    demand = (1 + ratios**2) / 2
    table = members.summary()
    np.testing.assert_allclose(table["peak of ductility[0]"], demand, rtol=1e-7)
    middle = members.z["elastic plastic"][:, -1]
    np.testing.assert_allclose(middle, (demand - 1) * y, rtol=1e-7)
    np.testing.assert_allclose(table["residual[0]"], table["u0"], rtol=0, atol=0)


@dataclass(frozen=True, eq=False)
class Odd(LinearSpring):
    ductility = eig3.jit(lambda r, yield_length: r / yield_length)


@pytest.mark.parametrize(
    ("law", "lowest"),
    [
        (ElasticPlastic(100.0, 1.0), 0.03),  # by 1 N and 100 N/m, between +1 and -1 N
        (Multilinear([0.01, 0.02, 0.03], [1.0, 1.5, 1.75]), -0.01),  # work of 25 - 5 - 20 mJ on twice the backbone
    ],
)
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_mass_that_is_released_beyond_yield_unloads_elastically(law, lowest, side):
    """As in a test in which a structure is pulled and let go: without a turn at the start, the link would return along
    its backbone curve, and give back what it has absorbed."""
    problem = eig3.linear([1.0], links=[(law, None, 0)], u0=0.05 * side, t_span=(0, 1))
    u = side * problem.integrate(h=1e-3).u[:, 0]
    assert u.max() <= 0.05
    assert u.min() == pytest.approx(lowest, abs=1e-5)  # (omega h)^2 = 1e-4 of the amplitude of 0.03


def test_backbone_curves_of_each_link():
    """One law with a curve for each of its links moves as two laws; at the first loading, each follows its curve."""
    stretches = np.array([[0.05, 0.1, 0.3], [0.1, 0.2, 0.4]])
    forces = np.array([[2.0, 3.0, 4.0], [1.0, 1.5, 2.0]])
    more = [0.1, 0.2, 0.3, 0.5], [1.0, 1.5, 1.8, 1.8]
    both = [(Multilinear(stretches, forces), [0, 1], [1, 2])]
    each = [(Multilinear(stretches[k], forces[k]), k, k + 1) for k in range(2)]
    last, u0 = [(Multilinear(*more), None, 0)], np.array([0.25, 0.4, 0.75])
    one, other = (
        structure(links + last, work=False, u0=u0).integrate(rtol=1e-9, invariants={}) for links in (both, each)
    )
    np.testing.assert_array_equal(one.u, other.u)
    assert one.z["multilinear"].shape[1] == 7
    assert min(len(one.events[f"multilinear {k}"]) for k in range(3)) > 2
    pulls = [np.interp(r, [0, *x], [0, *y]) for r, x, y in zip(u0[1:] - u0[:-1], stretches, forces, strict=True)]
    pulls.append(np.interp(u0[0], [0, *more[0]], [0, *more[1]]))
    acting = pulls @ np.array([[1, -1, 0], [0, 1, -1], [-1, 0, 0]])
    np.testing.assert_allclose(one.a[0], (acting - K @ u0) / M, rtol=0, atol=1e-12)


def test_modes_are_without_links():
    problem = structure()
    assert not problem.exact
    np.testing.assert_array_equal(problem.modes(2).omega, structure(links=()).modes(2).omega)


def one(*link):
    return lambda: structure([link])


test_what_is_wrong_is_refused_in_a_sentence = refusals(
    {
        r"links\[0\] must have numbers from 0 to 2, names or None for its ends, not 3": one(LinearSpring(1.0), 0, 3),
        r"links\[0\]: the structure has no d: did you mean": one(LinearSpring(1.0), 0, "d"),
        r"links\[0\] must join two different degrees of freedom": one(LinearSpring(1.0), 1, 1),
        r"links\[0\] changes velocities at events, which a structure does not take": one(MassImpact(0.3), 0, 1),
        r"problem must have links: give it to eig3.linear\.": lambda: link_forces(structure(())),
        r"problem must have links that yield, such as ElasticPlastic\.": lambda: link_ductility(structure(LINKS[-1:])),
        "has links: leave them out": lambda: structure().exact(1.0),
        "the links of this problem have no modes": lambda: eig3.structures.modal_solution(structure(), [1.0]),
    },
    {
        r"links must be a list of \(link, first, second\), not LinearSpring": lambda: structure(LinearSpring(1.0)),
        r"links\[0\] must be \(link, first, second\) with a link of eig3.effects": lambda: structure(
            [LinearSpring(1.0)]
        ),
        r"links\[0\] must be \(link, .* with a link of eig3.effects, not .*Gravity": one(
            eig3.effects.Gravity((-9.81,)), 0, 1
        ),
        "ductility of Odd must be compiled with @eig3.jit, and read only r": one(Odd(1.0), 0, 1),
    },
)


def test_many_links_are_one_loop():
    """The source has the same number of lines for one link and for a hundred."""
    n = 101
    stiffness = scipy.sparse.diags_array([2.0 * np.ones(n), -np.ones(n - 1), -np.ones(n - 1)], offsets=[0, 1, -1])
    shared = {"t_span": (0, 1), "v0": np.eye(n)[0]}
    few, many = (
        eig3.linear(
            np.ones(n), None, stiffness, links=[(ElasticPlastic(4.0, 0.1), range(m), range(1, m + 1))], **shared
        )
        for m in (1, 100)
    )
    sources = [inspect.getsource(problem.rhs.py_func.inner.py_func) for problem in (few, many)]
    assert sources[0] == sources[1]
    assert len(many.events) == 100
    assert many.integrate(h=0.01).success


def test_the_ready_building_on_isolators_strikes_the_wall_of_its_moat():
    """The period after yield is that of the whole mass on the isolators: its softest mode without links is rigid."""
    narrow, wide = (eig3.problems.isolated_building(gap=gap, t_end=8.0, work=True) for gap in (0.2, 1.0))
    runs = [problem.integrate(h=4e-4) for problem in (narrow, wide)]
    base = [np.abs(run.u[:, narrow.names.index("0A.ux")]).max() for run in runs]
    assert 0.2 < base[0] < 0.22 < base[1] < 1.0
    assert len(runs[0].events["gap 0"]) >= 2 > len(runs[1].events["gap 0"])
    for problem, run in zip((narrow, wide), runs, strict=True):
        assert run.drift["energy"] < 1e-4 * np.abs(run.z["work"]).max()
        total = problem.params.m[[name.endswith("ux") for name in problem.names]].sum()
        stiffness = (problem.params.link_0_stiffness * problem.params.link_0_hardening).sum()
        assert 2 * np.pi * np.sqrt(total / stiffness) == pytest.approx(2.5, rel=0.05)  # members have masses too
