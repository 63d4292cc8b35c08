"""Structures in the lanes of ensembles: written line by line, with the parameters that members share."""

import numpy as np
import pytest

import eig3
from eig3.effects import BoucWen, FrictionPendulum, LeadRubber, LinearDamper, LinearSpring, Maxwell
from eig3.math import cos
from eig3.structures import base_shear, link_ductility, link_forces, storey_drifts

N = 4
M = np.array([1.0, 2.0, 3.0, 1.5])
K = 40 * np.array([[3.0, -1.0, 0.0, 0.0], [-1.0, 2.0, -1.0, 0.0], [0.0, -1.0, 2.0, -1.0], [0.0, 0.0, -1.0, 1.0]])
T = np.r_[0, np.sort(np.random.default_rng(1).uniform(0, 3, 60)), 3.2]  # uneven; the run is longer
GROUND = T, np.sin(5 * T), np.array([1.0, 1.0, 0.5, 0.0])
TABLE = T, np.column_stack([np.cos(3 * T), np.sin(T)]), [3, 1]
LINKS = [
    (BoucWen(20.0, 0.05, 0.1, sharpness=2.0), None, [0, 1]),
    (Maxwell(10.0, 2.0), 0, 3),
    (LinearDamper(0.2), 2, None),
]
BEARINGS = [
    (LeadRubber(20.0, 1.0, 0.05), None, [(0, 1), (3, 2)]),
    (FrictionPendulum(0.1, 1.0, 9.0, 0.03), (0, 1), (2, None)),
]
SCALES = np.linspace(0.3, 3, 40)
MEMBERS = 0, 7, 39


@eig3.jit
def push(t, u, v, p, out):
    out[0] += p.strength * cos(t)
    out[2] -= p.strength * u[2] * u[2] * u[2]


passes = eig3.jit(lambda t, u, v, z, p: p.limit - abs(u[0]))

FUNCTION = {"force": push, "params": {"strength": 1.0, "limit": 0.3}, "links": LINKS[:1]}
#: Each term of the equation of motion is in a structure. The parameters that follow differ from member to member.
STRUCTURES = {
    "work": (
        {"ground": GROUND, "force": TABLE, "work": True, "damping": eig3.Rayleigh(0.05, 3.0, 15.0), "links": LINKS}
        | {"C": 0.2 * np.diag([1.0, 0.0, 2.0, 1.0])},
        ("ground_scale", "force_scale"),
    ),
    "bearings": (
        {"ground": GROUND, "work": True, "damping": eig3.Modal(0.05, 3), "links": BEARINGS},
        ("ground_scale", "link_0_stiffness"),
    ),
    "function": (FUNCTION, ("strength",)),
    "degrading": (
        {"ground": GROUND, "links": [(BoucWen(20.0, 0.05, 0.1, deltaNu=0.3, deltaEta=0.2), 0, [1, 2])]},
        ("ground_scale",),
    ),
}


def structure(kind):
    options = dict(STRUCTURES[kind][0])
    return eig3.linear(M, options.pop("C", None), K, t_span=(0, 4), u0=[0.1, 0, 0, 0.2], **options)


def scaled(kind):
    """Return the structure of a kind, and the parameters of members."""
    problem = structure(kind)
    return problem, {name: np.multiply.outer(SCALES, getattr(problem.params, name)) for name in STRUCTURES[kind][1]}


@pytest.mark.parametrize("kind", ["work", "bearings", "function"])
def test_members_are_single_runs(kind):
    """The order of sums differs: the difference is some multiples of round-off, which grow slowly in 500 steps."""
    problem, own = scaled(kind)
    h = np.linspace(0.008, 0.01, 40)
    if kind == "bearings":
        given = {"outputs": {"ductility": link_ductility(problem)}, "invariants": {}}
    else:
        given = {"outputs": {"pulls": link_forces(problem)}}
    if kind == "work":
        given["outputs"] |= {"shear": base_shear(problem), "drift": storey_drifts(problem, range(N))}
    members = problem.ensemble(params=own, h=h, **given)
    assert members.notes == ()  # the right-hand side has vectors: a note would say that it has none
    for i in MEMBERS:
        alone = problem.with_(params=problem.params._replace(**{name: values[i] for name, values in own.items()}))
        run = alone.integrate(h=h[i], **given)
        last = len(run.u) - 1
        np.testing.assert_allclose(members.u[i][-1], run.u[last], rtol=0, atol=1e-11)
        for key, values in run.extremes.items():
            tolerance = 1e-10 * max(1.0, np.abs(values.high).max())
            np.testing.assert_allclose(members.extremes[key].high[i], values.high, rtol=0, atol=tolerance)
        for key, z in run.z.items():
            np.testing.assert_allclose(members.z[key][i][-1], z[last], rtol=0, atol=1e-10)


