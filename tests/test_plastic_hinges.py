"""Frames whose members yield at hinges."""

import numpy as np
import pytest
from scipy.integrate import simpson

import eig3
from eig3 import problems
from eig3.effects import ElasticPlastic, FrictionPendulum, GiuffreMenegottoPinto, LinearSpring
from eig3.structures import Frame, Section, link_forces, link_stretches

from .conftest import assert_same, refusals

STEEL = {"E": 2.1e11, "density": 7850.0}
COLUMN, BEAM = Section(**STEEL, A=2.4e-2, I=8e-4), Section(**STEEL, A=1.2e-2, I=4.8e-4)
HEIGHT, SPAN = 3.3, 6.0
T = np.arange(0, 4, 0.02)


PLACES = {"a": (0, 0), "b": (SPAN, 0), "c": (0, HEIGHT), "d": (SPAN, HEIGHT)}


def portal(of_column=None, of_beam=None, ends=("start", "end")):
    """Two columns that are clamped at the ground, and a beam: with both hinges, all four that a mechanism needs."""
    frame = Frame()
    for name, place in PLACES.items():
        frame.node(name, *place)
    for start, end in ("ac", "bd"):
        frame.member(start, end, COLUMN, hinges={"start": of_column} if of_column else {})
    frame.member("c", "d", BEAM, hinges=dict.fromkeys(ends, of_beam) if of_beam else None)
    for name in "ab":
        frame.support(name)
    for name in "cd":
        frame.mass(name, 60e3)
    return frame


def yielding(laws, span, ground=0.0, damping=(0.03, 40.0, 200.0), **options):
    """Return the portal on a harmonic ground motion, with a force: tests with all of these share code."""
    no_force = [0.0, 10.0], np.zeros((2, 1)), [0]
    given = {"force": no_force, "work": True, "ground": (T, ground * np.sin(7 * T))} | options
    return portal(*laws).problem(span, damping=eig3.Rayleigh(*damping), **given)


LAW = ElasticPlastic(1e9, 2e5, 0.02)


def test_names_and_masses():
    """The end of a member has the inertia of half of it, m L^2 / 24, and the joint loses it."""
    law = ElasticPlastic(1e9, 2e5)
    frame = portal(law, law)
    joints = ("c.ux", "c.uy", "c.rz", "d.ux", "d.uy", "d.rz")
    assert frame.names == (*joints, "a-c.rz_start", "b-d.rz_start", "c-d.rz_start", "c-d.rz_end")
    problem = frame.problem((0, 1))
    of = dict(zip(problem.names, problem.params.m, strict=True))
    inertia = 7850 * 1.2e-2 * SPAN**3 / 24
    assert of["c-d.rz_start"] == of["c-d.rz_end"] == pytest.approx(inertia, rel=1e-12)
    rigid = dict(zip(portal().names, portal().matrices[0], strict=True))
    assert of["c.rz"] == pytest.approx(rigid["c.rz"] - inertia, rel=1e-12)
    assert problem.units[-1] == "rad"
    for _ in range(2):  # beside the beam
        frame.member("c", "d", BEAM, hinges={"start": law})
    assert frame.names[-2:] == ("c-d(2).rz_start", "c-d(3).rz_start")


def test_stiff_hinges_are_a_rigid_frame():
    """The flexibility of hinges of the stiffness k adds some 6 E I / (L k) to that of a member: 1e-3 of the motion."""
    ground = T, 3 * np.sin(7 * T)
    law = LinearSpring(1e12)
    runs = []
    for frame in (portal(), portal(law, law)):
        problem = frame.problem((0, 2), ground=ground, damping=eig3.Rayleigh(0.05, modes=(1, 3)))
        # stable up to 2.6e-5 s with stiff hinges
        runs.append(problem.integrate(h=2e-5, t_eval=np.linspace(0, 2, 41)).u[:, :6])
    np.testing.assert_allclose(runs[1], runs[0], rtol=0, atol=2e-3 * np.abs(runs[0]).max())


def test_modes_and_damping_are_those_of_rigid_hinges():
    law = ElasticPlastic(1e9, 2e5)
    damping = eig3.Rayleigh(0.05, modes=(1, 3))
    np.testing.assert_array_equal(portal(law, law).modes(3).omega, portal().modes(3).omega)
    ours, rigid = (frame.problem((0, 1), damping=damping).params for frame in (portal(law, law), portal()))
    assert (ours.a, ours.b) == (rigid.a, rigid.b)


