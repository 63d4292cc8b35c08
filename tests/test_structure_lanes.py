"""Structures in the lanes of ensembles: written line by line, with the parameters that members share."""

import re

import numpy as np
import pytest

import eig3
from eig3.effects import (
    BoucWen,
    FrictionPendulum,
    LeadRubber,
    LinearDamper,
    LinearSpring,
    Maxwell,
)
from eig3.math import cos
from eig3.structures import base_shear, link_ductility, link_forces, storey_drifts

N = 4
M = np.array([1.0, 2.0, 3.0, 1.5])
K = 40 * np.array([[3.0, -1.0, 0.0, 0.0], [-1.0, 2.0, -1.0, 0.0], [0.0, -1.0, 2.0, -1.0], [0.0, 0.0, -1.0, 1.0]])
C = 0.2 * np.diag([1.0, 0.0, 2.0, 1.0])
T = np.r_[0, np.sort(np.random.default_rng(1).uniform(0, 3, 60)), 3.2]  # uneven; the run is longer
GROUND = T, np.sin(5 * T), np.array([1.0, 1.0, 0.5, 0.0])
TABLE = T, np.column_stack([np.cos(3 * T), np.sin(T)]), [3, 1]
RAYLEIGH = eig3.Rayleigh(0.05, 3.0, 15.0)
LINKS = [
    (BoucWen(20.0, 0.05, 0.1, sharpness=2.0), None, [0, 1]),
    (Maxwell(10.0, 2.0), 0, 3),
    (LinearDamper(0.2), 2, None),
]
BEARINGS = [
    (LeadRubber(20.0, 1.0, 0.05), None, [(0, 1), (3, 2)]),
    (FrictionPendulum(0.1, 1.0, 9.0, 0.03), (0, 1), (2, None)),
]
DEGRADING = [(BoucWen(20.0, 0.05, 0.1, deltaNu=0.3, deltaEta=0.2), 0, [1, 2]), (BoucWen(20.0, 0.05), None, 3)]
SCALES = np.linspace(0.3, 3, 40)
MEMBERS = 0, 7, 39


@eig3.jit
def push(t, u, v, p, out):
    out[0] += p.strength * cos(t)
    out[2] -= p.strength * u[2] * u[2] * u[2]


STRUCTURES = {
    "ground": ({"ground": GROUND}, "ground_scale"),
    "table": ({"force": TABLE, "damping": RAYLEIGH}, "force_scale"),
    "modal damping and C": ({"ground": GROUND, "damping": eig3.Modal(0.05, 3), "C": C}, "ground_scale"),
    "links": ({"ground": GROUND, "links": LINKS, "damping": RAYLEIGH}, "ground_scale"),
    "function": ({"force": push, "params": {"strength": 1.0}, "links": LINKS}, "strength"),
    "work": ({"ground": GROUND, "work": True, "damping": RAYLEIGH, "C": C, "links": LINKS}, "ground_scale"),
    "degrading": ({"ground": GROUND, "links": DEGRADING, "damping": RAYLEIGH}, "ground_scale"),
    "bearings": ({"ground": GROUND, "work": True, "links": BEARINGS, "damping": RAYLEIGH}, "ground_scale"),
    "stiffness of links": ({"ground": GROUND, "links": LINKS[:1]}, "link_0_stiffness"),
}


def structure(options):
    options = dict(options)
    return eig3.linear(M, options.pop("C", None), K, t_span=(0, 4), u0=[0.1, 0, 0, 0.2], **options)


OWN_STEPS = np.linspace(0.008, 0.01, 40)
TERMS = STRUCTURES.keys() - {"ground", "links"}  # "work" has these terms too
CASES = [*((kind, OWN_STEPS) for kind in sorted(TERMS)), ("function", 0.01), ("work", 0.01)]  # have all other terms
WITH_ALL_OUTPUTS = "function", "work", "bearings"


@pytest.mark.parametrize(("kind", "h"), CASES, ids=[f"{kind}, {'own ' * np.ndim(h)}steps" for kind, h in CASES])
def test_members_are_single_runs(kind, h):
    """The order of sums differs: the difference is some multiples of round-off, which grow slowly in 500 steps."""
    options, name = STRUCTURES[kind]
    problem = structure(options)
    own = np.multiply.outer(SCALES, getattr(problem.params, name))
    outputs = {"pulls": link_forces(problem)} if "links" in options else {"drift": storey_drifts(problem, range(N))}
    if kind in WITH_ALL_OUTPUTS:
        outputs |= {"drift": storey_drifts(problem, range(N)), "ductility": link_ductility(problem)}
        outputs |= {"shear": base_shear(problem)} if "ground" in options else {}
    members = problem.ensemble(params={name: own}, h=h, outputs=outputs)
    assert not [note for note in members.notes if "one at a time" in note]
    for i in MEMBERS:
        alone = problem.with_(params=problem.params._replace(**{name: own[i]}))
        run = alone.integrate(h=np.broadcast_to(h, 40)[i], outputs=outputs)
        last = len(run.u) - 1
        np.testing.assert_allclose(members.u[i][-1], run.u[last], rtol=0, atol=1e-11)
        for key, values in run.extremes.items():
            tolerance = 1e-10 * max(1.0, np.abs(values.high).max())
            np.testing.assert_allclose(members.extremes[key].high[i], values.high, rtol=0, atol=tolerance)
        for key, z in run.z.items():
            np.testing.assert_allclose(members.z[key][i][-1], z[last], rtol=0, atol=1e-10)