def test_blocks():
    """Two points that move in two directions, with K of blocks."""
    edge = 2
    full = np.random.default_rng(edge).normal(size=(2 * edge, 2 * edge))
    k = 30 * (full @ full.T + np.eye(2 * edge))
    problem = eig3.linear(np.ones(2 * edge), None, k, damping=eig3.Rayleigh(0.05, 3.0, 15.0), t_span=(0, 4))
    assert problem.params.K.edge == edge
    starts = np.random.default_rng(1).normal(size=(40, 2 * edge))
    members = problem.ensemble(u0=starts, h=0.01)
    assert members.notes == ()
    run = problem.with_(u0=starts[7]).integrate(h=0.01)
    np.testing.assert_allclose(members.u[7, -1], run.u[-1], rtol=0, atol=1e-11)


def test_each_member_may_have_its_own_record_and_does_not_depend_on_the_others():
    """Bit by bit: also alone, on another thread, and in parts."""
    problem = structure("degrading")
    own = {"ground": np.random.default_rng(3).normal(size=(40, T.size)), "ground_scale": SCALES}
    members = problem.ensemble(params=own, h=0.01)
    assert members.notes == ()
    for i in MEMBERS:
        has = problem.params._replace(**{name: values[i] for name, values in own.items()})
        run = problem.with_(params=has).integrate(h=0.01)
        np.testing.assert_allclose(members.u[i, -1], run.u[-1], rtol=0, atol=1e-10)
        np.testing.assert_allclose(members.z["bouc wen"][i, -1], run.z["bouc wen"][-1], rtol=0, atol=1e-10)
    alone = problem.ensemble(params={name: values[7:8] for name, values in own.items()}, h=0.01, threads=1)
    parts = problem.ensemble(params=own, h=0.01, reduce=lambda part: part.u)
    np.testing.assert_array_equal(alone.u[0], members.u[7])
    np.testing.assert_array_equal(np.concatenate(parts), members.u)


def test_a_first_passage_ends_members_in_lanes():
    problem, events = structure("function"), {"passage": eig3.Event(passes, terminal=True)}
    h = np.linspace(0.008, 0.01, 40)
    members = problem.ensemble(params={"strength": 10 * SCALES}, h=h, events=events)
    assert not [note for note in members.notes if "one at a time" in note]
    i = int(np.argmax(members.status == eig3.Status.TERMINATED))
    run = problem.with_(params=problem.params._replace(strength=10 * SCALES[i])).integrate(h=h[i], events=events)
    assert run.status is eig3.Status.TERMINATED
    np.testing.assert_allclose(members.u[i, -1], run.u[-1], rtol=0, atol=1e-9)


def test_structures_of_other_patterns_do_not_share_code():
    """A member alone shares its parameters, as many members do: it runs in lanes too, with the same bits."""
    for ends in ((0, 2), (1, None)):
        problem = eig3.linear(M[:3], None, K[:3, :3], t_span=(0, 4), v0=M[:3], links=[(LinearSpring(5.0), *ends)])
        v0 = np.multiply.outer(SCALES, M[:3])
        members, alone = problem.ensemble(v0=v0, h=0.01), problem.ensemble(v0=v0[7:8], h=0.01)
        run = problem.with_(v0=v0[7]).integrate(h=0.01)
        np.testing.assert_allclose(members.u[7, -1], run.u[-1], rtol=0, atol=1e-12)
        assert alone.notes == ()
        np.testing.assert_array_equal(alone.u[0], members.u[7])