@pytest.mark.parametrize("share", [0.97, 1.03])
def test_the_plastic_limit_load_of_a_portal(share):
    """A mechanism with four hinges: the largest horizontal force is the sum of their moments over the height.

    The force rises slowly, and the damping is strong. Below the limit, the frame comes to rest. Above it, the rest of
    the force drives the mechanism against the damping of the masses: with a constant velocity, as long as the stiffness
    that remains, which is none, and the damping of the members, which turn as rigid bodies, do not count.
    """
    yields = 4e5, 2e5
    limit = 2 * (yields[0] + yields[1]) / HEIGHT
    laws = (ElasticPlastic(1e9, moment) for moment in yields)
    force = [0.0, 2.0, 10.0], np.array([[0.0], [1.0], [1.0]]) * share * limit, [0]
    problem = yielding(laws, (0, 6), force=force, damping=(0.3, 30.0, 300.0))
    run = problem.integrate(h=2e-4, t_eval=[5.0, 5.5, 6.0])
    moves = np.diff(run.u[:, 0])
    if share < 1:
        assert np.abs(moves).max() < 1e-4 * run.u[-1, 0]
    else:
        mass = problem.params.m[[0, 3]].sum()
        velocity = (share - 1) * limit / (problem.params.a * mass)
        np.testing.assert_allclose(moves / 0.5, velocity, rtol=0.02)  # the columns have inertia against rotation too


def test_moments_and_rotations_make_the_loops_of_the_law():
    """The energy of the ground is kinetic, elastic, damped or absorbed.

    The input is the integral of the power of the inertia forces, by Simpson's rule: its error is below 1e-5.
    """
    problem = yielding((LAW, LAW), (0, 3), ground=9)
    outputs = {"moments": link_forces(problem), "rotations": link_stretches(problem)}
    run = problem.integrate(h=1e-4, outputs=outputs)
    r, names = run.outputs["rotations"], list(problem.names)
    np.testing.assert_array_equal(r[:, 0], run.u[:, names.index("a-c.rz_start")])  # the other end is the ground
    expected = run.u[:, names.index("c-d.rz_end")] - run.u[:, names.index("d.rz")]
    np.testing.assert_allclose(r[:, 3], expected, rtol=0, atol=1e-15)
    elastic = 1e9 * (r - run.z["elastic plastic"])
    line = 0.02 * 1e9 * r
    moments = np.clip(elastic, line - 0.98 * 2e5, line + 0.98 * 2e5)
    np.testing.assert_allclose(run.outputs["moments"], moments, rtol=0, atol=1e-6 * 2e5)
    assert run.extremes["rotations"].high.max() > 5 * 2e5 / 1e9  # a ductility of more than 5
    p, z = problem.params, run.z
    power = -(run.v @ (p.m * p.influence)) * np.interp(run.t, p.ground_times, p.ground)
    energy = problem.energy_of(run.u, run.v, z=z)[-1]
    total = energy + z["dissipated"][-1] + z["absorbed"][-1]
    assert simpson(power, x=run.t) == pytest.approx(total, rel=1e-4)
    assert z["absorbed"][-1] > 0.3 * total
    assert run.drift["energy"] < 1e-4 * total


#: Displacements, m, of the roof and of the first floor of `yielding_frame` at t = 2, 4, 6, 8 and 10 s, that OpenSees
#: 3.7.1 prints, by Newmark's method with 1 ms and 0.5 ms, extrapolated: with elasticBeamColumn, zeroLength and Steel01,
#: equalDOF, and Rayleigh damping of the members.
OF_OPENSEES = [
    [-0.023916887887, -0.002365071817],
    [-0.074954437315, -0.020623956206],
    [-0.061528145127, -0.017364366263],
    [-0.056221845282, -0.015743390515],
    [-0.051690726008, -0.014433996620],
]


def test_the_ready_frame_moves_as_in_opensees():
    """EIG-3's own error with this step is 3e-6 m, of 0.117 m."""
    problem = problems.yielding_frame(t_end=10.0)
    run = problem.integrate(h=4e-4, t_eval=[2, 4, 6, 8, 10], invariants={})
    columns = [problem.names.index(name) for name in ("5A.ux", "1A.ux")]
    np.testing.assert_allclose(run.u[:, columns], OF_OPENSEES, rtol=0, atol=5e-6)


def test_eig3_keeps_its_order_in_the_ready_frame():
    """The hinges yield within steps, so single ratios scatter: the mean over three halvings counts."""
    problem = problems.yielding_frame(t_end=4.0)
    end = [problem.integrate(h=h, save_every=None, invariants={}).u[-1] for h in (4e-4, 5e-5, 1.25e-5)]
    errors = [np.abs(u - end[-1]).max() for u in end[:-1]]
    assert errors[0] / errors[1] > 8 ** (2 - 0.3)