@pytest.mark.parametrize("edge", [2, 3])
def test_blocks(edge):
    """A chain of points that move in two or three directions, with K of blocks."""
    rng = np.random.default_rng(edge)
    n, k = 3 * edge, np.zeros((3 * edge, 3 * edge))
    for point in range(3):
        full = rng.normal(size=(edge, edge))
        own = slice(edge * point, edge * (point + 1))
        k[own, own] += 30 * (full @ full.T + np.eye(edge))
        if point:
            before = slice(edge * (point - 1), edge * point)
            k[own, before] -= 3 * np.ones((edge, edge))
            k[before, own] -= 3 * np.ones((edge, edge))
    problem = eig3.linear(np.ones(n), None, k, damping=RAYLEIGH, ground=(T, np.sin(4 * T)), t_span=(0, 4))
    assert problem.params.K.edge == edge
    members = problem.ensemble(params={"ground_scale": SCALES}, h=0.01)
    assert members.notes == ()
    run = problem.with_(params=problem.params._replace(ground_scale=SCALES[7])).integrate(h=0.01)
    np.testing.assert_allclose(members.u[7, -1], run.u[-1], rtol=0, atol=1e-11)


def test_members_with_their_own_starts_share_all_parameters():
    problem = structure({"ground": GROUND, "links": LINKS})
    starts = np.random.default_rng(2).normal(size=(40, N)) / 10
    members = problem.ensemble(u0=starts, h=0.01)
    assert members.notes == ()
    for i in MEMBERS:
        run = problem.with_(u0=starts[i]).integrate(h=0.01)
        np.testing.assert_allclose(members.u[i, -1], run.u[-1], rtol=0, atol=1e-11)


def test_each_member_may_have_its_own_record():
    problem = structure({"ground": GROUND, "links": LINKS})
    records = np.random.default_rng(3).normal(size=(40, T.size))
    members = problem.ensemble(params={"ground": records, "ground_scale": SCALES}, h=0.01)
    assert members.notes == ()
    for i in MEMBERS:
        has = problem.params._replace(ground=records[i], ground_scale=SCALES[i])
        run = problem.with_(params=has).integrate(h=0.01)
        np.testing.assert_allclose(members.u[i, -1], run.u[-1], rtol=0, atol=1e-10)


def test_a_member_does_not_depend_on_the_others():
    """Bit by bit: also alone, on another thread, and in parts."""
    problem = structure({"ground": GROUND, "links": LINKS})
    whole = problem.ensemble(params={"ground_scale": SCALES}, h=0.01)
    alone = problem.ensemble(params={"ground_scale": SCALES[7:8]}, h=0.01, threads=1)
    parts = problem.ensemble(params={"ground_scale": SCALES}, h=0.01, reduce=lambda part: part.u)
    np.testing.assert_array_equal(alone.u[0], whole.u[7])
    np.testing.assert_array_equal(np.concatenate(parts), whole.u)


def test_a_first_passage_ends_members_in_lanes():
    @eig3.jit
    def passes(t, u, v, z, p):
        return p.limit - abs(u[0])

    problem = structure({"force": push, "params": {"strength": 1.0, "limit": 0.3}, "links": LINKS})
    events = {"passage": eig3.Event(passes, terminal=True)}
    members = problem.ensemble(params={"strength": 10 * SCALES}, h=0.01, events=events)
    assert not [note for note in members.notes if "one at a time" in note]
    i = int(np.argmax(members.status == eig3.Status.TERMINATED))
    run = problem.with_(params=problem.params._replace(strength=10 * SCALES[i])).integrate(h=0.01, events=events)
    assert run.status is eig3.Status.TERMINATED
    np.testing.assert_allclose(members.u[i, -1], run.u[-1], rtol=0, atol=1e-9)


def test_structures_of_other_sizes_and_patterns_do_not_share_code():
    for links in ([(LinearSpring(5.0), 0, 2)], [(LinearSpring(5.0), 1, 3)], []):
        problem = structure({"ground": GROUND, "links": links})
        members = problem.ensemble(params={"ground_scale": SCALES}, h=0.01)
        run = problem.with_(params=problem.params._replace(ground_scale=SCALES[7])).integrate(h=0.01)
        np.testing.assert_allclose(members.u[7, -1], run.u[-1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("kind", sorted(STRUCTURES.keys() - {"function"}))
def test_the_right_hand_side_is_vectorised(kind):
    """The notes of an ensemble would say that it is not, as they do for a force that adds to entries of an array."""
    options, name = STRUCTURES[kind]
    problem = structure(options)
    own = np.multiply.outer(SCALES, getattr(problem.params, name))
    members = problem.ensemble(params={name: own}, h=0.01, invariants={})
    assert members.notes == ()


def test_a_consistent_mass_runs_alone_and_says_so():
    mass = np.array([[2.0, 1.0], [1.0, 2.0]])
    problem = eig3.linear(mass, None, 20 * np.eye(2), ground=(T, np.sin(T)), t_span=(0, 4))
    members = problem.ensemble(params={"ground_scale": SCALES}, h=0.01)
    assert re.search("one at a time, because params have a sparse matrix", members.notes[0])