def test_a_step_beyond_the_limit_ends_as_diverged():
    """Yielding ends the growth at 1e110 m, where resets overflow: an error or a completed run would be wrong."""
    for h in (1e-3, 5e-3):
        run = problems.yielding_frame(t_end=10.0).integrate(h=h)
        assert run.status is eig3.Status.DIVERGED


def in_space(**options):
    """Return the portal in the plane of x and z, whose other directions are fixed."""
    frame = Frame(3)
    for name, (x, z) in PLACES.items():
        frame.node(name, x, 0, z)
    for start, end in ("ac", "bd"):
        frame.member(start, end, COLUMN, **options)
    frame.member("c", "d", BEAM, **({"hinges": options["hinges"]} if options else {}))
    for name in "ab":
        frame.support(name)
    for name in "cd":
        frame.mass(name, 60e3)
        frame.support(name, "uy rx rz")
    return frame


def test_a_frame_in_space_yields_as_the_frame_in_the_plane():
    """Its rotation about y has the other sign, which a symmetric law does not see. Round-off grows at events."""
    ground = T, 9 * np.sin(7 * T)
    space, plane = in_space(hinges={"start": {"ry": LAW}}, up=(1, 0, 0)), portal(LAW, LAW, ["start"])
    assert space.names[-3:] == ("a-c.ry_start", "b-d.ry_start", "c-d.ry_start")
    u, v = (frame.problem((0, 2), ground=ground).integrate(h=2e-4).u for frame in (plane, space))
    signs = np.where([".r" in name for name in space.names], -1.0, 1.0)
    assert np.abs(u[:, 0]).max() > 0.02
    np.testing.assert_allclose(v * signs, u, rtol=0, atol=1e-9)


def test_hinges_in_space_without_a_law_are_releases():
    """Condensed statically, since both directions of the bending of this member are those of the frame."""
    free = {"start": {"ry": ElasticPlastic(1.0, 1.0), "rz": ElasticPlastic(1.0, 1.0)}}
    found = []
    for options in ({"releases": "start"}, {"hinges": free}):
        frame = Frame(3)
        frame.node("a", 0, 0, 0)
        frame.node("b", SPAN, 0, 0)
        frame.member("a", "b", Section(**STEEL, A=1e-2, I=1e-4, I_side=3e-5, G=8e10, J=1e-5), **options)
        frame.mass("a", 1.0, 1.0)
        frame.mass("b", 1.0, 1.0)
        K = frame.matrices[1].toarray()
        kept, turns = K[:12, :12], K[12:, 12:]
        found.append(kept - K[:12, 12:] @ np.linalg.solve(turns, K[12:, :12]) if len(turns) else kept)
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-9 * np.abs(found[0]).max())


def test_a_beam_that_is_struck_turns_about_its_hinge_until_its_energy_is_used():
    """Corotational: E = M (theta - theta_y / 2) with the yield moment M, for a rotation theta of more than a radian."""
    moment, stiffness = 2e4, 1e7
    frame = Frame()
    frame.node("a", 0.0, 0.0)
    frame.node("b", 2.0, 0.0)
    frame.member("a", "b", Section(**STEEL, A=1e-2, I=1e-4), hinges={"start": ElasticPlastic(stiffness, moment)})
    frame.support("a")
    frame.mass("b", 500.0)
    spin = dict.fromkeys(("b.rz", "a-b.rz_start"), 5.0) | {"b.uy": 10.0, "b.ux": 0.0}
    v0 = [spin[name] for name in frame.names]
    problem = frame.problem((0, 0.8), corotational=True, v0=v0)
    run = problem.integrate(h=problem.critical_step().h / 4)
    energy = 0.5 * np.sum(problem.params.m * np.square(v0))
    theta = run.u[:, problem.names.index("a-b.rz_start")].max()
    assert theta > 1.0
    assert theta == pytest.approx(energy / moment + moment / (2 * stiffness), rel=1e-3)  # the beam vibrates a little


def test_hinges_are_looked_at_together_and_one_by_one_with_the_same_bits(monkeypatch):
    """Also if the events of a run are some of the family, in another order."""
    from eig3.functions import families

    def runs():
        problem = problems.yielding_frame(t_end=4.0)
        names = [*problem.events]
        chosen = {name: problem.events[name] for name in [*names[20:], *names[1:12]]}
        for events in (problem.events, chosen):
            yield problem.with_(events=events).prepare(h=4e-4, invariants={})()

    together = [*runs()]
    assert together[0]._extend().stepper.system.event_table[0, 4] == 34
    assert together[1]._extend().stepper.system.event_table[[0, 13, 14], 4].tolist() == [14, 1, 11]
    monkeypatch.setattr(families, "LEAST_TOGETHER", 1000)
    for one, other in zip(together, runs(), strict=True):
        assert (other._extend().stepper.system.event_table[:, 4] == 1).all()
        assert sum(len(found) for found in one.events.values()) > 20
        assert_same(one, other)


@pytest.mark.parametrize("corotational", [False, True])
def test_checked_hinges_have_order_2_and_the_error_of_smaller_steps(corotational, tmp_path):
    """Linear, both columns turn at the same time; so they do from files, and inlined."""
    h, law = 2.0**-13, GiuffreMenegottoPinto(1e9, 2e5, 0.02)
    problem = yielding((LAW, LAW), (0, 0.5), 9)
    if corotational:
        given = {"ground": (T, 9 * np.sin(7 * T)), "damping": eig3.Rayleigh(0.03, 40.0, 200.0)}
        problem = portal(law, law).problem((0, 0.5), corotational=True, **given)
    whole = problem.integrate(h=h, check=True)
    assert sum(len(found) for found in whole.events.values()) >= 4
    assert (whole.notes, round(whole.order)) == ((), 2)
    fine = problem.integrate(h=h / 16, t_eval=whole.t[::64])
    errors = np.abs(fine.u - whole.u[::64]).max(), np.abs(whole.error.u).max()
    assert 1 / 3 < errors[1] / errors[0] < 3
    if corotational:
        return
    problem.integrate(h=h, t_end=0.25, save_to=tmp_path / "run")
    for run in (problem.load(tmp_path / "run").extend(0.5), problem.integrate(h=h, inline=True)):
        assert_same(run, whole, ("u", "z"))


def test_isolators_below_corotational_members():
    """The frame sways by some mm on its base, so that the linear frame moves alike, to the square of the rotations."""
    frame = Frame()
    for name, place in PLACES.items():
        frame.node(name, *place)
        frame.mass(name, 30e3)
    for start, end, section in (("a", "c", COLUMN), ("b", "d", COLUMN), ("c", "d", BEAM), ("a", "b", BEAM)):
        frame.member(start, end, section)
    for name in "ab":
        frame.support(name, "uy")
    both = [("a.ux", None), ("b.ux", None)]
    links = [(FrictionPendulum(friction=0.05, radius=2.5, weight=6e5), None, both)]
    damping, ground = eig3.Rayleigh(0.03, 40.0, 200.0), (T, 3 * np.sin(7 * T))
    linear, turning = (
        frame.problem((0, 2), ground=ground, corotational=choice, links=links, damping=damping).integrate(h=1e-4)
        for choice in (False, True)
    )
    assert np.abs(turning.u).max() > 0.02
    np.testing.assert_allclose(turning.u, linear.u, rtol=0, atol=1e-3 * np.abs(linear.u).max())


def between(first, second, section=BEAM, **options):
    """Return the portal with another member."""
    frame = portal()
    frame.member(first, second, section, **options)
    return frame


def with_names_that_run_together():
    frame = portal()
    for k, name in enumerate(("1", "1-1")):
        frame.node(name, k, 9.0)
    frame.member("1", "1-1", COLUMN, hinges={"start": LAW})
    frame.member("1-1", "1", COLUMN, hinges={"start": LAW})


LIGHT = Section(E=2.1e11, A=1e-2, I=1e-4)
AT = {"start": LAW}
test_what_is_wrong_is_refused_in_a_sentence = refusals(
    {
        'hinges must be at "start" or "end", where .* has a moment': lambda: between("c", "d", hinges={"middle": LAW}),
        "where the member has a moment.*": lambda: between("a", "c", releases="start", hinges=AT),
        r"c-d\(2\)\.rz_start must have inertia, because a hinge joins it": lambda: between(
            "c", "d", LIGHT, hinges=AT
        ).problem((0, 1)),
        "two hinges have the name 1-1-1.rz_start: use names of nodes": with_names_that_run_together,
        r"hinges\['start'\] has no r: did you mean": lambda: in_space(hinges={"start": {"r": LAW}}),
        "hinges of members in space are for linear frames": lambda: in_space(hinges={"start": {"ry": LAW}}).problem(
            (0, 1), corotational=True
        ),
    },
    {
        r"hinges\['start'\] must name directions in space, such as": lambda: in_space(hinges=AT),
        r"hinges\['end'\] must be a link of eig3.effects": lambda: between("c", "d", hinges={"end": 1e9}),
        r"hinges\['start'\] must be a link of eig3.effects, not 3\.0": lambda: in_space(hinges={"start": {"ry": 3.0}}),
    },
)
